# SPDX-License-Identifier: Apache-2.0
"""Cables whose ends are pinned, on a swivel, sliding or free: against closed forms and by shooting."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pages import blocks
from references.held_ends import Problem
from scipy.integrate import solve_bvp
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation
from scipy.special import ellipe, ellipeinc, ellipk, ellipkinc

from cable_ros import Tracker
from cable_ros.branch.cable_tracker import CableTracker
from cable_ros.branch.cold_start import settle
from cable_ros.effects.registry import properties
from cable_ros.equilibrium import Equilibrium, Status
from cable_ros.rod.elements import Mesh, reference_element
from cable_ros.scene import Kinematics, SceneError, load_scene
from cable_ros.scene.text import parse_yaml

GRAVITY = 10.0
ALONG_X = {"position": [0.0, 0.0, 0.0], "rpy": [0.0, np.pi / 2, 0.0]}
UP = {"position": [0.0, 0.0, 0.0], "rpy": [0.0, 0.0, 0.0]}
FLIP = Rotation.from_rotvec([np.pi, 0.0, 0.0])
START = {"position": [0.1, 0.05, 0.02], "rpy": [0.3, 1.2, 0.2]}
END = {"position": [0.7, 0.3, 0.1], "rpy": [0.3, 1.0, 0.6]}
PULLED = {"kind": "sliding", "axial_force": 2.0, "axis": [0.2, 0.3, 1.0]}
PUSHED = {"kind": "sliding", "axial_force": -2.0, "axis": [0.2, 0.3, 1.0]}
LOADED = {"kind": "free", "force": [1.0, 2.0, -1.0]}
WOUND = {"kind": "free", "force": [1.0, 2.0, -1.0], "moment": [0.5, 0.4, -0.6]}
PAIRS = {
    "pinned": (START, END | {"kind": "pinned"}),
    "swivel": (START, END | {"kind": "swivel"}),
    "pinned start": (START | {"kind": "pinned"}, END),
    "swivel start": (START | {"kind": "swivel"}, END),
    "sliding": (START, END | PULLED),
    "sliding, free to turn": (START, END | {"kind": "sliding", "axial_force": 2.0, "rotation": "free"}),
    "sliding start": (START | PUSHED, END),
    "sliding start, swivel": (START | PUSHED, END | {"kind": "swivel"}),
    "free": (START, LOADED),
    "free, with a moment": (START, WOUND),
    "free start": (LOADED, END),
    "free start, with a moment": (WOUND, END),
}


def mapping(
    start: dict[str, Any], end: dict[str, Any], weight: float = 3.0, length: float = 1.0, **fields: Any
) -> dict[str, Any]:
    """A scene of a cable with EI = 1 N m^2 and this weight per length, N/m."""
    cable = {
        "name": "c", "length": length, "stiffness": [1.0, 1.0, 0.7], "linear_density": weight / GRAVITY,
        "start": start, "end": end,
    } | fields  # fmt: skip
    return {"gravity": [0.0, 0.0, -GRAVITY], "cables": [cable]}


def solved(scene: dict[str, Any], tolerance: float = 1e-8, points: int = 101) -> Equilibrium:
    found = Tracker(scene, tolerance=tolerance, polyline_points=points).arrive({})["c"]
    assert found.status is Status.CONVERGED, found.message
    return found


@pytest.mark.parametrize("load", [0.1, 1.0, 5.0, 20.0])
def test_a_force_bends_a_cantilever_to_bisshopp_and_druckers_elastica(load):
    """With p^2 = (1 + sin phi) / 2 and sin theta = 1 / (p 2^1/2), (P L^2 / EI)^1/2 = K(p) - F(p, theta)."""

    def phase(p: float) -> float:
        return float(np.arcsin(min(1.0, np.sqrt(0.5) / p)))

    p = brentq(
        lambda p: ellipk(p * p) - ellipkinc(phase(p), p * p) - np.sqrt(load),
        np.sqrt(0.5),
        1 - 1e-12,
        xtol=1e-15,
    )
    root = np.sqrt(load)
    drop = 1.0 - 2.0 / root * (ellipe(p * p) - ellipeinc(phase(p), p * p))
    reach = np.sqrt(2.0 * (2.0 * p * p - 1.0)) / root
    found = solved(mapping(ALONG_X, {"kind": "free", "force": [0.0, 0.0, -load]}, weight=0.0))
    np.testing.assert_allclose(found.points[-1], [reach, 0.0, -drop], atol=1e-8)
    assert found.end_wrench.tolist() == [0.0, 0.0, load, 0.0, 0.0, 0.0]
    # the clamp's axes: z along X, x along -Z
    np.testing.assert_allclose(found.start_wrench, [load, 0, 0, 0, load * reach, 0], atol=1e-7 * load)


@pytest.mark.parametrize("moment", [0.5, 1.5, 2.2])
def test_a_moment_bends_a_cantilever_to_a_circle(moment):
    found = solved(mapping(ALONG_X, {"kind": "free", "moment": [0.0, moment, 0.0]}, weight=0.0))
    s = moment * np.linspace(0.0, 1.0, len(found.points))
    circle = np.stack([np.sin(s), 0.0 * s, np.cos(s) - 1.0], axis=1) / moment
    np.testing.assert_allclose(found.points, circle, atol=1e-8)
    np.testing.assert_allclose(found.start_wrench, [0, 0, 0, 0, moment, 0], atol=1e-8)
    assert found.end_wrench.tolist() == [0.0, 0.0, 0.0, 0.0, -moment, 0.0]


def test_a_moment_too_large_for_its_stability_to_be_known_is_told():
    """The tangent is unsymmetric: where its symmetric part is no longer positive nothing is published."""
    scene = mapping(ALONG_X, {"kind": "free", "moment": [0.0, 4.0, 0.0]}, weight=0.0)
    found = Tracker(scene).arrive({})["c"]
    assert found.status is Status.NOT_CONVERGED
    assert "moment on its free end" in found.message
    assert np.isnan(found.start_wrench).all()


def heavy_cantilever(weight: float) -> tuple[np.ndarray, float]:
    """Tip (x, z) and clamp moment of a horizontal cantilever, by collocation."""

    def slope(s: np.ndarray, y: np.ndarray) -> np.ndarray:
        return np.stack([y[1], -weight * (1.0 - s) * np.cos(y[0]), np.cos(y[0]), np.sin(y[0])])

    s = np.linspace(0.0, 1.0, 41)
    guess = np.stack([-s, -np.ones_like(s), s, -0.5 * s])
    # theta falls from 0, and its slope is EI theta' = M with M(1) = 0, M' = w (1 - s) cos theta
    found = solve_bvp(
        lambda s, y: slope(s, y) * np.array([1.0, -1.0, 1.0, 1.0])[:, None],
        lambda a, b: np.array([a[0], b[1], a[2], a[3]]), s, guess, tol=1e-10, max_nodes=20000,
    )  # fmt: skip
    assert found.success
    return found.y[2:, -1], float(found.y[1, 0])


@pytest.mark.parametrize("weight", [0.5, 8.0, 100.0, 1000.0])
def test_a_heavy_cantilever_meets_its_boundary_value_problem(weight):
    tip, moment = heavy_cantilever(weight)
    found = solved(mapping(ALONG_X, {"kind": "free"}, weight=weight), 1e-6)
    np.testing.assert_allclose(found.points[-1, [0, 2]], tip, atol=1e-6)
    assert found.start_wrench[4] == pytest.approx(-moment, rel=2e-6)
    np.testing.assert_array_equal(found.end_wrench, 0.0)


@pytest.mark.parametrize("modulus", [0.3, 0.7, 0.9])
def test_a_pinned_strut_buckles_to_eulers_elastica(modulus):
    """With modulus k the chord is 2 E(k) / K(k) - 1 and the thrust 4 K(k)^2 EI / L^2."""
    m = modulus**2
    chord, thrust = 2.0 * ellipe(m) / ellipk(m) - 1.0, 4.0 * ellipk(m) ** 2
    ends = ({"kind": "pinned", "position": [x, 0.0, 0.0]} for x in (0.0, chord))
    found = solved(mapping(*ends, weight=0.0))
    np.testing.assert_allclose(found.end_wrench, [thrust, 0, 0, 0, 0, 0], atol=1e-6 * thrust)
    assert found.end_wrench[3:].tolist() == [0.0, 0.0, 0.0]
    assert found.stability_margin < 1e-5, "it turns freely about its chord"


@pytest.mark.parametrize("name", PAIRS)
def test_wrenches_meet_an_independent_shooting_solution(name):
    scene = mapping(*PAIRS[name], natural_strain=[0.3, -0.4, 0.6])
    found, reference = claimed(scene)
    assert reference.converged
    for mine, theirs in ((found.points[0], reference.start), (found.points[-1], reference.end)):
        np.testing.assert_allclose(mine, theirs, atol=1e-8)
    size = np.abs(np.concatenate([reference.start_moment, reference.end_moment])).max()
    wrenches_are_those(found, reference, scene, 1e-6 * (1 + size))


def wrenches_are_those(found: Equilibrium, reference: Any, scene: dict[str, Any], error: float) -> None:
    """Ours on the mounts are those of shooting on the cable, with the other sign and about other points."""
    for which, force, moment, at in (
        ("start", reference.start_force, reference.start_moment, reference.start),
        ("end", reference.end_force, reference.end_moment, reference.end),
    ):
        mount = scene["cables"][0][which]
        axes = Rotation.from_euler("xyz", mount.get("rpy", [0.0, 0.0, 0.0]))
        wrench = getattr(found, f"{which}_wrench")
        about = moment + np.cross(at - mount.get("position", at), force)
        np.testing.assert_allclose(wrench[:3], -axes.inv().apply(force), atol=error)
        np.testing.assert_allclose(wrench[3:], -axes.inv().apply(about), atol=error)


def claimed(scene: dict[str, Any]) -> tuple[Equilibrium, Any]:
    """Our answer, and the shooting solution from a guess 1 % beside it."""
    found = solved(scene)
    axes = Rotation.from_quat(found.wrench_axes[0])
    force, moment = axes.apply(found.start_wrench[:3]), axes.apply(found.start_wrench[3:])
    at, origin = found.points[0], scene["cables"][0]["start"].get("position", found.points[0])
    moment = moment - np.cross(at - origin, force)
    frame = Rotation.from_quat(found.orientations[0]).as_rotvec()
    guess = np.concatenate([at, frame, force, moment]) * (1.0 + 0.01 * np.cos(np.arange(12.0)))
    return found, Problem(scene["cables"][0], np.array(scene["gravity"])).solve(guess)


@pytest.mark.parametrize("name", PAIRS)
def test_released_components_are_exactly_what_is_given(name):
    scene = mapping(*PAIRS[name])
    found, cable = solved(scene, 1e-4), scene["cables"][0]
    for which in ("start", "end"):
        mount, wrench = cable[which], getattr(found, f"{which}_wrench")
        kind = mount.get("kind", "clamped")
        if kind == "pinned":
            assert wrench[3:].tolist() == [0.0, 0.0, 0.0]
        elif kind == "swivel":
            assert abs(wrench[5]) < 1e-14 * (1.0 + np.abs(wrench[3:]).max())
        elif kind == "free":
            given = [*mount["force"], *mount.get("moment", [0.0, 0.0, 0.0])]
            np.testing.assert_allclose(wrench, -np.array(given), rtol=1e-15, atol=1e-15)
        elif kind == "sliding":
            axis = np.array(mount.get("axis", [0.0, 0.0, 1.0]))
            along = wrench[:3] @ axis / np.linalg.norm(axis)
            assert along == pytest.approx(-mount["axial_force"], abs=1e-13)


def reversed_scene(scene: dict[str, Any]) -> dict[str, Any]:
    """The same cable, read from its other end: tangents turn round, sections by half a turn about x."""

    def turned(mount: dict[str, Any]) -> dict[str, Any]:
        out = dict(mount)
        if "rpy" in mount:
            out["rpy"] = (Rotation.from_euler("xyz", mount["rpy"]) * FLIP).as_euler("xyz").tolist()
        if "axis" in mount:
            out["axis"] = FLIP.apply(mount["axis"]).tolist()
        elif mount.get("kind") == "sliding":
            out["axial_force"] = -mount["axial_force"]
        return out

    out = copy.deepcopy(scene)
    (cable,) = out["cables"]
    cable["start"], cable["end"] = turned(cable["end"]), turned(cable["start"])
    if "natural_strain" in cable:
        cable["natural_strain"] = (-FLIP.apply(cable["natural_strain"])).tolist()
    return out


@pytest.mark.parametrize("name", PAIRS)
def test_a_cable_read_from_its_other_end_is_the_same(name):
    scene = mapping(*PAIRS[name], natural_strain=[0.3, -0.4, 0.6])
    one, other = solved(scene), solved(reversed_scene(scene))
    np.testing.assert_allclose(other.points[::-1], one.points, atol=1e-7)
    assert other.energy == pytest.approx(one.energy, rel=1e-8)
    assert other.stability_margin == pytest.approx(one.stability_margin, rel=1e-3)
    for mine, theirs, mount in (
        (one.start_wrench, other.end_wrench, scene["cables"][0]["start"]),
        (one.end_wrench, other.start_wrench, scene["cables"][0]["end"]),
    ):
        turn = FLIP if "rpy" in mount else Rotation.identity()
        expected = np.concatenate([turn.apply(mine[:3]), turn.apply(mine[3:])])
        np.testing.assert_allclose(theirs, expected, atol=1e-6 * (1.0 + np.abs(mine).max()))


def test_a_rigid_motion_of_everything_changes_no_wrench():
    motion, shift = Rotation.from_rotvec([0.4, -1.1, 0.8]), np.array([3.0, -2.0, 0.5])
    for name in ("pinned", "swivel start", "sliding", "free start, with a moment"):
        scene = mapping(*PAIRS[name])
        moved = copy.deepcopy(scene)
        moved["gravity"] = motion.apply(scene["gravity"]).tolist()
        for which in ("start", "end"):
            mount = moved["cables"][0][which]
            if "position" in mount:
                mount["position"] = (shift + motion.apply(mount["position"])).tolist()
                turn = motion * Rotation.from_euler("xyz", mount["rpy"])
                mount["rpy"] = turn.as_euler("xyz").tolist()
            for field in {"force", "moment"} & set(mount):
                mount[field] = motion.apply(mount[field]).tolist()
        one, other = solved(scene), solved(moved)
        np.testing.assert_allclose(other.points, shift + motion.apply(one.points), atol=1e-7)
        for which in ("start", "end"):
            if scene["cables"][0][which].get("kind") != "free":
                mine, theirs = (getattr(found, f"{which}_wrench") for found in (one, other))
                np.testing.assert_allclose(theirs, mine, atol=1e-6 * (1 + np.abs(mine).max()))


class Still:
    """Kinematics of mounts that a test moves."""

    joint_names = ()

    def __init__(self, poses: np.ndarray) -> None:
        self._poses = poses

    def poses(self, _: np.ndarray) -> np.ndarray:
        return self._poses[None]


def moved(poses: np.ndarray, motion: np.ndarray) -> np.ndarray:
    """(2, 7) mounts after translations and rotations (12,) along their own axes."""
    out = poses.copy()
    for i in range(2):
        frame, change = Rotation.from_quat(poses[i, 3:]), motion[6 * i : 6 * i + 6]
        out[i, :3] += frame.apply(change[:3])
        out[i, 3:] = (frame * Rotation.from_rotvec(change[3:])).as_quat()
    return out


@pytest.mark.parametrize("name", PAIRS)
def test_the_tangent_is_the_derivative_and_the_wrench_that_of_the_energy(name):
    scene = load_scene(mapping(*PAIRS[name]))
    poses = Kinematics(scene).poses(np.zeros(0))[0]
    tracked = CableTracker(scene.cables[0], properties(scene, scene.cables[0]), 1e-9, 3)

    def at(follower: CableTracker, where: np.ndarray) -> Equilibrium:
        found = follower.solve(Still(where), 0, np.zeros(0), where, 0.0)
        assert found.converged, found.message
        return found

    here, step = at(tracked, poses), 1e-4
    slope, work = np.empty((12, 12)), np.empty(12)
    for k in range(12):
        ahead, back = (
            at(copy.deepcopy(tracked), moved(poses, sign * step * np.eye(12)[k])) for sign in (1, -1)
        )
        change = [np.concatenate([one.start_wrench, one.end_wrench]) for one in (ahead, back)]
        slope[:, k] = (change[0] - change[1]) / (2 * step)
        work[k] = -(ahead.energy - back.energy) / (2 * step)
    # central differences: an error of the step's square, 1e-8, and of the solve, 1e-9 over the step
    np.testing.assert_allclose(here.clamp_stiffness, slope, atol=1e-6 * np.abs(slope).max())
    held = np.ones(12, bool)
    for i, mount in enumerate(scene.cables[0].mounts):
        held[6 * i : 6 * i + 6] = mount.kind != "free"  # whose load is turned with its axes
    if not name.endswith("moment"):  # whose work is no potential
        wrench = np.concatenate([here.start_wrench, here.end_wrench])
        np.testing.assert_allclose(work[held], wrench[held], atol=1e-6 * np.abs(wrench).max())


def its_error_is_bounded(scene: dict[str, Any]) -> None:
    """Hold the wrenches of its cable, and their estimated error, to those at a tolerance of 1e-10."""
    exact = solved(scene, 1e-10)
    for tolerance in (1e-3, 1e-5, 1e-7):
        found = solved(scene, tolerance)
        assert found.error_estimate <= tolerance
        for which in ("start_wrench", "end_wrench"):
            mine, theirs = getattr(found, which), getattr(exact, which)
            for part in (slice(0, 3), slice(3, 6)):
                size = max(np.linalg.norm(theirs[part]), 1.0)
                assert np.linalg.norm(mine[part] - theirs[part]) <= 3.0 * tolerance * size


@pytest.mark.parametrize("name", ["pinned", "swivel start", "sliding", "free, with a moment", "free start"])
def test_the_error_estimate_bounds_the_error(name):
    its_error_is_bounded(mapping(*PAIRS[name], weight=60.0))


@pytest.mark.parametrize("name", ["pinned", "swivel", "sliding", "free", "free start"])
@pytest.mark.parametrize("order", [2, 3])
def test_wrenches_converge_with_twice_the_order_of_the_elements(name, order):
    scene = load_scene(mapping(*PAIRS[name], weight=20.0))
    tracked = CableTracker(scene.cables[0], properties(scene, scene.cables[0]), 1e-10, 3)
    poses = Kinematics(scene).poses(np.zeros(0))[0]
    assert tracked.solve(Still(poses), 0, np.zeros(0), poses, 0.0).converged
    fine, q, F = tracked.rod, tracked.q, tracked.end_force

    def wrenches(elements: int) -> np.ndarray:
        mesh = Mesh(reference_element(order), np.full(elements, 1.0 / elements))
        rod = fine.variant(mesh)
        found = settle(rod, rod.on_end(fine.mesh.interpolate(q, mesh.nodes)), F)
        return np.concatenate(rod.supports(found.q, found.F).on_mounts(rod.qe, 1.0, 1.0))

    fine.refactor(q, F)
    exact = np.concatenate(fine.supports(q, F).on_mounts(fine.qe, 1.0, 1.0))
    errors = np.array([np.linalg.norm(wrenches(m) - exact) for m in (8, 16)])
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2 * order, abs=0.6)


MISTAKES = {
    "start.kind": (ALONG_X | {"kind": "hinged"}, END, {}, "is not clamped, pinned"),
    "end.position": (ALONG_X, {"kind": "free", "position": [0, 0, 0]}, {}, "nothing holds it"),
    "end.force": (ALONG_X, END | {"kind": "pinned", "force": [0, 0, 1]}, {}, "is for a free end"),
    "end.axis": (ALONG_X, END | {"kind": "sliding", "axis": [0, 0, 0]}, {}, "length 0"),
    "end.kind": ({"kind": "free"}, END | {"kind": "sliding"}, {}, "nothing holds the cable in place"),
    "start.moment": (WOUND, END | {"kind": "swivel"}, {}, "nothing but a clamp takes up a moment"),
    "total_twist": (ALONG_X, END | {"kind": "swivel"}, {"total_twist": 1.0}, "untwists itself"),
    "start.axial_force": (ALONG_X | {"axial_force": 1.0}, END, {}, "is for a sliding end"),
}


@pytest.mark.parametrize("field", MISTAKES)
def test_what_makes_no_sense_is_one_sentence_with_its_field(field):
    start, end, fields, words = MISTAKES[field]
    with pytest.raises(SceneError) as error:
        load_scene(mapping(start, end, **fields))
    assert f"cables[0].{field}:" in str(error.value)
    assert words in str(error.value)


def test_a_cable_that_cannot_reach_its_sliding_mount_says_so():
    far = {"position": [0.0, 2.0, 5.0], "rpy": [0.0, 0.0, 0.0], "kind": "sliding"}
    found = Tracker(mapping(UP, far)).solve({})["c"]
    assert found.status is Status.OUT_OF_REACH
    near = far | {"position": [0.0, 0.5, 5.0]}
    assert Tracker(mapping(UP, near)).solve({})["c"].converged, "only the distance across its axis counts"


def test_turning_ends_carry_no_torsion():
    """Of a round section: the torsion is constant along the cable, and zero where an end turns."""
    for name in ("pinned", "swivel", "swivel start"):
        found = solved(mapping(*PAIRS[name]))
        assert found.total_twist == pytest.approx(0.0, abs=1e-6)


def test_a_column_stands_up_to_its_critical_weight_and_then_leans():
    """The smallest critical weight of a clamped column is 7.837 EI / L^3 (Greenhill)."""
    margins = [solved(mapping(UP, {"kind": "free"}, weight=w)).stability_margin for w in (7.2, 7.5, 7.8)]
    # linear in the weight
    zero = 7.8 + margins[2] * 0.3 / (margins[1] - margins[2])
    assert zero == pytest.approx(7.837, abs=2e-3)
    leaning = solved(mapping(UP, {"kind": "free"}, weight=8.0), 1e-6)
    assert leaning.points[-1, 2] < 0.99
    assert leaning.stability_margin < 1e-5, "it may lean to any side"


def test_natural_frequencies_of_beams():
    """Roots of the characteristic equations of beams (Blevins 1979)."""
    upright, aside = ALONG_X, ALONG_X | {"position": [1.0, 0.0, 0.0]}
    slides = {"kind": "sliding", "rotation": "free"}
    for start, end, root in (
        (upright, {"kind": "free"}, 1.875104069),
        ({"kind": "free"}, aside, 1.875104069),
        (upright, aside | slides, 3.926602312),
        (upright | slides, aside, 3.926602312),
        (upright | {"kind": "sliding"}, aside, 4.730040745),
    ):
        scene = mapping(start, end)
        scene["gravity"] = [0.0, 0.0, 0.0]
        omega = 2.0 * np.pi * solved(scene, 1e-6).modes(2).frequencies
        np.testing.assert_allclose(omega, root**2 / np.sqrt(0.3), rtol=1e-5)


def test_joint_load_is_the_derivative_of_the_energy_and_its_derivative():
    for kind in ({"kind": "pinned"}, {"kind": "swivel"}, {"kind": "sliding", "axial_force": 0.02}):
        tracker = Tracker(on_the_arm(kind), tolerance=1e-9)
        load(tracker, 0.3)
        step = 1e-4
        (before, _, low), (torque, slope, _), (after, _, high) = (
            load(tracker, 0.3 + d) for d in (-step, 0, step)
        )
        assert torque == pytest.approx((low - high) / (2 * step), rel=1e-5)
        assert slope == pytest.approx((after - before) / (2 * step), rel=1e-5)


def test_the_load_of_a_free_end_is_not_the_joints():
    """What pulls at the end comes from elsewhere: the joint feels nothing of it."""
    arm = on_the_arm({"kind": "free", "force": [0.02, 0.0, 0.0]})
    assert arm["cables"][0]["end"]["link"] == "turret"
    tracker = Tracker(arm, tolerance=1e-8)
    torque, _, _ = load(tracker, 0.3)
    assert torque == 0.0
    here = tracker.solve({"orientation": 0.3})["camera_cable"]
    there = tracker.solve({"orientation": 0.8})["camera_cable"]
    assert here.end_wrench.tolist() == there.end_wrench.tolist() == [-0.02, 0.0, 0.0, 0.0, 0.0, 0.0]
    assert np.abs(here.points - there.points).max() > 1e-3, "its force turns with the link"


@pytest.mark.parametrize("name", ["pinned", "sliding", "free, with a moment", "free start"])
def test_a_cable_follows_its_temperature(name):
    """The unit of force is EI / L^2: given loads stay what they are in newtons as it changes."""
    table = {"value": 0.0, "table": [[-100.0, 4.0, 3.0], [0.0, 1.0, 1.0], [100.0, 0.8, 0.5]]}
    followed = Tracker(mapping(*PAIRS[name], temperature=table), tolerance=1e-8)
    followed.solve({})
    for value in (-80.0, 60.0):
        followed.set_environment({"temperature": value})
        found = followed.arrive({})["c"]
        assert found.status is Status.CONVERGED, found.message
        cold = solved(mapping(*PAIRS[name], temperature=table | {"value": value}))
        for wrench in ("start_wrench", "end_wrench"):
            mine, theirs = getattr(found, wrench), getattr(cold, wrench)
            np.testing.assert_allclose(mine, theirs, atol=1e-6 * (1.0 + np.abs(theirs).max()))


def test_effects_are_chosen_by_a_wrench_that_they_change():
    """The wrench of a free end is given whatever the cable is made of: the other one tells."""
    scene = mapping(ALONG_X, {"kind": "free"}, weight=1.0) | {"effects": "auto"}
    tracker = Tracker(scene)
    assert tracker.solve({})["c"].start_wrench[0] == pytest.approx(1.0)
    assert "weight" not in tracker.left_out["c"]
    light = Tracker(
        mapping(ALONG_X, {"kind": "free", "force": [0, 0, -5]}, weight=1e-6) | {"effects": "auto"}
    )
    light.solve({})
    assert light.left_out["c"] == ("weight",)


def test_the_example_of_the_page_is_as_it_says():
    page = Path(__file__).parents[1] / "docs" / "ends.md"
    example, *_ = [block.text for block in blocks(page) if block.language == "yaml"]
    scene = parse_yaml(example, str(page))
    found = Tracker(scene).arrive({})
    hose, lamp = found["hose"], found["lamp"]
    assert hose.status.trusted
    assert lamp.status.trusted
    assert hose.start_wrench[2] == pytest.approx(4.0)
    assert hose.points[0, 0] != pytest.approx(0.0, abs=1e-3), "it slides"
    np.testing.assert_allclose(hose.points[0, 1:], 0.0, atol=1e-6)
    assert lamp.end_wrench.tolist() == [0.0, 0.0, 3.0, 0.0, 0.0, 0.0]
    np.testing.assert_allclose(lamp.start_wrench, [0, 0, -3.0 - 0.5 * 0.1 * 9.81, 0, 0, 0], atol=1e-9)
    np.testing.assert_allclose(lamp.points[-1], [1.0, 0.0, -0.5], atol=1e-6)
    assert "turns freely" in lamp.message


def test_limits_of_a_pinned_cable():
    """Moment and curvature vanish at a pin; a strut is bent most in its middle."""
    m = 0.7**2
    chord, thrust = 2.0 * ellipe(m) / ellipk(m) - 1.0, 4.0 * ellipk(m) ** 2
    ends = ({"kind": "pinned", "position": [x, 0.0, 0.0]} for x in (0.0, chord))
    found = solved(mapping(*ends, weight=0.0, limits={"bend_radius": 0.1, "tension": 100.0}), 1e-6)
    worst = {one.quantity.name: one for one in found.extremes}
    # theta' = 2 k sqrt(P / EI) at the inflectional elastica's middle
    assert worst["bend_radius"].value == pytest.approx(1.0 / (2.0 * 0.7 * np.sqrt(thrust)), rel=1e-4)
    assert worst["bend_radius"].arc_length == pytest.approx(0.5, abs=1e-2)


def on_the_arm(end: dict[str, Any]) -> dict[str, Any]:
    """The arm of config/space_arm.yaml, whose cable's end is held otherwise."""
    from cable_ros.share import share_file

    file = share_file("config", "space_arm.yaml")
    with open(file, encoding="utf-8") as text:
        scene = parse_yaml(text.read(), str(file))
    (cable,) = scene["cables"]
    cable.pop("total_twist", None)
    mount = {"link": cable["end"]["link"]} if end.get("kind") == "free" else cable["end"]
    cable["end"] = mount | end
    scene["robot"]["urdf"] = str(share_file("config", "space_arm.urdf"))
    return scene


def load(tracker: Tracker, angle: float) -> tuple[float, float, float]:
    """Torque on the joint, its derivative, and the cable's energy."""
    from cable_ros.joint import joint_load

    joints = {"orientation": angle}
    found = tracker.solve(joints)
    assert found["camera_cable"].converged
    both = joint_load(tracker, found, joints)
    return float(both.torque[0]), float(both.stiffness[0, 0]), found["camera_cable"].energy
