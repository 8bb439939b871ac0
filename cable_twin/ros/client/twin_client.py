"""Client of a running twin: calls of its services, and single commands with the answer of the twin."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any

from cable_twin.basics.printable import printable_lines
from cable_twin.frame.commands import INPUTS, VECTOR, Kind
from cable_twin.ros.client.twin_list import twin_names
from cable_twin.ros.command_line import Ending
from cable_twin.ros.middleware import discovery_time

ANSWER = 5.0  # s within which the twin has to apply a command, on a machine that is busy with other things
SERVICE_ANSWER = 10.0  # s within which a service has to answer: the node itself waits for a frame for 5 s
SLOW_FRAME = 0.1  # s that a frame may take where many are asked for
URGENT = "/emergency_stop"  # service that is called in a hurry


class TwinError(RuntimeError):
    """Failed request to a twin, in one line: no twin, a refusal, or no answer."""


class TwinClient:
    """Client of one running twin.

    Args:
        node: of rclpy.
        twin: full name of the twin's node.
        wait: s to wait for it.
        ending: whether to give up.
    """

    def __init__(self, node: Any, twin: str, wait: float, ending: Ending) -> None:
        self._node, self._twin, self._wait, self._ending = node, twin, wait, ending

    def call(self, service: str, switch: bool | None = None) -> str:
        """Call a service of type std_srvs/SetBool with `switch`, else std_srvs/Trigger; returns the answer.

        Raises:
            TwinError: there is no twin, it does not answer, or it refuses.
        """
        from std_srvs.srv import SetBool, Trigger  # noqa: PLC0415

        kind = Trigger if switch is None else SetBool
        answer = self._call(kind, service, kind.Request() if switch is None else kind.Request(data=switch))
        return self._told(answer.success, answer.message)

    def step(self, count: int) -> str:
        """Let a paused twin compute frames, in one call; returns the answer.

        Raises:
            TwinError: there is no twin, it does not answer, is not paused, or a step fails.
        """
        from std_srvs.srv import Trigger  # noqa: PLC0415

        self._set("step_count", count)
        try:
            answer = self._call(Trigger, "step", Trigger.Request(), SERVICE_ANSWER + SLOW_FRAME * count)
        finally:
            if count != 1:
                self._set("step_count", 1)
        return self._told(answer.success, answer.message)

    def load(self, scenario: str) -> str:
        """Restart a twin with another scenario; returns a confirmation.

        Raises:
            TwinError: there is no twin, it does not answer, or there is no such scenario.
        """
        self._set("scenario", scenario)
        return f"loads {scenario} and starts it from the beginning"

    def _set(self, name: str, value: int | str) -> None:
        from rcl_interfaces.srv import SetParameters  # noqa: PLC0415
        from rclpy.parameter import Parameter  # noqa: PLC0415

        setting = Parameter(name, value=value).to_parameter_msg()
        result = self._call(SetParameters, "set_parameters", SetParameters.Request(parameters=[setting])).results[0]
        self._told(result.successful, result.reason)

    def _call(self, kind: Any, service: str, request: Any, patience: float = SERVICE_ANSWER) -> Any:
        name = f"{self._twin}/{service}"
        client = self._node.create_client(kind, name)
        try:
            self._find(client.service_is_ready, name)
            future = client.call_async(request)
            self._until(future.done, patience, f"{name} has not answered for {patience:g} s")
            return future.result()
        finally:
            self._node.destroy_client(client)

    def _told(self, success: bool, message: str) -> str:
        if not success:
            raise TwinError(f"{self._twin}: {message}")
        return printable_lines(message)  # of whoever has taken the name of the twin

    def give(self, kind: Kind, values: Mapping[str, float]) -> str:
        """Publish a command once and wait until the twin has applied it; returns the applied command, with units.

        Raises:
            TwinError: there is no twin, or it has not applied the command: its reason, where it tells one.
        """
        from diagnostic_msgs.msg import DiagnosticArray  # noqa: PLC0415
        from sensor_msgs.msg import JointState  # noqa: PLC0415

        from cable_twin.frame.records import AppliedCommand, Command  # noqa: PLC0415
        from cable_twin.messages import APPLIED_COMMANDS, REFUSED_COMMANDS  # noqa: PLC0415

        # an emergency stop does not wait for these, which are half of the start
        from cable_twin.messages.command_messages import applied_command_from_message  # noqa: PLC0415

        given = Command(kind.name, values)
        applied: list[AppliedCommand] = []
        refusals: list[str] = []

        def note_applied(data: bytes) -> None:
            found = applied_command_from_message(data)
            if (found.command, found.source) == (given, kind.topic):
                applied.append(found)

        def note_refusal(message: Any) -> None:
            refusals.extend(printable_lines(status.message) for status in message.status if status.name == kind.topic)

        message = _message(kind, values)
        publisher = self._node.create_publisher(type(message), f"{self._twin}/{kind.topic}", 10)
        name = publisher.topic_name  # as remapped
        answers = self._node.create_subscription(
            JointState, f"{self._twin}/{APPLIED_COMMANDS}", note_applied, 50, raw=True
        )
        refused = self._node.create_subscription(DiagnosticArray, f"{self._twin}/{REFUSED_COMMANDS}", note_refusal, 50)
        self._find(
            lambda: publisher.get_subscription_count() and self._heard(answers.topic_name, refused.topic_name), name
        )
        message.header.stamp = self._node.get_clock().now().to_msg()
        publisher.publish(message)
        self._until(
            lambda: applied or refusals,
            ANSWER,
            f"the twin has not applied it within {ANSWER:g} s: its terminal shows the reason of each refusal",
        )
        if not applied:
            raise TwinError(refusals[0])
        what = ", ".join(f"{name} {value:g} {kind.unit}" for name, value in values.items())
        return f"{kind.name.replace('_', ' ')} {what}"

    def _heard(self, *topics: str) -> bool:
        """Whether the subscriptions to applied and refused commands are matched with the twin."""
        return all(
            any(
                f"{one.node_namespace.rstrip('/')}/{one.node_name}" == self._twin
                for one in self._node.get_publishers_info_by_topic(topic)
            )
            for topic in topics
        )

    def _find(self, found: Callable[[], Any], name: str) -> None:
        """Wait for the twin behind a topic or service; an emergency stop does not wait where only others run."""
        import rclpy  # noqa: PLC0415

        started, wait = time.monotonic(), self._wait
        enough = discovery_time(rclpy.get_rmw_implementation_identifier())

        def looked() -> bool:
            elapsed = time.monotonic() - started
            others = name.endswith(URGENT) and elapsed > enough and twin_names(self._node)
            return bool(found()) or elapsed > wait or bool(others)

        self._until(looked, wait + ANSWER, "")
        if not found():
            raise TwinError(nobody_listens(self._node, name, min(time.monotonic() - started, wait)))

    def _until(self, condition: Callable[[], Any], seconds: float, fault: str) -> None:
        """Wait for a condition; raises TwinError at the time-out, or KeyboardInterrupt at a signal."""
        import rclpy  # noqa: PLC0415

        deadline = time.monotonic() + seconds
        while not condition():
            if self._ending.is_set():
                raise KeyboardInterrupt
            if time.monotonic() > deadline:
                raise TwinError(fault)
            rclpy.spin_once(self._node, timeout_sec=0.05)


def nobody_listens(node: Any, name: str, wait: float) -> str:
    """Message that no twin listens on a topic or service, with the twins of the ROS domain."""
    told = f"no twin listens on {name} after {wait:.3g} s"
    if others := twin_names(node):
        return f"{told}; there is {', '.join(others)}: drive --node {others[0]} ..."
    return f"{told}: is `sim` running, with the same ROS_DOMAIN_ID?"


def _message(kind: Kind, values: Mapping[str, float]) -> Any:
    """Message of a command kind for its topic."""
    from geometry_msgs.msg import Vector3, Vector3Stamped  # noqa: PLC0415
    from sensor_msgs.msg import JointState  # noqa: PLC0415

    if INPUTS[kind.topic] == VECTOR:
        return Vector3Stamped(vector=Vector3(**values))
    return JointState(name=[*values], **{kind.field: [*values.values()]})
