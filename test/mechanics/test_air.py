"""Air drag: force against its definition, and tangent in a Newton step of the whole system."""

import numpy as np
import pytest
from systems import disturbed_state, make_system, nodal_vectors
from test_equations_of_motion import ELASTIC, check_newton_step, rows

from cable_twin.mechanics.language.rotations import orientation
from cable_twin.mechanics.on_rope.sliding_joint import place_joint
from cable_twin.mechanics.on_rope.wind import drag_bodies, set_wind
from cable_twin.mechanics.parameters import FREE, SPEED, Air
from cable_twin.mechanics.rope.element import add_cable
from cable_twin.mechanics.rope.rope_drag import POINTS
from cable_twin.mechanics.rope.shape_functions import shape_functions, shape_functions_x

ROPE_DRAG = 2.5  # kg/m^2
WIND = np.array([4.0, -1.5])


def setup(dim=2, chains=(1, 2), rope=ROPE_DRAG, body=(3.0, 3.0, 3.0), modes=FREE):
    areas = np.diag([*body[: dim - 1], body[-1]]).ravel()
    air = Air(rope_drag=rope, body_drag=np.tile(areas, (sum(chains), 1)), present=True)
    system = make_system(dim, chains=chains, cable=ELASTIC, air=air)
    state, work = disturbed_state(system)
    state.drives.mode[:] = modes
    state.reference.position[:] = state.joints.position + 0.01
    set_wind(state, np.array([WIND[0], 2.5, WIND[1]])[: 3 if dim == 3 else None : 1 if dim == 3 else 2])
    for carriage in range(len(chains)):
        place_joint(system.cable, state, carriage)
    return system, state, work


def drag_on_rope(system, state, work):
    """Nodal forces and blocks of drag alone: with air less without."""
    found = []
    for q in (system.air.rope_drag, 0.0):
        add_cable(system._replace(air=system.air._replace(rope_drag=q)), state, 0.0, 25.0, 1.0, work)
        found.append((nodal_vectors(work.right_side), work.diagonal.copy()))
    return found[0][0] - found[1][0], found[0][1] - found[1][1]


def drag_on_cable(system, state):
    """Nodal drag forces (nodes 2, dim) from the definition, in numpy."""
    cable = system.cable
    places, weights = np.polynomial.legendre.leggauss(POINTS)
    e, e_dot = (nodal_vectors(x) for x in (state.nodes.position, state.nodes.velocity))
    forces = np.zeros_like(e)
    for element in range(cable.element_count if system.air.rope_drag else 0):
        nodes, length = slice(2 * element, 2 * element + 4), cable.element_length[element]
        for place, weight in zip((places + 1.0) / 2.0, weights / 2.0, strict=True):
            shape = np.array(shape_functions(place * length, length))
            r_x = np.array(shape_functions_x(place * length, length)) @ e[nodes]
            t = r_x / np.linalg.norm(r_x)
            relative = state.wind - shape @ e_dot[nodes]
            across = relative - t * (t @ relative)
            force = system.air.rope_drag * np.linalg.norm(across) * across
            forces[nodes] += np.outer(shape, force) * weight * length
    return forces


def drag_on_bodies(system, state):
    """Drag forces and moments (bodies, 3) in a plane, from the definition."""
    rows = []
    for body, drag in enumerate(system.air.body_drag):
        axes = np.reshape(orientation(state.bodies.position[body], (0.0, 0.0)), (2, 2))
        relative = state.wind - state.bodies.velocity[body, :2]
        rows.append([*axes @ drag.reshape(2, 2) @ axes.T @ relative * np.linalg.norm(relative), 0.0])
    return np.array(rows)


@pytest.mark.parametrize("dim", [2, 3])
def test_force_on_the_rope(dim):
    system, state, work = setup(dim, chains=())
    force, _ = drag_on_rope(system, state, work)
    np.testing.assert_allclose(force, drag_on_cable(system, state), atol=1e-12)


@pytest.mark.parametrize("modes", [FREE, SPEED], ids=["free", "driven"])
@pytest.mark.parametrize(
    ("rope", "body"), [(ROPE_DRAG, (0.0, 0.0)), (0.0, (3.0, 3.0)), (ROPE_DRAG, (3.0, 3.0)), (0.0, (1.0, 6.0))]
)
def test_newton_step(rope, body, modes):
    """Exact tangent to 3e-8 for drag on the rope, on bodies, on both, and by the axes of turning bodies."""
    system, state, work = setup(rope=rope, body=body, modes=modes)

    def residual(moved):
        bare = rows(system, moved, work)
        nodal = 4 * (system.cable.element_count + 1)
        inner = slice(2, -2)  # of the nodal vectors; both ends are pinned and hold their places
        drag = drag_on_cable(system, moved)
        bare[:nodal].reshape(-1, 2)[inner] -= drag[inner]
        bare[[2, 3]] -= drag[1]
        bare[[nodal - 2, nodal - 1]] -= drag[-1]
        bodies = drag_on_bodies(system, moved)
        bare[nodal : nodal + bodies.size] -= bodies.ravel()
        return np.concatenate([bare, np.zeros(4)])  # no sheaves, no haul ropes

    check_newton_step(system, state, work, 3e-8, residual)


def test_no_wind_and_no_motion_is_no_force():
    """Zero relative wind, by whose size the tangent divides."""
    system, state, work = setup()
    for array in (state.nodes.velocity, state.bodies.velocity):
        array[:] = 0.0
    set_wind(state, np.zeros(2))
    force, tangent = drag_on_rope(system, state, work)
    drag_bodies(system, state, 25.0, 1.0, work)
    assert not force.any()
    assert not tangent.any()
    assert not work.body_drag.any()
    assert not work.body_drag_tangent.any()


def test_a_rope_that_runs_along_itself_feels_nothing():
    system, state, work = setup(chains=())
    state.nodes.position[:, 0] = np.arange(4)[:, None] * 0.7 * np.array([0.8, 0.6])
    state.nodes.position[:, 1:] = 0.8, 0.6
    state.nodes.velocity[:] = 0.0
    state.nodes.velocity[:, 0] = 9.0 * np.array([0.8, 0.6])
    set_wind(state, np.zeros(2))
    np.testing.assert_allclose(drag_on_rope(system, state, work)[0], 0.0, atol=1e-12)
