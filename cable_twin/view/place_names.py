"""Names of places on a track, with one name for several objects at one place."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from os.path import commonprefix
from typing import TypeVar

import numpy as np

from cable_twin.frame.records import FloatArray

Place = TypeVar("Place", Sequence[float], tuple[float, float, float], FloatArray)
NEAR = 0.025  # of the track, within which supports have one name: letters do not fit between them


def gathered(
    places: Mapping[str, Place],
    wheels: Mapping[str, FloatArray],
    ropes: Collection[str] = (),
    near: float = 1e-3,
) -> dict[str, Place]:
    """Places with one name each: for several names the bullwheel between, their common prefix, or all names.

    Args:
        places: Name -> m, x first.
        wheels: Name -> (n, 3) m, rims of bullwheels.
        ropes: Names of ropes; a tower that bears several has the name of each behind its own one.
        near: m, along each axis from the first of some, within which others stand together with it.
    """
    groups: list[list[str]] = []
    for name, place in places.items():
        group = next((some for some in groups if _distance(places[some[0]], place) <= near), None)
        if group is None:
            groups.append([name])
        else:
            group.append(name)
    called = []
    for some in groups:
        between = [name for name, rim in wheels.items() if any(_spans(rim, places[one][0]) for one in some)]
        own = list(dict.fromkeys(_without_rope(name, ropes) for name in some)) if len(some) > 1 else some
        ends = all("/" in name for name in own)
        common = commonprefix(own).rstrip("_/") if ends or len(own) == 1 else ""  # noqa: RUF071 - of letters
        name = between[0] if between and len(some) > 1 else common or ", ".join(own)
        if name in called:
            name = ", ".join(own if ", ".join(own) not in called else some)
        called.append(name)
    return {name: places[some[0]] for name, some in zip(called, groups, strict=True)}


def _distance(one: Sequence[float] | FloatArray, other: Sequence[float] | FloatArray) -> float:
    return float(np.abs(np.subtract(one, other)).max())


def _spans(rim: FloatArray, x: float) -> bool:
    return bool(np.min(rim[:, 0]) <= x <= np.max(rim[:, 0]))


def _without_rope(name: str, ropes: Collection[str]) -> str:
    """Return the name of a tower without the name of its strand."""
    return next((name[: -len(rope) - 1] for rope in ropes if rope and name.endswith(f"_{rope}")), name)


__all__ = ["NEAR", "gathered"]
