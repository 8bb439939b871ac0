"""Jig-back in real time: hostile commands, goals, emergency stop, snapshot, log after a kill."""

from __future__ import annotations

import signal
from pathlib import Path

import numpy as np
import pytest
from twin_process import COMPILING

from cable_twin.frame.snapshot import Snapshot
from cable_twin.recording.log_reader import read_log, read_snapshots
from cable_twin.simulation import Simulation

pytest.importorskip("rclpy")
from std_srvs.srv import SetBool, Trigger

HOSTILE = (
    ({"name": ["cabin_1"], "velocity": [1.0]}, "'cabin_1' is clamped to haul_1, which pulls it; allowed drives: haul"),
    ({"name": ["haul_rope"], "velocity": [50.0]}, "speed of 'haul_rope': given 50 m/s; allowed: -10 to 10 m/s"),
    (
        {"name": ["haul_rope"], "position": [2000.0]},
        "place for 'haul_rope': given 2000 m; allowed: ",
    ),
)


@pytest.mark.long
def test_it_is_driven_stopped_and_killed_and_its_log_agrees_to_the_last_bit(processes, participants, replayed):
    sim = processes("--scenario", "jig_back")
    twin = participants(sim.domain)
    twin.subscribe_standard()

    for command, said in HOSTILE:
        with twin.stream(**command):  # what is refused is told once a second
            twin.until(lambda said=said: said in sim.output, what=said)
    twin.publish(name=["haul_rope"], position=[1.5])
    twin.until(lambda: abs(twin.joint("haul_rope")[0] - 1.5) < 0.1, COMPILING, "1.5 m of rope gone by")
    with twin.stream(name=["haul_rope"], velocity=[5.0]):
        twin.until(lambda: twin.joint("haul_rope")[1] > 0.5, what="0.5 m/s")
    assert twin.call("emergency_stop", SetBool, data=True).success
    twin.until(lambda: abs(twin.joint("haul_rope")[1]) < 1e-6, what="the emergency stop")
    saved = Path(twin.call("save_snapshot", Trigger).message.partition(": ")[2])
    assert twin.call("emergency_stop", SetBool, data=False).success
    twin.publish(name=["haul_rope"], position=[0.0])
    # another severity at the logger than that of the goal above
    twin.until(lambda: "haul_rope has arrived at" in sim.output.rpartition("emergency stop released")[2], COMPILING)
    assert twin.joint("haul_rope")[0] > -1e-6
    assert "view stopped" not in sim.output
    sim.send(signal.SIGKILL)
    sim.wait()
    log, second = read_log(sim.run_directory), Simulation.load(saved)
    assert second.emergency_stopped
    for applied in log.commands:
        if applied.time > second.time:
            second.advance_to(applied.time)
            second.apply(applied.command, applied.source)
    *_, last = (item for item in read_snapshots(log) if isinstance(item, Snapshot))
    assert last.time > second.time
    np.testing.assert_array_equal(second.advance_to(last.time).columns.arc_length, last.columns.arc_length)
    sources = {applied.source for applied in log.commands}
    assert {"joint_commands", "goal"} <= sources
    replayed(sim.run_directory)
