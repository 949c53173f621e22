# SPDX-License-Identifier: Apache-2.0
"""Drawn scenes with friction against the tests' discrete Coulomb rod, pose by pose.

    python benchmarks/drawn_reference.py 20 --seed 1 --segments 150     # the first 20 with friction
    python benchmarks/drawn_reference.py 19 34 --seed 1 --only

The reference starts from the solver's first shape, which knows no friction yet. Left out are scenes where it
finds no equilibrium beside that, or one of another force, and poses behind one where it jumped. Published
forces further off than `FAR` are told, then one table.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

sys.path.insert(0, str(Path(__file__).parents[1] / "test"))
from references import coulomb_rod

from cable_ros.bench.cases import Case, case_scene, joint_values
from cable_ros.bench.drawn import drawn_case
from cable_ros.bench.markdown import markdown_table
from cable_ros.bench.metamorphic import follow
from cable_ros.equilibrium import Equilibrium
from cable_ros.scene.kinematics import Kinematics
from cable_ros.scene.obstacles import Box, Obstacle, Plane, Sphere

FAR = 0.05
"""The discrete rod itself is good to 3 %."""
HEAD = (
    "scenes",
    "left out",
    "poses compared",
    "more than 5 % off",
    "more than 20 % off",
    "not trusted",
    "most",
)


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("numbers", type=int, nargs="+", help="how many scenes, or with --only their indices")
    parser.add_argument("--only", action="store_true", help="the numbers are indices")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--segments", type=int, default=150)
    parser.add_argument("--most", type=int, default=31, metavar="N", help="only paths of up to N poses")
    args = parser.parse_args()
    indices = iter(args.numbers if args.only else range(1_000_000))
    scenes = left_out = untrusted = 0
    errors: list[float] = []
    while scenes < (len(args.numbers) if args.only else args.numbers[0]):
        case = drawn_case(args.seed, next(indices), 1e-4)
        if not case_scene(case).obstacles[0].friction or len(case.path) > args.most:
            if args.only:
                scenes += 1
            continue
        scenes += 1
        off, why = compare(case, args.segments)
        if why:
            print(f"{case.name.replace(' ', ':')} [{case.expected}] {why}", flush=True)
        left_out += off is None
        found = off or []
        untrusted += sum(one is None for one in found)
        errors += [one for one in found if one is not None]
    worst = np.array(errors or [0.0])
    row = [scenes, left_out, len(errors), int((worst > FAR).sum()), int((worst > 4 * FAR).sum()), untrusted]
    print(f"\n{markdown_table(HEAD, [[*map(str, row), f'{worst.max():.1e}']])}")
    return 1 if (worst > FAR).any() else 0


def compare(case: Case, segments: int) -> tuple[list[float | None] | None, str]:
    """Relative errors of the end force at the poses, None where it is not trusted, and what is to be told."""
    told = follow(case).found
    if not told[0].status.trusted:
        return None, f"left out: {told[0].status.name} at the first pose"
    try:
        led = lead(reference_path(case), [one.name for one in case_scene(case).obstacles], told[0], segments)
    except ValueError as error:
        return None, f"left out: {error}"
    largest = float(np.linalg.norm(led.end_wrench[:, :3], axis=1).max())
    out: list[float | None] = []
    why = ""
    for i, (found, exact, jumped) in enumerate(zip(told, led.end_wrench, led.jumped, strict=True)):
        if jumped:
            return out, why or f"compared up to pose {i}, where the reference jumps"
        if not found.status.trusted:
            out.append(None)
            continue
        # a force that all but vanishes is compared with the path's
        size = max(float(np.linalg.norm(exact[:3])), 0.2 * largest)
        off = float(np.linalg.norm(found.end_wrench[:3] - exact[:3])) / size
        if i == 0 and off > FAR:
            return (
                None,
                f"left out: its first equilibrium is another, {100 * off:.3g} % away",
            )
        out.append(off)
        if off > FAR and not why:
            why = f"pose {i}, {found.status.name}: force {100 * off:.3g} % off the reference"
    return out, why


def lead(
    path: coulomb_rod.Path, names: list[str], first: Equilibrium, segments: int, step: float = 4e-3
) -> coulomb_rod.Led:
    """As `coulomb_rod.lead`, from the shape of `first`.

    Raises ValueError where the reference finds no equilibrium from there.
    """
    begin = coulomb_rod._Walk.begin

    def at_first(walk: coulomb_rod._Walk, _: float) -> None:
        n, length = segments, path.length
        given = np.linspace(0.0, 1.0, len(first.points))
        middles = (np.arange(n) + 0.5) / n
        s = np.linspace(0.0, 1.0, n + 1)
        x = np.column_stack([np.interp(s, given, column) for column in first.points.T]) / length
        q = Slerp(given, Rotation.from_quat(first.orientations))(middles).as_quat()[:, [3, 0, 1, 2]]
        lam = np.zeros((len(path.obstacles), n + 1, 3))
        for touch in first.contacts:
            lam[names.index(touch.obstacle), round(touch.arc_length / length * n)] += touch.force / walk.force
        start = Rotation.from_quat(path.start[3:]).apply(first.start_wrench[:3]) / walk.force
        borne = np.cumsum(lam.sum(axis=0), axis=0)[:-1]
        force = start - middles[:, None] * walk.w - borne
        walk.state = coulomb_rod._State(x, np.ascontiguousarray(q), force, lam)
        bodies = walk.bodies[:, 0]
        beside = walk.solve(walk.state, walk.ends[0], bodies, bodies, friction=False, load=walk.w)
        walk.state = beside or walk.settle(walk.ends[0], bodies, bodies, False, walk.w)

    coulomb_rod._Walk.begin = at_first
    try:
        return coulomb_rod.lead(path, segments, step)
    finally:
        coulomb_rod._Walk.begin = begin


def reference_path(case: Case) -> coulomb_rod.Path:
    """The case as the reference takes it."""
    scene = case_scene(case)
    (cable,) = scene.cables
    kinematics = Kinematics(scene)
    values = [joint_values(kinematics, joints) for joints in case.path]
    clamps = np.array([kinematics.poses(at)[0] for at in values])
    links = np.array([kinematics.obstacle_poses(at) for at in values])
    obstacles = tuple(obstacle(one, links[:, i]) for i, one in enumerate(scene.obstacles))
    weight = scene.gravity * cable.linear_density
    stiffness = np.array(cable.stiffness)
    return coulomb_rod.Path(
        cable.length, stiffness, weight, clamps[0, 0], clamps[:, 1], cable.radius, obstacles
    )


def obstacle(one: Obstacle, links: np.ndarray) -> coulomb_rod.Obstacle:
    """An obstacle whose link takes the poses `links` (n, 7)."""
    shape = one.shape
    kind = type(shape).__name__.lower()
    if isinstance(shape, Box):
        # the reference's boxes stand in the middle of their bodies
        turns = Rotation.from_quat(links[:, 3:])
        middles = links[:, :3] + turns.apply(np.array(shape.center))
        bodies = np.hstack([middles, (turns * Rotation.from_quat(np.array(shape.orientation))).as_quat()])
        return coulomb_rod.Obstacle(kind, tuple(0.5 * shape.size), one.friction, bodies)
    if isinstance(shape, Plane):
        values = (*shape.point, *shape.normal)
    elif isinstance(shape, Sphere):
        values = (*shape.center, shape.radius)
    else:
        values = (*shape.start, *shape.end, shape.radius)
    return coulomb_rod.Obstacle(kind, tuple(float(v) for v in values), one.friction, links)


if __name__ == "__main__":
    sys.exit(main())
