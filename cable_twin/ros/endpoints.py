"""Publishers and subscriptions of rclpy for the table of topics, with remapped names and overridden QoS."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial
from importlib import import_module
from typing import Any

from rclpy.exceptions import InvalidTopicNameException, ParameterException
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSPolicyKind, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.validate_full_topic_name import validate_full_topic_name

from cable_twin.basics.printable import printable
from cable_twin.frame.commands import INPUTS
from cable_twin.messages import Topic, TopicNames
from cable_twin.ros.parameters import QOS_OVERRIDES, ParameterError
from cable_twin.ros.startup import is_installed

OVERRIDABLE = (QoSPolicyKind.RELIABILITY, QoSPolicyKind.DURABILITY, QoSPolicyKind.DEPTH)


class Endpoints:
    """All publishers of a node, and its command subscriptions after `subscribe`.

    Attributes:
        senders: functions that publish the bytes of a message, by topic.

    Raises:
        ParameterError: an overridden QoS is invalid; the message is one line.
    """

    def __init__(self, node: Node, table: Sequence[Topic]) -> None:
        """Create the publishers; subscriptions to the command topics are only created by `subscribe`."""
        self._node = node
        self._topics = {topic.name: topic for topic in table}
        self._remapped: dict[str, str] = {}
        self.senders: dict[str, Callable[[bytes], None]] = {}
        self._publishers: dict[str, Any] = {}
        for topic in table:
            if not is_installed(topic.type):  # as with the wheels; logged all the same
                self.senders[topic.name] = lambda data: None
            elif topic.name not in INPUTS:
                self._publishers[topic.name] = self._create(topic, node.create_publisher)
                self.senders[topic.name] = self._publishers[topic.name].publish

    def subscribe(self, take: Callable[[str, bytes], None]) -> None:
        """Subscribe to all command topics; `take` receives the name of the topic and the bytes of each message."""
        for name in INPUTS:
            self._create(self._topics[name], self._node.create_subscription, partial(take, name), raw=True)

    @property
    def topics(self) -> tuple[Topic, ...]:
        """Table of topics with the QoS in use."""
        return tuple(self._topics.values())

    @property
    def names(self) -> TopicNames:
        """Full names of the published topics."""
        return TopicNames(self._node.get_fully_qualified_name(), self._remapped)

    def check_names(self, topics: Iterable[str]) -> None:
        """Raise ParameterError if a topic of a scenario to be loaded has an invalid full name, as one too long."""
        try:
            for topic in topics:
                validate_full_topic_name(self.names.full(topic))
        except InvalidTopicNameException as error:
            raise ParameterError(printable(error, 400)) from None

    def listeners(self, topic: str) -> int:
        """Number of subscriptions to a topic."""
        return self._publishers[topic].get_subscription_count() if topic in self._publishers else 0

    def warn_of_unknown(self) -> None:
        """Warn of QoS overrides for unknown topics or policies."""
        for name in self._node._parameter_overrides:
            if name.startswith(QOS_OVERRIDES) and not self._node.has_parameter(name):
                self._node.get_logger().warning(
                    f"parameter '{name}' is ignored: no such topic or policy; "
                    f"known: {QOS_OVERRIDES}TOPIC.publisher or .subscription, and .reliability, .durability or .depth"
                )

    def _create(self, topic: Topic, create: Callable[..., Any], *arguments: Any, **options: Any) -> Any:
        """Create a publisher or a subscription, and record its full name and QoS."""
        quality = QoSProfile(
            depth=topic.depth,
            reliability=ReliabilityPolicy[topic.reliability.upper()],
            durability=DurabilityPolicy[topic.durability.upper()],
        )
        name = topic.name if topic.name.startswith("/") else f"~/{topic.name}"
        overriding = QoSOverridingOptions(OVERRIDABLE)
        try:
            made = create(
                message_class(topic.type),
                name,
                *arguments,
                qos_profile=quality,
                qos_overriding_options=overriding,
                **options,
            )
        except (ParameterException, RuntimeError) as error:  # RuntimeError: also of rcl
            reason = " ".join(str(error).split()).partition(", at /")[0]
            raise ParameterError(f"{QOS_OVERRIDES}{self._node.resolve_topic_name(name)}: {reason}") from None
        if made.topic_name != self.names.full(topic.name):
            self._remapped[topic.name] = made.topic_name
        self._topics[topic.name] = replace(
            topic,
            reliability=quality.reliability.name.lower(),
            durability=quality.durability.name.lower(),
            depth=quality.depth,
        )
        return made


def message_class(kind: str) -> Any:
    """Class of messages of a type such as sensor_msgs/msg/JointState."""
    package, _, name = kind.split("/")
    return getattr(import_module(f"{package}.msg"), name)
