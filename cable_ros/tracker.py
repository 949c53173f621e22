# SPDX-License-Identifier: Apache-2.0
"""Joint angles in, equilibria out: warm start and branch."""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np

from cable_ros import interpretation
from cable_ros.branch import effect_selection
from cable_ros.branch.coupled_pieces import coupled_pieces, kinds
from cable_ros.branch.pieces import Span, joined, shares, spans
from cable_ros.branch.results import failed
from cable_ros.branch.rubbing_cables import crossed_cables
from cable_ros.common.compile_watch import GETTING
from cable_ros.common.packing import pack, unpack
from cable_ros.contact.overlaps import OUTLINE, SPACING, Pairs, SelfApproach
from cable_ros.effects.contact import encode
from cable_ros.effects.registry import environments, properties
from cable_ros.equilibrium import Equilibrium, Status
from cable_ros.robot_overlaps import RobotOverlaps
from cable_ros.scene import Kinematics, Scene, load_scene
from cable_ros.scene.joint_limits import IGNORE, MODES, REFUSE, WARN, JointLimits

ABSURD = 1e4
"""Joint values beyond this many rad or m are taken for a fault of the sender, not for a pose."""
MOST_POINTS = 100_001
"""Points of a polyline."""


NOTHING: dict[int, Equilibrium] = {}


