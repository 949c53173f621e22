# SPDX-License-Identifier: Apache-2.0
"""`cable modes`: the lowest natural frequencies about the equilibrium at one pose."""

from __future__ import annotations

import argparse
import json
import math
import sys
from typing import TYPE_CHECKING, Any

import numpy as np

from cable_ros.cli._arguments import add_command, add_pose, add_tolerance, joint_values, whole_number
from cable_ros.cli.solve import engineering

if TYPE_CHECKING:
    from cable_ros.equilibrium import Equilibrium, Modes

EXAMPLE = """example:
  cable modes config/space_arm.yaml --joint orientation=30deg
  cable modes config/space_arm_sphere.yaml --joint orientation=60deg --count 3 --json

Clamps and obstacles stand still, contacts go on pressing. A motion of the joints is quasi-static if the swing
that it stirs up is small: about its acceleration over (2 pi f)^2, f the lowest frequency.

exit code: 0 when every cable's equilibrium can be trusted, else 1"""


def add_parser(subparsers: argparse._SubParsersAction[Any]) -> None:
    parser = add_command(
        subparsers,
        "modes",
        "the lowest natural frequencies at one pose",
        "Print the lowest natural frequencies of each cable about its equilibrium, and where and along "
        "which of the world's axes it moves.",
        EXAMPLE,
    )
    add_pose(parser)
    add_tolerance(parser)
    parser.add_argument("--count", metavar="N", type=whole_number, default=6, help="how many (default 6)")
    parser.add_argument(
        "--json", action="store_true", help="print JSON: by cable, frequencies [Hz] and shapes as in Modes"
    )


def run(args: argparse.Namespace) -> int:
    from cable_ros.scene import load_scene
    from cable_ros.tracker import Tracker

    tracker = Tracker(load_scene(args.scene), tolerance=args.tolerance)
    equilibria = tracker.arrive(joint_values(args, tracker.joint_names))
    trusted = {name: found for name, found in equilibria.items() if found.status.trusted}
    modes = {name: found.modes(args.count) for name, found in trusted.items()}
    if args.json:
        print(json.dumps({name: as_json(one) for name, one in modes.items()}, indent=2))
    else:
        text = "\n\n".join(describe(name, trusted[name], one) for name, one in modes.items())
        print(text, end="\n" if text else "")
    refused = {name: found for name, found in equilibria.items() if name not in trusted}
    for name, found in refused.items():
        print(f"cable modes: {name}: {found.message}", file=sys.stderr)
    return 1 if refused else 0


def describe(name: str, found: Equilibrium, modes: Modes) -> str:
    """One cable's modes as a table."""
    lowest = float(modes.frequencies[0]) if len(modes.frequencies) else math.nan
    if math.isinf(lowest):
        return f"{name}: it has no mass (linear_density 0), so nothing swings"
    if math.isnan(lowest):
        return (
            f"{name}: no frequencies are known: friction alone makes this equilibrium stable, or the cable "
            "touches another cable, stretches where it rubs, or shears where it touches"
        )
    length = float(np.linalg.norm(np.diff(found.points, axis=0), axis=1).sum())
    lines = [
        f"{name}: {found.message}",
        "",
        f"  {'':>3}{'frequency':>14}{'period':>12}{'most at':>12}   along X, Y, Z",
    ]
    for number, (frequency, shape) in enumerate(zip(modes.frequencies, modes.shapes, strict=True), 1):
        size = np.linalg.norm(shape, axis=1)
        arc_length = length * float(np.argmax(size)) / (len(size) - 1)
        shares = 100.0 * (shape**2).sum(axis=0) / (shape**2).sum()
        lines.append(
            f"  {number:>3}{engineering(frequency, 'Hz'):>14}{engineering(1.0 / frequency, 's'):>12}"
            f"{f'{arc_length:.3g} m':>12}   " + ", ".join(f"{share:.0f} %" for share in shares)
        )
    swing = engineering(1.0 / (2.0 * math.pi * lowest) ** 2, "m")
    return "\n".join(
        [*lines, "", f"  a clamp that is accelerated by 1 m/s^2 makes it swing by about {swing}"]
    )


def as_json(modes: Modes) -> dict[str, Any]:
    """Frequencies and shapes as lists; null where there is no number."""
    shapes = np.where(np.isfinite(modes.shapes), modes.shapes, 0.0).tolist()
    return {
        "frequencies": [value if math.isfinite(value) else None for value in modes.frequencies.tolist()],
        "shapes": shapes if np.isfinite(modes.shapes).all() else None,
    }
