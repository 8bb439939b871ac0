"""Command `design`: tension, unstrained length, rope or tower heights of a line, written as a new scenario."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cable_twin.basics.units import rounded
from cable_twin.frame.records import FloatArray
from cable_twin.offline.import_profile import tell_rest
from cable_twin.offline.lines.at_rest import Line, plan_line
from cable_twin.offline.survey.designing import (
    Designed,
    design_length,
    design_rope,
    design_sag,
    design_tension,
    design_towers,
)
from cable_twin.offline.survey.line_model import DesignError, LineModel, line_model
from cable_twin.offline.survey.marked import rewritten, write_scenario
from cable_twin.scenario import ScenarioError, load_scenario, scenario_file, scenario_lines
from cable_twin.scenario.command_limits import sense_of
from cable_twin.scenario.spans import SpanError
from cable_twin.terminal.command_line import OneLineParser, fail, number, tell

DONE, FAILED, UNUSABLE = 0, 1, 2
PLACES = 4  # of the vehicle, at which the result is calculated; of a pinned track rope also the middle of each span
WANTED = ("length", "tension", "rope", "towers")
EPILOG = """\
One of these follows from all else, for both strands of a lift with a counterweight, one track rope with a cabin, or
the equal track ropes of a jig-back, which stay equal (its haul rope stays as it is):

  length    unstrained length, and the counterweight, for --tension or --sag
  tension   counterweight for the highest tension that the safety factor of the rope and the least loads of towers
            allow, or else that holds the rope on most towers
  rope      thinnest rope of the same construction with the safety factor, in whole millimetres
  towers    heights of the rope on the towers that keep least loads and clearance, changed as little as possible; a
            counterweight along the rope turns with it

They are found in closed form, with elastic catenaries over frictionless towers and the vehicles of a lift as even
weight, by bounded search; each is told with what decided it, and has a comment in the new file, which else is as the
old one. The new scenario is brought to rest, and its figures with limits are printed.

exit codes: 0 done, 1 there is none within the bounds, or the line has no equilibrium, 2 wrong scenario or option

examples:
  design chairlift --for tension --output designed.yaml
  design aerial_tramway --for length --sag 1:4.5 --output designed.yaml
  design chairlift --for rope --factor 6 --output designed.yaml
  design gondola --for towers --raise 8 --output designed.yaml
  design jig_back --for rope --factor 3.5 --output designed.yaml
"""


def parser() -> OneLineParser:
    """Parser of the options of `design`."""
    result = OneLineParser("design", "Design a part of a line.", EPILOG, failure=UNUSABLE)
    result.add_scenario("name of a shipped scenario, or path of a YAML file", scenario_lines)
    result.add_argument("--for", dest="wanted", choices=WANTED, required=True, help="what is designed")
    result.add_argument(
        "--output", type=Path, default=Path("designed.yaml"), metavar="FILE", help="scenario; default: designed.yaml"
    )
    result.add_argument(
        "--tension",
        type=number(0.0, math.inf, "N"),
        metavar="N",
        help="N, wanted in the rope at its tensioned end, for length",
    )
    result.add_argument(
        "--sag",
        type=_sag,
        metavar="SPAN:M",
        help="m, wanted below the chord of a span, numbered from 1 along the first rope, for length",
    )
    result.add_argument(
        "--factor",
        type=number(0.0, math.inf),
        metavar="F",
        help="safety factor of the rope; default: that of the scenario's limits",
    )
    for name, default in (("lower", 3.0), ("raise", 10.0)):
        result.add_argument(
            f"--{name}",
            dest=f"to_{name}",
            type=number(0.0, math.inf, "m"),
            default=default,
            metavar="M",
            help=f"m, most by which a tower is {name}ed; default: {default:g}".replace("raiseed", "raised"),
        )
    return result


def _sag(text: str) -> tuple[int, float]:
    span, _, sag = text.partition(":")
    if not span.isdecimal() or not sag:
        raise argparse.ArgumentTypeError(f"given {text!r}; allowed: SPAN:M as in 2:4.5")
    return int(span), number(0.0, math.inf, "m")(sag)


def main(argv: Sequence[str] | None = None) -> int:
    """Design a part of a line, write and report it; returns the exit code that the help lists."""
    arguments = parser()
    options = arguments.parse_args(sys.argv[1:] if argv is None else list(argv))
    source = arguments.given_scenario(options)
    if source is None:
        arguments.error("SCENARIO is needed")
    if options.wanted == "length" and (options.tension is None) == (options.sag is None):
        arguments.error("--for length: one of --tension and --sag is needed")
    try:
        model = line_model(load_scenario(source))
        found = _designed(model, options)
    except ScenarioError as error:
        return fail("design", error, UNUSABLE)
    except (DesignError, SpanError) as error:
        return fail("design", error, FAILED)
    for text in found.lines:
        print(text)
    heading = f"Designed for {options.wanted} from {source}: `design:` beside a value says what decided it."
    try:
        text = scenario_file(source).read_text(encoding="utf-8")
        kept = write_scenario(options.output, rewritten(text, found.changes, heading))
        scenario = load_scenario(str(options.output))
    except OSError as error:
        return fail("design", f"{error.filename or options.output}: {error.strerror or error}", FAILED)
    except ScenarioError as error:
        return fail("design", error, FAILED)
    if kept:
        tell("design", f"the former {options.output} is {kept} now")
    print(f"{options.output} at rest:")
    line = plan_line(scenario, PLACES, None)
    if model.cabin and not model.mass_keys:
        line.places = np.union1d(line.places, _middles(line))
    code = tell_rest("design", line)
    if options.factor is not None and (told := _wanted(line, model, options.factor)):
        print(told)
    return code


def _middles(line: Line) -> FloatArray:
    """Places (n,) in m of a line at which a cabin is in the middle of a span, where a pinned rope is tautest."""
    scenario = line.scenario
    model = line_model(scenario)
    bare = model.spans(model.tension(), 2).length
    middles = np.cumsum(bare) - 0.5 * bare
    if line.moved in scenario.carriages:
        return middles
    ways = [sense_of(scenario, name) * (middles - one.arc_length) for name, one in scenario.carriages.items()]
    found = np.concatenate(ways)
    return found[(found > line.places[0]) & (found < line.places[-1])]


def _wanted(line: Line, model: LineModel, factor: float) -> str:
    """Line with the safety factor that was wanted, and the least of the designed ropes at rest; empty without one."""
    designed = [f"ropes.{key.rpartition('.')[2]}" for key in model.rope_keys]
    found = [one for one in line.figures if one.id.quantity == "rope_safety_factor" and one.id.subject in designed]
    if not found:
        return ""
    least = min(found, key=lambda one: one.value).limited(factor, "--factor")
    return (
        f"rope safety factor {rounded(least.value)}, wanted by --factor at least {rounded(factor)}: {least.verdict}; "
        "the table has the limits of the scenario"
    )


def _designed(model: LineModel, options: Any) -> Designed:
    if options.wanted == "tension":
        return design_tension(model, options.factor)
    if options.wanted == "rope":
        return design_rope(model, options.factor)
    if options.wanted == "towers":
        return design_towers(model, options.to_lower, options.to_raise)
    if options.sag is not None:
        return design_sag(model, *options.sag)
    return design_length(model, options.tension, "the option")


if __name__ == "__main__":
    sys.exit(main())
