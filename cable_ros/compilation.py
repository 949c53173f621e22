# SPDX-License-Identifier: Apache-2.0
"""Numba's `njit` with a cache that knows all that was compiled into a function, and that may be missing.

Numba keeps compiled code as long as the file that holds the function stays the same. But functions of other
files are inlined into it, and constants of other files frozen: after an update that changes one file and not
another, old code would go on silently, or end in an error where old and new meet. Here compiled code is kept
as long as the file and all files of this package that it imports, directly or not, stay the same.

Numba copies into a function all that it calls, and optimises and keeps the copies again. Here that is left
to `LEAF` functions. All others are compiled once and called; kept code names those that it calls, which are
loaded before it. Nor does an argument that is a literal get code of its own.

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
from importlib import import_module
from inspect import signature
from pathlib import Path
from typing import Any, NamedTuple

import llvmlite.binding as llvm
import numba
from numba.core.types.misc import unliteral

PACKAGE = Path(__file__).parent
INNER: dict[str, Any] = {"cache": True, "error_model": "numpy", "no_cpython_wrapper": True}
"""Options of functions that only compiled functions call: they have no entry for Python, whose conversion of
the arguments is often more code than the function."""
LEAF_ENTRY: dict[str, Any] = {"cache": True, "error_model": "numpy", "_nrt": False}
"""Options of `LEAF` functions that Python calls as well."""
LEAF: dict[str, Any] = LEAF_ENTRY | INNER
"""Options of functions that make no arrays and return none, all that are called often and briefly: they are
copied into their callers.

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
    options["no_cfunc_wrapper"] = True  # nobody calls through a C function pointer
    copied = not options.get("_nrt", True)

    def decorate(function: Callable[..., Any]) -> Any:
        try:
            dispatcher = numba.njit(**options)(function)
        except RuntimeError:
            if not options.get("cache"):
                raise
            warnings.warn(_NO_FOLDER, RuntimeWarning, stacklevel=1)  # one place: shown once
            dispatcher = numba.njit(**{**options, "cache": False})(function)
        if dispatcher is function:  # NUMBA_DISABLE_JIT
            return function
        _take_literals_as_others(dispatcher)
        if options.get("no_cpython_wrapper"):
            _enter_through_another(dispatcher)
        _link(dispatcher, copied)
        cache = getattr(dispatcher, "_cache", None)  # none without caching
        file = getattr(cache, "_cache_file", None)
        if cache is not None and file is not None:
            file._source_stamp = file._source_stamp, stamp(Path(function.__code__.co_filename))
            cache._cache_file = CompiledCode(file)
        return dispatcher

    return decorate


class Callee(NamedTuple):
    """A compiled function that others call, not copy."""

    module: str
    name: str
    arguments: tuple[Any, ...]
    """Their types."""


_CALLEES: dict[str, Callee] = {}
"""By their symbols, those whose code is in this process."""
_CALLS: dict[str, dict[str, Callee]] = {}
"""What the code of a symbol calls."""


def _take_literals_as_others(dispatcher: Any) -> None:
    """An int is an int: `f(x, 3)` and `f(x, n)` call the same code."""
    inherited = dispatcher.get_call_template

    def get_call_template(arguments: Any, keywords: Any) -> Any:
        plain = {name: unliteral(one) for name, one in keywords.items()}
        return inherited(tuple(unliteral(one) for one in arguments), plain)

    dispatcher.get_call_template = get_call_template


def _enter_through_another(dispatcher: Any) -> None:
    """Calls from Python, as in tests, go through a function compiled for that in each process."""

    @memoized
    def entry() -> Any:
        names = ", ".join(signature(dispatcher.py_func).parameters)
        return numba.njit(eval(f"lambda {names}: inner({names})", {"inner": dispatcher}))

    def add_overload(compiled: Any) -> None:
        # Compiled callers look here; the inherited method would show it to Python as well.
        dispatcher.overloads[tuple(compiled.signature.args)] = compiled

    def compile_for_python(*arguments: Any) -> Any:
        types = tuple(dispatcher.typeof_pyval(one) for one in arguments)
        compiled = entry().compile(types)
        dispatcher._insert([one._code for one in types], compiled, False)
        return compiled

    dispatcher.add_overload, dispatcher._compile_for_args = add_overload, compile_for_python


def _link(dispatcher: Any, copied: bool) -> None:
    """Note what new code calls; unless it is `copied`, give its callers nothing but its name."""
    inherited = dispatcher.add_overload

    def add_overload(compiled: Any) -> None:
        library, symbol = compiled.library, compiled.fndesc.llvm_func_name
        declared = [one.name for one in library._final_module.functions if one.is_declaration]
        _CALLS[symbol] = {name: _CALLEES[name] for name in declared if name in _CALLEES}
        if not copied:
            function = dispatcher.py_func
            arguments = tuple(compiled.signature.args)
            _CALLEES[symbol] = Callee(function.__module__, function.__name__, arguments)
            inner = dispatcher.targetoptions.get("no_cpython_wrapper", False)
            entry = "" if inner else compiled.fndesc.llvm_cpython_wrapper_name
            library._shared_module = _names_only(library, entry)
        inherited(compiled)

    dispatcher.add_overload = add_overload


def _names_only(library: Any, entry: str) -> Any:
    """A module for callers to link, without code; Numba looks in it for the `entry` from Python, if any."""
    module = str(library.codegen._create_empty_module(library.name))
    if entry:
        module += f'\ndefine available_externally void @"{entry}"() {{ ret void }}'
    return llvm.parse_assembly(module)


def _is_here(symbol: str, callee: Callee) -> bool:
    """Get the callee's code, and say whether it is the one with this symbol."""
    if symbol not in _CALLEES:
        getattr(import_module(callee.module), callee.name).compile(callee.arguments)
    return symbol in _CALLEES


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
        if not isinstance(found, tuple) or found[:2] != (self._file._source_stamp, key):
            return None
        *_, data, calls = found
        # A symbol has a number that the process gave that compiled it: a callee compiled again has another.
        return data if all(_is_here(*call) for call in calls.items()) else None

    def save(self, key: Any, data: Any) -> None:
        """Save the data, unless the disk is full or was made read-only."""
        calls = _CALLS.get(data[1].llvm_func_name, {})
        labelled = self._file._source_stamp, key, data, calls
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


@memoized
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
