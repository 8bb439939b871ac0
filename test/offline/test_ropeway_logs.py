"""Logs of towers, counterweight, haul rope, brakes, loads, carriers, bullwheels and wind: simulated, read, replayed,
reviewed."""

from __future__ import annotations

import csv
import json
import shutil

import numpy as np
import pytest
from recorded_run import record, snapshots_of
from small_tramway import IN_SPACE, TRAMWAY
from test_moving_cable_twin import SHORT
from twin_process import LOG_EVERY_FRAME

from cable_twin.frame.records import Command
from cable_twin.frame.snapshot import COMMANDED, Columns
from cable_twin.key_figures import QUANTITIES, KeyFigures
from cable_twin.messages import decode
from cable_twin.offline import review, simulate
from cable_twin.offline.script import ScriptedCommand, check_script
from cable_twin.recording.log_reader import read_log
from cable_twin.runtime.watches import FigureWatch
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation

TRIP = [
    (0.1, Command("payload", {"cabin": 120.0})),
    (0.2, Command("speed", {"cabin": 6.0})),
    (3.0, Command("wind", {"x": -9.0, "z": 1.0})),
    (13.5, Command("emergency_stop", {})),
    (15.2, Command("release", {})),
    (15.4, Command("speed", {"cabin": -3.0})),
    (17.0, Command("reset", {})),
    (17.5, Command("speed", {"cabin": 1.0})),
]
RIDE = [
    (0.5, Command("speed", {"haul_rope": 5.0})),
    (9.0, Command("emergency_stop", {})),
    (14.0, Command("release", {})),
    (14.5, Command("speed", {"haul_rope": -4.0})),
    (17.0, Command("reset", {})),
    (18.0, Command("speed", {"haul_rope": -3.0})),
]
COARSE = ("--set", "ropes.up.elements=150", "--set", "ropes.down.elements=150")
END = 4.0  # s of the whole lift
GUST = 1.0  # s, when the wind rises
ENERGY_LOST = QUANTITIES["energy_lost"].name
BEGIN, DURATION = 0.5, 12.0  # s of a start


def logged(directory, given, commands, duration, rerun="none"):
    """Log of a run with all topics of every frame, and its snapshots."""
    scenario = load_scenario(given)
    script = [ScriptedCommand(time, command, "script", "") for time, command in commands]
    assert check_script(scenario, script) == []
    return record(directory, scenario, script, duration, 0.02, rerun, rates={})


@pytest.fixture(scope="module")
def tramway(tmp_path_factory):
    return logged(tmp_path_factory.mktemp("tramway"), TRAMWAY, TRIP, 20.0)


@pytest.fixture(scope="module")
def lift(tmp_path_factory):
    return logged(tmp_path_factory.mktemp("lift"), {**SHORT, "name": "short_lift"}, RIDE, 20.0, "file")


def test_the_cabin_went_over_the_tower_and_all_is_read_back(tramway):
    directory, frames = tramway
    assert max(frame.carriages["cabin"].arc_length for frame in frames) > 62.0
    read = snapshots_of(directory)
    assert len(read) == len(frames) == 1001
    for got, frame in zip(read, frames, strict=True):
        assert list(got.supports) == list(frame.supports) == ["start", "end", "tower_1"]
        for name, support in frame.supports.items():
            np.testing.assert_array_equal(got.supports[name].force, support.force)
        assert got.supports["end"].travel == pytest.approx(frame.supports["end"].travel, abs=1e-4)
        assert got.supports["start"].travel is None
        for column in ("command_kind", "commanded_speed", "reference_position", "reference_speed", "force_limit"):
            np.testing.assert_array_equal(getattr(got.columns, column), getattr(frame.columns, column))
        assert got.carriages["cabin"].payload == frame.carriages["cabin"].payload
        tower, expected = got.supports["tower_1"].tower, frame.supports["tower_1"].tower
        assert tower.normal_load == pytest.approx(expected.normal_load, rel=0.03)
        assert tower.margin == pytest.approx(expected.margin, rel=0.03)
        assert tower.lifted_off is expected.lifted_off


