"""Cases of closed loops of rope over bullwheels: statics, adhesion, longitudinal modes, tensioning, balances."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.linalg import eigh
from scipy.optimize import brentq

from cable_twin.mechanics.on_rope.sliding_joint import joint_tangent
from cable_twin.mechanics.parameters import FloatArray
from cable_twin.mechanics.rope.ale import rest_stretch, rope_before
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation
from verification import Result, case
from verification.models import moving, observed_order

BODY = {"chair": {"mass": 500.0, "inertia": 200.0, "upper_pivot": [0.0, 2.5]}}


def loop(
    *,
    length: float = 208.5,
    top: tuple[float, ...] = (200.0, 60.0),
    rope: dict[str, Any] | None = None,
    drive: dict[str, Any] | None = None,
    back: dict[str, Any] | None = None,
    limits: dict[str, float] | None = None,
    **rest: Any,
) -> Simulation:
    """Two strands of `length` (m) from the origin to `top` and back, without towers; `rest` is of the scenario.

    The bullwheel `drive` is at the top, and its drive is `haul_rope`; `back` is what the other one, `return`, has.
    """
    bottom = [0.0] * len(top)
    strand = {
        "unstrained_length": length,
        "mass_per_length": 6.0,
        "axial_stiffness": 60e6,
        "bending_stiffness": 0.0,
        "elements": 40,
        "damping_time": 0.0,
        **(rope or {}),
    }
    return Simulation(
        load_scenario(
            {
                "ropes": {
                    "up": {**strand, "start": {"position": bottom}, "end": {"position": list(top)}},
                    "down": {**strand, "start": {"position": list(top)}, "end": {"position": bottom}},
                },
                "sheaves": {
                    "drive": {
                        "radius": 2.0,
                        "joins": ["up.end", "down.start"],
                        "inertia": 40e3,
                        "drive": {"name": "haul_rope", "limits": limits or {}},
                        **(drive or {}),
                    },
                    "return": {"radius": 2.0, "joins": ["down.end", "up.start"], "inertia": 8e3, **(back or {})},
                },
                **rest,
            }
        ),
        samples=2,
        on_demand=True,
    )


def wheels(simulation: Simulation) -> Any:
    """Motion of the bullwheels, as a view of the kernels' data."""
    return simulation._engine.loop.motion  # type: ignore[attr-defined]


def by_rope(tension: Any, axial: float) -> Any:
    """Force (N) by the unstrained rope that goes by, ∂W/∂ε (1 + ε) - W = T (1 + T/(2 EA)); times its rate the power."""
    return tension * (1.0 + 0.5 * tension / axial)


def tangential_weights(simulation: Simulation) -> float:
    """Σ m g·r_X (N) of the carriers of one body on a loop, along both strands, by its slopes; X is unstrained rope."""
    total = 0.0
    for part in simulation._parts:
        system, state = part.system, part.state
        for carrier in np.flatnonzero(part.riding).tolist():
            along = joint_tangent(system.cable, state, carrier)[-1] / rest_stretch(system.cable, state)
            total += float(system.carriages.mass[carrier] * -system.cable.gravity[-1] * along)
    return total


