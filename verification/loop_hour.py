"""An hour of the shipped chairlift, a closed loop: no step may fail, and no rope may be lost."""

from __future__ import annotations

import time
from collections.abc import Callable

from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation
from verification.loops import rope_of, spacing_error

HEAD = """\

Closed loops: unstrained rope of all strands, and the way along it from carrier to carrier, each with its largest error
of all seconds; slip is the way by which a rim has gone further than the rope.

| run | simulated | steps | failed | halved | worst joint gap | rope, error | carriers, error | slip | times real time |
| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |
"""


def events() -> dict[int, tuple[str, float]]:
    """Every ten minutes: a service stop, an emergency stop; the fourth ten minutes go backwards. By second."""
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


__all__ = ["HEAD", "chairlift_hour"]