def test_carriers_and_their_drive_are_read_back(lift):
    directory, frames = lift
    for got, frame in zip(snapshots_of(directory), frames, strict=True):
        assert got.drives == frame.drives
        for column in ("command_kind", "commanded_speed", "commanded_force", "reference_position", "reference_speed"):
            name = f"drive_{column}"
            np.testing.assert_array_equal(getattr(got.columns, name), getattr(frame.columns, name))
        assert {name: chair.attached for name, chair in got.carriages.items()} == {
            name: chair.attached for name, chair in frame.carriages.items()
        }
        assert [chair.arc_length for chair in got.carriages.values()] == [
            chair.arc_length for chair in frame.carriages.values()
        ]
    assert len({name for frame in frames for name, chair in frame.carriages.items() if not chair.attached}) > 3
    log = read_log(directory)
    assert [(applied.time, applied.command) for applied in log.commands] == RIDE
    last = [decode(data, "sensor_msgs/msg/JointState") for _, _, data in log.messages(["joint_states"])][-1]
    assert last.name[6] == "haul_rope"
    assert last.velocity[6] == pytest.approx(-1.0, abs=0.02)  # for 2 s at 0.5 m/s² from rest


@pytest.mark.parametrize("which", ["tramway", "lift", "whole_lift", "windy"])
def test_it_replays_to_the_last_bit(which, request, replayed):
    found = request.getfixturevalue(which)
    output = replayed(found if which == "windy" else found[0])
    if which == "tramway":
        assert "supports/tower_1/force " in output


@pytest.mark.parametrize("which", ["tramway", "lift"])
def test_review_prints_and_draws_it(which, request, tmp_path, capsys):
    directory, _ = request.getfixturevalue(which)
    assert review.main([str(directory), "--no-viewer", "--plots", str(tmp_path / "pictures")]) == 0
    output = capsys.readouterr().out
    assert "nan" not in output
    assert {file.name for file in (tmp_path / "pictures").iterdir()} >= {"rope.png", "tension.png", "speed.png"}
    expected = {
        "tramway": ["tower_1: deropement margin", "end: counterweight travel, highest", "cabin: clearance over the"],
        "lift": ["haul_rope: stopping distance", "chair: swing along the track"],
    }
    for name in expected[which]:
        assert name in output
    assert "chair_1: " not in output


def test_two_lifts_are_compared_by_the_chair_that_differs_most(lift, tmp_path, capsys):
    slower, _ = logged(tmp_path, {**SHORT, "name": "short_lift"}, [(0.5, Command("speed", {"haul_rope": 2.0}))], 3.0)
    assert review.main([str(lift[0]), str(slower), "--no-viewer"]) == 0
    output = capsys.readouterr().out
    (row,) = [line for line in output.splitlines() if line.strip().startswith("swing/chair_")]
    assert row.split()[-5] == "deg"
    assert "of chair_1 to chair_6, only the one with the largest difference is shown" in output
    assert "speed/haul_rope" in output


def test_a_payload_that_no_motion_makes_possible_is_found_before_the_run():
    script = [
        ScriptedCommand(1.0, Command("payload", {"cabin": 401.0}), "script", "trip.yaml:1"),
        ScriptedCommand(2.0, Command("wind", {"x": 200.0, "z": 0.0}), "script", "trip.yaml:2"),
        ScriptedCommand(3.0, Command("payload", {"cabin": 10.0}), "script", "trip.yaml:3"),
    ]
    assert check_script(load_scenario(TRAMWAY), script) == [
        "trip.yaml:1: payload of 'cabin': given 401 kg; allowed: 0 to 400 kg",
        "trip.yaml:2: wind x: given 200 m/s; allowed: -100 to 100 m/s",
    ]


@pytest.fixture(scope="module")
def whole_lift(tmp_path_factory):
    """Directory and printed output of a run with a start and an emergency stop."""
    directory = tmp_path_factory.mktemp("whole_lift")
    script = directory / "lift.yaml"
    script.write_text("- {time: 0, name: haul_rope, speed: 2.5}\n- {time: 2, event: emergency_stop}\n")
    arguments = ["chairlift", *COARSE, "--script", str(script), "--duration", str(END), *LOG_EVERY_FRAME]
    arguments += ["--output", str(directory / "logs"), "--json", str(directory / "run.json")]
    assert simulate.main(arguments) == 0
    return next((directory / "logs").iterdir()), json.loads((directory / "run.json").read_text())["runs"][0]


