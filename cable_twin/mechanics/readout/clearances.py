"""Clearances of rope and vehicles over the ground and to masts, and the distance of two boxes.

The ground is straight between its points and level beyond its ends. Rope and outlines are taken at their points and,
between them, above the points of the ground: a minimum of straight lines over straight lines is at one of these.

In space the ground goes straight from the profile under the track (y = 0) to one on each side of it and level beyond
them; in a plane it is level across the track. A body is its outline in the middle, and in space that of its box at half
its width on both sides. A mast is upright and
round and ends at the rope; the point nearest to it in plan, of all below its top, counts.

The distance of two boxes of any orientation is exact, from those of corners to boxes and of edges to edges.
"""

from __future__ import annotations

from math import hypot, inf, nan, sqrt
from typing import NamedTuple

from cable_twin.mechanics.language.by_reference import by_reference
from cable_twin.mechanics.language.compilation import inlined_kernel, kernel
from cable_twin.mechanics.parameters import FloatArray, IntArray

BOX_START, BOX_POINTS = 1, 6  # of the points of an outline: its box, between what goes from there to the pivots


@by_reference
class Surroundings(NamedTuple):
    """Ground profiles, masts, outlines of vehicles, and last measured clearances."""

    middle: FloatArray  # (points, 2) m, profile under the track, x rising; none without a ground
    left: FloatArray  # (points, 2) m, profiles on both sides
    right: FloatArray  # (points, 2) m
    distance: float  # m, of the side profiles from the track; 0 for ground level across the track
    masts: FloatArray  # (masts, 4) m, x, y, height of the top, half the width
    first_body: IntArray  # (vehicles + 1,) number of the first body of each vehicle
    first_corner: IntArray  # (bodies + 1,) number of the first corner of each body
    corners: FloatArray  # (corners, 2) m, outline of each body in its axes, a single line
    half_width: FloatArray  # (bodies,) m, 0 in a plane
    line: FloatArray  # (corners, 3) m, scratch: placed outline of one body
    lowest: FloatArray  # (1 + vehicles, 3) height, x, z in m of rope and vehicles; height NaN without one
    nearest: FloatArray  # (vehicles, 2) distance in m from the nearest mast, and its number; NaN without one


@kernel
def look_around(around, rope, attached, body_position, body_orientation):
    """Store the least heights over the ground of rope and attached vehicles, and least distances of vehicles to masts.

    Args:
        around: takes the result.
        rope: (n, 3) m, points of the rope.
        attached: (vehicles,) 0 in a station.
        body_position: (bodies, 3) m.
        body_orientation: (bodies, 4) unit quaternions x, y, z, w.
    """
    around.lowest[:, 0] = nan
    around.nearest[:] = nan
    if around.middle.shape[0] > 0:
        find_least(around, rope, rope.shape[0], around.lowest[0])
    for vehicle in range(attached.size):
        if attached[vehicle] != 0.0:
            look_around_vehicle(around, vehicle, around.masts, body_position, body_orientation)


@kernel
def look_around_vehicle(around, vehicle, masts, body_position, body_orientation):
    """Store one vehicle's least height over the ground and least distance to `masts` (n, 4) in the record `around`."""
    lowest, nearest = around.lowest[1 + vehicle], around.nearest[vehicle]
    lowest[0], nearest[0], nearest[1] = nan, nan, nan
    ground = around.middle.shape[0] > 0
    for body in range(around.first_body[vehicle], around.first_body[vehicle + 1]):
        for side in range(-1, 2):
            if side != 0 and around.half_width[body] == 0.0:
                continue
            count = place_outline(around, body, side, body_position[body], body_orientation[body])
            if ground:
                find_least(around, around.line, count, lowest)
            find_nearest(masts, around.line, count, nearest)


