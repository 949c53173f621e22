# SPDX-License-Identifier: Apache-2.0
"""The pages that teach: files are written, edits made in a copy of the package, and the code is run."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from pages import Block, blocks, carry_out

from cable_ros.cli.main import main

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
NUMBER = re.compile(r"[-+]?\d+(?:\.\d*)?(?:e[-+]?\d+)?")
FEW_DIGITS = 1e-3
"""A page shows numbers to five digits that were solved to a tolerance of 1e-4."""


def _copy(root: Path) -> None:
    """What the package needs, with its compiled code: what a page does not change is not compiled again."""
    shutil.copytree(ROOT / "cable_ros", root / "cable_ros")
    for name in ("config", "docs"):
        shutil.copytree(ROOT / name, root / name, ignore=shutil.ignore_patterns("*.png"))
    shutil.copy(ROOT / "package.xml", root)


@pytest.mark.timeout(600)
@pytest.mark.parametrize(
    ("name", "compiled"), [("add_effect.md", True), ("add_topic.md", True), ("add_obstacle.md", False)]
)
def test_what_a_page_adds_works(name, compiled, tmp_path):
    """A page that changes kernels is run by the interpreter, which takes less than compiling contact."""
    if "topic" in name:
        pytest.importorskip("rclpy")
    page = DOCS / name
    steps = [block for block in blocks(page) if block.title]
    _copy(tmp_path)
    for block in steps:
        (tmp_path / block.title).parent.mkdir(parents=True, exist_ok=True)
        carry_out(block, tmp_path)
    touched = {block.title for block in steps if block.title.startswith("cable_ros/")}
    assert re.search(rf"touches \*\*{len(touched)} files? of the package\*\*", page.read_text())
    environment = {**os.environ, "PYTHONPATH": str(tmp_path)}
    if not compiled:
        environment["NUMBA_DISABLE_JIT"] = "1"
    run = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", steps[-1].title],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 0, run.stdout + run.stderr
    assert "passed" in run.stdout


@pytest.fixture(scope="module")
def first_steps(tmp_path_factory):
    """The folder in which the files of the page have been written, and the page's other blocks."""
    folder = tmp_path_factory.mktemp("first_steps")
    rest: list[Block] = []
    for block in blocks(DOCS / "first_steps.md"):
        if block.title:
            carry_out(block, folder)
        else:
            rest.append(block)
    return folder, rest


def test_first_steps_run_as_they_stand(first_steps, monkeypatch, capsys):
    folder, rest = first_steps
    monkeypatch.chdir(folder)
    printed, shown = "", 0
    for block in rest:
        if block.language == "bash":
            for line in block.text.splitlines():
                if line.startswith("cable "):
                    assert main(shlex.split(line, comments=True)[1:]) == 0, line
            printed = capsys.readouterr().out or printed
        elif block.language == "text":
            for line in block.text.splitlines():
                assert any(_same(line, other) for other in printed.splitlines()), line
                shown += 1
    assert shown
    assert (folder / "elbow.csv").exists()


def _same(shown: str, printed: str) -> bool:
    """Whether a line shows what was printed: its words, and its numbers to a few digits."""
    if NUMBER.sub("", shown).split() != NUMBER.sub("", printed).split():
        return False
    numbers = [np.array(NUMBER.findall(line), float) for line in (shown, printed)]
    return len(numbers[0]) == len(numbers[1]) and np.allclose(*numbers, rtol=FEW_DIGITS, atol=1e-9)


def test_first_steps_in_python(first_steps, monkeypatch):
    folder, rest = first_steps
    monkeypatch.chdir(folder)
    codes = [block.text for block in rest if block.language == "python"]
    assert codes
    for code in codes:
        exec(compile(code, "first_steps.md", "exec"), {"__name__": "__main__"})


def test_an_edit_needs_its_place(tmp_path):
    (tmp_path / "a.py").write_text("x = 1\nx = 1\n")
    with pytest.raises(AssertionError, match="2 places"):
        carry_out(Block("diff", "a.py", " x = 1\n+y = 2\n"), tmp_path)
    carry_out(Block("diff", "a.py", " x = 1\n x = 1\n+y = 2\n"), tmp_path)
    assert (tmp_path / "a.py").read_text() == "x = 1\nx = 1\ny = 2\n"
