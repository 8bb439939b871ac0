"""Ends of the strands of a loop: motion prescribed by bullwheels, and pull on the bullwheels."""

from __future__ import annotations

from math import sqrt

from cable_twin.mechanics.drives.motion import prescribe
from cable_twin.mechanics.drives.moving_rope import carry_clamped
from cable_twin.mechanics.drives.reference import follow
from cable_twin.mechanics.language.addresses import record_at
from cable_twin.mechanics.language.compilation import kernel
from cable_twin.mechanics.language.vectors import add_scaled, dot, load, scale, store
from cable_twin.mechanics.readout.sections import end_force
from cable_twin.mechanics.solution.bundle.records import FIXED, STATE, SYSTEM


@kernel
def give_ends(bundle, motion, system, state):
    """Prescribe the rope travel at both ends of all strands from their bullwheels."""
    sheaves = bundle.sheaves
    for sheave in range(sheaves.inertia.size):
        for side in range(2):
            here = record_at(bundle.records[sheaves.rope[sheave, side], STATE], state)
            position, speed = motion.rope.position[sheave], motion.rope.velocity[sheave]
            follow(here.rope, 1 - side, position, speed, motion.rope.acceleration[sheave])


@kernel
def place_ends(bundle, motion, system, state):
    """Prescribe position and motion of the end nodes of all strands from the carriages of their bullwheels."""
    sheaves, like = bundle.sheaves, system.cable.gravity
    for sheave in range(sheaves.inertia.size):
        if sheaves.tensioning[sheave] == FIXED:
            continue
        direction = load(sheaves.direction[sheave], like)
        for side in range(2):
            rope = sheaves.rope[sheave, side]
            cable = record_at(bundle.records[rope, SYSTEM], system).cable
            nodes = record_at(bundle.records[rope, STATE], state).nodes
            node = cable.element_count if side == 0 else 0
            place = add_scaled(motion.carriage.position[sheave], direction, load(cable.end_position[1 - side], like))
            store(place, nodes.position[node, 0])
            store(scale(motion.carriage.velocity[sheave], direction), nodes.velocity[node, 0])
            store(scale(motion.carriage.acceleration[sheave], direction), nodes.acceleration[node, 0])
            store(scale(motion.carriage.algorithmic[sheave], direction), nodes.algorithmic[node, 0])


@kernel
def carry_on(bundle, motion, system, state):
    """Update all strands, and all vehicles clamped to them, from the bullwheels of the present iteration."""
    give_ends(bundle, motion, system, state)
    place_ends(bundle, motion, system, state)
    for rope in range(bundle.records.shape[0]):
        own = record_at(bundle.records[rope, SYSTEM], system)
        if own.moving_cable.over_bullwheels:
            here = record_at(bundle.records[rope, STATE], state)
            carry_clamped(own, here)
            prescribe(here)


@kernel
def feel_ends(bundle, motion, system, state):
    """Update the tension of both strands at each bullwheel, less the momentum flux turned by the wheel."""
    sheaves, like = bundle.sheaves, system.cable.gravity
    for sheave in range(sheaves.inertia.size):
        pull, stretch = 0.0, 1.0
        for side in range(2):
            rope = sheaves.rope[sheave, side]
            own = record_at(bundle.records[rope, SYSTEM], system)
            here = record_at(bundle.records[rope, STATE], state)
            force = end_force(own, here, 1 - side)
            r_x = load(here.nodes.position[own.cable.element_count if side == 0 else 0, 1], like)
            along = dot(force, r_x) / sqrt(dot(r_x, r_x))
            motion.tension[sheave, side] = along if side == 0 else -along
            stretch += 0.5 * motion.tension[sheave, side] / own.cable.axial_stiffness
            if sheaves.tensioning[sheave] != FIXED:
                pull += dot(force, load(sheaves.direction[sheave], like))
        motion.pull[sheave], motion.stretch[sheave] = pull, stretch
