# SPDX-License-Identifier: Apache-2.0
"""Experiments of cosseratbench 0.3.0, which nobody here wrote, with our solver; for docs/cosseratbench.md.

Needs, in an environment of its own, this package's requirements and, for the others in the table,

    pip install cosseratbench[all]==0.3.0 'mujoco<4'

MuJoCo 4 no longer has the cable plugin that cosseratbench drives. Ours is a solver of cosseratbench,
`Statics`, where an experiment asks for a shape. `twist` watches rods buckle in time: there our answer is the
twist at which the stability margin is zero, extrapolated from smaller ones. `capstan` has a rope without held
ends: a hand holds ours, and gives way until it bears nothing.

    OMP_NUM_THREADS=1 taskset -c 1 python benchmarks/cosserat_bench.py
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Iterator
from dataclasses import replace
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
from cosseratbench.experiment import run
from cosseratbench.experiments import cantilever, capstan, catenary, crossing, twist
from cosseratbench.metrics import max_distance_to_curve
from cosseratbench.registry import load_solver
from cosseratbench.scenario import Cylinder, EndCondition, Material, Rod, Scenario
from cosseratbench.solver import Capability
from cosseratbench.trajectory import Trajectory
from scipy.integrate import solve_bvp
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from cable_ros import Equilibrium, Status, Tracker, load_scene
from cable_ros.bench.machine import describe
from cable_ros.bench.markdown import markdown_table, write_between
from cable_ros.joint import joint_load

ROOT = Path(__file__).parents[1]
TOLERANCE = 1e-6
FREE_MOMENT = 1e-8
"""Moment, over the largest one before the ends were released, that counts as none."""
LIFTED = 0.4
"""Height, m, from which the upper of two ropes comes down."""
DROP = 0.05
"""Height, m, that the upper of two ropes is held up by; from about 0.08 on the symmetric equilibrium of the
reference is no minimum of the energy: without friction the lower rope slips aside along the upper one."""
MOST_TURNS = 12
"""Maximum number of steps in which the ends are released."""
ROPE_TOLERANCE = 3e-5
"""Of the rope over a cylinder: what sticks there yields the less, the smaller it is."""
SCALE = 10.0
"""Of that rope's weight and stiffness, so of all its forces: no scene has a stiffness below 1e-6 N m^2."""
ABOVE = 0.01
"""Height, m, of the hand that holds that rope over the top of the cylinder at first."""
TURN, LOWER = 0.07, 0.02
"""Rad and m between two poses as the hand draws the rope over the cylinder."""
BARELY, NOTHING = 1e-3, 1e-6
"""Force on the hand, over the rope's weight, at which it slides by itself, and that counts as none."""


def cable(rod: Rod) -> dict[str, Any]:
    """The section of a rod in our scene's terms, which keeps its length."""
    bending = rod.material.youngs_modulus * rod.second_moment_of_area
    return {
        "name": "rod", "length": rod.length, "linear_density": rod.material.density * rod.area,
        "stiffness": [bending, bending, 2.0 * rod.material.shear_modulus * rod.second_moment_of_area],
    }  # fmt: skip


def clamp(point: np.ndarray, tangent: np.ndarray, normal: np.ndarray) -> dict[str, Any]:
    """A clamp whose z axis is the tangent, and whose x axis is as near to the normal as it can be."""
    z = tangent / np.linalg.norm(tangent)
    x = normal - (normal @ z) * z
    x /= np.linalg.norm(x)
    turn = Rotation.from_matrix(np.stack([x, np.cross(z, x), z], axis=1))
    return {"position": [float(v) for v in point], "orientation": turn.as_quat().tolist()}


def solved(gravity: Any, one: dict[str, Any], points: int, tolerance: float = TOLERANCE) -> Equilibrium:
    """The equilibrium of a scene with this cable."""
    mapping = {"gravity": [float(v) for v in gravity], "cables": [one]}
    found = Tracker(load_scene(mapping), tolerance, points).arrive({})["rod"]
    if not found.status.trusted:
        raise RuntimeError(found.message)
    return found


