"""Malicious bags, unpacking to gigabytes, with stamps of years or invalid contents: refused in a line."""

from __future__ import annotations

import os
import struct
import zlib
from dataclasses import replace

import psutil
import pytest
import zstandard
from bags import alter, unchanged
from logged_run import COMMANDS, EPOCH, METADATA, open_log, run_messages, write_run
from mcap.data_stream import RecordBuilder
from mcap.records import Chunk
from mcap.writer import MCAP0_MAGIC

from cable_twin.messages import APPLIED_COMMANDS, SCENARIO, serialize
from cable_twin.messages.command_messages import applied_command_message
from cable_twin.messages.topics import String
from cable_twin.offline.review import main as review
from cable_twin.recording.log_file import LogError
from cable_twin.recording.log_reader import read_log
from cable_twin.recording.mcap_records import CHUNK_LIMIT

GIGABYTE = 2**30
MEMORY = 300e6  # bytes that reading may take
YEARS = 30 * 365 * 86400 * 10**9  # ns


@pytest.fixture
def sound(tmp_path):
    """Log file of twenty frames."""
    log = open_log(tmp_path / "run")
    write_run(log, 20)
    log.close()
    return log.path


def read_all(path) -> tuple[list, list[str]]:
    """Read all messages and damage of a log; fails where that takes too much memory."""
    before = psutil.Process().memory_info().rss
    log = read_log(path)
    messages = list(log.messages())
    assert psutil.Process().memory_info().rss - before < MEMORY
    return messages, log.damage


def zeros(size: int) -> bytes:
    """Compressed zeros, some thousand times smaller than unpacked."""
    compressor = zstandard.ZstdCompressor(level=1).compressobj(size)
    block = bytes(2**24)
    return b"".join(compressor.compress(block) for _ in range(size // len(block))) + compressor.flush()


def chunk_record(data: bytes, size: int, checksum: int = 0, compression: str = "zstd") -> bytes:
    builder = RecordBuilder()
    Chunk(compression, data, EPOCH, EPOCH, checksum, size).write(builder)
    return builder.end()


def cut(sound) -> bytes:
    """Part of a log before its index."""
    content = sound.read_bytes()
    footer = len(content) - len(MCAP0_MAGIC) - 20
    (summary,) = struct.unpack_from("<Q", content, footer)
    return content[: summary - 13]  # without the record that ends the data


@pytest.mark.parametrize("says", [3 * GIGABYTE, 1000, CHUNK_LIMIT], ids=["3 GB", "too little", "what is allowed"])
def test_a_chunk_is_not_unpacked_to_more_than_is_allowed(sound, says):
    sound.write_bytes(cut(sound) + chunk_record(zeros(3 * GIGABYTE), says))
    messages, damage = read_all(sound)
    assert messages == run_messages(20)
    assert "unpacks to" in damage[0]


def test_many_chunks_are_not_unpacked_to_more_than_is_allowed(sound):
    size = CHUNK_LIMIT // 2
    head = struct.pack("<BQ", 0x80, size - 9)  # of one long record of a kind that nobody knows
    data = zstandard.compress(head + bytes(size - 9))
    sound.write_bytes(cut(sound) + 200 * chunk_record(data, size))
    messages, damage = read_all(sound)
    assert messages == run_messages(20)
    assert any("more than 200 times its size" in line for line in damage) or damage[-1] == "and more"


def test_chunks_within_chunks_and_in_the_index_are_not_unpacked(sound):
    bomb = chunk_record(zeros(GIGABYTE // 2), GIGABYTE // 2)
    within = chunk_record(bomb, len(bomb), zlib.crc32(bomb), "")
    sound.write_bytes(cut(sound) + within)
    messages, damage = read_all(sound)
    assert messages == run_messages(20)
    assert "in a chunk" in damage[0]


@pytest.mark.parametrize("length", [2**62, 2**33, 2**27 + 1])
def test_lengths_are_not_believed(sound, length):
    sound.write_bytes(cut(sound) + struct.pack("<BQ", 6, length) + bytes(1000))
    messages, _ = read_all(sound)
    assert messages == run_messages(20)
    (sound.parent / "head.mcap").write_bytes(MCAP0_MAGIC + struct.pack("<BQ", 12, length) + bytes(100))
    with pytest.raises(LogError, match="not a bag, or empty"):
        read_log(sound.parent / "head.mcap")


def test_what_never_ends_is_not_opened(tmp_path):
    os.mkfifo(tmp_path / "run_0.mcap")
    for path in (tmp_path, tmp_path / "run_0.mcap"):
        with pytest.raises(LogError, match=r"not a regular file|not a log"):
            read_log(path)


MANY = "9" * 5000


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("format_version", MANY, "format version: given '9999"),
        ("epoch_ns", MANY, "epoch_ns: given '9999"),
        ("epoch_ns", "²", "epoch_ns: given '²'"),
        ("epoch_ns", str(2**63), "epoch_ns: given '9223372036854775808'"),
        ("sample_count", MANY, "sample_count: given '9999"),
        ("sample_count", "1", "sample_count: given '1'; allowed: a whole number of points, 2 to 100000"),
        ("sample_count", "1000000000", "sample_count: given '1000000000'"),
        ("remapped", "[]", "remapped: given '[]'"),
        ("remapped", '{"cable": 3}', "remapped: given"),
        ("remapped", "[" * 100_000, "remapped: given"),
        ("remapped", "{", "remapped: given '{'"),
        ("commands_lost_from", "-1", "commands_lost_from: given '-1'"),
        ("commands_lost_from", "", "commands_lost_from: given ''"),
    ],
)
def test_metadata_of_another_kind_are_said(tmp_path, key, value, said):
    log = open_log(tmp_path / "run", metadata={**METADATA, key: value})
    write_run(log, 1)
    log.close()
    with pytest.raises(LogError) as caught:
        read_log(log.path)
    assert said in str(caught.value)
    assert len(str(caught.value)) < 300 + len(str(log.path))
    assert "\n" not in str(caught.value)


def test_a_scenario_nested_deep_is_said(sound, tmp_path):
    deep = serialize(String("[" * 100_000))
    target = alter(sound, tmp_path / "deep.mcap", lambda topic, _, data: deep if topic == SCENARIO else data)
    with pytest.raises(LogError, match="scenario is unreadable"):
        read_log(target)


@pytest.mark.parametrize("time", [-float(2**31) - EPOCH * 1e-9 + 4000.0, 1e8, 0.01])
def test_commands_of_another_time_than_their_message_are_said(sound, tmp_path, time):
    wrong = applied_command_message(replace(COMMANDS[0], time=time), EPOCH)
    target = alter(sound, tmp_path / "odd.mcap", lambda topic, _, data: wrong if topic == APPLIED_COMMANDS else data)
    with pytest.raises(LogError, match=r"command at 0.000000 s is unreadable: its message gives "):
        _ = read_log(target).commands


def test_stamps_that_jump_by_years_end_what_is_read(sound, tmp_path, capsys):
    def later(_topic, stamp_ns, data):
        return data if stamp_ns < EPOCH + 10**8 else None

    short = alter(sound, tmp_path / "short.mcap", later)
    jumped = alter(short, tmp_path / "jumped.mcap", unchanged, shifts=(0, YEARS))
    log = read_log(jumped)
    assert list(log.messages()) == list(read_log(short).messages())
    assert "does not belong to this run" in log.damage[0]
    assert log.end == read_log(short).end < 0.2
    assert review([str(jumped), "--repair"]) == 0
    assert "does not belong to this run" in capsys.readouterr().out
