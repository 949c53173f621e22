# SPDX-License-Identifier: Apache-2.0
"""Pins, rings and tubes between the ends: against shooting, closed forms and themselves seen otherwise."""

from __future__ import annotations

import copy
import csv
import functools
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from pages import blocks
from references import supported
from scipy.spatial.transform import Rotation
from test_clips import clipped_arm, load_at
from test_ends import END, GRAVITY, START, mapping

from cable_ros import Tracker
from cable_ros.branch.cold_start import settle
from cable_ros.branch.coupling import PER, assemble, residual_of
from cable_ros.branch.enumeration import branches
from cable_ros.cli.main import main
from cable_ros.equilibrium import Equilibrium, Status
from cable_ros.joint import joint_load
from cable_ros.log.reader import LogReader
from cable_ros.rod.elements import Mesh, reference_element
from cable_ros.scene import SceneError, load_scene
from cable_ros.scene.text import parse_yaml
from cable_ros.share import share_file

POINTS = 101
LEVEL = [0.0, np.pi / 2, 0.0]


def support(kind: str, name: str, arc_length: float, position: Any, **fields: Any) -> dict[str, Any]:
    place = {"arc_length": arc_length, "position": np.asarray(position).tolist()}
    return {"name": name, kind: place | fields}


def tracked(scene: dict[str, Any], tolerance: float = 1e-8, **joints: float) -> tuple[Tracker, Equilibrium]:
    tracker = Tracker(scene, tolerance=tolerance, polyline_points=POINTS)
    (found,) = tracker.arrive(joints).values()
    assert found.status is Status.CONVERGED, found.message
    return tracker, found


def tensions(tracker: Tracker, which: int = 0) -> np.ndarray:
    """(2,) tension before and after a support, N."""
    ends = [piece.ends() for piece in tracker._coupled[0].pieces]
    return np.array([-ends[which].wrenches[8], ends[which + 1].wrenches[2]])


PLAIN = mapping(START, END, weight=30.0)
FREE = Tracker(PLAIN, tolerance=1e-9, polyline_points=POINTS).arrive({})["c"]
AWAY = [(30, [0.01, -0.015, 0.02]), (65, [-0.01, 0.02, 0.01])]
TILT = [0.1, -0.05, 0.0]
SOFT = {"axial_stiffness": 300.0, "shear_stiffness": [150.0, 200.0]}
SOFT_HOSE = {"axial_stiffness": 150.0, "shear_stiffness": [60.0, 80.0]}
STRETCHES = pytest.mark.parametrize("soft", [{}, SOFT], ids=["keeps its length", "stretches and shears"])
KINDS = [
    ("pin",), ("ring",), ("pin", "ring"), ("ring", "pin"), ("ring", "ring"), ("pin", "pin"),
    ("tube",), ("tube", "tube"), ("ring", "tube"),
]  # fmt: skip


def away(kinds: tuple[str, ...], **fields: Any) -> dict[str, Any]:
    """The plain cable with supports that push it aside; `fields` of the cable."""
    names = [f"{kind}_{i}" for i, kind in enumerate(kinds)]
    return mapping(START, END, weight=30.0, **fields) | {} if not kinds else _with(names, kinds, fields)


@functools.cache
def free(soft: tuple[str, ...]) -> Equilibrium:
    """The plain cable, with these fields of `SOFT`."""
    scene = mapping(START, END, weight=30.0, **{name: SOFT[name] for name in soft})
    return Tracker(scene, tolerance=1e-9, polyline_points=POINTS).arrive({})["c"]


def axis(kind: str, k: int, tilt: Any, plain: Equilibrium = FREE) -> dict[str, Any]:
    """The orientation of a tube at a point of the plain cable, turned by `tilt`; of others none."""
    if kind != "tube":
        return {}
    own = Rotation.from_quat(plain.orientations[k]) * Rotation.from_rotvec(tilt)
    return {"orientation": own.as_quat().tolist()}


def axes_of(support: dict[str, Any]) -> Rotation:
    """Of the wrench of a support."""
    (fields,) = (value for key, value in support.items() if key != "name")
    return Rotation.from_quat(fields.get("orientation", [0.0, 0.0, 0.0, 1.0]))


def _with(names: list[str], kinds: tuple[str, ...], fields: dict[str, Any]) -> dict[str, Any]:
    supports = [
        support(kind, name, k / 100, FREE.points[k] + shift, **axis(kind, k, TILT))
        for name, kind, (k, shift) in zip(names, kinds, AWAY, strict=False)
    ]
    return mapping(START, END, weight=30.0, supports=supports, **fields)