@case("loop at rest", "first integral of an elastic rope: T (1 + T/(2 EA)) + ½ EI κ² less its weight times height")
def statics() -> Iterator[Result]:
    """One chair full up, one empty down; a mesh that resolves how the rope bends at its grips, √(EI / T) = 10 m."""
    weight = {"direction": [-0.958, -0.287], "mass": 9000.0}
    first, spacing = 120.0, 200.0  # where a grip is on a node its slope is as accurate as the forces
    for _ in range(4):
        simulation = loop(
            length=210.0,
            rope={"bending_stiffness": 5e6, "elements": 210, "joint": "paper"},
            back={"counterweight": weight},
            carriers={
                "name": "chair",
                "count": 2,
                "first": first,
                "spacing": spacing,
                "bodies": BODY,
                "payload": {"capacity": 400.0, "leaving": {"return": 400.0, "drive": 0.0}},
            },
        )
        there = [float(part.state.joints.position[part.riding][0]) for part in simulation._parts]
        off = [round(place) - place for place in there]
        first, spacing = first + off[0], spacing + off[1] - off[0]
    motion = wheels(simulation)
    (on, off), (came, went) = by_rope(motion.tension, 60e6)
    expected = tangential_weights(simulation)
    yield Result("forces at the drive: all tangential weights", "N", expected, on - off, 1e-6 * expected)
    force = simulation.snapshot.columns.sheave_force[0]
    yield Result("force of the drive that holds it", "N", on - off, float(force), 1e-6 * expected)
    yield Result("difference at the bullwheel that turns freely", "N", 0.0, went - came, 1e-3)
    yield Result("its weight on the counterweight", "N", 9000.0 * 9.81, float(motion.pull[1]), 1e-3)


@case("adhesion of a bullwheel", "Eytelwein 1808: ratio of tensions exp(friction times wrap)", needs_jit=True)
def adhesion() -> Iterator[Result]:
    """A drive that turns up its acceleration before a heavy return wheel, until the rope slips; then it stops."""
    simulation = loop(
        drive={"friction": 0.1},
        back={"inertia": 80e3},
        limits={"acceleration": 4.0, "jerk": 0.5},
        solver={"step": 0.01},
    )
    motion, most, sticking, slipping = wheels(simulation), np.exp(0.1 * np.pi), [1.0], []
    simulation.command("haul_rope", speed=12.0)
    while simulation.time < 8.0:
        was = bool(motion.slipping[0])
        simulation.advance_to(simulation.time + 0.01)
        ratio = motion.tension[0, 0] / motion.tension[0, 1]
        (slipping if was and motion.slipping[0] else sticking).append(float(ratio))
    yield Result("ratio of its tensions, up to which it holds", "-", most, max(sticking), 1e-3 * most)
    yield Result("the same while it slips, mean", "-", most, float(np.mean(slipping)), 1e-3 * most)
    gone = float(motion.rim.position[0] - motion.rope.position[0])
    yield Result("the rim is ahead of the rope, at least", "m", 2.0, min(gone, 2.0), 0.0)
    simulation.command("haul_rope", speed=0.0)
    simulation.advance_to(30.0)
    stands = simulation.snapshot.columns.sheave_slip[0]
    simulation.advance_to(31.0)
    again = float(simulation.snapshot.columns.sheave_slip[0])
    yield Result("it holds again", "m", float(stands), again, 1e-9)


LEVEL = {"length": 199.9, "top": (200.0, 0.0), "gravity": 0.0}  # m, m, m/s²: taut, with T = 30 kN
DRIVE, BACK = (inertia / 4.0 + 2.0 * np.pi * 6.0 for inertia in (40e3, 8e3))  # kg at the rims, with rope, of `loop`
ROPE = np.sqrt(60e6 * 6.0), np.sqrt(60e6 / 6.0)  # kg/s, m/s: impedance and speed of waves


def chain(masses: tuple[float, float], carriage: float, links: int = 1500) -> FloatArray:
    """Lowest frequencies (Hz) of two wheels and both strands as a ring of springs and masses.

    With the mass of a `carriage` (kg), of a wheel that moves and does not turn, beside one that is held.
    """
    mass, stiff = 6.0 * LEVEL["length"] / links, 60e6 * links / LEVEL["length"]
    if carriage:  # both strands alike: one of them, with half the carriage
        m = np.full(links, mass)
        m[-1] = 0.5 * (mass + carriage)
        k = np.diag(np.full(links, 2.0 * stiff)) - np.diag(np.full(links - 1, stiff), 1)
        k -= np.diag(np.full(links - 1, stiff), -1)
        k[-1, -1] = stiff
    else:
        m = np.full(2 * links, mass)
        m[0], m[links] = masses[0] + mass, masses[1] + mass
        k = 2.0 * stiff * np.eye(2 * links) - stiff * (np.eye(2 * links, k=1) + np.eye(2 * links, k=-1))
        k[0, -1] = k[-1, 0] = -stiff
    root = 1.0 / np.sqrt(m)
    found = eigh(root[:, None] * k * root, eigvals_only=True, subset_by_index=[0, 3])
    return np.sqrt(np.maximum(found, 0.0)) / (2.0 * np.pi)


