# SPDX-License-Identifier: Apache-2.0
"""Numba's part of `compilation`: imported only by a process that compiles.

A kernel's entry from Python looks at what it is given itself: Numba's takes any array with elements of the
right size, as Numba's dispatcher, which looks up the types of all arguments at every call, stands before it.
Without the dispatcher a call is quicker, and needs no Numba.
"""

from __future__ import annotations

import contextlib
import sys
import warnings
from collections.abc import Iterator
from functools import cache as memoized
from functools import reduce
from importlib import import_module
from inspect import signature
from pathlib import Path
from typing import Any, NamedTuple

import llvmlite.binding as llvm
import numba
import numpy as np
from llvmlite import ir
from numba.core import boxing, cgutils, pythonapi, types
from numba.core.compiler_lock import global_compiler_lock
from numba.core.types.misc import unliteral
from numba.extending import NativeValue, typeof_impl
from numba.np.numpy_support import as_dtype

from cable_ros.common.alone import alone
from cable_ros.common.compile_watch import listen
from cable_ros.kept_code import NDARRAY, Kept, add_symbols, maker, save
from cable_ros.kept_code import Callee as KeptCallee
from cable_ros.numba_shortcuts import take_shortcuts

_NO_FOLDER = (
    "compiled code cannot be kept, since neither this package's folder nor the user's cache folder can be "
    "written: every start compiles for about half a minute; set NUMBA_CACHE_DIR to a folder that can be"
)
MOST_COPIED = 150
"""Most instructions of a leaf that is copied into its callers."""
listen()
take_shortcuts()
add_symbols(llvm)


def dispatcher_of(kernel: Any) -> Any:
    """Numba's dispatcher for the `compilation.Kernel`, which keeps what it compiles."""
    kind: Any = type(kernel)
    _let_kernels_call(kind)
    function = kernel.py_func
    options = kernel.options | {"no_cfunc_wrapper": True}  # nobody calls through a C function pointer
    leaf = not options.get("_nrt", True)
    try:
        dispatcher = numba.njit(**options)(function)
    except RuntimeError:
        if not options.get("cache"):
            raise
        _tell_of_no_folder()
        dispatcher = numba.njit(**{**options, "cache": False})(function)
    _take_literals_as_others(dispatcher)
    if options.get("no_cpython_wrapper"):
        _enter_through_another(dispatcher)
    else:
        _enter_with_care(dispatcher)
    _link(dispatcher, leaf)
    cache = getattr(dispatcher, "_cache", None)  # none without caching
    file = getattr(cache, "_cache_file", None)
    if cache is not None and file is not None:
        file._source_stamp = file._source_stamp, kernel.stamp
        cache._cache_file = CompiledCode(file, kernel)
        _compile_alone(dispatcher, kernel, Path(cache.cache_path, "cable_ros.lock"))
    return dispatcher


@memoized
def _let_kernels_call(kind: Any) -> None:
    """Tell Numba what a kernel of this class is to a kernel that names it."""

    @typeof_impl.register(kind)
    def type_of_kernel(kernel: Any, _: Any) -> Any:
        return types.Dispatcher(kernel.dispatcher)


@memoized
def _tell_of_no_folder() -> None:
    warnings.warn(_NO_FOLDER, RuntimeWarning, stacklevel=1)


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


def _compile_alone(dispatcher: Any, kernel: Any, lock: Path) -> None:
    """Of processes that need the same code one compiles it, and the others take what that has kept.

    Each gives another symbol to what it compiles: of code of both, callers would not find their callees. Nor
    do they wait for each other in a circle, as kernels do not call each other in one.
    """
    inherited = dispatcher.compile

    def compile_alone(arguments: Any) -> Any:
        # The compiler first: of two threads, the one that has it must not wait for what the other has locked.
        with global_compiler_lock, alone(lock, f"{kernel.__module__}.{kernel.__qualname__}"):
            return inherited(arguments)

    dispatcher.compile = compile_alone


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


def _enter_with_care(dispatcher: Any) -> None:
    """The function's entry from Python refuses arguments of other types than its own."""
    compiler = dispatcher._compiler
    inherited = compiler.compile

    def compile_with_care(arguments: Any, return_type: Any) -> Any:
        with _our_conversions():  # one thread at a time compiles
            return inherited(arguments, return_type)

    compiler.compile = compile_with_care


