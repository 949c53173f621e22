# SPDX-License-Identifier: Apache-2.0
"""Balance at pins, rings and tubes: Newton's method for what the pieces on both sides share."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cable_ros.branch.coupled_run import CoupledRun
from cable_ros.branch.coupled_state import Shared
from cable_ros.branch.coupling import LOOSE, Ends, across_ring, step_size
from cable_ros.branch.followed_equilibrium import largest_difference
from cable_ros.branch.grip import STUCK, Grip, friction_force, landed
from cable_ros.branch.landing import INSIDE, Touch, caught, faced, let_go, touches
from cable_ros.branch.loose_ends import ALONG, Face
from cable_ros.contact.travel import SLIP_MISSED
from cable_ros.rod import quaternion
from cable_ros.scene import Kinematics

ITERATIONS = 12
"""Maximum number of steps of Newton's method at the supports."""
SLOW, STALLED = 0.2, 0.5
"""Rate of convergence beyond which the tangent is renewed, and beyond which a renewed one fails."""
FARTHEST = 0.25
"""Maximum step of Newton's method: a rotation, rad, or part of a length."""
NOISE, ROUNDING = 0.02, 2e-9
"""Fraction of the tolerance, and size, below which steps that stall are rounding of the pieces' solutions."""
EXACT = 1e-3
"""Fraction of the tolerance at which the steps end."""
PATIENT, SKEW = 3, 0.1
"""Of Broyden's method, with friction of obstacles: number of steps before a slow one asks for a new tangent,
and least part of a step that a change must answer to."""
SWITCHES = 6
"""Maximum number of changes between sticking and sliding in one step."""
HELD = 1e-6
"""Excess of friction at which a ring still sticks, as a fraction of it."""
SPARED = 5e-3
"""Friction over the largest force that an end which lies may go without."""
NO_WRENCHES = np.zeros(0)
LEAST = 1e-9
"""Motion against friction, as a fraction of the length, that is rounding."""


