# SPDX-License-Identifier: Apache-2.0
"""Solves a logged run again and compares every wrench with the logged one."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from cable_ros.equilibrium import Equilibrium
from cable_ros.log.errors import LogError
from cable_ros.log.events import ENVIRONMENT, RESET, SET, START
from cable_ros.log.reader import PARAMETERS, URDF, LogReader
from cable_ros.log.run import CLAMPS, Event, Gap, LoggedRun, Solve
from cable_ros.scene import Scene, SceneError, load_scene
from cable_ros.scene.text import parse_yaml
from cable_ros.tracker import MOST_POINTS, Tracker

_SETTINGS: dict[str, tuple[Any, float, float]] = {
    "tolerance": ((int, float), 1e-12, 0.1),
    "polyline_points": (int, 2, MOST_POINTS),
}
"""What a log may say of a tracker: the type, the least and the largest."""


@dataclass
class Comparison:
    """The wrenches at one clamp of one cable, logged and solved again."""

    compared: int = 0
    identical: int = 0
    """How many are the same bit for bit."""
    unanswered: int = 0
    """Logged, but solved again without a trusted result; or the other way round."""
    force: float = 0.0
    moment: float = 0.0
    """Largest differences, N and N m."""
    force_scale: float = 0.0
    moment_scale: float = 0.0
    """Largest logged force and moment, N and N m."""
    worst_time: int = 0
    """Log time of the largest difference of force, ns."""

    def take(self, logged: np.ndarray | None, again: Equilibrium | None, clamp: str, time: int) -> None:
        """One pair; None or an untrusted result stands for no wrench."""
        wrench = None
        if again is not None and again.status.trusted:
            wrench = again.end_wrench if clamp == "end" else again.start_wrench
        if logged is None or wrench is None:
            self.unanswered += (logged is None) != (wrench is None)
            return
        self.compared += 1
        self.identical += logged.tobytes() == np.ascontiguousarray(wrench, dtype=float).tobytes()
        difference = np.abs(wrench - logged)
        force, moment = float(np.linalg.norm(difference[:3])), float(np.linalg.norm(difference[3:]))
        if force > self.force:
            self.worst_time = time
        self.force, self.moment = max(self.force, force), max(self.moment, moment)
        self.force_scale = max(self.force_scale, float(np.linalg.norm(logged[:3])))
        self.moment_scale = max(self.moment_scale, float(np.linalg.norm(logged[3:])))

    @property
    def relative(self) -> float:
        """Largest difference over the largest logged force or moment; inf where an answer is missing."""
        if self.unanswered:
            return np.inf
        return max(_ratio(self.force, self.force_scale), _ratio(self.moment, self.moment_scale))

    def within(self, tolerance: float) -> bool:
        """Whether the difference is at most `tolerance`; 0 asks for the same bits."""
        return self.relative <= tolerance and (tolerance > 0 or self.identical == self.compared)


@dataclass
class Outcome:
    """What came out of solving a run again."""

    solves: int = 0
    gaps: int = 0
    """Solves that the log lacks because they were dropped."""
    fresh: bool = True
    """Whether the log begins with a tracker that had not solved anything."""
    environments: int = 0
    """Logged changes of the environment that were left out."""
    comparisons: dict[tuple[str, str], Comparison] = field(default_factory=dict)
    """By cable and clamp."""

    @property
    def relative(self) -> float:
        """Largest relative difference of all."""
        return max((c.relative for c in self.comparisons.values()), default=0.0)

    def within(self, tolerance: float) -> bool:
        """Whether all differences are at most `tolerance`; 0 asks for the same bits."""
        return all(c.within(tolerance) for c in self.comparisons.values())


def logged_scene(log: LogReader) -> Scene:
    """The scene that a log holds, and nothing else: no file that it names is opened.

    Raises: LogError, SceneError.
    """
    source = f"{log.path}: scene"
    values = parse_yaml(log.scene_text, source)
    if not isinstance(values, dict):
        raise LogError(f"{source} is no mapping with the fields of a scene; name a scene with --with.")
    if log.urdf_text is None and "robot" in values:
        raise LogError(
            f"{source} names a URDF, and the log holds none (attachment '{URDF}'); name a scene with --with."
        )
    return load_scene(values, urdf=log.urdf_text, meshes=False)


def logged_tolerance(log: LogReader, default: float = 1e-4) -> float:
    """The tolerance among the logged parameters. Raises LogError where they are damaged."""
    text = log.attachments.get(PARAMETERS, "")
    if not text.strip():
        return default
    try:
        nodes = parse_yaml(text, f"{log.path}: {PARAMETERS}")
    except SceneError as error:
        raise LogError(f"{error}; the log is damaged.") from None
    for node in nodes.values() if isinstance(nodes, dict) else ():
        parameters = node.get("ros__parameters") if isinstance(node, dict) else None
        value = parameters.get("tolerance") if isinstance(parameters, dict) else None
        if isinstance(value, float | int) and not isinstance(value, bool):
            try:
                return float(_checked("tolerance", value))
            except ValueError as error:
                raise LogError(f"{log.path}: {PARAMETERS}: {error}; the log is damaged.") from None
    return default


def _checked(name: str, value: Any) -> Any:
    """A logged setting that a tracker takes. Raises ValueError for any other."""
    kind, low, high = _SETTINGS[name]
    if isinstance(value, kind) and not isinstance(value, bool) and low <= value <= high:
        return value
    raise ValueError(f"its {name} is not a number from {low:g} to {high:g}")


def resolve(
    run: LoggedRun, tracker: Tracker, outcome: Outcome, own_environment: bool = False
) -> Iterator[tuple[Solve, dict[str, Equilibrium]]]:
    """Feed `run` to `tracker`; yields every solve with its new equilibria, and keeps count in `outcome`.

    `own_environment`: the temperatures of the tracker's scene hold, not those of the log.
    """
    for item in run:
        if isinstance(item, Event):
            try:
                _apply(item, tracker, outcome, own_environment)
            except (TypeError, ValueError, OverflowError) as error:
                what = f"{run.name}: the event '{item.kind}' cannot be repeated ({error})"
                raise LogError(f"{what}; the log is damaged.") from None
        elif isinstance(item, Gap):
            outcome.gaps += item.count
        elif all(name in item.joints for name in tracker.joint_names):
            # A received joint state without one of the joints was not solved.
            equilibria = tracker.solve(item.joints)
            outcome.solves += 1
            for cable, clamp in {*item.wrenches, *((name, clamp) for name in equilibria for clamp in CLAMPS)}:
                comparison = outcome.comparisons.setdefault((cable, clamp), Comparison())
                comparison.take(
                    item.wrenches.get((cable, clamp)), equilibria.get(cable), clamp, item.log_time
                )
            yield item, equilibria


def _apply(event: Event, tracker: Tracker, outcome: Outcome, own_environment: bool) -> None:
    if "environment" in event.values and event.kind in (START, ENVIRONMENT):
        if own_environment:
            outcome.environments += 1
        elif isinstance(environment := event.values["environment"], dict):
            tracker.set_environment(environment)
        else:
            raise ValueError("its environment is no mapping")
    if event.kind == RESET:
        tracker.reset()
    elif event.kind in (START, SET):
        outcome.fresh &= bool(event.values.get("fresh", True))
        if isinstance(lost := event.values.get("lost"), dict):
            tracker.distrust({str(cable): str(text) for cable, text in lost.items()})
        for name in _SETTINGS:
            if name in event.values:
                setattr(tracker, name, _checked(name, event.values[name]))
        # What was refused then must be refused again: it did not move the cable.
        if "joint_limits" in event.values:
            tracker.joint_limits = str(event.values["joint_limits"])


def _ratio(difference: float, scale: float) -> float:
    return difference / scale if scale else (np.inf if difference else 0.0)
