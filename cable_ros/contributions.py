# SPDX-License-Identifier: Apache-2.0
"""What each effect of a scene does at one pose, measured: to the end wrench, and to the time of a solve."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from cable_ros.contact.overlaps import NOT_MODELLED, SPACING, closest_approach, warning
from cable_ros.effects.effect import Effect
from cable_ros.effects.registry import ALL, called_for, wanted
from cable_ros.equilibrium import Equilibrium
from cable_ros.rod.units import Units, relative_change
from cable_ros.scene import Cable, Scene
from cable_ros.scene.model import FREE
from cable_ros.tracker import Tracker

FINER, FINEST = 0.1, 1e-9
"""Changes are measured at this part of the tolerance, but no finer than that."""
APPROACH = 10
"""Steps over which a pose with friction is approached: friction remembers the way."""
ANGLE, STROKE = np.radians(0.5), 2e-3
"""One such step, and that of the timed solves: rad, or parts of the shortest cable's length."""


@dataclass(frozen=True)
class Explained:
    """One effect on one cable."""

    name: str
    present: bool
    """Whether it is in the equations at this pose."""
    why: str
    """What in the scene calls for it; or why it is not there."""
    formula: str
    """What `size` is."""
    size: float | None
    """Dimensionless; None where the scene has no numbers for it."""
    change: float | None
    """Relative change of the end wrench between the equations with and without it; None: not measured."""
    time: float | None
    """What it adds to the time of a warm-started solve, s; None: not measured."""


@dataclass(frozen=True)
class Explanation:
    """All effects on one cable at one pose."""

    equilibrium: Equilibrium
    effects: tuple[Explained, ...]
    time: float
    """Median time of a warm-started solve, s."""
    self_contact: str
    """Whether the cable touches itself, and whether that is modelled, as a sentence."""


def restricted(scene: Scene, names: Iterable[str]) -> Scene:
    """The scene with these effects only."""
    return dataclasses.replace(scene, effects=tuple(names))


def explain(
    scene: Scene, joints: Mapping[str, float], tolerance: float = 1e-4, repeats: int = 100
) -> dict[str, Explanation]:
    """Explain the effects of every cable, by its name.

    Args:
        scene: from `load_scene`.
        joints: value by joint name, rad or m, for every joint that moves a clamp or an obstacle.
        tolerance: accepted relative error of the end wrench.
        repeats: solves over which times are medians; 0: no times.

    An effect's change is that between equilibria with and without it, on the branch of the scene's own
    equilibrium, solved ten times finer than the tolerance. With friction both approach the pose over ten
    steps of half a degree, or of 2 mm per metre of cable.
    """
    tracker = Tracker(scene, tolerance)
    step = _step(tracker)
    way = APPROACH if any("friction" in wanted(scene, cable) for cable in scene.cables) else 0
    base = _approach(tracker, joints, step, way)
    present = [
        tuple(n for n in wanted(scene, c) if n not in tracker.left_out.get(c.name, ())) for c in scene.cables
    ]
    variants = _variants(scene, present)
    cables = tuple(
        dataclasses.replace(c, total_twist=base[c.name].total_twist)
        if base[c.name].converged and not c.supports
        else c
        for c in scene.cables
    )
    on_branch = dataclasses.replace(scene, cables=cables)
    fine = max(FINER * tolerance, min(FINEST, tolerance))
    union = sorted({name for names in present for name in names})
    trackers = {key: Tracker(restricted(on_branch, names), fine) for key, names in variants.items()}
    trackers[""] = Tracker(restricted(on_branch, union), fine)
    found = {key: _approach(one, joints, step, way) for key, one in trackers.items()}
    timed = {key: Tracker(restricted(on_branch, names), tolerance) for key, names in variants.items()}
    timed[""] = Tracker(restricted(on_branch, union), tolerance)
    times = _times(timed, joints, step, repeats)
    return {
        cable.name: Explanation(
            base[cable.name],
            tuple(_explained(effect, scene, cable, names, base[cable.name], found, times) for effect in ALL),
            float(np.median(times[""][cable.name])) if repeats else np.nan,
            self_contact(
                cable,
                _approach(Tracker(on_branch, tolerance, 801), joints, step, way)[cable.name],
                scene.cable_contact,
            ),
        )
        for cable, names in zip(scene.cables, present, strict=True)
    }


def _variants(scene: Scene, present: Sequence[tuple[str, ...]]) -> dict[str, list[str]]:
    """By effect: the effects of the scene with this one the other way."""
    union = {name for names in present for name in names}
    out = {}
    for name in {n for cable in scene.cables for n in called_for(scene, cable)}:
        if name in union:
            names = union - {name} - ({"friction"} if name == "contact" else set())
        elif name == "friction" and "contact" not in union:
            continue
        else:
            names = union | {name}
        slides = scene.friction_model == "sliding" and {"contact", "friction"} <= set(names)
        if slides and {"stretch", "shear"} & set(names):
            continue  # not together
        out[name] = sorted(names)
    return out


