# SPDX-License-Identifier: Apache-2.0
"""Distances to obstacles against sampled surfaces, their derivatives, and the curve between the nodes."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from cable_ros.contact import distance as kernels
from cable_ros.contact.distance import gaps, placed
from cable_ros.effects.contact import encode
from cable_ros.rod import centreline, quaternion
from cable_ros.rod.elements import Mesh, end_bubbles, lagrange, primitives, reference_element
from cable_ros.scene.obstacles import Box, Capsule, Cylinder, Obstacle, Plane, Sphere

TURN = Rotation.from_rotvec([0.4, -1.1, 0.7])
CENTER = np.array([0.3, -0.2, 0.5])
AXIS = TURN.apply([0.0, 0.0, 1.0])
SHAPES = {
    "sphere": Sphere(CENTER, 0.4),
    "plane": Plane(CENTER, AXIS),
    "capsule": Capsule(CENTER - 0.5 * AXIS, CENTER + 0.5 * AXIS, 0.25),
    "cylinder": Cylinder(CENTER - 0.35 * AXIS, CENTER + 0.35 * AXIS, 0.3),
    "box": Box(CENTER, np.array([0.5, 0.9, 0.7]), TURN.as_quat()),
}
RADIUS = 0.05
NOWHERE = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])


def encoded(name: str, counts: bool = True) -> np.ndarray:
    """The obstacle as the kernels take it, (1, WIDTH)."""
    return encode([Obstacle(name, SHAPES[name], cable_radius_counts=counts)], RADIUS)


def value(obstacle: np.ndarray, r: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """Gap, its gradient (3,) and Hessian (3, 3)."""
    n, directions, bends = np.empty(3), np.empty((2, 3)), np.empty(2)
    distance = kernels.gap(obstacle, r, n, directions, bends)
    return distance, n, sum(b * np.outer(d, d) for b, d in zip(bends, directions, strict=True))


def surface(name: str, count: int = 400_000) -> np.ndarray:
    """Points (n, 3) all over the surface of a shape, near its centre for the plane; world frame."""
    rng = np.random.default_rng(0)
    shape = SHAPES[name]
    if isinstance(shape, Sphere):
        v = rng.normal(size=(count, 3))
        return shape.center + shape.radius * v / np.linalg.norm(v, axis=1, keepdims=True)
    if isinstance(shape, Plane):
        flat = np.column_stack([rng.uniform(-2, 2, (count, 2)), np.zeros(count)])
        return shape.point + TURN.apply(flat)
    if isinstance(shape, Box):
        p = rng.uniform(-0.5, 0.5, (count, 3))
        face = rng.integers(0, 3, count)
        p[np.arange(count), face] = rng.choice([-0.5, 0.5], count)
        return shape.center + TURN.apply(p * shape.size)
    half = 0.5 * np.linalg.norm(shape.end - shape.start)
    angle, z = rng.uniform(0, 2 * np.pi, count), rng.uniform(-half, half, count)
    side = np.column_stack([shape.radius * np.cos(angle), shape.radius * np.sin(angle), z])
    if isinstance(shape, Cylinder):
        disc = side * np.sqrt(rng.uniform(0, 1, count))[:, None]
        disc[:, 2] = rng.choice([-half, half], count)
        ends = disc
    else:
        v = rng.normal(size=(count, 3))
        ends = shape.radius * v / np.linalg.norm(v, axis=1, keepdims=True)
        ends[:, 2] += half * np.sign(ends[:, 2])
    return CENTER + TURN.apply(np.vstack([side, ends]))


def inside(name: str, r: np.ndarray) -> np.ndarray:
    """Whether points (n, 3) are in the solid, from its definition."""
    shape = SHAPES[name]
    y = TURN.inv().apply(r - CENTER)
    if isinstance(shape, Sphere):
        return np.linalg.norm(y, axis=1) < shape.radius
    if isinstance(shape, Plane):
        return y[:, 2] < 0
    if isinstance(shape, Box):
        return np.all(np.abs(y) < 0.5 * shape.size, axis=1)
    half = 0.5 * np.linalg.norm(shape.end - shape.start)
    if isinstance(shape, Cylinder):
        return (np.hypot(y[:, 0], y[:, 1]) < shape.radius) & (np.abs(y[:, 2]) < half)
    beyond = y[:, 2] - np.clip(y[:, 2], -half, half)
    return np.sqrt(y[:, 0] ** 2 + y[:, 1] ** 2 + beyond**2) < shape.radius


def places(seed: int, count: int) -> np.ndarray:
    return CENTER + np.random.default_rng(seed).uniform(-1.0, 1.0, (count, 3))


@pytest.mark.parametrize("name", SHAPES)
def test_gap_is_the_distance_to_the_surface(name: str) -> None:
    r = places(1, 300)
    distance, _ = cKDTree(surface(name)).query(r)
    sign = np.where(inside(name, r), -1.0, 1.0)
    assert {-1.0, 1.0} <= set(sign)
    found = np.array([gaps(encoded(name), p)[0] for p in r])
    # The points on a few square metres leave holes of some 0.01; a hole d at a distance D adds d^2 / 2 D, and
    # beside the surface the hole itself.
    assert np.abs(found + RADIUS - sign * distance).max() < 0.01
    assert np.median(np.abs(found + RADIUS - sign * distance)) < 2e-4


@pytest.mark.parametrize("name", SHAPES)
def test_gradient_and_hessian(name: str) -> None:
    obstacle = encoded(name)[0]
    step = 1e-5
    compared = 0
    for r in places(2, 200):
        _, n, second = value(obstacle, r)
        sides = [[value(obstacle, r + s * step * e) for s in (-1, 1)] for e in np.eye(3)]
        across = np.array([(b[1] - a[1]) for a, b in sides]) / (2 * step)
        if np.abs(across).max() > 1e3:
            continue  # an edge of the solid or of its inner skeleton lies between the two
        compared += 1
        gradient = np.array([(b[0] - a[0]) for a, b in sides]) / (2 * step)
        # Central differences: step^2 times the third derivative, up to 1 / distance^2; rounding 1e-16 / step.
        assert n == pytest.approx(gradient, abs=1e-6)
        assert np.linalg.norm(n) == pytest.approx(1.0, abs=1e-12)
        curvature = max(np.abs(second).max(), 1.0)
        assert second == pytest.approx(across, abs=1e-4 * curvature**3)
        assert second @ n == pytest.approx(np.zeros(3), abs=1e-10 * curvature)
    assert compared > 190


@pytest.mark.parametrize("name", SHAPES)
def test_gap_has_no_jumps(name: str) -> None:
    # A distance changes by no more than the way gone: also over edges and through the middle.
    obstacle = encoded(name)[0]
    rng = np.random.default_rng(3)
    for r in np.vstack([places(3, 100), CENTER + 1e-9 * rng.normal(size=(20, 3))]):
        step = 1e-3 * rng.normal(size=3)
        change = value(obstacle, r + step)[0] - value(obstacle, r)[0]
        assert abs(change) <= np.linalg.norm(step) * (1 + 1e-9)


@pytest.mark.parametrize("name", SHAPES)
def test_in_the_very_middle_everything_is_finite(name: str) -> None:
    distance, n, _ = value(encoded(name)[0], CENTER.copy())
    assert np.isfinite(distance)
    assert np.linalg.norm(n) == pytest.approx(1.0, abs=1e-12)


def test_the_cables_radius_may_be_left_out() -> None:
    r = CENTER + np.array([0.0, 0.0, 1.0])
    assert gaps(encoded("sphere"), r)[0] == pytest.approx(1.0 - 0.4 - RADIUS)
    assert gaps(encoded("sphere", counts=False), r)[0] == pytest.approx(1.0 - 0.4)


@pytest.mark.parametrize("name", SHAPES)
def test_obstacles_move_with_their_link_and_are_seen_from_the_start_clamp(name: str) -> None:
    rng = np.random.default_rng(4)
    link = np.append(rng.normal(size=3), Rotation.random(random_state=rng).as_quat())
    start = np.append(rng.normal(size=3), Rotation.random(random_state=rng).as_quat())
    length = 0.38
    seen = placed(encoded(name), link[None], start, length)
    for local in places(5, 20):
        world = Rotation.from_quat(link[3:]).apply(local) + link[:3]
        from_start = Rotation.from_quat(start[3:]).inv().apply(world - start[:3]) / length
        expected = gaps(encoded(name), local)[0]
        assert length * gaps(seen, from_start)[0] == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("direction", [[0, 0, 1], [0, 0, -1], [1, 0, 0], [-0.6, 0.64, -0.48], [1e-9, 0, -1]])
def test_across(direction: list[float]) -> None:
    n = np.array(direction, float) / np.linalg.norm(direction)
    directions = np.empty((2, 3))
    kernels.across(n, directions)
    assert np.vstack([directions, n]) @ np.vstack([directions, n]).T == pytest.approx(np.eye(3), abs=1e-12)


# The curve


MESH = Mesh(reference_element(5), np.array([0.2, 0.45, 0.35]))


def frames(seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    s = MESH.nodes[:, None]
    turn = 2.0 * s * rng.normal(size=3) + np.sin(3.0 * s + rng.normal(size=3))
    q = np.empty((len(s), 4))
    quaternion.retract(np.tile([1.0, 0.0, 0.0, 0.0], (len(s), 1)), turn.ravel(), q)
    return q


@pytest.mark.parametrize("x", [0.0, 0.3, 1.0])
def test_polynomials_at_one_place(x: float) -> None:
    nodes = MESH.element.nodes
    values, slopes = np.empty(6), np.empty(6)
    centreline.shape(nodes, x, values, slopes)
    expected, expected_slopes = lagrange(nodes, np.array([x]))
    assert values == pytest.approx(expected[0], abs=1e-13)
    assert slopes == pytest.approx(expected_slopes[0], abs=1e-11)


def test_elements_of_arc_lengths() -> None:
    places = {
        0.0: (0, 0.0),
        0.1: (0, 0.5),
        0.2: (1, 0.0),
        0.65: (2, 0.0),
        1.0: (2, 1.0),
        1.0 + 1e-15: (2, 1.0),
    }
    for s, (element, place) in places.items():
        found = centreline.find_element(s, MESH.starts, MESH.lengths)
        assert found[0] == element
        assert found[1] == pytest.approx(place, abs=1e-14)


@pytest.mark.parametrize("s", [0.01, 0.17, 0.5, 0.9999])
def test_tangent_and_its_derivative(s: float) -> None:
    q = frames()

    def at(s: float) -> tuple[np.ndarray, np.ndarray]:
        t, dt = np.empty(3), np.empty(3)
        centreline.direction(q, MESH.lengths, MESH.starts, MESH.element.nodes, s, t, dt)
        return t, dt

    t, dt = at(s)
    frame = MESH.interpolate(q, np.array([s]))[0]
    assert t == pytest.approx(quaternion.rotate(frame, np.array([0.0, 0.0, 1.0])), abs=1e-13)
    step = 1e-5  # central differences: step^2 times a third derivative of up to some hundred
    assert dt == pytest.approx((at(s + step)[0] - at(s - step)[0]) / (2 * step), abs=1e-6)
    assert t @ dt == pytest.approx(0.0, abs=1e-11)


@pytest.mark.parametrize("P", [[1.0, 0.0, 0.0], [0.3, -2.0, 5.0]])
def test_pull_of_a_point_force(P: list[float]) -> None:
    q, force, weight = 1.3 * frames()[7], np.array(P), 0.37

    def derivative(at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        gradient, hessian = np.empty(4), np.empty((4, 4))
        kernels.pull(at, force, weight, gradient, hessian)
        return gradient, hessian

    def work(at: np.ndarray) -> float:
        w, x, y, z = at
        t = np.array([2 * (x * z + w * y), 2 * (y * z - w * x), w * w - x * x - y * y + z * z]) / (at @ at)
        return -weight * force @ t

    gradient, hessian = derivative(q)
    step = 1e-5  # as above: 1e-10 of the third derivative, 1e-11 of rounding
    for i in range(4):
        e = step * np.eye(4)[i]
        assert gradient[i] == pytest.approx((work(q + e) - work(q - e)) / (2 * step), abs=1e-8)
        numeric = (derivative(q + e)[0] - derivative(q - e)[0]) / (2 * step)
        assert hessian[i] == pytest.approx(numeric, abs=1e-8)
    # The length of the quaternion does no work.
    assert gradient @ q == pytest.approx(0.0, abs=1e-13)


def test_the_curve_passes_where_the_solver_has_its_ends_and_follows_the_tangents() -> None:
    q = frames()
    element = MESH.element
    coefficients = np.zeros((3, 6, 3))
    centreline.curve(q, MESH.lengths, element.values, primitives(element), coefficients)

    def position(s: float) -> np.ndarray:
        r = np.empty(3)
        centreline.position(coefficients, MESH.lengths, MESH.starts, s, r)
        return r

    z = np.array([0.0, 0.0, 1.0])
    reached = np.zeros(3)
    for start, h in zip(MESH.starts, MESH.lengths, strict=True):
        assert position(start) == pytest.approx(reached, abs=1e-13)
        for x, weight in zip(element.points, element.weights, strict=True):
            s = start + h * x
            tangent = quaternion.rotate(MESH.interpolate(q, np.array([s]))[0], z)
            reached = reached + h * weight * tangent
            # At a Gauss point its slope is the tangent; central differences of a polynomial of order 5.
            slope = (position(s + 1e-5) - position(s - 1e-5)) / 2e-5
            assert slope == pytest.approx(tangent, abs=1e-7)
    assert position(1.0) == pytest.approx(reached, abs=1e-13)


def test_a_closed_curve_keeps_its_ends_and_has_the_tangents_of_the_frames_there() -> None:
    q, element, z = frames(), MESH.element, np.array([0.0, 0.0, 1.0])
    open_curve, closed = np.zeros((3, 6, 3)), np.zeros((3, 8, 3))
    centreline.curve(q, MESH.lengths, element.values, primitives(element), open_curve)
    centreline.close_curve(q, MESH.lengths, end_bubbles(element.order), open_curve, closed)
    slopes = np.arange(8)[:, None] * closed
    for e, h in enumerate(MESH.lengths):
        for end in (0, 1):
            tangent = quaternion.rotate(q[(e + end) * element.order], z)
            found = slopes[e, 1] if end == 0 else slopes[e].sum(axis=0)
            assert found == pytest.approx(h * tangent, abs=1e-13)
        assert closed[e, 0] == pytest.approx(open_curve[e, 0], abs=1e-15)
        assert closed[e].sum(axis=0) == pytest.approx(open_curve[e].sum(axis=0), abs=1e-13)
        for x in element.points:
            both = slopes[e, 1:].T @ x ** np.arange(7), (np.arange(1, 6)[:, None] * open_curve[e, 1:]).T
            assert both[0] == pytest.approx(both[1] @ x ** np.arange(5), abs=1e-13)
