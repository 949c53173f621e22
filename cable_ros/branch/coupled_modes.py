# SPDX-License-Identifier: Apache-2.0
"""Natural frequencies of pieces that turn and slide in the supports that they share; SI units.

A motion of the cable is the sum of two. In the first the sections in the supports stay, and each piece
vibrates between clamped ends. In the second the supports turn and pay out cable, and the pieces follow as if
that were slow. The second variation of the energy does not couple the two: that of the first is each piece's
own, that of the second is the tangent of the supports' equations, see `coupling`. The kinetic energy couples
them (Craig and Bampton, AIAA J. 6, 1968; here no mode is left out).

The kinetic energy is that of the material, so each piece is taken with the material that it has at rest. If a
support pays out the length da, the section that was in it moves by -v da, v the derivative of the position by
the unstretched length. It turns by -[kappa] da more than the section that is in the support afterwards.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from cable_ros.branch.coupling import END, LOOSE, PER, START, Ends, Loose
from cable_ros.branch.modes import Vibrating, displacements, followed, normalised
from cable_ros.equilibrium import Modes
from cable_ros.rod.units import Units
from cable_ros.rod.vibration import kernel, lowest, mass


class Piece(NamedTuple):
    """One piece between two supports."""

    own: Vibrating
    unit: Units
    density: float
    """Mass per length, kg/m."""
    start: np.ndarray
    """(7,) the section at its start in the world, m, quaternion x y z w."""


def coupled_modes(
    pieces: Sequence[Piece], ends: Sequence[Ends], K: np.ndarray, free: np.ndarray, count: int,
    places: Sequence[np.ndarray], loose: Sequence[Loose] = (),
) -> Modes:  # fmt: skip
    """The `count` lowest modes of n + 1 pieces; their shapes at the `places`, piece by piece.

    Args:
        pieces, ends: from the first to the last.
        K: (k, k) derivative of the supports' equations by their free unknowns.
        free: (N,) which unknowns of the supports these are.
        count: of modes.
        places: arc lengths on each piece, as fractions of its length.
        loose: its loose ends.

    Raises:
        LinAlgError: the equilibrium is not stable, or a piece cannot follow its supports.
    """
    bases, hessians, masses = [], [], []
    for i, piece in enumerate(pieces):
        own, Z = piece.own, kernel(piece.own.rows)
        motions = _mount_motions(ends[i], i, len(pieces), piece.unit.length, loose)
        bases.append((Z, followed(own, Z, motions[:, free])))
        hessians.append(piece.unit.moment * (Z.T @ own.H @ Z))
        masses.append(piece.density * piece.unit.length**3 * mass(own.moved))
    cuts = np.cumsum([0, *(len(H) for H in hessians)]).tolist()
    blocks, shared = [slice(a, b) for a, b in itertools.pairwise(cuts)], slice(cuts[-1], None)
    H, M = np.zeros((2, cuts[-1] + len(K), cuts[-1] + len(K)))
    H[shared, shared] = 0.5 * (K + K.T)
    for (Z, follows), own, own_mass, at in zip(bases, hessians, masses, blocks, strict=True):
        H[at, at] = own
        M[at, at] = Z.T @ own_mass @ Z
        M[at, shared] = Z.T @ own_mass @ follows
        M[shared, at] = M[at, shared].T
        M[shared, shared] += follows.T @ own_mass @ follows
    omega, vectors = lowest(H, M, count)
    shapes = []
    for piece, (Z, follows), at, where in zip(pieces, bases, blocks, places, strict=True):
        unknowns = piece.unit.length * (Z @ vectors[at] + follows @ vectors[shared])
        shapes.append(displacements(piece.own.moved, unknowns, where, piece.start))
    return Modes(omega / (2.0 * np.pi), normalised(np.concatenate(shapes, axis=1)))


def _mount_motions(ends: Ends, i: int, count: int, length: float, loose: Sequence[Loose]) -> np.ndarray:
    """(12, N) motions of the sections at both ends of piece i by the unknowns of the supports.

    Args:
        ends: of the piece.
        i, count: its number, and the number of pieces.
        length: its length, m.
        loose: the loose ends.
    """
    out = np.zeros((12, PER * (count - 1) + LOOSE * len(loose)))
    for k, end in enumerate(loose):
        if i == end.which * (count - 1):
            at = PER * (count - 1) + LOOSE * k
            rows = END if end.which else START
            out[rows, at : at + LOOSE] = end.motion / np.repeat([length, 1.0], 3)[:, None]
    for which, j in enumerate((i - 1, i)):
        if 0 <= j < count - 1:
            at, first = PER * j, 6 * which
            out[first : first + 3, at + 3] = -ends.strains[which] / length
            out[first + 3 : first + 6, at : at + 3] = np.eye(3)
            out[first + 3 : first + 6, at + 3] = -ends.curvatures[which]
    return out
