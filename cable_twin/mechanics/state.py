"""What changes while the twin runs, and the scratch space of the solver: arrays only, so that kernels work in place."""

from __future__ import annotations

from collections.abc import Mapping
from math import inf
from typing import Annotated, Any, NamedTuple, get_type_hints

import numpy as np
from numpy.typing import NDArray

from cable_twin.mechanics.language.by_reference import by_reference
from cable_twin.mechanics.language.compilation import kernel
from cable_twin.mechanics.language.lanes import WIDTH
from cable_twin.mechanics.language.memory import copy_record
from cable_twin.mechanics.language.ranges import ANY, CLOCK, Range, ranges_of
from cable_twin.mechanics.parameters import (
    FREE,
    GUSTS,
    HAULED,
    IN_GROOVE,
    LIFTED,
    SPEED,
    FloatArray,
    IntArray,
    System,
)

SHARE = Range(-1.0 - 1e-9, 1.0 + 1e-9)  # and what rounding adds
PLACE = Range("before the rope", "beyond the rope")  # m
NOT_NEGATIVE = Range(0.0, ANY.most)


@by_reference
class Motion(NamedTuple):
    """Coordinates of one kind and their rates, in arrays of one shape; units m or rad, and per second."""

    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray  # the true one
    algorithmic: FloatArray  # auxiliary acceleration of generalized-alpha, a weighted mean over a step of true ones


@by_reference
class Course(NamedTuple):
    """What a drive asks for, or a rope has taken as it was asked."""

    position: FloatArray  # m
    velocity: FloatArray  # m/s
    acceleration: FloatArray  # m/s²


@by_reference
class WindField(NamedTuple):
    """The wind where it acts, in this step, and what it goes on from."""

    time: FloatArray  # (1,) s, since the start or the last reset
    way: FloatArray  # (1,) m of wind gone by, at its mean speed
    gust: Annotated[
        FloatArray, ANY, ANY, ANY, ANY, ANY, Range(0, len(GUSTS) - 1)
    ]  # (6,) the last one that was commanded, as in `Wind.gusts`
    points: FloatArray  # (points, 3) m/s, turbulence in x, y, z at the points of `Wind`
    along_rope: FloatArray  # (dim, elements, rounded up to `WIDTH`) m/s, in the middle of each element
    at_bodies: FloatArray  # (bodies, dim) m/s, at each centre of mass
    shedding_phase: FloatArray  # (bodies,) rad, of the eddies that each sheds
    shedding_force: FloatArray  # (bodies, dim) N, of them


