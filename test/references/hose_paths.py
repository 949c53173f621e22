# SPDX-License-Identifier: Apache-2.0
"""Heavy hoses on rough ground, the lifted end led about: paths, scenes and references by `coulomb_rod`.

    python -m references.hose_paths [--resume]       # from test/; writes data/hose_paths.json, an hour

A hose lies on the ground z = 0 from its start clamp at the origin along X; its other end hangs on a hook that
three prismatic joints x, y, z and a revolute joint, turn, move. Each seed gives one path. It is kept if the
reference never jumps, its estimated error is below `GOOD` and a cold start of the tracker finds its first
equilibrium. The scene's `total_twist` selects that one, which is one of a pair if the hose has buckled.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path as File
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from cable_ros import Tracker, load_scene
from references.coulomb_rod import Led, Obstacle, Path, lead

FILE = File(__file__).parents[1] / "data" / "hose_paths.json"
JOINTS = ("x", "y", "z", "turn")
AXES = {"x": (1, 0, 0), "y": (0, 1, 0), "z": (0, 0, 1)}
GRAVITY = 9.80665
GRIDS = ((100, 1e-3), (200, 5e-4))
"""Segments and steps of both runs; the finer one is stored, their difference is its error. In steps of 6e-3
and 4e-3 both were off alike: by 1 to 4 % on seven paths, by 10 % where one turns round."""
GOOD = 0.03
"""Largest relative difference of the end forces of both runs in a path that is kept."""
TAUT = 4.0
"""Largest end force of a path that is kept, in weights of the hose."""
CUT = {"lengthwise_15": 11}
"""How many poses of a path are kept, of one that leads to a fold beyond them. At the 12th pose the force
across its plane is 0.525, 0.549 and 0.575 N with 100, 200 and 250 segments, and with 300 the rod jumps."""
KINDS = ("sideways", "lengthwise", "turned", "lifted", "round", "back", "mixed")


@dataclass(frozen=True)
class Hose:
    """A hose and the path of its hook; SI units."""

    name: str
    length: float
    stiffness: tuple[float, float, float]
    linear_density: float
    diameter: float
    friction: float
    tilt: float
    """Of the end clamp's tangent from the vertical towards X, rad, at turn = 0."""
    axis: str
    """Of the joint turn."""
    bent: tuple[float, float]
    """See `coulomb_rod.Path`."""
    push: float
    """Along Y while the first equilibrium is sought, N/m."""
    joints: tuple[tuple[float, float, float, float], ...]
    """x, y, z [m] and turn [rad] at every pose."""

    @property
    def start(self) -> list[float]:
        """(7,) pose of the start clamp."""
        return [0.0, 0.0, self.diameter / 2, *Rotation.from_euler("y", np.pi / 2).as_quat()]

    def path(self, friction: float | None = None) -> Path:
        """The same for the reference."""
        turn = Rotation.from_rotvec(np.outer([j[3] for j in self.joints], AXES[self.axis]))
        quaternions = (turn * Rotation.from_euler("y", self.tilt)).as_quat()
        ground = Obstacle(
            "plane", (0.0, 0.0, 0.0, 0.0, 0.0, 1.0), self.friction if friction is None else friction
        )
        return Path(
            self.length,
            np.array(self.stiffness),
            np.array([0.0, 0.0, -GRAVITY * self.linear_density]),
            np.array(self.start),
            np.hstack([np.array(self.joints)[:, :3], quaternions]),
            self.diameter / 2,
            (ground,),
            self.bent,
            push=np.array([0.0, self.push, 0.0]),
        )


@dataclass(frozen=True)
class Known:
    """A hose path and its reference."""

    hose: Hose
    total_twist: float
    """At the first pose, rad."""
    end_wrench: np.ndarray
    """(n, 6) what the cable exerts on the hook, in the end clamp's frame, N and N m."""
    error: np.ndarray
    """(n,) estimated relative error of the end force."""

    def scene(self) -> dict[str, Any]:
        """For `cable_ros.load_scene`, with `urdf`."""
        hose = self.hose
        base = [float(x) for x in Rotation.from_euler("y", hose.tilt).as_quat()]
        plane = {"point": [0.0, 0.0, 0.0], "normal": [0.0, 0.0, 1.0]}
        return {
            "gravity": [0.0, 0.0, -GRAVITY],
            "obstacles": [{"name": "ground", "plane": plane, "friction": hose.friction}],
            "cables": [
                {
                    "name": "hose",
                    "length": hose.length,
                    "stiffness": list(hose.stiffness),
                    "outer_diameter": hose.diameter,
                    "linear_density": hose.linear_density,
                    "total_twist": self.total_twist,
                    "start": {"position": hose.start[:3], "orientation": [float(x) for x in hose.start[3:]]},
                    "end": {"link": "hook", "position": [0.0, 0.0, 0.0], "orientation": base},
                }
            ],
        }

    def urdf(self) -> str:
        """The hook on its four joints."""
        links = ("world", "along", "across", "up", "hook")
        axes = [*AXES.values(), AXES[self.hose.axis]]
        parts = [f'<link name="{name}"/>' for name in links]
        for i, (name, axis) in enumerate(zip(JOINTS, axes, strict=True)):
            kind = "revolute" if name == "turn" else "prismatic"
            parts.append(
                f'<joint name="{name}" type="{kind}">'
                f'<parent link="{links[i]}"/><child link="{links[i + 1]}"/>'
                f'<axis xyz="{axis[0]} {axis[1]} {axis[2]}"/>'
                '<limit lower="-9" upper="9" effort="1" velocity="1"/></joint>'
            )
        return f'<robot name="hoist">{"".join(parts)}</robot>'

    def states(self) -> list[dict[str, float]]:
        """Joint values by name, pose by pose."""
        return [dict(zip(JOINTS, values, strict=True)) for values in self.hose.joints]


