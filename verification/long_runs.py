"""Long runs of the shipped ropeways: what may not happen in them, and whether all energy is accounted for.

A full trip of the tramway with an emergency stop over its tower, and an hour of the chairlift with starts, stops,
emergency stops and a reversal (`loop_hour`); trips of the jig-back are in `jig_back_stops`.
`python -m verification.long_runs` writes them to `docs/long_runs.md`.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from math import isfinite, sqrt
from pathlib import Path

import numpy as np
from rich.progress import Progress

from cable_twin.frame.snapshot import Snapshot
from cable_twin.mechanics.drives.haul_rope import rope_damping, rope_length
from cable_twin.mechanics.language.compilation import kernel
from cable_twin.mechanics.language.vectors import add_scaled, dot, load
from cable_twin.mechanics.on_rope.friction import friction_force, mobilise
from cable_twin.mechanics.on_rope.sliding_joint import joint_tangent
from cable_twin.mechanics.on_rope.tower import contact_frame, normal_force, slid
from cable_twin.mechanics.parameters import System
from cable_twin.mechanics.state import State
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation
from verification.jig_back_stops import HEAD as JIG_BACK_HEAD
from verification.jig_back_stops import drive_stop, track_rope_stop
from verification.loop_hour import HEAD as LOOP_HEAD
from verification.loop_hour import chairlift_hour
from verification.models import for_kernels
from verification.moving_cable import carrier_energies, viscous_power

PAGE = Path(__file__).parents[1] / "docs" / "long_runs.md"
HEAD = """\
# Long runs of the shipped ropeways

Written by `python -m verification.long_runs`, which takes minutes. Gap of the balance: work of the drive, less what was
dissipated, what carriers took with them and what is stored, over all work that went through the drive in either
direction; the largest of the run. Dissipated is what rope, towers, rollers, haul rope and air take by their own laws.
Times real time: simulated time over processor time of the solver, one thread.

