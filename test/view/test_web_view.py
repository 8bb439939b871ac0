"""Browser view: served on this machine only, reached by its link, and ended with its process."""

from __future__ import annotations

import signal
import socket
import subprocess
import sys
from urllib.parse import parse_qs, urlsplit
from urllib.request import urlopen

import psutil
import pytest
from twin_process import environment, run_module, wait_until, write_quick_scenario

from cable_twin.view.web_view import LIVE_ADDRESS, WebView, free_port

SERVE = "from cable_twin.offline.entry_points import review; raise SystemExit(review())"


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Directory of a logged second."""
    directory = tmp_path_factory.mktemp("web")
    write_quick_scenario(directory)
    result = run_module("offline.simulate", "quick.yaml", "--duration", "1", directory=directory)
    assert result.returncode == 0, result.stderr
    (log,) = (directory / "cable_twin_logs").iterdir()
    return log


def listening(process):
    """Local addresses on which a process and its children listen."""
    family = [process, *process.children(recursive=True)]
    sockets = [item for member in family for item in member.net_connections("tcp") if item.status == "LISTEN"]
    return {item.laddr for item in sockets}


def check_page(link):
    """Check that the page is rerun's, and that the address in it accepts local connections."""
    with urlopen(link, timeout=20.0) as page:
        assert page.status == 200
        assert b"rerun" in page.read().lower()
    (source,) = parse_qs(urlsplit(link).query)["url"]
    assert source.startswith(f"rerun+http://{LIVE_ADDRESS}:")
    with socket.create_connection((LIVE_ADDRESS, urlsplit(source).port), 20.0):
        pass


@pytest.mark.parametrize(
    "end",
    [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.long), signal.SIGKILL],
    ids=lambda number: number.name,
)
def test_review_serves_a_run_until_it_is_ended(run, tmp_path, end):
    with (tmp_path / "output.txt").open("w") as output:
        code = f"import signal; signal.signal(signal.SIGINT, signal.default_int_handler); {SERVE}"
        review = subprocess.Popen(
            [sys.executable, "-c", code, str(run), "--rerun", "web"], env=environment(tmp_path), stdout=output
        )
    try:
        wait_until(lambda: "in a browser" in (tmp_path / "output.txt").read_text() or review.poll() is not None)
        link = (tmp_path / "output.txt").read_text().split()[-1]
        check_page(link)
        family = psutil.Process(review.pid).children(recursive=True)
        addresses = listening(psutil.Process(review.pid))
        assert len(addresses) == 2
        assert {address.ip for address in addresses} == {LIVE_ADDRESS}
        review.send_signal(end)
        assert review.wait(30) == (0 if end == signal.SIGINT else -end)
        wait_until(lambda: not any(process.is_running() for process in family), what="a server that ends")
    finally:
        review.kill()
        review.wait()


def test_a_server_that_does_not_start_is_told():
    with pytest.raises(OSError, match="rerun does not serve a web view: exit code"):
        WebView("there_is_no_such_file.rrd")


def test_a_port_that_is_taken_is_not_chosen():
    with socket.socket() as taken:
        taken.bind((LIVE_ADDRESS, 0))
        taken.listen()
        wanted = taken.getsockname()[1]
        assert free_port(wanted) != wanted
    assert free_port(wanted) == wanted
