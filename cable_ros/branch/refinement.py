# SPDX-License-Identifier: Apache-2.0
"""Finer meshes for an equilibrium, until the estimated error of its wrenches meets the tolerance."""

from __future__ import annotations

import numpy as np

from cable_ros.branch.cold_start import Found, conditions_of, first_mesh, same, settle
from cable_ros.rod.elements import Mesh
from cable_ros.rod.kirchhoff import Rod

AIM, ACCEPT = 0.1, 0.45
"""Fractions of the tolerance: the error that a new mesh aims at, and the largest of a mesh that is kept."""
LENIENT = 1.6
"""Maximum misfit between contacts and elements of a mesh that is kept, over that of a new one; see
`ConstrainedRod.unresolved`."""
MOST_ELEMENTS = 2_000
"""Maximum number of elements of a mesh. Between clamps as far apart as the cable is long, tension has no
bound, nor has the mesh that it asks for."""
SHORT = 5e-3
"""Length of elements, L, without which an equilibrium is looked for if none is found on a mesh with them, or
if what the clamps bear is not known there."""
SLIVER = 1e-6
"""Length, L, of an element that nothing asks for."""
SHORTEST_ELEMENT = 1e-8
"""Length, L, of an element that is not halved any more: a cable that lies beside a clamp may leave the
surface 1e-6 of its length from it, and how both share what presses there is known where that is resolved."""
MOST_WORK = 200_000.0
"""Work after which no finer mesh is tried any more, iterations times unknowns: 0.3 s. Mostly it is 1,500."""


def on_mesh(found: Found, mesh: Mesh) -> Found | None:
    """The same equilibrium on another mesh; its work is that of the rod found, too."""
    mesh = found.rod.suited(mesh)
    q = found.rod.mesh.interpolate(found.q, mesh.nodes)
    q[0], q[-1] = found.q[0], found.q[-1]
    rod = found.rod.variant(mesh)
    rod.stay((found.q, found.rod.h.copy(), found.rod.s0.copy()))
    rod.work = found.rod.work
    one = settle(rod, q, found.F)
    found.rod.work = rod.work
    return one


def afresh(found: Found, tolerance: float) -> Found | None:
    """The same equilibrium on a mesh of its own, or None if another one is found there.

    A mesh that has followed contacts for long may be coarse where they come to next.
    """
    rod = found.rod
    conditions = conditions_of(rod)
    again = on_mesh(found, first_mesh(conditions, found.twist, tolerance))
    if again is None:
        return None
    fine, estimate = refine(again, tolerance)
    return fine if estimate <= tolerance and same(fine, found) else None


def better_mesh(rod: Rod, estimate: float, tolerance: float) -> Mesh:
    """The mesh whose elements have equal shares in an error of AIM * tolerance, by this order's rates.

    An element's share (energy norm squared, left by `Rod.wrench_error`) falls as its length^(2 order + 1).
    Where the rod lies with friction its elements are only divided: others would blur what friction remembers.
    """
    order = rod.mesh.element.order
    shares = np.maximum(rod.shares, 1e-12 * rod.shares.max() + 1e-300)
    gain = (AIM * tolerance / max(estimate, 1e-16)) ** (1.0 / (2 * order))
    size = rod.h * gain * (shares.mean() / shares) ** (1.0 / (2 * order + 1))
    size = np.clip(size, 0.25 * rod.h, 3.0 * rod.h)
    # sizes grow at most threefold from one element to the next
    for i in range(1, len(size)):
        size[i] = min(size[i], 3.0 * size[i - 1])
    for i in range(len(size) - 2, -1, -1):
        size[i] = min(size[i], 3.0 * size[i + 1])
    held, starts = rod.rubbed, np.append(rod.s0, 1.0)
    size[held] = np.minimum(size, rod.h)[held]
    edges = [0.0]
    for part in np.split(np.arange(len(size)), np.flatnonzero(held[1:] | held[:-1]) + 1):
        density = np.concatenate(([0.0], np.cumsum((rod.h / size)[part])))
        count = max(2 if len(part) == len(size) else 1, int(np.ceil(density[-1])))
        inner = np.linspace(0.0, density[-1], count + 1)
        edges += np.interp(inner, density, starts[part[0] : part[-1] + 2])[1:].tolist()
    return Mesh(rod.mesh.element, np.diff(edges))


