"""Saddles of few contact points, on which a vehicle shakes: the warning of it, and the check of figures."""

import re
import warnings

from cable_twin.offline.check import refined
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation
from verification.supports import on_saddle

STIFFNESS = 2e5  # N/m
LINE = on_saddle(1.0)
LINE["carriages"]["load"]["joint"] = "sliding"


def start(changes):
    """Simulation of the line with changes, at rest, and the warnings of its start."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        simulation = Simulation(load_scenario(LINE, changes), on_demand=True)
    return simulation, [str(one.message) for one in caught]


def test_points_that_shake_a_vehicle_are_warned_of_and_those_that_the_warning_names_are_not():
    _, (said,) = start({})
    assert said.startswith("contact points of saddle 'saddle', 1 m apart and of 200000 N/m each, shake vehicles")
    contacts, stiffness = re.findall(r"contacts: (\d+) with stiffness: (\d+) N/m", said)[0]
    _, rest = start({"towers.saddle.contacts": int(contacts), "towers.saddle.stiffness": float(stiffness)})
    assert rest == []


def test_sheaves_and_saddles_without_a_moving_vehicle_are_not():
    assert start({"towers.saddle.kind": "sheaves"})[1] == start({"carriages.load.joint": "fixed"})[1] == []


def test_check_of_figures_halves_the_distance_and_leaves_sheaves_alone():
    tower = refined(load_scenario(LINE)).towers["saddle"]
    assert (tower.contacts, tower.stiffness) == (49, 0.5 * STIFFNESS)
    assert refined(load_scenario(LINE, {"towers.saddle.kind": "sheaves"})).towers["saddle"].contacts == 25
