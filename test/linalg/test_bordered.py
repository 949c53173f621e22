# SPDX-License-Identifier: Apache-2.0
"""The saddle system of a rod, with few and with many constraint rows, against dense linear algebra."""

from __future__ import annotations

import numpy as np
import pytest
from references.plain_rod import dense

from cable_ros.linalg import bordered
from cable_ros.rod import quaternion
from cable_ros.rod.elements import Mesh, reference_element
from cable_ros.rod.kirchhoff import Rod
from cable_ros.rod.rod_state import Tangents

ORDER = 4
# 1e-16 times the condition of these systems, up to 1e6.
CLOSE = 1e-9


def bent(seed: int, force: float) -> tuple[Rod, np.ndarray]:
    """A rod linearised at no equilibrium; a large force makes its Hessian indefinite."""
    rng = np.random.default_rng(seed)
    mesh = Mesh(reference_element(ORDER), np.array([0.3, 0.25, 0.45]))
    s = mesh.nodes[:, None]
    turn = 2.0 * s * rng.normal(size=3) + np.sin(3.0 * s + rng.normal(size=3))
    q = np.empty((len(s), 4))
    quaternion.retract(np.tile([1.0, 0.0, 0.0, 0.0], (len(s), 1)), turn.ravel(), q)
    rod = Rod(mesh, np.array([1.0, 1.4, 0.7]))
    rod.set_conditions(q[-1], np.array([0.2, 0.1, 0.5]), rng.normal(size=3) * 5)
    _, _, gradient = rod.linearize(q, force * rng.normal(size=3))
    return rod, gradient


def matrices(rod: Rod, mu: float = 0.0) -> tuple[np.ndarray, np.ndarray, slice]:
    """H + mu D (with the part that is always added), C, and the rows of the inner nodes."""
    inner = slice(3, len(rod.elastic) - 3)
    elastic, geometric = dense(rod.elastic)[inner, inner], dense(rod.geometric)[inner, inner]
    return (1.0 + bordered.NEUTRAL + mu) * elastic + geometric, rod.C[:, inner], inner


def positive_on_kernel(H: np.ndarray, C: np.ndarray) -> bool:
    _, _, basis = np.linalg.svd(C)
    tangent = basis[len(C) :]
    eigenvalues = np.linalg.eigvalsh(tangent @ H @ tangent.T)
    assert np.abs(eigenvalues).min() > 1e-9  # otherwise there would be nothing to decide
    return bool(eigenvalues[0] > 0)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("force", [1.0, 10.0, 60.0])
@pytest.mark.parametrize("mu", [0.0, 0.3, 5.0])
def test_inertia_tells_minima_on_the_tangent_space(seed: int, force: float, mu: float) -> None:
    rod, _ = bent(seed, force)
    H, C, _ = matrices(rod, mu)
    assert rod.factor(mu) == positive_on_kernel(H, C)


def test_those_states_are_of_both_kinds() -> None:
    outcomes = [bent(seed, force)[0].factor(0.0) for seed in range(4) for force in (1.0, 10.0, 60.0)]
    assert True in outcomes
    assert False in outcomes


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("mu", [0.0, 0.5])
def test_step(seed: int, mu: float) -> None:
    rod, gradient = bent(seed, 10.0)
    H, C, inner = matrices(rod, mu)
    rod.factor(mu)
    violation = np.array([0.1, -0.2, 0.05])
    s, dF = rod.step(gradient, violation)
    both = np.block([[H, -C.T], [C, np.zeros((3, 3))]])
    expected = np.linalg.solve(both, -np.concatenate([gradient[inner], violation]))
    assert s[inner] == pytest.approx(expected[:-3], abs=CLOSE * np.abs(expected).max())
    assert dF == pytest.approx(expected[-3:], abs=CLOSE * np.abs(expected).max())
    assert not s[:3].any()
    assert not s[-3:].any()


