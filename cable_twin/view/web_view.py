"""Browser viewer of rerun, served by a separate process on the local interface only."""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from urllib.parse import quote

LIVE_ADDRESS = "127.0.0.1"  # never another: rerun has no access control
LIVE_PORT = 9876  # rerun's own
READY = 20.0  # s within which the server has to answer, also on a busy machine


def live_url(port: int) -> str:
    """Address of a live view for viewers (`rerun --connect URL`)."""
    return f"rerun+http://{LIVE_ADDRESS}:{port}/proxy"


class WebView:
    """Server of a live view or of recordings for browsers of this machine, until closed.

    Attributes:
        link: address for a browser.
    """

    def __init__(self, *sources: str) -> None:
        """Start the server and wait for its first answer.

        Args:
            sources: address of a live view, or recording files.

        Raises:
            OSError: the server does not start.
        """
        port, own_port = free_port(), free_port()
        live = sources[0].startswith("rerun")
        address = sources[0] if live else live_url(own_port)
        self.link = f"http://{LIVE_ADDRESS}:{port}/?url={quote(address, safe='')}"
        options = ["--serve-web", "--bind", LIVE_ADDRESS, "--web-viewer-port", str(port)]
        options += [] if live else ["--port", str(own_port)]
        self._process = subprocess.Popen(
            [*_program(), *options, *sources],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        deadline = time.monotonic() + READY
        for needed in (port,) if live else (port, own_port):
            while not _answers(needed):
                if self._process.poll() is not None or time.monotonic() > deadline:
                    self.close()
                    raise OSError(f"rerun does not serve a web view: exit code {self._process.returncode}")
                time.sleep(0.02)

    def wait(self) -> None:
        """Wait until the server of the browser view ends, or Ctrl-C."""
        with suppress(KeyboardInterrupt):
            self._process.wait()

    def close(self) -> None:
        """End the server of the browser view; a second call does nothing."""
        self._process.terminate()
        try:
            self._process.wait(5.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


def free_port(wanted: int = 0) -> int:
    """Find a free TCP port of the local interface: the wanted one, or another."""
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((LIVE_ADDRESS, wanted))
        except OSError:
            probe.bind((LIVE_ADDRESS, 0))
        return int(probe.getsockname()[1])


def _program() -> list[str]:
    """Command line of the rerun program without its Python wrapper, which would leave the program running."""
    import rerun_cli  # noqa: PLC0415 - comes with rerun-sdk

    program = Path(str(rerun_cli.__file__)).with_name("rerun")
    command = [str(program)] if os.access(program, os.X_OK) else [sys.executable, "-m", "rerun_cli"]
    setpriv = shutil.which("setpriv")  # so that it ends with this process, even a killed one
    return [setpriv, "--pdeathsig", "TERM", *command] if setpriv else command


def why_not(error: Exception) -> str:
    """Reason in one line why rerun cannot be used, with install advice where it is missing."""
    if isinstance(error, ImportError):
        return f"rerun is not installed ({error}): pip install rerun-sdk"
    return " ".join(str(error).split())


def _answers(port: int) -> bool:
    with socket.socket() as probe:
        probe.settimeout(0.5)
        return probe.connect_ex((LIVE_ADDRESS, port)) == 0
