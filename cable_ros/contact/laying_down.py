# SPDX-License-Identifier: Apache-2.0
"""How much of a cable comes down beside its clamps in a step, where it lies with friction.

All that comes down in a step slips the same way, and pushes what lies there already as the step as a whole
does. A cable whose end is laid flat comes down ever faster: beside a clamp at the height h above the ground a
cable of the weight w per length is free along l = (72 EI h / w)^1/4. In steps of one length most of it would
land in the last one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cable_ros.contact.points import ARC_LENGTH, FIRST, KIND, LAST, LENGTH, POINT, SAMPLE, WAS

LANDS, MOST = 0.05, 0.1
"""Part of a free span that the next step may lay down, and maximum part that a step may. The error is of
first order in it: with 0.16 in each step a lift's end wrench was 6 % off, with 0.04 it was 1 %."""
FLAT = 4
"""Power of a free span's length with which the height of its clamp goes."""
LITTLE = 5e-3
"""Friction of a free span if it lay, over the end force, up to which it may come down at once."""
SHORTEST_SPAN = 0.02
"""Free span, L, up to which it may, too: about the spacing of the points at which contact is looked for."""


@dataclass(frozen=True)
class Landing:
    """The free spans of a cable beside its clamps before and after a step in which it lies somewhere."""

    before: np.ndarray
    """(2,) lengths from the start and from the end to the nearest contact, L."""
    after: np.ndarray
    """(2,) the same after the step."""
    friction: float
    """Friction that what lies can bear per length, EI / L^3."""

    @classmethod
    def of(cls, before: np.ndarray, after: np.ndarray, possible: np.ndarray) -> Landing | None:
        """In a step from the contact points `before` (k, COLUMNS) to those `after` (m, COLUMNS).

        `possible` (m,): friction that each of these can bear, EI / L^2. Per length that is the median of the
        samples', for one beside a clamp may bear all that holds the cable there. A point that has just begun
        to touch is left out. None if nothing touched before, or nothing lies there.
        """
        samples = after[:, KIND] == SAMPLE
        if not len(before) or not samples.any():
            return None
        friction = float(np.median(possible[samples] / after[samples, LENGTH]))
        known = (after[:, KIND] != POINT) | (after[:, WAS] > 0.0)
        free = _spans(before)
        return cls(free, _spans(after[known], free), friction)

    @property
    def open(self) -> float:
        """Friction, EI / L^2, that the step leaves open: of what landed, in the part of its span that did."""
        landed = np.maximum(self.before - self.after, 0.0)
        return self.friction * float((landed**2 / np.maximum(self.before, 1e-300)).sum())

    def strides(self, force: float) -> tuple[float, float]:
        """By how much a step in the place of this one may be longer, and by how much the next one.

        If the first one is below 1, the step was too long. `force`: the end force, EI / L^2.
        """
        at_once = max(LITTLE * force / max(self.friction, 1e-300), SHORTEST_SPAN)
        counts = (self.before > at_once) & (self.after < self.before)
        if not counts.any():
            return np.inf, np.inf
        left = (self.after[counts] / self.before[counts]) ** FLAT  # of the height
        step = (1.0 - (1.0 - LANDS) ** FLAT) / (1.0 - left)
        again = step[left < (1.0 - MOST) ** FLAT].min(initial=np.inf)
        onward = (step * left)[self.after[counts] > at_once].min(initial=np.inf)
        return float(again), float(onward)


def _spans(points: np.ndarray, free_before: np.ndarray | None = None) -> np.ndarray:
    """(2,) length from each clamp to the nearest contact, L; a patch that ends with a sample reaches it.

    Where the cable was free beside a clamp, `free_before` (2,), and such a patch has come up, the span goes
    on beyond it, to the next contact.
    """
    s, kind = points[:, ARC_LENGTH], points[:, KIND]
    first, last = s.argmin(), s.argmax()
    spans = np.array([s[first], 1.0 - s[last]])
    reaches = np.array([kind[first] == SAMPLE, kind[last] == SAMPLE])
    spans[reaches] = 0.0
    if free_before is not None:
        for side in np.flatnonzero(reaches & (free_before > 0.0)):
            spans[side] = _gap(s if side == 0 else 1.0 - s, kind, LAST if side == 0 else FIRST)
    return spans


def _gap(s: np.ndarray, kind: np.ndarray, end: float) -> float:
    """Length, L, between a patch that reaches a clamp and the next contact; 0 if there is none.

    Args:
        s: (k,) lengths of the contact points from that clamp.
        kind: (k,) their kinds.
        end: the kind of an end of a patch that is far from the clamp.
    """
    reach = s[kind == end].min(initial=np.inf)
    beyond = s[(s > reach) & (kind != SAMPLE)].min(initial=np.inf)
    return float(beyond - reach) if np.isfinite(beyond) else 0.0
