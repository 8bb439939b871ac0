"""Calculation of load cases, each at rest found from the equilibrium of the first case on the same mesh."""

from __future__ import annotations

import gc
import multiprocessing
import re
import signal
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Any, NamedTuple, cast

import numpy as np

from cable_twin.ensemble import usable_cores
from cable_twin.key_figures import KeyFigure
from cable_twin.offline.envelopes.cases import LoadCase
from cable_twin.offline.envelopes.motion import run_dynamic
from cable_twin.offline.envelopes.places import line_at, search_places
from cable_twin.offline.envelopes.ranges import RangeCollector, Ranges
from cable_twin.offline.envelopes.tensioning import with_stops
from cable_twin.offline.lines.at_rest import Find, Line, at_place, calculate, from_scratch, plan_line
from cable_twin.scenario import Scenario
from cable_twin.simulation import EquilibriumError, Simulation
from cable_twin.simulation.rests import Rests

MOST_OF_PART = 10  # cases between two looks at what is finished
NO_RANGES = Ranges({}, {}, {})
OFF_MESH = re.compile(r"payload|^carriers\.loaded$|^air\.wind|\.counterweight\.|\.hydraulics\.|^limits\.")


@dataclass(frozen=True, slots=True)
class Job:
    """Load case to be calculated at a number of places of its vehicle."""

    case: LoadCase
    places: int


@dataclass(frozen=True, slots=True)
class CaseResult:
    """Key figures and ranges of a load case; the `time` of a figure is the place of the vehicle (m)."""

    id: str
    figures: tuple[KeyFigure, ...]
    fault: str = ""
    ranges: Ranges = NO_RANGES


class Neighbours(NamedTuple):
    """Part of the load cases for one process, on one mesh: each search starts from the equilibrium of the first case.

    Attributes:
        first: first case of the file with the mesh, from whose equilibria those of the others are searched for.
        jobs: load cases of the part.
    """

    first: LoadCase
    jobs: Sequence[Job]


