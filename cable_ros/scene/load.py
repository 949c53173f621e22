"""A scene from YAML or from a mapping; every mistake is one sentence with file, field and remedy."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from cable_ros.scene.errors import SceneError, suggestion
from cable_ros.scene.model import Cable, Mount, Robot, Scene
from cable_ros.scene.section import Section, Size, plain
from cable_ros.scene.text import parse_yaml, read_text
from cable_ros.scene.urdf import link_names

_MILLIMETRES = "it looks like millimetres"
LENGTH = Size("m", 0.01, 100.0, too_high=_MILLIMETRES)
DIAMETER = Size("m", 1e-5, 1.0, too_high=_MILLIMETRES)
MODULUS = Size("Pa", 1e4, 1e13, too_low="it looks like MPa or GPa (1 MPa = 1e6 Pa)")
LINEAR_DENSITY = Size("kg/m", 0.0, 1000.0, too_high="it looks like grams per metre")
# Bending from 1e-6 to 1e3 N m^2, torsion and the softer axis up to a thousand times softer or stiffer.
STIFFNESS = Size("N m^2", 1e-9, 1e6, too_high="it looks like N mm^2 (1 N mm^2 = 1e-6 N m^2)")
BENDING = Size("N m^2", 1e-6, 1e3, too_high=STIFFNESS.too_high)
TWIST = Size("rad", -1e4, 1e4)

LINK_REACH = 50.0
WORLD_REACH = 1e5
"""m; a clamp farther than this from the origin of its link, or of the world, is a slip of units."""
CHORD_RATIO = 100.0
"""Clamps in one frame that are this many cable lengths apart are a slip of units."""
SOLID_DENSITY = 1e5
"""kg/m^3; no solid is as heavy, so a linear density above it is a slip of units."""
UNIT_TOLERANCE = 1e-3
"""How far a quaternion's norm may be from 1 before it is refused; nearer ones are normalised."""

_TOKEN = re.compile(r"[A-Za-z](?:_?[A-Za-z0-9])*")
_TOKEN_LENGTH = 80
_SECTION_FIELDS = ("diameter", "youngs_modulus", "shear_modulus")


def load_scene(scene: str | os.PathLike[str] | Mapping[str, Any], *, urdf: str | None = None) -> Scene:
    """Read a scene.

    Args:
        scene: path of a YAML file, or a mapping with the same fields. In a mapping, `robot.urdf` is
            relative to the working directory; in a file, to the file.
        urdf: the text of a URDF, as the topic robot_description has it; takes the place of `robot.urdf`.

    Raises:
        SceneError: one sentence with file, field and remedy.
    """
    if isinstance(scene, Mapping):
        values, path, source = plain(scene), None, "scene"
        text = yaml.safe_dump(_dumpable(values), sort_keys=False, default_flow_style=None)
    else:
        path = Path(scene)
        source = str(path)
        text = read_text(path, source, "a scene in YAML")
        values = parse_yaml(text, source)
    top = Section(values, source, "", ("robot", "gravity", "cables"))
    gravity = top.vector("gravity", 3, "[x, y, z] in m/s^2, such as [0, 0, -9.80665]")
    robot = _robot(top, path, urdf)
    links = link_names(robot.urdf, robot.source) if robot else None
    cables: list[Cable] = []
    for i, entry in enumerate(top.items("cables", "a list of cables, see config/space_arm.yaml")):
        cable = _cable(entry, source, f"cables[{i}]", links)
        for j, other in enumerate(cables):
            if other.name == cable.name:
                raise SceneError(
                    source,
                    f"cables[{i}].name",
                    f"'{cable.name}' is already the name of cables[{j}]; give each cable its own name",
                )
        cables.append(cable)
    return Scene(tuple(cables), gravity, robot, text, path, source)


def _robot(top: Section, path: Path | None, urdf: str | None) -> Robot | None:
    section = Section(top.values["robot"], top.source, "robot", ("urdf",)) if "robot" in top else None
    if urdf is not None:
        return Robot(urdf, "robot description")
    if section is None:
        return None
    name = section.text("urdf", "the path of the robot's URDF, relative to the scene")
    file = Path(name).expanduser()
    if path is not None:
        file = path.parent / file
    return Robot(
        read_text(file, f"{top.source}: {section.at('urdf')}: {file}", "the robot's URDF"), str(file), file
    )


