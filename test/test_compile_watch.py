# SPDX-License-Identifier: Apache-2.0
"""What compiling costs is measured, told once, and no part of a solve."""

from __future__ import annotations

import threading
import time

import numba

from cable_ros import Tracker, load_scene
from cable_ros.cli.main import main
from cable_ros.common import compile_watch
from cable_ros.common.compile_watch import COMPILING, GETTING, Watch
from cable_ros.share import share_file
from cable_ros.warm_up import rehearse_all

compile_watch.listen()
ARM = str(share_file("config", "space_arm.yaml"))


def compile_one():
    """Numba compiles something that it has never seen."""
    return numba.njit(lambda x: x + 1)(1)


def test_spans_within_others_count_once():
    watch = Watch()
    begin = time.perf_counter()
    watch.on_start()
    time.sleep(0.02)
    watch.on_start()
    time.sleep(0.02)
    watch.on_end()
    assert watch.seconds == 0.0  # the outer one has not ended
    watch.on_end()
    assert 0.04 <= watch.seconds <= time.perf_counter() - begin


def test_each_thread_has_its_own_time():
    watch = Watch()
    watch.on_start()
    others = []
    other = threading.Thread(target=lambda: (watch.on_start(), watch.on_end(), others.append(watch.seconds)))
    other.start()
    other.join()
    assert watch.seconds == 0.0
    watch.on_end()
    assert watch.seconds > others[0] > 0.0


def test_compiling_is_told_once_after_a_while(monkeypatch):
    told = []
    watch = Watch()
    watch.tell = lambda: told.append(watch.seconds)
    watch.on_start()
    watch.on_end()
    assert not told
    monkeypatch.setattr(compile_watch, "NOTICE", 0.0)
    for _ in range(2):
        watch.on_start()
        watch.on_end()
    assert len(told) == 1


def test_the_command_line_tells(monkeypatch, capsys):
    monkeypatch.setattr(compile_watch, "NOTICE", 0.0)
    solve = Tracker.solve

    def compiling(self, joints):
        compile_one()
        return solve(self, joints)

    monkeypatch.setattr(Tracker, "solve", compiling)
    assert main(["solve", ARM, "--joint", "orientation=0"]) == 0
    captured = capsys.readouterr()
    assert captured.err.startswith("cable: compiling the solver: once after an installation")
    assert captured.err.count("\n") == 1


def test_no_solve_time_counts_it(monkeypatch):
    tracker = Tracker(load_scene(ARM))
    (tracked,) = tracker._tracked_cables
    tracker.solve({"orientation": 0.0})
    solve, spent = tracked.solve, []

    def compiling(*arguments):
        before = GETTING.seconds, COMPILING.seconds
        compile_one()
        spent.extend((GETTING.seconds - before[0], COMPILING.seconds - before[1]))
        return solve(*arguments)

    monkeypatch.setattr(tracked, "solve", compiling)
    begin = time.perf_counter()
    (found,) = tracker.solve({"orientation": 0.01}).values()
    passed = time.perf_counter() - begin
    getting, compiled = spent
    assert getting >= compiled > 0.01
    assert found.solve_time <= passed - getting


def test_what_was_rehearsed_is_not_compiled_again(capsys):
    rehearse_all()
    before = COMPILING.seconds
    for scene in ("space_arm.yaml", "space_arm_sphere.yaml", "draped.yaml"):
        assert main(["compile", scene]) == 0
        assert f"{scene}: " in capsys.readouterr().out
    assert COMPILING.seconds == before
