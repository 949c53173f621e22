# SPDX-License-Identifier: Apache-2.0
"""Natural frequencies of cables with pins, rings and tubes: two-span beams, a spectral reference, limits."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from references import vibrations
from references.rods import STILL, equal
from references.two_spans import two_spans
from scipy.spatial.transform import Rotation

from cable_ros import Equilibrium, Tracker, load_scene
from cable_ros.branch.coupled_modes import Piece, coupled_modes
from cable_ros.branch.coupling import Ends, Section
from cable_ros.branch.modes import followed, vibrating
from cable_ros.rod.kirchhoff import Rod
from cable_ros.rod.units import Units
from cable_ros.rod.vibration import kernel

GRAVITY = np.array([0.5, 1.0, -4.9])
START = {"position": [0.0, 0.0, 0.0], "orientation": [0.0, 0.0, 0.0, 1.0]}
END = {"position": [0.3, 0.0, 0.7], "rpy": [0.2, 0.5, 0.0]}
STIFFNESS, NATURAL = [1.0, 1.3, 0.8], [0.3, -0.2, 0.4]
FIRST, SECOND, TURN = [0.05, 0.02, 0.36], [0.2, 0.1, 0.6], [0.1, 0.2, 0.0]
PIN = {"name": "first", "pin": {"arc_length": 0.4, "position": FIRST}}
RING = {"name": "first", "ring": {"arc_length": 0.4, "position": FIRST}}
TUBE = {"name": "first", "tube": {"arc_length": 0.4, "position": FIRST, "rpy": TURN}}
OTHER = {"name": "second", "ring": {"arc_length": 0.75, "position": SECOND}}


def scene(supports: list[dict[str, Any]] | None, **fields: Any) -> dict[str, Any]:
    cable = {
        "name": "cable", "length": 1.0, "start": START, "end": END, "stiffness": STIFFNESS,
        "natural_strain": NATURAL, "linear_density": 1.0,
    }  # fmt: skip
    if supports is not None:
        cable["supports"] = supports
    return {"gravity": GRAVITY.tolist(), "cables": [cable | fields]}


def solved(mapping: dict[str, Any], tolerance: float = 1e-7) -> Equilibrium:
    (found,) = Tracker(load_scene(mapping), tolerance).arrive({}).values()
    assert found.status.trusted, found.message
    return found


def omega(found: Equilibrium, count: int = 5) -> np.ndarray:
    return found.modes(count).frequencies


def spectral(
    found: Equilibrium, supports: list[vibrations.Support], about: list[float], order: int
) -> np.ndarray:
    """The lowest of the same cable by `references.vibrations`."""
    turn = Rotation.from_euler("xyz", END["rpy"]).as_quat()
    rod = vibrations.Rod(
        1.0, np.array(STIFFNESS), np.array(NATURAL), GRAVITY, (np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])),
        (np.array(END["position"]), np.roll(turn, 1)), 1.0,
    )  # fmt: skip
    at = vibrations.Vibrations(rod, supports, np.array(about), np.roll(found.orientations, 1, axis=1), order)
    at.solve()
    return at.frequencies(4)


@pytest.mark.parametrize(
    ("supports", "held", "about", "order"),
    [
        ([PIN], [vibrations.pin(np.array(FIRST))], [0.4], 14),
        ([RING], [vibrations.ring(np.array(FIRST))], [0.39], 14),
        (
            [TUBE],
            [vibrations.tube(np.array(FIRST), Rotation.from_euler("xyz", TURN).as_matrix()[:, :2].T)],
            [0.37],
            16,
        ),
        ([PIN, OTHER], [vibrations.pin(np.array(FIRST)), vibrations.ring(np.array(SECOND))], [0.4, 0.75], 13),
    ],
    ids=["pin", "ring", "tube", "pin and ring"],
)
def test_frequencies_are_those_of_the_energy_differentiated(supports, held, about, order):
    found = solved(scene(supports))
    # of the reference: 3e-5 with so many points on a piece, 1e-6 with four more
    np.testing.assert_allclose(omega(found, 4), spectral(found, held, about, order), rtol=1e-4)


@pytest.mark.parametrize(("order", "counts"), [(2, (8, 16)), (3, (4, 8))])
def test_of_two_spans_they_converge_with_twice_the_order(order, counts):
    """A straight beam on a pin: two pieces that share the rotation in it."""
    exact, errors = np.repeat(two_spans(0.4, 2), 2) / (2.0 * np.pi), []
    turn = np.zeros((2, 12, 3))  # of the end of the first piece, of the start of the second
    turn[0, 9:], turn[1, 3:6] = np.eye(3), np.eye(3)
    for count in counts:
        pieces, K = [], np.zeros((3, 3))
        for length, by in zip((0.4, 0.6), turn, strict=True):
            rod = Rod(equal(order, count), np.array([1.0, 1.0, 0.8]))
            rod.set_conditions(np.array([1.0, 0.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0]), np.zeros(3))
            own = vibrating(rod, np.tile([1.0, 0.0, 0.0, 0.0], (len(rod.mesh.nodes), 1)), np.zeros(3))
            X = followed(own, kernel(own.rows), by)
            K += X.T @ own.H @ X / length
            pieces.append(Piece(own, Units(length, 1.0), 1.0, STILL))
        # 4 EI / L of each: to the order of the pieces
        np.testing.assert_allclose(np.diagonal(K)[:2], 4.0 / 0.4 + 4.0 / 0.6, rtol=1e-3)
        ends = Ends.of(np.zeros(12), Section(np.ones(3), np.zeros(3)))
        free, halves = np.array([True, True, True, False]), [np.linspace(0.0, 1.0, 3)] * 2
        found = coupled_modes(pieces, [ends, ends], K, free, 4, halves)
        errors.append(np.abs(found.frequencies / exact - 1.0))
        assert np.abs(found.shapes[:, [2, 3]]).max() < 1e-9, "the pin stands still"
    rates = np.log(errors[0] / errors[1]) / np.log(counts[1] / counts[0])
    np.testing.assert_allclose(rates, 2 * order, atol=0.6)


def test_what_holds_more_has_higher_frequencies():
    """Where a ring holds the cable, so would a pin and a tube, and where a pin does, a clip (Rayleigh)."""
    ring = solved(scene([RING]))
    place = {"arc_length": ring._tangent._cuts[1], "position": FIRST}
    frame = ring.pieces[0]._tangent.turn[6:9, 6:9]
    rpy = Rotation.from_matrix(frame).as_euler("xyz").tolist()
    others = [solved(scene([{"name": "first", "pin": place}]))]
    others += [solved(scene([{"name": "first", kind: place | {"rpy": rpy}}])) for kind in ("tube", "clip")]
    for other in others:  # the same equilibrium
        np.testing.assert_allclose(other.end_wrench, ring.end_wrench, rtol=1e-4, atol=1e-5)
    slides, turns, along, held = (omega(found) for found in (ring, *others))
    for less, more in ((slides, turns), (slides, along), (turns, held), (along, held)):
        assert (more >= less * (1.0 - 1e-6)).all()
        assert more.max() > less.max()
        assert (more > 1.02 * less).any()


def test_a_ring_that_sticks_is_a_pin():
    ring = {"name": "first", "ring": {"arc_length": 0.4, "position": FIRST, "friction": 5.0}}
    np.testing.assert_allclose(omega(solved(scene([ring]))), omega(solved(scene([PIN]))), rtol=1e-7)


def test_a_clip_between_pieces_parts_what_moves_together():
    """The frequencies are those of both sides, in one order."""
    clip = {"name": "second", "clip": {"arc_length": 0.75, "position": SECOND, "rpy": [0.0, 0.9, 0.0]}}
    found = solved(scene([RING, clip])).modes(6)
    sides = [
        solved(scene([RING], length=0.75, end={"position": SECOND, "rpy": [0.0, 0.9, 0.0]})).modes(6),
        solved(scene(None, length=0.25, start={"position": SECOND, "rpy": [0.0, 0.9, 0.0]})).modes(6),
    ]
    both = np.sort(np.concatenate([side.frequencies for side in sides]))[:6]
    np.testing.assert_allclose(found.frequencies, both, rtol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(found.shapes, axis=2).max(axis=1), 1.0, rtol=0.01)
    np.testing.assert_allclose(found.shapes[:, [0, 75, 100]], 0.0, atol=1e-9)
    # every mode is one of one side
    moves = np.array([[np.abs(one[:75]).max(), np.abs(one[75:]).max()] for one in found.shapes])
    assert moves.min(axis=1).max() < 1e-9


def turned(mount: dict[str, Any], by: Rotation, shift: np.ndarray) -> dict[str, Any]:
    frame = Rotation.from_euler("xyz", mount.get("rpy", [0.0, 0.0, 0.0]))
    out = {key: value for key, value in mount.items() if key not in ("rpy", "orientation")}
    position = by.apply(mount["position"]) + shift
    return out | {"position": position.tolist(), "orientation": (by * frame).as_quat().tolist()}


def test_rigid_motions_and_the_other_end_change_nothing():
    plain = omega(solved(scene([TUBE, OTHER])))
    by, shift = Rotation.from_euler("xyz", [0.4, -0.7, 1.1]), np.array([0.3, -0.2, 0.5])
    supports = [
        {"name": "first", "tube": turned(TUBE["tube"], by, shift)},
        {"name": "second", "ring": turned(OTHER["ring"], by, shift)},
    ]
    moved = scene(supports, start=turned(START, by, shift), end=turned(END, by, shift))
    np.testing.assert_allclose(
        omega(solved(moved | {"gravity": by.apply(GRAVITY).tolist()})), plain, rtol=1e-5
    )
    # told from its other end: z axes the other way, about x, which turns y and twist as well
    flip = Rotation.from_euler("x", np.pi)

    def back(mount: dict[str, Any]) -> dict[str, Any]:
        frame = Rotation.from_euler("xyz", mount.get("rpy", [0.0, 0.0, 0.0])) * flip
        out = {key: value for key, value in mount.items() if key not in ("rpy", "orientation")}
        if "arc_length" in out:
            out["arc_length"] = 1.0 - out["arc_length"]
        return out | {"orientation": frame.as_quat().tolist()}

    supports = [
        {"name": "second", "ring": back(OTHER["ring"])}, {"name": "first", "tube": back(TUBE["tube"])},
    ]  # fmt: skip
    natural = (np.array(NATURAL) * [-1.0, 1.0, 1.0]).tolist()
    other = scene(supports, start=back(END), end=back(START), natural_strain=natural)
    np.testing.assert_allclose(omega(solved(other)), plain, rtol=1e-5)


def test_units_change_nothing():
    """A cable twice as long, a quarter as heavy per length: f L^2 (rho / EI)^1/2 is the same."""
    one, place = omega(solved(scene([RING]))), {"arc_length": 0.8, "position": [2.0 * x for x in FIRST]}
    big = scene(
        [{"name": "first", "ring": place}], length=2.0, linear_density=0.25,
        natural_strain=[0.5 * x for x in NATURAL], end=END | {"position": [0.6, 0.0, 1.4]},
    )  # fmt: skip
    other = omega(solved(big | {"gravity": (0.5 * GRAVITY).tolist()}))
    np.testing.assert_allclose(other, one / 2.0, rtol=1e-6)


def test_without_mass_nothing_swings():
    assert np.isinf(omega(solved(scene([RING], linear_density=0.0)))).all()
