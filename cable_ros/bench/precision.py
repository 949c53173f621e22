# SPDX-License-Identifier: Apache-2.0
"""Work against precision: what each digit of the end wrench costs, for our solver and for the baselines.

The error of a wrench is the larger of |difference| / |reference| of its force and of its moment. References
come from `solve_bvp` at a tolerance of 1e-10 (1e-7 outside the diagram itself), started at our tightest
solution so that they are on its branch; how far the two agree is reported. Where a cable touches obstacles
they come from `verification`, which integrates the rod's equations beside that solution and finds the contact
forces again: point contacts are then known to 1e-9, patches, whose pressure it takes as many forces, to 1e-5;
friction is taken as reported. Times are medians over poses. Methods take turns in blocks of successive poses,
so that a slow spell of the machine hits all of them.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np

from cable_ros.baselines import bvp
from cable_ros.baselines.result import BaselineResult, ClampedCable, from_equilibrium, relative_wrench_error
from cable_ros.bench import effect_variants
from cable_ros.bench.cases import rods
from cable_ros.bench.contact_checks import surfaces, touches
from cable_ros.bench.methods import Method, OurTracker, Outcome, PlainBvp, Pose, Published, SolveBvp
from cable_ros.bench.verification import verify
from cable_ros.equilibrium import Equilibrium
from cable_ros.scene import Kinematics, Scene
from cable_ros.scene.joint_limits import JointLimits
from cable_ros.scene.model import CLAMPED
from cable_ros.scene.text import parse_yaml
from cable_ros.tracker import Tracker

BLOCK = 90
"""Consecutive poses that one method solves before the next has its turn: more than it takes to find its data
in the processor's caches again."""
TIGHTEST = 1e-11
"""Tolerance of the tracker that leads the references along the branch."""
TIGHT = 1e-9
"""The same where that tracker is the reference itself; a hundredth of what is then measured against it."""
BESIDE = 1e-2
"""A true equilibrium farther than this from our tight one, relative, is another one."""
PATIENCE = 3
"""After so many failures from its start on a method is asked no more: solve_bvp can take seconds for each."""


@dataclass(frozen=True)
class Size:
    """How much is measured."""

    tolerances: tuple[float, ...]
    bvp_tolerances: tuple[float, ...]
    parts: tuple[int, ...]
    poses: int
    """Most poses of the warm path."""
    references: int
    """How many of them have their error measured, and most cold starts."""
    gravity_numbers: tuple[float, ...]
    cables: tuple[int, ...]


FULL = Size(
    tolerances=tuple(10.0**-k for k in range(1, 11)),
    bvp_tolerances=(1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8),
    parts=(10, 20, 40, 80, 160, 320, 640, 1280, 2560, 5120),
    poses=361,
    references=19,
    gravity_numbers=(0.0, 1.0, 10.0, 100.0, 1e3, 1e4, 1e5),
    cables=(1, 2, 4, 8),
)
QUICK = Size(
    tolerances=(1e-2, 1e-4, 1e-6, 1e-8),
    bvp_tolerances=(1e-2, 1e-4, 1e-6),
    parts=(20, 80, 320),
    poses=41,
    references=5,
    gravity_numbers=(0.0, 100.0, 1e4),
    cables=(1, 4),
)
STEPS = (1 / 900, 1 / 360, 1 / 90, 1 / 36, 1 / 12, 1 / 4, 1 / 2)
"""Joint steps as fractions of the whole path: 0.2 to 90 deg of 180 deg."""


@dataclass(frozen=True)
class Row:
    """One line of the table."""

    panel: str
    """warm, cold, effect, gravity, step or cables."""
    method: str
    setting: str
    value: float
    """The setting or the varied quantity as a number."""
    seconds: float
    """Median time per equilibrium."""
    seconds_90: float
    """Nine of ten are faster."""
    error: float
    """Largest relative end-wrench error of the poses that have a reference."""
    error_median: float
    poses: int
    failed: int
    """Poses that the method itself calls failed; they count in the times, not in the errors."""


class NoEquilibrium(ValueError):
    """The path has nothing to measure."""


