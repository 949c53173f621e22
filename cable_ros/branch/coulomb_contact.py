# SPDX-License-Identifier: Apache-2.0
"""Coulomb friction where two cables touch: its law, and the equations of spacers with it.

Two sections touch at a point p of their surfaces, at the arms a = -r n and r' n from their centrelines, with
the radii r and r' and the normal n from the second to the first. Friction f on the first acts there, -f on
the second: each cable feels a force and the couple a x f. Since the last equilibrium the two points that
touched then have moved by u over each other. With t = f_then - k u across the normal, where f_then turns with
the sections and k is `friction_kernels.STICK`,

    f = t  where |t| <= mu N (stick),    f = mu N t / |t|  else (slip).

All of it turns with a rigid motion of both cables, where u = 0, and p is one point: so friction that sticks
does no work there. It is the law of obstacles (see `friction_kernels`), which act at the centreline.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from cable_ros.branch.crossing_balance import System, touching
from cable_ros.branch.rubbing_cable import Section
from cable_ros.contact.crossing import FREEDOMS, Spacer
from cable_ros.contact.dead_loads import ANSWERS, LOADS
from cable_ros.linalg.cross import cross_matrix

STICKS, SLIPS, STAYS, CARRIED = 0, 1, 2, 3
"""What friction does: stick; slip; stay as it was, turned with the sections, if the shape is only solved more
exactly; slip on in the same direction over the sections, for the derivatives of a result."""
UNKNOWNS = 9
"""Of a contact with friction: changes of the force, and of the couple on each cable beyond its arm's turn."""
Key = tuple[int, int, int, int]
"""Of a spacer: its cables and its slots."""


def key(spacer: Spacer) -> Key:
    """Of a spacer, as long as it is there."""
    return *spacer.cables, *spacer.slots


class Grip(NamedTuple):
    """Two sections that touched at the last equilibrium."""

    arcs: np.ndarray
    """(2,) their arc lengths, m."""
    arms: np.ndarray
    """(2, 3) from their centres to the point where they touched, along their axes, m."""
    friction: np.ndarray
    """(2, 3) on the first cable, along the axes of the one and of the other, N."""

    @classmethod
    def of(
        cls, arcs: np.ndarray, sections: Sequence[Section], normal: np.ndarray, radii: Sequence[float],
        force: np.ndarray,
    ) -> Grip:  # fmt: skip
        """Where two cables touch now, with the friction `force` (3,) on the first."""
        first, second = sections
        # the mean of both surfaces: what they are apart is rounding, and no motion
        point = 0.5 * (first.position - radii[0] * normal + second.position + radii[1] * normal)
        arms = np.stack([one.turn.T @ (point - one.position) for one in sections])
        return cls(arcs, arms, np.stack([one.turn.T @ force for one in sections]))


class Motion(NamedTuple):
    """What has become of a grip."""

    slip: np.ndarray
    """(3,) how far the point of the first cable has moved over that of the second, m."""
    friction: np.ndarray
    """(3,) on the first, turned with the sections, N."""
    levers: np.ndarray
    """(2, 3) arms now, world, m."""
    turned: np.ndarray
    """(2, 3) the friction turned with either section, N."""

    @classmethod
    def of(cls, grip: Grip, sections: Sequence[Section]) -> Motion:
        """With the same two sections now."""
        levers = np.stack([one.turn @ arm for one, arm in zip(sections, grip.arms, strict=True)])
        turned = np.stack([one.turn @ f for one, f in zip(sections, grip.friction, strict=True)])
        first, second = (one.position + lever for one, lever in zip(sections, levers, strict=True))
        return cls(first - second, turned.mean(axis=0), levers, turned)


class Rub(NamedTuple):
    """Friction at a spacer, and what its law needs."""

    force: np.ndarray
    """(3,) on the first cable, across the normal, N."""
    motion: Motion
    normal_force: float
    """N."""
    limit: float
    """Coefficient of friction."""
    stiffness: float
    """Of stick, N/m."""
    state: int
    """STICKS, SLIPS, STAYS or CARRIED."""

    @property
    def cone(self) -> float:
        """Largest possible friction, N."""
        return self.limit * max(self.normal_force, 0.0)

    def trial(self, normal: np.ndarray) -> np.ndarray:
        """(3,) the friction if it sticks, across the `normal` (3,), N."""
        free = self.motion.friction - self.stiffness * self.motion.slip
        out: np.ndarray = free - (free @ normal) * normal
        return out


class Law(NamedTuple):
    """Residual of the law along two directions across the normal, and its derivatives."""

    residual: np.ndarray
    """(2,)."""
    by_force: np.ndarray
    """(2, 3)."""
    by_slip: np.ndarray
    """(2, 3)."""
    by_turned: np.ndarray
    """(2, 3) by the friction turned with the sections."""
    by_normal: np.ndarray
    """(2, 3)."""
    by_normal_force: np.ndarray
    """(2,)."""


