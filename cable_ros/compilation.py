"""Numba's `njit` with a cache that knows all that was compiled into a function.

Numba keeps compiled code as long as the file that holds the function stays the same. But functions of other
files are inlined into it, and constants of other files frozen: after an update that changes one file and not
another, old code would go on silently, or end in an error where old and new meet. Here compiled code is kept
as long as the file and all files of this package that it imports, directly or not, stay the same.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable
from functools import cache as memoized
from pathlib import Path
from typing import Any

import numba

PACKAGE = Path(__file__).parent
_IMPORT = re.compile(rf"^\s*from ({PACKAGE.name}[\w.]*) import (\([^)]*\)|[^\n]*)", re.MULTILINE)


def njit(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """`numba.njit(**options)`, used as `@njit(cache=True, ...)`."""

    def decorate(function: Callable[..., Any]) -> Any:
        dispatcher = numba.njit(**options)(function)
        # none without caching; with NUMBA_DISABLE_JIT the dispatcher is the function itself
        file = getattr(getattr(dispatcher, "_cache", None), "_cache_file", None)
        if file is not None:
            file._source_stamp = file._source_stamp, stamp(Path(function.__code__.co_filename))
        return dispatcher

    return decorate


def stamp(path: Path) -> str:
    """Hash of the file's text and of all of this package's files that it imports."""
    digest = hashlib.sha256()
    for file in sorted(sources(path)):
        digest.update(file.read_bytes())
    return digest.hexdigest()


def sources(path: Path, package: Path = PACKAGE) -> set[Path]:
    """The file and, through any number of imports, the package's files that it imports."""
    found: set[Path] = set()
    waiting = [path]
    while waiting:
        file = waiting.pop()
        if file not in found and file.exists():
            found.add(file)
            waiting += _imported(file, package)
    return found


@memoized
def _imported(path: Path, package: Path) -> tuple[Path, ...]:
    """The modules that the file imports by `from package... import ...`; some may not exist."""
    out = []
    for module, names in _IMPORT.findall(path.read_text(encoding="utf-8")):
        place = package.parent.joinpath(*module.split("."))
        out += [place.with_suffix(".py"), place / "__init__.py"]
        out += [place / f"{name}.py" for name in re.findall(r"\w+", names)]
    return tuple(out)
