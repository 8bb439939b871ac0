"""State of one rope with its vehicles, and workspace of the solver: arrays that kernels change in place."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cable_twin.mechanics.language.by_reference import by_reference
from cable_twin.mechanics.language.compilation import kernel
from cable_twin.mechanics.language.declared import ANY, CLOCK, Memory, Of, Range, allocate, allocate_together, ranges_of
from cable_twin.mechanics.language.memory import copy_array
from cable_twin.mechanics.language.simd import WIDTH
from cable_twin.mechanics.parameters import (
    COLDEST,
    DRUM,
    FREE,
    GUSTS,
    HOTTEST,
    IN_GROOVE,
    JOINT,
    LIFTED,
    SPEED,
    FloatArray,
    IntArray,
    System,
)

VEHICLES = frozenset({"vehicle", "body"})  # sizes of arrays that all ropes of a scenario have in common
BoolArray = NDArray[np.bool_]
SHARE = Range(-1.0 - 1e-9, 1.0 + 1e-9)  # and what rounding adds
PLACE = Range("before the rope", "beyond the rope")  # m
NOT_NEGATIVE = Range(0.0, ANY.most)


@by_reference
class Motion(NamedTuple):
    """Coordinates of one kind and their rates, in arrays of one shape; units as declared, and per second."""

    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray  # the true one
    algorithmic: FloatArray  # auxiliary acceleration of generalized-alpha, a weighted mean over a step of true ones


@by_reference
class Mesh(NamedTuple):
    """Mesh of a rope: arc lengths of its nodes, which stand still except those that follow a vehicle's joint."""

    arc_length: Annotated[FloatArray, Of("node", unit="m")]
    length: Annotated[FloatArray, Of("element", unit="m")]  # of the elements, unstrained
    plain: Annotated[FloatArray, Of("element", first=1.0)]  # 0 beside a node that follows a load, else 1


@by_reference
class Course(NamedTuple):
    """Reference motion of a drive, or prescribed travel of a rope; units as declared, and per second."""

    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray


@by_reference
class Drives(NamedTuple):
    """Commands of drives, one row per axis: joint or haul drum of a vehicle, moving cable, bullwheel."""

    mode: Annotated[IntArray, Of(first=FREE), Range(FREE, SPEED)]  # FREE, FORCE or SPEED
    target: Annotated[FloatArray, Of(unit="m/s")]  # in SPEED
    force: Annotated[FloatArray, Of(unit="N")]  # given in FORCE; in SPEED the multiplier of the driven axis
    braking: Annotated[BoolArray, Of()]  # an emergency stop is in force
    braking_time: Annotated[FloatArray, Of(unit="s")]  # since the start of the emergency stop


@by_reference
class WindField(NamedTuple):
    """Present wind at elements and bodies, and the memory of its generators."""

    time: Annotated[FloatArray, Of(1, unit="s")]  # since the start or the last reset
    way: Annotated[FloatArray, Of(1, unit="m")]  # of wind gone by, at its mean speed
    gust: Annotated[
        FloatArray, Of(6), ANY, ANY, ANY, ANY, ANY, Range(0, len(GUSTS) - 1)
    ]  # the last one that was commanded, as in `Wind.gusts`
    points: Annotated[FloatArray, Of("wind point", 3, unit="m/s")]  # turbulence in x, y, z by row of `Wind.turbulence`
    along_rope: Annotated[FloatArray, Of("dim", "lane", unit="m/s")]  # in the middle of each element
    at_bodies: Annotated[FloatArray, Of("body", "dim", unit="m/s")]  # at each centre of mass
    shedding_phase: Annotated[FloatArray, Of("body", unit="rad")]  # of the eddies that each sheds
    shedding_force: Annotated[FloatArray, Of("body", "dim", unit="N")]  # of them


