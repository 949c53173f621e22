# SPDX-License-Identifier: Apache-2.0
"""What is known of how a cable came to its equilibrium: losses of its branch, snaps not told yet."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cable_ros.branch.cold_start import Conditions, Found, equilibria
from cable_ros.branch.continuation import Fall
from cable_ros.contact.distance import POSE
from cable_ros.equilibrium import Status

ASK = 0.1
"""Relative motion of the clamps, parts of the length or rad, between two searches for other equilibria."""
ALIKE = 1e-2
"""Relative difference of energy and end moment below which a coarse search has found the same equilibrium."""
TOLD = 3
"""Number of snaps that one message describes."""
BY_RULE = ", to the side of two that a small load along (-1, 3, 2) of the start clamp's axes takes"
REMEDY = (
    "It is known again once the cable touches nothing and has no other equilibrium near, or once every "
    "contact is a point and slips; until then, call reset (of the node: ~/reset) to take the equilibrium "
    "of a cold start."
)


@dataclass(frozen=True)
class Loss:
    """The tracked equilibrium may not be the cable's: why, and what has happened since.

    Friction in stick is what the past has left there; friction in slip is not. When every contact point
    slips, friction no longer depends on what was forgotten, provided that the real cable slips, too. Take the
    motion up to the onset of slip, from friction that was taken to be zero: from the opposite limit of the
    friction cone the real cable needs at most twice that motion. Hence everything must go on slipping for as
    long a motion as came before.
    """

    told: str
    """What happened, a clause."""
    history: bool
    """Whether friction's history was forgotten."""
    stuck: float = 0.0
    """Relative motion of clamps and obstacles since, up to and with the onset of slip everywhere."""
    slid: float = -1.0
    """The same since that onset; negative: something sticks."""
    joints: tuple[float, ...] = ()
    """Joint values where the branch was last known; none: nowhere."""
    twist: float = np.nan
    """Total twist there, rad."""
    unasked: float = np.inf
    """The same since other equilibria were last looked for."""

    def followed(self, motion: float, slips: bool, step: bool) -> Loss:
        """After a `motion` to a pose where every contact point `slips`, or not; by one `step` or a walk."""
        unasked = self.unasked + motion
        if slips and step and self.slid >= 0.0:
            return replace(self, slid=self.slid + motion, unasked=unasked)
        stuck = self.stuck + max(self.slid, 0.0) + motion
        return replace(self, stuck=stuck, slid=0.0 if slips else -1.0, unasked=unasked)

    @property
    def forgotten(self) -> bool:
        """Whether friction no longer depends on what was lost."""
        return self.history and self.slid >= self.stuck > 0.0

    @property
    def due(self) -> bool:
        """Whether to look for other equilibria, which takes as long as a cold start."""
        return self.unasked >= ASK

    @property
    def message(self) -> str:
        """What a result says."""
        return f"{Status.BRANCH_LOST.sentence[:-1]} ({self.told}). {REMEDY}"


@dataclass(frozen=True)
class Memory:
    """Friction came from a grid of contacts, and is as exact as that: how exact, and what has happened since."""

    error: float
    """Relative error of the end wrench."""
    since: Loss = Loss("", history=True)
    """The motion since, as after a loss."""

    def followed(self, motion: float, touches: bool, slips: bool, step: bool) -> Memory | None:
        """As `Loss.followed`; None once friction no longer depends on that."""
        since = self.since.followed(motion, slips, step)
        return None if since.forgotten or not touches else Memory(self.error, since)


