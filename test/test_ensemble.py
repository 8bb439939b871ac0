"""Ensembles: members have the bits of single simulations, with their commands and parameters."""

from __future__ import annotations

import copy
import itertools
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from cable_twin import Command, Ensemble, Simulation, load_scenario
from cable_twin.frame.records import CommandError
from cable_twin.key_figures import KeyFigures
from cable_twin.scenario import ScenarioError, scenario_names
from cable_twin.simulation.snapshot_file import FullState

ROOT = Path(__file__).resolve().parents[1]
TRIP = 1.5  # s
SPEEDS = np.array([0.5, 1.0, 1.5])  # m/s
# a plane and space, one rope and several: changes of all, drive, and values that differ between three members
CASES = {
    "aerial_tramway": (
        {},
        "cabin",
        {"carriages.cabin.payload.mass": [1000.0, 3000.0, 3000.0], "carriages.cabin.friction.rolling": 0.006},
    ),
    "windy_tramway": (
        {"air.wind.y": 8.0, "air.turbulence.intensity": 0.15},
        "cabin",
        {"air.turbulence.seed": [1, 2, 2], "cable.damping_time": [0.004, 0.005, 0.005]},
    ),
    "chairlift": ({}, "haul_rope", {"sheaves.drive.inertia": [2.0e5, 2.2e5, 2.2e5], "air.density": 1.05}),
}
# by these, towers would stand at other arc lengths of the bare rope, and so would the short elements of a graded mesh
OF_MESH = {
    "aerial_tramway": {"cable.axial_stiffness": 4.7e8, "cable.ice": 0.5, "cable.start.mass": 134.2e3},
    "chairlift": {"sheaves.return.counterweight.mass": 33.2e3},
}
# one rope and several, in a plane and in space, with nodes at loads and without; others have kernels of these
PLANE, SPACE = ("seed_example", "aerial_tramway", "chairlift", "bicable"), ("windy_tramway", "jig_back")
KINDS = *((name, 2) for name in PLANE), *((name, 3) for name in SPACE)


def apart(name: str, values: dict[str, object]) -> Simulation:
    """Simulation by itself, with values of a scenario."""
    return Simulation(load_scenario(name, values), samples=2, on_demand=True)


def values_of(parameters: dict[str, object], member: int) -> dict[str, object]:
    return {key: one[member] if isinstance(one, list) else one for key, one in parameters.items()}


@pytest.fixture(scope="module")
def tramways() -> Iterator[Ensemble]:
    """Six members of one scenario, of which tests use what they fork."""
    yield (ensemble := Ensemble("aerial_tramway", 6, threads=2))
    ensemble.close()


@pytest.fixture(scope="module")
def kept_tramway() -> tuple[Simulation, FullState]:
    simulation = apart("aerial_tramway", {})
    return simulation, simulation.capture()


@pytest.fixture
def tramway(kept_tramway) -> Simulation:
    """Simulation at its start."""
    simulation, start = kept_tramway
    simulation.restore(start)
    return simulation


@pytest.mark.parametrize("name", CASES)
def test_members_with_parameters_move_as_simulations_with_these_parameters_do(name):
    changes, drive, parameters = CASES[name]
    ensemble = Ensemble(load_scenario(name, changes), 3, parameters=parameters, threads=2)
    ensemble.command(drive, speed=SPEEDS)
    ensemble.advance_to(TRIP)
    found = ensemble.numbers()
    assert not ensemble.faults
    for member, speed in enumerate(SPEEDS.tolist()):
        single = apart(name, changes | values_of(parameters, member))
        single.command(drive, speed=speed)
        assert np.array_equal(single.advance_to(TRIP).numbers, found[member], equal_nan=True)
        assert np.array_equal(single.state.memory, ensemble.simulation(member).state.memory)
    assert not np.array_equal(found[0], found[1], equal_nan=True)
    ensemble.close()


@pytest.mark.parametrize("name", OF_MESH)
def test_values_that_would_grade_the_mesh_anew_are_on_the_mesh_of_the_scenario(name):
    drive, values = CASES[name][1], OF_MESH[name]
    ensemble = Ensemble(name, 2, parameters=values, threads=1)
    base = apart(name, {})
    single = base.with_values(load_scenario(name, values))
    by_itself = apart(name, values)
    for one in (ensemble, single, by_itself):
        one.command(drive, speed=1.0)
        one.advance_to(TRIP)
    assert np.array_equal(ensemble.numbers()[1], single.snapshot.numbers, equal_nan=True)
    whole = np.abs(by_itself.snapshot.numbers)
    apart_by = np.abs(ensemble.numbers()[0] - by_itself.snapshot.numbers)
    assert np.nanmax(apart_by / np.maximum(whole, 1.0)) < 1e-3


