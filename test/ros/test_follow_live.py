"""`sim --follow` beside a real plant: estimates, a plant that is killed and comes back, a log that replays."""

from __future__ import annotations

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from ros_participant import Participant
from sensor_msgs.msg import JointState
from twin_process import COMPILING, TwinProcess, allocate_domain, environment, release_domain, run_python

from cable_twin.recording.log_reader import read_log

PAYLOAD = "carriages.cabin.payload.mass"
TRUTH = 4200.0  # kg
COARSE = ["--set", "cable.elements={target: 20.0, at_towers: 6.0, growth: 1.7}"]  # for speed


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


def plant(directory, domain, started):
    """Plant with another payload, as a process of its own."""
    options = [*COARSE, "--set", f"{PAYLOAD}={TRUTH}"]
    variables = environment(directory, domain)  # not forked, as it becomes another process
    started.append(
        TwinProcess(directory, "aerial_tramway", *options, module="offline.plant", domain=domain, variables=variables)
    )
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


def payload(participant):
    """Estimate of the payload and its standard deviation in the newest message, kg."""
    status = next(one for one in participant.received["estimate"][-1].status if one.name == "cabin/payload")
    values = {one.key: one.value for one in status.values}
    return float(values["value"]), float(values["standard_deviation"])


@pytest.mark.long
def test_a_plant_is_followed_through_its_end_and_from_its_next_start(tmp_path, domain, started):
    """The twin says when it goes on alone; its log has what the plant said, and replays to the last bit."""
    (tmp_path / "plant").mkdir()
    first = plant(tmp_path / "plant", domain, started)
    options = [*COARSE, "--follow", "--outlook=false", "--rerun=none"]
    variables = environment(tmp_path, domain)
    twin = TwinProcess(tmp_path, "aerial_tramway", *options, domain=domain, variables=variables)
    started.append(twin)
    participant = Participant(domain)
    participant.subscribe("/diagnostics", DiagnosticArray)
    participant.subscribe("estimate", DiagnosticArray)
    participant.subscribe("/plant/joint_states", JointState)
    commands = participant.node.create_publisher(JointState, "/plant/joint_commands", 10)
    participant.until(lambda: participant.received["/plant/joint_states"], COMPILING, "a plant")
    participant.until(lambda: following(participant) == "follows", COMPILING, "a twin that follows")
    timer = participant.node.create_timer(0.1, lambda: commands.publish(JointState(name=["cabin"], velocity=[5.0])))
    participant.until(lambda: payload(participant)[1] < 150.0, COMPILING, "a narrow band")
    value, deviation = payload(participant)
    assert abs(value - TRUTH) < 4.0 * deviation
    first.kill()
    participant.until(lambda: following(participant) == "goes on by its model", COMPILING, "a twin alone")
    seen = len(participant.received["estimate"])
    participant.until(lambda: len(participant.received["estimate"]) > seen, COMPILING, "estimates by the model")
    participant.node.destroy_timer(timer)
    second = plant(tmp_path / "plant", domain, started)
    participant.until(lambda: following(participant) == "follows", COMPILING, "a twin that follows again")
    participant.close()
    second.kill()
    assert twin.end() == 0, twin.output
    assert "nothing from the plant since" in twin.output
    assert "the twin follows again" in twin.output
    log = twin.run_directory
    recorded = [topic for topic, _, _ in read_log(log).messages(["/plant/joint_states", "estimate"])]
    assert {*recorded} == {"/plant/joint_states", "estimate"}
    replayed = run_python("-m", "cable_twin.offline.replay", log, directory=tmp_path)
    assert replayed.returncode == 0, replayed.stdout + replayed.stderr