@pytest.mark.parametrize("seed", range(3))
def test_normal_step_is_the_shortest_that_closes_the_gap(seed: int) -> None:
    rod, _ = bent(seed, 10.0)
    violation = np.array([0.1, -0.2, 0.05])
    s = rod.normal_step(violation)
    # The damping that keeps a straight rod's step finite leaves a part of 1e-9 (of the trace).
    assert rod.derivative(s) == pytest.approx(-violation, abs=1e-6)
    D, C, inner = dense(rod.elastic), rod.C, slice(3, len(rod.elastic) - 3)
    other = np.linalg.lstsq(C[:, inner], -violation, rcond=None)[0]
    assert rod.norm(s) ** 2 == pytest.approx(s @ D @ s)
    assert s[inner] @ D[inner, inner] @ s[inner] <= other @ D[inner, inner] @ other * (1 + 1e-9)


def test_products_of_the_problem() -> None:
    rod, _ = bent(0, 10.0)
    s = np.random.default_rng(0).normal(size=len(rod.elastic))
    assert rod.apply_hessian(s) == pytest.approx((dense(rod.elastic) + dense(rod.geometric)) @ s, abs=1e-10)
    assert rod.derivative(s) == pytest.approx(rod.C @ s)


def tangents(rod: Rod) -> Tangents:
    return Tangents(rod.elastic, rod.geometric, rod.dchord, rod.C)


def constraint_rows(rod: Rod, extra: int, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """C and `extra` more rows V, their deltas, and the inner columns of V."""
    rng = np.random.default_rng([seed, extra])
    V = np.vstack([rod.C, rng.normal(size=(extra, rod.C.shape[1]))])
    delta = np.concatenate([np.zeros(3), 10.0 ** rng.uniform(-2, 1, extra)])
    return V, delta, V[:, 3:-3]


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("extra", [0, 1, 4, 16])
@pytest.mark.parametrize("force", [1.0, 60.0])
@pytest.mark.parametrize("soft", [0.0, 0.1])
def test_what_has_a_compliance_is_held_by_springs(seed: int, extra: int, force: float, soft: float) -> None:
    """Constraint rows and, with `soft`, the end, whose compliance is a matrix."""
    rod, gradient = bent(seed, force)
    H, C, inner = matrices(rod)
    V, delta, Vi = constraint_rows(rod, extra, seed)
    rows, n = 3 + extra, len(rod.elastic)
    Y, S = np.zeros((rows, n)), np.zeros((rows, rows))
    factors = bordered.Factors(rod.A, rod.L, rod.pivots, Y, S)
    root = np.random.default_rng(seed).normal(size=(3, 3))
    give, none = soft * root @ root.T, np.zeros((0, 0))
    convex = bordered.kkt_factor(tangents(rod), 0.0, ORDER, factors, V, V, False, delta, none, give, rows, 3)
    sprung = H + sum((np.outer(v, v) / d for v, d in zip(Vi[3:], delta[3:], strict=True)), np.zeros_like(H))
    if soft:
        sprung, C = sprung + C.T @ np.linalg.solve(give, C), np.zeros((0, len(H)))
    assert convex == positive_on_kernel(sprung, C)

    violation = np.random.default_rng(seed).normal(size=rows)
    s, y = np.empty(n), np.empty(rows)
    bordered.kkt_step(gradient, violation, V, rows, ORDER, factors, s, y)
    both = np.block([[H, -Vi.T], [Vi, np.diag(delta)]])
    both[len(H) : len(H) + 3, len(H) : len(H) + 3] += give
    expected = np.linalg.solve(both, -np.concatenate([gradient[inner], violation]))
    scale = CLOSE * np.abs(expected).max()
    assert s[inner] == pytest.approx(expected[:-rows], abs=scale)
    assert y == pytest.approx(expected[-rows:], abs=scale)


def test_turning_the_end_section() -> None:
    # The inner rows and the end position see H theta, C theta of the end rotation theta.
    rod, _ = bent(1, 10.0)
    H = dense(rod.elastic) + dense(rod.geometric)
    theta = np.array([0.3, -0.1, 0.2])
    turn = np.zeros(len(H))
    turn[-3:] = theta
    g, c = np.zeros(len(H)), np.zeros(3)
    bordered.end_coupling(tangents(rod), rod.C, 3, theta, g, c)
    assert g[:-3] == pytest.approx((H @ turn)[:-3], abs=1e-10)
    assert c == pytest.approx(rod.C @ turn, abs=1e-12)


def test_moment_of_the_end_clamp_after_a_step() -> None:
    rod, _ = bent(2, 10.0)
    H = dense(rod.elastic) + dense(rod.geometric)
    s = np.random.default_rng(0).normal(size=len(H))
    s[-3:] = 0.0
    dF = np.array([1.0, 2.0, -3.0])
    found = bordered.end_rows(tangents(rod), rod.C, 3, s, dF)
    assert found == pytest.approx((H @ s - rod.C.T @ dF)[-3:], abs=1e-10)


@pytest.mark.parametrize("seed", range(20))
def test_three_by_three(seed: int) -> None:
    rng = np.random.default_rng(seed)
    S = rng.normal(size=(3, 3))
    S = S + S.T
    b, x = rng.normal(size=3), np.empty(3)
    bordered.solve3(S, b, x)
    assert S @ x == pytest.approx(b, abs=1e-10)
    assert bordered.negative3(S) == np.sum(np.linalg.eigvalsh(S) < 0)


def test_three_by_three_with_zeros_on_the_diagonal() -> None:
    S = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 2.0]])
    x = np.empty(3)
    bordered.solve3(S, np.array([1.0, 2.0, 4.0]), x)
    assert x.tolist() == [2.0, 1.0, 2.0]
    assert bordered.negative3(S) == 1


