# SPDX-License-Identifier: Apache-2.0
"""Random cables among random obstacles: what is touched, when, and how, is left to chance."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from cable_ros.bench.carriage import JOINTS, on_carriage
from cable_ros.bench.cases import TRUSTED, Case
from cable_ros.bench.fuzz import CHORDS, random_cable
from cable_ros.bench.surfaces import Distance, distance
from cable_ros.equilibrium import Status
from cable_ros.scene import load_scene

STEPS = 5
"""Poses of one scene, the first one solved cold."""
CLEAR = 0.05
"""The clamps keep at least this far from every obstacle, parts of the length."""
POSSIBLE = (*TRUSTED, Status.OUT_OF_REACH)
"""The cable may be too short to get past what is in its way; only a search for ways can tell."""
WORLD = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])


def contact_case(seed: int, index: int, tolerance: float, steps: int = STEPS) -> Case:
    """A random cable among one to three random obstacles, its end clamp led a few steps between them."""
    rng = np.random.default_rng([seed, index, 2])
    mapping = random_cable(rng)
    (cable,) = mapping["cables"]
    length = cable["length"]
    ends = [np.array(cable[end]["position"]) for end in ("start", "end")]
    if rng.random() < 0.5:
        cable["outer_diameter"] = float(length * 10 ** rng.uniform(-3, -1.5))
    mapping["friction_model"] = "coulomb" if rng.random() < 0.7 else "sliding"
    mapping["obstacles"] = []
    down = np.array(mapping["gravity"]) / max(float(np.linalg.norm(mapping["gravity"])), 1e-300)
    count = int(rng.integers(1, 4))
    while len(mapping["obstacles"]) < count:
        name = f"obstacle_{len(mapping['obstacles'])}"
        one = {"name": name, **_shape(rng, ends, length, down), "friction": _friction(rng)}
        if min(_clearance(mapping, one, ends)) > CLEAR * length:
            mapping["obstacles"].append(one)
    if any("box" in one or "cylinder" in one for one in mapping["obstacles"]):
        # across a sharp edge a line without thickness would be pushed in no direction of its own
        cable.setdefault("outer_diameter", 0.002 * length)
    moved, urdf, home = on_carriage(mapping)
    signed = _distances(mapping)
    at = np.array([home[name] for name in JOINTS])
    scale = np.array([length] * 3 + [1.0] * 4)
    stride = 10 ** rng.uniform(-2.5, -0.8)
    path: list[dict[str, float]] = []
    heading = rng.normal(size=7) * scale
    while len(path) < steps:
        path.append(dict(zip(JOINTS, at.tolist(), strict=True)))
        heading = 0.9 * heading + 0.4 * rng.normal(size=7) * scale
        for _ in range(50):
            ahead = at + stride * heading / np.linalg.norm(heading / scale)
            chord = np.linalg.norm(ahead[:3] - ends[0]) / length
            if CHORDS[0] <= chord <= CHORDS[1] and min(d(ahead[:3]) for d in signed) > CLEAR * length:
                at = ahead
                break
            heading = rng.normal(size=7) * scale
    return Case(
        f"contact {index}",
        "verified or reported",
        moved,
        tuple(path),
        urdf=urdf,
        statuses=POSSIBLE,
        along=POSSIBLE,
        tolerance=tolerance,
        polyline_points=401,
    )


def _friction(rng: np.random.Generator) -> float:
    return 0.0 if rng.random() < 0.5 else float(rng.uniform(0.05, 0.8))


def _shape(
    rng: np.random.Generator, ends: list[np.ndarray], length: float, down: np.ndarray
) -> dict[str, Any]:
    """An obstacle about where the cable hangs: near a parabola between the clamps."""
    x = rng.uniform(0.1, 0.9)
    slack = np.sqrt(length**2 - float(np.sum((ends[1] - ends[0]) ** 2)))
    middle = ends[0] + x * (ends[1] - ends[0]) + 1.6 * x * (1.0 - x) * slack * down
    center = middle + 0.2 * length * rng.normal(size=3) / np.sqrt(3.0)
    size = length * 10 ** rng.uniform(-1.5, -0.5)
    way = rng.normal(size=3)
    way /= np.linalg.norm(way)
    kind = rng.choice(["sphere", "plane", "capsule", "cylinder", "box"])
    if kind == "sphere":
        return {"sphere": {"center": center.tolist(), "radius": float(size)}}
    if kind == "plane":
        # below both clamps, seen along its normal
        point = min(ends, key=lambda end: float(way @ end)) - rng.uniform(CLEAR, 0.2) * length * way
        return {"plane": {"point": point.tolist(), "normal": way.tolist()}}
    if kind == "box":
        edges = size * 2.0 ** rng.uniform(-1.5, 1.5, 3)
        turn = Rotation.random(random_state=rng).as_quat()
        return {"box": {"center": center.tolist(), "size": edges.tolist(), "orientation": turn.tolist()}}
    half = 0.5 * length * rng.uniform(0.1, 1.0) * way
    bar = {"start": (center - half).tolist(), "end": (center + half).tolist(), "radius": float(size / 2)}
    return {str(kind): bar}


def _clearance(mapping: dict[str, Any], obstacle: dict[str, Any], ends: list[np.ndarray]) -> list[float]:
    alone = _distances({**mapping, "obstacles": [obstacle]})
    return [float(signed(end)) for signed in alone for end in ends]


def _distances(mapping: dict[str, Any]) -> list[Distance]:
    scene = load_scene(mapping)
    return [distance(obstacle, WORLD, scene.cables[0].radius) for obstacle in scene.obstacles]
