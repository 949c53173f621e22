"""How a mistake in a scene is told."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class SceneError(ValueError):
    """One sentence: which file, which field, what is wrong there and what would be right."""

    def __init__(self, source: str, field: str, message: str) -> None:
        self.source = source
        self.field = field
        self.message = message
        text = f"{source}: {field}: {message}" if field else f"{source}: {message}"
        super().__init__(" ".join(text.splitlines()))  # names from a file may hold line breaks


def suggestion(name: str, valid: Iterable[str]) -> str:
    """' (did you mean ...?)' with the nearest valid name, or '' where none is near."""
    near = difflib.get_close_matches(name, list(valid), n=1, cutoff=0.6)
    return f" (did you mean '{near[0]}'?)" if near else ""
