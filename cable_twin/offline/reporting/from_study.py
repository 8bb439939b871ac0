"""Results of a study for a report: range of each key figure over all cases, and Sobol indices of the varied keys."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from cable_twin.basics.units import rounded
from cable_twin.key_figures import QUANTITIES, FigureId, KeyFigure
from cable_twin.offline.reporting.judging import judge_cases, with_rules
from cable_twin.offline.reporting.remarks import DIGITS, inputs_of
from cable_twin.offline.reporting.results import Case, Results, ResultsError, SobolIndex, StudyRange
from cable_twin.offline.studies.design import SCRIPT
from cable_twin.offline.studies.record import ENDS, MANIFEST, TABLE
from cable_twin.scenario import ScenarioError, load_scenario
from cable_twin.scenario.reference import unit_of

INDICES = "indices.csv"
EXPECTED = "allowed: a directory that `study --out` has written"


def is_study(path: Path) -> bool:
    """Whether a path is the directory of a study, or the manifest in it."""
    return path.name == MANIFEST or (path / MANIFEST).is_file()


def read_study(
    path: Path,
    file: Path | None = None,
    rules: Sequence[str] | None = None,
    facts: Mapping[str, Any] | None = None,
) -> Results:
    """Read the results of a study for a report.

    Args:
        path: directory of the study, or its manifest.
        file: scenario file with its remarks; None for the shipped file of the scenario's name.
        rules: rule profiles by which each case is judged, in place of those of the scenario.
        facts: keys of `limits.installation` for these verdicts, in place of those of the scenario.

    Raises:
        ResultsError: the study has no results, or they are damaged.
        ScenarioError: the scenario is invalid.
    """
    directory = path.parent if path.name == MANIFEST else path
    try:
        manifest = json.loads((directory / MANIFEST).read_text(encoding="utf-8"))
        scenario = load_scenario(manifest["scenario"])
        vary, program = manifest["vary"], manifest["program"]
        rows = list(_rows(directory / TABLE))
        cases = [_case(row, vary) for row in rows]
        judged = [(row["case"], _values(row, vary), _figures(row, manifest["figures"])) for row in rows]
        at_rest = manifest["duration"] == 0.0
        ranges = [_range(FigureId.of_text(key), one, rows) for key, one in manifest["figures"].items()]
        indices = [_index(row, manifest["figures"]) for row in _rows(directory / INDICES)]
        design = f"{manifest['method']}, {manifest['cases']} cases, {manifest['finished']} finished"
        design += f", {manifest['with_fault']} with a fault; {manifest['duration']:g} s each, seed {manifest['seed']}"
        made = f"cable_twin {program['package_version']}, numpy {program['numpy_version']}, "
        made += f"numba {program['numba_version']}, {program['machine']}"
    except ScenarioError as error:
        raise ScenarioError(*(f"{directory / MANIFEST}: {fault}" for fault in error.faults)) from None
    except OSError as error:
        raise ResultsError(f"{error.filename}: {(error.strerror or str(error)).lower()}; {EXPECTED}") from None
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        said = f"{error} is missing" if isinstance(error, KeyError) else " ".join(str(error).split())
        raise ResultsError(f"{directory}: no study: {said}; {EXPECTED}") from None
    scenario, profiles = with_rules(scenario, rules, facts or {})
    verdicts = judge_cases(scenario, judged, profiles, at_rest=at_rest)
    found = [one for one in ranges if one is not None]
    figures = [one.extreme for one in found]
    return Results(
        scenario.name,
        scenario,
        figures,
        inputs_of(scenario, file),
        {one.extreme.id: one.case for one in found},
        kind="a study",
        profiles=profiles,
        verdicts=verdicts,
        cases=cases,
        ranges=found,
        indices=indices,
        factors=[_factor(key, values) for key, values in vary.items()],
        sources=[("study", f"{directory}: {design}"), ("study made by", made)],
    )


def _rows(file: Path) -> Iterator[dict[str, str]]:
    """Rows of a study's CSV table by column name; none if the table of Sobol indices is missing, as for a grid."""
    if file.name == INDICES and not file.exists():
        return
    with file.open(encoding="utf-8", newline="") as stream:
        yield from csv.DictReader(stream)


def _case(row: Mapping[str, str], vary: Mapping[str, Any]) -> Case:
    broken = int(row["limits_not_kept"] or 0)
    name = f"limits not kept: {broken}" if broken else ""
    return Case(row["case"], name, {key: _number(row[key]) for key in vary}, row["fault"], not_kept=broken)


def _number(text: str) -> object:
    try:
        return float(f"{float(text):.6g}")
    except ValueError:
        return text


def _range(id_: FigureId, said: Mapping[str, str], rows: list[dict[str, str]]) -> StudyRange | None:
    """Range of a key figure over the cases of a study that have it; None where no case has it."""
    if id_.quantity not in QUANTITIES:
        raise ValueError(f"id: given {str(id_)!r}; allowed: ids of key figures")
    found = [(float(row[str(id_)]), row["case"]) for row in rows if row.get(str(id_))]
    found = [one for one in found if math.isfinite(one[0])]
    if not found:
        return None
    low, high = (pick(found, key=lambda one: one[0]) for pick in (min, max))
    value, case = low if id_.statistic == "lowest" else high
    extreme = KeyFigure(id_, said["name"], value, said["unit"], math.nan)
    return StudyRange(extreme, case, low, high, len(found))


def _values(row: Mapping[str, str], vary: Mapping[str, Any]) -> dict[str, Any]:
    """Values of the varied keys of a study's case, by dotted key of the scenario."""
    found: dict[str, Any] = {}
    for key in vary:
        if key == SCRIPT:
            continue
        try:
            found[key] = int(row[key]) if row[key].lstrip("-").isdecimal() else float(row[key])
        except ValueError:
            found[key] = row[key]
    return found


def _figures(row: Mapping[str, str], said: Mapping[str, Mapping[str, str]]) -> list[KeyFigure]:
    """Key figures of a study's case from its row, without times and places, which the table does not have."""
    return [
        KeyFigure(FigureId.of_text(key), one["name"], value, one["unit"], 0.0)
        for key, one in said.items()
        if row.get(key) and math.isfinite(value := float(row[key]))
    ]


def _index(row: Mapping[str, str], figures: Mapping[str, Any]) -> SobolIndex:
    numbers = [float(row[key]) for key in ("first", "first_low", "first_high", "total", "total_low", "total_high")]
    return SobolIndex(row["figure"], str(figures[row["figure"]]["name"]), row["key"], *numbers)


def _factor(key: str, values: Mapping[str, float] | Sequence[Any]) -> tuple[str, str]:
    """Varied key, and its range or list of values as text with unit."""
    said, joined = ([values[end] for end in ENDS], " to ") if isinstance(values, Mapping) else (values, ", ")
    texts = [str(one) if isinstance(one, str | bool) else rounded(one, DIGITS) for one in said]
    return key, f"{joined.join(texts)} {unit_of(key)}".rstrip()
