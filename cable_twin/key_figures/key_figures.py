"""The key figures of a run: those of each rope, and of what is between ropes."""

from __future__ import annotations

from dataclasses import replace

from cable_twin.key_figures.couplings import CouplingFigures
from cable_twin.key_figures.dissipation import ENERGY_LOST
from cable_twin.key_figures.figure import KeyFigure
from cable_twin.key_figures.figures_of_rope import FiguresOfRope
from cable_twin.key_figures.passing_figures import PassingFigures
from cable_twin.records import AppliedCommand, Touch
from cable_twin.scenario import Scenario
from cable_twin.snapshot import ENDS, Snapshot

OF_ROPE = ("rope ", "sag ", "dynamic amplification")  # how figures begin that are the rope's own


class KeyFigures:
    """Gathers the key figures of one run.

    Args:
        scenario: what runs; its `limits` and the limits of its drives are those of the figures.
    """

    def __init__(self, scenario: Scenario) -> None:
        self._whole = None if scenario.ropes else FiguresOfRope(scenario)
        self._ropes = {name: FiguresOfRope(scenario.of_rope(name)) for name in scenario.ropes}
        self._couplings = CouplingFigures(scenario)
        self._passing = PassingFigures(scenario) if len(scenario.ropes) > 1 and scenario.dim == 3 else None

    def update(self, snapshot: Snapshot) -> None:
        """Take in one snapshot; they come in the order of time."""
        if self._whole is not None:
            self._whole.update(snapshot)
            return
        for name, rope in self._ropes.items():
            rope.update(snapshot.of_rope(name))
        self._couplings.update(snapshot)
        if self._passing is not None:
            self._passing.update(snapshot)

    def command(self, applied: AppliedCommand) -> None:
        """Take in a command where it took effect."""
        for rope in [self._whole] if self._whole is not None else self._ropes.values():
            rope.command(applied)

    def touches(self) -> list[Touch]:
        """Vehicles that have met: the last touch of each with one after it on its rope."""
        ropes = [self._whole] if self._whole is not None else self._ropes.values()
        return [touch for rope in ropes for touch in rope.buffers.touches()]

    def figures(self) -> list[KeyFigure]:
        """All figures that have a value so far."""
        if self._whole is not None:
            return self._whole.figures()
        found, lost = [], []
        for name, rope in self._ropes.items():
            for figure in rope.figures():
                if figure.name == ENERGY_LOST:  # of the solver, which is one
                    lost = [figure]
                else:
                    found.append(replace(figure, name=_named(name, figure.name)))
        passing = [] if self._passing is None else self._passing.figures()
        return [*found, *self._couplings.figures(), *passing, *lost]


def _named(rope: str, figure: str) -> str:
    """What a figure of one rope is called among those of others."""
    if figure.startswith(OF_ROPE):
        return f"{rope}: {figure}"
    return f"{rope}/{figure}" if figure.startswith(tuple(f"{end}:" for end in ENDS)) else figure


__all__ = ["KeyFigures"]
