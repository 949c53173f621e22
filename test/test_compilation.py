# SPDX-License-Identifier: Apache-2.0
"""Compiled code is kept while its sources stay the same, no longer, with the same bits in all processes."""

from __future__ import annotations

import ast
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from cable_ros import compilation
from cable_ros.common.alone import alone
from cable_ros.compilation import PACKAGE, njit, sources

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
import sys
from somewhere.outer import outer
value = outer(10.0)
hits = 0 if "numba" not in sys.modules else sum(outer.stats.cache_hits.values())
print(value, "kept" if "numba" not in sys.modules else "loaded" if hits else "compiled")
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


def python(code: str, *arguments: str, path: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    """Runs the code in a new process, with modules of `path` and numba's own choice of a cache folder."""
    inherited = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}
    environment = {**inherited, "PYTHONPATH": str(path), **environment}
    run = [sys.executable, "-c", code, *arguments]
    return subprocess.run(run, env=environment, check=True, capture_output=True, text=True)


def call(package: Path) -> tuple[float, str]:
    """What `outer(10.0)` is in a new process, and where its code is from.

    It was kept and ran without Numba; or Numba loaded it; or compiled it.
    """
    done = python(CALL, path=package.parent)
    assert done.stderr == ""
    value, origin = done.stdout.split()
    return float(value), origin


def leave_it_to_numba(package: Path) -> None:
    """Take away what would be used without Numba."""
    for file in kept(package, "code"):
        file.unlink()


def replace(file: Path, old: str, new: str) -> None:
    assert old in file.read_text()
    file.write_text(file.read_text().replace(old, new))


def test_code_of_another_file_is_compiled_anew_where_it_is_used(package):
    assert call(package) == (21.0, "compiled")
    assert call(package) == (21.0, "kept")
    replace(package / "inner.py", "return FACTOR", "return 10.0 + FACTOR")
    assert call(package) == (31.0, "compiled")
    replace(package / "inner.py", "FACTOR = 2.0", "FACTOR = 3.0")
    assert call(package) == (41.0, "compiled")
    replace(package / "beside.py", "1", "2")
    assert call(package) == (41.0, "kept")


def test_an_update_that_is_taken_back_is_kept_again(package):
    """Numba still has the old code where a function has moved in its file, and gives it without compiling."""
    replace(package / "inner.py", "cache=True", "cache=True, no_cpython_wrapper=True")
    assert call(package) == (21.0, "compiled")
    replace(package / "inner.py", "FACTOR = 2.0", "FACTOR = 3.0\n")
    assert call(package) == (31.0, "compiled")
    replace(package / "inner.py", "FACTOR = 3.0\n", "FACTOR = 2.0")
    assert call(package)[0] == 21.0
    assert call(package) == (21.0, "kept")


def test_code_is_not_taken_without_that_of_its_callee(package):
    """What `outer` calls has a name with a number in it that another process gives otherwise."""
    assert call(package) == (21.0, "compiled")
    for file in (package / "__pycache__").glob("*inner.inner*"):
        file.unlink()
    assert call(package) == (21.0, "compiled")
    assert call(package) == (21.0, "kept")
    for file in (package / "__pycache__").glob("*inner.inner*"):
        file.unlink()
    python("from somewhere.inner import inner; inner(1); inner(1.0)", path=package.parent)
    assert call(package) == (21.0, "compiled")
    assert call(package) == (21.0, "kept")


def test_of_two_processes_one_compiles_and_the_other_takes_it(package):
    """Both begin at once; each would number what it compiles in its own way."""
    (package / "__pycache__").mkdir()
    count = "import numba; numba.njit(lambda: 1)()\n"
    run = {"env": {**os.environ, "PYTHONPATH": str(package.parent)}, "stdout": subprocess.PIPE, "text": True}
    run["env"].pop("NUMBA_CACHE_DIR", None)
    with alone(package / "__pycache__" / "cable_ros.lock", "somewhere.outer.outer"):
        both = [subprocess.Popen([sys.executable, "-c", code], **run) for code in (CALL, count + CALL)]
        with pytest.raises(subprocess.TimeoutExpired):
            both[1].wait(timeout=5.0)
    said = sorted(process.communicate()[0].split() for process in both)
    assert said == [["21.0", "compiled"], ["21.0", "loaded"]]
    assert call(package) == (21.0, "kept")


def test_kept_code_is_found_by_another_way_to_it(package, tmp_path):
    """As in a workspace that links to it."""
    assert call(package) == (21.0, "compiled")
    (tmp_path / "link").symlink_to(package.parent)
    assert call(tmp_path / "link" / package.name) == (21.0, "kept")


