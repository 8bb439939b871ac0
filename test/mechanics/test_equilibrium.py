"""Equilibrium: catenary, hanging chains, residual forces; errors where no equilibrium exists or a step fails."""

import re

import numpy as np
import pytest
from scipy.integrate import quad
from systems import turned

from cable_twin.mechanics.language.declared import arrays_of, clone
from cable_twin.mechanics.parameters import SPEED
from cable_twin.mechanics.rope.point import position_on_cable
from cable_twin.mechanics.solution.bundle.assembly import Assembly, Rope
from cable_twin.mechanics.solution.catenary import rest_over_supports
from cable_twin.mechanics.solution.equations_of_motion import assemble, largest_gap, solve_accelerations
from cable_twin.mechanics.solution.equilibrium import EquilibriumError, catenary, lay_straight, settle
from cable_twin.mechanics.solution.generalized_alpha import advance
from cable_twin.mechanics.solution.relaxation import MAX_RELAXATIONS, hang_carriages
from cable_twin.mechanics.solution.stepping import Outcome
from cable_twin.mechanics.state import allocate_state, allocate_workspace
from cable_twin.scenario import build_system, load_scenario
from cable_twin.simulation import Simulation, SolverError
from cable_twin.simulation.engine import leave_out_absent
from verification.models import changing
from verification.statics import CANTILEVER, LEVEL_SPAN

TWO_BODIES = {
    "upper": {"mass": 300.0, "inertia": 50.0, "upper_pivot": [0.2, 0.5], "lower_pivot": [-0.1, -0.6]},
    "lower": {"mass": 900.0, "inertia": 400.0, "upper_pivot": [0.3, 1.0]},
}


def loaded_span(elements=16, **changes):
    scenario = {**LEVEL_SPAN, "carriages": {"one": {"arc_length": 40.0, "bodies": TWO_BODIES}}}
    return load_scenario(scenario, {"cable.elements": elements, **changes})


def prepare(scenario):
    (system,) = leave_out_absent([build_system(scenario)])  # the kernels are those of a simulation
    state, work = allocate_state(system), allocate_workspace(system)
    for index, carriage in enumerate(scenario.carriages.values()):
        state.joints.position[index] = carriage.arc_length
    return system, state, work


@pytest.mark.parametrize("rise", [-60.0, 0.0, 30.0])
@pytest.mark.parametrize("length", [130.0, 106.0])
def test_catenary_is_the_integral_of_its_slope(rise, length):
    """Ends met to 1e-7 m; each place is the integral of r_x = (1/EA + 1/T) (H, V + w s), to 1e-8 m."""
    if rise == -60.0 and length == 106.0:
        length = 117.0
    scenario = load_scenario(LEVEL_SPAN, {"cable.end.position": [100.0, rise], "cable.unstrained_length": length})
    system = build_system(scenario)
    arc_lengths = np.linspace(0.0, length, 7)
    positions, slopes = catenary(system, arc_lengths)
    np.testing.assert_allclose(positions[[0, -1]], [[0.0, 0.0], [100.0, rise]], atol=1e-4 * length * 1e-2)
    tension = (np.linalg.norm(slopes, axis=1) - 1.0) * 2e7
    pull = tension[:, None] * slopes / np.linalg.norm(slopes, axis=1)[:, None]
    np.testing.assert_allclose(pull[:, 0], pull[0, 0], rtol=1e-6)
    np.testing.assert_allclose(np.diff(pull[:, 1]), 98.1 * np.diff(arc_lengths), rtol=1e-5)

    def slope(s, axis):
        at = np.array([pull[0, 0], pull[0, 1] + 98.1 * s])
        return (1.0 / 2e7 + 1.0 / np.hypot(*at)) * at[axis]

    for k in (2, 5):
        exact = [quad(slope, 0.0, arc_lengths[k], args=(axis,), epsabs=1e-11)[0] for axis in (0, 1)]
        np.testing.assert_allclose(positions[k], exact, atol=1e-5)


def test_catenary_without_gravity_is_straight():
    scenario = load_scenario(LEVEL_SPAN, {"gravity": 0.0, "cable.end.position": [101.5, 0.0]})
    positions, slopes = catenary(build_system(scenario), np.array([0.0, 50.5, 101.0]))
    np.testing.assert_allclose(positions, [[0, 0], [50.75, 0], [101.5, 0]], atol=1e-12)
    np.testing.assert_allclose(slopes, np.tile([101.5 / 101.0, 0.0], (3, 1)), rtol=1e-14)


def test_chains_hang_below_their_joint():
    system, state, _ = prepare(loaded_span())
    lay_straight(system, state, np.zeros(2), np.array([101.0, 0.0]))
    hang_carriages(system, state)
    np.testing.assert_allclose(state.bodies.position, [[39.8, -0.5, 0.0], [39.4, -2.1, 0.0]], atol=1e-12)


