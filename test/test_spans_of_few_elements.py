"""Warning of a mesh with too few elements in the spans beside towers."""

import warnings

import pytest

from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation

TOWER = {"kind": "saddle", "contacts": 5, "length": 4.0, "radius": 20.0, "stiffness": 1e6}
LINE = {  # three spans of 100 m
    "cable": {
        "unstrained_length": 301.0,
        "mass_per_length": 5.0,
        "axial_stiffness": 50e6,
        "bending_stiffness": 2e3,
        "elements": 60,
        "start": {"position": [0.0, 0.0]},
        "end": {"position": [300.0, 0.0]},
    },
    "towers": {"near": {**TOWER, "position": [100.0, 3.0]}, "far": {**TOWER, "position": [200.0, 3.0]}},
}
GRADED = {"target": 60.0, "at_towers": 2.0, "growth": 3.0}
FAR = [110.0, 3.0]  # of a station


def warnings_of(changes):
    """Warnings at the start of the line with changes, and the vertical load (N) of its first tower."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        simulation = Simulation(load_scenario(LINE, changes), on_demand=True)
    return [str(one.message) for one in caught], simulation.snapshot.supports["near"].force[2]


@pytest.mark.parametrize("elements", [1, 3, 11])
def test_loads_of_towers_that_are_wrong_are_warned_of(elements):
    (said,), _ = warnings_of({"cable.elements": elements})
    assert f"elements of {301.0 / elements:.3g} m beside tower 'near', whose spans are 100 m long on average" in said
    assert said.endswith("elements up to 20 m, or a graded mesh, prevent that")


def test_those_that_are_right_are_not():
    loads = []
    for elements in (16, 60, GRADED):
        said, load = warnings_of({"cable.elements": elements})
        assert not said
        loads.append(load)
    assert loads == pytest.approx([loads[1]] * 3, rel=0.02)


def test_towers_of_a_station_carry_a_bend_and_no_weight():
    said, _ = warnings_of({"cable.elements": GRADED, "towers.far.position": FAR})
    assert not said
