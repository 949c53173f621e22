# SPDX-License-Identifier: Apache-2.0
"""What the node publishes about one cable."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import TransformStamped, WrenchStamped
from nav_msgs.msg import Path
from rclpy.qos import DurabilityPolicy, QoSProfile

from cable_ros.equilibrium import Equilibrium, Status
from cable_ros.limits import OK
from cable_ros.ros.frame_names import Frames
from cable_ros.ros.limits_message import LEVELS, LimitsMessage
from cable_ros.ros.messages import PathMessage, WrenchMessage, clamp_transform, diagnostic
from cable_ros.ros.recorder import Outlet
from cable_ros.scene.model import Cable

if TYPE_CHECKING:
    from rclpy.node import Node

# Reliable suits subscribers of either kind; a slow one loses all but the newest.
STREAM = QoSProfile(depth=5)
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)

_LEVELS = {
    Status.CONVERGED: DiagnosticStatus.OK,
    Status.SNAPPED: DiagnosticStatus.WARN,
    Status.UNFINISHED: DiagnosticStatus.WARN,
}


def level(equilibrium: Equilibrium) -> bytes:
    """Diagnostic level of a result."""
    found: bytes = _LEVELS.get(equilibrium.status, DiagnosticStatus.ERROR)
    # cables that overlap have converged, but to what no real cable does
    return max(found, DiagnosticStatus.WARN) if equilibrium.overlaps else found


def worst_use(equilibrium: Equilibrium) -> int:
    """The worst level of its extremes, see `limits.Extreme.level`."""
    return max((extreme.level for extreme in equilibrium.extremes), default=OK)


class CableOutputs:
    """Topics and messages of one cable: wrenches at ends and supports, polyline, limits, diagnostics."""

    def __init__(
        self, node: Node, cable: Cable, frames: Frames, polyline_points: int, hardware_id: str = ""
    ) -> None:
        self.cable = cable
        self._frames = frames
        base = f"~/{cable.name}"
        self.end_frame, self.start_frame = (frames.of(f"{cable.name}_{clamp}") for clamp in ("end", "start"))
        self.end_wrench = Outlet.create(node, WrenchStamped, f"{base}/end_wrench", STREAM)
        self.start_wrench = Outlet.create(node, WrenchStamped, f"{base}/start_wrench", STREAM)
        self._supports = {
            support: (
                Outlet.create(node, WrenchStamped, f"{base}/{support}_wrench", STREAM),
                WrenchMessage(frames.of(f"{cable.name}_{support}")),
            )
            for support in (clip.name for clip in cable.supports)
        }
        self.polyline = Outlet.create(node, Path, f"{base}/polyline", LATCHED)
        self.limits: Outlet | None = None
        if cable.limits is not None:
            self.limits = Outlet.create(node, DiagnosticArray, f"{base}/limits", STREAM)
        self._limits_message = LimitsMessage(cable.name, hardware_id)
        self._end_message = WrenchMessage(self.end_frame)
        self._start_message = WrenchMessage(self.start_frame)
        self._path_message = PathMessage(frames.world, polyline_points)
        self.worst: Equilibrium | None = None
        """The result of the highest diagnostic level since the last diagnostics."""
        self._worst_severity: bytes = DiagnosticStatus.OK
        self._last: Equilibrium | None = None

    @property
    def outlets(self) -> tuple[Outlet, ...]:
        """All topics of this cable."""
        supports = (outlet for outlet, _ in self._supports.values())
        always = self.end_wrench, self.start_wrench, *supports, self.polyline
        return always if self.limits is None else (*always, self.limits)

    def note(self, equilibrium: Equilibrium) -> None:
        """Remember a result for the diagnostics; the worst one is reported, otherwise the last."""
        severity = _severity(equilibrium)
        if self.worst is None or severity >= self._worst_severity:
            self.worst, self._worst_severity = equilibrium, severity

    def wrenches(self, stamp: int, equilibrium: Equilibrium) -> Iterator[tuple[Outlet, bytes]]:
        """The messages of all wrenches and of limits: the first can go out before the next is made."""
        yield self.end_wrench, self._end_message.fill(stamp, equilibrium.end_wrench)
        yield self.start_wrench, self._start_message.fill(stamp, equilibrium.start_wrench)
        held = equilibrium.support_wrenches if self._supports else {}
        for name, (outlet, message) in self._supports.items():
            yield outlet, message.fill(stamp, held[name])
        if self.limits is not None:
            yield self.limits, self._limits_message.fill(stamp, equilibrium.extremes)

    def path(self, stamp: int, equilibrium: Equilibrium) -> tuple[Outlet, bytes]:
        """The message of the polyline."""
        if len(equilibrium.points) != self._path_message.count:
            self._path_message = PathMessage(self._frames.world, len(equilibrium.points))
        return self.polyline, self._path_message.fill(stamp, equilibrium.points, equilibrium.orientations)

    def transforms(self) -> list[TransformStamped]:
        """The frames of all that holds the cable, in their links."""
        held = [(self.start_frame, self.cable.start), (self.end_frame, self.cable.end)]
        held += [
            (self._frames.of(f"{self.cable.name}_{clip.name}"), clip.mount) for clip in self.cable.supports
        ]
        return [
            clamp_transform(frame, self._frames.of(mount.link) if mount.link else self._frames.world, mount)
            for frame, mount in held
        ]

    def status(
        self, prefix: str, hardware_id: str, also: Mapping[str, object], warning: str = ""
    ) -> DiagnosticStatus:
        """The diagnostics entry, about the worst result since the last one, with further values `also`.

        `warning`: a sentence that makes it a WARN at least; may be empty.
        A cable that nobody asks about is as well as it was.
        """
        name = f"{prefix}: {self.cable.name}"
        equilibrium, since = self.worst or self._last, "" if self.worst else " Nothing solved since."
        self.worst, self._last = None, equilibrium
        if equilibrium is None:
            return diagnostic(name, DiagnosticStatus.STALE, "Nothing solved yet.", {}, hardware_id)
        overlaps = [
            f"{one.other} at {one.distance:.6g} m, {one.contact_distance:.6g} m to touch"
            for one in equilibrium.overlaps
        ]
        sentences = [equilibrium.message, *(one.sentence for one in equilibrium.extremes if one.level > OK)]
        sentences += [warning] if warning else []
        severity = max(_severity(equilibrium), DiagnosticStatus.WARN if warning else DiagnosticStatus.OK)
        values = {
            "status": equilibrium.status.name,
            "solve time [us]": equilibrium.solve_time * 1e6,
            "iterations": equilibrium.iterations,
            "error estimate": equilibrium.error_estimate,
            "stability margin": equilibrium.stability_margin,
            "total twist [rad]": equilibrium.total_twist,
            "energy [J]": equilibrium.energy,
            **({"overlaps": "; ".join(overlaps)} if overlaps else {}),
            **_extremes(equilibrium),
            **also,
        }
        return diagnostic(name, severity, f"{' '.join(sentences)}{since}", values, hardware_id)

    def destroy(self, node: Node) -> None:
        """Withdraw the topics."""
        for outlet in self.outlets:
            if outlet.publisher is not None:
                node.destroy_publisher(outlet.publisher)


def _severity(equilibrium: Equilibrium) -> bytes:
    """The worse of the levels of the result and of its extremes."""
    return max(level(equilibrium), LEVELS[worst_use(equilibrium)])


def _extremes(equilibrium: Equilibrium) -> dict[str, object]:
    """Value and place of each extreme, by a name with its unit."""
    out: dict[str, object] = {}
    for one in equilibrium.extremes:
        out[f"{one.quantity.words} [{one.quantity.unit}]"] = one.value
        out[f"{one.quantity.words} at [m]"] = one.arc_length
    return out
