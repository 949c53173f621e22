# SPDX-License-Identifier: Apache-2.0
"""The robot's own links as obstacles: `obstacles: [{robot: {...}}]`."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Container, Iterable, Iterator, Sequence

from cable_ros.scene.collision import Piece, bodies, pieces, placed_by
from cable_ros.scene.errors import SceneError, suggestion
from cable_ros.scene.fitted_urdf import with_solids
from cable_ros.scene.model import FREE, Cable, Robot
from cable_ros.scene.obstacles import Obstacle
from cable_ros.scene.section import Section, describe, plain
from cable_ros.scene.solids import distances
from cable_ros.scene.urdf import link_names

LONGEST_NAME = 100
"""Characters of a name that a message repeats."""


def read(section: Section, robot: Robot | None, cables: Sequence[Cable]) -> tuple[Robot, list[Obstacle]]:
    """The obstacles of an entry with `robot`, and the robot with solids for the meshes that they are.

    Raises:
        SceneError: one sentence with file, field and remedy.
    """
    for name, remedy in (("link", "name links within robot"), ("friction", "give it within robot")):
        if name in section:
            section.fail(f"it stands beside robot; {remedy}", name)
    if robot is None:
        section.fail(
            "there is no robot; add 'robot: {urdf: FILE}' to the scene, "
            "or let the node take it from robot_description",
            "robot",
        )
    inner = section.inner("robot")
    links, named_links = _links(inner, robot)
    robot = with_solids(robot, links)
    solids = pieces(robot.urdf, robot.source, links)
    if not solids:
        inner.fail("none of these links has collision geometry; leave the robot out", "links")
    margin, friction = inner.number("margin"), inner.number("friction")
    prefix = f"{section.text('name')}/" if "name" in section else ""
    clamped = Clamped(robot, cables)
    found = [
        Obstacle(
            prefix + name, piece.shape, friction, piece.link,
            margin=margin, left_out_by=clamped.within(piece, margin),
        )
        for name, piece in named(solids)
    ]  # fmt: skip
    return dataclasses.replace(robot, named=robot.named | named_links), found


def beside(
    robot: Robot, cables: Sequence[Cable], joint_names: Iterable[str], modelled: bool
) -> tuple[list[Obstacle], dict[str, str]]:
    """The links that are not among the scene's obstacles, as such, if these joints tell where they are.

    Args:
        robot: of the scene.
        cables: of the scene.
        joint_names: joints whose values are known.
        modelled: whether the links that the scene names are obstacles in its equations.

    Returns:
        The obstacles, and by link why its collision geometry cannot be used.

    Raises:
        SceneError: the URDF's joints cannot be used.
    """
    links = placed_by(robot.urdf, robot.source, joint_names) - (robot.named if modelled else frozenset())
    solids: list[Piece] = []
    unknown: dict[str, str] = {}
    try:
        robot, found = _kept_solids(robot, links)
        solids += sorted(found, key=lambda piece: piece.link)
    except SceneError:  # link by link, to leave out those that are at fault
        for link in sorted(links):
            try:
                robot, found = _kept_solids(robot, {link})
                solids += found
            except SceneError as error:
                unknown[link] = str(error)
    clamped = Clamped(robot, cables)
    return [
        Obstacle(name, piece.shape, 0.0, piece.link, left_out_by=clamped.within(piece))
        for name, piece in named(solids)
    ], unknown


def _kept_solids(robot: Robot, links: Container[str]) -> tuple[Robot, tuple[Piece, ...]]:
    """The collision geometry of these links, and the robot with it; meshes that are not fitted yet raise."""
    robot = with_solids(robot, links, fit_new=False)
    return robot, pieces(robot.urdf, robot.source, links)


def fit_meshes(robot: Robot) -> Iterator[str]:
    """Fit the meshes of all links, which are then kept; yields why a link's cannot be fitted."""
    for link in link_names(robot.urdf, robot.source):
        try:
            with_solids(robot, {link})
        except SceneError as error:
            yield str(error)


def named(solids: Sequence[Piece]) -> Iterator[tuple[str, Piece]]:
    """Each piece with its name: that of its link, and a number where the link has several."""
    total, seen = Counter(piece.link for piece in solids), Counter[str]()
    for piece in solids:
        seen[piece.link] += 1
        yield f"{piece.link}/{seen[piece.link]}" if total[piece.link] > 1 else piece.link, piece


class Clamped:
    """Which cables are clamped in a piece of a link: they cannot touch what holds them.

    A clamp belongs to all links that are fixed to its own.
    """

    def __init__(self, robot: Robot, cables: Sequence[Cable]) -> None:
        self._bodies = bodies(robot.urdf, robot.source)
        self._clamps = []
        for cable in cables:
            for mount in cable.all_mounts:
                if mount.kind == FREE:
                    continue
                body = self._bodies[mount.link]
                point = body.position + body.turn @ mount.position
                self._clamps.append((cable, body.top, point))

    def within(self, piece: Piece, margin: float = 0.0) -> tuple[str, ...]:
        """Names of the cables whose ball about a clamp on the piece's body meets the piece."""
        body = self._bodies[piece.link]
        found = []
        for cable, top, point in self._clamps:
            if top == body.top:
                own = (point - body.position) @ body.turn
                if distances(piece.shape, own[None])[0] < cable.radius + margin:
                    found.append(cable.name)
        return tuple(dict.fromkeys(found))


def _links(section: Section, robot: Robot) -> tuple[set[str], set[str]]:
    """The links that `links` and `except` of a section choose, and all that they speak of."""
    known = link_names(robot.urdf, robot.source)
    chosen = set(known)
    if section.values.get("links", "all") != "all":
        chosen = set(_listed(section, "links", known))
    left = chosen - set(_listed(section, "except", known))
    if not left:
        section.fail("no link is left; leave the robot out, or some links in", "except")
    return left, chosen


def _listed(section: Section, name: str, known: Sequence[str]) -> list[str]:
    value = plain(section.get(name)) if name in section else []
    if not isinstance(value, list) or (name in section and not value):
        section.fail(f"must be {section.remedy(name)}, not {describe(value)}", name)
    for i, link in enumerate(value):
        if link not in known:
            hint = suggestion(link, known) if isinstance(link, str) else ""
            shown = f"'{link[:LONGEST_NAME]}'" if isinstance(link, str) else describe(link)
            section.fail(
                f"the robot has no link {shown}{hint}; its links are {', '.join(known)}", f"{name}[{i}]"
            )
    return value
