# SPDX-License-Identifier: Apache-2.0
"""Claimed contacts, checked against the obstacles' definitions and against the rod's own balance."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from cable_ros.bench import shooting
from cable_ros.bench.shooting import Touch
from cable_ros.bench.surfaces import Derivatives, Distance, curvature, derivatives, distance, gradient
from cable_ros.bench.verification import Rod, Verification, bend_layer, verify
from cable_ros.equilibrium import Contact, Equilibrium
from cable_ros.scene import Scene
from cable_ros.scene.kinematics import Kinematics

DEPTH = 1e-6
"""What a cable may be inside an obstacle, parts of its length."""
GRID_DEPTH = 0.01
"""The same over the estimated error of the end wrench, where that is more."""
STRETCH = 0.02
"""Forces nearer to each other than this, parts of the length, are summed."""
CELL = 4e-3
"""Pressure is made of forces so near to each other, parts of the length."""
LAYER = 0.1
"""And no farther apart than this part of the bends that a taut cable has where it is pushed."""
BESIDE = 0.6
"""Points of a Gauss rule side by side are nearer to each other than this part of their lengths together."""
FIRST = 0.4
"""Distance of such a rule's first point from its beginning, parts of the point's length."""
RULES = range(3, 9)
"""Numbers of points of a Gauss rule."""
SYMMETRIC = 1e-6
"""Accuracy of a Gauss rule's places and lengths, parts of its own length."""
CLAMP = 0.015
"""What presses nearer to a clamp than this does not hold the rod there."""
ROUNDS = 8
"""In which surfaces that pull let go."""
NOTHING = 1e-6
"""A force that is smaller, EI / L^2, counts as none."""
ROUNDING = 1e-6
"""Of directions, and of forces relative to the largest."""
ACROSS = 0.01
"""What friction by (53) may be off, parts of mu times the normal force: tangents are of the polyline."""
CLEARLY = 0.5
"""Of the end's motion, that part across the cable that leaves no doubt to which side it is."""


@dataclass(frozen=True)
class Surface:
    """An obstacle as one cable meets it at one pose."""

    signed: Distance
    friction: float
    solid: bool = True
    """Whether nothing of the cable may be inside; not of its own other strand."""
    derivatives: Derivatives | None = None
    """Of the distance; without them differences."""


def surfaces(scene: Scene, kinematics: Kinematics, joints: np.ndarray, radius: float) -> dict[str, Surface]:
    """All obstacles of a scene by name, for a cable of `radius`."""
    if not scene.obstacles:
        return {}
    links = kinematics.obstacle_poses(joints)
    return {
        obstacle.name: Surface(
            distance(obstacle, links[i], radius),
            obstacle.friction,
            derivatives=derivatives(obstacle, links[i], radius),
        )
        for i, obstacle in enumerate(scene.obstacles)
    }


def grid_error(claim: Equilibrium) -> float:
    """Estimated error of contacts on a grid; of an answer that only friction's path makes uncertain, 0."""
    return 0.0 if "followed in steps" in claim.message else claim.error_estimate


