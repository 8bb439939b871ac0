"""Cases of counterweights: tension, travel and oscillation."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from scipy.optimize import brentq

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


def weighted_bar(push: float, mass: float = 40.0, **solver: Any) -> tuple[Simulation, float, float]:
    """A straight rope without weight, its counterweight moved by `push` (m) and held till then; length, at rest (m)."""
    length, axial, pull = 50.0, 5e5, 1000.0
    simulation = Simulation(
        load_scenario(
            {
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
        )
    )
    stretched = length * (1.0 + pull / axial)
    with changing(simulation) as state:
        state.nodes.position[:, 0, 0] += push * np.linspace(0.0, 1.0, 25)
        state.nodes.position[:, 1, 0] += push / length
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
