# SPDX-License-Identifier: Apache-2.0
"""Stretch and shear: closed forms, a Cosserat rod integrated by other means, taut cables, derivatives."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest
import yaml
from references import planar
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation
from zoo_make import led

from cable_ros import Equilibrium, Status, Tracker, load_scene
from cable_ros.bench.cases import case_scene
from cable_ros.rod.elements import Mesh, reference_element
from cable_ros.rod.extensible import StretchingRod
from cable_ros.scene import SceneError
from cable_ros.share import share_file

LENGTH = 0.8
STIFFNESS = np.array([0.02, 0.03, 0.015])
IDENTITY = Rotation.identity()


def scene(position: Any, frame: Rotation = IDENTITY, **fields: Any) -> dict[str, Any]:
    gravity = fields.pop("gravity", np.zeros(3))
    start = fields.pop("start", (np.zeros(3), IDENTITY))
    cable = {
        "name": "cable",
        "length": LENGTH,
        "stiffness": STIFFNESS.tolist(),
        "linear_density": 1.0,
        **{
            name: {"position": [float(x) for x in p], "orientation": r.as_quat().tolist()}
            for name, (p, r) in {"start": start, "end": (position, frame)}.items()
        },
        **fields,
    }
    return {"gravity": [float(x) for x in gravity], "cables": [cable]}


def solve(mapping: dict[str, Any], tolerance: float = 1e-6, points: int = 101) -> Equilibrium:
    found = Tracker(load_scene(mapping), tolerance, points).solve({})["cable"]
    assert found.status is Status.CONVERGED, found.message
    return found


def distance(found: np.ndarray, expected: np.ndarray) -> float:
    unit = np.array([1.0] * 3 + [1 / LENGTH] * 3)
    return float(np.linalg.norm((found - expected) * unit) / np.linalg.norm(expected * unit))


@pytest.mark.parametrize("strain", [1e-4, 1e-3, 0.05])
@pytest.mark.parametrize("stiffness", [2.0, 1e3, 1e6])
def test_bar_pulled_straight(strain: float, stiffness: float) -> None:
    found = solve(scene([0, 0, LENGTH * (1 + strain)], axial_stiffness=stiffness))
    force = stiffness * strain
    np.testing.assert_allclose(found.end_wrench, [0, 0, -force, 0, 0, 0], atol=1e-6 * force)
    assert found.energy == pytest.approx(0.5 * force * strain * LENGTH, rel=1e-6)
    np.testing.assert_allclose(found.points[50], found.points[-1] / 2, atol=1e-9)


def test_hanging_bar_grows_by_its_weight() -> None:
    # Held at the top, its end just where it would hang free: no force there, and the textbook's parabola.
    weight, stiffness = 2.0, 50.0
    free = LENGTH + weight * LENGTH**2 / (2 * stiffness)
    found = solve(scene([0, 0, free], gravity=[0, 0, weight], axial_stiffness=stiffness))
    s = np.linspace(0, LENGTH, 101)
    np.testing.assert_allclose(
        found.points[:, 2], s + weight * (LENGTH * s - s**2 / 2) / stiffness, atol=1e-9
    )
    assert np.abs(found.end_wrench).max() < 1e-6 * weight * LENGTH
    np.testing.assert_allclose(found.start_wrench[2], weight * LENGTH, rtol=1e-6)


@pytest.mark.parametrize("shear", [0.02, 0.5, 20.0])
def test_short_beam_gives_way_as_timoshenkos(shear: float) -> None:
    # Both ends clamped, one moved across by a small way: k = 12 EI / L^3 / (1 + 12 EI / (GA L^2)).
    way = 1e-4 * LENGTH
    found = solve(
        scene([way, 0, LENGTH], axial_stiffness=1.0, shear_stiffness=[shear, 3 * shear]), tolerance=1e-6
    )
    ratio = 12 * STIFFNESS[1] / (shear * LENGTH**2)
    force = 12 * STIFFNESS[1] / LENGTH**3 / (1 + ratio) * way
    # Linear theory: what is left out is of the order of the slope squared, times EA L^2 / EI.
    np.testing.assert_allclose(found.end_wrench[[0, 4]], [-force, force * LENGTH / 2], rtol=1e-5)


def cosserat(
    force: np.ndarray, moment: np.ndarray, weight: np.ndarray, compliance: np.ndarray, natural: np.ndarray
) -> tuple[np.ndarray, Rotation, np.ndarray]:
    """End position and frame, and end wrench on the body, of a rod that starts with the given wrench.

    The balances as an initial-value problem in the world, the frame a matrix: nothing of the elements here.
    """

    def rates(s: float, y: np.ndarray) -> np.ndarray:
        frame, F, M = y[3:12].reshape(3, 3), y[12:15], y[15:18]
        strain = natural + (frame.T @ M) / STIFFNESS
        along = frame @ (np.array([0, 0, 1]) + compliance * (frame.T @ F))
        spin = np.array([[0, -strain[2], strain[1]], [strain[2], 0, -strain[0]], [-strain[1], strain[0], 0]])
        return np.concatenate([along, (frame @ spin).ravel(), -weight, -np.cross(along, F)])

    first = np.concatenate([np.zeros(3), np.eye(3).ravel(), force, moment])
    y = solve_ivp(rates, (0, LENGTH), first, method="DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
    frame = y[3:12].reshape(3, 3)
    return y[:3], Rotation.from_matrix(frame), -np.concatenate([frame.T @ y[12:15], frame.T @ y[15:18]])


CASES = {
    "stretch": ([0.05, -0.1, 0.1], [0, 0, 0.02]),
    "shear": ([0.05, -0.1, 0.1], [0.1, 0.03, 0]),
    "both": ([-0.1, 0.05, 0.25], [0.1, 0.05, 0.04]),
}


@pytest.mark.parametrize("name", CASES)
def test_cosserat_rod_by_an_initial_value_problem(name: str) -> None:
    force, compliance = (np.array(v) for v in CASES[name])
    natural, weight = np.array([0.3, -0.5, 0.8]), np.array([0.02, 0.05, -0.1])
    position, frame, expected = cosserat(force, np.array([0.01, -0.02, 0.008]), weight, compliance, natural)
    fields: dict[str, Any] = {"natural_strain": natural.tolist()}
    if compliance[2]:
        fields["axial_stiffness"] = 1 / compliance[2]
    if compliance[0]:
        # A compliance of zero is a very stiff one here: what that leaves is far below the tolerance.
        fields["shear_stiffness"] = [1 / c if c else 1e9 for c in compliance[:2]]
    for tolerance in (1e-4, 1e-7):
        found = solve(scene(position, frame, gravity=weight, **fields), tolerance)
        error = distance(found.end_wrench, expected)
        assert error < tolerance
        assert found.error_estimate < tolerance
        np.testing.assert_allclose(
            found.start_wrench[:3], force, atol=tolerance * np.linalg.norm(expected[:3])
        )
        np.testing.assert_allclose(found.points[-1], position, atol=1e-3 * tolerance * LENGTH)


def test_inextensible_limit_is_met_in_proportion_to_the_compliance() -> None:
    position, frame, gravity = [0.3, 0.2, 0.5], Rotation.from_rotvec([0.3, 0.8, -0.5]), [0, -0.3, 0.2]
    limit = solve(scene(position, frame, gravity=gravity), 1e-9)
    gaps = []
    for stiffness in (1e2, 1e3, 1e4):
        found = solve(scene(position, frame, gravity=gravity, axial_stiffness=stiffness), 1e-9)
        gaps.append(distance(found.end_wrench, limit.end_wrench))
    np.testing.assert_allclose(np.array(gaps[:-1]) / gaps[1:], 10.0, rtol=0.05)  # and a term of second order


@pytest.mark.parametrize("chord", [0.99, 0.9999, 1.0, 1.001, 1.05])
@pytest.mark.parametrize("stiffness", [2.0, 1e3, 1e6])
@pytest.mark.parametrize("weight", [0.0, 1.0])
def test_taut_cable_of_any_stiffness_is_found_cold(chord: float, stiffness: float, weight: float) -> None:
    found = solve(scene([0, 0, LENGTH * chord], gravity=[0, -weight, 0], axial_stiffness=stiffness), 1e-4)
    assert found.error_estimate < 1e-4
    pull = -found.end_wrench[2]
    if chord > 1 and stiffness > 100:  # the weight's sag only adds to it; the softest one it lengthens, too
        assert pull > stiffness * (chord - 1) * (1 - 1e-4)
    np.testing.assert_allclose(-(found.end_wrench + found.start_wrench)[1], weight * LENGTH, atol=1e-3)


def test_taut_cable_sags_as_a_parabola() -> None:
    # Pulled so taut that the clamps' boundary layers, (EI / T)^1/2 long, are short: the pull T follows from
    # T / EA = chord - 1 + (w L / T)^2 / 24, the sag is w L^2 / (8 T); the layers matter by their length.
    stiffness, weight, chord = 5e4, 40.0, 1.0
    found = solve(scene([0, 0, LENGTH * chord], gravity=[0, -weight, 0], axial_stiffness=stiffness), 1e-6)
    pull = -found.end_wrench[2]
    layer = np.sqrt(STIFFNESS[0] / pull) / LENGTH
    assert layer < 0.02
    assert pull / stiffness == pytest.approx((weight * LENGTH / pull) ** 2 / 24, rel=12 * layer)
    assert -found.points[50, 1] == pytest.approx(weight * LENGTH**2 / (8 * pull), rel=6 * layer)


def test_pulled_farther_than_a_tenth_is_out_of_reach() -> None:
    mapping = scene([0, 0, 1.2 * LENGTH], axial_stiffness=10.0)
    found = Tracker(load_scene(mapping)).solve({})["cable"]
    assert found.status is Status.OUT_OF_REACH
    only_shear = scene([0, 0, 1.01 * LENGTH], shear_stiffness=[1.0, 1.0])
    assert Tracker(load_scene(only_shear)).solve({})["cable"].status is Status.OUT_OF_REACH


TWIST = 0.5
SOFT: dict[str, Any] = {
    "natural_strain": [0.3, -0.5, 0.8],
    "axial_stiffness": 5.0,
    "shear_stiffness": [3.0, 4.0],
    "gravity": [0.05, -0.2, 0.1],
}


def moved(end: str, motion: np.ndarray) -> dict[str, Any]:
    ends = {
        "start": (np.zeros(3), IDENTITY),
        "end": (np.array([0.3, 0.2, 0.5]), Rotation.from_euler("x", 0.7)),
    }
    position, frame = ends[end]
    ends[end] = position + frame.apply(motion[:3]), frame * Rotation.from_rotvec(motion[3:])
    return scene(*ends["end"], start=ends["start"], total_twist=TWIST, **SOFT)


def test_clamp_stiffness_and_virtual_work() -> None:
    middle = solve(moved("end", np.zeros(6)), 1e-9)
    step = 2e-3
    for k, end in itertools.product(range(6), ("start", "end")):
        motion = np.zeros(6)
        motion[k] = step

        def numbers(by: float, end: str = end, motion: np.ndarray = motion) -> np.ndarray:
            found = solve(moved(end, by * motion), 1e-10)
            return np.concatenate([found.start_wrench, found.end_wrench, [found.energy]])

        # central difference of fourth order: truncation and the solves' error stay below 1e-8 (measured)
        numeric = (8 * (numbers(1) - numbers(-1)) - (numbers(2) - numbers(-2))) / (12 * step)
        at = k + (0 if end == "start" else 6)
        np.testing.assert_allclose(
            middle.clamp_stiffness[:, at], numeric[:12], atol=1e-7 * np.abs(middle.clamp_stiffness).max()
        )
        wrench = getattr(middle, f"{end}_wrench")
        assert wrench[k] == pytest.approx(-numeric[12], abs=1e-6 * np.abs(wrench).max())


def test_hessian_is_the_gradient_s_derivative() -> None:
    rng = np.random.default_rng(1)
    mesh = Mesh(reference_element(4), np.array([0.3, 0.7]))
    rod = StretchingRod(
        mesh, np.array([1.0, 1.3, 0.7]), np.array([0.5, -0.2, 1.0]), np.array([0.02, 0.03, 0.05])
    )
    q = 0.3 * rng.normal(size=(len(mesh.nodes), 4)) + np.array([1.0, 0, 0, 0])
    q /= np.linalg.norm(q, axis=1)[:, None]
    F, size = 3 * rng.normal(size=3), q.shape[0] * 3
    rod.set_conditions(q[-1], np.array([0.1, 0.2, 0.5]), 2 * rng.normal(size=3))

    def lagrangian(s: np.ndarray, force: np.ndarray) -> tuple[float, np.ndarray]:
        energy, gap, _ = rod.linearize(rod.retract(q, s), force)
        return energy - force @ gap, gap

    rod.linearize(q, F)
    gradient, C, reach = rod.g.ravel().copy(), rod.C.copy(), rod.reach.copy()
    H = np.array([rod.apply_hessian(row) for row in np.eye(size)])
    step, eye = 1e-4, np.eye(size)
    for i in range(size):
        more, less = (lagrangian(sign * step * eye[i], F) for sign in (1, -1))
        # Rounding 1e-16 / step of numbers near 30, and the step squared times third derivatives of some 1e3.
        assert (more[0] - less[0]) / (2 * step) == pytest.approx(gradient[i], abs=2e-5)
        np.testing.assert_allclose((more[1] - less[1]) / (2 * step), C[:, i], atol=1e-6)
    for i, j in rng.integers(0, size, (40, 2)):
        corners = [lagrangian(10 * step * (a * eye[i] + b * eye[j]), F)[0] for a in (1, -1) for b in (1, -1)]
        second = (corners[0] - corners[1] - corners[2] + corners[3]) / (4 * (10 * step) ** 2)
        assert second == pytest.approx(H[i, j], abs=1e-4 * np.abs(H).max())
    for k in range(3):
        force = 0.5 * np.eye(3)[k]
        way = lagrangian(np.zeros(size), F + force)[1] - lagrangian(np.zeros(size), F - force)[1]
        np.testing.assert_allclose(way, reach[:, k], atol=1e-12)  # linear in the force


def test_followed_warm_as_found_cold() -> None:
    arm = share_file("config", "space_arm.yaml").read_text()
    urdf = share_file("config", "space_arm.urdf")
    text = arm.replace("urdf: space_arm.urdf", f"urdf: {urdf}").replace(
        "    total_twist", "    axial_stiffness: 5.0\n    shear_stiffness: [2.0, 2.0]\n    total_twist"
    )
    loaded = load_scene(yaml.safe_load(text.replace("e6", "e+6")))
    tracker, name = Tracker(loaded, 1e-6), loaded.cables[0].name
    counts = []
    for angle in np.radians(np.arange(-90, 91, 2)):
        found = tracker.solve({"orientation": angle})[name]
        assert found.status is Status.CONVERGED
        counts.append(found.iterations)
    assert max(counts[1:]) <= 5
    cold = Tracker(loaded, 1e-8)
    cold.solve({"orientation": 0.0})
    expected = cold.solve({"orientation": np.pi / 2})[name]
    unit = np.array([1.0] * 3 + [1 / 0.38] * 3)
    assert np.linalg.norm((found.end_wrench - expected.end_wrench) * unit) < 2e-6 * np.linalg.norm(
        expected.end_wrench * unit
    )


@pytest.mark.parametrize("stiffness", [1e4, 1e6])
def test_snap_at_a_fold_is_told(stiffness: float) -> None:
    # An arch whose end turns against it; a stretching one snaps a little earlier than others (33 degrees).
    arch = planar.buckled(1.0, 1.0, 0.9).scene(axial_stiffness=stiffness)
    angles = np.arange(-20.0, 50.0, 1.0)
    found = []
    for turn in (1, -1):  # the cold start is free to take either of two mirror images
        case = led("arch", "", arch, [{"yaw": turn * np.radians(a)} for a in angles])
        tracker = Tracker(case_scene(case), tolerance=1e-6)
        found.append([tracker.solve(dict(pose))["cable"] for pose in case.path])
    snaps = 0
    for path in found:
        for before, after in itertools.pairwise(path):
            assert after.status in (Status.CONVERGED, Status.SNAPPED)
            if after.status is Status.SNAPPED:
                snaps += 1
                assert after.energy < before.energy
            else:  # a degree of turn does less work than the largest moment times itself
                moments = max(np.abs(one.end_wrench[3:]).max() for one in (before, after))
                assert abs(after.energy - before.energy) < 2 * np.radians(1) * moments
    assert snaps >= 1


BALL = {"name": "ball", "sphere": {"center": [1, 0, 0], "radius": 0.1}}


@pytest.mark.parametrize(
    ("name", "field", "value"),
    [("stretch", "axial_stiffness", 100.0), ("shear", "shear_stiffness", [100.0, 100.0])],
)
@pytest.mark.parametrize("every", ["all", "auto", None])
def test_no_strain_with_mobilised_friction(name: str, field: str, value: Any, every: str | None) -> None:
    mapping = scene([0, 0, 0.7], **{field: value})
    effects = [name, "contact", "friction"] if every is None else every
    mapping |= {"effects": effects, "obstacles": [BALL | {"friction": 0.1}], "friction_model": "sliding"}
    with pytest.raises(
        SceneError, match=rf"cables\[0\].{field}: {name} and friction_model sliding cannot be combined"
    ):
        load_scene(mapping)
    load_scene({**mapping, "friction_model": "coulomb"})
    load_scene({**mapping, "effects": ["contact", "friction"]})
    load_scene({**mapping, "effects": [name, "contact"]})
    load_scene({**mapping, "effects": [name]})
