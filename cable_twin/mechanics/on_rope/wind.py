"""Wind at elements and bodies, and its force on bodies: height law, gusts, turbulence, drag, vortex shedding.

Power law and gusts are those of IEC 61400-1 (2005), 6.3.1.2 and 6.3.2.2, and of CS-25.341: a gust has the amplitude a,
the duration T and, t after its start, the speed

    -0.37 a sin(3 π t / T) (1 - cos(2 π t / T))   extreme operating gust, with a dip before and after its peak,
    a / 2 (1 - cos(2 π t / T))                    one minus cosine,

everywhere at once, and as the mean with height. Turbulence is a table that the mean wind carries past unchanged
(Taylor 1938), at points along the line, between which it is interpolated.

The drag on a body acts at its centre of mass, without a moment. With the wind w there, w_b = w - ċ, a body that is
alike all round has the force q |w_b| w_b, q = density drag_area / 2, one with a drag area for each of its axes
A diag(q) Aᵀ |w_b| w_b. Eddies leave a body of the width b f = St v / b times a second, left and right in turn; they
push it across the horizontal relative wind v with c A ρ v² / 2 sin(2 π ∫ f dt) (EN 1991-1-4, annex E).

The drag on the rope is `rope.rope_drag`.
"""

from __future__ import annotations

from math import cos, floor, hypot, pi, sin, sqrt

from cable_twin.mechanics.language.compilation import inlined_kernel, kernel
from cable_twin.mechanics.language.rotations import by_turn, orientation
from cable_twin.mechanics.language.vectors import (
    accumulate,
    add_scaled,
    block,
    dot,
    full,
    load,
    outer,
    product,
    scale,
    store,
    subtract,
    symmetric,
    transpose,
)
from cable_twin.mechanics.on_rope.presence import belongs
from cable_twin.mechanics.parameters import OPERATING_GUST, FloatArray
from cable_twin.mechanics.state import State


def set_wind(state: State, wind: FloatArray) -> None:
    """Set a uniform wind (dim,) in m/s; where the wind varies, the next step overwrites its local values."""
    state.wind[:] = wind
    state.wind_field.along_rope[:] = state.wind[:, None]
    state.wind_field.at_bodies[:] = wind


@kernel
def update_wind(system, state, h):
    """Advance the wind by `h` (s), and write its velocity at all elements and bodies of a rope."""
    air, field, dim = system.air, state.wind_field, state.wind.size
    field.time[0] += h
    if not air.varies and field.gust[4] == 0.0:
        return  # all is as `set_wind` has left it
    wind, time = air.wind, field.time[0]
    x, y, z = state.wind[0], state.wind[1] if dim == 3 else 0.0, state.wind[dim - 1]
    mean = x, y, z
    field.way[0] += h * sqrt(x * x + y * y + z * z)
    if wind.intensity > 0.0:
        update_turbulence(wind, field, mean)
    for number in range(wind.gusts.shape[0] + 1):
        gust = field.gust if number == wind.gusts.shape[0] else wind.gusts[number]
        share = share_of_gust(gust, time)
        x, y, z = x + share * gust[0], y + share * gust[1], z + share * gust[2]
    nodes = state.nodes.position
    for element in range(system.cable.element_count):
        start, end = nodes[element, 0], nodes[element + 1, 0]
        across = 0.5 * (start[1] + end[1]) if dim == 3 else 0.0
        place = 0.5 * (start[0] + end[0]), across, 0.5 * (start[dim - 1] + end[dim - 1])
        here = wind_at(wind, field, place, (x, y, z))
        field.along_rope[0, element], field.along_rope[dim - 1, element] = here[0], here[2]
        if dim == 3:
            field.along_rope[1, element] = here[1]
    for vehicle in range(state.vehicle_rope.size):
        if belongs(system, state, vehicle):
            for body in range(system.carriages.body_offset[vehicle], system.carriages.body_offset[vehicle + 1]):
                write_wind_at(wind, state, body, (x, y, z))
                if wind.shedding.shape[0] > 0:
                    update_shedding(wind, state, body, h)


