# SPDX-License-Identifier: Apache-2.0
"""The pieces of a run between two clips or ends, and the linearised equations of what they share."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cable_ros.branch.coupled_state import Shared
from cable_ros.branch.coupled_tangent import CoupledTangent, Turned
from cable_ros.branch.coupling import (
    LOOSE,
    NEUTRAL,
    PER,
    Ends,
    Loose,
    System,
    assemble,
    inverse_but_neutral,
    judged,
    residual_of,
)
from cable_ros.branch.followed_equilibrium import largest_difference
from cable_ros.branch.grip import Slip
from cable_ros.branch.loose_ends import LooseEnd
from cable_ros.branch.loose_piece import LoosePiece
from cable_ros.branch.prediction import Step
from cable_ros.branch.shared_piece import Kept, SharedPiece
from cable_ros.scene import Cable, Kinematics
from cable_ros.scene.model import TUBE

RENEWED = 0.05
"""Motion of supports and sections, rad or parts of the length, after which stability is judged again."""
PROBE = 1e-4
"""Step of differences, rad and L."""
NOTHING = 1e-3
"""Wrench, EI / L^2 and EI / L, below which its changes are not relative: a loose end may bear none."""


class CoupledRun:
    """The pieces of one run and their last common equilibrium.

    Args:
        run: the cable between two clips or ends, with the supports in between.
        pieces: its pieces.
        first: number of its first piece in the scene.
        loose: its ends that are solved here, as they are among obstacles.
    """

    def __init__(
        self, run: Cable, pieces: Sequence[SharedPiece], first: int, loose: tuple[LooseEnd, ...] = ()
    ) -> None:
        self.run, self.pieces, self.first = run, tuple(pieces), first
        self.which = slice(first, first + len(pieces))
        self._guides = np.array([support.slides for support in run.supports], bool)
        self._tubes = np.array([support.kind == TUBE for support in run.supports], bool)
        self._friction = np.array([support.friction for support in run.supports], float)
        self._rough = np.flatnonzero(self._guides & (self._friction > 0.0)).tolist()
        self._known_free: dict[bytes, np.ndarray] = {}  # by what slides
        self.loose = loose
        per = np.arange(PER) == PER - 1, np.arange(LOOSE) >= LOOSE // 2
        self._lengths = np.concatenate([np.tile(per[0], len(self._guides)), np.tile(per[1], len(loose))])
        spins = len(loose) == 2 and all(end.mask[2] for end in loose)
        self._turns_freely = spins or any(end.free for end in loose)
        self.reset()

    def reset(self) -> None:
        """Forget the equilibrium."""
        self.state: Shared | None = None
        self._joints = self._origin = np.empty(0)
        self._kept: list[Kept] = []
        self._steps: tuple[Step, ...] = ()  # the last two, the latest first
        # corrections below the tolerance, not made: of the state that was found last, and of the present one
        self._left: np.ndarray | float = 0.0
        self._missed: np.ndarray | float = 0.0
        self._slides = np.zeros(len(self._guides), int)
        self._faces: list[tuple[int, bool] | None] = [None] * len(self.loose)  # number, and whether it lies
        self._slips = [False] * len(self.loose)  # see `Grip.slips`
        self._slid = [Slip(np.zeros(3), 0.0)] * len(self.loose)  # in the step to the last equilibrium
        self._wound = 1.0  # part of the given moments that acts
        self._inverse: np.ndarray | None = None
        self._tangent = np.empty((0, 0))  # of which it is the inverse, also by what is held
        self._spread: np.ndarray | None = None
        self._judged_at: np.ndarray | None = None
        self.margin = np.nan
        for piece in self.pieces:
            piece.reset()

    @property
    def may_rub(self) -> bool:
        """Whether there are obstacles with friction."""
        return any(piece.may_rub for piece in self.pieces)

    @property
    def rubs(self) -> bool:
        """Whether friction of obstacles may hold its pieces."""
        return any(piece.rubs for piece in self.pieces)

    @property
    def rubbing(self) -> bool:
        """Whether one of its pieces touches something with friction."""
        return any(piece.rubbing for piece in self.pieces)

    def _set_clear(self, clear: bool) -> None:
        """Solve all pieces as if nothing rough could hold them, or else with friction."""
        for piece in self.pieces:
            piece.clear = clear

    @property
    def _comparable(self) -> bool:
        """Whether the last two steps are along the same axes: slip turns, and so do a loose end's axes."""
        return not (self.rubs or self.loose)

    @property
    def arcs(self) -> np.ndarray:
        """(n,) arc lengths in its supports from its start, m."""
        if self.state is not None:
            return self.state.arcs
        return np.array([support.arc_length for support in self.run.supports])

    @property
    def free(self) -> np.ndarray:
        """(N,) which unknowns there are: rotations, in a tube about its axis only, and arcs that slide; of
        loose ends those that neither mount nor face holds.
        """
        sticks = [self._sticks(k) for k in range(len(self.loose))]
        key = self._slides.tobytes() + (repr((self._faces, sticks)).encode() if self.loose else b"")
        known = self._known_free.get(key)
        if known is None:
            out = np.ones((len(self._guides), PER), bool)
            out[self._tubes, :2] = False
            out[:, 3] = self._guides & ((self._friction == 0.0) | (self._slides != 0))
            ends = zip(self.loose, self._faces, sticks, strict=True)
            held = [end.held_by(face, stuck) for end, face, stuck in ends]
            known = self._known_free[key] = np.concatenate([out.ravel(), *held])
        return known

    @property
    def _solved(self) -> np.ndarray:
        """(N,) which of these are solved here: with friction, its piece tells where an end that yields is."""
        if not (self.loose and self.rubs) or self.loose[-1].which == 0:
            return self.free
        end, out = self.loose[-1], self.free.copy()
        if not end.free:
            out[-1] = False
        elif not self._friction_at(-1):
            out[-LOOSE // 2 :] = False
        return out

    def _friction_at(self, k: int) -> float:
        """The coefficient of friction at a free end that rests; 0: on nothing rough, or it lies.

        One that lies rests on its last section alone as long as the cable beside it touches nothing.
        """
        face = self._faces[k]
        if face is None or (face[1] and self.rubs):
            return 0.0
        return self.pieces[-self.loose[k].which].friction_of(face[0])

    def _sticks(self, k: int) -> bool:
        """Whether friction holds a free end."""
        return not self._slips[k] and self._friction_at(k) > 0.0

    @property
    def _nothing(self) -> np.ndarray:
        """(2,) force and moment that count as nothing, N and N m."""
        if not self.loose:
            return np.array([1e-300, 1e-300])
        return NOTHING * np.array(self.pieces[0].unit)

    @property
    def _push(self) -> np.ndarray:
        """(n,) signed coefficients of friction, see `coupling.assemble`."""
        return self._friction * self._slides

    def _accept(self, joints: np.ndarray, state: Shared) -> None:
        if self.state is not None:
            step = Step(joints - self._joints, self.state.step_to(state) + self._left - self._missed)
            if step.joints.any():
                far = largest_difference(joints, self._joints)
                self._slid = [Slip(tip.slipped, far) for tip in state.tips]
            if not self._comparable:
                self._steps = (step,)
            elif step.joints.any():
                self._steps = step, *self._steps[:1]
        self._joints, self.state, self._missed = joints, state, self._left
        self._keep()

    def _keep(self) -> None:
        """Remember the pieces' present equilibria."""
        self._kept = [piece.keep() for piece in self.pieces]

    @property
    def _remembered(self) -> bool:
        """Whether the pieces are for certain at the equilibria that are remembered."""
        if self.rubs or not self._kept:
            return False
        return all(piece.holds(kept) for piece, kept in zip(self.pieces, self._kept, strict=True))

    def _move(
        self, kinematics: Kinematics, joints: np.ndarray, mounts: np.ndarray, to: Shared, fall: bool = False,
        held: bool = False,
    ) -> Shared | None:  # fmt: skip
        """Move all pieces to a state nearby; where they are then, None if one could not follow.

        `fall`: whether each may fall to another equilibrium; `held`: whether an end stays that would yield.
        """
        places = to.places(mounts, self.run.length)
        if any(place.length < self._least for place in places):
            return None
        if self.loose and self.rubs and self.loose[-1].which:
            places[-1] = places[-1]._replace(pull=self.loose[-1].pull(mounts[-1, 1]))
        for piece, place in zip(self.pieces, places, strict=True):
            if piece.attempt(kinematics, joints, place._replace(yields=None) if held else place):
                continue
            if not (fall and piece.fall(kinematics, joints, place)):
                return None
        return self._reached(mounts, to)

    def _loose_piece(self, which: int) -> LoosePiece:
        """The first or the last of pieces next to a loose end."""
        piece = self.pieces[which]
        assert isinstance(piece, LoosePiece)
        return piece

    def _reached(self, mounts: np.ndarray, to: Shared) -> Shared:
        """The state `to` with its last tip where its section is."""
        if not to.tips or to.tips[-1].which == 0:
            return to
        tip = to.tips[-1].displaced(self._loose_piece(-1).astray, mounts[-1, 1])
        return to._replace(tips=(*to.tips[:-1], tip))

    @property
    def _least(self) -> float:
        """Minimum length of a piece, m: a shorter one is a ring or tube at a clamp."""
        return max(1e-3 * self.run.length, 2.0 * self.run.radius)

    def _return(self) -> None:
        """Move all pieces back to the last equilibrium."""
        for piece, kept in zip(self.pieces, self._kept, strict=True):
            piece.put_back(kept)
        self._inverse = None  # it may be that of a far state

    def tangent(self, mounts: np.ndarray, state: Shared) -> CoupledTangent:
        """The linearised equations about the present equilibria of the pieces."""
        places = state.places(mounts, self.run.length)
        pieces = [
            Turned(piece.tangent(place.poses), own, place.poses, piece.weight)
            for piece, own, place in zip(self.pieces, mounts.copy(), places, strict=True)
        ]
        for end, tip in zip(self.loose, state.tips, strict=True):
            pieces[-end.which].at_loose_end(end, tip)
        ends: tuple[Ends, ...] = tuple(piece.ends() for piece in self.pieces)
        loose = tuple(
            one.slipping(ends[-one.which].wrench(one.which)) if slips else one
            for one, slips in zip(self._loose(mounts, state), self._slips, strict=True)
        )
        return CoupledTangent(tuple(pieces), ends, self._push, self.free, loose, self.loose, state.tips)

    def _renew(self, mounts: np.ndarray, state: Shared) -> bool:
        """Invert the tangent at the pieces' present equilibria; whether it can be inverted."""
        system = self._system(mounts, state)
        self._spread = system.spread
        return self._invert(system.tangent)

    def _system(self, mounts: np.ndarray, state: Shared) -> System:
        """The supports' linearised equations at the pieces' present equilibria."""
        sides = self.tangent(mounts, state).sides()
        return assemble(sides, self._push, self._loose(mounts, state))

    def _probe(self, kinematics: Kinematics, joints: np.ndarray, mounts: np.ndarray, state: Shared) -> bool:
        """As `_renew`, by differences: the pieces' tangents do not know how slip turns friction."""
        found = self._differences(kinematics, joints, mounts, state, self._push)
        if found is None:
            return False
        self._spread = self._system(mounts, state).spread
        return self._invert(found[0])

    def _differences(
        self, kinematics: Kinematics, joints: np.ndarray, mounts: np.ndarray, state: Shared,
        *pushes: np.ndarray,
    ) -> list[np.ndarray] | None:  # fmt: skip
        """(N, N) `System.tangent` in what is free, for each of `pushes`, see `coupling.assemble`.

        By differences; None: a piece does not follow.
        """
        free, at = self._solved, [self._residual(mounts, state, push) for push in pushes]
        unit, out = np.eye(len(free)), [np.zeros((len(free), len(free))) for _ in pushes]
        for k in np.flatnonzero(free):
            size = PROBE * (self.run.length if self._lengths[k] else 1.0)
            for step in (size * unit[k], -size * unit[k]):
                moved = self._move(kinematics, joints, mounts, state.moved(step))
                if moved is not None:
                    break
            else:
                return None
            for columns, push, before in zip(out, pushes, at, strict=True):
                columns[:, k] = (self._residual(mounts, moved, push) - before) / step[k]
        return None if self._move(kinematics, joints, mounts, state) is None else out

    def _residual(self, mounts: np.ndarray, state: Shared, push: np.ndarray | None = None) -> np.ndarray:
        """(N,) of the equations at the pieces' present equilibria; `push`: another than the present one."""
        push = self._push if push is None else push
        return residual_of([piece.ends() for piece in self.pieces], push, self._loose(mounts, state))

    def _loose(self, mounts: np.ndarray, state: Shared) -> tuple[Loose, ...]:
        """The loose ends as their equations see them."""
        return tuple(
            end.loose(tip, mounts[-end.which, end.which], self._wound)
            for end, tip in zip(self.loose, state.tips, strict=True)
        )

    def _invert(self, tangent: np.ndarray) -> bool:
        """Keep the inverse of a tangent (N, N) in what is solved here; whether there is one."""
        free, self._tangent = self._solved, tangent
        try:
            if self._turns_freely:
                self._inverse = inverse_but_neutral(tangent[np.ix_(free, free)], self.scale()[free])
            else:
                self._inverse = np.linalg.inv(tangent[np.ix_(free, free)])
        except np.linalg.LinAlgError:
            return False
        return bool(np.isfinite(self._inverse).all())

    def scale(self) -> np.ndarray:
        """(N,) stiffness of straight pieces beside each support and loose end, N m and N / m."""
        out = np.zeros((len(self._guides), PER))
        for j in range(len(out)):
            for piece in self.pieces[j : j + 2]:
                stiffness, length = piece.section.stiffness, piece.length
                out[j, :2] += 4.0 * stiffness[:2] / length
                out[j, 2] += stiffness[2] / length
                out[j, 3] += 4.0 * stiffness[:2].mean() / length**3
        ends = []
        for end in self.loose:
            piece = self.pieces[-end.which]
            stiffness, length = piece.section.stiffness, piece.length
            turning = [*(4.0 * stiffness[:2] / length), stiffness[2] / length]
            ends.append([*turning, *[4.0 * stiffness[:2].mean() / length**3] * 3])
        return np.concatenate([out.ravel(), *ends])

    def _stable(self, kinematics: Kinematics, joints: np.ndarray, mounts: np.ndarray, state: Shared) -> bool:
        """Whether the state is a minimum of the energy, judged again if it has moved.

        Friction of obstacles holds a cable, too: what slips resists as its slip turns. Differences tell that.
        """
        here = np.concatenate([mounts[..., :3].ravel() / self.run.length, mounts[..., 3:].ravel(),
                               state.turns.ravel(), state.arcs / self.run.length,
                               *self._at(state)])  # fmt: skip
        if self._judged_at is not None and np.abs(here - self._judged_at).max() < RENEWED:
            return True  # what a free end touches counts a whole
        tangent = self.tangent(mounts, state)
        sides, free = tangent.sides(), self._solved
        none = np.zeros(len(self._guides))
        loose = self._loose(mounts, state)
        plain = assemble(sides, none, loose)
        system = assemble(sides, self._push, loose) if self._push.any() else plain
        hessian, slope = plain.hessian, system.tangent
        if self.rubs and self.rubbing:
            rough = self._differences(kinematics, joints, mounts, state, none, self._push)
            if rough is None:
                return False
            hessian, slope = rough
        margin = judged(self._held_by_slip(mounts, state, hessian), free, self.scale())
        if self._turns_freely and abs(margin) < NEUTRAL:
            margin = NEUTRAL
        if not margin > 0.0:
            return False
        self.margin, self._judged_at, self._spread = margin, here, system.spread
        return self._invert(slope)

    def _held_by_slip(self, mounts: np.ndarray, state: Shared, hessian: np.ndarray) -> np.ndarray:
        """(N, N) a Hessian with what holds an end that slips: its friction turns as its way does."""
        if not any(self._slips):
            return hessian
        out = hessian.copy()
        for k, (tip, loose) in enumerate(zip(state.tips, self._loose(mounts, state), strict=True)):
            if not (self._slips[k] and tip.face is not None and tip.face.grip is not None):
                continue
            push = loose.push(self.pieces[-tip.which].ends().wrench(tip.which))[3:5]
            way = max(float(np.linalg.norm(tip.position - tip.face.grip.anchor)), PROBE * self.run.length)
            size = float(np.linalg.norm(push))
            if size > 0.0:
                own = np.arange(2) + len(out) + LOOSE * (k - len(self.loose)) + 3
                out[np.ix_(own, own)] += size / way * (np.eye(2) - np.outer(push, push) / size**2)
        return out

    def _at(self, state: Shared) -> list[np.ndarray]:
        """Where loose ends are, in lengths and parts of a turn, and what they touch."""
        out = []
        for k, (tip, face) in enumerate(zip(state.tips, self._faces, strict=True)):
            touch = [-1.0, 0.0] if face is None else [float(face[0]), float(face[1])]
            touch.append(float(self._sticks(k)))
            out += [tip.position / self.run.length, tip.turn, np.array(touch)]
        return out
