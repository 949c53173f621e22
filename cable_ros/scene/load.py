# SPDX-License-Identifier: Apache-2.0
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

from cable_ros.scene.caps import MOST_CABLES, MOST_OBSTACLES, MOST_URDF_CHARACTERS
from cable_ros.scene.errors import SceneError, suggestion
from cable_ros.scene.influences import CELSIUS, GRAY, read_influence
from cable_ros.scene.model import EFFECTS, Cable, Mount, Robot, Scene
from cable_ros.scene.obstacles import read_obstacles
from cable_ros.scene.section import MILLIMETRES, Section, Size, describe, plain, rotation
from cable_ros.scene.text import check_amount, parse_yaml, read_text
from cable_ros.scene.urdf import link_names
from cable_ros.share import package_file

LENGTH = Size("m", 0.01, 100.0, too_high=MILLIMETRES)
DIAMETER = Size("m", 1e-5, 1.0, too_high=MILLIMETRES)
MODULUS = Size("Pa", 1e4, 1e13, too_low="it looks like MPa or GPa (1 MPa = 1e6 Pa)")
LINEAR_DENSITY = Size("kg/m", 0.0, 1000.0, too_high="it looks like grams per metre")
# Bending from 1e-6 to 1e3 N m^2, torsion and the softer axis up to a thousand times softer or stiffer.
STIFFNESS = Size("N m^2", 1e-9, 1e6, too_high="it looks like N mm^2 (1 N mm^2 = 1e-6 N m^2)")
BENDING = Size("N m^2", 1e-6, 1e3, too_high=STIFFNESS.too_high)
TWIST = Size("rad", -1e4, 1e4)
FORCE_STIFFNESS = Size("N", 1e-3, 1e12)

GRAVITY = Size("m/s^2", -500.0, 500.0, *["it looks like mm/s^2 or cm/s^2"] * 2)

LINK_REACH = 50.0
WORLD_REACH = 1e5
"""m; a clamp farther than this from the origin of its link, or of the world, is a slip of units."""
CHORD_RATIO = 100.0
"""Clamps in one frame that are this many cable lengths apart are a slip of units."""
SOLID_DENSITY = 1e5
"""kg/m^3; no solid is as heavy, so a linear density above it is a slip of units. A cable's elastic diameter
may be less than its outside."""
METAL_DENSITY = 23e3
"""kg/m^3; no metal is as heavy as that, nor what fills a cable's outer diameter."""
MOST_NATURAL = 100.0
"""rad; a drum that winds the whole cable through more than this is a slip of units."""

_SECTION_FIELDS = ("diameter", "youngs_modulus", "shear_modulus")
_CABLE_FIELDS = (
    "name", "length", *_SECTION_FIELDS, "stiffness", "outer_diameter", "linear_density", "total_twist",
    "natural_strain", "temperature", "dose", "axial_stiffness", "shear_stiffness", "start", "end",
)  # fmt: skip
_TOKEN = re.compile(r"[A-Za-z](?:_?[A-Za-z0-9])*")
_TOKEN_LENGTH = 80
_FIELDS = ("robot", "gravity", "cables", "obstacles", "cable_radius", "friction_model", "effects")


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
        check_amount(scene, "scene")
        values, path, source = plain(scene), None, "scene"
        text = yaml.safe_dump(_dumpable(values), sort_keys=False, default_flow_style=None)
    else:
        path = Path(scene)
        source = str(path)
        text = read_text(path, source, "a scene in YAML")
        values = parse_yaml(text, source)
    top = Section(values, source, "", _FIELDS)
    # A mapping is made by a program, which may well compute with a weight that no planet has.
    size = GRAVITY if path is not None else None
    gravity = top.vector("gravity", 3, "[x, y, z] in m/s^2, such as [0, 0, -9.80665]", size)
    robot = _robot(top, path, urdf)
    links = link_names(robot.urdf, robot.source) if robot else None
    cables: list[Cable] = []
    listed = top.items("cables", "a list of cables, see config/space_arm.yaml", MOST_CABLES)
    for i, entry in enumerate(listed):
        cable = _cable(entry, source, f"cables[{i}]", links)
        if path is not None:
            _check_density(cable, source, f"cables[{i}]")
        for j, other in enumerate(cables):
            if other.name == cable.name:
                raise SceneError(
                    source,
                    f"cables[{i}].name",
                    f"'{cable.name}' is already the name of cables[{j}]; give each cable its own name",
                )
        cables.append(cable)
    obstacles = read_obstacles(
        top.items("obstacles", "a list of obstacles, or leave it out", MOST_OBSTACLES)
        if "obstacles" in top
        else [],
        source,
        lambda section: _link(section, links),
        top.choice("cable_radius", ("count", "ignore"), "count") == "count",
    )
    friction_model = top.choice("friction_model", ("coulomb", "sliding"), "coulomb")
    effects = _effects(top)
    if obstacles:
        _check_stretch_without_contact(top, cables, effects)
    return Scene(tuple(cables), gravity, robot, text, path, source, obstacles, friction_model, effects)


