"""Services of simulation_interfaces, if that package is installed: state, steps, reset, entities, worlds.

They are below the name of the node; https://github.com/ros-simulation/simulation_interfaces has the definitions.
Features that the twin does not have (spawning, setting states, going back in time) give RESULT_FEATURE_UNSUPPORTED.
Another world is another scenario: it is built beside the running one, which then ends, and the twin restarts.
"""

from __future__ import annotations

import re
import threading
from collections.abc import Callable
from concurrent.futures import CancelledError, Future
from concurrent.futures import TimeoutError as FutureTimeoutError
from importlib import import_module
from typing import Any
from urllib.parse import unquote, urlsplit

from rclpy.action import ActionServer, CancelResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node

from cable_twin.basics.printable import printable
from cable_twin.frame.records import Command, CommandError
from cable_twin.key_figures import compile_figures
from cable_twin.messages import SECOND, FrameNames
from cable_twin.ros.parameters import ParameterError
from cable_twin.ros.services import NO_ANSWER, SERVICE_TIMEOUT, Services, done
from cable_twin.ros.startup import is_installed
from cable_twin.runtime.frame_loop import FrameLoop
from cable_twin.runtime.run_clock import RunClock
from cable_twin.runtime.scenario_reading import NoScenarioError, ScenarioReader
from cable_twin.runtime.separate_process import FilterError, matching_names
from cable_twin.scenario import Scenario, ScenarioError, config_directory
from cable_twin.simulation import EquilibriumError, Simulation

PACKAGE = "simulation_interfaces"
# codes of Result, and of LoadWorld
UNSUPPORTED, OK, NOT_FOUND, INCORRECT_STATE, FAILED = range(5)
UNSUPPORTED_FORMAT, NO_RESOURCE, RESOURCE_PARSE_ERROR = 101, 102, 103
# codes of SimulationState, of SetSimulationState, and of ResetSimulation
STOPPED, PLAYING, PAUSED, _, _, LOADING_WORLD = range(6)
ALREADY_IN_TARGET_STATE, INCORRECT_TRANSITION = 101, 103
SCOPE_STATE = 2
FEATURES = {  # codes of SimulatorFeatures
    "ENTITY_STATE_GETTING": 10,
    "SIMULATION_RESET": 20,
    "SIMULATION_RESET_STATE": 22,
    "SIMULATION_STATE_GETTING": 24,
    "SIMULATION_STATE_SETTING": 25,
    "SIMULATION_STATE_PAUSE": 26,
    "STEP_SIMULATION_SINGLE": 31,
    "STEP_SIMULATION_MULTIPLE": 32,
    "STEP_SIMULATION_ACTION": 33,
    "WORLD_LOADING": 40,
    "WORLD_RESOURCE_STRING": 41,
    "WORLD_INFO_GETTING": 44,
    "AVAILABLE_WORLDS": 45,
}
SERVICES = (  # types; the name of each is that of a method of `SimulationServices`, and of its service
    "GetSimulatorFeatures",
    "GetSimulationState",
    "SetSimulationState",
    "StepSimulation",
    "ResetSimulation",
    "GetEntities",
    "GetEntityState",
    "GetEntitiesStates",
    "GetAvailableWorlds",
    "GetCurrentWorld",
    "LoadWorld",
)
ABOUT = (
    "entities are the bodies of vehicles; their acceleration is not given; a step is a frame; after a reset simulated "
    "time continues"
)


def answered(response: Any, result: int = OK, message: str = "") -> Any:
    """Response of a service with result code and message filled in."""
    response.result.result, response.result.error_message = result, message
    return response


