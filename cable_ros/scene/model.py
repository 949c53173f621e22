# SPDX-License-Identifier: Apache-2.0
"""What there is: cables, their mounts and the robot that moves them. SI units, quaternions x y z w."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from cable_ros.scene.cable_limits import CableLimits
from cable_ros.scene.influences import Influence
from cable_ros.scene.obstacles import Obstacle

EFFECTS = (
    "weight", "natural_strain", "temperature", "dose", "stretch", "shear", "contact", "friction",
)  # fmt: skip
"""What a scene may call for beyond bending and torsion, by the names that its `effects` may list."""


KINDS = CLAMPED, PINNED, SWIVEL, SLIDING, FREE = "clamped", "pinned", "swivel", "sliding", "free"
"""How an end is held: in position and orientation; in position; but for turning about the tangent; across an
axis; not at all."""
SUPPORTS = CLIP, PIN, RING, TUBE = "clip", "pin", "ring", "tube"
"""What holds a cable between its ends: in position and orientation; in position; across the tangent only;
across the tangent and in direction."""
NOTHING = np.zeros(3)


@dataclass(frozen=True, eq=False)
class Mount:
    """What holds an end. The z axis of its frame is the cable's tangent at a clamp, from start to end."""

    position: np.ndarray
    """(3,) point that holds the end, in the link's frame, or in the world where there is no link, m."""
    orientation: np.ndarray
    """(4,) unit quaternion x y z w of the mount's frame in the same frame."""
    link: str | None = None
    """Link of the robot that carries it; None: fixed in the world. Of a free end: whose axes its load has."""
    kind: str = CLAMPED
    """One of `KINDS`."""
    axis: np.ndarray | None = None
    """(3,) unit vector along which a sliding end slides, in the mount's frame."""
    force: np.ndarray = field(default_factory=lambda: NOTHING)
    """(3,) given force on a sliding or free end, in the mount's frame, N."""
    moment: np.ndarray = field(default_factory=lambda: NOTHING)
    """(3,) given moment on a free end, in the mount's frame, N m."""
    turns: bool = False
    """Whether a sliding end may turn."""

    @property
    def holds(self) -> bool:
        """Whether the end stays at `position`."""
        return self.kind in (CLAMPED, PINNED, SWIVEL)


@dataclass(frozen=True, eq=False)
class Support:
    """What holds a cable between its ends."""

    name: str
    arc_length: float
    """From the cable's start, m; of a ring or tube: at first."""
    mount: Mount
    """Where it is. Its orientation is that of the cable in a clip, and of its direction, z, in a tube; of a
    pin or ring it is only that of the wrench's axes."""
    kind: str = CLIP
    """One of `SUPPORTS`."""
    friction: float = 0.0
    """Coulomb's coefficient of a ring."""

    @property
    def couples(self) -> bool:
        """Whether what is on one side of it depends on the other: at all but a clip."""
        return self.kind != CLIP

    @property
    def slides(self) -> bool:
        """Whether the cable slides through it."""
        return self.kind in (RING, TUBE)


@dataclass(frozen=True, eq=False)
class Cable:
    """One cable, held at its ends; straight, untwisted and inextensible unless it says otherwise."""

    name: str
    """Also its part of the topic names."""
    length: float
    """m."""
    stiffness: np.ndarray
    """(3,) bending about the section's x and y axes and torsion: EIx, EIy, GJ, N m^2."""
    linear_density: float
    """kg/m."""
    start: Mount
    end: Mount
    diameter: float | None = None
    """m; None where the scene gives the stiffness itself."""
    total_twist: float | None = None
    """Target, rad: selects the branch to start on; None: the stable equilibrium of least energy found."""

    outer_diameter: float | None = None
    """m, where contact must count more than `diameter`, or there is none."""
    natural_strain: np.ndarray | None = None
    """(3,) curvature about the section's x, y and twist of the unloaded cable, 1/m; None: straight."""
    temperature: Influence | None = None
    """What the temperature does to the stiffness; None: nothing."""
    dose: Influence | None = None
    """What the radiation dose does to the stiffness; None: nothing."""
    axial_stiffness: float | None = None
    """EA, N; None: inextensible."""
    shear_stiffness: np.ndarray | None = None
    """(2,) GA along the section's x and y axes, N; None: sections stay across the tangent."""
    limits: CableLimits | None = None
    """What it stands; None: nothing is watched."""
    supports: tuple[Support, ...] = ()
    """Between its ends, by rising arc length."""

    @property
    def radius(self) -> float:
        """Half of what counts in contact, m; 0 for a cable without a diameter."""
        return 0.5 * (self.outer_diameter or self.diameter or 0.0)

    @property
    def mounts(self) -> tuple[Mount, Mount]:
        """Start, end."""
        return self.start, self.end

    @property
    def all_mounts(self) -> tuple[Mount, ...]:
        """Start, supports, end."""
        return self.start, *(support.mount for support in self.supports), self.end

    @property
    def released(self) -> str:
        """What lets it turn or slide, in words; empty if clamps alone hold it."""
        for name, mount in (("start", self.start), ("end", self.end)):
            if mount.kind != CLAMPED:
                return f"a {mount.kind} {name}"
        return next((f"the {one.kind} '{one.name}'" for one in self.supports if one.couples), "")

    @property
    def pieces(self) -> tuple[Cable, ...]:
        """The parts between supports, each a cable of its own with this one's name; without them itself."""
        return self._cut_at(self.supports)

    @property
    def runs(self) -> tuple[Cable, ...]:
        """The parts between clips, each with the supports that are in it."""
        return self._cut_at(tuple(support for support in self.supports if not support.couples))

    def _cut_at(self, where: tuple[Support, ...]) -> tuple[Cable, ...]:
        if not where:
            return (self,)
        cuts = [0.0, *(support.arc_length for support in where), self.length]
        mounts = [self.start, *(support.mount for support in where), self.end]
        parts = []
        for i in range(len(cuts) - 1):
            inside = tuple(
                replace(one, arc_length=one.arc_length - cuts[i])
                for one in self.supports
                if cuts[i] < one.arc_length < cuts[i + 1]
            )
            length = cuts[i + 1] - cuts[i]
            parts.append(replace(self, length=length, start=mounts[i], end=mounts[i + 1], supports=inside))
        return tuple(parts)


