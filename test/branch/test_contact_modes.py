# SPDX-License-Identifier: Apache-2.0
"""Natural frequencies of cables that touch, with and without stretch: a beam, a plane, a reference."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from references import vibrations
from references.two_spans import two_spans
from scipy.spatial.transform import Rotation

from cable_ros import Equilibrium, Tracker, load_scene
from cable_ros.branch.modes import modes
from cable_ros.contact.nodal_rod import NodalRod
from cable_ros.contact.stretching_rod import StretchingTouchingRod

UPRIGHT = {"position": [0.0, 0.0, 0.0], "orientation": [0.0, 0.0, 0.0, 1.0]}
END = {"position": [0.3, 0.0, 0.7], "rpy": [0.2, 0.5, 0.0]}
STIFFNESS, GRAVITY = [1.0, 1.3, 0.8], np.array([1.0, 0.5, -3.0])
CENTRE, AXIS = np.array([0.0224, 0.1639, 0.397]), np.array([0.92, 0.33, 0.4])
AXIS /= np.linalg.norm(AXIS)
BALL = {"sphere": {"center": CENTRE.tolist(), "radius": 0.1}}
BAR = {
    "capsule": {
        "start": (CENTRE - 2.0 * AXIS).tolist(), "end": (CENTRE + 2.0 * AXIS).tolist(), "radius": 0.1,
    }
}  # fmt: skip


def solved(
    body: dict[str, Any] | None, tolerance: float, gravity: Any = GRAVITY, **fields: Any
) -> Equilibrium:
    cable = {
        "name": "cable", "length": 1.0, "start": UPRIGHT, "end": END, "stiffness": STIFFNESS,
        "linear_density": 1.0,
    }  # fmt: skip
    mapping = {
        "gravity": list(gravity), "cable_radius": "ignore", "effects": "all", "cables": [cable | fields],
    }  # fmt: skip
    if body is not None:
        mapping["obstacles"] = [{"name": "body", **body}]
    (found,) = Tracker(load_scene(mapping), tolerance).arrive({}).values()
    assert found.status.trusted, found.message
    return found


@pytest.mark.parametrize(
    ("body", "axis", "softness", "hook"),
    [
        (BALL, None, 0.0, None), (BALL, None, 1e-3, None), (BAR, AXIS, 0.0, None), (BAR, AXIS, 1e-3, None),
        (BALL, None, 0.0, np.array([0.12, 0.19, 0.56])),
    ],
    ids=["ball", "ball, stretching", "bar", "bar, stretching", "ball and ring"],
)  # fmt: skip
def test_frequencies_are_those_of_the_energy_differentiated(body, axis, softness, hook):
    """At one contact point: exact, with the curvature of the surface and that of the cable."""
    more: dict[str, Any] = {"axial_stiffness": 1.0 / softness} if softness else {}
    held = [vibrations.touch(CENTRE, 0.1, axis)]
    if hook is not None:
        more["supports"] = [{"name": "hook", "ring": {"arc_length": 0.7, "position": hook.tolist()}}]
        held.append(vibrations.ring(hook))
    coarse, fine = (solved(body, tolerance, **more) for tolerance in (1e-4, 1e-8))
    (contact,) = fine.contacts
    assert contact.length == 0.0
    about = [contact.arc_length, *([] if hook is None else fine._tangent._cuts[1:2])]
    turn = np.roll(Rotation.from_euler("xyz", END["rpy"]).as_quat(), 1)
    rod = vibrations.Rod(
        1.0, np.array(STIFFNESS), np.zeros(3), GRAVITY, (np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])),
        (np.array(END["position"]), turn), 1.0, softness,
    )  # fmt: skip
    frames = np.roll(fine.orientations, 1, axis=1)
    reference = vibrations.Vibrations(rod, held, np.array(about), frames, 12)
    reference.solve()
    expected = reference.frequencies(5)
    np.testing.assert_allclose(fine.modes(5).frequencies, expected, rtol=1e-5)
    np.testing.assert_allclose(coarse.modes(5).frequencies, expected, rtol=1e-4)


def test_a_beam_over_a_support_has_the_frequencies_of_two_spans():
    """Hardly pressed on, so that it is straight but for 1e-3; sideways nothing holds it."""
    ball = {"sphere": {"center": [-0.3 + 1e-4, 0.0, 0.4], "radius": 0.3}}
    end = UPRIGHT | {"position": [0.0, 0.0, 1.0]}
    found = solved(
        ball, 1e-7, gravity=(0.0, 0.0, 0.0), end=end, stiffness=[1.0, 1.0, 0.8], axial_stiffness=1e4,
        total_twist=0.0,
    )  # fmt: skip
    assert [contact.length for contact in found.contacts] == [0.0]
    free = np.square([4.730040744862704, 7.853204624095838])
    omega, shapes = 2.0 * np.pi * found.modes(4).frequencies, found.modes(4).shapes
    across = (shapes[..., 0] ** 2).sum(axis=1) > (shapes[..., 1] ** 2).sum(axis=1)
    # tension and the ball's curvature are of the order of the sag, 1e-4
    np.testing.assert_allclose(omega[across], two_spans(0.4, 2), rtol=1e-3)
    np.testing.assert_allclose(omega[~across], free, rtol=1e-3)


def test_along_a_plane_it_vibrates_in_the_plane_as_without_it():
    """The weight presses a cable that is bent in the plane onto it: it has those of one without weight."""
    flat = {
        "start": {"position": [0.0, 0.0, 0.0], "rpy": [0.0, 1.5707963267948966, 0.0]},
        "end": {"position": [0.85, 0.2, 0.0], "rpy": [0.0, 1.5707963267948966, 0.4]},
        "stiffness": [1.0, 1.0, 0.8], "total_twist": 0.0,
    }  # fmt: skip
    plane = {"plane": {"point": [0.0, 0.0, 0.0], "normal": [0.0, 0.0, 1.0]}}
    lying = solved(plane, 1e-7, gravity=(0.0, 0.0, -40.0), **flat)
    assert sum(contact.length for contact in lying.contacts) > 0.9
    free = solved(None, 1e-7, gravity=(0.0, 0.0, 0.0), **flat)
    found, every = lying.modes(3), free.modes(8)
    assert np.abs(found.shapes[..., 2]).max() < 1e-6
    within = np.abs(every.shapes[..., 2]).max(axis=1) < 1e-6
    assert not within.all()
    # how close the samples of the pressure hold it to the plane
    np.testing.assert_allclose(found.frequencies, every.frequencies[within][:3], rtol=1e-4)


def test_on_a_grid_a_cable_that_stretches_has_those_of_exact_contact():
    found = solved(BALL, 1e-6, axial_stiffness=1e3)
    rod, q, F, unit, start = found._tangent.parts()
    assert isinstance(rod, StretchingTouchingRod)
    exact = modes(rod, q, F, start, unit, 1.0, 4, 2).frequencies
    contacts, most = rod.loaded_contacts(q)(), []
    for cells in (64, 256):
        grid = NodalRod(rod.K, rod.natural, rod.obstacles, cells, False, rod.compliance)
        assert grid.adopt(rod, q, F, contacts[0], contacts[3], contacts[4], False)
        there = modes(grid, grid.shape, grid.end_force, start, unit, 1.0, 4, 2).frequencies
        most.append(np.abs(there / exact - 1.0).max())
    # the contact is half a cell off at most
    assert most[0] < 0.02
    assert most[1] < 0.005


def test_what_shears_or_rubs_as_it_stretches_is_not_told():
    rough = solved(BALL | {"friction": 0.3}, 1e-4, axial_stiffness=1e3)
    sheared = solved(BALL, 1e-3, axial_stiffness=1e3, shear_stiffness=[1e3, 1e3])
    for found in (rough, sheared):
        assert found.contacts
        assert np.isnan(found.modes(2).frequencies).all()
