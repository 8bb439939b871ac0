"""Publishers and subscriptions of rclpy for the table of topics."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from cable_twin.messages import Topic
from cable_twin.ros.declaration import is_installed


def message_class(message_type: str) -> Any:
    """Class of rclpy for a type such as "sensor_msgs/msg/JointState"."""
    package, _, name = message_type.split("/")
    return getattr(import_module(f"{package}.msg"), name)


def publisher_of(node: Node, topic: Topic) -> Callable[[bytes], None]:
    """What sends the bytes of a topic; nowhere where its message package is not installed, as with the wheels."""
    if not is_installed(topic.type):
        return lambda data: None
    quality = QoSProfile(
        depth=topic.depth,
        reliability=ReliabilityPolicy[topic.reliability.upper()],
        durability=DurabilityPolicy[topic.durability.upper()],
    )
    publish: Callable[[bytes], None] = node.create_publisher(
        message_class(topic.type), _name(topic.name), quality
    ).publish
    return publish


def subscribe(node: Node, topic: Topic, take: Callable[[bytes], None]) -> None:
    """Have the bytes of a topic taken."""
    node.create_subscription(message_class(topic.type), _name(topic.name), take, topic.depth, raw=True)


def _name(topic: str) -> str:
    return topic if topic.startswith("/") else f"~/{topic}"
