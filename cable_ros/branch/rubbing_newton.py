# SPDX-License-Identifier: Apache-2.0
"""Newton's method for cables that touch each other with friction."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cable_ros.branch.coulomb_contact import (
    CARRIED,
    SLIPS,
    STAYS,
    STICKS,
    UNKNOWNS,
    Grip,
    Key,
    Motion,
    Rub,
    Sides,
    assemble_with_friction,
    condensed,
    key,
    law,
)
from cable_ros.branch.crossing_balance import CrossedTangent, System
from cable_ros.branch.crossing_newton import (
    EXACT,
    FARTHEST,
    ITERATIONS,
    NOISE,
    ROUNDING,
    SLOW,
    STALLED,
    TANGENT,
    WRENCH,
    CrossingNewton,
    Pair,
)
from cable_ros.branch.rubbing_cable import Hold, RubbingCable, loaded_response
from cable_ros.branch.shared_piece import Place
from cable_ros.contact.crossing import FREEDOMS, Spacer
from cable_ros.contact.friction_kernels import ROUNDING as EDGE
from cable_ros.contact.friction_kernels import STICK
from cable_ros.linalg.cross import cross
from cable_ros.scene import Kinematics

MOST_SWITCHES, PATIENT = 8, 8
"""Maximum number of changes between stick and slip in one step, and of steps that a renewed tangent does not
make much shorter."""
NEARLY = 0.03
"""Size of a step from which on stick and slip may change."""
SPRING = 2e3
"""Stiffness, EI / L^3, of the spring that holds a touching point while Newton's method goes on."""
FARTHEST_SLIP = 0.5
"""Maximum slip in one step, as a fraction of the distance of the centrelines."""
FARTHEST_ROLL, FARTHEST_TURN = 0.2, 0.12
"""Maximum angle, rad, by which a cable rolls in one step, and by which the direction of slip turns."""
FRICTION_LEAST = 2e-4
"""Step, rad or m, that is never too far."""
AT_LIMIT = 1e-4
"""Relative distance of friction from its limit at which it counts as sliding."""


class RubbingTangent(CrossedTangent):
    """The linearised equations of all cables about their equilibrium, with the friction of their contacts."""

    def __init__(
        self, cables: Sequence[RubbingCable], radii: Sequence[float], spacers: Sequence[Spacer],
        poses: np.ndarray, rubs: dict[int, Rub], grips: dict[int, Grip],
    ) -> None:  # fmt: skip
        """`rubs`, `grips`: by number of the spacer."""
        super().__init__(cables, spacers, poses)
        self._radii, self._rubs, self._grips = tuple(radii), rubs, grips

    def whole(self, obstacles: Sequence[str] = ()) -> tuple[System, Sides]:
        """The equations with the unknowns of friction, see `assemble_with_friction`."""
        responses = []
        for i, ((tangent, first), own) in enumerate(zip(self._each, self._touching, strict=True)):
            moving = [*tangent.numbers(obstacles), *(first + slot for slot in own.slots)]
            loaded, before = [], []
            for slot, j in zip(own.slots, own.spacers, strict=True):
                if j in self._rubs:
                    side = self._spacers[j].cables.index(i)
                    loaded.append(first + slot)
                    before.append(float(self._grips[j].arcs[side]))
            responses.append(loaded_response(tangent, moving, loaded, before))
        return assemble_with_friction(self._spacers, self._radii, self._rubs, responses, len(obstacles))

    def system(self, obstacles: Sequence[str] = ()) -> System:
        if not self._rubs:
            return super().system(obstacles)
        return condensed(self.whole(obstacles)[0], FREEDOMS * len(self._spacers))