def test_forces_set_in_as_in_single_simulations():
    """Forces of several members given at once, the same again and others, beside one command after the other."""
    scenario = load_scenario("single_span")
    ensemble, singles = Ensemble(scenario, 3), [Simulation(scenario) for _ in range(3)]
    for time, forces in ((0.2, [0.0, 5e3, 20e3]), (0.4, [0.0, 5e3, 10e3])):
        ensemble.command("cabin", force=forces)
        ensemble.advance_to(time)
        for single, force in zip(singles, forces, strict=True):
            single.command("cabin", force=force)
            single.advance_to(time)
    for member, single in enumerate(singles):
        np.testing.assert_array_equal(ensemble.simulation(member).state.memory, single.state.memory)
    ensemble.close()


def test_threads_and_a_plain_loop_give_the_same_bits(tramways, tramway):
    tramways.fork(tramway)
    tramways.command("cabin", speed=np.linspace(0.5, 3.0, 6))
    tramways.advance_to(1.0)
    loop = []
    start = tramway.capture()
    for speed in np.linspace(0.5, 3.0, 6).tolist():
        tramway.restore(start)
        tramway.command("cabin", speed=speed)
        loop.append(tramway.advance_to(1.0).numbers)
    assert np.array_equal(tramways.numbers(), loop, equal_nan=True)
    for threads in (1, 7):
        other = Ensemble("aerial_tramway", 6, threads=threads)
        other.command("cabin", speed=np.linspace(0.5, 3.0, 6))
        other.advance_to(1.0)
        assert np.array_equal(other.numbers(), loop, equal_nan=True)
        other.close()


def test_a_fork_goes_on_with_the_bits_of_the_live_simulation(tramways, tramway):
    tramway.command("cabin", speed=4.0)
    tramway.advance_to(2.0)
    tramways.fork(tramway)
    tramways.emergency_stop(members=[1, 2])
    tramways.emergency_stop(False, members=2)
    tramways.command("cabin", speed=1.0, members=2)
    tramways.advance_to(6.0)
    gone_on = tramway.advance_to(6.0).numbers
    assert np.array_equal(tramways.numbers()[0], gone_on, equal_nan=True)
    speeds = tramways.observe(["cabin/speed"])["cabin/speed"]
    assert max(speeds[1:3]) < speeds[0]
    by_itself = tramways.simulation(1).advance_to(6.5).numbers
    tramways.advance_to(6.5)
    assert np.array_equal(by_itself, tramways.numbers()[1], equal_nan=True)


def test_chairs_are_loaded_in_stations_in_each_member_as_in_a_simulation():
    """Payloads change at stations, and parameters with them, which threads have to leave to Python."""
    ensemble, single = Ensemble("chairlift", 2, threads=2), apart("chairlift", {})
    for one in (ensemble, single):
        one.command("haul_rope", speed=2.5)
        one.advance_to(22.0)
    first = single.capture().starts[0].payload
    assert np.any(single.state.payload != first)  # some have been in a station
    assert np.array_equal(ensemble.numbers()[1], single.snapshot.numbers, equal_nan=True)
    assert not np.array_equal(ensemble.numbers()[0], apart("chairlift", {}).snapshot.numbers, equal_nan=True)
    ensemble.close()


@pytest.mark.parametrize("of", [list, np.array])
def test_members_may_be_a_mask(tramways, tramway, of):
    tramways.fork(tramway)
    tramways.command("cabin", speed=[1.0, 2.0], members=of([True, False, False, True, False, False]))
    tramways.advance_to(0.1)
    assert np.flatnonzero(abs(tramways.observe("cabin/speed").array[:, 0]) > 1e-6).tolist() == [0, 3]


def test_a_closed_ensemble_says_so():
    ensemble = Ensemble("aerial_tramway", 2, threads=2)
    ensemble.close()
    with pytest.raises(ValueError, match=r"advance_to: given an ensemble after close\(\); allowed: before it"):
        ensemble.advance_to(1.0)


