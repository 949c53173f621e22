# SPDX-License-Identifier: Apache-2.0
"""What a cable stands: extremes against closed forms, whatever holds it, and what a scene's limits tell."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from nodal_scenes import pressed
from references.rods import STILL
from scipy.spatial.transform import Rotation
from test_lying import CASES, RADIUS, tracker

from cable_ros import Equilibrium, Tracker, load_scene
from cable_ros.batch import solve_many
from cable_ros.branch import handover
from cable_ros.branch.extremes import Obstacles, extremes
from cable_ros.contact.distance import WIDTH
from cable_ros.contact.friction_kernels import FRICTIONLESS
from cable_ros.limits import BEYOND, NEAR, OK, QUANTITIES, Extreme
from cable_ros.rod.units import Units
from cable_ros.scene import SceneError
from cable_ros.scene.cable_limits import CableLimits
from cable_ros.share import share_file

UPRIGHT = [0, 0, 0, 1]
TIP = [0, 0, 0]
ALL = {"bend_radius": 0.04, "tension": 20.0, "torsion": 6.0, "clearance": 0.01}
BAR = {"stiffness": [1.0, 1.0, 0.7], "linear_density": 0.0}


def solved(end, gravity=TIP, tolerance=1e-6, obstacles=(), **fields) -> Equilibrium:
    """A cable of 1 m from the origin along Z with all limits."""
    start = {"position": TIP, "orientation": UPRIGHT}
    cable = {"name": "cable", "length": 1.0, "start": start, "end": end, "limits": ALL, **BAR, **fields}
    scene: dict[str, object] = {"gravity": gravity, "cables": [cable]}
    scene |= {"obstacles": list(obstacles)} if obstacles else {}
    (found,) = Tracker(load_scene(scene), tolerance).arrive({}).values()
    assert found.status.trusted, found.message
    return found


def arc(angle: float, twist: float = 0.0) -> dict[str, object]:
    """The end clamp of an arc of 1 m in the XZ plane; also turned about the tangent."""
    radius = 1.0 / angle
    place = [radius * (1 - math.cos(angle)), 0.0, radius * math.sin(angle)]
    return {"position": place, "rpy": [0.0, angle, 0.0]}


@pytest.mark.parametrize("tolerance", [1e-4, 1e-6, 1e-8])
def test_an_arc_has_the_bend_radius_of_its_circle(tolerance):
    found = solved(arc(1.5), tolerance=tolerance, total_twist=0.0)
    radius, tension, torsion, clearance = found.extremes
    # Relative to the tolerance of the wrench, whose moment bends it; the estimate is one of the end only.
    assert radius.value == pytest.approx(1.0 / 1.5, rel=tolerance)
    assert abs(tension.value) < tolerance * 1.5
    assert torsion.value < tolerance * 1.5
    assert clearance.value == math.inf
    assert math.isnan(clearance.arc_length)


def test_an_arc_that_is_its_natural_shape_is_bent_without_a_moment():
    found = solved(arc(1.5), natural_strain=[0.0, 1.5, 0.0], total_twist=0.0)
    assert found.extremes[0].value == pytest.approx(1.0 / 1.5, rel=1e-6)
    assert np.abs(found.end_wrench).max() < 1e-5


@pytest.mark.parametrize("turns", [-0.4, 0.3])
def test_a_straight_cable_that_is_twisted(turns):
    """Its twist is the end's turn over the unstretched length, its tension EA e, whichever way it turns."""
    twist = 2.0 * math.pi * turns
    end = {"position": [0, 0, 1.002], "rpy": [0, 0, twist]}
    found = solved(end, axial_stiffness=1e3, total_twist=twist)
    radius, tension, torsion, _ = found.extremes
    assert torsion.value == pytest.approx(abs(twist), rel=1e-6)
    assert tension.value == pytest.approx(2.0, rel=1e-6)
    assert radius.value > 1e4
    natural = solved(end, axial_stiffness=1e3, total_twist=twist, natural_strain=[0, 0, twist])
    assert natural.extremes[2].value < 1e-6


def test_a_hanging_cable_is_pulled_most_where_it_hangs():
    """A straight one that stretches: T(s) = EA e + w (L / 2 - s), upwards from its lower end at the start."""
    weight, strain, stiffness = 4.0 * 9.81, 0.01, 1e4
    found = solved(
        {"position": [0, 0, 1.0 + strain], "orientation": UPRIGHT}, [0, 0, -9.81],
        linear_density=4.0, axial_stiffness=stiffness,
    )  # fmt: skip
    tension = found.extremes[1]
    assert tension.value == pytest.approx(stiffness * strain + 0.5 * weight, rel=1e-6)
    assert tension.arc_length == pytest.approx(1.0, abs=1e-3)
    np.testing.assert_allclose(tension.position, [0, 0, 1.0 + strain], atol=1e-3)


