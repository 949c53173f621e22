# SPDX-License-Identifier: Apache-2.0
"""A cable of a scene file: its fields, what they may be, and how they are read."""

from __future__ import annotations

import itertools
import math
import re
from typing import Any

import numpy as np

from cable_ros.scene.between_ends import SUPPORT, check_supports, read_supports
from cable_ros.scene.cable_limits import CABLE_LIMITS, read_limits
from cable_ros.scene.errors import SceneError
from cable_ros.scene.fields import MILLIMETRES, Field, Size, vector
from cable_ros.scene.influences import CELSIUS, DOSE, GRAY, TEMPERATURE, read_influence, row
from cable_ros.scene.model import FREE, Cable
from cable_ros.scene.mounts import MOUNT, check_ends, read_mount
from cable_ros.scene.section import Section

LENGTH = Size("m", 0.01, 100.0, too_high=MILLIMETRES)
DIAMETER = Size("m", 1e-5, 1.0, too_high=MILLIMETRES)
MODULUS = Size("Pa", 1e4, 1e13, too_low="it looks like MPa or GPa (1 MPa = 1e6 Pa)")
LINEAR_DENSITY = Size("kg/m", 0.0, 1000.0, too_high="it looks like grams per metre")
# Bending from 1e-6 to 1e3 N m^2, torsion and the softer axis up to a thousand times softer or stiffer.
STIFFNESS = Size("N m^2", 1e-9, 1e6, too_high="it looks like N mm^2 (1 N mm^2 = 1e-6 N m^2)")
BENDING = Size("N m^2", 1e-6, 1e3, too_high=STIFFNESS.too_high)
TWIST = Size("rad", -1e4, 1e4)
FORCE_STIFFNESS = Size("N", 1e-3, 1e12)

CHORD_RATIO = 100.0
"""Clamps in one frame that are this many cable lengths apart are a slip of units."""
THINNEST_WALL = 0.99
"""Largest inner diameter by the outer one: a thinner tube kinks long before it is a rod."""
SOLID_DENSITY = 1e5
"""kg/m^3; no solid is as heavy, so a linear density above it is a slip of units. A cable's elastic diameter
may be less than its outside."""
METAL_DENSITY = 23e3
"""kg/m^3; no metal is as heavy as that, nor what fills a cable's outer diameter."""
MOST_NATURAL = 100.0
"""rad; a drum that winds the whole cable through more than this is a slip of units."""

_SECTION_FIELDS = ("diameter", "inner_diameter", "youngs_modulus", "shear_modulus")
_TOKEN = re.compile(r"[A-Za-z](?:_?[A-Za-z0-9])*")
_TOKEN_LENGTH = 80

_MOUNT_REMEDY = "{position: [x, y, z], orientation: [x, y, z, w]}, with a link where the robot carries it"

