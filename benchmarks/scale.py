# SPDX-License-Identifier: Apache-2.0
"""A sweep on one process, on two, on a Dask cluster, with a worker killed half-way; poses in random order.

    python benchmarks/scale.py    # tables as in docs/scale.md; a few minutes, two cores with nothing else

Every run's table is compared with that of one process, byte for byte.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import numpy as np
from distributed import Client, LocalCluster

from cable_ros import load_scene
from cable_ros.batch import concatenate, solve_many, solve_paths
from cable_ros.bench.machine import describe
from cable_ros.share import share_file

ARM = str(share_file("config", "space_arm.yaml"))
SWEEPS = {
    "2,001 poses": ("--joint", "orientation=-90:90:0.09deg"),
    "60,001 poses": ("--joint", "orientation=-90:90:0.003deg"),
    "151 scenes of 361 poses": (
        "--joint",
        "orientation=-90:90:0.5deg",
        "--vary",
        "youngs_modulus=5e6:8e6:2e4",
    ),
}
COMMAND = [sys.executable, "-m", "cable_ros.cli.main", "sweep", ARM]
RANDOM = 5_000  # poses


def sweep(arguments: tuple[str, ...], out: Path, *where: str) -> float:
    """Seconds of the command, its start included."""
    begin = time.perf_counter()
    subprocess.run([*COMMAND, *arguments, "--out", str(out), *where], check=True, capture_output=True)
    return time.perf_counter() - begin


def kill_after(seconds: float, cluster: LocalCluster) -> threading.Thread:
    """Kills a worker of the cluster, as a machine that fails would take it away."""

    def kill() -> None:
        with Client(cluster) as client:
            pids = client.run(os.getpid)
            time.sleep(seconds)
            os.kill(next(iter(pids.values())), signal.SIGKILL)

    thread = threading.Thread(target=kill)
    thread.start()
    return thread


def main() -> int:
    print(", ".join(f"{name} {fact}" for name, fact in describe().items()))
    os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1")
    wrong = 0
    print("\n| sweep | 1 process, s | 2 processes | Dask, 2 workers | one of them killed half-way |")
    print("|---|---|---|---|---|")
    with (
        tempfile.TemporaryDirectory() as folder,
        LocalCluster(
            n_workers=2, threads_per_worker=1, dashboard_address=None, worker_dashboard_address=None
        ) as cluster,
    ):
        address = cluster.scheduler_address
        for name, arguments in SWEEPS.items():
            files = [Path(folder) / f"{len(name)}_{i}.csv" for i in range(4)]
            alone = sweep(arguments, files[0], "--jobs", "1")
            seconds = [
                sweep(arguments, files[1], "--jobs", "2"),
                sweep(arguments, files[2], "--cluster", address),
            ]
            killer = kill_after(0.5 * seconds[1], cluster)
            seconds.append(sweep(arguments, files[3], "--cluster", address))
            killer.join()
            same = [file.read_bytes() == files[0].read_bytes() for file in files[1:]]
            wrong += same.count(False)
            cells = [f"{s:.1f}{'' if equal else ' DIFFERS'}" for s, equal in zip(seconds, same, strict=True)]
            print(f"| {name} | {alone:.1f} | {' | '.join(cells)} |")
    scene = load_scene(ARM)
    angles = np.radians(np.linspace(-90.0, 90.0, RANDOM))
    shuffled = np.random.default_rng(1).permutation(angles)
    solve_many(scene, angles[:100])  # loads the code
    print(f"\n| {RANDOM:,} poses, one process | poses/s |\n|---|---|")
    for name, solve in {
        "sorted": lambda: solve_many(scene, angles),
        "random, as `solve_many` orders them": lambda: solve_many(scene, shuffled),
        "random, in the order given": lambda: concatenate(
            [batch for _, batch in solve_paths([(scene, [shuffled])])]
        ),
    }.items():
        begin = time.perf_counter()
        solve()
        print(f"| {name} | {RANDOM / (time.perf_counter() - begin):,.0f} |")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
