"""Static line calculation with the vehicle at one place after the other, and the envelope of the results."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from cable_twin.frame.records import FloatArray, Place
from cable_twin.frame.snapshot import Columns, Snapshot
from cable_twin.key_figures import QUANTITIES, KeyFigure, KeyFigures, figure, supports_of
from cable_twin.scenario import Scenario, build_system, load_scenario
from cable_twin.scenario.command_limits import sense_of, travel_between_stops
from cable_twin.simulation import EquilibriumError, Simulation

# quantities of a motion, of which there is none
MOVING = ("drive_force", "drive_power", "speed", "acceleration", "dynamic_amplification")


@dataclass(slots=True)
class Line:
    """Static line calculation, with a row for each place.

    Attributes:
        scenario: what was calculated.
        moved: the vehicle that was moved, or the carriers of a moving cable, or the drive of a haul rope.
        places: (n,) m, arc length of the vehicle; of carriers and a haul rope, how far the cable has gone by.
        columns: what a frame shows, at each place.
        lowest: least heights (m) of all that is on the rope over the terrain, with x (m) of each, at each place.
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


def plan_line(scenario: Scenario, count: int, vehicle: str | None) -> Line:
    """Choose the places of the vehicle.

    Args:
        scenario: whose line it is.
        count: of places, at least 2.
        vehicle: its name; the first one that is not clamped where None, else what a haul rope pulls, all together.

    Raises:
        ValueError: there is no such vehicle; one line.
    """
    movable = [name for name, one in scenario.carriages.items() if one.joint != "clamped" and not one.clamped_to]
    hauled = [name for name, one in scenario.carriages.items() if one.clamped_to]
    pulling = next(iter(scenario.drives), "") if hauled else ""
    if scenario.carriers is not None and vehicle in (None, scenario.carriers.name):
        return Line(scenario, scenario.carriers.name, np.arange(count) * scenario.spacing / count)
    if pulling and (vehicle in (pulling, *hauled) or (vehicle is None and not movable)):
        return Line(scenario, pulling, np.linspace(*_way(scenario, hauled, pulling), count))
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


def calculate(line: Line, on_place: Callable[[int], None]) -> None:
    """Find the equilibrium at all places, and collect the results.

    Args:
        line: takes the results.
        on_place: called with the number of those done.

    Raises:
        EquilibriumError: there is no rest at a place; the line names it.
    """
    envelope, found = KeyFigures(line.scenario), []
    for number, place in enumerate(line.places.tolist()):
        simulation = at_place(line, place)
        here = simulation.snapshot
        if line.scenario.terrain:
            line.lowest.append(simulation.clearance().vehicles)
        # the place stands for the time, of which there is none
        numbers = here.numbers.copy()
        numbers[0] = place
        envelope.update(Snapshot(here.layout, numbers, here.solver))
        alone = KeyFigures(line.scenario)
        alone.update(here)
        values = {f"{one.name} [{one.unit}]": one.value for one in _static(alone.figures())}
        line.columns.append(here.columns)
        found.append(values)
        on_place(number + 1)
    names = dict.fromkeys(name for values in found for name in values)
    line.rows = {name: np.array([values.get(name, np.nan) for values in found]) for name in names}
    line.figures = [*(replace(one, band="") for one in _static(envelope.figures())), *_loads(line)]


def at_place(line: Line, place: float) -> Simulation:
    """Simulation of the line in equilibrium with its vehicle at a place."""
    scenario, moved = line.scenario, line.moved
    carriers = scenario.carriers
    changes: dict[str, float | None] = {f"carriages.{moved}.arc_length": place} if moved else {}
    if moved in scenario.drives:
        changes = _hauled_to(scenario, place)
    if carriers is not None and moved == carriers.name:
        first = 0.5 * scenario.spacing if carriers.first is None else carriers.first
        changes = {"carriers.first": (first + place) % scenario.spacing}
    try:
        return Simulation(load_scenario(scenario.resolved(), changes))
    except EquilibriumError as error:
        raise EquilibriumError(f"{moved} at {place:.1f} m: {error}") from None


def _way(scenario: Scenario, hauled: list[str], drive: str) -> tuple[float, float]:
    """Least and greatest travel (m) of the haul rope: the travel of its drive, else up to the end stops."""
    if (travel := scenario.drives[drive].travel) is not None:
        return travel
    ways = [travel_between_stops(scenario, name) for name in hauled]
    return max(way.low for way in ways), min(way.high for way in ways)


def _hauled_to(scenario: Scenario, passed: float) -> dict[str, float | None]:
    """Scenario changes for vehicles on haul ropes after a travel (m) of these."""
    # that of a drive is from where they stand at the start
    changes: dict[str, float | None] = {f"drives.{name}.travel": None for name in scenario.drives}
    for name, one in scenario.carriages.items():
        changes |= {f"carriages.{name}.clamped_to.{rope}": place + passed for rope, place in one.clamped_to.items()}
        if one.clamped_to:
            changes[f"carriages.{name}.arc_length"] = one.arc_length + sense_of(scenario, name) * passed
    return changes


def _static(figures: list[KeyFigure]) -> list[KeyFigure]:
    """Key figures with a meaning at rest; of tower margins only those of towers without contact."""
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
