# SPDX-License-Identifier: Apache-2.0
"""The package as colcon and pip install it: share files found, executables that run."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ET
from importlib import metadata
from pathlib import Path

import pytest

from cable_ros.share import share_directory, share_file

ROOT = Path(__file__).resolve().parent.parent
BUILD = (sys.executable, "-m", "colcon", "build", "--paths")
SOURCES = ("cable_ros", "config", "launch", "resource")
EXECUTABLES = ("cable", "cable_node", "cable_replay")
WHERE = (
    "from cable_ros import share; print(share.__file__); print(share.share_file('config', 'space_arm.yaml'))"
)

COMPILE_ONE = """

def rehearse_all():
    import numpy as np
    from cable_ros.linalg.banded import multiply
    multiply(np.eye(3), np.zeros(3), np.zeros(3))
"""
NEEDS_NUMBA = (
    "import sys; from cable_ros.warm_up import rehearse_all; rehearse_all(); print('numba' in sys.modules)"
)

# What the environment of a sourced ROS would say, and what the package must find out without; and the domain
# that this run of tests keeps clear of, which is not that of the runs that it starts.
ROS_VARIABLES = ("AMENT_PREFIX_PATH", "COLCON_PREFIX_PATH", "PYTHONPATH", "CABLE_ROS_TAKEN_DOMAIN")


def run(*command: str | Path, cwd: Path, env: dict[str, str]) -> str:
    """Standard output of a command that must succeed."""
    done = subprocess.run(
        list(map(str, command)), cwd=cwd, env=env, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def clean() -> dict[str, str]:
    """The environment of this process without any ROS in it."""
    return {name: value for name, value in os.environ.items() if name not in ROS_VARIABLES}


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of what the package is built from: a build leaves files beside its sources."""
    copy = tmp_path_factory.mktemp("source") / "cable_ros"
    copy.mkdir()
    for name in filter(lambda name: (ROOT / name).is_dir(), SOURCES):
        shutil.copytree(ROOT / name, copy / name, ignore=shutil.ignore_patterns("__pycache__"))
    for file in ROOT.iterdir():
        if file.suffix in (".xml", ".py", ".cfg", ".toml", ".in", ".md", ".rst") or file.name == "LICENSE":
            shutil.copy(file, copy)
    return copy


@pytest.fixture(scope="module")
def underlay(clean: dict[str, str]) -> dict[str, str]:
    """The environment of a sourced ROS."""
    pytest.importorskip("colcon_core", reason="colcon is not installed")
    pytest.importorskip("colcon_ros", reason="colcon's ROS extensions are not installed")
    ros = {"AMENT_PREFIX_PATH": sys.prefix, "ROS_DISTRO": "jazzy"}
    return clean | ros | {"ROS_VERSION": "2", "ROS_PYTHON_VERSION": "3"}


