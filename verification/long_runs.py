"""Long runs of the shipped ropeways: excluded events, and a complete energy balance.

A full trip of the tramway with an emergency stop over its tower; an hour of the chairlift, a closed loop, with starts,
stops, emergency stops and a reversal, in which no rope may be lost; trips of the jig-back with an emergency stop while
a cabin is on the tower, in which no step may fail. One of these stops with the drive and goes on to the stations. In
the other one the drive and what brakes it have failed, which is a brake of 1 N here: the track-rope brakes stop all.
`python -m verification.long_runs` writes them to `docs/long_runs.md`.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from math import degrees, inf, isfinite, sqrt
from pathlib import Path
from typing import Any

import numpy as np
from rich.progress import Progress

from cable_twin.frame.snapshot import Snapshot
from cable_twin.mechanics.drives.haul_rope import rope_damping, rope_length
from cable_twin.mechanics.language.compilation import kernel
from cable_twin.mechanics.language.rotations import orientation
from cable_twin.mechanics.language.vectors import add_scaled, dot, load
from cable_twin.mechanics.on_rope.friction import friction_force
from cable_twin.mechanics.on_rope.sliding_joint import joint_tangent
from cable_twin.mechanics.on_rope.tower import contact_frame
from cable_twin.mechanics.on_rope.tower_contact import mobilised, normal_force
from cable_twin.mechanics.parameters import System
from cable_twin.mechanics.state import State
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation
from verification.loops import rope_of, spacing_error
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
LOOP_HEAD = """\

Closed loops: unstrained rope of all strands, and the way along it from carrier to carrier, each with its largest error
of all seconds; slip is the way by which a rim has gone further than the rope.

| run | simulated | steps | failed | halved | worst joint gap | rope, error | carriers, error | slip | times real time |
| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |
"""
JIG_BACK_HEAD = """\

Jig-back at 10 m/s, emergency stop when its full cabin comes onto the tower; in `jig_back_drive_stop` it goes on 40 s
later, in `jig_back_track_rope_stop` the drive has failed. Ways of the full and the empty cabin, swing along the track,
highest tension of the track ropes, lowest and highest of the haul rope are those until it goes on.

