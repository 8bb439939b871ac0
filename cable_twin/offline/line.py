"""Command `line`: a static line calculation with the vehicle at many places, and the envelope of all results."""

from __future__ import annotations

import argparse
import csv
import json
import math
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TextIO

import numpy as np
from rich.console import Console

from cable_twin.frame.records import FloatArray, Place
from cable_twin.frame.snapshot import Columns, Snapshot
from cable_twin.key_figures import QUANTITIES, KeyFigure, KeyFigures, figure, supports_of, values_of
from cable_twin.key_figures.rules import judge, profiles_of
from cable_twin.offline.check import compared, refined
from cable_twin.offline.export import STDOUT
from cable_twin.offline.figure_table import print_figures, table_console
from cable_twin.offline.simulate_options import DEFAULT_SCENARIO, add_changes, plot_fault
from cable_twin.offline.survey.drawing import drawing_fault, write_drawing
from cable_twin.offline.verdict_table import print_verdicts, verdict_columns
from cable_twin.scenario import Scenario, ScenarioError, build_system, load_scenario, scenario_lines
from cable_twin.scenario.command_limits import sense_of, travel_between_stops
from cable_twin.simulation import EquilibriumError, Simulation
from cable_twin.terminal.bars import count_shown
from cable_twin.terminal.command_line import OneLineParser, fail, left_at_once

DONE, FAILED, UNUSABLE = 0, 1, 2
PLACES, MOST = 40, 2000
# quantities of motion, absent from a static line
MOVING = ("drive_force", "drive_power", "speed", "acceleration", "dynamic_amplification")
EPILOG = """\
The static equilibrium of the whole line, with its loads, wind and ice, is calculated for N places of the vehicle, from
one end of its track to the other. The carriers of a moving cable are advanced over one spacing; vehicles on a common
haul rope are moved together, over the travel of its drive. The table gives the highest and lowest values with the place
of the vehicle and the limits of the scenario. Loads of supports are forces of the cable on the support, by component.

exit codes: 0 done, 1 no equilibrium at a place or a file cannot be written, 2 wrong scenario or option

examples:
  line aerial_tramway
  line aerial_tramway --places 100 --plot empty.png \\
       --set carriages.cabin.payload.mass=0
  line gondola --csv gondola.csv --profile gondola.dxf
  line aerial_tramway --places 10 --check
"""


@dataclass(slots=True)
class Line:
    """Static line calculation, with a row for each place of the vehicle.

    Attributes:
        scenario: scenario of the line.
        moved: name of the moved vehicle, of the carriers of a moving cable, or of the drive of a haul rope.
        places: (n,) m, arc length of the vehicle; of carriers and a haul rope, travel of the cable.
        columns: columns of a frame at each place.
        lowest: least heights (m) of the vehicles over the terrain, with x (m) of each, at each place.
        rows: (n,) values by name and unit, at each place.
        figures: the envelope; the time of a figure is the place of the vehicle (m).
    """

    scenario: Scenario
    moved: str
    places: FloatArray
    columns: list[Columns] = field(default_factory=list)
    lowest: list[Mapping[str, Place]] = field(default_factory=list)
    rows: dict[str, FloatArray] = field(default_factory=dict)
    figures: list[KeyFigure] = field(default_factory=list)


Find = Callable[[Scenario, float], Simulation]


def from_scratch(scenario: Scenario, _place: float) -> Simulation:
    """Simulation at the rest of a scenario, found without another one."""
    return Simulation(scenario, on_demand=True)


