# SPDX-License-Identifier: Apache-2.0
"""The executables that have a node: a sentence says what is missing, not an import that fails."""

from __future__ import annotations

import sys

from cable_ros.common.requirements import missing


def cable_node() -> int:
    """Run `cable_node`; 2 where something is missing."""
    if _ready("cable_node"):
        from cable_ros.ros.cable_node import main

        return main()
    return 2


def cable_replay() -> int:
    """Run `cable_replay`; 2 where something is missing."""
    if _ready("cable_replay"):
        from cable_ros.ros.replay_node import main

        return main()
    return 2


def _ready(name: str) -> bool:
    sentence = missing(ros=True)
    if sentence:
        print(f"{name}: {sentence}", file=sys.stderr)
    return not sentence
