"""Cost of a study beside its cases: overhead a case, two workers beside one, tables of many cases."""

from __future__ import annotations

import os
import statistics
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
from rich.progress import Progress

from benchmarks.measure import LEAST_SHARE, Effort
from benchmarks.report import Part, Table, Value
from cable_twin.offline import study
from cable_twin.offline.studies import cluster
from cable_twin.offline.studies.case import Case, Finished, Names
from cable_twin.offline.studies.design import Design, Factor
from cable_twin.offline.studies.indices import indices_of
from cable_twin.offline.studies.record import Results, kept_in, write_tables

# cases of a round, and options: so many that half a case, for which a worker waits at the end, is a small share
STUDIES = {
    "seed_example, at rest": (120, ["seed_example", "--duration", "0", "--vary", "gravity=9:10"]),
    "chairlift, at rest": (48, ["chairlift", "--duration", "0", "--vary", "air.temperature=-20:40"]),
    "aerial_tramway, 60 s": (48, ["aerial_tramway", "--duration", "60", "--vary", "air.temperature=-20:40"]),
}
WORKERS = (1, 2)
MOST_OVERHEAD, LEAST_GAIN = 0.020, 1.8  # s a case; of two workers beside one
DEAR = 0.1  # s a case, from which on the gain is asked for: command and scheduler need a core, too
FIGURES = 100  # of a case whose tables are written
COUNTS = (1_024, 4_096, 16_384, 65_536)


def run(effort: Effort, progress: Progress) -> Part:
    """Measure studies of cheap and of dear cases, and tables of many."""
    faults: list[str] = []
    counts = COUNTS[: 2 if effort.quick else None]
    task = progress.add_task("studies", total=effort.repetitions * len(STUDIES) + len(counts))
    rows = _studies(effort, lambda: progress.advance(task), faults)
    many: list[dict[str, Value]] = []
    for count in counts:
        many.append(_tables(count))
        progress.advance(task)
    notes = [
        f"Medians of {effort.repetitions} rounds, in which one worker and two take turns. Overhead a case: wall time "
        "times workers, less the time within the cases, for each case; it is that of worker, scheduler, command and "
        "file together. Share: of a processor that the cases had; below 1, the machine did other work.",
        *[f"{name} grows as N^{_exponent(many, name):.2f}." for name in list(many[0])[1:]],
    ]
    tables = [Table("cases on a local cluster", rows), Table(f"tables of N cases with {FIGURES} figures", many)]
    return Part("Study", tables, notes, faults)


class Round(NamedTuple):
    """Times (s) of one study: wall, and within its cases wall and processor."""

    wall: float
    inside: float
    processor: float


def _studies(effort: Effort, on_round: Callable[[], object], faults: list[str]) -> list[dict[str, Value]]:
    """Rows of all studies; one worker and two take turns."""
    rows: list[dict[str, Value]] = []
    with cluster.connected(None, 1) as alone, cluster.connected(None, 2) as both:
        for name, (count, options) in STUDIES.items():
            rounds = []
            for _ in range(effort.repetitions):
                rounds.append((_once(alone, 1, options, count), _once(both, 2, options, count)))
                on_round()
            rows.append(_row(name, count, rounds, faults))
    return rows


def _row(name: str, count: int, rounds: Sequence[tuple[Round, Round]], faults: list[str]) -> dict[str, Value]:
    """Row of one study; what is missed of what is wanted goes to the faults."""
    gain = statistics.median(one.wall / two.wall for one, two in rounds)
    overhead = [
        statistics.median((workers * each[row].wall - each[row].inside) / count for each in rounds)
        for row, workers in enumerate(WORKERS)
    ]
    shares = [statistics.median(each[row].processor / each[row].inside for each in rounds) for row in range(2)]
    case = statistics.median(one.inside for one, _ in rounds) / count
    if min(overhead) > MOST_OVERHEAD:
        faults.append(f"{name}: overhead of {1e3 * min(overhead):.1f} ms a case; allowed: {1e3 * MOST_OVERHEAD:g} ms")
    if case > DEAR and min(shares) > LEAST_SHARE and gain < LEAST_GAIN:
        faults.append(f"{name}: two workers are {gain:.2f} times one; allowed: at least {LEAST_GAIN:g}")
    return {
        "study": name,
        "cases": count,
        "a case [ms]": 1e3 * case,
        "gain of 2 workers": gain,
        "gain at equal shares": gain * shares[0] / shares[1],
        "overhead a case, 1 worker [ms]": 1e3 * overhead[0],
        "2 workers [ms]": 1e3 * overhead[1],
        "share, 1 worker": shares[0],
        "share, 2 workers": shares[1],
    }


def _once(client: Any, workers: int, options: Sequence[str], count: int) -> Round:
    """Times of a study on workers that are warm."""
    given = study.parser().parse_args([*options, "--cases", str(count + 2 * workers), "--out", "unused"])
    planned = study.plan(given, given.plain_scenario)
    warm, measured = planned.cases[count:], planned.cases[:count]
    inside = processor = 0.0
    with tempfile.TemporaryDirectory() as directory, kept_in(Path(directory)) as kept:

        def on_done(finished: Finished, names: Names) -> None:
            nonlocal inside, processor
            kept.add(finished, names)
            inside, processor = inside + finished.seconds, processor + finished.processor

        cluster.run_on(client, planned.common, warm, on_done)
        inside, processor, begun = 0.0, 0.0, time.perf_counter()
        faults = cluster.run_on(client, planned.common, measured, on_done)
        wall = time.perf_counter() - begun
    assert not faults
    return Round(wall, inside, processor)


def _tables(count: int) -> dict[str, Value]:
    """Times and sizes of keeping, reading and writing so many cases."""
    names: Names = {f"load/towers.tower_{number}/highest": (f"load {number}", "N") for number in range(FIGURES)}
    values: Mapping[str, tuple[float, float, str]] = {key: (0.1 + len(key) / 7.0, 0.0, "12.3 m") for key in names}
    cases = [Case(f"c{number:06d}", {"gravity": 9.0 + 1e-7 * number}, f"{number:032x}") for number in range(count)]
    with tempfile.TemporaryDirectory() as directory, kept_in(Path(directory)) as kept:
        begun = time.perf_counter()
        for one in cases:
            kept.add(Finished(one.id, one.inputs, "host", 1.0, 1.0, "", (), values, ()), names)
        keeping, begun = time.perf_counter() - begun, time.perf_counter()
        results = Results(cases, kept)
        reading, begun = time.perf_counter() - begun, time.perf_counter()
        files = write_tables(Path(directory), results)
        writing, begun = time.perf_counter() - begun, time.perf_counter()
        few = SimpleNamespace(names=results.names, figures={next(iter(names)): np.random.default_rng(0).random(count)})
        indices_of(Design((Factor("a", (0.0, 1.0)), Factor("b", (0.0, 1.0))), "sobol", (), count // 4), few)
        indices = time.perf_counter() - begun
        size = os.path.getsize(Path(directory) / "cases.jsonl")
        tables = sum(map(os.path.getsize, files))
    return {
        "N": count,
        "keep [s]": keeping,
        "read [s]": reading,
        "write [s]": writing,
        "indices of one [s]": indices,
        "cases.jsonl [MB]": 1e-6 * size,
        "tables [MB]": 1e-6 * tables,
    }


def _exponent(rows: Sequence[Mapping[str, Any]], name: str) -> float:
    """Exponent of the power of N that fits a column."""
    logarithms = np.log([[row["N"], row[name]] for row in rows])
    return float(np.polyfit(*logarithms.T, 1)[0])
