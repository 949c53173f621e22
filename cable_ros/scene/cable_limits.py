# SPDX-License-Identifier: Apache-2.0
"""What a cable stands: its smallest bend radius, largest tension and torsion, least clearance."""

from __future__ import annotations

from dataclasses import dataclass

from cable_ros.scene.fields import MILLIMETRES, Field, Size
from cable_ros.scene.section import Section

BEND_RADIUS = Size("m", 1e-4, 1e3, too_high=MILLIMETRES)
TENSION = Size("N", 1e-6, 1e9)
TORSION = Size("rad/m", 1e-6, 1e4, too_high="it looks like degrees per metre")
CLEARANCE = Size("m", 1e-6, 100.0, too_high=MILLIMETRES)

CABLE_LIMITS = (
    Field(
        "bend_radius", "number", "metres", "Smallest radius to which the cable may be bent.", "0.04",
        default=None, absent="not watched", size=BEND_RADIUS, extent="at least the cable's own radius",
    ),
    Field(
        "tension", "number", "newtons", "Largest force along the cable.", "20",
        default=None, absent="not watched", size=TENSION,
    ),
    Field(
        "torsion", "number", "rad/m", "Largest twist per length, either way, beyond the natural one.", "6",
        default=None, absent="not watched", size=TORSION,
    ),
    Field(
        "clearance", "number", "metres", "Least distance of the cable's surface from every obstacle.", "0.01",
        default=None, absent="not watched", size=CLEARANCE,
    ),
)  # fmt: skip


@dataclass(frozen=True)
class CableLimits:
    """Limits of one cable, SI; None: that quantity is not watched."""

    bend_radius: float | None = None
    """Smallest bend radius, m."""
    tension: float | None = None
    """Largest tension, N."""
    torsion: float | None = None
    """Largest twist per length beyond the natural one, either way, rad/m."""
    clearance: float | None = None
    """Least distance of its surface from obstacles, m."""


def read_limits(cable: Section, radius: float) -> CableLimits | None:
    """The limits of a cable of this outer radius, m; None where it has none.

    Raises:
        SceneError: one sentence with file, field and remedy.
    """
    if "limits" not in cable:
        return None
    section = cable.inner("limits")
    given = {name: section.number(name) for name in section.fields if name in section}
    if not given:
        section.fail(f"no limit is given; give one of {', '.join(section.fields)}, or leave 'limits' out")
    bend_radius = given.get("bend_radius", radius)
    if bend_radius < radius:
        section.fail(
            f"{bend_radius:g} m is less than the cable's own radius of {radius:g} m; "
            "give the radius of the centreline",
            "bend_radius",
        )
    return CableLimits(**given)
