"""Temperature of ropes: longer or tighter, at rest and while they move; closed forms are in verification."""

from __future__ import annotations

import numpy as np
import pytest
from small_tramway import TRAMWAY

from cable_twin import Command, Ensemble, Simulation, load_scenario
from cable_twin.frame.records import CommandError
from cable_twin.offline.simulate import main
from cable_twin.scenario import ScenarioError
from verification import JIT

EXPANSION = 12e-6  # 1/K, the default


def at(name: str, temperature: float) -> Simulation:
    return Simulation(load_scenario(name, {"air.temperature": temperature}), samples=2, on_demand=True)


def test_nothing_changes_at_the_reference_temperature():
    plain = Simulation(load_scenario("single_span"), samples=2, on_demand=True)
    assert plain.system.cable.free_stretch == 1.0
    assert at("single_span", 20.0).system.cable.free_stretch == 1.0
    shifted = load_scenario("single_span", {"air.temperature": -10.0, "cable.reference_temperature": -10.0})
    same = Simulation(shifted, samples=2, on_demand=True)
    differing = np.flatnonzero(np.nan_to_num(same.snapshot.numbers) != np.nan_to_num(plain.snapshot.numbers))
    assert differing.tolist() == same.layout.places.temperature.tolist()


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


def test_a_command_sets_it_while_the_rope_moves():
    """The rope keeps its shape at once; the temperature it has already changes nothing, and a reset ends it."""
    simulation, plain = (Simulation(load_scenario("single_span"), samples=2, on_demand=True) for _ in range(2))
    simulation.temperature(20.0)
    first = simulation.advance_to(0.1)
    assert first.numbers.tobytes() == plain.advance_to(0.1).numbers.tobytes()
    simulation.temperature(-10.0)
    pulled = EXPANSION * 30.0 * simulation.system.cable.axial_stiffness
    assert simulation.snapshot.cable.tensions[-1] - first.cable.tensions[-1] == pytest.approx(pulled, rel=0.02)
    assert simulation.snapshot.columns.temperature[0] == -10.0
    simulation.advance_to(0.2)
    simulation.reset()
    assert simulation.snapshot.columns.temperature[0] == 20.0
    assert simulation.system.cable.free_stretch == 1.0
    again = simulation.advance_to(0.3).cable
    assert again.positions.tobytes() == plain.snapshot.cable.positions.tobytes()


@pytest.mark.skipif(not JIT, reason="minutes without compilation")
@pytest.mark.parametrize("name", ["aerial_tramway", "windy_tramway", "chairlift"])
def test_a_file_and_members_of_an_ensemble_continue_with_the_bits_of_one_run(tmp_path, name):
    whole = Simulation(load_scenario(name), samples=2, on_demand=True)
    whole.advance_to(0.1)
    whole.temperature(5.0)
    whole.advance_to(0.2)
    whole.save(tmp_path / "state.npz")
    ensemble = Ensemble(name, 3, threads=2)
    ensemble.advance_to(0.1)
    ensemble.apply([Command("temperature", {"ropes": degrees}) for degrees in (20.0, 5.0, 5.0)])
    ensemble.advance_to(0.2)
    ensemble.fork(whole, 2)
    loaded = Simulation.load(tmp_path / "state.npz", samples=2)
    expected = whole.advance_to(0.3).numbers
    ensemble.advance_to(0.3)
    assert loaded.advance_to(0.3).numbers.tobytes() == expected.tobytes()
    first, *others = ensemble.numbers()
    assert all(one.tobytes() == expected.tobytes() for one in others)
    assert not np.array_equal(first, expected, equal_nan=True)
    assert ensemble.simulation(1).snapshot.columns.temperature[0] == 5.0
    ensemble.close()


@pytest.mark.skipif(not JIT, reason="minutes without compilation")
@pytest.mark.parametrize(("scenario", "space"), [(TRAMWAY, 2), (TRAMWAY, 3), ("chairlift", 2)])
def test_a_log_of_it_replays_to_the_last_bit(tmp_path, replayed, scenario, space):
    loaded = load_scenario(scenario, {"space": space} if space == 3 else {})
    (tmp_path / "it.yaml").write_text(loaded.to_yaml())
    (tmp_path / "script.csv").write_text("time,temperature\n0.2,-3.5\n0.4,-4\n")
    arguments = ("--script", str(tmp_path / "script.csv"), "--duration", "0.8", "--record", "bag")
    assert main([str(tmp_path / "it.yaml"), *arguments, "--output", str(tmp_path / "logs")]) == 0
    (run,) = (tmp_path / "logs").iterdir()
    replayed(run)


@pytest.mark.skipif(not JIT, reason="minutes without compilation")
def test_the_counterweight_of_a_loop_follows_it_under_way():
    warm, cold = at("chairlift", 20.0), at("chairlift", 0.0)
    travels = [one.snapshot.columns.sheave_travel[1] for one in (cold, warm)]
    for degrees in range(19, -1, -1):
        warm.temperature(degrees)
        warm.advance_to(warm.time + 0.2)
    found = warm.advance_to(warm.time + 4.0).columns.sheave_travel[1]
    assert found - travels[1] == pytest.approx(travels[0] - travels[1], rel=0.1)  # friction at towers holds some of it


@pytest.mark.parametrize("degrees", [float("nan"), float("inf"), 283.15, -273.15])
def test_a_temperature_that_no_rope_has_is_refused(degrees):
    simulation = Simulation(load_scenario("single_span"), samples=2, on_demand=True)
    with pytest.raises(CommandError, match=rf"temperature: given {degrees:g} degC; allowed: -100 to 100 degC"):
        simulation.temperature(degrees)
    assert simulation.snapshot.columns.temperature[0] == 20.0


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
