# SPDX-License-Identifier: Apache-2.0
"""What Numba's compiler is spared is what it would have found again."""

from __future__ import annotations

import operator

import numpy as np
import pytest

from cable_ros import compilation
from cable_ros.numba_shortcuts import take_shortcuts

numba = pytest.importorskip("numba")


@pytest.fixture(autouse=True)
def shortcuts():
    take_shortcuts()


def test_flags_are_those_that_numba_reads_one_by_one():
    from numba.core.compiler import Flags

    flags = Flags()
    flags.nrt = True
    flags.error_model = "numpy"
    assert flags.values() == {name: getattr(flags, name) for name in Flags.options}
    other = flags.copy()
    assert other == flags
    assert hash(other) == hash(flags)
    other.nrt = False
    assert other != flags


def test_an_operator_is_looked_up_once_for_each_kind_of_operands():
    from numba import float64, int64
    from numba.core.registry import cpu_target

    context = cpu_target.typing_context
    context.refresh()
    product = context.resolve_value_type(operator.mul)
    once = product.get_call_type(context, (float64, int64), {})
    assert product.get_call_type(context, (float64, int64), {}) is once
    assert product.get_call_type(context, (int64, int64), {}).return_type == int64
    assert once.return_type == float64


def test_kernels_of_all_kinds_of_operands_are_what_python_makes_of_them():
    @compilation.njit()
    def mixed(a, i, x):
        low, high = min(i, 2), max(x, 0.5)
        return a[i] * i, a[-1] * x, i * i, i * x, i // 2, a[low] < high, len(a) * high

    a = np.array([0.5, 1.5, 2.5, 3.5])
    for arguments in ((a, 3, 0.25), (np.arange(4), 3, 0.25), (a, 0, 2.0), (a, 1, 2)):
        assert mixed(*arguments) == mixed.py_func(*arguments)
