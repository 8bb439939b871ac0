"""Load cases at rest, each found from the rest of the first one on the same mesh."""

from __future__ import annotations

import gc
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import NamedTuple, cast

import numpy as np

from cable_twin.key_figures import KeyFigure
from cable_twin.offline.envelopes.cases import LoadCase
from cable_twin.offline.envelopes.motion import run_dynamic
from cable_twin.offline.envelopes.places import search_places
from cable_twin.offline.envelopes.tensioning import with_stops
from cable_twin.offline.lines.at_rest import Line, at_place, calculate, from_scratch, plan_line
from cable_twin.scenario import Scenario
from cable_twin.simulation import EquilibriumError, Simulation
from cable_twin.simulation.rests import Rests

MOST_OF_PART = 10  # cases between two looks at what is finished
OFF_MESH = re.compile(r"payload|^carriers\.loaded$|^air\.wind|\.counterweight\.|\.hydraulics\.|^limits\.")


@dataclass(frozen=True, slots=True)
class Job:
    """Load case to be calculated."""

    case: LoadCase
    places: int


@dataclass(frozen=True, slots=True)
class CaseResult:
    """Key figures of a load case at rest; the time of a figure is the place of the vehicle (m)."""

    id: str
    figures: tuple[KeyFigure, ...]
    fault: str = ""


class Neighbours(NamedTuple):
    """Load cases of which each is at rest near the first one of them, on the same mesh.

    Attributes:
        first: the first one of the file, from whose rests those of the others are searched for.
        jobs: some of them.
    """

    first: LoadCase
    jobs: Sequence[Job]


def neighbours(jobs: Sequence[Job], all_jobs: Sequence[Job], cores: int) -> list[Neighbours]:
    """Parts of load cases for processes, in the order of the file, by what the mesh depends on.

    Args:
        jobs: those to be calculated.
        all_jobs: all of the file, which tell the first one of each part on any rerun.
        cores: processes that there will be.
    """
    firsts: dict[str, LoadCase] = {}
    for job in all_jobs:
        firsts.setdefault(_mesh_key(job.case), job.case)
    groups: dict[str, list[Job]] = {}
    for job in jobs:
        groups.setdefault(_mesh_key(job.case), []).append(job)
    found = []
    for key, group in groups.items():
        size = min(max(len(group) // (2 * cores), 1), MOST_OF_PART)
        found += [Neighbours(firsts[key], group[row : row + size]) for row in range(0, len(group), size)]
    return found


def _mesh_key(case: LoadCase) -> str:
    """Changes of a case except those of payloads, wind and tensioning, on which the mesh does not depend."""
    return repr(sorted((key, repr(one)) for key, one in case.changes.items() if not OFF_MESH.search(key)))


_bases: dict[tuple[str, int, float], Rests] = {}  # of the present part, by its first case, places and place


def run_part(part: Neighbours) -> list[CaseResult]:
    """Calculate load cases at rest, each from the rest of the first one of their part."""
    with uncollected():
        return [run_case(job, part.first) for job in part.jobs]


@contextmanager
def uncollected() -> Iterator[None]:
    """Context without the search for cycles of objects, which takes a fifth of the time among many key figures."""
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.enable()


def run_case(job: Job, first: LoadCase | None = None) -> CaseResult:
    """Calculate one load case, at rest or its run.

    Args:
        job: what is calculated.
        first: another one, from whose rest the search begins where the mesh is the same; None for from scratch.
    """

    def find(scenario: Scenario, place: float) -> Simulation:
        if first is None or first.id == job.case.id:
            return from_scratch(scenario, place)
        key = f"{first.scenario.name}: {first.id}", job.places, place
        if next(iter(_bases), key)[:2] != key[:2]:
            _bases.clear()
        if key not in _bases:
            line = _line(first.scenario, job.places)
            _bases[key] = cast(Rests, at_place(line, place, lambda base, _: Rests(base)))
        return _bases[key].under(scenario)

    try:
        if job.case.dynamic is not None:
            figures, fault = run_dynamic(job.case.scenario, job.case.dynamic)
            return CaseResult(job.case.id, tuple(figures), fault)
        if job.case.worst_place is not None:
            rest = with_stops(from_scratch) if job.case.stops else from_scratch
            search = search_places(job.case.scenario, job.case.worst_place, rest)
            return CaseResult(job.case.id, tuple(search.figures()))
        line = _line(job.case.scenario, job.places)
        calculate(line, find=with_stops(find) if job.case.stops else find, rows=False)
    except (EquilibriumError, ValueError) as error:
        return CaseResult(job.case.id, (), " ".join(str(error).split()))
    return CaseResult(job.case.id, tuple(line.figures))


def _line(scenario: Scenario, places: int) -> Line:
    return Line(scenario, "", np.zeros(1)) if places == 1 else plan_line(scenario, places, None)
