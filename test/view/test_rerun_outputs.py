"""Outputs of the view: file or live viewer, files left at the end, and failing disks."""

import socket
import subprocess
import sys
import time
import warnings
from pathlib import Path

import pytest

rr = pytest.importorskip("rerun")
psutil = pytest.importorskip("psutil")  # rerun brings it

from drawn_run import OUTLINES, RATE, column, rerun_command, snapshot_at  # noqa: E402

from cable_twin.view.rerun_view import RerunView  # noqa: E402
from cable_twin.view.web_view import free_port  # noqa: E402

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
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
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


FULL_DISK = """
import resource, signal, sys
from pathlib import Path
sys.path[:0] = {path!r}
import cable_twin.view.rerun_view as drawing
from drawn_run import OUTLINES, snapshot_at
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
drawing.FLUSH_TIMEOUT = 0.5
view = drawing.RerunView("test ropeway", OUTLINES, path=Path({file!r}), live=False)
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


@pytest.mark.parametrize("attempt", range(3))
def test_full_disk_is_an_error_and_no_hang(tmp_path, attempt):
    """Flush, disconnect and exit of rerun wait forever for a writer that has given up."""
    paths = [str(Path(__file__).parent), str(Path(__file__).parents[1]), str(ROOT)]
    script = FULL_DISK.format(path=paths, file=str(tmp_path / "run.rrd"))
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=300, check=False)
    assert run.returncode == 0, run.stderr
    assert "refused: the rerun recording cannot be written" in run.stdout
