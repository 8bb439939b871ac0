"""Parameters and state of a bundle: ropes side by side, what hangs between them, and what pushes from below."""

from __future__ import annotations

from typing import Annotated, Any, NamedTuple

import numpy as np

from cable_twin.mechanics.language.addresses import record_at
from cable_twin.mechanics.language.by_reference import by_reference
from cable_twin.mechanics.language.compilation import inlined_kernel, kernel
from cable_twin.mechanics.language.ranges import Range, ranges_of
from cable_twin.mechanics.parameters import FREE, SPEED, FloatArray, IntArray
from cable_twin.mechanics.state import PLACE, Course, Motion, copy_state

# Columns of `Bundle.records`: parameters, motion and scratch of a rope, its motion at the last good step and at the
# start of the present part of a step, and the forces in its sections.
SYSTEM, STATE, WORK, GOOD, BEFORE, SECTIONS = range(6)
FIXED, COUNTERWEIGHT, HYDRAULIC = range(3)  # Bullwheels.tensioning

FLAG, SIGN = Range(0, 1), Range(-1, 1)
LONGEST_GAP = 0.2  # m, of a clamp, that an iteration closes: of what is longer, more is left to the next ones


@by_reference
class Connectors(NamedTuple):
    """Massless rods between nodes of two ropes: droppers, slack carriers. They pull; few push."""

    rope: IntArray  # (connectors, 2)
    node: IntArray  # (connectors, 2)
    length: FloatArray  # (connectors,) m, unstrained
    stiffness: FloatArray  # (connectors,) N/m, when longer than that
    compression: FloatArray  # (connectors,) N/m, when shorter
    damping: FloatArray  # (connectors,) N s/m, while it pulls


@by_reference
class Pantographs(NamedTuple):
    """Masses on springs that push a rope from below, one-sided, and move along the track at a given speed.

    Stage 0 is the head; below each stage is its spring, that of the last one stands on the vehicle.
    """

    rope: IntArray  # (pantographs,)
    mass: FloatArray  # (pantographs, stages) kg; weight is balanced
    stiffness: FloatArray  # (pantographs, stages) N/m, below the stage
    damping: FloatArray  # (pantographs, stages) N s/m, beside it
    base_force: FloatArray  # (pantographs,) N, upwards on the last stage at height 0
    contact_stiffness: FloatArray  # (pantographs,) N/m, of head and rope


@by_reference
class Clamps(NamedTuple):
    """Carriages of one rope that are clamped to another one; each may come to several, onto one after the other."""

    rope: IntArray  # (clamps,) on which the carriage slides
    carriage: IntArray  # (clamps,) its number there
    offset: FloatArray  # (clamps, dim) m, of the clamp from the joint of the carriage
    choice_offset: IntArray  # (clamps + 1,) the ropes to which clamp c may come are rows choice_offset[c] and on
    choice: IntArray  # (choices,) rope
    place: FloatArray  # (choices,) m, unstrained arc length on it when none of that rope has gone by yet
    loop_length: (
        FloatArray  # (clamps,) m, of one that rides round the loop of its rope and slides where that goes; else 0
    )


@by_reference
class Wires(NamedTuple):
    """Damping of ropes as a share of their mass and of the stiffness that their tension gives them."""

    by_mass: FloatArray  # (ropes,) 1/s
    by_stiffness: FloatArray  # (ropes,) s
    tension: FloatArray  # (ropes,) N, for that stiffness
    present: bool  # whether any of them is not 0


