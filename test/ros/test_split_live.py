"""Live run with split logs, driven over DDS: no lost frame, and replay of every file."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from bags import rerun_command
from rosbags.highlevel import AnyReader
from split_run import bags
from twin_process import wait_until

from cable_twin.messages import ROBOT_DESCRIPTION, TF_STATIC
from cable_twin.recording.log_reader import read_log

pytest.importorskip("rclpy")

FRAME = 10_000_000  # ns


@pytest.mark.long
def test_split_run_has_every_frame_and_replays(quick_twin, replayed):
    limits = ["--split-duration", "1", "--keep-age", "3"]
    sim, participant = quick_twin(*limits)
    random = np.random.default_rng(3)

    def kept() -> list[int]:
        force = random.uniform() < 0.3
        value = {"effort": [random.uniform(0.0, 4e4)]} if force else {"velocity": [random.uniform(-8.0, 8.0)]}
        participant.publish(name=["cabin"], **value)
        participant.spin(float(random.uniform(0.01, 0.1)))
        return [int(file.stem.rpartition("_")[2]) for file in bags(sim.run_directory)]

    wait_until(lambda: kept()[-1] >= 6, what="the seventh file")
    participant.until(lambda: participant.applied[-1].source == "command_timeout", what="its stop")
    assert sim.end() == 0
    assert "recording: " not in sim.output
    log = read_log(sim.run_directory)
    assert {applied.source for applied in log.commands} == {"joint_commands", "command_timeout"}
    assert {applied.command.kind for applied in log.commands} == {"speed", "force"}
    numbers = [file.number for file in log.files]
    assert numbers == list(range(numbers[0], numbers[-1] + 1))
    assert numbers[0] > 0
    assert len(numbers) <= 5
    stamps = [stamp for _, stamp, _ in log.messages(["joint_states"])]
    assert {after - before for before, after in pairwise(stamps)} == {FRAME}
    with AnyReader([sim.run_directory]) as reader:
        assert reader.message_count == sum(1 for _ in log.messages())
    for file in log.files:  # each is shown alone as well
        assert {topic for topic, _, _ in file.messages([ROBOT_DESCRIPTION, TF_STATIC])} == {
            ROBOT_DESCRIPTION,
            TF_STATIC,
        }
    for path in (sim.run_directory, *bags(sim.run_directory)):
        replayed(path)
    recordings = sorted(sim.run_directory.glob("*.rrd"))
    assert [file.with_suffix(".mcap") for file in recordings] == sorted(bags(sim.run_directory))
    rerun_command("rrd", "verify", *recordings)
