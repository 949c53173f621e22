# SPDX-License-Identifier: Apache-2.0
"""Every process of a test run has its own ROS domain and log folder, and one thread.

`make test` runs two processes side by side (pytest-xdist); `pytest -n 0` runs all tests in one.
"""

from __future__ import annotations

import atexit
import os
import shutil
import sys
import tempfile
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, settings
from sampled import sampled

FOLDER = Path(__file__).parent

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("MPLBACKEND", "Agg")
os.environ.setdefault("CABLE_ROS_INTERPRET", "0")  # tests that are to be interpreted say so
# Domains 1 to 100 keep clear of the ports that the system hands out; 0 is everybody's.
# Never the one that is set: tests move joints, and on a robot that would be the robot's.
_taken = os.environ.setdefault("CABLE_ROS_TAKEN_DOMAIN", os.environ.get("ROS_DOMAIN_ID", "0"))
_domains = [str(domain) for domain in range(1, 101) if str(domain) != _taken]
_worker = os.environ.get("PYTEST_XDIST_WORKER")  # gw0, gw1, ...: processes of one run side by side
_run = os.getppid() + 1 + int(_worker[2:]) if _worker else os.getpid()
os.environ["ROS_DOMAIN_ID"] = _domains[_run % len(_domains)]
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
_ros_log = tempfile.mkdtemp(prefix="cable_ros_log_")
os.environ["ROS_LOG_DIR"] = _ros_log
atexit.register(shutil.rmtree, _ros_log, ignore_errors=True)

# What `colcon test` runs: what can be otherwise on a robot, in minutes; with CABLE_ROS_TESTS=all everything.
ROBOT = ("ros", "scene", "test_closed_forms.py", "test_joint.py", "test_tracker.py")
if "COLCON" in os.environ:
    # What was built, and compiled, is tested, not the sources in the folder that colcon starts pytest in.
    sys.path[:] = [entry for entry in sys.path if Path(entry).resolve() != FOLDER.parent]
    os.environ["PYTHONSAFEPATH"] = "1"
    from cable_ros.common.requirements import missing

    if sentence := missing():
        pytest.exit(f"{sentence} && python $(which colcon) test", returncode=2)
if "COLCON" in os.environ and os.environ.get("CABLE_ROS_TESTS") != "all":
    collect_ignore = [entry.name for entry in Path(__file__).parent.iterdir() if entry.name not in ROBOT]

# The same cases in every run, and no verdict by the clock; --hypothesis-profile=default looks for new ones.
settings.register_profile(
    "repeatable",
    derandomize=True,
    deadline=None,
    print_blob=True,
    suppress_health_check=[HealthCheck.too_slow],
)
settings.load_profile("repeatable")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    if os.environ.get("CABLE_ROS_TESTS") != "all":
        items[:], left = sampled(items)
        config.hook.pytest_deselected(items=left)


STARTS_NODES = ("ros/", "cli/test_demo.py")
"""Files whose tests start nodes and wait for them: one after the other, each with a core for the node."""
APART = ("test_zoo.py",)
"""A long file whose tests share nothing: each goes to the process that is free."""


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """The tests of a file stay together, for the sake of the fixtures they share.

    By our own hand: `--dist loadgroup` of pytest-xdist 3.8 forgets its groups, in silence, under pytest 9.2.
    """
    from xdist.scheduler import LoadScopeScheduling

    class ByFile(LoadScopeScheduling):
        def _split_scope(self, nodeid: str) -> str:
            file = nodeid.split("::")[0].removeprefix(f"{FOLDER.name}/")
            return nodeid if file in APART else "nodes" if file.startswith(STARTS_NODES) else file

    return ByFile(config, log)
