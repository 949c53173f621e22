# SPDX-License-Identifier: Apache-2.0
"""A hose from a forearm through a ring to a wrist that turns, and that rubs on the wrist's rough links."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cable_ros import Tracker
from cable_ros.bench.drawn import divided
from cable_ros.equilibrium import Equilibrium, Status
from cable_ros.scene import load_scene

JOINTS = {
    "w1": ("forearm", "one", "0 0 0.572", "0 1.5708 0", "0 1 0"),
    "w2": ("one", "two", "0 0.115 0", "0 0 0", "0 0 1"),
    "w3": ("two", "three", "0 0 0.116", "0 0 0", "0 1 0"),
}
"""Parent, child, position, m, and angles, rad, there, and axis of each."""
CORNERS = [(-1.8, -1.57, 0.0), (-2.3, -1.57, -np.pi), (-1.8, -1.2, 0.0)]
"""Joint values, rad: the last joint turns half round, and back."""


def urdf(pitch: float) -> str:
    """The wrist; `pitch` of the forearm, rad."""
    out = ["<link name='base'/><link name='forearm'/><joint name='fix' type='fixed'><parent link='base'/>"
           f"<child link='forearm'/><origin xyz='0 0 1' rpy='0 {pitch} 0'/></joint>"]  # fmt: skip
    for name, (parent, child, xyz, rpy, axis) in JOINTS.items():
        out.append(
            f"<link name='{child}'/><joint name='{name}' type='continuous'><parent link='{parent}'/>"
            f"<child link='{child}'/><origin xyz='{xyz}' rpy='{rpy}'/><axis xyz='{axis}'/></joint>"
        )
    return "<robot name='wrist'>" + "".join(out) + "</robot>"


def scene(length: float) -> dict[str, Any]:
    """The hose, m long, with friction in the ring and on the links: cylinders with flat ends."""

    def can(name: str, link: str, start: list[float], end: list[float]) -> dict[str, Any]:
        shape = {"start": start, "end": end, "radius": 0.0465}
        return {"name": name, "link": link, "friction": 0.2, "cylinder": shape}

    ring = {"link": "forearm", "arc_length": 0.3 * length, "position": [-0.14, 0.0, 0.5], "friction": 0.2}
    hose = {
        "name": "hose", "length": length, "linear_density": 0.25, "outer_diameter": 0.016,
        "stiffness": [0.15, 0.15, 0.12],
        "start": {"link": "forearm", "position": [-0.115, 0.0, 0.2], "rpy": [0.0, 0.0, 0.0]},
        "end": {"link": "three", "position": [-0.09, 0.1, 0.0], "rpy": [0.0, np.pi / 2, 0.0]},
        "supports": [{"name": "ring", "ring": ring}],
    }  # fmt: skip
    cans = [
        can("one", "one", [0.0, 0.1161, 0.0071], [0.0, 0.1161, 0.0636]),
        can("two", "one", [0.0, 0.1185, -0.0462], [0.0, 0.1185, 0.0098]),
        can("three", "two", [0.0, -0.0577, 0.1158], [0.0, 0.0626, 0.1158]),
    ]
    return {"gravity": [0.0, 0.0, -9.80665], "cables": [hose], "obstacles": cans}


def led(pitch: float, values: dict[str, Any], poses: int, corners: int = 3) -> list[Equilibrium]:
    """The results of a scene along the way from corner to corner, up to so many, in so many poses."""
    tracker = Tracker(load_scene(values, urdf=urdf(pitch)))
    path = divided([dict(zip(JOINTS, corner, strict=True)) for corner in CORNERS[:corners]], poses + 1)
    return [tracker.arrive(joints)["hose"] for joints in path]


@pytest.mark.parametrize(("pitch", "length"), [(2.1, 1.15), (2.4, 1.18), (2.5, 1.17)])
def test_the_hose_rubs_on_the_links_however_closely_its_path_is_told(pitch, length):
    """The branch was lost, sooner the closer it was told: where a point comes to rest, Newton's method went
    round between stick and slip without end.
    """
    few, many = (led(pitch, scene(length), poses) for poses in (400, 2000))
    assert [one.message for one in few + many if one.status is not Status.CONVERGED] == []
    assert sum(contact.sliding for one in many for contact in one.contacts) > 100
    rings = [np.array([one.support_wrenches["ring"][:3] for one in results]) for results in (few, many[::5])]
    np.testing.assert_allclose(*rings, atol=0.01 * np.abs(rings[1]).max())


def held_by(kind: str, values: dict[str, Any], friction: float) -> dict[str, Any]:
    """The scene with another kind of support for the ring, and other friction of the links."""
    (support,) = values["cables"][0]["supports"]
    place = support.pop("ring")
    if kind != "ring":
        del place["friction"]
    support[kind] = place | ({"rpy": [0.0, 0.0, 0.0]} if kind == "tube" else {})
    for obstacle in values["obstacles"]:
        obstacle["friction"] = friction
    return values


def test_how_it_slips_is_known_from_step_to_step():
    """It was that of a step long ago: each was a tenth as long as it may be, and added an error."""
    found = led(1.6, held_by("ring", scene(1.18), 0.3), 100)
    assert {one.status for one in found} <= {Status.CONVERGED, Status.SNAPPED}
    assert max(one.error_estimate for one in found) < 0.01


@pytest.mark.parametrize(
    ("kind", "friction", "pitch", "length", "corners"),
    [("ring", 0.3, 1.6, 1.18, 3), ("pin", 0.6, 2.5, 1.1, 3), ("tube", 0.3, 1.6, 1.18, 2)],
)
def test_the_hose_slips_off_the_links_with_its_friction(kind, friction, pitch, length, corners):
    """Where its branch ends at an edge it falls, while material slides through what holds it; it was lost."""
    values = held_by(kind, scene(length), friction)
    told = []
    for poses in (60, 180):
        found = led(pitch, values, poses, corners)
        assert {one.status for one in found} <= {Status.CONVERGED, Status.SNAPPED}, found[-1].message
        told.append(np.array([one.end_wrench[:3] for one in found[:: poses // 60]]))
    np.testing.assert_allclose(*told, atol=0.01 * np.abs(told[1]).max())
