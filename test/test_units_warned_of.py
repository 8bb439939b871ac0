"""Values that are possible and hardly meant, as those in another unit, are warned of."""

import warnings

import pytest

from cable_twin.scenario import load_scenario, scenario_names
from cable_twin.simulation import Simulation
from cable_twin.simulation.start_checks import warn_of_units

KMH = r"carriages.cabin.drive.limits.speed of 36 m/s: ropeways run at up to 15 m/s; 36 km/h are 10 m/s"


@pytest.mark.parametrize(
    ("name", "changes", "said"),
    [
        ("aerial_tramway", {"carriages.cabin.drive.limits.speed": 36.0}, KMH),
        ("chairlift", {"sheaves.drive.drive.limits.speed": 18.0}, "limits.speed of 18 m/s: .*; 18 km/h are 5 m/s"),
        (
            "chairlift",
            {"sheaves.drive.drive.limits.speed": 9.0},
            "speed of 9 m/s: lifts run at up to 8.5 m/s; 9 km/h are 2.5 m/s",
        ),
        (
            "single_span",
            {"carriages.cabin.friction.rolling": 0.5},
            "rolling of 0.5: .*; 0.5 % are 0.005",
        ),
        ("bicable", {"carriers.friction.rolling": 0.5}, "carriers.friction.rolling of 0.5: "),
        (
            "aerial_tramway",
            {"carriages.cabin.payload.capacity": 6.4, "carriages.cabin.payload.mass": 6.4},
            "payload.capacity of 6.4 kg: less than 2 % of the 5600 kg that carry it; 6.4 t are 6400 kg",
        ),
        (
            "chairlift",
            {"carriers.payload.capacity": 0.3, "carriers.payload.leaving": {"return": 0.3}},
            "of 0.3 kg: .*; 0.3 t are 300 kg",
        ),
        ("aerial_tramway", {"cable.mass_per_length": 0.0253}, "cable.mass_per_length of 0.0253 kg/m: .* of 7.4 kg/m"),
        ("chairlift", {"ropes.up.diameter": 0.4}, "ropes.up.mass_per_length of 6.1 kg/m: .* of 48.5 kg/m"),
    ],
)
def test_values_of_another_unit_are_warned_of(name, changes, said):
    with pytest.warns(UserWarning, match=said) as told:
        warn_of_units(load_scenario(name, changes))
    assert len(told) == 1


def test_shipped_scenarios_are_not_warned_of():
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        for name in scenario_names():
            warn_of_units(load_scenario(name))
    assert [str(one.message) for one in told] == []


def test_a_simulation_warns():
    with pytest.warns(UserWarning, match=KMH):
        Simulation(load_scenario("aerial_tramway", {"carriages.cabin.drive.limits.speed": 36.0}))


@pytest.mark.parametrize(
    ("name", "changes", "said"),
    [
        ("aerial_tramway", {"towers.tower.stiffness": 80.0}, "towers.tower.stiffness of 80 N/m: 121 contacts yield by"),
        ("chairlift", {"towers.tower_2_up.stiffness": 800.0}, "towers.tower_2_up.stiffness of 800 N/m: 8 contacts yie"),
    ],
)
def test_towers_that_yield_by_metres_are_warned_of(name, changes, said):
    with pytest.warns(UserWarning, match=said):
        Simulation(load_scenario(name, changes))
