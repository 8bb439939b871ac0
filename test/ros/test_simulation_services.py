"""simulation_interfaces: answers with message classes made of its definitions, which has no wheel.

The classes are those of rosbags, of the text in simulation_interfaces.txt: fields, types and constants are held to the
definitions by serializing each answer; only rclpy's own services are not among it.
"""

from __future__ import annotations

import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.base import Nodetype
from twin_process import PATIENCE, wait_until

pytest.importorskip("rclpy")
import rclpy

from cable_twin.ros.frame_loop import FrameLoop
from cable_twin.ros.run_clock import RunClock
from cable_twin.ros.services import Services
from cable_twin.ros.simulation_services import FEATURES, SimulationServices
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation

DEFINITIONS = Path(__file__).with_name("simulation_interfaces.txt")
PACKAGE = "simulation_interfaces"


def typestore():
    """Types of the definitions; a service is two messages."""
    store = get_typestore(Stores.ROS2_JAZZY)
    found = {}
    for part in re.split(r"^=== ", DEFINITIONS.read_text(encoding="utf-8"), flags=re.MULTILINE)[1:]:
        (kind, name), text = part.split("\n", 1)[0].split("/"), part.split("\n", 1)[1]
        text = re.sub(
            r"^(uint64 steps) 1$", r"\1", text, flags=re.MULTILINE
        )  # a default, which rosbags has no place for
        parts = re.split(r"^---$", text, flags=re.MULTILINE) if kind == "srv" else [text]
        for suffix, body in zip(("_Request", "_Response") if kind == "srv" else ("",), parts, strict=True):
            found |= get_types_from_msg(body, f"{PACKAGE}/msg/{name}{suffix}")
    store.register(found)
    return store


STORE = typestore()


def make(name):
    """A message with defaults, as rclpy makes one: mutable, whatever is in it too."""
    message_type = name if "/" in name else f"{PACKAGE}/msg/{name}"
    values = {}
    for field, (node, details) in STORE.fielddefs[message_type][1]:
        if node == Nodetype.NAME:
            values[field] = make(details)
        elif node == Nodetype.BASE:
            values[field] = {"string": "", "bool": False}.get(details[0], 0)
        else:
            values[field] = []
    return _Mutable(message_type, values)


class _Mutable(SimpleNamespace):
    """Fields of a type, which no other can be set of."""

    def __init__(self, message_type, values):
        super().__init__(**values)
        self.__dict__["_type"] = message_type

    def __setattr__(self, name, value):
        assert name in self.__dict__, f"{self._type} has no field {name}"
        super().__setattr__(name, value)


def frozen(message):
    """The dataclass of rosbags, which serializes."""
    if isinstance(message, _Mutable):
        values = {}
        for name, (node, details) in STORE.fielddefs[message._type][1]:
            value = frozen(getattr(message, name))
            numbers = node in (Nodetype.SEQUENCE, Nodetype.ARRAY) and details[0][0] == Nodetype.BASE
            if numbers and details[0][1][0] not in ("string",):
                value = np.array(value, dtype=details[0][1][0])
            values[name] = value
        return STORE.types[message._type](**values)
    return [frozen(one) for one in message] if isinstance(message, list) else message


@pytest.fixture(scope="module")
def twin():
    """The answers of a paused loop, and its parts."""
    simulation = Simulation(load_scenario("single_span", {"cable.elements": 10}))
    loop = FrameLoop(
        simulation,
        frame_steps=2,
        real_time_factor=1.0,
        command_timeout=0.5,
        on_run=lambda first: None,
        prepare=lambda snapshot: snapshot,
        publish=lambda frame: None,
        before_command=lambda: None,
        on_applied=lambda applied: None,
        on_fault=lambda line: None,
        paused=True,
    )
    clock = RunClock()
    clock.begin(0.0)
    context = rclpy.Context()
    rclpy.init(context=context)
    node = rclpy.create_node("services", context=context)
    services = Services(loop, Path, lambda: 1)
    services.offer(node)
    kinds = SimpleNamespace(**{name: lambda name=name: make(name) for name in ("EntityState", "WorldResource")})
    loop.start()
    yield SimpleNamespace(
        answers=SimulationServices(simulation, loop, clock, services, kinds), loop=loop, simulation=simulation
    )
    loop.stop()
    services.close()
    node.destroy_node()
    context.try_shutdown()


