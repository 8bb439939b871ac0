"""State, settings and parameters of ensemble members, loaded one at a time into one simulation's memory."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cable_twin.ensemble.advancing import (
    ASKING,
    ELEMENT,
    FAILED,
    GAP,
    HALVINGS,
    INCREMENT,
    ITERATIONS,
    LOST,
    MOVED,
    STATUS,
    STEPS,
    Looks,
    Members,
    observe_members,
)
from cable_twin.frame.records import SolverReport
from cable_twin.mechanics.language.addresses import address
from cable_twin.mechanics.language.by_reference import pack
from cable_twin.mechanics.language.entries import NOTHING, address_of
from cable_twin.mechanics.parameters import FloatArray
from cable_twin.mechanics.readout.columns import observe
from cable_twin.mechanics.solution.stepping import Outcome
from cable_twin.simulation import Simulation
from cable_twin.simulation.engine import Settings
from cable_twin.simulation.twin import PART, PERIOD, penetration_of, step_failure


class MemberStates:
    """Present states of all members with their settings, and the simulation with the parameters of each.

    Simulations take turns in the memory of the first one: `enter` writes a member's state there, `leave` reads it back.

    Attributes:
        base: simulation of the scenario, whose compiled system and memory all share.
        arrays: of all members, for kernels.
        variants: simulation that has the parameters of each member.
        settings: of each member, beside its state.
        block: states of all members by the names of their arrays, such as "drives.mode", each (members, ...).
        motions: states of bullwheels and rope couplings, likewise.

    Args:
        base: simulation at its start, at which all members begin.
        size: number of members.
    """

    def __init__(self, base: Simulation, size: int) -> None:
        engine, vehicles = base.engine, len(base.scenario.vehicles)
        self.base, self.size = base, size
        self.arrays = Members(
            states=np.zeros((size, engine.memory.size), dtype=np.uint8),
            motions=np.zeros((size, engine.moving.memory.size), dtype=np.uint8),
            systems=np.zeros((size, len(engine.parts)), dtype=np.int64),
            left=np.zeros(size, dtype=np.int64),
            stopped=np.zeros(size, dtype=np.bool_),
            loading=np.zeros(size, dtype=np.bool_),
            stations=np.zeros((size, vehicles)),
            ropes=np.zeros((size, vehicles), dtype=np.int64),
            counts=np.zeros((size, ASKING + 1), dtype=np.int64),
            sums=np.zeros((size, MOVED + 1)),
        )
        self.variants: list[Simulation] = [base] * size
        self.settings: list[Settings] = [engine.settings()] * size
        self.block: Any = self.arrays.states.view(engine.memory.base.dtype)[:, 0]  # type: ignore[union-attr]
        moving: Any = engine.moving.memory.base
        self.motions: Any = self.arrays.motions.view(moving.dtype)[:, 0]
        state = engine.parts[0].state
        first = state.clock.ctypes.data - engine.memory.ctypes.data
        self._clock_bytes = slice(first, first + state.clock.nbytes)
        self._rest_loads = np.zeros((size, *state.tower_load.shape))
        self._reading: tuple[Any, ...] | None = None
        self._entered: tuple[Any, ...] = (None, None, None)  # parameters and start that the memory has now
        rows = list(range(size))
        self.arrays.states[:], self.arrays.motions[:] = engine.memory, engine.moving.memory
        self.take(rows, self.settings[0])

    def enter(self, member: int) -> Simulation:
        """Load the present state of a member into the simulation that has the member's parameters."""
        variant, arrays, settings = self.variants[member], self.arrays, self.settings[member]
        self._write(member)
        stations, ropes = arrays.stations[member].copy(), arrays.ropes[member].copy()
        vehicles = settings.vehicles._replace(stations=stations, ropes=ropes)
        variant.take_over(settings._replace(vehicles=vehicles), self.report(member))
        self._entered = variant, settings.parameters, settings.start
        return variant

    def read(self, member: int) -> Simulation:
        """Load the present state of a member into a simulation, for reading its snapshot only."""
        settings, variant = self.settings[member], self.variants[member]
        if not is_same((variant, settings.parameters, settings.start), self._entered):
            return self.enter(member)
        self._write(member)
        variant.show(self.report(member))
        return variant

    def leave(self, member: int, simulation: Simulation) -> None:
        """Store the present state of a simulation as the state of a member."""
        engine = self.base.engine
        self.arrays.states[member], self.arrays.motions[member] = engine.memory, engine.moving.memory
        self.take([member], simulation.engine.settings())

    def take(self, rows: Sequence[int], settings: Settings) -> None:
        """Assign the settings of a simulation to some members."""
        arrays, self._entered = self.arrays, (None, None, None)
        for member in rows:
            self.settings[member] = settings
        arrays.systems[rows] = [address(packed) for _, packed in settings.parameters]
        arrays.stopped[rows], arrays.loading[rows] = settings.stopped, bool(settings.vehicles.loading)
        arrays.stations[rows], arrays.ropes[rows] = settings.vehicles.stations, settings.vehicles.ropes
        self._rest_loads[rows] = settings.start.before.record.tower_load

    def _write(self, member: int) -> None:
        engine = self.base.engine
        engine.memory[:], engine.moving.memory[:] = self.arrays.states[member], self.arrays.motions[member]

    def numbers(self) -> FloatArray:
        """Values (members, n) of the present snapshots of all members, in the order of the layout."""
        base = self.base
        numbers = np.empty((self.size, base.layout.size))
        if len(base.engine.parts) > 1:
            for member in range(self.size):
                numbers[member] = self.read(member).snapshot.numbers
            return numbers
        self._entered = None, None, None
        if self._reading is None:
            arguments, row = base.observer.arguments()
            observe(*arguments)
            system, state, sections, places, _, lateral, columns = arguments
            code, arrays = address_of(observe, arguments, NOTHING), pack(self.arrays)
            before = code, arrays, system, state, sections, places
            self._reading = before, (lateral, columns, row)
        first, last = self._reading
        observe_members(*first, self._rest_loads, *last, numbers)
        numbers[:, 0] = self.times
        return numbers

    @property
    def clocks(self) -> NDArray[np.int64]:
        """Steps (members,) since the start of each member."""
        return self.arrays.states[:, self._clock_bytes].view(np.int64)[:, 0]

    @property
    def times(self) -> FloatArray:
        """Simulated time (members,) in s of each member."""
        times: FloatArray = np.round(self.clocks * self.base.step * 1e9) / 1e9
        return times

    def reset_counts(self, rows: Any) -> None:
        """Reset the counted steps and solver outcomes of some members to zero."""
        self.arrays.counts[rows], self.arrays.sums[rows] = 0, 0.0

    def report(self, member: int) -> SolverReport:
        """Solver report of a member since its counts began."""
        counts, sums = self.arrays.counts[member], self.arrays.sums[member]
        steps, iterations, halvings = counts[[STEPS, ITERATIONS, HALVINGS]].tolist()
        return SolverReport(steps, iterations, halvings, *sums[[GAP, LOST, MOVED]].tolist())

    def fault(self, member: int, clock: int) -> str:
        """Reason for the end of a member, empty while it runs; `clock` counts the steps done before this call."""
        if self.arrays.counts[member, STATUS] != FAILED:
            simulation = self.enter(member)
            cause = penetration_of(simulation)
            return f"{cause}; the simulation keeps its state at {simulation.time:g} s" if cause else ""
        counts, sums = self.arrays.counts[member], self.arrays.sums[member]
        outcome = Outcome(
            converged=False,
            steps=int(self.clocks[member]) - clock,
            iterations=int(counts[ITERATIONS]),
            halvings=int(counts[HALVINGS]),
            gap=float(sums[GAP]),
            increment=float(sums[INCREMENT]),
            element=int(counts[ELEMENT]),
            lost=float(sums[LOST]),
            moved=float(sums[MOVED]),
        )
        return step_failure(self.base.system.solver, clock, outcome)


def is_same(one: Any, other: Any) -> bool:
    """Whether two values are one object, or tuples of the same objects."""
    if one is other:
        return True
    if not isinstance(one, tuple) or not isinstance(other, tuple) or len(one) != len(other):
        return False
    return all(is_same(*pair) for pair in zip(one, other, strict=True))


def looks_of(base: Simulation) -> Looks:
    """Settings of the checks between calls of the integrator, for members that share a simulation's system."""
    before, after = base.meeting_pairs
    nodes = sum(len(part.state.nodes.position) for part in base.engine.parts)
    return Looks(
        before=before,
        after=after,
        exchanges=base.engine.vehicles.exchanges,
        period=max(round(PERIOD / base.step), 1),
        most=max(PART // nodes, 1),
    )
