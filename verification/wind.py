"""Cases of non-uniform and unsteady wind: height, gusts, turbulence, eddies, drag by the axes of a body."""

from __future__ import annotations

from collections.abc import Iterator
from hashlib import sha256
from itertools import pairwise
from math import atan2, pi
from typing import Any

import numpy as np

from cable_twin.mechanics.on_rope.wind import set_wind, update_wind
from cable_twin.mechanics.parameters import FloatArray
from cable_twin.mechanics.state import allocate_state
from cable_twin.scenario import build_system, load_scenario
from cable_twin.scenario.builders.wind import coherence, components
from cable_twin.scenario.sections.air import Turbulence
from cable_twin.simulation import Simulation
from verification import Result, case
from verification.models import GRAVITY

DENSITY = 1.225  # kg/m^3, of air
SPEED = 15.0  # m/s
MASS = 300.0  # kg
SEED_7 = "b4def92c"  # what the samples of seed 7 begin with, as SHA-256


def line(body: dict[str, Any] | None = None, *, height: float = 40.0, **air: Any) -> dict[str, Any]:
    """A stiff, taut rope of 100 m across which the wind blows, a cabin in its middle, fixed and free to roll."""
    return {
        "cable": {
            "unstrained_length": 99.9,
            "mass_per_length": 2.0,
            "axial_stiffness": 1e9,
            "bending_stiffness": 1.0,
            "elements": 10,
            "start": {"position": [0.0, 0.0, height]},
            "end": {"position": [100.0, 0.0, height]},
        },
        "carriages": {
            "car": {
                "arc_length": 49.95,
                "joint": "fixed",
                "bodies": {"cabin": {"mass": MASS, "inertia": 100.0, "upper_pivot": [0.0, 2.0], **(body or {})}},
            }
        },
        "air": {"wind": [0.0, SPEED, 0.0], **air},
        "solver": {"step": 0.005},
    }


def winds(data: dict[str, Any], places: FloatArray, step: float, count: int) -> FloatArray:
    """Winds (count, places, 3) in m/s at places (places, 3) in m, every `step` (s): nothing there moves."""
    body = data["carriages"]["car"]["bodies"]["cabin"]
    cars = {f"car_{k}": {"arc_length": 1.0 + k, "bodies": {"cabin": body}} for k in range(len(places))}
    scenario = load_scenario(data | {"carriages": cars})
    system = build_system(scenario)
    state = allocate_state(system)
    set_wind(state, np.array(scenario.air.wind))
    state.bodies.position[:, :3] = places
    found = np.empty((count, len(places), 3))
    for number in range(count):
        update_wind(system, state, step)
        found[number] = state.wind_field.at_bodies
    return found


@case("wind and height", "IEC 61400-1: v (h / 10 m)^0.14", needs_jit=True)
def height() -> Iterator[Result]:
    """The wind at three heights over terrain that rises, and the roll of a cabin in it."""
    data = line({"drag_area": 5.0}, profile={"exponent": 0.14}) | {"terrain": [[-10.0, 0.0], [110.0, 12.0]]}
    places = np.array([[50.0, 0.0, z] for z in (16.0, 40.0, 5.0)])
    got = winds(data, places, 0.1, 1)[0, :, 1]
    for place, speed in zip(places[:2], got, strict=False):
        above = place[2] - 6.0
        yield Result(f"{above:g} m above the ground", "m/s", SPEED * (above / 10.0) ** 0.14, float(speed), 1e-12)
    yield Result("below the ground", "m/s", 0.0, float(got[2]), 0.0)
    cabin = Simulation(load_scenario(data)).snapshot.carriages["car"].bodies["cabin"]
    there = SPEED * ((cabin.position[2] - 6.0) / 10.0) ** 0.14
    roll = atan2(0.5 * DENSITY * 5.0 * there**2, MASS * GRAVITY)
    yield Result("roll at rest", "rad", roll, cabin.roll, 1e-6)


@case("gusts", "IEC 61400-1, 6.3.2.2: extreme operating gust; CS-25.341: one minus cosine", needs_jit=True)
def gusts() -> Iterator[Result]:
    """Gust of 10 m/s from the scenario and as a command, equal to each other."""
    times, start, duration = np.arange(1, 1500) * 0.01, 2.0, 10.5
    t = np.clip(times - start, 0.0, duration)
    turn = 2.0 * pi * t / duration
    shapes = {
        "operating_gust": -3.7 * np.sin(1.5 * turn) * (1.0 - np.cos(turn)),
        "one_minus_cosine": 5.0 * (1.0 - np.cos(turn)),
    }
    for shape, expected in shapes.items():
        gust = {"time": start, "amplitude": [0.0, 10.0, 0.0], "duration": duration, "shape": shape}
        got = winds(line({"drag_area": 5.0}, gusts=[gust]), np.zeros((1, 3)), 0.01, times.size)[:, 0, 1] - SPEED
        name = shape.replace("_", " ")
        yield Result(f"{name}: difference, largest", "m/s", 0.0, float(np.abs(got - expected).max()), 1e-9)
        yield Result(f"{name}: highest", "m/s", float(expected.max()), float(got.max()), 1e-9)
    planned = Simulation(load_scenario(line({"drag_area": 5.0}, gusts=[gust])))
    commanded = Simulation(load_scenario(line({"drag_area": 5.0})))
    commanded.advance_to(start)
    commanded.gust(0.0, y=10.0, duration=duration)
    ends = [one.advance_to(8.0).carriages["car"].bodies["cabin"].roll for one in (planned, commanded)]
    yield Result("roll after a commanded gust and a planned one", "rad", ends[0], ends[1], 1e-10)


