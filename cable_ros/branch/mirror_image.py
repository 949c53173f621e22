# SPDX-License-Identifier: Apache-2.0
"""The mirror image of an equilibrium in a scene with a plane of symmetry: a search may find only one."""

from __future__ import annotations

import numpy as np

from cable_ros.branch.cold_start import Conditions, Found, Sought, carried, conditions_of, same
from cable_ros.branch.end_for_end import end_for_end
from cable_ros.contact.nodal_rod import NodalRod
from cable_ros.contact.symmetry import GRID, GROWS, OUT, lost_symmetry, side_of
from cable_ros.rod import quaternion

SYMMETRIC = 1e-9
"""Maximum distance of what is in the plane of symmetry from it, L: rounding of the joint values."""
EVEN = 5e-4
"""Maximum twist asked for, rad, to which an equilibrium and its mirror image are equally near: a path's
rounding."""
SAME_SHAPE = 1e-6
"""Maximum difference of the frames of a shape that is its own mirror image."""
NEARLY = 0.1
"""The same of a shape beside a fork, as a fraction of `symmetry.OUT`: there rounding of the joints, 1e-12,
had put one out of its plane by 2e-5, which picked the side."""


def plane_of_symmetry(sought: Sought) -> np.ndarray | None:
    """(3,) unit normal of a plane that a clamped cable's ends, load and section are symmetric to; or None.

    In the start clamp's frame. The obstacles are not looked at: see `mirror_image`.
    """
    twisted = abs(sought.target_twist or 0.0) > EVEN
    if sought.compliance is not None or sought.ends is not None or twisted:
        return None
    conditions, stiffness = sought.conditions, sought.stiffness
    ends = quaternion.tangents(np.array([[1.0, 0.0, 0.0, 0.0], conditions.qe]))
    load = conditions.f / max(float(np.linalg.norm(conditions.f)), 1.0)
    _, sizes, axes = np.linalg.svd(np.vstack([ends, conditions.re, load]))
    n = axes[2]
    if sizes[2] > SYMMETRIC or sizes[1] < SYMMETRIC:
        return None  # no plane, or many
    isotropic = stiffness[0] == stiffness[1] or np.abs(n[:2]).min() < SYMMETRIC
    bent_along = np.linalg.norm(np.cross(sought.natural, n)) < SYMMETRIC
    image = reflected(conditions.qe[None], n)[0]
    turned = min(np.linalg.norm(image - conditions.qe), np.linalg.norm(image + conditions.qe))
    return n if isotropic and bent_along and turned < SYMMETRIC else None


def reflected(q: np.ndarray, n: np.ndarray) -> np.ndarray:
    """Frames (k, 4) reflected by the plane through the start clamp with unit normal n (3,): M R M.

    The start clamp's frame stays, since the sections are reflected, too.
    """
    return np.column_stack([q[:, 0], 2.0 * (q[:, 1:] @ n)[:, None] * n - q[:, 1:]])


def mirror_image(one: Found, n: np.ndarray) -> Found | None:
    """The mirror image of `one` by `plane_of_symmetry`; None if it is no equilibrium, or `one` itself."""
    image = _image(one, n)
    return None if image is None or same(image, one) else image


def _image(one: Found, n: np.ndarray) -> Found | None:
    """As `mirror_image`, also of one that is hardly out of the plane."""
    rod, q = one.rod, reflected(one.q, n)
    if np.abs(q - one.q).max() < SAME_SHAPE:
        return None
    if isinstance(rod, NodalRod):
        return _on_its_grid(rod, n)
    F = one.F - 2.0 * float(n @ one.F) * n
    return carried(rod, q, F, conditions_of(rod))


def by_rule(found: Found, shape: np.ndarray, uneven: float = OUT) -> tuple[Found, bool]:
    """An equilibrium to which a shape fell or went, or its image: that which leads more to `SIDE`.

    How that began must not pick one where the shape (65, 4), at GRID, is its own image; the second is whether
    that was so. With friction there is no choice, for the history has no symmetry.
    """
    rod = found.rod
    if rod.frictional or (isinstance(rod, NodalRod) and rod.state.tau.any()):
        return found, False
    n = plane_of_symmetry(Sought(rod.K, rod.natural, Conditions(rod.qe, rod.re, rod.f), None, SYMMETRIC))
    now = rod.mesh.interpolate(found.q, GRID)
    if n is not None and _leaves(shape, now, n, NEARLY * uneven):
        image = _image(found, n)
    else:
        lost = lost_symmetry(shape, now, rod.re, rod.f, uneven)
        image = None if lost is None else end_for_end(found, lost)
    if image is None:
        return found, False
    image.rod.work, image.rod.patience, image.rod.short = rod.work, rod.patience, rod.short
    here, there = (side_of(one.rod.mesh, one.q) for one in (found, image))
    return found if there < here else image, True


def _leaves(shape: np.ndarray, found: np.ndarray, n: np.ndarray, most: float) -> bool:
    """Whether a shape is its own image by the plane with normal n (3,), to `most`, and `found` is not.

    Both (65, 4), at GRID.
    """
    uneven = float(np.abs(reflected(shape, n) - shape).max())
    grown = float(np.abs(reflected(found, n) - found).max())
    return uneven <= most and (uneven <= SAME_SHAPE or grown > GROWS * uneven)


def _on_its_grid(rod: NodalRod, n: np.ndarray) -> Found | None:
    """The mirror image of the equilibrium of a rod on a grid of contacts; None if it is none."""
    assert rod.obstacles is not None
    across = np.eye(3) - 2.0 * np.outer(n, n)
    arc_lengths, _, _, forces, obstacles, _, _ = rod.contacts()
    image = NodalRod(rod.K, rod.natural, rod.obstacles, rod.cells, rod.coulomb, rod.compliance, rod.at)
    shape, end_force = reflected(rod.shape, n), across @ rod.end_force
    if not image.adopt(rod, shape, end_force, arc_lengths, forces @ across, obstacles):
        return None
    image.linearize(image.shape, image.end_force)
    return Found.at(image, image.shape, image.end_force)
