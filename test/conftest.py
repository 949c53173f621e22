"""Every test run has its own ROS domain and log folder, and leaves the machine's cores to others."""

from __future__ import annotations

import atexit
import os
import shutil
import tempfile

from hypothesis import HealthCheck, settings

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("MPLBACKEND", "Agg")
# Domains 1 to 100 keep clear of the ports that the system hands out; 0 is everybody's.
os.environ.setdefault("ROS_DOMAIN_ID", str(1 + os.getpid() % 100))
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