def test_code_of_a_callee_is_not_kept_again(package):
    """`outer` keeps its own code, that of its entry from Python, and the name of what it calls."""
    assert call(package) == (21.0, "compiled")
    (kept_outer,) = (file for file in kept(package, "nbc") if file.name.startswith("outer"))
    replace(package / "inner.py", "return FACTOR * x", "return " + " + ".join(["x / (FACTOR + x)"] * 200))
    before = kept_outer.stat().st_size
    assert call(package)[1] == "compiled"
    assert abs(kept_outer.stat().st_size - before) < 0.1 * before


def test_a_literal_argument_gets_no_code_of_its_own():
    @compilation.njit()
    def inner(n):
        return 2 * n

    @compilation.njit()
    def outer(n):
        return inner(3) + inner(n)

    assert outer(4) == 14
    assert len(inner.signatures) == 1


@pytest.mark.parametrize(("most_copied", "called"), [(0, 1), (10**6, 0)])
def test_a_short_leaf_is_copied_and_a_long_one_is_called(most_copied, called, monkeypatch):
    from cable_ros import kernel_compiler

    monkeypatch.setattr(kernel_compiler, "MOST_COPIED", most_copied)

    @compilation.njit(**{**compilation.LEAF, "cache": False})
    def leaf(x):
        return x[0] + x[1]

    @compilation.njit()
    def outer(x):
        return 2.0 * leaf(x)

    assert outer(np.array([1.0, 4.0])) == 10.0
    (compiled,) = outer.overloads.values()
    assert len(kernel_compiler._CALLS[compiled.fndesc.llvm_func_name]) == called


def test_a_function_without_an_entry_is_called_from_python_and_by_others():
    @compilation.njit(**{**compilation.INNER, "cache": False})
    def inner(x, count):
        return count * x[0], x[1]

    @compilation.njit()
    def outer(x):
        a, b = inner(x, 3)
        return a + b

    x = np.array([1.0, 4.0])
    assert outer(x) == 7.0
    assert inner(x, 2) == (2.0, 4.0)
    assert inner(x, 5) == (5.0, 4.0)
    assert inner(x, 0.5) == (0.5, 4.0)
    (compiled,) = (one for one in inner.overloads.values() if "int64" in str(one.signature.args[1]))
    names = {function.name for function in compiled.library._final_module.functions}
    assert compiled.fndesc.llvm_func_name in names
    assert compiled.fndesc.llvm_cpython_wrapper_name not in names


def _kernels():
    """The options' name of each compiled function of the package, by module and name."""
    for path in PACKAGE.rglob("*.py"):
        module = ".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts)
        for one in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(one, ast.FunctionDef):
                for decorator in map(ast.unparse, one.decorator_list):
                    if decorator.startswith("njit("):
                        yield (module, one.name), decorator


def _named_outside_kernels(path, kernels):
    """Compiled functions that the file's Python code names."""
    module = ".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts)
    tree = ast.parse(path.read_text(encoding="utf-8"))
    known = {name: (module, name) for (home, name) in kernels if home == module}
    for one in ast.walk(tree):
        if isinstance(one, ast.ImportFrom):
            known |= {alias.asname or alias.name: (one.module, alias.name) for alias in one.names}
    found, waiting = set(), list(tree.body)
    while waiting:
        one = waiting.pop()
        if isinstance(one, ast.FunctionDef) and (module, one.name) in kernels:
            continue
        if isinstance(one, ast.Name):
            found.add(known.get(one.id))
        elif isinstance(one, ast.Attribute) and isinstance(one.value, ast.Name) and one.value.id in known:
            found.add((".".join(known[one.value.id]), one.attr))
        waiting += ast.iter_child_nodes(one)
    return found & kernels.keys()


def test_what_python_calls_has_an_entry():
    """Without one each process would compile one at the first call."""
    kernels = dict(_kernels())
    inner = {name for name, options in kernels.items() if "INNER" in options or "**LEAF)" in options}
    assert len(inner) > 50
    called = set().union(*(_named_outside_kernels(path, kernels) for path in PACKAGE.rglob("*.py")))
    assert len(called) > 50
    assert inner & called == set()


def test_sources_are_followed_through_all_imports():
    found = {str(path.relative_to(PACKAGE)) for path in sources(PACKAGE / "rod" / "warm_step.py")}
    # warm_step.py uses bordered.py, and that banded.py, imported as a module of its package
    assert {"compilation.py", "rod/warm_step.py", "linalg/bordered.py", "linalg/banded.py"} <= found
    assert {"kept_code.py", "kernel_compiler.py"} <= found  # they make the code
    assert not any(path.startswith(("ros/", "cli/", "log/", "tracker", "contact/")) for path in found)


