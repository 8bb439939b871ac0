"""Scripted runs of scenarios in parallel, as members of ensembles; the members of an ensemble share one mesh."""

from __future__ import annotations

import threading
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from typing import NamedTuple

from cable_twin.ensemble import Ensemble, usable_cores
from cable_twin.frame.records import AppliedCommand, Command, CommandError
from cable_twin.frame.snapshot import Layout, Snapshot
from cable_twin.key_figures import KeyFigures
from cable_twin.offline.script import ScriptedCommand
from cable_twin.offline.scripted_run import Outcome, course
from cable_twin.offline.sweep_limits import SweptRun
from cable_twin.scenario import Scenario
from cable_twin.scenario.builders.bundle import build_ropes
from cable_twin.simulation import SAMPLES, EquilibriumError, SolverError
from cable_twin.simulation.same_model import OtherModelError

MOST = 64  # members of an ensemble, whose parameters take memory
REST = 0.1  # of a run, as the bar has it: the search for its start


@dataclass(frozen=True, slots=True)
class Job:
    """Inputs of one scripted run of a sweep over values of a key."""

    value: float
    scenario: Scenario
    script: Sequence[ScriptedCommand]
    duration: float  # s
    frame_steps: int


class Member:
    """Member of an ensemble with the interface of a simulation for scripts; the ensemble advances it.

    Args:
        ensemble: ensemble with samples of ropes in its snapshots.
        number: of the member.
        scenario: of the member.
    """

    def __init__(self, ensemble: Ensemble, number: int, scenario: Scenario) -> None:
        self.scenario = scenario
        self._ensemble, self._number = ensemble, number

    @property
    def layout(self) -> Layout:
        """Layout of a snapshot: names and array indices of the values in it."""
        return self._ensemble.layout

    @property
    def step(self) -> float:
        """Solver step (s)."""
        return self.scenario.solver.step

    @property
    def time(self) -> float:
        """Simulated time (s)."""
        return float(self._ensemble.times[self._number])

    @property
    def snapshot(self) -> Snapshot:
        """Snapshot of the member's present state."""
        return self._ensemble.snapshot(self._number)

    def apply(self, command: Command, source: str = "python") -> AppliedCommand:
        """Apply a command to the member at the present time: whole or, with an error, not at all.

        Raises:
            CommandError: one line with the given and the allowed values.
        """
        try:
            self._ensemble.apply(command, self._number)
        except CommandError as error:
            raise CommandError(str(error).removeprefix(f"member {self._number}: ")) from None
        return AppliedCommand(self.time, command, source)


class _Bar:
    """Progress of a set of runs, shown by a callback; safe to use from several threads."""

    def __init__(self, count: int, show: Callable[[float], object]) -> None:
        self._done, self._count, self._show, self._lock = 0.0, count, show, threading.Lock()

    def add(self, runs: float) -> None:
        """Add a number of finished runs, or a share of one run, to the progress."""
        with self._lock:
            self._done += runs
            self._show(min(self._done / self._count, 1.0))


def run_side_by_side(jobs: Sequence[Job], show: Callable[[float], object]) -> list[SweptRun]:
    """Carry out scripted runs as members of ensembles, bit for bit as single simulations; results in order.

    Args:
        jobs: the runs, each from the equilibrium of its scenario.
        show: called with the share of the runs that is done.
    """
    alike: dict[object, list[int]] = {}
    for number, job in enumerate(jobs):
        alike.setdefault(_mesh(job.scenario), []).append(number)
    groups = [group[first : first + MOST] for group in alike.values() for first in range(0, len(group), MOST)]
    cores, bar, stop = usable_cores(), _Bar(len(jobs), show), threading.Event()
    threads = max(cores // len(groups), 1)
    found: dict[int, SweptRun] = {}
    running: set[Future[dict[int, SweptRun]]] = set()
    with ThreadPoolExecutor(cores, "runs") as pool:
        try:
            while groups or running:
                if groups and len(running) < cores:
                    begun = _begin({number: jobs[number] for number in groups.pop()}, threads, bar)
                    found |= begun.failed
                    groups += [begun.others] if begun.others else []
                    running |= {pool.submit(_run_courses, begun, bar, stop)} if begun.members else set()
                    continue
                done, running = wait(running, return_when=FIRST_COMPLETED)
                for one in done:
                    found |= one.result()
        except BaseException:  # as of Ctrl-C
            stop.set()
            raise
    return [found[number] for number in range(len(jobs))]


def _mesh(scenario: Scenario) -> object:
    """Key of the meshes of all ropes of a scenario: runs with equal keys can be members of one ensemble."""
    try:
        ropes = build_ropes(scenario)
    except EquilibriumError:  # which its simulation will have as well
        return None
    return tuple((name, system.cable.node_arc_length.tobytes()) for name, system in ropes.items())


class _Begun(NamedTuple):
    """Ensemble of runs at their start, with runs that have no equilibrium, and runs that need another ensemble."""

    ensemble: Ensemble | None
    members: dict[int, tuple[Job, int]]  # with the member of each, by number of the run
    failed: dict[int, SweptRun]
    others: list[int]


def _begin(jobs: dict[int, Job], threads: int, bar: _Bar) -> _Begun:
    """Begin runs of one mesh as members of one ensemble; runs with another model are left for another ensemble."""
    begun = _Begun(None, {}, {}, [])
    for number, job in jobs.items():
        try:
            if begun.ensemble is None:
                ensemble = Ensemble(job.scenario, len(jobs), samples=SAMPLES, threads=threads, progress=False)
                begun = begun._replace(ensemble=ensemble)
            else:
                begun.ensemble.begin(job.scenario, len(begun.members))
        except OtherModelError:
            begun.others.append(number)
            continue
        except EquilibriumError as error:
            begun.failed[number] = SweptRun(job.value, (), str(error))
            bar.add(1.0)
            continue
        begun.members[number] = job, len(begun.members)
        bar.add(REST)
    return begun


def _run_courses(begun: _Begun, bar: _Bar, stop: threading.Event) -> dict[int, SweptRun]:
    """Carry out the scripted runs of an ensemble in step; returns the result of each run by its index."""
    ensemble, jobs = begun.ensemble, begun.members
    assert ensemble is not None
    figures = {number: KeyFigures(job.scenario) for number, (job, _) in jobs.items()}
    courses = {
        number: course(
            Member(ensemble, member, job.scenario),
            job.script,
            duration=job.duration,
            frame_steps=job.frame_steps,
            figures=figures[number],
        )
        for number, (job, member) in jobs.items()
    }
    targets, found = {number: next(one) for number, one in courses.items()}, {}
    while targets and not stop.is_set():
        before = ensemble.times
        times = before.copy()
        for number, target in targets.items():
            times[jobs[number][1]] = target
        ensemble.advance_to(times)
        faults, passed = ensemble.faults, ensemble.times - before
        for number in [*targets]:
            job, member = jobs[number]
            bar.add((1.0 - REST) * float(passed[member]) / job.duration)
            try:
                targets[number] = _go_on(courses[number], faults.get(member))
            except StopIteration as end:
                outcome: Outcome = end.value
                found[number] = SweptRun(job.value, figures[number].figures(), outcome.fault, outcome.refused)
                del targets[number]
    ensemble.close()
    return found


def _go_on(times: Generator[float, None, Outcome], fault: str | None) -> float:
    """Resume the generator of a run's times, with a solver error thrown into it if any; returns the next time (s)."""
    return next(times) if fault is None else times.throw(SolverError(fault))
