"""Extremes of a run for its key figures, and the constants of the scenario for their calculation."""

from __future__ import annotations

from math import nan
from typing import Annotated, NamedTuple

import numpy as np

from cable_twin.frame.snapshot import ENDS, Layout
from cable_twin.geometry.bodies import body_box
from cable_twin.geometry.ground import first_rows
from cable_twin.key_figures.figure import Subject
from cable_twin.mechanics.language import declared
from cable_twin.mechanics.language.by_reference import by_reference
from cable_twin.mechanics.language.declared import Of
from cable_twin.mechanics.parameters import FloatArray, IntArray
from cable_twin.scenario import Grading, Scenario, in_space, masts
from cable_twin.scenario.builders.outlines import body_outline
from cable_twin.scenario.builders.vehicles import stop_stroke
from cable_twin.scenario.sections.couplings import Sheave
from cable_twin.scenario.sections.vehicles import Body

EXTREME = 7  # numbers of an extreme, by these indices; NaN where there is none
VALUE, TIME, PLACE, ROPE, WIND = range(5)  # -, s, m, number of the rope, and x, y, z in m/s from there on
PLACES = 12  # frames with positions that are kept for accelerations: more than 2 MEAN / LOOK of `extremes_by_frame`
TOUCH = 4  # numbers of a touch: row of the other vehicle, arc length (m), speed (m/s), time (s)
NO_ROPE = -1  # number of the rope of extremes on no rope, and of carriers, which ride several strands


