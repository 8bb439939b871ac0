"""Key figures from Python: of a commanded run, and of a static line with its vehicle at many places.

.venv/bin/python examples/key_figures.py [SCENARIO]
"""

from __future__ import annotations

import sys

from cable_twin import Simulation, load_scenario
from cable_twin.basics.units import with_unit
from cable_twin.key_figures import KeyFigure, KeyFigures
from cable_twin.offline.lines.at_rest import Line, calculate, plan_line


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
    """Calculate the static line with its vehicle at a number of places."""
    line = plan_line(load_scenario(name), places, None)
    calculate(line)
    return line


def main(name: str = "aerial_tramway", target: str = "cabin") -> None:
    """Print the limited key figures of a run, and the highest tension at each place of a line."""
    for figure in run(name, target, 2.0, 8.0):
        if figure.limit is not None:
            verdict = "kept" if figure.kept else "NOT KEPT"
            value, limit = (with_unit(number, figure.unit) for number in (figure.value, figure.limit))
            print(f"{figure.name}: {value}, {figure.bound} {limit}: {verdict}")
    line = at_rest(name, 5)
    for place, tension in zip(line.places, line.rows["rope tension, highest [N]"], strict=True):
        print(f"{line.moved} at {place:.1f} m: {1e-3 * tension:.1f} kN")


if __name__ == "__main__":
    main(*sys.argv[1:])
