"""Coupled ropes: elimination, tangents, closed forms of strings, motion."""

import numpy as np
import pytest
from systems import dense_matrix, difference, disturbed_state, from_nodal_vectors, make_system, nodal_vectors

from cable_twin.key_figures import KeyFigures
from cable_twin.mechanics.rope.point import position_on_cable
from cable_twin.mechanics.solution.bundle.assembly import Assembly, Rope, no_couplings
from cable_twin.mechanics.solution.bundle.connector import add_connectors
from cable_twin.mechanics.solution.bundle.elimination import order_of, sequence_of, solve_bundle
from cable_twin.mechanics.solution.bundle.pantograph import add_pantographs
from cable_twin.mechanics.solution.bundle.records import (
    Clamps,
    Connectors,
    allocate_bundle_state,
    allocate_bundle_work,
)
from cable_twin.mechanics.state import allocate_state, allocate_workspace
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation

ELEMENTS = (7, 5, 9)
CLAMPED = np.array([[0, 1], [2, 0], [1, 2], [0, 2]])  # ropes; both their elements
CLAMP_ELEMENTS = np.array([[0, 0], [4, 3], [3, 8], [6, 1]])
ROPES = np.array([[0, 1], [0, 1], [1, 2], [0, 2]])
NODES = np.array([[2, 1], [4, 1], [3, 4], [5, 6]])
LENGTH, TENSION, STIFFNESS = 40.0, 5000.0, 2e5  # m, N, N/m


def make_bundle(dim, *, stiffness=50.0, compression=20.0, clamps=0, times=1, rolls=0):
    """Three ropes with four rods between them, of some times the elements, with the owners of their records."""
    systems = [make_system(dim, cable={"element_count": times * count}) for count in ELEMENTS]
    states, works = [allocate_state(s) for s in systems], [allocate_workspace(s) for s in systems]
    count = len(ROPES)
    couplings = no_couplings(len(ELEMENTS), dim)._replace(
        connectors=Connectors(
            rope=ROPES,
            node=times * NODES,
            length=np.full(count, 0.5),
            stiffness=np.full(count, stiffness),
            compression=np.full(count, compression),
            damping=np.full(count, 3.0),
            rolls=np.full(count, rolls),
        ),
        clamps=Clamps(
            rope=CLAMPED[:clamps, 0].copy(),
            carriage=np.zeros(clamps, np.int64),
            offset=np.zeros((clamps, dim)),
            choice_offset=np.arange(clamps + 1),
            choice=CLAMPED[:clamps, 1].copy(),
            place=np.zeros(clamps),
            loop_length=np.zeros(clamps),
        ),
    )
    ropes = Assembly([Rope(*parts) for parts in zip(systems, states, works, strict=True)], couplings)
    return ropes.bundle, systems, states, works, ropes


def as_matrix(block):
    """Matrix (2 dim, 2 dim) of a block (2, 2, dim²)."""
    dim = int(np.sqrt(block.shape[-1]))
    return block.reshape(2, 2, dim, dim).transpose(0, 2, 1, 3).reshape(2 * dim, 2 * dim)


def add_cross(matrix, blocks, first, second, dim):
    """Add the coupling of a connector's nodes, whose rows begin at `first` and `second`, to the matrix of all ropes."""
    for row in range(2):
        own, other = slice(first, first + dim), slice(second + row * dim, second + (row + 1) * dim)
        matrix[own, other] += blocks[row, 0].reshape(dim, dim)
        matrix[other, own] += blocks[row, 1].reshape(dim, dim)


def turned_and_shifted(systems, random, dim):
    """Change of all nodes by which each rope is shifted and turned at random."""
    found = []
    for system in systems:
        shift, turn = random.normal(size=(2, dim))
        nodes = np.zeros((system.cable.element_count + 1, 2, dim))
        nodes[:, 0], nodes[:, 1] = shift + system.cable.node_arc_length[:, None] * turn, turn
        found.append(nodes.ravel())
    return np.concatenate(found)


def places_of(dim, times=1):
    """First row of the block of each node in the matrix of all ropes."""
    sizes = [(times * count + 1) * 2 * dim for count in ELEMENTS]
    return np.cumsum([0, *sizes])