@by_reference
class State(NamedTuple):
    """Motion of the whole system at one time, and what its drives were told."""

    nodes: Motion  # e, (nodes, 2, dim): r in m, r_x (-)
    bodies: Motion  # r, (bodies, 3): x, z in m, pitch in rad; in space (bodies, 7): x, y, z, and x, y, z, w of a unit
    # quaternion, rates (bodies, 6) in m/s and, about the axes of the world, rad/s
    joints: Motion  # n, (carriages,) m, arc length on the whole cable; without inertia, so the true acceleration is
    # known only to Runge-Kutta
    sheaves: Motion  # (carriages,) m, rope that the drive sheave of each haul rope has hauled; no bullwheels of a loop
    hauled: Motion  # (carriages,) m, what each haul rope pulls: its way in space along the track rope
    joint_element: Annotated[IntArray, Range(0, "last element")]  # (carriages,) element on which the joint is
    friction_deflection: Annotated[
        FloatArray, SHARE
    ]  # (carriages,) -, share -1..1 of the rolling friction that is mobilised
    friction_origin: FloatArray  # (carriages,) m, arc length at which that was so: the start of the step
    multipliers: FloatArray  # lambda, (bodies, dim) N on each body at its upper pivot; first of a chain: sliding joint
    moments: FloatArray  # (bodies, turns) N m on each body, of what its joint holds; none in a plane
    clamp_holds: NDArray[np.bool_]  # (carriages,) by a clamp to another rope now
    clamp_force: FloatArray  # (carriages, dim) N of that rope on the carriage
    attached: NDArray[np.bool_]  # (carriages,) on the cable; only what is clamped to a moving one ever is not
    payload: Annotated[FloatArray, NOT_NEGATIVE]  # (carriages,) kg, already in the masses of the system
    drive_mode: Annotated[IntArray, Range(FREE, HAULED)]  # (carriages,) FREE, FORCE, SPEED, or HAULED
    sheave_mode: Annotated[
        IntArray, Range(FREE, SPEED)
    ]  # (carriages,) FREE, FORCE or SPEED of the drive sheave where HAULED
    drive_force: FloatArray  # (carriages,) N along the cable, given or (SPEED) the multiplier of the driven joint
    drive_target: FloatArray  # (carriages,) N in FORCE, m/s in SPEED
    drive_braking: NDArray[np.bool_]  # (carriages,) an emergency stop is in force
    braking_time: FloatArray  # (carriages,) s, since then
    reference: Course  # (carriages,) what a driven joint or sheave follows
    rope: Course  # (2,) rope that has gone by at start and end of the mesh, towards the end
    surplus: FloatArray  # (1,) m, by which the rope on the mesh was longer than that before any had gone by
    loop_start: FloatArray  # (1,) m, place on the loop of the start of the mesh then
    rope_target: FloatArray  # (1,) m/s
    rope_braking: NDArray[np.bool_]  # (1,) the emergency deceleration is in force
    kink_length: FloatArray  # (elements,) m, rope of each that sharp kinks take in this step (`solution.kinks`)
    slackness: FloatArray  # (1,) -, mean tension of the rope at rest over that in this step, where kinks are sharp
    contact_arc_length: Annotated[
        FloatArray, PLACE
    ]  # (contacts,) m, place of the rope nearest to each contact of the towers
    contact_deflection: Annotated[FloatArray, SHARE]  # (contacts,) -, share -1..1 of its friction that is mobilised
    contact_origin: FloatArray  # (contacts,) m, arc length less `rope` at which that was so: the start of the step
    tower_load: FloatArray  # (towers, 2) N, sum of normal forces at the end of the last step, and the least of them
    tower_lateral: FloatArray  # (towers, 2) in space: N to the left of the track that a tower gives the rope in its
    # grooves, at the end of the last step, and the highest ratio (-) of its size to the normal force, else NO_RATIO
    derailment: Annotated[
        IntArray, Range(IN_GROOVE, LIFTED), CLOCK
    ]  # (towers, 2) in space: IN_GROOVE or how the rope came out, and the clock at that
    push: FloatArray  # (carriages, 4) N with which each and those after it on the rope push each other, at the end of
    # the last step, and the highest since the start or the last reset; m/s at which they close in; clock of contact
    touch: Annotated[
        FloatArray, Range(0, "vehicles"), ANY, ANY, ANY
    ]  # (carriages, 4) 1 + number of the one after it that it has met last, or 0; m, its place on the
    # cable there; m/s at which they met; the clock at that
    wind: FloatArray  # (dim,) m/s, its mean at the reference height
    wind_field: WindField
    newton_curvature: Annotated[
        FloatArray, Range(0.0, inf)
    ]  # (1,) 1/m, Newton increment over the square of the one before; 0: not known
    clock: Annotated[IntArray, CLOCK]  # (1,) whole solver steps since the start


RECORDS: dict[str, Any] = {name: kind for name, kind in get_type_hints(State).items() if hasattr(kind, "_fields")}
RANGES = ranges_of(State)  # of the arrays, as `fields_of` names them
FIELDS = tuple(RANGES)


