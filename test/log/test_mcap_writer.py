# SPDX-License-Identifier: Apache-2.0
"""Our MCAP writer against the mcap package's: what its readers find in either file is the same."""

from __future__ import annotations

import io
import random
import struct
import zlib
from typing import Any

import pytest
from mcap.reader import NonSeekingReader, SeekingReader
from mcap.records import Chunk, Footer, MessageIndex
from mcap.stream_reader import StreamReader, get_chunk_data_stream
from mcap.writer import Writer

from cable_ros.log.mcap_writer import McapWriter

CHUNK_BYTES = 2000
START = 1_700_000_000_000_000_000  # ns


def write(writer: Any, count: int = 200) -> None:
    """Messages of all sizes on three channels, one of which nothing is sent on, out of order in time."""
    rng = random.Random(3)
    writer.start(profile="ros2", library="test")
    writer.add_attachment(1, 2, "scene.yaml", "application/yaml", b"cables: []\n")
    writer.add_metadata("host", {"name": "ä", "": "b"})
    schema = writer.register_schema("a/msg/B", "ros2msg", b"float64 c\n")
    channels = [writer.register_channel(f"/{name}", "cdr", schema, {"k": name}) for name in "abc"]
    for i in range(count):
        if i == count // 2:
            channels[1] = writer.register_channel("/late", "cdr", 0, {})
        time = START + i * 1000 + rng.randrange(-5000, 5000)
        data = rng.randbytes(rng.choice([0, 1, 40, 300]))
        writer.add_message(rng.choice(channels[:2]), time, data, time + 7, i)
        if i % 70 == 69:
            writer.flush()
    writer.add_metadata("end", {"dropped": "0"})
    writer.finish()


def summary_of(file: io.BytesIO) -> Any:
    file.seek(0)
    return SeekingReader(file).get_summary()


@pytest.fixture(params=[0, 1, 200])
def files(request):
    ours, theirs = io.BytesIO(), io.BytesIO()
    write(McapWriter(ours, CHUNK_BYTES), request.param)
    write(Writer(theirs, chunk_size=CHUNK_BYTES), request.param)
    return ours, theirs


@pytest.mark.parametrize("kind", [SeekingReader, NonSeekingReader])
def test_every_reader_finds_the_same_in_both_files(files, kind):
    found = []
    for file in files:
        file.seek(0)
        messages = [m for _, _, m in kind(file, validate_crcs=True).iter_messages(log_time_order=True)]
        file.seek(0)
        attachments = list(kind(file).iter_attachments())
        file.seek(0)
        found.append((messages, attachments, list(kind(file).iter_metadata())))
    assert found[0] == found[1]


def test_the_summary_is_the_same_but_for_the_chunks(files):
    ours, theirs = map(summary_of, files)
    assert ours.schemas == theirs.schemas
    assert ours.channels == theirs.channels
    assert ours.statistics == theirs.statistics
    # Where one chunk ends and the next begins may differ; what they hold together may not.
    for chunks in (ours.chunk_indexes, theirs.chunk_indexes):
        assert all(c.uncompressed_size < 2 * CHUNK_BYTES for c in chunks)
    sizes = [sum(c.uncompressed_size for c in summary.chunk_indexes) for summary in (ours, theirs)]
    assert sizes[0] == sizes[1]


def test_the_indexes_point_to_what_they_say(files):
    data = files[0].getvalue()
    summary = summary_of(files[0])
    files[0].seek(0)
    pending: list[Chunk] = []
    seen = 0
    for record in StreamReader(files[0], emit_chunks=True, validate_crcs=True).records:
        if isinstance(record, Chunk):
            pending = [record]
        elif isinstance(record, MessageIndex):
            body = get_chunk_data_stream(pending[0])[0].read(pending[0].uncompressed_size)
            for time, place in record.records:
                opcode, _, channel, _, log_time = struct.unpack_from("<BQHIQ", body, place)
                assert (opcode, channel, log_time) == (5, record.channel_id, time)
                seen += 1
        elif isinstance(record, Footer):
            start = record.summary_start
            assert record.summary_crc == zlib.crc32(data[start:-12])  # all but the checksum and the magic
    assert seen == summary.statistics.message_count
    for chunk in summary.chunk_indexes:
        assert data[chunk.chunk_start_offset] == 6
        end = chunk.chunk_start_offset + chunk.chunk_length
        for channel, place in chunk.message_index_offsets.items():
            assert struct.unpack_from("<BQH", data, place)[::2] == (7, channel)
            assert end <= place < end + chunk.message_index_length
    for index in (*summary.attachment_indexes, *summary.metadata_indexes):
        opcode, length = struct.unpack_from("<BQ", data, index.offset)
        assert (opcode, length + 9) == ({True: 9, False: 12}[hasattr(index, "media_type")], index.length)


def test_what_cannot_be_packed_changes_nothing():
    stream = io.BytesIO()
    writer = McapWriter(stream, CHUNK_BYTES)
    writer.start("ros2", "test")
    channel = writer.register_channel("/a", "cdr", 0, {})
    writer.add_message(channel, 1, b"one", 1, 0)
    with pytest.raises(struct.error):
        writer.add_message(channel, -1, b"before the epoch", 1, 1)
    writer.add_message(channel, 2, b"two", 2, 2)
    writer.finish()
    stream.seek(0)
    assert [m.data for _, _, m in SeekingReader(stream).iter_messages()] == [b"one", b"two"]
