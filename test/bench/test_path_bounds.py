# SPDX-License-Identifier: Apache-2.0
"""Whether there is a path past the obstacles: as geometry says, and no claim about it passes unchecked."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cable_ros import Status
from cable_ros.bench.cases import Case, Outcome, Step, reach_fault, run_case
from cable_ros.bench.path_bounds import PathBounds, path_bounds, pulled_taut
from cable_ros.bench.robustness import Tally
from cable_ros.bench.surfaces import Distance, distance
from cable_ros.scene.obstacles import Box, Obstacle, Plane, Shape, Sphere

START, END = np.array([1.0, 2.0, 3.0]), np.array([1.0, 2.0, 4.8])
"""1.8 m apart; the cables below are about 2 m long."""
WORLD = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])


def among(*shapes: Shape) -> dict[str, Distance]:
    return {
        f"obstacle_{i}": distance(Obstacle(f"obstacle_{i}", shape), WORLD, 0.0)
        for i, shape in enumerate(shapes)
    }


def box(low: tuple[float, float, float], high: tuple[float, float, float]) -> Box:
    """A box by its corners, seen from the middle between the clamps."""
    corners = 0.5 * (START + END) + np.array([low, high])
    return Box(corners.mean(axis=0), corners[1] - corners[0], np.array([0.0, 0.0, 0.0, 1.0]))


def round_ball(radius: float, aside: float) -> float:
    """Two tangents and an arc, past a ball half paths."""
    far = np.hypot(0.9, aside)
    tangent = np.sqrt(far**2 - radius**2)
    turned = 2.0 * (np.arctan2(0.9, aside) - np.arctan2(tangent, radius))
    return float(2.0 * tangent + radius * turned)


def check(paths: PathBounds, length: float, exact: float) -> None:
    # nodes 1/2000 apart cut corners, and springs let them in a little: 1e-4 at most; the path outside keeps
    # up to 3e-4 away, which makes it longer by as much for each rad of turn
    assert exact - 1e-4 * length < paths.lower * length < exact + 1e-6 * length
    assert exact <= paths.upper * length < exact + 5e-4 * length


@pytest.mark.parametrize(("radius", "aside"), [(0.4, 0.0), (0.5, 0.2)])
def test_round_a_ball(radius: float, aside: float) -> None:
    ball = Sphere(0.5 * (START + END) + np.array([aside, 0.0, 0.0]), radius)
    exact = round_ball(radius, aside)
    check(path_bounds(START, END, 2.0, among(ball)), 2.0, exact)


@pytest.mark.parametrize(("part", "says"), [(1.001, (False, True)), (0.999, (True, False))])
def test_whether_a_cable_is_long_enough(part: float, says: tuple[bool, bool]) -> None:
    ball = Sphere(0.5 * (START + END), 0.8)
    paths = path_bounds(START, END, part * round_ball(0.8, 0.0), among(ball))
    assert (paths.too_long, paths.fits) == says


@pytest.mark.parametrize(("aside", "too_long"), [(0.0, True), (1e-9, True), (1e-3, False)])
def test_a_string_in_a_plane_of_symmetry_is_pulled_within_it(aside: float, too_long: bool) -> None:
    """Over the far side of a ball, 2.49 m long; if it may slide off sideways it gets as short as 1.85 m."""
    ball = Sphere(0.5 * (START + END) + np.array([0.3, 0.0, 0.0]), 0.5)
    z = np.linspace(-1.0, 1.0, 201)[:, None]
    rounding = 1e-10 * np.random.default_rng(0).normal(size=z.shape)
    over = np.hstack([np.cos(0.5 * np.pi * z), aside * np.cos(0.5 * np.pi * z) + rounding, 0.9 * z])
    over[[0, -1], 1] = 0.0
    paths = pulled_taut(0.5 * (START + END) + over, START, END, 2.0, among(ball))
    assert paths.too_long == too_long
    assert paths.lower * 2.0 == pytest.approx(round_ball(0.5, -0.3 if too_long else 0.3), abs=2e-4)


def test_round_the_nearest_edge_of_a_box() -> None:
    wall = box((-0.3, -5.0, -0.05), (0.6, 5.0, 0.05))
    exact = 2.0 * np.hypot(0.85, 0.3) + 0.1
    check(path_bounds(START, END, 2.0, among(wall)), 2.0, exact)


def test_between_two_walls_in_zigzag() -> None:
    """First past the one on the left, then past the other on the right: no single arc goes there."""
    walls = among(box((-5.0, -5.0, -0.5), (0.1, 5.0, -0.48)), box((-0.1, -5.0, 0.48), (5.0, 5.0, 0.5)))
    exact = 2.0 * (np.hypot(0.4, 0.1) + 0.02) + np.hypot(0.96, 0.2)
    check(path_bounds(START, END, 2.0, walls), 2.0, exact)


def test_through_a_narrow_gap() -> None:
    """A slot 1 cm wide off the line of the clamps, with a long way round beside it."""
    slot = among(box((-5.0, -5.0, -0.05), (0.1, 5.0, 0.05)), box((0.11, -5.0, -0.05), (5.0, 5.0, 0.05)))
    exact = 2.0 * np.hypot(0.85, 0.1) + 0.1
    paths = path_bounds(START, END, 2.0, slot)
    assert paths.lower * 2.0 < exact + 1e-6
    assert paths.fits


def test_no_path_at_all() -> None:
    shut = path_bounds(START, END, 2.0, among(Plane(np.array([0.0, 0.0, 3.5]), np.array([0.0, 0.0, 1.0]))))
    assert shut.too_long
    assert not shut.fits
    wall = path_bounds(START, END, 2.0, among(box((-9.0, -9.0, -0.05), (9.0, 9.0, 0.05))))
    assert wall.too_long
    assert not wall.fits


def test_nothing_in_the_way() -> None:
    beside = among(Sphere(START + np.array([0.5, 0.0, 0.5]), 0.2))
    paths = path_bounds(START, END, 2.0, beside)
    assert paths.lower == pytest.approx(0.9, abs=1e-9)
    assert paths.upper == pytest.approx(0.9, abs=1e-9)
    assert not path_bounds(START, END, 1.79, beside).fits


def ball_case(radius: float) -> Case:
    """A cable of 1 m, 0.9 m from clamp to clamp, with a ball half paths."""
    along = [0.0, np.sqrt(0.5), 0.0, np.sqrt(0.5)]
    cable = {
        "name": "short",
        "length": 1.0,
        "stiffness": [0.01, 0.01, 0.007],
        "linear_density": 0.05,
        "start": {"position": [0.0, 0.0, 0.0], "orientation": along},
        "end": {"position": [0.9, 0.0, 0.0], "orientation": along},
    }
    ball = {"name": "ball", "sphere": {"center": [0.45, 0.0, 0.0], "radius": radius}}
    return Case("ball", "any", {"gravity": [0.0, 0.0, -9.81], "cables": [cable], "obstacles": [ball]})


@pytest.fixture(scope="module")
def too_short() -> Outcome:
    return run_case(ball_case(0.3))


def counted(outcome: Outcome, step: Step) -> Tally:
    tally = Tally("poses")
    tally.add(replace(outcome, steps=[step]))
    return tally


def test_a_confirmed_claim_is_counted_apart(too_short: Outcome) -> None:
    (step,) = too_short.steps
    assert step.equilibrium.status is Status.OUT_OF_REACH
    assert step.impossible
    tally = counted(too_short, step)
    assert tally.good
    assert tally.share == 1.0
    assert tally.row()[2:7] == ["1", "1", "100.00 %", "0", "0"]
    assert "Checked: the shortest path found is 1" in tally.report(0)  # 0.17 m
    tally.add(run_case(ball_case(0.05)))
    assert tally.row()[2:4] == ["2", "1"]
    assert tally.share == 1.0


def test_an_unconfirmed_claim_is_a_failure(too_short: Outcome) -> None:
    tally = counted(too_short, replace(too_short.steps[0], paths=PathBounds(0.9999, 1.0001)))
    assert not tally.good
    assert tally.share == 0.0
    assert len(tally.reported) == 1


def test_not_converged_is_a_failure_however_short_the_cable_is(too_short: Outcome) -> None:
    (step,) = too_short.steps
    lost = replace(step, equilibrium=replace(step.equilibrium, status=Status.NOT_CONVERGED, message="Lost."))
    tally = counted(too_short, lost)
    assert not tally.good
    assert tally.share == 0.0
    assert "Lost. Checked: the shortest path found is" in tally.reported[0][1]


def test_a_false_claim_is_wrong(too_short: Outcome, monkeypatch: pytest.MonkeyPatch) -> None:
    """The tracker made to say so where the ball is small."""
    monkeypatch.setattr("cable_ros.branch.cable_model.too_short", lambda *_: (0.02, 0))
    outcome = run_case(ball_case(0.05))
    assert outcome.steps[0].equilibrium.status is Status.OUT_OF_REACH
    tally = Tally("poses")
    tally.add(outcome)
    assert not tally.good
    assert len(tally.wrong) == 1
    # two tangents and an arc; a millimetre: the path outside keeps its distance
    missing = 1e3 * (1.0 - 2.0 * np.sqrt(0.45**2 - 0.05**2) - 0.1 * np.arcsin(0.05 / 0.45))
    assert tally.wrong[0][1].startswith("said to be too short, but a path ")
    told = float(tally.wrong[0][1].split("a path ")[1].split(" mm shorter")[0])
    assert told == pytest.approx(missing, abs=0.5)
    assert reach_fault(too_short.steps[0].equilibrium, PathBounds(1.1, 1.1), 1.0) is None
