"""Columns (arrays) of an output frame, read from an unchanged state: shape, tension, reactions, energy."""

from __future__ import annotations

from math import inf, isnan, nan
from typing import Annotated, NamedTuple

from cable_twin.mechanics.drives.haul_rope import haul_tension
from cable_twin.mechanics.drives.joint_drive import joint_forces, observe_haul, way_per_metre
from cable_twin.mechanics.drives.moving_rope import moving_rope_force
from cable_twin.mechanics.language.by_reference import by_reference
from cable_twin.mechanics.language.compilation import inlined_kernel, kernel
from cable_twin.mechanics.language.declared import Of
from cable_twin.mechanics.language.rotations import cross, orientation_in_space, turn_in_space
from cable_twin.mechanics.language.vectors import load, scale, store, subtract
from cable_twin.mechanics.on_rope.brakes import force_limit
from cable_twin.mechanics.on_rope.buffer import FORCE_NOW, HIGHEST
from cable_twin.mechanics.on_rope.chain import arm_to, axes_of, centre, spin_of
from cable_twin.mechanics.on_rope.counterweight import counterweight_motion
from cable_twin.mechanics.on_rope.presence import belongs
from cable_twin.mechanics.parameters import DRUM, FORCE, NO_RATIO, SPEED, FloatArray
from cable_twin.mechanics.readout.samples import joint_place, sample_positions, store_beside, store_in_space
from cable_twin.mechanics.readout.sections import (
    recover_sections,
    sample_tensions,
    tension_over_load,
    tension_range,
    tower_force,
)

STOPPING = 3  # beside the modes FREE, FORCE and SPEED, in `command_kind`: an emergency stop


