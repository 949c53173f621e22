# SPDX-License-Identifier: Apache-2.0
"""Kernels in the interpreter while another process compiles, or seems to."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from cable_ros import interpretation, kept_code
from cable_ros.compilation import INNER, njit
from cable_ros.interpretation import Interpretation, NotKeptError, begin, compiled_here, kept_only
from cable_ros.scene import load_scene
from cable_ros.share import share_file
from cable_ros.warm_up import _LOOSE

SCENE = load_scene(_LOOSE)
OTHER = load_scene(_LOOSE)
TOLD: list[str] = []


@njit(**INNER)
def divided(a, b):
    return a / b


@njit(cache=True, error_model="numpy")
def quotient(a):
    if a[0] < 0.0:
        raise ValueError("negative")
    return divided(a[0], a[1])


@pytest.fixture(autouse=True)
def unkept(monkeypatch):
    """No code is kept, SCENE is being solved, and the other process does nothing for ever."""
    forget()
    monkeypatch.setattr("cable_ros.compilation.load", lambda *_: None)
    monkeypatch.setattr(interpretation, "_CHILD", "import time; time.sleep(3600)")
    monkeypatch.setattr(interpretation, "ALLOWED", True)
    monkeypatch.setattr(Interpretation, "current", None)
    monkeypatch.setattr(Interpretation, "stopped", False)
    TOLD.clear()
    monkeypatch.setattr(Interpretation, "tell", TOLD.append)
    interpretation.solves(SCENE)
    yield
    end()
    interpretation._MINE.scene = None
    forget()


def forget() -> None:
    """The kernels have not been called, nor asked for their dispatcher, as by pytest's collection."""
    for kernel in (quotient, divided):
        vars(kernel).pop("dispatcher", None)
        kernel.forget_entry()


def end() -> None:
    """End the process that compiles, if any."""
    if (current := Interpretation.current) is not None:
        current.leave()


def compiles(kernel) -> bool:
    """Whether this process has compiled the kernel."""
    return "dispatcher" in vars(kernel)


def test_interpreted_until_the_other_process_has_ended():
    assert quotient(np.array([6.0, 3.0])) == 2.0
    assert quotient(np.array([6.0, 0.0])) == np.inf  # without a word, as compiled
    assert interpretation.is_under_way()
    assert not compiles(quotient)
    assert [interpretation.SENTENCE] == TOLD
    end()
    assert not interpretation.is_under_way()
    assert quotient(np.array([6.0, 4.0])) == 1.5
    assert compiles(quotient), "it was not kept, and there was a process for this scene"


def test_an_error_in_the_interpreter_is_no_reason_to_compile():
    with pytest.raises(ValueError, match="negative"):
        quotient(np.array([-1.0, 1.0]))
    assert not compiles(quotient)


def test_without_a_scene_it_is_compiled_here():
    interpretation._MINE.scene = None
    assert quotient(np.array([6.0, 3.0])) == 2.0
    assert compiles(quotient)
    assert Interpretation.current is None


def test_who_gets_code_ahead_compiles_it_here():
    with compiled_here():
        assert quotient(np.array([6.0, 3.0])) == 2.0
    assert compiles(quotient)


def test_only_what_is_kept():
    with kept_only(), pytest.raises(NotKeptError), compiled_here():
        quotient(np.array([6.0, 3.0]))
    assert quotient(np.array([6.0, 3.0])) == 2.0


def test_one_process_at_a_time_and_one_for_each_scene():
    first = begin(SCENE)
    assert begin(OTHER) is first
    end()
    assert begin(SCENE) is None
    second = begin(OTHER)
    assert second not in (first, None)
    end()
    assert begin(SCENE) is None


def test_where_it_is_of_no_use(monkeypatch):
    with monkeypatch.context() as one:
        one.setattr(interpretation, "ALLOWED", False)
        assert begin(SCENE) is None
    with monkeypatch.context() as one:
        one.setattr(interpretation, "parent_process", lambda: "one of several that solve")
        assert begin(SCENE) is None
    with monkeypatch.context() as one:
        one.setattr(sys, "executable", "/nowhere/python")
        assert begin(SCENE) is None
    with monkeypatch.context() as one:
        one.setattr(kept_code, "folders", lambda _: iter([Path(os.devnull)]))  # nobody's folder
        assert begin(SCENE) is None
    assert begin(SCENE) is not None


def test_a_stop_ends_what_is_interpreted():
    quotient(np.array([6.0, 3.0]))
    Interpretation.stopped = True
    with pytest.raises(KeyboardInterrupt):
        quotient(np.array([6.0, 3.0]))


def test_the_other_process_ends_with_this_one(tmp_path):
    """It is in the midst of compiling as this one has solved."""
    code = (
        "from cable_ros import Tracker\nfrom cable_ros.interpretation import Interpretation\nimport sys\n"
        "tracker = Tracker(sys.argv[1])\n"
        "found = tracker.solve(dict.fromkeys(tracker.joint_names, 0.0))['camera_cable']\n"
        "print(found.status.name, 'numba' in sys.modules, Interpretation.current._process.pid)\n"
    )
    command = [sys.executable, "-W", "ignore", "-c", code, str(share_file("config", "space_arm.yaml"))]
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path), "CABLE_ROS_INTERPRET": "1"}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    status, numba, child = done.stdout.split()
    assert (status, numba) == ("CONVERGED", "False")
    end = time.monotonic() + 10.0
    while Path(f"/proc/{child}").exists() and time.monotonic() < end:  # whoever inherits it may be slow
        time.sleep(0.05)
    assert not Path(f"/proc/{child}").exists()
