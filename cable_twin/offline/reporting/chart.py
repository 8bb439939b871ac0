"""Line chart as inline SVG: numbers as text, lines told apart by dashes, so that it can be printed in black."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from html import escape
from textwrap import wrap
from typing import NamedTuple

import numpy as np

from cable_twin.basics.units import rounded
from cable_twin.frame.records import FloatArray
from cable_twin.view.labels import above_line

WIDTH = 760.0  # px of a drawing, as wide as the text of a page
LEFT, RIGHT, TOP, BOTTOM = 64.0, 14.0, 26.0, 40.0  # px around the axes
LETTER = 6.4  # px, mean width of a letter
LONGEST_NAME = 24  # letters in a line of a name
ANCHORS = {0.0: "start", 0.5: "middle", 1.0: "end"}  # of a text, by the share of it left of its place
NAMES = 26.0  # px, left of the names of rows, for the label of the vertical axis
ROW, LEGEND_ROW = 13.0, 15.0  # px, height of a row of texts below the range of a chart, and of its legend
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


class Box(NamedTuple):
    """Box of a chart (px) that a line or a text takes."""

    left: float
    right: float
    top: float
    bottom: float

    def covers(self, other: Box) -> bool:
        """Whether this box and another one overlap."""
        return (
            self.left < other.right and other.left < self.right and self.top < other.bottom and other.top < self.bottom
        )


class Chart:
    """Chart with two axes as SVG, to which lines, areas, arrows and marks are added.

    Args:
        title: of the chart, for screen readers.
        x, y: ranges of the axes; empty ones are widened.
        labels: of both axes, with unit.
        height: px.
        rows: names of values in place of numbers on the vertical axis.
        below: names of rows for texts below the vertical range.

    Attributes:
        floor: value of the vertical axis at its lower end, below those rows.
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
        below: Sequence[str] = (),
    ) -> None:
        self._title, self._labels, self._rows, self._below = title, labels, rows, tuple(below)
        room = ROW * len(below) + 8.0 if below else 0.0
        self._height = height + room
        names = [*(rows or {}).values(), *below]
        self._left = max(LEFT, NAMES + LETTER * max(map(len, names), default=0))
        self._x, self._seen = _widened(*x), _widened(*y)
        low, high = self._seen
        self.floor = low - room / (height - TOP - BOTTOM) * (high - low)
        self._y = self.floor, high
        self._parts: list[str] = []
        self._taken: list[Box] = []  # by levels and their labels, arrows and stacked texts
        self._legend: list[tuple[str, Look]] = []

    def _at(self, x: float, y: float) -> tuple[float, float]:
        (x_low, x_high), (y_low, y_high) = self._x, self._y
        return (
            self._left + (x - x_low) / (x_high - x_low) * (WIDTH - self._left - RIGHT),
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
        middle = 0.5 * (left + right)
        self._parts.append(_text(middle, height - 4.0, label, "middle", bold=True, halo=True))
        self._taken += [Box(left, right, height - 1.0, height + 1.0), _box(middle, height - 4.0, label, "middle")]

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
        self._taken.append(Box(*sorted((left, right)), *sorted((top, bottom))))
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
        """Add a text beside a point of the chart; on the other side of it where a level would strike it through."""
        left, top = self._at(mark.x, mark.y)
        sides = [top - up for up in (mark.up, -mark.up - 7.0)]
        free = [y for y in sides if not any(map(_box(left, y, mark.text, mark.anchor).covers, self._taken))]
        self._parts.append(_text(left, (free or sides)[0], mark.text, mark.anchor, halo=True))

    def stacked(self, x: float, y: float, text: str, up: float) -> float:
        """Add a text above a point of the chart, or below it, farther from it until it covers no text or arrow.

        Args:
            x: of the point.
            y: of the point.
            text: within the width of the axes.
            up: px, least distance of its base line above the point; negative below it.

        Returns:
            The distance (px) at which it stands.
        """
        left, top = self._at(x, y)
        half = 0.5 * LETTER * len(text)
        left = min(max(left, self._left + half + 2.0), max(WIDTH - half, self._left + half + 2.0))
        while any(map(_box(left, top - up, text, "middle").covers, self._taken)):
            up += math.copysign(ROW, up)
        self._taken.append(_box(left, top - up, text, "middle"))
        self._parts.append(_text(left, top - up, text, "middle", halo=True))
        return up

    def name(self, x: float, y: float, name: str, curve: FloatArray) -> None:
        """Add a name above a point of the chart, so that a curve (n, 2) does not run through it."""
        lines = wrap(name, LONGEST_NAME)
        drawn = np.array([self._at(*point) for point in curve]) * (1.0, -1.0)
        left, top = self._at(x, y)
        width = LETTER * max(map(len, lines))
        share, height = above_line(np.array([left, -top]), width, drawn, (self._left, WIDTH - RIGHT))
        for number, line in enumerate(reversed(lines)):
            self._parts.append(_text(left, -height - 7.0 - ROW * number, line, ANCHORS[share], halo=True))

    def note(self, x: float, row: str, text: str) -> None:
        """Add a text at a place of the horizontal axis to a row below the vertical range."""
        left, _ = self._at(x, 0.0)
        self._parts.append(_text(left, self._row(row), text, "middle", halo=True))

    def _row(self, row: str) -> float:
        """Vertical place (px) of the texts of a row below the vertical range."""
        return self._height - BOTTOM - 6.0 - ROW * (len(self._below) - 1 - self._below.index(row))

    def named(self, label: str, look: Look) -> None:
        """Add a label to the legend of the chart, without a line."""
        self._legend.append((label, look))

    def svg(self) -> str:
        """SVG text of the chart, an `svg` element."""
        title = escape(self._title)
        legend, rows = self._legend_parts()
        down = LEGEND_ROW * (rows - 1)
        height = self._height + down
        return "\n".join(
            [
                f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH:g} {height:g}" '
                f'width="{WIDTH:g}" height="{height:g}" role="img" aria-label="{title}" '
                'font-family="DejaVu Sans, Verdana, sans-serif" font-size="10.5">',
                f"<title>{title}</title>",
                *legend,
                f'<g transform="translate(0 {down:g})">',
                *self._axes(),
                *self._parts,
                "</g></svg>",
            ]
        )

    def _axes(self) -> list[str]:
        (left, bottom), (right, top) = self._at(self._x[0], self._y[0]), self._at(self._x[1], self._y[1])
        found: list[str] = []
        for value, named in labelled_ticks(*self._x).items():
            place, _ = self._at(value, 0.0)
            found.append(f'<line x1="{place:.1f}" y1="{bottom:.1f}" x2="{place:.1f}" y2="{top:.1f}" stroke="{GRID}"/>')
            found.append(_text(place, bottom + 13.0, named, "middle", QUIET))
        for value, named in (self._rows or labelled_ticks(*self._seen)).items():
            _, place = self._at(0.0, value)
            found.append(f'<line x1="{left:.1f}" y1="{place:.1f}" x2="{right:.1f}" y2="{place:.1f}" stroke="{GRID}"/>')
            found.append(_text(left - 5.0, place + 3.6, named, "end", QUIET))
        found += [_text(left - 5.0, self._row(named), named, "end") for named in self._below]
        found.append(f'<path d="M{left:.1f},{top:.1f}V{bottom:.1f}H{right:.1f}" fill="none" stroke="{QUIET}"/>')
        found.append(_text(0.5 * (left + right), self._height - 8.0, self._labels[0], "middle"))
        middle = 0.5 * (top + bottom)
        turned = f'transform="rotate(-90 12 {middle:.1f})"'
        found.append(f'<text x="12" y="{middle:.1f}" text-anchor="middle" fill="{INK}" {turned}>'
                     f"{escape(self._labels[1])}</text>")  # fmt: skip
        return found

    def _legend_parts(self) -> tuple[list[str], int]:
        """SVG parts of the legend and the number of its rows."""
        found: list[str] = []
        place, row = self._left, 0
        for label, look in self._legend:
            width = 50.0 + LETTER * len(label)
            if place + width - 14.0 > WIDTH and place > self._left:
                place, row = self._left, row + 1
            y = 12.0 + LEGEND_ROW * row
            found.append(f'<line x1="{place:.1f}" y1="{y:g}" x2="{place + 28.0:.1f}" y2="{y:g}"{_stroke(look)}/>')
            found.append(_text(place + 33.0, y + 3.6, label, "start"))
            place += width
        return found, row + 1


def ticks(low: float, high: float) -> list[float]:
    """Round values within a range for the ticks of an axis, about `TICKS` of them."""
    raw = (high - low) / TICKS
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(one * power for one in STEPS if one * power >= raw * (1.0 - 1e-9))
    first = math.ceil(low / step - 1e-9)
    return [number * step + 0.0 for number in range(first, math.floor(high / step + 1e-9) + 1)]


def labelled_ticks(low: float, high: float) -> dict[float, str]:
    """Label of each tick within a range, with as many digits as tell it from the next one."""
    values = ticks(low, high)
    largest, between = max(map(abs, values), default=1.0), (high - low) / TICKS
    digits = max(4, math.floor(math.log10(largest or 1.0)) - math.floor(math.log10(between)) + 2)
    return {value: rounded(value, digits) for value in values}


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


def _box(x: float, y: float, text: str, anchor: str) -> Box:
    """Box of a text with its base line at a place (px)."""
    width = LETTER * len(text)
    left = x - width * next(share for share, name in ANCHORS.items() if name == anchor)
    return Box(left, left + width, y - 9.0, y + 3.0)
