# SPDX-License-Identifier: Apache-2.0
"""A batch in any order and on any executor: the same bits, also after a process has died."""

from __future__ import annotations

import dataclasses
import multiprocessing
import os
import signal
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor

import numpy as np
import pytest
from references import planar
from zoo_make import led

from cable_ros import Status, Tracker, batch, load_scene
from cable_ros.batch import CHUNK, WHOLE, Batch, concatenate, solve_many, solve_paths
from cable_ros.bench.cases import case_scene
from cable_ros.common import processes
from cable_ros.share import share_file

ANGLES = np.radians(np.linspace(-90, 90, 5 * CHUNK + 7))
MANY = 60  # of these take far longer than a process needs to start


@pytest.fixture(scope="module")
def arm():
    return load_scene(share_file("config", "space_arm.yaml"))


@pytest.fixture(scope="module")
def alone(arm):
    return solve_many(arm, ANGLES)


def same(a: Batch, b: Batch) -> bool:
    names = [field.name for field in dataclasses.fields(Batch)][2:-2]
    pairs = [(getattr(a, name), getattr(b, name)) for name in names]
    return all(
        one is other if one is None else np.array_equal(one, other, equal_nan=one.dtype == float)
        for one, other in pairs
    )


@pytest.fixture(params=["fork", "spawn"])
def at_once(request, monkeypatch):
    """Processes that start either way and need not wait."""
    monkeypatch.setattr(processes, "_start_method", lambda: request.param)
    monkeypatch.setattr(processes, "ALONE", 0.0)


@pytest.fixture(scope="module")
def jobs(arm):
    return [(arm, [ANGLES] * MANY)]


@pytest.fixture(scope="module")
def here(jobs):
    return concatenate([part for _, part in solve_paths(jobs)])


@pytest.mark.parametrize("kill", [False, True], ids=["all live", "one is killed"])
def test_processes_give_the_same_bits(jobs, here, at_once, monkeypatch, kill):
    """One is killed as soon as they take part, in the middle of its work."""
    pool = processes.Processes(2)
    monkeypatch.setattr(batch, "_pool", lambda *_: pool)
    there = []
    victim = None
    for _, part in solve_paths(jobs, workers=2):
        there.append(part)
        if kill and victim is None and pool._up:
            victim = multiprocessing.active_children()[0]
            os.kill(victim.pid, signal.SIGKILL)
    assert pool._up, "the processes took no part: more work is needed"
    assert pool._renewals == kill
    assert same(concatenate(there), here)


def test_threads_give_the_same_bits(arm, alone):
    with ThreadPoolExecutor(3) as executor:
        assert same(solve_many(arm, ANGLES, workers=3, executor=executor), alone)
        # Several scenes take turns in each of the threads.
        jobs = [(arm, [ANGLES[:9], ANGLES[5:90]]), (arm, [ANGLES[20:30]])] * 3
        solved = solve_paths(jobs, workers=3, executor=executor)
        assert same(
            concatenate([part for _, part in solved]), concatenate([part for _, part in solve_paths(jobs)])
        )


def test_an_executor_stays_the_caller_s(arm, alone):
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as executor:
        for _ in range(2):
            assert same(solve_many(arm, ANGLES, executor=executor), alone)


def test_a_path_at_once_is_the_same_as_its_chunks(arm, monkeypatch):
    jobs = [(arm, [ANGLES[:3], ANGLES, np.linspace(0.1, 0.2, WHOLE + 1)])]
    at_once = [batch for _, batch in solve_paths(jobs)]
    assert [len(batch) for batch in at_once] == [3, *[CHUNK] * 5, 7, *[CHUNK] * 8, 1]
    monkeypatch.setattr(batch, "WHOLE", 0)
    assert same(concatenate(at_once), concatenate([part for _, part in solve_paths(jobs)]))