def issue(poses: int) -> Hose:
    """The hose of issue 10: y from 0 to 0.15 m in `poses` steps and on to -0.15 m in as many."""
    ys = [0.15 * k / poses for k in range(poses + 1)] + [0.15 - 0.3 * k / poses for k in range(1, poses + 1)]
    joints = tuple((1.6, rounded(y), 0.5, 0.0) for y in ys)
    return Hose(
        f"issue_10_{poses}", 2.0, (0.5, 0.5, 0.375), 0.5, 0.02, 0.5, 0.0, "z", (0.65, 0.95), 2.0, joints
    )


def random_hose(seed: int) -> Hose:
    """Amplitudes in lengths of the hose; the first pose leaves it slack by a few hundredths of its length."""
    rng = np.random.default_rng([10, seed])
    kind = KINDS[seed % len(KINDS)]
    length = rounded(rng.uniform(0.5, 3.0), 3)
    density = rounded(rng.uniform(0.1, 1.0), 3)
    bending = rounded(density * GRAVITY * length**3 / np.exp(rng.uniform(np.log(20.0), np.log(200.0))), 4)
    low = rounded(rng.uniform(0.4, 0.65), 3)
    bent = low, rounded(low + rng.uniform(0.25, 0.35), 3)
    tilt = rounded(rng.uniform(0.0, 1.0), 3)
    # the end of what lies flat, turns up over the arc and is straight from there
    rise = np.pi / 2 - tilt
    arc = (bent[1] - bent[0]) / rise
    home = np.array([low + arc * np.sin(rise), 0.0, arc * (1 - np.cos(rise)), 0.0])
    home += (1 - bent[1]) * np.array([np.cos(rise), 0.0, np.sin(rise), 0.0])
    home += [-rng.uniform(0.0, 0.02), rng.uniform(-0.06, 0.06), -rng.uniform(0.0, 0.03), 0.0]
    count = int(rng.integers(15, 41))
    ways = np.array(_ways(kind, rng))
    lengths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(ways, axis=0), axis=1))])
    at = np.linspace(0.0, lengths[-1], count)
    offsets = np.stack([np.interp(at, lengths, ways[:, i]) for i in range(4)], axis=1)
    values = (home + offsets) * [length, length, length, 1.0]
    name = f"{kind}_{seed}"
    return Hose(
        name,
        length,
        (bending, bending, rounded(bending * rng.uniform(0.6, 1.0), 4)),
        density,
        rounded(0.01 * length, 3),
        rounded(rng.uniform(0.1, 0.8), 3),
        tilt,
        str(rng.choice(list(AXES))),
        bent,
        rounded(rng.choice([-0.3, 0.3]) * density * GRAVITY, 3),
        tuple(tuple(rounded(x) for x in row) for row in values[: CUT.get(name)]),  # type: ignore[misc]
    )


def _ways(kind: str, rng: np.random.Generator) -> list[np.ndarray]:
    """Way points (x, y, z, turn) from home, which is the first."""
    unit = np.eye(4)
    a, b = rng.uniform(0.03, 0.08, 2)
    home, side = np.zeros(4), float(rng.choice([-1.0, 1.0]))
    if kind == "sideways":
        return [home, side * a * unit[1], -side * b * unit[1], 0.5 * side * a * unit[1]]
    if kind == "lengthwise":
        return [home, -a * unit[0], 0.2 * b * unit[0], -0.6 * a * unit[0]]
    if kind == "turned":
        one, other = rng.uniform(0.3, 0.8, 2)
        return [home, side * one * unit[3], -side * other * unit[3], home]
    if kind == "lifted":
        return [home, 0.7 * a * unit[2], -0.5 * b * unit[2] + 0.3 * a * side * unit[1], home]
    if kind == "round":
        angles = side * np.linspace(0.0, 2 * np.pi * rng.uniform(1.0, 2.0), 25)
        return [0.6 * a * (np.cos(t) - 1) * unit[0] + 0.6 * a * np.sin(t) * unit[1] for t in angles]
    spread = np.array([0.04, 0.07, 0.04, 0.4])
    points = [home, *(rng.uniform(-1, 1, (3, 4)) * spread - 0.02 * unit[0])]
    return [*points, *points[-2::-1]] if kind == "back" else points


