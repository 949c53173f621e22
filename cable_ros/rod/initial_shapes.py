# SPDX-License-Identifier: Apache-2.0
"""Shapes to start from: curves of the right length between the clamps, with frames of a chosen twist."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from cable_ros.compilation import LEAF, njit
from cable_ros.rod import quaternion

OPTIONS = {"cache": True, "error_model": "numpy"}

_U = np.linspace(0.0, 1.0, 129)
_HERMITE = np.stack([3 * _U**2 - 2 * _U**3, _U - 2 * _U**2 + _U**3, _U**3 - _U**2, 16 * (_U * (1 - _U)) ** 2])
_SLOPES = np.stack(
    [6 * _U - 6 * _U**2, 1 - 4 * _U + 3 * _U**2, 3 * _U**2 - 2 * _U, 32 * _U * (1 - _U) * (1 - 2 * _U)]
)


ASIDE = 3e-11
"""Rotation, rad, by which start shapes are turned aside: above rounding, below a whisper of weight."""
SIDE = np.array([-1.0, 3.0, 2.0]) / np.sqrt(14.0)
"""To which side of the start clamp's axes a cable goes of two that are alike: in no plane of symmetry that a
drawn scene has."""


def _unit(v: np.ndarray) -> np.ndarray:
    return v / np.linalg.norm(v)


def tangents(nodes: np.ndarray, qe: np.ndarray, re: np.ndarray, bulge: np.ndarray | None) -> np.ndarray:
    """Unit tangents (n, 3) at the arc lengths `nodes` of a Hermite curve of length 1 between the clamps.

    Its slack goes into the clamps' own directions, or sideways along `bulge` (3,).
    """
    end = quaternion.rotate(qe, np.array([0.0, 0.0, 1.0]))
    base = np.outer(_SLOPES[0], re)
    along = np.outer(_SLOPES[1], [0.0, 0.0, 1.0]) + np.outer(_SLOPES[2], end)
    if bulge is not None:
        base, along = base + 0.5 * along, np.outer(_SLOPES[3], bulge)
    square, product, other = ((a * b).sum(axis=1) for a, b in ((base, base), (base, along), (along, along)))
    low, high = 0.0, 8.0
    for _ in range(30):
        middle = 0.5 * (low + high)
        speed = np.sqrt(np.maximum(square + middle * (2.0 * product + middle * other), 0.0))
        length = (speed.sum() - 0.5 * (speed[0] + speed[-1])) / (len(_U) - 1)
        low, high = (middle, high) if length < 1.0 else (low, middle)
    slope = base + max(low, 1e-3) * along
    speed = np.linalg.norm(slope, axis=1)
    s = np.concatenate(([0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]))))
    u = np.interp(nodes, s / s[-1], _U)
    t = np.stack([np.interp(u, _U, slope[:, a]) for a in range(3)], axis=1)
    t[0], t[-1] = (0.0, 0.0, 1.0), end
    # where the curve nearly stops its tangent is no direction: keep the neighbour's
    size = np.linalg.norm(t, axis=1)
    for i in np.flatnonzero(size < 1e-9):
        t[i], size[i] = t[i - 1], 1.0
    return t / np.linalg.norm(t, axis=1, keepdims=True)


@njit(**OPTIONS)
def transport(t: np.ndarray) -> np.ndarray:
    """Twist-free frames (n, 4) along the unit tangents t (n, 3), from the identity."""
    q = np.empty((t.shape[0], 4))
    q[0, 0], q[0, 1], q[0, 2], q[0, 3] = 1.0, 0.0, 0.0, 0.0
    turn = np.empty(4)
    for i in range(1, t.shape[0]):
        a, b = t[i - 1], t[i]
        turn[0] = 1.0 + a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
        turn[1] = a[1] * b[2] - a[2] * b[1]
        turn[2] = a[2] * b[0] - a[0] * b[2]
        turn[3] = a[0] * b[1] - a[1] * b[0]
        size = _norm4(turn)
        if size < 1e-6:  # straight back: any axis across
            if abs(a[0]) < 0.7:
                turn[0], turn[1], turn[2], turn[3] = 0.0, 0.0, a[2], -a[1]
            else:
                turn[0], turn[1], turn[2], turn[3] = 0.0, -a[2], 0.0, a[0]
            size = _norm4(turn)
        for k in range(4):
            turn[k] /= size
        q[i, 0], q[i, 1], q[i, 2], q[i, 3] = quaternion.product(turn, q[i - 1])
    return q


@njit(**LEAF)
def _norm4(q):  # type: ignore[no-untyped-def]
    """Length of the quaternion q (4,)."""
    return np.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])


def closing_turn(q: np.ndarray, qe: np.ndarray) -> float:
    """Angle in (-pi, pi] about the tangent from the last of the frames q to the end clamp's frame."""
    d = quaternion.multiply(quaternion.conjugate(q[-1]), qe)
    return float((2.0 * np.arctan2(d[3], d[0]) + np.pi) % (2.0 * np.pi) - np.pi)


def spin(q: np.ndarray, nodes: np.ndarray, angle: float) -> np.ndarray:
    """The frames q turned about their tangents by `angle` times the arc length."""
    half = 0.5 * angle * nodes
    w, x, y, z = q.T
    c, s = np.cos(half), np.sin(half)
    return np.stack([w * c - z * s, x * c + y * s, y * c - x * s, z * c + w * s], axis=1)


