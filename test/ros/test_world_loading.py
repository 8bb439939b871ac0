"""Another scenario loaded into a running twin: new logs; a scenario that fails leaves the twin unchanged."""

from __future__ import annotations

import json
import os

import pytest
from twin_process import COMPILING, PATIENCE, TwinProcess, run_module, write_quick_scenario

from cable_twin.scenario import load_scenario

pytest.importorskip("rclpy")
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.qos import DurabilityPolicy, QoSProfile
from ros_participant import Participant
from std_msgs.msg import String
from std_srvs.srv import SetBool

SCENARIO = "another.yaml"


def test_it_begins_anew_with_logs_of_its_own(processes, participants, tmp_path):
    first = write_quick_scenario(tmp_path)
    content = load_scenario(first).resolved()
    content["name"] = "other"
    content["cable"]["elements"] = 10
    (tmp_path / SCENARIO).write_text(json.dumps(content))
    content["carriages"]["second"] = content["carriages"]["cabin"]
    (tmp_path / "colliding.yaml").write_text(json.dumps(content))
    sim = processes("--scenario", str(first), "--rerun", "none")
    participant = participants(sim.domain)
    participant.subscribe_standard()
    scenarios = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    participant.subscribe("scenario", String, scenarios)

    def set_parameter(name, value):
        given = Parameter(name, value=value).to_parameter_msg()
        (result,) = participant.call("set_parameters", SetParameters, parameters=[given]).results
        return result.successful, result.reason

    def parameter(name):
        return parameter_value_to_python(participant.call("get_parameters", GetParameters, names=[name]).values[0])

    assert set_parameter("scenario", str(first)) == (True, "")  # as it is: nothing happens
    assert set_parameter("frame_rate", 100.0) == (True, "")  # the same of what is read-only
    assert not set_parameter("frame_rate", 50.0)[0]
    taken, reason = set_parameter("scenario", "nothing")
    assert (taken, reason[:35]) == (False, "scenario: given 'nothing', which is")
    assert set_parameter("command_timeout", 0.7) == (True, "")
    assert set_parameter("scenario", str(tmp_path / "colliding.yaml")) == (True, "")  # whose fault only shows at rest
    sim.wait_for("'other' is not loaded: ")
    participant.until(lambda: parameter("scenario") == str(first), what="the parameter put back")
    count = len(participant.received["joint_states"])
    participant.until(lambda: len(participant.received["joint_states"]) > count + 20, what="frames that go on")

    told = processes("--load", SCENARIO, module="ros.client.drive", domain=sim.domain)
    participant.until(lambda: told.process.poll() is not None, what="the end of drive")
    assert told.output.strip() == f"/cable_twin: loads {tmp_path / SCENARIO} and starts it from the beginning"
    participant.until(lambda: len(participant.received["scenario"]) == 2, COMPILING, "the other scenario")
    assert json.loads(participant.received["scenario"][1].data)["cable"]["elements"] == 10
    assert parameter("scenario") == str(tmp_path / SCENARIO)
    assert parameter("command_timeout") == 0.7  # what was set stays
    count = len(participant.received["joint_states"])
    participant.until(lambda: len(participant.received["joint_states"]) > count + 20, what="frames of the other one")
    assert participant.call("pause", SetBool, data=True).success
    assert sim.end() == 0
    assert "Traceback" not in sim.output
    assert sim.output.count("log closed: ") == 2
    runs = sorted((tmp_path / "cable_twin_logs").iterdir())
    assert len(runs) == 2
    for run in runs:
        replayed = run_module("offline.replay", str(run), directory=tmp_path)
        assert (replayed.returncode, replayed.stdout.splitlines()[-1]) == (0, "every sample agrees to the last bit")


def set_scenario(participant, name):
    given = Parameter("scenario", value=str(name)).to_parameter_msg()
    (result,) = participant.call("set_parameters", SetParameters, parameters=[given]).results
    return result.successful, result.reason


FAULTY = {  # scenario, and what is changed in it
    "leaving": ("chairlift", "carriers.payload.leaving", -300),
    "thick": ("single_span", "cable.diameter", 1e200),
    "unknown": ("single_span", "what\x1b[31m", 1),
    "long_name": (
        "single_span",
        "carriages",
        {"a" * 250: load_scenario("single_span").resolved()["carriages"]["cabin"]},
    ),
}


