# SPDX-License-Identifier: Apache-2.0
"""A named case, and what becomes of it: every answer is verified or reported, never silently wrong."""

from __future__ import annotations

import math
import os
import time
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from cable_ros.bench.contact_checks import (
    Surface,
    balance_fault,
    contact_fault,
    grid_error,
    held_in_place,
    let_go,
    pull_fault,
    sliding_fault,
    surfaces,
    touches,
)
from cable_ros.bench.end_checks import clamped, judge_ends
from cable_ros.bench.path_bounds import PathBounds, path_bounds
from cable_ros.bench.strand_surfaces import with_strands
from cable_ros.bench.verification import Rod, Verification, verify
from cable_ros.equilibrium import Equilibrium, Status
from cable_ros.scene import Scene, load_scene
from cable_ros.scene.kinematics import Kinematics
from cable_ros.tracker import Tracker

Pose = Mapping[str, float]
TOLD, CELLS = 1.5, 3e-2
"""Times its own estimate that an answer on a grid may be off, and what it may be in any case: it tells its
contacts cell by cell, from which they are taken here."""
START_FACTOR = 5.0
"""The tolerance is the end wrench's; the start's own, which may be much smaller, may be this much worse."""
FINENESS = 1, 3, 9
"""How many times as many forces as mostly make up the pressure, and as near to each other hold the cable, in
turn while an answer seems wrong."""
MOVED = 1e-9
"""Motion of the end, parts of the length, that has a direction."""
TRUSTED = (Status.CONVERGED, Status.SNAPPED)
UNFINISHED, CALLS = "UNFINISHED", 100
"""A status of that name asks for the same pose again; no pose may take more calls."""

LOST = "BRANCH_LOST"
"""The status of a cable whose branch or history of friction is not known is of that name."""


@dataclass(frozen=True)
class Case:
    """One hard case: a cable, the poses it is led through, and what must come out."""

    name: str
    expected: str
    """In words, for the table."""
    scene: Mapping[str, Any] | str
    """In the scene's format, or a scene file."""
    path: Sequence[Pose] = ({},)
    """Joint values, solved one after the other by one tracker."""
    urdf: str | None = None
    statuses: tuple[Status, ...] = (Status.CONVERGED,)
    """What the last pose may end in."""
    along: tuple[Status, ...] = TRUSTED
    """What the poses before may end in."""
    wrench: np.ndarray | Callable[[], np.ndarray] | None = None
    """(6,) exact end wrench at the last pose; (n, 6) where any one of several is right."""
    wrench_tolerance: float = 1e-4
    """Relative difference allowed from `wrench`; its reason stands beside the case."""
    tolerance: float = 1e-4
    """What the tracker is asked for."""
    polyline_points: int = 101
    check: Callable[[list[Step]], str | None] | None = None
    """What else must hold: returns a sentence where it does not."""
    baselines: bool = True
    """Whether a cold solve of the last pose means anything for the baselines."""


@dataclass(frozen=True)
class Step:
    """One pose's answer and what verification says of it."""

    equilibrium: Equilibrium
    rod: Rod
    verification: Verification | None
    """None where the status says that the numbers are not to be trusted."""
    seconds: float
    """Wall time of the whole call."""
    fault: str | None
    """Why the answer is wrong; None: verified, or reported as not to be trusted."""
    scene: Scene | None = None
    paths: PathBounds | None = None
    """Bounds on the shortest path past the obstacles, if there is no answer among them."""

    @property
    def verified(self) -> bool:
        return self.verification is not None and self.fault is None

    @property
    def impossible(self) -> bool:
        """Whether it was said that the cable is too short for an equilibrium, or pulled taut, and rightly."""
        return (
            (self.equilibrium.status is Status.OUT_OF_REACH or says_pulled(self.equilibrium))
            and self.fault is None
            and self.paths is not None
            and self.paths.too_long
        )


