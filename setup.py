# SPDX-License-Identifier: Apache-2.0
"""Build of cable_ros: an ament_python package for colcon, and a plain Python package for pip."""

import os
import subprocess
import sys
import tempfile
from glob import glob

from setuptools import find_packages, setup
from setuptools.command.develop import develop
from setuptools.command.install import install

PACKAGE = "cable_ros"

# Tested with 1.5.0 and 1.6.0. Until log/order.py read the chunks itself, log/reader.py needed 1.6, whose
# `iter_messages` has `starting_at` and `ending_before` where that of 1.5 has `start_time` and `end_time`.
MCAP = "mcap>=1.5"

# The Jazzy wheels, for machines without ROS. Pinned: unpinned, some of them would be another distribution's.
ROS_JAZZY = [
    "ros-jazzy-rclpy==7.1.6",
    "ros-jazzy-common-interfaces==5.3.6",
    "ros-rclpy[fastrtps]==7.1.6",
    "ros-rmw-fastrtps-cpp==8.4.3",
    "ros-sensor-msgs==5.3.6",
    "ros-ament-index-python==1.8.1",
]

# What the tests import. colcon runs pytest where the extra "test" has it, and otherwise unittest, which
# finds no test and is content.
TEST = ["pytest>=7.4", "pytest-timeout", "hypothesis"]

MESH = ["trimesh>=4.5", "pycollada"]  # collision meshes of a URDF; pycollada for DAE

CLUSTER = ["distributed"]  # brings dask of the same version


def compile_ahead(folder):
    """Compile the solver of the package in the folder, so that a robot's first start need not; never fail."""
    if os.environ.get("CABLE_ROS_COMPILE") == "0":
        return
    print("compiling the solver, some minutes; CABLE_ROS_COMPILE=0 leaves it to the first start", flush=True)
    path = os.pathsep.join([os.path.abspath(folder), os.environ.get("PYTHONPATH", "")])
    with tempfile.TemporaryDirectory() as elsewhere:  # Python would take the sources in the folder it is in
        done = subprocess.run(
            [sys.executable, "-m", f"{PACKAGE}.cli.main", "compile"],
            cwd=elsewhere,
            env={"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", **os.environ, "PYTHONPATH": path},
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
    if done.returncode:
        reason = (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1]
        print(f"built, but not compiled, which the first start will do: {reason}", file=sys.stderr)


class Install(install):
    """As colcon installs; what a wheel or a Debian package is made of has a `root`, and runs elsewhere."""

    def run(self):
        super().run()
        if self.root is None and self.single_version_externally_managed:
            compile_ahead(self.install_lib)


class Develop(develop):
    """As `colcon build --symlink-install` does."""

    def run(self):
        super().run()
        if not self.uninstall:
            compile_ahead(".")


setup(
    name=PACKAGE,
    cmdclass={"install": Install, "develop": Develop},
    version="0.1.0",
    description="What an externally mounted cable does to its robot, live: joint states in, wrench out",
    license="Apache-2.0",
    url="https://example.org/cable_ros",
    author="cable_ros maintainers",
    maintainer="cable_ros maintainers",
    maintainer_email="cable_ros@example.org",
    python_requires=">=3.10",
    package_dir={"": "."},  # an editable installation is this folder, and setuptools has nothing to warn of
    packages=find_packages(include=[PACKAGE, f"{PACKAGE}.*"]),
    package_data={PACKAGE: ["py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
        (f"share/{PACKAGE}/config", sorted(glob("config/*"))),
        (f"share/{PACKAGE}/launch", sorted(glob("launch/*.launch.py"))),
    ],
    install_requires=["numpy>=1.26", "scipy", "numba", "pyyaml", MCAP, "mcap-ros2-support", "tqdm"],
    extras_require={
        "ros": ROS_JAZZY,
        "robot": ["pin"],
        "plot": ["matplotlib"],
        "mesh": MESH,
        "parquet": ["pyarrow"],
        "cluster": CLUSTER,
        # Material for MkDocs, the last that builds with MkDocs 1; latex2mathml for the equations.
        "docs": ["mkdocs>=1.6,<2", "mkdocs-material>=9.5,<10", "latex2mathml>=3.77"],
        # A real arm with its meshes, 130 MB, for benchmarks/dress_pack.py, and others' experiments, for
        # benchmarks/cosserat_bench.py; and tests that skip without.
        "benchmarks": ["example-robot-data", "cosseratbench==0.3.0"],
        "test": TEST,
        "dev": [
            *TEST,
            *CLUSTER,
            *MESH,
            "pytest>=9",
            "pytest-xdist>=3.6",
            "rosbags",
            "colcon-common-extensions",
            "colcon-ros",
            "setuptools>=70.1,<80",
            "ruff==0.17.5",
            "mypy==2.4.1",
            "types-PyYAML",
        ],
    },
    entry_points={
        "console_scripts": [
            "cable = cable_ros.cli.main:main",
            "cable_node = cable_ros.ros.start:cable_node",
            "cable_replay = cable_ros.ros.start:cable_replay",
        ],
    },
    zip_safe=False,
)
