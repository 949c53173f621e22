# SPDX-License-Identifier: Apache-2.0
"""What an externally mounted cable does to its robot, live."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from cable_ros.equilibrium import Equilibrium, Status
    from cable_ros.scene import load_scene
    from cable_ros.tracker import Tracker

__all__ = ["Equilibrium", "Status", "Tracker", "load_scene"]

_HOMES = {
    "Equilibrium": "cable_ros.equilibrium",
    "Status": "cable_ros.equilibrium",
    "Tracker": "cable_ros.tracker",
    "load_scene": "cable_ros.scene",
}


def __getattr__(name: str) -> Any:
    """Import at first use: `cable -h` and the log's commands need no compiler and no solver."""
    if name == "__version__":
        return import_module("importlib.metadata").version(__name__)
    if name not in _HOMES:
        raise AttributeError(f"module '{__name__}' has no attribute '{name}'")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    """What is public, imported or not."""
    return sorted(
        {*globals(), *__all__, "__version__"} - {"Any", "TYPE_CHECKING", "annotations", "import_module"}
    )