@by_reference
class Columns(NamedTuple):
    """Quantities of an output frame, one row per object in the order of the scenario; NaN where not defined.

    Everything is in space: a planar system has y = 0 and turns about y only.
    """

    time: Annotated[FloatArray, Of(1, unit="s")]  # simulated; not filled by `observe`
    arc_length: Annotated[FloatArray, Of("vehicles", unit="m")]  # of the joint, unstrained
    speed: Annotated[FloatArray, Of("vehicles", unit="m/s")]  # rate of arc_length
    drive_force: Annotated[FloatArray, Of("vehicles", unit="N")]  # along the cable, on the vehicle or on its haul drum
    drive_power: Annotated[FloatArray, Of("vehicles", unit="W")]  # of this force, on its way along the stretched rope
    joint_position: Annotated[FloatArray, Of("vehicles", 3, unit="m")]
    contact_force: Annotated[FloatArray, Of("vehicles", 3, unit="N")]  # of the cable on the vehicle
    tension_over_load: Annotated[
        FloatArray, Of("vehicles")
    ]  # lower tension of the rope beside the vehicle over the force across the rope; NaN off the rope
    attached: Annotated[FloatArray, Of("vehicles")]  # 1 on the cable, 0 at rest in a station
    payload: Annotated[FloatArray, Of("vehicles", unit="kg")]
    haul_travel: Annotated[
        FloatArray, Of("vehicles", unit="m")
    ]  # place of the vehicle without stretch of its haul rope
    haul_speed: Annotated[FloatArray, Of("vehicles", unit="m/s")]  # of the haul rope at its drum
    haul_force: Annotated[FloatArray, Of("vehicles", unit="N")]  # of haul rope or clamp on the vehicle, along the cable
    haul_tension: Annotated[FloatArray, Of("vehicles", unit="N")]  # highest of the haul rope of a drive
    haul_pull: Annotated[FloatArray, Of("vehicles", 3, unit="N")]  # the same force as a vector
    push: Annotated[FloatArray, Of("vehicles", unit="N")]  # between the vehicle and those after it on the rope
    push_highest: Annotated[FloatArray, Of("vehicles", unit="N")]  # highest of all steps since start or reset
    touched: Annotated[FloatArray, Of("vehicles")]  # 1 + row of the last vehicle touched after it on the rope, or 0
    touch_place: Annotated[FloatArray, Of("vehicles", unit="m")]  # arc length of that touch
    touch_speed: Annotated[FloatArray, Of("vehicles", unit="m/s")]  # at which the two vehicles met
    touch_time: Annotated[FloatArray, Of("vehicles", unit="s")]  # of that touch
    body_position: Annotated[FloatArray, Of("bodies", 3, unit="m")]  # of the centre of mass without payload
    body_orientation: Annotated[FloatArray, Of("bodies", 4)]  # unit quaternion x, y, z, w
    body_velocity: Annotated[FloatArray, Of("bodies", 3, unit="m/s")]
    body_angular_velocity: Annotated[FloatArray, Of("bodies", 3, unit="rad/s")]
    body_angles: Annotated[FloatArray, Of("bodies", 3, unit="rad")]  # roll, pitch, yaw; pitch goes on beyond a turn
    support_force: Annotated[FloatArray, Of("supports", 3, unit="N")]  # of start, end and towers on the cable
    support_travel: Annotated[FloatArray, Of("supports", unit="m")]  # of a counterweight in the direction of its pull
    tower_load: Annotated[FloatArray, Of("supports", unit="N")]  # sum of normal forces of a tower
    tower_lowest_load: Annotated[FloatArray, Of("supports", unit="N")]  # lowest of all steps since start or reset
    tower_rest_load: Annotated[FloatArray, Of("supports", unit="N")]  # at the start
    tower_lateral: Annotated[
        FloatArray, Of("supports", unit="N")
    ]  # of a tower in space on the cable, to the left of the track
    tower_lateral_ratio: Annotated[
        FloatArray, Of("supports")
    ]  # highest of its size over the normal force since start or reset
    tower_derailed: Annotated[FloatArray, Of("supports")]  # 0 in the grooves, else OUT_LEFT, OUT_RIGHT or LIFTED
    tower_derailed_time: Annotated[FloatArray, Of("supports", unit="s")]  # of the derailment; 0 without one
    command_kind: Annotated[FloatArray, Of("carriages")]  # FREE, FORCE, SPEED or STOPPING; NaN without commands
    commanded_speed: Annotated[FloatArray, Of("carriages", unit="m/s")]  # 0 of other commands
    commanded_force: Annotated[FloatArray, Of("carriages", unit="N")]  # 0 of other commands
    reference_position: Annotated[
        FloatArray, Of("carriages", unit="m")
    ]  # of the drive; the joint's own without a reference
    reference_speed: Annotated[
        FloatArray, Of("carriages", unit="m/s")
    ]  # of the drive; the joint's own without a reference
    force_limit: Annotated[
        FloatArray, Of("carriages", unit="N")
    ]  # of drive or brakes at the present speed; NaN without a limit
    drive_command_kind: Annotated[FloatArray, Of("drives")]  # as `command_kind`
    drive_commanded_speed: Annotated[FloatArray, Of("drives", unit="m/s")]
    drive_commanded_force: Annotated[FloatArray, Of("drives", unit="N")]
    drive_reference_position: Annotated[FloatArray, Of("drives", unit="m")]
    drive_reference_speed: Annotated[FloatArray, Of("drives", unit="m/s")]
    drive_position: Annotated[FloatArray, Of("drives", unit="m")]  # rope travel: unstrained rope that has passed
    drive_speed: Annotated[FloatArray, Of("drives", unit="m/s")]
    moving_cable_force: Annotated[FloatArray, Of("drives", unit="N")]  # of the drive on the cable
    rope_position: Annotated[FloatArray, Of("samples", 3, unit="m")]
    rope_tension: Annotated[FloatArray, Of("samples", unit="N")]  # before a load at that place
    lowest_tension: Annotated[FloatArray, Of("ropes", 2, unit="N, m")]  # along the rope, and its arc length
    highest_tension: Annotated[FloatArray, Of("ropes", 2, unit="N, m")]  # along the rope, and its arc length
    temperature: Annotated[FloatArray, Of(1, unit="degC")]  # of ropes, by the last command or the scenario
    wind: Annotated[FloatArray, Of(3, unit="m/s")]  # likewise
    vehicle_rope: Annotated[
        FloatArray, Of("vehicles")
    ]  # number of its rope; the columns below are not filled by `observe`
    sheave_position: Annotated[FloatArray, Of("sheaves", unit="m")]  # unstrained rope over a bullwheel
    sheave_speed: Annotated[FloatArray, Of("sheaves", unit="m/s")]
    sheave_force: Annotated[FloatArray, Of("sheaves", unit="N")]  # of its drive at its rim
    sheave_tension: Annotated[FloatArray, Of("sheaves", 2, unit="N")]  # of the incoming and the outgoing strand
    sheave_travel: Annotated[FloatArray, Of("sheaves", unit="m")]  # of the tensioning device; NaN without one
    sheave_slip: Annotated[FloatArray, Of("sheaves", unit="m")]  # of the rim ahead of the rope
    sheave_rolled_back: Annotated[FloatArray, Of("sheaves")]  # 1 where a rollback has stopped the lift, else 0
    connector_force: Annotated[FloatArray, Of("connectors", unit="N")]  # pull of a connector between ropes
    pantograph_force: Annotated[FloatArray, Of("pantographs", unit="N")]  # upwards on the rope; NaN past an end of it
    pantograph_position: Annotated[FloatArray, Of("pantographs", 3, unit="m")]  # of the head
    pantograph_speed: Annotated[FloatArray, Of("pantographs", unit="m/s")]  # along the track


