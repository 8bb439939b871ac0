"""Search for all errors in a scenario at once, each with key path, given and allowed value."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from math import isfinite, nan
from typing import Any, get_args, get_origin

from pydantic import BaseModel, ValidationError

from cable_twin.scenario.checks.air import wind_faults
from cable_twin.scenario.checks.couplings import coupling_faults
from cable_twin.scenario.checks.fault import (
    NOTHING,
    Fault,
    KeyPath,
    allowed,
    alternative,
    inner_model,
    listed,
    locate,
    name_faults,
    refuse,
    scalar,
    unknown_key,
)
from cable_twin.scenario.checks.limits import limit_faults
from cable_twin.scenario.checks.line import equilibrium_faults, line_faults
from cable_twin.scenario.checks.vehicles import carrier_faults, drive_faults, name_conflicts, vehicle_faults
from cable_twin.scenario.checks.wrong_units import overload_faults
from cable_twin.scenario.schema import Scenario

BY_JOINS = ("ropes", "towers", "carriers", "drives", "sheaves")  # which wrongly joined ends make wrong as well
LARGEST, SMALLEST = 1e15, 1e-30  # of a number in SI units, by size


def find_faults(data: dict[str, Any]) -> tuple[Scenario | None, list[Fault]]:
    """Validate plain data as a scenario; returns the scenario, or None if invalid, and all errors.

    Args:
        data: dicts with text keys, lists and scalars.

    Returns:
        The scenario, or None where it has faults, and the faults. Implausible combinations are found even where other
        values have faults.
    """
    found = {fault.path: fault for fault in _beyond_reason(data)}
    try:
        scenario = Scenario.model_validate(data)
    except ValidationError as error:
        faults = [_schema_fault(item["loc"], item["type"], data) for item in error.errors()]
        found |= {fault.path: fault for fault in faults}
        scenario = None
    if found or scenario is None:
        if data.get("ropes"):  # the cable is the first of them, which has its own
            return None, [fault for path, fault in found.items() if path[0] != "cable" or "cable" in data]
        salvaged = _salvage(Scenario, data, set(found))
        return None, [*found.values(), *(fault for fault in _implausible(salvaged) if fault.path not in found)]
    faults = list(_implausible(scenario)) or list(equilibrium_faults(scenario))
    if any("joins" in fault.path for fault in faults):
        faults = [fault for fault in faults if "joins" in fault.path or fault.path[0] not in BY_JOINS]
    return (None if faults else scenario), faults


def _beyond_reason(data: Any, path: KeyPath = ()) -> Iterator[Fault]:
    """Errors of a scenario's numbers whose squares or products would overflow or underflow in floating point."""
    if isinstance(data, dict | list):
        for key, value in data.items() if isinstance(data, dict) else enumerate(data):
            if type(value) is float and SMALLEST <= abs(value) <= LARGEST:  # most of them
                continue
            yield from _beyond_reason(value, (*path, key))
    elif isinstance(data, int | float) and not isinstance(data, bool):
        is_finite = isinstance(data, int) or isfinite(data)  # which fails for a whole number of hundreds of digits
        if not is_finite or SMALLEST <= abs(data) <= LARGEST or data == 0:
            return
        try:
            field, _, used = locate(path)
        except KeyError:  # it does not exist, which is a fault of its own
            return
        if field is not None and scalar(field.annotation)[0] is not int:
            within = "one of its numbers" if used < len(path) else ""
            limits = f"numbers of {SMALLEST:g} to {LARGEST:g} in size, or 0"
            yield refuse(path[:used], data, f"{allowed(field)}; {limits}", within)


def _schema_fault(location: KeyPath, kind: str, data: dict[str, Any]) -> Fault:
    """Convert one validation error of pydantic into the error message of a scenario."""
    location = tuple(key for key in location if not str(key).startswith("#"))  # tags of alternatives
    if kind == "extra_forbidden":
        _, model, _ = locate(location[:-1])
        return unknown_key(location, model.model_fields if model else ())
    field, _, used = locate(location)
    path = location[:used]
    given: Any = data
    for key in path:
        if isinstance(given, Mapping) and key not in given:
            return refuse(path, NOTHING, allowed(field), "it is needed")
        given = given[key]
    return refuse(path, given, allowed(field))


