"""The haul rope of a tramway: elastic between drive sheave and carriage, inside the Newton iteration.

The sheave has its own coordinate u (m), how far it has paid or hauled rope: where the joint would be on the track if
the rope did not stretch. Of the rope, with the length l between sheave and that place,

    T = EA (u - s) / l + c (u_dot - s_dot),   c = 2 ζ sqrt(EA (m / l + ρ / 3)),

acts on s, and -T on u; T may push up to the pretension of the counter rope. The rope's mass moves as that of a rod of
two nodes: l ρ (1/3, 1/6; 1/6, 1/3) on (s, u). s is an arc length of the track, and T is the force on it: its power is
T s_dot. The weight of the rope is taken as balanced by the counter rope, whose mass belongs to the drive's inertia.
"""

from __future__ import annotations

from math import sqrt

from cable_twin.mechanics.language.compilation import kernel
from cable_twin.mechanics.on_rope.chain import carriage_mass
from cable_twin.mechanics.parameters import END, HAULED, SPEED

SHORTEST = 0.1  # of the rope beyond the track: what is left of the rope if the drive hauls the carriage too far


@kernel
def rope_length(system, carriage, travel):
    """Length (m) between the sheave and the place of `travel` (m), and its derivative by the travel."""
    beyond = system.haul_ropes.beyond_track[carriage]
    length, by_travel = beyond + travel, 1.0
    if system.haul_ropes.station[carriage] == END:
        length, by_travel = beyond + system.cable.unstrained_length - travel, -1.0
    return (length, by_travel) if length > SHORTEST * beyond else (SHORTEST * beyond, 0.0)


@kernel
def rope_damping(system, carriage, length):
    """Damping (N s/m) of the rope at a length (m), and its derivative by that."""
    ropes = system.haul_ropes
    stiffness, ratio = ropes.axial_stiffness[carriage], ropes.damping_ratio[carriage]
    mass = carriage_mass(system.carriages, carriage)
    root = sqrt(stiffness * (mass / length + ropes.mass_per_length[carriage] / 3.0))
    return 2.0 * ratio * root, -ratio * stiffness * mass / (length * length * root)


@kernel
def rope_force(system, state, carriage):
    """Force T (N) of the rope on the joint, towards larger s, without inertia.

    Returns:
        T; its derivatives by s, by s_dot and by u (N/m, N s/m); zero but T where the rope is slack. That by u_dot is
        minus the one by s_dot.
    """
    ropes = system.haul_ropes
    travel, rate = state.sheaves.position[carriage], state.sheaves.velocity[carriage]
    length, by_travel = rope_length(system, carriage, travel)
    stiffness = ropes.axial_stiffness[carriage] / length
    damping, damping_by_length = rope_damping(system, carriage, length)
    stretch = travel - state.joints.position[carriage]
    stretching = rate - state.joints.velocity[carriage]
    force = stiffness * stretch + damping * stretching
    sign = 1.0 if ropes.station[carriage] == END else -1.0
    if sign * force < -ropes.pretension[carriage]:
        return -sign * ropes.pretension[carriage], 0.0, 0.0, 0.0
    by_u = stiffness + by_travel * (damping_by_length * stretching - stiffness * stretch / length)
    return force, -stiffness, -damping, by_u


@kernel
def sheave_force(system, state, carriage):
    """Force (N) of the drive on its sheave, towards larger s: what rope and inertia take."""
    ropes = system.haul_ropes
    force, _, _, _ = rope_force(system, state, carriage)
    length, _ = rope_length(system, carriage, state.sheaves.position[carriage])
    mass = ropes.mass_per_length[carriage] * length / 6.0
    inertia = (ropes.drive_inertia[carriage] + 2.0 * mass) * state.sheaves.acceleration[carriage]
    return force + inertia + mass * state.joints.acceleration[carriage]


