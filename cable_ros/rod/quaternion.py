# SPDX-License-Identifier: Apache-2.0
"""Compiled quaternion arithmetic, scalar first; for ROS's x y z w see `from_ros`."""

from __future__ import annotations

import math

import numpy as np

from cable_ros.compilation import LEAF, LEAF_ENTRY, njit

OPTIONS = {"cache": True, "error_model": "numpy"}


@njit(**OPTIONS)
def multiply(a, b):
    """The product a b of two quaternions (4,)."""
    c = np.empty(4)
    c[0], c[1], c[2], c[3] = product(a, b)
    return c


@njit(**LEAF)
def product(a, b):
    """`multiply` of arrays or tuples, as a tuple."""
    return (
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    )


@njit(**OPTIONS)
def conjugate(a):
    """The inverse of a unit quaternion (4,)."""
    c = np.empty(4)
    c[0], c[1], c[2], c[3] = a[0], -a[1], -a[2], -a[3]
    return c


@njit(**OPTIONS)
def rotate(q, v):
    """The vector v (3,) turned by the unit quaternion q."""
    out = np.empty(3)
    out[0], out[1], out[2] = turned(q, v)
    return out


@njit(**LEAF)
def turned(q, v):
    """`rotate` of arrays or tuples, as a tuple."""
    x, y, z = q[1], q[2], q[3]
    a = 2.0 * (y * v[2] - z * v[1])
    b = 2.0 * (z * v[0] - x * v[2])
    c = 2.0 * (x * v[1] - y * v[0])
    return (
        v[0] + q[0] * a + y * c - z * b,
        v[1] + q[0] * b + z * a - x * c,
        v[2] + q[0] * c + x * b - y * a,
    )


@njit(**LEAF_ENTRY)
def largest_rotation(before, after):
    """Largest rotation, rad, of frames between two shapes (n, 4) that are near each other."""
    out = 0.0
    for i in range(before.shape[0]):
        for a in range(4):
            out = max(out, 2.0 * abs(after[i, a] - before[i, a]))
    return out


@njit(**OPTIONS)
def rotation_vector(q):
    """The rotation vector (3,) of q, of length at most pi."""
    out = np.empty(3)
    out[0], out[1], out[2] = turn(q)
    return out