@pytest.mark.parametrize("kinds", KINDS)
@pytest.mark.parametrize("natural", [None, [0.4, -0.9, 0.5]])
@STRETCHES
def test_wrenches_are_those_of_shooting_over_the_whole_cable(kinds, natural, soft):
    fields = soft if natural is None else {"natural_strain": natural} | soft
    scene = away(kinds, **fields)
    tracker, found = tracked(scene, 1e-9)
    (cable,) = scene["cables"]
    names = [one["name"] for one in cable["supports"]]
    held = [
        supported.Held(
            np.array(one[kind]["position"]), kind == "ring", tube=axes_of(one) if kind == "tube" else None
        )
        for one, kind in zip(cable["supports"], kinds, strict=True)
    ]
    turns = [Rotation.from_euler("xyz", cable[end]["rpy"]) for end in ("start", "end")]
    mine = [
        -np.concatenate([turn.apply(w[:3]), turn.apply(w[3:])])
        for turn, w in zip(turns, (found.start_wrench, found.end_wrench), strict=True)
    ]
    forces = np.array(
        [-axes_of(one).apply(found.support_wrenches[one["name"]][:3]) for one in cable["supports"]]
    )
    moments = np.array([-found.support_wrenches[name][3:] for name in names])
    arcs = tracker._coupled[0].arcs
    guess = supported.Solution(mine[0] * (1 + 1e-3), mine[1], forces * (1 + 1e-3), arcs.copy(), moments)
    exact = supported.solve(cable, np.array([0.0, 0.0, -GRAVITY]), held, guess)
    for one, other in ((mine[0], exact.start), (mine[1], exact.end)):
        for part in (slice(0, 3), slice(3, 6)):
            np.testing.assert_allclose(one[part], other[part], atol=1e-6 * np.linalg.norm(other[part]))
    np.testing.assert_allclose(forces, exact.forces, atol=1e-6 * np.abs(exact.forces).max())
    np.testing.assert_allclose(moments, exact.moments, atol=1e-6 * max(1e-3, np.abs(exact.moments).max()))
    np.testing.assert_allclose(arcs, exact.arcs, atol=1e-8)
    for kind, wrench in zip(kinds, found.support_wrenches.values(), strict=True):
        assert not wrench[5 if kind == "tube" else slice(3, 6)].any()


@pytest.mark.parametrize("kinds", KINDS)
@STRETCHES
def test_a_support_where_the_cable_is_anyway_changes_nothing(kinds, soft):
    plain = free(tuple(soft))
    supports = [
        support(kind, f"s{i}", k / 100, plain.points[k], **axis(kind, k, [0.0, 0.0, 0.4], plain))
        for i, (kind, (k, _)) in enumerate(zip(kinds, AWAY, strict=False))
    ]
    _, found = tracked(mapping(START, END, weight=30.0, supports=supports, **soft), 1e-9)
    reach = 2e-8 * max(np.abs(piece.clamp_stiffness).max() for piece in found.pieces)
    np.testing.assert_allclose(found.end_wrench, plain.end_wrench, atol=reach)
    np.testing.assert_allclose(found.start_wrench, plain.start_wrench, atol=reach)
    for wrench in found.support_wrenches.values():
        np.testing.assert_allclose(wrench, 0.0, atol=reach)
    np.testing.assert_allclose(found.points, plain.points, atol=2e-8)
    assert found.energy == pytest.approx(plain.energy, abs=1e-8)


@pytest.mark.parametrize("kinds", KINDS)
@STRETCHES
def test_tangents_are_those_of_finite_differences(kinds, soft):
    tracker, _ = tracked(away(kinds, **soft), 1e-10)
    (coupled,), none = tracker._coupled, np.zeros(0)
    mounts, state = tracker.kinematics.poses(none)[coupled.which], tracker._coupled[0].state
    smooth = np.zeros(len(kinds))
    exact = assemble(coupled.tangent(mounts, state).sides(), smooth).tangent
    # rotations commute only where moments are in balance
    free = exact[np.ix_(coupled.free, coupled.free)]
    np.testing.assert_allclose(free, free.T, atol=1e-6 * np.abs(exact).max())
    for k in range(PER * len(kinds)):
        step = (1e-6 if k % PER == 3 else 1e-5) * np.eye(PER * len(kinds))[k]
        seen = []
        for sign in (1.0, -1.0):
            assert coupled._move(tracker.kinematics, none, mounts, state.moved(sign * step))
            seen.append(residual_of([piece.ends() for piece in coupled.pieces], smooth))
        column = (seen[0] - seen[1]) / (2.0 * step.max())
        np.testing.assert_allclose(exact[:, k], column, atol=2e-5 * np.abs(exact[:, k]).max())


def test_the_two_sides_of_a_frictionless_ring_have_one_tension_and_one_moment():
    tracker, _ = tracked(away(("ring", "ring")), 1e-9)
    for which in (0, 1):
        before, after = tensions(tracker, which)
        assert before == pytest.approx(after, rel=1e-7)
        ends = [piece.ends() for piece in tracker._coupled[0].pieces]
        np.testing.assert_allclose(ends[which].curvatures[1], ends[which + 1].curvatures[0], atol=1e-6)


