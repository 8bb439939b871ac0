"""Clearance of rope and vehicles over the ground in a plane.

The ground is straight between its points and goes on level beyond its ends. Rope and outlines are taken at their points
and, between them, above the points of the ground: all that a minimum of straight lines over straight lines can be at.
"""

from __future__ import annotations

from math import cos, inf, nan, sin
from typing import NamedTuple

from cable_twin.mechanics.language.by_reference import by_reference
from cable_twin.mechanics.language.compilation import inlined_kernel, kernel
from cable_twin.mechanics.parameters import FloatArray, IntArray


@by_reference
class Ground(NamedTuple):
    """Ground profile, outlines of vehicles, and last measured clearances."""

    terrain: FloatArray  # (points, 2) m, x rising
    first_body: IntArray  # (vehicles + 1,) number of the first body of each vehicle
    first_corner: IntArray  # (bodies + 1,) number of the first corner of each body
    corners: FloatArray  # (corners, 2) m, the outline of each body in its axes, one line
    line: FloatArray  # (corners, 3) m, scratch: the outline of one body where it is
    lowest: FloatArray  # (1 + vehicles, 3) height, x, z in m of rope and vehicles; height NaN without one


@kernel
def look_at_ground(ground, rope, attached, body_position, body_angles):
    """Fill `ground.lowest` with the least height of rope and vehicles over the ground, without vehicles in stations.

    Args:
        ground: takes the result.
        rope: (n, 3) m, points of the rope.
        attached: (vehicles,) 0 in a station.
        body_position: (bodies, 3) m.
        body_angles: (bodies, 3) roll, pitch, yaw in rad.
    """
    lowest = ground.lowest
    lowest[0, 0] = nan
    find_lowest(ground.terrain, rope, rope.shape[0], lowest[0])
    for vehicle in range(attached.size):
        lowest[1 + vehicle, 0] = nan
        if attached[vehicle] != 0.0:
            for body in range(ground.first_body[vehicle], ground.first_body[vehicle + 1]):
                count = place_outline(ground, body, body_position[body], body_angles[body, 1])
                find_lowest(ground.terrain, ground.line, count, lowest[1 + vehicle])


@inlined_kernel
def place_outline(ground, body, position, pitch):
    """Write the outline of a body at `position` (3,) in m and `pitch` (rad) to `ground.line`; returns its points."""
    first, line, c, s = ground.first_corner[body], ground.line, cos(pitch), sin(pitch)
    count = ground.first_corner[body + 1] - first
    for point in range(count):
        along, up = ground.corners[first + point, 0], ground.corners[first + point, 1]
        line[point, 0], line[point, 2] = position[0] + along * c + up * s, position[2] + up * c - along * s
    return count


@kernel
def find_lowest(terrain, line, count, lowest):
    """Update `lowest` (3,) with the least height of a line over the ground, and its place.

    Of equal heights that of the first point counts, and points of the line count before those between them.

    Args:
        terrain: (points, 2) m, x rising.
        line: (n, 3) m, of which x and z count.
        count: points of the line, the first of them.
        lowest: (3,) m, height, x and z; height NaN before there is one.
    """
    height, x, z = inf, nan, nan  # of points of the line
    height_between, x_between, z_between = inf, nan, nan
    before_x, before_z, part = nan, nan, -1  # `part`: last point of the ground that is not beyond
    for point in range(count):
        here_x, here_z, part_before = line[point, 0], line[point, 2], part
        while part + 1 < terrain.shape[0] and terrain[part + 1, 0] <= here_x:
            part += 1
        while part >= 0 and terrain[part, 0] > here_x:
            part -= 1
        if part != part_before:
            first, last = (part_before, part) if part > part_before else (part, part_before)
            slope = (here_z - before_z) / (here_x - before_x)  # NaN at the first point
            for corner in range(first + 1, last + 1):
                above = before_z + slope * (terrain[corner, 0] - before_x)
                if above - terrain[corner, 1] < height_between:
                    height_between = above - terrain[corner, 1]
                    x_between, z_between = terrain[corner, 0], above
        if part >= 0 and part + 1 < terrain.shape[0]:
            rise = (terrain[part + 1, 1] - terrain[part, 1]) / (terrain[part + 1, 0] - terrain[part, 0])
            here = here_z - terrain[part, 1] - rise * (here_x - terrain[part, 0])
        else:
            here = here_z - terrain[part if part > 0 else 0, 1]
        if here < height:
            height, x, z = here, here_x, here_z
        before_x, before_z = here_x, here_z
    if height_between < height:
        height, x, z = height_between, x_between, z_between
    if height < inf and not height >= lowest[0]:
        lowest[0], lowest[1], lowest[2] = height, x, z
