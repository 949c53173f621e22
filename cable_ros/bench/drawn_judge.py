# SPDX-License-Identifier: Apache-2.0
"""Drawn scenes solved and judged: true by itself, true as a step, and the same in finer steps.

Without friction an answer is verified as among random obstacles. With friction the forces across the normals
are taken as reported, which says nothing of what came before. So beside the cone, two things are asked of the
path. What slides must not be driven by its friction, and what sticks stays where it is on its
obstacle. And the same path in more poses ends in the same wrenches.

A step tells its beginning and its end. In between what slides may turn back, where the point about which a
patch turns goes along it, and may come to rest. So a step at fault is solved again in parts, which show it.
"""

from __future__ import annotations

import math
import os
import traceback
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
from scipy.interpolate import CubicHermiteSpline
from scipy.spatial.transform import Rotation

from cable_ros.bench.cases import (
    Case,
    Pose,
    Step,
    answered,
    case_scene,
    joint_values,
    judge,
    lost,
    reach_fault,
    relative_difference,
    rods,
    says_pulled,
    says_taut,
)
from cable_ros.bench.contact_checks import surfaces
from cable_ros.bench.drawn import refined
from cable_ros.bench.path_bounds import path_bounds, pulled_taut
from cable_ros.equilibrium import Contact, Equilibrium, Status
from cable_ros.scene import Scene
from cable_ros.scene.kinematics import Kinematics
from cable_ros.tracker import Tracker

FINER = 4
"""Number of poses of the finer path over those of the path."""
SAME = 0.01
"""Relative difference allowed between wrenches of one pose on the two paths."""
SMALL = 0.05
"""Wrenches below this part of the path's largest are compared by that."""
PARTS = 16
"""A step with which something is wrong is solved again in so many parts, and in the square of that."""
LOOKED_AT = 24
"""Of longer paths so many poses are verified, evenly spread, and every one whose status is new."""
STILL = 1e-4
"""What sticks may move so far over its obstacle, parts of the length: the accuracy of a position at the
tolerance of a wrench."""
DRAWN = 0.5
"""And so far, parts of what the clamps and the obstacle moved in the step: it may slide before it sticks."""
NEAR_LIMIT = 0.8
"""What has more friction than this part of its limit may have slid to the last moment of the step."""
DRIVEN = 0.2
"""Friction of what slides may be driven by this part of what it could take up: its direction is that at the
step's end, not its mean."""
TURNED = 0.05
"""What slides may be driven over so much of what the clamps and the obstacle moved: slip turns in a step."""
SHORT = 0.02
"""Longest step, parts of the length, of which this is asked: in a longer one it may slide there and back."""
LEVER = 0.3
"""Motion of the cable beside a clamp that turns by 1 rad, parts of the length."""
FREE = 1e-3
"""A cable whose stability margin is less is all but free to turn, and rounding takes it to one side."""
NOTHING = 1e-6
"""Friction that is smaller, parts of the largest, is rounding."""


@dataclass(frozen=True)
class Judged:
    """One pose's answer, judged or not."""

    index: int
    step: Step
    judged: bool
    """Whether the answer was looked at, or only counted and timed."""
    inconsistent: str | None = None
    """Which contact's friction cannot have come of the step."""
    path_fault: str | None = None
    """How it differs from the same pose on the finer path."""

    @property
    def trusted(self) -> bool:
        return self.step.equilibrium.status.trusted

    @property
    def lost(self) -> bool:
        """Whether the branch and with it friction's history was lost, said or half said."""
        return lost(self.step.equilibrium)

    @property
    def wrong(self) -> str | None:
        """What is wrong with what was published as true."""
        if self.step.fault is not None:
            return self.step.fault
        if self.trusted and self.lost:
            return f"published as true, but lost: {self.step.equilibrium.message}"
        return (self.inconsistent or self.path_fault) if self.trusted else None

    @property
    def verified(self) -> bool:
        return self.step.verified and self.wrong is None


@dataclass(frozen=True)
class Drawn:
    """What became of one scene."""

    case: Case
    poses: list[Judged] = field(default_factory=list)
    raised: str | None = None
    """An exception: what no path may end in."""
    finer_lost: str | None = None
    """Where the finer path lost its history; from there on the two are not compared."""


