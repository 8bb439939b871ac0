"""Loading and unloading: what gets in or out of a carriage takes its time, a small part of it at a time.

All at once, 12 t of a cabin that are 5.6 t a moment later are thrown upwards with g times their ratio, and the rope
shakes for minutes; no load gets out like that.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from cable_twin.mechanics.on_rope.payload import shift_centres
from cable_twin.scenario.vehicles import Payload
from cable_twin.simulation.ropeway import Ropeway


def load(ropeway: Ropeway, masses: Mapping[str, float]) -> None:
    """Let vehicles be loaded, each in the time of its scenario, until they carry `masses` (kg)."""
    at_once = {name: mass for name, mass in masses.items() if _room(ropeway, name).loading_time == 0.0}
    ropeway.loading.update(masses)
    put_in(ropeway, at_once)


def load_on(ropeway: Ropeway, time: float) -> None:
    """Let what gets in or out go on by `time` (s)."""
    if ropeway.loading:
        put_in(ropeway, _next_loads(ropeway, time))


def exchange(ropeway: Ropeway) -> None:
    """Let carriers that have come into a station carry what one does that leaves it."""
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


__all__ = ["exchange", "load", "load_on", "put_in"]
