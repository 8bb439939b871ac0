"""Time measurement: wall time of single calls, medians over rounds in which all contestants take turns."""

from __future__ import annotations

import os
import platform
import statistics
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import datetime, timezone
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from rich.progress import Progress

from benchmarks import ONE_THREAD

ROOT = Path(__file__).resolve().parents[1]
LEAST_SHARE = 0.9  # of a processor; with less, something else was running


class BenchmarkError(RuntimeError):
    """Failed measurement; the reason in one line."""


@dataclass(frozen=True, slots=True)
class Effort:
    """Extent of a measurement."""

    quick: bool  # fewer and shorter cases
    repetitions: int
    minutes: float | None = None  # of the live twin; None for its own choice
    scenarios: tuple[str, ...] = ()  # of the live twin; none for its own choice
    beside: Path | None = None  # another checkout, of loads


@dataclass(frozen=True, slots=True)
class Timing:
    """Medians over the repetitions of one contestant."""

    wall: float  # s
    processor: float  # s, of the thread alone: less than wall where other programs took the processor from it

    @property
    def share(self) -> float:
        """Share of the wall time in which the thread had a processor."""
        return self.processor / self.wall


def timed(function: Callable[[], object]) -> Timing:
    """Time one call."""
    wall, processor = time.perf_counter(), time.thread_time()
    function()
    processor, wall = time.thread_time() - processor, time.perf_counter() - wall
    return Timing(wall, processor)


def interleave(
    contestants: Mapping[str, Callable[[], Callable[[], object]]],
    repetitions: int,
    progress: Progress,
    description: str,
) -> dict[str, Timing]:
    """Time contestants in turn, round after round, so that a slow spell of the machine meets all of them.

    Args:
        contestants: by name, a function that prepares a run and returns what is timed.
        repetitions: rounds.
        progress: shows how far it is.
        description: of the task.

    Returns:
        Medians by name.
    """
    rounds: dict[str, list[Timing]] = {name: [] for name in contestants}
    turns = [(name, prepare) for _ in range(repetitions) for name, prepare in contestants.items()]
    for name, prepare in progress.track(turns, description=description):
        rounds[name].append(timed(prepare()))
    return {name: median(timings) for name, timings in rounds.items()}


def median(timings: list[Timing]) -> Timing:
    """Medians of wall time and of processor time."""
    return Timing(
        statistics.median(timing.wall for timing in timings), statistics.median(timing.processor for timing in timings)
    )


def environment_of_user() -> dict[str, str]:
    """Environment of a process as started by users: this checkout, any number of threads."""
    paths = [str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])]
    kept = {key: value for key, value in os.environ.items() if key not in ONE_THREAD}
    return {**kept, "PYTHONPATH": os.pathsep.join(paths)}


def note_on_load(timings: list[Timing]) -> str:
    """Note in one line on other load of the machine during the measurement."""
    share = min(timing.share for timing in timings)
    line = f"The measured thread had a processor for at least {share:.0%} of the time (median of each case)"
    return (
        f"{line}."
        if share >= LEAST_SHARE
        else f"{line}: **the machine was busy: wall times are too long**, processor times less so."
    )


def machine() -> dict[str, str]:
    """Description of machine and versions."""
    packages = ("cable_twin", "numba", "numpy", "exudyn")
    return {
        "date": datetime.now(timezone.utc).strftime("%Y-%m-%d %H:%M UTC"),
        "processor": f"{_processor()}, {os.cpu_count()} cores",
        "python": platform.python_version(),
        **{package: _version(package) for package in packages},
    }


def _processor() -> str:
    """Name of the processor by Linux."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.machine()
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed"
