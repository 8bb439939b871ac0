"""Commands of the package in processes forked from one with everything imported and planar kernels loaded.

That takes a second or two of most starts.

From there on each is a process as ever, with arguments, environment, directory, signals and an exit code of its own.
"""

from __future__ import annotations

import atexit
import gc
import json
import os
import runpy
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import cache
from importlib import import_module
from pathlib import Path

from kernels_in_turn import take_turns

COMMANDS = "ros.sim", "ros.client.drive", "offline.simulate", "offline.review", "offline.replay"
LATER = "cable_twin.ros.node", "cable_twin.view.rerun_view", "scipy.optimize"  # what they import when they need it


class ForkedProcess:
    """Command, or script by its path, with the interface of `subprocess.Popen` and its output in files."""

    def __init__(
        self,
        name: str,
        arguments: Sequence[str],
        directory: Path,
        variables: Mapping[str, str],
        output: Path,
        errors: Path,
    ) -> None:
        server = _server()
        self._exit = Path(tempfile.mkdtemp(prefix="cable_twin_exit_")) / "code"
        self.returncode: int | None = None
        request = [name, list(arguments), str(directory), dict(variables), str(output), str(errors), str(self._exit)]
        server.stdin.write(json.dumps(request) + "\n")
        server.stdin.flush()
        if not (line := server.stdout.readline()):
            self._exit.parent.rmdir()
            raise RuntimeError("the process that forks commands has ended; its error stands above")
        self.pid = int(line)

    def poll(self) -> int | None:
        """Exit code; None while the process runs."""
        if self.returncode is None and self._exit.exists():
            self.returncode = int(self._exit.read_text())
            shutil.rmtree(self._exit.parent)
        return self.returncode

    def wait(self, timeout: float = float("inf")) -> int:
        """Wait for the end of the process; returns its exit code."""
        deadline = time.monotonic() + timeout
        while (code := self.poll()) is None:
            if time.monotonic() > deadline:
                raise subprocess.TimeoutExpired(f"process {self.pid}", timeout)
            time.sleep(0.01)
        return code

    def send_signal(self, number: int) -> None:
        """Send a signal to the process, if running."""
        if self.poll() is None:
            with suppress(ProcessLookupError):
                os.kill(self.pid, number)

    def kill(self) -> None:
        """Kill the process."""
        self.send_signal(signal.SIGKILL)


@cache
def _server() -> subprocess.Popen[str]:
    """Fork server of this test process, with everything imported."""
    root = Path(__file__).resolve().parents[1]
    paths = [str(root), *filter(None, [os.environ.get("PYTHONPATH")])]
    server = subprocess.Popen(
        [sys.executable, __file__],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(paths), "PYTHONUNBUFFERED": "1"},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    atexit.register(server.communicate)  # it ends with its input
    return server


def serve() -> None:
    """Fork a command for each line of the input and write its exit code to a file after its end."""
    for module in (*(f"cable_twin.{command}" for command in COMMANDS), *LATER):
        import_module(module)
    if "PYTEST_XDIST_WORKER" in os.environ:
        take_turns()
    _load_kernels()
    gc.freeze()  # or each goes through all of it when it ends
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the tests
    for line in sys.stdin:
        name, arguments, directory, variables, output, errors, code = json.loads(line)
        if os.fork():
            with suppress(ChildProcessError):
                while os.waitpid(-1, os.WNOHANG)[0]:  # those that have waited for theirs
                    pass
            continue
        if command := os.fork():
            os.write(1, f"{command}\n".encode())
            os.close(0)
            os.close(1)
            status = os.waitstatus_to_exitcode(os.waitpid(command, 0)[1])
            Path(f"{code}_").write_text(str(status))
            Path(f"{code}_").rename(code)
            os._exit(0)
        signal.signal(signal.SIGINT, signal.default_int_handler)
        os.chdir(directory)
        os.environ.clear()
        os.environ.update(variables)
        for descriptor, file in ((0, os.devnull), (1, output), (2, errors)):
            os.dup2(os.open(file, os.O_RDWR | os.O_APPEND | os.O_CREAT), descriptor)
        sys.argv = [name, *arguments]
        if name in COMMANDS:
            sys.argv[0] = name.rpartition(".")[2]
            sys.exit(import_module(f"cable_twin.{name}").main())
        sys.path[0] = str(Path(name).parent)
        runpy.run_path(name, run_name="__main__")
        sys.exit()


def _load_kernels() -> None:
    """Load the kernels that a planar twin needs at its start."""
    from cable_twin.key_figures import KeyFigures  # noqa: PLC0415 - not where processes are only asked for
    from cable_twin.scenario import load_scenario  # noqa: PLC0415
    from cable_twin.simulation import Simulation  # noqa: PLC0415

    simulation = Simulation(load_scenario("seed_example"))
    KeyFigures(simulation.scenario).update(simulation.advance_to(0.01))


if __name__ == "__main__":
    serve()
