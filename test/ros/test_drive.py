"""Command `drive` beside a running twin and a lift, without one, and with refused commands."""

from __future__ import annotations

import os
import pty
import re
import signal
import subprocess
import sys
from functools import partial
from pathlib import Path

import pytest
from test_moving_cable_twin import short_scenario
from twin_process import COMPILING, PATIENCE, TwinProcess, allocate_domain, environment, wait_until

from cable_twin.frame.commands import KINDS
from cable_twin.frame.records import Command, CommandError
from cable_twin.runtime.point_to_point import STATIONS, target_of
from cable_twin.scenario import command_fault, load_scenario
from cable_twin.simulation.command_handlers import check_drive

pytest.importorskip("rclpy")
from ros_participant import Participant
from std_msgs.msg import String
from std_srvs.srv import SetBool, Trigger

from cable_twin.ros.client.drive import main, parser
from cable_twin.ros.node import SecondTwinError, check_single_instance

STOP = Command("speed", {"cabin": 0.0})
TIME = r"\d+\.\d{3} s of simulated time"
WHEN = rf"( at {TIME}|, from the next frame boundary on)"  # the latter where the machine is busy


@pytest.fixture
def twin(running):
    """Running twin at rest at its start."""
    _, participant = running
    assert participant.call("emergency_stop", SetBool, data=False).success
    assert participant.call("reset", Trigger).success
    assert participant.call("pause", SetBool, data=False).success
    participant.spin(0.1)
    for messages in participant.received.values():
        messages.clear()
    participant.until(lambda: participant.received["joint_states"])
    return participant


def driven(processes, domain: int, *arguments: str) -> TwinProcess:
    """Start `drive` in a domain."""
    return processes(*arguments, "--wait", str(PATIENCE), module="ros.client.drive", domain=domain)


@pytest.fixture
def drive(running, processes):
    """Start `drive` beside the twin."""
    return partial(driven, processes, running[0].domain)


def finish(participant: Participant, process: TwinProcess) -> int:
    """Take messages until `drive` has ended."""
    participant.until(lambda: process.process.poll() is not None, what=f"end of drive; {process.output}")
    return process.wait()


def test_it_moves_the_cabin_for_a_while_and_stops_it(twin, drive):
    process = drive("cabin", "--speed", "3", "--ramp", "1", "--duration", "3")
    assert finish(twin, process) == 0, process.output
    speeds = [applied.command.values["cabin"] for applied in twin.applied if applied.command.kind == "speed"]
    assert speeds == [*sorted(speeds[:-1]), 0.0]  # up the ramp, and zero in the end
    assert max(speeds) == 3.0
    assert len(speeds) > 40  # 20 Hz
    assert any(0.5 < speed < 2.5 for speed in speeds)
    assert max(message.velocity[0] for message in twin.received["joint_states"]) == pytest.approx(3.0, abs=1e-3)
    twin.until(lambda: twin.speed == 0.0, what="stop")
    assert "command_timeout" not in {applied.source for applied in twin.applied}
    line = process.output.splitlines()[-1]
    assert "commanded +3.00 m/s  cabin:" in line
    assert line.rstrip().endswith("kN")


@pytest.mark.parametrize(
    ("what", "line"),
    [
        ("figures", r"rope tension, highest: [\d.]+ kN at .*"),
        ("state", r"cable_twin: solver: .*, [a-z_]+ [\d.e-]+.*"),
    ],
)
def test_it_shows_what_a_twin_publishes(twin, drive, what, line):
    process = drive("--show", what)
    assert finish(twin, process) == 0, process.output
    first, *lines = process.output.splitlines()
    assert re.fullmatch(r"(/diagnostics|/cable_twin/key_figures), stamped [\d.]+ s", first)
    assert any(re.fullmatch(line, one) for one in lines), lines


def test_its_line_fits_a_terminal(running, twin):
    process, _ = running
    reader, writer = pty.openpty()
    command = [sys.executable, "-m", "cable_twin.ros.client.drive", "cabin", "--speed", "1", "--duration", "0.6"]
    variables = {**environment(process.directory, process.domain), "COLUMNS": "60"}
    subprocess.run(command, stdout=writer, stderr=writer, env=variables, check=True, timeout=PATIENCE)
    os.close(writer)
    lines = os.read(reader, 4096).decode().split("\r")
    os.close(reader)
    assert sum("commanded +1.00 m/s  cabin:" in line for line in lines) > 1
    assert all(len(line.strip("\n")) < 60 for line in lines)


