# SPDX-License-Identifier: Apache-2.0
"""The equations of the supports at which a cable turns and slides, and their exact derivatives.

A support shares two things between the pieces on its two sides: the orientation of the section in it, and at
a ring or tube the arc length that is there. With the pieces' energies E_i(pose of both ends, length) an
equilibrium is a stationary point of their sum:

- by a rotation of the section: the moments of both pieces on the support are in balance;
- by the arc length: so are the configurational forces, H = F.t + 1/2 F.C F + 1/2 m.K^-1 m + m.kappa0 on both
  sides, with the internal force F and moment m, the compliance C against shear and tension, the stiffness K
  and the natural strain kappa0. dE/dL = -H, by the unstretched length. As m is the same on both sides of a
  ring, so is the tension F.t of a cable that keeps its length. One that does not has r' = R v, v = t + C F,
  and the force of a ring is across the mean of v on its two sides, for the difference of H is its product
  with that.

A tube holds the direction of the section: the rotation about the tangent alone is free. It takes up bending
moments, and so exerts a force along the cable, by which 1/2 m.K^-1 m differs on its two sides: the
Eshelby-like force of a sliding sleeve (Bigoni, Dal Corso, Bosi and Misseroni 2015).

The derivative of a piece's wrenches by its length follows from its clamp stiffness alone: a piece that goes
on beyond its end as the solution does, dr = R v ds, dR = R [kappa] ds, keeps its shape, and its end wrench
follows the rod's own differential equations.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from cable_ros.compilation import LEAF_ENTRY, njit
from cable_ros.linalg.cross import cross, cross_matrix
from cable_ros.rod import quaternion

TANGENT = np.array([0.0, 0.0, 1.0])
START, END = slice(0, 6), slice(6, 12)
PER = 4
"""Unknowns of a support: rotation of its section about the section's own axes, rad, and arc length, m. Those
that it holds are there, too, and stay."""
LOOSE = 6
"""Unknowns of a loose end: rotations of its section, rad, and lengths, m, see `Loose`."""
NEUTRAL = 1e-6
"""Eigenvalue, over the stiffness of straight pieces, below which a cable may turn freely: its rounding."""
WRENCH = 0.1
"""Weight of a relative change of the wrenches beside a rotation in rad: each may be 1 / 0.1 as inexact."""


class Section(NamedTuple):
    """What a piece is made of; SI."""

    stiffness: np.ndarray
    """(3,) N m^2."""
    natural: np.ndarray
    """(3,) curvature and twist of the unloaded cable, 1/m."""
    compliance: np.ndarray = np.zeros(3)
    """(3,) against shear and tension, 1/N."""


class Ends(NamedTuple):
    """The ends of one piece; SI, along the axes of the sections there."""

    wrenches: np.ndarray
    """(12,) what it exerts on what holds its start, then its end: force and moment."""
    curvatures: np.ndarray
    """(2, 3) curvature and twist, 1/m."""
    forces: np.ndarray
    """(2,) configurational force H, N."""
    strains: np.ndarray
    """(2, 3) derivative v of the position by the unstretched arc length; the tangent if nothing stretches."""
    compliance: np.ndarray
    """(3,) of `Section`."""

    @classmethod
    def of(cls, wrenches: np.ndarray, section: Section) -> Ends:
        """From its wrenches."""
        curvatures, forces, strains = np.empty((2, 3)), np.empty(2), np.empty((2, 3))
        _read_ends(wrenches, *section, curvatures, forces, strains)
        return cls(wrenches, curvatures, forces, strains, section.compliance)

    def wrench(self, which: int) -> np.ndarray:
        """(6,) what it exerts on what holds its start, 0, or its end, 1."""
        return self.wrenches[END if which else START]


@njit(**LEAF_ENTRY)
def onto_mounts(mounts, sections, wrenches, out):  # type: ignore[no-untyped-def]
    """Wrenches (12,) of both ends along the axes of the `sections`, turned into those of the `mounts`: `out`.

    `mounts`, `sections`: (2, 7) poses in the world.
    """
    for i in range(2):
        mount, section = mounts[i], sections[i]
        turn = quaternion.product(
            (mount[6], -mount[3], -mount[4], -mount[5]), (section[6], section[3], section[4], section[5])
        )
        for k in range(6 * i, 6 * i + 6, 3):
            v = (wrenches[k], wrenches[k + 1], wrenches[k + 2])
            out[k], out[k + 1], out[k + 2] = quaternion.turned(turn, v)


@njit(**LEAF_ENTRY)
def _read_ends(wrenches, stiffness, natural, soft, curvatures, forces, strains):  # type: ignore[no-untyped-def]
    """Curvatures (2, 3), configurational forces (2,) and strains (2, 3) from the wrenches (12,); see `Ends`.

    `stiffness`, `natural`, `soft`: fields of `Section`.
    """
    for i, sign in enumerate((1.0, -1.0)):
        forces[i] = sign * wrenches[6 * i + 2]
        for k in range(3):
            strain = soft[k] * sign * wrenches[6 * i + k]
            strains[i, k] = strain + (1.0 if k == 2 else 0.0)
            forces[i] += 0.5 * strain * sign * wrenches[6 * i + k]
            moment = sign * wrenches[6 * i + 3 + k]
            elastic = moment / stiffness[k]
            curvatures[i, k] = elastic + natural[k]
            forces[i] += 0.5 * moment * elastic + moment * natural[k]


class Side(NamedTuple):
    """One piece as its supports see it; SI, along the axes of the sections at its ends."""

    ends: Ends
    response: np.ndarray
    """(12 + 6k, 12 + 6k) derivative of its wrenches, and of those on k obstacles, by their motions."""
    growth: np.ndarray
    """(12 + 6k,) derivative of all of these by its length."""

    @classmethod
    def of(cls, ends: Ends, response: np.ndarray, loads: np.ndarray, by_end: bool) -> Side:
        """With its growth.

        Args:
            ends, response: as the fields.
            loads: (2, 3) load per length along the axes of both ends, N/m.
            by_end: whether it is the end that moves on as the length grows; at an end of any kind but a clamp
                it must be the other one.
        """
        own, sign = (END, 1.0) if by_end else (START, -1.0)
        kappa, v, W = ends.curvatures[int(by_end)], ends.strains[int(by_end)], ends.wrenches[own]
        growth = -sign * response[:, own] @ np.concatenate([v, kappa])
        # the rod's equations in the section's frame: F' = -kappa x F - f, m' = -kappa x m - v x F
        turned = np.concatenate([cross(kappa, W[:3]), cross(kappa, W[3:]) + cross(v, W[:3])])
        growth[own] -= sign * turned
        growth[own][:3] += loads[int(by_end)]
        return cls(ends, response, growth)


class Loose(NamedTuple):
    """A section at an end of the cable that nothing clamps, as its equations see it; SI, section's axes."""

    which: int
    """0: at the start, 1: at the end."""
    motion: np.ndarray
    """(6, 6) translation and rotation of the section by its unknowns: three rotations, three lengths."""
    load: np.ndarray
    """(6,) given force and moment on the cable."""
    bends: np.ndarray
    """(3, 3) Hessian of the gap to what the section rests on, 1/m, by its three lengths, the last of which is
    along the normal; zeros if it touches nothing."""
    by_turn: np.ndarray
    """(6, 3) derivative of the load by rotations of the axes that it is given along, about these, at rest
    itself; zeros at an end that its mount takes along."""
    lies: bool = False
    """Whether its tangent is held in a face, see `System.hessian`."""
    friction: np.ndarray = np.zeros(2)
    """(2,) over the normal force, of what it slips on, along its first two lengths; its direction stays."""

    def push(self, wrench: np.ndarray) -> np.ndarray:
        """(6,) derivative of the energy by its unknowns; the last three are the force that it rests on.

        `wrench` (6,): of the piece on what holds it.
        """
        return -self.motion.T @ (wrench + self.load)

    def residual(self, wrench: np.ndarray) -> np.ndarray:
        """(6,) what must vanish where it is free: `push`, less friction."""
        return self.less_friction(self.push(wrench))

    def less_friction(self, push: np.ndarray) -> np.ndarray:
        """(6,) or (6, n) of `push`, or changes of it."""
        if not self.friction.any():
            return push
        out = push.copy()
        out[3:5] -= np.multiply.outer(self.friction, push[5])
        return out

    def turned(self, wrench: np.ndarray) -> np.ndarray:
        """(6, 6) derivative of the residual by its unknowns with the wrench (6,) held."""
        out, (along, spins) = np.zeros((6, 6)), (self.motion[:3, 3:], self.motion[3:, :3])
        out[3:, :3] = along.T @ cross_matrix(wrench[:3]) @ spins
        out[:3, :3] = -spins.T @ cross_matrix(self.load[3:]) @ spins
        out[3:, 3:] = -self.push(wrench)[5] * self.bends
        return self.less_friction(out)

    def slipping(self, wrench: np.ndarray) -> Loose:
        """With the friction that holds it now; `wrench` as in `push`."""
        push = self.push(wrench)[3:]
        return self._replace(friction=push[:2] / push[2]) if push[2] > 0.0 else self


