# SPDX-License-Identifier: Apache-2.0
"""Cables that touch each other: against shooting over both, balance, virtual work, and invariances."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pages import blocks
from references import crossing
from scipy.spatial.transform import Rotation

from cable_ros.equilibrium import Equilibrium, Status
from cable_ros.joint import joint_load
from cable_ros.scene import SceneError, load_scene
from cable_ros.scene.text import parse_yaml
from cable_ros.tracker import Tracker

GRAVITY = np.array([0.0, 0.0, -9.81])
LIFT = (
    '<robot name="lift"><link name="world"/><link name="tool"/><joint name="lift" type="prismatic">'
    '<parent link="world"/><child link="tool"/><axis xyz="0 0 1"/>'
    '<limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>'
)
BELOW = {
    "name": "below",
    "length": 0.45,
    "stiffness": [0.0013, 0.0013, 0.0009],
    "outer_diameter": 0.008,
    "linear_density": 0.1,
    "start": {"position": [-0.2, 0.01, 0.0], "rpy": [0.0, math.pi / 2, 0.0]},
    "end": {"position": [0.2, 0.0, 0.0], "rpy": [0.0, math.pi / 2, 0.3]},
}
ABOVE = {
    "name": "above",
    "length": 0.45,
    "stiffness": [0.003, 0.002, 0.002],
    "outer_diameter": 0.010,
    "linear_density": 0.12,
    "start": {"link": "tool", "position": [0.02, -0.2, 0.0], "rpy": [-math.pi / 2, 0.0, 0.0]},
    "end": {"link": "tool", "position": [0.03, 0.2, 0.0], "rpy": [-math.pi / 2, 0.0, 0.2]},
}
"""It comes down on the other one as the joint `lift` falls."""
DISTANCE = 0.009


def scene(cables: list[dict[str, Any]], **more: Any) -> dict[str, Any]:
    return {
        "robot": {"urdf": "lift.urdf"}, "gravity": GRAVITY, "cable_contact": True, "cables": cables, **more
    }  # fmt: skip


def tracker(cables: list[dict[str, Any]], tolerance: float = 1e-8, **more: Any) -> Tracker:
    return Tracker(load_scene(scene(cables, **more), urdf=LIFT), tolerance=tolerance)


def lowered(model: Tracker, to: float, first: float = 0.03) -> dict[str, Equilibrium]:
    """Come down from above both cables."""
    found: dict[str, Equilibrium] = {}
    for lift in np.linspace(first, to, 5):
        found = model.arrive({"lift": lift})
        assert all(one.converged for one in found.values()), found
    return found


def in_world(found: Equilibrium) -> tuple[np.ndarray, np.ndarray]:
    """(6,), (6,): start and end wrench along the world's axes."""
    turns = [Rotation.from_quat(q).as_matrix() for q in found.wrench_axes]
    each = zip(turns, (found.start_wrench, found.end_wrench), strict=True)
    start, end = (np.concatenate([R @ W[:3], R @ W[3:]]) for R, W in each)
    return start, end


@pytest.mark.parametrize("lift", [0.006, -0.03])
@pytest.mark.parametrize("tolerance", [1e-4, 1e-8])
@pytest.mark.parametrize("axial", [{}, {"axial_stiffness": 20.0}])
def test_agrees_with_shooting(lift: float, tolerance: float, axial: dict[str, float]) -> None:
    """Shooting is exact to some 1e-9 of these numbers, with or without stretch, of 1 % here."""
    pair = [BELOW | axial, ABOVE | axial]
    found = lowered(tracker(pair, tolerance), lift)
    (one,), (other,) = found["below"].contacts, found["above"].contacts
    cables = []
    for cable in pair:
        ends = {name: dict(cable[name]) for name in ("start", "end")}
        for end in ends.values():
            if end.pop("link", None):
                end["position"] = np.add(end["position"], [0.0, 0.0, lift])
        cables.append(cable | ends)
    wrenches = [in_world(found[name]) for name in ("below", "above")]
    guess = crossing.Solution(
        np.array([-start for start, _ in wrenches]), np.empty((2, 6)), one.force,
        np.array([one.arc_length, other.arc_length]),
    )  # fmt: skip
    exact = crossing.solve(cables, GRAVITY, DISTANCE, guess)
    close = max(tolerance, 1e-7)
    for (start, end), first, last in zip(wrenches, exact.starts, exact.ends, strict=True):
        for a, b in ((-start, first), (-end, last)):
            for part in (slice(0, 3), slice(3, 6)):
                assert np.linalg.norm(a[part] - b[part]) <= close * np.linalg.norm(b[part])
    # the touching points are known as well as the wrenches, in units of the force and of the length
    assert np.linalg.norm(one.force - exact.force) <= 10 * close * np.linalg.norm(exact.force)
    assert np.abs([one.arc_length, other.arc_length] - exact.arcs).max() <= 10 * close * BELOW["length"]


