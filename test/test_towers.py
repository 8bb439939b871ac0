"""Towers and counterweights of a scenario: checks, built constants, and displayed quantities."""

import json
from itertools import pairwise

import numpy as np
import pytest
from test_scenario_faults import faults_of

from cable_twin.mechanics.solution.catenary import rest_over_supports
from cable_twin.scenario import ScenarioError, build_system, load_scenario
from cable_twin.simulation import EquilibriumError, Simulation
from verification import JIT
from verification.supports import CABIN, TRAMWAY, tramway

COARSE = {"cable__elements": 100 if JIT else 20}
HYDRAULIC = {"cable.end.support": "hydraulic"} | dict.fromkeys(
    ("cable.end.direction", "cable.end.mass", "cable.end.travel")
)


FAULTS = [
    ("cable.end.mass", None, "given nothing: a counterweight needs it; allowed: a number above 0, in kg"),
    ("cable.end.mass", 8e6, "a strain of 19.7 %; allowed: a pull of at most 19900 kN, for a strain of 5 %"),
    ("cable.end.direction", None, "given nothing: a counterweight needs it"),
    ("cable.end.direction", [0, 0], "allowed: a direction, not all numbers zero"),
    ("cable.end.direction", [-1, 0], "slack; allowed: a direction that pulls the cable away from [500.0, 80.0]"),
    ("cable.end.travel", [3, -3], "given [3.0, -3.0] m; allowed: the least travel, then a greater one, in m"),
    ("cable.end.travel", [2, 2], "allowed: the least travel, then a greater one"),
    ("cable.start.mass", 3.0, "where support is pinned; allowed: null, or a value in kg with support: counterweight"),
    ("cable.start.travel", [-1, 1], "given [-1.0, 1.0] m: where support is pinned; allowed: null, or a value in m"),
    ("cable.initial_shape", "straight", "given 'straight': with a counterweight; allowed: equilibrium"),
    ("towers.tower.kind", "roller", "allowed: one of sheaves, saddle"),
    ("towers.tower.stiffness", 0, "given 0 N/m; allowed: a finite number above 0, in N/m"),
    ("towers.tower.friction", -0.1, "given -0.1; allowed: a finite number at least 0"),
    ("towers.tower.contacts", 0, "given 0; allowed: a whole number at least 1"),
    ("towers.tower.length", 0.0, "given 0.0 m: for 13 contacts; allowed: a number above 0, in m"),
    ("towers.tower.length", 41.0, "more than one radian of a circle of 40 m; allowed: at most 40 m"),
    ("towers.tower.position", [-5, 80], "x between 0 m (the start) and 1000 m (the end), in order along the cable"),
    ("towers.tower.position", [0, 80], "x between 0 m (the start) and 1000 m (the end)"),
]


@pytest.mark.parametrize(("key", "value", "text"), FAULTS)
def test_a_fault_says_where_what_and_what_is_allowed(key, value, text):
    (fault,) = faults_of(TRAMWAY, {key: value})
    assert fault.startswith(f"mapping (override): {key}: ")
    assert text in fault


def test_a_tower_behind_the_end_also_turns_the_pull_round():
    faults = faults_of(TRAMWAY, {"towers.tower.position": [1200, 80]})
    assert any("towers.tower.position: given [1200.0, 80.0] m; allowed: x between" in fault for fault in faults)


def test_counterweights_and_free_ends_that_contradict():
    second = {"support": "counterweight", "position": [0, 0], "direction": [-1, 0], "mass": 1e4}
    (fault,) = faults_of(TRAMWAY, {"cable.start": second})
    assert "cable.end.support: given 'counterweight': at both ends; allowed: a counterweight at one end only" in fault
    (fault,) = faults_of(TRAMWAY, {"cable.start": {"support": "free", "position": [0, 0]}})
    assert "towers: given a mapping: an end is free; allowed: only where both ends of the rope are held" in fault
    (fault,) = faults_of(TRAMWAY, {"gravity": 0.0})
    assert "cable.end.force: given nothing: there is no weight without gravity" in fault


def test_towers_are_in_order_and_do_not_share_names_with_the_ends():
    tower = TRAMWAY["towers"]["tower"]
    towers = {"upper": tower, "lower": tower | {"position": [300.0, 40.0]}}
    with pytest.raises(ScenarioError, match=r"towers\.lower\.position: .* between 500 m \(tower 'upper'\) and 1000 m"):
        load_scenario({**TRAMWAY, "towers": towers})
    with pytest.raises(ScenarioError, match=r"towers\.end: given the name 'end': an end of the cable"):
        load_scenario({**TRAMWAY, "towers": {"end": tower}})


