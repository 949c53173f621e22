# SPDX-License-Identifier: Apache-2.0
"""Residuals of a rod on fixed contact points against their plain twin; their tangent against differences."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from nodal_scenes import STIFFNESS, rotation, shapes
from references import plain_rod
from scipy.spatial.transform import Rotation

from cable_ros.contact.distance import gap
from cable_ros.contact.nodal_kernels import OPEN, SLIP, STICK, TURNING, YIELD, residuals
from cable_ros.contact.nodal_newton import move
from cable_ros.contact.nodal_rod import NodalRod
from cable_ros.contact.nodal_state import State, Step
from cable_ros.contact.nodal_tangent import jacobian
from cable_ros.rod import quaternion

CELLS = 6
STEP = 1e-6
KINDS = OPEN, STICK, SLIP
ROUNDING = 1e-12


@dataclass
class Sample:
    """A rod far from any equilibrium, every boundary in contact with every obstacle in one of three ways."""

    rod: NodalRod
    step: Step
    kinds: np.ndarray
    """(m + 1, o) as they were made."""


def frame(body: np.ndarray, r: np.ndarray, reference: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """Gap, normal (3,) and directions (2, 3) across it, the first as near to the reference as can be."""
    n = np.empty(3)
    phi = gap(body, r, n, np.empty((2, 3)), np.empty(2))
    first = reference - (reference @ n) * n
    first /= np.linalg.norm(first)
    return phi, n, np.array([first, np.cross(n, first)])


def sample(
    seed: int,
    drag: float = 0.0,
    bodies: np.ndarray | None = None,
    coulomb: bool = True,
    soft: float = 0.0,
    shears: float = 0.0,
) -> Sample:
    """A random one; its slipping friction is on the cone along the trial's direction."""
    rng = np.random.default_rng(seed)
    bodies = np.array(list(shapes(0.4).values())) if bodies is None else bodies
    if not coulomb:
        bodies[:, 17] = 0.0
    count = len(bodies)
    rod = NodalRod(STIFFNESS, rng.normal(size=3), bodies, CELLS, True, np.array([shears, 0.7 * shears, soft]))
    m, state = len(rod.h), rod.state
    s = rod.mesh.nodes[:, None]
    turn = 2.0 * s * rng.normal(size=3) + np.sin(4.0 * s + rng.normal(size=3)) - np.sin(rng.normal(size=3))
    quaternion.retract(np.tile([1.0, 0, 0, 0], (len(s), 1)), turn.ravel(), state.q)
    state.r[:] = np.linspace(0, 1, m + 1)[:, None] * [0.05, 0.02, 0.9] + 0.05 * rng.normal(size=(m + 1, 3))
    state.F[:] = 20 * rng.normal(size=(m, 3))
    step = Step(
        rotation(rng.normal(size=3)), rng.normal(size=3), 30 * rng.normal(size=3), bodies,
        np.empty((m + 1, count, 3)), np.empty((m + 1, count, 3)), np.zeros((m + 1, count, 2)),
        state.q.copy(), state.r + 0.1 * rng.normal(size=state.r.shape), drag, 50.0, 80.0,
        np.full((m + 1, count), 1e-3),
    )  # fmt: skip
    kinds = rng.permuted(np.resize(KINDS, (m + 1, count)), axis=0)
    for k in range(m + 1):
        for o in range(count):
            # the directions go along with the normal: at the last equilibrium they were across it
            phi, n, d = frame(bodies[o], state.r[k], rng.normal(size=3))
            step.turned[k, o] = d[0]
            push = 5.0 + 5.0 * rng.random() if kinds[k, o] != OPEN else -5.0
            lam = (push + step.normal * phi) / (1.0 - step.normal * YIELD)
            state.lam[k, o] = lam if lam != 0.0 else 1.0
            along = rng.normal(size=2)
            along /= np.linalg.norm(along)
            radius = bodies[o, 17] * push
            if kinds[k, o] == SLIP:
                state.tau[k, o] = radius * along
                u = -(0.1 + rng.random()) * along
            else:
                state.tau[k, o] = 0.3 * radius * along
                step.tau[k, o] = rng.normal(size=2)
                u = 0.2 * radius / step.tangential * rng.normal(size=2) / 3.0
            step.carried[k, o] = state.r[k] - u @ d + 0.1 * rng.normal() * n
    if not coulomb:
        kinds[kinds == STICK] = SLIP  # without friction there is nothing to stick
    return Sample(rod, step, kinds)


