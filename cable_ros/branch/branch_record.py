# SPDX-License-Identifier: Apache-2.0
"""Whether a cable's branch is known: its loss, snap-throughs not reported yet, poses not reached yet."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cable_ros.branch.cold_start import Conditions, Found, Sought, Starts
from cable_ros.branch.snap_through import SnapThrough
from cable_ros.contact.distance import POSE
from cable_ros.contact.nodal_twin import FADING, STEP
from cable_ros.equilibrium import Status
from cable_ros.rod.ends import Ends

SEARCH_INTERVAL = 0.1
"""Minimum motion of the clamps, L or rad, between two searches for other equilibria."""
SEARCH_WORK = 150_000.0
"""Maximum work of each, iterations times unknowns, about 300 ms: where it is not over, others may be near."""
ALIKE = 1e-2
"""Maximum relative difference of energy and end moment of one equilibrium, found twice by coarse searches."""
MOST_REPORTED = 3
"""Maximum number of snap-throughs that one message describes."""
BY_RULE = ", to the side of two mirror images that a rule takes, not the robot"
TURNED = ", where it was free to turn"
FORKED = "; its branch forked at {:.4g} % of the step" + BY_RULE + "."
REMEDY = (
    "It is known again once the cable touches nothing and has no other equilibrium near, or once every "
    "contact is a point and slips, if there was one equilibrium only; until then, call reset (of the node: "
    "~/reset) to take that of a cold start."
)


@dataclass(frozen=True)
class Loss:
    """Why the tracked equilibrium may not be the cable's, and how it has moved since.

    Friction in stick depends on the past; friction in slip does not. Once every contact point slips, friction
    no longer depends on the forgotten history, if the real cable slips, too. The tracked cable started from
    zero friction and slips after some motion. The real one, at worst from the opposite limit of the friction
    cone, slips after at most twice that motion. Hence all points must go on slipping for as long a motion.
    Where across its slip a point is depends on the past all the same: see `PathError.of_slip`.
    """

    cause: str
    """A clause."""
    history: bool
    """Whether friction's history was forgotten."""
    several: bool = False
    """Whether the cold start after it found several equilibria: slip does not tell which is the cable's."""
    before_slip: float = 0.0
    """Relative motion of clamps and obstacles since then, up to the onset of slip at every point."""
    since_slip: float = -1.0
    """Relative motion since that onset; negative: some point sticks."""
    joints: tuple[float, ...] = ()
    """Joint values where the branch was last known; empty: nowhere."""
    twist: float = np.nan
    """Total twist there, rad."""
    since_search: float = np.inf
    """Relative motion since the last search for other equilibria."""
    remedy: str = REMEDY
    """When it is known again, a sentence."""

    def after_motion(self, motion: float, slips: bool, step: bool) -> Loss:
        """After a `motion`, in one `step` or several, to a pose where every contact point `slips`, or not."""
        since_search = self.since_search + motion
        if slips and step and self.since_slip >= 0.0:
            return replace(self, since_slip=self.since_slip + motion, since_search=since_search)
        # some point sticks or has just begun to slip, maybe within the step: the count starts again
        before_slip = self.before_slip + max(self.since_slip, 0.0) + motion
        return replace(
            self, before_slip=before_slip, since_slip=0.0 if slips else -1.0, since_search=since_search
        )

    @property
    def resolved(self) -> bool:
        """Whether friction no longer depends on the lost history, and nothing else was lost."""
        return self.history and not self.several and self.since_slip >= self.before_slip > 0.0

    @property
    def search_due(self) -> bool:
        """Whether to search for other equilibria, which takes as long as a cold start."""
        return self.since_search >= SEARCH_INTERVAL

    @property
    def message(self) -> str:
        """Of a result."""
        return f"{Status.BRANCH_LOST.sentence[:-1]} ({self.cause}). {self.remedy}"


@dataclass(frozen=True)
class GridHistory:
    """Friction's history that was computed on a grid of contacts."""

    error: float
    """Its relative error of the end wrench."""

    def after_motion(self, motion: float, touches: bool) -> GridHistory | None:
        """After a `motion`, L or rad, to a pose where it `touches`; None where it does not.

        The error fades as on a grid whose steps are as long as they may be. That every contact slips ends it
        no sooner: where across its slip a point is depends on the past, too.
        """
        return GridHistory(self.error * FADING ** (motion / STEP)) if touches else None


