# SPDX-License-Identifier: Apache-2.0
"""What a cable can touch: shapes fixed in the world or on a link of the robot, and how a scene gives them."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, NoReturn

import numpy as np

from cable_ros.scene.caps import MOST_OBSTACLES
from cable_ros.scene.errors import SceneError
from cable_ros.scene.fields import MILLIMETRES, Field, Size, vector
from cable_ros.scene.placement import LINK, ROTATION, rotation
from cable_ros.scene.section import Section

RADIUS = Size("m", 1e-5, 100.0, too_high=MILLIMETRES)
EDGE = Size("m", 1e-5, 1000.0, too_high=MILLIMETRES)
COORDINATE = Size("m", -1e5, 1e5, too_high=MILLIMETRES)
FRICTION = Size("", 0.0, 2.0)
RADIUS_WORDS = ("count", "ignore")
"""What `cable_radius` may be."""

SHORTEST_AXIS = 1e-5
"""m; a capsule or cylinder with a shorter axis is a slip."""


@dataclass(frozen=True, eq=False)
class Sphere:
    """A ball."""

    center: np.ndarray
    """(3,) m."""
    radius: float
    """m."""

    def farthest(self, directions: np.ndarray) -> np.ndarray:
        """(m, 3) its farthest points in unit directions (m, 3)."""
        return self.center + self.radius * directions


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

    def farthest(self, directions: np.ndarray) -> np.ndarray:
        """(m, 3) its farthest points in unit directions (m, 3)."""
        return _farther_end(self.start, self.end, directions) + self.radius * directions


@dataclass(frozen=True, eq=False)
class Cylinder:
    """A round bar with flat ends."""

    start: np.ndarray
    """(3,) centre of one end face, m."""
    end: np.ndarray
    """(3,) centre of the other, m."""
    radius: float
    """m."""

    def farthest(self, directions: np.ndarray) -> np.ndarray:
        """(m, 3) its farthest points in unit directions (m, 3)."""
        along = (self.end - self.start) / np.linalg.norm(self.end - self.start)
        across = directions - np.outer(directions @ along, along)
        size = np.linalg.norm(across, axis=1, keepdims=True)
        # Straight along the axis every point of the end face is as far: its centre.
        outward = np.divide(across, size, out=np.zeros_like(across), where=size > 1e-12)
        return _farther_end(self.start, self.end, directions) + self.radius * outward


@dataclass(frozen=True, eq=False)
class Box:
    """A solid box."""

    center: np.ndarray
    """(3,) m."""
    size: np.ndarray
    """(3,) whole edge lengths along its own axes, m."""
    orientation: np.ndarray
    """(4,) unit quaternion x y z w of its own axes."""

    def farthest(self, directions: np.ndarray) -> np.ndarray:
        """(m, 3) its farthest points in unit directions (m, 3)."""
        turn, part = self.orientation[:3], self.orientation[3]
        along = np.cross(turn, np.eye(3))
        axes = (np.eye(3) + 2.0 * (part * along + np.cross(turn, along))).T  # as columns
        return self.center + 0.5 * (np.sign(directions @ axes) * self.size) @ axes.T


def _farther_end(start: np.ndarray, end: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """(m, 3) the end of an axis that is farther in each direction (m, 3)."""
    return np.where((directions @ (end - start) > 0)[:, None], end, start)


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
    margin: float = 0.0
    """By which its surface stands out of the shape, m."""
    left_out_by: tuple[str, ...] = ()
    """Names of the cables that pass through it: those that are clamped in it."""


FRICTION_FIELD = Field(
    "friction", "number", "the coefficient of friction, such as 0.35",
    "Coefficient of friction between the cable and it.", "0.35", default=0.0, size=FRICTION,
)  # fmt: skip


def _point(name: str, meaning: str, example: str) -> Field:
    return Field(name, vector(3), "[x, y, z] in metres", meaning, example, size=COORDINATE)


def _radius(example: str) -> Field:
    return Field("radius", "number", "metres", "Radius.", example, size=RADIUS)


SPHERE = (_point("center", "Centre.", "[0.092, 0.010, -0.095]"), _radius("0.045"))
PLANE = (
    _point("point", "Any point of the surface.", "[0, 0, 0]"),
    Field(
        "normal", vector(3), "a direction [x, y, z] out of the solid, such as [0, 0, 1]",
        "Direction out of the solid, of any length.", "[0, 0, 1]", unit="-", extent="not zero",
    ),
)  # fmt: skip
CAPSULE = (
    _point("start", "One end of the axis; the half ball reaches a radius farther.", "[0, -0.1, 0.2]"),
    _point("end", "The other end.", "[0, 0.1, 0.2]"),
    _radius("0.02"),
)
CYLINDER = (
    _point("start", "Centre of one end face.", "[0, -0.1, 0.2]"),
    _point("end", "Centre of the other.", "[0, 0.1, 0.2]"),
    _radius("0.02"),
)
BOX = (
    _point("center", "Centre.", "[0.1, 0, 0.3]"),
    Field(
        "size", vector(3), "the whole edges [x, y, z] in metres",
        "Whole edge lengths along its own axes.", "[0.2, 0.1, 0.05]", size=EDGE,
    ),
    *(dataclasses.replace(field, default=None, absent="not turned") for field in ROTATION),
)  # fmt: skip

ROBOT_LINKS = (
    Field(
        "links", "text or list of texts", "all, or a list of links", "Links whose collision geometry it is.",
        "[turret]", default="all", extent="`all`, or links of the URDF with collision geometry",
    ),
    Field(
        "except", "list of texts", "a list of links", "Links that are left out of these.", "[camera]",
        default=(), absent="none", extent="links of the URDF",
    ),
    dataclasses.replace(FRICTION_FIELD, meaning="Coefficient of friction between the cable and the links."),
    Field(
        "margin", "number", "metres", "By how much the surfaces stand out of the geometry.", "0.002",
        default=0.0, size=Size("m", 0.0, 1.0, too_high=MILLIMETRES),
    ),
)  # fmt: skip


def _read_sphere(section: Section) -> Sphere:
    return Sphere(section.vector("center", 3), section.number("radius"))


def _read_plane(section: Section) -> Plane:
    normal = section.vector("normal", 3)
    size = math.hypot(*normal)
    if not 1e-9 < size < 1e9:
        section.fail(
            f"a normal of length {size:g} gives no direction; give one out of the solid, such as [0, 0, 1]",
            "normal",
        )
    unit = normal / size
    unit.setflags(write=False)
    return Plane(section.vector("point", 3), unit)


def _axis(section: Section) -> tuple[np.ndarray, np.ndarray, float]:
    start, end = section.vector("start", 3), section.vector("end", 3)
    if math.dist(start, end) < SHORTEST_AXIS:
        section.fail(
            f"its axis is {math.dist(start, end):g} m long; give a start and an end apart, or use a sphere",
            "end",
        )
    return start, end, section.number("radius")


def _read_box(section: Section) -> Box:
    size = section.vector("size", 3)
    turned = "orientation" in section or "rpy" in section
    orientation = rotation(section) if turned else np.array([0.0, 0.0, 0.0, 1.0])
    orientation.setflags(write=False)
    return Box(section.vector("center", 3), size, orientation)


_SHAPES: dict[str, Callable[[Section], Shape]] = {
    "sphere": _read_sphere,
    "plane": _read_plane,
    "capsule": lambda section: Capsule(*_axis(section)),
    "cylinder": lambda section: Cylinder(*_axis(section)),
    "box": _read_box,
}


def _shape(name: str, meaning: str, example: str, inner: tuple[Field, ...]) -> Field:
    remedy = f"its {' and '.join(field.name for field in inner)}"
    return Field(name, "mapping", remedy, meaning, example, None, "another shape", inner=inner)


OBSTACLE = (
    Field(
        "name", "text", "a name, such as bracket", "Name, for messages and markers.", "bracket",
        absent="required, but for a robot, whose obstacles have the links' names",
    ),
    _shape("sphere", "A ball.", "{center: [0.092, 0.010, -0.095], radius: 0.045}", SPHERE),
    _shape("plane", "A half space.", "{point: [0, 0, 0], normal: [0, 0, 1]}", PLANE),
    _shape(
        "capsule", "A round bar with half balls at its ends.",
        "{start: [0, -0.1, 0.2], end: [0, 0.1, 0.2], radius: 0.02}", CAPSULE,
    ),
    _shape(
        "cylinder", "A round bar with flat ends.",
        "{start: [0, -0.1, 0.2], end: [0, 0.1, 0.2], radius: 0.02}", CYLINDER,
    ),
    _shape("box", "A solid box.", "{center: [0.1, 0, 0.3], size: [0.2, 0.1, 0.05]}", BOX),
    Field(
        "robot", "mapping", "{links: all}, or which links", "The collision geometry of the robot's links.",
        "{links: all, except: [camera], friction: 0.2}", None, "another shape", inner=ROBOT_LINKS,
    ),
    FRICTION_FIELD,
    LINK,
    Field(
        "cable_radius", "text", " or ".join(RADIUS_WORDS), "The scene's `cable_radius`, for this obstacle.",
        "ignore", default=None, absent="the scene's", words=RADIUS_WORDS,
    ),
)  # fmt: skip


def read_obstacles(
    entries: list[Any], source: str, check_link: Callable[[Section], str | None], cable_radius: str,
    of_robot: Callable[[Section], Iterable[Obstacle]],
) -> tuple[Obstacle, ...]:  # fmt: skip
    """The obstacles of a scene.

    Args:
        entries: the list as it stands in the scene.
        source: how messages name the scene.
        check_link: reads and checks a section's `link`.
        cable_radius: the scene's own, for obstacles that do not say.
        of_robot: the obstacles of a section with `robot`.

    Raises:
        SceneError: one sentence with file, field and remedy.
    """
    out: list[Obstacle] = []
    places: dict[str, str] = {}
    for i, entry in enumerate(entries):
        section = Section(entry, source, f"obstacles[{i}]", OBSTACLE)
        given = [kind for kind in (*_SHAPES, "robot") if kind in section]
        if len(given) != 1:
            _wrong_count(section, given)
        counts = section.choice("cable_radius", cable_radius) == "count"
        if given == ["robot"]:
            found = [dataclasses.replace(one, cable_radius_counts=counts) for one in of_robot(section)]
        else:
            name, shape = section.text("name"), _SHAPES[given[0]](section.inner(given[0]))
            friction, link = section.number("friction"), check_link(section)
            found = [Obstacle(name, shape, friction, link, counts)]
        for one in found:
            if one.name in places:
                raise SceneError(
                    source,
                    section.at("name"),
                    f"'{one.name}' is already the name of {places[one.name]}; "
                    "give each obstacle its own name",
                )
        places |= {one.name: f"obstacles[{i}]" for one in found}
        out += found
    if len(out) > MOST_OBSTACLES:
        raise SceneError(
            source, "obstacles", f"these are {len(out)} obstacles, more than {MOST_OBSTACLES}; leave some out"
        )
    return tuple(out)


def _wrong_count(section: Section, given: list[str]) -> NoReturn:
    kinds = (*_SHAPES, "robot")
    shapes = f"{', '.join(kinds[:-1])} or {kinds[-1]}"
    what = f"both {' and '.join(given)} are given" if given else "it has no shape"
    section.fail(f"{what}; give exactly one of {shapes}")
