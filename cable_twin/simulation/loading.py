"""Loading and unloading of carriages over time, in small increments.

All at once, 12 t of a cabin that are 5.6 t a moment later are thrown upwards with g times their ratio, and the rope
shakes for minutes; no load gets out like that.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from cable_twin.mechanics.on_rope.payload import shift_centres
from cable_twin.scenario.sections.vehicles import Payload
from cable_twin.simulation.ropeway import Ropeway


def load(ropeway: Ropeway, masses: Mapping[str, float]) -> None:
    """Begin loading vehicles to `masses` (kg), each over the loading time of its scenario."""
    at_once = {name: mass for name, mass in masses.items() if _room(ropeway, name).loading_time == 0.0}
    ropeway.loading.update(masses)
    put_in(ropeway, at_once)


def load_on(ropeway: Ropeway, time: float) -> None:
    """Continue all loading and unloading by `time` (s)."""
    if ropeway.loading:
        put_in(ropeway, _next_loads(ropeway, time))


def exchange(ropeway: Ropeway) -> None:
    """Set the payload of carriers that have entered a station to that of carriers leaving it."""
    here = ropeway.stations_now()
    came = ~np.isnan(here) & (here != ropeway.stations)
    ropeway.stations = here
    if came.any():
        loads = {
            name: room.from_start if here[ropeway.rows[name]] == 0.0 else room.from_end
            for name, room in ropeway.rooms.items()
            if came[ropeway.rows[name]]
        }
        put_in(ropeway, loads)


def _next_loads(ropeway: Ropeway, time: float) -> dict[str, float]:
    """Payloads (kg) of vehicles under loading after another `time` (s)."""
    loads = {}
    for name, wanted in ropeway.loading.items():
        room, carried = _room(ropeway, name), float(ropeway.state.payload[ropeway.rows[name]])
        most = room.capacity / room.loading_time * time
        loads[name] = min(max(wanted, carried - most), carried + most)
    return loads


def put_in(ropeway: Ropeway, loads: Mapping[str, float]) -> None:
    """Set payloads of vehicles to `loads` (kg); loading ends for vehicles at their wanted payload."""
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


__all__ = ["exchange", "load", "load_on", "put_in"]
