"""A line at rest with its vehicle at one place after the other, and the envelope of what is there."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from cable_twin.key_figures import KeyFigure, KeyFigures
from cable_twin.records import FloatArray
from cable_twin.scenario import Scenario, build_system, load_scenario
from cable_twin.simulation import EquilibriumError, Simulation
from cable_twin.snapshot import Columns, Snapshot

MOVING = (  # figures of a motion, of which there is none
    "drive force",
    "drive power, highest",
    "drive power, lowest",
    "speed",
    "vehicle acceleration",
    "dynamic amplification, tension over that at the start",
    "deropement margin, load over that at rest",
)


@dataclass(slots=True)
class Line:
    """A static calculation, a row a place.

    Attributes:
        scenario: what was calculated.
        moved: the vehicle that was moved, or the carriers of a moving cable.
        places: (n,) m, arc length of the vehicle; of carriers, how far the cable has gone by.
        columns: what a frame shows, at each place.
        rows: (n,) values by name and unit, at each place.
        figures: the envelope; the time of a figure is the place of the vehicle (m).
    """

    scenario: Scenario
    moved: str
    places: FloatArray
    columns: list[Columns] = field(default_factory=list)
    rows: dict[str, FloatArray] = field(default_factory=dict)
    figures: list[KeyFigure] = field(default_factory=list)


def plan_line(scenario: Scenario, count: int, vehicle: str | None) -> Line:
    """Say where the vehicle is to be.

    Args:
        scenario: whose line it is.
        count: of places, at least 2.
        vehicle: its name; the first one that is not clamped where None.

    Raises:
        ValueError: there is no such vehicle; one line.
    """
    movable = [name for name, one in scenario.carriages.items() if one.joint != "clamped"]
    if scenario.carriers is not None and vehicle in (None, scenario.carriers.name):
        return Line(scenario, scenario.carriers.name, np.arange(count) * scenario.spacing / count)
    if vehicle is None and not movable:
        return Line(scenario, "", np.zeros(1))
    name = movable[0] if vehicle is None else vehicle
    if name not in movable:
        carriers = [scenario.carriers.name] if scenario.carriers is not None else []
        raise ValueError(
            f"--vehicle: given {name!r}; allowed: {', '.join([*movable, *carriers]) or 'none, it has none'}"
        )
    stroke = float(build_system(scenario).carriages.stop_stroke[list(scenario.vehicles).index(name)])
    return Line(scenario, name, np.linspace(stroke, scenario.cable.unstrained_length - stroke, count))


def calculate(line: Line, on_place: Callable[[int], None]) -> None:
    """Find the rest at all places, and gather what is there.

    Args:
        line: takes the results.
        on_place: called with the number of those done.

    Raises:
        EquilibriumError: there is no rest at a place; the line names it.
    """
    envelope, found = KeyFigures(line.scenario), []
    for number, place in enumerate(line.places.tolist()):
        here = at_place(line, place)
        # the place stands for the time, of which there is none
        numbers = here.numbers.copy()
        numbers[0] = place
        envelope.update(Snapshot(here.layout, numbers, here.solver))
        alone = KeyFigures(line.scenario)
        alone.update(here)
        values = {f"{one.name} [{one.unit}]": one.value for one in _static(alone.figures())}
        loads = -here.columns.support_force  # of the cable on what holds it
        for support, load in zip(here.layout.supports, loads, strict=True):
            values |= {f"{support}: load along the track [N]": load[0], f"{support}: load downwards [N]": -load[2]}
        line.columns.append(here.columns)
        found.append(values)
        on_place(number + 1)
    names = dict.fromkeys(name for values in found for name in values)
    line.rows = {name: np.array([values.get(name, np.nan) for values in found]) for name in names}
    line.figures = [*(replace(one, band="") for one in _static(envelope.figures())), *_vectors(line)]


def at_place(line: Line, place: float) -> Snapshot:
    """The line at rest with its vehicle there."""
    scenario, moved = line.scenario, line.moved
    carriers = scenario.carriers
    key, value = f"carriages.{moved}.arc_length", place
    if carriers is not None and moved == carriers.name:
        first = 0.5 * scenario.spacing if carriers.first is None else carriers.first
        key, value = "carriers.first", (first + place) % scenario.spacing
    try:
        return Simulation(load_scenario(scenario.resolved(), {key: value} if moved else {})).snapshot
    except EquilibriumError as error:
        raise EquilibriumError(f"{moved} at {place:.1f} m: {error}") from None


def _static(figures: list[KeyFigure]) -> list[KeyFigure]:
    """Those that mean something at rest."""
    return [one for one in figures if one.name.rpartition(": ")[2] not in MOVING]


def _vectors(line: Line) -> list[KeyFigure]:
    """Largest and least of each component of the loads on supports."""
    found = []
    for key, values in line.rows.items():
        name, _, unit = key.removesuffix("]").rpartition(" [")
        if name.endswith(("load along the track", "load downwards")):
            for word, at in (("highest", int(np.argmax(values))), ("lowest", int(np.argmin(values)))):
                found.append(KeyFigure(f"{name}, {word}", float(values[at]), unit, float(line.places[at])))
    return found


__all__ = ["Line", "calculate", "plan_line"]
