"""Static equilibrium for the start: elastic catenary of the bare cable, relaxed with every joint held."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cable_twin.basics.units import with_unit
from cable_twin.mechanics.drives.joint_drive import hold_all, release_joints
from cable_twin.mechanics.language.compilation import as_python
from cable_twin.mechanics.language.declared import arrays_of, declared
from cable_twin.mechanics.on_rope.load_node import AT_END, LEAST
from cable_twin.mechanics.on_rope.presence import bodies_of, vehicles_of
from cable_twin.mechanics.parameters import CONTINUUM, ELEMENT_FRAME, FloatArray, IntArray, System
from cable_twin.mechanics.rope.ale import rest_stretch
from cable_twin.mechanics.solution.bundle.assembly import Assembly, Rope
from cable_twin.mechanics.solution.bundle.records import LONGEST_GAP
from cable_twin.mechanics.solution.catenary import EquilibriumError, rest_over_supports
from cable_twin.mechanics.solution.relaxation import LAST, STALLED, Relaxed, hang_carriages, relax, relax_in_parts
from cable_twin.mechanics.state import State, WindField, Workspace

SOFTER = (1e-4, 1e-3, 1e-2, 1e-1)  # of the stiffness of the cable
LONGEST_WAY = 0.1  # of the shortest element, that a point goes in an iteration of a rope by itself
FIRST_STEP = 1e-2  # s, of the first iteration of ropes together
LONGEST_WAY_TOGETHER = 0.2  # m, that a point goes in one
COARSE = 1e-9  # of its length: increment at which a start of the second method ends
STIFFEST = 1e9  # of the forces on it: a strain of 1e-9, of which rounding leaves six digits
GIVEN = {"joints.position", "axis", "drives.mode", "attached", "vehicle_rope", "wind", "clock"}  # what a start has
GIVEN |= {"rope.position", "mesh.arc_length", "mesh.length", "mesh.plain", "node_load", "joint_node", "node_follows"}
GIVEN |= {"temperature", *(f"wind_field.{name}" for name in WindField._fields)}


def catenary(system: System, arc_lengths: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Elastic catenary of the bare cable between two held ends.

    Args:
        system: parameters.
        arc_lengths: (n,) m.

    Returns:
        Positions (n, dim) in m and slopes r_x (n, dim).

    Raises:
        EquilibriumError: when no catenary meets both ends.
    """
    cable = system.cable
    if not np.any(cable.gravity):
        start, end = cable.end_position
        slope = (end - start) / cable.unstrained_length
        return start + np.outer(arc_lengths, slope), np.tile(slope, (arc_lengths.size, 1))
    return rest_over_supports(system).place(arc_lengths)


def settled(
    system: System, state: State, work: Workspace, tolerance: float, *, near: bool = False, patience: int = STALLED
) -> Relaxed:
    """Relax one rope alone with all its joints held.

    Args:
        system: parameters.
        state: is left at rest.
        work: scratch space.
        tolerance: last increment (m) that is allowed.
        near: whether the rope is near its equilibrium already.
        patience: number of iterations without progress after which it gives up.
    """
    cable = system.cable
    alone = Assembly([Rope(system, state, work)])
    shortest = cable.cell_length
    wave_time = shortest * (cable.mass_per_length / cable.axial_stiffness) ** 0.5
    how = tolerance, 1.0 / (wave_time * wave_time), LONGEST_WAY * shortest
    begin = LAST * how[1] if near else 0.0
    elements = len(state.nodes.position) - 1
    return relax_in_parts(lambda *part: relax(*alone.relaxed, *how, *part), elements, begin, patience)


def settle_near(system: System, state: State, work: Workspace) -> None:
    """Relax one rope alone from a similar rope's equilibrium to its own, with all its joints held.

    Args:
        system: parameters.
        state: of the rope, with the shape of the similar one.
        work: scratch space.

    Raises:
        EquilibriumError: no equilibrium is found from there.
    """
    state.friction_origin[:] = state.joints.position
    held = hold_all(system, state)
    tolerance = 1e-11 * system.cable.unstrained_length
    end = settled(without_friction(system), state, work, tolerance, near=True)
    if not end.at_rest:
        left = _left([Rope(system, state, work)], end, tolerance)
        raise EquilibriumError(f"no static equilibrium of the rope near the given one {left}")
    release_joints(system, state, *held)


