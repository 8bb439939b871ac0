"""Frame rate of a paused twin stepped by its service, beside the Python API with equal messages."""

from __future__ import annotations

import os
import signal
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from rich.progress import Progress

from benchmarks.live_processes import processor_seconds
from benchmarks.measure import BenchmarkError, Effort, environment_of_user
from benchmarks.report import Part, Table, Value
from cable_twin.frame.rates import PUBLISHED
from cable_twin.messages import topics
from cable_twin.recording.frame_output import FrameOutput
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation

SCENARIOS = ("aerial_tramway", "single_span")
PERIOD = 0.01  # s, of a frame
FRAMES, QUICK_FRAMES, CALLS = 20_000, 300, 100  # of one call, and calls of one frame
LEAST = 0.8  # of the API with messages
SHARE = "the same of processor time"
NODE, STARTING = "/cable_twin", 300.0  # s, where it compiles


def run(effort: Effort, progress: Progress) -> Part:
    """Step each scenario by one call for many frames, and by one call for each frame."""
    try:
        import rclpy  # noqa: PLC0415 - an extra
    except ImportError as error:
        raise BenchmarkError(f"{error}: `pip install '.[ros]'` adds what is missing") from error
    frames = QUICK_FRAMES if effort.quick else FRAMES
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    domain = int(os.environ.get("ROS_DOMAIN_ID") or 20 + os.getpid() % 80)
    rows: list[dict[str, Value]] = []
    chosen = SCENARIOS[1:] if effort.quick else SCENARIOS
    task = progress.add_task("lockstep", total=len(chosen) * effort.repetitions)
    rclpy.init(domain_id=domain)
    try:
        node = rclpy.create_node("lockstep_benchmark")
        for scenario in chosen:
            alone, with_messages = _api(node, scenario)
            with _twin(node, scenario, domain) as twin:
                rounds = []
                for _ in range(effort.repetitions):
                    rates = [*_rates(alone, frames), *_rates(with_messages, frames)]
                    rates += _rates(twin.step, frames, lambda: processor_seconds(twin.process.pid))
                    rounds.append([*rates, *_rates(twin.calls, CALLS)])
                    progress.advance(task)
            rows.append(_row(scenario, rounds))
    finally:
        rclpy.shutdown()
    faults = [
        f"lockstep: {row['scenario']}: one call reaches {row[SHARE]:.2f} of the API with messages, allowed: {LEAST:g}"
        for row in rows
        if not effort.quick and float(row[SHARE] or 0.0) < LEAST
    ]
    notes = [
        f"Frames of {PERIOD * 1e3:g} ms a second of the clock, medians of {effort.repetitions} rounds; one call is "
        f"`~/step` with a `step_count` of {frames}, without logs. The API with messages encodes and publishes all "
        "topics of each frame, as the node does, which takes in its key figures besides.",
        f"One call for many frames is to reach {LEAST:g} of the API with messages, per processor time of the process.",
    ]
    return Part("Lockstep", [Table("frames a second", rows)], notes, faults)


def _row(scenario: str, rounds: list[list[float]]) -> dict[str, Value]:
    names = ("API alone", "API with messages", "one call", "a call a frame")
    rates = [statistics.median(column) for column in zip(*rounds, strict=True)]
    row: dict[str, Value] = {"scenario": scenario, **dict(zip(names, rates[::2], strict=True))}
    row["one call over the API"] = statistics.median(given[4] / given[2] for given in rounds)
    row[SHARE] = statistics.median(given[5] / given[3] for given in rounds)
    return row


def _rates(
    step: Callable[[int], object], frames: int, processor: Callable[[], float] = time.process_time
) -> tuple[float, float]:
    """Frames per second of wall time and of processor time."""
    started, used = time.perf_counter(), processor()
    step(frames)
    return frames / (time.perf_counter() - started), frames / max(processor() - used, 1e-9)


def _api(node: Any, scenario: str) -> tuple[Callable[[int], None], Callable[[int], None]]:
    """Frame rates of the plain API, and of the API with its messages built and published."""
    from cable_twin.ros.endpoints import Endpoints  # noqa: PLC0415 - of the extra ros

    simulation = Simulation(load_scenario(scenario))
    table = topics(simulation.layout)
    senders = Endpoints(node, table).senders
    output = FrameOutput(simulation, table, [PUBLISHED], frame_rate=1.0 / PERIOD)

    def alone(frames: int) -> None:
        for _ in range(frames):
            simulation.advance_to(simulation.time + PERIOD)

    def with_messages(frames: int) -> None:
        for _ in range(frames):
            for name, data in output.prepare(simulation.advance_to(simulation.time + PERIOD)).messages:
                senders[name](data)

    return alone, with_messages


class _Twin:
    """Paused twin in a separate process."""

    def __init__(self, node: Any, scenario: str, domain: int) -> None:
        from std_srvs.srv import Trigger  # noqa: PLC0415 - of the extra ros

        from cable_twin.ros.client.twin_client import TwinClient  # noqa: PLC0415
        from cable_twin.ros.startup import Ending  # noqa: PLC0415

        command = [sys.executable, "-m", "cable_twin.ros.sim", scenario, "--record", "false", "--start-paused"]
        environment = {**environment_of_user(), "ROS_DOMAIN_ID": str(domain)}
        self.process = subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        self.step = TwinClient(node, NODE, STARTING, Ending("benchmarks")).step
        self._node, self._request = node, Trigger.Request()
        self._client = node.create_client(Trigger, f"{NODE}/step")

    def calls(self, count: int) -> None:
        """Step frame by frame, one call after the other."""
        import rclpy  # noqa: PLC0415 - of the extra ros

        for _ in range(count):
            rclpy.spin_until_future_complete(self._node, self._client.call_async(self._request))


@contextmanager
def _twin(node: Any, scenario: str, domain: int) -> Iterator[_Twin]:
    """Context of a started twin."""
    from cable_twin.ros.client.twin_client import TwinError  # noqa: PLC0415 - of the extra ros

    twin = _Twin(node, scenario, domain)
    try:
        twin.step(10)
        yield twin
    except TwinError as error:
        raise BenchmarkError(str(error)) from error
    finally:
        twin.process.send_signal(signal.SIGINT)
        twin.process.wait(30.0)