def test_limits_tell_the_clearance_from_obstacles_not_from_the_other_cable() -> None:
    depth = 0.5
    ground = {"name": "ground", "plane": {"point": [0.0, 0.0, -depth], "normal": [0.0, 0.0, 1.0]}}
    limited = [one | {"limits": {"clearance": 0.01}} for one in (BELOW, ABOVE)]
    found = lowered(tracker(limited, obstacles=[ground]), -0.03)
    for one, cable in zip(found.values(), limited, strict=True):
        (clearance,) = [extreme for extreme in one.extremes if extreme.quantity.name == "clearance"]
        lowest = one.points[:, 2].min()
        assert clearance.obstacle == "ground"
        assert clearance.value == pytest.approx(lowest + depth - 0.5 * cable["outer_diameter"], abs=1e-4)


def test_forces_are_in_balance() -> None:
    """What one exerts on the other comes back, along the line between points that are the radii apart."""
    found = lowered(tracker([BELOW, ABOVE]), -0.03)
    (one,), (other,) = found["below"].contacts, found["above"].contacts
    assert (one.obstacle, other.obstacle) == ("above", "below")
    assert (one.other_arc_length, other.other_arc_length) == (other.arc_length, one.arc_length)
    # Newton's method ends at a thousandth of the tolerance
    np.testing.assert_allclose(one.force, -other.force, rtol=1e-8)
    between = other.position - one.position
    assert np.linalg.norm(between) == pytest.approx(DISTANCE, rel=1e-9)
    np.testing.assert_allclose(np.cross(between, other.force), 0.0, atol=1e-8 * DISTANCE)
    assert other.force @ between > 0.0
    for cable, name in ((BELOW, "below"), (ABOVE, "above")):
        start, end = in_world(found[name])
        (contact,) = found[name].contacts
        weight = cable["length"] * cable["linear_density"] * GRAVITY
        total = weight + contact.force - start[:3] - end[:3]
        np.testing.assert_allclose(total, 0.0, atol=1e-8 * np.linalg.norm(weight))


def check_virtual_work(model: Tracker, at: float, step: float, near: float) -> dict[str, Equilibrium]:
    """Torque against the energy's differences to `near`, stiffness against the torque's; the last answer."""
    energies, loads = [], []
    for k in range(-2, 3):
        joints = {"lift": at + k * step}
        found = model.solve(joints)
        energies.append(sum(one.energy for one in found.values()))
        loads.append(joint_load(model, found, joints))
    derivative = np.array([1.0, -8.0, 0.0, 8.0, -1.0]) / (12.0 * step)
    torques = [load.torque[0] for load in loads]
    assert torques[2] == pytest.approx(-derivative @ energies, rel=near)
    assert loads[2].stiffness[0, 0] == pytest.approx(derivative @ torques, rel=1e-5)
    return found


@pytest.mark.parametrize("axial", [{}, {"axial_stiffness": 20.0}])
def test_torque_is_the_work_and_stiffness_its_derivative(axial: dict[str, float]) -> None:
    model, at, step = tracker([BELOW | axial, ABOVE | axial], 1e-9), -0.03, 2e-4
    lowered(model, at - 2.5 * step)
    # differences of fourth order: their error is that of the energies, 1e-9 of some mJ, over the step
    check_virtual_work(model, at, step, 1e-6)


