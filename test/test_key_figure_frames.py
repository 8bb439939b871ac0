"""Input of key figures: gaps in frames, other scenarios, cost; and figures as messages and back."""

from __future__ import annotations

import math
import time

import numpy as np
import pytest
from named_figures import named
from prescribed_frames import (
    LENGTH,
    PERIOD,
    SAG,
    frame,
    gathered,
    height,
    scenario,
    snapshot,
    supported,
    writable,
)

from cable_twin.frame.records import AppliedCommand, Command
from cable_twin.key_figures import KeyFigures, figure_from_values, values_of
from cable_twin.mechanics.parameters import FREE, SPEED
from cable_twin.simulation import Simulation


def test_what_a_log_does_not_hold_is_no_value():
    """NaN enters no figure and replaces no value."""
    figures = KeyFigures(scenario(terrain=[[0.0, -60.0], [1000.0, -60.0]]))
    figures.update(frame(0.0, tension=math.nan))
    names = set(gathered(figures))
    assert names == {"sag below the chord", "rope clearance over the terrain"}
    figures.command(AppliedCommand(0.0, Command("emergency_stop", {}), "test"))  # from nobody knows where
    figures.update(snapshot(1.0, speed=3.0, pitch=0.1))
    before = gathered(figures)
    assert before["dynamic amplification, tension over that at the start"].value == 1.0
    assert before["cabin: clearance over the terrain"].value == pytest.approx(60.0 - 40.0 - 5.0 - 1.5, abs=0.3)
    for moment in (2.0, 3.0):
        nothing = frame(moment)
        nothing.numbers.base[1:] = math.nan
        figures.update(nothing)
    assert gathered(figures) == before


def test_frames_without_places_leave_accelerations_to_those_that_have_some():
    """Places at every fifth frame, as in a log: figures of these frames alone."""
    sparse, alone = KeyFigures(scenario()), KeyFigures(scenario())
    for number in range(101):
        moment = number * PERIOD
        one = snapshot(moment, place=500.0 + 0.5 * 1.2 * moment**2)
        if number % 5:
            writable(one).body_position[:] = math.nan
        else:
            alone.update(one)
        sparse.update(one)
    name = "cabin: vehicle acceleration"
    assert gathered(sparse)[name] == gathered(alone)[name]
    assert gathered(sparse)[name].value == pytest.approx(1.2, rel=0.05)


def test_frames_of_another_scenario_are_refused():
    with pytest.raises(ValueError, match="snapshot: given other names"):
        KeyFigures(scenario()).update(supported(0.0))


def test_a_span_without_a_point_takes_the_next_one():
    """Two towers between two points of the rope, and one just beyond a point."""
    places = {"a": 251.0, "b": 253.0, "c": 600.0}
    towers = {name: {"position": [x, height(x)]} for name, x in places.items()}
    figures = KeyFigures(scenario(towers=towers))
    figures.update(frame(0.0, towers=tuple(places)))
    found = gathered(figures)
    assert found["sag below the chord, a to b"].place == "x 255.0 m"
    assert found["sag below the chord, b to c"].value == pytest.approx(SAG * (347.0 / LENGTH) ** 2, rel=1e-3)


def test_an_update_costs_little_and_keeps_nothing():
    """Live use: well below a hundredth of a 10 ms frame, on a shared machine."""
    figures = KeyFigures(scenario())
    frames = [snapshot(number * PERIOD, place=100.0 + number) for number in range(200)]
    costs = []
    for one in frames:
        started = time.perf_counter()
        figures.update(one)
        costs.append(time.perf_counter() - started)
    assert np.median(costs) < 1e-4


def test_the_clearance_of_the_figures_is_that_of_the_simulation():
    """Rotated outline over ground with corners; figures sample fewer points of the rope."""
    ground = [[-10.0, -70.0], [55.0, -10.0], [60.0, -11.0], [300.0, -60.0], [1000.0, -60.0]]
    tilted = scenario(terrain=ground, carriages__cabin__arc_length=57.0)
    simulation, figures = Simulation(tilted), KeyFigures(tilted)
    lowest = math.inf
    for number in range(10):
        figures.update(simulation.advance_to(0.1 * number))
        lowest = min(lowest, simulation.clearance().vehicles["cabin"].height)
    assert gathered(figures)["cabin: clearance over the terrain"].value == pytest.approx(lowest, abs=1e-12)


@pytest.mark.parametrize(("brake", "commanded"), [(False, False), (False, True), (True, False)])
def test_a_free_carriage_without_a_brake_has_no_stop(brake, commanded):
    """Its drive was not commanded and an emergency stop leaves it free, as the buffer that it runs into is no brake."""
    means = {"emergency_stop": ["track_rope_brake"], "track_rope_brake": {"force": 1e4}} if brake else {}
    figures = KeyFigures(scenario(**{f"carriages__cabin__drive__{key}": value for key, value in means.items()}))
    for number in range(4):
        here = snapshot(number * PERIOD, place=100.0 + number * PERIOD * 5.0, speed=5.0)
        writable(here).command_kind[:] = SPEED if commanded else FREE
        figures.update(here)
        if number == 1:
            figures.command(AppliedCommand(number * PERIOD, Command("emergency_stop", {}), "test"))
    stops = {one.id.quantity for one in figures.figures() if "stopping" in one.id.quantity}
    told = {"stopping_distance", "stopping_time", "passenger_stopping_distance"}
    assert stops == (told if brake or commanded else set())


@pytest.mark.parametrize("limit", [None, 0.1 + 0.2])
def test_a_figure_comes_back_from_what_is_told_to_the_last_bit(limit):
    figure = named("cabin: swing", 1.0 / 3.0, "rad", 0.1 + 0.7, "arc length 1.0 m", limit, "at least", "scenario")
    figure = figure if limit is not None else named("cabin: swing", -1.0 / 3.0, "rad", 2.0)
    values = values_of(figure)
    assert all(isinstance(value, str) for value in values.values())
    assert figure_from_values("cabin: swing", values) == figure


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"value": "much"}, "could not convert"),
        ({"bound": "about"}, "bound: given 'about'"),
        ({"unit": None}, "unit: given nothing"),
    ],
)
def test_values_that_are_no_figure_are_refused(change, message):
    values = values_of(named("swing", 0.1, "rad", 1.0, limit=0.2)) | change
    with pytest.raises(ValueError, match=f"key figure 'swing': {message}"):
        figure_from_values("swing", {key: value for key, value in values.items() if value is not None})
