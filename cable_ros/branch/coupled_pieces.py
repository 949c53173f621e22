# SPDX-License-Identifier: Apache-2.0
"""The pieces between two clips, or ends, of a cable that turns or slides in what is between them."""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from cable_ros.branch.approach import FAR, Away
from cable_ros.branch.cable_tracker import CableTracker
from cable_ros.branch.coupled_tangent import Whole
from cable_ros.branch.crossing_cable import CrossingCable
from cable_ros.branch.followed_equilibrium import POSE_LEFT_OUT
from cable_ros.branch.followed_pieces import FollowedPieces
from cable_ros.branch.landing import with_tip
from cable_ros.branch.loose_ends import LooseEnd, loose_ends
from cable_ros.branch.loose_piece import LoosePiece
from cable_ros.branch.rubbing_cable import RubbingCable
from cable_ros.branch.shared_piece import Place, SharedPiece
from cable_ros.branch.tracked_equilibrium import FREE
from cable_ros.equilibrium import Equilibrium, Status
from cable_ros.rod.kirchhoff import FREE_TO_TURN
from cable_ros.scene import Cable, Kinematics, Scene

APPROACHES = 3
"""Maximum number of solves' steps in which obstacles come to a cable that hangs."""
PATIENCE = 2
"""Number of poses in a row that it cannot be followed to, before an equilibrium is searched for again."""
OUT_OF_BALANCE = "The equations of an end that is not clamped could not be solved to the tolerance."