def settle_together(ropes: Assembly, tolerance: float, elements: int, *, near: bool = False) -> None:
    """Relax coupled ropes together, starting from the equilibrium of each rope alone.

    Args:
        ropes: with their couplings.
        tolerance: last increment (m) that is allowed.
        elements: of all ropes.
        near: whether the ropes are near their common equilibrium already.

    Raises:
        EquilibriumError: no equilibrium is found.
    """
    how = tolerance, 1.0 / (FIRST_STEP * FIRST_STEP), LONGEST_WAY_TOGETHER
    begin = LAST * how[1] if near else 0.0
    try:
        end = relax_in_parts(lambda *part: relax(*ropes.relaxed, *how, *part), elements, begin)
    finally:
        ropes.scratch.closing[0] = LONGEST_GAP  # a search that fails leaves less, with which no clamp closes
    if not end.at_rest:
        raise EquilibriumError(
            f"no static equilibrium of the ropes together {_left(ropes.ropes, end, tolerance)}; check lengths, loads, "
            "pretension and counterweights of the ropes, or give more elements"
        )


def _left(ropes: Sequence[Rope], end: Relaxed, tolerance: float) -> str:
    """Text about a relaxation without success; `tolerance`: last increment (m) that is allowed."""
    moved = [np.nan_to_num(np.linalg.norm(rope.work.right_side[:, 0], axis=1)) for rope in ropes]
    most = max(range(len(ropes)), key=lambda row: float(moved[row].max()))
    place = float(ropes[most].state.mesh.arc_length[int(moved[most].argmax())])
    return (
        f"after {end.iterations} iterations: the last one moved a point by {with_unit(end.increment, 'm', 3)}, nodes "
        f"most at {place:.1f} m of {ropes[most].name}; allowed: {with_unit(tolerance, 'm', 3)}"
    )


def hanging(system: System) -> tuple[FloatArray, FloatArray]:
    """Straight initial shape of a cable with one free end: along its clamp, or down from its pin.

    Returns:
        Positions (nodes, dim) in m and slopes (nodes, dim).

    Raises:
        EquilibriumError: when the cable has neither a clamp nor weight.
    """
    cable = system.cable
    arc_lengths = cable.node_arc_length
    held = 0 if np.all(np.isfinite(cable.end_position[0])) else 1
    direction = cable.end_direction[held]
    if not np.all(np.isfinite(direction)):
        down = np.array(cable.gravity)
        strength = float(np.linalg.norm(down))
        if strength == 0.0:
            raise EquilibriumError(
                "gravity: given 0 m/s², where a cable on one pin is at rest in any direction; "
                "allowed: more than 0 m/s², or a clamped end"
            )
        direction = down / strength * (1.0 if held == 0 else -1.0)
    from_held = arc_lengths - (cable.unstrained_length if held == 1 else 0.0)
    return cable.end_position[held] + np.outer(from_held, direction), np.tile(direction, (arc_lengths.size, 1))


def lay_straight(system: System, state: State, start: FloatArray, end: FloatArray) -> None:
    """Initialise the cable straight and unstrained from `start` towards `end` (dim,) in m, vehicles hanging below."""
    lay_mesh(system, state)
    direction = (end - start) / np.linalg.norm(end - start)
    arc_lengths = state.mesh.arc_length
    state.nodes.position[:, 0] = start + np.outer(arc_lengths, direction)
    state.nodes.position[:, 1:] = direction
    hang_at_rest(system, state)


def hang_at_rest(system: System, state: State) -> None:
    """Hang a rope's vehicles at rest at their arc lengths, and start friction and drive references there."""
    own = vehicles_of(system, state)
    state.friction_origin[own] = state.reference.position[own] = state.joints.position[own]
    hang_carriages(system, state)


def lay_taut(system: System, state: State) -> None:
    """Initialise the cable straight and evenly stretched between its ends, vehicles hanging below."""
    lay_mesh(system, state)
    cable = system.cable
    start, end = cable.end_position
    state.nodes.position[:, 1:] = (end - start) / cable.unstrained_length
    state.nodes.position[:, 0] = start + state.mesh.arc_length[:, None] * state.nodes.position[0, 1]
    hang_at_rest(system, state)


