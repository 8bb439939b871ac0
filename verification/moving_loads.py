"""Cases of loads in motion: a mass along a taut string, one that rolls over many elements, orders of convergence."""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation, SolverError
from verification import Result, case
from verification.point_loads import Rope, plain, solve, with_tension

Array = NDArray[np.float64]
LENGTH, AXIAL, STRAIN = 100.0, 1e7, 0.01  # m, N and - of the string; 1 kg/m of unstrained length
STRING_GRAVITY = 0.2  # m/s²: little, so that the string is a linear one
SHARES, MASSES = (0.1, 0.3, 0.5, 0.7), (10.0, 100.0)  # of the wave speed; kg


def moving_mass(share: float, mass: float, count: int = 0) -> tuple[Array, Array, Array]:
    """Mass that enters a taut string at rest and runs along it at a constant speed, by the method of images.

    A force F(τ) at v τ moves the string at x by c / 2T where c (t - τ) >= |x - v τ|, and so do its images, which lie at
    2 m L + v τ, and with the other sign at 2 m L - v τ. At the mass itself each condition is τ <= τ_m(t), which is
    linear, so that its velocity is a sum of forces that acted before: y' = -c / 2T Σ ± τ_m' F(τ_m), with
    F = mass (g + y''). Frýba (1999, chapter 21) has the equation; no mode is left out here.

    Args:
        share: speed over that of waves.
        mass: kg.
        count: steps; 0 for as many as place and force need for four digits.

    Returns:
        Time (s), place across (m) and force (N) of the mass, until 0.95 of the length.
    """
    wave, speed, tension = string_constants(share)
    # the sag of the string itself, of the curvature ρ g / T, is ridden through as well
    gravity = STRING_GRAVITY * (1.0 + share**2)
    end, count = 0.95 * LENGTH / speed, count or round(6000.0 / share)
    time = np.linspace(0.0, end, count + 1)
    step, slow, fast = time[1], wave - speed, wave + speed
    images = []  # sign, rate and delay of τ_m
    for m in range(1, 2 + int(wave * end / LENGTH)):
        images += [(1.0, 1.0, 2.0 * m * LENGTH / fast), (1.0, 1.0, 2.0 * m * LENGTH / slow)]
        images += [(-1.0, fast / slow, 2.0 * m * LENGTH / slow), (-1.0, slow / fast, 2.0 * m * LENGTH / fast)]
    images.append((-1.0, slow / fast, 0.0))
    force, velocity, place = np.zeros(count + 1), np.zeros(count + 1), np.zeros(count + 1)
    half, stiff = 0.5 * step / mass, 2.0 * tension / wave

    def before(k: int, guess: float) -> float:
        """Forces of the images at time number k; where one is of the present step, with `guess` at its end."""
        total = 0.0
        for sign, rate, delay in images:
            past = rate * time[k] - delay
            if past > 0.0:
                number = min(past / step, float(k))
                low = min(int(number), k - 1)
                high = guess if low + 1 == k else force[low + 1]
                total -= sign * rate * (force[low] + (number - low) * (high - force[low]))
        return total

    for k in range(1, count + 1):
        # trapezoidal: u = u' + h/2M (F' + F) - h g, and F = -2T/c u + images
        known = velocity[k - 1] + half * force[k - 1] - step * gravity
        present = force[k - 1]
        for _ in range(50):
            last, present = present, (before(k, present) - stiff * known) / (1.0 + stiff * half)
            if abs(present - last) <= 1e-13 * mass * gravity:
                break
        force[k] = present
        velocity[k] = known + half * present
        place[k] = place[k - 1] + 0.5 * step * (velocity[k - 1] + velocity[k])
    return time, place, force


