"""What a frame of the twin costs over its solver: `simulate` with and without logs, beside the bare solver.

The unit is the solver of one commit, which stays the same when later work makes the solver faster; its sources come out
of the history of this checkout. All contestants are processes that take turns, a piece of simulated time each.
"""

from __future__ import annotations

import io
import statistics
import subprocess
import sys
import tarfile
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from rich.progress import Progress

from benchmarks.frame_stages import stages_table
from benchmarks.measure import ROOT, BenchmarkError, Effort, environment_of_user
from benchmarks.report import Part, Table, Value
from cable_twin.mechanics.language.compilation import MECHANICS, cache_directory

YARDSTICK = "757d35a"  # commit whose solver is the unit
PIECE, QUICK_PIECE = 30.0, 0.5  # s of simulated time in a turn
PERIOD = 0.01  # s, of a frame
MOST_WITH_LOGS, MOST_WITHOUT = 1.6, 1.25  # times the solver
MOST_GROWTH = 25.0  # % of a frame from 28 to 112 chairs, beyond what its solver grows
GROWTH = "growth beyond the solver's [%]"


@dataclass(frozen=True, slots=True)
class Case:
    """One ropeway under way."""

    scenario: str
    drive: str
    speed: float  # m/s
    changes: tuple[str, ...] = ()

    @property
    def arguments(self) -> tuple[str, ...]:
        """What `frame_process` takes."""
        return (self.scenario, self.drive, str(self.speed), *self.changes)


CASES = {
    "aerial_tramway": Case("aerial_tramway", "cabin", 7.0),
    "chairlift": Case("chairlift", "haul_rope", 2.5),
    "gondola": Case("gondola", "haul_rope", 6.0),
}
MANY = "chairlift, 112 chairs"
MANY_CHAIRS = Case("chairlift", "haul_rope", 2.5, ("carriers.count=112", "carriers.spacing=15.0"))
CONTESTANTS = ("yardstick", "solver", "off", "all")


class Contestant:
    """A process that runs pieces of a case."""

    def __init__(self, kind: str, case: Case, sources: Path) -> None:
        environment = {**environment_of_user(), "PYTHONPATH": str(sources)}
        command = [sys.executable, str(ROOT / "benchmarks" / "frame_process.py"), kind, *case.arguments]
        self._process = subprocess.Popen(
            command, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=sources
        )

    def wait(self) -> None:
        """Until it has started."""
        self._answer()

    def run(self, duration: float) -> float:
        """Processor time (s) of a piece (s)."""
        assert self._process.stdin is not None
        print(duration, file=self._process.stdin, flush=True)
        return float(self._answer())

    def close(self) -> None:
        """End it."""
        self._process.kill()
        self._process.wait()

    def _answer(self) -> str:
        assert self._process.stdout is not None
        if not (line := self._process.stdout.readline()):
            raise BenchmarkError("a process of the part frame has ended; its error stands above")
        return line


def run(effort: Effort, progress: Progress) -> Part:
    """Measure the ratios of all ropeways, then the stages of a frame."""
    piece = QUICK_PIECE if effort.quick else PIECE
    cases = {"chairlift": CASES["chairlift"]} if effort.quick else {**CASES, MANY: MANY_CHAIRS}
    task = progress.add_task("simulate over its solver", total=effort.repetitions * len(cases))
    with _yardstick() as (yardstick, note):
        times: dict[str, dict[str, list[float]]] = {}
        for name, case in cases.items():
            contestants = [kind for kind in CONTESTANTS if not (kind == "yardstick" and name == MANY)]
            times[name] = {kind: [] for kind in contestants}
            with _contestants(contestants, case, yardstick) as running:
                for _ in range(effort.repetitions):
                    for kind, contestant in running.items():
                        times[name][kind].append(contestant.run(piece))
                    progress.advance(task)
    frames = piece / PERIOD
    rows = [_ratios(name, times[name], frames) for name in cases if name != MANY]
    tables = [Table("processor time of `simulate` over the bare solver", rows)]
    faults = [] if effort.quick else _faults(rows)
    if MANY in times:
        growth = _growth(times["chairlift"], times[MANY], frames)
        tables.append(Table("a frame over the number of chairs", growth))
        if float(growth[1][GROWTH] or 0.0) > MOST_GROWTH:
            faults.append(f"frame: it grows {growth[1][GROWTH]:.0f} % more than its solver with 4 times the chairs")
    stages, stage_notes = stages_table(effort, progress)
    notes = [
        note,
        f"Each turn is {piece:g} s of simulated time at {1.0 / PERIOD:g} Hz, medians of {effort.repetitions} turns. "
        "Processor time is that of all threads of the process, key figures, and closing of logs included.",
        f"Times the solver: what is beyond today's solver, in units of that of {YARDSTICK}, and one; at most "
        f"{MOST_WITH_LOGS:g} with all logs and {MOST_WITHOUT:g} without.",
    ]
    return Part("A frame", [*tables, *stages], [*notes, *stage_notes], faults)


