# SPDX-License-Identifier: Apache-2.0
"""Scenes as people draw them: planar, symmetric, on round numbers, resting exactly.

Lengths are those of the cable, the drawing's plane is x-z with z up, angles are degrees. The obstacles of a
drawing stand on one link that slides along x, y, z and turns about an axis along y.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

Move = dict[str, float]
"""By how much joints are off home: slides in lengths, turns in degrees."""
UP, DOWN, AHEAD, BACK = 90.0, -90.0, 0.0, 180.0
"""Directions of tangents in the drawing's plane, degrees from x towards z."""
THICK = 0.02
"""Of beams and walls."""


@dataclass(frozen=True)
class Drawing:
    """One scene of a unit cable: the clamps at home, what is in the way, and waypoints of its joints."""

    start: tuple[float, float]
    """x and z."""
    start_angle: float
    end: tuple[float, float]
    end_angle: float
    obstacles: list[dict[str, Any]]
    waypoints: list[Move]
    """Between home and home."""
    pivot: tuple[float, float] = (0.0, 0.0)
    """x and z of the axis that the obstacles turn about."""
    weights: Sequence[float] = (0.0, 5.0, 20.0, 50.0, 100.0, 200.0)
    """w L^3 / EI may be one of these."""
    sharp: bool = field(default=False)
    """Whether something has edges, so that the cable needs a thickness."""


Rng = np.random.Generator


def _one(rng: Rng, values: Sequence[Any]) -> Any:
    return values[int(rng.integers(len(values)))]


def _ground(height: float = 0.0) -> dict[str, Any]:
    return {"name": "ground", "plane": {"point": [0.0, 0.0, height], "normal": [0.0, 0.0, 1.0]}}


def _box(name: str, low: Sequence[float], high: Sequence[float]) -> dict[str, Any]:
    """A box from its lowest to its highest corner."""
    center = [0.5 * (a + b) for a, b in zip(low, high, strict=True)]
    return {
        "name": name,
        "box": {"center": center, "size": [b - a for a, b in zip(low, high, strict=True)]},
    }


def _bar(name: str, kind: str, x: float, z: float, radius: float) -> dict[str, Any]:
    """A cylinder or capsule across the drawing's plane."""
    return {"name": name, kind: {"start": [x, -0.5, z], "end": [x, 0.5, z], "radius": radius}}


def _there(rng: Rng, moves: Sequence[Move]) -> list[Move]:
    """One of `moves`, or one and its opposite: there and back, or to both sides."""
    move = _one(rng, moves)
    if rng.random() < 0.3:
        return [move, {}, {name: -by for name, by in move.items()}]
    return [move]


def hose(rng: Rng, radius: float) -> Drawing:
    """A hose on the ground, clamped where it lies, whose lifted end is led about."""
    height, angle = _one(rng, [(0.2, UP), (0.3, UP), (0.2, AHEAD), (0.1, 30.0), (0.3, 45.0)])
    chord = _one(rng, [0.6, 0.7, 0.8])
    side = _one(rng, [0.05, 0.1, 0.15])
    square = [{"y": side}, {"y": side, "x": -side}, {"y": -side, "x": -side}, {"y": -side}]
    moves = _one(
        rng,
        [
            _there(rng, [{"y": side}, {"x": -side}, {"yaw": 30.0}, {"z": 0.05}, {"across": side}]),
            square,
            [{"y": side}, {"y": -side}],
        ],
    )
    weights = (20.0, 50.0, 100.0, 200.0)
    return Drawing((0.0, radius), AHEAD, (chord, height), angle, [_ground()], moves, weights=weights)


def lift(rng: Rng, radius: float) -> Drawing:
    """Both clamps on the ground; one is lifted and laid down again."""
    chord = _one(rng, [0.7, 0.8, 0.9])
    back = rng.random() < 0.5
    rise = _one(rng, [0.1, 0.2, 0.3])
    moves = _there(rng, [{"z": rise, "x": -0.1}, {"z": rise, "pitch": -30.0}, {"y": 0.1}, {"z": rise}])
    moves = [move for move in moves if move.get("z", 0.0) >= 0.0]
    end = (chord, radius) if back else (chord - 0.3, radius)
    weights = (20.0, 50.0, 100.0, 200.0)
    return Drawing((0.0, radius), AHEAD, end, AHEAD if back else BACK, [_ground()], moves, weights=weights)


