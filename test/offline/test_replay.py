"""`replay`: exact simulation of a run from its log alone, and detection of changed logs."""

from __future__ import annotations

import re
import time
from contextlib import suppress
from pathlib import Path

import numba
import numpy as np
import pytest
from bags import alter, bag, unchanged
from golden_log import GOLDEN
from twin_process import run_module, run_python, write_quick_scenario

from cable_twin.basics.cpu import CLASSES, class_of, machine, this_cpu
from cable_twin.frame.records import Command, CommandError
from cable_twin.mechanics.language.target import target
from cable_twin.messages import SCENARIO, MessageEncoder, decode, serialize, topics
from cable_twin.messages.command_messages import applied_command_message
from cable_twin.offline.replay import main
from cable_twin.recording.log_reader import read_log
from cable_twin.recording.log_writer import FORMAT_VERSION
from cable_twin.recording.run import start_run
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation

EPOCH = 1_700_000_000_123_456_789  # ns
FRAME_STEPS = 2  # of 5 ms
KINDS = ("speed", "force", "wind", "temperature", "payload", "emergency_stop", "release", "reset")
SHARES = (0.4, 0.2, 0.1, 0.05, 0.05, 0.05, 0.1, 0.05)
DRIVE = {
    "haul_rope": {"axial_stiffness": 9e7, "mass_per_length": 7.0, "drive_inertia": 3e4, "pretension": 6e4},
    "emergency_brake": {"force": 6e4, "rise_time": 0.4},
    "track_rope_brake": {"force": 4e4, "rise_time": 0.3},
    "emergency_stop": ["emergency_brake", "track_rope_brake"],
}


def random_command(kind: str, random: np.random.Generator, space: int = 2) -> Command:
    """Random command of a kind, mostly a valid one."""
    if kind == "temperature":
        return Command(kind, {"ropes": float(random.uniform(-20.0, 40.0))})
    if kind == "wind":
        wind = {"x": float(random.uniform(-15.0, 15.0)), "z": float(random.uniform(-2.0, 2.0))}
        return Command(kind, wind if space == 2 else {**wind, "y": float(random.uniform(-15.0, 15.0))})
    span = {"speed": (-8.0, 8.0), "force": (0.0, 4e4), "payload": (0.0, 6400.0)}.get(kind)
    return Command(kind, {} if span is None else {"cabin": float(random.uniform(*span))})


def record(directory: Path, seconds: float, *, seed: int, space: int = 2) -> Path:
    """Record a run without ROS as fast as possible, with commands of all kinds at random frame boundaries."""
    drive = {f"carriages.cabin.drive.{key}": value for key, value in DRIVE.items()}
    simulation = Simulation(load_scenario(write_quick_scenario(directory, space), drive))
    table = topics(simulation.layout)
    period = FRAME_STEPS * simulation.step
    run = start_run(simulation, table, record_directory=directory, frame_period=period, rerun="none")
    run.begin(EPOCH)
    encoder = MessageEncoder(simulation.layout, EPOCH)
    random = np.random.default_rng(seed)

    def put_frame() -> None:
        stamp_ns = encoder.stamp_ns(simulation.snapshot)
        run.recorder.record(encoder.frame(simulation.snapshot), stamp_ns, simulation.snapshot)

    put_frame()
    for frame in range(round(seconds / period)):
        if frame == 0 or random.random() < 0.1:
            kind = "payload" if frame == 0 else random.choice(KINDS, p=SHARES)
            with suppress(CommandError):  # while the emergency stop is in force, or outside the station
                applied = simulation.apply(random_command(kind, random, space))
                data = applied_command_message(applied, EPOCH)
                run.recorder.record_command(applied, data, EPOCH + round(applied.time * 1e9))
        simulation.advance_to((frame + 1) * period)
        put_frame()
    run.recorder.close()
    assert not run.recorder.faults
    assert run.recorder.dropped == 0
    return run.directory


def test_a_cabin_in_side_wind_replays_to_the_last_bit(tmp_path, replayed):
    recorded = record(tmp_path, 8.0, seed=3, space=3)
    winds = [applied.command.values for applied in read_log(recorded).commands if applied.command.kind == "wind"]
    assert any(wind.get("y") for wind in winds)
    replayed(recorded)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """Directory of a run of 14 s with commands of every kind."""
    return record(tmp_path_factory.mktemp("recorded"), 14.0, seed=1)


def test_thirty_seconds_of_varied_commands_agree_to_the_last_bit(tmp_path):
    recorded = record(tmp_path, 30.0, seed=1)
    log = read_log(recorded)
    assert {applied.command.kind for applied in log.commands} == set(KINDS)
    assert len(log.commands) > 150
    result = run_module("offline.replay", str(recorded), directory=tmp_path)  # another process
    assert result.returncode == 0, result.stdout + result.stderr
    assert result.stdout.splitlines()[-1] == "every sample agrees to the last bit"
    assert re.search(r"joint_states +3001 samples, +0 differ", result.stdout)
    assert re.search(r"cable +3001 samples, +0 differ", result.stdout)
    assert f"30.00 s, {len(log.commands)} commands" in result.stdout
    assert result.stderr == ""


