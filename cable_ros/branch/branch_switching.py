# SPDX-License-Identifier: Apache-2.0
"""Branch switching: from an equilibrium that is about to lose its stability to a stable one beside it."""

from __future__ import annotations

import numpy as np

from cable_ros.branch.cold_start import Conditions, Found
from cable_ros.contact.touching_rod import TouchingRod
from cable_ros.rod import warm_step
from cable_ros.rod.kirchhoff import Rod

AMPLITUDES = (0.1, 0.3, 1.0)
"""Perturbations along the mode, root of twice the elastic energy: sections turn by a third of that, rad."""
TOLERANCE = 1e-8
"""Of Newton's method, rad."""


def switch_branch(
    rod: Rod, q: np.ndarray, F: np.ndarray, mode: np.ndarray, conditions: Conditions
) -> Found | None:
    """The stable equilibrium under the `conditions` next to (q, F) along its softest mode; None without one.

    None, too, unless the branch of (q, F) itself is found there and is unstable. Only for a rod with
    contact points and without friction. The mode (3n,) has an elastic energy of 1/2.
    Among springs a contact cannot move along the cable to where a bifurcation leads it, as springs act at
    samples; here it moves. Of two mirror images always the same is found. Wagner and Wriggers (1988).
    """
    if not isinstance(rod, TouchingRod) or rod.frictional or not rod.count:
        return None
    put_back = rod.kept()
    mode = mode if mode @ rod.start_vector() >= 0.0 else -mode
    unstable = False  # whether that has been shown of the branch
    for amplitude in (0.0, *AMPLITUDES):
        rod.set_conditions(conditions.qe, conditions.re, conditions.f, conditions.obstacles)
        rod.ready = False
        start = rod.on_end(rod.retract(q, amplitude * mode))
        code, iterations, q_new, F_new = rod.correct(start, F, TOLERANCE)
        if code == warm_step.ADVANCED and unstable and rod.refactor(q_new, F_new):
            return Found.at(rod, q_new, F_new, iterations)
        put_back()
        if code == warm_step.ADVANCED:
            break
        unstable = unstable or code == warm_step.NOT_CONVEX
    rod.linearize(q, F)  # on the mesh that was put back
    return None