def without_slivers(mesh: Mesh, least: float = SLIVER) -> Mesh:
    """The mesh with elements shorter than `least` joined to the one before: a contact that is gone left them.

    `better_mesh` would let its elements grow from theirs.
    """
    edges = np.concatenate([[0.0], np.cumsum(mesh.lengths)])
    kept = [0.0]
    for edge in edges[1:-1]:
        if edge - kept[-1] > least and edges[-1] - edge > least:
            kept.append(edge)
    return Mesh(mesh.element, np.diff([*kept, edges[-1]]))


def refine(found: Found, tolerance: float, accept: float = AIM * 2.0) -> tuple[Found, float]:
    """The equilibrium on a mesh with an error of at most `accept` * tolerance, or the best one; its error."""
    iterations, budget = found.iterations, found.rod.work
    rod = found.rod.for_tolerance(tolerance)
    if rod is not found.rod:
        closer = settle(rod, found.q, found.F)
        if closer is None:
            return found, np.inf
        found = closer
        iterations += closer.iterations
    estimate = found.rod.relative_error(found.q, found.F)
    found.rod.work = MOST_WORK
    joined = _without_short_elements(found, tolerance)
    if joined is not None:
        found, estimate = joined
        iterations += found.iterations
    tried = [(found, estimate)]
    for _ in range(8):
        unresolved = found.rod.unresolved(found.q)
        errors = found.rod.clamp_errors(found.q, found.F)
        for error, beside in zip(errors, found.rod.beside_clamps(), strict=True):
            unresolved[beside] |= error > ACCEPT * tolerance
        unresolved &= found.rod.mesh.lengths > SHORTEST_ELEMENT
        if unresolved.any() and estimate <= tolerance:
            mesh = found.rod.mesh.split(unresolved)
        elif estimate > accept * tolerance:
            mesh = better_mesh(found.rod, estimate, tolerance)
        else:
            break
        if len(mesh.lengths) > MOST_ELEMENTS:
            break
        finer = on_mesh(found, mesh)
        if finer is None and mesh.lengths.min() < SHORT and found.rod.work > 0.0:
            finer = on_mesh(found, without_slivers(mesh, SHORT))
        if finer is None and found.rod.work > 0.0:
            finer = on_mesh(found, found.rod.mesh.split(np.ones(len(found.rod.h), bool)))
        if finer is None:
            break
        iterations += finer.iterations
        new = finer.rod.relative_error(finer.q, finer.F)
        if new > 0.9 * estimate and new < 1e-9 and not unresolved.any():
            break  # rounding: no mesh does better
        found, estimate = finer, new
        tried.append((found, estimate))
        if found.rod.work <= 0.0:
            break
    left = found.rod.work
    if len(tried) > 1 and _largest_error(*tried[-1]) > tolerance:
        found, estimate = min(tried, key=lambda one: _largest_error(*one))
        found.rod.refactor(found.q, found.F)
    found.rod.work = budget - (MOST_WORK - left)
    return Found(found.rod, found.q, found.F, found.energy, found.twist, iterations), estimate


def _without_short_elements(found: Found, tolerance: float) -> tuple[Found, float] | None:
    """The same on a mesh without short elements, and its error, if that tells what the clamps bear.

    Ends of patches that come to lie up to a clamp leave such elements: in them rounding tells what a sample
    bears, and halving them does not help. None if what the clamps bear is known, or is not known so, either.
    """
    rod = found.rod
    if rod.h.min() > SHORT or rod.rubbed.any():
        return None
    if rod.clamp_errors(found.q, found.F).max() <= ACCEPT * tolerance:
        return None
    joined = on_mesh(found, without_slivers(rod.mesh, SHORT))
    if joined is None:
        return None
    error = joined.rod.relative_error(joined.q, joined.F)
    return (joined, error) if _largest_error(joined, error) <= ACCEPT * tolerance else None


def _largest_error(found: Found, estimate: float) -> float:
    """The larger of the `estimate` and the clamps' errors; inf where the cable sinks in."""
    rod = found.rod
    sinks = rod.unresolved(found.q, LENIENT).any()
    return np.inf if sinks else max(estimate, float(rod.clamp_errors(found.q, found.F).max()))
