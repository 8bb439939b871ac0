"""Cases of a cable that moves along itself: string and catenary under way, carriers, balance of an open system."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.linalg import eig

from cable_twin.mechanics.language.compilation import kernel
from cable_twin.mechanics.language.vectors import dot, scale, subtract
from cable_twin.mechanics.parameters import FloatArray, System
from cable_twin.mechanics.readout.sections import end_force
from cable_twin.mechanics.rope.ale import mesh_dilution_rate, nodal_vectors, rest_stretch
from cable_twin.mechanics.rope.elastic_models import elastic_force
from cable_twin.mechanics.rope.element import rates_of_strain
from cable_twin.mechanics.rope.patch import beside_load, motion_of_rope
from cable_twin.mechanics.solution.equations_of_motion import assemble
from cable_twin.mechanics.solution.equilibrium import catenary, settled
from cable_twin.mechanics.state import State, allocate_workspace
from cable_twin.simulation import Simulation
from verification import Result, case
from verification.models import chairlift, changing, for_kernels, moving

STRING_LENGTH, STRING_END = 99.0, 99.1  # m, unstrained and held
STRING = {"unstrained_length": STRING_LENGTH, "end": (STRING_END, 0.0), "gravity": 0.0, "axial": 1e7, "bending": 0.0}


def set_speed(simulation: Simulation, speed: float, rate: float = 0.0) -> None:
    """Let the cable move at once, at a speed (m/s) and acceleration (m/s²)."""
    with changing(simulation) as state:
        for array, value in zip(state.rope, (0.0, speed, rate), strict=True):
            array[:] = value
        state.rope_drive.target[0] = speed


def settle_moving(simulation: Simulation) -> FloatArray:
    """Bring a cable to its steady shape at its present speed; returns the forces (2, dim) in N of its supports."""
    system = simulation.system
    length = system.cable.unstrained_length
    with changing(simulation) as state:
        settled(system, state, allocate_workspace(system), 1e-11 * length)
        return np.array([end_force(system, state, end) for end in range(2)])


def linearised(simulation: Simulation) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Mass, gyroscopic and stiffness matrix across a straight string, from the solver's own tangents; free unknowns."""
    system, (state, work) = simulation.system, for_kernels(simulation)
    matrices = []
    for factors in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)):
        assemble(system, state, *factors, work)
        nodes = work.diagonal.shape[0]
        matrix = np.zeros((2 * nodes, 2 * nodes))
        for k in range(nodes):  # entry 3 of a block is z against z
            matrix[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = work.diagonal[k, :, :, 3]
            if k < nodes - 1:
                matrix[2 * k : 2 * k + 2, 2 * k + 2 : 2 * k + 4] = work.upper[k, :, :, 3]
                matrix[2 * k + 2 : 2 * k + 4, 2 * k : 2 * k + 2] = work.lower[k, :, :, 3]
        matrices.append(matrix)
    free = np.ones(2 * nodes, dtype=bool)
    free[[0, -2]] = False
    mass, gyroscopic, stiffness = (matrix[np.ix_(free, free)] for matrix in matrices)
    return mass, gyroscopic, stiffness, free


def string_modes(simulation: Simulation) -> tuple[FloatArray, FloatArray]:
    """Frequencies (rad/s), rising, and complex shapes of (λ²M + λG + K) x = 0."""
    mass, gyroscopic, stiffness, _ = linearised(simulation)
    size = mass.shape[0]
    identity, nothing = np.eye(size), np.zeros((size, size))
    values, vectors = eig(
        np.block([[nothing, identity], [-stiffness, -gyroscopic]]),
        np.block([[identity, nothing], [nothing, mass]]),
    )
    order = np.argsort(values.imag)
    order = order[values.imag[order] > 0.0]
    return values.imag[order], vectors[:size, order]


@case("moving taut string", "Skutch 1897; Miranker 1960: ω_n = nπ (c² - v²)/(cL)")
def moving_string() -> Iterator[Result]:
    """Eigenvalues of the solver's tangents; c and v by unstrained length, so c² = N/(|r_x| ρA)."""
    for share in (0.0, 0.2, 0.5, 0.8):
        simulation = moving(**STRING, elements=40)
        cable = simulation.system.cable
        stretch = STRING_END / STRING_LENGTH
        wave = np.sqrt(cable.axial_stiffness * (stretch - 1.0) / (stretch * cable.mass_per_length))
        set_speed(simulation, share * wave)
        got, _ = string_modes(simulation)
        for n in (1, 2, 3):
            expected = n * np.pi * wave * (1.0 - share**2) / STRING_LENGTH
            where = f"ω{n} at v = {share:g} c"
            yield Result(where, "rad/s", expected, float(got[n - 1]), 1e-6 * expected)


@case("moving taut string in time", "the same", needs_jit=True)
def moving_string_in_time() -> Iterator[Result]:
    """The first mode at v = 0.5 c, 20 periods of a simulation from its complex shape, 200 steps each."""
    wave = np.sqrt(1e7 * (STRING_END / STRING_LENGTH - 1.0) / (STRING_END / STRING_LENGTH * 5.0))
    expected = np.pi * wave * 0.75 / STRING_LENGTH
    step = 2.0 * np.pi / expected / 200
    simulation = moving(**STRING, elements=40, step=float(step), spectral_radius=1.0, tolerance=1e-10)
    set_speed(simulation, 0.5 * wave)
    _, shapes = string_modes(simulation)
    _, _, _, free = linearised(simulation)
    shape = 1e-3 * shapes[:, 0] / np.abs(shapes[:, 0]).max()
    with changing(simulation) as state:
        for array, values in (
            (state.nodes.position, shape.real),
            (state.nodes.velocity, (1j * expected * shape).real),
        ):
            flat = array[:, :2, 1].ravel()
            flat[free] = values
            array[..., 1] = flat.reshape(-1, 2)[:, [0, 1, 1]]
        state.nodes.acceleration[..., 1] = -(expected**2) * state.nodes.position[..., 1]
        state.nodes.algorithmic[:] = state.nodes.acceleration
    heights = []
    for k in range(20 * 200 + 100):
        simulation.advance_to((k + 1) * simulation.step)
        heights.append(float(simulation.cable_positions(np.array([0.5 * STRING_LENGTH]))[0, 2]))
    height = np.array(heights)
    rising = np.flatnonzero((height[:-1] < 0.0) & (height[1:] >= 0.0))
    times = (rising - height[rising] / (height[rising + 1] - height[rising])) * simulation.step
    got = 2.0 * np.pi * (times.size - 1) / (times[-1] - times[0])
    yield Result("periods seen", "-", 20.0, float(times.size), 1.0)
    yield Result("ω1 at v = 0.5 c", "rad/s", expected, float(got), 2e-4 * expected)


@case("moving catenary", "catenary at rest, with the tension less m v² for the tension")
def moving_catenary() -> Iterator[Result]:
    """100 m level, 101 m of cable of 10 kg/m, EA 2e7 N. With T' = T - ρA v² |r_x| and k = EA/(EA - ρA v²).

    r_x = k (1/T' + 1/EA)(H, V + w s): k times the elastic catenary over 1/k of the span.
    """
    for speed in (0.0, 10.0, 40.0):
        simulation = moving(
            unstrained_length=101.0, end=(100.0, 0.0), mass_per_length=10.0, axial=2e7, bending=0.0, elements=64
        )
        set_speed(simulation, speed)
        forces = settle_moving(simulation)
        system = simulation.system
        flow = 10.0 * speed**2
        scale = 2e7 / (2e7 - flow)
        at_rest = system._replace(cable=system.cable._replace(end_position=system.cable.end_position / scale))
        places = np.array([25.25, 50.5])
        positions, slopes = catenary(at_rest, np.array([0.0, 25.25, 50.5]))
        got = simulation.cable_positions(places)[:, [0, 2]]
        apart = float(np.abs(got - scale * positions[1:]).max())
        yield Result(f"apart from it, {speed:g} m/s", "m", 0.0, apart, 1e-7)
        tensions = 2e7 * (scale * np.linalg.norm(slopes, axis=1) - 1.0)
        yield Result(
            f"tension in the middle, {speed:g} m/s",
            "N",
            tensions[2],
            float(simulation.cable_tension(np.array([50.5]))[0]),
            1e-8 * tensions[2],
        )
        support = tensions[0] - flow * scale * float(np.linalg.norm(slopes[0]))
        yield Result(
            f"force of a support, {speed:g} m/s", "N", support, float(np.hypot(*forces[0])), 1e-6 * abs(support)
        )


@case("cable that speeds up", "c² ε' = v_t (1 + ε): its own mass times v_t")
def speeding_up() -> Iterator[Result]:
    """Straight and without weight, 20 m/s² from rest: tensions of the ends, and the drive's force."""
    simulation = moving(**STRING, elements=40)
    set_speed(simulation, 0.0, 20.0)
    forces = settle_moving(simulation)
    growth = 20.0 * STRING_LENGTH * 5.0 / 1e7
    first = STRING_END * (growth / STRING_LENGTH) / np.expm1(growth)  # |r_x| at the start
    yield Result("tension at the start", "N", 1e7 * (first - 1.0), float(-forces[0, 0]), 1e-3)
    yield Result("tension at the end", "N", 1e7 * (first * np.exp(growth) - 1.0), float(forces[1, 0]), 1e-3)
    yield Result("difference: its mass times v_t", "N", 5.0 * STRING_END * 20.0, float(forces.sum(axis=0)[0]), 1e-3)
    squared = first**2 * np.expm1(2.0 * growth) / (2.0 * growth / STRING_LENGTH)  # ∫|r_x|² dx
    drive = simulation._observe().drives["haul_rope"]
    yield Result("force of the drive", "N", 5.0 * 20.0 * squared, drive.force, 1e-3)


@case("swing when a line stops", "pendulum on an accelerated pivot: up to 2 atan(a/g)", needs_jit=True)
def swing_of_a_stop() -> Iterator[Result]:
    """A carrier of 100 kg on a light level rope under 10 MN, from 5 m/s with 1.5 m/s² to rest."""
    simulation = moving(
        unstrained_length=100.0,
        end=(101.0, 0.0),
        mass_per_length=1.0,
        axial=1e9,
        bending=0.0,
        elements=20,
        step=0.005,
        carriages={
            "chair": {
                "arc_length": 20.0,
                "joint": "clamped",
                "bodies": {"chair": {"mass": 100.0, "inertia": 1.0, "upper_pivot": [0.0, 2.0]}},
            }
        },
        limits={"acceleration": 1e-3, "emergency_deceleration": 1.5},
    )
    set_speed(simulation, 5.0)
    with changing(simulation) as state:
        state.bodies.velocity[:, 0] = 5.0 * 1.01
    simulation.advance_to(1.0)
    before = simulation.snapshot.carriages["chair"].bodies["chair"].pitch
    yield Result("pitch before", "rad", 0.0, before, 2e-3)
    simulation.emergency_stop()
    pitches = []
    while simulation.snapshot.drives["haul_rope"].speed > 0.0:
        chair = simulation.advance_to(simulation.time + 0.01).carriages["chair"]
        pitches.append(chair.bodies["chair"].pitch)
    # the pivot slows at 1.01 times that; the load swings forwards, which is a negative pitch
    expected = -2.0 * np.arctan(1.5 * 1.01 / 9.81)
    yield Result("furthest swing", "rad", float(expected), float(np.min(pitches)), 0.001 * abs(expected))
    way = simulation.snapshot.drives["haul_rope"].position - 5.0
    yield Result("way to rest", "m", 5.0**2 / 3.0, way, 1e-9)


@kernel
def damping_power(system: System, state: State) -> float:
    """Power (W) that Kelvin-Voigt damping takes from a rope, by the rates of strain of all elements."""
    cable, like, total = system.cable, system.cable.gravity, 0.0
    stretch, dilution = rest_stretch(cable, state), mesh_dilution_rate(cable, state)
    for element in range(cable.element_count):
        length = state.mesh.length[element]
        e, v = nodal_vectors(state.nodes.position, element, like), nodal_vectors(state.nodes.velocity, element, like)
        if beside_load(cable, state, element):
            e, v, _ = motion_of_rope(system, state, element, state.nodes.acceleration)
        shape = subtract(e[2], e[0]), scale(length, e[1]), scale(length, e[3])
        rates = subtract(v[2], v[0]), scale(length, v[1]), scale(length, v[3])
        still, strained = scale(0.0, shape[0]), rates_of_strain(dilution, shape, rates)
        damped = elastic_force(cable, stretch * length, *shape, *strained, 0.0, 0.0)[:3]
        elastic = elastic_force(cable, stretch * length, *shape, still, still, still, 0.0, 0.0)[:3]
        for i in range(3):
            total += dot(subtract(damped[i], elastic[i]), rates[i])
    return total


def viscous_power(simulation: Simulation) -> float:
    """Power (W) that Kelvin-Voigt damping takes now."""
    return float(damping_power(simulation.system, for_kernels(simulation)[0]))


def carrier_energies(simulation: Simulation) -> FloatArray:
    """Mechanical energy (carriages,) in J of each carrier of one body, on the cable or not."""
    state, carriages = simulation.state, simulation.system.carriages
    v, q = state.bodies.velocity, state.bodies.position
    kinetic = 0.5 * carriages.mass * (v[:, 0] ** 2 + v[:, 1] ** 2) + 0.5 * carriages.inertia * v[:, 2] ** 2
    return kinetic - carriages.mass * (simulation.system.cable.gravity[1] * q[:, 1])


@case("balance of an open system", "first law, and the balance of momentum along the rope", needs_jit=True, long=True)
def open_system() -> Iterator[Result]:
    """A chairlift of 800 m starts, stops, goes back: 90 s, with carriers that leave and enter.

    Work of the drive is energy stored plus energy dissipated plus what carriers take with them and bring.
    """
    simulation = chairlift(step=0.005)
    state = simulation.state
    stored = simulation.energy().total
    work, throughput, dissipated, taken, swaps = 0.0, 0.0, 0.0, 0.0, 0
    drive = simulation.snapshot.drives["haul_rope"]
    power, loss = 0.0, 0.0
    worst = 0.0
    for time, speed in ((0.0, 2.5), (45.0, -2.5)):
        simulation.command("haul_rope", speed=speed)
        while simulation.time < time + 45.0 - 1e-9:
            energies, on = carrier_energies(simulation), state.attached.copy()
            drive = simulation.advance_to(simulation.time + simulation.step).drives["haul_rope"]
            left, came = on & ~state.attached, state.attached & ~on
            taken += float(energies[left].sum() - carrier_energies(simulation)[came].sum())
            swaps += int(left.sum() + came.sum())
            now, lost = drive.force * drive.speed, viscous_power(simulation)
            work += 0.5 * simulation.step * (power + now)
            throughput += 0.5 * simulation.step * abs(power + now)
            dissipated += 0.5 * simulation.step * (loss + lost)
            power, loss = now, lost
            worst = max(worst, abs(work - dissipated - taken - (simulation.energy().total - stored)))
    yield Result("carriers that left or entered", "-", 4.0, float(swaps), 3.0)
    yield Result("largest gap in the balance over what went through", "%", 0.0, 100.0 * worst / throughput, 0.05)
    # the drive's force from the ends of the rope alone: tension, stretch, weight and momentum carried in and out
    forces = np.array([simulation.snapshot.supports[end].force for end in ("start", "end")])
    cable, speed = simulation.system.cable, drive.speed
    slopes = np.linalg.norm(state.nodes.position[[0, -1], 1], axis=1)
    tensions = np.linalg.norm(forces, axis=1) + cable.mass_per_length * speed**2 * slopes
    ends = tensions * (1.0 + 0.5 * tensions / cable.axial_stiffness)
    ends -= 0.5 * cable.mass_per_length * (speed * slopes) ** 2
    ends += cable.mass_per_length * cable.gravity[1] * state.nodes.position[[0, -1], 0, 1]
    expected = float(ends[1] - ends[0])
    yield Result("force of the drive from both ends", "N", expected, drive.force, 0.0002 * abs(expected))
