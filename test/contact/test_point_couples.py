# SPDX-License-Identifier: Apache-2.0
"""Friction at a rigid arm: its pull is the gradient of its potential, its stiffness that one's derivative."""

from __future__ import annotations

import numpy as np
import pytest
from nodal_scenes import STIFFNESS

from cable_ros.contact.distance import AXES, DIMENSIONS, OFFSET, SHAPE, SPHERE, WIDTH
from cable_ros.contact.friction_kernels import FRICTIONLESS
from cable_ros.contact.points import (
    ARC_LENGTH,
    ARM,
    GIVEN,
    HOLD,
    INTERFACE,
    KIND,
    SAMPLE,
    SPRING,
    TARGET,
)
from cable_ros.contact.report import positions
from cable_ros.contact.touching_rod import TouchingRod
from cable_ros.rod import quaternion
from cable_ros.rod.elements import Mesh, reference_element

ARCS = np.array([0.25, 0.4])
"""At a boundary between two elements, and inside one."""
FORCES = np.array([[3.0, -2.0, 1.0], [-1.0, 4.0, 2.0]])
ARMS = np.array([[0.02, 0.05, 0.0], [-0.04, 0.01, 0.03]])
PLACES, STIFFNESSES = np.array([[0.1, 0.0, 0.2], [0.0, -0.1, 0.45]]), np.array([30.0, 0.0])


def loaded() -> tuple[TouchingRod, np.ndarray]:
    """A bent rod with two forces at arms, the one of them held by a spring, and its nodal frames."""
    rod = TouchingRod(Mesh(reference_element(4), np.full(8, 0.125)), STIFFNESS, None, 1e-3)
    row = np.zeros(WIDTH)
    row[SHAPE], row[AXES:DIMENSIONS], row[OFFSET] = SPHERE, np.eye(3).ravel(), -1e6
    q = np.tile([1.0, 0.0, 0.0, 0.0], (rod.mesh.nodes.shape[0], 1))
    rod.set_conditions(q[-1], np.array([0.0, 0.0, 0.9]), np.array([0.0, 0.0, -3.0]), row[None])
    rod.count = 2
    points = rod.points[:2]
    points[:, KIND], points[:, INTERFACE] = SAMPLE, -1.0
    points[:, ARC_LENGTH], points[:, HOLD], points[:, ARM : ARM + 3] = 0.7, ARCS, ARMS
    points[:, GIVEN : GIVEN + 3], points[:, TARGET : TARGET + 3] = FORCES, PLACES
    points[:, SPRING] = STIFFNESSES
    step = 0.1 * np.random.default_rng(1).normal(size=3 * len(q))
    step[:3] = step[-3:] = 0.0
    return rod, rod.retract(q, step)


def potential(rod: TouchingRod, q: np.ndarray) -> float:
    """Energy of the rod, of the forces and of the spring."""
    energy, _ = rod.value(q)
    rod.trace(q)
    frames = rod.mesh.interpolate(q, ARCS)
    ends = positions(rod.c, rod.h, rod.s0, ARCS) + [
        quaternion.rotate(one, arm) for one, arm in zip(frames, ARMS, strict=True)
    ]
    springs = 0.5 * STIFFNESSES @ ((PLACES - ends) ** 2).sum(axis=1)
    return float(energy - (FORCES * ends).sum() + springs)


def test_the_potential_has_this_gradient_and_hessian() -> None:
    rod, q = loaded()
    direction = np.random.default_rng(2).normal(size=3 * len(q))
    direction[:3] = direction[-3:] = 0.0

    def gradient(x: np.ndarray) -> np.ndarray:
        rod.trace(x)
        rod.rows = rod.assemble(x, np.zeros(3), FRICTIONLESS)
        return rod.g.ravel().copy()

    h = 1e-5
    there, back = rod.retract(q, h * direction), rod.retract(q, -h * direction)
    slope = (potential(rod, there) - potential(rod, back)) / (2 * h)
    assert gradient(q) @ direction == pytest.approx(slope, rel=1e-7)
    change = (gradient(there) - gradient(back)) @ direction / (2 * h)
    gradient(q)
    rows = rod.V[3 + rod.count : rod.rows] @ direction  # of the spring, after those of contact
    assert rod.rows == 3 + rod.count + 3
    assert rows**2 / rod.delta[3 + rod.count : rod.rows] @ np.ones(3) > 0.0
    stiffness = direction @ rod.apply_hessian(direction) + rows**2 @ (
        1.0 / rod.delta[3 + rod.count : rod.rows]
    )
    assert stiffness == pytest.approx(change, rel=1e-6)
