# SPDX-License-Identifier: Apache-2.0
"""The 25 equilibria of data/equilibria.json: a spectral homotopy refined by collocation to 1e-10."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from cable_ros.branch.cold_start import Conditions, Found, equilibria
from cable_ros.branch.refinement import refine
from cable_ros.rod.units import Units, relative


@dataclass(frozen=True)
class Known:
    """A cable, its clamps and load, and a stable equilibrium of it; SI units, world axes."""

    name: str
    length: float
    stiffness: np.ndarray
    weight: np.ndarray
    start: np.ndarray
    end: np.ndarray
    end_wrench: np.ndarray
    """(6,) what the cable exerts on the body at the end clamp, in the clamp's frame."""
    total_twist: float
    energy: float
    margin: float

    def scene(self, **fields: Any) -> dict[str, Any]:
        """The case in the scene's format; a density of 1 kg/m makes gravity the weight per length."""
        cable = {
            "name": "cable",
            "length": self.length,
            "stiffness": self.stiffness.tolist(),
            "linear_density": 1.0,
            "start": {"position": self.start[:3].tolist(), "orientation": self.start[3:].tolist()},
            "end": {"position": self.end[:3].tolist(), "orientation": self.end[3:].tolist()},
            **fields,
        }
        return {"gravity": self.weight.tolist(), "cables": [cable]}

    @property
    def units(self) -> Units:
        return Units(self.length, float(np.sqrt(self.stiffness[0] * self.stiffness[1])))

    def conditions(self) -> Conditions:
        """The same in units of the cable and the start clamp's frame."""
        poses, unit = np.stack([self.start, self.end]), self.units
        return Conditions(
            *relative(poses, np.array([1.0, 0.0, 0.0, 0.0]), self.weight, unit.length, unit.force)
        )

    def solved(self, tolerance: float = 1e-6) -> Found:
        """The equilibrium on a mesh fit for the tolerance."""
        stiffness = self.stiffness / self.units.stiffness
        found = equilibria(stiffness, None, self.conditions(), self.total_twist, tolerance, thorough=False)
        return refine(min(found, key=lambda one: abs(one.twist - self.total_twist)), tolerance)[0]


def _known(case: dict[str, Any]) -> Known:
    values = {
        name: np.array(case[name], float)
        for name in ("stiffness", "weight", "start", "end", "end_force", "end_moment")
    }
    back = Rotation.from_quat(values["end"][3:]).inv()
    wrench = -np.concatenate([back.apply(values.pop("end_force")), back.apply(values.pop("end_moment"))])
    return Known(
        name=case["name"],
        length=case["length"],
        end_wrench=wrench,
        total_twist=case["total_twist"],
        energy=case["energy"],
        margin=case["stability_margin"],
        **values,
    )


_FILE = Path(__file__).parents[1] / "data" / "equilibria.json"
KNOWN = {known.name: known for known in map(_known, json.loads(_FILE.read_text())["cases"])}


def wrench(found: Found) -> np.ndarray:
    """(6,) on the cable, its units: end force in the start clamp's frame, end moment in the end clamp's."""
    return np.concatenate([found.F, found.rod.g[-1]])


def relative_difference(a: np.ndarray, b: np.ndarray) -> float:
    """The larger of the force's and the moment's differences, each relative to b's."""
    return float(
        max(np.linalg.norm((a - b)[part]) / np.linalg.norm(b[part]) for part in (slice(0, 3), slice(3, 6)))
    )