@kernel
def place_outline(around, body, side, position, turn):
    """Write the outline of a body, or of the left (1) or right side (-1) of its box, in space; return its point count.

    `position` (3,) is in m, `turn` (4,) its quaternion.
    """
    first, line, aside = around.first_corner[body], around.line, side * around.half_width[body]
    count = around.first_corner[body + 1] - first
    if side != 0:
        first, count = first + BOX_START, BOX_POINTS
    i, j, k, real = turn[0], turn[1], turn[2], turn[3]
    for point in range(count):
        x, z = around.corners[first + point, 0], around.corners[first + point, 1]
        # v + 2 u x (u x v + w v), u the vector part
        a = j * z - k * aside + real * x
        b = k * x - i * z + real * aside
        c = i * aside - j * x + real * z
        line[point, 0] = position[0] + x + 2.0 * (j * c - k * b)
        line[point, 1] = position[1] + aside + 2.0 * (k * a - i * c)
        line[point, 2] = position[2] + z + 2.0 * (i * b - j * a)
    return count


@inlined_kernel
def height_of(profile, x):
    """Height (m) of a ground profile (points, 2) at x (m)."""
    last = profile.shape[0] - 1
    low, high = 0, last
    while high - low > 1:
        half = (low + high) // 2
        low, high = (half, high) if profile[half, 0] <= x else (low, half)
    share = (x - profile[low, 0]) / (profile[high, 0] - profile[low, 0])
    share = min(max(share, 0.0), 1.0)
    return profile[low, 1] + share * (profile[high, 1] - profile[low, 1])


@kernel
def ground_height(around, x, y):
    """Height (m) of the ground at x, y (m)."""
    middle = height_of(around.middle, x)
    if around.distance == 0.0:
        return middle
    beside = height_of(around.left, x) if y > 0.0 else height_of(around.right, x)
    return middle + min(abs(y) / around.distance, 1.0) * (beside - middle)


@kernel
def find_least(around, line, count, lowest):
    """Update `lowest` (3,) with the least height of a polyline over the ground, and with x and z (m) of that point."""
    for point in range(count):
        take_height(around, line[point, 0], line[point, 1], line[point, 2], lowest)
        if point > 0:
            for profile in (around.middle, around.left, around.right):
                take_between(around, profile, line[point - 1], line[point], lowest)


@kernel
def take_between(around, profile, start, end, lowest):
    """Update `lowest` (3,) with the heights over the ground of a line segment, at the corners of a ground profile."""
    way = end[0] - start[0]
    for corner in range(profile.shape[0] if way != 0.0 else 0):
        share = (profile[corner, 0] - start[0]) / way
        if 0.0 < share < 1.0:
            y, z = start[1] + share * (end[1] - start[1]), start[2] + share * (end[2] - start[2])
            take_height(around, profile[corner, 0], y, z, lowest)


@kernel
def take_height(around, x, y, z, lowest):
    """Update `lowest` (3,) with the height of a point over the ground, and with x and z (m) of the point, if lower."""
    height = z - ground_height(around, x, y)
    if height < inf and not height >= lowest[0]:
        lowest[0], lowest[1], lowest[2] = height, x, z


@kernel
def find_nearest(masts, line, count, nearest):
    """Update `nearest` (2,) with the least distance (m) of a polyline to a mast, and the index of the mast."""
    for mast in range(masts.shape[0]):
        x, y = masts[mast, 0], masts[mast, 1]
        for point in range(1, count):
            start, end = line[point - 1], line[point]
            along, across = end[0] - start[0], end[1] - start[1]
            square = along * along + across * across
            share = ((x - start[0]) * along + (y - start[1]) * across) / square if square > 0.0 else 0.0
            share = min(max(share, 0.0), 1.0)
            if start[2] + share * (end[2] - start[2]) < masts[mast, 2]:
                apart = hypot(x - start[0] - share * along, y - start[1] - share * across) - masts[mast, 3]
                if not apart >= nearest[0]:
                    nearest[0], nearest[1] = apart, mast


CORNERS, AXES = 8, 3


@kernel
def place_corners(half, corners):
    """Write the corners (8, 3) of an axis-aligned box with half lengths (3,) around 0; bit k of an index is axis k."""
    for corner in range(CORNERS):
        for axis in range(AXES):
            corners[corner, axis] = half[axis] if corner & (1 << axis) else -half[axis]