@contextlib.contextmanager
def _our_conversions() -> Iterator[None]:
    """Entries that Numba makes meanwhile convert arguments and results as below."""
    unboxers, boxers = pythonapi._unboxers.functions, pythonapi._boxers.functions
    before = {**unboxers}, {**boxers}
    unboxers |= {types.Array: _array_from_python, types.Integer: _integer_from_python}
    boxers |= {types.Array: _array_to_python}
    try:
        yield
    finally:
        unboxers |= before[0]
        boxers |= before[1]


_POINTER = np.intp().itemsize
_HEAD = object.__basicsize__
"""Bytes of every Python object before its own."""
_FOREIGN = ">" if sys.byteorder == "little" else "<"
_C_ORDER, _F_ORDER, _WRITEABLE = 0x1, 0x2, 0x400
"""Flags of an array, of NumPy's C interface."""


def _array_from_python(typ: Any, given: Any, c: Any) -> NativeValue:
    """Numba's, which takes any array whose elements have the size, for arrays of this type alone.

    All arguments of a type are converted by one function, where Numba repeats its code for each.
    """
    build = c.builder
    name = f"from_python.{typ}"
    place = cgutils.alloca_once(build, c.context.get_value_type(typ))
    known = build.module.globals.get(name) or _conversion(typ, name, place.type, c)
    failed = build.call(known, [given, place])
    return NativeValue(build.load(place), is_error=failed)


def _conversion(typ: Any, name: str, pointer: Any, c: Any) -> Any:
    """A function that puts what Python gives into an array of the type, and says whether that failed."""
    kind = ir.FunctionType(ir.IntType(1), [c.pyapi.pyobj, pointer])
    out = ir.Function(c.builder.module, kind, name=name)
    out.linkage = "internal"
    out.attributes.add("noinline")
    build = ir.IRBuilder(out.append_basic_block())
    inside = c._replace(builder=build, pyapi=c.context.get_python_api(build))
    given, place = out.args
    native = boxing.unbox_array(typ, _if_of_type(typ, given, inside), inside)
    build.store(native.value, place)
    build.ret(native.is_error)
    return out


def _if_of_type(typ: Any, given: Any, c: Any) -> Any:
    """What Python gives, if it is an array of the type, and None, which is none, otherwise."""
    build, none = c.builder, c.pyapi.borrow_none()
    one = build.select(cgutils.is_null(build, given), none, given)
    fits = cgutils.alloca_once_value(build, cgutils.false_bit)
    byte, number = ir.IntType(8), ir.IntType(32)

    def field(of: Any, offset: int, kind: Any) -> Any:
        place = build.gep(of, [ir.Constant(ir.IntType(64), offset)])
        return build.load(build.bitcast(place, kind.as_pointer()))

    is_array = build.icmp_unsigned("==", field(one, _POINTER, c.pyapi.pyobj), _ndarray(c))
    with build.if_then(is_array, likely=True):
        kind = field(one, _HEAD + 5 * _POINTER, c.pyapi.pyobj)  # its dtype
        wanted = {"C": _C_ORDER, "F": _F_ORDER, "A": 0}[typ.layout]
        wanted |= _WRITEABLE if typ.mutable else 0
        flags = build.and_(field(one, _HEAD + 6 * _POINTER, number), ir.Constant(number, wanted))
        order = field(kind, _HEAD + _POINTER + 2, byte)
        tests = [
            build.icmp_unsigned("==", field(one, _HEAD + _POINTER, number), ir.Constant(number, typ.ndim)),
            build.icmp_unsigned(
                "==", field(kind, _HEAD + _POINTER, byte), ir.Constant(byte, ord(as_dtype(typ.dtype).kind))
            ),
            build.icmp_unsigned("!=", order, ir.Constant(byte, ord(_FOREIGN))),
            build.icmp_unsigned("==", flags, ir.Constant(number, wanted)),
        ]
        build.store(reduce(build.and_, tests), fits)
    return build.select(build.load(fits), one, none)


