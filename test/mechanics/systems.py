"""Small mechanical systems in general position, and numerical derivatives, for tests of the mechanics."""

import numpy as np

from cable_twin.mechanics.language.declared import arrays_of, with_arrays, write
from cable_twin.mechanics.parameters import (
    ALONE,
    CONTINUUM,
    END,
    NO_BUFFERS,
    Air,
    Cable,
    Carriages,
    Counterweights,
    DriveLimits,
    HaulRopes,
    Solver,
    System,
    Towers,
    mesh_fields,
)
from cable_twin.mechanics.state import State, allocate_state, allocate_workspace
from cable_twin.simulation.engine import leave_out_absent


def make_cable(dim=2, **changes):
    """Cable of three elements of 0.7 m on average, pinned at both ends, with forces of a few hundred N.

    Elements are 20 % longer and shorter than that in turn, so that no test takes them as equal; `even` makes them so.
    """
    count, length = changes.pop("element_count", 3), changes.pop("element_length", 0.7)
    uneven = np.where(np.arange(count) % 2 == 1, 0.8, 1.2) if not changes.pop("even", False) else np.ones(count)
    if "node_arc_length" in changes:
        return make_cable(dim, **{key: value for key, value in changes.items() if key != "node_arc_length"})._replace(
            **mesh_fields(changes["node_arc_length"])
        )
    nodes = length * count * np.concatenate([[0.0], np.cumsum(uneven)]) / uneven.sum()
    gravity = (0.0, -9.81) if dim == 2 else (0.0, 0.0, -9.81)
    pinned = np.stack([np.zeros(dim * dim), np.eye(dim).ravel()])
    cable = Cable(
        **mesh_fields(nodes),
        mass_per_length=1.3,
        axial_stiffness=900.0,
        bending_stiffness=7.0,
        damping_time=0.0,
        elastic_model=CONTINUUM,
        gravity=gravity,
        end_position=np.zeros((2, dim)),
        end_projector=np.stack([pinned, pinned]),
        end_direction=np.full((2, dim), np.nan),
        load_arc_length=np.zeros(0),
        load_force=np.zeros((0, dim)),
        end_moment=np.zeros(2),
    )
    return cable._replace(**changes)


def make_carriages(chains=(), dim=2, **changes):
    """Carriages with given numbers of bodies, all different, without friction and with soft end stops."""
    offset = np.cumsum([0, *chains]).astype(np.int64)
    bodies, count = int(offset[-1]), len(chains)
    numbers = np.arange(bodies, dtype=float)
    upper = np.stack([0.05 - 0.02 * numbers, 0.3 + 0.03 * numbers], axis=1)
    lower = np.stack([-0.04 + 0.03 * numbers, -0.25 - 0.02 * numbers], axis=1)
    inertia = 0.4 + 0.1 * numbers
    if dim == 3:
        upper, lower = (np.insert(pivots, 1, 0.02 * (1.0 + numbers), axis=1) for pivots in (upper, lower))
        tensor = np.array([[0.5, 0.03, -0.02], [0.03, 0.4, 0.01], [-0.02, 0.01, 0.3]])
        inertia = (1.0 + 0.2 * numbers)[:, None] * tensor.ravel()
    carriages = Carriages(
        body_offset=offset,
        mass=3.0 + numbers,
        inertia=inertia,
        upper_pivot=upper,
        lower_pivot=lower,
        hinge_stiffness=np.zeros(bodies),
        hinge_damping=np.zeros(bodies),
        roll_damping=np.zeros(bodies),
        held=np.full(bodies, 0 if dim == 2 else 1, dtype=np.int64),
        centre_offset=np.zeros((bodies, dim)),
        fixed=np.zeros(count, dtype=np.bool_),
        clamped=np.zeros(count, dtype=np.bool_),
        loop_place=np.zeros(count),
        rails=np.zeros(count),
        rolling_friction=np.zeros(count),
        viscous_friction=np.zeros(count),
        presliding=np.full(count, 1e-2),
        limits=make_limits(count),
        drive_stops=np.ones(count, dtype=np.bool_),
        brake_force=np.zeros((count, 3)),
        brake_rise_time=np.zeros((count, 3)),
        stop_stroke=np.full(count, 0.1),
        stop_stiffness=np.full(count, 800.0),
        stop_damping=np.full(count, 0.3),
    )
    return carriages._replace(**changes)


