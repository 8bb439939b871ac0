"""Support forces at both ends from the end elements, against the balance of the end nodes of the assembled cable."""

import numpy as np
import pytest
from systems import disturbed_state, make_limits, make_system, nodal_vectors, put, with_moving_cable

from cable_twin.mechanics.on_rope.sliding_joint import place_joint, tangent_moment
from cable_twin.mechanics.on_rope.tower import add_towers, contact_force
from cable_twin.mechanics.on_rope.wind import set_wind
from cable_twin.mechanics.parameters import CONTINUUM, ELEMENT_FRAME, Air, MovingCable
from cable_twin.mechanics.readout.sections import end_force
from cable_twin.mechanics.rope.element import add_cable
from cable_twin.mechanics.rope.point import point_at, position_on_cable
from cable_twin.mechanics.solution.equations_of_motion import add_loads
from verification import JIT
from verification.models import for_kernels, moving
from verification.supports import tramway

MOVING = MovingCable(moving=True, loop_length=5.0, limits=make_limits(1, 0.8, 1.5))
LENGTH = 0.7  # m, of an element


def balance_of_end_nodes(system, state, work):
    """Support forces (2, dim) in N from the balance of the end nodes, under the present other forces."""
    cable = system.cable
    add_cable(system, state, 1.0, 0.0, 0.0, work)
    add_loads(cable, state, 0.0, work)
    nodal = nodal_vectors(work.right_side)

    def act(arc_length, force):
        point = point_at(cable, state, arc_length)
        nodal[2 * point.element : 2 * point.element + 4] += np.outer(point.shape, force)

    for carriage in np.flatnonzero(state.attached):
        act(state.joints.position[carriage], -state.multipliers[system.carriages.body_offset[carriage]])
        if system.carriages.hinge_damping.any():
            point = point_at(cable, state, state.joints.position[carriage])
            held = slice(2 * point.element, 2 * point.element + 4)
            r_x = np.array(point.shape_x) @ nodal_vectors(state.nodes.position)[held]
            turn = np.array([r_x[1], -r_x[0]]) / (r_x @ r_x)  # of the pitch, by the slope
            nodal[held] -= tangent_moment(system, state, carriage)[0][0] * np.outer(point.shape_x, turn)
    for contact in range(system.towers.stiffness.size):
        act(state.contact_arc_length[contact], contact_force(cable, system.towers, state, contact)[0])
    return -nodal[[0, -2]]


def check(system, state, work):
    expected = balance_of_end_nodes(system, state, work)
    got = np.array([end_force(system, state, end) for end in range(2)])
    np.testing.assert_allclose(got, expected, rtol=0.0, atol=1e-9 * np.abs(expected).max())
    return got


def in_motion(elements, dim=2, **options):
    """Cable in general position with all forces that act on its ends, some changed or left out by `options`."""
    whole = elements * LENGTH
    loads = {"places": [0.0, 0.3, 0.5 * whole, whole - 0.2, whole], "towers": [0.25, whole - 0.1], **options}
    places, count = np.array(loads["places"]), len(loads["towers"])
    rng = np.random.default_rng(3)
    cars = options.get("cars", [0.2, whole - 0.3] if dim == 2 else [])
    system = make_system(
        dim,
        chains=[1 + number % 2 for number in range(len(cars))],
        cable={
            "element_count": elements,
            "damping_time": 0.02,
            "elastic_model": options.get("model", CONTINUUM),
            "load_arc_length": places,
            "load_force": 50.0 * rng.standard_normal((places.size, dim)),
            "end_moment": np.array([3.0, -2.0]) if dim == 2 else np.zeros(2),
        },
        towers={"contacts": count},
        air=Air(
            rope_drag=2.5,
            body_drag=np.tile(np.eye(dim).ravel(), (sum(1 + k % 2 for k in range(len(cars))), 1)),
            present=True,
        ),
    )
    system = with_moving_cable(system, MOVING)
    state, work = disturbed_state(system)
    put(state.rope, 0.3, 1.7, 0.6)
    set_wind(state, rng.standard_normal(dim) * 4.0)
    state.joints.position[:] = cars
    for contact, place in enumerate(loads["towers"]):
        state.contact_arc_length[contact] = place
        system.towers.position[contact] = np.array(position_on_cable(system.cable, state, place))
        system.towers.position[contact, -1] += 0.03  # pressed in
    add_towers(system.cable, system.towers, state, 0.0, 0.0, work)
    for contact in range(len(loads["towers"])):
        assert contact_force(system.cable, system.towers, state, contact)[1] > 1.0
    state.contact_origin[:] = state.contact_arc_length - 0.004
    state.contact_deflection[:] = 0.2
    return system, state, work