def _ratios(name: str, times: Mapping[str, Sequence[float]], frames: float) -> dict[str, Value]:
    """The row of one ropeway; ratios are medians over the turns."""
    beyond = {
        kind: statistics.median(
            (own - solver) / unit
            for own, solver, unit in zip(times[kind], times["solver"], times["yardstick"], strict=True)
        )
        for kind in ("off", "all")
    }
    microseconds = {kind: statistics.median(taken) / frames * 1e6 for kind, taken in times.items()}
    return {
        "scenario": name,
        f"solver of {YARDSTICK} [µs a frame]": microseconds["yardstick"],
        "solver [µs]": microseconds["solver"],
        "no logs [µs]": microseconds["off"],
        "all logs [µs]": microseconds["all"],
        "no logs, times the solver": 1.0 + beyond["off"],
        "all logs, times the solver": 1.0 + beyond["all"],
        "real time over processor time": PERIOD * 1e6 / microseconds["all"],
    }


def _growth(
    few: Mapping[str, Sequence[float]], many: Mapping[str, Sequence[float]], frames: float
) -> list[dict[str, Value]]:
    """What a frame with all logs costs with few and with many chairs, and how much more that grows than the solver."""
    rows: list[dict[str, Value]] = []
    for chairs, times in ((28, few), (112, many)):
        solver, whole = (statistics.median(times[kind]) / frames * 1e6 for kind in ("solver", "all"))
        rows.append({"chairs": chairs, "solver [µs a frame]": solver, "frame with all logs [µs]": whole})
    solvers, wholes = ([float(row[key] or 0.0) for row in rows] for key in [*rows[0]][1:])
    for row, solver, whole in zip(rows, solvers, wholes, strict=True):
        row[GROWTH] = 100.0 * (whole / wholes[0] - solver / solvers[0])
    return rows


def _faults(rows: Sequence[Mapping[str, Value]]) -> list[str]:
    """Ratios beyond their limits, a line each."""
    found = []
    for row in rows:
        for kind, most in (("all logs", MOST_WITH_LOGS), ("no logs", MOST_WITHOUT)):
            ratio = float(row[f"{kind}, times the solver"] or 0.0)
            if ratio > most:
                found.append(
                    f"frame: {row['scenario']} with {kind} takes {ratio:.2f} times its solver, allowed: {most:g}"
                )
    return found


@contextmanager
def _contestants(kinds: Sequence[str], case: Case, yardstick: Path) -> Iterator[dict[str, Contestant]]:
    """Processes of one case that are ready to run."""
    with ExitStack() as stack:
        running = {}
        for kind in kinds:
            own = ("solver", yardstick) if kind == "yardstick" else (kind, ROOT)
            running[kind] = Contestant(own[0], case, own[1])
            stack.callback(running[kind].close)
            running[kind].wait()  # one after the other: they compile
        yield running


@contextmanager
def _yardstick() -> Iterator[tuple[Path, str]]:
    """Sources whose solver is the unit, and a note on them: those of a commit, or of this checkout without history."""
    archive = subprocess.run(
        ["git", "-C", str(ROOT), "archive", YARDSTICK, "cable_twin", "config", "resource"],
        capture_output=True,
        check=False,
    )
    if archive.returncode != 0:
        yield ROOT, f"**The unit is the solver of this checkout**, as the commit {YARDSTICK} is not in its history."
        return
    kept = cache_directory(MECHANICS)
    with tempfile.TemporaryDirectory(prefix="yardstick_", dir=None if kept is None else kept.parent) as directory:
        sources = Path(directory) / "sources"
        with tarfile.open(fileobj=io.BytesIO(archive.stdout)) as content:
            content.extractall(sources, filter="data") if sys.version_info >= (3, 12) else content.extractall(sources)
        if kept is not None:  # its kernels are compiled once: numba knows them by the place of their sources
            place = kept.parent / f"yardstick-{YARDSTICK}"
            with suppress(OSError):  # they are there
                sources.rename(place)
            sources = place
        yield sources, f"The unit is the solver of commit {YARDSTICK}, run beside."