class Statics:
    """A cosseratbench solver that goes to the end at once: every frame is the equilibrium."""

    name = "cable_ros"
    capabilities = frozenset({
        Capability.STRETCH, Capability.CYLINDER_CONTACT, Capability.PLANE_CONTACT, Capability.ROD_CONTACT
    })  # fmt: skip

    slides_at: float | None = None
    """Overhang at which the last rope over a cylinder slid, over the reference's."""

    def run(self, scenario: Scenario, *, n_elements: int, n_frames: int) -> Trajectory:
        """See `cosseratbench.solver.Solver`; n_elements is the number of the polyline's pieces only.

        Raises:
            NotImplementedError: moving ends, or ends that we do not have.
        """
        if any(rod.start_motion or rod.end_motion for rod in scenario.rods):
            raise NotImplementedError("ends that move")
        if len(scenario.rods) > 1:
            return trajectory(scenario, crossed(scenario, 2 * n_elements + 1), n_frames)
        rod = scenario.rods[0]
        if scenario.obstacles:
            draped = Draped(scenario, 2 * n_elements + 1)
            drawn, left = draped.let_go()
            self.slides_at = draped.limit(drawn)
            there, before = trajectory(scenario, [left], n_frames), trajectory(scenario, [drawn], 1)
            for rods, first in ((there.positions, before.positions), (there.directors, before.directors)):
                rods[0][0] = first[0][0]
            # the experiment's rope begins at its light end, ours at the hand
            return Trajectory(there.times, (there.positions[0][:, ::-1],), (there.directors[0][:, ::-1],))
        nodes, normal = rod.nodes(4 * n_elements), rod.directors(4 * n_elements)
        start = clamp(nodes[0], nodes[1] - nodes[0], normal[0])
        end = clamp(nodes[-1], nodes[-1] - nodes[-2], normal[-1])
        ends, points = (rod.start, rod.end), 2 * n_elements + 1
        if ends == (EndCondition.CLAMPED, EndCondition.FREE):
            force = np.sum([load.force for load in rod.loads], axis=0)
            free = {"kind": "free", "force": [float(v) for v in force]}
            found = solved(scenario.gravity, cable(rod) | {"start": start, "end": free}, points)
        elif ends == (EndCondition.PINNED, EndCondition.PINNED):
            pins = {"start": start | {"kind": "pinned"}, "end": end | {"kind": "pinned"}}
            stretch = {"axial_stiffness": rod.material.youngs_modulus * rod.area}
            found = solved(scenario.gravity, cable(rod) | stretch | pins, points)
        else:
            raise NotImplementedError("a cantilever, or pins at both ends")
        return trajectory(scenario, [found], n_frames)


def trajectory(scenario: Scenario, found: list[Equilibrium], n_frames: int) -> Trajectory:
    """Rods that rest."""
    every, x = (n_frames, 1, 1), [1.0, 0.0, 0.0]
    return Trajectory(
        np.linspace(0.0, scenario.duration, n_frames),
        tuple(np.tile(one.points[::2], every) for one in found),
        tuple(np.tile(Rotation.from_quat(one.orientations[1::2]).apply(x), every) for one in found),
    )


def jointed(name: str, kind: str, parent: str, at: np.ndarray, axis: np.ndarray) -> str:
    """URDF of a link with the joint of the same name that carries it at a place of its parent."""
    place, along = (" ".join(repr(float(v)) for v in vector) for vector in (at, axis))
    return (
        f'<link name="{name}"/>'
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{name}"/>'
        f'<origin xyz="{place}"/><axis xyz="{along}"/>'
        '<limit lower="-10" upper="10" effort="1" velocity="1"/></joint>'
    )