@by_reference
class State(NamedTuple):
    """Motion of one rope with its vehicles at one time, and the commands of its drives."""

    nodes: Annotated[Motion, Of("node", 3, "dim", unit="m")]  # e: r in m, r_x (-) before the node and after it
    mesh: Mesh
    bodies: Annotated[
        Motion, Of("body", "rate", unit="m"), Of("body", "coordinate", unit="m", field="position")
    ]  # r: x, z in m, pitch in rad; in space x, y, z, and x, y, z, w of a unit quaternion, rates in m/s and, about the
    # axes of the world, rad/s
    joints: Annotated[Motion, Of("vehicle", unit="m")]  # n, arc length on the whole cable; without inertia, so the true
    # acceleration is known only to Runge-Kutta
    drums: Annotated[Motion, Of("vehicle", unit="m")]  # rope hauled by the drive drum of each haul rope
    hauled: Annotated[Motion, Of("vehicle", unit="m")]  # what each haul rope pulls: its way in space along the track
    node_load: Annotated[
        IntArray, Of("node", first=-1), Range(-1, "last vehicle")
    ]  # vehicle that a node follows, or -1
    joint_node: Annotated[IntArray, Of("vehicle", first=-1), Range(-1, "last element")]  # that follows the joint, or -1
    node_follows: Annotated[BoolArray, Of("vehicle")]  # whether that goes along with it; near an end it stands
    joint_element: Annotated[IntArray, Of("vehicle"), Range(0, "last element")]  # element on which the joint is
    friction_deflection: Annotated[
        FloatArray, Of("vehicle"), SHARE
    ]  # share -1..1 of rolling friction that is mobilised
    friction_origin: Annotated[
        FloatArray, Of("vehicle", unit="m")
    ]  # arc length at which that was so: start of the step
    multipliers: Annotated[
        FloatArray, Of("body", "dim", unit="N")
    ]  # lambda, on each body at its upper pivot; first of a
    # chain: sliding joint
    moments: Annotated[
        FloatArray, Of("body", "turn", unit="N m")
    ]  # on each body, of what its joint holds; none in a plane
    clamp_holds: Annotated[BoolArray, Of("vehicle")]  # by a clamp to another rope now
    clamp_force: Annotated[FloatArray, Of("vehicle", "dim", unit="N")]  # of that rope on the carriage
    vehicle_rope: Annotated[IntArray, Of("vehicle"), Range(0, "last rope")]  # of each, or of its station
    attached: Annotated[
        BoolArray, Of("vehicle", first=1)
    ]  # on the cable; only what is clamped to a moving one ever is not
    payload: Annotated[FloatArray, Of("vehicle", unit="kg"), NOT_NEGATIVE]  # already in the masses of the system
    axis: Annotated[IntArray, Of("vehicle"), Range(JOINT, DRUM)]  # of the vehicle's drive
    drives: Annotated[Drives, Of("vehicle")]  # force: along the cable, or at the drum
    reference: Annotated[Course, Of("vehicle", unit="m")]  # reference of a joint or drum driven at a speed
    rope: Annotated[Course, Of(2, unit="m")]  # rope that has gone by at start and end of the mesh, towards the end
    surplus: Annotated[
        FloatArray, Of(1, unit="m")
    ]  # by which the rope on the mesh was longer than before any had gone by
    loop_start: Annotated[FloatArray, Of(1, unit="m")]  # place on the loop of the start of the mesh then
    rope_drive: Annotated[Drives, Of(1)]  # of a moving cable
    contact_arc_length: Annotated[FloatArray, Of("contact", unit="m"), PLACE]  # of the rope nearest to each contact
    contact_deflection: Annotated[FloatArray, Of("contact"), SHARE]  # share -1..1 of its friction that is mobilised
    contact_origin: Annotated[
        FloatArray, Of("contact", unit="m")
    ]  # arc length less `rope` at which that was so: the start
    # of the step
    tower_load: Annotated[
        FloatArray, Of("tower", 2, unit="N")
    ]  # sum of normal forces at the end of the last step, and the
    # least of them
    tower_lateral: Annotated[
        FloatArray, Of("tower", 2, unit="N, -")
    ]  # in space: N to the left of the track that a tower
    # gives the rope in its grooves, at the end of the last step, and the highest ratio (-) of its size to the normal
    # force, else NO_RATIO
    derailment: Annotated[
        IntArray, Of("tower", 2), Range(IN_GROOVE, LIFTED), CLOCK
    ]  # in space: IN_GROOVE or how the rope came out, and the clock at that
    push: Annotated[FloatArray, Of("vehicle", 4, unit="N, N, m/s, -")]  # with which each and those after it on the rope
    # push each other, at the end of the last step, and the highest since the start or the last reset; at which they
    # close in; clock of contact
    touch: Annotated[
        FloatArray, Of("vehicle", 4, unit="-, m, m/s, -"), Range(0, "vehicles"), ANY, ANY, ANY
    ]  # 1 + number of the one after it that it has met last, or 0; its place on the cable there; at which they met; the
    # clock at that
    wind: Annotated[FloatArray, Of("dim", unit="m/s")]  # its mean at the reference height
    wind_field: WindField
    temperature: Annotated[
        FloatArray, Of(1, unit="degC"), Range(COLDEST, HOTTEST)
    ]  # of the rope, already in the parameters
    newton_ratio: Annotated[
        FloatArray, Of(1, unit="-"), Range(0.0, inf)
    ]  # error that a Newton iteration leaves, over its estimate; 0: not known, nor are accelerations
    clock: Annotated[IntArray, Of(1), CLOCK]  # whole solver steps since the start
    memory: Memory  # all of these