def ringing(series: FloatArray, step: float, guess: float) -> tuple[float, float]:
    """Frequency (Hz) and damping ratio of what rings near `guess` (Hz): its phase and size in two halves of a run."""
    time, half = step * np.arange(series.size), series.size // 2
    series = series - np.polyval(np.polyfit(time, series, 1), time)
    turned = series * np.exp(-2j * np.pi * guess * time)
    window = np.hanning(half)
    first, second = (turned[:half] * window).sum(), (turned[half : 2 * half] * window).sum()
    frequency = guess + float(np.angle(second / first)) / (2.0 * np.pi * time[half])
    return frequency, -float(np.log(abs(second / first))) / (2.0 * np.pi * guess * time[half])


def rung(simulation: Simulation, duration: float, what: str) -> FloatArray:
    """Rate of the rope or of the carriage at the return wheel in every step of a run."""
    motion, series = wheels(simulation), []
    for _ in range(round(duration / simulation.step)):
        simulation.advance_to(simulation.time + simulation.step)
        series.append(getattr(motion, what).velocity[1])
    return np.array(series)


@case(
    "longitudinal modes of a loop", "chain of springs and masses; rod with a mass at its end", needs_jit=True, long=True
)
def modes() -> Iterator[Result]:
    """Level, without weight: the return wheel against a held drive, both free, the carriage of a counterweight."""
    impedance, wave = ROPE

    def held(omega: float) -> float:
        return BACK * omega - 2.0 * impedance / np.tan(omega * LEVEL["length"] / wave)

    expected = brentq(held, 1.0, 0.49 * np.pi * wave / LEVEL["length"]) / (2.0 * np.pi)
    simulation = loop(**LEVEL, limits={"acceleration": 1.0}, solver={"step": 0.005})
    simulation.command("haul_rope", speed=0.01)
    simulation.advance_to(0.1)
    frequency, damping = ringing(rung(simulation, 8.0, "rope"), 0.005, expected)
    yield Result("return wheel, drive held", "Hz", expected, frequency, 5e-3 * expected)
    yield Result("its damping by the method, of the critical one", "-", 0.0, damping, 1e-3)

    simulation = loop(**LEVEL, rope={"damping_time": 5e-4}, limits={"acceleration": 1.0}, solver={"step": 0.005})
    simulation.command("haul_rope", speed=0.01)
    simulation.advance_to(0.1)
    _, damping = ringing(rung(simulation, 8.0, "rope"), 0.005, expected)
    yield Result("damping with τ = 0.5 ms: ½ τ ω", "-", 5e-4 * np.pi * expected, damping, 0.05 * damping)

    expected = float(chain((DRIVE, BACK), 0.0)[1])
    simulation = loop(**LEVEL, solver={"step": 0.005})
    simulation.command("haul_rope", force=500.0)
    frequency, damping = ringing(rung(simulation, 8.0, "rope"), 0.005, expected)
    yield Result("both wheels free", "Hz", expected, frequency, 5e-3 * expected)
    yield Result("its damping by the method", "-", 0.0, damping, 1e-3)

    weight = {"direction": [-1.0, 0.0], "mass": 5000.0, "force": 60e3}
    expected = float(chain((0.0, 0.0), 5000.0)[0])
    simulation = loop(**LEVEL, back={"counterweight": weight}, solver={"step": 0.005})
    wheels(simulation).carriage.velocity[1] = 0.01
    frequency, damping = ringing(rung(simulation, 8.0, "carriage"), 0.005, expected)
    yield Result("counterweight on both strands", "Hz", expected, frequency, 5e-3 * expected)
    yield Result("its damping by the method", "-", 0.0, damping, 1e-3)


