"""Natural modes: pendulums in closed form, agreement with eq. 16, both solvers, orthogonality."""

import numpy as np
import pytest
from scipy.linalg import eigh
from systems import changed, difference
from test_equilibrium import loaded_span, prepare

from cable_twin.mechanics.language.compilation import kernel
from cable_twin.mechanics.language.rotations import move_body
from cable_twin.mechanics.on_rope.wind import set_wind
from cable_twin.mechanics.solution import modes
from cable_twin.mechanics.solution.equations_of_motion import solve_accelerations
from cable_twin.mechanics.solution.equilibrium import settle
from cable_twin.mechanics.solution.modes import natural_modes
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation
from verification.statics import CANTILEVER, LEVEL_SPAN


@kernel
def move(positions, increments, like):
    for body in range(positions.shape[0]):
        move_body(positions[body], increments[body], like)


STIFF = {"cable.axial_stiffness": 1e9, "cable.bending_stiffness": 1e5, "cable.elements": 4, "gravity": 9.81}


def hung_from_a_wall(bodies):
    """Carriage on a short, almost rigid cantilever, so that its joint stands still."""
    carriage = {"arc_length": 0.5, "joint": "fixed", "bodies": bodies}
    return Simulation(load_scenario({**CANTILEVER, "carriages": {"one": carriage}}, STIFF))


@pytest.mark.parametrize("spring", [0.0, 9.0])
def test_compound_pendulum(spring):
    """ω² = (m g d + k) / (I + m d²): to 1e-4; a damper changes nothing."""
    body = {"mass": 4.0, "inertia": 0.7, "upper_pivot": [0.3, 0.4], "stiffness": spring, "damping": 3.0}
    if spring:  # or it would not hang as the spring is
        body["upper_pivot"] = [0.0, 0.5]
    exact = np.sqrt((4.0 * 9.81 * 0.5 + spring) / (0.7 + 4.0 * 0.25)) / (2.0 * np.pi)
    assert hung_from_a_wall({"body": body}).natural_frequencies(1)[0] == pytest.approx(exact, rel=1e-4)


@pytest.mark.parametrize("springs", [(0.0, 0.0), (7.0, 4.0)])
def test_double_pendulum(springs):
    """Two rods of 1 m: roots of det(K - ω² M) with the textbook matrices and springs of N m/rad, to 1e-4."""
    mass, inertia, (upper, lower) = 2.67, 0.2242, springs
    rod = {"mass": mass, "inertia": inertia, "upper_pivot": [0.0, 0.5]}
    rods = {"upper": {**rod, "lower_pivot": [0.0, -0.5], "stiffness": upper}, "lower": {**rod, "stiffness": lower}}
    inertias = np.array([[inertia + 1.25 * mass, 0.5 * mass], [0.5 * mass, inertia + 0.25 * mass]])
    stiffness = mass * 9.81 * np.diag([1.5, 0.5]) + [[upper + lower, -lower], [-lower, lower]]
    exact = np.sqrt(eigh(stiffness, inertias, eigvals_only=True)) / (2.0 * np.pi)
    np.testing.assert_allclose(hung_from_a_wall(rods).natural_frequencies(2), exact, rtol=1e-4)


WIND = [2.0, 15.0, 0.0]
IN_SPACE = {"space": 3, "carriages.one.bodies.upper.drag_area": 3.0}
UNIVERSAL = {"carriages.one.bodies.lower.drag_area": 9.0, "carriages.one.bodies.lower.turns": "universal"}


