# SPDX-License-Identifier: Apache-2.0
"""`cable solve`: numbers, JSON, exit codes."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest

from cable_ros import Equilibrium, Tracker
from cable_ros.cli.main import main
from cable_ros.cli.solve import engineering
from cable_ros.joint import joint_torque
from cable_ros.share import share_file

ARM = str(share_file("config", "space_arm.yaml"))
FAR = """
gravity: [0, 0, -9.8]
cables:
  - name: short
    length: 0.3
    stiffness: [1.0e-3, 1.0e-3, 7.0e-4]
    linear_density: 0.1
    start: {position: [0, 0, 0], orientation: [0, 0, 0, 1]}
    end: {position: [0.5, 0, 0], orientation: [0, 0, 0, 1]}
"""


@pytest.fixture
def far(tmp_path):
    path = tmp_path / "far.yaml"
    path.write_text(FAR)
    return str(path)


def test_json_has_the_fields_of_equilibrium(capsys):
    assert main(["solve", ARM, "--joint", "orientation=0", "--tolerance", "1e-6", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["camera_cable"]
    fields = {field.name for field in dataclasses.fields(Equilibrium) if not field.name.startswith("_")}
    assert set(found) == fields | {"stiffness", "contacts", "extremes", "support_wrenches"}
    assert found["status"] == "CONVERGED"
    assert np.shape(found["points"]) == (101, 3)
    # The reference force and moment on the cable at 0 deg, in world axes, which are the clamp's there. Their
    # last digit is good to 3e-6, and the tolerance asked for is 1e-6.
    force, moment = [0.165686, 0.268690, 0.183239], [16.1021e-3, -14.9545e-3, -5.2165e-3]
    assert np.allclose(found["end_wrench"][:3], np.negative(force), rtol=0, atol=1e-5 * np.linalg.norm(force))
    assert np.allclose(
        found["end_wrench"][3:], np.negative(moment), rtol=0, atol=1e-5 * np.linalg.norm(moment)
    )


def test_joint_load_is_told(capsys):
    command = ["solve", ARM, "--joint", "orientation=0.5"]
    assert main([*command, "--json"]) == 0
    (value,) = json.loads(capsys.readouterr().out)["joint_load"].items()
    tracker, joints = Tracker(ARM), {"orientation": 0.5}
    (wanted,) = joint_torque(tracker, tracker.solve(joints), joints)
    assert value == ("orientation", pytest.approx(wanted, rel=1e-6))
    assert main(command) == 0
    assert f"  orientation       {engineering(wanted, 'N m')}\n" in capsys.readouterr().out


def test_contacts_are_told(capsys):
    ball = str(share_file("config", "space_arm_sphere.yaml"))
    assert main(["solve", ball, "--joint", "orientation=60deg"]) == 0
    assert "  contact           ball at 0.1" in capsys.readouterr().out
    assert main(["solve", ball, "--joint", "orientation=60deg", "--json"]) == 0
    contacts = json.loads(capsys.readouterr().out)["camera_cable"]["contacts"]
    assert {contact["obstacle"] for contact in contacts} == {"ball"}
    # On the ball: centre and radius of the scene; the solver's gap is far below a micrometre.
    for contact in contacts:
        assert np.linalg.norm(np.subtract(contact["position"], [0.092, 0.010, -0.095])) == pytest.approx(
            0.045, abs=1e-6
        )


def test_degrees_and_radians_are_the_same_pose(capsys):
    outputs = []
    for value in ("30deg", str(np.pi / 6)):
        assert main(["solve", ARM, "--joint", f"orientation={value}", "--json"]) == 0
        outputs.append(json.loads(capsys.readouterr().out)["camera_cable"]["end_wrench"])
    # The two values may differ in the last bit.
    assert outputs[0] == pytest.approx(outputs[1], rel=1e-12)


def test_the_text_says_sign_frame_and_units(capsys):
    assert main(["solve", ARM, "--joint", "orientation=0"]) == 0
    text = capsys.readouterr().out
    assert "what the cable exerts on the body at each clamp" in text
    assert "in the clamp's frame" in text
    assert "N, N m" in text
    assert "-0.16569" in text


def test_what_cannot_be_trusted_has_exit_code_1_and_no_number(capsys, far):
    assert main(["solve", far]) == 1
    captured = capsys.readouterr()
    assert "Fx" not in captured.out
    assert captured.err.startswith("cable solve: short: The clamps are 200 mm farther apart")


def test_json_stays_json_where_numbers_are_missing(capsys, far):
    assert main(["solve", far, "--json"]) == 1

    def refuse(name):
        raise AssertionError(f"{name} is not JSON")

    found = json.loads(capsys.readouterr().out, parse_constant=refuse)["short"]
    assert found["status"] == "OUT_OF_REACH"
    assert found["end_wrench"] == [None] * 6


@pytest.mark.parametrize(
    ("joints", "words"),
    [
        (["orientation=0", "orientation=1"], "more than once"),
        (["orientatoin=0"], "'orientatoin' moves no cable; those that do: orientation"),
    ],
)
def test_joints_are_the_needed_ones(capsys, joints, words):
    options = [word for joint in joints for word in ("--joint", joint)]
    assert main(["solve", ARM, *options]) == 2
    assert words in capsys.readouterr().err


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.04209, "42.09 mJ"), (0.0, "0 J"), (-1.5, "-1.5 J"), (1e-15, "1e-06 nJ"), (12345.0, "12.35 kJ")],
)
def test_engineering(value, text):
    assert engineering(value, "J") == text
