# SPDX-License-Identifier: Apache-2.0
"""A string pulled tight among obstacles: as long as geometry says."""

from __future__ import annotations

import numpy as np
import pytest

from cable_ros import Status, Tracker
from cable_ros.contact.distance import BOX, PLANE, SPHERE, WIDTH
from cable_ros.contact.shortest_path import SEGMENTS, shortest_path, taut_strings, too_short


def obstacle(kind: float, center: tuple[float, float, float], *sizes: float) -> np.ndarray:
    row = np.zeros(WIDTH)
    row[0], row[1:4], row[4:13] = kind, center, np.eye(3).ravel()
    row[13 : 13 + len(sizes)] = sizes
    return row


END = np.array([0.9, 0.0, 0.0])


@pytest.mark.parametrize("height", [0.0, 0.05, 0.15])
def test_round_a_sphere(height: float) -> None:
    """Two tangents and an arc."""
    radius, center = 0.2, np.array([0.45, height, 0.0])
    taut_strings = [np.sqrt(np.sum((end - center) ** 2) - radius**2) for end in (np.zeros(3), END)]
    between = np.arccos(-center @ (END - center) / np.linalg.norm(center) / np.linalg.norm(END - center))
    turned = between - sum(np.arctan2(way, radius) for way in taut_strings)
    length, way = shortest_path(END, np.array([obstacle(SPHERE, tuple(center), radius)]), 0.0)
    # the polygon's parts, 1/SEGMENTS long, cut the arc short by less than a fourth of the part's own share of
    # turn squared, and it may end a hundredth of a part off its minimum
    assert sum(taut_strings) + radius * turned - (1.0 / SEGMENTS / radius) ** 2 / 24 < length
    assert length < sum(taut_strings) + radius * turned + 1e-4
    assert np.linalg.norm(way - center, axis=1).min() > radius - 1e-9


def test_over_a_box_by_the_shorter_side() -> None:
    box = obstacle(BOX, (0.45, 0.1, 0.0), 0.1, 0.2, 5.0)  # from y = -0.1 to 0.3, endless along z
    length, way = shortest_path(END, np.array([box]), 0.0)
    exact = 2.0 * np.hypot(0.35, 0.1) + 0.2
    # each corner is cut by a part of the string at most: its detour is one of 1/SEGMENTS by 0.14 rad
    assert exact - 1e-3 < length < exact + 1e-4
    assert way[SEGMENTS // 2, 1] == pytest.approx(-0.1, abs=1e-3)


def test_a_free_way_is_the_chord() -> None:
    ground = obstacle(PLANE, (0.0, -0.1, 0.0))
    ground[4:13] = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]).ravel()
    length, _ = shortest_path(END, np.array([ground]), 0.0)
    assert length == pytest.approx(0.9, abs=1e-12)
    assert too_short(END, np.array([ground]), 1.0) is None


def test_only_where_no_way_is_short_enough() -> None:
    wall = obstacle(BOX, (0.45, 0.0, 0.0), 0.05, 0.2, 5.0)
    around = 2.0 * np.hypot(0.4, 0.2) + 0.1
    assert too_short(END, np.array([wall]), around + 1e-3) is None
    found = too_short(END, np.array([wall]), around - 2e-2)
    assert found is not None
    missing, which = found
    # parts of the string cut the corners by up to CUT, never the other way
    assert 1e-2 < missing < 2e-2 + 1e-6
    assert which == 0


def test_a_corner_that_the_coarse_string_cuts_is_not_counted_as_slack() -> None:
    box = obstacle(BOX, (0.45, 0.0, 0.0), 0.1, 0.2, 5.0)
    around = 2.0 * np.hypot(0.35, 0.2) + 0.2
    reach = around - 4e-3
    coarse, _ = shortest_path(END, np.array([box]), 0.0)
    assert coarse < reach
    found = too_short(END, np.array([box]), reach)
    assert found is not None
    # a string of a fourth of the parts' length cuts a fourth as much off the two corners
    assert found[0] == pytest.approx(4e-3 - 0.25 * (around - coarse), abs=2e-4)
    assert too_short(END, np.array([box]), around) is None


def test_every_way_past_a_box_is_found_once() -> None:
    bar = obstacle(BOX, (0.45, 0.0, 0.0), 0.05, 0.1, 5.0)  # endless along z: over it or under it
    found = taut_strings(END, np.array([bar]), 1.0)
    assert len(found) == 2
    middles = sorted(float(r[SEGMENTS // 2, 1]) for r in found)
    assert middles == pytest.approx([-0.1, 0.1], abs=1e-6)
    assert not taut_strings(END, np.array([bar]), 0.9)


def test_a_cable_that_is_too_short_is_told_so() -> None:
    along = [0.0, np.sqrt(0.5), 0.0, np.sqrt(0.5)]
    scene = {
        "gravity": [0.0, 0.0, -9.81],
        "cables": [
            {
                "name": "short",
                "length": 1.0,
                "outer_diameter": 0.01,
                "stiffness": [0.01, 0.01, 0.007],
                "linear_density": 0.05,
                "start": {"position": [0.0, 0.0, 0.0], "orientation": along},
                "end": {"position": [0.9, 0.0, 0.0], "orientation": along},
            }
        ],
        "obstacles": [{"name": "ball", "sphere": {"center": [0.45, 0.0, 0.0], "radius": 0.3}}],
    }
    found = Tracker(scene).solve({})["short"]
    assert found.status is Status.OUT_OF_REACH
    # two tangents of 0.332 m from 0.45 m and the arc between them: 1.177 m round radius 0.305 m
    assert "'short' is too short to get past obstacle 'ball'" in found.message
    taut_strings = 2.0 * np.sqrt(0.45**2 - 0.305**2)
    missing = 1e3 * (taut_strings + 0.305 * (np.pi - 2.0 * np.arctan2(taut_strings / 2.0, 0.305)) - 1.0)
    assert float(found.message.split("is ")[-1].split(" mm")[0]) == pytest.approx(missing, abs=1.0)