@case("a small swing of a lift", "the same with a tolerance of 1e-12 m", needs_jit=True, long=True)
def small_swing() -> Iterator[Result]:
    """The shipped chairlift, its rope undamped: its drive holds with a force, and the rope is pushed along; 40 s."""
    undamped = {f"ropes.{rope}.damping_time": 0.0 for rope in ("up", "down")}
    for step in (0.001, 0.01):
        swings = []
        for tolerance in (1e-12, 1e-9):
            solver = {"solver.step": step, "solver.tolerance": tolerance}
            simulation = Simulation(load_scenario("chairlift", {**undamped, **solver}), samples=2, on_demand=True)
            simulation.command("haul_rope", force=float(simulation.snapshot.columns.sheave_force[0]))
            motion = wheels(simulation)
            motion.rope.velocity[:] = motion.rim.velocity[:] = 1e-3
            simulation.advance_to(30.0)
            swings.append(1e3 * float(np.std(rung(simulation, 10.0, "rope"))))
        yield Result(f"rms of 30 to 40 s, {step * 1e3:g} ms", "mm/s", *swings, 5e-3 * swings[0])


@case("station rails", "1 - 10 u³ + 15 u⁴ - 6 u⁵ of the weight; steps of half the size")
def rails() -> Iterator[Result]:
    """The rope bears the rest of a cabin that stands on them; one that comes from them has one contact force."""
    rails, place = 12.0, 4.0  # m
    for space in (2, 3):
        changes = {"carriers.station_rails": rails, "carriers.first": place, "space": space}
        simulation = Simulation(load_scenario("gondola", changes), samples=2)
        columns, system = simulation.snapshot.columns, simulation.parts["up"].system
        first = int(np.argmin(np.where(columns.attached == 1.0, columns.arc_length, np.inf)))
        u = float(columns.arc_length[first]) / rails
        weight = (
            simulation.scenario.gravity * system.carriages.mass[slice(*system.carriages.body_offset[first:][:2])].sum()
        )
        left = 1e-3 * weight * (10.0 * u**3 - 15.0 * u**4 + 6.0 * u**5)
        got = 1e-3 * float(columns.contact_force[first, 2])
        yield Result(f"weight on the rope at rest, {'plane' if space == 2 else 'space'}", "kN", left, got, 1e-6 * left)
    highest = []
    for step in (0.005, 0.01):
        simulation = Simulation(
            load_scenario("gondola", {"solver.step": step, "drives.haul_rope.speed": 6.0}), samples=2
        )
        most = 0.0
        for frame in range(1, 3001):
            columns = simulation.advance_to(0.01 * frame).columns
            counts = (columns.attached == 1.0) & (columns.vehicle_rope == 0.0) & (columns.arc_length < 60.0)
            most = max(most, float(np.linalg.norm(columns.contact_force[counts], axis=1).max(initial=0.0)))
        highest.append(1e-3 * most)
    yield Result("highest contact force up to behind the first tower", "kN", *highest, 0.01 * highest[0])


@case("order in the step, of a loop", "generalized-alpha is of second order", needs_jit=True)
def order() -> Iterator[Result]:
    """Both wheels free and ringing: how far the return wheel has gone after a second, from one and the same state."""
    damped = {**LEVEL, "rope": {"damping_time": 2e-3}}  # what a step of the force leaves of a wave front fades
    fine = loop(**damped, solver={"step": 0.0005, "tolerance": 1e-12})
    fine.command("haul_rope", force=5000.0)
    fine.advance_to(1.0)
    state, gone = fine.capture(), []
    for step in (0.02, 0.01, 0.005, 0.0005):
        simulation = loop(**damped, solver={"step": step, "tolerance": 1e-12})
        simulation.restore(replace(state, scenario=simulation.scenario))
        simulation.advance_to(simulation.time + 1.0)
        gone.append(float(wheels(simulation).rope.position[1]))
    errors = [abs(one - gone[-1]) for one in gone[:-1]]
    yield Result("observed order", "-", 2.0, observed_order(errors), 0.3)


