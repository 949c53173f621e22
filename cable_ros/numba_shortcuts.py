# SPDX-License-Identifier: Apache-2.0
"""Numba's compiler without work that it repeats with the same outcome.

`kernel_compiler` takes these shortcuts. What is compiled stays the same. Where a version of Numba has no such
place, the shortcut is not taken.
"""

from __future__ import annotations

import contextlib
from functools import cache as memoized
from typing import Any

from numba.core import types
from numba.core.targetconfig import TargetConfig


@memoized
def take_shortcuts() -> None:
    """From now on, in this process."""
    for shortcut in (_remember_operators, _list_flags_at_once):
        with contextlib.suppress(AttributeError):
            shortcut()


def _remember_operators() -> None:
    """Find the type of `a * b` or `a[i]` once for the types of its operands.

    Numba tries every overload of an operator anew at each of its uses. An outcome that is itself an overload,
    which depends on the options of the caller, is not remembered.
    """
    known: dict[Any, Any] = {}
    functions: Any = types.Function
    search = functions.get_call_type

    def get_call_type(self: Any, context: Any, arguments: Any, keywords: Any) -> Any:
        key = self, tuple(arguments)
        found = known.get(key)
        if found is None or keywords:
            found = search(self, context, arguments, keywords)
            if not keywords and self.get_impl_key(found) is self.typing_key:
                known[key] = found
        return found

    functions.get_call_type = get_call_type


def _list_flags_at_once() -> None:
    """List a compilation's flags by one copy; they are compared wherever an overload is looked up."""
    flags: Any = TargetConfig

    defaults: dict[Any, dict[str, Any]] = {}

    def values(self: Any) -> dict[str, Any]:
        kind = type(self)
        if kind not in defaults:
            defaults[kind] = {name: option.default for name, option in kind.options.items()}
        return {**defaults[kind], **self._values}

    flags.values = values
