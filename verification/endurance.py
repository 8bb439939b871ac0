"""Hours of operation in minutes: memory, lateness and complete log of a twin.

Starts the node `sim` at a multiple of real time (single_span on 24 elements), drives its cabin up and down from
another process, and looks at its memory and its diagnostics once a second. Eight hours at 40 times real time:

    .venv/bin/python -m verification.endurance --hours 8
"""

from __future__ import annotations

import argparse
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from cable_twin.messages import JOINT_STATES, SECOND, decode
from cable_twin.recording.log_reader import read_log
from cable_twin.scenario import load_scenario

FRAME_RATE = 10.0  # Hz of simulated time: at 40 times real time 400 frames in a second of the clock
FACTOR = 40.0  # times real time
ELEMENTS = 24  # of the cable, so that two cores keep up
STATIONS = (150.0, 900.0)  # m of arc length between which the cabin of single_span goes up and down
SPEED = 8.0  # m/s
STARTING = 180.0  # s; the kernels may have to be compiled
WARM = 0.2  # part of the run after which memory is looked at


@dataclass(frozen=True)
class Endurance:
    """Results of a long run; each pair is of its first and its last quarter."""

    hours: float  # simulated
    wall_time: float  # s
    frames: int
    trips: int
    memory: tuple[float, float]  # MB resident, mean
    memory_slope: float  # MB in an hour of simulated time
    slope_by_frames: float  # MB in a million frames
    lateness: tuple[float, float]  # ms, median of the medians of each second
    lateness_p99: tuple[float, float]  # ms, median of the 99th percentiles of each second
    factor: float  # times real time, on the whole
    missing: int  # frames that are not in the log
    dropped: int  # as the twin counts them
    log_size: int  # bytes

    def lines(self) -> list[str]:
        """Text of a table."""
        first, last = self.memory
        return [
            f"simulated {self.hours:.2f} h in {self.wall_time:.0f} s, {self.factor:.1f} times real time; "
            f"{self.frames} frames, {self.trips} trips, log of {self.log_size / 1e6:.0f} MB",
            f"memory {first:.1f} MB in the first quarter, {last:.1f} MB in the last; "
            f"{self.memory_slope:+.2f} MB an hour, {self.slope_by_frames:+.1f} MB in a million frames",
            f"lateness, median {self.lateness[0]:.3f} ms and {self.lateness[1]:.3f} ms, "
            f"p99 {self.lateness_p99[0]:.2f} ms and {self.lateness_p99[1]:.2f} ms",
            f"frames missing in the log {self.missing}, dropped {self.dropped}",
        ]


