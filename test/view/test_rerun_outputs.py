"""Outputs of the view: files, also several of a run, live viewers, what is left at the end, and failing disks."""

import socket
import subprocess
import sys
import time
import warnings
from pathlib import Path

import pytest
from bags import RERUN, rerun_command

rr = pytest.importorskip("rerun")
psutil = pytest.importorskip("psutil")  # rerun brings it

from drawn_run import OUTLINES, RATE, column, commands, snapshot_at  # noqa: E402
from twin_process import wait_until  # noqa: E402

from cable_twin.view.rerun_view import RerunView  # noqa: E402
from cable_twin.view.web_view import free_port, live_url  # noqa: E402

ROOT = Path(__file__).parents[2]


def test_flushed_frames_survive_without_close(tmp_path):
    path = tmp_path / "run.rrd"
    view = RerunView("test ropeway", OUTLINES, path=path, live=False)
    for index in range(60):
        view.log(snapshot_at(index / RATE))
    view.flush()
    copy = tmp_path / "torn.rrd"
    copy.write_bytes(path.read_bytes())
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # it has no footer yet
        times, _ = column(copy, "/plots/tension", "Scalars:scalars")
    assert len(times) == 60
    view.close()


def test_close_is_final_and_may_be_repeated(tmp_path):
    view = RerunView("test ropeway", OUTLINES, path=tmp_path / "run.rrd", live=False)
    view.log(snapshot_at(0.0))
    view.close()
    view.close()
    with pytest.raises(RuntimeError, match="closed"):
        view.log(snapshot_at(0.01))
    assert rr.get_global_data_recording() is None


@pytest.mark.parametrize("live", [False, True], ids=["file", "live"])
def test_closed_views_leave_no_threads(tmp_path, live, capfd):
    """Views opened one after the other, as by a twin that loads other scenarios."""
    counts = []
    for number in range(4):
        view = RerunView("test ropeway", OUTLINES, path=tmp_path / f"{number}.rrd", live=live, live_port=free_port())
        view.log(snapshot_at(0.0))
        view.close()
        del view
        counts.append(psutil.Process().num_threads())
    assert counts[3] < counts[0] + 2 * 3, "each left two to four; others of this process may come and go"
    assert capfd.readouterr().err == ""  # rerun warns of what it drops


def test_a_view_that_saw_nothing_leaves_a_readable_file(tmp_path):
    path = tmp_path / "run.rrd"
    RerunView("test ropeway", {}, path=path, live=False).close()
    rerun_command("rrd", "verify", path)


def test_view_to_nowhere_and_unknown_unit_are_refused(tmp_path):
    with pytest.raises(ValueError, match="view: given no file"):
        RerunView("test ropeway", {}, path=None, live=False)
    with pytest.raises(ValueError, match="lbf"):
        RerunView("test ropeway", {}, path=tmp_path / "run.rrd", live=False, force_unit="lbf")


def test_live_view_listens_on_this_machine_only():
    port = free_port()
    view = RerunView("test ropeway", OUTLINES, path=None, live=True, live_port=port)
    try:
        view.log(snapshot_at(0.0))
        view.flush()
        assert view.url == f"rerun+http://127.0.0.1:{port}/proxy"
        listening = []
        deadline = time.monotonic() + 10.0
        while not listening and time.monotonic() < deadline:
            sockets = psutil.Process().net_connections(kind="tcp")
            listening = [s.laddr.ip for s in sockets if s.laddr.port == port and s.status == psutil.CONN_LISTEN]
        assert listening == ["127.0.0.1"]
    finally:
        view.close()


def test_file_or_port_that_cannot_be_had_is_an_error_at_once(tmp_path):
    with pytest.raises(OSError, match="No such file"):
        RerunView("test ropeway", {}, path=tmp_path / "no" / "run.rrd", live=False)
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        with pytest.raises(OSError, match=f"port {port}"):
            RerunView("test ropeway", {}, path=None, live=True, live_port=port)


BEGIN = """
import resource, signal, sys
from pathlib import Path
sys.path[:0] = {path!r}
import cable_twin.view.rerun_view as drawing
from drawn_run import OUTLINES, snapshot_at
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
path = Path({file!r})
view = drawing.RerunView("test ropeway", OUTLINES, path=path, live=False)
"""
FULL_DISK = """
drawing.FLUSH_TIMEOUT = 0.5
resource.setrlimit(resource.RLIMIT_FSIZE, (60_000, 60_000))
try:
    for index in range(500):
        view.log(snapshot_at(index / 100))
        if index % 50 == 49:
            view.flush()
except OSError as error:
    print("refused:", error)
view.close()
"""


def draw_on_full_disk(file, script):
    """Draw into a file by a process of its own, which sets a limit to the size of files; its output."""
    paths = [str(Path(__file__).parent), str(Path(__file__).parents[1]), str(ROOT)]
    code = BEGIN.format(path=paths, file=str(file)) + script
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=300, check=False)
    assert run.returncode == 0, run.stderr
    return run.stdout


@pytest.mark.parametrize("attempt", [0, *(pytest.param(one, marks=pytest.mark.long) for one in (1, 2))])
def test_full_disk_is_an_error_and_no_hang(tmp_path, attempt):
    """Flush, disconnect and exit of rerun wait forever for a writer that has given up."""
    said = draw_on_full_disk(tmp_path / "run.rrd", FULL_DISK)
    assert "refused: the rerun recording cannot be written" in said


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


def entities(path: Path) -> set[str]:
    lines = [line for line in rerun_command("rrd", "print", path).splitlines() if line.startswith("Chunk(")]
    paths = {word for line in lines for word in line.split(" - ")}
    return {path for path in paths if path.startswith(("/track", "/plots", "/readout", "/commands"))}


def test_each_file_is_whole(tmp_path):
    paths = [tmp_path / f"run_{number}.rrd" for number in range(3)]
    view = RerunView("test ropeway", OUTLINES, path=paths[0], live=False)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        draw_split(view, paths)
        rerun_command("rrd", "verify", *paths[:2])  # closed while the run goes on
        view.close()
    rerun_command("rrd", "verify", paths[2])
    assert entities(paths[1]) == entities(paths[2]) == entities(paths[0]) - {"/commands"}
    assert "/track/supports" in entities(paths[2])
    for path in paths:
        times, tensions = column(path, "/plots/tension", "Scalars:scalars")
        assert len(times) == len(tensions) == PART
        geometry, _ = column(path, "/track/rope", "LineStrips2D:strips")
        assert geometry[0] == times[0]  # the first frame is drawn whole


def test_viewers_stay_connected(tmp_path):
    port = free_port()
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
        rerun_command("rrd", "verify", *paths)
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
    rerun_command("rrd", "verify", path)


SPLIT_ON_FULL_DISK = """
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
    draw_on_full_disk(tmp_path / "run_0.rrd", SPLIT_ON_FULL_DISK)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # it has no index
        assert len(column(tmp_path / "run_0.rrd", "/plots/tension", "Scalars:scalars")[0]) == 500