@case("spectrum of turbulence", "IEC 61400-1, annex B: Kaimal, von Karman; coherence of two points", needs_jit=True)
def turbulence() -> Iterator[Result]:
    """The wind at points along a line in a wind across it, for 73 minutes: bands of the spectrum, variance, slope."""
    step, count = 0.05, 2**16
    for spectrum in ("kaimal", "von_karman"):
        turbulent = {"spectrum": spectrum, "intensity": 0.15, "length_scale": 60.0, "seed": 7, "points": 11}
        data = line({"drag_area": 5.0}, turbulence=turbulent)
        places = np.array([[x, 0.0, 40.0] for x in np.linspace(0.0, 100.0, 11)])
        found = winds(data, places, step, count)
        name, deviation = spectrum.replace("_", " "), 0.15 * SPEED
        yield Result(f"{name}: mean", "m/s", SPEED, float(found[..., 1].mean()), 0.02 * deviation)
        along = found[..., [1, 0, 2]] - np.array([SPEED, 0.0, 0.0])
        spectra = [np.abs(np.fft.rfft(part, axis=0)) ** 2 * 2.0 * step / count for part in np.moveaxis(along, 2, 0)]
        frequencies = np.fft.rfftfreq(count, step)
        wanted = components(Turbulence(**turbulent))
        for part, (label, target) in enumerate(zip(("along", "across", "upwards"), wanted, strict=True)):
            variance = float(along[..., part].var(axis=0).mean())
            every = float(np.trapezoid(target(np.linspace(0.0, 0.7, 200_001)), dx=0.7 / 200_000))
            yield Result(
                f"{name}: variance {label}", "m²/s²", deviation**2 * every, variance, 0.05 * deviation**2 * every
            )
            edges, ratios = np.geomspace(0.02, 2.0, 7), []
            for low, high in pairwise(edges):
                band = (frequencies >= low) & (frequencies < high)
                density = deviation**2 * target(frequencies[band] / SPEED) / SPEED
                ratios.append(float(spectra[part][band].mean() / density.mean()))
            worst = max(ratios, key=lambda ratio: abs(ratio - 1.0))
            yield Result(f"{name}: spectrum {label}, worst band over its own", "-", 1.0, worst, 0.15)
        inertial = (frequencies > 0.5) & (frequencies < 3.0)
        slope = np.polyfit(np.log(frequencies[inertial]), np.log(spectra[0][inertial].mean(axis=1)), 1)[0]
        yield Result(f"{name}: slope along, 0.5 to 3 Hz", "-", -5.0 / 3.0, float(slope), 0.06)
        waves = np.fft.rfft(along[:, :, 0], axis=0)
        band = (frequencies > 0.02) & (frequencies < 0.06)
        cross = np.mean([(waves[band, k] * waves[band, k + 1].conj()).real.mean() for k in range(10)])
        own = np.mean(np.abs(waves[band]) ** 2)
        expected = coherence(Turbulence(**turbulent), frequencies[band] / SPEED, np.array([10.0])).mean()
        yield Result(f"{name}: coherence over 10 m, 0.02 to 0.06 Hz", "-", float(expected), float(cross / own), 0.08)


@case("turbulence between its points", "IEC 61400-1, annex B: spectrum and variance as at the points", needs_jit=True)
def between_points() -> Iterator[Result]:
    """Points 50 m apart, length scale 60 m: a straight line between two has half of the variance in the middle."""
    step, count = 0.05, 2**16
    turbulent = {"intensity": 0.15, "length_scale": 60.0, "seed": 7, "points": 3}
    shares = np.array([0.125, 0.25, 0.375, 0.5])
    places = np.array([[50.0 * share, 0.0, 40.0] for share in (*shares, *(1.0 + shares))])
    found = winds(line({"drag_area": 5.0}, turbulence=turbulent), places, step, count)[..., 1] - SPEED
    density, deviation = components(Turbulence(**turbulent))[0], 0.15 * SPEED
    every = deviation**2 * float(np.trapezoid(density(np.linspace(0.0, 0.7, 200_001)), dx=0.7 / 200_000))
    spectrum = (np.abs(np.fft.rfft(found, axis=0)) ** 2 * 2.0 * step / count).reshape(-1, 2, shares.size)
    variances, frequencies = found.var(axis=0).reshape(2, -1).mean(axis=0), np.fft.rfftfreq(count, step)
    for share, variance, own in zip(shares, variances, np.moveaxis(spectrum, 2, 0), strict=True):
        yield Result(f"variance at {share:g} of the way", "m²/s²", every, float(variance), 0.1 * every)
        ratios = []
        for low, high in pairwise(np.geomspace(0.06, 2.0, 4)):  # where neighbours hardly have anything in common
            band = (frequencies >= low) & (frequencies < high)
            ratios.append(float(own[band].mean() / (deviation**2 * density(frequencies[band] / SPEED) / SPEED).mean()))
        worst = max(ratios, key=lambda ratio: abs(ratio - 1.0))
        yield Result(f"spectrum at {share:g} of the way, worst band over its own", "-", 1.0, worst, 0.1)