CABLE = (
    Field(
        "name", "text", "a name, such as camera_cable", "Name, which is also part of its topics.",
        "camera_cable",
        extent=f"up to {_TOKEN_LENGTH} letters, digits and single underscores, a letter first",
    ),
    Field("length", "number", "metres", "Length between the clamps, along the cable.", "0.380", size=LENGTH),
    Field(
        "diameter", "number", "metres",
        "Diameter of a round section, from which the stiffness follows with the two moduli.",
        "0.00754", default=None, absent="required without `stiffness`", size=DIAMETER,
        extent="less than `length`",
    ),
    Field(
        "inner_diameter", "number", "metres, or leave it out", "Diameter of the hole of a tube.", "0.005",
        default=None, absent="solid", size=DIAMETER, extent=f"up to {THINNEST_WALL:g} of `diameter`",
    ),
    Field(
        "youngs_modulus", "number", "pascals", "Young's modulus of that section.", "6.70e6",
        default=None, absent="required without `stiffness`", size=MODULUS,
    ),
    Field(
        "shear_modulus", "number", "pascals", "Shear modulus of that section.", "2.28e6",
        default=None, absent="required without `stiffness`", size=MODULUS,
    ),
    Field(
        "stiffness", vector(3), "[EIx, EIy, GJ] in N m^2",
        "Bending stiffness about the section's x and y axes and torsional stiffness, as measured.",
        "[1.063e-3, 1.063e-3, 0.7235e-3]", default=None, absent="required without `diameter` and moduli",
        size=STIFFNESS, extent=f"the larger of EIx, EIy from {BENDING.low:g} to {BENDING.high:g}",
    ),
    Field(
        "outer_diameter", "number", "metres",
        "Diameter of the outside, which touches obstacles, if it is more than `diameter`.", "0.020",
        default=None, absent="`diameter`, or none", size=DIAMETER, extent="from `diameter` to `length`",
    ),
    Field(
        "linear_density", "number", "kg/m (0 for a cable without weight)", "Mass per length.", "0.1019716",
        size=LINEAR_DENSITY, extent=f"in its outer diameter no denser than {METAL_DENSITY:g} kg/m^3",
    ),
    Field(
        "total_twist", "number", "radians, or leave it out",
        "Total twist of the branch to start on; a pose has several equilibria.", "-2.7",
        default=None, absent="the stable one of least energy that is found", size=TWIST,
    ),
    Field(
        "natural_strain", vector(3),
        "[about x, about y, twist] in 1/m, such as [0, 2.5, 0] off a drum of 0.4 m radius",
        "Curvature about the section's x and y axes and twist of the unloaded cable.", "[0, 2.5, 0]",
        default=None, absent="straight", unit="1/m",
        extent=f"at most {MOST_NATURAL:g} rad over the whole cable",
    ),
    Field(
        "temperature", "mapping", f"{{value: {CELSIUS.unit}, table: rows of {row(CELSIUS)}}}",
        "What the temperature does to the stiffness.",
        "{value: -80, table: [[-100, 3.2, 2.8], [20, 1, 1]]}", default=None, absent="nothing",
        inner=TEMPERATURE,
    ),
    Field(
        "dose", "mapping", f"{{value: {GRAY.unit}, table: rows of {row(GRAY)}}}",
        "What the radiation dose does to the stiffness; it multiplies what the temperature does.",
        "{value: 2.0e5, table: [[0, 1, 1], [1.0e6, 1.25, 1.2]]}", default=None, absent="nothing", inner=DOSE,
    ),
    Field(
        "axial_stiffness", "number", "EA in newtons", "Axial stiffness EA.", "299",
        default=None, absent="inextensible", size=FORCE_STIFFNESS,
        extent="not with friction_model sliding",
    ),
    Field(
        "shear_stiffness", vector(2), "[GAx, GAy] in newtons",
        "Shear stiffness along the section's x and y axes.", "[92, 92]",
        default=None, absent="sections stay across the centreline", size=FORCE_STIFFNESS,
        extent="not with friction_model sliding",
    ),
    Field(
        "limits", "mapping", "some of {bend_radius: m, tension: N, torsion: rad/m, clearance: m}",
        "What the cable stands: a warning from 80 % on, an error beyond.", "{bend_radius: 0.04, tension: 20}",
        default=None, absent="none", inner=CABLE_LIMITS,
    ),
    Field(
        "start", "mapping", _MOUNT_REMEDY,
        "Clamp at the start; the z axis of its frame is the cable's tangent, pointing from start to end.",
        "{position: [0, 0, 0], rpy: [1.570796, 0, 0]}", inner=MOUNT,
    ),
    Field(
        "end", "mapping", _MOUNT_REMEDY, "Clamp at the end, with the tangent in the same sense.",
        "{link: turret, position: [0.080, 0.145, 0.075], orientation: [0, 0, 0, 1]}", inner=MOUNT,
    ),
    Field(
        "supports", "list of mappings", "a list of clips, pins, rings and tubes, or leave it out",
        "What holds it between its ends; see [ends.md](ends.md).",
        "[{name: wrist_clip, clip: {arc_length: 0.31, position: [0, 0, 1], orientation: [0, 0, 0, 1]}}]",
        default=(), absent="none", extent="of different names", inner=SUPPORT,
    ),
)  # fmt: skip


