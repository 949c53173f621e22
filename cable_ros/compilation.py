# SPDX-License-Identifier: Apache-2.0
"""`njit`: functions compiled by Numba at their first call, and kept as long as their sources stay the same.

Numba keeps compiled code as long as the file that holds the function stays the same. But functions of other
files are inlined into it, and constants of other files frozen: after an update that changes one file and not
another, old code would go on silently, or end in an error where old and new meet. Here compiled code is kept
as long as the file and all files of this package that it imports, directly or not, stay the same.

Numba copies into a function all that it calls, and optimises and keeps the copies again. Here that is left
to short `LEAF` functions. All others are compiled once and called; kept code names those that it calls,
which are loaded before it. Nor does an argument that is a literal get code of its own. `kernel_compiler` has
all that needs Numba; a process whose code is kept gets on without it (`kept_code`).

Whoever uses it keeps to the arithmetic that is written, without `fastmath`. Each function's compiled code
brings its own copies of the functions that it calls, and those loaded first serve all: where an optimiser may
reorder sums, each copy does so in its own way, and the last bit of a result depends on what a process loaded
before, or has just compiled. As written, all copies agree, and but for the last bit of a power or a sine the
interpreter with them (`interpretation`, NUMBA_DISABLE_JIT=1).
"""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Callable
from functools import cache as memoized
from functools import cached_property, update_wrapper
from pathlib import Path
from typing import Any

import numpy as np

from cable_ros.common.compile_watch import GETTING
from cable_ros.interpretation import instead
from cable_ros.kept_code import load

PACKAGE = Path(__file__).parent
INNER: dict[str, Any] = {"cache": True, "error_model": "numpy", "no_cpython_wrapper": True}
"""Options of functions that only compiled functions call: they have no entry for Python, whose conversion of
the arguments is often more code than the function."""
LEAF_ENTRY: dict[str, Any] = {"cache": True, "error_model": "numpy", "_nrt": False}
"""Options of `LEAF` functions that Python calls as well."""
LEAF: dict[str, Any] = LEAF_ENTRY | INNER
"""Options of functions that make no arrays and return none, all that are called often and briefly: the short
ones are copied into their callers, the others called.

Numba counts references to arrays: each one that a function takes, or takes a slice of, costs atomic
additions, altogether more than the arithmetic of a point or two. Such functions need no count: their caller's
holds. They call their like only.
"""
_IMPORT = re.compile(rf"^\s*from ({PACKAGE.name}[\w.]*) import (\([^)]*\)|[^\n]*)", re.MULTILINE)


def njit(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """`numba.njit(**options)`, used as `@njit(cache=True, ...)`.

    Where no folder can be written, code is compiled anew in each process, after one RuntimeWarning.
    """
    if os.environ.get("NUMBA_DISABLE_JIT", "0") not in ("", "0"):
        return lambda function: function
    return lambda function: Kernel(function, options)


class Kernel:
    """A function that is compiled, or taken from where it is kept, at its first call.

    Its code is for arguments of the types that it was first called with. Calls with others are left to
    Numba's dispatcher, which compiles for them as well.
    """

    def __init__(self, function: Callable[..., Any], options: dict[str, Any]) -> None:
        update_wrapper(self, function)
        self.py_func, self.options = function, options
        self.forget_entry()

    def __call__(self, *arguments: Any) -> Any:
        try:
            return self._entry(*arguments)
        except np.linalg.LinAlgError:  # raised by the function itself, which has changed its arguments
            raise
        except (TypeError, ValueError):  # of other types, or another number of them: the dispatcher knows
            if self._interpreted:
                raise
            return self.dispatcher(*arguments)

    def __getattr__(self, name: str) -> Any:
        """What is not known here Numba's dispatcher knows."""
        if name.startswith("__"):
            raise AttributeError(name)
        return getattr(self.dispatcher, name)

    @cached_property
    def dispatcher(self) -> Any:
        """Numba's; it compiles this function, and looks at the types of arguments."""
        with GETTING.span():
            from cable_ros.kernel_compiler import dispatcher_of

            return dispatcher_of(self)

    @cached_property
    def stamp(self) -> str:
        """Of the sources."""
        return stamp(Path(self.py_func.__code__.co_filename))

    def forget_entry(self) -> None:
        """Look for the code again at the next call."""
        self._entry: Callable[..., Any] = self._enter_first
        self._interpreted = False

    def _enter_first(self, *arguments: Any) -> Any:
        if self.options.get("cache") and "dispatcher" not in vars(self):
            found = load(self.py_func, self.stamp)
            if found is None:
                found = instead(self)
                self._interpreted = found is not None
            if found is not None:
                self._entry = found
                return found(*arguments)
        out = self.dispatcher(*arguments)
        if not self.options.get("no_cpython_wrapper"):
            self._entry = next(iter(self.dispatcher.overloads.values())).entry_point
        return out


@memoized
def stamp(path: Path) -> str:
    """Hash of the file's text and of all of this package's files that it imports."""
    digest = hashlib.sha256()
    for file in sorted(sources(path)):
        digest.update(_digest(file))
    return digest.hexdigest()


@memoized
def _digest(file: Path) -> bytes:
    return hashlib.sha256(file.read_bytes()).digest()


def sources(path: Path, package: Path = PACKAGE) -> set[Path]:
    """The file and, through any number of imports, the package's files that it imports."""
    found: set[Path] = set()
    waiting = [path]
    while waiting:
        file = waiting.pop()
        if file not in found:
            found.add(file)
            waiting += _imported(file, package)
    return found


@memoized
def _imported(path: Path, package: Path) -> tuple[Path, ...]:
    """The modules that the file imports by `from package... import ...`."""
    out = []
    for module, names in _IMPORT.findall(path.read_text(encoding="utf-8")):
        place = package.parent.joinpath(*module.split("."))
        out += [place.with_suffix(".py"), place / "__init__.py"]
        out += [place / f"{name}.py" for name in re.findall(r"\w+", names)]
    return tuple(one for one in out if one.exists())
