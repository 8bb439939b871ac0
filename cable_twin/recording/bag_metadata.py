"""Metadata of a rosbag2 bag: files, topics with their QoS, message counts, and their YAML text."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from textwrap import indent
from typing import Any

from cable_twin.messages import TYPESTORE, Topic, TopicNames

INFINITE = {"sec": 9223372036, "nsec": 854775807}  # how rosbag2 writes a duration without end

PLAIN = re.compile(r"[A-Za-z_/][A-Za-z0-9_/.-]*")  # a text that YAML needs no quotes for
NO_TEXT = ("true", "false", "null", "yes", "no", "on", "off", "y", "n")  # in any spelling


@dataclass(frozen=True, slots=True)
class BagFile:
    """Summary of one file of a rosbag2 bag: name, time span, message counts."""

    name: str
    first_ns: int  # stamp (ns since 1970) of the earliest message
    last_ns: int  # of the latest
    counts: Sequence[int]  # messages of each topic, in the order of the topics

    @property
    def span(self) -> dict[str, Any]:
        """Start time, duration and message count of the bag file, in the form of rosbag2."""
        return _span([self])


@dataclass(frozen=True, slots=True)
class BagChannel:
    """Channel record of a topic in a bag file: name, type, definition, metadata."""

    topic: str  # relative or absolute name, as used for writing
    name: str
    type: str
    definition: bytes
    metadata: dict[str, str]


class BagTopics:
    """Topics of a bag with their channel records and metadata, made once for all files of a run to save time.

    Attributes:
        channels: In the order of the topics.
    """

    def __init__(self, topics: Sequence[Topic], names: TopicNames) -> None:
        """Prepare channel records and metadata text of all topics of a bag in rosbag2's form.

        Args:
            topics: Everything that may be written.
            names: Full names of topics.
        """
        self.channels = [_channel(topic, names) for topic in topics]
        self._texts = []
        for channel, topic in zip(self.channels, topics, strict=True):
            described = {
                "name": channel.name,
                "type": topic.type,
                "serialization_format": "cdr",
                "offered_qos_profiles": [qos_profile(topic)],
                "type_description_hash": channel.metadata["topic_type_hash"],
            }
            self._texts.append(as_yaml([{"topic_metadata": described}]))

    def information(self, files: Sequence[BagFile]) -> str:
        """YAML text of the metadata of a bag in rosbag2's format, from its files in order."""
        head = {"version": 9, "storage_identifier": "mcap", **_span(files)}
        counts = (sum(counts) for counts in zip(*(file.counts for file in files), strict=True))
        topics = [f"{text}  message_count: {count}\n" for text, count in zip(self._texts, counts, strict=False)]
        rest = {
            "compression_format": "",
            "compression_mode": "",
            "relative_file_paths": [file.name for file in files],
            "files": [{"path": file.name, **file.span} for file in files],
            "custom_data": None,
            "ros_distro": os.environ.get("ROS_DISTRO", "unknown"),
        }
        listed = "\n" + indent("".join(topics), "  ") if topics else " []\n"
        return f"{as_yaml(head)}topics_with_message_count:{listed}{as_yaml(rest)}"


def _channel(topic: Topic, names: TopicNames) -> BagChannel:
    definition, _ = TYPESTORE.generate_msgdef(topic.type, ros_version=2)
    metadata = {
        "offered_qos_profiles": as_yaml([qos_profile(topic)]).strip(),
        "topic_type_hash": TYPESTORE.hash_rihs01(topic.type),
    }
    return BagChannel(topic.name, names.full(topic.name), topic.type, definition.encode(), metadata)


def _span(files: Sequence[BagFile]) -> dict[str, Any]:
    filled = [file for file in files if any(file.counts)]
    first = min((file.first_ns for file in filled), default=0)
    last = max((file.last_ns for file in filled), default=0)
    return {
        "starting_time": {"nanoseconds_since_epoch": first},
        "duration": {"nanoseconds": last - first},
        "message_count": sum(sum(file.counts) for file in filled),
    }


def qos_profile(topic: Topic) -> dict[str, Any]:
    """Offered QoS of a topic in rosbag2's format."""
    return {
        "history": "keep_last",
        "depth": topic.depth,
        "reliability": topic.reliability,
        "durability": topic.durability,
        "deadline": dict(INFINITE),
        "lifespan": dict(INFINITE),
        "liveliness": "automatic",
        "liveliness_lease_duration": dict(INFINITE),
        "avoid_ros_namespace_conventions": False,
    }


def as_yaml(value: Any) -> str:
    """Write mappings, lists, texts and numbers as YAML in rosbag2's style: no folded lines, no anchors.

    A library takes a hundred times as long, which may delay a frame loop in the same interpreter.
    """
    return "\n".join(_lines(value)) + "\n"


def _lines(value: Any) -> Iterator[str]:
    pairs = value.items() if isinstance(value, dict) else ((None, item) for item in value)
    for key, item in pairs:
        head = "-" if key is None else f"{key}:"
        if not isinstance(item, dict | list) or not item:
            yield f"{head} {_scalar(item)}"
        elif key is None:
            first, *rest = _lines(item)
            yield f"- {first}"
            yield from (f"  {line}" for line in rest)
        else:
            yield head
            yield from (f"  {line}" for line in _lines(item))


def _scalar(value: Any) -> str:
    if isinstance(value, str) and PLAIN.fullmatch(value) and value.lower() not in NO_TEXT:
        return value
    return json.dumps(value)  # which is YAML, too
