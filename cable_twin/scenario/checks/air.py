"""Consistency checks of wind, gusts and vortex shedding."""

from __future__ import annotations

from collections.abc import Iterator
from math import hypot

from cable_twin.mechanics.parameters import STRONGEST_WIND
from cable_twin.scenario.checks.fault import Fault, KeyPath, Phrase, refuse
from cable_twin.scenario.schema import Scenario
from cable_twin.scenario.sections.quantities import in_space
from cable_twin.scenario.sections.vehicles import Body


def wind_faults(scenario: Scenario) -> Iterator[Fault]:
    """Errors in a scenario's wind and gusts: too strong, without effect on anything, or vectors of wrong dimension."""
    air, unfelt = scenario.air, wind_unfelt(scenario)
    yield from _speed(("air", "wind"), air.wind)
    if unfelt and any(air.wind):
        yield refuse(("air", "wind"), air.wind, "0 m/s", unfelt)
    if unfelt and air.gusts:
        yield refuse(("air", "gusts"), Phrase(f"{len(air.gusts)} gusts"), "none", unfelt)
    for number, gust in enumerate(air.gusts):
        path: KeyPath = ("air", "gusts", number, "amplitude")
        if len(gust.amplitude) > scenario.dim:
            yield refuse(path, gust.amplitude, "x, z in m/s", "three numbers in a plane")
        else:
            yield from _speed(path, gust.amplitude)
    if scenario.dim == 2:
        for path, body in _bodies(scenario):
            if body.shedding is not None:
                why = "in a plane, to which its force is perpendicular"
                yield refuse((*path, "shedding"), body.shedding, "null; only in a scenario with `space: 3`", why)


def wind_unfelt(scenario: Scenario) -> str:
    """Reason why wind has no effect in a scenario; empty if it acts on a rope or a body."""
    if scenario.air.density <= 0.0:
        return "nothing feels the wind: air.density is 0 kg/m^3"
    if any(cable.diameter is not None and cable.drag_coefficient != 0.0 for cable in scenario.cables.values()):
        return ""
    if any(body.shedding is not None or any(body.drag_areas) for _, body in _bodies(scenario)):
        return ""
    return "nothing feels the wind: no rope has a diameter (m) and no body a drag_area (m^2)"


def _speed(path: KeyPath, wind: tuple[float, ...]) -> Iterator[Fault]:
    """Error of a scenario's wind vector whose speed is beyond that of any hurricane."""
    if (speed := hypot(*in_space(wind))) > STRONGEST_WIND:
        allowed = f"at most {STRONGEST_WIND:g} m/s, more than any hurricane has"
        yield refuse(path, wind, allowed, f"a speed of {speed:.4g} m/s")


def _bodies(scenario: Scenario) -> Iterator[tuple[KeyPath, Body]]:
    """All vehicle bodies in a scenario file, each with its key path."""
    for name, carriage in scenario.carriages.items():
        yield from ((("carriages", name, "bodies", body), value) for body, value in carriage.bodies.items())
    for path, kind in scenario.carriers.kinds_by_path.items() if scenario.carriers else ():
        yield from (((*path, "bodies", body), value) for body, value in kind.bodies.items())
