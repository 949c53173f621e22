# SPDX-License-Identifier: Apache-2.0
"""The obstacles of a scene as RViz and Foxglove show them."""

from __future__ import annotations

import numpy as np
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from cable_ros.rod.quaternion import between, from_ros, multiply, rotate, to_ros
from cable_ros.ros.cdr_template import Template
from cable_ros.ros.messages import set_stamp
from cable_ros.scene.model import Scene
from cable_ros.scene.obstacles import Box, Capsule, Cylinder, Obstacle, Plane, Sphere

_COLOUR = ColorRGBA(r=0.55, g=0.58, b=0.62, a=0.6)
_PATCH = 3.0  # lengths of the longest cable: edge of the part of a plane that is shown
_SHEET = 1e-3  # of that edge: its thickness
_UP = np.array([0.0, 0.0, 1.0])
_UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])


def _bodies(obstacle: Obstacle, patch: float) -> list[tuple[int, np.ndarray, np.ndarray, np.ndarray]]:
    """Type, position, quaternion w x y z and scale of each marker of an obstacle, in its link's frame."""
    shape = obstacle.shape
    if isinstance(shape, Sphere):
        return [(Marker.SPHERE, shape.center, _UPRIGHT, np.full(3, 2 * shape.radius))]
    if isinstance(shape, Box):
        return [(Marker.CUBE, shape.center, from_ros(shape.orientation), shape.size)]
    if isinstance(shape, Plane):
        # The sheet lies under the surface.
        point = shape.point - 0.5 * _SHEET * patch * shape.normal
        return [(Marker.CUBE, point, between(_UP, shape.normal), patch * np.array([1.0, 1.0, _SHEET]))]
    axis = shape.end - shape.start
    scale = np.array([2 * shape.radius, 2 * shape.radius, np.linalg.norm(axis)])
    bodies = [
        (Marker.CYLINDER, 0.5 * (shape.start + shape.end), between(_UP, axis / np.linalg.norm(axis)), scale)
    ]
    if isinstance(shape, Capsule):
        ball = np.full(3, 2 * shape.radius)
        bodies += [(Marker.SPHERE, end, _UPRIGHT, ball) for end in (shape.start, shape.end)]
    else:
        assert isinstance(shape, Cylinder)
    return bodies


class ObstacleMarkers:
    """`visualization_msgs/MarkerArray` of all obstacles of a scene.

    Args:
        scene: with one obstacle or more.
        world_frame: frame of the markers; those on links are carried along by `fill`.
    """

    def __init__(self, scene: Scene, world_frame: str) -> None:
        patch = _PATCH * max(cable.length for cable in scene.cables)
        markers, self._bodies = [], []
        for index, obstacle in enumerate(scene.obstacles):
            for number, (kind, position, quaternion, scale) in enumerate(_bodies(obstacle, patch)):
                marker = Marker(ns=f"obstacle/{obstacle.name}", id=number, type=kind, action=Marker.ADD)
                marker.header.frame_id = world_frame
                marker.color = _COLOUR
                marker.scale.x, marker.scale.y, marker.scale.z = map(float, scale)
                markers.append(marker)
                self._bodies.append((index, obstacle.shape, position, quaternion))
        self._template = Template(MarkerArray(markers=markers))
        self._poses = [
            self._template.view(f"markers[{i}].pose.position.x", 7) for i in range(len(self._bodies))
        ]

    def fill(self, stamp: int, links: np.ndarray, centre: np.ndarray) -> bytes:
        """Bytes of the message.

        Args:
            stamp: ns.
            links: (n_obstacles, 7) from `Kinematics.obstacle_poses`.
            centre: (3,) world; of a plane, the part nearest to it is shown.
        """
        for pose, (index, shape, position, quaternion) in zip(self._poses, self._bodies, strict=True):
            turn = from_ros(links[index, 3:])
            pose[:3] = links[index, :3] + rotate(turn, position)
            if isinstance(shape, Plane):
                normal = rotate(turn, shape.normal)
                away = centre - pose[:3]
                pose[:3] += away - normal * (normal @ away)
            pose[3:] = to_ros(multiply(turn, quaternion))
        set_stamp(self._template, stamp)
        return self._template.to_bytes()
