# SPDX-License-Identifier: Apache-2.0
"""Cold start: the stable equilibria of one pose from fixed initial shapes, and meshes for a tolerance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cable_ros.branch.held_ends import held_starts, load_moment
from cable_ros.contact.distance import CENTRE, FRICTION_COEFFICIENT
from cable_ros.contact.penalty_continuation import FAR, descend
from cable_ros.contact.shortest_path import taut_strings
from cable_ros.contact.stretching_rod import StretchingTouchingRod
from cable_ros.contact.touching_rod import TouchingRod
from cable_ros.rod import quaternion, warm_step
from cable_ros.rod.elements import Mesh, reference_element
from cable_ros.rod.ends import Ends
from cable_ros.rod.extensible import SLACK, StretchingRod
from cable_ros.rod.held_rod import HeldRod
from cable_ros.rod.initial_shapes import along, aside, starts
from cable_ros.rod.kirchhoff import ORDER, Rod
from cable_ros.rod.rod_state import ENERGY, TWIST
from cable_ros.solve.trust_region import Options

TAUT = 0.999
"""Minimum chord, L, at which the search for an extensible cable begins with the straight shape."""
SEARCH = 1e-2
"""Tolerance of contact during a search."""
NEAR = 0.02
"""Maximum difference of total twist, rad, from the target at which a search ends."""
SEARCH_OPTIONS = Options(iterations=60, step_tolerance=1e-8, constraint_tolerance=1e-8)
GRAIN = 2.0**-30
"""To this, L, rad or of the weight, conditions are rounded for a search among obstacles: a descent that
zigzags for fifty iterations makes another equilibrium of a change in the twelfth digit. An arm's joints move
the clamps of a short cable by a hundred times that; `CLAMPED` is ten times the grain."""
LIMIT = 1e9
"""Unlimited work: more than any search takes."""
START_WORK = 60_000.0
"""Budget of one descent among obstacles, iterations times unknowns. Of 300 that converged none took more
than 40,000; those that fail may take five times that."""


@dataclass(frozen=True, eq=False)
class Conditions:
    """Boundary conditions, load and obstacles of a rod, in units of the cable and the start clamp's frame."""

    qe: np.ndarray
    """(4,) end frame, scalar first."""
    re: np.ndarray
    """(3,) end position, L."""
    f: np.ndarray
    """(3,) load per length, EI / L^3."""
    obstacles: np.ndarray | None = None
    """(n, distance.WIDTH); None: no contact."""

    def rounded(self) -> Conditions:
        """These to about nine digits, on a grid whose points round numbers are not half way between."""
        weight = max(float(np.linalg.norm(self.f)), 1.0)
        unit = GRAIN * 2.0 ** np.ceil(np.log2(weight))
        qe, obstacles = GRAIN * np.round(self.qe / GRAIN), None
        if self.obstacles is not None:
            obstacles = self.obstacles.copy()
            placed = obstacles[:, CENTRE:FRICTION_COEFFICIENT]
            placed[:] = GRAIN * np.round(placed / GRAIN)
        re = GRAIN * np.round(self.re / GRAIN)
        return Conditions(qe / np.linalg.norm(qe), re, unit * np.round(self.f / unit), obstacles)


def conditions_of(rod: Rod) -> Conditions:
    """The conditions of the rod's last equilibrium."""
    return Conditions(rod.qe, rod.re, rod.f, rod.obstacles)


@dataclass(frozen=True, eq=False)
class Sought:
    """A pose whose equilibrium is sought, in units of the cable."""

    stiffness: np.ndarray
    """(3,) about the section's axes."""
    natural: np.ndarray
    """(3,) curvature and twist of the unloaded cable."""
    conditions: Conditions
    target_twist: float | None
    """Total twist, rad, of the equilibrium wanted; None: that of least energy."""
    tolerance: float
    """Of the end wrench, relative."""
    compliance: np.ndarray | None = None
    """(3,) of shear and axial strain; None: inextensible and unshearable."""
    ends: Ends | None = None
    """How the ends are held; None: clamped."""
    least: float = Rod.least
    """See `Rod.least`."""
    clamps: tuple[float, float] = Rod.clamps
    """See `Rod.clamps`."""


@dataclass(frozen=True, eq=False)
class Found:
    """A stable equilibrium: the factored rod and its state."""

    rod: Rod
    q: np.ndarray
    """(n, 4) nodal frames."""
    F: np.ndarray
    """(3,) end force, EI / L^2."""
    energy: float
    """EI / L."""
    twist: float
    """Total twist, rad."""
    iterations: int

    @classmethod
    def at(cls, rod: Rod, q: np.ndarray, F: np.ndarray, iterations: int = 0) -> Found:
        """The equilibrium (q, F), for which the rod is factored."""
        return cls(rod, q, F, float(rod.totals[ENERGY]), float(rod.totals[TWIST]), iterations)