@by_reference
class Extremes(NamedTuple):
    """Extremes of a run up to the present time, highest values unless noted, and running means and sums.

    Vehicles that are off the rope do not count. Nor do forces and accelerations of a carrier on the first and the last
    element of a moving cable: the end of the model is a point, and a mass that moves over it a singular load, where a
    ropeway has the rails of a station.
    """

    tension: Annotated[FloatArray, Of("rope", EXTREME, unit="N", first=nan)]
    lowest_tension: Annotated[FloatArray, Of("rope", EXTREME, unit="N", first=nan)]
    first_tension: Annotated[FloatArray, Of("rope", unit="N", first=nan)]  # highest of the first frame with a tension
    rope_clearance: Annotated[FloatArray, Of("rope", EXTREME, unit="m", first=nan)]  # lowest
    carried: Annotated[FloatArray, Of("rope", EXTREME, unit="kg", first=nan)]
    carried_now: Annotated[FloatArray, Of("rope", unit="kg")]
    sag: Annotated[FloatArray, Of("support", EXTREME, unit="m", first=nan)]  # of the span that begins at this corner
    corner: Annotated[FloatArray, Of("support", 2, unit="m", first=nan)]  # x, z of ends of chords, along each rope
    load: Annotated[FloatArray, Of("support", EXTREME, unit="N", first=nan)]
    lowest_load: Annotated[FloatArray, Of("support", EXTREME, unit="N", first=nan)]
    margin: Annotated[FloatArray, Of("support", EXTREME, first=nan)]  # lowest load of a tower over its load at rest
    roller_load: Annotated[FloatArray, Of("support", EXTREME, unit="N", first=nan)]  # lowest mean of the rollers
    travel: Annotated[FloatArray, Of("support", EXTREME, unit="m", first=nan)]
    lowest_travel: Annotated[FloatArray, Of("support", EXTREME, unit="m", first=nan)]
    lateral: Annotated[FloatArray, Of("support", EXTREME, unit="N", first=nan)]
    lateral_ratio: Annotated[FloatArray, Of("support", EXTREME, first=nan)]
    derailed: Annotated[FloatArray, Of("support", EXTREME, first=nan)]  # kind of derailment
    speed: Annotated[FloatArray, Of("driven", EXTREME, unit="m/s", first=nan)]  # of vehicles, then of drives
    force: Annotated[FloatArray, Of("driven", EXTREME, unit="N", first=nan)]
    power: Annotated[FloatArray, Of("driven", EXTREME, unit="W", first=nan)]
    lowest_power: Annotated[FloatArray, Of("driven", EXTREME, unit="W", first=nan)]
    drive_speed: Annotated[FloatArray, Of("vehicle", EXTREME, unit="m/s", first=nan)]
    brake_force: Annotated[FloatArray, Of("vehicle", EXTREME, unit="N", first=nan)]
    end_stop_speed: Annotated[FloatArray, Of("vehicle", EXTREME, unit="m/s", first=nan)]
    approach: Annotated[FloatArray, Of("vehicle", unit="m/s")]  # in the last frame, 0 at an end stop
    swing: Annotated[FloatArray, Of("vehicle", EXTREME, unit="rad", first=nan)]
    roll: Annotated[FloatArray, Of("vehicle", EXTREME, unit="rad", first=nan)]
    acceleration: Annotated[FloatArray, Of("vehicle", EXTREME, unit="m/s^2", first=nan)]
    contact_force: Annotated[FloatArray, Of("vehicle", EXTREME, unit="N", first=nan)]
    haul_force: Annotated[FloatArray, Of("vehicle", EXTREME, unit="N", first=nan)]
    haul_tension: Annotated[FloatArray, Of("vehicle", EXTREME, unit="N", first=nan)]
    tension_over_load: Annotated[FloatArray, Of("vehicle", EXTREME, first=nan)]  # lowest; load across the rope
    clearance: Annotated[FloatArray, Of("vehicle", EXTREME, unit="m", first=nan)]  # lowest
    mast_clearance: Annotated[FloatArray, Of("vehicle", EXTREME, unit="m", first=nan)]  # lowest; place: row of the mast
    push: Annotated[FloatArray, Of("vehicle", EXTREME, unit="N", first=nan)]  # of buffers
    push_touch: Annotated[FloatArray, Of("vehicle", TOUCH, first=nan)]  # touch that led to that force
    touch: Annotated[FloatArray, Of("vehicle", TOUCH, first=nan)]  # the last one
    passed_time: Annotated[FloatArray, Of(PLACES, unit="s", first=nan)]  # of frames with positions
    passed: Annotated[FloatArray, Of(PLACES, "vehicle", 5, unit="m", first=nan)]  # last body, arc length, rope
    passed_last: Annotated[IntArray, Of(1)]  # row of the newest frame in `passed`
    side_tension: Annotated[FloatArray, Of("sheave", 2, EXTREME, unit="N", first=nan)]  # incoming and outgoing strand
    lowest_side_tension: Annotated[FloatArray, Of("sheave", 2, EXTREME, unit="N", first=nan)]
    adhesion: Annotated[FloatArray, Of("sheave", EXTREME, first=nan)]  # used share of the available adhesion
    torque: Annotated[FloatArray, Of("sheave", EXTREME, unit="N m", first=nan)]
    slip: Annotated[FloatArray, Of("sheave", EXTREME, unit="m", first=nan)]
    rolled_back: Annotated[FloatArray, Of("sheave", EXTREME, first=nan)]
    sheave_travel: Annotated[FloatArray, Of("sheave", EXTREME, unit="m", first=nan)]
    sheave_pull: Annotated[FloatArray, Of("sheave", EXTREME, unit="N", first=nan)]  # of a hydraulic tensioner
    lowest_sheave_pull: Annotated[FloatArray, Of("sheave", EXTREME, unit="N", first=nan)]
    lowest_sheave_travel: Annotated[FloatArray, Of("sheave", EXTREME, unit="m", first=nan)]
    pantograph_force: Annotated[FloatArray, Of("pantograph", EXTREME, unit="N", first=nan)]
    lowest_pantograph_force: Annotated[FloatArray, Of("pantograph", EXTREME, unit="N", first=nan)]
    frames: Annotated[FloatArray, Of("pantograph")]  # with a force of the pantograph
    mean_force: Annotated[FloatArray, Of("pantograph", unit="N")]
    square_force: Annotated[FloatArray, Of("pantograph", unit="N²")]  # sum of squared distances from the mean
    lost: Annotated[FloatArray, Of("pantograph")]  # frames without contact
    last_force: Annotated[FloatArray, Of("pantograph", unit="s", first=nan)]  # time of the last frame with a force
    left: Annotated[FloatArray, Of("pantograph", unit="s", first=nan)]  # time of the first frame past an end
    pull: Annotated[FloatArray, Of("connector", EXTREME, unit="N", first=nan)]
    slack: Annotated[FloatArray, Of("connector", unit="s")]
    last_time: Annotated[FloatArray, Of(1, unit="s", first=nan)]
    separation: Annotated[FloatArray, Of("pair", EXTREME, unit="m", first=nan)]  # lowest; arc length of the first one
    separated: Annotated[IntArray, Of("pair", 2)]  # vehicles at that time
    wind: Annotated[FloatArray, Of(3, unit="m/s", first=nan)]  # now, in space
    memory: declared.Memory


