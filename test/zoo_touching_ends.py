# SPDX-License-Identifier: Apache-2.0
"""Hard cases of ends that are not clamps among obstacles; `test_zoo_touching_ends` says what must hold."""

from __future__ import annotations

from typing import Any

import numpy as np
from test_ends import PAIRS
from test_touching_ends import FREE, GROUND, among, pushed
from zoo_supports import Case

LEVEL = {"position": [0.0, 0.0, 0.2], "rpy": [0.0, np.pi / 2, 0.0]}
ABOVE = LEVEL | {"position": [0.4, 0.0, 0.2]}
DOWN = {"position": [0.0, 0.0, 0.2], "rpy": [0.0, np.pi / 2 + 0.6, 0.0]}
ASIDE = {"position": [0.0, 0.0, 0.2], "rpy": [0.1, np.pi / 2 + 0.3, 0.2]}
CART = {"link": "cart"}
LONGER = {"axial_stiffness": 500.0}
BALL = {"name": "ball", "sphere": {"center": [0.3, 0.02, 0.6], "radius": 0.1}}
BELOW = {"name": "ball", "sphere": {"center": [0.03, 0.0, 0.0], "radius": 0.1}}
TABLE = {"name": "table", "box": {"center": [0.9, 0.0, -0.1], "size": [0.6, 1.0, 0.4]}}
WALL = {"name": "wall", "plane": {"point": [1.05, 0.0, 0.0], "normal": [-1.0, 0.0, 0.0]}}


def passed(name: str, **fields: Any) -> Case:
    """A ball goes along the cable of `test_ends.PAIRS`, under it; `fields` of the cable."""
    scene = pushed(name, **fields)
    (ball,) = scene["obstacles"]
    ball |= CART
    stretches = ", stretching" * bool(fields)
    return Case(f"{name}: a ball moves under it{stretches}", scene, np.array([0.04, 0.03, 0.02]))


def led(name: str, start: dict[str, Any], obstacle: dict[str, Any], to: list[float], **fields: Any) -> Case:
    """The start of a cable with a free end is led."""
    end = fields.pop("end", FREE)
    return Case(name, among(start | CART, end, obstacle, **{"weight": 30.0} | fields), np.array(to))


def hangs(lean: float) -> dict[str, Any]:
    """A start from which a cable hangs down; `lean` from the vertical, rad."""
    return {"position": [0.0, 0.0, 1.2], "rpy": [np.pi - lean, 0.0, 0.0]}


CASES = (
    led("free: comes down in its plane, rests, lies", LEVEL, GROUND, [0.0, 0.0, -0.15]),
    led("free: comes down aside, rests, lies", ASIDE, GROUND, [0.0, 0.0, -0.15]),
    led("free: drawn along the ground", DOWN, GROUND, [-0.3, 0.0, 0.0]),
    led("free: pushed along the ground", DOWN, GROUND, [0.3, 0.0, 0.0]),
    led("free: drawn across the ground", DOWN, GROUND, [0.0, 0.4, 0.0]),
    led("free: pulled along and pressed to the ground", DOWN, GROUND, [0.1, 0.2, 0.0],
        end=FREE | {"force": [0.0, 2.0, -3.0]}),
    led("free: drawn back across a table, all but straight", ABOVE, TABLE, [-0.15, 0.0, 0.0], weight=10.0),
    led("free: pushed over the edge of a table", LEVEL, TABLE, [0.2, 0.0, 0.0], weight=10.0),
    led("free: hangs straight, led against a ball", hangs(0.0), BALL, [0.4, 0.0, 0.0], weight=5.0),
    led("free: hangs straight, lowered beside the top of a ball", hangs(0.0), BELOW, [0.0, 0.0, -0.18],
        weight=5.0),
    led("free: hangs all but straight, lowered to the ground", hangs(1e-3), GROUND, [0.0, 0.0, -0.4],
        weight=5.0),
    led("free: hangs leaning by 3 degrees, lowered to the ground", hangs(0.05), GROUND, [0.0, 0.0, -0.4],
        weight=5.0),
    led("free: hangs heavy, lowered to the ground", hangs(1e-3), GROUND, [0.0, 0.0, -0.2], weight=60.0),
    led("free: hangs light, drawn over the ground it rests on", hangs(0.3), GROUND, [0.0, 0.3, -0.3],
        weight=0.5),
    led("free: pushed head on against a wall", LEVEL, WALL, [0.2, 0.0, 0.0], weight=1.0),
    Case("free start: comes down aside", among(FREE, ASIDE | CART, GROUND, weight=30.0),
         np.array([0.0, 0.0, -0.15])),
    *(passed(name) for name in PAIRS if "moment" not in name),
    *(passed(name, **LONGER) for name in ("pinned", "swivel start", "sliding", "free start")),
    led("free: stretches, comes down in its plane, rests, lies", LEVEL, GROUND, [0.0, 0.0, -0.15], **LONGER),
    led("free: stretches, hangs leaning, lowered to the ground", hangs(0.05), GROUND, [0.0, 0.0, -0.4],
        weight=5.0, **LONGER),
    led("free: stretches, drawn across the ground", DOWN, GROUND, [0.0, 0.4, 0.0], **LONGER),
    led("free: stretches, pushed over the edge of a table", LEVEL, TABLE, [0.2, 0.0, 0.0], weight=10.0,
        **LONGER),
    led("free: stretches, hangs straight, led against a ball", hangs(0.0), BALL, [0.4, 0.0, 0.0], weight=5.0,
        **LONGER),
)  # fmt: skip
