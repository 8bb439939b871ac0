"""Static start: the elastic catenary of the bare cable, relaxed with every joint held until all forces balance."""

from __future__ import annotations

from math import isfinite

import numpy as np
from scipy.optimize import root

from cable_twin.mechanics.compilation import kernel
from cable_twin.mechanics.equations_of_motion import assemble, measure_gaps, solve
from cable_twin.mechanics.generalized_alpha import largest_increment
from cable_twin.mechanics.parameters import CONTINUUM, ELEMENT_FRAME, HAULED, SPEED, FloatArray, System
from cable_twin.mechanics.sliding_joint import driven_force, local_stretch, position_on_cable
from cable_twin.mechanics.state import State, Workspace, clone_state, copy_state

MAX_RELAXATIONS = 5000


class EquilibriumError(RuntimeError):
    """No static equilibrium was found; the message says how far it came."""


def catenary(system: System, arc_lengths: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Elastic catenary (Irvine 1981) between the supports of the cable, without carriages.

    With tension (H, V + w s) at the arc length s, r_x = (1/EA + 1/T) (H, V + w s), integrated in closed form; H and
    V follow from the two ends.

    Args:
        system: parameters.
        arc_lengths: (n,) m.

    Returns:
        Positions (n, dim) in m and slopes r_x (n, dim).

    Raises:
        EquilibriumError: when no catenary meets both ends.
    """
    cable = system.cable
    gravity = np.array(cable.gravity)
    start, end = cable.support_position
    span = end - start
    strength = float(np.linalg.norm(gravity))
    chord = float(np.linalg.norm(span))
    if strength == 0.0:
        slope = span / cable.unstrained_length
        return start + np.outer(arc_lengths, slope), np.tile(slope, (arc_lengths.size, 1))
    up = -gravity / strength
    height = float(span @ up)
    level = span - height * up
    width = float(np.linalg.norm(level))
    level = level / width if width > 0.0 else np.eye(gravity.size)[0]
    weight, stiffness, length = cable.mass_per_length * strength, cable.axial_stiffness, cable.unstrained_length

    def shape(forces: FloatArray, s: FloatArray | float) -> FloatArray:
        horizontal, vertical = forces[0], forces[1]
        risen = vertical + weight * np.asarray(s)
        along = horizontal * s / stiffness
        along = along + horizontal / weight * (np.arcsinh(risen / horizontal) - np.arcsinh(vertical / horizontal))
        above = s * (vertical + 0.5 * weight * np.asarray(s)) / stiffness
        above = above + (np.hypot(horizontal, risen) - np.hypot(horizontal, vertical)) / weight
        return np.stack([along, above], axis=-1)

    # start values: parabola under its own sag when slack (Jayaraman, Knudson 1981), else the stretch of the chord
    width = max(width, 1e-3 * length)
    slack = (length**2 - height**2) / width**2 - 1.0
    if slack > 0.0:
        sag = float(np.sqrt(3.0 * slack))
        first = np.array([0.5 * weight * width / sag, 0.5 * weight * (height / np.tanh(sag) - length)])
    else:
        pull = stiffness * (chord / length - 1.0) + weight * length
        first = pull * np.array([width, height]) / chord - np.array([0.0, 0.5 * weight * length])
    scale = abs(first[0]) + abs(first[1])

    def miss(unknown: FloatArray) -> FloatArray:
        return (shape(unknown * scale, length) - [width, height]) / length

    found = root(miss, first / scale, method="hybr", tol=1e-12)
    if not np.all(np.abs(miss(found.x)) < 1e-6):
        raise EquilibriumError(
            f"no catenary of {length:g} m reaches over {width:g} m and up {height:g} m: "
            f"it misses by {np.abs(miss(found.x)).max() * length:.3g} m"
        )
    forces = found.x * scale
    tension = np.stack([np.full(arc_lengths.shape, forces[0]), forces[1] + weight * arc_lengths], axis=-1)
    slopes = tension / stiffness + tension / np.linalg.norm(tension, axis=-1, keepdims=True)
    basis = np.stack([level, up])
    return start + shape(forces, arc_lengths) @ basis, slopes @ basis


@kernel
def hang_carriages(system, state):
    """Put every chain below its place on the cable, each body upright."""
    carriages = system.carriages
    for carriage in range(carriages.fixed.size):
        place = position_on_cable(system.cable, state, state.sliding_coordinate[carriage])
        x, z = place[0], place[1]
        for body in range(carriages.body_offset[carriage], carriages.body_offset[carriage + 1]):
            state.body_coordinates[body, 0] = x - carriages.upper_pivot[body, 0]
            state.body_coordinates[body, 1] = z - carriages.upper_pivot[body, 1]
            state.body_coordinates[body, 2] = 0.0
            x = state.body_coordinates[body, 0] + carriages.lower_pivot[body, 0]
            z = state.body_coordinates[body, 1] + carriages.lower_pivot[body, 1]


@kernel
def relax(system, state, good, work, max_relaxations, tolerance):
    """Pseudo-transient continuation: implicit steps without velocity, longer and longer until they are Newton's.

    Returns:
        Number of iterations used (max_relaxations when it failed) and the last increment (m).
    """
    cable = system.cable
    wave_time = cable.element_length * (cable.mass_per_length / cable.axial_stiffness) ** 0.5
    mass_factor = 1.0 / (wave_time * wave_time)
    smallest = 1e-12 * mass_factor
    largest = 0.1 * cable.element_length
    increment = 0.0
    for iteration in range(max_relaxations):
        copy_state(state, good)
        measure_gaps(system, state, work, True)
        assemble(system, state, mass_factor, 0.0, 1.0, work)
        solvable = solve(system, state, work)
        increment = largest_increment(system, work)
        turn = 0.0
        for body in range(work.body_increment.shape[0]):
            turn = max(turn, abs(work.body_increment[body, 2]))
        if not solvable or not isfinite(increment) or increment > 3.0 * largest or turn > 0.5:
            copy_state(good, state)
            mass_factor *= 8.0
            continue
        state.nodal_coordinates[:] += work.right_side
        state.body_coordinates[:] += work.body_increment
        if increment < tolerance and mass_factor <= smallest:
            return iteration + 1, increment
        if increment < largest:
            mass_factor = max(0.25 * mass_factor, smallest)
    return max_relaxations, increment


def hanging(system: System) -> tuple[FloatArray, FloatArray]:
    """Straight start of a cable with one free end: along its clamp, or down from its pin.

    Returns:
        Positions (nodes, dim) in m and slopes (nodes, dim).

    Raises:
        EquilibriumError: when the cable has neither a clamp nor weight.
    """
    cable = system.cable
    arc_lengths = np.linspace(0.0, cable.unstrained_length, cable.element_count + 1, dtype=np.float64)
    held = 0 if np.all(np.isfinite(cable.support_position[0])) else 1
    direction = cable.support_direction[held]
    if not np.all(np.isfinite(direction)):
        down = np.array(cable.gravity)
        strength = float(np.linalg.norm(down))
        if strength == 0.0:
            raise EquilibriumError(
                "without gravity, a cable on one pin is at rest in any direction: it has to be given"
            )
        direction = down / strength * (1.0 if held == 0 else -1.0)
    from_held = arc_lengths - (cable.unstrained_length if held == 1 else 0.0)
    return cable.support_position[held] + np.outer(from_held, direction), np.tile(direction, (arc_lengths.size, 1))


def lay_straight(system: System, state: State, start: FloatArray, end: FloatArray) -> None:
    """Lay the cable at rest and unstrained from `start` towards `end` (dim,) in m, the carriages hanging below it."""
    cable = system.cable
    direction = (end - start) / np.linalg.norm(end - start)
    arc_lengths = np.linspace(0.0, cable.unstrained_length, cable.element_count + 1, dtype=np.float64)
    state.nodal_coordinates[:, 0] = start + np.outer(arc_lengths, direction)
    state.nodal_coordinates[:, 1] = direction
    state.friction_origin[:] = state.sliding_coordinate
    state.reference[:, 0] = state.sliding_coordinate
    hang_carriages(system, state)


def settle(system: System, state: State, work: Workspace) -> None:
    """Bring `state` to static equilibrium with every joint held at its `sliding_coordinate`, at rest in its wind.

    `drive_force` is left with what holds each joint that is driven or hauled.

    Accelerations stay zero, also where a drive lets its joint go: the integrator takes that up in its first step. The
    exact accelerations of that moment (`solve_accelerations`) are those of a wave in the light cable, gone after a
    fraction of a step.

    Raises:
        EquilibriumError: when the relaxation does not end; the last increment is in the message.
    """
    cable = system.cable
    arc_lengths = np.linspace(0.0, cable.unstrained_length, cable.element_count + 1, dtype=np.float64)
    both_held = bool(np.all(np.isfinite(cable.support_position)))
    positions, slopes = catenary(system, arc_lengths) if both_held else hanging(system)
    for end, place, direction in zip((0, -1), cable.support_position, cable.support_direction, strict=True):
        if np.all(np.isfinite(place)):
            positions[end] = place  # the catenary gives it roughly, and of a vertical span makes a steep one
        if np.all(np.isfinite(direction)):
            slopes[end] = direction * np.linalg.norm(slopes[end])
    given = state.wind
    for array in state[:-1]:
        if not any(array is kept for kept in (state.sliding_coordinate, state.drive_mode, state.sheave_mode, given)):
            array[:] = 0
    state.nodal_coordinates[:, 0], state.nodal_coordinates[:, 1] = positions, slopes
    state.friction_origin[:] = state.sliding_coordinate
    modes = state.drive_mode.copy()
    state.drive_mode[:] = SPEED
    state.reference[:, 0] = state.sliding_coordinate
    hang_carriages(system, state)
    if cable.elastic_model == ELEMENT_FRAME:  # on a coarse mesh it converges only from nearby
        continuum = system._replace(cable=cable._replace(elastic_model=CONTINUUM))
        relax(continuum, state, clone_state(state), work, MAX_RELAXATIONS, 1e-6 * cable.unstrained_length)
    tolerance = 1e-11 * cable.unstrained_length
    used, increment = relax(system, state, clone_state(state), work, MAX_RELAXATIONS, tolerance)
    if used >= MAX_RELAXATIONS:
        raise EquilibriumError(
            f"no static equilibrium after {used} iterations: the last one moved a point by {increment:.3g} m, "
            f"allowed are {tolerance:.3g} m"
        )
    for carriage in range(state.drive_mode.size):
        held = modes[carriage] in (SPEED, HAULED)
        state.drive_force[carriage] = driven_force(system, state, carriage) if held else 0.0
        if modes[carriage] == HAULED:  # as the rope has it, on the arc length
            state.drive_force[carriage] *= local_stretch(cable, state, carriage)
    state.drive_mode[:] = modes
