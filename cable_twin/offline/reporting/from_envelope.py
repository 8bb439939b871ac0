"""Results of an envelope of load cases for a report, with governing states at rest calculated again for drawings."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cable_twin.basics.units import counted
from cable_twin.frame.snapshot import Snapshot
from cable_twin.key_figures import FigureId, KeyFigure, supports_of
from cable_twin.offline.envelopes.cases import case_again
from cable_twin.offline.envelopes.ranges import Ranges, ranges_of_plain
from cable_twin.offline.envelopes.runs import Bases, first_of_each_mesh, mesh_key, rest_again
from cable_twin.offline.export import figure_of_columns
from cable_twin.offline.lines.at_rest import Line, at_place
from cable_twin.offline.reporting.from_log import PLACES, take_heights
from cable_twin.offline.reporting.judging import judge_extremes, with_rules
from cable_twin.offline.reporting.remarks import ScenarioText, inputs_of
from cable_twin.offline.reporting.results import Case, Results, ResultsError, RopeCourse, TowerLoad
from cable_twin.offline.verdict_table import verdict_of_columns
from cable_twin.scenario import Scenario, ScenarioError, load_scenario

LARGEST = 200_000_000  # bytes of a file
MOST = 60  # states that are found again, those that govern most figures first
LOAD = "support_load", "highest"
DRAWN = LOAD, ("rope_tension", "highest"), ("rope_tension", "lowest"), ("sag", "highest"), ("rope_clearance", "lowest")
SAME = 1e-6  # share of a load by which a state that is found again may differ
EXPECTED = "allowed: a file that `envelope --json` has written"


class Governing(NamedTuple):
    """State at rest that governs key figures of an envelope: id of the load case, and place of the vehicle (m)."""

    case: str
    place: float


def read_envelope(
    path: Path,
    on_state: Callable[[int], Callable[[], object]],
    file: Path | None = None,
    rules: Sequence[str] | None = None,
    facts: Mapping[str, Any] | None = None,
) -> Results:
    """Read the results of an envelope of load cases for a report.

    Args:
        path: file written by `envelope --json`.
        on_state: called with the number of states to be calculated; returns a function to call after each.
        file: scenario file with its remarks; None for that of the envelope.
        rules: rule profiles by which the extremes are judged, in place of the verdicts of the envelope.
        facts: keys of `limits.installation` for these verdicts, in place of those of the scenario.

    Raises:
        ResultsError: the file is not of an envelope.
        ScenarioError: the scenario or a rule profile of it is invalid.
        EquilibriumError: a state has no equilibrium.
    """
    data = _content(path)
    try:
        scenario = load_scenario(data["resolved"])
        figures = [figure_of_columns(one) for one in data["envelope"]]
        governing = {one.id: str(row["case"]) for one, row in zip(figures, data["envelope"], strict=True)}
        rows = data.get("at_rest") or data["envelope"]  # not of earlier versions
        still = [(str(row["case"]), figure_of_columns(row)) for row in rows]
        ranges = ranges_of_plain(data.get("ranges") or {"tensions": {}, "forces": {}})  # the same
        names = {str(one.id): one.name for one in figures}
        verdicts = [verdict_of_columns(one, names) for one in data["rules"]]
        cases = [_case(one) for one in data["cases"]]
        moving = {one.id for one in cases if one.moves}
        kept = ScenarioText(**data["file"]) if "file" in data else None  # not of earlier versions
        places, version, command = int(data["places"]), str(data["version"]), str(data["command"])
    except ScenarioError as error:
        raise ScenarioError(*(f"{path}: {fault}" for fault in error.faults)) from None
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        said = f"{error} is missing" if isinstance(error, KeyError) else " ".join(str(error).split())
        raise ResultsError(f"{path}: no envelope: {said}; {EXPECTED}") from None
    inputs = inputs_of(scenario, file, kept)
    scenario, profiles = with_rules(scenario, rules, facts or {})
    if rules is not None or facts:
        try:
            verdicts = judge_extremes(scenario, figures, governing, cases, profiles, still if moving else ())
        except ResultsError as error:
            raise ResultsError(f"{path}: {error}") from None
    states = _states([(case, one) for case, one in still if case not in moving])
    done = on_state(len(states))
    found = _found_again(scenario, data["cases"], states, places, done)
    if not states:  # all is governed by cases in motion
        found[Governing("", 0.0)] = at_place(Line(scenario, "", np.zeros(1)), 0.0).snapshot
    ropes, towers = _courses(scenario, found, ranges), _towers(scenario, figures, governing, found, ranges)
    lost = sum(bool(one.fault) and not one.moves for one in cases)
    at_rest = counted(len(cases) - len(moving) - lost, "load case")
    told = f"{at_rest} at rest, {counted(places, 'place')} of the vehicle, {len(moving)} in motion"
    told += f", {lost} without a result" if lost else ""
    governing_states = (
        f"{counted(len(states), 'state')} at rest, which govern tensions, sags, clearances and tower loads"
    )
    governing_states += " of the cases at rest" if moving else ""
    drawn = governing_states if states else "line at rest"
    drawn += "" if "ranges" in data else "; tensions along ropes of these alone, as in files of earlier versions"
    notes = [] if towers is not None else ["states at rest differ from those of the envelope: made by another version?"]
    return Results(
        scenario.name,
        scenario,
        figures,
        inputs,
        governing,
        "load cases at rest and in motion" if moving else "load cases at rest",
        ("vehicle at", "m"),
        profiles,
        verdicts,
        ropes,
        towers or [],
        cases=cases,
        sources=[
            ("envelope", f"{path}: {told}"),
            ("envelope made by", f"cable_twin {version}: {command}"),
            ("drawn", drawn),
        ],
        notes=notes,
    )


def _case(one: Mapping[str, Any]) -> Case:
    return Case(one["id"], one["name"], one["changes"], one["fault"], bool(one.get("dynamic")))


def _content(path: Path) -> Mapping[str, Any]:
    try:
        if path.stat().st_size > LARGEST:
            raise ResultsError(f"{path}: larger than {LARGEST} bytes; {EXPECTED}")
        data = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ResultsError(f"{path}: {(error.strerror or str(error)).lower()}; {EXPECTED}") from None
    except (ValueError, RecursionError) as error:
        raise ResultsError(f"{path}: no JSON ({' '.join(str(error).split())}); {EXPECTED}") from None
    if not isinstance(data, Mapping):
        raise ResultsError(f"{path}: no envelope: given a list or a number; {EXPECTED}")
    return data


def _states(extremes: Sequence[tuple[str, KeyFigure]]) -> list[Governing]:
    """States at rest that govern the drawn ones of extremes with their cases, those of most figures first."""
    drawn = [(case, one) for case, one in extremes if (one.id.quantity, one.id.statistic) in DRAWN]
    counts = Counter(Governing(case, one.time) for case, one in drawn)
    return [state for state, _ in counts.most_common(MOST)]


def _found_again(
    scenario: Scenario,
    cases: Sequence[Mapping[str, Any]],
    states: Sequence[Governing],
    places: int,
    done: Callable[[], object],
) -> dict[Governing, Snapshot]:
    """Calculate governing states at rest again, each from the equilibrium from which the envelope has found it.

    Args:
        scenario: scenario that the load cases change.
        cases: plain data of all load cases.
        states: load cases and places to calculate.
        places: number of places of the vehicle in the envelope.
        done: called after each state.
    """
    firsts = first_of_each_mesh([case["changes"] for case in cases])
    columns = {str(case["id"]): case for case in cases}
    keys = {one: mesh_key(columns[one.case]["changes"]) for one in states}
    bases: Bases = {}
    found: dict[Governing, Snapshot] = {}
    for key, group in groupby(sorted(states, key=lambda one: (keys[one], one)), key=keys.__getitem__):
        first = case_again(cases[firsts[key]], scenario)
        for one in group:
            again = case_again(columns[one.case], scenario)
            found[one] = rest_again(again, first, places, one.place, bases).snapshot
            done()
    return {one: found[one] for one in states}


def _courses(scenario: Scenario, found: Mapping[Governing, Snapshot], ranges: Ranges) -> list[RopeCourse]:
    """Courses of all ropes: lowest heights and clearances over the states at rest, tensions over all load cases."""
    courses = []
    snapshots = list(found.values())
    for name, part in snapshots[0].layout.ropes.items() if snapshots else ():
        shapes = [one.columns.rope_position[part] for one in snapshots]
        tensions = np.array([one.columns.rope_tension[part] for one in snapshots])
        x = np.linspace(min(one[:, 0].min() for one in shapes), max(one[:, 0].max() for one in shapes), PLACES)
        lowest, above = np.full(PLACES, np.nan), np.full(PLACES, np.nan)
        for shape in shapes:
            take_heights(scenario, shape, x, lowest, above)
        arc_lengths = snapshots[0].layout.arc_lengths[part]
        both = np.array([tensions.min(axis=0), tensions.max(axis=0)])
        if name in ranges.tensions:
            both = ranges.tensions[name].along(arc_lengths)
        courses.append(RopeCourse(name, arc_lengths, shapes[0], x, lowest, above, both))
    return courses


def _towers(
    scenario: Scenario,
    figures: list[KeyFigure],
    governing: Mapping[FigureId, str],
    found: Mapping[Governing, Snapshot],
    ranges: Ranges,
) -> list[TowerLoad] | None:
    """Forces on towers in their governing states; None where a force differs from the load of the envelope."""
    loads = {one.id.subject: one for one in figures if (one.id.quantity, one.id.statistic) == LOAD}
    towers = []
    for row, subject in enumerate(supports_of(scenario)):
        load = loads.get(subject.key)
        if load is None or subject.name not in scenario.towers:
            continue
        snapshot = found.get(Governing(governing[load.id], load.time))
        force = ranges.forces.get(subject.key, np.full(3, np.nan))  # of a case in motion, or not found again
        if snapshot is not None:
            force = -snapshot.columns.support_force[row]
            if abs(float(np.linalg.norm(force)) - load.value) > SAME * load.value:
                return None
        least = ranges.least_forces.get(subject.key, np.full(3, np.nan))
        towers.append(TowerLoad(subject.key, subject.name, np.array(scenario.tower_places[subject.name]), force, least))
    return towers
