# SPDX-License-Identifier: Apache-2.0
"""The README keeps its promises: its examples run, its table of parameters is the node's."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

from cable_ros.cli.main import main

ROOT = Path(__file__).parents[1]
TEXT = (ROOT / "README.md").read_text(encoding="utf-8")


def _blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", TEXT, flags=re.MULTILINE | re.DOTALL)


@pytest.fixture
def beside_a_copy(tmp_path, monkeypatch):
    """A folder to work in that has the scenes where the README says they are."""
    (tmp_path / "config").symlink_to(ROOT / "config")
    monkeypatch.chdir(tmp_path)


@pytest.mark.usefixtures("beside_a_copy")
@pytest.mark.parametrize("code", _blocks("python"), ids=lambda code: code.strip().splitlines()[-1][:40])
def test_python_examples_run(code):
    exec(compile(code, "README.md", "exec"), {"__name__": "__main__"})


COMMANDS = [line for block in _blocks("bash") for line in block.splitlines() if line.startswith("cable ")]


@pytest.mark.usefixtures("beside_a_copy")
@pytest.mark.parametrize("line", [line for line in COMMANDS if "demo/" not in line])
def test_commands_run(line, capsys):
    assert main(shlex.split(line, comments=True)[1:]) == 0
    assert capsys.readouterr().out


def test_the_table_of_parameters_is_the_node_s():
    pytest.importorskip("rclpy")
    from cable_ros.ros.parameters import DECLARATIONS

    table = TEXT.partition("### Parameters")[2].partition("##")[0]
    rows = [
        [cell.strip() for cell in line.split("|")[1:-1]]
        for line in table.splitlines()
        if line.startswith("| `")
    ]
    assert [row[0].strip("`") for row in rows] == [entry.name for entry in DECLARATIONS]
    for row, entry in zip(rows, DECLARATIONS, strict=True):
        default = str(entry.default).lower() if isinstance(entry.default, bool) else entry.default
        assert row[1].strip("`") == (default if isinstance(default, str) else f"{default:g}")
        assert row[2] == entry.description
