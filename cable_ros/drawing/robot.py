# SPDX-License-Identifier: Apache-2.0
"""The robot of a scene as lines from link to link, and the obstacles that its links carry."""

from __future__ import annotations

import dataclasses
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from cable_ros.rod.quaternion import from_ros, multiply, rotate, to_ros
from cable_ros.scene.kinematics import Kinematics
from cable_ros.scene.model import FREE, Scene
from cable_ros.scene.obstacles import Box, Obstacle, Plane, Shape, Sphere
from cable_ros.scene.urdf import chains


@dataclass(frozen=True)
class RobotPose:
    """The robot at one pose of its joints."""

    label: str
    """That of the cables' shapes at this pose."""
    lines: np.ndarray
    """(k, 2, 3) from each link's origin to the next one's, and to the clamps that it carries, world, m."""
    carried: tuple[Shape, ...]
    """Obstacles on its links, in the world."""


class Skeleton:
    """Draws the links between the root and those that carry clamps or obstacles.

    Raises:
        SceneError: the URDF cannot be used, or Pinocchio is missing.
    """

    def __init__(self, scene: Scene) -> None:
        self._carried = [obstacle for obstacle in scene.obstacles if obstacle.link is not None]
        mounts = [mount for cable in scene.cables for mount in cable.all_mounts if mount.link is not None]
        ends = [mount.link for mount in mounts] + [obstacle.link for obstacle in self._carried]
        self._clamps = [(str(mount.link), mount.position) for mount in mounts if mount.kind != FREE]
        self._parents: list[tuple[str, str]] = []
        self._links: list[str] = []
        if scene.robot is not None and ends:
            bare = ET.fromstring(chains(scene.robot.urdf, scene.robot.source, dict.fromkeys(map(str, ends))))
            self._links = [link.get("name", "") for link in bare.iter("link")]
            for joint in bare.iter("joint"):
                parent, child = joint.find("parent"), joint.find("child")
                assert parent is not None
                assert child is not None
                self._parents.append((parent.get("link", ""), child.get("link", "")))
        # A point on each link, which moves as an obstacle would.
        points = tuple(Obstacle(link, Sphere(np.zeros(3), 0.0), link=link) for link in self._links)
        self._kinematics = Kinematics(dataclasses.replace(scene, obstacles=points))

    def at(self, joints: Mapping[str, float], label: str) -> RobotPose:
        """The robot at joint values by name, rad or m; those not named are 0."""
        q = np.array([joints.get(name, 0.0) for name in self._kinematics.joint_names])
        poses = dict(zip(self._links, self._kinematics.obstacle_poses(q), strict=True))
        lines = [(poses[parent][:3], poses[child][:3]) for parent, child in self._parents]
        for link, position in self._clamps:
            origin = poses[link]
            lines.append((origin[:3], origin[:3] + rotate(from_ros(origin[3:]), position)))
        carried = tuple(moved(obstacle.shape, poses[str(obstacle.link)]) for obstacle in self._carried)
        return RobotPose(label, np.array(lines, dtype=float).reshape(-1, 2, 3), carried)


def moved(shape: Shape, pose: np.ndarray) -> Shape:
    """The shape, given in a frame at `pose` (7,): position, m, and quaternion x y z w in the world."""
    position, turn = pose[:3], from_ros(pose[3:])
    if isinstance(shape, Plane):
        return Plane(position + rotate(turn, shape.point), rotate(turn, shape.normal))
    if isinstance(shape, Sphere):
        return dataclasses.replace(shape, center=position + rotate(turn, shape.center))
    if isinstance(shape, Box):
        orientation = to_ros(multiply(turn, from_ros(shape.orientation)))
        return Box(position + rotate(turn, shape.center), shape.size, orientation)
    ends = {"start": position + rotate(turn, shape.start), "end": position + rotate(turn, shape.end)}
    return dataclasses.replace(shape, **ends)
