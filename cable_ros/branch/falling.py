# SPDX-License-Identifier: Apache-2.0
"""Cold starts by a fall: a light cable is found among the obstacles, and falls under its whole one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cable_ros.branch.cold_start import Found, Sought, Starts, same, settled
from cable_ros.branch.snap_through import DESCENT

LIGHT = 0.1
"""Weight of the light cable, as a fraction of the whole. Cables of w L^3 / EI = 200 over beams 0.04 L wide
were found with 0.05 to 0.2, not with 0.5."""
FALL_WORK = 25_000.0
"""Budget of a fall, iterations times unknowns. Those that ended took up to 17,000."""


class Falling:
    """Light cables at rest get their whole weight at once, and the energy is descended from there.

    Soft obstacles, which any shape can start from, do not bear a heavy cable: it is through a narrow one
    before they harden. A light one comes to rest outside of it, and from there no soft obstacles are needed.

    Args:
        sought: the pose; without obstacles or weight there is nothing to try.
    """

    def __init__(self, sought: Sought) -> None:
        self._sought = sought
        self._tried = sought.conditions.obstacles is None or not sought.conditions.f.any()
        self._light: Starts | None = None
        """The search for light cables at rest."""
        self._next = 0
        """Number of those that have fallen."""
        self._fallen: list[Found] = []

    @property
    def over(self) -> bool:
        """Whether all light cables have been found and have fallen."""
        if self._tried or self._light is None:
            return self._tried
        return self._light.over and self._next == len(self._light.found)

    def settle(self) -> tuple[list[Found], float]:
        """Search on for light cables, or let the next one fall.

        Returns the distinct equilibria of the pose, on coarse meshes, after the last one; and the work.
        """
        if self._light is None:
            whole = self._sought.conditions
            light = replace(whole, f=LIGHT * whole.f)
            self._light = Starts(replace(self._sought, conditions=light), thorough=False)
        if not self._light.over:
            return [], self._light.descend()
        one = self._light.found[self._next]
        self._next += 1
        fallen, work = self._fall(one)
        if fallen is not None and not any(same(fallen, other) for other in self._fallen):
            self._fallen.append(fallen)
        return (self._fallen if self.over else []), work

    def _fall(self, one: Found) -> tuple[Found | None, float]:
        """Where a light cable comes to rest with its whole weight, and the work."""
        rod, whole = one.rod, self._sought.conditions
        rod.set_conditions(whole.qe, whole.re, whole.f, whole.obstacles)
        rod.work = FALL_WORK
        fallen = settled(rod, rod.fall(one.q, one.F, DESCENT))
        work = FALL_WORK - rod.work
        rod.work = np.inf
        if fallen is None:
            return None, work
        return replace(fallen, iterations=one.iterations + fallen.iterations), work
