"""Placement of labels without overlap, and their size on a screen."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cable_twin.frame.records import FloatArray

LETTER, LINE = 6.4, 16.0  # pixels of rerun, across and along a text; measured on its pictures, rounded up
MARGIN = (8.0, 6.0)  # pixels of its ground around a text, both sides together


def label_sizes(texts: Sequence[str]) -> FloatArray:
    """Return width and height (n, 2) in pixels of labels, which may have several lines."""
    lines = [text.split("\n") for text in texts]
    sizes = [(max(map(len, rows)) * LETTER + MARGIN[0], len(rows) * LINE + MARGIN[1]) for rows in lines]
    return np.array(sizes).reshape(-1, 2)


def apart(anchors: FloatArray, sizes: FloatArray, taken: FloatArray | None = None) -> FloatArray:
    """Return label positions after moves along the second axis, only forwards, until no label covers another.

    Those that are further on keep their places before others, so that along a slope two rows are enough where only
    neighbours meet. Numbers that are missing (NaN) stay so.

    Args:
        anchors: (..., n, 2), of each label the middle of the side with the lesser second coordinate.
        sizes: (n, 2), along both axes.
        taken: (m, 4), anchors and sizes of others, which stay where they are.
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


__all__ = ["apart", "label_sizes"]
