"""The paper's integrator, for verification: explicit Runge-Kutta of order 4 on eq. 16 at acceleration level.

A joint stays on its element within a step. A step in which one leaves its element is cut at the node: there the
Jacobian is rebuilt on the neighbour, since r_xx, and with it γ, jumps (paper, end of section 3.2). Constraints hold at
acceleration level only, so their drift is fed back (Baumgarte 1972) and reported.
"""

from __future__ import annotations

from math import isfinite

import numpy as np
from numpy.typing import NDArray

from cable_twin.mechanics.drives.reference import advance_reference
from cable_twin.mechanics.language.compilation import kernel
from cable_twin.mechanics.language.memory import combine_arrays, copy_array
from cable_twin.mechanics.on_rope.sliding_joint import driven_force, settle_friction
from cable_twin.mechanics.on_rope.tower import settle_supports
from cable_twin.mechanics.parameters import SPEED, FloatArray, System
from cable_twin.mechanics.readout.columns import energies
from cable_twin.mechanics.rope.shape_functions import MASS
from cable_twin.mechanics.solution.equations_of_motion import measure_gaps, solve_accelerations
from cable_twin.mechanics.solution.generalized_alpha import worst_element
from cable_twin.mechanics.state import copy_state

IMAGINARY_LIMIT = 2.0 * 2.0**0.5  # largest stable (frequency times step) of the method for an undamped oscillation
FEEDBACK = 0.1  # Baumgarte's rate times the step
MAX_CUTS = 60  # tries to place the end of a step on a node
NODE_TOLERANCE = 1e-12  # of an element's length


def stable_step(system: System) -> float:
    """Largest stable step (s) of the method for the bare cable.

    The highest frequency is that of the endless straight mesh over all phases between neighbours, axial or in bending;
    with Kelvin-Voigt damping of time τ it is the decay rate τω² that counts.
    """
    from scipy.linalg import eigh  # noqa: PLC0415 - a quarter of a second, of every start

    cable = system.cable
    length = cable.element_length
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
    """Matrix (2, 2) of one node of an endless mesh with `phase` (rad) between nodes, from an element's (4, 4)."""
    coupling = element[:2, 2:] * np.exp(1j * phase)
    return element[:2, :2] + element[2:, 2:] + coupling + coupling.conj().T


@kernel
def combine_stage(start, weight, state):
    """Coordinates and velocities of the next stage: those of `start` plus `weight` (s) times the rates in `state`."""
    combine_arrays(start.nodal_coordinates, weight, state.nodal_velocities, state.nodal_coordinates)
    combine_arrays(start.nodal_velocities, weight, state.nodal_accelerations, state.nodal_velocities)
    combine_arrays(start.body_coordinates, weight, state.body_velocities, state.body_coordinates)
    combine_arrays(start.body_velocities, weight, state.body_accelerations, state.body_velocities)
    combine_arrays(start.sliding_coordinate, weight, state.sliding_velocity, state.sliding_coordinate)
    combine_arrays(start.sliding_velocity, weight, state.sliding_acceleration, state.sliding_velocity)


@kernel
def add_rates(weight, state, total):
    """Add `weight` times the rates in `state` to the sums in `total`: velocities to its coordinates, and so on."""
    combine_arrays(total.nodal_coordinates, weight, state.nodal_velocities, total.nodal_coordinates)
    combine_arrays(total.nodal_velocities, weight, state.nodal_accelerations, total.nodal_velocities)
    combine_arrays(total.body_coordinates, weight, state.body_velocities, total.body_coordinates)
    combine_arrays(total.body_velocities, weight, state.body_accelerations, total.body_velocities)
    combine_arrays(total.sliding_coordinate, weight, state.sliding_velocity, total.sliding_coordinate)
    combine_arrays(total.sliding_velocity, weight, state.sliding_acceleration, total.sliding_velocity)


