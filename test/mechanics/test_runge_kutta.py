import warnings

import numpy as np
import pytest

from cable_twin.mechanics.solution.runge_kutta import stable_step
from cable_twin.scenario import build_system, load_scenario
from cable_twin.simulation import Simulation, SolverError
from verification import JIT
from verification.models import beam, changing

SEED = {"cable.elements": 4, "solver.integrator": "runge_kutta", "solver.step": 4e-5}


def bar(elements=3, *, damping_time=0.0, bending=1e-3, **solver):
    return beam(
        length=3.0,
        mass_per_length=2.0,
        axial=5e3,
        bending=bending,
        elements=elements,
        supports=("pinned", "pinned"),
        gravity=0.0,
        damping_time=damping_time,
        **solver,
    )


def stable(**overrides):
    return stable_step(bar(**overrides).system)


def test_stable_step_is_that_of_bending_where_that_is_faster():
    # slopes in step: (8 + 2 * 2) / (2/105 - 2/140); slopes against each other: (8 - 2 * 2) / (2/105 + 2/140)
    frequency = np.sqrt(12.0 * 210.0 * 1e6 / 2.0)
    assert stable(bending=1e6) == pytest.approx(np.sqrt(8.0) / frequency, rel=1e-9)


def test_stable_step_falls_with_damping():
    crossing = np.sqrt(2.0 / 5e3)
    rate = 0.1 * 42.0 / crossing**2
    assert stable(damping_time=0.1) == pytest.approx(2.785 / rate, rel=1e-9)


@pytest.mark.parametrize("damping_time", [0.0, 0.05])
@pytest.mark.parametrize(("share", "grows"), [(0.95, False), (1.05, True)])
def test_stable_step_is_where_the_motion_stops_being_bounded(damping_time, share, grows):
    step = share * stable(damping_time=damping_time)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        simulation = bar(damping_time=damping_time, integrator="runge_kutta", step=step)
    with changing(simulation) as state:
        velocities = state.nodes.velocity
        slopes = 1e-6 * np.random.default_rng(5).standard_normal(velocities[:, 1].shape)
        velocities[:, 1:] = slopes[:, None]
    before = simulation.energy().total
    try:
        simulation.advance_to((2000 if JIT else 300) * step)
    except SolverError:
        assert grows
    else:
        assert (simulation.energy().total > before) == grows


def test_a_step_above_it_is_warned_of():
    limit = stable_step(build_system(load_scenario("seed_example", SEED)))
    assert limit > 4e-5
    with pytest.warns(UserWarning, match=r"solver\.step of 0\.0001 s is above the largest stable one"):
        Simulation(load_scenario("seed_example", {**SEED, "solver.step": 1e-4}))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        Simulation(load_scenario("seed_example", SEED))


@pytest.mark.parametrize("model", ["continuum", pytest.param("element_frame", marks=pytest.mark.long)])
def test_agrees_with_the_default(model):
    time = 0.02 if JIT else 0.004
    common = {"cable.elements": 4, "cable.elastic_model": model}
    paper = Simulation(load_scenario("seed_example", {**SEED, **common}))
    default = Simulation(load_scenario("seed_example", {**common, "solver.step": 2e-5, "solver.tolerance": 1e-9}))
    got, want = paper.advance_to(time), default.advance_to(time)
    np.testing.assert_allclose(
        got.carriages["carriage"].position, want.carriages["carriage"].position, atol=2e-5 * 10 * time
    )
    assert 0.0 < got.solver.constraint_residual < 1e-9
    assert got.solver.iterations == 0


def test_a_driven_joint_follows_its_reference():
    simulation = Simulation(
        load_scenario(
            "seed_example",
            {
                **SEED,
                "carriages.carriage.drive.mode": "speed",
                "carriages.carriage.drive.limits.acceleration": 2.0,
            },
        )
    )
    simulation.command("carriage", speed=-0.5)
    time = 250 * 4e-5 if JIT else 50 * 4e-5
    car = simulation.advance_to(time).carriages["carriage"]
    assert car.arc_length == pytest.approx(3.2 - 0.5 * 2.0 * time**2, abs=1e-12)
    assert car.speed == pytest.approx(-2.0 * time)
    assert np.linalg.norm(car.position - car.bodies["rb1"].position) == pytest.approx(0.5, abs=1e-6)


def test_a_motion_that_is_no_number_is_taken_back():
    simulation = Simulation(load_scenario("seed_example", SEED))
    simulation.advance_to(4e-5)
    good = simulation.snapshot.time
    with changing(simulation) as state:
        state.nodes.velocity[2, 0, 0] = np.nan
    with pytest.raises(SolverError):
        simulation.advance_to(8e-5)
    assert simulation.time == good


def test_no_snapshot_holds_what_is_no_number_when_the_motion_blows_up():
    with pytest.warns(UserWarning, match="will not stay finite"):
        simulation = bar(integrator="runge_kutta", step=1.5 * stable())
    with changing(simulation) as state:
        state.nodes.velocity[1, 1:] = 1e-3
    with pytest.raises(SolverError):
        simulation.advance_to(2000 * simulation.step)
    snapshot = simulation.snapshot
    assert np.abs(snapshot.cable.positions).max() > 1e10
    for numbers in (snapshot.cable.positions, snapshot.cable.tensions, snapshot.supports["end"].force):
        assert np.isfinite(numbers).all()
    assert np.isfinite(simulation.energy().total)