class Operator:
    """Operator that drives the cabin between the stations and receives the diagnostics."""

    def __init__(self, domain: int, process: int) -> None:
        import rclpy  # noqa: PLC0415 - --help works without it
        from diagnostic_msgs.msg import DiagnosticArray  # noqa: PLC0415
        from rclpy.executors import SingleThreadedExecutor  # noqa: PLC0415
        from sensor_msgs.msg import JointState  # noqa: PLC0415

        self._context = rclpy.Context()
        rclpy.init(context=self._context, domain_id=domain)
        self._node = rclpy.create_node("operator", context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._status = Path(f"/proc/{process}/statm")
        self.rows: list[tuple[float, float, float, float]] = []  # simulated s, MB, lateness median and p99 in ms
        self.simulated = 0.0
        self.trips = 0
        self.dropped = 0
        self._direction = 1.0
        self._command = JointState(name=["cabin"], velocity=[SPEED])
        self._publisher = self._node.create_publisher(JointState, "/cable_twin/joint_commands", 50)
        self._node.create_subscription(JointState, f"/cable_twin/{JOINT_STATES}", self._drive, 1, raw=True)
        self._node.create_subscription(DiagnosticArray, "/diagnostics", self._watch, 10, raw=True)
        self._heard = 0

    def work(self, seconds: float, until: Callable[[], Any]) -> None:
        """Take messages and give commands."""
        deadline = time.monotonic() + seconds
        while time.monotonic() < deadline and not until():
            self._executor.spin_once(timeout_sec=0.05)

    def close(self) -> None:
        """Leave the ROS domain."""
        self._executor.shutdown()
        self._node.destroy_node()
        self._context.try_shutdown()

    def _drive(self, data: bytes) -> None:
        self._heard += 1
        if self._heard % 30:
            return
        arc_length = decode(data, "sensor_msgs/msg/JointState").position[0]
        turning = arc_length > STATIONS[1] if self._direction > 0.0 else arc_length < STATIONS[0]
        if turning:
            self._direction = -self._direction
            self._command.velocity = [SPEED * self._direction]
            self.trips += 1
        self._publisher.publish(self._command)

    def _watch(self, data: bytes) -> None:
        tasks = decode(data, "diagnostic_msgs/msg/DiagnosticArray").status
        values: Mapping[str, str] = {pair.key: pair.value for status in tasks for pair in status.values}
        self.simulated = float(values["simulated_time_s"])
        self.dropped = int(values["log_dropped_frames"])
        memory = int(self._status.read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6
        lateness = float(values["lateness_median_ms"]), float(values["lateness_p99_ms"])
        self.rows.append((self.simulated, memory, *lateness))


def run(hours: float, factor: float, directory: Path, domain: int, on_time: Callable[[float], None]) -> Endurance:
    """Operate a twin for a time (s).

    Args:
        hours: of simulated time.
        factor: times real time.
        directory: where logs are written.
        domain: ROS domain of the twin.
        on_time: called with simulated time (s), about once a second.

    Raises:
        RuntimeError: The twin did not start, or ended by itself.
    """
    scenario = load_scenario("single_span", {"cable.elements": ELEMENTS}).resolved()
    path = directory / "scenario.yaml"
    path.write_text(json.dumps({key: scenario[key] for key in scenario if key != "name"}), encoding="utf-8")
    arguments = [
        "--scenario",
        path,
        "--frame-rate",
        FRAME_RATE,
        "--real-time-factor",
        factor,
        "--record-directory",
        directory / "logs",
    ]
    output = directory / "output.txt"
    with output.open("w") as stream:
        sim = subprocess.Popen(
            [sys.executable, "-m", "cable_twin.ros.sim", *map(str, arguments)],
            env={**os.environ, "ROS_DOMAIN_ID": str(domain), "ROS_LOG_DIR": str(directory)},
            stdout=stream,
            stderr=subprocess.STDOUT,
        )
    operator = Operator(domain, sim.pid)
    try:
        operator.work(STARTING, lambda: operator.rows or sim.poll() is not None)
        started, first = time.monotonic(), operator.simulated
        while operator.simulated < 3600.0 * hours and operator.rows and sim.poll() is None:
            operator.work(1.0, lambda: False)
            on_time(operator.simulated)
        wall_time, last = time.monotonic() - started, operator.simulated
        sim.send_signal(signal.SIGINT)
        if sim.wait(120.0) != 0 or last < 3600.0 * hours:
            raise RuntimeError(f"the twin ended too early: {output.read_text()}")
    finally:
        sim.kill()
        sim.wait()
        operator.close()
    log = read_log(next((directory / "logs").iterdir()))
    stamps = [stamp for _, stamp, _ in log.messages([JOINT_STATES])]
    frame = round(SECOND / FRAME_RATE)
    rows = np.array(operator.rows)
    warm = rows[rows[:, 0] >= WARM * last]
    slope = float(np.polyfit(warm[:, 0] / 3600.0, warm[:, 1], 1)[0])
    quarter = max(len(rows) // 4, 1)
    quarters = [(rows[:quarter, column], rows[-quarter:, column]) for column in (1, 2, 3)]
    return Endurance(
        hours=last / 3600.0,
        wall_time=wall_time,
        frames=len(stamps),
        trips=operator.trips,
        memory=(float(quarters[0][0].mean()), float(quarters[0][1].mean())),
        memory_slope=slope,
        slope_by_frames=slope / (3600.0 * FRAME_RATE) * 1e6,
        lateness=(float(np.median(quarters[1][0])), float(np.median(quarters[1][1]))),
        lateness_p99=(float(np.median(quarters[2][0])), float(np.median(quarters[2][1]))),
        factor=(last - first) / wall_time,
        missing=sum((after - before) // frame - 1 for before, after in pairwise(stamps)) + (not log.complete),
        dropped=operator.dropped,
        log_size=log.size,
    )


def main() -> int:
    """Run the test and print its results; returns 1 when frames are missing."""
    parser = argparse.ArgumentParser(
        prog="python -m verification.endurance", description="Operate a twin for hours of simulated time."
    )
    parser.add_argument("--hours", type=float, default=8.0, help="of simulated time; default: 8")
    parser.add_argument("--factor", type=float, default=FACTOR, help="times real time; default: 40")
    options = parser.parse_args()
    columns = (TextColumn("{task.completed:.0f} of {task.total:.0f} s"), BarColumn(), TimeRemainingColumn())
    with tempfile.TemporaryDirectory() as directory, Progress(*columns, disable=not sys.stdout.isatty()) as progress:
        task = progress.add_task("operate", total=3600.0 * options.hours)
        result = run(
            options.hours,
            options.factor,
            Path(directory),
            random.randrange(20, 100),
            lambda simulated: progress.update(task, completed=simulated),
        )
    print("\n".join(result.lines()))
    return int(result.missing > 0 or result.dropped > 0)


if __name__ == "__main__":
    sys.exit(main())