@by_reference
class Workspace(NamedTuple):
    """Residual, tangent and what elimination leaves behind; contents have no meaning between steps."""

    diagonal: FloatArray  # (nodes, 2, 2, dim²): matrices of r and r_x against r and r_x
    upper: FloatArray  # (nodes - 1, 2, 2, dim²), couples node k to k + 1
    lower: FloatArray  # (nodes - 1, 2, 2, dim²), couples node k + 1 to k
    group: FloatArray  # (4 dim + 16 dim², WIDTH), residual and tangent of a group of elements, as in `groups`
    right_side: FloatArray  # (nodes, 2, dim), minus the residual; after the solution the increment of e
    joint_gap: FloatArray  # (bodies, dim) m (or m/s² at acceleration level): what each joint has to close
    held_gap: FloatArray  # (bodies, 2) -, cosines of the angles that joints in space hold at right ones
    body_increment: FloatArray  # (bodies, dim + turns)
    turned: FloatArray  # (bodies, turns) rad, rotation vector of the step so far, by which an integrator reckons
    turn_by_place: FloatArray  # (bodies, turns dim) minus the turn of a body, by the place of its upper pivot
    turn_by_above: FloatArray  # (bodies, turns²) the same by the turn of what is above
    turn_right: FloatArray  # (bodies, turns)
    impedance: FloatArray  # (bodies, dim²) D of the chain from this body down: force by place
    impedance_turning: FloatArray  # (bodies, dim turns) D of the same: force by turn of what is above
    impedance_moment: FloatArray  # (bodies, turns dim) D of the same: moment by place
    impedance_turn: FloatArray  # (bodies, turns²) D of the same: moment by turn
    impedance_force: FloatArray  # (bodies, dim + turns) b of the same: Δ(λ, m) = D Δ(p, θ) + b
    held_by_place: FloatArray  # (bodies, turns dim) increment of the moment that holds in space, by the place
    held_by_above: FloatArray  # (bodies, turns²)
    held_right: FloatArray  # (bodies, turns)
    pivot_by_joint: FloatArray  # (carriages, dim²) A of `seen_carriage`: place of the pivot by that of the joint
    pivot_by_turn: FloatArray  # (carriages, dim turns) B of it: by the turn of the cable
    pivot_right: FloatArray  # (carriages, dim) m, a of it
    joint_along: FloatArray  # (carriages, dim) unit tangent of the cable, across which a joint yields in this step
    joint_by_s: FloatArray  # (carriages, dim) r_x - ∂δ/∂s: place of the pivot by the arc length
    grip_row: FloatArray  # (carriages, 4, turns dim) turn of the cable as the hinge sees it, by the nodal coordinates
    grip_by_s: FloatArray  # (carriages, turns) rad/m, the same by the arc length
    sliding_pivot: FloatArray  # (carriages,) eliminated row of the sliding coordinate
    sliding_row: FloatArray  # (carriages, 4, dim)
    sliding_column: FloatArray  # (carriages, 4, dim) forces on the nodes by the sliding coordinate
    sliding_along: FloatArray  # (carriages, dim) minus its row by a force on the joint beside the cable
    sliding_right: FloatArray  # (carriages,)
    sliding_increment: FloatArray  # (carriages,)
    saturation: FloatArray  # (carriages,) N, what a drive at its force limit gives in this step, else 0
    driven: NDArray[np.bool_]  # (carriages,) the joint follows a reference
    given_force: FloatArray  # (carriages,) N along the cable
    haul_direction: FloatArray  # (carriages, dim) of each haul rope in this step: its way by the place of the joint
    haul_place: FloatArray  # (carriages, dim) m, of the joint at the start of the step
    haul_origin: FloatArray  # (carriages,) m, way less direction times place
    haul_gap: FloatArray  # (carriages,) m, way at the place of the joint less that of the state
    haul_force: FloatArray  # (carriages,) N on the way
    haul_by_way: FloatArray  # (carriages,) N/m, its derivative by the way, the sheave eliminated
    haul_change: FloatArray  # (carriages,) N, its increment where the joint stands
    haul_increment: FloatArray  # (carriages,)
    sheave_row: FloatArray  # (carriages, 3) eliminated row of the sheave: pivot, coefficient of the way, right side
    sheave_increment: FloatArray  # (carriages,)
    pressed: NDArray[np.bool_]  # (carriages,) others push it
    pressed_stiffness: FloatArray  # (entries,) N/m, tangent of the buffers of each pair
    foreseen: FloatArray  # (carriages, 3) where others push it: N/m and N of its own way along the rope, and that in m
    body_drag: FloatArray  # (bodies, dim) N, of the air
    body_drag_tangent: FloatArray  # (bodies, dim²) N/m, minus its derivative by the place
    body_drag_turning: FloatArray  # (bodies, dim turns) N/rad, minus its derivative by the turn


