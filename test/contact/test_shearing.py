# SPDX-License-Identifier: Apache-2.0
"""A cable that shears among obstacles: a beam, boundary values, a discrete rod, derivatives, limits,
invariances.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from arm_over_ball import BALL, CLAMP, START, check_response, error, moved, numbers, over_ball
from nodal_scenes import AHEAD, go, obstacle, raised
from references import sheared_contact
from references.coulomb_rod import lead
from references.hose_paths import GRAVITY, known
from scipy.spatial.transform import Rotation

from cable_ros import Equilibrium, Status, Tracker, load_scene
from cable_ros.branch.cold_start import Conditions, equilibria
from cable_ros.contact.distance import CYLINDER
from cable_ros.contact.nodal_rod import NodalRod
from cable_ros.rod.rod_state import ENERGY

SOFT = 4.0
"""GA, N: on the arm, whose end force is 0.2 N, sections tilt by 1 to 3 degrees."""


def arm(shear: float | None, **changes: Any) -> dict[str, Any]:
    """The arm's cable over the ball with GA = shear, N."""
    return over_ball({} if shear is None else {"shear_stiffness": [shear, shear]}, **changes)


def solve(mapping: dict[str, Any], tolerance: float = 1e-4) -> Equilibrium:
    found = Tracker(load_scene(mapping), tolerance).arrive({})["cable"]
    assert found.status is Status.CONVERGED, found.message
    assert found.contacts
    return found


@pytest.mark.parametrize("shear", [5.0, 50.0, 500.0])
def test_a_beam_on_a_point_support_gives_way_as_timoshenkos(shear: float) -> None:
    # clamped at both ends, pushed up in its middle by so little that tension does not matter
    up, round_, even, cells = 1e-3, 0.011, np.ones(3), 81  # one cell has its middle in the beam's
    compliance = np.array([1.0 / shear, 1.0 / shear, 1e-2])
    below = obstacle(CYLINDER, [-round_ - up, 0.0, 0.5], [0.5 * np.pi, 0.0, 0.0], [round_ - 0.01, 1.0])[None]
    conditions = Conditions(AHEAD, np.array([0.0, 0.0, 1.0]), np.zeros(3), below)
    (found, *_) = equilibria(even, None, replace(conditions, obstacles=None), 0.0, compliance=compliance)
    rod = NodalRod(even, None, below, cells, False, compliance)
    found.rod.obstacles, nothing = below, np.zeros(0)
    assert rod.adopt(found.rod, found.q, found.F, nothing, np.zeros((0, 3)), nothing.astype(int), False)
    go(rod, replace(conditions, obstacles=raised(below, 2.0 * up)))
    (touch,) = np.flatnonzero(rod.state.lam)
    force = float(rod.state.lam[touch, 0])
    assert force == pytest.approx(up / (1.0 / 192.0 + 1.0 / (4.0 * shear)), rel=1e-3)
    assert rod.totals[ENERGY] == pytest.approx(0.5 * force * up, rel=1e-3)
    assert abs(rod.g[-1, 1]) == pytest.approx(0.125 * force, rel=1e-3)


@pytest.mark.parametrize("soft", [1e-2, 1e-3, 1e-4])
def test_what_lies_against_boundary_values(soft: float) -> None:
    reference = sheared_contact.lifted(soft)
    scene = reference.scene(shear_stiffness=[1.0 / soft] * 2)
    found = solve(scene)
    assert error(found.end_wrench, reference.end_wrench) < found.error_estimate < 4e-3
    assert error(found.start_wrench, reference.start_wrench) < 2e-3
    assert found.contacts[-1].arc_length == pytest.approx(reference.facts["touchdown_end"], abs=1.0 / 80)
    del scene["cables"][0]["shear_stiffness"]
    assert error(solve(scene).end_wrench, reference.end_wrench) > 25 * soft  # without it is another one


def test_order_of_the_grid() -> None:
    soft = 3e-3  # pressure falls off over 0.05 lengths: more than a cell
    reference = sheared_contact.lifted(soft)
    tracker = Tracker(load_scene(reference.scene(shear_stiffness=[1.0 / soft] * 2)))
    tracker.arrive({})
    (tracked,) = tracker._tracked_cables
    rod = tracked.rod
    assert isinstance(rod, NodalRod)
    arc_lengths, _, _, forces, which, _, _ = rod.contacts()
    exact, off = -reference.end_wrench[3:] / 2.0, []  # in units of the geometric mean of 4 and 1
    for cells in (40, 80, 160, 320):
        fine = NodalRod(rod.K, rod.natural, rod._under, cells, False, rod.compliance)
        assert fine.adopt(rod, rod.shape, rod.end_force, arc_lengths, forces, which, pair=False)
        bend = fine.g[-1]
        off.append(float(np.linalg.norm(bend - exact)) / float(np.linalg.norm(exact)))
    assert np.polyfit(np.log([40, 80, 160, 320]), np.log(off), 1)[0] < -1.5


