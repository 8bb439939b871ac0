"""Cases of loads on a ropeway besides its own weight: payload, ice, wind; and its height above the ground."""

from __future__ import annotations

from collections.abc import Iterator
from math import cos, pi, radians, sin, sqrt
from typing import Any

import numpy as np

from cable_twin.simulation import Simulation
from verification import Result, case
from verification.models import GRAVITY, beam

DENSITY = 1.225  # kg/m^3, of air


def span(
    *, mass_per_length: float = 1.0, length: float = 100.0, axial: float = 2e6, rise: float = 0.0, **changes: Any
) -> Simulation:
    """A rope of a sag of about 1 % between two pins 100 m apart."""
    return beam(
        length=length,
        mass_per_length=mass_per_length,
        axial=axial,
        bending=1.0,
        elements=32,
        end=(sqrt(100.0**2 - rise**2) - 0.05, rise),
        supports=("pinned", "pinned"),
        shape="equilibrium",
        step=2e-3,
        **changes,
    )


def vehicle(payload: dict[str, Any] | None = None, arc_length: float = 1.0, **body: Any) -> dict[str, Any]:
    """A cabin of 200 kg, 3 m below the rope."""
    cabin = {"mass": 200.0, "inertia": 80.0, "upper_pivot": [0.0, 3.0], **body}
    carriage: dict[str, Any] = {"arc_length": arc_length, "drive": {"mode": "speed"}, "bodies": {"cabin": cabin}}
    return {"car": {**carriage, **({} if payload is None else {"payload": payload})}}


@case("payload", "weight on the supports; mass, centre and inertia of two bodies as one", needs_jit=True)
def payload() -> Iterator[Result]:
    """Loaded in the station; a passenger off the centre tilts the cabin; the motion is that of a heavier body."""
    place, mass = (0.4, -0.8), 150.0
    room = {"capacity": 500.0, "position": list(place), "mass": 0.0}
    simulation = span(carriages=vehicle({**room, "mass": mass}))
    weight = GRAVITY * (100.0 + 200.0 + mass)
    up = sum(support.force[2] for support in simulation.snapshot.supports.values())
    yield Result("vertical force of both supports", "N", weight, up, 1e-6 * weight)
    # hung from one point, the common centre of mass is below it
    centre = np.array(place) * mass / (200.0 + mass) - np.array([0.0, 3.0])
    tilt = np.arctan2(centre[0], -centre[1])
    got = simulation.snapshot.carriages["car"].bodies["cabin"].pitch
    yield Result("tilt at rest", "rad", float(tilt), got, 1e-6)
    offset = np.array(place) * mass / (200.0 + mass)
    inertia = 80.0 + 200.0 * mass / (200.0 + mass) * float(np.dot(place, place))
    heavy = {"mass": 200.0 + mass, "inertia": inertia, "upper_pivot": (np.array([0.0, 3.0]) - offset).tolist()}
    other = span(carriages=vehicle(**heavy))
    for one in (simulation, other):
        one.command("car", speed=2.0)
        one.advance_to(8.0)
    states = [one.snapshot.carriages["car"].bodies["cabin"] for one in (simulation, other)]
    yield Result("difference from one body, pitch after 8 s", "rad", states[1].pitch, states[0].pitch, 1e-9)
    turned = (cos(states[0].pitch) * offset[0] + sin(states[0].pitch) * offset[1]) + states[0].x
    yield Result("difference from one body, place after 8 s", "m", states[1].x, float(turned), 1e-9)
    # loaded in motion of the cabin, nothing jumps
    simulation = span(carriages=vehicle(room))
    before = simulation.advance_to(0.5).carriages["car"].bodies["cabin"]
    simulation.payload("car", mass)
    after = simulation.snapshot.carriages["car"].bodies["cabin"]
    yield Result(
        "jump of the cabin as it is loaded", "m", 0.0, abs(after.x - before.x) + abs(after.z - before.z), 1e-12
    )
    up = np.mean([_lift(simulation, 0.5 + 0.01 * k) for k in range(1, 2000)])
    yield Result("mean vertical force of both supports after it", "N", weight, float(up), 0.01 * weight)


def _lift(simulation: Simulation, time: float) -> float:
    return float(sum(support.force[2] for support in simulation.advance_to(time).supports.values()))


@case("ice on the rope", "weight; diameter of rope and ice", needs_jit=True)
def ice() -> Iterator[Result]:
    """0.5 kg/m of 900 kg/m³ on a rope of 20 mm."""
    cable = {"ice": 0.5, "diameter": 0.02, "drag_coefficient": 1.1}
    iced = span(cable=cable)
    up = sum(support.force[2] for support in iced.snapshot.supports.values())
    yield Result("vertical force of both supports", "N", 150.0 * GRAVITY, up, 1e-6 * 150.0 * GRAVITY)
    diameter = sqrt(0.02**2 + 4.0 * 0.5 / (pi * 900.0))
    yield Result("drag of it", "kg/m²", 0.5 * DENSITY * 1.1 * diameter, iced.system.air.rope_drag, 1e-12)
    heavy = span(mass_per_length=1.5).cable_positions([50.0])[0, 2]
    yield Result("sag against that of a heavier rope", "m", heavy, iced.cable_positions([50.0])[0, 2], 1e-9)


