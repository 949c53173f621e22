# SPDX-License-Identifier: Apache-2.0
"""Tables in Markdown, and files that commands keep up to date."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path


class MarkdownError(ValueError):
    """The file has no place for the text."""


def markdown_table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """The table's lines."""
    return "\n".join("| " + " | ".join(cells) + " |" for cells in (head, ["---"] * len(head), *rows))


def write_between(path: Path, name: str, text: str) -> None:
    """Replace what stands between `<!-- name begins -->` and `<!-- name ends -->`; a missing file is made.

    Raises:
        MarkdownError: the file is there and has no such marks; it is not touched.
    """
    marks = [f"<!-- {name} {when} -->" for when in ("begins", "ends")]
    old = path.read_text() if path.exists() else "\n".join(marks) + "\n"
    if not all(mark in old for mark in marks):
        raise MarkdownError(
            f"{path}: the lines {marks[0]} and {marks[1]} are missing; add them where it goes"
        )
    before, rest = old.split(marks[0], 1)
    path.write_text(f"{before}{marks[0]}\n{text}{marks[1]}{rest.split(marks[1], 1)[1]}")
