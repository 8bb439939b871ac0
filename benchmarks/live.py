"""The live twin against the clock: frames that came late, beside those of a bare timer in the same minutes.

`sim` runs in a process of its own, with all logs, as a user starts it; commands that change go to it over DDS, and
lateness is what its diagnostics count. A bare timer in another process waits for the same period and does nothing: what
makes that one late is the machine. Watchers do the same on one core each, as a stall may hit a core and not the other.
"""

from __future__ import annotations

import argparse
import json
import math
import multiprocessing
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np

from cable_twin.ros.lateness import COARSE_NAMES, LatenessHistogram
from cable_twin.scenario import ScenarioError, load_scenario

NODE = "/cable_twin"
COMMAND_PERIOD = 0.05  # s
SPEED_PERIOD = 1.5  # s from one speed to the next
START_TIMEOUT = 300.0  # s, with a compilation on a busy machine
NEARBY = 1  # s around a missed frame in which a stall of the bare timer explains it
MOST_WATCHERS = 8  # cores that are watched one by one
MEGABYTE = 1e6
LIMITS = {"lateness_p99.9_ms": 3.0, "cpu_percent": 25.0}
EPILOG = """\
Linux only: the share of the processor is read from /proc.

examples:
  python -m benchmarks.live                                      two minutes
  python -m benchmarks.live --minutes 10 --output live.json --plot live.png

exit code: 0 when every limit is kept, 1 when one is missed, 2 when the twin did not start or ended early
"""


class LiveError(RuntimeError):
    """The measurement could not be made."""


@dataclass
class Second:
    """One report of the twin, and the bare timer up to then."""

    at: float  # s since the first report
    twin_missed: int
    twin_late_ms: float  # latest frame of this second
    bare_late_ms: float  # the same of the bare timer
    stall_ms: float  # latest frame of the watchers, which stay on one core each