@case("wind on the rope", "q w² takes from the weight; no force along the rope", needs_jit=True)
def wind() -> Iterator[Result]:
    """Upward wind on a level span at rest, then a gust that ends."""
    cable = {"diameter": 0.03, "drag_coefficient": 1.2, "damping_time": 0.0}
    drag = 0.5 * DENSITY * 1.2 * 0.03
    speed = 8.0
    blown = span(cable=cable, air={"wind": [0.0, speed]})
    lighter = span(mass_per_length=1.0 - drag * speed**2 / GRAVITY)
    middle = [one.cable_positions([50.0])[0, 2] for one in (blown, lighter)]
    yield Result("sag against that of a lighter rope", "m", middle[1], middle[0], 2e-3 * abs(middle[1]))
    up = sum(support.force[2] for support in blown.snapshot.supports.values())
    # across a rope of the slope θ: w cos θ, of which cos θ is upwards
    along = np.diff(blown.cable_positions(np.linspace(0.0, 100.0, 4001)), axis=0)
    steep = (along[:, 0] / np.hypot(along[:, 0], along[:, 2])) ** 3
    lift = 100.0 * drag * speed**2 * float(np.mean(steep))
    yield Result("vertical force of both supports", "N", 100.0 * GRAVITY - lift, up, 0.01)
    # a gust of 2 s; then what the rope loses of its energy is what the still air takes
    gusty = span(cable=cable)
    gusty.wind(0.0, 25.0)
    gusty.advance_to(2.0)
    gusty.wind(0.0, 0.0)
    before, frame = gusty.energy().total, 0.004  # s, two steps
    places = np.linspace(0.0, 100.0, 401)
    shapes = []
    for k in range(1001):
        gusty.advance_to(2.0 + frame * k)
        shapes.append(gusty.cable_positions(places))
    velocities = np.gradient(np.array(shapes), frame, axis=0)
    tangents = np.gradient(np.array(shapes), places, axis=1)
    turned = tangents[..., 0] * velocities[..., 2] - tangents[..., 2] * velocities[..., 0]
    across = np.abs(turned) / np.hypot(tangents[..., 0], tangents[..., 2])
    power = drag * np.mean(across**3, axis=1) * 100.0
    taken = frame * float(np.sum(power) - 0.5 * (power[0] + power[-1]))
    yield Result("energy lost in still air in 4 s", "J", taken, before - gusty.energy().total, 0.02 * taken)


@case("wind on a vehicle", "q w² on a pendulum; terminal speed √(m g sin/q)", needs_jit=True)
def wind_on_a_vehicle() -> Iterator[Result]:
    """A cabin that hangs in the wind at rest, and one that rolls down against the air."""
    area, speed = 6.0, 15.0
    q = 0.5 * DENSITY * area
    hanging = span(carriages=vehicle(arc_length=50.0, drag_area=area), air={"wind": [speed, 0.0]})
    got = hanging.snapshot.carriages["car"].bodies["cabin"].pitch
    yield Result("tilt at rest", "rad", -float(np.arctan2(q * speed**2, 200.0 * GRAVITY)), got, 1e-9)
    angle = radians(20.0)
    point = {"mass": 10.0, "inertia": 1.0, "upper_pivot": [0.0, 0.0], "drag_area": 2.0}
    far = 100.0 * (1.0 + 1e-3)
    for blowing in (0.0, 3.0):
        rolling = beam(
            length=100.0,
            mass_per_length=1e-3,
            axial=1e9,
            bending=1.0,
            elements=20,
            end=(far * cos(angle), far * sin(angle)),
            supports=("pinned", "pinned"),
            shape="equilibrium",
            carriages={"car": {"arc_length": 95.0, "bodies": {"body": point}}},
            air={"wind": [blowing * cos(angle), blowing * sin(angle)]},
            step=1e-3,
        )
        car = rolling.advance_to(9.0 if blowing == 0.0 else 12.0).carriages["car"]
        terminal = sqrt(10.0 * GRAVITY * sin(angle) / (0.5 * DENSITY * 2.0)) - blowing
        label = f"terminal speed down in {blowing:g} m/s of wind upwards"
        yield Result(label, "m/s", -terminal, car.speed * (1.0 + 1e-3), 0.01)


@case("clearance", "straight lines over straight lines")
def clearance() -> Iterator[Result]:
    """A weightless straight rope above a ridge, a cabin of 2 m by 3 m beside it."""
    simulation = beam(
        length=100.0,
        mass_per_length=1.0,
        axial=1e6,
        bending=1.0,
        elements=4,
        gravity=0.0,
        end=(80.0, 60.0),
        supports=("pinned", "pinned"),
        shape="straight",
        carriages=vehicle(arc_length=30.0, size=[2.0, 3.0]),
        terrain=[[-5.0, -20.0], [40.0, 20.0], [80.0, 10.0]],
    )
    found = simulation.clearance()
    yield Result("height of the rope", "m", 10.0, found.rope.height, 1e-9)
    yield Result("its place", "m", 40.0, found.rope.x, 1e-9)
    # the cabin's lower corner at x = 24 + 1, 4.5 m below its joint at (24, 18)
    ground = -20.0 + (25.0 + 5.0) * 40.0 / 45.0
    yield Result("height of the cabin", "m", 13.5 - ground, found.vehicles["car"].height, 1e-9)
    yield Result("its place", "m", 25.0, found.vehicles["car"].x, 1e-9)
