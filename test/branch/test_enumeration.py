# SPDX-License-Identifier: Apache-2.0
"""The list of stable equilibria at one pose."""

from __future__ import annotations

import math

import numpy as np
import pytest
from references import planar
from zoo_make import ARM, cable, turned, without_target_twist

from cable_ros import Equilibrium, Tracker, load_scene
from cable_ros.branch.enumeration import branches


def test_the_arm_has_the_branches_that_are_known() -> None:
    # Energies and twists found by another discretisation (relative 1e-3 is all that those figures give).
    (found,) = branches(load_scene(ARM), {"orientation": 0.0}).values()
    energies = [one.energy for one in found]
    assert energies == sorted(energies)
    assert energies[:2] == pytest.approx([42.1e-3, 45.1e-3], rel=1e-3)
    assert energies[2:4] == pytest.approx([108e-3, 120e-3], rel=1e-2)
    assert [one.total_twist for one in found[:2]] == pytest.approx([-2.74, 3.25], abs=5e-3)


def test_each_is_stable_and_where_its_twist_leads_a_cold_start() -> None:
    mapping = cable(turned([0.5, 0.2, 0.1], [0.4, 0.9, -0.3]))
    found = branches(load_scene(mapping), {}, tolerance=1e-6)["cable"]
    assert len(found) > 1
    for one in found:
        assert one.status.trusted
        assert one.stability_margin > 0.0
        mapping["cables"][0]["total_twist"] = one.total_twist
        again = Tracker(load_scene(mapping), tolerance=1e-6).solve({})["cable"]
        # both are within 1e-6 of the same truth
        assert again.end_wrench == pytest.approx(one.end_wrench, abs=1e-5 * np.abs(one.end_wrench).max())


def test_both_sides_of_a_buckled_rod() -> None:
    # Stiffness 4 : 1, so that it buckles in one plane, to either side: mirror images, equal energy and twist.
    side = planar.buckled(1.0, 1.0, 0.9)
    found = branches(load_scene(without_target_twist(side.scene())), {})["cable"]
    planar_ones = [one for one in found if abs(one.total_twist) < 0.1]
    mirror = np.array([-1.0, 1.0, 1.0, 1.0, -1.0, 1.0])
    assert len(planar_ones) == 2
    expected = [side.end_wrench, mirror * side.end_wrench]
    order = np.argsort([one.end_wrench[4] for one in planar_ones])
    for i, true in zip(order, sorted(expected, key=lambda w: w[4]), strict=True):
        # the tolerance asked for is 1e-4
        assert planar_ones[i].end_wrench == pytest.approx(true, abs=2e-4 * np.linalg.norm(true))


def test_none_is_listed_twice() -> None:
    def near(a: Equilibrium, b: Equilibrium) -> bool:
        return bool(np.abs(a.points - b.points).max() < 1e-3)

    found = branches(load_scene(cable(turned([0.3, 0.3, 0.0], [1.0, 0.0, 2.0]))), {})["cable"]
    for i, one in enumerate(found):
        assert not any(near(one, other) for other in found[:i])


def test_out_of_reach_has_none() -> None:
    assert branches(load_scene(cable(turned([1.05, 0.0, 0.0], [0.0, 0.0, 0.0]))), {}) == {"cable": []}


def test_a_missing_joint_is_named() -> None:
    with pytest.raises(KeyError, match="orientation"):
        branches(load_scene(ARM), {})


def test_the_target_twist_moves_the_search() -> None:
    # A rod soft in torsion keeps many turns before it writhes.
    end, soft = turned([0.8, 0.2, 0.1], [0.4, 0.9, -0.3]), (1.0, 1.0, 0.1)
    for turns in (-4, 4):
        target_twist = 2.0 * math.pi * turns
        found = branches(load_scene(cable(end, stiffness=soft, total_twist=target_twist)), {})["cable"]
        assert min(abs(one.total_twist - target_twist) for one in found) < math.pi
