# SPDX-License-Identifier: Apache-2.0
"""What `cable compile` compiles with two processes."""

from __future__ import annotations

from multiprocessing import active_children

import pytest

from cable_ros import warm_up
from cable_ros.cli.compile import _helped
from cable_ros.cli.main import main
from cable_ros.common.compile_watch import COMPILING


@pytest.fixture
def told(monkeypatch):
    """How often it was told that something is compiled."""
    told = []
    monkeypatch.setattr(COMPILING, "tell", lambda: told.append("compiling"))
    return told


def test_a_helper_comes_with_the_first_compilation_and_goes_with_the_work(told):
    with _helped():
        assert active_children() == []
        COMPILING.tell()
        assert len(active_children()) == 1
    assert active_children() == []
    assert told == ["compiling"]


def test_nobody_helps_where_nothing_is_compiled(told):
    before = COMPILING.tell
    with _helped():
        pass
    assert COMPILING.tell is before


def test_the_helper_begins_at_the_other_end(monkeypatch):
    tried = []
    for name in ("_rehearse_still", "_rehearse_arm", "_rehearse_drawn"):
        monkeypatch.setattr(warm_up, name, lambda *arguments: tried.append(arguments))
    warm_up.rehearse_all()
    forwards = tried.copy()
    tried.clear()
    warm_up.rehearse_all(backwards=True)
    assert len(tried) > 5
    assert tried == forwards[::-1]


def test_more_than_two_processes_are_refused(capsys):
    assert main(["compile", "--jobs", "3"]) == 2
    assert "choose from" in capsys.readouterr().err
