# SPDX-License-Identifier: Apache-2.0
"""`cable log`: what a log holds, and saving what is whole of one that was cut off."""

from __future__ import annotations

import argparse
import sys
from datetime import datetime, timezone
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cable_ros.cli._arguments import add_command
from cable_ros.common.printable import escaped, one_line

if TYPE_CHECKING:
    from cable_ros.log.reader import LogReader
    from cable_ros.log.recover import Recovery

EXAMPLE = """example:
  cable log info space_arm.mcap
  cable log recover space_arm.mcap.part

A log is called '.mcap.part' until it is finished; one that keeps that name was cut off."""


def add_parser(subparsers: argparse._SubParsersAction[Any]) -> None:
    """Add `cable log` and its two commands."""
    parser = add_command(
        subparsers,
        "log",
        "look into a log, or recover one that was cut off",
        "Look into a log of the cable node, or recover one whose writer was killed.",
        EXAMPLE,
    )
    actions = parser.add_subparsers(title="actions", dest="action", metavar="ACTION", required=True)
    info = add_command(
        actions,
        "info",
        "print what a log holds",
        "Print the topics, times and facts that a log holds.",
        "example:\n  cable log info space_arm.mcap",
    )
    info.add_argument("log", metavar="FILE", type=Path, help="finished log (.mcap)")
    recover = add_command(
        actions,
        "recover",
        "save what is whole into a new, indexed file",
        "Save every whole chunk of a log that was cut off into a new file with an index.",
        "example:\n  cable log recover space_arm.mcap.part",
    )
    recover.add_argument("log", metavar="FILE", type=Path, help="log that was cut off; it is left as it is")
    recover.add_argument(
        "--out",
        metavar="FILE",
        type=Path,
        help="new file (default: FILE without '.part', or <stem>_recovered.mcap)",
    )


def run(args: argparse.Namespace) -> int:
    """Exit code 0; 1 where nothing could be recovered; LogError where the log cannot be read at all."""
    from cable_ros.log.reader import LogReader
    from cable_ros.log.recover import recover

    if args.action == "info":
        with LogReader(args.log) as reader:
            print(describe(reader))
        return 0
    recovery = recover(args.log, args.out)
    print(report(args.log, recovery))
    if not any(recovery.messages.values()):
        print(f"cable log: {one_line(str(args.log))} holds no whole message: none was saved", file=sys.stderr)
        return 1
    return 0


def describe(log: LogReader) -> str:
    """The log as a person reads it."""
    count = sum(topic.count for topic in log.topics.values())
    seconds = (log.end - log.start) / 1e9
    lines = [
        f"{log.path}: {log.path.stat().st_size / 1e6:.3g} MB, {count} messages in {seconds:.3f} s"
        + (f", from {_time(log.start)} to {_time(log.end)}" if count else ""),
        "",
    ]
    width = max((len(escaped(name)) for name in log.topics), default=0)
    for topic in sorted(log.topics.values(), key=lambda topic: topic.name):
        rate = f"{topic.count / seconds:8.1f} Hz" if seconds > 0 else ""
        lines.append(f"  {escaped(topic.name):{width}}  {topic.count:>9} {rate}  {topic.type_name}")
    for name, text in log.attachments.items():
        lines.append(f"  attachment {name}, {len(text)} characters")
    for name, entries in log.metadata.items():
        if name != "rosbag2":
            lines += ["", f"  {name}:", *(f"    {key}: {value}" for key, value in entries.items() if value)]
    return "\n".join(map(escaped, lines))


def report(source: Path, recovery: Recovery) -> str:
    """What was saved and what was lost."""
    count = sum(recovery.messages.values())
    span = (
        f", {(recovery.end - recovery.start) / 1e9:.3f} s from {_time(recovery.start)}"
        f" to {_time(recovery.end)}"
        if recovery.start is not None
        else ""
    )
    lines = [
        f"{recovery.path}: saved {count} messages of {len(recovery.messages)} topics and"
        f" {recovery.attachments} attachments{span}"
    ]
    lines += [f"  {escaped(name)}: {number}" for name, number in sorted(recovery.messages.items())]
    for damage in recovery.damages:
        lines.append(
            f"lost: {damage.size} bytes of {source} from byte {damage.offset} on: {escaped(damage.what)}"
        )
    if recovery.orphans:
        lines.append(f"lost: {recovery.orphans} messages whose topic was named in a damaged place")
    if recovery.was_whole:
        lines.append("lost: nothing")
    return "\n".join(lines)


def _time(nanoseconds: int) -> str:
    moment = datetime.fromtimestamp(nanoseconds // 1_000_000_000, timezone.utc)
    return f"{moment:%Y-%m-%d %H:%M:%S}.{nanoseconds % 1_000_000_000 // 1_000_000:03d} UTC"
