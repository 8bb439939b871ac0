"""Services of simulation_interfaces, with message classes from its definitions, as it has no wheel.

The classes are those of rosbags, of the text in simulation_interfaces.txt: fields, types and constants are held to the
definitions by serializing each answer; only rclpy's own services and actions are not among it: the goal of an action
is a double here, with the methods that rclpy's has.
"""

from __future__ import annotations

import inspect
import json
import re
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from frame_loops import frame_loop
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.base import Nodetype
from twin_process import PATIENCE, wait_until

pytest.importorskip("rclpy")
import rclpy

from cable_twin.messages import FrameNames
from cable_twin.ros.services import Services, SnapshotWriter
from cable_twin.ros.simulation_services import FEATURES, SimulationServices, WorldLoading, service_name
from cable_twin.runtime.run_clock import RunClock
from cable_twin.runtime.scenario_reading import ScenarioReader
from cable_twin.scenario import load_scenario

DEFINITIONS = Path(__file__).with_name("simulation_interfaces.txt")
PACKAGE = "simulation_interfaces"
SUFFIXES = {"msg": ("",), "srv": ("_Request", "_Response"), "action": ("_Goal", "_Result", "_Feedback")}


def typestore():
    """Types of the definitions; a service has two messages."""
    store = get_typestore(Stores.ROS2_JAZZY)
    found = {}
    for part in re.split(r"^=== ", DEFINITIONS.read_text(encoding="utf-8"), flags=re.MULTILINE)[1:]:
        (kind, name), text = part.split("\n", 1)[0].split("/"), part.split("\n", 1)[1]
        text = re.sub(
            r"^(uint64 steps) 1$", r"\1", text, flags=re.MULTILINE
        )  # a default, which rosbags has no place for
        parts = [text] if kind == "msg" else re.split(r"^---$", text, flags=re.MULTILINE)
        for suffix, body in zip(SUFFIXES[kind], parts, strict=True):
            found |= get_types_from_msg(body, f"{PACKAGE}/msg/{name}{suffix}")
    store.register(found)
    return store


STORE = typestore()


def make(name):
    """Message with defaults, mutable at all depths like those of rclpy."""
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
    """Message of a type, without fields that the type lacks."""

    def __init__(self, message_type, values):
        super().__init__(**values)
        self.__dict__["_type"] = message_type

    def __setattr__(self, name, value):
        assert name in self.__dict__, f"{self._type} has no field {name}"
        super().__setattr__(name, value)


def frozen(message):
    """Dataclass of rosbags for a message, to be serialized."""
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
    """Service handlers of a paused loop, and their parts."""
    loop = frame_loop("single_span", paused=True)
    simulation = loop._simulation
    clock = RunClock()
    clock.begin(0.0)
    context = rclpy.Context()
    rclpy.init(context=context)
    node = rclpy.create_node("services", context=context)
    services = Services(node, loop, SnapshotWriter(Path, 0.0), lambda: 1)
    kinds = SimpleNamespace(**{name: lambda name=name: make(name) for name in ("EntityState", "WorldResource")})
    loop.start()
    loading = WorldLoading(node, loop, lambda simulation: None, "single_span")
    reader = ScenarioReader([], "single_span")
    answers = SimulationServices(simulation, loop, clock, services, loading, reader, kinds, FrameNames())
    yield SimpleNamespace(answers=answers, loop=loop, simulation=simulation, loading=loading)
    loop.stop()
    services.close()
    node.destroy_node()
    context.try_shutdown()


def driven(answer):
    """Result of a coroutine, driven as by the executor."""
    if not hasattr(answer, "send"):
        return answer
    answers = []

    def done():
        try:
            answer.send(None)
        except StopIteration as end:
            answers.append(end.value)
        return answers

    return wait_until(done, PATIENCE)[0]


class Goal:
    """Goal of rclpy's action server, with its feedback and end."""

    def __init__(self, steps, cancel_after=None):
        self.request = make(f"{PACKAGE}/msg/SimulateSteps_Goal")
        self.request.steps = steps
        self.told, self.ends, self._cancel_after = [], [], cancel_after

    def publish_feedback(self, feedback):
        assert STORE.serialize_cdr(frozen(feedback), feedback._type)
        self.told.append((feedback.completed_steps, feedback.remaining_steps))

    @property
    def is_cancel_requested(self):
        return len(self.told) == self._cancel_after

    def succeed(self):
        self.ends.append("succeeded")

    def abort(self):
        self.ends.append("aborted")

    def canceled(self):
        self.ends.append("cancelled")


@pytest.fixture
def act(twin):
    """Simulate steps as an action; returns the goal, and the result as code and message."""

    def acting(*arguments, **options):
        goal = Goal(*arguments, **options)
        result, feedback = make("SimulateSteps_Result"), make("SimulateSteps_Feedback")
        answer = driven(twin.answers.simulate_steps(goal, result, feedback)).result
        return goal, answer.result, answer.error_message

    return acting


@pytest.fixture
def call(twin):
    """Call a service by name and fields; checks that the response can be serialized."""

    def calling(service, **fields):
        request, response = make(f"{service}_Request"), make(f"{service}_Response")
        for name, value in fields.items():
            target, *rest = name.split("__")
            if rest:
                setattr(getattr(request, target), rest[0], value)
            else:
                setattr(request, target, value)
        answer = driven(getattr(twin.answers, service_name(service))(request, response))
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
    assert (refused.result, refused.error_message) == (
        4,
        "not paused: call ~/pause with true first, as drive --pause does",
    )
    assert call("SetSimulationState", state__state=0).result.result == 1
    assert call("GetSimulationState").state.state == 0
    assert call("SetSimulationState", state__state=3).result.result == 0
    assert call("SetSimulationState", state__state=2).result.result == 103
    assert call("StepSimulation", steps=1).result.result == 1
    assert call("GetSimulationState").state.state == 2  # at the start no more


