"""Punctuality of the live twin: late frames beside those of a bare timer in equal minutes.

`sim` runs in a process of its own, with all logs, as a user starts it; commands that change go to it over DDS, and
lateness is what its diagnostics count. A bare timer in another process waits for the same period and does nothing: what
makes that one late is the machine. Watchers do the same on one core each, as a stall may hit a core and not the other.
"""

from __future__ import annotations

import io
import os
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from rich.progress import Progress

from benchmarks.live_processes import PERIOD, BareTimer, Twin, memory, processor_seconds
from benchmarks.measure import Effort
from benchmarks.report import Part, Table, Value
from cable_twin.runtime.frame_statistics import COARSE_NAMES

SCENARIO = "aerial_tramway"
MINUTES, QUICK_MINUTES = 2.0, 0.1
START_TIMEOUT = 300.0  # s, with a compilation on a busy machine
REPORT_TIMEOUT = 30.0  # s
NEARBY = 1  # s around a missed frame in which a stall of the bare timer explains it
MOST_WATCHERS = 8  # cores that are watched one by one
SHOWN = 5  # seconds, the worst ones
MOST_LATE = 3.0  # ms at p99.9
MOST_PROCESSOR = {SCENARIO: 25.0}  # % of a core
MOST_PROCESSOR_OF_LIFTS = 35.0  # %
MOST_DELAY, MOST_RARE_DELAY = 2.0, 10.0  # ms from stamp to subscriber: median and p99
PICTURE = "live.png"
NAMES = {
    "median": "lateness_median_ms",
    "p99": "lateness_p99_ms",
    "p99.9": "lateness_p99.9_ms",
    "max": "lateness_max_ms",
}


@dataclass(frozen=True, slots=True)
class Second:
    """One report of the twin, and the bare timers up to then."""

    at: float  # s since the first report
    missed: int  # frames of the twin
    late: float  # ms, latest frame of the twin
    bare: float  # ms, the same of the bare timer
    stall: float  # ms, the same of the watchers, which stay on one core each


@dataclass(frozen=True, slots=True)
class Result:
    """Measurements of one run."""

    minutes: float
    twin: dict[str, float]  # by the names of the diagnostics
    bare: dict[str, float]
    seconds: list[Second]
    processor: float  # % of a core
    resident: float  # MB at the end
    peak: float  # MB
    commands: int
    refused: int
    dropped: int  # frames that are not in the logs
    scenario: str = SCENARIO
    delay: dict[str, float] = field(default_factory=dict)  # from stamp to subscriber, by the names of the diagnostics

    @property
    def unexplained(self) -> int:
        """Number of frames missed by the twin while no bare timer missed one."""
        return unexplained(self.seconds, PERIOD * 1e3)


def run(effort: Effort, progress: Progress) -> Part:
    """Run twin and bare timers beside each other, one scenario after the other."""
    minutes = effort.minutes or (QUICK_MINUTES if effort.quick else MINUTES)
    results = [measure(scenario, minutes, progress) for scenario in effort.scenarios or (SCENARIO,)]
    return Part(
        f"Live: {minutes:.3g} minutes at {1.0 / PERIOD:g} Hz with all logs",
        [
            table
            for result in results
            for table in (
                Table(f"{result.scenario}: lateness of frames", _lateness(result)),
                Table(f"{result.scenario}: process", [_process(result)]),
                Table(f"{result.scenario}: the seconds in which the twin was latest", _worst(result.seconds)),
            )
        ],
        [
            "`sim --scenario NAME` with all logs, given another speed every 1.5 s over DDS. A bare timer in "
            "another process waits for the same period.",
            "Watchers do as the bare timer, on one core each. A missed frame (later than a period) is the machine's "
            "where in that second, or one beside it, one of these missed its period too.",
        ],
        [fault for result in results for fault in faults(result)],
        {name: picture for result in results for name, picture in _pictures(result).items()},
    )


def measure(scenario: str, minutes: float, progress: Progress) -> Result:
    """Start the twin and the timers, and count from the first report.

    Raises:
        BenchmarkError: the twin does not start or ends early.
    """
    task = progress.add_task("live: starting the twin", total=None)
    with tempfile.TemporaryDirectory(prefix="cable_twin_live_") as directory:
        twin = Twin(scenario, Path(directory))
        cores = sorted(os.sched_getaffinity(0))[:MOST_WATCHERS]
        timers = [BareTimer(PERIOD, core) for core in (None, *cores)]
        seconds: list[Second] = []
        try:
            twin.wait_for_report(START_TIMEOUT)
            for timer in timers:
                timer.begin()
            begin, used = time.monotonic(), processor_seconds(twin.process.pid)
            progress.update(task, description="live: seconds", total=round(60.0 * minutes))
            while (elapsed := time.monotonic() - begin) < 60.0 * minutes:
                report = twin.wait_for_report(REPORT_TIMEOUT)
                bare, *stalls = [timer.latest() * 1e3 for timer in timers]
                missed, late = int(report["missed_frames"]), float(report["lateness_max_ms"])
                seconds.append(Second(round(elapsed, 1), missed, late, bare, max(stalls)))
                progress.update(task, completed=int(elapsed))
            used = processor_seconds(twin.process.pid) - used
            processor = 100.0 * used / (time.monotonic() - begin)
            resident, peak = memory(twin.process.pid, "VmRSS"), memory(twin.process.pid, "VmHWM")
            summary = timers[0].summary()
        finally:
            twin.close()
            for timer in timers:
                timer.close()
    return Result(
        minutes=elapsed / 60.0,
        twin={key.removeprefix("total_"): float(value) for key, value in report.items() if key.startswith("total_")},
        bare=summary,
        seconds=seconds,
        processor=processor,
        resident=resident,
        peak=peak,
        commands=twin.commands_sent,
        refused=int(report["commands_refused"]),
        dropped=int(report["log_dropped_frames"]),
        scenario=scenario,
        delay=twin.delays.summary(),
    )


