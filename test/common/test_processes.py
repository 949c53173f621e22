# SPDX-License-Identifier: Apache-2.0
"""Processes that start late, die, and are left: real ones."""

from __future__ import annotations

import multiprocessing
import os
import threading
import time
from concurrent.futures import BrokenExecutor

import pytest
from elsewhere import dies, dies_amid_a_message, sleeps, whose

from cable_ros.common import processes
from cable_ros.common.processes import Processes, WorkersDiedError
from cable_ros.scene import load_scene
from cable_ros.share import share_file

STARTS = ["fork", "spawn"]


@pytest.fixture(params=STARTS)
def start(request, monkeypatch):
    """Either way of starting, at once."""
    monkeypatch.setattr(processes, "_start_method", lambda: request.param)
    monkeypatch.setattr(processes, "ALONE", 0.0)
    return request.param


def _until_up(pool: Processes) -> None:
    while pool.submit(whose, 0).result() == os.getpid():
        time.sleep(0.01)


def test_this_process_works_until_others_are_up(start):
    with Processes(2) as pool:
        assert pool.submit(whose, 0).result() == os.getpid()
        _until_up(pool)
        assert len(multiprocessing.active_children()) == 2
    assert multiprocessing.active_children() == []


def test_little_work_starts_none():
    with Processes(2) as pool:
        assert pool.submit(whose, 0).result() == os.getpid()
        assert multiprocessing.active_children() == []


def test_processes_that_are_not_up_are_not_waited_for(monkeypatch):
    monkeypatch.setattr(processes, "ALONE", 0.0)
    with Processes(2) as pool:
        # Each would do the first piece of work, which for them takes longer than a test may.
        pool.submit(sleeps, os.getpid())
        assert len(multiprocessing.active_children()) == 2
    assert multiprocessing.active_children() == []


def test_after_an_exception_running_work_is_ended(start):
    pool = Processes(2)
    _until_up(pool)
    pool.submit(time.sleep, 3600)
    pool.__exit__(KeyboardInterrupt, KeyboardInterrupt(), None)
    assert multiprocessing.active_children() == []


def test_others_follow_one_that_died(start):
    with Processes(2) as pool:
        _until_up(pool)
        for _ in range(processes.RENEWALS):
            with pytest.raises(BrokenExecutor):
                pool.submit(dies, os.getpid()).result()
            assert pool.submit(whose, 0).result() != os.getpid()


def test_work_that_is_always_deadly_ends_with_a_sentence(start):
    with Processes(2) as pool:
        _until_up(pool)
        for _ in range(processes.RENEWALS + 1):
            with pytest.raises(BrokenExecutor):
                pool.submit(dies, os.getpid()).result()
        with pytest.raises(WorkersDiedError, match="the 2 processes that solve died 4 times; the memory may"):
            pool.submit(dies, os.getpid())


def test_libraries_of_new_processes_use_one_thread(monkeypatch):
    monkeypatch.setattr(processes, "_start_method", lambda: "spawn")
    monkeypatch.setattr(processes, "ALONE", 0.0)
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    monkeypatch.delenv("MKL_NUM_THREADS", raising=False)
    with Processes(2) as pool:
        _until_up(pool)
        assert pool.submit(os.getenv, "OMP_NUM_THREADS").result() == "1"
        assert pool.submit(os.getenv, "MKL_NUM_THREADS").result() == "1"
    assert os.environ["OMP_NUM_THREADS"] == "7"
    assert "MKL_NUM_THREADS" not in os.environ


def test_beside_other_threads_nothing_is_forked():
    done = threading.Event()
    other = threading.Thread(target=done.wait)
    other.start()
    assert processes._start_method() == "spawn"
    done.set()
    other.join()


def test_a_log_of_a_sweep_does_not_forbid_a_fork(tmp_path):
    """The thread of a node's log would: each process would then import and load all by itself."""
    batch_log = pytest.importorskip("cable_ros.ros.batch_log")
    scene = load_scene(share_file("config", "space_arm.yaml"))
    before = set(threading.enumerate())  # of other tests, which may end at any time
    with batch_log.BatchLog(tmp_path / "sweep.mcap", scene):
        assert set(threading.enumerate()) <= before


def test_one_that_dies_amid_a_message_holds_up_nobody(start, monkeypatch):
    """The rest of the message never comes; the executor waits for it, and all futures for the executor."""
    monkeypatch.setattr(processes, "GRACE", 0.2)
    with Processes(2) as pool:
        _until_up(pool)
        with pytest.raises(BrokenExecutor):
            pool.submit(dies_amid_a_message, os.getpid()).result(timeout=60.0)
        assert pool.submit(whose, 0).result(timeout=60.0) != os.getpid()
    assert multiprocessing.active_children() == []
