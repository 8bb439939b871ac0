"""Constants of the mechanics, built from a scenario; a value is copied to the field named like its key."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from math import inf
from typing import Any, get_type_hints

import numpy as np
from pydantic import BaseModel

from cable_twin.mechanics.parameters import FloatArray


def floats(values: list, columns: int = 0) -> FloatArray:
    """Array of floats, shape (n,), or (n, columns) even for n = 0."""
    return np.array(values, dtype=np.float64).reshape((-1, columns) if columns else -1)


def numbers(record: Any, section: BaseModel, pattern: str = "{}") -> dict[str, Any]:
    """Numeric values of a scenario section by field name of a record of constants; null (no limit) becomes infinity.

    Args:
        record: class of the record; keys of the section that it does not have are left out.
        section: section of a scenario.
        pattern: name in the record of a key that the record does not have itself, as in "{}_limit".
    """
    names = _names(record, type(section), pattern, (float, int))
    return {name: _finite_or_inf(getattr(section, key)) for key, name in names.items()}


def columns(
    record: Any, model: type[BaseModel], sections: Sequence[BaseModel], pattern: str = "{}"
) -> dict[str, FloatArray]:
    """Numeric values of several scenario sections as arrays (sections,), by field name of a record of constants.

    Arguments, and null as infinity, are as for `numbers`.
    """
    names = _names(record, model, pattern, (FloatArray,))
    return {name: floats([_finite_or_inf(getattr(one, key)) for one in sections]) for key, name in names.items()}


@cache
def _names(record: Any, model: type[BaseModel], pattern: str, kinds: tuple[Any, ...]) -> dict[str, str]:
    """Map each numeric key of a scenario section to the field of a record of constants that holds its value."""
    found, known = {}, get_type_hints(record)
    for key, field in model.model_fields.items():
        name = key if key in known else pattern.format(key)
        is_number = field.annotation in (float, int, float | None, int | None)
        if is_number and known.get(name) in kinds:
            found[key] = name
    return found


def _finite_or_inf(value: float | None) -> float:
    return inf if value is None else value