def test_every_compiled_file_takes_this_njit():
    direct = [
        str(path.relative_to(PACKAGE))
        for path in PACKAGE.rglob("*.py")
        if "from numba import" in path.read_text(encoding="utf-8") and path.name != "compilation.py"
    ]
    assert direct == []


def kept(package: Path, ending: str) -> list[Path]:
    found = sorted((package / "__pycache__").glob(f"*.{ending}"))
    assert len(found) == 2  # inner's and outer's
    return found


@pytest.mark.parametrize("size", [0, 100])
@pytest.mark.parametrize("ending", ["nbi", "nbc"])
def test_files_cut_short_are_replaced(package, ending, size):
    """As a power failure leaves them."""
    assert call(package) == (21.0, "compiled")
    leave_it_to_numba(package)
    for file in kept(package, ending):
        os.truncate(file, size)
    assert call(package) == (21.0, "compiled")
    leave_it_to_numba(package)
    assert call(package) == (21.0, "loaded")
    assert call(package) == (21.0, "kept")


@pytest.mark.parametrize("size", [0, 100])
def test_kept_code_cut_short_is_replaced(package, size):
    assert call(package) == (21.0, "compiled")
    for file in kept(package, "code"):
        os.truncate(file, size)
    assert call(package) == (21.0, "loaded")
    assert call(package) == (21.0, "kept")


def test_code_of_other_sources_is_not_taken(package):
    """Before and after an update, two processes write at once: the index of one, the data of the other."""
    assert call(package) == (21.0, "compiled")
    files = kept(package, "nbc") + kept(package, "code")
    for file in files:
        shutil.copy(file, package / file.name)
    replace(package / "inner.py", "FACTOR = 2.0", "FACTOR = 3.0")
    assert call(package) == (31.0, "compiled")
    for file in files:
        shutil.copy(package / file.name, file)
    assert call(package) == (31.0, "compiled")
    assert call(package) == (31.0, "kept")


def test_code_of_another_maker_is_not_taken(package):
    """Another processor, Numba or NumPy; here another setting of Numba's."""
    assert call(package) == (21.0, "compiled")
    done = python(CALL, path=package.parent, NUMBA_OPT="2")
    assert done.stdout.split()[1] != "kept"


def test_a_disk_that_takes_nothing_stops_nothing(package):
    """A folder in the place of a file is as good as a full disk: neither can be written."""
    call(package)
    for file in kept(package, "nbi") + kept(package, "code"):
        file.unlink()
        file.mkdir()
    assert call(package) == (21.0, "compiled")


def test_an_entry_takes_arguments_of_its_types_alone():
    """What the code was not compiled for must not be read as if it were."""

    @compilation.njit()
    def total(x, pair, n, factor):
        out = np.zeros(2)
        for i in range(n):
            out[0] += factor * x[i] + pair[1][i]
        out[1] = len(x)
        return out

    x = np.arange(4.0)
    pair = (1, np.ones(4))
    assert list(total(x, pair, 4, 2.0)) == [16.0, 4.0]
    entry = total._entry
    frozen = x.copy()
    frozen.flags.writeable = False
    for other in (x[::-1], x.astype(int), x.astype("f4"), frozen, list(x)):
        with pytest.raises(TypeError):
            entry(other, pair, 4, 2.0)
        with pytest.raises(TypeError):
            entry(x, (1, other), 4, 2.0)
        if not isinstance(other, list):
            assert list(total(other, pair, 4, 2.0)) == [16.0, 4.0]
    for other in (x.reshape(1, 4), x.astype(">f8"), x.astype(complex), None, 1.0):
        with pytest.raises(TypeError):
            entry(other, pair, 4, 2.0)
    for other in ((1,), x, None):
        with pytest.raises((TypeError, ValueError)):
            entry(x, other, 4, 2.0)
    for count in (4.0, None, x):
        with pytest.raises(TypeError):
            entry(x, pair, count, 2.0)
    assert list(entry(x, pair, np.int32(4), 2)) == [16.0, 4.0]
    with pytest.raises(TypeError):
        total(x, pair, 4)


def test_a_solve_whose_code_is_kept_needs_no_numba():
    code = "import sys; from cable_ros.warm_up import rehearse_contact; rehearse_contact(); "
    python(code, path=PACKAGE.parent)  # which may compile
    assert python(code + "print('numba' in sys.modules)", path=PACKAGE.parent).stdout == "False\n"


def test_no_folder_to_keep_code_in_is_told_once(package, tmp_path):
    nowhere = tmp_path / "file"
    nowhere.touch()
    (package / "__pycache__").symlink_to(nowhere)
    done = python(CALL, path=package.parent, XDG_CACHE_HOME=str(nowhere / "cache"))
    assert done.stdout.startswith("21.0 ")
    assert done.stderr.count("set NUMBA_CACHE_DIR") == 1


