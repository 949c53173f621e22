# SPDX-License-Identifier: Apache-2.0
"""`~/status`: bytes as rclpy has them, and what they say of cables that can and cannot be trusted."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path

import pytest

pytest.importorskip("rclpy", reason="rclpy is not on this machine")

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.serialization import deserialize_message, serialize_message

from cable_ros.branch.results import failed
from cable_ros.equilibrium import Overlap, Status
from cable_ros.ros.cable_outputs import level
from cable_ros.ros.status_message import CODES, NUMBERS, StatusMessage

SECOND = 1_000_000_000


def result(status, error=1e-5, margin=0.25):
    return replace(
        failed(Status.NOT_CONVERGED, "", 0.0, 2), status=status, error_estimate=error, stability_margin=margin
    )


def read(data):
    message = deserialize_message(data, DiagnosticArray)
    theirs = serialize_message(message)
    assert 0 <= len(theirs) - len(data) < 4  # rclpy pads the end
    return message


def values(entry):
    return {pair.key: pair.value for pair in entry.values}


def test_every_status_has_a_number_of_its_own():
    assert set(CODES) == set(Status)
    assert sorted(CODES.values()) == list(range(len(Status)))
    # Controllers on robots know these by heart.
    assert (CODES[Status.CONVERGED], CODES[Status.SNAPPED], CODES[Status.INVALID_INPUT]) == (0, 1, 6)


def test_the_docs_list_numbers_and_keys():
    text = (Path(__file__).parents[2] / "docs" / "ros.md").read_text()
    rows = re.findall(r"^\| (\d) \| ([A-Z_]+) \| (yes|no)\b", text, re.M)
    assert rows == [
        (str(code), status.name, "yes" if status.trusted else "no") for status, code in CODES.items()
    ]
    keys = re.findall(r"^\| (\d) \| `(.+?)` \|", text, re.M)
    data = StatusMessage(["a"], "").fill(0, {"a": result(Status.CONVERGED)})
    assert keys == [(str(index), key) for index, key in enumerate(values(read(data).status[0]))]


@pytest.mark.parametrize("status", Status)
def test_an_entry_says_all(status):
    cables = ["a", "camera_cable"]
    equilibria = {"camera_cable": result(status, 2.5e-3, -1e-120), "a": result(Status.CONVERGED)}
    message = read(StatusMessage(cables, "arm").fill(7 * SECOND + 5, equilibria))
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (7, 5)
    assert [entry.name for entry in message.status] == cables
    entry = message.status[1]
    assert (entry.level, entry.hardware_id) == (level(equilibria["camera_cable"]), "arm")
    assert entry.message == status.sentence
    found = values(entry)
    assert list(found) == ["status", "code", "trusted", "overlaps", *NUMBERS]
    assert Status[found["status"]] is status
    assert CODES[status] == int(found["code"])
    assert found["trusted"] == ("true" if status.trusted else "false")
    age = 0.0 if status.trusted else math.inf
    assert [float(found[key]) for key in NUMBERS] == [2.5e-3, -1e-120, age]


def test_the_age_counts_from_the_last_trusted_answer_of_each_cable():
    good, bad = result(Status.SNAPPED), result(Status.NOT_CONVERGED, math.nan, math.nan)
    status = StatusMessage(["a", "b"], "")

    def ages(seconds, a, b):
        data = status.fill(round(seconds * SECOND), {"a": a, "b": b})
        return [float(values(entry)[NUMBERS[2]]) for entry in read(data).status]

    assert ages(10.0, good, bad) == [0.0, math.inf]
    assert ages(10.5, bad, good) == [0.5, 0.0]
    assert ages(12.0, bad, bad) == [2.0, 1.5]
    assert ages(10.25, bad, bad) == [0.25, math.inf]  # time went back: not known
    assert ages(10.3, good, good) == [0.0, 0.0]


def test_numbers_that_are_none_are_readable():
    message = read(StatusMessage(["a"], "").fill(0, {"a": result(Status.OUT_OF_REACH, math.nan, -math.inf)}))
    found = values(message.status[0])
    assert math.isnan(float(found[NUMBERS[0]]))
    assert float(found[NUMBERS[1]]) == -math.inf


def test_an_overlap_is_told():
    found = replace(result(Status.CONVERGED), overlaps=(Overlap("b", 0.004, 0.01),))
    (entry,) = read(StatusMessage(["a"], "").fill(0, {"a": found})).status
    assert entry.level == DiagnosticStatus.WARN
    assert (values(entry)["overlaps"], values(entry)["trusted"]) == ("true", "true")


def test_many_combinations_of_many_cables_are_all_right():
    names = [f"cable_{i}" for i in range(3)]
    status = StatusMessage(names, "")
    combinations = [(a, b, c) for a in Status for b in Status for c in Status]
    for turn in range(2):  # more than are kept ready
        for statuses in combinations:
            message = read(status.fill(turn, dict(zip(names, map(result, statuses), strict=True))))
            assert [values(entry)["status"] for entry in message.status] == [one.name for one in statuses]
