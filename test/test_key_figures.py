"""Key figures against closed forms: motion and tension that are prescribed, so that every figure is known."""

from __future__ import annotations

import math
import time

import numpy as np
import pytest

from cable_twin.key_figures import KeyFigures
from cable_twin.records import (
    AppliedCommand,
    BodyState,
    CableSamples,
    CarriageState,
    Command,
    Snapshot,
    SolverReport,
    SupportState,
)
from cable_twin.scenario import load_scenario

PERIOD = 0.01  # s
LENGTH, SAG = 1000.0, 40.0  # m, of a parabola between ends of one height


def scenario(**overrides):
    return load_scenario("aerial_tramway", {key.replace("__", "."): value for key, value in overrides.items()})


def snapshot(
    moment: float, *, place=500.0, speed=0.0, drive_force=0.0, pitch=0.0, body=None, tension=1e6, weight=1e5
) -> Snapshot:
    x = np.linspace(0.0, LENGTH, 201)
    z = -4.0 * SAG * x / LENGTH * (1.0 - x / LENGTH)
    tensions = tension * (1.0 + 0.1 * x / LENGTH)  # highest at the end, lowest at the start
    where = np.array([place, float(np.interp(place, x, z))])
    last = body if body is not None else where - np.array([0.0, 5.0])
    cabin = CarriageState(
        arc_length=place,
        speed=speed,
        drive_force=drive_force,
        contact_force=np.array([0.0, weight]),
        position=where,
        bodies={"cabin": BodyState(last[0], last[1], pitch, 0.0, 0.0, 0.0)},
    )
    supports = {name: SupportState(np.zeros(2)) for name in ("start", "end")}
    cable = CableSamples(x, np.column_stack([x, z]), tensions)
    return Snapshot(moment, {"cabin": cabin}, supports, cable, SolverReport(1, 1, 0, 0.0))


def gathered(figures: KeyFigures) -> dict[str, object]:
    return {figure.name: figure for figure in figures.figures()}


def drive(figures: KeyFigures, speed_at, duration: float, *, start=100.0, begin=0.0) -> float:
    """Move the carriage with a speed over time, place by the trapezoidal rule, which is exact for ramps."""
    place = start
    for frame in range(round(duration / PERIOD) + 1):
        moment = begin + frame * PERIOD
        if frame:
            place += 0.5 * PERIOD * (speed_at(moment) + speed_at(moment - PERIOD))
        figures.update(snapshot(moment, place=place, speed=speed_at(moment)))
    return place


def test_tension_sag_and_safety_factor_with_place_and_time():
    figures = KeyFigures(scenario(cable__breaking_force=4.0e6))
    figures.update(snapshot(0.0, tension=1.0e6))
    figures.update(snapshot(1.0, tension=1.2e6))
    figures.update(snapshot(2.0, tension=0.9e6))
    found = gathered(figures)
    highest = found["rope tension, highest"]
    assert (highest.value, highest.time, highest.place) == (pytest.approx(1.32e6), 1.0, "arc length 1000.0 m")
    assert found["rope tension, lowest"].value == pytest.approx(0.9e6)
    assert found["sag below the chord"].value == pytest.approx(SAG)
    assert found["sag below the chord"].place == "x 500.0 m"
    factor = found["rope safety factor"]
    assert factor.value == pytest.approx(4.0e6 / 1.32e6)
    assert (factor.limit, factor.bound, factor.kept) == (3.15, "at least", False)
    assert "EN 12927" in factor.source


def test_no_safety_factor_without_breaking_force():
    figures = KeyFigures(scenario(cable__breaking_force=None))
    figures.update(snapshot(0.0))
    assert "rope safety factor" not in gathered(figures)


def test_tension_over_transverse_load_takes_the_part_across_the_rope():
    figures = KeyFigures(scenario())
    figures.update(snapshot(0.0, place=250.0, weight=1e5, tension=1e6))
    # sampled every 5 m: the chord from 245 to 255 m is the tangent of the parabola at 250 m
    across = 1e5 * math.cos(math.atan(4.0 * SAG / LENGTH * (1.0 - 2.0 * 0.25)))
    ratio = gathered(figures)["cabin: tension over transverse load"]
    assert ratio.value == pytest.approx(1.025e6 / across, rel=1e-6)
    assert ratio.kept is True