@pytest.mark.parametrize("kinds", [("ring",), ("ring", "ring"), ("tube",), ("ring", "tube")])
def test_the_configurational_force_is_one_from_end_to_end(kinds):
    """F.t + m.K^-1 m / 2 and the weight's potential are one along it, rings and tubes included."""
    scene = away(kinds)
    _, found = tracked(scene, 1e-9)
    K = np.array(scene["cables"][0]["stiffness"])
    (z0, z1), w = found.points[[0, -1], 2], 30.0
    at_start = found.start_wrench[2] + 0.5 * (found.start_wrench[3:] ** 2 / K).sum() - w * z0
    at_end = -found.end_wrench[2] + 0.5 * (found.end_wrench[3:] ** 2 / K).sum() - w * z1
    assert at_start == pytest.approx(at_end, rel=1e-7)


@pytest.mark.parametrize("kinds", KINDS)
@STRETCHES
def test_mirror_images_have_mirrored_wrenches(kinds, soft):
    scene = away(kinds, **soft)
    _, before = tracked(scene, 1e-9)
    flip = np.diag([1.0, -1.0, 1.0])
    image = copy.deepcopy(scene)
    (cable,) = image["cables"]
    for end in ("start", "end"):
        own = Rotation.from_euler("xyz", cable[end].pop("rpy")).as_matrix()
        cable[end]["orientation"] = Rotation.from_matrix(flip @ own @ flip).as_quat().tolist()
        cable[end]["position"] = (flip @ cable[end]["position"]).tolist()
    for one, kind in zip(cable["supports"], kinds, strict=True):
        own = axes_of(one).as_matrix()
        one[kind]["position"] = (flip @ one[kind]["position"]).tolist()
        one[kind]["orientation"] = Rotation.from_matrix(flip @ own @ flip).as_quat().tolist()
    _, after = tracked(image, 1e-9)
    for name, wrench in before.support_wrenches.items():
        mirrored = flip @ after.support_wrenches[name][:3]
        np.testing.assert_allclose(mirrored, wrench[:3], atol=1e-6 * np.abs(wrench).max())
    np.testing.assert_allclose(after.points @ flip, before.points, atol=1e-7)
    assert after.total_twist == pytest.approx(-before.total_twist, abs=1e-6)


@pytest.mark.parametrize("kinds", KINDS)
@STRETCHES
def test_a_rigid_motion_of_everything_changes_no_wrench(kinds, soft):
    """Gravity turns with the scene; energies are measured from another height."""
    scene = away(kinds, **soft)
    _, before = tracked(scene, 1e-9)
    turn, shift = Rotation.from_euler("xyz", [0.7, -0.4, 1.1]), np.array([0.3, -2.0, 0.6])
    moved = copy.deepcopy(scene)
    moved["gravity"] = turn.apply(scene["gravity"]).tolist()
    (cable,) = moved["cables"]
    for end in ("start", "end"):
        own = Rotation.from_euler("xyz", cable[end].pop("rpy"))
        cable[end]["orientation"] = (turn * own).as_quat().tolist()
        cable[end]["position"] = (turn.apply(cable[end]["position"]) + shift).tolist()
    for one, kind in zip(cable["supports"], kinds, strict=True):
        one[kind]["position"] = (turn.apply(one[kind]["position"]) + shift).tolist()
        one[kind]["orientation"] = (turn * axes_of(one)).as_quat().tolist()
    _, after = tracked(moved, 1e-9)
    size = np.abs(before.end_wrench).max()
    np.testing.assert_allclose(after.end_wrench, before.end_wrench, atol=1e-7 * size)
    for name, wrench in before.support_wrenches.items():
        np.testing.assert_allclose(after.support_wrenches[name], wrench, atol=1e-6 * np.abs(wrench).max())
    np.testing.assert_allclose(after.points, turn.apply(before.points) + shift, atol=1e-7)


@pytest.mark.parametrize("kinds", KINDS)
@STRETCHES
def test_a_cable_told_from_its_other_end_is_the_same(kinds, soft):
    scene = away(kinds, **soft)
    _, before = tracked(scene, 1e-9)
    back = copy.deepcopy(scene)
    (cable,) = back["cables"]
    flip = Rotation.from_rotvec([np.pi, 0.0, 0.0])
    ends = cable["end"], cable["start"]
    cable["start"], cable["end"] = (
        {
            "position": end["position"],
            "orientation": (Rotation.from_euler("xyz", end["rpy"]) * flip).as_quat().tolist(),
        }
        for end in ends
    )
    for one, kind in zip(cable["supports"], kinds, strict=True):
        one[kind]["arc_length"] = 1.0 - one[kind]["arc_length"]
        one[kind]["orientation"] = (axes_of(one) * flip).as_quat().tolist()
    _, after = tracked(back, 1e-9)
    for name, wrench in before.support_wrenches.items():
        other = flip.apply(after.support_wrenches[name].reshape(2, 3)).ravel()
        np.testing.assert_allclose(other, wrench, atol=1e-6 * np.abs(wrench).max())
    np.testing.assert_allclose(after.points[::-1], before.points, atol=1e-7)
    assert after.energy == pytest.approx(before.energy, rel=1e-8)


