"""Named hard cases that are not had yet: what passes moves to the zoo.

    cable bench robustness --zoo test/zoo_open.py

`test_zoo.py` does not count them.
"""

from __future__ import annotations

from zoo_hose import OPEN

CASES = OPEN
