"""Results of an ensemble as columns: one (members,) for each quantity, by name and unit."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from cable_twin.key_figures import KeyFigure
from cable_twin.mechanics.parameters import FloatArray


class MemberColumns(Mapping[str, FloatArray]):
    """Values of all members by name of the quantity: `columns["cabin/speed"]` is (members,).

    Attributes:
        names: of the columns, (n,).
        units: of the columns, (n,).
        array: the numbers, (members, n); NaN where a member has none.
    """

    __slots__ = ("_rows", "array", "names", "units")

    def __init__(self, names: Sequence[str], units: Sequence[str], array: FloatArray) -> None:
        self.names, self.units, self.array = tuple(names), tuple(units), array
        self._rows = {name: number for number, name in enumerate(self.names)}

    def __getitem__(self, name: str) -> FloatArray:
        return self.array[:, self._rows[name]]

    def __iter__(self) -> Iterator[str]:
        return iter(self.names)

    def __len__(self) -> int:
        return len(self.names)


def figure_columns(figures: Sequence[Sequence[KeyFigure]]) -> MemberColumns:
    """Columns of the key figures of each member, in the order of the first member.

    Args:
        figures: of each member; a figure that a member does not have is NaN there.
    """
    units = {one.name: one.unit for of_member in figures for one in of_member}
    array = np.full((len(figures), len(units)), np.nan)
    rows = {name: number for number, name in enumerate(units)}
    for member, of_member in enumerate(figures):
        for one in of_member:
            array[member, rows[one.name]] = one.value
    return MemberColumns(list(units), list(units.values()), array)