class Draped:
    """A rope over a rough cylinder, whose light end is free, while a hand holds the heavy one.

    The hand has drawn the rope over the cylinder, against friction, until as much hangs on the light side as
    asked for. Then it gives way until it bears nothing: no force, and a clamp at a rope that hangs straight
    has no other. The rope does not stretch: ours does not where a free end goes with rough obstacles.
    """

    def __init__(self, scenario: Scenario, points: int) -> None:
        (rod,), (cylinder,) = scenario.rods, scenario.obstacles
        assert isinstance(cylinder, Cylinder)
        self.wrap, self.friction = cylinder.radius + rod.radius, cylinder.friction
        self.weight = SCALE * rod.material.density * rod.area * float(np.linalg.norm(scenario.gravity))
        self.length, self.light = rod.length, -rod.centerline[0][2]
        heavy = {k: SCALE * v for k, v in vars(rod.material).items()}
        rope = cable(replace(rod, material=Material(**heavy))) | {"outer_diameter": 2.0 * rod.radius}
        rope["start"] = {"link": "reach"} | clamp(np.zeros(3), -np.eye(3)[0], np.eye(3)[1])
        axis = 0.5 * cylinder.length * np.array(cylinder.axis)
        drum = {"start": (-axis).tolist(), "end": axis.tolist(), "radius": cylinder.radius}
        scene = {
            "gravity": [float(v) for v in scenario.gravity], "robot": {"urdf": "hand.urdf"},
            "obstacles": [{"name": "cylinder", "cylinder": drum, "friction": cylinder.friction}],
            "cables": [rope | {"end": {"kind": "free"}}],
        }  # fmt: skip
        at, (x, y, z) = np.zeros(3), np.eye(3)
        urdf = (
            '<robot name="hand"><link name="world"/>' + jointed("turn", "revolute", "world", at, y)
            + jointed("rise", "prismatic", "turn", at, z) + jointed("reach", "prismatic", "rise", at, x)
            + "</robot>"
        )  # fmt: skip
        self.tracker = Tracker(load_scene(scene, urdf=urdf), ROPE_TOLERANCE, points)

    def at(self, turn: float, reach: float) -> Equilibrium:
        """With the hand turned about the cylinder from its top, and reaching on from there by so many m."""
        rise = self.wrap + ABOVE * max(0.0, 1.0 - 5.0 * reach)
        found = self.tracker.arrive({"turn": turn, "rise": rise, "reach": reach})["rod"]
        # a pose that is not met to the tolerance is passed by: the branch goes on
        if found.status not in (Status.CONVERGED, Status.NOT_CONVERGED):
            raise RuntimeError(found.message)
        return found

    def pull(self, found: Equilibrium) -> float:
        """Of the rope on the hand, upward, as a length of rope that weighs as much, m."""
        return float(found.start_wrench[2]) / self.weight

    def drawn(self) -> tuple[Equilibrium, float]:
        """As it slides, with what is to hang on the light side, and how far the hand reaches then.

        Raises:
            RuntimeError: it slides by itself before.
        """
        for turn in np.arange(0.0, 0.5 * np.pi, TURN):
            self.at(float(turn), 0.0)
        end, reach = self.length - np.pi * self.wrap - self.light, 0.0
        pull = math.inf
        while reach < end:
            # near the end the pull falls by several times what the hand goes on
            reach = min(reach + min(LOWER, 0.1 * pull), end)
            found = self.at(0.5 * np.pi, reach)
            pull = self.pull(found) if found.status is Status.CONVERGED else pull
            if pull < BARELY * self.length:
                hangs = -found.points[-1, 2]
                raise RuntimeError(f"It slides off by itself where {reach:.4f} m hang beside {hangs:.4f} m.")
        return found, reach

    def let_go(self) -> tuple[Equilibrium, Equilibrium]:
        """As it slides, and as it hangs when the hand bears nothing."""
        drawn, reach = self.drawn()
        before, up = self.pull(drawn), 1e-6 * self.length
        while abs(before) > NOTHING * self.length:
            reach -= up
            found = self.at(0.5 * np.pi, reach)
            if found.status is not Status.CONVERGED:
                raise RuntimeError(found.message)
            now = self.pull(found)
            up, before = now * up / (before - now), now
        return drawn, found

    def limit(self, found: Equilibrium) -> float:
        """Overhang at which it slides, over the reference's for as much on the light side."""
        heavy, light = -found.points[[0, -1], 2]
        return float(heavy + self.pull(found)) / capstan.holding_overhang(self.friction, float(light))


