"""Labels: size on a screen, placement without overlap, and one name for several objects at one place."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from os.path import commonprefix
from typing import TypeVar

import numpy as np

from cable_twin.frame.records import FloatArray

LETTER, LINE = 6.4, 16.0  # pixels, width of a letter and height of a line in rerun; measured, rounded up
MARGIN = (8.0, 6.0)  # pixels of background left and right of a text, and above and below it
SAMPLES = 400  # of the highest of several curves
NEAR = 0.025  # distance over the length of the track within which supports share one name, as two do not fit


def label_sizes(texts: Sequence[str]) -> FloatArray:
    """Return width and height (n, 2) in pixels of labels, which may have several lines."""
    lines = [text.split("\n") for text in texts]
    sizes = [(max(map(len, rows)) * LETTER + MARGIN[0], len(rows) * LINE + MARGIN[1]) for rows in lines]
    return np.array(sizes).reshape(-1, 2)


def apart(anchors: FloatArray, sizes: FloatArray, taken: FloatArray | None = None) -> FloatArray:
    """Return label positions, moved forwards along the second axis until no label covers another.

    Labels further forwards are placed first, so that along a slope two rows are enough where only neighbours overlap.
    Missing numbers (NaN) stay missing.

    Args:
        anchors: (..., n, 2), middle of the side of each label with the smaller second coordinate.
        sizes: (n, 2), sizes along both axes.
        taken: (m, 4), anchors and sizes of fixed labels.
    """
    fixed = np.empty((0, 4)) if taken is None else taken
    order = np.argsort(-anchors[..., 1], axis=-1, kind="stable")
    boxes = np.concatenate([anchors, np.broadcast_to(sizes, anchors.shape)], axis=-1)
    boxes = np.take_along_axis(boxes, order[..., None], axis=-2)
    boxes = np.concatenate([np.broadcast_to(fixed, (*anchors.shape[:-2], *fixed.shape)), boxes], axis=-2)
    x, y, width, height = np.moveaxis(boxes, -1, 0)
    for last in range(max(len(fixed), 1), y.shape[-1]):
        before, one = np.s_[..., :last], np.s_[..., last : last + 1]
        beside = np.abs(x[before] - x[one]) < (width[before] + width[one]) / 2.0
        for _ in range(last):
            covered = beside & (y[before] < y[one] + height[one]) & (y[before] + height[before] > y[one])
            if not covered.any():
                break
            beyond = np.where(covered, y[before] + height[before], -np.inf).max(axis=-1, keepdims=True)
            y[one] = np.where(covered.any(axis=-1, keepdims=True), beyond, y[one])
    placed = np.array(anchors, dtype=np.float64)
    np.put_along_axis(placed[..., 1], order, y[..., len(fixed) :], axis=-1)
    return placed


def highest_line(curves: Sequence[FloatArray]) -> FloatArray:
    """Return the upper edge (m, 2) of several curves (n, 2) over their first coordinate; NaN where there is none."""
    x = np.linspace(min(one[:, 0].min() for one in curves), max(one[:, 0].max() for one in curves), SAMPLES)
    heights = []
    for one in curves:
        order = np.argsort(one[:, 0])
        heights.append(np.interp(x, one[order, 0], one[order, 1], left=np.nan, right=np.nan))
    return np.column_stack([x, np.fmax.reduce(heights)])


def above_line(place: FloatArray, width: float, line: FloatArray, ends: tuple[float, float]) -> tuple[float, float]:
    """Return where a label above a point clears a line: share of it left of the point, height of its lower side.

    Of a label in the middle, to the left and to the right, the lowest between the ends counts.

    Args:
        place: (2,), the point.
        width: Width of the label.
        line: (n, 2), the line over its first coordinate.
        ends: Least and greatest first coordinate of the label.
    """
    found = []
    for share in (0.5, 1.0, 0.0):
        low = place[0] - share * width
        if ends[0] <= low and low + width <= ends[1]:
            below = line[(line[:, 0] >= low) & (line[:, 0] <= low + width), 1]
            found.append((float(np.fmax.reduce(below, initial=place[1])), share))
    height, share = min(found, key=lambda one: one[0], default=(float(place[1]), 0.5))
    return share, height


Place = TypeVar("Place", Sequence[float], tuple[float, float, float], FloatArray)


def shared_names(
    places: Mapping[str, Place],
    wheels: Mapping[str, FloatArray],
    ropes: Collection[str] = (),
    near: float = 1e-3,
) -> dict[str, Place]:
    """Give each place one name: if objects share it, the name of a bullwheel, their common prefix, or all names.

    Args:
        places: name -> place (m), x first.
        wheels: name -> (n, 3) m, rim of each bullwheel.
        ropes: names of ropes, each the end of the name of a support of several ropes.
        near: distance (m) along each axis within which objects share a name.
    """
    groups: list[list[str]] = []
    for name, place in places.items():
        group = next((group for group in groups if _distance(places[group[0]], place) <= near), None)
        if group is None:
            groups.append([name])
        else:
            group.append(name)
    names: list[str] = []
    for group in groups:
        wheel = next((name for name, rim in wheels.items() if any(_spans(rim, places[one][0]) for one in group)), None)
        own = list(dict.fromkeys(_without_rope(name, ropes) for name in group)) if len(group) > 1 else group
        ends = all("/" in name for name in own)
        common = commonprefix(own).rstrip("_/") if ends or len(own) == 1 else ""  # noqa: RUF071 - of letters
        name = wheel if wheel and len(group) > 1 else common or ", ".join(own)
        if name in names:
            name = ", ".join(own if ", ".join(own) not in names else group)
        names.append(name)
    return {name: places[group[0]] for name, group in zip(names, groups, strict=True)}


def _distance(one: Sequence[float] | FloatArray, other: Sequence[float] | FloatArray) -> float:
    return float(np.abs(np.subtract(one, other)).max())


def _spans(rim: FloatArray, x: float) -> bool:
    return bool(np.min(rim[:, 0]) <= x <= np.max(rim[:, 0]))


def _without_rope(name: str, ropes: Collection[str]) -> str:
    """Return the name of a tower without the name of its rope at the end."""
    return next((name[: -len(rope) - 1] for rope in ropes if rope and name.endswith(f"_{rope}")), name)
