"""Parameters that are set while the twin runs: what is taken, and what comes of it."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Future

from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter

from cable_twin.ros.declaration import as_meant
from cable_twin.ros.frame_loop import FrameLoop
from cable_twin.ros.node_parameters import CHANGING, PARAMETERS
from cable_twin.ros.world_loading import WorldLoading
from cable_twin.scenario import ScenarioError, load_scenario


class LiveParameters:
    """Only parameters of `CHANGING` change; another `scenario` is loaded, and the twin begins anew with it.

    Args:
        node: that has them.
        loop: what runs.
        loading: of another scenario.
    """

    def __init__(self, node: Node, loop: FrameLoop, loading: WorldLoading) -> None:
        self._node, self._loop, self._loading = node, loop, loading
        self._scenario = node.get_parameter("scenario").value

    def on_set(self, parameters: Sequence[RosParameter]) -> SetParametersResult:
        """Take them all, or none."""
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
        """Begin to load a scenario; returns why not, or nothing."""
        if self._loading.busy:
            return "another scenario is being loaded"
        try:
            scenario = load_scenario(wanted)
        except ScenarioError as error:
            return str(error)

        def put_back(future: Future[str]) -> None:
            if future.result():
                self._node.set_parameters([RosParameter("scenario", value=self._scenario)])

        self._loading.begin(scenario, wanted, paused=self._loop.paused).add_done_callback(put_back)
        return ""


def are_unchanged(node: Node, parameters: list[RosParameter]) -> bool:
    """Whether all have the values that they are set to, as in a file of `ros2 param dump`."""
    return all(
        node.has_parameter(one.name)
        and (now := node.get_parameter(one.name)).type_ == one.type_
        and now.value == one.value
        for one in as_meant(parameters)
    )


def inherited(node: Node, loading: WorldLoading) -> list[RosParameter]:
    """Parameters of the node that begins anew with what was loaded: those that this one was given, and what changed."""
    kept = dict(node._parameter_overrides) | {name: node.get_parameter(name) for name in CHANGING}
    kept |= {
        name: RosParameter(name, value=value)
        for name, value in (
            ("scenario", loading.source),
            ("set", ""),
            ("snapshot", ""),
            ("start_paused", loading.paused),
        )
    }
    return list(kept.values())


__all__ = ["LiveParameters", "are_unchanged", "inherited"]
