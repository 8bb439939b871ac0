"""Cost of a frame of the twin over its solver: `simulate` with and without logs, beside the bare solver.

All contestants are processes that take turns, a piece of simulated time each.
"""

from __future__ import annotations

import statistics
from collections.abc import Mapping, Sequence

from rich.progress import Progress

from benchmarks.frame_stages import stages_table
from benchmarks.measure import Effort
from benchmarks.report import Part, Table, Value
from benchmarks.yardstick import CASES, YARDSTICK, Case, contestants, yardstick_sources

PIECE, QUICK_PIECE = 30.0, 0.5  # s of simulated time in a turn
PERIOD = 0.01  # s, of a frame
MOST_WITH_LOGS, MOST_WITHOUT = 1.6, 1.25  # times the solver
MOST_GROWTH = 25.0  # % of a frame from 28 to 112 chairs, beyond what its solver grows
GROWTH = "growth beyond the solver's [%]"


MANY = "chairlift, 112 chairs"
MANY_CHAIRS = Case("chairlift", "haul_rope", 2.5, ("carriers.count=112",))
CONTESTANTS = ("yardstick", "solver", "off", "all")


def run(effort: Effort, progress: Progress) -> Part:
    """Measure the ratios of all ropeways, then the stages of a frame."""
    piece = QUICK_PIECE if effort.quick else PIECE
    cases = {"chairlift": CASES["chairlift"]} if effort.quick else {**CASES, MANY: MANY_CHAIRS}
    task = progress.add_task("simulate over its solver", total=effort.repetitions * len(cases))
    with yardstick_sources() as (yardstick, note):
        times: dict[str, dict[str, list[float]]] = {}
        for name, case in cases.items():
            kinds = [kind for kind in CONTESTANTS if not (kind == "yardstick" and name == MANY)]
            times[name] = {kind: [] for kind in kinds}
            with contestants(kinds, case, yardstick) as running:
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
    """Row of one ropeway; ratios are medians over the turns."""
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
    """Cost of a frame with all logs, with few and with many chairs, and its growth beyond the solver's."""
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
