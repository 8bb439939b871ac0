"""Command `calibrate`: parameters of a scenario from logs of a plant, with intervals and an identifiability check."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from functools import partial
from importlib import metadata
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rich.console import Console

from cable_twin.basics.units import counted, rounded, shown_unit
from cable_twin.ensemble import usable_cores
from cable_twin.ensemble.estimate.quantities import readings
from cable_twin.frame.records import CommandError
from cable_twin.offline.calibration.check import Check, check
from cable_twin.offline.calibration.data import Package, fingerprint, logs_of, package, twin_of
from cable_twin.offline.calibration.parameters import CalibrationError, Prior, parameters_of, prior_of
from cable_twin.offline.calibration.prediction import (
    Evaluation,
    Predictor,
    deviations_of,
    load_state,
    save_state,
    scales_of,
)
from cable_twin.offline.calibration.solve import MISFIT, Solution, solve
from cable_twin.offline.calibration.writing import results, scenario_text
from cable_twin.offline.simulate_options import UNUSABLE, add_changes, plots_fault
from cable_twin.recording.log_file import LogError
from cable_twin.scenario import ScenarioError
from cable_twin.simulation import EquilibriumError, Simulation
from cable_twin.terminal.bars import share_shown, start_shown
from cable_twin.terminal.command_line import INTERRUPTED, OneLineParser, fail, tell, whole_number

DONE, FAILED = 0, 1  # exit codes, beside UNUSABLE
STATE, SCENARIO_FILE, RESULTS, PICTURE = "state.npz", "calibrated.yaml", "calibration.json", "calibration.png"
USUAL_RUNS = 6  # of all members in a solve
THOUSANDFOLD = 300.0, 3000.0  # times a prediction that a sensor with a wrong unit reads, or the inverse of that
EPILOG = """\
Twins repeat the run of each log with its commands. KEYs are those of a scenario, and errors of sensors:
sensors.NAME.bias, .gain and .delay, with * for any text in NAME. Each has a prior: the value of the scenario with an
assumed deviation, or that of --prior.

Before the solve a check tells which parameters the logs cannot tell, why, and which run would: these keep their
priors. The others come from bounded least squares of residuals over the standard deviations of the sensors, with one
stretch of 10 s out of five held out for validation. Intervals of 95 % count noise, priors, what is not told, and
errors of the model as far as residuals show them.

DIR gets calibrated.yaml, the scenario with a comment beside each number, calibration.json, calibration.png and
state.npz. The same command goes on where it was ended.

Where sensors do not fit at the end, the search starts again from other points. If they still do not fit, the values
and intervals of the files are not to be trusted.

exit codes: 0 done, 1 sensors do not fit, the twin failed, the solve found no end or something cannot be written, 2
wrong log, scenario, key or option, 130 ended by Ctrl-C

