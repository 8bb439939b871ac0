"""Cases out of the plane: ropes and carriages in space against planes, closed forms and their own turned images."""

from __future__ import annotations

from collections.abc import Iterator
from math import atan, cos, hypot, pi, sin, sqrt, tan
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from cable_twin.mechanics.parameters import FloatArray, System
from cable_twin.mechanics.readout.energies import energies
from cable_twin.mechanics.readout.sections import end_force
from cable_twin.mechanics.solution.equilibrium import settle
from cable_twin.mechanics.solution.modes import natural_modes
from cable_twin.mechanics.state import State, allocate_state, allocate_workspace
from cable_twin.scenario import Scenario, build_system, load_scenario
from cable_twin.simulation import Simulation
from cable_twin.simulation.engine import leave_out_absent
from verification import Result, case
from verification.models import GRAVITY, changing, for_kernels, observed_order
from verification.rope_frequencies import RATIOS, STRING, flat_cable, irvine_frequencies
from verification.statics import CANTILEVER, LEVEL_SPAN, elastica

HANGER = {"mass": 200.0, "inertia": 100.0, "upper_pivot": [0.0, 1.5], "lower_pivot": [0.0, -1.5], "damping": 50.0}
CABIN = {"mass": 800.0, "inertia": 600.0, "upper_pivot": [0.1, 1.0], "drag_area": 4.0}
OBLIQUE = 0.7  # rad, by which a system is turned about z
ARM, CONE = 2.0, 0.5  # m, rad: of the conical pendulum


def span(*, end: tuple[float, ...] = (200.0, 10.0), start: tuple[float, ...] = (0.0, 0.0), **more: Any) -> Simulation:
    """A damped span of 200 m with a cabin on it that slides freely, in wind."""
    data: dict[str, Any] = {
        "cable": {
            "unstrained_length": 201.0,
            "mass_per_length": 5.0,
            "axial_stiffness": 2e7,
            "bending_stiffness": 500.0,
            "elements": 40,
            "damping_time": 0.005,
            "diameter": 0.03,
            "start": {"position": list(start)},
            "end": {"position": list(end)},
        },
        "carriages": {"cabin": {"arc_length": 80.0, "bodies": {"hanger": HANGER, "cabin": CABIN}}},
        "solver": {"step": 0.005, "tolerance": 1e-12},
    }
    return Simulation(load_scenario(data | more))


def tangent_frame(angle: float) -> FloatArray:
    """Rotation matrix (3, 3) about z."""
    return Rotation.from_rotvec([0.0, 0.0, angle]).as_matrix()


@case("a plane in space", "the same motion in the plane", needs_jit=True)
def plane_in_space() -> Iterator[Result]:
    """A cabin that slides down a span in wind along the track, five seconds."""
    wind = {"air": {"wind": [3.0, 0.0]}}
    plane, space = span(**wind), span(**wind, space=3)
    for simulation in (plane, space):
        simulation.advance_to(5.0)
    rope = np.abs(plane.state.nodes.position - space.state.nodes.position[..., [0, 2]]).max()
    bodies = np.abs(plane.state.bodies.position[:, :2] - space.state.bodies.position[:, [0, 2]]).max()
    yield Result("rope apart", "m", 0.0, float(rope), 1e-9)
    yield Result("bodies apart", "m", 0.0, float(bodies), 1e-9)
    yield Result("rope out of the plane", "m", 0.0, float(np.abs(space.state.nodes.position[..., 1]).max()), 1e-12)


@case("a system turned about z", "invariance under rotation", needs_jit=True)
def turned_system() -> Iterator[Result]:
    """A cabin in oblique wind beside one with rope and wind turned by 0.7 rad: at rest, and after five seconds."""
    turn = tangent_frame(OBLIQUE)
    wind, end = np.array([3.0, 12.0, 0.0]), np.array([200.0, 0.0, 10.0])
    straight = span(start=(0.0, 0.0, 0.0), end=tuple(end), air={"wind": wind.tolist()})
    turned = span(start=(0.0, 0.0, 0.0), end=tuple((turn @ end).tolist()), air={"wind": (turn @ wind).tolist()})
    for time in (0.0, 5.0):
        for simulation in (straight, turned):
            simulation.advance_to(time)
        rope = np.abs(straight.state.nodes.position @ turn.T - turned.state.nodes.position).max()
        bodies = np.abs(straight.state.bodies.position[:, :3] @ turn.T - turned.state.bodies.position[:, :3]).max()
        yield Result(f"rope apart at {time:g} s", "m", 0.0, float(rope), 1e-9)
        yield Result(f"bodies apart at {time:g} s", "m", 0.0, float(bodies), 1e-9)