RANGES = ranges_of(State)  # of the arrays, as `arrays_of` names them
FIELDS = tuple(RANGES)


@by_reference
class Workspace(NamedTuple):
    """Residual, tangent and factors of elimination; contents have no meaning between steps."""

    diagonal: Annotated[FloatArray, Of("node", 2, 2, "dim²")]  # matrices of r and r_x against r and r_x
    upper: Annotated[FloatArray, Of("element", 2, 2, "dim²")]  # couples node k to k + 1
    lower: Annotated[FloatArray, Of("element", 2, 2, "dim²")]  # couples node k + 1 to k
    group: Annotated[
        FloatArray, Of("element row", WIDTH)
    ]  # residual and tangent of a group of elements, as in `shape_functions`
    elements: Annotated[FloatArray, Of(WIDTH, "element row")]  # the same, one row an element
    patch_of: Annotated[IntArray, Of("element", first=-1)]  # load beside which the element is, else -1
    patch_right: Annotated[IntArray, Of("element")]  # 1 for the element after that load, 0 for the one before
    patch: Annotated[
        FloatArray, Of("vehicle", "patch", "patch column")
    ]  # tangent of both elements beside a load, with its right side in the column after; rows as in `point.patch_row`
    patch_force: Annotated[FloatArray, Of("vehicle", "patch")]  # right side of these by the two elements alone
    no_columns: Annotated[FloatArray, Of("vehicle", "patch", 0)]  # further right sides of patches, where none are
    along_held: Annotated[BoolArray, Of("vehicle")]  # whether the arc length of a load's node has a given increment
    along_increment: Annotated[FloatArray, Of("vehicle", unit="m")]  # that increment
    along_kept: Annotated[FloatArray, Of("vehicle", 3, unit="m, m/s, m/s²")]  # motion of joints before a difference
    plain_elements: Annotated[IntArray, Of("lane")]  # elements beside no load, the last one repeated
    plain_count: Annotated[IntArray, Of(1)]  # how many of these there are
    patch_elements: Annotated[IntArray, Of("beside load")]  # elements beside loads, likewise
    patch_count: Annotated[IntArray, Of(1)]  # how many of these there are
    patch_motion: Annotated[FloatArray, Of("patch motion", WIDTH)]  # of the rope on a group of these, one row a number
    patch_elastic: Annotated[FloatArray, Of("element row", WIDTH)]  # elastic part of the `group` of these
    patch_by_length: Annotated[FloatArray, Of("patch length", WIDTH)]  # derivatives of their elastic energy by length
    right_side: Annotated[FloatArray, Of("node", 3, "dim")]  # minus the residual; after the solution the increment of e
    contact_slide: Annotated[
        FloatArray, Of("contact lane", unit="N/m")
    ]  # growth of its friction with sliding, over |r_x|
    contact_element: Annotated[IntArray, Of("contact lane", first=-1)]  # where the rope touches, or is near; else -1
    contact_near: Annotated[IntArray, Of("contact lane")]  # element of the point of the rope that is nearest
    contact_place: Annotated[FloatArray, Of("contact lane", unit="m")]  # arc length at which the rope is taken there
    contact_shape: Annotated[FloatArray, Of(4, "contact lane")]  # shape functions there
    contact_shape_x: Annotated[FloatArray, Of(4, "contact lane")]  # their derivatives
    contact_depth: Annotated[FloatArray, Of(3, "contact lane", unit="m, m/s, N")]  # its rate, and the normal force
    contact_normal: Annotated[FloatArray, Of("dim", "contact lane")]  # of the rope
    contact_friction: Annotated[
        FloatArray, Of(3, "contact lane", unit="m, -, -")
    ]  # way, and its share that was mobilised before it and is after it
    lane_moves: Annotated[BoolArray, Of(WIDTH)]  # whether nearest points of a group of contacts are still looked for
    lane_numbers: Annotated[FloatArray, Of(8, WIDTH)]  # of a group of contacts, one row a number
    joint_gap: Annotated[
        FloatArray, Of("body", "dim", unit="m")
    ]  #  (or m/s² at acceleration level): what each joint has to close
    held_gap: Annotated[
        FloatArray, Of("body", 2, unit="-")
    ]  # cosines of the angles that joints in space hold at right ones
    body_increment: Annotated[FloatArray, Of("body", "rate")]
    turned: Annotated[
        FloatArray, Of("body", "turn", unit="rad")
    ]  # rotation vector of the step so far, by which an integrator reckons
    turn_by_place: Annotated[
        FloatArray, Of("body", "turn dim")
    ]  # minus the turn of a body, by the place of its upper pivot
    turn_by_above: Annotated[FloatArray, Of("body", "turn²")]  # the same by the turn of what is above
    turn_right: Annotated[FloatArray, Of("body", "turn")]
    impedance: Annotated[FloatArray, Of("body", "dim²")]  # D of the chain from this body down: force by place
    impedance_turning: Annotated[FloatArray, Of("body", "turn dim")]  # D of the same: force by turn of what is above
    impedance_moment: Annotated[FloatArray, Of("body", "turn dim")]  # D of the same: moment by place
    impedance_turn: Annotated[FloatArray, Of("body", "turn²")]  # D of the same: moment by turn
    impedance_force: Annotated[FloatArray, Of("body", "rate")]  # b of the same: Δ(λ, m) = D Δ(p, θ) + b
    held_by_place: Annotated[
        FloatArray, Of("body", "turn dim")
    ]  # increment of the moment that holds in space, by the place
    held_by_above: Annotated[FloatArray, Of("body", "turn²")]
    held_right: Annotated[FloatArray, Of("body", "turn")]
    grip_row: Annotated[
        FloatArray, Of("vehicle", 4, "turn dim")
    ]  # turn of the cable as the hinge sees it, by the nodal coordinates
    grip_by_s: Annotated[FloatArray, Of("vehicle", "turn", unit="rad/m")]  # the same by the arc length
    sliding_pivot: Annotated[FloatArray, Of("vehicle")]  # eliminated row of the sliding coordinate
    sliding_row: Annotated[FloatArray, Of("vehicle", 4, "dim")]
    sliding_column: Annotated[FloatArray, Of("vehicle", 4, "dim")]  # forces on the nodes by the sliding coordinate
    sliding_along: Annotated[FloatArray, Of("vehicle", "dim")]  # minus its row by a force on the joint beside the cable
    sliding_right: Annotated[FloatArray, Of("vehicle")]
    sliding_increment: Annotated[FloatArray, Of("vehicle")]
    saturation: Annotated[
        FloatArray, Of("vehicle", unit="N")
    ]  # what a drive at its force limit gives in this step, else 0
    driven: Annotated[BoolArray, Of("vehicle")]  # the joint follows a reference
    given_force: Annotated[FloatArray, Of("vehicle", unit="N")]  # along the cable
    haul_direction: Annotated[
        FloatArray, Of("vehicle", "dim")
    ]  # of each haul rope in this step: its way by the place of the joint
    haul_place: Annotated[FloatArray, Of("vehicle", "dim", unit="m")]  # of the joint at the start of the step
    haul_origin: Annotated[FloatArray, Of("vehicle", unit="m")]  # way less direction times place
    haul_gap: Annotated[FloatArray, Of("vehicle", unit="m")]  # way at the place of the joint less that of the state
    haul_force: Annotated[FloatArray, Of("vehicle", unit="N")]  # on the way
    haul_by_way: Annotated[FloatArray, Of("vehicle", unit="N/m")]  # its derivative by the way, the drum eliminated
    haul_change: Annotated[FloatArray, Of("vehicle", unit="N")]  # its increment where the joint stands
    haul_increment: Annotated[FloatArray, Of("vehicle")]
    drum_row: Annotated[
        FloatArray, Of("vehicle", 3)
    ]  # eliminated row of the drum: pivot, coefficient of the way, right side
    drum_increment: Annotated[FloatArray, Of("vehicle")]
    touching: Annotated[BoolArray, Of("pair")]  # their buffers are pressed
    pressed_tangent: Annotated[FloatArray, Of("pair", "dim²", unit="N/m")]  # of their buffers
    pressed: Annotated[BoolArray, Of("vehicle")]  # others push it, whose displacement is predicted
    foreseen: Annotated[FloatArray, Of("vehicle", 2)]  # of that, along the rope: stiffness (N/m) and force (N)
    foreseen_way: Annotated[FloatArray, Of("vehicle", "dim")]  # along the rope
    foreseen_move: Annotated[FloatArray, Of("vehicle", "dim", unit="m")]  # the displacement
    body_drag: Annotated[FloatArray, Of("body", "dim", unit="N")]  # of the air
    body_drag_tangent: Annotated[FloatArray, Of("body", "dim²", unit="N/m")]  # minus its derivative by the place
    body_drag_turning: Annotated[FloatArray, Of("body", "turn dim", unit="N/rad")]  # minus its derivative by the turn
    memory: Memory  # all of these


