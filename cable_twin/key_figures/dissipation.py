"""Numerical dissipation: energy lost or gained by the integrator over energy moved, judged in whole blocks of time."""

from __future__ import annotations

from dataclasses import replace
from math import isnan, nan, sqrt
from typing import NamedTuple

from cable_twin.basics.units import with_unit
from cable_twin.frame.records import SolverReport
from cable_twin.key_figures.figure import KeyFigure, Subject, figure
from cable_twin.scenario import Grading, Scenario

BLOCK = 5.0  # s of simulated time, over which losses are summed
SIGNIFICANT = 0.02  # share of the largest energy moved in a block; blocks below it are the end of a motion
QUIET = 0.01  # m/s of all mass, up to which it counts as standing still
GAINS = "the motion is not physical: lower solver.step, shorten elements, or let cable.elastic_model be continuum"


class Block(NamedTuple):
    """Numerical energy loss and exchanged kinetic energy in one block of time."""

    lost: float  # J, below 0 where energy is gained
    moved: float  # J
    start: float  # s
    end: float  # s

    @property
    def share(self) -> float:
        """Relative energy error of a block of time: energy lost or gained over energy moved."""
        return abs(self.lost) / self.moved

    @property
    def gained(self) -> bool:
        """Whether energy is gained, as from elements that are too long for their curvature."""
        return self.lost < 0.0

    def __str__(self) -> str:
        """Energy lost or gained, and moved, as text."""
        amount = f"{with_unit(abs(self.lost), 'J', 3)} of {with_unit(self.moved, 'J', 3)}"
        return f"gained, not lost: {amount}" if self.gained else amount


class Dissipation:
    """Numerical dissipation of a run: energy lost or gained per change of kinetic energy, highest of all blocks of 5 s.

    A shock loses its energy at once, before the motion that follows it. So a block is judged 10 s after its start, when
    the next block is complete, against the larger energy moved in either block. A judged block is not judged again, so
    that a running twin and the log of its run agree.

    Args:
        scenario: scenario of the run, with the limit `limits.energy_lost`.
    """

    def __init__(self, scenario: Scenario) -> None:
        self._scenario = scenario
        self._floor = _mass(scenario) * QUIET**2  # J
        self._lost, self._moved, self._start = 0.0, 0.0, nan  # J, J and s, of the block so far
        self._waiting: Block | None = None  # complete, until the next one is complete too
        self._most = 0.0  # J, moved in any block that was judged
        self._worst: Block | None = None
        self._judged = False  # whether any block has been

    def update(self, time: float, report: SolverReport) -> None:
        """Add the energy balance of the solver up to `time` (s); that of a first frame is of the time before it."""
        if isnan(self._start):
            self._start = time
            return
        self._lost += report.energy_lost
        self._moved += 0.5 * report.energy_moved  # a gain of one part is a loss of another one: half of the changes
        if time - self._start >= BLOCK * (1.0 - 1e-9):
            if self._waiting is not None:
                self._judge(self._waiting, self._moved)
            self._waiting = Block(self._lost, self._moved, self._start, time)
            self._lost, self._moved, self._start = 0.0, 0.0, time

    def _judge(self, block: Block, moved_next: float) -> None:
        """Store a block with the highest relative error of a run; `moved_next` (J): energy moved in the next block."""
        self._judged = True
        block = block._replace(moved=max(block.moved, moved_next))
        self._most = max(self._most, block.moved)
        if block.moved < max(self._floor, SIGNIFICANT * self._most):
            return
        if self._worst is None or block.share > self._worst.share:
            self._worst = block

    def figure(self, time: float) -> KeyFigure:
        """Highest relative energy error with its limit; before 10 s have passed, that so far without a limit.

        Args:
            time: now, s.

        Returns:
            The figure, with the cause where its limit is passed; NaN where nothing has moved.
        """
        if not self._judged:
            return self._so_far(time)
        if self._worst is None:
            return _energy_lost(nan, time)
        worst = self._worst
        place = f"{worst} from {worst.start:.1f} s on"
        found = _energy_lost(worst.share, worst.end, place).limited_by(self._scenario)
        if found.kept is not False:
            return found
        return replace(found, place=f"{place}; {GAINS if worst.gained else cause(self._scenario)}")

    def _so_far(self, time: float) -> KeyFigure:
        waiting = self._waiting or Block(0.0, 0.0, self._start, time)
        whole = Block(waiting.lost + self._lost, waiting.moved + self._moved, waiting.start, time)
        if not whole.moved >= self._floor:
            return _energy_lost(nan, time)
        return _energy_lost(whole.share, time, f"{whole}; judged after {2.0 * BLOCK:g} s")


def _energy_lost(share: float, time: float, place: str = "") -> KeyFigure:
    return figure("energy_lost", Subject("solver"), "highest", share, time, place)


def _mass(scenario: Scenario) -> float:
    """Mass (kg) of all ropes and bodies."""
    cables = scenario.cables.values()
    bodies = [body for vehicle in scenario.vehicles.values() for body in vehicle.bodies.values()]
    return sum(cable.mass_per_length * cable.unstrained_length for cable in cables) + sum(body.mass for body in bodies)


def cause(scenario: Scenario) -> str:
    """Text on the cause of numerical dissipation and its remedy: the joint, else elements that waves pass in a step.

    Where a vehicle on an element passes to the next one, it is shaken however short steps and elements are.
    """
    if any(cable.joint == "paper" for cable in scenario.cables.values()):
        return "a joint within elements shakes the rope at each node: let cable.joint be node"
    passed = 0.0
    for cable in scenario.cables.values():
        elements = cable.elements
        length = elements.at_towers if isinstance(elements, Grading) else cable.unstrained_length / elements
        passed = max(passed, scenario.solver.step * sqrt(cable.axial_stiffness / cable.mass_per_length) / length)
    return f"tension waves pass {passed:.2g} elements in a step: lower solver.step"
