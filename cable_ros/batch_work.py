# SPDX-License-Identifier: Apache-2.0
"""The pieces of work of a batch: they go to other processes or machines, and give the same bits on each."""

from __future__ import annotations

import dataclasses
import threading
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cable_ros.batch_result import PER_CABLE, Batch, with_snaps
from cable_ros.equilibrium import Equilibrium, Status
from cable_ros.joint import joint_torques
from cable_ros.limits import QUANTITIES
from cable_ros.scene import Kinematics, Scene
from cable_ros.scene.model import FREE
from cable_ros.tracker import Tracker

CHUNK = 64
"""Poses that one process solves in a row. Fixed, so that the number of processes changes no result."""
_SAME_WRENCH = 0.005  # part of the end wrench by which results of one branch may differ
_SAME_TWIST = 0.1  # rad


@dataclass(frozen=True)
class Job:
    """A scene, and how it is to be solved."""

    key: str
    """Of no other job, on whatever machine."""
    scene: Scene
    tolerance: float
    polyline_points: int
    stiffness: bool


@dataclass(frozen=True)
class Path:
    """Poses (m, n) of a path, and the state of a tracker that has come to the first one; None: cold."""

    job: Job
    poses: np.ndarray
    state: bytes | None
    snapped: np.ndarray
    """(c,) bool: whether the cables snapped on the way to that pose."""


@dataclass(frozen=True)
class Chunk:
    """Poses (m, n) to solve in a row from a tracker's state, and the pose after them (0 or 1, n)."""

    job: Job
    poses: np.ndarray
    state: bytes
    snapped: np.ndarray
    after: np.ndarray


@dataclass(frozen=True)
class Done:
    """A chunk's results, and where the path arrives then."""

    batch: Batch
    arrival: Batch | None
    state: bytes | None


def has_friction(scene: Scene) -> bool:
    """Whether equilibria depend on the path on which they are reached."""
    rings = any(support.friction for cable in scene.cables for support in cable.supports)
    return rings or any(obstacle.friction for obstacle in scene.obstacles)


def in_one(scene: Scene) -> bool:
    """Whether a path is not cut into chunks: friction remembers it, or pieces of a cable have branches."""
    return has_friction(scene) or any(cable.supports for cable in scene.cables)


def as_poses(path: np.ndarray, names: Sequence[str]) -> np.ndarray:
    """The path as (m, n) poses of the joints `names`; raises ValueError for another shape."""
    poses = np.asarray(path, dtype=float)
    if poses.ndim == 1 and len(names) == 1:
        poses = poses[:, None]
    if poses.ndim != 2 or poses.shape[1] != len(names) or not len(poses):
        wanted = f"(m, {len(names)}), a column for each of {', '.join(names) or 'no joint'}"
        raise ValueError(f"joints has the shape {np.shape(path)}; it must be {wanted}, with at least one row")
    return poses


def paths_of(job: Job, paths: Sequence[np.ndarray]) -> Iterator[Path]:
    """The paths, each with the state of a tracker that has come to its first pose."""
    names = Kinematics(job.scene).joint_names
    nothing = np.zeros(len(job.scene.cables), dtype=bool)
    if len(paths) == 1:
        yield Path(job, as_poses(paths[0], names), None, nothing)
        return
    scout = Tracker(job.scene, job.tolerance, 2)
    state: bytes | None = None
    for path in paths:
        poses = as_poses(path, names)
        if state is not None:
            scout.restore(state)
        found = scout.arrive(dict(zip(names, poses[0].tolist(), strict=True)))
        state = scout.snapshot()
        snapped = np.array([one.status is Status.SNAPPED for one in found.values()])
        yield Path(job, poses, state, snapped)


def chunks(path: Path) -> Iterator[Chunk]:
    """The chunks of a path. If friction makes the result depend on the whole way, it is one chunk."""
    job, poses = path.job, path.poses
    scout = Tracker(job.scene, job.tolerance, 2)
    if path.state is not None:
        scout.restore(path.state)
    snapped = path.snapped
    stride = len(poses) if in_one(job.scene) else CHUNK
    for begin in range(0, len(poses), stride):
        if begin or path.state is None:
            scout.arrive(dict(zip(scout.joint_names, poses[begin].tolist(), strict=True)))
        end = begin + stride
        yield Chunk(job, poses[begin:end], scout.snapshot(), snapped, poses[end : end + 1])
        snapped = np.zeros_like(snapped)


