"""Relaxations in parts: between two of them Ctrl-C is heard, and whoever starts is told how far it is."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from math import log
from typing import NamedTuple

MAX_RELAXATIONS = 5000
LAST = 1e-12  # of the first mass factor: from there on iterations are Newton's
PART = 50_000  # iterations times elements of a part, which takes some tenths of a second at most


class Moment(NamedTuple):
    """How far a relaxation is."""

    elements: int
    iterations: int
    share: float  # 0 to 1, of what the masses have to lose
    elapsed: float  # s

    @property
    def remaining(self) -> float:
        """Time (s) left at most, at the speed so far: most lines rest after a tenth of the iterations or less."""
        return self.elapsed / self.iterations * (MAX_RELAXATIONS - self.iterations)


_watchers: list[Callable[[Moment], object]] = []


@contextmanager
def watching_relaxation(shown: Callable[[Moment], object]) -> Iterator[None]:
    """Tell how far relaxations are within this block, after each part."""
    _watchers.append(shown)
    try:
        yield
    finally:
        _watchers.remove(shown)


def relax_in_parts(relax: Callable[[float, int], tuple[int, float, float]], elements: int) -> tuple[int, float]:
    """Relax until all forces balance, or for the most iterations that are allowed.

    Args:
        relax: takes a mass factor, 0 for the first one, and iterations; gives how many it took, the last increment (m)
            and the mass factor to go on with, 0 at rest.
        elements: of the mesh.

    Returns:
        Number of iterations, `MAX_RELAXATIONS` where it found no rest, and the last increment (m).
    """
    begun, used, factor, first = time.monotonic(), 0, 0.0, 0.0
    part = max(PART // elements, 1)
    increment = 0.0
    while used < MAX_RELAXATIONS:
        taken, increment, factor = relax(factor, min(part, MAX_RELAXATIONS - used))
        used += taken
        if factor == 0.0:
            return used, increment
        first = max(first, factor)
        moment = Moment(elements, used, min(log(first / factor) / -log(LAST), 1.0), time.monotonic() - begun)
        for shown in _watchers:
            shown(moment)
    return MAX_RELAXATIONS, increment


__all__ = ["LAST", "MAX_RELAXATIONS", "Moment", "relax_in_parts", "watching_relaxation"]
