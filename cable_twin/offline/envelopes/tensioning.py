"""Tensioning devices of a load case: free, stuck, or held at a travel or at a limit of their travel."""

from __future__ import annotations

from collections.abc import Mapping
from math import inf
from typing import Any

import numpy as np

from cable_twin.frame.snapshot import Columns
from cable_twin.key_figures import supports_of
from cable_twin.offline.lines.at_rest import Find
from cable_twin.scenario import Scenario, load_scenario
from cable_twin.scenario.checks.fault import show
from cable_twin.simulation import Simulation

STOPS = "stops"  # state of devices that are free between the limits of their travel
STATES = {
    STOPS: "free within the travel, and held at a limit where the rope would take it beyond",
    "stuck": "held at a travel of 0 m, where the file of the scenario has it, as after a failure",
    "least_travel": "held at the least travel, whatever the rope pulls there",
    "most_travel": "held at the most travel, likewise",
}
ALLOWED = f"{', '.join(STATES)}, or a travel in m"
OF_END = ("mass", "force", "travel", "direction", "buffer_stiffness")  # keys of a counterweight at the end of a rope
FAR = 1e4  # m, of a travel without limits


class TensioningError(ValueError):
    """Error in the entry `tensioning` of a load case; the message is one line."""


def tensioning(scenario: Scenario, given: Any) -> dict[str, Any]:
    """Scenario changes, by dotted key, that hold all tensioning devices in a given state; none for the state `stops`.

    Args:
        scenario: scenario with counterweights or cylinders.
        given: one of `STATES`, or a travel in m.

    Raises:
        TensioningError: none of these is given, there is no device, or a device lacks the limit or range of travel.
    """
    known = given in STATES if isinstance(given, str) else isinstance(given, int | float) and given is not True
    if not known or given is False:
        raise TensioningError(f"tensioning: given {show(given)}; allowed: {ALLOWED}")
    devices = _devices(scenario)
    if not devices:
        raise TensioningError(f"tensioning: given {show(given)}; allowed: no such key, as nothing tensions a rope here")
    travels = {path: _travel(path, limits, given) for path, limits in devices.items()}
    return {} if given == STOPS else held(scenario, travels)


def held(scenario: Scenario, travels: Mapping[str, float]) -> dict[str, Any]:
    """Changes of a scenario, by dotted key, that hold tensioning devices at travels (m), given by their dotted keys.

    With a device held, the tension follows from length, temperature and load of the rope. The rope ends on its
    carriage are moved along the pull, and the device is taken away.
    """
    values: dict[str, Any] = {}
    for path, travel in travels.items():
        section, name, *_ = path.split(".")
        if section == "sheaves":
            sheave, values[path] = scenario.sheaves[name], None
            moved = {f"sheaves.{name}": sheave.position} if sheave.position is not None else {}
            for joined in sheave.joins:
                rope, _, end = joined.partition(".")
                moved[f"ropes.{joined}"] = scenario.ropes[rope].ends[end].position
            direction = sheave.tensioning.direction if sheave.tensioning is not None else ()
        else:
            end = _end(scenario, path)
            values |= {f"{path}.support": "pinned", **{f"{path}.{key}": None for key in OF_END if getattr(end, key)}}
            moved, direction = {path: end.position}, end.direction or ()
        if travel:
            way = np.array(scenario.vector(direction))
            way *= travel / np.linalg.norm(way)
            for key, place in moved.items():
                values[f"{key}.position"] = (np.array(scenario.vector(place)) + way).tolist()
    return values


def with_stops(find: Find) -> Find:
    """Equilibrium search that holds tensioning devices at the limits of their travel where ropes take them beyond.

    Args:
        find: simulation at the rest of a scenario, with the vehicle at a place (m).
    """

    def found(scenario: Scenario, place: float) -> Simulation:
        limits = {path: limit for path, limit in _devices(scenario).items() if limit is not None}
        free = load_scenario(scenario.resolved(), {f"{path}.travel": [-FAR, FAR] for path in limits})
        simulation = find(free, place)
        travels = _travels(scenario, simulation.snapshot.columns)
        beyond = {
            path: min(max(travels[path], low), high)
            for path, (low, high) in limits.items()
            if not low <= travels[path] <= high
        }
        return find(load_scenario(scenario.resolved(), held(scenario, beyond)), place) if beyond else simulation

    return found


def _devices(scenario: Scenario) -> dict[str, tuple[float, float] | None]:
    """Limits of travel (m) of all tensioning devices that are not locked, by dotted key; None for no limits."""
    found: dict[str, tuple[float, float] | None] = {}
    for name, sheave in scenario.sheaves.items():
        if sheave.counterweight is not None:
            low, high = sheave.counterweight.travel
            found[f"sheaves.{name}.counterweight"] = low, high
        elif sheave.hydraulics is not None and not sheave.hydraulics.locked:
            low, high = sheave.hydraulics.travel
            found[f"sheaves.{name}.hydraulics"] = low, high
    for name, cable in scenario.cables.items():
        for key, end in cable.ends.items():
            if end.support == "counterweight":
                found[f"{scenario.rope_key(name)}.{key}"] = (
                    None if end.travel is None else (end.travel[0], end.travel[1])
                )
    return found


def _end(scenario: Scenario, path: str) -> Any:
    """End of a rope of a scenario by its dotted key."""
    *_, name, end = path.split(".")
    return (scenario.ropes[name] if scenario.ropes else scenario.cable).ends[end]


def _travels(scenario: Scenario, columns: Columns) -> dict[str, float]:
    """Travels (m) of all tensioning devices in a frame at rest, by dotted key."""
    wheels, supports, found = list(scenario.sheaves), [one.key for one in supports_of(scenario)], {}
    for path in _devices(scenario):
        *_, name, last = path.split(".")
        on_rope = f"ropes.{name}.{last}" in supports
        row = supports.index(f"ropes.{name}.{last}") if on_rope else wheels.index(name)
        found[path] = float((columns.support_travel if on_rope else columns.sheave_travel)[row])
    return found


def _travel(path: str, limits: tuple[float, float] | None, given: float | str) -> float:
    """Travel (m) at which a tensioning device is held for a given state or travel."""
    if given in ("stuck", STOPS):
        return 0.0
    if isinstance(given, str):
        if limits is None:
            raise TensioningError(
                f"tensioning: given {given!r}: {path}.travel is not given; allowed: stuck, or a travel in m"
            )
        return limits[0 if given == "least_travel" else 1]
    low, high = limits or (-inf, inf)
    if not low <= given <= high:  # of NaN, too
        raise TensioningError(f"tensioning: given {given:g} m; allowed: {low:g} to {high:g} m, by {path}.travel")
    return float(given)
