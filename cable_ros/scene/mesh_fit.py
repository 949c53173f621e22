# SPDX-License-Identifier: Apache-2.0
"""Solids that enclose a mesh: a box, a cylinder, a capsule or a ball about each of a few parts of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import trimesh
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from cable_ros.compilation import njit
from cable_ros.scene.mesh_cover import Space, cover, solids_about
from cable_ros.scene.obstacles import Box, Capsule, Cylinder, Sphere
from cable_ros.scene.solids import Solid, distances, facing

VERSION = 1
"""Of what is found here: fits that an older one has kept are made again."""
MOST_SOLIDS = 8
SAMPLES = 30_000
"""Number of points that stand for a mesh's surface."""
AROUND, BEYOND = 12_000, 0.3
"""Number of points by which solids are compared, and how far they go beyond the mesh, middle extents."""
GOOD = 0.01
"""Relative to the mesh; a single solid that stands out by no more is good enough."""
COARSER = 2
"""Spacing of points to compare solids, relative to that to tell how good they are."""
SPACING = 100
"""Points of a solid's surface per length of the mesh."""
DIVISIONS = 5
"""How often triangles are divided that no solid encloses."""
ROUNDING = 1e-9
"""Relative; how much larger than what they enclose solids are made."""
SAME = 1e-6
"""Relative to the mesh; surfaces that are nearer to each other hide each other."""
NEIGHBOURS = 12
"""Number of triangles, those with the nearest samples, that are asked for the distance from a mesh."""


@dataclass(frozen=True, eq=False)
class Fit:
    """Solids for a mesh, in its frame."""

    solids: tuple[Solid, ...]
    outside: float
    """How far the solids stand out of the mesh, m: largest distance of a point of their surface."""
    bare: float
    """How far the mesh stands out of the solids, m; 0 but for rounding."""


def fit(mesh: trimesh.Trimesh) -> Fit:
    """Solids that together enclose a mesh: a single one if it fits well, or at most `MOST_SOLIDS`.

    They are those of `mesh_cover`, a little larger.
    """
    size = float(mesh.extents.max())
    surface = Surface(mesh)
    choices: list[list[Solid]] = [[one] for one in solids_about(np.array(mesh.vertices))]
    choices = [_enclosing(one, mesh.triangles, ROUNDING * size) for one in choices]
    out = [_standing_out(one, surface, COARSER * size / SPACING) for one in choices]
    solids, outside = choices[int(np.argmin(out))], min(out)
    if outside > GOOD * size:
        several = cover(surface.points, surface.space(mesh.bounds), MOST_SOLIDS)
        several = _enclosing(several, mesh.triangles, ROUNDING * size)
        if _standing_out(several, surface, COARSER * size / SPACING) < outside:
            solids = several
    outside = _standing_out(solids, surface, size / SPACING)
    bare = np.min([distances(solid, surface.points) for solid in solids], axis=0).max()
    return Fit(tuple(solids), outside, max(float(bare), 0.0))


def _enclosing(solids: Sequence[Solid], triangles: np.ndarray, rounding: float) -> list[Solid]:
    """The solids, each larger by as much as triangles (n, 3, 3) ask for that are in none of them.

    Triangles that several solids share are divided: what is left of them is in one, or nearly so.
    """
    growth = np.zeros(len(solids))
    for division in range(DIVISIONS + 1):
        far = np.array(
            [distances(solid, triangles.reshape(-1, 3)).reshape(-1, 3).max(axis=1) for solid in solids]
        )
        nearest, least = far.argmin(axis=0), far.min(axis=0)
        triangles, nearest, least = triangles[least > 0.0], nearest[least > 0.0], least[least > 0.0]
        if division < DIVISIONS:
            triangles = _divided(triangles)
        else:
            np.maximum.at(growth, nearest, least)
    return [_grown(solid, float(by) + rounding) for solid, by in zip(solids, growth, strict=True)]


def _divided(triangles: np.ndarray) -> np.ndarray:
    """(4 n, 3, 3) the triangles (n, 3, 3), each as four."""
    a, b, c = triangles.transpose(1, 0, 2)
    ab, bc, ca = 0.5 * (a + b), 0.5 * (b + c), 0.5 * (c + a)
    parts = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    return np.concatenate([np.stack(part, axis=1) for part in parts])


class Surface:
    """A mesh's surface, for distances from it; with holes, too."""

    def __init__(self, mesh: trimesh.Trimesh) -> None:
        samples, faces = trimesh.sample.sample_surface(mesh, SAMPLES, seed=0)
        corners = mesh.triangles.reshape(-1, 3)
        self.points = np.concatenate([np.asarray(samples), corners])
        self._faces = np.concatenate([faces, np.repeat(np.arange(len(mesh.faces)), 3)])
        self._triangles = np.array(mesh.triangles, dtype=float)
        self._tree = cKDTree(self.points)

    def space(self, bounds: np.ndarray) -> Space:
        """Points in and about the mesh, whose bounds are (2, 3)."""
        beyond = BEYOND * np.sort(bounds[1] - bounds[0])[1]
        points = np.random.default_rng(0).uniform(bounds[0] - beyond, bounds[1] + beyond, (AROUND, 3))
        return Space(points, self.outside(points))

    def outside(self, points: np.ndarray) -> np.ndarray:
        """How far points (n, 3) are outside the mesh, m, 0 inside; not too small but for points inside."""
        if not len(points):
            return np.zeros(0)
        _, near = self._tree.query(points, k=[*range(1, NEIGHBOURS + 1)])
        distance = np.full(len(points), np.inf)
        for column in near.T:
            closest = trimesh.triangles.closest_point(self._triangles[self._faces[column]], points)
            distance = np.minimum(distance, np.linalg.norm(points - closest, axis=1))
        return np.where(winding(self._triangles, points) > 0.5, 0.0, distance)


