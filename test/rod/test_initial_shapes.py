# SPDX-License-Identifier: Apache-2.0
"""Starts of the search: curves between the clamps with frames of a chosen twist."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cable_ros.rod import quaternion
from cable_ros.rod.elements import Mesh, reference_element
from cable_ros.rod.energy_kernels import gradient, workspace
from cable_ros.rod.initial_shapes import (
    along,
    bulges,
    closing_turn,
    spin,
    starts,
    tangents,
    transport,
    unloaded,
)
from cable_ros.rod.rod_state import Evaluation, Grid, Section

MESH = Mesh(reference_element(6), np.full(8, 0.125))
NODES = MESH.nodes
END = quaternion.from_ros(Rotation.from_rotvec([0.7, -0.4, 1.0]).as_quat())
CHORD = np.array([0.3, 0.2, 0.4])
DOWN = np.array([0.0, -20.0, -5.0])
Z = np.array([0.0, 0.0, 1.0])


def totals(q: np.ndarray, mesh: Mesh = MESH) -> np.ndarray:
    """End position (3), energy with unit stiffness, twist of frames q."""
    g, radial, out = np.empty((len(q), 3)), np.empty(len(q)), np.empty(5)
    force, nothing = np.zeros((len(mesh.lengths), 3)), np.zeros(3)
    grid = Grid(mesh.lengths, mesh.starts, mesh.element.tables)
    lanes = workspace(mesh.lengths, mesh.element.tables.by_point)
    evaluation = Evaluation(np.zeros_like(q), g, radial, out, lanes)
    gradient(q, force, nothing, Section(np.ones(3), nothing), grid, evaluation)
    return out


@pytest.mark.parametrize("which", range(6))
def test_curves_leave_and_arrive_as_clamped_and_reach_the_end(which: int) -> None:
    bulge = bulges(END, CHORD, DOWN)[which]
    t = tangents(NODES, END, CHORD, bulge)
    assert np.linalg.norm(t, axis=1) == pytest.approx(np.ones(len(NODES)), abs=1e-14)
    assert t[0] == pytest.approx(Z, abs=1e-14)
    assert t[-1] == pytest.approx(quaternion.rotate(END, Z), abs=1e-14)
    # Frames along them end near the clamp: a start need not meet it, but be of the right length and way.
    assert np.linalg.norm(totals(transport(t))[:3] - CHORD) < 0.1


def test_slack_goes_where_it_is_sent() -> None:
    for bulge in bulges(END, CHORD, DOWN)[1:]:
        q = transport(tangents(NODES, END, CHORD, bulge))
        half = totals(q[: 4 * 6 + 1], Mesh(reference_element(6), np.full(4, 0.125)))[:3]
        sideways = half - CHORD * (half @ CHORD) / (CHORD @ CHORD)
        across = bulge - CHORD * (bulge @ CHORD) / (CHORD @ CHORD)
        assert sideways @ across > 0.0


def test_directions_for_the_slack_are_down_and_all_around() -> None:
    none, down, *around = bulges(END, CHORD, DOWN)
    assert none is None
    assert down == pytest.approx(DOWN / np.linalg.norm(DOWN))
    assert len(around) == 4
    assert np.abs(np.array(around) @ CHORD).max() < 1e-14
    assert np.sum(around, axis=0) == pytest.approx(np.zeros(3), abs=1e-14)
    assert len(bulges(END, CHORD, np.zeros(3))) == 5
    # Clamps at one point have no chord, and still five directions.
    assert all(np.all(np.isfinite(b)) for b in bulges(END, np.zeros(3), np.zeros(3)) if b is not None)


def test_transported_frames_have_no_twist() -> None:
    t = tangents(NODES, END, CHORD, None)
    q = transport(t)
    assert np.array([quaternion.rotate(a, Z) for a in q]) == pytest.approx(t, abs=1e-13)
    # The turn from node to node is about an axis across both tangents: without twist but for the mesh.
    for a, b in pairwise(q):
        turn = quaternion.rotation_vector(quaternion.multiply(b, quaternion.conjugate(a)))
        assert abs(turn @ quaternion.rotate(a, Z)) < 1e-13


def test_transport_along_a_straight_line_back() -> None:
    q = transport(np.array([Z, -Z, Z, [1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]]))
    assert np.linalg.norm(q, axis=1) == pytest.approx(np.ones(5), abs=1e-14)
    assert quaternion.rotate(q[1], Z) == pytest.approx(-Z, abs=1e-14)
    assert quaternion.rotate(q[4], Z) == pytest.approx([-1.0, 0.0, 0.0], abs=1e-14)


@pytest.mark.parametrize("turns", [-1.0, 0.0, 1.0])
def test_spin_adds_twist_and_keeps_the_curve(turns: float) -> None:
    q = transport(tangents(NODES, END, CHORD, None))
    angle = closing_turn(q, END) + 2.0 * np.pi * turns
    spun = spin(q, NODES, angle)
    assert np.array([quaternion.rotate(a, Z) for a in spun]) == pytest.approx(
        np.array([quaternion.rotate(a, Z) for a in q]), abs=1e-13
    )
    # It closes on the clamp's frame, whose quaternion has two signs.
    assert abs(spun[-1] @ END) == pytest.approx(1.0, abs=1e-13)
    # Twist between nodes is resolved to the interpolation's few 1e-3 of these coarse curves.
    assert totals(spun)[4] - totals(q)[4] == pytest.approx(angle, abs=0.05)


@pytest.mark.parametrize("target_twist", [None, -7.0, 0.0, 2.5, 12.0])
def test_starts_begin_with_the_twist_nearest_to_the_target_twist(target_twist: float | None) -> None:
    found = list(starts(NODES, END, CHORD, DOWN, target_twist))
    assert len(found) >= 6
    for q in found:
        assert q[0] == pytest.approx([1.0, 0.0, 0.0, 0.0], abs=1e-14)
        assert abs(q[-1] @ END) == pytest.approx(1.0, abs=1e-13)
    twists = np.array([totals(q)[4] for q in found])
    centre = 0.0 if target_twist is None else target_twist
    # Possible twists of a curve are a turn apart, so one lies within half a turn (and a coarse mesh's 0.1).
    assert abs(twists[0] - centre) < np.pi + 0.1
    assert np.all(np.abs(twists - centre) < 2.2 * np.pi + 0.1)


def test_starts_are_the_same_every_time() -> None:
    first, second = (list(starts(NODES, END, CHORD, DOWN, None)) for _ in range(2))
    assert all(np.array_equal(a, b) for a, b in zip(first, second, strict=True))


NATURAL = np.array([3.0, -1.0, 2.0])
SIZE = float(np.linalg.norm(NATURAL))


def helix(s: float) -> np.ndarray:
    """Frame of the unloaded cable at the arc length s."""
    return np.concatenate([[np.cos(s * SIZE / 2)], np.sin(s * SIZE / 2) * NATURAL / SIZE])


def test_a_coiled_cable_starts_from_its_own_shape() -> None:
    # At its own end frame nothing has to give: the helix itself, strain = natural strain everywhere.
    first = next(iter(unloaded(NODES, helix(1.0), NATURAL, None)))
    for s, q in zip(NODES, first, strict=True):
        assert abs(q @ helix(s)) == pytest.approx(1.0, abs=1e-13)
    for q in starts(NODES, END, CHORD, DOWN, None, NATURAL):
        assert abs(q[-1] @ END) == pytest.approx(1.0, abs=1e-13)


@pytest.mark.parametrize("turns", [-2.0, 0.0, 1.0])
def test_a_coiled_cable_starts_with_the_twist_nearest_to_the_target_twist(turns: float) -> None:
    target_twist = NATURAL[2] + 2.0 * np.pi * turns + 0.5
    twists = [totals(q)[4] for q in unloaded(NODES, helix(1.0), NATURAL, target_twist)]
    around = NATURAL[2] + 2.0 * np.pi * (turns + np.array([0.0, 1.0, -1.0]))
    # The mesh resolves a helix of two turns and more an end to end to about 1e-3.
    assert twists == pytest.approx(around, abs=1e-2)


@pytest.mark.parametrize("target_twist", [None, 4.0])
def test_frames_along_a_string_follow_it_and_end_as_clamped(target_twist: float | None) -> None:
    way = np.array([[0.0, 0.0, 0.0], [0.3, 0.0, 0.4], [0.3, 0.0, 0.8], [0.0, 0.0, 1.2]])  # 0.5, 0.4, 0.5 long
    q = along(way, NODES, END, target_twist, np.zeros(3))
    # the same rotation; its quaternion may have either sign
    assert abs(q[-1] @ END) == pytest.approx(1.0, abs=1e-12)
    assert q[0] == pytest.approx([1.0, 0.0, 0.0, 0.0], abs=1e-12)
    middle = len(NODES) // 2
    assert quaternion.rotate(q[middle], Z) == pytest.approx(Z, abs=1e-12)
    turns = closing_turn(along(way, NODES, END, None, np.zeros(3)), END)
    assert turns == pytest.approx(0.0, abs=1e-12)