@case("tilted catenary", "the catenary under the resultant of weight and side load, in its plane", needs_jit=True)
def tilted_catenary() -> Iterator[Result]:
    """A level span under a lateral force per unstrained length as well as its weight, bare and with a vehicle."""
    side = 4.0  # m/s², as a part of gravity
    strength = hypot(GRAVITY, side)
    for vehicle in (False, True):
        body = {"mass": 300.0, "inertia": 50.0, "upper_pivot": [0.0, 2.0]}
        carriages = {"cabin": {"arc_length": 70.0, "joint": "fixed", "bodies": {"cabin": body}}} if vehicle else {}
        rope = {
            "unstrained_length": 203.0,
            "mass_per_length": 5.0,
            "axial_stiffness": 2e7,
            "bending_stiffness": 10.0,
            "elements": 64,
            "start": {"position": [0.0, 0.0]},
            "end": {"position": [200.0, 0.0]},
        }
        scenario = {"cable": rope, "carriages": carriages}
        plane, flat = at_rest(load_scenario(scenario), (0.0, -strength))
        tilted, space = at_rest(load_scenario({**scenario, "space": 3}), (0.0, side, -GRAVITY))
        angle = atan(side / GRAVITY)  # about the chord
        image = flat.nodes.position[:, 0] @ np.array([[1.0, 0.0, 0.0], [0.0, -sin(angle), cos(angle)]])
        label = "with a vehicle" if vehicle else "bare"
        apart = float(np.abs(space.nodes.position[:, 0] - image).max())
        yield Result(f"places apart, {label}", "m", 0.0, apart, 1e-6 * 203.0)
        want, got = (float(np.linalg.norm(end_force(*pair, 0))) for pair in ((plane, flat), (tilted, space)))
        yield Result(f"tension at the start, {label}", "N", want, got, 1e-5 * want)


def at_rest(scenario: Scenario, gravity: tuple[float, ...]) -> tuple[System, State]:
    """A system in another gravity (dim,) in m/s² than a scenario can have, and its state at rest."""
    (system,) = leave_out_absent([build_system(scenario)])
    system = system._replace(cable=system.cable._replace(gravity=gravity))
    state = allocate_state(system)
    for row, carriage in enumerate(scenario.vehicles.values()):
        state.joints.position[row] = carriage.arc_length
    settle(system, state, allocate_workspace(system))
    return system, state


@case("roll under a side force", "tan φ = side force over weight, about each joint", needs_jit=True)
def roll() -> Iterator[Result]:
    """A hanger and a cabin on a stiff, taut rope in a wind across it; the joint between them leaves the roll free."""
    wind, area, density = 15.0, 6.0, 1.225
    force = 0.5 * density * area * wind**2
    hanger = {"mass": 200.0, "inertia": 100.0, "upper_pivot": [0.0, 1.0], "lower_pivot": [0.0, -1.0]}
    cabin = {"mass": 500.0, "inertia": 200.0, "upper_pivot": [0.0, 1.2], "drag_area": area, "turns": "universal"}
    for turns in ("universal", "revolute"):
        bodies = {"hanger": hanger, "cabin": {**cabin, "turns": turns}}
        simulation = Simulation(load_scenario(taut(bodies) | {"air": {"wind": [0.0, wind, 0.0], "density": density}}))
        found = simulation.snapshot.carriages["cabin"].bodies
        got = [float(found[name].roll) for name in bodies]
        weights = 200.0 * GRAVITY, 500.0 * GRAVITY
        upper = atan(2.0 * force / (weights[0] + 2.0 * weights[1]))  # arms of 1 m and 2 m
        lower = atan(force / weights[1])
        if turns == "revolute":  # one rigid body in roll, arms of 1 m and 3.2 m
            upper = lower = atan(3.2 * force / (weights[0] + 3.2 * weights[1]))
        # a wind to the left swings what hangs to the left: x is the axis, and the roll is negative about it
        for name, want, have in zip(bodies, (upper, lower), got, strict=True):
            yield Result(f"roll of the {name}, {turns}", "rad", want, abs(have), 1e-6)