@njit(cache=True)
def winding(triangles, points):  # type: ignore[no-untyped-def]
    """(n,) how often triangles (m, 3, 3) wind round points (n, 3): 1 inside a mesh, also if it has holes.

    Jacobson et al. (2013), with the solid angle of a triangle by van Oosterom and Strackee (1983).
    """
    out = np.zeros(points.shape[0])
    v = np.empty((3, 3))
    for i in range(points.shape[0]):
        total = 0.0
        for k in range(triangles.shape[0]):
            lengths = 1.0
            size = np.empty(3)
            for j in range(3):
                for a in range(3):
                    v[j, a] = triangles[k, j, a] - points[i, a]
                size[j] = np.sqrt(v[j, 0] ** 2 + v[j, 1] ** 2 + v[j, 2] ** 2)
                lengths *= size[j]
            above = (
                v[0, 0] * (v[1, 1] * v[2, 2] - v[1, 2] * v[2, 1])
                + v[0, 1] * (v[1, 2] * v[2, 0] - v[1, 0] * v[2, 2])
                + v[0, 2] * (v[1, 0] * v[2, 1] - v[1, 1] * v[2, 0])
            )
            below = lengths
            for j in range(3):
                k1, k2 = (j + 1) % 3, (j + 2) % 3
                below += (v[j, 0] * v[k1, 0] + v[j, 1] * v[k1, 1] + v[j, 2] * v[k1, 2]) * size[k2]
            total += np.arctan2(above, below)
        out[i] = total / (2.0 * np.pi)
    return out


def _standing_out(solids: Sequence[Solid], surface: Surface, spacing: float) -> float:
    """How far points of the solids stand out of a mesh where no other solid hides them, m."""
    out = 0.0
    for k, solid in enumerate(solids):
        points = surface_points(solid, spacing)
        for i, other in enumerate(solids):
            if i != k:
                points = points[distances(other, points) > SAME * spacing * SPACING]
        out = max(out, float(surface.outside(points).max(initial=0.0)))
    return out


def surface_points(solid: Solid, spacing: float) -> np.ndarray:
    """(n, 3) points of a solid's surface, not farther apart than `spacing`, m."""
    if isinstance(solid, Box):
        lines = [np.linspace(-0.5, 0.5, int(np.ceil(edge / spacing)) + 1) * edge for edge in solid.size]
        faces = []
        for k in range(3):
            sides = [lines[i] if i != k else np.array([-0.5, 0.5]) * solid.size[k] for i in range(3)]
            faces.append(np.stack(np.meshgrid(*sides, indexing="ij"), axis=-1).reshape(-1, 3))
        turn = Rotation.from_quat(solid.orientation.copy()).as_matrix()
        return solid.center + np.concatenate(faces) @ turn.T
    radius, start, end = (
        solid.radius,
        *((solid.center,) * 2 if isinstance(solid, Sphere) else (solid.start, solid.end)),
    )
    length = float(np.linalg.norm(end - start))
    heights = np.linspace(0.0, length, int(np.ceil(length / spacing)) + 1)
    side = np.column_stack([np.full_like(heights, radius), heights])
    if isinstance(solid, Cylinder):
        out = np.linspace(0.0, radius, int(np.ceil(radius / spacing)) + 1)
        profile = np.concatenate(
            [np.column_stack([out, np.full_like(out, z)]) for z in (0.0, length)] + [side]
        )
    else:
        angles = np.linspace(0.0, 0.5 * np.pi, int(np.ceil(0.5 * np.pi * radius / spacing)) + 1)
        cap = radius * np.column_stack([np.cos(angles), np.sin(angles)])
        profile = np.concatenate([cap * [1.0, -1.0], side, cap + [0.0, length]])
    round_ = np.linspace(0.0, 2.0 * np.pi, int(np.ceil(2.0 * np.pi * radius / spacing)) + 1)[:-1]
    x, y = np.outer(profile[:, 0], np.cos(round_)), np.outer(profile[:, 0], np.sin(round_))
    own = np.stack([x, y, np.broadcast_to(profile[:, 1:], x.shape)], axis=-1).reshape(-1, 3)
    turn = facing((end - start) / length) if length else np.eye(3)
    return start + own @ turn.T


def _grown(solid: Solid, by: float) -> Solid:
    """The solid with its surface farther out by this length, m."""
    if isinstance(solid, Box):
        return Box(solid.center, solid.size + 2.0 * by, solid.orientation)
    if isinstance(solid, Sphere):
        return Sphere(solid.center, solid.radius + by)
    if isinstance(solid, Capsule):
        return Capsule(solid.start, solid.end, solid.radius + by)
    step = by * (solid.end - solid.start) / np.linalg.norm(solid.end - solid.start)
    return Cylinder(solid.start - step, solid.end + step, solid.radius + by)
