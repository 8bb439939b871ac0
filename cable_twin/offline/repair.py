"""A bag that was cut short, copied to one with an index, for tools that open no other."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from mcap.records import Channel, Message, Schema
from mcap.stream_reader import StreamReader
from ruamel.yaml import YAML

from cable_twin.messages import NAMESPACE, Topic
from cable_twin.recording.log_reader import RECORD_LIMIT, UNREADABLE, Log, LogError, one_line
from cable_twin.recording.mcap_log import McapLog


def repair(log: Log, on_position: Callable[[int], None] | None = None) -> tuple[Path, int]:
    """Copy all that can be read of a bag to a new one beside it; the old one stays as it is.

    Args:
        log: What was cut short.
        on_position: Called with the bytes of the file read so far, to show progress.

    Returns:
        Directory of the new bag, a rosbag2 directory named BAG_repaired, and the number of messages in it.

    Raises:
        OSError: The new bag exists, or the disk refuses.
        LogError: The channels of the old one are damaged.
    """
    parent = log.path.resolve().parent
    source = parent if (parent / "metadata.yaml").exists() else log.path.resolve().with_suffix("")
    directory = source.with_name(f"{source.name}_repaired")
    namespace = log.metadata.get("namespace", NAMESPACE)
    new = McapLog(directory, _topics(log, namespace), log.metadata, namespace=namespace, snapshot=log.snapshot)
    count = 0
    try:
        for topic, stamp_ns, data in log.messages(on_position=on_position):
            new.write(topic, stamp_ns, data)
            count += 1
    finally:
        new.close()
    return directory, count


def _topics(log: Log, namespace: str) -> list[Topic]:
    """Topics of a bag with their QoS, from its channels; they stand before the first message."""
    schemas: dict[int, str] = {}
    topics = []
    yaml = YAML(typ="safe", pure=True)
    try:
        with log.path.open("rb") as stream:
            for record in StreamReader(stream, record_size_limit=RECORD_LIMIT).records:
                if isinstance(record, Schema):
                    schemas[record.id] = record.name
                elif isinstance(record, Channel):
                    (qos,) = yaml.load(record.metadata["offered_qos_profiles"])
                    topics.append(
                        Topic(
                            record.topic.removeprefix(f"{namespace.rstrip('/')}/"),
                            schemas[record.schema_id],
                            qos["reliability"],
                            qos["durability"],
                            qos["depth"],
                        )
                    )
                elif isinstance(record, Message):
                    break
    except UNREADABLE as error:
        raise LogError(f"{log.path}: channels are damaged: {one_line(error)}") from error
    return topics