def allocate_state(system: System) -> State:
    """State of zeros with every joint at rest; `equilibrium` fills it."""
    nodes, dim = system.cable.element_count + 1, len(system.cable.gravity)
    turns = turns_of(dim)
    bodies, carriages = system.carriages.mass.size, system.carriages.fixed.size
    contacts = system.towers.stiffness.size
    modes = np.where(system.haul_ropes.axial_stiffness > 0.0, HAULED, FREE)
    modes = np.where(system.carriages.fixed | system.carriages.clamped, SPEED, modes).astype(np.int64)
    return State(
        nodes=_at_rest((nodes, 2, dim)),
        bodies=_bodies_at_rest(bodies, dim),
        joints=_at_rest((carriages,)),
        sheaves=_at_rest((carriages,)),
        hauled=_at_rest((carriages,)),
        joint_element=np.zeros(carriages, dtype=np.int64),
        friction_deflection=np.zeros(carriages),
        friction_origin=np.zeros(carriages),
        multipliers=np.zeros((bodies, dim)),
        moments=np.zeros((bodies, turns)),
        clamp_holds=np.zeros(carriages, dtype=np.bool_),
        clamp_force=np.zeros((carriages, dim)),
        attached=np.ones(carriages, dtype=np.bool_),
        payload=np.zeros(carriages),
        drive_mode=modes,
        sheave_mode=np.full(carriages, FREE, dtype=np.int64),
        drive_force=np.zeros(carriages),
        drive_target=np.zeros(carriages),
        drive_braking=np.zeros(carriages, dtype=np.bool_),
        braking_time=np.zeros(carriages),
        reference=Course(*(np.zeros(carriages) for _ in Course._fields)),
        rope=Course(*(np.zeros(2) for _ in Course._fields)),
        surplus=np.zeros(1),
        loop_start=np.zeros(1),
        rope_target=np.zeros(1),
        rope_braking=np.zeros(1, dtype=np.bool_),
        kink_length=np.zeros(nodes - 1),
        slackness=np.ones(1),
        contact_arc_length=np.zeros(contacts),
        contact_deflection=np.zeros(contacts),
        contact_origin=np.zeros(contacts),
        tower_load=np.zeros((system.towers.top.shape[0], 2)),
        tower_lateral=np.zeros((system.towers.top.shape[0], 2)),
        derailment=np.zeros((system.towers.top.shape[0], 2), dtype=np.int64),
        push=np.zeros((carriages, 4)),
        touch=np.zeros((carriages, 4)),
        wind=np.zeros(dim),
        wind_field=_calm(system, dim),
        newton_curvature=np.zeros(1),
        clock=np.zeros(1, dtype=np.int64),
    )


def _at_rest(shape: tuple[int, ...]) -> Motion:
    return Motion(*(np.zeros(shape) for _ in Motion._fields))


def _bodies_at_rest(bodies: int, dim: int) -> Motion:
    motion = _at_rest((bodies, dim + turns_of(dim)))
    if dim == 2:
        return motion
    upright = np.zeros((bodies, 7))
    upright[:, 6] = 1.0
    return motion._replace(position=upright)