def by_modes(share: float, mass: float, count: int) -> tuple[Array, Array]:
    """Time (s) and place across (m) of the same mass by `count` modes of the string (Galerkin), with Runge-Kutta."""
    wave, speed, _ = string_constants(share)
    gravity, waves = STRING_GRAVITY * (1.0 + share**2), np.arange(1, count + 1) * np.pi / LENGTH
    ratio = 2.0 * mass / LENGTH * (1.0 + STRAIN)  # of the mass to half of the string; 1 kg per unstrained m
    end = 0.9 * LENGTH / speed
    steps = int(end * wave * waves[-1] / 0.4)
    step = end / steps

    def rates(t: float, y: Array) -> Array:
        q, v = y[:count], y[count:]
        sine, cosine = np.sin(waves * speed * t), np.cos(waves * speed * t)
        free = -((waves * wave) ** 2) * q
        # (1 + ratio s s') q'' = free - ratio s (g + 2 v k q' cos - v² k² q sin)
        force = gravity + 2.0 * speed * (waves * cosine) @ v - speed**2 * (waves**2 * sine) @ q
        force = (force + sine @ free) / (1.0 + ratio * sine @ sine)
        return np.concatenate([v, free - ratio * sine * force])

    y, places = np.zeros(2 * count), [0.0]
    for k in range(steps):
        t = k * step
        a = rates(t, y)
        b = rates(t + 0.5 * step, y + 0.5 * step * a)
        c = rates(t + 0.5 * step, y + 0.5 * step * b)
        d = rates(t + step, y + step * c)
        y = y + step / 6.0 * (a + 2.0 * b + 2.0 * c + d)
        places.append(float(np.sin(waves * speed * (t + step)) @ y[:count]))
    return step * np.arange(steps + 1), np.array(places)


def string_constants(share: float) -> tuple[float, float, float]:
    """Wave speed and speed of the mass (m/s) in space, and tension (N), of the string."""
    wave = float(np.sqrt(AXIAL * STRAIN * (1.0 + STRAIN)))
    return wave, share * wave, AXIAL * STRAIN


def mass_on_string(
    share: float, mass: float, elements: int, dim: int = 2, samples: int = 90
) -> tuple[Array, Array, Array]:
    """Time (s), place across (m), less the sag of the string itself, and force (N) of the mass in the product.

    A step is a 40th of the time on one element.
    """
    wave, speed, tension = string_constants(share)
    step = LENGTH / elements / (share * float(np.sqrt(AXIAL * STRAIN))) / 40.0
    level = [1.0] if dim == 2 else [0.8, 0.6]
    unstrained = LENGTH / (1.0 + STRAIN)
    along = speed / (1.0 + STRAIN)
    limits = {"acceleration": 1e9, "speed": 2.0 * wave}
    body = {"mass": mass, "inertia": 0.01, "upper_pivot": [0.0] * dim, "size": [0.0] * 2}
    car = {"arc_length": 1e-6, "speed": along, "end_stop": {"stroke": 1e-6}, "bodies": {"body": body}}
    car["drive"] = {"mode": "speed", "limits": limits}
    scenario = {
        "gravity": STRING_GRAVITY,
        "cable": {
            "joint": "node",
            "unstrained_length": unstrained,
            "mass_per_length": 1.0,
            "axial_stiffness": AXIAL,
            "bending_stiffness": 0.0,
            "elements": elements,
            "start": {"position": [0.0] * dim},
            "end": {"position": [*(LENGTH * np.array(level)).tolist(), 0.0]},
        },
        "carriages": {"car": car},
        "solver": {"step": step, "tolerance": 1e-10},
    }
    simulation = Simulation(load_scenario(scenario), on_demand=True)
    rows = []
    for place in np.linspace(0.02, 0.9, samples):
        snapshot = simulation.advance_to(place * LENGTH / speed)
        now = snapshot.carriages["car"]
        x = float(np.linalg.norm(now.position[:2]))
        sag = STRING_GRAVITY / (1.0 + STRAIN) * x * (LENGTH - x) / (2.0 * tension)
        rows.append((snapshot.time, float(now.position[2]) + sag, float(now.contact_force[2])))
    return tuple(np.array(rows).T)  # type: ignore[return-value]


