"""Time to the answer of an emergency stop under load: message floods, bombs, loading of worlds, a full disk."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from rich.progress import Progress

from benchmarks.live_processes import NODE, PERIOD, BareTimer
from benchmarks.measure import BenchmarkError, Effort, environment_of_user
from benchmarks.report import Part, Table, Value
from cable_twin.runtime.frame_loop import wake_promptly

SCENARIO = "single_span"
RATE = 100.0  # calls in a second, a stop and its release in turn
SECONDS, QUICK_SECONDS = 30.0, 3.0  # of each load
SETTLING = 2.0  # s that a load has before calls count
MOST = 50.0  # ms, at p99.9
BARE = "bare timer late, p99.9 [ms]"
DISK = 64  # MB of the disk that fills
STARTING, ANSWERING = 600.0, 30.0  # s: with a compilation; for the last answers
LOADS = {  # process of `benchmarks.hostile` beside the twin; "" for none
    "calm": "",
    "10,000 hostile messages a second": "messages",
    "bombs as scenarios": "bombs",
    "readers that hang": "readers",
    "full disk": "",
    "worlds that are loaded": "worlds",
}


def run(effort: Effort, progress: Progress) -> Part:
    """Call the emergency stop at a steady rate under one load after the other."""
    try:
        import rclpy  # noqa: F401, PLC0415 - an extra
    except ImportError as error:
        raise BenchmarkError(f"{error}: `pip install '.[ros]'` adds what is missing") from error
    seconds = QUICK_SECONDS if effort.quick else SECONDS
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    os.environ.setdefault("ROS_DOMAIN_ID", str(20 + os.getpid() % 80))
    rows, notes = [], []
    task = progress.add_task("emergency stop", total=len(LOADS))
    with (
        tempfile.TemporaryDirectory(prefix="cable_twin_stop_") as name,
        _disk(Path(name)) as (disk, own),
        _twin(disk) as process,
        _Caller() as caller,
    ):
        for title, load in LOADS.items():
            progress.update(task, description=f"emergency stop: {title}")
            if title == "full disk" and not own:
                notes.append("No full disk: only root may mount one (tmpfs).")
                progress.advance(task)
                continue
            if title == "full disk":
                _fill(disk)
            with _hostile(load, disk):
                time.sleep(SETTLING)
                rows.append({"load": title, **_measured(caller, seconds)})
            if process.poll() is not None:
                raise BenchmarkError(f"the twin ended with exit code {process.returncode} under: {title}")
            progress.advance(task)
    faults = [
        f"emergency_stop: {row['load']}: p99.9 of {row['p99.9 [ms]']:.1f} ms, {row['unanswered']} unanswered, allowed "
        f"are {MOST:g} ms and none; a bare timer was {row[BARE]:.1f} ms late"
        for row in rows
        if float(row["p99.9 [ms]"] or 0.0) > MOST or row["unanswered"]
    ]
    notes += [
        f"`{NODE}/emergency_stop` of `sim {SCENARIO}` with logs, called {RATE:g} times a second for {seconds:g} s "
        "under each load, a stop and its release in turn; from the call to its answer in another process. A bare timer "
        "in a third process waits for a period of 10 ms meanwhile.",
        "Messages: of unknown names, of a name five times, with control characters, noise, and sound commands in turn; "
        "one in a thousand has 20,000 names or a `frame_id` of 1 MB. Bombs: aliases that stand for 10^12 values, a "
        "pipe and an endless device as `scenario`. Readers that hang: ten stopped processes that subscribe reliably.",
    ]
    return Part("Emergency stop", [Table("from call to answer", rows)], notes, faults)


class _Caller:
    """Thread that calls the emergency stop at a steady rate."""

    def __init__(self) -> None:
        import rclpy  # noqa: PLC0415 - of the extra ros
        from rclpy.qos import QoSProfile  # noqa: PLC0415
        from std_srvs.srv import SetBool  # noqa: PLC0415

        from cable_twin.ros.startup import new_executor  # noqa: PLC0415

        self._context = rclpy.Context()
        rclpy.init(context=self._context)
        self._node = rclpy.create_node("emergency_stop_benchmark", context=self._context)
        self._request = SetBool.Request
        self._client = self._node.create_client(SetBool, f"{NODE}/emergency_stop", qos_profile=QoSProfile(depth=10_000))
        self._executor = new_executor(self._context)
        self._executor.add_node(self._node)

    def __enter__(self) -> _Caller:
        deadline = time.monotonic() + STARTING
        while not self._client.service_is_ready():
            if time.monotonic() > deadline:
                raise BenchmarkError(f"no twin within {STARTING:g} s")
            time.sleep(0.1)
        self.call(10, 10.0)  # the first ones make connections
        return self

    def __exit__(self, *_: object) -> None:
        self._executor.shutdown()
        self._node.destroy_node()
        self._context.try_shutdown()

    def call(self, count: int, rate: float) -> list[float]:
        """Latencies (s) of answered calls among a number of calls at a rate (Hz)."""
        found: list[float] = []
        thread = threading.Thread(target=self._call, args=(count, rate, found))
        thread.start()
        thread.join()
        return found

    def _call(self, count: int, rate: float, found: list[float]) -> None:
        wake_promptly()
        due = time.monotonic()
        for number in range(count):
            begun = time.monotonic()
            future = self._client.call_async(self._request(data=number % 2 == 0))
            future.add_done_callback(lambda _, begun=begun: found.append(time.monotonic() - begun))
            due += 1.0 / rate
            while (left := due - time.monotonic()) > 0.0:
                self._executor.spin_once(timeout_sec=left)
        deadline = time.monotonic() + ANSWERING
        while len(found) < count and time.monotonic() < deadline:
            self._executor.spin_once(timeout_sec=0.1)


def _measured(caller: _Caller, seconds: float) -> dict[str, Value]:
    """Row of the table for one load."""
    timer = BareTimer(PERIOD, None)
    timer.begin()
    count = round(RATE * seconds)
    try:
        latencies = 1e3 * np.array(caller.call(count, RATE) or [np.inf])
        bare = timer.summary()
    finally:
        timer.close()
    p50, p99, rare = (float(value) for value in np.percentile(latencies, (50.0, 99.0, 99.9), method="higher"))
    return {
        "calls": count,
        "unanswered": count - latencies.size,
        "p50 [ms]": p50,
        "p99 [ms]": p99,
        "p99.9 [ms]": rare,
        "longest [ms]": float(latencies.max()),
        BARE: bare["lateness_p99.9_ms"],
    }


@contextmanager
def _twin(disk: Path) -> Iterator[subprocess.Popen[bytes]]:
    """Twin in a separate process, with logs and loadable scenarios in a directory."""
    command = [sys.executable, "-m", "cable_twin.ros.sim", SCENARIO, "--record-directory", str(disk / "logs")]
    process = subprocess.Popen(
        [*command, "--scenario-directories", str(disk)],
        env=environment_of_user(),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        yield process
    finally:
        process.send_signal(signal.SIGINT)
        try:
            process.wait(30.0)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


@contextmanager
def _hostile(load: str, disk: Path) -> Iterator[None]:
    """Process of a load for a while."""
    if not load:
        yield
        return
    command = [sys.executable, "-m", "benchmarks.hostile", load, str(disk)]
    process = subprocess.Popen(command, env=environment_of_user(), stdout=subprocess.PIPE, start_new_session=True)
    assert process.stdout is not None
    process.stdout.readline()  # it is at it
    try:
        yield
        if process.poll() is not None:
            raise BenchmarkError(f"the process of hostile {load} has ended")
    finally:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()


@contextmanager
def _disk(directory: Path) -> Iterator[tuple[Path, bool]]:
    """Small file system, and whether it could be mounted, which needs root."""
    disk = directory / "disk"
    disk.mkdir()
    mount: Callable[..., Any] = lambda *command: subprocess.run(command, check=False, capture_output=True)  # noqa: E731
    own = mount("mount", "-t", "tmpfs", "-o", f"size={DISK}m", "cable_twin", str(disk)).returncode == 0
    try:
        yield disk, own
    finally:
        if own:
            mount("umount", "-l", str(disk))


def _fill(disk: Path) -> None:
    """Fill the disk completely."""
    with (disk / "filler").open("wb", buffering=0) as filler:
        try:
            while True:
                filler.write(bytes(1 << 16))
        except OSError:
            return