class Balance(CoupledRun):
    """Finds the equilibria of a run near its last one."""

    def _newton(
        self, kinematics: Kinematics, joints: np.ndarray, mounts: np.ndarray, guess: Shared
    ) -> Shared | None:
        """The equilibrium near a guess, with what sticks and what slides; None: none was found."""
        assert self.state is not None
        kept, origin, faces, slips = self._slides.copy(), self.state.arcs, list(self._faces), self._slips
        guess = self._faced(kinematics, joints, guess, begin=True)
        for _ in range(SWITCHES):
            found = self._corrected(kinematics, joints, mounts, guess)
            if found is not None and self._let_go(mounts, found):
                guess, self._inverse = self._faced(kinematics, joints, found), None
                continue
            if found is None or not (self._rough or any(map(self._friction_at, range(len(self.loose))))):
                break
            switched = self._switched(found, origin)
            gripped = self._gripped(mounts, found)
            if not (switched.any() or gripped):
                break
            arcs = np.where(switched & (self._slides == 0), origin, found.arcs)
            guess, self._inverse = Shared(found.turns, arcs, found.tips), None
            if gripped:
                guess = self._faced(kinematics, joints, guess)
        else:
            found = None
        if found is not None and self._spared(mounts, found):
            found = None
        if found is None:
            if faces != self._faces or not np.array_equal(self._slides, kept) or slips != self._slips:
                self._inverse = None
            self._slides, self._faces, self._slips = kept, faces, slips
        return found

    def _spared(self, mounts: np.ndarray, found: Shared) -> bool:
        """Whether an end that lies bears a force that friction does not know: there is none of its own."""
        if not self.rubs:
            return False
        forces = [piece.ends().wrenches.reshape(-1, 2, 3)[:, 0] for piece in self.pieces]
        largest = float(np.abs(forces).max())
        for tip, loose in zip(found.tips, self._loose(mounts, found), strict=True):
            if tip.face is not None and tip.face.lies:
                piece = self.pieces[-tip.which]
                normal = loose.push(piece.ends().wrench(tip.which))[ALONG]
                if piece.friction_of(tip.face.obstacle) * normal > SPARED * largest:
                    return True
        return False

    def _gripped(self, mounts: np.ndarray, found: Shared) -> bool:
        """Whether free ends stick that slipped, or slip that stuck."""
        slips, before = [], self._slips
        for tip, loose in zip(found.tips, self._loose(mounts, found), strict=True):
            push = loose.push(self.pieces[-tip.which].ends().wrench(tip.which))[3:]
            grip = None if tip.face is None else tip.face.grip
            slips.append(grip is not None and grip.slips_on(tip.position, push))
        self._slips = slips
        return slips != before

    def _switched(self, found: Shared, origin: np.ndarray) -> np.ndarray:
        """(n,) which rings stick that slid, or slide that stuck; `origin` (n,): arc lengths before."""
        switched, known = np.zeros(len(origin), bool), None
        for j in self._rough:
            if self._slides[j]:
                # the cable slides towards its end, and less of it is before the ring
                if self._slides[j] * (found.arcs[j] - origin[j]) > LEAST * self.run.length:
                    self._slides[j], switched[j] = 0, True
                continue
            excess, signs = known = known or self._excess()
            if excess[j] > (1.0 + HELD) * self._friction[j]:
                self._slides[j], switched[j] = signs[j], True
        return switched

    def _excess(self) -> tuple[np.ndarray, np.ndarray]:
        """(n,) difference of the tensions over the force across each ring, and (n,) its sign."""
        ends = [piece.ends() for piece in self.pieces]
        out, signs = np.zeros(len(self._guides)), np.zeros(len(self._guides), int)
        for j in range(len(out)):
            difference = ends[j + 1].forces[0] - ends[j].forces[1]
            out[j] = abs(difference) / max(across_ring(ends[j], ends[j + 1])[0], 1e-300)
            signs[j] = int(np.sign(difference))
        return out, signs

    def _corrected(
        self, kinematics: Kinematics, joints: np.ndarray, mounts: np.ndarray, guess: Shared
    ) -> Shared | None:
        """Newton's method with a tangent that is renewed if it is slow; None: it does not converge."""
        state = self._move(kinematics, joints, mounts, self._caught(kinematics, joints, guess))
        if state is None:
            return None
        tolerance = EXACT * self.pieces[0].tolerance
        self._left = 0.0
        size, rate, rubs = np.inf, SLOW, self.rubs
        age = ITERATIONS  # number of steps since the tangent was made
        last = np.empty(0), np.empty(0)  # the step before and the residual from which it was made
        for iteration in range(2 * ITERATIONS if rubs else ITERATIONS):
            if self.loose and not touches(self._faces, state.tips):
                # it has arrived inside of what it touches from here on
                state = self._move(kinematics, joints, mounts, self._faced(kinematics, joints, state))
                if state is None:
                    return None
                size = np.inf
            free = self._solved
            if self._inverse is None or len(self._inverse) != free.sum():
                if not (
                    self._probe(kinematics, joints, mounts, state) if rubs else self._renew(mounts, state)
                ):
                    return None
                age = 0
            assert self._inverse is not None
            ends = [piece.ends() for piece in self.pieces]
            residual = self._residual(mounts, state)
            step = self._answer(state, residual)
            new = self._size(step, ends, residual)
            if not self._reach(step) <= FARTHEST:
                return None
            if iteration and rubs:
                self._learn(last[0][free], (residual - last[1])[free])
                step = self._answer(state, residual)
                new = self._size(step, ends, residual)
                if not self._reach(step) <= FARTHEST:
                    return None
            if iteration:
                rate = new / size
                if rate > STALLED and new <= max(NOISE * self.pieces[0].tolerance, ROUNDING):
                    return state
                if rate > STALLED and age <= 1 and not rubs:
                    return None
            if iteration and rate > (STALLED if rubs else SLOW) and age > (PATIENT if rubs else 0):
                self._inverse, size = None, np.inf
                continue
            size = new
            if new <= tolerance and self._clear(kinematics, joints, state):
                self._left = step if self._comparable else 0.0
                return state
            state, age, last = state.moved(step), age + 1, (step, residual)
            if self.loose:
                state, before = self._caught(kinematics, joints, state), state
                if state is not before:
                    self._inverse, new = None, np.inf
            state = self._move(kinematics, joints, mounts, state)
            if state is None:
                return None
            if new * min(max(rate, 1e-3), 1.0) <= tolerance and self._clear(kinematics, joints, state):
                return state
        return None

    def _stops(self, found: Shared) -> bool:
        """Whether a free end that slipped has come to rest in a step too long to tell where."""
        grips = [(tip.face.grip, tip.position) for tip in found.tips if tip.face is not None]
        most = SLIP_MISSED * self.run.length
        return any(grip is not None and grip.missed(position) > most for grip, position in grips)

    def _clear(self, kinematics: Kinematics, joints: np.ndarray, state: Shared) -> bool:
        """Whether no free end is inside of an obstacle where it has arrived; if one is, it touches that."""
        if not self.loose or self._caught(kinematics, joints, state) is state:
            return True
        self._inverse = None
        return False

    def _answer(self, state: Shared, residual: np.ndarray) -> np.ndarray:
        """(N,) the next step of Newton's method; an end that slips does so as friction lets it."""
        assert self._inverse is not None
        free, inverse = self._solved, self._inverse
        out = np.zeros(len(free))
        out[free] = -inverse @ residual[free]
        if not any(self._slips):
            return out
        for k, tip in enumerate(state.tips):
            if tip.face is None or tip.face.grip is None or not tip.face.grip.slips:
                continue
            grip, first = tip.face.grip, len(free) + LOOSE * (k - len(self.loose)) + LOOSE // 2
            own = np.searchsorted(np.flatnonzero(free), [first, first + 1])
            row = self._tangent[first + 2, free]
            by_force = inverse[:, own]
            normal = residual[first + 2] + row @ out[free]
            for origin in (grip.origin(tip.position), grip.anchor):
                way = (tip.position - origin) @ tip.axes[:, :2] + out[first : first + 2]
                force = friction_force(grip.friction, way, by_force[own], normal, row @ by_force)
                if np.linalg.norm(way - by_force[own] @ force) > STUCK:
                    break  # what comes to rest does so at its anchor
            out[free] -= by_force @ force
        return out

    def _learn(self, step: np.ndarray, change: np.ndarray) -> None:
        """Improve the inverse by Broyden's method (1965), after a step that changed the residual, (free,).

        Where contact slips, the direction of friction depends on the step: the tangent does not know that.
        """
        assert self._inverse is not None
        back = self._inverse @ change
        weighed = step / np.where(self._lengths, self.run.length**2, 1.0)[self._solved]
        size = float(weighed @ back)
        if abs(size) > SKEW * float(weighed @ step):
            self._inverse = self._inverse + np.outer(step - back, weighed @ self._inverse) / size

    def _reach(self, step: np.ndarray) -> float:
        """Of a step (N,): largest rotation, rad, or shift over the shortest length."""
        return self._measured(step, np.empty((0, len(step))), NO_WRENCHES)

    def _size(self, step: np.ndarray, ends: Sequence[Ends], residual: np.ndarray) -> float:
        """Of a step (N,): largest rotation, rad, shift over the shortest length, or part of a wrench.

        `residual` (N,): from which it was made; what an end that yields bears too much is part of its force.
        """
        spread = np.empty((0, len(step))) if self._spread is None else self._spread
        wrenches = np.concatenate([one.wrenches for one in ends])
        size = self._measured(step, spread, wrenches)
        if not self.loose:
            return size
        whole = max(np.abs(wrenches.reshape(-1, 2, 3)[:, 0]).max(), self._nothing[0])
        return max(size, float(np.abs(residual[self.free & ~self._solved]).max(initial=0.0) / whole))

    def _measured(self, step: np.ndarray, spread: np.ndarray, wrenches: np.ndarray) -> float:
        """See `coupling.step_size`."""
        shortest = min(piece.length for piece in self.pieces)
        return step_size(step, self._lengths, shortest, spread, wrenches, self._nothing)

    def _rows(self, kinematics: Kinematics, joints: np.ndarray) -> np.ndarray | None:
        """(o, WIDTH) the obstacles in the world, SI."""
        return self.pieces[0].obstacles(kinematics, joints)

    def _faced(
        self, kinematics: Kinematics, joints: np.ndarray, state: Shared, begin: bool = False
    ) -> Shared:
        """The state with its free ends on what they touch, where that is now; `begin`: of a step."""
        if touches(self._faces, state.tips) and not any(self._faces):
            return state
        rows = self._rows(kinematics, joints)
        tips = []
        for k, (tip, face) in enumerate(zip(state.tips, self._faces, strict=True)):
            grip = None if begin or tip.face is None else tip.face.grip
            on = faced(tip, face, rows)
            friction = self._friction_at(k)
            if on.face is not None and friction > 0.0:
                if grip is None:
                    grip = self._grip(kinematics, joints, k, tip.position, on.face)
                grip = grip._replace(friction=friction, slips=self._slips[k])
                there = on.position if grip.slips else grip.anchor
                on = on._replace(face=on.face._replace(grip=grip), position=there).on_face()
            tips.append(on)
        return state._replace(tips=tuple(tips))

    def _grip(self, kinematics: Kinematics, joints: np.ndarray, k: int, now: np.ndarray, face: Face) -> Grip:
        """How a tip that comes to be at `now` (3,) rubs on the face, if it has stuck since it was on it."""
        assert self.state is not None
        last, slid = self.state.tips[k], self._slid[k]
        old, new = (kinematics.obstacle_poses(at)[face.obstacle].copy() for at in (self._joints, joints))
        turn = quaternion.multiply(
            quaternion.from_ros(new[3:]), quaternion.conjugate(quaternion.from_ros(old[3:]))
        )
        carried = new[:3] + quaternion.rotate(turn, last.position - old[:3])
        if last.face is None or last.face.obstacle != face.obstacle:
            return Grip(0.0, landed(face.row, carried, now), False, np.zeros(3), 1.0)
        ratio = largest_difference(joints, self._joints) / slid.step if slid.step else 1.0
        return Grip(0.0, carried, False, quaternion.rotate(turn, slid.way), ratio)

    def _caught(
        self, kinematics: Kinematics, joints: np.ndarray, state: Shared, least: float = INSIDE
    ) -> Shared:
        """The state with free ends on obstacles that are nearer than `least`, a fraction of the length."""
        if not any(end.free for end in self.loose):
            return state
        rows, least = self._rows(kinematics, joints), least * self.run.length
        faces = [caught(end, tip, rows, least) for end, tip in zip(self.loose, state.tips, strict=True)]
        if touches(faces, state.tips):
            return state
        self._touch(faces)
        return self._faced(kinematics, joints, state)

    def _let_go(self, mounts: np.ndarray, state: Shared) -> bool:
        """Whether free ends touch something else at a solution than they did before."""
        if not any(self._faces):
            return False
        before, unit = self._faces, self.pieces[0].unit
        self._touch([
            let_go(tip, loose, self.pieces[-tip.which].ends().wrench(tip.which), unit)
            for tip, loose in zip(state.tips, self._loose(mounts, state), strict=True)
        ])  # fmt: skip
        return before != self._faces

    def _touch(self, faces: list[Touch]) -> None:
        """Let free ends touch these; what is new sticks at first."""
        same = [old == new for old, new in zip(self._faces, faces, strict=True)]
        self._slips = [slip and kept for slip, kept in zip(self._slips, same, strict=True)]
        self._faces = faces
