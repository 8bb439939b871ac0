"""Several ropes, what hangs between them, holds to two of them, and what joins them to loops."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, cast

import numpy as np

from cable_twin.mechanics.drives.pull import hold_all, let_go
from cable_twin.mechanics.language.addresses import Addresses
from cable_twin.mechanics.language.compilation import Kernel
from cable_twin.mechanics.parameters import FloatArray
from cable_twin.mechanics.readout.columns import Columns
from cable_twin.mechanics.readout.sections import allocate_sections
from cable_twin.mechanics.solution.bundle.connector import connector_forces
from cable_twin.mechanics.solution.bundle.generalized_alpha import advance as advance_bundle
from cable_twin.mechanics.solution.bundle.mutual_forces import give_forces
from cable_twin.mechanics.solution.bundle.order import lines_of, order_of
from cable_twin.mechanics.solution.bundle.records import (
    SYSTEM,
    Bundle,
    Wires,
    allocate_bundle_state,
    allocate_bundle_work,
    clone_bundle_state,
)
from cable_twin.mechanics.solution.bundle.rest import relax_bundle, settle_bundle
from cable_twin.mechanics.solution.bundle.strand_ends import feel_ends
from cable_twin.mechanics.solution.equilibrium import lay_taut, note_rest, relax, without_friction
from cable_twin.mechanics.state import allocate_workspace, clone_state, fields_of, write_state
from cable_twin.records import Command, Energy
from cable_twin.scenario import Scenario
from cable_twin.scenario.build_bundle import (
    build_bullwheels,
    build_clamps,
    build_connectors,
    build_pantographs,
    clamped_pairs,
)
from cable_twin.simulation.loop import Loop
from cable_twin.simulation.loop_layout import LoopLayout
from cable_twin.simulation.ropeway import Ropeway, of_rope, restore_ropes
from cable_twin.simulation.second_rope import (
    along_track,
    check_connectors,
    clamp_rows,
    let_clamps_hold,
    note_clamps,
    observe_clamps,
)
from cable_twin.simulation.snapshot_file import FullState

SLACKEST_REST = 1e-11  # of the length of the longest rope: the last increment of a rest


class RopeBundle:
    """Several ropes, what hangs between them and what pushes them from below."""

    at_rest: tuple[Kernel, ...] = cast(Kernel, relax), cast(Kernel, relax_bundle), cast(Kernel, feel_ends)

    def __init__(self, scenario: Scenario, parts: list[Ropeway]) -> None:
        self.parts, self._scenario = parts, scenario
        systems = dict(zip(scenario.ropes, (part.system for part in parts), strict=True))
        self._works = [allocate_workspace(system) for system in systems.values()]
        connectors, names = build_connectors(scenario, systems)
        self._rows = [list(scenario.connectors).index(name) for name in names]  # where the file has them
        pantographs, clamps = build_pantographs(scenario), build_clamps(scenario)
        self._exerting = clamps.rope.size + 2 * connectors.length.size + pantographs.rope.size
        for part in parts:
            part.sections = allocate_sections(part.system, self._exerting)
        self._addresses = Addresses(
            [
                (part.system, part.state, work, clone_state(part.state), clone_state(part.state), part.sections)
                for part, work in zip(parts, self._works, strict=True)
            ]
        )
        self._packed_systems = [part.packed_system for part in parts]
        nodes = [part.state.nodes.position.shape[0] for part in parts]
        damped = [(rope.mass_damping, rope.tension_damping) for rope in scenario.ropes.values()]
        self.bundle = Bundle(
            records=self._addresses.table,
            up=np.eye(scenario.dim)[-1].copy(),
            connectors=connectors,
            pantographs=pantographs,
            clamps=clamps,
            wires=Wires(
                by_mass=np.array([one for one, _ in damped]),
                by_stiffness=np.array([one for _, one in damped]),
                tension=np.zeros(len(parts)),
                present=bool(np.any(damped)),
            ),
            order=order_of(
                nodes,
                connectors.rope,
                connectors.node,
                along_track(scenario, parts) if clamps.rope.size else None,
                lines_of(len(parts), np.concatenate([connectors.rope, clamped_pairs(scenario)])),
            ),
            sheaves=build_bullwheels(scenario),
        )
        self.moving = moving = self._start = allocate_bundle_state(self.bundle)
        self._scratch = allocate_bundle_work(self.bundle)
        self._spare = clone_bundle_state(moving), clone_bundle_state(moving)
        given = scenario.pantographs.values()
        moving.place.position[:] = [one.position for one in given]
        self.loop = Loop(scenario, self.bundle, moving.sheaves, parts)
        self._layout = LoopLayout(scenario, self.bundle.sheaves, parts)
        self.commands: dict[str, Command] = {}
        self.integrator = cast(Kernel, advance_bundle)
        self._forces = np.zeros(len(scenario.connectors))
        self._clamp_rows = clamp_rows(scenario)
        self._hung_from = {rope for one in scenario.connectors.values() for rope, _ in one.ends}

    def check_bare(self) -> None:
        """Refuse ropes that have no rest even by themselves and without vehicles.

        Raises:
            EquilibriumError: one of them has none.
        """
        self._layout.check_bare()
        for name, part in self._by_name():
            if name not in self._scenario.strands and not part.is_taut:
                with of_rope(name):
                    part.check_bare(loaded=name in self._hung_from)

    def find_rest(self) -> None:
        """Bring all ropes to rest, and again where joints yield by the tension of the first time.

        Raises:
            EquilibriumError: there is none.
        """
        self.check_bare()
        self._layout.lay_out(self.moving.sheaves)
        laid = [clone_state(part.state) for part in self.parts], clone_bundle_state(self.moving)

        def again() -> None:
            for part, state in zip(self.parts, laid[0], strict=True):
                write_state(state, part.state)
            for before, now in zip(fields_of(laid[1]).values(), fields_of(self.moving).values(), strict=True):
                now[...] = before
            self._find_rest()

        self._find_rest()
        sharpened = [self._sharpen(name, part) for name, part in self._by_name()]
        if any(sharpened):
            again()
        for name, part in self._by_name():
            with of_rope(name):
                part.check_travel(self.parts, again)

    def _by_name(self) -> Iterator[tuple[str, Ropeway]]:
        return zip(self._scenario.ropes, self.parts, strict=True)

    @staticmethod
    def _sharpen(name: str, part: Ropeway) -> bool:
        with of_rope(name):
            return part.sharpen(f"ropes.{name}")

    def _find_rest(self) -> None:
        """Bring each rope to rest by itself, then all of them together."""
        for name, part, work in zip(self._scenario.ropes, self.parts, self._works, strict=True):
            if part.is_taut:
                lay_taut(part.system, part.state)
            else:
                with of_rope(name):
                    part.lay(work, self._layout.ends(name, self.moving.sheaves))
        self._raise_pantographs()
        modes = [hold_all(part.state) for part in self.parts]
        check_connectors(self._scenario, self.parts)
        let_clamps_hold(self._scenario, self.parts, self.bundle.clamps)
        self._settle()
        note_clamps(self.parts, self.bundle.clamps)
        for row, (part, own_modes) in enumerate(zip(self.parts, modes, strict=True)):
            self._addresses.write(row, SYSTEM, part.system)
            note_rest(part.system, part.state)
            let_go(part.system, part.state, own_modes)
            part.take_over_rest()
            self.bundle.wires.tension[row] = part.mean_tension()
        self.moving.place.velocity[:] = [one.speed for one in self._scenario.pantographs.values()]
        self.commands = self.loop.set_in_motion()

    def _settle(self) -> None:
        """Bring all ropes to rest together, as if nothing rubbed.

        Raises:
            EquilibriumError: there is no such rest.
        """
        for row, part in enumerate(self.parts):
            self._addresses.write(row, SYSTEM, without_friction(part.system))
        longest = max(rope.unstrained_length for rope in self._scenario.ropes.values())
        first = self.parts[0]
        relaxed = self.bundle, self.moving, self._spare[0], self._scratch, first.system, first.state, self._works[0]
        elements = sum(len(part.state.nodes.position) - 1 for part in self.parts)
        if self._scenario.sheaves:
            self.loop.settle(lambda: settle_bundle(relaxed, SLACKEST_REST * longest, elements))
        else:
            settle_bundle(relaxed, SLACKEST_REST * longest, elements)

    def _raise_pantographs(self) -> None:
        """Let heads touch their ropes, as they are laid now, with the force that they have at their height."""
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
        """What the integrator gets to take so many steps."""
        first = self.parts[0]
        ropes = first.system, first.state, self._works[0]
        return self.bundle, self.moving, *self._spare, self._scratch, *ropes, steps

    def typical(self) -> dict[str, Any]:
        """Arguments that kernels below the integrator get, by their names there; only their types count."""
        first, bundle, moving = self.parts[0], self.bundle, self.moving
        whole = {"bundle": bundle, "moving": moving, "scratch": self._scratch}
        inner = {"sheaves": bundle.sheaves, "motion": moving.sheaves}
        counts = dict.fromkeys(("sheave", "clamp", "connector", "member", "event"), 0)
        return first.typical(self._works[0]) | whole | inner | counts

    def advance(self, steps: int) -> tuple[Any, ...]:
        """Take so many steps, or fewer: until a lift has rolled back; the fields of `Outcome`."""
        for row, part in enumerate(self.parts):
            if part.packed_system is not self._packed_systems[row]:
                self._addresses.write(row, SYSTEM, part.system)
                self._packed_systems[row] = part.packed_system
        outcome = self.integrator(*self.arguments(steps))
        if self.loop.rolled_back and not self.parts[0].stopped:
            self.commands.clear()
            for part in self.parts:
                part.stop()
        return outcome  # type: ignore[no-any-return]

    def couple(self) -> None:
        """Let the sections of each rope have what other ropes exert on it now."""
        if not self._exerting:
            return
        first = self.parts[0]
        give_forces(self.bundle, self.moving, first.system, first.state, first.sections)

    def observe(self, columns: Columns) -> None:
        """Fill the columns of connectors and pantographs, and of clamps that hold to no rope now."""
        first, moving = self.parts[0], self.moving
        observe_clamps(self._clamp_rows, self.parts, self.bundle.clamps, moving, columns)
        if self._forces.size:
            connector_forces(self.bundle, first.state, first.system.cable.gravity, self._forces)
            columns.connector_force[self._rows] = self._forces
        columns.pantograph_force[:] = moving.contact_force
        columns.pantograph_speed[:] = moving.place.velocity
        columns.pantograph_position[:, 0] = moving.place.position
        columns.pantograph_position[:, 2] = moving.stages.position[:, 0]
        self.loop.observe(columns)

    def drive(self, command: Command) -> None:
        """Give drives of bullwheels, of those that it names, a speed (m/s) or a force (N)."""
        for name, value in command.values.items():
            if name in self.loop.drives:
                self.loop.drive(name, command.kind, value)
                self.commands[name] = Command(command.kind, {name: value})

    def stop(self, _: Command) -> None:
        """Begin the emergency stop of the bullwheels."""
        self.loop.stop()
        self.commands.clear()

    def release(self, _: Command) -> None:
        """End it."""
        self.loop.release()

    def go_back(self, _: Command) -> None:
        """Put pantographs, clamps and bullwheels back to the start."""
        self.commands = dict(self._first_commands)
        for start, now in zip(fields_of(self._start).values(), fields_of(self.moving).values(), strict=True):
            now[...] = start

    def energy(self) -> Energy:
        """Energy (J) of the bullwheels; that of pantographs and connectors is not counted."""
        return self.loop.energy()

    def begin(self) -> None:
        """Let this be the start, to which a reset goes back."""
        for part in self.parts:
            part.begin()
        self._start, self._first_commands = clone_bundle_state(self.moving), dict(self.commands)

    def between(self) -> dict[str, FloatArray]:
        """A copy of the motion of pantographs, clamps and bullwheels, now and at the start, by name."""
        both = ("now", self.moving), ("start", self._start)
        return {f"{key}/{name}": array.copy() for key, one in both for name, array in fields_of(one).items()}

    def restore(self, full: FullState) -> None:
        """Go to a full state that fits: of ropes, pantographs, clamps, bullwheels, and what their drives are told."""
        restore_ropes(self.parts, full)
        for key, one in (("now", self.moving), ("start", self._start)):
            for name, array in fields_of(one).items():
                array[...] = full.between[f"{key}/{name}"]
        self.commands = {name: full.commands[name] for name in self.loop.drives if name in full.commands}


__all__ = ["RopeBundle"]