@case("bits of turbulence", "the same samples from a seed on every machine; what goes by comes later downwind")
def bits() -> Iterator[Result]:
    """A fingerprint of the samples, and the wind along a line 100 m downwind."""
    turbulent = {"intensity": 0.15, "length_scale": 60.0, "seed": 7, "points": 11}
    table = build_system(load_scenario(line({"drag_area": 5.0}, turbulence=turbulent))).air.wind.turbulence[:11]
    got = sha256(table.tobytes()).hexdigest()[:8]
    yield Result("first bits of the samples of seed 7", "-", float(int(SEED_7, 16)), float(int(got, 16)), 0.0)
    data = line({"drag_area": 5.0}, turbulence=turbulent) | {"air": {"wind": [10.0, 0.0, 0.0], "turbulence": turbulent}}
    found = winds(data, np.array([[0.0, 0.0, 40.0], [100.0, 0.0, 40.0]]), 0.1, 400)
    late = float(np.abs(found[100:, 1] - found[:-100, 0]).max())
    yield Result("wind 100 m downwind, 10 s later: difference", "m/s", 0.0, late, 1e-4)


@case("eddies", "EN 1991-1-4, annex E: St v / b, c A v² times half the density", needs_jit=True)
def eddies() -> Iterator[Result]:
    """Side force on a cabin of 20 t that hardly moves: how often it changes its sign, and how large it becomes."""
    shedding = {"width": 2.0, "area": 5.0, "strouhal": 0.12, "force_coefficient": 1.1}
    heavy = {"mass": 20e3, "inertia": 2e4, "shedding": shedding}
    data = line(heavy)
    data["air"]["wind"] = [0.0, 3.0, 0.0]  # m/s
    simulation = Simulation(load_scenario(data))
    forces = []
    for number in range(1, 10_001):
        simulation.advance_to(0.005 * number)
        forces.append(simulation.state.wind_field.shedding_force[0].copy())
    side = np.array(forces)
    rises = np.flatnonzero((side[1:, 0] > 0.0) & (side[:-1, 0] <= 0.0))
    frequency = (rises.size - 1) / (0.005 * (rises[-1] - rises[0]))
    yield Result("frequency", "Hz", 0.12 * 3.0 / 2.0, float(frequency), 1e-3)
    force = 0.5 * DENSITY * 1.1 * 5.0 * 9.0
    yield Result("largest force", "N", force, float(np.abs(side[:, 0]).max()), 2e-3 * force)
    yield Result("force along the wind", "N", 0.0, float(np.abs(side[:, 1]).max()), 0.01 * force)


@case("drag by axes", "K = A diag(q) Aᵀ: tan of the roll q_y w² / (m g); by components in oblique wind", needs_jit=True)
def by_axes() -> Iterator[Result]:
    """A cabin that is 5 m² from the side and nothing from ahead or below, and a heavy plate in oblique wind."""
    simulation = Simulation(load_scenario(line({"drag_area": [0.0, 5.0, 0.0]})))
    roll = atan2(0.5 * DENSITY * 5.0 * SPEED**2, MASS * GRAVITY)
    yield Result("roll at rest", "rad", roll, simulation.snapshot.carriages["car"].bodies["cabin"].roll, 1e-9)
    alike = Simulation(load_scenario(line({"drag_area": 5.0})))
    three = Simulation(load_scenario(line({"drag_area": [5.0, 5.0, 5.0]})))
    ends = [one.advance_to(2.0).carriages["car"].bodies["cabin"].roll for one in (alike, three)]
    yield Result("one area and three that are alike: roll after 2 s", "rad", ends[0], ends[1], 0.0)
    oblique = line({"drag_area": [1.0, 4.0, 1.0]})
    oblique["air"]["wind"] = [8.0, 6.0, 0.0]
    cabin = Simulation(load_scenario(oblique)).snapshot.carriages["car"]
    drag = 0.5 * DENSITY * 10.0  # the rope holds the heading: each component of the wind has the area of its axis
    yield Result("force along", "N", drag * 1.0 * 8.0, float(-cabin.contact_force[0]), 0.02 * drag * 8.0)
    yield Result("force across", "N", drag * 4.0 * 6.0, float(-cabin.contact_force[1]), 0.02 * drag * 24.0)
