# SPDX-License-Identifier: Apache-2.0
"""Ends of a cable among obstacles that are pinned, free or slide: their unknowns, loads and wrenches; SI.

The cable is solved as one between two clamps, put where its end sections are. What the end releases is an
unknown, and the equation that belongs to it is that the clamp exerts nothing there but the given load.
A free end may come to rest on an obstacle. Its section is then held along the normal; on a flat face the
tangent is held in the face, too, as soon as the cable beside it would go in: it lies.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cable_ros.branch.coupling import LOOSE, Loose
from cable_ros.branch.grip import Grip
from cable_ros.contact.distance import across, gap
from cable_ros.linalg.cross import cross_matrix
from cable_ros.rod import quaternion
from cable_ros.scene.model import CLAMPED, FREE, PINNED, SLIDING, SWIVEL, Cable, Mount

ALONG, PITCH = 5, 0
"""The unknowns along the normal and out of the face, which a face holds."""
Z_AXIS = np.array([0.0, 0.0, 1.0])


class Face(NamedTuple):
    """What a free end rests on."""

    obstacle: int
    """Its number."""
    row: np.ndarray
    """(WIDTH,) of `contact.distance`, SI, world."""
    lies: bool
    """Whether the cable lies there: its last tangent is in the face."""
    grip: Grip | None = None
    """How it rubs; None: it lies, or there is no friction."""

    @property
    def touch(self) -> tuple[int, bool]:
        """Its number, and whether the cable lies there."""
        return self.obstacle, self.lies


class Surface(NamedTuple):
    """An obstacle beside a point."""

    gap: float
    """m."""
    normal: np.ndarray
    """(3,)."""
    bends: np.ndarray
    """(3, 3) Hessian of the gap, 1/m."""

    @classmethod
    def at(cls, row: np.ndarray, r: np.ndarray) -> Surface:
        """Of the obstacle `row` (WIDTH,) beside r (3,)."""
        n, directions, bends = np.empty(3), np.empty((2, 3)), np.empty(2)
        distance = gap(row, r, n, directions, bends)
        return cls(float(distance), n, (bends * directions.T) @ directions)


class Tip(NamedTuple):
    """The section at a loose end, in the frame of its mount; that of a free end in the world."""

    which: int
    """0: at the start, 1: at the end."""
    world: bool
    """Whether it is told in the world."""
    position: np.ndarray
    """(3,) m."""
    turn: np.ndarray
    """(4,) orientation, scalar first."""
    axes: np.ndarray
    """(3, 3) in columns, the directions in which it moves."""
    spins: np.ndarray
    """(3, 3) in columns, the axes about which it turns, along its own axes; the last one is the tangent."""
    slides: bool = False
    """Whether it slides along the last of its axes."""
    face: Face | None = None
    """What it rests on."""

    @property
    def touch(self) -> tuple[int, bool] | None:
        """The obstacle that it rests on, and whether the cable lies there; None: it hangs."""
        return None if self.face is None else self.face.touch

    @property
    def slipped(self) -> np.ndarray:
        """(3,) m, world, how far it has slipped in this step over what it rests on."""
        grip = None if self.face is None else self.face.grip
        return self.position - grip.anchor if grip is not None and grip.slips else np.zeros(3)

    def moved(self, step: np.ndarray) -> Tip:
        """After a step (6,): rotations about `spins`, rad, then along `axes`, m; it stays on its face."""
        turn = np.empty((1, 4))
        quaternion.retract(self.turn[None], self.spins @ step[:3], turn)
        return self._replace(position=self.position + self.axes @ step[3:], turn=turn[0]).on_face()

    def on_face(self) -> Tip:
        """The nearest one on its face, with axes and spins of that place."""
        if self.face is None:
            return self
        beside = Surface.at(self.face.row, self.position)
        position, n = self.position - beside.gap * beside.normal, beside.normal
        sides = np.empty((2, 3))
        across(n, sides)
        turn, spins = self.turn, np.eye(3)
        if self.face.lies:
            tangent = quaternion.rotate(turn, Z_AXIS)
            flat = tangent - (tangent @ n) * n
            turn = quaternion.multiply(quaternion.between(tangent, flat / np.linalg.norm(flat)), turn)
            pitch = quaternion.rotate(quaternion.conjugate(turn), np.cross(n, flat / np.linalg.norm(flat)))
            spins = np.stack([pitch, np.cross(Z_AXIS, pitch), Z_AXIS], axis=1)
        return self._replace(position=position, turn=turn, axes=np.stack([*sides, n], axis=1), spins=spins)

    def step_to(self, other: Tip) -> np.ndarray:
        """(6,) the step that leads to another one, as in `moved`."""
        turn = quaternion.rotation_vector(quaternion.multiply(quaternion.conjugate(self.turn), other.turn))
        return np.concatenate([self.spins.T @ turn, self.axes.T @ (other.position - self.position)])

    def yields(self, mount: np.ndarray) -> np.ndarray | None:
        """(3, 3) projector on the directions, world, along which nothing but a given force holds it.

        None: it is held, it rubs, or it is at the start, from which positions count. `mount` (7,).
        """
        if self.which == 0 or not (self.world or self.slides):
            return None
        n = self.axes[:, 2]
        if self.slides:
            along = quaternion.rotate(quaternion.from_ros(mount[3:]), n)
            return np.outer(along, along)
        if self.face is not None and self.face.grip is not None:
            return None
        return np.eye(3) if self.face is None else np.eye(3) - np.outer(n, n)

    def displaced(self, by: np.ndarray, mount: np.ndarray) -> Tip:
        """One that is off by (3,), m, world, where it yields; `mount` (7,)."""
        own = (
            by if self.world else quaternion.rotate(quaternion.conjugate(quaternion.from_ros(mount[3:])), by)
        )
        return self._replace(position=self.position + own).on_face()

    def pose(self, mount: np.ndarray) -> np.ndarray:
        """(7,) of the section in the world; `mount` (7,)."""
        if self.world:
            return np.concatenate([self.position, quaternion.to_ros(self.turn)])
        own = quaternion.from_ros(mount[3:])
        turn = quaternion.multiply(own, self.turn)
        position = mount[:3] + quaternion.rotate(own, self.position)
        return np.concatenate([position, quaternion.to_ros(turn)])

    @property
    def leans(self) -> float:
        """Of one on a face: sine of the angle by which the cable beside it goes into the face."""
        tangent = float(quaternion.rotate(self.turn, Z_AXIS) @ self.axes[:, 2])
        return tangent if self.which else -tangent


class LooseEnd:
    """How one end is held, if not clamped.

    Args:
        which: 0: the start, 1: the end.
        mount: of the scene.
    """

    def __init__(self, which: int, mount: Mount) -> None:
        self.which, self.mount = which, mount
        self.free = mount.kind == FREE
        self.mask = np.zeros(LOOSE, bool)
        """(6,) which unknowns there are while it touches nothing."""
        self.mask[:3] = self.free or mount.kind == PINNED or mount.turns
        self.mask[2] |= mount.kind == SWIVEL
        self.mask[3:5], self.mask[5] = self.free, self.free or mount.kind == SLIDING
        self._axes = np.eye(3)
        if mount.axis is not None:
            sides = np.empty((2, 3))
            across(mount.axis, sides)
            self._axes = np.stack([*sides, mount.axis], axis=1)

    def tip(self, pose: np.ndarray, mount: np.ndarray) -> Tip:
        """Its section at `pose` (7,), as far as the mount at `mount` (7,) lets it be there; both world."""
        position, turn = pose[:3], quaternion.from_ros(pose[3:])
        if self.free:
            return Tip(self.which, True, position, turn, self._axes, np.eye(3))
        back = quaternion.conjugate(quaternion.from_ros(mount[3:]))
        turn = quaternion.multiply(back, turn)
        if not self.mask[2]:
            turn = np.array([1.0, 0.0, 0.0, 0.0])
        elif not self.mask[0]:
            turn = turn * np.array([1.0, 0.0, 0.0, 1.0])
            turn = turn / np.linalg.norm(turn) if turn.any() else np.array([1.0, 0.0, 0.0, 0.0])
        along = self._axes[:, 2] @ quaternion.rotate(back, position - mount[:3]) if self.mask[5] else 0.0
        slides = bool(self.mask[ALONG])
        return Tip(self.which, False, along * self._axes[:, 2], turn, self._axes, np.eye(3), slides)

    def held_by(self, face: tuple[int, bool] | None, sticks: bool) -> np.ndarray:
        """(6,) which unknowns there are on a face: an obstacle's number, and whether it lies there."""
        mask = self.mask.copy()
        if face is not None:
            mask[ALONG], mask[PITCH] = False, not face[1]
            mask[3:5] &= not sticks
        return mask

    def loose(self, tip: Tip, mount: np.ndarray, wound: float) -> Loose:
        """As its equations see it; `mount` (7,), world; `wound`: the part of its moment that acts."""
        section = quaternion.matrices_from_ros(tip.pose(mount)[None, 3:])[0]
        own = quaternion.matrices_from_ros(np.ascontiguousarray(mount[None, 3:]))[0]
        motion = np.zeros((6, 6))
        motion[:3, 3:] = section.T @ (tip.axes if tip.world else own @ tip.axes)
        motion[3:, :3] = tip.spins
        back, force, moment = section.T @ own, self.mount.force, wound * self.mount.moment
        load, by_turn = np.concatenate([back @ force, back @ moment]), np.zeros((6, 3))
        if self.free:
            by_turn = -np.concatenate([back @ cross_matrix(force), back @ cross_matrix(moment)])
        bends = np.zeros((3, 3))
        if tip.face is not None:
            bends[:2, :2] = (tip.axes.T @ Surface.at(tip.face.row, tip.position).bends @ tip.axes)[:2, :2]
        return Loose(self.which, motion, load, bends, by_turn, tip.face is not None and tip.face.lies)

    def pull(self, mount: np.ndarray) -> np.ndarray:
        """(3,) its given force, N, world; `mount` (7,)."""
        return quaternion.rotate(quaternion.from_ros(mount[3:]), self.mount.force)

    def energy(self, tip: Tip, mount: np.ndarray) -> float:
        """Minus the work, J, of its given force up to where it is, from the mount or the world's origin."""
        force = self.pull(mount) if self.free else self.mount.force
        return -float(force @ tip.position)

    def wrench(self, tip: Tip, inner: np.ndarray) -> np.ndarray:
        """(6,) on its mount, about its origin and along its axes, from that on the section (6,).

        Of a free end about itself. What is released is exactly zero, or the given load.
        """
        mount = self.mount
        if self.free:
            return -np.concatenate([mount.force, mount.moment]) + 0.0
        force = quaternion.rotate(tip.turn, inner[:3])
        if mount.axis is not None:
            force = force - (mount.axis @ force) * mount.axis - mount.force
        moment = quaternion.rotate(tip.turn, inner[3:] * ~self.mask[:3]) + np.cross(tip.position, force)
        return np.concatenate([force, moment]) + 0.0

    def onto_mount(self, tip: Tip) -> np.ndarray:
        """(6, 6) takes wrenches on the section to the mount's axes; its transpose motions of the mount.

        Zeros for a free end, which no mount moves.
        """
        out = np.zeros((6, 6))
        if not self.free:
            turn = quaternion.matrices_from_ros(quaternion.to_ros(tip.turn)[None])[0]
            out[:3, :3] = out[3:, 3:] = turn
            out[3:, :3] = cross_matrix(tip.position) @ turn
        return out


def loose_ends(run: Cable) -> tuple[LooseEnd, ...]:
    """The ends of a run that are not clamps."""
    return tuple(LooseEnd(i, mount) for i, mount in enumerate(run.mounts) if mount.kind != CLAMPED)