def _salvage(model: type[BaseModel], data: Any, bad: set[KeyPath], at: KeyPath = ()) -> Any:
    """Build a pydantic model from its valid values; others are NaN, for which every comparison is false."""
    values: dict[str, Any] = {}
    data = data if isinstance(data, dict) else {}
    for name, field in model.model_fields.items():
        here = (*at, name)
        container, inner = inner_model(field)
        kind, _ = scalar(field.annotation)
        given = data.get(name)
        if alternative(kind) and not isinstance(given, dict):
            values[name] = nan if here in bad or name not in data else given
        elif inner is not None and container is None:
            absent = given is None and scalar(field.annotation)[1]
            values[name] = None if absent else _salvage(inner, given, bad, here)
        elif inner is not None and container is dict:
            items = given.items() if isinstance(given, dict) else ()
            values[name] = {key: _salvage(inner, item, bad, (*here, key)) for key, item in items}
        elif inner is not None:
            numbered = enumerate(given) if isinstance(given, list) else ()
            values[name] = tuple(_salvage(inner, item, bad, (*here, key)) for key, item in numbered)
        elif get_origin(kind) is dict:
            items = given.items() if isinstance(given, dict) else ()
            values[name] = {key: item for key, item in items if (*here, key) not in bad}
        elif here not in bad and (name in data or not field.is_required()):
            values[name] = given if name in data else field.get_default(call_default_factory=True)
        elif get_origin(kind) is tuple and get_args(kind) not in ((float, float), (float, Ellipsis)):
            values[name] = ()
        else:
            values[name] = {float: nan, int: nan}.get(kind, (nan, nan) if get_origin(kind) is tuple else None)
    return model.model_construct(**values)


def _implausible(scenario: Scenario) -> Iterator[Fault]:
    """Errors in combinations of a scenario's values that are each valid alone, in all sections."""
    seen: set[KeyPath] = set()  # of ropes together, as carriers of a loop are on each of its strands
    for name in scenario.cables:
        own = tuple(scenario.rope_key(name).split(".", 1))
        yield from name_faults(own, name)
        alone = scenario.of_rope(name)
        faults = [
            fault._replace(path=(*own, *fault.path[1:])) if fault.path[0] == "cable" else fault
            for fault in (*line_faults(alone), *vehicle_faults(alone))
        ]
        yield from (fault for fault in faults if fault.path not in seen)
        seen |= {fault.path for fault in faults}
    yield from coupling_faults(scenario)
    yield from name_conflicts(scenario)
    yield from drive_faults(scenario)
    if scenario.carriers is not None:
        yield from carrier_faults(scenario, scenario.carriers)
    yield from _sensors(scenario)
    yield from limit_faults(scenario)
    yield from wind_faults(scenario)
    yield from overload_faults(scenario)


def _sensors(scenario: Scenario) -> Iterator[Fault]:
    """Errors in a scenario's sensors: unknown object, two of one kind on an object, or keys of another kind."""
    vehicles = _body_names(scenario)
    ends = [end for rope in scenario.cables for end in scenario.end_names(rope)]
    bodies = [f"{name}/{body}" for name, own in vehicles.items() for body in own]
    known = {
        "encoder": [*scenario.drives, *vehicles],
        "drive_force": [*scenario.drives, *vehicles],
        "load_cell": [*ends, *scenario.towers],
        "inclinometer": [*vehicles, *bodies],
        "imu": [*vehicles, *bodies],
    }
    taken: dict[tuple[str, str, str], str] = {}
    for name, sensor in scenario.sensors.items():
        path = ("sensors", name)
        yield from name_faults(path)
        if sensor.kind not in known or not isinstance(sensor.of, str):
            continue  # a fault of its own
        if sensor.of not in known[sensor.kind]:
            allowed_names = listed(known[sensor.kind], "nothing in this scenario")
            yield refuse((*path, "of"), sensor.of, f"{allowed_names}, for {sensor.kind}")
        if sensor.axis == "roll" and (sensor.kind != "inclinometer" or scenario.dim == 2):
            yield refuse((*path, "axis"), sensor.axis, "pitch, or roll of an inclinometer in space")
        if (first := taken.setdefault((sensor.kind, sensor.of, sensor.axis), name)) != name:
            yield refuse(
                (*path, "of"), sensor.of, f"one {sensor.kind} for each object", f"measured by '{first}' already"
            )
        if sensor.kind != "imu":
            for key in ("rate_noise", "rate_bias"):
                if (given := getattr(sensor, key)) != 0.0:
                    yield refuse((*path, key), given, "0, except for an imu")


def _body_names(scenario: Scenario) -> dict[str, list[str]]:
    """Body names by vehicle, also for a scenario with other errors."""
    found = {name: [*vehicle.bodies] for name, vehicle in scenario.carriages.items()}
    carriers = scenario.carriers
    if carriers is None or not isinstance(carriers.count, int):
        return found
    order = carriers.order or tuple(carriers.kinds)
    for number in range(carriers.count):
        kind = carriers.kinds.get(order[number % len(order)]) if order else None
        found[f"{carriers.name}_{number + 1}"] = [*(carriers.bodies if kind is None else kind.bodies)]
    return found
