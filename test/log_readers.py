# SPDX-License-Identifier: Apache-2.0
"""Messages by topic as four readers count them that are not ours; checksums on where a reader has them."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from collections import Counter
from pathlib import Path

import pytest
from mcap.reader import NonSeekingReader, SeekingReader

MCAP_CORE = Path(__file__).with_name("log") / "mcap_core_counts.cjs"


def by_mcap(path: Path) -> Counter[str]:
    """With the index and without it."""
    counts = []
    for kind in (SeekingReader, NonSeekingReader):
        with path.open("rb") as stream:
            messages = kind(stream, validate_crcs=True).iter_messages()
            counts.append(Counter(channel.topic for _, channel, _ in messages))
    assert counts[0] == counts[1]
    return counts[0]


def by_mcap_ros2(path: Path) -> Counter[str]:
    """Every message decoded."""
    library = pytest.importorskip("mcap_ros2.decoder", reason="mcap-ros2-support is not on this machine")
    with path.open("rb") as stream:
        reader = SeekingReader(stream, decoder_factories=[library.DecoderFactory()], validate_crcs=True)
        return Counter(channel.topic for _, channel, _, _ in reader.iter_decoded_messages())


def by_rosbags(path: Path) -> Counter[str]:
    """Every message decoded."""
    library = pytest.importorskip("rosbags.highlevel", reason="rosbags is not on this machine")
    counts: Counter[str] = Counter()
    with library.AnyReader([path]) as reader:
        for connection, _, raw in reader.messages():
            reader.deserialize(raw, connection.msgtype)
            counts[connection.topic] += 1
    return counts


def by_mcap_core(path: Path) -> Counter[str]:
    """JavaScript's reader, the one of Foxglove; skips where it is not installed (`make node_modules`)."""
    if shutil.which("node") is None:
        pytest.skip("node is not on this machine")
    folders = [os.environ.get("NODE_PATH", ""), str(Path(__file__).parents[1] / "node_modules")]
    environment = {**os.environ, "NODE_PATH": os.pathsep.join(filter(None, folders))}
    probe = ["node", "-e", "require('@mcap/core'), require('fzstd')"]
    if subprocess.run(probe, env=environment, capture_output=True, check=False).returncode:
        pytest.skip("the npm packages @mcap/core and fzstd are not on this machine; 'make node_modules'")
    done = subprocess.run(
        ["node", MCAP_CORE, path], env=environment, capture_output=True, text=True, timeout=60, check=True
    )
    return Counter(json.loads(done.stdout))


READERS = (by_mcap, by_mcap_ros2, by_rosbags, by_mcap_core)
