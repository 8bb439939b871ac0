"""Queries of a simulation: snapshots, shape, tension, clearance, energy, natural modes."""

from __future__ import annotations

from dataclasses import astuple
from functools import cached_property
from typing import Any

import numpy as np

from cable_twin.frame.records import Clearance, Energy, SolverReport
from cable_twin.frame.snapshot import Layout, Snapshot
from cable_twin.geometry.ground import clearance_seen, surroundings_of
from cable_twin.mechanics.language.by_reference import pack
from cable_twin.mechanics.parameters import FloatArray
from cable_twin.mechanics.readout.clearances import Surroundings, look_around
from cable_twin.mechanics.readout.columns import observe
from cable_twin.mechanics.readout.energies import energies
from cable_twin.mechanics.readout.samples import places_on, sample_positions
from cable_twin.mechanics.readout.sections import recover_sections, sample_tensions
from cable_twin.scenario import Scenario
from cable_twin.simulation.engine import Engine
from cable_twin.simulation.ropeway import Ropeway

ROPE_POINTS = 10  # of an element, at which its clearance is taken
SHAPE_POINTS = 32  # of an element, among which the largest displacement of a mode is looked for
LEAST_SAMPLES = 2  # of a rope: its ends
LEAST = 1e-9  # of a length, by which a place may be off the rope: rounding


def time_of(clock: int, step: float) -> float:
    """Time (s) after `clock` steps (s), rounded to whole nanoseconds for an exact round trip through a log."""
    return round(clock * step * 1e9) / 1e9


class Queries:
    """Queries of the present state of a simulation, which leave it unchanged."""

    _ropeway: Ropeway  # the first rope with what is on it
    _parts: list[Ropeway]
    _engine: Engine
    _observer: Observer
    _on_demand: bool
    _report: SolverReport
    _seen: Snapshot | None

    @property
    def snapshot(self) -> Snapshot:
        """Snapshot of the present state of the simulation."""
        if self._seen is None:
            self._seen = self._observe()
        return self._seen

    def cable_positions(self, arc_lengths: FloatArray, rope: str | None = None) -> FloatArray:
        """Points (n, 3) in m of a rope, by default of the first, at unstrained arc lengths (n,) in m.

        Raises:
            ValueError: when there is no rope of that name, or no such place on it.
        """
        part, arc_lengths = self._places(rope, arc_lengths)
        positions = np.empty((arc_lengths.size, 3))
        sample_positions(
            part.system.cable, part.state, places_on(part.system.cable, part.state, arc_lengths), positions
        )
        return positions

    def cable_tension(self, arc_lengths: FloatArray, rope: str | None = None) -> FloatArray:
        """Tension (n,) in N of a rope at unstrained arc lengths (n,) in m, from the forces in its sections.

        The tension jumps at a load; at the load itself it is the tension before.

        Raises:
            ValueError: when there is no rope of that name, or no such place on it.
        """
        part, arc_lengths = self._places(rope, arc_lengths)
        tensions = np.empty(arc_lengths.size)
        self._engine.couple()
        recover_sections(part.system, part.state, part.sections)
        places = places_on(part.system.cable, part.state, arc_lengths)
        sample_tensions(part.system, part.state, part.sections, places, tensions)
        return tensions

    def clearance(self) -> Clearance:
        """Least heights of ropes and vehicles above the ground, with their places.

        Raises:
            ValueError: when the scenario has no terrain.
        """
        if not self._ropeway.scenario.terrain:
            raise ValueError("clearance: given a scenario without terrain; allowed: one with terrain")
        each = {name: self._clearance_of(name, part) for name, part in zip(self._lookouts, self._parts, strict=True)}
        ropes = {name: one.rope for name, one in each.items()}
        vehicles = {name: place for one in each.values() for name, place in one.vehicles.items()}
        return Clearance(min(ropes.values(), key=lambda place: place.height), vehicles, ropes)

    def _clearance_of(self, name: str, part: Ropeway) -> Clearance:
        """Least heights above the ground of one rope and its vehicles, with their places."""
        cable, lookout, columns = part.system.cable, self._lookouts[name], self.snapshot.columns
        points = np.linspace(0.0, cable.unstrained_length, ROPE_POINTS * cable.element_count + 1, dtype=np.float64)
        rope, rows = self.cable_positions(points, name), [*part.rows.values()]
        riding = columns.attached[rows] * (columns.vehicle_rope[rows] == self._parts.index(part))
        first = self._observer.layout.first_body
        bodies = [body for row in rows for body in range(first[row], first[row + 1])]
        look_around(lookout, rope, riding, columns.body_position[bodies], columns.body_orientation[bodies])
        return clearance_seen(lookout, name, [*part.rows], riding)

    def energy(self) -> Energy:
        """Mechanical energy (J) of ropes, vehicles and bullwheels now, without connectors and pantographs."""
        each = [energies(part.system, part.state) for part in self._parts] + [astuple(self._engine.energy())]
        return Energy(*np.sum(each, axis=0).tolist())

    def natural_frequencies(self, count: int) -> FloatArray:
        """Lowest natural frequencies (count,) in Hz about the present shape, with every joint held.

        Raises:
            ValueError: when there are fewer, or several ropes.
        """
        return self._modes(count)[0]

    def mode_shapes(self, count: int, arc_lengths: FloatArray) -> FloatArray:
        """Shapes (count, n, 3) of the lowest natural modes at unstrained arc lengths (n,) in m.

        The largest component of the displacement on the rope is 1, wherever the shapes are looked at.

        Raises:
            ValueError: when there are fewer modes, several ropes, or no such place on the rope.
        """
        _, shapes = self._modes(count)
        _, arc_lengths = self._places(None, arc_lengths)
        cable, state = self._ropeway.system.cable, self._ropeway.state
        whole = np.linspace(0.0, cable.unstrained_length, SHAPE_POINTS * cable.element_count + 1)
        result = np.empty((count, arc_lengths.size + whole.size, 3))
        places = places_on(cable, state, np.concatenate([arc_lengths, whole]))
        for shape, positions in zip(shapes, result, strict=True):
            nodes = state.nodes._replace(position=np.ascontiguousarray(shape))
            sample_positions(cable, state._replace(nodes=nodes), places, positions)
        return result[:, : arc_lengths.size] / np.abs(result).max(axis=(1, 2), keepdims=True)

    def _modes(self, count: int) -> tuple[FloatArray, FloatArray]:
        from cable_twin.mechanics.solution.modes import natural_modes  # noqa: PLC0415 - sparse solvers, for no start

        if len(self._parts) > 1:
            count = len(self._parts)
            raise ValueError(f"natural frequencies: given a scenario of {count} ropes; allowed: one rope")
        return natural_modes(self._ropeway.system, self._ropeway.state, count)

    def _show(self, report: SolverReport) -> None:
        """Update the present snapshot; `report` is the solver report for it."""
        self._report = report
        self._seen = None if self._on_demand else self._observe()

    def _observe(self) -> Snapshot:
        return self._observer.snapshot(self.time, self._report)

    @property
    def time(self) -> float:
        """Simulated time (s)."""
        return time_of(int(self._ropeway.state.clock[0]), self._ropeway.system.solver.step)

    @cached_property
    def _lookouts(self) -> dict[str, Surroundings]:
        """Ground and obstacles around each rope, built at the first query of clearance."""
        ropes = zip(self._observer.layout.ropes, self._parts, strict=True)
        return {name: surroundings_of(part.scenario) for name, part in ropes}

    def _places(self, rope: str | None, arc_lengths: FloatArray) -> tuple[Ropeway, FloatArray]:
        """Ropeway of a rope, and checked arc lengths (m) on it, as a writable copy for kernels.

        Raises:
            ValueError: there is no such rope, it has no such place, or the places are no list of numbers.
        """
        part, places = self._part(rope), np.array(arc_lengths, dtype=np.float64, order="C")
        if places.ndim != 1:
            raise ValueError(f"arc lengths: given {places.ndim} dimensions; allowed: one, a list of numbers in m")
        length = part.system.cable.unstrained_length
        off = places[~((places >= -LEAST * length) & (places <= (1.0 + LEAST) * length))]
        if off.size:
            raise ValueError(f"arc length: given {off.flat[0]:.9g} m; allowed: 0 to {length:.9g} m, on the rope")
        return part, places

    def _part(self, rope: str | None) -> Ropeway:
        """Ropeway of a rope by name; without a name, of the first rope.

        Raises:
            ValueError: there is no rope of that name.
        """
        names = list(self._observer.layout.ropes)
        if rope is not None and rope not in names:
            raise ValueError(f"rope: given {rope!r}; allowed: {', '.join(names)}")
        return self._parts[0 if rope is None else names.index(rope)]


