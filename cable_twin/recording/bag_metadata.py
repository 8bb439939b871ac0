"""What rosbag2 wants to know of a bag: files, topics with their QoS, counts; and the text it reads it from."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from cable_twin.messages import TYPESTORE, Topic, full_name

INFINITE = {"sec": 9223372036, "nsec": 854775807}  # how rosbag2 writes a duration without end

PLAIN = re.compile(r"[A-Za-z_/][A-Za-z0-9_/.-]*")  # a text that YAML needs no quotes for
NO_TEXT = ("true", "false", "null", "yes", "no", "on", "off", "y", "n")  # in any spelling


@dataclass(frozen=True, slots=True)
class BagFile:
    """What one file of a bag holds."""

    name: str
    first_ns: int  # stamp (ns since 1970) of the earliest message
    last_ns: int  # of the latest
    counts: Sequence[int]  # messages of each topic, in the order of the topics

    @property
    def span(self) -> dict[str, Any]:
        """When it starts, how long it lasts and how many messages it has."""
        return _span([self])


def bag_information(topics: Iterable[Topic], namespace: str, files: Sequence[BagFile]) -> dict[str, Any]:
    """Return the information of a bag as rosbag2 keeps it.

    Args:
        topics: Everything that may be written.
        namespace: Full name of the node, in front of relative topic names.
        files: In their order.
    """
    return {
        "version": 9,
        "storage_identifier": "mcap",
        **_span(files),
        "topics_with_message_count": [
            {
                "topic_metadata": {
                    "name": full_name(topic.name, namespace),
                    "type": topic.type,
                    "serialization_format": "cdr",
                    "offered_qos_profiles": [qos_profile(topic)],
                    "type_description_hash": TYPESTORE.hash_rihs01(topic.type),
                },
                "message_count": sum(file.counts[index] for file in files),
            }
            for index, topic in enumerate(topics)
        ],
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": [file.name for file in files],
        "files": [{"path": file.name, **file.span} for file in files],
        "custom_data": None,
        "ros_distro": os.environ.get("ROS_DISTRO", "unknown"),
    }


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
    """Return the QoS that a topic is offered with, as rosbag2 writes it."""
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
    """Return mappings, lists, texts and numbers as YAML: no folded lines, no anchors, as rosbag2 writes it.

    A library takes a hundred times as long, which is time that a frame loop in the same interpreter may wait for.
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
