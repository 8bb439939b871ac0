"""Parameters and state of coupled ropes: ropes, connectors, clamps, pantographs and bullwheels."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from cable_twin.mechanics.language.addresses import record_at
from cable_twin.mechanics.language.by_reference import by_reference
from cable_twin.mechanics.language.compilation import inlined_kernel, kernel
from cable_twin.mechanics.language.declared import LATEST, Memory, Of, Range, allocate, ranges_of
from cable_twin.mechanics.language.memory import copy_array
from cable_twin.mechanics.language.simd import WIDTH
from cable_twin.mechanics.parameters import DriveLimits, FloatArray, IntArray
from cable_twin.mechanics.state import PLACE, Course, Drives, Motion, copy_state

# Columns of `Bundle.records`: parameters, motion and scratch of a rope, its motion at the last good step and at the
# start of the present part of a step, and the forces in its sections.
SYSTEM, STATE, WORK, GOOD, BEFORE, SECTIONS = range(6)
FIXED, COUNTERWEIGHT, HYDRAULIC = range(3)  # Bullwheels.tensioning

FLAG, SIGN, KEY = Range(0, 1), Range(-1, 1), Range(-1, LATEST)
SERVES = 20  # iterations for which the response of the ropes to their bullwheels serves, once found
LONGEST_GAP = 0.2  # m, of a clamp, that an iteration closes: of what is longer, more is left to the next ones


@by_reference
class Connectors(NamedTuple):
    """Massless rods between nodes of two ropes, such as droppers: tension, and compression by a given stiffness."""

    rope: IntArray  # (connectors, 2)
    node: IntArray  # (connectors, 2)
    length: FloatArray  # (connectors,) m, unstrained
    stiffness: FloatArray  # (connectors,) N/m, when longer than that
    compression: FloatArray  # (connectors,) N/m, when shorter
    damping: FloatArray  # (connectors,) N s/m, while it pulls
    rolls: IntArray  # (connectors,) 1 where the second end rolls along its rope


@by_reference
class Pantographs(NamedTuple):
    """Pantographs: masses on springs below a rope, in one-sided contact, moved along the track at a given speed.

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
    """Clamps of vehicles to a second rope; each may hold several ropes, one after another."""

    rope: IntArray  # (clamps,) on which the carriage slides
    carriage: IntArray  # (clamps,) its row among all vehicles
    offset: FloatArray  # (clamps, dim) m, of the clamp from the joint of the carriage
    choice_offset: IntArray  # (clamps + 1,) the ropes to which clamp c may come are rows choice_offset[c] and on
    choice: IntArray  # (choices,) rope
    place: FloatArray  # (choices,) m, unstrained arc length on it when none of that rope has gone by yet
    loop_length: (
        FloatArray  # (clamps,) m, of one that rides round the loop of its rope and slides where that goes; else 0
    )


@by_reference
class Wires(NamedTuple):
    """Rayleigh damping coefficients β of ropes, for damping by the geometric stiffness of given tensions."""

    by_stiffness: FloatArray  # (ropes,) s
    tension: FloatArray  # (ropes,) N, for that stiffness
    present: bool  # whether any of them is not 0


@by_reference
class Bullwheels(NamedTuple):
    """Bullwheels, each between the end of one strand and the start of another strand, or of its own."""

    rope: IntArray  # (wheels, 2): whose end runs onto it, and whose start runs off it
    inertia: FloatArray  # (wheels,) kg, of all that turns with it, reduced to its rim
    wrapped: FloatArray  # (wheels,) kg, rope on it
    adhesion: FloatArray  # (wheels,) -, highest ratio of their tensions, exp(μ α)
    resistance: FloatArray  # (wheels,) N at its rim, of its bearings
    driven: IntArray  # (wheels,) 1 where there is a drive
    way: FloatArray  # (wheels, 2) m, of rope gone by, least and most, within which the drive stops; -inf, inf of none
    limits: DriveLimits  # (wheels,) of the drive
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
    """Elimination order of the nodes of all ropes, and number of nodes eliminated before each connector is added."""

    rope: IntArray  # (nodes of all,)
    node: IntArray  # (nodes of all,)
    connector_at: IntArray  # (connectors,) nodes that are gone before; rising
    number: IntArray  # (nodes of all,) when each of them is, rope after rope
    first: IntArray  # (ropes,) of each rope in `number`
    joined: IntArray  # (ropes,) 1 where its nodes are among them: something holds it to another rope within a step
    line: IntArray  # (ropes,) number of the ropes that are held to each other


