# SPDX-License-Identifier: Apache-2.0
"""`cable_node`: joint states in; end wrenches, joint load, polylines, markers, diagnostics and a log out."""

from __future__ import annotations

import gc
import sys
import time
from collections.abc import Sequence
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.clock import Clock, ClockType, JumpThreshold, TimeJump
from rclpy.duration import Duration
from rclpy.logging import get_logging_directory
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory
from visualization_msgs.msg import MarkerArray

from cable_ros.log import events
from cable_ros.ros import parameters
from cable_ros.ros.cable_outputs import LATCHED, STREAM
from cable_ros.ros.cdr_template import serialise
from cable_ros.ros.frame_names import Frames, root_frame
from cable_ros.ros.frames import tf_static, tf_static_outlet
from cable_ros.ros.health import Health
from cable_ros.ros.inlet import Inlet, Message
from cable_ros.ros.lifetime import Lifetime, tell_last
from cable_ros.ros.live_scene import LiveScene
from cable_ros.ros.messages import diagnostics
from cable_ros.ros.outbox import Outbox
from cable_ros.ros.parameters import ParameterError
from cable_ros.ros.preparation import Preparation, leave
from cable_ros.ros.recorder import Outlet, log_path, type_name
from cable_ros.ros.throttle import Throttle
from cable_ros.scene.errors import SceneError
from cable_ros.scene.load import load_scene
from cable_ros.tracker import Tracker

# As everywhere in ROS, other names are given by remapping.
JOINT_STATES = "joint_states"
ROBOT_DESCRIPTION = "robot_description"
# Best effort: a lost state is not sent again, a newer one is better. The queue is emptied at every turn.
_JOINT_STATES = QoSProfile(depth=16, reliability=ReliabilityPolicy.BEST_EFFORT)
_CATCH_UP = 4e-3  # s; a backlog that takes longer than this to answer is skipped but for the newest
_LATCHED_INPUT = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
_DIAGNOSTICS = QoSProfile(depth=10)
_MARKERS = QoSProfile(depth=50)
_REPORT_SPACING = 0.05  # s, least time between reports that a change of status sets off