def test_replay_is_faster_than_the_run(recorded):
    started = time.monotonic()
    assert main([str(recorded)]) == 0
    assert time.monotonic() - started < 14.0


@pytest.mark.parametrize("chosen", [5, pytest.param(15, marks=pytest.mark.long)])
def test_altered_command_is_found_with_time_and_topic(recorded, tmp_path, capsys, chosen):
    speeds = [applied for applied in read_log(recorded).commands if applied.command.kind == "speed"]
    applied = speeds[chosen]
    original = applied_command_message(applied, EPOCH)
    other = Command("speed", {"cabin": -applied.command.values["cabin"]})
    replacement = applied_command_message(type(applied)(applied.time, other, applied.source), EPOCH)
    target = tmp_path / "altered.mcap"
    alter(bag(recorded), target, lambda topic, _, data: replacement if data == original else data)
    assert main([str(target)]) == 1
    output = capsys.readouterr().out
    match = re.search(
        r"^first difference at ([\d.]+) s on (\S+), (.+): logged (\S+), replayed (\S+)$", output, re.MULTILINE
    )
    assert match, output
    assert applied.time < float(match[1]) < applied.time + 0.1
    assert match[2] == "columns"
    assert match[3] in ("arc_length[cabin]", "speed[cabin]", "drive_force[cabin]", "commanded_speed[cabin]")
    assert float(match[4]) != float(match[5])
    assert "every sample agrees" not in output


def test_left_out_command_is_found(recorded, tmp_path, capsys):
    target = tmp_path / "altered.mcap"
    first = applied_command_message(read_log(recorded).commands[0], EPOCH)
    alter(bag(recorded), target, lambda topic, _, data: None if data == first else data)
    assert main([str(target)]) == 1
    assert "first difference at" in capsys.readouterr().out


def nudge(topic, message_type, field, change):
    """Change the second number of a field of one message; in `columns` after the time, the place of the cabin."""

    def altered(name, stamp_ns, data):
        if name == topic and stamp_ns == EPOCH + 12_340_000_000:
            message = decode(data, message_type)
            setattr(message, field, getattr(message, field).copy())
            getattr(message, field)[1] = change(getattr(message, field)[1])
            return serialize(message)
        return data

    return altered


def nudge_place(change):
    return nudge("columns", "std_msgs/msg/Float64MultiArray", "data", change)


def test_single_altered_number_is_found_to_the_last_bit(recorded, tmp_path, capsys):
    target = alter(bag(recorded), tmp_path / "altered.mcap", nudge_place(lambda place: np.nextafter(place, np.inf)))
    assert main([str(target)]) == 1
    output = capsys.readouterr().out
    assert "first difference at 12.340000 s on columns, arc_length[cabin]: logged " in output
    assert re.search(r"columns +1401 samples, +1 differ", output)
    assert main([str(target), "--tolerance", "1e-9"]) == 0
    assert "every sample agrees within the tolerance of 1e-09; largest difference: " in capsys.readouterr().out


def test_altered_message_beside_the_numbers_is_found(recorded, tmp_path, capsys):
    change = nudge("joint_states", "sensor_msgs/msg/JointState", "velocity", lambda speed: np.nextafter(speed, np.inf))
    target = alter(bag(recorded), tmp_path / "altered.mcap", change)
    assert main([str(target)]) == 1
    output = capsys.readouterr().out
    assert re.search(r"12.340000 s on joint_states, message: logged 'sha256 \w+', replayed 'sha256 \w+'", output)
    assert re.search(r"joint_states +1401 samples, +1 differ", output)
    assert re.search(r"columns +1401 samples, +0 differ", output)


def test_unaltered_copy_agrees(recorded, tmp_path):
    target = tmp_path / "copy.mcap"
    alter(bag(recorded), target, unchanged)
    assert main([str(target)]) == 0


def test_truncated_bag_replays_as_far_as_it_goes(recorded, tmp_path, capsys):
    content = bag(recorded).read_bytes()
    target = tmp_path / "cut.mcap"
    target.write_bytes(content[: len(content) * 2 // 3])
    assert main([str(target)]) == 0
    output = capsys.readouterr().out
    assert "cut short" in output
    assert int(re.search(r"joint_states +(\d+) samples", output)[1]) > 500


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda topic, _, data: data if topic == SCENARIO else None, "it contains no frame of the twin"),
        (lambda topic, _, data: None if topic == SCENARIO else data, "no scenario in it"),
        (lambda topic, _, data: None, "empty: no message was written"),
        (lambda topic, _, data: data[:-30] if topic == SCENARIO else data, "scenario is unreadable"),
        (lambda topic, _, data: data[:20] if topic == "applied_commands" else data, "is unreadable"),
        (lambda topic, _, data: data[:40] if topic == "columns" else data, "columns at 0.000000 s is unreadable"),
    ],
    ids=["no_frames", "no_scenario", "no_messages", "broken_scenario", "broken_command", "broken_sample"],
)
def test_log_that_lacks_what_a_replay_needs_is_named_in_a_line(recorded, tmp_path, refusal, change, said):
    target = alter(bag(recorded), tmp_path / "altered.mcap", change, metadata={"scenario_text": ""})
    line = refusal(main, target)
    assert line.startswith(f"replay: {target}: ")
    assert said in line