@by_reference
class Bundle(NamedTuple):
    """Constant parameters of coupled ropes."""

    records: IntArray  # (ropes, 6) addresses of what each rope has, columns as named above
    offset: IntArray  # (ropes + 1,) of the nodes of each rope among those of all
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
    """Motion of the bullwheels, and commands of their drives."""

    rim: Annotated[Motion, Of("wheel", unit="m")]  # of unstrained rope
    rope: Annotated[Motion, Of("wheel", unit="m")]  # unstrained, that has gone over it
    carriage: Annotated[Motion, Of("wheel", unit="m")]  # in the direction in which it tensions
    given: Annotated[FloatArray, Of("wheel", unit="N")]  # on the rim in this step, of drive, bearings and brake
    by_forces: Annotated[IntArray, Of("wheel"), Range(0, 2)]  # what moves by its forces in this step: nothing, the rope
    # alone, or the wheel
    tension: Annotated[
        FloatArray, Of("wheel", 2, unit="N")
    ]  # of the strand that comes to it, and of that which leaves it
    stretch: Annotated[FloatArray, Of("wheel", first=1.0)]  # length of the rope on it over that without strain
    traction: Annotated[FloatArray, Of("wheel", unit="N")]  # of the rim on the rope, by the unstrained rope over it
    pull: Annotated[FloatArray, Of("wheel", unit="N")]  # of both strands against the direction in which it tensions
    slipping: Annotated[
        IntArray, Of("wheel"), SIGN
    ]  # 1 while it slips on a rim that is faster, -1 on one that is slower
    drives: Annotated[Drives, Of("wheel")]  # force: at the rim
    sense: Annotated[IntArray, Of("wheel"), SIGN]  # 1 or -1, in which its drive turned it last, 0 before
    furthest: Annotated[FloatArray, Of("wheel", unit="m")]  # of its rim in that sense
    rolled_back: Annotated[IntArray, Of("wheel"), FLAG]  # 1 where it has gone back too far, until the release


@by_reference
class WheelResponse(NamedTuple):
    """Response of the ropes to their bullwheels, kept from step to step, with the conditions it was computed for."""

    left: Annotated[IntArray, Of("kept", 1), Range(0, SERVES)]  # iterations for which it may still serve
    mass_factor: Annotated[FloatArray, Of("kept", 1, unit="1/s²")]  # of the integrator
    inertia: Annotated[FloatArray, Of("kept", 1, unit="kg")]  # of all bodies
    active: Annotated[IntArray, Of("kept", "coordinate"), KEY]  # which coordinates are unknowns, and which ropes slip
    joints: Annotated[IntArray, Of("kept", "vehicle"), KEY]  # element of each vehicle, and how it is held there
    clamps: Annotated[IntArray, Of("kept", "clamp"), KEY]  # which element of a rope each holds
    wheels: Annotated[FloatArray, Of("kept", "coordinate", "coordinate")]  # of the equations of the wheels
    of_nodes: Annotated[
        FloatArray, Of("kept", "node", "wheel", 2, "dim²")
    ]  # minus the increments of nodes by rope over a wheel, column 0, and by its carriage, column 1
    of_clamps: Annotated[FloatArray, Of("kept", "clamp", "wheel", 2, "dim²")]  # the same of the clamps
    of_loads: Annotated[FloatArray, Of("kept", "vehicle", "patch", "wheel")]  # of loads at nodes, by rope over a wheel


@by_reference
class BundleState(NamedTuple):
    """Motion of bullwheels, clamps and pantographs, beside the states of the ropes."""

    stages: Annotated[Motion, Of("pantograph", "stage", unit="m")]  # height
    place: Annotated[Course, Of("pantograph", unit="m")]  # along the track
    arc_length: Annotated[FloatArray, Of("pantograph", unit="m"), PLACE]  # of the rope above the head
    contact_force: Annotated[FloatArray, Of("pantograph", unit="N")]
    clamp_rope: Annotated[IntArray, Of("clamp", first=-1), Range(-1, "last rope")]  # to which it holds now, -1 to none
    clamp_place: Annotated[FloatArray, Of("clamp", unit="m"), PLACE]  # arc length there
    clamp_slack: Annotated[FloatArray, Of("clamp", "dim", unit="m")]  # left of the gap at which it took hold under way
    clamp_taken: Annotated[FloatArray, Of("clamp", 2, "dim", unit="m, m/s")]  # that gap and its rate
    clamp_time: Annotated[FloatArray, Of("clamp", unit="s")]  # since then
    rail_mass: Annotated[FloatArray, Of("clamp", unit="kg")]  # of its carriage on the rails of a station
    tight: Annotated[IntArray, Of("contact"), FLAG]  # of connectors, then pantographs: 1 where it pulled or touched at
    # the last look
    sheaves: BullwheelMotion  # so called in files of snapshots, as the section of a scenario is
    response: WheelResponse  # last: a copy for the time of a step is without it
    memory: Memory  # all of these