@by_reference
class Bullwheels(NamedTuple):
    """Bullwheels, each between the end of one strand and the start of another one or of the same."""

    rope: IntArray  # (wheels, 2): whose end runs onto it, and whose start runs off it
    inertia: FloatArray  # (wheels,) kg, of all that turns with it, reduced to its rim
    wrapped: FloatArray  # (wheels,) kg, rope on it
    adhesion: FloatArray  # (wheels,) -, highest ratio of their tensions, exp(μ α)
    resistance: FloatArray  # (wheels,) N at its rim, of its bearings
    driven: IntArray  # (wheels,) 1 where there is a drive
    way: FloatArray  # (wheels, 2) m, of rope gone by, least and most, within which the drive stops; -inf, inf of none
    acceleration_limit: FloatArray  # (wheels,) m/s², of the drive
    emergency_deceleration: FloatArray  # (wheels,) m/s², of the drive in an emergency stop
    jerk_limit: FloatArray  # (wheels,) m/s³, inf where there is none
    brake_force: FloatArray  # (wheels,) N at its rim, of what an emergency stop applies instead, 0 of none
    brake_rise_time: FloatArray  # (wheels,) s, from release to full force
    rollback: FloatArray  # (wheels,) m, that the rim may go back before it is stopped, inf without a watch
    tensioning: IntArray  # (wheels,) FIXED, COUNTERWEIGHT or HYDRAULIC
    direction: FloatArray  # (wheels, dim) unit vector in which it is pulled; 0 where FIXED
    mass: FloatArray  # (wheels,) kg, that moves along that
    pull: FloatArray  # (wheels,) N, of the counterweight, or that the cylinder keeps
    band: FloatArray  # (wheels,) N, by which that may be off before the cylinder moves
    rate: FloatArray  # (wheels,) m/s, of the cylinder
    travel: FloatArray  # (wheels, 2) m, least and most
    buffer_stiffness: FloatArray  # (wheels,) N/m, at both limits
    buffer_damping: FloatArray  # (wheels,) s/m, of the buffer force, per unit of its elastic part


@by_reference
class Order(NamedTuple):
    """In which order the nodes of all ropes are eliminated, and when each connector has both its nodes at the front."""

    rope: IntArray  # (nodes of all,)
    node: IntArray  # (nodes of all,)
    connector_at: IntArray  # (connectors,) nodes that are gone before; rising
    number: IntArray  # (nodes of all,) when each of them is, rope after rope
    first: IntArray  # (ropes,) of each rope in `number`
    joined: IntArray  # (ropes,) 1 where its nodes are among them: something holds it to another rope within a step


@by_reference
class Bundle(NamedTuple):
    """Everything that does not change while a bundle runs."""

    records: IntArray  # (ropes, 6) addresses of what each rope has, columns as named above
    coupled: bool  # whether there is anything of what follows: known to kernels, where there is not
    up: FloatArray  # (dim,) unit vector
    connectors: Connectors
    pantographs: Pantographs
    clamps: Clamps
    wires: Wires
    order: Order
    sheaves: Bullwheels  # as the section of a scenario is called


@by_reference
class BullwheelMotion(NamedTuple):
    """Motion of the bullwheels, and what their drives were told."""

    rim: Motion  # (wheels,) m, of unstrained rope
    rope: Motion  # (wheels,) m, unstrained, that has gone over it
    carriage: Motion  # (wheels,) m, in the direction in which it tensions
    given: FloatArray  # (wheels,) N on the rim in this step, of drive, bearings and brake
    by_forces: Annotated[
        IntArray, Range(0, 2)
    ]  # (wheels,) what moves by its forces in this step: nothing, the rope alone, or the wheel
    tension: FloatArray  # (wheels, 2) N, of the strand that comes to it and of that which leaves it
    stretch: FloatArray  # (wheels,) -, length of the rope on it over that without strain
    traction: FloatArray  # (wheels,) N, of the rim on the rope, by the unstrained rope that goes over it
    pull: FloatArray  # (wheels,) N, of both strands against the direction in which it tensions
    slipping: Annotated[IntArray, SIGN]  # (wheels,) 1 while it slips on a rim that is faster, -1 on one that is slower
    mode: Annotated[IntArray, Range(FREE, SPEED)]  # (wheels,) FREE, FORCE or SPEED, of the drive
    target: FloatArray  # (wheels,) m/s
    force: FloatArray  # (wheels,) N at the rim, in FORCE
    braking: Annotated[IntArray, FLAG]  # (wheels,) 1 in an emergency stop
    braking_time: FloatArray  # (wheels,) s, since then
    sense: Annotated[IntArray, SIGN]  # (wheels,) 1 or -1, in which its drive turned it last, 0 before
    furthest: FloatArray  # (wheels,) m, of its rim in that sense
    rolled_back: Annotated[IntArray, FLAG]  # (wheels,) 1 where it has gone back too far, until the release


