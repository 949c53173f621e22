"""Compiled code is kept while its sources stay the same, and no longer."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from cable_ros import compilation
from cable_ros.compilation import PACKAGE, sources

MODULES = {
    "inner.py": """
        from somewhere.compilation import njit
        FACTOR = 2.0
        @njit(cache=True)
        def inner(x):
            return FACTOR * x
    """,
    "outer.py": """
        from somewhere.compilation import njit
        from somewhere.inner import (
            inner,
        )
        @njit(cache=True)
        def outer(x):
            return inner(x) + 1.0
    """,
    "beside.py": "VALUE = 1\n",
}
CALL = """
from somewhere.outer import outer
print(outer(10.0), sum(outer.stats.cache_hits.values()), sum(outer.stats.cache_misses.values()))
"""


@pytest.fixture
def package(tmp_path):
    """A package of two compiled files, one calling the other's function, with this package's `njit`."""
    folder = tmp_path / "somewhere"
    folder.mkdir()
    (folder / "__init__.py").write_text("")
    (folder / "compilation.py").write_text(Path(compilation.__file__).read_text())
    for name, text in MODULES.items():
        (folder / name).write_text(text.replace("\n        ", "\n").lstrip())
    return folder


def call(package: Path) -> tuple[float, bool]:
    """What `outer(10.0)` is in a new process, and whether its code came from the cache."""
    environment = {**os.environ, "PYTHONPATH": str(package.parent)}
    environment.pop("NUMBA_CACHE_DIR", None)
    run = [sys.executable, "-c", CALL]
    out = subprocess.run(run, env=environment, check=True, capture_output=True, text=True).stdout.split()
    assert {out[1], out[2]} == {"0", "1"}
    return float(out[0]), out[1] == "1"


def replace(file: Path, old: str, new: str) -> None:
    assert old in file.read_text()
    file.write_text(file.read_text().replace(old, new))


def test_code_of_another_file_is_compiled_anew_where_it_is_used(package):
    assert call(package) == (21.0, False)
    assert call(package) == (21.0, True)
    replace(package / "inner.py", "return FACTOR", "return 10.0 + FACTOR")
    assert call(package) == (31.0, False)
    replace(package / "inner.py", "FACTOR = 2.0", "FACTOR = 3.0")
    assert call(package) == (41.0, False)
    replace(package / "beside.py", "1", "2")
    assert call(package) == (41.0, True)


def test_sources_are_followed_through_all_imports():
    found = {str(path.relative_to(PACKAGE)) for path in sources(PACKAGE / "statics" / "compiled.py")}
    # compiled.py uses saddle.py, and that banded.py, imported as a module of its package
    assert {"compilation.py", "statics/compiled.py", "statics/saddle.py", "solve/banded.py"} <= found
    assert not any(path.startswith(("ros/", "cli/", "log/")) for path in found)


def test_every_compiled_file_takes_this_njit():
    direct = [
        str(path.relative_to(PACKAGE))
        for path in PACKAGE.rglob("*.py")
        if "from numba import" in path.read_text(encoding="utf-8") and path.name != "compilation.py"
    ]
    assert direct == []
