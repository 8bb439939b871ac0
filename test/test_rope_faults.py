"""Several ropes in a scenario: what is wrong with each, and with what is between them, a line each."""

from __future__ import annotations

import re

import pytest
from changed_keys import change
from test_scenario_faults import SEED, faults_of

from cable_twin.scenario import load_scenario
from cable_twin.simulation import EquilibriumError, Simulation


def two_ropes(**changes):
    """Two ropes with a rod between them and a pantograph below, as plain data."""
    wire = {"unstrained_length": 99.9, "mass_per_length": 1.0, "axial_stiffness": 1e6, "bending_stiffness": 1.0}
    held = {"elements": 20, "start": {"position": [0.0, 0.0]}, "end": {"position": [100.0, 0.0]}}
    data = {
        "ropes": {"upper": wire | held, "lower": wire | held},
        "connectors": {
            "one": {"from": ["upper", 30.0], "to": ["lower", 30.0], "length": 1.0, "stiffness": 1e5},
            "other": {"from": ["upper", 60.0], "to": ["lower", 60.0], "length": 1.0, "stiffness": 1e5},
        },
        "pantographs": {
            "head": {
                "rope": "lower",
                "position": 20.0,
                "uplift_force": 100.0,
                "stages": [{"mass": 7.0, "stiffness": 4e3}],
            }
        },
    }
    return change(data, changes)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"ropes__upper__unstrained_length": -1.0}, "ropes.upper.unstrained_length: given -1.0 m; allowed: a finite"),
        ({"ropes__lower__unstrained_length": 300.0}, None),
        (
            {"ropes__lower__unstrained_length": 80.0},
            "ropes.lower.unstrained_length: given 80.0 m: its ends are 100 m",
        ),
        (
            {"connectors__one__length": 0.0},
            "connectors.one.length: given 0.0 m; allowed: a finite number above 0, in m",
        ),
        (
            {"connectors__one__to": ["lower", 120.0]},
            "connectors.one.to: given 120.0 m: on 'lower'; allowed: above 0 and",
        ),
        (
            {"connectors__one__to": ["middle", 30.0]},
            "connectors.one.to: given the rope 'middle'; allowed: upper, lower",
        ),
        (
            {"connectors__one__to": ["upper", 40.0]},
            "connectors.one.to: given 'upper': both ends on one rope; allowed: another rope than `from`",
        ),
        ({"connectors__one__to": ["lower", 70.0]}, "connectors.other: given across 'one'; allowed: the same order"),
        (
            {"pantographs__head__rope": "middle"},
            "pantographs.head.rope: given the rope 'middle'; allowed: upper, lower",
        ),
        (
            {"pantographs__head__position": 100.0},
            "pantographs.head.position: given 100.0 m; allowed: above 0 and below 100",
        ),
        ({"pantographs__head__stages": []}, "pantographs.head.stages: given []"),
        (
            {"towers": {"mast": {"position": [50.0, 1.0], "rope": "middle"}}},
            "towers.mast.rope: given the rope 'middle'",
        ),
        ({"solver": {"integrator": "runge_kutta"}}, "solver.integrator: given 'runge_kutta': with several ropes"),
    ],
)
def test_several_ropes_are_checked_each_and_together(changes, said):
    faults = faults_of(two_ropes(**changes)) if said else []
    if said is None:
        load_scenario(two_ropes(**changes))
    else:
        assert len(faults) == 1, faults
        assert said in faults[0]


def test_one_cable_takes_nothing_of_several_ropes():
    data = {**SEED.resolved(), "pantographs": two_ropes()["pantographs"]}
    assert any(
        fault.endswith("pantographs.head: given a mapping: with one cable; allowed: only with several `ropes`")
        for fault in faults_of(data)
    )
    data = SEED.resolved()
    data["cable"]["mass_damping"] = 0.1
    assert any(
        "cable.mass_damping: given 0.1 1/s; allowed: 0, or several `ropes`" in fault for fault in faults_of(data)
    )


def test_several_ropes_go_through_yaml_and_back():
    scenario = load_scenario(two_ropes())
    assert "cable" not in scenario.resolved()
    assert load_scenario(scenario.resolved()).resolved() == scenario.resolved()
    assert scenario.cable == scenario.ropes["upper"]


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        (
            {"connectors__other__to": ["lower", 66.0]},
            "connectors.other.to: given 66 m on 'lower', which at rest is 6.006 m aside from 60 m on 'upper' before "
            "the connector of 1 m pulls; allowed: up to 2.998 m",
        ),
        (
            {"ropes__upper__start": {"position": [0.0, 30.0]}, "ropes__upper__end": {"position": [100.0, 30.0]}},
            "connectors.one.to: given 30 m on 'lower', which at rest is 30 m away from 30 m on 'upper' before the "
            "connector of 1 m pulls; allowed: up to 10.99 m",
        ),
    ],
)
def test_a_connector_that_cannot_reach_is_named_before_it_bends_the_ropes(changes, said):
    with pytest.raises(EquilibriumError, match=f"^{re.escape(said)}$"):
        Simulation(load_scenario(two_ropes(**changes)), samples=2)


@pytest.mark.parametrize("changes", [{}, {"space": 3}])
def test_a_weight_that_no_tension_holds_is_told(changes):
    """Of strands over towers, in a plane and in space; the search for their tension had ended in a traceback."""
    with pytest.raises(EquilibriumError, match=r"^no tension up to 620000 kN, .* its weight is 4.993e\+10 kN$"):
        Simulation(load_scenario("chairlift", {"gravity": 1e10, **changes}))


CABIN = {"mass": 300.0, "inertia": 100.0, "upper_pivot": [0.0, 2.0]}


@pytest.mark.parametrize(
    ("changes", "keys"),
    [
        ({"space": 2, "towers.tower_1.mast_offset": 2.0}, ["towers.tower_1.mast_offset"]),
        ({"space": 3, "towers.tower_3.position": [290.0, 400.0, 66.0]}, ["towers.tower_3.position"]),
        ({"space": 2, "terrain_sides": {"distance": 9.0, "left": [[0, 0], [1, 0]], "right": [[0, 0], [1, 0]]}}, None),
    ],
)
def test_towers_and_terrain_of_several_ropes_are_checked_as_those_of_one(changes, keys):
    faults = faults_of("chairlift", changes)
    assert {fault.split(": ")[1] for fault in faults} >= set(keys or ["terrain_sides"])


def test_names_are_there_once_on_all_ropes_together():
    """A joint has the name of its carriage and body, on whichever rope that is; a frame that of its carriage."""
    one = {"arc_length": 30.0, "bodies": {"b_c": CABIN}}
    other = {"arc_length": 30.0, "bodies": {"c": CABIN}}
    carriages = {"a": {**one, "rope": "upper"}, "a_b": {**other, "rope": "lower"}, "mast": {**one, "rope": "lower"}}
    towers = {"mast": {"position": [50.0, -1.0], "rope": "upper"}}
    keys = {fault.split(": ")[1] for fault in faults_of(two_ropes(carriages=carriages, towers=towers))}
    assert keys == {"carriages.a_b.bodies.c", "carriages.mast"}


@pytest.mark.parametrize("kinks", ["rounded", "sharp"])
def test_carriers_without_bodies_are_a_fault_whatever_the_kinks(kinks):
    data = load_scenario("chairlift").resolved()
    data["carriers"]["bodies"] = {}
    data["ropes"]["up"]["kinks"] = kinks
    assert any("carriers.bodies: given neither bodies nor kinds" in fault for fault in faults_of(data))
