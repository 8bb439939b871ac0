"""Bags with changed bytes, records, messages, metadata and states, to `review`, `replay` and `simulate --from-bag`."""

from __future__ import annotations

import json
import struct
import tempfile
import zlib
from collections.abc import Callable
from contextlib import redirect_stdout, suppress
from functools import cache
from io import BytesIO, StringIO
from pathlib import Path
from typing import Any

import numpy as np
import zstandard
from hypothesis import strategies as st
from mcap.data_stream import RecordBuilder
from mcap.reader import make_reader
from mcap.records import Attachment, Chunk
from mcap.writer import MCAP0_MAGIC, CompressionType, Writer

from fuzzing import DONE, REFUSED, Case
from fuzzing.mutations import EXTREMES, NOT_FINITE, changed, changed_bytes, texts

NAMES = "seed_example", "windy_tramway", "chairlift"  # one rope in a plane, one in space, and several
DURATION, SPLIT = "1.3", "1"  # s
STAMPS = (0, 1, -(2**31) * 10**9 % 2**64, 2**31 * 10**9, 2**63 - 1, 2**63, 2**64 - 1, 30 * 365 * 86400 * 10**9)
WORDS = MCAP0_MAGIC, b"\x04\x00\x00\x00zstd", b"cable_twin", b"\xff" * 8, b"\x00" * 64, struct.pack("<BQ", 6, 2**62)
KEYS = "format_version", "epoch_ns", "sample_count", "remapped", "namespace", "starts_from", "file", "frame_id"
LATER_KEYS = "commands_lost_from", "after_loss", "scenario_text", "scenario_crc32", "frame_prefix", "package_version"
given_texts = st.one_of(
    texts, st.sampled_from(("9" * 5000, "²", "-1", "1e9", "[]", "{}", '{"cable": "/x"}', "[" * 50_000, "x" * 100_000))
)


@cache
def originals() -> list[bytes]:
    """Valid bags from a start, and valid bags from an attached state."""
    from cable_twin.offline.simulate import main  # noqa: PLC0415 - only where cases are made

    with tempfile.TemporaryDirectory() as directory:
        script = Path(directory) / "script.yaml"
        script.write_text(
            "[{time: 0.2, event: emergency_stop}, {time: 0.6, event: reset}, {time: 1.1, event: release}]"
        )
        options = ["--duration", DURATION, "--split-duration", SPLIT, "--record", "bag", "--output", directory]
        for name in NAMES:
            with redirect_stdout(StringIO()):
                main([name, "--script", str(script), *options])
        return [file.read_bytes() for file in sorted(Path(directory).glob("*/*.mcap"))]


def first() -> list[Case]:
    """First cases: a valid bag, and a bag without any frame."""
    sound = originals()[0]
    return [Case(sound, ".mcap"), Case(sound[:20], ".mcap")]


def cases() -> st.SearchStrategy[Case]:
    """Valid bags with some changes, and malicious files."""
    originals()
    return _cases()


@st.composite
def _cases(draw: Callable[..., Any]) -> Case:
    content = draw(st.sampled_from(originals()))
    way = draw(st.sampled_from(("bytes", "messages", "messages", "metadata", "scenario", "state", "index", "bomb")))
    if way == "bytes":
        return Case(draw(changed_bytes(content, WORDS)), ".mcap")
    if way == "index":
        return Case(draw(_changed_numbers(content)), ".mcap")
    if way == "bomb":
        return Case(_without_index(content) + draw(_bombs()), ".mcap")
    return Case(draw(_written_anew(content, way)), ".mcap")


@st.composite
def _changed_numbers(draw: Callable[..., Any], content: bytes) -> bytes:
    """Bag with changed offsets, lengths and counts in its index or record heads, without a checksum."""
    data = bytearray(content)
    with suppress(struct.error):
        footer = len(data) - len(MCAP0_MAGIC) - 20
        (start,) = struct.unpack_from("<Q", data, footer)
        data[-len(MCAP0_MAGIC) - 4 : -len(MCAP0_MAGIC)] = bytes(4)
        for _ in range(draw(st.integers(1, 4))):
            place = (
                draw(st.integers(start, footer + 8)) if draw(st.booleans()) else draw(st.integers(8, len(data) - 16))
            )
            kind, values = draw(st.sampled_from((("<Q", (0, 1, 2**33, 2**62, start)), ("<I", (0, 2**31, 2**32 - 1)))))
            struct.pack_into(kind, data, place, draw(st.sampled_from(values)))
    return bytes(data)


