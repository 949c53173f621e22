# SPDX-License-Identifier: Apache-2.0
"""Order of convergence: error of the end wrench on equal elements of orders 3 to 6, space arm.

    python benchmarks/convergence.py --angle 90 --twist -3.69        # a second

Against sixteen elements of order 8; force and moment each relative to its own size, the larger of both.
"""

from __future__ import annotations

import argparse
import sys
from itertools import pairwise

import numpy as np

from cable_ros import load_scene
from cable_ros.branch.cold_start import Conditions, Found, equilibria
from cable_ros.branch.refinement import on_mesh
from cable_ros.rod.elements import Mesh, reference_element
from cable_ros.rod.units import Units, relative
from cable_ros.scene import Kinematics
from cable_ros.share import share_file

ORDERS, COUNTS = (3, 4, 5, 6), (4, 6, 8)


def equilibrium(degrees: float, twist: float) -> Found:
    scene = load_scene(share_file("config", "space_arm.yaml"))
    (cable,) = scene.cables
    unit = Units(cable.length, float(np.sqrt(cable.stiffness[0] * cable.stiffness[1])))
    poses = Kinematics(scene).poses(np.radians([degrees]))[0]
    weight = cable.linear_density * scene.gravity
    conditions = Conditions(*relative(poses, np.array([1.0, 0, 0, 0]), weight, unit.length, unit.force))
    found = equilibria(cable.stiffness / unit.stiffness, None, conditions, twist, thorough=False)
    return min(found, key=lambda one: abs(one.twist - twist))


def on_equal(found: Found, order: int, count: int) -> Found:
    finer = on_mesh(found, Mesh(reference_element(order), np.full(count, 1.0 / count)))
    assert finer is not None
    return finer


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--angle", type=float, default=90.0, help="of the orientation joint, degrees")
    parser.add_argument("--twist", type=float, default=-3.69, help="total twist of the branch, rad")
    arguments = parser.parse_args()
    reference = on_equal(equilibrium(arguments.angle, arguments.twist), 8, 16)

    errors = np.empty((len(COUNTS), len(ORDERS)))
    for i, count in enumerate(COUNTS):
        for j, order in enumerate(ORDERS):
            found = on_equal(reference, order, count)
            force = np.linalg.norm(found.F - reference.F) / np.linalg.norm(reference.F)
            moment = np.linalg.norm(found.rod.g[-1] - reference.rod.g[-1])
            errors[i, j] = max(force, moment / np.linalg.norm(reference.rod.g[-1]))
    print("| elements | " + " | ".join(f"p = {order}" for order in ORDERS) + " |")
    print("|---" * (len(ORDERS) + 1) + "|")
    for count, row in zip(COUNTS, errors, strict=True):
        print(f"| {count} | " + " | ".join(f"{error:.1e}" for error in row) + " |")
    for (a, b), (first, second) in zip(pairwise(COUNTS), pairwise(errors), strict=True):
        rates = np.log(first / second) / np.log(b / a)
        print(f"| rate, {a} to {b} | " + " | ".join(f"{rate:.1f}" for rate in rates) + " |")
    return 0


if __name__ == "__main__":
    sys.exit(main())
