"""From a scenario to the constants of the mechanics."""

from __future__ import annotations

from math import inf, nan, pi, sqrt

import numpy as np

from cable_twin.mechanics import parameters
from cable_twin.mechanics.parameters import FloatArray, Payloads
from cable_twin.scenario.mesh import even_nodes, nodes_of
from cable_twin.scenario.schema import Body, Cable, Carriage, Drive, Scenario, Support, Tower

PRESLIDING = 1e-3  # m, how far a joint with rolling friction yields before it slides
TOWER_FRICTION = {"sheaves": 0.03, "saddle": 0.1}  # -, rolling of lined sheaves, sliding on a greased saddle
TOE = 1e-3  # m, depth over which a contact of a tower becomes stiff
BUFFER = 0.05  # m, what the buffers of a counterweight yield under its pull
DEFAULT_STROKE = 0.005  # of the cable's length
NO_BRAKE = (0.0, 0.0)  # N, s
BRAKES = ("service_brake", "emergency_brake", "track_rope_brake")  # in the columns of `parameters`
USED_STROKE = 0.6  # of the stroke, to stop the carriage at the reference speed without damping


def build_system(scenario: Scenario) -> parameters.System:
    """Work out the constants of the mechanics.

    Args:
        scenario: a scenario from `load_scenario`.

    Returns:
        Cable, carriages and solver; the bodies are in the order of the file.
    """
    cable, solver = scenario.cable, scenario.solver
    ends = (cable.start, cable.end)
    system = parameters.System(
        cable=parameters.Cable(
            **parameters.mesh_fields(even_nodes(cable.unstrained_length, 1)),
            mass_per_length=cable.mass_per_length + cable.ice,
            axial_stiffness=cable.axial_stiffness,
            bending_stiffness=cable.bending_stiffness,
            damping_time=cable.damping_time,
            elastic_model=parameters.ELASTIC_MODELS.index(cable.elastic_model),
            gravity=scenario.vector((0.0, -scenario.gravity)),
            end_position=np.array(
                [np.full(scenario.dim, nan) if end.support == "free" else scenario.vector(end.position) for end in ends]
            ),
            end_projector=np.array([_free_part(scenario, end) for end in ends]),
            end_direction=np.array([_direction(scenario, end if end.support == "clamped" else None) for end in ends]),
            load_arc_length=_array([load.arc_length for load in cable.loads]),
            load_force=_array([scenario.vector(load.force) for load in cable.loads], scenario.dim),
            end_moment=_end_moments(cable),
        ),
        carriages=_build_carriages(scenario),
        towers=_build_towers(scenario),
        counterweights=_build_counterweights(scenario),
        moving_cable=_build_moving_cable(scenario),
        haul_ropes=_build_haul_ropes(scenario),
        air=_build_air(scenario),
        solver=parameters.Solver(
            step=solver.step,
            spectral_radius=solver.spectral_radius,
            tolerance=solver.tolerance,
            max_iterations=solver.max_iterations,
            max_halvings=solver.max_halvings,
        ),
    )
    nodes = nodes_of(scenario, system)
    return system._replace(cable=system.cable._replace(**parameters.mesh_fields(nodes)))


def build_payloads(scenario: Scenario) -> Payloads:
    """Say where each carriage can be loaded: the body in the order of the file, -1 for none, and the place in it."""
    bodies, places, first = [], [], 0
    for carriage in scenario.vehicles.values():
        names, payload = list(carriage.bodies), carriage.payload
        number = -1 if payload is None else first + names.index(payload.body or names[-1])
        bodies.append(number)
        places.append(scenario.vector((0.0, 0.0) if payload is None else payload.position))
        first += len(names)
    return Payloads(body=np.array(bodies, dtype=np.int64), position=_array(places, scenario.dim))


def stop_stroke(scenario: Scenario, carriage: Carriage) -> float:
    """Length (m) of the end stops of a carriage: as given, or 0.5 % of the cable's length; none where it is clamped."""
    if carriage.joint == "clamped":
        return 0.0
    given = carriage.end_stop.stroke
    return DEFAULT_STROKE * scenario.cable.unstrained_length if given is None else given