def test_review_has_the_figures_of_the_run(whole_lift, tmp_path):
    directory, told = whole_lift
    seen, pictures = tmp_path / "seen.json", tmp_path / "pictures"
    arguments = [str(directory), "--no-viewer", "--json", str(seen), "--plots", str(pictures)]
    assert review.main(arguments) == 0
    again = json.loads(seen.read_text())["runs"][0]
    for mine, theirs in ((told, again), (again, told)):
        values = {one["key_figure"]: one["value"] for one in mine["key_figures"]}
        for figure in theirs["key_figures"]:
            if "chair: " not in figure["key_figure"]:  # of which a log has single precision
                assert values[figure["key_figure"]] == pytest.approx(figure["value"], rel=1e-5, abs=1e-6), figure[
                    "key_figure"
                ]
    names = {one["key_figure"] for one in told["key_figures"]}
    assert {"haul_rope: stopping time", "drive: adhesion used of available", "drive: drive torque, highest"} <= names
    assert {"return: counterweight travel, lowest", "down: load of carriers, highest"} <= names
    assert "sheave_tension/drive_on [N]" in told["signals"]["columns"]
    assert (pictures / "sheaves.png").is_file()


def test_bullwheels_and_strands_come_back_to_the_last_bit_and_to_the_side(whole_lift):
    directory, _ = whole_lift
    last = snapshots_of(directory)[-1]
    overrides = {"ropes.up.elements": 150, "ropes.down.elements": 150}
    simulation = Simulation(load_scenario("chairlift", overrides))
    simulation.command("haul_rope", speed=2.5)
    simulation.advance_to(2.0)
    simulation.emergency_stop()
    there, here = simulation.advance_to(END).columns, last.columns
    assert there.drive_command_kind == COMMANDED.index("emergency stop")
    told = [name for name in Columns._fields if name.startswith(("drive_comm", "drive_ref"))]
    assert len(told) == 5
    for name in (
        *told,
        "sheave_position",
        "sheave_speed",
        "sheave_force",
        "sheave_tension",
        "sheave_slip",
        "sheave_travel",
    ):
        np.testing.assert_array_equal(getattr(here, name), getattr(there, name))
    np.testing.assert_array_equal(here.vehicle_rope, there.vehicle_rope)
    np.testing.assert_allclose(here.arc_length, there.arc_length, atol=1e-9)
    np.testing.assert_array_equal(here.body_position, there.body_position)
    sides = np.where(here.vehicle_rope == 0.0, 2.1, -2.1)
    np.testing.assert_array_equal(here.body_position[:, 1], sides)
    samples = np.where(last.layout.sample_ropes == 0, 2.1, -2.1)
    np.testing.assert_array_equal(there.rope_position[:, 1], samples)


@pytest.fixture(scope="module")
def windy(tmp_path_factory):
    """Directory of a run of three seconds with wind from the right."""
    directory = tmp_path_factory.mktemp("space")
    (directory / "windy.yaml").write_text(load_scenario(IN_SPACE).to_yaml())
    (directory / "gust.yaml").write_text(f"- {{time: {GUST}, wind: 2.0, wind_y: 14.0}}\n")
    script = ["--script", str(directory / "gust.yaml"), "--duration", "3"]
    logs = ["--record", "bag", "--output", str(directory / "logs")]
    assert simulate.main([str(directory / "windy.yaml"), *script, *logs]) == 0
    (found,) = (directory / "logs").iterdir()
    return found