def test_wrenches_meet_the_tolerance_and_so_does_their_estimate():
    exact = tracked(away(("ring", "pin")), 1e-10)[1]
    for tolerance in (1e-3, 1e-5, 1e-7):
        found = tracked(away(("ring", "pin")), tolerance)[1]
        assert found.error_estimate <= tolerance
        for name in ("start_wrench", "end_wrench"):
            ours, true = getattr(found, name), getattr(exact, name)
            assert np.linalg.norm((ours - true)[:3]) <= tolerance * np.linalg.norm(true[:3])
            assert np.linalg.norm((ours - true)[3:]) <= tolerance * np.linalg.norm(true[3:])


@pytest.mark.parametrize("kinds", [("pin",), ("ring",), ("tube",), ("ring", "pin"), ("ring", "tube")])
@pytest.mark.parametrize("order", [2, 3])
@STRETCHES
def test_wrenches_converge_with_twice_the_order_of_the_elements(kinds, order, soft):
    """All pieces on equal elements, balanced again; what they share converges with them."""
    tracker, _ = tracked(away(kinds, **soft), 1e-10)
    (coupled,), none = tracker._coupled, np.zeros(0)
    mounts = tracker.kinematics.poses(none)[coupled.which]
    fine = [(piece.length, piece.rod, piece.q, piece.end_force) for piece in coupled.pieces]

    def shared() -> np.ndarray:
        ends = np.concatenate([piece.ends().wrenches for piece in coupled.pieces])
        return np.concatenate([ends, coupled.arcs])

    exact, errors = shared(), []
    state = coupled.state
    for elements in (4, 8):
        mesh = Mesh(reference_element(order), np.full(elements, 1.0 / elements))
        for piece, (length, rod, q, F) in zip(coupled.pieces, fine, strict=True):
            piece.set_length(length)  # whose unit of force the compliance is in
            coarse = rod.variant(mesh)
            settled = settle(coarse, rod.mesh.interpolate(q, mesh.nodes), F)
            piece._rod, piece._q, piece._F = settled.rod, settled.q, settled.F
        coupled._inverse = None
        balanced = coupled._newton(tracker.kinematics, none, mounts, state)
        assert balanced is not None
        coupled._accept(none, balanced)
        errors.append(np.linalg.norm(shared() - exact))
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2 * order, abs=0.6)


def supported_arm(
    kind: str, link: str | None, cable: dict[str, Any] | None = None, **fields: Any
) -> dict[str, Any]:
    """The arm whose cable goes through a pin or ring where its middle is at 0.3 rad; `cable`: its fields."""
    scene = clipped_arm(link)
    scene["cables"][0] |= cable or {}
    (one,) = scene["cables"][0]["supports"]
    one[kind] = one.pop("clip") | fields
    return scene


@pytest.mark.parametrize("link", ["turret", None])
@pytest.mark.parametrize("kind", ["pin", "ring", "tube"])
@STRETCHES
def test_joint_load_counts_supports_by_virtual_work(kind, link, soft):
    tracker = Tracker(supported_arm(kind, link, soft), tolerance=1e-9)
    (name,) = tracker.joint_names
    tracker.arrive({name: 0.3})

    step = 1e-4
    angles = (0.35 - step, 0.35, 0.35 + step)
    (before, _, low), (torque, slope, _), (after, _, high) = (load_at(tracker, one) for one in angles)
    assert torque == pytest.approx((low - high) / (2 * step), rel=1e-6)
    assert slope == pytest.approx((after - before) / (2 * step), rel=1e-6)


@pytest.mark.parametrize("kind", ["pin", "ring", "tube"])
@STRETCHES
def test_clamp_stiffness_is_that_of_finite_differences(kind, soft):
    scene = away((kind,), **soft)
    _, found = tracked(scene, 1e-10)
    exact = found.clamp_stiffness
    assert np.abs(exact).max() < np.inf
    own = Rotation.from_euler("xyz", scene["cables"][0]["end"]["rpy"])
    for k in range(6):
        step, seen = 1e-5, []
        for sign in (1.0, -1.0):
            moved = copy.deepcopy(scene)
            motion = sign * step * np.eye(6)[k]
            end = moved["cables"][0]["end"]
            end["position"] = (own.apply(motion[:3]) + end["position"]).tolist()
            end["orientation"] = (own * Rotation.from_rotvec(motion[3:])).as_quat().tolist()
            del end["rpy"]
            one = tracked(moved, 1e-10)[1]
            seen.append(np.concatenate([one.start_wrench, one.end_wrench]))
        column = (seen[0] - seen[1]) / (2 * step)
        np.testing.assert_allclose(exact[:, 6 + k], column, atol=1e-5 * np.abs(column).max())