def joined(before: Done | None, chunk: Chunk, done: Done, solve: Callable[[Chunk], Done]) -> Done:
    """What is done of a chunk, where the path arrives; `before`: done of the chunk before it."""
    if before is None or before.arrival is None:
        return done
    assert before.state is not None
    arrival = before.arrival
    if not _agree(chunk.job, arrival, done.batch):
        # What lies between two strides has changed the branch: go on from where the path came.
        done = solve(dataclasses.replace(chunk, state=before.state))
    snapped = arrival.status[0] == Status.SNAPPED
    return dataclasses.replace(done, batch=with_snaps(done.batch, snapped))


def _agree(job: Job, arrival: Batch, batch: Batch) -> bool:
    """Whether the first pose of `batch` is on the branches on which the path arrives there."""
    per_length = np.array([[1.0] * 3 + [1.0 / cable.length] * 3 for cable in job.scene.cables])
    free = np.array([[cable.end.kind == FREE] for cable in job.scene.cables])  # whose wrench is given
    ours, theirs = (
        np.where(free, one.start_wrench[0], one.end_wrench[0]) * per_length for one in (arrival, batch)
    )
    size = np.linalg.norm(ours, axis=1) + np.linalg.norm(theirs, axis=1)
    far = np.linalg.norm(ours - theirs, axis=1) > max(_SAME_WRENCH, job.tolerance) * size
    turned = np.abs(arrival.total_twist[0] - batch.total_twist[0]) > _SAME_TWIST
    # NaN, where neither is trusted, is not far.
    return not (far | turned | (arrival.trusted[0] != batch.trusted[0])).any()


class _Latest(threading.local):
    """The tracker of the job that this thread worked at last: trackers are not shared between threads."""

    key = ""
    tracker: Tracker


_LATEST = _Latest()


def solve(work: Path | Chunk) -> list[Done]:
    """What a process does: a chunk, or all chunks of a path."""
    if isinstance(work, Chunk):
        return [_solve_chunk(work)]
    out: list[Done] = []
    for chunk in chunks(work):
        before = out[-1] if out else None
        out.append(joined(before, chunk, _solve_chunk(chunk), _solve_chunk))
    # Where it arrives within a path has been looked at.
    return [Done(done.batch, None, None) for done in out]


def _solve_chunk(chunk: Chunk) -> Done:
    job = chunk.job
    if _LATEST.key != job.key:
        _LATEST.key, _LATEST.tracker = job.key, Tracker(job.scene, job.tolerance, job.polyline_points)
    tracker = _LATEST.tracker
    tracker.restore(chunk.state)
    batch = with_snaps(_solve_row(job, tracker, chunk.poses), chunk.snapped)
    if not len(chunk.after):
        return Done(batch, None, None)
    return Done(batch, _solve_row(job, tracker, chunk.after), tracker.snapshot())


def _solve_row(job: Job, tracker: Tracker, poses: np.ndarray) -> Batch:
    names = tracker.joint_names
    rows = [tracker.arrive(dict(zip(names, pose, strict=True))) for pose in poses.tolist()]
    cables = tuple(cable.name for cable in job.scene.cables)
    arrays: dict[str, Any] = {
        name: np.array([[getattr(row[cable], name) for cable in cables] for row in rows])
        for name in (*PER_CABLE, *(["stiffness"] if job.stiffness else []))
    }
    if any(cable.limits is not None for cable in job.scene.cables):
        arrays["extremes"] = np.array([[_extremes(row[cable]) for cable in cables] for row in rows])
    batch = Batch(cables, names, poses, joint_torques(tracker, rows, poses), **arrays)
    refused = ~batch.trusted
    for values in arrays.values():
        if values.dtype == float:
            values[refused] = np.nan
    supports = tuple((cable.name, one.name) for cable in job.scene.cables for one in cable.supports)
    if not supports:
        return batch
    wrenches = [[_support_wrench(row[cable], name) for cable, name in supports] for row in rows]
    return dataclasses.replace(batch, supports=supports, support_wrench=np.array(wrenches))


def _support_wrench(found: Equilibrium, name: str) -> np.ndarray:
    """(6,) of a trusted result, otherwise NaN."""
    return found.support_wrenches[name] if found.status.trusted else np.full(6, np.nan)


def _extremes(found: Equilibrium) -> np.ndarray:
    """(4, 2) value and arc length of each extreme; NaN without any."""
    out = np.full((len(QUANTITIES), 2), np.nan)
    for row, extreme in zip(out, found.extremes, strict=False):
        row[:] = extreme.value, extreme.arc_length
    return out