def _check_stretch_without_contact(top: Section, cables: list[Cable], effects: str | tuple[str, ...]) -> None:
    """The equations of contact are those of a cable that neither stretches nor shears."""
    for i, cable in enumerate(cables):
        for effect, field, value in (
            ("stretch", "axial_stiffness", cable.axial_stiffness),
            ("shear", "shear_stiffness", cable.shear_stiffness),
        ):
            if value is not None and (isinstance(effects, str) or {effect, "contact"} <= set(effects)):
                top.fail(
                    f"{effect} and contact cannot be combined yet; leave {field} or the obstacles out, "
                    "or let 'effects' list one of the two",
                    f"cables[{i}].{field}",
                )


def _effects(top: Section) -> str | tuple[str, ...]:
    if "effects" not in top:
        return "all"
    names = ", ".join(EFFECTS)
    remedy = f"auto, all, or a list of {names}"
    value = plain(top.get("effects", remedy))
    if isinstance(value, str):
        return top.choice("effects", ("auto", "all"), "all")
    if not isinstance(value, list):
        top.fail(f"must be {remedy}, not {describe(value)}", "effects")
    for i, name in enumerate(value):
        place = f"effects[{i}]"
        if name not in EFFECTS:
            hint = suggestion(name, EFFECTS) if isinstance(name, str) else ""
            shown = f"'{name}'" if isinstance(name, str) else describe(name)
            top.fail(f"there is no effect {shown}{hint}; give some of {names}", place)
        if name in value[:i]:
            top.fail(f"'{name}' stands here twice; keep one", place)
    if "friction" in value and "contact" not in value:
        top.fail("friction needs contact; add contact, or take friction out", "effects")
    return tuple(value)


def _robot(top: Section, path: Path | None, urdf: str | None) -> Robot | None:
    section = Section(top.values["robot"], top.source, "robot", ("urdf",)) if "robot" in top else None
    if urdf is not None:
        return Robot(urdf, "robot description")
    if section is None:
        return None
    name = section.text("urdf", "the path of the robot's URDF, relative to the scene")
    if name.startswith("package://"):
        try:
            file = package_file(name)
        except FileNotFoundError as error:
            section.fail(f"{name}: {error}", "urdf")
    else:
        file = Path(name).expanduser()
        if path is not None:
            file = path.parent / file
    place = f"{top.source}: {section.at('urdf')}: {file}"
    return Robot(read_text(file, place, "the robot's URDF", MOST_URDF_CHARACTERS), str(file), file)


def _cable(values: Any, source: str, place: str, links: tuple[str, ...] | None) -> Cable:
    section = Section(values, source, place, _CABLE_FIELDS)
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
    axial = shear = None
    if "axial_stiffness" in section:
        axial = section.number("axial_stiffness", "EA in newtons", FORCE_STIFFNESS)
    if "shear_stiffness" in section:
        shear = section.vector("shear_stiffness", 2, "[GAx, GAy] in newtons", FORCE_STIFFNESS)
    start = _mount(section, "start", links)
    end = _mount(section, "end", links)
    if start.link == end.link:
        chord = math.dist(start.position, end.position)
        if chord > CHORD_RATIO * length:
            section.fail(
                f"this clamp is {chord:g} m from the start of a cable of {length:g} m; "
                f"{MILLIMETRES}; give metres",
                "end.position",
            )
    return Cable(
        name, length, stiffness, density, start, end, diameter, twist,
        outer_diameter=_outer_diameter(section, length, diameter),
        natural_strain=_natural_strain(section, length),
        temperature=read_influence(section, "temperature", CELSIUS, "sensor_msgs/Temperature"),
        dose=read_influence(section, "dose", GRAY, "std_msgs/Float64"),
        axial_stiffness=axial, shear_stiffness=shear,
    )  # fmt: skip


