# SPDX-License-Identifier: Apache-2.0
"""Cables that stretch and shear, with ends of any kind: by shooting, closed forms, limits and differences."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest
from scipy.optimize import fsolve
from scipy.spatial.transform import Rotation
from test_ends import (
    END,
    PAIRS,
    START,
    its_error_is_bounded,
    mapping,
    on_the_arm,
    solved,
    wrenches_are_those,
)
from test_ends import claimed as shot
from test_supports import support
from test_touching_ends import (
    DIAMETER,
    GROUND,
    NAMES,
    TILTED,
    among,
    carried,
    cart,
    claimed,
    pushed,
    read_both_ways,
    wrenches,
)

from cable_ros import Tracker
from cable_ros.branch.cold_start import settle
from cable_ros.equilibrium import Equilibrium, Status
from cable_ros.joint import joint_load
from cable_ros.rod.elements import Mesh, reference_element
from cable_ros.scene import SceneError, load_scene

SOFT = {"axial_stiffness": 200.0, "shear_stiffness": [60.0, 90.0]}
LONGER = {"axial_stiffness": 200.0}
NATURAL = [0.3, -0.4, 0.6]
DOWN = {"position": [0.0, 0.0, 0.0], "rpy": [0.0, np.pi, 0.0]}
EVERY = pytest.mark.parametrize("name", PAIRS)


def soft(name: str, **fields: Any) -> dict[str, Any]:
    """The cable of `test_ends.PAIRS` that stretches and shears."""
    return mapping(*copy.deepcopy(PAIRS[name]), **SOFT, **fields)


def hanging(end: dict[str, Any], **fields: Any) -> dict[str, Any]:
    return mapping(DOWN, end, **fields)


@EVERY
def test_wrenches_meet_an_independent_shooting_solution(name):
    scene = soft(name, natural_strain=NATURAL)
    found, reference = shot(scene)
    assert reference.converged
    for mine, theirs in ((found.points[0], reference.start), (found.points[-1], reference.end)):
        np.testing.assert_allclose(mine, theirs, atol=1e-8)
    size = np.abs(np.concatenate([reference.start_moment, reference.end_moment])).max()
    wrenches_are_those(found, reference, scene, 1e-6 * (1 + size))


@EVERY
def test_a_ball_that_pushes_is_that_of_shooting(name):
    scene = pushed(name, natural_strain=NATURAL, **LONGER)
    found, exact = claimed(scene)
    assert exact.converged
    ((mine,), (ball,)) = found.contacts, exact.balls
    size = np.abs(np.concatenate([exact.start_moment, exact.end_moment])).max()
    assert ball.push > 0.5
    assert np.linalg.norm(mine.force) == pytest.approx(ball.push, abs=1e-6 * (1 + size))
    assert mine.arc_length == pytest.approx(ball.arc, abs=1e-6)
    wrenches_are_those(found, exact, scene, 1e-6 * (1 + size))


@pytest.mark.parametrize("force", [[0.0, 0.0, 0.0], [0.5, 1.5, -2.0]])
def test_a_free_end_that_rests_is_that_of_shooting(force):
    end = {"kind": "free", "force": force}
    scene = among(TILTED, end, GROUND, natural_strain=NATURAL, **LONGER)
    found, exact = claimed(scene, rests=(np.array([0.0, 0.0, 1.0]), 0.5 * DIAMETER))
    assert exact.converged
    np.testing.assert_allclose(found.points[-1], exact.end, atol=1e-7)
    size = np.abs(exact.start_force).max()
    np.testing.assert_allclose(found.contacts[0].force, exact.end_force - force, atol=1e-6 * size)
    turn = Rotation.from_euler("xyz", TILTED["rpy"]).inv()
    np.testing.assert_allclose(found.start_wrench[:3], -turn.apply(exact.start_force), atol=1e-6 * size)
    np.testing.assert_allclose(found.start_wrench[3:], -turn.apply(exact.start_moment), atol=1e-6 * size)


@pytest.mark.parametrize(
    ("stiffness", "weight", "pull"), [(20.0, 0.5, 3.0), (20.0, 5.0, 0.0), (1e3, 5.0, 3.0), (1e6, 0.5, 0.0)]
)
def test_a_bar_that_hangs_is_longer_by_its_weight_and_load(stiffness, weight, pull):
    """By w L^2 / 2 EA and P L / EA, found cold, with and without obstacles far below."""
    end = {"kind": "free", "force": [0.0, 0.0, -pull]}
    far = {"name": "far", "sphere": {"center": [0.3, 0.0, -9.0], "radius": 0.1}}
    for more in ({}, {"obstacles": [far]}):
        scene = hanging(end, weight=weight, axial_stiffness=stiffness, outer_diameter=0.01)
        found = solved(scene | more, 1e-8)
        longer = (0.5 * weight + pull) / stiffness
        np.testing.assert_allclose(found.points[-1], [0.0, 0.0, -1.0 - longer], atol=1e-9)
        np.testing.assert_allclose(found.start_wrench, [0, 0, weight + pull, 0, 0, 0], atol=1e-7)


@pytest.mark.parametrize("stiffness", [30.0, 300.0])
@pytest.mark.parametrize("span", [0.7, 0.95, 1.02])
def test_pinned_at_both_ends_it_hangs_as_irvines_elastic_catenary(span, stiffness):
    """x = H L / EA + H / w (asinh(V / H) - asinh((V - w L) / H)) and the like of z, to first order in EI."""
    weight, drop = 10.0, 0.1
    start = {"kind": "pinned", "position": [0.0, 0.0, 0.0]}
    end = {"kind": "pinned", "position": [span, 0.0, -drop]}
    forces = []
    for bending in (1e-3, 1e-4):
        scene = mapping(start, end, weight=weight, axial_stiffness=stiffness)
        scene["cables"][0]["stiffness"] = [bending] * 3
        forces.append(solved(scene, 1e-7).start_wrench[:3])

    def missed(x: np.ndarray) -> list[float]:
        H, V = x
        a, b = V / H, (V - weight) / H
        along = H / stiffness + H / weight * (np.arcsinh(a) - np.arcsinh(b))
        down = (V - 0.5 * weight) / stiffness + H / weight * (np.hypot(1, a) - np.hypot(1, b))
        return [along - span, down - drop]

    H, V = fsolve(missed, [5.0, 6.0], xtol=1e-13)
    assert np.abs(missed([H, V])).max() < 1e-10
    np.testing.assert_allclose((10.0 * forces[1] - forces[0]) / 9.0, [H, 0.0, -V], atol=3e-6 * np.hypot(H, V))


@EVERY
def test_what_is_released_is_exactly_what_is_given(name):
    scene = soft(name)
    found, cable = solved(scene, 1e-4), scene["cables"][0]
    for which in ("start", "end"):
        mount, wrench = cable[which], getattr(found, f"{which}_wrench")
        kind = mount.get("kind", "clamped")
        if kind == "pinned":
            assert not wrench[3:].any()
        elif kind == "swivel":
            assert not wrench[5]
        elif kind == "free":
            given = [*mount["force"], *mount.get("moment", [0.0, 0.0, 0.0])]
            np.testing.assert_allclose(wrench, -np.array(given), rtol=1e-15)
        elif kind == "sliding":
            axis = np.array(mount.get("axis", [0.0, 0.0, 1.0]))
            along = wrench[:3] @ axis / np.linalg.norm(axis)
            assert along == pytest.approx(-mount["axial_force"], abs=1e-13)


@EVERY
def test_a_cable_read_from_its_other_end_is_the_same(name):
    one, other = read_both_ways(soft(name, natural_strain=NATURAL))
    assert other.energy == pytest.approx(one.energy, rel=1e-8)


MOTIONS = {
    "turned": Rotation.from_rotvec([0.4, -1.1, 0.8]).as_matrix(),
    "mirrored": np.diag([1.0, -1.0, 1.0]),
}


@pytest.mark.parametrize("motion", MOTIONS)
@EVERY
def test_a_rigid_motion_or_a_mirror_changes_no_wrench(name, motion):
    turn, shift = MOTIONS[motion], np.array([3.0, -2.0, 0.5])
    scene = soft(name) | {"obstacles": []}
    image = carried(scene, turn, shift)
    for one in (scene, image):
        del one["obstacles"]
    plain, other = solved(scene), solved(image)
    np.testing.assert_allclose(other.points, plain.points @ turn.T + shift, atol=1e-7)
    for which, mine, theirs in zip(("start", "end"), wrenches(plain), wrenches(other), strict=True):
        free = scene["cables"][0][which].get("kind") == "free"
        flip = np.kron(np.diag([1.0, -1.0]), turn) if motion == "mirrored" else np.eye(6)
        if motion == "mirrored" or not free:
            np.testing.assert_allclose(theirs, flip @ mine, atol=1e-6 * (1.0 + np.abs(mine).max()))


def test_a_stiff_cable_is_one_that_keeps_its_length_to_first_order():
    for name in ("pinned", "swivel start", "sliding", "sliding start", "free", "free start, with a moment"):
        exact, off = solved(mapping(*PAIRS[name]), 1e-9), []
        for stiff in (1e4, 1e5, 1e6):
            fields = {"axial_stiffness": stiff, "shear_stiffness": [stiff, 2.0 * stiff]}
            found = solved(mapping(*PAIRS[name], **fields), 1e-9)
            off.append(
                np.abs(
                    np.concatenate([*wrenches(found) - wrenches(exact), found.points[50] - exact.points[50]])
                ).max()
            )
        assert np.log10(off[0] / off[1]) == pytest.approx(1.0, abs=0.1)
        assert np.log10(off[1] / off[2]) == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize("moves", ["start", "end"])
@pytest.mark.parametrize("fields", [SOFT, {"shear_stiffness": [60.0, 90.0]}], ids=["both", "shears"])
@EVERY
def test_tangents_are_those_of_finite_differences(name, moves, fields):
    """Wrenches by motions of a mount, and minus the energy's derivative, too."""
    scene = mapping(*copy.deepcopy(PAIRS[name]), **fields)
    mount = scene["cables"][0][moves]
    if "position" not in mount:
        pytest.skip("nothing holds it")
    mount["link"] = "cart"
    tracker = Tracker(load_scene(scene, urdf=cart()), tolerance=1e-9)
    here = tracker.arrive(dict.fromkeys(NAMES, 0.0))["c"]
    assert here.status is Status.CONVERGED, here.message
    own, r = Rotation.from_euler("xyz", mount["rpy"]).as_matrix(), np.array(mount["position"])
    shift = np.array([[0, -r[2], r[1]], [r[2], 0, -r[0]], [-r[1], r[0], 0]])
    motion = np.block([[own.T, -own.T @ shift], [np.zeros((3, 3)), own.T]])
    columns = here.clamp_stiffness[:, :6] if moves == "start" else here.clamp_stiffness[:, 6:]
    columns, load = columns @ motion, motion.T @ getattr(here, f"{moves}_wrench")
    for k, joint in enumerate(NAMES):
        seen = [tracker.arrive(dict.fromkeys(NAMES, 0.0) | {joint: x})["c"] for x in (1e-4, -1e-4)]
        slope = (wrenches(seen[0]) - wrenches(seen[1])).ravel() / 2e-4
        np.testing.assert_allclose(columns[:, k], slope, atol=1e-5 * np.abs(columns).max())
        if "moment" not in name:  # whose work is no potential
            work = -(seen[0].energy - seen[1].energy) / 2e-4
            assert load[k] == pytest.approx(work, abs=1e-5 * (1.0 + np.abs(load).max()))


