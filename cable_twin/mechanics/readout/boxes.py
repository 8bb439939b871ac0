"""Exact distance of two boxes of any orientation: from corner-box and edge-edge distances."""

from __future__ import annotations

from math import inf, sqrt

from cable_twin.mechanics.language.compilation import inlined_kernel, kernel

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
    """Transform one corner of the other box into the axes and centre of `box`."""
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
    """Least distance (m) of corners (8, 3) to a box of half lengths (3,); 0 for crossing edges.

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
    """Clamp a share to 0..1."""
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


__all__ = ["box_distance"]