def make_limits(count=1, acceleration=0.5, emergency_deceleration=1.5, **changes):
    """Drive limits with limited accelerations only."""
    limits = DriveLimits(*np.full((7, count), np.inf))._replace(
        acceleration=np.full(count, acceleration),
        deceleration=np.full(count, acceleration),
        emergency_deceleration=np.full(count, emergency_deceleration),
    )
    return limits._replace(**{name: np.full(count, value) for name, value in changes.items()})


def make_towers(dim=2, contacts=0, **changes):
    """Towers of one contact each, with friction, below the cable of `disturbed_state`."""
    numbers = np.arange(contacts, dtype=float)
    side = np.zeros((contacts, dim))
    side[:, -1] = 1.0
    left = np.zeros((contacts, dim))
    left[:, 1] = float(dim == 3)
    towers = Towers(
        contact_offset=np.arange(contacts + 1, dtype=np.int64),
        contact_tower=np.arange(contacts, dtype=np.int64),
        top=np.zeros((contacts, dim)),
        position=np.zeros((contacts, dim)),
        normal=side,
        stiffness=3000.0 + 100.0 * numbers,
        damping=np.full(contacts, 0.2),
        friction=np.full(contacts, 0.3),
        presliding=np.full(contacts, 0.02),
        apart=np.zeros(contacts),
        toe=np.full(contacts, 0.01),
        groove=np.full(contacts, 4.0),
        left=left,
        derailment_ratio=np.full(contacts, 0.5),
        groove_friction=np.zeros(contacts),
        groove_height=np.full(contacts, 0.05),
    )
    return towers._replace(**changes)


def make_counterweights(dim=2, **changes):
    """Record of counterweights with none at either end."""
    weights = Counterweights(
        direction=np.full((2, dim), np.nan),
        mass=np.zeros(2),
        force=np.zeros(2),
        travel=np.tile([-np.inf, np.inf], (2, 1)),
        stiffness=np.ones(2),
        damping=np.zeros(2),
    )
    return weights._replace(**changes)


def make_haul_ropes(count, **changes):
    """Haul ropes for `count` carriages, none unless an axial stiffness is given."""
    ropes = HaulRopes(
        axial_stiffness=np.zeros(count),
        mass_per_length=np.full(count, 2.0),
        damping_ratio=np.full(count, 0.05),
        station=np.full(count, END, dtype=np.int64),
        beyond_track=np.full(count, 0.4),
        pretension=np.full(count, 500.0),
        drive_inertia=np.full(count, 7.0),
        present="axial_stiffness" in changes,
    )
    return ropes._replace(**changes)


def make_system(
    dim=2, *, chains=(), cable=None, carriages=None, towers=None, counterweights=None, haul_ropes=None, air=None
):
    """Complete system of the type that simulations have; without drag unless `air` is given."""
    bodies = sum(chains)
    whole = System(
        cable=make_cable(dim, **(cable or {})),
        carriages=make_carriages(chains, dim, **(carriages or {})),
        towers=make_towers(dim, **(towers or {})),
        counterweights=make_counterweights(dim, **(counterweights or {})),
        haul_ropes=make_haul_ropes(len(chains), **(haul_ropes or {})),
        air=Air(rope_drag=0.0, body_drag=np.zeros((bodies, dim * dim)), present=False) if air is None else air,
        solver=Solver(step=1e-3, spectral_radius=0.7, tolerance=1e-9, max_iterations=12, max_halvings=4),
    )
    (system,) = leave_out_absent([whole])
    return system


def with_moving_cable(system, moving):
    """Copy of a system with an axially moving cable, of the type that simulations have."""
    return system._replace(number=ALONE, moving_cable=moving, buffers=NO_BUFFERS)


