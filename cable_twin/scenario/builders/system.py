"""Constants of the mechanics of one rope, built from a scenario."""

from __future__ import annotations

from math import inf, nan, pi, sqrt

import numpy as np

from cable_twin.mechanics import parameters
from cable_twin.mechanics.parameters import FloatArray, Payloads
from cable_twin.mechanics.solution.catenary import line_over
from cable_twin.scenario.builders import columns, floats, numbers
from cable_twin.scenario.builders.mesh import even_nodes, nodes_of, with_marks
from cable_twin.scenario.builders.vehicles import PRESLIDING, build_carriages, build_haul_ropes, build_limits
from cable_twin.scenario.builders.wind import build_wind
from cable_twin.scenario.schema import Scenario
from cable_twin.scenario.sections.line import Cable, EndSupport, Tower

TOWER_FRICTION = {"sheaves": 0.03, "saddle": 0.1}  # -, rolling of lined sheaves, sliding on a greased saddle
OF_TOWERS = ("derailment_ratio", "groove_height")  # constants of a whole tower, and not of a contact
TOE = 1e-3  # m, depth over which a contact of a tower becomes stiff
BUFFER = 0.05  # m, compression of the buffers of a counterweight under its pull


def tower_friction(tower: Tower) -> float:
    """Friction of the rope on a tower: of the scenario, else the usual one of its kind."""
    return TOWER_FRICTION[tower.kind] if tower.friction is None else tower.friction


def build_system(
    scenario: Scenario, marks: FloatArray | None = None, nodes: FloatArray | None = None
) -> parameters.System:
    """Build the constants of the mechanics of one rope.

    Args:
        scenario: a scenario from `load_scenario`, of one rope.
        marks: arc lengths (marks,) in m of additional nodes, such as those of connectors.
        nodes: arc lengths (nodes,) in m of all nodes, instead of the mesh of the scenario.

    Returns:
        Cable, carriages and solver; the bodies are in the order of the file.
    """
    system = parameters.System(
        cable=_build_cable(scenario),
        carriages=build_carriages(scenario),
        towers=_build_towers(scenario),
        counterweights=_build_counterweights(scenario),
        moving_cable=_build_moving_cable(scenario),
        haul_ropes=build_haul_ropes(scenario),
        air=_build_air(scenario),
        solver=parameters.Solver(**numbers(parameters.Solver, scenario.solver)),
    )
    if nodes is None:
        nodes = nodes_of(scenario, system)
    if marks is not None:
        nodes = with_marks(nodes, marks)
    mesh = parameters.mesh_fields(nodes) | {"load_nodes": scenario.joint == "node"}
    return system._replace(cable=system.cable._replace(**mesh))


def _build_cable(scenario: Scenario) -> parameters.Cable:
    """Build the constants of the bare rope, with a single element."""
    cable, dim = scenario.cable, scenario.dim
    ends = list(cable.ends.values())
    own = {
        **parameters.mesh_fields(even_nodes(cable.unstrained_length, 1)),
        "mass_per_length": cable.mass_per_length + cable.ice,
        "elastic_model": parameters.ELASTIC_MODELS.index(cable.elastic_model),
        "gravity": scenario.vector((0.0, -scenario.gravity)),
        "end_position": np.array(
            [np.full(dim, nan) if end.support == "free" else scenario.vector(end.position) for end in ends]
        ),
        "end_projector": np.array([_free_part(scenario, end) for end in ends]),
        "end_direction": np.array([_direction(scenario, end if end.support == "clamped" else None) for end in ends]),
        "load_arc_length": floats([load.arc_length for load in cable.loads]),
        "load_force": floats([scenario.vector(load.force) for load in cable.loads], dim),
        "end_moment": _end_moments(cable),
        "free_stretch": cable.free_stretch(scenario.air.temperature),
    }
    return parameters.Cable(**(numbers(parameters.Cable, cable) | own))


def build_payloads(scenario: Scenario) -> Payloads:
    """Build the payload of each vehicle: index of the body that carries it (-1 for none), and position in the body."""
    bodies, places, first = [], [], 0
    for carriage in scenario.vehicles.values():
        names, payload = list(carriage.bodies), carriage.payload
        number = -1 if payload is None else first + names.index(payload.body or names[-1])
        bodies.append(number)
        places.append(scenario.vector((0.0, 0.0) if payload is None else payload.position))
        first += len(names)
    return Payloads(body=np.array(bodies, dtype=np.int64), position=floats(places, scenario.dim))