@kernel
def condense_sheave(system, state, carriage, mass_factor, rate_factor, work):
    """Eliminate the sheave: leaves the force on s and its derivative in `haul_force` and `haul_by_s`.

    A sheave that follows its reference is there already; the row of any other is
    (drive inertia + l ρ / 3) u_ddot + l ρ / 6 s_ddot + T = drive force.
    """
    ropes = system.haul_ropes
    force, by_s, by_s_dot, by_u = rope_force(system, state, carriage)
    length, by_travel = rope_length(system, carriage, state.sheaves.position[carriage])
    rope = ropes.mass_per_length[carriage] / 6.0
    mass, mass_by_u = rope * length, rope * by_travel
    u_ddot, s_ddot = state.sheaves.acceleration[carriage], state.joints.acceleration[carriage]
    t_by_s = by_s + rate_factor * by_s_dot
    t_by_u = by_u - rate_factor * by_s_dot
    on_s = force - mass * (2.0 * s_ddot + u_ddot)
    on_s_by_s = t_by_s - mass_factor * 2.0 * mass
    row = work.sheave_row[carriage]
    row[0], row[1], row[2] = 1.0, 0.0, 0.0
    if state.sheave_mode[carriage] != SPEED:
        on_s_by_u = t_by_u - mass_factor * mass - mass_by_u * (2.0 * s_ddot + u_ddot)
        drive = ropes.drive_inertia[carriage]
        row[0] = mass_factor * (drive + 2.0 * mass) + t_by_u + mass_by_u * (2.0 * u_ddot + s_ddot)
        row[1] = mass_factor * mass + t_by_s
        row[2] = state.drive_force[carriage] - force - (drive + 2.0 * mass) * u_ddot - mass * s_ddot
        on_s += on_s_by_u * row[2] / row[0]
        on_s_by_s -= on_s_by_u * row[1] / row[0]
    work.haul_force[carriage], work.haul_by_s[carriage] = on_s, on_s_by_s


@kernel
def recover_sheave(carriage, work):
    """Increment of u, once that of s is known."""
    row = work.sheave_row[carriage]
    work.sheave_increment[carriage] = (row[2] - row[1] * work.sliding_increment[carriage]) / row[0]


@kernel
def hang_in_rope(system, state, carriage, force):
    """Put the sheave where the rope has `force` (N) on the joint at rest; returns whether the rope can have it."""
    ropes = system.haul_ropes
    beyond, stiffness = ropes.beyond_track[carriage], ropes.axial_stiffness[carriage]
    s = state.joints.position[carriage]
    if ropes.station[carriage] == END:
        travel = (stiffness * s + force * (beyond + system.cable.unstrained_length)) / (stiffness + force)
        can = force >= -ropes.pretension[carriage]
    else:
        travel = (stiffness * s + force * beyond) / (stiffness - force)
        can = force <= ropes.pretension[carriage]
    sheaves = state.sheaves
    sheaves.position[carriage], sheaves.velocity[carriage] = travel, 0.0
    sheaves.acceleration[carriage] = sheaves.algorithmic[carriage] = 0.0
    state.reference.position[carriage] = travel
    return can


@kernel
def haul_energies(system, state):
    """Kinetic and elastic energy (J) of all haul ropes and drives."""
    kinetic, elastic = 0.0, 0.0
    for carriage in range(state.drive_mode.size):
        if state.drive_mode[carriage] == HAULED:
            u_dot, s_dot = state.sheaves.velocity[carriage], state.joints.velocity[carriage]
            length, _ = rope_length(system, carriage, state.sheaves.position[carriage])
            rope = system.haul_ropes.mass_per_length[carriage] * length / 6.0
            kinetic += 0.5 * system.haul_ropes.drive_inertia[carriage] * u_dot * u_dot
            kinetic += rope * (s_dot * s_dot + s_dot * u_dot + u_dot * u_dot)
            stiffness = system.haul_ropes.axial_stiffness[carriage] / length
            stretch = state.sheaves.position[carriage] - state.joints.position[carriage]
            sign = 1.0 if system.haul_ropes.station[carriage] == END else -1.0
            slack = -system.haul_ropes.pretension[carriage] / stiffness
            stretch = max(sign * stretch, slack)
            elastic += 0.5 * stiffness * stretch * stretch
    return kinetic, elastic