@by_reference
class BundleState(NamedTuple):
    """Motion of what is on no rope alone."""

    stages: Motion  # (pantographs, stages) m, height
    place: Course  # (pantographs,) m, along the track
    arc_length: Annotated[FloatArray, PLACE]  # (pantographs,) m, of the rope above the head
    contact_force: FloatArray  # (pantographs,) N
    clamp_rope: Annotated[IntArray, Range(-1, "last rope")]  # (clamps,) to which it holds now, -1 to none
    clamp_place: Annotated[FloatArray, PLACE]  # (clamps,) m, arc length there
    clamp_slack: FloatArray  # (clamps, dim) m, what is left of the gap at which it took hold under way
    clamp_taken: FloatArray  # (clamps, 2, dim) m and m/s, that gap and its rate
    clamp_time: FloatArray  # (clamps,) s, since then
    rail_mass: FloatArray  # (clamps,) kg, of its carriage on the rails of a station
    tight: Annotated[IntArray, FLAG]  # (connectors + pantographs,) 1 where it pulled or touched at the last look
    sheaves: BullwheelMotion  # so called in files of snapshots, as the section of a scenario is


@inlined_kernel
def rope_of(bundle, rope, system, state, work):
    """Parameters, motion and scratch of one rope; `system`, `state`, `work` are those of any, for their types."""
    own = bundle.records[rope]
    return record_at(own[SYSTEM], system), record_at(own[STATE], state), record_at(own[WORK], work)


@kernel
def copy_ropes(bundle, source, target, state):
    """Copy the states of all ropes from one column of records to another."""
    for rope in range(bundle.records.shape[0]):
        copy_state(record_at(bundle.records[rope, source], state), record_at(bundle.records[rope, target], state))


BUNDLE_RANGES = ranges_of(BundleState)  # of the arrays, as `fields_of` names them


@by_reference
class BundleWork(NamedTuple):
    """Scratch of the solver; contents have no meaning between steps."""

    fill: FloatArray  # (members, members, 2, 2, dim²): of the front, each against each; ropes, then clamps
    linked: IntArray  # (members, members) 1 where there is any
    side: FloatArray  # (eliminated, members, 2, 2, dim²): what was eliminated by each member of the front
    used: IntArray  # (eliminated, members) 1 where there is any
    front: IntArray  # (ropes,) node of each rope, then (clamps,) clamp at each further place of the front, or -1
    width: IntArray  # (1,) members that have been used so far
    sequence: IntArray  # (eliminated,) what was: the number of a node, or -1 - clamp
    touch: IntArray  # (nodes of all + 4 clamps,) first of the clamps' nodes at each node, then the one after each
    member: IntArray  # (clamps,) place of each at the front
    nodes_left: IntArray  # (clamps,) of its four, that are still to be eliminated
    clamp_node: IntArray  # (clamps, 4) of both elements, among those of all ropes; -1 where it does not hold
    closing: FloatArray  # (1,) m, largest gap of a clamp that an iteration closes whole
    clamp_diagonal: FloatArray  # (clamps, 2, 2, dim²): force and sliding coordinate by themselves
    clamp_right: FloatArray  # (clamps, 2, dim), then their increments
    clamp_out: FloatArray  # (clamps, 4, 2, 2, dim²): nodes of both elements by them
    clamp_in: FloatArray  # (clamps, 4, 2, 2, dim²): them by the nodes
    cross: FloatArray  # (connectors, dim²) N/m: either node by the other
    elimination: FloatArray  # (pantographs, stages, 3): matrix row, and what stands right of it
    increment: FloatArray  # (pantographs, stages) m
    by_rope: FloatArray  # (pantographs, stages) -, of each stage by the rope above the head
    wheel_increment: FloatArray  # (wheels, 2) m, the last of this step: of the rope over it, and of its carriage
    wheel_stiffness: FloatArray  # (wheels, 2) N/m, measured in this step against the same, 0 where it was not needed


