# SPDX-License-Identifier: Apache-2.0
"""Stiffness of a rod on fixed contact points against differences of solves."""

from __future__ import annotations

import numpy as np
import pytest
from nodal_scenes import advance, go, ground, matrix, pressed, raised, rotation, start

from cable_ros.branch.cold_start import Conditions
from cable_ros.branch.results import Tangent
from cable_ros.contact.distance import FRICTION_COEFFICIENT
from cable_ros.contact.nodal_rod import NodalRod
from cable_ros.contact.response import cross_matrix
from cable_ros.rod import quaternion, warm_step
from cable_ros.rod.units import Units

STEP = 4e-6
"""Of the differences, lengths and rad: their error is about its square times the third derivative."""
OFF = 1e-6
"""Relative difference that they leave."""
SHAPES = ("plane", "sphere", "capsule", "cylinder", "box")


def rigid(bodies: np.ndarray, shift: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """Obstacles turned about the origin, then shifted."""
    out, R = bodies.copy(), matrix(rotation(turn))
    for body in out:
        body[1:4] = R @ body[1:4] + shift
        body[4:13] = (R @ body[4:13].reshape(3, 3)).ravel()
    return out


def wrenches(rod: NodalRod, moving: int, turn: np.ndarray, shift: np.ndarray) -> np.ndarray:
    """(12 + 6 moving,) on the cable; the start clamp stands turned and shifted."""
    state, back = rod.state, matrix(rod.state.q[-1]).T
    forces = rod.contact_forces()
    out = [-state.F[0], rod.g[0], back @ state.F[-1], rod.g[-1]]
    R = matrix(rotation(turn))
    for o in range(moving):
        force = R @ forces[:, o].sum(axis=0)
        moment = R @ np.cross(state.r, forces[:, o]).sum(axis=0)
        out += [force, moment + np.cross(shift, force)]
    return np.concatenate(out)


def after(rod: NodalRod, motion: np.ndarray, moving: int) -> np.ndarray:
    """`wrenches` after a small motion (12 + 6 moving,) of the clamps and the obstacles from 0 on."""
    new = rod.snapshot()()
    assert isinstance(new, NodalRod)
    bodies = rod._under.copy()
    for o in range(moving):
        at = 12 + 6 * o
        bodies[o : o + 1] = rigid(bodies[o : o + 1], motion[at : at + 3], motion[at + 3 : at + 6])
    re = rod.re + matrix(rod.qe) @ motion[6:9]
    qe = quaternion.multiply(rod.qe, rotation(motion[9:12]))
    # seen from the start clamp that moved
    shift, turn = motion[0:3], motion[3:6]
    R = matrix(rotation(turn)).T
    there = Conditions(
        quaternion.multiply(rotation(-turn), qe), R @ (re - shift), R @ rod.f,
        rigid(bodies, -R @ shift, -turn),
    )  # fmt: skip
    assert advance(new, there) == warm_step.ADVANCED
    return wrenches(new, moving, turn, shift)


def differences(rod: NodalRod, moving: int) -> np.ndarray:
    size = 12 + 6 * moving
    columns = [
        (after(rod, STEP * unit, moving) - after(rod, -STEP * unit, moving)) / (2 * STEP)
        for unit in np.eye(size)
    ]
    return np.array(columns).T


def off(found: np.ndarray, exact: np.ndarray) -> float:
    return float(np.abs(found - exact).max() / np.abs(exact).max())


@pytest.mark.parametrize("shape", SHAPES)
def test_without_friction(shape: str) -> None:
    rod = pressed(shape)
    assert rod.touches
    assert off(rod.wrench_response(rod.shape, rod.end_force, [0]), differences(rod, 1)) < OFF
    stiffness = rod.clamp_stiffness(rod.shape, rod.end_force)
    assert off(stiffness, differences(rod, 0)) < OFF
    # what is conservative has a symmetric stiffness but for the moments' own turning; the diagonal blocks'
    # force parts are free of that
    for at in (slice(0, 3), slice(6, 9)):
        block = stiffness[at, at]
        assert block == pytest.approx(block.T, abs=1e-9 * np.abs(block).max())


@pytest.mark.parametrize(("shape", "soft"), [*((shape, 0.0) for shape in SHAPES), ("sphere", 2e-3)])
def test_what_sticks(shape: str, soft: float) -> None:
    rod = pressed(shape, 0.4, soft=soft)
    rough = rod._under.copy()
    rough[:, FRICTION_COEFFICIENT] = 2.0  # what slipped sticks with the friction that it had
    go(rod, Conditions(rod.qe, rod.re, rod.f, rough))
    assert rod.touches
    assert not rod.sliding().any()
    assert np.abs(rod.state.tau).max() > 1.0
    assert off(rod.wrench_response(rod.shape, rod.end_force, [0]), differences(rod, 1)) < OFF


@pytest.mark.parametrize("soft", [0.0, 2e-3])
def test_what_slips_goes_on_slipping_the_same_way(soft: float) -> None:
    # all in the plane of x and z, the ground drawn along z under the cable
    conditions = Conditions(
        rotation([0.0, -0.2, 0.0]), np.array([0.05, 0.0, 0.92]), np.array([-30.0, 0.0, 0.0]),
        ground(-0.4, 0.4)[None],
    )  # fmt: skip
    rod = start(conditions, 64, soft=soft)
    bodies = raised(conditions.obstacles, 0.2525)
    go(rod, Conditions(rod.qe, rod.re, rod.f, bodies))
    go(rod, Conditions(rod.qe, rod.re, rod.f, rigid(bodies, np.array([0.0, 0.0, 0.05]), np.zeros(3))))
    assert np.array_equal(rod.sliding(), rod.state.lam > 0.0)
    found = rod.wrench_response(rod.shape, rod.end_force, [0])
    size = np.abs(found).max()
    # how far the ground has been drawn does not matter; that it is drawn on keeps the friction
    assert np.abs(found[:, 14]).max() < 1e-9 * size
    on = np.zeros(18)
    on[14] = 1e-3
    for column in (0, 2, 4, 6, 8, 10, 12):
        unit = STEP * np.eye(18)[column]
        exact = (after(rod, on + unit, 1) - after(rod, on - unit, 1)) / (2 * STEP)
        assert np.abs(found[:, column] - exact).max() < 1e-5 * size, column


def test_a_tracker_gives_it_in_the_world() -> None:
    """`Equilibrium.wrench_response` of a rod on fixed contact points, in SI units, from a copy."""
    rod = pressed("sphere", 0.4)
    unit = Units(2.0, 0.5)
    begin = np.array([0.3, -0.2, 0.1, *quaternion.to_ros(rotation([0.3, 0.5, -0.4]))])
    response = Tangent(rod, rod.shape, rod.end_force, unit, ["ball"], begin, 1.0).wrench_response
    expected, held = rod.wrench_response(rod.shape, rod.end_force, [0]), rod.contact_force()
    go(rod, Conditions(rod.qe, rod.re, rod.f, raised(rod._under, 0.01)))  # the rod moves on
    clamps, both = response([]), response(["ball"])
    scale = np.repeat([unit.force, unit.moment] * 2, 3)[:, None] / np.repeat([unit.length, 1.0] * 2, 3)
    assert clamps == pytest.approx(-scale * expected[:12, :12], rel=1e-9)
    assert both[:12, :12] == pytest.approx(clamps, rel=1e-9)
    # moved along together, no force changes, nor a moment about a clamp
    R = matrix(quaternion.from_ros(begin[3:]))
    end = R @ matrix(rod.qe)
    together = np.concatenate((R.T, np.zeros((3, 3)), end.T, np.zeros((3, 3)), np.eye(3), np.zeros((3, 3))))
    exact = np.zeros((18, 3))
    exact[15:18] = cross_matrix(unit.force * R @ held)  # v x W, W = -held the force on the ball
    assert both @ together == pytest.approx(exact, abs=1e-9 * np.abs(both).max())
