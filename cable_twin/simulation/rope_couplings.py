"""Clamps of carriages, connectors between ropes, and pantographs: initial state, checks and readout."""

from __future__ import annotations

import numpy as np

from cable_twin.mechanics.parameters import FREE, FloatArray
from cable_twin.mechanics.readout.columns import Columns
from cable_twin.mechanics.readout.samples import places_on, sample_positions
from cable_twin.mechanics.solution.bundle.records import BundleState, Clamps, Pantographs
from cable_twin.mechanics.solution.catenary import EquilibriumError
from cable_twin.scenario import Scenario
from cable_twin.scenario.builders.bundle import clamped
from cable_twin.simulation.ropeway import Ropeway

BESIDE = 1e-3  # m, on both sides of a place, for the slope there
ASIDE = 0.02  # of the shorter rope: from end to end of a connector, horizontally
FARTHEST = 0.1  # of the shorter rope: from a carriage to where it is clamped, before the ropes share its weight


def along_track(scenario: Scenario, parts: list[Ropeway]) -> list[FloatArray]:
    """Approximate places (m) along the track of the nodes of each rope, on a straight line from end to end."""
    found = []
    for part, rope in zip(parts, scenario.ropes.values(), strict=True):
        start, end = rope.start.position[0], rope.end.position[0]
        found.append(start + (end - start) * part.system.cable.node_arc_length / rope.unstrained_length)
    return found


def let_clamps_hold(scenario: Scenario, parts: list[Ropeway], clamps: Clamps) -> None:
    """Release the drives of all joints held by clamps, while each rope is in equilibrium by itself.

    Raises:
        EquilibriumError: a carriage is far from its place on the other rope; the message names it.
    """
    ropes = list(scenario.ropes)
    for clamp, (row, carriage, name, one) in enumerate(clamped(scenario)):
        here, lengths = parts[row], {rope: cable.unstrained_length for rope, cable in scenario.ropes.items()}
        on = [(rope, place) for rope, place in one.clamped_to.items() if 0.0 < place < lengths[rope]]
        if not on or not (here.state.attached[carriage] and here.state.vehicle_rope[carriage] == row):
            continue
        (rope, place), *_ = on
        other = parts[ropes.index(rope)]
        joint = float(here.state.joints.position[carriage])
        apart = float(np.linalg.norm(_position(other, place) - _position(here, joint) - clamps.offset[clamp]))
        shorter = min(part.system.cable.unstrained_length for part in (here, other))
        if apart > FARTHEST * shorter:
            raise EquilibriumError(
                f"carriages.{name}.clamped_to: given {place:g} m on {rope!r}, which at rest is {apart:.4g} m away "
                f"from the carriage before it is clamped; allowed: up to {FARTHEST * shorter:.4g} m"
            )
        here.state.drives.mode[carriage], here.state.drives.force[carriage] = FREE, 0.0


def check_connectors(scenario: Scenario, parts: list[Ropeway]) -> None:
    """Check the distance that each connector has to span, while each rope is in equilibrium by itself.

    Raises:
        EquilibriumError: the ends of a connector are much farther apart than it is long; the message names it.
    """
    of = dict(zip(scenario.ropes, parts, strict=True))
    for name, rod in scenario.connectors.items():
        (upper, above), (lower, below) = rod.ends
        way = _position(of[upper], above) - _position(of[lower], below)
        shorter = min(of[rope].system.cable.unstrained_length for rope in (upper, lower))
        # ropes that do not share their weight yet sag otherwise, but stay where they are along and across the track
        for what, apart, share in (("aside", way[:-1], ASIDE), ("away", way, FARTHEST)):
            if (distance := float(np.linalg.norm(apart))) > (allowed := rod.length + share * shorter):
                raise EquilibriumError(
                    f"connectors.{name}.to: given {below:g} m on {lower!r}, at rest {distance:.4g} m {what} from "
                    f"{above:g} m on {upper!r} without this connector of {rod.length:g} m; allowed: a place up to "
                    f"{allowed:.4g} m {what}"
                )


def note_clamps(parts: list[Ropeway], clamps: Clamps) -> None:
    """Set the reference places of friction and drives of clamped carriages to their places in equilibrium."""
    for row, carriage in zip(clamps.rope.tolist(), clamps.carriage.tolist(), strict=True):
        state = parts[row].state
        state.friction_origin[carriage] = state.reference.position[carriage] = state.joints.position[carriage]


def observe_clamps(parts: list[Ropeway], clamps: Clamps, moving: BundleState, columns: Columns) -> None:
    """Fill a snapshot's columns of clamp pulls: zero for opened clamps, without the share carried by station rails."""
    pairs = [*zip(clamps.rope.tolist(), clamps.carriage.tolist(), moving.clamp_rope.tolist(), strict=True)]
    held = {row for track, row, other in pairs if other >= 0 and parts[track].state.clamp_holds[row]}
    for clamp, (track, row, other) in enumerate(pairs):
        if row not in held:
            columns.haul_pull[row], columns.haul_force[row] = 0.0, 0.0
        elif other >= 0 and moving.rail_mass[clamp] != 0.0:
            _leave_out_rails(parts[track], float(moving.rail_mass[clamp]), row, columns)


def observe_pantographs(parts: list[Ropeway], pantographs: Pantographs, moving: BundleState, columns: Columns) -> None:
    """Fill a snapshot's columns of pantographs: force NaN past an end of the rope, speed and place of the head."""
    for row, rope in enumerate(pantographs.rope.tolist()):
        start, end = parts[rope].state.nodes.position[[0, -1], 0, 0].tolist()
        under = min(start, end) < moving.place.position[row] < max(start, end)
        columns.pantograph_force[row] = moving.contact_force[row] if under else np.nan
    columns.pantograph_speed[:] = moving.place.velocity
    columns.pantograph_position[:, 0] = moving.place.position
    columns.pantograph_position[:, 2] = moving.stages.position[:, 0]


def _leave_out_rails(track: Ropeway, mass: float, row: int, columns: Columns) -> None:
    """Subtract the weight of the carriage `mass` (kg) carried by station rails from pull and power of its clamp."""
    place, carried = float(columns.arc_length[row]), mass * track.scenario.gravity
    before, after = _position(track, place - BESIDE), _position(track, place + BESIDE)
    stretched = float(np.linalg.norm(after - before))
    along = carried * float((after - before)[-1]) / stretched
    columns.haul_pull[row, 2] -= carried
    columns.haul_force[row] -= along
    columns.drive_force[row] -= along
    columns.drive_power[row] -= along * columns.speed[row] * stretched / (2.0 * BESIDE)


def _position(part: Ropeway, place: float) -> FloatArray:
    """Position (dim,) in m of a rope at an arc length (m)."""
    found = np.empty((1, 3))
    sample_positions(part.system.cable, part.state, places_on(part.system.cable, part.state, np.array([place])), found)
    return found[0] if part.scenario.dim == 3 else found[0, ::2]


__all__ = [
    "along_track",
    "check_connectors",
    "let_clamps_hold",
    "note_clamps",
    "observe_clamps",
    "observe_pantographs",
]
