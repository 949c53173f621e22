# SPDX-License-Identifier: Apache-2.0
"""Writes the pages that the code knows best: fields of a scene file, parameters of the node, commands.

python docs/reference.py          write them
python docs/reference.py --check  exit code 1 if a page is not what the code says
"""

from __future__ import annotations

import argparse
import importlib
import re
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from cable_ros.bench.markdown import markdown_table
from cable_ros.cli import main as cli
from cable_ros.scene.fields import REQUIRED, Field, Size
from cable_ros.scene.load import SCENE

FOLDER = Path(__file__).parent
NOTE = "<!-- Written by docs/reference.py: change the code, not this page. -->"

SCENE_START = f"""{NOTE}
# The scene file

YAML in SI units: metres, kilograms, newtons, radians; quaternions are x y z w. Every mistake is one
sentence with the file, the field and what would be right. [first_steps.md](first_steps.md) builds a scene;
complete ones are [space_arm.yaml](../config/space_arm.yaml),
[space_arm_sphere.yaml](../config/space_arm_sphere.yaml), [space_arm_cold.yaml](../config/space_arm_cold.yaml)
and [draped.yaml](../config/draped.yaml).
"""

PARAMETERS_START = f"""{NOTE}
# Parameters of the node

As in `config/cable_node.yaml`, or on the command line: `-p tolerance:=1e-6`. Those marked live can be changed
while the node runs, as in `ros2 param set /cable_node tolerance 1e-6`; the others are read once.
"""

COMMANDS_START = f"""{NOTE}
# Commands

The exit code is 0 when done, 1 when the answer is no, and 2 with one sentence on stderr when it could not be
done. `-h` after a command prints what stands here.
"""


def mappings(fields: Iterable[Field] = SCENE, place: str = "") -> Iterator[tuple[str, Field | None]]:
    """Place and field of every mapping of a scene file, the file itself (`""`, None) first."""
    if not place:
        yield "", None
    for field in fields:
        if field.inner:
            inside = f"{place}.{field.name}".lstrip(".") + ("[]" if field.kind.startswith("list") else "")
            yield inside, field
            yield from mappings(field.inner, inside)


def scene_page() -> str:
    """The reference of the scene file; mappings of equal fields share a section."""
    sections: dict[tuple[Field, ...], list[tuple[str, Field | None]]] = {}
    for place, field in mappings():
        sections.setdefault(field.inner if field else SCENE, []).append((place, field))
    parts = [SCENE_START]
    for fields, places in sections.items():
        title = ", ".join(f"`{place}`" for place, _ in places if place) or "The file"
        parts.append(f"## {title}\n")
        said = dict.fromkeys(field.meaning for _, field in places if field)
        parts += ["\n".join(said) + "\n"] if said else []
        head = ("field", "type", "unit", "default", "range", "meaning", "example")
        parts.append(markdown_table(head, map(_row, fields)) + "\n")
    return "\n".join(parts)


def _row(field: Field) -> list[str]:
    cells = [
        f"`{field.name}`",
        field.kind,
        field.unit or (field.size.unit if field.size else ""),
        _default(field),
        _range(field),
        field.meaning,
        f"`{field.example}`",
    ]
    return [cell.replace("|", "\\|") for cell in cells]


def _default(field: Field) -> str:
    if field.absent:
        return field.absent
    return "required" if field.default is REQUIRED else f"`{field.default}`"


def _range(field: Field) -> str:
    bounds = [_bounds(field.size)] if field.size else [", ".join(f"`{word}`" for word in field.words)]
    bounds += [_bounds(size) for size in field.columns]
    return "; ".join(part for part in (*bounds, field.extent) if part)


def _bounds(size: Size) -> str:
    return f"{_figure(size.low)} to {_figure(size.high)}"


def _figure(value: float) -> str:
    """A whole number of up to seven digits as it is written by hand."""
    return f"{value:.0f}" if value == round(value) and abs(value) < 1e7 else f"{value:g}"


def parameters_page() -> str:
    """The node's parameters; needs rclpy."""
    from cable_ros.ros.parameters import DECLARATIONS

    rows = []
    for entry in DECLARATIONS:
        default = str(entry.default).lower() if isinstance(entry.default, bool) else entry.default
        kind = {bool: "bool", int: "integer", float: "double", str: "string"}[type(entry.default)]
        shown = default if isinstance(default, str) else f"{default:g}"
        bounds = "" if entry.low is None else f"{_figure(entry.low)} to {_figure(entry.high)}"
        live = "live" if entry.live else ""
        rows.append([f"`{entry.name}`", kind, f"`{shown}`" if shown else "", bounds, live, entry.description])
    table = markdown_table(("parameter", "type", "default", "range", "", "meaning"), rows)
    return f"{PARAMETERS_START}\n{table}\n"


def commands_page() -> str:
    """The `cable` command, from its parsers."""
    names = cli._command_names()
    parser = cli._parser({name: importlib.import_module(f"cable_ros.cli.{name}") for name in names})
    return "\n".join([COMMANDS_START, *_sections(parser, "cable")])


def _sections(parser: argparse.ArgumentParser, name: str) -> Iterator[str]:
    commands = [a for a in parser._actions if isinstance(a, argparse._SubParsersAction)]
    if name != "cable":
        yield f"## `{name}`\n\n{parser.description}\n"
        rows = [_argument(a) for a in parser._actions if a not in commands and a.dest != "help"]
        if rows:
            yield markdown_table(("argument", "default", "meaning"), rows) + "\n"
        whole = re.sub(r"\s*\\\n\s*", " ", parser.epilog or "")  # a command may go over several lines
        examples = [re.sub(r"(?<=\S)   +(?=[a-z])", "  # ", line.strip()) for line in whole.splitlines()]
        examples = [line for line in examples if line.startswith("cable ")]
        if examples:
            yield "```bash\n" + "\n".join(examples) + "\n```\n"
    for action in commands:
        for inner, sub in action.choices.items():
            yield from _sections(sub, f"{name} {inner}")


def _argument(action: argparse.Action) -> list[str]:
    metavar = action.metavar
    if metavar is None and action.nargs != 0:
        metavar = "|".join(map(str, action.choices)) if action.choices else action.dest.upper()
    shown = " ".join(metavar) if isinstance(metavar, tuple) else metavar or ""
    name = ", ".join(action.option_strings)
    text = (action.help or "") % {**vars(action), "prog": "cable"}
    cells = [f"`{' '.join(part for part in (name, shown) if part)}`", _argument_default(action), text]
    return [cell.replace("|", "\\|").replace("<", "&lt;") for cell in cells]


def _argument_default(action: argparse.Action) -> str:
    value: Any = action.default
    if value in (None, False, [], argparse.SUPPRESS):
        return "required" if action.required and not action.option_strings else ""
    return f"`{value}`"


PAGES = {"scene.md": scene_page, "parameters.md": parameters_page, "commands.md": commands_page}


def main(arguments: list[str]) -> int:
    stale = [name for name, page in PAGES.items() if page() != _kept(name)]
    if arguments == ["--check"]:
        for name in stale:
            print(f"docs/{name} is not what the code says: run python docs/reference.py", file=sys.stderr)
        return int(bool(stale))
    for name in stale:
        (FOLDER / name).write_text(PAGES[name](), encoding="utf-8")
    return 0


def _kept(name: str) -> str:
    path = FOLDER / name
    return path.read_text(encoding="utf-8") if path.exists() else ""


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