@pytest.fixture
def call(twin):
    """Call a service by its name and fields; the answer is one that can be serialized."""

    def calling(service, **fields):
        request, response = make(f"{service}_Request"), make(f"{service}_Response")
        for name, value in fields.items():
            target, *rest = name.split("__")
            if rest:
                setattr(getattr(request, target), rest[0], value)
            else:
                setattr(request, target, value)
        answer = twin.answers.handlers[service](request, response)
        if hasattr(answer, "send"):  # a coroutine, as the executor drives it
            coroutine, answers = answer, []

            def done():
                try:
                    coroutine.send(None)
                except StopIteration as end:
                    answers.append(end.value)
                return answers

            (answer,) = wait_until(done, PATIENCE)
        assert STORE.serialize_cdr(frozen(answer), answer._type)
        return answer

    return calling


def test_features_are_those_of_the_definitions(call):
    answer = call("GetSimulatorFeatures")
    constants = STORE.types[f"{PACKAGE}/msg/SimulatorFeatures"]
    assert {name: getattr(constants, name) for name in FEATURES} == FEATURES
    assert answer.features.features == [*FEATURES.values()]


def test_it_steps_plays_pauses_and_stops(twin, call):
    twin.loop.pause(True)
    before = twin.loop.simulated_time
    answer = call("StepSimulation", steps=250)
    assert answer.result.result == 1, answer.result.error_message
    assert twin.loop.simulated_time == pytest.approx(before + 2.5)
    assert call("StepSimulation", steps=0).result.result == 4
    assert call("GetSimulationState").state.state == 2
    assert call("SetSimulationState", state__state=2).result.result == 101
    assert call("SetSimulationState", state__state=1).result.result == 1
    assert call("GetSimulationState").state.state == 1
    refused = call("StepSimulation", steps=1).result
    assert (refused.result, refused.error_message) == (4, "not paused: call ~/pause with true first")
    assert call("SetSimulationState", state__state=0).result.result == 1
    assert call("GetSimulationState").state.state == 0
    assert call("SetSimulationState", state__state=3).result.result == 0
    assert call("SetSimulationState", state__state=2).result.result == 103
    assert call("StepSimulation", steps=1).result.result == 1
    assert call("GetSimulationState").state.state == 2  # at the start no more


def test_a_reset_is_of_the_state_alone(twin, call):
    twin.loop.pause(True)
    call("StepSimulation", steps=10)
    time = twin.loop.simulated_time
    for scope in (0, 1, 4, 255):
        refused = call("ResetSimulation", scope=scope).result
        assert refused.result == 0
        assert "allowed: 2 (SCOPE_STATE), for time never goes back" in refused.error_message
    assert call("ResetSimulation", scope=2).result.result == 1
    assert twin.loop.simulated_time == time
    assert twin.simulation.snapshot.carriages["cabin"].arc_length == 60.0


def test_entities_are_the_bodies(twin, call):
    names = ["cabin/running_carriage", "cabin/hanger", "cabin/cabin"]
    assert call("GetEntities").entities == names
    assert call("GetEntities", filters__filter="hang|runn").entities == names[:2]
    assert call("GetEntities", filters__filter="(").result.result == 4
    assert call("GetEntities", filters__categories=[make("EntityCategory")]).result.result == 0
    answer = call("GetEntitiesStates", filters__filter="cabin$")
    state = answer.states[0]
    body = twin.simulation.snapshot.carriages["cabin"].bodies["cabin"]
    assert (answer.entities, state.header.frame_id) == (["cabin/cabin"], "map")
    assert [state.pose.position.x, state.pose.position.z] == [body.x, body.z]
    assert state.pose.orientation.w == body.orientation[3]
    assert call("GetEntityState", entity="cabin/cabin").state == state
    missing = call("GetEntityState", entity="bus").result
    assert (missing.result, missing.error_message[:20]) == (2, "'bus' given; known: ")


def test_worlds_are_the_scenarios(twin, call):
    worlds = {world.name: world for world in call("GetAvailableWorlds").worlds}
    assert "gondola" in worlds
    path = worlds["single_span"].world_resource.uri.removeprefix("file://")
    assert load_scenario(path).cable == load_scenario("single_span").cable
    assert call("GetAvailableWorlds", additional_sources=["/tmp"]).result.result == 0
    current = call("GetCurrentWorld").world
    assert current.name == "single_span"
    assert "unstrained_length" in current.world_resource.resource_string
