"""The part of a URDF that the clamps need: the chains of joints from the root to their links."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterable

from cable_ros.scene.errors import SceneError

_MOVING = ("revolute", "continuous", "prismatic")


def _parse(urdf: str, source: str) -> ET.Element:
    try:
        root = ET.fromstring(urdf.strip())
    except ET.ParseError as error:
        raise SceneError(source, "", f"this is not the XML of a URDF ({error})") from None
    if "xacro" in urdf and any("xacro" in str(element.tag) for element in root.iter()):
        raise SceneError(source, "", "this is a xacro file; expand it first: xacro FILE > robot.urdf")
    if root.tag != "robot":
        raise SceneError(source, "", f"its root element is <{root.tag}>; give a URDF, whose root is <robot>")
    return root


def link_names(urdf: str, source: str) -> tuple[str, ...]:
    """Names of the robot's links, as the URDF lists them; `source` names it in messages.

    Raises:
        SceneError: not a URDF, or one without links.
    """
    names = tuple(link.get("name", "") for link in _parse(urdf, source).findall("link"))
    if not names:
        raise SceneError(source, "", "this URDF has no links")
    return names


def chains(urdf: str, source: str, links: Iterable[str]) -> str:
    """A URDF with only the joints between the root and the given links, in the order of the chains.

    Masses, meshes and limits are left out; a continuous joint becomes a revolute one, which counts
    turns. The links must be in the URDF.

    Raises:
        SceneError: a joint on the way is of a kind that has no single angle or stroke, mimics another,
            or the joints do not form a tree with one root.
    """
    root = _parse(urdf, source)
    parent_joint: dict[str, ET.Element] = {}
    for joint in root.findall("joint"):
        name = joint.get("name", "")
        child = _link_of(joint, "child", source)
        if child in parent_joint:
            other = parent_joint[child].get("name", "")
            raise SceneError(source, f"joint '{name}'", f"link '{child}' already hangs on joint '{other}'")
        parent_joint[child] = joint

    out = ET.Element("robot", name="chains")
    kept: dict[str, None] = {}
    roots: set[str] = set()
    for link in links:
        chain: list[str] = [link]
        while chain[-1] in parent_joint:
            chain.append(_link_of(parent_joint[chain[-1]], "parent", source))
            if len(chain) > len(parent_joint) + 1:
                raise SceneError(source, f"link '{link}'", "its joints form a ring, not a tree")
        roots.add(chain[-1])
        kept.update(dict.fromkeys(reversed(chain)))
    if len(roots) > 1:
        raise SceneError(
            source, "", f"no joints connect the links {', '.join(sorted(roots))}; a URDF has one root"
        )
    for link in kept:
        ET.SubElement(out, "link", name=link)
    for link in kept:
        if link in parent_joint:
            out.append(_bare_joint(parent_joint[link], source))
    return ET.tostring(out, encoding="unicode")


def _link_of(joint: ET.Element, end: str, source: str) -> str:
    element = joint.find(end)
    name = element.get("link") if element is not None else None
    if not name:
        raise SceneError(source, f"joint '{joint.get('name', '')}'", f"it has no {end} link")
    return name


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
        ET.SubElement(bare, end, link=_link_of(joint, end, source))
    origin = joint.find("origin")
    if origin is not None:
        for key in ("xyz", "rpy"):
            _triple(origin, key, "0 0 0", source, place)
        bare.append(origin)
    if kind == "fixed":
        bare.set("type", "fixed")
        return bare
    axis = joint.find("axis")
    direction = _triple(axis, "xyz", "1 0 0", source, place)
    norm = math.hypot(*direction)
    if norm == 0:
        raise SceneError(source, place, "its axis is zero; give a direction such as 0 0 1")
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
