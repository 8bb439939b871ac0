"""Cases of a tramway's drive: haul rope, brakes, limits, on a taut light rope that is straight to 0.1 mm."""

from __future__ import annotations

from collections.abc import Iterator
from math import atan, degrees, log, pi, radians, sin, sqrt
from typing import Any

import numpy as np
from scipy.linalg import eigh

from cable_twin.simulation import Simulation
from verification import Result, case
from verification.drives import LENGTH, MASS, STRAIN, slope
from verification.models import GRAVITY

MOVING = MASS * (1.0 + STRAIN) ** 2  # kg, of the carriage by its arc length
ROPE = {"axial_stiffness": 20e3, "mass_per_length": 0.06, "damping_ratio": 0.0, "drive_inertia": 25.0}


def tramway(
    drive: dict[str, Any], *, start: float = 40.0, angle: float = 0.0, arm: float = 0.0, **more: Any
) -> Simulation:
    """One carriage at arc length `start` (m), its centre `arm` (m) below the rope, on a slope of `angle` (rad)."""
    return slope(angle, start, drive=drive, body={"inertia": 1e-3, "upper_pivot": [0.0, arm]}, **more)


def hauled(rope: dict[str, Any] | None = None, **drive: Any) -> dict[str, Any]:
    """Drive section with a haul rope in a loop, which can push as well."""
    return {"mode": "speed", "haul_rope": {**ROPE, "pretension": 1e5, **(rope or {})}, **drive}


def stretches(simulation: Simulation, start: float, end: float, frame: float = 0.01) -> tuple[np.ndarray, np.ndarray]:
    """Times (s) and distance (m) of the carriage ahead of the place given by its drum."""
    times = np.arange(start, end, frame)
    cars = [simulation.advance_to(float(time)).carriages["car"] for time in times]
    return times, np.array([car.arc_length - car.haul_rope.travel for car in cars if car.haul_rope])


def frequency(times: np.ndarray, values: np.ndarray) -> float:
    """Frequency (Hz) from the first to the last upward crossing of zero."""
    up = np.flatnonzero((values[:-1] < 0.0) & (values[1:] >= 0.0))
    crossings = times[up] - values[up] * (times[up + 1] - times[up]) / (values[up + 1] - values[up])
    return (up.size - 1) / float(crossings[-1] - crossings[0])


@case("bounce in the haul rope after a sudden stop", "ω² = k/(m + m_rope/3)", needs_jit=True, long=True)
def bounce() -> Iterator[Result]:
    """The sheave stops within 2 % of a period; both stations; damped and not."""
    for station, start in (("end", 40.0), ("start", 60.0)):
        drive = hauled({"station": station}, limits={"acceleration": 0.5, "jerk": 0.02, "emergency_deceleration": 60.0})
        simulation = tramway(drive, start=start)
        simulation.command("car", speed=1.0)
        simulation.advance_to(20.0)
        simulation.emergency_stop()
        begun = simulation.time
        times, ahead = stretches(simulation, begun + 0.05, begun + 12.0)
        car = simulation.snapshot.carriages["car"]
        assert car.haul_rope is not None
        length = 10.0 + (LENGTH - car.haul_rope.travel if station == "end" else car.haul_rope.travel)
        stiffness = ROPE["axial_stiffness"] / length
        omega = sqrt(stiffness / (MOVING + ROPE["mass_per_length"] * length / 3.0))
        label = f"drive at the {station}"
        yield Result(f"frequency, {label}", "Hz", omega / (2.0 * pi), frequency(times, ahead), 1e-3 * omega / 6.0)
        # the rope's mass at the sheave stops with it, so the speed at which the free mode begins is a little higher
        share = (MOVING + ROPE["mass_per_length"] * length / 2.0) / (MOVING + ROPE["mass_per_length"] * length / 3.0)
        yield Result(f"amplitude, {label}", "m", share / omega, float(np.abs(ahead).max()), 0.01 / omega)
    for ratio in (0.02, 0.1):
        drive = hauled(
            {"damping_ratio": ratio}, limits={"acceleration": 0.5, "jerk": 0.02, "emergency_deceleration": 60.0}
        )
        simulation = tramway(drive)
        simulation.command("car", speed=1.0)
        simulation.advance_to(20.0)
        simulation.emergency_stop()
        _, ahead = stretches(simulation, 20.05, 28.0, 1e-3)
        peaks = [b for a, b, c in zip(ahead, ahead[1:], ahead[2:], strict=False) if a < b > c]
        decrement = log(peaks[0] / peaks[2]) / 2.0
        got = decrement / sqrt(4.0 * pi**2 + decrement**2)
        yield Result(f"damping ratio of {ratio:g}", "-", ratio, got, 0.01 * ratio)


