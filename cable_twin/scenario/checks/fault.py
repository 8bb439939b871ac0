"""Fault of a scenario, and the wording of given values in its message."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from re import fullmatch
from typing import Any, NamedTuple

KeyPath = tuple[str | int, ...]

NAME = "[a-zA-Z][a-zA-Z0-9_]*"


class Fault(NamedTuple):
    """One fault of a scenario: key path, and text on the given and the allowed value."""

    path: KeyPath
    text: str


def refuse(path: KeyPath, given: Any, allowed: str, *, detail: str = "") -> Fault:
    """Fault of a key: its value, what about it matters, and the values that are allowed, with their unit.

    Args:
        path: of the key.
        given: its value.
        allowed: values and unit, and why.
        detail: behind the value, with the space or comma between them.
    """
    return Fault(path, f"given {show(given)}{detail}; allowed: {allowed}")


def show(value: Any) -> str:
    """Format a given value on one short line."""
    if value is None:
        return "null"
    if isinstance(value, Mapping):
        return "a mapping" if value else "an empty mapping"
    try:
        text = repr(value)
    except ValueError:
        return "a number of thousands of digits"
    return text if len(text) <= 60 else f"{text[:57]}..."


def name_faults(path: tuple[str, ...], name: str | None = None) -> Iterator[Fault]:
    """Fault of an invalid name: the last key of its path, or the value at this path."""
    name = path[-1] if name is None else name
    if not fullmatch(NAME, name):
        yield Fault(path, f"given the name {name!r}; allowed: a letter, then letters, digits and underscores")
