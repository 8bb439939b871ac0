"""Ground of a scenario: height of rope and vehicles above it, and a line drawn where there is no terrain."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import chain

import numpy as np

from cable_twin.frame.records import Clearance, FloatArray, Place
from cable_twin.geometry.bodies import body_box, body_outlines
from cable_twin.mechanics.parameters import IntArray
from cable_twin.mechanics.readout.clearances import Ground, Surroundings
from cable_twin.scenario import Scenario, masts


def ground_of(scenario: Scenario) -> Ground:
    """Ground profile and body outlines of a scenario for `look_at_ground`; no profile points without terrain."""
    outlines = [list(bodies.values()) for bodies in body_outlines(scenario).values()]
    lines = list(chain.from_iterable(outlines))
    return Ground(
        terrain=np.array(scenario.terrain, dtype=np.float64).reshape(-1, 2),
        first_body=_firsts(map(len, outlines)),
        first_corner=_firsts(map(len, lines)),
        corners=np.concatenate([np.empty((0, 2)), *lines]),
        line=np.zeros((max(map(len, lines), default=0), 3)),
        lowest=np.full((1 + len(outlines), 3), np.nan),
    )


def surroundings_of(scenario: Scenario) -> Surroundings:
    """Ground, masts and vehicles of a scenario in space for `look_around`; masts rope by rope."""
    ground, sides = ground_of(scenario), scenario.terrain_sides
    profiles = ((), ()) if sides is None else (sides.left, sides.right)
    left, right = (np.array(points, dtype=np.float64).reshape(-1, 2) for points in profiles)
    boxes = [body_box(body) for vehicle in scenario.vehicles.values() for body in vehicle.bodies.values()]
    all_masts = [mast for rope in scenario.cables for mast in masts(scenario.of_rope(rope)).values()]
    return Surroundings(
        middle=ground.terrain,
        left=left,
        right=right,
        distance=0.0 if sides is None else sides.distance,
        masts=np.array(all_masts, dtype=np.float64).reshape(-1, 4),
        first_body=ground.first_body,
        first_corner=ground.first_corner,
        corners=ground.corners,
        half_width=np.array([0.0 if box is None else 0.5 * box[1] for box in boxes], dtype=np.float64),
        line=ground.line,
        lowest=ground.lowest,
        nearest=np.full((len(scenario.vehicles), 2), np.nan),
    )


def _firsts(counts: Iterable[int]) -> IntArray:
    """Index of the first item of each group, with the total count appended."""
    return np.cumsum([0, *counts], dtype=np.int64)


def clearance_seen(ground: Ground | Surroundings, rope: str, names: Iterable[str], attached: FloatArray) -> Clearance:
    """Clearance of a rope and its vehicles as last measured by `look_at_ground` or `look_around`.

    `names` and `attached` (vehicles,) are those of the vehicles on the rope; vehicles off the rope are left out.
    """
    lowest, *vehicles = (Place(*row) for row in ground.lowest.tolist())
    found = {name: place for name, place, on in zip(names, vehicles, attached, strict=True) if on}
    return Clearance(lowest, found, {rope: lowest})


def heights_over_ground(scenario: Scenario, points: FloatArray) -> FloatArray:
    """Heights (n,) in m of points (n, 3) above the terrain of a scenario, continued level beyond its ends."""
    middle, sides = np.array(scenario.terrain, dtype=np.float64), scenario.terrain_sides
    ground = np.interp(points[:, 0], middle[:, 0], middle[:, -1])
    if sides is not None:
        left, right = (
            np.interp(points[:, 0], *np.array(profile, dtype=np.float64).T) for profile in (sides.left, sides.right)
        )
        share = np.clip(np.abs(points[:, 1]) / sides.distance, 0.0, 1.0)
        ground += share * (np.where(points[:, 1] > 0.0, left, right) - ground)
    heights: FloatArray = points[:, 2] - ground
    return heights


def default_ground(cable: FloatArray, carriages: Sequence[FloatArray]) -> FloatArray:
    """Return a ground line below the reach of every carriage along its way, parallel to the chord of the cable.

    A load that travels along a taut rope draws a parabola: its sag, and that of the bodies, is scaled to midspan.

    Args:
        cable: (n, 2) m.
        carriages: For each carriage (m, 2) m, its joint and then the points of its bodies.
    """
    chord = cable[-1] - cable[0]
    points = np.vstack([cable, *carriages])
    span = max(abs(chord[0]), np.ptp(points[:, 0]), 1e-3)
    slope = chord[1] / chord[0] if abs(chord[0]) > abs(chord[1]) else 0.0
    depths = cable[0, 1] + slope * (points[:, 0] - cable[0, 0]) - points[:, 1]
    deepest = depths.max()
    for carriage in carriages:
        part = np.clip((carriage[0, 0] - cable[0, 0]) / chord[0], 0.02, 0.98) if slope or chord[0] else 0.5
        sag = cable[0, 1] + slope * (carriage[0, 0] - cable[0, 0]) - carriage[0, 1]
        reach = carriage[0, 1] - carriage[:, 1].min()
        deepest = max(deepest, min(sag / (4.0 * part * (1.0 - part)), 0.3 * span) + reach)
    ends = np.array([points[:, 0].min() - 0.02 * span, points[:, 0].max() + 0.02 * span])
    heights = cable[0, 1] + slope * (ends - cable[0, 0]) - deepest - max(0.1 * deepest, 0.02 * span)
    return np.column_stack([ends, heights])
