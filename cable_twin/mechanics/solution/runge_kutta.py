"""Explicit Runge-Kutta of order 4 on eq. 16 at acceleration level: the paper's integrator, for verification.

A joint stays on its element within a step. A step in which one leaves its element is cut at the node: there the
Jacobian is rebuilt on the neighbour, since r_xx, and with it γ, jumps (paper, end of section 3.2). Constraints hold at
acceleration level only, so their drift is fed back (Baumgarte 1972) and reported.
"""

from __future__ import annotations

from math import isfinite
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cable_twin.mechanics.drives.motion import prescribe, report_forces
from cable_twin.mechanics.language.addresses import record_at
from cable_twin.mechanics.language.compilation import inlined_kernel, kernel
from cable_twin.mechanics.language.memory import combine_arrays, copy_array
from cable_twin.mechanics.language.rotations import make_unit, quaternion_rate
from cable_twin.mechanics.language.vectors import Vector
from cable_twin.mechanics.parameters import FloatArray, System
from cable_twin.mechanics.readout.energies import energies
from cable_twin.mechanics.rope.shape_functions import MASS
from cable_twin.mechanics.solution.bundle.records import BEFORE, GOOD, rope_of
from cable_twin.mechanics.solution.equations_of_motion import largest_gap, solve_accelerations
from cable_twin.mechanics.solution.newton import worst_element
from cable_twin.mechanics.solution.stepping import begin_step, settle
from cable_twin.mechanics.state import copy_state

IMAGINARY_LIMIT = 2.0 * 2.0**0.5  # largest stable (frequency times step) of the method for an undamped oscillation
FEEDBACK = 0.1  # Baumgarte's rate times the step
MAX_CUTS = 60  # tries to place the end of a step on a node
NODE_TOLERANCE = 1e-12  # of an element's length


def stable_step(system: System) -> float:
    """Largest step (s) at which the Runge-Kutta method is stable for a cable without vehicles.

    The highest frequency is that of the endless straight mesh of its shortest element over all phases between
    neighbours, axial or in bending; with Kelvin-Voigt damping of time τ it is the decay rate τω² that counts.
    """
    from scipy.linalg import eigh  # noqa: PLC0415 - a quarter of a second, of every start

    cable = system.cable
    length = float(cable.element_length.min())
    axial = np.array(
        [
            [6 / 5, 1 / 10, -6 / 5, 1 / 10],
            [1 / 10, 2 / 15, -1 / 10, -1 / 30],
            [-6 / 5, -1 / 10, 6 / 5, -1 / 10],
            [1 / 10, -1 / 30, -1 / 10, 2 / 15],
        ]
    )
    bending = np.array([[12.0, 6, -12, 6], [6, 4, -6, 2], [-12, -6, 12, -6], [6, 2, -6, 4]])
    mass = np.array(MASS) * cable.mass_per_length * length
    fastest = max(
        eigh(_at_phase(stiffness, phase), _at_phase(mass, phase), eigvals_only=True)[-1]
        for stiffness in (axial * cable.axial_stiffness / length, bending * cable.bending_stiffness / length**3)
        for phase in np.linspace(0.0, np.pi, 181)
    )
    frequency = float(np.sqrt(fastest))
    step = IMAGINARY_LIMIT / frequency
    if cable.damping_time > 0.0:
        step = min(step, 2.785 / (cable.damping_time * frequency**2))
    return step


def _at_phase(element: FloatArray, phase: float) -> NDArray[np.complex128]:
    """Matrix (2, 2) of a wave with `phase` (rad) from node to node of an endless mesh, from an element's (4, 4)."""
    coupling = element[:2, 2:] * np.exp(1j * phase)
    return element[:2, :2] + element[2:, 2:] + coupling + coupling.conj().T


@kernel
def add_rates(weight, rates, start, target):
    """Write `start` plus `weight` (s) times the `rates` of one kind of coordinates, positions and velocities."""
    combine_arrays(start.position, weight, rates.velocity, target.position)
    combine_arrays(start.velocity, weight, rates.acceleration, target.velocity)


@kernel
def add_body_rates(weight: float, rates: Any, start: Any, target: Any, like: Vector) -> None:
    """Write `start` plus `weight` (s) times the `rates` of bodies; quaternions in space become slightly too long."""
    if len(like) == 2:
        add_rates(weight, rates, start, target)
    else:
        _add_rates_in_space(weight, rates, start, target)


@kernel
def _add_rates_in_space(weight, rates, start, target):
    for body in range(rates.velocity.shape[0]):
        v = rates.velocity[body]
        x, y, z, w = quaternion_rate(rates.position[body], (v[3], v[4], v[5]))
        for axis, rate in enumerate((v[0], v[1], v[2], x, y, z, w)):
            target.position[body, axis] = start.position[body, axis] + weight * rate
    combine_arrays(start.velocity, weight, rates.acceleration, target.velocity)


@kernel
def add_all_rates(weight, rates, start, target, like):
    """Write `start` plus `weight` (s) times the `rates` of nodes, bodies and joints; the three states may coincide."""
    add_rates(weight, rates.nodes, start.nodes, target.nodes)
    add_body_rates(weight, rates.bodies, start.bodies, target.bodies, like)
    add_rates(weight, rates.joints, start.joints, target.joints)