def run_drawn(case: Case, finer: int = FINER) -> Drawn:
    """Lead a drawn case's cable through its path and judge it; `finer` = 1 leaves the finer path out."""
    poses: list[Judged] = []
    try:
        scene = case_scene(case)
        kinematics = Kinematics(scene)
        answers, seconds = _solve(case, scene, case.path)
        watched = _watched(answers)
        for i, joints in enumerate(case.path):
            before = None if i == 0 else (answers[i - 1], case.path[i - 1])
            shape = next((one.points for one in reversed(answers[:i]) if one.status.trusted), None)
            poses.append(
                _judged(
                    case, scene, kinematics, i, joints, answers[i], seconds[i], before, i in watched, shape
                )
            )
        if finer > 1 and len(case.path) > 1:
            path = refined(case.path, finer)
            solved, _ = _solve(case, scene, path)
            poses = _compared(poses, solved, finer)
            ways = (answers, case.path), (solved, path)
            told, within = (_step_faults(case, scene, kinematics, *way) for way in ways)
            poses = _traced(poses, told, within)
            first = next((i for i, one in enumerate(solved) if lost(one)), None)
            if first is not None:
                return Drawn(case, poses, None, f"pose {first} of {len(solved)}: {solved[first].message}")
    except Exception as raised:  # an exception is what a case must never end in
        last = traceback.extract_tb(raised.__traceback__)[-1]
        where = f"{os.path.basename(last.filename)}:{last.lineno}"
        return Drawn(case, poses, f"{type(raised).__name__} at {where}: {raised}")
    return Drawn(case, poses)


def _solve(case: Case, scene: Scene, path: Sequence[Pose]) -> tuple[list[Equilibrium], list[float]]:
    """The cable's answers along a path, and the wall time of each call, s."""
    tracker = Tracker(scene, tolerance=case.tolerance, polyline_points=case.polyline_points)
    (cable,) = scene.cables
    out, times = [], []
    for joints in path:
        answers, seconds = answered(tracker, joints)
        found = answers[cable.name]
        found.contacts  # noqa: B018  read off now: the tracker goes on
        out.append(found)
        times.append(seconds)
    return out, times


def _watched(answers: Sequence[Equilibrium]) -> set[int]:
    """Which poses are verified."""
    count = len(answers)
    even = {round(i) for i in np.linspace(0, count - 1, min(count, LOOKED_AT))}
    changed = {
        i
        for i, (before, after) in enumerate(pairwise(answers), start=1)
        if before.status is not after.status or after.message != before.message
    }
    return even | changed | {i for i, one in enumerate(answers) if says_pulled(one)}


def _judged(
    case: Case, scene: Scene, kinematics: Kinematics, index: int, joints: Pose,
    found: Equilibrium, seconds: float, before: tuple[Equilibrium, Pose] | None, look: bool,
    shape: np.ndarray | None,
) -> Judged:  # fmt: skip
    """Judge the answer at `joints`; `shape`: (n, 3) of the last trusted one before, m."""
    (cable,) = scene.cables
    rod = rods(scene, kinematics, joints)[cable.name]
    verification, fault, paths = None, None, None
    if look:
        met = surfaces(scene, kinematics, joint_values(kinematics, joints), cable.radius)
        verification, fault = judge(rod, found, case.tolerance, met)
        if found.status.name in ("OUT_OF_REACH", "NOT_CONVERGED"):
            distances = {name: surface.signed for name, surface in met.items()}
            ends = rod.start[:3], rod.end[:3], rod.length, distances
            if shape is not None and says_pulled(found):
                # without friction: from a plane of symmetry a string is pulled within that
                paths = pulled_taut(shape, *ends)
                wrong = paths.fits and says_taut(found)
                fault = f"said to be taut, but {paths.describe(rod.length)}" if wrong else None
            else:
                paths = path_bounds(*ends)
                fault = reach_fault(found, paths, rod.length)
    step = Step(found, rod, verification, seconds, fault, scene, paths)
    faults = () if before is None else friction_faults(scene, kinematics, before, (found, joints))
    inconsistent = next((fault for _, fault in faults), None)
    return Judged(index, step, look or not found.status.trusted, inconsistent)


