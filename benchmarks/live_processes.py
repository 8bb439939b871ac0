"""Processes of the live benchmark: the twin as started by users, and timers that only wait."""

from __future__ import annotations

import multiprocessing
import os
import signal
import struct
import subprocess
import sys
import time
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.measure import BenchmarkError, environment_of_user
from cable_twin.messages import SECOND
from cable_twin.runtime.frame_statistics import LatenessHistogram
from cable_twin.scenario import load_scenario

NODE = "/cable_twin"
COMMAND_PERIOD = 0.05  # s
SPEED_PERIOD = 1.5  # s from one speed to the next
MEGABYTE = 1e6
PERIOD = 0.01  # s, of a frame: the node's default
STAMP = struct.Struct("<2I")  # of a message that begins with a header


def bare_timer(period: float, core: int | None, connection: Connection) -> None:
    """Wait for one deadline after the other; each message is answered by the lateness since the last one.

    The first message begins it.

    Args:
        period: s.
        core: processor that it stays on; None lets the system choose, as it does for the twin.
        connection: takes anything and gives the largest lateness (s) since the last, or for None the whole summary.
    """
    if core is not None:
        os.sched_setaffinity(0, {core})
    connection.recv()
    connection.send("begin")
    total, recent = LatenessHistogram(period), LatenessHistogram(period)
    due = time.monotonic()
    while True:
        due += period
        time.sleep(max(due - time.monotonic(), 0.0))
        late = max(time.monotonic() - due, 0.0)
        total.add(late)
        recent.add(late)
        if connection.poll():
            if connection.recv() is None:
                connection.send(total.summary())
                return
            connection.send(recent.maximum)
            recent = LatenessHistogram(period)


class BareTimer:
    """Bare timer in a separate process."""

    def __init__(self, period: float, core: int | None) -> None:
        spawning = multiprocessing.get_context("spawn")
        self._ours, theirs = spawning.Pipe()
        self._process = spawning.Process(target=bare_timer, args=(period, core, theirs), daemon=True)
        self._process.start()

    def begin(self) -> None:
        """Begin to count; the process has been started before."""
        self._ours.send("begin")
        self._ours.recv()

    def latest(self) -> float:
        """Largest lateness (s) since the last call."""
        self._ours.send("")
        return float(self._ours.recv())

    def summary(self) -> dict[str, float]:
        """Read the results and end the process."""
        self._ours.send(None)
        return self._ours.recv()

    def close(self) -> None:
        """End the process, if still running."""
        if self._process.is_alive():
            self._process.terminate()


def processor_seconds(process: int) -> float:
    """User and system time (s) of a process with all its threads so far."""
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def memory(process: int, key: str) -> float:
    """Memory (MB) of a process: `VmRSS` now or `VmHWM` at most."""
    for line in Path(f"/proc/{process}/status").read_text().splitlines():
        if line.startswith(f"{key}:"):
            return int(line.split()[1]) * 1024.0 / MEGABYTE
    raise BenchmarkError(f"process {process} has ended")


class Twin:
    """Process of `sim`, and a node that commands it and takes its diagnostics."""

    def __init__(self, scenario: str, directory: Path) -> None:
        """Start `sim` in the domain of ROS_DOMAIN_ID, or one of 20 to 99; driven names come from the scenario."""
        try:
            import rclpy  # noqa: PLC0415 - the bare timer's process must not load it
            from diagnostic_msgs.msg import DiagnosticArray  # noqa: PLC0415
            from rclpy.executors import SingleThreadedExecutor  # noqa: PLC0415
            from sensor_msgs.msg import JointState  # noqa: PLC0415
        except ImportError as error:
            raise BenchmarkError(f"{error}: `pip install '.[ros]'` adds what is missing") from error

        loaded = load_scenario(scenario)
        own = {name: one for name, one in loaded.carriages.items() if one.joint == "sliding" and not one.clamped_to}
        driven = {name: one.drive for name, one in own.items()} | loaded.drives
        self._limits = {name: drive.limits.speed or 1.0 for name, drive in driven.items()}
        self._joint_state = JointState
        self._random = np.random.default_rng(4)
        self._next_speeds = self._next_command = 0.0
        self._speeds: list[float] = []
        self.commands_sent = 0
        self.reports: list[dict[str, str]] = []
        self.delays = LatenessHistogram(PERIOD)
        self._log = directory / "sim.txt"
        domain = int(os.environ.get("ROS_DOMAIN_ID") or 20 + os.getpid() % 80)
        environment = {
            **environment_of_user(),
            "ROS_DOMAIN_ID": str(domain),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
            "PYTHONUNBUFFERED": "1",
        }
        command = [sys.executable, "-m", "cable_twin.ros.sim", "--scenario", scenario]
        command += ["--record-directory", str(directory / "logs")]
        with self._log.open("w", encoding="utf-8") as output:
            self.process = subprocess.Popen(command, env=environment, stdout=output, stderr=subprocess.STDOUT)
        os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
        self._context = rclpy.Context()
        rclpy.init(context=self._context, domain_id=domain)
        self._node = rclpy.create_node("live_benchmark", context=self._context)
        self._publisher = self._node.create_publisher(JointState, f"{NODE}/joint_commands", 10)
        self._node.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, 10)
        self._node.create_subscription(JointState, f"{NODE}/joint_states", self._on_joint_states, 100, raw=True)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)

    def wait_for_report(self, timeout: float) -> dict[str, str]:
        """Send commands until the next report of the twin has come.

        Raises:
            BenchmarkError: when the twin has ended, or does not report in time.
        """
        count = len(self.reports)
        deadline = time.monotonic() + timeout
        while len(self.reports) == count:
            if self.process.poll() is not None:
                raise BenchmarkError(
                    f"the twin ended with exit code {self.process.returncode}:\n{self._log.read_text()}"
                )
            if time.monotonic() > deadline:
                raise BenchmarkError(f"no report on /diagnostics within {timeout:g} s:\n{self._log.read_text()}")
            if self.reports and time.monotonic() >= self._next_command:  # else it is still on its way
                self._next_command = time.monotonic() + COMMAND_PERIOD
                self._command()
            self._executor.spin_once(timeout_sec=COMMAND_PERIOD)
        return self.reports[-1]

    def close(self) -> None:
        """End the twin as Ctrl-C does."""
        self.process.send_signal(signal.SIGINT)
        try:
            self.process.wait(30.0)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        self._executor.shutdown()
        self._node.destroy_node()
        self._context.try_shutdown()

    def _command(self) -> None:
        now = time.monotonic()
        if now >= self._next_speeds:
            self._next_speeds = now + SPEED_PERIOD
            self._speeds = [float(self._random.uniform(-limit, limit)) for limit in self._limits.values()]
        self._publisher.publish(self._joint_state(name=list(self._limits), velocity=self._speeds))
        self.commands_sent += 1

    def _on_joint_states(self, data: bytes) -> None:
        """Record the age of a frame on arrival, as `ros2 topic delay` does."""
        now = time.time_ns()
        stamp = STAMP.unpack_from(data, 4)
        self.delays.add(max((now - stamp[0] * SECOND - stamp[1]) / SECOND, 0.0))

    def _on_diagnostics(self, message: Any) -> None:
        self.reports.append({pair.key: pair.value for status in message.status for pair in status.values})
