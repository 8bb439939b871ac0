"""Bare rope over its supports with a given tension at one end: elastic catenaries from support to support."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
import scipy  # loads `optimize` where it is used

from cable_twin.basics.units import with_unit
from cable_twin.mechanics.parameters import FloatArray
from cable_twin.mechanics.solution.catenary import elastic_catenary


class SpanError(ValueError):
    """Error of a rope that does not reach from one support to the next with a given tension; one line."""


class Spans(NamedTuple):
    """Rope in a vertical plane over frictionless supports; span k is before support k + 1.

    Attributes:
        corner: (spans + 1, 2) m, x and z of the supports.
        pull: (spans, 2) N, tension at the start of each span, level and upwards along the rope.
        length: (spans,) m, unstrained.
        weight: N/m of unstrained length.
        stiffness: N, EA.
        free_stretch: -, length without tension over the unstrained one.
    """

    corner: FloatArray
    pull: FloatArray
    length: FloatArray
    weight: float
    stiffness: float
    free_stretch: float

    @property
    def pull_after(self) -> FloatArray:
        """Tension vectors (spans, 2) in N at the end of each span: horizontal and upward parts, from start to end."""
        return self.pull + np.stack([np.zeros_like(self.length), self.weight * self.length], axis=1)

    @property
    def tension(self) -> FloatArray:
        """Tension (spans + 1,) in N at the supports."""
        return np.append(np.hypot(*self.pull.T), np.hypot(*self.pull_after[-1]))

    def loads(self) -> FloatArray:
        """Loads (spans - 1, 2) in N of the rope on the supports between both ends, along x and upwards."""
        return self.pull[1:] - self.pull_after[:-1]

    def shape(self, points: int) -> FloatArray:
        """Points (spans * points, 2) in m of the rope, from the start of each span to its end."""
        share = np.linspace(0.0, 1.0, points)[:, None]
        across = elastic_catenary(self.pull[None], share * self.length, self.weight, self.stiffness, self.free_stretch)
        placed: FloatArray = (self.corner[:-1] + across).transpose(1, 0, 2).reshape(-1, 2)
        return placed

    def sags(self, points: int = 21) -> FloatArray:
        """Greatest depth (spans,) in m of the rope below the chord of each span."""
        shape = self.shape(points).reshape(-1, points, 2)
        low, high = self.corner[:-1, None], self.corner[1:, None]
        share = (shape[..., 0] - low[..., 0]) / (high[..., 0] - low[..., 0])
        chord = low[..., 1] + share * (high[..., 1] - low[..., 1])
        return np.asarray((chord - shape[..., 1]).max(axis=1))


def spans_under_tension(
    corner: FloatArray, tension: float, weight: float, stiffness: float, free_stretch: float = 1.0
) -> Spans:
    """Calculate the taut rope over supports with a given tension at its start.

    Args:
        corner: (spans + 1, 2) m, x and z of start, supports and end, in rising x.
        tension: N, at the start.
        weight: N/m of unstrained length, that of evenly spread loads included.
        stiffness: N, EA.
        free_stretch: -, length without tension over the unstrained one.

    Raises:
        SpanError: the tension does not carry the rope over a span.
    """
    pulls, lengths, here = [], [], tension
    for number, (low, high) in enumerate(pairwise(np.asarray(corner, dtype=np.float64)), start=1):
        span = high - low
        pull, length = _span(span, here, weight, stiffness, free_stretch)
        if not length > 0.0:
            over = f"over span {number} of {with_unit(float(span[0]), 'm')}"
            text = f"tension: given {with_unit(here, 'N')}, which does not carry {with_unit(weight, 'N/m')} {over}"
            raise SpanError(f"{text}; allowed: more tension, or shorter spans")
        pulls.append(pull)
        lengths.append(length)
        here = float(np.hypot(pull[0], pull[1] + weight * length))
    return Spans(np.asarray(corner), np.array(pulls), np.array(lengths), weight, stiffness, free_stretch)


def _span(
    span: FloatArray, tension: float, weight: float, stiffness: float, free_stretch: float
) -> tuple[FloatArray, float]:
    """Pull (2,) in N at the start of a span and its unstrained length (m), negative without a solution."""
    chord = float(np.hypot(*span))

    def pull_of(angle: float) -> FloatArray:
        return tension * np.array([np.cos(angle), np.sin(angle)])

    def miss(unknown: FloatArray) -> FloatArray:
        pull, length = pull_of(unknown[0]), unknown[1] * chord
        reached = elastic_catenary(pull, np.array(length), weight, stiffness, free_stretch)
        return np.asarray((reached - span) / chord)

    stretch = free_stretch + tension / stiffness
    dip = weight * chord / (2.0 * tension)  # of a parabola
    first = [
        np.arctan2(span[1], span[0]) - np.arcsin(min(dip * span[0] / chord, 0.9)),
        (1.0 + dip * dip / 6.0) / stretch,
    ]
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
        found = scipy.optimize.root(miss, first, method="hybr", tol=1e-13)
        missed = np.abs(miss(found.x)).max()
    if not missed < 1e-9 or not -np.pi / 2 < found.x[0] < np.pi / 2:
        return pull_of(0.0), -1.0
    return pull_of(float(found.x[0])), float(found.x[1] * chord)
