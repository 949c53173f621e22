# SPDX-License-Identifier: Apache-2.0
"""Structured mutations of scenes, URDFs and logs: each loads, or gives one sentence of ours, soon.

All are drawn from seeds, so that a failure is named by its number and comes again.
"""

from __future__ import annotations

import contextlib
import copy
import random
import resource
import struct
import time
import xml.etree.ElementTree as ET
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("pinocchio", reason="robots need Pinocchio")
pytest.importorskip("rosbags", reason="sample logs need rosbags")

import zstandard
from log_samples import START, fill

from cable_ros.cli.log import describe, report
from cable_ros.log.errors import LogError
from cable_ros.log.events import encode_event
from cable_ros.log.history import read_history
from cable_ros.log.qos import offered_profiles
from cable_ros.log.reader import PARAMETERS, SCENE, URDF, LogReader
from cable_ros.log.recover import recover
from cable_ros.log.resolve import logged_scene, logged_tolerance
from cable_ros.log.run import LoggedRun
from cable_ros.log.writer import LogWriter
from cable_ros.scene import Kinematics, SceneError, load_scene
from cable_ros.scene.joint_limits import JointLimits
from cable_ros.scene.text import parse_yaml
from cable_ros.share import share_file

SOON = 100.0  # s, of one: what hangs never ends, and most take milliseconds
MEMORY = 500_000  # kB that a whole test may add to the process's peak

SCENES = ("space_arm.yaml", "space_arm_sphere.yaml", "space_arm_cold.yaml", "draped.yaml")
ARM_URDF = share_file("config", "space_arm.urdf").read_text()
ARM = share_file("config", "space_arm.yaml").read_text()

NUMBERS: list[Any] = [0, -1, 1e-300, 1e300, 10**400, -(10**25), float("nan"), float("inf"), 1e9, 0.5, 3]
TEXTS: list[Any] = [
    "",
    " ",
    "a\0b",
    "x" * 5000,
    "\x1b[31m",
    "\u202e",
    "\ud800",
    "../../etc/passwd",
    "/dev/zero",
]
OTHERS: list[Any] = [None, True, [], {}, [[]], [1, 2, 3], [[1, 2, 3]] * 3, {"a": {"b": 1}}, [0] * 2000]
JUNK = [*NUMBERS, *TEXTS, *OTHERS]
MARKS = [
    "\0",
    "\t",
    ":",
    "- ",
    "&a ",
    "*a",
    "!!set ",
    "<<: ",
    "{",
    "]",
    "'",
    "\ufeff",
    "\x85",
    "9" * 300,
    "%",
    "é",
]


@contextlib.contextmanager
def bounded(number: int, *errors: type[Exception]) -> Iterator[None]:
    """What happens within is over soon, and raises nothing but these, in one printable line."""
    begin = time.monotonic()
    sentence = "none was needed"
    try:
        yield
    except errors as error:
        sentence = str(error)
    except BaseException as error:
        raise AssertionError(f"mutation {number}") from error
    assert sentence.isprintable(), number
    assert 10 < len(sentence) < 3000, number
    assert time.monotonic() - begin < SOON, number


@pytest.fixture(autouse=True)
def little_memory() -> Iterator[None]:
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    yield
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < MEMORY


def places(value: Any) -> list[tuple[Any, Any]]:
    """Every (container, key) of nested mappings and lists."""
    out: list[tuple[Any, Any]] = []
    for key, entry in value.items() if isinstance(value, dict) else enumerate(value):
        out.append((value, key))
        if isinstance(entry, dict | list):
            out += places(entry)
    return out


def mutate_values(values: Any, rng: random.Random) -> None:
    """One to three changes of nested mappings and lists."""
    for _ in range(rng.choice((1, 1, 2, 3))):
        all_places = places(values)
        if not all_places:
            return
        container, key = rng.choice(all_places)
        kind = rng.randrange(9)
        if kind >= 6 and isinstance(container[key], int | float):
            container[key] *= rng.choice((0.5, 0.999, 1.001, 2.0, -1.0))
        elif kind <= 2 or kind >= 6:
            container[key] = copy.deepcopy(rng.choice(JUNK))
        elif kind == 3:
            del container[key]
        elif isinstance(container, list):
            container += [copy.deepcopy(container[key])] * rng.choice((1, 2, 1200))
        elif kind == 4:
            other, place = rng.choice(all_places)
            container[key] = copy.deepcopy(other[place])
        else:
            container[str(rng.choice(TEXTS))] = container.pop(key)