class CableNode(Node):
    """Tracks the cables of a scene while its robot moves.

    Raises:
        ParameterError: a parameter can't be used.
        SceneError: the scene can't.
    """

    def __init__(self) -> None:
        super().__init__("cable_node")
        try:
            self._set_up()
        except (ParameterError, SceneError) as error:
            tell_last(self, str(error))
            raise

    def _set_up(self) -> None:
        parameters.declare(self)
        for sentence in parameters.unknown(self):
            self.get_logger().warning(sentence)
        self._scene_path = parameters.scene_file(self._value("scene"))
        self._health = Health(self.get_fully_qualified_name(), str(self._scene_path))
        self._out = Outbox(self)
        self._live: LiveScene | None = None
        self._urdf: str | None = None
        self._robot: Subscription | None = None
        self._waiting = ""
        self._preparation: Preparation | None = None
        self._log_is_due = False
        self._inlet: Inlet | None = None
        self._throttle = Throttle()
        self._next = {"polylines": 0.0, "markers": 0.0}
        self._reported: tuple[Any, ...] = ()
        self._report_time = 0.0
        self._answer_time = 1e-4  # s, running mean

        topic = self.resolve_topic_name(JOINT_STATES)
        self._joint_states = Outlet(topic, type_name(JointState), _JOINT_STATES, None, exact=False)
        self._diagnostics = Outlet.create(self, DiagnosticArray, "/diagnostics", _DIAGNOSTICS)
        self._joint_load = Outlet.create(self, JointState, "~/joint_load", STREAM)
        self._joint_stiffness = Outlet.create(self, JointTrajectory, "~/joint_stiffness", STREAM)
        self._status = Outlet.create(self, DiagnosticArray, "~/status", STREAM)
        self._markers = Outlet.create(self, MarkerArray, "~/markers", _MARKERS)
        solved_joints = self.resolve_topic_name(f"~/{events.SOLVED_JOINTS}")
        self._solved_joints = Outlet(solved_joints, type_name(JointState), STREAM, None)
        self._scene_text = Outlet.create(self, String, "~/scene", LATCHED)
        self._tf_static = tf_static_outlet(self)
        self._load()

        self.create_service(Trigger, "~/reset", self._on_reset)
        self.create_service(Trigger, "~/start_log", self._on_start_log)
        self.create_service(Trigger, "~/stop_log", self._on_stop_log)
        alone = MutuallyExclusiveCallbackGroup()  # it takes its time; others are called meanwhile
        self.create_service(Trigger, "~/reload_scene", self._on_reload_scene, callback_group=alone)
        # Steady time: reports go on while simulated time stands still.
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(1 / self._value("diagnostics_rate"), self._on_timer, clock=steady)
        backwards = JumpThreshold(
            min_forward=None, min_backward=Duration(nanoseconds=-1), on_clock_change=False
        )
        self._jump = self.get_clock().create_jump_callback(backwards, post_callback=self._on_time_jump)
        self.add_on_set_parameters_callback(parameters.validate)
        self.add_post_set_parameters_callback(self._on_parameters)

    def _value(self, name: str) -> Any:
        return self.get_parameter(name).value

    def _now(self) -> int:
        return self.get_clock().now().nanoseconds

    # -- the scene ---------------------------------------------------------------------------------------

    def _load(self) -> bool:
        """Load the scene and get its code, for `_track`; False where it waits for its robot."""
        path = self._scene_path
        try:
            scene = load_scene(path, urdf=self._urdf)
        except SceneError as error:
            if self._urdf is not None or "robot_description" not in str(error):
                raise
            self._wait_for_robot()
            return False
        tracker = Tracker(scene, self._value("tolerance"), self._value("polyline_points"))
        self._waiting = "Compiling the solver; joint states are taken after that."
        self.get_logger().info(self._waiting)
        self._health.refused = False
        self._preparation = Preparation(self, tracker, self._track)
        return True

    def _track(self, tracker: Tracker, seconds: float) -> None:
        """Go on with this tracker, whose code is there."""
        self._preparation = None
        path, scene = self._scene_path, tracker.scene
        tracker.tolerance = self._value("tolerance")
        tracker.polyline_points = self._value("polyline_points")
        old, self._live = self._live, None
        if old is not None:
            old.destroy(self)
        frames = Frames(self._value("frame_prefix"), self._value("world_frame") or root_frame(scene.robot))
        live = LiveScene(
            self, scene, tracker, self._joint_states.topic, frames, self._health.hardware_id, self._note
        )
        if old is not None:
            live.states.carry_on(old.states)
        live.joint_limits = self._value("joint_limits")
        live.check_motion = self._value("check_motion")
        # What was made so far lives as long as the scene: the collector need not look at it again.
        gc.unfreeze()
        gc.collect()
        gc.freeze()
        self._live = live
        names, joints = ", ".join(live.cables), ", ".join(tracker.joint_names) or "none"
        self.get_logger().info(
            f"Ready after {seconds:.1f} s: {path} with the cables {names}; joints: {joints}."
        )
        for note in scene.notes:
            self.get_logger().info(note)
        if tracker.robot_overlaps.unknown:
            self.get_logger().warning(tracker.robot_overlaps.unknown)
        logging = self._out.recorder.on
        if logging:  # a log holds one scene
            self._out.stop_log()
        self._out.latch(self._scene_text, serialise(String(data=scene.text)))
        self._out.latch(self._tf_static, tf_static([t for c in live.cables.values() for t in c.transforms()]))
        self._out.flush()
        if logging or self._log_is_due:
            self._log_is_due = False
            self._start_log()
        if self._inlet is None:
            self._inlet = Inlet(self, JOINT_STATES, _JOINT_STATES, self._on_joint_states)

    def _wait_for_robot(self) -> None:
        topic = self.resolve_topic_name(ROBOT_DESCRIPTION)
        self._waiting = f"{self._scene_path} names no robot; waiting for its URDF on '{topic}'."
        self.get_logger().info(self._waiting)
        if self._robot is None:
            take = self._on_robot_description
            self._robot = self.create_subscription(String, ROBOT_DESCRIPTION, take, _LATCHED_INPUT)

    def _on_robot_description(self, message: String) -> None:
        if self._live is not None or self._preparation is not None:
            self._urdf = message.data
            self.get_logger().warning("A new robot description came; call ~/reload_scene to use it.")
            return
        self._urdf = message.data
        try:
            self._load()
        except SceneError as error:
            self._waiting = str(error)
            self._health.refused = True
            self.get_logger().error(self._waiting)

    # -- joint states in, messages out -------------------------------------------------------------------

    def _on_joint_states(self, batch: list[Message]) -> None:
        """Answer all states that have come, or the newest alone where all would take too long."""
        live = self._live
        if live is None:
            return
        first = max(0, len(batch) - max(1, int(_CATCH_UP / self._answer_time)))
        for index, (data, info) in enumerate(batch):
            begin = time.perf_counter()
            self._on_one_state(live, data, info, skip=index < first)
            self._answer_time += 0.1 * (time.perf_counter() - begin - self._answer_time)

    def _on_one_state(self, live: LiveScene, data: bytes, info: dict[str, Any], skip: bool) -> None:
        arrival = self._now()
        self._health.heard()
        states = live.states
        usable = states.take(data, info.get("publication_sequence_number"))
        self._out.send(self._joint_states, data)
        if states.fault:
            self._note(states.fault)
        if usable and not states.stamp:
            self.get_logger().warning(
                f"Joint states on '{states.topic}' have no stamp; the node's time is used.", once=True
            )
        stamp = states.stamp or arrival
        if usable and not states.missing():
            if skip:
                states.counters.skipped += 1
            else:
                self._solve(live, stamp)
        self._report_changes(live)
        self._out.flush(arrival, max(stamp, 0))  # a log's times have no sign

    def _solve(self, live: LiveScene, stamp: int) -> None:
        if changed := live.environment.apply():
            self._out.event(events.ENVIRONMENT, environment=changed)
        live.solve()
        if live.tracker.outside:
            self._note(live.tracker.outside)
        self._out.send(self._solved_joints, live.solved_joints(stamp))
        live.send_loads(self._out.send, stamp, self._joint_load, self._joint_stiffness)
        self._out.send(self._status, live.status(stamp))
        live.note(stamp)
        if self._is_time_for("polylines", self._value("polyline_rate")):
            live.send_polylines(self._out.send, stamp)
        if self._markers.wanted() and self._is_time_for("markers", self._value("marker_rate")):
            live.send_markers(self._out.send, stamp, self._markers, self._value("marker_force_scale"))
        for name, equilibrium in live.equilibria.items():
            if not equilibrium.status.trusted:
                text = f"{name}: {equilibrium.message} Nothing is published for it."
                if self._throttle.passes(text):
                    self.get_logger().error(text)
            elif equilibrium.overlaps and self._throttle.passes(f"{name}: {equilibrium.message}"):
                self.get_logger().warning(f"{name}: {equilibrium.message}")

    def _is_time_for(self, what: str, rate: float) -> bool:
        """Whether the next one is due at this rate, Hz; 0: always."""
        if not rate:
            return True
        now = time.monotonic()
        if now < self._next[what]:
            return False
        # In step with the rate where we keep up with it, from now on where we don't.
        self._next[what] = max(self._next[what] + 1 / rate, now)
        return True

    # -- diagnostics -------------------------------------------------------------------------------------

    def _on_timer(self) -> None:
        live = self._live
        if live is not None and not live.states.needed:
            self._solve(live, self._now())
        self._report()
        self._out.flush()

    def _report_changes(self, live: LiveScene) -> None:
        """Report at once where something changed; the timer reports the rest."""
        states, log_problem = live.states, self._out.recorder.problem
        state = (live.statuses, bool(states.fault), log_problem, bool(states.missing()))
        if state != self._reported and time.monotonic() - self._report_time > _REPORT_SPACING:
            self._reported = state
            self._report()

    def _report(self) -> None:
        live = self._live
        publishers = self.count_publishers(self._joint_states.topic)
        entries = [
            self._health.joint_states(live.states if live else None, self._waiting, publishers),
            self._health.log(self._out.recorder),
        ]
        if live is not None:
            entries += live.entries(self._health.name)
        self._out.send(self._diagnostics, serialise(diagnostics(self._now(), entries)))
        self._report_time = time.monotonic()

    def _on_time_jump(self, jump: TimeJump) -> None:
        text = (
            f"The clock went back by {-jump.delta.nanoseconds * 1e-9:.6g} s; nothing is reset, the cables go "
            "on from where they are. Call ~/reset if this is the start of a new run."
        )
        self._note(text)

    def _note(self, sentence: str) -> None:
        """Tell what is wrong: in the next diagnostics, and now and then in the console."""
        self._health.note(sentence)
        if self._throttle.passes(sentence):
            self.get_logger().warning(sentence)

    # -- the log -----------------------------------------------------------------------------------------

    def _outlets(self) -> list[Outlet]:
        """Every topic that a log may hold."""
        own = [self._joint_states, self._solved_joints, self._diagnostics]
        own += [self._joint_load, self._joint_stiffness, self._status, self._markers]
        cables = self._live.cables.values() if self._live else ()
        return [*own, *(outlet for cable in cables for outlet in cable.outlets)]

    def _start_log(self) -> None:
        path = log_path(self._value("log.path"), self._health.name, str(get_logging_directory()))
        settings = {name: self._value(f"log.{name}") for name in ("max_size", "max_duration", "queue_size")}
        texts = self._live.attachments(parameters.as_text(self)) if self._live else {}
        if self._out.start_log(path, settings, texts, self._outlets()) and (live := self._live):
            tracker = live.tracker
            used: dict[str, Any] = {
                "tolerance": tracker.tolerance,
                "polyline_points": tracker.polyline_points,
                "joint_limits": tracker.joint_limits,
            }
            if environment := live.environment.values:
                used["environment"] = environment
            if lost := tracker.lost:
                used["lost"] = lost
            self._out.event(events.START, fresh=live.fresh, **used)

    # -- parameters and services -------------------------------------------------------------------------

    def _on_parameters(self, changed: Sequence[Parameter]) -> None:
        for parameter in changed:
            if parameter.name in ("tolerance", "polyline_points", "joint_limits") and self._live:
                limits = parameter.name == "joint_limits"
                setattr(self._live if limits else self._live.tracker, parameter.name, parameter.value)
                self._out.event(events.SET, **{parameter.name: parameter.value})
            elif parameter.name == "check_motion" and self._live:
                self._live.check_motion = parameter.value
            elif parameter.name == "log.enabled":
                if not parameter.value:
                    self._log_is_due = False
                    self._out.stop_log()
                elif not self._out.recorder.on:
                    self._log_is_due = False
                    self._start_log()

    def _on_reset(self, _: Trigger.Request, answer: Trigger.Response) -> Trigger.Response:
        if self._live:
            self._live.reset()
            self._out.event(events.RESET)
        answer.success, answer.message = True, "The next joint state is solved from a cold start."
        return answer

    def _on_start_log(self, _: Trigger.Request, answer: Trigger.Response) -> Trigger.Response:
        running = self._out.recorder.on
        self.set_parameters([Parameter("log.enabled", value=True)])
        writer, problem = self._out.recorder.writer, self._out.recorder.problem
        answer.success = not problem and writer is not None
        words = "Already writing" if running else "Writing"
        answer.message = f"{words} {writer.path}." if answer.success and writer else problem
        return answer

    def _on_stop_log(self, _: Trigger.Request, answer: Trigger.Response) -> Trigger.Response:
        writer = self._out.recorder.writer
        self.set_parameters([Parameter("log.enabled", value=False)])
        answer.success = True
        answer.message = "There was no log to stop."
        if writer is not None:
            answer.success = writer.error is None
            answer.message = writer.error or f"{writer.path} is complete."
        return answer

    async def _on_reload_scene(self, _: Trigger.Request, answer: Trigger.Response) -> Trigger.Response:
        if self._preparation is not None:
            answer.success, answer.message = False, "The scene is being loaded already; wait for 'Ready'."
            return answer
        try:
            answer.success = self._load()
            if self._preparation is not None:
                await self._preparation.finished
            answer.message = f"{self._scene_path} is loaded." if answer.success else self._waiting
        except SceneError as error:
            answer.success, answer.message = False, f"{error}; the old scene stays."
        return answer

    def open(self) -> None:
        """Begin the log, where one is asked for; a scene that is being compiled begins it."""
        if self._preparation is not None:
            self._log_is_due = bool(self._value("log.enabled"))
        elif self._value("log.enabled"):
            self._start_log()

    def close(self) -> None:
        """Complete the log."""
        self._out.stop_log()


def main(args: Sequence[str] | None = None) -> int:
    """Run the node until SIGINT or SIGTERM.

    Returns:
        0 after a clean stop; 2 where it could not start, with the reason in one sentence on stderr, and on
        /rosout.
    """
    try:
        with Lifetime() as lifetime:
            rclpy.init(args=list(args) if args is not None else None)
            node = CableNode()
            lifetime.started(node, node.close)
            node.open()
            rclpy.spin(node)
    except (ParameterError, SceneError):  # told
        return 2
    return leave(0)


if __name__ == "__main__":
    sys.exit(main())