def lay_mesh(system: System, state: State) -> None:
    """Initialise the mesh of a rope, with a node at each vehicle where nodes of this mesh are to follow vehicles.

    Nodes of loads in the first and last element of a moving rope stand where `update_load_nodes` puts them.
    """
    homes, own = system.cable.node_arc_length, vehicles_of(system, state)
    state.mesh.arc_length[:], state.mesh.length[:], state.mesh.plain[:] = homes, system.cable.element_length, 1.0
    state.node_load[:], state.joint_node[own], state.node_follows[own] = -1, -1, False
    if not system.cable.load_nodes:
        return
    riders = np.flatnonzero(own & state.attached)
    riders = riders[np.argsort(state.joints.position[riders], kind="stable")]
    places, room = state.joints.position[riders], AT_END * np.diff(homes)[[0, -1]]
    if system.moving_cable.moving:
        places = np.clip(places, homes[0] + room[0], homes[-1] - room[1])
    for rider, node, s in with_room(homes, riders, places, nodes_for(homes, places), LEAST * system.cable.cell_length):
        load = state.joints.position[rider]
        state.mesh.arc_length[node] = s
        state.node_load[node], state.joint_node[rider], state.node_follows[rider] = rider, node, load == s
        state.joint_element[rider] = node - 1 if load <= s else node
    beside = (state.node_load[:-1] >= 0) | (state.node_load[1:] >= 0)
    state.mesh.length[:] = np.where(beside, np.diff(state.mesh.arc_length), state.mesh.length)


def nodes_for(homes: FloatArray, places: FloatArray) -> list[int]:
    """Indices of distinct nodes, one near each load, to follow loads at rising arc lengths (m).

    Loads that compete for the same nodes get a train of adjacent nodes, centred on the middle of the loads.
    """
    last = homes.size - 2
    trains: list[list[float]] = []  # first node, and places of the loads in elements
    for place in np.interp(places, homes, np.arange(homes.size)).tolist():
        trains.append([0.0, place])
        while True:
            own = trains[-1]
            middle = round(float(np.mean(own[1:])) - 0.5 * (len(own) - 2))
            own[0] = float(np.clip(middle, 1, max(last - len(own) + 2, 1)))
            if len(trains) < 2 or own[0] > trains[-2][0] + len(trains[-2]) - 2:
                break
            trains[-2:] = [[0.0, *trains[-2][1:], *own[1:]]]
    return [int(train[0]) + number for train in trains for number in range(len(train) - 1)]


def with_room(
    homes: FloatArray, riders: IntArray, places: FloatArray, nodes: list[int], room: float
) -> list[tuple[int, int, float]]:
    """Loads (index, node, arc length in m) whose node keeps at least `room` (m) to both neighbouring nodes."""
    kept = [load for load in zip(riders.tolist(), nodes, places.tolist(), strict=True) if 0 < load[1] < homes.size - 1]
    while True:
        mesh = homes.copy()
        for _, node, s in kept:
            mesh[node] = s
        tight = [k for k, (_, node, s) in enumerate(kept) if not mesh[node - 1] + room < s < mesh[node + 1] - room]
        if not tight:
            return kept
        del kept[tight[0]]


def lay_cable(system: System, state: State) -> None:
    """Initialise nodes and tower contacts with the equilibrium of the bare cable over its supports.

    Raises:
        EquilibriumError: when there is no such equilibrium.
    """
    cable, towers = system.cable, system.towers
    arc_lengths = state.mesh.arc_length
    ends = cable.end_position.copy()
    stretch = as_python(rest_stretch)(cable, state)
    whole = system._replace(cable=cable._replace(unstrained_length=stretch * cable.unstrained_length))
    if not np.all(np.isfinite(ends)):
        positions, slopes = hanging(system)
    elif towers.top.size == 0 and not np.any(system.counterweights.mass):
        positions, slopes = catenary(whole, stretch * arc_lengths)
    else:
        rest = rest_over_supports(whole)
        positions, slopes = rest.place(stretch * arc_lengths)
        ends = rest.corner[[0, -1]]
        for tower, middle in enumerate(np.cumsum(rest.length)[:-1]):
            first, last = towers.contact_offset[tower : tower + 2]
            state.contact_arc_length[first:last] = middle / stretch
    slopes = stretch * slopes  # by the arc length of the mesh, on which bullwheels may have let more rope
    for end, place, direction in zip((0, -1), ends, cable.end_direction, strict=True):
        if np.all(np.isfinite(place)):
            positions[end] = place  # the catenary gives it roughly, and of a vertical span makes a steep one
        if np.all(np.isfinite(direction)):
            slopes[end] = direction * np.linalg.norm(slopes[end])
    state.nodes.position[:, 0], state.nodes.position[:, 1:] = positions, slopes[:, None]


