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
    condensed,
    key,
    law,
)
from cable_ros.branch.crossing_newton import (
    EXACT,
    FARTHEST,
    ITERATIONS,
    NOISE,
    ROUNDING,
    SHORTER,
    SLOW,
    STALLED,
    TANGENT,
    WRENCH,
    CrossingNewton,
    Pair,
)
from cable_ros.branch.followed_equilibrium import largest_difference
from cable_ros.branch.rubbing_cable import Hold, RubbingCable
from cable_ros.branch.rubbing_tangent import RubbingTangent
from cable_ros.contact.crossing import FREEDOMS, UNSTABLE, Spacer
from cable_ros.contact.friction_kernels import ROUNDING as EDGE
from cable_ros.contact.friction_kernels import STICK
from cable_ros.linalg.cross import cross
from cable_ros.rod import quaternion
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
FARTHEST_ROLL, FARTHEST_TURN, FAINT = 0.2, 0.12, 0.05
"""Maximum angle, rad, by which a cable rolls in one step, and by which the direction of slip turns; what
friction is less than this fraction of the force on a clamp may turn further."""
FRICTION_LEAST = 2e-4
"""Step, rad or m, that is never too far."""
AT_LIMIT = 1e-4
"""Relative distance of friction from its limit at which it counts as sliding."""


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
        self._pressing: dict[Key, float] = {}  # normal forces there, N
        self._states: dict[Key, int] = {}
        self._of_tangent: list[int] = []  # the states that `_inverse` is of
        self._poses = np.zeros((0, 2, 7))  # of the clamps, in the last attempt
        self._given = 0  # see `_given_way`, of the last tangent
        self._pushes = np.zeros((0, 0))
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
        size, slow, switches, shorter = np.inf, 0, 0, SHORTER  # no step can be made shorter yet
        before, each, changes, known = spacers, np.zeros(0), np.zeros(0), dict(self._forces)
        then = {key(one): one.centres.mean(axis=0) for one in self.spacers}
        moved = {
            key(one): np.tile(one.centres.mean(axis=0) - then[key(one)], (2, 1))
            for one in spacers if key(one) in self._forces
        }  # fmt: skip
        predicted = self._predicted(poses, spacers, dict(self._states))
        if predicted is not None:
            spacers, moved = predicted
        for _ in range(2 * ITERATIONS):
            self.iterations += 1
            self._hold(spacers, moved)
            if not self._all_among(kinematics, joints, poses, spacers):
                return None
            pressed = self._residual(spacers, poses)
            if pressed is None and self.loose and shorter < SHORTER:
                # a step may end beside the contact
                shorter, size, each, changes = shorter + 1, np.inf, 0.5 * each, 0.5 * changes
                spacers = self._moved(before, each, known, changes)
                continue
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
            before, each, shorter = spacers, part * step[:unknowns].reshape(-1, FREEDOMS), 0
            known, changes = dict(self._forces), part * step[unknowns:].reshape(-1, UNKNOWNS)[:, :3]
            spacers = self._moved(before, each, known, changes)
        return None

    def _moved(
        self, spacers: Sequence[Spacer], each: np.ndarray, forces: dict[Key, np.ndarray], changes: np.ndarray
    ) -> list[Spacer]:
        """The spacers after steps (k, FREEDOMS), with these forces after changes (r, 3)."""
        out = [one.moved(own) for one, own in zip(spacers, each, strict=True)]
        rubbing = [one for one in out if key(one) in forces]
        for one, change in zip(rubbing, changes, strict=True):
            self._forces[key(one)] = across(forces[key(one)] + change, one.frame[2])
        return out

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
        if largest_difference(joints, self._joints) <= FRICTION_LEAST:
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
                turned = abs(float(cross(then, rub.force) @ n)) / max(float(np.linalg.norm(then)), 1e-300)
                pull = max(self.cables[i].pull for i in one.cables)
                if turned > FARTHEST_TURN * max(rub.cone, FAINT * pull):
                    return None
        return spacers

    def _accept(self, joints: np.ndarray, pairs: Sequence[Pair], spacers: Sequence[Spacer]) -> None:
        states, forces = self._states, self._forces
        super()._accept(joints, pairs, spacers)
        grips, self._last, self._pressing = {}, {}, {}
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
            self._last[at], self._pressing[at] = (force, state), touches[0].force
        self._grips = grips
        self._inverse = None  # of other sections

    def tangent(self, poses: np.ndarray, carried: bool = True) -> RubbingTangent:
        """The linearised equations about the present equilibria; `carried`: slip goes on the same way."""
        # a step that was tried since may have had other contacts
        self._forces = {key(one): self._last[key(one)][0] for one in self.spacers}
        self._states = {key(one): self._last[key(one)][1] for one in self.spacers}
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
            self._given = 0
            return super()._renew(spacers, poses)
        self.iterations += TANGENT
        grips = {j: self._grips[key(spacers[j])] for j in rubs}
        whole = RubbingTangent(self.cables, self._radii, spacers, poses, rubs, grips).whole()
        system, self._sides = whole
        self._pushes = system.pushed
        self._of_tangent = [rub.state for rub in rubs.values()]
        try:
            self._given = self._given_way(rubs, spacers)
            self._inverse, self._spread = np.linalg.inv(system.tangent), system.spread
            self._modes = condensed(system, FREEDOMS * len(spacers)).modes()
        except np.linalg.LinAlgError:
            return False
        return bool(np.isfinite(self._inverse).all())

    def _given_way(self, rubs: dict[int, Rub], spacers: Sequence[Spacer]) -> int:
        """Number of directions in which the touching points are not at a minimum, spacers at rest.

        Each cable is at one where a spring holds it. Without it, the points give way to forces across the
        normals by the compliances C; those that stick move together, and slip resists a turn of its
        direction.
        """
        assert self._sides is not None
        size = len(self._sides.moved)
        E = np.zeros((4 * len(rubs), size))
        turning, together = np.zeros((len(E), len(E))), []
        for i, (j, rub) in enumerate(rubs.items()):
            frame, at, free = spacers[j].frame[:2], 4 * i, np.zeros((len(E), 4))
            E[at : at + 2, 6 * i : 6 * i + 3] = E[at + 2 : at + 4, 6 * i + 3 : 6 * i + 6] = frame
            free[at : at + 4] = np.eye(4)
            if rub.state in (STICKS, STAYS):
                free = free[:, :2] + free[:, 2:]
            else:
                d = frame @ rub.force / max(float(np.linalg.norm(rub.force)), 1e-300)
                slip = max(float(np.linalg.norm(rub.motion.slip)), rub.cone / rub.stiffness, 1e-300)
                side = np.array([-d[1], d[0]])
                apart = np.concatenate([side, -side])
                turning[at : at + 4, at : at + 4] = rub.cone / slip * np.outer(apart, apart)
            together.append(free)
        C = E @ self._sides.moved[:, -size:] @ E.T
        free = np.hstack(together)
        stiffness = free.T @ (np.linalg.inv(0.5 * (C + C.T)) + turning) @ free
        return int((np.linalg.eigvalsh(stiffness) < 0.0).sum())

    def _is_minimum(self, values: np.ndarray) -> bool:
        unstable = UNSTABLE * (len(values) // FREEDOMS)
        return int((values > 0.0).sum()) + self._given == unstable

    def _predicted(
        self, poses: np.ndarray, spacers: list[Spacer], states: dict[Key, int]
    ) -> tuple[list[Spacer], dict[Key, np.ndarray]] | None:
        """Spacers and how far the points go with the clamps from the last equilibrium, by its tangent.

        The friction changes, too. None: the cables are elsewhere, or there is no tangent.
        """
        there = all(cable.at(known) for cable, known in zip(self.cables, self._kept, strict=True))
        same = [key(one) for one in spacers] == [key(one) for one in self.spacers]
        if not there or not same:
            return None
        now = np.stack([cable.clamps for cable in self.cables])
        motions = np.concatenate([motion(a, b) for a, b in zip(now, poses, strict=True)])
        unknowns, rubbing = FREEDOMS * len(spacers), [key(one) for one in self.spacers if key(one) in states]
        given, known = dict(states), dict(self._forces)
        cones = {at: self.limit * force for at, force in self._pressing.items()}
        yielding: set[Key] = set()
        for _ in range(3):
            self._states = {at: CARRIED if state == SLIPS else STICKS for at, state in states.items()}
            found = self._renew(self.spacers, now)
            if not found or self._inverse is None or self._sides is None:
                self._states, self._forces = given, known
                return None
            step = -self._inverse @ (self._pushes @ motions)
            moved = self._sides.moved[:, : len(step)] @ step + self._sides.carried @ motions
            places = dict(zip(rubbing, moved.reshape(-1, 2, 3), strict=True))
            turned = [
                at for at, (first, second) in places.items()
                if states[at] == SLIPS and self._forces[at] @ (first - second) > 0.0
            ]  # fmt: skip
            forces = {
                at: self._forces[at] + change
                for at, change in zip(rubbing, step[unknowns:].reshape(-1, UNKNOWNS)[:, :3], strict=True)
            }
            beyond = [
                at for at in rubbing
                if states[at] != SLIPS and at not in yielding and np.linalg.norm(forces[at]) > cones[at]
            ]  # fmt: skip
            if not (turned or beyond):
                break
            states = states | dict.fromkeys(turned, STICKS)  # what would slip along its friction turns back
            states = states | dict.fromkeys(beyond, SLIPS)  # and what would stick beyond its limit slips
            yielding |= {*turned, *beyond}
            for at in beyond:
                self._forces[at] = forces[at] * (cones[at] / float(np.linalg.norm(forces[at])))
        self._states = states
        least = min(one.apart for one in spacers)
        part = min(1.0, FARTHEST * least / max(float(np.abs(step[:unknowns]).max()), 1e-300))
        step = part * step
        changes = step[unknowns:].reshape(-1, UNKNOWNS)[:, :3]
        out = self._moved(self.spacers, step[:unknowns].reshape(-1, FREEDOMS), dict(self._forces), changes)
        self._inverse = None
        return out, {at: part * place for at, place in places.items()}


def motion(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """(12,) of two clamps from poses (2, 7) to others: along their own axes, and rotation about these."""
    out = []
    for a, b in zip(before, after, strict=True):
        turn = quaternion.multiply(
            quaternion.conjugate(quaternion.from_ros(a[3:])), quaternion.from_ros(b[3:])
        )
        out += [quaternion.matrix_from_ros(a[3:]).T @ (b[:3] - a[:3]), quaternion.rotation_vector(turn)]
    return np.concatenate(out)


def across(v: np.ndarray, n: np.ndarray) -> np.ndarray:
    """The part of v (3,) across the unit vector n (3,)."""
    out: np.ndarray = v - (v @ n) * n
    return out
