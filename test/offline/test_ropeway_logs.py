"""Logs of towers, counterweight, haul rope, brakes, loads and carriers: simulated, read, replayed, reviewed."""

from __future__ import annotations

import numpy as np
import pytest
from recorded_run import record, snapshots_of
from small_tramway import TRAMWAY
from test_moving_cable_twin import SHORT

from cable_twin.frame.records import Command
from cable_twin.messages import decode
from cable_twin.offline import review
from cable_twin.offline.script import ScriptedCommand, check_script
from cable_twin.recording.log_reader import read_log
from cable_twin.scenario import load_scenario

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


@pytest.mark.parametrize("which", ["tramway", "lift"])
def test_it_replays_to_the_last_bit(which, request, replayed):
    directory, _ = request.getfixturevalue(which)
    output = replayed(directory)
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
