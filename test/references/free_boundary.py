# SPDX-License-Identifier: Apache-2.0
"""A rod that lies along an obstacle between given clamps: boundary-value problems with free lift-offs.

Planar, in the XY plane, weight along -Y. The manufactured cases of `contact` say where their clamps come to
be; here the clamps are given and the lengths of the free spans, the tension on the stretch and the point
forces where it ends are sought: by shooting from the lift-offs (`meet`, to about 1e-11), and, to check it, by
collocation of both spans with these numbers as free parameters (`collocate`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.integrate import solve_bvp
from scipy.optimize import root

from references.contact import Touching, manufacture, span
from references.reference import Reference


@dataclass(frozen=True)
class Surface:
    """What the rod lies on: the ground y = 0, or a cylinder along Z of `radius` about `centre` (2,)."""

    centre: tuple[float, float] = (0.0, 0.0)
    radius: float = np.inf

    @property
    def curvature(self) -> float:
        """Of a rod that follows it along X over its top; 1 / radius, negative."""
        return -1.0 / self.radius

    def point(self, place: float) -> np.ndarray:
        """(2,) of the surface: `place` is the abscissa on the ground, the tangent's angle on a cylinder."""
        if np.isinf(self.radius):
            return np.array([place, 0.0])
        return np.array(self.centre) + self.radius * np.array([-np.sin(place), np.cos(place)])

    def angle(self, place: float) -> float:
        """Of the tangent there."""
        return 0.0 if np.isinf(self.radius) else place

    def tension(self, place: float, along: float, start: float, weight: float, friction: float) -> float:
        """After `along` of the stretch that begins at `place` with the tension `start`.

        T' = w sin(theta) + mu (w cos(theta) - c T), theta' = c: closed form; with w = 0 the capstan's
        T = T_0 exp(mu |c| along).
        """
        if np.isinf(self.radius):
            return start + friction * weight * along
        c = self.curvature
        a = 2 * friction * weight / (c * (1 + friction**2))
        b = (friction**2 - 1) / (friction**2 + 1) * weight / c
        theta = place + c * along
        swing = [a * np.sin(t) + b * np.cos(t) for t in (place, theta)]
        return float((start - swing[0]) * np.exp(-friction * c * along) + swing[1])


GROUND = Surface()


@dataclass(frozen=True)
class Lying:
    """A solution, in units of the cable: what `manufacture` needs."""

    before: float
    """Length of the free span in front of the stretch; 0: it begins at the start clamp."""
    after: float
    """Length of the free span behind it."""
    place: float
    """Of the first lift-off on the surface; see `Surface.point`."""
    tension: float
    """At the start of the stretch."""
    first: float
    last: float
    """Point forces at the lift-offs; `first` is of no matter where the stretch begins at the clamp."""

    def case(self, surface: Surface, weight: float, friction: float = 0.0) -> Touching:
        """The case, moved to where it lies on the surface."""
        made = manufacture(
            (self.before, self.after),
            1.0 - self.before - self.after,
            surface.curvature,
            self.tension,
            (self.first, self.last),
            weight,
            angle=surface.angle(self.place),
            friction=friction,
        )
        origin = surface.point(self.place)
        shift = np.array([*origin, 0.0, 0.0, 0.0, 0.0, 0.0])
        moved = replace(made.reference, start=made.reference.start + shift, end=made.reference.end + shift)
        return replace(made, reference=moved, points=made.points + origin)


def clamp(pose: np.ndarray) -> np.ndarray:
    """(3,) x, y and angle of the tangent of a planar clamp's pose (7,)."""
    x, y, z, w = pose[3:]
    return np.array([*pose[:2], np.arctan2(2 * (y * z - w * x), 2 * (x * z + w * y))])