HELD_ENDS = {
    "pinned": {"kind": "pinned"},
    "swivel": {"kind": "swivel"},
    "sliding": {"kind": "sliding", "axial_force": 1.5},
    "free": {"kind": "free", "force": [0.2, 0.0, -1.0]},
}


def on_cart(kind: str, end: dict[str, Any] | None = None, **fields: Any) -> dict[str, Any]:
    """The cable of `rubbing` with its support on the cart, and another end, fixed in the world."""
    scene = parse_yaml(rubbing(0.0).text, "scene")
    (cable,) = scene["cables"]
    along = {"rpy": [0.0, 2.0, 0.1]} if kind == "tube" else {}
    del cable["end"]["link"]
    if end is not None:
        free = end["kind"] == "free"
        cable["end"] = end if free else cable["end"] | end
    cable["supports"] = [support(kind, "r", 0.42, [0.38, 0.02, -0.02], link="cart", **along)]
    cable |= fields
    return scene


def slopes(tracker: Tracker, x: float, step: float = 1e-4) -> tuple[np.ndarray, np.ndarray]:
    """Joint load and joint stiffness, and the same by central differences of the energy and of the load."""

    def at(slide: float) -> tuple[float, float, float]:
        found = tracker.arrive({"slide": slide})
        assert found["c"].status.trusted, found["c"].message
        load = joint_load(tracker, found, {"slide": slide})
        return float(load.torque[0]), float(load.stiffness[0, 0]), found["c"].energy

    tracker.arrive({"slide": x})
    (before, _, low), (torque, slope, _), (after, _, high) = (at(x + d) for d in (-step, 0.0, step))
    return np.array([torque, slope]), np.array([(low - high) / (2 * step), (after - before) / (2 * step)])


@pytest.mark.parametrize("kind", ["pin", "ring", "tube"])
@pytest.mark.parametrize("end", HELD_ENDS)
@STRETCHES
def test_ends_of_any_kind_go_with_supports(end, kind, soft):
    tracker = Tracker(load_scene(on_cart(kind, HELD_ENDS[end], **soft), urdf=SLIDER), tolerance=1e-8)
    exact, differences = slopes(tracker, 0.0, 5e-5)
    np.testing.assert_allclose(exact, differences, rtol=1e-5)


def test_pieces_beside_a_ring_touch_obstacles_also_on_moving_links():
    values = parse_yaml(rubbing(0.0).text, "scene")
    values["cables"][0]["outer_diameter"] = 0.01
    plain = Tracker(load_scene(values, urdf=SLIDER), tolerance=1e-6, polyline_points=401)
    points = plain.arrive({"slide": 0.0})["c"].points
    under, beside = points[80] - [0.0, 0.0, 0.052], points[320] - [0.042, 0.0, 0.0]
    values["obstacles"] = [
        {"name": "ball", "sphere": {"center": under.tolist(), "radius": 0.05}},
        {"name": "peg", "link": "cart", "sphere": {"center": beside.tolist(), "radius": 0.04}},
    ]
    tracker = Tracker(load_scene(values, urdf=SLIDER), tolerance=1e-8)
    exact, differences = slopes(tracker, 0.0)
    # the joint load is good to the tolerance of contact
    np.testing.assert_allclose(exact, differences, rtol=5e-5)
    found = tracker.arrive({"slide": 0.0})["c"]
    assert set(found.obstacle_wrenches) == {"ball", "peg"}
    arcs = [contact.arc_length for contact in found.contacts]
    assert arcs[0] < tracker._coupled[0].arcs[0] < arcs[-1]


def test_the_temperature_may_change():
    table = {"value": 20.0, "table": [[-100, 3.2, 2.8], [20, 1, 1]]}
    warm, cold = (on_cart("ring", temperature=table | {"value": value}) for value in (20.0, -40.0))
    tracker = Tracker(load_scene(warm, urdf=SLIDER), tolerance=1e-7)
    tracker.arrive({"slide": 0.0})
    tracker.set_environment({"temperature": -40.0})
    found = tracker.arrive({"slide": 0.0})["c"]
    other = Tracker(load_scene(cold, urdf=SLIDER), tolerance=1e-7).arrive({"slide": 0.0})["c"]
    size = np.abs(other.end_wrench).max()
    np.testing.assert_allclose(found.end_wrench, other.end_wrench, atol=1e-6 * size)


# Friction


SLIDER = """
<robot name="r"><link name="base"/><link name="cart"/>
<joint name="slide" type="prismatic"><parent link="base"/><child link="cart"/><axis xyz="0 0 -1"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>
"""