@pytest.mark.parametrize("name", ["pinned", "swivel", "sliding", "free, with a moment", "free start"])
def test_the_response_to_an_obstacle_is_that_of_finite_differences(name):
    scene = pushed(name, **LONGER)
    scene["obstacles"][0]["link"] = "cart"
    tracker = Tracker(load_scene(scene, urdf=cart()), tolerance=1e-8)
    here = tracker.arrive(dict.fromkeys(NAMES, 0.0))["c"]
    columns = here.wrench_response(["ball"])[:12, 12:]
    for k, joint in enumerate(NAMES):
        seen = [tracker.arrive(dict.fromkeys(NAMES, 0.0) | {joint: x})["c"] for x in (2e-4, -2e-4)]
        slope = (wrenches(seen[0]) - wrenches(seen[1])).ravel() / 4e-4
        np.testing.assert_allclose(columns[:, k], slope, atol=2e-5 * max(1.0, np.abs(columns).max()))


@pytest.mark.parametrize(
    "end", [{"kind": "pinned"}, {"kind": "swivel"}, {"kind": "sliding", "axial_force": 0.02}]
)
def test_joint_load_is_the_derivative_of_the_energy_and_its_derivative(end):
    arm = on_the_arm(end)
    arm["cables"][0] |= {"axial_stiffness": 30.0, "shear_stiffness": [9.0, 12.0]}
    tracker, step = Tracker(arm, tolerance=1e-9), 1e-4

    def at(angle: float) -> tuple[float, float, float]:
        joints = {"orientation": angle}
        found = tracker.arrive(joints)
        load = joint_load(tracker, found, joints)
        return float(load.torque[0]), float(load.stiffness[0, 0]), found["camera_cable"].energy

    at(0.3)
    (before, _, low), (torque, slope, _), (after, _, high) = (at(0.3 + d) for d in (-step, 0.0, step))
    assert torque == pytest.approx((low - high) / (2 * step), rel=1e-5)
    assert slope == pytest.approx((after - before) / (2 * step), rel=1e-5)