@dataclass(frozen=True)
class Outcome:
    """A case's answers, and what is wrong with one of them."""

    case: Case
    steps: list[Step] = field(default_factory=list)
    fault: str | None = None
    reference_error: float = math.nan
    """Relative difference of the last end wrench from the case's reference."""

    @property
    def passed(self) -> bool:
        return self.fault is None

    @property
    def verified_error(self) -> float:
        """Largest wrench error along the path by verification."""
        errors = [s.verification.wrench_error for s in self.steps if s.verification is not None]
        return max(errors, default=math.nan)


def case_scene(case: Case) -> Scene:
    return load_scene(case.scene, urdf=case.urdf)


def joint_values(kinematics: Kinematics, joints: Pose) -> np.ndarray:
    return np.array([joints[name] for name in kinematics.joint_names], dtype=float)


def rods(scene: Scene, kinematics: Kinematics, joints: Pose) -> dict[str, Rod]:
    """The cables as verification takes them, at a pose with all needed joints finite."""
    poses = kinematics.poses(joint_values(kinematics, joints))
    return {
        cable.name: Rod(
            cable.length, cable.stiffness, scene.gravity * cable.linear_density, poses[i, 0], poses[i, 1]
        )
        for i, cable in enumerate(scene.cables)
    }


def judge(
    rod: Rod,
    equilibrium: Equilibrium,
    tolerance: float,
    met: Mapping[str, Surface] | None = None,
) -> tuple[Verification | None, str | None]:
    """Verification of an answer among the obstacles `met`, and what is wrong with it, if anything.

    Trusted answers must be finite, sit on their clamps (to a tenth of `tolerance`), and be within
    `tolerance` of a true and stable equilibrium.
    """
    if not equilibrium.status.trusted:
        return None, None
    for name in ("end_wrench", "start_wrench", "points", "orientations", "stiffness"):
        if not np.all(np.isfinite(getattr(equilibrium, name))):
            return None, f"{name} is not finite in a trusted answer"
    for name in ("stability_margin", "total_twist", "energy", "error_estimate"):
        if not math.isfinite(getattr(equilibrium, name)):
            return None, f"{name} is not finite in a trusted answer"
    miss = _clamp_miss(rod, equilibrium)
    if miss > 0.1 * tolerance:
        return None, f"the polyline misses a clamp by {miss:.1e} of the length or rad"
    met = met or {}
    fault = contact_fault(rod, met, equilibrium)
    if fault is not None:
        return None, fault
    lies = any(contact.length > 0.0 for contact in equilibrium.contacts)
    for fineness in FINENESS if lies else FINENESS[:1]:
        # how the pressure goes on between its samples, and where it holds, is this judge's own reading
        found, fault = _compared(rod, equilibrium, tolerance, met, fineness)
        if fault is None:
            break
    return found, fault or balance_fault(rod, equilibrium, tolerance)


def _compared(
    rod: Rod, equilibrium: Equilibrium, tolerance: float, met: Mapping[str, Surface], fineness: int
) -> tuple[Verification, str | None]:
    """`judge`, of an answer that is outside of obstacles; `fineness`: of `touches` and `verify`."""
    reported = sorted(touches(rod, met, equilibrium, fineness), key=lambda touch: touch.place)
    found = verify(rod, equilibrium, reported, fineness=fineness)
    # as reported, contacts of cells push; found again, neighbours trade forces that nothing distinguishes
    on_grid = grid_error(equilibrium) > tolerance
    fault = None if on_grid else pull_fault(rod, found, reported)
    if fault is not None:
        freed = let_go(rod, met, equilibrium, found, reported)
        if freed is None:
            return found, fault
        found = freed
    if not found.converged:
        return found, "no equilibrium found beside the answer"
    # friction on a grid is known to what the answer says, which must then be true
    if on_grid:
        tolerance = max(TOLD * grid_error(equilibrium), CELLS)
    if found.wrench_error > tolerance:
        found = held_in_place(rod, equilibrium, tolerance, reported) or found
    if found.wrench_error > tolerance:
        return found, f"end wrench off by {found.wrench_error:.1e}, asked for {tolerance:.0e}"
    if found.start_wrench_error > START_FACTOR * tolerance:
        return found, f"start wrench off by {found.start_wrench_error:.1e}, asked for {tolerance:.0e}"
    if not found.stable:
        return found, f"not a minimum, but published as one (margin {equilibrium.stability_margin:.1e})"
    return found, None


