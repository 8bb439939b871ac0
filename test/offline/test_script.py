"""Scripts of `simulate`: equal commands from YAML and CSV, and faults with file and line."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import integrate

from cable_twin.frame.records import Command
from cable_twin.offline.script import Place, ScriptedCommand, ScriptError, check_script, read_script
from cable_twin.offline.scripted_run import simulate
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation

YAML_TEXT = """\
# up, and an emergency stop on the way
- {time: 0, name: cabin, speed: 6.0}
- {time: 40, event: emergency_stop}

- time: 50
  event: release
- {time: 20.5, name: cabin, force: 3e4}
- {time: 60, name: cabin, payload: 3200}
- {time: 61, wind: -12, wind_z: 1.5}
"""
CSV_TEXT = """\
# up, and an emergency stop on the way
time, name, speed, force, event, payload, wind, wind_z
0, cabin, 6.0, ,
40, , , , emergency_stop

50,,,,release
20.5,cabin,,3e4
60,cabin,,,,3200
61,,,,,,-12,1.5
"""


DRIVEN = "{time: 1, name: cabin, speed: 2"


def write(directory, name, text):
    path = directory / name
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize("separator", [";", "\t"])
def test_csv_of_a_spreadsheet_may_have_decimal_commas(tmp_path, separator):
    text = separator.join(("# a remark, with a comma\ntime", "name", "speed\n0,5", "cabin", "5,5\n"))
    (command,) = read_script(write(tmp_path, "trip.csv", text))
    assert (command.time, dict(command.command.values)) == (0.5, {"cabin": 5.5})


def test_yaml_and_csv_say_the_same_in_the_order_of_time(tmp_path):
    scripts = [read_script(write(tmp_path, "trip.yaml", YAML_TEXT)), read_script(write(tmp_path, "trip.csv", CSV_TEXT))]
    for script in scripts:
        assert [(item.time, item.command, item.source) for item in script] == [
            (0.0, Command("speed", {"cabin": 6.0}), "script"),
            (20.5, Command("force", {"cabin": 3e4}), "script"),
            (40.0, Command("emergency_stop", {}), "script"),
            (50.0, Command("release", {}), "script"),
            (60.0, Command("payload", {"cabin": 3200.0}), "script"),
            (61.0, Command("wind", {"x": -12.0, "z": 1.5}), "script"),
        ]
    assert [item.place.rpartition(":")[2] for item in scripts[0]] == ["2", "7", "3", "5", "8", "9"]
    assert [item.place.rpartition(":")[2] for item in scripts[1]] == ["3", "7", "4", "6", "8", "9"]


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("{name: cabin, speed: 6}", "time: given none; allowed: zero or more, in s"),
        ("{at: here, event: release}", "at: given 'here'; allowed: {name: VEHICLE or DRIVE, position: m"),
        ("{at: {name: cabin}, event: release}", "at: given {'name': 'cabin'}; allowed: {name: VEHICLE or DRIVE"),
        ("{at: {name: cabin, position: .nan}, event: release}", "at position: given nan; allowed: a finite"),
        ("{at: {name: cabin, position: 1" + 400 * "0" + "}, event: release}", "; allowed: a finite number, in m"),
        ("{time: 1, wind: 3, wind: 4}", "given wind twice, first on line 2; allowed: once"),
        ("{time: -1, name: cabin, speed: 6}", "time: given -1; allowed: zero or more, in s"),
        ("{time: .inf, name: cabin, speed: 6}", "time: given inf"),
        ("{time: true, name: cabin, speed: 6}", "time: given True"),
        ("{time: 1, name: cabin}", "given name 'cabin'; allowed: time (s) and either name with speed, force, payload,"),
        ("{time: 1, speed: 6}", "given speed 6; allowed: time (s) and either name"),
        ("{time: 1, name: cabin, speed: 6, force: 1}", "speed 6, force 1; allowed"),
        ("{time: 1, name: cabin, speed: .nan}", "speed: given nan; allowed: a finite number, in m/s"),
        ("{time: 1, name: cabin, force: much}", "force: given 'much'; allowed: a finite number, in N"),
        ("{time: 1, name: cabin, payload: heavy}", "payload: given 'heavy'; allowed: a finite number, in kg"),
        ("{time: 1, name: cabin, speed: 1" + 400 * "0" + "}", "; allowed: a finite number, in m/s"),
        ("{time: 1, wind: .inf}", "wind: given inf; allowed: a finite number, in m/s"),
        ("{time: 1, wind: 3, wind_z: up}", "wind_z: given 'up'; allowed: a finite number, in m/s"),
        ("{time: 1, temperature: .nan}", "temperature: given nan; allowed: a finite number, in degC"),
        ("{time: 1, wind_z: 3}", "given wind_z 3; allowed: time (s) and either name"),
        ("{time: 1, gust: 3, gust_duration: long}", "gust_duration: given 'long'; allowed: a finite number, in s"),
        ("{time: 1, gust: 3, wind: 3}", "given wind 3, gust 3; allowed: time (s) and either name"),
        ("{time: 1, wind: 3, name: cabin}", "given name 'cabin', wind 3; allowed: time (s) and either name"),
        ("{time: 1, wind: 3, event: reset}", "given event 'reset' with wind; allowed"),
        ("{time: 1, event: brake}", "given event 'brake'; allowed: exactly one of emergency_stop, release, reset"),
        ("{time: 1, event: [reset]}", "given event ['reset']; allowed"),
        ("{time: 1, event: reset, name: cabin}", "given event 'reset' with name; allowed"),
        ("{time: 1, name: cabin, velocity: 6}", "given unknown key velocity; allowed"),
        ("hello", "given 'hello'; allowed"),
        (f"{DRIVEN}, step: 1}}", "given step 1; allowed with a time, a name and a speed or force: step and duration"),
        (f"{DRIVEN}, step: 1, duration: 0}}", "duration: given 0 s; allowed: more than 0 s"),
        (f"{DRIVEN}, step: .nan, duration: 1}}", "step: given nan; allowed: a finite number, in m/s"),
        (f"{DRIVEN}, chirp: 1, duration: 9, from: 0.1}}", "given chirp 1, duration 9, from 0.1; allowed"),
        (f"{DRIVEN}, chirp: 1, duration: 9, from: 0.1, to: 0}}", "to: given 0 Hz; allowed: more than 0, up to 10 Hz"),
        (f"{DRIVEN}, chirp: 1, duration: 9, from: 11, to: 1}}", "from: given 11 Hz; allowed: more than 0, up to 10 Hz"),
        (f"{DRIVEN}, chirp: 1, duration: 1e6, from: 1, to: 1}}", "chirp: given 20000000 commands; allowed: 100000"),
        (f"{DRIVEN}, step: 1, chirp: 1, duration: 1}}", "given step 1, chirp 1, duration 1; allowed"),
        ("{time: 1, name: cabin, payload: 2, step: 1, duration: 2}", "given payload with step, duration; allowed"),
    ],
)
def test_each_fault_has_file_and_line(tmp_path, line, said):
    path = write(tmp_path, "trip.yaml", f"- {{time: 0, name: cabin, speed: 1}}\n- {line}\n")
    with pytest.raises(ScriptError) as error:
        read_script(path)
    assert str(error.value).startswith(f"{path}:2: ")
    assert said in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("scenario", ["single_span", "chairlift", "windy_tramway"])
def test_faults_of_the_file_and_of_the_scenario_are_told_together_in_the_order_of_lines(tmp_path, scenario):
    """All faults before anything is built, unreadable lines and refused commands together."""
    lines = [
        "{time: 0, name: nobody, speed: 1}",
        "hello",
        "{time: 1, event: emergency_stop}",
        "{time: 2, name: nobody, force: 1}",
        "{time: -1, event: release}",
        "{time: 3, wind: 300}",
        "{time: 3, temperature: 283.15}",
        "{at: {name: bus, position: 3}, event: release}",
    ]
    path = write(tmp_path, "trip.yaml", "".join(f"- {line}\n" for line in lines))
    with pytest.raises(ScriptError) as error:
        read_script(path, load_scenario(scenario))
    said = {
        1: "carriage or drive: given 'nobody'",
        2: "given 'hello'; allowed",
        4: "the emergency stop is in force",
        5: "time: given -1",
        6: "wind x: given 300 m/s",
        7: "temperature: given 283.15 degC; allowed: -100 to 100 degC",
        8: "at: given name 'bus'; allowed",
    }
    for line, (number, fault) in zip(str(error.value).splitlines(), said.items(), strict=True):
        assert line.startswith(f"{path}:{number}: {fault}")


def test_a_step_and_a_chirp_are_commands(tmp_path):
    text = "- {time: 2, name: cabin, speed: 3, step: 1.5, duration: 10}\n"
    text += "- {time: 20, name: cabin, force: 100, chirp: 40, from: 0.1, to: 0.5, duration: 30}\n"
    table = "time,name,speed,force,step,chirp,duration,from,to\n2,cabin,3,,1.5,,10\n20,cabin,,100,,40,30,0.1,0.5\n"
    script = read_script(write(tmp_path, "test.yaml", text))
    again = read_script(write(tmp_path, "test.csv", table))
    assert [(item.time, item.command) for item in script] == [(item.time, item.command) for item in again]
    assert [(item.time, item.command.values["cabin"]) for item in script[:3]] == [(2.0, 3.0), (2.0, 4.5), (12.0, 3.0)]
    chirp = script[3:]
    assert {item.command.kind for item in chirp} == {"force"}
    times, values = np.array([(item.time - 20.0, item.command.values["cabin"]) for item in chirp]).T
    assert (times[0], times[-1], values[-1]) == (0.0, 30.0, 100.0)
    assert np.diff(times) == pytest.approx(0.1)  # 20 in 2 s, the period of 0.5 Hz
    phase = integrate.cumulative_trapezoid(0.1 * 5.0 ** (np.linspace(0.0, 30.0, 30001) / 30.0), dx=1e-3, initial=0.0)
    there = np.interp(times, np.linspace(0.0, 30.0, 30001), phase)
    np.testing.assert_allclose(values[:-1], 100.0 + 40.0 * np.sin(2.0 * np.pi * there[:-1]), atol=1e-3)


def test_a_limit_that_a_chirp_exceeds_is_told_once(tmp_path):
    path = write(tmp_path, "test.yaml", "- {time: 1, name: cabin, speed: 9, chirp: 5, from: 1, to: 1, duration: 10}\n")
    with pytest.raises(ScriptError, match=r"^[^\n]* allowed: -10 to 10 m/s$"):
        read_script(path, load_scenario("single_span"))


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("trip.csv", "name,speed\ncabin,1\n", ":1: header: given 'name,speed'; allowed: one with a column time"),
        ("trip.csv", "time,name,speed,speed\n", ":1: header: given 'time,name,speed,speed'; allowed: each key once"),
        ("trip.csv", "time,name,speed\n1,cabin,2,3,4\n", ":2: cells: given 5; allowed: 3, as in the header"),
        ("trip.csv", "time,name,speed\n1,cabin," + 140_000 * "1" + "\n", ":2: not CSV (field larger than"),
        ("trip.yaml", "time: 1\n", ":1: given a mapping; allowed: a list of commands"),
        ("trip.yaml", "- {time: 1\n- 2", ":2: not YAML ("),
        ("trip.txt", "", ": suffix: given '.txt'; allowed: .yaml, .yml or .csv"),
    ],
)
def test_what_is_no_script_is_named(tmp_path, name, text, said):
    path = write(tmp_path, name, text)
    with pytest.raises(ScriptError) as error:
        read_script(path)
    assert f"{path}{said}" in str(error.value)
    assert "\n" not in str(error.value)


def test_missing_and_binary_files_are_named(tmp_path):
    with pytest.raises(ScriptError, match=r"none.yaml: No such file or directory"):
        read_script(tmp_path / "none.yaml")
    (tmp_path / "binary.csv").write_bytes(b"time\n\xff\xfe\n")
    with pytest.raises(ScriptError, match=r"binary.csv: not a text in UTF-8"):
        read_script(tmp_path / "binary.csv")


def test_empty_script_has_no_commands(tmp_path):
    assert read_script(write(tmp_path, "none.yaml", "# nothing\n")) == []
    assert read_script(write(tmp_path, "none.csv", "\n")) == []


PLACES_YAML = """\
- {time: 0, name: cabin, speed: 8.0}
- {at: {name: cabin, position: 80}, event: emergency_stop}
- {time: 25, event: release}
- {time: 26, name: cabin, speed: -4}
- {time: 26, at: {name: cabin, position: 70.5}, name: cabin, speed: 0}
- {at: {name: cabin, position: 900}, wind: 5}
"""
PLACES_CSV = """\
time,at_name,at_position,name,speed,wind,event
0,,,cabin,8
,cabin,80,,,,emergency_stop
25,,,,,,release
26,,,cabin,-4
26,cabin,70.5,cabin,0
,cabin,900,,,5
"""


@pytest.mark.parametrize(("name", "text"), [("trip.yaml", PLACES_YAML), ("trip.csv", PLACES_CSV)])
def test_commands_are_given_where_a_vehicle_comes_by(tmp_path, name, text):
    """First step beyond the place from either side at any frame rate; each command once, from its time on."""
    script = read_script(write(tmp_path, name, text))
    applied = []
    for frame_steps in (2, 7):
        simulation = Simulation(load_scenario("single_span", {"cable.elements": 20}))
        given = []
        apply = simulation.apply
        simulation.apply = lambda command, source, apply=apply, given=given: (
            given.append(command) or apply(command, source)
        )
        seen = []

        def look(time, simulation=simulation, seen=seen):
            seen.append((time, simulation.snapshot.carriages["cabin"].arc_length))

        outcome = simulate(simulation, script, duration=45.0, frame_steps=frame_steps, epoch_ns=0, on_frame=look)
        assert outcome.refused == []
        assert outcome.not_reached == [
            f"{tmp_path / name}:{6 if name == 'trip.yaml' else 7}: 'cabin' has not passed 900 m"
        ]
        applied.append([(command.kind, *command.values.values()) for command in given])
    assert applied[0] == applied[1]
    assert applied[0] == [("speed", 8.0), ("emergency_stop",), ("release",), ("speed", -4.0), ("speed", 0.0)]


def test_a_place_is_reached_at_the_same_step_whatever_the_frames_are():
    script = [
        ScriptedCommand(0.0, Command("speed", {"haul_rope": 2.0}), "script", ""),
        ScriptedCommand(0.0, Command("emergency_stop", {}), "script", "", Place("haul_rope", 5.0)),
    ]
    ends = []
    for frame_steps in (1, 13, 200):
        simulation = Simulation(load_scenario("gondola", {"ropes.up.elements": 60, "ropes.down.elements": 60}))
        outcome = simulate(simulation, script, duration=13.0, frame_steps=frame_steps, epoch_ns=0)
        assert not outcome.not_reached
        ends.append(simulation.advance_to(20.0).numbers.tobytes())
        assert simulation.snapshot.drives["haul_rope"].speed == 0.0
        assert simulation.snapshot.drives["haul_rope"].position == pytest.approx(6.05, abs=0.05)  # 1.58 m/s there
    assert len(set(ends)) == 1


def test_places_that_nothing_can_come_by_are_told_before_the_run(tmp_path):
    """Places off the cable; unknown names are in the table of faults above."""
    script = read_script(write(tmp_path, "trip.yaml", "- {at: {name: cabin, position: 5000}, event: emergency_stop}\n"))
    (fault,) = check_script(load_scenario("single_span"), script)
    assert fault.endswith("trip.yaml:1: at: given 5000 m of 'cabin'; allowed: 0 to 1044.25 m, on the cable")