class Tracker:
    """Follows every cable of a scene while the joints move.

    Args:
        scene: from `load_scene`; a path or mapping is loaded.
        tolerance: accepted relative error of the end wrench, 1e-12 to 0.1; the resolution follows from it.
        polyline_points: points of `Equilibrium.points`, 2 to 100,001.
        joint_limits: what to do with joint values outside the URDF's limits: `warn`, solve them and say so in
            the message; `refuse`, not solve them; or `ignore`, solve them as any other.

    Raises:
        SceneError: the scene is not usable.
        ValueError: tolerance or polyline_points out of range, or no such way with joint limits.
    """

    def __init__(
        self,
        scene: Scene | str | Mapping[str, object],
        tolerance: float = 1e-4,
        polyline_points: int = 101,
        joint_limits: str = WARN,
    ):
        self.scene = scene if isinstance(scene, Scene) else load_scene(scene)
        self.kinematics = Kinematics(self.scene)
        self.joint_names = self.kinematics.joint_names
        self.limits = JointLimits(self.scene, self.joint_names)
        self.joint_limits = joint_limits
        self.outside = ""
        """Sentences about the joint values solved last that are outside their limits; mostly empty."""
        self._check(tolerance, polyline_points)
        self._tolerance, self._polyline_points = float(tolerance), int(polyline_points)
        names = [obstacle.name for obstacle in self.scene.obstacles]
        self._pieces = self.scene.pieces
        self._tracked_cables = tuple(
            kind(piece, properties(self.scene, piece), self._tolerance, self._polyline_points, names)
            for kind, piece in zip(kinds(self.scene), self._pieces, strict=True)
        )
        self._coupled = coupled_pieces(self.scene, self._tracked_cables)
        self._crossed = crossed_cables(self.scene, self._tracked_cables)
        self._groups: list[range] = []  # by cable: the numbers of its pieces
        for cable in self.scene.cables:
            begin = self._groups[-1].stop if self._groups else 0
            self._groups.append(range(begin, begin + len(cable.pieces)))
        self._spans: dict[int, tuple[Span, int]] = {}  # by piece, of its `fractions`
        self._names = [cable.name for cable in self.scene.cables]
        self._whole = len(self._pieces) == len(self._names)  # no cable has clips
        self._share_points()
        self._pairs = Pairs(self.scene.cables)
        self._approaches = [SelfApproach(one.length, SPACING * 2.0 * one.radius) for one in self.scene.cables]
        self.robot_overlaps = RobotOverlaps(self.scene, self.joint_names)
        self._beside = {
            i: encode(self.scene.obstacles, cable.radius, cable.name)
            for i, cable in enumerate(self._pieces)
            if cable.limits is not None
        }
        self._joints: np.ndarray | None = None
        self._auto = self.scene.effects == "auto"

    def __repr__(self) -> str:
        cables, joints = (
            ", ".join(f.name for f in self._tracked_cables),
            ", ".join(self.joint_names) or "none",
        )
        return f"Tracker(cables: {cables}; joints: {joints}; tolerance {self._tolerance:g})"

    @staticmethod
    def _check(tolerance: float, polyline_points: int) -> None:
        if not 1e-12 <= tolerance <= 0.1:
            raise ValueError(
                f"tolerance is {tolerance!r}; give the accepted relative error, from 1e-12 to 0.1"
            )
        if not 2 <= polyline_points <= MOST_POINTS:
            raise ValueError(f"polyline_points is {polyline_points!r}; give 2 to {MOST_POINTS}")

    @property
    def tolerance(self) -> float:
        """Accepted relative error of the end wrench; a change holds from the next solve on."""
        return self._tolerance

    @tolerance.setter
    def tolerance(self, value: float) -> None:
        self._check(value, self._polyline_points)
        self._tolerance = float(value)
        for tracked in self._tracked_cables:
            tracked.tolerance = self._tolerance

    @property
    def polyline_points(self) -> int:
        """Points of every polyline; a change holds from the next solve on."""
        return self._polyline_points

    @polyline_points.setter
    def polyline_points(self, value: int) -> None:
        self._check(self._tolerance, value)
        self._polyline_points = int(value)
        for tracked in self._tracked_cables:
            tracked.polyline_points = self._polyline_points
        self._share_points()

    def _share_points(self) -> None:
        """Tell the pieces of cables with clips where their points are."""
        for index in range(len(self._groups)):
            self._share(index)

    def _share(self, index: int) -> None:
        """Tell the pieces of a cable where their points are."""
        group, count = self._groups[index], self._polyline_points
        if len(group) > 1:
            cuts = self._cuts(index)
            for i, span in zip(group, spans(cuts, count), strict=True):
                tracked, known = self._tracked_cables[i], (span, count)
                if tracked.fractions is None or self._spans.get(i) != known:
                    # another array is another table of where they are
                    tracked.fractions, self._spans[i] = span.fractions(cuts[-1], count), known
                tracked.polyline_points = len(tracked.fractions)

    def _cuts(self, index: int) -> list[float]:
        """Arc lengths of start, supports and end of a cable at present, m."""
        cable, group = self.scene.cables[index], self._groups[index]
        cuts = [0.0, *(support.arc_length for support in cable.supports), cable.length]
        for coupled in self._coupled:
            if coupled.first in group:
                begin = coupled.first - group[0]
                cuts[begin + 1 : begin + len(coupled.pieces)] = (cuts[begin] + coupled.arcs).tolist()
        return cuts

    @property
    def joint_limits(self) -> str:
        """`warn`, `refuse` or `ignore`; a change holds from the next solve on."""
        return self._joint_limits

    @joint_limits.setter
    def joint_limits(self, value: str) -> None:
        if value not in MODES:
            raise ValueError(f"joint_limits is {value!r}; give {', '.join(MODES[:-1])} or {MODES[-1]}")
        self._joint_limits = value

    def reset(self) -> None:
        """Forget all equilibria: the next solve starts cold, on the branch that the scene asks for."""
        self._joints = None
        for tracked in self._tracked_cables:
            tracked.reset()
        for coupled in self._coupled:
            coupled.reset()
        if self._crossed is not None:
            self._crossed.reset()

    def set_environment(self, values: Mapping[str, Any]) -> None:
        """Temperature, dose and what else the scene has tables for; holds until changed, also over `reset`.

        The cables follow on their branches, in small changes where the step is large; the next solve tells.

        Args:
            values: by name, for all cables that depend on it, such as {"temperature": 20.0}, degC, or
                {"dose": 1e4}, Gy; or by cable, such as {"camera_cable": {"temperature": 20.0}}.

        Raises:
            ValueError: one sentence: nothing depends on it, not a finite number, or outside the scene's
                table; nothing has changed then.
        """
        before = {tracked.name: tracked.environment for tracked in self._tracked_cables}
        after = environments(self.scene, before, values)
        for i, (cable, tracked) in enumerate(zip(self._pieces, self._tracked_cables, strict=True)):
            if after[cable.name] != tracked.environment:
                tracked.environment = after[cable.name]
                new = properties(self.scene, cable, environment=tracked.environment)
                tracked.change_properties(new, self._clamp_poses(i), i)
                tracked.choice = None

    @property
    def _shares(self) -> bool:
        """Whether equilibria depend on each other."""
        return bool(self._coupled) or self._crossed is not None

    @property
    def left_out(self) -> dict[str, tuple[str, ...]]:
        """By cable: the effects that `effects: auto` leaves out at present."""
        out: dict[str, tuple[str, ...]] = {}
        for f in self._tracked_cables:
            if f.choice is not None:
                out[f.name] = tuple(dict.fromkeys((*out.get(f.name, ()), *f.choice.left_out)))
        return out

    def _prepare(self, index: int) -> None:
        tracked, cable = self._tracked_cables[index], self._pieces[index]
        effect_selection.prepare(tracked, self.scene, cable, self.kinematics, index)

    def _review(self, index: int, found: Equilibrium) -> bool:
        tracked, cable = self._tracked_cables[index], self._pieces[index]
        return effect_selection.review(tracked, self.scene, cable, self.kinematics, index, found)

    def snapshot(self) -> bytes:
        """What the next solve starts from, for `restore`, also in another process with the same versions."""
        return pack(
            (self._tracked_cables, self._coupled, self._crossed) if self._shares else self._tracked_cables
        )

    def restore(self, snapshot: bytes) -> None:
        """Go on from a snapshot of a tracker of the same scene; tolerance and polyline points stay."""
        if self._shares:
            self._tracked_cables, self._coupled, self._crossed = unpack(snapshot)
        else:
            self._tracked_cables = unpack(snapshot)
        self._spans.clear()
        for tracked in self._tracked_cables:
            tracked.tolerance, tracked.polyline_points = self._tolerance, self._polyline_points
        self._share_points()

    def solve(self, joints: Mapping[str, float]) -> dict[str, Equilibrium]:
        """The equilibrium of every cable at the given joint values, by cable name.

        Args:
            joints: value by joint name, rad or m; others than `joint_names` are ignored.

        The work of a call is bounded: a pose too far away for it comes back as `Status.UNFINISHED`, and the
        next call goes on from where the cable has got; `arrive` does that.

        Never raises for values: what cannot be used comes back as `Status.INVALID_INPUT`, and the next usable
        pose is followed from the last one.
        """
        begin, code = time.perf_counter(), GETTING.seconds
        self.outside = ""
        interpretation.solves(self.scene)
        try:
            numbers = [float(joints[name]) for name in self.joint_names]
        except (KeyError, TypeError, ValueError):
            return self._invalid(self._fault(joints), begin)
        for number in numbers:
            if not -ABSURD <= number <= ABSURD:
                return self._invalid(self._fault(joints), begin)
        self.outside = "" if self._joint_limits == IGNORE else self.limits.beyond(numbers)
        if self.outside and self._joint_limits == REFUSE:
            return self._invalid(f"{self.outside} Not solved, as joint_limits is '{REFUSE}'.", begin)
        values = np.array(numbers)
        each = []
        poses = self.kinematics.poses(values)
        together = self._solve_coupled(values, poses, begin) if self._coupled else NOTHING
        if self._crossed is not None:
            together = dict(enumerate(self._crossed.solve(self.kinematics, values, poses, begin)))
        for i, tracked in enumerate(self._tracked_cables):
            if i in together:
                found = together[i]
            else:
                if self._auto:
                    self._prepare(i)
                found = tracked.solve(self.kinematics, i, values, poses[i], begin)
                if self._auto and found.converged and self._review(i, found):
                    found = tracked.solve(self.kinematics, i, values, poses[i], begin)
            if GETTING.seconds != code:  # compiled, or loaded: once in a process
                spent, code = GETTING.seconds - code, GETTING.seconds
                found = dataclasses.replace(found, solve_time=max(found.solve_time - spent, 0.0))
            if i in self._beside:
                found = self._watch(i, values, poses[i], found)
            each.append(found)
            begin = time.perf_counter()
        self._joints = values
        out = dict(zip(self._names, each, strict=False)) if self._whole else self._joined(each, poses)
        if len(out) > 1 and self._crossed is None:
            clamps = np.array([(poses[group[0], 0], poses[group[-1], 1]) for group in self._groups])
            self._pairs.mark(out, clamps, self._outlines(out, poses))
        if self.robot_overlaps.compared:
            self.robot_overlaps.mark(out, joints, self._outlines(out, poses))
        if self.outside:
            for name, found in out.items():
                out[name] = dataclasses.replace(found, message=f"{found.message} {self.outside}")
        return out

    def _joined(self, each: list[Equilibrium], poses: np.ndarray) -> dict[str, Equilibrium]:
        """The results of all cables by name, from those of all pieces."""
        out = {}
        for index, (cable, group) in enumerate(zip(self.scene.cables, self._groups, strict=True)):
            if len(group) == 1:
                out[cable.name] = each[group[0]]
                continue
            found = [each[i] for i in group]
            outline = partial(self._outline, index, poses)
            out[cable.name] = joined(cable, found, self._cuts(index), outline, self._approaches[index])
        return out

    def _solve_coupled(self, joints: np.ndarray, poses: np.ndarray, begin: float) -> dict[int, Equilibrium]:
        """The results of the pieces that share supports, by number; in `poses` their sections take the place
        of the mounts that they turn in.
        """
        out: dict[int, Equilibrium] = {}
        for coupled in self._coupled:
            index = next(k for k, group in enumerate(self._groups) if coupled.first in group)
            mounts = poses[coupled.which]
            found = coupled.solve(self.kinematics, joints, mounts, begin, partial(self._share, index))
            out.update(enumerate(found, coupled.first))
            if coupled.state is not None:
                poses[coupled.which] = [place.poses for place in coupled.places(mounts)]
            begin = time.perf_counter()
        return out

    def _clamp_poses(self, index: int) -> Callable[[np.ndarray], np.ndarray]:
        """`Kinematics.poses`, with the sections of the piece in the place of mounts that they turn in."""
        for coupled in self._coupled:
            if index in range(coupled.first, coupled.first + len(coupled.pieces)):
                return partial(coupled.held, self.kinematics)
        return self.kinematics.poses

    def _watch(self, index: int, joints: np.ndarray, poses: np.ndarray, found: Equilibrium) -> Equilibrium:
        """The result of a piece such that it tells its extremes, if it is trusted."""
        tracked, limits = self._tracked_cables[index], self._pieces[index].limits
        if limits is None or not found.status.trusted:
            return found
        links = self.kinematics.obstacle_poses(joints)
        extremes = tracked.extremes(limits, self._beside[index], links, tracked.origin(poses))
        return found.completed({"_extremes": extremes})

    def arrive(self, joints: Mapping[str, float]) -> dict[str, Equilibrium]:
        """As `solve`, called again until no cable is `Status.UNFINISHED`: for work without a deadline."""
        out = self.solve(joints)
        # each call gets on by at least a given part of a step, or ends otherwise
        while any(one.status is Status.UNFINISHED for one in out.values()):
            out = self.solve(joints)
        return out

    @property
    def lost(self) -> dict[str, str]:
        """By cable: what happened to its branch, for those that are `Status.BRANCH_LOST`."""
        return {tracked.name: tracked.lost for tracked in self._tracked_cables if tracked.lost}

    def distrust(self, lost: Mapping[str, str]) -> None:
        """Take the branches of these cables for lost, as another tracker's `lost` tells."""
        for tracked in self._tracked_cables:
            if tracked.name in lost:
                tracked.distrust(lost[tracked.name])

    def _outlines(self, found: Mapping[str, Equilibrium], poses: np.ndarray) -> Callable[[int], np.ndarray]:
        """Gives a cable's polyline (n, 3) by its number."""

        def outline(index: int) -> np.ndarray:
            points = found[self.scene.cables[index].name].points
            return points if len(points) >= OUTLINE else self._outline(index, poses)

        return outline

    def _outline(self, index: int, poses: np.ndarray) -> np.ndarray:
        """(OUTLINE, 3) polyline of a cable by its number, world, m."""
        group = self._groups[index]
        tracked = [self._tracked_cables[i] for i in group]
        outlines = [one.outline(one.origin(poses[i])) for i, one in zip(group, tracked, strict=True)]
        if len(group) == 1:
            return outlines[0]
        parts = zip(outlines, shares(self._cuts(index), OUTLINE), strict=True)
        own = np.linspace(0.0, 1.0, OUTLINE)
        return np.concatenate(
            [np.stack([np.interp(at, own, line[:, a]) for a in range(3)], axis=1) for line, at in parts]
        )

    def _fault(self, joints: Mapping[str, float]) -> str:
        for name in self.joint_names:
            if name not in joints:
                return f"Joint '{name}' is missing; the scene needs {', '.join(self.joint_names)}."
            try:
                value = float(joints[name])
            except (TypeError, ValueError):
                return f"Joint '{name}' is {joints[name]!r}; a number in rad or m is needed."
            if not math.isfinite(value) or abs(value) > ABSURD:
                return f"Joint '{name}' is {value:g}; a finite value within {ABSURD:g} rad or m is needed."
        return Status.INVALID_INPUT.sentence

    def _invalid(self, message: str, begin: float) -> dict[str, Equilibrium]:
        count, seconds = self._polyline_points, time.perf_counter() - begin
        return {
            cable.name: failed(Status.INVALID_INPUT, message, seconds, count) for cable in self.scene.cables
        }
