"""Cases along a taut light rope, straight to 0.1 mm: drive, friction, end stops."""

from __future__ import annotations

from collections.abc import Iterator
from math import cos, radians, sin, tan
from typing import Any

import numpy as np
from scipy.optimize import brentq

from cable_twin.scenario.builders.vehicles import PRESLIDING
from cable_twin.simulation import Simulation
from verification import Result, case
from verification.models import GRAVITY, beam

MASS = 10.0  # kg, of the carriage
LENGTH = 100.0  # m, of the rope without tension
STRAIN = 1e-3  # of the rope: a metre of arc length is 1.001 m of way


def slope(
    angle: float,
    start: float,
    *,
    friction: dict[str, float] | None = None,
    drive: dict[str, Any] | None = None,
    end_stop: dict[str, float] | None = None,
    body: dict[str, Any] | None = None,
    step: float = 1e-3,
) -> Simulation:
    """A point mass at arc length `start` (m) on a straight rope that rises by `angle` (rad), under 1 MN."""
    far = LENGTH * (1.0 + STRAIN)
    return beam(
        length=LENGTH,
        mass_per_length=1e-3,
        axial=1e9,
        bending=1.0,
        elements=20,
        end=(far * cos(angle), far * sin(angle)),
        supports=("pinned", "pinned"),
        shape="equilibrium",
        carriages={
            "car": {
                "arc_length": start,
                "friction": friction or {},
                "drive": drive or {},
                "end_stop": end_stop or {},
                "bodies": {"body": {"mass": MASS, "inertia": 1.0, "upper_pivot": [0.0, 0.0], **(body or {})}},
            }
        },
        step=step,
        tolerance=1e-10,
    )


def gained_speed(simulation: Simulation, start: float, end: float) -> float:
    """Mean acceleration (m/s²) along the rope between two times (s)."""
    before = simulation.advance_to(start).carriages["car"].speed
    after = simulation.advance_to(end).carriages["car"].speed
    return (after - before) * (1.0 + STRAIN) / (end - start)


@case("friction on a slope", "Coulomb; Dahl 1968", needs_jit=True)
def friction_on_a_slope() -> Iterator[Result]:
    """30 degrees: holds above μ = tan 30° = 0.577, slides below with g (sin - μ cos)."""
    angle = radians(30.0)
    for coefficient in (0.3, 0.5):
        simulation = slope(angle, 90.0, friction={"rolling": coefficient})
        expected = -GRAVITY * (sin(angle) - coefficient * cos(angle))
        got = gained_speed(simulation, 0.5, 1.5)
        yield Result(f"acceleration at μ = {coefficient:g}", "m/s²", expected, got, 2e-3)
    # let go with nothing mobilised it slides until the friction has taken up the work of the weight:
    # tan(angle) D = μ (D - p (1 - exp(-D/p)))
    coefficient = 0.8
    share = tan(angle) / coefficient
    way = PRESLIDING * brentq(lambda x: (1.0 - np.exp(-x)) / x - (1.0 - share), 1e-3, 50.0)
    simulation = slope(angle, 50.0, friction={"rolling": coefficient}, step=1e-4)
    places = [simulation.advance_to(1e-3 * frame).carriages["car"].arc_length - 50.0 for frame in range(1, 100)]
    yield Result("first way of a carriage that holds", "mm", -1e3 * way, 1e3 * min(places), 0.01)
    # what rings on the rope ratchets friction that yields; a little viscous friction calms it
    simulation = slope(angle, 50.0, friction={"rolling": coefficient, "viscous": 100.0})
    before = simulation.advance_to(5.0).carriages["car"].arc_length
    after = simulation.advance_to(15.0).carriages["car"].arc_length
    yield Result("creep in 10 s", "µm", 0.0, 1e6 * (after - before), 1.0)
    simulation = slope(angle, 50.0, friction={"rolling": coefficient})
    before = simulation.advance_to(10.0).carriages["car"].arc_length
    after = simulation.advance_to(20.0).carriages["car"].arc_length
    yield Result("creep from 10 to 20 s without any damping, ringing", "mm", 0.0, 1e3 * (after - before), 2.0)


