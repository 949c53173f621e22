# SPDX-License-Identifier: Apache-2.0
"""Coulomb's friction at a free end that rests on something rough, SI.

While it sticks, its section is held where the obstacle takes it. While it slips, friction of mu times the
normal force opposes its slip at the end of the step, as `friction_kernels.lead` tells that from this step and
the one before. Where the cable beside an end that lies touches, too, it bears no force of its own: friction
acts there.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq

from cable_ros.contact.distance import gap
from cable_ros.contact.friction_kernels import ahead, lead_of
from cable_ros.contact.slip_kernels import may_have_slipped

EXCESS = 1e-6
"""Of a force beyond mu N, as a fraction of it, at which an end still sticks."""
STUCK = 1e-12
"""Way, m, below which an end that slips has stuck: rounding."""
STIFFEST = 1e12
"""Friction over the way, in what holds an end elastically, at which it sticks."""


class Slip(NamedTuple):
    """How an end slipped in a step."""

    way: np.ndarray
    """(3,) m, over the obstacle, world."""
    step: float
    """How far the joints moved in it, rad or m."""


class Grip(NamedTuple):
    """How an end rubs on what it rests on."""

    friction: float
    """Coefficient."""
    anchor: np.ndarray
    """(3,) m, world: where it would be now if it had stuck since the last equilibrium."""
    slips: bool
    """Whether it may leave its anchor."""
    slid: np.ndarray
    """(3,) m, its slip in the step before, carried along by the obstacle."""
    ratio: float
    """Length of this step over that of the step before."""

    def origin(self, position: np.ndarray) -> np.ndarray:
        """(3,) m, world: friction at `position` (3,) opposes the way from there.

        It is ahead of the anchor, along the slip in the step before: see `friction_kernels.lead`.
        """
        way, size = position - self.anchor, float(np.linalg.norm(self.slid))
        long = float(np.linalg.norm(way))
        if min(size, long) <= STUCK:
            return self.anchor
        most, _ = lead_of(long, size, self.ratio)
        share = ahead(long, size, float(way @ self.slid) / (size * long), most)
        out: np.ndarray = self.anchor + share * self.slid
        return out

    def missed(self, position: np.ndarray) -> float:
        """How far it may have slipped, m, if it has come to rest within the step; see `slip_missed`."""
        along = float((position - self.anchor) @ self.slid) if self.slips else 0.0
        return float(may_have_slipped(along, float(np.linalg.norm(self.slid)), self.ratio))

    def slips_on(self, position: np.ndarray, push: np.ndarray) -> bool:
        """Whether it slips, by Coulomb's law, at a solution at `position` (3,).

        `push` (3,): the obstacle's force on it across, across and along the normal.
        """
        if self.slips:
            return bool(np.linalg.norm(position - self.anchor) > STUCK)
        return float(np.hypot(push[0], push[1])) > max(self.friction * push[2] * (1.0 + EXCESS), 0.0)


def friction_force(
    friction: float, way: np.ndarray, compliance: np.ndarray, normal: float, relief: np.ndarray
) -> np.ndarray:
    """(2,) force on what holds an end elastically, along the way that it slips under it.

    Under a force f the way is `way` - `compliance` f, and f is along it and as large as the coefficient
    `friction` times the normal force, `normal` - `relief` . f; where less is enough, the end sticks: its way
    is none. With f = k times the way, k is the root of one equation.

    Args:
        friction: coefficient.
        way: (2,) m, without friction.
        compliance: (2, 2) m/N.
        normal: N, without friction.
        relief: (2,).
    """

    def force(k: float) -> np.ndarray:
        out: np.ndarray = k * np.linalg.solve(np.eye(2) + k * compliance, way)
        return out

    def excess(k: float) -> float:
        f = force(k)
        return float(np.linalg.norm(f)) - friction * max(normal - float(relief @ f), 0.0)

    unit = 1.0 / float(np.linalg.norm(compliance))
    if excess(STIFFEST * unit) <= 0.0:
        return np.linalg.solve(compliance, way)
    softest = -np.log(STIFFEST)
    if excess(float(np.exp(2.0 * softest)) * unit) >= 0.0:
        return np.zeros(2)  # it hardly touches
    root = brentq(lambda k: excess(np.exp(k) * unit), 2.0 * softest, -softest, xtol=1e-14)
    return force(float(np.exp(root)) * unit)


def landed(row: np.ndarray, before: np.ndarray, now: np.ndarray) -> np.ndarray:
    """(3,) where a point first touched the obstacle `row` (WIDTH,) on its way from `before` to `now` (3,)."""
    spare = np.empty(3), np.empty((2, 3)), np.empty(2)
    first, last = float(gap(row, before, *spare)), float(gap(row, now, *spare))
    part = 0.0 if first <= 0.0 else first / (first - min(last, 0.0))
    return before + part * (now - before)