@case("carriage and drive on one haul rope", "rod of two nodes between two masses", needs_jit=True)
def free_sheave() -> Iterator[Result]:
    """A push of the drive lets both swing against each other; momentum and energy stay afterwards."""
    simulation = tramway(hauled(mode="force"))
    simulation.command("car", force=5.0)
    simulation.advance_to(0.2)
    simulation.command("car", force=0.0)
    start, times = simulation.energy().total, np.arange(0.2, 6.0, 0.005)
    ahead, energies, momenta = [], [], []
    length = 10.0 + LENGTH - 40.0
    rope = ROPE["mass_per_length"] * length
    for time in times:
        car = simulation.advance_to(float(time)).carriages["car"]
        assert car.haul_rope is not None
        ahead.append(car.arc_length - car.haul_rope.travel)
        energies.append(simulation.energy().total)
        momenta.append((MOVING + rope / 2.0) * car.speed + (ROPE["drive_inertia"] + rope / 2.0) * car.haul_rope.speed)
    stiffness = ROPE["axial_stiffness"] / length * np.array([[1.0, -1.0], [-1.0, 1.0]])
    masses = np.array([[MOVING + rope / 3.0, rope / 6.0], [rope / 6.0, ROPE["drive_inertia"] + rope / 3.0]])
    expected = sqrt(eigh(stiffness, masses, eigvals_only=True)[1]) / (2.0 * pi)
    centred = np.array(ahead) - np.mean([np.max(ahead), np.min(ahead)])
    yield Result("frequency", "Hz", expected, frequency(times, centred), 4e-3 * expected)
    yield Result("momentum", "N s", 1.0, float(np.mean(momenta)), 5e-3)
    yield Result("energy at the end by that at the start", "-", 1.0, energies[-1] / start if start else 0.0, 5e-3)


@case("brake on the drive sheave", "∫ of its force over the mass of all that moves", needs_jit=True, long=True)
def sheave_brake() -> Iterator[Result]:
    """A stiff haul rope; the force of the brakes rises within their time, both brakes together, then it holds."""
    speed, force, rise = 4.0, 60.0, 0.8
    for used in (("emergency_brake",), ("service_brake", "emergency_brake")):
        drive = hauled(
            {"axial_stiffness": 1e8, "damping_ratio": 0.3},
            emergency_stop=list(used),
            limits={"acceleration": 1.0},
            service_brake={"force": 30.0, "rise_time": rise},
            emergency_brake={"force": force, "rise_time": rise},
        )
        simulation = tramway(drive, start=20.0)
        simulation.command("car", speed=speed)
        simulation.advance_to(6.0)
        at = simulation.snapshot.carriages["car"].arc_length
        simulation.emergency_stop()
        times = 6.0 + np.arange(1, 9000) * 1e-3
        cars = [simulation.advance_to(float(time)).carriages["car"] for time in times]
        middle = 0.5 * (at + cars[-1].arc_length)  # what leaves the rope on the way counts no more
        mass = MOVING + ROPE["drive_inertia"] + ROPE["mass_per_length"] * (10.0 + LENGTH - middle)
        deceleration = sum({"service_brake": 30.0, "emergency_brake": force}[name] for name in used) / mass
        stop = rise / 2.0 + speed / deceleration
        left = stop - rise
        way = speed * rise - deceleration * rise**2 / 6.0 + deceleration * left**2 / 2.0
        still = np.array([abs(car.speed) < 1e-3 for car in cars])
        label = " and ".join(used).replace("_", " ")
        yield Result(f"time, {label}", "s", stop, 1e-3 * float(np.argmax(still)), 0.02)
        yield Result(f"way, {label}", "m", way, cars[-1].arc_length - at, 0.01 * way)
        yield Result(f"speed after it, {label}", "m/s", 0.0, cars[-1].speed, 1e-6)
        yield Result(f"highest force, {label}", "N", deceleration * mass, max(-car.drive_force for car in cars), 1e-6)


