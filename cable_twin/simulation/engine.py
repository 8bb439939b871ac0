"""Engine that takes solver steps: ropes of a scenario with their vehicles, and the couplings between ropes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import nullcontext
from functools import partial
from itertools import chain
from typing import Any, NamedTuple, cast

import numpy as np

from cable_twin.frame.records import Command, Energy
from cable_twin.mechanics.drives.joint_drive import hold_all, release_joints
from cable_twin.mechanics.language.by_reference import Known, pack
from cable_twin.mechanics.language.compilation import Kernel
from cable_twin.mechanics.language.declared import Kept, Memory, arrays_of, clone, write
from cable_twin.mechanics.on_rope.wind import set_wind
from cable_twin.mechanics.parameters import ALONE, CONTINUUM, FloatArray, System
from cable_twin.mechanics.readout.columns import Columns
from cable_twin.mechanics.readout.sections import allocate_sections
from cable_twin.mechanics.solution.bundle.assembly import Assembly, Couplings, Rope
from cable_twin.mechanics.solution.bundle.bullwheels import update_end_tensions
from cable_twin.mechanics.solution.bundle.connector import connector_forces
from cable_twin.mechanics.solution.bundle.couplings import give_forces
from cable_twin.mechanics.solution.bundle.records import BundleState, Wires
from cable_twin.mechanics.solution.catenary import EquilibriumError
from cable_twin.mechanics.solution.equilibrium import lay_taut, settle_near, without_friction
from cable_twin.mechanics.solution.relaxation import Moment as RelaxationMoment
from cable_twin.mechanics.solution.relaxation import relax, store_equilibrium, watching_relaxation
from cable_twin.mechanics.solution.stepping import integrator_named
from cable_twin.mechanics.state import State, Workspace, allocate_states, allocate_workspace
from cable_twin.scenario import Scenario
from cable_twin.scenario.builders.bundle import (
    build_bullwheels,
    build_clamps,
    build_connectors,
    build_pantographs,
    build_ropes,
    clamped_pairs,
)
from cable_twin.simulation.common_rest import CommonRest, rolling_far, settle_fixed, settle_softly
from cable_twin.simulation.loop import Loop, LoopLayout
from cable_twin.simulation.rope_couplings import (
    along_track,
    check_connectors,
    let_clamps_hold,
    note_clamps,
    observe_clamps,
    observe_pantographs,
)
from cable_twin.simulation.ropeway import Ropeway, of_rope
from cable_twin.simulation.same_model import check_same_meshes, check_same_parts, check_same_structure, sharing
from cable_twin.simulation.snapshot_file import FullState
from cable_twin.simulation.vehicle_contacts import with_buffers
from cable_twin.simulation.vehicles import Vehicles, VehicleSettings, with_all_vehicles

SLACKEST_REST = 1e-11  # of the length of the longest rope: the last increment of a rest


class Start(NamedTuple):
    """Initial state and commands, to which a reset goes back."""

    before: Kept  # states of all ropes
    moving: BundleState
    commands: Mapping[str, Command]  # of drives of bullwheels
    of_ropes: Sequence[Mapping[str, Command]]


class Settings(NamedTuple):
    """Data of an engine that are not in its state: parameters with payloads, commands in force, loading, start."""

    parameters: tuple[tuple[System, Any], ...]  # of each rope, and packed
    stopped: bool
    commands: Mapping[str, Command]  # of drives of bullwheels
    of_ropes: tuple[Mapping[str, Command], ...]
    vehicles: VehicleSettings
    start: Start


SHAPE = (  # arrays of a state that a search for another rest begins with
    *("nodes.position", "bodies.position", "joints.position", "contact_arc_length", "surplus", "loop_start"),
    *("mesh.arc_length", "mesh.length", "mesh.plain", "node_load", "joint_node", "node_follows", "joint_element"),
    *("multipliers", "moments"),  # without the weight of what hangs on it, a vehicle would turn about its joint freely
)


class Engine:
    """Engine that takes the solver steps of a scenario: ropes with their vehicles, and couplings between ropes.

    Attributes:
        parts: ropes with their vehicles, one for each rope.
        commands: last command in force of each drive of a bullwheel.
        vehicles: payloads of the vehicles of all ropes.
        moving: motion of bullwheels and of rope couplings.
        couplings: parameters of the bullwheels and rope couplings.
        integrator: kernel that takes steps.
        at_rest: kernels that find the static equilibrium.
    """

    def __init__(self, scenario: Scenario, like: Engine | None = None, *, own_mesh: bool = False) -> None:
        """Build the ropes and couplings of a scenario, before the search for equilibrium.

        With another engine, this one shares its mesh, states and workspaces, and the two take turns.

        Args:
            scenario: scenario that is built.
            like: the other engine.
            own_mesh: refuse another engine whose mesh is not that which the scenario would have by itself.

        Raises:
            OtherModelError: the scenario differs from that of the other engine in more than values.
        """
        if not isinstance(scenario, Scenario):
            raise TypeError(f"scenario: given {scenario!r}; allowed: a Scenario, as of `load_scenario`")
        if like is not None:
            check_same_parts(scenario, like._scenario)
        self._scenario: Scenario = scenario
        self._names = list(scenario.cables)
        self._naming = of_rope if scenario.ropes else nullcontext  # in what is said of one of them
        systems = build_ropes(scenario, None if like is None or own_mesh else like.meshes)
        if like is not None and own_mesh:
            check_same_meshes([one.cable.node_arc_length for one in systems.values()], like.meshes)
        self.parts: list[Ropeway] = _ropeways(scenario, list(systems.values()), like)
        self.vehicles = Vehicles(scenario, self.parts)
        connectors, names = build_connectors(scenario, systems)
        self._rows = [list(scenario.connectors).index(name) for name in names]  # where the file has them
        pantographs, clamps = build_pantographs(scenario), build_clamps(scenario)
        damped = [rope.tension_damping for rope in scenario.cables.values()]
        couplings = Couplings(
            connectors=connectors,
            pantographs=pantographs,
            clamps=clamps,
            wires=Wires(
                by_stiffness=np.array(damped),
                tension=np.zeros(len(self.parts)),
                present=bool(np.any(damped)),
            ),
            sheaves=build_bullwheels(scenario),
            pairs=clamped_pairs(scenario),
            along=along_track(scenario, self.parts) if clamps.rope.size else [],
        )
        self._exerting = clamps.rope.size + 2 * connectors.length.size + pantographs.rope.size
        if like is not None:
            check_same_structure([couplings], [like.couplings])
            couplings = sharing(couplings, like.couplings)
        self.couplings: Couplings = couplings
        self._works: list[Workspace] = like._works if like else [allocate_workspace(part.system) for part in self.parts]
        for row, part in enumerate(self.parts):
            own = allocate_sections(part.system, self._exerting) if like is None else like.parts[row].sections
            part.sections = own
        ropes = [
            Rope(part.system, part.state, work, part.sections, name)
            for (name, part), work in zip(self._by_name(), self._works, strict=True)
        ]
        self._sections = pack(self.parts[0].sections)
        self._coupled = couplings.any
        shared = None if like is None else like._ropes
        self._ropes: Assembly = Assembly(ropes, couplings, shared)
        self.bundle, self.moving = self._ropes.bundle, self._ropes.moving
        self._start: BundleState = self.moving
        self._states = [part.state for part in self.parts]
        self._before = Kept(*self._states)
        self.moving.place.position[:] = [one.position for one in scenario.pantographs.values()]
        self.loop = Loop(scenario, self.bundle, self.moving.sheaves, self.parts)
        self._layout = LoopLayout(scenario, self.bundle.sheaves, self.parts)
        self.commands: dict[str, Command] = {}
        self.integrator = cast(Kernel, integrator_named(scenario.solver.integrator))
        self.at_rest = cast(tuple[Kernel, ...], (relax, update_end_tensions) if scenario.sheaves else (relax,))
        self._smooth: dict[int, tuple[System, Any]] = {}  # of each rope, with the same without friction, packed
        self._forces, self._near = np.zeros(len(scenario.connectors)), False
        self._hung_from = {rope for one in scenario.connectors.values() for rope, _ in one.ends}

    def check_bare(self) -> None:
        """Refuse ropes without an equilibrium even when bare and uncoupled, before any compilation.

        Raises:
            EquilibriumError: a rope has no equilibrium.
        """
        self._layout.check_bare()
        for name, part in self._by_name():
            if name not in self._scenario.strands and not (self._coupled and part.is_taut):
                with self._naming(name):
                    part.check_bare(loaded=name in self._hung_from)

    def find_rest(self, near: tuple[Kept, BundleState] | None = None) -> None:
        """Find the static equilibrium of all ropes.

        Args:
            near: states of ropes and couplings at the equilibrium of similar ropes, where the search begins; None for
                a search from scratch, with checks of the bare ropes.

        Raises:
            EquilibriumError: there is no equilibrium.
        """
        self._near = near is not None
        if near is None:
            self.check_bare()
            self._layout.lay_out(self.moving.sheaves)
        laid = Kept(*self._states), clone(self.moving)
        if near is not None:
            self._take_shape(*near)

        def again() -> None:
            found = Kept(*self._states), clone(self.moving)
            write(laid[0], self._states[0])
            write(laid[1], self.moving)
            if self._near:
                self._take_shape(*found)
            self._find_rest()

        self._find_rest()
        for name, part in self._by_name():
            with self._naming(name):
                part.check_travel(self.parts, again)

    def _take_shape(self, states: Kept, moving: BundleState) -> None:
        """Copy the shape of ropes and bodies and the places of bullwheels from another static equilibrium."""
        for own, record in zip(self._states, states.records, strict=True):
            mine, given = arrays_of(own), arrays_of(record)
            for name in SHAPE:
                mine[name][...] = given[name]
        self.moving.sheaves.carriage.position[:] = moving.sheaves.carriage.position
        self.loop.take_up()

    def take_loads(self, scenario: Scenario) -> None:
        """Write payloads, wind and tensioning of an otherwise equal scenario into the present parameters.

        Raises:
            OtherModelError: tensioning devices are of other kinds.
        """
        sheaves, own = build_bullwheels(scenario), self.couplings.sheaves
        check_same_structure([sheaves], [own])
        for array, given in zip(arrays_of(own).values(), arrays_of(sheaves).values(), strict=True):
            array[...] = given
        for part in self.parts:
            set_wind(part.state, np.array(scenario.vector(scenario.air.wind)))
        self.vehicles.take_payloads(scenario)
        self._scenario = self.loop.scenario = scenario

    def _by_name(self) -> Iterator[tuple[str, Ropeway]]:
        return zip(self._names, self.parts, strict=True)

    def _find_rest(self) -> None:
        """Find the equilibrium of each rope by itself, then of all ropes together."""
        for (name, part), work in zip(self._by_name(), self._works, strict=True):
            if self._near:
                if not self._coupled:
                    settle_near(part.system, part.state, work)
            elif self._coupled and part.is_taut:
                lay_taut(part.system, part.state)
            else:
                with self._naming(name):
                    part.lay(work, self._layout.ends(name, self.moving.sheaves))
        if self._coupled:
            self._rest_together()
        self.vehicles.take_first_loads()
        for part in self.parts:
            part.take_over_rest()
        self.moving.place.velocity[:] = [one.speed for one in self._scenario.pantographs.values()]
        self.commands = self.loop.set_in_motion()

    def _rest_together(self) -> None:
        """Find the common equilibrium of coupled ropes, each of which is in equilibrium by itself."""
        if not self._near:
            self._raise_pantographs()
        held = [hold_all(part.system, part.state) for part in self.parts]
        check_connectors(self._scenario, self.parts)
        let_clamps_hold(self._scenario, self.parts, self.bundle.clamps)
        self._settle()
        note_clamps(self.parts, self.bundle.clamps)
        for row, (part, drives) in enumerate(zip(self.parts, held, strict=True)):
            self._ropes.put(row, part.system)
            store_equilibrium(part.system, part.state, self._works[row])
            release_joints(part.system, part.state, *drives)
            self.bundle.wires.tension[row] = part.mean_tension()

    def _settle(self) -> None:
        """Find the common equilibrium of all ropes without friction.

        Raises:
            EquilibriumError: there is no such equilibrium.
        """
        for row, part in enumerate(self.parts):
            if self._smooth.get(row, (None, None))[0] is not part.system:
                self._smooth[row] = part.system, pack(without_friction(part.system))
            self._ropes.put(row, self._smooth[row][1])
        tolerance = SLACKEST_REST * max(rope.unstrained_length for rope in self._scenario.cables.values())
        connectors = self.bundle.connectors
        if self._near or not connectors.rolls.any():
            self._search(CommonRest(self._ropes, self.parts, tolerance, near=self._near))
            return
        laid = Kept(*self._states), clone(self.moving)
        settle = CommonRest(self._ropes, self.parts, tolerance, may_touch=False)
        try:
            self._search(settle, partial(settle_fixed, connectors, settle), explain=False)
        except EquilibriumError:
            write(laid[0], self._states[0])
            write(laid[1], self.moving)
            settle = CommonRest(self._ropes, self.parts, tolerance)
            with rolling_far(connectors):
                self._search(settle, partial(settle_softly, connectors, settle))

    def _search(self, settle: CommonRest, roughly: Callable[[], None] | None = None, *, explain: bool = True) -> None:
        """Find the common equilibrium by `settle`, first `roughly` where given; see `Loop.settle`."""
        if self._scenario.sheaves:
            self.loop.settle(settle, roughly, near=self._near, explain=explain)
            return
        if roughly is not None:
            roughly()
        settle()

    def _raise_pantographs(self) -> None:
        """Raise pantograph heads to their ropes, with the uplift force at their height."""
        moving, pantographs = self.moving, self.bundle.pantographs
        for row, one in enumerate(self._scenario.pantographs.values()):
            part = self.parts[int(pantographs.rope[row])]
            places = part.state.nodes.position[:, 0]
            nearest = int(np.argmin(abs(places[:, 0] - one.position)))
            moving.arc_length[row] = part.system.cable.node_arc_length[nearest]
            head = places[nearest, -1] + one.uplift_force / pantographs.contact_stiffness[row]
            yielded = np.cumsum([0.0, *(one.uplift_force / pantographs.stiffness[row, :-1])])
            moving.stages.position[row] = head + yielded

    def arguments(self, steps: int) -> tuple[Any, ...]:
        """Arguments of the integrator for a number of steps."""
        return *self._ropes.arguments, steps

    def typical(self) -> dict[str, Any]:
        """Sample arguments, by parameter name, of kernels below the integrator; only their types count."""
        first, bundle, moving = self.parts[0], self.bundle, self.moving
        whole = {"bundle": bundle, "moving": moving, "scratch": self._ropes.scratch}
        inner: dict[str, Any] = {"sheaves": bundle.sheaves, "motion": moving.sheaves}
        inner |= {"moving_before": moving, "response": moving.response}
        inner |= {"saturation": self._ropes.scratch.saturation, "saturated": False}
        inner["wheel_columns"] = self._ropes.scratch.wheel_columns
        inner["patch_columns"] = self._ropes.scratch.patch_columns
        counts = (
            "rope",
            "node",
            "sheave",
            "clamp",
            "connector",
            "member",
            "event",
            "column",
            "iteration",
            "slot",
            "count",
            "inner",
            "opposite",
            "kept_to",
        )
        numbers = dict.fromkeys(counts, 0) | {"tension_time": 1.0}
        return first.typical(self._works[0]) | whole | inner | numbers

    def advance(self, steps: int) -> tuple[Any, ...]:
        """Take a number of solver steps, fewer if a bullwheel rolls back; returns the fields of `Outcome`."""
        self._put_parameters()
        outcome = self.integrator(*self.arguments(steps))
        self.stop_rolled_back()
        return outcome  # type: ignore[no-any-return]

    def _put_parameters(self) -> None:
        """Hand the present parameters of all ropes over to the kernels."""
        for row, part in enumerate(self.parts):
            self._ropes.put(row, part.packed_system)

    def stop_rolled_back(self) -> None:
        """Stop the ropes if a bullwheel has rolled back and no emergency stop is in force yet."""
        if self.loop.rolled_back and not self.parts[0].stopped:
            self.commands.clear()
            for part in self.parts:
                part.stop()

    def couple(self) -> None:
        """Write the forces from other ropes into the sections of each rope."""
        if not self._exerting:
            return
        bundle, moving, *_, system, state, _ = self._ropes.arguments
        give_forces(bundle, moving, system, state, self._sections)

    def observe(self, columns: Columns) -> None:
        """Fill the columns of a snapshot for connectors, pantographs, bullwheels and opened clamps."""
        if not self._coupled:
            return
        moving = self.moving
        observe_clamps(self.parts, self.bundle.clamps, moving, columns)
        if self._forces.size:
            bundle, *_, system, state, _ = self._ropes.arguments
            connector_forces(bundle, system, state, self.parts[0].system.cable.gravity, self._forces)
            columns.connector_force[self._rows] = self._forces
        observe_pantographs(self.parts, self.bundle.pantographs, moving, columns)
        self.loop.observe(columns)

    def acting(self) -> bytes:
        """Values that commands change at once, as comparable bytes: drives, payloads, wind and temperatures."""
        state, wheels = self._states[0], self.moving.sheaves.drives
        own = [(part.state.wind, part.state.temperature) for part in self.parts]
        drives = state.drives.mode, state.drives.force, wheels.mode, wheels.force
        return b"".join(array.tobytes() for array in (*drives, state.payload, *chain(*own)))

    def forget_accelerations(self) -> None:
        """Discard the accelerations of the last step, as forces have changed abruptly before the next one."""
        self._states[0].newton_ratio[0] = 0.0

    def drive(self, command: Command) -> None:
        """Apply a speed (m/s) or force (N) command to the bullwheel drives named in the command."""
        for name, value in command.values.items():
            if name in self.loop.drives:
                self.loop.drive(name, command.kind, value)
                self.commands[name] = Command(command.kind, {name: value})

    def stop(self, _: Command) -> None:
        """Begin the emergency stop of the bullwheels."""
        self.loop.stop()
        self.commands.clear()

    def release(self, _: Command) -> None:
        """Release the emergency stop of the bullwheels."""
        self.loop.release()

    def go_back(self, _: Command) -> None:
        """Reset ropes, vehicles, pantographs, clamps and bullwheels to the start; time runs on."""
        clock = int(self._states[0].clock[0])
        write(self._before, self._states[0])  # not the kernel, which this would be the first to call from Python
        write(self._start, self.moving)
        for part, commands in zip(self.parts, self._first_of_ropes, strict=True):
            part.state.clock[0], part.commands = clock, dict(commands)
        self.commands = dict(self._first_commands)
        self.vehicles.loading.clear()
        self._follow_state()

    def load(self, command: Command) -> None:
        """Begin loading or unloading the vehicles that a command names."""
        self.vehicles.load(command.values)

    def energy(self) -> Energy:
        """Energy (J) of the bullwheels, without pantographs and connectors."""
        return self.loop.energy()

    def begin(self) -> None:
        """Store the present state of ropes and couplings as the start for resets."""
        self._before = Kept(*self._states)
        for part, start in zip(self.parts, self._before.records, strict=True):
            part.start = start
        self._start = clone(self.moving)
        self._first_commands: Mapping[str, Command] = dict(self.commands)
        self._first_of_ropes: Sequence[Mapping[str, Command]] = [dict(part.commands) for part in self.parts]
        self.vehicles.note_stations()

    @property
    def states(self) -> list[State]:
        """States of all ropes, in one block of memory."""
        return self._states

    @property
    def meshes(self) -> list[FloatArray]:
        """Arc lengths (nodes,) in m of the nodes of each rope."""
        return [part.system.cable.node_arc_length for part in self.parts]

    @property
    def workspace_size(self) -> int:
        """Bytes of the workspaces of the solver of all ropes."""
        return sum(work.memory.nbytes for work in self._works)

    @property
    def memory(self) -> Memory:
        """Block of memory with the states of all ropes."""
        return self._states[0].memory

    def go_to_start(self) -> None:
        """Write the state of the start into the memory of ropes and couplings."""
        write(self._before, self._states[0])
        write(self._start, self.moving)

    def follow_temperature(self, _: Command | None = None) -> None:
        """Write the temperatures of the state into the parameters of ropes."""
        for part in self.parts:
            part.follow_temperature()
        self._put_parameters()

    def carry_loads(self) -> None:
        """Write payloads and temperatures of the state into the parameters."""
        self.vehicles.carry(self._states[0].payload)
        self.follow_temperature()

    def _follow_state(self) -> None:
        """Update parameters and stations after a whole state has been written into memory."""
        self.vehicles.follow_state()
        self.follow_temperature()

    def rest_of(self, like: Engine) -> None:
        """Copy the equilibrium and constants of another engine, instead of searching for an equilibrium."""
        self.bundle.wires.tension[:] = like.bundle.wires.tension
        own = tuple((part.system, part.packed_system) for part in self.parts)
        settings = like.settings()
        self.take_over(settings._replace(parameters=own, vehicles=settings.vehicles._replace(carried=None)))
        self.carry_loads()

    def settings(self) -> Settings:
        """Data of the engine that are not in its state, such as parameters, for a later restoration by `take_over`."""
        return Settings(
            tuple((part.system, part.packed_system) for part in self.parts),
            self.parts[0].stopped,
            dict(self.commands),
            tuple(dict(part.commands) for part in self.parts),
            self.vehicles.settings(),
            Start(self._before, self._start, self._first_commands, self._first_of_ropes),
        )

    def take_over(self, settings: Settings) -> None:
        """Restore settings of an earlier moment, whose state has been written into memory."""
        self._before, self._start, self._first_commands, self._first_of_ropes = settings.start
        self.commands = dict(settings.commands)
        each = zip(self.parts, settings.parameters, settings.of_ropes, self._before.records, strict=True)
        for part, parameters, commands, start in each:
            part.take(*parameters)
            part.stopped, part.commands, part.start = settings.stopped, dict(commands), start
        self.vehicles.take_over(settings.vehicles)
        self._put_parameters()

    def kept_states(self) -> tuple[Kept, Kept]:
        """Copies of the states of all ropes with their vehicles, at present and at the start of the run."""
        return Kept(*self._states), Kept(*self._before.records)

    def kept(self) -> tuple[Kept, ...]:
        """Copies of the motion of rope couplings, at present and at the start of the run; empty without couplings."""
        return (Kept(self.moving), Kept(self._start)) if self._coupled else ()

    def restore(self, full: FullState) -> None:
        """Restore ropes, pantographs, clamps, bullwheels and drive commands from a full state with equal arrays."""
        write(full.now, self._states[0])
        write(full.before, self._before)
        self.vehicles.loading = dict(full.loading)
        self._follow_state()
        for part in self.parts:
            part.stopped = full.emergency_stopped
            own = (*part.rows, *part.scenario.drives)
            part.commands = {name: command for name, command in full.commands.items() if name in own}
        for kept, record in zip(full.couplings, (self.moving, self._start), strict=False):
            write(kept, record)
        for key, array in (full.foreign or {}).items():
            moment, _, name = key.partition("/")
            arrays_of(self.moving if moment == "now" else self._start)[name][...] = array
        self.commands = {name: full.commands[name] for name in self.loop.drives if name in full.commands}


def _ropeways(scenario: Scenario, systems: list[System], like: Engine | None) -> list[Ropeway]:
    """Build one ropeway for each rope, with all vehicles, from systems that have the vehicles of one rope each."""
    alone = [scenario.of_rope(name) for name in scenario.cables]
    whole = with_all_vehicles(scenario, alone, [with_buffers(*pair) for pair in zip(systems, alone, strict=True)])
    if len(whole) > 1:
        whole = [system._replace(number=number) for number, system in enumerate(whole)]
    whole = leave_out_absent(whole)
    rows = {name: row for row, name in enumerate(scenario.vehicles)}
    states = allocate_states(whole)
    if like is not None:
        others = [part.system for part in like.parts]
        check_same_structure(whole, others)
        whole = [sharing(*pair) for pair in zip(whole, others, strict=True)]
        first, states = states, tuple(part.state for part in like.parts)
        write(first[0], states[0])
    return [Ropeway(*one, rows) for one in zip(alone, whole, states, strict=True)]


def leave_out_absent(systems: list[System]) -> list[System]:
    """Mark features absent from all systems in the systems' types, so that compiled kernels leave these features out.

    There are few such types, as kernels compiled for one type are of no use to another: beside the continuum's
    elastic model nodes that follow loads are left in, whether there is one or not, and beside the paper's they are
    left out; of a rope by itself its number and all that several ropes need, unless it moves or vehicles on it can
    meet, where it has the type of several.
    """
    known: dict[str, Any] = {}
    if all(system.cable.elastic_model == CONTINUUM for system in systems):
        known = {"elastic_model": Known(CONTINUUM)}
    elif not any(system.cable.load_nodes for system in systems):
        known = {"load_nodes": Known(False)}
    systems = [system._replace(cable=system.cable._replace(**known)) for system in systems]
    first = systems[0]
    if len(systems) > 1 or first.moving_cable.moving or first.buffers.present:
        return systems
    absent = cast(bool, Known(False))
    still, apart = first.moving_cable._replace(moving=absent), first.buffers._replace(present=absent)
    return [first._replace(number=Known(ALONE), moving_cable=still, buffers=apart)]


__all__ = ["Engine", "RelaxationMoment", "leave_out_absent", "watching_relaxation"]