@kernel
def classical_step(system, state, start, total, h, work):
    """Classical Runge-Kutta step from `start`; returns whether all four stages were solvable.

    Quaternions go with the others in their four numbers and are made unit ones at its end, where they are too long by
    h⁵: a projection, which keeps the order (Hairer, Lubich, Wanner 2006, IV.4).
    """
    like = system.cable.gravity
    copy_state(start, state)
    begin_step(system, state, h)
    copy_state(state, total)
    even_out(start.reference, state.reference, h)
    for stage in range(4):
        if not solve_accelerations(system, state, FEEDBACK / system.solver.step, work):
            return False
        add_all_rates(h / 6.0 if stage in (0, 3) else h / 3.0, state, total, total, like)
        if stage < 3:
            add_all_rates(h if stage == 2 else 0.5 * h, state, start, state, like)
    copy_place(total.nodes, state.nodes)
    copy_place(total.bodies, state.bodies)
    make_unit(state.bodies.position, like)
    copy_place(total.joints, state.joints)
    copy_array(total.reference.acceleration, state.reference.acceleration)
    prescribe(system, state)
    return True


@kernel
def even_out(before, after, h):
    """Set the accelerations of reference motions to their means over a step of `h` (s), for all of its stages."""
    for number in range(after.velocity.size):
        after.acceleration[number] = (after.velocity[number] - before.velocity[number]) / h


@kernel
def copy_place(source, target):
    """Copy coordinates and velocities of one kind of coordinates, without accelerations."""
    copy_array(source.position, target.position)
    copy_array(source.velocity, target.velocity)


@inlined_kernel
def place_in_element(cable, state, carriage):
    """Relative position of a vehicle's joint on its element, from 0 to 1."""
    element = state.joint_element[carriage]
    return (state.joints.position[carriage] - state.mesh.arc_length[element]) / state.mesh.length[element]


@kernel
def overshoot(cable, state):
    """Largest overshoot (elements) of a joint beyond a node of its element, and index of the joint."""
    farthest, which = 0.0, -1
    for carriage in range(state.joints.position.size):
        place = place_in_element(cable, state, carriage)
        beyond = 0.0
        if place > 1.0 and state.joint_element[carriage] < cable.element_count - 1:
            beyond = place - 1.0
        elif place < 0.0 and state.joint_element[carriage] > 0:
            beyond = -place
        if beyond > farthest:
            farthest, which = beyond, carriage
    return farthest, which


@kernel
def step_to_node(system, state, start, total, h, work):
    """Take a step of at most `h` (s) that ends when the first joint reaches a node.

    Returns:
        The time taken (s), or -1 when a stage could not be solved; the joint now on a node, or -1.
    """
    cable = system.cable
    if not classical_step(system, state, start, total, h, work):
        return -1.0, -1
    beyond, which = overshoot(cable, state)
    if which < 0:
        return h, -1
    short, long = 0.0, h
    taken = h
    for _ in range(MAX_CUTS):
        if beyond <= NODE_TOLERANCE:
            # within or on the node: `short` is a step that leaves nobody's element
            place = place_in_element(cable, state, which)
            if min(abs(place), abs(place - 1.0)) <= NODE_TOLERANCE or long - short <= 1e-14 * h:
                return taken, which
            short = taken
        else:
            long = taken
        # the joint moves almost evenly within a step, so Newton's guess from its speed is nearly right
        speed = state.joints.velocity[which] / state.mesh.length[state.joint_element[which]]
        place = place_in_element(cable, state, which)
        guess = taken - (place - (1.0 if speed > 0.0 else 0.0)) / speed if speed != 0.0 else 0.5 * (short + long)
        taken = guess if short < guess < long else 0.5 * (short + long)
        if not classical_step(system, state, start, total, taken, work):
            return -1.0, -1
        beyond, other = overshoot(cable, state)
        if beyond > NODE_TOLERANCE:
            which = other
    return taken, which


@kernel
def change_element(cable, state, carriage):
    """Move a vehicle's joint that is on a node to the next element in its direction."""
    place = place_in_element(cable, state, carriage)
    element = state.joint_element[carriage] + (1 if place > 0.5 else -1)
    state.joint_element[carriage] = min(max(element, 0), cable.element_count - 1)


@kernel
def advance(bundle, moving, moving_good, moving_before, scratch, system, state, work, steps):
    """Integrate `steps` whole steps of one rope; counterpart of `generalized_alpha.advance` with equal results.

    `iterations` counts solutions of eq. 16 beyond the four a step needs, `halvings` the nodes that were passed, `gap`
    is the drift of the constraints (m); energy loss is not measured. A step after which the energy is not finite is
    taken back and ends the call.
    """
    own, here, room = rope_of(bundle, 0, system, state, work)
    start, total = record_at(bundle.records[0, GOOD], state), record_at(bundle.records[0, BEFORE], state)
    worst_gap, nodes = 0.0, 0
    for done in range(steps):
        copy_state(here, start)
        left = own.solver.step
        healthy = True
        while healthy and left > 1e-12 * own.solver.step:
            taken, carriage = step_to_node(own, here, start, total, left, room)
            healthy = taken >= 0.0
            if healthy:
                left -= taken
                settle(own, here, room)
                if carriage >= 0:
                    change_element(own.cable, here, carriage)
                    nodes += 1
                if left > 1e-12 * own.solver.step:
                    copy_state(here, total)
                    copy_state(total, start)
        gap = largest_gap(own, here, room, False)
        kinetic, elastic, gravitational = energies(own, here)
        if not healthy or not isfinite(gap) or not isfinite(kinetic + elastic + gravitational):
            copy_state(start, here)
            return False, done, 0, nodes, worst_gap, gap, worst_element(room), 0.0, 0.0
        worst_gap = max(worst_gap, gap)
        here.clock[0] += 1
    report_forces(own, here)
    return True, steps, 0, nodes, worst_gap, 0.0, worst_element(room), 0.0, 0.0
