"""Newest lines of many, such as alarms, of which minor ones do not push out the others."""

from __future__ import annotations

from collections.abc import Iterable


class NewestLines:
    """Newest lines, in the order in which they came; where there are too many, the oldest minor ones go first.

    Args:
        most: number of lines that are kept.
    """

    def __init__(self, most: int) -> None:
        self._most = most
        self._kept: list[tuple[str, bool]] = []

    def add(self, lines: Iterable[str], *, minor: bool = False) -> None:
        """Add lines, all of them minor or none."""
        self._kept += ((line, minor) for line in lines)
        while len(self._kept) > self._most:
            oldest = next((row for row, (_, small) in enumerate(self._kept) if small), 0)
            del self._kept[oldest]

    @property
    def lines(self) -> list[str]:
        """Lines that are kept, the newest one last."""
        return [line for line, _ in self._kept]
