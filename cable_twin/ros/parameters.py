"""Parameters of the node: declared from the table at the start, and changed while the twin runs."""

from __future__ import annotations

import weakref
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future
from difflib import get_close_matches
from typing import TYPE_CHECKING, Any, cast

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult
from rcl_interfaces.msg import Parameter as ParameterMessage
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter
from rclpy.parameter_service import ParameterService

from cable_twin.basics.printable import printable
from cable_twin.frame.rates import ONCE, fault
from cable_twin.messages.topics import TFMessage
from cable_twin.ros.parameter_table import CHANGING, PARAMETERS, Parameter, splitting_of
from cable_twin.ros.services import done
from cable_twin.ros.startup import is_installed
from cable_twin.runtime.frame_loop import FrameLoop
from cable_twin.runtime.scenario_reading import ScenarioReader
from cable_twin.scenario import Scenario, ScenarioError, assignment

if TYPE_CHECKING:
    from cable_twin.ros.simulation_services import WorldLoading

RATES = {  # parameter: its group of topics, and 0 for published or 1 for logged ones
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
KINDS = {float: "a number", int: "a whole number", bool: "true or false", str: "a text"}  # of values, in words
ROS_PARAMETERS = ("use_sim_time", "start_type_description_service", QOS_OVERRIDES)  # every node has them


class ParameterError(ValueError):
    """Invalid parameters of the node; the text has a line for each."""


def declare_parameters(node: Node) -> dict[str, Any]:
    """Declare every parameter of the table and return given values by name.

    Raises:
        ParameterError: a value has another type, or is out of range.
    """
    faults = []
    values: dict[str, Any] = {}
    names = [parameter.name for parameter in PARAMETERS]
    for name in node._parameter_overrides:
        if name not in names and not name.startswith(ROS_PARAMETERS):
            node.get_logger().warning(f"unknown parameter '{name}' is ignored; known: {', '.join(names)}")
    for parameter in PARAMETERS:
        # with dynamic type at first, so that 100 is accepted for 100.0, and the clearer checks below come first
        undescribed = ParameterDescriptor(dynamic_typing=True)
        value: Any = parameter.converted(node.declare_parameter(parameter.name, parameter.default, undescribed).value)
        if type(value) is not type(parameter.default):
            kind = KINDS[type(parameter.default)]
            faults.append(f"parameter '{parameter.name}': given {value!r}; allowed: {kind}: {parameter.help}")
        elif fault := parameter.fault(value):
            faults.append(fault)
        else:
            node.undeclare_parameter(parameter.name)
            node.declare_parameter(parameter.name, value, _descriptor(parameter), ignore_override=True)
        values[parameter.name] = value
    if values["readmit"]:
        faults.append(
            f"parameter 'readmit': given '{values['readmit']}'; allowed: none at the start, as no sensor is out"
        )
    if not faults:
        faults = splitting_of(values).faults("parameter '{}'".format)
    if faults:
        raise ParameterError("\n".join(faults))
    return values


def changes_of(values: Mapping[str, Any]) -> dict[str, Any]:
    """Changed scenario values by dotted key, from the parameter `set`.

    Raises:
        ParameterError: a line is no KEY=VALUE, or the scenario is that of a snapshot, which has no changes.
    """
    try:
        changes = dict(assignment(line) for line in values["set"].splitlines() if line.strip())
    except ValueError as error:
        raise ParameterError(f"parameter 'set': {error}") from None
    if changes and values["snapshot"]:
        names = ", ".join(changes)
        raise ParameterError(f"parameter 'set': given changes of {names}; allowed: none together with 'snapshot'")
    return changes


def with_doubles(parameters: list[RosParameter]) -> list[RosParameter]:
    """Parameters set at run time, with integers converted to doubles where the table has doubles."""
    doubles = {parameter.name for parameter in PARAMETERS if isinstance(parameter.default, float)}
    return [
        RosParameter(one.name, value=float(one.value))
        if one.type_ == RosParameter.Type.INTEGER and one.name in doubles
        else one
        for one in parameters
    ]


def topic_rates(node: Node, values: Mapping[str, Any], frame_rate: float) -> tuple[dict[str, float], dict[str, float]]:
    """Rates (Hz) by group of topics, of publishers and of the log, at a frame rate (Hz).

    Raises:
        ParameterError: a given rate does not divide the frame rate; defaults are lowered to rates that do.
    """
    given = [(f"parameter '{name}'", values[name]) for name in RATES if name in node._parameter_overrides]
    faults = [line for name, rate in given if (line := fault(name, rate, frame_rate)) is not None]
    if faults:
        raise ParameterError("\n".join(faults))
    rates: tuple[dict[str, float], dict[str, float]] = ({}, {})
    for name, (group, logged) in RATES.items():
        rates[logged][group] = values[name]
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
    """Names of carriers with topics of their own.

    Raises:
        ParameterError: the scenario has no carrier of a name.
    """
    names = [name.strip() for name in values["carrier_topics"].split(",") if name.strip()]
    carriers = [*scenario.vehicles][len(scenario.carriages) :]
    known = f"the carriers {carriers[0]} to {carriers[-1]}" if carriers else "no carriers"
    faults = [
        f"parameter 'carrier_topics': given '{name}'; allowed: {known} of '{scenario.name}'"
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


class LiveParameterService(ParameterService):
    """Parameter services of the node, for the parameters changeable at run time; another `scenario` restarts the twin.

    A new scenario is read before the parameter is set, without blocking the executor.

    Args:
        node: node of the twin.
        loop: frame loop.
        loading: loads another scenario.
        reader: reads another scenario.
        readmit: lets a sensor of the plant count again, or returns why it cannot.
    """

    def __init__(
        self,
        node: Node,
        loop: FrameLoop,
        loading: WorldLoading,
        reader: ScenarioReader,
        readmit: Callable[[str], str],
    ) -> None:
        self._node, self._loop, self._loading, self._reader = node, loop, loading, reader
        self._readmit = readmit
        self._scenario = node.get_parameter("scenario").value
        self._read: tuple[str, Future[Scenario]] | None = None
        super().__init__(cast("Node", _Grouped(node)))
        self._node_weak_ref = weakref.ref(node)
        node.add_on_set_parameters_callback(self.on_set)
        node.add_post_set_parameters_callback(self._after_set)

    async def prepare(self, given: Sequence[ParameterMessage]) -> None:
        """Read a newly set scenario before `on_set` accepts or refuses it."""
        self._read = None
        for one in given:
            source = one.value.string_value
            if one.name == "scenario" and source != self._scenario and not self._loading.busy:
                reading = self._reader.read(source)
                await done(reading)
                self._read = source, reading
                return

    def on_set(self, parameters: Sequence[RosParameter]) -> SetParametersResult:
        """Apply a set of parameters as a whole, or refuse all of them; callback of rclpy."""
        given = {parameter.name: parameter.value for parameter in parameters}
        for parameter in PARAMETERS:
            if parameter.name in given and (fault := parameter.fault(given[parameter.name])):
                return SetParametersResult(successful=False, reason=fault)
        if (sensor := given.get("readmit")) and (fault := self._readmit(sensor)):
            return SetParametersResult(successful=False, reason=fault)
        wanted = given.get("scenario", self._scenario)
        if wanted != self._scenario and (fault := self._load(wanted)):
            return SetParametersResult(successful=False, reason=fault)
        if "command_timeout" in given:
            self._loop.command_timeout = float(given["command_timeout"])
        return SetParametersResult(successful=True)

    def _after_set(self, parameters: Sequence[RosParameter]) -> None:
        """Make `readmit` empty again, so that it can be set to the same sensor later; callback of rclpy."""
        if any(one.name == "readmit" and one.value for one in parameters):
            self._node.set_parameters([RosParameter("readmit", value="")])

    def _load(self, wanted: str) -> str:
        """Begin to load a scenario; returns the reason of a refusal, empty otherwise."""
        if self._loading.busy:
            return "another scenario is being loaded"
        read, self._read = self._read, None
        if read is None or read[0] != wanted:
            return f"scenario: given '{wanted}' while another one is being read; allowed: one at a time"
        try:
            scenario = read[1].result()
        except ScenarioError as error:
            return str(error)

        def put_back(future: Future[str]) -> None:
            if future.result():
                self._node.set_parameters([RosParameter("scenario", value=self._scenario)])

        self._loading.begin(scenario, wanted, paused=self._loop.paused).add_done_callback(put_back)
        return ""

    async def _set_parameters_callback(self, request: Any, response: Any) -> Any:
        await self.prepare(request.parameters)
        return super()._set_parameters_callback(request, response)

    async def _set_parameters_atomically_callback(self, request: Any, response: Any) -> Any:
        await self.prepare(request.parameters)
        return super()._set_parameters_atomically_callback(request, response)


class _Grouped:
    """Proxy of a node that creates services in a reentrant callback group, so that none waits for another."""

    def __init__(self, node: Node) -> None:
        self._node, self._group = node, ReentrantCallbackGroup()
        self.get_name = node.get_name

    def create_service(self, *arguments: Any, **options: Any) -> Any:
        """Create a service of the node in the callback group of the parameter services."""
        return self._node.create_service(*arguments, callback_group=self._group, **options)


def are_unchanged(node: Node, parameters: list[RosParameter]) -> bool:
    """Whether all parameters already have their given values, as in a file of `ros2 param dump`."""
    return all(
        node.has_parameter(one.name)
        and (now := node.get_parameter(one.name)).type_ == one.type_
        and now.value == one.value
        for one in with_doubles(parameters)
    )


def unknown_parameter(node: Node, parameters: Sequence[RosParameter]) -> str:
    """Reason in a line why parameters cannot be set: the name of one that the node does not have; empty otherwise."""
    for one in parameters:
        if not node.has_parameter(one.name):
            near = get_close_matches(one.name, [parameter.name for parameter in PARAMETERS], n=1)
            hint = f"did you mean {near[0]}?" if near else f"allowed while the twin runs: {', '.join(CHANGING)}"
            return f"{printable(one.name)}: given a parameter that does not exist; {hint}"
    return ""


def inherited(node: Node, scenario: str, *, paused: bool) -> list[RosParameter]:
    """Parameters of a node restarted with a scenario: overrides and changes of the previous node."""
    kept = dict(node._parameter_overrides) | {name: node.get_parameter(name) for name in CHANGING}
    kept |= {
        name: RosParameter(name, value=value)
        for name, value in (("scenario", scenario), ("set", ""), ("snapshot", ""), ("start_paused", paused))
    }
    return list(kept.values())
