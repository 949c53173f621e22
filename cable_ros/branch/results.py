# SPDX-License-Identifier: Apache-2.0
"""Results of a rod at an equilibrium, in SI units and in the world."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from cable_ros.branch.coupled_modes import Piece
from cable_ros.branch.modes import modes, vibrating
from cable_ros.contact.fixed_set import FixedSetRod
from cable_ros.contact.report import contact_table
from cable_ros.contact.response import HELD
from cable_ros.equilibrium import ContactTable, Equilibrium, Modes, Status
from cable_ros.linalg.cross import cross_matrix
from cable_ros.rod import output, quaternion
from cable_ros.rod.elements import Mesh, equally_spaced, integrals, sampling
from cable_ros.rod.extensible import StretchingRod
from cable_ros.rod.held_rod import HeldRod
from cable_ros.rod.kirchhoff import Rod
from cable_ros.rod.units import Units


def wrenches(rod: Rod, q: np.ndarray, F: np.ndarray, unit: Units) -> tuple[np.ndarray, np.ndarray]:
    """(6,), (6,): wrenches of the cable on its end and start clamps, N and N m, in the clamps' frames.

    `rod` is at an equilibrium with the nodal frames q (n, 4) and the end force F (3,), in units of the cable.
    """
    both = both_wrenches(rod, q, F, unit)
    return both[6:], both[:6]


def both_wrenches(rod: Rod, q: np.ndarray, F: np.ndarray, unit: Units) -> np.ndarray:
    """(12,) the `wrenches` on the start clamp, then on the end clamp."""
    if isinstance(rod, HeldRod):
        end, start = rod.supports(q, F).on_mounts(rod.qe, unit.force, unit.moment)
        return np.concatenate([start, end])
    out = np.empty(12)
    output.wrenches(F, rod.f, rod.contact_force(), rod.qe, rod.g, unit.force, unit.moment, out[6:], out[:6])
    return out


class Reader:
    """Computes wrenches, points and frames of rods; keeps the interpolation table of the last mesh."""

    def __init__(self, slides: bool = False) -> None:
        """`slides`: whether points and unit are others at every call, so that no table is worth keeping."""
        self._slides = slides
        self._known: tuple[Mesh, int | np.ndarray, Units, tuple[Any, ...]] | None = None

    def read(
        self,
        rod: Rod,
        q: np.ndarray,
        F: np.ndarray,
        start: np.ndarray,
        unit: Units,
        where: int | np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """End and start wrench as in `wrenches`, points (c, 3), world, m, and frames (c, 4), x y z w.

        Args:
            rod, q, F: at an equilibrium, with its nodal frames (n, 4) and end force (3,).
            start: (7,) the start clamp in the world, m, quaternion x y z w.
            unit: of the cable.
            where: number of points at equal arc lengths, or rising arc lengths (c,), L.
        """
        count = where if isinstance(where, int) else len(where)
        end_wrench, start_wrench = np.empty(6), np.empty(6)
        points, orientations = np.empty((count, 3)), np.empty((count, 4))
        out, contact = (end_wrench, start_wrench, points, orientations), rod.contact_force()
        if rod.adapts_mesh or self._slides or (rod.on_grid and rod.soft):
            at = equally_spaced(count) if isinstance(where, int) else where
            table = (unit.force, unit.moment, unit.length), integrals(rod.mesh.element.order), at
            output.read_anywhere(q, (rod.h, rod.s0), start, F, rod.f, contact, rod.qe, rod.g, table, out)
            rod.stretch_anywhere(q, F, at, start, unit.length, points)
            if not rod.clamped:
                end_wrench[:], start_wrench[:] = wrenches(rod, q, F, unit)
            return out
        known = self._known
        if known is None or known[0] is not rod.mesh or _other(known[1], where) or known[2] is not unit:
            scale = unit.force, unit.moment, unit.length
            self._known = known = rod.mesh, where, unit, (scale, tuple(sampling(rod.mesh, where)))
        table = known[3]
        output.read(q, rod.h, start, F, rod.f, contact, rod.qe, rod.g, table, out)
        if not rod.clamped:
            end_wrench[:], start_wrench[:] = wrenches(rod, q, F, unit)
        rod.stretch_points(q, F, table[1], start, unit.length, points)
        return out


def _other(a: int | np.ndarray, b: int | np.ndarray) -> bool:
    """Whether two descriptions of points differ; arrays are not compared by value."""
    return a is not b if isinstance(b, np.ndarray) else a != b


def touching(
    rod: Rod, q: np.ndarray, names: Sequence[str], start: np.ndarray, unit: Units
) -> Callable[[], ContactTable] | None:
    """A function that returns the contacts when called; from copies, since the rod changes. None: no contact.

    Args:
        rod, q: at an equilibrium, with its nodal frames (n, 4), kept.
        names: of the obstacles.
        start: (7,) the start clamp in the world, m, quaternion x y z w; kept.
        unit: of the cable.
    """
    contacts = rod.loaded_contacts(q)
    return None if contacts is None else partial(contact_table, contacts, names, start, unit)


class Tangent:
    """The linearised equations about an equilibrium; from a copy of the rod, since the rod changes.

    Implements `equilibrium.Linearised`. It costs little until it is used.
    """

    __slots__ = (
        "_F",
        "_compliance",
        "_conditions",
        "_density",
        "_names",
        "_q",
        "_snapshot",
        "_start",
        "_unit",
    )

    def __init__(
        self, rod: Rod, q: np.ndarray, F: np.ndarray, unit: Units, names: Sequence[str], start: np.ndarray,
        density: float,
    ) -> None:  # fmt: skip
        """About the equilibrium of `rod` with the nodal frames q (n, 4) and the end force F (3,).

        `names` of the obstacles; `start` (7,), kept, the start clamp in the world, m, quaternion x y z w;
        `density` the mass per length, kg/m.
        """
        self._snapshot, self._conditions = rod.snapshot(), (rod.qe, rod.re, rod.f)
        self._q, self._F, self._unit, self._names, self._density = q, F, unit, names, density
        self._start, self._compliance = start, rod.compliance  # the rod's is another at another length

    def _rod(self, held: bool = False) -> Rod:
        copy = self._snapshot()
        copy.compliance = self._compliance
        copy.set_conditions(*self._conditions)
        if held and isinstance(copy, FixedSetRod | StretchingRod):
            copy.yield_at_end(HELD)
        return copy

    @property
    def slack(self) -> float:
        """What the cable is longer than the distance of its ends, as a fraction of its length."""
        return 1.0 - float(np.linalg.norm(self._conditions[1]))

    def modes(self, count: int, points: int) -> Modes:
        """See `Equilibrium.modes`."""
        return modes(self._rod(), self._q, self._F, self._start, self._unit, self._density, count, points)

    def piece(self) -> Piece:
        """Of a cable with supports, one that vibrates."""
        own = vibrating(self._rod(held=True), self._q, self._F)
        return Piece(own, self._unit, self._density, self._start)

    def wrench_response(self, obstacles: Sequence[str], held: bool = False) -> np.ndarray:
        """See `Equilibrium.wrench_response`; `held`: whether an end stays that would yield."""
        return self.response_of(self.numbers(obstacles), held)

    def parts(self) -> tuple[Any, np.ndarray, np.ndarray, Units, np.ndarray]:
        """A rod at the equilibrium, its nodal frames and end force, the cable's units and its start clamp."""
        return self._rod(), self._q, self._F, self._unit, self._start

    def numbers(self, obstacles: Sequence[str]) -> list[int]:
        """Of obstacles by name."""
        names = list(self._names)
        return [names.index(name) for name in obstacles]

    def obstacle(self, which: int) -> str:
        """The name of an obstacle by its number."""
        return self._names[which]

    def response_of(self, moving: Sequence[int], held: bool = False) -> np.ndarray:
        """The same for obstacles by number."""
        copy, q, F, unit, start = self._rod(held), self._q, self._F, self._unit, self._start
        scale_wrench = np.tile(np.repeat([unit.force, unit.moment], 3), 2 + len(moving))
        scale_motion = np.tile(np.repeat([unit.length, 1.0], 3), 2 + len(moving))
        response = copy.wrench_response(q, F, moving)
        response = -response * scale_wrench[:, None] / scale_motion[None, :]
        if moving:
            # obstacles: from the start clamp's frame to the world's
            turn = quaternion.matrix_from_ros(start[3:]).T
            seen = np.eye(len(response))
            for at in range(12, len(response), 6):
                seen[at : at + 3, at : at + 3] = seen[at + 3 : at + 6, at + 3 : at + 6] = turn
                seen[at : at + 3, at + 3 : at + 6] = -turn @ cross_matrix(start[:3])
            response = seen.T @ response @ seen
        return response


def failed(status: Status, message: str, solve_time: float, polyline_points: int) -> Equilibrium:
    """A result without numbers."""
    n, nan = polyline_points, np.nan
    return Equilibrium(
        status=status, message=message, converged=False, stable=False, stability_margin=nan,
        end_wrench=np.full(6, nan), start_wrench=np.full(6, nan), points=np.full((n, 3), nan),
        orientations=np.full((n, 4), nan), total_twist=nan, energy=nan, error_estimate=nan, iterations=0,
        solve_time=solve_time,
    )  # fmt: skip
