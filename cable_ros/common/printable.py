# SPDX-License-Identifier: Apache-2.0
"""Texts from files and messages as a terminal may show them: one line, without control characters."""

from __future__ import annotations

MOST_CHARACTERS = 2000
"""Of a sentence; a longer one loses its middle."""


def escaped(text: str) -> str:
    r"""`text` with everything that is not printable as Python writes it: a tab as \t, ESC as \x1b.

    A name out of a file could otherwise move the cursor, recolour the terminal or turn the reading direction.
    """
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def one_line(text: str) -> str:
    """`text` in one line of at most `MOST_CHARACTERS`, escaped."""
    line = escaped(" ".join(text.splitlines()))
    if len(line) <= MOST_CHARACTERS:
        return line
    return f"{line[: MOST_CHARACTERS * 2 // 3]} ... {line[-MOST_CHARACTERS // 4 :]}"