@case("viscous friction on a slope", "terminal speed m g sin / c", needs_jit=True)
def viscous_slope() -> Iterator[Result]:
    """Terminal speed to 1e-5 after ten time constants m/c."""
    angle, viscous = radians(30.0), 20.0
    simulation = slope(angle, 90.0, friction={"viscous": viscous})
    expected = -MASS * GRAVITY * sin(angle) / viscous
    yield Result("speed after 6 s", "m/s", expected, simulation.advance_to(6.0).carriages["car"].speed, 1e-3)


@case("driven joint, trapezoid", "v²/2a and m a + m g sin", needs_jit=True)
def trapezoid() -> Iterator[Result]:
    """0.5 m/s² to 2 m/s, up 20 degrees, and back to rest."""
    angle, acceleration, speed = radians(20.0), 0.5, 2.0
    simulation = slope(angle, 20.0, drive={"mode": "speed", "limits": {"acceleration": acceleration}})
    simulation.command("car", speed=speed)
    weight = MASS * GRAVITY * sin(angle)
    for time in (1.0, 4.0, 7.0):
        ramp = min(time, speed / acceleration)
        car = simulation.advance_to(time).carriages["car"]
        way = 0.5 * acceleration * ramp**2 + speed * (time - ramp)
        yield Result(f"way after {time:g} s", "m", way, car.arc_length - 20.0, 1e-9)
        force = weight + (MASS * acceleration * (1.0 + STRAIN) if time <= ramp else 0.0)
        yield Result(f"drive force after {time:g} s", "N", force, car.drive_force, 0.01)
    simulation.command("car", speed=-speed)
    at = simulation.snapshot.carriages["car"].arc_length
    car = simulation.advance_to(7.0 + 2.0 * speed / acceleration).carriages["car"]
    yield Result("way of a reversal", "m", 0.0, car.arc_length - at, 1e-9)
    yield Result("speed after it", "m/s", -speed, car.speed, 1e-12)


@case("driven joint, jerk limit", "a/j + v/a, or 2 √(v/j)", needs_jit=True, long=True)
def jerk_limited() -> Iterator[Result]:
    """To 2 m/s at 0.5 m/s² with jerk limits that do and do not let it reach that acceleration."""
    acceleration, speed, step = 0.5, 2.0, 1e-3
    for jerk in (0.1, 0.25, 2.0):
        limits = {"acceleration": acceleration, "jerk": jerk}
        simulation = slope(radians(20.0), 20.0, drive={"mode": "speed", "limits": limits}, step=step)
        simulation.command("car", speed=speed)
        speeds = [simulation.advance_to(step * k).carriages["car"].speed for k in range(10_000)]
        rates = np.diff(speeds) / step
        reached = step * int(np.argmax(np.array(speeds) >= speed - 1e-9))
        full = acceleration**2 / jerk <= speed
        duration = speed / acceleration + acceleration / jerk if full else 2.0 * np.sqrt(speed / jerk)
        peak = acceleration if full else np.sqrt(speed * jerk)
        label = f"jerk limit {jerk:g} m/s³"
        yield Result(f"time to speed, {label}", "s", float(duration), reached, step)
        yield Result(f"highest acceleration, {label}", "m/s²", float(peak), float(rates.max()), 1e-3)
        highest = float(np.abs(np.diff(rates)).max() / step)
        yield Result(f"highest jerk, {label}", "m/s³", jerk, highest, 1e-6)
        yield Result(f"highest speed, {label}", "m/s", speed, max(speeds), 1e-12)


