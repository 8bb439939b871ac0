"""Trips of the shipped jig-back with an emergency stop while a cabin is on the tower: no step may fail.

One stops with the drive and goes on to the stations. In the other one the drive and what brakes it have failed, which
is a brake of 1 N here, and the track-rope brakes of both cabins stop all.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from math import degrees, inf
from typing import Any

from cable_twin.frame.snapshot import Snapshot
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation

HEAD = """\

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


class Extremes:
    """What a stop does, from its first frame on."""

    def __init__(self, first: Snapshot) -> None:
        self._places = [first.carriages[name].arc_length for name in first.layout.carriages]
        self.ways, self.swing = [0.0, 0.0], 0.0  # m, rad
        self.track, self.slackest, self.haul = 0.0, inf, 0.0  # N

    def take(self, snapshot: Snapshot) -> None:
        """Take in one frame."""
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
    """The drive stops it; after the release it goes on to the stations."""
    return trip("jig_back_drive_stop", {}, True, share, shown)


def track_rope_stop(share: float, shown: Callable[..., None]) -> str:
    """The track-rope brakes stop it, and hold."""
    return trip("jig_back_track_rope_stop", FAILED, False, share, shown)


__all__ = ["HEAD", "drive_stop", "track_rope_stop"]
