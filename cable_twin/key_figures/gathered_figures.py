"""Key figures of a whole run: of each rope, and of the couplings between ropes."""

from __future__ import annotations

from dataclasses import replace
from math import isnan, nan

from cable_twin.frame.records import AppliedCommand, Touch
from cable_twin.frame.snapshot import ENDS, Snapshot
from cable_twin.key_figures.couplings import CouplingFigures
from cable_twin.key_figures.dissipation import Dissipation
from cable_twin.key_figures.figure import KeyFigure
from cable_twin.key_figures.limits import limited
from cable_twin.key_figures.loop_figures import LoopFigures
from cable_twin.key_figures.passing_figures import PassingFigures
from cable_twin.key_figures.rope_figures import FiguresOfRope
from cable_twin.key_figures.seat_stops import SeatStops
from cable_twin.key_figures.stops import CarriedStops
from cable_twin.scenario import Scenario

OF_ROPE = ("rope ", "sag ", "dynamic amplification")  # how figures begin that are the rope's own

LEAST = ("tension over transverse load", "clearance over the terrain", "clearance to towers")  # where little is bad


class KeyFigures:
    """Key figures of one run, updated frame by frame.

    Args:
        scenario: what runs; its `limits` and the limits of its drives are those of the figures.
    """

    def __init__(self, scenario: Scenario) -> None:
        self._ropes = {name: FiguresOfRope(scenario.of_rope(name)) for name in scenario.cables}
        self._dissipation, self._time = Dissipation(scenario), nan  # s, of the last frame
        self._scenario, self._carried = scenario, CarriedStops(scenario)
        self._seats = SeatStops(scenario)
        self._couplings, self._loops = CouplingFigures(scenario), LoopFigures(scenario)
        self._riding = (f"{scenario.carriers.name}: ",) if scenario.carriers and scenario.ropes else ()
        meeting = len(scenario.ropes) > 1 and len(scenario.vehicles) > 1 and scenario.dim == 3
        self._passing = PassingFigures(scenario) if meeting else None

    def update(self, snapshot: Snapshot) -> None:
        """Take in one snapshot, in order of time."""
        self._carried.update(snapshot)
        self._seats.update(snapshot)
        self._time = snapshot.time
        self._dissipation.update(self._time, snapshot.solver)
        for name, rope in self._ropes.items():
            rope.update(snapshot.of_rope(name))
        self._couplings.update(snapshot)
        self._loops.update(snapshot)
        if self._passing is not None:
            self._passing.update(snapshot)

    def command(self, applied: AppliedCommand) -> None:
        """Take in a command at the time of its effect."""
        for rope in self._ropes.values():
            rope.command(applied)
        self._loops.command(applied)
        self._carried.command(applied)
        self._seats.command(applied)

    def touches(self) -> list[Touch]:
        """Return the last touch of each vehicle with a vehicle after it on its rope."""
        return [touch for rope in self._ropes.values() for touch in rope.buffers.touches()]

    def figures(self) -> list[KeyFigure]:
        """Return all figures with a value so far."""
        lost = self._dissipation.figure(self._time)
        of_solver = [] if isnan(lost.value) else [lost]
        carried = [
            *self._carried.figures(lambda figure, key: limited(self._scenario, figure, key)),
            *self._seats.figures(),
        ]
        found: dict[str, KeyFigure] = {}
        for name, rope in self._ropes.items():
            for own in rope.figures():
                source = own.source.replace("scenario: cable.", f"scenario: {self._scenario.rope_key(name)}.")
                figure = replace(own, name=self._named(name, own.name), source=source)
                if own.name.startswith(self._riding):  # on every strand: the worst of them, and where that was
                    figure = replace(own, place=f"{name}: {own.place}")
                    figure = _worse(found.pop(own.name, figure), figure)
                found[figure.name] = figure
        passing = [] if self._passing is None else self._passing.figures()
        return [*found.values(), *self._loops.figures(), *carried, *self._couplings.figures(), *passing, *of_solver]

    def _named(self, rope: str, figure: str) -> str:
        """Name of a figure of one rope: unchanged for a single rope, with the name of its rope among several."""
        if not self._scenario.ropes:
            return figure
        if figure.startswith(OF_ROPE):
            return f"{rope}: {figure}"
        return f"{rope}/{figure}" if figure.startswith(tuple(f"{end}:" for end in ENDS)) else figure


def compile_figures(scenario: Scenario, first: Snapshot) -> None:
    """Compile the kernels of the key figures on the first snapshot of a run, before its frames are due."""
    KeyFigures(scenario).update(first)


def _worse(one: KeyFigure, other: KeyFigure) -> KeyFigure:
    """Return the more extreme of two figures of equal name on two strands."""
    least = one.bound == "at least" or one.name.endswith(LEAST)
    return other if (other.value < one.value) == least and other.value != one.value else one


__all__ = ["KeyFigures", "compile_figures"]
