"""What takes solver steps: one rope, or several with what couples them, behind the same calls."""

from __future__ import annotations

from typing import Any, Protocol, cast

from cable_twin.mechanics.language.by_reference import Known, pack
from cable_twin.mechanics.language.compilation import Kernel
from cable_twin.mechanics.parameters import CONTINUUM, FloatArray, System
from cable_twin.mechanics.readout.columns import Columns
from cable_twin.mechanics.solution.equilibrium import relax
from cable_twin.mechanics.solution.integrator_by_name import integrator_named
from cable_twin.mechanics.solution.relaxation import Moment as RelaxationMoment
from cable_twin.mechanics.solution.relaxation import watching_relaxation
from cable_twin.mechanics.state import allocate_workspace, clone_state
from cable_twin.records import Command, Energy
from cable_twin.scenario import Scenario, build_system
from cable_twin.scenario.build_bundle import (
    build_ropes,
)
from cable_twin.simulation.meeting import with_buffers
from cable_twin.simulation.rope_bundle import RopeBundle
from cable_twin.simulation.ropeway import Ropeway, restore_ropes
from cable_twin.simulation.snapshot_file import FullState


class Engine(Protocol):
    """What `Simulation` asks of it.

    Attributes:
        parts: one a rope, with what is on it.
        commands: the last one in force of each drive that is on no rope alone.
        at_rest: the kernels that find the rest.
        integrator: the kernel that takes steps.
    """

    parts: list[Ropeway]
    commands: dict[str, Command]
    at_rest: tuple[Kernel, ...]
    integrator: Kernel

    def arguments(self, steps: int) -> tuple[Any, ...]:
        """What the integrator gets to take so many steps."""

    def typical(self) -> dict[str, Any]:
        """Arguments that kernels below the integrator get, by their names there; only their types count."""

    def check_bare(self) -> None:
        """Refuse ropes that have no rest even without vehicles, before anything is compiled."""

    def find_rest(self) -> None:
        """Bring everything to where it starts."""

    def advance(self, steps: int) -> tuple[Any, ...]:
        """Take so many steps, or fewer where something is to be done after one of them; the fields of `Outcome`."""

    def couple(self) -> None:
        """Let the sections of each rope have what other ropes exert on it now."""

    def observe(self, columns: Columns) -> None:
        """Fill the columns of what is on no rope alone."""

    def begin(self) -> None:
        """Let this be the start, to which a reset goes back."""

    def energy(self) -> Energy:
        """Energy (J) of that."""

    def between(self) -> dict[str, FloatArray]:
        """A copy of the motion of what is on no rope alone, now and at the start, by name."""

    def restore(self, full: FullState) -> None:
        """Go to a full state that fits."""


class SingleRope:
    """One rope and what is on it."""

    at_rest: tuple[Kernel, ...] = (cast(Kernel, relax),)

    def __init__(self, scenario: Scenario, part: Ropeway) -> None:
        self.parts: list[Ropeway] = [part]
        self.commands: dict[str, Command] = {}
        self.integrator = cast(Kernel, integrator_named(scenario.solver.integrator))
        self._work = allocate_workspace(part.system)
        self._pack()

    def _pack(self) -> None:
        part = self.parts[0]
        self._packed = pack(part.state)
        self._scratch = pack(clone_state(part.state)), pack(clone_state(part.state)), pack(self._work)

    def check_bare(self) -> None:
        """Refuse a rope that has no rest even without vehicles.

        Raises:
            EquilibriumError: it has none.
        """
        self.parts[0].check_bare()

    def find_rest(self) -> None:
        """Bring the rope to rest.

        Raises:
            EquilibriumError: it finds none.
        """
        part = self.parts[0]
        part.check_bare()
        part.lay(self._work)
        if part.sharpen():
            part.lay(self._work)
        part.check_travel(self.parts, lambda: part.lay(self._work))
        part.take_over_rest()
        self._pack()

    def arguments(self, steps: int) -> tuple[Any, ...]:
        """What the integrator gets to take so many steps."""
        return self.parts[0].packed_system, self._packed, *self._scratch, steps

    def typical(self) -> dict[str, Any]:
        """Arguments that kernels below the integrator get, by their names there; only their types count."""
        return self.parts[0].typical(self._work)

    def advance(self, steps: int) -> tuple[Any, ...]:
        """Take so many steps; the fields of `Outcome`."""
        return self.integrator(*self.arguments(steps))  # type: ignore[no-any-return]

    def couple(self) -> None:
        """Nothing: there is no other rope."""

    def observe(self, columns: Columns) -> None:
        """Nothing: all is on the rope."""

    def energy(self) -> Energy:
        """None: all is on the rope."""
        return Energy(0.0, 0.0, 0.0)

    def begin(self) -> None:
        """Let this be the start, to which a reset goes back."""
        self.parts[0].begin()

    def between(self) -> dict[str, FloatArray]:
        """Nothing: all is on the rope."""
        return {}

    def restore(self, full: FullState) -> None:
        """Go to a full state that fits."""
        restore_ropes(self.parts, full)


def engine_of(scenario: Scenario) -> Engine:
    """What takes the steps of a scenario."""
    if not scenario.ropes:
        return SingleRope(scenario, *_ropeways([scenario], [build_system(scenario)]))
    systems = build_ropes(scenario)
    return RopeBundle(scenario, _ropeways([scenario.of_rope(name) for name in systems], list(systems.values())))


def _ropeways(scenarios: list[Scenario], systems: list[System]) -> list[Ropeway]:
    """One a rope, from the scenario and the system of each."""
    whole = leave_out_absent([with_buffers(*pair) for pair in zip(systems, scenarios, strict=True)])
    return [Ropeway(*pair) for pair in zip(scenarios, whole, strict=True)]


def leave_out_absent(systems: list[System]) -> list[System]:
    """The same systems, all of one type, for kernels that are compiled without what none of them has.

    There are few such types, as what is compiled for one of them is of no use to another one: the paper's elastic model
    may be left out, and with a rope by itself also what lets it go by, and vehicles meet.
    """
    if all(system.cable.elastic_model == CONTINUUM for system in systems):
        known = Known(CONTINUUM)
        systems = [system._replace(cable=system.cable._replace(elastic_model=known)) for system in systems]
    if len(systems) == 1 and not systems[0].moving_cable.moving and not systems[0].buffers.present:
        system, absent = systems[0], cast(bool, Known(False))
        still, apart = system.moving_cable._replace(moving=absent), system.buffers._replace(present=absent)
        systems = [system._replace(moving_cable=still, buffers=apart)]
    return systems


__all__ = [
    "Engine",
    "RelaxationMoment",
    "RopeBundle",
    "SingleRope",
    "engine_of",
    "leave_out_absent",
    "watching_relaxation",
]
