# SPDX-License-Identifier: Apache-2.0
"""Many poses at once: arrays in, arrays out, over one or several processes or machines."""

from __future__ import annotations

import uuid
from collections import deque
from collections.abc import Generator, Iterable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, Executor, Future
from dataclasses import dataclass

import numpy as np

from cable_ros.batch_result import Batch, concatenate, taken
from cable_ros.batch_work import (
    CHUNK,
    Chunk,
    Done,
    Job,
    Path,
    as_poses,
    chunks,
    has_friction,
    joined,
    paths_of,
    solve,
)
from cable_ros.common.processes import Elsewhere, Here, Processes
from cable_ros.common.short_path import along_curve
from cable_ros.equilibrium import Status
from cable_ros.scene import Kinematics, Scene
from cable_ros.tracker import ABSURD

__all__ = ["CHUNK", "Batch", "concatenate", "solve_many", "solve_paths"]

WHOLE = 8 * CHUNK
"""Poses of a path up to which one process solves all of it, if it is one of several."""
JUMPS = 0.2
"""Mean step, as a part of the range of the joint values, beyond which poses are a set and no path."""


def solve_many(
    scene: Scene,
    joints: np.ndarray,
    *,
    tolerance: float = 1e-4,
    polyline_points: int = 2,
    workers: int = 1,
    stiffness: bool = False,
    executor: Executor | None = None,
) -> Batch:
    """Equilibria along a path of poses, or of a set of them.

    The first pose is solved cold. The path is walked in strides of `CHUNK` poses, each cable staying on its
    branch, and from each of these its stretch of the path is tracked pose by pose; where it then arrives at
    another branch than the stride (it has snapped on the way), the next stretch starts from there. With
    friction the whole path is one stretch. So the result is that of a tracker led along the path, and does
    not depend on `workers` or `executor`.

    More than `CHUNK` poses that jump, by a fifth of their range on average, are no path but a set, such as
    random ones. They are solved along a short path that begins at the first pose, which is many times
    quicker, and come back in the caller's order. With friction, or if a cable snaps on that path, the
    equilibria depend on the order, and the caller's is kept.

    Args:
        scene: the scene.
        joints: (m, n_joints) joint values in the order of `Tracker.joint_names`, rad or m; (m,) for one.
        tolerance: relative error of the end wrench that is acceptable.
        polyline_points: points of each centreline, at least 2.
        workers: processes; 1 stays in this one. More need the caller's script to be importable
            (`if __name__ == "__main__":`), as everywhere in multiprocessing. With an executor: how many
            pieces of work it does at a time.
        stiffness: whether `Batch.stiffness` is wanted, which takes several times as long as the equilibrium.
        executor: where to solve instead, such as `distributed.Client.get_executor()`; it remains the
            caller's. This package must be installed there, in the same versions for the same bits.

    Raises:
        ValueError: `joints` is empty or has not one column for each joint.
        WorkersDiedError: processes died again and again; an executor's own errors are passed on.
    """

    def solved(*paths: np.ndarray) -> Batch:
        job = scene, paths
        return concatenate(
            [b for _, b in solve_paths([job], tolerance, polyline_points, workers, stiffness, executor)]
        )

    poses = as_poses(joints, Kinematics(scene).joint_names)
    order = None if has_friction(scene) else _short_order(poses)
    if order is None:
        return solved(poses)
    # The second path starts where the first one did.
    first = int(np.flatnonzero(order == 0)[0])
    walked = [part for part in (order[first:], order[:first][::-1]) if len(part)]
    batch = solved(*(poses[part] for part in walked))
    if {Status.SNAPPED, Status.BRANCH_LOST} & set(batch.status.ravel()):
        return solved(poses)
    return taken(batch, np.argsort(np.concatenate(walked)))


def solve_paths(
    jobs: Iterable[tuple[Scene, Sequence[np.ndarray]]],
    tolerance: float = 1e-4,
    polyline_points: int = 2,
    workers: int = 1,
    stiffness: bool = False,
    executor: Executor | None = None,
) -> Generator[tuple[int, Batch]]:
    """Several paths in each of several scenes: chunk after chunk, in order, each as soon as it is there.

    A scene's first path starts cold, every other one from the first pose of the path before it. Poses are
    solved in the order given. Arguments and errors as in `solve_many`.

    Yields:
        The index of the job and the next chunk of one of its paths.
    """
    pending: deque[_Pending] = deque()
    before: Done | None = None

    def result(piece: _Pending) -> list[Done]:
        """Of the piece of work; if its process has died, it is done again, with all that died with it."""
        while True:
            try:
                return piece.future.result()
            except BrokenExecutor:
                piece.future = pool.submit(solve, piece.work)
                for other in pending:
                    if other.died():
                        other.future = pool.submit(solve, other.work)

    def first() -> Iterator[tuple[int, Batch]]:
        nonlocal before
        dones = result(pending[0])
        piece = pending.popleft()
        if isinstance(piece.work, Chunk):

            def again(chunk: Chunk) -> Done:
                return result(_Pending(piece.index, chunk, pool.submit(solve, chunk)))[0]

            dones = [before := joined(before, piece.work, dones[0], again)]
        for done in dones:
            yield piece.index, done.batch

    with _pool(workers, executor) as pool:
        try:
            for index, (scene, paths) in enumerate(jobs):
                job = Job(uuid.uuid4().hex, scene, tolerance, polyline_points, stiffness)
                for number, path in enumerate(paths_of(job, paths)):
                    whole = len(path.poses) <= WHOLE and (index, number) != (0, 0)
                    for work in [path] if whole else chunks(path):
                        pending.append(_Pending(index, work, pool.submit(solve, work)))
                        while len(pending) > 4 * workers:  # enough to keep every process busy
                            yield from first()
            while pending:
                yield from first()
        finally:
            for piece in pending:
                piece.future.cancel()


@dataclass
class _Pending:
    """A piece of work of a job that somebody does."""

    index: int
    work: Path | Chunk
    future: Future[list[Done]]

    def died(self) -> bool:
        """Whether its process has died."""
        future = self.future
        return future.done() and not future.cancelled() and isinstance(future.exception(), BrokenExecutor)


def _short_order(poses: np.ndarray) -> np.ndarray | None:
    """The order (m,) of poses (m, n) along a short path; None for a path that is not to be changed."""
    usable = (np.abs(poses) <= ABSURD).all(axis=1)  # false for NaN
    if not usable[0] or usable.sum() <= CHUNK:
        return None
    places = poses[usable]
    steps = np.abs(np.diff(places, axis=0)).max(axis=1)
    if steps.mean() <= JUMPS * np.ptp(places, axis=0).max():
        return None
    return np.concatenate([np.flatnonzero(usable)[along_curve(places)], np.flatnonzero(~usable)])


def _pool(workers: int, executor: Executor | None) -> Here:
    if executor is not None:
        return Elsewhere(executor)
    return Processes(workers) if workers > 1 else Here()
