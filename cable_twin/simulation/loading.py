"""Loading and unloading: what gets in or out of a carriage takes its time, a small part of it at a time.

All at once, 12 t of a cabin that are 5.6 t a moment later are thrown upwards with g times their ratio, and the rope
shakes for minutes; no load gets out like that.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from cable_twin.mechanics.on_rope.payload import shift_centres
from cable_twin.mechanics.solution.stepping import Outcome
from cable_twin.scenario.schema import Payload
from cable_twin.simulation.ropeway import Ropeway

PERIOD = 0.05  # s of simulated time from one part of a load to the next: a person in four of them


def load(ropeway: Ropeway, masses: Mapping[str, float]) -> None:
    """Let vehicles be loaded, each in the time of its scenario, until they carry `masses` (kg)."""
    at_once = {name: mass for name, mass in masses.items() if _room(ropeway, name).loading_time == 0.0}
    ropeway.loading.update(masses)
    put_in(ropeway, at_once)


def in_parts(ropeway: Ropeway, steps: int, advance: Callable[[int], tuple]) -> Outcome:
    """Take `steps` solver steps by calls of `advance`; loads go on at times that no caller can shift.

    Returns:
        What came of all of them, or until the one that failed.
    """
    period = max(round(PERIOD / ropeway.system.solver.step), 1)
    total = Outcome(True, 0, 0, 0, 0.0, 0.0, 0)
    while total.converged and total.steps < steps:
        rest = steps - total.steps
        until = period - int(ropeway.state.clock[0]) % period if ropeway.loading else rest
        part = Outcome(*advance(min(rest, until)))
        total = part._replace(
            steps=total.steps + part.steps,
            iterations=total.iterations + part.iterations,
            halvings=total.halvings + part.halvings,
            gap=max(total.gap, part.gap),
        )
        if ropeway.loading and total.converged and int(ropeway.state.clock[0]) % period == 0:
            put_in(ropeway, _next_loads(ropeway, period * ropeway.system.solver.step))
    return total


def _next_loads(ropeway: Ropeway, time: float) -> dict[str, float]:
    """What vehicles that are being loaded carry (kg) after another `time` (s)."""
    loads = {}
    for name, wanted in ropeway.loading.items():
        room, carried = _room(ropeway, name), float(ropeway.state.payload[ropeway.rows[name]])
        most = room.capacity / room.loading_time * time
        loads[name] = min(max(wanted, carried - most), carried + most)
    return loads


def put_in(ropeway: Ropeway, loads: Mapping[str, float]) -> None:
    """Let vehicles carry `loads` (kg) from now on; those that carry what they shall are loaded."""
    before = ropeway.system.carriages.centre_offset
    for name, mass in loads.items():
        ropeway.state.payload[ropeway.rows[name]] = mass
        if mass == ropeway.loading.get(name):
            del ropeway.loading[name]
    ropeway.carry(ropeway.state.payload)
    shift_centres(ropeway.state, ropeway.system.carriages.centre_offset - before)


def _room(ropeway: Ropeway, name: str) -> Payload:
    room = ropeway.scenario.vehicles[name].payload
    assert room is not None
    return room


__all__ = ["PERIOD", "in_parts", "load", "put_in"]