@pytest.mark.parametrize("soft", [0.0, 0.1])
def test_an_eigenvalue_turned_by_rows_that_act_elsewhere_is_told(soft: float) -> None:
    """Without an energy the sign of the determinant tells whether an eigenvalue has gone through 0."""
    told: set[tuple[int, int]] = set()
    for seed in range(60):
        rod, _ = bent(seed, 2.0)
        H, C, inner = matrices(rod)
        V, delta, Vi = constraint_rows(rod, 4, seed)
        delta[3] *= -100.0  # below 0, as that of a point that rolls: its force pulls the cable along
        W = V.copy()
        W[3:] += 2.0 * np.random.default_rng([seed, 7]).normal(size=W[3:].shape)
        n, none, give = len(rod.elastic), np.zeros((0, 0)), soft * np.eye(3)
        factors = bordered.Factors(rod.A, rod.L, rod.pivots, np.zeros((7, n)), np.zeros((7, 7)))
        args = tangents(rod), 0.0, ORDER, factors, V, W, True, delta, none, give, 7, 3
        stable = bordered.kkt_factor(*args)
        numbers = []
        for own in (Vi, W[:, inner]):
            K = H + sum(np.outer(w, v) / d for w, v, d in zip(own[3:], Vi[3:], delta[3:], strict=True))
            if soft:
                basis = np.eye(len(H))
                K = K + C.T @ C / soft
            else:
                basis = np.linalg.svd(C)[2][3:]
            values = np.linalg.eigvals(basis @ K @ basis.T)
            numbers.append(int(((values.real < 0.0) & (np.abs(values.imag) < 1e-9)).sum()))
        without, with_others = numbers
        if max(numbers) <= 1:  # from one to two the sign changes as from one to none
            assert stable == (with_others == 0)
            told.add((without, with_others))
    assert told == {(0, 0), (1, 0), (0, 1), (1, 1)}


@pytest.mark.parametrize("seed", range(20))
def test_constraints_that_nearly_depend_on_each_other(seed: int) -> None:
    """An eigenvalue below the rounding of the largest one says nothing of samples, which give way a little;
    of points at one place it says that they depend on each other. A negative one above it is one.
    """
    rng = np.random.default_rng(seed)
    basis, _ = np.linalg.qr(rng.normal(size=(12, 12)))
    eigenvalues = 10.0 ** rng.uniform(-6.0, -1.0, 12)
    eigenvalues[0], eigenvalues[1] = 5e4, -1e-12
    for unstable in (False, True):
        eigenvalues[2] = -1e-7 if unstable else 1e-7
        S = basis * eigenvalues @ basis.T
        kept = S.copy()
        assert minimum(S, np.full(12, 1e-18)) is not unstable
        np.testing.assert_array_equal(S, kept)
    twice = np.diag([1.0, 0.0, 2.0]) + np.array([[0.0, 1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, 0.0]])
    assert not minimum(twice, np.zeros(3))


def minimum(S: np.ndarray, delta: np.ndarray) -> bool:
    """`bordered.is_minimum`, as Python can call it, where all eigenvalues have to be positive."""
    return bool(bordered.is_minimum.py_func(S, delta, len(S), len(S), 1.0))
