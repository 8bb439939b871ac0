"""`sim --follow` beside a real plant: estimates, a plant that is killed and comes back, a log that replays."""

from __future__ import annotations

import json
from typing import NamedTuple

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters
from ros_participant import Participant
from sensor_msgs.msg import JointState
from twin_process import COMPILING, TwinProcess, allocate_domain, environment, release_domain, run_module

from cable_twin.messages.sensor_messages import plant_names
from cable_twin.messages.texts import readmitted_from_message
from cable_twin.offline.plant import plant_of
from cable_twin.recording.log_reader import read_log

COARSE = ["--set", "cable.elements={target: 20.0, at_towers: 6.0, growth: 1.7}"]  # for speed


class Followed(NamedTuple):
    """Scenario that is followed, and what is estimated of its plant."""

    scenario: str
    both: list[str]  # options of plant and twin
    plant: list[str]  # further ones of the plant
    drive: str
    quantity: str
    truth: float
    narrow: float  # deviation that is waited for


TRAMWAY = Followed(
    "aerial_tramway", COARSE, ["--set", "carriages.cabin.payload.mass=4200"], "cabin", "cabin/payload", 4200.0, 150.0
)
LIFT = Followed("gondola", [], [], "haul_rope", "towers/friction", 1.0, 0.2)


@pytest.fixture
def domain():
    number = allocate_domain()
    yield number
    release_domain(number)


@pytest.fixture
def started():
    """Processes, which end with the test."""
    processes = []
    yield processes
    for one in processes:
        one.kill()


def plant(followed, directory, domain, started):
    """Plant as a process of its own."""
    options = [followed.scenario, *followed.both, *followed.plant]
    variables = environment(directory, domain)  # not forked, as it becomes another process
    started.append(TwinProcess(directory, *options, module="offline.plant", domain=domain, variables=variables))
    return started[-1]


def following(participant):
    """State of the task `following` in the newest diagnostics that have it."""
    found = [
        one
        for message in participant.received["/diagnostics"]
        for one in message.status
        if one.name.endswith("cable_twin: following")
    ]
    return found[-1].message


def estimate(participant, quantity):
    """Estimate of a quantity and its standard deviation in the newest message that has both."""
    if not participant.received["estimate"]:
        return 0.0, float("inf")
    status = next(one for one in participant.received["estimate"][-1].status if one.name == quantity)
    values = {one.key: one.value for one in status.values}
    return float(values["value"]), float(values["standard_deviation"])


@pytest.mark.long
@pytest.mark.parametrize("followed", [TRAMWAY, LIFT], ids=lambda one: one.scenario)
def test_a_plant_is_followed_through_its_end_and_from_its_next_start(followed, tmp_path, domain, started):
    """The twin says when it goes on alone; its log has what the plant said, and replays to the last bit."""
    (tmp_path / "plant").mkdir()
    first = plant(followed, tmp_path / "plant", domain, started)
    options = [*followed.both, "--follow", "--outlook=false", "--rerun=none"]
    variables = environment(tmp_path, domain)
    twin = TwinProcess(tmp_path, followed.scenario, *options, domain=domain, variables=variables)
    started.append(twin)
    participant = Participant(domain)
    participant.subscribe("/diagnostics", DiagnosticArray)
    participant.subscribe("estimate", DiagnosticArray)
    participant.subscribe("/plant/joint_states", JointState)
    commands = participant.node.create_publisher(JointState, "/plant/joint_commands", 10)
    participant.until(lambda: participant.received["/plant/joint_states"], COMPILING, "a plant")
    participant.until(lambda: following(participant) == "follows", COMPILING, "a twin that follows")
    command = JointState(name=[followed.drive], velocity=[5.0])
    timer = participant.node.create_timer(0.1, lambda: commands.publish(command))
    participant.until(lambda: estimate(participant, followed.quantity)[1] < followed.narrow, COMPILING, "a narrow band")
    value, deviation = estimate(participant, followed.quantity)
    assert abs(value - followed.truth) < 4.0 * deviation
    first.kill()
    participant.until(lambda: following(participant) == "goes on by its model", COMPILING, "a twin alone")
    seen = len(participant.received["estimate"])
    participant.until(lambda: len(participant.received["estimate"]) > seen, COMPILING, "estimates by the model")
    participant.node.destroy_timer(timer)
    second = plant(followed, tmp_path / "plant", domain, started)
    participant.until(lambda: following(participant) == "follows", COMPILING, "a twin that follows again")
    participant.close()
    second.kill()
    assert twin.end() == 0, twin.output
    assert "nothing from the plant since" in twin.output
    assert "the twin follows again" in twin.output
    log = twin.run_directory
    recorded = [topic for topic, _, _ in read_log(log).messages(["/plant/joint_states", "estimate"])]
    assert {*recorded} == {"/plant/joint_states", "estimate"}
    replayed = run_module("offline.replay", str(log), directory=tmp_path)
    assert replayed.returncode == 0, replayed.stdout + replayed.stderr


