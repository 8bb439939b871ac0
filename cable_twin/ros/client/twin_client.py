"""Client of running twins: their list, calls of services, and single commands with the answer of the twin."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any
from xml.etree import ElementTree

from cable_twin.basics.printable import LONGEST_MESSAGE, printable, printable_lines
from cable_twin.basics.units import with_unit
from cable_twin.frame.commands import TEMPERATURE, VECTOR, Kind
from cable_twin.ros.startup import Ending, discovery_time

SCENARIO, ROBOT, DIAGNOSTICS = "/scenario", "/robot_description", "/diagnostics"
UNLIMITED = 1e9  # m, m/s or N: stands for no limit, as a URDF has to have a number
ANSWER = 5.0  # s within which the twin has to apply a command, also on a busy machine
SERVICE_ANSWER = 10.0  # s within which a service has to answer: the node itself waits for a frame for 5 s
SLOW_FRAME = 0.1  # s that a frame may take where many are requested
URGENT = "/emergency_stop"  # service that does not wait for the whole discovery time


@dataclass(slots=True)
class _Twin:
    """Running twin in the list of `drive --list`, as known from its topics."""

    scenario: Mapping[str, Any] = field(default_factory=dict)
    values: Mapping[str, str] = field(default_factory=dict)  # figures from the diagnostics
    limits: Mapping[str, str] | None = None  # in words, by name of carriage or drive; None: not received yet

    def describe(self, name: str, count: int) -> str:
        """Description of the twin in one line: name, scenario, state, time, vehicles."""
        values = self.values
        states = [
            *(["emergency stop in force"] if values.get("emergency_stop") == "true" else []),
            *(["paused"] if values.get("paused") == "true" else []),
        ]
        state = ", ".join(states) or "running"
        when = f"{state} at {values.get('simulated_time_s')} s of simulated time" if values else "state unknown"
        several = f"; {count} nodes have this name" if count > 1 else ""
        line = f"{name}: {self.scenario.get('name', 'scenario unknown')}, {when}; {self._vehicles()}{several}"
        return printable(line, LONGEST_MESSAGE)

    def _vehicles(self) -> str:
        names = list(map(self._limited, self._named("carriages")))
        if carriers := self._named("carriers"):
            names.append(f"{carriers.get('name')}_1 to {carriers.get('name')}_{carriers.get('count')}")
        drives = ", ".join(map(self._limited, self._named("drives")))
        return (f"drive: {drives}; " if drives else "") + f"carriages: {', '.join(names) or 'none'}"

    def _limited(self, name: str) -> str:
        one = self._named("carriages").get(name)
        if isinstance(one, dict) and (one.get("clamped_to") or one.get("joint") == "fixed"):
            return f"{name} (takes no command)"
        limit = (self.limits or {}).get(name)
        return f"{name} ({limit})" if limit else name

    def _named(self, section: str) -> Mapping[str, Any]:
        """Section of a given name in the scenario that the twin publishes; empty if it is no mapping."""
        found = self.scenario.get(section)
        return found if isinstance(found, dict) else {}


def published_scenario(text: str) -> dict[str, Any]:
    """Scenario published by a node, empty if invalid."""
    try:
        scenario = json.loads(text)
    except (ValueError, RecursionError):
        return {}
    return scenario if isinstance(scenario, dict) else {}


def limits_in(description: str) -> dict[str, str]:
    """Command limits of each joint along a rope, by name, from the URDF of a twin; empty without any."""
    found: dict[str, str] = {}
    if "<!" in description:  # XML entities, which may expand without end
        return found
    try:
        joints = ElementTree.fromstring(description).iterfind("joint[@type='prismatic']")
        for joint in joints:
            given = {key: float(value) for key, value in joint.find("limit").attrib.items()}  # type: ignore[union-attr]
            speed, force = given["velocity"], given["effort"]
            limits = [f"{speed:g} m/s"] if speed < UNLIMITED else []
            limits += [with_unit(force, "N")] if 0.0 < force < UNLIMITED else []
            found[joint.get("name", "")] = f"up to {', '.join(limits)}" if limits else ""
    except (ElementTree.ParseError, AttributeError, KeyError, ValueError):
        return {}  # not the URDF of a twin
    return found


def list_twins(node: Any, wait: float, ending: Ending) -> list[str]:
    """Find twins; returns a line each: name, scenario, state, simulated time (s), driven vehicles and limits.

    Args:
        node: node of rclpy.
        wait: time (s) to wait for twins and for their state.
        ending: flag of the signals that end the command.
    """
    import rclpy  # noqa: PLC0415
    from diagnostic_msgs.msg import DiagnosticArray  # noqa: PLC0415
    from rclpy.qos import DurabilityPolicy, QoSProfile  # noqa: PLC0415
    from std_msgs.msg import String  # noqa: PLC0415

    twins: dict[str, _Twin] = {}

    def on_scenario(name: str, message: Any) -> None:
        twins[name].scenario = published_scenario(message.data)

    def on_limits(name: str, message: Any) -> None:
        twins[name].limits = limits_in(message.data)

    def on_status(message: Any) -> None:
        for status in message.status:
            twin = twins.get(f"/{status.name.rpartition(': ')[0]}")
            if twin is not None:
                twin.values = {**twin.values, **{pair.key: pair.value for pair in status.values}}

    node.create_subscription(DiagnosticArray, DIAGNOSTICS, on_status, 50)
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    started, enough = time.monotonic(), discovery_time(rclpy.get_rmw_implementation_identifier())

    def finished() -> bool:
        for name in twin_names(node):
            if name not in twins:
                twins[name] = _Twin()
                for topic, callback in ((SCENARIO, on_scenario), (ROBOT, on_limits)):
                    node.create_subscription(
                        String, name + topic, lambda m, name=name, callback=callback: callback(name, m), latched
                    )
        elapsed = time.monotonic() - started
        complete = bool(twins) and all(
            twin.scenario and twin.values and (twin.limits is not None or not node.count_publishers(name + ROBOT))
            for name, twin in twins.items()
        )
        return elapsed > (enough if complete else max(wait, enough) if twins else wait)

    spin_until(node, ending, finished, wait + enough)
    return [twin.describe(name, node.count_publishers(name + SCENARIO)) for name, twin in sorted(twins.items())]


def twin_names(node: Any) -> list[str]:
    """Full names of visible twins: nodes with the topic `scenario` and the service `emergency_stop`."""
    scenarios = {
        name.removesuffix(SCENARIO)
        for name, types in node.get_topic_names_and_types()
        if name.endswith(SCENARIO) and "std_msgs/msg/String" in types
    }
    stops = {
        name.rpartition("/")[0] for name, _ in node.get_service_names_and_types() if name.endswith("/emergency_stop")
    }
    return sorted(scenarios & stops)


class TwinError(RuntimeError):
    """Failed request to a twin, in one line: no twin, a refusal, or no answer."""


class TwinClient:
    """Client of one running twin: calls of its services, and single commands with its answer.

    Args:
        node: node of rclpy.
        twin: full name of the twin's node.
        wait: time (s) to wait for the twin.
        ending: flag of the signals that end the command.
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
        return self._answer(answer.success, answer.message)

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
        return self._answer(answer.success, answer.message)

    def load(self, scenario: str) -> str:
        """Restart a twin with another scenario; returns a confirmation.

        Raises:
            TwinError: there is no twin, it does not answer, or there is no such scenario.
        """
        self._set("scenario", scenario)
        return f"loads {scenario} and starts it from the beginning"

    def readmit(self, sensor: str) -> str:
        """Let a sensor that a twin leaves out count again; returns a confirmation.

        Raises:
            TwinError: there is no twin, it does not answer, or leaves out no such sensor.
        """
        self._set("readmit", sensor)
        return f"{sensor} counts again"

    def _set(self, name: str, value: int | str) -> None:
        from rcl_interfaces.srv import SetParameters  # noqa: PLC0415
        from rclpy.parameter import Parameter  # noqa: PLC0415

        setting = Parameter(name, value=value).to_parameter_msg()
        result = self._call(SetParameters, "set_parameters", SetParameters.Request(parameters=[setting])).results[0]
        self._answer(result.successful, result.reason)

    def _call(self, kind: Any, service: str, request: Any, patience: float = SERVICE_ANSWER) -> Any:
        name = f"{self._twin}/{service}"
        client = self._node.create_client(kind, name)
        try:
            self._find(client.service_is_ready, name)
            future = client.call_async(request)
            if not spin_until(self._node, self._ending, future.done, patience):
                raise TwinError(f"{name} has not answered for {patience:g} s")
            return future.result()
        finally:
            self._node.destroy_client(client)

    def _answer(self, success: bool, message: str) -> str:
        if not success:
            raise TwinError(f"{self._twin}: {message}")
        return printable_lines(message)  # as any node may have the name of a twin

    def give(self, kind: Kind, values: Mapping[str, float]) -> str:
        """Publish a command once and wait until the twin has applied it; returns the applied command, with units.

        Raises:
            TwinError: there is no twin, or it has not applied the command; with the reason of a refusal.
        """
        from diagnostic_msgs.msg import DiagnosticArray  # noqa: PLC0415
        from sensor_msgs.msg import JointState  # noqa: PLC0415

        from cable_twin.frame.records import AppliedCommand, Command  # noqa: PLC0415
        from cable_twin.messages import APPLIED_COMMANDS, REFUSED_COMMANDS  # noqa: PLC0415

        # half of the start of this command, which an emergency stop does without
        from cable_twin.messages.command_messages import applied_command_from_message  # noqa: PLC0415

        given = Command(kind.name, values)
        applied: list[AppliedCommand] = []
        refusals: list[str] = []

        def on_applied(data: bytes) -> None:
            found = applied_command_from_message(data)
            if (found.command, found.source) == (given, kind.topic):
                applied.append(found)

        def on_refused(message: Any) -> None:
            refusals.extend(printable_lines(status.message) for status in message.status if status.name == kind.topic)

        message = _message(kind, values)
        publisher = self._node.create_publisher(type(message), f"{self._twin}/{kind.topic}", 10)
        name = publisher.topic_name  # as remapped
        answers = self._node.create_subscription(
            JointState, f"{self._twin}/{APPLIED_COMMANDS}", on_applied, 50, raw=True
        )
        refused = self._node.create_subscription(DiagnosticArray, f"{self._twin}/{REFUSED_COMMANDS}", on_refused, 50)
        self._find(
            lambda: publisher.get_subscription_count() and self._heard(answers.topic_name, refused.topic_name), name
        )
        message.header.stamp = self._node.get_clock().now().to_msg()
        publisher.publish(message)
        if not spin_until(self._node, self._ending, lambda: applied or refusals, ANSWER):
            raise TwinError(
                f"command not applied within {ANSWER:g} s: the terminal of the twin shows the reason of each refusal"
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
        """Wait until a twin offers a topic or service; an emergency stop gives up early if only other twins run."""
        import rclpy  # noqa: PLC0415

        started, wait = time.monotonic(), self._wait
        enough = discovery_time(rclpy.get_rmw_implementation_identifier())

        def finished() -> bool:
            elapsed = time.monotonic() - started
            others = name.endswith(URGENT) and elapsed > enough and twin_names(self._node)
            return bool(found()) or elapsed > wait or bool(others)

        spin_until(self._node, self._ending, finished, wait + ANSWER)
        if not found():
            raise TwinError(nobody_listens(self._node, name, min(time.monotonic() - started, wait)))


def spin_until(node: Any, ending: Ending, condition: Callable[[], Any], seconds: float) -> bool:
    """Spin a node until a condition holds; returns False after a time (s), or raises KeyboardInterrupt at a signal."""
    import rclpy  # noqa: PLC0415

    deadline = time.monotonic() + seconds
    while not condition():
        if ending.is_set():
            raise KeyboardInterrupt
        if time.monotonic() > deadline:
            return False
        rclpy.spin_once(node, timeout_sec=0.05)
    return True


def nobody_listens(node: Any, name: str, wait: float) -> str:
    """Message that no twin listens on a topic or service, with the twins of the ROS domain."""
    message = f"no twin listens on {name} after {wait:.3g} s"
    if others := twin_names(node):
        return f"{message}; there is {', '.join(others)}: drive --node {others[0]} ..."
    return f"{message}: is `sim` running, with the same ROS_DOMAIN_ID?"


def _message(kind: Kind, values: Mapping[str, float]) -> Any:
    """ROS message of a command for the topic of its kind."""
    from geometry_msgs.msg import Vector3, Vector3Stamped  # noqa: PLC0415
    from sensor_msgs.msg import JointState, Temperature  # noqa: PLC0415

    if kind.message == VECTOR:
        return Vector3Stamped(vector=Vector3(**values))
    if kind.message == TEMPERATURE:
        return Temperature(**{kind.name: values["ropes"]})
    return JointState(name=[*values], **{kind.field: [*values.values()]})
