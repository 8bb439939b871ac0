"""Repair of a cut or damaged bag: a copy of all readable messages, with an index for other tools in each file."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from mcap.records import Channel

from cable_twin.basics.limited_yaml import read_yaml
from cable_twin.messages import TYPESTORE, Topic, TopicNames
from cable_twin.recording.log_file import UNREADABLE, LogError, LogFile, one_line
from cable_twin.recording.log_reader import Log
from cable_twin.recording.log_writer import LOST_FROM, McapLog

QOS_LIMIT = 10_000  # characters of the QoS of a topic
DEEPEST = 1_000_000  # messages of a history
QOS = {"reliability": ("reliable", "best_effort"), "durability": ("volatile", "transient_local")}


def repair(log: Log, on_position: Callable[[int], None] | None = None) -> tuple[Path, int]:
    """Copy all readable messages of a damaged bag to a new bag beside it; the old bag stays unchanged.

    Where commands are lost, metadata of the copy have the time from which on: a replay needs every command.

    Args:
        log: Damaged or cut log; read to its end, so that all losses are known.
        on_position: Called with the bytes of the file read so far, to show progress.

    Returns:
        Directory of the new bag, a rosbag2 directory named BAG_repaired with as many files, and the number of messages
        in it.

    Raises:
        OSError: The new bag exists, or the disk refuses.
        LogError: The channels of the old bag are damaged.
    """
    directory = log.source.with_name(f"{log.source.name}_repaired")
    first = log.files[0]
    names = first.names
    metadata = {key: value for key, value in log.metadata.items() if key != LOST_FROM}
    new = McapLog(directory, _topics(log, names), metadata, names=names, number=first.number)
    count = 0
    try:
        new.begin(log.epoch_ns, log.snapshot, lost_from_ns=first.lost_from_ns)
        before = first
        for file, moved in log.files_in_turn(on_position):
            if file is not first:
                lost = not file.follows(before)
                new.split(file.snapshot(), file.number, after_loss=lost, lost_from_ns=file.lost_from_ns)
            before = file
            for topic, stamp_ns, data in file.messages(on_position=moved):
                new.write(topic, stamp_ns, data)
                count += 1
    finally:
        new.close()
    return directory, count


def _topics(log: Log, names: TopicNames) -> list[Topic]:
    """Topics of a bag with their QoS, from the first file with readable channels; all files have equal topics."""
    faults = []
    for file in log.files:
        try:
            if topics := _topics_of(file, names):
                return topics
        except LogError as error:  # noqa: PERF203 - every file has them
            faults.append(error)
    raise faults[0] if faults else LogError(f"{log.path}: it contains no topics")


def _topics_of(file: LogFile, names: TopicNames) -> list[Topic]:
    """Topics of a bag file with their QoS."""
    try:
        channels, schemas = file.declared()
        return [_topic(channel, schemas[channel.schema_id].name, names) for channel in channels.values()]
    except UNREADABLE as error:
        raise LogError(f"{file.path}: channels are damaged: {one_line(error)}") from error


def _topic(channel: Channel, message_type: str, names: TopicNames) -> Topic:
    """Topic of an MCAP channel with its recorded QoS, or the default QoS where that is unreadable."""
    if message_type not in TYPESTORE.fielddefs:
        raise ValueError(f"topic {channel.topic!r} is of an unknown type, {message_type!r}")
    qos = _qos(channel.metadata.get("offered_qos_profiles", ""))
    sound = {key: qos[key] for key, allowed in QOS.items() if qos.get(key) in allowed}
    depth = qos.get("depth")
    if isinstance(depth, int) and 0 <= depth <= DEEPEST:
        sound["depth"] = depth
    return Topic(names.own(channel.topic), message_type, **sound)


def _qos(text: str) -> dict[str, Any]:
    """QoS profile of a topic from its text in a bag, as a mapping; empty where unreadable."""
    try:
        (qos,) = read_yaml(text[:QOS_LIMIT]).content
    except UNREADABLE:
        return {}
    return qos if isinstance(qos, dict) and all(isinstance(qos.get(key), str | None) for key in QOS) else {}
