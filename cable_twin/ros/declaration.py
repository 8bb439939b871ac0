"""The table of parameters as parameters of a node."""

from __future__ import annotations

from typing import Any

from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor
from rclpy.node import Node

from cable_twin.ros.parameters import PARAMETERS, Parameter, splitting_of

ROS_PARAMETERS = ("use_sim_time", "start_type_description_service", "qos_overrides.")  # every node has them


class ParameterError(ValueError):
    """Parameters that the node cannot start with, a line each."""


def declare_parameters(node: Node) -> dict[str, Any]:
    """Declare every parameter of the table and return what was given, by name.

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
        # dynamic, so that 100 may stand for 100.0
        undescribed = ParameterDescriptor(dynamic_typing=True)
        value: Any = node.declare_parameter(parameter.name, parameter.default, undescribed).value
        if isinstance(parameter.default, float) and isinstance(value, int) and not isinstance(value, bool):
            value = float(value)
        if type(value) is not type(parameter.default):
            kind = type(parameter.default).__name__
            faults.append(f"parameter '{parameter.name}' is {value!r}; a {kind} is needed: {parameter.help}")
        elif fault := parameter.fault(value):
            faults.append(fault)
        else:
            node.set_descriptor(parameter.name, _descriptor(parameter))  # after our own, clearer check
        values[parameter.name] = value
    if values["snapshot"] and "scenario" in node._parameter_overrides:
        faults.append("parameters 'scenario' and 'snapshot' are given; one is allowed: a snapshot has its scenario")
    if not faults:
        faults = splitting_of(values).faults("parameter '{}'".format)
    if faults:
        raise ParameterError("\n".join(faults))
    return values


def _descriptor(parameter: Parameter) -> ParameterDescriptor:
    """What other nodes are told about a parameter."""
    descriptor = ParameterDescriptor(
        description=parameter.help,
        additional_constraints=f"one of: {', '.join(parameter.choices)}" if parameter.choices else "",
        read_only=parameter.name != "command_timeout",
        dynamic_typing=True,
    )
    if parameter.low is not None and parameter.high is not None:
        descriptor.floating_point_range = [FloatingPointRange(from_value=parameter.low, to_value=parameter.high)]
    return descriptor
