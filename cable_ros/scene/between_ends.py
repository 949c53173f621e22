# SPDX-License-Identifier: Apache-2.0
"""What holds a cable between its ends: the fields of `supports`, and what does not make sense."""

from __future__ import annotations

import itertools
import re

import numpy as np

from cable_ros.scene.fields import MILLIMETRES, Field, Size, vector
from cable_ros.scene.model import CLAMPED, CLIP, RING, SUPPORTS, TUBE, Cable, Mount, Support
from cable_ros.scene.mounts import LINK_REACH, WORLD_REACH, read_position
from cable_ros.scene.placement import LINK, ROTATION, read_link, rotation
from cable_ros.scene.section import Section

ARC_LENGTH = Size("m", 0.0, 100.0, too_high=MILLIMETRES)
COEFFICIENT = Size("1", 0.0, 10.0)

SHORTEST = 0.01
"""m; a shorter piece between two supports is a slip of units."""
MOST_SUPPORTS = 50
TOKEN = re.compile(r"[A-Za-z](?:_?[A-Za-z0-9]){0,79}")
LEVEL = np.array([0.0, 0.0, 0.0, 1.0])
LEVEL.setflags(write=False)


def _arc_length(text: str) -> Field:
    return Field(
        "arc_length", "number", "metres", text, "0.31", size=ARC_LENGTH, extent="within the cable"
    )  # fmt: skip


POSITION = Field(
    "position", vector(3), "[x, y, z] in metres",
    "Point that holds the cable, in the link's frame, or in the world.", "[0.1, 0.05, 0.02]", unit="m",
    extent=f"within {LINK_REACH:g} m of the link's origin, {WORLD_REACH:g} m of the world's",
)  # fmt: skip
AXES = tuple(
    Field(
        field.name, field.kind, field.remedy,
        f"{field.meaning} Of the axes that its wrench is given along, for the cable turns freely.",
        field.example, unit=field.unit, extent=field.extent, size=field.size, default=None,
        absent="those of the link or the world",
    )
    for field in ROTATION
)  # fmt: skip

CLIP_FIELDS = (
    _arc_length("Arc length of the cable at which it is clamped, from its start."),
    LINK,
    POSITION,
    *ROTATION,
)
PIN_FIELDS = (
    _arc_length("Arc length of the cable at which it is held, from its start."),
    LINK,
    POSITION,
    *AXES,
)
RING_FIELDS = (
    _arc_length("Arc length of the cable that is in the ring at first, from its start."),
    LINK,
    POSITION,
    *AXES,
    Field(
        "friction", "number", "a coefficient, such as 0.2",
        "Coulomb's coefficient of the cable sliding through the ring.", "0.2", default=0.0, absent="0",
        size=COEFFICIENT,
    ),
)  # fmt: skip
TUBE_FIELDS = (
    _arc_length("Arc length of the cable that is in the tube at first, from its start."),
    LINK,
    POSITION,
    *ROTATION,
)

ONE_OF = "one of `clip`, `pin`, `ring` and `tube` is required"

SUPPORT = (
    Field(
        "name", "text", "a name, such as wrist_clip", "Name, which is also part of its topic.", "wrist_clip",
        extent="letters, digits and single underscores, a letter first; not start or end",
    ),
    Field(
        "clip", "mapping", "{arc_length: m, position: [x, y, z], orientation: [x, y, z, w]}, with a link",
        "Clamps the cable at an arc length; its frame is like that of `start`.",
        "{arc_length: 0.31, position: [0.1, 0.05, 0.02], orientation: [0, 0, 0, 1]}", default=None,
        absent=ONE_OF, inner=CLIP_FIELDS,
    ),
    Field(
        "pin", "mapping", "{arc_length: m, position: [x, y, z]}, with a link",
        "Holds the cable at an arc length and lets it turn.",
        "{arc_length: 0.31, position: [0.1, 0.05, 0.02]}", default=None, absent=ONE_OF, inner=PIN_FIELDS,
    ),
    Field(
        "ring", "mapping", "{arc_length: m, position: [x, y, z], friction: 0.2}, with a link",
        "Lets the cable slide and turn through a point.",
        "{arc_length: 0.31, position: [0.1, 0.05, 0.02]}", default=None, absent=ONE_OF, inner=RING_FIELDS,
    ),
    Field(
        "tube", "mapping", "{arc_length: m, position: [x, y, z], orientation: [x, y, z, w]}, with a link",
        "Lets the cable slide and turn through a short guide, along its z axis.",
        "{arc_length: 0.31, position: [0.1, 0.05, 0.02], orientation: [0, 0, 0, 1]}", default=None,
        absent=ONE_OF, inner=TUBE_FIELDS,
    ),
)  # fmt: skip


