# SPDX-License-Identifier: Apache-2.0
"""Contact against what is known without the solver: closed forms and manufactured cases."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from references import contact, planar
from references.reference import Reference
from scipy.special import ellipk
from test_rough_supports import URDF, arrived, hanging
from zoo_contact import rising

from cable_ros import Equilibrium, Status, Tracker
from cable_ros.bench.cases import Case, case_scene
from cable_ros.scene import load_scene


def at_the_end(case: Case, tolerance: float) -> list[Equilibrium]:
    tracker = Tracker(case_scene(case), tolerance=tolerance)
    return [tracker.solve(dict(pose))["cable"] for pose in case.path]


def error(found: np.ndarray, exact: np.ndarray) -> float:
    return float(np.linalg.norm(found - exact) / np.linalg.norm(exact))


def pressed(phase: float) -> tuple[Reference, Case]:
    """An arch that the rising ground presses at its middle; a whisper of weight chooses its side."""
    reference = contact.pressed_at_a_point(0.4, phase * float(ellipk(0.16)))
    down = replace(reference, weight=np.array([0.0, -1e-9, 0.0]))
    return reference, rising("arch", "closed form", down)


@pytest.mark.parametrize("phase", [1.05, 1.2, 1.35])
@pytest.mark.parametrize("tolerance", [1e-2, 1e-4, 1e-6, 1e-8])
def test_a_pressed_arch_within_the_asked_tolerance(phase: float, tolerance: float) -> None:
    reference, case = pressed(phase)
    found = at_the_end(case, tolerance)[-1]
    assert found.status is Status.CONVERGED
    # lengths are 1, so force and moment count alike; the weight of 1e-9 changes the wrench by about itself
    assert error(found.end_wrench, reference.end_wrench) < tolerance + 1e-9
    assert error(found.start_wrench, reference.start_wrench) < tolerance + 1e-9
    (touch,) = found.contacts
    assert touch.arc_length == pytest.approx(0.5, abs=tolerance)
    assert touch.normal == pytest.approx([0.0, 1.0, 0.0], abs=1e-9)
    # the force is the difference of both ends' forces, which are larger
    assert touch.force[1] == pytest.approx(
        reference.facts["contact_force_y"], abs=2 * tolerance * np.linalg.norm(reference.end_wrench) + 1e-7
    )
    assert not touch.sliding
    assert found.points[:, 1].min() > -1e-6


def test_the_estimate_covers_contact() -> None:
    for tolerance in (1e-3, 1e-5, 1e-7):
        reference, case = pressed(1.2)
        found = at_the_end(case, tolerance)[-1]
        assert error(found.end_wrench, reference.end_wrench) < 3 * found.error_estimate + 1e-9


def test_touching_starts_where_the_free_arch_arrives() -> None:
    reference, case = pressed(1.2)
    # the same arch without the ground: buckled rods of this chord hang this far below their clamps
    arch = planar.buckled(1.0, 1.0, 2 * reference.end[0])
    free = Tracker(case_scene(Case("free", "", arch.scene()))).solve({})["cable"]
    sag = float(np.abs(free.points[:, 1]).max())
    for pose, one in zip(case.path, at_the_end(case, 1e-4), strict=True):
        clear = reference.start[1] - pose["y"] - sag
        assert abs(clear) > 1e-4, "the ground stops too near to the arch to tell"
        assert bool(one.contacts) == (clear < 0.0)


@pytest.mark.parametrize("friction", [0.0, 0.3])
@pytest.mark.parametrize("beside", [-0.3, 0.02], ids=["alone", "beside a hump"])
@pytest.mark.parametrize("radius", [1e-3, 4e-3])
def test_what_is_thinner_than_a_step_does_not_pass_through_the_cable(radius, beside, friction) -> None:
    """A roller rises under a hanging cable, which may lie on a hump, in steps of 0.5 mm to 0.2 m."""
    scene = hanging(friction, radius)
    scene["obstacles"][1]["friction"] = friction
    held = []
    for poses in (1, 2, 20, 400):
        tracker = Tracker(load_scene(scene, urdf=URDF), joint_limits="ignore")
        for rise in np.linspace(-0.2, 0.0, poses + 1):
            found = arrived(tracker, rise=rise, hump=beside)
        assert found.status is Status.CONVERGED, found.message
        assert "roller" in [contact.obstacle for contact in found.contacts], "it is above the cable"
        held.append(found.end_wrench)
    atol = (0.01 if friction else 1e-3) * np.abs(held[-1]).max()
    np.testing.assert_allclose(held, np.broadcast_to(held[-1], (4, 6)), atol=atol)
