"""View sizes on the smallest supported screen, in pixels of rerun's browser view."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

WIDTH, HEIGHT = 1280, 800
MENU, TIME_PANEL, TITLE = 37, 30, 29  # above all, below all, and above each view
TIME_LABELS = 17  # below a plot
IN_A_ROW = 3  # plots and close-ups, of about one height and width; in space there are more of them
IN_SPACE_IN_A_ROW = 4
LEGEND_ROW = 22  # of names of lines, one below the other
LETTER_OF_TABLE, MARGINS_OF_TABLE = 6.5, 32  # of the readout


class Sizes(NamedTuple):
    """Division of the picture into views.

    Attributes:
        side: Width of the column with readout and commands.
        rows: Cells, plots and close-ups, in each row below the track.
        space: Whether the track is seen in space beside the view of its plane.
    """

    side: float
    rows: tuple[int, ...]
    space: bool

    @property
    def main(self) -> float:
        """Width of the picture without the side column."""
        return WIDTH - self.side

    @property
    def row(self) -> float:
        """Height of a row, title included."""
        return (HEIGHT - MENU - TIME_PANEL) / (1 + len(self.rows))

    @property
    def track(self) -> tuple[float, float]:
        """Width and height of a view of the whole track."""
        return self.main / (2 if self.space else 1), self.row - TITLE

    def cell(self, number: int) -> tuple[float, float]:
        """Width and height of a plot with legend, or of a close-up, by its number from the first row on."""
        for count in self.rows:
            if number < count:
                return self.main / count, self.row - TITLE
            number -= count
        raise IndexError(number)


def divided(cells: int, *, space: bool, table: tuple[int, int]) -> Sizes:
    """Return the division of the picture for a number of cells and a readout with column widths in letters."""
    count = max(1, -(-cells // (IN_SPACE_IN_A_ROW if space else IN_A_ROW)))
    ends = [cells * row // count for row in range(count + 1)]
    rows = tuple(last - first for first, last in pairwise(ends))
    wanted = MARGINS_OF_TABLE + LETTER_OF_TABLE * sum(table)
    return Sizes(min(max(wanted, WIDTH / 6.0), WIDTH / 3.0), rows, space)


__all__ = ["LEGEND_ROW", "TIME_LABELS", "Sizes", "divided"]