def unexplained(seconds: Sequence[Second], period: float) -> int:
    """Number of frames missed by the twin while no bare timer did, within a second before or after.

    Args:
        seconds: one after the other.
        period: ms, from which on a frame is missed.
    """
    total = 0
    for index, second in enumerate(seconds):
        around = seconds[max(index - NEARBY, 0) : index + NEARBY + 1]
        if not any(max(other.bare, other.stall) > period for other in around):
            total += second.missed
    return total


def faults(result: Result) -> list[str]:
    """Exceeded limits, a line each."""
    found = []
    if result.unexplained:
        found.append(f"{result.unexplained} missed frames that no stall of the machine explains")
    late, bare = (one["lateness_p99.9_ms"] for one in (result.twin, result.bare))
    if late > MOST_LATE:
        found.append(f"lateness p99.9 of {late:.2f} ms, allowed are {MOST_LATE:g} ms (bare timer: {bare:.2f} ms)")
    most = MOST_PROCESSOR.get(result.scenario, MOST_PROCESSOR_OF_LIFTS)
    if result.processor > most:
        found.append(f"{result.processor:.1f} % of a core, allowed are {most:g} %")
    for key, allowed in (("lateness_median_ms", MOST_DELAY), ("lateness_p99_ms", MOST_RARE_DELAY)):
        if result.delay.get(key, 0.0) > allowed:
            name = key.removeprefix("lateness_").removesuffix("_ms")
            found.append(f"{name} of {result.delay[key]:.2f} ms from stamp to subscriber, allowed: {allowed:g} ms")
    if result.refused:
        found.append(f"{result.refused} of {result.commands} commands were refused")
    if result.dropped:
        found.append(f"{result.dropped} frames are missing in the logs")
    return [f"live: {result.scenario}: {line}" for line in found]


def _lateness(result: Result) -> list[dict[str, Value]]:
    """Table rows of lateness for the twin and the bare timer."""
    return [
        {
            "process": name,
            "frames": round(one["frames"]),
            "missed": round(one["missed_frames"]),
            **{f"{short} [ms]": one[key] for short, key in NAMES.items()},
            **{_interval(name): round(one[f"frames_late_{name}"]) for name in COARSE_NAMES},
        }
        for name, one in (("twin", result.twin), ("bare timer", result.bare))
    ]


def _interval(name: str) -> str:
    """Name of a bin of the diagnostics in words, such as "0.5 to 1 ms"."""
    return name.replace("_", " ")


def _process(result: Result) -> dict[str, Value]:
    return {
        "missed without a stall": result.unexplained,
        "longest stall of a core [ms]": max((second.stall for second in result.seconds), default=0.0),
        "processor [% of a core]": result.processor,
        "resident [MB]": result.resident,
        "peak [MB]": result.peak,
        "commands sent": result.commands,
        "refused": result.refused,
        "frames not in the logs": result.dropped,
        "stamp to subscriber, median [ms]": result.delay.get("lateness_median_ms"),
        "p99 [ms]": result.delay.get("lateness_p99_ms"),
    }


def _worst(seconds: Sequence[Second]) -> list[dict[str, Value]]:
    worst = sorted(seconds, key=lambda second: second.late, reverse=True)[:SHOWN]
    return [
        {
            "at [s]": second.at,
            "twin [ms]": second.late,
            "bare timer [ms]": second.bare,
            "watchers [ms]": second.stall,
            "missed": second.missed,
        }
        for second in worst
    ]


def _pictures(result: Result) -> dict[str, bytes]:
    """Histograms of lateness beside each other, as shares of all frames; nothing without matplotlib."""
    try:
        import matplotlib as mpl  # noqa: PLC0415 - optional
    except ImportError:
        return {}
    mpl.use("Agg")  # no screen needed
    import matplotlib.pyplot as plt  # noqa: PLC0415

    figure, axes = plt.subplots(figsize=(8.4, 4.2), layout="constrained")
    places = np.arange(len(COARSE_NAMES))
    for offset, one, label, color in (
        (-0.2, result.twin, "twin", "#0072B2"),
        (0.2, result.bare, "bare timer", "#B0BAC3"),
    ):
        counts = np.array([one[f"frames_late_{name}"] for name in COARSE_NAMES])
        bars = axes.bar(places + offset, counts / max(counts.sum(), 1) * 100.0, 0.4, label=label, color=color)
        axes.bar_label(bars, [f"{count:.0f}" for count in counts], fontsize=8)
    axes.set(yscale="log", ylim=(1e-4, 1000.0), xlabel="lateness", ylabel="frames [%]")
    axes.set_xticks(places, [_interval(name) for name in COARSE_NAMES])
    axes.set_title(f"{result.scenario}: {1.0 / PERIOD:g} Hz for {result.minutes:.3g} min, all logs on", loc="left")
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False)
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=120)
    plt.close(figure)
    return {PICTURE if result.scenario == SCENARIO else f"live_{Path(result.scenario).stem}.png": buffer.getvalue()}