def bulges(qe: np.ndarray, re: np.ndarray, f: np.ndarray) -> list[np.ndarray | None]:
    """Where the slack may go: the clamps' own directions, down, and four directions across the chord."""
    chord = re if np.linalg.norm(re) > 1e-6 else np.array([0.0, 0.0, 1.0])
    chord = _unit(chord)
    # the frame of the start clamp sets the directions across, so that the search moves with the rig
    helper = np.array([1.0, 0.0, 0.0]) if abs(chord[0]) < 0.8 else np.array([0.0, 1.0, 0.0])
    across = _unit(np.cross(chord, helper))
    other = np.cross(chord, across)
    out: list[np.ndarray | None] = [None]
    if np.linalg.norm(f) > 1e-9:
        out.append(_unit(f))
    return out + [across, -across, other, -other]


def unloaded(
    nodes: np.ndarray, qe: np.ndarray, natural: np.ndarray, target_twist: float | None
) -> Iterator[np.ndarray]:
    """Frames (n, 4) of the unloaded helix, turned evenly along it so that its end meets the end clamp.

    First the one whose twist is nearest to the target, then those with a turn more and less.
    """
    helix = np.array([_turn(s * natural) for s in nodes])
    rest = quaternion.rotation_vector(quaternion.multiply(quaternion.conjugate(helix[-1]), qe))
    closed = np.array([quaternion.multiply(q, _turn(s * rest)) for q, s in zip(helix, nodes, strict=True)])
    nearest = 0.0 if target_twist is None else np.round((target_twist - natural[2] - rest[2]) / (2.0 * np.pi))
    for turns in (nearest, nearest + 1, nearest - 1):
        yield spin(closed, nodes, 2.0 * np.pi * turns)


def _turn(v: np.ndarray) -> np.ndarray:
    """The quaternion of the rotation vector v."""
    angle = float(np.linalg.norm(v))
    return np.concatenate(([np.cos(0.5 * angle)], 0.5 * np.sinc(0.5 * angle / np.pi) * v))


def starts(
    nodes: np.ndarray,
    qe: np.ndarray,
    re: np.ndarray,
    f: np.ndarray,
    target_twist: float | None,
    natural: np.ndarray | None = None,
    taut: bool = False,
) -> Iterator[np.ndarray]:
    """Initial shapes of a search, (n, 4) frames each: every curve of `bulges` with two or three total twists.

    The twists of a curve between given clamps differ by whole turns. Those within about a turn of the target
    are taken, the nearest first. If the cable is naturally curved or taut, its `unloaded` shape comes first.

    Args:
        nodes: (n,) arc lengths, L.
        qe, re: end frame (4,) and end position (3,), L.
        f: (3,) load per length.
        target_twist: rad; None: the natural twist.
        natural: (3,) curvature and twist of the unloaded cable, 1 / L; None: straight.
        taut: whether the cable is nearly straight between its clamps.
    """
    natural = np.zeros(3) if natural is None else natural
    if taut or natural.any():
        yield from unloaded(nodes, qe, natural, target_twist)
    frames = [transport(tangents(nodes, qe, re, bulge)) for bulge in bulges(qe, re, f)]
    turns = []
    for rank, q in enumerate(frames):
        base = closing_turn(q, qe)
        centre = natural[2] if target_twist is None else target_twist
        nearest = base + 2.0 * np.pi * np.round((centre - base) / (2.0 * np.pi))
        turns_off = 1.1 if rank == 0 else 0.8  # the first curve with three twists, others with one or two
        for k in (-1, 0, 1):
            angle = nearest + 2.0 * np.pi * k
            if abs(angle - centre) <= 2.0 * np.pi * turns_off:
                turns.append((abs(k), rank, angle, q))
    turns.sort(key=lambda item: item[:2])
    for _, _, angle, q in turns:
        yield spin(q, nodes, angle)


def along(
    path: np.ndarray, nodes: np.ndarray, qe: np.ndarray, target_twist: float | None, natural: np.ndarray
) -> np.ndarray:
    """Frames (n, 4) along the string `path` (m, 3), those whose twist is nearest to the target twist."""
    parts = np.diff(path, axis=0)
    lengths = np.linalg.norm(parts, axis=1)
    middle = (np.cumsum(lengths) - 0.5 * lengths) / lengths.sum()
    directions = parts / lengths[:, None]
    t = np.stack([np.interp(nodes, middle, directions[:, a]) for a in range(3)], axis=1)
    t[0], t[-1] = (0.0, 0.0, 1.0), quaternion.rotate(qe, np.array([0.0, 0.0, 1.0]))
    q = transport(t / np.linalg.norm(t, axis=1, keepdims=True))
    base = closing_turn(q, qe)
    centre = natural[2] if target_twist is None else target_twist
    return spin(q, nodes, base + 2.0 * np.pi * np.round((centre - base) / (2.0 * np.pi)))


def aside(q: np.ndarray, nodes: np.ndarray, size: float = ASIDE) -> np.ndarray:
    """Frames q (n, 4) turned by `size`, rad, such that the cable bulges towards SIDE of each section's axes.

    A descent from a symmetric shape then takes a side that rounding cannot choose.
    """
    # tangents towards SIDE in the first half and back in the second: a bulge
    axis = np.array([-SIDE[1], SIDE[0], 0.0])
    wave = size * np.sin(2.0 * np.pi * nodes)[:, None] * axis
    out = np.empty_like(q)
    quaternion.retract(q, wave.ravel(), out)
    return out


def side(q: np.ndarray, nodes: np.ndarray) -> float:
    """How far the frames q (n, 4) at equal distances lead to SIDE: the cable's mean position, lengths."""
    w, x, y, z = q.T
    t = np.stack((2.0 * (x * z + w * y), 2.0 * (y * z - w * x), w * w - x * x - y * y + z * z), axis=1)
    return float(np.mean((1.0 - nodes) * (t @ SIDE)))