@pytest.mark.parametrize(
    ("model", "dim"),
    [(CONTINUUM, 2), (CONTINUUM, 3), (ELEMENT_FRAME, 2), pytest.param(ELEMENT_FRAME, 3, marks=pytest.mark.long)],
)
@pytest.mark.parametrize("elements", [1, 2, 3, 5])
def test_end_forces_are_what_the_end_nodes_lack(elements, model, dim):
    """With flow, drag, damping, loads, vehicles and towers on the elements at both ends."""
    check(*in_motion(elements, dim, model=model))


def test_each_part_is_in_the_end_forces():
    """Leaving out one part changes the forces, and they are right without it, so no part cancels another."""
    system, state, work = in_motion(3)
    forces = check(system, state, work)
    still = state._replace(attached=np.zeros_like(state.attached))
    less = [
        (system._replace(moving_cable=MOVING._replace(moving=False)), state),
        (system._replace(air=system.air._replace(present=False)), state),
        (system._replace(cable=system.cable._replace(load_force=0.0 * system.cable.load_force)), state),
        (system._replace(towers=system.towers._replace(stiffness=0.0 * system.towers.stiffness)), state),
        (system, still),
    ]
    for other, moved in less:
        assert (np.abs(check(other, moved, work) - forces) > 1e-3).any(axis=1).all()


@pytest.mark.parametrize("cars", [[0.0, 3.5], [LENGTH, 3.5 - LENGTH], [1.0, 2.0], [0.1, 0.1]])
@pytest.mark.parametrize("towers", [[], [0.0, 3.5], [LENGTH, 1.75, 3.5 - LENGTH]])
def test_what_is_at_a_node_or_on_inner_elements_is_shared_out_alike(cars, towers):
    check(*in_motion(5, cars=cars, towers=towers))


def test_moments_of_hinges_are_in_the_end_forces():
    """Hinge moments of carriages on the elements at both ends."""
    system, state, work = in_motion(3)
    bare = check(system, state, work)
    for carriage in range(2):
        place_joint(system.cable, state, carriage)
    system.carriages.hinge_stiffness[:], system.carriages.hinge_damping[:] = 40.0, 6.0
    assert (np.abs(check(system, state, work) - bare) > 1e-3).any(axis=1).all()


def test_end_forces_of_a_tramway_under_way():
    """Friction on a tower, a counterweight, a cabin that leaves the lower station."""
    simulation = tramway(cabin={"arc_length": 6.0}, cable__elements=50, cable__joint="paper", cable__end__mass=60e3)
    simulation.command("cabin", speed=5.0)
    for _ in range(10 if JIT else 2):
        simulation.advance_to(simulation.time + (0.2 if JIT else 0.01))
        forces = check(simulation.system, *for_kernels(simulation))
        supports = simulation.snapshot.supports
        np.testing.assert_allclose([supports[end].force[[0, 2]] for end in ("start", "end")], forces, rtol=1e-14)


def test_end_forces_of_a_moving_cable_under_way():
    """Carriers entering and leaving across the elements at both ends."""
    chair = {"mass": 300.0, "inertia": 100.0, "upper_pivot": [0.0, 2.0]}
    simulation = moving(
        cable={"joint": "paper"},
        unstrained_length=60.0,
        end=(58.0, 14.0),
        elements=12 if JIT else 4,
        damping_time=0.01,
        limits={"speed": 5.0, "acceleration": 0.5},
        carriers={"name": "chair", "count": 6, "spacing": 20.0, "bodies": {"chair": chair}},
        step=0.01,
    )
    simulation.command("haul_rope", speed=4.0)
    attached = set()
    for _ in range(40 if JIT else 2):
        simulation.advance_to(simulation.time + (0.5 if JIT else 0.01))
        check(simulation.system, *for_kernels(simulation))
        attached.add(tuple(simulation.state.attached))
    assert len(attached) > 2 or not JIT
