"""Outlook of a running twin: key figures of some futures from its present state, and limits violated in them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from cable_twin.basics.units import rounded, shown_unit
from cable_twin.frame.records import FloatArray
from cable_twin.frame.snapshot import Snapshot
from cable_twin.key_figures.figure import FigureId, KeyFigure

EMERGENCY_STOP, AS_COMMANDED, ANNOUNCED = "emergency stop", "as commanded", "announced wind"  # names of futures
SHOWN = frozenset(
    (
        *("stopping_distance", "stopping_time", "passenger_stopping_distance", "speed"),
        *("swing", "lateral_swing", "acceleration"),
        *("rope_clearance", "vehicle_clearance", "tower_clearance", "vehicle_separation"),
        *("rope_tension", "rope_safety_factor", "tension_per_transverse_load"),
        *("support_load", "deropement_margin", "roller_load", "lateral_ratio", "derailed"),
        *("adhesion_used", "rope_slip", "rollback", "counterweight_travel", "hydraulics_travel"),
    )
)  # quantities of an outlook; others only where they pass a limit
LEFT_OUT = "energy_lost"  # of the solver, and no matter of the ropeway


@dataclass(frozen=True, slots=True)
class Future:
    """Future of a twin in an outlook: assumption, key figures, tensions over time, limits that would be violated.

    Attributes:
        name: one of `EMERGENCY_STOP`, `AS_COMMANDED`, `ANNOUNCED`.
        assumed: assumption in words.
        figures: from the present to the end of the future, in the order of `KeyFigures.figures`.
        passed: time (s) by which a limit is passed, by the id of the figure.
        times: (n,) s, simulated.
        highest: (n, ropes) N, highest tension along each rope.
        lowest: (n, ropes) N, lowest tension along each rope.
        last: snapshot of the future's end; None for a future that was not run.
        fault: why the future was not run, or ended early; empty otherwise.
    """

    name: str
    assumed: str
    figures: tuple[KeyFigure, ...]
    passed: Mapping[FigureId, float]
    times: FloatArray
    highest: FloatArray
    lowest: FloatArray
    last: Snapshot | None
    fault: str = ""

    def __getitem__(self, id_: str) -> KeyFigure:
        """Key figure by its id as text, such as swing/carriages.cabin/highest."""
        wanted = FigureId.of_text(id_)
        for one in self.figures:
            if one.id == wanted:
                return one
        raise KeyError(id_)

    @property
    def warnings(self) -> list[str]:
        """Lines about limits that would be violated in this future, in the order of time."""
        beyond = [one for one in self.figures if one.id in self.passed]
        beyond.sort(key=lambda one: self.passed[one.id])
        return [self.warning(one) for one in beyond]

    def warning(self, one: KeyFigure) -> str:
        """Line about a key figure that would violate its limit in this future."""
        assert one.limit is not None
        unit, scale = shown_unit(one.unit, max(abs(one.value), abs(one.limit)))
        unit = "" if unit == "-" else f" {unit}"
        place = f", {one.place}" if one.place else ""
        return (
            f"{self.name}: {one.name}: {rounded(one.value * scale)}{unit} at {one.time:.2f} s{place}; allowed: "
            f"{one.bound} {rounded(one.limit * scale)}{unit}, violated no later than "
            f"{self.passed[one.id]:.2f} s ({one.source})"
        )


@dataclass(frozen=True, slots=True)
class Outlook:
    """Futures of a twin from its present state.

    Attributes:
        time: s, simulated, of the present state.
        horizon: s, length of the futures.
        futures: emergency stop now, go on as commanded, announced gust or wind.
        ropes: names of the ropes, for the columns of tensions.
        effort: s by the clock that the calculation took.
    """

    time: float
    horizon: float
    futures: tuple[Future, ...]
    ropes: tuple[str, ...]
    effort: float

    def __getitem__(self, name: str) -> Future:
        """Future by its name."""
        for one in self.futures:
            if one.name == name:
                return one
        raise KeyError(name)

    @property
    def warnings(self) -> list[str]:
        """Lines about limits that would be violated in any of the futures, and about futures that ended early."""
        lines = [line for future in self.futures for line in future.warnings]
        return lines + [f"{one.name}: {one.fault}" for one in self.futures if one.fault and one.last is not None]
