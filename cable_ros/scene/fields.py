# SPDX-License-Identifier: Apache-2.0
"""What a field of a scene file is: one description for its reader, its error messages and the reference."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

MILLIMETRES = "it looks like millimetres"


class _Required:
    def __repr__(self) -> str:
        return "required"


REQUIRED: Final = _Required()


@dataclass(frozen=True)
class Size:
    """What a physical number may be: its unit, its bounds, and the slip that a number outside hints at."""

    unit: str
    low: float
    high: float
    too_low: str = ""
    too_high: str = ""


@dataclass(frozen=True)
class Field:
    """One field of a mapping in a scene file."""

    name: str
    kind: str
    """The kind of YAML value, such as `number` or `list of 3 numbers`."""
    remedy: str
    """What to give; error messages end with it."""
    meaning: str
    """One sentence for the reference."""
    example: str
    """A value as it stands in a scene file."""
    default: Any = REQUIRED
    """The value in use where the field is not given; None: nothing takes its place."""
    absent: str = ""
    """What a scene without the field means, where `default` alone does not say it."""
    size: Size | None = None
    """Unit and bounds of each number."""
    unit: str = ""
    """Unit where there is no `size`."""
    extent: str = ""
    """Bounds that are not those of a single number."""
    words: tuple[str, ...] = ()
    """All that a text may be."""
    columns: tuple[Size, ...] = ()
    """Of each row of a table."""
    inner: tuple[Field, ...] = ()
    """Fields of the mapping, or of each mapping of the list."""


def vector(length: int) -> str:
    """`Field.kind` of so many numbers."""
    return f"list of {length} numbers"
