# SPDX-License-Identifier: Apache-2.0
"""How near a cable comes to what it stands: the worst value of each quantity along it, beside its limit."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

WARNING = 0.8
"""Fraction of a limit in use from which it is reported."""
OK, NEAR, BEYOND = 0, 1, 2
"""How an extreme stands to its limit, the worse the larger."""


@dataclass(frozen=True)
class Quantity:
    """Something that a cable may be limited in."""

    name: str
    """As in the scene's `limits`."""
    unit: str
    least: bool
    """Whether small values are the dangerous ones."""

    @property
    def words(self) -> str:
        """As a sentence has it."""
        return self.name.replace("_", " ")


QUANTITIES = (
    Quantity("bend_radius", "m", True),
    Quantity("tension", "N", False),
    Quantity("torsion", "rad/m", False),
    Quantity("clearance", "m", True),
)
"""In the order of `Equilibrium.extremes`."""


@dataclass(frozen=True, eq=False)
class Extreme:
    """The worst value of a quantity along a cable, and where it is; SI units."""

    quantity: Quantity
    value: float
    """Smallest bend radius, largest tension (negative: pressed all along), largest twist per length, either
    way, or least clearance (negative: inside). Infinite: straight all along, or nothing to keep clear of."""
    arc_length: float
    """From the start along the unstretched cable, m; NaN for an infinite value."""
    position: np.ndarray
    """(3,) of the centreline there, world, m; NaN for an infinite value."""
    limit: float | None
    """None: the scene gives none."""
    obstacle: str = ""
    """To which the clearance is least."""

    @property
    def use(self) -> float:
        """How much of the limit is in use: 1 at the limit, more beyond it; 0 without one."""
        if self.limit is None:
            return 0.0
        if not self.quantity.least:
            return max(self.value / self.limit, 0.0)
        return self.limit / self.value if self.value > 0.0 else math.inf

    @property
    def level(self) -> int:
        """OK, NEAR from `WARNING` on, or BEYOND the limit."""
        return OK if self.use < WARNING else NEAR if self.use <= 1.0 else BEYOND

    @property
    def sentence(self) -> str:
        """What a person reads: "Bend radius 0.036 m at 0.21 m, 111 % of its limit of 0.04 m."."""
        shown = f"{self.quantity.words.capitalize()} {self.value:.4g} {self.quantity.unit}"
        if math.isfinite(self.arc_length):
            shown += f" at {self.arc_length:.4g} m"
        if self.obstacle:
            shown += f" to '{self.obstacle}'"
        if self.limit is None:
            return f"{shown}."
        use = f"{100.0 * self.use:.0f} % of " if math.isfinite(self.use) else "beyond "
        return f"{shown}, {use}its limit of {self.limit:g} {self.quantity.unit}."

    def as_dict(self) -> dict[str, Any]:
        """By name, for JSON."""
        return {
            "quantity": self.quantity.name,
            "value": self.value,
            "arc_length": self.arc_length,
            "position": self.position,
            "limit": self.limit,
            "use": self.use,
            "obstacle": self.obstacle,
        }