class System(NamedTuple):
    """The supports' equations about a state of n + 1 pieces, for N = 4 n + 6 m unknowns.

    They are those of n supports, then those of m loose ends.
    """

    residual: np.ndarray
    """(N,) derivative of the energy by the unknowns, less a ring's friction."""
    tangent: np.ndarray
    """(N, N) its derivative."""
    hessian: np.ndarray
    """(N, N) the same of the energy twice along motions that stay on faces: an end that lies and turns about
    the face's normal and about its own tangent would leave the face by half their product, against a moment.
    """
    by_wrenches: np.ndarray
    """(N, 12 (n + 1)) derivative of the residual by the pieces' wrenches."""
    spread: np.ndarray
    """(12 (n + 1) + 6 k, N) derivative of wrenches, also on obstacles, by the unknowns."""


def residual_of(ends: Sequence[Ends], friction: np.ndarray, loose: Sequence[Loose] = ()) -> np.ndarray:
    """`System.residual`; `friction` (n,): coefficient times direction, see `assemble`."""
    out = np.empty(PER * len(friction) + LOOSE * len(loose))
    for i, end in enumerate(loose):
        at = PER * len(friction) + LOOSE * i
        out[at : at + LOOSE] = end.residual(ends[-end.which].wrench(end.which))
    for j, slip in enumerate(friction.tolist()):
        before, after = ends[j], ends[j + 1]
        _at_support(before.wrenches, after.wrenches, before.forces, after.forces, slip, j, out)
        if slip != 0.0 and after.compliance.any():
            out[PER * j + 3] = after.forces[0] - before.forces[1] - across_ring(before, after, slip)[0]
    return out


