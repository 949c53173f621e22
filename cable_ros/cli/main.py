# SPDX-License-Identifier: Apache-2.0
"""The `cable` command: every other file of this folder is one of its subcommands."""

from __future__ import annotations

import argparse
import importlib
import os
import pkgutil
import sys
from collections.abc import Sequence
from typing import Any, NoReturn

import cable_ros.cli
from cable_ros.common import compile_watch
from cable_ros.common.printable import one_line
from cable_ros.common.requirements import missing
from cable_ros.interpretation import Interpretation

INTERRUPTED = 130  # 128 + SIGINT, and the like for SIGPIPE: what a shell reports for a program they end
BROKEN_PIPE = 141
EXTRAS = {
    "matplotlib": "plot",
    "pyarrow": "parquet",
    "distributed": "cluster",
    "rclpy": "ros",
    "sensor_msgs": "ros",
    "geometry_msgs": "ros",
}
"""The extra of our package that brings what a command may miss."""
_REMEDIES: dict[type, str] = {
    FileNotFoundError: "there is no such file or folder; check the path",
    FileExistsError: "a file of this name is in the way; name another folder",
    NotADirectoryError: "a part of this path is a file, not a folder; name another",
    IsADirectoryError: "it is a folder; name a file",
    PermissionError: "this user may not do that there; name another place",
}


class Parser(argparse.ArgumentParser):
    """An argument parser whose complaint is one sentence."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: {message}; see '{self.prog} -h'\n")


def main(argv: Sequence[str] | None = None) -> int:
    """Run `cable` with `argv` (default: the process's) and return its exit code.

    0: done; 1: done, and the answer is no; 2: it could not be done, for the reason in the one
    sentence on stderr.
    """
    if sentence := missing():
        print(f"cable: {sentence}", file=sys.stderr)
        return 2
    try:
        code = _run(list(sys.argv[1:] if argv is None else argv))
        sys.stdout.flush()
        return code
    except BrokenPipeError:  # the reader of our output had enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return BROKEN_PIPE
    except KeyboardInterrupt:
        print("cable: interrupted", file=sys.stderr)
        return INTERRUPTED


def _run(arguments: list[str]) -> int:
    names = _command_names()
    # One command needs only its own file; the list of all of them needs them all.
    modules = {name: importlib.import_module(f"cable_ros.cli.{name}") for name in _wanted(arguments, names)}
    parser = _parser(modules)
    try:
        args = parser.parse_args(arguments)
    except SystemExit as stop:  # argparse has printed its help or its sentence
        return stop.code if isinstance(stop.code, int) else 2
    if args.command is None:
        parser.print_help()
        return 0
    compile_watch.COMPILING.tell = _tell_of_compiling
    Interpretation.tell = _tell
    try:
        return int(modules[args.command].run(args))
    except BrokenPipeError:
        raise
    except Exception as error:
        if not _is_for_the_user(error):
            raise
        print(f"cable {args.command}: {_sentence(error)}", file=sys.stderr)
        return 2


def _parser(modules: dict[str, Any]) -> Parser:
    parser = Parser(
        prog="cable",
        description="What an externally mounted cable does to its robot.",
        epilog="example:\n  cable solve config/space_arm.yaml --joint orientation=30deg\n\n"
        "'cable COMMAND -h' says more about one command.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action=_Version, nargs=0, help="show program's version number and exit")
    subparsers = parser.add_subparsers(title="commands", dest="command", metavar="COMMAND")
    for module in modules.values():
        module.add_parser(subparsers)
    return parser


def _command_names() -> list[str]:
    files = (module.name for module in pkgutil.iter_modules(cable_ros.cli.__path__))
    return [name for name in files if name != "main" and not name.startswith("_")]


def _wanted(arguments: list[str], names: list[str]) -> list[str]:
    return [arguments[0]] if arguments and arguments[0] in names else names


def _is_for_the_user(error: Exception) -> bool:
    """Whether the error's text is a sentence about the input, not a fault of the program.

    Those are the errors this package defines, what the operating system refuses, and other packages
    that are not installed or do not fit the others.
    """
    if isinstance(error, ImportError):
        return not (error.name or "").startswith("cable_ros")
    return isinstance(error, OSError) or type(error).__module__.startswith("cable_ros.")


def _tell_of_compiling() -> None:
    _tell("compiling the solver: once after an installation or an update, up to some minutes")


def _tell(sentence: str) -> None:
    print(f"cable: {sentence}", file=sys.stderr, flush=True)


def _sentence(error: Exception) -> str:
    if isinstance(error, ModuleNotFoundError):
        package = str(error.name).partition(".")[0]
        extra = EXTRAS.get(package)
        remedy = f"pip install 'cable_ros[{extra}]'" if extra else "install it"
        return f"the Python package '{package}' is missing; {remedy}"
    if isinstance(error, OSError) and error.filename is not None:
        return one_line(f"{error.filename}: {_REMEDIES.get(type(error), error.strerror)}")
    return one_line(" ".join(str(error).split()))


class _Version(argparse.Action):
    """Print the version, which takes long to look up, if it is asked for."""

    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> NoReturn:
        from importlib import metadata

        try:
            version = metadata.version("cable_ros")
        except metadata.PackageNotFoundError:
            version = "(not installed)"
        print(f"cable_ros {version}")
        parser.exit()


if __name__ == "__main__":
    sys.exit(main())
