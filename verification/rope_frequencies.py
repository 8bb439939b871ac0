"""Cases of small motions about equilibrium: cables, strings, beams."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation
from verification import Result, case
from verification.statics import CANTILEVER, LEVEL_SPAN

Array = NDArray[np.float64]


def irvine_frequencies(ratio: float, string: float, count: int) -> Array:
    """Lowest in-plane frequencies (count,) in Hz of a flat parabolic cable (Irvine, Caughey 1974).

    Args:
        ratio: λ² = (w l / H)² l EA / (H L_e).
        string: π / l sqrt(H / m) / (2 π), the first frequency of the taut string, Hz.
        count: how many.
    """
    symmetric = []
    for k in range(count):
        # one root on each branch of tan(w / 2), the first between 0 and 3 π
        low, high = (2 * k + 1) * np.pi, (2 * k + 3) * np.pi

        def miss(w: float) -> float:
            half = 0.5 * w
            return np.sin(half) - np.cos(half) * (half - 4.0 / ratio * half**3)

        if k == 0 and miss(low) * miss(1e-2) < 0.0:
            symmetric.append(brentq(miss, 1e-2, low))
        symmetric.append(brentq(miss, low + 1e-9, high - 1e-9))
    return np.sort(np.concatenate([np.array(symmetric) / np.pi, 2.0 * np.arange(1, count + 1)]))[:count] * string


SPAN, WEIGHT, LEVEL = 100.0, 98.1, 1e5  # m, N/m, N: of the flat cable
RATIOS = 5.0, 40.0, 200.0  # λ²: below, near and above the crossover of 4 π²
STRING = np.sqrt(LEVEL / 10.0) / (2.0 * SPAN)  # Hz


def flat_cable(ratio: float) -> dict[str, float]:
    """Changes of a level span that give it λ² and the level tension, with a sag of 1/82 of the span."""
    pull = WEIGHT * SPAN / LEVEL
    stiffness = ratio * LEVEL * SPAN * (1.0 + pull**2 / 8.0) / (pull**2 * SPAN)

    def width(length: float) -> float:
        half = 0.5 * WEIGHT * length
        return LEVEL * length / stiffness + 2.0 * LEVEL / WEIGHT * np.arcsinh(half / LEVEL) - SPAN

    return {
        "cable.unstrained_length": brentq(width, 50.0, 150.0, xtol=1e-12),
        "cable.axial_stiffness": stiffness,
        "cable.elements": 48,
    }


@case("in-plane frequencies of a flat cable", "Irvine, Caughey 1974")
def cable_frequencies() -> Iterator[Result]:
    """At three λ²."""
    for ratio in RATIOS:
        simulation = Simulation(load_scenario(LEVEL_SPAN, flat_cable(ratio)))
        exact = irvine_frequencies(ratio, STRING, 5)
        for number, (expected, got) in enumerate(zip(exact, simulation.natural_frequencies(5), strict=True), 1):
            yield Result(f"λ² = {ratio:g}, frequency {number}", "Hz", expected, float(got), 0.01 * expected)


@case("frequencies and shapes of a taut string", "closed form")
def string_frequencies() -> Iterator[Result]:
    """Without weight and bending: transverse n π / L sqrt(T / ((1 + ε) m)), shape sin(n π x / L)."""
    length, strain, stiffness = 100.0, 0.01, 2e7
    changes = {
        "gravity": 0.0,
        "cable.unstrained_length": length,
        "cable.bending_stiffness": 0.0,
        "cable.end.position": [length * (1.0 + strain), 0.0],
        "cable.elements": 32,
    }
    simulation = Simulation(load_scenario(LEVEL_SPAN, changes))
    frequencies = simulation.natural_frequencies(10)
    arc_lengths = np.linspace(0.0, length, 51)
    shapes = simulation.mode_shapes(3, arc_lengths)
    for number in (1, 2, 3):
        exact = number / (2.0 * length) * np.sqrt(stiffness * strain / ((1.0 + strain) * 10.0))
        yield Result(f"transverse frequency {number}", "Hz", exact, float(frequencies[number - 1]), 1e-6 * exact)
        sine = np.sin(number * np.pi * arc_lengths / length)
        got = shapes[number - 1, :, 2]
        sign = np.sign(got @ sine)
        worst = max(np.abs(sign * got - sine).max(), np.abs(shapes[number - 1, :, 0]).max())
        yield Result(f"shape {number}, worst of 51 points", "-", 0.0, float(worst), 1e-4)
    # the first mode along the string is the tenth of all: sqrt((1 + ε) / ε) = 10.05
    along = 1.0 / (2.0 * length) * np.sqrt(stiffness / 10.0)
    across = 10.0 / (2.0 * length) * np.sqrt(stiffness * strain / ((1.0 + strain) * 10.0))
    yield Result("transverse frequency 10", "Hz", across, float(frequencies[9]), 1e-4 * across)
    yield Result("longitudinal frequency 1", "Hz", along, float(simulation.natural_frequencies(11)[10]), 1e-4 * along)


@case("frequencies of beams", "Euler, Bernoulli")
def beam_frequencies() -> Iterator[Result]:
    """Unstrained and straight: ω = k² sqrt(EI / m), with k L the roots of each kind of support's equation."""
    free = {"position": [1.0, 0.0], "support": "free"}
    clamped = {"position": [0.0, 0.0], "support": "clamped", "direction": [1.0, 0.0]}
    pinned = {"position": [1.0, 0.0], "support": "pinned"}
    roots = {
        "pinned, pinned": [np.pi, 2.0 * np.pi, 3.0 * np.pi],
        "clamped, free": [brentq(lambda k: np.cos(k) * np.cosh(k) + 1.0, a, a + 2.0) for a in (1.0, 4.0, 7.0)],
        "clamped, pinned": [brentq(lambda k: np.tan(k) - np.tanh(k), a, a + 0.5) for a in (3.8, 7.0, 10.1)],
        "free, free": [brentq(lambda k: np.cos(k) * np.cosh(k) - 1.0, a, a + 2.0) for a in (4.0, 7.0, 10.0)],
    }
    ends = {
        "pinned, pinned": ({**pinned, "position": [0.0, 0.0]}, pinned),
        "clamped, free": (clamped, free),
        "clamped, pinned": (clamped, pinned),
        "free, free": ({**free, "position": [0.0, 0.0]}, free),
    }
    for supports, values in roots.items():
        start, end = ends[supports]
        changes = {"cable.start": start, "cable.end": end, "cable.initial_shape": "straight"}
        simulation = Simulation(load_scenario(CANTILEVER, changes))
        rigid = 3 if supports == "free, free" else 0
        frequencies = simulation.natural_frequencies(rigid + 3)
        if rigid:
            yield Result("free, free, rigid modes", "Hz", 0.0, float(frequencies[:rigid].max()), 1e-2)
        for number, (root_, got) in enumerate(zip(values, frequencies[rigid:], strict=True), 1):
            exact = root_**2 / (2.0 * np.pi)
            yield Result(f"{supports}, frequency {number}", "Hz", exact, float(got), 1e-5 * exact)