def friction_faults(
    scene: Scene,
    kinematics: Kinematics,
    before: tuple[Equilibrium, Pose],
    after: tuple[Equilibrium, Pose],
    still: float = STILL,
) -> list[tuple[Contact, str]]:
    """Contacts whose friction cannot have come of a step from one trusted equilibrium to the next, and why.

    The motion of the touching point over its obstacle is that of the centreline's point at its arc length.
    Only contacts that were there before the step are looked at, and only steps no longer than SHORT. A fall
    is no step: what stuck may be torn off.

    `still`: see STILL.
    """
    if any(found.status is not Status.CONVERGED for found, _ in (before, after)):
        return []
    rough = {obstacle.name: i for i, obstacle in enumerate(scene.obstacles) if obstacle.friction}
    if not rough:
        return []
    (cable,) = scene.cables
    links = [kinematics.obstacle_poses(joint_values(kinematics, joints)) for _, joints in (before, after)]
    curves = [_curve(found, cable.length) for found, _ in (before, after)]
    largest = max((float(np.linalg.norm(c.friction)) for c in after[0].contacts), default=0.0)
    moved = _clamp_motion(before[0], after[0], cable.length)
    faults = []
    for contact in after[0].contacts:
        if contact.obstacle not in rough or not _near(contact, before[0].contacts, cable.length):
            continue
        old, new = (links[k][rough[contact.obstacle]] for k in (0, 1))
        turn = Rotation.from_quat(new[3:]) * Rotation.from_quat(old[3:]).inv()
        # where the obstacle would have carried the point that touched it there before
        carried = new[:3] + turn.apply(curves[0](contact.arc_length) - old[:3])
        slip = curves[1](contact.arc_length) - carried
        slip -= (slip @ contact.normal) * contact.normal
        drag = float(np.linalg.norm(carried - curves[0](contact.arc_length)))
        size, force = float(np.linalg.norm(slip)), float(np.linalg.norm(contact.friction))
        where = f"contact with {contact.obstacle} at {contact.arc_length / cable.length:.4f} L"
        if moved + drag > SHORT * cable.length:
            continue
        friction = scene.obstacles[rough[contact.obstacle]].friction
        held = force < NEAR_LIMIT * friction * contact.normal_force
        if not contact.sliding and held and size > still * cable.length + DRAWN * (moved + drag):
            faults.append((contact, f"{where} is said to stick and moved {size / cable.length:.1e} L"))
        driven = float(contact.friction @ slip) > (DRIVEN * force + NOTHING * largest) * size
        if contact.sliding and driven and size > still * cable.length + TURNED * (moved + drag):
            what = f"{where} slides {size / cable.length:.1e} L the way its friction pushes"
            faults.append((contact, what))
    return faults


def _clamp_motion(before: Equilibrium, after: Equilibrium, length: float) -> float:
    """Largest motion of a clamp, m, with that of the cable beside it where the clamp turns."""
    ends = [0, -1]
    straight = np.linalg.norm(after.points[ends] - before.points[ends], axis=1)
    turns = Rotation.from_quat(after.orientations[ends]) * Rotation.from_quat(before.orientations[ends]).inv()
    return float((straight + LEVER * length * turns.magnitude()).max())


def _traced(
    poses: Sequence[Judged], told: Sequence[str | None], within: Sequence[str | None]
) -> list[Judged]:
    """The poses with what is wrong with friction in the step to each, as `told` and on the finer path."""
    parts = len(within) // len(told)
    out = [poses[0]]
    for i, pose in enumerate(poses[1:]):
        finer = next((fault for fault in within[parts * i : parts * (i + 1)] if fault), None)
        fault = told[i] if finer is None or told[i] else f"in a finer path, {finer}"
        out.append(replace(pose, inconsistent=fault))
    return out