def main(argv: Sequence[str] | None = None) -> int:
    """Calculate a line and report; the help has the exit codes."""
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
    print_verdicts(words, profiles_of(line.scenario), judge(line.scenario, line.figures, at_rest=True))
    try:
        for path, write in ((options.csv, _write_csv), (options.json, _write_json)):
            if path is not None:
                _write(path, line, write)
        if options.plot is not None:
            from cable_twin.offline.line_plot import write_line_plot  # noqa: PLC0415 - matplotlib takes a second

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
        "--places", type=_places, default=PLACES, metavar="N", help=f"number of places, 2 to {MOST}; default: {PLACES}"
    )
    add_changes(result)
    result.add_argument(
        "--check",
        action="store_true",
        help="calculate the line a second time with elements half as long, and print how much each figure changes",
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


def _places(text: str) -> int:
    if not text.isascii() or not text.isdigit() or not 2 <= int(text) <= MOST:
        raise argparse.ArgumentTypeError(f"{text!r} given, allowed: a whole number from 2 to {MOST}")
    return int(text)


def _write(path: str, line: Line, write: Callable[[TextIO, Line], None]) -> None:
    if path == STDOUT:
        write(sys.stdout, line)
        return
    with open(path, "w", encoding="utf-8", newline="") as file:
        write(file, line)


def _rows(line: Line) -> tuple[list[str], list[list[float | None]]]:
    """Column names with units, and a row of numbers for each place; None for missing ones."""
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
    content: dict[str, Any] = {"scenario": line.scenario.name, "vehicle": line.moved, "envelope": envelope}
    if verdicts := judge(line.scenario, line.figures, at_rest=True):
        content["rules"] = [verdict_columns(one) for one in verdicts]
    json.dump({**content, "columns": names, "rows": rows}, file, indent=1)
    file.write("\n")


def plan_line(scenario: Scenario, count: int, vehicle: str | None) -> Line:
    """Choose the places of the vehicle.

    Args:
        scenario: scenario of the line.
        count: number of places, at least 2.
        vehicle: name of a vehicle; None for the first one that is not clamped, else all on a haul rope together.

    Raises:
        ValueError: there is no such vehicle; one line.
    """
    movable = [name for name, one in scenario.carriages.items() if one.joint != "clamped" and not one.clamped_to]
    hauled = [name for name, one in scenario.carriages.items() if one.clamped_to]
    pulling = next(iter(scenario.drives), "") if hauled else ""
    if scenario.carriers is not None and vehicle in (None, scenario.carriers.name):
        return Line(scenario, scenario.carriers.name, np.arange(count) * scenario.spacing / count)
    if pulling and (vehicle in (pulling, *hauled) or (vehicle is None and not movable)):
        return Line(scenario, pulling, np.linspace(*haul_travel(scenario, hauled, pulling), count))
    if vehicle is None and not movable:
        return Line(scenario, "", np.zeros(1))
    name = movable[0] if vehicle is None else vehicle
    if name not in movable:
        others = [
            pulling,
            *(hauled if pulling else ()),
            scenario.carriers.name if scenario.carriers is not None else "",
        ]
        allowed = ", ".join(filter(None, [*movable, *others]))
        raise ValueError(f"--vehicle: given {name!r}; allowed: {allowed or 'none, it has none'}")
    stroke = float(build_system(scenario).carriages.stop_stroke[list(scenario.vehicles).index(name)])
    return Line(scenario, name, np.linspace(stroke, scenario.cable.unstrained_length - stroke, count))


def calculate(
    line: Line,
    on_place: Callable[[], object] = lambda: None,
    find: Find = from_scratch,
) -> None:
    """Find the equilibrium at all places, and collect the results.

    Args:
        line: planned line, which gets the results.
        on_place: called after each place.
        find: simulation at the rest of a scenario, with the vehicle at a place (m).

    Raises:
        EquilibriumError: no equilibrium at a place; the line names it.
    """
    envelope, found = KeyFigures(line.scenario), []
    for place in line.places.tolist():
        simulation = at_place(line, place, find)
        here = simulation.snapshot
        if line.scenario.terrain:
            line.lowest.append(simulation.clearance().vehicles)
        # place in the column of the time, which a static line does not have
        numbers = here.numbers.copy()
        numbers[0] = place
        envelope.update(Snapshot(here.layout, numbers, here.solver))
        alone = KeyFigures(line.scenario)
        alone.update(here)
        values = {f"{one.name} [{one.unit}]": one.value for one in _static(alone.figures())}
        line.columns.append(here.columns)
        found.append(values)
        on_place()
    names = dict.fromkeys(name for values in found for name in values)
    line.rows = {name: np.array([values.get(name, np.nan) for values in found]) for name in names}
    line.figures = [*(replace(one, band="") for one in _static(envelope.figures())), *_loads(line)]


def at_place(line: Line, place: float, find: Find = from_scratch) -> Simulation:
    """Simulation of the line in equilibrium with its vehicle at a place, found by `find`."""
    scenario, moved = line.scenario, line.moved
    carriers = scenario.carriers
    changes: dict[str, float | None] = {f"carriages.{moved}.arc_length": place} if moved else {}
    if moved in scenario.drives:
        changes = _hauled_to(scenario, place)
    if carriers is not None and moved == carriers.name:
        first = 0.5 * scenario.spacing if carriers.first is None else carriers.first
        changes = {"carriers.first": (first + place) % scenario.spacing}
    try:
        return find(load_scenario(scenario.resolved(), changes) if changes else scenario, place)
    except EquilibriumError as error:
        raise EquilibriumError(f"{moved} at {place:.1f} m: {error}") from None


def haul_travel(scenario: Scenario, hauled: list[str], drive: str) -> tuple[float, float]:
    """Least and greatest travel (m) of the haul rope: the travel of its drive, else up to the end stops."""
    if (travel := scenario.drives[drive].travel) is not None:
        return travel
    ranges = [travel_between_stops(scenario, name) for name in hauled]
    return max(one.low for one in ranges), min(one.high for one in ranges)


def _hauled_to(scenario: Scenario, passed: float) -> dict[str, float | None]:
    """Scenario changes for vehicles on haul ropes after a travel (m) of the haul ropes."""
    # the travel of a drive is counted from the start
    changes: dict[str, float | None] = {f"drives.{name}.travel": None for name in scenario.drives}
    for name, one in scenario.carriages.items():
        changes |= {f"carriages.{name}.clamped_to.{rope}": place + passed for rope, place in one.clamped_to.items()}
        if one.clamped_to:
            changes[f"carriages.{name}.arc_length"] = one.arc_length + sense_of(scenario, name) * passed
    return changes


def _static(figures: list[KeyFigure]) -> list[KeyFigure]:
    """Key figures with a meaning at rest; tower margins only of towers without contact."""
    found = []
    for one in figures:
        quantity = one.id.quantity
        if quantity == "deropement_margin":  # at rest 1, or 0 where the rope does not touch
            found += [replace(one, place="does not touch")] if one.value == 0.0 else []
        elif quantity not in MOVING:
            found.append(one)
    return found


def _loads(line: Line) -> list[KeyFigure]:
    """Add the rows of load components of all supports; returns the figures of their largest and least values."""
    found, forces = [], np.array([-one.support_force for one in line.columns])  # of the cable on its supports
    for row, subject in enumerate(supports_of(line.scenario)):
        for quantity, values in (("load_along_track", forces[:, row, 0]), ("load_downwards", -forces[:, row, 2])):
            line.rows[f"{subject.name}: {QUANTITIES[quantity].name} [{QUANTITIES[quantity].unit}]"] = values
            for statistic, at in (("highest", int(np.argmax(values))), ("lowest", int(np.argmin(values)))):
                found.append(figure(quantity, subject, statistic, float(values[at]), float(line.places[at])))
    return found


if __name__ == "__main__":
    sys.exit(main())
