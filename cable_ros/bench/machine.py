# SPDX-License-Identifier: Apache-2.0
"""On what a benchmark ran: printed, and written into every table and plot."""

from __future__ import annotations

import os
import platform
from importlib import metadata
from pathlib import Path
from xml.etree import ElementTree

from cable_ros.share import PACKAGE, share_file

PACKAGES = ("numpy", "scipy", "numba")


def describe() -> dict[str, str]:
    """Processor, cores this process may use, operating system, Python and package versions."""
    facts = {
        "processor": _processor(),
        "cores": str(len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()),
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
    }
    for package in PACKAGES:
        try:
            facts[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            facts[package] = "not installed"
    facts[PACKAGE] = _version()
    return facts


def _version() -> str:
    """Of this package, also if it runs from its source tree."""
    return ElementTree.parse(share_file("package.xml")).getroot().findtext("version", "unknown")


def _processor() -> str:
    try:
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith(("model name", "Model")):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or "unknown"