@dataclass(frozen=True)
class MeshFit:
    """How well solids stand for a mesh of a link's collision geometry."""

    link: str
    solids: int
    outside: float
    """How far they stand out of the mesh, m."""
    bare: float
    """How far the mesh stands out of them, m."""


@dataclass(frozen=True, eq=False)
class Robot:
    """The robot's description."""

    urdf: str
    """The URDF's text."""
    source: str
    """Where it comes from, for messages."""
    path: Path | None = None
    """Its file; None where the text was given."""
    named: frozenset[str] = frozenset()
    """Links that the scene's obstacles speak of, those that they leave out by name included."""
    fits: tuple[MeshFit, ...] = ()
    """Meshes that `urdf` has solids for."""
    meshes: bool = True
    """Whether mesh files that it names may be opened."""


@dataclass(frozen=True, eq=False)
class Scene:
    """All that a tracker needs to know before the first joint state."""

    cables: tuple[Cable, ...]
    gravity: np.ndarray
    """(3,) world, m/s^2."""
    robot: Robot | None
    text: str
    """The scene's YAML text, as it was read."""
    path: Path | None
    """The scene's file; None where it was given as a mapping."""
    source: str
    """How messages name the scene."""
    obstacles: tuple[Obstacle, ...] = ()
    friction_model: str = "coulomb"
    """coulomb: stick and slip; sliding: fully mobilised against the end's motion, (53) of Liu et al."""
    cable_contact: bool = False
    """Whether cables touch each other and themselves; if not, where they overlap is told."""
    effects: str | tuple[str, ...] = "all"
    """auto: what matters at the tolerance; all: what has numbers in the scene; or some of `EFFECTS`."""
    cable_friction: float = 0.0
    """Coefficient of friction where cables touch each other."""

    @property
    def pieces(self) -> tuple[Cable, ...]:
        """The pieces of all cables, cable by cable; see `Cable.pieces`."""
        return tuple(piece for cable in self.cables for piece in cable.pieces)

    def strains(self, cable: Cable) -> bool:
        """Whether a cable stretches or shears."""
        fields = (("stretch", cable.axial_stiffness), ("shear", cable.shear_stiffness))
        return any(
            value is not None and (isinstance(self.effects, str) or name in self.effects)
            for name, value in fields
        )

    @property
    def has_contact(self) -> bool:
        """Whether its cables may touch obstacles."""
        return bool(self.obstacles) and (isinstance(self.effects, str) or "contact" in self.effects)

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences about what became of the robot's links as obstacles; mostly none."""
        held = [
            f"Cable '{cable}' passes through '{obstacle.name}', in which it is clamped."
            for obstacle in self.obstacles
            for cable in obstacle.left_out_by
        ]
        fits = [
            f"The mesh of '{fit.link}', as {fit.solids} solid{'s'[: fit.solids - 1]}: they stand out of it "
            f"by up to {fit.outside * 1e3:.3g} mm, it out of them by up to {fit.bare * 1e3:.2g} mm."
            for fit in (self.robot.fits if self.robot else ())
        ]
        return (*fits, *held)

    def __repr__(self) -> str:
        cables, obstacles = (", ".join(one.name for one in many) for many in (self.cables, self.obstacles))
        return f"Scene({self.source}; cables: {cables}; obstacles: {obstacles or 'none'})"
