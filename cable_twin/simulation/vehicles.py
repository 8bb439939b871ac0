"""Vehicles of a scenario, which exist once for all ropes: parameters, first places, payloads, loading, stations.

Vehicles are loaded over time in small increments: unloaded at once, a cabin of 12 t that weighs 5.6 t a moment later
is thrown upwards with g times the ratio of both, and the rope shakes for minutes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from cable_twin.mechanics.on_rope.chain import load_bodies, shift_centres
from cable_twin.mechanics.on_rope.presence import vehicles_of
from cable_twin.mechanics.parameters import (
    BODY_FIELDS,
    DriveLimits,
    FloatArray,
    IntArray,
    MovingCable,
    System,
    VehicleBuffers,
)
from cable_twin.scenario import Scenario, build_payloads
from cable_twin.scenario.sections.vehicles import Carriage, CarrierPayload, Payload
from cable_twin.simulation.ropeway import Ropeway


class Home(NamedTuple):
    """Index of the first rope of a vehicle, and row of the vehicle among the vehicles of that rope."""

    rope: int
    row: int


class VehicleSettings(NamedTuple):
    """Data of vehicles that are not in their state: payloads in the parameters, loading, last stations and ropes."""

    carried: FloatArray | None  # (vehicles,) kg, payloads in the parameters
    loading: dict[str, float]  # kg, payload at the end of loading, by name
    stations: FloatArray  # (vehicles,) m, place of the station of each at the last look, NaN on the rope
    ropes: IntArray  # (vehicles,) rope of each then


def with_all_vehicles(scenario: Scenario, alone: Sequence[Scenario], systems: Sequence[System]) -> list[System]:
    """Return the system of each rope with the vehicles of all ropes, from systems with the vehicles of one rope each.

    Args:
        scenario: scenario of all ropes.
        alone: scenario of each rope alone.
        systems: system of each rope, with the vehicles of its scenario.
    """
    if len(systems) == 1:
        return list(systems)
    homes = _homes(scenario, alone)
    first = np.cumsum([0, *(system.carriages.fixed.size for system in systems)])
    vehicles = np.array([first[home.rope] + home.row for home in homes], dtype=np.int64)
    sizes = np.concatenate([np.diff(system.carriages.body_offset) for system in systems])
    starts = np.concatenate([[0], np.cumsum(sizes)])
    bodies = np.concatenate([np.zeros(0), *(np.arange(starts[row], starts[row + 1]) for row in vehicles)])
    bodies = bodies.astype(np.int64)
    carriages, hauls = systems[0].carriages, systems[0].haul_ropes
    limits = np.concatenate([np.array(one.carriages.limits) for one in systems], axis=1)
    # `take` gives contiguous rows, as of a rope by itself: kernels of other arrays would be other kernels
    carriages = carriages._replace(
        body_offset=np.cumsum([0, *sizes[vehicles]], dtype=np.int64),
        **{
            name: np.concatenate([getattr(one.carriages, name) for one in systems])[
                bodies if name in BODY_FIELDS else vehicles
            ]
            for name in carriages._fields[1:]
            if name != "limits"
        },
        limits=DriveLimits(*limits.take(vehicles, axis=1)),
    )
    hauls = hauls._replace(
        present=any(one.haul_ropes.present for one in systems),
        **{
            name: np.concatenate([getattr(one.haul_ropes, name) for one in systems])[vehicles]
            for name in hauls._fields
            if name != "present"
        },
    )
    drag = np.concatenate([one.air.body_drag for one in systems])[bodies]
    sheds = [one.air.wind.shedding for one in systems]
    if any(map(len, sheds)):
        counts = [one.carriages.mass.size for one in systems]
        whole = [shed if len(shed) else np.zeros((count, 2)) for shed, count in zip(sheds, counts, strict=True)]
        shedding = np.concatenate(whole)[bodies]
    else:
        shedding = sheds[0]
    buffers = _all_buffers(homes, [one.buffers for one in systems])
    return [
        system._replace(
            carriages=carriages,
            haul_ropes=hauls,
            buffers=buffers,
            air=system.air._replace(body_drag=drag, wind=system.air.wind._replace(shedding=shedding)),
            moving_cable=_carrying(system.moving_cable, scenario, own, alone),
        )
        for system, own in zip(systems, alone, strict=True)
    ]


def _homes(scenario: Scenario, alone: Sequence[Scenario]) -> list[Home]:
    """Index of the first rope of each vehicle, and the vehicle's row on this rope, in the order of the scenario."""
    local = [{name: row for row, name in enumerate(own.vehicles)} for own in alone]
    return [next(Home(rope, own[name]) for rope, own in enumerate(local) if name in own) for name in scenario.vehicles]