def mutate_text(text: str, rng: random.Random) -> str:
    """One to four cuts, doublings and insertions."""
    for _ in range(rng.randint(1, 4)):
        at = rng.randrange(len(text) + 1)
        size = rng.choice((1, 3, 30, 300))
        kind = rng.randrange(4)
        if kind == 0:
            text = text[:at] + text[at + size :]
        elif kind == 1:
            text = text[:at] + text[at : at + size] * rng.choice((2, 50)) + text[at + size :]
        else:
            text = text[:at] + rng.choice(MARKS) + text[at:]
    return text


def use(scene: Any) -> None:
    """What every program does with a scene before it solves."""
    kinematics = Kinematics(scene)
    JointLimits(scene, kinematics.joint_names)
    assert np.isfinite(kinematics.poses(np.zeros(len(kinematics.joint_names)))).all()


def test_scenes_as_values() -> None:
    sources = [parse_yaml(share_file("config", name).read_text(), name) for name in SCENES]
    urdfs = [share_file("config", source["robot"]["urdf"]).read_text() for source in sources]
    loaded = 0
    for number in range(400):
        rng = random.Random(f"values {number}")
        values = copy.deepcopy(sources[number % len(sources)])
        mutate_values(values, rng)
        with bounded(number, SceneError):
            use(load_scene(values, urdf=urdfs[number % len(sources)]))
            loaded += 1
    assert 20 < loaded < 200


def test_scenes_as_texts(tmp_path: Path) -> None:
    texts = [share_file("config", name).read_text() for name in SCENES]
    (tmp_path / "space_arm.urdf").write_text(ARM_URDF)
    (tmp_path / "draped.urdf").write_text(share_file("config", "draped.urdf").read_text())
    loaded = 0
    for number in range(300):
        rng = random.Random(f"text {number}")
        file = tmp_path / "scene.yaml"
        file.write_bytes(mutate_text(texts[number % len(texts)], rng).encode(errors="surrogatepass"))
        with bounded(number, SceneError):
            use(load_scene(file))
            loaded += 1
    assert 20 < loaded < 250


def mutate_urdf(root: ET.Element, rng: random.Random) -> None:
    """One to three changes of elements and attributes."""
    for _ in range(rng.choice((1, 1, 2, 3))):
        elements = list(root.iter())
        element, parent = rng.choice(elements), rng.choice(elements)
        kind = rng.randrange(6)
        if kind == 0 and element.attrib:
            del element.attrib[rng.choice(list(element.attrib))]
        elif kind in (1, 2) and element.attrib:
            texts = [t for t in TEXTS if isinstance(t, str) and t.isprintable()]
            values = [
                *texts,
                "\x85",
                "nan",
                "1e309",
                "0 0 0",
                "0 0 1 2",
                "-inf inf 0",
                "l0",
                "floating",
                "camera",
            ]
            element.set(rng.choice(list(element.attrib)), str(rng.choice([*values, *NUMBERS])))
        elif kind == 3:
            for above in elements:
                if element in list(above):
                    above.remove(element)
        elif kind == 4 and element is not root:
            parent.append(copy.deepcopy(element))
        else:
            element.tag = rng.choice(("link", "joint", "limit", "mimic", "robot", "x"))


def test_urdfs() -> None:
    scene = parse_yaml(ARM, "scene")
    loaded = 0
    for number in range(1500):
        rng = random.Random(f"urdf {number}")
        if number % 3:
            root = ET.fromstring(ARM_URDF)
            mutate_urdf(root, rng)
            text = ET.tostring(root, encoding="unicode")
        else:
            text = mutate_text(ARM_URDF, rng)
        with bounded(number, SceneError):
            use(load_scene(scene, urdf=text))
            loaded += 1
    assert 100 < loaded < 1400


_HEADER = struct.Struct("<BQ")


def records_of(data: bytes) -> list[tuple[int, bytes]]:
    """Opcode and body of each record between the magics."""
    out, position = [], 8
    while position < len(data) - 8:
        opcode, length = _HEADER.unpack_from(data, position)
        position += _HEADER.size
        out.append((opcode, data[position : position + length]))
        position += length
    return out


def damaged(body: bytes, rng: random.Random) -> bytes:
    """Some bytes changed, left out or doubled, or a number of four or eight bytes made large."""
    if not body:
        return b"\xff" * rng.randrange(1, 40)
    at, size = rng.randrange(len(body)), rng.choice((1, 2, 8, 60))
    kind = rng.randrange(6)
    if kind == 0:
        return body[:at] + bytes(rng.randrange(256) for _ in range(size)) + body[at + size :]
    if kind == 1:
        return body[:at] + body[at + size :]
    if kind == 2:
        return body[:at] + body[at : at + size] * rng.choice((2, 1000)) + body[at + size :]
    if kind == 3:
        return (
            body[:at] + rng.choice((b"\xff" * 4, b"\xff" * 8, b"\xff\xff\xff\x7f", bytes(8))) + body[at + 8 :]
        )
    if kind == 4:
        return body[:at]
    return bytes(len(body))


