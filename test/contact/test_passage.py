# SPDX-License-Identifier: Apache-2.0
"""What a step may have passed through, against all samples beside all obstacles in plain NumPy."""

from __future__ import annotations

import numpy as np
import pytest
from references.rods import reference
from scipy.spatial.transform import Rotation

from cable_ros.contact.distance import AXES, BOX, CAPSULE, CENTRE, DIMENSIONS, OFFSET, PLANE, SPHERE, WIDTH
from cable_ros.contact.gap_search import passed
from cable_ros.rod.centreline import curve, position
from cable_ros.rod.elements import integrals

SAMPLES = np.linspace(0.0, 1.0, 41)
OBSTACLES = 12


def solids(rng: np.random.Generator, points: np.ndarray, near: float) -> np.ndarray:
    """Thin and thick ones, half of them about so near to some of the points (n, 3), anyhow turned."""
    rows = np.zeros((OBSTACLES, WIDTH))
    for row in rows:
        row[0] = rng.choice([SPHERE, CAPSULE, BOX, PLANE])
        row[CENTRE:AXES] = rng.uniform(-1.0, 1.0, 3)
        if rng.random() < 0.5:
            row[CENTRE:AXES] = rng.choice(points) + near * rng.normal(size=3)
        row[AXES:DIMENSIONS] = Rotation.random(random_state=rng).as_matrix().ravel()
        count = {SPHERE: 1, CAPSULE: 2, BOX: 3, PLANE: 0}[row[0]]
        row[DIMENSIONS : DIMENSIONS + count] = 10.0 ** rng.uniform(-3.0, -0.5, count)
        row[OFFSET] = rng.choice([0.0, 0.01])
    return rows


def moved(rows: np.ndarray, rng: np.random.Generator, size: float) -> np.ndarray:
    """Each one shifted and turned by about so much, or resting."""
    out = rows.copy()
    for row in out[rng.random(len(out)) < 0.7]:
        row[CENTRE:AXES] += size * rng.normal(size=3)
        turn = Rotation.from_rotvec(size * rng.normal(size=3)).as_matrix()
        row[AXES:DIMENSIONS] = (turn @ row[AXES:DIMENSIONS].reshape(3, 3)).ravel()
    return out


@pytest.mark.parametrize("size", [1e-4, 1e-3, 1e-2, 0.1])
def test_nothing_that_is_left_out_can_have_passed(size):
    """Crossed or not is the same; bodies and cable move by as much as a solid is thick, more and less."""
    rng = np.random.default_rng(round(1.0 / size))
    rod = reference("space_arm_+0.0deg")
    values, primitives, _ = integrals(rod.rod.mesh.element.order)
    h, s0 = rod.rod.h, rod.rod.s0
    c = np.empty((len(h), len(values) + 1, 3))
    curve(rod.q, h, values, primitives, c)
    points = np.empty((len(SAMPLES), 3))
    for s, point in zip(SAMPLES, points, strict=True):
        position(c, h, s0, s, point)
    answers, beside = [], 0.5 * (SAMPLES[1] - SAMPLES[0])  # what is nearest may be between two samples
    for _ in range(60):
        old_c = c.copy()
        old_c[:, 0] += size * rng.normal(size=3)
        old = solids(rng, points, 3.0 * size)
        new = moved(old, rng, size)
        phi = np.empty((OBSTACLES, len(SAMPLES)))
        _, crossed = passed(old_c, (c, h, s0), SAMPLES, old, new, phi)
        before, expected = np.empty(3), False
        for k in range(1, len(SAMPLES) - 1):
            position(old_c, h, s0, SAMPLES[k], before)
            for o in range(OBSTACLES):
                there = new[o, AXES:DIMENSIONS].reshape(3, 3).T @ (points[k] - new[o, CENTRE:AXES])
                here = old[o, AXES:DIMENSIONS].reshape(3, 3).T @ (before - old[o, CENTRE:AXES])
                motion, sizes = np.linalg.norm(there - here), new[o, DIMENSIONS:OFFSET]
                if (
                    sizes.any()
                    and motion > sizes[sizes > 0.0].min() + new[o, OFFSET]
                    and phi[o, k] < motion + beside
                ):
                    expected = True
        assert crossed == expected
        answers.append(expected)
    assert size < 1e-2 or any(answers)
    assert size > 1e-2 or not all(answers)
