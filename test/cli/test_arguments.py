# SPDX-License-Identifier: Apache-2.0
"""Joint values and ranges as they are typed."""

from __future__ import annotations

import argparse
import math

import pytest

from cable_ros.cli._arguments import (
    CommandError,
    joint_values,
    named_quantity,
    named_range,
    process_count,
    quantity,
    relative_tolerance,
)


@pytest.mark.parametrize(
    ("text", "value"),
    [("0.5", 0.5), ("-1e-3", -1e-3), ("0.5rad", 0.5), ("30deg", math.pi / 6), ("-90 deg", -math.pi / 2)],
)
def test_quantity(text, value):
    assert quantity(text) == pytest.approx(value, rel=1e-15)


@pytest.mark.parametrize("text", ["", "deg", "30°", "inf", "nan", "1,2", "half"])
def test_no_quantity(text):
    with pytest.raises(argparse.ArgumentTypeError, match=r"not (a number|finite)"):
        quantity(text)


def test_named_quantity():
    assert named_quantity("orientation=-90deg") == ("orientation", -math.pi / 2)
    for text in ("orientation", "=3", "orientation="):
        with pytest.raises(argparse.ArgumentTypeError, match="NAME=VALUE"):
            named_quantity(text)


@pytest.mark.parametrize(
    ("text", "count", "first", "last"),
    [
        ("a=-90:90:0.5deg", 361, -math.pi / 2, math.pi / 2),
        ("a=0:1:0.1", 11, 0, 1),
        ("a=1:0:-0.25", 5, 1, 0),
        ("a=0:1:0.3", 4, 0, 0.9),
        ("a=2:2:1", 1, 2, 2),
        ("a=10deg", 1, math.pi / 18, math.pi / 18),
        ("a=1,3,2", 3, 1, 2),
    ],
)
def test_named_range_includes_both_ends(text, count, first, last):
    name, values = named_range(text)
    assert name == "a"
    assert len(values) == count
    # A few roundings of numbers of size 2.
    assert values[[0, -1]] == pytest.approx([first, last], abs=1e-14)


@pytest.mark.parametrize("text", ["a=0:1", "a=0:1:0", "a=0:1:-0.1", "a=0:1:1e-9", "a=0:x:1", "a=1,,2", "a"])
def test_bad_ranges(text):
    with pytest.raises(argparse.ArgumentTypeError):
        named_range(text)


def test_relative_tolerance():
    assert relative_tolerance("1e-7") == 1e-7
    for text in ("0", "-1e-4", "1", "nan", "1deg", "fine"):
        with pytest.raises(argparse.ArgumentTypeError, match="not between"):
            relative_tolerance(text)


def test_process_count():
    assert process_count("4") == 4
    for text in ("0", "-3", "two", "1.5"):
        with pytest.raises(argparse.ArgumentTypeError, match="not a number of processes"):
            process_count(text)


def joints(*pairs, needed=("a", "b"), pose=None):
    return joint_values(argparse.Namespace(command="solve", joint=list(pairs), pose=pose), needed)


def test_joint_values(capsys):
    assert joints(("b", 1.0), ("a", 2.0)) == {"a": 2.0, "b": 1.0}
    with pytest.raises(CommandError, match="'c' moves no cable"):
        joints(("c", 1.0))
    with pytest.raises(CommandError, match="more than once"):
        joints(("a", 1.0), ("a", 1.0))
    assert joints(needed=()) == {}
    assert capsys.readouterr().err == ""
    assert joints(("a", 1.0)) == {"a": 1.0, "b": 0.0}
    assert capsys.readouterr().err == "cable solve: 0 for the joint b, not named\n"
    assert joints() == {"a": 0.0, "b": 0.0}
    assert capsys.readouterr().err == "cable solve: 0 for the joints a, b, not named\n"


@pytest.mark.parametrize(
    "text",
    [
        "{a: 0.5, b: 1, elsewhere: 3}",
        "header: {frame_id: ''}\nname: [b, elsewhere, a]\nposition: [1.0, 3.0, 0.5]\nvelocity: []\n---\n",
    ],
)
def test_a_pose_from_a_file(tmp_path, capsys, text):
    path = tmp_path / "pose.yaml"
    path.write_text(text)
    assert joints(pose=path) == {"a": 0.5, "b": 1.0}
    assert joints(("a", 2.0), pose=path) == {"a": 2.0, "b": 1.0}
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("[1, 2]", "must be lines 'NAME: VALUE', rad or m, or a joint state"),
        ("a: wide", "a: must be a number in rad or m within 10000"),
        ("a: .nan", "a: must be a number"),
        ("a: 1" + 400 * "0", "a: must be a number"),
        ("a: yes", "a: must be a number"),
        ("{name: [a, b], position: [1.0]}", "2 names and 1 positions"),
    ],
)
def test_what_is_no_pose_is_a_sentence(tmp_path, text, sentence):
    path = tmp_path / "pose.yaml"
    path.write_text(text)
    with pytest.raises(CommandError) as caught:
        joints(pose=path)
    assert str(caught.value).startswith(f"--pose {path}: ")
    assert sentence in str(caught.value)
