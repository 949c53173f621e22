"""Every test run has its own ROS domain and log folder, and leaves the machine's cores to others."""

from __future__ import annotations

import atexit
import os
import shutil
import tempfile
from pathlib import Path

from hypothesis import HealthCheck, settings

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("MPLBACKEND", "Agg")
# Domains 1 to 100 keep clear of the ports that the system hands out; 0 is everybody's.
# Never the one that is set: tests move joints, and on a robot that would be the robot's.
_domain = 1 + os.getpid() % 100
if str(_domain) == os.environ.get("ROS_DOMAIN_ID"):
    _domain = 1 + _domain % 100
os.environ["ROS_DOMAIN_ID"] = str(_domain)
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
_ros_log = tempfile.mkdtemp(prefix="cable_ros_log_")
os.environ["ROS_LOG_DIR"] = _ros_log
atexit.register(shutil.rmtree, _ros_log, ignore_errors=True)

# What `colcon test` runs: what can be otherwise on a robot, in minutes; with CABLE_ROS_TESTS=all everything.
ROBOT = ("ros", "scene", "test_closed_forms.py", "test_joint.py", "test_tracker.py")
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
