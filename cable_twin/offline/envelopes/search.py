"""Search for the worst key figures over one variable: a coarse grid, then bounded searches at its worst points."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise

import numpy as np

from cable_twin.key_figures import KeyFigure

BRACKETS, CLOSE = 3, 0.9  # points refined by search: at most so many, as bad as that share of the worst
MOST_TRIES = 12  # of each bounded search


class Search:
    """Search for the worst key figures over one variable, such as the place of a vehicle or the moment of a stop.

    Args:
        at: calculates key figures by id at a value of the variable.
        finest: least difference of two values of the variable.
        key: of the search in its file, for messages.

    Attributes:
        tried: key figures by id, by value of the variable.
    """

    def __init__(self, at: Callable[[float], Mapping[str, KeyFigure]], finest: float, key: str) -> None:
        self._at, self._finest, self._key = at, finest, key
        self.tried: dict[float, Mapping[str, KeyFigure]] = {}

    def at(self, value: float) -> Mapping[str, KeyFigure]:
        """Key figures by id at a value of the variable, rounded to the search's resolution; cached for each value."""
        value = round(round(value / self._finest) * self._finest, 9)
        if value not in self.tried:
            self.tried[value] = self._at(value)
        return self.tried[value]

    def figures(self) -> list[KeyFigure]:
        """Extreme of each key figure over all tried values of the variable (the first, if several tie)."""
        found: dict[str, KeyFigure] = {}
        for _, figures in sorted(self.tried.items()):
            for key, one in figures.items():
                if key not in found or _sense(key) * one.value > _sense(key) * found[key].value:
                    found[key] = one
        return list(found.values())

    def worst(self, figure: str) -> tuple[float, float]:
        """Tried value of the variable that is worst for a key figure by id, and the value of the figure there.

        Raises:
            ValueError: the figure exists at no tried value; one line.
        """
        tried = [(value, found[figure].value) for value, found in self.tried.items() if figure in found]
        if not tried:
            text = "which is not calculated; allowed: ids of calculated key figures"
            raise ValueError(f"{self._key}.figures: given {figure}, {text}")
        return max(tried, key=lambda item: _sense(figure) * item[1])

    def refine(self, figure: str, grid: Sequence[float]) -> None:
        """Search for the worst value of a key figure by id around the worst points of an ascending grid."""
        from scipy.optimize import minimize_scalar  # noqa: PLC0415 - a while

        values = [self._badness(figure, value) for value in grid]
        worst = _sense(figure) * self.worst(figure)[1]
        floor = worst - (1.0 - CLOSE) * abs(worst)
        order = sorted(range(len(grid)), key=lambda row: -values[row])
        beside = [-np.inf, *values, -np.inf]
        peaks = [row for row in order if values[row] >= max(floor, beside[row], beside[row + 2])]
        brackets = list(pairwise(grid))
        for row in peaks[:BRACKETS]:
            for low, high in brackets[max(row - 1, 0) : row + 1]:
                if high - low > self._finest:
                    minimize_scalar(
                        lambda value: -self._badness(figure, value),
                        bounds=(low, high),
                        method="bounded",
                        options={"xatol": self._finest, "maxiter": MOST_TRIES},
                    )

    def _badness(self, figure: str, value: float) -> float:
        found = self.at(value).get(figure)
        return -np.inf if found is None else _sense(figure) * found.value


def _sense(figure: str) -> float:
    return -1.0 if figure.endswith("/lowest") else 1.0
