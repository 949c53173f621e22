# SPDX-License-Identifier: Apache-2.0
"""What a rod with contact points remembers of friction from step to step, and how far friction lets it go."""

from __future__ import annotations

import math

import numpy as np

from cable_ros.contact.detection import RESTING
from cable_ros.contact.fixed_set import FixedSetRod
from cable_ros.contact.friction_kernels import COULOMB, FRICTIONLESS, SLIDING
from cable_ros.contact.laying_down import Landing
from cable_ros.contact.patches import SAMPLES
from cable_ros.contact.path_error import NONE, STILL, PathError
from cable_ros.contact.points import (
    ARC_LENGTH,
    BEFORE,
    FIRST,
    FORCE,
    FRICTION,
    KIND,
    LAST,
    LENGTH,
    NEAR_LIMIT,
    NUMBER,
    OBSTACLE,
    POINT,
    SAMPLE,
    SLIPS,
)
from cable_ros.contact.rough_points import bearable_friction, touches_rough
from cable_ros.contact.slip_kernels import farthest_roll, has_new_point, slip_bend, slip_change, slip_missed
from cable_ros.contact.travel import (
    CONTACT_STEP,
    FORCE_BEND,
    FORCE_CHANGE,
    FRICTION_STEP,
    LANDING_CHANGE,
    LYING_CHANGE,
    LYING_STEP,
    POINTS_CHANGE,
    ROLLED,
    SHORTER,
    SLIP_MISSED,
    TAUT,
    TAUT_CHANGE,
    TAUT_FORCE_CHANGE,
    stride,
)
from cable_ros.rod import quaternion
from cable_ros.rod.elements import Mesh
from cable_ros.rod.units import norm

SHORT_STEP = 1e-3
"""Length of a step, L, below which what sticks along a patch is firmer."""
STIFF_FORCE = 160.0
"""End force, EI / L^2, above which it is, too: a taut cable resists its clamps with about 2 F^1.5, EI / L^3,
here as much as `BEDDING` allows for. At 7e4 an end force was a quarter too small, in whatever steps."""


