# SPDX-License-Identifier: Apache-2.0
"""Hoses on a UR10 as somebody might mount them, led to and fro: how many poses are answered, and how soon.

    pip install 'cable_ros[robot,mesh]' example-robot-data
    python benchmarks/random_dress_packs.py 30 --seed 1                 # 150 poses each
    python benchmarks/random_dress_packs.py 30 --seed 1 --friction 0.3  # of the links, and --finer 4

Length, stiffness, weight and diameter of the hose are random, what holds it on the forearm (a clip, a pin, a
ring with or without friction, a tube, nothing) and where, and five poses of the arm about those of the
pick-and-place of `examples/dress_pack.py`, with half turns of wrist 3. With `--finer`, the path is told in so
many times as many poses, too, and the last wrenches are compared.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from cable_ros import Status, Tracker, load_scene
from cable_ros.bench.markdown import markdown_table

sys.path.insert(0, str(Path(__file__).parents[1]))
from examples import dress_pack

KINDS = ("clip", "pin", "ring", "tube", "nothing")
SAME = 0.01
"""Relative difference of the last wrenches that counts as none."""
HEAD = ("held by", "hoses", "poses", "converged", "snapped", "not converged", "lost", "median ms", "99 % ms")


def hose(g: np.random.Generator, friction: float) -> tuple[str, dict[str, Any]]:
    """What holds it on the forearm, and its scene."""
    kind, values = str(g.choice(KINDS)), dress_pack.scene(float(g.choice([0.0, 0.2, 0.4])), friction)
    (cable,), stiffer, longer = values["cables"], g.uniform(0.5, 2.0), float(g.uniform(-0.05, 0.2))
    cable["stiffness"] = [stiffer * one for one in cable["stiffness"]]
    cable["linear_density"] = float(g.choice([0.1, 0.25, 0.5]))
    cable["outer_diameter"] = float(g.choice([0.01, 0.016, 0.02]))
    cable["length"] += longer
    first, held, last = cable["supports"]
    last["clip"]["arc_length"] += longer
    place = held.pop("ring")
    place["position"] = (
        np.array(place["position"]) + g.uniform([-0.03, 0.0, -0.05], [0.0, 0.0, 0.05])
    ).tolist()
    if kind != "ring":
        del place["friction"]
    if kind in ("clip", "tube"):
        place["rpy"] = [0.0, float(g.uniform(-0.4, 0.4)), 0.0]
    held[kind] = place
    cable["supports"] = [first, last] if kind == "nothing" else [first, held, last]
    return kind, values


def round_trip(g: np.random.Generator) -> np.ndarray:
    """(6, 6) joint values, rad, from the first stop by four others and back."""
    stops = dress_pack.STOPS[g.integers(1, 5, 4)] + g.uniform(-0.25, 0.25, (4, 6))
    stops[:, 5] = np.pi / 2 * g.integers(-2, 3, 4)
    return np.array([dress_pack.STOPS[0], *stops, dress_pack.STOPS[0]])


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("count", type=int, nargs="?", default=30, help="number of hoses")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--poses", type=int, default=150, help="of each")
    parser.add_argument("--friction", type=float, default=0.0, help="of the links")
    parser.add_argument("--finer", type=int, default=1)
    args = parser.parse_args()
    counts = {kind: Counter[Status]() for kind in KINDS}
    hoses, times = Counter[str](), {kind: [] for kind in KINDS}  # type: dict[str, list[float]]
    apart = 0
    for index in tqdm(range(args.count), file=sys.stderr):
        g = np.random.default_rng([args.seed, index])
        kind, values = hose(g, args.friction)
        stops, ends = round_trip(g), []
        hoses[kind] += 1
        for finer in sorted({1, args.finer}):
            tracker, known = Tracker(load_scene(values)), {Status.OUT_OF_REACH}
            for joints in dress_pack.poses(finer * (args.poses - 1) + 1, stops):
                begin = time.perf_counter()
                found = tracker.arrive(joints)["hose"]
                if finer == 1:
                    times[kind].append(1e3 * (time.perf_counter() - begin))
                    counts[kind][found.status] += 1
                if not found.status.trusted and found.status not in known:
                    known.add(found.status)
                    print(
                        f"hose {index}, {kind}, {finer} x: {found.status.name}: {found.message}", flush=True
                    )
            ends.append(found)
        if len(ends) == 2 and all(one.status.trusted for one in ends):
            few, many = (one.start_wrench[:3] for one in ends)
            if np.linalg.norm(few - many) > SAME * np.linalg.norm(many):
                apart += 1
                print(f"hose {index}, {kind}: {few} N at its start, {many} N in more poses", flush=True)
    rows = []
    for kind in KINDS:
        count = counts[kind]
        reached = count.total() - count[Status.OUT_OF_REACH]
        if reached:
            shown = Status.CONVERGED, Status.SNAPPED, Status.NOT_CONVERGED, Status.BRANCH_LOST
            rows.append([kind, str(hoses[kind]), str(reached), *(str(count[status]) for status in shown),
                         *(f"{np.percentile(times[kind], share):.1f}" for share in (50, 99))])  # fmt: skip
    print(markdown_table(HEAD, rows))
    if args.finer > 1:
        print(f"{apart} of {args.count} hoses end elsewhere, told in {args.finer} times as many poses")
    return 0


if __name__ == "__main__":
    sys.exit(main())
