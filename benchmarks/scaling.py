"""Cost of a step over the number of elements and of carriages."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from rich.progress import Progress

from benchmarks.cases import ropeway
from benchmarks.measure import Effort, Timing, interleave, note_on_load
from benchmarks.report import Part, Table, Value
from cable_twin.scenario import Scenario
from cable_twin.simulation import Simulation

ELEMENTS = (12, 25, 50, 100, 200, 400, 800, 1600, 3200)
CARRIAGES = (1, 2, 5, 10, 20, 50, 100, 200)
STEP = 0.005  # s
DURATION = 1.0  # s, simulated in each repetition


def run(effort: Effort, progress: Progress) -> Part:
    """Run the ropeway on every mesh with one carriage, and on 200 elements with every number of carriages."""
    duration = 0.1 if effort.quick else DURATION
    elements, carriages = (ELEMENTS[:7:3], CARRIAGES[:5:2]) if effort.quick else (ELEMENTS, CARRIAGES)
    series = {
        "elements": {n: ropeway(n, 1, step=STEP) for n in elements},
        "carriages": {n: ropeway(200, n, step=STEP) for n in carriages},
    }
    tables: list[Table] = []
    exponents: list[dict[str, Value]] = []
    timings: list[Timing] = []
    for kind, scenarios in series.items():
        iterations = dict.fromkeys(scenarios, 0)

        def prepare(count: int, scenario: Scenario, counts: dict[int, int] = iterations) -> Callable[[], None]:
            simulation = Simulation(scenario)

            def advance() -> None:
                counts[count] = simulation.advance_to(duration).solver.iterations

            return advance

        contestants = {str(n): (lambda n=n, one=one: prepare(n, one)) for n, one in scenarios.items()}
        measured = interleave(contestants, effort.repetitions, progress, f"scaling over {kind}")
        steps = round(duration / STEP)
        rows: list[dict[str, Value]] = [
            {
                kind: n,
                "wall per step [µs]": measured[str(n)].wall / steps * 1e6,
                "iterations per step": iterations[n] / steps,
                "processor per iteration [µs]": measured[str(n)].processor / iterations[n] * 1e6,
                "real time [times]": duration / measured[str(n)].wall,
            }
            for n in scenarios
        ]
        fixed = "1 carriage" if kind == "elements" else "200 elements"
        tables.append(Table(f"over {kind}: ropeway, {fixed}, steps of {STEP * 1e3:g} ms", rows))
        costs = [measured[str(n)].processor for n in scenarios]
        exponents.append(_exponents(kind, list(scenarios), costs))
        timings += measured.values()
    notes = [
        "Exponent: slope of log processor time over log count, 1 is linear; the last is that between the two largest."
    ]
    return Part("Scaling", [*tables, Table("exponents", exponents)], [*notes, note_on_load(timings)])


def _exponents(kind: str, counts: list[int], costs: list[float]) -> dict[str, Value]:
    """Fitted exponents of one series; a fit over its upper half leaves out constant costs."""
    x, y = np.log(counts), np.log(costs)
    half = len(counts) // 2
    return {
        "over": kind,
        "from": counts[0],
        "to": counts[-1],
        "exponent": float(np.polyfit(x, y, 1)[0]),
        "exponent of the upper half": float(np.polyfit(x[-half - 1 :], y[-half - 1 :], 1)[0]),
        "last exponent": float((y[-1] - y[-2]) / (x[-1] - x[-2])),
    }