def _clamp_miss(rod: Rod, equilibrium: Equilibrium) -> float:
    worst = 0.0
    for i, clamp in ((0, rod.start), (-1, rod.end)):
        gap = np.linalg.norm(equilibrium.points[i] - clamp[:3]) / rod.length
        turn = Rotation.from_quat(equilibrium.orientations[i]).inv() * Rotation.from_quat(clamp[3:])
        worst = max(worst, float(gap), float(turn.magnitude()))
    return worst


def answered(tracker: Tracker, joints: Pose) -> tuple[dict[str, Equilibrium], float]:
    """The answers at a pose, asked for again while one is not done, and the longest call's wall time, s."""
    longest = 0.0
    for _ in range(CALLS):
        began = time.perf_counter()
        answers = tracker.solve(dict(joints))
        longest = max(longest, time.perf_counter() - began)
        if not any(answer.status.name == UNFINISHED for answer in answers.values()):
            break
    return answers, longest


def lost(found: Equilibrium) -> bool:
    """Whether the branch was lost, said by its status or, of an answer solved cold, by its message only."""
    return found.status.name == LOST or "solved anew" in found.message


def solve_step(
    tracker: Tracker, scene: Scene, kinematics: Kinematics, joints: Pose, case: Case
) -> list[Step]:
    """One pose: an answer for each cable, judged. Exceptions of the tracker pass through."""
    answers, seconds = answered(tracker, joints)
    usable = all(math.isfinite(joints.get(name, math.nan)) for name in kinematics.joint_names)
    at = dict(joints) if usable else dict.fromkeys(kinematics.joint_names, 0.0)
    cables = {cable.name: cable for cable in scene.cables}
    steps = []
    for name, rod in rods(scene, kinematics, at).items():
        paths = None
        if usable:
            resolved = _resolved(name, rod, answers[name], tracker, joints)
            met = surfaces(scene, kinematics, joint_values(kinematics, joints), cables[name].radius)
            verification, fault = None, None
            apart, strands, wrong = with_strands(resolved, name, rod.length, 2.0 * cables[name].radius)
            if wrong:
                fault = wrong
            elif clamped(cables[name]):
                verification, fault = judge(rod, apart, tracker.tolerance, {**met, **strands})
            else:
                verification, fault = judge_ends(cables[name], rod, resolved, tracker.tolerance)
            if met and answers[name].status in (Status.OUT_OF_REACH, Status.NOT_CONVERGED):
                distances = {which: surface.signed for which, surface in met.items()}
                paths = path_bounds(rod.start[:3], rod.end[:3], rod.length, distances)
                fault = reach_fault(answers[name], paths, rod.length)
        else:
            trusted = answers[name].status.trusted
            verification, fault = None, "trusted without usable joints" if trusted else None
        steps.append(Step(answers[name], rod, verification, seconds, fault, scene, paths))
    return steps


def says_taut(answer: Equilibrium) -> bool:
    """Whether the answer is that an obstacle has pulled the cable taut, so that its branch has an end."""
    return answer.status is Status.NOT_CONVERGED and "is taut around" in answer.message


def says_pulled(answer: Equilibrium) -> bool:
    """Whether the answer is that, or that its end force rises so steeply that it could not be followed."""
    pulled = answer.status is Status.NOT_CONVERGED and "is pulled around" in answer.message
    return pulled or says_taut(answer)


def reach_fault(answer: Equilibrium, paths: PathBounds, length: float) -> str | None:
    """What is wrong with the claim that a cable of `length`, m, is too short for all paths; or None."""
    if answer.status is not Status.OUT_OF_REACH or not paths.fits:
        return None
    return f"said to be too short, but {paths.describe(length)}"


