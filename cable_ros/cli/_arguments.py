# SPDX-License-Identifier: Apache-2.0
"""What several commands read from their arguments: joint values, ranges, tolerances."""

from __future__ import annotations

import argparse
import math
import sys
import textwrap
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, cast

import numpy as np

from cable_ros.share import scene_path

MOST_JOINT = 1e4  # rad or m; beyond, a tracker takes it for a fault
MOST_VALUES = 10_000_000  # of one range; more is a mistyped step


class CommandError(Exception):
    """A command cannot do what was asked; the text is one sentence that says why."""


def add_command(
    subparsers: argparse._SubParsersAction[Any], name: str, summary: str, description: str, epilog: str
) -> argparse.ArgumentParser:
    """A subcommand with its one-line summary, its description, and its examples as they are written."""
    return cast(
        "argparse.ArgumentParser",
        subparsers.add_parser(
            name,
            help=summary,
            description=textwrap.fill(description, 90),
            epilog=epilog,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        ),
    )


def add_scene(parser: argparse.ArgumentParser) -> None:
    """SCENE."""
    what = "scene file (YAML); a bare name is also sought among the installed scenes"
    parser.add_argument("scene", metavar="SCENE", type=scene_path, help=what)


def add_pose(parser: argparse.ArgumentParser) -> None:
    """SCENE, and --joint for each of its joints."""
    add_scene(parser)
    parser.add_argument(
        "--joint",
        metavar="NAME=VALUE",
        type=named_quantity,
        action="append",
        default=[],
        help="joint value, rad or m; 30deg for degrees; once for each joint, 0 for those not named",
    )
    parser.add_argument(
        "--pose",
        metavar="FILE",
        type=Path,
        help="joint values as YAML, 'NAME: VALUE' or lists 'name' and 'position' as in a joint state "
        "(ros2 topic echo --once /joint_states); --joint goes before",
    )


def add_tolerance(parser: argparse.ArgumentParser) -> None:
    """--tolerance of the tracker."""
    parser.add_argument(
        "--tolerance",
        metavar="T",
        type=relative_tolerance,
        default=1e-4,
        help="relative error of the end wrench that is acceptable (default 1e-4)",
    )


def quantity(text: str) -> float:
    """A finite number; with `deg` behind it, degrees, given back in rad; `rad` may stand there too."""
    number, scale = text.strip(), 1.0
    if number.endswith("deg"):
        number, scale = number[:-3], math.pi / 180
    elif number.endswith("rad"):
        number = number[:-3]
    try:
        value = float(number)
    except ValueError:
        raise argparse.ArgumentTypeError(
            f"'{text}' is not a number such as 0.5 (rad or m) or 30deg"
        ) from None
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"'{text}' is not finite")
    return value * scale


def named_quantity(text: str) -> tuple[str, float]:
    """`NAME=VALUE` as (name, value in rad or m)."""
    name, value = _split(text, "VALUE, such as orientation=30deg")
    return name, quantity(value)


def named_range(text: str) -> tuple[str, np.ndarray]:
    """`NAME=START:STOP:STEP[deg]`, `NAME=A,B,C` or `NAME=VALUE` as (name, values); both ends included."""
    name, values = _split(text, "START:STOP:STEP, such as orientation=-90:90:0.5deg")
    if ":" not in values:
        return name, np.array([quantity(value) for value in values.split(",")])
    parts = values.split(":")
    if len(parts) != 3:
        raise argparse.ArgumentTypeError(f"'{values}' is not START:STOP:STEP, such as -90:90:0.5deg")
    # The unit is written once, behind the step, and holds for all three.
    unit = next((unit for unit in ("deg", "rad") if parts[2].endswith(unit)), "")
    start, stop, step = (quantity(part.removesuffix(unit) + unit) for part in parts)
    if step == 0 or (stop - start) * step < 0:
        raise argparse.ArgumentTypeError(f"the step of '{values}' does not lead from its start to its stop")
    count = math.floor((stop - start) / step + 1e-9) + 1  # 1e-9: the stop is met in spite of rounding
    if count > MOST_VALUES:
        raise argparse.ArgumentTypeError(f"'{values}' has {count} values; take a longer step")
    return name, start + step * np.arange(count)