@kernel
def classical_step(system, state, start, total, h, work):
    """One step of the classical method from `start`; returns whether all four stages could be solved."""
    copy_state(start, state)
    copy_state(start, total)
    for stage in range(4):
        if not solve_accelerations(system, state, FEEDBACK / system.solver.step, work):
            return False
        add_rates(h / 6.0 if stage in (0, 3) else h / 3.0, state, total)
        if stage < 3:
            combine_stage(start, h if stage == 2 else 0.5 * h, state)
    copy_array(total.nodal_coordinates, state.nodal_coordinates)
    copy_array(total.nodal_velocities, state.nodal_velocities)
    copy_array(total.body_coordinates, state.body_coordinates)
    copy_array(total.body_velocities, state.body_velocities)
    copy_array(total.sliding_coordinate, state.sliding_coordinate)
    copy_array(total.sliding_velocity, state.sliding_velocity)
    for carriage in range(system.carriages.fixed.size):
        if state.drive_mode[carriage] == SPEED:
            advance_reference(system.carriages, system.cable, state, carriage, h)
            state.sliding_coordinate[carriage] = state.reference[carriage, 0]
            state.sliding_velocity[carriage] = state.reference[carriage, 1]
    return True


@kernel
def overshoot(cable, state):
    """How far (elements) the joint that left its element most is beyond its node; and which joint that is."""
    farthest, which = 0.0, -1
    for carriage in range(state.sliding_coordinate.size):
        place = state.sliding_coordinate[carriage] / cable.element_length - state.sliding_element[carriage]
        beyond = 0.0
        if place > 1.0 and state.sliding_element[carriage] < cable.element_count - 1:
            beyond = place - 1.0
        elif place < 0.0 and state.sliding_element[carriage] > 0:
            beyond = -place
        if beyond > farthest:
            farthest, which = beyond, carriage
    return farthest, which


@kernel
def step_to_node(system, state, start, total, h, work):
    """Take a step of at most `h` (s) that ends where the first joint on its way reaches a node.

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
            place = state.sliding_coordinate[which] / cable.element_length - state.sliding_element[which]
            if min(abs(place), abs(place - 1.0)) <= NODE_TOLERANCE or long - short <= 1e-14 * h:
                return taken, which
            short = taken
        else:
            long = taken
        # the joint moves almost evenly within a step, so Newton's guess from its speed is nearly right
        speed = state.sliding_velocity[which] / cable.element_length
        place = state.sliding_coordinate[which] / cable.element_length - state.sliding_element[which]
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
    """Move a joint that is on a node to the element it goes to."""
    place = state.sliding_coordinate[carriage] / cable.element_length - state.sliding_element[carriage]
    element = state.sliding_element[carriage] + (1 if place > 0.5 else -1)
    state.sliding_element[carriage] = min(max(element, 0), cable.element_count - 1)


@kernel
def advance_explicitly(system, state, start, total, work, steps):
    """Take `steps` whole steps; the counterpart of `generalized_alpha.advance`, with the same outcome.

    `iterations` counts solutions of eq. 16 beyond the four a step needs, `halvings` the nodes that were passed, `gap`
    is the drift of the constraints (m). A step after which the energy is not finite is taken back and ends the call.
    """
    worst_gap, nodes = 0.0, 0
    for done in range(steps):
        copy_state(state, start)
        left = system.solver.step
        healthy = True
        while healthy and left > 1e-12 * system.solver.step:
            taken, carriage = step_to_node(system, state, start, total, left, work)
            healthy = taken >= 0.0
            if healthy:
                left -= taken
                for joint in range(system.carriages.fixed.size):
                    settle_friction(system.carriages, state, joint)
                settle_supports(system.cable, system.supports, state)
                if carriage >= 0:
                    change_element(system.cable, state, carriage)
                    nodes += 1
                if left > 1e-12 * system.solver.step:
                    copy_state(state, total)
                    copy_state(total, start)
        gap = measure_gaps(system, state, work, False)
        kinetic, elastic, gravitational = energies(system, state)
        if not healthy or not isfinite(gap) or not isfinite(kinetic + elastic + gravitational):
            copy_state(start, state)
            return False, done, 0, nodes, worst_gap, gap, worst_element(work)
        worst_gap = max(worst_gap, gap)
        state.clock[0] += 1
    for carriage in range(system.carriages.fixed.size):
        if state.drive_mode[carriage] == SPEED:
            state.drive_force[carriage] = driven_force(system, state, carriage)
    return True, steps, 0, nodes, worst_gap, 0.0, worst_element(work)
