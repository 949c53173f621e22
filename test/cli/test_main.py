# SPDX-License-Identifier: Apache-2.0
"""The command's frame: help, version, sentences instead of tracebacks, pipes that close."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import types
from pathlib import Path

import pytest

from cable_ros.cli import main as frame

CABLE = [sys.executable, "-m", "cable_ros.cli.main"]


@pytest.fixture
def fake_command(monkeypatch):
    """Install `cable fake`, whose run() does what the test gives."""

    def install(run):
        module = types.ModuleType("cable_ros.cli.fake")
        module.add_parser = lambda subparsers: subparsers.add_parser("fake")
        module.run = run
        monkeypatch.setitem(sys.modules, "cable_ros.cli.fake", module)
        monkeypatch.setattr(frame, "_command_names", lambda: ["fake"])

    return install


def test_every_command_is_listed_and_has_an_example(capsys):
    assert frame.main(["-h"]) == 0
    listing = capsys.readouterr().out
    names = frame._command_names()
    assert {"solve", "plot", "sweep", "demo", "branches"} <= set(names)
    for name in names:
        assert f"    {name} " in listing
        assert frame.main([name, "-h"]) == 0
        assert f"cable {name}" in capsys.readouterr().out.partition("example")[2]


def test_no_command_prints_the_help(capsys):
    assert frame.main([]) == 0
    assert "commands:" in capsys.readouterr().out


def test_version(capsys):
    assert frame.main(["--version"]) == 0
    assert capsys.readouterr().out.startswith("cable_ros ")


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (["nonsense"], "nonsense"),
        (["solve"], "SCENE"),
        (["solve", "scene.yaml", "--joint", "orientation"], "NAME=VALUE"),
        (["solve", "scene.yaml", "--joint", "orientation=wide"], "'wide' is not a number"),
        (["solve", "scene.yaml", "--joint", "orientation=nan"], "not finite"),
        (["solve", "scene.yaml", "--tolerance", "2"], "between"),
        (["solve", "no/such/scene.yaml"], "no/such/scene.yaml"),
        (["sweep", "scene.yaml", "--out", "out.csv", "--jobs", "-3"], "not a number of processes"),
        (["sweep", "scene.yaml", "--out", "out.txt"], "must end in .csv, .parquet or .mcap"),
        (
            ["sweep", "space_arm.yaml", "--out", "out.csv", "--vary", "length=-1"],
            "length = -1: cables[0].length",
        ),
        (["branches", "space_arm.yaml", "--out", "out.doc"], "must end in .png, .pdf or .svg"),
        (["bench", "robustness", "--cases", "-1"], "not a whole number from 0 on"),
        (["plot", "no/such/log.mcap"], "there is no such file"),
        (["plot", __file__], "name a log (.mcap)"),
        (["log", "recover", __file__], "name a log (.mcap)"),
        (["replay", "no/such/log.mcap"], "say what to do: --resolve, or --with SCENE"),
        (["demo", "--out", __file__], "a file of this name is in the way; name another folder"),
    ],
)
def test_bad_input_is_one_sentence_and_exit_code_2(capsys, arguments, word):
    assert frame.main(arguments) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert word in captured.err
    assert captured.err.count("\n") == 1


def test_our_errors_are_sentences(fake_command, capsys):
    from cable_ros.cli._arguments import CommandError

    def run(args):
        raise CommandError("the moon is full")

    fake_command(run)
    assert frame.main(["fake"]) == 2
    assert capsys.readouterr().err == "cable fake: the moon is full\n"


def test_faults_of_the_program_are_not_hidden(fake_command):
    def run(args):
        return [][0]

    fake_command(run)
    with pytest.raises(IndexError):
        frame.main(["fake"])


def test_a_missing_package_names_the_extra(fake_command, capsys):
    def run(args):
        raise ModuleNotFoundError("No module named 'pyarrow'", name="pyarrow.parquet")

    fake_command(run)
    assert frame.main(["fake"]) == 2
    assert "pip install 'cable_ros[parquet]'" in capsys.readouterr().err


def test_a_package_that_does_not_fit_says_so_itself(fake_command, capsys):
    def run(args):
        raise ImportError("pyarrow requires NumPy 2.0 or newer, found 1.26.4")

    fake_command(run)
    assert frame.main(["fake"]) == 2
    assert capsys.readouterr().err == "cable fake: pyarrow requires NumPy 2.0 or newer, found 1.26.4\n"


def test_interrupt_is_quiet(fake_command, capsys):
    def run(args):
        signal.raise_signal(signal.SIGINT)
        return 0

    fake_command(run)
    # A shell that starts us in the background has SIGINT ignored.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        assert frame.main(["fake"]) == 130
    finally:
        signal.signal(signal.SIGINT, before)
    assert capsys.readouterr().err == "cable: interrupted\n"


def test_a_closed_pipe_is_quiet():
    reading, writing = os.pipe()
    os.close(reading)
    buffered = {**os.environ, "PYTHONUNBUFFERED": ""}  # unbuffered, argparse itself swallows the error
    try:
        done = subprocess.run(
            [*CABLE, "-h"], stdout=writing, stderr=subprocess.PIPE, env=buffered, check=False
        )
    finally:
        os.close(writing)
    assert done.stderr == b""
    assert done.returncode == 141


def test_help_does_not_load_the_solver():
    """`cable -h` answers at once: neither the compiler nor the robot library is imported for it."""
    program = (
        "import sys; from cable_ros.cli.main import main; main(['-h']);"
        "sys.exit(bool({'numba', 'scipy', 'pinocchio', 'matplotlib', 'rclpy'} & set(sys.modules)))"
    )
    root = Path(__file__).parents[2]
    assert (
        subprocess.run([sys.executable, "-c", program], cwd=root, capture_output=True, check=False).returncode
        == 0
    )
