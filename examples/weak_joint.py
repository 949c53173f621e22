# SPDX-License-Identifier: Apache-2.0
"""A joint that its cable pushes aside, simulated: to try feedforward.py without a robot.

    ros2 run cable_ros cable_node --ros-args -p scene:=space_arm.yaml
    python3 examples/weak_joint.py --ros-args -p scene:=space_arm.yaml

Inertia I, and a weak position controller of stiffness k and damping d that follows a sine:

    I q'' = k (target - q) + d (target' - q') + I target'' + cable(q) + command

The cable's torque is the solver's. With its own inertia fed forward, the joint errs by nothing but what the
command leaves of that torque.
"""

from __future__ import annotations

import math

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from cable_ros import Tracker, load_scene
from cable_ros.joint import joint_load
from cable_ros.share import scene_path

STEP = 1e-3
"""s of the integration; the joint's own time, sqrt(I/k), is a hundred times as long."""
_COMMAND_TIMEOUT = 0.2  # s; a command that is older is none


class WeakJoint(Node):
    """Publishes `joint_states` and `target`, obeys `effort_controller/commands`; `effort` is the command."""

    def __init__(self) -> None:
        super().__init__("weak_joint")
        scene = self.declare_parameter("scene", "space_arm.yaml").value
        self._joint = self.declare_parameter("joint", "orientation").value
        self._stiffness = self.declare_parameter("stiffness", 0.3).value  # N m/rad
        self._inertia = self.declare_parameter("inertia", 2e-3).value  # kg m^2
        self._amplitude = self.declare_parameter("amplitude", 1.0).value  # rad
        self._period = self.declare_parameter("period", 8.0).value  # s
        rate = self.declare_parameter("rate", 100.0).value  # Hz
        self._damping = 1.4 * math.sqrt(self._stiffness * self._inertia)
        self._tracker = Tracker(load_scene(scene_path(scene)), tolerance=1e-6)
        self._position, self._velocity = 0.0, self._target(0.0)[1]
        self._command, self._command_time, self._held = 0.0, -math.inf, 0.0
        self._cable()  # compiles
        self._start = self._done = self._now()
        self._states = self.create_publisher(JointState, "joint_states", 5)
        self._targets = self.create_publisher(JointState, "target", 5)
        self.create_subscription(Float64MultiArray, "effort_controller/commands", self._on_command, 1)
        self.create_timer(1 / rate, self._on_timer)

    def _now(self) -> float:
        return self.get_clock().now().nanoseconds * 1e-9

    def _target(self, time: float) -> tuple[float, float, float]:
        """Target, its velocity and its acceleration."""
        rate = 2 * math.pi / self._period
        sine, cosine = math.sin(rate * time), math.cos(rate * time)
        return self._amplitude * sine, self._amplitude * rate * cosine, -self._amplitude * rate**2 * sine

    def _cable(self) -> tuple[float, float]:
        """What the cable exerts on the joint where it is, and the derivative by the position."""
        joints = {self._joint: self._position}
        equilibria = self._tracker.solve(joints)
        for equilibrium in equilibria.values():
            if not equilibrium.status.trusted:
                raise RuntimeError(equilibrium.message)
        load = joint_load(self._tracker, equilibria, joints)
        return float(load.torque.item()), float(load.stiffness.item())

    def _on_command(self, message: Float64MultiArray) -> None:
        (self._command,) = message.data
        self._command_time = self._now()

    def _on_timer(self) -> None:
        clock = self.get_clock().now()
        now = clock.nanoseconds * 1e-9
        # Since the last call the joint has had the command that was known then.
        command = self._held
        self._held = self._command if now - self._command_time < _COMMAND_TIMEOUT else 0.0
        before = self._position
        torque, slope = self._cable()
        while self._done < now:
            target, velocity, acceleration = self._target(self._done - self._start)
            force = self._stiffness * (target - self._position) + self._damping * (velocity - self._velocity)
            force += torque + slope * (self._position - before) + command
            self._velocity += STEP * (acceleration + force / self._inertia)
            self._position += STEP * self._velocity
            self._done += STEP
        state = JointState(name=[self._joint], position=[self._position], velocity=[self._velocity])
        state.effort = [command]
        state.header.stamp = clock.to_msg()
        self._states.publish(state)
        target, velocity, _ = self._target(self._done - self._start)
        self._targets.publish(
            JointState(header=state.header, name=state.name, position=[target], velocity=[velocity])
        )


def main() -> None:
    """Run until SIGINT or SIGTERM."""
    try:
        rclpy.init()
        rclpy.spin(WeakJoint())
    except (KeyboardInterrupt, ExternalShutdownException):
        pass


if __name__ == "__main__":
    main()
