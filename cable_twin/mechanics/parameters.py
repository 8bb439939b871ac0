"""Constant parameters of the mechanical system, as named tuples for compiled kernels.

`dim` is 2 in a plane and 3 in space; it is carried by the length of `Cable.gravity`, which the kernels know at compile
time, and so is the number of turns of a body, 1 or 3. Vectors are x along the track, y to its left, z up.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cable_twin.mechanics.language.by_reference import by_reference

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

ELASTIC_MODELS = ("continuum", "element_frame")  # by number
CONTINUUM = 0  # elastic_model: W = (EA strain^2 + EI curvature^2) / 2 on the arc itself
ELEMENT_FRAME = 1  # elastic_model: the paper's, strains in the frame of each element's chord

FREE = 0  # drive mode: nothing acts on the axis but friction and stops
FORCE = 1  # drive mode: a given force on the axis
SPEED = 2  # drive mode: the axis follows a reference position, its multiplier is the drive force
JOINT, DRUM = 0, 1  # axis of a vehicle's drive: its joint, or the drum of its haul rope, which pulls a free joint

ALONE = -1  # number of a rope by itself
INTEGRATORS = ("generalized_alpha", "runge_kutta")  # modules of `solution`

START, END = 0, 1  # stations of a track
IN_GROOVE, OUT_LEFT, OUT_RIGHT, LIFTED = 0, 1, 2, 3  # the rope on a tower in space, or derailed, by its side
NO_RATIO = -1.0  # of forces on a tower without contact so far
SERVICE, EMERGENCY, TRACK_ROPE = 0, 1, 2  # columns of brakes: two on the drum, one on the track rope


@by_reference
class Cable(NamedTuple):
    """Cable of uniform properties: stiffness, mass, supports and loads, with the element lengths of its mesh."""

    element_count: int
    element_length: FloatArray  # l, (elements,) m, unstrained
    node_arc_length: FloatArray  # (nodes,) m
    node_joined: NDArray[np.bool_]  # (nodes,) whether a connector to another rope is at the node
    cell_length: float  # m, of the even grid by which the element at an arc length is looked up
    cell_element: IntArray  # (cells,) element at the start of each cell
    unstrained_length: float  # L, m
    load_nodes: bool  # whether a node of the mesh follows every joint on the cable
    mass_per_length: float  # rho A, kg/m
    axial_stiffness: float  # EA, N
    bending_stiffness: float  # EI, N m^2
    damping_time: float  # Kelvin-Voigt relaxation time of EA and EI, s
    elastic_model: int  # CONTINUUM or ELEMENT_FRAME
    gravity: tuple[float, ...]  # (dim,) m/s^2
    end_position: FloatArray  # (2, dim) m, of start and end (of a counterweight at travel 0); NaN where free
    end_projector: FloatArray  # (2, 2, dim²) of start and end, of r and r_x: onto the free directions
    end_direction: FloatArray  # (2, dim) unit vectors of the cable in a clamp; NaN without a clamp
    load_arc_length: FloatArray  # (loads,) m
    load_force: FloatArray  # (loads, dim) N
    end_moment: FloatArray  # (2,) N m about y, on start and end (planar cables only)
    mass_damping: float = 0.0  # α, 1/s: damping by velocities, per mass
    free_stretch: float = 1.0  # -, length without tension over the unstrained one: 1 + α ΔT, of its temperature


def mesh_fields(node_arc_length: FloatArray) -> dict[str, Any]:
    """Fields of `Cable` that describe its mesh, from the arc lengths (nodes,) in m of its nodes, the first at 0."""
    lengths = np.diff(node_arc_length)
    if np.ptp(lengths) < 1e-9 * lengths[0]:
        lengths[:] = node_arc_length[-1] / lengths.size  # equal to the last bit
    whole = float(node_arc_length[-1])
    cells = int(np.ceil(whole / lengths.min() * (1.0 - 1e-9)))
    starts = whole / cells * np.arange(cells)
    return {
        "element_count": lengths.size,
        "element_length": lengths,
        "node_arc_length": node_arc_length,
        "node_joined": np.zeros(node_arc_length.size, dtype=np.bool_),
        "cell_length": whole / cells,
        "cell_element": np.clip(np.searchsorted(node_arc_length, starts, side="right") - 1, 0, lengths.size - 1),
        "unstrained_length": whole,
        "load_nodes": False,
    }


@by_reference
class DriveLimits(NamedTuple):
    """Limits of drives, one row per axis: joint or haul drum of a vehicle, moving cable, bullwheel."""

    speed: FloatArray  # m/s, inf without a limit
    acceleration: FloatArray  # m/s^2, of the reference
    deceleration: FloatArray  # m/s^2, of the reference towards rest
    emergency_deceleration: FloatArray  # m/s^2, of the reference in an emergency stop
    jerk: FloatArray  # m/s^3, inf without a limit
    force: FloatArray  # N, inf without a limit
    power: FloatArray  # W, force times speed, inf without a limit


@by_reference
class Carriages(NamedTuple):
    """Vehicles as chains of rigid bodies; body k of vehicle c is row body_offset[c] + k, the first is on the cable."""

    body_offset: IntArray  # (carriages + 1,)
    mass: FloatArray  # (bodies,) kg
    inertia: FloatArray  # (bodies,) kg m^2 about the centre of mass; in space (bodies, 9) in the body's axes
    upper_pivot: FloatArray  # (bodies, dim) m, from the centre of mass in the body's axes
    lower_pivot: FloatArray  # (bodies, dim) m, where the next body of the chain hangs
    hinge_stiffness: FloatArray  # (bodies,) N m/rad, of a spring against the body above; first of a chain: the cable
    hinge_damping: FloatArray  # (bodies,) N m s/rad, of a damper beside it
    roll_damping: FloatArray  # (bodies,) N m s/rad, of a damper of its roll in space
    held: IntArray  # (bodies,) angles that the joint above holds in space: 1 the heading, 2 the roll as well
    centre_offset: FloatArray  # (bodies, dim) m, of the centre of mass with its payload from that without
    fixed: NDArray[np.bool_]  # (carriages,) fixed at its arc length
    clamped: NDArray[np.bool_]  # (carriages,) clamped to a moving cable, also on the rest of its loop
    loop_place: FloatArray  # (carriages,) m, initial position on the loop of a clamped carriage
    rails: FloatArray  # (carriages,) m, over which a clamped carriage leaves the rails of a station, 0 without rails
    rolling_friction: FloatArray  # (carriages,) - , of the normal contact force
    viscous_friction: FloatArray  # (carriages,) N s/m
    presliding: FloatArray  # (carriages,) m, elastic displacement of a joint before it slides
    limits: DriveLimits  # (carriages,)
    drive_stops: NDArray[np.bool_]  # (carriages,) an emergency stop is the drive's, at its emergency deceleration
    brake_force: FloatArray  # (carriages, 3) N, of the brakes that an emergency stop applies, 0 of all others
    brake_rise_time: FloatArray  # (carriages, 3) s, from release to full force
    stop_stroke: FloatArray  # (carriages,) m, length of the elastic buffer at both ends of the cable
    stop_stiffness: FloatArray  # (carriages,) N/m
    stop_damping: FloatArray  # (carriages,) s/m, of the buffer force, per unit of its elastic part


BODY_FIELDS = frozenset(Carriages._fields[1 : Carriages._fields.index("fixed")])  # those with a row a body


@by_reference
class Towers(NamedTuple):
    """Towers between the ends; contact k of tower t, a sheave or a point of a saddle, is row contact_offset[t] + k."""

    contact_offset: IntArray  # (towers + 1,)
    contact_tower: IntArray  # (contacts,)
    top: FloatArray  # (towers, dim) m, where the middle of the saddle or of the sheaves touches the rope
    position: FloatArray  # (contacts, dim) m
    normal: FloatArray  # (contacts, dim) unit vectors towards the rope
    stiffness: FloatArray  # (contacts,) N/m, normal to the rope
    damping: FloatArray  # (contacts,) s/m, of the normal force, per unit of its elastic part
    friction: FloatArray  # (contacts,) - , limit of the force along the rope per normal force
    presliding: FloatArray  # (contacts,) m, elastic displacement of the rope before it slides
    apart: FloatArray  # (contacts,) m, length of the surface for which a point of a saddle stands; 0 of sheaves
    toe: FloatArray  # (contacts,) m, depth over which the stiffness sets in
    groove: FloatArray  # (contacts,) 1/m, in space: lateral over normal force, per offset from the middle
    groove_friction: FloatArray  # (contacts,) -, in space: lateral friction over normal force
    left: FloatArray  # (towers, dim) in space: unit vectors across the grooves to the left of the track
    derailment_ratio: FloatArray  # (towers,) -, lateral over normal force of a whole tower at which the rope derails
    groove_height: FloatArray  # (towers,) m, lift at which the rope has left its grooves
    at_bends: bool = False  # contacts touch sharp bends of the rope at loads too, see `on_rope.tower`


@by_reference
class Counterweights(NamedTuple):
    """Counterweights at the ends of the cable, with constant pull; a mass of 0 without one."""

    direction: FloatArray  # (2, dim) unit vectors in which start and end are pulled
    mass: FloatArray  # (2,) kg, of the inertia along that direction
    force: FloatArray  # (2,) N
    travel: FloatArray  # (2, 2) m, least and most from `end_position` along the direction; infinite without
    stiffness: FloatArray  # (2,) N/m, of the buffers at both limits
    damping: FloatArray  # (2,) s/m, of the buffer force, per unit of its elastic part


@by_reference
class MovingCable(NamedTuple):
    """Axially moving cable between fixed ends: its drive, and its loop as a single strand."""

    moving: bool
    loop_length: float  # m, unstrained; the part beyond the cable's own length is not simulated
    limits: DriveLimits  # (1,) of its drive
    over_bullwheels: bool = False  # its ends move with bullwheels, shared with other strands
    loop_offset: float = 0.0  # m, of its start on the loop, from the start of the first strand
    carries: NDArray[np.bool_] = np.zeros(0, dtype=np.bool_)  # (vehicles,) may be clamped to it, among several ropes


STANDING = MovingCable(
    moving=False,
    loop_length=1.0,
    limits=DriveLimits(*np.full((7, 1), np.inf)),
)


@by_reference
class HaulRopes(NamedTuple):
    """Haul rope of each vehicle: elastic, between the drive drum in a station and the joint of the vehicle."""

    axial_stiffness: FloatArray  # (carriages,) N, 0 where the drive acts on the carriage itself
    mass_per_length: FloatArray  # (carriages,) kg/m
    damping_ratio: FloatArray  # (carriages,) -, of carriage and rope on a drum that is held
    station: IntArray  # (carriages,) START or END, where the drum is
    beyond_track: FloatArray  # (carriages,) m of rope between the end of the track and the drum
    pretension: FloatArray  # (carriages,) N, pull of the counter rope, up to which the rope can push
    drive_inertia: FloatArray  # (carriages,) kg, all that turns or runs with the drum, reduced to the rope
    present: bool  # whether any carriage has one


@by_reference
class VehicleBuffers(NamedTuple):
    """Possible buffer contacts of vehicles on the rope; vehicle c has the entries offset[c] to offset[c + 1]."""

    offset: IntArray  # (carriages + 1,)
    other: IntArray  # (entries,) carriage of the possible contact
    side: FloatArray  # (entries,) 1 if the other one is after it on the rope, -1 if before
    room: FloatArray  # (entries,) m between their joints at first contact of the buffers
    stiffness: FloatArray  # (entries,) N/m, of both buffers in series
    damping: FloatArray  # (entries,) s/m, of their force, per unit of its elastic part
    present: bool  # whether there is an entry


NO_BUFFERS = VehicleBuffers(
    offset=np.zeros(1, dtype=np.int64),
    other=np.zeros(0, dtype=np.int64),
    side=np.zeros(0),
    room=np.zeros(0),
    stiffness=np.zeros(0),
    damping=np.zeros(0),
    present=False,
)


@by_reference
class Wind(NamedTuple):
    """Parameters of the wind: height law, gusts, turbulence, vortex shedding; vectors are x, y, z, in a plane too."""

    exponent: float  # -, of the power law of height; 0: uniform
    reference_height: float  # m above the ground, of the given wind
    ground: FloatArray  # (n,) m, z of the ground, evenly along x; one number for level ground
    ground_start: float  # m, x of the first
    ground_step: float  # m
    gusts: FloatArray  # (gusts, 6): x, y, z in m/s, start and duration in s, shape: ONE_COSINE or OPERATING_GUST
    intensity: float  # -, standard deviation along the wind over its mean speed; 0: no turbulence
    # (2 points, samples, 3): along the wind, to its left and up, for a deviation of 1 along it: at the points, and what
    # a straight line between neighbours lacks in the middle
    turbulence: FloatArray
    sample_spacing: float  # m of wind path from sample to sample; the first follows the last
    points: FloatArray  # (points, 3) m, evenly from start to end of the cable
    shedding: FloatArray  # (bodies, 2): eddies per metre of wind path, kg/m of their force; (0, 2) without shedding


ONE_COSINE, OPERATING_GUST = 0, 1  # shapes of a gust, see `on_rope.wind`
GUSTS = ("one_minus_cosine", "operating_gust")  # by number
STRONGEST_WIND = 100.0  # m/s, more than in any hurricane: 96 m/s in Patricia, 2015, a mean of a minute
COLDEST, HOTTEST = -100.0, 100.0  # degC, of ropes: beyond any weather and any rope in the sun
STEADY = Wind(
    exponent=0.0,
    reference_height=10.0,
    ground=np.zeros(1),
    ground_start=0.0,
    ground_step=1.0,
    gusts=np.zeros((0, 6)),
    intensity=0.0,
    turbulence=np.zeros((2, 1, 3)),
    sample_spacing=1.0,
    points=np.zeros((1, 3)),
    shedding=np.zeros((0, 2)),
)


@by_reference
class Air(NamedTuple):
    """Aerodynamic coefficients: quadratic drag of rope and bodies, and variation of the wind."""

    rope_drag: float  # kg/m^2, half of density, drag coefficient and diameter multiplied; 0 for none
    body_drag: FloatArray  # (bodies, dim²) kg/m, half of density and drag areas, a diagonal matrix in the axes of each
    present: bool  # whether there is any coefficient
    varies: bool = False  # whether the wind varies in space or time
    wind: Wind = STEADY


@by_reference
class Payloads(NamedTuple):
    """Payload position of each vehicle: the body that is loaded, and the point of it."""

    body: IntArray  # (carriages,) number of the body, -1 without a payload
    position: FloatArray  # (carriages, 2) m, from the centre of mass of the empty body in its axes


@by_reference
class Solver(NamedTuple):
    """Parameters of time integration and of its Newton iterations."""

    step: float  # h, s
    spectral_radius: float  # rho_inf of generalized-alpha, -
    tolerance: float  # m, estimated error of a position at which the Newton iteration ends
    max_iterations: int  # Newton iterations before a step is halved
    max_halvings: int  # halvings of a step before it fails


@by_reference
class System(NamedTuple):
    """All constant parameters of one rope with its supports, and of the vehicles that may be on it."""

    cable: Cable
    carriages: Carriages
    towers: Towers
    counterweights: Counterweights
    haul_ropes: HaulRopes
    air: Air
    solver: Solver
    moving_cable: MovingCable = STANDING
    buffers: VehicleBuffers = NO_BUFFERS
    number: int = ALONE  # of the rope among several
