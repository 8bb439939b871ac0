"""Static line calculation: equilibrium of a line with its vehicle at many places, and the envelope of all results."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from cable_twin.frame.records import FloatArray, Place
from cable_twin.frame.snapshot import Columns, Snapshot
from cable_twin.key_figures import QUANTITIES, KeyFigure, KeyFigures, figure, supports_of
from cable_twin.offline.lines.passings import Passings
from cable_twin.scenario import Scenario, load_scenario
from cable_twin.scenario.command_limits import places_of, sense_of, travel_between_stops
from cable_twin.simulation import EquilibriumError, Simulation
from cable_twin.simulation.vehicle_contacts import places_between

MOST = 2000  # places of a vehicle
# quantities of motion, absent from a static line
MOVING = ("drive_force", "drive_power", "drive_speed", "speed", "acceleration", "dynamic_amplification")


@dataclass(slots=True)
class Line:
    """Static line calculation: results at each place of the vehicle, and their envelope.

    Attributes:
        scenario: scenario of the line.
        moved: name of the moved vehicle, of the carriers of a moving cable, or of the drive of a haul rope.
        places: (n,) m, arc length of the vehicle; of carriers and a haul rope, travel of the cable; rising.
        columns: columns of a frame at each place.
        lowest: least heights (m) of the vehicles over the terrain, with x (m) of each, at each place.
        rows: (n,) values by name and unit, at each place.
        figures: envelope of key figures; the `time` of a figure is the place of the vehicle (m).
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
    """Simulation of a scenario at rest, its equilibrium found without another equilibrium as initial guess."""
    return Simulation(scenario, on_demand=True)


def plan_line(scenario: Scenario, count: int, vehicle: str | None) -> Line:
    """Choose the vehicle of a static line calculation and its places.

    Args:
        scenario: scenario of the line.
        count: number of places, at least 2.
        vehicle: name of a vehicle; None for the first one that is not clamped, else all on a haul rope together.

    Raises:
        ValueError: the scenario has no such vehicle; one line.
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
        raise ValueError(f"--vehicle: given {name!r}; allowed: {allowed or 'none, the scenario has none'}")
    between, track = places_between(scenario, name), places_of(scenario, name)  # it cannot pass others on its rope
    return Line(scenario, name, np.linspace(max(between[0], track[0]), min(between[1], track[1]), count))


def calculate(
    line: Line,
    on_place: Callable[[], object] = lambda: None,
    find: Find = from_scratch,
    *,
    rows: bool = True,
) -> None:
    """Find the equilibrium of a line at all places of its vehicle, and collect the results in the line.

    Places at which vehicles pass masts or each other in space are added to those of the line.

    Args:
        line: planned line, which gets the results.
        on_place: called after each place.
        find: simulation at the rest of a scenario, with the vehicle at a place (m).
        rows: whether the values and lowest heights at each place are wanted, beside the figures of all places.

    Raises:
        EquilibriumError: no equilibrium at a place, which the message names.
    """
    rests: dict[float, Snapshot] = {}
    lowest: dict[float, Mapping[str, Place]] = {}

    def at(place: float) -> Columns:
        if place not in rests:
            simulation = at_place(line, place, find)
            rests[place] = simulation.snapshot
            if rows and line.scenario.terrain:
                lowest[place] = simulation.clearance().vehicles
            on_place()
        return rests[place].columns

    for place in line.places.tolist():
        at(place)
    if line.places.size > 1:
        Passings(line.scenario).search(at, line.places, _again(line))
    line.places = np.array(sorted(rests))
    line.lowest = [lowest[place] for place in sorted(lowest)]
    envelope, found = KeyFigures(line.scenario), []
    for place, here in sorted(rests.items()):
        # place in the column of the time, which a static line does not have
        numbers = here.numbers.copy()
        numbers[0] = place
        envelope.update(Snapshot(here.layout, numbers, here.solver))
        line.columns.append(here.columns)
        if rows:
            alone = KeyFigures(line.scenario)
            alone.update(here)
            found.append({f"{one.name} [{one.unit}]": one.value for one in _static(alone.figures())})
    names = dict.fromkeys(name for values in found for name in values)
    line.rows = {name: np.array([values.get(name, np.nan) for values in found]) for name in names}
    static = [replace(one, band="") if one.band else one for one in _static(envelope.figures())]
    line.figures = [*static, *_loads(line)]


def _again(line: Line) -> float | None:
    """Place (m) at which each carrier of a line is where the next one was at the first place; None without carriers."""
    carriers = line.scenario.carriers
    return line.scenario.spacing if carriers is not None and line.moved == carriers.name else None


def at_place(line: Line, place: float, find: Find = from_scratch) -> Simulation:
    """Simulation of a line in equilibrium with its vehicle at a place (m), by the equilibrium search `find`."""
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
    """Least and greatest travel (m) of a haul rope: from its drive's limits, else up to the vehicles' end stops."""
    if (travel := scenario.drives[drive].travel) is not None:
        return travel
    ranges = [travel_between_stops(scenario, name) for name in hauled]
    return max(one.low for one in ranges), min(one.high for one in ranges)


def _hauled_to(scenario: Scenario, passed: float) -> dict[str, float | None]:
    """Scenario changes, by key, that move all vehicles along with their haul ropes by the travel `passed` (m)."""
    # the travel of a drive is counted from the start
    changes: dict[str, float | None] = {f"drives.{name}.travel": None for name in scenario.drives}
    for name, one in scenario.carriages.items():
        changes |= {f"carriages.{name}.clamped_to.{rope}": place + passed for rope, place in one.clamped_to.items()}
        if one.clamped_to:
            changes[f"carriages.{name}.arc_length"] = one.arc_length + sense_of(scenario, name) * passed
    return changes


def _static(figures: list[KeyFigure]) -> list[KeyFigure]:
    """Keep key figures with a meaning at rest; of tower margins only those of towers without contact."""
    found = []
    for one in figures:
        quantity = one.id.quantity
        if quantity == "deropement_margin":  # at rest 1, or 0 where the rope does not touch
            found += [replace(one, place="does not touch")] if one.value == 0.0 else []
        elif quantity not in MOVING:
            found.append(one)
    return found


def _loads(line: Line) -> list[KeyFigure]:
    """Add the load components of all supports to the rows of a line; returns key figures of their extremes.

    The one across the track, in space, is in the rows alone.
    """
    found, forces = [], np.array([-one.support_force for one in line.columns])  # of the cable on its supports
    places, loads = line.places.tolist(), {"load_along_track": forces[:, :, 0], "load_downwards": -forces[:, :, 2]}
    extremes = {
        quantity: (("highest", values.argmax(axis=0).tolist()), ("lowest", values.argmin(axis=0).tolist()))
        for quantity, values in loads.items()
    }
    for row, subject in enumerate(supports_of(line.scenario)):
        for quantity, values in loads.items():
            line.rows[f"{subject.name}: {QUANTITIES[quantity].name} [{QUANTITIES[quantity].unit}]"] = values[:, row]
            for statistic, rows in extremes[quantity]:
                at = rows[row]
                found.append(figure(quantity, subject, statistic, float(values[at, row]), places[at]))
        if line.scenario.dim == 3:
            line.rows[f"{subject.name}: load to the left [N]"] = forces[:, row, 1]
    return found
