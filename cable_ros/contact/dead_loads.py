# SPDX-License-Identifier: Apache-2.0
"""How a cable answers to given forces and couples at its contact points; see `contact.response`.

Friction between two cables is a load of each: a force at the contact point and a couple about its centreline.
Both follow the contact point along the cable. Units of the cable, start clamp's frame.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cable_ros.contact.points import ARC_LENGTH, ARM, FRICTION, OBSTACLE
from cable_ros.contact.response_kernels import displacements
from cable_ros.linalg.cross import cross, cross_matrix
from cable_ros.rod import quaternion
from cable_ros.rod.elements import Mesh, lagrange

LOADS = 6
"""Columns of a load: change of the force, and of the couple beyond what the turn of its section changes."""
ANSWERS = 12
"""Rows of a load: displacement and rotation of the section that stands at the contact point; the same of
another section, which is the one that touched before."""
BESIDE = -1e-9, 1e-9
"""L; a section between two elements is looked at from both."""


class DeadLoads(NamedTuple):
    """Given friction of k contact points."""

    points: np.ndarray
    """(k,) their numbers."""
    couples: np.ndarray
    """(k, 3) the present ones, EI / L."""
    turned: np.ndarray
    """(k, 3, 3n) derivative of the rotations of the sections there by the nodal rotations."""
    bent: np.ndarray
    """(k, 3, 3n) its derivative by the arc length, the mean of both sides."""
    moved: np.ndarray
    """(k, 3, 3n) derivative of their positions."""
    moved_before: np.ndarray
    """(k, 3, 3n) derivative of the positions of the sections that touched before."""
    turned_before: np.ndarray
    """(k, 3, 3n) derivative of their rotations."""

    def dragged(self, count: int) -> np.ndarray:
        """(count, 3n) what the couples pull at the nodes as their points move along the cable, per L."""
        out = np.zeros((count, self.bent.shape[2]))
        out[self.points] = np.einsum("ia,iaj->ij", self.couples, self.bent)
        return out

    def forces(self, columns: int) -> np.ndarray:
        """(k, 3, columns) change of each force by the motions, the last ones of which are the loads."""
        return self._own(0, columns)

    def by_couples(self, columns: int) -> np.ndarray:
        """(3n, columns) what the changes of the couples pull at the nodes."""
        out: np.ndarray = np.einsum("iaj,iak->jk", self.turned, self._own(3, columns))
        return out

    def answers(self, x: np.ndarray, shift: np.ndarray) -> np.ndarray:
        """(ANSWERS k, columns) of nodal rotations x (3n, columns) and motions of the start (3, columns)."""
        each = [
            self.moved @ x + shift, self.turned @ x, self.moved_before @ x + shift, self.turned_before @ x,
        ]  # fmt: skip
        return np.concatenate(each, axis=1).reshape(-1, x.shape[1])

    def _own(self, first: int, columns: int) -> np.ndarray:
        k = len(self.points)
        out = np.zeros((k, 3, columns))
        for i in range(k):
            at = columns - LOADS * (k - i) + first
            out[i, :, at : at + 3] = np.eye(3)
        return out

    @classmethod
    def of(
        cls, mesh: Mesh, shape: tuple[np.ndarray, ...], dchord: np.ndarray, points: np.ndarray,
        obstacles: np.ndarray, before: np.ndarray,
    ) -> DeadLoads:  # fmt: skip
        """Of the contact points on some obstacles.

        Args:
            mesh: of the rod.
            shape: of `contact_state.Shape`.
            dchord: of `rod_state.Tangents`.
            points: (m, COLUMNS) of `contact.points`.
            obstacles: (k,) their numbers.
            before: (k,) arc lengths of the sections that touched them before, L.
        """
        q = shape[0]
        which = np.array([int(np.flatnonzero(points[:, OBSTACLE] == one)[0]) for one in obstacles], int)
        arcs, both = points[which, ARC_LENGTH], np.concatenate([points[which, ARC_LENGTH], before])
        couples = np.empty((len(which), 3))
        for frame, i, couple in zip(mesh.interpolate(q, arcs), which, couples, strict=True):
            arm = quaternion.rotate(frame, points[i, ARM : ARM + 3])
            couple[:] = cross(arm, points[i, FRICTION : FRICTION + 3])
        moved, turn = np.empty((2, len(both), 3, 3 * len(q)))
        displacements(shape, dchord, both, 0.0, np.zeros((0, 0, 3)), moved, turn)
        sides = [rotations(mesh, q, np.clip(arcs + s, 0.0, 1.0)) for s in BESIDE]
        return cls(
            which, couples, rotations(mesh, q, arcs)[0], 0.5 * (sides[0][1] + sides[1][1]),
            moved[: len(arcs)], moved[len(arcs) :], rotations(mesh, q, before)[0],
        )  # fmt: skip


def rotations(mesh: Mesh, q: np.ndarray, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives (k, 3, 3n) of the rotations of sections by the nodal rotations, and theirs by s.

    With q = sum N_i q_i of any length, the rotation is 2 vec(dq q*) / |q|^2.

    Args:
        mesh: of the rod.
        q: (n, 4) nodal frames.
        s: (k,) arc lengths, L.
    """
    element, x = mesh.locate(s)
    N, slopes = lagrange(mesh.element.nodes, x)
    slopes = slopes / mesh.lengths[element][:, None]
    nodes = element[:, None] * mesh.element.order + np.arange(mesh.element.order + 1)[None, :]
    out, rate = np.zeros((2, len(s), 3, 3 * len(q)))
    for i, own in enumerate(nodes):
        here, along = N[i] @ q[own], slopes[i] @ q[own]
        size, change = here @ here, 2.0 * (here @ along)
        for j, node in enumerate(own):
            w, v = q[node, 0], q[node, 1:]
            turn = 0.5 * np.vstack([-v, w * np.eye(3) + cross_matrix(v)])  # of q_i by its rotation vector
            at = slice(3 * node, 3 * node + 3)
            a, b = _vector(here) @ turn, _vector(along) @ turn
            out[i, :, at] = 2.0 / size * N[i, j] * a
            rate[i, :, at] = 2.0 / size * (slopes[i, j] * a + N[i, j] * b) - change / size * out[i, :, at]
    return out, rate


def _vector(q: np.ndarray) -> np.ndarray:
    """(3, 4): the vector part of p q* is this times p."""
    return np.hstack([-q[1:, None], q[0] * np.eye(3) + cross_matrix(q[1:])])