def bare_timer(period: float, core: int | None, connection: Connection) -> None:
    """Wait for one absolute deadline after the other; to every message answer what happened since the last one.

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


class _Timer:
    """A bare timer in a process of its own."""

    def __init__(self, period: float, core: int | None) -> None:
        spawning = multiprocessing.get_context("spawn")
        self._ours, theirs = spawning.Pipe()
        self._process = spawning.Process(target=bare_timer, args=(period, core, theirs), daemon=True)
        self._process.start()

    def begin(self) -> None:
        """Begin to count, at once: the process has long been started."""
        self._ours.send("begin")
        self._ours.recv()

    def latest(self) -> float:
        """Largest lateness (s) since the last call."""
        self._ours.send("")
        return float(self._ours.recv())

    def summary(self) -> dict[str, float]:
        """All of it; ends the process."""
        self._ours.send(None)
        return self._ours.recv()

    def close(self) -> None:
        """End the process, if it still runs."""
        if self._process.is_alive():
            self._process.terminate()


def processor_seconds(process: int) -> float:
    """User and system time (s) of a process with all its threads since it began."""
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def memory(process: int, key: str) -> float:
    """Memory (MB) of a process: `VmRSS` now or `VmHWM` at most."""
    for line in Path(f"/proc/{process}/status").read_text().splitlines():
        if line.startswith(f"{key}:"):
            return int(line.split()[1]) * 1024.0 / MEGABYTE
    raise LiveError(f"process {process} has ended")


class Twin:
    """`sim` in a process of its own and a node that commands it and takes its diagnostics."""

    def __init__(self, scenario: str, frame_rate: float, directory: Path, domain: int) -> None:
        """Start it; the carriages to drive and their limits come from the scenario."""
        import rclpy  # noqa: PLC0415 - the bare timer's process must not load it
        from diagnostic_msgs.msg import DiagnosticArray  # noqa: PLC0415
        from rclpy.executors import SingleThreadedExecutor  # noqa: PLC0415
        from sensor_msgs.msg import JointState  # noqa: PLC0415

        carriages = load_scenario(scenario).carriages.items()
        self._limits = {name: one.drive.limits.speed or 1.0 for name, one in carriages if one.joint == "sliding"}
        self._joint_state = JointState
        self._random = np.random.default_rng(4)
        self._next_speeds = 0.0
        self._speeds: list[float] = []
        self.commands_sent = 0
        self.reports: list[dict[str, str]] = []
        self.warnings: set[str] = set()
        self._log = directory / "sim.txt"
        environment = {
            **os.environ,
            "ROS_DOMAIN_ID": str(domain),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
            "PYTHONUNBUFFERED": "1",
        }
        command = [sys.executable, "-m", "cable_twin.ros.sim", "--scenario", scenario]
        command += ["--frame-rate", f"{frame_rate:g}", "--record-directory", str(directory / "logs")]
        with self._log.open("w", encoding="utf-8") as output:
            self.process = subprocess.Popen(command, env=environment, stdout=output, stderr=subprocess.STDOUT)
        os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
        self._context = rclpy.Context()
        rclpy.init(context=self._context, domain_id=domain)
        self._node = rclpy.create_node("live_benchmark", context=self._context)
        self._publisher = self._node.create_publisher(JointState, f"{NODE}/joint_commands", 10)
        self._node.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, 10)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)

    def wait_for_report(self, timeout: float) -> dict[str, str]:
        """Send commands until the next report of the twin has come.

        Raises:
            LiveError: when the twin has ended, or does not report in time.
        """
        count = len(self.reports)
        deadline = time.monotonic() + timeout
        while len(self.reports) == count:
            if self.process.poll() is not None:
                raise LiveError(f"the twin ended with exit code {self.process.returncode}:\n{self._log.read_text()}")
            if time.monotonic() > deadline:
                raise LiveError(f"no report on /diagnostics within {timeout:g} s:\n{self._log.read_text()}")
            if self.reports:  # else it is still on its way
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

    def _on_diagnostics(self, message: Any) -> None:
        status = message.status[0]
        self.reports.append({pair.key: pair.value for pair in status.values})


def measure(scenario: str, frame_rate: float, minutes: float, directory: Path, domain: int) -> dict[str, Any]:
    """Run twin and bare timer beside each other.

    Args:
        scenario: name or path.
        frame_rate: Hz.
        minutes: how long, from the first report on.
        directory: for the logs of the twin.
        domain: ROS domain that nobody else uses.

    Returns:
        Summaries of `twin` and `bare_timer`, `seconds` one by one, and the figures of the process.

    Raises:
        LiveError: the twin does not start or ends early.
    """
    from rich.progress import Progress  # noqa: PLC0415 - the bare timer's process must not load it

    cores = sorted(os.sched_getaffinity(0))[:MOST_WATCHERS]
    twin = Twin(scenario, frame_rate, directory, domain)
    timers = [_Timer(1.0 / frame_rate, core) for core in (None, *cores)]
    seconds: list[Second] = []
    try:
        with Progress() as progress:
            task = progress.add_task("starting the twin", total=None)
            twin.wait_for_report(START_TIMEOUT)
            for timer in timers:
                timer.begin()
            begin, used = time.monotonic(), processor_seconds(twin.process.pid)
            progress.update(task, description="measuring", total=60.0 * minutes)
            while (elapsed := time.monotonic() - begin) < 60.0 * minutes:
                report = twin.wait_for_report(30.0)
                late, *stalls = [timer.latest() * 1e3 for timer in timers]
                twin_missed, twin_late = int(report["missed_frames"]), float(report["lateness_max_ms"])
                seconds.append(Second(round(elapsed, 3), twin_missed, twin_late, late, max(stalls)))
                progress.update(task, completed=elapsed)
        used = processor_seconds(twin.process.pid) - used
        cpu_percent = 100.0 * used / (time.monotonic() - begin)
        resident, peak = memory(twin.process.pid, "VmRSS"), memory(twin.process.pid, "VmHWM")
        bare = timers[0].summary()
    finally:
        twin.close()
        for timer in timers:
            timer.close()
    report = twin.reports[-1]
    return {
        "scenario": scenario,
        "frame_rate_hz": frame_rate,
        "minutes": elapsed / 60.0,
        "commands_sent": twin.commands_sent,
        "commands_refused": int(report["commands_refused"]),
        "log_dropped_frames": int(report["log_dropped_frames"]),
        "cpu_percent": cpu_percent,
        "memory_mb": resident,
        "memory_peak_mb": peak,
        "twin": {key.removeprefix("total_"): float(value) for key, value in report.items() if key.startswith("total_")},
        "bare_timer": bare,
        "missed_unexplained": unexplained(seconds, 1e3 / frame_rate),
        "seconds": [asdict(second) for second in seconds],
    }


def unexplained(seconds: Sequence[Second], period_ms: float) -> int:
    """Frames that the twin missed while nothing beside it missed one, in the second before and after included."""
    total = 0
    for index, second in enumerate(seconds):
        around = seconds[max(index - NEARBY, 0) : index + NEARBY + 1]
        if not any(max(other.bare_late_ms, other.stall_ms) > period_ms for other in around):
            total += second.twin_missed
    return total


def faults(result: dict[str, Any]) -> list[str]:
    """What is not as it should be, a line each."""
    found = []
    if result["missed_unexplained"]:
        found.append(f"{result['missed_unexplained']} missed frames that no stall of the machine explains")
    late, allowed = result["twin"]["lateness_p99.9_ms"], LIMITS["lateness_p99.9_ms"]
    if late > allowed:
        bare = result["bare_timer"]["lateness_p99.9_ms"]
        found.append(f"lateness p99.9 of {late:.2f} ms, allowed are {allowed:g} ms (bare timer: {bare:.2f} ms)")
    if result["cpu_percent"] > LIMITS["cpu_percent"]:
        found.append(f"{result['cpu_percent']:.1f} % of a core, allowed are {LIMITS['cpu_percent']:g} %")
    if result["log_dropped_frames"]:
        found.append(f"{result['log_dropped_frames']} frames are missing in the logs")
    return found


def table(result: dict[str, Any]) -> str:
    """The result for people, as a table in Markdown."""
    twin, bare = result["twin"], result["bare_timer"]
    lines = ["| | twin | bare timer |", "| --- | ---: | ---: |"]
    names = ("median", "p99", "p99.9", "max")
    stall = max((second["stall_ms"] for second in result["seconds"]), default=0.0)
    lines += [f"| {key.replace('_', ' ')} | {twin[key]:.0f} | {bare[key]:.0f} |" for key in ("frames", "missed_frames")]
    lines += [
        f"| lateness {name} (ms) | {twin[f'lateness_{name}_ms']:.2f} | {bare[f'lateness_{name}_ms']:.2f} |"
        for name in names
    ]
    lines += [
        f"| longest stall of one core (ms) | | {stall:.2f} |",
        f"| missed frames without a stall | {result['missed_unexplained']} | |",
        f"| processor (% of a core) | {result['cpu_percent']:.1f} | |",
        f"| memory (MB), largest | {result['memory_mb']:.0f}, {result['memory_peak_mb']:.0f} | |",
    ]
    return "\n".join(lines)


def plot(result: dict[str, Any], path: Path) -> None:
    """Draw both histograms of lateness beside each other, in parts of all frames."""
    import matplotlib as mpl  # noqa: PLC0415 - wanted with --plot only

    mpl.use("Agg")
    import matplotlib.pyplot as plt  # noqa: PLC0415

    figure, axes = plt.subplots(figsize=(8.0, 4.0), layout="constrained")
    places = np.arange(len(COARSE_NAMES))
    for offset, key, label in ((-0.2, "twin", "twin"), (0.2, "bare_timer", "bare timer")):
        counts = np.array([result[key][f"frames_late_{name}"] for name in COARSE_NAMES])
        bars = axes.bar(places + offset, counts / max(counts.sum(), 1) * 100.0, 0.4, label=label)
        axes.bar_label(bars, [f"{count:.0f}" for count in counts], fontsize=8)
    names = [name.removesuffix("_ms").replace("_", " ") for name in COARSE_NAMES]
    axes.set(yscale="log", ylim=(1e-4, 1000.0), xlabel="lateness (ms)", ylabel="frames (%)")
    axes.set_xticks(places, names)
    axes.set_title(f"{result['scenario']}, {result['frame_rate_hz']:g} Hz, {result['minutes']:.1f} min, all logs on")
    axes.legend()
    figure.savefig(path, dpi=120)
    plt.close(figure)


def positive(text: str) -> float:
    """A finite number above zero, for options."""
    value = float(text)
    if not (math.isfinite(value) and value > 0.0):
        raise argparse.ArgumentTypeError(f"{text} given, a number above 0 is needed")
    return value


def parser() -> argparse.ArgumentParser:
    """Options of the command."""
    result = argparse.ArgumentParser(
        "benchmarks.live", description=__doc__, epilog=EPILOG, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    result.add_argument("--minutes", type=positive, default=2.0, help="how long; default: 2")
    result.add_argument("--scenario", default="aerial_tramway", help="name or path; default: aerial_tramway")
    result.add_argument("--frame-rate", type=positive, default=100.0, metavar="HZ", help="default: 100 Hz")
    result.add_argument(
        "--domain", type=int, default=20 + os.getpid() % 80, help="ROS domain; default: one of 20 to 99"
    )
    result.add_argument("--output", type=Path, metavar="FILE", help="write all figures as JSON, each second among them")
    result.add_argument("--plot", type=Path, metavar="FILE", help="draw the histograms, as .png, .svg or .pdf")
    return result


def main(argv: Sequence[str] | None = None) -> int:
    """Measure and print; 0 when every limit is kept, 1 when one is missed, 2 when nothing could be measured."""
    options = parser().parse_args(argv)
    for path in filter(None, (options.output, options.plot)):
        if not path.absolute().parent.is_dir():
            print(f"benchmarks.live: {path}: there is no directory {path.absolute().parent}", file=sys.stderr)
            return 2
    try:
        with tempfile.TemporaryDirectory(prefix="cable_twin_live_") as directory:
            result = measure(options.scenario, options.frame_rate, options.minutes, Path(directory), options.domain)
    except (LiveError, ScenarioError, ImportError) as error:
        print(f"benchmarks.live: {error}", file=sys.stderr)
        return 2
    print(table(result))
    if options.output:
        options.output.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    if options.plot:
        plot(result, options.plot)
    found = faults(result)
    for line in found or ["every limit is kept"]:
        print(line)
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
