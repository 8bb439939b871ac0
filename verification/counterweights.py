"""Cases of counterweights: tension, travel and oscillation."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from scipy.optimize import brentq

from cable_twin.mechanics.parameters import ELASTIC_MODELS
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation
from verification import Result, case
from verification.models import GRAVITY, changing, start_moving
from verification.supports import tramway


@case("counterweight at rest", "end tension = its force; Hooke")
def counterweight_tension() -> Iterator[Result]:
    """Along its line the end of the tramway bears its weight, whatever hangs on the rope; a straight rope stretches."""
    pull = 80e3 * GRAVITY
    direction = np.array([0.99, 0.12]) / np.hypot(0.99, 0.12)
    for place in (200.0, 750.0):
        simulation = tramway(cabin={"arc_length": place, "joint": "fixed"})
        got = float(simulation.snapshot.supports["end"].force[[0, 2]] @ direction)
        yield Result(f"tension along its line, cabin at {place:g} m", "N", pull, got, 1e-6 * pull)
    simulation, length, stretched = weighted_bar(0.0)
    yield Result(
        "travel of a straight rope", "m", stretched - length, simulation.snapshot.supports["end"].travel or 0.0, 1e-9
    )


@case("rope at another temperature", "θ kelvin more: EA alpha θ less in a taut span, alpha θ L more travel")
def temperature() -> Iterator[Result]:
    """A rope between fixed ends is tensioned or relieved, one with a counterweight gets longer at its tension."""
    expansion, length, axial, pull = 12e-6, 50.0, 5e5, 1000.0
    for model in ELASTIC_MODELS:
        for kelvin in (30.0, -50.0):
            scenario = bar(length, axial, pull)
            scenario["air"] = {"temperature": 20.0 + kelvin}
            scenario["cable"]["elastic_model"] = model
            travel = Simulation(load_scenario(scenario)).snapshot.supports["end"].travel or 0.0
            expected = length * (pull / axial + expansion * kelvin)
            yield Result(f"travel at {kelvin:+g} K, {model}", "m", expected, travel, 1e-9)
            scenario["cable"]["end"] = {"position": [length * (1.0 + pull / axial), 0.0], "support": "pinned"}
            tensions = Simulation(load_scenario(scenario)).snapshot.cable.tensions
            expected = pull - axial * expansion * kelvin
            yield Result(f"tension of a taut span at {kelvin:+g} K, {model}", "N", expected, float(tensions[100]), 1e-6)


@case("rope that cools", "as at rest at the last temperature: EA alpha θ in a taut span, alpha θ L of travel")
def cooling() -> Iterator[Result]:
    """A damped rope is cooled from 30 K above to 50 K below in steps of 1 K every 0.05 s, and left alone for 5 s."""
    expansion, length, axial, pull = 12e-6, 50.0, 5e5, 1000.0
    for space, model in ((2, "continuum"), (3, "continuum"), (2, "element_frame")):
        scenario = bar(length, axial, pull)
        scenario |= {"space": space, "air": {"temperature": 50.0}}
        cable = scenario["cable"] | {"elastic_model": model, "damping_time": 0.05}
        start, end = ([0.0] * space, [length] + [0.0] * (space - 1))
        along = [1.0] + [0.0] * (space - 1)
        weighted = cable | {"start": {"position": start}, "end": cable["end"] | {"position": end, "direction": along}}
        snapshot = _cooled(scenario | {"cable": weighted}).snapshot
        expected, travel = length * (pull / axial - expansion * 50.0), snapshot.supports["end"].travel or 0.0
        yield Result(f"travel, {model}, {space} dimensions", "m", expected, travel, 1e-8)
        end = [length * (1.0 + pull / axial)] + [0.0] * (space - 1)
        taut = cable | {"start": {"position": start}, "end": {"position": end, "support": "pinned"}}
        tensions = _cooled(scenario | {"cable": taut}).snapshot.cable.tensions
        expected = pull + axial * expansion * 50.0
        yield Result(f"tension of a taut span, {model}, {space} dimensions", "N", expected, float(tensions[100]), 1e-6)


def _cooled(scenario: dict[str, Any]) -> Simulation:
    """Simulation of a rope after it has cooled to 50 K below its reference temperature."""
    simulation = Simulation(load_scenario(scenario))
    for step, degrees in enumerate(range(49, -31, -1)):
        simulation.advance_to(0.05 * step)
        simulation.temperature(degrees)
    simulation.advance_to(simulation.time + 5.0)
    return simulation


@case("sag at another temperature", "elastic catenary of the length L (1 + alpha θ) and the weight of L")
def sag_at_temperature() -> Iterator[Result]:
    """Under the weight of the rope as well: a warm rope sags as one of that length, with as much mass and stiffness."""
    expansion, kelvin, length, mass, axial = 12e-6, 40.0, 203.0, 2.0, 2e7
    stretch = 1.0 + expansion * kelvin
    for space in (2, 3):
        heights = []
        for own in (
            {"unstrained_length": length, "mass_per_length": mass, "axial_stiffness": axial},
            {
                "unstrained_length": length * stretch,
                "mass_per_length": mass / stretch,
                "axial_stiffness": axial * stretch,
            },
        ):
            ends = ([0.0, 0.0], [200.0, 20.0]) if space == 2 else ([0.0, 0.0, 0.0], [200.0, 0.0, 20.0])
            start, end = ({"position": place, "support": "pinned"} for place in ends)
            cable = {**own, "bending_stiffness": 0.0, "elements": 40, "start": start, "end": end}
            warm = own["unstrained_length"] == length
            air = {"temperature": 20.0 + (kelvin if warm else 0.0)}
            simulation = Simulation(load_scenario({"gravity": GRAVITY, "space": space, "cable": cable, "air": air}))
            middle = simulation.cable_positions(np.array([0.5 * own["unstrained_length"]]))[0, 2]
            heights.append(float(middle))
        yield Result(f"height of the middle, {space} dimensions", "m", heights[1], heights[0], 1e-6)


def bar(length: float, axial: float, pull: float, mass: float = 40.0, **solver: Any) -> dict[str, Any]:
    """Scenario of a straight rope (m) without weight, of a stiffness (N), and a counterweight with a pull (N)."""
    return {
        "gravity": 0.0,
        "cable": {
            "unstrained_length": length,
            "mass_per_length": 0.6,
            "axial_stiffness": axial,
            "bending_stiffness": 1.0,
            "elements": 24,
            "start": {"position": [0.0, 0.0]},
            "end": {
                "position": [length, 0.0],
                "support": "counterweight",
                "direction": [1.0, 0.0],
                "mass": mass,
                "force": pull,
            },
        },
        "solver": solver,
    }


def weighted_bar(push: float, mass: float = 40.0, **solver: Any) -> tuple[Simulation, float, float]:
    """A straight rope without weight, its counterweight moved by `push` (m) and held till then; length, at rest (m)."""
    length, axial, pull = 50.0, 5e5, 1000.0
    simulation = Simulation(load_scenario(bar(length, axial, pull, mass, **solver)))
    stretched = length * (1.0 + pull / axial)
    with changing(simulation) as state:
        state.nodes.position[:, 0, 0] += push * np.linspace(0.0, 1.0, 25)
        state.nodes.position[:, 1:, 0] += push / length
    return simulation, length, stretched


@case("counterweight on an elastic rope", "bar with an end mass: ω = β c / L, β tan β = m_rope / m", needs_jit=True)
def counterweight_oscillation() -> Iterator[Result]:
    """First axial mode of a straight rope with a mass at its end: from the modes, and let go."""
    length, axial, mass_per_length = 50.0, 5e5, 0.6
    for mass in (40.0, 2000.0):
        ratio = mass_per_length * length / mass
        beta = brentq(lambda b, ratio=ratio: b * np.tan(b) - ratio, 1e-9, 0.5 * np.pi - 1e-9)
        frequency = beta / length * np.sqrt(axial / mass_per_length) / (2.0 * np.pi)
        simulation, _, _ = weighted_bar(0.0, mass)
        modes = simulation.natural_frequencies(24)
        nearest = float(modes[np.abs(modes - frequency).argmin()])
        yield Result(f"natural frequency, {mass:g} kg", "Hz", frequency, nearest, 1e-4 * frequency)
        period = 1.0 / frequency
        simulation, _, stretched = weighted_bar(0.01, mass, step=period / 400.0, spectral_radius=0.9)
        start_moving(simulation)
        times, travels = [], []
        for step in range(4 * 400 + 1):
            snapshot = simulation.advance_to(step * simulation.step)
            times.append(snapshot.time)
            travels.append((snapshot.supports["end"].travel or 0.0) - (stretched - length))
        time, travel = np.array(times), np.array(travels)
        phase = np.exp(-2j * np.pi * frequency * time)
        half = time.size // 2
        # how far the phase of the first mode moves from the first half to the second
        first, second = (travel * phase)[:half].sum(), (travel * phase)[half : 2 * half].sum()
        got = frequency + float(np.angle(second / first)) / (2.0 * np.pi * time[half])
        yield Result(f"frequency of the motion, {mass:g} kg", "Hz", frequency, got, 1e-3 * frequency)
