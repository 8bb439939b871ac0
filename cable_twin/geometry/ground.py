"""Terrain of a scenario: heights and clearances above the ground, and a ground line for drawings without terrain."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import chain

import numpy as np

from cable_twin.frame.records import Clearance, FloatArray, Place
from cable_twin.geometry.bodies import body_box, body_outlines
from cable_twin.mechanics.parameters import IntArray
from cable_twin.mechanics.readout.clearances import Surroundings
from cable_twin.scenario import Scenario, masts

MAST, BELOW = 15.0, 0.25  # m, longest drawn mast without terrain, and share of the ropes' height range below them


def surroundings_of(scenario: Scenario) -> Surroundings:
    """Terrain, masts and vehicle outlines of a scenario, as the record that the clearance kernel `look_around` takes.

    Masts are listed rope by rope; without terrain its profiles are empty.
    """
    sides, in_space = scenario.terrain_sides, scenario.dim == 3
    middle, left, right = (
        np.array(points, dtype=np.float64).reshape(-1, 2)
        for points in (scenario.terrain, *(((), ()) if sides is None else (sides.left, sides.right)))
    )
    outlines = [list(bodies.values()) for bodies in body_outlines(scenario).values()]
    lines = list(chain.from_iterable(outlines))
    boxes = [body_box(body) for vehicle in scenario.vehicles.values() for body in vehicle.bodies.values()]
    all_masts = [mast for rope in scenario.cables for mast in masts(scenario.of_rope(rope)).values()]
    return Surroundings(
        middle=middle,
        left=left,
        right=right,
        distance=0.0 if sides is None else sides.distance,
        masts=np.array(all_masts, dtype=np.float64).reshape(-1, 4),
        first_body=first_rows(map(len, outlines)),
        first_corner=first_rows(map(len, lines)),
        corners=np.concatenate([np.empty((0, 2)), *lines]),
        half_width=np.array([0.5 * box[1] if in_space and box is not None else 0.0 for box in boxes], np.float64),
        line=np.zeros((max(map(len, lines), default=0), 3)),
        lowest=np.full((1 + len(outlines), 3), np.nan),
        nearest=np.full((len(outlines), 2), np.nan),
    )


def first_rows(counts: Iterable[int]) -> IntArray:
    """Row of the first item of each group, for groups of given sizes one after the other, with the total appended."""
    return np.cumsum([0, *counts], dtype=np.int64)


def clearance_seen(around: Surroundings, rope: str, names: Iterable[str], attached: FloatArray) -> Clearance:
    """Clearance over ground of a rope and its vehicles, as last computed by the kernel `look_around`.

    `names` and `attached` (vehicles,) are those of the vehicles on the rope; vehicles off the rope are left out.
    """
    lowest, *vehicles = (Place(*row) for row in around.lowest.tolist())
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


def tower_foot(scenario: Scenario, x: float, top: float, ropes: FloatArray) -> float:
    """Height (m) of the foot of a tower for drawings: on the terrain, else below its top and a little below all ropes.

    Args:
        scenario: Scenario of the tower.
        x: Place of the tower along the track, in m.
        top: Height of its top, in m.
        ropes: Heights (n,) of all ropes, in m; NaN is left out.
    """
    if scenario.terrain:
        ground = np.array(scenario.terrain, dtype=np.float64)
        return float(np.interp(x, ground[:, 0], ground[:, -1]))
    lowest, highest = float(np.nanmin(ropes)), float(np.nanmax(ropes))
    return min(top, max(top - MAST, lowest - BELOW * (highest - lowest)))


def default_ground(cable: FloatArray, carriages: Sequence[FloatArray]) -> FloatArray:
    """Ground line for drawings without terrain: parallel to the cable's chord, below the lowest path of all vehicles.

    A load that travels along a taut rope follows a parabola: the sag of rope and bodies is scaled to midspan.

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