def test_it_goes_to_a_place_and_stops_there(twin, drive):
    process = drive("cabin", "--to", "95.5", "--at-most", "6")
    assert finish(twin, process) == 0, process.output
    said = re.fullmatch(
        r"arrived: cabin at (\S+) m, 0\.\d\d m from 95\.50 m, after \S+ s", process.output.splitlines()[-1]
    )
    assert said, process.output
    twin.until(lambda: twin.speed == 0.0, what="stop")
    assert twin.arc_length == pytest.approx(95.5, abs=0.1)
    speeds = [message.velocity[0] for message in twin.received["joint_states"]]
    assert 5.0 < max(speeds) <= 6.01  # up, along
    assert min(speeds) > -0.1  # and down to a stop, not to and fro
    assert " m to go" in process.output
    assert {applied.source for applied in twin.applied} == {"goal", "arrival"}  # the twin drove; nobody else had to
    process = drive("cabin", "--to", "5000")
    assert finish(twin, process) == 1
    assert re.search(
        r"drive: --to: place for 'cabin': given '5000'; allowed: \S+ to \S+ m along the cable, or start, end, lower_",
        process.output,
    )


def test_stations_are_where_the_end_stops_begin():
    scenario = load_scenario("single_span")
    length = scenario.cable.unstrained_length
    places = {name: target_of(scenario, "cabin", name) for name in STATIONS}
    assert places["lower_station"] == places["start"] == pytest.approx(0.005 * length)
    assert places["upper_station"] == places["end"] == pytest.approx(0.995 * length)
    falling = load_scenario("single_span", {"cable.start.position": [0.0, 300.0], "cable.end.position": [1000.0, 0.0]})
    assert target_of(falling, "cabin", "upper_station") == pytest.approx(0.005 * length)
    steep = {"cable.start.position": [0.0, 9.0, 300.0], "cable.end.position": [1000.0, 0.0, 0.0]}
    assert target_of(load_scenario("single_span", steep), "cabin", "upper_station") == pytest.approx(0.005 * length)
    with pytest.raises(ValueError, match="place for 'haul_rope': given 'upper_station'; allowed: "):
        target_of(load_scenario("gondola"), "haul_rope", "upper_station")


@pytest.mark.parametrize("number", [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.long)])
def test_signal_stops_a_driven_force_with_speed_zero(twin, drive, number):
    process = drive("cabin", "--force", "40000")
    twin.until(lambda: twin.received["applied_commands"] and twin.speed > 0.3, what="motion by force")
    process.send(number)
    assert finish(twin, process) == 0
    twin.until(lambda: twin.speed == 0.0, what="stop")
    last = twin.applied[-1]
    assert (last.command, last.source) == (STOP, "joint_commands")  # not by the time-out
    assert "Traceback" not in process.output


def test_a_reader_that_leaves_ends_it_with_a_stop(running, twin):
    command = [sys.executable, "-m", "cable_twin.ros.client.drive", "cabin", "--speed", "2"]
    with subprocess.Popen(
        command,
        env=environment(running[0].directory, running[0].domain),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    ) as process:
        twin.until(lambda: twin.received["applied_commands"] and twin.speed > 0.3, what="motion")
        process.stdout.close()
        twin.until(lambda: process.poll() is not None, what="the end of drive")
        assert process.stderr.read() == b""
    assert process.returncode == 0
    twin.until(lambda: twin.speed == 0.0, what="stop")
    last = twin.applied[-1]
    assert (last.command, last.source) == (STOP, "joint_commands")


def test_what_the_scenario_excludes_is_named_at_once(twin, drive):
    process = drive("cabin", "--force", "-2e5")
    assert finish(twin, process) == 1
    assert process.output.strip() == "drive: force of 'cabin': given -200000 N; allowed: -150000 to 150000 N"
    assert not twin.received["applied_commands"]


def test_refusals_of_the_twin_end_it(twin, drive):
    process = drive("cabin", "--speed", "2")
    twin.until(lambda: twin.received["applied_commands"])
    assert twin.call("emergency_stop", SetBool, data=True).success
    assert finish(twin, process) == 1
    refusal = "drive: the emergency stop is in force: release it before the next command"
    assert refusal in process.output
    process = drive("cabin", "--speed", "2", "--duration", "0.2")  # over before an answer could have come
    assert finish(twin, process) == 1
    assert refusal in process.output


