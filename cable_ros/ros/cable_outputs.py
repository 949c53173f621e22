# SPDX-License-Identifier: Apache-2.0
"""What the node publishes about one cable."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import TransformStamped, WrenchStamped
from nav_msgs.msg import Path
from rclpy.qos import DurabilityPolicy, QoSProfile

from cable_ros.equilibrium import Equilibrium, Status
from cable_ros.ros.frame_names import Frames
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


class CableOutputs:
    """Topics and messages of one cable: both wrenches, polyline, diagnostics."""

    def __init__(self, node: Node, cable: Cable, frames: Frames, polyline_points: int) -> None:
        self.cable = cable
        self._frames = frames
        base = f"~/{cable.name}"
        self.end_frame, self.start_frame = (frames.of(f"{cable.name}_{clamp}") for clamp in ("end", "start"))
        self.end_wrench = Outlet.create(node, WrenchStamped, f"{base}/end_wrench", STREAM)
        self.start_wrench = Outlet.create(node, WrenchStamped, f"{base}/start_wrench", STREAM)
        self.polyline = Outlet.create(node, Path, f"{base}/polyline", LATCHED)
        self._end_message = WrenchMessage(self.end_frame)
        self._start_message = WrenchMessage(self.start_frame)
        self._path_message = PathMessage(frames.world, polyline_points)
        self.worst: Equilibrium | None = None
        """The result of the highest diagnostic level since the last diagnostics."""
        self._told: Equilibrium | None = None

    @property
    def outlets(self) -> tuple[Outlet, ...]:
        """All topics of this cable."""
        return self.end_wrench, self.start_wrench, self.polyline

    def note(self, equilibrium: Equilibrium) -> None:
        """Remember a result for the diagnostics; the worst one is told, later ones otherwise."""
        if self.worst is None or level(equilibrium) >= level(self.worst):
            self.worst = equilibrium

    def wrenches(self, stamp: int, equilibrium: Equilibrium) -> Iterator[tuple[Outlet, bytes]]:
        """The messages of both wrenches, one by one: the first can go out before the second is made."""
        yield self.end_wrench, self._end_message.fill(stamp, equilibrium.end_wrench)
        yield self.start_wrench, self._start_message.fill(stamp, equilibrium.start_wrench)

    def path(self, stamp: int, equilibrium: Equilibrium) -> tuple[Outlet, bytes]:
        """The message of the polyline."""
        if len(equilibrium.points) != self._path_message.count:
            self._path_message = PathMessage(self._frames.world, len(equilibrium.points))
        return self.polyline, self._path_message.fill(stamp, equilibrium.points, equilibrium.orientations)

    def transforms(self) -> list[TransformStamped]:
        """The frames of both clamps in their links."""
        return [
            clamp_transform(frame, self._frames.of(mount.link) if mount.link else self._frames.world, mount)
            for frame, mount in ((self.start_frame, self.cable.start), (self.end_frame, self.cable.end))
        ]

    def status(self, prefix: str, hardware_id: str, also: Mapping[str, object]) -> DiagnosticStatus:
        """The diagnostics entry, about the worst result since the last one, with further values `also`.

        A cable that nobody asks about is as well as it was.
        """
        name = f"{prefix}: {self.cable.name}"
        equilibrium, since = self.worst or self._told, "" if self.worst else " Nothing solved since."
        self.worst, self._told = None, equilibrium
        if equilibrium is None:
            return diagnostic(name, DiagnosticStatus.STALE, "Nothing solved yet.", {}, hardware_id)
        overlaps = [
            f"{one.other} at {one.distance:.6g} m, {one.contact_distance:.6g} m to touch"
            for one in equilibrium.overlaps
        ]
        values = {
            "status": equilibrium.status.name,
            "solve time [us]": equilibrium.solve_time * 1e6,
            "iterations": equilibrium.iterations,
            "error estimate": equilibrium.error_estimate,
            "stability margin": equilibrium.stability_margin,
            "total twist [rad]": equilibrium.total_twist,
            "energy [J]": equilibrium.energy,
            **({"overlaps": "; ".join(overlaps)} if overlaps else {}),
            **also,
        }
        return diagnostic(name, level(equilibrium), f"{equilibrium.message}{since}", values, hardware_id)

    def destroy(self, node: Node) -> None:
        """Withdraw the topics."""
        for outlet in self.outlets:
            if outlet.publisher is not None:
                node.destroy_publisher(outlet.publisher)
