"""Cases of several ropes: carriages that slide on one rope and are clamped to another."""

from __future__ import annotations

from collections.abc import Iterator
from math import atan2, cos, hypot
from typing import Any

import numpy as np

from cable_twin.mechanics.drives.moving_rope import moving_rope_force
from cable_twin.mechanics.parameters import DriveLimits, FloatArray
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation
from verification import Result, case
from verification.models import GRAVITY, observed_order

SPAN, RISE = 300.0, 90.0  # m
ROPES = {  # kg/m, N, N m²
    "track": {"mass_per_length": 10.0, "axial_stiffness": 1.6e8, "bending_stiffness": 2e4},
    "haul": {"mass_per_length": 2.5, "axial_stiffness": 3e7, "bending_stiffness": 1e3},
}
TENSIONS = {"track": 4e5, "haul": 6e4}  # N, of each by itself
MASS = 4000.0  # kg
TIGHT, SLACK = 1.2e5, 2e4  # N, of the haul rope


def unstrained(rope: dict[str, float], tension: float, span: float = SPAN, rise: float = RISE) -> float:
    """Unstrained length (m) of a rope in a span (m) that has about this tension (N) by itself: a parabola's."""
    chord, load = hypot(span, rise), rope["mass_per_length"] * GRAVITY * cos(atan2(rise, span))
    sagging = chord + load**2 * chord**3 / (24.0 * tension**2)
    return float(sagging * (1.0 - tension / rope["axial_stiffness"]))


def clamped(
    *,
    places: tuple[float, ...] = (150.0,),
    elements: int = 32,
    dim: int = 2,
    haul: float = TENSIONS["haul"],
    ropes: Any = ROPES,
    **more: Any,
) -> dict[str, Any]:
    """Carriages at `places` (m) of a track rope, clamped to a haul rope beside it, as plain data of a scenario."""

    def at(x: float, z: float) -> list[float]:
        return [x, z] if dim == 2 else [x, 0.0, z]

    held = {"elements": elements, "start": {"position": at(0.0, 0.0)}, "end": {"position": at(SPAN, RISE)}}
    lengths = {rope: unstrained(ROPES[rope], tension) for rope, tension in (TENSIONS | {"haul": haul}).items()}
    share = lengths["haul"] / lengths["track"]
    bodies = {"cabin": {"mass": MASS, "inertia": 9000.0, "upper_pivot": at(0.0, 4.0)}}
    carriages = {
        f"cabin_{number + 1}": {"arc_length": place, "clamped_to": {"haul": place * share}, "bodies": bodies}
        for number, place in enumerate(places)
    }
    both = {name: rope | held | {"unstrained_length": lengths[name]} for name, rope in ropes.items()}
    return {"gravity": GRAVITY, "ropes": both, "carriages": carriages, **more}


def slope_of(simulation: Simulation, rope: str, place: float) -> FloatArray:
    """Way (3,) along a rope per unstrained length at an arc length (m)."""
    before, after = simulation.cable_positions([place - 1e-3, place + 1e-3], rope=rope)
    return np.asarray((after - before) / 2e-3)


def clamp_place(simulation: Simulation) -> float:
    """Unstrained arc length (m) of the haul rope at which the first carriage is clamped at the start."""
    return float(simulation.scenario.carriages["cabin_1"].clamped_to["haul"])


@case("carriage clamped to a haul rope, at rest", "F·t = m g sin θ on a rope that is a rail without friction")
def clamp_at_rest() -> Iterator[Result]:
    """Slack and tight haul ropes, in a plane and in space; what the track rope does not give, the haul rope does."""
    for label, haul, dim in (("tight", TIGHT, 2), ("slack", SLACK, 2), ("in space", TENSIONS["haul"], 3)):
        simulation = Simulation(load_scenario(clamped(haul=haul, dim=dim, places=(100.0,))))
        cabin = simulation.snapshot.carriages["cabin_1"]
        slope = slope_of(simulation, "track", cabin.arc_length)
        along = slope / np.linalg.norm(slope)
        pull = float(simulation.snapshot.columns.haul_pull[0] @ along)
        weight = MASS * GRAVITY * float(along[2])
        yield Result(f"pull along the track rope, {label}", "N", weight, pull, 1e-5 * weight)
        apart = simulation.cable_positions([clamp_place(simulation)], rope="haul")[0] - cabin.position
        yield Result(f"distance of both ropes there, {label}", "m", 0.0, float(np.linalg.norm(apart)), 1e-9)