def table(rng: Rng, radius: float) -> Drawing:
    """A cable that sags onto a table between two clamps, pressed down, slid, or the table moved."""
    height, chord = _one(rng, [0.1, 0.2, 0.3]), _one(rng, [0.3, 0.4, 0.5, 0.6])
    start, end = _one(rng, [(DOWN, UP), (AHEAD, AHEAD), (-45.0, 45.0), (BACK, BACK)])
    step = _one(rng, [0.05, 0.1])
    moves = _there(
        rng,
        [
            {"z": -0.05},
            {"x": step},
            {"y": step},
            {"up": 0.05},
            {"along": step},
            {"across": step},
            {"yaw": 45.0},
        ],
    )
    flat = rng.random() < 0.5
    top = _ground() if flat else _box("table", [-1.0, -1.0, -0.1], [2.0, 1.0, 0.0])
    return Drawing((0.0, height), start, (chord, height), end, [top], moves, sharp=not flat)


def edge(rng: Rng, radius: float) -> Drawing:
    """A cable that lies on a table and hangs over its edge."""
    reach, drop = _one(rng, [0.1, 0.2, 0.3]), _one(rng, [0.1, 0.2, 0.3])
    angle = _one(rng, [DOWN, -45.0, AHEAD])
    lying = rng.random() < 0.5
    moves = _there(
        rng, [{"z": -0.1}, {"x": 0.1}, {"y": 0.1}, {"yaw": 30.0}, {"along": -0.1}, {"across": 0.1}]
    )
    return Drawing(
        (0.0, radius if lying else 0.1), AHEAD if lying else DOWN, (0.3 + reach, -drop), angle,
        [_box("table", [-1.0, -0.5, -0.5], [0.3, 0.5, 0.0])], moves, sharp=True,
    )  # fmt: skip


def tray(rng: Rng, radius: float) -> Drawing:
    """A cable that is laid into a tray, which may be moved under it."""
    width, height = _one(rng, [0.5, 0.6, 0.7]), _one(rng, [0.1, 0.2])
    walls = [
        _box("floor", [-0.1, -0.5, -THICK], [width + 0.1, 0.5, 0.0]),
        _box("left wall", [-0.1 - THICK, -0.5, -THICK], [-0.1, 0.5, 0.1]),
        _box("right wall", [width + 0.1, -0.5, -THICK], [width + 0.1 + THICK, 0.5, 0.1]),
    ]
    start, end = _one(rng, [(DOWN, UP), (BACK, BACK), (AHEAD, AHEAD)])
    moves = _there(rng, [{"z": -0.05}, {"x": -0.1}, {"along": 0.05}, {"up": 0.05}, {"turn": 5.0}, {"y": 0.1}])
    pivot = (0.5 * width, 0.0)
    return Drawing((0.0, height), start, (width, height), end, walls, moves, pivot, sharp=True)


def drum(rng: Rng, radius: float) -> Drawing:
    """A cable draped over a drum, or sagging onto it, which may turn."""
    size = _one(rng, [0.1, 0.15, 0.2])
    half = _one(rng, [0.3, 0.35])
    low = _one(rng, [-0.1, 0.0, 0.1])
    start, top = _one(
        rng, [(AHEAD, -0.2), (AHEAD, -0.1), (-45.0, -0.2), (45.0, 0.3), (45.0, 0.35), (UP, 0.4)]
    )
    kind = _one(rng, ["cylinder", "capsule"])
    moves = _there(
        rng,
        [
            {"turn": 10.0},
            {"turn": 30.0},
            {"turn": 60.0},
            {"z": -0.1},
            {"along": 0.05},
            {"up": 0.05},
            {"y": 0.1},
        ],
    )
    bar = _bar("drum", kind, 0.0, top - size, size)
    return Drawing((-half, low), start, (half, low), -start, [bar], moves, (0.0, top - size))


def wall(rng: Rng, radius: float) -> Drawing:
    """A loop of cable that is pushed against a wall."""
    apart = _one(rng, [0.2, 0.3, 0.4])
    gap = _one(rng, [0.2, 0.25, 0.3])
    if rng.random() < 0.5:
        front = {"name": "wall", "plane": {"point": [gap, 0.0, 0.0], "normal": [-1.0, 0.0, 0.0]}}
    else:
        front = _box("wall", [gap, -1.0, -1.0], [gap + 0.1, 1.0, 1.0])
    moves = _there(
        rng, [{"along": -0.05}, {"along": -0.1}, {"up": 0.1}, {"across": 0.1}, {"z": 0.1}, {"y": 0.1}]
    )
    return Drawing((0.0, 0.0), AHEAD, (0.0, apart), BACK, [front], moves, sharp="box" in front)