def rubbing(friction: float, **fields: Any) -> Any:
    """A cable from a wall through a ring, and down to a cart that pulls it down or lets it up."""
    scene = {
        "gravity": [0.0, 0.0, -GRAVITY],
        "cables": [{
            "name": "c", "length": 0.85, "stiffness": [0.02, 0.02, 0.015], "linear_density": 1.0,
            "start": {"position": [0.0, 0.0, 0.0], "rpy": [0.0, 1.2, 0.0]},
            "end": {"link": "cart", "position": [0.55, 0.06, -0.35], "rpy": [0.0, np.pi, 0.0]},
            "supports": [support("ring", "r", 0.42, [0.4, 0.0, 0.0], friction=friction)],
        } | fields],
    }  # fmt: skip
    return load_scene(scene, urdf=SLIDER)


def test_friction_holds_until_the_tensions_differ_by_mu_times_the_force_across():
    tracker = Tracker(rubbing(0.3), tolerance=1e-8)
    (coupled,) = tracker._coupled
    stuck, slid = 0, 0
    arc = None
    for x in [*np.linspace(0.0, 0.05, 25), *np.linspace(0.05, -0.08, 45), *np.linspace(-0.08, 0.05, 31)]:
        found = tracker.arrive({"slide": x})["c"]
        assert found.status.trusted, found.message
        before, after = tensions(tracker)
        total = coupled.pieces[0].ends().wrenches[6:9] + coupled.pieces[1].ends().wrenches[:3]
        limit = 0.3 * np.hypot(*total[:2])
        assert abs(after - before) <= limit * (1 + 1e-6)
        if arc is not None:
            moved = coupled.arcs[0] - arc
            if abs(moved) > 1e-9:
                # it slides towards the larger tension, and friction is at its limit
                assert moved * (after - before) < 0.0
                assert abs(after - before) == pytest.approx(limit, rel=1e-6)
                slid += 1
            else:
                stuck += 1
        arc = coupled.arcs[0]
    assert stuck > 5
    assert slid > 20


@pytest.mark.parametrize("turn", [-0.08, -0.05])
@pytest.mark.parametrize("soft", [{}, SOFT_HOSE], ids=["keeps its length", "stretches and shears"])
def test_friction_is_that_of_shooting_where_it_slides_and_where_it_sticks(turn, soft):
    """Led to `turn` it slides, so that the tensions differ by mu times the force across; a little way back it
    sticks: the cable is as on a pin at the arc length where it turned round.
    """
    values, mu = parse_yaml(rubbing(0.3, **soft).text, "scene"), 0.3
    (cable,) = values["cables"]
    cable["end"].pop("link")
    home = np.array(cable["end"]["position"])
    (ring,) = (one["ring"] for one in cable["supports"])
    tracker = Tracker(rubbing(mu, **soft), tolerance=1e-9)
    for x in np.linspace(0.0, turn, 21):
        tracker.arrive({"slide": x})
    arcs = []
    for x in (turn, turn + 1e-3):
        found = tracker.arrive({"slide": x})["c"]
        assert found.status is Status.CONVERGED, found.message
        arcs.append(tracker._coupled[0].arcs[0])
        cable["end"]["position"] = (home - [0.0, 0.0, x]).tolist()
        ends = [piece.ends() for piece in tracker._coupled[0].pieces]
        slides = x == turn
        more = ends[1].forces[0] - ends[0].forces[1]
        held = supported.Held(np.array(ring["position"]), slides, float(np.copysign(mu, more)) * slides)
        mine = [
            -Rotation.from_euler("xyz", cable[end]["rpy"]).apply(wrench.reshape(2, 3)).ravel()
            for end, wrench in (("start", found.start_wrench), ("end", found.end_wrench))
        ]
        force = -found.support_wrenches["r"][None, :3]
        guess = supported.Solution(*mine, force, np.array(arcs[-1:]), np.zeros((1, 3)))
        exact = supported.solve(cable, np.array([0.0, 0.0, -GRAVITY]), [held], guess)
        for ours, true in ((mine[0], exact.start), (mine[1], exact.end), (force, exact.forces)):
            np.testing.assert_allclose(ours, true, atol=1e-6 * np.abs(exact.forces).max())
        assert arcs[-1] == pytest.approx(exact.arcs[0], abs=1e-7)
    assert arcs[1] == pytest.approx(arcs[0], abs=1e-9)


def test_a_path_told_in_more_steps_ends_in_the_same_place():
    """Where it slides on, friction is that of the pose; where it sticks, that of where it turned back."""
    ends = {}
    for count in (7, 23, 90):
        tracker = Tracker(rubbing(0.3), tolerance=1e-8)
        for x in [*np.linspace(0.0, -0.08, count), *np.linspace(-0.08, -0.03, count)]:
            found = tracker.arrive({"slide": x})["c"]
            assert found.status.trusted, found.message
        ends[count] = tracker._coupled[0].arcs[0], found.end_wrench
    for count in (7, 23):
        assert ends[count][0] == pytest.approx(ends[90][0], abs=1e-7)
        np.testing.assert_allclose(ends[count][1], ends[90][1], atol=1e-5 * np.abs(ends[90][1]).max())


