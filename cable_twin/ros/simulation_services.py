"""Services of simulation_interfaces, if that package is installed: state, steps, reset, entities, worlds.

They are below the name of the node. What the twin does not do (spawning, setting of states, going back in time) is
answered with RESULT_FEATURE_UNSUPPORTED; https://github.com/ros-simulation/simulation_interfaces has the definitions.
"""

from __future__ import annotations

import re
from concurrent.futures import CancelledError
from concurrent.futures import TimeoutError as FutureTimeoutError
from importlib import import_module
from typing import Any

from cable_twin.basics.printable import printable
from cable_twin.frame.records import Command, CommandError
from cable_twin.messages import SECOND, FrameNames
from cable_twin.ros.declaration import is_installed
from cable_twin.ros.executor import done
from cable_twin.ros.services import SERVICE_TIMEOUT, Services
from cable_twin.ros.world_loading import WorldLoading
from cable_twin.ros.world_services import FAILED, INCORRECT_STATE, NOT_FOUND, UNSUPPORTED, WorldServices, told
from cable_twin.runtime.frame_loop import FrameLoop
from cable_twin.runtime.run_clock import RunClock
from cable_twin.runtime.scenario_reading import ScenarioReader
from cable_twin.runtime.separate_process import FilterError, matching_names
from cable_twin.simulation import Simulation

PACKAGE = "simulation_interfaces"
# of SimulationState, of SetSimulationState, and of ResetSimulation
STOPPED, PLAYING, PAUSED, _, _, LOADING_WORLD = range(6)
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
    "STEP_SIMULATION_ACTION": 33,
    "WORLD_LOADING": 40,
    "WORLD_RESOURCE_STRING": 41,
    "WORLD_INFO_GETTING": 44,
    "AVAILABLE_WORLDS": 45,
}
ABOUT = (
    "entities are the bodies of vehicles; their acceleration is not given; a step is a frame; a reset lets time run on"
)


