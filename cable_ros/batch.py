# SPDX-License-Identifier: Apache-2.0
"""Many poses at once: arrays in, arrays out, over one or several processes."""

from __future__ import annotations

import contextlib
import dataclasses
import itertools
import multiprocessing
import os
import signal
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from cable_ros.joint import joint_torques
from cable_ros.scene import Scene
from cable_ros.tracker import Tracker

CHUNK = 64
"""Poses that one process solves in a row. Fixed, so that the number of processes changes no result."""

_SAME_WRENCH = 0.005  # part of the end wrench by which results of one branch may differ
_SAME_TWIST = 0.1  # rad

SINGLE_THREADED = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


@dataclass(frozen=True)
class Batch:
    """Equilibria of m poses and c cables; fields as in `Equilibrium`, SI units.

    Where a status is not trusted, the numbers are NaN (`converged`, `stable`, `iterations` remain).
    """

    cables: tuple[str, ...]
    joint_names: tuple[str, ...]
    joints: np.ndarray
    """(m, n_joints) rad or m."""
    joint_load: np.ndarray
    """(m, n_joints) torque of all cables together on each joint, N m, or N on a prismatic one; NaN where one
    of them is not trusted."""
    status: np.ndarray
    """(m, c) of `Status`."""
    converged: np.ndarray
    """(m, c) bool."""
    stable: np.ndarray
    """(m, c) bool."""
    stability_margin: np.ndarray
    """(m, c)."""
    end_wrench: np.ndarray
    """(m, c, 6) what the cable exerts on the body at its end clamp, in that clamp's frame, N and N m."""
    start_wrench: np.ndarray
    """(m, c, 6) the same at the start clamp."""
    points: np.ndarray
    """(m, c, n, 3) centrelines, world, m."""
    orientations: np.ndarray
    """(m, c, n, 4) section frames x y z w, world."""
    total_twist: np.ndarray
    """(m, c) rad."""
    energy: np.ndarray
    """(m, c) J."""
    error_estimate: np.ndarray
    """(m, c) relative error of the end wrench."""
    iterations: np.ndarray
    """(m, c) int."""
    overlapping: np.ndarray
    """(m, c) bool: whether the cable meets itself or another one, which is not modelled."""
    stiffness: np.ndarray | None = None
    """(m, c, 6, 6) derivative of the end wrench by a small motion of the end clamp, in its frame; None unless
    it was asked for."""

    def __len__(self) -> int:
        return len(self.joints)

    def __repr__(self) -> str:
        cables, trusted = ", ".join(self.cables), int(self.trusted.all(axis=1).sum())
        return f"Batch({len(self)} poses of {cables}; {trusted} can be trusted)"

    @property
    def trusted(self) -> np.ndarray:
        """(m, c) bool: which numbers are to be believed."""
        return np.vectorize(lambda status: status.trusted, otypes=[bool])(self.status)


def solve_many(
    scene: Scene,
    joints: np.ndarray,
    *,
    tolerance: float = 1e-4,
    polyline_points: int = 2,
    workers: int = 1,
    stiffness: bool = False,
) -> Batch:
    """Equilibria along a path of poses.

    The first pose is solved cold. The path is walked in strides of `CHUNK` poses, each cable staying on its
    branch, and from each of these its stretch of the path is tracked pose by pose; where it then arrives at
    another branch than the stride (it has snapped on the way), the next stretch starts from there. With
    friction the whole path is one stretch. So the result is that of a tracker led along the path, and does
    not depend on `workers`.

    Args:
        scene: the scene.
        joints: (m, n_joints) joint values in the order of `Tracker.joint_names`, rad or m; (m,) for one.
        tolerance: relative error of the end wrench that is acceptable.
        polyline_points: points of each centreline, at least 2.
        workers: processes; 1 stays in this one. More need the caller's script to be importable
            (`if __name__ == "__main__":`), as everywhere in multiprocessing.
        stiffness: whether `Batch.stiffness` is wanted, which takes several times as long as the equilibrium.

    Raises:
        ValueError: `joints` is empty or has not one column for each joint.
    """
    return concatenate(
        [
            batch
            for _, batch in solve_paths([(scene, [joints])], tolerance, polyline_points, workers, stiffness)
        ]
    )


def solve_paths(
    jobs: Iterable[tuple[Scene, Sequence[np.ndarray]]],
    tolerance: float = 1e-4,
    polyline_points: int = 2,
    workers: int = 1,
    stiffness: bool = False,
) -> Iterator[tuple[int, Batch]]:
    """Several paths in each of several scenes: chunk after chunk, in order, each as soon as it is there.

    A scene's first path starts cold, every other one from the first pose of the path before it. Arguments
    and errors as in `solve_many`.

    Yields:
        The index of the job and the next chunk of one of its paths.
    """
    pending: deque[tuple[int, _Chunk, Future[_Done]]] = deque()
    before: _Done | None = None
    with _pool(workers) as submit:

        def first() -> tuple[int, Batch]:
            nonlocal before
            index, chunk, future = pending.popleft()
            done = future.result()
            arrival = before.arrival if before is not None else None
            if before is not None and arrival is not None and not _agree(chunk.job, arrival, done.batch):
                # What lies between two strides has changed the branch: go on from where the path came.
                chunk = dataclasses.replace(chunk, state=before.state)
                done = submit(_solve_chunk, chunk).result()
            before = done
            return index, done.batch

        for index, (scene, paths) in enumerate(jobs):
            for chunk in _chunks(_Job(next(_numbers), scene, tolerance, polyline_points, stiffness), paths):
                pending.append((index, chunk, submit(_solve_chunk, chunk)))
                while len(pending) > 4 * workers:  # enough to keep every process busy
                    yield first()
        while pending:
            yield first()


