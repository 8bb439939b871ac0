"""Snapshots read back from a log against the recorded simulation."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from bags import alter, bag, unchanged
from recorded_run import record, snapshots_of
from test_moving_cable_twin import SHORT
from twin_process import write_quick_scenario

from cable_twin.frame.rates import EVERY_FRAME, LOGGED, frames_between
from cable_twin.frame.records import AppliedCommand, Command
from cable_twin.messages.columns import COLUMNS_OF, GROUPS
from cable_twin.offline.script import ScriptedCommand
from cable_twin.recording.log_file import LogError
from cable_twin.recording.log_reader import read_log, read_snapshots
from cable_twin.scenario import load_scenario, scenario_names

SCRIPT = [
    ScriptedCommand(0.0, Command("speed", {"cabin": 4.0}), "script", ""),
    ScriptedCommand(0.115, Command("emergency_stop", {}), "script", ""),
    ScriptedCommand(0.2, Command("release", {}), "script", ""),
]


@pytest.fixture(scope="module")
def scenario(tmp_path_factory):
    return load_scenario(write_quick_scenario(tmp_path_factory.mktemp("quick")))


@pytest.fixture(scope="module")
def recorded(scenario, tmp_path_factory):
    """Run of 0.5 s with all topics of every frame, and its frames."""
    return record(tmp_path_factory.mktemp("recorded"), scenario, SCRIPT, 0.5, rates={})


def frames_due(rates):
    """Number of frames from one frame with a group to the next, by group."""
    return {group: frames_between(100.0, rates.get(group, EVERY_FRAME)) for group in GROUPS}


def assert_held(read, frame, number, due=None) -> None:
    """Check a read frame: due groups to the last bit, else the rope in single precision, all others NaN."""
    due = due or frames_due(LOGGED)
    complete = number % due["path"] == 0
    for name, expected in frame.columns._asdict().items():
        period = next((due[group] for group, names in COLUMNS_OF.items() if name in names), due["joints"])
        if not complete and number % period:
            rope = name in ("rope_position", "rope_tension") and number % due["rope"] == 0
            expected = expected.astype("f4") if rope else np.full_like(expected, np.nan)  # noqa: PLW2901
        np.testing.assert_array_equal(getattr(read.columns, name), expected, f"{name}, {read.time} s")


def test_frames_and_commands_come_back_in_order_and_to_the_last_bit(recorded):
    directory, frames = recorded
    items = list(read_snapshots(read_log(directory)))
    kinds = [item.command.kind if isinstance(item, AppliedCommand) else type(item).__name__[0] for item in items]
    assert kinds == ["S", "speed", *"S" * 11, "emergency_stop", *"S" * 9, "release", *"S" * 30, "R"]
    assert [item.time for item in items if isinstance(item, AppliedCommand)] == [0.0, 0.115, 0.2]
    for read, frame in zip(snapshots_of(directory), frames, strict=True):
        np.testing.assert_array_equal(read.numbers, frame.numbers)
        assert read.solver == frame.solver


@pytest.mark.parametrize(
    "rates", [LOGGED, {"joints": 50.0, "poses": 0.0, "forces": 10.0, "rope": 25.0, "path": 5.0}], ids=["usual", "given"]
)
def test_each_group_is_there_at_its_frames_and_nan_between(scenario, tmp_path, rates):
    directory, frames = record(tmp_path, scenario, SCRIPT, 0.5, rates=rates)
    due = frames_due(rates)
    read = snapshots_of(directory)
    assert [one.time for one in read] == [frame.time for frame in frames]
    for number, (got, frame) in enumerate(zip(read, frames, strict=True)):
        assert_held(got, frame, number, due)
    for name in ("steps", "iterations", "halvings", "energy_lost", "energy_moved"):
        logged, taken = (sum(getattr(one.solver, name) for one in run) for run in (read, frames))
        assert logged == pytest.approx(taken, rel=1e-12), f"{name}: reports are sums since the one before"


def test_carriers_come_back_from_their_columns(tmp_path):
    script = [ScriptedCommand(0.0, Command("speed", {"haul_rope": 5.0}), "script", "")]
    directory, frames = record(tmp_path, load_scenario(SHORT), script, 0.3)
    named = {topic for topic, *_ in read_log(directory).messages()}
    assert {"carriers/poses", "carriers/forces"} <= named
    assert not [topic for topic in named if topic.startswith("carriages/")]
    for number, (got, frame) in enumerate(zip(snapshots_of(directory), frames, strict=True)):
        assert_held(got, frame, number)


@pytest.mark.long
@pytest.mark.parametrize("name", scenario_names())
def test_shipped_scenario_comes_back_to_the_last_bit(tmp_path, name):
    directory, frames = record(tmp_path, load_scenario(name), [], 0.12)
    for number, (got, frame) in enumerate(zip(snapshots_of(directory), frames, strict=True)):
        assert_held(got, frame, number)


def test_a_stranger_reads_the_columns_by_their_description(recorded):
    """Reader of docs/logs.md with mcap, numpy and rosbags, without this package."""
    directory, frames = recorded
    page = Path(__file__).parents[2].joinpath("docs", "logs.md").read_text()
    (example,) = re.findall(r"```python\n(import json.*?)```", page, re.DOTALL)
    found = {}
    exec(example.replace("TIME_0.mcap", str(bag(directory))), found)
    assert found["columns"]["arc_length"] == frames[-1].columns.arc_length
    np.testing.assert_array_equal(found["columns"]["rope_position"], frames[-1].columns.rope_position)
    names = found["layout"]["names"]["bodies"]
    assert names == [*frames[-1].layout.bodies]
    np.testing.assert_array_equal(found["columns"]["body_angles"][1], frames[-1].columns.body_angles[:, 1])


SPEED = '"name": "speed", "unit": "m/s", "shape": [1]'


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ('"speed"', '"new_speed"', ""),
        ('"vehicles"', '"cars"', ""),
        (SPEED, '"name": "speed", "shape": [2]', "speed: given shape (2,); allowed: (1,)"),
        (SPEED, '"name": "speed", "shape": [1e99]', "speed: given shape"),
        (SPEED, '"name": "other", "shape": [999, 9999]', "given 9989001 numbers; allowed: at most 1000000"),
        ('"groups"', '"other"', "a JSON object with groups of columns is expected"),
        ("{", "[" * 100_000, "a JSON object with groups of columns is expected"),
    ],
    ids=["unknown", "axes", "shape", "no_shape", "many", "none", "deep"],
)
def test_columns_of_another_version_are_left_out_and_nonsense_is_named(recorded, tmp_path, old, new, expected):
    text = read_log(recorded[0]).metadata["columns"]
    assert old in text
    text = text.replace(old, new)
    other = read_log(alter(bag(recorded[0]), tmp_path / "other.mcap", unchanged, metadata={"columns": text}))
    if expected:
        with pytest.raises(LogError, match=f"other.mcap: columns are unreadable: .*{re.escape(expected)}"):
            next(read_snapshots(other))
        return
    first = next(read_snapshots(other))
    assert first.columns.arc_length == recorded[1][0].columns.arc_length
    assert np.isnan(first.columns.speed[0]) == ("new_speed" in text)


@pytest.mark.parametrize(
    ("topic", "time"),
    [("columns", 0.0), ("command", 0.0), ("key_figures", 0.5)],
)
def test_unreadable_message_is_named_with_topic_and_time(recorded, tmp_path, topic, time):
    broken = alter(
        bag(recorded[0]), tmp_path / "broken.mcap", lambda name, _, data: data[:30] if topic in name else data
    )
    with pytest.raises(LogError, match=rf"broken.mcap: {topic} at {time:.6f} s is unreadable"):
        list(read_snapshots(read_log(broken)))


def test_progress_grows_to_the_size_of_the_file(recorded):
    log = read_log(recorded[0])
    positions: list[int] = []
    list(read_snapshots(log, on_position=positions.append))
    assert positions == sorted(positions)
    assert 0 < positions[0] <= positions[-1] <= log.size
    assert log.end == 0.5