def test_there_and_back_without_friction_is_the_same_and_with_it_is_not():
    arcs = {}
    for friction in (0.0, 0.3):
        tracker = Tracker(rubbing(friction), tolerance=1e-8)
        seen = []
        for x in (0.0, -0.04, -0.06, -0.04):
            tracker.arrive({"slide": x})
            seen.append(tracker._coupled[0].arcs[0])
        arcs[friction] = seen
    assert arcs[0.0][1] == pytest.approx(arcs[0.0][3], abs=1e-8)
    assert abs(arcs[0.3][1] - arcs[0.3][3]) > 1e-4


def test_a_snapshot_keeps_what_the_supports_share():
    tracker = Tracker(rubbing(0.3), tolerance=1e-6)
    for x in (0.0, -0.06, -0.03):
        tracker.arrive({"slide": x})
    kept = tracker.snapshot()
    other = Tracker(rubbing(0.3), tolerance=1e-6)
    other.restore(kept)
    one, two = (t.arrive({"slide": -0.01})["c"] for t in (tracker, other))
    assert one.end_wrench.tobytes() == two.end_wrench.tobytes()
    assert one.points.tobytes() == two.points.tobytes()


def test_points_are_at_equal_arc_lengths_wherever_the_ring_is():
    tracker = Tracker(rubbing(0.0), tolerance=1e-8, polyline_points=401)
    for x in (0.0, -0.08):
        points = tracker.arrive({"slide": x})["c"].points
        steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
        assert len(points) == 401
        np.testing.assert_allclose(steps, 0.85 / 400, rtol=1e-3)


def test_a_cable_pulled_out_of_its_rings_is_out_of_reach_and_comes_back():
    tracker = Tracker(rubbing(0.0), tolerance=1e-6)
    before = tracker.arrive({"slide": 0.04})["c"]
    far = tracker.arrive({"slide": 0.9})["c"]
    assert far.status is Status.OUT_OF_REACH
    assert "way through its rings" in far.message
    after = tracker.arrive({"slide": 0.04})["c"]
    np.testing.assert_allclose(
        after.end_wrench, before.end_wrench, atol=1e-5 * np.abs(before.end_wrench).max()
    )


def test_a_short_piece_between_a_clamp_and_a_ring():
    """The ring, 2 cm from the clamp, pushes the cable aside by 0.8 mm: its piece is fifty times as stiff."""
    where = FREE.points[2] + [0.0005, -0.0005, 0.0003]
    scene = mapping(START, END, weight=30.0, supports=[support("ring", "r", 0.02, where)])
    tracker, found = tracked(scene, 1e-8)
    (arc,) = tracker._coupled[0].arcs
    assert arc == pytest.approx(0.02, abs=1e-3)
    first, last = (Rotation.from_euler("xyz", end["rpy"]) for end in (START, END))
    mine = [
        -np.concatenate([turn.apply(w[:3]), turn.apply(w[3:])])
        for turn, w in ((first, found.start_wrench), (last, found.end_wrench))
    ]
    force = -found.support_wrenches["r"][None, :3]
    guess = supported.Solution(mine[0], mine[1], force, np.array([arc]), np.zeros((1, 3)))
    held = [supported.Held(where, True)]
    exact = supported.solve(scene["cables"][0], np.array([0.0, 0.0, -GRAVITY]), held, guess)
    np.testing.assert_allclose(force, exact.forces, rtol=1e-5)
    assert arc == pytest.approx(exact.arcs[0], abs=1e-9)


def test_a_branch_that_was_lost_is_told_until_reset(monkeypatch):
    tracker = Tracker(rubbing(0.3), tolerance=1e-6)
    assert tracker.arrive({"slide": 0.0})["c"].status is Status.CONVERGED
    (coupled,) = tracker._coupled
    monkeypatch.setattr(coupled, "_follow", lambda *_: (1, None))
    statuses = [tracker.arrive({"slide": x})["c"].status for x in (0.01, 0.02, 0.01)]
    assert statuses == [Status.NOT_CONVERGED, Status.NOT_CONVERGED, Status.BRANCH_LOST]
    assert "from pose to pose" in tracker.lost["c"]
    monkeypatch.undo()
    assert tracker.arrive({"slide": 0.0})["c"].status is Status.BRANCH_LOST
    tracker.reset()
    assert tracker.arrive({"slide": 0.0})["c"].status is Status.CONVERGED