def law(rub: Rub, frame: np.ndarray) -> Law:
    """Of friction at a spacer with this `frame` (3, 3), see `Spacer.frame`; N, and m where it sticks."""
    E, n, f, motion = frame[:2], frame[2], rub.force, rub.motion
    nothing, none = np.zeros((2, 3)), np.zeros(2)
    if rub.state == STICKS:
        off = motion.slip + (f - motion.friction) / rub.stiffness
        by = E / rub.stiffness
        return Law(E @ off, by, E, -by, -(n @ off) * E, none)
    if rub.state == STAYS:
        off = f - motion.friction
        return Law(E @ off, E, nothing, -E, -(n @ off) * E, none)
    if rub.state == CARRIED:
        d = f / max(float(np.linalg.norm(f)), 1e-300)
        # the friction turned with the sections has that direction, too
        return Law(E @ (f - rub.cone * d), E, nothing, -E, nothing, -rub.limit * (E @ d))
    free = motion.friction - rub.stiffness * motion.slip
    trial = rub.trial(n)
    size = max(float(np.linalg.norm(trial)), 1e-300)
    d = trial / size
    # Newton's method for |t| f = mu N t, of the same root, is more robust; beyond the cone f is cut to it
    # (Hueeber, Stadler and Wohlmuth 2008)
    cut = f * min(1.0, rub.cone / max(float(np.linalg.norm(f)), 1e-300))
    across = (rub.cone * E - np.outer(E @ cut, d)) / size
    return Law(
        E @ (f - rub.cone * d), E, rub.stiffness * across, -across, (n @ free) * across,
        -rub.limit * (E @ d),
    )  # fmt: skip


class Sides(NamedTuple):
    """What forces on one side alone do, two at each of r contacts with friction."""

    tangent: np.ndarray
    """(size, 6 r) derivative of the equations."""
    spread: np.ndarray
    """(12 n + 6 o, 6 r) derivative of the wrenches."""
    moved: np.ndarray
    """(6 r, size + 6 r) derivative of the places where either cable touches by the unknowns and these."""
    carried: np.ndarray
    """(6 r, 12 n + 6 o) the same by motions of the clamps and obstacles."""


def assemble_with_friction(
    spacers: Sequence[Spacer], radii: Sequence[float], rubs: dict[int, Rub],
    responses: Sequence[np.ndarray], obstacles: int = 0,
) -> tuple[System, Sides]:  # fmt: skip
    """The equations of the spacers, 5 k unknowns, then `UNKNOWNS` for each that rubs; and `Sides`.

    Args:
        spacers: at least one.
        radii: of the cables, m.
        rubs: friction by number of the spacer.
        responses: of each cable, see `rubbing_cable.loaded_response`: of its clamps, the obstacles, all
            spacers that it touches, then the loads of those that rub.
        obstacles: number of obstacles that may move.
    """
    count, own_size, ends = len(responses), FREEDOMS * len(spacers), 12 * len(responses)
    which = {j: own_size + UNKNOWNS * i for i, j in enumerate(rubs)}
    order = {j: 6 * i for i, j in enumerate(rubs)}
    size, known = own_size + UNKNOWNS * len(rubs), 12 + 6 * obstacles
    more = 6 * len(rubs)
    tangent, spread = np.zeros((size, size + more)), np.zeros((ends + 6 * obstacles, size + more))
    moved, carried = np.zeros((more, size + more)), np.zeros((more, len(spread)))
    pushed, held = np.zeros((size, len(spread))), np.zeros((len(spread),) * 2)
    bases = [spacer.basis() for spacer in spacers]
    for i, (own, response) in enumerate(zip(touching(spacers, count), responses, strict=True)):
        rows = np.r_[12 * i : 12 * i + 12, ends : len(spread)]
        slots = 6 * len(own.slots)
        rubbing = [(a, j) for a, j in enumerate(own.spacers) if j in which]
        # motions and loads of this cable by all unknowns
        inputs = np.zeros((slots + LOADS * len(rubbing), size + more))
        for a, j in enumerate(own.spacers):
            inputs[6 * a : 6 * a + 6, FREEDOMS * j : FREEDOMS * j + FREEDOMS] = bases[j]
        for b, (a, j) in enumerate(rubbing):
            side, at = _side(own.spacers, a, spacers[j], i), slots + LOADS * b
            inputs[at : at + 3, which[j] : which[j] + 3] = np.eye(3) if side == 0 else -np.eye(3)
            couple, alone = which[j] + 3 + 3 * side, size + order[j] + 3 * side
            lever = (2.0 * side - 1.0) * radii[i] * spacers[j].frame[2]
            inputs[at : at + 3, alone : alone + 3] = np.eye(3)
            inputs[at + 3 : at + 6, alone : alone + 3] = cross_matrix(lever)
            inputs[at + 3 : at + 6, couple : couple + 3] = np.eye(3)
        by_unknowns, by_motions = response[:, known:] @ inputs, np.zeros((len(response), len(spread)))
        by_motions[:, rows] = response[:, :known]
        held[rows] += by_motions[:known]
        spread[rows] += by_unknowns[:known]
        for a, j in enumerate(own.spacers):
            wrench, motion = known + 6 * a, slice(FREEDOMS * j, FREEDOMS * j + FREEDOMS)
            tangent[motion] += bases[j].T @ by_unknowns[wrench : wrench + 6]
            pushed[motion] += bases[j].T @ by_motions[wrench : wrench + 6]
        for b, (a, j) in enumerate(rubbing):
            side = _side(own.spacers, a, spacers[j], i)
            first, force = known + slots + ANSWERS * b, known + 6 * a
            terms = _terms(rubs[j], spacers[j], radii, side)
            to = order[j] + 3 * side
            lever = (2.0 * side - 1.0) * radii[i] * spacers[j].frame[2]
            for out, by in ((moved, by_unknowns), (carried, by_motions)):
                out[to : to + 3] = by[first : first + 3] - cross_matrix(lever) @ by[first + 3 : first + 6]
            for out, by in ((tangent, by_unknowns), (pushed, by_motions)):
                out[which[j] : which[j] + UNKNOWNS] += (
                    terms[:, :ANSWERS] @ by[first : first + ANSWERS]
                    + terms[:, ANSWERS:] @ by[force : force + 3]
                )
    for j, at in which.items():
        _explicit(rubs[j], spacers[j], radii, tangent[at : at + UNKNOWNS], FREEDOMS * j, at)
    whole = System(tangent[:, :size], spread[:, :size], pushed, held)
    return whole, Sides(tangent[:, size:], spread[:, size:], moved, carried)