class Bench:
    """Measures one scene along one path of its joints; rows come as they are done.

    Args:
        scene: the scene.
        path: (m, n_joints) joint values in the order of `Tracker.joint_names`, in small steps.
        size: how much to measure.
        tick: called with a few words after every solve or block of solves.

    Raises:
        NoEquilibrium: from `rows`, where the path's first pose has none.
    """

    def __init__(self, scene: Scene, path: np.ndarray, size: Size, tick: Callable[[str], None]) -> None:
        self.scene, self.size, self.tick = scene, size, tick
        self.whole = path
        self.path = path[: size.poses]
        self.plain = effect_variants.plain(scene)
        """Whether the baselines can solve the scene; else references are our own, of tight tolerance."""
        self.agreement = 0.0
        """Largest relative difference between a reference of the diagram and the tightest tracker."""
        self.verified, self.unverified = 0, 0
        """References of the diagram, of cables among obstacles, that verification confirmed and did not."""

    def ticks(self) -> int:
        """How often `tick` will be called, nearly."""
        size, blocks = self.size, math.ceil(len(self.path) / BLOCK)
        settings = len(size.tolerances) + len(size.bvp_tolerances)
        others = 8 + 2 * len(size.gravity_numbers) + len(STEPS) + len(size.cables)
        return (
            (settings + len(size.bvp_tolerances) + len(size.parts)) * blocks
            + (settings + 2 * len(size.parts)) * size.references
            + others * (len(self.path) + blocks)
        )

    @property
    def provenance(self) -> str:
        """Where the diagram's references come from, and how far they agree with the tightest tracker."""
        if self.plain:
            return f"solve_bvp and cable_ros agree within {self.agreement:.1e}"
        if not self.verified:
            return f"cable_ros at {TIGHT:.0e}, since the baselines do not know all of the scene's effects"
        alone = f"; {self.unverified} more are cable_ros's alone" if self.unverified else ""
        friction = any(obstacle.friction for obstacle in self.scene.obstacles)
        of_friction = ", with the friction forces of cable_ros," if friction else ""
        return (
            f"integration of the rod's equations{of_friction} and cable_ros at {TIGHT:.0e} agree within "
            f"{self.agreement:.1e} at {self.verified} poses{alone}"
        )

    def rows(self) -> Iterator[Row]:
        """All panels."""
        mounts = [mount for cable in self.scene.cables for mount in cable.all_mounts]
        if len(mounts) > 2 * len(self.scene.cables) or any(mount.kind != CLAMPED for mount in mounts):
            raise NoEquilibrium(
                "only cables between two clamps are measured; clamp both ends, without supports"
            )
        yield from self.precision()
        for panel in (self.effects, self.gravity, self.steps, self.cables):
            yield from panel()

    def precision(self) -> Iterator[Row]:
        """The work-precision rows, warm and cold."""
        size = self.size
        poses = self.poses(self.scene, self.path, size.references, 1e-10)
        ours = [OurTracker(self.scene, tolerance) for tolerance in size.tolerances]
        if not self.plain:
            size = replace(size, bvp_tolerances=(), parts=())
            ours = [method for method in ours if method.setting >= (10 if self.verified else 100) * TIGHT]
        if poses[0].reference is None:
            raise NoEquilibrium(
                f"no equilibrium is found at the path's first pose, {poses[0].joints}; "
                "give a path that the cable can follow with --joint NAME=START:STOP:STEP"
            )
        theirs = [SolveBvp(tolerance) for tolerance in size.bvp_tolerances]
        plain = [PlainBvp(tolerance) for tolerance in size.bvp_tolerances]
        methods: list[Method] = [*ours, *theirs, *plain, *(Published(parts) for parts in size.parts)]
        yield from self.warm("warm", methods, poses)
        coarse = [parts for parts in size.parts if parts <= 640]  # from ones, finer grids take minutes
        methods = [*ours, *theirs]
        methods += [Published(parts, start) for start in (False, True) for parts in coarse]
        yield from self.cold(methods, [pose for pose in poses if pose.reference is not None])

    def effects(self) -> Iterator[Row]:
        """The default tolerance with one effect after the other; with a ball, the poses that touch it."""
        for label, scene in effect_variants.variants(self.scene, self.path[len(self.path) // 2]):
            yield from self._ours("effect", label, 0.0, scene, self.path)

    def gravity(self) -> Iterator[Row]:
        """The default tolerance under ever more weight, w L^3 / EI of the first cable."""
        cable = self.scene.cables[0]
        size = float(np.linalg.norm(self.scene.gravity))
        direction = self.scene.gravity / size if size > 0 else np.array([0.0, 0.0, -1.0])
        per_gravity = cable.linear_density * cable.length**3 / float(np.min(cable.stiffness[:2]))
        for number in self.size.gravity_numbers:
            if per_gravity > 0:
                gravity = number / per_gravity * direction
                scene = effect_variants.edited(
                    self.scene, {"gravity": gravity.tolist()}, effect_variants.nothing
                )
                label, others = f"w L^3/EI = {number:g}", [SolveBvp(1e-3)] if self.plain else []
                yield from self._ours("gravity", label, number, scene, self.path, *others)

    def steps(self) -> Iterator[Row]:
        """The default tolerance at ever larger joint steps, to and fro between the ends of the path."""
        ends = self.whole[0], self.whole[-1]
        reach = float(np.max(np.abs(ends[1] - ends[0]), initial=0.0))
        joints = JointLimits(self.scene, Kinematics(self.scene).joint_names).joints
        slide = all(joint.unit == "m" for joint in joints)
        scale, unit = (1e3, "mm") if slide else (math.degrees(1.0), "deg")
        for part in STEPS if reach > 0 else ():
            count = min(self.size.poses, 120)
            fraction = 1 - np.abs(1 - np.mod(part * np.arange(count), 2))  # a triangle wave from 0 to 1
            path = ends[0] + fraction[:, None] * (ends[1] - ends[0])
            label = f"{part * reach * scale:.3g} {unit}"
            yield from self._ours("step", label, part * reach, self.scene, path)

    def cables(self) -> Iterator[Row]:
        """The default tolerance with the first cable mounted several times."""
        for count in self.size.cables:
            first = parse_yaml(self.scene.text, self.scene.source)["cables"][0]
            copies = [{**first, "name": f"cable{i}"} for i in range(count)]
            scene = effect_variants.edited(self.scene, {"cables": copies}, effect_variants.nothing)
            yield from self._ours("cables", f"{count} cables", count, scene, self.path)

    def _ours(
        self, panel: str, label: str, value: float, scene: Scene, path: np.ndarray, *others: Method
    ) -> Iterator[Row]:
        poses = self.poses(scene, path, 5, 1e-7)
        for row in self.warm(panel, [OurTracker(scene, 1e-4), *others], poses):
            yield Row(**{**row.__dict__, "setting": label, "value": value})

    def poses(self, scene: Scene, path: np.ndarray, references: int, tolerance: float) -> list[Pose]:
        """The poses of a path; the first, the last and some between with their references."""
        kinematics = Kinematics(scene)
        names = kinematics.joint_names
        with_reference = set(
            np.linspace(0, len(path) - 1, min(references, len(path))).round().astype(int).tolist()
        )
        comparable = effect_variants.plain(scene)
        leader = Tracker(scene, TIGHTEST if comparable else TIGHT, 201)
        poses = []
        for i, values in enumerate(path):
            joints = dict(zip(names, values.tolist(), strict=True))
            clamps = kinematics.poses(values)
            cables = tuple(
                ClampedCable(cable.length, cable.stiffness, cable.linear_density * scene.gravity, *clamp)
                for cable, clamp in zip(scene.cables, clamps, strict=True)
            )
            equilibria = leader.arrive(joints)
            reference = None
            if i in with_reference and all(e.status.trusted for e in equilibria.values()):
                starts = [from_equilibrium(e, c) for e, c in zip(equilibria.values(), cables, strict=True)]
                if comparable:
                    pairs = zip(cables, starts, strict=True)
                    reference = tuple(self._reference(c, start, tolerance) for c, start in pairs)
                elif tolerance <= 1e-10 and scene.obstacles and effect_variants.bare(scene):
                    reference = self._verified(scene, kinematics, joints, equilibria, starts)
                else:
                    reference = tuple(starts)
            touching = any(e.contacts for e in equilibria.values())
            poses.append(Pose(joints, cables, reference, touching or not scene.obstacles))
            self.tick("references")
        return poses

    def _reference(self, cable: ClampedCable, start: BaselineResult, tolerance: float) -> BaselineResult:
        refined = bvp.solve(cable, start, tolerance=tolerance, max_nodes=30000)
        if not refined.converged:  # a very heavy cable: the tightest tracker must do
            return start
        if tolerance <= 1e-10:
            self.agreement = max(self.agreement, relative_wrench_error(start.end_wrench, refined.end_wrench))
        return refined

    def _verified(
        self,
        scene: Scene,
        kinematics: Kinematics,
        joints: Mapping[str, float],
        equilibria: Mapping[str, Equilibrium],
        starts: Sequence[BaselineResult],
    ) -> tuple[BaselineResult, ...]:
        """The starts with the end wrenches of the true equilibria beside them, where those are found."""
        out = []
        values = np.array([joints[name] for name in kinematics.joint_names])
        radii = {cable.name: cable.radius for cable in scene.cables}
        for (name, rod), start in zip(rods(scene, kinematics, joints).items(), starts, strict=True):
            met = surfaces(scene, kinematics, values, radii[name])
            reported = sorted(touches(rod, met, equilibria[name]), key=lambda touch: touch.place)
            found = verify(rod, equilibria[name], reported)
            difference = relative_wrench_error(found.end_wrench, start.end_wrench)
            if found.converged and difference < BESIDE:
                self.verified += 1
                self.agreement = max(self.agreement, difference)
                start = replace(start, end_wrench=found.end_wrench)
            else:
                self.unverified += 1
            out.append(start)
        return tuple(out)

    def warm(self, panel: str, methods: Sequence[Method], poses: Sequence[Pose]) -> Iterator[Row]:
        outcomes: list[list[Outcome]] = [[] for _ in methods]
        if poses[0].reference is None:
            return
        for method in methods:
            method.settle(poses[0])
        for begin in range(0, len(poses), BLOCK):
            for method, done in zip(methods, outcomes, strict=True):
                if not _hopeless(done):
                    done += [method.warm(pose) for pose in poses[begin : begin + BLOCK]]
                self.tick(panel)
        for method, done in zip(methods, outcomes, strict=True):
            yield _row(panel, method, poses, done)

    def cold(self, methods: Sequence[Method], poses: Sequence[Pose]) -> Iterator[Row]:
        outcomes: list[list[Outcome]] = [[] for _ in methods]
        for pose in poses:
            for method, done in zip(methods, outcomes, strict=True):
                if not _hopeless(done):
                    done.append(method.cold(pose))
                self.tick("cold")
        for method, done in zip(methods, outcomes, strict=True):
            yield _row("cold", method, poses, done)


def write_csv(path: Path, rows: Sequence[Row], facts: Mapping[str, str]) -> None:
    """The table, after lines `# name: fact` on the machine."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", newline="", encoding="utf-8") as file:
        for name, fact in facts.items():
            file.write(f"# {name}: {fact}\n")
        writer = csv.writer(file, lineterminator="\n")
        names = [field.name for field in fields(Row)]
        writer.writerow(names)
        for row in rows:
            values = (getattr(row, name) for name in names)
            writer.writerow(f"{value:.4g}" if isinstance(value, float) else value for value in values)


def _hopeless(outcomes: Sequence[Outcome]) -> bool:
    return len(outcomes) >= PATIENCE and not any(np.isfinite(one.wrenches).all() for one in outcomes)


def _row(panel: str, method: Method, poses: Sequence[Pose], outcomes: Sequence[Outcome]) -> Row:
    """Over the poses that were tried and count; over all that were tried where none does."""
    tried = list(zip(poses, outcomes, strict=False))
    counted = [(pose, outcome) for pose, outcome in tried if pose.counts] or tried
    poses, outcomes = zip(*counted, strict=True)
    errors = [
        relative_wrench_error(wrench, reference.end_wrench)
        for pose, outcome in zip(poses, outcomes, strict=True)
        if pose.reference is not None
        for wrench, reference in zip(outcome.wrenches, pose.reference, strict=True)
        if np.all(np.isfinite(wrench))
    ]
    seconds = [outcome.seconds for outcome in outcomes]
    return Row(
        panel=panel,
        method=method.name,
        setting=f"n = {method.setting:g}" if method.setting >= 1 else f"{method.setting:.0e}",
        value=method.setting,
        seconds=float(np.median(seconds)),
        seconds_90=float(np.quantile(seconds, 0.9)),
        error=max(errors, default=math.nan),
        error_median=float(np.median(errors)) if errors else math.nan,
        poses=len(outcomes),
        failed=sum(not np.all(np.isfinite(outcome.wrenches)) for outcome in outcomes),
    )
