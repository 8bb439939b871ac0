"""Solver cost on uniform meshes over that of the reference commit, without features added since."""

from __future__ import annotations

import statistics

from rich.progress import Progress

from benchmarks.measure import Effort
from benchmarks.report import Part, Table, Value
from benchmarks.yardstick import YARDSTICK, Case, contestants, yardstick_sources

UNIFORM = {  # without air, which the scenario of that commit did not have
    "single_span": Case("single_span", "cabin", 2.0, ("air.density=0",)),
    "seed_example": Case("seed_example", "carriage", 1.0),
}
PIECE = 10.0  # s of simulated time in a turn
TURNS = 5  # for each repetition
MOST = 1.03  # of the unit


def run(effort: Effort, progress: Progress) -> Part:
    """Ratio of both solver times, median over turns."""
    turns = 3 if effort.quick else TURNS * effort.repetitions
    task = progress.add_task("even meshes and the unit", total=len(UNIFORM) * turns)
    rows: list[dict[str, Value]] = []
    faults = []
    with yardstick_sources() as (sources, note):
        for name, case in UNIFORM.items():
            ratios = []
            with contestants(("yardstick", "solver"), case, sources) as running:
                for turn in range(turns):
                    order = sorted(running, reverse=turn % 2 == 1)  # neither is always the first
                    times = {kind: running[kind].run(PIECE) for kind in order}
                    ratios.append(times["solver"] / times["yardstick"])
                    progress.advance(task)
            low, middle, high = statistics.quantiles(ratios, n=4) if turns > 1 else ratios * 3
            quarters = {"first quarter": low, "third quarter": high}
            rows.append({"scenario": name, "turns": turns, f"of the cost of {YARDSTICK}": middle, **quarters})
            if not effort.quick and middle > MOST:
                faults.append(f"{name}: {middle:.3f} of the cost of {YARDSTICK}, {MOST:g} are allowed")
    notes = [note, f"The solver alone, in turns of {PIECE:g} s of simulated time; {MOST:g} are allowed."]
    return Part("Even meshes", [Table("cost", rows)], notes, faults)