SCENES = """
import hashlib, sys
import numpy as np
from references import planar
from zoo_make import led
from cable_ros import Tracker, load_scene
from cable_ros.bench.cases import case_scene
from cable_ros.share import share_file

def angles(start, end, count):
    return np.radians(np.linspace(start, end, count))

def of_config(name, path):
    tracker = Tracker(load_scene(share_file("config", name)))
    return tracker, [dict.fromkeys(tracker.joint_names, value) for value in path]

def arch():
    path = [{"yaw": angle} for angle in [*angles(-20, 60, 33), *angles(60, 0, 31)]]
    case = led("arch", "", planar.buckled(1.0, 1.0, 0.9).scene(), path)
    return Tracker(case_scene(case)), case.path

SCENES = {
    "arm": lambda: of_config("space_arm.yaml", angles(-90, 90, 46)),
    "arch": arch,
    "sphere": lambda: of_config("space_arm_sphere.yaml", angles(20, 75, 56)),
    "draped": lambda: of_config("draped.yaml", np.linspace(0.0, 0.2, 11)),
}
def bits(name):
    tracker, path = SCENES[name]()
    digest = hashlib.sha256()
    for joints in path:
        for found in tracker.solve(joints).values():
            for value in (found.end_wrench, found.points, found.stability_margin, found.error_estimate):
                digest.update(np.asarray(value).tobytes())
    return digest.hexdigest()
"""
SOLVE = """
print(*[digest for _, digest in sorted((name, bits(name)) for name in sys.argv[1:])])
"""
MEANWHILE = """
from cable_ros import interpretation
from cable_ros.interpretation import Interpretation
interpretation.ALLOWED, Interpretation.tell = True, str  # cable_ros.bench, which measures, forbids it

def wrenches():
    tracker, path = SCENES[sys.argv[1]]()
    return np.array([[one.end_wrench for one in tracker.solve(joints).values()] for joints in path])

interpreted = wrenches()
Interpretation.current.wait()
difference = np.abs(wrenches() - interpreted).max() / np.abs(interpreted).max()
assert "numba" not in sys.modules, "what the other process has compiled is loaded"
print(bits(sys.argv[1]), difference)
"""


def solved(*names: str, **environment: str) -> str:
    """What identifies every bit of the scenes' equilibria, solved in this order in a new process."""
    return python(SCENES + SOLVE, *names, path=Path(__file__).parent, **environment).stdout


def test_the_same_bits_just_compiled_and_loaded(tmp_path):
    """Contact would take as long again to compile; its functions are loaded in two orders below."""
    cache = str(tmp_path)
    compiled = solved("arch", "arm", NUMBA_CACHE_DIR=cache)
    assert solved("arch", "arm", NUMBA_CACHE_DIR=cache) == compiled
    assert solved("arm", "arch", NUMBA_CACHE_DIR=cache) == compiled


@pytest.mark.timeout(300)  # another process compiles beside other tests
def test_the_same_interpreted_meanwhile_and_compiled_after(tmp_path):
    keeps = {"CABLE_ROS_INTERPRET": "1", "NUMBA_CACHE_DIR": str(tmp_path)}
    done = python(SCENES + MEANWHILE, "arm", path=Path(__file__).parent, **keeps)
    compiled, difference = done.stdout.splitlines()[-1].split()
    assert compiled == solved("arm").strip()
    assert float(difference) < 1e-11, "powers and sines of NumPy differ in the last bit"


@pytest.mark.timeout(600)  # the first test to solve with contact compiles for it
def test_the_same_bits_whatever_was_loaded_before():
    """With contact, whose functions share most of theirs with those of the free cable."""
    names = ["arch", "arm", "draped", "sphere"]
    assert solved(*names) == solved(*reversed(names))
    assert solved("sphere", "arm") == solved("arm", "sphere")


def test_the_arithmetic_is_that_which_is_written():
    relaxed = re.compile(r"""fastmath["']?\s*[:=]""")
    found = [
        str(path.relative_to(PACKAGE))
        for path in PACKAGE.rglob("*.py")
        if relaxed.search(path.read_text(encoding="utf-8"))
    ]
    assert found == ["baselines/published_kernels.py"]


def test_a_function_that_fails_is_not_run_again() -> None:
    """It has changed its arguments: what it made of them twice could pass for an answer."""

    @njit()
    def factor(a: np.ndarray) -> None:
        a[0] += 1.0
        if a[1] == 0.0:
            raise np.linalg.LinAlgError("a singular matrix")

    factor(np.ones(2))
    a = np.zeros(2)
    with pytest.raises(np.linalg.LinAlgError):
        factor(a)
    assert a[0] == 1.0
