# SPDX-License-Identifier: Apache-2.0
"""Continuation of an equilibrium in the cable's properties, from the old ones to the new ones."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cable_ros.branch import handover
from cable_ros.contact.nodal_rod import NodalRod
from cable_ros.contact.shearing_rod import among_obstacles
from cable_ros.contact.touching_rod import TouchingRod
from cable_ros.rod import warm_step
from cable_ros.rod.extensible import StretchingRod
from cable_ros.rod.kirchhoff import Rod

LARGEST = 0.3
"""Maximum change of a stiffness's logarithm in one step."""
SMALLEST = 1e-3
"""Minimum step, as a fraction of the change; if it fails, the branch ends."""


@dataclass(frozen=True, eq=False)
class Section:
    """Properties and load of a rod, in the cable's units and the start clamp's frame."""

    stiffness: np.ndarray
    """(3,) of bending and torsion."""
    natural: np.ndarray
    """(3,) curvature and twist of the unloaded cable."""
    load: np.ndarray
    """(3,) per length."""
    compliance: np.ndarray | None = None
    """(3,) of shear and axial strain; None: inextensible and unshearable."""


def between(a: Section, b: Section, t: float) -> Section:
    """Interpolate from a to b, 0 <= t <= 1: stiffness geometrically, all else linearly."""
    return Section(
        a.stiffness ** (1.0 - t) * b.stiffness**t if t < 1.0 else b.stiffness,
        (1.0 - t) * a.natural + t * b.natural,
        (1.0 - t) * a.load + t * b.load,
        None if a.compliance is b.compliance is None else (1.0 - t) * _soft(a) + t * _soft(b),
    )


def _soft(section: Section) -> np.ndarray:
    return np.zeros(3) if section.compliance is None else section.compliance


def with_section(rod: Rod, section: Section, scale: float = 1.0) -> Rod:
    """A rod with the section, on the same mesh between the same clamps; `scale` as in `follow`."""
    soft = section.compliance is not None and section.compliance.any()
    if isinstance(rod, NodalRod):
        compliance = _soft(section)
        new: Rod = rod.variant(None, section.stiffness, section.natural, scale, compliance)
    elif isinstance(rod, TouchingRod) and (soft or rod.soft):
        new = _touching(rod, section, scale)
    elif section.compliance is not None and soft:
        new = StretchingRod(rod.mesh, section.stiffness, section.natural, section.compliance)
    elif rod.soft:
        new = Rod(rod.mesh, section.stiffness, section.natural)
    else:
        new = rod.variant(stiffness=section.stiffness, natural=section.natural, scale=scale)
    new.set_conditions(rod.qe, rod.re, section.load, rod.obstacles)
    return new


def _touching(rod: TouchingRod, section: Section, scale: float) -> TouchingRod:
    """`with_section` of a rod among obstacles that stretches before or after."""
    one = rod.mesh, section.stiffness, section.natural
    new = among_obstacles(*one, section.compliance, rod.tolerance, rod.density)
    new.set_conditions(rod.qe, rod.re, section.load, rod.obstacles)
    new.take_contacts(rod, scale)
    return new


def follow(
    rod: Rod, q: np.ndarray, F: np.ndarray, target: Section, scale: float, tolerance: float
) -> tuple[Rod, np.ndarray, np.ndarray] | None:
    """Continue the equilibrium (q, F) of a rod to the target at fixed clamps; None if the branch ends before.

    `scale` is the new unit of force over the old one. The rod itself does not change. One that touches and
    will shear goes onto a grid of contacts first, and so does one that the shear makes touch.
    """
    shears = target.compliance is not None and bool(target.compliance[:2].any())
    on_contacts = shears and isinstance(rod, TouchingRod)
    if not (on_contacts and rod.touches):
        found = _follow(rod, q, F, target, scale, tolerance)
        if found is not None or not on_contacts:
            return found
    on_grid = handover.nodal(rod, q, F, always=True)
    if on_grid is None:
        return None
    return _follow(on_grid, on_grid.shape, on_grid.end_force, target, scale, tolerance)


def _follow(
    rod: Rod, q: np.ndarray, F: np.ndarray, target: Section, scale: float, tolerance: float
) -> tuple[Rod, np.ndarray, np.ndarray] | None:
    """`follow` on one kind of rod."""
    soft = rod.compliance * scale if rod.soft else None
    before = Section(rod.K / scale, rod.natural, rod.f / scale, soft)
    F = F / scale
    logarithm = float(np.abs(np.log(target.stiffness / before.stiffness)).max())
    last = rod.variant(scale=scale)
    at, step = 0.0, min(1.0, LARGEST / max(logarithm, 1e-300))
    while at < 1.0:
        to = min(1.0, at + step)
        here, there = between(before, target, at), between(before, target, to)
        new = with_section(last, there)
        new.set_conditions(rod.qe, rod.re, here.load, rod.obstacles)
        if new.refactor(q, F):
            code, iterations, q_new, F_new = new.advance(
                q, F, rod.qe, rod.re, there.load, tolerance, 0.35, rod.obstacles
            )
            if code == warm_step.ADVANCED:
                at, q, F, last = to, q_new, F_new, new
                if at == 1.0:
                    return new, q, F
                if iterations <= 4:
                    step *= 2.0
                step = min(step, LARGEST / max(logarithm, 1e-300))
                continue
        step *= 0.5
        if step < SMALLEST:
            return None
    return None