class SimulationServices:
    """Handlers of the simulation_interfaces services of one twin.

    Args:
        simulation: what runs.
        loop: that runs it.
        clock: of stamps.
        services: that step.
        loading: of other scenarios.
        reader: of those.
        messages: module of the message types.
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
        frames: FrameNames = FrameNames(),  # noqa: B008 - frozen
    ) -> None:
        self._simulation, self._loop, self._clock, self._services = simulation, loop, clock, services
        self._loading, self._messages, self._frames = loading, messages, frames
        self._stopped_at: float | None = simulation.time  # s of simulated time, if it stands still there
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
            **WorldServices(simulation.scenario, loading, reader, messages).handlers,
        }

    def get_simulator_features(self, _: Any, response: Any) -> Any:
        """Report the supported features of simulation_interfaces."""
        response.features.features = [*FEATURES.values()]
        response.features.custom_info = ABOUT
        return response

    def get_simulation_state(self, _: Any, response: Any) -> Any:
        """Report the state: playing, paused, or stopped at the start."""
        response.state.state = self._state
        return told(response)

    def set_simulation_state(self, request: Any, response: Any) -> Any:
        """Set the state: play, pause, or stop, which pauses at the start."""
        wanted = request.state.state
        if self._loading.busy:
            return told(response, INCORRECT_STATE, "another world is being loaded")
        if wanted not in (STOPPED, PLAYING, PAUSED):
            return told(response, UNSUPPORTED, f"state {wanted} given; allowed: 0 stopped, 1 playing, 2 paused")
        if wanted == self._state:
            return told(response, ALREADY_IN_TARGET_STATE, "it is already in this state")
        if wanted == PLAYING and self._loop.fault:
            return told(response, FAILED, f"{self._loop.fault}; reset it first")
        if wanted == PAUSED and self._state == STOPPED:
            return told(response, INCORRECT_TRANSITION, "stopped; allowed: playing first")
        self._loop.pause(wanted != PLAYING)
        if wanted == STOPPED:  # paused before, so that no frame comes after the reset
            if fault := self._reset():
                return told(response, FAILED, fault)
            self._loop.pause(True)  # a reset after a fault lets time run
        self._stopped_at = self._loop.simulated_time if wanted == STOPPED else None
        return told(response)

    async def step_simulation(self, request: Any, response: Any) -> Any:
        """Compute a number of frames while paused, as fast as possible."""
        if request.steps < 1:
            return told(response, FAILED, "0 steps given; allowed: 1 or more")
        taken, message = await self._services.step(int(request.steps))
        return told(response) if taken else told(response, FAILED, message)

    async def simulate_steps(self, goal: Any, result: Any, feedback: Any) -> Any:
        """Compute a number of frames as an action, with feedback and possible cancellation after each frame."""
        steps = int(goal.request.steps)

        def on_frame(taken: int) -> bool:
            feedback.completed_steps, feedback.remaining_steps = taken, steps - taken
            goal.publish_feedback(feedback)
            return not goal.is_cancel_requested

        finished, message = (False, "0 steps given; allowed: 1 or more")
        if steps > 0:
            finished, message = await self._services.step(steps, on_frame)
        if finished:
            goal.succeed()
            return told(result)
        if goal.is_cancel_requested:
            goal.canceled()
            return told(result, FAILED, f"cancelled: {message}")
        goal.abort()
        return told(result, FAILED, message)

    def reset_simulation(self, request: Any, response: Any) -> Any:
        """Reset the state; time runs on, and nothing was spawned."""
        if request.scope != SCOPE_STATE:
            given = f"scope {request.scope} given; allowed: {SCOPE_STATE} (SCOPE_STATE), for time never goes back"
            return told(response, UNSUPPORTED, given)
        fault = self._reset()
        return told(response, FAILED, fault) if fault else told(response)

    async def get_entities(self, request: Any, response: Any) -> Any:
        """Report the names of bodies that match the filters."""
        response.entities, fault = await self._fitting(request.filters)
        return told(response, *fault) if fault else told(response)

    def get_entity_state(self, request: Any, response: Any) -> Any:
        """Report pose and twist of a body."""
        if request.entity not in self._rows:
            known = ", ".join([*self._rows][:8])
            return told(response, NOT_FOUND, f"'{printable(request.entity)}' given; known: {known}")
        response.state = self._entity_state(request.entity)
        return told(response)

    async def get_entities_states(self, request: Any, response: Any) -> Any:
        """Report the names and states of bodies that match the filters."""
        response.entities, fault = await self._fitting(request.filters)
        response.states = [self._entity_state(name) for name in response.entities]
        return told(response, *fault) if fault else told(response)

    @property
    def _state(self) -> int:
        if self._loading.busy:
            return LOADING_WORLD
        if not self._loop.paused:
            return PLAYING
        return STOPPED if self._stopped_at == self._loop.simulated_time else PAUSED

    def _reset(self) -> str:
        """Reset the state; returns the reason of a refusal, empty otherwise."""
        try:
            self._loop.submit(Command("reset", {}), "service").result(SERVICE_TIMEOUT)
        except (CommandError, FutureTimeoutError, CancelledError) as error:
            return str(error) or f"no frame boundary within {SERVICE_TIMEOUT:g} s; it is done at the next one"
        return ""

    async def _fitting(self, filters: Any) -> tuple[list[str], tuple[int, str] | None]:
        """Names that match the filters, or result code and message of an unsupported filter."""
        if filters.categories or filters.tags.tags or filters.bounds.points:
            return [], (UNSUPPORTED, "categories, tags, bounds are not known; allowed: a regular expression of names")
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
    """Name of the service of a type, such as get_entities of GetEntities."""
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
    from rclpy.action import ActionServer, CancelResponse  # noqa: PLC0415 - tests of the answers need no rclpy
    from rclpy.callback_groups import ReentrantCallbackGroup  # noqa: PLC0415

    kinds = import_module(f"{PACKAGE}.srv")
    own = SimulationServices(
        simulation, loop, clock, services, loading, reader, import_module(f"{PACKAGE}.msg"), frames
    )
    group = ReentrantCallbackGroup()
    for kind, handler in own.handlers.items():
        node.create_service(getattr(kinds, kind), f"~/{service_name(kind)}", handler, callback_group=group)
    action = import_module(f"{PACKAGE}.action").SimulateSteps

    async def simulate_steps(goal: Any) -> Any:  # rclpy awaits functions that are seen to be coroutines alone
        return await own.simulate_steps(goal, action.Result(), action.Feedback())

    return ActionServer(
        node,
        action,
        "~/simulate_steps",
        simulate_steps,
        cancel_callback=lambda _: CancelResponse.ACCEPT,
        callback_group=group,
    )


__all__ = ["FEATURES", "SimulationServices", "offer_simulation_services", "service_name"]
