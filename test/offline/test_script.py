"""Scripts of `simulate`: YAML and CSV say the same, and what is wrong is named with file and line."""

from __future__ import annotations

import pytest

from cable_twin.offline.script import ScriptError, read_script
from cable_twin.records import Command

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


def write(directory, name, text):
    path = directory / name
    path.write_text(text, encoding="utf-8")
    return path


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
        ("{name: cabin, speed: 6}", "no time given; allowed: zero or more, in s"),
        ("{time: -1, name: cabin, speed: 6}", "time -1 given; allowed: zero or more, in s"),
        ("{time: .inf, name: cabin, speed: 6}", "time inf given"),
        ("{time: true, name: cabin, speed: 6}", "time True given"),
        ("{time: 1, name: cabin}", "name 'cabin' given; allowed: time (s) and either name with speed, force, payload,"),
        ("{time: 1, speed: 6}", "speed 6 given; allowed: time (s) and either name"),
        ("{time: 1, name: cabin, speed: 6, force: 1}", "speed 6, force 1 given; allowed"),
        ("{time: 1, name: cabin, speed: .nan}", "speed nan given; allowed: a finite number, in m/s"),
        ("{time: 1, name: cabin, force: much}", "force 'much' given; allowed: a finite number, in N"),
        ("{time: 1, name: cabin, payload: heavy}", "payload 'heavy' given; allowed: a finite number, in kg"),
        ("{time: 1, name: cabin, speed: 1" + 400 * "0" + "}", "given; allowed: a finite number, in m/s"),
        ("{time: 1, wind: .inf}", "wind inf given; allowed: a finite number, in m/s"),
        ("{time: 1, wind: 3, wind_z: up}", "wind_z 'up' given; allowed: a finite number, in m/s"),
        ("{time: 1, wind_z: 3}", "wind_z 3 given; allowed: time (s) and either name"),
        ("{time: 1, wind: 3, name: cabin}", "name 'cabin', wind 3 given; allowed: time (s) and either name"),
        ("{time: 1, wind: 3, event: reset}", "event 'reset' with wind given"),
        ("{time: 1, event: brake}", "event 'brake' given; allowed: emergency_stop, release, reset, alone"),
        ("{time: 1, event: [reset]}", "event ['reset'] given"),
        ("{time: 1, event: reset, name: cabin}", "event 'reset' with name given"),
        ("{time: 1, name: cabin, velocity: 6}", "unknown velocity; allowed"),
        ("hello", "'hello' given; allowed"),
    ],
)
def test_each_fault_has_file_and_line(tmp_path, line, said):
    path = write(tmp_path, "trip.yaml", f"- {{time: 0, name: cabin, speed: 1}}\n- {line}\n")
    with pytest.raises(ScriptError) as error:
        read_script(path)
    assert str(error.value).startswith(f"{path}:2: ")
    assert said in str(error.value)
    assert "\n" not in str(error.value)


def test_all_faults_are_told_at_once(tmp_path):
    path = write(tmp_path, "trip.csv", "time,name,speed\n-1,cabin,6\n1,cabin,fast\n2,cabin,3\n")
    with pytest.raises(ScriptError) as error:
        read_script(path)
    first, second = str(error.value).splitlines()
    assert first.startswith(f"{path}:2: time -1.0 given")
    assert second.startswith(f"{path}:3: speed 'fast' given")


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("trip.csv", "name,speed\ncabin,1\n", ":1: header 'name,speed' given; it needs time"),
        ("trip.csv", "time,name,speed,speed\n", ":1: header 'time,name,speed,speed' given; each key only once"),
        ("trip.csv", "time,name,speed\n1,cabin,2,3,4\n", ":2: 5 cells given; the header has 3"),
        ("trip.csv", "time,name,speed\n1,cabin," + 140_000 * "1" + "\n", ":2: not CSV (field larger than"),
        ("trip.yaml", "time: 1\n", ":1: a mapping given; allowed: a list of commands"),
        ("trip.yaml", "- {time: 1\n- 2", ":2: not YAML ("),
        ("trip.txt", "", ": suffix '.txt' given; allowed: .yaml, .yml or .csv"),
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
