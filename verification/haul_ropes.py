"""Cases of a haul rope beside its track rope: no force along the track rope."""

from __future__ import annotations

from collections.abc import Iterator
from math import cos, radians, sin
from typing import Any

import numpy as np

from cable_twin.simulation import Simulation
from verification import Result, case
from verification.models import GRAVITY, beam
from verification.tramway import MASS, hauled, tramway

LOAD = 500.0  # kg, of the carriage on the sagging rope
PULL = 60e3  # N, of its counterweight
TRACK = {"mass_per_length": 3.0, "axial": 30e6}  # kg/m, N


def span(drive: dict[str, Any], **changes: Any) -> Simulation:
    """A carriage at 170 m of a rope that rises 60 m over 240 m, pinned above and pulled by a counterweight below."""
    weight = {"support": "counterweight", "direction": [-0.95, -0.31], "mass": PULL / GRAVITY}
    body = {"mass": LOAD, "inertia": 1.0, "upper_pivot": [0.0, 0.0]}
    cable = {"start": {"position": [0.0, 0.0], **weight}}
    carriages = {"car": {"arc_length": 170.0, "drive": drive, "bodies": {"body": body}}}
    return beam(
        length=247.2,
        bending=0.0,
        elements=160,
        end=(240.0, 60.0),
        supports=("pinned", "pinned"),
        shape="equilibrium",
        **(TRACK | {"cable": cable, "carriages": carriages, "step": 2e-3, "tolerance": 1e-10} | changes),
    )


def carried(tension: float, height: float) -> float:
    """First integral (N) of a rope at rest, of its tension (N) and height (m): ∫ of dT (1 + T/EA) = ρ g dz."""
    return tension * (1.0 + 0.5 * tension / TRACK["axial"]) - TRACK["mass_per_length"] * GRAVITY * height


@case("haul rope and track rope at rest", "T (1 + T/2EA) - rho g z the same at both ends; m g sin", needs_jit=True)
def at_rest() -> Iterator[Result]:
    """Tension difference of both ends equal to the weight of the rope; the pull is on the station.

    What is left is that of a kink, which is rounded over an element.
    """
    for station in ("end", "start"):
        simulation = span(hauled({"station": station}))
        snapshot = simulation.snapshot
        car, ends = snapshot.carriages["car"], snapshot.supports
        assert car.haul_rope is not None
        lower, upper = (float(np.linalg.norm(ends[end].force)) for end in ("start", "end"))
        below = float(simulation.cable_positions(np.zeros(1))[0, 2])
        before, after = simulation.cable_positions(np.array([169.999, 170.001]))
        along = (after - before) / np.linalg.norm(after - before)
        label = f"drive at the {station}"
        yield Result(f"tension kept, {label}", "N", carried(lower, below), carried(upper, 60.0), 5e-4 * PULL)
        yield Result(f"haul force, {label}", "N", LOAD * GRAVITY * along[2], car.haul_rope.force, 1e-2)
        yield Result(f"contact force along the rope, {label}", "N", 0.0, float(car.contact_force @ along), 1e-2)
        whole = sum(end.force for end in ends.values()) + car.haul_rope.force * along
        weight = LOAD * GRAVITY + TRACK["mass_per_length"] * 247.2 * GRAVITY
        yield Result(f"supports and station together, {label}", "N", weight, float(whole[2]), 1e-2)
        yield Result(f"the same level, {label}", "N", 0.0, float(whole[0]), 1e-2)


@case("haul rope against friction", "m g sin + μ m g cos; against a drive on the carriage", needs_jit=True)
def against_friction() -> Iterator[Result]:
    """Constant speed up a straight slope: only friction acts along the track rope."""
    slope, friction = radians(20.0), 0.03
    weight, resisting = MASS * GRAVITY * sin(slope), friction * MASS * GRAVITY * cos(slope)
    along = np.array([cos(slope), 0.0, sin(slope)])
    for label, drive in (("haul rope", hauled({"damping_ratio": 0.3})), ("drive on the carriage", {"mode": "speed"})):
        simulation = tramway(drive, start=20.0, angle=slope, friction={"rolling": friction})
        simulation.command("car", speed=2.0)
        car = simulation.advance_to(12.0).carriages["car"]
        pull = car.drive_force if car.haul_rope is None else car.haul_rope.force
        contact = weight if car.haul_rope is None else -resisting
        yield Result(f"pull, {label}", "N", weight + resisting, pull, 0.05)
        yield Result(f"contact force along the rope, {label}", "N", contact, float(car.contact_force @ along), 0.05)


@case("way of a hauled carriage", "speed of its drum times time, wherever the track rope bends", needs_jit=True)
def way_of_drum() -> Iterator[Result]:
    """Eighty seconds over a rope of little strain that bends by 0.08 rad at the carriage.

    The path of the carriage is longer than the rope that it passes, by 1 / cos of half the angle.
    """
    speed, begun, times = 1.5, 20.0, np.arange(20.25, 100.1, 0.25)
    heavy = {"body": {"mass": 3.0 * LOAD, "inertia": 1.0, "upper_pivot": [0.0, 0.0]}}
    for station in ("end", "start"):
        drive = hauled({"station": station, "damping_ratio": 0.3, "axial_stiffness": 1e9})
        car = {"arc_length": 40.0, "drive": drive, "bodies": heavy}
        simulation = span(drive, carriages={"car": car}, cable={}, axial=30e9, step=5e-3)
        simulation.command("car", speed=speed)
        first = simulation.advance_to(begun).carriages["car"]
        cars = [first, *(simulation.advance_to(float(time)).carriages["car"] for time in times)]
        path = float(np.linalg.norm(np.diff([car.position for car in cars], axis=0), axis=1).sum())
        passed = cars[-1].arc_length - first.arc_length
        assert path > passed * 1.0006
        yield Result(f"way, drive at the {station}", "m", speed * (times[-1] - begun), passed, 1e-2)


@case("haul rope of a track rope that moves along itself", "energy is conserved", needs_jit=True)
def sliding_track() -> Iterator[Result]:
    """Sudden stop of the sheave: energy exchange of carriage, both ropes and counterweight."""
    limits = {"acceleration": 0.5, "emergency_deceleration": 60.0}
    simulation = span(
        hauled({"axial_stiffness": 1e6, "mass_per_length": 1.0}, limits=limits), spectral_radius=0.9, step=1e-3
    )
    simulation.command("car", speed=3.0)
    simulation.advance_to(8.0)
    simulation.emergency_stop()
    simulation.advance_to(8.2)
    start, moving, energies, travels = simulation.energy(), [], [], []
    for time in np.arange(8.2, 20.0, 0.02):
        travels.append(simulation.advance_to(float(time)).supports["start"].travel)
        energies.append(simulation.energy().total)
        moving.append(simulation.energy().kinetic)
    assert np.ptp(travels) > 0.04  # m, with 1.3 kN: 2.5 % of the energy
    lost = float(np.ptp(np.array(energies) - start.total)) / (max(moving) - min(moving))
    yield Result("energy lost or gained, of what is kinetic at times", "-", 0.0, lost, 1e-3)
