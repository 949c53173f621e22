# SPDX-License-Identifier: Apache-2.0
"""`cable explain`: what each effect does at one pose, and what it costs."""

from __future__ import annotations

import argparse
import dataclasses
import json
import math
import sys
from typing import TYPE_CHECKING, Any

from cable_ros.cli._arguments import add_command, add_pose, add_tolerance, joint_values
from cable_ros.cli.solve import engineering

if TYPE_CHECKING:
    from cable_ros.contributions import Explained, Explanation

EXAMPLE = """example:
  cable explain config/space_arm.yaml --joint orientation=30deg
  cable explain config/space_arm_sphere.yaml --joint orientation=60deg --tolerance 1e-3

An effect's change is that of the end wrench between the equations with and without it; its time is what it
adds to a warm-started solve. Both are measured.

exit code: 0 when every cable's equilibrium can be trusted, else 1"""


def add_parser(subparsers: argparse._SubParsersAction[Any]) -> None:
    parser = add_command(
        subparsers,
        "explain",
        "which effects are present at one pose, why, and what each changes and costs",
        "Print every effect of a scene: whether it is there and why, what leaving it out would "
        "change in the end wrench, and what it costs in time.",
        EXAMPLE,
    )
    add_pose(parser)
    add_tolerance(parser)
    parser.add_argument("--json", action="store_true", help="print JSON")


def run(args: argparse.Namespace) -> int:
    from cable_ros.contributions import explain
    from cable_ros.scene import Kinematics, load_scene

    scene = load_scene(args.scene)
    joints = joint_values(args, Kinematics(scene).joint_names)
    explained = explain(scene, joints, args.tolerance)
    if args.json:
        out = {name: as_json(one) for name, one in explained.items()}
        print(json.dumps({"effects": scene.effects, "tolerance": args.tolerance, "cables": out}, indent=2))
    else:
        heading = f"effects: {scene.effects if isinstance(scene.effects, str) else ', '.join(scene.effects)}"
        print(f"{heading}; tolerance {args.tolerance:g}\n")
        print("\n\n".join(describe(name, one) for name, one in explained.items()))
    refused = {n: e.equilibrium for n, e in explained.items() if not e.equilibrium.status.trusted}
    for name, found in refused.items():
        print(f"cable explain: {name}: {found.message}", file=sys.stderr)
    return 1 if refused else 0


def describe(name: str, explanation: Explanation) -> str:
    """One cable's table as a person reads it."""
    found = explanation.equilibrium
    if not found.status.trusted:
        return f"{name}: no equilibrium to explain"
    lines = [
        f"{name}: {found.message}",
        f"  a warm-started solve takes {_time(explanation.time)}; bending and torsion are always in it",
        "",
        f"  {'effect':<15}{'there':<7}{'changes wrench by':>18}{'takes':>10}   size and cause",
    ]
    for effect in explanation.effects:
        lines.append(
            f"  {effect.name:<15}{'yes' if effect.present else 'no':<7}{_change(effect):>18}"
            f"{_time(effect.time):>10}   {_size(effect)}{effect.why}"
        )
    return "\n".join([*lines, "", f"  {explanation.self_contact}"])


def as_json(explanation: Explanation) -> dict[str, Any]:
    """One cable as JSON can hold it: times in s, numbers that are not there null."""
    found = explanation.equilibrium
    return {
        "status": found.status.name,
        "message": found.message,
        "time": _number(explanation.time),
        "self_contact": explanation.self_contact,
        "effects": [
            {key: _number(value) for key, value in dataclasses.asdict(effect).items()}
            for effect in explanation.effects
        ],
    }


def _number(value: Any) -> Any:
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _change(effect: Explained) -> str:
    if effect.change is None:
        return "-"
    return f"{100 * effect.change:.3g} %" if effect.change >= 1e-3 else f"{effect.change:.1e}"


def _time(value: float | None) -> str:
    return "-" if value is None or math.isnan(value) else engineering(float(f"{value:.2g}"), "s")


def _size(effect: Explained) -> str:
    return "" if effect.size is None else f"{effect.formula} = {effect.size:.3g}; "
