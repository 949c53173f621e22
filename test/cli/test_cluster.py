# SPDX-License-Identifier: Apache-2.0
"""`cable sweep --cluster`: a real Dask cluster on this machine."""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import threading
import time

import pytest

from cable_ros.cli import _cluster
from cable_ros.cli.main import main
from cable_ros.share import share_file

distributed = pytest.importorskip("distributed")
pytestmark = pytest.mark.filterwarnings("default")  # a scheduler and its workers share our process

ARM = str(share_file("config", "space_arm.yaml"))
OPTIONS = {"threads_per_worker": 1, "dashboard_address": None, "worker_dashboard_address": None}
SWEEP = ("sweep", ARM, "--joint", "orientation=-90:90:0.2deg", "--vary", "youngs_modulus=5e6:7e6:5e5")


def local_cluster(workers):
    """A cluster of this machine; Dask gives its thread 10 s to begin, too few for once on a busy machine."""
    for _ in range(2):
        with contextlib.suppress(AssertionError):
            return distributed.LocalCluster(n_workers=workers, **OPTIONS)
    return distributed.LocalCluster(n_workers=workers, **OPTIONS)


@pytest.fixture(scope="module")
def cluster():
    with local_cluster(2) as made:
        yield made


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    out = tmp_path_factory.mktemp("alone") / "arm.csv"
    assert main([*SWEEP, "--out", str(out), "--jobs", "1"]) == 0
    return out.read_text()


def test_a_cluster_writes_the_same_table(tmp_path, cluster, alone, capsys):
    out = tmp_path / "arm.csv"
    assert main([*SWEEP, "--out", str(out), "--cluster", cluster.scheduler_address]) == 0
    assert out.read_text() == alone
    told = capsys.readouterr().out
    assert f"4505 poses, 4505 CONVERGED; {cluster.scheduler_address} with 2 threads, " in told


def test_what_a_killed_worker_did_not_finish_is_done_by_others(tmp_path, cluster, alone, monkeypatch):
    """One of two is killed, in the middle of its work, when the first rows are written."""
    from cable_ros.cli import _tables

    killed = []
    write = _tables.CsvTable.write

    def kill_first(table, variant, batch):
        if not killed:
            busy = cluster.scheduler_info["workers"]
            killed.append(next(iter(busy)))
            with distributed.Client(cluster) as client:
                pids = client.run(os.getpid)
            os.kill(pids[killed[0]], signal.SIGKILL)
        write(table, variant, batch)

    monkeypatch.setattr(_tables.CsvTable, "write", kill_first)
    out = tmp_path / "arm.csv"
    assert main([*SWEEP, "--out", str(out), "--cluster", cluster.scheduler_address]) == 0
    assert killed
    assert out.read_text() == alone


def _refused(tmp_path, capsys, address: str) -> str:
    out = tmp_path / "arm.csv"
    assert main(["sweep", ARM, "--out", str(out), "--cluster", address]) == 2
    assert not out.exists()
    (sentence,) = [line for line in capsys.readouterr().err.splitlines() if "--cluster" in line]
    return sentence


def test_no_scheduler(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(_cluster, "PATIENCE", 1)
    with socket.socket() as taken:  # bound, but nobody listens
        taken.bind(("127.0.0.1", 0))
        address = f"tcp://127.0.0.1:{taken.getsockname()[1]}"
        assert "no Dask scheduler answers there" in _refused(tmp_path, capsys, address)
    assert "no Dask scheduler answers there" in _refused(tmp_path, capsys, "nonsense:::")


def test_no_worker(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(_cluster, "PATIENCE", 1)
    with local_cluster(0) as empty:
        address = empty.scheduler_address
        assert f"no worker has joined; start some with 'dask worker {address}" in _refused(
            tmp_path, capsys, address
        )


def test_another_version_is_refused_and_another_numpy_told(tmp_path, capsys, cluster, monkeypatch):
    versions = distributed.Client.get_versions

    def other(name):
        def changed(self, check=False, packages=None):
            found = versions(self, check, packages)
            for facts in found["workers"].values():
                facts["packages"][name] = "0.0.1"
            return found

        return changed

    monkeypatch.setattr(distributed.Client, "get_versions", other("cable_ros"))
    assert "has cable_ros 0.0.1, not 0.1.0" in _refused(tmp_path, capsys, cluster.scheduler_address)
    monkeypatch.setattr(distributed.Client, "get_versions", other("numpy"))
    out = str(tmp_path / "arm.csv")
    assert main(["sweep", ARM, "--out", out, "--cluster", cluster.scheduler_address]) == 0
    assert "results may differ in the last bits: tcp" in capsys.readouterr().err


def test_the_scheduler_leaves(tmp_path, capsys):
    made = local_cluster(1)
    closing = threading.Thread(target=lambda: (time.sleep(1.0), made.close()))
    closing.start()
    arguments = ["sweep", ARM, "--joint", "orientation=-90:90:0.0001deg", "--out", str(tmp_path / "arm.csv")]
    code = main([*arguments, "--cluster", made.scheduler_address])
    closing.join()
    assert code == 2
    assert "--cluster" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_one_of_jobs_and_cluster(capsys):
    assert main(["sweep", ARM, "--out", "a.csv", "--jobs", "2", "--cluster", "tcp://127.0.0.1:1"]) == 2
    assert "not allowed with argument --jobs" in capsys.readouterr().err