def sizes_of(system: System) -> dict[str, int]:
    """Sizes of array dimensions by name, as "node" for the number of nodes, for the records of one rope."""
    elements, dim = system.cable.element_count, len(system.cable.gravity)
    turns = turns_of(dim)
    return {
        "node": elements + 1,
        "element": elements,
        "lane": -(-elements // WIDTH) * WIDTH,  # elements, rounded up to whole groups
        "body": system.carriages.mass.size,
        "vehicle": system.carriages.fixed.size,
        "tower": system.towers.top.shape[0],
        "contact": system.towers.stiffness.size,
        "contact lane": -(-system.towers.stiffness.size // WIDTH) * WIDTH,
        "pair": system.buffers.other.size,  # of vehicles that may push each other
        "wind point": system.air.wind.turbulence.shape[0],
        "dim": dim,
        "turn": turns,  # angles of a body
        "rate": dim + turns,
        "coordinate": 3 if dim == 2 else 7,  # of a body
        "dim²": dim * dim,
        "turn dim": turns * dim,
        "turn²": turns * turns,
        "patch": 8 * dim + 2 if system.cable.load_nodes else 0,
        "patch column": 8 * dim + 4 if system.cable.load_nodes else 0,
        "beside load": 2 * system.carriages.fixed.size + WIDTH - 1,
        "patch motion": dim + 6,
        "patch length": 3 * dim + 2,
        "element row": 4 * dim + 16 * dim * dim,  # residual and tangent of an element
    }


def allocate_state(system: System) -> State:
    """Allocate a zero state of one rope with every joint at rest, as input of `equilibrium`."""
    return allocate_states([system])[0]


def allocate_states(systems: Sequence[System]) -> tuple[State, ...]:
    """Allocate the states of ropes in one block of memory; the vehicles exist once, for all of them."""
    states = allocate_together(State, [sizes_of(system) for system in systems], VEHICLES)
    for system, state in zip(systems, states, strict=True):
        _initialise(system, state)
    return states


def _initialise(system: System, state: State) -> None:
    """Set mesh, drives, ropes of vehicles and quaternions of a new state."""
    state.mesh.arc_length[:], state.mesh.length[:] = system.cable.node_arc_length, system.cable.element_length
    held = system.carriages.fixed | system.carriages.clamped
    state.axis[:] = np.where((system.haul_ropes.axial_stiffness > 0.0) & ~held, DRUM, JOINT)
    state.drives.mode[held] = SPEED
    state.vehicle_rope[:] = max(system.number, 0)
    state.rope_drive.mode[:] = SPEED if system.moving_cable.moving else FREE
    if len(system.cable.gravity) == 3:
        state.bodies.position[:, 6] = 1.0  # upright
    state.wind_field.shedding_phase[:] = first_phases(system.carriages.mass.size)


def allocate_workspace(system: System) -> Workspace:
    """Allocate the solver's workspace for the rope and vehicles of `system`."""
    work = allocate(Workspace, sizes_of(system))
    work.plain_elements[:] = np.minimum(np.arange(work.plain_elements.size), system.cable.element_count - 1)
    work.plain_count[0] = system.cable.element_count
    return work


def first_phases(bodies: int) -> FloatArray:
    """Initial vortex-shedding phases (bodies,) in rad, far apart for neighbouring bodies."""
    return 2.0 * np.pi * (0.6180339887498949 * np.arange(bodies, dtype=np.float64) % 1.0)


def turns_of(dim: int) -> int:
    """Number of rotation angles of a body: 1 in a plane, 3 in space."""
    return 1 if dim == 2 else 3


@kernel
def copy_state(source, target):
    """Copy every array of the state `source` into the state `target`."""
    copy_array(source.memory, target.memory)
