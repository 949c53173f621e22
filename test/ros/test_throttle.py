# SPDX-License-Identifier: Apache-2.0
"""Which sentences pass, without waiting: time stands still or jumps."""

from __future__ import annotations

import pytest

pytest.importorskip("rclpy", reason="the package cable_ros.ros needs rclpy")

from cable_ros.ros import throttle
from cable_ros.ros.throttle import MOST_KINDS, PERIOD, Throttle


@pytest.fixture
def clock(monkeypatch):
    now = [1000.0]
    monkeypatch.setattr(throttle.time, "monotonic", lambda: now[0])
    return now


def test_each_kind_passes_once_in_a_while(clock):
    told = Throttle()
    assert told.passes("The stamps went back by 1.5 s.")
    assert not told.passes("The stamps went back by -2e-05 s.")
    assert told.passes("The clock went back by 2 s.")
    clock[0] += PERIOD
    assert told.passes("The stamps went back by 3 s.")
    assert not told.passes("The stamps went back by 4 s.")


def test_a_number_in_a_name_makes_another_kind(clock):
    told = Throttle()
    assert told.passes("names 'joint_1' twice")
    assert told.passes("names 'joint_2' twice")


def test_many_kinds_are_forgotten_oldest_first(clock):
    told = Throttle()
    names = [f"kind_{i}x" for i in range(MOST_KINDS + 1)]
    assert all(map(told.passes, names))
    assert not told.passes(names[-1])
    assert told.passes(names[0])
