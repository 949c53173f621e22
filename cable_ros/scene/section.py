# SPDX-License-Identifier: Apache-2.0
"""Typed reading of one mapping of a scene, every mistake reported with its place."""

from __future__ import annotations

import math
import numbers
import os
import unicodedata
from collections.abc import Mapping, Sequence
from typing import Any, NoReturn

import numpy as np

from cable_ros.scene.caps import LONGEST_TEXT, MOST_ROWS
from cable_ros.scene.errors import SceneError, suggestion
from cable_ros.scene.fields import REQUIRED, Field, Size, vector

_CONTROLS = ("Cc", "Cs", "Zl", "Zp")  # Unicode's categories: controls, half characters, line separators


class Section:
    """A mapping in a scene, with its place there and the fields that it may have.

    Every method raises `SceneError` if the value is not what its `Field` says.
    """

    def __init__(self, values: Any, source: str, place: str, fields: Sequence[Field]) -> None:
        self.source = source
        self.place = place
        self.fields = {field.name: field for field in fields}
        if not isinstance(values, Mapping):
            names = ", ".join(self.fields)
            self.fail(f"must be a mapping with the fields {names}, not {describe(values)}")
        self.values = values
        for name in values:
            if name not in self.fields:
                shown = name[:LONGEST_TEXT] if isinstance(name, str) else describe(name)
                hint = suggestion(shown, self.fields) or f"; the fields here are {', '.join(self.fields)}"
                raise SceneError(source, self.at(shown), f"there is no such field{hint}")

    def at(self, name: str) -> str:
        """Field path of a field of this section."""
        return f"{self.place}.{name}" if self.place else name

    def fail(self, message: str, name: str = "") -> NoReturn:
        """Raise a SceneError at this section or at its field `name`."""
        raise SceneError(self.source, self.at(name) if name else self.place, message)

    def __contains__(self, name: str) -> bool:
        return name in self.values

    def has_default(self, name: str) -> bool:
        """Whether the field is not given and a value takes its place."""
        return name not in self and self.fields[name].default not in (REQUIRED, None)

    def get(self, name: str) -> Any:
        """The value as it stands; an error tells what to add where it is missing."""
        value = self.values.get(name)
        if value is None:
            state = "empty" if name in self else "missing"
            self.fail(f"this field is {state}; give {self.remedy(name)}", name)
        return value

    def remedy(self, name: str) -> str:
        """What to give for the field."""
        return self.fields[name].remedy

    def inner(self, name: str) -> Section:
        """The mapping in this field."""
        return Section(self.get(name), self.source, self.at(name), self.fields[name].inner)

    def text(self, name: str) -> str:
        """A non-empty text."""
        value, remedy = self.get(name), self.remedy(name)
        if not isinstance(value, str) or not value.strip():
            self.fail(f"must be a text, not {describe(value)}; give {remedy}", name)
        if len(value) > LONGEST_TEXT:
            self.fail(f"has {len(value)} characters, more than {LONGEST_TEXT}; give {remedy}", name)
        control = next((c for c in value if unicodedata.category(c) in _CONTROLS), None)
        if control is not None:
            self.fail(f"holds the control character {control!r}; give {remedy}", name)
        return value

    def number(self, name: str) -> float:
        """A finite number within the field's bounds; its default where it is not given."""
        if self.has_default(name):
            return float(self.fields[name].default)
        return self._check(self.get(name), name, self.remedy(name), self.fields[name].size)

    def vector(self, name: str, length: int, bounded: bool = True) -> np.ndarray:
        """(length,) finite numbers, each within the field's bounds if `bounded`."""
        field, value = self.fields[name], plain(self.get(name))
        assert field.kind == vector(length)
        if not isinstance(value, list) or len(value) != length:
            self.fail(f"must be a list of {length} numbers, not {describe(value)}; give {field.remedy}", name)
        size = field.size if bounded else None
        out = np.array([self._check(v, f"{name}[{i}]", field.remedy, size) for i, v in enumerate(value)])
        out.setflags(write=False)
        return out

    def items(self, name: str, most: int = MOST_ROWS) -> list[Any]:
        """A list of one to `most` entries; an empty one where the field is not given."""
        if self.has_default(name):
            return []
        value = plain(self.get(name))
        if not isinstance(value, list) or not value:
            self.fail(
                f"must be a list with at least one entry, not {describe(value)}; give {self.remedy(name)}",
                name,
            )
        if len(value) > most:
            self.fail(f"has {len(value)} entries; give at most {most}", name)
        return value

    def choice(self, name: str, default: str | None = None) -> str:
        """One of the field's words; `default`, or the field's own, where it is not given."""
        field = self.fields[name]
        if name not in self:
            return default or str(field.default)
        word = self.text(name)
        if word not in field.words:
            self.fail(f"'{word}' is not {field.remedy}{suggestion(word, field.words)}", name)
        return word

    def flag(self, name: str) -> bool:
        """True or false; the field's default where it is not given."""
        value = self.fields[name].default if name not in self else self.get(name)
        if not isinstance(value, bool):
            self.fail(f"must be {self.remedy(name)}, not {describe(value)}", name)
        return value

    def table(self, name: str) -> np.ndarray:
        """(n, columns) numbers in two rows or more, each within its size, the first ones rising."""
        field, rows = self.fields[name], self.items(name)
        if len(rows) < 2:
            self.fail(f"one row is not enough; give {field.remedy}", name)
        for i, row in enumerate(rows):
            place = f"{name}[{i}]"
            if not isinstance(row, list) or len(row) != len(field.columns):
                self.fail(
                    f"must be a row of {len(field.columns)} numbers, not {describe(row)}; "
                    f"give {field.remedy}",
                    place,
                )
            for k, (value, size) in enumerate(zip(row, field.columns, strict=True)):
                self._check(value, f"{place}[{k}]", field.remedy, size)
            if i and not row[0] > rows[i - 1][0]:
                self.fail(
                    f"{row[0]:g} is not above {rows[i - 1][0]:g}; give rows with rising first numbers", place
                )
        out = np.array(rows, float)
        out.setflags(write=False)
        return out

    def _check(self, value: Any, name: str, remedy: str, size: Size | None) -> float:
        if isinstance(value, bool) or not isinstance(value, numbers.Real):
            self.fail(f"must be a number, not {describe(value)}; give {remedy}", name)
        try:
            number = float(value)
        except OverflowError:  # an integer
            number = math.inf
        if not math.isfinite(number):
            self.fail(f"must be finite, not {describe(value)}; give {remedy}", name)
        if size is None:
            return number
        unit = f" {size.unit}" if size.unit else ""
        if number < 0 <= size.low:
            self.fail(f"must not be negative, but is {number:g}{unit}; give {remedy}", name)
        if not size.low <= number <= size.high:
            slip = size.too_low if number < size.low else size.too_high
            self.fail(
                f"{number:g}{unit} is outside {size.low:g} to {size.high:g}{unit}"
                f"{'; ' + slip if slip else ''}; give {remedy}",
                name,
            )
        return number


def plain(value: Any) -> Any:
    """Arrays, tuples, NumPy scalars and paths as the lists, numbers and texts that YAML has."""
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, Mapping):
        return {key: plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [plain(entry) for entry in value]
    return os.fspath(value) if isinstance(value, os.PathLike) else value


def describe(value: Any) -> str:
    """A value as a reader of the scene would call it."""
    if value is None:
        return "empty"
    if isinstance(value, bool):
        return f"the truth value {str(value).lower()}"
    if isinstance(value, str):
        return f"the text '{value[:40]}'"
    if isinstance(value, Mapping):
        return "a mapping"
    if isinstance(value, list | tuple | np.ndarray):
        return f"a list of {len(value)}"
    if isinstance(value, int) and abs(value) >= 10**20:
        size = abs(value)  # Python writes no integers of more than 4300 digits
        digits = len(str(size)) if size < 10**4000 else math.floor(math.log10(size)) + 1
        return f"an integer of {digits} digits"
    return f"{value}"