def end_stop(scenario: Scenario, carriage: Carriage) -> tuple[float, float, float]:
    """Stroke (m), stiffness (N/m) and damping (s/m) of the end stops of a carriage.

    What is not given follows from the reference speed v: the drive's limit, or sqrt(g L) / 2 without one. The
    stiffness stops the whole carriage from v within 60 % of the stroke, and holds its whole weight there as well,
    which counts only for slow drives; the damping is 0.5 / v. What is clamped to a moving cable goes through.
    """
    if carriage.joint == "clamped":
        return 0.0, 0.0, 0.0
    stop = carriage.end_stop
    stroke = stop_stroke(scenario, carriage)
    speed = carriage.drive.limits.speed
    if speed is None:
        speed = 0.5 * sqrt(scenario.gravity * scenario.cable.unstrained_length) or 1.0
    mass = sum(body.mass for body in carriage.bodies.values())
    if carriage.payload is not None:
        mass += carriage.payload.capacity
    used = USED_STROKE * stroke
    stiffness = mass * max(speed**2 / used**2, scenario.gravity / used) if stop.stiffness is None else stop.stiffness
    damping = 0.5 / speed if stop.damping is None else stop.damping
    return stroke, stiffness, damping


def _free_part(scenario: Scenario, end: Support) -> FloatArray:
    """Projectors (2, dim²) of r and r_x of an end node onto what its support leaves free."""
    identity = np.eye(scenario.dim)
    position, slope = identity, identity
    if end.support != "free":
        position = np.zeros_like(identity)
    if end.support == "counterweight":
        position = _direction(scenario, end)[:, None] * _direction(scenario, end)
    if end.support == "clamped":
        slope = _direction(scenario, end)[:, None] * _direction(scenario, end)  # the strain is free, the turn is not
    return np.array([position.ravel(), slope.ravel()])


def _direction(scenario: Scenario, end: Support | None) -> FloatArray:
    """Unit vector (dim,) of the cable in a clamp or of the pull of a counterweight, NaN elsewhere."""
    if end is None or end.direction is None:
        return np.full(scenario.dim, nan)
    direction = np.array(scenario.vector(end.direction), dtype=np.float64)
    return direction / np.linalg.norm(direction)


def _end_moments(cable: Cable) -> FloatArray:
    """Moments (2,) in N m on start and end."""
    moments = np.zeros(2)
    for load in cable.loads:
        moments[0 if load.arc_length < 0.5 * cable.unstrained_length else 1] += load.moment
    return moments


def _build_towers(scenario: Scenario) -> parameters.Towers:
    towers = list(scenario.towers.values())
    places = [scenario.cable.start.position, *(t.position for t in towers), scenario.cable.end.position]
    corners = np.array([scenario.vector(place) for place in places])
    contacts = [_contacts(tower, *corners[number : number + 3]) for number, tower in enumerate(towers)]
    return parameters.Towers(
        contact_offset=np.cumsum([0, *(tower.contacts for tower in towers)], dtype=np.int64),
        top=corners[1:-1].copy(),
        position=_array([row for places, _ in contacts for row in places], scenario.dim),
        normal=_array([row for _, normals in contacts for row in normals], scenario.dim),
        stiffness=_array([tower.stiffness for tower in towers for _ in range(tower.contacts)]),
        damping=_array([tower.damping for tower in towers for _ in range(tower.contacts)]),
        friction=_array(
            [
                TOWER_FRICTION[tower.kind] if tower.friction is None else tower.friction
                for tower in towers
                for _ in range(tower.contacts)
            ]
        ),
        presliding=np.full(sum(tower.contacts for tower in towers), PRESLIDING),
        toe=np.full(sum(tower.contacts for tower in towers), TOE),
    )