def test_a_swag_s_first_integral():
    """T + 1/2 M.kappa + w z is constant along a uniform cable, so the tension has a bound by both ends'.

    Here the cable sags between level clamps: the largest tension is at a clamp, as the wrench there has it.
    """
    found = solved(
        {"position": [0.7, 0, 0], "rpy": [0, math.pi, 0]}, [0, 0, 9.81], linear_density=5.0, total_twist=0.0
    )
    tension = found.extremes[1]
    at_start, at_end = found.start_wrench[2], -found.end_wrench[2]
    assert tension.value >= max(at_start, at_end) - 1e-9
    assert np.interp(tension.arc_length, np.linspace(0, 1, 101), found.points[:, 2]) <= 0.7


BALL = {"name": "ball", "sphere": {"center": [-0.5, 0.3, 0.5], "radius": 0.2}}


@pytest.mark.parametrize("radius", [None, 0.03])
def test_a_ball_beside_an_arc(radius):
    """The distance of a point from a circle is that from its plane and, within it, from the rim."""
    fields = {} if radius is None else {"outer_diameter": 2.0 * radius}
    found = solved(arc(1.5), obstacles=[BALL], tolerance=1e-8, total_twist=0.0, **fields)
    clearance = found.extremes[3]
    centre, rim = np.array([1.0 / 1.5, 0.0]), 1.0 / 1.5
    inside = np.array([-0.5, 0.5]) - centre
    distance = math.hypot(np.linalg.norm(inside) - rim, 0.3)
    assert clearance.value == pytest.approx(distance - 0.2 - (radius or 0.0), rel=1e-7)
    # The nearest point lies towards the ball's centre.
    angle = math.atan2(inside[1], -inside[0])
    assert clearance.arc_length == pytest.approx(rim * angle, abs=1e-4)
    assert clearance.obstacle == "ball"
    assert np.linalg.norm(clearance.position - [-0.5, 0.3, 0.5]) == pytest.approx(distance, rel=1e-6)


def test_what_is_not_in_the_equations_is_told_as_well():
    """A cable whose effects leave contact out goes through the ball: its clearance is negative."""
    middle = [(1.0 - math.cos(0.75)) / 1.5, 0.0, math.sin(0.75) / 1.5]
    ball = {"name": "ball", "sphere": {"center": middle, "radius": 0.2}}
    cable = {"name": "cable", "length": 1.0, "start": {"position": TIP, "orientation": UPRIGHT},
             "end": arc(1.5), "limits": ALL, "total_twist": 0.0, **BAR}  # fmt: skip
    scene = {"gravity": TIP, "cables": [cable], "obstacles": [ball], "effects": []}
    (found,) = Tracker(load_scene(scene), 1e-6).arrive({}).values()
    clearance = found.extremes[3]
    assert clearance.value == pytest.approx(-0.2, rel=1e-5)
    assert clearance.level == BEYOND


def test_where_it_touches_the_clearance_is_nothing():
    tracker = Tracker(limited(share_file("config", "space_arm_sphere.yaml")))
    found = tracker.arrive({"orientation": math.radians(60)})["camera_cable"]
    assert found.contacts
    # A contact is held to far less than 1e-6 of the length of 0.38 m.
    assert abs(found.extremes[3].value) < 1e-7
    assert found.extremes[3].level == BEYOND


@pytest.mark.parametrize("tolerance", [1e-2, 1e-4, 1e-6])
def test_on_a_drum_it_is_bent_as_the_drum_is(tolerance):
    """Rod over a drum of 0.15 m, whose radius is that of the centreline there: no span is bent more."""
    steps, _ = tracker(CASES["draped"], tolerance)
    (tracked,) = steps._tracked_cables
    nothing = Obstacles(np.zeros((0, WIDTH)), np.zeros((0, 7)), ())
    radius, *_ = extremes(tracked.rod, tracked.q, tracked._F, STILL, tracked._units, CableLimits(), nothing)()
    # Of the moment the parts of the pressure leave 1e-4; exact ones would leave the wrench's tolerance.
    assert radius.value == pytest.approx(RADIUS, rel=2e-4)


@pytest.mark.parametrize("shape", ["sphere", "plane", "box"])
def test_on_a_grid_of_contacts_they_converge_to_those_of_exact_contact(shape):
    differences = []
    for cells in (64, 128):
        rod = pressed(shape, cells=cells)
        exact = handover.exact(rod, 1e-6, FRICTIONLESS)
        assert exact is not None
        found, expected = (
            np.array([one.value for one in extremes(
                of, q, F, STILL, Units(1.0, 1.0), CableLimits(), Obstacles(of.obstacles, STILL[None], ["it"])
            )()[:3]])
            for of, q, F in ((rod, rod.shape, rod.end_force), (exact.rod, exact.q, exact.F))
        )  # fmt: skip
        differences.append(np.abs(found / expected - 1.0))
    assert differences[0].max() < 5e-3
    # Along a patch exact contact itself has pressure at points only, some 5e-5.
    assert differences[1].max() < 0.6 * differences[0].max() + 5e-5


