# SPDX-License-Identifier: Apache-2.0
"""`cable solve`: the equilibrium at one pose."""

from __future__ import annotations

import argparse
import enum
import json
import math
import sys
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from cable_ros.cli._arguments import add_command, add_pose, add_tolerance, joint_values

if TYPE_CHECKING:
    from cable_ros.equilibrium import Contact, Equilibrium
    from cable_ros.limits import Extreme

EXAMPLE = """example:
  cable solve config/space_arm.yaml --joint orientation=30deg
  cable solve config/space_arm.yaml --pose pose.yaml
  cable solve config/space_arm.yaml --joint orientation=0.5 --json | jq .camera_cable.end_wrench

exit code: 0 when every cable's equilibrium can be trusted, else 1"""

PREFIXES = {0: "", -3: "m", -6: "µ", -9: "n", 3: "k", 6: "M"}


def add_parser(subparsers: argparse._SubParsersAction[Any]) -> None:
    parser = add_command(
        subparsers,
        "solve",
        "the equilibrium at one pose",
        "Solve each cable of a scene at one pose of the robot, and print what it does there.",
        EXAMPLE,
    )
    add_pose(parser)
    add_tolerance(parser)
    parser.add_argument(
        "--json",
        action="store_true",
        help="print JSON: by cable, with the field names of Equilibrium, and joint_load",
    )


def run(args: argparse.Namespace) -> int:
    from cable_ros.joint import joint_torque
    from cable_ros.scene import load_scene
    from cable_ros.tracker import Tracker

    tracker = Tracker(load_scene(args.scene), tolerance=args.tolerance)
    joints = joint_values(args, tracker.joint_names)
    equilibria = tracker.arrive(joints)
    load = dict(zip(tracker.joint_names, joint_torque(tracker, equilibria, joints).tolist(), strict=True))
    if args.json:
        found_all: dict[str, Any] = {name: as_json(found) for name, found in equilibria.items()}
        print(json.dumps(found_all | {"joint_load": _plain(load)}, indent=2))
    else:
        trusted = [describe(name, found) for name, found in equilibria.items() if found.status.trusted]
        if load and len(trusted) == len(equilibria):
            trusted.append(_load_lines(load, [limit.unit for limit in tracker.limits.joints]))
        if notes := [note for note in (*tracker.scene.notes, tracker.robot_overlaps.unknown) if note]:
            trusted.append("\n".join(["the robot's links", "", *(f"  {note}" for note in notes)]))
        print("\n\n".join(trusted), end="\n" if trusted else "")
    refused = {name: found for name, found in equilibria.items() if not found.status.trusted}
    for name, found in refused.items():
        print(f"cable solve: {name}: {found.message}", file=sys.stderr)
    return 1 if refused else 0


def describe(name: str, found: Equilibrium) -> str:
    """The equilibrium as a person reads it."""
    title = f"{name}: {found.message}"
    turn = math.degrees(found.total_twist)
    return "\n".join(
        [
            title,
            "",
            "  what the cable exerts on the body at each clamp, about the clamp point, in the clamp's frame",
            "           " + "".join(f"{head:>12}" for head in ("Fx", "Fy", "Fz", "Mx", "My", "Mz")),
            _wrench_line("end", found.end_wrench),
            _wrench_line("start", found.start_wrench),
            *(_wrench_line(name, wrench) for name, wrench in found.support_wrenches.items()),
            "",
            f"  energy            {engineering(found.energy, 'J')}  (elastic and weight)",
            f"  total twist       {found.total_twist:.4f} rad  ({turn:.1f} deg; names the branch)",
            f"  stability margin  {found.stability_margin:.3g}  (0 at a fold)",
            f"  error estimate    {found.error_estimate:.1e} of the end wrench",
            f"  effort            {found.iterations} iterations, {engineering(found.solve_time, 's')}",
            *_contact_lines(found.contacts),
            *_extreme_lines(found.extremes),
        ]
    )


def _load_lines(load: Mapping[str, float], units: Sequence[str]) -> str:
    """Torque or force on each joint, whose values are in these units."""
    lines = ["joint load, what all cables together exert on each joint, positive along its axis", ""]
    for (name, value), unit in zip(load.items(), units, strict=True):
        lines.append(f"  {name:<17} {engineering(value, 'N' if unit == 'm' else 'N m')}")
    return "\n".join(lines)


def engineering(value: float, unit: str) -> str:
    """The value with four digits and the unit with a prefix, as 42.11 mJ."""
    power = math.floor(math.log10(abs(value)) / 3) * 3 if value and math.isfinite(value) else 0
    power = min(max(power, min(PREFIXES)), max(PREFIXES))
    return f"{value / 10.0**power:.4g} {PREFIXES[power]}{unit}"


def as_json(found: Equilibrium) -> dict[str, Any]:
    """The fields by name; arrays as lists, the status by its name, NaN and infinity as null."""
    return {name: _plain(value) for name, value in found.as_dict().items()}


def _plain(value: Any) -> Any:
    if isinstance(value, enum.Enum):
        return value.name
    if hasattr(value, "tolist"):  # NumPy arrays and numbers
        value = value.tolist()
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, dict):
        return {name: _plain(item) for name, item in value.items()}
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def _contact_lines(contacts: Sequence[Contact]) -> Iterator[str]:
    """One line for each obstacle that is touched: where along the cable, and with what force in all."""
    for name in dict.fromkeys(contact.obstacle for contact in contacts):
        touching = [contact for contact in contacts if contact.obstacle == name]
        first, last = touching[0].arc_length, touching[-1].arc_length
        where = f"{first:.4g} m" if len(touching) == 1 else f"{first:.4g} to {last:.4g} m"
        force = math.hypot(
            *(sum(components) for components in zip(*(c.force for c in touching), strict=True))
        )
        slides = ", sliding" if any(contact.sliding for contact in touching) else ""
        yield f"  contact           {name} at {where}, {engineering(force, 'N')}{slides}"


def _extreme_lines(extremes: Sequence[Extreme]) -> Iterator[str]:
    """One line for each extreme: its value, where it is, and how much of its limit that is."""
    for extreme in extremes:
        title = extreme.quantity.words
        mark = ("", "  NEAR THE LIMIT", "  BEYOND THE LIMIT")[extreme.level]
        yield f"  {title:<17} {extreme.sentence.removeprefix(title.capitalize()).strip(' .')}{mark}"


def _wrench_line(clamp: str, wrench: Any) -> str:
    force = "".join(f"{value:>12.5g}" for value in wrench[:3])
    moment = "".join(f"{value:>12.5g}" for value in wrench[3:])
    return f"  {clamp:<9}{force}{moment}   N, N m"
