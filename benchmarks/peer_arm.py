# SPDX-License-Identifier: Apache-2.0
"""The arm as benchmarks/peers.py hands it to other programs: numbers, clamps, a first shape, references."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from cable_ros import Tracker, load_scene
from cable_ros.scene import Kinematics, vary
from cable_ros.share import share_file

REFERENCES = Path(__file__).parents[1] / "test" / "data" / "equilibria.json"
ANGLES = range(91)
"""Degrees of the orientation joint, one warm step from each to the next."""
LEADER = 1e-10
"""Tolerance of the shape that every program starts from."""


@dataclass(frozen=True)
class Chain:
    """Nodes and edges of a discrete rod; its first and last edges have the clamps in their middles.

    So the bending of the first free node begins at the clamp, and the discrete rods converge with order two.
    """

    edge: float
    """Length of an edge, m."""
    points: np.ndarray
    """(n + 1, 3) nodes, m."""
    frames: Rotation
    """(n,) section frames of the edges, third columns nearly along them."""

    def material(self, axis: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(n, 3) tangents, (n, 3) a section's `axis` across them, (n - 1,) its twists from edge to edge."""
        tangents = np.diff(self.points, axis=0)
        tangents /= np.linalg.norm(tangents, axis=1)[:, None]
        across = self.frames.apply(axis)
        across -= np.sum(across * tangents, axis=1)[:, None] * tangents
        across /= np.linalg.norm(across, axis=1)[:, None]
        twists = [
            angle_about(tangents[i + 1], transported(across[i], tangents[i], tangents[i + 1]), across[i + 1])
            for i in range(len(tangents) - 1)
        ]
        return tangents, across, np.array(twists)


class Arm:
    """The camera cable of the space arm on the branch of test/data/equilibria.json; SI units, world axes."""

    def __init__(self) -> None:
        # 1 N/m as the references have it; the file rounds the density to seven digits
        self.scene = vary(load_scene(share_file("config", "space_arm.yaml")), {"linear_density": 1 / 9.80665})
        (cable,) = self.scene.cables
        self.length, self.density = cable.length, cable.linear_density
        self.bending, self.torsion = float(cable.stiffness[0]), float(cable.stiffness[2])
        self.radius = 0.5 * float(cable.diameter or 0.0)
        self.area = np.pi * self.radius**2
        self.youngs_modulus = self.bending / (np.pi * self.radius**4 / 4)
        self.shear_modulus = self.torsion / (np.pi * self.radius**4 / 2)
        self.gravity = -float(self.scene.gravity[2])
        self.weight = self.density * self.gravity
        self._kinematics = Kinematics(self.scene)
        self.start = self.clamp(0.0, which=0)
        leader = Tracker(self.scene, LEADER, 401)
        self._shape = leader.arrive({"orientation": 0.0})[cable.name]
        cases = {case["name"]: case for case in json.loads(REFERENCES.read_text())["cases"]}
        self.references = {k: _force_on_cable(cases[f"space_arm_{k:+.1f}deg"]) for k in ANGLES if k % 15 == 0}

    def clamp(self, degrees: float, which: int = 1) -> np.ndarray:
        """(7,) clamp pose at an angle of the joint: position, quaternion x y z w; 0: start, 1: end."""
        return self._kinematics.poses(np.array([np.radians(degrees)]))[0, which]

    def error(self, degrees: int, force: np.ndarray) -> float:
        """Relative error of the end force (3,), of the clamp on the cable."""
        exact = self.references[degrees]
        return float(np.linalg.norm(force - exact) / np.linalg.norm(exact))

    def sections(self, at: np.ndarray) -> tuple[np.ndarray, Rotation]:
        """(m, 3) points and (m,) section frames of the starting shape at arc lengths (m,)."""
        known = np.linspace(0.0, self.length, len(self._shape.points))
        points = np.column_stack([np.interp(at, known, column) for column in self._shape.points.T])
        frames = Slerp(known, Rotation.from_quat(self._shape.orientations))(np.clip(at, 0.0, self.length))
        return points, frames

    def chain(self, edges: int) -> Chain:
        """The starting shape as a chain."""
        edge = self.length / (edges - 1)
        points, _ = self.sections((np.arange(edges + 1) - 0.5) * edge)
        _, frames = self.sections(np.arange(edges) * edge)
        points[:2], points[-2:] = clamped(self.start, edge), clamped(self.clamp(0.0), edge)
        return Chain(edge, points, frames)

    def straight(self, edges: int) -> np.ndarray:
        """(n + 1, 3) nodes of the cable laid straight from its start clamp, without strain."""
        edge = self.length / (edges - 1)
        along = Rotation.from_quat(self.start[3:]).apply([0.0, 0.0, 1.0])
        return self.start[:3] + ((np.arange(edges + 1) - 0.5) * edge)[:, None] * along


def clamped(pose: np.ndarray, edge: float) -> np.ndarray:
    """(2, 3) nodes of an edge with the clamp (7,) in its middle."""
    along = 0.5 * edge * Rotation.from_quat(pose[3:]).apply([0.0, 0.0, 1.0])
    return np.array([pose[:3] - along, pose[:3] + along])


def transported(across: np.ndarray, before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """(3,) a vector across the unit tangent `before`, by the smallest turn to `after`."""
    out = across - (across @ after) / (1.0 + before @ after) * (before + after)
    return out / np.linalg.norm(out)


def angle_about(axis: np.ndarray, first: np.ndarray, second: np.ndarray) -> float:
    """Angle from one unit vector to another, both across the axis, rad."""
    return float(np.arctan2(np.cross(first, second) @ axis, first @ second))


def _force_on_cable(case: dict) -> np.ndarray:
    return np.array(case["end_force"])