def test_without_a_twin_or_with_a_paused_one_it_says_so(processes, quick_twin):
    alone = processes("cabin", "--speed", "1", "--wait", "3", module="ros.client.drive")
    paused, participant = quick_twin("--record", "false", "--start-paused", "true", paused=True)
    waiting = processes("cabin", "--speed", "1", "--wait", "6", module="ros.client.drive", domain=paused.domain)
    assert alone.wait() == 1
    assert alone.output.strip() == (
        "drive: no twin listens on /cable_twin/joint_commands after 3 s: is `sim` running, with the same ROS_DOMAIN_ID?"
    )
    assert waiting.wait() == 1
    assert waiting.output.strip() == (
        "drive: the twin on /cable_twin/joint_commands does not advance: if it is paused, `drive --resume` continues it"
    )
    given_up = processes("gondola", "--force", "1", module="ros.client.drive", domain=paused.domain)
    participant.until(lambda: participant.node.count_publishers("/cable_twin/joint_commands"), what="drive")
    given_up.send(signal.SIGINT)
    assert given_up.wait() == 130
    participant.spin(0.5)
    assert not participant.received["applied_commands"]  # who drives nothing stops nothing


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["cabin", "--speed", "1", "--force", "1"], "argument --force: not allowed with argument --speed"),
        (["cabin", "--speed", "nan"], "argument --speed: given 'nan'; allowed: a finite number"),
        (["cabin", "--speed", "fast"], "argument --speed: given 'fast'; allowed: a finite number"),
        (["cabin", "--speed", "1", "--ramp", "-1"], "argument --ramp: given '-1'; allowed: 0 s or more"),
        (["--speed", "1"], "NAME: given nothing; allowed: a carriage or drive, before --speed"),
        (["--to", "5"], "NAME: given nothing; allowed: a carriage or drive, before --to"),
        (["cabin", "--to", "5", "--at-most", "0"], "--at-most: given 0 m/s; allowed: more than 0 m/s, with --to"),
        (["cabin", "--to", "5", "--ramp", "2"], "--ramp: given 2 s; allowed: with --speed, --force"),
        (["--payload", "1"], "NAME: given nothing; allowed: a carriage, before --payload"),
        (["cabin", "--pause"], "NAME: given 'cabin'; allowed: with --speed, --force, --payload, --to"),
        (["cabin", "--wind", "1"], "NAME: given 'cabin'; allowed: with --speed, --force, --payload, --to"),
        (["--reset", "--duration", "1"], "--duration: given 1 s; allowed: with --speed, --force"),
        (["cabin", "--payload", "1", "--ramp", "1"], "--ramp: given 1 s; allowed: with --speed, --force"),
        (["--wind", "1", "2", "3", "4"], "argument --wind: given 4 numbers; allowed: at most 3, of x, z, y, in m/s"),
        (["--temperature", "1", "2"], "argument --temperature: given 2 numbers; allowed: one, of all ropes, in degC"),
        (["--wind", "gale"], "argument --wind: given 'gale'; allowed: a finite number"),
        (
            ["--reset", "--node", "a b"],
            "argument --node: given 'a b'; allowed: the full name of a node, such as /b/cable_twin",
        ),
        (["--step", "0"], "argument --step: given '0'; allowed: a whole number from 1 on"),
        (["--pause", "--resume"], "argument --resume: not allowed with argument --pause"),
        (
            ["cabin"],
            "one of the arguments --speed --force --payload --wind --temperature --emergency-stop --release --reset "
            "--pause --resume --snapshot --step --to --load --readmit --list --show is required",
        ),
    ],
)
def test_bad_options_are_named_in_a_line(capsys, arguments, said):
    with pytest.raises(SystemExit, match="1"):
        main(arguments)
    assert capsys.readouterr().err == f"drive: {said}; all options: drive --help\n"