@st.composite
def _bombs(draw: Callable[..., Any]) -> bytes:
    """Bag with chunks of wrong sizes, or unpacking to too much, nested or repeated."""
    size = draw(st.sampled_from((2**20, 2**26, 2**28)))
    fill = draw(st.sampled_from((b"\x00", b"\x05\x16" + bytes(7 + 22), b"\x80\x00" + bytes(7), b"\xff")))
    data = _packed(fill, size)
    record = _chunk(data, draw(st.sampled_from((size, size // len(fill) * len(fill), 0, 1, 2**40, 2**63))))
    for _ in range(draw(st.integers(0, 2))):
        record = _chunk(record, len(record), zlib.crc32(record), "")
    return record * draw(st.sampled_from((1, 1, 3, 200)))


@cache
def _packed(fill: bytes, size: int) -> bytes:
    block = fill * (2**20 // len(fill))
    compressor = zstandard.ZstdCompressor(level=1).compressobj()
    return b"".join(compressor.compress(block) for _ in range(size // len(block))) + compressor.flush()


def _chunk(data: bytes, size: int, checksum: int = 0, compression: str = "zstd") -> bytes:
    builder = RecordBuilder()
    Chunk(compression, data, 1, 0, checksum, size).write(builder)
    return builder.end()


def _without_index(content: bytes) -> bytes:
    footer = len(content) - len(MCAP0_MAGIC) - 20
    return content[: struct.unpack_from("<Q", content, footer)[0] - 13]


@st.composite
def _written_anew(draw: Callable[..., Any], content: bytes, way: str) -> bytes:
    """Bag rewritten by mcap's own writer, with a change named by `way`."""
    reader, output = make_reader(BytesIO(content)), BytesIO()
    whole, compression = draw(st.booleans()), draw(st.sampled_from(list(CompressionType)))
    writer = Writer(
        output, draw(st.sampled_from((1 << 20, 20_000))), compression, use_chunking=draw(st.booleans()) or whole
    )
    writer.start("ros2", "fuzzing")
    for record in reader.iter_metadata():
        entries = dict(record.metadata)
        if way == "metadata" and record.name == "cable_twin":
            for _ in range(draw(st.integers(1, 3))):
                entries[draw(st.sampled_from((*KEYS, *LATER_KEYS)))] = draw(given_texts)
            if draw(st.integers(0, 9)) == 0:
                entries.pop(draw(st.sampled_from(sorted(entries))))
        writer.add_metadata(record.name, entries)
    for attachment in reader.iter_attachments():
        writer.add_attachment(
            1, 1, attachment.name, "", _state(draw, attachment) if way == "state" else attachment.data
        )
    channels: dict[int, int] = {}
    change = draw(st.integers(2, 40)) if way == "messages" else 0
    for number, (schema, channel, message) in enumerate(reader.iter_messages(log_time_order=False)):
        data, stamp = message.data, message.log_time
        if channel.id not in channels:
            metadata = dict(channel.metadata)
            if way == "metadata" and draw(st.integers(0, 3)) == 0:
                metadata["offered_qos_profiles"] = draw(
                    st.one_of(given_texts, st.sampled_from(("[*a]", "- 3", "- {}")))
                )
            number_of_schema = writer.register_schema(schema.name, schema.encoding, schema.data)
            channels[channel.id] = writer.register_channel(channel.topic, "cdr", number_of_schema, metadata)
        is_scenario = way == "scenario" and channel.topic.endswith("/scenario")
        if is_scenario:
            data = _text_message(json.dumps(draw(changed(_text_of(data))), default=str))
        elif way == "messages" and (number % change == change - 1 or channel.topic.endswith("commands")):
            what = draw(st.sampled_from(("data", "data", "stamp", "leave out", "double", "channel", "keep")))
            data = draw(changed_bytes(data)) if what == "data" else data
            stamp = draw(st.sampled_from((*STAMPS, stamp + STAMPS[-1], stamp - 10**9))) if what == "stamp" else stamp
            if what == "leave out":
                continue
            if what == "double":
                writer.add_message(channels[channel.id], stamp, data, stamp)
            if what == "channel":
                writer.add_message(draw(st.sampled_from(sorted(channels.values()))), stamp % 2**64, data, 0)
        writer.add_message(channels[channel.id], stamp % 2**64, data, stamp % 2**64)
    writer.finish()
    return output.getvalue() if whole else output.getvalue()[: draw(st.integers(0, output.tell()))]


def _text_of(data: bytes) -> Any:
    return json.loads(data[8:-1])


def _text_message(text: str) -> bytes:
    encoded = text.encode() + b"\x00"
    return b"\x00\x01\x00\x00" + struct.pack("<I", len(encoded)) + encoded


def _state(draw: Callable[..., Any], attachment: Attachment) -> bytes:
    """Attached state with some changed numbers or bytes."""
    if draw(st.booleans()):
        return bytes(draw(changed_bytes(attachment.data, (b"PK\x03\x04", b"\x00" * 64))))
    arrays = dict(np.load(BytesIO(attachment.data)))
    for _ in range(draw(st.integers(1, 3))):
        name = draw(st.sampled_from(sorted(key for key, array in arrays.items() if array.size and key != "header")))
        array = arrays[name] = arrays[name].copy()
        place = draw(st.integers(0, array.size - 1))
        with suppress(OverflowError, ValueError), np.errstate(all="ignore"):
            array.flat[place] = draw(st.sampled_from((*EXTREMES, *NOT_FINITE)))
    stream = BytesIO()
    np.savez(stream, **arrays)
    return stream.getvalue()


def prepare() -> None:
    """Load the modules that simulate, read and draw."""
    from cable_twin.offline import replay, review, simulate  # noqa: F401, PLC0415
    from cable_twin.scenario import load_scenario  # noqa: PLC0415
    from cable_twin.simulation import Simulation  # noqa: PLC0415

    for name in NAMES:
        Simulation(load_scenario(name)).advance_to(0.02)


def run(file: Path) -> str:
    """Review a bag, repair it and review the copy, replay it, and repeat its commands for a moment."""
    from cable_twin.offline import replay, review, simulate  # noqa: PLC0415

    with tempfile.TemporaryDirectory() as directory:
        bag = Path(directory) / "bag.mcap"
        bag.write_bytes(file.read_bytes())
        codes = [
            review.main([str(bag), "--rerun", "off"]),
            review.main([str(bag), "--repair"]),
            replay.main([str(bag)]),
            simulate.main(["--from-bag", str(bag), "--duration", "0.02", "--record", "off"]),
        ]
        if (copy := bag.with_name("bag_repaired")).exists():
            codes.append(review.main([str(copy), "--rerun", "off"]))
    return DONE if any(code < 2 for code in codes) else REFUSED
