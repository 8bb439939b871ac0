"""Processes of the package for tests, `sim` and others, each in its own ROS domain."""

from __future__ import annotations

import fcntl
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import cache
from itertools import cycle, islice, pairwise
from pathlib import Path
from typing import IO, Any

from forked_process import ForkedProcess
from ruamel.yaml import YAML

import cable_twin
from cable_twin.messages import SECOND
from cable_twin.scenario import config_directory

COMPILING = 600.0  # s within which a fresh machine has compiled the kernels, be it slow and busy
PATIENCE = 60.0  # s for anything else; a machine that builds something beside may stall for seconds
PACKAGE_PARENT = Path(cable_twin.__file__).resolve().parents[1]
REPOSITORY = Path(__file__).resolve().parents[1]
LOG_EVERY_FRAME = [f"--log-{group}-rate=0" for group in ("pose", "force", "rope", "path")]  # of sim and simulate
# of DDS, whose ports are 7400 + 250 * domain and on: those above and below the ports that Linux gives to clients
DOMAINS = (*range(215, 233), *range(101, 79, -1))
_next_domains = cycle(DOMAINS)
_locks: dict[int, IO[str]] = {}


def allocate_domain() -> int:
    """Reserve an unused ROS domain of this machine until its release or the end of this process."""
    for domain in islice(_next_domains, len(DOMAINS)):
        lock = (Path(tempfile.gettempdir()) / f"cable_twin_test_domain_{domain}.lock").open("a")
        with suppress(OSError):  # another test has it
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if not _is_used(domain):
                _locks[domain] = lock
                return domain
        lock.close()
    raise RuntimeError(f"no free ROS domain among {DOMAINS}")


def _is_used(domain: int) -> bool:
    """Whether a process listens on a port of a ROS domain."""
    first = 7400 + 250 * domain
    sockets = [line.split() for file in Path("/proc/net").glob("udp*") for line in file.read_text().splitlines()[1:]]
    return any(first <= int(socket[1].rpartition(":")[2], 16) < first + 250 for socket in sockets)


def release_domain(domain: int) -> None:
    """Release a ROS domain; no effect where not reserved by this process."""
    if domain in _locks:
        _locks.pop(domain).close()


@cache
def _common_domain() -> int:
    """ROS domain of commands that need no other participant."""
    return allocate_domain()


def environment(directory: Path, domain: int | None = None) -> dict[str, str]:
    """Environment of a process: package under test, own ROS domain, no files outside `directory`."""
    paths = [str(PACKAGE_PARENT), *filter(None, [os.environ.get("PYTHONPATH")])]
    return {
        **os.environ,
        "PYTHONPATH": os.pathsep.join(paths),
        "PYTHONUNBUFFERED": "1",
        "ROS_DOMAIN_ID": str(_common_domain() if domain is None else domain),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "ROS_LOG_DIR": str(directory / "ros_log"),
    }


def write_quick_scenario(directory: Path, space: int = 2) -> Path:
    """Write a single span of low cost, whose drive reaches its speed in a second or two, in wind or calm."""
    yaml = YAML()
    content = yaml.load((config_directory() / "aerial_tramway.yaml").read_text(encoding="utf-8"))
    content["cable"].update(elements=20, start={"position": [0.0, 0.0]})
    del content["towers"]
    content["solver"]["step"] = 0.005  # s, half a frame
    cabin = content["carriages"]["cabin"]
    cabin["arc_length"] = 60.0
    cabin["drive"]["limits"].update(acceleration=4.0, deceleration=None, jerk=40.0)
    del cabin["drive"]["haul_rope"]
    cabin["bodies"]["cabin"].update(mass=9500.0, inertia=23156.0)
    cabin["payload"] = {"capacity": 6400.0, "position": [0.3, -0.8], "station_distance": 70.0}
    cabin["bodies"]["cabin"]["drag_area"] = 15.0
    if space == 3:
        content["space"] = 3
        cabin["bodies"]["cabin"]["inertia_tensor"] = [21000.0, 23156.0, 15000.0]
    path = directory / "quick.yaml"
    with path.open("w", encoding="utf-8") as stream:
        yaml.dump(content, stream)
    return path


def wait_until(condition: Callable[[], Any], timeout: float = PATIENCE, what: str = "") -> Any:
    """Poll a condition; returns its result, or fails at the time-out."""
    deadline = time.monotonic() + timeout
    while not (value := condition()):
        assert time.monotonic() < deadline, f"not within {timeout:g} s: {what or condition}"
        time.sleep(0.02)
    return value


_twins: dict[int, TwinProcess] = {}  # the newest of each domain


def check_alive(domain: int) -> None:
    """Fail with the output of a twin that has ended, instead of waiting for it."""
    twin = _twins.get(domain)
    assert twin is None or twin.process.poll() is None, f"the twin has ended: {twin.output}"


