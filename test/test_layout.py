# SPDX-License-Identifier: Apache-2.0
"""The package's folders import only what is below them, and no modules import each other in a circle."""

from __future__ import annotations

import ast
import re
from collections import defaultdict
from pathlib import Path

import cable_ros

PACKAGE = Path(cable_ros.__file__).parent
ORDER = (
    ("common", "compilation", "interpretation", "kernel_compiler", "numba_shortcuts", "kept_code", "share"),
    ("linalg",),
    ("solve",),
    ("limits", "equilibrium"),
    ("scene",),
    ("rod",),
    ("contact",),
    ("effects",),
    ("branch",),
    ("tracker", "joint", "batch", "batch_result", "batch_work", "contributions", "robot_overlaps", "warm_up"),
    ("drawing",),
    ("baselines",),
    ("log",),
    ("ros",),
    ("bench",),
    ("cli",),
)
"""Folders and loose modules, the lowest first; what stands side by side may import each other."""
LEVEL = {name: level for level, names in enumerate(ORDER) for name in names}
MIDDLEWARE = re.compile(r"(rclpy|mcap|mcap_ros2|\w+_msgs|\w+_srvs|\w+_interfaces)(\.|$)")


def name_of(path: Path) -> str:
    """Dotted, without the package's own name; a folder's `__init__` has the folder's."""
    parts = path.relative_to(PACKAGE).with_suffix("").parts
    return ".".join(part for part in parts if part != "__init__")


PATHS = {name_of(path): path for path in sorted(PACKAGE.rglob("*.py"))}


def imported(path: Path) -> set[str]:
    """Full names of all that the file imports, wherever in it and under whatever condition."""
    out = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            out |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: imports are absolute"
            inner = {f"{node.module}.{alias.name}" for alias in node.names}
            modules = {name for name in inner if name.removeprefix("cable_ros.") in PATHS}
            out |= modules | ({node.module or ""} if inner - modules else set())
    return out


def graph() -> dict[str, set[str]]:
    """Module -> modules of this package that it imports; without the package's own `__init__`, a facade."""
    out: dict[str, set[str]] = defaultdict(set)
    for name, path in PATHS.items():
        for full in imported(path):
            if name and full.startswith("cable_ros."):
                out[name].add(full.removeprefix("cable_ros."))
    return out


IMPORTS = graph()


def test_every_folder_has_its_place_in_the_order() -> None:
    assert {name.split(".")[0] for name in PATHS if name} == set(LEVEL)


def test_imports_lead_down() -> None:
    upward = [
        f"{name} imports {other}"
        for name, others in IMPORTS.items()
        for other in sorted(others)
        if LEVEL[other.split(".")[0]] > LEVEL[name.split(".")[0]]
    ]
    assert upward == []


def test_no_circles() -> None:
    """Also none that TYPE_CHECKING or an import within a function hides."""
    rest = {name: set(others) - {name} for name, others in IMPORTS.items()}
    while True:  # take away what imports nothing that is left
        rest = {name: others & rest.keys() for name, others in rest.items()}
        if not (leaves := {name for name, others in rest.items() if not others}):
            break
        rest = {name: others for name, others in rest.items() if name not in leaves}
    assert rest == {}


def test_the_facade_is_imported_by_nobody_inside() -> None:
    inside = [name for name, path in PATHS.items() if name and "cable_ros" in imported(path)]
    assert inside == []


def test_two_folders_know_ros_and_its_logs() -> None:
    known = {
        name.split(".")[0]
        for name, path in PATHS.items()
        if any(MIDDLEWARE.match(full) for full in imported(path))
    }
    assert known == {"ros", "log"}


def test_files_of_one_name_mean_one_thing() -> None:
    """A command has the name of what it shows, and each folder may have errors of its own."""
    homes = defaultdict(list)
    for name in PATHS:
        folder, _, base = name.rpartition(".")
        if folder != "cli":
            homes[base].append(name)
    alike = {base: names for base, names in homes.items() if len(names) > 1}
    assert set(alike) <= {"errors", "contact"}
