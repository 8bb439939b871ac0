"""Cases of bicable lifts: carriers that ride a loop, clamped to its strands, and slide on track ropes."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation
from verification import Result, case
from verification.models import GRAVITY
from verification.ropes import slope_of, unstrained

SPAN, RISE, CLAMP = 200.0, 40.0, -0.5  # m, and of the clamp from the joint
TRACK = {"mass_per_length": 8.0, "axial_stiffness": 1.5e8, "bending_stiffness": 1e4}
HAUL = {"mass_per_length": 2.0, "axial_stiffness": 2e7, "bending_stiffness": 3e2}
TENSIONS = 3e5, 4e4  # N, of track and haul ropes by themselves
EMPTY, FULL = 800.0, 600.0  # kg, of a cabin and of what it carries uphill
HANGERS = (50.0, 100.0, 150.0)  # m along the track, of slack carriers
STRANDS = {"haul_up": "track_up", "haul_down": "track_down"}
CLAMP_BELOW = -0.6  # m, of the clamp of a shipped cabin from its joint
RAILS = 16.0  # m, at both ends of a track: beyond that nothing is carried by the rails of a station


LENGTH = unstrained(TRACK, TENSIONS[0], SPAN, RISE)  # m, of a track
STRAND = unstrained(HAUL, TENSIONS[1], SPAN, RISE)  # m, of a strand


def lift(*, count: int = 4, first: float | None = None, loaded: bool = True, hangers: bool = False) -> dict[str, Any]:
    """A lift with two track ropes, one loop and `count` cabins, the first at a place (m), as plain data."""
    tops = {"joint": [SPAN, RISE], "clamp": [SPAN, RISE + CLAMP]}
    feet = {"joint": [0.0, 0.0], "clamp": [0.0, CLAMP]}

    def rope(kind: dict[str, float], at: str, length: float, upward: bool) -> dict[str, Any]:
        start, end = ({"position": side[at]} for side in ((feet, tops) if upward else (tops, feet)))
        return kind | {"unstrained_length": length, "elements": 40, "start": start, "end": end}

    ropes = {f"track_{way}": rope(TRACK, "joint", LENGTH, way == "up") for way in ("up", "down")}
    ropes |= {f"haul_{way}": rope(HAUL, "clamp", STRAND, way == "up") for way in ("up", "down")}
    wheel = {"radius": 1.5, "friction": 0.3, "inertia": 5000.0}
    motor = {"name": "motor", "limits": {"speed": 6.0, "acceleration": 0.5, "jerk": 0.5}}
    carriers: dict[str, Any] = {"name": "cabin", "count": count, "tracks": STRANDS, "clamp_offset": [0.0, CLAMP]}
    carriers["bodies"] = {"cabin": {"mass": EMPTY, "inertia": 500.0, "upper_pivot": [0.0, 2.5]}}
    carriers |= {} if first is None else {"first": first}
    if loaded:
        carriers["payload"] = {"capacity": FULL, "leaving": {"return": FULL, "drive": 0.0}}
    rods = {
        f"{way}_{number}": {
            "from": [f"track_{way}", place],
            "to": [f"haul_{way}", place * STRAND / LENGTH],
            "length": 0.05 - CLAMP,
            "stiffness": 1e5,
            "damping": 200.0,
        }
        for way in ("up", "down")
        for number, place in enumerate(HANGERS if hangers else ())
    }
    return {
        "gravity": GRAVITY,
        "ropes": ropes,
        "sheaves": {
            "drive": wheel | {"joins": ["haul_up.end", "haul_down.start"], "drive": motor},
            "return": wheel | {"joins": ["haul_down.end", "haul_up.start"]},
        },
        "connectors": rods,
        "carriers": carriers,
    }


def off_rails(simulation: Simulation) -> list[int]:
    """Rows of the carriers beyond the station rails, carried by both ropes alone."""
    c, ropes = simulation.snapshot.columns, list(simulation.scenario.ropes)
    ends = np.array([simulation.scenario.ropes[ropes[int(rope)]].unstrained_length for rope in c.vehicle_rope])
    between = (c.arc_length > RAILS) & (c.arc_length < ends - RAILS)
    return [int(row) for row in np.flatnonzero((c.attached == 1.0) & between)]


def track_of(simulation: Simulation, row: int) -> str:
    """Name of the track rope with a carrier."""
    return list(simulation.scenario.ropes)[int(simulation.snapshot.columns.vehicle_rope[row])]


@case("bicable lift at rest, pull of the clamps", "F·t = m g sin θ on a rope that is a rail without friction")
def bicable_clamps() -> Iterator[Result]:
    """Clamp forces of each cabin on the line, full or empty: the largest error, of elements of 30 m; 6e-5 with 10 m."""
    simulation = Simulation(load_scenario("bicable"))
    c, carriers = simulation.snapshot.columns, simulation.scenario.carriers
    empty, off = sum(body.mass for body in carriers.bodies.values()) if carriers else 0.0, []
    for row in off_rails(simulation):
        slope = slope_of(simulation, track_of(simulation, row), float(c.arc_length[row]))
        along, weight = slope / np.linalg.norm(slope), GRAVITY * (empty + float(c.payload[row]))
        off.append(float(c.haul_pull[row] @ along) / (weight * float(along[2])) - 1.0)
    yield Result("cabins on the line", "-", 16.0, float(len(off)), 3.0)
    yield Result("pull along the track, share that is off", "-", 0.0, max(off, key=abs), 1e-3)


@case("bicable lift at rest, slack carriers", "the weight of a strand is carried by bullwheels, clamps and carriers")
def slack_carriers() -> Iterator[Result]:
    """Slack clamps beside a carrier pull with nothing; others are tight."""
    simulation = Simulation(load_scenario(lift(first=HANGERS[1] * STRAND / LENGTH + 2.0, hangers=True)))
    c, pulls = simulation.snapshot.columns, simulation.snapshot.columns.connector_force
    held, rods = 0.0, simulation.scenario.connectors
    for (name, rod), pull in zip(rods.items(), pulls.tolist(), strict=True):
        if name.startswith("up"):
            (track, place), (haul, beside) = rod.ends
            way = (
                simulation.cable_positions([place], rope=track)[0] - simulation.cable_positions([beside], rope=haul)[0]
            )
            held += pull * float(way[2] / np.linalg.norm(way))
    on = [row for row in off_rails(simulation) if track_of(simulation, row) == "track_up"]
    held -= sum(float(c.haul_pull[row, 2]) for row in on)
    held += sum(float(simulation.snapshot.supports[f"haul_up/{end}"].force[2]) for end in ("start", "end"))
    state = simulation.parts["haul_up"].state
    weight = HAUL["mass_per_length"] * (STRAND + float(state.surplus[0])) * GRAVITY
    yield Result("weight of the strand", "N", weight, held, 1e-4 * weight)
    yield Result("pull beside the cabin", "N", 0.0, float(pulls[list(rods).index("up_1")]), 0.0)
    for number in (0, 2):
        share = HAUL["mass_per_length"] * GRAVITY * STRAND / 4.0
        name = f"up_{number}"
        yield Result(
            f"pull of {name} beside weight of a quarter", "N", share, float(pulls[list(rods).index(name)]), share
        )


@case("bicable lift at rest, tension along the haul rope", "T - q z of a rope changes by forces along it alone")
def haul_rope_tension() -> Iterator[Result]:
    """Slack carriers and sheaves pass no force along the rope, so that it has the weight of rope and cabins alone.

    Between both ends of each strand, over what the clamps pull along it; the nearest carriers are square to the rope.
    """
    simulation = Simulation(load_scenario("bicable"))
    snapshot, scenario = simulation.snapshot, simulation.scenario
    for name, track_name in STRANDS.items():
        ends = [snapshot.supports[f"{name}/{end}"].force for end in ("start", "end")]
        heights = [float(scenario.ropes[name].ends[end].position[-1]) for end in ("start", "end")]
        weight = scenario.ropes[name].mass_per_length * scenario.gravity * (heights[1] - heights[0])
        pulled = 0.0
        places = np.arange(1.0, scenario.ropes[name].unstrained_length - 1.0, 0.25)
        points = simulation.cable_positions(places, rope=name)
        for row in np.flatnonzero(snapshot.columns.attached == 1.0).tolist():
            if track_of(simulation, row) == track_name:
                apart = np.linalg.norm(points - snapshot.columns.joint_position[row] - [0.0, 0.0, CLAMP_BELOW], axis=1)
                tangent = slope_of(simulation, name, float(places[np.argmin(apart)]))
                pulled += float(snapshot.columns.haul_pull[row] @ tangent / np.linalg.norm(tangent))
        gained = float(np.linalg.norm(ends[1]) - np.linalg.norm(ends[0]))
        yield Result(f"{name}: tension gained", "N", weight + pulled, gained, 2e-3 * abs(gained))
    for name, rod in scenario.connectors.items():
        (track, place), (haul, _) = rod.ends
        if name in ("up_2", "down_5"):
            upper = simulation.cable_positions([place], rope=track)[0]
            along = np.linspace(rod.ends[1][1] - 3.0, rod.ends[1][1] + 3.0, 6001)
            nearest = float(np.min(np.linalg.norm(simulation.cable_positions(along, rope=haul) - upper, axis=1)))
            pull = rod.stiffness * (nearest - rod.length)
            yield Result(f"{name}: pull, of its least distance", "N", pull, snapshot.connectors[name], 1e-2)


def sheave_way(simulation: Simulation) -> float:
    """Unstrained rope (m) that has passed over the drive bullwheel."""
    return float(simulation.snapshot.columns.sheave_position[0])


@case("bicable lift, laps with a stop and back", "kinematics: rope is neither made nor lost", needs_jit=True, long=True)
def bicable_laps() -> Iterator[Result]:
    """Unstrained rope on the loop and between riders of one strand, and closed clamps, over a lap."""
    simulation = Simulation(load_scenario(lift(count=6)), samples=2)
    spacing, lost, moved, gap, halvings = simulation.scenario.spacing, 0.0, 0.0, 0.0, 0
    loop = sum(simulation.scenario.ropes[name].unstrained_length for name in STRANDS)
    loop += sum(float(simulation.parts[name].state.surplus[0]) for name in STRANDS)
    for speed, duration in ((5.0, 130.0), (-5.0, 60.0)):
        simulation.command("motor", speed=speed)
        end = simulation.time + duration
        while simulation.time < end:
            snapshot = simulation.advance_to(simulation.time + 0.5)
            halvings += snapshot.solver.halvings
            gap = max(gap, snapshot.solver.constraint_residual)
            on_strands, places = 0.0, unstrained_places(simulation)
            for name in STRANDS:
                state = simulation.parts[name].state
                here = simulation.scenario.ropes[name].unstrained_length + float(state.surplus[0])
                on_strands += here + float(state.rope.position[0] - state.rope.position[1])
                apart = np.diff(np.sort(places.get(name, [])))
                moved = max(moved, float(np.abs(apart - spacing).max(initial=0.0)))
            lost = max(lost, abs(on_strands - loop))
    yield Result("rope made or lost", "m", 0.0, lost, 1e-9)
    yield Result("rope between riders, beside their distance", "m", 0.0, moved, 1e-9)
    yield Result("gap of joints and clamps", "m", 0.0, gap, 1e-9)
    yield Result("steps halved", "-", 0.0, float(halvings), 0.0)


def unstrained_places(simulation: Simulation) -> dict[str, list[float]]:
    """Unstrained rope (m) of a strand before each of its riders, by strand."""
    moving, ropes = simulation._engine.moving, list(simulation.scenario.ropes)  # type: ignore[union-attr]
    found: dict[str, list[float]] = {}
    for rope, place in zip(moving.clamp_rope.tolist(), moving.clamp_place.tolist(), strict=True):
        if rope >= 0:
            state, length = (
                simulation.parts[ropes[rope]].state,
                simulation.scenario.ropes[ropes[rope]].unstrained_length,
            )
            on_strand = length + float(state.surplus[0] + state.rope.position[0] - state.rope.position[1])
            found.setdefault(ropes[rope], []).append(place * on_strand / length)
    return found


@case("bicable lift, balance of energy", "first law", needs_jit=True, long=True)
def bicable_energy() -> Iterator[Result]:
    """Work of the drive between the stations, with four cabins, beside the energy of all that moves."""
    simulation = Simulation(load_scenario(lift(first=25.0)), samples=2)
    simulation.command("motor", speed=5.0)
    before, work, power, largest, stored = simulation.energy().total, 0.0, 0.0, 0.0, 0.0
    while sheave_way(simulation) < 50.0:
        columns = simulation.advance_to(simulation.time + simulation.step).columns
        after = float(columns.moving_cable_force[0] * columns.drive_speed[0])
        work, power = work + 0.5 * simulation.step * (power + after), after
        stored = simulation.energy().total - before
        largest = max(largest, abs(work - stored))
    yield Result("work not found in ropes, wheels and cabins", "J", 0.0, largest, 2e-3 * stored)
