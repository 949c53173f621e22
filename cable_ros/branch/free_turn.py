# SPDX-License-Identifier: Apache-2.0
"""A round weightless cable between clamps in one line is free to turn about it: where it turns to.

It turns the shorter way, and where an obstacle is in that way it comes to rest on it.
"""

from __future__ import annotations

import numpy as np

from cable_ros.branch.cold_start import Conditions
from cable_ros.contact.clearance import clearance
from cable_ros.contact.report import coefficients
from cable_ros.contact.symmetry import GRID
from cable_ros.rod import quaternion
from cable_ros.rod.clamp_stiffness import clamp_response
from cable_ros.rod.initial_shapes import side
from cable_ros.rod.kirchhoff import Rod

IN_LINE = 1e-6
"""Maximum distance of what is in the line from it, L and rad: so far what is added to the Hessian holds the
cable where it is."""
FARTHEST = 0.01
"""The same of the end where turning is of second order in its motion."""
BESIDE = 5e-3
"""Distance of the end from the line, L and rad, at which places differ to second order."""
SLIGHT = 1e-9
"""Least work over force and motion that tells one place from another."""
FIRST_ORDER = 0.01
"""Maximum part of what is of first order in work that is to be of second order."""
HOLD = 1e-4
"""Part of the elastic stiffness that holds the cable where its clamp stiffness is computed."""
AS_FAR = 1e-3
"""Maximum difference of the ways to two places, rad, at which a rule chooses and not the way."""
LEAST_TURN = 0.01
"""Shortest turn, rad, after which it is looked whether an obstacle is in the way."""
REACH = 0.5
"""Maximum distance of a cable from the line, L, between clamps on it."""
INSIDE = 1e-6
"""Depth inside an obstacle, L, beyond that before, that is in the way."""


def place_to_turn_to(
    rod: Rod, q: np.ndarray, F: np.ndarray, conditions: Conditions
) -> tuple[np.ndarray, np.ndarray] | None:
    """The equilibrium to which one that turns freely turns as its end begins to move; None: not known.

    To first order the energy rises by what the end clamp does on the cable as it leaves the line. Turned by
    phi about that, the end wrench turns as well, so that this is A cos phi + B sin phi.

    Args:
        rod: at its equilibrium, factored.
        q, F: nodal frames (n, 4) and end force (3,) there.
        conditions: a little further along the path.

    Returns:
        Its nodal frames (n, 4) and end force (3,).
    """
    if not _turns_about_line(rod, IN_LINE):
        return None
    moment, motion = rod.reactions(), _off_line(conditions.qe, conditions.re)
    wrench = np.concatenate((F, moment))
    A, B = float(wrench @ motion), float(wrench @ _turned_back(motion))
    norm = np.linalg.norm
    if np.hypot(A, B) <= SLIGHT * (norm(F) * norm(motion[:3]) + norm(moment) * norm(motion[3:])):
        return None
    return _turned(rod, q, F, float(np.arctan2(-B, -A)))


def is_beside(rod: Rod, conditions: Conditions) -> bool:
    """Whether the end is so far from the line that second order counts, or nothing turns freely."""
    off = float(np.linalg.norm(_off_line(conditions.qe, conditions.re)))
    return off >= BESIDE or not _turns_about_line(rod, FARTHEST)


