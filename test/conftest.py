"""Every process of a test run has its own ROS domain and log folder, and one thread.

`make test` runs two processes side by side (pytest-xdist); `pytest -n 0` runs all tests in one.
"""

from __future__ import annotations

import atexit
import os
import shutil
import tempfile
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

FOLDER = Path(__file__).parent

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("MPLBACKEND", "Agg")
# Domains 1 to 100 keep clear of the ports that the system hands out; 0 is everybody's.
os.environ.setdefault("ROS_DOMAIN_ID", str(1 + os.getpid() % 100))
if _worker := os.environ.get("PYTEST_XDIST_WORKER"):  # gw0, gw1, ...: each inherits the domain of the run
    os.environ["ROS_DOMAIN_ID"] = str(1 + (int(os.environ["ROS_DOMAIN_ID"]) + int(_worker[2:])) % 100)
os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
_ros_log = tempfile.mkdtemp(prefix="cable_ros_log_")
os.environ["ROS_LOG_DIR"] = _ros_log
atexit.register(shutil.rmtree, _ros_log, ignore_errors=True)

# The same cases in every run, and no verdict by the clock; --hypothesis-profile=default looks for new ones.
settings.register_profile(
    "repeatable",
    derandomize=True,
    deadline=None,
    print_blob=True,
    suppress_health_check=[HealthCheck.too_slow],
)
settings.load_profile("repeatable")

STARTS_NODES = ("ros/", "cli/test_demo.py")
"""Files whose tests start nodes and wait for them: one after the other, each with a core for the node."""
APART = ("test_zoo.py", "test_hose_paths.py")
"""Long files whose tests share nothing: each test goes to the process that is free."""


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """With `--dist loadgroup`, the tests of a file stay together, for the sake of the fixtures they share."""
    if not config.pluginmanager.hasplugin("xdist"):
        return
    for item in items:
        file = item.path.relative_to(FOLDER).as_posix()
        if file not in APART:
            group = "nodes" if file.startswith(STARTS_NODES) else file
            item.add_marker(pytest.mark.xdist_group(group))
