# SPDX-License-Identifier: Apache-2.0
"""Writes messages to MCAP files, mostly from a thread of its own: the caller then never waits for a disk."""

from __future__ import annotations

import struct
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from pathlib import Path

from cable_ros.log.definitions import message_definition
from cable_ros.log.errors import RECOVER, LogError, describe
from cable_ros.log.joint_state_cdr import JOINT_STATE, trim_joint_state
from cable_ros.log.mcap_writer import MESSAGE_HEAD, Chunk
from cable_ros.log.part import Contents, Part, Topic

_POLL_SECONDS = 0.02
_OVERHEAD_BYTES = 250  # of a waiting message's objects
_CLOSE_SECONDS = 10.0


class LogWriter:
    """A log of ROS 2 messages in CDR, readable by rosbag2, Foxglove and any MCAP library.

    `path`: the first file; further ones, when it is split, are called `<stem>_1.mcap`, `<stem>_2.mcap`, ...
    Each is whole by itself, and called `.mcap.part` until it is.
    `attachments`: file name -> text, such as the scene; `metadata`: record name -> entries. In every file.
    `max_bytes`, `max_seconds`: where a file is split; 0 for never. The index of an open file is kept in
    memory (about 200 bytes for each chunk), which the default size bounds at a few MB.
    `queue_bytes`: bound of what waits for the disk; beyond it messages are dropped and counted.
    `chunk_bytes`, `chunk_seconds`: a chunk is closed, and goes to the operating system, at this size
    (before compression) or age: what a killed process loses at most.
    `sync_seconds`: how often the disk itself is made to take it: what a power cut loses at most. Five
    seconds is ext4's own commit interval; more often costs an SD card wear and gains little.
    `background`: whether a thread does the writing. Without one the caller does it whenever a chunk is full:
    for programs that fork, which a thread would forbid. Ages do not count then, and nothing is split.

    Messages are packed where they are offered, which costs a microsecond or two each; the thread gets whole
    chunks, and what it does with one mostly leaves the interpreter to others. `write` is meant to be called
    from one thread at a time.

    Raises: LogError where the file cannot be made, exists, or its folder is not writable.
    """

    def __init__(
        self,
        path: str | Path,
        *,
        attachments: Mapping[str, str] | None = None,
        metadata: Mapping[str, Mapping[str, str]] | None = None,
        max_bytes: int = 1 << 30,
        max_seconds: float = 0.0,
        queue_bytes: int = 32 << 20,
        chunk_bytes: int = 256 << 10,
        chunk_seconds: float = 0.5,
        sync_seconds: float = 5.0,
        background: bool = True,
    ) -> None:
        self._base = Path(path)
        if self._base.suffix != ".mcap":
            raise LogError(f"Cannot write {self._base}: a log's name ends in '.mcap'.")
        self._contents = Contents(dict(attachments or {}), dict(metadata or {}))
        self._max_bytes = max_bytes
        self._max_seconds = max_seconds
        self._queue_bytes = queue_bytes
        self._chunk_bytes = chunk_bytes
        self._chunk_seconds = chunk_seconds
        self._sync_seconds = sync_seconds

        self.dropped = 0
        """Messages not logged, for a full queue or after `error`."""
        self.written = 0
        """Messages handed to the file."""
        self.error: str | None = None
        """Why the log stopped, as one sentence; None while all is well."""
        self.paths: list[Path] = []
        """Files finished so far."""

        self._topics: dict[str, Topic] = {}
        self._numbered: list[Topic] = []
        self._chunk = Chunk()
        self._lock = threading.Lock()  # of the open chunk
        self._queue: deque[Chunk] = deque()
        self._fault: Exception | None = None
        # Two counters with one writer each need no lock.
        self._bytes_in = 0
        self._bytes_out = 0
        self._stop = threading.Event()
        self._discarded = False
        self._part = Part(self._base, self._contents, chunk_bytes)
        self._thread: threading.Thread | None = None
        self._open = True
        if background:
            self._thread = threading.Thread(target=self._run, name="log_writer", daemon=True)
            self._thread.start()

    @property
    def path(self) -> Path:
        """The file that is being written, under the name that it will have when it is whole."""
        return self._part.file.path

    @property
    def queued_bytes(self) -> int:
        """Bytes that wait for the disk, at most `queue_bytes`."""
        return self._bytes_in - self._bytes_out

    @property
    def _writes(self) -> bool:
        """Whether what is offered gets into the file."""
        return self._open if self._thread is None else self._thread.is_alive()

    def add_topic(self, topic: str, type_name: str, offered_qos: str = "", exact: bool = False) -> Topic:
        """Announce a topic ahead of its first message; needed only to give its QoS (`qos_to_yaml`).

        `exact`: nothing follows the last field of its messages, so that nobody need look (a JointState from
        rclpy may be padded).

        Raises: LogError for an unknown type, or a topic that was announced with another type.
        """
        known = self._topics.get(topic)
        if known is None:
            message_definition(type_name)
            trim = type_name == JOINT_STATE and not exact
            known = Topic(topic, type_name, offered_qos, len(self._numbered) + 1, trim)
            self._numbered.append(known)
            self._topics[topic] = known
        elif known.type_name != type_name:
            raise LogError(f"Topic {topic} is logged as {known.type_name} and cannot be {type_name} as well.")
        return known

    def write(
        self, topic: str, type_name: str, cdr: bytes, log_time_ns: int, publish_time_ns: int | None = None
    ) -> bool:
        """Queue one serialised message; never blocks. False where it was dropped.

        `cdr` is kept, not copied, so it has to be immutable. `log_time_ns` is the clock of replay;
        `publish_time_ns` is the same unless given.

        Raises: LogError for an unknown type, at a topic's first message.
        """
        entry = self._topics.get(topic)
        if entry is None or entry.type_name != type_name:
            entry = self.add_topic(topic, type_name)
        sequence = entry.sequence
        entry.sequence = (sequence + 1) & 0xFFFFFFFF  # MCAP has four bytes for it
        size = len(cdr) + _OVERHEAD_BYTES
        if not self._writes or self._bytes_in - self._bytes_out + size > self._queue_bytes:
            self.dropped += 1
            return False
        if entry.trim:
            cdr = trim_joint_state(cdr)
            size = len(cdr) + _OVERHEAD_BYTES
        if publish_time_ns is None:
            publish_time_ns = log_time_ns
        with self._lock:
            chunk = self._chunk
            try:
                chunk.add(entry.number, log_time_ns, cdr, publish_time_ns, sequence)
            except struct.error as error:  # a message that cannot be written must not end the log unseen
                self._fault = error
                self.dropped += 1
                return False
            self._bytes_in += size
            full = chunk.size > self._chunk_bytes
            if full:
                self._queue.append(chunk)
                self._chunk = Chunk()
        if full and self._thread is None:
            self._guarded(self._drain)
        return True

    def put(self, topic: str, type_name: str, cdr: bytes, log_time_ns: int) -> None:
        """As `write`, but waits while the queue is full: for programs that are not in a hurry.

        Raises: LogError where the log has stopped.
        """
        while self._thread is not None and self._writes and self.queued_bytes > self._queue_bytes // 2:
            time.sleep(0.005)
        if not self.write(topic, type_name, cdr, log_time_ns):
            raise LogError(self.error or f"Cannot write {self.path}: the log is closed.")

    def close(self) -> None:
        """Write what is queued, finish the file, stop the thread. What failed is then in `error`."""
        self._stop.set()
        if self._thread is None:
            self._finish_here()
            return
        self._thread.join(_CLOSE_SECONDS)
        if self._thread.is_alive() and self.error is None:
            self.error = (
                f"Cannot write {self.path}: the disk did not answer for {_CLOSE_SECONDS:.0f} s;"
                f" {RECOVER.format(path=self._part.file.part_path)}."
            )

    def discard(self) -> None:
        """Stop, and remove the unfinished file; of a split log, those finished before stay."""
        self._discarded = True
        self._stop.set()
        if self._thread is None:
            self._finish_here()
        else:
            self._thread.join(_CLOSE_SECONDS)

    def __enter__(self) -> LogWriter:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def _run(self) -> None:
        self._guarded(self._write_until_stopped)
        self._drop_rest()

    def _finish_here(self) -> None:
        """What the thread would do last, once."""
        if self._open:
            self._guarded(self._write_until_stopped)
            self._drop_rest()
        self._open = False

    def _guarded(self, work: Callable[[], None]) -> None:
        """Do some of the writing; a failure ends the log, and is in `error`."""
        try:
            work()
            return
        except LogError as error:
            self.error = str(error)
        except OSError as error:
            self.error = describe(error, self.path, "write").removesuffix(".") + (
                f"; {RECOVER.format(path=self._part.file.part_path)}."
            )
            self._part.file.abandon()
        except Exception as error:  # must not end the log unseen
            self.error = f"Log {self.path} stopped: {type(error).__name__}: {error}."
            self._part.file.abandon()
        self._open = False
        self._drop_rest()

    def _drop_rest(self) -> None:
        """Count what waits as dropped."""
        self._take_open_chunk()
        self.dropped += sum(chunk.count for chunk in self._queue)
        self._queue.clear()

    def _write_until_stopped(self) -> None:
        opened = flushed = synced = time.monotonic()
        while True:
            stopping = self._stop.wait(_POLL_SECONDS)
            if self._discarded:
                self._part.file.discard()
                return
            now = time.monotonic()
            old = now - flushed >= self._chunk_seconds
            if old or stopping:
                self._take_open_chunk()
            self._drain()
            if old:
                self._part.flush()
                flushed = now
            if now - synced >= self._sync_seconds:
                self._part.file.sync()
                synced = now
            if self._fault is not None:
                raise self._fault
            if stopping and not self._queue and not self._chunk.count:
                self._part.finish(self.dropped)
                self.paths.append(self._part.file.path)
                return
            too_old = self._max_seconds and now - opened >= self._max_seconds
            if too_old or (self._max_bytes and self._part.size >= self._max_bytes):
                self._split()
                opened = flushed = synced = now

    def _take_open_chunk(self) -> None:
        with self._lock:
            if self._chunk.count:
                self._queue.append(self._chunk)
                self._chunk = Chunk()

    def _drain(self) -> None:
        """Hand what is queued to the file."""
        while self._queue:
            chunk = self._queue[0]
            held = chunk.size + chunk.count * (_OVERHEAD_BYTES - MESSAGE_HEAD)
            self._part.write(chunk, self._numbered)
            self._queue.popleft()
            self._bytes_out += held
            self.written += chunk.count

    def _split(self) -> None:
        self._part.finish(self.dropped)
        self.paths.append(self._part.file.path)
        path = self._base.with_name(f"{self._base.stem}_{len(self.paths)}.mcap")
        self._part = Part(path, self._contents, self._chunk_bytes)
