# SPDX-License-Identifier: Apache-2.0
"""Natural frequencies of a rod on supports, from its energy alone; shares no code with the package.

Frames are polynomials on each piece between two supports, through Chebyshev's points. A support stands at an
arc length that is an unknown where the cable slides. The Lagrangian, energy less multipliers times what the
supports hold, is differentiated numerically: gradients by the complex step, Hessians by central differences
of these. The kinetic energy is that of points of the material, whose velocity has a part from the supports
that move along the cable. Any unit; scalar first.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import legendre
from scipy.linalg import eigh, null_space

STEP, DIFFERENCE = 1e-30, 1e-5
FRESH, EXACT = 2, 1e-8
"""Number of steps with a Hessian of their own, and the rotation at which they end."""


@dataclass(frozen=True)
class Support:
    """What holds a rod at one arc length."""

    slides: bool
    """Whether its arc length is free."""
    missed: Callable[[np.ndarray, np.ndarray], np.ndarray]
    """What it holds (b, r), zero where it does, of b positions (b, 3) and tangents (b, 3)."""


def pin(position: np.ndarray) -> Support:
    """It turns there."""
    return Support(False, lambda r, t: r - position)


def ring(position: np.ndarray) -> Support:
    """It turns and slides there."""
    return Support(True, lambda r, t: r - position)


def tube(position: np.ndarray, across: np.ndarray) -> Support:
    """It slides there along a direction, across which are the rows of `across` (2, 3)."""
    return Support(True, lambda r, t: np.concatenate([r - position, t @ across.T], axis=1))


def touch(centre: np.ndarray, radius: float, axis: np.ndarray | None = None) -> Support:
    """It touches a sphere, or a cylinder with this axis (3,), where the gap of its centreline is least."""
    across = np.eye(3) if axis is None else np.eye(3) - np.outer(axis, axis)

    def missed(r: np.ndarray, t: np.ndarray) -> np.ndarray:
        away = (r - centre) @ across
        apart = np.sqrt(np.sum(away * away, axis=1))
        return np.stack([apart - radius, np.sum(away * t, axis=1) / apart], axis=1)

    return Support(True, missed)


@dataclass(frozen=True)
class Rod:
    """A rod between two clamps."""

    length: float
    stiffness: np.ndarray
    """(3,) of bending, bending and torsion."""
    natural: np.ndarray
    """(3,) natural curvatures and twist."""
    load: np.ndarray
    """(3,) per length."""
    start: tuple[np.ndarray, np.ndarray]
    """Position and quaternion."""
    end: tuple[np.ndarray, np.ndarray]
    density: float
    softness: float = 0.0
    """1 / EA."""


class Vibrations:
    """A rod on supports, by `order` points a piece.

    Args:
        rod, supports: see there.
        arcs: (n,) about where they are.
        frames: (k, 4) about its frames, at equal arc lengths.
        order: number of points on each piece.
    """

    def __init__(
        self, rod: Rod, supports: list[Support], arcs: np.ndarray, frames: np.ndarray, order: int = 12
    ) -> None:
        self.rod, self.supports, self.order = rod, supports, order
        self.arcs = np.array(arcs, float)
        self.nodes = 0.5 - 0.5 * np.cos(np.pi * np.arange(order) / (order - 1))
        self.x, self.w = _gauss(order + 6)
        powers = legendre.legvander(2 * self.nodes - 1, order - 1)
        by_nodes = np.linalg.inv(powers)
        self.values = legendre.legvander(2 * self.x - 1, order - 1) @ by_nodes
        slopes = np.stack([legendre.legval(2 * self.x - 1, 2 * legendre.legder(c)) for c in np.eye(order)], 1)
        self.slopes = slopes @ by_nodes
        self.to_series = np.linalg.inv(legendre.legvander(2 * self.x - 1, len(self.x) - 1))
        self.sliding = [j for j, support in enumerate(supports) if support.slides]
        self.pieces = len(supports) + 1
        count = self.pieces * (order - 1) + 1
        signs = np.cumprod(np.sign(np.concatenate([[1.0], np.sum(frames[1:] * frames[:-1], axis=1)])))
        s = np.unique(np.concatenate(self._places()))
        even = np.linspace(0.0, rod.length, len(frames))
        q = np.stack([np.interp(s, even, column) for column in (frames * signs[:, None]).T], axis=1)
        q[0], q[-1] = (end * np.sign(end @ q[at]) for end, at in ((rod.start[1], 0), (rod.end[1], -1)))
        self.q = q / np.linalg.norm(q, axis=1)[:, None]
        assert len(self.q) == count
        self.turns = 3 * (count - 2)
        self.strains = self.pieces * len(self.x) if rod.softness else 0
        self.strain = np.zeros(self.strains)
        self.size = self.turns + len(self.sliding) + self.strains
        self.multipliers = np.zeros(len(self.missed(np.zeros((1, self.size)))[0]))

    def _places(self) -> list[np.ndarray]:
        cuts = np.concatenate([[0.0], self.arcs, [self.rod.length]])
        return [np.round(a + (b - a) * self.nodes, 14) for a, b in itertools.pairwise(cuts)]

    def _shape(self, u: np.ndarray) -> tuple[np.ndarray, ...]:
        """Of b states u (b, size): cuts (b, pieces + 1), frames at the nodes (b, n, 4), strains
        (b, pieces, g), and series of the positions (pieces, g + 1, b, 3).
        """
        arcs = np.tile(self.arcs, (len(u), 1)).astype(u.dtype)
        arcs[:, self.sliding] += u[:, self.turns : self.turns + len(self.sliding)]
        cuts = np.pad(arcs, ((0, 0), (1, 1)))
        cuts[:, -1] = self.rod.length
        turns = np.pad(u[:, : self.turns], ((0, 0), (3, 3))).reshape(len(u), -1, 3)
        q = turned(np.broadcast_to(self.q, (*turns.shape[:2], 4)), turns)
        strain = np.zeros((len(u), self.pieces, len(self.x)), u.dtype)
        if self.strains:
            strain += (self.strain + u[:, -self.strains :]).reshape(strain.shape)
        start, series = self.rod.start[0], []
        for i in range(self.pieces):
            rate = (1 + strain[:, i])[..., None] * tangents(self.values @ self._piece(q, i))
            rate = rate * (0.5 * (cuts[:, i + 1] - cuts[:, i]))[:, None, None]
            series.append(legendre.legint(np.einsum("kg,bga->kba", self.to_series, rate), lbnd=-1))
            series[i][0] += start
            start = series[i].sum(axis=0)
        return cuts, q, strain, np.stack(series)

    def _piece(self, q: np.ndarray, i: int) -> np.ndarray:
        first = i * (self.order - 1)
        return q[:, first : first + self.order]

    def energy(self, u: np.ndarray) -> np.ndarray:
        """(b,) elastic energy less the work of the load, of b states u (b, size)."""
        cuts, q, strain, series = self._shape(u)
        out, powers = np.zeros(len(u), u.dtype), legendre.legvander(2 * self.x - 1, series.shape[1] - 1)
        for i in range(self.pieces):
            long, nodal = cuts[:, i + 1] - cuts[:, i], self._piece(q, i)
            kappa = curvatures(self.values @ nodal, self.slopes @ nodal / long[:, None, None])
            density = 0.5 * ((kappa - self.rod.natural) ** 2) @ self.rod.stiffness
            density = density - np.einsum("gk,kba,a->bg", powers, series[i], self.rod.load)
            if self.strains:
                density = density + 0.5 * strain[:, i] ** 2 / self.rod.softness
            out = out + long * (density @ self.w)
        return out

    def missed(self, u: np.ndarray) -> np.ndarray:
        """(b, r) what clamp and supports hold, of b states u (b, size)."""
        _, q, _, series = self._shape(u)
        ends, t = series.sum(axis=1), tangents(q[:, self.order - 1 :: self.order - 1])
        held = [support.missed(ends[j], t[:, j]) for j, support in enumerate(self.supports)]
        return np.concatenate([ends[-1] - self.rod.end[0], *held], axis=1)

    def material(self, u: np.ndarray, s: np.ndarray) -> np.ndarray:
        """(b, 3 k) positions of the material points s (k,), of b states u (b, size)."""
        cuts, _, _, series = self._shape(u)
        rest, out = np.concatenate([[0.0], self.arcs, [self.rod.length]]), []
        for i in range(self.pieces):
            here = s[(s >= rest[i]) & (s < rest[i + 1])]
            x = (here - cuts[:, i, None]) / (cuts[:, i + 1] - cuts[:, i])[:, None]
            powers = legendre.legvander(2 * x - 1, series.shape[1] - 1)
            out.append(np.einsum("bsk,kba->bsa", powers, series[i]))
        return np.concatenate(out, axis=1).reshape(len(u), -1)

    def lagrangian(self, u: np.ndarray) -> np.ndarray:
        """(b, 1) of b states u (b, size)."""
        return (self.energy(u) - self.missed(u) @ self.multipliers)[:, None]

    def jacobian(self, function: Callable[[np.ndarray], np.ndarray], u: np.ndarray) -> np.ndarray:
        """(r, size) of a function of states, at u (size,), by the complex step."""
        return function(u + 1j * STEP * np.eye(self.size)).imag.T / STEP

    def hessian(self) -> np.ndarray:
        """Of the Lagrangian."""
        H = np.empty((self.size, self.size))
        for k in range(self.size):
            u = np.zeros(self.size)
            u[k] = DIFFERENCE
            H[k] = self.jacobian(self.lagrangian, u)[0] - self.jacobian(self.lagrangian, -u)[0]
        H /= 2 * DIFFERENCE
        return 0.5 * (H + H.T)

    def solve(self, steps: int = 20) -> None:
        """Go to the equilibrium nearby by Newton's method."""
        here = np.zeros(self.size)
        G = self.jacobian(self.missed, here)
        plain = self.jacobian(lambda v: self.energy(v)[:, None], here)[0]
        self.multipliers = np.linalg.lstsq(G.T, plain, rcond=None)[0]
        for k in range(steps):
            if k < FRESH:
                H = self.hessian()
            G = self.jacobian(self.missed, here)
            zero = np.zeros((len(G), len(G)))
            right = -np.concatenate([self.jacobian(self.lagrangian, here)[0], -self.missed(here[None])[0]])
            step = np.linalg.solve(np.block([[H, -G.T], [-G, zero]]), right)
            self._move(step[: self.size])
            self.multipliers = self.multipliers + step[self.size :]
            if np.abs(step[: self.size]).max() < EXACT:
                return
        raise AssertionError("Newton's method did not converge")

    def _move(self, u: np.ndarray) -> None:
        turns = np.concatenate([np.zeros(3), u[: self.turns], np.zeros(3)]).reshape(-1, 3)
        self.q = turned(self.q, turns)
        self.q /= np.linalg.norm(self.q, axis=1)[:, None]
        self.arcs[self.sliding] += u[self.turns : self.turns + len(self.sliding)]
        self.strain = self.strain + u[len(u) - self.strains :]

    def frequencies(self, count: int) -> np.ndarray:
        """The lowest (count,), per unit of time."""
        cuts = np.concatenate([[0.0], self.arcs, [self.rod.length]])
        long = np.diff(cuts)
        s = np.concatenate([a + b * self.x for a, b in zip(cuts[:-1], long, strict=True)])
        w = np.concatenate([b * self.w for b in long])
        here = np.zeros(self.size)
        J = self.jacobian(lambda v: self.material(v, s), here) * np.sqrt(np.repeat(w, 3))[:, None]
        Z = null_space(self.jacobian(self.missed, here))
        M, H = self.rod.density * (J @ Z).T @ (J @ Z), Z.T @ self.hessian() @ Z
        inverse = eigh(M, H, eigvals_only=True)[::-1][:count]
        return 1.0 / np.sqrt(inverse) / (2.0 * np.pi)


