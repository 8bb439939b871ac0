"""Command `import_profile`: a runnable scenario from surveyed terrain and towers, with all assumptions marked."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from cable_twin.offline.figure_table import print_figures, table_console
from cable_twin.offline.lines.at_rest import Line, calculate
from cable_twin.offline.simulate_options import add_changes
from cable_twin.offline.survey.geodata import SUFFIXES, is_geodata, read_geodata
from cable_twin.offline.survey.jig_back import jig_back_scenario
from cable_twin.offline.survey.lift import CHAIRLIFT, GONDOLA, lift_scenario
from cable_twin.offline.survey.marked import as_file, assumptions, missed, plain, with_changes, write_scenario
from cable_twin.offline.survey.profile import FEET, Survey, SurveyError
from cable_twin.offline.survey.stations import Ends, ends_of
from cable_twin.offline.survey.tables import read_survey
from cable_twin.offline.survey.tramway import tramway_scenario
from cable_twin.scenario import ScenarioError, load_scenario
from cable_twin.simulation import EquilibriumError
from cable_twin.terminal.bars import start_shown
from cable_twin.terminal.command_line import OneLineParser, fail, number, tell

DONE, FAILED, UNUSABLE = 0, 1, 2
Build = Callable[[Survey, Ends, Mapping[str, Any]], dict[str, Any]]
KINDS: dict[str, Build] = {
    "fixed_grip_chairlift": lambda survey, ends, changes: lift_scenario(survey, ends, CHAIRLIFT, changes),
    "jig_back": jig_back_scenario,
    "aerial_tramway": tramway_scenario,
    "detachable_gondola": lambda survey, ends, changes: lift_scenario(survey, ends, GONDOLA, changes),
}
EPILOG = """\
TERRAIN has columns x and z, TOWERS has x and the height of the rope, z_rope or rope_above_ground; name, contacts,
length, radius and hold_down where the survey has them. Rows named start and end are the stations. Lengths are metres,
or in the unit of the header, as in x [ft]. GPX, GeoJSON and GeoPackage have a line of the ground with heights, and
points of towers with these as attributes, or as KEY=VALUE in the description of a waypoint; they need the extra
survey. Ropes, vehicles, drives and what else the survey does not say are assumed:
each has a comment in the file, and is listed. The scenario is brought to rest once, unless --no-rest is given.

exit codes: 0 done, 1 the line has no equilibrium (the file is written) or cannot be written, 2 wrong survey or option

examples:
  import_profile examples/survey/line.geojson --output my_lift.yaml
  import_profile examples/survey/terrain.csv examples/survey/towers.csv \\
                 --type fixed_grip_chairlift --output my_lift.yaml
  import_profile examples/survey/terrain.csv examples/survey/towers.csv \\
                 --start 0,0 --end 950,240 --set carriers.count=60
"""


def parser() -> OneLineParser:
    """Parser of the options of `import_profile`."""
    result = OneLineParser(
        "import_profile", "Make a scenario of surveyed terrain and towers.", EPILOG, failure=UNUSABLE
    )
    result.add_argument("terrain", type=Path, metavar="TERRAIN", help="file of the ground under the line")
    result.add_argument(
        "towers", type=Path, nargs="?", metavar="TOWERS", help="file of the towers; default: that of the terrain"
    )
    result.add_argument(
        "--type",
        choices=KINDS,
        default="fixed_grip_chairlift",
        metavar="KIND",
        help=f"kind of ropeway: {', '.join(KINDS)}; default: fixed_grip_chairlift",
    )
    result.add_argument(
        "--output", type=Path, default=Path("surveyed.yaml"), metavar="FILE", help="scenario; default: surveyed.yaml"
    )
    for name in ("start", "end"):
        result.add_argument(
            f"--{name}", type=_place, metavar="X,Z", help=f"m, where the rope leaves the station at the {name}"
        )
    result.add_argument("--units", choices=FEET, help="unit of lengths where the file names none; default: m")
    result.add_argument(
        "--rope-above-ground",
        type=number(0.0, 200.0, "m"),
        metavar="M",
        help="m, assumed for towers whose rope has no height in the survey",
    )
    result.add_argument("--no-rest", action="store_true", help="do not look for the equilibrium")
    add_changes(result)
    return result


def _place(text: str) -> tuple[float, float]:
    try:
        x, z = map(float, text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"given {text!r}; allowed: X,Z in m, as in 0,4.5") from None
    if not math.isfinite(x + z):
        raise argparse.ArgumentTypeError(f"given {text!r}; allowed: two finite numbers in m")
    return x, z


def main(argv: Sequence[str] | None = None) -> int:
    """Make a scenario from a survey and report; returns the exit code that the help lists."""
    given = sys.argv[1:] if argv is None else list(argv)
    options = parser().parse_args(given)
    try:
        survey = _read(options)
        changes = dict(options.set)
        tree = KINDS[options.type](survey, ends_of(survey, options.start, options.end), changes)
        content = {"name": options.output.stem, **plain(tree)}
        scenario = load_scenario(content, changes, label=str(options.output))
    except (SurveyError, ScenarioError) as error:
        return fail("import_profile", error, UNUSABLE)
    for note in survey.notes:
        tell("import_profile", note)
    found, written = assumptions(tree), with_changes(tree, changes)
    files = [one for one in (options.terrain, options.towers) if one is not None]
    heading = [
        f"{options.type} from {' and '.join(one.name for one in files)}, made by import_profile.",
        "Values are of the survey, or have their origin beside them; what is assumed has to be looked at.",
    ]
    try:
        kept = write_scenario(options.output, as_file(written, heading))
    except OSError as error:
        return fail("import_profile", f"{error.filename or options.output}: {error.strerror or error}", FAILED)
    if kept:
        tell("import_profile", f"the former {options.output} is {kept} now")
    print(f"{options.output}: {scenario.description}")
    print(f"{len(found)} assumptions:")
    for line in found:
        print(f"  {line}")
    for line in missed(written):
        tell("import_profile", line)
    return DONE if options.no_rest else tell_rest("import_profile", Line(scenario, "", np.zeros(1)))


def _read(options: argparse.Namespace) -> Survey:
    """Read the survey from the files given by options, all geodata or all tables."""
    towers = options.towers or options.terrain
    kinds = {is_geodata(options.terrain), is_geodata(towers)}
    if len(kinds) == 2 or (options.towers is None and kinds == {False}):
        raise SurveyError(
            f"survey: given {options.terrain}, {towers}; allowed: two CSV files, or one or two of "
            f"{', '.join(SUFFIXES)} with one coordinate system"
        )
    read = read_geodata if kinds == {True} else read_survey
    return read(options.terrain, towers, options.units, options.rope_above_ground)


def tell_rest(command: str, line: Line) -> int:
    """Find the equilibrium of a new scenario's line, and print its key figures with limits; returns the exit code."""
    try:
        with start_shown(command, Console(stderr=True)):
            calculate(line)
    except EquilibriumError as error:
        return fail(command, error if line.moved else str(error).partition(" m: ")[2] or error, FAILED)
    shown = [one for one in line.figures if one.kept is not None]
    print_figures(table_console(), [shown], at=f"{line.moved} at" if line.moved else "at", unit_at="m")
    return DONE


if __name__ == "__main__":
    sys.exit(main())
