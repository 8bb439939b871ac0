"""All that is wrong with a scenario, at once: each fault with its key path, what was given and what is allowed."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from difflib import get_close_matches
from itertools import pairwise
from math import hypot, nan
from re import fullmatch
from types import UnionType
from typing import Annotated, Any, Literal, NamedTuple, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo

from cable_twin.scenario_parameters import BRAKES, stop_stroke
from cable_twin.scenario_schema import Cable, Carriage, Scenario

KeyPath = tuple[str | int, ...]

LARGEST_STRAIN = 0.05  # to reach the far end; no rope survives more
NAME = "[a-zA-Z][a-zA-Z0-9_]*"


class Fault(NamedTuple):
    """One fault: where it is and what it is."""

    path: KeyPath
    text: str


def find_faults(data: dict[str, Any]) -> tuple[Scenario | None, list[Fault]]:
    """Read a scenario from plain data.

    Args:
        data: dicts with text keys, lists and scalars.

    Returns:
        The scenario, or None where it has faults, and the faults. What is implausible is found even where other
        values have faults of their own.
    """
    try:
        scenario = Scenario.model_validate(data)
    except ValidationError as error:
        found = {
            fault.path: fault for fault in (_schema_fault(item["loc"], item["type"], data) for item in error.errors())
        }
        salvaged = _salvage(Scenario, data, set(found))
        return None, [*found.values(), *(fault for fault in _implausible(salvaged) if fault.path not in found)]
    faults = list(_implausible(scenario))
    return (None if faults else scenario), faults


def unknown_key(path: KeyPath, known: Iterable[str]) -> Fault:
    """The fault of a key that does not exist, with the nearest one that does."""
    known = list(known)
    near = get_close_matches(str(path[-1]), known, n=1)
    if near:
        hint = f"did you mean {near[0]!r}?"
    else:
        hint = f"allowed: {', '.join(known)}" if known else "nothing can be set below this"
    return Fault(path, f"this key does not exist; {hint}")


def inner_model(field: FieldInfo) -> tuple[type | None, type[BaseModel] | None]:
    """The model in a field, or null, and what holds it: (None, Cable), (dict, Carriage), (tuple, Load); or no model."""
    annotation, _ = _scalar(field.annotation)
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return None, annotation
    container, inner = get_origin(annotation), get_args(annotation)
    model = {dict: inner[1:2], tuple: inner[:1]}.get(container, ())
    if model and isinstance(model[0], type) and issubclass(model[0], BaseModel):
        return container, model[0]
    return None, None


def show(value: Any) -> str:
    """A given value on one short line."""
    if value is None:
        return "null"
    if isinstance(value, Mapping):
        return "a mapping" if value else "an empty mapping"
    try:
        text = repr(value)
    except ValueError:
        return "a number of thousands of digits"
    return text if len(text) <= 60 else f"{text[:57]}..."


def _schema_fault(location: KeyPath, kind: str, data: dict[str, Any]) -> Fault:
    """Word one finding of pydantic."""
    if kind == "extra_forbidden":
        _, model, _ = _locate(location[:-1])
        return unknown_key(location, model.model_fields if model else ())
    field, _, used = _locate(location)
    path = location[:used]
    given: Any = data
    for key in path:
        if isinstance(given, Mapping) and key not in given:
            return Fault(path, f"nothing given, but it is needed; allowed: {_allowed(field)}")
        given = given[key]
    return Fault(path, f"given {show(given)}; allowed: {_allowed(field)}")


def _locate(path: KeyPath) -> tuple[FieldInfo | None, type[BaseModel] | None, int]:
    """The deepest field on a path, the model that the path leads into, and how much of the path belongs to them."""
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
    return field, model, used


def _scalar(annotation: Any) -> tuple[Any, bool]:
    """An annotation without Annotated and Optional, and whether null is allowed."""
    if get_origin(annotation) is Annotated:
        return _scalar(get_args(annotation)[0])
    if get_origin(annotation) in (Union, UnionType):
        return _scalar(next(arg for arg in get_args(annotation) if arg is not type(None)))[0], True
    return annotation, False


def _allowed(field: FieldInfo | None) -> str:
    """What a field allows, in words, with its unit."""
    if field is None:
        return "a mapping"
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
        text = f"one of {', '.join(get_args(kind))}"
    elif get_origin(kind) is tuple and get_args(kind)[1:] == (Ellipsis,):
        words = get_args(get_args(kind)[0]) if get_origin(get_args(kind)[0]) is Literal else ()
        text = f"a list of some of {', '.join(words)}" if words else "a list of points, 2 finite numbers each"
    elif get_origin(kind) is tuple:
        text = f"a list of {len(get_args(kind))} finite numbers"
    else:
        text = {float: "a finite number", int: "a whole number", str: "a text"}[kind]
    text = " ".join([text, " and ".join(limits)]) if limits else text
    unit = field.json_schema_extra.get("unit") if isinstance(field.json_schema_extra, dict) else None
    text = f"{text}, in {unit}" if unit not in (None, "-") else text
    return f"{text}, or null" if optional else text


def _salvage(model: type[BaseModel], data: Any, bad: set[KeyPath], at: KeyPath = ()) -> Any:
    """Build a model from what is sound; a number without a sound value is NaN, so that no comparison finds it wrong."""
    values: dict[str, Any] = {}
    data = data if isinstance(data, dict) else {}
    for name, field in model.model_fields.items():
        here = (*at, name)
        container, inner = inner_model(field)
        kind, _ = _scalar(field.annotation)
        given = data.get(name)
        if inner is not None and container is None:
            absent = given is None and _scalar(field.annotation)[1]
            values[name] = None if absent else _salvage(inner, given, bad, here)
        elif inner is not None and container is dict:
            items = given.items() if isinstance(given, dict) else ()
            values[name] = {key: _salvage(inner, item, bad, (*here, key)) for key, item in items}
        elif inner is not None:
            numbered = enumerate(given) if isinstance(given, list) else ()
            values[name] = tuple(_salvage(inner, item, bad, (*here, key)) for key, item in numbered)
        elif here in bad and get_origin(kind) is tuple and get_args(kind)[1:] == (Ellipsis,):
            values[name] = ()
        elif here in bad or (name not in data and field.is_required()):
            values[name] = {float: nan, int: nan}.get(kind, (nan, nan) if get_origin(kind) is tuple else None)
        else:
            values[name] = given if name in data else field.get_default(call_default_factory=True)
    return model.model_construct(**values)


def _implausible(scenario: Scenario) -> Iterator[Fault]:
    """Values that are sound alone but not together."""
    yield from _supports(scenario.cable)
    yield from _span(scenario.cable)
    yield from _loads(scenario.cable)
    yield from _carriages(scenario)
    yield from _terrain(scenario)


def _supports(cable: Cable) -> Iterator[Fault]:
    for name in ("start", "end"):
        end = getattr(cable, name)
        path = ("cable", name, "direction")
        if end.support == "clamped":
            if end.direction is None:
                yield Fault(path, "nothing given, but a clamped end needs it; allowed: a list of 2 finite numbers")
            elif hypot(*end.direction) == 0.0:
                yield Fault(path, f"given {show(list(end.direction))}; allowed: a direction, not both numbers zero")
        elif end.support is not None and end.direction is not None:
            yield Fault(
                path, f"given {show(list(end.direction))} where support is {end.support}; allowed: only where clamped"
            )
    if cable.start.support == cable.end.support == "free" and cable.initial_shape != "straight":
        yield Fault(
            ("cable", "end", "support"),
            "given 'free' at both ends; allowed: pinned or clamped at one at least, or initial_shape: straight",
        )


def _span(cable: Cable) -> Iterator[Fault]:
    start, end = cable.start, cable.end
    if not {start.support, end.support} <= {"pinned", "clamped"}:
        return
    chord = hypot(end.position[0] - start.position[0], end.position[1] - start.position[1])
    if chord <= 1e-6 * cable.unstrained_length:
        yield Fault(
            ("cable", "end", "position"),
            f"given {show(list(end.position))}, the place of the start; allowed: another place, in m",
        )
    strain = chord / cable.unstrained_length - 1.0
    if cable.initial_shape == "straight" and abs(strain) > 1e-9:
        yield Fault(
            ("cable", "initial_shape"),
            f"given 'straight', unstrained, between held ends {chord:.9g} m apart with a cable of "
            f"{cable.unstrained_length:.9g} m; allowed: equilibrium, or a free end",
        )
    if strain > LARGEST_STRAIN:
        yield Fault(
            ("cable", "unstrained_length"),
            f"given {cable.unstrained_length!r} for ends that are {chord:.6g} m apart, which needs a strain of "
            f"{100.0 * strain:.3g} % and a tension of {cable.axial_stiffness * strain:.3g} N; allowed: at least "
            f"{chord / (1.0 + LARGEST_STRAIN):.6g} m, for a strain of {100.0 * LARGEST_STRAIN:.3g} %",
        )


def _loads(cable: Cable) -> Iterator[Fault]:
    length = cable.unstrained_length
    for number, load in enumerate(cable.loads):
        path: KeyPath = ("cable", "loads", number)
        if load.arc_length > length:
            yield Fault((*path, "arc_length"), f"given {load.arc_length!r}; allowed: 0 to {length:.9g} m, on the cable")
        elif load.moment != 0.0 and 0.0 < load.arc_length < length:
            yield Fault((*path, "moment"), f"given {load.moment!r} within the cable; allowed: only at its ends, in N m")


def _carriages(scenario: Scenario) -> Iterator[Fault]:
    length = scenario.cable.unstrained_length
    for name, carriage in scenario.carriages.items():
        path = ("carriages", name)
        yield from _name(path)
        stroke = stop_stroke(scenario, carriage)
        if 2.0 * stroke >= length:
            yield Fault(
                (*path, "end_stop", "stroke"),
                f"given {stroke!r} at both ends of a cable of {length:.9g} m; allowed: less than {length / 2:.9g} m",
            )
        elif carriage.arc_length < stroke or carriage.arc_length > length - stroke:
            yield Fault(
                (*path, "arc_length"),
                f"given {carriage.arc_length!r}; allowed: {stroke:.9g} to {length - stroke:.9g} m, "
                "on the cable and between its end stops",
            )
        last = list(carriage.bodies)[-1:]
        for body_name, body in carriage.bodies.items():
            yield from _name((*path, "bodies", body_name))
            if body.lower_pivot is None and [body_name] != last:
                yield Fault(
                    (*path, "bodies", body_name, "lower_pivot"),
                    "nothing given, but another body hangs there; allowed: a list of 2 finite numbers, in m",
                )
        yield from _payload(path, carriage)
        yield from _drive(path, carriage, scenario.solver.integrator)


def _payload(path: KeyPath, carriage: Carriage) -> Iterator[Fault]:
    payload = carriage.payload
    if payload is None:
        return
    if payload.mass > payload.capacity:
        yield Fault(
            (*path, "payload", "mass"), f"given {payload.mass!r}; allowed: 0 to the capacity of {payload.capacity:g} kg"
        )
    if payload.body is not None and payload.body not in carriage.bodies:
        yield Fault(
            (*path, "payload", "body"), f"given {show(payload.body)}; allowed: one of {', '.join(carriage.bodies)}"
        )


def _drive(path: KeyPath, carriage: Carriage, integrator: str) -> Iterator[Fault]:
    drive, limits = carriage.drive, carriage.drive.limits
    path = (*path, "drive")
    if limits.deceleration is not None and limits.deceleration > limits.emergency_deceleration:
        yield Fault(
            (*path, "limits", "deceleration"),
            f"given {limits.deceleration!r}; allowed: at most the emergency_deceleration of "
            f"{limits.emergency_deceleration:g} m/s^2",
        )
    means = drive.emergency_stop
    given = [name for name in BRAKES if getattr(drive, name) is not None]
    for name in means:
        if name != "drive" and name not in given:
            yield Fault(
                (*path, "emergency_stop"),
                f"given {name!r}, which this drive does not have; allowed: {', '.join(['drive', *given])}",
            )
    sheave = [name for name in means if name in BRAKES[:2]]
    if "drive" in means and sheave:
        yield Fault(
            (*path, "emergency_stop"),
            f"given 'drive' and {sheave[0]!r}; allowed: either, for the drive decelerates at emergency_deceleration "
            "with whatever force that takes",
        )
    if drive.haul_rope is not None and carriage.joint == "fixed":
        yield Fault((*path, "haul_rope"), "given for a carriage whose joint is fixed; allowed: only where it slides")
    for key, used in (("haul_rope", drive.haul_rope is not None), ("emergency_stop", tuple(means) != ("drive",))):
        if used and integrator == "runge_kutta":
            yield Fault((*path, key), "given with the integrator runge_kutta; allowed: only with generalized_alpha")


def _terrain(scenario: Scenario) -> Iterator[Fault]:
    terrain = scenario.terrain
    if not terrain:
        return
    x = [point[0] for point in terrain]
    if len(x) < 2:
        yield Fault(("terrain",), f"given {len(x)} point; allowed: at least 2 points x, z, in m")
        return
    for number, (before, after) in enumerate(pairwise(x), start=1):
        if after <= before:
            yield Fault(("terrain", number), f"given x = {after!r} after {before!r}; allowed: rising x, in m")
    low, high = sorted((scenario.cable.start.position[0], scenario.cable.end.position[0]))
    if x[0] > low or x[-1] < high:
        yield Fault(
            ("terrain",),
            f"given from x = {x[0]:g} to {x[-1]:g} m; allowed: at least the whole track, {low:g} to {high:g} m",
        )


def _name(path: tuple[str, ...]) -> Iterator[Fault]:
    if not fullmatch(NAME, path[-1]):
        yield Fault(path, f"given the name {path[-1]!r}; allowed: a letter, then letters, digits and underscores")