class CoupledPieces(FollowedPieces):
    """Keeps the pieces of one run on their common branch."""

    def reset(self) -> None:
        super().reset()
        self._waiting: list[np.ndarray] = []
        self._snapped: str = ""  # a sentence, if it did so on the way that has not arrived yet
        self._failures: int = 0
        self._lost: str = ""

    def held(self, kinematics: Kinematics, joints: np.ndarray) -> np.ndarray:
        """`Kinematics.poses` at `joints`, with its sections in the place of the mounts that they turn in."""
        poses = kinematics.poses(joints[: len(kinematics.joint_names)])
        if self.state is not None:
            poses[self.which] = [place.poses for place in self.places(poses[self.which])]
        return poses

    def places(self, mounts: np.ndarray) -> list[Place]:
        """Where its pieces are held now; `mounts` (n + 1, 2, 7): of their ends."""
        assert self.state is not None
        return self.state.places(mounts, self.run.length)

    def solve(
        self, kinematics: Kinematics, joints: np.ndarray, mounts: np.ndarray, begin: float,
        share: Callable[[], None],
    ) -> list[Equilibrium]:  # fmt: skip
        """The equilibria of its pieces, with wrenches along the axes of their mounts.

        Args:
            kinematics: of the robot.
            joints: (n_joints,) values.
            mounts: (n + 1, 2, 7) of the ends of the pieces there, world.
            begin: when the solve began, s.
            share: tells the pieces where their points are, once their lengths are known.
        """
        if self.state is not None and any(piece.rod is None for piece in self.pieces):
            self._forget("it could not be followed to the cable's new properties")
        resolved = self.state is None or [piece.resolve() for piece in self.pieces]
        if resolved is not True and not all(resolved):
            self._forget(f"it could not be brought to the tolerance {self.pieces[0].tolerance:g}")
        if self._failures >= PATIENCE:
            self._forget("it could not be followed from pose to pose")
        if out_of_reach := self._out_of_reach(mounts):
            message, where = out_of_reach
            return self._failed(Status.OUT_OF_REACH, message, begin, where)
        if self.state is None:
            problem = self._start(kinematics, joints, mounts)
            if problem is not None:
                status, message, where = problem
                return self._failed(status, message, begin, where)
            if self._lost:
                self.pieces[0].distrust(self._lost)
            return self._publish(kinematics, joints, mounts, "", begin, share)
        route = [*self._waiting, joints] if self._rough or self.may_rub else [joints]
        self._waiting, steps = [], 0
        for piece in self.pieces:
            piece.worked = 0.0
        for k, there in enumerate(route):
            steps, told = self._follow(kinematics, there, steps)
            self._snapped = self._snapped or (told or "")
            if told is None:
                self._failures += 1
                if self.rubbing:
                    self.pieces[0].distrust(POSE_LEFT_OUT)
                self._waiting = route[k + 1 : -1]
                return self._failed(Status.NOT_CONVERGED, Status.NOT_CONVERGED.sentence, begin)
            if not (self._joints is there or np.array_equal(self._joints, there)):
                self._waiting = route[k:]
                return self._failed(Status.UNFINISHED, Status.UNFINISHED.sentence, begin)
        self._failures, snapped, self._snapped = 0, self._snapped, ""
        return self._publish(kinematics, joints, mounts, snapped, begin, share)

    def _search(
        self, kinematics: Kinematics, joints: np.ndarray, mounts: np.ndarray
    ) -> tuple[Status, str, int] | None:
        problem = super()._search(kinematics, joints, mounts)
        if problem is not None and self._approached(kinematics, joints, mounts):
            return None
        return problem

    def _approached(self, kinematics: Kinematics, joints: np.ndarray, mounts: np.ndarray) -> bool:
        """Lead it from where it hangs clear: obstacles come to it against its load; whether they arrive."""
        end = next((end for end in self.loose if end.free), None)
        if end is None or self.run.supports:
            return False
        load = self.pieces[0].weight * self.run.length + end.pull(mounts[-end.which, end.which])
        size = float(np.linalg.norm(load))
        if size == 0.0:
            return False
        away = Away(kinematics, FAR * self.run.length / size * load)
        far, near = np.append(joints, 1.0), np.append(joints, 0.0)
        if super()._search(away, far, mounts) is not None:
            return False
        for _ in range(APPROACHES):
            if self._follow(away, near, 0)[1] is None:
                break
            if np.array_equal(self._joints, near):
                assert self.state is not None
                for piece in self.pieces:
                    piece.has_come_to(joints)
                # the path that led here is one of another joint, too
                self._joints, self._steps = joints, ()
                self._keep()
                return True
        self.state = None
        return False

    def _forget(self, cause: str) -> None:
        """Forget the equilibrium; what is found next is another one, maybe, until `reset`."""
        self.reset()
        self._lost = cause

    def _out_of_reach(self, mounts: np.ndarray) -> tuple[str, int] | None:
        """A sentence if its supports are too far apart, and which piece it is about; None if they are not."""
        if not (self.run.start.holds and self.run.end.holds):
            return None
        chords = [math.dist(start[:3], end[:3]) for start, end in mounts.tolist()]
        cuts = [0.0, *self.arcs.tolist(), self.run.length]
        fixed = [0, *(j for j, slides in enumerate(self._guides.tolist(), 1) if not slides), len(chords)]
        for a, b in itertools.pairwise(fixed):
            chord, length = sum(chords[a:b]), cuts[b] - cuts[a]
            if chord >= self.pieces[0].longest * length:
                way = "way through its rings and tubes" if b > a + 1 else "distance between its supports"
                more = (
                    f"{(chord - length) * 1e3:.4g} mm longer than" if chord - length > 1e-9 else "as long as"
                )
                return f"The {way} is {more} the cable there ({length:g} m).", a
        return None

    def _publish(
        self, kinematics: Kinematics, joints: np.ndarray, mounts: np.ndarray, snapped: str, begin: float,
        share: Callable[[], None],
    ) -> list[Equilibrium]:  # fmt: skip
        """The results of the pieces; `snapped`: a sentence if the cable did so on the way."""
        for _ in range(3):
            places = self.places(mounts)
            if self._guides.any():
                share()
            meshes = [piece.mesh for piece in self.pieces]
            found = [
                piece.publish(place.poses, begin) for piece, place in zip(self.pieces, places, strict=True)
            ]
            if all(piece.mesh is mesh for piece, mesh in zip(self.pieces, meshes, strict=True)):
                break
            # other meshes: the balance of the supports is another by their error
            assert self.state is not None
            self._set_clear(not self.rubbing)
            kept = self._kept
            self._keep()  # a step with friction begins at what was kept, on its mesh
            exact = self._newton(kinematics, joints, mounts, self.state)
            if exact is None and self.loose:
                self._kept = kept
                self._return()  # from there it goes on to the next pose
                return self._failed(Status.NOT_CONVERGED, OUT_OF_BALANCE, begin)
            if exact is None:
                break
            self._accept(joints, exact)
        assert self.state is not None
        if not self._remembered:
            self._keep()
        tangent = self.tangent(mounts, self.state)
        out = []
        for i, one in enumerate(found):
            inner, touching = np.concatenate([one.start_wrench, one.end_wrench]), one._touching
            wrenches = tangent.pieces[i].on_mounts(inner)
            for end, tip, loose in zip(self.loose, self.state.tips, tangent.loose, strict=True):
                if i == end.which * (len(found) - 1):
                    own = slice(6 * end.which, 6 * end.which + 6)
                    wrenches[own] = end.wrench(tip, inner[own])
                    if tip.face is not None:
                        piece, push = self.pieces[i], loose.push(inner[own])[3:]
                        arc = piece.length * end.which
                        touching = partial(with_tip, touching, piece.names, tip, push, arc)
            fields: dict[str, Any] = {
                "start_wrench": wrenches[:6], "end_wrench": wrenches[6:], "_mounts": mounts[i, :, 3:].copy(),
                "_tangent": tangent.pieces[i] if len(found) > 1 else Whole(tangent),
                "_coupled": tangent if i == 0 and len(found) > 1 else None, "_touching": touching,
                "stability_margin": min(one.stability_margin, self.margin),
            }  # fmt: skip
            if i == 0 and self.loose:
                fields |= self._of_loose_ends(kinematics, joints, mounts, one, fields["stability_margin"])
            if one.status is Status.CONVERGED and snapped:
                fields |= {"status": Status.SNAPPED, "message": snapped if i == 0 else ""}
            out.append(one.completed(fields))
            begin = time.perf_counter()
        return out

    def _of_loose_ends(
        self, kinematics: Kinematics, joints: np.ndarray, mounts: np.ndarray, one: Equilibrium, margin: float
    ) -> dict[str, Any]:
        """Fields of the result `one` of the first piece that loose ends change; `margin`: of the cable."""
        assert self.state is not None
        out: dict[str, Any] = {"energy": one.energy + self._given(mounts, self.state)}
        if margin < FREE_TO_TURN and one.status.trusted:
            out["stability_margin"] = 0.0
            out["message"] = FREE if one.message == Status.CONVERGED.sentence else one.message
        return out

    def _failed(self, status: Status, message: str, begin: float, where: int = 0) -> list[Equilibrium]:
        """Results without numbers; `message`: of the piece `where`."""
        seconds = time.perf_counter() - begin
        return [
            piece.failed(status, message if i == where else "", seconds if i == where else 0.0)
            for i, piece in enumerate(self.pieces)
        ]