def test_a_refused_command_changes_no_member_and_names_the_one(tramways, tramway):
    tramways.fork(tramway)
    before = tramways.numbers()
    with pytest.raises(CommandError, match=r"^member 5: speed of 'cabin': given 20 m/s; allowed: -10 to 10 m/s$"):
        tramways.command("cabin", speed=[1.0, 2.0, 3.0, 4.0, 5.0, 20.0])
    with pytest.raises(CommandError, match=r"^member 0: carriage or drive: given 'nobody'"):
        tramways.command("nobody", speed=1.0)
    with pytest.raises(CommandError, match="allowed: a finite number"):
        tramways.command("cabin", speed=np.nan)
    assert np.array_equal(tramways.numbers(), before, equal_nan=True)
    tramways.emergency_stop()
    with pytest.raises(CommandError, match="release it"):
        tramways.command("cabin", speed=1.0)
    tramways.apply(Command("reset", {}))
    assert np.array_equal(tramways.numbers()[:, 1:], before[:, 1:], equal_nan=True)


@pytest.mark.parametrize(
    ("parameters", "line"),
    [
        ({"cable.elements": 40}, r"^cable.elements: given 40, which needs another mesh; allowed: values that leave "),
        ({"cable.unstrained_length": 1042.3, "cable.ice": 0.1}, "^cable.unstrained_length: .* needs another mesh"),
        ({"solver.step": 0.0025}, "^solver.step: given 0.0025, which needs another solver"),
        ({"cable.elastic_model": "element_frame"}, "^cable.elastic_model: .* needs another elastic model"),
        ({"air.turbulence.seed": 2}, "^air.turbulence.seed: given 2, which needs air.turbulence in"),
        ({"cable.ice": [0.1, 0.2]}, r"^parameters: cable.ice: given 2 values; allowed: 6, one for each member"),
    ],
)
def test_values_that_members_cannot_have_are_refused_in_a_line(tramways, parameters, line):
    with pytest.raises(ValueError, match=line) as refused:
        tramways.change(parameters)
    assert "\n" not in str(refused.value)


def test_values_are_refused_with_the_lines_of_a_scenario(tramways):
    for values in ({"cable.ice": -1.0}, {"cable.no_such_key": 1.0}):
        with pytest.raises(ScenarioError) as of_scenario:
            load_scenario("aerial_tramway", values)
        with pytest.raises(ScenarioError) as of_ensemble:
            tramways.change(values)
        assert str(of_ensemble.value) == str(of_scenario.value)


def test_changed_parameters_act_on_the_present_state(tramways, tramway):
    tramways.fork(tramway)
    tramways.command("cabin", speed=2.0)
    tramways.advance_to(0.5)
    before = tramways.observe(["cabin/arc_length", "cabin/payload"])
    tramways.change({"carriages.cabin.payload.mass": [6000.0, 100.0, 100.0]}, [0, 1, 2])
    tramways.change({"air.wind.x": -20.0}, members=3)
    tramways.change({"carriages.cabin.friction.rolling": 0.02}, members=4)
    after = tramways.observe(["cabin/arc_length", "cabin/payload"])
    assert np.array_equal(before["cabin/arc_length"], after["cabin/arc_length"])
    assert after["cabin/payload"].tolist()[:3] == [6000.0, 100.0, 100.0]
    tramways.advance_to(1.0)
    numbers = tramways.numbers()
    assert np.array_equal(numbers[1], numbers[2], equal_nan=True)
    assert len({row.tobytes() for row in numbers}) == 5
    assert tramways.values[3] == {"air.wind.x": -20.0}
    tramways.change({"carriages.cabin.friction.rolling": 0.005}, members=4)
    tramways.change({"carriages.cabin.payload.mass": tramways.scenario.carriages["cabin"].payload.mass})
    tramways.change({"air.wind.x": 0.0})


def test_forked_members_keep_their_own_payload_wind_and_temperature(tramway):
    payload = "carriages.cabin.payload.mass"
    parameters = {payload: [0.0, 3200.0, 6400.0], "air.wind.x": [12.0, 0.0, 0.0], "air.temperature": [20.0, 20.0, 0.0]}
    ensemble = Ensemble("aerial_tramway", 3, parameters=parameters, threads=1)
    tramway.command("cabin", speed=2.0)
    tramway.advance_to(0.2)
    ensemble.fork(tramway)
    assert ensemble.observe(["cabin/payload"])["cabin/payload"].tolist() == parameters[payload]
    changed = Ensemble("aerial_tramway", 3, threads=1)
    changed.fork(tramway)
    changed.change(parameters)
    for one in (ensemble, changed):
        one.advance_to(0.4)
    assert np.array_equal(ensemble.numbers(), changed.numbers(), equal_nan=True)
    ensemble.apply(Command("reset", {}))  # to the start of the simulation
    ensemble.change({payload: parameters[payload]})
    assert ensemble.observe(["cabin/payload"])["cabin/payload"].tolist() == parameters[payload]