class WorldLoading:
    """Loader that builds another scenario in its own thread, while the paused twin still answers.

    Args:
        node: node whose log reports the outcome.
        loop: frame loop of the running scenario.
        check: raises ParameterError if the node's parameters do not fit a simulation.
        before: name or path of the running scenario.

    Attributes:
        before: as given.
        source: name or path of the loaded scenario, for the parameter `scenario`.
        loaded: simulation to restart with, None until it is built.
        paused: whether the twin restarts paused.
        paused_before: whether the running scenario was paused before.
        busy: whether a scenario is being loaded, or is loaded and about to start.
    """

    def __init__(self, node: Node, loop: FrameLoop, check: Callable[[Simulation], None], before: str) -> None:
        self._node, self._loop, self._check = node, loop, check
        self.before, self.source = before, ""
        self.loaded: Simulation | None = None
        self.paused = self.paused_before = False
        self.busy = False

    def begin(self, scenario: Scenario, source: str, *, paused: bool) -> Future[str]:
        """Pause simulated time and load a scenario; returns a future of the error message, empty after success.

        After a fault the running scenario continues.
        """
        self.busy, self.paused_before = True, self._loop.paused
        self._loop.pause(True)
        self._node.get_logger().info(f"loading '{scenario.name}'; simulated time is paused meanwhile")
        future: Future[str] = Future()
        threading.Thread(
            target=self._load, args=(scenario, source, paused, future), name="loading", daemon=True
        ).start()
        return future

    def _load(self, scenario: Scenario, source: str, paused: bool, future: Future[str]) -> None:
        fault = ""
        try:
            simulation = Simulation(scenario, meanwhile=compile_figures)
            self._check(simulation)
        except (EquilibriumError, ParameterError) as error:
            fault = " ".join(str(error).split())
        except Exception as error:  # a fault of the program: reported to the caller, and the twin continues
            fault = f"fault of the program: {printable(repr(error), 400)}"
        if fault:
            self._node.get_logger().error(
                f"'{scenario.name}' is not loaded: {fault}; the previous scenario keeps running"
            )
            self.busy = False
            self._loop.pause(self.paused_before)
        else:
            self.source, self.paused, self.loaded = source, paused, simulation
        future.set_result(fault)


