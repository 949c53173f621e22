# SPDX-License-Identifier: Apache-2.0
"""Named hard cases beside the zoo: too slow for it, or not had yet.

    cable bench robustness --zoo test/zoo_open.py

`test_zoo.py` does not count them.
"""

from __future__ import annotations

from dataclasses import replace

from zoo_drawn import thin_floor
from zoo_hose import OPEN

from cable_ros.bench.drawn import drawn_case

DRAWN = {
    (72, 22): "1.1e-4 off at an estimate of a step before",
    (73, 11): "a hose slides 1.3e-4 of its length the way its friction pushes",
    (73, 33): "over beams without friction",
    (73, 40): "over beams without friction, in two steps",
    (73, 42): "a ball pushed past a rough cable",
    (91, 6): "over beams without friction, there and back",
    (91, 20): "a hose led far aside in one step: a grid's error is too large",
    (91, 37): "a tray, dragged along: a grid's error is too large",
    (92, 1): "a drum pushed up into a cable: its branch is lost",
    (92, 7): "a start wrench on a rough edge is 6.8e-4 off",
    (93, 16): "a contact on a tray is said to stick and moves",
    (93, 35): "a tray, drawn together: a grid's error is too large",
    (93, 46): "over an edge along itself: a grid's error is too large",
    (94, 0): "a tray, along: a grid's error is too large for 29 poses",
    (94, 50): "a lift led aside: 4 % off in the first step",
    (95, 56): "a hose turned at its clamp is 1.7e-4 off",
    (96, 39): "a lift: 3.6 % off, a grid's estimate is too small",
    (96, 107): "a drum turned under a heavy cable: a grid's error is too large",
    (96, 125): "a tray, dragged along: it slides 5e-4 of its length the way its friction pushes",
    (96, 138): "a lift without friction: the estimated error is four times the tolerance",
    (96, 146): "rough beams dragged along: the branch is lost",
    (97, 30): "across a rough edge: the branch is lost",
    (97, 34): "along two rough beams: friction keeps the error of a grid left long since",
}
"""By seed and index of `drawn_case`, what is amiss."""

CASES = (
    *OPEN,
    replace(thin_floor(0.001), name="a weightless loop that rests without force, led aside"),
    *(replace(drawn_case(*key, 1e-4), name=f"drawn {key}: {what}") for key, what in DRAWN.items()),
)
