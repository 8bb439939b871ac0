"""Output files of a calibration: the scenario with a comment beside each value, and all results as JSON."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from ruamel.yaml.comments import CommentedMap, CommentedSeq

from cable_twin.basics.limited_yaml import read_yaml
from cable_twin.basics.units import shown_unit, with_unit
from cable_twin.offline.calibration.check import Check
from cable_twin.offline.calibration.data import differences
from cable_twin.offline.calibration.parameters import OF_SENSORS
from cable_twin.offline.calibration.solve import Estimate, Solution
from cable_twin.offline.survey.marked import Change, dumped, rewritten
from cable_twin.scenario import (
    Scenario,
    Written,
    full_key,
    load_scenario,
    parse_scenario,
    scenario_file,
    scenario_keys,
    value_at,
)

DIGITS = 7  # of values in files
DEEPEST = 3  # of anchors in parts with anchors


def scenario_text(
    source: str | None,
    values: Mapping[str, Any],
    scenario: Scenario,
    estimates: Sequence[Estimate],
    logs: Sequence[Path],
) -> str:
    """YAML text of the scenario with the calibrated values, each with a comment on its origin.

    Args:
        source: file or name of the scenario, whose comments are kept; None for one from a log.
        values: changes of the scenario by dotted key.
        scenario: of the twin.
        estimates: of the calibration.
        logs: logs of the calibration.
    """
    given = {full_key(key): Change(value, "given by --set") for key, value in values.items()}
    found: dict[str, Change] = {}
    for one in estimates:
        with_bias = one.told and one.parameter.error == "bias" and one.parameter.sensor in scenario.sensors
        if not one.parameter.sensor or with_bias:
            value = float(f"{one.value:.{DIGITS}g}")
            found |= {key: Change(value, _source(one)) for key in one.parameter.keys}
    resolved = load_scenario(scenario.resolved(), {key: one.value for key, one in found.items()}).resolved()
    heading = f"Calibrated from {', '.join(path.name for path in logs)}, with intervals of 95 % beside the values."
    if source is not None:
        text = scenario_file(source).read_text(encoding="utf-8")
        if made := _in_file(text, given, found, resolved, heading):
            return made
    whole = {
        key: Change(value_at(resolved, key), one.why)
        for name, one in {**given, **found}.items()
        for key in scenario_keys(resolved, name)
    }
    return rewritten(dumped(_commented(resolved)), whole, heading)


def _in_file(
    text: str, given: Mapping[str, Change], found: Mapping[str, Change], resolved: Mapping[str, Any], heading: str
) -> str:
    """Text of a scenario file with given and found values; empty where they cannot be put into it."""
    written = Written(dict(read_yaml(text).content))
    with_sensors = OF_SENSORS in written.data
    changes = {key: one for key, one in {**given, **found}.items() if with_sensors or not key.startswith(OF_SENSORS)}
    try:
        for _ in range(1 + DEEPEST):  # parts with an anchor change those that share it
            made = rewritten(text, written.by_file(_whole(written, changes, resolved)), heading)
            now = parse_scenario(made).resolved()
            apart = [
                (key, value)
                for key, _, value in differences(now, resolved)
                if key.partition(".")[0] not in ("name", "description", *([] if with_sensors else [OF_SENSORS]))
            ]
            if not apart:
                return made
            changes |= {key: Change(value, "as before, no longer shared") for key, value in apart}
    except (KeyError, TypeError, ValueError):  # a key that has another form in the file
        pass
    return ""


def _whole(written: Written, changes: Mapping[str, Change], resolved: Mapping[str, Any]) -> dict[str, Change]:
    """Changes of a scenario file by key, with whole lists in place of parts of those that the file does not have."""
    found: dict[str, Change] = {}
    for key, change in changes.items():
        name, _, last = key.rpartition(".")
        here = scenario_keys(resolved, name)[0] if name else ""
        items = value_at(resolved, here)
        if not isinstance(items, list):
            found[key] = change
            continue
        there = [value_at(written.data, one) for one in written.by_file({name: change})]
        if all(isinstance(one, list) and len(one) == len(items) for one in there):
            found[key] = change
        else:
            why = f"{found[name].why}; {last}: {change.why}" if name in found else f"{last}: {change.why}"
            found[name] = Change(items, why)
    return found


def _commented(tree: Any) -> Any:
    """Convert plain data to YAML nodes: mappings with a key on each line, each list in one line."""
    if isinstance(tree, Mapping):
        content = CommentedMap()
        for key, value in tree.items():
            content[key] = _commented(value)
        return content
    if isinstance(tree, list | tuple):
        items = CommentedSeq([_commented(one) for one in tree])
        items.fa.set_flow_style()
        return items
    return tree


def _source(one: Estimate) -> str:
    """Comment beside an estimate in the scenario: unit, calibrated or prior kept, 95 % interval."""
    unit, _ = shown_unit(one.parameter.unit, one.value)
    unit = "" if unit == "-" else one.parameter.unit + ", "
    if not one.told:
        return f"{unit}prior kept: the logs do not tell it, +- {with_unit(one.half, one.parameter.unit, 3)} assumed"
    interval = f"+- {with_unit(one.half, one.parameter.unit, 3)} (95 %)"
    if one.cut:
        low, high = (with_unit(end, one.parameter.unit, 3) for end in (one.low, one.high))
        interval = f"{low} to {high} (95 %, cut at its bound)"
    return f"{unit}calibrated: {interval}, prior {one.parameter.prior}"


def results(solution: Solution, found: Check, logs: Sequence[Path]) -> dict[str, Any]:
    """All results of a calibration as plain data; residuals in standard deviations."""
    parameters = []
    for one, finding in zip(solution.estimates, found.findings, strict=True):
        parameters.append(
            {
                "key": one.parameter.key,
                "joined": list(one.parameter.joined),
                "unit": one.parameter.unit,
                "told": bool(one.told),
                "value": one.value,
                "low": one.low,
                "high": one.high,
                "at_bound": bool(one.at_bound),
                "cut_at_bound": bool(one.cut),
                "prior": {"mean": one.parameter.mean, "deviation": one.parameter.deviation},
                "bounds": [one.parameter.low, one.parameter.high],
                "model_error_factor": one.inflated,
                "left_of_prior": {"others_known": finding.alone, "others_free": finding.together},
            }
        )
    return {
        "logs": [str(path) for path in logs],
        "converged": solution.done,
        "do_not_fit": [one.sensor for one in solution.misfits],
        "evaluations": solution.evaluations,
        "starting_points": solution.starts,
        "parameters": parameters,
        "correlation": np.round(solution.correlation, 4).tolist(),
        "singular_values": found.singular_values.tolist(),
        "residuals": [
            {
                "sensor": one.sensor,
                "samples": one.samples,
                "prior": one.before,
                "training": one.after,
                "validation": None if np.isnan(one.held) else one.held,
            }
            for one in solution.fits
        ],
    }