@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_there_and_back_until_slack_and_taut(friction):
    """Pulled taut through the ring and let out until it folds: each pose is solved, or says why not."""
    tracker = Tracker(rubbing(friction), tolerance=1e-5)
    seen = []
    for x in [*np.linspace(0.0, 0.1, 21), *np.linspace(0.1, -0.3, 81), *np.linspace(-0.3, 0.0, 61)]:
        found = tracker.arrive({"slide": x})["c"]
        seen.append(found.status)
        if found.status is Status.OUT_OF_REACH:
            assert x > 0.069
        elif found.status.trusted:
            assert x < 0.071
            before, after = tensions(tracker)
            assert np.isfinite([before, after]).all()
    assert seen.count(Status.CONVERGED) > 130
    assert seen.count(Status.BRANCH_LOST) == 0


def test_tables_and_logs_of_a_sweep_have_the_wrenches_at_supports(tmp_path):
    values = supported_arm("ring", "turret", friction=0.1)
    file = tmp_path / "scene.yaml"
    file.write_text(yaml.safe_dump(values | {"robot": {"urdf": str(share_file("config", "space_arm.urdf"))}}))
    sweep = ["sweep", str(file), "--joint", "orientation=0.2:0.4:0.025", "--jobs", "1", "--out"]
    assert main([*sweep, str(tmp_path / "t.csv")]) == 0
    with (tmp_path / "t.csv").open(newline="") as rows:
        table = list(csv.DictReader(rows))
    tracker = Tracker(load_scene(file))
    assert len(table) == 9
    for row in table:
        found = tracker.arrive({"orientation": float(row["orientation"])})["camera_cable"]
        held = [float(row[f"clip_{kind}_{axis}"]) for kind in ("force", "moment") for axis in "xyz"]
        np.testing.assert_allclose(held, found.support_wrenches["clip"], rtol=1e-6, atol=1e-10)
    pytest.importorskip("rclpy", reason="logs of sweeps need ROS")
    assert main([*sweep, str(tmp_path / "t.mcap")]) == 0
    topics = LogReader(tmp_path / "t.mcap").topics
    assert topics["/cable_node/camera_cable/clip_wrench"].count == 9
    assert main(["replay", str(tmp_path / "t.mcap"), "--resolve", "--tolerance", "1e-6"]) == 0


def test_the_example_of_the_page_is_held_by_its_supports():
    page = Path(__file__).parents[1] / "docs" / "ends.md"
    *_, example = [block.text for block in blocks(page) if block.language == "yaml"]
    scene = parse_yaml(example, str(page))
    supports = scene["cables"][0]["supports"]
    tracker = Tracker(scene, tolerance=1e-6, polyline_points=1001)
    found = tracker.arrive({})["dress_pack"]
    assert found.status is Status.CONVERGED, found.message
    np.testing.assert_allclose(found.points[300], [0.28, 0.0, 0.02], atol=1e-6)
    ring = round(1000 * tracker._coupled[0].arcs[1])
    assert np.linalg.norm(found.points[ring] - [0.58, 0.02, 0.08]) < 1e-3
    turn = Rotation.from_euler("y", np.pi / 2)
    total = turn.apply(found.start_wrench[:3] + found.end_wrench[:3])
    for fields, wrench in zip(supports, found.support_wrenches.values(), strict=True):
        own = Rotation.from_euler("xyz", fields.get("tube", {}).get("rpy", [0.0, 0.0, 0.0]))
        total += own.apply(wrench[:3])
    np.testing.assert_allclose(total, [0.0, 0.0, -0.2 * 9.81], atol=1e-5)


MISTAKES = {
    "supports[0]": ([{"name": "a"}], {}, "give one of clip, pin, ring and tube, not 0"),
    "supports[0].ring.friction": (
        [support("ring", "a", 0.3, [0.3, 0, 0], friction=-0.1)], {}, "must not be negative",
    ),
    "supports": (
        [support("ring", "a", 0.3, [0.3, 0, 0])],
        {"start": {"kind": "swivel", **START}, "end": {"kind": "pinned", **END}},
        "nothing holds the twist",
    ),
    "end.moment": (
        [support("pin", "a", 0.3, [0.3, 0, 0])],
        {"end": {"kind": "free", "moment": [0, 0, 0.1]}},
        "put a clip",
    ),
}  # fmt: skip


@pytest.mark.parametrize("field", MISTAKES)
def test_what_makes_no_sense_is_one_sentence_with_its_field(field):
    supports, extra, words = MISTAKES[field]
    with pytest.raises(SceneError) as error:
        load_scene(mapping(**({"start": START, "end": END} | extra), supports=supports))
    assert f"cables[0].{field}:" in str(error.value)
    assert words in str(error.value)


def test_branches_of_a_cable_with_a_ring_are_not_listed():
    scene = mapping(START, END, supports=[support("ring", "a", 0.3, [0.3, 0, 0])], outer_diameter=0.01)
    scene["obstacles"] = [
        {"name": "g", "friction": 0.2, "plane": {"point": [0, 0, -3.0], "normal": [0, 0, 1]}}
    ]
    with pytest.raises(SceneError, match="cannot be listed yet"):
        branches(load_scene(scene | {"effects": ["weight", "contact"]}), {})