def neighbours(jobs: Sequence[Job], all_jobs: Sequence[Job], cores: int) -> list[Neighbours]:
    """Divide load cases into parts for processes, each of cases on one mesh, in the order of the file.

    Args:
        jobs: load cases to be calculated.
        all_jobs: all load cases of the file, so that the first case of each mesh is the same in any rerun.
        cores: number of processes.
    """
    firsts = first_of_each_mesh([job.case.changes for job in all_jobs])
    groups: dict[str, list[Job]] = {}
    for job in jobs:
        groups.setdefault(mesh_key(job.case.changes), []).append(job)
    found = []
    for key, group in groups.items():
        size = min(max(len(group) // (2 * cores), 1), MOST_OF_PART)
        found += [Neighbours(all_jobs[firsts[key]].case, group[row : row + size]) for row in range(0, len(group), size)]
    return found


def mesh_key(changes: Mapping[str, Any]) -> str:
    """Key of the mesh of a load case: its changes without payloads, wind and others that leave the mesh as it is.

    Args:
        changes: values by dotted key.
    """
    return repr(sorted((key, repr(one)) for key, one in changes.items() if not OFF_MESH.search(key)))


def first_of_each_mesh(changes: Sequence[Mapping[str, Any]]) -> dict[str, int]:
    """Index of the first load case of a file on each mesh, by the key of the mesh.

    Args:
        changes: of each case, values by dotted key.
    """
    firsts: dict[str, int] = {}
    for number, one in enumerate(changes):
        firsts.setdefault(mesh_key(one), number)
    return firsts


# first rests of one part, None where there is none, by its first case, places and place
Bases = dict[tuple[str, int, float], Rests | None]
_bases: Bases = {}  # of the present part


def run_part(part: Neighbours) -> list[CaseResult]:
    """Calculate the load cases of a part, each at rest from the equilibrium of the first case on its mesh."""
    with uncollected():
        return [run_case(job, part.first) for job in part.jobs]


@contextmanager
def uncollected() -> Iterator[None]:
    """Context manager without cyclic garbage collection, which takes a fifth of the time with many key figures."""
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.enable()


def run_case(job: Job, first: LoadCase | None = None) -> CaseResult:
    """Calculate one load case, at rest or in motion.

    Args:
        job: load case and number of places.
        first: load case on the same mesh, from whose equilibrium the search begins; None for a search from scratch.
    """
    collector = RangeCollector(job.case.scenario)
    try:
        if job.case.dynamic is not None:
            figures, fault = run_dynamic(job.case.scenario, job.case.dynamic, collector)
            return CaseResult(job.case.id, tuple(figures), fault, collector.ranges())
        find = _find(job.case, first, job.places, _bases)

        def seen(scenario: Scenario, place: float) -> Simulation:
            simulation = find(scenario, place)
            collector.take(simulation.snapshot)
            return simulation

        if job.case.worst_place is not None:
            found = search_places(job.case.scenario, job.case.worst_place, seen).figures()
        else:
            line = _line(job.case.scenario, job.places)
            calculate(line, find=seen, rows=False)
            found = line.figures
    except (EquilibriumError, ValueError) as error:
        return CaseResult(job.case.id, (), " ".join(str(error).split()))
    return CaseResult(job.case.id, tuple(found), ranges=collector.ranges())


def rest_again(case: LoadCase, first: LoadCase, places: int, place: float, bases: Bases) -> Simulation:
    """Simulation of a load case at rest with the vehicle at a place, bit-identical to its earlier calculation.

    Args:
        case: load case at rest.
        first: load case from whose equilibrium the search begins.
        places: number of places of the vehicle in the calculation.
        place: of the vehicle, in m: one of these places, or of the search for the worst.
        bases: keeps equilibria of `first`; the result is valid until the next call that begins at the same one.

    Raises:
        EquilibriumError: the case has no equilibrium.
    """
    line = _line(case.scenario, places)
    if case.worst_place is not None:
        line = line_at(case.scenario, place, one=case.worst_place.one)
    return at_place(line, place, _find(case, first, places, bases))


def _find(case: LoadCase, first: LoadCase | None, places: int, bases: Bases) -> Find:
    """Make the equilibrium search of a load case: from the equilibrium of `first` on the same mesh, or from scratch."""

    def find(scenario: Scenario, place: float) -> Simulation:
        if first is None or first.id == case.id or case.worst_place is not None:
            return from_scratch(scenario, place)
        key = f"{first.scenario.name}: {first.id}", places, place
        if next(iter(bases), key)[:2] != key[:2]:
            bases.clear()
        if key not in bases:
            bases[key] = None
            with suppress(EquilibriumError):  # of tensioning beyond its travel, where the other is held at its limits
                line = _line(first.scenario, places)
                bases[key] = cast(Rests, at_place(line, place, lambda base, _: Rests(base)))
        begin = bases[key]
        return from_scratch(scenario, place) if begin is None else begin.under(scenario)

    return with_stops(find) if case.stops else find


def _line(scenario: Scenario, places: int) -> Line:
    """Line of a load case: of one place, that of the scenario, with the vehicle that is placed where there are more."""
    if places > 1:
        return plan_line(scenario, places, None)
    here = scenario.carriages.get(plan_line(scenario, 2, None).moved)
    return Line(scenario, "", np.array([0.0 if here is None else here.arc_length]))


def run_side_by_side(parts: Sequence[Neighbours], on_part: Callable[[list[CaseResult]], object]) -> None:
    """Calculate parts of the load cases in worker processes.

    Args:
        parts: of the load cases.
        on_part: called with the results of each part, in their order.
    """
    context = multiprocessing.get_context("spawn")  # a process that has threads must not be forked
    workers = min(usable_cores(), len(parts))
    pool = ProcessPoolExecutor(workers, context, signal.signal, (signal.SIGINT, signal.SIG_IGN))
    try:
        for results in pool.map(run_part, parts):
            on_part(results)
    finally:
        processes = list((pool._processes or {}).values())
        pool.shutdown(wait=False, cancel_futures=True)
        for process in processes:  # jobs are not awaited after Ctrl-C
            process.terminate()