class SimulationServices:
    """Handlers of the simulation_interfaces services of one twin, a method for each of `SERVICES`.

    Args:
        simulation: running simulation.
        loop: frame loop.
        clock: clock of the time stamps.
        services: services of the node, which compute steps.
        loading: loads another scenario.
        reader: reads scenarios that are named or sent.
        messages: module of the message types.
        frames: names of coordinate frames.
    """

    def __init__(
        self,
        simulation: Simulation,
        loop: FrameLoop,
        clock: RunClock,
        services: Services,
        loading: WorldLoading,
        reader: ScenarioReader,
        messages: Any,
        frames: FrameNames,
    ) -> None:
        self._simulation, self._loop, self._clock, self._services = simulation, loop, clock, services
        self._loading, self._reader, self._messages, self._frames = loading, reader, messages, frames
        self._stopped_at: float | None = simulation.time  # s of simulated time at which it is stopped
        self._rows = {name: row for row, name in enumerate(simulation.layout.bodies)}

    def get_simulator_features(self, _: Any, response: Any) -> Any:
        """Report the supported features of simulation_interfaces."""
        response.features.features = [*FEATURES.values()]
        response.features.custom_info = ABOUT
        return response

    def get_simulation_state(self, _: Any, response: Any) -> Any:
        """Report the state: playing, paused, or stopped at the start."""
        response.state.state = self._state
        return answered(response)

    def set_simulation_state(self, request: Any, response: Any) -> Any:
        """Set the state: play, pause, or stop, which pauses at the start."""
        wanted = request.state.state
        if self._loading.busy:
            return answered(response, INCORRECT_STATE, "another world is being loaded")
        if wanted not in (STOPPED, PLAYING, PAUSED):
            return answered(response, UNSUPPORTED, f"state: given {wanted}; allowed: 0 stopped, 1 playing, 2 paused")
        if wanted == self._state:
            return answered(response, ALREADY_IN_TARGET_STATE, "the simulation is already in this state")
        if wanted == PLAYING and self._loop.fault:
            return answered(response, FAILED, f"{self._loop.fault}; reset it first")
        if wanted == PAUSED and self._state == STOPPED:
            return answered(response, INCORRECT_TRANSITION, "stopped; allowed: playing first")
        self._loop.pause(wanted != PLAYING)  # before a reset, so that no frame comes after it
        if wanted == STOPPED:
            if fault := self._reset():
                return answered(response, FAILED, fault)
            self._loop.pause(True)  # as a reset after a fault resumes
        self._stopped_at = self._loop.simulated_time if wanted == STOPPED else None
        return answered(response)

    async def step_simulation(self, request: Any, response: Any) -> Any:
        """Compute a number of frames while paused, as fast as possible."""
        if request.steps < 1:
            return answered(response, FAILED, "steps: given 0; allowed: 1 or more")
        taken, message = await self._services.step(int(request.steps))
        return answered(response) if taken else answered(response, FAILED, message)

    async def simulate_steps(self, goal: Any, result: Any, feedback: Any) -> Any:
        """Compute a number of frames as an action, with feedback and possible cancellation after each frame."""
        steps = int(goal.request.steps)

        def on_frame(taken: int) -> bool:
            feedback.completed_steps, feedback.remaining_steps = taken, steps - taken
            goal.publish_feedback(feedback)
            return not goal.is_cancel_requested

        finished, message = (False, "steps: given 0; allowed: 1 or more")
        if steps > 0:
            finished, message = await self._services.step(steps, on_frame)
        if finished:
            goal.succeed()
            return answered(result)
        if goal.is_cancel_requested:
            goal.canceled()
            return answered(result, FAILED, f"cancelled: {message}")
        goal.abort()
        return answered(result, FAILED, message)

    def reset_simulation(self, request: Any, response: Any) -> Any:
        """Reset the state of the twin to its start; simulated time runs on."""
        if request.scope != SCOPE_STATE:
            given = f"scope: given {request.scope}; allowed: {SCOPE_STATE} (SCOPE_STATE), for time never goes back"
            return answered(response, UNSUPPORTED, given)
        fault = self._reset()
        return answered(response, FAILED, fault) if fault else answered(response)

    async def get_entities(self, request: Any, response: Any) -> Any:
        """Report the names of entities, which are bodies of vehicles, that match the filters."""
        response.entities, fault = await self._matching_entities(request.filters)
        return answered(response, *fault) if fault else answered(response)

    def get_entity_state(self, request: Any, response: Any) -> Any:
        """Report the pose and the twist of an entity, which is a body of a vehicle."""
        if request.entity not in self._rows:
            known = ", ".join([*self._rows][:8])
            return answered(response, NOT_FOUND, f"entity: given '{printable(request.entity)}'; allowed: {known}")
        response.state = self._entity_state(request.entity)
        return answered(response)

    async def get_entities_states(self, request: Any, response: Any) -> Any:
        """Report the names, poses and twists of entities, which are bodies, that match the filters."""
        response.entities, fault = await self._matching_entities(request.filters)
        response.states = [self._entity_state(name) for name in response.entities]
        return answered(response, *fault) if fault else answered(response)

    async def get_available_worlds(self, request: Any, response: Any) -> Any:
        """Report the installed scenarios."""
        if request.additional_sources or request.filter.tags:
            return answered(response, UNSUPPORTED, "additional_sources and tags are not supported; allowed: none")
        reading = self._reader.worlds()
        await done(reading)
        response.worlds = []
        for name, description in reading.result():
            world = self._messages.WorldResource()
            world.name, world.description = name, description
            world.world_resource.uri = (config_directory() / f"{name}.yaml").as_uri()
            response.worlds.append(world)
        return answered(response)

    async def load_world(self, request: Any, response: Any) -> Any:
        """Build another scenario; the twin then closes its logs and restarts paused at its start."""
        resource = request.world_resource
        if not resource.uri and not resource.resource_string:
            return answered(response, NO_RESOURCE, "world: given nothing; allowed: uri, or YAML as resource_string")
        if self._loading.busy:
            return answered(response, INCORRECT_STATE, "another world is being loaded")
        try:
            address = urlsplit(resource.uri)
        except ValueError:  # unbalanced brackets
            address = urlsplit("none:")
        if address.scheme not in ("", "file") or address.netloc not in ("", "localhost"):
            shown = printable(resource.uri)
            given = f"uri: given '{shown}'; allowed: file:///PATH of a YAML file, or the name of a scenario"
            return answered(response, UNSUPPORTED_FORMAT, given)
        source = unquote(address.path) if address.scheme else resource.uri
        reading = self._reader.read(source, "" if source else resource.resource_string)
        await done(reading)
        try:
            scenario = reading.result()
        except NoScenarioError as error:
            return answered(response, NOT_FOUND, str(error))
        except ScenarioError as error:
            return answered(response, RESOURCE_PARSE_ERROR, str(error))
        if self._loading.busy:
            return answered(response, INCORRECT_STATE, "another world is being loaded")
        loaded = self._loading.begin(scenario, source or scenario.name, paused=True)
        await done(loaded)
        if fault := loaded.result():
            return answered(response, FAILED, fault)
        response.world.name, response.world.description = scenario.name, scenario.description
        response.world.world_resource = resource
        return answered(response)

    def get_current_world(self, _: Any, response: Any) -> Any:
        """Report the running scenario, as YAML."""
        scenario = self._simulation.scenario
        response.world.name, response.world.description = scenario.name, scenario.description
        response.world.world_resource.resource_string = scenario.to_yaml()
        return answered(response)

    @property
    def _state(self) -> int:
        if self._loading.busy:
            return LOADING_WORLD
        if not self._loop.paused:
            return PLAYING
        return STOPPED if self._stopped_at == self._loop.simulated_time else PAUSED

    def _reset(self) -> str:
        """Reset the state of the twin; returns the reason of a refusal, empty otherwise."""
        try:
            self._loop.submit(Command("reset", {}), "service").result(SERVICE_TIMEOUT)
        except (CommandError, FutureTimeoutError, CancelledError) as error:
            return str(error) or NO_ANSWER
        return ""

    async def _matching_entities(self, filters: Any) -> tuple[list[str], tuple[int, str] | None]:
        """Names of bodies that match the filters, or result code and message of an unsupported filter."""
        if filters.categories or filters.tags.tags or filters.bounds.points:
            return [], (
                UNSUPPORTED,
                "categories, tags and bounds are not supported; allowed: a regular expression of names",
            )
        matching = matching_names(filters.filter, [*self._rows])
        await done(matching)
        try:
            return matching.result(), None
        except FilterError as error:
            return [], (FAILED, str(error))

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


