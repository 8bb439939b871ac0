"""Ensembles beside a plain loop over single simulations: real time, threads, forks, memory, and steps for learning."""

from __future__ import annotations

import statistics
import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from rich.progress import Progress

from benchmarks.measure import Effort
from benchmarks.report import Part, Table, Value
from cable_twin import Ensemble, Simulation, load_scenario

MEMBERS, QUICK_MEMBERS = 32, 8
SCENARIOS = {"single_span": "cabin", "aerial_tramway": "cabin", "windy_tramway": "cabin", "chairlift": "haul_rope"}
REAL_TIME = {"aerial_tramway": 9.0, "chairlift": 3.0}  # times real time, of 32 members on one core, at least
SPEED, DURATION, QUICK_DURATION = 2.0, 5.0, 1.0  # m/s; s of simulated time
LONGEST_FORK = 100e-6  # s a member
LEAST_SPEED_UP = 1.9  # of two threads on two free cores
MOST_MEMORY = 2.0  # of state and workspace
FREE = 0.97  # of what two threads get of two cores, at least, where the speed-up says anything


def run(effort: Effort, progress: Progress) -> Part:
    """Measure ensembles of each scenario."""
    members = QUICK_MEMBERS if effort.quick else MEMBERS
    duration = QUICK_DURATION if effort.quick else DURATION
    rows: list[dict[str, Value]] = []
    faults: list[str] = []
    for name in progress.track(SCENARIOS, description="ensembles"):
        row, wrong = _measured(name, members, duration, effort.repetitions)
        rows.append(row)
        faults += wrong
    notes = [
        f"{members} members at up to {SPEED:g} m/s for {duration:g} s, medians of {effort.repetitions}. Times real "
        "time is of all members together: with 9, each of them runs 9 times as fast as the clock.",
        "Cores free: those that two threads get for nothing but sums; with fewer than 2, two threads gain less.",
        "Members are equal to the last bit at 1, 2 and 7 threads, and to single simulations one after another.",
    ]
    return Part("Ensembles", [Table(f"{members} members beside single simulations", rows)], notes, faults)


def _measured(name: str, members: int, duration: float, repetitions: int) -> tuple[dict[str, Value], list[str]]:
    """Row of one scenario, and what is not as it has to be."""
    drive, speeds = SCENARIOS[name], np.linspace(0.2, 1.0, members) * SPEED
    single = Simulation(load_scenario(name), samples=2, on_demand=True)
    start, ensembles = single.capture(), {count: Ensemble(name, members, threads=count) for count in (1, 2, 7)}

    for ensemble in ensembles.values():  # compiles, and allocates the memory of threads
        ensemble.advance_to(single.step)

    def together(count: int) -> tuple[float, Any]:
        ensemble = ensembles[count]
        single.restore(start)
        ensemble.fork(single)
        ensemble.command(drive, speed=speeds)
        wall = _wall(lambda: ensemble.advance_to(duration))
        return wall, ensemble.numbers()

    def one_by_one() -> tuple[float, Any]:
        rows, wall = [], 0.0
        for speed in speeds.tolist():
            single.restore(start)
            single.command(drive, speed=speed)
            wall += _wall(lambda: single.advance_to(duration))
            rows.append(single.snapshot.numbers)
        return wall, np.array(rows)

    walls: dict[int, list[float]] = {count: [] for count in (0, *ensembles)}
    free, faults = [], []
    for _ in range(repetitions):
        wall, expected = one_by_one()
        walls[0].append(wall)
        for count in ensembles:
            wall, found = together(count)
            walls[count].append(wall)
            if not np.array_equal(found, expected, equal_nan=True):
                faults.append(f"ensemble: {name}: members with {count} threads are not those of a plain loop")
        free.append(_free_cores())
    single.restore(start)
    ensembles[1].fork(single)  # it packs parameters, once
    fork = statistics.median(_wall(lambda: ensembles[1].fork(single)) for _ in range(max(repetitions, 5))) / members
    whole = single.engine.memory.nbytes + single.engine.moving.memory.nbytes + single.engine.workspace_size
    medians = {count: statistics.median(several) for count, several in walls.items()}
    ratios = [one / two for one, two in zip(walls[1], walls[2], strict=True)]
    speed_up, memory = statistics.median(ratios), ensembles[1].memory / whole
    real_time, cores = duration / medians[1], statistics.median(free)
    for ensemble in ensembles.values():
        ensemble.close()
    if fork > LONGEST_FORK:
        faults.append(f"ensemble: {name}: a fork takes {fork * 1e6:.0f} us a member; allowed: {LONGEST_FORK * 1e6:.0f}")
    if cores >= 2.0 * FREE and speed_up < LEAST_SPEED_UP:
        faults.append(f"ensemble: {name}: two threads are {speed_up:.2f} times one; allowed: from {LEAST_SPEED_UP:g}")
    if memory > MOST_MEMORY:
        faults.append(
            f"ensemble: {name}: a member has {memory:.2f} times its state and workspace; allowed: {MOST_MEMORY:g}"
        )
    row: dict[str, Value] = {
        "scenario": name,
        "plain loop, times real time": duration / medians[0],
        "1 thread": real_time,
        "2 threads": duration / medians[2],
        "2 threads over 1": speed_up,
        "cores free": cores,
        "fork, us a member": fork * 1e6,
        "memory of a member, kB": ensembles[1].memory / 1e3,
        "over its state and workspace": memory,
    }
    if members == MEMBERS and real_time < REAL_TIME.get(name, 0.0):
        faults.append(f"ensemble: {name}: {real_time:.1f} times real time; wanted: {REAL_TIME[name]:g}")
    return row, faults


def _wall(function: Callable[[], object]) -> float:
    """Time (s) of one call by the clock."""
    begun = time.perf_counter()
    function()
    return time.perf_counter() - begun


def _free_cores() -> float:
    """Cores that two threads get now, which do nothing but sums without the interpreter lock."""
    numbers = np.ones(4_000_000)

    def add() -> None:
        for _ in range(20):
            numbers.sum()

    alone = _wall(add)
    both = [threading.Thread(target=add) for _ in range(2)]

    def together() -> None:
        for one in both:
            one.start()
        for one in both:
            one.join()

    return 2.0 * alone / _wall(together)
