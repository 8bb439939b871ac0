"""Vehicles meeting on one rope: buffer forces in all outputs. Closed forms: `verification`."""

import numpy as np
import pytest
import test_loads
from test_simulation import same

from cable_twin.key_figures import KeyFigures
from cable_twin.messages.figure_messages import describe
from cable_twin.offline import replay, simulate
from cable_twin.runtime.watches import FigureWatch
from cable_twin.scenario import build_system, load_scenario
from cable_twin.simulation import EquilibriumError, Simulation, SolverError
from cable_twin.simulation.vehicle_contacts import with_buffers
from verification.vehicle_buffers import level, vehicle


def two_cabins(size=(2.0, 3.0), force=None, **places):
    """Cabins 2 m long at 10 and 40 m, driven without haul ropes, with or without a force limit (N)."""
    data = test_loads.scenario().resolved()
    cabins = {
        name: {
            "arc_length": places.get(name, place),
            "drive": {"mode": "speed", "limits": {"acceleration": 2.0, "force": force}},
            "bodies": {"cabin": {**test_loads.CABIN, "size": list(size)}},
        }
        for name, place in (("down", 40.0), ("up", 10.0))  # the order of the file is none of theirs
    }
    return load_scenario({**data, "carriages": cabins})


def meet(simulation, times):
    simulation.command("up", speed=5.0)
    simulation.command("down", speed=-5.0)
    for time in times:
        yield simulation.advance_to(time)


def test_too_few_steps_for_the_force_of_buffers_are_warned_of_with_a_step_that_does():
    """Of 1e5 N/m in series and 100 kg each: apart after π √(50 / 5e4) s; measured in eight steps and in a hundred."""
    vehicles = [vehicle(4.0, 1.0, 100.0), vehicle(7.0, -1.0, 100.0)]
    with pytest.warns(UserWarning, match=r"0\.02 s: 'vehicle_0' and 'vehicle_1', .* in 5\.0 steps; .* 0\.012 s"):
        level(vehicles, 0.02)
    forces = [level(vehicles, step).advance_to(1.5).columns.push_highest[0] for step in (0.012, 0.001)]
    assert forces[0] == pytest.approx(forces[1], rel=0.05)


def test_two_cabins_push_each_other_whatever_the_pacing():
    simulation = Simulation(two_cabins(force=2500.0), samples=5)
    figures = KeyFigures(simulation.scenario)
    watch = FigureWatch(figures)
    told, least = [], np.inf
    for snapshot in meet(simulation, 0.05 * np.arange(1, 91)):
        watch.update(snapshot)
        watch.statuses()
        told += watch.take_messages()
        least = min(least, snapshot.carriages["down"].arc_length - snapshot.carriages["up"].arc_length)
    assert 1.0 < least < 2.0
    # 30 m less what a ramp to 5 m/s at 2 m/s² takes, at 10 m/s, until 2 m are left; the rope is stretched a little
    met = 2.5 + (28.0 - 2 * 6.25) / 10.0
    [line] = [line for line in told if not line.startswith("limit not kept")]
    assert line.startswith("'up' and 'down' touch at 4.0")
    touch = figures.touches()[0]
    assert (touch.vehicle, touch.other) == ("up", "down")
    assert touch.time == pytest.approx(met, abs=0.05)
    assert touch.speed == pytest.approx(10.0, rel=0.01)
    [figure] = [figure for figure in figures.figures() if figure.id.quantity == "buffer_force"]
    assert figure.value > 2500.0
    assert figure.value == simulation.state.push[1, 1]
    assert "met at 10 m/s" in describe(figure)
    assert snapshot.carriages["down"].push == 0.0  # of the one before the other
    again = Simulation(two_cabins(force=2500.0), samples=5)
    *_, last = meet(again, [4.5])
    assert same(last, snapshot)
    simulation.reset()
    assert simulation.advance_to(simulation.time + 0.5).carriages["up"].arc_length == pytest.approx(10.0)
    assert not simulation.state.push[:, 1].any()


