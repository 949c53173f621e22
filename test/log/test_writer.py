# SPDX-License-Identifier: Apache-2.0
"""The writer: what goes in comes out, files are never overwritten, and a bad disk stops only the log."""

from __future__ import annotations

import io
import os
import resource
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import pytest
from log_samples import JOINT_STATE, JOINTS, START, WRENCH, WRENCH_STAMPED, fill, joint_state, wrench

from cable_ros.log.errors import LogError
from cable_ros.log.reader import LogReader
from cable_ros.log.recover import recover
from cable_ros.log.writer import LogWriter


def test_every_message_comes_back_with_its_bytes_times_and_number(write_log):
    with LogReader(write_log(300)) as log:
        for topic in (JOINTS, WRENCH):
            messages = list(log.messages([topic]))
            assert [m.sequence for m in messages] == list(range(300))
            assert [m.log_time for m in messages] == [START + i * 1_000_000 for i in range(300)]
        assert messages[7].cdr == wrench([7, 0.1, -7, 1.0, 2.0, 3.5], START + 7_000_000)
        assert messages[7].publish_time == messages[7].log_time
        assert next(log.messages([JOINTS])).publish_time == START - 1000
        assert log.topics[WRENCH].type_name == WRENCH_STAMPED
        assert (log.start, log.end) == (START, START + 299_000_000)


def test_attachments_and_metadata_are_in_every_file_of_a_split_log(tmp_path):
    log = LogWriter(
        tmp_path / "run.mcap",
        attachments={"scene.yaml": "cables: []\n", "robot.urdf": "<robot name='ä'/>"},
        metadata={"cable_ros": {"version.numpy": "2.4"}},
        max_bytes=20_000,
        chunk_bytes=4096,
    )
    for block in range(20):
        fill(log, 50, 50 * block)
        time.sleep(0.03)  # the file's size is looked at between two polls of the queue
    log.close()
    assert log.error is None
    assert len(log.paths) > 2
    assert [p.name for p in log.paths] == ["run.mcap", *(f"run_{i}.mcap" for i in range(1, len(log.paths)))]
    numbers = []
    for path in log.paths:
        with LogReader(path) as part:
            assert part.scene_text == "cables: []\n"
            assert part.urdf_text == "<robot name='ä'/>"
            assert part.metadata["cable_ros"] == {"version.numpy": "2.4"}
            numbers += [m.sequence for m in part.messages([JOINTS], as_written=True)]
    assert numbers == list(range(1000))
    assert not list(tmp_path.glob("*.part"))


def test_a_log_is_split_by_time(tmp_path):
    with LogWriter(tmp_path / "run.mcap", max_seconds=0.1) as log:
        deadline = time.monotonic() + 20
        while not log.paths and time.monotonic() < deadline:
            fill(log, 1)
            time.sleep(0.01)
    assert len(log.paths) >= 2


@pytest.mark.parametrize("existing", ["run.mcap", "run.mcap.part"])
def test_an_existing_file_is_never_overwritten(tmp_path, existing):
    (tmp_path / existing).write_text("precious")
    with pytest.raises(LogError, match=rf"{existing}: it exists already .* choose another name"):
        LogWriter(tmp_path / "run.mcap")
    assert (tmp_path / existing).read_text() == "precious"


def test_a_file_that_appears_meanwhile_is_not_overwritten(tmp_path):
    log = LogWriter(tmp_path / "run.mcap")
    fill(log, 3)
    (tmp_path / "run.mcap").write_text("precious")
    log.close()
    assert "exists already" in (log.error or "")
    assert (tmp_path / "run.mcap").read_text() == "precious"
    assert sum(recover(tmp_path / "run.mcap.part", tmp_path / "saved.mcap").messages.values()) == 6


