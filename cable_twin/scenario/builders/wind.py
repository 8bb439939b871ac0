"""Constants of the wind for the mechanics, built from a scenario, and turbulence by spectral representation.

With n = k L, k the wave number in 1/m along the wind and L the length scale, a component has the spectrum k S / σ²

    4 n / (1 + 6 n)^(5/3)             Kaimal et al. 1972, as IEC 61400-1 (2005), B.14, has it: across the wind with
                                      L / 3 and 0.8 σ, upwards with 0.66 / 8.1 L and 0.5 σ,
    4 n / (1 + 71 n²)^(5/6)           von Karman 1948, along the wind; across it and upwards, with this L and σ,
    2 n (1 + 71 8/3 n²) / (1 + 71 n²)^(11/6),

and at two points with the distance d across the wind the coherence exp(-12 √((k d)² + (0.12 d / L)²)) of IEC 61400-1,
B.16, which is used for all three components. Spectra and coherence are functions of the wave number: in a mean wind of
speed U, the frequency is f = k U.

The samples are those of Shinozuka and Deodatis (1991, 1996): a sum of cosines with random phases, amplitudes by the
Cholesky factor of the coherence, summed by a fast Fourier transform.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from cable_twin.mechanics import parameters
from cable_twin.mechanics.parameters import STEADY, FloatArray
from cable_twin.scenario.builders import floats, numbers
from cable_twin.scenario.schema import Scenario
from cable_twin.scenario.sections.air import Turbulence
from cable_twin.scenario.sections.quantities import in_space

SAMPLES = 2**14
PER_LENGTH = 128.0  # samples in a length scale, twice as many as the shortest waves
QUANTUM = 2.0**-20  # m/s, to which samples are rounded: cosines of different processors differ by 1e-16
CHUNK = 1024  # wave numbers at a time
KAIMAL = ((1.0, 1.0), (2.7 / 8.1, 0.8), (0.66 / 8.1, 0.5))  # of L and of σ: along the wind, across it, upwards


def kaimal(n: FloatArray) -> FloatArray:
    """Kaimal spectrum in the form S / (σ² L), as a function of n = k L: wave number k times length scale L."""
    return 4.0 / (1.0 + 6.0 * n) ** (5.0 / 3.0)


def von_karman(n: FloatArray) -> FloatArray:
    """Von Karman spectrum along the wind, S / (σ² L), as a function of n = k L: wave number k, length scale L."""
    return 4.0 / (1.0 + 71.0 * n**2) ** (5.0 / 6.0)


def von_karman_across(n: FloatArray) -> FloatArray:
    """Von Karman spectrum across the wind, S / (σ² L), in isotropic turbulence, as a function of n = k L."""
    return 2.0 * (1.0 + 71.0 * 8.0 / 3.0 * n**2) / (1.0 + 71.0 * n**2) ** (11.0 / 6.0)


def components(turbulence: Turbulence) -> list[Callable[[FloatArray], FloatArray]]:
    """Spectra S / σ² (m) by wave number (1/m), along the wind, across, upwards; σ is the deviation along the wind."""
    length = turbulence.length_scale
    shapes = (kaimal,) * 3 if turbulence.spectrum == "kaimal" else (von_karman, von_karman_across, von_karman_across)
    scales = KAIMAL if turbulence.spectrum == "kaimal" else ((1.0, 1.0),) * 3

    def of(shape: Callable[[FloatArray], FloatArray], share: float, deviation: float) -> Callable[..., FloatArray]:
        return lambda k: deviation**2 * share * length * shape(k * share * length)

    return [of(shape, *scale) for shape, scale in zip(shapes, scales, strict=True)]


def coherence(turbulence: Turbulence, k: FloatArray, distance: FloatArray) -> FloatArray:
    """Coherence (wave numbers, ...) of points at a distance (...) in m across the wind."""
    d = distance[None]
    waves = k.reshape(-1, *(1,) * distance.ndim)
    return np.exp(-turbulence.decay * np.sqrt((waves * d) ** 2 + (0.12 * d / turbulence.length_scale) ** 2))


@lru_cache(maxsize=2)  # a scenario is built several times: for its checks, simulations and members of ensembles
def make_turbulence(
    turbulence: Turbulence, start: tuple[float, ...], end: tuple[float, ...], wind: tuple[float, ...]
) -> tuple[FloatArray, FloatArray, float]:
    """Generate turbulence samples at points from a start to an end (3,) in m, in a wind (3,) of given direction.

    Returns:
        Points (points, 3) in m; samples (2 points, SAMPLES, 3) at them for a deviation of 1 m/s along the wind, across
        it and upwards, of which the first follows the last, and of what a straight line to the next point lacks in the
        middle; their spacing in m.
    """
    points = np.linspace(start, end, turbulence.points)
    spacing = turbulence.length_scale / PER_LENGTH
    step = 1.0 / (SAMPLES * spacing)
    k = step * np.arange(1.0, SAMPLES // 2, dtype=np.float64)
    ahead = np.array(wind) / np.linalg.norm(wind)
    apart = points[:, None] - points[None]
    across = np.linalg.norm(apart - (apart @ ahead)[..., None] * ahead, axis=-1)
    generator = np.random.default_rng(turbulence.seed)
    phases = 2.0 * np.pi * generator.random((3, k.size, len(points)))
    waves = np.exp(1j * phases)
    for first in range(0, k.size, CHUNK):
        part = slice(first, first + CHUNK)
        matrix = coherence(turbulence, k[part], across) + 1e-12 * np.eye(
            len(points)
        )  # for points without distance across the wind
        waves[:, part] = np.einsum("kij,ckj->cki", np.linalg.cholesky(matrix), waves[:, part])
    spectra = np.stack([_amplitudes(spectrum, k, step) for spectrum in components(turbulence)])
    waves *= spectra[:, :, None]
    # the mean of two points with the coherence c has the share (1 + c) / 2 of their variance
    alike = coherence(turbulence, k, across[0, min(1, len(points) - 1)].reshape(1))
    lacks = waves * (np.sqrt(2.0 / (1.0 + alike)) - 1.0)
    return points, np.concatenate([_summed(waves), _summed(lacks)]), spacing


def _amplitudes(spectrum: Callable[[FloatArray], FloatArray], k: FloatArray, step: float) -> FloatArray:
    """Amplitudes (wave numbers,) in m/s of the cosines; the first one includes the variance of all longer waves."""
    variance = step * spectrum(k)
    places, weights = np.polynomial.legendre.leggauss(20)
    end = 1.5 * k[0]
    variance[0] = 0.5 * end * float(weights @ spectrum(0.5 * end * (places + 1.0)))
    return np.sqrt(2.0 * variance)


def _summed(waves: NDArray[np.complex128]) -> FloatArray:
    """Samples (points, SAMPLES, 3) of waves (3, wave numbers, points), rounded to be equal on every processor."""
    whole = np.zeros((3, SAMPLES // 2 + 1, waves.shape[2]), dtype=np.complex128)
    whole[:, 1:-1] = 0.5 * SAMPLES * waves
    samples = np.fft.irfft(whole, axis=1).transpose(2, 1, 0)
    return np.ascontiguousarray(np.round(samples / QUANTUM) * QUANTUM)


GROUND_STEP = 1.0  # m, spacing of the ground table


def build_wind(scenario: Scenario) -> parameters.Wind:
    """Build the variation of the wind in space and time; `STEADY` for a steady, uniform wind."""
    air, wind = scenario.air, STEADY
    gusts = [
        (*in_space(gust.amplitude), gust.time, gust.duration, parameters.GUSTS.index(gust.shape)) for gust in air.gusts
    ]
    shedding = _shedding(scenario)
    if gusts or shedding.size:
        wind = wind._replace(gusts=floats(gusts, 6), shedding=shedding)
    if air.profile is not None:
        first, step, ground = _ground(scenario, air.profile.ground)
        wind = wind._replace(
            **numbers(parameters.Wind, air.profile), ground=ground, ground_start=first, ground_step=step
        )
    if air.turbulence is not None and air.turbulence.intensity > 0.0:
        start, end = (in_space(end.position) for end in (scenario.cable.start, scenario.cable.end))
        ahead = in_space(air.wind)
        if not any(ahead):  # in space across the track
            ahead = (0.0, 1.0, 0.0) if scenario.dim == 3 else (1.0, 0.0, 0.0)
        points, table, spacing = make_turbulence(air.turbulence, start, end, ahead)
        copied = numbers(parameters.Wind, air.turbulence)
        wind = wind._replace(**copied, turbulence=table, sample_spacing=spacing, points=points)
    return wind


def _shedding(scenario: Scenario) -> FloatArray:
    """Eddies per metre and side force coefficient (kg/m) of the bodies, (bodies, 2); (0, 2) without vortex shedding."""
    rows = []
    for vehicle in scenario.vehicles.values():
        for body in vehicle.bodies.values():
            eddies, density = body.shedding, scenario.air.density
            rows.append(
                (0.0, 0.0)
                if eddies is None
                else (eddies.strouhal / eddies.width, 0.5 * density * eddies.force_coefficient * eddies.area)
            )
    table = floats(rows, 2)
    return table if table.any() else np.zeros((0, 2))


def _ground(scenario: Scenario, level: float) -> tuple[float, float, FloatArray]:
    """First x (m), step (m) and heights (n,) in m of the ground."""
    if not scenario.terrain:
        return 0.0, 1.0, np.array([level])
    terrain = np.array(scenario.terrain)
    count = max(int(np.ceil(np.ptp(terrain[:, 0]) / GROUND_STEP)), 1) + 1
    x, step = np.linspace(terrain[0, 0], terrain[-1, 0], count, retstep=True)
    return float(x[0]), float(step), np.interp(x, terrain[:, 0], terrain[:, 1])
