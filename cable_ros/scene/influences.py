# SPDX-License-Identifier: Apache-2.0
"""What the stiffness of a cable depends on: temperature and radiation dose, as tables in the scene."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from cable_ros.scene.fields import Field, Size
from cable_ros.scene.section import Section

CELSIUS = Size("degC", -273.15, 2000.0, too_low="it is below absolute zero")
GRAY = Size("Gy", 0.0, 1e12)
FACTOR = Size("", 1e-3, 1e3)


def row(size: Size) -> str:
    """A row of the table, as messages call it."""
    return f"[{size.unit}, factor of the bending stiffness, factor of the torsional stiffness]"


def _fields(size: Size, message: str, value: str, topic: str, table: str) -> tuple[Field, ...]:
    """Fields of an influence of this unit, whose topic carries `message`; and examples of their values."""
    return (
        Field(
            "value", "number", size.unit, "Value now; where a topic is named, until its first message.",
            value, size=size, extent="within the table",
        ),
        Field(
            "topic", "text", f"a topic of {message}, or leave it out",
            f"Topic of {message} that the node takes the value from.", topic, default=None,
            absent="the value is constant",
        ),
        Field(
            "table", "list of rows of 3 numbers", f"at least two rows of {row(size)}",
            f"Rows {row(size)}, linear between them.", table, unit=f"{size.unit}, -, -",
            extent="rising first numbers", columns=(size, FACTOR, FACTOR),
        ),
    )  # fmt: skip


TEMPERATURE = _fields(
    CELSIUS, "sensor_msgs/Temperature", "-80", "camera_cable/temperature", "[[-100, 3.2, 2.8], [20, 1, 1]]"
)
DOSE = _fields(GRAY, "std_msgs/Float64", "2.0e5", "camera_cable/dose", "[[0, 1, 1], [1.0e6, 1.25, 1.2]]")

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


def read_influence(cable: Section, name: str, size: Size) -> Influence | None:
    """The field `name` of a cable; None where it is not given.

    Raises:
        SceneError: one sentence with file, field and remedy.
    """
    if name not in cable:
        return None
    section = cable.inner(name)
    value = section.number("value")
    topic = None
    if "topic" in section:
        topic = section.text("topic")
        if not _TOPIC.fullmatch(topic):
            message = section.remedy("topic").removeprefix("a topic of ").partition(",")[0]
            section.fail(
                f"'{topic}' is not a topic's name; give one of {message}, such as camera/{name}", "topic"
            )
    influence = Influence(name, size.unit, value, section.table("table"), topic)
    try:
        influence.factors(value)
    except ValueError as error:
        section.fail(f"{error}; give a value in between, or a row for it", "value")
    return influence
