"""Temperature of ropes: longer or tighter, at rest and from the present state on; closed forms are in verification."""

from __future__ import annotations

import numpy as np
import pytest

from cable_twin import Ensemble, Simulation, load_scenario
from cable_twin.scenario import ScenarioError

EXPANSION = 12e-6  # 1/K, the default


def at(name: str, temperature: float) -> Simulation:
    return Simulation(load_scenario(name, {"air.temperature": temperature}), samples=2, on_demand=True)


def test_nothing_changes_at_the_reference_temperature():
    plain = Simulation(load_scenario("single_span"), samples=2, on_demand=True)
    assert plain.system.cable.free_stretch == 1.0
    assert at("single_span", 20.0).system.cable.free_stretch == 1.0
    shifted = load_scenario("single_span", {"air.temperature": -10.0, "cable.reference_temperature": -10.0})
    same = Simulation(shifted, samples=2, on_demand=True)
    assert np.array_equal(same.snapshot.numbers, plain.snapshot.numbers, equal_nan=True)


def test_the_counterweight_of_a_tramway_takes_up_the_length():
    warm, cold = at("aerial_tramway", 40.0), at("aerial_tramway", 10.0)
    length = warm.system.cable.unstrained_length
    travels = [one.snapshot.supports["start"].travel for one in (warm, cold)]
    assert travels[0] - travels[1] == pytest.approx(EXPANSION * 30.0 * length, rel=0.02)
    tensions = [one.snapshot.cable.tensions[0] for one in (warm, cold)]
    assert tensions[0] == pytest.approx(tensions[1], rel=1e-4)


def test_the_counterweight_of_a_loop_takes_up_half_of_both_strands():
    warm, cold = at("chairlift", 30.0), at("chairlift", 10.0)
    both = sum(part.system.cable.unstrained_length for part in warm.parts.values())
    travels = [one.snapshot.columns.sheave_travel[1] for one in (warm, cold)]
    assert travels[0] - travels[1] == pytest.approx(EXPANSION * 20.0 * both / 2.0, rel=0.05)


def test_it_acts_on_the_present_state_of_members():
    """The rope keeps its shape at once, and its tension changes by EA α ΔT; then it goes on."""
    ensemble, given = Ensemble("single_span", 3, threads=1), np.array([20.0, -10.0, 40.0])
    ensemble.advance_to(0.1)
    ensemble.change({"air.temperature": given})
    tensions = ensemble.observe(["end/tension"])["end/tension"]
    stiffness = ensemble.scenario.cable.axial_stiffness
    assert tensions - tensions[0] == pytest.approx(-stiffness * EXPANSION * (given - 20.0), rel=0.02)
    ensemble.advance_to(1.0)
    assert not ensemble.faults
    assert len({*ensemble.observe(["end/tension"])["end/tension"].tolist()}) == 3
    rest = [at("single_span", one).snapshot.cable.tensions[-1] for one in (20.0, -10.0, 40.0)]
    assert rest[1] > rest[0] > rest[2]
    ensemble.close()


@pytest.mark.parametrize(
    ("values", "line"),
    [
        (
            {"air.temperature": 150.0},
            r"air.temperature: given 150.0 degC; allowed: .* at least -100 and at most 100, in degC",
        ),
        ({"cable.thermal_expansion": -1e-5}, "cable.thermal_expansion: given -1e-05 1/K"),
    ],
)
def test_impossible_values_are_refused_in_a_line(values, line):
    with pytest.raises(ScenarioError, match=line):
        load_scenario("single_span", values)


def test_joined_strands_expand_alike():
    with pytest.raises(
        ScenarioError, match=r"ropes\.\w+\.thermal_expansion: given .* equal values on all joined ropes"
    ):
        load_scenario("chairlift", {"ropes.up.thermal_expansion": 16e-6})
