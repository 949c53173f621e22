# SPDX-License-Identifier: Apache-2.0
"""The result of one solve for one cable."""

from __future__ import annotations

import enum
import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from functools import cached_property
from typing import Any, Protocol

import numpy as np

from cable_ros.limits import Extreme
from cable_ros.linalg.cross import cross


class Status(enum.Enum):
    """Outcome of one solve; the value is the sentence that a person reads."""

    CONVERGED = "Converged to a stable equilibrium."
    SNAPPED = "The branch ended at a fold: the cable snapped to another stable equilibrium."
    BRANCH_LOST = "The branch was lost without a fold: these numbers may be those of another equilibrium."
    UNFINISHED = (
        "The way to this pose is long: the solve used up its budget and goes on from here at the next call."
    )
    OUT_OF_REACH = "The clamps are farther apart than the cable is long."
    NOT_CONVERGED = "The solver did not converge; the numbers are not to be trusted."
    INVALID_INPUT = "The input is not a usable number or a needed joint is missing."

    def __init__(self, sentence: str) -> None:
        self.sentence = sentence
        """The value, quicker to get."""
        self.trusted = self.name in ("CONVERGED", "SNAPPED")
        """Whether numbers with this status may be published as true."""


@dataclass(frozen=True, eq=False)
class Contact:
    """A place where the cable touches an obstacle.

    Where it lies on the obstacle, a point force at each end of that stretch, and the pressure between them as
    forces at the points of a Gauss rule.
    """

    obstacle: str
    """Its name in the scene; with `cable_contact` also that of another cable, or its own."""
    arc_length: float
    """From the start, m."""
    position: np.ndarray
    """(3,) of the centreline, world, m."""
    normal: np.ndarray
    """(3,) out of the obstacle, unit vector, world."""
    force: np.ndarray
    """(3,) on the cable, friction included, world, N."""
    length: float
    """Of the part of the cable that the force is spread along, m; 0: a point force."""
    sliding: bool
    """Whether friction has given way; false without friction."""
    other_arc_length: float | None = None
    """Where on the other cable, or on the other strand of its own, from the start, m; None on an obstacle."""

    @property
    def normal_force(self) -> float:
        """Part of the force along the normal, N; never negative."""
        return float(self.force @ self.normal)

    @property
    def friction(self) -> np.ndarray:
        """(3,) part of the force across the normal, world, N."""
        return self.force - self.normal_force * self.normal


@dataclass(frozen=True)
class Overlap:
    """A cable within another, within itself or within a link of the robot, where contact is not modelled."""

    other: str
    """Name of the other cable; its own where the cable meets itself; or the link's."""
    distance: float
    """Smallest distance of the centrelines, of a polyline of some 100 points, m; from the surface of a link,
    negative inside."""
    contact_distance: float
    """At which the surfaces would touch: the sum of the outer radii, m."""
    between: tuple[float, float] | None = None
    """First and last arc length within a link, m; None for a cable."""


