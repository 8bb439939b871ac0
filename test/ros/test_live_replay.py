"""A run that was driven over DDS in real time, simulated again from its log."""

import numpy as np
import pytest
from twin_process import write_quick_scenario

from cable_twin.offline import replay
from cable_twin.recording.log_reader import read_log

pytest.importorskip("rclpy")


def test_live_run_over_dds_agrees_to_the_last_bit(processes, participants, tmp_path, capsys):
    sim = processes("--scenario", str(write_quick_scenario(tmp_path)))
    participant = participants(sim.domain)
    participant.subscribe_standard()
    random = np.random.default_rng(7)
    for number in range(40):
        value = {"velocity": [float(random.uniform(-8.0, 8.0))]}
        if number % 3 == 2:
            value = {"effort": [float(random.uniform(0.0, 4e4))]}
        participant.publish(name=["cabin"], **value)
        participant.spin(float(random.uniform(0.01, 0.2)))
    participant.until(
        lambda: participant.applied[-1].source == "command_timeout",
        what="its stop",
    )
    assert sim.end() == 0
    log = read_log(sim.run_directory)
    sources = {applied.source for applied in log.commands}
    assert sources == {"joint_commands", "command_timeout"}
    assert len(log.commands) >= 41
    assert replay.main([str(sim.run_directory)]) == 0
    assert "every sample agrees to the last bit" in capsys.readouterr().out