def _outer_diameter(section: Section, length: float, diameter: float | None) -> float | None:
    if "outer_diameter" not in section:
        return None
    outer = section.number("outer_diameter", "metres", DIAMETER)
    if outer >= length:
        section.fail(
            f"{outer:g} m is not below the length of {length:g} m; {MILLIMETRES}; give metres",
            "outer_diameter",
        )
    if diameter is not None and outer < diameter:
        section.fail(
            f"{outer:g} m is less than the diameter of {diameter:g} m; "
            "give the cable's outside, or leave it out",
            "outer_diameter",
        )
    return outer


def _check_density(cable: Cable, source: str, place: str) -> None:
    """Raise SceneError if a cable of a file is denser than metal; a program may draw numbers at random."""
    outer, density = cable.outer_diameter, cable.linear_density
    if outer is not None and density > METAL_DENSITY * math.pi / 4 * outer**2:
        raise SceneError(
            source,
            f"{place}.linear_density",
            f"{density:g} kg/m in an outer diameter of {outer:g} m would be denser than any metal; "
            f"{LINEAR_DENSITY.too_high}; give kg/m",
        )


def _natural_strain(section: Section, length: float) -> np.ndarray | None:
    if "natural_strain" not in section:
        return None
    remedy = "[about x, about y, twist] in 1/m, such as [0, 2.5, 0] off a drum of 0.4 m radius"
    strain = section.vector("natural_strain", 3, remedy)
    whole = length * math.hypot(*strain)
    if whole > MOST_NATURAL:
        section.fail(
            f"it winds the cable through {whole:g} rad; it looks like 1/mm or degrees; give {remedy}",
            "natural_strain",
        )
    return strain


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
            f"{diameter:g} m is not below the length of {length:g} m; {MILLIMETRES}; give metres", "diameter"
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
        cable.get(name, remedy), cable.source, cable.at(name), ("link", "position", "orientation", "rpy")
    )
    link = _link(section, links)
    position = section.vector("position", 3, "[x, y, z] in metres")
    reach = math.hypot(*position)
    if reach > (WORLD_REACH if link is None else LINK_REACH):
        frame = "the world" if link is None else "its link"
        section.fail(f"{reach:g} m from the origin of {frame}; {MILLIMETRES}; give metres", "position")
    return Mount(position, rotation(section), link)


def _link(section: Section, links: tuple[str, ...] | None) -> str | None:
    """The field `link`, which must be one of the robot's."""
    if "link" not in section:
        return None
    link = section.text("link", "a link of the robot, or leave it out")
    if links is None:
        section.fail(
            f"'{link}' needs a robot; add 'robot: {{urdf: FILE}}' to the scene, "
            "or let the node take it from robot_description, "
            "or leave 'link' out for what is fixed in the world",
            "link",
        )
    if link not in links:
        section.fail(
            f"the robot has no link '{link}'{suggestion(link, links)}; its links are {', '.join(links)}",
            "link",
        )
    return link


def _dumpable(values: Any) -> Any:
    """A mapping that YAML can hold, for the scene's text; what is wrong with it is told by the sections."""
    if isinstance(values, Mapping):
        return {
            key if isinstance(key, str) else describe(key): _dumpable(value) for key, value in values.items()
        }
    if isinstance(values, list):
        return [_dumpable(value) for value in values]
    if isinstance(values, int) and not isinstance(values, bool):
        return values if abs(values) < 10**20 else describe(values)
    return values if isinstance(values, bool | int | float | str) or values is None else str(values)