def test_drives_without_a_limit_press_them_through_each_other_and_the_run_ends():
    lines = []
    for times in ([20.0], 0.01 * np.arange(1, 600)):
        simulation = Simulation(two_cabins(), samples=5)
        with pytest.raises(SolverError, match=r"^'up' and 'down' are pressed through each other .* kN; allowed") as e:
            list(meet(simulation, times))
        lines.append(str(e.value))
        with pytest.raises(SolverError, match="pressed through"):
            simulation.advance_to(30.0)
    assert lines[0] == lines[1]


@pytest.mark.parametrize("up", [10.0, 10.05, 10.2, *(pytest.param(up, marks=pytest.mark.long) for up in (10.1, 10.35))])
def test_points_without_size_may_pass(up):
    """Wherever in an element they do; the joint is the paper's, unless another one is asked for."""
    simulation = Simulation(two_cabins(size=[0.0, 0.0], up=up), samples=5)
    highest = 0.0
    for snapshot in meet(simulation, 0.1 * np.arange(1, 91)):
        highest = max(highest, np.abs(snapshot.columns.contact_force).max())
    assert snapshot.carriages["up"].arc_length > snapshot.carriages["down"].arc_length
    assert not simulation.system.buffers.present
    assert highest < 3.0 * 200.0 * 9.81  # N, of the weight of a cabin
    assert np.abs(simulation.state.bodies.position[:, 2]).max() < 1.0  # rad
    assert simulation.scenario.joint == "paper"
    assert two_cabins().joint == "node"


def test_cabins_that_start_within_each_other_are_refused():
    with pytest.raises(
        EquilibriumError, match=r"^carriages.up.arc_length: given 39 m, too near to 'down' at 38.5 m; .* 2 m"
    ):
        Simulation(two_cabins(up=39.0, down=38.5))


def test_who_can_meet_whom():
    """Neighbours; points pass each other, so all points between two blocks can meet both."""
    data = two_cabins().resolved()
    block = data["carriages"]["up"]
    point = {**block, "bodies": {"cabin": {**test_loads.CABIN, "size": [0.0, 0.0]}}}
    row = {"a": (block, 50.0), "p": (point, 30.0), "q": (point, 20.0), "b": (block, 10.0), "c": (block, 5.0)}
    scenario = load_scenario(
        {**data, "carriages": {name: {**one, "arc_length": place} for name, (one, place) in row.items()}}
    )
    buffers = with_buffers(build_system(scenario), scenario).buffers
    names = list(row)
    found = {
        names[one]: {names[other] for other in buffers.other[buffers.offset[one] : buffers.offset[one + 1]]}
        for one in range(len(names))
    }
    assert found == {"a": {"p", "q", "b"}, "p": {"a", "b"}, "q": {"a", "b"}, "b": {"c", "p", "q", "a"}, "c": {"b"}}
    own = {"stiffness": 3e5, "damping": 0.4}
    softer = load_scenario(scenario.resolved(), {"carriages.b.buffers": own, "carriages.c.buffers": {"stiffness": 6e5}})
    buffers = with_buffers(build_system(softer), softer).buffers
    last = buffers.offset[-1] - 1  # c against b
    assert buffers.stiffness[last] == pytest.approx(2e5)
    assert buffers.damping[last] == pytest.approx(0.4 * (2 / 3) ** 2 + (0.5 / (0.5 * np.sqrt(9.81 * 60.9))) / 9)
    assert buffers.stiffness[buffers.offset[1] + 1] == pytest.approx(3e5)  # of a point against b: of b alone


@pytest.mark.long
@pytest.mark.parametrize("changes", [{"space": 3}, {"solver.integrator": "runge_kutta"}])
def test_space_and_runge_kutta_agree_with_the_plane(changes):
    plane = level([vehicle(4.0, 1.5, 100.0, 0.6), vehicle(7.0, -0.5, 100.0, 0.6)], step=2e-4)
    other = Simulation(load_scenario(plane.scenario.resolved(), changes))
    expected, got = (simulation.advance_to(1.15).columns for simulation in (plane, other))
    close = 1e-9 if "space" in changes else 1e-6
    np.testing.assert_allclose(got.arc_length, expected.arc_length, rtol=0, atol=close)
    np.testing.assert_allclose(got.speed, expected.speed, rtol=0, atol=close)
    assert got.push_highest[0] == pytest.approx(expected.push_highest[0], rel=1e-4)
    assert got.speed[1] > got.speed[0]