@dataclass(frozen=True, eq=False)
class ContactTable:
    """All `Contact`s of a cable, by rising arc length, a field an array; world, SI units."""

    names: tuple[str, ...]
    """Of the scene's obstacles, and of other cables that it touches."""
    obstacle: np.ndarray
    """(n,) int, in `names`."""
    arc_length: np.ndarray
    """(n,)."""
    position: np.ndarray
    """(n, 3)."""
    normal: np.ndarray
    """(n, 3)."""
    force: np.ndarray
    """(n, 3)."""
    length: np.ndarray
    """(n,)."""
    sliding: np.ndarray
    """(n,) bool."""
    other_arc_length: np.ndarray | None = None
    """(n,) on the other cable, NaN on an obstacle; None: no contact is with a cable."""

    def contacts(self) -> tuple[Contact, ...]:
        """One by one."""
        rows = zip(
            self.obstacle.tolist(), self.arc_length.tolist(), self.position, self.normal, self.force,
            self.length.tolist(), self.sliding.tolist(), strict=True,
        )  # fmt: skip
        found = tuple(Contact(self.names[which], *row) for which, *row in rows)
        if self.other_arc_length is None:
            return found
        others = (None if math.isnan(s) else s for s in self.other_arc_length.tolist())
        return tuple(replace(one, other_arc_length=s) for one, s in zip(found, others, strict=True))

    def obstacle_wrenches(self) -> dict[str, np.ndarray]:
        """See `Equilibrium.obstacle_wrenches`."""
        exerted = -np.concatenate([self.force, cross(self.position, self.force)], axis=1)
        # another cable is there once for each place where it touches
        which = [self.names.index(self.names[k]) for k in self.obstacle.tolist()]
        sums = np.zeros((len(self.names), 6))
        np.add.at(sums, which, exerted)
        return {self.names[k]: sums[k] for k in sorted(set(which))}


@dataclass(frozen=True, eq=False)
class Modes:
    """The k lowest free vibrations about an equilibrium, clamps and obstacles at rest."""

    frequencies: np.ndarray
    """(k,) rising, Hz; infinite for a cable without mass, NaN without a result."""
    shapes: np.ndarray
    """(k, n, 3) displacement at the n points of the polyline, world; the largest of each mode is 1."""


class Coupled(Protocol):
    """The linearised equations of pieces that share supports."""

    @property
    def count(self) -> int:
        """Number of pieces."""

    def response(self, obstacles: Sequence[str]) -> np.ndarray:
        """See `branch.coupled_tangent.CoupledTangent.response`."""

    def modes(self, count: int, places: Sequence[np.ndarray]) -> Modes:
        """The `count` lowest, with shapes at the `places`: arc lengths on each piece, parts of its length."""


class Linearised(Protocol):
    """The linearised equations about an equilibrium."""

    def wrench_response(self, obstacles: Sequence[str]) -> np.ndarray:
        """See `Equilibrium.wrench_response`."""

    def modes(self, count: int, points: int) -> Modes:
        """See `Equilibrium.modes`; shapes at `points` equal arc lengths."""