class Observer:
    """Builder of snapshots from the states of one scenario.

    Args:
        scenario: scenario of the run.
        engine: engine to read the state from.
        samples: points (at least 2) at which snapshots hold each rope.
    """

    def __init__(self, scenario: Scenario, engine: Engine, samples: int) -> None:
        if isinstance(samples, bool) or not isinstance(samples, int | np.integer) or samples < LEAST_SAMPLES:
            raise ValueError(f"samples: given {samples!r}; allowed: a whole number from {LEAST_SAMPLES}")
        self._engine, self.samples = engine, int(samples)
        self.layout = layout = Layout.of(scenario, samples)
        self._numbers = np.zeros(layout.size)
        self._columns = layout.columns(self._numbers)
        self._of_ropes: list[tuple[Ropeway, tuple[Any, ...], tuple[Any, ...]]] = []

    def _prepare(self) -> None:
        """Locate the samples on ropes; only at the first snapshot, as a start is checked before kernels compile."""
        for number, (part, samples) in enumerate(zip(self._engine.parts, self.layout.ropes.values(), strict=True)):
            places = places_on(part.system.cable, part.state, self.layout.arc_lengths[samples])
            read = pack(part.state), pack(part.sections), pack(places)
            lateral = [*self.layout.laterals.values()][number]
            self._of_ropes.append((part, read, (lateral, pack(self.layout.columns_of(number, self._columns)))))

    def arguments(self) -> tuple[tuple[Any, ...], FloatArray]:
        """Arguments of the kernel `observe` for the first rope, and the row (n,) of values that the kernel writes."""
        if not self._of_ropes:
            self._prepare()
        part, read, written = self._of_ropes[0]
        return (part.packed_system, *read, part.start.tower_load, *written), self._numbers

    def snapshot(self, time: float, report: SolverReport) -> Snapshot:
        """Read a snapshot from the present state.

        Args:
            time: s.
            report: solver report since the previous snapshot.
        """
        if not self._of_ropes:
            self._prepare()
        self._engine.couple()
        for part, read, written in self._of_ropes:
            observe(part.packed_system, *read, part.start.tower_load, *written)
        self._engine.observe(self._columns)
        self._numbers[0] = time
        return Snapshot(self.layout, self._numbers.copy(), report)


def read_only(arrays: Any) -> Any:
    """Read-only views of the arrays of a named tuple."""
    if isinstance(arrays, tuple):
        return type(arrays)(*map(read_only, arrays))
    view = arrays.view()
    view.flags.writeable = False
    return view
