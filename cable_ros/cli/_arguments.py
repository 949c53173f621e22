"""What several commands read from their arguments: joint values, ranges, tolerances."""

from __future__ import annotations

import argparse
import math
import textwrap
from collections.abc import Iterable, Sequence
from typing import Any, cast

import numpy as np

from cable_ros.share import scene_path

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
        help="joint value, rad or m; 30deg for degrees; once for each joint",
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


def count(text: str) -> int:
    """A whole number from 0 on."""
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"'{text}' is not a whole number from 0 on, such as 100")
    return int(text)


def joint_values(pairs: Sequence[tuple[str, float]], needed: Iterable[str]) -> dict[str, float]:
    """The values by name, one for each needed joint and for no other.

    Raises:
        CommandError: a joint is missing, given twice, or moves no cable (a misspelt name).
    """
    check_joints([name for name, _ in pairs], needed)
    return dict(pairs)


def check_joints(given: Sequence[str], needed: Iterable[str]) -> None:
    """Raise CommandError unless each needed joint, and no other, is given once."""
    needed = list(needed)
    which = f"those that do: {', '.join(needed)}" if needed else "none does in this scene"
    for name in given:
        if name not in needed:
            raise CommandError(f"the joint '{name}' moves no cable; {which}")
        if given.count(name) > 1:
            raise CommandError(f"the joint '{name}' is given more than once")
    missing = [name for name in needed if name not in given]
    if missing:
        options = " ".join(f"--joint {name}=VALUE" for name in missing)
        raise CommandError(f"the cables depend on joints without a value; add {options}")


def _split(text: str, form: str) -> tuple[str, str]:
    name, equals, value = text.partition("=")
    if not (name and equals and value):
        raise argparse.ArgumentTypeError(f"'{text}' is not NAME={form}")
    return name, value