class RubbingNewton(CrossingNewton):
    """As `CrossingNewton`, with friction wherever cables have touched before.

    Args:
        cables: of the group.
        radii: of each, m.
        limit: coefficient of friction.
    """

    cables: tuple[RubbingCable, ...]

    def __init__(self, cables: Sequence[RubbingCable], radii: Sequence[float], limit: float) -> None:
        self.limit = limit
        super().__init__(cables, radii)

    def reset(self) -> None:
        super().reset()
        self._grips: dict[Key, Grip] = {}
        """Of the last equilibrium."""
        self._last: dict[Key, tuple[np.ndarray, int]] = {}
        """Friction there, on the first cable, and whether it stuck or slipped."""
        self._forces: dict[Key, np.ndarray] = {}  # these now
        self._states: dict[Key, int] = {}
        self._of_tangent: list[int] = []  # the states that `_inverse` is of
        self._poses = np.zeros((0, 2, 7))  # of the clamps, in the last attempt
        self._held = True  # whether friction holds what the springs of Newton's method have held
        self._sides: Sides | None = None  # of the tangent that `_inverse` is of
        for cable in self.cables:
            cable.hold({})

    def _hold(self, spacers: Sequence[Spacer], moved: dict[Key, np.ndarray]) -> None:
        """Have the cables feel the present friction at these spacers, from their present equilibria on.

        A cable under given friction alone may be unstable where one that is held is not: so a spring holds
        each touching point where it is expected, `moved` (2, 3) m from where it is. Friction is what both
        exert; the spring's part vanishes as Newton's method arrives.
        """
        holds: list[dict[int, Hold]] = [{} for _ in self.cables]
        for one in spacers:
            if key(one) not in self._forces:
                continue
            for side, (i, slot) in enumerate(zip(one.cables, one.slots, strict=True)):
                cable, sign = self.cables[i], 1.0 - 2.0 * side
                arc, arm = cable.touches(slot, cable.start).arc_length, -sign * self._radii[i] * one.frame[2]
                section = cable.section_at(arc, cable.start)
                holds[i][slot] = Hold(
                    arc, section.turn.T @ arm, sign * self._forces[key(one)],
                    section.position + arm + moved[key(one)][side], SPRING * cable.stick_unit,
                )  # fmt: skip
        for tracked, own in zip(self.cables, holds, strict=True):
            tracked.hold(own)

    def _rubs(self, spacers: Sequence[Spacer], poses: np.ndarray) -> dict[int, Rub]:
        """Friction at the present equilibria, by number of the spacer."""
        out = {}
        for j, one in enumerate(spacers):
            grip = self._grips.get(key(one))
            if grip is None:
                continue
            sections = [
                self.cables[i].section_at(float(s), poses[i, 0])
                for i, s in zip(one.cables, grip.arcs, strict=True)
            ]
            pressing = float(np.mean([touch.force for touch in self._touches(one, poses)]))
            stiffness = STICK * min(self.cables[i].stick_unit for i in one.cables)
            out[j] = Rub(
                self._forces[key(one)], Motion.of(grip, sections), pressing, self.limit, stiffness,
                self._states[key(one)],
            )  # fmt: skip
        return out

    def _newton(
        self, kinematics: Kinematics, joints: np.ndarray, poses: np.ndarray, guess: Sequence[Spacer]
    ) -> list[Spacer] | None:
        self._poses = poses
        known = [one for one in guess if key(one) in self._grips]
        still = self._joints is not None and np.array_equal(joints, self._joints)
        self._forces = {key(one): across(self._last[key(one)][0], one.frame[2]) for one in known}
        self._states = {key(one): STAYS if still else self._last[key(one)][1] for one in known}
        if not known:
            self._hold([], {})
            return super()._newton(kinematics, joints, poses, guess)
        return self._with_friction(kinematics, joints, poses, guess)

    def _with_friction(
        self, kinematics: Kinematics, joints: np.ndarray, poses: np.ndarray, guess: Sequence[Spacer]
    ) -> list[Spacer] | None:
        """As `CrossingNewton._newton`, with friction as unknowns."""
        spacers, tolerance, unknowns = list(guess), self.cables[0].asked, FREEDOMS * len(guess)
        size, slow, switches = np.inf, 0, 0
        before = {key(one): one.centres.mean(axis=0) for one in self.spacers}
        moved = {
            key(one): np.tile(one.centres.mean(axis=0) - before[key(one)], (2, 1))
            for one in spacers if key(one) in self._forces
        }  # fmt: skip
        for _ in range(2 * ITERATIONS):
            self.iterations += 1
            self._hold(spacers, moved)
            self._show(kinematics, joints, poses, spacers)
            for cable, own in zip(self.cables, poses, strict=True):
                if not cable.attempt(kinematics, joints, Place(own, cable.length)):
                    return None
                if not np.isfinite(cable.end_force).all():
                    return None
            pressed = self._residual(spacers, poses)
            if pressed is None:
                return None
            apart = self._balance(spacers, poses)
            rubs = self._rubs(spacers, poses)
            begins = [at for at, state in self._states.items() if state == CARRIED]
            for at in begins:  # one step with the direction of the friction that was too large
                self._states[at] = SLIPS
            switched = bool(begins) or (size < NEARLY and self._switch(rubs, spacers))
            rubs = self._rubs(spacers, poses)
            if switched:
                switches, size = switches + 1, np.inf
                if switches > MOST_SWITCHES:
                    return None
            residual = np.concatenate([pressed, *(
                np.concatenate([law(rub, spacers[j].frame).residual, np.zeros(UNKNOWNS - 2)])
                for j, rub in rubs.items()
            )])  # fmt: skip
            if self._of_tangent != [rub.state for rub in rubs.values()]:
                self._inverse = None
            step, new = self._whole_step(residual, apart, spacers)
            if not switched and new > STALLED * size and new <= max(NOISE * tolerance, ROUNDING):
                return self._arrived(joints, spacers, rubs)
            if new > SLOW * size or not new <= FARTHEST:
                if not self._renew(spacers, poses):
                    return None
                step, new = self._whole_step(residual, apart, spacers)
                slow += new > STALLED * size and new < FARTHEST
                if slow > PATIENT or not np.isfinite(new):
                    return None
            if new <= EXACT * tolerance and not switched:
                return self._arrived(joints, spacers, rubs)
            size, part = new, min(1.0, FARTHEST / new)
            assert self._sides is not None
            places = (self._sides.moved @ np.concatenate([step, apart]) * part).reshape(-1, 2, 3)
            moved = {key(spacers[j]): place for j, place in zip(rubs, places, strict=True)}
            spacers = [
                one.moved(own)
                for one, own in zip(spacers, part * step[:unknowns].reshape(-1, FREEDOMS), strict=True)
            ]
            for j, change in zip(rubs, part * step[unknowns:].reshape(-1, UNKNOWNS), strict=True):
                at, n = key(spacers[j]), spacers[j].frame[2]
                self._forces[at] = across(self._forces[at] + change[:3], n)
        return None

    def _balance(self, spacers: Sequence[Spacer], poses: np.ndarray) -> np.ndarray:
        """(6 r,) what friction on either side lacks of the same force, which becomes that of both."""
        out = []
        for one in spacers:
            if key(one) not in self._forces:
                continue
            first, second = (
                self.cables[i].friction(slot, poses[i, 0])
                for i, slot in zip(one.cables, one.slots, strict=True)
            )
            force = across(0.5 * (first - second), one.frame[2])
            self._forces[key(one)] = force
            out += [force - first, -force - second]
        return np.concatenate(out)

    def _whole_step(
        self, residual: np.ndarray, apart: np.ndarray, spacers: Sequence[Spacer]
    ) -> tuple[np.ndarray, float]:
        """Newton's step by the last tangent, and its size; infinite without one."""
        if self._inverse is None or self._sides is None or len(self._inverse) != len(residual):
            return residual, np.inf
        step = -self._inverse @ (residual + self._sides.tangent @ apart)
        least = min(one.apart for one in spacers)
        changes = (self._spread @ step + self._sides.spread @ apart).reshape(-1, 12)
        told = [cable.size_of(change) for cable, change in zip(self.cables, changes, strict=True)]
        return step, max(float(np.abs(step[: FREEDOMS * len(spacers)]).max()) / least, WRENCH * max(told))

    def _switch(self, rubs: dict[int, Rub], spacers: Sequence[Spacer]) -> bool:
        """Change between stick and slip where the present friction asks for it; whether any did."""
        switched = False
        for j, rub in rubs.items():
            at, trial = key(spacers[j]), rub.trial(spacers[j].frame[2])
            size = float(np.linalg.norm(trial))
            if rub.state in (STICKS, STAYS):
                slips = float(np.linalg.norm(rub.force)) > (1.0 + EDGE) * rub.cone
                if slips and rub.state == STAYS:
                    continue
                to = CARRIED if slips else rub.state
            else:
                to = SLIPS if size >= (1.0 - EDGE) * rub.cone and trial @ rub.force >= 0.0 else STICKS
            switched = switched or to != rub.state
            self._states[at] = to
        return switched

    def _arrived(
        self, joints: np.ndarray, spacers: list[Spacer], rubs: dict[int, Rub]
    ) -> list[Spacer] | None:
        """The spacers, unless friction has turned or slipped too far in this step."""
        assert self._joints is not None
        if float(np.abs(joints - self._joints).max(initial=0.0)) <= FRICTION_LEAST:
            return spacers
        for j, rub in rubs.items():
            one = spacers[j]
            n, before, slipped = one.frame[2], self._last[key(one)], rub.state == SLIPS
            if float(np.linalg.norm(rub.motion.slip)) > FARTHEST_SLIP * one.apart:
                return None
            for sign, lever in zip((1.0, -1.0), rub.motion.levers, strict=True):
                size = float(np.linalg.norm(lever))
                if float(np.linalg.norm(lever + sign * size * n)) > FARTHEST_ROLL * size:
                    return None
            if slipped and before[1] == SLIPS:
                then = across(rub.motion.friction, n)
                turn = cross(then, rub.force) @ n
                if abs(float(turn)) > FARTHEST_TURN * float(np.linalg.norm(then) * np.linalg.norm(rub.force)):
                    return None
        return spacers

    def _accept(self, joints: np.ndarray, pairs: Sequence[Pair], spacers: Sequence[Spacer]) -> None:
        states, forces = self._states, self._forces
        super()._accept(joints, pairs, spacers)
        grips, self._last = {}, {}
        for one in self.spacers:
            at, n = key(one), one.frame[2]
            force = across(forces.get(at, np.zeros(3)), n)
            touches = self._touches(one, self._poses)
            sections = [
                self.cables[i].section_at(touch.arc_length, self._poses[i, 0])
                for i, touch in zip(one.cables, touches, strict=True)
            ]
            arcs = np.array([touch.arc_length for touch in touches])
            grips[at] = Grip.of(arcs, sections, n, [self._radii[i] for i in one.cables], force)
            state = states.get(at, STICKS)
            if state == STAYS:
                state = (
                    SLIPS
                    if np.linalg.norm(force) > (1.0 - AT_LIMIT) * self.limit * touches[0].force
                    else STICKS
                )
            self._last[at] = force, state
        self._grips = grips
        self._inverse = None  # of other sections

    def tangent(self, poses: np.ndarray, carried: bool = True) -> RubbingTangent:
        """The linearised equations about the present equilibria; `carried`: slip goes on the same way."""
        rubs = self._rubs(self.spacers, poses)
        if carried:
            rubs = {
                j: rub._replace(state=CARRIED if rub.state == SLIPS else STICKS) for j, rub in rubs.items()
            }
        grips = {j: self._grips[key(self.spacers[j])] for j in rubs}
        return RubbingTangent(self.cables, self._radii, self.spacers, poses, rubs, grips)

    def _renew(self, spacers: Sequence[Spacer], poses: np.ndarray) -> bool:
        rubs = self._rubs(spacers, poses)
        if not rubs:
            self._held = True
            return super()._renew(spacers, poses)
        self.iterations += TANGENT
        grips = {j: self._grips[key(spacers[j])] for j in rubs}
        whole = RubbingTangent(self.cables, self._radii, spacers, poses, rubs, grips).whole()
        system, self._sides = whole
        self._of_tangent = [rub.state for rub in rubs.values()]
        self._held = all(self._holds(rub, spacers[j], i) for i, (j, rub) in enumerate(rubs.items()))
        try:
            self._inverse, self._spread = np.linalg.inv(system.tangent), system.spread
            self._modes = condensed(system, FREEDOMS * len(spacers)).modes()
        except np.linalg.LinAlgError:
            return False
        return bool(np.isfinite(self._inverse).all())

    def _holds(self, rub: Rub, spacer: Spacer, number: int) -> bool:
        """Whether two cables that stick, or slip, are stable where they are held only by each other.

        Either is a minimum of its energy where a spring holds it. Without it they give way across the normal
        to a force on each, by the compliances C: the sum of their inverses must be positive definite where
        they move together, and both along the slip where they slip. `number` of the friction among all.
        """
        assert self._sides is not None
        E, at = spacer.frame[:2], len(self._sides.moved[0]) - len(self._sides.moved) + 6 * number
        C = [
            E @ self._sides.moved[6 * number + k : 6 * number + k + 3, at + k : at + k + 3] @ E.T
            for k in (0, 3)
        ]
        if rub.state in (SLIPS, CARRIED):
            d = E @ rub.force
            return all(float(d @ one @ d) > 0.0 for one in C)
        stiffness = np.linalg.inv(C[0]) + np.linalg.inv(C[1])
        return bool(np.linalg.eigvalsh(stiffness + stiffness.T)[0] > 0.0)

    def _stable(self, poses: np.ndarray, spacers: Sequence[Spacer]) -> bool:
        return super()._stable(poses, spacers) and self._held


def across(v: np.ndarray, n: np.ndarray) -> np.ndarray:
    """The part of v (3,) across the unit vector n (3,)."""
    out: np.ndarray = v - (v @ n) * n
    return out
