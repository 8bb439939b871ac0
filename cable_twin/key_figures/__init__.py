"""Key figures of a run, gathered from snapshot to snapshot: live in the node, or afterwards from a log.

A key figure has an identity, a standard name, value, unit, limit, the limit's source, and time and place at which the
value was reached. Carriers of one kind share their figures, which are those of the worst carrier, named in the place.
The cost and the memory of an update do not grow with the run.
"""

from cable_twin.key_figures.extremes import supports_of
from cable_twin.key_figures.figure import (
    FigureId,
    KeyFigure,
    NotJudged,
    Subject,
    figure,
    figure_from_values,
    not_judged,
    values_of,
)
from cable_twin.key_figures.figures_of_run import KeyFigures, compile_figures
from cable_twin.key_figures.quantities import QUANTITIES, Quantity

__all__ = [
    "QUANTITIES",
    "FigureId",
    "KeyFigure",
    "KeyFigures",
    "NotJudged",
    "Quantity",
    "Subject",
    "compile_figures",
    "figure",
    "figure_from_values",
    "not_judged",
    "supports_of",
    "values_of",
]
