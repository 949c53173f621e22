# SPDX-License-Identifier: Apache-2.0
"""Of two mirror images a search takes the same one, whatever the last digits of the joints."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cable_ros import Tracker
from cable_ros.bench.cases import case_scene
from cable_ros.bench.drawn import drawn_case
from cable_ros.branch.cold_start import Conditions, Sought
from cable_ros.branch.mirror_image import plane_of_symmetry, reflected
from cable_ros.rod import quaternion

PLANAR = Sought(
    np.array([1.0, 1.0, 0.75]),
    np.zeros(3),
    Conditions(
        np.array([np.cos(0.3), 0.0, np.sin(0.3), 0.0]), np.array([0.4, 0.0, 0.6]), np.array([-9.0, 0.0, 2.0])
    ),
    None,
    1e-4,
)
"""All in the plane y = 0."""


def test_the_plane_is_that_of_ends_and_load() -> None:
    n = plane_of_symmetry(PLANAR)
    assert n is not None
    assert np.abs(n) == pytest.approx([0.0, 1.0, 0.0])


@pytest.mark.parametrize("twist", [0.0, 1e-16, -1e-9])
def test_a_twist_of_rounding_leaves_the_symmetry(twist: float) -> None:
    """A search that follows a loss asks for the twist that the branch had."""
    assert plane_of_symmetry(replace(PLANAR, target_twist=twist)) is not None


@pytest.mark.parametrize(
    "other",
    [
        {"conditions": replace(PLANAR.conditions, re=np.array([0.4, 1e-6, 0.6]))},
        {"conditions": replace(PLANAR.conditions, f=np.array([0.0, 9.0, 0.0]))},
        {"conditions": replace(PLANAR.conditions, qe=np.array([np.cos(0.3), 0.0, 0.0, np.sin(0.3)]))},
        {"stiffness": np.array([1.0, 2.0, 0.75]), "conditions": replace(PLANAR.conditions, f=np.zeros(3))},
        {"natural": np.array([1.0, 0.0, 0.0])},
        {"target_twist": 1.0},
    ],
    ids=["offset", "load", "twisted end", "still a plane", "natural curvature", "twist"],
)
def test_what_breaks_the_symmetry(other: dict[str, object], request: pytest.FixtureRequest) -> None:
    """A section with its axes in the plane and across it does not."""
    plane = plane_of_symmetry(replace(PLANAR, **other))
    assert (plane is not None) == ("still a plane" in request.node.callspec.id)


def test_reflected_frames() -> None:
    """The tangents are reflected; the start clamp's frame and the image's image are the same."""
    q = np.random.default_rng(1).normal(size=(7, 4))
    q /= np.linalg.norm(q, axis=1)[:, None]
    q[0] = [1.0, 0.0, 0.0, 0.0]
    n = np.array([0.6, 0.8, 0.0])  # across the start clamp's tangent
    image = reflected(q, n)
    mirror = np.eye(3) - 2.0 * np.outer(n, n)
    np.testing.assert_allclose(quaternion.tangents(image), quaternion.tangents(q) @ mirror, atol=1e-15)
    np.testing.assert_allclose(image[0], q[0], atol=1e-15)
    np.testing.assert_allclose(reflected(image, n), q, atol=1e-15)


@pytest.mark.parametrize("key", [(5, 22), (5, 28)], ids=["by relaxation", "by descent"])
def test_rounding_does_not_choose_the_side(key: tuple[int, int]) -> None:
    """Descents found one image only, and which one came of the joints' twelfth digit."""
    case = drawn_case(*key, 1e-4)
    random = np.random.default_rng(3)
    wrenches = []
    for size in (0.0, 1e-12, 1e-12, 1e-12, 1e-12):
        joints = {name: value + size * random.uniform(-1.0, 1.0) for name, value in case.path[0].items()}
        found = Tracker(case_scene(case), tolerance=1e-4).arrive(joints)["cable"]
        assert "one of 2 of equal energy" in found.message
        wrenches.append(found.end_wrench)
    np.testing.assert_allclose(wrenches, wrenches[:1] * 5, atol=1e-4 * np.abs(wrenches[0]).max())
    assert abs(wrenches[0][3]) > 0.1 * np.abs(wrenches[0][3:]).max()  # the moment across tells them apart
