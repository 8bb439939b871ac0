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
FORM = "allowed: KEY=LOW:HIGH or KEY=VALUE,VALUE,..., as in air.wind.x=-15:15 or script=trip.yaml,stop.yaml"
Value = float | int | str | bool


class DesignError(ValueError):
    """Error of a design of a study that cannot be made; the message is one line."""


@dataclass(frozen=True, slots=True)
class Factor:
    """Varied key of a study, with a range of numbers or a list of values.

    Attributes:
        key: dotted key of the scenario, or `SCRIPT`.
        range: least and greatest value; None for a list.
        values: values of the list, in order.
        whole: whether only integers of the range are taken.
    """

    key: str
    range: tuple[float, float] | None = None
    values: tuple[Value, ...] = ()
    whole: bool = False

    def at(self, share: float) -> Value:
        """Value of the varied key at a share (0 to below 1) of its range or list."""
        if self.range is None:
            return self.values[min(int(share * len(self.values)), len(self.values) - 1)]
        low, high = self.range
        if self.whole:
            return int(low) + min(int(share * (high - low + 1.0)), int(high - low))
        return low + share * (high - low)

    def levels(self, count: int) -> tuple[Value, ...]:
        """Levels of the varied key in a grid: `count` values from end to end of a range, or all values of a list."""
        if self.range is None:
            return self.values
        points = np.linspace(*self.range, count).tolist()
        return tuple(dict.fromkeys(map(round, points))) if self.whole else tuple(points)

    @property
    def ends(self) -> tuple[Value, ...]:
        """Both ends of the range of the varied key, or all values of its list."""
        return self.levels(2)


def factor_of(text: str) -> Factor:
    """Parse KEY=LOW:HIGH or KEY=VALUE,VALUE,... of the option `--vary`.

    Raises:
        argparse.ArgumentTypeError: one line with the given and the allowed form.
    """
    key, equals, given = text.partition("=")
    key = key.strip()
    if not (equals and key and given.strip()):
        raise argparse.ArgumentTypeError(f"given {text!r}; {FORM}")
    name = key if key == SCRIPT else full_key(key)
    if ":" in given and key != SCRIPT:
        try:
            low, high = map(float, given.split(":"))
        except ValueError:
            low = high = math.nan
        if not (math.isfinite(low) and math.isfinite(high) and low < high):
            raise argparse.ArgumentTypeError(f"given {text!r}; {FORM}, with LOW below HIGH, both finite")
        return Factor(name, (low, high))
    try:
        values = given.split(",") if key == SCRIPT else read_yaml(f"[{given}]").content
    except UnreadableYamlError as error:
        raise argparse.ArgumentTypeError(f"given {text!r}, which cannot be read: {error}; {FORM}") from None
    if not all(isinstance(one, Value) and one != "" for one in values) or len({*values}) < len(values):
        raise argparse.ArgumentTypeError(f"given {text!r}; {FORM}, with each value once")
    return Factor(name, values=tuple(values))


@dataclass(frozen=True, slots=True)
class Design:
    """Design of a study: the values of all varied keys in each case, in order.

    Attributes:
        factors: varied keys.
        method: one of `METHODS`.
        rows: a value of each varied key, for each case.
        base: for Sobol, number of rows of each of the matrices A, B and A with a column of B; else 0.
    """

    factors: tuple[Factor, ...]
    method: str
    rows: Sequence[tuple[Value, ...]]
    base: int = 0

    def cases(self) -> Iterator[tuple[str, Mapping[str, Value]]]:
        """Iterate over the cases of the design: id, and values by key."""
        digits = len(str(len(self.rows)))
        for number, row in enumerate(self.rows, 1):
            yield f"c{number:0{digits}d}", dict(zip((one.key for one in self.factors), row, strict=True))


def design(factors: Sequence[Factor], method: str, cases: int, seed: int) -> Design:
    """Make a design of a study with at most a number of cases.

    A grid has all combinations of equally many levels of each range and of all values of each list. Sobol is the
    design of Saltelli: two matrices A and B of a scrambled Sobol sequence, and A with each column of B in turn.

    Args:
        factors: varied keys, at least one, with different names.
        method: one of `METHODS`.
        cases: most cases.
        seed: of the random numbers of a Latin hypercube and of the scrambling.

    Raises:
        DesignError: the number of cases is too small for the method; one line.
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
    """Levels of each varied key in a grid of at most `cases` combinations, as many as possible for each range."""

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
    """Error lines about the varied keys of a study taken together, such as a key given twice."""
    keys = [one.key for one in factors]
    for key in sorted({key for key in keys if keys.count(key) > 1}):
        yield f"--vary: given {key} twice; allowed: each key once"


def with_kinds(factors: Sequence[Factor], is_whole: Any) -> list[Factor]:
    """Restrict varied keys for which `is_whole(key)` holds to integers.

    Raises:
        DesignError: an end of the range of such a key is no integer; one line.
    """
    found = []
    for one in factors:
        whole = one.range is not None and is_whole(one.key)
        if one.range is not None and whole and not all(end.is_integer() for end in one.range):
            raise DesignError(f"--vary {one.key}: given {one.range[0]:g}:{one.range[1]:g}; allowed: whole numbers")
        found.append(Factor(one.key, one.range, one.values, whole))
    return found
