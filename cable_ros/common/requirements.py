# SPDX-License-Identifier: Apache-2.0
"""What Ubuntu 24.04 has no package of: reported in one sentence before an import of it fails."""

from __future__ import annotations

from importlib.util import find_spec

FROM_PIP = {"numba": "numba>=0.59", "mcap": "mcap>=1.5"}
"""By name of the import, what pip calls it."""
_ROS = "rclpy"


def missing(ros: bool = False) -> str:
    """The sentence about what is not installed; empty where all is there.

    Args:
        ros: whether ROS is needed as well.
    """
    if ros and find_spec(_ROS) is None:
        return (
            "the Python package 'rclpy' is missing; source ROS first (. /opt/ros/jazzy/setup.bash), or where "
            "there is no ROS: pip install 'cable_ros[ros]'"
        )
    absent = [name for name in FROM_PIP if find_spec(name) is None]
    if not absent:
        return ""
    names = " and ".join(f"'{name}'" for name in absent)
    wanted = " ".join(f"'{requirement}'" for requirement in FROM_PIP.values())
    return (
        f"the Python package {names} is missing, and rosdep has none for Ubuntu 24.04; in the workspace: "
        "python3 -m venv --system-site-packages .venv && touch .venv/COLCON_IGNORE && "
        f". .venv/bin/activate && pip install {wanted} && python $(which colcon) build"
    )
