"""Designs of a study: grids, Latin hypercubes and Sobol sequences over ranges and lists of values of scenario keys."""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from cable_twin.basics.limited_yaml import UnreadableYamlError, read_yaml
from cable_twin.frame.records import FloatArray
from cable_twin.scenario import full_key

METHODS = ("grid", "latin", "sobol")
SCRIPT = "script"  # key whose values are files of commands
FORM = "KEY=LOW:HIGH or KEY=VALUE,VALUE,... is needed, as in air.wind.x=-15:15 or script=trip.yaml,stop.yaml"
Value = float | int | str | bool


class DesignError(ValueError):
    """Design that cannot be made; the text is one line."""


@dataclass(frozen=True, slots=True)
class Factor:
    """Varied key: a range of numbers, or a list of values.

    Attributes:
        key: dotted key of the scenario, or `SCRIPT`.
        range: least and greatest value; None for a list.
        values: of a list, in order.
        whole: whether only integers of the range are taken.
    """

    key: str
    range: tuple[float, float] | None = None
    values: tuple[Value, ...] = ()
    whole: bool = False

    def at(self, share: float) -> Value:
        """Value at a share (0 to below 1) of the range, or of the list."""
        if self.range is None:
            return self.values[min(int(share * len(self.values)), len(self.values) - 1)]
        low, high = self.range
        if self.whole:
            return int(low) + min(int(share * (high - low + 1.0)), int(high - low))
        return low + share * (high - low)

    def levels(self, count: int) -> tuple[Value, ...]:
        """Values from end to end for a grid: `count` of a range, fewer where it has fewer integers; or those listed."""
        if self.range is None:
            return self.values
        points = np.linspace(*self.range, count).tolist()
        return tuple(dict.fromkeys(map(round, points))) if self.whole else tuple(points)

    @property
    def ends(self) -> tuple[Value, ...]:
        """Both ends of the range, or all values of the list."""
        return self.levels(2)


def factor_of(text: str) -> Factor:
    """Parse KEY=LOW:HIGH or KEY=VALUE,VALUE,...

    Raises:
        argparse.ArgumentTypeError: one line with the given and the allowed form.
    """
    key, equals, given = text.partition("=")
    key = key.strip()
    if not (equals and key and given.strip()):
        raise argparse.ArgumentTypeError(f"{text!r} given, {FORM}")
    name = key if key == SCRIPT else full_key(key)
    if ":" in given and key != SCRIPT:
        try:
            low, high = map(float, given.split(":"))
        except ValueError:
            low = high = math.nan
        if not (math.isfinite(low) and math.isfinite(high) and low < high):
            raise argparse.ArgumentTypeError(f"{text!r} given, {FORM}, with LOW below HIGH, both finite")
        return Factor(name, (low, high))
    try:
        values = given.split(",") if key == SCRIPT else read_yaml(f"[{given}]").content
    except UnreadableYamlError as error:
        raise argparse.ArgumentTypeError(f"{text!r} given, which cannot be read: {error}; {FORM}") from None
    if not all(isinstance(one, Value) and one != "" for one in values) or len({*values}) < len(values):
        raise argparse.ArgumentTypeError(f"{text!r} given, {FORM}, with each value once")
    return Factor(name, values=tuple(values))


@dataclass(frozen=True, slots=True)
class Design:
    """Cases of a study in order.

    Attributes:
        factors: what is varied.
        method: one of `METHODS`.
        rows: a value of each factor, for each case.
        base: of Sobol, number of rows of each of the matrices A, B and A with a column of B; else 0.
    """

    factors: tuple[Factor, ...]
    method: str
    rows: Sequence[tuple[Value, ...]]
    base: int = 0

    def cases(self) -> Iterator[tuple[str, Mapping[str, Value]]]:
        """Ids and values by key of all cases."""
        digits = len(str(len(self.rows)))
        for number, row in enumerate(self.rows, 1):
            yield f"c{number:0{digits}d}", dict(zip((one.key for one in self.factors), row, strict=True))


def design(factors: Sequence[Factor], method: str, cases: int, seed: int) -> Design:
    """Design with at most a number of cases.

    A grid has all combinations of equally many levels of each range and of all values of each list. Sobol is the
    design of Saltelli: two matrices A and B of a scrambled Sobol sequence, and A with each column of B in turn.

    Args:
        factors: at least one, with different keys.
        method: one of `METHODS`.
        cases: most cases.
        seed: of the random numbers of a Latin hypercube and of the scrambling.

    Raises:
        DesignError: there are too few cases for it; one line.
    """
    from scipy.stats import qmc  # noqa: PLC0415 - half a second

    chosen, size = tuple(factors), len(factors)
    if method == "grid":
        return Design(chosen, method, list(product(*_levels(chosen, cases))))
    if method == "latin":
        shares = qmc.LatinHypercube(size, rng=seed).random(cases)
        return Design(chosen, method, _rows(chosen, shares))
    base = 2 ** int(math.log2(max(cases / (size + 2), 1.0)))
    if base < 2:
        raise DesignError(f"--cases: given {cases}; allowed: at least {2 * (size + 2)}, for sobol of {size} keys")
    both = qmc.Sobol(2 * size, rng=seed).random_base2(round(math.log2(base)))
    a, b = both[:, :size], both[:, size:]
    mixed = []
    for column in range(size):
        mixed.append(a.copy())
        mixed[-1][:, column] = b[:, column]
    return Design(chosen, method, _rows(chosen, np.concatenate([a, b, *mixed])), base)


def _rows(factors: Sequence[Factor], shares: FloatArray) -> list[tuple[Value, ...]]:
    return [tuple(one.at(share) for one, share in zip(factors, row, strict=True)) for row in shares.tolist()]


def _levels(factors: Sequence[Factor], cases: int) -> list[tuple[Value, ...]]:
    """Levels of each factor of a grid, with as many of each range as the number of cases leaves."""

    def of(count: int) -> list[tuple[Value, ...]]:
        return [one.levels(count) for one in factors]

    ranges = sum(one.range is not None for one in factors)
    least = math.prod(map(len, of(2)))
    if least > cases:
        raise DesignError(f"--cases: given {cases}; allowed: at least {least}, for both ends and all values listed")
    if not ranges:
        return of(2)
    count = 2
    while count < cases and math.prod(map(len, of(count + 1))) <= cases:
        count += 1
    return of(count)


def faults_of(factors: Sequence[Factor]) -> Iterator[str]:
    """Faults of factors beside each other, a line each."""
    keys = [one.key for one in factors]
    for key in sorted({key for key in keys if keys.count(key) > 1}):
        yield f"--vary: {key} is given twice; allowed: each key once"


def with_kinds(factors: Sequence[Factor], is_whole: Any) -> list[Factor]:
    """Factors with integers only, for keys for which `is_whole(key)` holds.

    Raises:
        DesignError: a range of such a key ends at no integer; one line.
    """
    found = []
    for one in factors:
        whole = one.range is not None and is_whole(one.key)
        if one.range is not None and whole and not all(end.is_integer() for end in one.range):
            raise DesignError(f"--vary {one.key}: given {one.range[0]:g}:{one.range[1]:g}; allowed: whole numbers")
        found.append(Factor(one.key, one.range, one.values, whole))
    return found
