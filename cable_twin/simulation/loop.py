"""Strands of a closed loop and their bullwheels: initial layout, equilibrium, drives and outputs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np

from cable_twin.basics.units import rounded, with_unit
from cable_twin.frame.records import Command, Energy
from cable_twin.mechanics.language.by_reference import pack
from cable_twin.mechanics.language.compilation import as_python
from cable_twin.mechanics.language.declared import Kept, write
from cable_twin.mechanics.parameters import FORCE, SPEED, FloatArray, System
from cable_twin.mechanics.readout.columns import Columns
from cable_twin.mechanics.solution.bundle.bullwheels import observe_bullwheels, stop_wheel, update_end_tensions
from cable_twin.mechanics.solution.bundle.loop_rest import (
    CLOSE,
    MOST_ITERATIONS,
    NUDGE,
    TOLERANCE,
    on_bullwheels,
    rest_in_closed_form,
    settle_loop,
)
from cable_twin.mechanics.solution.bundle.records import (
    COUNTERWEIGHT,
    FIXED,
    BullwheelMotion,
    Bullwheels,
    Bundle,
    bullwheels_at_rest,
)
from cable_twin.mechanics.solution.catenary import Cure, EquilibriumError, check_rest, rest_over_supports
from cable_twin.mechanics.solution.equilibrium import hang_carriages
from cable_twin.scenario import Scenario
from cable_twin.scenario.checks.line import groove_faults
from cable_twin.simulation.ropeway import Ropeway, of_rope

LOOP_DIGITS = 9  # of a metre, to which places on the loop are known: what is clamped at a bullwheel stays on its side
LEAST_LEFT = 0.5  # of an element whose node goes along with a load that was moved
SOUND = 0.02  # of a pull: as near as that to what it has to be, another one is at fault


class Loop:
    """Bullwheels of one scenario, and the strands between them.

    Args:
        scenario: scenario of the run.
        bundle: parameters of its bullwheels and rope couplings.
        motion: motion of the bullwheels.
        parts: ropes with their vehicles, one for each rope.
    """

    def __init__(self, scenario: Scenario, bundle: Bundle, motion: BullwheelMotion, parts: list[Ropeway]) -> None:
        self._bundle, self._parts, self.motion = bundle, dict(zip(scenario.cables, parts, strict=True)), motion
        self._names, self._strands = list(scenario.sheaves), scenario.strands
        on_wheels = {name: drive.sheave for name, drive in scenario.drives.items() if drive.sheave is not None}
        self._drives = {name: self._names.index(sheave) for name, sheave in on_wheels.items()}
        driven = np.array([*self._drives.values()], dtype=np.int64)
        numbers = np.array([row for row, name in enumerate(scenario.drives) if name in self._drives], dtype=np.int64)
        self._packed = pack(bundle.sheaves), pack(motion), driven, numbers
        self.scenario, self.keeps_slopes = scenario, False
        self._slopes: FloatArray | None = None
        motion.drives.mode[driven] = SPEED

    def settle(self, relax: Any, roughly: Any = None, *, near: bool = False, explain: bool = True) -> None:
        """Find the equilibrium of a loop of strands; `relax` finds the equilibrium of all ropes between given ends.

        Args:
            relax: finds the equilibrium of all ropes between their given ends.
            roughly: does so for a system that is nearly the same and comes to rest from far away; None for none.
            near: whether the search begins at the equilibrium of similar strands.
            explain: whether a failure is looked into, which takes another search.

        Raises:
            EquilibriumError: there is none, or a bullwheel cannot hold the rope by friction.
        """
        first = next(iter(self._parts.values()))
        lengths = np.array([part.system.cable.unstrained_length for part in self._parts.values()])

        def rest(found: Any = relax) -> None:
            self._lay(along=near)
            found()
            update_end_tensions(self._bundle, self.motion, first.system, first.state)

        laid = Kept(first.state)
        try:
            if near and self.keeps_slopes:
                self._slopes = settle_near(self._bundle.sheaves, self.motion, rest, self._slopes)
            else:
                if roughly is not None:
                    settle_loop(self._bundle.sheaves, self.motion, lengths, partial(rest, roughly), CLOSE)
                settle_loop(self._bundle.sheaves, self.motion, lengths, rest)
        except EquilibriumError as error:
            if near or not explain:
                raise
            raise EquilibriumError(self._out_of_balance(str(error), lengths, rest, laid)) from None
        self.motion.traction[:] = self.motion.stretch * (self.motion.tension[:, 0] - self.motion.tension[:, 1])
        self.motion.drives.force[:] = np.where(self._bundle.sheaves.driven, self.motion.traction, 0.0)
        self._begin_here()
        self._check_adhesion()
        self._check_travel()

    def _out_of_balance(self, error: str, lengths: FloatArray, rest: Callable[[], None], laid: Kept) -> str:
        """Message of a loop without rest: which tensioning devices do not fit, a line each, where that is sure.

        It is sure where a device still pulls too little or too much with all devices held at those ends of their
        travel. Else the message is that of the search, and tells what the devices need at a travel of 0 m.

        Args:
            error: message of the search.
            lengths: (strands,) m.
            rest: finds the equilibrium of all ropes between the ends that bullwheels give them.
            laid: states with which the search began.
        """
        devices = [sheave.tensioning for sheave in self.scenario.sheaves.values()]
        given, nowhere = self._bundle.sheaves.pull.copy(), np.zeros(len(devices))
        needed = self._pulls_held(nowhere, lengths, rest, laid)
        rows = [row for row, device in enumerate(devices) if device is not None and needed[row] > 0.0]
        off = [row for row in rows if abs(given[row] - needed[row]) > SOUND * needed[row]]
        if off:
            ends = [
                0.0 if one is None else one.travel[int(g > n)] for one, g, n in zip(devices, given, needed, strict=True)
            ]
            left = (given - self._pulls_held(np.array(ends), lengths, rest, laid)) * np.sign(given - needed)
            if any(sure := [self._unfit(row, float(needed[row])) for row in off if left[row] > 0.0]):
                return "\n".join(sure)
        held = [f"{self._device(row)[0]} needs about {self._pull(row, float(needed[row]), 3)}" for row in rows]
        return error + (f"; with a travel of 0 m the loop rests, where {', '.join(held)}" if held else "")

    def _pulls_held(self, at: FloatArray, lengths: FloatArray, rest: Callable[[], None], laid: Kept) -> FloatArray:
        """Pulls (sheaves,) in N of strands at rest with all devices held `at` a travel (m); nan where none is found."""
        sheaves, motion = self._bundle.sheaves, self.motion
        write(laid, next(iter(self._parts.values())).state)
        motion.rope.position[:], motion.carriage.position[:] = 0.0, at
        try:
            settle_loop(sheaves._replace(tensioning=np.full_like(sheaves.tensioning, FIXED)), motion, lengths, rest)
        except EquilibriumError:
            return np.full_like(at, np.nan)
        return motion.pull.copy()

    def _unfit(self, row: int, needed: float) -> str:
        """Message about a tensioning device that cannot hold its strands, which need a pull (N) at a travel of 0 m."""
        key, weighed = self._device(row)
        given = float(self._bundle.sheaves.pull[row])
        pulling = f", which pulls with {with_unit(given, 'N', 3)}" if weighed else ""
        return (
            f"{key}: given {self._pull(row, given)}{pulling}: no static equilibrium; allowed: about "
            f"{self._pull(row, needed, 3)}, to rest at a travel of 0 m with ropes of this length and these loads"
        )

    def _device(self, row: int) -> tuple[str, bool]:
        """Key of what a tensioning device pulls with, and whether that is a mass."""
        name, sheave = self._names[row], self.scenario.sheaves[self._names[row]]
        weighed = sheave.counterweight is not None and sheave.counterweight.force is None
        device = "counterweight" if sheave.counterweight else "hydraulics"
        return f"sheaves.{name}.{device}.{'mass' if weighed else 'force'}", weighed

    def _pull(self, row: int, pull: float, digits: int = 4) -> str:
        """Text of the mass (kg) or force (N) with which a tensioning device has a pull (N)."""
        scale, unit = (1.0 / self.scenario.gravity, "kg") if self._device(row)[1] else (1.0, "N")
        return f"{rounded(pull * scale, digits)} {unit}"

    def _lay(self, *, along: bool = False) -> None:
        """Move strand ends to their bullwheels, and clamped vehicles to their places on the moved strands.

        Args:
            along: whether nodes move along the rope, which keeps it on its towers, and vehicles keep their pose beside
                them; else nodes move as the ends do, and vehicles hang down.
        """
        motion, sheaves = self.motion, self._bundle.sheaves
        parts, passed = list(self._parts.values()), 0.0
        before = [_points(part) for part in parts] if along else []
        for sheave in range(len(self._names)):
            for side in range(2):
                part = parts[sheaves.rope[sheave, side]]
                cable, nodes = part.system.cable, part.state.nodes
                part.state.rope.position[1 - side] = motion.rope.position[sheave]
                way = motion.carriage.position[sheave] * sheaves.direction[sheave]
                moved = cable.end_position[1 - side] + way - nodes.position[-1 if side == 0 else 0, 0]
                share = cable.node_arc_length / cable.unstrained_length  # all of it comes along, so none is crushed
                share = share if side == 0 else 1.0 - share
                if along:
                    _move_along(part, moved, share, -1 if side == 0 else 0)
                else:
                    nodes.position[:, 0] += np.outer(share, moved)
        for name in self._strands:
            part = self._parts[name]
            state, length = part.state, part.system.cable.unstrained_length
            gone = state.rope.position
            stretch = 1.0 + (gone[0] - gone[1]) / length
            state.loop_start[0] = passed + gone[0]
            moving, carriages = part.system.moving_cable, part.system.carriages
            places = ((carriages.loop_place - moving.loop_offset) % moving.loop_length - passed) / stretch
            passed += (stretch - 1.0) * length
            on = carriages.clamped & part.riding
            state.joints.position[on] = np.clip(places, 0.0, length)[on]
            state.reference.position[on] = state.joints.position[on]
            if along:
                _take_load_nodes_along(part)
            else:
                hang_carriages(part.system, state)
        for part, points in zip(parts, before, strict=along):
            riding = np.repeat(part.riding, np.diff(part.system.carriages.body_offset))
            moved = _points(part) - points
            part.state.bodies.position[riding, : moved.shape[1]] += moved[riding]

    def take_up(self) -> None:
        """Set the travel of bullwheels to the rope lengths of the strands in the present state."""
        if not self._names:
            return
        sheaves, rows = self._bundle.sheaves, {name: row for row, name in enumerate(self._parts)}
        fixed = np.flatnonzero(sheaves.driven)[:1] if np.any(sheaves.driven) else np.zeros(1, np.int64)
        gone, surplus = np.zeros((len(self._strands) + 1, len(self._names))), np.zeros(len(self._strands) + 1)
        for line, name in enumerate(self._strands):
            gone[line] = 1.0 * (sheaves.rope[:, 1] == rows[name]) - 1.0 * (sheaves.rope[:, 0] == rows[name])
            surplus[line] = self._parts[name].state.surplus[0]
            self._parts[name].state.surplus[0] = 0.0
        gone[-1, fixed] = 1.0
        self.motion.rope.position[:] = np.linalg.lstsq(gone, surplus, rcond=None)[0]
        self._lay(along=True)

    def _begin_here(self) -> None:
        """Set the travel of all strands and bullwheels to zero in the present state."""
        for name in self._strands:
            state = self._parts[name].state
            state.surplus[0] = state.rope.position[0] - state.rope.position[1]
            state.loop_start[0] = round(float(state.loop_start[0] - state.rope.position[0]), LOOP_DIGITS)
            state.rope.position[:] = 0.0
        self.motion.rope.position[:] = 0.0

    def _check_adhesion(self) -> None:
        """Refuse a start with a tension ratio at a bullwheel beyond rope friction."""
        for row, (on, off) in enumerate(self.motion.tension.tolist()):
            used, most = max(on / off, off / on), float(self._bundle.sheaves.adhesion[row])
            if min(on, off) <= 0.0 or used > most:
                raise EquilibriumError(
                    f"sheaves.{self._names[row]}: at rest its strands pull with {with_unit(on, 'N')} and "
                    f"{with_unit(off, 'N')}, a ratio of {used:.3g}, and the rope would slip; "
                    f"allowed: up to {most:.3g}, exp(friction times wrap)"
                )

    def _check_travel(self) -> None:
        """Refuse a start with a counterweight or a cylinder outside its travel."""
        for row, (name, sheave) in enumerate(self.scenario.sheaves.items()):
            device, travel = sheave.tensioning, float(self.motion.carriage.position[row])
            if device is None or device.travel[0] <= travel <= device.travel[1]:
                continue
            way = "shorter" if travel > device.travel[1] else "longer"
            pull = "less" if travel > device.travel[1] else "more"
            beyond = max(device.travel[0] - travel, travel - device.travel[1])
            raise EquilibriumError(
                f"sheaves.{name}.{'counterweight' if sheave.counterweight else 'hydraulics'}.travel: given "
                f"{device.travel[0]:g} to {device.travel[1]:g} m, but it rests at {travel:.4g} m; allowed: limits "
                f"around that, {pull} pull, or ropes that are {with_unit(2.0 * beyond, 'm', 3)} {way} in all"
            )

    def set_in_motion(self) -> dict[str, Command]:
        """Give the rope of the loop its initial speed; returns the commands that keep that speed, by drive."""
        held = {}
        for name in self._drives:
            if (drive := self.scenario.drives[name]).speed != 0.0:
                held[name] = Command("speed", {name: drive.speed})
                self.motion.drives.target[self._drives[name]] = drive.speed
                self.motion.rim.velocity[:] = self.motion.rope.velocity[:] = drive.speed
                for strand in self._strands:
                    part = self._parts[strand]
                    part.state.rope.velocity[:] = drive.speed
                    part.carry_clamped_at(drive.speed)
        return held

    def drive(self, name: str, kind: str, value: float) -> None:
        """Apply a speed (m/s) or force (N) command to a drive."""
        row = self._drives[name]
        if kind == "force":
            self.motion.by_forces[row] = 0  # they are new
            self.motion.drives.mode[row], self.motion.drives.force[row] = FORCE, value
            return
        if self.motion.drives.mode[row] != SPEED:
            self.motion.by_forces[row] = 0
            self.motion.drives.mode[row] = SPEED
            self.motion.rim.acceleration[row] = 0.0
        self.motion.drives.target[row] = value

    @property
    def drives(self) -> tuple[str, ...]:
        """Names of the bullwheel drives."""
        return tuple(self._drives)

    @property
    def rolled_back(self) -> bool:
        """Whether a rollback has triggered the emergency stop of the loop."""
        return bool(self._names) and bool(self.motion.rolled_back.any())

    def stop(self) -> None:
        """Begin the emergency stop of all bullwheels."""
        for sheave in range(len(self._names)):
            as_python(stop_wheel)(self._bundle.sheaves, self.motion, sheave)

    def release(self) -> None:
        """Release the emergency stop of the bullwheels."""
        motion = self.motion
        motion.drives.braking[:] = motion.by_forces[:] = motion.rolled_back[:] = 0
        motion.rim.acceleration[:] = 0.0

    def observe(self, columns: Columns) -> None:
        """Fill the columns of a snapshot for bullwheels and their drives."""
        if self._names:
            observe_bullwheels(*self._packed, columns)

    def energy(self) -> Energy:
        """Energy (J) of the bullwheels, the rope on them, and their tensioning devices."""
        motion, sheaves = self.motion, self._bundle.sheaves
        kinetic = 0.5 * (sheaves.inertia @ motion.rim.velocity**2 + sheaves.wrapped @ motion.rope.velocity**2)
        moved = sheaves.tensioning == COUNTERWEIGHT
        kinetic += 0.5 * float(sheaves.mass[moved] @ motion.carriage.velocity[moved] ** 2)
        depth = np.maximum(sheaves.travel[:, 0] - motion.carriage.position, 0.0)
        depth = depth + np.maximum(motion.carriage.position - sheaves.travel[:, 1], 0.0)
        elastic = 0.5 * float(sheaves.buffer_stiffness @ depth**2)
        return Energy(float(kinetic), elastic, -float(sheaves.pull[moved] @ motion.carriage.position[moved]))


def _move_along(part: Ropeway, moved: FloatArray, share: FloatArray, end: int) -> None:
    """Move the nodes of a strand along the rope by their shares of the displacement of one end.

    The displacement of the end across the strand is taken by the last span alone.

    Args:
        part: rope of the strand.
        moved: (dim,) m, displacement of the end.
        share: (nodes,) shares of the displacement, from 0 at the other end to 1.
        end: row of the node at the end, 0 or -1.
    """
    state, places = part.state, part.state.mesh.arc_length
    tangents = state.nodes.position[:, 1] + state.nodes.position[:, 2]
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
    forward = float(moved @ tangents[end])
    last = abs(places[end] - state.contact_arc_length).min(initial=places[-1] - places[0])
    beside = np.maximum(1.0 - abs(places[end] - places) / last, 0.0)
    across = moved - forward * tangents[end]
    state.nodes.position[:, 0] += forward * share[:, None] * tangents + np.outer(beside, across)


def _take_load_nodes_along(part: Ropeway) -> None:
    """Move mesh nodes that follow loads to their slightly displaced loads, so that the bend at a load is kept."""
    state, mesh = part.state, part.state.mesh
    nodes = np.flatnonzero(state.node_load >= 0)
    nodes = nodes[state.node_follows[state.node_load[nodes]]]
    places = mesh.arc_length.copy()
    places[nodes] = state.joints.position[state.node_load[nodes]]
    if not (np.diff(places) > LEAST_LEFT * np.diff(mesh.arc_length)).all():
        return
    slopes = 0.5 * (state.nodes.position[nodes, 1] + state.nodes.position[nodes, 2])
    state.nodes.position[nodes, 0] += (places - mesh.arc_length)[nodes, None] * slopes
    beside = (state.node_load[:-1] >= 0) | (state.node_load[1:] >= 0)
    mesh.arc_length[:] = places
    mesh.length[:] = np.where(beside, np.diff(places), mesh.length)


def _points(part: Ropeway) -> FloatArray:
    """Positions (bodies, dim) in m of the vehicles' joints on a strand, repeated for each body of a vehicle."""
    state, count = part.state, np.diff(part.system.carriages.body_offset)
    nodes = state.nodes.position[:, 0].T
    points = np.array([np.interp(state.joints.position, state.mesh.arc_length, one) for one in nodes])
    return np.repeat(points.T, count, axis=0)


