"""Search for all faults of a scenario at once, each with key path, given and allowed value."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from difflib import get_close_matches
from math import isfinite, nan
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo

from cable_twin.scenario.checks.fault import Fault, KeyPath, refuse
from cable_twin.scenario.checks.line_conflicts import cable_faults
from cable_twin.scenario.checks.rope_conflicts import rope_faults
from cable_twin.scenario.checks.sensor_conflicts import sensor_faults
from cable_twin.scenario.checks.space_conflicts import rest_faults, space_faults
from cable_twin.scenario.checks.vehicle_conflicts import vehicle_faults
from cable_twin.scenario.checks.wind_conflicts import wind_faults
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
            field, _, used = _locate(path)
        except KeyError:  # it does not exist, which is a fault of its own
            return
        if field is not None and _scalar(field.annotation)[0] is not int:
            within = " in it" if used < len(path) else ""
            limits = f"numbers of {SMALLEST:g} to {LARGEST:g} in size, or 0"
            yield refuse(path[:used], data, f"{allowed(field)}; {limits}", detail=within)


def unknown_key(path: KeyPath, known: Iterable[str]) -> Fault:
    """Fault of an unknown key, with the most similar known key."""
    known = list(known)
    near = get_close_matches(str(path[-1]), known, n=1)
    if near:
        hint = f"did you mean {near[0]!r}?"
    else:
        hint = f"allowed: {', '.join(known)}" if known else "nothing can be set below this"
    return Fault(path, f"this key does not exist; {hint}")


def inner_model(field: FieldInfo) -> tuple[type | None, type[BaseModel] | None]:
    """Container and model of a field: (None, Cable), (dict, Carriage), (tuple, Load), or no model."""
    annotation, _ = _scalar(field.annotation)
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return None, annotation
    if alternative := _alternative(annotation):
        return None, alternative
    container, inner = get_origin(annotation), get_args(annotation)
    model = {dict: inner[1:2], tuple: inner[:1]}.get(container, ())
    if model and isinstance(model[0], type) and issubclass(model[0], BaseModel):
        return container, model[0]
    return (dict, None) if container is dict else (None, None)


def _alternative(annotation: Any) -> type[BaseModel] | None:
    """Model allowed in place of a number; None without one."""
    if get_origin(annotation) not in (Union, UnionType):
        return None
    members = [get_args(member)[0] if get_origin(member) is Annotated else member for member in get_args(annotation)]
    return next((item for item in members if isinstance(item, type) and issubclass(item, BaseModel)), None)


def _schema_fault(location: KeyPath, kind: str, data: dict[str, Any]) -> Fault:
    """Convert one validation error of pydantic into a fault."""
    location = tuple(key for key in location if not str(key).startswith("#"))  # tags of alternatives
    if kind == "extra_forbidden":
        _, model, _ = _locate(location[:-1])
        return unknown_key(location, model.model_fields if model else ())
    field, _, used = _locate(location)
    path = location[:used]
    given: Any = data
    for key in path:
        if isinstance(given, Mapping) and key not in given:
            return Fault(path, f"nothing given, but it is needed; allowed: {allowed(field)}")
        given = given[key]
    return refuse(path, given, f"{allowed(field)}")


def _locate(path: KeyPath) -> tuple[FieldInfo | None, type[BaseModel] | None, int]:
    """Deepest field on a key path, the model at its end, and the number of path parts up to there."""
    field: FieldInfo | None = None
    model: type[BaseModel] | None = Scenario
    used = 0
    while model is not None and used < len(path):
        field = model.model_fields[str(path[used])]
        container, model = inner_model(field)
        used += 1
        if container is not None:
            if used == len(path):
                return field, None, used
            used += 1  # the name or the number of the item
    if field is not None and model is None and get_origin(_scalar(field.annotation)[0]) is dict:
        used = min(used + 1, len(path))
    return field, model, used


def _scalar(annotation: Any) -> tuple[Any, bool]:
    """Strip Annotated and Optional from an annotation; returns the type and whether null is allowed."""
    if get_origin(annotation) is Annotated:
        return _scalar(get_args(annotation)[0])
    if get_origin(annotation) in (Union, UnionType) and type(None) in get_args(annotation):
        return _scalar(next(arg for arg in get_args(annotation) if arg is not type(None)))[0], True
    return annotation, False


def allowed(field: FieldInfo | None, *, unit: bool = True) -> str:
    """Allowed values of a field in words, with or without its unit."""
    if field is None:
        return "a mapping"
    extra = field.json_schema_extra if isinstance(field.json_schema_extra, dict) else {}
    if "allowed" in extra:
        return str(extra["allowed"])
    container, model = inner_model(field)
    kind, optional = _scalar(field.annotation)
    bounds = {
        "gt": "above",
        "ge": "at least",
        "lt": "below",
        "le": "at most",
        "min_length": "with a length of at least",
    }
    limits = [
        f"{word} {getattr(limit, name):g}"
        for limit in field.metadata
        for name, word in bounds.items()
        if getattr(limit, name, None) is not None
    ]
    if model is not None or container is not None:
        text = "a list of mappings" if container is tuple else "a mapping"
    elif get_origin(kind) is Literal:
        text = f"one of {', '.join(map(str, get_args(kind)))}"
    elif get_origin(kind) is tuple and get_args(kind)[1:] == (Ellipsis,):
        inner = get_args(kind)[0]
        words = get_args(inner) if get_origin(inner) is Literal else ("names",) if inner is str else ()
        text = f"a list of some of {', '.join(words)}" if words else "a list of points, 2 finite numbers each"
        if get_args(kind)[0] is float:
            text, limits = _numbers(field), []
    elif get_origin(kind) is tuple:
        text = f"a list of {len(get_args(kind))} finite numbers"
    else:
        text = {float: "a finite number", int: "a whole number", str: "a text", bool: "true or false"}[kind]
    text = " ".join([text, " and ".join(limits)]) if limits else text
    own = extra.get("unit")
    text = f"{text}, in {own}" if unit and own not in (None, "-") else text
    return f"{text}, or null" if optional else text


def _numbers(field: FieldInfo) -> str:
    """Allowed number of entries of a list of numbers, in words."""
    annotation = str(field.annotation) + str(field.metadata)
    return (
        "a list of 3 or 6 finite numbers" if "max_length=6" in annotation else "a list of 2 finite numbers, 3 in space"
    )


def _salvage(model: type[BaseModel], data: Any, bad: set[KeyPath], at: KeyPath = ()) -> Any:
    """Build a model from its sound values; missing numbers are NaN, for which every comparison is false."""
    values: dict[str, Any] = {}
    data = data if isinstance(data, dict) else {}
    for name, field in model.model_fields.items():
        here = (*at, name)
        container, inner = inner_model(field)
        kind, _ = _scalar(field.annotation)
        given = data.get(name)
        if _alternative(kind) and not isinstance(given, dict):
            values[name] = nan if here in bad or name not in data else given
        elif inner is not None and container is None:
            absent = given is None and _scalar(field.annotation)[1]
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