@EVERY
def test_the_error_estimate_bounds_the_error(name):
    its_error_is_bounded(soft(name, weight=60.0))


@pytest.mark.parametrize("name", ["pinned", "swivel", "sliding", "free", "free start"])
@pytest.mark.parametrize("order", [2, 3])
def test_wrenches_converge_with_twice_the_order_of_the_elements(name, order):
    tracker = Tracker(soft(name, weight=20.0), tolerance=1e-10)
    assert tracker.arrive({})["c"].status is Status.CONVERGED
    (coupled,), none = tracker._coupled, np.zeros(0)
    mounts, state, (piece,) = tracker.kinematics.poses(none)[coupled.which], coupled.state, coupled.pieces
    fine, q, F, exact, errors = piece.rod, piece.q, piece.end_force, piece.ends().wrenches, []
    for elements in (8, 16):
        mesh = Mesh(reference_element(order), np.full(elements, 1.0 / elements))
        settled = settle(fine.variant(mesh), fine.mesh.interpolate(q, mesh.nodes), F)
        piece._rod, piece._q, piece._F = settled.rod, settled.q, settled.F
        coupled._inverse = None
        coupled._keep()
        balanced = coupled._newton(tracker.kinematics, none, mounts, state)
        assert balanced is not None
        errors.append(np.linalg.norm(piece.ends().wrenches - exact))
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2 * order, abs=0.6)


