"""All that is wrong with a scenario, at once: each fault with its key path, what was given and what is allowed."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from difflib import get_close_matches
from itertools import pairwise
from math import ceil, copysign, hypot, nan
from re import fullmatch
from types import UnionType
from typing import Annotated, Any, Literal, NamedTuple, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo

from cable_twin.scenario_parameters import BRAKES, stop_stroke
from cable_twin.scenario_schema import Body, Cable, Carriage, Carriers, Scenario, Support

KeyPath = tuple[str | int, ...]

LARGEST_STRAIN = 0.05  # to reach the far end; no rope survives more
HELD = {"pinned", "clamped", "hydraulic", "counterweight"}  # supports of an end that has a place
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
    yield from _supports(scenario)
    yield from _span(scenario)
    yield from _towers(scenario)
    yield from _loads(scenario.cable)
    yield from _carriages(scenario)
    yield from _moving_cable(scenario)
    yield from _terrain(scenario)


def _supports(scenario: Scenario) -> Iterator[Fault]:
    cable = scenario.cable
    for name in ("start", "end"):
        end = getattr(cable, name)
        path = ("cable", name, "direction")
        if end.support in ("clamped", "counterweight"):
            if end.direction is None:
                yield Fault(path, f"nothing given, but {_kind(end)} needs it; allowed: a list of 2 finite numbers")
            elif hypot(*end.direction) == 0.0:
                yield Fault(path, f"given {show(list(end.direction))}; allowed: a direction, not both numbers zero")
        elif end.support is not None and end.direction is not None:
            yield Fault(
                path,
                f"given {show(list(end.direction))} where support is {end.support}; "
                "allowed: only where clamped or at a counterweight",
            )
    if cable.start.support == cable.end.support == "free" and cable.initial_shape != "straight":
        yield Fault(
            ("cable", "end", "support"),
            "given 'free' at both ends; allowed: pinned or clamped at one at least, or initial_shape: straight",
        )
    if cable.start.support == cable.end.support == "counterweight":
        yield Fault(("cable", "end", "support"), "given 'counterweight' at both ends; allowed: at one of them")
    for name in ("start", "end"):
        if getattr(cable, name).support is not None:
            yield from _counterweight(scenario, name)


def _kind(end: Support) -> str:
    """What an end is, in words."""
    return "a counterweight" if end.support == "counterweight" else f"a {end.support} end"


def _counterweight(scenario: Scenario, name: str) -> Iterator[Fault]:
    """What a counterweight needs and what only a counterweight has."""
    cable = scenario.cable
    end = getattr(cable, name)
    path = ("cable", name)
    if end.support != "counterweight":
        for key, unit in (("mass", "kg"), ("force", "N"), ("travel", "m"), ("buffer_stiffness", "N/m")):
            given = getattr(end, key)
            if given is not None:
                given = list(given) if isinstance(given, tuple) else given
                yield Fault(
                    (*path, key),
                    f"given {show(given)} where support is {end.support}; allowed: only at a counterweight, in {unit}",
                )
        return
    if end.mass is None:
        yield Fault((*path, "mass"), "nothing given, but a counterweight needs it; allowed: a number above 0, in kg")
    pull = (end.mass or nan) * scenario.gravity if end.force is None else end.force
    if pull == 0.0:
        yield Fault((*path, "force"), "nothing given, and no weight without gravity; allowed: a number above 0, in N")
    if pull > LARGEST_STRAIN * cable.axial_stiffness:
        yield Fault(
            (*path, "mass" if end.force is None else "force"),
            f"given a pull of {pull:.6g} N, a strain of {100.0 * pull / cable.axial_stiffness:.3g} %; allowed: at most "
            f"{LARGEST_STRAIN * cable.axial_stiffness:.6g} N, for a strain of {100.0 * LARGEST_STRAIN:.3g} %",
        )
    if end.travel is not None and end.travel[0] >= end.travel[1]:
        yield Fault(
            (*path, "travel"), f"given {show(list(end.travel))}; allowed: the least travel, then a greater one, in m"
        )
    if end.direction is not None:
        corners = [cable.start.position, *(tower.position for tower in scenario.towers.values()), cable.end.position]
        inner = corners[-2] if name == "end" else corners[1]
        outwards = (end.position[0] - inner[0], end.position[1] - inner[1])
        if outwards[0] * end.direction[0] + outwards[1] * end.direction[1] <= 0.0 < hypot(*end.direction):
            yield Fault(
                (*path, "direction"),
                f"given {show(list(end.direction))}, which lets the cable go slack; allowed: one that pulls it "
                f"away from {show(list(inner))}",
            )


def _span(scenario: Scenario) -> Iterator[Fault]:
    cable = scenario.cable
    start, end = cable.start, cable.end
    if not {start.support, end.support} <= HELD:
        return
    if (
        hypot(end.position[0] - start.position[0], end.position[1] - start.position[1])
        <= 1e-6 * cable.unstrained_length
    ):
        yield Fault(
            ("cable", "end", "position"),
            f"given {show(list(end.position))}, the place of the start; allowed: another place, in m",
        )
    corners = [start.position, *(tower.position for tower in scenario.towers.values()), end.position]
    way = sum(hypot(b[0] - a[0], b[1] - a[1]) for a, b in pairwise(corners))
    strain = way / cable.unstrained_length - 1.0
    over = " apart" if not scenario.towers else " apart over the towers"
    if "counterweight" in (start.support, end.support):
        if cable.initial_shape == "straight":
            yield Fault(("cable", "initial_shape"), "given 'straight' with a counterweight; allowed: equilibrium")
        return
    if cable.initial_shape == "straight" and abs(strain) > 1e-9:
        yield Fault(
            ("cable", "initial_shape"),
            f"given 'straight', unstrained, between held ends {way:.9g} m apart with a cable of "
            f"{cable.unstrained_length:.9g} m; allowed: equilibrium, or a free end",
        )
    if strain > LARGEST_STRAIN:
        yield Fault(
            ("cable", "unstrained_length"),
            f"given {cable.unstrained_length!r} for ends that are {way:.6g} m{over}, which needs a strain of "
            f"{100.0 * strain:.3g} % and a tension of {cable.axial_stiffness * strain:.3g} N; allowed: at least "
            f"{way / (1.0 + LARGEST_STRAIN):.6g} m, for a strain of {100.0 * LARGEST_STRAIN:.3g} %",
        )


def _towers(scenario: Scenario) -> Iterator[Fault]:
    cable = scenario.cable
    start, end = cable.start, cable.end
    if scenario.towers and "free" in (start.support, end.support):
        yield Fault(("towers",), "given with a free end of the cable; allowed: only where both ends are held")
    weighted = "counterweight" in (start.support, end.support)
    if scenario.towers and cable.initial_shape == "straight" and not weighted:
        yield Fault(("cable", "initial_shape"), "given 'straight' over towers; allowed: equilibrium")
    way = copysign(1.0, end.position[0] - start.position[0])
    before, passed = "the start", start.position[0]
    for name, tower in scenario.towers.items():
        path = ("towers", name)
        yield from _name(path)
        if name in ("start", "end"):
            yield Fault(path, f"given the name {name!r}, that of an end of the cable; allowed: another one")
        x = tower.position[0]
        if way * (x - passed) <= 0.0 or way * (end.position[0] - x) <= 0.0:
            yield Fault(
                (*path, "position"),
                f"given {show(list(tower.position))}; allowed: x between {passed:g} m of {before} and "
                f"{end.position[0]:g} m of the end, in order along the cable",
            )
        before, passed = f"tower {name!r}", x
        if tower.contacts > 1 and tower.length == 0.0:
            yield Fault((*path, "length"), f"given 0.0 for {tower.contacts} contacts; allowed: a number above 0, in m")
        if tower.contacts == 1 and tower.length > 0.0:
            yield Fault((*path, "length"), f"given {tower.length!r} for one contact; allowed: 0, or more contacts")
        if tower.radius is not None and tower.length > tower.radius:
            yield Fault(
                (*path, "length"),
                f"given {tower.length!r}, more than one radian of a circle of {tower.radius:g} m; "
                f"allowed: at most {tower.radius:g} m",
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
        if carriage.joint == "clamped":
            yield from _clamped(scenario, name, carriage)
        elif scenario.drives and carriage.joint is not None:
            yield Fault((*path, "joint"), f"given {carriage.joint!r} on a cable that moves; allowed: clamped")
        elif 2.0 * stroke >= length:
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
        yield from _bodies(path, carriage.bodies)
        yield from _payload(path, carriage)
        yield from _drive(path, carriage, scenario.solver.integrator)


def _bodies(path: tuple[str, ...], bodies: Mapping[str, Body]) -> Iterator[Fault]:
    last = list(bodies)[-1:]
    for name, body in bodies.items():
        yield from _name((*path, "bodies", name))
        if body.lower_pivot is None and [name] != last:
            yield Fault(
                (*path, "bodies", name, "lower_pivot"),
                "nothing given, but another body hangs there; allowed: a list of 2 finite numbers, in m",
            )


def _clamped(scenario: Scenario, name: str, carriage: Carriage) -> Iterator[Fault]:
    """What of a carriage does not go with a moving cable."""
    path = ("carriages", name)
    if not scenario.drives:
        yield Fault(
            (*path, "joint"), "given 'clamped' on a cable that stands still; allowed: sliding, fixed, or drives"
        )
    elif carriage.arc_length < 0.0 or carriage.arc_length > scenario.loop_length:
        yield Fault(
            (*path, "arc_length"),
            f"given {carriage.arc_length!r}; allowed: 0 to {scenario.loop_length:.9g} m, on the loop of the cable",
        )
    for key in ("rolling", "viscous"):
        if getattr(carriage.friction, key) > 0.0:
            given = getattr(carriage.friction, key)
            yield Fault((*path, "friction", key), f"given {given!r}; allowed: 0, what is clamped does not slide")
    if carriage.drive.mode not in (None, "free"):
        yield Fault(
            (*path, "drive", "mode"),
            f"given {carriage.drive.mode!r}; allowed: free, what is clamped goes with the cable",
        )


def _moving_cable(scenario: Scenario) -> Iterator[Fault]:
    """Drive and carriers of a cable that moves along itself."""
    for name, drive in scenario.drives.items():
        path = ("drives", name)
        yield from _name(path)
        if name != next(iter(scenario.drives)):
            yield Fault(path, "given a second drive of the cable; allowed: one")
        if name in scenario.carriages:
            yield Fault(path, "given the name of a carriage; allowed: another one, for commands name both")
        for key, why in (
            ("force", "a moving cable keeps its speed"),
            ("power", "a moving cable keeps its speed"),
            ("deceleration", "a moving cable stops as it starts, at its acceleration"),
        ):
            given = getattr(drive.limits, key)
            if given is not None:
                yield Fault((*path, "limits", key), f"given {given!r}; allowed: null, {why}")
    if scenario.drives:
        for end in ("start", "end"):
            if getattr(scenario.cable, end).support == "free":
                yield Fault(
                    ("cable", end, "support"),
                    "given 'free' for a cable that moves; allowed: pinned or clamped, at a station",
                )
        if scenario.solver.integrator == "runge_kutta":
            yield Fault(
                ("solver", "integrator"), "given 'runge_kutta' for a cable that moves; allowed: generalized_alpha"
            )
    if scenario.carriers is not None:
        yield from _carriers(scenario, scenario.carriers)


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


def _carriers(scenario: Scenario, carriers: Carriers) -> Iterator[Fault]:
    length = scenario.cable.unstrained_length
    if not scenario.drives:
        yield Fault(("carriers",), "given for a cable that stands still; allowed: with a drive in drives")
    if carriers.name is not None:
        yield from _name(("carriers", "name"), carriers.name)
        taken = [name for name in (*scenario.carriages, *scenario.drives) if fullmatch(f"{carriers.name}_[0-9]+", name)]
        if taken:
            yield Fault(("carriers", "name"), f"given {carriers.name!r}, which would name {taken[0]!r} twice")
    if carriers.spacing > length:
        yield Fault(
            ("carriers", "spacing"),
            f"given {carriers.spacing!r}; allowed: at most {length:.9g} m, the length of the cable",
        )
    elif scenario.loop_length < length:
        yield Fault(
            ("carriers", "count"),
            f"given {carriers.count!r} every {carriers.spacing:.9g} m, a loop of {scenario.loop_length:.9g} m; "
            f"allowed: at least {ceil(length / carriers.spacing - 1e-9)}, for the cable of {length:.9g} m to fit in",
        )
    if carriers.first is not None and carriers.first > scenario.loop_length:
        yield Fault(
            ("carriers", "first"), f"given {carriers.first!r}; allowed: 0 to {scenario.loop_length:.9g} m, on the loop"
        )
    yield from _bodies(("carriers",), carriers.bodies)


def _name(path: tuple[str, ...], name: str | None = None) -> Iterator[Fault]:
    """The fault of a name that is no good: the last key of its path, or the value there."""
    name = path[-1] if name is None else name
    if not fullmatch(NAME, name):
        yield Fault(path, f"given the name {name!r}; allowed: a letter, then letters, digits and underscores")
