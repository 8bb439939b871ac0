"""Loading and unloading in a station over their time."""

from __future__ import annotations

import numpy as np
import pytest
import test_loads
from test_simulation import same

from cable_twin.frame.records import AppliedCommand
from cable_twin.key_figures import KeyFigures
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation

TIME = 2.0  # s, for all of the capacity of 400 kg


def station(loading_time=TIME, carried=400.0):
    return load_scenario(
        test_loads.scenario().resolved(),
        {
            "carriages.cabin.payload.loading_time": loading_time,
            "carriages.cabin.payload.mass": carried,
            "carriages.cabin.payload.station_speed": 1.0,  # its haul rope gives way under the load
        },
    )


def carried(snapshot) -> float:
    return snapshot.carriages["cabin"].payload


def test_a_load_gets_in_and_out_evenly_in_its_time():
    simulation = Simulation(station(carried=100.0), samples=5)
    simulation.payload("cabin", 300.0)
    assert carried(simulation.snapshot) == 100.0
    for time in (0.25, 0.5, 0.75):
        assert carried(simulation.advance_to(time)) == pytest.approx(100.0 + 400.0 * time / TIME)
    assert carried(simulation.advance_to(1.3)) == 300.0
    simulation.payload("cabin", 100.0)
    assert carried(simulation.advance_to(1.8)) == pytest.approx(200.0)
    simulation.payload("cabin", carried(simulation.snapshot))  # that is all
    assert carried(simulation.advance_to(3.0)) == pytest.approx(200.0)
    assert simulation.system.carriages.mass[0] == pytest.approx(400.0)
    simulation.payload("cabin", 0.0)
    simulation.reset()
    assert carried(simulation.advance_to(4.0)) == 100.0


def highest_acceleration(loading_time: float) -> float:
    scenario = station(loading_time)
    simulation, figures = Simulation(scenario, samples=5), KeyFigures(scenario)
    figures.update(simulation.advance_to(0.5))
    figures.command(simulation.payload("cabin", 0.0))
    for number in range(51, 51 + 300):
        figures.update(simulation.advance_to(0.01 * number))
    return next(figure.value for figure in figures.figures() if figure.name == "cabin: vehicle acceleration")


def test_a_cabin_that_is_unloaded_is_not_thrown_up():
    """Unloaded at once, 600 kg on the rope would become 200 kg and accelerate by g times 400 / 200."""
    assert highest_acceleration(0.0) > 10.0
    assert highest_acceleration(TIME) < 1.5


def test_half_loaded_it_goes_on_with_the_same_bits_whatever_the_pacing(tmp_path):
    frames = Simulation(station(), samples=5)
    frames.advance_to(0.13)
    assert isinstance(frames.payload("cabin", 0.0), AppliedCommand)
    at_once = Simulation(station(), samples=5)
    at_once.advance_to(0.13)
    at_once.payload("cabin", 0.0)
    for time in np.arange(0.2, 1.0, 0.07):
        frames.advance_to(time)
    frames.save(tmp_path / "state.npz")
    loaded = Simulation.load(tmp_path / "state.npz", samples=5)
    ends = [one.advance_to(3.0) for one in (frames, at_once, loaded)]
    assert carried(ends[0]) == 0.0
    assert same(ends[0], ends[1])
    assert same(ends[0], ends[2])