@pytest.mark.parametrize("spring", [0.0, 3e4], ids=["pivots", "springs"])
@pytest.mark.parametrize(
    "space", [{}, IN_SPACE, IN_SPACE | UNIVERSAL], ids=["in a plane", "in side wind", "universal joints"]
)
def test_modes_solve_equation_16(spring, space):
    """Accelerations of -ω² times a mode displaced from equilibrium: to 1e-4 of the largest.

    A span with two bodies on it; accelerations by differences of `solve_accelerations` over the motion of the nodes
    and bodies that keeps the joints closed.
    """
    changes = {f"carriages.one.bodies.{name}.stiffness": spring for name in ("upper", "lower")} | space
    system, state, work = prepare(loaded_span(elements=6, **{"carriages.one.joint": "fixed", **changes}))
    set_wind(state, np.array(WIND) if space else np.zeros(state.wind.size))
    settle(system, state, work)
    assert not space or np.abs(state.multipliers[:, 1]).max() > 1e2
    frequencies, shapes = natural_modes(system, state, 4)
    free, _ = np.linalg.qr(modes._free_directions(system, state).toarray())
    (carriage,) = modes.hanging_carriages(system, state)
    dim, (nodal, held), bodies = len(system.cable.gravity), free.shape, state.bodies.velocity.shape[0]
    parts = [0, 2, 4] if dim == 2 else range(6)  # of position and turn in space: x, z, pitch
    unknowns = np.vstack([np.eye(nodal)[carriage.places] @ free, np.zeros((carriage.angles, held))])
    unknowns = np.hstack([unknowns, np.eye(unknowns.shape[0])[:, -carriage.angles :]])
    directions = carriage.directions[:, parts].reshape(-1, unknowns.shape[0]) @ unknowns
    everything = np.vstack([np.hstack([free, np.zeros((nodal, carriage.angles))]), directions])

    def accelerations(x):
        """Accelerations of free nodal directions and angles at given coordinates."""
        moved = changed(
            state,
            nodes_position=state.nodes.position + (free @ x[:held]).reshape(state.nodes.position.shape),
            nodes_acceleration=np.zeros_like(state.nodes.acceleration),
            bodies_position=state.bodies.position.copy(),
            bodies_acceleration=np.zeros_like(state.bodies.acceleration),
            multipliers=state.multipliers.copy(),
            moments=state.moments.copy(),
        )
        move(moved.bodies.position, (directions @ x).reshape(bodies, -1), system.cable.gravity)
        assert solve_accelerations(system, moved, 0.0, work)
        found = np.concatenate([moved.nodes.acceleration.ravel(), moved.bodies.acceleration.ravel()])
        return np.linalg.lstsq(everything, found, rcond=None)[0]

    matrix = -difference(accelerations, np.zeros(unknowns.shape[1]), 1e-5)
    values, vectors = np.linalg.eig(matrix)
    order = np.argsort(values.real)[:4]
    np.testing.assert_allclose(np.sqrt(values.real[order]) / (2.0 * np.pi), frequencies, rtol=1e-4)
    for shape, vector in zip(shapes, vectors.real.T[order], strict=True):
        got = free.T @ shape.reshape(nodal)
        other = vector[:held]
        alike = abs(got @ other) / (np.linalg.norm(got) * np.linalg.norm(other))
        assert alike == pytest.approx(1.0, abs=1e-4)


def test_shapes_are_the_same_wherever_they_are_looked_at():
    """Also at a node of a mode, where rounding was blown up to 1, and at an end; places off the rope are refused."""
    simulation = Simulation(loaded_span(elements=24, **{"carriages.one.joint": "fixed"}))
    everywhere = np.linspace(0.0, 101.0, 24 * 4 + 1)
    whole = simulation.mode_shapes(3, everywhere)
    assert np.abs(whole).max(axis=(1, 2)) == pytest.approx(1.0, abs=0.01)
    for row in (0, 17, 48):
        np.testing.assert_allclose(simulation.mode_shapes(3, everywhere[[row]])[:, 0], whole[:, row], atol=1e-12)
    for given, said in (([102.0], "arc length: given 102 m"), (50.0, "arc lengths: given 0 dimensions")):
        with pytest.raises(ValueError, match=said):
            simulation.mode_shapes(3, given)


def test_both_ways_of_solving_agree(monkeypatch):
    """All eigenvalues at once against the lowest few by iteration: to 1e-8, shapes to 1e-6."""
    simulation = Simulation(loaded_span(elements=24, **{"carriages.one.joint": "fixed"}))
    arc_lengths = np.linspace(0.0, 101.0, 11)
    dense, dense_shapes = simulation.natural_frequencies(6), simulation.mode_shapes(6, arc_lengths)
    monkeypatch.setattr(modes, "DENSE_LIMIT", 10)
    np.testing.assert_allclose(simulation.natural_frequencies(6), dense, rtol=1e-7)
    for one, other in zip(simulation.mode_shapes(6, arc_lengths), dense_shapes, strict=True):
        sign = np.sign((one * other).sum())
        np.testing.assert_allclose(sign * one, other, atol=1e-5)


def test_shapes_are_orthogonal_over_the_mass():
    """M-products of different modes of a bare span vanish: below 1e-9 of their own."""
    simulation = Simulation(load_scenario(LEVEL_SPAN, {"cable.elements": 12}))
    _, shapes = natural_modes(simulation.system, simulation.capture().state, 8)
    flat = shapes.reshape(8, -1)
    products = flat @ (modes._cable_mass(simulation.system, simulation.state) @ flat.T)
    size = np.sqrt(np.diag(products))
    np.testing.assert_allclose(products / np.outer(size, size), np.eye(8), atol=1e-9)


@pytest.mark.parametrize("scale", [1.0, 7.0])
def test_mass_does_not_depend_on_the_mesh(scale):
    """Whole mass in a rigid shift of all nodes, to 1e-12."""
    simulation = Simulation(load_scenario(LEVEL_SPAN, {"cable.elements": round(3 * scale)}))
    shift = np.zeros(simulation.state.nodes.position.shape)
    shift[:, 0, 1] = 1.0
    mass = shift.ravel() @ (modes._cable_mass(simulation.system, simulation.state) @ shift.ravel())
    assert mass == pytest.approx(1010.0, rel=1e-12)


def test_number_of_modes_is_checked():
    """Free unknowns of two pinned elements: 12 nodal coordinates less 4."""
    simulation = Simulation(load_scenario(LEVEL_SPAN, {"cable.elements": 2}))
    assert simulation.natural_frequencies(8).shape == (8,)
    for count in (0, 9):
        with pytest.raises(ValueError, match=f"natural frequencies: given {count}; allowed: 1 to 8"):
            simulation.natural_frequencies(count)