def test_on_one_of_several_ropes_as_on_one_alone():
    one = level([vehicle(4.0, 1.5, 100.0, 0.6), vehicle(7.0, -0.5, 300.0, 0.6)])
    data = one.scenario.resolved()
    rope = data.pop("cable")
    beside = {**rope, "start": {"position": [0.0, 3.0]}, "end": {"position": [20.0, 3.0]}}
    data["carriages"] = {name: {**carriage, "rope": "own"} for name, carriage in data["carriages"].items()}
    several = Simulation(load_scenario({**data, "ropes": {"beside": beside, "own": rope}}))
    expected, got = (simulation.advance_to(1.2) for simulation in (one, several))
    np.testing.assert_allclose(got.columns.speed, expected.columns.speed, rtol=0, atol=1e-8)
    np.testing.assert_allclose(got.columns.push_highest, expected.columns.push_highest, rtol=1e-7)
    figures = KeyFigures(several.scenario)
    figures.update(got)
    assert [(touch.vehicle, touch.other) for touch in figures.touches()] == [("vehicle_0", "vehicle_1")]


def test_a_haul_rope_takes_the_push_and_the_track_rope_none():
    """Cabin pulled by its haul rope against a trolley held by its drive."""
    hold = {"acceleration": 2.0, "force": 3e4}
    scenario = test_loads.scenario(
        **{"carriages.cabin.arc_length": 24.0, "carriages.trolley.drive.limits": hold, "solver.spectral_radius": 0.3}
    )
    simulation = Simulation(scenario, samples=5)
    simulation.command("cabin", force=1500.0)
    pushed = []
    for time in np.arange(13.0, 30.0, 0.1):
        columns = simulation.advance_to(float(time)).columns
        pushed.append(columns.push[0])
        here = columns.arc_length[0] + np.array([-1e-4, 1e-4])
        along = np.subtract(*simulation.cable_positions(here)[::-1])
        along /= np.linalg.norm(along)
        contact = columns.contact_force[0]
        assert abs(contact @ along) < 5e-3 * max(np.linalg.norm(contact), 200.0 * 9.81)  # it rolls without friction
    assert max(pushed) > 1500.0
    weight = 200.0 * 9.81 * along[2]
    assert np.mean(pushed[50:]) == pytest.approx(1500.0 - weight, rel=0.1)


def test_goes_on_from_a_snapshot_in_the_middle_of_a_push(tmp_path):
    simulation = level([vehicle(4.0, 1.5, 100.0, 0.6), vehicle(7.0, -0.5, 100.0, 0.6)])
    simulation.advance_to(1.03)
    assert simulation.snapshot.carriages["vehicle_0"].push > 0.0
    simulation.save(tmp_path / "pushed.npz")
    loaded = Simulation.load(tmp_path / "pushed.npz")
    last, again = (one.advance_to(1.5) for one in (simulation, loaded))
    assert same(last, again)


def test_simulate_says_it_and_the_log_replays_to_the_last_bit(tmp_path, capsys):
    (tmp_path / "two.yaml").write_text(two_cabins(force=2500.0).to_yaml())
    (tmp_path / "script.yaml").write_text(
        "- {time: 0.1, name: up, speed: 5.0}\n- {time: 0.1, name: down, speed: -5.0}\n"
    )
    logs = ["--script", str(tmp_path / "script.yaml"), "--output", str(tmp_path / "logs"), "--duration", "5"]
    assert simulate.main([str(tmp_path / "two.yaml"), *logs]) == 0
    said = capsys.readouterr()
    assert "up and down: buffer force, highest" in said.out
    assert "simulate: warning: up and down: buffer force, highest: " in said.err
    [run] = (tmp_path / "logs").iterdir()
    assert replay.main([str(run)]) == 0
