# SPDX-License-Identifier: Apache-2.0
"""Processes wait for each other, as long as they live, and no longer than they must."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path

import pytest

from cable_ros.common import alone as module
from cable_ros.common.alone import alone

HOLD = """
import sys, time
from pathlib import Path
from cable_ros.common.alone import alone
with alone(Path(sys.argv[1]), "it"):
    print("has it", flush=True)
    time.sleep(100)
"""
ROOT = Path(__file__).parents[2]


@pytest.fixture
def file(tmp_path):
    return tmp_path / "lock"


@pytest.fixture
def holder(file):
    """A process that does what is called 'it'."""
    with subprocess.Popen(
        [sys.executable, "-c", HOLD, file], cwd=ROOT, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "has it\n"
        yield process
        process.kill()


def waited(file: Path, name: str) -> float:
    """Seconds until it was our turn."""
    begin = time.monotonic()
    with alone(file, name):
        return time.monotonic() - begin


def test_who_is_second_waits_as_long_as_it_may(file, holder, monkeypatch):
    monkeypatch.setattr(module, "PATIENCE", 0.3)
    assert waited(file, "it") > 0.3
    assert waited(file, "something else") < 0.2


def test_nobody_waits_for_a_process_that_has_died(file, holder):
    holder.kill()
    holder.wait()
    assert waited(file, "it") < 5.0


def test_a_thing_within_a_thing_and_once_more(file):
    with alone(file, "it"), alone(file, "part of it"), alone(file, "it"):
        pass
    assert waited(file, "it") < 0.2


def test_where_no_file_can_be_nobody_waits(tmp_path):
    assert waited(tmp_path / "no folder" / "lock", "it") < 0.2
