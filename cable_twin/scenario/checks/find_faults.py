"""Search for all faults of a scenario at once, each with key path, given and allowed value."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from math import isfinite, nan
from typing import Any, get_args, get_origin

from pydantic import BaseModel, ValidationError

from cable_twin.scenario.checks.air import wind_faults
from cable_twin.scenario.checks.couplings import (
    bullwheel_faults,
    clamp_faults,
    connector_faults,
    pantograph_faults,
    track_faults,
    travel_faults,
    unknown_rope_faults,
)
from cable_twin.scenario.checks.fault import (
    Fault,
    KeyPath,
    allowed,
    alternative,
    inner_model,
    locate,
    name_faults,
    refuse,
    scalar,
    show,
    unknown_key,
)
from cable_twin.scenario.checks.line import cable_faults, rest_faults, space_faults
from cable_twin.scenario.checks.vehicles import vehicle_faults
from cable_twin.scenario.schema import Scenario

LARGEST, SMALLEST = 1e15, 1e-30  # of a number in SI units, by size


def find_faults(data: dict[str, Any]) -> tuple[Scenario | None, list[Fault]]:
    """Validate plain data as a scenario and collect all faults.

    Args:
        data: dicts with text keys, lists and scalars.

    Returns:
        The scenario, or None where it has faults, and the faults. What is implausible is found even where other
        values have faults of their own.
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
    faults = list(_implausible(scenario)) or list(rest_faults(scenario))
    faults.sort(key=lambda fault: "joins" not in fault.path)  # what is joined wrongly has faults elsewhere
    return (None if faults else scenario), faults


def _beyond_reason(data: Any, path: KeyPath = ()) -> Iterator[Fault]:
    """Faults of numbers too large or too small for their squares and products."""
    if isinstance(data, dict | list):
        for key, value in data.items() if isinstance(data, dict) else enumerate(data):
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
            within = " in it" if used < len(path) else ""
            limits = f"numbers of {SMALLEST:g} to {LARGEST:g} in size, or 0"
            yield refuse(path[:used], data, f"{allowed(field)}; {limits}", detail=within)


def _schema_fault(location: KeyPath, kind: str, data: dict[str, Any]) -> Fault:
    """Convert one validation error of pydantic into a fault."""
    location = tuple(key for key in location if not str(key).startswith("#"))  # tags of alternatives
    if kind == "extra_forbidden":
        _, model, _ = locate(location[:-1])
        return unknown_key(location, model.model_fields if model else ())
    field, _, used = locate(location)
    path = location[:used]
    given: Any = data
    for key in path:
        if isinstance(given, Mapping) and key not in given:
            return Fault(path, f"nothing given, but it is needed; allowed: {allowed(field)}")
        given = given[key]
    return refuse(path, given, f"{allowed(field)}")


def _salvage(model: type[BaseModel], data: Any, bad: set[KeyPath], at: KeyPath = ()) -> Any:
    """Build a model from its sound values; missing numbers are NaN, for which every comparison is false."""
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
    """Faults of combinations of values that are each valid alone."""
    yield from rope_faults(scenario)
    if not scenario.ropes:
        yield from cable_faults(scenario)
        yield from vehicle_faults(scenario)
        yield from space_faults(scenario)
    yield from sensor_faults(scenario)
    yield from wind_faults(scenario)


def sensor_faults(scenario: Scenario) -> Iterator[Fault]:
    """Faults of sensors: unknown objects, two of one kind on one object, or keys of another kind."""
    vehicles = _vehicles(scenario)
    ends = [end for rope in scenario.cables for end in scenario.end_names(rope)]
    bodies = [f"{name}/{body}" for name, own in vehicles.items() for body in own]
    known = {
        "encoder": [*scenario.drives, *vehicles],
        "load_cell": [*ends, *scenario.towers],
        "inclinometer": [*vehicles, *bodies],
        "imu": [*vehicles, *bodies],
    }
    taken: dict[tuple[str, str], str] = {}
    for name, sensor in scenario.sensors.items():
        path = ("sensors", name)
        yield from name_faults(path)
        if sensor.kind not in known or not isinstance(sensor.of, str):
            continue  # a fault of its own
        if sensor.of not in known[sensor.kind]:
            allowed = ", ".join(known[sensor.kind][:8]) or "nothing in this scenario"
            more = ", ..." if len(known[sensor.kind]) > 8 else ""
            yield Fault((*path, "of"), f"given {show(sensor.of)}; allowed for {sensor.kind}: {allowed}{more}")
        first = taken.setdefault((sensor.kind, sensor.of), name)
        if first != name:
            yield refuse(
                (*path, "of"), sensor.of, f"one {sensor.kind} for each", detail=f", which '{first}' measures already"
            )
        if sensor.kind != "imu":
            for key in ("rate_noise", "rate_bias"):
                if getattr(sensor, key) != 0.0:
                    yield refuse((*path, key), getattr(sensor, key), "0, only an imu has it")


def _vehicles(scenario: Scenario) -> dict[str, list[str]]:
    """Body names of all vehicles, also for a scenario with other faults."""
    found = {name: [*vehicle.bodies] for name, vehicle in scenario.carriages.items()}
    carriers = scenario.carriers
    if carriers is None or not isinstance(carriers.count, int):
        return found
    order = carriers.order or tuple(carriers.kinds)
    for number in range(carriers.count):
        kind = carriers.kinds.get(order[number % len(order)]) if order else None
        found[f"{carriers.name}_{number + 1}"] = [*(carriers.bodies if kind is None else kind.bodies)]
    return found


def rope_faults(scenario: Scenario) -> Iterator[Fault]:
    """Faults of each rope alone, and of the couplings between ropes."""
    yield from unknown_rope_faults(scenario)
    if not scenario.ropes:
        for key in ("sheaves", "connectors", "pantographs"):
            for name in getattr(scenario, key):
                yield Fault((key, name), "given with one cable; allowed: with several `ropes`")
        if scenario.carriers is not None and scenario.carriers.tracks:
            yield Fault(("carriers", "tracks"), "given with one cable; allowed: with several `ropes`")
        for name, carriage in scenario.carriages.items():
            if carriage.clamped_to:
                yield Fault(("carriages", name, "clamped_to"), "given with one cable; allowed: with several `ropes`")
        for key in ("mass_damping", "tension_damping", "lateral"):
            if getattr(scenario.cable, key) != 0.0:
                yield refuse(("cable", key), getattr(scenario.cable, key), "0, or several `ropes`")
        return
    if scenario.solver.integrator != "generalized_alpha":
        yield refuse(
            ("solver", "integrator"), scenario.solver.integrator, "generalized_alpha", detail=" with several ropes"
        )
    seen = set()  # what rides a loop is on each of its strands
    for name in scenario.ropes:
        yield from name_faults(("ropes", name))
        alone = scenario.of_rope(name)
        for fault in (*cable_faults(alone), *vehicle_faults(alone)):
            path: KeyPath = ("ropes", name, *fault.path[1:]) if fault.path[0] == "cable" else fault.path
            if path not in seen:
                seen.add(path)
                yield Fault(path, fault.text)
    yield from bullwheel_faults(scenario)
    if scenario.carriers is not None:
        yield from track_faults(scenario, scenario.carriers)
    yield from connector_faults(scenario)
    yield from pantograph_faults(scenario)
    clamps = list(clamp_faults(scenario))
    yield from clamps
    if not clamps and not list(unknown_rope_faults(scenario)):
        yield from travel_faults(scenario)
