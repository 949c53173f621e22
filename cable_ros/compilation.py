# SPDX-License-Identifier: Apache-2.0
"""Numba's `njit` with a cache that knows all that was compiled into a function, and that may be missing.

Numba keeps compiled code as long as the file that holds the function stays the same. But functions of other
files are inlined into it, and constants of other files frozen: after an update that changes one file and not
another, old code would go on silently, or end in an error where old and new meet. Here compiled code is kept
as long as the file and all files of this package that it imports, directly or not, stay the same.

Whoever uses it keeps to the arithmetic that is written, without `fastmath`. Each function's compiled code
brings its own copies of the functions that it calls, and those loaded first serve all: where an optimiser may
reorder sums, each copy does so in its own way, and the last bit of a result depends on what a process loaded
before, or has just compiled. As written, all copies agree, also with the interpreter (NUMBA_DISABLE_JIT=1).
"""

from __future__ import annotations

import contextlib
import hashlib
import re
import warnings
from collections.abc import Callable
from functools import cache as memoized
from pathlib import Path
from typing import Any

import numba

PACKAGE = Path(__file__).parent
LEAF: dict[str, Any] = {"cache": True, "error_model": "numpy", "_nrt": False}
"""Options of functions that make no arrays and return none, all that are called often and briefly.

Numba counts references to arrays: each one that a function takes, or takes a slice of, costs atomic
additions, altogether more than the arithmetic of a point or two. Such functions need no count: their caller's
holds. They call their like only.
"""
_NO_FOLDER = (
    "compiled code cannot be kept, since neither this package's folder nor the user's cache folder can be "
    "written: every start compiles for about half a minute; set NUMBA_CACHE_DIR to a folder that can be"
)
_IMPORT = re.compile(rf"^\s*from ({PACKAGE.name}[\w.]*) import (\([^)]*\)|[^\n]*)", re.MULTILINE)


def njit(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """`numba.njit(**options)`, used as `@njit(cache=True, ...)`.

    Where no folder can be written, code is compiled anew in each process, after one RuntimeWarning.
    """

    def decorate(function: Callable[..., Any]) -> Any:
        try:
            dispatcher = numba.njit(**options)(function)
        except RuntimeError:
            if not options.get("cache"):
                raise
            warnings.warn(_NO_FOLDER, RuntimeWarning, stacklevel=1)  # one place: shown once
            return numba.njit(**{**options, "cache": False})(function)
        # none without caching; with NUMBA_DISABLE_JIT the dispatcher is the function itself
        cache = getattr(dispatcher, "_cache", None)
        file = getattr(cache, "_cache_file", None)
        if cache is not None and file is not None:
            file._source_stamp = file._source_stamp, stamp(Path(function.__code__.co_filename))
            cache._cache_file = CompiledCode(file)
        return dispatcher

    return decorate


class CompiledCode:
    """Numba's index and data files of one function; what they cannot give is not there, and compiled anew."""

    def __init__(self, file: Any) -> None:
        self._file = file

    def load(self, key: Any) -> Any:
        """The data saved under the key by a process with the same sources; None without."""
        try:
            found = self._file.load(key)
        except Exception:  # cut short by a power failure: whatever unpickling makes of it
            return None
        # Of two processes that write at once, the index may be one's and the data the other's.
        mine = isinstance(found, tuple) and found[:2] == (self._file._source_stamp, key)
        return found[2] if mine else None

    def save(self, key: Any, data: Any) -> None:
        """Save the data, unless the disk is full or was made read-only."""
        labelled = self._file._source_stamp, key, data
        with contextlib.suppress(OSError):
            try:
                self._file.save(key, labelled)
            except OSError:
                raise
            except Exception:  # an index cut short
                self._file.flush()
                self._file.save(key, labelled)

    def flush(self) -> None:
        """Forget what was saved."""
        self._file.flush()


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
