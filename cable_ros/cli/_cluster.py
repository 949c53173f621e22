# SPDX-License-Identifier: Apache-2.0
"""The workers of a Dask cluster, for `cable sweep --cluster`."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from concurrent.futures import CancelledError, Executor, Future, InvalidStateError
from contextlib import contextmanager, suppress
from threading import Event, Thread
from typing import Any
from weakref import WeakSet

from cable_ros.cli._arguments import CommandError

PATIENCE = 10
"""Time, s, to wait for the scheduler, and for its first worker."""
PACKAGES = ("cable_ros", "numpy", "scipy", "numba")
"""Whose versions decide the bits of a result."""


class _Watched(Executor):
    """Dask's executor, whose futures end when the scheduler leaves: Dask's own may wait for ever then."""

    def __init__(self, client: Any) -> None:
        self._client, self._executor = client, client.get_executor(pure=False)
        self._futures: WeakSet[Future[Any]] = WeakSet()
        self._over = Event()
        Thread(target=self._watch, daemon=True).start()

    def submit(self, function: Any, /, *arguments: Any, **named: Any) -> Future[Any]:
        future: Future[Any] = self._executor.submit(function, *arguments, **named)
        self._futures.add(future)
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        self._over.set()
        self._executor.shutdown(wait=wait)

    def _watch(self) -> None:
        while not self._over.wait(1.0):
            if self._client.status != "running":
                for future in list(self._futures):
                    with suppress(InvalidStateError):  # it has ended
                        future.set_exception(CancelledError())


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
        executor = _Watched(client)
        try:
            yield executor, sum(client.nthreads().values())
        except KilledWorker:
            raise CommandError(
                f"--cluster {address}: several workers died over the same poses; see their logs, and whether "
                "they have enough memory"
            ) from None
        except (CancelledError, ValueError) as error:
            # a future that is cancelled while Dask unpacks its outcome ends in an error of Dask's own
            if isinstance(error, ValueError) and "to unpack" not in str(error):
                raise
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
