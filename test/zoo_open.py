# SPDX-License-Identifier: Apache-2.0
"""Named hard cases beside the zoo: too slow for it, or not had yet.

    cable bench robustness --zoo test/zoo_open.py

`test_zoo.py` does not count them.
"""

from __future__ import annotations

from dataclasses import replace

from zoo_hose import OPEN

from cable_ros.bench.drawn import drawn_case

DRAWN = {
    (72, 4): "a grid's error is too large on a bar and a wall with friction",
    (72, 9): "a heavy loop over a narrow beam is not found cold",
    (72, 17): "a grid's error is too large between two plates",
    (72, 22): "1.1e-4 off at an estimate of a step before",
    (72, 35): "it slides off two beams without friction, and a grid holds it there",
    (73, 11): "a hose slides 1.3e-4 of its length the way its friction pushes",
    (73, 20): "a snap on a table takes more than a call's work",
    (73, 33): "over beams without friction",
    (73, 40): "over beams without friction, in two steps",
    (73, 42): "a ball pushed past a rough cable",
}
"""By seed and index of `drawn_case`, what is amiss."""

CASES = (
    *OPEN,
    *(replace(drawn_case(*key, 1e-4), name=f"drawn {key}: {what}") for key, what in DRAWN.items()),
)
