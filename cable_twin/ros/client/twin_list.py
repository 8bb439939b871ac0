"""List of the twins in this ROS domain, with their state."""

from __future__ import annotations

import json
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any
from xml.etree import ElementTree

from cable_twin.basics.printable import LONGEST_MESSAGE, printable
from cable_twin.basics.units import with_unit
from cable_twin.ros.command_line import Ending
from cable_twin.ros.middleware import discovery_time

SCENARIO, ROBOT, DIAGNOSTICS = "/scenario", "/robot_description", "/diagnostics"
UNLIMITED = 1e9  # m, m/s or N, for what has no limit: a URDF has to have a number


@dataclass(slots=True)
class _Twin:
    """Known state of one twin."""

    scenario: Mapping[str, Any] = field(default_factory=dict)
    values: Mapping[str, str] = field(default_factory=dict)  # of its diagnostics
    limits: Mapping[str, str] | None = None  # of what is commanded, as they are told; None: not heard yet

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
        """Section of the scenario, empty unless a mapping."""
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
    if "<!" in description:  # entities, which may grow without end
        return found
    try:
        joints = ElementTree.fromstring(description).iterfind("joint[@type='prismatic']")
        for joint in joints:
            given = {key: float(value) for key, value in joint.find("limit").attrib.items()}  # type: ignore[union-attr]
            speed, force = given["velocity"], given["effort"]
            told = [f"{speed:g} m/s"] if speed < UNLIMITED else []
            told += [with_unit(force, "N")] if 0.0 < force < UNLIMITED else []
            found[joint.get("name", "")] = f"up to {', '.join(told)}" if told else ""
    except (ElementTree.ParseError, AttributeError, KeyError, ValueError):
        return {}  # not of a twin
    return found


def list_twins(node: Any, wait: float, ending: Ending) -> list[str]:
    """Find twins; returns a line each: name, scenario, state, simulated time (s), driven vehicles and limits.

    Args:
        node: of rclpy.
        wait: s to wait for one, and for what it says.
        ending: whether to give up.
    """
    import rclpy  # noqa: PLC0415
    from diagnostic_msgs.msg import DiagnosticArray  # noqa: PLC0415
    from rclpy.qos import DurabilityPolicy, QoSProfile  # noqa: PLC0415
    from std_msgs.msg import String  # noqa: PLC0415

    twins: dict[str, _Twin] = {}

    def note_scenario(name: str, message: Any) -> None:
        twins[name].scenario = published_scenario(message.data)

    def note_limits(name: str, message: Any) -> None:
        twins[name].limits = limits_in(message.data)

    def note_status(message: Any) -> None:
        for status in message.status:
            twin = twins.get(f"/{status.name.rpartition(': ')[0]}")
            if twin is not None:
                twin.values = {**twin.values, **{pair.key: pair.value for pair in status.values}}

    node.create_subscription(DiagnosticArray, DIAGNOSTICS, note_status, 50)
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    started, enough = time.monotonic(), discovery_time(rclpy.get_rmw_implementation_identifier())
    while not ending.is_set():
        for name in twin_names(node):
            if name not in twins:
                twins[name] = _Twin()
                for topic, note in ((SCENARIO, note_scenario), (ROBOT, note_limits)):
                    node.create_subscription(
                        String, name + topic, lambda m, name=name, note=note: note(name, m), latched
                    )
        rclpy.spin_once(node, timeout_sec=0.05)
        elapsed = time.monotonic() - started
        complete = bool(twins) and all(
            twin.scenario and twin.values and (twin.limits is not None or not node.count_publishers(name + ROBOT))
            for name, twin in twins.items()
        )
        if elapsed > (enough if complete else max(wait, enough) if twins else wait):
            break
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
