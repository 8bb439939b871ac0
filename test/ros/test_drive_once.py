"""Single requests of `drive`: stops, pauses, steps, payload, wind, snapshots, list of twins."""

from __future__ import annotations

import re
import signal
from pathlib import Path

import pytest
from twin_process import COMPILING, allocate_domain, wait_until

pytest.importorskip("rclpy")
from ros_participant import Participant
from std_msgs.msg import String
from std_srvs.srv import SetBool, Trigger

from cable_twin.ros.node import SecondTwinError, check_single_instance

TIME = r"\d+\.\d{3} s of simulated time"
WHEN = rf"( at {TIME}|, from the next frame boundary on)"  # the latter where the machine is busy


@pytest.fixture
def twin(running):
    """Running twin at rest at its start."""
    _, participant = running
    assert participant.call("emergency_stop", SetBool, data=False).success
    assert participant.call("reset", Trigger).success
    assert participant.call("pause", SetBool, data=False).success
    return participant


@pytest.fixture
def drive(running, processes):
    """Run `drive` beside the twin; returns exit code and output."""

    def run(*arguments):
        process = processes(*arguments, module="ros.client.drive", domain=running[0].domain)
        participant = running[1]
        participant.until(lambda: process.process.poll() is not None, what=f"end of drive; {process.output}")
        return process.wait(), process.output.strip()

    return run


def test_it_stops_releases_and_resets(twin, drive):
    code, output = drive("--emergency-stop")
    assert code == 0
    assert re.fullmatch(rf"/cable_twin: emergency stop{WHEN}", output)
    assert twin.next_diagnostics()[2]["emergency_stop"] == "true"
    assert drive("--list") == (0, twin_line(twin, "emergency stop in force"))
    code, output = drive("--release")
    assert code == 0
    assert re.fullmatch(rf"/cable_twin: emergency stop released{WHEN}", output)
    code, output = drive("--release")
    assert code == 0
    assert re.fullmatch(rf"/cable_twin: no emergency stop was in force at {TIME}", output)
    code, output = drive("--reset")
    assert code == 0
    assert re.fullmatch(rf"/cable_twin: state put back to the start at {TIME}", output)
    assert twin.next_diagnostics()[2]["emergency_stop"] == "false"


class twin_line:  # noqa: N801 - stands for a text
    """Pattern of the twin's line in a list, at any time."""

    def __init__(self, twin: Participant, state: str) -> None:
        self.pattern = rf"{twin.twin}: quick, {state} at {TIME}; carriages: cabin \(up to 10 m/s, 150 kN\)"

    def __eq__(self, other: object) -> bool:
        return re.fullmatch(self.pattern, str(other)) is not None

    def __repr__(self) -> str:
        return self.pattern

    __hash__ = None


def test_it_pauses_steps_and_resumes(twin, drive):
    code, output = drive("--step", "2")
    assert (code, output) == (1, "drive: /cable_twin: not paused: call ~/pause with true first")
    code, output = drive("--pause")
    assert code == 0
    (paused_at,) = re.fullmatch(r"/cable_twin: paused at (\d+\.\d{3}) s of simulated time", output).groups()
    twin.next_diagnostics()
    assert drive("--list") == (0, twin_line(twin, "paused"))
    code, output = drive("--step", "5")
    assert code == 0
    (at,) = re.fullmatch(r"/cable_twin: 5 frames, to (.*) s of simulated time", output).groups()
    assert float(at) == pytest.approx(float(paused_at) + 0.05, abs=0.011)
    code, output = drive("--step", "2000000")
    assert (code, "step_count" in output) == (1, True)
    code, output = drive("--step", "1")
    assert re.fullmatch(rf"/cable_twin: one frame, to {TIME}", output)
    code, output = drive("--resume")
    assert code == 0
    assert re.fullmatch(rf"/cable_twin: running at {TIME}", output)
    assert twin.next_diagnostics()[2]["paused"] == "false"


def test_it_loads_and_blows_and_says_why_not(twin, drive):
    twin.received["applied_commands"].clear()
    assert drive("cabin", "--payload", "640") == (0, "/cable_twin: payload cabin 640 kg")
    assert drive("cabin", "--payload", "0") == (0, "/cable_twin: payload cabin 0 kg")
    assert drive("--wind", "12") == (0, "/cable_twin: wind x 12 m/s, z 0 m/s")
    assert drive("--wind", "-3", "0.5") == (0, "/cable_twin: wind x -3 m/s, z 0.5 m/s")
    assert drive("--temperature", "-5") == (0, "/cable_twin: temperature ropes -5 degC")
    twin.until(lambda: len(twin.applied) == 5, what="all five")
    applied = [(one.command.kind, one.source) for one in twin.applied]
    assert applied == [("payload", "payload")] * 2 + [("wind", "wind")] * 2 + [("temperature",) * 2]
    code, output = drive("cabin", "--payload", "1e6")
    assert (code, output) == (1, "drive: payload of 'cabin': given 1e+06 kg; allowed: 0 to 6400 kg")
    code, output = drive("gondola", "--payload", "1")
    assert (code, output) == (1, "drive: payload: given for carriage 'gondola'; allowed: cabin")
    code, output = drive("--wind", "200")
    assert (code, output) == (1, "drive: wind x: given 200 m/s; allowed: -100 to 100 m/s")


