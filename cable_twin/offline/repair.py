"""A bag that was cut short or damaged, copied to one with an index in each file, for tools that open no other."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from mcap.records import Channel, Message, Schema
from mcap.stream_reader import StreamReader

from cable_twin.limited_yaml import read_yaml
from cable_twin.messages import Topic, TopicNames
from cable_twin.recording.log_file import RECORD_LIMIT, UNREADABLE, one_line
from cable_twin.recording.log_reader import Log
from cable_twin.recording.log_versions import LogError
from cable_twin.recording.log_writer import McapLog


def repair(log: Log, on_position: Callable[[int], None] | None = None) -> tuple[Path, int]:
    """Copy all that can be read of a bag to a new one beside it; the old one stays as it is.

    Args:
        log: What was cut short.
        on_position: Called with the bytes of the file read so far, to show progress.

    Returns:
        Directory of the new bag, a rosbag2 directory named BAG_repaired with as many files, and the number of messages
        in it.

    Raises:
        OSError: The new bag exists, or the disk refuses.
        LogError: The channels of the old one are damaged.
    """
    directory = log.source.with_name(f"{log.source.name}_repaired")
    first = log.files[0]
    names = first.names
    new = McapLog(directory, _topics(log, names), log.metadata, names=names, number=first.number)
    count = 0
    try:
        new.begin(log.epoch_ns, log.snapshot)
        before = first
        for file, moved in log.files_in_turn(on_position):
            if file is not first:
                new.split(file.snapshot(), file.number, after_loss=not file.follows(before))
            before = file
            for topic, stamp_ns, data in file.messages(on_position=moved):
                new.write(topic, stamp_ns, data)
                count += 1
    finally:
        new.close()
    return directory, count


def _topics(log: Log, names: TopicNames) -> list[Topic]:
    """Topics of a bag with their QoS, from the first file whose channels can be read: all have the same."""
    faults = []
    for file in log.files:
        try:
            if topics := _topics_of(file.path, names):
                return topics
        except LogError as error:  # noqa: PERF203 - every file has them
            faults.append(error)
    raise faults[0] if faults else LogError(f"{log.path}: no channel in it")


def _topics_of(path: Path, names: TopicNames) -> list[Topic]:
    """Topics of a file; they stand before the first message."""
    schemas: dict[int, str] = {}
    topics = []
    try:
        with path.open("rb") as stream:
            for record in StreamReader(stream, record_size_limit=RECORD_LIMIT).records:
                if isinstance(record, Schema):
                    schemas[record.id] = record.name
                elif isinstance(record, Channel):
                    (qos,) = read_yaml(record.metadata["offered_qos_profiles"]).content
                    topics.append(
                        Topic(
                            names.own(record.topic),
                            schemas[record.schema_id],
                            qos["reliability"],
                            qos["durability"],
                            qos["depth"],
                        )
                    )
                elif isinstance(record, Message):
                    break
    except UNREADABLE as error:
        raise LogError(f"{path}: channels are damaged: {one_line(error)}") from error
    return topics
