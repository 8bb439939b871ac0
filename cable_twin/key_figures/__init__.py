"""Key figures of a run, gathered from snapshot to snapshot: live in the node, or afterwards from a log.

Each has its standard name, value, unit, limit and the source of the limit, and says when and where it was reached.
Carriers of one kind share their figures, which are those of the worst of them, named in the place. The cost and the
memory of an update do not grow with the run.
"""

from cable_twin.key_figures.buffers import BUFFER_FORCE
from cable_twin.key_figures.dissipation import ENERGY_LOST
from cable_twin.key_figures.figure import KeyFigure, figure_from_values, values_of
from cable_twin.key_figures.gathered_figures import KeyFigures, compile_figures
from cable_twin.key_figures.space_figures import DERAILED

__all__ = [
    "BUFFER_FORCE",
    "DERAILED",
    "ENERGY_LOST",
    "KeyFigure",
    "KeyFigures",
    "compile_figures",
    "figure_from_values",
    "values_of",
]
