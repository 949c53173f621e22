# SPDX-License-Identifier: Apache-2.0
"""The least distance from obstacles against many samples, for every shape and several at once."""

from __future__ import annotations

import numpy as np
import pytest
from nodal_scenes import ground, obstacle, shapes
from references.rods import reference

from cable_ros.contact.clearance import clearance
from cable_ros.contact.distance import BOX, SPHERE, gaps
from cable_ros.rod.centreline import curve, position
from cable_ros.rod.elements import integrals

NAMES = ("space_arm_+0.0deg", "cable_02", "cable_05")
COUNT = 20_001


def centreline(name: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Coefficients, lengths and starts of the elements of a known cable."""
    found = reference(name)
    values, primitives, _ = integrals(found.rod.mesh.element.order)
    c = np.empty((len(found.rod.h), len(values) + 1, 3))
    curve(found.q, found.rod.h, values, primitives, c)
    return c, found.rod.h, found.rod.s0


def sampled(c: np.ndarray, h: np.ndarray, s0: np.ndarray, bodies: np.ndarray) -> tuple[float, int]:
    """Least of all distances at many places, and to which obstacle."""
    r = np.empty(3)
    all_of_them = np.empty((COUNT, len(bodies)))
    for k, s in enumerate(np.linspace(0.0, 1.0, COUNT)):
        position(c, h, s0, s, r)
        all_of_them[k] = gaps(bodies, r)
    return float(all_of_them.min()), int(all_of_them.min(axis=0).argmin())


def check(name: str, bodies: np.ndarray) -> None:
    curve_of = centreline(name)
    found, at, which = clearance(*curve_of, bodies, np.inf)
    expected, nearest = sampled(*curve_of, bodies)
    # The distance changes by no more than the arc length: a sample misses the least by half a step at most.
    assert expected - 0.5 / (COUNT - 1) <= found <= expected + 1e-12
    assert which == nearest
    r = np.empty(3)
    position(*curve_of, at, r)
    assert gaps(bodies, r)[which] == found


@pytest.mark.parametrize("shape", shapes())
@pytest.mark.parametrize("name", NAMES)
def test_of_each_shape(name, shape):
    check(name, shapes()[shape][None])


@pytest.mark.parametrize("seed", range(8))
def test_of_many_at_once(seed):
    """Small ones, many of them beside each other: what cannot be nearest is left out, and nothing else."""
    rng = np.random.default_rng(seed)
    bodies = [
        obstacle(kind, rng.uniform(-0.5, 0.7, 3), rng.normal(size=3), rng.uniform(0.01, 0.1, 3))
        for kind in rng.choice([SPHERE, BOX], 30)
    ]
    check(NAMES[seed % 3], np.array([*bodies, ground(-0.6)]))


def test_of_nothing_it_is_infinite():
    assert clearance(*centreline(NAMES[0]), shapes()["box"][None][:0], np.inf)[0] == np.inf