def taut(bodies: dict[str, Any], **solver: Any) -> dict[str, Any]:
    """Scenario of a carriage that is fixed in the middle of a rope so taut that it stands still."""
    rope = {
        "unstrained_length": 10.0,
        "mass_per_length": 0.01,
        "axial_stiffness": 1e10,
        "bending_stiffness": 1.0,
        "elements": 10,
        "start": {"position": [0.0, 0.0, 0.0]},
        "end": {"position": [10.05, 0.0, 0.0]},
    }
    carriages = {"cabin": {"arc_length": 5.0, "joint": "fixed", "bodies": bodies}}
    return {"cable": rope, "carriages": carriages, "solver": {"step": 1e-3, "tolerance": 1e-13, **solver}}


def conical(step: float) -> tuple[Simulation, float]:
    """A point mass that goes round in a cone below a taut rope, and its time for a turn (s)."""
    body = {"mass": 2.0, "inertia": 1e-7, "upper_pivot": [0.0, ARM]}
    simulation = Simulation(load_scenario(taut({"ball": body}, step=step)))
    rate = sqrt(GRAVITY / (ARM * cos(CONE)))

    def axes(angle: float) -> FloatArray:
        """Axes of the body as columns where its heading is held: the lateral one across the rope, z to the pivot."""
        up = -np.array([sin(CONE) * cos(angle), sin(CONE) * sin(angle), -cos(CONE)])
        left = np.cross(up, [1.0, 0.0, 0.0])
        left /= np.linalg.norm(left)
        return np.stack([np.cross(left, up), left, up], axis=1)

    joint = np.array(simulation.snapshot.carriages["cabin"].position)
    small = 1e-5
    spin = Rotation.from_matrix(axes(small) @ axes(-small).T).as_rotvec() / (2.0 * small) * rate
    with changing(simulation) as state:
        arm = -ARM * axes(0.0)[:, 2]
        state.bodies.position[0] = [*(joint + arm), *Rotation.from_matrix(axes(0.0)).as_quat()]
        state.bodies.velocity[0] = [*np.cross([0.0, 0.0, rate], arm), *spin]
        inwards = -(rate**2) * np.array([arm[0], arm[1], 0.0])
        for accelerations in (state.bodies.acceleration, state.bodies.algorithmic):
            accelerations[0, :3] = inwards
        state.multipliers[0] = 2.0 * (inwards + np.array([0.0, 0.0, GRAVITY]))
    return simulation, 2.0 * pi / rate


@case("conical pendulum", "ω² = g / (l cos θ)", needs_jit=True)
def conical_pendulum() -> Iterator[Result]:
    """Its height and energy through a turn, where it is after one, and the order in time."""
    errors = []
    for step in (16e-3, 8e-3, 4e-3):
        simulation, period = conical(step)
        start = simulation.state.bodies.position[0, :3].copy()
        joint = np.array(simulation.snapshot.carriages["cabin"].position)
        before = sum(energies(simulation.system, for_kernels(simulation)[0]))
        turns, heights = round(period / step), []
        for number in range(1, turns + 1):
            simulation.advance_to(number * step)
            heights.append(float(simulation.state.bodies.position[0, 2] - joint[2]))
        angle = 2.0 * pi * (turns * step / period - 1.0)
        apart = simulation.state.bodies.position[0, :3] - joint - tangent_frame(angle) @ (start - joint)
        errors.append(float(np.linalg.norm(apart)))
    yield Result("after a turn, apart", "m", 0.0, errors[-1], 1e-3)
    yield Result("lowest of a turn", "m", -ARM * cos(CONE), min(heights), 1e-3)
    yield Result("highest of a turn", "m", -ARM * cos(CONE), max(heights), 1e-3)
    after = sum(energies(simulation.system, for_kernels(simulation)[0]))
    yield Result("energy after a turn", "J", before, after, 1e-3 * 2.0 * GRAVITY * ARM * tan(CONE))
    yield Result("order in time", "-", 2.0, observed_order(errors), 0.1)


