# SPDX-License-Identifier: Apache-2.0
"""Joint values that the URDF does not allow: told, refused or ignored, and never silently solved."""

from __future__ import annotations

import math

import numpy as np
import pytest

pytest.importorskip("pinocchio", reason="the arm's kinematics need Pinocchio")

from cable_ros import Status, Tracker, load_scene
from cable_ros.cli.main import main
from cable_ros.scene import SceneError
from cable_ros.scene.joint_limits import JITTER, SLACK, JointLimit, JointLimits
from cable_ros.share import share_file

ARM = str(share_file("config", "space_arm.yaml"))
URDF = share_file("config", "space_arm.urdf").read_text()
LIMIT = '<limit lower="-1.5707963267948966" upper="1.5707963267948966" effort="10" velocity="1"/>'
OUTSIDE = "Joint 'orientation' is 1.6 rad, outside its limits of -1.5708 to 1.5708 rad in the URDF."


def limits(limit: str, kind: str = "revolute") -> JointLimit:
    """Of the arm's orientation joint, with another element <limit>."""
    urdf = URDF.replace(LIMIT, limit, 1).replace('type="revolute"', f'type="{kind}"', 1)
    assert limit in urdf
    return JointLimits(load_scene(ARM, urdf=urdf), ["orientation"]).joints[0]


def test_what_a_urdf_says() -> None:
    assert limits(LIMIT) == JointLimit("orientation", "rad", -math.pi / 2, math.pi / 2, 1.0)
    assert limits('<limit lower="-1" upper="2"/>') == JointLimit("orientation", "rad", -1, 2)
    # Without an end it is at zero, says the format; without either the element is there for something else.
    assert limits('<limit upper="2" velocity="3"/>') == JointLimit("orientation", "rad", 0, 2, 3)
    assert limits('<limit effort="1" velocity="3"/>') == JointLimit("orientation", "rad", velocity=3)
    assert limits("") == JointLimit("orientation", "rad")
    assert limits('<limit lower="-inf" upper="inf"/>') == JointLimit("orientation", "rad")
    # A continuous joint has no ends, whatever stands there.
    assert limits(LIMIT, "continuous") == JointLimit("orientation", "rad", velocity=1.0)
    assert limits(LIMIT, "prismatic").unit == "m"


@pytest.mark.parametrize(
    ("limit", "sentence"),
    [
        ('<limit lower="low" upper="1"/>', "its lower limit 'low' is not a number"),
        ('<limit lower="nan" upper="1"/>', "its lower limit 'nan' is not a number"),
        ('<limit lower="1" upper="-1"/>', "its lower limit 1 is above its upper one, -1"),
    ],
)
def test_limits_that_are_none(limit: str, sentence: str) -> None:
    with pytest.raises(SceneError, match=f"joint 'orientation': {sentence}"):
        limits(limit)


def test_warned_values_are_solved_and_told() -> None:
    tracker = Tracker(ARM)
    inside = tracker.solve({"orientation": 1.5})["camera_cable"]
    assert "limits" not in inside.message
    assert tracker.outside == ""
    outside = tracker.solve({"orientation": 1.6})["camera_cable"]
    assert outside.status is Status.CONVERGED
    assert outside.message == f"{Status.CONVERGED.sentence} {OUTSIDE}"
    assert tracker.outside == OUTSIDE
    assert "it looks like degrees" in JointLimit("j", "rad", -1, 1).beyond(30.0)
    # A joint that rests at its end may be seen a little beyond it.
    tracker.solve({"orientation": math.pi / 2 + 0.9 * SLACK})
    assert tracker.outside == ""


def test_refused_values_leave_the_cable_where_it_is() -> None:
    refusing, other = Tracker(ARM, joint_limits="refuse"), Tracker(ARM)
    for tracker in (refusing, other):
        tracker.solve({"orientation": 1.5})
    refused = refusing.solve({"orientation": 1.6})["camera_cable"]
    assert refused.status is Status.INVALID_INPUT
    assert refused.message == f"{OUTSIDE} Not solved, as joint_limits is 'refuse'."
    again, same = (tracker.solve({"orientation": 1.49})["camera_cable"] for tracker in (refusing, other))
    np.testing.assert_array_equal(again.end_wrench, same.end_wrench)


def test_ignored_values_are_solved_as_any() -> None:
    ignoring, warning = Tracker(ARM, joint_limits="ignore"), Tracker(ARM)
    found, told = (tracker.solve({"orientation": 1.6})["camera_cable"] for tracker in (ignoring, warning))
    assert ignoring.outside == ""
    assert found.message == Status.CONVERGED.sentence
    np.testing.assert_array_equal(found.end_wrench, told.end_wrench)
    with pytest.raises(ValueError, match="give warn, refuse or ignore"):
        ignoring.joint_limits = "clip"


def test_speeds() -> None:
    joint = JointLimit("lift", "m", velocity=0.1)
    allowed = 0.1 * (0.5 + JITTER) + SLACK
    assert joint.too_fast(allowed * 0.999, 0.5) == joint.too_fast(-allowed * 0.999, 0.5) == ""
    assert joint.too_fast(-0.2, 0.5) == (
        "Joint 'lift' went 0.2 m in 0.5 s; its velocity limit in the URDF is 0.1 m/s."
    )
    assert JointLimit("lift", "m").too_fast(1e9, 1e-9) == ""


def test_commands_tell(tmp_path, capsys) -> None:
    assert main(["solve", ARM, "--joint", "orientation=100"]) == 0
    assert "Joint 'orientation' is 100 rad, outside its limits" in capsys.readouterr().out
    table = tmp_path / "arm.csv"
    assert main(["sweep", ARM, "--joint", "orientation=-1:2:1", "--out", str(table)]) == 0
    said = capsys.readouterr().err
    assert "cable sweep: Joint 'orientation' is 2 rad, outside its limits" in said
    assert "is -1 rad" not in said
    assert main(["sweep", ARM, "--joint", "orientation=-90:90:90deg", "--out", str(tmp_path / "b.csv")]) == 0
    assert "outside" not in capsys.readouterr().err
