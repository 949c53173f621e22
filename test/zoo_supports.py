# SPDX-License-Identifier: Apache-2.0
"""Hard cases of pins, rings and tubes by name; `test_zoo_supports` says what must hold for each.

They are apart from the zoo's others, whose judge knows a cable between two ends only: these are judged by
shooting over all pieces.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation
from test_ends import END, START, mapping
from test_supports import FREE, SOFT, TILT, axis, support

from cable_ros import Tracker
from cable_ros.equilibrium import Equilibrium, Status
from cable_ros.scene import load_scene

CART = """
<robot name="r"><link name="base"/><link name="a"/><link name="b"/><link name="cart"/>
<joint name="x" type="prismatic"><parent link="base"/><child link="a"/><axis xyz="1 0 0"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
<joint name="y" type="prismatic"><parent link="a"/><child link="b"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
<joint name="z" type="prismatic"><parent link="b"/><child link="cart"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>
"""
FLIP = np.diag([1.0, -1.0, 1.0])


def there_and_back(steps: int) -> np.ndarray:
    """(2 steps + 1,) fractions of a path, in so many steps each way."""
    there = np.linspace(0.0, 1.0, steps + 1)
    return np.concatenate([there, there[-2::-1]])


@dataclass(frozen=True)
class Case:
    """A cable whose end, and what else is on the link `cart`, is led straight from home and back."""

    name: str
    scene: dict[str, Any]
    """At home all joints are 0, and links are where the world is."""
    to: np.ndarray
    """(3,) how far the cart moves, m."""
    shot: float = 1.0
    """Fraction of the path up to which shooting finds it: not a cable that is all but straight."""

    def joints(self, part: float) -> dict[str, float]:
        """Joint values at a fraction of the path."""
        return dict(zip("xyz", (part * self.to).tolist(), strict=True))

    def tracker(self, tolerance: float) -> Tracker:
        """One of its scene that has solved nothing."""
        return Tracker(load_scene(self.scene, urdf=CART), tolerance=tolerance)

    def led(self, parts: np.ndarray, tolerance: float) -> list[Equilibrium]:
        """The equilibria at fractions of the path, one after the other; none of the cases snaps."""
        tracker, out = self.tracker(tolerance), []
        for part in parts:
            found = tracker.arrive(self.joints(part))["c"]
            assert found.status is Status.CONVERGED, found.message
            out.append(found)
        return out

    def mounts(self) -> list[dict[str, Any]]:
        """The mounts of the cable in the scene: start, end, supports."""
        (cable,) = self.scene["cables"]
        inner = [one[kind] for one in cable["supports"] for kind in one if kind != "name"]
        return [cable["start"], cable["end"], *inner]

    def mirrored(self) -> Case:
        """Seen in a mirror across y."""
        image = Case(self.name, copy.deepcopy(self.scene), FLIP @ self.to)
        for mount in image.mounts():
            mount["position"] = (FLIP @ mount["position"]).tolist()
            own = FLIP @ frame(mount).as_matrix() @ FLIP
            mount.pop("rpy", None)
            mount["orientation"] = Rotation.from_matrix(own).as_quat().tolist()
        return image

    def fixed(self, part: float) -> dict[str, Any]:
        """The cable of the scene at a fraction of the path, all of it in the world."""
        there = Case(self.name, copy.deepcopy(self.scene), self.to)
        for mount in there.mounts():
            if mount.pop("link", None):
                mount["position"] = (mount["position"] + part * self.to).tolist()
        (cable,) = there.scene["cables"]
        return cable


@dataclass(frozen=True)
class Answers:
    """What a case's path ends in, told in several ways; each is solved once."""

    case: Case
    tolerance: float

    EIGHT = np.linspace(0.0, 1.0, 9)
    """Fractions of the path in 8 steps."""

    @cached_property
    def there_and_back(self) -> list[Equilibrium]:
        """In 16 steps there and as many back."""
        return self.case.led(there_and_back(16), self.tolerance)

    @cached_property
    def in_eight(self) -> list[Equilibrium]:
        """There in 8 steps."""
        return self.case.led(self.EIGHT, self.tolerance)

    def in_steps(self) -> list[Equilibrium]:
        """The last one of the path in 2, 8 and 16 steps."""
        few = self.case.led(np.linspace(0.0, 1.0, 3), self.tolerance)
        return [few[-1], self.in_eight[-1], self.there_and_back[16]]

    def beside(self) -> list[Equilibrium]:
        """The last one of the path, and of another that differs from it in the twelfth digit."""
        return [self.in_eight[-1], self.case.led(self.EIGHT * (1.0 + 1e-12), self.tolerance)[-1]]