@pytest.mark.parametrize("dim", [pytest.param(2, marks=pytest.mark.long), 3])
@pytest.mark.parametrize("clamps", [0, 1, 4])
@pytest.mark.parametrize("times", [1, 2, 5])
def test_elimination_solves_what_a_dense_solver_solves(dim, clamps, times):
    """Clamps in any order along the ropes, without a diagonal block of their own; runs of nodes between, or none."""
    bundle, systems, _, works, _kept = make_bundle(dim, clamps=clamps, times=times, rolls=1)
    random, first = np.random.default_rng(dim), places_of(dim, times)
    scratch = allocate_bundle_work(bundle)
    size = first[-1] + clamps * 2 * dim
    matrix, right = np.zeros((size, size)), np.zeros(size)
    for rope, work in enumerate(works):
        for array in (work.diagonal, work.upper, work.lower, work.right_side):
            array[:] = random.normal(size=array.shape)
        for i in range(2):
            work.diagonal[:, i, i] += 8.0 * np.eye(dim).ravel()
        own = slice(first[rope], first[rope + 1])
        matrix[own, own] = dense_matrix(work.diagonal, work.upper, work.lower)
        right[own] = nodal_vectors(work.right_side).ravel()
    for connector, (ropes, nodes) in enumerate(zip(ROPES, times * NODES, strict=True)):
        scratch.cross[connector] = random.normal(size=(2, 2, dim * dim))
        add_cross(matrix, scratch.cross[connector], *(first[ropes] + nodes * 2 * dim), dim)
    for clamp in range(clamps):
        own = slice(first[-1] + clamp * 2 * dim, first[-1] + (clamp + 1) * 2 * dim)
        blocks = scratch.clamp_diagonal[clamp], scratch.clamp_right[clamp]
        for array in (*blocks, scratch.clamp_out[clamp], scratch.clamp_in[clamp]):
            array[:] = random.normal(size=array.shape)
        scratch.clamp_diagonal[clamp, 0, 0] = 0.0
        matrix[own, own], right[own] = as_matrix(scratch.clamp_diagonal[clamp]), scratch.clamp_right[clamp].ravel()
        for k in range(4):
            rope, node = CLAMPED[clamp, k // 2], times * CLAMP_ELEMENTS[clamp, k // 2] + k % 2
            scratch.clamp_node[clamp, k] = first[rope] // (2 * dim) + node
            there = slice(first[rope] + node * 2 * dim, first[rope] + (node + 1) * 2 * dim)
            matrix[there, own] += as_matrix(scratch.clamp_out[clamp, k])
            matrix[own, there] += as_matrix(scratch.clamp_in[clamp, k])
    exact = np.linalg.solve(matrix, right)
    scratch.used[:], scratch.side[:] = 1, 7.0  # of the solution before, when the clamps were elsewhere
    assert solve_bundle(bundle, scratch, works[0], systems[0].cable.gravity)
    found = [*(nodal_vectors(work.right_side).ravel() for work in works), scratch.clamp_right.ravel()]
    np.testing.assert_allclose(np.concatenate(found), exact, rtol=1e-11, atol=1e-11)


@pytest.mark.parametrize("dim", [pytest.param(2, marks=pytest.mark.long), 3])
def test_tangent_of_a_pantograph_is_the_derivative_of_its_push(dim):
    """Of a head that does not give way, as its stages are heavy here: by size, direction and place of its push."""
    pantograph = {
        "rope": "upper",
        "position": 5.3,
        "speed": 0.0,
        "uplift_force": 60.0,
        "contact_stiffness": 5e4,
        "stages": [{"mass": 7.0, "stiffness": 7e3, "damping": 10.0}],
    }
    simulation = strings(rods=[(MIDDLE, {"length": 0.99})], gravity=9.81, dim=dim, pantographs={"head": pantograph})
    engine = simulation.engine
    bundle, moving, scratch = engine.bundle, engine.moving, engine._ropes.scratch
    part, work = engine.parts[0], engine._works[0]
    state, like = part.state, part.system.cable.gravity
    state.nodes.position[:, :2] += np.random.default_rng(5).normal(scale=1e-3, size=(len(state.nodes.position), 2, dim))
    state.nodes.position[:, 2] = state.nodes.position[:, 1]
    start = state.nodes.position.copy()
    moving.stages.position[0, 0] = position_on_cable(part.system.cable, state, 5.3 * (1.0 - TENSION / 2e5))[-1] + 0.02

    def forces(change):
        state.nodes.position[:] = start + from_nodal_vectors(change, dim)
        for array in (work.right_side, work.diagonal, work.upper, work.lower):
            array[:] = 0.0
        add_pantographs(bundle, moving, scratch, part.system, state, work, 1e30, 0.0, 1.0, like)
        return nodal_vectors(work.right_side).ravel()

    size = nodal_vectors(work.right_side).size
    numeric = -difference(forces, np.zeros(size), 1e-5)
    forces(np.zeros(size))
    assert moving.contact_force[0] > 100.0
    matrix = dense_matrix(work.diagonal, work.upper, work.lower)
    np.testing.assert_allclose(matrix, numeric, rtol=0, atol=1e-6 * np.abs(numeric).max())


def test_block_without_inverse_is_told():
    bundle, systems, _, works, _kept = make_bundle(2)
    assert not solve_bundle(bundle, allocate_bundle_work(bundle), works[0], systems[0].cable.gravity)


@pytest.mark.parametrize("dim", [pytest.param(2, marks=pytest.mark.long), 3])
@pytest.mark.parametrize(("rate_factor", "rolls"), [(0.0, 0), (70.0, 0), (0.0, 1), (70.0, 1)])
def test_tangent_of_rods_is_the_derivative_of_their_forces(dim, rate_factor, rolls):
    """Positions and rates varied together by the factor of the integrator; ropes move where nothing rolls."""
    bundle, systems, states, works, _kept = make_bundle(dim, rolls=rolls)
    like, first, random = systems[0].cable.gravity, places_of(dim), np.random.default_rng(3)
    for rope, (system, state) in enumerate(zip(systems, states, strict=True)):
        other, _ = disturbed_state(system, seed=rope)
        straight = np.zeros_like(other.nodes.position)
        straight[:, 1:] = np.eye(dim)[0] * 1.05 + 0.2 * np.eye(dim)[-1]
        straight[:, 0] = system.cable.node_arc_length[:, None] * straight[:, 1]
        state.nodes.position[:] = straight + (0.2 if rolls else 1.0) * (other.nodes.position - straight)
        state.nodes.position[:, 0, -1] -= 0.7 * rope
    scratch, moving = allocate_bundle_work(bundle), allocate_bundle_state(bundle)
    places = [state.nodes.position.copy() for state in states]
    speeds = [(1 - rolls) * random.normal(size=place.shape) for place in places]

    def forces(change):
        for rope, (state, work) in enumerate(zip(states, works, strict=True)):
            moved = from_nodal_vectors(change[first[rope] : first[rope + 1]], dim)
            state.nodes.position[:] = places[rope] + moved
            state.nodes.velocity[:] = speeds[rope] + rate_factor * moved
            for array in (work.right_side, work.diagonal, work.upper, work.lower):
                array[:] = 0.0
        add_connectors(bundle, moving, scratch, systems[0], states[0], works[0], rate_factor, 1.0, like)
        return np.concatenate([nodal_vectors(work.right_side).ravel() for work in works])

    numeric = -difference(forces, np.zeros(first[-1]), 1e-5)
    assert np.abs(forces(np.zeros(first[-1]))).max() > 1.0
    matrix = np.zeros_like(numeric)
    for rope, work in enumerate(works):
        own = slice(first[rope], first[rope + 1])
        matrix[own, own] = dense_matrix(work.diagonal, work.upper, work.lower)
    for connector, (ropes, nodes) in enumerate(zip(ROPES, NODES, strict=True)):
        add_cross(matrix, scratch.cross[connector], *(first[ropes] + nodes * 2 * dim), dim)
    largest = np.abs(numeric).max()
    if not rolls:
        change = random.normal(size=first[-1])
        np.testing.assert_allclose(matrix @ change, numeric @ change, rtol=0, atol=1e-6 * largest)
    for rope in range(len(systems)):
        own = slice(first[rope], first[rope + 1])
        np.testing.assert_allclose(matrix[own, own], numeric[own, own], rtol=0, atol=1e-6 * largest)
    rigid = np.array([turned_and_shifted(systems, random, dim) for _ in range(6)])  # where couplings are exact
    np.testing.assert_allclose(rigid @ matrix @ rigid.T, rigid @ numeric @ rigid.T, rtol=0, atol=1e-4 * largest)


def test_connectors_come_in_an_order_along_all_ropes_or_not_at_all():
    shuffled = [3, 1, 0, 2]
    found = sequence_of(ROPES[shuffled], NODES[shuffled])
    order_of([8, 6, 10], ROPES[shuffled][found], NODES[shuffled][found])
    with pytest.raises(ValueError, match="cross"):
        sequence_of(np.array([[0, 1], [0, 1]]), np.array([[1, 3], [2, 2]]))
    with pytest.raises(ValueError, match="crosses"):
        order_of([5, 5], np.array([[0, 1], [0, 1]]), np.array([[1, 3], [2, 2]]))


def strings(*, rods, gravity=0.0, dim=2, **changes):
    """Two strings of equal tension, 1 m above each other, with rods between them; heights in m."""

    def place(x, z):
        return [x, z] if dim == 2 else [x, 0.0, z]

    def rope(height):
        axial = 2e5
        return {
            "unstrained_length": LENGTH / (1.0 + TENSION / axial),
            "mass_per_length": 1.0,
            "axial_stiffness": axial,
            "bending_stiffness": 0.0,
            "elements": 128,
            "start": {"position": place(0.0, height)},
            "end": {"position": place(LENGTH, height)},
        }

    scenario = {
        "gravity": gravity,
        "ropes": {"upper": rope(1.0), "lower": rope(0.0)},
        "connectors": {
            f"rod_{k}": {"from": ["upper", s], "to": ["lower", s], "stiffness": STIFFNESS, **rod}
            for k, (s, rod) in enumerate(rods)
        },
        "solver": {"step": 0.002, "spectral_radius": 1.0, "tolerance": 1e-12},
        **changes,
    }
    return Simulation(load_scenario(scenario))


MIDDLE = 0.5 * LENGTH / 1.025


@pytest.mark.parametrize("dim", [2, 3])
def test_short_rod_pulls_strings_together_as_springs_in_a_row(dim):
    short = 0.05
    simulation = strings(rods=[(MIDDLE, {"length": 1.0 - short})], dim=dim)
    (pull,) = simulation.snapshot.connectors.values()
    expected = short / (1.0 / STIFFNESS + 2.0 * LENGTH / (4.0 * TENSION))
    assert pull == pytest.approx(expected, rel=3e-3)  # a cubic has no kink
    upper, lower = (simulation.cable_positions([MIDDLE], rope=name)[0, 2] for name in ("upper", "lower"))
    assert upper - lower == pytest.approx(1.0 - short + pull / STIFFNESS, abs=1e-9)
    assert (1.0 - upper) == pytest.approx(lower, abs=1e-9)
    assert simulation.advance_to(0.5).connectors["rod_0"] == pytest.approx(pull, rel=1e-6)


def test_long_rod_is_slack_and_pushes_where_it_can():
    simulation = strings(rods=[(MIDDLE, {"length": 1.05}), (0.7 * MIDDLE, {"length": 0.9})])
    pulls = simulation.advance_to(0.1).connectors
    assert pulls["rod_0"] == 0.0
    assert pulls["rod_1"] > 10.0
    pushing = strings(rods=[(MIDDLE, {"length": 1.05, "compression": STIFFNESS})]).snapshot.connectors["rod_0"]
    assert pushing == pytest.approx(-0.05 / (1.0 / STIFFNESS + 2.0 * LENGTH / (4.0 * TENSION)), rel=3e-3)


def test_strings_that_swing_together_keep_their_frequency_and_energy():
    """Rods between equal strings are inactive in their common motion at n/2L sqrt(T/m), per unstrained length."""
    rods = [(share * 2.0 * MIDDLE, {"length": 1.0, "compression": STIFFNESS}) for share in (0.2, 0.5, 0.7)]
    simulation = strings(rods=rods)
    state = simulation.capture()
    for own in state.states:
        s = np.linspace(0.0, 1.0, own.nodes.position.shape[0])
        own.nodes.velocity[:, 0, 1] = 0.02 * np.sin(np.pi * s)
        own.nodes.velocity[:, 1:, 1] = 0.02 * np.pi / (2.0 * MIDDLE) * np.cos(np.pi * s)[:, None]
        own.newton_ratio[0] = np.inf  # accelerations are known: none where a string is straight
    simulation.restore(state)
    before = simulation.energy().total
    times, heights = [], []
    for _ in range(1500):
        times.append(simulation.advance_to(simulation.time + 0.002).time)
        heights.append(simulation.cable_positions([MIDDLE], rope="lower")[0, 2])
    crossings = np.flatnonzero((np.array(heights)[:-1] < 0.0) & (np.array(heights)[1:] >= 0.0))
    fractions = [times[k] - heights[k] * 0.002 / (heights[k + 1] - heights[k]) for k in crossings]
    frequency = np.sqrt(TENSION / 1.0 * 1.025) / (2.0 * LENGTH)
    assert np.diff(fractions).mean() * frequency == pytest.approx(1.0, abs=1e-3)
    assert simulation.energy().total == pytest.approx(before, abs=1e-6 * 0.02**2 * LENGTH)


PANTOGRAPH = {
    "rope": "lower",
    "position": 12.0,
    "speed": 10.0,
    "uplift_force": 60.0,
    "stages": [{"mass": 7.0, "stiffness": 4e3, "damping": 10.0}, {"mass": 15.0, "stiffness": 50.0}],
}


def test_state_goes_through_a_file_to_the_last_bit(tmp_path):
    """State of couplings, pantographs included, after a file and after a reset."""
    simulation = strings(rods=[(MIDDLE, {"length": 0.99})], gravity=9.81, pantographs={"head": PANTOGRAPH})
    start = simulation.snapshot
    assert start.pantographs["head"].contact_force == pytest.approx(60.0, abs=50.0)
    simulation.advance_to(0.4)
    simulation.save(tmp_path / "state.npz")
    later = simulation.advance_to(0.8)
    again = Simulation.load(tmp_path / "state.npz").advance_to(0.8)
    np.testing.assert_array_equal(later.numbers, again.numbers)
    assert later.pantographs["head"].position[0] == pytest.approx(20.0)
    assert simulation.advance_to(3.0).pantographs["head"].position[0] == pytest.approx(42.0)
    simulation.reset()
    np.testing.assert_array_equal(simulation.snapshot.numbers[1:], start.numbers[1:])


def test_figures_of_a_pantograph_end_with_its_rope():
    """No loss of contact past an end, where the force is NaN, and no other mean."""
    simulation = strings(rods=[(MIDDLE, {"length": 0.99})], gravity=9.81, pantographs={"head": PANTOGRAPH})
    figures = KeyFigures(simulation.scenario)
    for number in range(28):
        figures.update(simulation.advance_to(0.1 * number))
    under, past = named(figures), simulation.advance_to(2.81)
    assert under["head: contact force, mean"].place == ""
    assert under["head: contact force, mean"].value > 30.0
    assert np.isnan(past.pantographs["head"].contact_force)
    assert past.pantographs["head"].position[0] > LENGTH
    figures.update(past)
    figures.update(simulation.advance_to(3.0))
    later = named(figures)
    for name in (one for one in later if one.startswith("head: ")):
        assert later[name].value == under[name].value
    for name in ("contact force, mean", "contact force, standard deviation", "loss of contact, share of the time"):
        assert later[f"head: {name}"].place == "has left its wire at 2.81 s"
        assert later[f"head: {name}"].time == pytest.approx(2.7)


def named(figures):
    return {one.name: one for one in figures.figures()}
