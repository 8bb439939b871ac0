"""Equilibrium of joined ropes: lifts with coupled strands, and counterweights with vehicles on their ropes."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest
from bent_line import BENT
from small_tramway import IN_SPACE, TRAMWAY

from cable_twin.mechanics.solution.bundle.loop_rest import on_bullwheels, rest_in_closed_form
from cable_twin.mechanics.solution.bundle.records import bullwheels_at_rest
from cable_twin.mechanics.solution.catenary import rest_over_supports
from cable_twin.scenario import load_scenario
from cable_twin.scenario.builders.bundle import build_bullwheels, build_ropes
from cable_twin.simulation import EquilibriumError, Simulation
from verification import JIT

needs_kernels = pytest.mark.skipif(not JIT, reason="minutes without compilation")
FEW = {f"ropes.{rope}.elements": {"target": 12.0, "at_towers": 2.0, "growth": 2.0} for rope in ("up", "down")}
HELD_DOWN = {**FEW, "towers.tower_2.hold_down": True, "towers.tower_2.position": [150.0, 26.0]}
FIXED = {"sheaves.return.counterweight": None}
FEW_TRACKS = {
    f"ropes.{kind}_{way}.elements": {"target": 30.0, "at_towers": 4.0, "growth": 2.0}
    for kind in ("track", "haul")
    for way in ("up", "down")
}
VALLEY = {  # one rope below a tower in a valley, which holds it down
    "plane": {
        "cable.start.position": [0.0, 20.0],
        "cable.end.position": [200.0, 20.0],
        "towers.tower.position": [100.0, 16.0],
    },
    "space": {
        "cable.start.position": [0.0, 0.0, 20.0],
        "cable.end.position": [200.0, 0.0, 20.0],
        "towers.tower.position": [100.0, 0.0, 16.0],
    },
}


def of_length(up: float, down: float | None = None) -> dict[str, Any]:
    """Unstrained lengths (m) of both strands of the chairlift."""
    return {"ropes.up.unstrained_length": up, "ropes.down.unstrained_length": up if down is None else down}


def refusal(scenario: Any, changes: dict[str, Any]) -> str:
    """Text of a refused start."""
    with pytest.raises(EquilibriumError) as caught:
        Simulation(load_scenario(scenario, changes))
    return str(caught.value)


@needs_kernels
@pytest.mark.parametrize("space", [2, 3])
@pytest.mark.parametrize(("lengths", "travel"), [((815.0,), -3.67), ((822.0,), 3.35), ((813.0, 824.0), -0.16)])
def test_a_lift_with_a_hold_down_runs_with_all_lengths_that_its_counterweight_takes_up(lengths, travel, space):
    """Single strands too slack or too tight for one of their towers."""
    simulation = Simulation(load_scenario("chairlift", HELD_DOWN | of_length(*lengths) | {"space": space}))
    assert simulation.snapshot.columns.sheave_travel[1] == pytest.approx(travel, abs=0.02)
    assert simulation.snapshot.supports["tower_2_up"].tower.normal_load > 2e3


@needs_kernels
@pytest.mark.parametrize(("length", "travel", "off"), [(823.0, 4.35, "shorter"), (814.0, -4.67, "longer")])
def test_beyond_that_it_is_refused_for_its_travel_and_says_by_how_much(length, travel, off):
    said = refusal("chairlift", HELD_DOWN | of_length(length))
    found = re.search(
        r"return\.counterweight\.travel: .* rests at (\S+) m; .* ropes that are (\S+) m (\w+) in all", said
    )
    assert found, said
    assert float(found[1]) == pytest.approx(travel, abs=0.02)
    assert found[3] == off
    changed = length + 0.5 * (float(found[2]) + 0.02) * (1.0 if off == "longer" else -1.0)
    assert Simulation(load_scenario("chairlift", HELD_DOWN | of_length(changed))).time == 0.0


@needs_kernels
@pytest.mark.parametrize("space", [2, 3])
def test_a_loop_without_tensioning_is_told_the_length_with_which_it_touches_its_towers(space):
    changes = HELD_DOWN | FIXED | {"space": space}
    said = refusal("chairlift", changes | of_length(820.5))
    found = re.search(r"towers\.tower_2_up\.position: .* below its top .*, or strands of at most (\S+) m in all", said)
    assert found, said
    simulation = Simulation(load_scenario("chairlift", changes | of_length(0.5 * float(found[1]))))
    assert simulation.snapshot.time == 0.0


def test_a_loop_is_told_the_pull_with_which_it_touches_its_towers():
    changes = FEW | {"towers.tower_2.position": [150.0, 29.0]}
    said = refusal("chairlift", changes)
    found = re.search(r"tower_2_up\.position: .* above its top .* a pull of at most (\S+) kN of sheaves\.return", said)
    assert found, said
    less = load_scenario("chairlift", changes | {"sheaves.return.counterweight.mass": 1e3 * float(found[1]) / 9.81})
    wheels, systems = build_bullwheels(less), build_ropes(less)
    strands, motion = dict(enumerate(systems.values())), bullwheels_at_rest(2)
    rest_in_closed_form(wheels, motion, strands)
    load = rest_over_supports(on_bullwheels(wheels, motion, 0, strands[0])).load()[1]
    assert 0.0 < load @ systems["up"].towers.normal[8:16].mean(axis=0) < 1e3


@pytest.mark.parametrize("dim", ["plane", "space"])
@pytest.mark.parametrize("length", [203.0, 200.25])
def test_one_rope_is_told_the_length_with_which_it_touches_its_tower(dim, length):
    changes = {**VALLEY[dim], "towers.tower.hold_down": True}
    said = refusal(BENT, changes | {"cable.unstrained_length": length})
    found = re.search(r"towers\.tower\.position: .* below .* or a cable\.unstrained_length of at most (\S+) m", said)
    assert found, said
    touching = Simulation(load_scenario(BENT, changes | {"cable.unstrained_length": float(found[1])}))
    assert touching.snapshot.supports["tower"].tower.normal_load > 0.0


@needs_kernels
def test_the_bare_loop_in_closed_form_rests_where_its_elements_do():
    changes = FEW | of_length(817.0, 821.0) | {"carriers": None}
    scenario = load_scenario("chairlift", changes)
    motion = bullwheels_at_rest(2)
    rest_in_closed_form(build_bullwheels(scenario), motion, dict(enumerate(build_ropes(scenario).values())))
    c = Simulation(scenario).snapshot.columns
    assert motion.carriage.position[1] == pytest.approx(c.sheave_travel[1], abs=0.01)  # m, of some 1000 m
    np.testing.assert_allclose(motion.tension, c.sheave_tension, rtol=2e-4)
    assert motion.rope.position[1] == pytest.approx(2.0, abs=0.01)  # half of what the strands differ by


@pytest.mark.parametrize("scenario", [TRAMWAY, IN_SPACE])
def test_the_weight_of_one_rope_may_be_lifted_by_its_vehicle_to_where_it_has_travel(scenario):
    """Counterweight at 0.38 m for the bare rope, lifted by some centimetres by a 200 kg cabin at mid-span."""
    place = {"carriages.cabin.arc_length": 30.0}
    loaded = Simulation(load_scenario(scenario, place)).snapshot.supports["end"].travel
    limited = {**place, "cable.end.travel": [-1.5, loaded + 0.01]}
    within = Simulation(load_scenario(scenario, limited)).snapshot.supports["end"].travel
    assert within == pytest.approx(loaded, abs=1e-9)
    said = refusal(scenario, {**place, "cable.end.travel": [-1.5, loaded - 0.05]})
    assert f"cable.end.travel: the counterweight of 49.05 kN would rest at {loaded:.3f} m, it is too heavy" in said
    assert said.endswith("as with a cable that is about 0.05 m shorter")
    shorter = scenario["cable"]["unstrained_length"] - 0.051
    changes = {**place, "cable.end.travel": [-1.5, loaded - 0.05], "cable.unstrained_length": shorter}
    assert Simulation(load_scenario(scenario, changes)).snapshot.supports["end"].travel < loaded - 0.05


@needs_kernels
def test_the_weight_of_a_track_rope_may_be_lifted_by_what_hangs_on_it_to_where_it_has_travel():
    changes = {**FEW_TRACKS, "ropes.track_down.end.travel": [-3.0, 0.0], "ropes.track_up.start.travel": [-3.0, 0.0]}
    supports = Simulation(load_scenario("bicable", changes)).snapshot.supports
    lifted = supports["track_up/start"].travel, supports["track_down/end"].travel
    assert lifted == pytest.approx((-0.92, -0.40), abs=0.02)
    said = refusal("bicable", changes | {"ropes.track_down.end.travel": [-3.0, -0.5]})
    assert f"ropes.track_down.end.travel: the counterweight of 686.7 kN would rest at {lifted[1]:.3f} m" in said
    assert f"allowed: between -3 and -0.5 m, as with a cable that is about {lifted[1] + 0.5:.3g} m shorter" in said