def first_mesh(conditions: Conditions, twist: float, tolerance: float) -> Mesh:
    """A coarse mesh for the search: finer for many turns, and at the clamps where weight makes layers.

    Tolerances below 1e-3 get at least four elements. If these resolve one pose, they mostly resolve all, and
    the mesh need not change along the path.
    """
    layer = min(1.0, 3.0 / np.sqrt(max(float(np.linalg.norm(conditions.f)), 1.0)))
    count = (4 if tolerance < 1e-3 else 3) + int(abs(twist) / 6.0)
    half = [0.5]
    smallest = min(max(2.0 * layer, 0.5 / count), 6.0 * _taut_layer(conditions))
    while half[0] > smallest:
        half = [half[0] / 2, half[0] / 2] + half[1:]
    lengths = np.array(half + half[::-1])
    if len(lengths) <= count:
        lengths = np.full(count, 1.0 / count)
    return Mesh(reference_element(ORDER), lengths / lengths.sum())


def _taut_layer(conditions: Conditions) -> float:
    """Length l, in L, of the boundary layers of bending at the clamps of a nearly taut cable.

    An angle a exp(-s / l) between tangent and chord shortens the chord by a^2 l / 4; l is such that the two
    layers take all the slack.
    """
    chord = float(np.linalg.norm(conditions.re))
    along = conditions.re / max(chord, 1e-9)
    end = quaternion.rotate(conditions.qe, np.array([0.0, 0.0, 1.0]))
    bend = 2.0 - float(along[2]) - float(along @ end)
    return max(2.0 * (1.0 - chord) / max(bend, 1e-9), 1e-5)


def settle(rod: Rod, q: np.ndarray, F: np.ndarray, options: Options = Options()) -> Found | None:  # noqa: B008
    """The minimum of the energy near (q, F), factored; or None."""
    return settled(rod, rod.minimum(q, F, options))


def settled(rod: Rod, result: tuple[np.ndarray, np.ndarray, int] | None) -> Found | None:
    """What a descent of the rod ended in: q, F and iterations; or None."""
    if result is None:
        return None
    q, F, iterations = result
    return Found.at(rod, q, F, iterations)


def carried(rod: Rod, q: np.ndarray, F: np.ndarray, conditions: Conditions) -> Found | None:
    """The equilibrium of a rod under other conditions next to (q, F), with its contacts if it can."""
    there = conditions.qe, conditions.re, conditions.f, conditions.obstacles
    if isinstance(rod, TouchingRod) and rod.count:
        touching = rod.snapshot()()
        assert isinstance(touching, TouchingRod)
        touching.set_conditions(*there)
        found = corrected(touching, q, F)
        if found is not None:
            return found
    other = rod.variant(rod.mesh)
    other.set_conditions(*there)
    return settle(other, other.on_end(q), F, SEARCH_OPTIONS)


def corrected(rod: TouchingRod, q: np.ndarray, F: np.ndarray) -> Found | None:
    """The equilibrium of a rod with its contacts next to (q, F), under its conditions, or None."""
    code, iterations, q_new, F_new = rod.correct(
        rod.on_end(q), F, SEARCH_OPTIONS.step_tolerance, remesh=False
    )
    if code != warm_step.ADVANCED or not rod.refactor(q_new, F_new):
        return None
    return Found.at(rod, q_new, F_new, iterations)