def test_forked_members_keep_their_own_payloads_of_carriers_that_have_not_been_in_a_station():
    ensemble = Ensemble("chairlift", 2, parameters={"carriers.payload.leaving.drive": [100.0, 200.0]}, threads=1)
    lift = apart("chairlift", {})
    before = [ensemble.snapshot(member).columns.payload.copy() for member in range(2)]
    full = lift.capture()
    boarded = int(np.flatnonzero(full.state.payload == 0.0)[0])
    full.state.payload[boarded] = 50.0
    lift.restore(full)
    ensemble.fork(lift)
    for member, loads in enumerate(before):
        loads[boarded] = 50.0
        assert np.array_equal(ensemble.snapshot(member).columns.payload, loads)


def test_a_begun_member_goes_on_from_its_own_scenario():
    own = {"carriages.cabin.payload.mass": 0.0, "air.wind.x": 12.0}
    friction = {"carriages.cabin.friction.rolling": 0.01}
    ensemble = Ensemble("aerial_tramway", 2, threads=1)
    ensemble.begin(load_scenario("aerial_tramway", own), 1)
    ensemble.change(friction, 1)
    assert ensemble.values == ({}, friction)
    assert ensemble.simulation(1).scenario == load_scenario("aerial_tramway", {**own, **friction})
    ensemble.fork(apart("aerial_tramway", {}), 1)
    assert ensemble.observe(["cabin/payload"])["cabin/payload"].tolist() == [6400.0, 0.0]


def test_a_member_that_ends_says_why_and_the_others_go_on():
    ensemble = Ensemble(load_scenario("single_span"), 3, threads=1)
    ensemble.command("cabin", speed=1.0)
    states = ensemble._states
    states.block["0/nodes.velocity" if "0/nodes.velocity" in states.block.dtype.fields else "nodes.velocity"][1] = 1e9
    ensemble.advance_to(0.5)
    assert list(ensemble.faults) == [1]
    assert "failed: after" in ensemble.faults[1]
    assert ensemble.times.tolist() == [0.5, ensemble.times[1], 0.5]
    assert ensemble.times[1] < 0.5
    ensemble.advance_to(0.6)
    assert ensemble.times[0] == 0.6
    ensemble.apply(Command("reset", {}), members=1)
    ensemble.advance_to(1.0)
    assert not ensemble.faults
    ensemble.close()


def test_key_figures_are_columns_over_the_members():
    ensemble = Ensemble("single_span", 2, figures_period=0.05, threads=1)
    ensemble.command("cabin", speed=[0.2, 4.0])
    ensemble.advance_to(2.0)
    figures = ensemble.figures()
    assert figures.array.shape == (2, len(figures)) == (2, len(figures.units))
    fastest = figures["cabin: speed"]
    assert fastest[1] > fastest[0] > 0.0
    with pytest.raises(ValueError, match="allowed: with figures_period"):
        Ensemble("single_span", 1).figures()
    ensemble.close()


@pytest.mark.parametrize(
    ("name", "space"),
    [
        pytest.param(*one, marks=[pytest.mark.long] * (one not in KINDS))
        for one in itertools.product(scenario_names(), (2, 3))
    ],
)
def test_key_figures_of_members_are_those_of_a_simulation(name, space):
    scenario = load_scenario(name, {"space": 3} if space == 3 else {})
    drives = [*scenario.drives, *(key for key, one in scenario.carriages.items() if one.drive.mode == "speed")][:1]
    ensemble = Ensemble(scenario, 2, figures_period=0.05, threads=2)
    single = Simulation(scenario)
    expected = KeyFigures(scenario)
    expected.update(single.snapshot)
    for one, drive in itertools.product((ensemble, single), drives):
        one.command(drive, speed=0.5)
    for time in (0.05, 0.1, 0.15):
        expected.update(single.advance_to(time))
    ensemble.advance_to(0.15)
    found = ensemble.figures()
    ensemble.close()
    assert [*found] == [one.name for one in expected.figures()]
    for one in expected.figures():
        assert np.array_equal(found[one.name], [one.value] * 2, equal_nan=True), one.name


@pytest.mark.parametrize(("name", "drive"), [("single_span", "cabin"), ("chairlift", "haul_rope")])
def test_key_figures_of_members_have_their_stops(name, drive):
    ensemble, single = Ensemble(name, 2, figures_period=0.05, threads=2), Simulation(load_scenario(name))
    expected = KeyFigures(single.scenario)
    expected.update(single.snapshot)
    ensemble.command(drive, speed=[0.5, 0.2])
    expected.command(single.command(drive, speed=0.5))
    ensemble.advance_to(2.0)
    for frame in range(1, 41):
        expected.update(single.advance_to(0.05 * frame))
    ensemble.emergency_stop()
    expected.command(single.emergency_stop())
    ensemble.advance_to(3.5)
    for frame in range(41, 71):
        expected.update(single.advance_to(0.05 * frame))
    found = ensemble.figures()
    ensemble.close()
    stops = [one for one in expected.figures() if "stop" in one.id.quantity or one.id.quantity == "mean_deceleration"]
    assert len(stops) >= 4
    for one in stops:
        assert found[one.name][0] == one.value, one.name
        assert found[one.name][1] != one.value, one.name


