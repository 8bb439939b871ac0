"""`sim --rerun live` with real viewers that connect, are killed or hang, while recording continues."""

from __future__ import annotations

import signal
import socket
import subprocess
from itertools import pairwise
from pathlib import Path

import psutil
import pytest
from bags import RERUN, rerun_command
from twin_process import wait_until, write_quick_scenario

from cable_twin.recording.log_reader import read_log

pytest.importorskip("rclpy")

pytestmark = pytest.mark.long

FRAME = 10_000_000  # ns
PORT = 9876
ADDRESS = f"rerun+http://127.0.0.1:{PORT}/proxy"
MUCH = 200_000  # bytes of a picture that moves


@pytest.fixture
def viewers(tmp_path):
    """Start rerun's own program without a window, writing all received data to a file."""
    started = []

    def start(name: str) -> tuple[subprocess.Popen, Path]:
        target = tmp_path / f"{name}.rrd"
        output = (tmp_path / f"{name}.txt").open("w")
        viewer = subprocess.Popen(
            [RERUN, ADDRESS, "--port", "auto", "--save", target], stdout=output, stderr=subprocess.STDOUT
        )
        started.append(viewer)
        wait_until(lambda: target.exists() and target.stat().st_size > MUCH, what=f"a picture for {name}")
        return viewer, target

    yield start
    for viewer in started:
        viewer.kill()
        viewer.wait()


def test_recording_goes_on_while_viewers_come_hang_and_die(processes, participants, viewers, tmp_path):
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(("127.0.0.1", PORT))
        except OSError:
            pytest.skip(f"somebody else has port {PORT}")
    sim = processes("--scenario", str(write_quick_scenario(tmp_path)), "--rerun", "live")
    sim.wait_for(f"rerun --bind 127.0.0.1 --connect {ADDRESS}")
    participant = participants(sim.domain)
    participant.subscribe_standard()
    sockets = psutil.Process(sim.process.pid).net_connections(kind="tcp")
    assert {s.laddr.ip for s in sockets if s.status == psutil.CONN_LISTEN} == {"127.0.0.1"}

    first, _ = viewers("first")
    hanging, _ = viewers("hanging")
    hanging.send_signal(signal.SIGSTOP)
    first.send_signal(signal.SIGKILL)
    participant.spin(3.0)  # longer than any flush waits
    _, late_file = viewers("late")
    size = late_file.stat().st_size
    wait_until(lambda: late_file.stat().st_size > size + MUCH, what="a late viewer that is kept up to date")
    level, message, values = participant.next_diagnostics()
    assert level in (0, 1), message  # a warning where this machine was late
    assert float(values["real_time_factor"]) == pytest.approx(1.0, abs=0.2)
    assert int(values["log_backlog_frames"]) < 200
    assert sim.end() == 0
    assert "recording: " not in sim.output
    log = read_log(sim.run_directory)
    assert log.complete
    stamps = [stamp for _, stamp, _ in log.messages(["joint_states"])]
    assert len(stamps) > 300
    assert [after - before for before, after in pairwise(stamps)] == [FRAME] * (len(stamps) - 1)
    (recording,) = sim.run_directory.glob("*.rrd")
    rerun_command("rrd", "stats", recording)
