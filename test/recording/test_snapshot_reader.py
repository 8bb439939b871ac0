"""What a log gives back against the simulation that wrote it."""

from __future__ import annotations

import numpy as np
import pytest
from bags import alter, bag
from test_moving_cable_twin import SHORT
from twin_process import write_quick_scenario

from cable_twin.frame.records import AppliedCommand, Command
from cable_twin.frame.snapshot import Snapshot
from cable_twin.key_figures import KeyFigures
from cable_twin.messages import topics
from cable_twin.offline.script import ScriptedCommand
from cable_twin.offline.scripted_run import simulate
from cable_twin.recording.log_reader import read_log
from cable_twin.recording.log_versions import LogError
from cable_twin.recording.run import start_run
from cable_twin.recording.snapshot_reader import read_snapshots
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation

LAST_BITS = 1e-15  # rad, rad/s; of sums of joints
EPOCH = 1_700_000_000_123_456_789  # ns
SCRIPT = [
    ScriptedCommand(0.0, Command("speed", {"cabin": 4.0}), "script", ""),
    ScriptedCommand(0.115, Command("emergency_stop", {}), "script", ""),
    ScriptedCommand(0.2, Command("release", {}), "script", ""),
]


def record(directory, scenario, script, duration, **options):
    """A run at 100 Hz, and its frames as they were handed over."""
    simulation = Simulation(scenario)
    table = topics(simulation.layout)
    run = start_run(simulation, table, record_directory=directory, frame_period=0.01, rerun="none")
    run.begin(EPOCH)
    figures = KeyFigures(scenario)
    frames = []
    outcome = simulate(
        simulation,
        script,
        duration=duration,
        frame_steps=round(0.01 / simulation.step),
        epoch_ns=EPOCH,
        run=run,
        figures=figures,
        on_frame=lambda _: frames.append(simulation.snapshot),
        **options,
    )
    run.recorder.close()
    assert (outcome.applied, outcome.refused, outcome.fault, run.recorder.faults) == (len(script), [], "", [])
    return run.directory, frames


@pytest.fixture(scope="module")
def scenario(tmp_path_factory):
    return load_scenario(write_quick_scenario(tmp_path_factory.mktemp("quick")))


@pytest.fixture(scope="module")
def recorded(scenario, tmp_path_factory):
    """A run of 0.5 s with all of every frame, and its frames as the simulation gives them again."""
    directory, _ = record(tmp_path_factory.mktemp("recorded"), scenario, SCRIPT, 0.5, rates={})
    again = Simulation(scenario)
    waiting = list(SCRIPT)
    frames = []
    for frame in range(51):
        while waiting and waiting[0].time < frame * 0.01:
            item = waiting.pop(0)
            again.advance_to(item.time)
            again.apply(item.command)
        frames.append(again.advance_to(frame * 0.01))
    return directory, frames


def snapshots_of(directory):
    return [item for item in read_snapshots(read_log(directory)) if isinstance(item, Snapshot)]


def test_frames_and_commands_come_back_in_order(recorded):
    directory, frames = recorded
    items = list(read_snapshots(read_log(directory)))
    kinds = [item.command.kind if isinstance(item, AppliedCommand) else type(item).__name__[0] for item in items]
    assert kinds == ["S", "speed", *"S" * 11, "emergency_stop", *"S" * 9, "release", *"S" * 30, "R"]
    assert [item.time for item in items if isinstance(item, AppliedCommand)] == [0.0, 0.115, 0.2]
    snapshots = [item for item in items if isinstance(item, Snapshot)]
    assert len(snapshots) == len(frames)
    for read, frame in zip(snapshots, frames, strict=True):
        assert read.time == frame.time
        np.testing.assert_array_equal(read.cable.positions, frame.cable.positions.astype("f4"))
        np.testing.assert_array_equal(read.cable.tensions, frame.cable.tensions.astype("f4"))
        np.testing.assert_array_equal(read.cable.arc_lengths, frame.cable.arc_lengths)
        for name, support in frame.supports.items():
            np.testing.assert_array_equal(read.supports[name].force, support.force)
        state, expected = read.carriages["cabin"], frame.carriages["cabin"]
        assert (state.arc_length, state.speed) == (expected.arc_length, expected.speed)
        assert state.drive_force == expected.drive_force
        np.testing.assert_array_equal(state.contact_force, expected.contact_force)
        np.testing.assert_array_equal(state.position, expected.position)
        assert list(state.bodies) == list(expected.bodies)
        for name, body in expected.bodies.items():
            got = state.bodies[name]
            assert (got.x, got.z) == (body.x, body.z)
            assert got.pitch == pytest.approx(body.pitch, abs=LAST_BITS)
            assert got.angular_velocity[1] == pytest.approx(body.angular_velocity[1], abs=LAST_BITS)