def test_an_unfinished_sweep_leaves_no_work(arm):
    futures = []

    class Executor(ThreadPoolExecutor):
        def submit(self, *arguments):
            futures.append(super().submit(*arguments))
            return futures[-1]

    with Executor(1) as executor:
        solved = solve_paths([(arm, [ANGLES] * 20)], workers=4, executor=executor)
        next(solved)
        solved.close()
        # One may be running, and a few are done.
        assert sum(future.cancelled() for future in futures) >= 8


def test_a_set_of_poses_is_walked_on_a_short_path(arm):
    """Iterations are the work; each pose far from the one before it takes ten times as many."""
    rng = np.random.default_rng(2)
    shuffled = rng.permutation(ANGLES)
    found = solve_many(arm, shuffled)
    assert np.array_equal(found.joints[:, 0], shuffled)
    as_given = concatenate([part for _, part in solve_paths([(arm, [shuffled])])])
    assert found.iterations.sum() < 0.5 * as_given.iterations.sum()
    scale = np.linalg.norm(as_given.end_wrench, axis=-1, keepdims=True)
    # Each within the tolerance of 1e-4 of the truth, force and moment together.
    assert (np.abs(found.end_wrench - as_given.end_wrench) < 4e-4 * scale).all()
    with ThreadPoolExecutor(2) as executor:
        assert same(solve_many(arm, shuffled, workers=2, executor=executor), found)


def test_what_is_no_pose_does_not_disturb_the_others(arm):
    shuffled = np.random.default_rng(2).permutation(ANGLES)
    shuffled[[5, 77]] = np.nan, 1e9
    found = solve_many(arm, shuffled)
    assert np.flatnonzero(~found.trusted[:, 0]).tolist() == [5, 77]
    assert np.array_equal(found.joints[:, 0], shuffled, equal_nan=True)


def _as_given(scene, poses: np.ndarray) -> None:
    assert same(solve_many(scene, poses), concatenate([part for _, part in solve_paths([(scene, [poses])])]))


def test_friction_keeps_the_order():
    ball = load_scene(share_file("config", "space_arm_sphere.yaml"))
    poses = np.random.default_rng(5).permutation(np.radians(np.linspace(0.0, 60.0, CHUNK + 4)))
    _as_given(ball, poses[:, None])


def _arch(yaw: np.ndarray):
    """A buckled strip that snaps through when it is turned by 40 degrees or so, either way."""
    case = led("arch", "", planar.buckled(1.0, 1.0, 0.9).scene(), [{"yaw": angle} for angle in yaw])
    scene = case_scene(case)
    return scene, np.array([[pose[name] for name in Tracker(scene).joint_names] for pose in case.path])


def test_a_fold_keeps_the_order():
    scene, poses = _arch(np.random.default_rng(6).permutation(np.radians(np.linspace(-60, 60, CHUNK + 9))))
    _as_given(scene, poses)
    assert (solve_many(scene, poses).status == Status.SNAPPED).any()


def test_a_snap_from_one_chunk_to_the_next_is_told():
    yaw = np.radians(np.linspace(-20, 60, 2 * CHUNK))
    scene, poses = _arch(yaw)
    (snap,) = np.flatnonzero((solve_many(scene, poses).status == Status.SNAPPED)[:, 0])
    still = np.repeat(poses[:1], CHUNK, axis=0)
    for shift in (-1, 0, 1):  # the pose after the fold is the last of a chunk, the first or the second
        path = np.concatenate([still, poses])[snap + shift :]
        (at,) = np.flatnonzero((solve_many(scene, path).status == Status.SNAPPED)[:, 0])
        assert at == CHUNK - shift


def test_a_snap_from_one_path_to_the_next_is_told():
    scene, poses = _arch(np.radians([-20.0, -20.0, 60.0, 60.0]))
    for first in (poses[:1], poses[:2]):
        paths = [first, poses[2:]]
        statuses = np.concatenate([part.status[:, 0] for _, part in solve_paths([(scene, paths)])])
        assert statuses.tolist() == [Status.CONVERGED] * len(first) + [Status.SNAPPED, Status.CONVERGED]