@case(
    "frequencies in space", "across n/(2 L) √(H/m), untouched by sag to first order; in the plane Irvine, Caughey 1974"
)
def frequencies_in_space() -> Iterator[Result]:
    """At three λ²; of all modes of a flat cable, those that move across the plane and those in it."""
    for ratio in RATIOS:
        simulation = Simulation(load_scenario(LEVEL_SPAN, {**flat_cable(ratio), "space": 3}))
        frequencies, shapes = natural_modes(simulation.system, simulation.state, 10)
        sizes = np.abs(shapes[:, :, 0]).max(axis=1)
        aside = sizes[:, 1] > sizes[:, 2]
        for kind, chosen, exact in (
            ("across", aside, STRING * np.arange(1.0, 4.0)),
            ("in the plane", ~aside, irvine_frequencies(ratio, STRING, 3)),
        ):
            for number, (want, got) in enumerate(zip(exact, frequencies[chosen][:3], strict=True), start=1):
                yield Result(f"λ² = {ratio:g}, {number} {kind}", "Hz", float(want), float(got), 0.01 * want)


@case("order of convergence, cantilever loaded askew", "elastica, in the plane of the load", needs_jit=True)
def order_of_elements() -> Iterator[Result]:
    """The force at the tip is turned about the clamp's axis by 0.7 rad, so is the elastica."""
    across, up = -sin(OBLIQUE), cos(OBLIQUE)
    x, z, _ = elastica(3.0, 1e2, "continuum")
    errors = []
    for elements in (8, 16, 32):
        load = {"arc_length": 1.0, "force": [0.0, -3.0 * across, -3.0 * up]}
        changes = {"space": 3, "cable.axial_stiffness": 1e2, "cable.elements": elements, "cable.loads": [load]}
        end = Simulation(load_scenario(CANTILEVER, changes)).cable_positions(np.ones(1))[0]
        errors.append(float(np.linalg.norm(end - [x, z * across, z * up])))
    yield Result("order, 8 to 16 elements", "-", 4.0, observed_order(errors[:2]), 0.05)
    yield Result("order, 16 to 32 elements", "-", 4.0, observed_order(errors), 0.05)
    yield Result("tip on 32 elements", "m", 0.0, errors[-1], 2e-8)


@case(
    "rope bent in plan over a tower",
    "side force of a groove 2 H sin β; its ratio to the normal force g y",
    needs_jit=True,
)
def groove() -> Iterator[Result]:
    """A tower 4 m beside the line of both ends, in the middle of 200 m."""
    aside, half, ratio = 4.0, 100.0, 20.0
    rope = {
        "unstrained_length": 200.3,
        "mass_per_length": 5.0,
        "axial_stiffness": 2e7,
        "bending_stiffness": 10.0,
        "elements": {"target": 4.0, "at_towers": 0.5, "growth": 1.5},
        "start": {"position": [0.0, 0.0, 0.0]},
        "end": {"position": [2.0 * half, 0.0, 0.0]},
    }
    tower = {"position": [half, aside, 2.0], "stiffness": 1e7, "groove": ratio}
    simulation = Simulation(load_scenario({"cable": rope, "towers": {"tower": tower}}))
    force = np.array(simulation.snapshot.supports["tower"].force)
    level = float(np.hypot(*simulation.snapshot.supports["start"].force[:2]))
    place = simulation.cable_positions(simulation.state.contact_arc_length)[0]
    expected = 2.0 * level * float(place[1]) / hypot(half, float(place[1]))
    yield Result("side force", "N", expected, float(force[1]), 2e-3 * expected)
    yield Result("ratio of the forces", "-", ratio * (aside - float(place[1])), float(force[1] / force[2]), 1e-6)
