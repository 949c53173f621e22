# SPDX-License-Identifier: Apache-2.0
"""Whether a step leads from a shape that is its own image to one that is not."""

from __future__ import annotations

import numpy as np
import pytest

from cable_ros.contact.symmetry import LEANT, OUT, is_even, leaves_plane, lost_symmetry
from cable_ros.rod import quaternion

GRID = np.linspace(0.0, 1.0, 33)
U = GRID - 0.5
NONE, EVEN, ODD = 0.0 * U, np.cos(np.pi * U) ** 2, np.sin(2.0 * np.pi * U)
"""All are zero at the ends."""
LOOP = np.stack([np.cos(2.0 * U), 0.2 * ODD, np.sin(2.0 * U)], axis=1)
"""Tangents of a cable that is its image, told from its other end, by reflection in a plane across x."""
BOW = np.stack([1.0 + EVEN, 0.2 * ODD, 0.5 + 0.1 * EVEN], axis=1)
"""The same by half a turn about y."""
PLANAR = np.stack([np.sin(3.0 * GRID**2), NONE, np.cos(3.0 * GRID**2)], axis=1)
AHEAD = np.array([0.0, 0.0, 1.0])


def frames(t: np.ndarray) -> np.ndarray:
    """(33, 4) of a shape with tangents t (33, 3), of any length."""
    t = t / np.linalg.norm(t, axis=1)[:, None]
    return np.array([quaternion.between(AHEAD, one) for one in t])


def even(t: np.ndarray) -> bool:
    """Whether the shape with tangents t (33, 3), of any length, is its own image."""
    q = frames(t)
    return is_even(q, np.mean(quaternion.tangents(q), axis=0))


def lost(before: np.ndarray, change: tuple[np.ndarray, ...], size: float, uneven: float = OUT) -> bool:
    """Whether symmetry is lost as tangents (33, 3), of any length, change by `size` times three columns."""
    shapes = [frames(t) for t in (before, before + size * np.stack(change, axis=1))]
    position = np.mean(quaternion.tangents(shapes[0]), axis=0)  # the ends stay where they are
    if before is PLANAR:
        return leaves_plane(*shapes, shapes[1][-1], position)
    return lost_symmetry(*shapes, position, np.zeros(3), uneven) is not None


@pytest.mark.parametrize(
    ("shape", "keeps", "breaks"),
    [
        (LOOP, (EVEN, ODD, ODD), (ODD, NONE, NONE)),
        (LOOP, (EVEN, ODD, ODD), (NONE, EVEN, NONE)),
        (BOW, (EVEN, ODD, EVEN), (NONE, NONE, ODD)),
        (BOW, (EVEN, ODD, EVEN), (ODD, NONE, NONE)),
        (PLANAR, (ODD, NONE, EVEN), (NONE, EVEN, NONE)),
        (PLANAR, (ODD, NONE, EVEN), (NONE, ODD, NONE)),
    ],
)
def test_what_is_its_own_image(
    shape: np.ndarray, keeps: tuple[np.ndarray, ...], breaks: tuple[np.ndarray, ...]
) -> None:
    assert not lost(shape, keeps, 0.1)
    assert lost(shape, breaks, 0.1)
    assert not lost(shape, breaks, 1e-4)  # that may be rounding of a step near the fork
    kept, broken = np.stack(keeps, axis=1), np.stack(breaks, axis=1)
    assert even(shape + 0.1 * kept + 1e-3 * broken)  # as uneven as stick and slip make it
    assert not even(shape + 0.1 * kept + 0.1 * broken)
    askew = shape + 3.0 * OUT * broken
    assert not lost(askew, breaks, 0.1)


def test_ends_that_move_apart_unevenly() -> None:
    at_the_end = (NONE, GRID, NONE)
    for shape in (LOOP, BOW, PLANAR):
        assert not lost(shape, at_the_end, 0.1)


@pytest.mark.parametrize("breaks", [(NONE, NONE, ODD), (ODD, NONE, NONE)])
def test_shape_that_leans_before_it_falls(breaks: tuple[np.ndarray, ...]) -> None:
    """What leans does not tilt the axis of the half turn, which the ends know."""
    leans = BOW + 3.0 * OUT * np.stack(breaks, axis=1)
    assert lost(leans, breaks, 0.3, LEANT)
    assert not lost(leans, breaks, 0.3)


def test_load_tells_the_axis_that_aligned_ends_do_not() -> None:
    """A shape uneven by 3e-5 tilts it: then the image is no equilibrium, and no rule picks the side."""
    twisted, breaks = np.stack([0.5 * ODD, EVEN, 1.0 + NONE], axis=1), np.stack([NONE, ODD, NONE], axis=1)
    shapes = [frames(twisted + lean * breaks) for lean in (3e-5, 0.3)]
    for load, tilt in ((np.array([-20.0, 0.0, 0.0]), 0.0), (np.zeros(3), 1e-5)):
        symmetry = lost_symmetry(*shapes, 0.6 * AHEAD, load)
        assert symmetry is not None
        assert abs(symmetry.axis[1]) >= tilt
        assert tilt > 0.0 or np.allclose(np.abs(symmetry.axis), [1.0, 0.0, 0.0], 0.0, 1e-12)
