# SPDX-License-Identifier: Apache-2.0
"""The linearised equations of cables that rub on each other."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cable_ros.branch.coulomb_contact import Grip, Rub, Sides, assemble_with_friction, condensed
from cable_ros.branch.crossing_balance import CrossedTangent, System
from cable_ros.branch.rubbing_cable import RubbingCable, loaded_response
from cable_ros.contact.crossing import FREEDOMS, Spacer


class RubbingTangent(CrossedTangent):
    """The linearised equations of all cables about their equilibrium, with the friction of their contacts."""

    def __init__(
        self, cables: Sequence[RubbingCable], radii: Sequence[float], spacers: Sequence[Spacer],
        poses: np.ndarray, rubs: dict[int, Rub], grips: dict[int, Grip],
    ) -> None:  # fmt: skip
        """`rubs`, `grips`: by number of the spacer."""
        super().__init__(cables, spacers, poses)
        self._radii, self._rubs, self._grips = tuple(radii), rubs, grips

    def whole(self, obstacles: Sequence[str] = ()) -> tuple[System, Sides]:
        """The equations with the unknowns of friction, see `assemble_with_friction`."""
        responses = []
        for i, ((tangent, first), own) in enumerate(zip(self._each, self._touching, strict=True)):
            moving = [*tangent.numbers(obstacles), *(first + slot for slot in own.slots)]
            loaded, before = [], []
            for slot, j in zip(own.slots, own.spacers, strict=True):
                if j in self._rubs:
                    side = self._spacers[j].cables.index(i)
                    loaded.append(first + slot)
                    before.append(float(self._grips[j].arcs[side]))
            responses.append(loaded_response(tangent, moving, loaded, before))
        return assemble_with_friction(self._spacers, self._radii, self._rubs, responses, len(obstacles))

    def system(self, obstacles: Sequence[str] = ()) -> System:
        if not self._rubs:
            return super().system(obstacles)
        return condensed(self.whole(obstacles)[0], FREEDOMS * len(self._spacers))