def test_a_cable_too_short_for_its_way_over_the_towers():
    (fault,) = faults_of(TRAMWAY, {**HYDRAULIC, "cable.unstrained_length": 955.0})
    assert "its ends are 1006.76 m apart over the towers, which" in fault
    for travel, apart in (([-1, 1], "1005.76"), (None, "506.36")):  # without limits it may come to the tower
        (fault,) = faults_of(TRAMWAY, {"cable.end.travel": travel, "cable.unstrained_length": 100.0})
        assert "cable.unstrained_length: given 100.0 m" in fault
        assert f"its ends are {apart} m apart over the towers with the counterweight as far in as it goes" in fault


REST = [
    ({"towers.tower.position": [500.0, 5.0]}, r"towers.tower.position: .* passes 1\d.\d m above its top .* higher"),
    ({"towers.tower.hold_down": True}, r"towers.tower.position: .* passes 6\d.\d m below its top .* lower"),
    ({"cable.end.travel": [-1, 1]}, "cable.end.travel: .* would rest at 4.488 m, it is too heavy, .* between -1 and 1"),
    ({"cable.end.mass": 20e3}, "cable.end.travel: .* would rest at -8.885 m, it is too light"),
    ({"cable.end.mass": 500.0}, "cable.end.mass: .* too light to hold a cable of 207 kN; allowed: a heavier one"),
]


@pytest.mark.parametrize(("overrides", "text"), REST)
def test_what_finds_no_rest_is_said_in_one_line(overrides, text):
    with pytest.raises(EquilibriumError, match=text) as caught:
        Simulation(load_scenario(TRAMWAY, overrides))
    assert "\n" not in str(caught.value)


def test_contacts_are_even_on_a_circle_with_its_top_at_the_tower():
    supports = build_system(load_scenario(TRAMWAY)).towers
    np.testing.assert_allclose(supports.position[6], [500.0, 80.0])
    centre = supports.position - 40.0 * supports.normal
    np.testing.assert_allclose(centre, np.broadcast_to(centre[0], centre.shape))
    steps = [float(np.arccos(a @ b)) * 40.0 for a, b in pairwise(supports.normal)]
    np.testing.assert_allclose(steps, 2.0)
    slope = (np.arctan2(80.0, 500.0) + np.arctan2(20.0, 500.0)) / 2.0
    np.testing.assert_allclose(supports.normal[6], [-np.sin(slope), np.cos(slope)])
    np.testing.assert_allclose(supports.friction, 0.1)


def test_a_hold_down_presses_from_above_and_straight_trains_are_straight():
    overrides = {"towers.tower.hold_down": True, "towers.tower.radius": None, "towers.tower.kind": "sheaves"}
    supports = build_system(load_scenario(TRAMWAY, overrides)).towers
    assert (supports.normal[:, 1] < -0.9).all()
    np.testing.assert_allclose(np.diff(supports.position, axis=0, n=2), 0.0, atol=1e-10)
    np.testing.assert_allclose(supports.friction, 0.03)


def test_a_cable_that_runs_towards_smaller_x_lies_on_the_same_side():
    """Mirrored tramway with equal loads."""
    mirrored = {
        "cable.end.position": [-1000.0, 100.0],
        "cable.end.direction": [-0.99, 0.12],
        "towers.tower.position": [-500.0, 80.0],
        "cable.elements": COARSE["cable__elements"],
    }
    one, other = tramway(**COARSE).snapshot, Simulation(load_scenario(TRAMWAY, mirrored)).snapshot
    for name, support in one.supports.items():
        np.testing.assert_allclose(other.supports[name].force, support.force * [-1.0, 1.0, 1.0], rtol=1e-6)


def test_a_counterweight_pulls_with_its_weight_unless_a_force_is_given():
    weights = build_system(load_scenario(TRAMWAY)).counterweights
    np.testing.assert_allclose(weights.force, [0.0, 80e3 * 9.81])
    np.testing.assert_allclose(weights.stiffness[1], 80e3 * 9.81 / 0.05)
    weights = build_system(load_scenario(TRAMWAY, {"cable.end.force": 7e5, "cable.end.travel": None})).counterweights
    np.testing.assert_allclose(weights.force, [0.0, 7e5])
    assert weights.travel.tolist() == [[-np.inf, np.inf]] * 2


