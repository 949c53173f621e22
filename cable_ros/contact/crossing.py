# SPDX-License-Identifier: Apache-2.0
"""Where two cables touch: closest points of their centrelines, and the spacer that stands for the contact.

Contact between two cables is a force along the common normal of their centrelines, at points whose distance
is the sum of the radii. The spacer is a rigid body without mass between them, with two surfaces: of a
cylinder along the one cable, which the other one sees as an obstacle, and of one along the other, the other
way round. It is in equilibrium where both press on it along one line with the same force. As its axes are
that far apart, that line is their common normal, and each cable has its closest point on the other's axis:
these are the conditions of contact. So each cable only ever touches an obstacle.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cable_ros.contact.crossing_kernels import closest_points
from cable_ros.contact.distance import AXES, CAPSULE, CENTRE, DIMENSIONS, OFFSET, SHAPE, WIDTH
from cable_ros.linalg.cross import cross
from cable_ros.rod import quaternion
from cable_ros.rod.elements import Mesh

FREEDOMS = 5
"""Of a spacer: translations along two directions across the normal and along it, rotations about the two. It
may turn about the normal, and nothing changes."""
UNSTABLE = 2
"""Number of them in which the energy has a maximum at a stable equilibrium: the normal is that of the
smallest distance, the largest distance of two parallel planes between the cables."""
HALF_LENGTH = 3.0
"""Of a spacer's cylinders, distances of the axes: it stands for the cable nearby."""
WITHIN, SHORT = 0.4, 0.5
"""Radius about the axis on which the centreline of a cable stays that touches itself, and half length of such
a cylinder, distances of the centrelines. The cable sees both cylinders, and each strand must touch its own
only: it stays clear of the other one by 1 - 2 WITHIN, unless it turns round within a diameter."""


class Spacer(NamedTuple):
    """The body between two cables where they touch; world, m."""

    cables: tuple[int, int]
    """Numbers of the two, rising."""
    slots: tuple[int, int]
    """Which of the first one's obstacles it is, and of the second one's."""
    centres: np.ndarray
    """(2, 3) a point of the axis that the first cable sees, which is on the second, and the other way round;
    their difference is along the common normal. Of a cable that touches itself the axes are between its two
    strands, each nearer to the strand that sees it."""
    axes: np.ndarray
    """(2, 3) unit vectors along these axes, across the normal."""

    @classmethod
    def between(
        cls, cables: tuple[int, int], slots: tuple[int, int], points: np.ndarray, tangents: np.ndarray,
        apart: float,
    ) -> Spacer:  # fmt: skip
        """For centrelines that are `apart`, m, about the middle of two closest points.

        Args:
            cables, slots: as the fields.
            points, tangents: (2, 3) of the first and of the second cable.
            apart: distance of the centrelines.
        """
        normal = points[0] - points[1]
        normal /= np.linalg.norm(normal)
        middle = 0.5 * (points[0] + points[1])
        axes = tangents[::-1] - np.outer(tangents[::-1] @ normal, normal)
        axes /= np.linalg.norm(axes, axis=1)[:, None]
        half = 0.5 * apart * _lever(cables)
        return cls(cables, slots, middle + half * np.stack([-normal, normal]), axes)

    @property
    def of_itself(self) -> bool:
        """Whether one cable touches itself."""
        return self.cables[0] == self.cables[1]

    @property
    def apart(self) -> float:
        """Distance of the centrelines that touch it, m."""
        return float(np.linalg.norm(self.centres[1] - self.centres[0])) / abs(_lever(self.cables))

    @property
    def points(self) -> np.ndarray:
        """(2, 3) of the centrelines, where these touch it."""
        half = 0.5 * (self.centres[1] - self.centres[0]) / _lever(self.cables)
        return self.centres.mean(axis=0) + np.stack([half, -half])

    @property
    def frame(self) -> np.ndarray:
        """(3, 3) two directions across the normal, and the normal, from the second cable to the first."""
        normal = (self.centres[1] - self.centres[0]) / (self.apart * _lever(self.cables))
        first = self.axes[0]
        return np.stack([first, cross(normal, first), normal])

    def basis(self) -> np.ndarray:
        """(6, FREEDOMS) its motions: velocity of its point in the world's origin, and rotation.

        See `moved`.
        """
        out, frame = np.zeros((6, FREEDOMS)), self.frame
        out[:3, :3] = frame.T
        turns = frame[:2] / self.apart
        out[3:, 3:] = turns.T
        out[:3, 3:] = cross(0.5 * self.centres.sum(axis=0), turns).T
        return out

    def moved(self, step: np.ndarray) -> Spacer:
        """After a step (FREEDOMS,), m: translation, and rotation about its middle times `apart`."""
        frame, middle = self.frame, 0.5 * self.centres.sum(axis=0)
        q = np.empty((1, 4))
        quaternion.retract(np.array([[1.0, 0.0, 0.0, 0.0]]), step[3:] @ frame[:2] / self.apart, q)
        turn = quaternion.matrix_from_ros(quaternion.to_ros(q[0]))
        return self._replace(
            centres=middle + step[:3] @ frame + (self.centres - middle) @ turn.T, axes=self.axes @ turn.T
        )

    def step_to(self, other: Spacer) -> np.ndarray:
        """(FREEDOMS,) the step that leads to one nearby, to first order."""
        frame, change = self.frame, other.centres - self.centres
        # times the distance of the centrelines
        turn = cross(self.frame[2], change[1] - change[0]) / _lever(self.cables)
        return np.concatenate([frame @ change.mean(axis=0), frame[:2] @ turn])

    def with_apart(self, apart: float) -> Spacer:
        """For another distance of the centrelines, m."""
        return Spacer.between(self.cables, self.slots, self.points, self.axes[::-1], apart)

    def along(self, tangents: np.ndarray) -> Spacer:
        """With its axes along the tangents (2, 3) of the first and the second cable."""
        return Spacer.between(self.cables, self.slots, self.points, tangents, self.apart)

    def obstacle(self, side: int, radius: float) -> np.ndarray:
        """(WIDTH,) what the cable of that side sees, as `distance.gap` takes it; `radius` of the other, m."""
        row, axis, normal = np.zeros(WIDTH), self.axes[side], self.frame[2]
        row[SHAPE], row[CENTRE:AXES] = CAPSULE, self.centres[side]
        row[AXES:DIMENSIONS] = np.column_stack([normal, cross(axis, normal), axis]).ravel()
        if self.of_itself:
            row[DIMENSIONS : DIMENSIONS + 2] = WITHIN * self.apart, SHORT * self.apart
        else:
            row[DIMENSIONS : DIMENSIONS + 2] = radius, HALF_LENGTH * self.apart
            row[OFFSET] = self.apart - radius
        return row