def read_supports(
    cable: Section, length: float, thickness: float, links: tuple[str, ...] | None
) -> tuple[Support, ...]:
    """The supports of a cable of this length and outer diameter, m, by rising arc length.

    Raises:
        SceneError: one sentence with file, field and remedy.
    """
    if "supports" not in cable:
        return ()
    found: list[Support] = []
    place = cable.at("supports")
    for i, entry in enumerate(cable.items("supports", MOST_SUPPORTS)):
        section = Section(entry, cable.source, f"{place}[{i}]", SUPPORT)
        name = section.text("name")
        if not TOKEN.fullmatch(name) or name in ("start", "end"):
            section.fail(
                f"'{name}' cannot be part of a ROS topic name, or is taken by an end; use letters, digits "
                "and single underscores, a letter first",
                "name",
            )
        if any(support.name == name for support in found):
            section.fail(f"'{name}' is already the name of a support; give each its own", "name")
        kinds = [kind for kind in SUPPORTS if kind in section]
        if len(kinds) != 1:
            section.fail(f"give one of {', '.join(SUPPORTS[:-1])} and {SUPPORTS[-1]}, not {len(kinds)}")
        found.append(_support(section, name, kinds[0], links))
    found.sort(key=lambda support: support.arc_length)
    cuts = [0.0, *(support.arc_length for support in found), length]
    least = max(SHORTEST, thickness)
    for before, after in itertools.pairwise(cuts):
        if after - before < least:
            cable.fail(
                f"between the arc lengths {before:g} and {after:g} m are {after - before:g} m of a cable of "
                f"{length:g} m; give supports that are {least:g} m or more apart, and from the ends",
                "supports",
            )
    return tuple(found)


def _support(section: Section, name: str, kind: str, links: tuple[str, ...] | None) -> Support:
    inner = section.inner(kind)
    link = read_link(inner, links)
    turned = kind in (CLIP, TUBE) or "orientation" in inner or "rpy" in inner
    mount = Mount(read_position(inner, link), rotation(inner) if turned else LEVEL, link)
    friction = inner.number("friction") if kind == RING and "friction" in inner else 0.0
    return Support(name, inner.number("arc_length"), mount, kind, friction)


def check_supports(cable: Section, read: Cable) -> None:
    """Raise SceneError for what cannot be solved with pins, rings and tubes."""
    for run in read.runs:
        released = [support for support in run.supports if support.kind != CLIP]
        if not released:
            continue
        which = " and ".join(f"{support.kind} '{support.name}'" for support in released[:2])
        first, last = run.mounts
        if CLAMPED not in (first.kind, last.kind):
            cable.fail(
                f"nothing holds the twist of the cable at its {which}, through which it turns freely; clamp "
                "an end, or put a clip beside it",
                "supports",
            )
        for name, mount in (("start", read.start), ("end", read.end)):
            if mount in run.mounts and mount.moment.any():
                cable.fail(
                    f"the cable turns freely at its {which}, and a moment on a free end needs a clamp next "
                    "to it; put a clip there, or leave the moment out",
                    f"{name}.moment",
                )
