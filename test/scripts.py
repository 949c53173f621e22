# SPDX-License-Identifier: Apache-2.0
"""Scripts of the repository that tests import: examples, benchmarks and that of the docs."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).parents[1]


def script(path: str) -> ModuleType:
    """The script at a path from the repository's root, newly run as a module."""
    file = ROOT / path
    spec = importlib.util.spec_from_file_location(f"{file.stem}_under_test", file)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # where dataclasses, and whoever reads its source, look for it
    spec.loader.exec_module(module)
    return module


def need_arm(example: ModuleType) -> None:
    """Skip the test where the arm of examples/dress_pack.py is not installed."""
    try:
        example.urdf()
    except FileNotFoundError as error:
        pytest.skip(str(error))