JOINTS = ("arc_length", "speed", "drive_force", "drive_position", "drive_speed", "moving_cable_force", "attached")
PLACES = ("joint_position", "body_position", "body_orientation")
FORCES = ("contact_force", "support_force")
ROPE = ("rope_position", "rope_tension")


def assert_columns(read, frame, names, *, held: bool, single=()) -> None:
    """What was held comes back to the last bit, of single precision where it is logged so; the rest is NaN."""
    for name in names:
        got, expected = getattr(read.columns, name), getattr(frame.columns, name)
        kept = expected.astype("f4") if name in single else expected
        np.testing.assert_array_equal(got, kept if held else np.full_like(expected, np.nan), f"{name}, {read.time} s")


def test_each_group_is_there_at_its_frames_and_nan_between(scenario, tmp_path):
    directory, frames = record(tmp_path, scenario, SCRIPT, 0.5)
    read = snapshots_of(directory)
    assert [one.time for one in read] == [frame.time for frame in frames]
    for number, (got, frame) in enumerate(zip(read, frames, strict=True)):
        assert_columns(got, frame, JOINTS, held=True)
        for name in ("body_angles", "body_angular_velocity"):
            expected = getattr(frame.columns, name)[:, 1]
            np.testing.assert_allclose(getattr(got.columns, name)[:, 1], expected, rtol=0.0, atol=LAST_BITS)
        assert_columns(got, frame, (*PLACES, *FORCES), held=number % 5 == 0)  # 20 of 100 Hz
        assert_columns(got, frame, ROPE, held=number % 10 == 0, single=ROPE)


def test_rates_that_are_asked_for_are_those_that_come_back(scenario, tmp_path):
    rates = {"joints": 50.0, "poses": 0.0, "forces": 10.0, "rope": 25.0}
    directory, frames = record(tmp_path, scenario, [], 0.2, rates=rates)
    for number, (got, frame) in enumerate(zip(snapshots_of(directory), frames, strict=True)):
        assert_columns(got, frame, JOINTS, held=number % 2 == 0)
        assert_columns(got, frame, PLACES, held=True)
        assert_columns(got, frame, FORCES, held=number % 10 == 0)
        assert_columns(got, frame, ROPE, held=number % 4 == 0, single=ROPE)


def test_carriers_come_back_from_their_columns(tmp_path):
    script = [ScriptedCommand(0.0, Command("speed", {"haul_rope": 5.0}), "script", "")]
    directory, frames = record(tmp_path, load_scenario(SHORT), script, 0.3)
    named = {topic for topic, *_ in read_log(directory).messages()}
    assert {"carriers/poses", "carriers/forces"} <= named
    assert not [topic for topic in named if topic.startswith("carriages/")]
    single = ("joint_position", "contact_force", *ROPE)
    for number, (got, frame) in enumerate(zip(snapshots_of(directory), frames, strict=True)):
        assert_columns(got, frame, JOINTS, held=True)
        assert_columns(got, frame, (*PLACES, *FORCES), held=number % 5 == 0, single=single)
        assert_columns(got, frame, ROPE, held=number % 10 == 0, single=single)


def test_log_without_forces_reads_as_nan(recorded, tmp_path):
    old = alter(
        bag(recorded[0]), tmp_path / "old.mcap", lambda topic, _, data: None if topic.endswith("force") else data
    )
    first = next(read_snapshots(read_log(old)))
    assert np.isnan(first.carriages["cabin"].contact_force).all()
    assert np.isnan(first.supports["start"].force).all()
    assert np.isfinite(first.cable.tensions).all()


@pytest.mark.parametrize(
    ("topic", "time"),
    [("cable", 0.0), ("joint_states", 0.0), ("carriages/cabin/pose", 0.0), ("command", 0.0), ("key_figures", 0.5)],
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
