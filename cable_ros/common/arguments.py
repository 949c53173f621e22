# SPDX-License-Identifier: Apache-2.0
"""What the commands and the nodes read alike from their command lines."""

from __future__ import annotations

import argparse
import math


def from_zero(text: str) -> float:
    """A finite number that is not negative.

    Raises:
        argparse.ArgumentTypeError: it is something else.
    """
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not (math.isfinite(value) and value >= 0):
        raise argparse.ArgumentTypeError(f"'{text}' is not a number from 0 on, such as 1e-6 or 2.5")
    return value
