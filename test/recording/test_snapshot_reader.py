"""What a log gives back against the simulation that wrote it."""

from __future__ import annotations

import numpy as np
import pytest
from bags import alter, bag
from twin_process import write_quick_scenario

from cable_twin.messages import topics
from cable_twin.offline.script import ScriptedCommand
from cable_twin.offline.scripted_run import simulate
from cable_twin.recording.log_reader import LogError, read_log
from cable_twin.recording.run import start_run
from cable_twin.recording.snapshot_reader import read_snapshots
from cable_twin.records import AppliedCommand, Command
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation
from cable_twin.snapshot import Snapshot

EPOCH = 1_700_000_000_123_456_789  # ns
SCRIPT = [
    ScriptedCommand(0.0, Command("speed", {"cabin": 4.0}), "script", ""),
    ScriptedCommand(0.115, Command("emergency_stop", {}), "script", ""),
    ScriptedCommand(0.2, Command("release", {}), "script", ""),
]


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A run of 0.5 s, and its frames as the simulation gives them again."""
    directory = tmp_path_factory.mktemp("recorded")
    scenario = load_scenario(write_quick_scenario(directory))
    simulation = Simulation(scenario)
    table = topics(simulation.layout)
    run = start_run(simulation, table, record_directory=directory, frame_period=0.01, rerun="off")
    run.begin(EPOCH)
    outcome = simulate(simulation, SCRIPT, duration=0.5, frame_steps=2, epoch_ns=EPOCH, run=run)
    run.recorder.close()
    assert (outcome.applied, outcome.refused, outcome.fault, run.recorder.faults) == (3, [], "", [])
    again = Simulation(scenario)
    waiting = list(SCRIPT)
    frames = []
    for frame in range(51):
        while waiting and waiting[0].time < frame * 0.01:
            item = waiting.pop(0)
            again.advance_to(item.time)
            again.apply(item.command)
        frames.append(again.advance_to(frame * 0.01))
    return run.directory, frames


def test_frames_and_commands_come_back_in_order(recorded):
    directory, frames = recorded
    items = list(read_snapshots(read_log(directory)))
    kinds = ["S" if isinstance(item, Snapshot) else item.command.kind for item in items]
    assert kinds == ["S", "speed", *"S" * 11, "emergency_stop", *"S" * 9, "release", *"S" * 30]
    assert [item.time for item in items if isinstance(item, AppliedCommand)] == [0.0, 0.115, 0.2]
    snapshots = [item for item in items if isinstance(item, Snapshot)]
    assert len(snapshots) == len(frames)
    for read, frame in zip(snapshots, frames, strict=True):
        assert read.time == frame.time
        np.testing.assert_array_equal(read.cable.positions, frame.cable.positions.astype("f4"))
        np.testing.assert_array_equal(read.cable.tensions, frame.cable.tensions.astype("f4"))
        np.testing.assert_array_equal(read.cable.arc_lengths, frame.cable.arc_lengths.astype("f4"))
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
            assert (got.x, got.z, got.pitch, got.pitch_rate) == (body.x, body.z, body.pitch, body.pitch_rate)


def test_log_without_forces_reads_as_nan(recorded, tmp_path):
    old = alter(
        bag(recorded[0]), tmp_path / "old.mcap", lambda topic, _, data: None if topic.endswith("force") else data
    )
    first = next(read_snapshots(read_log(old)))
    assert np.isnan(first.carriages["cabin"].contact_force).all()
    assert np.isnan(first.supports["start"].force).all()
    assert np.isfinite(first.cable.tensions).all()


@pytest.mark.parametrize("topic", ["cable", "joint_states", "carriages/cabin/pose", "applied_commands"])
def test_unreadable_message_is_named_with_topic_and_time(recorded, tmp_path, topic):
    broken = alter(
        bag(recorded[0]), tmp_path / "broken.mcap", lambda name, _, data: data[:30] if name == topic else data
    )
    with pytest.raises(LogError, match=r"broken.mcap: .* at 0.000000 s is unreadable"):
        list(read_snapshots(read_log(broken)))


def test_progress_grows_to_the_size_of_the_file(recorded):
    log = read_log(recorded[0])
    positions: list[int] = []
    list(read_snapshots(log, on_position=positions.append))
    assert positions == sorted(positions)
    assert 0 < positions[0] <= positions[-1] <= log.size
    assert log.end == 0.5
