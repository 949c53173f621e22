# SPDX-License-Identifier: Apache-2.0
"""The judge of contacts: right on what is known, and not to be fooled."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from references import contact
from references.reference import Reference
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation
from scipy.special import ellipk
from zoo_make import ARM

from cable_ros import Equilibrium, Tracker, load_scene
from cable_ros.bench.cases import answered, case_scene, joint_values, judge, rods
from cable_ros.bench.contact_checks import (
    Surface,
    contact_fault,
    let_go,
    pull_fault,
    spread,
    surfaces,
    touches,
)
from cable_ros.bench.drawn import drawn_case
from cable_ros.bench.shooting import Touch
from cable_ros.bench.surfaces import curvature, derivatives, distance, gradient
from cable_ros.bench.verification import Rod, apart, refine, verify
from cable_ros.equilibrium import Contact
from cable_ros.scene import Kinematics
from cable_ros.scene.obstacles import Box, Capsule, Cylinder, Obstacle, Plane, Sphere

SPHERE = ARM.replace("space_arm.yaml", "space_arm_sphere.yaml")
TURN = np.array([0.1, -0.3, 0.2, 0.9]) / np.linalg.norm([0.1, -0.3, 0.2, 0.9])
SHAPES = {
    "sphere": Sphere(np.array([0.1, 0.0, 0.2]), 0.4),
    "plane": Plane(np.array([0.0, 0.1, 0.0]), np.array([0.6, 0.0, 0.8])),
    "capsule": Capsule(np.array([-0.3, 0.1, 0.0]), np.array([0.4, 0.2, 0.3]), 0.2),
    "cylinder": Cylinder(np.array([-0.3, 0.1, 0.0]), np.array([0.4, 0.2, 0.3]), 0.3),
    "box": Box(np.array([0.1, 0.0, 0.0]), np.array([0.5, 0.8, 0.3]), TURN),
}


@pytest.mark.parametrize("name", SHAPES)
def test_distance_is_that_to_the_nearest_place_of_the_surface(name: str) -> None:
    link = np.concatenate([[0.2, -0.1, 0.4], TURN])
    signed = distance(Obstacle(name, SHAPES[name]), link, 0.0)
    rng = np.random.default_rng(0)
    for point in rng.uniform(-1.5, 1.5, (40, 3)):
        d, normal = float(signed(point)), gradient(signed, point, 1e-7)
        # a distance grows by one along its gradient, and ends on the surface
        assert np.linalg.norm(normal) == pytest.approx(1.0, abs=1e-6)
        assert float(signed(point - d * normal)) == pytest.approx(0.0, abs=1e-6)
        # and nothing nearer is on the surface
        near = point + 0.99 * abs(d) * _directions(rng, 200)
        assert np.all(np.sign(signed(near)) == np.sign(d))


@pytest.mark.parametrize("name", SHAPES)
def test_exact_derivatives_are_those_of_the_distance(name: str) -> None:
    link = np.concatenate([[0.2, -0.1, 0.4], TURN])
    obstacle = Obstacle(name, SHAPES[name])
    signed, exact = distance(obstacle, link, 0.01), derivatives(obstacle, link, 0.01)
    assert exact is not None
    points = np.random.default_rng(0).uniform(-1.5, 1.5, (40, 3))
    normals, bends = exact(points)
    assert normals == pytest.approx(gradient(signed, points, 1e-5), abs=1e-8)
    assert bends == pytest.approx(curvature(signed, points, 1e-4), abs=1e-5)
    # a line without thickness is pushed in no direction of its own by a sharp edge
    assert (derivatives(obstacle, link, 0.0) is None) == (name in ("box", "cylinder"))


def test_the_cables_own_radius_counts_where_the_obstacle_says_so() -> None:
    link = np.array([0, 0, 0, 0, 0, 0, 1.0])
    ball = Obstacle("ball", SHAPES["sphere"])
    point = np.array([[2.0, 0.0, 0.0]])
    thin = distance(ball, link, 0.05)(point) - distance(ball, link, 0.0)(point)
    assert thin == pytest.approx(-0.05)
    ignored = distance(replace(ball, cable_radius_counts=False), link, 0.05)(point)
    assert ignored == pytest.approx(distance(ball, link, 0.0)(point))


def pressed_arch(phase: float = 1.3) -> tuple[Reference, np.ndarray, np.ndarray]:
    """Closed form of an arch that touches a plane at its middle, with its shape: one half, mirrored."""
    reference = contact.pressed_at_a_point(0.4, phase * float(ellipk(0.16)))
    fx, fy = Rotation.from_quat(reference.start[3:]).apply(reference.start_wrench[:3])[:2]
    state = [*reference.start[:2], 0.0, reference.start_wrench[4], fx, fy]
    s = np.linspace(0.0, 0.5, 101)
    half = solve_ivp(contact._rates, (0, 0.5), state, "DOP853", s, args=(0.0,), rtol=1e-12, atol=1e-13).y
    x = np.concatenate([half[0], -half[0, -2::-1]])
    y = np.concatenate([half[1], half[1, -2::-1]])
    angle = np.concatenate([half[2], -half[2, -2::-1]])
    frames = [Rotation.from_euler("z", a) * Rotation.from_quat(reference.start[3:]) for a in angle]
    return reference, np.column_stack([x, y, 0 * x]), np.array([frame.as_quat() for frame in frames])


def flat(r: np.ndarray, normal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Gradients and Hessians, at points (k, 3), of the distance from a plane."""
    return np.broadcast_to(normal, r.shape), np.zeros((len(r), 3, 3))


