"""Ends of the strands of a loop: where their bullwheels have them, and what they pull with there."""

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
    """Let rope run onto and off all strands as their wheels have it."""
    sheaves = bundle.sheaves
    for sheave in range(sheaves.inertia.size):
        for side in range(2):
            here = record_at(bundle.records[sheaves.rope[sheave, side], STATE], state)
            position, speed = motion.rope.position[sheave], motion.rope.velocity[sheave]
            follow(here.rope, 1 - side, position, speed, motion.rope.acceleration[sheave])


@kernel
def place_ends(bundle, motion, system, state):
    """Put the end nodes of all strands where the carriages of their wheels are, and let them move as those do."""
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
    """Let all strands, and what is clamped to them, go to where their wheels are in this iteration."""
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
    """Take what both strands of each wheel pull with now: their tensions, less the momentum that the wheel turns."""
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
