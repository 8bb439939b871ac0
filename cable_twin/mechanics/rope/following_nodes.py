"""Mesh nodes that follow moving loads: taken from the mesh, handed on from load to load, returned to the mesh.

A node that returns to its home divides a cubic, which leaves the rope and its motion as they are. A node that is taken
from its home leaves one cubic between its neighbours, to which the rope there is moved.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from cable_twin.mechanics.language.compilation import inlined_kernel, kernel
from cable_twin.mechanics.language.rotations import orientation
from cable_twin.mechanics.language.traced import formula
from cable_twin.mechanics.language.vectors import accumulate, add_scaled, dot, load, scale, store, subtract, transpose
from cable_twin.mechanics.rope.patch import bends, motion_at_rest
from cable_twin.mechanics.rope.point import AFTER, BEFORE, R, interpolate, point_on
from cable_twin.mechanics.rope.shape_functions import AXIAL_PLACES, AXIAL_POINTS, AXIAL_WEIGHT, shape_functions


class Field(NamedTuple):
    """Position and slope of the rope at a fixed arc length of the mesh, with their rates and accelerations."""

    position: Any  # r (dim,) m, r_x (dim,)
    velocity: Any  # of them, per second
    acceleration: Any  # likewise
    algorithmic: Any  # likewise, of the auxiliary acceleration


@formula
def at_place(vectors, shape, shape_x):
    """Value and slope (dim,) of a cubic element at a point, from its nodal vectors and the shape functions there."""
    return (
        shape[0] * vectors[0] + shape[1] * vectors[1] + shape[2] * vectors[2] + shape[3] * vectors[3],
        shape_x[0] * vectors[0] + shape_x[1] * vectors[1] + shape_x[2] * vectors[2] + shape_x[3] * vectors[3],
    )


@inlined_kernel
def field_at(system, state, element, arc_length):
    """Shape and motion of the rope at an arc length (m) of the mesh, on a given element."""
    point = point_on(state, element, arc_length)
    e, v, a = motion_at_rest(system.cable, state, element, state.nodes.acceleration, state.joints.acceleration)
    _, _, mean = motion_at_rest(system.cable, state, element, state.nodes.algorithmic, state.joints.algorithmic)
    return Field(
        at_place(e, point.shape, point.shape_x),
        at_place(v, point.shape, point.shape_x),
        at_place(a, point.shape, point.shape_x),
        at_place(mean, point.shape, point.shape_x),
    )


@inlined_kernel
def write_row(pair, row):
    """Write position and slope (dim,) of the rope to the rows (rows, dim) of a node, one slope for both sides."""
    store(pair[0], row[R])
    store(pair[1], row[BEFORE])
    store(pair[1], row[AFTER])


@inlined_kernel
def write_field(field, nodes, node):
    """Set a mesh node to position and slope of the rope, and to their rates and accelerations, as given in `field`."""
    write_row(field.position, nodes.position[node])
    write_row(field.velocity, nodes.velocity[node])
    write_row(field.acceleration, nodes.acceleration[node])
    write_row(field.algorithmic, nodes.algorithmic[node])


@kernel
def copy_node(nodes, source, target):
    """Copy all coordinates of a node, with rates and accelerations, to another node."""
    for row in range(3):
        for axis in range(nodes.position.shape[2]):
            nodes.position[target, row, axis] = nodes.position[source, row, axis]
            nodes.velocity[target, row, axis] = nodes.velocity[source, row, axis]
            nodes.acceleration[target, row, axis] = nodes.acceleration[source, row, axis]
            nodes.algorithmic[target, row, axis] = nodes.algorithmic[source, row, axis]


@kernel
def put_node(state, node, arc_length):
    """Move a node of the mesh to an arc length (m), and update the lengths of the elements beside it."""
    places = state.mesh.arc_length
    places[node] = arc_length
    state.mesh.length[node - 1], state.mesh.length[node] = arc_length - places[node - 1], places[node + 1] - arc_length


@kernel
def give_back(system, state, node):
    """Return a node that has followed a moving load to its home arc length, after the nodes that block its path."""
    homes, places, last, first = system.cable.node_arc_length, state.mesh.arc_length, node, node
    while homes[last] >= places[last + 1]:
        last += 1
    while homes[first] <= places[first - 1]:
        first -= 1
    for moved in range(last, node, -1):
        put_back(system, state, moved)
    for moved in range(first, node + 1):
        put_back(system, state, moved)


@kernel
def put_back(system, state, node):
    """Return a node that has followed a moving load to its home between its neighbours, without moving the rope."""
    home, number = system.cable.node_arc_length[node], state.node_load[node]
    element = node if home >= state.mesh.arc_length[node] else node - 1
    write_field(field_at(system, state, element, home), state.nodes, node)
    state.node_load[node], state.joint_node[number], state.node_follows[number] = -1, -1, False
    put_node(state, node, home)


@inlined_kernel
def slope_of_one(way, lengths, near, far, place):
    """Slope (dim,) at a moving load of the one cubic that fits the two elements ahead of the load best, in mean square.

    Args:
        way: 1 where the two elements are after the load, -1 where they are before it.
        lengths: of the near element and of the far one, m.
        near: nodal vectors of the element beside the load.
        far: nodal vectors of the other one.
        place: of the new cubic at the load (dim,).
    """
    whole, total, squared = lengths[0] + lengths[1], scale(0.0, place), 0.0
    for number in range(2):
        length, vectors = (lengths[0], near) if number == 0 else (lengths[1], far)
        for point in range(AXIAL_POINTS):
            x = AXIAL_PLACES[point] * length
            shape = shape_functions(x, length)
            offset = (lengths[0] if way > 0 else 0.0) if number == 1 else (0.0 if way > 0 else lengths[1])
            merged = shape_functions(offset + x, whole)
            old = at_place(vectors, shape, shape)[0]
            if way > 0:
                known = at_place((place, scale(0.0, place), far[2], far[3]), merged, merged)[0]
                share = merged[1]
            else:
                known = at_place((far[0], far[1], place, scale(0.0, place)), merged, merged)[0]
                share = merged[3]
            weight = AXIAL_WEIGHT[point] * length * share
            total = add_scaled(weight, subtract(old, known), total)
            squared += weight * share
    return scale(1.0 / squared, total)


@inlined_kernel
def bend_of_one(way, length, far, place, slope):
    """r_xx (dim,) at a load, of the cubic from the load to a far node, from the nodal vectors at the two."""
    if way > 0:
        return bends(length, (place, slope, far[2], far[3]))[0]
    return bends(length, (far[0], far[1], place, slope))[1]


class Rest(NamedTuple):
    """Nodal vectors of an element, and their rates at fixed arc lengths of the mesh."""

    position: Any  # r_A, slope A, r_B, slope B (dim,)
    velocity: Any
    acceleration: Any
    algorithmic: Any


@inlined_kernel
def at_rest(system, state, element):
    """Nodal vectors of an element and their rates at fixed arc lengths of the mesh, as `Rest`."""
    cable, nodes, joints = system.cable, state.nodes, state.joints
    e, v, a = motion_at_rest(cable, state, element, nodes.acceleration, joints.acceleration)
    return Rest(e, v, a, motion_at_rest(cable, state, element, nodes.algorithmic, joints.algorithmic)[2])


@kernel
def leave_out(system, state, node, way):
    """Merge the two elements ahead of a moving load into one cubic, leaving out the node between them."""
    near, far = (node, node + 1) if way > 0 else (node - 1, node - 2)
    lengths = state.mesh.length[near], state.mesh.length[far]
    merge(system, state, node, way, lengths, at_rest(system, state, near), at_rest(system, state, far))


@inlined_kernel
def lateral_axis(carriages, state, number, like):
    """Lateral axis (dim,) of a load that is a vehicle whose heading the rope holds in space; 0 of others."""
    if len(like) == 3 and carriages.held[carriages.body_offset[number]] > 0:
        return transpose(orientation(state.bodies.position[carriages.body_offset[number]], like))[1]
    return scale(0.0, like)


@inlined_kernel
def write_slope(slope, lateral, nodal, row):
    """Write the slope (dim,), or its rate, on one side of a node (rows, dim); the mean along `lateral` stays."""
    half = scale(0.5 * dot(lateral, subtract(slope, load(nodal[row], slope))), lateral)
    accumulate(scale(-1.0, half), nodal[BEFORE + AFTER - row])
    store(subtract(slope, half), nodal[row])


@inlined_kernel
def merge(system, state, node, way, lengths, near, far):
    """Merge the two cubics ahead of a load into one: set the slope of the load's node on that side, and its rates.

    The slope is that of the nearest cubic in mean square, of the shape and of velocities and accelerations alike: no
    wave shorter than the merged element is passed on. Across a vehicle in space both slopes of the node share what that
    changes, so that their mean, along which the vehicle heads, stays as it is.

    Args:
        system: parameters.
        state: with the load's node, whose slope it takes.
        node: of the load.
        way: 1 where the cubics are after the load, -1 where they are before it.
        lengths: of the near cubic and of the far one, m.
        near: the cubic beside the load, `Rest`.
        far: the other one.
    """
    nodes, joints, like = state.nodes, state.joints, system.cable.gravity
    number, whole = state.node_load[node], lengths[0] + lengths[1]
    lateral = lateral_axis(system.carriages, state, number, like)
    speed = joints.velocity[number] if state.node_follows[number] else 0.0
    place = load(nodes.position[node, R], like)
    slope = slope_of_one(way, lengths, near.position, far.position, place)
    bend = bend_of_one(way, whole, far.position, place, slope)
    moving = add_scaled(-speed, slope, load(nodes.velocity[node, R], like))
    turning = slope_of_one(way, lengths, near.velocity, far.velocity, moving)
    bending = bend_of_one(way, whole, far.velocity, moving, turning)
    row = AFTER if way > 0 else BEFORE
    convected = add_scaled(2.0 * speed, turning, scale(speed * speed, bend))
    for kind in range(2):
        along = joints.acceleration[number] if kind == 0 else joints.algorithmic[number]
        whole_rate = load(nodes.acceleration[node, R] if kind == 0 else nodes.algorithmic[node, R], like)
        along = along if state.node_follows[number] else 0.0
        there = subtract(whole_rate, add_scaled(along, slope, convected))
        beside = near.acceleration if kind == 0 else near.algorithmic
        beyond = far.acceleration if kind == 0 else far.algorithmic
        turned = slope_of_one(way, lengths, beside, beyond, there)
        turned = add_scaled(along, bend, add_scaled(2.0 * speed, bending, turned))
        write_slope(turned, lateral, nodes.acceleration[node] if kind == 0 else nodes.algorithmic[node], row)
    write_slope(slope, lateral, nodes.position[node], row)
    write_slope(add_scaled(speed, bend, turning), lateral, nodes.velocity[node], row)


@kernel
def shift_train(system, state, first, last, way):
    """Hand the loads at nodes `first` to `last` on to the next nodes, `way` 1 or -1; one node returns to its home.

    The node that returns divides a cubic, which leaves the rope as it is; the node that is taken ahead leaves one cubic
    of two elements, which loses the part of a wave that only two can represent.
    """
    behind, front = (first, last) if way > 0 else (last, first)
    home = system.cable.node_arc_length[behind]
    field = field_at(system, state, behind - 1 if way > 0 else behind, home)
    leave_out(system, state, front, way)
    node = front
    for _ in range(last - first + 1):
        number = state.node_load[node]
        copy_node(state.nodes, node, node + way)
        state.node_load[node + way], state.joint_node[number] = number, node + way
        state.mesh.arc_length[node + way] = state.mesh.arc_length[node]
        node -= way
    state.node_load[behind] = -1
    write_field(field, state.nodes, behind)
    state.mesh.arc_length[behind] = home
    for node in range(min(first, first + way), max(last, last + way) + 1):
        put_node(state, node, state.mesh.arc_length[node])


@inlined_kernel
def write_both(row, nodes, before, after, side):
    """Write r and both slopes of a node from nodal vectors of both its elements; r from the one after for `side` 1."""
    store(add_scaled(side, after[0], scale(1.0 - side, before[2])), nodes[row, R])
    store(before[3], nodes[row, BEFORE])
    store(after[1], nodes[row, AFTER])


@kernel
def stand_still(system, state, node):
    """Stop a node that has followed its load at its present arc length.

    The rope has another velocity on either side of the node; with that of the side to which the load moves on, the load
    keeps its own velocity.
    """
    nodes, joints = state.nodes, state.joints
    _, v_before, a_before = motion_at_rest(system.cable, state, node - 1, nodes.acceleration, joints.acceleration)
    _, v_after, a_after = motion_at_rest(system.cable, state, node, nodes.acceleration, joints.acceleration)
    _, _, mean_before = motion_at_rest(system.cable, state, node - 1, nodes.algorithmic, joints.algorithmic)
    _, _, mean_after = motion_at_rest(system.cable, state, node, nodes.algorithmic, joints.algorithmic)
    side = 1.0 if joints.velocity[state.node_load[node]] > 0.0 else 0.0
    write_both(node, nodes.velocity, v_before, v_after, side)
    write_both(node, nodes.acceleration, a_before, a_after, side)
    write_both(node, nodes.algorithmic, mean_before, mean_after, side)
    state.node_follows[state.node_load[node]] = False


@kernel
def take_node(system, state, number, node, s, follow):
    """Move a free node to the arc length s (m) of a moving load on an adjacent element, without moving the rope.

    The two elements on the other side of its former place become one cubic, as by `leave_out`.

    Args:
        system: parameters.
        state: of the rope.
        number: of the load.
        node: free, or with a load that comes back to it.
        s: m, of the load if the node follows it.
        follow: whether the node follows the load, or stands at s.
    """
    home, like = state.mesh.arc_length[node], system.cable.gravity
    element, way = (node - 1, 1) if s < home else (node, -1)
    field = field_at(system, state, element, s)
    cut, far = at_rest(system, state, element), at_rest(system, state, element + way)
    near = Rest(
        part_of(way, field.position, cut.position),
        part_of(way, field.velocity, cut.velocity),
        part_of(way, field.acceleration, cut.acceleration),
        part_of(way, field.algorithmic, cut.algorithmic),
    )
    length = state.mesh.length[element + way]
    lengths = max(way * (home - s), 1e-6 * length), length
    write_field(going_along(state, number, element, s, field, follow, like), state.nodes, node)
    state.node_load[node], state.joint_node[number], state.node_follows[number] = number, node, follow
    put_node(state, node, s)
    state.joint_element[number] = node - 1 if follow or state.joints.position[number] < s else node
    merge(system, state, node, way, lengths, near, far)


@inlined_kernel
def part_of(way, at_load, vectors):
    """Nodal vectors of one part of an element divided at a load: from load to end (`way` 1), or start to load (-1)."""
    if way > 0:
        return at_load[0], at_load[1], vectors[2], vectors[3]
    return vectors[0], vectors[1], at_load[0], at_load[1]


@inlined_kernel
def going_along(state, number, element, s, field, follow, like):
    """Motion of a node at an arc length s (m), from the motion of the rope there, if the node follows a moving load."""
    if not follow:
        return field
    speed, point = state.joints.velocity[number], point_on(state, element, s)
    bend = interpolate(state.nodes.position, element, point.shape_xx, like)
    bend_rate = interpolate(state.nodes.velocity, element, point.shape_xx, like)
    slope, turning = field.position[1], field.velocity[1]
    moved = add_scaled(speed, slope, field.velocity[0]), add_scaled(speed, bend, turning)
    convected = (
        add_scaled(2.0 * speed, turning, scale(speed * speed, bend)),
        scale(2.0 * speed, bend_rate),
    )
    along, mean = state.joints.acceleration[number], state.joints.algorithmic[number]
    true = (
        add_scaled(1.0, field.acceleration[0], add_scaled(along, slope, convected[0])),
        add_scaled(1.0, field.acceleration[1], add_scaled(along, bend, convected[1])),
    )
    auxiliary = (
        add_scaled(1.0, field.algorithmic[0], add_scaled(mean, slope, convected[0])),
        add_scaled(1.0, field.algorithmic[1], add_scaled(mean, bend, convected[1])),
    )
    return Field(field.position, moved, true, auxiliary)