def _step(tracker: Tracker) -> np.ndarray:
    """One step of every joint: an angle, or a stroke where the joint only shifts what it moves."""
    zero, kinematics = np.zeros(len(tracker.joint_names)), tracker.kinematics
    if not len(zero):
        return zero
    motions = [kinematics.jacobians(zero).reshape(-1, 6, len(zero)), kinematics.obstacle_jacobians(zero)]
    turns = np.abs(np.concatenate(motions)[:, 3:]).max(axis=(0, 1), initial=0.0) > 0
    return np.where(turns, ANGLE, STROKE * min(cable.length for cable in tracker.scene.cables))


def _approach(
    tracker: Tracker, joints: Mapping[str, float], step: np.ndarray, count: int
) -> dict[str, Equilibrium]:
    for back in range(count, 0, -1):
        tracker.arrive(_moved(tracker, joints, -back * step))
    return tracker.arrive(joints)


def _moved(tracker: Tracker, joints: Mapping[str, float], way: np.ndarray) -> dict[str, float]:
    return {name: joints[name] + float(s) for name, s in zip(tracker.joint_names, way, strict=True)}


def _times(
    trackers: Mapping[str, Tracker], joints: Mapping[str, float], step: np.ndarray, repeats: int
) -> dict[str, dict[str, list[float]]]:
    """Times of warm-started solves by variant and cable; all variants take turns, so that noise meets all."""
    out: dict[str, dict[str, list[float]]] = {key: {} for key in trackers}
    for i in range(-5, repeats):  # the first ones start cold
        for key, tracker in trackers.items():
            # to and fro in a few steps each: with friction, every turn back costs more than going on
            offset = abs(i % (2 * APPROACH) - APPROACH) - 0.5 * APPROACH
            for name, found in tracker.solve(_moved(tracker, joints, offset * step)).items():
                if i >= 0:
                    out[key].setdefault(name, []).append(found.solve_time)
    return out


def _explained(
    effect: Effect,
    scene: Scene,
    cable: Cable,
    present: tuple[str, ...],
    base: Equilibrium,
    found: Mapping[str, Mapping[str, Equilibrium]],
    times: Mapping[str, Mapping[str, Sequence[float]]],
) -> Explained:
    name, why = effect.NAME, effect.cause(scene, cable)
    if not why:
        return Explained(name, False, effect.ABSENT, effect.SIZE, None, None, None)
    if name not in wanted(scene, cable):
        why = f"not in the scene's effects; {why}"
    elif name not in present:
        why = f"left out by 'effects: auto' as below a tenth of the tolerance; {why}"
    elif name == "contact":
        why += _touching(base)
    wrench = "start_wrench" if cable.end.kind == FREE else "end_wrench"
    size = effect.size(scene, cable, {}, float(np.linalg.norm(getattr(base, wrench)[:3])))
    if name not in found:
        return Explained(name, name in present, why, effect.SIZE, size, None, None)
    with_it, without = found[""][cable.name], found[name][cable.name]
    slower, faster = times[""].get(cable.name, ()), times[name].get(cable.name, ())
    if name not in present:
        with_it, without, slower, faster = without, with_it, faster, slower
    change = None
    if with_it.converged and without.converged:
        units = Units(cable.length, float(np.sqrt(cable.stiffness[0] * cable.stiffness[1])))
        unit = np.repeat([units.force, units.moment], 3)
        change = relative_change(
            (getattr(without, wrench) - getattr(with_it, wrench)) / unit,
            getattr(with_it, wrench) / unit,
            1e-6,
        )
    cost = float(np.median(np.subtract(slower, faster))) if len(slower) else None
    return Explained(name, name in present, why, effect.SIZE, size, change, cost)


def _touching(found: Equilibrium) -> str:
    if not found.contacts:
        return "; touches nothing at this pose"
    force = sum(float(c.force @ c.normal) for c in found.contacts)
    names = ", ".join(dict.fromkeys(c.obstacle for c in found.contacts))
    first, last = found.contacts[0].arc_length, found.contacts[-1].arc_length
    where = f"at {first:.4g} m" if first == last else f"from {first:.4g} to {last:.4g} m"
    return f"; touches {names} {where} of its length with {force:.3g} N"


def self_contact(cable: Cable, found: Equilibrium, solved: bool) -> str:
    """Whether the cable comes so near to itself that this contact would matter; `solved`: it is modelled."""
    if solved and found.converged and not any(one.other == cable.name for one in found.overlaps):
        touches = sum(one.obstacle == cable.name for one in found.contacts) // 2
        return f"Contact of the cable with itself is modelled; here it touches itself at {touches} points."
    if not found.converged:
        return f"{NOT_MODELLED}; there is no equilibrium that would tell whether it matters."
    diameter = 2.0 * cable.radius
    if not diameter:
        return f"{NOT_MODELLED}; without a diameter nothing tells when it would matter."
    apart = closest_approach(found.points, cable.length, SPACING * diameter)
    if apart < diameter:
        return warning(apart, diameter)
    if not np.isfinite(apart):
        return f"{NOT_MODELLED}; this one is too short for it."
    return (
        f"{NOT_MODELLED}; here its parts stay {apart * 1e3:.3g} mm apart, {apart / diameter:.2g} diameters."
    )