def multiply(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Quaternion product along the last axis."""
    v, w = a[..., 1:], b[..., 1:]
    scalar = a[..., :1] * b[..., :1] - np.sum(v * w, axis=-1, keepdims=True)
    return np.concatenate([scalar, a[..., :1] * w + b[..., :1] * v + np.cross(v, w)], axis=-1)


def turned(q: np.ndarray, psi: np.ndarray) -> np.ndarray:
    """q exp(psi / 2), of quaternions (..., 4) and rotation vectors (..., 3)."""
    size = np.sqrt(0.25 * np.sum(psi * psi, axis=-1, keepdims=True) + 1e-200)
    return multiply(q, np.concatenate([np.cos(size), 0.5 * np.sin(size) / size * psi], axis=-1))


def tangents(q: np.ndarray) -> np.ndarray:
    """(..., 3) third axes of quaternions (..., 4) of any length."""
    w, x, y, z = np.moveaxis(q, -1, 0)
    t = np.stack([2 * (x * z + w * y), 2 * (y * z - w * x), w**2 - x**2 - y**2 + z**2], axis=-1)
    return t / np.sum(q * q, axis=-1, keepdims=True)


def curvatures(q: np.ndarray, dq: np.ndarray) -> np.ndarray:
    """(..., 3) of quaternions (..., 4) and their derivatives by the arc length."""
    inverse = q * np.array([1.0, -1.0, -1.0, -1.0])
    return 2 * multiply(inverse, dq)[..., 1:] / np.sum(q * q, axis=-1, keepdims=True)


def _gauss(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Points and weights on 0 .. 1."""
    x, w = legendre.leggauss(count)
    return 0.5 + 0.5 * x, 0.5 * w