@pytest.fixture(scope="module")
def workspace(source: Path, underlay: dict[str, str], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A colcon workspace with the package built in it."""
    base = tmp_path_factory.mktemp("workspace")
    env = underlay | {"COLCON_LOG_PATH": str(base / "log"), "CABLE_ROS_COMPILE": "0"}
    run(*BUILD, source, cwd=base, env=env)
    return base


def copy_configuration(package: Path) -> None:
    """Give a package pytest's configuration, and no tests."""
    (package / "test").mkdir(exist_ok=True)
    for name in ("conftest.py", "sampled.py"):
        shutil.copy(ROOT / "test" / name, package / "test")


def in_workspace(workspace: Path, env: dict[str, str], *command: str | Path) -> str:
    """Output of a command in a shell that has sourced the workspace, as a user's has."""
    script = '. "$0/install/setup.bash" && exec "$@"'
    return run("bash", "-c", script, workspace, *command, cwd=workspace, env=env)


def test_colcon_workspace_is_an_ament_prefix(workspace: Path, clean: dict[str, str]) -> None:
    prefix = workspace / "install" / "cable_ros"
    code = (
        "from ament_index_python import packages as p;"
        "print(p.get_package_prefix('cable_ros')); print(p.get_package_share_directory('cable_ros'))"
    )
    if shutil.which("ros2") is None:
        pytest.importorskip("ament_index_python", reason="neither ROS nor its wheels are here")
    found = in_workspace(workspace, clean, sys.executable, "-c", code).split()
    assert found == [str(prefix), str(prefix / "share" / "cable_ros")]
    built, shared = in_workspace(workspace, clean, sys.executable, "-c", WHERE).split()
    assert Path(built).is_relative_to(prefix)
    assert Path(shared) == prefix / "share" / "cable_ros" / "config" / "space_arm.yaml"
    for folder in ("config", "launch"):
        ours = {p.name for p in (ROOT / folder).glob("*") if p.is_file()}
        assert {p.name for p in (prefix / "share" / "cable_ros" / folder).glob("*")} == ours


@pytest.fixture
def quick(source: Path, tmp_path: Path) -> Path:
    """A copy of the sources in which to compile everything is to compile one function."""
    copy = tmp_path / "cable_ros"
    shutil.copytree(source, copy)
    with (copy / "cable_ros" / "warm_up.py").open("a") as file:
        file.write(COMPILE_ONE)
    return copy


@pytest.mark.parametrize("how", [(), ("--symlink-install",)])
def test_colcon_compiles_where_it_installs(
    quick: Path, underlay: dict[str, str], clean: dict[str, str], tmp_path: Path, how: tuple[str, ...]
) -> None:
    env = {name: value for name, value in underlay.items() if name != "NUMBA_CACHE_DIR"}
    run(*BUILD, quick, *how, cwd=tmp_path, env=env)
    said = (tmp_path / "log" / "latest_build" / "cable_ros" / "stdout.log").read_text()
    assert "compiling the solver, some minutes; CABLE_ROS_COMPILE=0 leaves it" in said
    env = {name: value for name, value in clean.items() if name != "NUMBA_CACHE_DIR"}
    assert in_workspace(tmp_path, env, sys.executable, "-c", NEEDS_NUMBA) == "False\n"
    run(*BUILD, quick, *how, cwd=tmp_path, env=underlay)
    said = (tmp_path / "log" / "latest_build" / "cable_ros" / "stdout.log").read_text()
    assert "nothing to compile" in said


def test_a_build_without_numba_says_so_and_goes_on(
    quick: Path, underlay: dict[str, str], tmp_path: Path
) -> None:
    with (quick / "cable_ros" / "common" / "requirements.py").open("a") as file:
        file.write('FROM_PIP["numba_is_not_here"] = "numba"\n')
    run(*BUILD, quick, cwd=tmp_path, env=underlay)
    said = (tmp_path / "log" / "latest_build" / "cable_ros" / "stderr.log").read_text()
    (line,) = (line for line in said.splitlines() if "not compiled" in line)
    assert "the Python package 'numba_is_not_here' is missing" in line
    copy_configuration(quick)
    test = (sys.executable, "-m", "colcon", "test", "--paths", quick)
    done = subprocess.run(test, cwd=tmp_path, env=underlay, capture_output=True, check=False)
    assert done.returncode
    said = (tmp_path / "log" / "latest_test" / "cable_ros" / "stdout_stderr.log").read_text()
    assert "the Python package 'numba_is_not_here' is missing" in said


def test_colcon_executables_run(workspace: Path, clean: dict[str, str]) -> None:
    # What `ros2 run cable_ros NAME` looks for: an executable in lib/<package> of the package's prefix.
    folder = workspace / "install" / "cable_ros" / "lib" / "cable_ros"
    assert {p.name for p in folder.iterdir() if os.access(p, os.X_OK)} == set(EXECUTABLES)
    assert "solve" in in_workspace(workspace, clean, folder / "cable", "-h")


def test_colcon_runs_the_tests_and_fails_with_them(
    workspace: Path, source: Path, clean: dict[str, str]
) -> None:
    folder = source / "test" / "ros"
    folder.mkdir(parents=True)
    copy_configuration(source)
    colcon = (sys.executable, "-m", "colcon")
    env = clean | {"COLCON_LOG_PATH": str(workspace / "log")}
    for outcome, summary in (
        ("True", "1 test, 0 errors, 0 failures"),
        ("False", "1 test, 0 errors, 1 failure"),
    ):
        (folder / "test_it.py").write_text(
            f"import os\n\n\ndef test_it():\n    assert os.environ['ROS_DOMAIN_ID'] != '7' and {outcome}\n"
        )
        (source / "test" / "test_of_the_solver.py").write_text("def test_long():\n    assert False\n")
        in_workspace(
            workspace,
            env | {"ROS_DOMAIN_ID": "7"},
            *colcon,
            "test",
            "--paths",
            source,
            "--event-handlers",
            "status-",
        )
        result = subprocess.run(
            [*colcon, "test-result"], cwd=workspace, env=env, capture_output=True, text=True, check=False
        )
        assert summary in result.stdout
        assert result.returncode == (outcome == "False")


def test_what_colcon_runs_is_there() -> None:
    text = (ROOT / "test" / "conftest.py").read_text()
    (names,) = re.findall(r"^ROBOT = \((.*)\)$", text, re.M)
    for name in re.findall(r'"(.+?)"', names):
        assert (ROOT / "test" / name).exists()


def test_pip_installs_the_share_files(source: Path, clean: dict[str, str], tmp_path: Path) -> None:
    target = tmp_path / "target"
    build = (sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-build-isolation")
    run(*build, "--target", target, source, cwd=tmp_path, env=clean)
    env = clean | {"PYTHONPATH": str(target)}
    code, shared = run(sys.executable, "-c", WHERE, cwd=tmp_path, env=env).split()
    assert Path(code).is_relative_to(target)
    assert Path(shared) == target / "share" / "cable_ros" / "config" / "space_arm.yaml"
    assert (target / "cable_ros" / "py.typed").is_file()
    assert {p.name for p in (target / "bin").iterdir()} >= set(EXECUTABLES)
    assert not list(target.rglob("*.code"))  # a wheel goes to other machines


def test_this_environment_has_the_commands() -> None:
    # setup.cfg sends the executables to lib/cable_ros for colcon; with pip they must be in bin all the same.
    scripts = {point.name for point in metadata.distribution("cable_ros").entry_points}
    assert scripts == set(EXECUTABLES)
    for name in EXECUTABLES:
        assert os.access(Path(sys.executable).parent / name, os.X_OK)


def test_ament_index_comes_before_the_environment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    overlay = tmp_path / "overlay"
    index = overlay / "share" / "ament_index" / "resource_index" / "packages"
    index.mkdir(parents=True)
    (index / "cable_ros").touch()
    (overlay / "share" / "cable_ros").mkdir()
    (overlay / "share" / "cable_ros" / "package.xml").touch()
    installed = tmp_path / "lib" / "site-packages" / "cable_ros" / "share.py"
    monkeypatch.setattr("cable_ros.share.__file__", str(installed))
    monkeypatch.delenv("AMENT_PREFIX_PATH", raising=False)
    with pytest.raises(FileNotFoundError, match="install the package again"):
        share_directory()
    monkeypatch.setenv("AMENT_PREFIX_PATH", os.pathsep.join(["", str(tmp_path), str(overlay)]))
    assert share_directory() == overlay / "share" / "cable_ros"


def test_missing_share_file_names_those_there_are() -> None:
    with pytest.raises(FileNotFoundError, match=r"space_arm\.yaml"):
        share_file("config", "space_arn.yaml")


def test_versions_and_licence_agree() -> None:
    package = ET.parse(ROOT / "package.xml").getroot()
    ours = metadata.metadata("cable_ros")
    version = package.findtext("version")
    assert version == ours["Version"]
    assert f"## {version}" in (ROOT / "CHANGELOG.md").read_text()
    assert package.findtext("license") == "Apache-2.0"
    assert "Version 2.0, January 2004" in (ROOT / "LICENSE").read_text()


def test_the_release_tools_take_it() -> None:
    package = pytest.importorskip("catkin_pkg.package", reason="catkin_pkg is not on this machine")
    release = pytest.importorskip(
        "catkin_pkg.cli.prepare_release", reason="catkin_pkg is not on this machine"
    )
    warnings: list[str] = []
    ours = package.parse_package(str(ROOT), warnings=warnings)
    assert warnings == []
    assert [url.type for url in ours.urls] == ["repository"]
    assert ours.authors
    text = (ROOT / "CHANGELOG.rst").read_text()
    assert release.get_forthcoming_label(text) or re.search(rf"^{re.escape(ours.version)} \(", text, re.M)


def test_every_imported_ros_package_is_declared() -> None:
    """rosdep installs what package.xml names and nothing else."""
    declared = {e.text for e in ET.parse(ROOT / "package.xml").getroot().iter("exec_depend")}
    pattern = re.compile(
        r"^\s*(?:from|import) ((?:\w+_msgs|\w*_interfaces|std_srvs|rclpy|launch\w*|ament_\w+))\b", re.M
    )
    files = [*(ROOT / "cable_ros").rglob("*.py"), *(ROOT / "launch").glob("*.py")]
    used = {name for file in files for name in pattern.findall(file.read_text())}
    assert used <= declared


def test_every_file_names_its_license() -> None:
    for folder in ("cable_ros", "launch", "examples", "benchmarks", "test"):
        for path in sorted((ROOT / folder).rglob("*.py")):
            with path.open(encoding="utf-8") as file:
                head = [file.readline() for _ in range(2)]
            assert "# SPDX-License-Identifier: Apache-2.0\n" in head, path