def _side(spacers: Sequence[int], a: int, spacer: Spacer, cable: int) -> int:
    """Whether the a-th contact of a cable is on the first side of its spacer, 0, or on the second, 1."""
    if spacer.of_itself:
        return int(spacers[a] in spacers[:a])
    return int(spacer.cables[1] == cable)


def _terms(rub: Rub, spacer: Spacer, radii: Sequence[float], side: int) -> np.ndarray:
    """(UNKNOWNS, ANSWERS + 3) of the equations of friction by a cable's answers and its normal force."""
    n, sign = spacer.frame[2], 1.0 - 2.0 * side
    own, out = law(rub, spacer.frame), np.zeros((UNKNOWNS, ANSWERS + 3))
    out[:2, 6:9] = sign * own.by_slip
    out[:2, 9:12] = -sign * own.by_slip @ cross_matrix(rub.motion.levers[side])
    friction = rub.force if rub.state == CARRIED else rub.motion.turned[side]
    out[:2, 9:12] -= 0.5 * own.by_turned @ cross_matrix(friction)
    # both press with the same force; that on the spacer is against the normal on the first side
    out[:2, ANSWERS:] = -0.5 * sign * np.outer(own.by_normal_force, n)
    arm, force = -sign * radii[spacer.cables[side]] * n, sign * rub.force
    couple = slice(3 + 3 * side, 6 + 3 * side)
    # (turn x arm) x force
    out[couple, 3:6] = cross_matrix(force) @ cross_matrix(arm)
    return out


def _explicit(
    rub: Rub, spacer: Spacer, radii: Sequence[float], rows: np.ndarray, motion: int, at: int
) -> None:
    """Add what the unknowns themselves do in the equations of friction `rows` (UNKNOWNS, size).

    motion, at: numbers of the first unknown of the spacer's motion, and of its friction.
    """
    frame = spacer.frame
    own, n, f = law(rub, frame), frame[2], rub.force
    by_motion = np.zeros((3, FREEDOMS))  # of the normal
    by_motion[:, 3:] = -cross_matrix(n) @ frame[:2].T / spacer.apart
    to = slice(motion, motion + FREEDOMS)
    rows[:2, at : at + 3] += own.by_force
    rows[:2, to] += own.by_normal @ by_motion
    rows[2, at : at + 3] += n
    rows[2, to] += f @ by_motion
    for side in range(2):
        radius, couple = radii[spacer.cables[side]], slice(3 + 3 * side, 6 + 3 * side)
        rows[couple, at + 3 + 3 * side : at + 6 + 3 * side] += np.eye(3)
        # arm = - sign radius n, force = sign f: the signs cancel in their product
        rows[couple, at : at + 3] += radius * cross_matrix(n)
        rows[couple, to] -= radius * cross_matrix(f) @ by_motion


def condensed(system: System, size: int) -> System:
    """The equations of the first `size` unknowns, the others as these ask for."""
    A, B = system.tangent[:size, :size], system.tangent[:size, size:]
    C, D = system.tangent[size:, :size], system.tangent[size:, size:]
    answer = np.linalg.solve(D, np.hstack([C, system.pushed[size:]]))
    by_motion, by_push = answer[:, :size], answer[:, size:]
    rest = system.spread[:, size:]
    return System(
        A - B @ by_motion, system.spread[:, :size] - rest @ by_motion,
        system.pushed[:size] - B @ by_push, system.held - rest @ by_push,
    )  # fmt: skip