def vector(at: Sample, state: State) -> np.ndarray:
    """All residuals at a state, numbered as its unknowns; the end's rows are left zero."""
    rod = at.rod
    residuals(state, rod._model, at.step, rod._work)
    rows, work = rod._rows, rod._work
    out = np.zeros(rod._size[0])
    for i in range(1, len(rows.psi) - 1):
        out[rows.psi[i] : rows.psi[i] + 3] = work.evaluation.g[i]
    for e in range(len(rows.F)):
        out[rows.F[e] : rows.F[e] + 3] = work.mismatch[e]
    for k in range(1, len(rows.F)):
        out[rows.r[k] : rows.r[k] + 3] = work.balance[k]
        for o in range(rows.contact.shape[1]):
            if rows.contact[k, o] >= 0:
                out[rows.contact[k, o] : rows.contact[k, o] + 3] = work.contact[k, o]
    return out


def tangent(at: Sample) -> tuple[np.ndarray, np.ndarray]:
    """Dense tangent and right-hand side."""
    rod = at.rod
    residuals(rod.state, rod._model, at.step, rod._work)
    a, b = rod._band.a, rod._band.b
    rod._size = total, low = jacobian(
        rod.state, rod._model, at.step, rod._work, rod._tangents, rod._rows, a, b
    )  # fmt: skip
    out = np.zeros((total, total))
    for i in range(total):
        first, last = max(0, i - low), min(total, i + low + 1)
        out[i, first:last] = a[i, low + first - i : low + last - i]
    return out, b[:total].copy()