@case("mass along a taut string", "Frýba 1999, moving mass; method of images", needs_jit=True, long=True)
def mass_along_a_string() -> Iterator[Result]:
    """From one end at rest, up to 0.9 of the length, on 100 elements; in a plane, and in space across the axes.

    Short waves must not grow as a node is handed on from element to element: hence the fastest mass on 200 as well.
    """
    for mass in MASSES:
        for share in SHARES:
            time, exact, _ = moving_mass(share, mass)
            coarse_time, coarse, _ = moving_mass(share, mass, time.size // 2)
            size = float(np.abs(exact).max())
            label = f"{mass:g} kg, v = {share:g} c"
            numerical = float(np.abs(np.interp(coarse_time, time, exact) - coarse).max()) / size
            yield Result(f"{label}: closed form on half the steps, place", "-", 0.0, numerical, 2e-4)
            meshes = [(100, 2), (100, 3)] + [(200, 2)] * (share == SHARES[-1])
            for elements, dim in meshes:
                got_time, got, _ = mass_on_string(share, mass, elements, dim)
                off = float(np.abs(got - np.interp(got_time, time, exact)).max()) / size
                where = f"{'plane' if dim == 2 else 'space'}, {elements} elements"
                yield Result(f"{label}: place, of the largest, {where}", "-", 0.0, off, 1e-3)


@case("mass along a taut string, its closed form", "modes of the string (Galerkin)", needs_jit=True, long=True)
def closed_form_of_the_mass() -> Iterator[Result]:
    """The closed form beside 50, 100 and 200 modes, which come nearer to it, and beside what they come near to."""
    for mass, share in ((10.0, 0.3), (10.0, 0.7), (100.0, 0.5)):
        time, exact, _ = moving_mass(share, mass)
        at = np.linspace(0.0, 0.9 * LENGTH / string_constants(share)[1], 400)
        wanted, size = np.interp(at, time, exact), float(np.abs(exact).max())
        places = [np.interp(at, *by_modes(share, mass, modes)) for modes in (50, 100, 200)]
        errors = [float(np.abs(place - wanted).max()) / size for place in places]
        label = f"{mass:g} kg, v = {share:g} c"
        yield Result(f"{label}: 200 modes, of the largest place", "-", 0.0, errors[-1], 6e-3)
        yield Result(f"{label}: half as far with twice the modes", "-", 0.5, errors[-1] / errors[-2], 0.15)
        limit = float(np.abs(2.0 * places[-1] - places[-2] - wanted).max()) / size
        yield Result(f"{label}: extrapolated from 100 and 200 modes", "-", 0.0, limit, 1e-3)


ROLLING = Rope((700.0, 30.0), 700.0, 200.0, 4e8, (0.5,), (1.2e5,))  # N/m, N, N: as of a tramway
ROLLING_TENSION, SPEED, ELEMENTS, PASSED, FINER = 1e6, 10.0, 70, 50, 8  # N, m/s, -, passed at speed, times the elements
ROLLING_LIMITS = {"speed": SPEED, "acceleration": 0.5, "jerk": 0.1}  # m/s and so on: a start that rings little
ROLLING_FRAME = 0.02  # s


@lru_cache(maxsize=4)
def rolled(elements: int, dim: int = 2, step: float = 0.005) -> tuple[Array, Array, float]:
    """Place (n, 3) in m and contact force (n,) in N of a load at its speed, over 50 elements of 70.

    Last the length (m) of an element of 70.
    """
    rope = with_tension(ROLLING if dim == 2 else _turned(ROLLING), ROLLING_TENSION)
    coarse = rope.length / ELEMENTS
    rope = Rope(rope.end, rope.length, rope.weight, rope.stiffness, (3.3 * coarse,), rope.loads)
    data = plain(rope, elements, "driven")
    data["carriages"]["load_1"]["drive"] = {"mode": "speed", "limits": ROLLING_LIMITS}
    simulation = Simulation(load_scenario({**data, "solver": {"step": step}}), on_demand=True)
    simulation.command("load_1", speed=SPEED)
    speeding = SPEED / ROLLING_LIMITS["acceleration"] + ROLLING_LIMITS["acceleration"] / ROLLING_LIMITS["jerk"]  # s
    rows = []
    for frame in range(round(PASSED * coarse / SPEED / ROLLING_FRAME)):
        car = simulation.advance_to(speeding + ROLLING_FRAME * frame).carriages["load_1"]
        rows.append((*car.position, float(np.linalg.norm(car.contact_force))))
    found = np.array(rows)
    return found[:, :3], found[:, 3], coarse


def _turned(rope: Rope) -> Rope:
    """The rope in space, across all axes."""
    return Rope((0.8 * rope.end[0], 0.6 * rope.end[0], rope.end[1]), *_rest(rope))


def _rest(rope: Rope) -> Any:
    return rope.length, rope.weight, rope.stiffness, rope.places, rope.loads


def wave_at(signal: Array, frequency: float, frame: float = ROLLING_FRAME) -> float:
    """Amplitude of a signal at a frequency (Hz), by a window of Hann."""
    window = np.hanning(signal.size)
    turning = np.exp(-2j * np.pi * frequency * frame * np.arange(signal.size))
    return float(2.0 * np.abs(np.sum(window * (signal - signal.mean()) * turning)) / window.sum())


@case("load that rolls over 50 elements", "a mesh eight times finer", needs_jit=True, long=True)
def rolling_load() -> Iterator[Result]:
    """Load of 12 t at a constant 10 m/s, over elements of 10 m, in a plane and in space, without any damping."""
    for dim in (2, 3):
        where = "plane" if dim == 2 else "space"
        fine, fine_force, element = rolled(ELEMENTS * FINER, dim)
        try:
            place, force, _ = rolled(ELEMENTS, dim)
        except SolverError:
            yield Result(f"{where}: goes on", "-", 1.0, 0.0, 0.0)
            continue
        weight = ROLLING.loads[0]
        apart = float(np.linalg.norm(place - fine, axis=1).max())
        yield Result(f"{where}: place, largest difference", "m", 0.0, apart, 1e-4)
        off = float(np.abs(force - fine_force).max() / weight)
        yield Result(f"{where}: contact force, largest difference over the weight", "-", 0.0, off, 2e-3)
        for number in (1, 2, 3):
            wave = wave_at(force - fine_force, number * SPEED / element) / weight
            yield Result(f"{where}: wave of the force, {number} a mesh period, of the weight", "-", 0.0, wave, 2e-4)


def off_with_long_steps(steps: float) -> float:
    """Largest difference of the contact force, over the weight, with elements passed in `steps` from ones of 10 m."""
    step = 0.01  # s
    short = round(ROLLING.end[0] / (SPEED * step * steps))
    _, force, _ = rolled(short, step=step)
    _, coarse_force, _ = rolled(ELEMENTS, step=step)
    return float(np.abs(force - coarse_force).max() / ROLLING.loads[0])


@case("load that passes an element in a few steps", "elements of 10 m and the same steps", needs_jit=True, long=True)
def long_steps() -> Iterator[Result]:
    """The load that rolls, with steps of 10 ms."""
    for steps in (12.5, 6.0, 5.0):
        off = off_with_long_steps(steps)
        yield Result(f"{steps:g} steps: contact force, largest difference over the weight", "-", 0.0, off, 2e-3)


SAGGING = Rope((100.0, 20.0), 112.0, 100.0, 2e5, (0.37 * 112.0,), (8e3,))  # soft and slack: errors above rounding


@case("order of convergence in space, with a load", "two elastic catenaries that meet at it", needs_jit=True)
def order_in_space() -> Iterator[Result]:
    """Worst of 200 points, and the load itself, on 8 to 64 elements; more than 4 counts as 4."""
    exact, errors, at_load = solve(SAGGING), [], []
    arc_lengths = np.linspace(0.0, SAGGING.length, 200)
    wanted = np.array([exact.position(s) for s in arc_lengths])
    for elements in (8, 16, 32, 64):
        data = plain(SAGGING, elements, "driven")
        simulation = Simulation(load_scenario(data, {"solver.tolerance": 1e-12}))
        got = simulation.cable_positions(arc_lengths)[:, [0, 2]]
        errors.append(float(np.abs(got - wanted).max()))
        place = simulation.snapshot.carriages["load_1"].position[[0, 2]]
        at_load.append(float(np.linalg.norm(place - exact.position(SAGGING.places[0]))))
    for label, found in (("rope", errors), ("load", at_load)):
        order = float(np.log2(found[-2] / found[-1]))
        yield Result(f"order of the {label}, 32 to 64 elements", "-", 4.0, min(order, 4.0), 0.6)
        yield Result(f"error of the {label}, 64 elements", "m", 0.0, found[-1], 1e-6)


@case("load in motion on a coarse mesh", "a mesh eight times finer", needs_jit=True, long=True)
def order_in_motion() -> Iterator[Result]:
    """A load that starts smoothly, comes to 8 m/s and rolls over several elements; after 10 s."""
    rope = with_tension(Rope((200.0, 10.0), 200.0, 60.0, 1e7, (0.2,), (1e4,)), 6e4)
    limits = {"speed": 8.0, "acceleration": 2.0, "jerk": 0.8}
    places = []
    for elements in (48, 384):
        data = plain(rope, elements, "driven")
        data["carriages"]["load_1"]["drive"] = {"mode": "speed", "limits": limits}
        simulation = Simulation(load_scenario({**data, "solver": {"step": 0.002}}), on_demand=True)
        simulation.command("load_1", speed=8.0)
        places.append(np.array(simulation.advance_to(10.0).carriages["load_1"].position))
    error = float(np.linalg.norm(places[0] - places[1]))
    yield Result("error of its place, 48 elements", "m", 0.0, error, 1e-4)