def plane_below(reference: Reference) -> list[Touch]:
    """The touch with the plane y = 0 in the middle, its force not known."""
    height = reference.start[1] / reference.length

    def surface(r: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return r[:, 1] + height, *flat(r, np.array([0.0, 1.0, 0.0]))

    return [Touch(0.5, surface, 0.8 * reference.facts["contact_force_y"], np.zeros(3))]


def test_the_force_of_a_closed_form_is_found() -> None:
    reference, points, orientations = pressed_arch()
    rod = Rod(1.0, reference.stiffness, reference.weight, reference.start, reference.end)
    claim = points, orientations, reference.start_wrench, reference.end_wrench
    found = refine(rod, *claim, plane_below(reference))
    assert found.converged
    # integration and closed form agree to about 1e-10
    assert found.wrench_error < 1e-8
    assert found.normal_forces == pytest.approx([reference.facts["contact_force_y"]], rel=1e-8)
    wrong = refine(rod, *claim[:3], 1.01 * reference.end_wrench, plane_below(reference))
    assert wrong.wrench_error == pytest.approx(0.01, rel=1e-3)


def test_a_surface_that_would_have_to_pull_is_told() -> None:
    reference, points, orientations = pressed_arch(1.05)
    rod = Rod(1.0, reference.stiffness, reference.weight, reference.start, reference.end)
    (touch,) = plane_below(reference)

    def below(r: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        # the free arch does not reach down there
        gap, normal, bend = touch.surface(r)
        return gap + 0.008, normal, bend

    down = [replace(touch, surface=below)]
    found = refine(rod, points, orientations, reference.start_wrench, reference.end_wrench, down)
    assert found.converged
    fault = pull_fault(rod, found, down)
    assert fault is not None
    assert "pull" in fault
    # let go, it comes off, and is another one
    claim: Any = SimpleNamespace(
        points=points,
        orientations=orientations,
        start_wrench=found.start_wrench,
        end_wrench=found.end_wrench,
        stability_margin=1.0,
    )
    freed = let_go(rod, {"plane": Surface(lambda r: below(r)[0], 0.0)}, claim, found, down)
    assert freed is not None
    assert freed.wrench_error > 1e-2


def test_only_points_on_one_surface_cannot_be_told_apart() -> None:
    reference, points, orientations = pressed_arch()
    rod = Rod(1.0, reference.stiffness, reference.weight, reference.start, reference.end)
    (middle,) = plane_below(reference)

    def beside(r: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return r[:, 2], *flat(r, np.array([0.0, 0.0, 1.0]))

    same = [middle, replace(middle, place=0.503, force=0.0)]
    assert [touch.holds for touch in apart(same)] == [True, False]
    two = [middle, replace(middle, place=0.503, force=1.0, surface=beside, slides=False)]
    assert [touch.holds for touch in apart(two)] == [True, True]
    found = refine(rod, points, orientations, reference.start_wrench, reference.end_wrench, apart(two))
    assert found.converged
    # the arch is plane: what keeps it there needs no force, whatever was told
    assert found.normal_forces == pytest.approx([reference.facts["contact_force_y"], 0.0], abs=1e-6)


@pytest.mark.parametrize("missing", [None, 0, 3])
def test_pressure_stays_between_the_ends_of_its_stretch(missing: int | None) -> None:
    nodes, weights = np.polynomial.legendre.leggauss(4)
    low, high, force = 0.3, 0.4, 2.0
    samples = [
        (low + (high - low) * 0.5 * (1.0 + x), (high - low) * 0.5 * w, force * 0.5 * w)
        for i, (x, w) in enumerate(zip(nodes, weights, strict=True))
        if i != missing
    ]
    up = np.array([0.0, 0.0, 1.0])
    told = [
        Contact("table", s, np.zeros(3), up, f * up, length, False)
        for s, length, f in [(low, 0.0, 5.0), *samples, (high, 0.0, 5.0)]
    ]
    places, forces = np.array(spread(told, 2e-3)).T
    assert np.all((places > low) & (places < high))
    assert np.diff(places).max() < 2e-3 + 1e-12
    assert forces.sum() == pytest.approx(sum(f for _, _, f in samples))
    # the pressure is uniform where it presses, and missing beside one end or nowhere
    covered = sum(length for _, length, _ in samples)
    middle = high - 0.5 * covered if missing == 0 else low + 0.5 * covered
    assert places @ forces / forces.sum() == pytest.approx(middle, abs=1e-9)


def test_a_coarse_mesh_keeps_its_pressure_beside_a_fine_one() -> None:
    nodes, weights = np.polynomial.legendre.leggauss(4)
    up = np.array([0.0, 0.0, 1.0])

    def told(low: float, high: float, forces: list[float]) -> list[Contact]:
        places = low + (high - low) * 0.5 * (1.0 + nodes)
        lengths = (high - low) * 0.5 * weights
        return [
            Contact("table", s, np.zeros(3), up, f * up, length, False)
            for s, f, length in zip(places, forces, lengths, strict=True)
        ]

    end = 0.3
    coarse = told(0.0, end, [*(2.0 * end * 0.5 * weights)])
    for fine in (told(end, 0.301, [0.5, 0.0, 0.2, 0.1]), told(end, 0.301, [0.5, 0.0, 0.2, 0.1])[2:]):
        places, forces = np.array(spread([*coarse, *fine], 2e-3)).T
        mine = places < end
        assert forces[mine] == pytest.approx(2.0 * end / mine.sum(), rel=1e-9)
        assert forces[~mine].sum() == pytest.approx(sum(float(c.force[2]) for c in fine))


HARD = {
    "a curved patch without friction": (158, 272, "drum", 0),
    "a fine mesh beside the clamp": (158, 329, "edge", 4),
    "taut, at 3700 EI / L^2": (126, 32, None, 18),
    "a patch about to part": (158, 461, "wall", 4),
    "a loop at rest on an edge": (110, 22, None, 12),
    "pressure that steepens towards the clamp": (164, 1497, None, 10),
    "a heavy cable lifted off a rough table": (164, 1330, None, 17),
    "all but free to slide with its friction given": (162, 127, None, 6),
}


def hard(name: str) -> tuple[Rod, dict[str, Surface], Callable[..., Equilibrium]]:
    """A rod, its obstacles, and the tracker's answer for another linear density, relative."""
    seed, index, kind, pose = HARD[name]
    case = drawn_case(seed, index, 1e-4, kind)
    scene, joints = case_scene(case), case.path[pose]
    (cable,) = scene.cables
    kinematics = Kinematics(scene)
    rod = rods(scene, kinematics, joints)[cable.name]
    met = surfaces(scene, kinematics, joint_values(kinematics, joints), cable.radius)

    def answer(density: float = 1.0) -> Equilibrium:
        """Of the cable with another linear density."""
        assert not isinstance(case.scene, str)
        (told,) = case.scene["cables"]
        other = {**told, "linear_density": density * told["linear_density"]}
        tracker = Tracker(
            case_scene(replace(case, scene={**case.scene, "cables": [other]})), polyline_points=401
        )
        answers = [answered(tracker, there)[0][cable.name] for there in case.path[: pose + 1]]
        return answers[-1]

    return rod, met, answer


@pytest.mark.parametrize("name", HARD)
def test_hard_answers_are_verified_and_wrong_ones_beside_them_are_not(name: str) -> None:
    rod, met, answer = hard(name)
    claim = answer()
    assert judge(rod, claim, 1e-4, met)[1] is None
    wrong = replace(claim, end_wrench=claim.end_wrench * (1.0 + 2e-4))
    assert "end wrench off" in (judge(rod, wrong, 1e-4, met)[1] or "")
    wrong = replace(claim, start_wrench=claim.start_wrench * (1.0 + 2e-3))
    assert "start wrench off" in (judge(rod, wrong, 1e-4, met)[1] or "")
    fewer = tuple(contact for contact in claim.contacts if contact.length > 0.0)
    wrong = replace(claim, _touching=lambda: SimpleNamespace(contacts=lambda: fewer))
    assert judge(rod, wrong, 1e-4, met)[1] is not None
    assert judge(rod, answer(1.1), 1e-4, met)[1] is not None


def test_points_held_in_place_need_the_friction_that_is_told() -> None:
    rod, met, answer = hard("all but free to slide with its friction given")
    claim = answer()
    assert verify(rod, claim, touches(rod, met, claim)).wrench_error > 5e-4
    less = [replace(one, force=one.force - 1e-3 * one.friction) for one in claim.contacts]
    aside = [replace(one, position=one.position + [0.0, 1e-4 * rod.length, 0.0]) for one in claim.contacts]
    for contacts in (less, aside):
        wrong = replace(claim, _touching=partial(SimpleNamespace, contacts=partial(tuple, contacts)))
        assert "end wrench off" in (judge(rod, wrong, 1e-4, met)[1] or "")


@pytest.mark.parametrize("off", [1e-3, -1e-4])
def test_where_a_cable_lifts_off_is_found_whatever_was_told(off: float) -> None:
    """A rod over a bar, manufactured: told to lift off at a place beside, the judge finds the same wrench."""
    reference, centre = contact.draped().reference, contact.cylinder_centre(0.15, 1.4)
    ends = [*centre, -1.0], [*centre, 1.0]
    mapping = {
        "gravity": [0.0, -9.81, 0.0],
        "cables": [{
            "name": "cable",
            "length": 1.0,
            "stiffness": reference.stiffness.tolist(),
            "linear_density": 20.0 / 9.81,
            "start": {"position": reference.start[:3].tolist(), "orientation": reference.start[3:].tolist()},
            "end": {"position": reference.end[:3].tolist(), "orientation": reference.end[3:].tolist()},
        }],
        "obstacles": [{"name": "bar", "capsule": {"start": ends[0], "end": ends[1], "radius": 0.15}}],
    }  # fmt: skip
    scene = load_scene(mapping)
    claim = Tracker(scene, tolerance=1e-6, polyline_points=401).solve({})["cable"]
    rod = Rod(1.0, reference.stiffness, reference.weight, reference.start, reference.end)
    told = touches(rod, surfaces(scene, Kinematics(scene), np.zeros(0), 0.0), claim)
    first = min(touch.place for touch in told)
    assert first == pytest.approx(reference.facts["touchdown_start"], abs=1e-5)
    beside = [replace(touch, place=first + off) if touch.place == first else touch for touch in told]
    found = verify(rod, claim, beside)
    assert found.converged
    error = np.linalg.norm(found.end_wrench - reference.end_wrench) / np.linalg.norm(reference.end_wrench)
    assert error < 2e-5  # of the forces that stand for the pressure


@pytest.fixture(scope="module")
def on_the_ball() -> tuple[Rod, dict[str, Surface], Equilibrium]:
    scene = load_scene(SPHERE)
    tracker = Tracker(scene, polyline_points=401)
    for angle in (0.0, 0.5, 1.0):
        (found,) = tracker.solve({"orientation": angle}).values()
    kinematics = Kinematics(scene)
    q = np.array([1.0])
    (cable,) = scene.cables
    poses = kinematics.poses(q)[0]
    rod = Rod(cable.length, cable.stiffness, scene.gravity * cable.linear_density, poses[0], poses[1])
    return rod, surfaces(scene, kinematics, q, cable.radius), found


def test_the_trackers_contact_is_verified(on_the_ball: tuple[Rod, dict[str, Surface], Equilibrium]) -> None:
    rod, met, claim = on_the_ball
    assert claim.contacts
    assert contact_fault(rod, met, claim) is None
    found = verify(rod, claim, touches(rod, met, claim))
    assert found.converged
    assert found.wrench_error < 1e-4
    assert found.normal_forces == pytest.approx([c.normal_force for c in claim.contacts], rel=1e-3)
    # without the touch the rod falls through: another equilibrium, with another wrench
    free = verify(rod, claim)
    assert not free.converged or free.wrench_error > 1e-2


def test_false_contacts_are_found(on_the_ball: tuple[Rod, dict[str, Surface], Equilibrium]) -> None:
    rod, met, claim = on_the_ball
    (one,) = claim.contacts

    def told(**changes: np.ndarray) -> str:
        other = replace(claim)
        vars(other)["contacts"] = (replace(one, **changes),)
        return contact_fault(rod, met, other) or ""

    assert "pulls" in told(force=-one.force)
    assert "cone" in told(force=one.force + 0.5 * one.friction)
    assert "off the surface" in told(position=one.position + 1e-5 * rod.length * one.normal)
    assert "normal" in told(normal=np.array([0.0, 0.0, 1.0]), force=np.zeros(3))
    assert "not finite" in told(force=np.full(3, np.nan))
    centre = one.position - 0.045 * one.normal
    inward = claim.points + 1e-3 * (centre - claim.points)
    assert "inside" in (contact_fault(rod, met, replace(claim, points=inward)) or "")


def _directions(rng: np.random.Generator, count: int) -> np.ndarray:
    v = rng.normal(size=(count, 3))
    return v / np.linalg.norm(v, axis=1, keepdims=True)