def across_ring(before: Ends, after: Ends, slip: float = 1.0) -> tuple[float, np.ndarray, np.ndarray]:
    """Force of a ring across the cable times its stretch and `slip`, N, and its derivatives.

    By at most mu times this the configurational forces differ: with the mean v of both sides they differ by
    v.P, P the ring's force, so that v is the direction in which the cable slides, and P is |v x P| / |v|
    across it. The derivatives are (3,), by the force of the piece before the ring, and of that after it.
    """
    total = before.wrenches[6:9] + after.wrenches[:3]
    if not after.compliance.any():
        across = float(np.hypot(total[0], total[1]))
        by_force = slip * np.array([total[0], total[1], 0.0]) / max(across, 1e-300)
        return slip * across, by_force, by_force
    v = 0.5 * (before.strains[1] + after.strains[0])
    lever = cross(v, total)
    across = float(np.linalg.norm(lever))
    unit = slip * lever / max(across, 1e-300)
    by_force, by_strain = cross(unit, v), 0.5 * after.compliance * cross(total, unit)
    return slip * across, by_force - by_strain, by_force + by_strain


@njit(**LEAF_ENTRY)
def _at_support(before, after, forces_before, forces_after, slip, j, out):  # type: ignore[no-untyped-def]
    """The part of `residual_of` that belongs to support j, into `out` (N,).

    `before`, `after`: (12,) wrenches of the pieces on its sides, (2,) configurational forces of these.
    """
    for a in range(3):
        out[PER * j + a] = -(before[9 + a] + after[3 + a])
    push = slip * np.hypot(before[6] + after[0], before[7] + after[1]) if slip != 0.0 else 0.0
    out[PER * j + 3] = forces_after[0] - forces_before[1] - push


