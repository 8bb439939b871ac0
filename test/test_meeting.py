"""Vehicles that meet on one rope."""

from __future__ import annotations

import pytest
import test_loads

from cable_twin.scenario import load_scenario
from cable_twin.simulation import EquilibriumError, Simulation, SolverError


def two_cabins(size=(2.0, 3.0), **places):
    """Cabins 2 m long at 10 and 40 m, driven without haul ropes."""
    data = test_loads.scenario().resolved()
    cabins = {
        name: {
            "arc_length": places.get(name, place),
            "drive": {"mode": "speed", "limits": {"acceleration": 2.0}},
            "bodies": {"cabin": {**test_loads.CABIN, "size": list(size)}},
        }
        for name, place in (("down", 40.0), ("up", 10.0))  # the order of the file is none of theirs
    }
    return load_scenario({**data, "carriages": cabins})


def meet(times):
    simulation = Simulation(two_cabins(), samples=5)
    simulation.command("up", speed=5.0)
    simulation.command("down", speed=-5.0)
    try:
        for time in times:
            simulation.advance_to(time)
    except SolverError as error:
        return simulation, str(error)
    raise AssertionError("they have not met")


def test_two_cabins_do_not_pass_through_each_other_whatever_the_pacing():
    simulation, line = meet([20.0])
    assert line.startswith("'up' and 'down' have met at ")
    assert "their bodies need 2 m" in line
    cabins = simulation.snapshot.carriages
    # 30 m less what a ramp to 5 m/s at 2 m/s² takes, at 10 m/s, until 2 m are left
    assert simulation.time == pytest.approx(2.5 + (28.0 - 2 * 6.25) / 10.0, abs=0.051)
    assert cabins["up"].arc_length < cabins["down"].arc_length
    assert meet(0.01 * number for number in range(600))[1] == line
    with pytest.raises(SolverError, match="have met"):
        simulation.advance_to(30.0)
    simulation.reset()
    assert simulation.advance_to(simulation.time + 0.5).carriages["up"].arc_length == pytest.approx(10.0)


def test_points_without_size_may_pass():
    simulation = Simulation(two_cabins(size=[0.0, 0.0]), samples=5)
    simulation.command("up", speed=5.0)
    cabins = simulation.advance_to(9.0).carriages
    assert cabins["up"].arc_length > cabins["down"].arc_length


def test_cabins_that_start_within_each_other_are_refused():
    with pytest.raises(EquilibriumError, match=r"^carriages.up.arc_length: given 39.0, within 'down' at 38.5; .* 2 m"):
        Simulation(two_cabins(up=39.0, down=38.5))
