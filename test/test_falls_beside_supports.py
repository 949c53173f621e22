# SPDX-License-Identifier: Apache-2.0
"""Cables through pins, rings and tubes that rub, and snap: friction's memory, however the path is told."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from test_falls import cone
from test_rough_supports import URDF, arrived, bent

from cable_ros import Tracker
from cable_ros.branch.viscous_fall import ViscousFall
from cable_ros.equilibrium import Equilibrium, Status
from cable_ros.scene import load_scene

ALONG = Rotation.from_euler("y", np.pi / 2).as_quat().tolist()
POSES = 8


def across(friction: float) -> dict[str, Any]:
    """A heavy cable over a rough beam and through a pin, all in one vertical plane."""
    scene = bent("pin", friction)
    (cable,) = scene["cables"]
    cable["start"]["orientation"] = cable["end"]["orientation"] = ALONG
    cable["end"]["position"] = [1.05, 0.0, 0.08]
    cable["supports"][0]["pin"]["position"] = [0.55, 0.0, 0.08]
    return scene


def drawn(friction: float, parts: int = 1) -> tuple[Tracker, list[Equilibrium]]:
    """The tracker and the results as its end is drawn across until it snaps, and on."""
    tracker, out = Tracker(load_scene(across(friction), urdf=URDF), joint_limits="ignore"), []
    for t in np.linspace(0.0, 1.0, POSES * parts + 1):
        out.append(arrived(tracker, x=0.05 * np.sin(np.pi * t), y=0.15 * t))
    return tracker, out


@pytest.mark.parametrize("friction", [0.2, 0.5])
def test_a_cable_snaps_with_its_friction_however_the_path_is_told(friction):
    """Its contact on the beam neither lets go nor forgets: the forces after it are those of one history."""
    ends, snaps = [], []
    for parts in (1, 2, 4):
        _, found = drawn(friction, parts)
        assert {one.status for one in found} == {Status.CONVERGED, Status.SNAPPED}, found[-1].message
        (snap,) = [i for i, one in enumerate(found) if one.status is Status.SNAPPED]
        assert all(cone(one, friction) < 1.0 + 1e-6 for one in found)
        snaps.append(snap / parts)
        ends.append(found[-1].end_wrench)
    assert max(snaps) - min(snaps) <= 1.0  # each telling brackets it between two of its poses
    for end in ends[1:]:
        assert np.linalg.norm(end - ends[0]) < 0.01 * np.linalg.norm(ends[0])


def test_a_fall_that_forgets_friction_says_so(monkeypatch):
    """Where the cable does not come to rest with its friction, it falls without, as a last resort."""
    monkeypatch.setattr(ViscousFall, "_fall_with_friction", lambda *_: False)
    tracker, rough = drawn(0.5)
    assert rough[-1].status is Status.BRANCH_LOST
    assert "friction of its contacts was forgotten" in rough[-1].message
    assert "until reset is called" in rough[-1].message
    tracker.reset()
    assert arrived(tracker, y=0.02).status is Status.CONVERGED
    assert {one.status for one in drawn(0.0)[1]} == {Status.CONVERGED, Status.SNAPPED}


# A ring with friction, found from a cold start


def beside_a_plate(
    chord: float, length: float, drop: float, over: float, friction: float, pitch: float
) -> dict[str, Any]:
    """A cable through a ring at a `chord`, m, with `length`, m, before it, by a smooth plate above or below.

    `over`: height of the plate's face above the start, m; `drop` of the end below it, m.
    """
    plate = {"size": [0.8 * chord, 0.1, 0.02], "center": [0.5 * chord, 0.0, over + np.copysign(0.01, over)]}
    return {
        "gravity": [0.0, 0.0, -9.80665],
        "obstacles": [{"name": "plate", "box": plate}],
        "cables": [{
            "name": "c", "length": length + 0.8, "linear_density": 0.25, "stiffness": [0.1, 0.1, 0.08],
            "outer_diameter": 0.01,
            "start": {"position": [0.0, 0.0, 0.0], "orientation": ALONG},
            "end": {"position": [chord + 0.6, 0.0, -drop], "rpy": [0.0, pitch, 0.0]},
            "supports": [{"name": "s", "ring": {
                "position": [chord, 0.0, 0.0], "arc_length": length, "friction": friction,
            }}],
        }],
    }  # fmt: skip


@pytest.mark.parametrize("scene", [
    (0.25, 0.3, -0.2, -0.02, 0.1, 1.57), (0.25, 0.3, -0.2, -0.02, 0.4, 1.57),
    (0.25, 0.3, 0.3, 0.02, 0.4, 2.5), (0.25, 0.35, -0.2, -0.02, 0.1, 2.5),
    (0.25, 0.35, -0.2, -0.02, 0.4, 1.57),
])  # fmt: skip
def test_a_ring_that_does_not_hold_the_cable_is_found_beyond_folds(scene):
    """Until friction holds it, it slides so far that it buckles on its way, and leaves the plate."""
    friction = scene[4]
    tracker = Tracker(load_scene(beside_a_plate(*scene), urdf=URDF))
    tracker.polyline_points = 1001
    found = arrived(tracker)
    assert found.status is Status.CONVERGED, found.message
    tangent, force = tangent_at(found, scene[0]), found.support_wrenches["s"][:3]
    along = float(force @ tangent)
    assert abs(along) <= friction * np.linalg.norm(force - along * tangent) * (1.0 + 1e-4)  # as asked for


def tangent_at(found: Equilibrium, x: float) -> np.ndarray:
    """(3,) tangent of the centreline where it passes through the ring at (x, 0, 0), between two points."""
    nearest = int(np.linalg.norm(found.points - [x, 0.0, 0.0], axis=1).argmin())
    near = slice(nearest - 1, nearest + 2)
    tangents = Rotation.from_quat(found.orientations[near]).as_matrix()[:, :, 2]
    out = np.array([np.interp(x, found.points[near, 0], component) for component in tangents.T])
    return out / np.linalg.norm(out)