def _loose(scene: Scene, run: Cable) -> tuple[LooseEnd, ...]:
    """The ends of a run that are solved as its supports are: those that are not clamps, among obstacles or of
    a cable that strains.
    """
    return loose_ends(run) if scene.has_contact or scene.strains(run) else ()


def kinds(scene: Scene) -> list[Callable[..., CableTracker]]:
    """What tracks each of `Scene.pieces`."""
    if scene.cable_contact:
        return [RubbingCable if scene.cable_friction else CrossingCable] * len(scene.cables)
    return [_kind(scene, run) for cable in scene.cables for run in cable.runs for _ in run.pieces]


def _kind(scene: Scene, run: Cable) -> Callable[..., CableTracker]:
    """What tracks each piece of a run."""
    if _loose(scene, run):
        return LoosePiece
    return SharedPiece if run.supports else CableTracker


def coupled_pieces(scene: Scene, tracked: Sequence[CableTracker]) -> tuple[CoupledPieces, ...]:
    """The runs of pieces that share supports; `tracked`: of `Scene.pieces`."""
    out, first = [], 0
    for cable in scene.cables:
        for run in cable.runs:
            pieces = tracked[first : first + len(run.pieces)]
            loose = _loose(scene, run)
            if run.supports or loose:
                shared = [piece for piece in pieces if isinstance(piece, SharedPiece)]
                out.append(CoupledPieces(run, shared, first, loose))
            first += len(pieces)
    return tuple(out)