def read_cable(values: Any, source: str, place: str, links: tuple[str, ...] | None) -> Cable:
    """A cable of a scene.

    Args:
        values: its entry as it stands in the scene.
        source: how messages name the scene.
        place: its place there.
        links: of the robot; None where there is none.

    Raises:
        SceneError: one sentence with file, field and remedy.
    """
    section = Section(values, source, place, CABLE)
    name = section.text("name")
    if len(name) > _TOKEN_LENGTH or not _TOKEN.fullmatch(name):
        section.fail(
            f"'{name}' cannot be part of a ROS topic name; "
            f"use up to {_TOKEN_LENGTH} letters, digits and single underscores, a letter first",
            "name",
        )
    length = section.number("length")
    diameter, stiffness = _stiffness(section, length)
    density = section.number("linear_density")
    if diameter is not None and density > SOLID_DENSITY * math.pi / 4 * diameter**2:
        section.fail(
            f"{density:g} kg/m in a diameter of {diameter:g} m would be heavier than any solid; "
            f"{LINEAR_DENSITY.too_high}; give kg/m",
            "linear_density",
        )
    twist = section.number("total_twist") if "total_twist" in section else None
    axial = section.number("axial_stiffness") if "axial_stiffness" in section else None
    shear = section.vector("shear_stiffness", 2) if "shear_stiffness" in section else None
    start = read_mount(section, "start", links)
    end = read_mount(section, "end", links)
    outer = _outer_diameter(section, length, diameter)
    supports = read_supports(section, length, outer or diameter or 0.0, links)
    held = [start, *(support.mount for support in supports), end]
    for one, other in itertools.pairwise(held):
        check_ends(section, one, other)
    if not supports and start.link == end.link and FREE not in (start.kind, end.kind):
        chord = math.dist(start.position, end.position)
        if chord > CHORD_RATIO * length:
            section.fail(
                f"this clamp is {chord:g} m from the start of a cable of {length:g} m; "
                f"{MILLIMETRES}; give metres",
                "end.position",
            )
    cable = Cable(
        name, length, stiffness, density, start, end, diameter, twist,
        outer_diameter=outer,
        natural_strain=_natural_strain(section, length),
        temperature=read_influence(section, "temperature", CELSIUS),
        dose=read_influence(section, "dose", GRAY),
        axial_stiffness=axial, shear_stiffness=shear,
        limits=read_limits(section, 0.5 * (outer or diameter or 0.0)),
        supports=supports,
    )  # fmt: skip
    check_supports(section, cable)
    return cable


def _outer_diameter(section: Section, length: float, diameter: float | None) -> float | None:
    if "outer_diameter" not in section:
        return None
    outer = section.number("outer_diameter")
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


def check_density(cable: Cable, source: str, place: str) -> None:
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
    strain = section.vector("natural_strain", 3)
    whole = length * math.hypot(*strain)
    if whole > MOST_NATURAL:
        section.fail(
            f"it winds the cable through {whole:g} rad; it looks like 1/mm or degrees; "
            f"give {section.remedy('natural_strain')}",
            "natural_strain",
        )
    return strain


def _stiffness(section: Section, length: float) -> tuple[float | None, np.ndarray]:
    """Diameter, and EIx, EIy, GJ: as given, or of a round section by (14)-(16) of the paper.

    A tube's second moments of area are those of the whole less those of what is missing.
    """
    given = [name for name in _SECTION_FIELDS if name in section]
    choice = "give either stiffness, or diameter with youngs_modulus and shear_modulus"
    if "stiffness" in section:
        if given:
            section.fail(f"both stiffness and {' and '.join(given)} are given; {choice}")
        stiffness = section.vector("stiffness", 3)
        worst = max(stiffness[:2])
        if not BENDING.low <= worst <= BENDING.high:
            slip = f"; {BENDING.too_high}" if worst > BENDING.high else ""
            section.fail(
                f"a bending stiffness of {worst:g} N m^2 is outside {BENDING.low:g} to {BENDING.high:g} N m^2"
                f"{slip}; give {section.remedy('stiffness')}",
                "stiffness",
            )
        return None, stiffness
    if not given:
        section.fail(f"neither stiffness nor diameter is given; {choice}")
    diameter = section.number("diameter")
    if diameter >= length:
        section.fail(
            f"{diameter:g} m is not below the length of {length:g} m; {MILLIMETRES}; give metres", "diameter"
        )
    hole = _inner_diameter(section, diameter)
    young = section.number("youngs_modulus")
    shear = section.number("shear_modulus")
    second_moment = math.pi * (diameter**4 - hole**4) / 64  # Ix = Iy; the polar Iz is twice as large
    stiffness = np.array([young * second_moment, young * second_moment, shear * 2 * second_moment])
    stiffness.setflags(write=False)
    return diameter, stiffness


def _inner_diameter(section: Section, diameter: float) -> float:
    """Of a tube, m; 0 for a solid section."""
    if "inner_diameter" not in section:
        return 0.0
    inner = section.number("inner_diameter")
    if inner > THINNEST_WALL * diameter:
        section.fail(
            f"{inner:g} m leaves no wall within the diameter of {diameter:g} m; give less than "
            f"{THINNEST_WALL * diameter:g} m",
            "inner_diameter",
        )
    return inner
