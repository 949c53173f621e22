# SPDX-License-Identifier: Apache-2.0
"""Named hard cases beside the zoo: too slow for it, or not had yet.

    cable bench robustness --zoo test/zoo_open.py

`test_zoo.py` does not count them.
"""

from __future__ import annotations

from zoo_hose import OPEN

CASES = OPEN
