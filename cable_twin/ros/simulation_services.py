"""The services of simulation_interfaces, where that package can be imported: state, steps, reset, entities, worlds.

They are below the name of the node. What the twin does not do (spawning, setting of states, going back in time) is
answered with RESULT_FEATURE_UNSUPPORTED; https://github.com/ros-simulation/simulation_interfaces has the definitions.
"""

from __future__ import annotations

import re
from concurrent.futures import CancelledError
from concurrent.futures import TimeoutError as FutureTimeoutError
from importlib import import_module
from importlib.util import find_spec
from typing import Any

from cable_twin.messages import SECOND, FrameNames
from cable_twin.records import Command, CommandError
from cable_twin.ros.frame_loop import FrameLoop
from cable_twin.ros.run_clock import RunClock
from cable_twin.ros.services import SERVICE_TIMEOUT, Services
from cable_twin.scenario import config_directory, load_scenario, scenario_names
from cable_twin.simulation import Simulation

PACKAGE = "simulation_interfaces"
# of Result, of SimulationState, of SetSimulationState, and of ResetSimulation
UNSUPPORTED, OK, NOT_FOUND, INCORRECT_STATE, FAILED = range(5)
STOPPED, PLAYING, PAUSED = range(3)
ALREADY_IN_TARGET_STATE, INCORRECT_TRANSITION = 101, 103
SCOPE_STATE = 2
FEATURES = {  # of SimulatorFeatures
    "ENTITY_STATE_GETTING": 10,
    "SIMULATION_RESET": 20,
    "SIMULATION_RESET_STATE": 22,
    "SIMULATION_STATE_GETTING": 24,
    "SIMULATION_STATE_SETTING": 25,
    "SIMULATION_STATE_PAUSE": 26,
    "STEP_SIMULATION_SINGLE": 31,
    "STEP_SIMULATION_MULTIPLE": 32,
    "WORLD_INFO_GETTING": 44,
    "AVAILABLE_WORLDS": 45,
}
ABOUT = (
    "entities are the bodies of vehicles; their acceleration is not given; a step is a frame; a reset lets time run on"
)