class Starts:
    """Energy descents from a fixed list of initial shapes to the stable equilibria of one pose, one by one.

    Args:
        sought: the pose and the target; the search uses a coarse mesh for its tolerance.
        thorough: whether to continue after an equilibrium within NEAR of the target twist.
    """

    def __init__(self, sought: Sought, thorough: bool) -> None:
        self.found: list[Found] = []
        """Distinct equilibria on the coarse mesh, in the order found."""
        self._sought, self._thorough = sought, thorough
        conditions, natural = sought.conditions, sought.natural
        turns = abs(sought.target_twist or 0.0) + float(np.linalg.norm(natural))
        self._mesh = first_mesh(_for_mesh(sought), turns, sought.tolerance)
        self._seen: list[np.ndarray] = []
        chord, re = float(np.linalg.norm(conditions.re)), conditions.re
        self._taut = sought.compliance is not None and chord > TAUT
        if sought.compliance is not None:
            re = re * min(1.0, SLACK / max(chord, SLACK))
        nodes, qe, f = self._mesh.nodes, conditions.qe, conditions.f
        if sought.ends is None:
            self._shapes = list(starts(nodes, qe, re, f, sought.target_twist, natural, self._taut))
        else:
            self._shapes = list(held_starts(sought.ends, nodes, qe, re, f, sought.target_twist, natural))
        self._strings: list[np.ndarray] | None = None  # the shortest paths past the obstacles
        self._through: list[np.ndarray] = []  # initial shapes that soft obstacles let through

    @property
    def over(self) -> bool:
        """Whether all initial shapes have been tried."""
        return not (self._shapes or self._strings or (self._through and self.found))

    def descend(self) -> float:
        """Descend from the next initial shape; returns the work, iterations times unknowns.

        In the end, shapes that soft obstacles let through begin again among stiffer ones, if others have led
        to an equilibrium: it may not be the lowest. If none has, continuation finds lower ones, see `Search`.
        """
        rod = self._rod()
        rod.work = LIMIT if rod.obstacles is None or self._strings else START_WORK
        left, known = rod.work, len(self._seen)
        if self._shapes:
            start = aside(self._shapes.pop(0), self._mesh.nodes)
            one = settle(rod, start, np.zeros(3), SEARCH_OPTIONS)
            if one is None and len(self._seen) > known and not rod.soft:
                self._through.append(start)
        elif self._strings:
            one = self._past_obstacles(rod)
        else:
            assert isinstance(rod, TouchingRod)
            one = settled(rod, descend(rod, self._through.pop(0), np.zeros(3), SEARCH_OPTIONS, FAR))
        if rod.obstacles is None and one is not None:
            rod.work -= one.iterations * rod.elastic.shape[0]
        left -= rod.work
        rod.work = np.inf
        if isinstance(rod, TouchingRod):
            rod.seen = None  # only starts are compared
        if one is not None:
            self._keep(one)
        stretches = rod.soft  # no descent from a path past obstacles then
        nothing = not self._shapes and not self.found and self._strings is None
        if nothing and not stretches and rod.obstacles is not None:
            # a taut cable may pass through soft obstacles, and be caught on the wrong side as they harden
            self._strings = taut_strings(rod.re, rod.obstacles, 1.0)
            self._seen = []
        return left

    def _rod(self) -> Rod:
        rod: Rod
        sought, conditions = self._sought, self._sought.conditions
        section = self._mesh, sought.stiffness, sought.natural
        if sought.ends is not None:
            rod = HeldRod(*section, sought.ends)
        elif sought.compliance is not None and conditions.obstacles is not None:
            rod = StretchingTouchingRod(*section, sought.compliance, max(sought.tolerance, SEARCH))
            rod.seen, rod.least, rod.clamps = self._seen, max(rod.least, sought.least), sought.clamps
        elif sought.compliance is not None:
            rod = StretchingRod(*section, sought.compliance)
        elif conditions.obstacles is None:
            rod = Rod(*section)
        else:
            rod = TouchingRod(*section, max(sought.tolerance, SEARCH))
            rod.seen, rod.least, rod.clamps = self._seen, sought.least, sought.clamps
        rod.set_conditions(conditions.qe, conditions.re, conditions.f, conditions.obstacles)
        return rod

    def _past_obstacles(self, rod: Rod) -> Found | None:
        """The equilibrium that a descent from the next shortest path past the obstacles leads to."""
        assert isinstance(rod, TouchingRod)
        assert self._strings
        sought = self._sought
        q = along(self._strings.pop(0), self._mesh.nodes, rod.qe, sought.target_twist, sought.natural)
        one = settled(rod, descend(rod, q, np.zeros(3), SEARCH_OPTIONS, 1, taut=True))
        if one is not None:
            self._strings.clear()
        return one

    def _keep(self, one: Found) -> None:
        """Record an equilibrium, and end the search if it has the target twist."""
        if any(same(one, other) for other in self.found):
            lowest = min(self.found, key=lambda other: other.energy)
            if self._taut and not self._thorough and same(one, lowest):
                self._shapes.clear()  # in a straight cable, all starts of one twist lead to one equilibrium
            return
        self.found.append(one)
        target_twist = self._sought.target_twist
        if target_twist is not None and not self._thorough and abs(one.twist - target_twist) < NEAR:
            self._shapes.clear()
            self._through.clear()


def _for_mesh(sought: Sought) -> Conditions:
    """The conditions, where ends are held otherwise with their loads beside the weight."""
    conditions, ends = sought.conditions, sought.ends
    if ends is None:
        return conditions
    size = float(np.linalg.norm(conditions.f)) + load_moment(ends)
    return Conditions(conditions.qe, np.zeros(3), np.array([size, 0.0, 0.0]))


def equilibria(
    stiffness: np.ndarray, natural: np.ndarray | None, conditions: Conditions, target_twist: float | None,
    tolerance: float = 1e-4, thorough: bool = True, compliance: np.ndarray | None = None,
    ends: Ends | None = None,
) -> list[Found]:  # fmt: skip
    """All equilibria that `Starts` finds, by rising energy; arguments as in `Sought` and `Starts`."""
    natural = np.zeros(3) if natural is None else natural
    sought = Sought(stiffness, natural, conditions, target_twist, tolerance, compliance, ends)
    search = Starts(sought, thorough)
    while not search.over:
        search.descend()
    return sorted(search.found, key=lambda one: one.energy)


def same(a: Found, b: Found) -> bool:
    """Whether a and b are one equilibrium; mirror images share twist and energy, but not the end moment."""
    moment = a.rod.reactions()
    return (
        abs(a.twist - b.twist) < 1e-3
        and abs(a.energy - b.energy) < 1e-5 * (1.0 + abs(a.energy))
        and float(np.linalg.norm(moment - b.rod.reactions())) < 1e-2 * (1.0 + float(np.linalg.norm(moment)))
    )