@kernel
def write_wind_at(wind, state, body, even):
    """Write the wind velocity at a body, from the mean wind `even` (3,) in m/s."""
    field, bodies, dim = state.wind_field, state.bodies.position, state.wind.size
    place = bodies[body, 0], bodies[body, 1] if dim == 3 else 0.0, bodies[body, dim - 1]
    here = wind_at(wind, field, place, even)
    field.at_bodies[body, 0], field.at_bodies[body, dim - 1] = here[0], here[2]
    if dim == 3:
        field.at_bodies[body, 1] = here[1]


@kernel
def share_of_gust(gust, time):
    """Speed (-) at a `time` (s) of a gust, row `gust` (6,) of `Wind.gusts`, relative to the amplitude of the gust."""
    duration, passed = gust[4], time - gust[3]
    if not 0.0 < passed < duration:
        return 0.0
    turn = 2.0 * pi * passed / duration
    if gust[5] == OPERATING_GUST:
        return -0.37 * sin(1.5 * turn) * (1.0 - cos(turn))
    return 0.5 * (1.0 - cos(turn))


@kernel
def wind_at(wind, field, place, even):
    """Wind x, y, z in m/s at a position (3,) in m: mean wind `even` (3,) scaled to the height, plus turbulence."""
    factor = 1.0
    if wind.exponent > 0.0:
        height = place[2] - ground_at(wind, place[0])
        factor = (height / wind.reference_height) ** wind.exponent if height > 0.0 else 0.0
    x, y, z = factor * even[0], factor * even[1], factor * even[2]
    if wind.intensity > 0.0:
        last = wind.points.shape[0] - 1
        share = share_of_line(wind, place) * last
        first = min(int(share), last - 1) if last > 0 and share > 0.0 else 0  # what is no number is at the first
        share, after = share - first, min(first + 1, last)
        # and what the straight line lacks, most in the middle: the variance is that at the points
        middle = 4.0 * share * (1.0 - share)
        for row, weight in ((0, 1.0), (last + 1, middle * sqrt(middle))):
            here, there = field.points[row + first], field.points[row + after]
            x += weight * (here[0] + share * (there[0] - here[0]))
            y += weight * (here[1] + share * (there[1] - here[1]))
            z += weight * (here[2] + share * (there[2] - here[2]))
    return x, y, z


@kernel
def ground_at(wind, x):
    """Height (m) of the ground of the wind profile at `x` (m)."""
    last = wind.ground.size - 1
    share = min(max((x - wind.ground_start) / wind.ground_step, 0.0), 1.0 * last)
    first = min(int(share), max(last - 1, 0)) if share > 0.0 else 0  # what is no number is at the first
    return wind.ground[first] + (share - first) * (wind.ground[min(first + 1, last)] - wind.ground[first])


@inlined_kernel
def share_of_line(wind, place):
    """Relative position of a point (3,) along the line of turbulence points, from 0 at its start to 1 at its end."""
    start, end = wind.points[0], wind.points[wind.points.shape[0] - 1]
    along, length = 0.0, 0.0
    for axis in range(3):
        along += (place[axis] - start[axis]) * (end[axis] - start[axis])
        length += (end[axis] - start[axis]) ** 2
    return min(max(along / length, 0.0), 1.0) if length > 0.0 else 0.0