def meet(
    clamps: tuple[np.ndarray, np.ndarray],
    guess: Lying,
    surface: Surface,
    weight: float,
    friction: float = 0.0,
) -> tuple[Lying, Reference]:
    """The rod between `clamps`, (3,) each: x, y, angle in units of the cable; friction fully mobilised.

    `friction` > 0: the surface is drawn towards the start clamp under the rod; < 0: towards the end clamp.
    Raises ValueError where no solution is found from the guess or it is not admissible.
    """
    lies = guess.before == 0.0

    def unpack(x: np.ndarray) -> Lying:
        if lies:
            return Lying(0.0, x[0], clamps[0][0], x[1], 0.0, x[2])
        return Lying(*x)

    def miss(x: np.ndarray) -> np.ndarray:
        made = unpack(x).case(surface, weight, friction).reference
        ends = [_off(clamp(made.end), clamps[1])]
        if not lies:
            ends.append(_off(clamp(made.start), clamps[0]))
        return np.concatenate(ends)

    start = [guess.after, guess.tension, guess.last]
    if not lies:
        start = [guess.before, guess.after, guess.place, guess.tension, guess.first, guess.last]
    found = root(miss, start, tol=1e-12)
    solution = unpack(found.x)
    if not np.abs(miss(found.x)).max() < 1e-10:
        raise ValueError(f"No rod lies along the surface between these clamps: {found.message}")
    case = solution.case(surface, weight, friction)
    if case.least_pressure < 0 or solution.last < 0 or solution.first < 0:
        raise ValueError("The surface would have to pull on the rod.")
    return solution, case.reference


def walk(
    stations: Sequence[tuple[np.ndarray, np.ndarray]],
    guess: Lying,
    surface: Surface,
    weight: float,
    friction: float = 0.0,
) -> list[tuple[Lying, Reference]]:
    """`meet` at each pair of clamps, started from the one before."""
    out = []
    for clamps in stations:
        guess, reference = meet(clamps, guess, surface, weight, friction)
        out.append((guess, reference))
    return out


def stuck(
    lying: Lying, clamps: tuple[np.ndarray, np.ndarray], surface: Surface, weight: float, turn: float
) -> tuple[np.ndarray, np.ndarray, float]:
    """What the rod becomes that sticks to a cylinder while this turns by `turn`, rad about Z, from `lying`.

    Each span by itself: it lifts off at the place of the cylinder where its material lies, with no moment to
    spare, and the force it takes up there is its own. Exact while the friction at both lift-offs, which bears
    all that the forces change along the tangent, is within the cone.

    Returns the forces (2,) of the rod at both clamps, F just inside the start and the end clamp, and the
    friction needed, the largest part of a point force. Raises ValueError where no solution is found.
    """
    forces, needed = [], 0.0
    along = 1.0 - lying.before - lying.after
    pulls = lying.tension, surface.tension(lying.place, along, lying.tension, weight, 0.0)
    for sign, length, target, pull, push in (
        (-1.0, lying.before, clamps[0], pulls[0], lying.first),
        (1.0, lying.after, clamps[1], pulls[1], lying.last),
    ):

        def shape(x: np.ndarray, sign: float = sign) -> np.ndarray:
            s = x[0] if sign < 0 else 1.0 - x[0]
            theta = lying.place + turn + surface.curvature * (s - lying.before)
            t, n = np.array([np.cos(theta), np.sin(theta)]), np.array([-np.sin(theta), np.cos(theta)])
            force = x[1] * t - sign * x[2] * n
            state = np.array([*surface.point(theta), theta, surface.curvature, *force])
            return span(state, sign * x[0], weight)[:, -1]

        found = root(
            lambda x, shape=shape, target=target: _off(shape(x)[:3], target), [length, pull, push], tol=1e-12
        )
        if not np.abs(_off(shape(found.x)[:3], target)).max() < 1e-10:
            raise ValueError(f"No rod sticks to the cylinder so far turned: {found.message}")
        forces.append(shape(found.x)[4:])
        needed = max(needed, abs(found.x[1] - pull) / found.x[2])
    return forces[0], forces[1], needed


