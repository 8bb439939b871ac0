"""Simulation of other scenario values on the compiled system, mesh and memory of an existing one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, TypeVar

import numpy as np

from cable_twin.mechanics.language.by_reference import Known
from cable_twin.mechanics.parameters import FloatArray
from cable_twin.scenario import Scenario

MAY_SWITCH = {"drive_stops", "tensioning", "cell_element"}  # conditions and numbers that are no structure
R = TypeVar("R")


class OtherModelError(ValueError):
    """Error of a scenario value that would need another mesh, other parts or another solver; one line."""


def check_same_parts(scenario: Scenario, like: Scenario) -> None:
    """Refuse a scenario with other ropes, vehicles, supports or drives, other meshes or another solver.

    Raises:
        OtherModelError: one line with the first difference.
    """
    for part in ("cables", "vehicles", "towers", "drives", "sheaves", "connectors", "pantographs"):
        if list(getattr(scenario, part)) != list(getattr(like, part)):
            raise OtherModelError(f"other {part}")
    if scenario.solver != like.solver:
        raise OtherModelError("another solver")
    if scenario.dim != like.dim:
        raise OtherModelError("another dimension (a plane, or space)")
    if (scenario.air.turbulence is None) != (like.air.turbulence is None):
        raise OtherModelError(f"{'no ' if like.air.turbulence else ''}air.turbulence in the scenario of all")
    for own, other in zip(scenario.cables.values(), like.cables.values(), strict=True):
        if own.elements != other.elements or own.unstrained_length != other.unstrained_length:
            raise OtherModelError("another mesh")
        if own.elastic_model != other.elastic_model:
            raise OtherModelError("another elastic model")


def check_same_meshes(meshes: Sequence[FloatArray], like: Sequence[FloatArray]) -> None:
    """Refuse meshes, by the arc lengths of their nodes, that are not equal to the last bit.

    Raises:
        OtherModelError: a mesh differs.
    """
    if not all(np.array_equal(own, other) for own, other in zip(meshes, like, strict=True)):
        raise OtherModelError("another mesh")


def check_same_structure(records: Sequence[Any], like: Sequence[Any]) -> None:
    """Refuse parameter records whose arrays have other sizes, or other indices.

    Raises:
        OtherModelError: one line with the first difference.
    """
    for record, other in zip(records, like, strict=True):
        for name in _differences(record, other):
            raise OtherModelError(f"another {name.replace('_', ' ')}")


def _differences(record: Any, like: Any, name: str = "") -> Iterator[str]:
    """Names of fields of two parameter records that differ in type, size or index."""
    if isinstance(record, tuple) and hasattr(record, "_fields"):
        for field, own, other in zip(record._fields, record, like, strict=True):
            yield from _differences(own, other, field)
    elif isinstance(record, np.ndarray):
        fixed = record.dtype != np.float64 and name not in MAY_SWITCH
        if record.shape != like.shape or record.dtype != like.dtype or (fixed and not np.array_equal(record, like)):
            yield name
    elif type(record) is not type(like) or (_is_whole(record) and record != like):
        yield name


def _is_whole(record: Any) -> bool:
    """Whether a field of a parameter record holds an integer: a count or a compile-time constant, not True or False."""
    return isinstance(record, Known) or (isinstance(record, int) and not isinstance(record, bool))


def sharing(record: R, like: Any) -> R:
    """Copy of a parameter record that shares all equal arrays and inner records with another one."""
    if isinstance(record, np.ndarray):
        equal = record.shape == like.shape and record.tobytes() == like.tobytes()
        return like if equal else record  # type: ignore[return-value]
    if isinstance(record, tuple) and hasattr(record, "_fields"):
        fields = [sharing(own, other) for own, other in zip(record, like, strict=True)]
        same = all(own is other or _is_equal_number(own, other) for own, other in zip(fields, like, strict=True))
        return like if same else type(record)(*fields)  # type: ignore[return-value]
    return record


def _is_equal_number(own: Any, other: Any) -> bool:
    if not isinstance(own, bool | int | float | tuple) or hasattr(own, "_fields"):
        return False
    return type(own) is type(other) and bool(own == other)
