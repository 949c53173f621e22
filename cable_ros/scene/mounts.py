# SPDX-License-Identifier: Apache-2.0
"""What holds the ends of a cable: fields of `start` and `end`, and what does not make sense."""

from __future__ import annotations

import math

import numpy as np

from cable_ros.scene.fields import MILLIMETRES, Field, Size, vector
from cable_ros.scene.model import CLAMPED, FREE, KINDS, PINNED, SLIDING, SWIVEL, Mount
from cable_ros.scene.placement import LINK, ROTATION, read_link, rotation
from cable_ros.scene.section import Section

FORCE = Size("N", -1e6, 1e6)
MOMENT = Size("N m", -1e6, 1e6, *["it looks like N mm"] * 2)

LINK_REACH = 50.0
WORLD_REACH = 1e5
"""m; a mount farther than this from the origin of its link, or of the world, is a slip of units."""

MOUNT = (
    Field(
        "kind", "text", ", ".join(KINDS[:-1]) + f" or {KINDS[-1]}",
        "How the end is held; see [ends.md](ends.md).", CLAMPED, default=CLAMPED, words=KINDS,
    ),
    LINK,
    Field(
        "position", vector(3), "[x, y, z] in metres",
        "Point that holds the end, in the link's frame, or in the world.", "[0.080, 0.145, 0.075]", unit="m",
        extent=f"within {LINK_REACH:g} m of the link's origin, {WORLD_REACH:g} m of the world's",
        absent="required; not for `free`",
    ),
    *ROTATION,
    Field(
        "axis", vector(3), "a direction [x, y, z], such as [0, 0, 1]",
        "Direction in which a `sliding` end slides, along the axes of its own frame.", "[0, 0, 1]",
        default=None, absent="[0, 0, 1], along the tangent",
    ),
    Field(
        "axial_force", "number", "newtons",
        "Force of the mount on the cable along `axis`; at the end of a cable along z a positive one pulls.",
        "2.0", default=None, absent="0", size=FORCE,
    ),
    Field(
        "rotation", "text", "held or free", "Whether a `sliding` end may turn.", "held", default="held",
        words=("held", "free"),
    ),
    Field(
        "force", vector(3), "[x, y, z] in newtons",
        "Force on the cable at a `free` end, along the axes of the link, or of the world.", "[0, 0, -2]",
        default=None, absent="none", size=FORCE,
    ),
    Field(
        "moment", vector(3), "[x, y, z] in newton metres",
        "Moment on the cable at a `free` end, along the same axes.", "[0, 0.01, 0]", default=None,
        absent="none", size=MOMENT,
    ),
)  # fmt: skip

BELONGS = {"axis": SLIDING, "axial_force": SLIDING, "rotation": SLIDING, "force": FREE, "moment": FREE}


def read_mount(cable: Section, name: str, links: tuple[str, ...] | None) -> Mount:
    """`start` or `end` of a cable.

    Raises:
        SceneError: one sentence with file, field and remedy.
    """
    section = cable.inner(name)
    kind = section.choice("kind")
    for field, belongs in BELONGS.items():
        if field in section and kind != belongs:
            section.fail(
                f"'{field}' is for a {belongs} end, and this one is {kind}; leave it out, "
                f"or give 'kind: {belongs}'",
                field,
            )
    link = read_link(section, links)
    if kind == FREE:
        return _free(section, link)
    position = read_position(section, link)
    level = kind == PINNED and "orientation" not in section and "rpy" not in section
    turn = _constant([0.0, 0.0, 0.0, 1.0]) if level else rotation(section)
    if kind != SLIDING:
        return Mount(position, turn, link, kind)
    axis = section.vector("axis", 3) if "axis" in section else _constant([0.0, 0.0, 1.0])
    size = math.hypot(*axis)
    if not size > 0.0:
        section.fail("a direction of length 0 is none; give [0, 0, 1] for the tangent", "axis")
    axial = section.number("axial_force") if "axial_force" in section else 0.0
    turns = section.choice("rotation") == "free"
    return Mount(
        position, turn, link, kind, _constant(axis / size), _constant(axial * axis / size), turns=turns
    )


def read_position(section: Section, link: str | None) -> np.ndarray:
    """(3,) in the frame of the link, or of the world, m."""
    position = section.vector("position", 3)
    reach = math.hypot(*position)
    if reach > (WORLD_REACH if link is None else LINK_REACH):
        frame = "the world" if link is None else "its link"
        section.fail(f"{reach:g} m from the origin of {frame}; {MILLIMETRES}; give metres", "position")
    return position


def _free(section: Section, link: str | None) -> Mount:
    for field in ("position", "orientation", "rpy"):
        if field in section:
            section.fail(f"a free end has no {field}: nothing holds it; leave it out", field)
    force, moment = (
        section.vector(name, 3) if name in section else _constant([0.0, 0.0, 0.0])
        for name in ("force", "moment")
    )
    if link is not None and not (force.any() or moment.any()):
        section.fail("a free end without force and moment needs no axes for them; leave 'link' out", "link")
    return Mount(_constant([0.0, 0.0, 0.0]), _constant([0.0, 0.0, 0.0, 1.0]), link, FREE, None, force, moment)


def check_ends(cable: Section, start: Mount, end: Mount) -> None:
    """Raise SceneError for what cannot be solved with these two ends."""
    kinds = f"the start is {start.kind} and the end {end.kind}"
    if not (start.holds or end.holds):
        cable.fail(
            f"{kinds}, so that nothing holds the cable in place; make one of them clamped, swivel or pinned",
            "end.kind",
        )
    twist_free = any(mount.turns or mount.kind in (PINNED, SWIVEL, FREE) for mount in (start, end))
    for name, one, other in (("start", start, end), ("end", end, start)):
        if one.moment.any() and other.kind != CLAMPED:
            cable.fail(
                f"{kinds}, and nothing but a clamp takes up a moment; clamp the other end, or leave it out",
                f"{name}.moment",
            )
    if "supports" in cable and "total_twist" in cable:
        cable.fail(
            "the twist of a cable with supports is that of its pieces; leave 'total_twist' out",
            "total_twist",
        )
    if twist_free and "total_twist" in cable:
        cable.fail(
            f"{kinds}, so that the cable untwists itself; leave 'total_twist' out, which chooses among the "
            "branches of a cable that cannot turn about its tangent at either end",
            "total_twist",
        )


def _constant(values: list[float] | np.ndarray) -> np.ndarray:
    out = np.array(values, float)
    out.setflags(write=False)
    return out
