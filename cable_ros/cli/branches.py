# SPDX-License-Identifier: Apache-2.0
"""`cable branches`: the stable equilibria of one pose."""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cable_ros.cli._arguments import CommandError, add_command, add_pose, joint_values
from cable_ros.cli.solve import as_json, engineering

if TYPE_CHECKING:
    from cable_ros.equilibrium import Equilibrium

EXAMPLE = """example:
  cable branches config/space_arm.yaml --joint orientation=0 --out branches.png

Write the total twist of the one that your cable is on into the scene, as total_twist: a cold start then
finds it."""

PICTURES = (".png", ".pdf", ".svg")


def add_parser(subparsers: argparse._SubParsersAction[Any]) -> None:
    parser = add_command(
        subparsers,
        "branches",
        "the stable equilibria of one pose",
        "List the stable equilibria that a search finds at one pose, and draw them. They differ "
        "by turns of twist and by the side to which the cable loops; a real cable shows one of them.",
        EXAMPLE,
    )
    add_pose(parser)
    parser.add_argument(
        "--out",
        metavar="FILE",
        type=Path,
        default=Path("branches.png"),
        help="picture: .png, .pdf or .svg (default branches.png)",
    )
    parser.add_argument("--json", action="store_true", help="print JSON with the field names of Equilibrium")


def run(args: argparse.Namespace) -> int:
    from cable_ros.branch.enumeration import branches
    from cable_ros.scene import Kinematics, load_scene

    if args.out.suffix not in PICTURES:
        raise CommandError(f"--out {args.out}: the name must end in .png, .pdf or .svg")
    scene = load_scene(args.scene)
    joints = joint_values(args, Kinematics(scene).joint_names)
    found = branches(scene, joints)
    if args.json:
        print(json.dumps({name: [as_json(one) for one in ones] for name, ones in found.items()}, indent=2))
    else:
        print("\n\n".join(describe(name, ones) for name, ones in found.items()))
    if any(found.values()):
        draw(found, ", ".join(f"{name} = {value:.4g}" for name, value in joints.items()), args.out)
        if not args.json:
            print(f"\n{args.out}: their shapes")
    return 0 if all(found.values()) else 1


def describe(name: str, found: Sequence[Equilibrium]) -> str:
    """One cable's equilibria as a table."""
    if not found:
        return f"{name}: no stable equilibrium was found at this pose"
    head = f"  {'':>3}{'energy':>12}{'total twist':>28}{'margin':>10}{'|end force|':>14}{'|end moment|':>15}"
    lines = [f"{name}: {len(found)} stable {'equilibria' if len(found) > 1 else 'equilibrium'}", "", head]
    for number, one in enumerate(found, 1):
        twist = f"{one.total_twist:.4f} rad {f'({math.degrees(one.total_twist):.1f} deg)':>13}"
        force = engineering(math.hypot(*one.end_wrench[:3]), "N")
        moment = engineering(math.hypot(*one.end_wrench[3:]), "N m")
        lines.append(
            f"  {number:>3}{engineering(one.energy, 'J'):>12}{twist:>28}{one.stability_margin:>10.3f}"
            f"{force:>14}{moment:>15}"
        )
    return "\n".join(lines)


def draw(found: Mapping[str, Sequence[Equilibrium]], pose: str, out: Path) -> None:
    """The shapes of all of them, coloured by energy, as a picture."""
    from cable_ros.drawing.figures import Shape, save, shapes_figure

    shapes = []
    for name, ones in found.items():
        for number, one in enumerate(ones, 1):
            which = f"{name} {number}" if len(found) > 1 else str(number)
            label = f"{which}: {engineering(one.energy, 'J')}, {one.total_twist:.2f} rad"
            shapes.append(Shape(name, label, one.points, float(number)))
    title = f"Stable equilibria of {', '.join(found)}{f' at {pose}' if pose else ''}"
    save(shapes_figure(shapes, title, "energy and total twist"), out)