@pytest.fixture(scope="module")
def live(tmp_path_factory):
    """Twin, participant, an allowed directory for scenarios and a forbidden one."""
    directory, elsewhere = tmp_path_factory.mktemp("allowed"), tmp_path_factory.mktemp("elsewhere")
    started = tmp_path_factory.mktemp("start")
    scenario = str(write_quick_scenario(started))
    process = TwinProcess(started, scenario, "--record", "false", "--scenario-directories", str(directory))
    participant = Participant(process.domain)
    participant.subscribe_standard()
    yield process, participant, directory, elsewhere
    participant.close()
    process.kill()


@pytest.mark.parametrize("name", FAULTY)
def test_a_faulty_scenario_is_refused_and_the_twin_runs_on(live, name):
    process, participant, directory, _ = live
    scenario, key, value = FAULTY[name]
    content = load_scenario(scenario).resolved() | {"name": name}
    *sections, last = key.split(".")
    section = content
    for one in sections:
        section = section[one]
    section[last] = value
    file = directory / f"{name}.yaml"
    file.write_text(json.dumps(content))
    taken, reason = set_scenario(participant, file)
    if taken:  # its fault only shows where it is built
        process.wait_for(f"'{name}' is not loaded: ", PATIENCE)
    else:
        assert all(line.isprintable() for line in reason.split("\n")), reason
        assert reason.startswith(f"{file}: ")
    check_running(live)


def check_running(live):
    process, participant, *_ = live
    count = len(participant.received["joint_states"])
    participant.until(lambda: len(participant.received["joint_states"]) > count + 20, what="frames that go on")
    assert "Traceback" not in process.output
    assert "\x1b[31m" not in process.output


def test_what_is_no_file_is_refused_at_once(live):
    _, participant, directory, _ = live
    os.mkfifo(directory / "pipe.yaml")
    (directory / "endless.yaml").symlink_to("/dev/zero")
    (directory / "directory.yaml").mkdir()
    for name in ("pipe.yaml", "endless.yaml", "directory.yaml", "missing.yaml"):
        given = Parameter("scenario", value=str(directory / name)).to_parameter_msg()
        client = participant.node.create_client(SetParameters, "/cable_twin/set_parameters")
        participant.until(client.service_is_ready)
        asked = client.call_async(SetParameters.Request(parameters=[given]))
        assert participant.call("emergency_stop", SetBool, data=False).success
        (result,) = participant.until(asked.result, what=f"the answer for {name}").results
        assert not result.successful
        assert ("no such file" in result.reason) != (name == "endless.yaml")
    check_running(live)


def test_nothing_is_told_of_files_elsewhere(live):
    process, participant, directory, elsewhere = live
    secret = "password: hunter2\n"
    for name in ("secret.yaml", "secret.txt"):
        (elsewhere / name).write_text(secret)
        (process.directory / name).write_text(secret)
        (directory / name).write_text(secret)
    (directory / "link.yaml").symlink_to(elsewhere / "secret.yaml")
    outside = [elsewhere / "secret.yaml", elsewhere / "missing.yaml", directory / "link.yaml", directory / "secret.txt"]
    for path in (*outside, directory / ".." / elsewhere.name / "secret.yaml", "/etc/passwd", "~/.netrc"):
        taken, reason = set_scenario(participant, path)
        assert not taken
        assert reason.startswith(f"{path}: not a scenario; allowed: the name of one, or a .yaml file below ")
    beside = process.directory / "secret.yaml"
    assert set_scenario(participant, beside) == (False, f"{beside}: not a scenario; `simulate {beside}` says why")
    assert "password" in set_scenario(participant, directory / "secret.yaml")[1]
    assert "hunter2" not in process.output


def test_ctrl_c_ends_it_while_a_scenario_is_read(live):
    process, participant, directory, _ = live
    content = load_scenario("chairlift").resolved()
    (directory / "large.yaml").write_text(json.dumps(content, indent=8) + " " * 500_000)
    given = Parameter("scenario", value=str(directory / "large.yaml")).to_parameter_msg()
    client = participant.node.create_client(SetParameters, "/cable_twin/set_parameters")
    participant.until(client.service_is_ready)
    client.call_async(SetParameters.Request(parameters=[given]))
    participant.spin(0.2)
    code = process.end()
    assert code == 0, process.output