def test_stiffness_of_one_cable_takes_in_the_other() -> None:
    """Move the end of the one that is below, by its own scene, against its stiffness."""
    found, step = lowered(tracker([BELOW, ABOVE]), -0.03), 1e-5
    wrenches = []
    for k in (-1, 1):
        end = BELOW["end"] | {"position": np.add(BELOW["end"]["position"], [0.0, 0.0, k * step])}
        wrenches.append(lowered(tracker([BELOW | {"end": end}, ABOVE]), -0.03)["below"].end_wrench)
    along = Rotation.from_euler("xyz", BELOW["end"]["rpy"]).as_matrix().T @ [0.0, 0.0, 1.0]
    expected = (wrenches[1] - wrenches[0]) / (2.0 * step)
    response = found["below"].stiffness[:, :3] @ along
    # wrenches to 1e-8 over steps of 1e-5 m, and the differences' own error
    np.testing.assert_allclose(response, expected, rtol=1e-3, atol=1e-4 * np.abs(expected).max())


def test_contact_begins_and_ends_where_the_cables_meet() -> None:
    """Wrenches are continuous, forces grow from zero and never pull, and the way back is the same."""
    model = tracker([BELOW, ABOVE], 1e-7)
    lifts = [*np.linspace(0.02, 0.0, 21), *np.linspace(0.0, 0.02, 21)]
    forces, wrenches = [], []
    for lift in lifts:
        found = model.solve({"lift": lift})
        assert all(one.converged and not one.overlaps for one in found.values())
        forces.append(sum(contact.normal_force for contact in found["below"].contacts))
        wrenches.append(np.concatenate([one.end_wrench for one in found.values()]))
    assert min(forces) == 0.0
    assert forces[0] == forces[-1] == 0.0
    assert forces[20] > 0.1
    np.testing.assert_allclose(forces, forces[::-1], atol=1e-6)
    np.testing.assert_allclose(wrenches, wrenches[::-1], atol=1e-6)
    # the steepest rise is 40 N/m: no jump
    assert np.abs(np.diff(forces)).max() < 0.06


def transformed(cable: dict[str, Any], turn: Rotation, shift: np.ndarray) -> dict[str, Any]:
    out = dict(cable)
    for name in ("start", "end"):
        own = dict(cable[name])
        own["position"] = turn.apply(own["position"]) + shift
        own["orientation"] = (turn * Rotation.from_euler("xyz", own.pop("rpy"))).as_quat()
        out[name] = own
    return out


def backwards(cable: dict[str, Any]) -> dict[str, Any]:
    """From its other end: a half turn about the section's x axis puts the tangent round."""
    out = dict(cable)
    for name, other in (("start", "end"), ("end", "start")):
        own = dict(cable[other])
        turned = Rotation.from_euler("xyz", own.pop("rpy")) * Rotation.from_euler("x", math.pi)
        out[name] = own | {"orientation": turned.as_quat()}
    return out


def test_does_not_depend_on_the_point_of_view() -> None:
    """Another order, another end to begin at, another frame of the world: the same forces."""
    base = lowered(tracker([BELOW, ABOVE]), -0.03)
    swapped = lowered(tracker([ABOVE, BELOW]), -0.03)
    turned_back = lowered(tracker([BELOW, backwards(ABOVE)]), -0.03)
    for found in (swapped, turned_back):
        # two solutions to a tolerance of 1e-8
        np.testing.assert_allclose(
            found["below"].end_wrench, base["below"].end_wrench, rtol=0.0,
            atol=1e-7 * np.linalg.norm(base["below"].end_wrench),
        )  # fmt: skip
        assert found["below"].energy == pytest.approx(base["below"].energy, abs=1e-10)
    assert turned_back["above"].contacts[0].arc_length == pytest.approx(
        ABOVE["length"] - base["above"].contacts[0].arc_length, abs=1e-8
    )
    # about the vertical, which the joint's axis is
    turn, shift = Rotation.from_euler("z", 0.7), np.array([0.3, -0.2, 0.1])
    moved = lowered(tracker([transformed(one, turn, shift) for one in (BELOW, ABOVE)]), -0.03)
    for name in ("below", "above"):
        scale = np.linalg.norm(base[name].end_wrench)
        np.testing.assert_allclose(moved[name].end_wrench, base[name].end_wrench, rtol=0.0, atol=1e-7 * scale)
    np.testing.assert_allclose(
        moved["below"].contacts[0].force, turn.apply(base["below"].contacts[0].force), atol=1e-8
    )