def test_the_tension_jumps_where_something_rubs():
    """Both sides of the contact count; the wrenches tell the tension at the clamps."""
    tracker = Tracker(limited(share_file("config", "space_arm_sphere.yaml")), 1e-6)
    for degrees in (40, 50, 60):
        found = tracker.arrive({"orientation": math.radians(degrees)})["camera_cable"]
    (contact, *_) = found.contacts
    assert np.linalg.norm(contact.friction) > 0.0
    tension = found.extremes[1].value
    assert tension >= max(found.start_wrench[2], -found.end_wrench[2]) - 1e-9
    assert tension <= np.linalg.norm(found.end_wrench[:3]) + np.linalg.norm(contact.force) + 0.4


def limited(path, **limits):
    """The scene of a file, its first cable with these limits."""
    scene = load_scene(path)
    text = scene.text.replace("    total_twist:", f"    limits: {limits or ALL}\n    total_twist:")
    folder = path.parent
    text = text.replace("urdf: space_arm.urdf", f"urdf: {folder / 'space_arm.urdf'}")
    import yaml

    return load_scene(_numbers(yaml.safe_load(text)))


def _numbers(values):
    """YAML 1.1 takes 6.70e6 for a text."""
    if isinstance(values, dict):
        return {key: _numbers(value) for key, value in values.items()}
    if isinstance(values, list):
        return [_numbers(value) for value in values]
    try:
        return float(values) if isinstance(values, str) else values
    except ValueError:
        return values


def test_limits_change_no_bit_of_the_rest():
    plain, watched = (
        Tracker(scene)
        for scene in (
            load_scene(share_file("config", "space_arm.yaml")),
            limited(share_file("config", "space_arm.yaml")),
        )
    )
    for degrees in (-90, -89, 0, 45):
        one, other = (
            t.arrive({"orientation": math.radians(degrees)})["camera_cable"] for t in (plain, watched)
        )
        assert one.end_wrench.tobytes() == other.end_wrench.tobytes()
        assert one.points.tobytes() == other.points.tobytes()
        assert one.extremes == ()
        assert [extreme.quantity for extreme in other.extremes] == list(QUANTITIES)
        assert other.as_dict()["extremes"][0]["quantity"] == "bend_radius"


def test_levels_and_sentences():
    radius, tension, _, clearance = QUANTITIES

    def one(quantity, value, limit, obstacle=""):
        return Extreme(quantity, value, 0.21, np.zeros(3), limit, obstacle)

    uses = [
        (radius, 0.06, 0.04, OK), (radius, 0.049, 0.04, NEAR), (radius, 0.039, 0.04, BEYOND),
        (radius, math.inf, 0.04, OK), (tension, 15.9, 20, OK), (tension, 16.1, 20, NEAR),
        (tension, 20.0, 20, NEAR), (tension, 20.1, 20, BEYOND), (tension, -5.0, 20, OK),
        (tension, 1e9, None, OK), (clearance, -1e-9, 0.01, BEYOND), (clearance, 0.011, 0.01, NEAR),
    ]  # fmt: skip
    for quantity, value, limit, level in uses:
        assert one(quantity, value, limit).level == level
    for before, after in pairwise([0.08, 0.05, 0.03, 0.0]):
        assert one(clearance, before, 0.04).use < one(clearance, after, 0.04).use
    assert one(radius, 0.036, 0.04).sentence == "Bend radius 0.036 m at 0.21 m, 111 % of its limit of 0.04 m."
    assert one(tension, 3.0, None).sentence == "Tension 3 N at 0.21 m."
    shown = one(clearance, -0.002, 0.01, "ball").sentence
    assert shown == "Clearance -0.002 m at 0.21 m to 'ball', beyond its limit of 0.01 m."


def test_a_batch_has_them_as_arrays():
    scene = limited(share_file("config", "space_arm.yaml"))
    angles = np.radians([0.0, 1.0, 2.0])
    batch = solve_many(scene, angles)
    assert batch.extremes is not None
    assert batch.extremes.shape == (3, 1, 4, 2)
    tracker = Tracker(scene, polyline_points=2)
    for row, angle in zip(batch.extremes[:, 0], angles, strict=True):
        found = tracker.solve({"orientation": float(angle)})["camera_cable"].extremes
        # Solves that start elsewhere differ by some of the tolerance of 1e-4; a flat maximum is anywhere.
        np.testing.assert_allclose(row[:, 0], [one.value for one in found], rtol=1e-5)
        np.testing.assert_allclose(row[:2, 1], [one.arc_length for one in found[:2]], atol=1e-5)
    assert solve_many(load_scene(share_file("config", "space_arm.yaml")), angles).extremes is None