@case("tension beside a clamped carriage", "T + T²/2EA - m g z is the same along a rope but for F·r_x")
def tension_beside_clamp() -> Iterator[Result]:
    """From end to end of both ropes, so stiff in bending that 2 m long elements have the bend at the carriage.

    On the track rope nothing of the pull of the haul rope is left.
    """
    ropes = {name: rope | {"bending_stiffness": 2e7 if name == "track" else 2e6} for name, rope in ROPES.items()}
    simulation = Simulation(load_scenario(clamped(places=(100.0,), elements=128, ropes=ropes)))
    pull = simulation.snapshot.columns.haul_pull[0]
    on_haul = float(pull @ slope_of(simulation, "haul", clamp_place(simulation)))
    for name, expected in (("track", 0.0), ("haul", on_haul)):
        rope, gained = ROPES[name], []
        for end in ("start", "end"):
            tension = float(np.linalg.norm(simulation.snapshot.supports[f"{name}/{end}"].force))
            gained.append(tension + tension**2 / (2.0 * rope["axial_stiffness"]))
        got = gained[1] - gained[0] - rope["mass_per_length"] * GRAVITY * RISE
        yield Result(f"gained along the {name} rope", "N", expected, got, 1e-3 * on_haul)


@case("carriage pulled by a haul rope, balance of energy", "first law", needs_jit=True, long=True)
def clamp_energy() -> Iterator[Result]:
    """Work of the drive of the haul rope beside the energy of both ropes and the carriage, over several nodes.

    The haul rope moves along itself by its equations, but between two points: it has no bullwheels here.
    """
    for label, tension in (("tight", TIGHT), ("slack", SLACK)):
        simulation = Simulation(load_scenario(clamped(haul=tension, places=(100.0,), solver={"step": 0.002})))
        part, before, start = simulation.parts["haul"], simulation.energy().total, clamp_place(simulation)
        limits = DriveLimits(*np.full((7, 1), 0.5))
        moving = part.system.moving_cable._replace(moving=True, loop_length=1e4, limits=limits)
        part.system = part.system._replace(moving_cable=moving)
        part.state.rope_drive.target[0] = 4.0  # m/s
        work, power, stored, largest = 0.0, 0.0, 0.0, 0.0
        for _ in range(4000):
            snapshot = simulation.advance_to(simulation.time + simulation.step)
            rope = part.state.rope
            slope = slope_of(simulation, "haul", start + float(rope.position[0]))
            force = moving_rope_force(part.system, part.state) + float(snapshot.columns.haul_pull[0] @ slope)
            after = force * float(rope.velocity[0])
            work, power = work + 0.5 * simulation.step * (power + after), after
            stored = simulation.energy().total - before
            largest = max(largest, abs(work - stored))
        yield Result(f"work not found in ropes and carriage, {label}", "J", 0.0, largest, 2e-3 * stored)


def hauled_for(steps: int, dim: int = 2) -> Simulation:
    """A carriage of which the place on the haul rope goes 0.2 m (t / 0.4 s)⁴ on, within one element of each rope."""
    solver = {"step": 0.4 / steps, "tolerance": 1e-12}
    simulation = Simulation(load_scenario(clamped(places=(100.0,), elements=8, dim=dim, solver=solver)))
    state = simulation.parts["haul"].state
    for step in range(1, steps + 1):
        state.rope.position[:] = 0.2 * (step / steps) ** 4
        simulation.advance_to(0.4 * step / steps)
    return simulation


@case("carriage pulled by a haul rope, order in time", "Chung, Hulbert 1993: 2", needs_jit=True)
def clamp_order() -> Iterator[Result]:
    """Its place beside that of a step far shorter; a planar motion in space is that of the plane."""
    found = [hauled_for(steps).snapshot.columns.joint_position[0].copy() for steps in (80, 160, 320, 2560)]
    errors = [float(np.linalg.norm(one - found[-1])) for one in found[:-1]]
    yield Result("order", "-", 2.0, observed_order(errors), 0.1)
    flat, wide = (hauled_for(80, dim).snapshot.columns for dim in (2, 3))
    apart = float(np.abs(flat.joint_position - wide.joint_position).max())
    yield Result("place in a plane and in space, apart", "m", 0.0, apart, 1e-9)
    apart = float(np.abs(flat.haul_pull - wide.haul_pull).max())
    yield Result("pull in a plane and in space, apart", "N", 0.0, apart, 1e-3)


STRANDS = ("track_1", "track_2", "haul_1", "haul_2")
HALF_WAY = {"cabin_1": 521.1, "cabin_2": 521.1}  # m of the track ropes, half their unstrained length