@by_reference
class BundleWork(NamedTuple):
    """Workspace of the solver for couplings; contents have no meaning between steps."""

    fill: Annotated[
        FloatArray, Of("member", "member", 2, 2, "dim²")
    ]  # of the front, each against each; ropes, then clamps
    linked: Annotated[IntArray, Of("member", "member")]  # 1 where there is any
    side: Annotated[
        FloatArray, Of("eliminated", "member", 2, 2, "dim²")
    ]  # what was eliminated by each member of the front
    used: Annotated[IntArray, Of("eliminated", "member")]  # 1 where there is any
    width_then: Annotated[IntArray, Of("eliminated")]  # members that had been used at each elimination
    front: Annotated[IntArray, Of("member")]  # node of each rope, then clamp at each further place of the front, or -1
    width: Annotated[IntArray, Of(1)]  # members that have been used so far
    sequence: Annotated[IntArray, Of("eliminated")]  # what was: the number of a node, or -1 - clamp
    coupled_from: Annotated[IntArray, Of("rope")]  # first node of each rope that something holds to another one now
    coupled_to: Annotated[IntArray, Of("rope")]  # last of them; where there is none, both are a node in the middle
    next_kept: Annotated[
        IntArray, Of("ordered")
    ]  # of each node that something holds to another rope now, the next one of its rope, or itself; else -1
    kept: Annotated[IntArray, Of("ordered")]  # these nodes in order of elimination
    kept_count: Annotated[IntArray, Of(1)]  # how many they are; 0: not found yet
    noted: Annotated[IntArray, Of("clamp", 4)]  # `clamp_node` for which these are
    runs: Annotated[
        IntArray, Of(4, 3)
    ]  # kept nodes before and after each of four runs that are eliminated together, and that before among all ropes'
    run_rope: Annotated[IntArray, Of(4)]  # of each
    run_factors: Annotated[
        FloatArray, Of("beside", "lanes of two nodes")
    ]  # of nodes eliminated side by side: increments by the kept node before, and by the node after
    touch: Annotated[IntArray, Of("touch")]  # first of the clamps' nodes at each node, then the one after each
    member: Annotated[IntArray, Of("clamp")]  # place of each at the front
    nodes_left: Annotated[IntArray, Of("clamp")]  # of its four, that are still to be eliminated
    clamp_node: Annotated[
        IntArray, Of("clamp", 4, first=-1)
    ]  # of both elements, among those of all ropes; -1 where it does not hold
    closing: Annotated[
        FloatArray, Of(1, unit="m", first=LONGEST_GAP)
    ]  # largest gap of a clamp that an iteration closes whole
    clamp_diagonal: Annotated[FloatArray, Of("clamp", 2, 2, "dim²")]  # force and sliding coordinate by themselves
    clamp_right: Annotated[FloatArray, Of("clamp", 2, "dim")]  # then their increments
    clamp_out: Annotated[FloatArray, Of("clamp", 4, 2, 2, "dim²")]  # nodes of both elements by them
    clamp_in: Annotated[FloatArray, Of("clamp", 4, 2, 2, "dim²")]  # them by the nodes
    cross: Annotated[FloatArray, Of("connector", 2, 2, "dim²")]  # first end by r, r_x of the second; back
    elimination: Annotated[FloatArray, Of("pantograph", "stage", 3)]  # matrix row, and what stands right of it
    increment: Annotated[FloatArray, Of("pantograph", "stage")]  # m
    by_rope: Annotated[FloatArray, Of("pantograph", "stage")]  # of each stage by the rope above the head
    slot: Annotated[IntArray, Of("wheel", "rope")]  # of the columns of each wheel among those of a rope, or -1
    slots: Annotated[IntArray, Of("rope")]  # columns of each rope: of the wheels that its nodes feel in this iteration
    wheel_columns: Annotated[
        FloatArray, Of("node", "wheel", 2, "dim²")
    ]  # tangent of each node of all ropes by rope over a wheel, column 0, and by its carriage, column 1; then solutions
    clamp_columns: Annotated[FloatArray, Of("clamp", "wheel", 2, "dim²")]  # the same of the clamps
    patch_columns: Annotated[FloatArray, Of("vehicle", "patch", "wheel")]  # by rope over a wheel, of loads at nodes
    wheel_row: Annotated[
        FloatArray, Of("wheel", 2, 2, 3, "dim")
    ]  # of both strands: forces on rope over it and on its carriage, by slope of the end and both vectors beside that
    wheel_matrix: Annotated[FloatArray, Of("coordinate", "coordinate")]  # of the wheels by themselves: rope, carriage
    wheel_increment: Annotated[FloatArray, Of("coordinate", unit="m")]  # their right side, then their increments
    saturation: Annotated[FloatArray, Of("wheel", unit="N")]  # limit at which its drive is held in this step, or 0
    asked: Annotated[FloatArray, Of("wheel", unit="m/s²")]  # acceleration of its reference, before it was held
    lagging: Annotated[FloatArray, Of(1, unit="m")]  # what a kept response may leave of the last increment
    memory: Memory  # all of these