@pytest.mark.parametrize(
    ("limits", "sentence"),
    [
        ({}, "no limit is given"),
        ({"bend_radius": 40}, ""),
        ({"bend_radius": -1}, "must not be negative"),
        ({"bend_radius": 0.001}, "less than the cable's own radius of 0.00377 m"),
        ({"tension": 0.0}, "0 N is outside"),
        ({"torsion": "much"}, "must be a number"),
        ({"torsion": 36000.0}, "it looks like degrees per metre"),
        ({"clearance": 5000}, "it looks like millimetres"),
        ({"bent_radius": 0.04}, "did you mean 'bend_radius'"),
        (0.04, "must be a mapping"),
    ],
)
def test_bad_values_are_told_in_a_sentence(limits, sentence):
    if not sentence:
        assert limited(share_file("config", "space_arm.yaml"), **limits).cables[0].limits.bend_radius == 40
        return
    scene = limited(share_file("config", "space_arm.yaml"))
    import yaml

    values = yaml.safe_load(scene.text)
    values["cables"][0]["limits"] = limits
    with pytest.raises(SceneError, match="limits") as caught:
        load_scene(values)
    assert sentence in caught.value.message
    assert "\n" not in str(caught.value)


def test_a_soft_cable_is_bent_and_placed_as_its_frames_say():
    """One that bends, stretches and shears: curvature of its frames, places of its polyline."""
    end = {"position": [0.5, 0.1, 0.4], "rpy": [0.3, 1.0, 0.0]}
    start = {"position": TIP, "orientation": UPRIGHT}
    cable = {"name": "cable", "length": 1.0, "start": start, "end": end, "limits": ALL, "total_twist": 0.5,
             "stiffness": [1.0, 1.6, 0.7], "linear_density": 2.0, "axial_stiffness": 60.0,
             "shear_stiffness": [40.0, 50.0], "natural_strain": [0.3, -0.5, 0.2]}  # fmt: skip
    count = 4001
    tracker = Tracker(load_scene({"gravity": [3.0, 0, -9.0], "cables": [cable]}), 1e-7, count)
    (found,) = tracker.arrive({}).values()
    assert found.status.trusted, found.message
    radius, tension, torsion, _ = found.extremes
    for one in found.extremes[:3]:
        places = np.linspace(0.0, 1.0, count)
        on_it = [np.interp(one.arc_length, places, found.points[:, axis]) for axis in range(3)]
        np.testing.assert_allclose(one.position, on_it, atol=1e-7)  # chords of 0.25 mm
    turns = Rotation.from_quat(found.orientations)
    strain = (turns[:-1].inv() * turns[1:]).as_rotvec() * (count - 1)
    # Mean strains between points 1 / 4000 apart; the frames' derivative is an order worse than 1e-7.
    assert 1.0 / radius.value == pytest.approx(np.hypot(strain[:, 0], strain[:, 1]).max(), rel=1e-4)
    assert torsion.value == pytest.approx(np.abs(strain[:, 2] - 0.2).max(), rel=1e-4)
    # The wrenches have the force along the tangents of both clamps.
    assert tension.value >= max(found.start_wrench[2], -found.end_wrench[2]) - 1e-9


@pytest.mark.parametrize("aside", [-0.1, 0.12])
def test_of_pieces_between_clips_the_worst_is_that_of_one_alone(aside):
    """A piece is looked at closely only where it may be the worst: none is left out that is."""
    clips = [
        {"name": f"clip_{k}", "clip": {"arc_length": s, "position": [x, 0.0, z], "rpy": [0.0, turn, 0.0]}}
        for k, (s, x, z, turn) in enumerate([(0.3, 0.06, 0.28, 0.3), (0.6, aside, 0.5, -0.4)])
    ]
    ball = {"name": "ball", "sphere": {"center": [0.2, 0.1, 0.4], "radius": 0.03}}
    found = solved({"position": [0.1, 0.1, 0.8], "rpy": [0.2, 0.5, 0.4]}, obstacles=[ball], supports=clips,
                   gravity=[0.0, 0.0, -9.81], linear_density=0.3)  # fmt: skip
    pieces = [piece.extremes for piece in found.pieces]
    for k, one in enumerate(found.extremes):
        values = [own[k].value for own in pieces]
        i = values.index(min(values) if one.quantity.least else max(values))
        assert one.value == values[i]
        np.testing.assert_array_equal(one.position, pieces[i][k].position)
        assert one.arc_length == pieces[i][k].arc_length + (0.0, 0.3, 0.6)[i]
        assert one.obstacle == pieces[i][k].obstacle
