# SPDX-License-Identifier: Apache-2.0
"""Recovery keeps every chunk that is whole, wherever the file was cut or damaged."""

from __future__ import annotations

import random

import pytest
from log_samples import WRENCH
from mcap.reader import SeekingReader
from mcap.records import Chunk, Message
from mcap.stream_reader import StreamReader, breakup_chunk

from cable_ros.log.errors import LogError
from cable_ros.log.reader import LogReader
from cable_ros.log.recover import default_output, recover


@pytest.fixture
def log_path(write_log):
    return write_log(150, chunk_bytes=1500, attachments={"scene.yaml": "a scene"})


def ends_of_chunks(path):
    """Of each chunk: the byte after it, and how many messages the file holds up to there."""
    ends, count = [], 0
    with path.open("rb") as stream:
        for record in StreamReader(stream, emit_chunks=True).records:
            if isinstance(record, Chunk):
                count += sum(isinstance(r, Message) for r in breakup_chunk(record))
                ends.append((stream.tell(), count))
    return ends


def test_cut_anywhere_every_whole_chunk_is_kept(log_path, tmp_path):
    data = log_path.read_bytes()
    with LogReader(log_path) as log:
        messages = list(log.messages(as_written=True))
    ends = ends_of_chunks(log_path)
    assert len(ends) > 15
    cut, out = tmp_path / "cut.mcap", tmp_path / "saved.mcap"
    random_offsets = random.Random(7)
    offsets = {8, len(data)} | {random_offsets.randrange(8, len(data)) for _ in range(300)}
    offsets |= {end + shift for end, _ in ends[:10] for shift in (-1, 0, 1)}
    for offset in sorted(offsets):
        cut.write_bytes(data[:offset])
        saved = recover(cut, out)
        expected = max((count for end, count in ends if end <= offset), default=0)
        with LogReader(out) as log:
            assert list(log.messages(as_written=True)) == messages[:expected], offset
            assert sum(saved.messages.values()) == expected
        out.unlink()


def test_a_damaged_chunk_in_the_middle_costs_only_itself(log_path, tmp_path):
    with LogReader(log_path) as log:
        before = list(log.messages(as_written=True))
    with log_path.open("rb") as stream:
        chunk = SeekingReader(stream).get_summary().chunk_indexes[5]
    data = bytearray(log_path.read_bytes())
    data[chunk.chunk_start_offset + chunk.chunk_length - 40] ^= 0xFF
    log_path.write_bytes(data)

    with (
        LogReader(log_path) as log,
        pytest.raises(LogError, match=r"damaged before byte \d+.*cable log recover"),
    ):
        list(log.messages())
    saved = recover(log_path)
    assert saved.path.name == "run_recovered.mcap"
    assert [d.offset for d in saved.damages] == [chunk.chunk_start_offset]
    with LogReader(saved.path) as log:
        after = list(log.messages(as_written=True))
    lost = [m for m in before if m not in after]
    assert after == [m for m in before if m not in lost]
    assert 0 < len(lost) < 40
    assert all(chunk.message_start_time <= m.log_time <= chunk.message_end_time for m in lost)


def test_the_first_chunk_names_the_topics_but_its_loss_costs_only_itself(log_path):
    with log_path.open("rb") as stream:
        chunk = SeekingReader(stream).get_summary().chunk_indexes[0]
    data = bytearray(log_path.read_bytes())
    data[chunk.chunk_start_offset + chunk.chunk_length - 40] ^= 0xFF
    log_path.write_bytes(data)
    saved = recover(log_path)
    assert saved.messages[WRENCH] > 100
    assert saved.orphans == 0


def test_a_whole_log_is_copied_and_nothing_is_said_to_be_lost(log_path, tmp_path):
    saved = recover(log_path, tmp_path / "copy.mcap")
    assert saved.was_whole
    assert not saved.damages
    with LogReader(log_path) as log, LogReader(saved.path) as copy:
        assert list(log.messages()) == list(copy.messages())
        assert copy.attachments == log.attachments
        assert {k: v for k, v in copy.metadata.items() if k != "rosbag2"} == {
            k: v for k, v in log.metadata.items() if k != "rosbag2"
        }
        assert copy.topics == log.topics


def test_what_is_not_a_log_is_one_sentence(tmp_path, log_path):
    (tmp_path / "text.mcap").write_text("not a log")
    with pytest.raises(LogError, match="does not begin as an MCAP file does"):
        recover(tmp_path / "text.mcap", tmp_path / "out.mcap")
    with pytest.raises(LogError, match="does not begin as an MCAP file does"):
        LogReader(tmp_path / "text.mcap")
    with pytest.raises(LogError, match="no such file"):
        recover(tmp_path / "none.mcap")
    with pytest.raises(LogError, match="it is the log to recover"):
        recover(log_path, log_path)
    with pytest.raises(LogError, match="exists already"):
        recover(log_path, tmp_path / "text.mcap")
    assert not (tmp_path / "out.mcap").exists()


def test_the_new_file_is_named_after_the_log(tmp_path):
    assert default_output(tmp_path / "a.mcap.part") == tmp_path / "a.mcap"
    assert default_output(tmp_path / "a.mcap") == tmp_path / "a_recovered.mcap"
