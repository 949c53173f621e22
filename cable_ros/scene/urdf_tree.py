# SPDX-License-Identifier: Apache-2.0
"""A URDF as a tree: its XML, and what its links and joints must be for one."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from xml.parsers import expat

from cable_ros.scene.caps import (
    DEEPEST_ELEMENT,
    LONGEST_CHAIN,
    MOST_ELEMENTS,
    MOST_LINKS,
    MOST_URDF_CHARACTERS,
)
from cable_ros.scene.errors import SceneError


def parse(urdf: str, source: str) -> ET.Element:
    """The element <robot>; `source` names the URDF in messages.

    Raises:
        SceneError: not the XML of a URDF, a xacro file, or more than a robot needs.
    """
    if len(urdf) > MOST_URDF_CHARACTERS:
        raise SceneError(source, "", f"has more than {MOST_URDF_CHARACTERS} characters; give a robot's URDF")
    text = urdf.strip()
    try:
        _check_amount(text, source)
        root = ET.fromstring(text)
    except (ET.ParseError, expat.ExpatError, ValueError, LookupError) as error:
        if isinstance(error, SceneError):
            raise
        raise SceneError(source, "", f"this is not the XML of a URDF ({error})") from None
    if "xacro" in urdf and any("xacro" in str(element.tag) for element in root.iter()):
        raise SceneError(source, "", "this is a xacro file; expand it first: xacro FILE > robot.urdf")
    if root.tag != "robot":
        raise SceneError(source, "", f"its root element is <{root.tag}>; give a URDF, whose root is <robot>")
    return root


def _check_amount(text: str, source: str) -> None:
    """Raise SceneError if the XML has a document type, or too many elements, before any is kept."""
    count = depth = 0

    def start(*_: object) -> None:
        nonlocal count, depth
        count, depth = count + 1, depth + 1
        if count > MOST_ELEMENTS:
            raise SceneError(source, "", f"has more than {MOST_ELEMENTS} elements; give a robot's URDF")
        if depth > DEEPEST_ELEMENT:
            raise SceneError(source, "", f"nests its elements more than {DEEPEST_ELEMENT} deep; give a URDF")

    def end(_: object) -> None:
        nonlocal depth
        depth -= 1

    def document_type(*_: object) -> None:
        raise SceneError(
            source, "", "it has a document type (<!DOCTYPE>), which a URDF needs not; take it out"
        )

    parser = expat.ParserCreate("utf-8")
    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.StartDoctypeDeclHandler = document_type
    parser.Parse(text.encode(), True)


def check_tree(root: ET.Element, source: str) -> tuple[str, ...]:
    """Names of the robot's links, as the URDF lists them.

    Raises:
        SceneError: links or joints without a name or with the same one, a joint on a link that is not there,
            or joints that do not form one tree.
    """
    links = _names(root, "link", source)
    if not links:
        raise SceneError(source, "", "this URDF has no links")
    if len(links) > MOST_LINKS:
        raise SceneError(source, "", f"has {len(links)} links, more than {MOST_LINKS}; leave some out")
    known = set(links)
    _names(root, "joint", source)
    parents: dict[str, tuple[str, str]] = {}
    for joint in root.findall("joint"):
        name = joint.get("name", "")
        place = f"joint '{name}'"
        parent, child = link_of(joint, "parent", source), link_of(joint, "child", source)
        for end, link in (("parent", parent), ("child", child)):
            if link not in known:
                raise SceneError(
                    source, place, f"its {end} link '{link}' is not defined; add <link name=...>"
                )
        if child in parents:
            other = parents[child][1]
            raise SceneError(source, place, f"link '{child}' already hangs on joint '{other}'")
        parents[child] = parent, name
    _check_chains(links, parents, source)
    return links


def link_of(joint: ET.Element, end: str, source: str) -> str:
    """The name of a joint's link at its `end`, parent or child. Raises SceneError where there is none."""
    element = joint.find(end)
    name = element.get("link") if element is not None else None
    if not name:
        raise SceneError(source, f"joint '{joint.get('name', '')}'", f"it has no {end} link")
    return name


def _names(root: ET.Element, kind: str, source: str) -> tuple[str, ...]:
    seen: dict[str, None] = {}
    for element in root.findall(kind):
        name = element.get("name", "")
        if not name:
            raise SceneError(source, "", f"a {kind} has no name; give each its own")
        if name in seen:
            raise SceneError(
                source, f"{kind} '{name}'", f"there are two of this name; give each {kind} its own"
            )
        if not name.isprintable():
            raise SceneError(source, f"{kind} '{name}'", "its name holds a control character; take it out")
        seen[name] = None
    return tuple(seen)


def _check_chains(links: tuple[str, ...], parents: dict[str, tuple[str, str]], source: str) -> None:
    """Raise SceneError unless every link hangs on one root, by a chain that is not too long."""
    depths = {link: 0 for link in links if link not in parents}
    roots = list(depths)
    if len(roots) > 1:
        raise SceneError(
            source, "", f"no joints connect the links {', '.join(sorted(roots))}; a URDF has one root"
        )
    for link in links:
        chain: list[str] = []
        while link not in depths:
            chain.append(link)
            link = parents[link][0]
            if len(chain) > len(parents):
                raise SceneError(source, f"link '{link}'", "its joints form a ring, not a tree")
        for above, name in enumerate(reversed(chain), depths[link] + 1):
            depths[name] = above
            if above > LONGEST_CHAIN:
                raise SceneError(
                    source,
                    f"link '{name}'",
                    f"more than {LONGEST_CHAIN} joints lead to it; leave out links that nothing needs",
                )
