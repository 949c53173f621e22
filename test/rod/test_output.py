# SPDX-License-Identifier: Apache-2.0
"""The compiled polyline against its plain twin: SciPy's rotations and Simpson's rule."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from cable_ros.rod.elements import Mesh, integrals, reference_element, sampling
from cable_ros.rod.output import polyline, polyline_anywhere

LENGTH = 0.7


def rod(order: int, lengths: list[float]) -> tuple[Mesh, np.ndarray]:
    """A mesh and the nodal quaternions (n, 4), scalar first, of a rod that winds in all directions."""
    mesh = Mesh(reference_element(order), np.array(lengths))
    s = mesh.nodes
    turns = np.column_stack([np.sin(3 * s), 1.5 * s**2, 2 * s - s**3])
    return mesh, Rotation.from_rotvec(turns).as_quat()[:, [3, 0, 1, 2]]


@pytest.mark.parametrize(
    ("order", "lengths"), [(3, [0.125] * 8), (6, [0.2, 0.35, 0.45]), (5, [0.3, 0.2, 0.5])]
)
@pytest.mark.parametrize("count", [2, 7, 101])
def test_polyline_is_the_integral_of_its_own_tangents(order, lengths, count):
    mesh, q = rod(order, lengths)
    start = np.array([0.3, -1.2, 0.5, *Rotation.from_rotvec([0.4, -2.0, 1.1]).as_quat()])
    table = sampling(mesh, count)
    points, orientations = np.empty((count, 3)), np.empty((count, 4))
    polyline(q, mesh.lengths, table, start, LENGTH, points, orientations)

    fine = np.linspace(0.0, 1.0, 100 * 40 * 6 + 1)  # holds every coarse arc length
    clamp = Rotation.from_quat(start[3:])
    frames = clamp * Rotation.from_quat(mesh.interpolate(q, fine)[:, [1, 2, 3, 0]])
    tangents = frames.apply([0.0, 0.0, 1.0])
    way = CubicSpline(fine, tangents).antiderivative()(fine)
    picked = np.linspace(0, len(fine) - 1, count).round().astype(int)
    # the order + 4 points of an element integrate the normalised polynomials of these bends to a few 1e-8
    assert points == pytest.approx(start[:3] + LENGTH * way[picked], abs=1e-7)
    turned = (frames[picked].inv() * Rotation.from_quat(orientations)).magnitude()
    assert turned == pytest.approx(0.0, abs=1e-7)  # acos near 1 loses half the digits
    assert np.linalg.norm(orientations, axis=1) == pytest.approx(1.0, abs=1e-15 * 4)


@pytest.mark.parametrize(("order", "lengths"), [(3, [0.125] * 8), (6, [0.2, 0.35, 0.45])])
def test_without_tables_the_polyline_is_the_same(order, lengths):
    mesh, q = rod(order, lengths)
    start = np.array([0.3, -1.2, 0.5, *Rotation.from_rotvec([0.4, -2.0, 1.1]).as_quat()])
    table = sampling(mesh, 50)
    results = [(np.empty((50, 3)), np.empty((50, 4))) for _ in range(2)]
    polyline(q, mesh.lengths, table, start, LENGTH, *results[0])
    at = np.arange(50) / 49
    polyline_anywhere(q, mesh.lengths, mesh.starts, *integrals(order), at, start, LENGTH, *results[1])
    # the same integrals, but in powers of the place: their coefficients cancel to some 1e-11
    assert results[1][0] == pytest.approx(results[0][0], abs=1e-10)
    assert results[1][1] == pytest.approx(results[0][1], abs=1e-12)