def _lever(cables: tuple[int, int]) -> float:
    """Distance along the normal of a spacer's axes, over that of the centrelines."""
    return 2.0 * WITHIN - 1.0 if cables[0] == cables[1] else 1.0


class Curve(NamedTuple):
    """The centreline of a cable in the world."""

    q: np.ndarray
    """(n, 4) nodal frames."""
    c: np.ndarray
    """(m, g + 1, 3) see `centreline.curve`, m."""
    h: np.ndarray
    """(m,) lengths of its elements, L."""
    s0: np.ndarray
    """(m,) their starts, L."""
    nodes: np.ndarray
    """(p + 1,) of an element."""
    length: float
    """m."""

    @classmethod
    def of(cls, q: np.ndarray, c: np.ndarray, mesh: Mesh, start: np.ndarray, length: float) -> Curve:
        """With q (n, 4) and c seen from the start clamp, lengths, which is at `start` (7,) in the world."""
        turn = quaternion.matrix_from_ros(start[3:])
        c = length * c @ turn.T
        c[:, 0] += start[:3]
        frames = np.empty_like(q)
        first = quaternion.from_ros(start[3:])
        for own, out in zip(q, frames, strict=True):
            out[:] = quaternion.multiply(first, own)
        return cls(frames, c, mesh.lengths, mesh.starts, mesh.element.nodes, length)


class Closest(NamedTuple):
    """A pair of points of two cables whose distance is smallest nearby."""

    arcs: tuple[float, float]
    """Arc lengths, m."""
    points: np.ndarray
    """(2, 3) m."""
    tangents: np.ndarray
    """(2, 3)."""

    @property
    def distance(self) -> float:
        """m."""
        return float(np.linalg.norm(self.points[0] - self.points[1]))

    @property
    def normal(self) -> np.ndarray:
        """(3,) from the second cable to the first."""
        return (self.points[0] - self.points[1]) / max(self.distance, 1e-300)

    def at_end(self, lengths: tuple[float, float]) -> bool:
        """Whether it is at an end of a cable of these lengths, m."""
        return any(s <= 0.0 or s >= length for s, length in zip(self.arcs, lengths, strict=True))


def closest(a: Curve, b: Curve, fractions: tuple[float, float]) -> Closest:
    """The closest points of two cables beside these fractions of their lengths."""
    at, points, tangents = np.array(fractions), np.empty((2, 3)), np.empty((2, 3))
    closest_points(tuple(a), tuple(b), at, points, tangents)
    return Closest((float(at[0]) * a.length, float(at[1]) * b.length), points, tangents)


def candidates(
    p: np.ndarray, r: np.ndarray, reach: float, beyond: float | None = None
) -> list[tuple[float, float]]:
    """Where the distance of two polylines (n, 3), (m, 3) has a minimum below `reach`, in fractions of them.

    Points are at equal arc lengths. With `beyond`, of one polyline with itself: minima at fractions that are
    farther apart than this, the smaller one first.
    """
    d = np.sqrt(((p[:, None] - r[None]) ** 2).sum(axis=2))
    if not d.min() < reach:
        return []
    around = np.full((len(p) + 2, len(r) + 2), np.inf)
    around[1:-1, 1:-1] = d
    low = d < reach
    for i in range(3):
        for k in range(3):
            if (i, k) != (1, 1):
                low &= d <= around[i : i + len(p), k : k + len(r)]
    if beyond is not None:
        low &= np.triu(np.ones_like(low), int(np.ceil(beyond * (len(p) - 1))))
    return [(i / (len(p) - 1), k / (len(r) - 1)) for i, k in np.argwhere(low)]
