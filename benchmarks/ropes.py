"""Cost of several ropes: one to eight of them, alone and with rods between, whole lifts, and the pantograph."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from rich.progress import Progress

from benchmarks.measure import Effort, interleave, note_on_load
from benchmarks.report import Part, Table, Value
from cable_twin.scenario import Scenario, load_scenario
from cable_twin.simulation import Simulation

COUNTS = (1, 2, 4, 8)
KINDS = ("alone", "in pairs", "all")  # which ropes are coupled: none, each two as track and haul rope are, all
CHAIRS = (10, 28, 50, 100, 200)  # on the loop of the chairlift
ELEMENTS, LENGTH, STRETCH = 200, 200.0, 1.01  # of each rope; m; chord over unstrained length
RODS = 19  # between two neighbours
STEP, LIFT_STEP, DURATION = 0.005, 0.01, 3.0  # s, the second one of the chairlift
MOST_EXPONENT, MOST_SHARE, LEAST_PACE = 1.05, 1.3, 1.0  # of cost over ropes; of one alone; times real time
MOST_COUPLED, MOST_OF_PAIR = 1.5, 1.25  # exponent over ropes with rods between all neighbours; two of them, of one
NOTES = [
    f"Ropes of {ELEMENTS} elements side by side, {RODS} rods from each to the next one where they are coupled; "
    f"steps of {STEP * 1e3:g} ms. Costs are by processor time, per Newton iteration and element; that of one rope is "
    "the unit. Nodes with rods make one front of all ropes that these hold together; those between them are eliminated "
    "before, four runs of them at a time.",
    f"Allowed: an exponent of {MOST_EXPONENT:g} over ropes, {MOST_COUPLED:g} with rods between all neighbours, "
    f"{MOST_SHARE:g} times the cost of one rope where nothing is coupled, {MOST_OF_PAIR:g} "
    "times for two with rods, and the pantograph faster than real time.",
]


def ropes(count: int, kind: str) -> Scenario:
    """Ropes side by side that swing from rest, under gravity."""
    wire = {
        "unstrained_length": LENGTH / STRETCH,
        "mass_per_length": 2.0,
        "axial_stiffness": 1e6,
        "bending_stiffness": 10.0,
        "elements": ELEMENTS,
    }
    names = [f"rope_{k + 1}" for k in range(count)]
    data: dict[str, Any] = {
        "ropes": {
            name: wire | {"start": {"position": [0.0, -float(k)]}, "end": {"position": [LENGTH, -float(k)]}}
            for k, name in enumerate(names)
        },
        "solver": {"step": STEP},
    }
    if kind != "alone":
        places = [LENGTH / STRETCH * (rod + 1) / (RODS + 1) for rod in range(RODS)]
        data["connectors"] = {
            f"rod_{k + 1}_{rod + 1}": {"from": [names[k], s], "to": [names[k + 1], s], "length": 0.98, "stiffness": 1e4}
            for k in range(0, count - 1, 2 if kind == "in pairs" else 1)
            for rod, s in enumerate(places)
        }
    return load_scenario(data)


def run(effort: Effort, progress: Progress) -> Part:
    """Measure all cases in turns."""
    counts = COUNTS[:2] if effort.quick else COUNTS
    duration = 0.1 if effort.quick else DURATION
    cases = {(n, kind): ropes(n, kind) for n in counts for kind in KINDS if n > 1 or kind == "alone"}
    iterations = dict.fromkeys(cases, 0)

    def prepare(case: tuple[int, str]) -> Callable[[], None]:
        simulation = Simulation(cases[case])

        def advance() -> None:
            iterations[case] = simulation.advance_to(duration).solver.iterations

        return advance

    contestants = {str(case): (lambda case=case: prepare(case)) for case in cases}
    contestants["pantograph"] = lambda: _pantograph(duration)
    chairs = CHAIRS[1:2] if effort.quick else CHAIRS
    contestants |= {f"lift {n}": (lambda n=n: _lift(n, duration)) for n in chairs}
    measured = interleave(contestants, effort.repetitions, progress, "several ropes")
    costs = {case: measured[str(case)].processor / iterations[case] / (case[0] * ELEMENTS) for case in cases}
    rows: list[dict[str, Value]] = [
        {
            "ropes": n,
            "coupled": {"alone": "no"}.get(kind, kind),
            "iterations per step": iterations[n, kind] / round(duration / STEP),
            "per element and iteration [ns]": cost * 1e9,
            "times one rope": cost / costs[1, "alone"],
        }
        for (n, kind), cost in costs.items()
    ]
    exponents: dict[str, float] = {}
    for kind in KINDS:
        chosen = [n for n, own in cases if own == kind]
        if len(chosen) > 1:
            exponents[f"ropes, {kind}"] = _exponent(chosen, [costs[n, kind] * n for n in chosen])
    lifts = [measured[f"lift {n}"].processor for n in chairs]
    if len(chairs) > 1:
        exponents["chairs of a lift"] = _exponent(list(chairs), lifts)
    pace = duration / measured["pantograph"].processor
    summary: list[dict[str, Value]] = [{"figure": f"exponent over {what}", "value": e} for what, e in exponents.items()]
    summary.append({"figure": "pantograph: times real time, by processor time", "value": pace})
    faults = [] if effort.quick else _faults(exponents, costs, pace)
    whole: list[dict[str, Value]] = [
        {
            "chairs": n,
            "processor per step [µs]": cost / duration * LIFT_STEP * 1e6,
            "real time [times]": duration / cost,
        }
        for n, cost in zip(chairs, lifts, strict=True)
    ]
    tables = [
        Table("cost of several ropes", rows),
        Table("chairlift, both strands and bullwheels, at 2.5 m/s, solver alone", whole),
        Table("exponents and pace", summary),
    ]
    return Part("Several ropes", tables, [*NOTES, note_on_load(list(measured.values()))], faults)


def _exponent(counts: list[int], costs: list[float]) -> float:
    """Slope of costs over counts on logarithmic axes (-)."""
    return float(np.polyfit(np.log(counts), np.log(costs), 1)[0])


def _lift(chairs: int, duration: float) -> Callable[[], None]:
    """The chairlift under way with a number of chairs evenly round its loop, of unchanged total mass."""
    share = 28.0 / chairs
    changed = {"count": chairs, "bodies.chair.mass": 250.0 * share, "bodies.chair.inertia": 250.0 * share}
    changed |= {"payload.capacity": 300.0 * share, "payload.leaving.return": 300.0 * share}
    values = {f"carriers.{key}": value for key, value in changed.items()}
    simulation = Simulation(load_scenario("chairlift", {**values, "drives.haul_rope.speed": 2.5}))
    return lambda: simulation.advance_to(duration) and None


def _pantograph(duration: float) -> Callable[[], None]:
    simulation = Simulation(load_scenario("pantograph"))
    return lambda: simulation.advance_to(duration) and None


def _faults(exponents: dict[str, float], costs: dict[tuple[int, str], float], pace: float) -> list[str]:
    """Exceeded limits, a line each."""
    allowed = {what: MOST_COUPLED if what == "ropes, all" else MOST_EXPONENT for what in exponents}
    found = [
        f"ropes: exponent over {what} is {value:.3g}, allowed: {allowed[what]:g}"
        for what, value in exponents.items()
        if value > allowed[what]
    ]
    worst = max(cost / costs[1, "alone"] for (_, kind), cost in costs.items() if kind == "alone")
    if worst > MOST_SHARE:
        found.append(f"ropes: an element of several ropes costs {worst:.3g} of one alone, allowed: {MOST_SHARE:g}")
    of_pair = costs[2, "all"] / costs[1, "alone"]
    if of_pair > MOST_OF_PAIR:
        found.append(
            f"ropes: an element of two ropes with rods costs {of_pair:.3g} of one alone, allowed: {MOST_OF_PAIR:g}"
        )
    if pace < LEAST_PACE:
        found.append(f"ropes: the pantograph runs {pace:.3g} times real time, allowed: {LEAST_PACE:g} or more")
    return found
