"""Cases of towers: loads, friction, energy, and a cabin that passes over one."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import root

from cable_twin.mechanics.on_rope.tower import settle_towers
from cable_twin.mechanics.readout.sections import end_force
from cable_twin.mechanics.solution.equilibrium import settled
from cable_twin.mechanics.state import allocate_workspace
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation
from verification import Result, case
from verification.models import GRAVITY, changing, observed_order, start_moving
from verification.statics import catenary_end

Array = NDArray[np.float64]

TRAMWAY: dict[str, Any] = {
    "description": "tramway of 1000 m over one tower, with a counterweight",
    "cable": {
        "unstrained_length": 1010.0,
        "mass_per_length": 20.87,
        "axial_stiffness": 398e6,
        "bending_stiffness": 79e3,
        "elements": 200,
        "start": {"position": [0.0, 0.0]},
        "end": {
            "position": [1000.0, 100.0],
            "support": "counterweight",
            "direction": [0.99, 0.12],
            "mass": 80e3,
            "travel": [-8.0, 8.0],
        },
    },
    "towers": {"tower": {"position": [500.0, 80.0], "kind": "saddle", "contacts": 13, "length": 24.0, "radius": 40.0}},
    "solver": {"step": 0.005},
}
BUMP, ROUND, BEDDING = 2e4, 400.0, 2e5  # N, m and N/m per m: a load, radius and stiffness of a saddle
CABIN: dict[str, Any] = {
    "arc_length": 300.0,
    "drive": {"mode": "speed", "limits": {"acceleration": 0.3}},
    "bodies": {"cabin": {"mass": 12e3, "inertia": 24e3, "upper_pivot": [0.0, 4.0]}},
}


def tramway(*, cabin: dict[str, Any] | None = None, **overrides: Any) -> Simulation:
    """The tramway, with a cabin where `cabin` says how it differs; `cable__elements=50` overrides `cable.elements`."""
    scenario = {**TRAMWAY, "carriages": {"cabin": {**CABIN, **cabin}} if cabin is not None else {}}
    return Simulation(load_scenario(scenario, {key.replace("__", "."): value for key, value in overrides.items()}))


def over_a_circle(simulation: Simulation, radius: float) -> tuple[Array, Array, Array, float]:
    """Elastic catenaries on both sides of the circle of the tower, tangent to it, with one tension, by shooting.

    Returns:
        Force (2,) in N of the tower, forces (2,) in N at start and end, and the travel of the counterweight (m).
    """
    cable, supports, weights = simulation.system.cable, simulation.system.towers, simulation.system.counterweights
    weight, stiffness, length = cable.mass_per_length * GRAVITY, cable.axial_stiffness, cable.unstrained_length
    centre = supports.position[0] - radius * supports.normal[0]
    direction, given = weights.direction[1], float(weights.force[1])
    start, end = cable.end_position
    scale = np.array([given, given, length, 1.0, given, given, length, 1.0, length])

    def ends(unknown: Array) -> tuple[Array, ...]:
        first, s_1, angle_1, second, s_2, angle_2, travel = np.split(unknown * scale, [2, 3, 4, 6, 7, 8])
        before, after = first + np.array([0.0, weight * s_1[0]]), second + np.array([0.0, weight * s_2[0]])
        on, off = (centre + radius * np.array([np.sin(a[0]), np.cos(a[0])]) for a in (angle_1, angle_2))
        return first, before, second, after, on, off, angle_1, angle_2, s_1, s_2, travel

    def miss(unknown: Array) -> Array:
        first, before, second, after, on, off, angle_1, angle_2, s_1, s_2, travel = ends(unknown)
        arc = radius * (angle_2 - angle_1) / (1.0 + given / stiffness)
        return np.concatenate(
            [
                (start + catenary_end(first, weight, stiffness, s_1[0]) - on) / length,
                (off + catenary_end(second, weight, stiffness, s_2[0]) - end - travel * direction) / length,
                np.arctan2(-before[1], before[0]) - angle_1,
                np.arctan2(-second[1], second[0]) - angle_2,
                [(np.hypot(*second) - np.hypot(*before) - weight * (off - on)[1]) / given],
                [(after @ direction - given) / given],
                (s_1 + arc + s_2) / length - 1.0,
            ]
        )

    near = supports.top[0] - start
    share = float(np.hypot(*near)) / length
    guess = [1.0, near[1] / near[0] - 0.15, share, -0.1, 1.0, -0.1, 1.0 - share, 0.1, 0.0]
    found = root(miss, guess, method="hybr", tol=1e-13).x
    assert np.abs(miss(found)).max() < 1e-10
    first, before, second, after, _, _, angle_1, angle_2, _, _, travel = ends(found)
    arc = float((angle_2 - angle_1)[0]) * radius / (1.0 + given / stiffness)
    return before - second + np.array([0.0, weight * arc]), -first, after, float(travel[0])


@case("two spans over a saddle without friction", "Irvine 1981, tangent to a circle; one tension")
def frictionless_saddle() -> Iterator[Result]:
    """The tramway on elements of 2.5 m, a saddle of 25 contacts: loads, and the tension on either side of it."""
    radius = 40.0
    saddle = {"contacts": 25, "length": 12.0, "radius": radius, "friction": 0.0, "stiffness": 1e9}
    simulation = tramway(cable__elements=400, **{f"towers__tower__{key}": value for key, value in saddle.items()})
    snapshot = simulation.snapshot
    load, start, end, travel = over_a_circle(simulation, radius)
    got = {name: support.force[[0, 2]] for name, support in snapshot.supports.items()}
    size = float(np.hypot(*load))
    for axis, name in enumerate("xz"):
        yield Result(f"load on the tower, {name}", "N", float(load[axis]), float(got["tower"][axis]), 1e-3 * size)
    for name, force in (("start", start), ("end", end)):
        pull = float(np.hypot(*force))
        yield Result(f"pull at the {name}", "N", pull, float(np.hypot(*got[name])), 2e-4 * pull)
    yield Result("travel of the counterweight", "m", travel, snapshot.supports["end"].travel or 0.0, 5e-3)
    weight, at = 20.87 * GRAVITY, float(simulation.state.contact_arc_length[12])
    before = np.hypot(*(-got["start"] + np.array([0.0, weight * at])))
    after = np.hypot(*(got["end"] - np.array([0.0, weight * (1010.0 - at)])))
    yield Result("tension after the saddle less that before, share", "-", 0.0, float(after / before - 1.0), 5e-5)


def on_saddle(pitch: float, along: float = 0.0, dim: int = 2) -> dict[str, Any]:
    """Scenario of a load held on a saddle on a taut rope.

    Args:
        pitch: m, between contact points, which have the same stiffness per length.
        along: m, of the load from the point at the top.
        dim: 2 in a plane, 3 in space.
    """
    aside = [0.0] * (dim - 2)
    body = {"mass": BUMP / GRAVITY, "inertia": 100.0, "upper_pivot": [0.0, *aside, 1.0]}
    return {
        **({"space": 3} if dim == 3 else {}),
        "cable": {
            "unstrained_length": 199.75,
            "mass_per_length": 1.0,
            "axial_stiffness": 400e6,
            "bending_stiffness": 10.0,
            "elements": {"target": 10.0, "at_towers": 0.1, "growth": 1.5},
            "start": {"position": [0.0, *aside, 0.0]},
            "end": {"position": [200.0, *aside, 0.0]},
        },
        "towers": {
            "saddle": {
                "position": [100.0, *aside, 5.0],
                "kind": "saddle",
                "friction": 0.0,
                "length": 24.0,
                "radius": ROUND,
                "contacts": round(24.0 / pitch) + 1,
                "stiffness": BEDDING * pitch,
            }
        },
        # the middle of the rope, and its stretch
        "carriages": {"load": {"arc_length": 99.875 + along / 1.00257, "joint": "fixed", "bodies": {"body": body}}},
    }


@case("load on the contact points of a saddle", "line load: no bump, of F a/4T less what springs at distances a yield")
def bumps_of_a_saddle() -> Iterator[Result]:
    """How much higher a load stands on a contact point than between two, for points 1 and 0.5 m apart of equal k/a.

    Less than a fifth of what it would be on springs.
    """
    for dim, pitch in ((2, 1.0), (2, 0.5), (3, 1.0), (3, 0.5)):
        top, aside = (Simulation(load_scenario(on_saddle(pitch, way, dim))).snapshot for way in (0.0, 0.5 * pitch))
        (x, _, on), (beside_x, _, between) = (one.vehicles.position[0] for one in (top, aside))
        tension = float(aside.cable.tensions.min())
        falls = ((beside_x - x) ** 2 + 0.25 * pitch**2) / (2.0 * ROUND)  # the circle, and its chord below it
        h = np.sqrt(BEDDING * pitch**2 / tension)
        root_h = h * np.sqrt(1.0 + 0.25 * h * h)
        sinks = BUMP * pitch / tension * (0.25 + 0.5 / (root_h + 0.5 * h * h) - 0.5 / root_h)
        name = f"{'in space' if dim == 3 else 'in a plane'}, points {pitch:g} m apart: bump"
        yield Result(name, "m", 0.0, float(on - between - falls), 0.2 * float(sinks))


@case("all weight is on the supports", "Newton: at rest forces balance")
def weight_on_supports() -> Iterator[Result]:
    """A cabin in the second span of the tramway; towers, anchor, and what holds the end across its line."""
    simulation = tramway(cabin={"arc_length": 700.0, "joint": "fixed"})
    total = sum(support.force for support in simulation.snapshot.supports.values())
    weight = (20.87 * 1010.0 + 12e3) * GRAVITY
    yield Result("vertical forces over all weight", "-", 1.0, float(total[2]) / weight, 1e-6)
    yield Result("level forces over all weight", "-", 0.0, float(total[0]) / weight, 1e-6)


@case("friction on a train of sheaves", "capstan, exp(μ θ)", needs_jit=True)
def capstan() -> Iterator[Result]:
    """A rope without weight, bent by 0.2 rad over 12 contacts, pulled at one end and let back, in small steps."""
    span, rise, contacts, radius, pull = 50.0, 5.0, 12, 30.0, 1e5
    # each side is tangent to the circle, whose middle is the radius below the top
    angle = 2.0 * (np.arcsin(radius / np.hypot(span, radius - rise)) - np.arctan2(radius - rise, span))
    for coefficient in (0.1, 0.4):
        simulation = Simulation(
            load_scenario(
                {
                    "gravity": 0.0,
                    "cable": {
                        "unstrained_length": 100.5,
                        "mass_per_length": 5.0,
                        "axial_stiffness": 4e7,
                        "bending_stiffness": 10.0,
                        "elements": 200,
                        "start": {"position": [0.0, 0.0]},
                        "end": {
                            "position": [2.0 * span, 0.0],
                            "support": "counterweight",
                            "direction": [span, -rise],
                            "mass": 1e4,
                            "force": pull,
                        },
                    },
                    "towers": {
                        "train": {
                            "position": [span, rise],
                            "contacts": contacts,
                            "length": radius * float(angle),
                            "radius": radius,
                            "friction": coefficient,
                        }
                    },
                }
            )
        )
        for sign, name in ((1.0, "pulled"), (-1.0, "let back")):
            start, end = creep(simulation, np.linspace(1.0, 2.0, 21)[:: int(sign)][1:] * pull)
            ratio = end / start if sign > 0.0 else start / end
            expected = float(np.exp(coefficient * angle))
            label = f"tension ratio when {name}, friction {coefficient:g}"
            yield Result(label, "-", expected, ratio, 0.01 * (expected - 1.0))


def creep(simulation: Simulation, pulls: Array) -> tuple[float, float]:
    """Change the pull of the counterweight so slowly that the rope is always at rest; tensions (N) at both ends."""
    system, work = simulation.system, allocate_workspace(simulation.system)
    with changing(simulation) as state:
        for pull in pulls:
            weights = system.counterweights._replace(force=np.array([0.0, pull]))
            system = system._replace(counterweights=weights)
            assert settled(system, state, work, 1e-9).at_rest
            settle_towers(system.cable, system.towers, state, work)
        start, end = (float(np.hypot(*end_force(system, state, end))) for end in range(2))
    return start, end


@case("cabin over a tower", "weight goes straight into the tower; energy", needs_jit=True, long=True)
def passing_cabin() -> Iterator[Result]:
    """12 t at rest on the saddle, and at 7 m/s over it, in steps of 5 ms: no friction, damped only in the contacts.

    With the joint of the paper: the bend at a node sinks in between the few contacts of this saddle.
    """
    # both spans alike, so that nothing of the cabin's weight acts along the rope
    level = {
        "cable__end__position": [1000.0, 0.0],
        "cable__end__direction": [0.97, -0.2],
        "cable__start__position": [0.0, 0.0],
        "towers__tower__friction": 0.0,
        "cable__joint": "paper",
    }
    bare = tramway(**level)
    middle = float(bare.state.contact_arc_length[6])
    standing = tramway(cabin={"arc_length": middle, "joint": "fixed"}, **level)
    more = standing.snapshot.supports["tower"].force - bare.snapshot.supports["tower"].force
    yield Result("load that it adds, over its weight, z", "-", 1.0, float(more[2]) / (12e3 * GRAVITY), 2e-3)
    yield Result("load that it adds, over its weight, x", "-", 0.0, float(more[0]) / (12e3 * GRAVITY), 2e-3)
    simulation = tramway(cabin={}, towers__tower__friction=0.0, cable__joint="paper")
    start = simulation.energy().total
    simulation.command("cabin", speed=7.0)
    work, iterations, halvings, steps, worst, most = 0.0, 0, 0, 0, 0.0, 0.0
    loads = []
    before = power(simulation)
    while (snapshot := simulation.snapshot).carriages["cabin"].arc_length < 700.0:
        snapshot = simulation.advance_to(simulation.time + simulation.step)
        now = power(simulation)
        work += 0.5 * (before + now) * simulation.step
        before = now
        report = snapshot.solver
        iterations, halvings, steps = iterations + report.iterations, halvings + report.halvings, steps + report.steps
        most = max(most, abs(work))
        loads.append(float(np.linalg.norm(snapshot.carriages["cabin"].contact_force)) / (12e3 * GRAVITY))
        worst = max(worst, abs(simulation.energy().total - start - work))
    yield Result("steps that had to be halved", "-", 0.0, float(halvings), 0.0)
    yield Result("Newton iterations a step", "-", 1.0, iterations / steps, 0.3)
    yield Result("energy less work of the drive, worst, share of the most work", "-", 0.0, worst / most, 0.005)
    yield Result("contact force of the cabin over its weight, most", "-", 1.0, max(loads), 0.45)
    yield Result("contact force of the cabin over its weight, least", "-", 1.0, min(loads), 0.45)


def power(simulation: Simulation) -> float:
    """Power (W) of the drive of the cabin: its force along the rope times its way on the stretched rope."""
    cabin = simulation.snapshot.carriages["cabin"]
    s = np.array([cabin.arc_length - 1e-3, cabin.arc_length + 1e-3])
    here = simulation.cable_positions(s)
    return cabin.drive_force * cabin.speed * float(np.linalg.norm(here[1] - here[0])) / 2e-3


def plucked(friction: float, push: float, **solver: Any) -> Simulation:
    """The tramway without its cabin, thrown upwards by `push` (m/s) in its first span."""
    simulation = tramway(
        towers__tower__friction=friction, towers__tower__damping=0.0, **{f"solver__{k}": v for k, v in solver.items()}
    )
    with changing(simulation) as state:
        place = state.nodes.position[:, 0, 0]
        inside = (place > 0.0) & (place < 480.0)
        state.nodes.velocity[inside, 0, 1] += push * np.sin(np.pi * place[inside] / 480.0) ** 2
    return simulation


@case("energy of a rope on a tower", "never gained; friction only loses", needs_jit=True)
def energy_on_a_tower() -> Iterator[Result]:
    """A wave in the tramway for 20 s, with and without friction on the saddle."""
    losses = []
    for friction in (0.0, 0.1):
        simulation = plucked(friction, 4.0, step=2e-3, spectral_radius=0.9)
        start_moving(simulation)
        rest = tramway(towers__tower__friction=0.0).energy().total
        energies = [simulation.energy().total - rest]
        for frame in range(1, 201):
            simulation.advance_to(0.1 * frame)
            energies.append(simulation.energy().total - rest)
        gain = max(energies) / energies[0] - 1.0
        losses.append(1.0 - energies[-1] / energies[0])
        yield Result(f"largest gain over the start, share, friction {friction:g}", "-", 0.0, gain, 1e-6)
    yield Result("loss in 20 s without friction, share", "-", 0.0, losses[0], 1e-5)
    yield Result("friction loses more", "-", 1.0, float(losses[1] > 100.0 * losses[0]), 0.0)


@case("order in time over a tower", "2, as without one", needs_jit=True)
def order_over_a_tower() -> Iterator[Result]:
    """A small wave that never lifts the rope off, after 1 s: steps of 4, 2 and 1 ms against one of 0.25 ms."""
    places = []
    for step in (4e-3, 2e-3, 1e-3, 2.5e-4):
        simulation = plucked(0.0, 0.2, step=step, tolerance=1e-12)
        start_moving(simulation)
        simulation.advance_to(1.0)
        places.append(simulation.state.nodes.position[:, 0].copy())
    errors = [float(np.abs(place - places[-1]).max()) for place in places[:-1]]
    yield Result("order", "-", 2.0, observed_order(errors), 0.15)


@case("two integrators over a tower", "the paper's integrator", needs_jit=True)
def two_integrators() -> Iterator[Result]:
    """A soft rope with a counterweight thrown up and about on a rough saddle, 1 s; the explicit one at 0.1 ms."""
    places = {}
    for integrator, step in (("runge_kutta", 1e-4), ("generalized_alpha", 1e-3), ("generalized_alpha", 5e-4)):
        end = {"position": [100.0, -4.0], "support": "counterweight", "direction": [1.0, -0.1], "mass": 300.0}
        simulation = Simulation(
            load_scenario(
                {
                    "cable": {
                        "unstrained_length": 98.0,
                        "mass_per_length": 1.0,
                        "axial_stiffness": 1e5,
                        "bending_stiffness": 50.0,
                        "elements": 40,
                        "start": {"position": [0.0, 0.0]},
                        "end": end,
                    },
                    "towers": {
                        "saddle": {
                            "position": [50.0, 3.0],
                            "contacts": 3,
                            "length": 5.0,
                            "radius": 15.0,
                            "stiffness": 1e5,
                            "friction": 0.2,
                        }
                    },
                    "solver": {"integrator": integrator, "step": step, "spectral_radius": 0.9, "tolerance": 1e-10},
                }
            )
        )
        with changing(simulation) as state:
            x = state.nodes.position[:, 0, 0]
            state.nodes.velocity[x < 50.0, 0, 1] += 2.0 * np.sin(np.pi * x[x < 50.0] / 50.0) ** 2
        start_moving(simulation)
        simulation.advance_to(1.0)
        places[integrator, step] = simulation.state.nodes.position[:, 0].copy()
    exact = places["runge_kutta", 1e-4]
    for step, tolerance in ((1e-3, 1e-4), (5e-4, 5e-5)):
        worst = float(np.abs(places["generalized_alpha", step] - exact).max())
        yield Result(f"largest distance of a node after 1 s, {1e3 * step:g} ms", "m", 0.0, worst, tolerance)


@case("rope thrown off a tower", "never adhesive: it lifts off and lands", needs_jit=True)
def deropement() -> Iterator[Result]:
    """The whole rope thrown upwards at 12 m/s leaves the saddle and comes back."""
    simulation = tramway(towers__tower__friction=0.0)
    with changing(simulation) as state:
        place = state.nodes.position[:, 0, 0]
        state.nodes.velocity[1:-1, 0, 1] += 12.0 * np.sin(np.pi * place[1:-1] / 1000.0)
    off, least, highest, landed, halvings = False, np.inf, 0.0, False, 0
    for frame in range(1, 1001):
        snapshot = simulation.advance_to(0.01 * frame)
        tower = snapshot.supports["tower"].tower
        assert tower is not None
        halvings += snapshot.solver.halvings
        least = min(least, tower.normal_load)
        landed = landed or (off and not tower.lifted_off)
        off = off or tower.lifted_off
        highest = max(highest, float(simulation.cable_positions(simulation.state.contact_arc_length)[6, 2]))
    yield Result("lifts off and lands", "-", 1.0, float(off and landed), 0.0)
    yield Result("least load, that kept by the twin", "N", least, tower.lowest_load, 0.0)
    yield Result("rises above the saddle", "-", 1.0, float(highest > 80.0), 0.0)
    yield Result("steps that had to be halved", "-", 0.0, float(halvings), 0.0)
