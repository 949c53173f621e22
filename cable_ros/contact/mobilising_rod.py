# SPDX-License-Identifier: Apache-2.0
"""A rod whose friction is mobilised against the end's motion, as the paper's law (53) has it."""

from __future__ import annotations

import numpy as np

from cable_ros.contact.remeshing_rod import RemeshingRod
from cable_ros.rod import warm_step

TURN, LEAST_TURN = 0.25, 1 / 128
"""First and least part of mobilised friction that turns back at once."""


class MobilisingRod(RemeshingRod):
    """The part of `ActiveSetRod` for `friction_model: sliding`."""

    def _reverse(
        self, q: np.ndarray, F: np.ndarray, re: np.ndarray, tolerance: float, limit: float
    ) -> tuple[int, int, np.ndarray, np.ndarray]:
        """Turn mobilised friction against the end's new direction, in steps if that turns back."""
        motion = re - self.re
        size = float(np.linalg.norm(motion))
        before, after = self.direction, motion / max(size, 1e-300)
        if size < 1e-12:
            return warm_step.ADVANCED, 0, q, F
        if self.count and before @ after <= 0.0 and self.obstacles is not None:
            return self.mobilise(q, F, before, after, tolerance, limit)
        self.direction = after
        return warm_step.ADVANCED, 0, q, F

    def mobilise(
        self, q: np.ndarray, F: np.ndarray, before: np.ndarray, after: np.ndarray, tolerance: float,
        limit: float,
    ) -> tuple[int, int, np.ndarray, np.ndarray]:  # fmt: skip
        """Lead friction that is mobilised against `before` through zero to that against `after`, both (3,).

        Returns code, iterations and equilibrium as `step_in_contact`. Where friction turns the cable over,
        there is none with all of it.
        """
        at, step, spent = -1.0 if before.any() else 0.0, TURN, 0
        while at < 1.0:
            there = min(at + step, 1.0)
            self.direction = -there * before if there < 0.0 else there * after
            code, iterations, q_new, F_new = self.correct(q, F, tolerance, limit, remesh=False)
            spent += iterations
            if code == warm_step.ADVANCED:
                q, F, at, step = q_new, F_new, there, 2.0 * step
                continue
            step *= 0.5
            if step < LEAST_TURN:
                return code, spent, q, F
        return warm_step.ADVANCED, spent, q, F