def mirrored(cable: dict[str, Any]) -> dict[str, Any]:
    """In the plane y = 0."""
    out = dict(cable)
    for name in ("start", "end"):
        own = dict(cable[name])
        own["position"] = np.multiply(own["position"], [1.0, -1.0, 1.0])
        R = Rotation.from_euler("xyz", own.pop("rpy")).as_matrix()
        # the mirror image of a right-handed frame, with its x axis turned round
        image = np.diag([1.0, -1.0, 1.0]) @ R @ np.diag([-1.0, 1.0, 1.0])
        out[name] = own | {"orientation": Rotation.from_matrix(image).as_quat()}
    return out


def test_mirror_image() -> None:
    """Forces are mirrored, moments against it."""
    base = lowered(tracker([BELOW, ABOVE]), -0.03)
    image = lowered(tracker([mirrored(BELOW), mirrored(ABOVE)]), -0.03)
    sign = np.array([-1.0, 1.0, 1.0, 1.0, -1.0, -1.0])
    for name in ("below", "above"):
        scale = np.linalg.norm(base[name].end_wrench)
        np.testing.assert_allclose(
            image[name].end_wrench, sign * base[name].end_wrench, rtol=0.0, atol=1e-7 * scale
        )


def test_cables_that_do_not_touch_are_those_of_a_scene_without_contact() -> None:
    with_contact, without = (
        tracker([BELOW, ABOVE], 1e-6, cable_contact=asked).solve({"lift": 0.05}) for asked in (True, False)
    )
    for name, one in with_contact.items():
        # two cold starts to the tolerance
        np.testing.assert_allclose(one.end_wrench, without[name].end_wrench, rtol=1e-5, atol=1e-8)
        assert not one.contacts


def test_snapshot_goes_on_with_the_contact() -> None:
    model, other = (tracker([BELOW, ABOVE], 1e-6) for _ in range(2))
    lowered(model, -0.03)
    other.restore(model.snapshot())
    one, two = (each.solve({"lift": -0.032})["below"] for each in (model, other))
    np.testing.assert_array_equal(one.end_wrench, two.end_wrench)
    assert len(two.contacts) == 1


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"shear_stiffness": [10.0, 10.0]}, "shear_stiffness"),
        ({"end": ABOVE["end"] | {"kind": "pinned"}}, "end.kind"),
    ],
)
def test_refuses_what_it_is_not_combined_with(change: dict[str, Any], told: str) -> None:
    with pytest.raises(SceneError, match=f"{told}.*cable_contact"):
        tracker([BELOW, ABOVE | change])


def test_refuses_friction_and_other_values() -> None:
    rough = {"name": "ground", "plane": {"point": [0, 0, -1], "normal": [0, 0, 1]}, "friction": 0.2}
    with pytest.raises(SceneError, match="friction of obstacles and cable_contact"):
        tracker([BELOW, ABOVE], obstacles=[rough])
    with pytest.raises(SceneError, match="the name of a cable"):
        tracker([BELOW, ABOVE], obstacles=[rough | {"name": "above", "friction": 0.0}])
    with pytest.raises(SceneError, match="true, false or"):
        tracker([BELOW, ABOVE], cable_contact="yes")


def test_the_example_of_the_page_is_as_it_says() -> None:
    page = Path(__file__).parents[1] / "docs" / "cable_contact.md"
    (example,) = [block.text for block in blocks(page) if block.language == "yaml"]
    found = Tracker(load_scene(parse_yaml(example, str(page)))).solve({})
    assert all(one.converged and not one.overlaps for one in found.values())
    (one,), (other,) = found["hose"].contacts, found["wire"].contacts
    assert (one.obstacle, other.obstacle) == ("wire", "hose")
    assert np.linalg.norm(one.position - other.position) == pytest.approx(0.009, rel=1e-6)


