"""Names of topics and coordinate frames: defaults of the tables, or remapped names of a run."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field

NAMESPACE = "/cable_twin"
FRAME_ID = "map"


@dataclass(frozen=True, slots=True)
class TopicNames:
    """Full names of topics, and their inverse.

    Attributes:
        namespace: full name of the node, in front of relative names.
        remapped: full names by the names of the table, of those that ROS was told to call otherwise.
    """

    namespace: str = NAMESPACE
    remapped: Mapping[str, str] = field(default_factory=dict)

    @classmethod
    def of(cls, metadata: Mapping[str, str]) -> TopicNames:
        """Topic names from log `metadata`, with defaults for missing entries."""
        return cls(metadata.get("namespace", NAMESPACE), json.loads(metadata.get("remapped", "{}")))

    @property
    def metadata(self) -> dict[str, str]:
        """Topic names as log metadata."""
        return {"namespace": self.namespace, "remapped": json.dumps(self.remapped)}

    def full(self, topic: str) -> str:
        """Full name of a topic given relative to the node ("joint_states") or absolute ("/tf")."""
        plain = topic if topic.startswith("/") else f"{self.namespace.rstrip('/')}/{topic}"
        return self.remapped.get(topic, plain)

    def own(self, name: str) -> str:
        """Name in the topic table of a topic with a given full name."""
        topics = {remapped: topic for topic, remapped in self.remapped.items()}
        return topics.get(name, name.removeprefix(f"{self.namespace.rstrip('/')}/"))


@dataclass(frozen=True, slots=True)
class FrameNames:
    """Names of coordinate frames.

    Attributes:
        frame_id: of the frame in which everything is, x along the track, y lateral, z up (REP-103).
        frame_prefix: in front of the names of vehicles, their bodies and supports, as robot_state_publisher has it.
    """

    frame_id: str = FRAME_ID
    frame_prefix: str = ""

    @classmethod
    def of(cls, metadata: Mapping[str, str]) -> FrameNames:
        """Frame names from log `metadata`, with defaults for missing entries."""
        return cls(metadata.get("frame_id", FRAME_ID), metadata.get("frame_prefix", ""))

    @property
    def metadata(self) -> dict[str, str]:
        """Frame names as log metadata."""
        return {"frame_id": self.frame_id, "frame_prefix": self.frame_prefix}

    def named(self, thing: str) -> str:
        """Name of the frame of a vehicle ("cabin"), a body ("cabin/hanger") or a support ("tower_1")."""
        return f"{self.frame_prefix}{thing}"


__all__ = ["FRAME_ID", "NAMESPACE", "FrameNames", "TopicNames"]
