# SPDX-License-Identifier: Apache-2.0
"""Where a cable passes through links of the robot that its scene does not have among the obstacles."""

from __future__ import annotations

import dataclasses
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from cable_ros.compilation import njit
from cable_ros.contact.distance import gap, placed
from cable_ros.contact.overlaps import LONGEST
from cable_ros.effects.contact import encode
from cable_ros.equilibrium import Equilibrium, Overlap
from cable_ros.scene import Kinematics, Obstacle, Scene, SceneError

WORLD = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])


class RobotOverlaps:
    """Compares cables with the collision geometry of the links whose poses the scene's joints tell.

    Args:
        scene: what there is.
        joint_names: of its kinematics.
    """

    def __init__(self, scene: Scene, joint_names: Sequence[str]) -> None:
        self.unknown = ""
        """Sentence about the links that cannot be compared with; mostly empty."""
        self._cables = scene.cables
        self._obstacles: list[Obstacle] = []
        if scene.robot is not None and "<collision" in scene.robot.urdf:
            from cable_ros.scene import robot_obstacles  # SciPy's rotations take a quarter of a second

            modelled = isinstance(scene.effects, str) or "contact" in scene.effects
            unknown: dict[str, str] = {}
            try:
                self._obstacles, unknown = robot_obstacles.beside(
                    scene.robot, scene.cables, joint_names, modelled
                )
            except SceneError as error:
                unknown = {"the robot": str(error)}
            if unknown:
                why = next(iter(unknown.values()))
                self.unknown = f"Cables are not compared with {', '.join(unknown)}: {why}"
        self.compared = bool(self._obstacles)
        """Whether there are links that cables are compared with."""
        self._solids: dict[str, list[int]] = defaultdict(list)
        for k, obstacle in enumerate(self._obstacles):
            self._solids[obstacle.link or ""].append(k)
        if self._obstacles:
            self._kinematics = Kinematics(dataclasses.replace(scene, obstacles=tuple(self._obstacles)))
            self._rows = [encode(self._obstacles, cable.radius, cable.name) for cable in scene.cables]

    def mark(
        self,
        found: dict[str, Equilibrium],
        joints: Mapping[str, float],
        outline: Callable[[int], np.ndarray],
    ) -> None:
        """Put into `found` which links its trusted cables pass through, and what their messages then say.

        Args:
            found: equilibria by cable.
            joints: value by joint name.
            outline: gives a cable's polyline (n, 3), world, m, by its number.
        """
        if not self.compared:
            return
        links = self._kinematics.obstacle_poses(
            np.array([joints[name] for name in self._kinematics.joint_names], dtype=float)
        )
        for i, cable in enumerate(self._cables):
            if not found[cable.name].status.trusted:
                continue
            points = outline(i)
            rows = placed(self._rows[i], links, WORLD, 1.0)
            step = LONGEST * cable.length / (len(points) - 1)
            deepest, first, last = inside(np.ascontiguousarray(points), step, rows)
            if deepest.max(initial=0.0) > 0.0:
                along = np.linspace(0.0, cable.length, len(points))
                passed = {}
                for link, solids in self._solids.items():
                    within = [k for k in solids if deepest[k] > 0.0]
                    if within:
                        depth, (begin, end) = deepest[within].max(), (first[within].min(), last[within].max())
                        passed[link] = Overlap(
                            link, cable.radius - float(depth), cable.radius,
                            (float(along[begin]), float(along[end])),
                        )  # fmt: skip
                found[cable.name] = _passing(found[cable.name], passed)


@njit(cache=True)
def inside(points, step, obstacles):  # type: ignore[no-untyped-def]
    """How deep a polyline is in each obstacle, and where.

    Args:
        points: (n, 3) m.
        step: the most that neighbouring points may be apart, m.
        obstacles: (o, WIDTH) as `distance.gap` takes them.

    Returns:
        (o,) largest depth, m, 0 outside, and (o,) first and last point within.
    """
    count = obstacles.shape[0]
    deepest, first, last = np.zeros(count), np.zeros(count, np.int64), np.zeros(count, np.int64)
    n, directions, bends = np.empty(3), np.empty((2, 3)), np.empty(2)
    for o in range(count):
        k = 0
        while k < points.shape[0]:
            distance = gap(obstacles[o], points[k], n, directions, bends)
            if distance < 0.0:
                if deepest[o] == 0.0:
                    first[o] = k
                deepest[o], last[o] = max(deepest[o], -distance), k
            k += max(1, int(min(distance / step, 1e9)))
    return deepest, first, last


def _passing(found: Equilibrium, passed: Mapping[str, Overlap]) -> Equilibrium:
    """With these overlaps, by link."""
    passages = "; ".join(
        f"{link} by {(one.contact_distance - one.distance) * 1e3:.3g} mm "
        f"between {one.between[0]:.3g} and {one.between[1]:.3g} m"
        for link, one in passed.items()
        if one.between
    )
    message = f"{found.message} It passes through {passages}: the robot is not among its obstacles."
    return dataclasses.replace(found, message=message, overlaps=(*found.overlaps, *passed.values()))
