"""Saddles of few contact points: how a vehicle on them rises and sinks, the warning of it, and the check of figures."""

import re
import warnings
from math import sqrt

import pytest

from cable_twin.offline.check import refined
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation

LENGTH, RADIUS, STIFFNESS, LOAD = 24.0, 400.0, 2e5, 2e4  # m, m, N/m per m of saddle, N
TOP, STRETCH = 99.875, 1.00257  # m of rope to the top, and its length by strain
LINE = {  # a rope bent by 0.1 rad over a saddle of 0.06 rad, and a vehicle on its top
    "cable": {
        "unstrained_length": 199.75,
        "mass_per_length": 1.0,
        "axial_stiffness": 400e6,
        "bending_stiffness": 10.0,
        "elements": {"target": 10.0, "at_towers": 0.1, "growth": 1.5},
        "start": {"position": [0.0, 0.0]},
        "end": {"position": [200.0, 0.0]},
    },
    "towers": {
        "saddle": {
            "position": [100.0, 5.0],
            "kind": "saddle",
            "friction": 0.0,
            "length": LENGTH,
            "radius": RADIUS,
            "contacts": 25,
            "stiffness": STIFFNESS,
        }
    },
    "carriages": {
        "load": {
            "arc_length": TOP,
            "joint": "sliding",
            "bodies": {"body": {"mass": LOAD / 9.81, "inertia": 100.0, "upper_pivot": [0.0, 1.0]}},
        }
    },
}


def start(changes):
    """Simulation of the line with changes, at rest, and the warnings of its start."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        simulation = Simulation(load_scenario(LINE, changes), on_demand=True)
    return simulation, [str(one.message) for one in caught]


def bump(pitch):
    """Height (m) by which a load stands higher on the contact point at the top than between it and the next one.

    Less what the circle falls by between both, and its chord lies below it. And the tension (N).
    """
    fineness = {"towers.saddle.contacts": round(LENGTH / pitch) + 1, "towers.saddle.stiffness": STIFFNESS * pitch}
    places = []
    for arc_length in (TOP, TOP + 0.5 * pitch / STRETCH):
        simulation, _ = start({"carriages.load.arc_length": arc_length, **fineness})
        places.append(simulation.snapshot.vehicles.position[0])
    (x, _, on), (aside, _, between) = places
    return on - between - (aside - x) ** 2 / (2.0 * RADIUS) - pitch**2 / (8.0 * RADIUS), tension_of(simulation)


def tension_of(simulation):
    """Lowest tension (N) of the rope."""
    return float(simulation.snapshot.cable.tensions.min())


@pytest.mark.parametrize("pitch", [1.0, 0.5])
def test_load_sinks_between_contact_points_as_on_a_string_on_springs(pitch):
    height, tension = bump(pitch)
    h = sqrt(STIFFNESS * pitch * pitch / tension)
    root = h * sqrt(1.0 + 0.25 * h * h)
    on, beside = LOAD * pitch / tension / (2.0 * root), LOAD * pitch / (2.0 * tension) / (root + 0.5 * h * h)
    assert height == pytest.approx(beside + LOAD * pitch / (4.0 * tension) - on, rel=0.03)


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
