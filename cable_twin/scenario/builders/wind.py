"""Constants of the wind for the mechanics, built from a scenario."""

from __future__ import annotations

import numpy as np

from cable_twin.mechanics import parameters
from cable_twin.mechanics.parameters import STEADY, FloatArray
from cable_twin.scenario.builders.turbulence import make_turbulence
from cable_twin.scenario.builders.vehicles import floats
from cable_twin.scenario.schema import Scenario
from cable_twin.scenario.sections.quantities import in_space

GROUND_STEP = 1.0  # m, at which the terrain is looked up


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
            exponent=air.profile.exponent,
            reference_height=air.profile.reference_height,
            ground=ground,
            ground_start=first,
            ground_step=step,
        )
    if air.turbulence is not None and air.turbulence.intensity > 0.0:
        start, end = (np.array(in_space(end.position)) for end in (scenario.cable.start, scenario.cable.end))
        points = np.linspace(start, end, air.turbulence.points)
        ahead = np.array(in_space(air.wind))
        if not ahead.any():  # across the track where that can be
            ahead = np.array([0.0, 1.0, 0.0] if scenario.dim == 3 else [1.0, 0.0, 0.0])
        table, spacing = make_turbulence(air.turbulence, points, ahead)
        wind = wind._replace(
            intensity=air.turbulence.intensity, turbulence=table, sample_spacing=spacing, points=points
        )
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


__all__ = ["build_wind"]