def touches(rod: Rod, met: Mapping[str, Surface], claim: Equilibrium, fineness: int = 1) -> list[Touch]:
    """The claimed contacts as verification takes them; pressure as many forces side by side.

    `fineness`: how many times as many as mostly.
    """
    length = rod.length
    unit = rod.force_unit
    cell = min(CELL * length, LAYER * bend_layer(rod, claim)) / fineness

    def surface(one: Surface):  # type: ignore[no-untyped-def]
        def at(r: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
            points = rod.start[:3] + r * length
            if one.derivatives is not None:
                normals, bends = one.derivatives(points)
            else:
                step = 1e-6 * length
                normals, bends = gradient(one.signed, points, step), curvature(one.signed, points, step)
            return one.signed(points) / length, normals, bends * length

        return at

    out = []
    for name in dict.fromkeys(contact.obstacle for contact in claim.contacts):
        mine = sorted((c for c in claim.contacts if c.obstacle == name), key=lambda c: c.arc_length)
        at = surface(met[name])
        points = [(c.arc_length, c.normal_force, c.friction) for c in mine if c.length == 0.0]
        for place, normal_force, friction in points:
            out.append(Touch(place / length, at, normal_force / unit, friction / unit))
        for place, normal_force in spread(mine, cell):
            # the clamp itself holds what is next to it
            holds = CLAMP < place / length < 1.0 - CLAMP
            out.append(Touch(place / length, at, normal_force / unit, np.zeros(3), holds, slides=False))
        # friction remembers: it need not be smooth, and is taken as it is reported
        pressing = [c for c in mine if c.length > 0.0 and c.friction.any()]
        out += [Touch(c.arc_length / length, at, 0.0, c.friction / unit, False, False) for c in pressing]
    return out


def spread(contacts: Sequence[Contact], cell: float) -> list[tuple[float, float]]:
    """Place, m, and normal force, N, of many forces that make up the pressure on one obstacle.

    Between the contacts that have a length it is interpolated, in each Gauss rule by itself, whose sum stays
    its own: beside a fine mesh, which hardly knows its pressure, a coarse one keeps what it has, and nothing
    is made up for next to a clamp, whose own force it would change. The forces are at most `cell`, m, apart.
    """
    out: list[tuple[float, float]] = []
    points = [c.arc_length for c in contacts if c.length == 0.0]
    pressing = [(c.arc_length, c.length, c.normal_force) for c in contacts if c.length > 0.0]
    places, lengths, forces = np.array(pressing).reshape(-1, 3).T
    groups = _groups(places, lengths, points)
    begins = [low for _, low in groups[1:]]
    reached = 0.0
    for (which, low), following in zip(groups, [*begins, None], strict=False):
        s, length, pressure = places[which], lengths[which], forces[which] / lengths[which]
        total = float(length.sum())
        if low is None:
            near = [p for p in [reached, *points] if 0.0 <= s[0] - p < length[0]]
            after = [p for p in [*points, following] if p is not None and 0.0 <= p - s[-1] < length[-1]]
            # where the cable has lifted off beside one end, the pressure reaches to the other
            alone = s[0] - FIRST * length[0]
            low = max(near, default=min(after) - total if after else alone)
        else:
            slopes = np.diff(pressure)[[0, -1]] / np.diff(s)[[0, -1]]
            ends = np.array([low, low + total])
            at_ends = pressure[[0, -1]] + slopes * (ends - s[[0, -1]])
            s, pressure = np.insert(ends, 1, s), np.insert(at_ends, 1, pressure)
        cells = max(len(length), math.ceil(total / cell))
        at = low + total * (np.arange(cells) + 0.5) / cells
        mine = np.interp(at, s, pressure) * total / cells
        mine += (forces[which].sum() - mine.sum()) / cells
        out += list(zip(at.tolist(), mine.tolist(), strict=True))
        reached = low + total
    return out


def _groups(
    places: np.ndarray, lengths: np.ndarray, points: Sequence[float]
) -> list[tuple[slice, float | None]]:
    """Samples whose pressure is interpolated together: Gauss rules, with their beginnings, and what is left.

    Of the latter those side by side; nothing is interpolated across `points` of contact.
    """
    out: list[tuple[slice, float | None]] = []
    i = 0
    while i < len(places):
        rules = [slice(i, i + k) for k in RULES if i + k <= len(places)]
        begun = ((rule, _beginning(places[rule], lengths[rule])) for rule in rules)
        whole = next((one for one in begun if one[1] is not None), None)
        if whole is not None:
            out.append(whole)
            i = whole[0].stop
            continue
        beside = i > 0 and places[i] - places[i - 1] < BESIDE * (lengths[i - 1] + lengths[i])
        parted = beside and any(places[i - 1] < p < places[i] for p in points)
        if out and out[-1][1] is None and beside and not parted:
            out[-1] = slice(out[-1][0].start, i + 1), None
        else:
            out.append((slice(i, i + 1), None))
        i += 1
    return out


def _beginning(places: np.ndarray, lengths: np.ndarray) -> float | None:
    """Where a Gauss rule of these points begins; None if they are none.

    Its points are symmetric, each inside what it stands for, and the first and the last stand for the least.
    """
    total = float(lengths.sum())
    middle = float(lengths @ places) / total
    off = np.abs([places + places[::-1] - 2.0 * middle, lengths - lengths[::-1]]).max()
    ends = middle - 0.5 * total + np.cumsum(lengths)
    inside = np.all((ends - lengths < places) & (places < ends))
    rule = off < SYMMETRIC * total and inside and np.all(lengths[[0, -1]] < lengths[[1, -2]])
    return middle - 0.5 * total if rule else None


def contact_fault(rod: Rod, met: Mapping[str, Surface], claim: Equilibrium) -> str | None:
    """What is wrong with the claimed contacts as they are reported: place, direction, pull, cone, depth."""
    largest = max((float(np.linalg.norm(contact.force)) for contact in claim.contacts), default=0.0)
    for contact in claim.contacts:
        where = f"contact with {contact.obstacle} at {contact.arc_length / rod.length:.4f} L"
        if not all(np.all(np.isfinite(v)) for v in (contact.position, contact.normal, contact.force)):
            return f"{where}: not finite"
        surface = met[contact.obstacle]
        off = float(surface.signed(contact.position)) / rod.length
        if abs(off) > DEPTH:
            return f"{where}: {off:.1e} L off the surface"
        # along a normal the distance grows by one; an edge has many
        up = 1e-4 * rod.length
        slope = (
            float(surface.signed(contact.position + up * contact.normal) - surface.signed(contact.position))
            / up
        )
        if abs(slope - 1.0) > 1e-4:
            return f"{where}: that is no normal, the distance grows by {slope:.3f} along it"
        if contact.normal_force < -ROUNDING * largest:
            return f"{where}: it pulls with {-contact.normal_force:.2e} N"
        rub = float(np.linalg.norm(contact.friction))
        if rub > surface.friction * contact.normal_force + ROUNDING * largest:
            return f"{where}: friction {rub:.3e} N beyond the cone of {contact.normal_force:.3e} N"
    for name, surface in met.items():
        if not surface.solid:
            continue
        deepest = float(surface.signed(claim.points[1:-1]).min()) / rod.length
        # on a grid the cable may sag between two contacts, by less than what the grid costs
        if deepest < -max(DEPTH, GRID_DEPTH * grid_error(claim)):
            return f"{-deepest:.1e} L inside {name}"
    return None


def balance_fault(rod: Rod, claim: Equilibrium, tolerance: float) -> str | None:
    """Whether what contacts and both ends are said to bear is not the weight, to the relative `tolerance`.

    What lies finds its pressure again whatever was told of it.
    """
    if any(contact.other_arc_length is not None for contact in claim.contacts):
        return None  # a cable's own strands push each other
    ends = [
        Rotation.from_quat(pose[3:]).apply(wrench[:3])
        for pose, wrench in ((rod.start, claim.start_wrench), (rod.end, claim.end_wrench))
    ]
    forces = [*ends, -rod.length * rod.weight, *(-contact.force for contact in claim.contacts)]
    largest = max(float(np.linalg.norm(force)) for force in forces)
    left = float(np.linalg.norm(np.sum(forces, axis=0)))
    return f"forces do not balance by {left:.2e} N" if left > tolerance * largest else None


def pull_fault(rod: Rod, found: Verification, touches: Sequence[Touch]) -> str | None:
    """Whether a surface would have to pull to keep the true rod on it."""
    together, pulls = _pulls(rod, found, touches)
    return f"balance needs a surface to pull with {-together.min():.2e} N" if pulls.any() else None


def let_go(
    rod: Rod, met: Mapping[str, Surface], claim: Equilibrium, found: Verification, touches: Sequence[Touch]
) -> Verification | None:
    """The true equilibrium that the rod finds if what pulls lets go; None if there is none outside obstacles.

    Along a patch that is about to part the rod lifts off by next to nothing: said to touch there, it is still
    all but the same, which is what remains to be seen.
    """
    for _ in range(ROUNDS):
        _, pulls = _pulls(rod, found, touches)
        if found.shape is None or not pulls.any():
            break
        touches = [touch for touch, pull in zip(touches, pulls, strict=True) if not pull]
        found = verify(rod, claim, touches)
    if found.shape is None or pulls.any():
        return None
    points = found.shape.points[1:-1]
    deepest = min(float(surface.signed(points).min()) for surface in met.values() if surface.solid)
    return found if deepest > -DEPTH * rod.length else None


def held_in_place(
    rod: Rod, claim: Equilibrium, tolerance: float, touches: Sequence[Touch]
) -> Verification | None:
    """The true equilibrium with its rubbing points where they are said to be; None if other forces hold them.

    With its friction given, a cable may be all but free to slide: what changes the force by a millionth then
    moves the true equilibrium by a thousandth. With its points given it is not; their forces must be those
    told, to the `tolerance`, parts of the largest.
    """
    rubbing = [c for c in claim.contacts if c.length == 0.0 and c.friction.any()]
    if not rubbing:
        return None
    held = [
        Touch(
            contact.arc_length / rod.length,
            _plane((contact.position - rod.start[:3]) / rod.length, axis),
            float(contact.force @ axis) / rod.force_unit,
            np.zeros(3),
            slides=False,
        )
        for contact in rubbing
        for axis in np.eye(3)
    ]
    others = [touch for touch in touches if not (touch.holds and touch.friction.any())]
    both = sorted([*others, *held], key=lambda touch: touch.place)
    found = verify(rod, claim, both)
    if not found.converged:
        return None
    forces = [found.normal_forces[[one is touch for touch in both]] for one in held]
    off = np.ravel(forces) - np.ravel([contact.force for contact in rubbing])
    largest = max(float(np.linalg.norm(contact.force)) for contact in claim.contacts)
    return found if np.linalg.norm(off) <= tolerance * largest else None


def _plane(point: np.ndarray, normal: np.ndarray) -> shooting.Surface:
    """Distances of points (k, 3) from a plane, with their gradients and Hessians."""

    def at(r: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return (r - point) @ normal, np.broadcast_to(normal, r.shape), np.zeros((len(r), 3, 3))

    return at


def _pulls(rod: Rod, found: Verification, touches: Sequence[Touch]) -> tuple[np.ndarray, np.ndarray]:
    """(n,) force about each touch, N, and (n,) whether that is a pull.

    Side by side on a stretch, forces that take turns are all but the same to the rod: their sum is judged.
    """
    places = np.array([touch.place for touch in touches])
    if len(places) == 0 or len(found.normal_forces) != len(places):
        return np.zeros(len(places)), np.zeros(len(places), bool)
    together = (np.abs(places[:, None] - places[None, :]) < STRETCH) @ found.normal_forces
    nothing = NOTHING * float(np.min(rod.stiffness[:2])) / rod.length**2
    return together, together < -1e-3 * max(float(np.abs(together).max()), nothing)


def sliding_fault(rod: Rod, met: Mapping[str, Surface], claim: Equilibrium, motion: np.ndarray) -> str | None:
    """Where the claimed friction is not that of (53) of Liu et al. (2018), after a `motion` (3,) of the end.

    It is mu times the normal force, along t x n, against the motion's part along that.
    """
    largest = max((float(np.linalg.norm(contact.force)) for contact in claim.contacts), default=0.0)
    tangents = Rotation.from_quat(claim.orientations).as_matrix()[:, :, 2]
    at = np.linspace(0.0, rod.length, len(tangents))
    for contact in claim.contacts:
        size = met[contact.obstacle].friction * contact.normal_force
        if size <= ROUNDING * largest:
            continue
        where = f"contact with {contact.obstacle} at {contact.arc_length / rod.length:.4f} L"
        t = np.array([np.interp(contact.arc_length, at, column) for column in tangents.T])
        side = np.cross(t, contact.normal)
        side /= np.linalg.norm(side)
        along = float(contact.friction @ side)
        if abs(abs(along) - size) > ACROSS * size:
            return f"{where}: friction of {along:.3e} N across the cable is not {size:.3e} N"
        towards = float(motion @ side)
        if along * towards > 0.0 and abs(towards) > CLEARLY * float(np.linalg.norm(motion)):
            return f"{where}: friction pushes the way the end goes"
    return None
