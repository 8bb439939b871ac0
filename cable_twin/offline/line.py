"""Command `line`: static line calculation with the vehicle at many places, and the envelope of all results."""

from __future__ import annotations

import csv
import json
import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, TextIO

import numpy as np
from rich.console import Console

from cable_twin.key_figures import not_judged, values_of
from cable_twin.key_figures.rules import judge, profiles_of
from cable_twin.offline.check import compared, refined
from cable_twin.offline.export import STDOUT, opened
from cable_twin.offline.figure_table import print_figures, table_console
from cable_twin.offline.lines.at_rest import MOST, Line, calculate, plan_line
from cable_twin.offline.simulate_options import DEFAULT_SCENARIO, add_changes, plot_fault
from cable_twin.offline.survey.drawing import drawing_fault, write_drawing
from cable_twin.offline.verdict_table import print_verdicts, verdict_columns
from cable_twin.scenario import ScenarioError, load_scenario, scenario_lines
from cable_twin.simulation import EquilibriumError
from cable_twin.terminal.bars import count_shown
from cable_twin.terminal.command_line import OneLineParser, fail, left_at_once, whole_number

DONE, FAILED, UNUSABLE = 0, 1, 2
PLACES = 40
EPILOG = """\
The static equilibrium of the whole line, with its loads, wind and ice, is calculated for N places of the vehicle, from
one end of its track, or another vehicle on it, to the other. The carriers of a moving cable are advanced over one
spacing; vehicles on a common haul rope are moved together, over the travel of its drive. In space, places at which
vehicles pass masts or each other are added. The table gives the highest and lowest values with the place of the
vehicle and the limits of the scenario. Loads of supports are forces of the cable on the support, by component.

exit codes: 0 done, 1 no equilibrium at a place or a file cannot be written, 2 wrong scenario or option

examples:
  line aerial_tramway
  line aerial_tramway --places 100 --plot empty.png \\
       --set carriages.cabin.payload.mass=0
  line gondola --csv gondola.csv --profile gondola.dxf
  line aerial_tramway --places 10 --check
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Calculate a line at rest and report; returns the exit code that the help lists."""
    arguments = parser()
    options = arguments.parse_args(sys.argv[1:] if argv is None else list(argv))
    if fault := plot_fault(options.plot) or drawing_fault(options.profile):
        return fail("line", fault, UNUSABLE)
    console = Console(stderr=True)
    scenario = arguments.given_scenario(options) or DEFAULT_SCENARIO
    try:
        with left_at_once("line"), console.status("compiling the solver, once on this machine: about half a minute"):
            line = plan_line(load_scenario(scenario, dict(options.set)), options.places, options.vehicle)
            profiles_of(line.scenario)
        with count_shown(console, "places at rest", line.places.size) as on_place:
            calculate(line, on_place)
        if options.check:
            finer = plan_line(refined(line.scenario), options.places, options.vehicle)
            with count_shown(console, "places at rest", finer.places.size) as on_place:
                calculate(finer, on_place)
            line.figures = compared(line.figures, finer.figures)
    except (ScenarioError, ValueError) as error:
        return fail("line", error, UNUSABLE)
    except EquilibriumError as error:
        return fail("line", error, FAILED)
    words = table_console()
    if STDOUT in (options.csv, options.json):
        words = Console(stderr=True, width=160, highlight=False)
    title = f"{line.moved} at {line.places.size} places" if line.moved else "no vehicle"
    words.print(f"{line.scenario.name} at rest, {title}", markup=False)
    print_figures(words, [line.figures], at=f"{line.moved} at" if line.moved else "at", unit_at="m")
    for one in not_judged(line.scenario, line.figures):
        words.print(one.told(), markup=False)
    print_verdicts(words, profiles_of(line.scenario), judge(line.scenario, line.figures, at_rest=True), line.scenario)
    try:
        for path, write in ((options.csv, _write_csv), (options.json, _write_json)):
            if path is not None:
                with opened(path) as file:
                    write(file, line)
        if options.plot is not None:
            from cable_twin.offline.lines.plot import write_line_plot  # noqa: PLC0415 - matplotlib takes a second

            write_line_plot(line, options.plot)
        if options.profile is not None:
            write_drawing(line, options.profile)
    except BrokenPipeError:
        raise  # the reader of the output has closed it: `entry_points` ends silently
    except OSError as error:
        return fail("line", f"{error.filename or 'output'}: {error.strerror or error}", FAILED)
    return DONE


def parser() -> OneLineParser:
    """Parser of the options of `line`."""
    result = OneLineParser(
        "line", "Calculate a line at rest with its vehicle at many places.", EPILOG, failure=UNUSABLE
    )
    result.add_scenario(f"name of a scenario, or path of its YAML file; default: {DEFAULT_SCENARIO}", scenario_lines)
    result.add_argument(
        "--vehicle",
        metavar="NAME",
        help="vehicle that is placed along the line; default: the first carriage, or all carriers together",
    )
    result.add_argument(
        "--places",
        type=whole_number(2, MOST),
        default=PLACES,
        metavar="N",
        help=f"number of places, 2 to {MOST}, beside those of passing masts and vehicles; default: {PLACES}",
    )
    add_changes(result)
    result.add_argument(
        "--check",
        action="store_true",
        help="calculate the line a second time with elements half as long and contact points of saddles half as far "
        "apart, and print how much each figure changes",
    )
    result.add_argument(
        "--csv", metavar="PATH", help="write one row for each place, in SI units; '-': to standard output"
    )
    result.add_argument(
        "--json", metavar="PATH", help="write these rows and the envelope, in SI units; '-': to standard output"
    )
    result.add_argument(
        "--plot",
        type=Path,
        metavar="PATH",
        help="plot profile, terrain, tension, clearance and tower loads, as .png, .pdf or .svg",
    )
    result.add_argument(
        "--profile",
        type=Path,
        metavar="PATH",
        help="write terrain, towers, range of the ropes and clearance, as .csv, or .dxf for CAD (needs ezdxf)",
    )
    return result


def _rows(line: Line) -> tuple[list[str], list[list[float | None]]]:
    """Column names with units, and a row of numbers for each place of a calculated line; None where missing."""
    table = np.column_stack([line.places, *line.rows.values()])
    return ["place [m]", *line.rows], [
        [value if math.isfinite(value) else None for value in row] for row in table.tolist()
    ]


def _write_csv(file: TextIO, line: Line) -> None:
    names, rows = _rows(line)
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(names)
    writer.writerows(rows)


def _write_json(file: TextIO, line: Line) -> None:
    names, rows = _rows(line)
    envelope: list[dict[str, Any]] = []
    for one in line.figures:
        values = {key: value for key, value in values_of(one).items() if key not in ("time_s", "band")}
        numbers: dict[str, Any] = {key: float(values[key]) for key in ("value", "limit") if key in values}
        if one.uncertainty is not None:
            numbers["uncertainty"] = one.uncertainty
        envelope.append({"name": one.name, **values, **numbers, "vehicle_at_m": one.time, "kept": one.kept})
        envelope[-1]["verdict"] = one.verdict or None
    content: dict[str, Any] = {"scenario": line.scenario.name, "vehicle": line.moved, "envelope": envelope}
    if verdicts := judge(line.scenario, line.figures, at_rest=True):
        content["rules"] = [verdict_columns(one) for one in verdicts]
    json.dump({**content, "columns": names, "rows": rows}, file, indent=1)
    file.write("\n")


if __name__ == "__main__":
    sys.exit(main())
