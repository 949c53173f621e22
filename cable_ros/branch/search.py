# SPDX-License-Identifier: Apache-2.0
"""A cold start in pieces: the work of one call is bounded, and the next call continues."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cable_ros.branch import handover
from cable_ros.branch.cold_start import Found, Sought, Starts, carried, same
from cable_ros.branch.end_for_end import end_for_end
from cable_ros.branch.falling import Falling
from cable_ros.branch.mirror_image import mirror_image, plane_of_symmetry
from cable_ros.branch.paying_out import Led, Loading, PayingOut
from cable_ros.branch.refinement import refine
from cable_ros.contact.symmetry import REVERSED, Symmetry, side_of
from cable_ros.equilibrium import Status

EQUAL = 1e-11
"""Maximum relative difference of two equal energies: rounding. Even a tiny weight makes more, and decides."""
TWINS = 1e-6
"""Maximum relative difference of energy of equilibria that a message calls equal in energy."""


class Search:
    """Looks for the equilibrium of one pose that is nearest the twist asked for, or of least energy.

    In turn: energy descents from initial shapes (`Starts`); the equilibria found, on finer meshes (`refine`),
    until one meets the tolerance; and if none does, continuation in the cable's length (`PayingOut`)
    and weight (`Loading`), relaxation on a grid of contacts (`handover.Rest`) and falls of a light cable
    (`Falling`), whose equilibria are made finer in the same way.

    Args:
        sought: the pose and what is asked for there.
    """

    def __init__(self, sought: Sought) -> None:
        self.sought = sought
        touches = sought.conditions.obstacles is not None
        begun = replace(sought, conditions=sought.conditions.rounded()) if touches else sought
        self._starts = Starts(begun, thorough=False)
        self._last: list[Led | handover.Rest | Falling] = []
        if sought.compliance is None and sought.ends is None:
            self._last = [PayingOut(begun), Loading(begun), handover.Rest(begun), Falling(begun)]
        self._coarse: list[Found] | None = None
        self._refined = 0
        self._best: Found | None = None
        self._estimate = np.inf
        self._origin: Found | None = None

    def go(self, work: float) -> float:
        """Search until `work`, iterations times unknowns, is spent or the search is `over`; returns the rest.

        A piece that has begun is finished, so that the rest may be negative.
        """
        while work > 0.0 and not self.over:
            work -= self._piece()
        return work

    @property
    def over(self) -> bool:
        """Whether an equilibrium meets the tolerance, or everything has been tried."""
        if not self._starts.over or self._coarse is None:
            return False
        tried = self._refined == len(self._coarse) and all(one.over for one in self._last)
        return tried or self._estimate <= self.sought.tolerance

    @property
    def found(self) -> Found | None:
        """The equilibrium of least estimated error; None if there is none."""
        return self._best if self._estimate < np.inf else None

    @property
    def several(self) -> bool:
        """Whether it found more than one equilibrium."""
        return self._coarse is not None and len(self._coarse) > 1

    @property
    def sentence(self) -> str:
        """The message of `found`; it says whether others have the same energy."""
        assert self._coarse is not None
        assert self._origin is not None
        twins = sum(_equal(other, self._origin) for other in self._coarse)
        sentence = Status.CONVERGED.sentence
        if twins < 2:
            return sentence
        rule = "a rule chooses the side towards (-1, 3, 2) of the start clamp's axes"
        return f"{sentence[:-1]}, one of {twins} of equal energy: {rule}."

    def _piece(self) -> float:
        """Do the next piece of the search; returns its work."""
        if not self._starts.over:
            return self._starts.descend()
        if self._coarse is None:
            return self._arrive(self._starts.found)
        if self._refined < len(self._coarse):
            return self._refine(self._coarse[self._refined])
        found, work = next(one for one in self._last if not one.over).settle()
        if found:
            work += self._arrive(found)
            self._refined = 0
        return work

    def _arrive(self, found: list[Found]) -> float:
        """Bring the equilibria that were found to the very pose, and sort them; returns the work of that."""
        conditions, work = self.sought.conditions, 0.0
        if conditions.obstacles is not None:
            there = [carried(one.rod, one.q, one.F, conditions) for one in found]
            work = sum(to.iterations * to.rod.iteration_work for to in there if to is not None)
            # one that turns freely may not be found again, and is as good at the rounded pose
            found = [
                one if to is None else replace(to, iterations=one.iterations + to.iterations)
                for one, to in zip(found, there, strict=True)
            ]
        return work + self._sort(found)

    def _sort(self, found: list[Found]) -> float:
        """Put the equilibria found in turn, with images of the first ones; returns the work of that."""
        n, twist = plane_of_symmetry(self.sought), self.sought.target_twist
        self._coarse, work = _in_turn(found, twist, n is not None), 0.0
        if n is None or not found:
            return work
        # a scene may have other symmetries, too: of the images that they make, descents find only some
        alike = [one for one in self._coarse if _equal(one, self._coarse[0])]
        chord = self.sought.conditions.re
        across = Symmetry(REVERSED, chord / max(float(np.linalg.norm(chord)), TWINS))
        for one in alike:  # which grows
            for image in (mirror_image(one, n), end_for_end(one, across)):
                if image is None or not _equal(image, one) or any(same(image, known) for known in alike):
                    continue
                alike.append(image)
                work += image.iterations * image.rod.iteration_work
        found = [one for one in found if not any(same(one, known) for known in alike)] + alike
        self._coarse = _in_turn(found, twist, True)
        return work

    def _refine(self, one: Found) -> float:
        self._refined += 1
        fine, estimate = refine(one, self.sought.tolerance)
        if self._best is None or estimate < self._estimate:
            self._best, self._estimate, self._origin = fine, estimate, one
        return (fine.iterations - one.iterations) * fine.rod.iteration_work


def _equal(one: Found, other: Found, most: float = TWINS) -> bool:
    """Whether two energies are equal, but for the fraction `most`."""
    return abs(one.energy - other.energy) <= most * (1.0 + abs(other.energy))


def _in_turn(found: list[Found], target_twist: float | None, symmetric: bool = False) -> list[Found]:
    """Sorted by distance from the target twist, or by energy; of equals, the one on the chosen side first.

    `symmetric`: whether the scene has a plane of symmetry, so that equal energies are those of mirror images.
    """
    found = sorted(found, key=lambda one: one.energy)
    if target_twist is not None:
        found.sort(key=lambda one: abs(one.twist - target_twist))
    centre = target_twist or 0.0

    def alike(one: Found) -> bool:
        apart = abs(abs(one.twist - centre) - abs(found[0].twist - centre))
        return _equal(one, found[0], TWINS if symmetric else EQUAL) and apart <= 1e-3

    first = [one for one in found if alike(one)]
    first.sort(key=lambda one: -side_of(one.rod.mesh, one.q))
    return first + [one for one in found if not alike(one)]