@dataclass(frozen=True)
class Equilibrium:
    """One cable's equilibrium at one pose of the robot; SI units.

    Where `status.trusted` is false every number is the solver's last attempt or NaN, never to be
    published as true.
    """

    status: Status
    """How the solve ended; see `overlaps`, too."""
    message: str
    """The status sentence with this case's numbers in it."""
    converged: bool
    stable: bool
    stability_margin: float
    """Smallest eigenvalue of the energy Hessian on the tangent space of the end conditions,
    relative to the elastic stiffness; 0 at a fold."""
    end_wrench: np.ndarray
    """(6,) force [N] then moment [N m] about the clamp point that the cable exerts on the body at
    the end clamp, in the end clamp's frame. Of a pinned or sliding end about the origin and along the axes of
    its mount; of a free one the negative of its load, about the cable's end, along the axes of the load."""
    start_wrench: np.ndarray
    """(6,) the same at the start clamp, in the start clamp's frame."""
    points: np.ndarray
    """(n, 3) centreline at equal arc lengths, world frame, m."""
    orientations: np.ndarray
    """(n, 4) section frames as quaternions x y z w, world frame; z axis = tangent."""
    total_twist: float
    """Integral of the twist over the length, rad: the name of the branch."""
    energy: float
    """Elastic energy plus potential of the weight, heights measured from the world's origin, J."""
    error_estimate: float
    """Estimated relative error of the end wrench."""
    iterations: int
    solve_time: float
    """Wall time of this solve, s, without that of compiling or loading code."""
    overlaps: tuple[Overlap, ...] = ()
    """Where its surface meets another cable's, its own or a link's, which no equation forbids: if any, the
    equilibrium is one of the equations, but not of the real cable. The message then says so, too."""
    _tangent: Linearised | None = field(default=None, repr=False, compare=False)
    _touching: Callable[[], ContactTable | None] | None = field(default=None, repr=False, compare=False)
    _pieces: tuple[Equilibrium, ...] = ()
    _supports: tuple[tuple[str, np.ndarray], ...] = ()
    _coupled: Coupled | None = field(default=None, repr=False, compare=False)
    _mounts: np.ndarray | None = field(default=None, repr=False, compare=False)
    _extremes: Callable[[], tuple[Extreme, ...]] | None = field(default=None, repr=False, compare=False)

    @classmethod
    def of(cls, fields: dict[str, Any]) -> Equilibrium:
        """The constructor in a quarter of its time, which a frozen class spends on a check a field."""
        new = object.__new__(cls)
        vars(new).update(fields)
        return new

    def completed(self, fields: dict[str, Any]) -> Equilibrium:
        """Itself with other `fields`: only for its maker, before anybody has seen it."""
        vars(self).update(fields)
        return self

    def __repr__(self) -> str:
        force = ", ".join(f"{value:.4g}" for value in self.end_wrench[:3])
        return (
            f"Equilibrium({self.status.name}, end force [{force}] N, {len(self.points)} points, "
            f"error estimate {self.error_estimate:.1e})"
        )

    @property
    def overlapping(self) -> bool:
        """Whether it meets itself, another cable or a link of the robot; see `overlaps`."""
        return bool(self.overlaps)

    @property
    def pieces(self) -> tuple[Equilibrium, ...]:
        """Of a cable with supports: the equilibria between them, with arc lengths of their own; or itself.

        Their wrenches are about the points and along the axes of the supports, their stiffness that of a
        piece whose sections are clamped there.
        """
        return self._pieces or (self,)

    @property
    def support_wrenches(self) -> dict[str, np.ndarray]:
        """What the cable exerts on the body of each support, by its name.

        (6,) force [N], then moment [N m] about the support's point, along the axes of its frame. What it
        releases is exactly zero: the moment of a pin and of a ring, that about the axis of a tube.
        """
        sides = zip(self._supports, self._pieces, self._pieces[1:], strict=False)
        return {
            name: held * (one.end_wrench + other.start_wrench) + 0.0 for (name, held), one, other in sides
        }

    @property
    def wrench_axes(self) -> np.ndarray:
        """(2, 4) axes of `start_wrench` and of `end_wrench`, quaternions x y z w, world."""
        return self.orientations[[0, -1]] if self._mounts is None else self._mounts

    @cached_property
    def _contact_table(self) -> ContactTable | None:
        return None if self._touching is None else self._touching()

    @cached_property
    def contacts(self) -> tuple[Contact, ...]:
        """Where it touches obstacles, by rising arc length; read off when first asked for."""
        return () if self._contact_table is None else self._contact_table.contacts()

    @cached_property
    def extremes(self) -> tuple[Extreme, ...]:
        """Smallest bend radius, largest tension and torsion, least clearance, each with its place and limit.

        Only of a cable with `limits` in its scene and of a trusted result, otherwise empty; computed when
        first read. The bend radius is that of the sections' turn along the unstretched cable, natural
        curvature included; torsion is the twist beyond the natural one; clearance is that of the surface from
        obstacles, whether or not contact is in the equations.
        """
        return () if self._extremes is None else self._extremes()

    @cached_property
    def obstacle_wrenches(self) -> dict[str, np.ndarray]:
        """What the cable exerts on each obstacle that it touches, by name, friction included.

        (6,) force [N], then moment [N m] about the world's origin, along the world's axes: minus the forces
        of `contacts`, which act on the cable, at their positions on its centreline. (The surfaces touch half
        a diameter away; the moment of friction over that distance is left out on both bodies.)
        """
        return {} if self._contact_table is None else self._contact_table.obstacle_wrenches()

    def modes(self, count: int = 6) -> Modes:
        """The `count` lowest natural frequencies about this equilibrium, and their modes.

        Small vibrations without damping, by a consistent mass matrix of the mass per length; of sections'
        own inertia see `rod.vibration`. Contacts go on pressing and what sticks sticks; what slips is free
        to slide, in rings, too, so that the frequencies are those of the least that holds the cable. Pieces
        between pins, rings and tubes vibrate together. NaN where it is friction alone that makes it stable,
        where a cable touches another one, stretches where it rubs, or shears where it touches. Takes
        milliseconds, on a grid of contacts a second.
        """
        if self._tangent is None:
            return Modes(np.full(count, np.nan), np.full((count, len(self.points), 3), np.nan))
        return self._tangent.modes(count, len(self.points))

    def wrench_response(self, obstacles: Sequence[str] = ()) -> np.ndarray:
        """(12 + 6 k, 12 + 6 k) derivative of wrenches by small motions of both clamps and of k obstacles.

        Rows: the components of `start_wrench` and `end_wrench`, along axes that move with their clamp; then
        of `obstacle_wrenches`. Columns: translation [m] along, then rotation [rad] about the start clamp's
        own axes through its clamp point, the same of the end clamp; then of each obstacle, in their order
        here, translation and rotation about the world's axes through the world's origin. What is not named
        stays where it is; so does the direction of the weight.

        Exact without friction, from the factored tangent at the equilibrium: contacts slide along the cable
        and patches grow as they do, but none begins or ends. With Coulomb friction it is the derivative along
        motions in which what sticks goes on sticking, carried by its obstacle, and what slips slips on the
        same way over its obstacle, with mu times the changing normal force. A motion that turns back, or
        aside, is answered otherwise where something slips. Friction of the model `sliding` follows the
        tangent, the normal and the normal force, and does not turn round. NaN without a result, where the
        equations are singular, and of a cable that stretches where it presses on what has friction: there the
        answer to one direction is not that to the other. (On a grid of contacts, which do not move along the
        cable, it is.)
        """
        size = 12 + 6 * len(obstacles)
        if self._tangent is None:
            return np.full((size, size), np.nan)
        return self._tangent.wrench_response(obstacles)

    @cached_property
    def clamp_stiffness(self) -> np.ndarray:
        """(12, 12) derivative of both wrenches by small motions of both clamps, obstacles at rest.

        Columns: translation [m] along, then rotation [rad] about the start clamp's own axes through its clamp
        point, then the same of the end clamp; rows: the components of `start_wrench`, then of `end_wrench`,
        along axes that move with their clamp. See `wrench_response`, also for what friction does; computed
        when first read.
        """
        return self.wrench_response()

    @property
    def stiffness(self) -> np.ndarray:
        """(6, 6) derivative of `end_wrench` by a small motion of the end clamp, the start clamp held.

        Columns: translation [m] along, then rotation [rad] about the end clamp's own axes through the clamp
        point; rows: the components of `end_wrench`, along the axes that move with the clamp. The last block
        of `clamp_stiffness`; NaN without a result. With W = (f, m) the end wrench and dead loads, its
        antisymmetric part is that of the moving axes: K - K^T = [[0, [f]x], [[f]x, [m]x]] with [v]x u = v x
        u.
        """
        return self.clamp_stiffness[6:, 6:]

    def as_dict(self) -> dict[str, Any]:
        """All public fields by name, and what is computed when asked for, as mappings."""
        out = {f.name: getattr(self, f.name) for f in fields(self) if not f.name.startswith("_")}
        out["contacts"] = [asdict(contact) for contact in self.contacts]
        out["overlaps"] = [asdict(overlap) for overlap in self.overlaps]
        out["extremes"] = [extreme.as_dict() for extreme in self.extremes]
        out["stiffness"] = self.stiffness
        out["support_wrenches"] = self.support_wrenches
        return out