def axes(at: Sample, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Section's axes (m, g, 3, 3), columns, of the frames q at the Gauss points of all elements, and their
    weights (g,).
    """
    element = at.rod.mesh.element
    places = at.rod.s0[:, None] + at.rod.h[:, None] * element.points
    frames = np.roll(at.rod.mesh.interpolate(q, places.ravel()), -1, axis=1)
    return Rotation.from_quat(frames).as_matrix().reshape(*places.shape, 3, 3), element.tables.weights


def pull(at: Sample) -> np.ndarray:
    """(n, 3) derivative of -1/2 integral sum c (F.d)^2 ds by the nodes' rotations, by differences."""
    rod, n = at.rod, len(at.rod.state.q)

    def energy(psi: np.ndarray) -> float:
        q = np.empty((n, 4))
        quaternion.retract(rod.state.q, psi, q)
        d, w = axes(at, q)
        forces = np.einsum("ea,egab->egb", rod.state.F, d)
        return -0.5 * float((rod.h[:, None] * w * (forces**2 @ rod.compliance)).sum())

    units = 1e-3 * np.eye(3 * n)
    columns = [8 * (energy(u) - energy(-u)) - energy(2 * u) + energy(-2 * u) for u in units]
    return np.reshape(columns, (n, 3)) / 12e-3


def plain(at: Sample) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Moments (n, 3), ways (m, 3), forces (m + 1, 3), contacts (m + 1, o, 3) from their definitions."""
    rod, state, step = at.rod, at.rod.state, at.step
    m, zero = len(rod.h), np.zeros(3)
    g, _ = plain_rod.gradients(
        state.q, np.zeros((len(state.q), 3)), state.F, zero, rod.K, rod.natural, rod.mesh
    )
    moments = g.reshape(-1, 3) + pull(at)
    for i in range(1, len(moments) - 1):
        back = quaternion.conjugate(step.q[i])
        moments[i] += TURNING * step.drag / CELLS * quaternion.rotation_vector(
            quaternion.multiply(back, state.q[i])
        )  # fmt: skip
    ways, forces = np.empty((m, 3)), np.zeros((m + 1, 3))
    contacts = np.zeros((m + 1, len(step.obstacles), 3))
    for e in range(m):
        # the integral of the tangents over one element: what the end goes on if that alone has force
        ways[e] = state.r[e + 1] - state.r[e]
        for a in range(3):
            F = np.zeros((m, 3))
            F[e, a] = 1.0
            ways[e, a] += plain_rod.integrals(state.q, F, zero, 0.0 * rod.K, zero, rod.mesh)[0].real
        d, w = axes(at, state.q)
        ways[e] -= rod.h[e] * np.einsum("g,gab,b,gcb,c->a", w, d[e], rod.compliance, d[e], state.F[e])
    for k in range(1, m):
        forces[k] = state.F[k - 1] - state.F[k] - step.f / CELLS
        forces[k] += step.drag / CELLS * (state.r[k] - step.r[k])
        for o, body in enumerate(step.obstacles):
            phi, n, d = frame(body, state.r[k], step.turned[k, o])
            lam, tau = state.lam[k, o], state.tau[k, o]
            forces[k] -= lam * n + tau @ d
            push = max(0.0, lam - step.normal * (phi + YIELD * lam))
            trial = tau - step.tangential * (
                d @ (state.r[k] - step.carried[k, o]) + step.give[k, o] * (tau - step.tau[k, o])
            )
            cone = body[17] * push
            size = np.linalg.norm(trial)
            cut = trial if size <= cone else cone * trial / size
            contacts[k, o] = np.append(lam - push, tau - cut)
    return moments, ways, forces, contacts


@pytest.mark.parametrize(("soft", "shears"), [(0.0, 0.0), (0.02, 0.0), (0.0, 0.03), (0.01, 0.03)])
@pytest.mark.parametrize(("seed", "drag"), [(0, 0.0), (1, 0.0), (2, 100.0)])
def test_residuals_are_their_plain_twins(seed: int, drag: float, soft: float, shears: float) -> None:
    at = sample(seed, drag, soft=soft, shears=shears)
    tangent(at)
    vector(at, at.rod.state)
    work = at.rod._work
    assert np.array_equal(work.kinds[1:-1], at.kinds[1:-1])
    assert work.near[1:-1].all()
    moments, ways, forces, contacts = plain(at)
    assert work.mismatch == pytest.approx(ways, abs=ROUNDING)
    assert work.balance == pytest.approx(forces, abs=1e3 * ROUNDING)
    assert work.contact == pytest.approx(contacts, abs=1e3 * ROUNDING)
    inner, rounding = slice(1, -1), 1e3 * ROUNDING if soft == shears == 0.0 else 1e-7  # differences
    assert work.evaluation.g[inner] == pytest.approx(moments[inner], abs=rounding)
    assert work.evaluation.g[[0, -1]] == pytest.approx(moments[[0, -1]], abs=rounding)


@pytest.mark.parametrize("coulomb", [True, False])
@pytest.mark.parametrize("drag", [0.0, 100.0])
@pytest.mark.parametrize(
    ("seed", "soft", "shears"),
    [
        *((seed, 0.0, 0.0) for seed in range(4)),
        (0, 0.02, 0.0),
        (1, 0.005, 0.0),
        (2, 0.0, 0.03),
        (3, 0.01, 0.02),
    ],
)
def test_the_tangent_is_the_derivative(
    seed: int, soft: float, shears: float, drag: float, coulomb: bool
) -> None:
    at = sample(seed, drag, coulomb=coulomb, soft=soft, shears=shears)
    state, rows = at.rod.state, at.rod._rows
    exact, b = tangent(at)
    total = len(b)
    inner = np.ones(total, bool)
    for first in (rows.r[-1], rows.psi[-1]):
        inner[first : first + 3] = False
    here = vector(at, state)
    assert b[inner] == pytest.approx(-here[inner], abs=1e-9)
    work = at.rod._work
    assert {int(kind) for kind in work.kinds[1:-1].ravel()} == ({*KINDS} if coulomb else {OPEN, SLIP})
    # the tangent leaves out that moments turn with their own sections, half as much by this chart
    for i in range(1, len(rows.psi) - 1):
        g = work.evaluation.g[i]
        cross = np.array([[0.0, -g[2], g[1]], [g[2], 0.0, -g[0]], [-g[1], g[0], 0.0]])
        at_i = slice(rows.psi[i], rows.psi[i] + 3)
        exact[at_i, at_i] += 0.5 * cross
    new = at.rod._trial
    found = np.empty((total, total))
    for j in range(total):
        unit = np.zeros(total)
        unit[j] = 1.0
        sides = []
        for part in (STEP, -STEP):
            move(state, unit, part, rows, new)
            sides.append(vector(at, new))
        found[:, j] = (sides[0] - sides[1]) / (2 * STEP)
    # rounding of numbers of about 1e3 over the step, and its square by the third derivatives
    assert np.abs(found - exact)[inner].max() < 1e-8 * np.abs(exact).max()
    ends = exact[~inner]
    assert np.abs(ends).sum() == 6.0  # nothing but the ends' own motion
