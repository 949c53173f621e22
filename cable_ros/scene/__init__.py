"""What there is: the scene file, and where its clamps are."""

from cable_ros.scene.errors import SceneError
from cable_ros.scene.kinematics import Kinematics
from cable_ros.scene.load import load_scene
from cable_ros.scene.model import Cable, Mount, Robot, Scene
from cable_ros.scene.variation import vary

__all__ = ["Cable", "Kinematics", "Mount", "Robot", "Scene", "SceneError", "load_scene", "vary"]
