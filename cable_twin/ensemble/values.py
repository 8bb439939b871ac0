"""Values that differ between the members of an ensemble: of scenario keys, and numbers given for each."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cable_twin.basics.printable import printable
from cable_twin.mechanics.parameters import FloatArray
from cable_twin.scenario import full_key, load_scenario
from cable_twin.simulation import Simulation
from cable_twin.simulation.same_model import OtherModelError

Source = str | Path | Mapping[str, Any]
Values = Mapping[str, Any]  # by dotted key: one value for all members, or a sequence with one for each
ALLOWED = (
    "values that leave ropes, meshes, vehicles, supports and the solver as they are, such as masses, payloads, "
    "stiffnesses, damping, friction, drag, wind and ice"
)


def values_of(members: int, parameters: Values, kept: Sequence[int] | None = None) -> list[dict[str, Any]]:
    """Scenario values of each member of an ensemble, by dotted key.

    Args:
        members: number of members.
        parameters: by key, a sequence of one value for each member, or one value for all.
        kept: numbers of the members, for messages.

    Raises:
        ValueError: a sequence has another length than the ensemble; one line.
    """
    if not isinstance(parameters, Mapping):
        raise ValueError(f"parameters: given {printable(str(parameters))}; allowed: a mapping of dotted keys to values")
    found: list[dict[str, Any]] = [{} for _ in range(members)]
    for key, given in parameters.items():
        each = given.tolist() if isinstance(given, np.ndarray) else given
        if isinstance(each, list | tuple | range):
            if len(each) != members:
                raise ValueError(
                    f"parameters: {printable(key)}: given {len(each)} values; allowed: {members}, one for each member, "
                    "or one value for all; if a value is a list itself, [[...]] * members"
                )
        else:
            each = [each] * members
        for own, value in zip(found, each, strict=True):
            own[full_key(key)] = value
    return found


def numbers_of(members: int, name: str, given: Any) -> FloatArray:
    """Number (members,) of each of some members, from one for all or one for each.

    Args:
        members: number of these members.
        name: of what is given, in a message.
        given: number or numbers.

    Raises:
        ValueError: given are no numbers, or other than one or one for each; one line.
    """
    try:
        return np.broadcast_to(np.asarray(given, dtype=np.float64), (members,))
    except (TypeError, ValueError):
        shown = printable(" ".join(str(given).split()))
        raise ValueError(f"{name}: given {shown}; allowed: one number, or {members}, one for each member") from None


def with_values(base: Simulation, source: Source, values: Mapping[str, Any], *, rest: bool) -> Simulation:
    """Simulation with other values of a scenario, on the compiled system and memory of an existing one.

    Args:
        base: the simulation.
        source: its scenario, as `load_scenario` takes it.
        values: by dotted key.
        rest: begin at an own static equilibrium, else at that of the base.

    Raises:
        ScenarioError: a value is refused, as `load_scenario` does.
        ValueError: a value needs another mesh, other parts or another solver; one line with the key.
        EquilibriumError: there is no static equilibrium.
    """
    scenario = load_scenario(source, dict(values))
    try:
        return base.with_values(scenario, rest=rest)
    except OtherModelError as error:
        raise ValueError(_refusal(base, source, values, error)) from None


def put_in(simulation: Simulation, keys: Collection[str], before: FloatArray) -> None:
    """Put payloads, wind and temperature of the scenario into the present state, where given keys name them.

    Payloads of carriers, which change in stations, are put in where they are still those of the start. Loading that is
    under way ends for a vehicle whose payload is put in.

    Args:
        simulation: the simulation.
        keys: dotted keys of its scenario.
        before: (vehicles,) kg, payloads at the start that the state comes from.
    """
    scenario, vehicles = simulation.scenario, simulation.engine.vehicles
    named = {name for name in scenario.carriages if _name(keys, f"carriages.{name}.payload.mass")}
    each = zip(scenario.vehicles, simulation.state.payload, before, vehicles.first_loads, strict=True)
    loads = {name: float(own) for name, now, first, own in each if name in named or now == first != own}
    vehicles.put_in(loads)
    for name in loads:
        vehicles.loading.pop(name, None)
    if _name(keys, "air.wind"):
        along, *across, up = scenario.air.wind
        simulation.wind(along, up, *across)
    if _name(keys, "air.temperature"):
        simulation.temperature(scenario.air.temperature)


def _name(keys: Collection[str], key: str) -> bool:
    """Whether any of several dotted keys is this one, or one of a part of it, or one that it is a part of."""
    return any(f"{one}.".startswith(f"{key}.") or f"{key}.".startswith(f"{one}.") for one in keys)


def _refusal(base: Simulation, source: Source, values: Mapping[str, Any], error: OtherModelError) -> str:
    """Message about a value that members of one ensemble cannot have, with the key of the first such value."""
    for key, value in values.items():
        if needed := _needed(base, source, key, value):
            return f"{printable(key)}: given {value!r}, which needs {needed}; allowed: {ALLOWED}"
    return f"{', '.join(map(printable, values))}: given values that together need {error}; allowed: {ALLOWED}"


def _needed(base: Simulation, source: Source, key: str, value: Any) -> str:
    """Change that a value needs beyond those allowed within one ensemble, in words; empty for none."""
    try:
        base.with_values(load_scenario(source, {key: value}), rest=False)
    except OtherModelError as error:
        return str(error)
    except ValueError:  # of the value without the others
        return ""
    return ""
