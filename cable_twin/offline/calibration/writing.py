"""Output files of a calibration: the scenario with a comment beside each value, and all results as JSON."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap, CommentedSeq

from cable_twin.basics.units import shown_unit, with_unit
from cable_twin.offline.calibration.check import Check
from cable_twin.offline.calibration.parameters import OF_SENSORS, value_at
from cable_twin.offline.calibration.solve import Estimate, Solution
from cable_twin.offline.survey.marked import Change, dumped, rewritten
from cable_twin.scenario import Scenario, full_key, load_scenario, scenario_file

DIGITS = 7  # of values in files


def scenario_text(
    source: str | None, values: Mapping[str, Any], scenario: Scenario, solution: Solution, logs: Sequence[Path]
) -> str:
    """YAML text of the scenario with the calibrated values, each with a comment on its origin.

    Args:
        source: file or name of the scenario, whose comments are kept; None for one from a log.
        values: changes of the scenario by dotted key.
        scenario: of the twin.
        solution: of the calibration.
        logs: logs of the calibration.
    """
    changes = {full_key(key): Change(value, "given by --set") for key, value in values.items()}
    for one in solution.estimates:
        with_bias = one.told and one.parameter.error == "bias" and one.parameter.sensor in scenario.sensors
        if not one.parameter.sensor or with_bias:
            value = float(f"{one.value:.{DIGITS}g}")
            changes |= {key: Change(value, _source(one)) for key in one.parameter.keys}
    heading = f"Calibrated from {', '.join(path.name for path in logs)}, with intervals of 95 % beside the values."
    if source is not None:
        text = scenario_file(source).read_text(encoding="utf-8")
        named = {key: one for key, one in changes.items() if not key.startswith(OF_SENSORS) or f"{OF_SENSORS}:" in text}
        try:
            made = rewritten(text, named, heading)
            if _has(load_scenario(YAML(typ="safe").load(made)), solution):
                return made
        except (KeyError, TypeError, ValueError):  # a key that has another form in the file
            pass
    return rewritten(dumped(_commented(scenario.resolved())), changes, heading)


def _has(scenario: Scenario, solution: Solution) -> bool:
    """Whether a scenario has all calibrated values of a solution."""
    resolved = scenario.resolved()
    return all(
        value_at(resolved, key) == float(f"{one.value:.{DIGITS}g}")
        for one in solution.estimates
        if not one.parameter.sensor
        for key in one.parameter.keys
    )


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
    return f"{unit}calibrated: +- {with_unit(one.half, one.parameter.unit, 3)} (95 %), prior {one.parameter.prior}"


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
                "low": one.value - one.half,
                "high": one.value + one.half,
                "at_bound": bool(one.at_bound),
                "prior": {"mean": one.parameter.mean, "deviation": one.parameter.deviation},
                "bounds": [one.parameter.low, one.parameter.high],
                "model_error_factor": one.inflated,
                "left_of_prior": {"others_known": finding.alone, "others_free": finding.together},
            }
        )
    return {
        "logs": [str(path) for path in logs],
        "converged": solution.converged,
        "evaluations": solution.evaluations,
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
