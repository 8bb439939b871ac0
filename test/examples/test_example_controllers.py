"""Example controllers that are independent of the package: one live, one in lockstep."""

from __future__ import annotations

import json
import math
import re
import runpy
import socket
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from twin_process import write_quick_scenario

pytest.importorskip("rclpy")
from builtin_interfaces.msg import Time
from sensor_msgs.msg import JointState
from std_msgs.msg import Header, String
from std_srvs.srv import SetBool, Trigger

from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
LONGEST = 120.0  # s of an example, which compiles nothing and drives for some seconds
FASTEST = "carriages.cabin.drive.limits.speed"
START, PLACE, PERIOD = 60.0, 61.0, 0.01  # m, m, s


@pytest.fixture
def drive(running, processes):
    """Run an example beside the twin at its start; returns the printed lines."""
    twin, participant = running

    def run(script, *arguments, paused):
        assert participant.call("pause", SetBool, data=paused).success
        assert participant.call("reset", Trigger).success
        process = processes(*arguments, module=str(EXAMPLES / script), domain=twin.domain)
        assert process.wait(LONGEST) == 0, process.output
        assert "Traceback" not in process.output
        return process.output.splitlines()

    return run


def test_few_lines_drive_to_a_place_and_know_their_dead_time(running, drive):
    place, dead_time = drive("position_controller.py", "cabin", str(PLACE), paused=False)
    assert place == f"cabin is at {PLACE:.2f} m" or abs(float(place.split()[3]) - PLACE) < 0.05
    told = re.fullmatch(r"commands took effect (\d+) ms after their states \(median\)", dead_time)
    # a frame is computed ahead of its time, so that an answer to it comes into the one after it
    assert PERIOD * 1e3 <= int(told[1]) < 10.0 * PERIOD * 1e3
    participant = running[1]
    participant.until(lambda: participant.speed == pytest.approx(0.0, abs=0.05), what="a cabin that stands")
    code = (EXAMPLES / "position_controller.py").read_text().partition('"""\n\n')[2].splitlines()
    assert len([line for line in code if line.strip() and not line.lstrip().startswith(("#", '"""'))]) < 50


@pytest.fixture
def controller(monkeypatch):
    """Controller of a name and place without a node, with the limits of a scenario; its commands go to a function."""
    made = runpy.run_path(str(EXAMPLES / "position_controller.py"))["PositionController"]
    monkeypatch.setattr(made, "__init__", lambda self: None)
    monkeypatch.setattr(made, "create_subscription", lambda self, *arguments: None)

    def make(scenario, name, place, publish):
        one = made()
        one.name, one.place, one.last, one.sent, one.dead_times = name, place, None, {}, []
        one.commands = SimpleNamespace(publish=publish)
        one.on_scenario(String(data=json.dumps(scenario.resolved())))
        return one

    return make


@pytest.mark.parametrize("name", ["gondola", "bicable"])
def test_the_same_lines_take_a_lift_to_a_place_without_going_beyond(controller, name):
    simulation, answers = Simulation(load_scenario(name), samples=2, on_demand=True), [0.0, 0.0]
    one = controller(simulation.scenario, "haul_rope", 12.0, lambda message: answers.append(message.velocity[0]))
    for frame in range(1, 1500):
        simulation.command("haul_rope", speed=answers[-2])  # a frame late
        columns = simulation.advance_to(0.02 * frame).columns
        place, speed = float(columns.drive_position[0]), float(columns.drive_speed[0])
        assert place < 12.05
        try:
            one.on_state(JointState(name=["haul_rope"], position=[place], velocity=[speed]))
        except SystemExit:
            break
    assert place == pytest.approx(12.0, abs=0.05)


def test_without_arguments_there_is_a_line_of_usage(ended):
    for arguments in ((), ("--help",)):
        said, *_ = ended(EXAMPLES / "position_controller.py", *arguments)  # which Python prints, with exit code 1
        assert said.startswith("usage: position_controller.py NAME PLACE")
        assert "\n" not in said


