# SPDX-License-Identifier: Apache-2.0
"""The image of an equilibrium told from its other end, in a scene that is the same from there."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from cable_ros.branch.cold_start import Found, corrected
from cable_ros.contact.distance import gaps
from cable_ros.contact.points import ARC_LENGTH, FIRST, INTERFACE, KIND, LAST, OBSTACLE
from cable_ros.contact.symmetry import REVERSED, Symmetry
from cable_ros.contact.touching_rod import TouchingRod
from cable_ros.rod import quaternion
from cable_ros.rod.centreline import position
from cable_ros.rod.elements import Mesh

SAME, ALIKE = 1e-6, 1e-2
"""Maximum difference of the weight and the end frame from their images, and that of the end force, relative:
just beyond a fork the mesh matters as much."""


def end_for_end(one: Found, symmetry: Symmetry) -> Found | None:
    """The image of `one` by a reflection or half a turn that swaps its ends; None if it is no equilibrium."""
    rod, n = one.rod, symmetry.axis
    even = rod.K[0] == rod.K[1] and not rod.natural.any() and not rod.soft
    if not isinstance(rod, TouchingRod) or not (even and rod.count) or rod.frictional:
        return None
    if abs(float(n @ n) - 1.0) > SAME:
        return None  # the ends are at one place: no direction
    reflection = np.eye(3) - 2.0 * np.outer(n, n)
    # of the sections as well, whose tangents point the other way along the cable
    if symmetry.kind == REVERSED:
        image, sections = reflection, np.diag([1.0, 1.0, -1.0])
    else:
        image, sections = -reflection, np.diag([1.0, -1.0, -1.0])
    frames = image @ Rotation.from_quat(quaternion.to_ros(one.q[::-1])).as_matrix() @ sections
    q = quaternion.from_ros(Rotation.from_matrix(frames @ frames[0].T).as_quat())
    turns = np.concatenate(([q[0, 0]], np.sum(q[1:] * q[:-1], axis=1)))
    q *= np.cumprod(np.where(turns < 0.0, -1.0, 1.0))[:, None]  # along the cable no sign changes
    askew = min(np.linalg.norm(q[-1] - rod.qe), np.linalg.norm(q[-1] + rod.qe))
    weight = np.linalg.norm(image @ rod.f - rod.f) / max(float(np.linalg.norm(rod.f)), 1.0)
    if max(askew, weight) > SAME:
        return None
    F = -image @ rod.start_force(one.F)
    found = corrected(_other_way_round(rod, one.q, image), q, F)
    alike = found is not None and np.linalg.norm(found.F - F) < ALIKE * np.linalg.norm(F)
    return found if alike else None


def _other_way_round(rod: TouchingRod, q: np.ndarray, image: np.ndarray) -> TouchingRod:
    """The rod with its mesh and the contacts of the shape q (n, 4) told from the other end."""
    assert rod.obstacles is not None
    new = rod.variant(Mesh(rod.mesh.element, rod.mesh.lengths[::-1].copy()))
    new.count = rod.count
    new.points[: new.count] = rod.points[: rod.count]
    rod.trace(q)
    r = np.empty(3)
    for point in new.points[: new.count]:
        position(rod.c, rod.h, rod.s0, point[ARC_LENGTH], r)
        point[OBSTACLE] = int(np.argmin(np.abs(gaps(rod.obstacles, image @ (r - rod.re)))))
        point[ARC_LENGTH], point[INTERFACE] = 1.0 - point[ARC_LENGTH], -1.0
        point[KIND] = {FIRST: LAST, LAST: FIRST}.get(point[KIND], point[KIND])
    new.take_samples()
    return new
