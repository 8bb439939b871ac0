"""Another scenario for a running twin: it ends its logs, and begins anew; what cannot be loaded leaves it as it was."""

from __future__ import annotations

import json

import pytest
from twin_process import COMPILING, run_module, write_quick_scenario

from cable_twin.scenario import load_scenario

pytest.importorskip("rclpy")
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.qos import DurabilityPolicy, QoSProfile
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

    told = processes("--load", SCENARIO, module="ros.drive", domain=sim.domain)
    participant.until(lambda: told.process.poll() is not None, what="the end of drive")
    assert told.output.strip() == f"/cable_twin: loads {tmp_path / SCENARIO}, and begins anew with it"
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