def _carrying(moving: MovingCable, scenario: Scenario, own: Scenario, alone: Sequence[Scenario]) -> MovingCable:
    """Parameters of a moving cable with the mask of vehicles it may carry, and its offset along the vehicles' loop."""
    carried = {name for name, vehicle in own.vehicles.items() if vehicle.joint == "clamped"}
    offset = 0.0
    if carried and own.strand is not None:
        home = next(one for one in alone if not carried.isdisjoint(one.vehicles))
        offset = own.strand.offset - (home.strand.offset if home.strand else 0.0)
    carries = np.array([name in carried for name in scenario.vehicles], dtype=np.bool_)
    return moving._replace(loop_offset=offset, carries=carries)


def _all_buffers(homes: Sequence[Home], buffers: Sequence[VehicleBuffers]) -> VehicleBuffers:
    """Buffers between all vehicles that can meet, from the buffers on each rope."""
    rows = {home: row for row, home in enumerate(homes)}
    entries = [
        (home.rope, entry)
        for home in homes
        for entry in range(buffers[home.rope].offset[home.row], buffers[home.rope].offset[home.row + 1])
    ]
    counts = [int(np.diff(buffers[home.rope].offset)[home.row]) for home in homes]

    def column(name: str) -> FloatArray:
        return np.array([getattr(buffers[rope], name)[entry] for rope, entry in entries], dtype=np.float64)

    return VehicleBuffers(
        offset=np.cumsum([0, *counts], dtype=np.int64),
        other=np.array([rows[Home(rope, int(buffers[rope].other[entry]))] for rope, entry in entries], dtype=np.int64),
        side=column("side"),
        room=column("room"),
        stiffness=column("stiffness"),
        damping=column("damping"),
        present=any(one.present for one in buffers),
    )