def assemble(sides: Sequence[Side], friction: np.ndarray, loose: Sequence[Loose] = ()) -> System:
    """The equations of n supports between n + 1 pieces, and of loose ends.

    Args:
        sides: the pieces, with the same k obstacles.
        friction: (n,) of each ring, mu where the cable slides towards its end, -mu where it slides back, 0
            without friction: the difference of the tensions is that times the force across the cable, see
            `across_ring`.
        loose: the loose ends.
    """
    count, n = len(sides), len(friction)
    obstacles = sides[0].response.shape[0] - 12
    size, unknowns = 12 * count, PER * n + LOOSE * len(loose)
    by_wrenches, spread = np.zeros((unknowns, size)), np.zeros((size + obstacles, unknowns))
    for j, slip in enumerate(friction):
        before, after, at = sides[j], sides[j + 1], PER * j
        end, start = slice(12 * j + 6, 12 * j + 12), slice(12 * j + 12, 12 * j + 18)
        for where, side, which in ((end, before, 1), (start, after, 0)):
            by_wrenches[at : at + 3, where][:, 3:] = -np.eye(3)
            by_wrenches[at + 3, where] = np.concatenate(
                [side.ends.strains[which], side.ends.curvatures[which]]
            )
        if slip:
            slopes = across_ring(before.ends, after.ends, slip)[1:]
            for where, by_force in zip((end, start), slopes, strict=True):
                by_wrenches[at + 3, where][:3] -= by_force
        for i, side, own, sign in ((j, before, END, 1.0), (j + 1, after, START, -1.0)):
            rows = np.r_[12 * i : 12 * i + 12, size : size + obstacles]
            spread[rows, at : at + 3] += side.response[:, own][:, 3:]
            spread[rows, at + 3] += sign * side.growth
    for k, held in enumerate(loose):
        i, own = held.which * (count - 1), END if held.which else START
        place = slice(PER * n + LOOSE * k, PER * n + LOOSE * (k + 1))
        rows = np.r_[12 * i : 12 * i + 12, size : size + obstacles]
        spread[rows, place] += sides[i].response[:, own] @ held.motion
        by_wrenches[place, 12 * i + own.start : 12 * i + own.stop] = held.less_friction(-held.motion.T)
    tangent = by_wrenches @ spread[:size]
    for k, held in enumerate(loose):
        place = slice(PER * n + LOOSE * k, PER * n + LOOSE * (k + 1))
        tangent[place, place] += held.turned(sides[-held.which].ends.wrench(held.which))
    residual = residual_of([side.ends for side in sides], friction, loose)
    hessian = tangent.copy()
    for k, held in enumerate(loose):
        turn, spin = PER * n + LOOSE * k + 1, PER * n + LOOSE * k + 2
        if held.lies:  # the change of the spin's equation by the turn has that, and not the other one
            hessian[turn, spin] = tangent[spin, turn]
    return System(residual, tangent, hessian, by_wrenches, spread)


def judged(tangent: np.ndarray, free: np.ndarray, scale: np.ndarray) -> float:
    """Least eigenvalue of the symmetric part of the tangent at the free unknowns, over `scale`.

    Args:
        tangent: (N, N) of `System`, without friction.
        free: (N,) which unknowns there are.
        scale: (N,) stiffness that belongs to each, N m or N / m.
    """
    root = np.sqrt(scale[free])
    K = tangent[np.ix_(free, free)] / root / root[:, None]
    return float(np.linalg.eigvalsh(0.5 * (K + K.T))[0])


def inverse_but_neutral(tangent: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """(k, k) inverse on what takes up a load: a cable that turns freely stays where it is.

    `tangent` (k, k), `scale` (k,): as in `judged`, at the free unknowns.
    """
    root = np.sqrt(scale)
    U, sizes, V = np.linalg.svd(tangent / root / root[:, None])
    sizes = np.where(sizes > NEUTRAL, sizes, np.inf)
    inverse: np.ndarray = (V.T / sizes) @ U.T / root / root[:, None]
    return inverse


@njit(**LEAF_ENTRY)
def step_size(step, lengths, shortest, spread, wrenches, least):  # type: ignore[no-untyped-def]
    """Of a step: largest rotation, rad, shift over the shortest length, or part of a wrench times `WRENCH`.

    Args:
        step: (N,).
        lengths: (N,) which unknowns are lengths.
        shortest: length of a piece, m.
        spread: (12 (n + 1) or more, N) of `System`; (0, N) if it is not known.
        wrenches: (12 (n + 1),) of the pieces.
        least: (2,) force and moment that count as nothing.
    """
    size = 0.0
    for k in range(step.shape[0]):
        size = max(size, abs(step[k]) / (shortest if lengths[k] else 1.0))
        if step[k] != step[k]:
            return np.nan
    if spread.shape[0] == 0:
        return size
    for kind in range(2):  # force, moment
        change, whole = 0.0, least[kind]
        for i in range(wrenches.shape[0]):
            if i // 3 % 2 == kind:
                v = 0.0
                for k in range(step.shape[0]):
                    v += spread[i, k] * step[k]
                change, whole = max(change, abs(v)), max(whole, abs(wrenches[i]))
        size = max(size, WRENCH * change / whole)
    return size
