"""Cost of an outlook: processor time of three futures of a minute, on one thread, beside the bare steps of it."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable

from rich.progress import Progress

from benchmarks.measure import Effort
from benchmarks.report import Part, Table, Value
from cable_twin import Ensemble, Forecaster, Simulation, load_scenario

HORIZON, START = 60.0, 30.0  # s
SPEEDS = {  # m/s of the drive, and s of one core that three futures may take
    "aerial_tramway": ("cabin", 7.0, 0.5),
    "windy_tramway": ("cabin", 7.0, None),
    "chairlift": ("haul_rope", 2.3, 2.0),
    "jig_back": ("haul_rope", 7.0, None),
}


def run(effort: Effort, progress: Progress) -> Part:
    """Measure the outlook of each scenario."""
    rows: list[dict[str, Value]] = []
    misses: list[str] = []
    for name in progress.track(SPEEDS, description="outlooks"):
        drive, speed, most = SPEEDS[name]
        twin = Simulation(load_scenario(name))
        twin.command(drive, speed=speed)
        twin.advance_to(START)
        forecaster = Forecaster(twin.scenario, horizon=HORIZON, threads=1)
        steps = Ensemble(twin.scenario, 3, threads=1)

        def bare(steps: Ensemble = steps, twin: Simulation = twin) -> None:
            steps.fork(twin)
            steps.emergency_stop(members=0)
            steps.advance_to(twin.time + HORIZON)

        forecaster.outlook(twin)  # compiles
        whole = _spent(lambda f=forecaster, t=twin: f.outlook(t), effort.repetitions)
        solver = _spent(bare, effort.repetitions)
        rows.append(
            {
                "scenario": name,
                "outlook [s of one core]": whole,
                "steps alone [s]": solver,
                "times real time": 3.0 * HORIZON / whole,
                "wanted [s]": most,
            }
        )
        if most is not None and whole > most:
            misses.append(f"{name}: {whole:.2f} s, wanted were {most:g} s.")
        forecaster.close()
        steps.close()
    notes = [f"Three futures of {HORIZON:g} s, medians of {effort.repetitions} of processor time.", *misses]
    return Part("Outlook", [Table("three futures of a minute", rows)], notes)


def _spent(function: Callable[[], object], repetitions: int) -> float:
    """Median processor time (s) of one call."""
    found = []
    for _ in range(repetitions):
        begun = time.process_time()
        function()
        found.append(time.process_time() - begun)
    return statistics.median(found)