@case("rope of a loop", "no rope is lost: Σ λ L, and the way from carrier to carrier", needs_jit=True, long=True)
def conserved() -> Iterator[Result]:
    """The shipped chairlift for 70 s: start, emergency stop, reversal, stop. An hour of it: docs/long_runs.md."""
    simulation = Simulation(load_scenario("chairlift"))
    start, worst, between = rope_of(simulation), 0.0, 0.0
    events = {0: 2.5, 25: None, 32: -2.5, 60: 0.0}
    for second in range(70):
        if second in events:
            if events[second] is None:
                simulation.emergency_stop()
            else:
                simulation.emergency_stop(False)
                simulation.command("haul_rope", speed=events[second])
        simulation.advance_to(second + 1.0)
        worst = max(worst, abs(rope_of(simulation) - start))
        between = max(between, spacing_error(simulation))
    yield Result("unstrained length", "m", start, start + worst, 1e-9 * start)
    yield Result("from carrier to carrier, largest error", "m", 0.0, between, 1e-9 * start)


def rope_of(simulation: Simulation) -> float:
    """Unstrained rope (m) on all strands."""
    return sum(
        rest_stretch(part.system.cable, part.state) * part.system.cable.unstrained_length for part in simulation._parts
    )


def spacing_error(simulation: Simulation) -> float:
    """Largest error of the unstrained rope (m) between two carriers of a strand."""
    worst = 0.0
    for part in simulation._parts:
        on = np.sort(part.state.joints.position[part.riding])
        places = [rope_before(part.system.cable, part.state, place) for place in on.tolist()]
        worst = max(worst, float(np.abs(np.diff(places) - part.scenario.spacing).max(initial=0.0)))
    return worst


@case("energy of a loop", "first law: work of the drive", needs_jit=True)
def energy() -> Iterator[Result]:
    """Chairs up and down, none comes on or off: start, stop, back again, and a coast; no damping but the method's."""
    simulation = loop(
        length=209.5,
        rope={"bending_stiffness": 1e5, "elements": 100},
        back={"counterweight": {"direction": [-0.958, -0.287], "mass": 9000.0}},
        limits={"acceleration": 0.3, "jerk": 0.3},
        carriers={"name": "chair", "count": 4, "first": 60.0, "spacing": 100.0, "bodies": BODY},
        solver={"step": 0.01, "spectral_radius": 0.9},
    )
    motion, start = wheels(simulation), simulation.energy().total
    work, through, gap, power = 0.0, 0.0, 0.0, 0.0
    events = {0: 1.5, 16: 0.0, 24: -1.5, 36: 0.0}
    while simulation.time < 40.0 - 1e-9:
        second = round(simulation.time, 9)
        if second in events:
            simulation.command("haul_rope", speed=events[int(second)])
        snapshot = simulation.advance_to(simulation.time + 0.01)
        now = float(snapshot.columns.sheave_force[0] * motion.rim.velocity[0])
        work, through = work + 0.005 * (power + now), through + 0.005 * abs(power + now)
        power = now
        gap = max(gap, abs(work - simulation.energy().total + start))
    yield Result("largest gap over all work of the drive", "%", 0.0, 100.0 * gap / through, 0.2)


@case("tensioning of a loop", "straight elastic ropes: travel L (1 + F/(2 EA)) - D")
def tensioning() -> Iterator[Result]:
    """Level, without weight: a pull of F on both strands, and strands that a warm day makes longer."""
    for force, length in ((60e3, 199.9), (90e3, 199.9), (60e3, 199.9 * (1.0 + 12e-6 * 30.0))):
        weight = {"direction": [-1.0, 0.0], "mass": 5000.0, "force": force}
        simulation = loop(**{**LEVEL, "length": length}, back={"counterweight": weight})
        expected = length * (1.0 + 0.5 * force / 60e6) - 200.0
        got = float(simulation.snapshot.columns.sheave_travel[1])
        yield Result(f"travel, {force / 1e3:g} kN, {length:.6g} m", "m", expected, got, 1e-7)