@inlined_kernel
def rope_of(bundle, rope, system, state, work):
    """Parameters, state and workspace of the rope of index `rope`; the other arguments, of any rope, give the types."""
    own = bundle.records[rope]
    return record_at(own[SYSTEM], system), record_at(own[STATE], state), record_at(own[WORK], work)


@kernel
def copy_ropes(bundle, source, target, state):
    """Copy the states of all ropes, which are in one block of memory, from one column of records to another."""
    copy_state(record_at(bundle.records[0, source], state), record_at(bundle.records[0, target], state))


@inlined_kernel
def copy_motion(moving, kept):
    """Copy the motion of couplings into `kept`, without the stored response of ropes to bullwheels."""
    copy_array(moving.memory[: kept.memory.size], kept.memory)


@inlined_kernel
def take_motion(kept, moving):
    """Restore the motion of couplings from a copy made by `copy_motion`."""
    copy_array(kept.memory, moving.memory[: kept.memory.size])


BUNDLE_RANGES = ranges_of(BundleState)  # of the arrays, as `arrays_of` names them


def sizes_of_bundle(bundle: Bundle) -> dict[str, int]:
    """Sizes of array dimensions by name, as "clamp" for the number of clamps, for the records of coupled ropes."""
    clamps, connectors, nodes = bundle.clamps.rope.size, bundle.connectors.length.size, bundle.order.node.size
    pantographs, stages = bundle.pantographs.mass.shape
    coupled = bool(connectors or clamps)  # by what is eliminated beside their nodes
    return {
        "wheel": bundle.sheaves.inertia.size,
        "pantograph": pantographs,
        "stage": stages,
        "clamp": clamps,
        "connector": connectors,
        "contact": connectors + pantographs,
        "member": (bundle.records.shape[0] if coupled else 0) + clamps,  # of the front: ropes, then clamps
        "eliminated": nodes + clamps,
        "ordered": nodes,
        "beside": int(bundle.offset[-1]) // 2 if coupled else 0,  # two nodes at least
        "lanes of two nodes": 2 * WIDTH * 4 * bundle.up.size**2,
        "touch": nodes + 4 * clamps,  # nodes, then those of the clamps
        "coordinate": 2 * bundle.sheaves.inertia.size,
        "rope": bundle.records.shape[0],
        "node": int(bundle.offset[-1]),  # of all ropes
        "dim": bundle.up.size,
        "dim²": bundle.up.size**2,
    }


def allocate_bundle_state(bundle: Bundle, vehicles: int = 0, patch: int = 0, kept: int = 1) -> BundleState:
    """Allocate the state of bullwheels, clamps and pantographs at rest; `kept` 0: without response to bullwheels.

    Of `vehicles` on the ropes those at a node have `patch` rows.
    """
    return allocate(BundleState, sizes_of_bundle(bundle) | {"vehicle": vehicles, "patch": patch, "kept": kept})


def bullwheels_at_rest(count: int) -> BullwheelMotion:
    """Allocate the motion of `count` bullwheels at rest."""
    return allocate(BullwheelMotion, {"wheel": count})


def allocate_bundle_work(bundle: Bundle, vehicles: int = 0, patch: int = 0) -> BundleWork:
    """Allocate the solver's workspace for couplings of several ropes.

    Args:
        bundle: of ropes.
        vehicles: number of vehicles that have a node of the mesh which follows them.
        patch: number of unknowns of the two elements beside such a node.
    """
    return allocate(BundleWork, sizes_of_bundle(bundle) | {"vehicle": vehicles, "patch": patch})