def test_the_limit_without_shear_is_met_in_proportion() -> None:
    limit = solve(arm(1e9)).end_wrench  # on the same grid
    gaps = [error(solve(arm(shear)).end_wrench, limit) for shear in (10.0, 100.0, 1000.0)]
    np.testing.assert_allclose(np.array(gaps[:-1]) / gaps[1:], 10.0, rtol=0.05)
    # and what the grid leaves is what it says
    exact, coarse = solve(arm(None), 1e-6), solve(arm(1e9))
    assert error(coarse.end_wrench, exact.end_wrench) < coarse.error_estimate < 1e-3
    assert coarse.contacts[0].arc_length == pytest.approx(exact.contacts[0].arc_length, abs=1e-5)


@pytest.mark.parametrize("body", ["start", "end", "ball"])
def test_stiffness_and_virtual_work(body: str) -> None:
    found, step = solve(arm(SOFT)), 1e-4
    response = found.wrench_response(["ball"])
    for k in (0, 2) if body == "ball" else (1, 2, 3, 5):
        motion = np.zeros(6)
        motion[k] = step * (1.0 if k < 3 else 10.0)
        more, less = (numbers(solve(arm(SOFT, **moved(body, part * motion)))) for part in (1.0, -1.0))
        numeric = (more - less) / (2.0 * motion[k])
        check_response(found, response, body, k, numeric, stiffness=2e-3, work=3e-3, push=3e-3)


def test_a_hose_that_shears_against_a_discrete_rod() -> None:
    path = known()["lengthwise_8"]
    hose, scene = path.hose, path.scene()
    shear = 10.0 * hose.linear_density * GRAVITY * hose.length
    scene["cables"][0]["shear_stiffness"] = [shear, shear]
    tracker = Tracker(load_scene(scene, urdf=path.urdf()))
    found = [tracker.arrive(state)["hose"] for state in path.states()]
    assert {one.status for one in found} == {Status.CONVERGED}
    exact = lead(replace(hose.path(), shear=(shear, shear)), 120, 6e-3).end_wrench
    off = [error(one.end_wrench[:3], force[:3]) for one, force in zip(found, exact, strict=True)]
    assert max(off) < 0.005
    assert np.median(off) < 0.003
    # without the shear it is another path
    assert max(map(error, exact[:, :3], path.end_wrench[:, :3])) > 0.05


LIFTED = (
    '<robot name="r"><link name="world"/><link name="body"/><joint name="j" type="prismatic">'
    '<parent link="world"/><child link="body"/><axis xyz="0 0 1"/>'
    '<limit lower="-9" upper="9" effort="1" velocity="1"/></joint></robot>'
)


def test_a_cable_meets_the_ball_and_leaves_it_again() -> None:
    scene = arm(SOFT)
    (ball,) = scene["obstacles"]
    ball["link"] = "body"
    tracker = Tracker(load_scene(scene, urdf=LIFTED))
    found = [tracker.arrive({"j": z})["cable"] for z in (-0.08, -0.004, 0.0, -0.004, -0.08)]
    assert {one.status for one in found} == {Status.CONVERGED}
    assert [bool(one.contacts) for one in found] == [False, True, True, True, False]
    assert error(found[3].end_wrench, found[1].end_wrench) < 1e-6  # without friction it forgets
    assert error(found[4].end_wrench, found[0].end_wrench) < 1e-4
    assert max(found[0].error_estimate, found[4].error_estimate) < 1e-4  # off its grid
    assert error(found[2].end_wrench, solve(arm(SOFT)).end_wrench) < 1e-5


# what does not matter


def alike(one: Equilibrium, other: Equilibrium, wrench: np.ndarray) -> bool:
    return error(wrench, one.end_wrench) < 1e-6 + (
        0.5 * one.error_estimate if one.contacts[0].sliding else 0.0
    )


@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_moved_together_mirrored_and_told_from_the_other_end(friction: float) -> None:
    here = solve(arm(SOFT, friction=friction))
    whole, shift = Rotation.from_rotvec([0.7, -0.4, 1.1]), np.array([0.3, -2.0, 1.0])
    place = [(whole.apply(p) + shift, whole * r) for p, r in (START, CLAMP)]
    there = solve(
        arm(SOFT, start=place[0], end=place[1], ball=whole.apply(BALL) + shift, friction=friction,
            gravity=whole.apply([0.0, 0.0, -9.80665]))
    )  # fmt: skip
    assert alike(here, there, there.end_wrench)
    half = Rotation.from_rotvec([np.pi, 0.0, 0.0])
    back = solve(
        arm(SOFT, start=(CLAMP[0], CLAMP[1] * half), end=(START[0], START[1] * half), friction=friction)
    )
    turned = np.concatenate([half.apply(back.start_wrench[:3]), half.apply(back.start_wrench[3:])])
    assert alike(here, back, turned)
    side = np.diag([1.0, -1.0, 1.0])

    def mirrored(p: np.ndarray, r: Rotation) -> tuple[np.ndarray, Rotation]:
        return side @ p, Rotation.from_matrix(side @ r.as_matrix() @ side)

    image = solve(
        arm(
            SOFT, start=mirrored(*START), end=mirrored(*CLAMP), ball=side @ BALL, friction=friction, twist=2.7
        )
    )
    assert alike(here, image, image.end_wrench * [1.0, -1.0, 1.0, -1.0, 1.0, -1.0])