@by_reference
class Constants(NamedTuple):
    """Constants of a scenario from which the extremes of its runs are calculated."""

    in_space: bool
    first_sample: IntArray  # (ropes + 1,)
    first_support: IntArray  # (ropes + 1,)
    first_mast: IntArray  # (ropes + 1,)
    length: FloatArray  # (ropes,) m, unstrained
    end_element: FloatArray  # (ropes,) m, length at either end without forces of clamped vehicles
    rollers: FloatArray  # (supports,) number of a tower; 0 for saddles and ends
    first_body: IntArray  # (vehicles + 1,)
    vehicle_rope: IntArray  # (vehicles,) or NO_ROPE
    clamped: IntArray  # (vehicles,) 1 for vehicles clamped to their rope
    braked: IntArray  # (vehicles,) 1 for carriages whose drive takes no part in an emergency stop
    stroke: FloatArray  # (vehicles,) m, of the end stops of carriages; 0 without
    empty: FloatArray  # (vehicles,) kg
    radius: FloatArray  # (sheaves,) m
    strand_ends: IntArray  # (sheaves, 2) rows of supports
    pulled_along: FloatArray  # (sheaves, 3) direction of the pull of a hydraulic tensioner; NaN without one
    available: FloatArray  # (sheaves,) friction times wrap: highest logarithm of the tension ratio


@by_reference
class Boxes(NamedTuple):
    """Bounding boxes of all bodies, groups of their vehicles, and scratch arrays."""

    group: IntArray  # (vehicles,) group of each; a pair of groups is first * groups + second
    first_body: IntArray  # (vehicles + 1,)
    middle: FloatArray  # (bodies, 3) m, centre of the box in the axes of the body
    body_half: FloatArray  # (bodies, 3) m, half the edges of the box
    centre: FloatArray  # (2, 3) m, scratch
    axes: FloatArray  # (2, 3, 3), scratch
    half: FloatArray  # (2, 3) m, scratch
    corners: FloatArray  # (2, 8, 3) m, scratch


def passes(scenario: Scenario) -> bool:
    """Whether a scenario has vehicles on different ropes in space, which can pass each other."""
    return scenario.dim == 3 and len(scenario.ropes) > 1 and len(scenario.vehicles) > 1


def ropes_of(scenario: Scenario) -> list[Scenario]:
    """Scenario of each rope alone, with its towers and vehicles."""
    return [scenario.of_rope(name) for name in scenario.cables]


def supports_of(scenario: Scenario) -> list[Subject]:
    """Subjects of the figures of all supports, rope by rope: both ends, then towers."""
    found = []
    for name, one in zip(scenario.cables, ropes_of(scenario), strict=True):
        ends = zip(ENDS, scenario.end_names(name), strict=True)
        found += [Subject(f"ropes.{name}.{end}", printed) for end, printed in ends]
        found += [Subject(f"towers.{tower}", tower) for tower in one.towers]
    return found


def masts_of(scenario: Scenario) -> list[str]:
    """Names of the towers with masts in space, rope by rope."""
    return [name for one in ropes_of(scenario) for name in masts(one)]


def constants_of(scenario: Scenario, layout: Layout) -> Constants:
    """Calculate the constants of a scenario for the extremes of its runs, for frames of a layout."""
    ropes, vehicles = ropes_of(scenario), scenario.vehicles
    rows = {name: row for row, name in enumerate(vehicles)}
    rope_of, clamped = np.full(len(vehicles), NO_ROPE), np.zeros(len(vehicles), np.int64)
    stroke = np.zeros(len(vehicles))
    for number, one in enumerate(ropes):
        for name, carriage in one.carriages.items():
            stroke[rows[name]] = stop_stroke(one, carriage) if carriage.joint == "sliding" else 0.0
        for name, vehicle in one.vehicles.items():
            clamped[rows[name]] = vehicle.joint == "clamped"
            if name in scenario.carriages or not scenario.ropes:
                rope_of[rows[name]] = number
    wheels, towers = scenario.sheaves.values(), [list(one.towers.values()) for one in ropes]
    rollers = [
        count
        for own in towers
        for count in (*(0 for _ in ENDS), *(tower.contacts if tower.kind == "sheaves" else 0 for tower in own))
    ]
    bodies = [list(vehicle.bodies.values()) for vehicle in vehicles.values()]
    braked = [name in scenario.carriages and "drive" not in one.drive.emergency_stop for name, one in vehicles.items()]
    return Constants(
        in_space=scenario.dim == 3,
        first_sample=np.array([0, *(part.stop for part in layout.ropes.values())], np.int64),
        first_support=first_rows([len(ENDS) + len(own) for own in towers]),
        first_mast=first_rows([len(masts(one)) for one in ropes]),
        length=np.array([one.cable.unstrained_length for one in ropes], np.float64),
        end_element=np.array([_end_element(one) for one in ropes], np.float64),
        rollers=np.array(rollers, np.float64),
        first_body=first_rows([len(own) for own in bodies]),
        vehicle_rope=rope_of.astype(np.int64),
        clamped=clamped,
        braked=np.array(braked, np.int64),
        stroke=stroke,
        empty=np.array([sum(body.mass for body in own) for own in bodies], np.float64),
        radius=np.array([wheel.radius for wheel in wheels], np.float64),
        strand_ends=_strand_ends(scenario),
        pulled_along=np.array([_pulled_along(wheel) for wheel in wheels]).reshape(-1, 3),
        available=np.array([wheel.friction * wheel.wrap for wheel in wheels], np.float64),
    )


