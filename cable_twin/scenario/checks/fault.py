"""Error messages about scenarios in one wording, and schema fields by key path, with allowed values and units."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from difflib import get_close_matches
from re import fullmatch
from types import UnionType
from typing import Annotated, Any, Literal, NamedTuple, Union, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from cable_twin.scenario.schema import Scenario
from cable_twin.scenario.sections.quantities import OF_KIND

KeyPath = tuple[str | int, ...]

NAME = "[a-zA-Z][a-zA-Z0-9_]*"
NAMES_SHOWN = 8  # of those that are allowed


class Fault(NamedTuple):
    """Error in a scenario: key path, and message with the given value, the reason and the allowed values."""

    path: KeyPath
    text: str


class Phrase(str):
    """Words in an error message in place of the given value, such as "no track for haul_down"."""

    __slots__ = ()


NOTHING = Phrase("nothing")


def refuse(path: KeyPath, given: Any, allowed: str, why: str = "") -> Fault:
    """Build the error for an invalid value, with the message `given VALUE UNIT: WHY; allowed: RANGE UNIT`.

    Args:
        path: key path of the value; the schema has its unit.
        given: the value, or a `Phrase` in its place.
        allowed: the allowed values in words, with their unit.
        why: the reason, where the allowed values do not tell it.
    """
    reason = f": {why}" if why else ""
    return Fault(path, f"given {show(given, unit_of(path))}{reason}; allowed: {allowed}")


def show(value: Any, unit: str = "") -> str:
    """Format a given value for an error message: one short line, numbers with their unit."""
    if isinstance(value, Phrase):
        return str(value)
    if value is None:
        return "null"
    if isinstance(value, Mapping | BaseModel):
        return "a mapping" if value else "an empty mapping"
    value = list(value) if isinstance(value, tuple) else value
    try:
        text = repr(value)
    except ValueError:
        return "a number of thousands of digits"
    numbers = value if isinstance(value, list) and value else [value]
    if unit and all(isinstance(number, int | float) and not isinstance(number, bool) for number in numbers):
        unit = f" {unit}"
    else:
        unit = ""
    return f"{text}{unit}" if len(text) <= 60 else f"{text[:57]}..."


def of_space(path: KeyPath, section: BaseModel, keys: Iterable[str]) -> Iterator[Fault]:
    """Errors of keys of a section in a plane that count in space only, with another value than by default."""
    for key in keys:
        given, default = getattr(section, key), type(section).model_fields[key].default
        if given not in (None, default):
            own = (*path, key)
            yield refuse(own, given, f"{show(default, unit_of(own))}, the default; others in space only", "in a plane")


def listed(names: Iterable[str], otherwise: str) -> str:
    """Join allowed names for an error message, only the first few of many; `otherwise` if there are no names."""
    names = list(names)
    return ", ".join(names[:NAMES_SHOWN]) + (", ..." if len(names) > NAMES_SHOWN else "") if names else otherwise


def name_faults(path: KeyPath, name: str | None = None) -> Iterator[Fault]:
    """Error for an invalid name, which is the last key of a key path, or the value at this path."""
    name = str(path[-1]) if name is None else name
    if not fullmatch(NAME, name):
        yield refuse(
            path, Phrase(f"the name {name!r}"), "a letter A-Z or a-z, then such letters, digits and underscores"
        )


def unknown_key(path: KeyPath, known: Iterable[str]) -> Fault:
    """Error for an unknown key, which suggests the most similar known key or lists all known keys."""
    known = list(known)
    near = get_close_matches(str(path[-1]), known, n=1)
    if near:
        hint = f"did you mean {near[0]!r}?"
    else:
        hint = f"allowed: {', '.join(known)}" if known else "nothing can be set below this"
    return Fault(path, f"this key does not exist; {hint}")


def unit_of(path: KeyPath) -> str:
    """Unit of the value at a key path; empty for a dimensionless number, and for a key that does not exist."""
    try:
        field, _, _ = locate(path)
    except KeyError:
        return ""
    extra = field.json_schema_extra if field is not None else None
    unit = str(extra.get("unit", "")) if isinstance(extra, dict) else ""
    return "" if unit in ("-", OF_KIND) else unit


def inner_model(field: FieldInfo) -> tuple[type | None, type[BaseModel] | None]:
    """Container and section model of a schema field: (None, Cable), (dict, Carriage), (tuple, Load), or no model."""
    annotation, _ = scalar(field.annotation)
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return None, annotation
    if (other := alternative(annotation)) is not None:
        return None, other
    container, inner = get_origin(annotation), get_args(annotation)
    model = {dict: inner[1:2], tuple: inner[:1]}.get(container, ())
    if model and isinstance(model[0], type) and issubclass(model[0], BaseModel):
        return container, model[0]
    return (dict, None) if container is dict else (None, None)


def alternative(annotation: Any) -> type[BaseModel] | None:
    """Section model that a key accepts in place of a number; None without one."""
    if get_origin(annotation) not in (Union, UnionType):
        return None
    members = [get_args(member)[0] if get_origin(member) is Annotated else member for member in get_args(annotation)]
    return next((item for item in members if isinstance(item, type) and issubclass(item, BaseModel)), None)


def locate(path: KeyPath) -> tuple[FieldInfo | None, type[BaseModel] | None, int]:
    """Deepest schema field on a key path, the model at its end, and the number of path parts up to there."""
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
    if field is not None and model is None and get_origin(scalar(field.annotation)[0]) is dict:
        used = min(used + 1, len(path))
    return field, model, used


def scalar(annotation: Any) -> tuple[Any, bool]:
    """Strip Annotated and Optional from an annotation; returns the type and whether null is allowed."""
    if get_origin(annotation) is Annotated:
        return scalar(get_args(annotation)[0])
    if get_origin(annotation) in (Union, UnionType) and type(None) in get_args(annotation):
        return scalar(next(arg for arg in get_args(annotation) if arg is not type(None)))[0], True
    return annotation, False


def allowed(field: FieldInfo | None, *, unit: bool = True) -> str:
    """Allowed values of a schema field in words, with or without its unit."""
    if field is None:
        return "a mapping"
    extra = field.json_schema_extra if isinstance(field.json_schema_extra, dict) else {}
    if "allowed" in extra:
        return str(extra["allowed"])
    container, model = inner_model(field)
    kind, optional = scalar(field.annotation)
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