@case("driven joint at the end of its track", "v²/2a", needs_jit=True)
def driven_to_the_end() -> Iterator[Result]:
    """Drive reference ending before the end stop; an emergency stop over v²/2a."""
    limits = {"acceleration": 0.5, "emergency_deceleration": 2.0}
    simulation = slope(
        radians(20.0), 80.0, drive={"mode": "speed", "limits": limits}, end_stop={"stroke": 0.5}, step=2e-3
    )
    simulation.command("car", speed=3.0)
    farthest = max(simulation.advance_to(0.01 * frame).carriages["car"].arc_length for frame in range(2000))
    car = simulation.snapshot.carriages["car"]
    yield Result("resting place", "m", LENGTH - 0.5, car.arc_length, 1e-6)
    yield Result("farthest place", "m", LENGTH - 0.5, farthest, 1e-6)
    yield Result("speed there", "m/s", 0.0, car.speed, 1e-9)
    simulation.command("car", speed=-3.0)
    car = simulation.advance_to(30.0).carriages["car"]
    yield Result("speed on the way back", "m/s", -3.0, car.speed, 1e-12)
    at = car.arc_length
    simulation.emergency_stop()
    car = simulation.advance_to(32.0).carriages["car"]
    yield Result("way of an emergency stop", "m", 3.0**2 / (2.0 * 2.0), at - car.arc_length, 1e-9)
    yield Result("speed after it", "m/s", 0.0, car.speed, 0.0)


@case("force along the cable", "a = F/m - g sin", needs_jit=True)
def driven_by_force() -> Iterator[Result]:
    """Given force, and a drive with less force than its acceleration needs."""
    angle = radians(20.0)
    weight = MASS * GRAVITY * sin(angle)
    simulation = slope(angle, 20.0, drive={"mode": "force"})
    simulation.command("car", force=60.0)
    yield Result("acceleration, 60 N", "m/s²", (60.0 - weight) / MASS, gained_speed(simulation, 0.5, 1.5), 1e-3)
    limits = {"acceleration": 0.5, "force": 36.0}
    simulation = slope(angle, 20.0, drive={"mode": "speed", "limits": limits})
    simulation.command("car", speed=1.0)
    got = gained_speed(simulation, 0.5, 1.5)
    yield Result("acceleration at the force limit", "m/s²", (36.0 - weight) / MASS, got, 1e-3)
    forces, speeds = [], []
    for frame in range(151, 800):
        car = simulation.advance_to(0.01 * frame).carriages["car"]
        forces.append(car.drive_force)
        speeds.append(car.speed)
    yield Result("highest force", "N", 36.0, max(forces), 1e-5)
    yield Result("highest speed", "m/s", 1.0, max(speeds), 1e-9)
    yield Result("speed in the end", "m/s", 1.0, speeds[-1], 1e-9)
    yield Result("force in the end", "N", weight, forces[-1], 0.01)
    saturated = np.array(forces) > 36.0 - 1e-5
    yield Result("times that it leaves its limit", "-", 1.0, float(np.abs(np.diff(saturated.astype(int))).sum()), 0.0)


@case("end stop", "a buffer gives back no energy", needs_jit=True)
def end_stop() -> Iterator[Result]:
    """Free carriage running down 20 m into the end stop, and its decreasing rebounds."""
    angle = radians(20.0)
    simulation = slope(angle, 20.0, end_stop={"stroke": 1.0})
    start = simulation.energy()
    places, free_energies = [], [start.total]
    for frame in range(1, 3001):
        car = simulation.advance_to(0.01 * frame).carriages["car"]
        places.append(car.arc_length)
        if car.arc_length > 1.0:  # what the buffer holds is in no energy
            free_energies.append(simulation.energy().total)
    swing = MASS * GRAVITY * 20.0 * sin(angle)
    gain = max(float(np.diff(free_energies).max()), 0.0)
    yield Result("largest gain in 10 ms or a contact, share of the fall", "-", 0.0, gain / swing, 2e-5)
    yield Result("beyond the end of the cable", "m", 0.0, max(-min(places), 0.0), 0.0)
    tops = [b for a, b, c in zip(places, places[1:], places[2:], strict=False) if a < b > c]
    yield Result("contacts after which it comes back less far", "-", 1.0, float(np.mean(np.diff([20.0, *tops]) < 0)), 0)
