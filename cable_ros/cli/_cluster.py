# SPDX-License-Identifier: Apache-2.0
"""The workers of a Dask cluster, for `cable sweep --cluster`."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from concurrent.futures import CancelledError, Executor
from contextlib import contextmanager
from typing import Any

from cable_ros.cli._arguments import CommandError

PATIENCE = 10
"""Time, s, to wait for the scheduler, and for its first worker."""
PACKAGES = ("cable_ros", "numpy", "scipy", "numba")
"""Whose versions decide the bits of a result."""


@contextmanager
def cluster(address: str) -> Iterator[tuple[Executor, int]]:
    """An executor over the workers of the Dask scheduler at `address`, and how many threads they have.

    What a worker that dies has not finished goes to another one, by Dask itself.

    Raises:
        CommandError: no scheduler or worker answers, a worker has another version of this package or none,
            or within the context the scheduler leaves, or the same work ends several workers.
    """
    from distributed import Client
    from distributed.scheduler import KilledWorker

    try:
        client = Client(address, timeout=PATIENCE)
    except (OSError, ValueError) as error:
        raise CommandError(f"--cluster {address}: no Dask scheduler answers there ({error})") from None
    with client:
        try:
            client.wait_for_workers(1, timeout=PATIENCE)
        except TimeoutError:
            raise CommandError(
                f"--cluster {address}: no worker has joined; start some with 'dask worker {address} "
                "--nworkers auto --nthreads 1' where this package is installed"
            ) from None
        _check_versions(client.get_versions(packages=PACKAGES), address)
        executor = client.get_executor(pure=False)
        try:
            yield executor, sum(client.nthreads().values())
        except KilledWorker:
            raise CommandError(
                f"--cluster {address}: several workers died over the same poses; see their logs, and whether "
                "they have enough memory"
            ) from None
        except CancelledError:
            raise CommandError(f"--cluster {address}: the scheduler has left") from None
        finally:
            executor.shutdown(wait=False)


def _check_versions(versions: dict[str, Any], address: str) -> None:
    """Refuse workers with another version of this package; tell of those that may differ in the last bits."""
    ours = versions["client"]["packages"]
    for worker, facts in versions["workers"].items():
        theirs = facts["packages"]
        differing = [name for name in PACKAGES if theirs.get(name) != ours[name]]
        if PACKAGES[0] in differing:
            name = PACKAGES[0]
            raise CommandError(
                f"--cluster {address}: the worker {worker} has {name} {theirs.get(name)}, not {ours[name]}"
            )
        if differing:
            what = ", ".join(f"{name} {theirs.get(name)}, here {ours[name]}" for name in differing)
            print(f"cable sweep: results may differ in the last bits: {worker} has {what}", file=sys.stderr)