def _step_faults(
    case: Case, scene: Scene, kinematics: Kinematics, answers: Sequence[Equilibrium], path: Sequence[Pose]
) -> list[str | None]:
    """What is wrong with friction in each step of a path.

    Nothing is if there is nothing wrong in the step's parts, in all of which no more may move than in one
    step, they end in the same wrench, and what sticks does so there: it had slid before, as what slides had
    turned back. At a corner of the path slip turns back within however short a part: that may be one of them.
    """
    faults = [friction_faults(scene, kinematics, *ends) for ends in pairwise(zip(answers, path, strict=True))]
    out = [found[0][1] if found else None for found in faults]
    for parts in (PARTS, PARTS**2):
        divided = [parts if one else 1 for one in out]
        if max(divided) == 1:
            break
        way = [path[0]]
        for step, n in zip(pairwise(path), divided, strict=True):
            way.extend(refined(step, n)[1:])
        solved = list(zip(_solve(case, scene, way)[0], way, strict=True))
        ends = np.cumsum([0, *divided])
        for i, found in enumerate(faults):
            if out[i]:
                part = solved[ends[i] : ends[i + 1] + 1]
                out[i] = _left_in_parts(scene, kinematics, found, answers[i + 1], part)
    return out


def _left_in_parts(
    scene: Scene, kinematics: Kinematics, faults: Sequence[tuple[Contact, str]], answer: Equilibrium,
    solved: Sequence[tuple[Equilibrium, Pose]],
) -> str | None:  # fmt: skip
    """Which of the `faults` of a step to the `answer` is left as it was `solved` in parts, too, if any."""
    (cable,) = scene.cables
    there, joints = solved[-1]
    same = all(one.status.trusted for one, _ in solved)
    if same:
        rod = rods(scene, kinematics, joints)[cable.name]
        same = relative_difference(answer.end_wrench, there.end_wrench, rod) <= SAME
        still = STILL / (len(solved) - 1)
        faulty = [one for one in pairwise(solved) if friction_faults(scene, kinematics, *one, still)]
        same &= len(faulty) <= 1 and not any(friction_faults(scene, kinematics, *one) for one in faulty)
    sticking = [one for one in there.contacts if not one.sliding]
    left = (
        fault
        for contact, fault in faults
        if not (same and (contact.sliding or _near(contact, sticking, cable.length)))
    )
    return next(left, None)


def _near(contact: Contact, others: Sequence[Contact], length: float) -> list[Contact]:
    """Those of the other contacts that are with the same obstacle about there."""
    near = max(contact.length, 0.01 * length)
    return [
        one for one in others
        if one.obstacle == contact.obstacle and abs(one.arc_length - contact.arc_length) < near
    ]  # fmt: skip


def _curve(found: Equilibrium, length: float) -> CubicHermiteSpline:
    tangents = Rotation.from_quat(found.orientations).as_matrix()[:, :, 2]
    return CubicHermiteSpline(np.linspace(0.0, length, len(found.points)), found.points, tangents)


def _compared(poses: Sequence[Judged], finer: Sequence[Equilibrium], parts: int) -> list[Judged]:
    """The poses beside the same poses of the path in `parts` times as many, while both are trusted.

    A path whose first pose has no answer begins elsewhere, and friction remembers where.
    """
    if not (poses[0].trusted and finer[0].status.trusted):
        return list(poses)
    unit = np.array([1.0] * 3 + [1.0 / poses[0].step.rod.length] * 3)
    sizes = [float(np.linalg.norm(p.step.equilibrium.end_wrench * unit)) for p in poses if p.trusted]
    floor = SMALL * max(sizes, default=0.0)
    out = []
    apart = False
    for i, pose in enumerate(poses):
        fault, other = None, finer[parts * i]
        apart |= any(lost(one) for one in finer[max(0, parts * (i - 1) + 1) : parts * i + 1])
        free = min(pose.step.equilibrium.stability_margin, other.stability_margin) < FREE
        if pose.trusted and other.status.trusted and not apart and not free:
            wrench = pose.step.equilibrium.end_wrench
            off = relative_difference(wrench, other.end_wrench, pose.step.rod)
            size = float(np.linalg.norm(other.end_wrench * unit))
            off *= size / max(size, floor, 1e-300)
            if not off <= SAME or not math.isfinite(off):
                fault = f"the same path in {parts} times as many poses ends in a wrench {off:.1e} away"
        out.append(replace(pose, path_fault=fault))
    return out
