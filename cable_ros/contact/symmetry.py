# SPDX-License-Identifier: Apache-2.0
"""Whether a step takes one of two images of a cable: where a symmetric branch forks, rounding would choose.

A cable may be its own image by reflection in its plane; told from its other end, by reflection in the plane
half way between its ends; and told from there, too, by half a turn.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cable_ros.rod import quaternion
from cable_ros.rod.elements import Mesh
from cable_ros.rod.initial_shapes import side

PLANAR, OUT, GROWS = 1e-8, 1e-3, 10.0
"""How far a planar shape is out of its plane, half the turn of a section, rad; what shows that a shape is not
symmetric; and by how much that has grown in a step, for near a fork the mesh and the tolerance of Newton's
method make one uneven that is the same from both ends."""
LEANT = 1e-2
"""As OUT, for a shape that a cable falls from: near a fold rounding has more of a lever."""
NEARLY = 3e-3
"""As OUT, for a shape that stick and slip have made uneven."""
GRID = np.linspace(0.0, 1.0, 65)
"""Where shapes are compared."""


class Symmetry(NamedTuple):
    """How a cable is its own image told from its other end."""

    kind: int
    axis: np.ndarray
    """(3,) unit normal of the plane of reflection, or axis of the half turn."""


REVERSED, TURNED = 0, 1
"""Kinds: by reflection in the plane half way between the ends, and by half a turn."""


def leaves_plane(
    q: np.ndarray, q_new: np.ndarray, qe: np.ndarray, re: np.ndarray, most: float = PLANAR
) -> bool:
    """Whether a planar cable leaves its plane in one step, although its ends stay in it.

    Where the planar branch loses its stability, rounding would pick one of two mirror images; smaller steps
    show that, and a rule picks it, see `switch_branch`.

    Args:
        q, q_new: (n, 4) frames before and after.
        qe, re: end frame (4,) and position (3,), L.
        most: how far out of its plane the cable may be before.
    """
    n = quaternion.plane(q)
    if not n.any() or quaternion.out_of_plane(q_new, n) < OUT:
        return False
    ends = max(quaternion.out_of_plane(qe[None], n), abs(float(re @ n)))
    return ends < PLANAR and quaternion.out_of_plane(q, n) < most


def takes_side(q: np.ndarray, q_new: np.ndarray, qe: np.ndarray, re: np.ndarray, f: np.ndarray) -> bool:
    """Whether a cable with friction, which makes it a little uneven, is no longer its own image.

    Arguments as in `leaves_plane`, at arc lengths that are symmetric, and in `lost_symmetry`.
    """
    return leaves_plane(q, q_new, qe, re, OUT / GROWS) or lost_symmetry(q, q_new, re, f) is not None


def lost_symmetry(
    q: np.ndarray, q_new: np.ndarray, re: np.ndarray, f: np.ndarray, most: float = OUT
) -> Symmetry | None:
    """By which a shape was its own image from end to end, and is no longer, although its ends are; or None.

    Args:
        q, q_new: (n, 4) frames before and after, at arc lengths that are symmetric.
        re: (3,) end position, L.
        f: (3,) load per length.
        most: how uneven the shape before may be, OUT or LEANT.
    """
    before, after = quaternion.tangents(q), quaternion.tangents(q_new)
    for kind, sign in ((REVERSED, 1.0), (TURNED, -1.0)):
        was, now = before + sign * before[::-1], after + sign * after[::-1]
        # reflected, all is along the chord; turned, all is along an axis across it
        axis = _axis(re[None]) if kind == REVERSED else _turned_about(now[0], after[0], re, f, was)
        askew = 0.0 if kind == REVERSED else abs(float(re @ axis))
        uneven = _off(was, _axis(was) if kind == REVERSED else axis)
        ends = max(_off(now[:1], axis), askew)
        if ends < PLANAR and uneven < most and _off(now, axis) > max(OUT, GROWS * uneven):
            return Symmetry(kind, axis)
    return None


def is_even(q: np.ndarray, re: np.ndarray) -> bool:
    """Whether a shape is its own image in any of these ways, nearly: nothing else makes it leave that.

    Args:
        q: (n, 4) frames, at arc lengths that are symmetric.
        re: (3,) end position, L.
    """
    n = quaternion.plane(q)
    if quaternion.out_of_plane(q, n) < NEARLY and abs(float(re @ n)) < NEARLY:
        return True
    tangents = quaternion.tangents(q)
    reflected, turned = tangents + tangents[::-1], tangents - tangents[::-1]
    return min(_off(reflected, _axis(re[None])), _off(turned, _axis(turned))) < NEARLY


def side_of(mesh: Mesh, q: np.ndarray) -> float:
    """How far the shape q (n, 4) on a mesh leads to SIDE, see `initial_shapes.side`."""
    return side(mesh.interpolate(q, GRID), GRID)


def _turned_about(
    apart: np.ndarray, begin: np.ndarray, re: np.ndarray, f: np.ndarray, was: np.ndarray
) -> np.ndarray:
    """(3,) axis of the half turn that swaps the ends, which know it, or the load, better than a shape.

    Args:
        apart, begin: (3,) tangent at the start, less that at the end and alone.
        re, f: (3,) end position, L, and load per length.
        was: (n, 3) tangents before less those from the other end: along the axis, if all three are parallel
            and there is no load. Near a fork these are uneven by 1e-5.
    """
    for v in (apart, np.cross(re, begin), f):
        if (axis := _axis(v[None])).any():
            return axis
    chord = _axis(re[None])
    return _axis(was - np.outer(was @ chord, chord))


def _axis(v: np.ndarray) -> np.ndarray:
    """Direction (3,) of the longest of v (k, 3); zero if none is longer than `PLANAR`."""
    longest = v[np.argmax(np.sum(v**2, axis=1))]
    size = float(np.linalg.norm(longest))
    return longest / size if size > PLANAR else np.zeros(3)


def _off(v: np.ndarray, axis: np.ndarray) -> float:
    """Largest part of v (k, 3) that is not along the `axis` (3,)."""
    return float(np.abs(v - np.outer(v @ axis, axis)).max())