def test_roll_yaw_and_wind_come_back(windy):
    simulation = Simulation(load_scenario(IN_SPACE))
    frames = snapshots_of(windy)
    compared = 0
    for frame in frames:
        if simulation.time < GUST <= frame.time:
            simulation.advance_to(GUST)
            simulation.wind(2.0, 0.0, 14.0)
        snapshot = simulation.advance_to(frame.time)
        wind = [0.0, 0.0, 0.0] if frame.time < GUST else [2.0, 14.0, 0.0]
        if frame.time != GUST:
            np.testing.assert_array_equal(frame.columns.wind, wind)
        if not np.isnan(frame.columns.body_angles).any():
            np.testing.assert_allclose(frame.columns.body_angles, snapshot.columns.body_angles, atol=1e-12)
            compared += 1
    assert compared > 30


def test_review_plots_and_exports_what_goes_across(windy, tmp_path):
    pytest.importorskip("matplotlib")
    files = ["--plots", str(tmp_path / "plots"), "--csv", str(tmp_path / "run.csv")]
    assert review.main([str(windy), "--no-viewer", *files]) == 0
    assert (tmp_path / "plots" / "across.png").stat().st_size > 20_000
    rows = list(csv.DictReader((tmp_path / "run.csv").open()))
    rolls = [float(row["roll/cabin/cabin [deg]"]) for row in rows if row["roll/cabin/cabin [deg]"]]
    assert max(rolls) > 1.0
    assert float(rows[-1]["wind/y [m/s]"]) == 14.0
    assert max(float(row["lateral/cabin/cabin [m]"]) for row in rows if row["lateral/cabin/cabin [m]"]) > 0.1


def test_runs_are_compared_in_space_too(windy, tmp_path, no_display):
    pytest.importorskip("rerun")
    from rerun.chunk import RrdReader  # noqa: PLC0415

    copies = [shutil.copytree(windy, tmp_path / name) for name in ("calm", "windy")]
    assert review.main([*map(str, copies)]) == 0
    (recording,) = copies[0].glob("*.rrd")
    entities = {chunk.entity_path for chunk in RrdReader(recording).stream()}
    for root in "ab":
        assert {f"/{root}/space/rope", f"/{root}/space/carriages/cabin/cabin", f"/{root}/plots/wind"} <= entities


@pytest.mark.parametrize("tramway", [pytest.param(TRAMWAY, marks=pytest.mark.long), IN_SPACE], ids=["plane", "space"])
def test_a_running_twin_and_the_log_of_its_run_have_one_verdict(tramway, tmp_path, capsys):
    """No alarm from the first steps of a motion, which lose a large share of little energy."""
    scenario = load_scenario(tramway, {"solver.step": 0.02})
    path, script = tmp_path / "tramway.yaml", tmp_path / "start.yaml"
    path.write_text(scenario.to_yaml(), encoding="utf-8")
    script.write_text(f"- {{time: {BEGIN}, name: cabin, speed: 3.0}}\n", encoding="utf-8")
    arguments = [str(path), "--script", str(script), "--duration", str(DURATION), "--frame-rate", "50"]
    assert simulate.main([*arguments, "--record", "bag", "--output", str(tmp_path / "runs")]) == 0
    (run,) = (tmp_path / "runs").iterdir()
    assert review.main([str(run), "--no-viewer", "--json", str(tmp_path / "run.json")]) == 0
    assert ENERGY_LOST not in capsys.readouterr().err
    (reviewed,) = json.loads((tmp_path / "run.json").read_text())["runs"]
    (found,) = [figure for figure in reviewed["key_figures"] if figure["id"] == "energy_lost/solver/highest"]

    simulation = Simulation(scenario)
    watch, levels = FigureWatch(KeyFigures(scenario)), set()
    watch.update(simulation.snapshot)
    for frame in range(1, round(50.0 * DURATION) + 1):
        if frame == round(50.0 * BEGIN) + 1:
            watch.command(simulation.command("cabin", speed=3.0))
        watch.update(simulation.advance_to(0.02 * frame))
        statuses = {status.name: status for status in watch.statuses()}
        levels |= {statuses[ENERGY_LOST].level} if ENERGY_LOST in statuses else set()
    assert levels == {0}  # at no moment a warning
    assert not [line for line in watch.take_messages() if ENERGY_LOST in line]
    assert found["kept"] is True
    assert found["value"] == pytest.approx(float(statuses[ENERGY_LOST].values["value"]), rel=1e-9)