@dataclass(frozen=True)
class Standing:
    """How the present equilibrium was come by."""

    loss: Loss | None = None
    snaps: tuple[Fall, ...] = ()
    """The last of the snaps through folds that no result has told yet, at most TOLD."""
    more: int = 0
    """Number of such snaps before these."""
    waiting: tuple[tuple[float, ...], ...] = ()
    """Joint values of the poses that were asked for and not reached yet: friction depends on the path."""

    def lost(self, told: str, history: bool, joints: np.ndarray, twist: float | None) -> Standing:
        """After a loss at `joints` (n,), where it had that twist; what was unknown before stays told."""
        before = self.loss
        if before is not None:
            return Standing(Loss(told, history or before.history, joints=before.joints, twist=before.twist))
        if twist is None:
            return Standing(Loss(told, history))
        return Standing(Loss(told, history, joints=tuple(joints.tolist()), twist=twist))

    def snapped(self, fall: Fall) -> Standing:
        """After a fall through a fold."""
        if self.loss is not None:
            return self
        snaps = (*self.snaps, fall)
        return Standing(None, snaps[-TOLD:], self.more + max(0, len(snaps) - TOLD))

    def asked(self, here: np.ndarray, joints: np.ndarray) -> Standing:
        """After another pose, `joints` (n,), was asked for and not reached; the cable is `here` (n,)."""
        route = [tuple(here.tolist()), *self.waiting]
        while len(route) > 1 and passes(np.array(route[-2]), np.array(route[-1]), joints):
            route.pop()  # it is on the straight path to the next
        return replace(self, waiting=(*route[1:], tuple(joints.tolist())))

    def story(self, unit: float) -> str:
        """The message of a snap; `unit`: of energy, J."""
        parts = [
            f"total twist {s.twist_before:.3f} -> {s.twist_after:.3f} rad,"
            f" energy {s.energy_before * unit:.4g} -> {s.energy_after * unit:.4g} J"
            f" at {100 * s.at:.4g} % of the step{BY_RULE if s.crossed else ''}"
            for s in self.snaps
        ]
        before = f"{self.more} times before; " if self.more else ""
        return f"{Status.SNAPPED.sentence[:-1]} ({before}{'; '.join(parts)})."


def passes(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> bool:
    """Whether the straight way from a to c, joint values (n,), leads through b."""
    first, whole = b - a, c - a
    size = float(whole @ whole)
    part = float(first @ whole) / size if size > 0.0 else 0.0
    off = np.abs(first - part * whole).max(initial=0.0)
    return bool(0.0 <= part <= 1.0 and off <= 1e-9 * (1.0 + np.abs(c).max(initial=0.0)))


def motion(a: Conditions, b: Conditions) -> float:
    """How far clamps, obstacles and weight have moved relative to the start clamp, lengths or rad."""
    turned = 2.0 * min(np.abs(a.qe - b.qe).max(), np.abs(a.qe + b.qe).max())
    weighed = np.abs(a.f - b.f).max() / (1.0 + np.linalg.norm(a.f))
    out = max(float(np.abs(a.re - b.re).max()), float(turned), float(weighed))
    if a.obstacles is not None and b.obstacles is not None:
        # centre and axes of each obstacle
        out = max(out, float(np.abs(a.obstacles[:, POSE] - b.obstacles[:, POSE]).max()))
    return out


def alone(
    here: Found, stiffness: np.ndarray, natural: np.ndarray, compliance: np.ndarray | None, tolerance: float
) -> bool:
    """Whether a search finds no other equilibrium without contact within half a turn of twist.

    A cable that touches nothing is held by its clamps alone. Its equilibria differ by about whole turns,
    of which a cold start takes the nearest to the last one, or they are mirror images and the like, of
    which nothing tells the right one. What a real cable is caught on is not known here, either.
    """
    rod, moment = here.rod, here.rod.g[-1].copy()
    size = float(np.linalg.norm(moment))
    free = Conditions(rod.qe, rod.re, rod.f)
    for other in equilibria(stiffness, natural, free, here.twist, tolerance, True, compliance):
        if abs(other.twist - here.twist) >= np.pi:
            continue
        turned = float(np.linalg.norm(other.rod.g[-1] - moment)) > ALIKE * (1.0 + size)
        if turned or abs(other.energy - here.energy) > ALIKE * (1.0 + abs(here.energy)):
            return False
    return True
