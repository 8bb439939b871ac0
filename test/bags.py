"""Bags for tests: altered, damaged and cut copies of recorded runs, and rerun's own tools for them."""

from __future__ import annotations

import subprocess
import sys
from itertools import product
from pathlib import Path

from mcap.reader import make_reader
from mcap.records import ChunkIndex
from mcap.writer import Writer

RERUN = Path(sys.executable).with_name("rerun")


def bag(run: Path) -> Path:
    """Path of the MCAP file of a run."""
    (file,) = run.glob("*.mcap")
    return file


def alter(source: Path, target: Path, change, *, metadata=None, chunk_size=1 << 20, qos=None, shifts=(0,)) -> Path:
    """Rewrite a bag by mcap's own writer, with messages altered or left out.

    `change` gives what stands for topic, stamp and data, None for nothing; `metadata` replaces values of the run's,
    `chunk_size` is in bytes, `qos` gives the QoS of one topic after the other, and all messages are written once for
    each of `shifts` (ns), later by that time.
    """
    with source.open("rb") as stream, target.open("wb") as output:
        reader = make_reader(stream)
        writer = Writer(output, chunk_size)
        writer.start("ros2", "test")
        for record in reader.iter_metadata():
            changed = {**record.metadata, **(metadata or {})} if record.name == "cable_twin" else record.metadata
            writer.add_metadata(record.name, changed)
        channels = {}
        for shift, (schema, channel, message) in product(shifts, list(reader.iter_messages(log_time_order=False))):
            if channel.id not in channels:
                schema_id = writer.register_schema(schema.name, schema.encoding, schema.data)
                given = channel.metadata if qos is None else {"offered_qos_profiles": next(qos)}
                channels[channel.id] = writer.register_channel(channel.topic, "cdr", schema_id, given)
            data = change(channel.topic.removeprefix("/cable_twin/"), message.log_time, message.data)
            if data is not None:
                times = message.log_time + shift, message.publish_time + shift
                writer.add_message(channels[channel.id], times[0], data, times[1], message.sequence)
        writer.finish()
    return target


def cut_short(source: Path, target: Path, part: float) -> Path:
    """First part of a bag, as left by a kill, in chunks as small as those of a run in real time."""
    content = alter(source, target, unchanged, chunk_size=20_000).read_bytes()
    target.write_bytes(content[: round(part * len(content))])
    return target


def damage_middle(file: Path) -> None:
    """Spoil the chunk in the middle of a finished bag."""
    chunks = chunks_of(file)
    content = bytearray(file.read_bytes())
    middle = chunks[len(chunks) // 2].chunk_start_offset + 100
    content[middle : middle + 200] = bytes(200)
    file.write_bytes(content)


def chunks_of(file: Path) -> list[ChunkIndex]:
    """Chunk entries in the index of a finished bag, in their order."""
    with file.open("rb") as stream:
        return sorted(make_reader(stream).get_summary().chunk_indexes, key=lambda index: index.chunk_start_offset)


def chunk_with(file: Path, topic: str) -> ChunkIndex:
    """First chunk with messages of a topic, by the usual name of the topic."""
    with file.open("rb") as stream:
        channels = make_reader(stream).get_summary().channels
    named = {number for number, channel in channels.items() if channel.topic == f"/cable_twin/{topic}"}
    return next(chunk for chunk in chunks_of(file) if not named.isdisjoint(chunk.message_index_offsets))


def flip_bit(file: Path, place: int) -> None:
    """Invert one bit of the byte at an offset."""
    content = bytearray(file.read_bytes())
    content[place] ^= 0x10
    file.write_bytes(content)


def flip_chunk(file: Path, chunk: ChunkIndex) -> None:
    """Invert one bit in the middle of the data of a chunk."""
    flip_bit(file, chunk.chunk_start_offset + chunk.chunk_length - chunk.compressed_size // 2)


def unchanged(_topic: str, _stamp_ns: int, data: bytes) -> bytes:
    return data


def foreign_bag(path: Path) -> Path:
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start("ros2", "somebody else")
        schema = writer.register_schema("std_msgs/msg/String", "ros2msg", b"string data")
        writer.add_message(writer.register_channel("/chatter", "cdr", schema), 0, b"\x00\x01\x00\x00", 0)
        writer.finish()
    return path


def text_file(path: Path) -> Path:
    path.write_text("not a bag")
    return path


def empty_file(path: Path) -> Path:
    path.touch()
    return path


def empty_directory(path: Path) -> Path:
    path.mkdir()
    return path


NO_BAGS = {
    "missing": (lambda path: path, "no such file or directory"),
    "foreign": (foreign_bag, "not a bag made by cable_twin"),
    "text": (text_file, "not a bag"),
    "empty": (empty_file, "not a bag"),
    "directory": (empty_directory, "not a log: given 0 .mcap files; allowed: those of one run"),
}


def rerun_command(*arguments):
    """Run one of rerun's own tools; returns its output."""
    run = subprocess.run([RERUN, *map(str, arguments)], capture_output=True, text=True, timeout=300, check=False)
    assert run.returncode == 0, run.stdout + run.stderr
    return run.stdout + run.stderr
