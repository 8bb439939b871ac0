"""Line chart as inline SVG: numbers as text, lines told apart by dashes, so that it can be printed in black."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from html import escape
from typing import NamedTuple

import numpy as np

from cable_twin.basics.units import rounded
from cable_twin.frame.records import FloatArray

WIDTH = 760.0  # px of a drawing, as wide as the text of a page
LEFT, RIGHT, TOP, BOTTOM = 64.0, 14.0, 26.0, 40.0  # px around the axes
LETTER = 6.2  # px, mean width of a letter of the legend
TICKS = 6  # about as many on an axis
STEPS = 1.0, 2.0, 2.5, 5.0, 10.0  # of ticks, times a power of ten
INK, QUIET, GRID, LIMIT = "#1b2730", "#6b7780", "#dfe4e8", "#a3241b"


class Look(NamedTuple):
    """Look of a line in a chart: colour, dashes (px, empty for a solid line) and width (px)."""

    color: str = INK
    dashes: str = ""
    width: float = 1.4


# in this order dashes alone tell lines apart, and the greys of the colours do so where they do not
LOOKS = (
    Look("#00497a"),
    Look("#b04a00", "7 3"),
    Look("#00684b", "2 2.5"),
    Look("#8a3d74", "9 3 2 3"),
    Look("#1b2730", "1 4"),
    Look("#5a6a75", "14 4"),
)
LIMIT_LOOK = Look(LIMIT, "12 3 2 3 2 3", 1.6)


class Mark(NamedTuple):
    """Text beside a point of a chart, with an anchor: start, middle or end."""

    x: float
    y: float
    text: str
    anchor: str = "middle"
    up: float = 6.0  # px above the point


class Chart:
    """Chart with two axes as SVG, to which lines, areas, arrows and marks are added.

    Args:
        title: of the chart, for screen readers.
        x, y: ranges of the axes; empty ones are widened.
        labels: of both axes, with unit.
        height: px.
        rows: names of values in place of numbers on the vertical axis.
    """

    def __init__(
        self,
        title: str,
        x: tuple[float, float],
        y: tuple[float, float],
        labels: tuple[str, str],
        *,
        height: float = 240.0,
        rows: Mapping[float, str] | None = None,
    ) -> None:
        self._title, self._labels, self._height, self._rows = title, labels, height, rows
        self._x, self._y = _widened(*x), _widened(*y)
        self._parts: list[str] = []
        self._legend: list[tuple[str, Look]] = []

    def _at(self, x: float, y: float) -> tuple[float, float]:
        (x_low, x_high), (y_low, y_high) = self._x, self._y
        return (
            LEFT + (x - x_low) / (x_high - x_low) * (WIDTH - LEFT - RIGHT),
            self._height - BOTTOM - (y - y_low) / (y_high - y_low) * (self._height - TOP - BOTTOM),
        )

    def line(self, x: FloatArray, y: FloatArray, look: Look, label: str = "") -> None:
        """Add a line through points to the chart, with gaps at NaN; a line with a label is in the legend."""
        for part in _runs(np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)):
            points = " ".join(f"{px:.1f},{py:.1f}" for px, py in (self._at(*point) for point in part))
            self._parts.append(f'<polyline points="{points}" fill="none"{_stroke(look)}/>')
        if label:
            self._legend.append((label, look))

    def level(self, y: float, label: str, look: Look = LIMIT_LOOK) -> None:
        """Add a horizontal line over the whole width of the chart, such as a limit, with a label in its middle."""
        (left, height), (right, _) = self._at(self._x[0], y), self._at(self._x[1], y)
        self._parts.append(
            f'<line x1="{left:.1f}" y1="{height:.1f}" x2="{right:.1f}" y2="{height:.1f}"{_stroke(look)}/>'
        )
        self._parts.append(_text(0.5 * (left + right), height - 4.0, label, "middle", bold=True, halo=True))

    def area(self, x: FloatArray, low: FloatArray, high: FloatArray, color: str = QUIET, opacity: float = 0.18) -> None:
        """Add a filled area between two lines over x to the chart."""
        seen = np.isfinite(low) & np.isfinite(high)
        if not seen.any():
            return
        both = np.concatenate([np.column_stack([x, high])[seen], np.column_stack([x, low])[seen][::-1]])
        points = " ".join(f"{px:.1f},{py:.1f}" for px, py in (self._at(*point) for point in both))
        self._parts.append(f'<polygon points="{points}" fill="{color}" fill-opacity="{opacity}" stroke="none"/>')

    def arrow(self, x: float, y: float, along: float, up: float, look: Look) -> None:
        """Add an arrow from a point of the chart, with components in px; a negative `up` points down."""
        left, top = self._at(x, y)
        right, bottom = left + along, top - up
        size = math.hypot(along, up)
        if not size >= 1.0:  # NaN, too
            return
        self._parts.append(f'<line x1="{left:.1f}" y1="{top:.1f}" x2="{right:.1f}" y2="{bottom:.1f}"{_stroke(look)}/>')
        cos, sin = along / size, -up / size
        corners = ((0.0, 0.0), (-7.0, 2.6), (-7.0, -2.6))
        head = " ".join(f"{right + a * cos - b * sin:.1f},{bottom + a * sin + b * cos:.1f}" for a, b in corners)
        self._parts.append(f'<polygon points="{head}" fill="{look.color}" stroke="none"/>')

    def dot(self, x: float, y: float, color: str = INK) -> None:
        """Add a dot at a point of the chart."""
        left, top = self._at(x, y)
        self._parts.append(f'<circle cx="{left:.1f}" cy="{top:.1f}" r="2.6" fill="{color}"/>')

    def mark(self, mark: Mark) -> None:
        """Add a text beside a point of the chart."""
        left, top = self._at(mark.x, mark.y)
        self._parts.append(_text(left, top - mark.up, mark.text, mark.anchor, halo=True))

    def beside(self, text: str, y: float, up: float) -> None:
        """Add a text to the left of the vertical axis, `up` px above a value."""
        left, top = self._at(self._x[0], y)
        self._parts.append(_text(left - 5.0, top - up, text, "end"))

    def named(self, label: str, look: Look) -> None:
        """Add a label to the legend of the chart, without a line."""
        self._legend.append((label, look))

    def svg(self) -> str:
        """SVG text of the chart, an `svg` element."""
        title = escape(self._title)
        return "\n".join(
            [
                f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH:g} {self._height:g}" '
                f'width="{WIDTH:g}" height="{self._height:g}" role="img" aria-label="{title}" '
                'font-family="DejaVu Sans, Verdana, sans-serif" font-size="10.5">',
                f"<title>{title}</title>",
                *self._axes(),
                *self._parts,
                *self._legend_parts(),
                "</svg>",
            ]
        )

    def _axes(self) -> list[str]:
        (left, bottom), (right, top) = self._at(self._x[0], self._y[0]), self._at(self._x[1], self._y[1])
        found: list[str] = []
        for value in ticks(*self._x):
            place, _ = self._at(value, 0.0)
            found.append(f'<line x1="{place:.1f}" y1="{bottom:.1f}" x2="{place:.1f}" y2="{top:.1f}" stroke="{GRID}"/>')
            found.append(_text(place, bottom + 13.0, rounded(value), "middle", QUIET))
        for value, named in (self._rows or {one: rounded(one) for one in ticks(*self._y)}).items():
            _, place = self._at(0.0, value)
            found.append(f'<line x1="{left:.1f}" y1="{place:.1f}" x2="{right:.1f}" y2="{place:.1f}" stroke="{GRID}"/>')
            found.append(_text(left - 5.0, place + 3.6, named, "end", QUIET))
        found.append(f'<path d="M{left:.1f},{top:.1f}V{bottom:.1f}H{right:.1f}" fill="none" stroke="{QUIET}"/>')
        found.append(_text(0.5 * (left + right), self._height - 8.0, self._labels[0], "middle"))
        middle = 0.5 * (top + bottom)
        turned = f'transform="rotate(-90 12 {middle:.1f})"'
        found.append(f'<text x="12" y="{middle:.1f}" text-anchor="middle" fill="{INK}" {turned}>'
                     f"{escape(self._labels[1])}</text>")  # fmt: skip
        return found

    def _legend_parts(self) -> list[str]:
        found: list[str] = []
        place = LEFT
        for label, look in self._legend:
            if place + 36.0 + LETTER * len(label) > WIDTH and found:
                break  # what has no room is named in the table below
            found.append(f'<line x1="{place:.1f}" y1="12" x2="{place + 28.0:.1f}" y2="12"{_stroke(look)}/>')
            found.append(_text(place + 33.0, 15.6, label, "start"))
            place += 50.0 + LETTER * len(label)
        return found


def ticks(low: float, high: float) -> list[float]:
    """Round values within a range for the ticks of an axis, about `TICKS` of them."""
    raw = (high - low) / TICKS
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(one * power for one in STEPS if one * power >= raw * (1.0 - 1e-9))
    first = math.ceil(low / step - 1e-9)
    return [number * step + 0.0 for number in range(first, math.floor(high / step + 1e-9) + 1)]


def span(values: Sequence[FloatArray | float], *, zero: bool = False, margin: float = 0.06) -> tuple[float, float]:
    """Range of all finite values for an axis, with a margin as a share of the range."""
    flat = np.concatenate([np.atleast_1d(np.asarray(one, dtype=np.float64)).ravel() for one in values])
    flat = flat[np.isfinite(flat)]
    low, high = (float(flat.min()), float(flat.max())) if flat.size else (0.0, 1.0)
    low, high = (min(low, 0.0), max(high, 0.0)) if zero else (low, high)
    low, high = _widened(low, high)
    return low - margin * (high - low), high + margin * (high - low)


def _widened(low: float, high: float) -> tuple[float, float]:
    """Widen the range of an axis where it is empty or spans rounding errors alone."""
    least = 1e-6 * max(abs(low), abs(high), 1e-3)
    if high - low > least:
        return low, high
    half = 0.05 * max(abs(low), 1.0)
    return low - half, high + half


def _runs(x: FloatArray, y: FloatArray) -> list[FloatArray]:
    """Split a line at its gaps (NaN) into stretches (n, 2) of points."""
    seen = np.isfinite(x) & np.isfinite(y)
    points = np.column_stack([x, y])
    edges = np.flatnonzero(np.diff(seen.astype(np.int8))) + 1
    parts = zip(np.split(points, edges), np.split(seen, edges), strict=True)
    return [part for part, here in parts if here.size and here[0]]


def _stroke(look: Look) -> str:
    dashes = f' stroke-dasharray="{look.dashes}"' if look.dashes else ""
    return f' stroke="{look.color}" stroke-width="{look.width:g}"{dashes}'


def _text(
    x: float, y: float, text: str, anchor: str, color: str = INK, *, bold: bool = False, halo: bool = False
) -> str:
    """SVG text at a place (px), with a white halo to be read in front of lines."""
    weight = ' font-weight="bold"' if bold else ""
    start = f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}"{weight}'
    behind = (
        f'{start} fill="none" stroke="#fff" stroke-width="3" aria-hidden="true">{escape(text)}</text>' if halo else ""
    )
    return f'{behind}{start} fill="{color}">{escape(text)}</text>'