def _contacts(tower: Tower, before: FloatArray, here: FloatArray, after: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Places (contacts, dim) in m of the contacts of a tower and the normals there, evenly along a circle.

    Its middle is the top of the tower; its tangent there goes between the directions to the supports `before` and
    `after` (dim,) in m, seen from `here`, as sheaves on their balances and well placed saddles do.
    """
    along = (here - before) / np.linalg.norm(here - before) + (after - here) / np.linalg.norm(after - here)
    along /= np.linalg.norm(along)
    up = np.eye(along.size)[-1] - along[-1] * along
    up /= np.linalg.norm(up)
    if tower.hold_down:
        up = -up
    s = np.linspace(-0.5, 0.5, tower.contacts)[:, None] * tower.length if tower.contacts > 1 else np.zeros((1, 1))
    top = here
    if tower.radius is None:
        return top + s * along, np.repeat(up[None], tower.contacts, axis=0)
    angle = s / tower.radius
    normals = np.cos(angle) * up + np.sin(angle) * along
    return top + tower.radius * (normals - up), normals


def _build_counterweights(scenario: Scenario) -> parameters.Counterweights:
    ends = (scenario.cable.start, scenario.cable.end)
    rows = [_counterweight(scenario, end) for end in ends]
    direction, mass, force, travel = zip(*rows, strict=True)
    return parameters.Counterweights(
        direction=np.array(direction),
        mass=_array(list(mass)),
        force=_array(list(force)),
        travel=_array(list(travel), 2),
        stiffness=_array([end.buffer_stiffness or pull / BUFFER for end, pull in zip(ends, force, strict=True)]),
        damping=_array([end.buffer_damping for end in ends]),
    )


def _counterweight(scenario: Scenario, end: Support) -> tuple[FloatArray, float, float, tuple[float, float]]:
    """Direction (dim,), mass (kg), force (N) and travel (m) of the counterweight at an end; without one a mass of 0."""
    if end.support != "counterweight" or end.mass is None:
        return np.full(scenario.dim, nan), 0.0, 0.0, (-inf, inf)
    return _direction(scenario, end), end.mass, end.force or end.mass * scenario.gravity, end.travel or (-inf, inf)


def _build_moving_cable(scenario: Scenario) -> parameters.MovingCable:
    for drive in scenario.drives.values():
        limits = drive.limits
        return parameters.MovingCable(
            moving=True,
            loop_length=scenario.loop_length,
            acceleration_limit=limits.acceleration,
            emergency_deceleration=limits.emergency_deceleration,
            jerk_limit=inf if limits.jerk is None else limits.jerk,
        )
    return parameters.STANDING


def _build_carriages(scenario: Scenario) -> parameters.Carriages:
    carriages = list(scenario.vehicles.values())
    bodies = [body for carriage in carriages for body in carriage.bodies.values()]
    limits = [carriage.drive.limits for carriage in carriages]
    stops = _array([end_stop(scenario, carriage) for carriage in carriages], 3)
    brakes = _array([_brakes(carriage.drive) for carriage in carriages]).reshape(-1, len(BRAKES), 2)
    return parameters.Carriages(
        body_offset=np.cumsum([0, *(len(carriage.bodies) for carriage in carriages)], dtype=np.int64),
        mass=_array([body.mass for body in bodies]),
        inertia=_inertias(scenario, bodies),
        upper_pivot=_array([scenario.vector(body.upper_pivot) for body in bodies], scenario.dim),
        lower_pivot=_array([scenario.vector(body.lower_pivot or (0.0, 0.0)) for body in bodies], scenario.dim),
        hinge_stiffness=_array([body.stiffness for body in bodies]),
        hinge_damping=_array([body.damping for body in bodies]),
        roll_damping=_array([body.roll_damping for body in bodies]),
        held=np.array(_held(scenario), dtype=np.int64),
        centre_offset=np.zeros((len(bodies), scenario.dim)),
        fixed=np.array([carriage.joint == "fixed" for carriage in carriages], dtype=np.bool_),
        clamped=np.array([carriage.joint == "clamped" for carriage in carriages], dtype=np.bool_),
        loop_place=_array([carriage.arc_length for carriage in carriages]),
        rolling_friction=_array([carriage.friction.rolling for carriage in carriages]),
        presliding=np.full(len(carriages), PRESLIDING),
        viscous_friction=_array([carriage.friction.viscous for carriage in carriages]),
        speed_limit=_array([inf if limit.speed is None else limit.speed for limit in limits]),
        acceleration_limit=_array([limit.acceleration for limit in limits]),
        deceleration_limit=_array([limit.deceleration or limit.acceleration for limit in limits]),
        emergency_deceleration=_array([limit.emergency_deceleration for limit in limits]),
        jerk_limit=_array([inf if limit.jerk is None else limit.jerk for limit in limits]),
        force_limit=_array([inf if limit.force is None else limit.force for limit in limits]),
        power_limit=_array([inf if limit.power is None else limit.power for limit in limits]),
        drive_stops=np.array(["drive" in carriage.drive.emergency_stop for carriage in carriages], dtype=np.bool_),
        brake_force=brakes[:, :, 0].copy(),
        brake_rise_time=brakes[:, :, 1].copy(),
        stop_stroke=stops[:, 0].copy(),
        stop_stiffness=stops[:, 1].copy(),
        stop_damping=stops[:, 2].copy(),
    )


def _inertias(scenario: Scenario, bodies: list[Body]) -> FloatArray:
    """Inertias (bodies,) in kg m² about y, or in space tensors (bodies, 9) in the axes of each body."""
    if scenario.dim == 2:
        return _array([body.inertia for body in bodies])
    tensors = [np.array(body.inertia, dtype=np.float64) for body in bodies]
    return np.array([t if t.ndim == 2 else np.diag(np.broadcast_to(t, 3)) for t in tensors]).reshape(-1, 9)


def _held(scenario: Scenario) -> list[int]:
    """Angles that the joint above each body holds: in space the heading, and of a revolute one the roll as well."""
    found = []
    for carriage in scenario.vehicles.values():
        for number, body in enumerate(carriage.bodies.values()):
            found.append(0 if scenario.dim == 2 else 2 if number > 0 and body.turns == "revolute" else 1)
    return found


def _brakes(drive: Drive) -> list[tuple[float, float]]:
    """Force (N) and rise time (s) of the brakes that an emergency stop applies."""
    applied = [getattr(drive, name) if name in drive.emergency_stop else None for name in BRAKES]
    return [NO_BRAKE if brake is None else (brake.force, brake.rise_time) for brake in applied]


def _build_haul_ropes(scenario: Scenario) -> parameters.HaulRopes:
    ropes = [carriage.drive.haul_rope for carriage in scenario.vehicles.values()]
    return parameters.HaulRopes(
        axial_stiffness=_array([0.0 if rope is None else rope.axial_stiffness for rope in ropes]),
        mass_per_length=_array([0.0 if rope is None else rope.mass_per_length for rope in ropes]),
        damping_ratio=_array([0.0 if rope is None else rope.damping_ratio for rope in ropes]),
        station=np.array(
            [parameters.START if rope is None or rope.station == "start" else parameters.END for rope in ropes],
            dtype=np.int64,
        ),
        beyond_track=_array([1.0 if rope is None else rope.beyond_track for rope in ropes]),
        pretension=_array([0.0 if rope is None else rope.pretension for rope in ropes]),
        drive_inertia=_array([0.0 if rope is None else rope.drive_inertia for rope in ropes]),
        present=any(rope is not None for rope in ropes),
    )


def _build_air(scenario: Scenario) -> parameters.Air:
    cable, density = scenario.cable, scenario.air.density
    rope_drag = 0.0
    if cable.diameter is not None:
        diameter = sqrt(cable.diameter**2 + 4.0 * cable.ice / (pi * cable.ice_density))
        rope_drag = 0.5 * density * cable.drag_coefficient * diameter
    areas = [body.drag_area for carriage in scenario.vehicles.values() for body in carriage.bodies.values()]
    body_drag = 0.5 * density * _array(areas)
    return parameters.Air(rope_drag=rope_drag, body_drag=body_drag, present=bool(rope_drag > 0.0 or body_drag.any()))


def _array(values: list, columns: int = 0) -> FloatArray:
    """Floats of shape (n,), or (n, columns) even where n is 0."""
    return np.array(values, dtype=np.float64).reshape((-1, columns) if columns else -1)
