"""What changes while the twin runs, and the scratch space of the solver: arrays only, so that kernels work in place."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cable_twin.mechanics.language.by_reference import by_reference
from cable_twin.mechanics.language.compilation import kernel
from cable_twin.mechanics.language.lanes import WIDTH
from cable_twin.mechanics.language.memory import copy_array
from cable_twin.mechanics.parameters import FREE, HAULED, SPEED, FloatArray, System


@by_reference
class State(NamedTuple):
    """Motion of the whole system at one time.

    `*_algorithmic` are the auxiliary accelerations of generalized-alpha, a weighted mean over a step of the true ones.
    """

    nodal_coordinates: FloatArray  # e, (nodes, 2, dim): r in m, r_x
    nodal_velocities: FloatArray  # (nodes, 2, dim) m/s, 1/s
    nodal_accelerations: FloatArray  # (nodes, 2, dim) m/s², 1/s²
    nodal_algorithmic: FloatArray  # (nodes, 2, dim)
    body_coordinates: FloatArray  # r, (bodies, 3): x, z in m, pitch in rad
    body_velocities: FloatArray  # (bodies, 3) m/s, rad/s
    body_accelerations: FloatArray  # (bodies, 3) m/s², rad/s²
    body_algorithmic: FloatArray  # (bodies, 3)
    sliding_coordinate: FloatArray  # n, (carriages,) m, arc length on the whole cable
    sliding_velocity: FloatArray  # (carriages,) m/s
    sliding_acceleration: FloatArray  # (carriages,) m/s²
    sliding_element: NDArray[np.int64]  # (carriages,) element on which the joint is
    friction_deflection: FloatArray  # (carriages,) -, share -1..1 of the rolling friction that is mobilised
    friction_origin: FloatArray  # (carriages,) m, arc length at which that was so: the start of the step
    multipliers: FloatArray  # lambda, (bodies, 2) N on each body at its upper pivot; first of a chain: sliding joint
    drive_force: FloatArray  # (carriages,) N along the cable, given or (SPEED) the multiplier of the driven joint
    drive_mode: NDArray[np.int64]  # (carriages,) FREE, FORCE, SPEED, or HAULED
    sheave_mode: NDArray[np.int64]  # (carriages,) FREE, FORCE or SPEED of the drive sheave where HAULED
    drive_target: FloatArray  # (carriages,) N in FORCE, m/s in SPEED
    drive_braking: NDArray[np.bool_]  # (carriages,) an emergency stop is in force
    braking_time: FloatArray  # (carriages,) s, since then
    reference: FloatArray  # (carriages, 3) m, m/s, m/s²: what a driven joint follows
    support_arc_length: FloatArray  # (contacts,) m, place of the rope nearest to each contact of the towers
    support_deflection: FloatArray  # (contacts,) -, share -1..1 of its friction that is mobilised
    support_origin: FloatArray  # (contacts,) m, arc length less `rope` at which that was so: the start of the step
    tower_load: FloatArray  # (towers, 2) N, sum of normal forces at the end of the last step, and the least of them
    newton_curvature: FloatArray  # (1,) 1/m, Newton increment over the square of the one before; 0: not known
    attached: NDArray[np.bool_]  # (carriages,) on the cable; only what is clamped to a moving one ever is not
    rope: FloatArray  # (3,) cable that has gone by (m), its speed (m/s) and acceleration (m/s²), towards the end
    rope_target: FloatArray  # (1,) m/s
    rope_braking: NDArray[np.bool_]  # (1,) the emergency deceleration is in force
    sheave: FloatArray  # (carriages, 4) rope travel m, its rate m/s, m/s², and its algorithmic acceleration
    hauled_acceleration: FloatArray  # (carriages,) m/s², true one of a joint at a haul rope; 0 elsewhere
    payload: FloatArray  # (carriages,) kg, already in the masses of the system
    wind: FloatArray  # (dim,) m/s
    clock: NDArray[np.int64]  # (1,) whole solver steps since the start


@by_reference
class Workspace(NamedTuple):
    """Residual, tangent and what elimination leaves behind; contents have no meaning between steps."""

    diagonal: FloatArray  # (nodes, 2, 2, dim²): matrices of r and r_x against r and r_x
    upper: FloatArray  # (nodes - 1, 2, 2, dim²), couples node k to k + 1
    lower: FloatArray  # (nodes - 1, 2, 2, dim²), couples node k + 1 to k
    group: FloatArray  # (4 dim + 10 dim², WIDTH), residual and tangent of a group of elements
    right_side: FloatArray  # (nodes, 2, dim), minus the residual; after the solution the increment of e
    joint_gap: FloatArray  # (bodies, 2) m (or m/s² at acceleration level): what each joint has to close
    body_residual: FloatArray  # (bodies, 3)
    body_increment: FloatArray  # (bodies, 3)
    pitch_pivot: FloatArray  # (bodies,) eliminated row of the pitch: its pivot
    pitch_row: FloatArray  # (bodies, 2) coefficients of the upper pivot's displacement
    pitch_right: FloatArray  # (bodies,)
    impedance: FloatArray  # (bodies + 1, 3) D of the chain from this body down: xx, xz, zz
    impedance_force: FloatArray  # (bodies + 1, 2) b of the same: Δλ = D Δp + b
    sliding_pivot: FloatArray  # (carriages,) eliminated row of the sliding coordinate
    sliding_row: FloatArray  # (carriages, 4, dim)
    sliding_right: FloatArray  # (carriages,)
    sliding_increment: FloatArray  # (carriages,)
    saturation: FloatArray  # (carriages,) N, what a drive at its force limit gives in this step, else 0
    haul_force: FloatArray  # (carriages,) N on the arc length, the sheave eliminated
    haul_by_s: FloatArray  # (carriages,) N/m, its derivative by the arc length
    sheave_row: FloatArray  # (carriages, 3) eliminated row of the sheave: pivot, coefficient of s, right side
    sheave_increment: FloatArray  # (carriages,)
    body_drag: FloatArray  # (bodies, 2) N
    body_drag_tangent: FloatArray  # (bodies, 3) N/m, minus its derivative by the place: xx, xz, zz


def allocate_state(system: System) -> State:
    """State of zeros with every joint at rest; `equilibrium` fills it."""
    nodes, dim = system.cable.element_count + 1, len(system.cable.gravity)
    bodies, carriages = system.carriages.mass.size, system.carriages.fixed.size
    contacts = system.supports.stiffness.size
    modes = np.where(system.haul_ropes.axial_stiffness > 0.0, HAULED, FREE)
    modes = np.where(system.carriages.fixed | system.carriages.clamped, SPEED, modes).astype(np.int64)
    return State(
        nodal_coordinates=np.zeros((nodes, 2, dim)),
        nodal_velocities=np.zeros((nodes, 2, dim)),
        nodal_accelerations=np.zeros((nodes, 2, dim)),
        nodal_algorithmic=np.zeros((nodes, 2, dim)),
        body_coordinates=np.zeros((bodies, 3)),
        body_velocities=np.zeros((bodies, 3)),
        body_accelerations=np.zeros((bodies, 3)),
        body_algorithmic=np.zeros((bodies, 3)),
        sliding_coordinate=np.zeros(carriages),
        sliding_velocity=np.zeros(carriages),
        sliding_acceleration=np.zeros(carriages),
        sliding_element=np.zeros(carriages, dtype=np.int64),
        friction_deflection=np.zeros(carriages),
        friction_origin=np.zeros(carriages),
        multipliers=np.zeros((bodies, 2)),
        drive_force=np.zeros(carriages),
        drive_mode=modes,
        sheave_mode=np.full(carriages, FREE, dtype=np.int64),
        drive_target=np.zeros(carriages),
        drive_braking=np.zeros(carriages, dtype=np.bool_),
        braking_time=np.zeros(carriages),
        reference=np.zeros((carriages, 3)),
        support_arc_length=np.zeros(contacts),
        support_deflection=np.zeros(contacts),
        support_origin=np.zeros(contacts),
        tower_load=np.zeros((system.supports.top.shape[0], 2)),
        newton_curvature=np.zeros(1),
        attached=np.ones(carriages, dtype=np.bool_),
        rope=np.zeros(3),
        rope_target=np.zeros(1),
        rope_braking=np.zeros(1, dtype=np.bool_),
        sheave=np.zeros((carriages, 4)),
        hauled_acceleration=np.zeros(carriages),
        payload=np.zeros(carriages),
        wind=np.zeros(dim),
        clock=np.zeros(1, dtype=np.int64),
    )


def allocate_workspace(system: System) -> Workspace:
    """Scratch space of the size of `system`."""
    nodes, dim = system.cable.element_count + 1, len(system.cable.gravity)
    bodies, carriages = system.carriages.mass.size, system.carriages.fixed.size
    return Workspace(
        diagonal=np.zeros((nodes, 2, 2, dim * dim)),
        upper=np.zeros((nodes - 1, 2, 2, dim * dim)),
        lower=np.zeros((nodes - 1, 2, 2, dim * dim)),
        group=np.zeros((4 * dim + 10 * dim * dim, WIDTH)),
        right_side=np.zeros((nodes, 2, dim)),
        joint_gap=np.zeros((bodies, 2)),
        body_residual=np.zeros((bodies, 3)),
        body_increment=np.zeros((bodies, 3)),
        pitch_pivot=np.zeros(bodies),
        pitch_row=np.zeros((bodies, 2)),
        pitch_right=np.zeros(bodies),
        impedance=np.zeros((bodies + 1, 3)),
        impedance_force=np.zeros((bodies + 1, 2)),
        sliding_pivot=np.zeros(carriages),
        sliding_row=np.zeros((carriages, 4, dim)),
        sliding_right=np.zeros(carriages),
        sliding_increment=np.zeros(carriages),
        saturation=np.zeros(carriages),
        haul_force=np.zeros(carriages),
        haul_by_s=np.zeros(carriages),
        sheave_row=np.zeros((carriages, 3)),
        sheave_increment=np.zeros(carriages),
        body_drag=np.zeros((bodies, 2)),
        body_drag_tangent=np.zeros((bodies, 3)),
    )


def clone_state(state: State) -> State:
    """Independent copy."""
    return State._make(array.copy() for array in state)


@kernel
def copy_state(source, target):
    """Write every array of `source` into `target`."""
    copy_array(source.nodal_coordinates, target.nodal_coordinates)
    copy_array(source.nodal_velocities, target.nodal_velocities)
    copy_array(source.nodal_accelerations, target.nodal_accelerations)
    copy_array(source.nodal_algorithmic, target.nodal_algorithmic)
    copy_array(source.body_coordinates, target.body_coordinates)
    copy_array(source.body_velocities, target.body_velocities)
    copy_array(source.body_accelerations, target.body_accelerations)
    copy_array(source.body_algorithmic, target.body_algorithmic)
    copy_array(source.sliding_coordinate, target.sliding_coordinate)
    copy_array(source.sliding_velocity, target.sliding_velocity)
    copy_array(source.sliding_acceleration, target.sliding_acceleration)
    copy_array(source.sliding_element, target.sliding_element)
    copy_array(source.friction_deflection, target.friction_deflection)
    copy_array(source.friction_origin, target.friction_origin)
    copy_array(source.multipliers, target.multipliers)
    copy_array(source.drive_force, target.drive_force)
    copy_array(source.drive_mode, target.drive_mode)
    copy_array(source.drive_target, target.drive_target)
    copy_array(source.drive_braking, target.drive_braking)
    copy_array(source.reference, target.reference)
    copy_array(source.support_arc_length, target.support_arc_length)
    copy_array(source.support_deflection, target.support_deflection)
    copy_array(source.support_origin, target.support_origin)
    copy_array(source.tower_load, target.tower_load)
    copy_array(source.newton_curvature, target.newton_curvature)
    copy_array(source.attached, target.attached)
    copy_array(source.rope, target.rope)
    copy_array(source.rope_target, target.rope_target)
    copy_array(source.rope_braking, target.rope_braking)
    copy_array(source.sheave_mode, target.sheave_mode)
    copy_array(source.braking_time, target.braking_time)
    copy_array(source.sheave, target.sheave)
    copy_array(source.hauled_acceleration, target.hauled_acceleration)
    copy_array(source.payload, target.payload)
    copy_array(source.wind, target.wind)
    copy_array(source.clock, target.clock)