def allocate_bundle_state(bundle: Bundle) -> BundleState:
    """State of zeros."""
    shape = bundle.pantographs.mass.shape
    count, clamps = shape[0], bundle.clamps.rope.size
    return BundleState(
        stages=Motion(*(np.zeros(shape) for _ in Motion._fields)),
        place=Course(*(np.zeros(count) for _ in Course._fields)),
        arc_length=np.zeros(count),
        contact_force=np.zeros(count),
        clamp_rope=np.full(clamps, -1, np.int64),
        clamp_place=np.zeros(clamps),
        clamp_slack=np.zeros(bundle.clamps.offset.shape),
        clamp_taken=np.zeros((clamps, 2, bundle.up.size)),
        clamp_time=np.zeros(clamps),
        rail_mass=np.zeros(clamps),
        tight=np.zeros(bundle.connectors.length.size + count, np.int64),
        sheaves=bullwheels_at_rest(bundle.sheaves.inertia.size),
    )


def bullwheels_at_rest(count: int) -> BullwheelMotion:
    """Motion of `count` bullwheels that nothing has moved yet."""
    return BullwheelMotion(
        rim=Motion(*(np.zeros(count) for _ in Motion._fields)),
        rope=Motion(*(np.zeros(count) for _ in Motion._fields)),
        carriage=Motion(*(np.zeros(count) for _ in Motion._fields)),
        given=np.zeros(count),
        by_forces=np.zeros(count, np.int64),
        tension=np.zeros((count, 2)),
        stretch=np.ones(count),
        traction=np.zeros(count),
        pull=np.zeros(count),
        slipping=np.zeros(count, np.int64),
        mode=np.full(count, FREE, np.int64),
        target=np.zeros(count),
        force=np.zeros(count),
        braking=np.zeros(count, np.int64),
        braking_time=np.zeros(count),
        sense=np.zeros(count, np.int64),
        furthest=np.zeros(count),
        rolled_back=np.zeros(count, np.int64),
    )


def clone_bundle_state(moving: BundleState) -> BundleState:
    """Independent copy."""
    return _clone(moving)  # type: ignore[no-any-return]


def _clone(record: Any) -> Any:
    return type(record)(*(_clone(field) if isinstance(field, tuple) else field.copy() for field in record))


def allocate_bundle_work(bundle: Bundle) -> BundleWork:
    """Scratch of the size of a bundle."""
    ropes, dim = bundle.records.shape[0], bundle.up.size
    nodes, connectors, shape = bundle.order.node.size, bundle.connectors.length.size, bundle.pantographs.mass.shape
    clamps = bundle.clamps.rope.size
    members, eliminated, block = ropes + clamps, nodes + clamps, (2, 2, dim * dim)
    return BundleWork(
        fill=np.zeros((members, members, *block)),
        linked=np.zeros((members, members), np.int64),
        side=np.zeros((eliminated, members, *block)),
        used=np.zeros((eliminated, members), np.int64),
        front=np.zeros(members, np.int64),
        width=np.zeros(1, np.int64),
        sequence=np.zeros(eliminated, np.int64),
        touch=np.zeros(nodes + 4 * clamps, np.int64),
        member=np.zeros(clamps, np.int64),
        nodes_left=np.zeros(clamps, np.int64),
        clamp_node=np.full((clamps, 4), -1, np.int64),
        closing=np.full(1, LONGEST_GAP),
        clamp_diagonal=np.zeros((clamps, *block)),
        clamp_right=np.zeros((clamps, 2, dim)),
        clamp_out=np.zeros((clamps, 4, *block)),
        clamp_in=np.zeros((clamps, 4, *block)),
        cross=np.zeros((connectors, dim * dim)),
        elimination=np.zeros((*shape, 3)),
        increment=np.zeros(shape),
        by_rope=np.zeros(shape),
        wheel_increment=np.zeros((bundle.sheaves.inertia.size, 2)),
        wheel_stiffness=np.zeros((bundle.sheaves.inertia.size, 2)),
    )