def disturbed_state(system, seed=1):
    """State in general position (a stretched wavy cable, everything in motion) and its workspace."""
    rng = np.random.default_rng(seed)
    state, work = allocate_state(system), allocate_workspace(system)
    cable, dim = system.cable, len(system.cable.gravity)
    direction = np.eye(dim)[0] * 1.05 + 0.2 * np.eye(dim)[-1]
    state.nodes.position[:, 0] = cable.node_arc_length[:, None] * direction
    state.nodes.position[:, 1:] = direction
    nodes = cable.element_count + 1
    state.nodes.position[:] += 0.08 * from_nodal_vectors(rng.standard_normal((nodes, 2, dim)), dim)
    for array in (state.nodes.velocity, state.nodes.acceleration):
        array[:] = from_nodal_vectors(rng.standard_normal((nodes, 2, dim)), dim)
    for array in (state.bodies.velocity, state.bodies.acceleration):
        array[:] = rng.standard_normal(array.shape)
    state.bodies.position[:] = 0.5 * rng.standard_normal(state.bodies.position.shape)
    if dim == 3:
        state.bodies.position[:, 3:] /= np.linalg.norm(state.bodies.position[:, 3:], axis=1, keepdims=True)
    state.multipliers[:] = 30.0 * rng.standard_normal(state.multipliers.shape)
    count = state.joints.position.size
    state.joints.position[:] = cable.unstrained_length * (np.arange(count) + 0.77) / (count + 0.6)
    state.joints.velocity[:] = rng.standard_normal(count)
    return state, work


def turned(pitch, offset):
    """A u with A = [[cos, sin], [-sin, cos]]: right-handed about y, so x turns towards -z."""
    c, s = np.cos(pitch), np.sin(pitch)
    return np.array([[c, s], [-s, c]]) @ offset


def difference(function, x, step):
    """Derivative (values, x.size) of `function` at `x` by central differences of fourth order."""
    columns = []
    for k in range(x.size):
        change = np.zeros(x.size)
        change[k] = step
        columns.append(
            (8.0 * (function(x + change) - function(x - change)) - function(x + 2 * change) + function(x - 2 * change))
            / (12.0 * step)
        )
    return np.stack(columns, axis=-1)


def second_difference(function, step):
    """Second derivative at 0 of a function of one number, of fourth order."""
    far = function(2 * step) + function(-2 * step)
    return (16.0 * (function(step) + function(-step)) - far - 30.0 * function(0.0)) / (12.0 * step**2)


def dense_blocks(work):
    """Dense matrix (nodes 2 dim, nodes 2 dim) of the block-tridiagonal matrix of a workspace."""
    return dense_matrix(work.diagonal, work.upper, work.lower)


def dense_matrix(diagonal, upper, lower):
    """Dense matrix of blocks in the layout of `solve_block_tridiagonal`."""
    nodes, dim = diagonal.shape[0], round(diagonal.shape[3] ** 0.5)

    def square(blocks):
        return blocks.reshape(2, 2, dim, dim).transpose(0, 2, 1, 3).reshape(2 * dim, 2 * dim)

    size = 2 * dim
    matrix = np.zeros((nodes * size, nodes * size))
    for k in range(nodes):
        here, after = slice(k * size, (k + 1) * size), slice((k + 1) * size, (k + 2) * size)
        matrix[here, here] = square(diagonal[k])
        if k < nodes - 1:
            matrix[here, after], matrix[after, here] = square(upper[k]), square(lower[k])
    return matrix


def nodal_vectors(coordinates):
    """Copy (2 nodes, dim) of r and r_x of all nodes, none of which follows a load."""
    return coordinates[:, :2].reshape(-1, coordinates.shape[-1])


def from_nodal_vectors(vectors, dim):
    """Coordinates (nodes, 3, dim) of nodes of which none follows a load, from their r and r_x in any shape."""
    return np.take(np.reshape(vectors, (-1, 2, dim)), [0, 1, 1], axis=1)


def changed(state, into=None, **fields):
    """Copy of a state with other arrays, `into` another copy if given; those of inner records are named nodes_position.

    To write into the same copy again saves a kernel from packing it anew, which takes longer than the kernel.
    """
    names = {name.replace(".", "_"): name for name in arrays_of(state)}
    arrays = {name: value for name, value in fields.items() if not isinstance(value, tuple)}
    records = {name: value for name, value in fields.items() if isinstance(value, tuple)}
    assert arrays.keys() <= {*names, *names.values()}, f"no arrays of a state: {[*arrays]}"
    arrays = {names.get(name, name): array for name, array in arrays.items()}
    if into is None:
        return with_arrays(State, arrays_of(state) | arrays)._replace(**records)
    write(state, into)
    own = arrays_of(into)
    for name, array in arrays.items():
        own[name][...] = array
    for name, record in records.items():
        put(getattr(into, name), *record)
    return into


def put(record, *values):
    """Fill all arrays of a motion or a course with one value."""
    for array, value in zip(record, values, strict=True):
        array[:] = value