def _free_part(scenario: Scenario, end: EndSupport) -> FloatArray:
    """Projectors (2, dim²) of position r and slope r_x of an end node onto the directions left free by the support."""
    identity = np.eye(scenario.dim)
    position, slope = identity, identity
    if end.support != "free":
        position = np.zeros_like(identity)
    if end.support == "counterweight":
        position = _direction(scenario, end)[:, None] * _direction(scenario, end)
    if end.support == "clamped":
        slope = _direction(scenario, end)[:, None] * _direction(scenario, end)  # the strain is free, the turn is not
    return np.array([position.ravel(), slope.ravel()])


def _direction(scenario: Scenario, end: EndSupport | None) -> FloatArray:
    """Unit vector (dim,) of the cable in a clamp or of the pull of a counterweight, NaN elsewhere."""
    if end is None or end.direction is None:
        return np.full(scenario.dim, nan)
    direction = np.array(scenario.vector(end.direction), dtype=np.float64)
    return direction / np.linalg.norm(direction)


def _end_moments(cable: Cable) -> FloatArray:
    """External moments (2,) in N m on start and end of the cable."""
    moments = np.zeros(2)
    for load in cable.loads:
        moments[0 if load.arc_length < 0.5 * cable.unstrained_length else 1] += load.moment
    return moments


def _build_towers(scenario: Scenario) -> parameters.Towers:
    """Build the towers with their contacts with the rope; values of a tower are repeated for each of its contacts."""
    record, towers = parameters.Towers, list(scenario.towers.values())
    of_contacts = [tower for tower in towers for _ in range(tower.contacts)]
    shapes = [
        _contacts(scenario, tower, up, along) for tower, up, along in zip(towers, *_groove_axes(scenario), strict=True)
    ]
    frictions = [tower_friction(tower) for tower in of_contacts]
    whole = columns(record, Tower, towers)
    own = {
        "contact_offset": np.cumsum([0, *(tower.contacts for tower in towers)], dtype=np.int64),
        "contact_tower": np.repeat(np.arange(len(towers), dtype=np.int64), [tower.contacts for tower in towers]),
        "top": _corners(scenario)[1:-1].copy(),
        "position": floats([row for places, _ in shapes for row in places], scenario.dim),
        "normal": floats([row for _, normals in shapes for row in normals], scenario.dim),
        "friction": floats(frictions),
        "presliding": np.full(len(of_contacts), PRESLIDING),
        "apart": floats([_apart(tower) for tower in of_contacts]),
        "toe": np.full(len(of_contacts), TOE),
        "left": tower_axes(scenario)[1],
    }
    return record(**(columns(record, Tower, of_contacts) | {name: whole[name] for name in OF_TOWERS} | own))


def _apart(tower: Tower) -> float:
    """Length (m) of the surface of a saddle for which each of its contact points stands; 0 of sheaves."""
    return tower.length / (tower.contacts - 1) if tower.kind == "saddle" and tower.contacts > 1 else 0.0


def tower_axes(scenario: Scenario) -> tuple[FloatArray, FloatArray]:
    """Unit vectors (towers, dim) of the groove opening of each tower, and across it to the left of the track.

    In a plane the vectors to the left are zero.
    """
    up, along = _groove_axes(scenario)
    if scenario.dim == 2:
        return up, np.zeros_like(up)
    across = np.cross(up, along)
    sides = np.einsum("td,td->t", across, _level_left(scenario, along))
    return up, across * np.copysign(1.0, sides)[:, None]


def masts(scenario: Scenario) -> dict[str, tuple[float, float, float, float]]:
    """Place x, y, height of the top and half the width, in m, of the masts in space, by name of their towers."""
    if scenario.dim == 2:
        return {}
    found, corners = {}, _corners(scenario)[1:-1]
    left = _level_left(scenario, _groove_axes(scenario)[1])
    for (name, tower), top, side in zip(scenario.towers.items(), corners, left, strict=True):
        if tower.mast_offset is not None and tower.mast_width is not None:
            x, y, z = (top + tower.mast_offset * side).tolist()
            found[name] = x, y, z, 0.5 * tower.mast_width
    return found