| run | simulated | steps | failed | halved | joint gap | ways | swing | track ropes | haul rope | slip | real time |
| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |
"""
TOWER = 388.0  # m along the track, where its saddle begins
STAND = 40.0  # s from the stop until the release
FRAME = 0.05  # s
FAILED: dict[str, Any] = {
    "sheaves.drive.brake": {"force": 1.0},
    **{f"carriages.cabin_{one}.drive.emergency_stop": ["track_rope_brake"] for one in (1, 2)},
}
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
            z = mobilised(system.cable, system.towers, state, contact)
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
    moving, bodies = np.repeat(state.attached, np.diff(system.carriages.body_offset)), 0.0
    for place, velocity, drag in zip(
        state.bodies.position[moving], state.bodies.velocity[moving, :2], system.air.body_drag[moving], strict=True
    ):
        own = velocity @ np.reshape(orientation(place, system.cable.gravity), (2, 2))  # along the axes of the body
        bodies += float(own @ drag.reshape(2, 2) @ own * np.linalg.norm(own))
    slopes, velocities = state.nodes.position[:, 1], state.nodes.velocity[:, 0]
    tangents = slopes / np.linalg.norm(slopes, axis=1)[:, None]
    across = velocities - np.sum(velocities * tangents, axis=1)[:, None] * tangents
    lengths = np.convolve(system.cable.element_length, [0.5, 0.5])  # half of either neighbour
    return bodies + system.air.rope_drag * float(lengths @ np.linalg.norm(across, axis=1) ** 3)


@dataclass
class Balance:
    """Energy supplied and dissipated in a run, all in J, by the trapezoidal rule from frame to frame."""

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
        """Add one frame (s)."""
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


def events() -> dict[int, tuple[str, float]]:
    """Stops by second: every ten minutes a service stop and an emergency stop; reversal in the fourth ten minutes."""
    found: dict[int, tuple[str, float]] = {}
    for number in range(6):
        begin, speed = 600 * number, -2.5 if number == 3 else 2.5
        found |= {begin: ("speed", speed), begin + 240: ("speed", 0.0), begin + 270: ("speed", speed)}
        found |= {begin + 540: ("stop", 1.0), begin + 580: ("stop", 0.0)}
    return found


def chairlift_hour(share: float, shown: Callable[..., None]) -> str:
    """Carry out the hour, or its first share, and return its row of the table.

    Raises:
        SolverError: when a step fails.
    """
    simulation = Simulation(load_scenario("chairlift"), samples=2, on_demand=True)
    rope, planned, end = rope_of(simulation), events(), round(3600 * share)
    lost, apart, residual, slip, solving, steps, halvings = 0.0, 0.0, 0.0, 0.0, 0.0, 0, 0
    for second in range(end):
        kind, value = planned.get(second, ("", 0.0))
        if kind == "speed":
            simulation.command("haul_rope", speed=value)
        elif kind:
            simulation.emergency_stop(value == 1.0)
        started = time.process_time()
        snapshot = simulation.advance_to(second + 1.0)
        solving += time.process_time() - started
        report = snapshot.solver
        steps, halvings = steps + report.steps, halvings + report.halvings
        residual = max(residual, report.constraint_residual)
        lost, apart = max(lost, abs(rope_of(simulation) - rope)), max(apart, spacing_error(simulation))
        slip = max(slip, float(abs(snapshot.columns.sheave_slip).max()))
        shown(completed=(second + 1) / end)
    return (
        f"| chairlift_hour | {end} s | {steps} | 0 | {halvings} | {residual:.1e} m | {lost:.1e} m | {apart:.1e} m | "
        f"{slip:.1e} m | {end / solving:.1f} |"
    )


class Extremes:
    """Extremes of a stop, from its first frame on."""

    def __init__(self, first: Snapshot) -> None:
        self._places = [first.carriages[name].arc_length for name in first.layout.carriages]
        self.ways, self.swing = [0.0, 0.0], 0.0  # m, rad
        self.track, self.slackest, self.haul = 0.0, inf, 0.0  # N

    def take(self, snapshot: Snapshot) -> None:
        """Add one frame."""
        for row, name in enumerate(snapshot.layout.carriages):
            cabin = snapshot.carriages[name]
            self.ways[row] = max(self.ways[row], abs(cabin.arc_length - self._places[row]))
            self.swing = max(self.swing, abs(cabin.bodies["cabin"].pitch))
        for name, rope in snapshot.ropes.items():
            low, high = float(rope.tensions.min()), float(rope.tensions.max())
            if name.startswith("track"):
                self.track = max(self.track, high)
            else:
                self.slackest, self.haul = min(self.slackest, low), max(self.haul, high)


def trip(name: str, changes: dict[str, Any], goes_on: bool, share: float, shown: Callable[..., None]) -> str:
    """Carry out a trip, or its first share, and return its row of the table.

    Raises:
        SolverError: when a step fails.
    """
    simulation = Simulation(load_scenario("jig_back", changes))
    end = (200.0 if goes_on else 120.0) * share
    simulation.command("haul_rope", speed=10.0)
    steps, halvings, residual, slip, solving = 0, 0, 0.0, 0.0, 0.0
    seen, stopped, released = Extremes(simulation.snapshot), inf, False
    while simulation.time < end - 1e-9:
        started = time.process_time()
        snapshot = simulation.advance_to(simulation.time + FRAME)
        solving += time.process_time() - started
        report = snapshot.solver
        steps, halvings = steps + report.steps, halvings + report.halvings
        residual = max(residual, report.constraint_residual)
        slip = max(slip, float(abs(snapshot.columns.sheave_slip).max()))
        if stopped == inf and snapshot.carriages["cabin_1"].position[0] >= TOWER:
            simulation.emergency_stop()
            stopped, seen = simulation.time, Extremes(snapshot)
        elif stopped < inf and not released:
            seen.take(snapshot)
        if goes_on and not released and simulation.time >= stopped + STAND:
            simulation.emergency_stop(False)
            simulation.command("haul_rope", speed=10.0)
            released = True
        shown(completed=simulation.time / end)
    ways, (low, high) = "and ".join(f"{way:.1f} m " for way in seen.ways), (seen.slackest / 1e3, seen.haul / 1e3)
    return (
        f"| {name} | {simulation.time:.0f} s | {steps} | 0 | {halvings} | {residual:.1e} m | {ways}| "
        f"{degrees(seen.swing):.1f}° | {seen.track / 1e3:.0f} kN | {low:.1f} and {high:.1f} kN | {slip:.1e} m | "
        f"{simulation.time / solving:.1f} |"
    )


def drive_stop(share: float, shown: Callable[..., None]) -> str:
    """Emergency stop by the drive; after the release on to the stations."""
    return trip("jig_back_drive_stop", {}, True, share, shown)


def track_rope_stop(share: float, shown: Callable[..., None]) -> str:
    """Emergency stop by the track-rope brakes, which then hold."""
    return trip("jig_back_track_rope_stop", FAILED, False, share, shown)


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