def test_a_fork_at_times_is_one_at_each(tramways, tramway):
    tramway.command("cabin", speed=4.0)
    start, times = tramway.capture(), [0.5, 0.2, 0.4]
    tramways.fork(tramway, [3, 1, 2], at=times)
    for member, time in zip([3, 1, 2], times, strict=True):
        tramway.restore(start)
        expected = tramway.advance_to(time).numbers
        assert np.array_equal(tramways.snapshot(member).numbers, expected, equal_nan=True)
    with pytest.raises(ValueError, match=r"fork: at: given 0.1 s for member 0; allowed: a finite time, from 0.4 s"):
        tramways.fork(tramway, 0, at=0.1)


def test_the_page_of_ensembles_has_many_stops_in_two_lines_more(tmp_path, monkeypatch):
    """Besides the import of numpy; with three stops, soon after the start."""
    text = (ROOT / "docs" / "ensemble.md").read_text(encoding="utf-8")
    one, many = re.findall(r"^```python\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)[:2]
    assert len(many.splitlines()) == len(one.splitlines()) + 2 + 1
    many = many.replace("uniform(40.0, 105.0, 200)", "uniform(0.2, 0.9, 3)").replace('tramway", 200)', 'tramway", 3)')
    assert "200" not in many
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "agg")
    exec(many.replace("+ 25.0", "+ 1.0"), {})
    assert (tmp_path / "stops.png").stat().st_size > 1000


@pytest.mark.parametrize("arguments", [{"members": 0}, {"members": 1.5}, {"members": 2, "threads": 0}])
def test_wrong_arguments_are_refused_in_a_line(arguments):
    with pytest.raises(ValueError, match="allowed: a whole number from 1"):
        Ensemble("single_span", **arguments)


def test_times_and_members_are_checked(tramways, tramway):
    tramways.fork(tramway)
    with pytest.raises(ValueError, match="given nan s for member 0; allowed: a finite time"):
        tramways.advance_to(np.nan)
    wrong = {
        r"advance_to: given 1e\+300 s for member 0; allowed: .* up to ": lambda: tramways.advance_to(1e300),
        r"advance_to: given \[1, 2\]; allowed: one number, or 6,": lambda: tramways.advance_to([1, 2]),
        "speed: given fast; allowed: one number, or 1,": lambda: tramways.command("cabin", speed="fast", members=0),
        r"fork: at: given \[1, 2\]; allowed: one number, or 6,": lambda: tramways.fork(tramway, at=[1, 2]),
        "members: given 6; allowed: 0 to 5, or a mask of all 6": lambda: tramways.fork(tramway, 6),
        "members: given True; allowed": lambda: tramways.emergency_stop(members=True),
        "members: given True; allowed: 0": lambda: tramways.emergency_stop(members=[True, False]),
        "members: given 1.5; allowed": lambda: tramways.emergency_stop(members=1.5),
        "member: given slice": lambda: tramways.snapshot(slice(0, 2)),
        r"parameters: given \[1\]; allowed: a mapping": lambda: tramways.change([1]),
        "command: given 'release'; allowed: a `Command`": lambda: tramways.apply("release"),
        "command: given None; allowed: a `Command`": lambda: tramways.apply(None),
        "members: given 2 twice; allowed: each of 0 to 5 once": lambda: tramways.emergency_stop(members=[2, 1, 2]),
        "fork: given 'x'; allowed: a Simulation of 'aerial_tramway'": lambda: tramways.fork("x", at=1.0),
        "observations: given 'nothing'": lambda: tramways.observe("nothing"),
        "samples: given 1; allowed: a whole number from 2": lambda: Ensemble("single_span", 1, samples=1),
        "scenario: given 'single_span'; allowed: a Scenario": lambda: tramways.begin("single_span", 0),
    }
    for line, ask in wrong.items():
        with pytest.raises((TypeError, ValueError), match=line):
            ask()
    with pytest.raises(ValueError, match="another scenario"):
        tramways.fork(apart("single_span", {}))
    with pytest.raises(TypeError, match="given an Ensemble; allowed: a Simulation"):
        copy.deepcopy(tramways)