@kernel
def observe(system, state, sections, places, rest_loads, lateral, columns):
    """Fill the columns of an output frame from the state of one rope with its vehicles.

    Args:
        system: parameters.
        state: state of the rope.
        sections: scratch, with the forces that other ropes exert.
        places: sample places on the rope.
        rest_loads: (towers, ...) N, loads of the towers at the start of the run in the first column.
        lateral: m, y of a planar rope and its vehicles.
        columns: result; of samples, supports and ropes only the rows of this rope.
    """
    sample_positions(system.cable, state, places, columns.rope_position)
    if lateral != 0.0:
        columns.rope_position[:, 1] = lateral
    recover_sections(system, state, sections)
    sample_tensions(system, state, sections, places, columns.rope_tension)
    tension_range(system, state, sections, columns.lowest_tension[0], columns.highest_tension[0])
    for vehicle in range(state.vehicle_rope.size):
        if belongs(system, state, vehicle):
            observe_vehicle(system, state, vehicle, lateral, columns)
            ratio = tension_over_load(system, state, sections, vehicle) if state.attached[vehicle] else nan
            columns.tension_over_load[vehicle] = ratio
            if vehicle < columns.command_kind.size:
                observe_command(system, state, vehicle, columns)
            for body in range(system.carriages.body_offset[vehicle], system.carriages.body_offset[vehicle + 1]):
                observe_body(system, state, body, lateral, columns)
    observe_supports(system, state, sections, rest_loads, columns)
    if system.moving_cable.moving:
        for drive in range(columns.drive_position.size):
            columns.drive_position[drive], columns.drive_speed[drive] = state.rope.position[0], state.rope.velocity[0]
            columns.moving_cable_force[drive] = moving_rope_force(system, state)
            columns.drive_command_kind[drive] = STOPPING if state.rope_drive.braking[0] else SPEED
            columns.drive_commanded_speed[drive], columns.drive_commanded_force[drive] = state.rope_drive.target[0], 0.0
            columns.drive_reference_position[drive] = state.rope.position[0]
            columns.drive_reference_speed[drive] = state.rope.velocity[0]
    wind = load(state.wind, system.cable.gravity)
    store_in_space(wind, columns.wind)
    columns.temperature[0] = state.temperature[0]


@kernel
def observe_vehicle(system, state, vehicle, lateral, columns):
    """Fill the columns of one vehicle of a rope in an output frame."""
    columns.vehicle_rope[vehicle] = state.vehicle_rope[vehicle]
    columns.arc_length[vehicle], columns.speed[vehicle] = state.joints.position[vehicle], state.joints.velocity[vehicle]
    columns.attached[vehicle] = 1.0 if state.attached[vehicle] else 0.0
    columns.payload[vehicle], columns.drive_force[vehicle] = state.payload[vehicle], state.drives.force[vehicle]
    store_beside(joint_place(system, state, vehicle), lateral, columns.joint_position[vehicle])
    contact, pull = joint_forces(system, state, vehicle)
    store_in_space(contact, columns.contact_force[vehicle])
    store_in_space(pull, columns.haul_pull[vehicle])
    travel, speed, force = observe_haul(system, state, vehicle)
    columns.haul_travel[vehicle], columns.haul_speed[vehicle], columns.haul_force[vehicle] = travel, speed, force
    columns.haul_tension[vehicle] = haul_tension(system, state, vehicle) if state.axis[vehicle] == DRUM else nan
    if isnan(force):
        columns.haul_pull[vehicle] = nan
    elif isnan(travel):  # of a clamp, with the force of the vehicle's own drive
        columns.drive_force[vehicle] += force
    pace = state.drums.velocity[vehicle] if state.axis[vehicle] == DRUM else state.joints.velocity[vehicle]
    columns.drive_power[vehicle] = columns.drive_force[vehicle] * pace * way_per_metre(system, state, vehicle)
    push, touch = state.push[vehicle], state.touch[vehicle]
    columns.push[vehicle], columns.push_highest[vehicle] = push[FORCE_NOW], push[HIGHEST]
    columns.touched[vehicle], columns.touch_place[vehicle], columns.touch_speed[vehicle] = touch[0], touch[1], touch[2]
    columns.touch_time[vehicle] = round(touch[3] * system.solver.step * 1e9) / 1e9