class FrictionalRod(FixedSetRod):
    """A `FixedSetRod` whose contact points are those of a step with friction."""

    onward: float = np.inf
    """By how much the next step may be longer than the last one, as what comes down beside a clamp allows."""

    @property
    def frictional(self) -> bool:  # type: ignore[override]
        """Whether it touches something with friction."""
        if self.model == FRICTIONLESS or self.obstacles is None:
            return False
        return bool(touches_rough(self.points, self.count, self.obstacles))

    @property
    def lies(self) -> bool:  # type: ignore[override]
        """Whether it lies along an obstacle with friction."""
        if self.model != COULOMB or not self.has_patch:
            return False
        return bool((self._on_rough() & (self.points[: self.count, KIND] != POINT)).any())

    @property
    def sticks_at_point(self) -> bool:  # type: ignore[override]
        """Whether it sticks to something where it touches at a point."""
        points = self.points[: self.count]
        return bool((self._on_rough() & (points[:, KIND] == POINT) & (points[:, SLIPS] == 0.0)).any())

    @property
    def rubbed(self) -> np.ndarray:
        """(m,) see `Rod.rubbed`."""
        out, points = super().rubbed, self.points[: self.count]
        if self.lies:
            out[points[points[:, LENGTH] > 0.0, NUMBER].astype(int) // SAMPLES] = True
        return out

    @property
    def all_slip(self) -> bool:  # type: ignore[override]
        points = self.points[: self.count]
        return bool((points[:, SLIPS] == 1.0).all() and (points[:, KIND] == POINT).all())

    @property
    def replaceable(self) -> bool:  # type: ignore[override]
        """Whether a grid can take its place: not with mobilised friction, which a grid does not have."""
        return self.model != SLIDING

    @property
    def longest_step(self) -> float:  # type: ignore[override]
        if self.model == FRICTIONLESS:
            return CONTACT_STEP
        return LYING_STEP if self.lies and not self.creeps else FRICTION_STEP

    def use_friction(self, model: int) -> None:
        if self.model != model:
            self.model, self.ready = model, False

    def _slip_on(self, before: np.ndarray) -> None:
        """Let slip, for the next step, what slipped `before` (k, COLUMNS) and is still near its limit.

        A solve in which nothing moves takes almost all of it to stick, by rounding. From there the next step
        does not find back if a patch slips.
        """
        points = self.points[: self.count]
        if self.model != COULOMB or self.creeps or not len(before) or not len(points):
            return
        away = np.abs(points[:, None, ARC_LENGTH] - before[None, :, ARC_LENGTH])
        away[points[:, None, OBSTACLE] != before[None, :, OBSTACLE]] = np.inf
        nearest = away.argmin(axis=1)
        slipped = (before[nearest, SLIPS] == 1.0) & (before[nearest, OBSTACLE] == points[:, OBSTACLE])
        friction = np.linalg.norm(points[:, FRICTION:BEFORE], axis=1)
        cone = self._coefficients() * points[:, FORCE]
        begins = slipped & (points[:, SLIPS] == 0.0) & (cone > 0.0) & (friction > NEAR_LIMIT * cone)
        if begins.any():
            points[begins, SLIPS] = 1.0
            self.ready = False  # the factors are those of what sticks

    def landing(self, before: np.ndarray) -> Landing | None:
        """What has come down since its contact points were `before` (k, COLUMNS), if it lies on anything."""
        if self.creeps or not self.lies:
            return None
        coefficients, points = self._coefficients(), self.points[: self.count]
        rough = coefficients > 0.0
        possible = coefficients[rough] * points[rough, FORCE]
        return Landing.of(before[self._coefficients(before) > 0.0], points[rough], possible)

    def follow(
        self, distance: float, before: np.ndarray, after: np.ndarray, landing: Landing | None = None
    ) -> None:
        """Add a step of `distance`, L, to the `PathError`.

        Args:
            distance: its length, L.
            before, after: (3,) the end force.
            landing: what came down in it.
        """
        if self.model != COULOMB or not self.frictional:
            self.followed = NONE
        elif self.lies and not self.creeps:
            left_open = 0.0 if landing is None else landing.open
            self.followed = self.followed.after_step(
                distance, before, after, self._possible_friction(), left_open
            )
        elif not self.has_patch:
            self.followed = self.followed.after_slip(distance, self.unforeseen, self._possible_friction())
        if self.followed.unknown:
            self.followed = self.followed.known_but_for(self._possible_friction(held=True))

    def follow_fall(self, before: np.ndarray, after: np.ndarray) -> None:
        """Add a fall from one end force to another, (3,), to the `PathError`."""
        if self.model != COULOMB or not self.frictional:
            self.followed = NONE
        else:
            self.followed = self.followed.after_fall(before, after, self._possible_friction())

    @property
    def holds_unknown(self) -> bool:
        return self.followed.unknown > self.followed.error

    def follow_nothing(self) -> None:
        """Add a part of the path that could not be followed to the `PathError`."""
        if self.model == COULOMB and self.frictional:
            self.followed = self.followed.not_followed(self._possible_friction())

    def slip_anew(self) -> None:
        """Let the `PathError` be that of what slips after all was unknown."""
        if self.model == COULOMB and self.frictional:
            self.followed = PathError.of_slip(self._possible_friction())

    def _possible_friction(self, held: bool = False) -> float:
        """Sum of the friction that its contacts can bear, EI / L^2; `held`: those that stick.

        Those at a clamp are left out: they may press as hard as they like, and hold what it holds anyway.
        """
        if self.obstacles is None:
            return 0.0
        return float(bearable_friction(self.points, self.count, self.obstacles, RESTING, held))

    def path_error(self, F: np.ndarray) -> float:
        error = self.followed.of_force
        return error / max(norm(F), self.least, 1e-3) if error else 0.0

    def _set_bedding(self, distance: float, F: np.ndarray) -> None:
        """Let what sticks along a patch yield in proportion to a short step, by its length, L.

        A cable that is laid flat moves ever less along itself; where it yielded as much, 5 % of its end force
        was missing. And the less, the more a cable resists its clamps; that is by the larger of their
        forces, for that at the end, F (3,), is none where it is free.
        """
        if distance == 0.0 or self.creeps:
            return
        pull = max(norm(F), norm(self.start_force(F)))
        firmer = max(1.0, SHORT_STEP / distance) * max(1.0, pull / STIFF_FORCE) ** 1.5
        bedding = self.softest_bedding * 4.0 ** round(math.log(firmer, 4.0))
        if bedding != self.bedding:
            self.bedding, self.ready = bedding, False

    def _rotated(self, q: np.ndarray, q_new: np.ndarray, mesh: Mesh | None = None) -> float:
        """Largest rotation of a section, rad, from q to q_new, (n, 4), whose nodes have moved along.

        `mesh`: that of q, if it is not the present one.
        """
        then, now = self.mesh if mesh is None else mesh, Mesh(self.mesh.element, self.h.copy())
        before = then.interpolate(q, now.nodes)
        return quaternion.largest_rotation(before, q_new)

    def _friction_stride(
        self, F: np.ndarray, q_new: np.ndarray, F_new: np.ndarray, obstacles: np.ndarray, before: np.ndarray,
        distance: float, hard: bool,
    ) -> float:  # fmt: skip
        """By how much the next step may be longer than one that ended at (q_new, F_new); see `travel.stride`.

        Args:
            F, q_new, F_new: the end force (3,) before, the new shape (n, 4) and end force.
            obstacles: as in `distance.gap`.
            before: (k, COLUMNS) contact points before. What comes down slips the way that it did in all of
                the step.
            distance: its length, L.
            hard: whether it was hard to solve: at points alone some may have slipped on its way that stick.
        """
        force = norm(F_new)
        slack = force < TAUT and not self.creeps  # near taut its force changes in any step
        most = (LYING_CHANGE if slack else TAUT_CHANGE) if self.has_patch else POINTS_CHANGE
        longest = stride(self._friction_change(q_new, F_new, obstacles, most), most)
        missed = slip_missed(self.points, self.count, distance)
        stopped = missed > 0.0
        # maybe in the place of one that was dropped on the way to the solution
        new = has_new_point(self.points, self.count)
        landed = new or self.count > len(before)
        at_point = stopped or (new and bool((before[:, SLIPS] == 1.0).any()))
        if stopped and slack:
            longest = min(longest, stride(missed, SLIP_MISSED))
        longest = min(longest, stride(farthest_roll(self.points, self.count), ROLLED))
        begins = landed or stopped
        if begins or (slack and (hard or self.has_patch)):
            larger = max(norm(F), force, self.least)
            change = norm(F_new - F) / larger
            # all of a patch that slips may stop as soon as a point beside it bears
            most = LANDING_CHANGE if at_point or (begins and not self.has_patch) else FORCE_CHANGE
            longest = min(longest, stride(change, most if slack else TAUT_FORCE_CHANGE))
            rate = self.followed.rate
            # the force at a free end is nothing, and foretells nothing
            if rate is not None and slack and self.has_patch and distance > STILL and larger > self.least:
                bend = norm(F_new - F - distance * rate) / larger
                longest = min(longest, stride(bend, FORCE_BEND))
        return longest

    def _landing_strides(
        self, landing: Landing | None, distance: float, F: np.ndarray
    ) -> tuple[float, float]:  # fmt: skip
        """`Landing.strides` of a step of `distance`, L, to the end force F (3,).

        Neither a new mesh nor a pause changes how far the next step may go.
        """
        if distance <= STILL:
            return np.inf, self.onward
        return (np.inf, np.inf) if landing is None else landing.strides(norm(F))

    def _turns_back(self) -> bool:
        """Whether friction has turned back at a point that slips, in the last solve."""
        points = self.points[: self.count]
        slips = (points[:, KIND] == POINT) & (points[:, SLIPS] == 1.0)
        along = np.sum(points[:, FRICTION:BEFORE] * points[:, BEFORE : BEFORE + 3], axis=1)
        return bool((slips & (along < 0.0)).any())

    def _friction_change(self, q: np.ndarray, F: np.ndarray, obstacles: np.ndarray, most: float) -> float:
        """Relative change, in a step to q, of the friction of what slips; 0 if it is below `most` anyway.

        At points alone, how otherwise it turns than before; along a patch, how it changes across the cable.
        """
        self.unforeseen = 0.0
        change, possible = slip_change(self.points, self.count, obstacles)
        possible = max(possible, norm(F))
        if change == 0.0 or (self.has_patch and change <= SHORTER * most * possible):
            return 0.0
        if not self.has_patch:
            self.unforeseen, bend = slip_bend(self.points, self.count)
            return bend / possible
        slips, turned = self._turned()
        along = quaternion.tangents(self.mesh.interpolate(q, self.points[: self.count][slips, ARC_LENGTH]))
        return float(np.linalg.norm(np.cross(along, turned[slips]), axis=1).sum()) / possible

    def _turned(self) -> tuple[np.ndarray, np.ndarray]:
        """(count,) which contact points slip, and (count, 3) by how much their friction changed in the step.

        Of a patch that a point has become its first end tells the change of all of it: the friction is the
        same, spread out.
        """
        points = self.points[: self.count]
        kind, s = points[:, KIND], points[:, ARC_LENGTH]
        slips, before = np.asarray(points[:, SLIPS] == 1.0), points[:, BEFORE : BEFORE + 3]
        turned, known = points[:, FRICTION:BEFORE] - before, np.asarray(before.any(axis=1))
        for i in np.flatnonzero((kind == FIRST) & known):
            beyond = (points[:, OBSTACLE] == points[i, OBSTACLE]) & (kind != POINT) & (s >= s[i])
            patch = np.flatnonzero(beyond & (s <= s[beyond & (kind == LAST)].min(initial=1.0)))
            if not known[patch[kind[patch] == SAMPLE]].any():
                turned[i], all_of_it = turned[patch].sum(axis=0), slips[patch].any()
                slips[patch] = False
                slips[i] = all_of_it
        return slips, turned
