"""Sobol indices of the key figures of a study: shares of their variance due to each varied key."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cable_twin.basics.units import NORMAL_95, shown_unit
from cable_twin.frame.records import FloatArray
from cable_twin.key_figures.shown import NOISE
from cable_twin.offline.studies.design import Design
from cable_twin.offline.studies.record import Results, whole_file

SPREAD = 1e-9  # of the size of a figure: with less it does not vary


class Index(NamedTuple):
    """Sobol index with the ends of its 95 % confidence interval."""

    value: float
    low: float
    high: float


class Indices(NamedTuple):
    """First-order and total Sobol indices of a key figure, by varied key."""

    first: Mapping[str, Index]
    total: Mapping[str, Index]


def indices_of(design: Design, results: Results) -> tuple[dict[str, Indices], list[str]]:
    """Sobol indices of all key figures of a study, by id, and ids of key figures that some case lacks.

    Figures that do not vary have no indices. The estimators are those of `scipy.stats.sobol_indices` (Saltelli 2010),
    ratios of means over the rows of the design; intervals follow from their linearisation, as for independent rows.

    Args:
        design: design of the method sobol.
        results: results of all cases.
    """
    from scipy.stats import sobol_indices  # noqa: PLC0415 - half a second

    base, size = design.base, len(design.factors)
    found, without = {}, []
    for key, values in results.figures.items():
        if not np.isfinite(values).all():
            without.append(key)
            continue
        if not varies(results, key):
            continue
        blocks = values.reshape(size + 2, base)
        one = sobol_indices(func={"f_A": blocks[:1], "f_B": blocks[1:2], "f_AB": blocks[2:, None, :]}, n=base)
        a, b, *mixed = blocks - blocks[:2].mean()
        terms = np.array([b * (mixed - a), 0.5 * (a - mixed) ** 2])  # (2, keys, rows), whose means are the numerators
        spread, variance = 0.5 * (a**2 + b**2), float(np.var(blocks[:2]))
        values_of = np.array([np.ravel(one.first_order), np.ravel(one.total_order)])
        errors = np.std(terms - values_of[:, :, None] * spread, axis=2) / (variance * np.sqrt(base))
        keys = [factor.key for factor in design.factors]
        found[key] = Indices(*(_by_key(keys, *row) for row in zip(values_of, NORMAL_95 * errors, strict=True)))
    return found, without


def _by_key(keys: Sequence[str], values: FloatArray, off: FloatArray) -> dict[str, Index]:
    rows = np.transpose([values, values - off, values + off]).tolist()
    return {key: Index(*row) for key, row in zip(keys, rows, strict=True)}


def varies(results: Results, key: str) -> bool:
    """Whether a key figure varies over the cases of a study by more than rounding errors."""
    values = results.figures[key]
    there = values[np.isfinite(values)]
    if not there.size:
        return False
    size = float(np.abs(there).max())
    scale = shown_unit(results.names[key][1], size)[1]
    return float(np.ptp(there)) > max(SPREAD * size, NOISE / scale)


def write_indices(file: Path, found: Mapping[str, Indices]) -> None:
    """Write Sobol indices as CSV, a row for each key figure and varied key.

    Raises:
        OSError: the file cannot be written.
    """
    with whole_file(file) as opened:
        writer = csv.writer(opened, lineterminator="\n")
        ends = [f"{order}{end}" for order in ("first", "total") for end in ("", "_low", "_high")]
        writer.writerow(["figure", "key", *ends])
        for figure, one in found.items():
            for key, first in one.first.items():
                writer.writerow([figure, key, *first, *one.total[key]])


def shown_figures(results: Results, most: int) -> list[str]:
    """Ids of the key figures of a study that vary most in relation to their size.

    For each quantity and statistic, the figure of the subject that varies most is taken.
    """
    spread, seen = {}, set()
    for key, values in results.figures.items():
        if varies(results, key) and values.tobytes() not in seen:  # at rest the lowest is the highest
            seen.add(values.tobytes())
            spread[key] = float((np.nanmax(values) - np.nanmin(values)) / np.nanmax(np.abs(values)))
    found: dict[tuple[str, str], str] = {}
    for key in sorted(spread, key=lambda one: -spread[one]):
        quantity, _, rest = key.partition("/")
        found.setdefault((quantity, rest.rpartition("/")[2]), key)
    return list(found.values())[:most]
