# SPDX-License-Identifier: Apache-2.0
"""What RViz and Foxglove show: a cable as a tube coloured by its bending moment, its end forces as arrows."""

from __future__ import annotations

import numpy as np
from geometry_msgs.msg import Point
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from cable_ros.equilibrium import Equilibrium
from cable_ros.limits import BEYOND, OK
from cable_ros.rod.quaternion import matrices_from_ros
from cable_ros.ros.cdr_template import Template, serialise
from cable_ros.ros.messages import set_stamp
from cable_ros.scene.model import Cable

SIDES = 8
"""Corners of the tube's section."""
_DEFAULT_RADIUS_RATIO = 0.01  # of the length, where the scene gives no diameter
# Colours from no bending moment to the largest: dark blue, teal, yellow (viridis at three places).
_COLOURS = np.array([[0.27, 0.00, 0.33], [0.13, 0.57, 0.55], [0.99, 0.91, 0.14]])
_NEAR, _BEYOND = ColorRGBA(r=1.0, g=0.8, b=0.0, a=1.0), ColorRGBA(r=0.9, g=0.0, b=0.0, a=1.0)


def bending_moments(cable: Cable, quaternions: np.ndarray) -> np.ndarray:
    """Bending moment along the cable, N m, from the turns between neighbouring section frames.

    Args:
        cable: length, stiffness and natural strain.
        quaternions: (n, 4) section frames at equal arc lengths, x y z w.

    Returns:
        (n,) norm of the bending part of the moment; between two sections their mean curvature counts.
    """
    a, b = quaternions[:-1], quaternions[1:]
    # Vector part of conj(a) b: half the turn from one section to the next, in the section's own axes.
    vector = a[:, 3:] * b[:, :3] - b[:, 3:] * a[:, :3] - np.cross(a[:, :3], b[:, :3])
    scalar = np.sum(a * b, axis=1)
    vector *= np.where(scalar < 0, -1.0, 1.0)[:, None]
    sine = np.linalg.norm(vector, axis=1)
    angle = 2 * np.arctan2(sine, np.abs(scalar))
    step = cable.length / (len(quaternions) - 1)
    turn = vector * (angle / np.where(sine > 0, sine, 1.0) / step)[:, None]
    if cable.natural_strain is not None:
        turn -= cable.natural_strain
    moment = np.hypot(cable.stiffness[0] * turn[:, 0], cable.stiffness[1] * turn[:, 1])
    return np.interp(np.arange(len(quaternions)), np.arange(len(moment)) + 0.5, moment)


def colours(values: np.ndarray) -> np.ndarray:
    """(n, 4) colours r g b a of (n,) values, from dark (0) to bright (the largest)."""
    top = float(np.max(values, initial=0.0))
    place = values / top if top > 0 else np.zeros_like(values)
    knots = np.linspace(0, 1, len(_COLOURS))
    channels = [np.interp(place, knots, channel) for channel in _COLOURS.T]
    return np.stack([*channels, np.ones_like(place)], axis=1)