@kernel
def observe_command(system, state, carriage, columns):
    """Fill the columns of a vehicle's drive: command, present motion and force limit."""
    kind, limit, told_speed, told_force, place, speed = nan, nan, nan, nan, nan, nan
    if not system.carriages.fixed[carriage] and not system.carriages.clamped[carriage]:
        place, speed, mode = (
            state.joints.position[carriage],
            state.joints.velocity[carriage],
            state.drives.mode[carriage],
        )
        if state.axis[carriage] == DRUM:
            place, speed = state.drums.position[carriage], state.drums.velocity[carriage]
        kind = STOPPING if state.drives.braking[carriage] else mode
        told_speed = state.drives.target[carriage] if mode == SPEED else 0.0
        told_force = state.drives.force[carriage] if mode == FORCE else 0.0
        if mode == SPEED:
            place, speed = state.reference.position[carriage], state.reference.velocity[carriage]
        limit = force_limit(system.carriages, state, carriage, speed * way_per_metre(system, state, carriage))
    columns.command_kind[carriage] = kind
    columns.commanded_speed[carriage], columns.commanded_force[carriage] = told_speed, told_force
    columns.reference_position[carriage], columns.reference_speed[carriage] = place, speed
    columns.force_limit[carriage] = limit if limit < inf else nan


@kernel
def observe_body(system, state, body, lateral, columns):
    """Fill the columns of one body of a vehicle, with the position of its centre of mass without payload."""
    own, like = state.bodies.position[body], system.cable.gravity
    spin = spin_of(state.bodies.velocity, body, like)
    arm = arm_to(axes_of(state, body, like), system.carriages.centre_offset[body], like)
    store_beside(subtract(centre(state, body, like), arm), lateral, columns.body_position[body])
    velocity = subtract(load(state.bodies.velocity[body], like), cross(spin, arm))
    store_in_space(velocity, columns.body_velocity[body])
    quaternion, angles = orientation_in_space(own, like)
    store(quaternion, columns.body_orientation[body])
    store(turn_in_space(spin), columns.body_angular_velocity[body])
    store(angles, columns.body_angles[body])


@kernel
def observe_supports(system, state, sections, rest_loads, columns):
    """Fill the columns of the supports of a rope: both ends and all towers."""
    for end in range(2):
        pull = load(sections.node_force[0 if end == 0 else system.cable.element_count], system.cable.gravity)
        store_in_space(scale(-1.0 if end == 0 else 1.0, pull), columns.support_force[end])
        travel = nan
        if system.counterweights.mass[end] > 0.0:
            travel, _, _ = counterweight_motion(system.counterweights, system.cable, state, end)
        columns.support_travel[end] = travel
        columns.tower_load[end], columns.tower_lowest_load[end], columns.tower_rest_load[end] = nan, nan, nan
        observe_groove(system, state, -1, columns, end)
    for tower in range(system.towers.top.shape[0]):
        row = 2 + tower
        force = tower_force(system, sections, tower)
        store_in_space(force, columns.support_force[row])
        columns.support_travel[row] = nan
        columns.tower_load[row], columns.tower_lowest_load[row] = state.tower_load[tower, 0], state.tower_load[tower, 1]
        columns.tower_rest_load[row] = rest_loads[tower, 0]
        observe_groove(system, state, tower if len(system.cable.gravity) == 3 else -1, columns, row)


@inlined_kernel
def observe_groove(system, state, tower, columns, row):
    """Fill the columns of lateral force and derailment of a tower, in one row of supports; NaN for tower -1."""
    columns.tower_lateral[row], columns.tower_lateral_ratio[row] = nan, nan
    columns.tower_derailed[row], columns.tower_derailed_time[row] = nan, nan
    if tower >= 0:
        columns.tower_lateral[row] = state.tower_lateral[tower, 0]
        if state.tower_lateral[tower, 1] != NO_RATIO:
            columns.tower_lateral_ratio[row] = state.tower_lateral[tower, 1]
        columns.tower_derailed[row] = state.derailment[tower, 0]
        columns.tower_derailed_time[row] = round(state.derailment[tower, 1] * system.solver.step * 1e9) / 1e9
