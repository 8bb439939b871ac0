"""How much energy the integrator itself has taken out of the motion, of that which came and went."""

from __future__ import annotations

from math import inf, nan, sqrt

from cable_twin.key_figures.figure import KeyFigure
from cable_twin.records import SolverReport
from cable_twin.scenario import Grading, Scenario

ENERGY_LOST = "energy lost by the solver, of that which moved"
WINDOW = 10.0  # s of simulated time over which both are added up
SIGNIFICANT = 0.02  # of the window that moved most: less is the end of a motion, of which nothing depends
FLOOR = 1e-3  # J, below which it is rounding that moves


class Dissipation:
    """Watches it in windows, of which the worst counts.

    Args:
        scenario: what runs.
    """

    def __init__(self, scenario: Scenario) -> None:
        self._cause = cause(scenario)
        self._allowed = inf if scenario.limits.energy_lost is None else scenario.limits.energy_lost
        self._start = nan  # s, of the window
        self._lost, self._moved = 0.0, 0.0  # J, in it so far
        self._most = 0.0  # J, moved in any
        self._worst: tuple[float, float, float, float] | None = None  # its lost and moved (J), start and end (s)

    def update(self, time: float, report: SolverReport) -> None:
        """Take in what the solver did up to `time` (s)."""
        if not self._start <= time:  # nor where there was none
            self._start = time
        self._lost += report.energy_lost
        self._moved += 0.5 * report.energy_moved  # what one gains another loses
        if time - self._start >= WINDOW:
            self._worst, self._most = self._judged(time), max(self._most, self._moved)
            self._start, self._lost, self._moved = time, 0.0, 0.0

    def _judged(self, time: float) -> tuple[float, float, float, float] | None:
        """The worst window, with the present one as far as it is."""
        if self._moved < max(FLOOR, SIGNIFICANT * self._most):
            return self._worst
        worst = self._worst
        if worst is None or worst[1] < SIGNIFICANT * self._moved or self._lost * worst[1] > worst[0] * self._moved:
            return self._lost, self._moved, self._start, time
        return worst

    def figure(self, time: float) -> KeyFigure:
        """The share lost in the worst window up to `time` (s), and why if too much; NaN where nothing has moved."""
        worst = self._judged(time)
        if worst is None:
            return KeyFigure(ENERGY_LOST, nan, "-", time)
        lost, moved, start, end = worst
        share = max(lost, 0.0) / moved
        advice = f"; {self._cause}" if share > self._allowed else ""
        return KeyFigure(ENERGY_LOST, share, "-", end, f"{lost:.3g} of {moved:.3g} J from {start:.1f} s on{advice}")


def cause(scenario: Scenario) -> str:
    """What of a scenario lets energy be lost, and what to change."""
    cable, step = scenario.cable, scenario.solver.step
    elements = cable.elements
    length = elements.at_towers if isinstance(elements, Grading) else cable.unstrained_length / elements
    passed = step * sqrt(cable.axial_stiffness / cable.mass_per_length) / length
    if passed > 1.0:
        return f"tension waves pass {passed:.2g} elements in a step: lower solver.step"
    return f"a step is {passed:.2g} of what tension waves take through an element: refine cable.elements"


__all__ = ["ENERGY_LOST", "Dissipation", "cause"]