def _level_left(scenario: Scenario, along: FloatArray) -> FloatArray:
    """Level unit vectors (n, 3) to the left of the track, across directions (n, 3) of its cable in space."""
    turned = np.cross([0.0, 0.0, -1.0 if scenario.runs_back else 1.0], along)
    return turned / np.linalg.norm(turned, axis=1)[:, None]


def _groove_axes(scenario: Scenario) -> tuple[FloatArray, FloatArray]:
    """Unit vectors (towers, dim) of the opening of each tower's middle groove across the line, and along the line.

    Grooves open upwards, downwards of a hold-down, or as near to `groove_direction` as they can; the line goes between
    the directions to the supports before and after it, as sheaves on their balances and well placed saddles do.
    """
    corners = _corners(scenario)
    up, along = np.zeros((2, len(scenario.towers), scenario.dim))
    for number, tower in enumerate(scenario.towers.values()):
        along[number] = line_over(*corners[number : number + 3])
        given = tower.groove_direction
        upright = np.eye(scenario.dim)[-1] * (-1.0 if tower.hold_down else 1.0)
        opening = upright if given is None else np.array(scenario.vector(given))
        up[number] = opening - (opening @ along[number]) * along[number]
        up[number] /= np.linalg.norm(up[number])
    return up, along


def _corners(scenario: Scenario) -> FloatArray:
    """Positions (towers + 2, dim) in m of start, towers and end."""
    return np.array([scenario.vector(place) for place in scenario.corners])


def _contacts(scenario: Scenario, tower: Tower, up: FloatArray, along: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Positions (contacts, dim) in m and normals of the contacts of a tower, evenly spaced on a circle.

    The middle one is the top of the tower, with its normal `up` (dim,) and its tangent `along` (dim,).
    """
    s = np.linspace(-0.5, 0.5, tower.contacts)[:, None] * tower.length if tower.contacts > 1 else np.zeros((1, 1))
    top = np.array(scenario.vector(tower.position))
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
        mass=floats(list(mass)),
        force=floats(list(force)),
        travel=floats(list(travel), 2),
        stiffness=floats([end.buffer_stiffness or pull / BUFFER for end, pull in zip(ends, force, strict=True)]),
        damping=floats([end.buffer_damping for end in ends]),
    )


def _counterweight(scenario: Scenario, end: EndSupport) -> tuple[FloatArray, float, float, tuple[float, float]]:
    """Direction (dim,), mass (kg), force (N) and travel (m) of the counterweight at an end; without one a mass of 0."""
    if end.support != "counterweight" or end.mass is None:
        return np.full(scenario.dim, nan), 0.0, 0.0, (-inf, inf)
    return _direction(scenario, end), end.mass, end.force or end.mass * scenario.gravity, end.travel or (-inf, inf)


def _build_moving_cable(scenario: Scenario) -> parameters.MovingCable:
    if scenario.strand is not None:
        return parameters.STANDING._replace(moving=True, over_bullwheels=True, loop_length=scenario.loop_length)
    for drive in scenario.drives.values():
        limits = build_limits([drive.limits])
        return parameters.MovingCable(moving=True, loop_length=scenario.loop_length, limits=limits)
    return parameters.STANDING


def _build_air(scenario: Scenario) -> parameters.Air:
    cable, density = scenario.cable, scenario.air.density
    rope_drag = 0.0
    if cable.diameter is not None:
        diameter = sqrt(cable.diameter**2 + 4.0 * cable.ice / (pi * cable.ice_density))
        rope_drag = 0.5 * density * cable.drag_coefficient * diameter
    bodies = [body for carriage in scenario.vehicles.values() for body in carriage.bodies.values()]
    areas = [scenario.vector(body.drag_areas) for body in bodies]
    body_drag = 0.5 * density * floats([np.diag(area) for area in areas], scenario.dim**2)
    wind = build_wind(scenario)
    forces = rope_drag > 0.0 or body_drag.any() or wind.shedding.any()
    return parameters.Air(
        rope_drag=rope_drag, body_drag=body_drag, present=bool(forces), varies=wind is not parameters.STEADY, wind=wind
    )
