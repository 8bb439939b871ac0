"""Recordings in several files: each complete, with viewers still connected."""

from __future__ import annotations

import socket
import subprocess
import sys
import warnings
from pathlib import Path

import psutil
import pytest
from drawn_run import OUTLINES, RATE, column, commands, snapshot_at
from twin_process import wait_until

from cable_twin.view.rerun_view import RerunView
from cable_twin.view.web_view import live_url

RERUN = Path(sys.executable).with_name("rerun")
PART = 120  # frames in a file


def draw_split(view: RerunView, paths: list[Path]) -> None:
    orders = commands()
    for number, path in enumerate(paths):
        if number:
            view.split(path)
        for index in range(number * PART, (number + 1) * PART):
            snapshot = snapshot_at(index / RATE)
            if (order := orders.get(snapshot.time)) is not None:
                view.log_command(order)
            view.log(snapshot)
        view.flush()


def verified(*paths: Path) -> None:
    subprocess.run([RERUN, "rrd", "verify", *paths], check=True, capture_output=True, timeout=300)


def entities(path: Path) -> set[str]:
    printed = subprocess.run([RERUN, "rrd", "print", path], check=True, capture_output=True, text=True, timeout=300)
    lines = [line for line in printed.stdout.splitlines() if line.startswith("Chunk(")]
    paths = {word for line in lines for word in line.split(" - ")}
    return {path for path in paths if path.startswith(("/track", "/plots", "/readout", "/commands"))}


def test_each_file_is_whole(tmp_path):
    paths = [tmp_path / f"run_{number}.rrd" for number in range(3)]
    view = RerunView("test ropeway", OUTLINES, path=paths[0], live=False)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        draw_split(view, paths)
        verified(*paths[:2])  # closed while the run goes on
        view.close()
    verified(paths[2])
    assert entities(paths[1]) == entities(paths[2]) == entities(paths[0]) - {"/commands"}
    assert "/track/supports" in entities(paths[2])
    for path in paths:
        times, tensions = column(path, "/plots/tension", "Scalars:scalars")
        assert len(times) == len(tensions) == PART
        geometry, _ = column(path, "/track/rope", "LineStrips2D:strips")
        assert geometry[0] == times[0]  # the first frame is drawn whole


def test_viewers_stay_connected(tmp_path):
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    paths = [tmp_path / f"run_{number}.rrd" for number in range(3)]
    view = RerunView("test ropeway", OUTLINES, path=paths[0], live=True, live_port=port)
    seen = tmp_path / "seen.rrd"
    with (tmp_path / "viewer.txt").open("w") as output:
        viewer = subprocess.Popen(
            [RERUN, live_url(port), "--port", "auto", "--save", seen], stdout=output, stderr=subprocess.STDOUT
        )
    try:
        draw_split(view, paths[:1])
        wait_until(lambda: connections(port) and seen.exists())
        before = connections(port)
        for number, path in enumerate(paths[1:], start=1):
            size = seen.stat().st_size
            view.split(path)
            for index in range(number * PART, (number + 1) * PART):
                view.log(snapshot_at(index / RATE))
            view.flush()
            wait_until(lambda: seen.stat().st_size > size + 50_000)  # noqa: B023 - of this turn
            assert connections(port) == before
        view.close()
        verified(*paths)
        for path in paths:
            assert len(column(path, "/plots/tension", "Scalars:scalars")[0]) == PART
    finally:
        viewer.kill()
        viewer.wait()
        view.close()


def connections(port: int) -> set[int]:
    """Ports of other processes connected to the live view."""
    sockets = [item for item in psutil.Process().net_connections(kind="tcp") if item.raddr]
    own = {item.laddr.port for item in sockets if item.raddr.port == port}
    return {item.raddr.port for item in sockets if item.laddr.port == port} - own


def test_file_that_cannot_be_made_is_an_error_and_the_old_one_is_whole(tmp_path):
    path = tmp_path / "run_0.rrd"
    view = RerunView("test ropeway", OUTLINES, path=path, live=False)
    view.log(snapshot_at(0.0))
    with pytest.raises(OSError, match="No such file"):
        view.split(tmp_path / "none/run_1.rrd")
    view.close()
    verified(path)


FULL_DISK = """
import resource, signal, sys
from pathlib import Path
sys.path[:0] = {path!r}
from cable_twin.view.rerun_view import RerunView
from drawn_run import OUTLINES, snapshot_at
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
path = Path({file!r})
view = RerunView("test ropeway", OUTLINES, path=path, live=False)
for index in range(500):
    view.log(snapshot_at(index / 100))
view.flush()
size = path.stat().st_size
resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))
try:
    view.split(path.with_name("run_1.rrd"))
    for index in range(500, 1000):
        view.log(snapshot_at(index / 100))
    view.flush()
except OSError as error:
    print("refused:", error)
view.close()
"""


def test_disk_that_is_full_at_the_split_is_no_hang(tmp_path):
    """No room for the index of the old file, whose frames stay readable."""
    paths = [str(Path(__file__).parent), str(Path(__file__).parents[1]), str(Path(__file__).parents[2])]
    script = FULL_DISK.format(path=paths, file=str(tmp_path / "run_0.rrd"))
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=300, check=False)
    assert run.returncode == 0, run.stderr
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # it has no index
        assert len(column(tmp_path / "run_0.rrd", "/plots/tension", "Scalars:scalars")[0]) == 500