def crossed(scenario: Scenario, points: int) -> list[Equilibrium]:
    """Two ropes between pins: each pin is a joint, whose torque is zero; the second rope comes from above.

    Pins do not go with cables that touch: Newton's method turns the joints by their exact stiffness.
    """
    lift, cables = jointed("lift", "prismatic", "world", np.zeros(3), np.eye(3)[2]), []
    links = ['<link name="world"/>', lift]
    for rod, parent in zip(scenario.rods, ("world", "lift"), strict=True):
        nodes, normal = rod.nodes(200), np.array(rod.normal)
        own = cable(rod) | {"name": parent, "outer_diameter": 2.0 * rod.radius}
        own["axial_stiffness"] = rod.material.youngs_modulus * rod.area
        for end, point, tangent in (
            ("start", nodes[0], nodes[1] - nodes[0]), ("end", nodes[-1], nodes[-1] - nodes[-2])
        ):  # fmt: skip
            links.append(jointed(f"{parent}_{end}", "revolute", parent, point, normal))
            own[end] = {"link": f"{parent}_{end}"} | clamp(np.zeros(3), tangent, normal)
        cables.append(own)
    scene = {
        "gravity": list(scenario.gravity), "robot": {"urdf": "pins.urdf"},
        "cable_contact": True, "cables": cables,
    }  # fmt: skip
    urdf = f'<robot name="pins">{"".join(links)}</robot>'
    tracker = Tracker(load_scene(scene, urdf=urdf), TOLERANCE, points)
    at = dict.fromkeys(tracker.joint_names, 0.0)
    pins = [k for k, name in enumerate(tracker.joint_names) if name != "lift"]
    first = None
    for at["lift"] in (*np.linspace(LIFTED, 0.0, 11), *[0.0] * MOST_TURNS):
        found = tracker.arrive(at)
        if not all(one.status.trusted for one in found.values()):
            raise RuntimeError(" ".join(one.message for one in found.values()))
        if at["lift"] > 0.0:
            continue
        torque, stiffness = joint_load(tracker, found, at)
        first = np.abs(torque[pins]).max() if first is None else first
        if np.abs(torque[pins]).max() < FREE_MOMENT * first:
            return list(found.values())
        turns = np.linalg.solve(stiffness[np.ix_(pins, pins)], -torque[pins])
        for k, turn in zip(pins, turns / max(1.0, np.abs(turns).max() / 0.3), strict=True):
            at[tracker.joint_names[k]] += float(turn)
    raise RuntimeError("The pins still carry a moment.")


def critical_twist(tension: float = 10.0) -> float:
    """The twist at which the margin is zero, over the reference's; tension in EI / L^2, as in `twist`."""
    straight = Rod(((0.0, 0.0, 0.0), (twist.LENGTH, 0.0, 0.0)), twist.RADIUS, twist.MATERIAL)
    one, reference = cable(straight), twist.critical_twist(straight, tension)
    x, z = np.eye(3)[0], np.eye(3)[2]
    pull = tension * one["stiffness"][0] / twist.LENGTH**2

    def margin(share: float) -> float:
        angle = share * reference
        turned = np.cos(angle) * z + np.sin(angle) * np.cross(x, z)
        end = clamp(x * twist.LENGTH, x, turned) | {"kind": "sliding", "axial_force": float(pull)}
        whole = one | {"start": clamp(np.zeros(3), x, z), "end": end, "total_twist": float(angle)}
        found = solved(np.zeros(3), whole, 11, 1e-8)
        if abs(found.total_twist - angle) > 1e-3:
            raise RuntimeError("the cold start found another branch")
        return found.stability_margin

    # nearer to zero a cold start prefers the branch with a turn less
    shares = (0.80, 0.85, 0.90, 0.95)
    return float(np.polyval(np.polyfit([margin(share) for share in shares], shares, len(shares) - 1), 0.0))


def exact_deflection(rod: Rod, force: float) -> float:
    """Of a cantilever's tip under a force across it, of fixed length: the elastica by collocation."""
    ratio = force * rod.length**2 / (rod.material.youngs_modulus * rod.second_moment_of_area)
    s = np.linspace(0.0, 1.0, 50)
    found = solve_bvp(
        lambda s, y: np.array([y[1], -ratio * np.cos(y[0]), np.sin(y[0])]),
        lambda a, b: np.array([a[0], b[1], a[2]]),
        s, np.array([ratio * s, ratio * (1 - s), 0.5 * ratio * s**2]), tol=1e-10,
    )  # fmt: skip
    return float(found.y[2, -1]) * rod.length