def stiffen(system: System, state: State, work: Workspace, tolerance: float) -> Relaxed:
    """Relax a series of cables of increasing axial stiffness, each from the shape of the softer one before.

    Args:
        system: parameters.
        state: is initialised anew, and left at rest.
        work: scratch space.
        tolerance: last increment (m) that is allowed.

    Returns:
        End of the last relaxation.
    """
    cable = system.cable
    lay_cable(system, state)
    rough = 1e-6 * cable.unstrained_length
    for share in SOFTER:
        softer = system._replace(cable=cable._replace(axial_stiffness=share * cable.axial_stiffness))
        settled(softer, state, work, rough)
    return settled(system, state, work, tolerance, patience=2 * STALLED)  # the last resort: stiff cables are slow


def _advice(system: System, state: State) -> str:
    """Text that advises how to change a rope whose relaxation has failed."""
    cable = system.cable
    mass = cable.mass_per_length * cable.unstrained_length + float(
        system.carriages.mass[bodies_of(system, state)].sum()
    )
    loads = float(np.linalg.norm(cable.load_force, axis=1).sum()) + mass * float(np.linalg.norm(cable.gravity))
    if cable.axial_stiffness > STIFFEST * loads > 0.0:
        return (
            f"its strain under {with_unit(loads, 'N', 3)} is lost in rounding: lower cable.axial_stiffness, "
            f"{with_unit(STIFFEST * loads, 'N', 3)} are stiff enough"
        )
    return "change cable.elements or cable.bending_stiffness, or the length or the tension of the rope"


def without_friction(system: System) -> System:
    """Copy of the system parameters without friction of towers and joints."""
    smooth = np.zeros_like(system.carriages.rolling_friction)
    return system._replace(
        towers=system.towers._replace(friction=np.zeros_like(system.towers.friction)),
        carriages=system.carriages._replace(rolling_friction=smooth),
    )


def touching_bends(system: System) -> System:
    """Copy of the system parameters with towers that touch the rope's sharp bends at loads as well (`on_rope.tower`).

    Only searches for rests that else fail use it: steps do without, as inertia holds a load on a contact.
    """
    return system._replace(towers=system.towers._replace(at_bends=True))


def without_stops(system: System) -> System:
    """Copy of the system parameters without travel limits of counterweights."""
    weights = system.counterweights
    return system._replace(counterweights=weights._replace(travel=np.tile([-np.inf, np.inf], (2, 1))))


def settle(system: System, state: State, work: Workspace) -> None:
    """Bring `state` to static equilibrium in its wind, with every joint held at its `sliding_coordinate`.

    `drive_force` is left with what holds each joint that is driven or hauled.

    The cable lies on its towers without friction; mobilised friction of the motion starts from zero.

    Accelerations stay zero, also where a drive lets its joint go: the integrator takes that up in its first step. The
    exact accelerations of that moment (`solve_accelerations`) are those of a wave in the light cable, gone after a
    fraction of a step.

    Args:
        system: parameters of the rope and what is on it.
        state: takes the result.
        work: scratch space.

    Raises:
        EquilibriumError: when the relaxation does not end; the last increment is in the message.
    """
    cable = system.cable
    own = {"vehicle": vehicles_of(system, state), "body": bodies_of(system, state)}
    for field, array in zip(declared(State), arrays_of(state).values(), strict=True):
        if field.name not in GIVEN:
            array[own.get(str(field.shape[0]), slice(None))] = 0
    if state.bodies.position.shape[1] > state.bodies.velocity.shape[1]:
        state.bodies.position[own["body"], -1] = 1.0  # of a quaternion
    work.turned[:] = 0.0
    lay_mesh(system, state)
    lay_cable(system, state)
    state.friction_origin[own["vehicle"]] = state.joints.position[own["vehicle"]]
    held = hold_all(system, state)
    smooth = without_friction(system)
    if cable.elastic_model == ELEMENT_FRAME:  # on a coarse mesh it converges only from nearby
        continuum = smooth._replace(cable=cable._replace(elastic_model=CONTINUUM))
        settled(continuum, state, work, 1e-6 * cable.unstrained_length)
    tolerance = 1e-11 * cable.unstrained_length
    end = settled(smooth, state, work, tolerance)
    if not end.at_rest:
        tolerance = COARSE * cable.unstrained_length
        end = stiffen(smooth, state, work, tolerance)
    if not end.at_rest and system.towers.stiffness.size:
        lay_cable(system, state)
        again = settled(touching_bends(smooth), state, work, tolerance)
        end = again if again.at_rest else end
    if not end.at_rest:
        left = _left([Rope(system, state, work)], end, tolerance)
        raise EquilibriumError(f"no static equilibrium {left}; nor from softer cables; {_advice(system, state)}")
    release_joints(system, state, *held)