def collocate(
    clamps: tuple[np.ndarray, np.ndarray],
    guess: Lying,
    surface: Surface,
    weight: float,
    friction: float = 0.0,
    tolerance: float = 1e-10,
) -> Lying:
    """The same by collocation (scipy.integrate.solve_bvp): x, y, theta, kappa of both spans on [0, 1].

    Raises ValueError where it does not converge.
    """
    lies = guess.before == 0.0

    def unpack(p: np.ndarray) -> Lying:
        return Lying(0.0, p[0], clamps[0][0], p[1], 0.0, p[2]) if lies else Lying(*p)

    def frames(one: Lying) -> tuple[tuple[np.ndarray, float], tuple[np.ndarray, float]]:
        """Point and angle at both ends of the stretch."""
        along = 1.0 - one.before - one.after
        other = one.place + along * (1.0 if np.isinf(surface.radius) else surface.curvature)
        return tuple((surface.point(s), surface.angle(s)) for s in (one.place, other))  # type: ignore[return-value]

    def forces(one: Lying) -> tuple[np.ndarray, np.ndarray]:
        """(2,) F just outside both lift-offs."""
        along = 1.0 - one.before - one.after
        pull = surface.tension(one.place, along, one.tension, weight, friction)
        out = []
        for (_, theta), size, push in zip(
            frames(one), (one.tension, pull), (one.first, -one.last), strict=True
        ):
            t, n = np.array([np.cos(theta), np.sin(theta)]), np.array([-np.sin(theta), np.cos(theta)])
            out.append(size * t + push * (n - friction * t))
        return out[0], out[1]

    def spread(s: np.ndarray, u: np.ndarray, length: float, force: np.ndarray, at: float) -> np.ndarray:
        c, sn = np.cos(u[2]), np.sin(u[2])
        fy = force[1] + weight * length * (s - at)
        return length * np.array([c, sn, u[3], force[0] * sn - fy * c])

    def rates(s: np.ndarray, u: np.ndarray, p: np.ndarray) -> np.ndarray:
        one = unpack(p)
        left, right = forces(one)
        parts = [spread(s, u[-4:], one.after, right, 0.0)]
        if not lies:
            parts.insert(0, spread(s, u[:4], one.before, left, 1.0))
        return np.vstack(parts)

    def ends(a: np.ndarray, b: np.ndarray, p: np.ndarray) -> np.ndarray:
        (low, first), (high, second) = frames(unpack(p))
        c = surface.curvature
        parts = [a[-4:] - np.array([*high, second, c]), _off(b[-4:-1], clamps[1])]
        if not lies:
            parts += [_off(a[:3], clamps[0]), b[:4] - np.array([*low, first, c])]
        return np.concatenate(parts)

    points = guess.case(surface, weight, friction).points
    grid = np.linspace(0.0, 1.0, 200)
    shape = [*_shape(points[-200:], guess.after)]
    if not lies:
        shape = [*_shape(points[:200], guess.before), *shape]
    p = [guess.after, guess.tension, guess.last]
    if not lies:
        p = [guess.before, guess.after, guess.place, guess.tension, guess.first, guess.last]
    found = solve_bvp(rates, ends, grid, np.array(shape), p=np.array(p), tol=tolerance, max_nodes=50_000)
    if not found.success:
        raise ValueError(found.message)
    return unpack(found.p)


def _off(found: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """(3,) difference of two clamps; angles up to whole turns."""
    x, y, turn = found - wanted
    return np.array([x, y, (turn + np.pi) % (2 * np.pi) - np.pi])


def _shape(points: np.ndarray, length: float) -> np.ndarray:
    """(4, n) x, y, theta, kappa of a span's points (n, 2) at equal arc lengths."""
    step = length / (len(points) - 1)
    tangent = np.gradient(points, step, axis=0)
    theta = np.unwrap(np.arctan2(tangent[:, 1], tangent[:, 0]))
    return np.array([*points.T, theta, np.gradient(theta, step)])
