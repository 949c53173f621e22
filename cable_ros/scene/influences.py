# SPDX-License-Identifier: Apache-2.0
"""What the stiffness of a cable depends on: temperature and radiation dose, as tables in the scene."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from cable_ros.scene.section import Section, Size

CELSIUS = Size("degC", -273.15, 2000.0, too_low="it is below absolute zero")
GRAY = Size("Gy", 0.0, 1e12)
FACTOR = Size("", 1e-3, 1e3)

_TOPIC = re.compile(r"(?:~/|/)?[A-Za-z_][A-Za-z0-9_]*(?:/[A-Za-z_][A-Za-z0-9_]*)*")


@dataclass(frozen=True, eq=False)
class Influence:
    """Something outside that changes the stiffness of a cable: a value and what it does."""

    name: str
    """temperature or dose."""
    unit: str
    """degC or Gy."""
    value: float
    """In that unit; where a topic is named, until its first message."""
    table: np.ndarray
    """(n, 3) rising values, and there the factors of the bending and of the torsional stiffness."""
    topic: str | None = None
    """sensor_msgs/Temperature for the temperature, std_msgs/Float64 for the dose; None: a constant."""

    def factors(self, value: float) -> np.ndarray:
        """(3,) factors of EIx, EIy, GJ at a value; linear between the rows of the table.

        Raises:
            ValueError: the value is not within the table.
        """
        low, high = self.table[0, 0], self.table[-1, 0]
        if not low <= value <= high:
            raise ValueError(
                f"{value:g} {self.unit} is outside the table, which ends at {low:g} and {high:g} {self.unit}"
            )
        bending, torsion = (float(np.interp(value, self.table[:, 0], self.table[:, k])) for k in (1, 2))
        return np.array([bending, bending, torsion])


def read_influence(cable: Section, name: str, size: Size, message: str) -> Influence | None:
    """The field `name` of a cable; None where it is not given. `message` is the type that its topic carries.

    Raises:
        SceneError: one sentence with file, field and remedy.
    """
    if name not in cable:
        return None
    row = f"[{size.unit}, factor of the bending stiffness, factor of the torsional stiffness]"
    section = Section(
        cable.get(name, f"{{value: {size.unit}, table: rows of {row}}}"),
        cable.source,
        cable.at(name),
        ("value", "topic", "table"),
    )
    value = section.number("value", size.unit, size)
    topic = None
    if "topic" in section:
        topic = section.text("topic", f"a topic of {message}, or leave it out")
        if not _TOPIC.fullmatch(topic):
            section.fail(
                f"'{topic}' is not a topic's name; give one of {message}, such as camera/{name}", "topic"
            )
    table = section.table("table", f"at least two rows of {row}", (size, FACTOR, FACTOR))
    influence = Influence(name, size.unit, value, table, topic)
    try:
        influence.factors(value)
    except ValueError as error:
        section.fail(f"{error}; give a value in between, or a row for it", "value")
    return influence