@pytest.mark.long
def test_a_twin_goes_on_where_the_encoder_of_its_lift_sticks(tmp_path, domain, started):
    """A twin that took the place of a stuck encoder for that of its plant would stop there."""
    (tmp_path / "plant").mkdir()
    scenario = plant_of("chairlift", {}).scenario
    sensors = json.dumps({name: one.model_dump(exclude_defaults=True) for name, one in scenario.sensors.items()})
    names = plant_names(scenario) | {"sensors/joint_states": "/measured/joint_states"}
    remapped = {"__node": "virtual_plant", "~/joint_commands": "/plant/joint_commands"}
    remapped |= {f"~/{own}": name for own, name in names.items()}
    rules = [part for own, name in remapped.items() for part in ("-r", f"{own}:={name}")]
    options = ["chairlift", "--set", f"sensors={sensors}", "--outlook=false", "--rerun=none", "--ros-args", *rules]
    variables = environment(tmp_path, domain)
    started.append(TwinProcess(tmp_path / "plant", *options, domain=domain, variables=variables))
    options = ["chairlift", "--follow", "--outlook=false", "--rerun=none"]
    started.append(TwinProcess(tmp_path, *options, domain=domain, variables=variables))
    participant = Participant(domain)
    participant.subscribe("/diagnostics", DiagnosticArray)
    participant.subscribe("joint_states", JointState)
    relay, places, sticks = participant.node.create_publisher(JointState, "/plant/joint_states", 50), [], []

    def pass_on(message):
        if message.position:  # of the encoder, not of the force
            places.append(message.position)
            message.position = places[sticks[0] if sticks else -1]
        relay.publish(message)

    participant.node.create_subscription(JointState, "/measured/joint_states", pass_on, 50)
    participant.until(lambda: following(participant) == "follows", COMPILING, "a twin that follows")
    commands = participant.node.create_publisher(JointState, "/plant/joint_commands", 10)
    command = JointState(name=["haul_rope"], velocity=[2.5])
    participant.node.create_timer(0.1, lambda: commands.publish(command))
    participant.until(lambda: participant.speed > 2.4, COMPILING, "a twin under way")
    sticks.append(len(places) - 1)
    participant.until(lambda: "left out: encoder_haul_rope" in following(participant), COMPILING, "an alarm")
    participant.until(lambda: participant.speed > 2.4, COMPILING, "a twin that goes on")
    place = participant.arc_length
    participant.until(lambda: participant.arc_length > place + 20.0, COMPILING, "a twin that still goes on")
    assert participant.speed > 2.4
    sticks.clear()
    value = ParameterValue(type=ParameterType.PARAMETER_STRING, string_value="encoder_haul_rope")
    for said in ("", "readmit: given 'encoder_haul_rope'; allowed: none, as no sensor is left out"):
        setting = [Parameter(name="readmit", value=value)]
        (result,) = participant.call("set_parameters", SetParameters, parameters=setting).results
        assert result.reason == said
        participant.until(lambda: following(participant) == "follows", COMPILING, "an encoder that counts again")
    participant.close()
    twin = started[-1]
    assert twin.end() == 0, twin.output
    recorded = [readmitted_from_message(data) for _, _, data in read_log(twin.run_directory).messages(["readmitted"])]
    assert recorded == ["encoder_haul_rope"]
