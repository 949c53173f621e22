# SPDX-License-Identifier: Apache-2.0
"""Random cables, clamps, weights, twists and joint paths; every one is named by a seed and an index."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from cable_ros.bench.carriage import JOINTS, on_carriage
from cable_ros.bench.cases import TRUSTED, Case

GRAVITY_NUMBERS = (0.0, 300.0)
CHORDS = (0.05, 0.98)
"""Relative to the length."""
STEPS = 100
"""Poses of one tracked path."""


def random_cable(rng: np.random.Generator) -> dict[str, Any]:
    """A one-cable scene: any size and stiffness, any clamps with the chord in `CHORDS`, any weight.

    In half of the scenes a twist within one turn is asked for; in the others there is no hint.
    """
    length = 10 ** rng.uniform(-1.3, 0.7)
    bending = 10 ** rng.uniform(-5, 1)
    stiffness = bending * np.array([1.0, 2 ** rng.uniform(-1, 1), 10 ** rng.uniform(-0.7, 0.7)])
    gravity_number = rng.uniform(*GRAVITY_NUMBERS)
    weight = gravity_number * min(stiffness[:2]) / length**3
    density = 10 ** rng.uniform(-3, 0)
    start = rng.uniform(-2, 2, 3)
    end = start + rng.uniform(*CHORDS) * length * _direction(rng)
    first, last = Rotation.random(2, random_state=rng).as_quat()
    cable: dict[str, Any] = {
        "name": "cable",
        "length": float(length),
        "stiffness": stiffness.tolist(),
        "linear_density": float(density),
        "start": {"position": start.tolist(), "orientation": first.tolist()},
        "end": {"position": end.tolist(), "orientation": last.tolist()},
    }
    if rng.random() < 0.5:
        cable["total_twist"] = float(rng.uniform(-2 * np.pi, 2 * np.pi))
    return {"gravity": (weight / density * _direction(rng)).tolist(), "cables": [cable]}


def cold_case(seed: int, index: int, tolerance: float) -> Case:
    """The `index`-th random cable of a seed, to be solved cold."""
    rng = np.random.default_rng([seed, index, 0])
    return Case(f"cold {index}", "verified or reported", random_cable(rng), tolerance=tolerance)


def tracked_case(seed: int, index: int, tolerance: float, steps: int = STEPS) -> Case:
    """A random cable whose end clamp is led through `steps` poses of a smooth random path.

    The path is a spline of slides and turns; its steps are between about 0.1 and 10 degrees and, of the
    same share of the length, from path to path.
    """
    rng = np.random.default_rng([seed, index, 1])
    mapping, urdf, home = on_carriage(random_cable(rng))
    (cable,) = mapping["cables"]
    length, start = cable["length"], np.array(cable["start"]["position"])
    stride = 10 ** rng.uniform(-2.7, -0.75)
    at = np.array([home[name] for name in JOINTS])
    scale = np.array([length] * 3 + [1.0] * 4)
    heading = rng.normal(size=7) * scale
    path = []
    for _ in range(steps):
        path.append(dict(zip(JOINTS, at.tolist(), strict=True)))
        heading = 0.95 * heading + 0.3 * rng.normal(size=7) * scale
        at = at + stride * heading / np.linalg.norm(heading / scale)
        away = at[:3] - start
        chord = np.linalg.norm(away) / length
        if not CHORDS[0] <= chord <= CHORDS[1]:
            at[:3] = start + away * np.clip(chord, *CHORDS) / chord
            heading[:3] -= 2 * away * (heading[:3] @ away) / (away @ away)
    return Case(
        f"tracked {index}",
        "verified or reported",
        mapping,
        tuple(path),
        urdf=urdf,
        statuses=TRUSTED,
        tolerance=tolerance,
    )


def _direction(rng: np.random.Generator) -> np.ndarray:
    v = rng.normal(size=3)
    return v / np.linalg.norm(v)
