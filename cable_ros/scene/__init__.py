# SPDX-License-Identifier: Apache-2.0
"""What there is: the scene file, and where its clamps and obstacles are."""

from cable_ros.scene.errors import SceneError
from cable_ros.scene.influences import Influence
from cable_ros.scene.kinematics import Kinematics
from cable_ros.scene.load import load_scene
from cable_ros.scene.model import EFFECTS, Cable, Mount, Robot, Scene
from cable_ros.scene.obstacles import Box, Capsule, Cylinder, Obstacle, Plane, Shape, Sphere
from cable_ros.scene.variation import vary

__all__ = [
    "EFFECTS",
    "Box",
    "Cable",
    "Capsule",
    "Cylinder",
    "Influence",
    "Kinematics",
    "Mount",
    "Obstacle",
    "Plane",
    "Robot",
    "Scene",
    "SceneError",
    "Shape",
    "Sphere",
    "load_scene",
    "vary",
]