@pytest.mark.parametrize("name", ["pinned", "sliding", "free, with a moment", "free start"])
def test_a_cable_follows_its_temperature(name):
    table = {"value": 0.0, "table": [[-100.0, 4.0, 3.0], [0.0, 1.0, 1.0], [100.0, 0.8, 0.5]]}
    followed = Tracker(soft(name, temperature=table), tolerance=1e-8)
    followed.arrive({})
    for value in np.linspace(2.0, -20.0, 12):  # a large change at once may be told as a snap-through
        followed.set_environment({"temperature": value})
        found = followed.arrive({})["c"]
        assert found.status is Status.CONVERGED, found.message
    cold = solved(soft(name, temperature=table | {"value": -20.0}))
    np.testing.assert_allclose(
        wrenches(found), wrenches(cold), atol=1e-6 * (1.0 + np.abs(wrenches(cold)).max())
    )


def test_frequencies_of_a_bar_that_vibrates_along_itself():
    """(EA / rho)^1/2 / L times pi / 2 clamped and free, and pi between clamps, through a ring, too."""
    free = solved(hanging({"kind": "free"}, weight=1e-6, axial_stiffness=1.0), 1e-6)
    speed = np.sqrt(1.0 / (1e-6 / 10.0))
    assert 2.0 * np.pi * free.modes(1).frequencies[0] == pytest.approx(0.5 * np.pi * speed, rel=1e-6)
    held = {"position": [0.0, 0.0, -1.0], "rpy": [0.0, np.pi, 0.0]}
    ring = [support("ring", "r", 0.37, [0.0, 0.0, -0.37])]
    for supports in ({}, {"supports": ring}):
        one = hanging(held, weight=1e-6, axial_stiffness=1.0, **supports)
        found = solved(one, 1e-6)
        assert 2.0 * np.pi * found.modes(1).frequencies[0] == pytest.approx(np.pi * speed, rel=1e-5)


def test_effects_without_stretch_and_shear_are_those_of_a_cable_that_has_neither():
    names = {"effects": ["weight", "natural_strain"]}
    for name in ("pinned", "free"):
        one, other = solved(soft(name) | names), solved(mapping(*PAIRS[name]) | names)
        np.testing.assert_array_equal(wrenches(one), wrenches(other))


def led(scene: dict[str, Any], path: np.ndarray, tolerance: float = 1e-8) -> list[Equilibrium]:
    """Equilibria with the start on a link that moves through the positions of the path (n, 3)."""
    scene["cables"][0]["start"]["link"] = "cart"
    tracker, out = Tracker(load_scene(scene, urdf=cart()), tolerance=tolerance), []
    for x, y, z in path.tolist():
        out.append(tracker.arrive(dict.fromkeys(NAMES, 0.0) | {"x": x, "y": y, "z": z})["c"])
        assert out[-1].status is Status.CONVERGED, (x, y, z, out[-1].message)
    return out