def _strand_ends(scenario: Scenario) -> IntArray:
    """Rows (sheaves, 2) of the supports that are the ends of strands joined by each bullwheel."""
    rows = {one.key: row for row, one in enumerate(supports_of(scenario))}
    found = [[rows[f"ropes.{joined}"] for joined in wheel.joins] for wheel in scenario.sheaves.values()]
    return np.array(found, np.int64).reshape(-1, 2)


def _pulled_along(wheel: Sheave) -> FloatArray:
    """Unit vector (3,) of the pull of a bullwheel's hydraulic tensioner; NaN without one."""
    if wheel.hydraulics is None:
        return np.full(3, nan)
    given = np.array(in_space(wheel.hydraulics.direction))
    return np.asarray(given / np.linalg.norm(given))


def no_extremes(scenario: Scenario) -> Extremes:
    """Allocate the extremes of a run of a scenario, without values before its first frame."""
    ropes = ropes_of(scenario)
    sizes = {
        "rope": len(ropes),
        "support": sum(len(ENDS) + len(one.towers) for one in ropes),
        "vehicle": len(scenario.vehicles),
        "driven": len(scenario.vehicles) + len(scenario.drives),
        "sheave": len(scenario.sheaves),
        "pantograph": len(scenario.pantographs),
        "connector": len(scenario.connectors),
        "pair": (len(scenario.carriages) + (scenario.carriers is not None)) ** 2 if passes(scenario) else 0,
    }
    made = declared.allocate(Extremes, sizes)
    tops = [[(tower.position[0], tower.position[-1]) for tower in one.towers.values()] for one in ropes]
    made.corner[:] = [corner for own in tops for corner in ((nan, nan), *own, (nan, nan))]
    return made


def _end_element(scenario: Scenario) -> float:
    """Length (m) of the elements at the ends of a rope."""
    elements = scenario.cable.elements
    return elements.at_towers if isinstance(elements, Grading) else scenario.cable.unstrained_length / elements


class Hull(NamedTuple):
    """Bounding box of a body in its axes, from the centre of mass without payload."""

    middle: FloatArray  # (3,) m
    half: FloatArray  # (3,) m


def hull_of(body: Body) -> Hull:
    """Bounding box of a body; for a bar, a box of width 0."""
    box = body_box(body)
    if box is not None:
        return Hull(np.zeros(3), 0.5 * box)
    line = body_outline(body)
    low, high = line.min(axis=0), line.max(axis=0)
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    return Hull(np.array([middle[0], 0.0, middle[1]]), np.array([half[0], 0.0, half[1]]))


def boxes_of(scenario: Scenario) -> Boxes:
    """Bounding boxes of the bodies of a scenario, for the clearances of passing vehicles."""
    vehicles = list(scenario.vehicles.values())
    hulls = [hull_of(body) for one in vehicles for body in one.bodies.values()]
    return Boxes(
        group=np.minimum(np.arange(len(vehicles)), len(scenario.carriages)),
        first_body=first_rows(len(one.bodies) for one in vehicles),
        middle=np.array([hull.middle for hull in hulls]).reshape(-1, 3),
        body_half=np.array([hull.half for hull in hulls]).reshape(-1, 3),
        centre=np.zeros((2, 3)),
        axes=np.zeros((2, 3, 3)),
        half=np.zeros((2, 3)),
        corners=np.zeros((2, 8, 3)),
    )