def jig_back(loads: tuple[float, float], elements: int, **more: Any) -> Simulation:
    """Scenario of the shipped jig-back with cabins of given payloads (kg) half-way, without air."""
    changes: dict[str, Any] = {f"ropes.{rope}.elements": elements for rope in STRANDS}
    changes["drives.haul_rope.travel"] = None  # which is from where the cabins start
    for number, (name, load) in enumerate(zip(HALF_WAY, loads, strict=True), start=1):
        changes |= {f"carriages.{name}.payload.mass": load, f"carriages.{name}.arc_length": HALF_WAY[name]}
        changes[f"carriages.{name}.clamped_to"] = {f"haul_{number}": 536.85}
    return Simulation(load_scenario("jig_back", changes | {"air.density": 0.0} | more))


@case("jig-back at rest, cabins half-way", "T + T²/2EA gained at the drive = pulls of the clamps along the haul rope")
def jig_back_at_rest() -> Iterator[Result]:
    """Equal cabins balance each other; else the drive holds what the clamps pull with. Ropes as stiff as above.

    On the track ropes nothing of the pull is left.
    """
    stiff = {f"ropes.{rope}.bending_stiffness": 1e6 if rope.startswith("haul") else 2e7 for rope in STRANDS}
    for label, loads in (("equal cabins", (3000.0, 3000.0)), ("full and empty", (6400.0, 0.0))):
        simulation = jig_back(loads, 192, **stiff)
        columns, cabins = simulation.snapshot.columns, simulation.snapshot.carriages
        pulls = []
        for number, (name, rope) in enumerate(zip(HALF_WAY, STRANDS[2:], strict=True)):
            places = np.linspace(0.0, simulation.scenario.ropes[rope].unstrained_length, 20001)
            along = simulation.cable_positions(places, rope=rope)[:, 0] * (1.0 - 2.0 * number)
            place = float(np.interp(cabins[name].position[0] * (1.0 - 2.0 * number), along, places))
            pulls.append(float(columns.haul_pull[number] @ slope_of(simulation, rope, place)))
        on, off = columns.sheave_tension[0].tolist()
        stiffness = simulation.scenario.ropes["haul_1"].axial_stiffness
        gained = on - off + (on**2 - off**2) / (2.0 * stiffness)
        tolerance = 1e-6 * on if loads[0] == loads[1] else 1e-3 * max(map(abs, pulls))
        yield Result(f"gained at the drive, {label}", "N", sum(pulls), gained, tolerance)
        for rope in STRANDS[:2]:
            cable, supports = simulation.scenario.ropes[rope], simulation.snapshot.supports
            low, high = (float(np.linalg.norm(supports[f"{rope}/{end}"].force)) for end in ("start", "end"))
            ends = simulation.cable_positions([0.0, cable.unstrained_length], rope=rope)
            weight = cable.mass_per_length * simulation.scenario.gravity * float(ends[1, 2] - ends[0, 2])
            gained = high - low + (high**2 - low**2) / (2.0 * cable.axial_stiffness) - weight
            yield Result(f"gained along {rope}, {label}", "N", 0.0, gained, 1e-5 * high)


@case("jig-back under way, equal cabins", "W at the drive = μ Σ N ds of the wheels on the track ropes + ΔE", long=True)
def jig_back_under_way() -> Iterator[Result]:
    """From start to stop between stations and towers; what the damping of the ropes takes is within the row.

    On 120 elements a track rope gives back 14 % of the friction as nodes are handed on, on 240 ones 2 %.
    """
    smooth = {f"towers.{one}_{number}.friction": 0.0 for one in ("tower", "rollers") for number in (1, 2)}
    simulation = jig_back((3000.0, 3000.0), 360, **smooth)
    rolling = simulation.scenario.carriages["cabin_1"].friction.rolling
    before, driven, friction, frame = simulation.energy().total, 0.0, 0.0, 0.05
    for until, speed in ((18.0, 5.0), (40.0, 0.0)):
        simulation.command("haul_rope", speed=speed)
        while simulation.time < until - 1e-9:
            columns = simulation.advance_to(simulation.time + frame).columns
            driven += frame * float(columns.sheave_force[0] * columns.sheave_speed[0])
            normal = np.linalg.norm(columns.contact_force, axis=1)
            friction += frame * float(rolling * normal @ np.abs(columns.speed))
    kept = simulation.energy().total - before
    yield Result("W - ΔE, per friction", "-", 1.0, (driven - kept) / friction, 0.02)