def test_steps_as_an_action_tell_each_frame_and_can_be_cancelled(twin, call, act):
    twin.loop.pause(True)
    before = twin.loop.simulated_time
    goal, result, _ = act(5)
    assert (result, goal.ends) == (1, ["succeeded"])
    assert goal.told == [(1, 4), (2, 3), (3, 2), (4, 1), (5, 0)]
    assert twin.loop.simulated_time == pytest.approx(before + 0.05)
    goal, result, message = act(1000, cancel_after=3)
    assert (result, message, goal.ends) == (4, "cancelled: paused after 3 of 1000 frames", ["cancelled"])
    assert twin.loop.simulated_time == pytest.approx(before + 0.08)
    goal, result, message = act(0)
    assert (result, message, goal.ends) == (4, "steps: given 0; allowed: 1 or more", ["aborted"])
    call("SetSimulationState", state__state=1)
    goal, result, message = act(1)
    assert (result, message, goal.ends) == (
        4,
        "not paused: call ~/pause with true first, as drive --pause does",
        ["aborted"],
    )
    twin.loop.pause(True)


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
    assert (missing.result, missing.error_message[:30]) == (2, "entity: given 'bus'; allowed: ")


def test_an_expression_that_takes_hours_is_given_up_while_others_are_answered(twin, call):
    filters = SimpleNamespace(
        filter=r"^(.|\S|[a-z/_])*[0-9]$",
        categories=[],
        tags=SimpleNamespace(tags=[]),
        bounds=SimpleNamespace(points=[]),
    )
    waiting = twin.answers.get_entities(SimpleNamespace(filters=filters), make("GetEntities_Response"))
    waiting.send(None)
    assert call("GetEntities", filters__filter="hang").entities == ["cabin/hanger"]
    result = driven(waiting).result
    assert (result.result, "more than 2 s; allowed: a regular" in result.error_message) == (4, True)
    long = call("GetEntities", filters__filter="(" * 5000).result
    assert (long.result, long.error_message[:31]) == (4, "filter: given 5000 characters; ")


def test_worlds_are_the_scenarios(twin, call):
    worlds = {world.name: world for world in call("GetAvailableWorlds").worlds}
    assert "gondola" in worlds
    path = worlds["single_span"].world_resource.uri.removeprefix("file://")
    assert load_scenario(path).cable == load_scenario("single_span").cable
    assert call("GetAvailableWorlds", additional_sources=["/tmp"]).result.result == 0
    current = call("GetCurrentWorld").world
    assert current.name == "single_span"
    assert "unstrained_length" in current.world_resource.resource_string


@pytest.mark.parametrize(
    ("resource", "result", "message"),
    [
        ({}, 102, "world: given nothing; allowed: uri, or YAML as resource_string"),
        ({"uri": "https://example.org/a.yaml"}, 101, "uri: given 'https://example.org/a.yaml'; allowed: file:///PATH"),
        (
            {"uri": "file:///nowhere/a%20b.yaml"},
            2,
            "/nowhere/a b.yaml: not a scenario; allowed: the name of one, or a .yaml ",
        ),
        ({"uri": "nothing"}, 2, "scenario: given 'nothing', which is neither a scenario nor a file; allowed: aerial_"),
        ({"resource_string": "cable: 1"}, 103, "text: "),
        ({"resource_string": "a: b: c"}, 103, "text:1: not YAML"),
    ],
)
def test_a_world_that_cannot_be_read_leaves_the_one_that_runs(twin, call, resource, result, message):
    given = {f"world_resource__{name}": value for name, value in resource.items()}
    answer = call("LoadWorld", **given).result
    assert (answer.result, answer.error_message[: len(message)]) == (result, message)
    assert not twin.loading.busy


def test_a_world_is_built_before_the_one_that_runs_ends(twin, call):
    twin.loop.pause(False)
    colliding = load_scenario("single_span", {"cable.elements": 10}).resolved()
    colliding["carriages"]["second"] = colliding["carriages"]["cabin"]
    answer = call("LoadWorld", world_resource__resource_string=json.dumps(colliding)).result
    assert answer.result == 4
    assert "given 60 m, too near to 'cabin' at 60 m" in answer.error_message
    assert (twin.loop.paused, twin.loading.busy) == (False, False)  # it goes on as it was
    asked = []
    answer = make("LoadWorld_Response")
    resource = SimpleNamespace(uri="seed_example", resource_string="")
    coroutine = twin.answers.load_world(SimpleNamespace(world_resource=resource), answer)
    with suppress(StopIteration):  # on a busy machine all of it may be done between two looks
        while not twin.loading.busy:
            coroutine.send(None)  # it waits for the scenario to be read, beside what runs
    if twin.loading.loaded is None:
        asked.append(call("GetSimulationState").state.state)
    if inspect.getcoroutinestate(coroutine) != inspect.CORO_CLOSED:
        answer = driven(coroutine)
    assert asked in ([], [5])
    assert (answer.result.result, answer.world.name) == (1, "seed_example")
    assert (twin.loading.loaded.scenario.name, twin.loading.source) == ("seed_example", "seed_example")
    assert twin.loading.paused
    assert call("LoadWorld", world_resource__uri="gondola").result.result == 3
    assert call("SetSimulationState", state__state=1).result.result == 3
    assert call("GetSimulationState").state.state == 5
