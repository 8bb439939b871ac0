"""Ropeway of one rope, target of commands: parameters, state, drives, and commands in force."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cable_twin.basics.units import with_unit
from cable_twin.frame.records import Command
from cable_twin.mechanics.drives.haul_rope import hang_in_rope
from cable_twin.mechanics.drives.motion import set_going, take_over
from cable_twin.mechanics.drives.stations import hang_in_station, park
from cable_twin.mechanics.language.by_reference import pack
from cable_twin.mechanics.language.compilation import as_python
from cable_twin.mechanics.language.rotations import no_turn
from cable_twin.mechanics.language.simd import WIDTH
from cable_twin.mechanics.on_rope.hinge import Above
from cable_twin.mechanics.on_rope.presence import vehicles_of
from cable_twin.mechanics.on_rope.wind import set_wind
from cable_twin.mechanics.parameters import DRUM, FORCE, FREE, SPEED, TRACK_ROPE, FloatArray, System
from cable_twin.mechanics.readout.sections import Sections, allocate_sections
from cable_twin.mechanics.rope.element import element_tensions
from cable_twin.mechanics.solution.catenary import EquilibriumError, beyond_travel, check_rest
from cable_twin.mechanics.solution.equilibrium import lay_cable, lay_straight, settle, without_stops
from cable_twin.mechanics.solution.prediction import Coefficients
from cable_twin.mechanics.state import State, Workspace
from cable_twin.scenario import Scenario
from cable_twin.scenario.sections.vehicles import Carriage

DRIVE_MODES = {"free": FREE, "force": FORCE, "speed": SPEED}


class Ropeway:
    """One rope with its vehicles: parameters, motion, start for resets, and drive commands in force.

    Attributes:
        scenario: scenario of the rope alone.
        vehicles: vehicles that may be on the rope, by name, as in that scenario.
        rows: row of each vehicle among the vehicles of all ropes.
        packed_system: parameters, with payloads, for kernels.
        state: motion, written in place; in one block of memory with that of all ropes.
        sections: forces in the rope, for a readout.
        start: state to which a reset goes back.
        stopped: whether an emergency stop is in force.
        commands: the last drive command in force of each carriage or drive that has one.
    """

    def __init__(self, scenario: Scenario, system: System, state: State, rows: Mapping[str, int]) -> None:
        """Rope of a `scenario` of one rope, with parameters, state, and rows of all vehicles by name."""
        self.scenario, self.vehicles = scenario, scenario.vehicles
        self.rows = {name: rows[name] for name in self.vehicles}
        self.system = system
        self.state = self.start = state
        self.sections: Sections = allocate_sections(system)
        self.stopped = False
        self.commands: dict[str, Command] = {}
        set_wind(self.state, np.array(scenario.vector(scenario.air.wind)))
        self.state.temperature[0] = scenario.air.temperature

    def holds(self, vehicle: Carriage) -> bool:
        """Return whether a vehicle is on the rope at the start, not in a station."""
        riding = self.scenario.riding
        if riding and vehicle.clamped_to:
            return riding.on_track(vehicle.clamped_to[riding.strand])
        return vehicle.joint != "clamped" or vehicle.arc_length <= self.scenario.cable.unstrained_length

    def place(self, row: int, vehicle: Carriage) -> None:
        """Place a vehicle on the rope or in a station of the rope, at the start."""
        self.state.vehicle_rope[row] = max(self.system.number, 0)
        self.state.joints.position[row] = vehicle.arc_length
        if vehicle.joint == "sliding":
            self.state.drives.mode[row] = DRIVE_MODES[vehicle.drive.mode]
        if self.holds(vehicle):
            return
        riding = self.scenario.riding
        if riding is None:
            park(self.system, self.state, row, vehicle.arc_length)
        else:
            place = vehicle.clamped_to[riding.strand]
            beyond = riding.loop_length - place
            end = self.system.cable.unstrained_length if place - riding.length < beyond and place > 1.0 else 0.0
            hang_in_station(self.system, self.state, row, end)

    def check_bare(self, *, loaded: bool = False) -> None:
        """Refuse a bare cable without an equilibrium at its start, by checks without any kernel.

        Args:
            loaded: whether anything hangs on the cable besides its own vehicles and loads.

        Raises:
            EquilibriumError: there is none; the message names the value that does not fit.
        """
        if self.scenario.cable.initial_shape != "straight":
            check_rest(self.system, tuple(self.scenario.towers), loaded=loaded or self._is_loaded)
            lay_cable(self.system, self.state)

    def lay(self, work: Workspace, ends: FloatArray | None) -> None:
        """Bring the cable to its initial shape, with its ends at `ends` (2, dim) in m where given.

        Args:
            work: scratch space.
            ends: places (2, dim) in m of its ends, None for those of the scenario.

        Raises:
            EquilibriumError: the cable with its carriages has no static equilibrium.
        """
        cable = self.scenario.cable
        if cable.initial_shape == "straight":
            ends = np.array([self.scenario.vector(end.position) for end in (cable.start, cable.end)])
            lay_straight(self.system, self.state, ends[0], ends[1])
        else:
            moved = self.system.cable if ends is None else self.system.cable._replace(end_position=ends)
            settle(self.system._replace(cable=moved), self.state, work)

    def take_over_rest(self) -> None:
        """Initialise drives and haul ropes with the holding forces of the equilibrium.

        Raises:
            EquilibriumError: a haul rope would have to push.
        """
        hang_in_ropes(self.system, self.state, self.rows)
        self.commands = self._set_in_motion()

    def _set_in_motion(self) -> dict[str, Command]:
        """Set the initial speeds of the scenario; returns the commands that keep these speeds, by carriage or drive."""
        held, system, state = {}, self.system, self.state
        for name, drive in self.scenario.drives.items():
            if drive.speed != 0.0:
                state.rope.velocity[:] = state.rope_drive.target[0] = drive.speed
                held[name] = Command("speed", {name: drive.speed})
                self.carry_clamped_at(drive.speed)
        for name, vehicle in self.vehicles.items():
            if vehicle.speed != 0.0:
                set_going(system, state, self.rows[name], vehicle.speed)
                if state.drives.mode[self.rows[name]] == SPEED:
                    state.drives.target[self.rows[name]] = vehicle.speed
                    held[name] = Command("speed", {name: vehicle.speed})
        return held

    def carry_clamped_at(self, speed: float) -> None:
        """Set the vehicles clamped to the rope in motion at its `speed` (m/s)."""
        for index in np.flatnonzero(self.system.carriages.clamped & self.riding).tolist():
            set_going(self.system, self.state, index, speed)

    def stop(self) -> None:
        """Begin the emergency stop of the rope and its driven vehicles, and drop the commands in force."""
        if not self.stopped:
            self.state.drives.braking_time[:] = 0.0
        self.stopped = True
        self.commands.clear()
        self.state.rope_drive.target[0] = 0.0
        self.state.rope_drive.braking[0] = True
        for row in self.rows.values():
            brake(self.system, self.state, row)

    def check_travel(self, together: list[Ropeway], find_rest: Callable[[], None]) -> None:
        """Refuse a counterweight that rests on its upper travel limit and so does not tension the rope in equilibrium.

        Args:
            together: all ropes of a common equilibrium, this one included.
            find_rest: finds their equilibrium; called again, without limits of any travel, before a refusal.

        Raises:
            EquilibriumError: tells where the counterweight would rest, and how much the length has to change.
        """
        weights = self.system.counterweights
        for end in np.flatnonzero(weights.mass > 0.0).tolist():
            if self._travel(end) >= weights.travel[end, 1]:
                limited = self.system
                for part in together:
                    part.system = without_stops(part.system)
                find_rest()
                raise EquilibriumError(beyond_travel(limited, end, self._travel(end)))

    def _travel(self, end: int) -> float:
        """Travel (m) of the counterweight at an end."""
        moved = self.state.nodes.position[-end, 0] - self.system.cable.end_position[end]
        return float(moved @ self.system.counterweights.direction[end])

    @property
    def riding(self) -> NDArray[np.bool_]:
        """Mask (vehicles,) of the vehicles that are attached to the rope now."""
        return self.state.attached & vehicles_of(self.system, self.state)

    @property
    def _is_loaded(self) -> bool:
        """Whether vehicles or loads hang on the rope."""
        return bool(self.vehicles or self.system.cable.load_force.any())

    @property
    def is_taut(self) -> bool:
        """Whether the rope is shorter than the distance of its two fixed ends, with no tower between them."""
        cable = self.scenario.cable
        held = {end.support for end in (cable.start, cable.end)} <= {"pinned", "hydraulic"}
        apart = float(np.linalg.norm(np.subtract(cable.end.position, cable.start.position)))
        return held and not self.scenario.towers and cable.unstrained_length < apart

    def typical(self, work: Workspace) -> dict[str, Any]:
        """Sample arguments, by parameter name, of kernels for one rope; only their types count.

        A kernel with a parameter that is missing here is not compiled ahead; a test names such kernels.
        """
        system, state = self.system, self.state
        whole = {"system": system, "state": state, "before": state, "work": work, "sections": self.sections}
        inner = {"wind": system.air.wind, "field": state.wind_field, "coordinates": state.nodes.position}
        inner |= {name: getattr(work, name) for name in ("diagonal", "upper", "lower", "right_side")}
        inner["patch_columns"] = work.no_columns
        counts = ("carriage", "contact", "tower", "end", "body", "element", "station")
        counts_beside_loads = ("number", "count", "first", "node", "slot", "lane")
        sizes = "mass_factor", "rate_factor", "stiffness_factor", "duration", "h", "arc_length", "speed", "normal"
        numbers: dict[str, Any] = dict.fromkeys((*counts, *counts_beside_loads), 0)
        numbers |= dict.fromkeys(
            (*sizes, "rope_drag", "share", "of_slopes", "increment", "previous", "s", "s_dot", "travel", "least"), 1.0
        )
        like, still = system.cable.gravity, no_turn(system.cable.gravity)
        vectors: dict[str, Any] = dict.fromkeys(
            ("gravity", "like", "pivot", "moved", "force", "by_force", "residual"), like
        )
        vectors |= {"direction": (0.0, 0.0, 0.0), "turned": still, "impedance": (like,) * len(like)}
        method = {"c": Coefficients(0.0, 0.0, 0.0, 0.0), "above": Above(like, still), "topmost": True}
        return whole | system._asdict() | inner | numbers | vectors | method

    def mean_tension(self) -> float:
        """Mean tension (N) of the rope."""
        return float(np.average(self._element_tensions(), weights=self.state.mesh.length))

    def _element_tensions(self) -> FloatArray:
        """Mean tensions (elements,) in N of the elements from their strains."""
        count = self.system.cable.element_count
        tensions = np.empty((-(-count // WIDTH), WIDTH))
        element_tensions(self.system.cable, self.state, tensions)
        return tensions.ravel()[:count]

    @property
    def system(self) -> System:
        """Parameters of the rope and its vehicles, with payloads."""
        return self._system

    @system.setter
    def system(self, system: System) -> None:
        self.take(system, pack(system))

    def follow_temperature(self) -> None:
        """Write the temperature of the state into the parameters of the rope, if it has changed."""
        cable = self.system.cable
        stretch = self.scenario.cable.free_stretch(float(self.state.temperature[0]))
        if stretch != cable.free_stretch:
            self.system = self.system._replace(cable=cable._replace(free_stretch=stretch))

    def take(self, system: System, packed: Any) -> None:
        """Set the parameters of the rope and its vehicles, with their packed form for kernels."""
        self._system, self.packed_system = system, packed


def drive(state: State, index: int, kind: str, value: float) -> None:
    """Set mode ("speed" or "force") and target (m/s or N) of a drive, starting from its present motion."""
    if kind == "force":
        state.drives.mode[index] = FORCE
        state.drives.force[index] = value
        return
    if state.drives.mode[index] != SPEED:
        state.drives.mode[index] = SPEED
        as_python(take_over)(state, index, 0.0)
    state.drives.target[index] = value


def brake(system: System, state: State, index: int) -> None:
    """Emergency stop of one carriage as in the scenario: by its drive, its brakes, or the track-rope brake alone."""
    drives = system.carriages
    if drives.clamped[index]:
        return
    braked = bool(drives.brake_force[index].any())
    if state.drives.mode[index] == FREE and not braked:
        return
    stoppable = drives.drive_stops[index] or drives.brake_force[index, :TRACK_ROPE].any()
    if state.drives.mode[index] != FREE or stoppable:
        drive(state, index, "speed" if stoppable else "force", 0.0)
    state.drives.braking[index] = True


def hang_in_ropes(system: System, state: State, rows: Mapping[str, int]) -> None:
    """Initialise the haul ropes of vehicles with the forces that hold them; `rows`: row of each vehicle by name.

    Raises:
        EquilibriumError: a haul rope would have to push; the message names the carriage.
    """
    for name, index in rows.items():
        if state.axis[index] != DRUM:
            continue
        force = float(state.drives.force[index])
        if not hang_in_rope(system, state, index, force):
            raise EquilibriumError(
                f"carriages.{name}.drive.haul_rope: given one that would have to push with "
                f"{with_unit(abs(force), 'N')} to hold the carriage at its start; "
                "allowed: a pretension of as much, in N, or the drive at the other station"
            )
        if state.drives.mode[index] != SPEED:
            state.drives.force[index] = 0.0


@contextmanager
def of_rope(name: str) -> Iterator[None]:
    """Context manager that renames keys `cable.` in equilibrium errors to `ropes.NAME.`, as the scenario has them."""
    try:
        yield
    except EquilibriumError as error:
        raise EquilibriumError(str(error).replace("cable.", f"ropes.{name}.")) from None
