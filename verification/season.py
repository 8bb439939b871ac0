"""Long run with splitting and retention: bounded disk use, replay of each kept file, constant memory.

`simulate` as a user starts it, with a stop and a start every hour, its memory and its directory looked at all the time;
then `replay` of every kept file alone. A day of the chairlift takes an hour or two on one core:

    .venv/bin/python -m verification.season --hours 24
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from cable_twin.recording.log_reader import read_log

SCENARIO, DRIVE, SPEED = "chairlift", "haul_rope", 2.5  # m/s
FILE_SECONDS = 1800.0  # s of simulated time in a file
KEPT_MEGABYTES = 400.0
LOOK = 2.0  # s of the clock between two looks
MEGABYTE = 1e6
WARM = 0.25  # part of the run after which memory is looked at


@dataclass(slots=True)
class Season:
    """Results of a long run."""

    hours: float
    frame_rate: float  # Hz
    wall_time: float = 0.0  # s
    memory: list[tuple[float, float]] = field(default_factory=list)  # s of the clock, MB resident
    largest: float = 0.0  # MB, of the directory at any look
    files: int = 0  # kept
    numbers: tuple[int, int] = (0, 0)  # of the first and last file that is kept
    replayed: int = 0  # of them that agree to the last bit alone
    faults: list[str] = field(default_factory=list)

    def lines(self) -> list[str]:
        """Text of a table."""
        warm = [memory for at, memory in self.memory if at >= WARM * self.wall_time]
        quarter = max(len(warm) // 4, 1)
        first, last = (sum(part) / len(part) for part in (warm[:quarter], warm[-quarter:]))
        return [
            f"{self.hours:g} h of {SCENARIO} at {self.frame_rate:g} Hz in {self.wall_time:.0f} s, "
            f"{3600.0 * self.hours / self.wall_time:.1f} times real time",
            f"disk: at most {self.largest:.0f} MB at any time, {KEPT_MEGABYTES:g} MB are kept after a split; "
            f"{self.files} files are left, numbers {self.numbers[0]} to {self.numbers[1]}",
            f"memory: {first:.1f} MB after the first quarter, {last:.1f} MB at the end",
            f"replayed alone to the last bit: {self.replayed} of {self.files} files",
            *self.faults,
        ]


def run(hours: float, frame_rate: float, directory: Path, changes: Sequence[str], progress: Progress) -> Season:
    """Simulate a long run, and replay the remaining files."""
    season = Season(hours, frame_rate)
    script = directory / "day.yaml"
    lines = [f"- {{time: 0, name: {DRIVE}, speed: {SPEED}}}"]
    for hour in range(1, int(hours) + 1):
        lines += [
            f"- {{time: {3600 * hour - 60}, event: emergency_stop}}",
            f"- {{time: {3600 * hour - 30}, event: release}}",
            f"- {{time: {3600 * hour - 29}, name: {DRIVE}, speed: {SPEED if hour % 2 else -SPEED}}}",
        ]
    script.write_text("\n".join(lines), encoding="utf-8")
    arguments = [
        *("--duration", 3600.0 * hours, "--frame-rate", frame_rate, "--script", script, "--output", directory / "logs"),
        *("--split-duration", FILE_SECONDS, "--keep-size", KEPT_MEGABYTES),
        *(item for change in changes for item in ("--set", change)),
    ]
    command = [sys.executable, "-m", "cable_twin.offline.simulate", SCENARIO, *map(str, arguments)]
    output = directory / "output.txt"
    started = time.monotonic()
    task = progress.add_task("simulate: files", total=3600.0 * hours / FILE_SECONDS)
    with output.open("w") as stream:
        process = subprocess.Popen(command, stdout=stream, stderr=subprocess.STDOUT)
    try:
        while process.poll() is None:
            time.sleep(LOOK)
            _look(season, process.pid, time.monotonic() - started, directory / "logs")
            progress.update(task, completed=season.numbers[1])
    finally:
        process.kill()
        process.wait()
    season.wall_time = time.monotonic() - started
    if process.returncode != 0:
        season.faults.append(f"simulate ended with {process.returncode}: {output.read_text()[-2000:]}")
        return season
    (directory_of_run,) = (directory / "logs").iterdir()
    files = read_log(directory_of_run).files
    season.files, season.numbers = len(files), (files[0].number, files[-1].number)
    for file in progress.track(files, description="replay: files"):
        replay = [sys.executable, "-m", "cable_twin.offline.replay", str(file.path)]
        result = subprocess.run(replay, capture_output=True, text=True, check=False)
        if result.returncode == 0 and "every sample agrees to the last bit" in result.stdout:
            season.replayed += 1
        else:
            season.faults.append(f"{file.path.name}: {result.stdout[-500:]}{result.stderr[-500:]}")
    return season


def _look(season: Season, process: int, at: float, logs: Path) -> None:
    """Present memory of the process and size of its directory."""
    try:
        pages = int(Path(f"/proc/{process}/statm").read_text().split()[1])
    except (OSError, IndexError):
        return  # it has just ended
    season.memory.append((at, pages * os.sysconf("SC_PAGE_SIZE") / MEGABYTE))
    sizes = []
    for file in logs.glob("*/*"):
        try:
            sizes.append(file.stat().st_size)
        except FileNotFoundError:
            continue  # removed meanwhile
        if file.suffix == ".mcap":
            season.numbers = (0, max(season.numbers[1], int(file.stem.rpartition("_")[2])))
    season.largest = max(season.largest, sum(sizes) / MEGABYTE)


def main() -> int:
    """Run the test and print its results; returns 1 where a file does not replay or the run failed."""
    parser = argparse.ArgumentParser(prog="python -m verification.season", description=__doc__.partition("\n")[0])
    parser.add_argument("--hours", type=float, default=24.0, help="of simulated time; default: %(default)g")
    parser.add_argument("--frame-rate", type=float, default=100.0, help="Hz; default: %(default)g")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="as of simulate")
    options = parser.parse_args()
    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.completed:.0f}"), TimeRemainingColumn())
    with tempfile.TemporaryDirectory(prefix="season_") as directory, Progress(*columns, transient=True) as progress:
        season = run(options.hours, options.frame_rate, Path(directory), options.set, progress)
    print("\n".join(season.lines()))
    return 1 if season.faults or season.replayed < season.files else 0


if __name__ == "__main__":
    sys.exit(main())