def places_beside(
    rod: Rod, q: np.ndarray, F: np.ndarray, conditions: Conditions
) -> list[tuple[np.ndarray, np.ndarray]]:
    """As `place_to_turn_to`, where to first order no place is better: an arch that moves across.

    Turned by phi, it sees the motion as if that were turned back. To second order the work is half of what
    the clamp stiffness makes of that, a multiple of cos 2 phi and sin 2 phi. Of its two minima the nearer one
    comes first, and where both are as far a rule chooses; none are known where the list is empty.
    """
    if not _turns_about_line(rod, FARTHEST):
        return []
    rod.linearize(q, F)
    rod.factor(HOLD)
    response = clamp_response(q, F, (rod.qe, rod.re, rod.f), rod.grid, rod.saddle)[6:, 6:]
    rod.refactor(q, F)
    stiffness = 0.5 * (response + response.T)
    motion = _off_line(conditions.qe, conditions.re)
    ways = np.array([motion, _turned_back(motion)])
    work = 0.5 * ways @ stiffness @ ways.T
    wrench = np.concatenate((F, rod.reactions())) - stiffness @ _off_line(rod.qe, rod.re)
    of_second_order = float(np.ptp(np.linalg.eigvalsh(work)))
    of_first_order = float(np.linalg.norm(ways @ wrench))
    if of_first_order > FIRST_ORDER * of_second_order or motion @ motion == 0.0:
        return []
    angle = 0.5 * float(np.arctan2(-2.0 * work[0, 1], work[1, 1] - work[0, 0]))
    places = [_turned(rod, q, F, one) for one in (angle, angle - np.copysign(np.pi, angle))]
    if 0.5 * np.pi - abs(angle) < AS_FAR:
        places.sort(key=lambda place: -side(rod.mesh.interpolate(place[0], GRID), GRID))
    return places


def _turns_about_line(rod: Rod, most: float) -> bool:
    """Whether it turns freely about the line of its clamps, off which its end is by `most` L or rad."""
    off = np.abs(np.concatenate((rod.re[:2], rod.qe[1:3]))).max()
    bent = np.abs(np.concatenate((rod.natural[:2], rod.f))).max()
    return bool(off <= most and bent <= IN_LINE and rod.K[0] == rod.K[1] and not rod.compliance.any())


def _off_line(qe: np.ndarray, re: np.ndarray) -> np.ndarray:
    """Motion and rotation (6,) across the line, L and rad, of an end frame (4,) and position (3,)."""
    spin, size = np.array([qe[0], 0.0, 0.0, qe[3]]), float(np.hypot(qe[0], qe[3]))
    spin = spin / size if size > 0.0 else np.array([1.0, 0.0, 0.0, 0.0])  # half a turn across: any will do
    back = quaternion.conjugate(spin)
    rotation = quaternion.rotation_vector(quaternion.multiply(back, qe))
    return np.array([re[0], re[1], 0.0, rotation[0], rotation[1], 0.0])


def _turned_back(motion: np.ndarray) -> np.ndarray:
    """A motion and rotation (6,) turned about the line by -90 degrees."""
    return np.array([motion[1], -motion[0], motion[2], motion[4], -motion[3], motion[5]])


def _turned(rod: Rod, q: np.ndarray, F: np.ndarray, angle: float) -> tuple[np.ndarray, np.ndarray]:
    """The frames (n, 4) and the end force (3,), turned about the line by an angle, rad, if they can."""
    angle = _as_far_as_clear(rod, q, angle)
    turn = np.array([np.cos(0.5 * angle), 0.0, 0.0, np.sin(0.5 * angle)])
    back = quaternion.conjugate(turn)
    turned = np.array([quaternion.multiply(quaternion.multiply(turn, one), back) for one in q])
    return turned, quaternion.rotate(turn, F)


def _as_far_as_clear(rod: Rod, q: np.ndarray, angle: float) -> float:
    """The angle, rad, or how far the frames q (n, 4) can be turned before an obstacle is in the way."""
    if rod.obstacles is None:
        return angle
    h, s0 = rod.mesh.lengths, rod.mesh.starts
    c = coefficients(q, h, rod.mesh.element)

    def room(turned: float, most: float = np.inf) -> float:
        cos, sin = np.cos(turned), np.sin(turned)
        about = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
        return float(clearance(c @ about.T, h, s0, rod.obstacles, most)[0])

    at, left = 0.0, room(0.0)
    deepest = min(left, 0.0) - INSIDE
    while at < abs(angle):
        further = min(at + max(left / REACH, LEAST_TURN), abs(angle))
        left = room(np.copysign(further, angle), REACH * np.pi)
        if left < deepest:
            return float(np.copysign(at, angle))
        at = further
    return angle
