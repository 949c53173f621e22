# SPDX-License-Identifier: Apache-2.0
"""Input that means harm: what the command says, how long it takes, how much memory it has at most.

    python benchmarks/hostile_input.py    # a table as in docs/input.md

Each input goes to the command that a user would give it, in a process of its own.
"""

from __future__ import annotations

import os
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import lz4.frame
import zstandard

from cable_ros.log.events import encode_event
from cable_ros.log.writer import LogWriter
from cable_ros.share import share_file

ARM = share_file("config", "space_arm.yaml").read_text()
URDF = share_file("config", "space_arm.urdf").read_text()
HEAVY = """
gravity: [0, 0, -9.80665]
cables:
  - name: hose
    length: 0.4
    stiffness: [1.0e-3, 1.0e-3, 7.0e-4]
    outer_diameter: 0.012
    linear_density: 150
    start: {position: [0, 0, 0], orientation: [0, 0, 0, 1]}
    end: {position: [0.2, 0, 0], orientation: [0, 0, 0, 1]}
"""
SOLVE = ("solve", "{}", "--joint", "orientation=0")
RECOVER = ("log", "recover", "{}")
RESOLVE = ("replay", "{}", "--resolve")
LONGEST = 150  # characters of a sentence that are shown


def scene(folder: Path, text: str, urdf: str = URDF) -> Path:
    """A scene with its URDF beside it."""
    (folder / "space_arm.urdf").write_text(urdf)
    path = folder / "scene.yaml"
    path.write_bytes(text.encode())
    return path


def changed(old: str, new: str) -> Callable[[Path], Path]:
    """The arm's scene with another text in it."""
    assert old in ARM
    return lambda folder: scene(folder, ARM.replace(old, new))


def robot(urdf: str) -> Callable[[Path], Path]:
    """The arm's scene with another robot."""
    return lambda folder: scene(folder, ARM, urdf)


def pipe(folder: Path) -> Path:
    """A pipe that nobody writes."""
    os.mkfifo(folder / "scene.yaml")
    return folder / "scene.yaml"


def nested(folder: Path) -> Path:
    """YAML in which each of 30 lists has the one before nine times."""
    lines = [f"a{i}: &a{i} [{f'*a{i - 1}, ' * 9}]" for i in range(1, 30)]
    return scene(folder, "\n".join(["a0: &a0 [x, x]", *lines]))


def chain(count: int) -> str:
    """A robot of that many joints in a row."""
    links = "".join(f'<link name="l{i}"/>' for i in range(count + 1))
    joints = (
        f'<joint name="j{i}" type="revolute"><parent link="l{i}"/><child link="l{i + 1}"/></joint>'
        for i in range(count)
    )
    return f'<robot name="r">{links}{"".join(joints)}</robot>'


def chunk(compression: str, data: bytes, size: int) -> Callable[[Path], Path]:
    """A log of one chunk that says it holds `size` bytes."""
    name = compression.encode()
    body = struct.pack("<QQQI", 1, 1, size, 0) + struct.pack("<I", len(name)) + name
    body += struct.pack("<Q", len(data)) + data

    def write(folder: Path) -> Path:
        path = folder / "run.mcap"
        head = b"\x89MCAP0\r\n" + struct.pack("<BQII", 1, 8, 0, 0)
        path.write_bytes(head + struct.pack("<BQ", 6, len(body)) + body)
        return path

    return write


def zeros(compression: str, size: int) -> bytes:
    """Zero bytes, compressed bit by bit."""
    block = bytes(1 << 20)
    if compression == "zstd":
        packer = zstandard.ZstdCompressor().compressobj()
        return b"".join([packer.compress(block) for _ in range(size >> 20)]) + packer.flush()
    frame = lz4.frame.LZ4FrameCompressor()
    return frame.begin() + b"".join(frame.compress(block) for _ in range(size >> 20)) + frame.flush()


def logged(event: bytes = b"", **attachments: str) -> Callable[[Path], Path]:
    """A log as the node's, with these attachments (`scene_yaml` for scene.yaml) and an event."""

    def write(folder: Path) -> Path:
        texts = {name.replace("_", "."): text for name, text in attachments.items()}
        with LogWriter(folder / "run.mcap", attachments={"scene.yaml": ARM, **texts}) as log:
            if event:
                log.write("/n/events", "std_msgs/msg/String", event, 1)
            for topic, kind in (("/n/camera_cable/end_wrench", "WrenchStamped"), ("/joint_states", "")):
                package = "geometry_msgs" if kind else "sensor_msgs"
                log.write(topic, f"{package}/msg/{kind or 'JointState'}", b"\0\1\0\0" + bytes(120), 2)
        return folder / "run.mcap"

    return write