@kernel
def box_distance(centre, axes, half, corners):
    """Distance (m) between two boxes; 0 in overlap.

    Args:
        centre: (2, 3) m.
        axes: (2, 3, 3), column k the direction of axis k of each.
        half: (2, 3) m, half the length along each; 0 makes it a plate, a bar or a point.
        corners: (2, 8, 3) scratch, corners of each in the axes of the first one.
    """
    least = inf
    for box in range(2):  # that has its corners where it is its own
        place_corners(half[box], corners[box])
        for corner in range(CORNERS):
            turn_into(corners[1 - box], corner, centre, axes, half, box)
        least = min(least, distance_from(half[box], corners[1 - box]))
    if least == 0.0:
        return 0.0
    for corner in range(CORNERS):  # those of the second are in the axes of itself now: of the first, as for edges
        turn_into(corners[1], corner, centre, axes, half, 0)
    place_corners(half[0], corners[0])
    for first in range(CORNERS):
        for axis in range(AXES):
            if first & (1 << axis):
                continue
            for second in range(CORNERS):
                for other in range(AXES):
                    if not second & (1 << other):
                        here = segment_distance(
                            corners[0, first],
                            corners[0, first | (1 << axis)],
                            corners[1, second],
                            corners[1, second | (1 << other)],
                        )
                        least = min(least, here)
    return least


@kernel
def turn_into(corners, corner, centre, axes, half, box):
    """Write a corner of one of two boxes, in the axes of the other, `box` (0 or 1), and relative to its centre."""
    other = 1 - box
    for axis in range(AXES):
        value = 0.0
        for part in range(AXES):
            place = centre[other, part] - centre[box, part]
            for own in range(AXES):
                sign = 1.0 if corner & (1 << own) else -1.0
                place += sign * half[other, own] * axes[other, part, own]
            value += axes[box, part, axis] * place
        corners[corner, axis] = value


@kernel
def distance_from(half, corners):
    """Least distance (m) of the corners (8, 3) of a box to another one of half lengths (3,); 0 for crossing edges.

    Both are in the axes of the latter.
    """
    least = inf
    for corner in range(CORNERS):
        square = 0.0
        for axis in range(AXES):
            beyond = max(abs(corners[corner, axis]) - half[axis], 0.0)
            square += beyond * beyond
        least = min(least, square)
        for axis in range(AXES):
            if not corner & (1 << axis) and crosses(half, corners[corner], corners[corner | (1 << axis)]):
                return 0.0
    return sqrt(least)


@kernel
def crosses(half, start, end):
    """Return whether the segment from `start` to `end` (3,) intersects a box of half lengths (3,) around 0."""
    first, last = 0.0, 1.0
    for axis in range(AXES):
        way = end[axis] - start[axis]
        if way == 0.0:
            if abs(start[axis]) > half[axis]:
                return False
            continue
        one, two = (-half[axis] - start[axis]) / way, (half[axis] - start[axis]) / way
        first, last = max(first, min(one, two)), min(last, max(one, two))
    return first <= last


@inlined_kernel
def within(share):
    """Clamp a number to the range 0..1."""
    return min(max(share, 0.0), 1.0)


@kernel
def segment_distance(start, end, other_start, other_end):
    """Distance (m) between two line segments, each from a start to an end (3,)."""
    own, cross, others, own_apart, others_apart = 0.0, 0.0, 0.0, 0.0, 0.0
    for axis in range(AXES):
        way, other = end[axis] - start[axis], other_end[axis] - other_start[axis]
        apart = start[axis] - other_start[axis]
        own, cross, others = own + way * way, cross + way * other, others + other * other
        own_apart, others_apart = own_apart + way * apart, others_apart + other * apart
    determinant = own * others - cross * cross
    share = 0.0
    if determinant > 1e-12 * own * others:  # not parallel, where any place does
        share = within((cross * others_apart - own_apart * others) / determinant)
    other_share = within((others_apart + cross * share) / others) if others > 0.0 else 0.0
    if own > 0.0:
        share = within((cross * other_share - own_apart) / own)
    square = 0.0
    for axis in range(AXES):
        apart = start[axis] + share * (end[axis] - start[axis])
        apart -= other_start[axis] + other_share * (other_end[axis] - other_start[axis])
        square += apart * apart
    return sqrt(square)
