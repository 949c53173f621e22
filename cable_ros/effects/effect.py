# SPDX-License-Identifier: Apache-2.0
"""What an effect is, and what the equations need to know of one cable."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from cable_ros.scene import Cable, Scene

Environment = Mapping[str, float]
"""Values by the name of an `Influence`, in its unit; one that is missing has the scene's own value."""


@dataclass(frozen=True, eq=False)
class Properties:
    """One cable as the equations see it, SI: bending and torsion, and what the effects have added."""

    length: float
    stiffness: np.ndarray
    """(3,) EIx, EIy, GJ, N m^2."""
    weight: np.ndarray
    """(3,) load per length in the world, N/m."""
    natural: np.ndarray | None = None
    """(3,) curvature and twist of the unloaded cable, 1/m."""
    compliance: np.ndarray | None = None
    """(3,) 1/GAx, 1/GAy, 1/EA, 1/N; None: inextensible and unshearable."""
    obstacles: np.ndarray | None = None
    """(n, distance.WIDTH) in their links' frames, without friction; None: nothing to touch."""
    friction: np.ndarray | None = None
    """(n,) coefficients of the obstacles; None: frictionless."""
    friction_model: str = "coulomb"
    """As in `Scene`."""


class Effect(Protocol):
    """A module of this folder: one effect, what calls for it, how large it is and what it adds."""

    NAME: str
    """As in `scene.EFFECTS`."""
    ABSENT: str
    """What a scene lacks that does not call for it."""
    SIZE: str
    """The dimensionless number that `size` returns, as a formula."""

    def cause(self, scene: Scene, cable: Cable) -> str:
        """What in the scene calls for it, as a phrase; empty where nothing does."""

    def add(self, properties: Properties, scene: Scene, cable: Cable, environment: Environment) -> Properties:
        """The cable's properties with this effect; only for a cable that calls for it."""

    def size(self, scene: Scene, cable: Cable, environment: Environment, force: float) -> float:
        """How large it is; `force` is the magnitude of the end force, N."""