def test_three_cables_and_two_contacts_on_one() -> None:
    """Two lie on the third: its balance, and the work of lowering both."""
    second = ABOVE | {
        "name": "second",
        "start": ABOVE["start"] | {"position": [-0.08, -0.2, 0.01]},
        "end": ABOVE["end"] | {"position": [-0.09, 0.2, 0.0]},
    }
    model, at, step = tracker([ABOVE, BELOW, second], 1e-8), -0.02, 2e-4
    lowered(model, at - 2.5 * step)
    found = check_virtual_work(model, at, step, 1e-5)
    assert [one.obstacle for one in found["below"].contacts] == ["second", "above"]
    start, end = in_world(found["below"])
    weight = BELOW["length"] * BELOW["linear_density"] * GRAVITY
    pressed = sum(one.force for one in found["below"].contacts)
    np.testing.assert_allclose(weight + pressed, start[:3] + end[:3], atol=1e-7)
    for name in ("above", "second"):
        assert found["below"].obstacle_wrenches[name][:3] == pytest.approx(
            found[name].contacts[0].force, rel=1e-7
        )


def test_two_contacts_of_one_pair() -> None:
    """A loop that comes down on a cable meets it twice, once after the other."""
    loop = {
        "name": "loop",
        "length": 0.4,
        "stiffness": [0.05, 0.05, 0.04],
        "outer_diameter": 0.010,
        "linear_density": 0.05,
        "start": {"link": "tool", "position": [-0.08, -0.12, 0.0], "rpy": [-math.pi / 2, 0.0, 0.0]},
        "end": {"link": "tool", "position": [0.085, -0.12, 0.0], "rpy": [math.pi / 2, 0.0, 0.0]},
    }
    model = tracker([BELOW, loop], 1e-7)
    counts = []
    for lift in np.linspace(-0.04, -0.07, 13):
        found = model.arrive({"lift": lift})
        assert all(one.converged for one in found.values())
        counts.append(len(found["below"].contacts))
    assert counts == sorted(counts)
    assert counts[-1] == 2
    others = sorted(found["loop"].contacts, key=lambda one: one.position[0])
    for one, other in zip(
        sorted(found["below"].contacts, key=lambda one: one.position[0]), others, strict=True
    ):
        np.testing.assert_allclose(one.force, -other.force, rtol=1e-6)
        assert np.linalg.norm(one.position - other.position) == pytest.approx(DISTANCE, rel=1e-8)
    # both forces of one name in one wrench
    total = sum(one.force for one in found["below"].contacts)
    np.testing.assert_allclose(found["below"].obstacle_wrenches["loop"][:3], -total, rtol=1e-12)


def test_cold_start_pushes_apart_cables_that_overlap() -> None:
    """From overlapping shapes to the equilibrium that the path from above leads to."""
    followed, cold = lowered(tracker([BELOW, ABOVE], 1e-7), 0.010), tracker([BELOW, ABOVE], 1e-7)
    found = cold.solve({"lift": 0.010})
    for name, one in followed.items():
        scale = np.linalg.norm(one.end_wrench)
        np.testing.assert_allclose(found[name].end_wrench, one.end_wrench, rtol=0.0, atol=1e-6 * scale)


def test_cables_that_lie_along_each_other_are_told() -> None:
    beside = ABOVE | {
        "start": {"link": "tool", "position": [-0.2, 0.002, 0.0], "rpy": [0.0, math.pi / 2, 0.0]},
        "end": {"link": "tool", "position": [0.2, 0.0, 0.0], "rpy": [0.0, math.pi / 2, 0.0]},
    }
    model = tracker([BELOW, beside], 1e-4)
    assert model.solve({"lift": 0.02})["below"].converged
    found = model.solve({"lift": 0.01})
    for one in found.values():
        assert one.status is Status.NOT_CONVERGED
        assert "'below' and 'above' lie along each other" in one.message
        assert np.isnan(one.end_wrench).all()
    # and back where they are apart, it goes on
    assert model.solve({"lift": 0.02})["below"].converged


def test_temperature_changes_both() -> None:
    """As if it had been cold from the start."""
    cold = {"temperature": {"value": 20.0, "topic": "t", "table": [[-50, 2.0, 2.0], [20, 1.0, 1.0]]}}
    model, other = (tracker([BELOW | cold, ABOVE], 1e-7) for _ in range(2))
    lowered(model, -0.03)
    model.set_environment({"temperature": -20.0})
    other.set_environment({"temperature": -20.0})
    changed, expected = model.solve({"lift": -0.03}), lowered(other, -0.03)
    for name, one in changed.items():
        scale = np.linalg.norm(expected[name].end_wrench)
        np.testing.assert_allclose(one.end_wrench, expected[name].end_wrench, rtol=0.0, atol=1e-6 * scale)