def service_name(kind: str) -> str:
    """Name of the service for a service type, such as get_entities for GetEntities."""
    return re.sub(r"(?<=[a-z])(?=[A-Z])", "_", kind).lower()


def offer_simulation_services(
    node: Any,
    simulation: Simulation,
    loop: FrameLoop,
    clock: RunClock,
    services: Services,
    loading: WorldLoading,
    reader: ScenarioReader,
    frames: FrameNames,
) -> Any:
    """Create the simulation_interfaces services of a node; returns the action server, None without the package."""
    if not is_installed(PACKAGE):
        return None
    kinds = import_module(f"{PACKAGE}.srv")
    own = SimulationServices(
        simulation, loop, clock, services, loading, reader, import_module(f"{PACKAGE}.msg"), frames
    )
    group = ReentrantCallbackGroup()
    for kind in SERVICES:
        name = service_name(kind)
        node.create_service(getattr(kinds, kind), f"~/{name}", getattr(own, name), callback_group=group)
    action = import_module(f"{PACKAGE}.action").SimulateSteps

    async def simulate_steps(goal: Any) -> Any:  # rclpy awaits coroutine functions only
        return await own.simulate_steps(goal, action.Result(), action.Feedback())

    return ActionServer(
        node,
        action,
        "~/simulate_steps",
        simulate_steps,
        cancel_callback=lambda _: CancelResponse.ACCEPT,
        callback_group=group,
    )