class Vehicles:
    """Payloads of the vehicles of all ropes: loading over time, and changes in stations.

    Attributes:
        loading: payloads (kg) that vehicles under loading or unloading will have, by name.
        first_loads: payloads (vehicles,) in kg at the start.

    Args:
        scenario: of all ropes.
        parts: ropes with parameters without payloads, and states in one block of memory.
    """

    def __init__(self, scenario: Scenario, parts: Sequence[Ropeway]) -> None:
        """Place all vehicles on their ropes or in stations, with their first payloads."""
        self._parts, self._state, self._scenario = parts, parts[0].state, scenario
        self._rows = {name: row for row, name in enumerate(scenario.vehicles)}
        self._payloads, self._empty = build_payloads(scenario), parts[0].system.carriages
        self._carried: FloatArray | None = None  # kg, in the parameters now
        self._rooms = [_rooms(part.scenario) for part in parts]
        self.loading: dict[str, float] = {}
        found = [_first_rope(name, parts) for name in self._rows]
        self.first_loads = np.array([one.payload.mass if one.payload else 0.0 for _, one in found], dtype=np.float64)
        self.carry(self.first_loads)
        for row, (part, vehicle) in enumerate(found):
            part.place(row, vehicle)
        self.note_stations()

    def carry(self, masses: FloatArray) -> None:
        """Write changed payloads (vehicles,) in kg into the parameters of all ropes."""
        if self._carried is not None and np.array_equal(masses, self._carried):
            return
        carriages = load_bodies(self._empty, self._payloads, masses)
        for part in self._parts:
            part.system = part.system._replace(carriages=carriages)
        self._carried = masses.copy()

    def take_payloads(self, scenario: Scenario) -> None:
        """Write the first payloads of a scenario with equal vehicles into the present parameters of all ropes."""
        alone = {
            id(part): scenario.of_rope(name).vehicles for name, part in zip(scenario.cables, self._parts, strict=True)
        }
        found = [(name, _first_rope(name, self._parts)[0]) for name in self._rows]
        loads = [alone[id(part)][name].payload for name, part in found]
        self.first_loads = np.array([one.mass if one else 0.0 for one in loads], dtype=np.float64)
        carriages = load_bodies(self._empty, self._payloads, self.first_loads)
        for present, given in zip(self._parts[0].system.carriages, carriages, strict=True):
            if isinstance(present, np.ndarray) and isinstance(given, np.ndarray) and present is not given:
                present[...] = given
        self._carried = self.first_loads.copy()

    def take_first_loads(self) -> None:
        """Store the initial payloads in the state."""
        self._state.payload[:] = self.first_loads

    def follow_state(self) -> None:
        """Update stations and parameters after a whole state has been written into memory."""
        self.note_stations()
        self.carry(self._state.payload)

    def settings(self) -> VehicleSettings:
        """Data of vehicles that are not in their state: payloads in the parameters, loading, stations last recorded."""
        return VehicleSettings(self._carried, dict(self.loading), self._stations, self._ropes)

    def take_over(self, settings: VehicleSettings) -> None:
        """Restore vehicle settings of an earlier moment, whose parameters and state are restored as well."""
        self._carried, loading, self._stations, self._ropes = settings
        self.loading = dict(loading)

    def note_stations(self) -> None:
        """Record the present rope and station of each vehicle."""
        self._stations, self._ropes = self._stations_now(), self._state.vehicle_rope.copy()

    def _stations_now(self) -> FloatArray:
        """Arc length (m) of the station that each vehicle is in, NaN for a vehicle on the rope."""
        return np.where(self._state.attached, np.nan, self._state.joints.position)

    @property
    def awaited(self) -> bool:
        """Whether a vehicle has changed its rope or station since the last record, so that payloads may change."""
        if not self.exchanges:
            return False
        same = np.array_equal(self._stations_now(), self._stations, equal_nan=True)
        return not (same and np.array_equal(self._state.vehicle_rope, self._ropes))

    @property
    def exchanges(self) -> bool:
        """Whether payloads of any vehicle change in stations."""
        return any(self._rooms)

    def load(self, masses: Mapping[str, float]) -> None:
        """Begin loading vehicles to `masses` (kg), each over the loading time of its scenario."""
        self.loading.update(masses)
        self.put_in({name: mass for name, mass in masses.items() if self._room(name).loading_time == 0.0})

    def load_on(self, time: float) -> None:
        """Continue all loading and unloading by `time` (s)."""
        loads = {}
        for name, wanted in self.loading.items():
            room, carried = self._room(name), float(self._state.payload[self._rows[name]])
            most = room.capacity / room.loading_time * time
            loads[name] = min(max(wanted, carried - most), carried + most)
        if loads:
            self.put_in(loads)

    def serve(self, time: float) -> None:
        """Continue all loading by `time` (s), and exchange the payloads of vehicles that have reached a station."""
        self.load_on(time)
        if self.awaited:
            self.exchange()

    def exchange(self) -> None:
        """Set the payload of each carrier that has come to or passed a station to the payload on departure."""
        here, ropes = self._stations_now(), self._state.vehicle_rope
        came = (~np.isnan(here) & (here != self._stations)) | (ropes != self._ropes)
        loads = {}
        for part, rooms in zip(self._parts, self._rooms, strict=True):
            own = came & vehicles_of(part.system, self._state) if rooms else came
            for name, room in rooms.items():
                if own[row := self._rows[name]]:
                    place = float(self._state.joints.position[row])
                    loads[name] = room.entering(at_start=2.0 * place < part.system.cable.unstrained_length)
        self.note_stations()
        if loads:
            self.put_in(loads)

    def put_in(self, loads: Mapping[str, float]) -> None:
        """Set payloads of vehicles to `loads` (kg); loading ends for vehicles at their wanted payload."""
        before = self._parts[0].system.carriages.centre_offset
        for name, mass in loads.items():
            self._state.payload[self._rows[name]] = mass
            if mass == self.loading.get(name):
                del self.loading[name]
        self.carry(self._state.payload)
        shift_centres(self._state, self._parts[0].system.carriages.centre_offset - before)

    def _room(self, name: str) -> Payload:
        room = self._scenario.vehicles[name].payload
        assert room is not None
        return room


def _first_rope(name: str, parts: Sequence[Ropeway]) -> tuple[Ropeway, Carriage]:
    """Rope on which, or in a station of which, a vehicle starts; and the vehicle in the scenario of that rope."""
    possible = [(part, part.vehicles[name]) for part in parts if name in part.vehicles]
    return next((one for one in possible if one[0].holds(one[1])), possible[0])


def _rooms(scenario: Scenario) -> dict[str, CarrierPayload]:
    """Payloads with which carriers leave the stations of a rope, by name of the carrier."""
    carriers = scenario.carriers
    if carriers is None:
        return {}
    found = {}
    for number in range(carriers.count):
        if (room := carriers.kind(number).payload) is not None:
            stays = {} if carriers.carries(number) else {"from_start": 0.0, "from_end": 0.0}
            found[f"{carriers.name}_{number + 1}"] = room.model_copy(update=stays)
    return found