def test_a_folder_that_cannot_be_written_is_one_sentence(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(LogError, match="not a folder; write the log to another folder"):
        LogWriter(tmp_path / "file" / "run.mcap")
    if os.geteuid() != 0:  # root may write anywhere
        (tmp_path / "locked").mkdir(mode=0o500)
        with pytest.raises(LogError, match="may not write there"):
            LogWriter(tmp_path / "locked" / "run.mcap")


def test_wrong_names_and_types_are_refused(tmp_path):
    with pytest.raises(LogError, match=r"ends in '\.mcap'"):
        LogWriter(tmp_path / "run.bag")
    with LogWriter(tmp_path / "run.mcap") as log:
        with pytest.raises(LogError, match="not a message type; write it as"):
            log.write("/a", "JointState", b"", 0)
        with pytest.raises(LogError, match="Message type no_such/msg/Type is not installed"):
            log.write("/a", "no_such/msg/Type", b"", 0)
        log.write("/a", JOINT_STATE, joint_state(0.0), 1)
        with pytest.raises(LogError, match="cannot be geometry_msgs/msg/WrenchStamped as well"):
            log.write("/a", WRENCH_STAMPED, wrench([0] * 6), 1)
    assert log.written == 1


def test_a_stalled_disk_costs_bounded_memory_and_is_counted(tmp_path, monkeypatch):
    answer = threading.Event()

    class Stalled(io.FileIO):
        def write(self, data: Any) -> int:
            answer.wait(60)
            return super().write(data)

    log = LogWriter(tmp_path / "warm.mcap")
    log.close()
    monkeypatch.setattr("cable_ros.log.unfinished.io.FileIO", Stalled)
    answer.set()
    log = LogWriter(tmp_path / "run.mcap", queue_bytes=100_000, chunk_bytes=1000)
    answer.clear()
    accepted = [log.write(WRENCH, WRENCH_STAMPED, wrench([i] * 6), i + 1) for i in range(5000)]
    assert not all(accepted)
    assert log.queued_bytes <= 100_000
    assert log.dropped == accepted.count(False)
    assert log.error is None
    answer.set()
    log.close()
    with LogReader(tmp_path / "run.mcap") as reader:
        kept = [m.sequence for m in reader.messages()]
        assert kept == [i for i, ok in enumerate(accepted) if ok]
        assert reader.metadata["cable_ros_log_end"]["dropped"] == str(log.dropped)


FILE_LIMIT = 60_000  # bytes

FULL_DISK = """
import resource, signal, sys, time
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)  # as CPython does; then a write beyond the limit fails
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[2]), -1))
from log_samples import fill
from cable_ros.log.writer import LogWriter
log = LogWriter(sys.argv[1], chunk_bytes=4096)
written = 0
while log.error is None:
    try:
        fill(log, 10, written)
        written += 10
    except AssertionError:  # refused: the log has stopped
        break
    time.sleep(0.001)
before = -1
while before != log.dropped:  # what the queue still held is counted by the log's thread
    before = log.dropped
    time.sleep(0.1)
log.write("/joint_states", "sensor_msgs/msg/JointState", b"", 0)
assert log.dropped == before + 1
log.close()
print(log.error)
"""


def run_until_full(folder: Path, limit: int) -> str:
    """The error of a process of its own that logs until the disk takes no more."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(["test", *sys.path])}
    done = subprocess.run(
        [sys.executable, "-c", FULL_DISK, str(folder / "run.mcap"), str(limit)],
        env=environment,
        cwd=Path(__file__).parents[2],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def check_recovered(folder: Path, out: Path) -> None:
    assert not (folder / "run.mcap").exists()
    saved = recover(folder / "run.mcap.part", out)
    with LogReader(out) as reader:
        numbers = [m.sequence for m in reader.messages([WRENCH])]
    assert numbers == list(range(len(numbers)))
    assert saved.messages[WRENCH] == len(numbers) > 100


@pytest.mark.skipif(not hasattr(resource, "RLIMIT_FSIZE"), reason="no file size limit on this system")
def test_a_file_that_may_not_grow_stops_the_log_with_a_sentence(tmp_path):
    error = run_until_full(tmp_path, FILE_LIMIT)
    assert "largest size allowed" in error
    assert f"cable log recover {tmp_path / 'run.mcap.part'}" in error
    check_recovered(tmp_path, tmp_path / "saved.mcap")


def test_a_full_disk_stops_the_log_with_a_sentence(tmp_path):
    disk = tmp_path / "disk"
    disk.mkdir()
    mount = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=256k", "tmpfs", str(disk)], capture_output=True, check=False
    )
    if mount.returncode != 0:
        pytest.skip("mounting a small tmpfs needs root")
    try:
        error = run_until_full(disk, resource.RLIM_INFINITY)
        assert "the disk is full; free some space" in error
        check_recovered(disk, tmp_path / "saved.mcap")
    finally:
        subprocess.run(["umount", str(disk)], check=True)


def test_a_message_that_cannot_be_written_ends_the_log_with_a_sentence(tmp_path):
    log = LogWriter(tmp_path / "run.mcap")
    log.write(WRENCH, WRENCH_STAMPED, wrench([0] * 6), -1)  # MCAP's times are unsigned
    log.close()
    assert log.error is not None
    assert "stopped" in log.error


def test_without_a_thread_the_caller_writes_the_same(tmp_path):
    threads = threading.active_count()
    logs = [LogWriter(tmp_path / f"{name}.mcap", background=name == "a", chunk_bytes=4096) for name in "ab"]
    assert threading.active_count() == threads + 1
    for log in logs:
        fill(log, 300)
    grown = logs[1].written
    assert 0 < grown < 600  # chunk by chunk, not all at the end
    for log in logs:
        log.close()
        assert (log.error, log.dropped, log.written) == (None, 0, 600)
    with LogReader(logs[0].path) as first, LogReader(logs[1].path) as second:
        assert list(first.messages()) == list(second.messages())
    with pytest.raises(LogError):
        logs[1].put(JOINTS, JOINT_STATE, joint_state(0.0, START), START)


def test_without_a_thread_a_bad_disk_is_told_and_nothing_is_left_of_what_is_discarded(tmp_path):
    log = LogWriter(tmp_path / "full.mcap", background=False, chunk_bytes=4096)
    log._part.file.stream.close()

    def put_many():
        for _ in range(300):
            log.put(JOINTS, JOINT_STATE, joint_state(0.0, START), START)

    with pytest.raises(LogError, match=r"full\.mcap"):
        put_many()
    log.close()
    assert log.written == 0
    assert log.dropped > 0
    other = LogWriter(tmp_path / "other.mcap", background=False)
    fill(other, 10)
    other.discard()
    assert not list(tmp_path.glob("other*"))
