# SPDX-License-Identifier: Apache-2.0
"""A scene that is being tracked: joint states in, messages out, in the order in which they matter."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

from diagnostic_msgs.msg import DiagnosticStatus

from cable_ros.equilibrium import Equilibrium, Status
from cable_ros.joint import joint_load, joint_torque
from cable_ros.ros.cable_outputs import CableOutputs, worst_use
from cable_ros.ros.environment import Environment
from cable_ros.ros.frame_names import Frames
from cable_ros.ros.joint_motion import JointMotion
from cable_ros.ros.joint_states import JointStates
from cable_ros.ros.markers import CableMarkers
from cable_ros.ros.messages import JointLoadMessage, JointStiffnessMessage, SolvedJointsMessage
from cable_ros.ros.obstacle_markers import ObstacleMarkers
from cable_ros.ros.quasi_static import QuasiStatic
from cable_ros.ros.recorder import Outlet
from cable_ros.ros.status_message import StatusMessage
from cable_ros.scene.joint_limits import IGNORE
from cable_ros.scene.model import Scene
from cable_ros.tracker import Tracker

if TYPE_CHECKING:
    from rclpy.node import Node

Send = Callable[[Outlet, bytes], None]


class LiveScene:
    """Tracker, joint states and the messages of one scene.

    Args:
        node: publishes the cables' topics.
        scene: what there is.
        tracker: of that scene.
        topic: of the joint states, for sentences.
        frames: names of the frames.
        hardware_id: of the entries in diagnostics and status.
        note: called with a sentence about an input that can't be used.
    """

    def __init__(
        self,
        node: Node,
        scene: Scene,
        tracker: Tracker,
        topic: str,
        frames: Frames,
        hardware_id: str,
        note: Callable[[str], None],
    ) -> None:
        self.scene = scene
        self.tracker = tracker
        self.frames = frames
        self.hardware_id = hardware_id
        self.states = JointStates(tracker.joint_names, topic)
        self.environment = Environment(node, scene, tracker, note)
        self.cables = {
            cable.name: CableOutputs(node, cable, frames, tracker.polyline_points, hardware_id)
            for cable in scene.cables
        }
        self._solved = SolvedJointsMessage(tracker.joint_names)
        self._load = JointLoadMessage(tracker.joint_names) if tracker.joint_names else None
        self._stiffness = JointStiffnessMessage(tracker.joint_names) if tracker.joint_names else None
        self._status = StatusMessage([cable.name for cable in scene.cables], hardware_id)
        self._markers: dict[str, CableMarkers] = {}
        self._obstacles = ObstacleMarkers(scene, frames.world) if scene.obstacles else None
        self.equilibria: dict[str, Equilibrium] = {}
        self._quasi_static: QuasiStatic | None = None
        self.fresh = True
        """Whether the tracker has solved nothing since it was made or reset."""
        self.statuses: tuple[tuple[Status, bool, int], ...] = ()
        """Of each cable: status, whether it overlaps another or itself, and how it stands to its limits."""
        self._prepare_markers()

    @property
    def joint_limits(self) -> str:
        """The tracker's; where it is not to ignore them, jumps of joints are reported, too."""
        return self.tracker.joint_limits

    @joint_limits.setter
    def joint_limits(self, value: str) -> None:
        self.tracker.joint_limits = value
        self.states.motion = None if value == IGNORE else JointMotion(self.tracker.limits.joints)

    @property
    def check_motion(self) -> bool:
        """Whether the joints' motion is compared with the cables' natural frequencies."""
        return self._quasi_static is not None

    @check_motion.setter
    def check_motion(self, value: bool) -> None:
        lengths = {cable.name: cable.length for cable in self.scene.cables}
        self._quasi_static = QuasiStatic(lengths) if value else None

    def solve(self) -> None:
        """Solve at the last known joint positions."""
        self.equilibria = self.tracker.solve(self.states.joints())
        self.states.counters.solved += 1
        self.fresh = False

    def note(self, stamp: int) -> None:
        """Remember how it went, for the diagnostics; `stamp` of the joint state, ns."""
        if self._quasi_static is not None:
            self._quasi_static.take(stamp, self.equilibria)
        self.statuses = tuple(
            (one.status, bool(one.overlaps), worst_use(one)) for one in self.equilibria.values()
        )
        for name, equilibrium in self.equilibria.items():
            self.cables[name].note(equilibrium)

    def reset(self) -> None:
        """The next pose is solved from a cold start."""
        self.tracker.reset()
        self.fresh = True

    def solved_joints(self, stamp: int) -> bytes:
        """The joint values that were solved last, for the log."""
        return self._solved.fill(stamp, self.states.positions)

    def _trusted(self) -> list[tuple[CableOutputs, Equilibrium]]:
        return [(self.cables[name], e) for name, e in self.equilibria.items() if e.status.trusted]

    def send_loads(self, send: Send, stamp: int, load: Outlet, stiffness: Outlet) -> None:
        """Send the wrenches of every cable whose numbers are trusted, then, where all are, the joint load.

        The load's derivative costs more than the solve, and is sent only while somebody listens.
        """
        trusted = self._trusted()
        for cable, equilibrium in trusted:
            for outlet, data in cable.wrenches(stamp, equilibrium):
                send(outlet, data)
        if self._load and self._stiffness and len(trusted) == len(self.cables):
            joints = self.states.joints()
            torque = joint_torque(self.tracker, self.equilibria, joints)
            send(load, self._load.fill(stamp, self.states.positions, torque))
            if stiffness.wanted():
                derivative = joint_load(self.tracker, self.equilibria, joints).stiffness
                send(stiffness, self._stiffness.fill(stamp, derivative))

    def status(self, stamp: int) -> bytes:
        """Whether what was sent for the last solve can be trusted."""
        return self._status.fill(stamp, self.equilibria)

    def send_polylines(self, send: Send, stamp: int) -> None:
        """Send the polyline of every cable whose numbers are trusted."""
        for cable, equilibrium in self._trusted():
            send(*cable.path(stamp, equilibrium))

    def send_markers(self, send: Send, stamp: int, outlet: Outlet, force_scale: float) -> None:
        """Send the obstacles and every cable; one whose numbers are not trusted leaves the view."""
        self._prepare_markers()
        if self._obstacles is not None:
            kinematics, joints = self.tracker.kinematics, self.states.positions
            centre = kinematics.poses(joints)[0, 0, :3]
            send(outlet, self._obstacles.fill(stamp, kinematics.obstacle_poses(joints), centre))
        for name, equilibrium in self.equilibria.items():
            markers = self._markers[name]
            trusted = equilibrium.status.trusted
            send(outlet, markers.fill(stamp, equilibrium, force_scale) if trusted else markers.remove())
            if trusted and (contacts := markers.contacts(stamp, equilibrium, force_scale)):
                send(outlet, contacts)
            if trusted and (limits := markers.limits(stamp, equilibrium)):
                send(outlet, limits)

    def _prepare_markers(self) -> None:
        count = self.tracker.polyline_points
        for cable in self.scene.cables:
            markers = self._markers.get(cable.name)
            if markers is None or markers.count != count:
                self._markers[cable.name] = CableMarkers(cable, self.frames.world, count)

    def entries(self, prefix: str) -> list[DiagnosticStatus]:
        """The diagnostics of every cable."""
        left_out = self.tracker.left_out
        swings = self._quasi_static.report(time.monotonic(), self.equilibria) if self._quasi_static else {}
        out = []
        for name, cable in self.cables.items():
            also: dict[str, object] = dict(self.environment.of(name))
            if effects := left_out.get(name):
                also["effects left out"] = ", ".join(effects)
            warning = ""
            if swing := swings.get(name):
                also |= {"lowest natural frequency [Hz]": swing.frequency, "swing [m]": swing.amplitude}
                warning = swing.warning
            out.append(cable.status(prefix, self.hardware_id, also, warning))
        if self._quasi_static is not None:
            self._quasi_static.reported()
        return out

    def attachments(self, parameters: str) -> Mapping[str, str]:
        """What a log needs besides messages to be solved again."""
        texts = {"scene.yaml": self.scene.text, "parameters.yaml": parameters}
        if self.scene.robot is not None:
            texts["robot.urdf"] = self.scene.robot.urdf
        return texts

    def destroy(self, node: Node) -> None:
        """Withdraw the cables' topics."""
        self.environment.destroy(node)
        for cable in self.cables.values():
            cable.destroy(node)