def _cable(values: Any, source: str, place: str, links: tuple[str, ...] | None) -> Cable:
    section = Section(
        values,
        source,
        place,
        ("name", "length", *_SECTION_FIELDS, "stiffness", "linear_density", "total_twist", "start", "end"),
    )
    name = section.text("name", "a name, such as camera_cable")
    if len(name) > _TOKEN_LENGTH or not _TOKEN.fullmatch(name):
        section.fail(
            f"'{name}' cannot be part of a ROS topic name; "
            f"use up to {_TOKEN_LENGTH} letters, digits and single underscores, a letter first",
            "name",
        )
    length = section.number("length", "metres", LENGTH)
    diameter, stiffness = _stiffness(section, length)
    density = section.number("linear_density", "kg/m (0 for a cable without weight)", LINEAR_DENSITY)
    if diameter is not None and density > SOLID_DENSITY * math.pi / 4 * diameter**2:
        section.fail(
            f"{density:g} kg/m in a diameter of {diameter:g} m would be heavier than any solid; "
            f"{LINEAR_DENSITY.too_high}; give kg/m",
            "linear_density",
        )
    twist = (
        section.number("total_twist", "radians, or leave it out", TWIST) if "total_twist" in section else None
    )
    start = _mount(section, "start", links)
    end = _mount(section, "end", links)
    if start.link == end.link:
        chord = math.dist(start.position, end.position)
        if chord > CHORD_RATIO * length:
            section.fail(
                f"this clamp is {chord:g} m from the start of a cable of {length:g} m; "
                f"{_MILLIMETRES}; give metres",
                "end.position",
            )
    return Cable(name, length, stiffness, density, start, end, diameter, twist)


def _stiffness(section: Section, length: float) -> tuple[float | None, np.ndarray]:
    """Diameter, and EIx, EIy, GJ: as given, or of a solid round section by (14)-(16) of the paper."""
    given = [name for name in _SECTION_FIELDS if name in section]
    choice = "give either stiffness, or diameter with youngs_modulus and shear_modulus"
    if "stiffness" in section:
        if given:
            section.fail(f"both stiffness and {' and '.join(given)} are given; {choice}")
        stiffness = section.vector("stiffness", 3, "[EIx, EIy, GJ] in N m^2", STIFFNESS)
        worst = max(stiffness[:2])
        if not BENDING.low <= worst <= BENDING.high:
            slip = f"; {BENDING.too_high}" if worst > BENDING.high else ""
            section.fail(
                f"a bending stiffness of {worst:g} N m^2 is outside {BENDING.low:g} to {BENDING.high:g} N m^2"
                f"{slip}; give [EIx, EIy, GJ] in N m^2",
                "stiffness",
            )
        return None, stiffness
    if not given:
        section.fail(f"neither stiffness nor diameter is given; {choice}")
    diameter = section.number("diameter", "metres", DIAMETER)
    if diameter >= length:
        section.fail(
            f"{diameter:g} m is not below the length of {length:g} m; {_MILLIMETRES}; give metres", "diameter"
        )
    young = section.number("youngs_modulus", "pascals", MODULUS)
    shear = section.number("shear_modulus", "pascals", MODULUS)
    second_moment = math.pi * diameter**4 / 64  # Ix = Iy; the polar Iz is twice as large
    stiffness = np.array([young * second_moment, young * second_moment, shear * 2 * second_moment])
    stiffness.setflags(write=False)
    return diameter, stiffness


def _mount(cable: Section, name: str, links: tuple[str, ...] | None) -> Mount:
    remedy = "{position: [x, y, z], orientation: [x, y, z, w]}, with a link where the robot carries it"
    section = Section(
        cable.get(name, remedy), cable.source, cable.at(name), ("link", "position", "orientation")
    )
    link = section.text("link", "a link of the robot, or leave it out") if "link" in section else None
    if link is not None and links is None:
        section.fail(
            f"'{link}' needs a robot; add 'robot: {{urdf: FILE}}' to the scene, "
            "or let the node take it from robot_description, or leave 'link' out for a clamp in the world",
            "link",
        )
    if link is not None and links is not None and link not in links:
        section.fail(
            f"the robot has no link '{link}'{suggestion(link, links)}; its links are {', '.join(links)}",
            "link",
        )
    position = section.vector("position", 3, "[x, y, z] in metres")
    reach = math.hypot(*position)
    if reach > (WORLD_REACH if link is None else LINK_REACH):
        frame = "the world" if link is None else "its link"
        section.fail(f"{reach:g} m from the origin of {frame}; {_MILLIMETRES}; give metres", "position")
    quaternion = section.vector("orientation", 4, "a unit quaternion [x, y, z, w]")
    norm = math.hypot(*quaternion)
    if abs(norm - 1) > UNIT_TOLERANCE:
        section.fail(
            f"the quaternion's norm is {norm:.6g}, not 1; give a unit quaternion [x, y, z, w], "
            "such as [0, 0, 0, 1] for no rotation",
            "orientation",
        )
    unit = quaternion / norm
    unit.setflags(write=False)
    return Mount(position, unit, link)


def _dumpable(values: Any) -> Any:
    """A mapping that YAML can hold, for the scene's text; what is wrong with it is told by the sections."""
    if isinstance(values, Mapping):
        return {str(key): _dumpable(value) for key, value in values.items()}
    if isinstance(values, list):
        return [_dumpable(value) for value in values]
    return values if isinstance(values, bool | int | float | str) or values is None else str(values)