def test_the_help_says_how_many_numbers_and_which_places_of_a_drive(monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    said = parser().format_help()
    assert re.search(r"--temperature DEGC +degC: ", said)
    assert re.search(r"--wind M/S \[M/S \.\.\.\]", said)
    assert "of a drive m of its travel, start or end" in said


@pytest.mark.parametrize(
    ("scenario", "name", "kind", "value", "said"),
    [
        (
            "jig_back",
            "cabin_1",
            "speed",
            3.0,
            "'cabin_1' is clamped to haul_1, which pulls it; allowed drives: haul_rope",
        ),
        ("jig_back", "cabin", "speed", 3.0, "carriage or drive: given 'cabin'; allowed: haul_rope"),
        ("jig_back", "haul_rope", "speed", 30.0, "speed of 'haul_rope': given 30 m/s; allowed: -10 to 10 m/s"),
        ("chairlift", "haul_rope", "force", 0.0, None),  # a drive that is lost
        ("chairlift", "haul_rope", "force", 1e6, "force of 'haul_rope': given 1000000 N; allowed: -106453 to 106453 N"),
        ("aerial_tramway", "cabin", "force", 1e4, None),
        ("aerial_tramway", "cabin", "speed", 11.0, "speed of 'cabin': given 11 m/s; allowed: -10 to 10 m/s"),
    ],
)
def test_it_knows_before_it_sends_what_a_twin_refuses(scenario, name, kind, value, said):
    published = load_scenario(load_scenario(scenario).resolved())
    assert command_fault(published, kind, KINDS[kind].unit, name, value) == said
    if said is not None:
        with pytest.raises(CommandError, match=re.escape(said)):
            check_drive(Command(kind, {name: value}), published)


@pytest.fixture
def request_of(running, drive):
    """Send a request by `drive` beside the twin; returns exit code and output."""

    def run(*arguments):
        process = drive(*arguments)
        return finish(running[1], process), process.output.strip()

    return run


def test_it_stops_releases_and_resets(twin, request_of):
    code, output = request_of("--emergency-stop")
    assert code == 0
    assert re.fullmatch(rf"/cable_twin: emergency stop{WHEN}", output)
    assert twin.next_diagnostics()[2]["emergency_stop"] == "true"
    assert request_of("--list") == (0, twin_line(twin, "emergency stop in force"))
    code, output = request_of("--release")
    assert code == 0
    assert re.fullmatch(rf"/cable_twin: emergency stop released{WHEN}", output)
    code, output = request_of("--release")
    assert code == 0
    assert re.fullmatch(rf"/cable_twin: no emergency stop was in force at {TIME}", output)
    code, output = request_of("--reset")
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


def test_a_twin_that_follows_no_plant_has_no_sensor_to_readmit(request_of):
    said = "drive: /cable_twin: readmit: given 'load_end'; allowed: none, as this twin follows no plant"
    assert request_of("--readmit", "load_end") == (1, said)


def test_it_pauses_steps_and_resumes(twin, request_of):
    code, output = request_of("--step", "2")
    assert (code, output) == (1, "drive: /cable_twin: not paused: call ~/pause with true first, as drive --pause does")
    code, output = request_of("--pause")
    assert code == 0
    (paused_at,) = re.fullmatch(r"/cable_twin: paused at (\d+\.\d{3}) s of simulated time", output).groups()
    twin.next_diagnostics()
    assert request_of("--list") == (0, twin_line(twin, "paused"))
    code, output = request_of("--step", "5")
    assert code == 0
    (at,) = re.fullmatch(r"/cable_twin: 5 frames, to (.*) s of simulated time", output).groups()
    assert float(at) == pytest.approx(float(paused_at) + 0.05, abs=0.011)
    code, output = request_of("--step", "2000000")
    assert (code, "step_count" in output) == (1, True)
    code, output = request_of("--step", "1")
    assert re.fullmatch(rf"/cable_twin: one frame, to {TIME}", output)
    code, output = request_of("--resume")
    assert code == 0
    assert re.fullmatch(rf"/cable_twin: running at {TIME}", output)
    assert twin.next_diagnostics()[2]["paused"] == "false"


def test_it_loads_and_blows_and_says_why_not(twin, request_of):
    twin.received["applied_commands"].clear()
    assert request_of("cabin", "--payload", "640") == (0, "/cable_twin: payload cabin 640 kg")
    assert request_of("cabin", "--payload", "0") == (0, "/cable_twin: payload cabin 0 kg")
    assert request_of("--wind", "12") == (0, "/cable_twin: wind x 12 m/s, z 0 m/s")
    assert request_of("--wind", "-3", "0.5") == (0, "/cable_twin: wind x -3 m/s, z 0.5 m/s")
    assert request_of("--temperature", "-5") == (0, "/cable_twin: temperature ropes -5 degC")
    twin.until(lambda: len(twin.applied) == 5, what="all five")
    applied = [(one.command.kind, one.source) for one in twin.applied]
    assert applied == [("payload", "payload")] * 2 + [("wind", "wind")] * 2 + [("temperature",) * 2]
    code, output = request_of("cabin", "--payload", "1e6")
    assert (code, output) == (1, "drive: payload of 'cabin': given 1e+06 kg; allowed: 0 to 6400 kg")
    code, output = request_of("gondola", "--payload", "1")
    assert (code, output) == (1, "drive: payload: given for carriage 'gondola'; allowed: cabin")
    code, output = request_of("--wind", "200")
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


def test_it_saves_a_snapshot_and_prints_where(running, twin, request_of):
    code, output = request_of("--snapshot")
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


def test_a_second_twin_of_one_name_is_refused_and_another_name_is_listed(running, twin, processes, request_of):
    first = running[0]
    arguments = ["--scenario", str(first.directory / "quick.yaml"), "--record", "false"]
    second = processes(*arguments, domain=first.domain)
    assert second.wait(COMPILING) == 1
    assert second.output == (
        f"sim: a twin named /cable_twin runs already in ROS domain {first.domain}: end it, give this one another name, "
        "as with --ros-args -r __ns:=/b, or another ROS_DOMAIN_ID, or allow both with --allow-second\n"
    )
    other = processes(*arguments, "--start-paused", "--ros-args", "-r", "__ns:=/b", domain=first.domain)
    other.wait_for("'quick' runs at 100 Hz")
    here = twin.node.get_node_names_and_namespaces
    twin.until(lambda: ("cable_twin", "/b") in here(), what="both")
    code, output = request_of("--list")
    assert code == 0
    lines = output.splitlines()
    assert [line.partition(":")[0] for line in lines] == ["/b/cable_twin", "/cable_twin"]
    paused = "/b/cable_twin: quick, paused at 0.000 s of simulated time; carriages: cabin (up to 10 m/s, 150 kN)"
    assert lines[0] == paused
    code, output = request_of("--node", "/b/cable_twin", "--step", "1")
    assert (code, output) == (0, "/b/cable_twin: one frame, to 0.010 s of simulated time")
    assert other.end() == 0
    allowed = processes(*arguments, "--allow-second", domain=first.domain)
    allowed.wait_for("'quick' runs at 100 Hz")
    wait_until(lambda: twin.node.count_publishers("/cable_twin/scenario") == 2, what="both")
    code, output = request_of("--list")
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


@pytest.fixture(scope="module")
def lift(tmp_path_factory):
    """Running lift of six chairs, and a participant."""
    directory = tmp_path_factory.mktemp("lift")
    (directory / "lift.yaml").write_text(short_scenario().to_yaml())
    process = TwinProcess(directory, "--scenario", "lift.yaml", "--record", "false")
    participant = Participant(process.domain)
    participant.subscribe_standard()
    participant.until(lambda: participant.received["joint_states"])
    yield process, participant
    participant.close()
    process.kill()


@pytest.fixture
def drive_lift(lift, processes):
    """Start `drive` beside the lift."""
    return partial(driven, processes, lift[0].domain)


def test_the_rope_is_driven_stops_in_silence_and_in_an_emergency(lift, drive_lift):
    process, participant = lift
    process.wait_for("drive: haul_rope; carriages: chair_1 to chair_6; commands on")

    def speed():
        return participant.joint("haul_rope")[1]

    driver = drive_lift("haul_rope", "--speed", "2")
    participant.until(lambda: speed() > 1.0, what="motion")
    driver.send(signal.SIGKILL)
    participant.until(lambda: "no command for 0.5 s: haul_rope ramps to a stop" in process.output, what="time-out")
    participant.until(lambda: speed() == 0.0, what="stop")
    drive_lift("haul_rope", "--speed", "-2")
    participant.until(lambda: speed() < -1.0, what="motion backwards")
    assert participant.call("emergency_stop", SetBool, data=True).success
    participant.until(lambda: speed() == 0.0, what="emergency stop")
    assert participant.call("emergency_stop", SetBool, data=False).success


@pytest.mark.long
def test_the_rope_goes_by_to_a_place(lift, drive_lift):
    process, participant = lift

    def rope():
        return participant.joint("haul_rope")

    participant.until(lambda: rope()[1] == 0.0, what="stop")
    target = rope()[0] - 7.5
    driver = drive_lift("haul_rope", "--to", f"{target:.3f}")
    assert finish(participant, driver) == 0, driver.output
    participant.until(lambda: rope()[1] == 0.0, what="stop")
    assert rope()[0] == pytest.approx(target, abs=0.1)

    # a trip that is abandoned after one that has arrived
    driver = drive_lift("haul_rope", "--to", f"{target + 50.0:.3f}")
    participant.until(lambda: rope()[1] > 0.1, what="motion")
    assert participant.call("emergency_stop", SetBool, data=True).success
    finish(participant, driver)
    why = "haul_rope: emergency stop from service took over"
    assert f"drive: the twin has abandoned this trip: {why}" in driver.output
    participant.until(lambda: f"goal abandoned: {why}" in process.output, what="line")
    assert participant.call("emergency_stop", SetBool, data=False).success

    driver = drive_lift("haul_rope", "--force", "5")
    assert finish(participant, driver) == 1
    allowed = "none, as this drive takes speeds only (m/s)"
    assert driver.output == f"drive: force of 'haul_rope': given 5 N; allowed: {allowed}\n"