def inside_chunk(body: bytes, rng: random.Random) -> bytes:
    """A chunk with what it holds damaged, and its size and checksum right again."""
    start, end, size, _ = struct.unpack_from("<QQQI", body)
    (length,) = struct.unpack_from("<I", body, 28)
    content = damaged(zstandard.decompress(body[40 + length :], size), rng)
    packed = zstandard.compress(content)
    head = struct.pack("<QQQI", start, end, len(content), zlib.crc32(content))
    return head + struct.pack("<I4sQ", 4, b"zstd", len(packed)) + packed


def mutate_log(records: list[tuple[int, bytes]], rng: random.Random) -> bytes:
    """The bytes of the log with one to three records changed."""
    records = list(records)
    lengths: dict[int, int] = {}
    for _ in range(rng.choice((1, 1, 2, 3))):
        at = rng.randrange(len(records))
        opcode, body = records[at]
        kind = rng.randrange(8)
        if kind <= 2:
            records[at] = opcode, inside_chunk(body, rng) if opcode == 6 else damaged(body, rng)
        elif kind == 3:
            records[at] = rng.randrange(256), body
        elif kind == 4 and len(records) > 1:
            del records[at]
        elif kind == 5:
            records[at:at] = [records[at]] * rng.choice((1, 3, 500))
        elif kind == 6:
            lengths[at] = rng.choice((0, 1, len(body) + 1, 1 << 31, 1 << 40, (1 << 64) - 1))
        else:
            other = rng.randrange(len(records))
            records[at], records[other] = records[other], records[at]
    parts = [
        _HEADER.pack(opcode, lengths.get(i, len(body))) + body for i, (opcode, body) in enumerate(records)
    ]
    magic = b"\x89MCAP0\r\n"
    data = magic + b"".join(parts) + magic
    return data[: rng.randrange(len(data))] if rng.random() < 0.1 else data


def in_place(data: bytes, rng: random.Random) -> bytes:
    """Bytes overwritten, so that the index still says where everything is."""
    out = bytearray(data)
    for _ in range(rng.randint(1, 6)):
        at = rng.randrange(8, len(out) - 8)
        out[at : at + rng.choice((1, 4, 8))] = rng.choice(
            (b"\xff", b"\0", b"\x7f", bytes([rng.randrange(256)]))
        )
    return bytes(out)


@pytest.fixture
def log_bytes(tmp_path: Path) -> bytes:
    """A log as the node's: scene, robot, parameters, joint states, wrenches and events."""
    texts = {SCENE: ARM, URDF: ARM_URDF, PARAMETERS: "/n: {ros__parameters: {tolerance: 0.001}}"}
    path = tmp_path / "whole.mcap"
    log = LogWriter(path, attachments=texts, metadata={"host": {"a": "b"}}, chunk_bytes=1000)
    fill(log, 12)
    event = encode_event("start", tolerance=1e-3, fresh=True)
    log.write("/cable_node/events", "std_msgs/msg/String", event, START)
    log.close()
    assert log.error is None
    return path.read_bytes()


def read_everything(path: Path) -> None:
    """Each way in which our commands look at a log; what one cannot do does not keep from the next."""
    with LogReader(path) as log:
        actions: list[Callable[[], Any]] = [
            lambda: describe(log).splitlines(),
            lambda: sum(len(message.cdr) for message in log.messages()),
            lambda: sum(1 for _ in log.decoded(as_written=True)),
            lambda: list(LoggedRun([log])),
            lambda: use(logged_scene(log)),
            lambda: logged_tolerance(log),
            lambda: [offered_profiles(topic.offered_qos) for topic in log.topics.values()],
            lambda: read_history(path),
        ]
        for action in actions:
            with contextlib.suppress(LogError, SceneError):
                action()


def test_logs(tmp_path: Path, log_bytes: bytes) -> None:
    records = records_of(log_bytes)
    path, out = tmp_path / "run.mcap", tmp_path / "out.mcap"
    read = saved = 0
    for number in range(400):
        rng = random.Random(f"log {number}")
        path.write_bytes(in_place(log_bytes, rng) if number % 4 == 0 else mutate_log(records, rng))
        with bounded(number, LogError):
            read_everything(path)
            read += 1
        with bounded(number, LogError):
            found = recover(path, out)
            saved += any(found.messages.values())
            assert report(path, found).replace("\n", "").isprintable()
            with LogReader(out) as copy_:  # what is saved is a whole log
                assert sum(1 for _ in copy_.messages()) == sum(found.messages.values())
        out.unlink(missing_ok=True)
    assert 50 < read < 400
    assert saved > 150
    assert not list(tmp_path.glob("*.recovery"))