@case("track-rope brake", "a = F/m - g sin, holds above m g sin", needs_jit=True)
def track_rope_brake() -> Iterator[Result]:
    """The drive lets go and the brake grips: on the level, on a slope that it holds, and on one that it does not."""
    for force, incline in ((20.0, 0.0), (60.0, 20.0), (25.0, 20.0)):
        drive = {
            "mode": "speed",
            "limits": {"acceleration": 1.0},
            "track_rope_brake": {"force": force},
            "emergency_stop": ["track_rope_brake"],
        }
        simulation = tramway(drive, start=40.0, angle=radians(incline))
        simulation.command("car", speed=2.0)
        before = simulation.advance_to(3.0).carriages["car"]
        simulation.emergency_stop()
        weight = MASS * GRAVITY * sin(radians(incline))
        first, second = (simulation.advance_to(time).carriages["car"].speed for time in (3.05, 3.15))
        got = (first - second) / 0.1 * (1.0 + STRAIN)
        label = f"{force:g} N on {incline:g} degrees"
        yield Result(f"deceleration, {label}", "m/s²", (force + weight) / MASS, got, 0.02)
        way = 0.5 * 2.0**2 / ((force + weight) / MASS) / (1.0 + STRAIN)
        cars = [simulation.advance_to(3.15 + 0.005 * k).carriages["car"] for k in range(400)]
        farthest = max(car.arc_length for car in cars)
        yield Result(f"way to rest, {label}", "m", way, farthest - before.arc_length, 0.01 * way)
        end = simulation.advance_to(6.0).carriages["car"].speed
        later = simulation.advance_to(6.5).carriages["car"].speed
        slides = max(weight - force, 0.0) / MASS
        yield Result(f"acceleration in the end, {label}", "m/s²", -slides, (later - end) / 0.5, 0.02)


@case("power and deceleration limits of a drive", "v = √(2 P t/m); v²/2a", needs_jit=True)
def limits() -> Iterator[Result]:
    """Direct drive and haul rope on the level."""
    power = 50.0
    simulation = tramway({"mode": "speed", "limits": {"acceleration": 5.0, "power": power}}, start=10.0)
    simulation.command("car", speed=8.0)
    early, late = (simulation.advance_to(time).carriages["car"] for time in (1.0, 4.0))
    gained = 0.5 * MOVING * (late.speed**2 - early.speed**2)
    yield Result("work in 3 s", "J", 3.0 * power, gained, 0.5)
    yield Result("force times speed", "W", power, late.drive_force * (1.0 + STRAIN) * late.speed, 0.1)
    for drive in ({"mode": "speed"}, hauled({"axial_stiffness": 1e8, "damping_ratio": 0.3})):
        ramps = {"acceleration": 1.0, "deceleration": 0.4, "emergency_deceleration": 1.2}
        simulation = tramway({**drive, "limits": ramps}, start=20.0)
        simulation.command("car", speed=3.0)
        at = simulation.advance_to(5.0).carriages["car"].arc_length
        simulation.command("car", speed=-1.0)
        label = "haul rope" if "haul_rope" in drive else "direct"
        car = simulation.advance_to(5.0 + 3.0 / 0.4 + 1.0 + 1.0).carriages["car"]
        way = 3.0**2 / (2.0 * 0.4) - 1.0**2 / 2.0 - 1.0
        yield Result(f"way of a service stop and a start back, {label}", "m", way, car.arc_length - at, 5e-3)
        simulation.emergency_stop()
        at = car.arc_length
        car = simulation.advance_to(20.0).carriages["car"]
        yield Result(f"way of an emergency stop, {label}", "m", -(1.0**2) / (2.0 * 1.2), car.arc_length - at, 1e-3)


@case("pendulum under constant deceleration of its pivot", "about atan(a/g), up to twice that", needs_jit=True)
def pendulum() -> Iterator[Result]:
    """A deceleration that sets in at once swings the cabin to twice the angle at which it would hang at rest in it."""
    arm = 2.0  # m
    for deceleration in (0.5, 1.5):
        limits = {"acceleration": 0.25, "jerk": 0.02, "emergency_deceleration": deceleration}
        simulation = tramway({"mode": "speed", "limits": limits}, start=2.0, arm=arm)
        simulation.command("car", speed=3.0)
        simulation.advance_to(27.0)
        left = max(abs(pitch(simulation, 30.0 + 0.01 * k)) for k in range(300))
        simulation.emergency_stop()
        begun = simulation.time
        duration = 3.0 / deceleration
        angles = [pitch(simulation, begun + 0.01 * k) for k in range(1, int(100 * duration))]
        still = degrees(atan(deceleration / GRAVITY))
        swing = max(np.abs(angles))
        yield Result(f"swing before, {deceleration:g} m/s²", "deg", 0.0, left, 0.2)
        yield Result(f"highest swing, {deceleration:g} m/s²", "deg", 2.0 * still, swing, 0.2)
        middle = abs(max(angles) + min(angles)) / 2.0
        yield Result(f"middle of the swing, {deceleration:g} m/s²", "deg", still, middle, 0.03 * still)


def pitch(simulation: Simulation, time: float) -> float:
    """Pitch (deg) of the carriage's body at a time (s)."""
    return degrees(simulation.advance_to(time).carriages["car"].bodies["body"].pitch)