def test_a_hydraulic_end_is_held():
    simulation = Simulation(
        load_scenario(
            TRAMWAY, {**HYDRAULIC, "cable.unstrained_length": 1006.0, "cable.elements": COARSE["cable__elements"]}
        )
    )
    assert simulation.snapshot.supports["end"].travel is None
    np.testing.assert_allclose(simulation.snapshot.cable.positions[-1], [1000.0, 0.0, 100.0], atol=1e-9)


def test_a_snapshot_names_every_support():
    simulation = tramway(cabin={"joint": "fixed"}, **COARSE)
    supports = simulation.snapshot.supports
    assert list(supports) == ["start", "end", "tower"]
    tower = supports["tower"].tower
    assert tower is not None
    assert tower.normal_load == tower.rest_load == tower.lowest_load > 1.5e5
    assert (tower.margin, tower.lifted_off) == (1.0, False)
    assert np.linalg.norm(supports["tower"].force) == pytest.approx(tower.normal_load, rel=0.01)
    assert supports["start"].tower is None
    assert -8.0 < supports["end"].travel < 8.0
    total = sum(support.force for support in supports.values())
    np.testing.assert_allclose(total, [0.0, 0.0, (20.87 * 1010.0 + 12e3) * 9.81], rtol=1e-6, atol=1.0)


def test_at_rest_it_stays_there_with_its_friction():
    simulation = tramway(cabin={"joint": "fixed"}, **COARSE)
    before = simulation.snapshot
    after = simulation.advance_to(1.0 if JIT else 0.05)
    np.testing.assert_allclose(after.cable.positions, before.cable.positions, atol=1e-6)
    assert after.supports["tower"].tower.margin == pytest.approx(1.0, abs=1e-6)


def test_reset_gives_back_the_towers_and_repeats_to_the_last_bit():
    simulation = tramway(cabin={"arc_length": 500.0}, **COARSE)
    start = simulation.snapshot
    time = 2.0 if JIT else 0.05
    simulation.command("cabin", speed=5.0)
    one = simulation.advance_to(time)
    assert one.supports["tower"].tower.normal_load != start.supports["tower"].tower.normal_load
    simulation.reset()
    assert simulation.snapshot.supports["tower"].tower == start.supports["tower"].tower
    simulation.command("cabin", speed=5.0)
    other = simulation.advance_to(2.0 * time)
    assert other.supports["tower"].tower == one.supports["tower"].tower
    np.testing.assert_array_equal(other.cable.positions, one.cable.positions)


def test_a_scenario_with_towers_reads_back_the_same():
    scenario = load_scenario({**TRAMWAY, "carriages": {"cabin": CABIN}})
    assert load_scenario(json.loads(json.dumps(scenario.resolved()))) == scenario


@pytest.mark.parametrize("tensioning", ["counterweight", "hydraulic"])
def test_a_lift_of_many_towers_starts_at_rest_near_its_catenaries(tensioning):
    """Ten towers of one sheave, one hold-down: loads near the closed form of the initial guess."""
    x = np.linspace(0.0, 660.0, 12)
    z = 8.0 + 0.3 * x + 12.0 * np.sin(np.pi * x / 660.0)
    z[5] -= 6.0
    towers = {f"t{k}": {"position": [x[k], z[k]], "hold_down": k == 5} for k in range(1, 11)}
    end = {"position": [x[-1], z[-1]], "support": tensioning}
    if tensioning == "counterweight":
        end |= {"direction": [1.0, 0.25], "mass": 12e3, "travel": [-3.0, 3.0]}
    way = float(np.hypot(np.diff(x), np.diff(z)).sum())
    cable = {"unstrained_length": way, "mass_per_length": 8.0, "axial_stiffness": 8e7, "bending_stiffness": 3e3}
    cable |= {"elements": 132 if JIT else 44, "start": {"position": [x[0], z[0]]}, "end": end}
    simulation = Simulation(load_scenario({"cable": cable, "towers": towers}))
    rest = rest_over_supports(simulation.system)
    for load, name in zip(rest.load(), towers, strict=True):
        force = simulation.snapshot.supports[name].force
        np.testing.assert_allclose(force, [load[0], 0.0, load[1]], atol=0.1 * np.hypot(*load))
    total = sum(support.force for support in simulation.snapshot.supports.values())
    np.testing.assert_allclose(total, [0.0, 0.0, way * 8.0 * 9.81], rtol=1e-6, atol=0.1)