def test_all_forces_balance_at_rest():
    """Residual of every free row below 1e-5 N (of 11 kN), gaps below 1e-9 m, every mass centre under its pivot."""
    system, state, work = prepare(loaded_span())
    settle(system, state, work)
    state.drives.mode[:] = SPEED
    state.reference.position[:] = state.joints.position
    assert largest_gap(system, state, work, True) < 1e-9
    assemble(system, state, 0.0, 0.0, 1.0, work)
    # right_side holds minus the residual once what the carriages still have to close is taken off, which is nothing
    assert np.abs(work.right_side).max() < 1e-5
    np.testing.assert_allclose(state.multipliers, [[0.0, 1200.0 * 9.81], [0.0, 900.0 * 9.81]], atol=1e-6)
    # the lower body hangs plumb; the moments on the upper one balance
    place = position_on_cable(system.cable, state, 40.0)
    joint = state.bodies.position[1, :2] + turned(state.bodies.position[1, 2], [0.3, 1.0])
    assert joint[0] == pytest.approx(state.bodies.position[1, 0], abs=1e-9)
    moment = 300.0 * (state.bodies.position[0, 0] - place[0]) + 900.0 * (joint[0] - place[0])
    assert moment == pytest.approx(0.0, abs=1e-6)


def test_rest_is_rest():
    """Accelerations of eq. 16 at rest, joint held: below 1e-5 m/s² for the bodies."""
    system, state, work = prepare(loaded_span(**{"carriages.one.joint": "fixed"}))
    settle(system, state, work)
    assert solve_accelerations(system, state, 0.0, work)
    assert np.abs(state.bodies.acceleration).max() < 1e-5
    for array in (state.nodes.velocity, state.bodies.velocity, state.joints.velocity):
        assert not array.any()


@pytest.mark.parametrize("joint", ["paper", "node"])
def test_held_joint_reports_its_drive_force(joint):
    """Holding force equal to the weight along the mean of both sides of the rope, by the cosine of half its bend."""
    simulation = Simulation(loaded_span(**{"carriages.one.joint": "fixed", "cable.joint": joint}))
    places = simulation.cable_positions(np.array([40.0 - 1e-4, 40.0, 40.0 + 1e-4]))
    before, after = (side / np.linalg.norm(side) for side in np.diff(places, axis=0))
    along = (before + after) / np.linalg.norm(before + after)
    exact = 1200.0 * 9.81 * along[2] / (along @ after)
    assert simulation.snapshot.carriages["one"].drive_force == pytest.approx(exact, rel=1e-6)


def test_hanging_cable_carries_its_own_weight():
    """One end free: support force m g L, and the stretch w L² / (2 EA) of a vertical rope, to 1e-9 m."""
    free = {"position": [0.0, -101.0], "support": "free"}
    simulation = Simulation(load_scenario(LEVEL_SPAN, {"cable.end": free, "cable.elements": 8}))
    np.testing.assert_allclose(simulation.snapshot.supports["start"].force, [0.0, 0.0, 98.1 * 101.0], atol=1e-5)
    end = simulation.cable_positions(np.array([101.0]))[0]
    np.testing.assert_allclose(end, [0.0, 0.0, -101.0 - 98.1 * 101.0**2 / (2 * 2e7)], atol=1e-9)


def test_a_problem_without_rest_says_so():
    """Stiff bar on a pin with a moment of 9 N m, above the m g L² / 2 = 4.9 N m of its weight: endless rotation.

    The error names iterations, far fewer than the most, how far the last one moved a point, where, and what is allowed.
    """
    said = r"after ([0-9]+) iterations: the last one moved a point by [0-9].* m, nodes most at .* m of the rope; "
    with pytest.raises(EquilibriumError, match=said + "allowed: 1e-09 m") as caught:
        Simulation(load_scenario(CANTILEVER, bar_on_a_pin(9.0)))
    assert int(re.search(said, str(caught.value))[1]) < 0.5 * MAX_RELAXATIONS
    assert Simulation(load_scenario(CANTILEVER, bar_on_a_pin(4.0))).time == 0.0


def bar_on_a_pin(moment):
    return {
        "gravity": 9.81,
        "cable.bending_stiffness": 1e3,
        "cable.start": {"position": [0.0, 0.0], "support": "pinned"},
        "cable.loads": [{"arc_length": 0.0, "moment": moment}],
        "cable.elements": 2,
    }


@pytest.mark.parametrize("moment", [-4.0, 2.0])
def test_a_bar_leans_until_its_weight_balances_a_moment(moment):
    """Angle asin(2 M / (m g L²)) from the plumb line, right-handed about y: to 1e-3 rad with EI of 1000 N m²."""
    end = Simulation(load_scenario(CANTILEVER, bar_on_a_pin(moment))).cable_positions(np.array([1.0]))[0]
    lean = np.arcsin(2.0 * moment / 9.81)
    np.testing.assert_allclose(end, [-np.sin(lean), 0.0, -np.cos(lean)], atol=1e-3)