class SimulationServices:
    """Answers of one twin.

    Args:
        simulation: what runs.
        loop: that runs it.
        clock: of stamps.
        services: that step.
        messages: module of the message types.
    """

    def __init__(
        self,
        simulation: Simulation,
        loop: FrameLoop,
        clock: RunClock,
        services: Services,
        messages: Any,
        frames: FrameNames = FrameNames(),  # noqa: B008 - frozen
    ) -> None:
        self._simulation, self._loop, self._clock, self._services = simulation, loop, clock, services
        self._messages, self._frames = messages, frames
        self._stopped_at: float | None = None  # s of simulated time
        self._rows = {name: row for row, name in enumerate(simulation.layout.bodies)}
        self.handlers = {
            "GetSimulatorFeatures": self.get_simulator_features,
            "GetSimulationState": self.get_simulation_state,
            "SetSimulationState": self.set_simulation_state,
            "StepSimulation": self.step_simulation,
            "ResetSimulation": self.reset_simulation,
            "GetEntities": self.get_entities,
            "GetEntityState": self.get_entity_state,
            "GetEntitiesStates": self.get_entities_states,
            "GetAvailableWorlds": self.get_available_worlds,
            "GetCurrentWorld": self.get_current_world,
        }

    def get_simulator_features(self, _: Any, response: Any) -> Any:
        """What of the interfaces there is."""
        response.features.features = [*FEATURES.values()]
        response.features.custom_info = ABOUT
        return response

    def get_simulation_state(self, _: Any, response: Any) -> Any:
        """Playing, paused, or stopped at the start."""
        response.state.state = self._state
        return _told(response)

    def set_simulation_state(self, request: Any, response: Any) -> Any:
        """Play, pause, or stop: pause at the start."""
        wanted = request.state.state
        if wanted not in (STOPPED, PLAYING, PAUSED):
            return _told(response, UNSUPPORTED, f"state {wanted} given; allowed: 0 stopped, 1 playing, 2 paused")
        if wanted == self._state:
            return _told(response, ALREADY_IN_TARGET_STATE, "it is in this state")
        if wanted == PLAYING and self._loop.fault:
            return _told(response, FAILED, f"{self._loop.fault}; reset it first")
        if wanted == PAUSED and self._state == STOPPED:
            return _told(response, INCORRECT_TRANSITION, "stopped; allowed: playing first")
        self._loop.pause(wanted != PLAYING)
        if wanted == STOPPED:  # paused before, so that no frame comes after the reset
            if fault := self._reset():
                return _told(response, FAILED, fault)
            self._loop.pause(True)  # a reset after a fault lets time run
        self._stopped_at = self._loop.simulated_time if wanted == STOPPED else None
        return _told(response)

    async def step_simulation(self, request: Any, response: Any) -> Any:
        """Take so many frames while paused, as fast as they go."""
        if request.steps < 1:
            return _told(response, FAILED, "0 steps given; allowed: 1 or more")
        done, message = await self._services.step(int(request.steps))
        return _told(response) if done else _told(response, FAILED, message)

    def reset_simulation(self, request: Any, response: Any) -> Any:
        """Put the state back; time runs on, and nothing was spawned."""
        if request.scope != SCOPE_STATE:
            given = f"scope {request.scope} given; allowed: {SCOPE_STATE} (SCOPE_STATE), for time never goes back"
            return _told(response, UNSUPPORTED, given)
        fault = self._reset()
        return _told(response, FAILED, fault) if fault else _told(response)

    def get_entities(self, request: Any, response: Any) -> Any:
        """Names of bodies that fit."""
        response.entities, fault = self._fitting(request.filters)
        return _told(response, *fault) if fault else _told(response)

    def get_entity_state(self, request: Any, response: Any) -> Any:
        """Pose and twist of a body."""
        if request.entity not in self._rows:
            known = ", ".join([*self._rows][:8])
            return _told(response, NOT_FOUND, f"'{request.entity}' given; known: {known}")
        response.state = self._entity_state(request.entity)
        return _told(response)

    def get_entities_states(self, request: Any, response: Any) -> Any:
        """The same of all that fit."""
        response.entities, fault = self._fitting(request.filters)
        response.states = [self._entity_state(name) for name in response.entities]
        return _told(response, *fault) if fault else _told(response)

    def get_available_worlds(self, request: Any, response: Any) -> Any:
        """The scenarios that are installed."""
        if request.additional_sources or request.filter.tags:
            return _told(response, UNSUPPORTED, "additional_sources and tags are not known; allowed: none")
        response.worlds = []
        for name in scenario_names():
            world = self._messages.WorldResource()
            world.name, world.description = name, load_scenario(name).description
            world.world_resource.uri = f"file://{config_directory() / f'{name}.yaml'}"
            response.worlds.append(world)
        return _told(response)

    def get_current_world(self, _: Any, response: Any) -> Any:
        """The scenario that runs, as YAML."""
        scenario = self._simulation.scenario
        response.world.name, response.world.description = scenario.name, scenario.description
        response.world.world_resource.resource_string = scenario.to_yaml()
        return _told(response)

    @property
    def _state(self) -> int:
        if not self._loop.paused:
            return PLAYING
        return STOPPED if self._stopped_at == self._loop.simulated_time else PAUSED

    def _reset(self) -> str:
        """Put the state back; returns why not, or nothing."""
        try:
            self._loop.submit(Command("reset", {}), "service").result(SERVICE_TIMEOUT)
        except (CommandError, FutureTimeoutError, CancelledError) as error:
            return str(error) or f"no frame boundary within {SERVICE_TIMEOUT:g} s; it is done at the next one"
        return ""

    def _fitting(self, filters: Any) -> tuple[list[str], tuple[int, str] | None]:
        """Names that fit, or result and line of a filter that cannot be applied."""
        if filters.categories or filters.tags.tags or filters.bounds.points:
            return [], (UNSUPPORTED, "categories, tags, bounds are not known; allowed: a regular expression of names")
        try:
            wanted = re.compile(filters.filter)
        except re.error as error:
            return [], (FAILED, f"filter {filters.filter!r} given: {error}; allowed: a regular expression of names")
        return [name for name in self._rows if wanted.search(name)], None

    def _entity_state(self, name: str) -> Any:
        snapshot, row, state = self._simulation.snapshot, self._rows[name], self._messages.EntityState()
        columns = snapshot.columns
        state.header.frame_id = self._frames.frame_id
        stamp = state.header.stamp
        stamp.sec, stamp.nanosec = divmod(self._clock.stamp_ns(snapshot.time), SECOND)
        for target, values in (
            (state.pose.position, columns.body_position[row]),
            (state.pose.orientation, columns.body_orientation[row]),
            (state.twist.linear, columns.body_velocity[row]),
            (state.twist.angular, columns.body_angular_velocity[row]),
        ):
            for axis, value in zip("xyzw", values.tolist(), strict=False):
                setattr(target, axis, value)
        return state


def _told(response: Any, result: int = OK, message: str = "") -> Any:
    """The response with its result."""
    response.result.result, response.result.error_message = result, message
    return response


def offer_simulation_services(
    node: Any, simulation: Simulation, loop: FrameLoop, clock: RunClock, services: Services, frames: FrameNames
) -> None:
    """Create them below the name of a node of rclpy; nothing where the package is not there."""
    if find_spec(PACKAGE) is None:
        return
    from rclpy.callback_groups import ReentrantCallbackGroup  # noqa: PLC0415 - tests of the answers need no rclpy

    kinds = import_module(f"{PACKAGE}.srv")
    own = SimulationServices(simulation, loop, clock, services, import_module(f"{PACKAGE}.msg"), frames)
    group = ReentrantCallbackGroup()
    for kind, handler in own.handlers.items():
        name = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", kind).lower()
        node.create_service(getattr(kinds, kind), f"~/{name}", handler, callback_group=group)


__all__ = ["FEATURES", "SimulationServices", "offer_simulation_services"]
