"""Parameters set while the twin runs: accepted changes and their effects."""

from __future__ import annotations

import weakref
from collections.abc import Sequence
from concurrent.futures import Future
from typing import Any, cast

from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import SetParametersResult
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter
from rclpy.parameter_service import ParameterService

from cable_twin.ros.declaration import as_meant
from cable_twin.ros.executor import done
from cable_twin.ros.node_parameters import CHANGING, PARAMETERS
from cable_twin.ros.world_loading import WorldLoading
from cable_twin.runtime.frame_loop import FrameLoop
from cable_twin.runtime.scenario_reading import ScenarioReader
from cable_twin.scenario import Scenario, ScenarioError


class LiveParameters:
    """Changes of the parameters in `CHANGING`; another `scenario` is loaded, and the twin restarts with it.

    Args:
        node: that has them.
        loop: what runs.
        loading: of another scenario.
        reader: of that.
    """

    def __init__(self, node: Node, loop: FrameLoop, loading: WorldLoading, reader: ScenarioReader) -> None:
        self._node, self._loop, self._loading, self._reader = node, loop, loading, reader
        self._scenario = node.get_parameter("scenario").value
        self._read: tuple[str, Future[Scenario]] | None = None

    async def prepare(self, given: Sequence[ParameterMessage]) -> None:
        """Read a newly set scenario before `on_set` decides about it."""
        self._read = None
        for one in given:
            source = one.value.string_value
            if one.name == "scenario" and source != self._scenario and not self._loading.busy:
                reading = self._reader.read(source)
                await done(reading)
                self._read = source, reading
                return

    def on_set(self, parameters: Sequence[RosParameter]) -> SetParametersResult:
        """Apply all parameters, or none."""
        given = {parameter.name: parameter.value for parameter in parameters}
        for parameter in PARAMETERS:
            if parameter.name in given and (fault := parameter.fault(given[parameter.name])):
                return SetParametersResult(successful=False, reason=fault)
        wanted = given.get("scenario", self._scenario)
        if wanted != self._scenario and (fault := self._load(wanted)):
            return SetParametersResult(successful=False, reason=fault)
        if "command_timeout" in given:
            self._loop.command_timeout = float(given["command_timeout"])
        return SetParametersResult(successful=True)

    def _load(self, wanted: str) -> str:
        """Begin to load a scenario; returns the reason of a refusal, empty otherwise."""
        if self._loading.busy:
            return "another scenario is being loaded"
        read, self._read = self._read, None
        if read is None or read[0] != wanted:
            return "one scenario at a time"
        try:
            scenario = read[1].result()
        except ScenarioError as error:
            return str(error)

        def put_back(future: Future[str]) -> None:
            if future.result():
                self._node.set_parameters([RosParameter("scenario", value=self._scenario)])

        self._loading.begin(scenario, wanted, paused=self._loop.paused).add_done_callback(put_back)
        return ""


class LiveParameterService(ParameterService):
    """Parameter services of the node that read a new scenario before setting it, without blocking the executor."""

    def __init__(self, node: Node, live: LiveParameters) -> None:
        self._live = live
        super().__init__(cast("Node", _Grouped(node)))
        self._node_weak_ref = weakref.ref(node)

    async def _set_parameters_callback(self, request: Any, response: Any) -> Any:
        await self._live.prepare(request.parameters)
        return super()._set_parameters_callback(request, response)

    async def _set_parameters_atomically_callback(self, request: Any, response: Any) -> Any:
        await self._live.prepare(request.parameters)
        return super()._set_parameters_atomically_callback(request, response)


class _Grouped:
    """Node proxy whose services do not wait for each other."""

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
        for one in as_meant(parameters)
    )


def inherited(node: Node, scenario: str, *, paused: bool) -> list[RosParameter]:
    """Parameters of a node restarted with a scenario: overrides and changes of the previous node."""
    kept = dict(node._parameter_overrides) | {name: node.get_parameter(name) for name in CHANGING}
    kept |= {
        name: RosParameter(name, value=value)
        for name, value in (("scenario", scenario), ("set", ""), ("snapshot", ""), ("start_paused", paused))
    }
    return list(kept.values())


__all__ = ["LiveParameterService", "LiveParameters", "are_unchanged", "inherited"]