def _integer_from_python(typ: Any, given: Any, c: Any) -> NativeValue:
    """Numba's, which takes 2.7 for 2, for integers alone."""
    object_ = c.pyapi.pyobj
    index = cgutils.get_or_insert_function(
        c.builder.module, ir.FunctionType(object_, [object_]), "PyNumber_Index"
    )
    whole = c.builder.call(index, [given])
    out = boxing.unbox_integer(typ, whole, c)
    c.pyapi.decref(whole)
    return out


def _array_to_python(typ: Any, value: Any, c: Any) -> Any:
    """As Numba's, which gets NumPy's array type by unpickling it."""
    object_, number = c.pyapi.pyobj, ir.IntType(32)
    takes = [c.pyapi.voidptr, object_, number, number, object_]
    make = cgutils.get_or_insert_function(
        c.builder.module, ir.FunctionType(object_, takes), "NRT_adapt_ndarray_to_python_acqref"
    )
    dtype = c.env_manager.read_const(c.env_manager.add_const(as_dtype(typ.dtype)))
    place = c.builder.bitcast(cgutils.alloca_once_value(c.builder, value), c.pyapi.voidptr)
    shape = ir.Constant(number, typ.ndim), ir.Constant(number, int(typ.mutable))
    out = c.builder.call(make, [place, _ndarray(c), *shape, dtype])
    c.context.nrt.decref(c.builder, typ, value)
    return out


def _ndarray(c: Any) -> Any:
    """NumPy's array type."""
    known = c.builder.module.globals
    if NDARRAY not in known:
        ir.GlobalVariable(c.builder.module, ir.IntType(8), NDARRAY)
    return known[NDARRAY]


def _link(dispatcher: Any, leaf: bool) -> None:
    """Note what new code calls; unless it is a short leaf, give its callers nothing but its name."""
    inherited = dispatcher.add_overload

    def add_overload(compiled: Any) -> None:
        library, symbol = compiled.library, compiled.fndesc.llvm_func_name
        declared = [one.name for one in library._final_module.functions if one.is_declaration]
        _CALLS[symbol] = {name: _CALLEES[name] for name in declared if name in _CALLEES}
        if not (leaf and _is_short(library, symbol)):
            function = dispatcher.py_func
            arguments = tuple(compiled.signature.args)
            _CALLEES[symbol] = Callee(function.__module__, function.__name__, arguments)
            inner = dispatcher.targetoptions.get("no_cpython_wrapper", False)
            entry = "" if inner else compiled.fndesc.llvm_cpython_wrapper_name
            library._shared_module = _names_only(library, entry)
        inherited(compiled)

    dispatcher.add_overload = add_overload


def _is_short(library: Any, symbol: str) -> bool:
    """Whether callers shall copy the function, as they did if it was kept."""
    module = library._shared_module or library._final_module  # the former if it was kept
    try:
        function = module.get_function(symbol)
    except NameError:
        return False
    return sum(1 for block in function.blocks for _ in block.instructions) <= MOST_COPIED


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

    def __init__(self, file: Any, kernel: Any) -> None:
        self._file, self._kernel = file, kernel

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
        if not all(_is_here(*call) for call in calls.items()):
            return None
        self._keep(data, calls, compiled=False)
        return data

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
        self._keep(data, calls, compiled=True)

    def flush(self) -> None:
        """Forget what was saved."""
        self._file.flush()

    def _keep(self, data: Any, calls: dict[str, Callee], compiled: bool) -> None:
        """Keep the code for processes without Numba, too."""
        (_, kind, code), described, environment, signed, *_, repeated, environments = data
        inner = self._kernel.options.get("no_cpython_wrapper", False)
        # What nobody calls by its name is not needed. Of code just loaded that is not known yet: an older
        # version's may be kept in its place, after an update that was taken back.
        copied = compiled and inner and described.llvm_func_name not in _CALLEES
        if kind != "object" or repeated or copied:
            return
        known = {one.env_name: list(one.consts) for one in (environment, *environments)}
        kept = Kept(
            stamp=self._kernel.stamp,
            made_by=maker(),
            arguments=str(signed.args),
            symbol=described.llvm_func_name,
            entry="" if inner else described.llvm_cpython_wrapper_name,
            code=code[0],
            environments=tuple(known.items()),
            callees=tuple(KeptCallee(one.module, one.name, symbol) for symbol, one in calls.items()),
        )
        save(self._kernel.py_func, kept)
