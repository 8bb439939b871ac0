"""Key figures from Python: of a commanded run, and of a static line with its vehicles at many places.

.venv/bin/python examples/key_figures.py [SCENARIO] [DRIVE]
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence

from cable_twin import Simulation, load_scenario
from cable_twin.basics.units import with_unit
from cable_twin.key_figures import KeyFigure, KeyFigures
from cable_twin.offline.lines.at_rest import Line, calculate, plan_line
from cable_twin.scenario import ScenarioError, command_limits

HIGHEST = "rope tension, highest [N]"  # row of a line; of several ropes with the name of the rope before it


def run(name: str, target: str, speed: float, until: float) -> list[KeyFigure]:
    """Drive `target` at a speed (m/s) for half of the time `until` (s), stop it, and return the key figures."""
    scenario = load_scenario(name)
    simulation, figures = Simulation(scenario), KeyFigures(scenario)
    figures.update(simulation.snapshot)
    figures.command(simulation.command(target, speed=speed))
    for frame in range(
        1, round(100.0 * until) + 1
    ):  # frames of 0.01 s, of which the highest and lowest values are taken
        if frame == round(50.0 * until):
            figures.command(simulation.command(target, speed=0.0))
        figures.update(simulation.advance_to(0.01 * frame))
    return figures.figures()


def at_rest(name: str, places: int) -> Line:
    """Calculate the static line with its vehicles at a number of places."""
    line = plan_line(load_scenario(name), places, None)
    calculate(line)
    return line


def main(argv: Sequence[str] | None = None) -> None:
    """Print the limited key figures of a run, and the highest tension of each rope at each place of a line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("scenario", nargs="?", default="aerial_tramway", help="name or file; default: aerial_tramway")
    parser.add_argument("drive", nargs="?", help="carriage or drive; default: the first one of the scenario")
    options = parser.parse_args(argv)
    try:
        drives = [*command_limits(load_scenario(options.scenario))]
    except ScenarioError as error:
        parser.error(str(error))
    if options.drive not in (None, *drives):
        parser.error(f"drive: given {options.drive}; allowed: {', '.join(drives) or 'none in this scenario'}")
    if not drives:
        parser.error(f"{options.scenario}: given a scenario without a drive; allowed: one with a drive")
    for figure in run(options.scenario, options.drive or drives[0], 2.0, 8.0):
        if figure.limit is not None:
            verdict = "kept" if figure.kept else "NOT KEPT"
            value, limit = (with_unit(number, figure.unit) for number in (figure.value, figure.limit))
            print(f"{figure.name}: {value}, {figure.bound} {limit}: {verdict}")
    line = at_rest(options.scenario, 5)
    for number, place in enumerate(line.places):
        tensions = [f"{key.removesuffix(HIGHEST)}{1e-3 * row[number]:.1f} kN" for key, row in line.rows.items()
                    if key.endswith(HIGHEST)]  # fmt: skip
        print(f"{line.moved} at {place:.1f} m: {', '.join(tensions)}")


if __name__ == "__main__":
    main()