@njit(**LEAF)
def turn(q):
    """`rotation_vector` of an array or tuple, as a tuple."""
    s = np.sqrt(q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    scale = 2.0
    if s > 1e-12:
        scale = 2.0 * np.arctan2(s, abs(q[0])) / s
    if q[0] < 0.0:
        scale = -scale
    return scale * q[1], scale * q[2], scale * q[3]


@njit(**LEAF_ENTRY)
def retract(q, psi, out):
    """out = q exp(psi / 2), normalised, row by row of q (n, 4); psi (3n,): rotations in the section frame."""
    for i in range(q.shape[0]):
        a, b, c = 0.5 * psi[3 * i], 0.5 * psi[3 * i + 1], 0.5 * psi[3 * i + 2]
        angle2 = a * a + b * b + c * c
        if angle2 < 1e-4:
            s = 1.0 - angle2 / 6.0 * (1.0 - angle2 / 20.0 * (1.0 - angle2 / 42.0))
            r = 1.0 - angle2 / 2.0 * (1.0 - angle2 / 12.0 * (1.0 - angle2 / 30.0))
        else:
            angle = np.sqrt(angle2)
            s = np.sin(angle) / angle
            r = np.cos(angle)
        a, b, c = s * a, s * b, s * c
        w, x, y, z = q[i, 0], q[i, 1], q[i, 2], q[i, 3]
        o0 = w * r - x * a - y * b - z * c
        o1 = w * a + x * r + y * c - z * b
        o2 = w * b - x * c + y * r + z * a
        o3 = w * c + x * b - y * a + z * r
        n = 1.0 / np.sqrt(o0 * o0 + o1 * o1 + o2 * o2 + o3 * o3)
        out[i, 0], out[i, 1], out[i, 2], out[i, 3] = n * o0, n * o1, n * o2, n * o3


@njit(**OPTIONS)
def matrices_from_ros(q):
    """The rotation matrices (n, 3, 3) of unit quaternions x y z w, the rows of q (n, 4)."""
    out = np.empty((q.shape[0], 3, 3))
    for i in range(q.shape[0]):
        x, y, z, w = q[i, 0], q[i, 1], q[i, 2], q[i, 3]
        out[i, 0, 0] = 1.0 - 2.0 * (y * y + z * z)
        out[i, 0, 1] = 2.0 * (x * y - z * w)
        out[i, 0, 2] = 2.0 * (x * z + y * w)
        out[i, 1, 0] = 2.0 * (x * y + z * w)
        out[i, 1, 1] = 1.0 - 2.0 * (x * x + z * z)
        out[i, 1, 2] = 2.0 * (y * z - x * w)
        out[i, 2, 0] = 2.0 * (x * z - y * w)
        out[i, 2, 1] = 2.0 * (y * z + x * w)
        out[i, 2, 2] = 1.0 - 2.0 * (x * x + y * y)
    return out


def matrix_from_ros(q: np.ndarray) -> np.ndarray:
    """The rotation matrix (3, 3) of the quaternion x y z w, q (4,), which may be any but zero."""
    parts = [float(part) for part in q]
    size = math.sqrt(sum(part**2 for part in parts))
    x, y, z, w = (part / size for part in parts)
    return np.array(
        [
            [x * x - y * y - z * z + w * w, 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
            [2.0 * (x * y + z * w), -x * x + y * y - z * z + w * w, 2.0 * (y * z - x * w)],
            [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), -x * x - y * y + z * z + w * w],
        ]
    )


def from_ros(q: np.ndarray) -> np.ndarray:
    """x y z w to w x y z."""
    return np.roll(np.asarray(q, float), 1, axis=-1)


def to_ros(q: np.ndarray) -> np.ndarray:
    """w x y z to x y z w."""
    return np.roll(q, -1, axis=-1)


def tangents(q: np.ndarray) -> np.ndarray:
    """(n, 3): third columns of the frames q (n, 4)."""
    w, x, y, z = q.T
    return np.stack((2.0 * (x * z + w * y), 2.0 * (y * z - w * x), w * w - x * x - y * y + z * z), axis=1)


def between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The shortest rotation (4,) that takes the unit vector a to the unit vector b."""
    out = np.concatenate(([1.0 + a @ b], np.cross(a, b)))
    size = float(np.linalg.norm(out))
    if size < 1e-6:  # straight back: any axis across
        out = np.concatenate(([0.0], np.cross(a, np.eye(3)[np.argmin(np.abs(a))])))
        size = float(np.linalg.norm(out))
    return out / size


def slerp(a: np.ndarray, b: np.ndarray, t: float) -> np.ndarray:
    """The unit quaternion at the fraction t of the shortest rotation from a to b, unit quaternions."""
    out = np.empty((1, 4))
    retract(a[None, :], t * rotation_vector(multiply(conjugate(a), b)), out)
    return out[0]


def plane(q: np.ndarray) -> np.ndarray:
    """Unit normal (3,) of the plane in which frames q (n, 4) turn farthest; zero if they do not turn.

    The frame of the start clamp is the identity.
    """
    farthest = q[np.argmax(np.sum(q[:, 1:] ** 2, axis=1)), 1:]
    size = float(np.linalg.norm(farthest))
    return farthest / size if size > 1e-6 else np.zeros(3)


def out_of_plane(q: np.ndarray, n: np.ndarray) -> float:
    """Half the largest angle, rad, by which frames q (n, 4) turn out of the plane with normal n (3,)."""
    return float(np.abs(q[:, 1:] - np.outer(q[:, 1:] @ n, n)).max())