@pytest.mark.parametrize("value", ["-1", "nan", "much"])
def test_bad_tolerance_is_refused(refusal, value):
    assert f"--tolerance: given '{value}'; allowed: a number" in refusal(main, "run.mcap", "--tolerance", value)


def test_it_says_what_made_the_log(recorded, capsys):
    assert main([str(recorded)]) == 0
    output = capsys.readouterr().out
    metadata = read_log(recorded).metadata
    assert (
        f"made by: cable_twin {metadata['package_version']}, numba {metadata['numba_version']}, numpy "
        f"{metadata['numpy_version']}, machine {metadata['machine']}, CPU {metadata['cpu']}, "
        f"arithmetic {metadata['arithmetic']}, format {FORMAT_VERSION}"
    ) in output
    assert "here:" not in output
    assert re.search(r"scenario: quick, sha256 [0-9a-f]{12}$", output, re.MULTILINE)
    assert re.search(r"commands: .*\d+ emergency_stop.* from \d+ python, sha256 [0-9a-f]{12}$", output, re.MULTILINE)


@pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="nothing is compiled for a CPU")
def test_a_log_replays_to_the_last_bit_on_another_cpu_of_the_class(recorded):
    """Its kernels are those of this one: nothing is compiled."""
    assert read_log(recorded).metadata["cpu"] == target().name
    if target().name not in {known.target.name for known in CLASSES.values()}:
        pytest.skip("this CPU is of no class")
    result = run_python("-m", "cable_twin.offline.replay", recorded, variables={"NUMBA_CPU_NAME": "skylake"})
    assert result.returncode == 0, result.stdout + result.stderr
    assert "every sample agrees to the last bit" in result.stdout
    assert "here:" not in result.stdout
    assert "compil" not in result.stderr


@pytest.mark.parametrize(("name", "is_held"), [("-m", True), ("-c", False)])
def test_a_command_as_a_module_has_the_arithmetic_of_the_command(monkeypatch, name, is_held):
    """`python -m` has that name of a program until its module is found; a program that imports one is left alone."""
    if (known := class_of(machine(), this_cpu())) is None:
        pytest.skip("this CPU is of no known class")
    monkeypatch.delenv("OPENBLAS_CORETYPE", raising=False)
    code = f"import os, sys; sys.argv = [{name!r}]; import cable_twin.offline; print(os.getenv('OPENBLAS_CORETYPE'))"
    result = run_python("-c", code)
    assert result.stdout.split() == [known.core if is_held else "None"], result.stderr


def test_log_of_another_machine_is_compared_to_the_stated_tolerance(recorded, tmp_path, capsys):
    other = {"cpu": "elsewhere", "numpy_version": "0.1"}
    near = alter(bag(recorded), tmp_path / "near.mcap", nudge_place(lambda place: place * (1.0 + 1e-9)), metadata=other)
    assert main([str(near)]) == 0
    output = capsys.readouterr().out
    assert "CPU elsewhere" in output
    assert re.search(r"here: +numpy [\d.]+, CPU [\w-]+$", output, re.MULTILINE)
    assert "every sample agrees within the tolerance of 1e-06; largest difference: 1" in output
    assert main([str(near), "--tolerance", "0"]) == 1
    assert "the tolerance is 0" in capsys.readouterr().out
    far = alter(bag(recorded), tmp_path / "far.mcap", nudge_place(lambda place: place * (1.0 + 1e-5)), metadata=other)
    assert main([str(far)]) == 1
    output = capsys.readouterr().out
    assert "the tolerance is 1e-06" in output
    assert "it was made with another numpy, CPU: rounding grows" in output


def test_newer_format_is_named_as_such(recorded, tmp_path, refusal):
    target = alter(bag(recorded), tmp_path / "newer.mcap", unchanged, metadata={"format_version": "6"})
    assert "format version 6 is newer than this cable_twin reads (5); update cable_twin" in refusal(main, target)


def test_a_log_of_an_earlier_version_of_the_package_keeps_replaying():
    """Tolerance of 0.01 %: room for another solution method, none for another motion."""
    assert main([str(GOLDEN), "--tolerance", "1e-4"]) == 0


def test_the_golden_log_has_the_present_format():
    assert read_log(GOLDEN).metadata["format_version"] == FORMAT_VERSION
