"""Overrides of scenario values by dotted key: parsing of KEY=VALUE, and assignment to one place."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from cable_twin.basics.limited_yaml import UnreadableYamlError, read_yaml
from cable_twin.scenario.checks.fault import Fault, KeyPath
from cable_twin.scenario.checks.find_faults import inner_model, unknown_key
from cable_twin.scenario.schema import Scenario

AXES = ("x", "y", "z")
OF_AIR = "wind"  # begins a short key


class UnknownKeyError(ValueError):
    """Error of a dotted key that does not exist in a scenario.

    Attributes:
        fault: the key, and what is allowed there.
    """

    def __init__(self, fault: Fault) -> None:
        super().__init__(fault.text)
        self.fault = fault


def assignment(text: str) -> tuple[str, Any]:
    """Parse KEY=VALUE into key and value, the value in YAML.

    Raises:
        ValueError: one line with what was given and what is allowed.
    """
    key, equals, value = text.partition("=")
    if not equals or not key.strip():
        raise ValueError(f"{text!r} given, KEY=VALUE is needed")
    try:
        return key.strip(), read_yaml(value).content
    except (UnreadableYamlError, ValueError):
        raise ValueError(f"{text!r} given, the value is not YAML") from None


def full_key(key: str) -> str:
    """Full key of a short key: `wind.y` is `air.wind.y`, `wind.turbulence` is `air.turbulence`."""
    first, _, rest = key.partition(".")
    if first != OF_AIR:
        return key
    last = rest.partition(".")[0]
    return f"air.{key}" if not rest or last in AXES or last.isdecimal() else f"air.{rest}"


def override(data: dict[str, Any], key: str, value: Any) -> KeyPath:
    """Set one value by its dotted key; in a list, the key ends with an axis or an index from 0 on.

    Carriages, bodies and other things with names must be there, or are given whole; other sections are made.

    Args:
        data: a scenario as plain data; what is changed in it is a copy.
        key: dotted, in full.
        value: as plain data.

    Returns:
        Path of what changed: the key, or the list in which it ends.

    Raises:
        UnknownKeyError: there is no such place.
    """
    parts = key.split(".")
    data.update(_in_model(data, Scenario, parts, value, ()))
    node: Any = data
    for depth, part in enumerate(parts):
        if isinstance(node, list):
            return tuple(parts[:depth])
        node = node.get(part) if isinstance(node, dict) else None
    return tuple(parts)


def put_into_list(items: Sequence[Any], parts: Sequence[str], value: Any, path: KeyPath) -> list[Any]:
    """Copy of a list with one value set; setting y turns a vector of two numbers into one of three.

    Args:
        items: numbers, or lists of them; they stay as they are.
        parts: of the key below the list.
        value: as plain data.
        path: of the list.

    Raises:
        UnknownKeyError: it has no such place.
    """
    part, *rest = parts
    items = list(items)
    vector = 2 <= len(items) <= 3 and not any(isinstance(item, list | tuple | dict) for item in items)
    if vector and part in AXES:
        items = [items[0], 0.0, items[1]] if part == "y" and len(items) == 2 else items
        row = min(AXES.index(part), len(items) - 1)
    elif part.isdecimal() and int(part) < len(items):
        row = int(part)
    else:
        axes = f"{', '.join(AXES)} or " if vector else ""
        known = f"allowed: {axes}a number from 0 to {len(items) - 1}" if items else "nothing can be set below this"
        raise UnknownKeyError(Fault((*path, part), f"this key does not exist; {known}"))
    if rest and not isinstance(items[row], list | tuple):
        raise UnknownKeyError(unknown_key((*path, part, rest[0]), ()))
    items[row] = put_into_list(items[row], rest, value, (*path, part)) if rest else value
    return items


def _in_model(node: Any, model: type[BaseModel], parts: Sequence[str], value: Any, path: KeyPath) -> Any:
    """Copy of a section with one value set."""
    part, *rest = parts
    if part not in model.model_fields:
        raise UnknownKeyError(unknown_key((*path, part), model.model_fields))
    if node is None or isinstance(node, int | float):  # left out, or a number where a mapping may stand too
        node = {}
    if not isinstance(node, dict):
        return node  # a fault of its own
    if not rest:
        return {**node, part: value}
    return {**node, part: _in_field(node.get(part), model.model_fields[part], rest, value, (*path, part))}


def _in_field(node: Any, field: FieldInfo, parts: Sequence[str], value: Any, path: KeyPath) -> Any:
    """Copy of the content of a field with one value set."""
    container, model = inner_model(field)
    if container is None and model is not None:
        return _in_model(node, model, parts, value, path)
    if container is dict:
        return _in_names({} if node is None else node, model, parts, value, path)
    if node is None and not field.is_required():
        node = field.get_default(call_default_factory=True)
    if not isinstance(node, list | tuple):
        raise UnknownKeyError(unknown_key((*path, parts[0]), ()))
    if model is None or not parts[1:] or not parts[0].isdecimal() or int(parts[0]) >= len(node):
        return put_into_list(node, parts, value, path)
    items, row = list(node), int(parts[0])
    items[row] = _in_model(items[row], model, parts[1:], value, (*path, parts[0]))
    return items


def _in_names(node: Any, model: type[BaseModel] | None, parts: Sequence[str], value: Any, path: KeyPath) -> Any:
    """Copy of a mapping of names with one value set, or with a new entry given whole."""
    if not isinstance(node, dict):
        return node  # a fault of its own
    part, *rest = parts
    whole = not rest and model is not None and isinstance(value, dict)
    if part not in node and not whole:
        fault = unknown_key((*path, part), node)
        if model is not None and not node:
            key = ".".join(map(str, (*path, part)))
            fault = Fault(fault.path, f"there is none yet; allowed: a whole one, as in {key}={{...}}")
        raise UnknownKeyError(fault)
    if not rest:
        return {**node, part: value}
    if model is None:
        raise UnknownKeyError(unknown_key((*path, part, rest[0]), ()))
    return {**node, part: _in_model(node[part], model, rest, value, (*path, part))}


__all__ = ["UnknownKeyError", "assignment", "full_key", "override", "put_into_list"]