def frame(mount: dict[str, Any]) -> Rotation:
    """Orientation of a mount, or of the axes of its wrench."""
    if "rpy" in mount:
        return Rotation.from_euler("xyz", mount["rpy"])
    return Rotation.from_quat(mount.get("orientation", [0.0, 0.0, 0.0, 1.0]))


def held(
    name: str, where: list[tuple[str, int, list[float]]], to: list[float], weight: float = 30.0,
    on_cart: tuple[str, ...] = ("end",), shot: float = 1.0, **fields: Any,
) -> Case:  # fmt: skip
    """A case of supports s0, s1.. at percents of the plain cable, moved by a shift, and what moves; `fields`
    of the cable.
    """
    supports = []
    for i, (kind, k, shift) in enumerate(where):
        placed = axis(kind, k, TILT) | ({"link": "cart"} if f"s{i}" in on_cart else {})
        supports.append(support(kind, f"s{i}", k / 100, FREE.points[k] + shift, **placed))
    end = END | ({"link": "cart"} if "end" in on_cart else {})
    return Case(name, mapping(START, end, weight=weight, supports=supports, **fields), np.array(to), shot)


CLOSE = [0.0012, -0.0012, 0.0008]
SIDE, OTHER = [0.01, -0.015, 0.02], [-0.01, 0.02, 0.01]
LONGER = {"axial_stiffness": 400.0}
THREE = [("pin", 20, CLOSE), ("ring", 50, OTHER), ("tube", 75, SIDE)]
CASES = (
    held("a ring near a clamp", [("ring", 3, CLOSE)], [0.1, -0.15, 0.1]),
    held("a tube near a clamp", [("tube", 6, CLOSE)], [0.05, -0.1, 0.05]),
    held("a ring that slides far", [("ring", 30, SIDE)], [0.14, 0.07, -0.014], on_cart=("s0",)),
    held("a tube that slides far", [("tube", 30, SIDE)], [0.15, 0.08, 0.0], on_cart=("s0",)),
    held("a ring, slack and then taut", [("ring", 35, SIDE)], [0.138, 0.09, 0.021], shot=0.8),
    held("a tube, slack and then taut", [("tube", 35, SIDE)], [0.138, 0.092, 0.0], shot=0.8),
    held("a piece buckles between pins", [("pin", 30, SIDE), ("pin", 60, SIDE)], [-0.12, -0.1, 0.0], 1.0,
         on_cart=("s1", "end")),
    held("a pin, a ring and a tube", THREE, [0.03, -0.06, 0.05]),
    held("a ring, no weight", [("ring", 35, SIDE)], [0.1, -0.1, 0.05], 0.0),
    held("a tube, no weight", [("tube", 35, SIDE)], [0.1, -0.1, 0.05], 0.0),
    held("a pin, a ring and a tube, no weight", THREE, [0.03, -0.06, 0.05], 0.0),
    held("a ring, slack and then longer than unloaded", [("ring", 35, SIDE)], [0.2, 0.15, 0.03], **LONGER),
    held("a tube, slack and then longer than unloaded", [("tube", 35, SIDE)], [0.2, 0.15, 0.0], **LONGER),
    held("a pin beside which a piece gets longer", [("pin", 40, SIDE)], [0.15, 0.1, 0.0], **LONGER),
    held("a ring, hardly stretching", [("ring", 35, SIDE)], [0.138, 0.09, 0.021], shot=0.8,
         axial_stiffness=1e6),
    held("a stretching ring that slides far", [("ring", 30, SIDE)], [0.14, 0.07, -0.014], on_cart=("s0",),
         **SOFT),
    held("a stretching tube that slides far", [("tube", 30, SIDE)], [0.15, 0.08, 0.0], on_cart=("s0",),
         **SOFT),
    held("a pin, a ring and a tube, stretching", THREE, [0.03, -0.06, 0.05], **SOFT),
    held("a ring near a clamp, stretching", [("ring", 3, CLOSE)], [0.1, -0.15, 0.1], **SOFT),
    held("a stretching ring, no weight", [("ring", 35, SIDE)], [0.1, -0.1, 0.05], 0.0, **SOFT),
    held("a stretching piece buckles between pins", [("pin", 30, SIDE), ("pin", 60, SIDE)],
         [-0.12, -0.1, 0.0], 1.0, on_cart=("s1", "end"), **SOFT),
)  # fmt: skip