@case("hydraulic tensioning of a loop", "its law: moves where the pull has left its band", needs_jit=True, long=True)
def hydraulics() -> Iterator[Result]:
    """Chairs that go up and down a loop; the cylinder moves, and one that is locked does not."""
    for locked in (False, True):
        cylinder = {"direction": [-0.958, -0.287], "force": 88e3, "band": 800.0, "rate": 0.05, "locked": locked}
        simulation = loop(
            length=208.5,
            rope={"bending_stiffness": 1e5, "damping_time": 0.02},
            back={"hydraulics": cylinder},
            limits={"acceleration": 0.05, "jerk": 0.05},
            carriers={"name": "chair", "count": 4, "first": 60.0, "spacing": 100.0, "bodies": BODY},
        )
        motion = wheels(simulation)
        start, first = float(motion.carriage.position[1]), float(motion.tension[1].sum())
        pulls, moved = [], 0.0
        simulation.command("haul_rope", speed=1.0)
        while simulation.time < 40.0:
            simulation.advance_to(simulation.time + 0.1)
            pulls.append(float(motion.tension[1].sum()))
            moved = max(moved, abs(float(motion.carriage.position[1]) - start))
        off = max(abs(one - first) for one in pulls)
        if locked:
            yield Result("locked: its tensions leave the band, at least", "N", 2000.0, min(off, 2000.0), 0.0)
            yield Result("locked: travel", "m", 0.0, moved, 0.0)
        else:
            yield Result("its tensions stay in the band, and a tenth more", "N", 0.0, off, 880.0)
            yield Result("it moves, at least", "m", 0.02, min(moved, 0.02), 0.0)


@case("strand of a loop", "a cable that moves along itself as a whole", needs_jit=True)
def as_one_cable() -> Iterator[Result]:
    """Both bullwheels driven alike against each strand as a single moving cable: 10 s, one start."""
    limits = {"acceleration": 0.4, "jerk": 0.5}
    given = {"mass_per_length": 6.0, "bending_stiffness": 3e3, "elements": 40, "damping_time": 0.004}
    simulation = loop(limits=limits, rope=given, back={"drive": {"name": "second", "limits": limits}})
    alone = moving(
        unstrained_length=208.5,
        end=(200.0, 60.0),
        axial=60e6,
        limits=limits,
        mass_per_length=6.0,
        bending=3e3,
        elements=40,
        damping_time=0.004,
    )
    alone.command("haul_rope", speed=2.0)
    for name in ("haul_rope", "second"):
        simulation.command(name, speed=2.0)
    places, worst = np.linspace(0.0, 208.5, 80), 0.0
    for second in range(1, 11):
        simulation.advance_to(float(second))
        alone.advance_to(float(second))
        apart = simulation.cable_positions(places, "up") - alone.cable_positions(places)
        worst = max(worst, float(np.abs(apart).max()))
    yield Result("apart, at most", "m", 0.0, worst, 1e-9)


@case("loop in space", "the same in a plane", needs_jit=True)
def in_space() -> Iterator[Result]:
    """Loop with chairs in a plane and in space, 3 s from rest."""
    seen = []
    for top in ((200.0, 60.0), (200.0, 0.0, 60.0)):
        simulation = loop(
            top=top,
            limits={"acceleration": 0.5},
            rope={"bending_stiffness": 3e3, "elements": 20},
            carriers={"name": "chair", "count": 4, "first": 60.0, "spacing": 100.0, "bodies": BODY},
        )
        simulation.command("haul_rope", speed=2.0)
        simulation.advance_to(3.0)
        places = np.linspace(0.0, 208.5, 50)
        seen.append(np.stack([simulation.cable_positions(places, rope) for rope in ("up", "down")]))
    yield Result("apart, at most", "m", 0.0, float(np.abs(seen[0] - seen[1]).max()), 1e-9)
