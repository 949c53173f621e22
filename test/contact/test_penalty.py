# SPDX-License-Identifier: Apache-2.0
"""Obstacles as springs: what they see between samples, and their tangents."""

from __future__ import annotations

import numpy as np
import pytest
from nodal_scenes import STIFFNESS, obstacle, rotation

from cable_ros.contact.distance import BOX
from cable_ros.contact.penalty import PenaltyProblem
from cable_ros.contact.touching_rod import TouchingRod
from cable_ros.rod.elements import Mesh, reference_element

SPRING = 1e4
DEPTH = 1e-3
"""Of the rod in the edge, L."""
RADIUS = 0.01
"""Of what nodal_scenes.obstacle has about it, L."""
EDGE = rotation([0.0, 0.25 * np.pi, 0.0])


def over_edge(at: float) -> tuple[TouchingRod, np.ndarray]:
    """A straight rod along z that an edge of a box, at arc length `at`, stands DEPTH into."""
    rod = TouchingRod(Mesh(reference_element(4), np.full(8, 0.125)), STIFFNESS, None, 1e-3)
    turned = 0.1 * np.sqrt(2.0)
    box = obstacle(BOX, [DEPTH - RADIUS - turned, 0.0, at], [0.0, 0.25 * np.pi, 0.0], [0.1, 0.3, 0.1])
    q = np.tile([1.0, 0.0, 0.0, 0.0], (rod.mesh.nodes.shape[0], 1))
    rod.set_conditions(q[-1], np.array([0.0, 0.0, 1.0]), np.zeros(3), box[None])
    return rod, q


def bent(rod: TouchingRod, q: np.ndarray, size: float) -> np.ndarray:
    step = size * np.random.default_rng(1).normal(size=3 * len(q))
    step[:3] = step[-3:] = 0.0
    return rod.retract(q, step)


@pytest.mark.parametrize("part", [0.0, 0.3, 0.5, 0.9])
def test_a_foundation_presses_alike_wherever_an_edge_is_between_two_samples(part: float) -> None:
    rod, _ = over_edge(0.5)
    rod, q = over_edge(0.5 + part * rod.spacing)
    foundation, at_samples = (PenaltyProblem(rod, SPRING, kind).value(q)[0] for kind in (True, False))
    s = np.linspace(-RADIUS, RADIUS, 20001)
    depth = np.maximum(0.0, RADIUS - np.hypot(RADIUS - DEPTH, s))
    # what a circle is more than a parabola
    assert foundation == pytest.approx(0.5 * SPRING * np.trapezoid(depth**2, s), rel=1e-3)
    if part == 0.5:
        assert at_samples < 1e-12  # the samples beside it do not see it


def test_the_energy_has_this_gradient_and_hessian() -> None:
    rod, straight = over_edge(0.5 + 0.3 * TouchingRod(
        Mesh(reference_element(4), np.full(8, 0.125)), STIFFNESS, None, 1e-3).spacing)  # fmt: skip
    q = bent(rod, straight, 1e-4)
    problem = PenaltyProblem(rod, SPRING, foundation=True)
    direction = np.random.default_rng(2).normal(size=3 * len(q))
    direction[:3] = direction[-3:] = 0.0
    force = np.zeros(3)

    def gradient(x: np.ndarray) -> np.ndarray:
        return problem.linearize(x, force)[2]

    h = 1e-6
    there, back = rod.retract(q, h * direction), rod.retract(q, -h * direction)
    slope = (problem.value(there)[0] - problem.value(back)[0]) / (2 * h)
    assert gradient(q) @ direction == pytest.approx(slope, rel=1e-6)
    change = (gradient(there) - gradient(back)) @ direction / (2 * h)
    problem.linearize(q, force)
    assert direction @ problem.apply_hessian(direction) == pytest.approx(change, rel=1e-4)