@dataclass(frozen=True)
class BranchRecord:
    """Whether the branch of the present equilibrium is known, and what has to be reported of it."""

    loss: Loss | None = None
    snaps: tuple[SnapThrough, ...] = ()
    """The last snap-throughs at folds that no result has reported yet, at most MOST_REPORTED."""
    earlier: int = 0
    """Number of such snap-throughs before these."""
    fork: float | None = None
    """Fraction of the step at which the branch forked, if no result has reported that yet."""
    waiting: tuple[tuple[float, ...], ...] = ()
    """Joint values of the poses asked for and not reached yet: friction depends on the path."""

    def after_loss(
        self, cause: str, history: bool, joints: np.ndarray, twist: float | None, several: bool = False
    ) -> BranchRecord:
        """After a loss at `joints` (n,) with total twist `twist`, rad; an earlier loss keeps its pose."""
        before = self.loss
        if before is not None:
            history, several = history or before.history, several or before.several
            return BranchRecord(Loss(cause, history, several, joints=before.joints, twist=before.twist))
        if twist is None:
            return BranchRecord(Loss(cause, history, several))
        return BranchRecord(Loss(cause, history, several, joints=tuple(joints.tolist()), twist=twist))

    def after_snap(self, snap: SnapThrough) -> BranchRecord:
        """After a snap-through at a fold."""
        if self.loss is not None:
            return self
        snaps = (*self.snaps, snap)
        return BranchRecord(None, snaps[-MOST_REPORTED:], self.earlier + max(0, len(snaps) - MOST_REPORTED))

    def after_fork(self, at: float) -> BranchRecord:
        """After the branch has forked at a fraction of a step."""
        return self if self.loss is not None else replace(self, fork=at)

    def with_waiting(self, here: np.ndarray, joints: np.ndarray) -> BranchRecord:
        """After another pose, `joints` (n,), was asked for and not reached; the cable is `here` (n,)."""
        route = [tuple(here.tolist()), *self.waiting]
        while len(route) > 1 and passes(np.array(route[-2]), np.array(route[-1]), joints):
            route.pop()  # it is on the straight path to the next
        return replace(self, waiting=(*route[1:], tuple(joints.tolist())))

    def snap_message(self, unit: float) -> str:
        """The message of snap-throughs; `unit`: of energy, J."""
        parts = [
            f"total twist {s.twist_before:.3f} -> {s.twist_after:.3f} rad,"
            f" energy {s.energy_before * unit:.4g} -> {s.energy_after * unit:.4g} J"
            f" at {100 * s.at:.4g} % of the step{TURNED if s.turned else ''}{BY_RULE if s.crossed else ''}"
            for s in self.snaps
        ]
        before = f"{self.earlier} times before; " if self.earlier else ""
        return f"{Status.SNAPPED.sentence[:-1]} ({before}{'; '.join(parts)})."


def passes(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> bool:
    """Whether the straight path from a to c, joint values (n,), passes through b."""
    first, whole = b - a, c - a
    size = float(whole @ whole)
    fraction = float(first @ whole) / size if size > 0.0 else 0.0
    off = np.abs(first - fraction * whole).max(initial=0.0)
    return bool(0.0 <= fraction <= 1.0 and off <= 1e-9 * (1.0 + np.abs(c).max(initial=0.0)))


def relative_motion(a: Conditions, b: Conditions) -> float:
    """Largest motion of clamps, obstacles and weight relative to the start clamp, L or rad."""
    turned = 2.0 * min(np.abs(a.qe - b.qe).max(), np.abs(a.qe + b.qe).max())
    weighed = np.abs(a.f - b.f).max() / (1.0 + np.linalg.norm(a.f))
    out = max(float(np.abs(a.re - b.re).max()), float(turned), float(weighed))
    if a.obstacles is not None and b.obstacles is not None:
        # centre and axes of each obstacle
        out = max(out, float(np.abs(a.obstacles[:, POSE] - b.obstacles[:, POSE]).max()))
    return out


def is_unique(
    here: Found, stiffness: np.ndarray, natural: np.ndarray, compliance: np.ndarray | None, tolerance: float,
    ends: Ends | None = None,
) -> bool:  # fmt: skip
    """Whether a search finds no other equilibrium within half a turn of twist.

    The equilibria of a cable without contact differ by about whole turns of twist, and a cold start takes the
    nearest to the last one; or they are mirror images and the like, of which nothing decides. Nor does
    anything tell whether the cable is caught on an obstacle. Those outside the scene are not known here.

    Args:
        here: an equilibrium without contact.
        stiffness, natural, compliance, tolerance, ends: see `cold_start.Sought`.
    """
    rod, moment = here.rod, here.rod.reactions().copy()
    size = float(np.linalg.norm(moment))

    def other(one: Found) -> bool:
        if abs(one.twist - here.twist) >= np.pi:
            return False
        turned = float(np.linalg.norm(one.rod.reactions() - moment)) > ALIKE * (1.0 + size)
        return turned or abs(one.energy - here.energy) > ALIKE * (1.0 + abs(here.energy))

    # those without contact are many times as quick to find
    for obstacles in (None,) if rod.obstacles is None else (None, rod.obstacles):
        conditions = Conditions(rod.qe, rod.re, rod.f, obstacles)
        sought = Sought(stiffness, natural, conditions, here.twist, tolerance, compliance, ends)
        search, work = Starts(sought, thorough=True), SEARCH_WORK
        while not search.over and work > 0.0 and not any(map(other, search.found)):
            work -= search.descend()
        if not search.over or any(map(other, search.found)):
            return False
    return True