def _resolved(name: str, rod: Rod, answer: Equilibrium, tracker: Tracker, joints: Pose) -> Equilibrium:
    """The answer with a polyline fine enough to verify it: four points to the bends at the clamps.

    The same pose is solved again for it, which must give the same wrench; the verdict is on the first one's.
    """
    force = float(np.linalg.norm(answer.end_wrench[:3])) * rod.length**2 / float(np.min(rod.stiffness[:2]))
    needed = 4.0 * math.sqrt(force) if answer.status.trusted and math.isfinite(force) else 0.0
    before = tracker.polyline_points
    if needed <= before:
        return answer
    tracker.polyline_points = int(min(needed, 4000.0)) + 1
    again = tracker.solve(dict(joints))[name]
    tracker.polyline_points = before
    if not relative_difference(again.end_wrench, answer.end_wrench, rod) <= 0.1 * tracker.tolerance:
        return answer
    return replace(answer, points=again.points, orientations=again.orientations)


def run_case(case: Case) -> Outcome:
    """Lead the case's cable through its path and judge every answer."""
    steps: list[Step] = []
    try:
        scene = case_scene(case)
        tracker = Tracker(scene, tolerance=case.tolerance, polyline_points=case.polyline_points)
        kinematics = Kinematics(scene)
        for joints in case.path:
            before = steps[-1].rod if steps else None
            steps += solve_step(tracker, scene, kinematics, joints, case)
            if scene.friction_model == "sliding" and len(scene.cables) == 1 and before is not None:
                steps[-1] = _with_sliding(before, steps[-1], kinematics, joints)
    except Exception as raised:  # an exception is what a case must never end in
        last = traceback.extract_tb(raised.__traceback__)[-1]
        where = f"{os.path.basename(last.filename)}:{last.lineno}"
        return Outcome(case, steps, f"{type(raised).__name__} at {where}: {raised}")
    error = math.nan
    if case.wrench is not None:
        exact = np.atleast_2d(case.wrench() if callable(case.wrench) else case.wrench)
        error = min(relative_difference(steps[-1].equilibrium.end_wrench, w, steps[-1].rod) for w in exact)
    return Outcome(case, steps, _fault(case, steps, error), error)


def _with_sliding(before: Rod, step: Step, kinematics: Kinematics, joints: Pose) -> Step:
    """A step after a rod led from `before`, its friction judged by (53) of Liu et al. (2018)."""
    assert step.scene is not None
    turn = [Rotation.from_quat(rod.start[3:]) for rod in (before, step.rod)]
    ends = [
        r.inv().apply(rod.end[:3] - rod.start[:3]) for r, rod in zip(turn, (before, step.rod), strict=True)
    ]
    motion = turn[1].apply(ends[1] - ends[0])
    told = step.equilibrium.status.trusted and step.fault is None
    if not told or np.linalg.norm(motion) < MOVED * step.rod.length:
        return step
    (cable,) = step.scene.cables
    met = surfaces(step.scene, kinematics, joint_values(kinematics, joints), cable.radius)
    return replace(step, fault=sliding_fault(step.rod, met, step.equilibrium, motion))


def _fault(case: Case, steps: list[Step], error: float) -> str | None:
    for i, step in enumerate(steps):
        where = f"pose {i}: " if len(steps) > 1 else ""
        if step.fault is not None:
            return where + step.fault
        allowed = case.statuses if i == len(steps) - 1 else case.along
        if step.equilibrium.status not in allowed:
            return f"{where}{step.equilibrium.status.name}: {step.equilibrium.message}"
    if case.wrench is not None and not error <= case.wrench_tolerance:
        return f"end wrench off the reference by {error:.1e}, allowed {case.wrench_tolerance:.0e}"
    return case.check(steps) if case.check is not None else None


def relative_difference(wrench: np.ndarray, exact: np.ndarray, rod: Rod) -> float:
    """|difference| / |exact| with moments divided by the length."""
    unit = np.array([1.0] * 3 + [1.0 / rod.length] * 3)
    size = max(float(np.linalg.norm(exact * unit)), 1e-12 * float(np.max(rod.stiffness)) / rod.length**2)
    return float(np.linalg.norm((wrench - exact) * unit)) / size
