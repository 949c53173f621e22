# SPDX-License-Identifier: Apache-2.0
"""What a cable can touch: shapes fixed in the world or on a link of the robot, and how a scene gives them."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NoReturn

import numpy as np

from cable_ros.scene.errors import SceneError
from cable_ros.scene.section import MILLIMETRES, Section, Size, rotation

RADIUS = Size("m", 1e-5, 100.0, too_high=MILLIMETRES)
EDGE = Size("m", 1e-5, 1000.0, too_high=MILLIMETRES)
COORDINATE = Size("m", -1e5, 1e5, too_high=MILLIMETRES)
FRICTION = Size("", 0.0, 2.0)

SHORTEST_AXIS = 1e-5
"""m; a capsule or cylinder with a shorter axis is a slip."""


@dataclass(frozen=True, eq=False)
class Sphere:
    """A ball."""

    center: np.ndarray
    """(3,) m."""
    radius: float
    """m."""


@dataclass(frozen=True, eq=False)
class Plane:
    """A half space: solid on the side away from the normal."""

    point: np.ndarray
    """(3,) any point of its surface, m."""
    normal: np.ndarray
    """(3,) unit vector out of the solid."""


@dataclass(frozen=True, eq=False)
class Capsule:
    """A round bar with half balls at its ends."""

    start: np.ndarray
    """(3,) one end of its axis, m; the half ball reaches a radius farther."""
    end: np.ndarray
    """(3,) the other end, m."""
    radius: float
    """m."""


@dataclass(frozen=True, eq=False)
class Cylinder:
    """A round bar with flat ends."""

    start: np.ndarray
    """(3,) centre of one end face, m."""
    end: np.ndarray
    """(3,) centre of the other, m."""
    radius: float
    """m."""


@dataclass(frozen=True, eq=False)
class Box:
    """A solid box."""

    center: np.ndarray
    """(3,) m."""
    size: np.ndarray
    """(3,) whole edge lengths along its own axes, m."""
    orientation: np.ndarray
    """(4,) unit quaternion x y z w of its own axes."""


Shape = Sphere | Plane | Capsule | Cylinder | Box


@dataclass(frozen=True, eq=False)
class Obstacle:
    """A rigid body that the cables cannot enter."""

    name: str
    shape: Shape
    """In the frame of the link, or of the world where there is none."""
    friction: float = 0.0
    """Coefficient between the cable and it."""
    link: str | None = None
    """Link of the robot that carries it; None: fixed in the world."""
    cable_radius_counts: bool = True
    """Whether the cable's surface touches it, or, as in Liu et al. (2018), its centreline."""


def _sphere(section: Section) -> Sphere:
    return Sphere(_point(section, "center"), section.number("radius", "metres", RADIUS))


def _plane(section: Section) -> Plane:
    normal = section.vector("normal", 3, "a direction [x, y, z] out of the solid, such as [0, 0, 1]")
    size = math.hypot(*normal)
    if not 1e-9 < size < 1e9:
        section.fail(
            f"a normal of length {size:g} gives no direction; give one out of the solid, such as [0, 0, 1]",
            "normal",
        )
    unit = normal / size
    unit.setflags(write=False)
    return Plane(_point(section, "point"), unit)


def _axis(section: Section) -> tuple[np.ndarray, np.ndarray, float]:
    start, end = _point(section, "start"), _point(section, "end")
    if math.dist(start, end) < SHORTEST_AXIS:
        section.fail(
            f"its axis is {math.dist(start, end):g} m long; give a start and an end apart, or use a sphere",
            "end",
        )
    return start, end, section.number("radius", "metres", RADIUS)


def _box(section: Section) -> Box:
    size = section.vector("size", 3, "the whole edges [x, y, z] in metres", EDGE)
    turned = "orientation" in section or "rpy" in section
    orientation = rotation(section) if turned else np.array([0.0, 0.0, 0.0, 1.0])
    orientation.setflags(write=False)
    return Box(_point(section, "center"), size, orientation)


def _point(section: Section, name: str) -> np.ndarray:
    return section.vector(name, 3, "[x, y, z] in metres", COORDINATE)


_SHAPES: dict[str, tuple[tuple[str, ...], Callable[[Section], Shape]]] = {
    "sphere": (("center", "radius"), _sphere),
    "plane": (("point", "normal"), _plane),
    "capsule": (("start", "end", "radius"), lambda section: Capsule(*_axis(section))),
    "cylinder": (("start", "end", "radius"), lambda section: Cylinder(*_axis(section))),
    "box": (("center", "size", "orientation", "rpy"), _box),
}


def read_obstacles(
    entries: list[Any], source: str, check_link: Callable[[Section], str | None], radius_counts: bool
) -> tuple[Obstacle, ...]:
    """The obstacles of a scene.

    Args:
        entries: the list as it stands in the scene.
        source: how messages name the scene.
        check_link: reads and checks a section's `link`.
        radius_counts: the scene's own `cable_radius`, for obstacles that do not say.

    Raises:
        SceneError: one sentence with file, field and remedy.
    """
    out: list[Obstacle] = []
    for i, entry in enumerate(entries):
        section = Section(
            entry, source, f"obstacles[{i}]", ("name", *_SHAPES, "friction", "link", "cable_radius")
        )
        name = section.text("name", "a name, such as bracket")
        for j, other in enumerate(out):
            if other.name == name:
                raise SceneError(
                    source,
                    section.at("name"),
                    f"'{name}' is already the name of obstacles[{j}]; give each obstacle its own name",
                )
        friction = 0.0
        if "friction" in section:
            friction = section.number("friction", "the coefficient of friction, such as 0.35", FRICTION)
        counts = section.choice("cable_radius", ("count", "ignore"), "count" if radius_counts else "ignore")
        out.append(Obstacle(name, _shape(section), friction, check_link(section), counts == "count"))
    return tuple(out)


def _shape(section: Section) -> Shape:
    given = [kind for kind in _SHAPES if kind in section]
    if len(given) != 1:
        _wrong_count(section, given)
    kind = given[0]
    fields, build = _SHAPES[kind]
    inner = Section(
        section.get(kind, f"its {' and '.join(fields)}"), section.source, section.at(kind), fields
    )
    return build(inner)


def _wrong_count(section: Section, given: list[str]) -> NoReturn:
    shapes = f"{', '.join(list(_SHAPES)[:-1])} or {list(_SHAPES)[-1]}"
    what = f"both {' and '.join(given)} are given" if given else "it has no shape"
    section.fail(f"{what}; give exactly one of {shapes}")