def _chunks(job: _Job, paths: Sequence[np.ndarray]) -> Iterator[_Chunk]:
    """The chunks of the paths, each with the state of a tracker that has come to its first pose.

    Where friction makes the result depend on the whole way, a path is one chunk.
    """
    scout = Tracker(job.scene, job.tolerance, 2)
    friction = any(obstacle.friction for obstacle in job.scene.obstacles)
    start: Any = None
    for path in paths:
        poses = _as_poses(path, scout.joint_names)
        if start is not None:
            scout.restore(start)
        stride = len(poses) if friction else CHUNK
        for begin in range(0, len(poses), stride):
            scout.arrive(dict(zip(scout.joint_names, poses[begin].tolist(), strict=True)))
            if begin == 0:
                start = scout.snapshot()
            end = begin + stride
            yield _Chunk(job, scout.snapshot(), poses[begin:end], poses[end : end + 1])


def _agree(job: _Job, arrival: Batch, batch: Batch) -> bool:
    """Whether the first pose of `batch` is on the branches on which the path arrives there."""
    per_length = np.array([[1.0] * 3 + [1.0 / cable.length] * 3 for cable in job.scene.cables])
    ours, theirs = arrival.end_wrench[0] * per_length, batch.end_wrench[0] * per_length
    size = np.linalg.norm(ours, axis=1) + np.linalg.norm(theirs, axis=1)
    far = np.linalg.norm(ours - theirs, axis=1) > max(_SAME_WRENCH, job.tolerance) * size
    turned = np.abs(arrival.total_twist[0] - batch.total_twist[0]) > _SAME_TWIST
    # NaN, where neither is trusted, is not far.
    return not (far | turned | (arrival.trusted[0] != batch.trusted[0])).any()


def concatenate(batches: Sequence[Batch]) -> Batch:
    """The batches, of the same scene, as one."""
    first = batches[0]
    if len(batches) == 1:
        return first
    names = ["joints", "joint_load", *_PER_CABLE, *(["stiffness"] if first.stiffness is not None else [])]
    arrays = {name: np.concatenate([getattr(batch, name) for batch in batches]) for name in names}
    return Batch(first.cables, first.joint_names, **arrays)


_PER_CABLE = tuple(field.name for field in fields(Batch))[4:-1]
_numbers = itertools.count()


@dataclass(frozen=True)
class _Job:
    number: int
    scene: Scene
    tolerance: float
    polyline_points: int
    stiffness: bool


@dataclass(frozen=True)
class _Chunk:
    """Poses (m, n) to solve in a row from a tracker's state, and the pose after them (0 or 1, n)."""

    job: _Job
    state: Any
    poses: np.ndarray
    after: np.ndarray


@dataclass(frozen=True)
class _Done:
    """A chunk's results, and where the path arrives then."""

    batch: Batch
    arrival: Batch | None
    state: Any


_latest: tuple[int, Tracker] | None = None  # the tracker of the job that this process worked at last


def _solve_chunk(chunk: _Chunk) -> _Done:
    global _latest
    job = chunk.job
    if _latest is None or _latest[0] != job.number:
        _latest = job.number, Tracker(job.scene, job.tolerance, job.polyline_points)
    tracker = _latest[1]
    tracker.restore(chunk.state)
    batch = _solve_row(job, tracker, chunk.poses)
    if not len(chunk.after):
        return _Done(batch, None, None)
    return _Done(batch, _solve_row(job, tracker, chunk.after), tracker.snapshot())


def _solve_row(job: _Job, tracker: Tracker, poses: np.ndarray) -> Batch:
    names = tracker.joint_names
    rows = [tracker.arrive(dict(zip(names, pose, strict=True))) for pose in poses.tolist()]
    cables = tuple(cable.name for cable in job.scene.cables)
    arrays = {
        name: np.array([[getattr(row[cable], name) for cable in cables] for row in rows])
        for name in (*_PER_CABLE, *(["stiffness"] if job.stiffness else []))
    }
    batch = Batch(cables, names, poses, joint_torques(tracker, rows, poses), **arrays)
    refused = ~batch.trusted
    for values in arrays.values():
        if values.dtype == float:
            values[refused] = np.nan
    return batch


def _as_poses(path: np.ndarray, names: Sequence[str]) -> np.ndarray:
    poses = np.asarray(path, dtype=float)
    if poses.ndim == 1 and len(names) == 1:
        poses = poses[:, None]
    if poses.ndim != 2 or poses.shape[1] != len(names) or not len(poses):
        wanted = f"(m, {len(names)}), a column for each of {', '.join(names) or 'no joint'}"
        raise ValueError(f"joints has the shape {np.shape(path)}; it must be {wanted}, with at least one row")
    return poses


@contextlib.contextmanager
def _pool(workers: int) -> Iterator[Callable[..., Future[_Done]]]:
    """Gives the function that has a chunk solved: here for one worker, else by that many processes."""
    if workers <= 1:
        yield _solve_here
        return
    threads = {name: os.environ.get(name) for name in SINGLE_THREADED}
    os.environ.update(dict.fromkeys(SINGLE_THREADED, "1"))  # the processes are the parallelism
    executor = ProcessPoolExecutor(
        workers,
        multiprocessing.get_context("spawn"),
        initializer=signal.signal,
        initargs=(signal.SIGINT, signal.SIG_IGN),
    )
    try:
        yield executor.submit
    finally:
        executor.shutdown(cancel_futures=True)
        for name, value in threads.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _solve_here(function: Callable[..., _Done], *arguments: Any) -> Future[_Done]:
    future: Future[_Done] = Future()
    future.set_result(function(*arguments))
    return future
