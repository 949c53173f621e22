# SPDX-License-Identifier: Apache-2.0
"""The collision geometry of a URDF: solids on links, and meshes that solids may stand for."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Container, Iterable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from cable_ros.scene.errors import SceneError
from cable_ros.scene.fields import Size
from cable_ros.scene.obstacles import COORDINATE, EDGE, RADIUS, Box, Capsule, Cylinder, Sphere
from cable_ros.scene.solids import Solid, placed
from cable_ros.scene.urdf_tree import link_of, parse

SOLIDS = ("sphere", "cylinder", "box", "capsule")
SCALE = Size("", 1e-6, 1e6)


@dataclass(frozen=True, eq=False)
class Piece:
    """A solid of a link."""

    link: str
    shape: Solid
    """In the link's frame."""


class Body(NamedTuple):
    """Where a link is in the rigid body that fixed joints make of it and others."""

    top: str
    """The body's first link; the following are in its frame."""
    position: np.ndarray
    """(3,) of the link's origin, m."""
    turn: np.ndarray
    """(3, 3) rotation matrix of the link."""


def pieces(urdf: str, source: str, links: Container[str]) -> tuple[Piece, ...]:
    """The collision geometry of these links but for meshes, in the order of the URDF.

    Raises:
        SceneError: one sentence: a geometry of another kind, or numbers that cannot be.
    """
    out = []
    for link, place, collision in collisions(parse(urdf, source), links):
        geometry = geometry_of(collision, source, place)
        if geometry.tag != "mesh":
            position, turn = origin_of(collision, source, place)
            out.append(Piece(link, placed(_solid(geometry, source, place), position, turn)))
    return tuple(out)


def placed_by(urdf: str, source: str, joint_names: Iterable[str]) -> frozenset[str]:
    """The links whose poses follow from the values of these joints."""
    root = parse(urdf, source)
    known = {*joint_names, *(j.get("name", "") for j in root.findall("joint") if j.get("type") == "fixed")}
    parents = {link_of(joint, "child", source): joint for joint in root.findall("joint")}
    out = set()
    for link in root.findall("link"):
        name = at = link.get("name", "")
        while at in parents and parents[at].get("name", "") in known:
            at = link_of(parents[at], "parent", source)
        if at not in parents:
            out.add(name)
    return frozenset(out)


def collisions(root: ET.Element, links: Container[str]) -> Iterator[tuple[str, str, ET.Element]]:
    """Link, how messages name the place, and element of each collision of these links."""
    for link in root.findall("link"):
        name = link.get("name", "")
        if name not in links:
            continue
        for number, collision in enumerate(link.findall("collision"), 1):
            yield name, f"link '{name}', collision {number}", collision


def geometry_of(collision: ET.Element, source: str, place: str) -> ET.Element:
    """The element within <geometry>. Raises SceneError unless it is a solid or a mesh."""
    geometry = collision.find("geometry")
    for shape in geometry if geometry is not None else ():
        if shape.tag in (*SOLIDS, "mesh"):
            return shape
        raise SceneError(
            source, place, f"its geometry <{shape.tag}> is unknown; give {', '.join(SOLIDS)} or mesh"
        )
    raise SceneError(source, place, f"it has no geometry; give {', '.join(SOLIDS)} or mesh")


def origin_of(element: ET.Element, source: str, place: str) -> tuple[np.ndarray, np.ndarray]:
    """Position (3,), m, and rotation matrix (3, 3) of an element's <origin>; the identity without one."""
    origin = element.find("origin")
    if origin is None:
        return np.zeros(3), np.eye(3)
    position = numbers(origin, "xyz", 3, source, place, COORDINATE, "0 0 0")
    angles = numbers(origin, "rpy", 3, source, place, Size("rad", -1e4, 1e4), "0 0 0")
    return position, Rotation.from_euler("xyz", angles).as_matrix()


def numbers(
    element: ET.Element, key: str, count: int, source: str, place: str, size: Size, default: str = ""
) -> np.ndarray:
    """(count,) an attribute's numbers. Raises SceneError unless they are within `size`."""
    text = element.get(key, default)
    try:
        out = np.array([float(word) for word in text.split()])
    except ValueError:
        out = np.empty(0)
    wanted = "a number" if count == 1 else f"{count} numbers"
    if len(out) != count or not all(map(math.isfinite, out)):
        raise SceneError(source, place, f"its {key} '{text}' is not {wanted}")
    if out.min() < size.low or out.max() > size.high:
        slip = f"; {size.too_high}" if size.too_high and out.max() > size.high else ""
        unit = f" {size.unit}" if size.unit else ""
        raise SceneError(
            source, place, f"its {key} '{text}' is outside {size.low:g} to {size.high:g}{unit}{slip}"
        )
    return out


def _solid(geometry: ET.Element, source: str, place: str) -> Solid:
    """The shape about its own origin; a URDF's axis is z."""
    if geometry.tag == "box":
        return Box(np.zeros(3), numbers(geometry, "size", 3, source, place, EDGE), np.array([0, 0, 0, 1.0]))
    (radius,) = numbers(geometry, "radius", 1, source, place, RADIUS).tolist()
    if geometry.tag == "sphere":
        return Sphere(np.zeros(3), radius)
    (length,) = numbers(geometry, "length", 1, source, place, EDGE)
    end = np.array([0.0, 0.0, 0.5 * length])
    return Cylinder(-end, end, radius) if geometry.tag == "cylinder" else Capsule(-end, end, radius)


def bodies(urdf: str, source: str) -> dict[str | None, Body]:
    """By link, the rigid body that it is part of; None: the world, whose body is the root link's."""
    root = parse(urdf, source)
    parents = {link_of(joint, "child", source): joint for joint in root.findall("joint")}
    out: dict[str | None, Body] = {}
    for link in root.findall("link"):
        name = top = link.get("name", "")
        position, turn = np.zeros(3), np.eye(3)
        while top in parents and parents[top].get("type") == "fixed":
            there, turned = origin_of(parents[top], source, f"joint '{parents[top].get('name', '')}'")
            position, turn = there + turned @ position, turned @ turn
            top = link_of(parents[top], "parent", source)
        out[name] = Body(top, position, turn)
        if name not in parents:
            out[None] = out[name]
    return out