@kernel
def update_turbulence(wind, field, mean):
    """Write the turbulence at all its points in a mean wind (3,) in m/s, delayed with the distance downwind.

    After the rows of the points are those of what straight lines between them lack, as in `Wind.turbulence`.
    """
    flat = hypot(mean[0], mean[1])
    speed = hypot(flat, mean[2])
    ahead = (mean[0] / flat, mean[1] / flat) if flat > 0.0 else (1.0, 0.0)
    deviation, samples = wind.intensity * speed, wind.turbulence.shape[1]
    count = wind.points.shape[0]
    for point in range(count):
        behind = 0.0
        for axis in range(3):
            if speed > 0.0:
                behind += (wind.points[point, axis] - wind.points[0, axis]) * mean[axis] / speed
        place = (field.way[0] - behind) / wind.sample_spacing
        whole = floor(place)
        t = place - whole
        # four samples, by the cubic of Catmull and Rom
        weights = (
            0.5 * t * (t * (2.0 - t) - 1.0),
            0.5 * (t * t * (3.0 * t - 5.0) + 2.0),
            0.5 * t * (t * (4.0 - 3.0 * t) + 1.0),
            0.5 * t * t * (t - 1.0),
        )
        first = int(whole) - 1
        for row in (point, count + point):
            u, v, w = 0.0, 0.0, 0.0
            for number in range(4):
                sample, weight = wind.turbulence[row, (first + number) % samples], weights[number]
                u, v, w = u + weight * sample[0], v + weight * sample[1], w + weight * sample[2]
            field.points[row, 0] = deviation * (u * ahead[0] - v * ahead[1])
            field.points[row, 1] = deviation * (u * ahead[1] + v * ahead[0])
            field.points[row, 2] = deviation * w


@kernel
def update_shedding(wind, state, body, h):
    """Advance the vortex shedding of a body by `h` (s), and write its side force."""
    field = state.wind_field
    x = field.at_bodies[body, 0] - state.bodies.velocity[body, 0]
    y = field.at_bodies[body, 1] - state.bodies.velocity[body, 1]
    speed = hypot(x, y)
    phase = field.shedding_phase[body] + 2.0 * pi * wind.shedding[body, 0] * speed * h
    field.shedding_phase[body] = phase % (2.0 * pi)
    side = wind.shedding[body, 1] * speed * sin(phase)
    field.shedding_force[body, 0], field.shedding_force[body, 1] = -side * y, side * x


@kernel
def drag_bodies(system, state, rate_factor, stiffness_factor, work):
    """Store the aerodynamic force (N) on all bodies of a rope, and its negative derivatives by position, rotation."""
    for vehicle in range(state.vehicle_rope.size):
        if belongs(system, state, vehicle):
            for body in range(system.carriages.body_offset[vehicle], system.carriages.body_offset[vehicle + 1]):
                drag_body(system.air, state, body, system.cable.gravity, rate_factor, stiffness_factor, work)


@kernel
def drag_body(air, state, body, like, rate_factor, stiffness_factor, work):
    """Store the aerodynamic force (N) on one body, and its negative derivatives by position and rotation."""
    dim, q, even = len(like), air.body_drag[body, 0], True
    for axis in range(1, dim):
        even = even and air.body_drag[body, axis * (dim + 1)] == q
    relative = subtract(load(state.wind_field.at_bodies[body], like), load(state.bodies.velocity[body], like))
    speed = sqrt(dot(relative, relative))
    if not even:
        drag_by_axes(air, state, body, relative, (speed, rate_factor, stiffness_factor), work)
    elif q > 0.0:
        store(scale(q * speed, relative), work.body_drag[body])
        steep = rate_factor * q / speed if speed > 0.0 else 0.0
        store(full(1.0, symmetric(steep * speed * speed, steep, relative), 0.0), work.body_drag_tangent[body])
    if air.wind.shedding.shape[0] > 0:
        if even and q == 0.0:
            store(scale(0.0, like), work.body_drag[body])
        accumulate(load(state.wind_field.shedding_force[body], like), work.body_drag[body])


@inlined_kernel
def drag_by_axes(air, state, body, relative, factors, work):
    """Store the drag on a body with a drag area for each axis: K |w| w, K = A diag(q) Aᵀ rotating with the body."""
    speed, rate_factor, stiffness_factor = factors
    axes = orientation(state.bodies.position[body], relative)
    k = product(product(axes, load(air.body_drag[body], axes)), transpose(axes))
    drag = product(k, relative)
    store(scale(speed, drag), work.body_drag[body])
    steep = rate_factor / speed if speed > 0.0 else 0.0
    by_place = add_scaled(1.0, outer(steep, drag, relative), block(rate_factor * speed, k, 0.0))
    store(by_place, work.body_drag_tangent[body])
    by_angle = subtract(product(k, by_turn(relative)), by_turn(drag))
    store(scale(stiffness_factor * speed, by_angle), work.body_drag_turning[body])
