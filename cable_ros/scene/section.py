# SPDX-License-Identifier: Apache-2.0
"""Typed reading of one mapping of a scene, every mistake told with its place."""

from __future__ import annotations

import math
import numbers
import os
import unicodedata
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NoReturn

import numpy as np

from cable_ros.scene.caps import LONGEST_TEXT, MOST_ROWS
from cable_ros.scene.errors import SceneError, suggestion

MILLIMETRES = "it looks like millimetres"
UNIT_TOLERANCE = 1e-3
"""How far a quaternion's norm may be from 1 before it is refused; nearer ones are normalised."""

_CONTROLS = ("Cc", "Cs", "Zl", "Zp")  # Unicode's categories: controls, half characters, line separators


@dataclass(frozen=True)
class Size:
    """What a physical number may be: its unit, its bounds, and the slip that a number outside hints at."""

    unit: str
    low: float
    high: float
    too_low: str = ""
    too_high: str = ""


class Section:
    """A mapping in a scene, with its place there and the fields that it may have.

    Every method raises `SceneError` where the value is not what it must be.
    """

    def __init__(self, values: Any, source: str, place: str, fields: Sequence[str]) -> None:
        self.source = source
        self.place = place
        self.fields = tuple(fields)
        if not isinstance(values, Mapping):
            self.fail(f"must be a mapping with the fields {', '.join(fields)}, not {describe(values)}")
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

    def get(self, name: str, remedy: str) -> Any:
        """The value as it stands; `remedy` tells what to add where it is missing."""
        value = self.values.get(name)
        if value is None:
            self.fail(f"this field is {'empty' if name in self else 'missing'}; give {remedy}", name)
        return value

    def text(self, name: str, remedy: str) -> str:
        """A non-empty text."""
        value = self.get(name, remedy)
        if not isinstance(value, str) or not value.strip():
            self.fail(f"must be a text, not {describe(value)}; give {remedy}", name)
        if len(value) > LONGEST_TEXT:
            self.fail(f"has {len(value)} characters, more than {LONGEST_TEXT}; give {remedy}", name)
        control = next((c for c in value if unicodedata.category(c) in _CONTROLS), None)
        if control is not None:
            self.fail(f"holds the control character {control!r}; give {remedy}", name)
        return value

    def number(self, name: str, remedy: str, size: Size | None = None) -> float:
        """A finite number within `size`."""
        return self._check(self.get(name, remedy), name, remedy, size)

    def vector(self, name: str, length: int, remedy: str, size: Size | None = None) -> np.ndarray:
        """(length,) finite numbers, each within `size`."""
        value = plain(self.get(name, remedy))
        if not isinstance(value, list) or len(value) != length:
            self.fail(f"must be a list of {length} numbers, not {describe(value)}; give {remedy}", name)
        out = np.array([self._check(v, f"{name}[{i}]", remedy, size) for i, v in enumerate(value)])
        out.setflags(write=False)
        return out

    def items(self, name: str, remedy: str, most: int = MOST_ROWS) -> list[Any]:
        """A list of one to `most` entries."""
        value = plain(self.get(name, remedy))
        if not isinstance(value, list) or not value:
            self.fail(f"must be a list with at least one entry, not {describe(value)}; give {remedy}", name)
        if len(value) > most:
            self.fail(f"has {len(value)} entries; give at most {most}", name)
        return value

    def choice(self, name: str, words: Sequence[str], default: str) -> str:
        """One of some words; `default` where the field is not given."""
        if name not in self:
            return default
        valid = " or ".join(words)
        word = self.text(name, valid)
        if word not in words:
            self.fail(f"'{word}' is not {valid}{suggestion(word, words)}", name)
        return word

    def table(self, name: str, remedy: str, columns: Sequence[Size]) -> np.ndarray:
        """(n, len(columns)) numbers in two rows or more, each within its size, the first ones rising."""
        rows = self.items(name, remedy)
        if len(rows) < 2:
            self.fail(f"one row is not enough; give {remedy}", name)
        for i, row in enumerate(rows):
            place = f"{name}[{i}]"
            if not isinstance(row, list) or len(row) != len(columns):
                self.fail(
                    f"must be a row of {len(columns)} numbers, not {describe(row)}; give {remedy}", place
                )
            for k, (value, size) in enumerate(zip(row, columns, strict=True)):
                self._check(value, f"{place}[{k}]", remedy, size)
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


_DEGREES = "it looks like degrees"
ANGLE = Size("rad", -2 * math.pi, 2 * math.pi, _DEGREES, _DEGREES)


def unit_quaternion(section: Section, name: str) -> np.ndarray:
    """(4,) a quaternion x y z w, normalised."""
    quaternion = section.vector(name, 4, "a unit quaternion [x, y, z, w]")
    norm = math.hypot(*quaternion)
    if abs(norm - 1) > UNIT_TOLERANCE:
        section.fail(
            f"the quaternion's norm is {norm:.6g}, not 1; give a unit quaternion [x, y, z, w], "
            "such as [0, 0, 0, 1] for no rotation",
            name,
        )
    unit = quaternion / norm
    unit.setflags(write=False)
    return unit


def rotation(section: Section) -> np.ndarray:
    """(4,) quaternion x y z w of the section's `orientation`, or of its `rpy` as URDF has it.

    URDF's roll, pitch and yaw turn about the fixed axes x, y, z, one after the other.
    """
    if "rpy" not in section:
        return unit_quaternion(section, "orientation")
    if "orientation" in section:
        section.fail("both orientation and rpy are given; give one of the two")
    angles = section.vector("rpy", 3, "[roll, pitch, yaw] in radians", ANGLE)
    (sr, sp, sy), (cr, cp, cy) = np.sin(0.5 * angles), np.cos(0.5 * angles)
    quaternion = np.array(
        [
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
            cr * cp * cy + sr * sp * sy,
        ]
    )
    quaternion.setflags(write=False)
    return quaternion


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
