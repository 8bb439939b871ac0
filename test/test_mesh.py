"""Nodes of graded meshes, element search on them, and refused gradings."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from cable_twin.mechanics.parameters import mesh_fields
from cable_twin.mechanics.rope.point import element_at, position_on_cable
from cable_twin.mechanics.state import allocate_state
from cable_twin.scenario import Grading, build_system, load_scenario
from cable_twin.scenario.builders.mesh import graded_nodes, short_zones
from verification.followed import LIFTS, SCENES

GRADING = {"target": 8.0, "at_towers": 1.4, "growth": 1.5}
ROPEWAYS = ("chairlift", "gondola", "aerial_tramway")


def ropeway(name, **grading):
    """Scenario with a given grading; of a whole lift its uphill strand."""
    if name == "aerial_tramway":
        return load_scenario(name, {"cable.elements": {**GRADING, **grading}})
    return load_scenario(name, {"ropes.up.elements": {**GRADING, **grading}}).of_rope("up")


@pytest.mark.parametrize("name", ROPEWAYS)
@pytest.mark.parametrize("growth", [1.2, 1.5, 2.0])
def test_elements_are_short_at_towers_and_ends_and_grow_between_them(name, growth):
    scenario = ropeway(name, growth=growth)
    system = build_system(scenario)
    nodes, lengths = system.cable.node_arc_length, system.cable.element_length
    assert (nodes[0], nodes[-1]) == (0.0, scenario.cable.unstrained_length)
    assert_allclose(lengths.sum(), scenario.cable.unstrained_length, rtol=1e-12)
    assert 0.97 * 1.4 < lengths.min() <= 1.03 * 1.4
    assert lengths.max() < 1.02 * 8.0
    ratios = lengths[1:] / lengths[:-1]
    assert np.maximum(ratios, 1.0 / ratios).max() < 1.02 * growth
    zones = short_zones(scenario, system)
    assert len(zones) == 2 + len(scenario.towers)
    for first, last in zones:
        touched = (nodes[1:] >= first) & (nodes[:-1] <= last)
        assert lengths[touched].max() < 1.4 * growth


def test_towers_are_found_where_the_rope_lies_on_them():
    """Zones of short elements contain all contacts of the rope at rest."""
    from cable_twin.simulation import Simulation  # noqa: PLC0415 - the only test here that needs the solver

    scenario = load_scenario("gondola")
    simulation = Simulation(scenario)
    zones = short_zones(scenario.of_rope("up"), simulation.system)[1:-1]
    offset = simulation.system.towers.contact_offset
    for tower, (first, last) in enumerate(zones):
        places = simulation.state.contact_arc_length[offset[tower] : offset[tower + 1]]
        assert (places > first).all()
        assert (places < last).all()


def test_a_load_hangs_as_low_as_short_elements_beside_it_let_it():
    """12 t on a rope of 1044 m; with 40 equal elements it hangs 0.1 m too high."""
    from cable_twin.simulation import Simulation  # noqa: PLC0415 - the other tests here need no solver

    heights = {}
    for at_load in (1.0, 0.25):
        elements = {"target": 26.0, "at_towers": at_load, "growth": 2.0}
        loads = [{"arc_length": 522.0, "force": [0.0, -117720.0]}]
        simulation = Simulation(
            load_scenario("single_span", {"carriages": {}, "cable.loads": loads, "cable.elements": elements})
        )
        heights[at_load] = position_on_cable(simulation.system.cable, simulation.state, 522.0)[1]
        assert simulation.system.cable.element_count < 65
    # two catenaries, and what the bending stiffness adds to them: at most sqrt(EI/T) F/2T
    assert 109.3056 < heights[0.25] < 109.3056 + 0.0115
    assert heights[1.0] == pytest.approx(heights[0.25], abs=2.5e-3)


def test_a_target_as_short_as_at_towers_is_an_even_mesh():
    nodes = graded_nodes(100.0, Grading(target=2.0, at_towers=2.0), np.array([[0.0, 0.0], [40.0, 45.0]]))
    assert_allclose(nodes, np.linspace(0.0, 100.0, 51), atol=1e-9)


def test_a_number_makes_elements_that_are_equal_to_the_last_bit():
    cable = build_system(load_scenario("single_span")).cable
    assert np.all(cable.element_length == cable.element_length[0])


@pytest.mark.parametrize("nodes", [np.linspace(0.0, 7.0, 8), np.array([0.0, 0.1, 0.35, 2.0, 2.1, 5.0, 5.05, 7.0])])
def test_every_place_is_found_on_its_element(nodes):
    system = build_system(load_scenario("single_span"))
    cable = system.cable._replace(**mesh_fields(nodes))
    state = allocate_state(system._replace(cable=cable))
    places = np.concatenate([nodes, 0.5 * (nodes[1:] + nodes[:-1]), np.random.default_rng(1).uniform(0.0, 7.0, 200)])
    for place in places:
        expected = min(np.searchsorted(nodes, place, side="right") - 1, nodes.size - 2)
        assert element_at(cable, state, place) == expected
    assert element_at(cable, state, -1.0) == 0
    assert element_at(cable, state, 9.0) == nodes.size - 2


def test_part_of_a_grading_is_changed_by_its_key():
    scenario = load_scenario("chairlift", {"ropes.down.elements.target": 6.0})
    up, down = (scenario.ropes[name].elements for name in ("up", "down"))
    assert (up.target, down.target) == (12.0, 6.0)
    assert up.at_towers == down.at_towers


@pytest.mark.parametrize("name", SCENES | LIFTS)
def test_plants_that_are_followed_have_no_coarser_mesh_anywhere_and_finer_ones_on_each_rope(name):
    own, plant = load_scenario(name), load_scenario(name, dict((SCENES | LIFTS)[name].mesh))
    for rope in own.ropes:
        twin, other = (one.ropes[rope].elements for one in (own, plant))
        assert other.target < twin.target
        assert other.at_towers <= twin.at_towers