| run | simulated | steps | failed | halved | worst joint gap | through the drive | gap of balance | times real time |
| --- | --- | --- | --- | --- | --- | --- | --- | --- |
"""
Event = tuple[float, Callable[[Simulation], object]]


@kernel
def tower_losses(system: System, state: State) -> float:
    """Power (W) that friction and damping of all contacts of towers take from the rope."""
    total = 0.0
    for contact in range(system.towers.stiffness.size):
        _, r_x, _, normal, depth, moving = contact_frame(system.cable, system.towers, state, contact)
        rate = -dot(normal, moving)
        force, _, _ = normal_force(system.towers, contact, depth, rate)
        elastic, _, _ = normal_force(system.towers, contact, depth, 0.0)
        if force > 0.0:
            total += (force - elastic) * rate
            z, _ = mobilise(slid(state, contact), state.contact_deflection[contact], system.towers.presliding[contact])
            norm = sqrt(dot(r_x, r_x))
            total -= (
                system.towers.friction[contact] * force * z * (dot(moving, r_x) / norm + state.rope.velocity[0] * norm)
            )
    return total


@kernel
def carriage_losses(system: System, state: State) -> float:
    """Power (W) that rolling takes from all carriages that slide, and damping from their haul ropes."""
    cable, carriages = system.cable, system.carriages
    total = 0.0
    for carriage in range(carriages.fixed.size):
        if carriages.clamped[carriage] or carriages.fixed[carriage]:
            continue
        r_x = joint_tangent(cable, state, carriage)
        force = load(state.multipliers[carriages.body_offset[carriage]], cable.gravity)
        across = add_scaled(-dot(force, r_x) / dot(r_x, r_x), r_x, force)
        friction, _, _, _ = friction_force(carriages, state, carriage, sqrt(dot(across, across)))
        total -= friction * sqrt(dot(r_x, r_x)) * state.joints.velocity[carriage]
        if system.haul_ropes.present:
            length, _ = rope_length(system, carriage, state.drums.position[carriage])
            damping, _ = rope_damping(system, carriage, length)
            total += damping * (state.drums.velocity[carriage] - state.hauled.velocity[carriage]) ** 2
    return total


def air_losses(simulation: Simulation) -> float:
    """Power (W) that still air takes from rope and bodies; that of the rope by its nodes."""
    system, state = simulation.system, simulation.state
    moving = np.repeat(state.attached, np.diff(system.carriages.body_offset))
    bodies = float(system.air.body_drag[moving] @ np.linalg.norm(state.bodies.velocity[moving, :2], axis=1) ** 3)
    slopes, velocities = state.nodes.position[:, 1], state.nodes.velocity[:, 0]
    tangents = slopes / np.linalg.norm(slopes, axis=1)[:, None]
    across = velocities - np.sum(velocities * tangents, axis=1)[:, None] * tangents
    lengths = np.convolve(system.cable.element_length, [0.5, 0.5])  # half of either neighbour
    return bodies + system.air.rope_drag * float(lengths @ np.linalg.norm(across, axis=1) ** 3)


@dataclass
class Balance:
    """Where the energy of a run comes from and goes to, all in J, by the trapezoidal rule from frame to frame."""

    simulation: Simulation
    work: float = 0.0  # of the drive
    through: float = 0.0  # the same, driving and braking added up
    dissipated: float = 0.0
    taken: float = 0.0  # by carriers that left, less what those that came brought
    gap: float = 0.0  # largest so far
    _before: tuple[float, float] = (0.0, 0.0)
    _start: float = field(init=False)

    def __post_init__(self) -> None:
        self._start = self.simulation.energy().total

    def advance(self, frame: float) -> None:
        """Go on by one frame (s)."""
        simulation = self.simulation
        if simulation.drives:
            before, energies = simulation.state.attached.copy(), carrier_energies(simulation)
        snapshot = simulation.advance_to(simulation.time + frame)
        if simulation.drives:
            on = simulation.state.attached
            self.taken += float(energies[before & ~on].sum() - carrier_energies(simulation)[on & ~before].sum())
        power = sum(drive.force * drive.speed for drive in snapshot.drives.values())
        for carriage in snapshot.carriages.values():
            if carriage.haul_rope is not None:
                power += carriage.drive_force * carriage.haul_rope.speed
        system, (state, _) = simulation.system, for_kernels(simulation)
        lost = viscous_power(simulation) + air_losses(simulation)
        lost += tower_losses(system, state) + carriage_losses(system, state)
        self.work += 0.5 * frame * (power + self._before[0])
        self.through += 0.5 * frame * abs(power + self._before[0])
        self.dissipated += 0.5 * frame * (lost + self._before[1])
        self._before = power, lost
        stored = simulation.energy().total - self._start
        self.gap = max(self.gap, abs(self.work - self.dissipated - self.taken - stored))


def tramway_trip() -> tuple[Simulation, list[Event], float, float]:
    """Up at 7 m/s, emergency stop with the cabin on the saddle, on at 5 m/s, service stop, and back down."""
    return (
        Simulation(load_scenario("aerial_tramway")),
        [
            (0.0, lambda twin: twin.command("cabin", speed=7.0)),
            (68.0, lambda twin: twin.emergency_stop()),
            (90.0, lambda twin: twin.emergency_stop(False)),
            (91.0, lambda twin: twin.command("cabin", speed=5.0)),
            (200.0, lambda twin: twin.command("cabin", speed=0.0)),
            (230.0, lambda twin: twin.command("cabin", speed=-10.0)),
            (318.0, lambda twin: twin.command("cabin", speed=0.0)),
        ],
        370.0,
        0.02,
    )


RUNS = {"tramway_trip": tramway_trip}
LOOPS = {"chairlift_hour": chairlift_hour}
JIG_BACKS = {"jig_back_drive_stop": drive_stop, "jig_back_track_rope_stop": track_rope_stop}
OTHERS = LOOPS | JIG_BACKS  # which have rows of their own


def run(name: str, share: float, shown: Callable[..., None]) -> str:
    """Carry out a run, or its first share, and return its row of the table; `shown` gets the share that is `completed`.

    Raises:
        SolverError: when a step fails.
        FloatingPointError: when the energy is no finite number.
    """
    simulation, events, end, frame = RUNS[name]()
    end *= share
    balance = Balance(simulation)
    balance.advance(frame)  # compiles what is not compiled yet
    solving, steps, halvings, residual, begun = 0.0, 0, 0, 0.0, simulation.time
    advance_to = simulation.advance_to

    def timed(moment: float) -> Snapshot:
        nonlocal solving
        started = time.process_time()
        snapshot = advance_to(moment)
        solving += time.process_time() - started
        return snapshot

    simulation.advance_to = timed  # type: ignore[method-assign]
    while simulation.time < end - 1e-9:
        while events and events[0][0] <= simulation.time + 1e-9:
            events.pop(0)[1](simulation)
        balance.advance(frame)
        report = simulation.snapshot.solver
        steps, halvings = steps + report.steps, halvings + report.halvings
        residual = max(residual, report.constraint_residual)
        if not isfinite(balance.gap):
            raise FloatingPointError(f"{name}: no finite energy at {simulation.time:g} s")
        shown(completed=simulation.time / end)
    return (
        f"| {name} | {simulation.time:.0f} s | {steps} | 0 | {halvings} | {residual:.1e} m | "
        f"{balance.through / 1e6:.1f} MJ | {100.0 * balance.gap / balance.through:.3f} % | "
        f"{(simulation.time - begun) / solving:.1f} |"
    )


def main() -> int:
    """Carry out the runs and write the page."""
    known = ", ".join((*RUNS, *OTHERS))
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", nargs="*", metavar="RUN", help=f"some of {known}; default: all, and the page")
    parser.add_argument("--share", type=float, default=1.0, help="first part of each, above 0 to 1; default: 1")
    options = parser.parse_args()
    unknown = [name for name in options.runs if name not in (*RUNS, *OTHERS)]
    if unknown or not 0.0 < options.share <= 1.0:
        parser.error(
            f"RUN: given {unknown[0]!r}; allowed: {known}"
            if unknown
            else f"--share: given {options.share:g}; allowed: above 0 to 1"
        )
    rows: dict[str, str] = {}
    for name in options.runs or (*RUNS, *OTHERS):
        with Progress() as bar:
            task = bar.add_task(name, total=1.0)
            shown = partial(bar.update, task)
            rows[name] = OTHERS[name](options.share, shown) if name in OTHERS else run(name, options.share, shown)
        print(rows[name])
    if not options.runs and options.share == 1.0:
        tables = ((HEAD, RUNS), (LOOP_HEAD, LOOPS), (JIG_BACK_HEAD, JIG_BACKS))
        page = "".join(head + "".join(f"{rows[name]}\n" for name in names) for head, names in tables)
        PAGE.write_text(page, encoding="utf-8")
        print(f"wrote {PAGE}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
