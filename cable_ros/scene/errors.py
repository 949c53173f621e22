# SPDX-License-Identifier: Apache-2.0
"""The error that reports a mistake in a scene."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from itertools import islice

from cable_ros.common.printable import one_line

LONGEST_COMPARED = 100
MOST_COMPARED = 1000
"""Characters of a name, and names, that a suggestion is sought for: the search is quadratic in both."""


class SceneError(ValueError):
    """One sentence: which file, which field, what is wrong there and what would be right."""

    def __init__(self, source: str, field: str, message: str) -> None:
        self.source = source
        self.field = field
        self.message = message
        text = f"{source}: {field}: {message}" if field else f"{source}: {message}"
        super().__init__(one_line(text))  # names from a file may hold anything


def suggestion(name: str, valid: Iterable[str]) -> str:
    """' (did you mean ...?)' with the nearest valid name, or '' where none is near."""
    if len(name) > LONGEST_COMPARED:
        return ""
    short = (other for other in islice(valid, MOST_COMPARED) if len(other) <= LONGEST_COMPARED)
    near = difflib.get_close_matches(name, list(short), n=1, cutoff=0.6)
    return f" (did you mean '{near[0]}'?)" if near else ""