PATHS = {
    "pinned, drawn beyond its length": (
        mapping(copy.deepcopy(START), END | {"kind": "pinned"}, **LONGER), [-0.35, -0.2, 0.0],
    ),
    "swivel, drawn beyond its length": (
        mapping(copy.deepcopy(START), END | {"kind": "swivel"}, **SOFT), [-0.35, -0.2, 0.0],
    ),
    "free, hangs straight": (hanging({"kind": "free"}, weight=30.0, **LONGER), [0.1, -0.2, 0.3]),
    "free, hardly stretches": (
        mapping(copy.deepcopy(START), {"kind": "free"}, weight=30.0, axial_stiffness=1e6), [0.1, -0.2, 0.3],
    ),
    "sliding, pulled straight": (
        mapping(
            copy.deepcopy(START), END | {"kind": "sliding", "axial_force": 30.0, "rotation": "free"},
            weight=0.5, axial_stiffness=1e5,
        ),
        [0.1, -0.2, 0.1],
    ),
    "sliding, shears": (
        mapping(
            copy.deepcopy(START), END | {"kind": "sliding", "axial_force": 5.0},
            shear_stiffness=[60.0, 90.0],
        ),
        [0.1, -0.2, 0.1],
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", PATHS)
def test_there_and_back_it_is_as_before_in_any_number_of_steps(name):
    scene, to = PATHS[name]
    ends = []
    for steps in (2, 8, 32):
        parts = np.linspace(0.0, 1.0, steps + 1)
        found = led(copy.deepcopy(scene), np.outer([*parts, *parts[-2::-1]], to))
        ends.append(wrenches(found[steps]))
        size = np.abs(ends[0]).max()
        np.testing.assert_allclose(wrenches(found[-1]), wrenches(found[0]), atol=1e-6 * size)
    for one in ends[1:]:
        np.testing.assert_allclose(one, ends[0], atol=1e-6 * size)


def test_an_obstacle_that_moves_under_a_stretching_cable_is_felt_where_it_is():
    """Between clamps, in warm steps as found cold: normals once were those from before the step."""
    scene = among(copy.deepcopy(START), copy.deepcopy(END), **LONGER)
    scene["obstacles"] = copy.deepcopy(pushed("swivel", **LONGER)["obstacles"])
    scene["obstacles"][0]["link"] = "cart"
    warm = Tracker(load_scene(scene, urdf=cart()), tolerance=1e-8)
    for x in (0.0, 1e-4, 2e-3):
        joints = dict.fromkeys(NAMES, 0.0) | {"x": x}
        found = warm.arrive(joints)["c"]
        cold = Tracker(load_scene(scene, urdf=cart()), tolerance=1e-8).arrive(joints)["c"]
        np.testing.assert_allclose(wrenches(found), wrenches(cold), atol=1e-7 * np.abs(wrenches(cold)).max())
        np.testing.assert_allclose(found.contacts[0].force, cold.contacts[0].force, atol=1e-6)


def test_lowered_to_the_ground_in_one_step_it_comes_to_stand_there():
    """A step that had been found unstable once left the end told to touch the ground above which it hung."""
    start = {"position": [0.0, 0.0, 1.2], "rpy": [np.pi - 1e-3, 0.0, 0.0]}
    scene = among(start, {"kind": "free"}, GROUND, weight=5.0, axial_stiffness=500.0)
    *_, last = led(scene, np.array([[0.0, 0.0, 0.0], [0.0, 0.0, -0.15], [0.0, 0.0, -0.2]]), 1e-6)
    assert [round(one.arc_length, 9) for one in last.contacts] == [1.0]


MISTAKES = {
    "stretch among rough obstacles": ({"axial_stiffness": 200.0}, 0.3),
    "shear among obstacles": ({"shear_stiffness": [60.0, 90.0]}, 0.0),
}


@pytest.mark.parametrize("words", MISTAKES)
@pytest.mark.parametrize("released", ["a pinned end", "the ring 'r'"])
def test_what_is_not_done_is_refused_in_one_sentence(words, released):
    fields, friction = MISTAKES[words]
    pinned = released == "a pinned end"
    supports = {} if pinned else {"supports": [support("ring", "r", 0.5, [0.4, 0.2, 0.0])]}
    end = END | ({"kind": "pinned"} if pinned else {})
    with pytest.raises(SceneError, match=f"{words} is solved between clamps only, and there is {released}"):
        load_scene(among(START, end, GROUND | {"friction": friction}, **fields, **supports))
