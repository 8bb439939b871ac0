"""Command `drive` beside the twin of a ski lift: commands to its rope, and a stop after silence."""

from __future__ import annotations

import signal

import pytest
from test_moving_cable_twin import short_scenario
from twin_process import PATIENCE, TwinProcess

pytest.importorskip("rclpy")
from ros_participant import Participant
from std_srvs.srv import SetBool

WAIT = ("--wait", str(PATIENCE))


@pytest.fixture(scope="module")
def lift(tmp_path_factory):
    """Running lift of six chairs, and a participant."""
    directory = tmp_path_factory.mktemp("lift")
    (directory / "lift.yaml").write_text(short_scenario().to_yaml())
    process = TwinProcess(directory, "--scenario", "lift.yaml", "--record", "false")
    participant = Participant(process.domain)
    participant.subscribe_standard()
    participant.until(lambda: participant.received["joint_states"])
    yield process, participant
    participant.close()
    process.kill()


def test_the_rope_is_driven_stops_in_silence_and_in_an_emergency(lift, processes):
    process, participant = lift
    process.wait_for("drive: haul_rope; carriages: chair_1 to chair_6; commands on")

    def speed():
        return participant.joint("haul_rope")[1]

    drive = processes("haul_rope", "--speed", "2", *WAIT, module="ros.client.drive", domain=process.domain)
    participant.until(lambda: speed() > 1.0, what="motion")
    drive.send(signal.SIGKILL)
    participant.until(lambda: "no command for 0.5 s: haul_rope ramps to a stop" in process.output, what="time-out")
    participant.until(lambda: speed() == 0.0, what="stop")
    processes("haul_rope", "--speed", "-2", *WAIT, module="ros.client.drive", domain=process.domain)
    participant.until(lambda: speed() < -1.0, what="motion backwards")
    assert participant.call("emergency_stop", SetBool, data=True).success
    participant.until(lambda: speed() == 0.0, what="emergency stop")
    assert participant.call("emergency_stop", SetBool, data=False).success


@pytest.mark.long
def test_the_rope_goes_by_to_a_place(lift, processes):
    process, participant = lift

    def rope():
        return participant.joint("haul_rope")

    participant.until(lambda: rope()[1] == 0.0, what="stop")
    target = rope()[0] - 7.5
    drive = processes("haul_rope", "--to", f"{target:.3f}", *WAIT, module="ros.client.drive", domain=process.domain)
    participant.until(lambda: drive.process.poll() is not None, what=f"end of drive; {drive.output}")
    assert drive.wait() == 0, drive.output
    participant.until(lambda: rope()[1] == 0.0, what="stop")
    assert rope()[0] == pytest.approx(target, abs=0.1)

    # a trip that is abandoned after one that has arrived
    drive = processes(
        "haul_rope", "--to", f"{target + 50.0:.3f}", *WAIT, module="ros.client.drive", domain=process.domain
    )
    participant.until(lambda: rope()[1] > 0.1, what="motion")
    assert participant.call("emergency_stop", SetBool, data=True).success
    participant.until(lambda: drive.process.poll() is not None, what=f"end of drive; {drive.output}")
    why = "haul_rope: emergency stop from service took over"
    assert f"drive: the twin has abandoned this trip: {why}" in drive.output
    participant.until(lambda: f"goal abandoned: {why}" in process.output, what="line")
    assert participant.call("emergency_stop", SetBool, data=False).success

    drive = processes("haul_rope", "--force", "5", *WAIT, module="ros.client.drive", domain=process.domain)
    participant.until(lambda: drive.process.poll() is not None, what="end of drive")
    assert drive.wait() == 1
    allowed = "none, as this drive takes speeds only (m/s)"
    assert drive.output == f"drive: force of 'haul_rope': given 5 N; allowed: {allowed}\n"
