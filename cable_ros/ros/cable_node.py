# SPDX-License-Identifier: Apache-2.0
"""`cable_node`: joint states in; end wrenches, joint load, polylines, markers, diagnostics and a log out."""

from __future__ import annotations

import gc
import sys
import time
from collections.abc import Sequence
from typing import Any

import rclpy
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.clock import Clock, ClockType, JumpThreshold, TimeJump
from rclpy.duration import Duration
from rclpy.logging import get_logging_directory
from rclpy.node import Node
from rclpy.parameter import Parameter
from std_msgs.msg import String
from std_srvs.srv import Trigger

from cable_ros.log import events
from cable_ros.ros import parameters
from cable_ros.ros.cdr_template import serialise
from cable_ros.ros.frame_names import Frames, root_frame
from cable_ros.ros.frames import tf_static
from cable_ros.ros.health import Health
from cable_ros.ros.inlet import Inlet, Message
from cable_ros.ros.lifetime import Lifetime, tell_last
from cable_ros.ros.live_scene import LiveScene
from cable_ros.ros.messages import diagnostics
from cable_ros.ros.node_outlets import JOINT_STATES, JOINT_STATES_QOS, NodeOutlets
from cable_ros.ros.outbox import Outbox
from cable_ros.ros.parameters import ParameterError
from cable_ros.ros.preparation import leave
from cable_ros.ros.recorder import log_path
from cable_ros.ros.scene_source import SceneSource
from cable_ros.ros.throttle import Throttle
from cable_ros.scene.errors import SceneError
from cable_ros.tracker import Tracker

_CATCH_UP = 4e-3  # s; a backlog that takes longer than this to answer is skipped but for the newest
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
        self._source = SceneSource(self, parameters.scene_file(self._value("scene")), self._track)
        self._health = Health(self.get_fully_qualified_name(), str(self._source.path))
        self._out = Outbox(self)
        self._live: LiveScene | None = None
        self._log_is_due = False
        self._inlet: Inlet | None = None
        self._throttle = Throttle()
        self._next = {"polylines": 0.0, "markers": 0.0}
        self._reported: tuple[Any, ...] = ()
        self._report_time = 0.0
        self._answer_time = 1e-4  # s, running mean
        self._outlets = NodeOutlets.create(self)
        self._source.load()

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

    def _track(self, tracker: Tracker, seconds: float) -> None:
        """Go on with this tracker, whose code is there."""
        scene = tracker.scene
        tracker.tolerance = self._value("tolerance")
        tracker.polyline_points = self._value("polyline_points")
        old, self._live = self._live, None
        if old is not None:
            old.destroy(self)
        frames = Frames(self._value("frame_prefix"), self._value("world_frame") or root_frame(scene.robot))
        topic = self._outlets.joint_states.topic
        live = LiveScene(self, scene, tracker, topic, frames, self._health.hardware_id, self._note)
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
            f"Ready after {seconds:.1f} s: {self._source.path} with the cables {names}; joints: {joints}."
        )
        for note in scene.notes:
            self.get_logger().info(note)
        if tracker.robot_overlaps.unknown:
            self.get_logger().warning(tracker.robot_overlaps.unknown)
        logging = self._out.recorder.on
        if logging:  # a log holds one scene
            self._out.stop_log()
        self._out.latch(self._outlets.scene, serialise(String(data=scene.text)))
        transforms = [one for cable in live.cables.values() for one in cable.transforms()]
        self._out.latch(self._outlets.tf_static, tf_static(transforms))
        self._out.flush()
        if logging or self._log_is_due:
            self._log_is_due = False
            self._start_log()
        if self._inlet is None:
            self._inlet = Inlet(self, JOINT_STATES, JOINT_STATES_QOS, self._on_joint_states)

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
        self._out.send(self._outlets.joint_states, data)
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
        outlets = self._outlets
        if changed := live.environment.apply():
            self._out.event(events.ENVIRONMENT, environment=changed)
        live.solve()
        if live.tracker.outside:
            self._note(live.tracker.outside)
        self._out.send(outlets.solved_joints, live.solved_joints(stamp))
        live.send_loads(self._out.send, stamp, outlets.joint_load, outlets.joint_stiffness)
        self._out.send(outlets.status, live.status(stamp))
        live.note(stamp)
        if self._is_time_for("polylines", self._value("polyline_rate")):
            live.send_polylines(self._out.send, stamp)
        if outlets.markers.wanted() and self._is_time_for("markers", self._value("marker_rate")):
            live.send_markers(self._out.send, stamp, outlets.markers, self._value("marker_force_scale"))
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
        states, source = live.states if live else None, self._source
        publishers = self.count_publishers(self._outlets.joint_states.topic)
        entries = [
            self._health.joint_states(states, source.waiting, source.refused, publishers),
            self._health.log(self._out.recorder),
        ]
        if live is not None:
            entries += live.entries(self._health.name)
        self._out.send(self._outlets.diagnostics, serialise(diagnostics(self._now(), entries)))
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

    def _start_log(self) -> None:
        path = log_path(self._value("log.path"), self._health.name, str(get_logging_directory()))
        settings = {name: self._value(f"log.{name}") for name in ("max_size", "max_duration", "queue_size")}
        texts = self._live.attachments(parameters.as_text(self)) if self._live else {}
        cables = self._live.cables.values() if self._live else ()
        outlets = [*self._outlets.streams, *(outlet for cable in cables for outlet in cable.outlets)]
        if self._out.start_log(path, settings, texts, outlets) and (live := self._live):
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
        if self._source.loading is not None:
            answer.success, answer.message = False, "The scene is being loaded already; wait for 'Ready'."
            return answer
        try:
            answer.success = self._source.load()
            if (loading := self._source.loading) is not None:
                await loading
            path, waiting = self._source.path, self._source.waiting
            answer.message = f"{path} is loaded." if answer.success else waiting
        except SceneError as error:
            answer.success, answer.message = False, f"{error}; the old scene stays."
        return answer

    def open(self) -> None:
        """Begin the log, where one is asked for; a scene that is being compiled begins it."""
        if self._source.loading is not None:
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
    except (ParameterError, SceneError):  # reported already
        return 2
    return leave(0)


if __name__ == "__main__":
    sys.exit(main())