def settle_near(
    sheaves: Bullwheels, motion: BullwheelMotion, relax: Callable[[], None], slopes: FloatArray | None
) -> FloatArray:
    """Find the equilibrium of strands over their bullwheels, starting from the equilibrium under similar loads.

    One set of derivatives serves for all loads; each search corrects it in its iterations by Broyden's method.

    Args:
        sheaves: parameters of the bullwheels.
        motion: their motion at rest, from which the search begins.
        relax: brings all ropes to rest between the ends that `motion` gives them, and stores their pulls.
        slopes: derivatives (N/m) of the bullwheels' balance by their displacements; None to find them.

    Returns:
        These derivatives, as they were given or found.

    Raises:
        EquilibriumError: the equilibrium is not found.
    """
    free = np.flatnonzero(sheaves.driven == 0) if np.any(sheaves.driven) else np.arange(1, sheaves.driven.size)
    pulled = np.flatnonzero(sheaves.tensioning != FIXED)
    ways = [(motion.rope.position, sheave) for sheave in free] + [(motion.carriage.position, one) for one in pulled]

    def off_balance() -> FloatArray:
        relax()
        tension = motion.tension
        return np.array([*(tension[free, 1] - tension[free, 0]), *(sheaves.pull[pulled] - motion.pull[pulled])])

    left = off_balance()
    if slopes is None:
        slopes = np.empty((left.size, left.size))
        for column, (array, row) in enumerate(ways):
            array[row] += NUDGE
            slopes[:, column] = (off_balance() - left) / NUDGE
            array[row] -= NUDGE
    corrected = slopes
    for _ in range(MOST_ITERATIONS):
        if np.abs(left).max(initial=0.0) < TOLERANCE * float(np.abs(motion.tension).max()):
            return slopes
        if not np.isfinite(left).all():
            break
        move = np.linalg.lstsq(corrected, -left, rcond=None)[0]
        for (array, row), way in zip(ways, move, strict=True):
            array[row] += way
        before, left = left, off_balance()
        corrected = corrected + np.outer(left - before - corrected @ move, move) / (move @ move)
    raise EquilibriumError("no static equilibrium of the loop nearby")


