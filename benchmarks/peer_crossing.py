# SPDX-License-Identifier: Apache-2.0
"""Two cables that cross under their weight, beside MuJoCo's native 1D flex as it is refined.

Needs, in an environment of its own, this package's requirements and

    pip install mujoco==4.0.0

The scene is the first one of docs/cable_contact.md, into which the table goes. MuJoCo starts with the upper
cable `LIFT` above the lower one, both in the shapes that they have alone, and lowers its clamps.

    OMP_NUM_THREADS=1 python benchmarks/peer_crossing.py
"""

from __future__ import annotations

import argparse
import time
from importlib import metadata
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from peer_arm import Chain, clamped
from peer_mujoco import EndClamp, Strand, model_of
from scipy.spatial.transform import Rotation, Slerp

from cable_ros import Equilibrium, Tracker, load_scene
from cable_ros.bench.machine import describe
from cable_ros.bench.markdown import markdown_table, write_between
from cable_ros.scene.text import parse_yaml

PAGE = Path(__file__).parents[1] / "docs" / "cable_contact.md"
NEIGHBOURS = 6
"""Numbers of edges tried from each one on: an answer depends on where the nodes are beside the contact."""
LIFT = 0.03
"""Height from which the upper cable comes down, m."""
STEPS = ((0.02, 200, 600), (0.01, 0, 600))
"""Time step, s, steps in which the cable comes down, and in which both come to rest: the contact gives way by
the square of the step, but with the short one alone they swing for long."""
CONTACT = 'contype="1" conaffinity="1" condim="1" solref="-1e8 -2e4" solimp="0.9999 0.9999 0.001 0.5 2"'
"""As stiff as it gets, without friction."""
RESTING = 1e-4
"""Speed of a node, m/s, below which a cable rests: a step moves it by less than a micrometre."""


def pose(held: dict[str, Any]) -> np.ndarray:
    """(7,) of a clamp of the scene: position, quaternion x y z w."""
    return np.concatenate([held["position"], Rotation.from_euler("xyz", held["rpy"]).as_quat()])


def strand(cable: dict[str, Any], edges: int) -> Strand:
    """A cable of the scene, with so many edges."""
    edge, radius = cable["length"] / (edges - 1), 0.5 * cable["outer_diameter"]
    bending, _, torsion = cable["stiffness"]
    return Strand(
        cable["name"], pose(cable["start"]), edges, edge, cable["linear_density"] * edge, radius,
        bending / (np.pi * radius**4 / 4), torsion / (np.pi * radius**4 / 2),
    )  # fmt: skip


class Crossing:
    """Both cables in MuJoCo, with so many edges each, at rest on each other."""

    def __init__(self, scene: dict[str, Any], edges: int, alone: list[Equilibrium]) -> None:
        begin, gravity = time.perf_counter(), np.array(scene["gravity"], float)
        cables, step = scene["cables"], STEPS[0][0]
        self._edges, self._held = edges, [[pose(cable[end]) for end in ("start", "end")] for cable in cables]
        self._strands = [strand(cable, edges) for cable in cables]
        parts = [one.xml(lifted=True, contact=CONTACT) for one in self._strands]
        self._model = model_of(parts, [one.name for one in self._strands], step, gravity)
        self._data = mujoco.MjData(self._model)
        self._ends = [EndClamp(one, step, gravity) for one in self._strands]
        self._place(alone)
        self._settle()
        self.seconds = time.perf_counter() - begin
        self._contacts = [self._data.contact[i] for i in range(self._data.ncon)]
        self._normal = np.zeros(len(self._contacts))
        for i in range(len(self._normal)):
            force = np.zeros(6)
            mujoco.mj_contactForce(self._model, self._data, i, force)
            self._normal[i] = force[0]

    def _place(self, alone: list[Equilibrium]) -> None:
        """The cables in the shapes that they have alone, the second lifted."""
        model, data = self._model, self._data
        mujoco.mj_step(model, data)  # fills the reference frames of the straight rods
        axes = [data.plastic[a + 3 : a + 6].copy() for a in model.flex_plasticadr]
        mujoco.mj_resetData(model, data)
        for k, (one, found) in enumerate(zip(self._strands, alone, strict=True)):
            n, turn = self._edges, Rotation.from_quat(one.start[3:])
            known = np.linspace(0.0, 1.0, len(found.points))
            nodes, middles = (np.arange(n + 1) - 0.5) / (n - 1), np.arange(n) / (n - 1)
            points = np.column_stack([np.interp(nodes, known, column) for column in found.points.T])
            points[:2], points[-2:] = (clamped(held, one.edge) for held in self._held[k])
            frames = Slerp(known, Rotation.from_quat(found.orientations))(middles)
            chain = Chain(one.edge, points + [0.0, 0.0, k * LIFT], frames)
            tangents, across, twists = chain.material(turn.inv().apply(axes[k]))
            data.plastic[self._plastic(k)] = np.r_[np.hstack([tangents, across]).ravel(), twists]
            begin = k * (4 * n - 11)
            data.qpos[begin : begin + 3 * (n - 3)] = (chain.points - one.rest)[2:-2].ravel()
            for i, held in enumerate(self._held[k]):
                data.mocap_quat[2 * k + i] = held[[6, 3, 4, 5]]
                data.mocap_pos[2 * k + i] = held[:3] + [0.0, 0.0, k * LIFT]

    def _plastic(self, k: int) -> slice:
        begin = self._model.flex_plasticadr[k]
        return slice(begin, begin + 7 * self._edges - 1)

    def _settle(self) -> None:
        model, data = self._model, self._data
        for step, falling, resting in STEPS:
            model.opt.timestep = step
            for i in range(falling):
                for end, held in enumerate(self._held[1]):
                    data.mocap_pos[2 + end] = held[:3] + [0.0, 0.0, LIFT * (1.0 - (i + 1) / falling)]
                mujoco.mj_step(model, data)
            for _ in range(resting):
                mujoco.mj_step(model, data)
        mujoco.mj_forward(model, data)
        if not (data.ncon and np.abs(data.qvel).max() < RESTING):
            raise RuntimeError(f"MuJoCo's cables of {self._edges} edges do not rest on each other.")

    @property
    def position(self) -> np.ndarray:
        """(3,) where they touch, m: the middle of all contacts, by their forces."""
        return self._normal @ [one.pos for one in self._contacts] / self._normal.sum()

    @property
    def force(self) -> np.ndarray:
        """(3,) on the first cable, N."""
        signs = [1.0 if one.flex[1] == 0 else -1.0 for one in self._contacts]
        return self._normal * signs @ [one.frame[:3] for one in self._contacts]

    @property
    def depth(self) -> float:
        """How deep the surfaces are in each other, m."""
        return -min(one.dist for one in self._contacts)

    def end_wrench(self, k: int) -> np.ndarray:
        """(6,) of a cable on its end clamp, along the clamp's axes, N and N m."""
        data, n = self._data, self._edges
        points = data.flexvert_xpos[k * (n + 1) : (k + 1) * (n + 1)]
        hinges = k * (4 * n - 11) + 3 * (n - 3)
        tension = data.efc_force[k * (n - 2) + n - 3]
        wrench = self._ends[k].wrench(
            points, data.plastic[self._plastic(k)], data.qpos[hinges : hinges + n - 2], tension
        )
        back = Rotation.from_quat(self._held[k][1][3:]).inv()
        return -back.apply(wrench.reshape(2, 3)).ravel()

    @property
    def answer(self) -> np.ndarray:
        """(18,) position, contact force and both end wrenches."""
        return np.concatenate([self.position, self.force, self.end_wrench(0), self.end_wrench(1)])


