# SPDX-License-Identifier: Apache-2.0
"""The pages of docs/: links and scripts that are there, commands that are understood, all pages listed."""

from __future__ import annotations

import ast
import importlib
import re
import shlex
from pathlib import Path

import pytest
from pages import blocks
from scripts import script

import cable_ros.ros
from cable_ros.cli import main as frame

ROOT = Path(__file__).parents[1]
PAGES = sorted((ROOT / "docs").glob("*.md"))
FILES = [*PAGES, ROOT / "README.md"]


def _found(pattern: str, commands: bool = False) -> list[tuple[str, str]]:
    """(page, match) of all pages, or of the shell commands that they show, each once."""
    texts = {page.name: page.read_text(encoding="utf-8") for page in FILES}
    if commands:
        texts = {name: _commands(text) for name, text in texts.items()}
    matches = ((name, match) for name, text in texts.items() for match in re.findall(pattern, text, re.M))
    return list(dict.fromkeys(matches))


def _commands(text: str) -> str:
    """What a page shows of a shell, in fences or indented."""
    fences = re.compile(r"^```(\w*).*?\n(.*?)^```", re.M | re.S)
    fenced = [code for language, code in fences.findall(text) if language in ("bash", "sh", "console")]
    indented = re.findall(r"^    (?:\$ )?(.*)$", fences.sub("", text), re.M)
    return "\n".join([*fenced, *indented])


@pytest.mark.parametrize(("page", "target"), _found(r"\]\(([^)#:]+)[^)]*\)"))
def test_links_lead_somewhere(page, target):
    folder = ROOT if page == "README.md" and "docs/" in target else ROOT / "docs"
    assert (folder / target).exists() or (ROOT / target).exists()


@pytest.mark.parametrize(
    ("page", "script"), _found(r"(?:benchmarks|examples|test|config|cable_ros)/[a-z0-9_/]+\.\w+")
)
def test_files_that_are_named_are_there(page, script):
    made = {
        block.title for block in blocks(ROOT / "docs" / page)
    }  # by a page that shows how to add something
    assert (ROOT / script).exists() or script in made


@pytest.mark.parametrize(("page", "line"), _found(r"^(cable .*)$", commands=True))
def test_commands_are_understood(page, line):
    words = shlex.split(line.partition(" | ")[0], comments=True)[1:]
    module = importlib.import_module(f"cable_ros.cli.{words[0]}")
    frame._parser({words[0]: module}).parse_args(words)


@pytest.mark.parametrize(("page", "line"), _found(r"^ros2 run cable_ros cable_replay (.*)$", commands=True))
def test_replays_are_understood(page, line):
    pytest.importorskip("rclpy")
    from cable_ros.ros.replay_node import parse

    assert parse(shlex.split(line, comments=True)).log


def test_every_page_is_listed():
    listed = set(re.findall(r"\]\((\w+\.md)\)", (ROOT / "docs" / "README.md").read_text()))
    assert listed == {page.name for page in PAGES} - {"README.md"}


@pytest.mark.parametrize("page", ["scene.md", "parameters.md", "commands.md"])
def test_what_the_code_knows_best_is_what_it_says(page):
    if page == "parameters.md":
        pytest.importorskip("rclpy")
    reference = script("docs/reference.py")
    assert set(reference.PAGES) == {"scene.md", "parameters.md", "commands.md"}
    kept = (ROOT / "docs" / page).read_text(encoding="utf-8")
    assert kept == reference.PAGES[page](), "run python docs/reference.py"


def _advertised():
    """Name and type of every topic that the node's code advertises, `~/<cable>/` for those of a cable."""
    for path in sorted(Path(cable_ros.ros.__path__[0]).glob("*.py")):
        for call in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(call, ast.Call) and ast.unparse(call.func) == "Outlet.create":
                _, kind, name, _ = map(ast.unparse, call.args)
                if name != "TOPIC":  # /tf_static, whose name is tf2's
                    yield (
                        re.sub(r"^f?'(.*)'$", r"\1", name)
                        .replace("{base}", "~/<cable>")
                        .replace("{support}", "<support>"),
                        kind,
                    )


@pytest.mark.parametrize("page", ["README.md", "docs/ros.md"])
def test_every_topic_has_its_row(page):
    topics = list(_advertised())
    assert ("~/<cable>/end_wrench", "WrenchStamped") in topics
    rows = re.findall(r"^\| `([^`]+)` \| `\w+/(\w+)` \|", (ROOT / page).read_text(encoding="utf-8"), re.M)
    assert [topic for topic in topics if topic not in rows] == []
