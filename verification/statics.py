"""Cases at rest: catenaries, cantilevers, elastica."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.optimize import brentq

from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation
from verification import Result, case

LEVEL_SPAN = {
    "description": "level span",
    "cable": {
        "unstrained_length": 101.0,
        "mass_per_length": 10.0,
        "axial_stiffness": 2e7,
        "bending_stiffness": 1.0,
        "elements": 64,
        "start": {"position": [0.0, 0.0], "support": "pinned"},
        "end": {"position": [100.0, 0.0], "support": "pinned"},
    },
    "carriages": {},
    "solver": {},
}


@case("elastic catenary, level", "Irvine 1981")
def level_catenary() -> Iterator[Result]:
    """Both ends at one height."""
    weight, length, stiffness, span = 98.1, 101.0, 2e7, 100.0

    def width(horizontal: float) -> float:
        half = 0.5 * weight * length
        return horizontal * length / stiffness + 2.0 * horizontal / weight * np.arcsinh(half / horizontal)

    horizontal = brentq(lambda h: width(h) - span, 1e3, 1e6, xtol=1e-9)
    tension = np.hypot(horizontal, 0.5 * weight * length)
    sag = weight * length**2 / (8.0 * stiffness) + (tension - horizontal) / weight
    simulation = Simulation(load_scenario(LEVEL_SPAN))
    start = simulation.snapshot.supports["start"].force
    yield Result("horizontal tension", "N", horizontal, -start[0], 1.0)
    yield Result("end tension", "N", tension, float(np.hypot(*start)), 1.0)
    yield Result("sag", "m", sag, -simulation.cable_positions(np.array([length / 2.0]))[0, 1], 1e-4)
    arc_lengths = np.linspace(0.0, length, 41)
    exact = np.hypot(horizontal, weight * (arc_lengths - length / 2.0))
    worst = float(np.abs(simulation.cable_tension(arc_lengths) / exact - 1.0).max())
    yield Result("tension readout, worst of 41 points", "-", 0.0, worst, 2e-4)