def rod_error(name: str, scenario: Scenario, trajectory: Trajectory) -> float:
    """Error against the rod's own equations, bending and large deflections included; NaN where we have none.

    `cantilever`: relative, of the tip's deflection. `catenary`: largest distance of a node from the curve by
    cosseratbench's boundary-value problem of the elastica, in lengths of the rod. `crossing`: of a node from
    its own place on that curve.
    """
    ends = [positions[-1] for positions in trajectory.positions]
    if name == "cantilever":
        exact = exact_deflection(scenario.rods[0], cantilever.FORCE)
        return abs(float(-ends[0][-1, 2]) / exact - 1.0)
    if name == "catenary":
        _, half = crossing._elastica(scenario.rods[0].material.youngs_modulus, 0.0)
        curve = np.zeros((2 * len(half) - 1, 3))
        curve[:, [0, 2]] = np.concatenate([half, [crossing.SPAN, 0.0] + half[-2::-1] * [-1.0, 1.0]])
        return max_distance_to_curve(ends[0], curve) / scenario.rods[0].length
    if name == "crossing":
        arc, *curves = crossing._shapes(*crossing._parameters(scenario), 2.0 * crossing.RADIUS)
        own = (np.linspace(0.0, crossing.LENGTH, len(end)) for end in ends)
        pairs = zip(ends, curves, own, strict=True)
        return max(float(np.abs(CubicSpline(arc, curve)(at) - end).max()) for end, curve, at in pairs)
    return float("nan")


def others(names: tuple[str, ...]) -> Iterator[tuple[str, ...]]:
    """Rows of the table: what cosseratbench itself finds of the solvers."""
    for module in (cantilever, catenary, twist, capstan, crossing):
        experiment = vars(module)[module.__name__.rpartition(".")[2]]
        for solver in (Statics(), *(load_solver(name) for name in names)):
            values = {"drop": DROP} if module is crossing else {}
            name = f"{experiment.name}, drop {DROP:g}" if values else experiment.name
            result = run(experiment, solver, values=values)
            if result.trajectory is None:
                why = result.failure or f"not there: {', '.join(result.missing)}"
                if solver.name == Statics.name and module is twist:
                    begin = time.perf_counter()
                    error = abs(critical_twist() - 1.0)
                    yield _row(
                        "twist", solver.name, f"critical_twist_error {error:.1e}", time.perf_counter() - begin
                    )
                    continue
                yield _row(name, solver.name, why, result.wall_time)
                continue
            told = [
                f"{key} {value:.1e}" for key, value in result.metrics.items() if key != "settling_residual"
            ]
            if isinstance(solver, Statics) and module is capstan:
                told.append(f"slides at {solver.slides_at:.3f} of the reference's overhang")
            scenario = crossing.build(1e6, DROP) if module is crossing else experiment.scenario
            error = rod_error(experiment.name, scenario, result.trajectory)
            yield _row(name, solver.name, ", ".join(told), result.wall_time, error)


def _row(
    experiment: str, solver: str, told: str, seconds: float | None, error: float = math.nan
) -> tuple[str, ...]:
    return (
        experiment, solver, told, "" if math.isnan(error) else f"{error:.1e}",
        "" if seconds is None else f"{seconds:.0f} s" if seconds > 10.0 else f"{seconds:.2g} s",
    )  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--beside", nargs="*", default=["pyelastica", "mujoco"], help="cosseratbench's solvers"
    )
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "cosseratbench.md")
    args = parser.parse_args()
    rows = []
    for row in others(tuple(args.beside)):
        rows.append(row)
        print("  ".join(row), flush=True)
    head = ("experiment", "solver", "by cosseratbench's measure", "against the rod's equations", "wall time")
    versions = {name: metadata.version(name) for name in ("cosseratbench", *args.beside)}
    facts = ", ".join(f"{name} {fact}" for name, fact in (describe() | versions).items())
    write_between(args.out, "cosseratbench", f"{markdown_table(head, rows)}\n\nOne run: {facts}.\n")


if __name__ == "__main__":
    main()