def test_a_speed_that_is_repeated_and_a_place_that_is_reached_tell_no_dead_time(drive, controller):
    """Of commands of one speed none can be told from another; without an answer there is no number."""
    one = controller(load_scenario("single_span", {FASTEST: 4.0}), "cabin", 1000.0, lambda message: None)

    def message(frame, **fields):
        return JointState(header=Header(stamp=Time(nanosec=frame * 10_000_000)), name=["cabin"], **fields)

    for frame in (1, 2):  # the answer to the first comes after the second
        one.on_state(message(frame, position=[60.0], velocity=[4.0]))
    for frame in (2, 3):
        one.on_applied(message(frame, velocity=[4.0]))
    assert one.dead_times == [pytest.approx(PERIOD)]
    (place,) = drive("position_controller.py", "cabin", str(START), paused=False)
    assert place.startswith("cabin is at ")


def test_lockstep_gives_the_numbers_of_the_python_api(drive, tmp_path):
    """Comparison with the control law of the example in the simulation itself, to the last printed digit."""
    simulation = Simulation(load_scenario(write_quick_scenario(tmp_path)))
    simulation.advance_to(PERIOD)
    expected = []
    for frame in range(6000):
        cabin, follows = simulation.snapshot.carriages["cabin"], simulation.snapshot.columns.reference_speed[0]
        left = PLACE - cabin.arc_length
        if frame % 100 == 0:
            numbers = cabin.arc_length, cabin.speed, follows, cabin.drive_force
            expected.append("{:5d} {:10.4f} m {:9.5f} m/s, reference {:9.5f} m/s, {:10.1f} N".format(frame, *numbers))
        if abs(left) < 0.01 and abs(cabin.speed) < 0.01:
            break
        speed = min(0.3 * abs(left), math.sqrt(2.0 * 0.15 * abs(left)), 3.0)
        simulation.command("cabin", speed=math.copysign(speed, left))
        simulation.advance_to(simulation.time + PERIOD)
    expected.append(f"{frame} frames, at {cabin.arc_length:.4f} m with {cabin.speed:.5f} m/s")
    assert len(expected) > 3
    assert drive("lockstep.py", "cabin", "--to", str(PLACE), paused=True) == expected


def test_lockstep_says_why_it_cannot(domain, processes):
    process = processes("cabin", "--to", "1", "--wait", "0.5", module=str(EXAMPLES / "lockstep.py"), domain=domain)
    assert process.wait(LONGEST) == 1
    assert process.output == "lockstep.py: a twin that listens: not within 0.5 s\n"


@pytest.mark.parametrize(
    ("scenario", "said"),
    [
        ("single_span", "Address already in use; allowed: opc.tcp://HOST:PORT with a free port"),
        ("chairlift", "scenario: given chairlift; allowed: one with a carriage"),
    ],
)
def test_a_plant_of_opc_ua_that_cannot_be_served_is_a_line(scenario, said, capsys, monkeypatch):
    pytest.importorskip("asyncua")
    with socket.create_server(("127.0.0.1", 0)) as other:
        url = f"opc.tcp://127.0.0.1:{other.getsockname()[1]}"
        monkeypatch.setattr(sys, "argv", ["opcua_plant", scenario, "--url", url])
        assert runpy.run_path(str(EXAMPLES / "opcua_plant.py"))["main"]() == 2
    (line,) = [one for one in capsys.readouterr().err.splitlines() if one.startswith("opcua_plant: ")]
    assert line.lower().endswith(said.lower())


def test_key_figures_of_several_ropes_are_printed_and_bad_arguments_refused_in_a_line(capsys):
    example = runpy.run_path(str(EXAMPLES / "key_figures.py"))["main"]
    example(["chairlift"])
    lines = capsys.readouterr().out.splitlines()
    assert any(line.startswith("drive: adhesion used of available: ") for line in lines)
    assert sum(" m: up: " in line and ", down: " in line for line in lines) == 5
    for arguments, said in ((["chairlift", "cabin"], "drive: given cabin; allowed: haul_rope"), (["x"], "given 'x'")):
        with pytest.raises(SystemExit, match="2"):
            example(arguments)
        assert said in capsys.readouterr().err.splitlines()[-1]
