# SPDX-License-Identifier: Apache-2.0
"""Code blocks of the pages in docs/, and what they say to change: new files and edits."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

_FENCE = re.compile(r'^```(\w*)(?: title="([^"]+)")?\n(.*?)^```', re.M | re.S)


@dataclass(frozen=True)
class Block:
    """One fenced block: its language, the file that its title names (or ""), and its text."""

    language: str
    title: str
    text: str


def blocks(page: Path) -> list[Block]:
    """All fenced blocks, in their order."""
    return [Block(*found) for found in _FENCE.findall(page.read_text(encoding="utf-8"))]


def carry_out(block: Block, root: Path) -> None:
    """Write the file, or make the edit, that a block with a title shows, below `root`.

    An edit is a diff without line numbers: what has no `+` stands in the file just once. `@@` parts edits.

    Raises:
        AssertionError: a new file is there already, or the place of an edit is not there, or not once.
    """
    path = root / block.title
    if block.language != "diff":
        assert not path.exists(), f"{block.title} is there already"
        path.write_text(block.text, encoding="utf-8")
        return
    text = path.read_text(encoding="utf-8")
    for edit in re.split(r"^@@.*\n", block.text, flags=re.M):
        lines = edit.splitlines(keepends=True)
        before, after = ("".join(line[1:] for line in lines if line[0] != sign) for sign in "+-")
        assert text.count(before) == 1, f"{block.title}: {text.count(before)} places look like\n{before}"
        text = text.replace(before, after)
    path.write_text(text, encoding="utf-8")
