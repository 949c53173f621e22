# SPDX-License-Identifier: Apache-2.0
"""What `effects: auto` has left out of one cable's equations; see `branch.effect_selection`."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True, eq=False)
class Choice:
    """What is left out of one cable's equations, and what is known about that."""

    left_out: tuple[str, ...]
    change: float
    """Relative change of the end wrench that it makes, all together, when last measured."""
    tolerance: float
    size: float
    """Of the end wrench then, in units of the cable."""
    shape: np.ndarray
    """(n, 4) nodal frames then."""
    note: str = field(default="")
    """What the message of an equilibrium says about it."""