class CableMarkers:
    """`visualization_msgs/MarkerArray` of one cable: tube, end forces as arrows, contact forces as lines,
    balls where a limit is near or exceeded.
    """

    def __init__(self, cable: Cable, world_frame: str, count: int) -> None:
        self.count = count
        self._cable = cable
        self._touched = False
        self._radius = cable.diameter / 2 if cable.diameter else cable.length * _DEFAULT_RADIUS_RATIO
        corners = 6 * SIDES * (count - 1)
        tube = self._marker(world_frame, f"{cable.name}/tube", Marker.TRIANGLE_LIST)
        tube.points = [Point() for _ in range(corners)]
        tube.colors = [ColorRGBA() for _ in range(corners)]
        tube.scale.x = tube.scale.y = tube.scale.z = 1.0
        arrows = []
        for name in ("end_force", "start_force"):
            arrow = self._marker(world_frame, f"{cable.name}/{name}", Marker.ARROW)
            arrow.points = [Point(), Point()]
            arrow.scale.x, arrow.scale.y = 3 * self._radius, 6 * self._radius  # shaft and head diameter
            arrow.color = ColorRGBA(r=0.9, g=0.2, b=0.1, a=1.0)
            arrows.append(arrow)
        self._lines = lines = self._marker(world_frame, f"{cable.name}/contact_forces", Marker.LINE_LIST)
        lines.scale.x = 0.5 * self._radius
        lines.color = ColorRGBA(r=0.1, g=0.5, b=0.9, a=1.0)
        self._limited = False
        self._balls = balls = self._marker(world_frame, f"{cable.name}/limits", Marker.SPHERE_LIST)
        balls.scale.x = balls.scale.y = balls.scale.z = 3 * self._radius
        shown = [tube, *arrows, lines, *([balls] if cable.limits is not None else [])]
        self._removal = MarkerArray(
            markers=[Marker(header=m.header, ns=m.ns, action=Marker.DELETE) for m in shown]
        )
        self._template = Template(MarkerArray(markers=[tube, *arrows]))
        view = self._template.view
        self._points = view("markers[0].points[{}].x", 3, rows=corners)
        self._colours = view("markers[0].colors[{}].r", 4, rows=corners, dtype=np.float32)
        self._arrows = [view(f"markers[{i}].points[{{}}].x", 3, rows=2) for i in (1, 2)]
        angles = np.arange(SIDES) * (2 * np.pi / SIDES)
        self._circle = self._radius * np.stack([np.cos(angles), np.sin(angles), np.zeros(SIDES)])
        self._corners = self._triangles(count)

    @staticmethod
    def _marker(frame: str, namespace: str, kind: int) -> Marker:
        marker = Marker(ns=namespace, type=kind, action=Marker.ADD)
        marker.header.frame_id = frame
        marker.pose.orientation.w = 1.0
        return marker

    @staticmethod
    def _triangles(count: int) -> np.ndarray:
        """Ring corner (section * SIDES + side) of every triangle corner, outside facing out."""
        section, side = (index.reshape(-1) for index in np.mgrid[0 : count - 1, 0:SIDES])
        here, beside = section * SIDES + side, section * SIDES + (side + 1) % SIDES
        above, above_beside = here + SIDES, beside + SIDES
        return np.stack([here, beside, above_beside, here, above_beside, above], axis=1).reshape(-1)

    def fill(self, stamp: int, equilibrium: Equilibrium, force_scale: float) -> bytes:
        """Bytes with the tube and the arrows; `force_scale` is an arrow's length in m/N."""
        points = equilibrium.points
        frames = matrices_from_ros(equilibrium.orientations)
        rings = points[:, None, :] + np.einsum("nij,jk->nki", frames, self._circle)
        self._points[:] = rings.reshape(-1, 3)[self._corners]
        shades = colours(bending_moments(self._cable, equilibrium.orientations))
        self._colours[:] = shades[self._corners // SIDES]
        axes = matrices_from_ros(equilibrium.wrench_axes)
        ends = ((-1, equilibrium.end_wrench), (0, equilibrium.start_wrench))
        for arrow, (index, wrench) in zip(self._arrows, ends, strict=True):
            arrow[0] = points[index]
            arrow[1] = points[index] + force_scale * (axes[index] @ wrench[:3])
        set_stamp(self._template, stamp)
        return self._template.to_bytes()

    def contacts(self, stamp: int, equilibrium: Equilibrium, force_scale: float) -> bytes | None:
        """Bytes with a line for the force at each contact; None where there is none to show or to remove."""
        found = equilibrium.contacts
        if not found and not self._touched:
            return None
        self._touched = bool(found)
        lines = self._lines
        lines.header.stamp.sec, lines.header.stamp.nanosec = divmod(stamp, 1_000_000_000)
        lines.action = Marker.ADD if found else Marker.DELETE
        ends = [end for one in found for end in (one.position, one.position + force_scale * one.force)]
        lines.points = [Point(x=float(x), y=float(y), z=float(z)) for x, y, z in ends]
        return serialise(MarkerArray(markers=[lines]))

    def limits(self, stamp: int, equilibrium: Equilibrium) -> bytes | None:
        """Bytes with a ball where a limit is near (yellow) or exceeded (red); None: nothing to change."""
        found = [one for one in equilibrium.extremes if one.level > OK]
        if not found and not self._limited:
            return None
        self._limited = bool(found)
        balls = self._balls
        balls.header.stamp.sec, balls.header.stamp.nanosec = divmod(stamp, 1_000_000_000)
        balls.action = Marker.ADD if found else Marker.DELETE
        balls.points = [Point(x=x, y=y, z=z) for x, y, z in (one.position.tolist() for one in found)]
        balls.colors = [_BEYOND if one.level == BEYOND else _NEAR for one in found]
        return serialise(MarkerArray(markers=[balls]))

    def remove(self) -> bytes:
        """Bytes that take the cable out of the view: there is no shape of it that could be trusted."""
        self._touched = self._limited = False
        return serialise(self._removal)