def test_acceleration_of_the_last_body_on_a_circle():
    figures = KeyFigures(scenario())
    radius, rate = 5.0, 0.7
    for frame in range(200):
        angle = rate * frame * PERIOD
        figures.update(snapshot(frame * PERIOD, body=radius * np.array([math.sin(angle), -math.cos(angle)])))
    found = gathered(figures)["cabin: vehicle acceleration"]
    assert found.value == pytest.approx(radius * rate**2, rel=1e-4)
    assert found.kept is False


def test_a_reset_is_no_acceleration():
    figures = KeyFigures(scenario())
    for frame in range(10):
        figures.update(snapshot(frame * PERIOD, place=100.0))
    figures.command(AppliedCommand(9 * PERIOD, Command("reset", {}), "test"))
    for frame in range(10, 20):
        figures.update(snapshot(frame * PERIOD, place=300.0))
    assert gathered(figures)["cabin: vehicle acceleration"].value == pytest.approx(0.0, abs=1e-6)


def test_stopping_distance_is_half_the_square_of_speed_over_deceleration():
    figures = KeyFigures(scenario(limits__stopping_distance=20.0))
    drive(figures, lambda _: 6.0, 5.0)
    figures.command(AppliedCommand(5.0, Command("emergency_stop", {}), "test"))
    drive(figures, lambda moment: max(6.0 - 1.2 * (moment - 5.0), 0.0), 8.0, start=130.0, begin=5.0)
    stop = gathered(figures)["cabin: stopping distance"]
    assert stop.value == pytest.approx(6.0**2 / (2.0 * 1.2), abs=1e-6)
    assert stop.place == "emergency stop from 6.00 m/s in 5.0 s"
    assert (stop.time, stop.limit, stop.source, stop.kept) == (5.0, 20.0, "scenario: limits.stopping_distance", True)


def test_a_stop_that_is_taken_back_does_not_count():
    figures = KeyFigures(scenario())
    drive(figures, lambda _: 6.0, 1.0)
    figures.command(AppliedCommand(1.0, Command("speed", {"cabin": 0.0}), "test"))
    drive(figures, lambda _: 4.0, 1.0, begin=1.01)
    figures.command(AppliedCommand(2.0, Command("speed", {"cabin": 6.0}), "test"))
    drive(figures, lambda _: 0.0, 1.0, begin=2.02)
    assert "cabin: stopping distance" not in gathered(figures)


def test_drive_and_swing_against_the_limits_of_the_scenario():
    figures = KeyFigures(scenario())
    figures.update(snapshot(0.0, speed=-8.0, drive_force=4e4, pitch=-0.2))
    figures.update(snapshot(1.0, speed=10.5, drive_force=2e4, pitch=0.4))
    found = gathered(figures)
    assert found["cabin: speed"].value == 10.5
    assert found["cabin: speed"].kept is False
    assert found["cabin: speed"].source == "scenario: carriages.cabin.drive.limits.speed"
    assert found["cabin: drive force"].value == 4e4
    assert found["cabin: drive force"].kept is True
    assert found["cabin: drive power, highest"].value == pytest.approx(2.1e5)
    assert found["cabin: drive power, lowest"].value == pytest.approx(-3.2e5)
    assert (found["cabin: swing along the track"].value, found["cabin: swing along the track"].kept) == (0.4, False)


def test_an_update_costs_little_and_keeps_nothing():
    """Live use: well under a tenth of a frame of 10 ms, on a machine that others use too."""
    figures = KeyFigures(scenario())
    frames = [snapshot(frame * PERIOD, place=100.0 + frame) for frame in range(200)]
    costs = []
    for frame in frames:
        started = time.perf_counter()
        figures.update(frame)
        costs.append(time.perf_counter() - started)
    assert np.median(costs) < 1e-3
