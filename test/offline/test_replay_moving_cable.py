"""`replay` of a ski lift to the last bit: commands to the drive of the rope, carriers leaving and entering."""

from __future__ import annotations

import pytest
from test_moving_cable_twin import short_lift

from cable_twin.frame.records import Command
from cable_twin.messages import MessageEncoder, decode, topics
from cable_twin.messages.command_messages import applied_command_message
from cable_twin.offline import replay
from cable_twin.recording.log_reader import read_log
from cable_twin.recording.run import start_run

EPOCH = 1_700_000_000_123_456_789  # ns
COMMANDS = {
    1.0: Command("speed", {"haul_rope": 5.0}),
    12.0: Command("emergency_stop", {}),
    15.0: Command("release", {}),
    15.5: Command("speed", {"haul_rope": -4.0}),
    24.0: Command("reset", {}),
    25.0: Command("speed", {"haul_rope": -3.0}),
}


def record(directory):
    """Record 30 s of commands of all kinds, with a view."""
    simulation = short_lift()
    table = topics(simulation.layout)
    run = start_run(simulation, table, record_directory=directory, frame_period=0.02)
    run.begin(EPOCH)
    encoder = MessageEncoder(simulation.layout, EPOCH)
    off_and_on = 0
    for frame in range(1501):
        before = simulation.snapshot
        snapshot = simulation.advance_to(frame * 0.02)
        off_and_on += sum(
            chair.attached != before.carriages[name].attached for name, chair in snapshot.carriages.items()
        )
        run.recorder.record(encoder.frame(snapshot), encoder.stamp_ns(snapshot), snapshot)
        if (command := COMMANDS.get(round(snapshot.time, 9))) is not None:
            applied = simulation.apply(command)
            data = applied_command_message(applied, EPOCH)
            run.recorder.record_command(applied, data, EPOCH + round(applied.time * 1e9))
    run.recorder.close()
    assert not run.recorder.faults
    assert off_and_on > 3
    return run.directory


def test_a_lift_replays_to_the_last_bit(tmp_path, capsys):
    directory = record(tmp_path)
    assert [applied.command for applied in read_log(directory).commands] == list(COMMANDS.values())
    assert replay.main([str(directory)]) == 0
    assert capsys.readouterr().out.splitlines()[-1] == "every sample agrees to the last bit"
    log = read_log(directory)
    last = [decode(data, "sensor_msgs/msg/JointState") for _, _, data in log.messages(["joint_states"])][-1]
    assert last.name[6] == "haul_rope"
    assert last.velocity[6] == pytest.approx(-2.5)  # for 5 s at 0.5 m/s² from rest