examples:
  echo '- {time: 2, name: cabin, speed: 7.0}' > trip.yaml
  plant aerial_tramway --set carriages.cabin.payload.mass=4200 \\
        --script trip.yaml --log plants
  calibrate plants/* --scenario aerial_tramway --output calibration \\
        --free carriages.cabin.payload.mass,cable.axial_stiffness
  calibrate plants/* --scenario aerial_tramway --output calibration \\
        --free 'wind.x,sensors.load_*.bias' --prior wind.x=0:3
"""

UNUSABLE_INPUT = (LogError, ScenarioError, EquilibriumError)


def parser() -> OneLineParser:
    """Parser of the options of `calibrate`."""
    result = OneLineParser(
        "calibrate", "Find parameters of a scenario from logs of its plant.", EPILOG, failure=UNUSABLE
    )
    result.add_argument(
        "logs", nargs="+", type=Path, metavar="LOG", help="directory of a plant's bag, or one of its .mcap files"
    )
    result.add_argument(
        "--free",
        required=True,
        action="append",
        type=_keys,
        metavar="KEY,KEY",
        help="parameters that are searched for; can be repeated",
    )
    result.add_argument(
        "--scenario", metavar="SCENARIO", help="scenario of the twin, name or path; default: that of the log"
    )
    add_changes(result)
    result.add_argument(
        "--prior",
        action="append",
        default=[],
        type=_prior,
        metavar="KEY=VALUE:DEVIATION",
        help="prior of a free parameter, mean and standard deviation in its unit; can be repeated",
    )
    result.add_argument(
        "--validate", action="append", default=[], type=Path, metavar="LOG", help="another log, held out whole"
    )
    result.add_argument("--check", action="store_true", help="only tell what the logs can tell, without a solve")
    result.add_argument(
        "--threads", type=whole_number(1, 1000), metavar="N", help="threads of the ensemble; default: one a core"
    )
    result.add_argument(
        "--output", type=Path, default=Path("calibration"), metavar="DIR", help="directory; default: calibration"
    )
    return result


def _keys(text: str) -> list[str]:
    found = [one.strip() for one in text.split(",")]
    if not all(found):
        raise argparse.ArgumentTypeError(f"given {text!r}; allowed: KEY,KEY as in cable.axial_stiffness,wind.x")
    return found


def _prior(text: str) -> tuple[str, Prior]:
    try:
        return prior_of(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def main(argv: Sequence[str] | None = None) -> int:
    """Calibrate a scenario by logs of a plant; returns the exit code that the help lists."""
    arguments = parser()
    options = arguments.parse_args(sys.argv[1:] if argv is None else list(argv))
    console = Console(stderr=True)
    try:
        with start_shown("calibrate", console):
            job = prepare(options)
        return _run(job, options, console)
    except (*UNUSABLE_INPUT, CalibrationError) as error:
        return fail("calibrate", error, UNUSABLE)
    except (_FailedError, CommandError) as error:
        return fail("calibrate", error, FAILED)
    except KeyboardInterrupt:
        return fail("calibrate", f"ended by Ctrl-C; what was done is kept in {options.output}", INTERRUPTED)
    except BrokenPipeError:
        raise
    except (OSError, RuntimeError) as error:  # RuntimeError: ~ of a user without a home
        return fail("calibrate", f"--output {options.output}: {getattr(error, 'strerror', None) or error}", FAILED)


class _FailedError(ValueError):
    """Failure of a calibration with valid input; the message is one line."""


class Job(NamedTuple):
    """Prepared calibration: simulation of the twin, data of the logs, and predictor of measurements."""

    simulation: Simulation
    packages: tuple[Package, ...]
    predictor: Predictor
    state: str  # fingerprint of all inputs


def prepare(options: argparse.Namespace) -> Job:
    """Prepare a calibration from its options: read logs, build the twin, look up the free parameters.

    Raises:
        ScenarioError, LogError, EquilibriumError, CalibrationError: a scenario, log or parameter cannot be used.
    """
    logs = logs_of([*options.logs, *options.validate], options.scenario)
    simulation = twin_of(logs[0], options.scenario, dict(options.set))
    scenario, rest = simulation.scenario, simulation.snapshot
    scales = scales_of(scenario, rest)
    known = {name: one for name, one in readings(scenario, rest.layout, _loads(rest)).items() if name in scales}
    keys = [key for given in options.free for key in given]
    parameters = parameters_of(simulation, keys, dict(options.prior), scales)
    training = len(options.logs)
    packages = tuple(
        package(log, scenario, known, partial(tell, "calibrate"), held=number >= training)
        for number, log in enumerate(logs)
    )
    deviations = deviations_of(scenario, scales)
    predictor = Predictor(scenario, packages, known, deviations, parameters, options.threads or usable_cores())
    state = fingerprint(packages, scenario.resolved(), parameters, deviations, metadata.version("cable_twin"))
    return Job(simulation, packages, predictor, state)


def _loads(rest: Any) -> dict[str, float]:
    """Load (N) of each support at rest, by name."""
    forces = rest.columns.support_force
    return {name: float(np.linalg.norm(forces[row])) for name, row in rest.layout.support_rows.items()}


def _run(job: Job, options: argparse.Namespace, console: Console) -> int:
    """Run a prepared calibration: identifiability check, solve, report; returns the exit code."""
    predictor, state = job.predictor, options.output.expanduser() / STATE
    state.parent.mkdir(parents=True, exist_ok=True)
    if kept := load_state(state, job.state):
        tell("calibrate", f"goes on with {len(kept)} evaluations of {state}")
        for one in kept:
            predictor.remember(one)
    predictor.on_evaluation = lambda _: save_state(state, job.state, predictor.evaluations)
    keys = len(predictor.parameters)
    print(
        f"{job.simulation.scenario.name}: {counted(keys, 'parameter')}, {len(predictor.rows.time)} measurements of "
        f"{sum(one.end for one in job.packages):.0f} s"
    )
    predictor.bar = lambda number: share_shown(console, f"all members, run {number} of about {USUAL_RUNS}")
    prior = predictor.evaluate(np.zeros(keys))
    _check_units(predictor, prior)
    found = check(predictor.parameters, prior, predictor.rows)
    _tell_check(found, any(one.moved for one in job.packages))
    if options.check:
        return DONE
    solution = solve(predictor, found, prior, partial(tell, "calibrate"))
    if not all(np.isfinite([one.deviation for one in solution.estimates])):
        raise _FailedError("the estimates have no finite 95 % intervals: nothing is written")
    _print(solution)
    return _write(job, solution, found, options)


def _check_units(predictor: Predictor, prior: Evaluation) -> None:
    """Raise an error for a sensor in another unit: readings about 1000 or 1/1000 times the predicted ones."""
    for name, ratio in predictor.ratios(prior).items():
        if any(THOUSANDFOLD[0] < one < THOUSANDFOLD[1] for one in (ratio, 1.0 / max(ratio, 1e-300))):
            raise CalibrationError(
                f"sensor {name}: given readings {ratio:.4g} times those of the twin, another unit?; allowed: SI units"
            )


def _tell_check(found: Check, moved: bool) -> None:
    """Print the result of the identifiability check: how well the logs tell, parameters not identifiable and why."""
    *values, last = [rounded(one, 3) for one in found.singular_values]
    times = f"{', '.join(values)} and {last}" if values else last
    directions = counted(len(found.findings), "direction")
    told = f"check: the logs tell {found.rank} of {directions} better than priors"
    print(f"{told}: deviations of priors are {times} times those of the logs")
    for one in found.findings:
        if not one.told:
            print(f"  {one.reason(moved)}")


def _print(solution: Solution) -> None:
    """Print estimates, residuals and high correlations of a calibration."""
    wide = max(len(one.parameter.key) for one in solution.estimates)
    print(f"{'parameter':{wide}}  {'value':>12} {'95 % interval':>27} {'prior':>12}  unit")
    for one in solution.estimates:
        unit, scale = shown_unit(one.parameter.unit, max(abs(one.value), abs(one.parameter.mean)))
        value, low, high, prior = (scale * number for number in (one.value, one.low, one.high, one.parameter.mean))
        interval = f"{rounded(low, 5)} to {rounded(high, 5)}"
        remark = "  prior kept" if not one.told else "  at its bound" if one.at_bound else ""
        remark += "  interval cut at its bound" if one.cut else ""
        remark += "".join(f"  = {key}" for key in one.parameter.joined)
        numbers = f"{rounded(value, 5):>12} {interval:>27} {rounded(prior, 5):>12}"
        print(f"{one.parameter.key:{wide}}  {numbers}  {unit}{remark}")
    print("root mean square of residuals in standard deviations:")
    print(f"{'sensor':{wide}}  {'prior':>12} {'training':>12} {'validation':>12}")
    for fit in solution.fits:
        held = "-" if np.isnan(fit.held) else f"{fit.held:.3g}"
        remark = "  does not fit" if fit.after > MISFIT else ""
        print(f"{fit.sensor:{wide}}  {fit.before:12.3g} {fit.after:12.3g} {held:>12}{remark}")
    told = [number for number, one in enumerate(solution.estimates) if one.told]
    for row in told:
        for column in told[: told.index(row)]:
            if abs(value := solution.correlation[row, column]) > 0.9:
                keys = (solution.estimates[number].parameter.key for number in (column, row))
                print(f"correlation {value:.3f}: {' and '.join(keys)}")


def _write(job: Job, solution: Solution, found: Check, options: argparse.Namespace) -> int:
    """Write all files of a calibration: scenario, results, picture; returns the exit code."""
    directory, scenario = options.output.expanduser(), job.simulation.scenario
    text = scenario_text(options.scenario, dict(options.set), scenario, solution.estimates, options.logs)
    (directory / SCENARIO_FILE).write_text(text, encoding="utf-8")
    said = json.dumps(results(solution, found, [*options.logs, *options.validate]), indent=2, allow_nan=False)
    (directory / RESULTS).write_text(said + "\n", encoding="utf-8")
    files = [SCENARIO_FILE, RESULTS]
    if fault := plots_fault("the picture"):
        tell("calibrate", fault)
    else:
        from cable_twin.offline.calibration.plot import write_picture  # noqa: PLC0415 - matplotlib is an extra

        write_picture(f"{scenario.name} calibrated", solution, job.predictor.rows, directory / PICTURE)
        files.append(PICTURE)
    print(f"{directory}: {', '.join(files)}")
    if not solution.converged:
        return fail("calibrate", f"no end after {solution.evaluations} evaluations: the values are not final", FAILED)
    if misfits := solution.misfits:
        sensors = ", ".join(f"{one.sensor} {rounded(one.after, 3)}" for one in misfits)
        elsewhere = f" from any of {solution.starts} starting points" if solution.starts > 1 else ""
        line = (
            f"the run does not fit{elsewhere}: values and intervals are not to be trusted; residuals: given {sensors}"
        )
        return fail("calibrate", f"{line} standard deviations; allowed: {MISFIT} or less", FAILED)
    return DONE


if __name__ == "__main__":
    sys.exit(main())