def rounded(value: float, digits: int = 6) -> float:
    """To so many significant digits, as stored."""
    return float(f"{value:.{digits}g}")


def refer(hose: Hose) -> Known | None:
    """The reference of a hose, if it is good to `GOOD`, slack and on one branch."""
    runs: list[Led] = []
    for segments, step in GRIDS:
        try:
            runs.append(lead(hose.path(), segments, step, may_jump=False))
        except ValueError as problem:
            print(f"{hose.name}, {segments} segments: {problem}", flush=True)
            return None
        largest = np.linalg.norm(runs[-1].end_wrench[:, :3], axis=1).max()
        if largest > TAUT * hose.length * hose.linear_density * GRAVITY:
            return None
    coarse, fine = (run.end_wrench[:, :3] for run in runs)
    error = np.linalg.norm(fine - coarse, axis=1) / np.linalg.norm(fine, axis=1)
    if error.max() > GOOD:
        print(f"{hose.name}: error {error.max():.1e}", flush=True)
        return None
    return Known(hose, rounded(float(runs[-1].total_twist[0])), runs[-1].end_wrench, error)


def same_start(path: Known) -> bool:
    """Whether a cold start of the tracker finds the path's first equilibrium, of several that are stable.

    This selects paths only; no number of the reference comes from the tracker.
    """
    tracker = Tracker(load_scene(path.scene(), urdf=path.urdf()))
    found, exact = tracker.solve(path.states()[0])["hose"].end_wrench[:3], path.end_wrench[0, :3]
    same = bool(np.linalg.norm(found - exact) < GOOD * np.linalg.norm(exact))
    if not same:
        print(f"{path.hose.name}: another first equilibrium", flush=True)
    return same


def known() -> dict[str, Known]:
    """The stored paths by name."""
    out = {}
    for row in json.loads(FILE.read_text())["paths"]:
        wrench, error = np.array(row.pop("end_wrench")), np.array(row.pop("error"))
        twist = row.pop("total_twist")
        tuples = {name: tuple(row.pop(name)) for name in ("stiffness", "bent")}
        joints = tuple(tuple(values) for values in row.pop("joints"))
        hose = Hose(**row, **tuples, joints=joints)
        out[hose.name] = Known(hose, twist, wrench, error)
    return out


def store(paths: list[Known]) -> None:
    """Write them, six digits a number."""
    rows = []
    for one in paths:
        row = asdict(one.hose) | {
            "total_twist": one.total_twist,
            "end_wrench": [[rounded(x) for x in wrench] for wrench in one.end_wrench],
            "error": [rounded(x, 2) for x in one.error],
        }
        rows.append(json.dumps(row))
    note = (
        "Hoses on rough ground, references/hose_paths.py. SI; joints: x, y, z, turn at every pose; "
        "end_wrench: force and moment on the hook in the end clamp's frame; error: of the force, relative."
    )
    FILE.write_text('{"note": "' + note + '",\n"paths": [\n' + ",\n".join(rows) + "\n]}\n")


def generate(paths: list[Known], count: int) -> Iterator[Known]:
    """The issue's paths and random ones after the seed of the last of `paths`, until there are `count`."""
    if not paths:
        for poses in (10, 30):
            found = refer(issue(poses))
            assert found is not None, "The path of issue 10 must have a reference."
            yield found
    last = paths[-1].hose.name.split("_") if paths else ["issue"]
    seed = 0 if last[0] == "issue" else int(last[1]) + 1
    while len(paths) < count:
        found = refer(random_hose(seed))
        if found is not None and same_start(found):
            yield found
        seed += 1


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--count", type=int, default=51, help="paths, the two of issue 10 among them")
    parser.add_argument("--resume", action="store_true", help="add to the stored paths")
    args = parser.parse_args()
    paths = list(known().values()) if args.resume else []
    for one in generate(paths, args.count):
        paths.append(one)
        store(paths)
        print(f"{one.hose.name}: {len(one.error)} poses, error {one.error.max():.1e}", flush=True)


if __name__ == "__main__":
    main()
