"""Records of an MCAP file that may be damaged or malicious, loaded and unpacked within limits.

The package mcap parses single records. Its readers are not used: they unpack any chunk to any size, trust lengths
within a record, and end at the first damage.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Iterator, Mapping
from contextlib import suppress
from io import BytesIO
from typing import IO, Any, NamedTuple

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, ChunkIndex, Footer, Schema
from mcap.writer import MCAP0_MAGIC

RECORD_LIMIT = 2**27  # bytes of a record; the longest that is written is a full state, of some megabytes
CHUNK_LIMIT = 2**26  # bytes that a chunk may unpack to; one that is written has 1 MB and a message
RATIO_LIMIT = 200  # times its size that a file may unpack to, beside a chunk; logs have 4 to 10
HEAD = struct.Struct("<BQ")  # of a record: opcode, and length of what follows
CHUNK_HEAD = struct.Struct("<QQQII")  # of a chunk: first and last stamp, size unpacked, its CRC, length of a name
MESSAGE_HEAD = struct.Struct("<HIQQ")  # of a message: channel, sequence, stamps of log and publisher
CHUNK_SIGNATURE = b"\x04\x00\x00\x00zstd"  # in a chunk, behind the other numbers of its head
FOOTER_SIZE = HEAD.size + 20 + len(MCAP0_MAGIC)
SEARCHED = 1 << 20  # bytes at a time
TRIED = 8  # times the size of a file that is read in search of chunks
CHUNK, MESSAGE, CHANNEL, SCHEMA = map(int, (Opcode.CHUNK, Opcode.MESSAGE, Opcode.CHANNEL, Opcode.SCHEMA))
# what a piece of a file may raise that is not what it says
UNREADABLE = (McapError, zstandard.ZstdError, struct.error, ValueError, OverflowError, KeyError)


class Record(NamedTuple):
    """Record of an MCAP file with its offset."""

    offset: int  # bytes
    opcode: int
    content: bytes


class ChunkPlace(NamedTuple):
    """Place of a chunk in an MCAP file, from the index: offset, length, time span, channels."""

    offset: int
    length: int
    first_ns: int  # stamp of its earliest message
    last_ns: int  # of the latest
    channels: frozenset[int]  # with messages in the chunk; empty if not in the index


class Index(NamedTuple):
    """Index at the end of a closed MCAP file: channels, schemas, chunks, offsets of other records."""

    channels: Mapping[int, Channel]
    schemas: Mapping[int, Schema]
    chunks: tuple[ChunkPlace, ...]  # in order, without overlap
    others: tuple[int, ...]  # offsets of metadata and attachments


def parsed(kind: type, content: bytes) -> Any:
    """Parse the content of an MCAP record into a class of the package mcap; raises one of the errors in UNREADABLE."""
    return kind.read(ReadDataStream(BytesIO(content)))  # type: ignore[attr-defined]


def record_at(stream: IO[bytes], offset: int) -> Record:
    """Read one record of an MCAP file at an offset.

    Raises:
        McapError: No record is there, or it is longer than the rest of the file or than the limit.
    """
    size = stream.seek(0, os.SEEK_END)
    stream.seek(offset)
    head = stream.read(HEAD.size)
    if len(head) < HEAD.size:
        raise McapError(f"ends within a record at byte {offset}")
    opcode, length = HEAD.unpack(head)
    if not (Opcode.HEADER <= opcode <= Opcode.DATA_END or opcode >= 0x80):
        raise McapError(f"no record at byte {offset}")
    if length > size - offset - HEAD.size:
        raise McapError(f"ends within a record at byte {offset}")
    if length > RECORD_LIMIT:
        raise McapError(f"record at byte {offset}: given {length} bytes; allowed: up to {RECORD_LIMIT}")
    return Record(offset, opcode, stream.read(length))


def walk(stream: IO[bytes]) -> Iterator[Record | McapError]:
    """Iterate over all records of an MCAP file up to the end of its data, past damaged places.

    A damaged place yields its fault; iteration goes on with the next chunk behind it, if any.
    """
    offset = len(MCAP0_MAGIC)
    left = TRIED * stream.seek(0, os.SEEK_END)  # bytes, of which what looks like a chunk may take to be none
    while True:
        try:
            record = record_at(stream, offset)
            if record.opcode == CHUNK and not _is_consistent(record.content):
                raise McapError(f"a chunk of another length than its header gives, at byte {offset}")
        except McapError as error:
            found = None
            for start in _signatures(stream, offset + 1):
                with suppress(*UNREADABLE):
                    content = record_at(stream, start).content
                    left -= len(content)
                    if _is_consistent(content) and unpacked(content):
                        found = start
                if found is not None or left < 0:
                    break
            if found is None:
                return  # cut short, as by a kill
            yield error
            offset = found
            continue
        if record.opcode in (Opcode.DATA_END, Opcode.FOOTER):
            return
        yield record
        offset += HEAD.size + len(record.content)


def _signatures(stream: IO[bytes], offset: int) -> Iterator[int]:
    """Offsets in a damaged MCAP file, from a byte on, at which chunks probably start: a signature is in their head."""
    within, before = HEAD.size + CHUNK_HEAD.size - 4, b""
    stream.seek(offset)
    while data := stream.read(SEARCHED):
        block, first, place = before + data, stream.tell() - len(data) - len(before), stream.tell()
        found = block.find(CHUNK_SIGNATURE)
        while found >= 0:
            if (start := first + found - within) >= offset:
                stream.seek(start)
                if stream.read(1)[0] == CHUNK:
                    yield start
            found = block.find(CHUNK_SIGNATURE, found + 1)
        stream.seek(place)
        before = block[1 - len(CHUNK_SIGNATURE) :]


def _is_consistent(content: bytes) -> bool:
    """Whether the length of an MCAP chunk agrees with its header, so that the next record follows directly."""
    try:
        start = CHUNK_HEAD.size + CHUNK_HEAD.unpack_from(content)[-1]
        return bool(struct.unpack_from("<Q", content, start)[0] == len(content) - start - 8)
    except struct.error:
        return False


def unpacked_size(content: bytes) -> int:
    """Unpacked size (bytes) of an MCAP chunk according to its header."""
    return int(CHUNK_HEAD.unpack_from(content)[2])


def has_messages(content: bytes) -> bool:
    """Whether an MCAP chunk has messages: the stamp of its last one, which its header has, is not 0."""
    return bool(CHUNK_HEAD.unpack_from(content)[1])


def unpacked(content: bytes) -> bytes:
    """Unpack the data of an MCAP chunk from the content of its record.

    Raises:
        McapError: The chunk is damaged, of another compression, or would unpack to more than the limit.
    """
    _, _, size, checksum, name = CHUNK_HEAD.unpack_from(content)
    start = CHUNK_HEAD.size + name + 8
    compression = content[CHUNK_HEAD.size : start - 8].decode()
    if not _is_consistent(content):
        raise McapError("a chunk of another length than its header gives")
    if size > CHUNK_LIMIT:
        raise McapError(f"a chunk that unpacks to too much: given {size} bytes; allowed: up to {CHUNK_LIMIT}")
    data = content[start:]
    if compression == "zstd":
        # the frame says so too, and zstandard believes it rather than a limit
        if zstandard.frame_content_size(data) not in (size, -1):
            raise McapError(f"a chunk that unpacks to another size than the {size} bytes in its header")
        data = zstandard.decompress(data, size)
    elif compression:
        raise McapError(f"compression of a chunk: given {compression!r}; allowed: 'zstd', or none")
    if len(data) != size or (checksum and zlib.crc32(data) != checksum):
        raise McapError("a chunk with a wrong checksum")
    return data


def chunk_messages(data: bytes, names: dict[int, str]) -> Iterator[tuple[int, int, bytes]]:
    """Channel, stamp (ns since 1970) and data of each message in an unpacked MCAP chunk.

    Args:
        data: Of the chunk.
        names: Topics by channel, to which channels declared in the chunk are added.

    Raises:
        One of UNREADABLE: A record in the chunk is longer than the chunk, or of a kind that no chunk has.
    """
    position, end = 0, len(data)
    while position < end:
        opcode, length = HEAD.unpack_from(data, position)
        position += HEAD.size
        if length > end - position:
            raise McapError("a record that is longer than its chunk")
        if opcode == MESSAGE:
            channel, _, stamp, _ = MESSAGE_HEAD.unpack_from(data, position)
            yield channel, stamp, data[position + MESSAGE_HEAD.size : position + length]
        elif opcode == CHANNEL:
            declared = parsed(Channel, data[position : position + length])
            names[declared.id] = declared.topic
        elif opcode != SCHEMA:
            raise McapError(f"kind of a record in a chunk: given {opcode}; allowed: schema, channel or message")
        position += length


def declared(data: bytes) -> Iterator[Channel | Schema]:
    """Channels and schemas declared in an unpacked MCAP chunk; raises one of the errors in UNREADABLE."""
    position = 0
    while position < len(data):
        opcode, length = HEAD.unpack_from(data, position)
        position += HEAD.size
        if opcode in (CHANNEL, SCHEMA):
            yield parsed(Channel if opcode == CHANNEL else Schema, data[position : position + length])
        position += length


def read_index(stream: IO[bytes]) -> Index | None:
    """Read the index at the end of an MCAP file; None where missing or damaged."""
    try:
        size = stream.seek(0, os.SEEK_END)
        footer = record_at(stream, size - FOOTER_SIZE)
        start = parsed(Footer, footer.content)
        if footer.opcode != Opcode.FOOTER or not 0 < start.summary_start < footer.offset or not _ends_well(stream):
            return None
        if start.summary_crc and start.summary_crc != _checksum(stream, start.summary_start, size):
            return None
        return _index(stream, start.summary_start, footer.offset)
    except (*UNREADABLE, OSError):
        return None


def _ends_well(stream: IO[bytes]) -> bool:
    stream.seek(-len(MCAP0_MAGIC), os.SEEK_END)
    return stream.read() == MCAP0_MAGIC


def _checksum(stream: IO[bytes], start: int, size: int) -> int:
    """CRC of the index of an MCAP file, up to the checksum in its footer."""
    left, checksum = size - len(MCAP0_MAGIC) - 4 - start, 0
    stream.seek(start)
    while left > 0 and (data := stream.read(min(left, SEARCHED))):
        left, checksum = left - len(data), zlib.crc32(data, checksum)
    return checksum


def _index(stream: IO[bytes], start: int, end: int) -> Index:
    channels: dict[int, Channel] = {}
    schemas: dict[int, Schema] = {}
    chunks: list[ChunkPlace] = []
    others: list[int] = []
    sets: dict[frozenset[int], frozenset[int]] = {}  # one of each: an hour has thousands of chunks and few of these
    while start < end:
        record = record_at(stream, start)
        start += HEAD.size + len(record.content)
        if record.opcode == CHANNEL:
            channel = parsed(Channel, record.content)
            channels[channel.id] = channel
        elif record.opcode == Opcode.SCHEMA:
            schema = parsed(Schema, record.content)
            schemas[schema.id] = schema
        elif record.opcode in (Opcode.METADATA_INDEX, Opcode.ATTACHMENT_INDEX):
            others.append(int.from_bytes(record.content[:8], "little"))
        elif record.opcode == Opcode.CHUNK_INDEX:
            one = parsed(ChunkIndex, record.content)
            own = frozenset(one.message_index_offsets)
            own = sets.setdefault(own, own)
            times = one.message_start_time, one.message_end_time
            chunks.append(ChunkPlace(one.chunk_start_offset, one.chunk_length, *times, own))
    apart: list[ChunkPlace] = []
    for chunk in sorted(chunks):
        if not apart or chunk.offset >= apart[-1].offset + apart[-1].length:  # what is in the file once is read once
            apart.append(chunk)
    return Index(channels, schemas, tuple(apart), tuple(others))