class TwinProcess:
    """Command of the package as a process, not forked where `command` or `variables` are given."""

    def __init__(
        self,
        directory: Path,
        *arguments: str,
        module: str = "ros.sim",  # or the path of a script
        domain: int | None = None,
        command: Sequence[str] | None = None,
        variables: Mapping[str, str] | None = None,
    ) -> None:
        self.directory = directory
        self.owns_domain = domain is None
        self.domain = allocate_domain() if domain is None else domain
        self.output_path = directory / f"{Path(module).stem if '/' in module else module}_{time.monotonic_ns()}.txt"
        self.output_path.touch()
        self.name = " ".join((module, *arguments))
        if module == "ros.sim":
            _twins[self.domain] = self
            if command is None and not any(argument.startswith("--outlook") for argument in arguments):
                arguments = "--outlook", "false", *arguments  # which would run a minute ahead all the time
        self.process: subprocess.Popen[bytes] | ForkedProcess
        if command is None and variables is None:
            variables = environment(directory, self.domain)
            self.process = ForkedProcess(module, arguments, directory, variables, self.output_path, self.output_path)
            return
        with self.output_path.open("w") as output:
            self.process = subprocess.Popen(
                [*(command or [sys.executable, "-m", f"cable_twin.{module}"]), *arguments],
                cwd=directory,
                env=environment(directory, self.domain) if variables is None else variables,
                stdout=output,
                stderr=subprocess.STDOUT,
            )

    @property
    def output(self) -> str:
        """Output so far."""
        return self.output_path.read_text()

    @property
    def run_directory(self) -> Path:
        """Directory of the only recorded run."""
        (run,) = (self.directory / "cable_twin_logs").iterdir()
        return run

    def wait_for(self, text: str, timeout: float = COMPILING) -> None:
        """Wait for a text in the output."""
        wait_until(lambda: text in self.output or self.process.poll() is not None, timeout, text)
        assert text in self.output, self.output

    def send(self, number: int) -> None:
        """Send a signal to the process."""
        self.process.send_signal(number)

    def wait(self, timeout: float = PATIENCE) -> int:
        """Wait for the end of the process; returns its exit code. One that goes on is killed and named."""
        try:
            return self.process.wait(timeout)
        except subprocess.TimeoutExpired:
            self.process.kill()
            raise AssertionError(f"{self.name} went on for {timeout:g} s and was killed: {self.output}") from None

    def end(self) -> int:
        """End the process as by Ctrl-C."""
        self.send(signal.SIGINT)
        return self.wait()

    def kill(self) -> None:
        """Kill the process, if still running."""
        with suppress(ProcessLookupError):
            self.process.kill()
        self.process.wait()
        if _twins.get(self.domain) is self:  # another test may get its domain
            del _twins[self.domain]
        if self.owns_domain:
            release_domain(self.domain)


def refused_starts(directory: Path, *starts: Sequence[str]) -> list[list[str]]:
    """Error lines of `sim` for each list of arguments; each is refused without other output or recording."""
    said = []
    for arguments in starts:
        result = run_module("ros.sim", *arguments, directory=directory)
        assert (result.returncode, result.stdout) == (1, "")
        said.append(result.stderr.splitlines())
    assert not (directory / "cable_twin_logs").exists()
    return said


def stamps(messages: list[Any]) -> list[int]:
    """Stamps (ns) of messages."""
    return [message.header.stamp.sec * SECOND + message.header.stamp.nanosec for message in messages]


def gaps(messages: list[Any]) -> list[int]:
    """Differences (ns) of successive stamps."""
    return [after - before for before, after in pairwise(stamps(messages))]


def run_python(
    *arguments: object, directory: Path = REPOSITORY, variables: Mapping[str, str] | None = None
) -> subprocess.CompletedProcess[str]:
    """Run Python with the package under test and compiled kernels; returns the output."""
    paths = [str(REPOSITORY), *filter(None, [os.environ.get("PYTHONPATH")])]
    own = {"PYTHONPATH": os.pathsep.join(paths), "NUMBA_DISABLE_JIT": "0", **(variables or {})}
    return subprocess.run(
        [sys.executable, *map(str, arguments)],
        cwd=directory,
        env={**os.environ, **own},
        capture_output=True,
        text=True,
        timeout=COMPILING,
        check=False,
    )


def run_module(module: str, *arguments: str, directory: Path) -> Any:
    """Run a command of the package, such as `offline.simulate`, to its end; returns the output."""
    with tempfile.TemporaryDirectory(prefix="cable_twin_said_") as name:
        output, errors = Path(name) / "output", Path(name) / "errors"
        process = ForkedProcess(module, arguments, directory, environment(directory), output, errors)
        try:
            process.wait(COMPILING)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait(PATIENCE)
            raise AssertionError(f"{module} goes on: {output.read_text()}{errors.read_text()}") from None
        return subprocess.CompletedProcess(
            [module, *arguments], process.returncode, output.read_text(), errors.read_text()
        )