@pytest.mark.long
def test_a_wind_that_nothing_feels_is_refused(processes):
    sim = processes("--scenario", "seed_example", "--record", "false")
    sim.wait_for("runs at")
    asked = processes("--wind", "12", module="ros.client.drive", domain=sim.domain)
    assert asked.wait() == 1
    assert asked.output == (
        "drive: wind: given x 12, z 0 m/s: nothing feels the wind: no rope has a diameter (m) and no body a drag_area "
        "(m^2); allowed: 0 m/s\n"
    )


def test_it_saves_a_snapshot_and_prints_where(running, twin, drive):
    code, output = drive("--snapshot")
    assert code == 0
    (path,) = re.fullmatch(rf"/cable_twin: saved at {TIME}: (.*)", output).groups()
    assert Path(path).stat().st_size > 1000
    assert Path(path).is_relative_to(running[0].directory)


def test_without_a_twin_it_says_so(processes):
    missing = {
        ("--reset",): "no twin listens on /cable_twin/reset",
        ("--wind", "1"): "no twin listens on /cable_twin/wind",
        ("--list",): "no twin found",
    }
    started = [processes(*arguments, "--wait", "2", module="ros.client.drive") for arguments in missing]
    for process, said in zip(started, missing.values(), strict=True):
        assert process.wait() == 1
        assert process.output == f"drive: {said} after 2 s: is `sim` running, with the same ROS_DOMAIN_ID?\n"


@pytest.mark.parametrize("arguments", [["--list"], ["--wind", "1"]])
def test_ctrl_c_ends_the_waiting(processes, participants, arguments):
    process = processes(*arguments, "--wait", "60", module="ros.client.drive")
    participant = participants(process.domain)
    seen = participant.node.get_node_names
    participant.until(lambda: any("drive" in name for name in seen()), what="drive")
    process.send(signal.SIGINT)
    assert process.wait() == 130
    assert process.output == ""


@pytest.mark.parametrize("arguments", [["--emergency-stop", "--wait", "60"], ["--reset", "--wait", "1.5"]])
def test_where_only_other_twins_run_they_are_named(running, processes, arguments):
    """An emergency stop fails as soon as other twins are known, before the end of --wait."""
    twin = running[1]
    process = processes(
        *arguments, "--node", "/elsewhere/cable_twin", module="ros.client.drive", domain=running[0].domain
    )
    twin.until(lambda: process.process.poll() is not None, what="end of drive")
    assert process.wait() == 1
    said = re.fullmatch(r"drive: no twin listens on /elsewhere/cable_twin/\w+ after ([\d.]+) s; (.*)\n", process.output)
    assert said, process.output
    assert float(said[1]) < 20.0
    assert said[2] == "there is /cable_twin: drive --node /cable_twin ..."


def test_a_second_twin_of_one_name_is_refused_and_another_name_is_listed(running, twin, processes, drive):
    first = running[0]
    arguments = ["--scenario", str(first.directory / "quick.yaml"), "--record", "false"]
    second = processes(*arguments, domain=first.domain)
    assert second.wait(COMPILING) == 1
    assert second.output == (
        f"sim: a twin named /cable_twin runs already in ROS domain {first.domain}: give this one another name, "
        "as with --ros-args -r __ns:=/b, or allow both with --allow-second\n"
    )
    other = processes(*arguments, "--start-paused", "--ros-args", "-r", "__ns:=/b", domain=first.domain)
    other.wait_for("'quick' runs at 100 Hz")
    here = twin.node.get_node_names_and_namespaces
    twin.until(lambda: ("cable_twin", "/b") in here(), what="both")
    code, output = drive("--list")
    assert code == 0
    lines = output.splitlines()
    assert [line.partition(":")[0] for line in lines] == ["/b/cable_twin", "/cable_twin"]
    paused = "/b/cable_twin: quick, paused at 0.000 s of simulated time; carriages: cabin (up to 10 m/s, 150 kN)"
    assert lines[0] == paused
    code, output = drive("--node", "/b/cable_twin", "--step", "1")
    assert (code, output) == (0, "/b/cable_twin: one frame, to 0.010 s of simulated time")
    assert other.end() == 0
    allowed = processes(*arguments, "--allow-second", domain=first.domain)
    allowed.wait_for("'quick' runs at 100 Hz")
    wait_until(lambda: twin.node.count_publishers("/cable_twin/scenario") == 2, what="both")
    code, output = drive("--list")
    assert output.endswith("; 2 nodes have this name")
    assert allowed.end() == 0


def test_a_twin_of_another_machine_is_seen_by_what_it_publishes(participants):
    """Node of that name in this process, without a claim of the name on this machine."""
    domain = allocate_domain()
    here, there = participants(domain), participants(domain)
    there.node.create_publisher(String, "/test_participant/scenario", 1)
    here.until(lambda: here.node.count_publishers("/test_participant/scenario"), what="discovery")
    with pytest.raises(SecondTwinError, match=rf"/test_participant runs already in ROS domain {domain}: .*second"):
        check_single_instance(here.node)
