"""Where a cable touches, as `Equilibrium.contacts` tells it: in the world, in SI units."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from cable_ros.equilibrium import Contact
from cable_ros.mechanics.effects.contact_kernels import position
from cable_ros.statics.touch_points import FORCE, FRICTION, HELD, LENGTH, OBSTACLE, PLACE
from cable_ros.statics.units import Units


def contacts(
    points: np.ndarray, normals: np.ndarray, curve: tuple[np.ndarray, np.ndarray, np.ndarray],
    coefficients: np.ndarray, names: Sequence[str], start: np.ndarray, units: Units,
) -> tuple[Contact, ...]:  # fmt: skip
    """The contact points in the world, by rising arc length.

    Args:
        points: (n, COLUMNS), see `touch_points`, with `normals` (n, 3), both in the start clamp's frame.
        curve: coefficients of the centreline, lengths and starts of the elements, see
            `contact_kernels.curve`.
        coefficients: of friction (obstacles,), zeros where it is left out.
        names: of the obstacles.
        start: (7,) the start clamp in the world, m, quaternion x y z w.
        units: of the cable.
    """
    turn = Rotation.from_quat(start[3:]).as_matrix()
    out = []
    r = np.empty(3)
    for point, normal in zip(points, normals, strict=True):
        friction, obstacle = point[FRICTION:HELD], int(point[OBSTACLE])
        position(*curve, point[PLACE], r)
        cone = coefficients[obstacle] * point[FORCE]
        out.append(
            Contact(
                obstacle=names[obstacle],
                arc_length=float(point[PLACE]) * units.length,
                position=start[:3] + units.length * turn @ r,
                normal=turn @ normal,
                force=units.force * turn @ (point[FORCE] * normal + friction),
                length=float(point[LENGTH]) * units.length,
                sliding=bool(cone > 0.0 and np.linalg.norm(friction) > (1.0 - 1e-9) * cone),
            )
        )
    return tuple(sorted(out, key=lambda contact: contact.arc_length))


def on_grid(
    touching: tuple[np.ndarray, ...], names: Sequence[str], start: np.ndarray, units: Units
) -> tuple[Contact, ...]:
    """The contacts of a `NodalRod` in the world, by rising arc length, each a point force.

    Args:
        touching: see `NodalRod.contacts`.
        names, start, units: as in `contacts`.
    """
    turn = Rotation.from_quat(start[3:]).as_matrix()
    return tuple(
        Contact(
            obstacle=names[o],
            arc_length=float(s) * units.length,
            position=start[:3] + units.length * turn @ r,
            normal=turn @ n,
            force=units.force * turn @ P,
            length=0.0,
            sliding=bool(slides),
        )
        for s, r, n, P, o, slides in zip(*touching, strict=True)
    )
