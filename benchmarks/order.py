# SPDX-License-Identifier: Apache-2.0
"""Which element: order and quadrature against the time of a step, for the space arm's cable.

    taskset -c 2,3 python benchmarks/order.py        # half a minute

Equal elements of every order; the error is the worst of seven poses, against sixteen elements of order 8;
the time is that of a warm step that assembles and factors a new tangent, the lower quartile of 420. Prints,
for each element, the number of them and the time that a given error takes, interpolated between whole numbers
of elements.
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from tqdm import tqdm

from cable_ros import load_scene
from cable_ros.bench.machine import describe
from cable_ros.branch.cold_start import Conditions, Found, equilibria
from cable_ros.branch.refinement import on_mesh
from cable_ros.rod.elements import Mesh, reference_element
from cable_ros.rod.kirchhoff import Rod
from cable_ros.rod.units import Units, relative
from cable_ros.scene import Cable, Kinematics, Scene
from cable_ros.share import share_file

ERRORS = (1e-3, 1e-4, 1e-6, 1e-8)
POSES = np.radians([-90.0, -60.0, -30.0, 0.0, 30.0, 60.0, 90.0])
STEP, STEPS = np.radians(0.5), 60
IDENTITY = np.array([1.0, 0.0, 0.0, 0.0])


@dataclass(frozen=True)
class Measured:
    """One mesh."""

    elements: int
    error: float
    seconds: float


class Arm:
    """The arm's cable in its own units, at any angle."""

    def __init__(self, scene: Scene) -> None:
        self.cable: Cable = scene.cables[0]
        self._kinematics = Kinematics(scene)
        bending = float(np.sqrt(self.cable.stiffness[0] * self.cable.stiffness[1]))
        self._units = Units(self.cable.length, bending)
        self.stiffness = self.cable.stiffness / self._units.stiffness
        self._weight = self.cable.linear_density * scene.gravity

    def conditions(self, angle: float) -> Conditions:
        (poses,) = self._kinematics.poses(np.array([angle]))
        return Conditions(*relative(poses, IDENTITY, self._weight, self._units.length, self._units.force))

    def equilibrium(self, angle: float) -> Found:
        """On the branch of the scene, finely resolved."""
        target_twist = self.cable.total_twist
        found = equilibria(self.stiffness, None, self.conditions(angle), target_twist, 1e-4, thorough=True)
        nearest = min(found, key=lambda one: abs(one.twist - (target_twist or 0.0)))
        fine = on_mesh(nearest, Mesh(reference_element(8), np.full(16, 1 / 16)))
        assert fine is not None
        return fine


def wrench(found: Found) -> np.ndarray:
    """(2, 3) end force and end moment in units of the cable."""
    found.rod.linearize(found.q, found.F)
    return np.array([found.F, found.rod.g[-1]])


def measure(arm: Arm, exact: list[Found], order: int, quadrature: int, elements: int) -> Measured | None:
    """Worst error over the poses and time of a step; None where a coarse mesh has no such equilibrium."""
    mesh = Mesh(reference_element(order, quadrature), np.full(elements, 1 / elements))
    worst, seconds = 0.0, []
    for angle, true in zip(POSES, exact, strict=True):
        found = on_mesh(true, mesh)
        if found is None:
            return None
        size = np.linalg.norm(wrench(true), axis=1)
        worst = max(worst, float(np.max(np.linalg.norm(wrench(found) - wrench(true), axis=1) / size)))
        rod, target = found.rod, arm.conditions(angle + STEP)
        for _ in range(STEPS):
            rod.linearize(found.q, found.F)
            rod.factor(0.0)
            rod.rotation = np.inf  # so that the step makes them anew
            begin = time.perf_counter()
            advance(rod, found, target)
            seconds.append(time.perf_counter() - begin)
    return Measured(elements, worst, float(np.quantile(seconds, 0.25)))


def advance(rod: Rod, found: Found, to: Conditions) -> None:
    """One warm step, thrown away."""
    before = rod.qe, rod.re, rod.f
    rod.advance(found.q, found.F, to.qe, to.re, to.f, 1e-7)
    rod.set_conditions(*before)


def cost(series: list[Measured], error: float) -> tuple[float, float] | None:
    """Elements and seconds at that error, log-linear between the meshes around it."""
    for coarse, fine in pairwise(series):
        if fine.error <= error <= coarse.error:
            part = np.log(coarse.error / error) / np.log(coarse.error / fine.error)
            elements = coarse.elements + part * (fine.elements - coarse.elements)
            return elements, coarse.seconds + part * (fine.seconds - coarse.seconds)
    return None


def main() -> int:
    argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    ).parse_args()
    print(", ".join(f"{name} {fact}" for name, fact in describe().items()))
    arm = Arm(load_scene(share_file("config", "space_arm.yaml")))
    exact = [arm.equilibrium(angle) for angle in POSES]
    elements = [(order, order) for order in range(2, 9)] + [(4, 5), (6, 5), (6, 7)]
    print("\n| order | Gauss points |" + "".join(f" {error:.0e} |" for error in ERRORS))
    print("|---|---|" + "---|" * len(ERRORS))
    for order, quadrature in tqdm(elements, unit=" elements", disable=None):
        counts = sorted({max(2, round(2 * 1.25**k)) for k in range(20)})
        series: list[Measured] = []
        for count in counts:
            if count * order > 150 or (series and series[-1].error < ERRORS[-1]):
                break
            one = measure(arm, exact, order, quadrature, count)
            if one is not None:
                series.append(one)
        cells = []
        for error in ERRORS:
            point = cost(series, error)
            cells.append(f" {point[0]:.1f}: {point[1] * 1e6:.0f} us |" if point else " - |")
        tqdm.write(f"| {order} | {quadrature} |" + "".join(cells))
    return 0


if __name__ == "__main__":
    sys.exit(main())
