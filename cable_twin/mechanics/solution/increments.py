"""Size and place of the last Newton increment."""

from __future__ import annotations

from math import isfinite

from cable_twin.mechanics.language.compilation import kernel


@kernel
def largest_increment(system, work):
    """Size (m) of the last Newton increment: positions, slopes times element length, arc lengths; nan if any is."""
    like, lengths, increments = system.cable.gravity, system.cable.element_length, work.right_side
    worst, total = 0.0, 0.0
    for node in range(increments.shape[0]):
        length = lengths[min(node, lengths.size - 1)]
        largest, gone = 0.0, 0.0  # of a node, as the next one need not wait for it
        for i in range(len(like)):
            r, slope = increments[node, 0, i], length * increments[node, 1, i]
            largest = max(largest, abs(r), abs(slope))
            gone += r + slope
        worst = max(worst, largest)
        total += gone
    for body in range(work.body_increment.shape[0]):
        for axis in range(work.body_increment.shape[1]):
            increment = work.body_increment[body, axis]
            if axis < work.right_side.shape[2]:
                worst = max(worst, abs(increment))
            total += increment
    for carriage in range(work.sliding_increment.size):
        worst = max(worst, abs(work.sliding_increment[carriage]))
        worst = max(worst, abs(work.drum_increment[carriage]))
        total += work.sliding_increment[carriage] + work.drum_increment[carriage]
    return worst if isfinite(total) else total - total


@kernel
def worst_element(work):
    """Element at whose first node the last Newton increment was largest, or not a number."""
    worst, place = -1.0, 0
    for node in range(work.right_side.shape[0]):
        for i in range(work.right_side.shape[2]):
            size = abs(work.right_side[node, 0, i])
            if not size <= worst:
                worst, place = size, node
            if not isfinite(size):
                return min(node, work.right_side.shape[0] - 2)
    return min(place, work.right_side.shape[0] - 2)