def answer_of(found: list[Equilibrium], radius: float) -> np.ndarray:
    """The same of ours; `radius`, m: of the first cable."""
    (one,), (other,) = (cable.contacts for cable in found)
    between = other.position - one.position
    position = one.position + radius * between / np.linalg.norm(between)
    return np.concatenate([position, one.force, *(cable.end_wrench for cable in found)])


def differences(answer: np.ndarray, ours: np.ndarray) -> np.ndarray:
    """(4,): position, m; contact force, end force and end moment over ours, of the worse cable."""
    off, own = (np.linalg.norm(x.reshape(-1, 3), axis=1) for x in (answer - ours, ours))
    part = off / own
    return np.array([off[0], part[1], part[[2, 4]].max(), part[[3, 5]].max()])


def solved(scene: dict[str, Any], tolerance: float) -> tuple[list[Equilibrium], float]:
    """Both cables, and how long a cold start took, s."""
    found, times = {}, []
    for _ in range(3):
        tracker = Tracker(load_scene(scene), tolerance, 2001)
        begin = time.perf_counter()
        found = tracker.arrive({})
        times.append(time.perf_counter() - begin)
    return list(found.values()), min(times)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--edges", type=int, nargs="+", default=[20, 40, 80, 160], help="of each cable")
    parser.add_argument("--no-write", action="store_true", help="leave the page as it is")
    args = parser.parse_args()
    scene: Any = parse_yaml(PAGE.read_text().split("```yaml\n")[1].split("```")[0], PAGE.name)
    alone, _ = solved(scene | {"cable_contact": False}, 1e-8)
    ours, seconds = solved(scene, 1e-8)
    _, usual = solved(scene, 1e-4)
    exact, rows = answer_of(ours, 0.5 * scene["cables"][0]["outer_diameter"]), []
    for edges in args.edges:
        trials = [Crossing(scene, n, alone) for n in range(edges, edges + NEIGHBOURS)]
        each = np.array([differences(one.answer, exact) for one in trials])
        mean = differences(np.mean([one.answer for one in trials], axis=0), exact)
        depth, spent = max(one.depth for one in trials), np.mean([one.seconds for one in trials])
        (place, *parts), (worst_place, *worst) = mean, each.max(axis=0)
        rows.append([
            f"{edges} to {edges + NEIGHBOURS - 1}", f"{1e3 * place:.2g}, {1e3 * worst_place:.2g} mm",
            *(f"{100 * a:.2g}, {100 * b:.2g} %" for a, b in zip(parts, worst, strict=True)),
            f"{1e3 * depth:.1g} mm", f"{spent:.2g} s",
        ])  # fmt: skip
    head = ["edges", "where they touch", "contact force", "end force", "end moment", "penetration", "time"]
    about = ", ".join(f"{name} {value}" for name, value in describe().items())
    text = (
        f"{markdown_table(head, rows)}\n\n"
        f"Ours, from nothing: {seconds:.2g} s at a tolerance of 1e-8, {usual:.2g} s at 1e-4. "
        f"One run: {about}, mujoco {metadata.version('mujoco-core')}.\n"
    )
    print(text)
    if not args.no_write:
        write_between(PAGE, "beside MuJoCo", text)


if __name__ == "__main__":
    main()