class LoopLayout:
    """Start layout of a closed loop: strands and bullwheels at rest in closed form, without other ropes.

    Args:
        scenario: scenario of the run.
        sheaves: parameters of its bullwheels.
        parts: ropes with their vehicles, one for each rope.
    """

    def __init__(self, scenario: Scenario, sheaves: Bullwheels, parts: list[Ropeway]) -> None:
        self._sheaves, self._wheels = sheaves, list(scenario.sheaves)
        self._names, self._parts, self._strands = list(scenario.ropes), parts, scenario.strands
        self._bare_rest = bullwheels_at_rest(len(self._wheels))  # until it is known
        self._rows = [row for row, name in enumerate(self._names) if name in self._strands]

    def check_bare(self) -> None:
        """Refuse towers without contact to the bare strands at the tension over their bullwheels.

        Raises:
            EquilibriumError: names such a tower, or a strand that has no equilibrium even by itself.
        """
        if not self._rows:
            return
        strands = self._bare()
        try:
            self._bare_rest = motion = self._rest(self._sheaves, strands)
        except EquilibriumError:
            self._check_each(strands)
            return
        for row, system in strands.items():
            scenario, here = self._parts[row].scenario, on_bullwheels(self._sheaves, motion, row, system)
            with of_rope(self._names[row]):
                check_rest(here, tuple(scenario.towers), loaded=True, cure=self._cure(row))
                if scenario.dim == 3 and (fault := next(groove_faults(scenario, here), None)) is not None:
                    raise EquilibriumError(f"{'.'.join(map(str, fault.path))}: {fault.text}")

    def lay_out(self, motion: BullwheelMotion) -> None:
        """Place bullwheels near their equilibrium: where they rest with the vehicles' mass spread evenly over strands.

        Without such an equilibrium they stay as the strands lie by themselves; the later search reports the reason.
        """
        if not self._rows:
            return
        loaded = {}
        for row, system in self._bare().items():
            cable, carriages = system.cable, system.carriages
            attached = np.repeat(self._parts[row].riding, np.diff(carriages.body_offset))
            more = float(carriages.mass[attached].sum()) / cable.unstrained_length
            loaded[row] = system._replace(cable=cable._replace(mass_per_length=cable.mass_per_length + more))
        try:
            found = self._rest(self._sheaves, loaded, self._bare_rest)
        except EquilibriumError:
            return
        motion.rope.position[:], motion.carriage.position[:] = found.rope.position, found.carriage.position
        for sheave, side in np.ndindex(self._sheaves.rope.shape):
            part = self._parts[int(self._sheaves.rope[sheave, side])]
            part.state.rope.position[1 - side] = motion.rope.position[sheave]

    def ends(self, name: str, motion: BullwheelMotion) -> FloatArray | None:
        """Ends (2, dim) in m of a strand at the places of its bullwheels; None for any other rope."""
        if name not in self._strands:
            return None
        row = self._names.index(name)
        ends: FloatArray = on_bullwheels(self._sheaves, motion, row, self._parts[row].system).cable.end_position
        return ends

    def _bare(self) -> dict[int, System]:
        """Mechanical systems of the strands, by index of the rope."""
        return {row: self._parts[row].system for row in self._rows}

    def _rest(
        self, sheaves: Bullwheels, strands: Mapping[int, System], start: BullwheelMotion | None = None
    ) -> BullwheelMotion:
        """Bullwheel motion at the closed-form equilibrium of strands, searched for from `start`."""
        motion = bullwheels_at_rest(len(self._wheels))
        if start is not None:
            motion.rope.position[:], motion.carriage.position[:] = start.rope.position, start.carriage.position
        rest_in_closed_form(sheaves, motion, strands)
        return motion

    def _check_each(self, strands: Mapping[int, System]) -> None:
        """Refuse a strand without an equilibrium even by itself."""
        for row, system in strands.items():
            if not self._parts[row].is_taut:
                with of_rope(self._names[row]):
                    rest_over_supports(system)

    def _cure(self, row: int) -> Cure:
        """Remedy for a strand off its towers: another tensioning force, or another length of a fixed loop."""
        sheaves, strands = self._sheaves, self._bare()
        tensioned = np.flatnonzero(sheaves.tensioning != FIXED)

        def pulled(force: float) -> System:
            pull = sheaves.pull.copy()
            pull[tensioned[0]] = force
            other = sheaves._replace(pull=pull)
            return on_bullwheels(other, self._rest(other, strands), row, strands[row])

        if tensioned.size:
            text = f"a pull of {{bound}} {{value}} of sheaves.{self._wheels[tensioned[0]]}"
            return Cure(float(sheaves.pull[tensioned[0]]), text, "N", pulled)

        whole = sum(system.cable.unstrained_length for system in strands.values())

        def cut(given: float) -> System:
            other = {}
            for one, system in strands.items():
                length = given / whole * system.cable.unstrained_length
                other[one] = system._replace(cable=system.cable._replace(unstrained_length=length))
            return on_bullwheels(sheaves, self._rest(sheaves, other), row, other[row])

        return Cure(whole, "strands of {bound} {value} in all", "m", cut)