def _calm(system: System, dim: int) -> WindField:
    bodies = system.carriages.mass.size
    return WindField(
        time=np.zeros(1),
        way=np.zeros(1),
        gust=np.zeros(6),
        points=np.zeros(system.air.wind.points.shape),
        along_rope=np.zeros((dim, -(-system.cable.element_count // WIDTH) * WIDTH)),
        at_bodies=np.zeros((bodies, dim)),
        shedding_phase=first_phases(bodies),
        shedding_force=np.zeros((bodies, dim)),
    )


def first_phases(bodies: int) -> FloatArray:
    """Phases (bodies,) in rad of the eddies at the start: those of neighbours are far from each other."""
    return 2.0 * np.pi * (0.6180339887498949 * np.arange(bodies, dtype=np.float64) % 1.0)


def turns_of(dim: int) -> int:
    """How many angles a body has."""
    return 1 if dim == 2 else 3


def allocate_workspace(system: System) -> Workspace:
    """Scratch space of the size of `system`."""
    nodes, dim = system.cable.element_count + 1, len(system.cable.gravity)
    turns = turns_of(dim)
    bodies, carriages = system.carriages.mass.size, system.carriages.fixed.size
    return Workspace(
        diagonal=np.zeros((nodes, 2, 2, dim * dim)),
        upper=np.zeros((nodes - 1, 2, 2, dim * dim)),
        lower=np.zeros((nodes - 1, 2, 2, dim * dim)),
        group=np.zeros((4 * dim + 16 * dim * dim, WIDTH)),
        right_side=np.zeros((nodes, 2, dim)),
        joint_gap=np.zeros((bodies, dim)),
        held_gap=np.zeros((bodies, 2)),
        body_increment=np.zeros((bodies, dim + turns)),
        turned=np.zeros((bodies, turns)),
        turn_by_place=np.zeros((bodies, turns * dim)),
        turn_by_above=np.zeros((bodies, turns * turns)),
        turn_right=np.zeros((bodies, turns)),
        impedance=np.zeros((bodies, dim * dim)),
        impedance_turning=np.zeros((bodies, dim * turns)),
        impedance_moment=np.zeros((bodies, turns * dim)),
        impedance_turn=np.zeros((bodies, turns * turns)),
        impedance_force=np.zeros((bodies, dim + turns)),
        held_by_place=np.zeros((bodies, turns * dim)),
        held_by_above=np.zeros((bodies, turns * turns)),
        held_right=np.zeros((bodies, turns)),
        pivot_by_joint=np.zeros((carriages, dim * dim)),
        pivot_by_turn=np.zeros((carriages, dim * turns)),
        pivot_right=np.zeros((carriages, dim)),
        joint_along=np.zeros((carriages, dim)),
        joint_by_s=np.zeros((carriages, dim)),
        grip_row=np.zeros((carriages, 4, turns * dim)),
        grip_by_s=np.zeros((carriages, turns)),
        sliding_pivot=np.zeros(carriages),
        sliding_row=np.zeros((carriages, 4, dim)),
        sliding_column=np.zeros((carriages, 4, dim)),
        sliding_along=np.zeros((carriages, dim)),
        sliding_right=np.zeros(carriages),
        sliding_increment=np.zeros(carriages),
        saturation=np.zeros(carriages),
        driven=np.zeros(carriages, dtype=np.bool_),
        given_force=np.zeros(carriages),
        haul_direction=np.zeros((carriages, dim)),
        haul_place=np.zeros((carriages, dim)),
        haul_origin=np.zeros(carriages),
        haul_gap=np.zeros(carriages),
        haul_force=np.zeros(carriages),
        haul_change=np.zeros(carriages),
        haul_by_way=np.zeros(carriages),
        haul_increment=np.zeros(carriages),
        sheave_row=np.zeros((carriages, 3)),
        sheave_increment=np.zeros(carriages),
        pressed=np.zeros(carriages, dtype=np.bool_),
        pressed_stiffness=np.zeros(system.buffers.other.size),
        foreseen=np.zeros((carriages, 3)),
        body_drag=np.zeros((bodies, dim)),
        body_drag_tangent=np.zeros((bodies, dim * dim)),
        body_drag_turning=np.zeros((bodies, dim * turns)),
    )


def fields_of(record: Any, within: str = "") -> dict[str, NDArray[Any]]:
    """All arrays of a state by name, those of the records in it as in "nodes.position"."""
    found: dict[str, NDArray[Any]] = {}
    for name, field in zip(record._fields, record, strict=True):
        found |= fields_of(field, f"{within}{name}.") if isinstance(field, tuple) else {f"{within}{name}": field}
    return found


def state_of(fields: Mapping[str, NDArray[Any]]) -> State:
    """The state whose `fields_of` these are.

    Raises:
        KeyError: one is missing.
    """
    parts: dict[str, Any] = dict(fields)
    for name, kind in RECORDS.items():
        parts[name] = kind(*(fields[f"{name}.{field}"] for field in kind._fields))
    return State(*(parts[name] for name in State._fields))


def clone_state(state: State) -> State:
    """Independent copy."""
    return state_of({name: array.copy() for name, array in fields_of(state).items()})


def write_state(source: State, target: State) -> None:
    """Write every array of `source` into `target`, without a kernel."""
    for here, there in zip(fields_of(source).values(), fields_of(target).values(), strict=True):
        there[...] = here


@kernel
def copy_state(source, target):
    """Write every array of `source` into `target`."""
    copy_record(source, target)