def beams(rng: Rng, radius: float) -> Drawing:
    """A cable over one or two beams with parallel edges."""
    half = _one(rng, [0.25, 0.3])
    angle, top = _one(rng, [(AHEAD, -0.1), (AHEAD, -0.2), (-45.0, -0.2), (45.0, 0.25), (45.0, 0.3)])
    places = _one(rng, [[0.0], [-0.1, 0.1]])
    bars = [_box(f"beam {i}", [x - THICK, -0.5, -0.5], [x + THICK, 0.5, top]) for i, x in enumerate(places)]
    low = _one(rng, [0.0, 0.05])
    moves = _there(
        rng, [{"z": -0.1}, {"x": 0.05}, {"y": 0.1}, {"along": 0.05}, {"up": 0.05}, {"across": 0.1}]
    )
    return Drawing((-half, low), angle, (half, low), -angle, bars, moves, sharp=True)


def ball(rng: Rng, radius: float) -> Drawing:
    """A cable that arches over a ball, or sags onto it, under its middle or beside it."""
    size, half = _one(rng, [0.1, 0.15]), _one(rng, [0.3, 0.35])
    beside = _one(rng, [0.0, 0.0, 0.05])
    angle, top = _one(rng, [(AHEAD, -0.1), (AHEAD, -0.2), (-45.0, -0.2), (45.0, 0.3), (45.0, 0.35)])
    one = {"name": "ball", "sphere": {"center": [0.0, beside, top - size], "radius": size}}
    moves = _there(
        rng, [{"z": -0.1}, {"up": 0.05}, {"across": 0.05}, {"along": 0.1}, {"turn": 30.0}, {"y": 0.05}]
    )
    return Drawing((-half, 0.0), angle, (half, 0.0), -angle, [one], moves, (0.0, top - size))


def rollers(rng: Rng, radius: float) -> Drawing:
    """A cable over one drum and under the next."""
    size, kind = _one(rng, [0.05, 0.1]), _one(rng, ["cylinder", "capsule"])
    bars = [_bar("under", kind, -0.15, -size, size), _bar("over", kind, 0.15, size, size)]
    half = _one(rng, [0.4, 0.45])
    moves = _there(rng, [{"z": 0.1}, {"x": -0.05}, {"up": 0.05}, {"turn": 10.0}, {"y": 0.05}])
    return Drawing((-half, -0.05), AHEAD, (half, 0.05), AHEAD, bars, moves)


def slot(rng: Rng, radius: float) -> Drawing:
    """A cable that is compressed between two plates."""
    half = _one(rng, [0.05, 0.1])
    plates = [
        {"name": name, "plane": {"point": [0.0, 0.0, side * half], "normal": [0.0, 0.0, -side]}}
        for name, side in (("floor", -1.0), ("ceiling", 1.0))
    ]
    moves = _there(
        rng, [{"x": -0.05}, {"x": -0.1}, {"y": 0.05}, {"z": 0.02}, {"along": 0.05}, {"across": 0.05}]
    )
    chord = _one(rng, [0.8, 0.9, 0.92])
    return Drawing((0.0, 0.0), AHEAD, (chord, 0.0), AHEAD, plates, moves, weights=(0.0, 5.0, 20.0, 50.0))


def corner(rng: Rng, radius: float) -> Drawing:
    """A ground with a wall and a bar on it: several obstacles at once."""
    chord = _one(rng, [0.4, 0.5])
    things = [
        _ground(),
        _box("wall", [chord + 0.2, -0.5, 0.0], [chord + 0.3, 0.5, 0.5]),
        _bar("bar", _one(rng, ["cylinder", "capsule"]), 0.5 * chord, 0.05, 0.05),
    ]
    moves = _there(rng, [{"x": 0.1}, {"z": -0.05}, {"y": 0.1}, {"along": -0.1}, {"up": 0.05}, {"yaw": 45.0}])
    return Drawing((0.0, 0.2), DOWN, (chord, 0.2), _one(rng, [UP, AHEAD]), things, moves, sharp=True)


KINDS: dict[str, Callable[[Rng, float], Drawing]] = {
    maker.__name__: maker
    for maker in (hose, lift, table, edge, tray, drum, wall, beams, ball, rollers, slot, corner)
}
"""By name; a drawing's random numbers and the cable's radius, 0 without a thickness, make one."""
