# SPDX-License-Identifier: Apache-2.0
"""Compiled code that is kept, and used again without Numba.

To import Numba and its types takes most of a warm start and half of a node's memory; to run what it has
compiled takes LLVM's linker, Numba's runtime and nothing else. So the object code of each kernel is kept in
a file of its own beside Numba's files. It is taken if all that it came of is still the same: the sources,
Python, NumPy, Numba, LLVM, the processor, Numba's settings. Otherwise, or if anything here fails, Numba does
the work (`kernel_compiler`), which is what it did before.
"""

from __future__ import annotations

import contextlib
import ctypes
import hashlib
import os
import pickle
import platform
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from functools import cache as memoized
from importlib import import_module, machinery, util
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cable_ros.common.compile_watch import GETTING

FORMAT = 1
"""Of `Kept`; to be raised whenever its meaning changes."""
NDARRAY = "cable_ros_ndarray"
"""Symbol of NumPy's array type in compiled code."""
_LOCK = threading.RLock()
_LINKED: set[str] = set()
"""Symbols of the kernels whose code is linked in this process."""


class Callee(NamedTuple):
    """A kernel that another one calls."""

    module: str
    name: str
    symbol: str


class Kept(NamedTuple):
    """The code of one kernel."""

    stamp: str
    """Of its sources."""
    made_by: str
    """`maker` of the process that compiled it."""
    arguments: str
    """Their types."""
    symbol: str
    """Of the kernel itself, for kernels that call it."""
    entry: str
    """Symbol of its entry from Python; empty without."""
    code: bytes
    """Object file of the machine."""
    environments: tuple[tuple[str, list[Any]], ...]
    """Symbol and constants of each of Numba's environments in it; the first is the entry's."""
    callees: tuple[Callee, ...]


@memoized
def maker() -> str:
    """What compiled code depends on beside its sources."""
    import llvmlite
    import llvmlite.binding as llvm

    settings = sorted(
        one for one in os.environ.items() if one[0].startswith("NUMBA_") and "CACHE" not in one[0]
    )
    features = llvm.get_host_cpu_features().flatten()
    versions = [sys.version, np.__version__, llvmlite.__version__, _numba("_version.py").read_text()]
    return repr((FORMAT, versions, platform.machine(), llvm.get_host_cpu_name(), features, settings))


def folders(file: Path) -> Iterator[Path]:
    """Where code of this source file may be kept, the best first: where Numba keeps it, too."""
    if chosen := os.environ.get("NUMBA_CACHE_DIR"):
        yield Path(chosen)
        return
    yield file.parent / "__pycache__"
    with contextlib.suppress(RuntimeError):  # a user without a home
        yield Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "numba"


def can_keep() -> bool:
    """Whether code that is compiled now will be there for another process."""
    for folder in folders(Path(__file__)):
        with contextlib.suppress(OSError):
            folder.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=folder):
                return True
    return False


def _name(kernel: Callable[..., Any]) -> str:
    """Of the file with this kernel's code: its own even where many packages share the folder."""
    source = _place(kernel.__code__.co_filename)
    return f"{kernel.__module__}.{kernel.__qualname__}-{source}.{sys.implementation.cache_tag}.code"


@memoized
def _place(file: str) -> str:
    """Short for where the file is, however that is written: colcon links to sources, users to workspaces."""
    return hashlib.sha256(os.path.realpath(file).encode()).hexdigest()[:12]


def save(kernel: Callable[..., Any], kept: Kept) -> None:
    """Keep a kernel's code, unless no disk takes it, behind that for other types of arguments."""
    for folder in folders(Path(kernel.__code__.co_filename)):
        all_ = {one.arguments: one for one in _read(folder / _name(kernel)) if one[:2] == kept[:2]}
        if all_.get(kept.arguments) == kept:
            return
        all_[kept.arguments] = kept
        with contextlib.suppress(OSError):
            folder.mkdir(parents=True, exist_ok=True)
            with tempfile.NamedTemporaryFile(dir=folder, delete=False) as file:
                try:
                    pickle.dump([tuple(one) for one in all_.values()], file)
                    file.close()
                    os.replace(file.name, folder / _name(kernel))
                except BaseException:
                    os.unlink(file.name)
                    raise
            return


def find(kernel: Callable[..., Any], stamp: str, symbol: str = "") -> Kept | None:
    """What is kept of a kernel, with this symbol if any, if it is of these sources and of this machine."""
    for folder in folders(Path(kernel.__code__.co_filename)):
        for found in _read(folder / _name(kernel)):
            if found[:2] == (stamp, maker()) and symbol in ("", found.symbol):
                return found
    return None