MILLION = 1_100_000
INPUTS: dict[str, tuple[Callable[[Path], Path], tuple[str, ...]]] = {
    "`urdf: /dev/zero`": (changed("space_arm.urdf", "/dev/zero"), SOLVE),
    "a pipe for a scene": (pipe, SOLVE),
    "lists of lists by aliases": (nested, SOLVE),
    "an integer of 400 digits": (changed("length: 0.380", f"length: {'9' * 400}"), SOLVE),
    '`"a\\0b"` for a name': (changed("name: camera_cable", 'name: "a\\0b"'), SOLVE),
    "`gravity: -9806`": (changed("gravity: [", "gravity: [-9806, 0, 0]\n#"), SOLVE),
    "150 kg/m in 12 mm": (lambda folder: scene(folder, HEAVY), SOLVE),
    "a chain of 20,000 links": (robot(chain(20_000)), SOLVE),
    "a chain of 9,000 links": (robot(chain(9_000)), SOLVE),
    "parent link not defined": (robot(URDF.replace('<link name="base"/>', "")), SOLVE),
    "a joint's name twice": (robot(URDF.replace('name="pitch"', 'name="orientation"')), SOLVE),
    "two roots": (robot(URDF.replace("</robot>", '<link name="b"/></robot>')), SOLVE),
    "5 million elements": (robot(f"<robot>{'<a/>' * 5_000_000}</robot>"), SOLVE),
    "2 GB of zeros, zstd, as said": (chunk("zstd", zeros("zstd", 1 << 31), 1 << 31), RECOVER),
    "2 GB of zeros, lz4, 1 kB said": (chunk("lz4", zeros("lz4", 1 << 31), 1024), RECOVER),
    "100 MB of zeros, zstd": (chunk("zstd", zeros("zstd", 100 << 20), 100 << 20), RECOVER),
    "a million empty records": (
        chunk("zstd", zstandard.compress(struct.pack("<BQ", 0x90, 0) * MILLION), 9 * MILLION),
        RECOVER,
    ),
    "damaged `parameters.yaml`": (logged(parameters_yaml="{[", robot_urdf=URDF), RESOLVE),
    "a scene that names a URDF": (logged(), RESOLVE),
    "nested JSON": (logged(encode_event("x")[:8] + b"[" * 90_000 + b"\0", robot_urdf=URDF), RESOLVE),
    "a tolerance of 5": (logged(encode_event("set", tolerance=5.0), robot_urdf=URDF), RESOLVE),
}


def measure(make: Callable[[Path], Path], command: tuple[str, ...]) -> tuple[int, str, float, float]:
    """Exit code, the sentence, seconds and MB of the command on what `make` makes."""
    with tempfile.TemporaryDirectory() as folder:
        path = make(Path(folder))
        words = [word.format(path) for word in command]
        begin = time.monotonic()
        process = subprocess.Popen(
            [sys.executable, "-m", "cable_ros.cli.main", *words],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        assert process.stdout is not None
        assert process.stderr is not None
        out, said = process.stdout.read(), process.stderr.read()
        _, status, usage = os.wait4(process.pid, 0)
        seconds = time.monotonic() - begin
        process.returncode = os.waitstatus_to_exitcode(status)
        lost = [line for line in out.splitlines() if line.startswith("lost: ")]
        sentence = (lost or said.strip().splitlines() or ["done"])[0 if lost else -1]
        return process.returncode, sentence.replace(f"{folder}/", ""), seconds, usage.ru_maxrss / 1e3


def main() -> None:
    """Print the table."""
    print("| input | exit code | what is said | s | MB |\n|---|---|---|---|---|")
    for name, (make, command) in INPUTS.items():
        code, sentence, seconds, memory = measure(make, command)
        shown = sentence if len(sentence) <= LONGEST else f"{sentence[:LONGEST]} ..."
        print(f"| {name} | {code} | {shown} | {seconds:.1f} | {memory:.0f} |", flush=True)


if __name__ == "__main__":
    main()
