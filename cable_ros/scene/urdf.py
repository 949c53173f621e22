# SPDX-License-Identifier: Apache-2.0
"""The part of a URDF that the clamps need: the chains of joints from the root to their links."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping

from cable_ros.scene.caps import FARTHEST_ORIGIN, MOST_MOVING
from cable_ros.scene.errors import SceneError
from cable_ros.scene.urdf_tree import check_tree, link_of, parse

_MOVING = ("revolute", "continuous", "prismatic")


def link_names(urdf: str, source: str) -> tuple[str, ...]:
    """Names of the robot's links, as the URDF lists them; `source` names it in messages.

    Raises:
        SceneError: not a URDF, or one that is not a tree of named links and joints.
    """
    return check_tree(parse(urdf, source), source)


def chains(urdf: str, source: str, links: Iterable[str]) -> str:
    """A URDF with only the joints between the root and the given links, in the order of the chains.

    Masses, meshes and limits are left out; a continuous joint becomes a revolute one, which counts
    turns. The links must be in the URDF.

    Raises:
        SceneError: a joint on the way is of a kind that has no single angle or stroke, or mimics another, or
            the URDF is no tree.
    """
    root = parse(urdf, source)
    check_tree(root, source)
    parent_joint = {link_of(joint, "child", source): joint for joint in root.findall("joint")}
    out = ET.Element("robot", name="chains")
    kept: dict[str, None] = {}
    for link in links:
        chain: list[str] = [link]
        while chain[-1] in parent_joint:
            chain.append(link_of(parent_joint[chain[-1]], "parent", source))
        kept.update(dict.fromkeys(reversed(chain)))
    for link in kept:
        ET.SubElement(out, "link", name=link)
    joints = [parent_joint[link] for link in kept if link in parent_joint]
    moving = sum(joint.get("type") != "fixed" for joint in joints)
    if moving > MOST_MOVING:
        raise SceneError(
            source, "", f"{moving} joints move the clamps and obstacles, more than {MOST_MOVING}; fix some"
        )
    for joint in joints:
        out.append(_bare_joint(joint, source))
    return ET.tostring(out, encoding="unicode")


def joint_elements(urdf: str, source: str) -> dict[str, ET.Element]:
    """The URDF's joints by name. Raises SceneError where it is no URDF."""
    return {joint.get("name", ""): joint for joint in parse(urdf, source).findall("joint")}


def number_of(given: Mapping[str, str], key: str, default: float, source: str, place: str) -> float:
    """A number among the attributes of an element; it may be infinite. Raises SceneError for another text."""
    try:
        number = float(given.get(key, default))
    except ValueError:
        number = math.nan
    if math.isnan(number):
        raise SceneError(source, place, f"its {key} limit '{given[key]}' is not a number")
    return number


def _bare_joint(joint: ET.Element, source: str) -> ET.Element:
    name, kind = joint.get("name", ""), joint.get("type", "")
    place = f"joint '{name}'"
    if kind != "fixed" and kind not in _MOVING:
        raise SceneError(
            source,
            place,
            f"its type '{kind}' cannot move a clamp; use fixed, revolute, continuous or prismatic joints",
        )
    if joint.find("mimic") is not None:
        raise SceneError(
            source, place, "it mimics another joint, which is not supported; give it a state of its own"
        )
    bare = ET.Element("joint", name=name, type="prismatic" if kind == "prismatic" else "revolute")
    for end in ("parent", "child"):
        ET.SubElement(bare, end, link=link_of(joint, end, source))
    origin = joint.find("origin")
    if origin is not None:
        for key in ("xyz", "rpy"):
            triple = _triple(origin, key, "0 0 0", source, place)
            if max(map(abs, triple)) > FARTHEST_ORIGIN:
                unit = "millimetres; give metres" if key == "xyz" else "something else than radians"
                raise SceneError(
                    source,
                    place,
                    f"its {key} '{origin.get(key)}' is beyond {FARTHEST_ORIGIN:g}; it looks like {unit}",
                )
        bare.append(origin)
    if kind == "fixed":
        bare.set("type", "fixed")
        return bare
    axis = joint.find("axis")
    direction = _triple(axis, "xyz", "1 0 0", source, place)
    norm = math.hypot(*direction)
    if not 1e-9 < norm < 1e9:
        size = f"{norm:g} long" if norm else "zero"
        raise SceneError(source, place, f"its axis is {size}; give a direction such as 0 0 1")
    ET.SubElement(bare, "axis", xyz=" ".join(repr(v / norm) for v in direction))
    ET.SubElement(bare, "limit", lower="-1e9", upper="1e9", effort="1e9", velocity="1e9")
    return bare


def _triple(
    element: ET.Element | None, key: str, default: str, source: str, place: str
) -> tuple[float, float, float]:
    text = element.get(key, default) if element is not None else default
    try:
        x, y, z = (float(v) for v in text.split())
    except ValueError:
        x = y = z = math.nan
    if not all(map(math.isfinite, (x, y, z))):
        raise SceneError(source, place, f"its {key} '{text}' is not three finite numbers")
    return x, y, z
