# SPDX-License-Identifier: Apache-2.0
"""Whether the joints move slowly enough for an equilibrium to be what the cable does."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from cable_ros.equilibrium import Equilibrium

MOST_SWING = 0.01
"""Maximum swing that is not reported, fraction of the cable's length."""
PARTS = 8
"""The acceleration is taken over a period of the lowest vibration by this number, twice."""
LONGEST = 1.0
"""s, at most; a cable that nothing holds has no period."""
PAUSE = 1.0
"""s between two computations of the frequency: each takes milliseconds."""


@dataclass
class Swing:
    """What one cable's own motion would make it swing by."""

    length: float
    """Of the cable, m."""
    frequency: float = math.nan
    """The lowest natural one, Hz."""
    acceleration: float = 0.0
    """The largest since it was last asked for, root mean square over the length, m/s^2."""
    _past: list[tuple[float, np.ndarray]] = field(default_factory=list)
    """Up to two times, s, and polylines (n, 3), m."""

    @property
    def amplitude(self) -> float:
        """Of an oscillator of that frequency that is accelerated so: a / (2 pi f)^2, m."""
        return self.acceleration / (2.0 * math.pi * self.frequency) ** 2

    @property
    def warning(self) -> str:
        """A sentence where that is not small; empty otherwise."""
        if not self.amplitude > MOST_SWING * self.length:
            return ""
        return (
            f"Not quasi-static: accelerated by {self.acceleration:.3g} m/s^2, a cable of "
            f"{self.frequency:.3g} Hz swings by some {self.amplitude:.2g} m, "
            f"{100.0 * self.amplitude / self.length:.2g} % of its length."
        )

    def take(self, time: float, points: np.ndarray) -> None:
        """Its polyline (n, 3), m, at a time, s; if that goes back, or n changes, it begins anew."""
        past = self._past
        if past and (time <= past[-1][0] or points.shape != past[-1][1].shape):
            past.clear()
        period = LONGEST if not self.frequency > 1.0 / LONGEST else 1.0 / self.frequency
        if past and time - past[-1][0] < period / PARTS:
            return
        if len(past) == 2:
            (t0, r0), (t1, r1) = past
            bend = 2.0 * ((points - r1) / (time - t1) - (r1 - r0) / (t1 - t0)) / (time - t0)
            # Silence between is no motion that we know.
            if time - t0 < 4.0 * period / PARTS:
                rms = math.sqrt(float((bend * bend).sum()) / len(points))
                self.acceleration = max(self.acceleration, rms)
            del past[0]
        past.append((time, points))

    def lost(self) -> None:
        """It has no shape that could be trusted."""
        self._past.clear()


class QuasiStatic:
    """Watches the cables of a scene.

    Args:
        lengths: of the cables, by name, m.
    """

    def __init__(self, lengths: Mapping[str, float]) -> None:
        self._swings = {name: Swing(length) for name, length in lengths.items()}
        self._due = -math.inf

    def take(self, stamp: int, equilibria: Mapping[str, Equilibrium]) -> None:
        """The equilibria of a joint state with this stamp, ns."""
        for name, found in equilibria.items():
            if found.status.trusted:
                self._swings[name].take(1e-9 * stamp, found.points)
            else:
                self._swings[name].lost()

    def report(self, now: float, equilibria: Mapping[str, Equilibrium]) -> dict[str, Swing]:
        """By cable; the frequencies are computed again if they are older than `PAUSE`, `now` in s."""
        if now >= self._due:
            self._due = now + PAUSE
            for name, found in equilibria.items():
                if found.status.trusted:
                    self._swings[name].frequency = float(found.modes(1).frequencies[0])
        return self._swings

    def reported(self) -> None:
        """Look for the largest acceleration from here on."""
        for swing in self._swings.values():
            swing.acceleration = 0.0