def _read(file: Path) -> list[Kept]:
    try:
        return [Kept(*one) for one in pickle.loads(file.read_bytes())]
    except Exception:  # not there, or cut short by a power failure: whatever unpickling makes of it
        return []


def load(kernel: Callable[..., Any], stamp: str) -> Callable[..., Any] | None:
    """The kernel's entry from Python, of code that is kept; None without.

    Args:
        kernel: the Python function.
        stamp: of its sources.
    """
    with _LOCK, GETTING.span():
        try:
            kept = find(kernel, stamp)
            if kept is None or not kept.entry or not _link(kept):
                return None
            return _entry(kernel, kept)
        except Exception:  # another Numba or LLVM than those that this was written for
            return None


def _link(kept: Kept) -> bool:
    """Link a kernel's code and all that it calls; say whether all of that is there."""
    if kept.symbol in _LINKED:
        return True
    for callee in kept.callees:
        if callee.symbol in _LINKED:
            continue
        kernel = getattr(import_module(callee.module), callee.name)
        # A symbol has a number that the process gave that compiled it: compiled again, it has another.
        found = find(kernel.py_func, kernel.stamp, callee.symbol)
        if found is None or not _link(found):
            return False
    linker = _linker()
    linker.engine.add_object_file(linker.llvm.ObjectFileRef.from_data(kept.code))
    linker.engine.finalize_object()
    for symbol, constants in kept.environments:
        environment = linker.make_environment({"__name__": __name__})
        environment.consts[:] = constants
        linker.environments[symbol] = environment
        address = linker.engine.get_global_value_address(symbol)
        ctypes.c_void_p.from_address(address).value = id(environment)
    _LINKED.add(kept.symbol)
    return True


def _entry(kernel: Callable[..., Any], kept: Kept) -> Callable[..., Any]:
    linker = _linker()
    address = linker.engine.get_function_address(kept.entry)
    environment = linker.environments[kept.environments[0][0]]
    module, name = import_module(kernel.__module__), kernel.__name__
    made: Callable[..., Any] = linker.make_function(
        module, name, kernel.__doc__ or "", address, environment, (linker,)
    )
    return made


class _Linker:
    """LLVM's linker with the symbols that Numba's code calls, and makers of Numba's objects."""

    def __init__(self) -> None:
        import llvmlite.binding as llvm

        self.llvm = llvm
        self.environments: dict[str, Any] = {}
        """By symbol; compiled code points to them."""
        with contextlib.suppress(RuntimeError):  # newer ones do it themselves and forbid it
            llvm.initialize()
        llvm.initialize_native_target()
        llvm.initialize_native_asmprinter()
        helpers, functions = _extension("_helperlib"), _extension("_dynfunc")
        runtime = _extension("core.runtime._nrt_python")
        for name, address in {**helpers.c_helpers, **functions.c_helpers}.items():
            llvm.add_symbol(f"numba_{name}", address)
        for name, address in runtime.c_helpers.items():
            llvm.add_symbol(name if name.startswith("_") else f"NRT_{name}", address)
        add_symbols(llvm)
        self.make_environment, self.make_function = functions.Environment, functions.make_function
        target = llvm.Target.from_triple(llvm.get_process_triple()).create_target_machine(jit=True)
        self.engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), target)


_linker = memoized(_Linker)


def add_symbols(llvm: Any) -> None:
    """Tell LLVM where objects of Python and NumPy are that our code names."""
    llvm.add_symbol("_Py_NoneStruct", id(None))
    llvm.add_symbol(NDARRAY, id(np.ndarray))
    for one in (TypeError, ValueError, RuntimeError, SystemError, StopIteration, OverflowError, MemoryError):
        llvm.add_symbol(f"PyExc_{one.__name__}", id(one))


def _extension(name: str) -> Any:
    """One of Numba's extension modules, without importing Numba; it is the same if Numba follows."""
    full = f"numba.{name}"
    if full in sys.modules:
        return sys.modules[full]
    stem = _numba(*name.split("."))
    file = next(
        one for suffix in machinery.EXTENSION_SUFFIXES if (one := stem.with_name(stem.name + suffix)).exists()
    )
    spec = util.spec_from_file_location(full, file)
    assert spec is not None
    assert spec.loader is not None
    module = util.module_from_spec(spec)
    sys.modules[full] = module
    spec.loader.exec_module(module)
    return module


def _numba(*parts: str) -> Path:
    """A file of Numba."""
    spec = util.find_spec("numba")
    assert spec is not None
    return Path(str(spec.origin)).parent.joinpath(*parts)
