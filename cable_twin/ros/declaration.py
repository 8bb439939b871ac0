"""Declaration of the parameter table as parameters of a node."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.util import find_spec
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter

from cable_twin.frame.rates import ONCE, fault
from cable_twin.messages.topics import TFMessage
from cable_twin.ros.node_parameters import CHANGING, PARAMETERS, Parameter, splitting_of
from cable_twin.scenario import Scenario, assignment

RATES = {  # parameter: group of topics that it is of, and who takes them: publishers or logs
    "rope_rate": ("rope", 0),
    "path_rate": ("path", 0),
    "marker_rate": ("markers", 0),
    "log_joint_rate": ("joints", 1),
    "log_pose_rate": ("poses", 1),
    "log_force_rate": ("forces", 1),
    "log_rope_rate": ("rope", 1),
    "log_path_rate": ("path", 1),
    "log_transform_rate": ("transforms", 1),
    "log_marker_rate": ("markers", 1),
}
QOS_OVERRIDES = "qos_overrides."
ROS_PARAMETERS = ("use_sim_time", "start_type_description_service", QOS_OVERRIDES)  # every node has them


class ParameterError(ValueError):
    """Invalid parameters of the node, a line each."""


def declare_parameters(node: Node) -> dict[str, Any]:
    """Declare every parameter of the table and return given values by name.

    Raises:
        ParameterError: a value is of another kind, or out of its range.
    """
    faults = []
    values: dict[str, Any] = {}
    names = [parameter.name for parameter in PARAMETERS]
    for name in node._parameter_overrides:
        if name not in names and not name.startswith(ROS_PARAMETERS):
            node.get_logger().warning(f"unknown parameter '{name}' is ignored; known: {', '.join(names)}")
    for parameter in PARAMETERS:
        # of any type at first, so that 100 may stand for 100.0, and our own, clearer checks come first
        undescribed = ParameterDescriptor(dynamic_typing=True)
        value: Any = parameter.meant(node.declare_parameter(parameter.name, parameter.default, undescribed).value)
        if type(value) is not type(parameter.default):
            kind = type(parameter.default).__name__
            faults.append(f"parameter '{parameter.name}' is {value!r}; a {kind} is needed: {parameter.help}")
        elif fault := parameter.fault(value):
            faults.append(fault)
        else:
            node.undeclare_parameter(parameter.name)
            node.declare_parameter(parameter.name, value, _descriptor(parameter), ignore_override=True)
        values[parameter.name] = value
    if not faults:
        faults = splitting_of(values).faults("parameter '{}'".format)
    if faults:
        raise ParameterError("\n".join(faults))
    return values


def changes_of(values: Mapping[str, Any]) -> dict[str, Any]:
    """Changed scenario values by dotted key, from the parameter `set`.

    Raises:
        ParameterError: a line of it is no KEY=VALUE, or the scenario is that of a snapshot.
    """
    try:
        changes = dict(assignment(line) for line in values["set"].splitlines() if line.strip())
    except ValueError as error:
        raise ParameterError(f"parameter 'set': {error}") from None
    if changes and values["snapshot"]:
        names = ", ".join(changes)
        raise ParameterError(f"parameter 'set' changes {names}; allowed beside 'snapshot': nothing, it has its own")
    return changes


def is_installed(message_type: str) -> bool:
    """Whether the package of a message type such as "tf2_msgs/msg/TFMessage", or a named package, is installed."""
    found = find_spec(message_type.partition("/")[0])
    return found is not None and found.origin is not None  # None: the directory of its sources


def as_meant(parameters: list[RosParameter]) -> list[RosParameter]:
    """Convert parameters set at run time: integers become doubles where the table has doubles."""
    doubles = {parameter.name for parameter in PARAMETERS if isinstance(parameter.default, float)}
    return [
        RosParameter(one.name, value=float(one.value))
        if one.type_ == RosParameter.Type.INTEGER and one.name in doubles
        else one
        for one in parameters
    ]


def topic_rates(node: Node, values: Mapping[str, Any], frame_rate: float) -> tuple[dict[str, float], dict[str, float]]:
    """Rates (Hz) by group of topics, of publishers and of logs.

    Raises:
        ParameterError: one that was given does not divide the frame rate (Hz); a default is lowered to one that does.
    """
    given = [(f"parameter '{name}'", values[name]) for name in RATES if name in node._parameter_overrides]
    faults = [line for name, rate in given if (line := fault(name, rate, frame_rate)) is not None]
    if faults:
        raise ParameterError("\n".join(faults))
    rates: tuple[dict[str, float], dict[str, float]] = ({}, {})
    for name, (group, taker) in RATES.items():
        rates[taker][group] = values[name]
    if not is_installed(TFMessage.__msgtype__):
        rates[0]["transforms"] = ONCE
    return rates


def count_frame_steps(node: Node, frame_rate: float, step: float) -> int:
    """Number of solver steps (s) in a frame at a rate (Hz), with a warning where the rate is not exact."""
    period = 1.0 / frame_rate
    steps = max(round(period / step), 1)
    if abs(steps * step - period) > 1e-9:
        node.get_logger().warning(
            f"frame_rate {frame_rate:g} Hz is no whole number of solver steps of {step:g} s: "
            f"{1.0 / (steps * step):g} Hz is used"
        )
    return steps


def own_topics(values: Mapping[str, Any], scenario: Scenario) -> tuple[str, ...]:
    """Carriers with topics of their own.

    Raises:
        ParameterError: the scenario has none of that name.
    """
    names = [name.strip() for name in values["carrier_topics"].split(",") if name.strip()]
    carriers = [*scenario.vehicles][len(scenario.carriages) :]
    known = f"the carriers {carriers[0]} to {carriers[-1]}" if carriers else "no carriers"
    faults = [
        f"parameter 'carrier_topics' names '{name}'; scenario '{scenario.name}' has {known}"
        for name in dict.fromkeys(names)
        if name not in carriers
    ]
    if faults:
        raise ParameterError("\n".join(faults))
    return tuple(dict.fromkeys(names))


def _descriptor(parameter: Parameter) -> ParameterDescriptor:
    """Descriptor of a parameter: description, choices and range."""
    descriptor = ParameterDescriptor(
        description=parameter.help,
        additional_constraints=f"one of: {', '.join(parameter.choices)}" if parameter.choices else "",
        read_only=parameter.name not in CHANGING,
    )
    if isinstance(parameter.default, int) and parameter.low is not None and parameter.high is not None:
        descriptor.integer_range = [IntegerRange(from_value=int(parameter.low), to_value=int(parameter.high))]
    elif parameter.low is not None and parameter.high is not None:
        descriptor.floating_point_range = [FloatingPointRange(from_value=parameter.low, to_value=parameter.high)]
    return descriptor
