# SPDX-License-Identifier: Apache-2.0
"""Cables that lie along an obstacle, against boundary values: the accuracy asked for, and its order."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pytest
from references import contact
from references.free_boundary import GROUND, Lying, clamp, walk
from references.planar import elastica
from references.reference import Reference
from scipy.spatial.transform import Rotation

from cable_ros import Equilibrium, Status, Tracker, load_scene
from cable_ros.bench.carriage import on_carriage
from cable_ros.bench.drawn import drawn_case
from cable_ros.bench.metamorphic import nudged
from cable_ros.contact.points import ARC_LENGTH, KIND, SAMPLE
from cable_ros.contact.touching_rod import TouchingRod
from cable_ros.rod.elements import Mesh, reference_element
from cable_ros.rod.units import Units
from cable_ros.rod.warm_step import ADVANCED

RADIUS, WRAP = 0.15, 1.4
X, Y = contact.cylinder_centre(RADIUS, WRAP)
DRUM = {"name": "drum", "cylinder": {"start": [X, Y, -1.0], "end": [X, Y, 1.0], "radius": RADIUS}}


@dataclass(frozen=True)
class Lies:
    """A reference, and from where its end clamp comes to lie as it says: (x, y, yaw) beside home."""

    reference: Reference
    moves: tuple[tuple[float, float, float], ...] = ((0.0, 0.0, 0.0),)


CASES = {
    "lifted": Lies(contact.with_obstacle(contact.lifted(), contact.GROUND)),
    "sagging": Lies(contact.with_obstacle(contact.sagging(), contact.GROUND)),
    "draped": Lies(
        contact.with_obstacle(contact.draped(radius=RADIUS, wrap=WRAP), DRUM),
        tuple((0.2 * a, 0.3 * a, a) for a in np.linspace(1.0, 0.0, 25)),
    ),
}


def tracker(case: Lies, tolerance: float) -> tuple[Tracker, Equilibrium]:
    scene, urdf, home = on_carriage(case.reference.scene())
    steps = Tracker(load_scene(scene, urdf=urdf), tolerance=tolerance)
    for x, y, yaw in case.moves:
        joints = {**home, "x": home["x"] + x, "y": home["y"] + y, "yaw": home["yaw"] + yaw}
        found = steps.solve(joints)["cable"]
    assert found.status is Status.CONVERGED, found.message
    return steps, found


def error(found: np.ndarray, exact: np.ndarray) -> float:
    return float(np.linalg.norm(found - exact) / np.linalg.norm(exact))


@pytest.mark.parametrize("tolerance", [1e-2, 1e-4, 1e-6, 1e-8])
@pytest.mark.parametrize("name", CASES)
def test_within_the_asked_tolerance(name: str, tolerance: float) -> None:
    reference = CASES[name].reference
    _, found = tracker(CASES[name], tolerance)
    facts = reference.facts
    for wrench, exact in (
        (found.end_wrench, reference.end_wrench),
        (found.start_wrench, reference.start_wrench),
    ):
        assert error(wrench, exact) < tolerance
    # the estimate is that of the end wrench; 1e-8 is left by equations solved to a hundredth of the tolerance
    assert error(found.end_wrench, reference.end_wrench) < 3 * found.error_estimate + 1e-8
    total = np.sum([touch.force for touch in found.contacts], axis=0)
    borne = np.array([facts["contact_force_x"], facts["contact_force_y"], 0.0])
    # the difference of both ends' forces, which are as large
    assert np.linalg.norm(total - borne) < 3 * tolerance * np.linalg.norm(borne)
    assert all(touch.normal_force >= 0.0 for touch in found.contacts)


@pytest.mark.parametrize("tolerance", [1e-2, 1e-4, 1e-6])
@pytest.mark.parametrize("name", CASES)
def test_lifts_off_where_it_should_and_with_a_force(name: str, tolerance: float) -> None:
    facts = CASES[name].reference.facts
    _, found = tracker(CASES[name], tolerance)
    first, last = found.contacts[0], found.contacts[-1]
    # where the curvature does not jump: it is had less well than the wrench, by its slope
    near = max(tolerance, 1e-4)
    assert last.arc_length == pytest.approx(facts["touchdown_end"], abs=near)
    assert last.normal_force == pytest.approx(facts["point_force_end"], rel=50 * near)
    if facts["touchdown_start"] > 0.0:
        assert first.arc_length == pytest.approx(facts["touchdown_start"], abs=near)
        assert first.normal_force == pytest.approx(facts["point_force_start"], rel=50 * near)


@pytest.mark.parametrize("tolerance", [1e-4, 1e-6, 1e-8])
def test_stays_out_between_what_holds_it(tolerance: float) -> None:
    steps, _ = tracker(CASES["draped"], tolerance)
    steps.polyline_points = 2001
    home = on_carriage(CASES["draped"].reference.scene())[2]
    x, y, _ = steps.solve(home)["cable"].points.T
    # a millionth of the length, and no deeper than what the wrench may be off
    assert (np.hypot(x - X, y - Y) - RADIUS).min() > -min(1e-6, 0.2 * tolerance)


def test_lifted_step_by_step() -> None:
    reference = CASES["lifted"].reference
    scene, urdf, home = on_carriage(reference.scene())
    steps = Tracker(load_scene(scene, urdf=urdf))
    start, end = clamp(reference.start), clamp(reference.end)
    rises = np.linspace(0.0, 0.1, 11)
    stations = [(start, end + np.array([0.0, up, 0.0])) for up in rises]
    exact = walk(stations, Lying(0.0, 0.55, 0.0, 10.0, 0.0, 19.0), GROUND, 60.0)
    for up, (lying, true) in zip(rises, exact, strict=True):
        found = steps.solve({**home, "y": home["y"] + up})["cable"]
        assert found.status is Status.CONVERGED
        assert error(found.end_wrench, true.end_wrench) < 1e-4
        assert error(found.start_wrench, true.start_wrench) < 1e-4
        # the place where it leaves the ground moves along the cable, smoothly
        assert found.contacts[-1].arc_length == pytest.approx(1.0 - lying.after, abs=1e-4)


@pytest.mark.parametrize(
    ("name", "order", "counts"),
    [
        ("sagging", 5, (1, 2, 3)),
        ("sagging", 6, (1, 2, 3)),
        ("lifted", 6, (1, 2, 3)),
        ("draped", 6, (2, 3, 4)),
        ("draped", 5, (3, 4, 6)),
    ],
)
def test_the_wrench_has_twice_the_order_of_the_elements(
    name: str, order: int, counts: tuple[int, ...]
) -> None:
    """Equal elements in each span and on the stretch: the ends of a stretch cost no order."""
    case = CASES[name]
    steps, _ = tracker(case, 1e-8)
    (tracked,) = steps._tracked_cables
    rod, q, force = tracked.rod, tracked.q, tracked._F
    assert isinstance(rod, TouchingRod)
    rows = rod.points[: rod.count]
    bounds = np.array([0.0, *np.sort(rows[rows[:, KIND] != SAMPLE, ARC_LENGTH]), 1.0])
    unit = Units(1.0, float(np.sqrt(np.prod(case.reference.stiffness[:2])))).force
    exact = np.linalg.norm(case.reference.end_wrench[:3]) / unit
    errors = []
    for count in counts:
        edges = [np.linspace(a, b, count + 1)[1:] for a, b in pairwise(bounds)]
        mesh = Mesh(reference_element(order), np.diff([0.0, *np.concatenate(edges)]))
        coarse = rod.variant(mesh)
        shape = rod.mesh.interpolate(q, mesh.nodes)
        shape[0], shape[-1] = q[0], q[-1]
        code, _, _, found = coarse.correct(shape, force, 1e-9, remesh=False)
        assert code == ADVANCED
        errors.append(abs(np.linalg.norm(found) - exact) / exact)
    rates = np.log(np.divide(errors[:-1], errors[1:])) / np.log(np.divide(counts[1:], counts[:-1]))
    # from below: the coarsest meshes have one element on a span; beyond these rounding, 4e-11, shows
    assert 2 * order - 2 < rates[-1] < 2 * order + 1
    assert errors[-1] < 3e-8


@pytest.mark.parametrize("tolerance", [1e-4, 1e-6])
def test_a_twisted_cable_on_the_ground_lifts_its_clamps_as_it_must(tolerance: float) -> None:
    """Flat on the ground it is a planar elastica, whatever its twist; across the ground F n = G J tau kappa.

    That is M' + t x F = 0 at the clamps, whose share of the pressure no sample along the cable tells.
    """
    turn, torsion = 1.5, 0.75
    flat = elastica(1.0, 1.0, thrust=12.0, k=0.4, start_phase=0.3)
    end = Rotation.from_quat(flat.end[3:]) * Rotation.from_euler("z", turn)
    scene = {
        "gravity": [0.0, 0.0, -10.0],
        "obstacles": [{"name": "ground", "plane": {"point": [0, 0, 0], "normal": [0, 0, 1]}}],
        "cables": [
            {
                "name": "cable",
                "length": 1.0,
                "stiffness": [1.0, 1.0, torsion],
                "linear_density": 6.0,
                "total_twist": turn,
                "start": {"position": flat.start[:3].tolist(), "orientation": flat.start[3:].tolist()},
                "end": {"position": flat.end[:3].tolist(), "orientation": end.as_quat().tolist()},
            }
        ],
    }
    found = Tracker(load_scene(scene), tolerance=tolerance).solve({})["cable"]
    assert found.status is Status.CONVERGED
    assert found.points[:, 2] == pytest.approx(0.0, abs=1e-6)
    force, moment = end.apply(found.end_wrench[:3]), end.apply(found.end_wrench[3:])
    curvature = np.linalg.norm(flat.end_wrench[3:])
    size = np.linalg.norm(force)
    assert abs(abs(force[2]) - torsion * turn * curvature) < tolerance * size
    assert abs(force[2]) > 0.05 * size
    assert abs(abs(moment[2]) - curvature) < tolerance * np.linalg.norm(moment)


def test_pressures_that_have_not_settled_do_not_refine_the_mesh() -> None:
    # flat on smooth ground a step settles the shape to 1e-10 and its pressures to 1e-3 only
    case = nudged(drawn_case(5, 8, 1e-4), 5)
    steps = Tracker(load_scene(case.scene, urdf=case.urdf), tolerance=1e-4)
    found = [steps.arrive(dict(pose))["cable"] for pose in case.path]
    assert all(one.status is Status.CONVERGED for one in found)
    assert max(len(one.contacts) for one in found) <= 2 * len(found[0].contacts)