def relative_tolerance(text: str) -> float:
    """A number between 1e-12 and 0.1, both included."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 1e-12 <= value <= 0.1:
        raise argparse.ArgumentTypeError(f"'{text}' is not between 1e-12 and 0.1, such as 1e-4")
    return value


def process_count(text: str) -> int:
    """A whole number from 1 on."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"'{text}' is not a number of processes, such as 4")
    return int(text)


def whole_number(text: str) -> int:
    """A whole number from 1 to 1000."""
    if not text.isdecimal() or not 1 <= int(text) <= 1000:
        raise argparse.ArgumentTypeError(f"'{text}' is not a whole number from 1 to 1000, such as 6")
    return int(text)


def count(text: str) -> int:
    """A whole number from 0 on."""
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"'{text}' is not a whole number from 0 on, such as 100")
    return int(text)


def joint_values(args: argparse.Namespace, needed: Iterable[str]) -> dict[str, float]:
    """The values of --joint and --pose by name, one for each needed joint. Others are 0, and reported.

    Raises:
        CommandError: a joint is given twice or moves no cable (a misspelt name), or the file holds no pose.
    """
    needed = list(needed)
    check_names([name for name, _ in args.joint], needed)
    filed = read_pose(args.pose) if args.pose is not None else {}
    values = {name: value for name, value in filed.items() if name in needed} | dict(args.joint)
    return dict.fromkeys(not_named(args.command, values, needed), 0.0) | values


def not_named(command: str, given: Iterable[str], needed: Iterable[str]) -> list[str]:
    """The needed joints that are not among the given ones; a line on stderr says that they are 0."""
    missing = [name for name in needed if name not in given]
    if missing:
        what = "joint" if len(missing) == 1 else "joints"
        print(f"cable {command}: 0 for the {what} {', '.join(missing)}, not named", file=sys.stderr)
    return missing


def read_pose(path: Path) -> dict[str, float]:
    """Joint values by name from a YAML file: a mapping of names to numbers, or a joint state.

    Raises:
        CommandError: it is neither.
        OSError, SceneError: it cannot be read, or is no YAML.
    """
    from cable_ros.scene.text import parse_yaml, read_text

    place = f"--pose {path}"
    # `ros2 topic echo` ends each message with a line of dashes.
    text = read_text(path, place, "joint values in YAML").split("\n---")[0]
    found = parse_yaml(text, place)
    if not isinstance(found, dict):
        raise CommandError(f"{place}: must be lines 'NAME: VALUE', rad or m, or a joint state")
    names, positions = found.get("name"), found.get("position")
    if isinstance(names, list) and isinstance(positions, list):
        if len(names) != len(positions):
            raise CommandError(f"{place}: {len(names)} names and {len(positions)} positions")
        found = dict(zip(map(str, names), positions, strict=True))
    for name, value in found.items():
        number = isinstance(value, int | float) and not isinstance(value, bool)
        if not number or not abs(value) <= MOST_JOINT:
            raise CommandError(
                f"{place}: {name}: must be a number in rad or m within {MOST_JOINT:g}, such as 0.5; "
                "give 'NAME: VALUE' or lists 'name' and 'position'"
            )
    return {name: float(value) for name, value in found.items()}


def check_joints(given: Sequence[str], needed: Iterable[str]) -> None:
    """Raise CommandError unless each needed joint, and no other, is given once."""
    needed = list(needed)
    check_names(given, needed)
    missing = [name for name in needed if name not in given]
    if missing:
        options = " ".join(f"--joint {name}=VALUE" for name in missing)
        raise CommandError(f"the cables depend on joints without a value; add {options}")


def check_names(given: Sequence[str], needed: Sequence[str]) -> None:
    """Raise CommandError if a joint is none of the needed ones, or given more than once."""
    which = f"those that do: {', '.join(needed)}" if needed else "none does in this scene"
    for name in given:
        if name not in needed:
            raise CommandError(f"the joint '{name}' moves no cable; {which}")
        if given.count(name) > 1:
            raise CommandError(f"the joint '{name}' is given more than once")


def _split(text: str, form: str) -> tuple[str, str]:
    name, equals, value = text.partition("=")
    if not (name and equals and value):
        raise argparse.ArgumentTypeError(f"'{text}' is not NAME={form}")
    return name, value
