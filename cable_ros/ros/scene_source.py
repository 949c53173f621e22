# SPDX-License-Identifier: Apache-2.0
"""From the scene's file, and the robot's description if that names no robot, to a tracker that is ready."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import String

from cable_ros import interpretation
from cable_ros.ros.preparation import Preparation
from cable_ros.scene.errors import SceneError
from cable_ros.scene.load import load_scene
from cable_ros.tracker import Tracker

if TYPE_CHECKING:
    from rclpy.node import Node
    from rclpy.subscription import Subscription
    from rclpy.task import Future

ROBOT_DESCRIPTION = "robot_description"
_LATCHED_INPUT = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class SceneSource:
    """Loads a scene and gets its code in a thread of its own, at the start and when it is reloaded.

    Args:
        node: subscribes to the robot's description; its parameters set up the tracker.
        path: the scene's file.
        ready: called by the executor with the tracker and the seconds that its code took.
    """

    def __init__(self, node: Node, path: Path, ready: Callable[[Tracker, float], None]) -> None:
        self.path = path
        self.waiting = ""
        """What no joint state is taken for yet, a sentence; also why a robot's description was refused."""
        self.refused = False
        """Whether the last robot's description was refused."""
        self._node, self._ready = node, ready
        self._urdf: str | None = None
        self._robot: Subscription | None = None
        self._preparation: Preparation | None = None
        self._delivered = False

    @property
    def loading(self) -> Future | None:
        """Done as soon as the tracker that is being prepared is handed over; None: nothing is."""
        return None if self._preparation is None else self._preparation.finished

    def load(self) -> bool:
        """Load the scene and begin to compile its code; False if it waits for its robot.

        Raises:
            SceneError: the scene, or the robot's description, can't be used.
        """
        node = self._node
        try:
            scene = load_scene(self.path, urdf=self._urdf)
        except SceneError as error:
            if self._urdf is not None or "robot_description" not in str(error):
                raise
            self._wait_for_robot()
            return False
        settings = (node.get_parameter(name).value for name in ("tolerance", "polyline_points"))
        tracker = Tracker(scene, *settings)
        hurry = interpretation.ALLOWED and not self._delivered  # an old scene goes on meanwhile
        self._tell(f"{'Loading' if hurry else 'Compiling'} the solver; joint states are taken after that.")
        self.refused = False
        self._preparation = Preparation(node, tracker, self._hand_over, hurry)
        return True

    def _hand_over(self, tracker: Tracker, seconds: float) -> None:
        self._preparation, self._delivered = None, True
        self._ready(tracker, seconds)

    def _tell(self, sentence: str) -> None:
        self.waiting = sentence
        self._node.get_logger().info(sentence)

    def _wait_for_robot(self) -> None:
        topic = self._node.resolve_topic_name(ROBOT_DESCRIPTION)
        self._tell(f"{self.path} names no robot; waiting for its URDF on '{topic}'.")
        if self._robot is None:
            take = self._on_robot_description
            self._robot = self._node.create_subscription(String, ROBOT_DESCRIPTION, take, _LATCHED_INPUT)

    def _on_robot_description(self, message: String) -> None:
        self._urdf = message.data
        if self._delivered or self._preparation is not None:
            warning = "A new robot description came; call ~/reload_scene to use it."
            self._node.get_logger().warning(warning)
            return
        try:
            self.load()
        except SceneError as error:
            self.waiting, self.refused = str(error), True
            self._node.get_logger().error(self.waiting)
