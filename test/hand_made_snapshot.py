"""Snapshots made from records, without a simulation."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from cable_twin.frame.records import (
    BodyState,
    CableSamples,
    CarriageState,
    DriveState,
    FloatArray,
    SolverReport,
    SupportState,
)
from cable_twin.frame.snapshot import Layout, Snapshot

REPORT = SolverReport(steps=1, iterations=2, halvings=0, constraint_residual=1e-12)


def snapshot_of(
    time: float,
    carriages: Mapping[str, CarriageState],
    supports: Mapping[str, SupportState],
    cable: CableSamples,
    drives: Mapping[str, DriveState] | None = None,
    solver: SolverReport = REPORT,
    carriers: int = 0,
) -> Snapshot:
    """Snapshot with the numbers of given records.

    Args:
        time: s.
        carriages: by name; vectors (3,) in space, or (2,) x and z.
        supports: by name, start and end before the towers.
        cable: its positions (n, 3) or (n, 2).
        drives: of a moving cable, by name.
        solver: what the solver did.
        carriers: how many of the carriages are some, the last ones.
    """
    drives = drives or {}
    vehicles = {name: tuple(state.bodies) for name, state in carriages.items()}
    layout = Layout(vehicles, tuple(supports), tuple(drives), cable.arc_lengths, carriers=carriers)
    numbers = np.full(layout.size, np.nan)
    columns = layout.columns(numbers)
    columns.time[0] = time
    for row, state in enumerate(carriages.values()):
        columns.arc_length[row], columns.speed[row] = state.arc_length, state.speed
        columns.drive_force[row], columns.payload[row] = state.drive_force, state.payload
        columns.joint_position[row] = in_space(state.position)
        columns.contact_force[row] = in_space(state.contact_force)
        columns.attached[row] = state.attached
        if (rope := state.haul_rope) is not None:
            columns.haul_travel[row], columns.haul_speed[row] = rope.travel, rope.speed
            columns.haul_force[row] = rope.force
    for row, body in enumerate(body for state in carriages.values() for body in state.bodies.values()):
        columns.body_position[row], columns.body_orientation[row] = body.position, body.orientation
        columns.body_velocity[row], columns.body_angular_velocity[row] = body.velocity, body.angular_velocity
        columns.body_angles[row] = body.angles
    for row, support in enumerate(supports.values()):
        columns.support_force[row] = in_space(support.force)
        if support.travel is not None:
            columns.support_travel[row] = support.travel
        if (tower := support.tower) is not None:
            columns.tower_load[row], columns.tower_lowest_load[row] = tower.normal_load, tower.lowest_load
            columns.tower_rest_load[row] = tower.rest_load
    for row, drive in enumerate(drives.values()):
        columns.drive_position[row], columns.drive_speed[row] = drive.position, drive.speed
        columns.moving_cable_force[row] = drive.force
    for whose, speed in (("", columns.speed[: columns.command_kind.size]), ("drive_", columns.drive_speed)):
        for name, value in (("command_kind", 2.0), ("commanded_speed", speed + 1.0), ("commanded_force", 0.0)):
            getattr(columns, f"{whose}{name}")[:] = value  # it is told to go faster than it does
        getattr(columns, f"{whose}reference_speed")[:] = speed
    columns.reference_position[:] = columns.arc_length[: columns.command_kind.size]
    columns.drive_reference_position[:] = columns.drive_position
    columns.rope_position[:] = in_space(cable.positions)
    columns.rope_tension[:] = cable.tensions
    for column, number in (
        (columns.lowest_tension, cable.tensions.argmin()),
        (columns.highest_tension, cable.tensions.argmax()),
    ):
        column[0] = cable.tensions[number], cable.arc_lengths[number]
    return Snapshot(layout, numbers, solver)


def body_in_plane(
    x: float, z: float, pitch: float, speed_x: float = 0.0, speed_z: float = 0.0, spin: float = 0.0
) -> BodyState:
    """State of a body in a planar system: place (m), pitch (rad), and their rates."""
    return BodyState(
        position=np.array([x, 0.0, z]),
        orientation=np.array([0.0, np.sin(0.5 * pitch), 0.0, np.cos(0.5 * pitch)]),
        velocity=np.array([speed_x, 0.0, speed_z]),
        angular_velocity=np.array([0.0, spin, 0.0]),
        angles=np.array([0.0, pitch, 0.0]),
    )


def in_space(vectors: FloatArray) -> FloatArray:
    """(..., 3) of vectors (..., 3), or of (..., 2) x and z with y = 0."""
    vectors = np.asarray(vectors, dtype=np.float64)
    return vectors if vectors.shape[-1] == 3 else np.insert(vectors, 1, 0.0, axis=-1)