def test_a_weightless_cable_on_a_pin_has_no_place_of_rest():
    weightless = {**bar_on_a_pin(0.0), "gravity": 0.0}
    with pytest.raises(EquilibriumError, match="any direction"):
        Simulation(load_scenario(CANTILEVER, weightless))


@pytest.mark.parametrize("length", [99.9, 101.0])
@pytest.mark.parametrize("end", [[0.0, -100.0], [0.02, 100.0]], ids=["down", "up"])
def test_cable_of_a_vertical_span_ends_at_its_support(end, length):
    """Both ends exactly at their supports, taut and slack, with the weight on both."""
    simulation = Simulation(load_scenario(LEVEL_SPAN, {"cable.end.position": end, "cable.unstrained_length": length}))
    ends = [[0.0, 0.0, 0.0], [end[0], 0.0, end[1]]]
    np.testing.assert_allclose(simulation.cable_positions(np.array([0.0, length])), ends, atol=1e-12)
    forces = [simulation.snapshot.supports[name].force for name in ("start", "end")]
    np.testing.assert_allclose(sum(forces), [0.0, 0.0, 98.1 * length], atol=1e-4)


def test_ends_that_no_catenary_meets_are_named():
    """Weight beyond floating point, at which the search for a catenary ends."""
    system, state, work = prepare(load_scenario(LEVEL_SPAN, {"cable.elements": 2}))
    system = system._replace(cable=system.cable._replace(mass_per_length=1e307))
    with np.errstate(all="ignore"), pytest.raises(EquilibriumError, match="no catenary of 101 m reaches over 100 m"):
        settle(system, state, work)


def test_a_catenary_that_would_push_is_told_as_one():
    """Formerly `it misses by 1.56e-11 m`."""
    weight = dict.fromkeys(("direction", "mass", "travel"))
    changes = {f"cable.start.{key}": value for key, value in weight.items()} | {"cable.start.support": "pinned"}
    changes |= {"cable.unstrained_length": 6000.0, "towers.tower.position": [100.0, 400.0]}
    system = build_system(load_scenario("aerial_tramway", changes))
    with pytest.raises(EquilibriumError, match="over a tower: the one found would push, as an arch; allowed: another"):
        rest_over_supports(system)


@pytest.mark.parametrize("field", ["nodes.position", "nodes.velocity", "bodies.position", "joints.velocity"])
def test_not_a_number_stops_the_solver_and_is_named(field):
    """Outcome with an element at the faulty node, and an unchanged state.

    What a carriage passes on is on the whole right side at once, so no element is to blame then.
    """
    system, state, work = prepare(loaded_span(elements=6))
    settle(system, state, work)
    alone = Assembly([Rope(system, state, work)])
    assert Outcome(*advance(*alone.arguments, 2)).converged
    array = arrays_of(state)[field]
    if field.startswith("nodes"):
        array[4, 0, 1] = np.nan
    else:
        array.ravel()[0] = np.nan
    at_call = clone(state)
    outcome = Outcome(*advance(*alone.arguments, 5))
    assert not outcome.converged
    assert outcome.steps == 0
    assert outcome.halvings == system.solver.max_halvings + 1
    assert outcome.element in ((3, 4) if field.startswith("nodes") else range(6))
    for one, other in zip(arrays_of(state).values(), arrays_of(at_call).values(), strict=True):
        np.testing.assert_array_equal(one, other)
    assert state.clock[0] == 2


def test_not_a_number_reaches_no_snapshot():
    """Error with step and element; a state without NaN continues in the same simulation."""
    simulation = Simulation(loaded_span(elements=6))
    simulation.advance_to(0.002)
    kept = simulation.state.nodes.velocity[4, 0, 1]
    with changing(simulation) as state:
        state.nodes.velocity[4, 0, 1] = np.nan
    with pytest.raises(SolverError, match=r"step 3 \(to 0\.003 s\) failed: .* on element [34], .* at 0\.002 s"):
        simulation.advance_to(0.01)
    with changing(simulation) as state:
        state.nodes.velocity[4, 0, 1] = kept
    assert simulation.time == 0.002
    assert np.isfinite(simulation.advance_to(0.004).cable.positions).all()


def test_good_steps_before_a_bad_one_are_kept():
    """End stop too stiff for a coarse step: earlier steps are counted, and all numbers stay finite."""
    stiff = {
        "carriages.one.end_stop": {"stroke": 0.05, "stiffness": 1e13, "damping": 0.0},
        "carriages.one.arc_length": 0.5,
        "solver.step": 0.01,
        "solver.max_iterations": 4,
        "solver.max_halvings": 0,
    }
    simulation = Simulation(loaded_span(elements=8, **stiff))
    simulation.command("one", force=-60000.0)
    with pytest.raises(SolverError):
        simulation.advance_to(3.0)
    steps = simulation.snapshot.solver.steps
    assert steps > 0
    assert simulation.time == pytest.approx(0.01 * steps)
    assert np.isfinite(simulation.snapshot.cable.positions).all()
    assert all(np.isfinite(array).all() for array in arrays_of(simulation.state).values())
