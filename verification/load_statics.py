"""Cases of point loads at rest, beside elastic catenaries that meet at them: anywhere on an element, any bend."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise

import numpy as np
from scipy.optimize import brentq

from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation
from verification import Result, case
from verification.point_loads import (
    GRAVITY,
    LIMITS,
    Errors,
    Rope,
    compare,
    held_by_potential,
    hung,
    plain,
    rest_place,
    simulated,
    solve,
    with_tension,
    worst,
)

TENSION = 2e5  # N, beside the load
WEIGHT = 0.2  # of the rope, over the tension
ELEMENTS, FIRST = 20, 8  # of the rope, and the one on which loads stand
PLANE, SPACE, LEVEL = (1000.0, 300.0), (600.0, 800.0, 300.0), (1000.0, 20.0)  # m
# F / T and EA F² / T³ of loads; strains up to 0.1
BENDS = (
    (0.02, 0.01),
    (0.05, 0.1),
    (0.05, 1.0),
    (0.2, 1.0),
    (0.1, 3.0),
    (0.2, 10.0),
    (0.2, 33.0),
    (0.5, 3.0),
    (0.5, 33.0),
)
FEW = ((0.1, 3.0), (0.2, 33.0), (0.5, 3.0))
UNITS = {"height": "l F / T", "hold": "F² / T", "sides": "T", "anywhere": "-", "ends": "-"}
TEXTS = {
    "height": "height of the load",
    "hold": "force that holds it along the rope",
    "sides": "tension on both sides",
    "anywhere": "tension, worst of 501 points",
    "ends": "forces on the supports",
}


def rope_of(bend: tuple[float, float], end: tuple[float, ...] = PLANE, shares: tuple[float, ...] = (0.425,)) -> Rope:
    """Rope with loads at `shares` of its length, each of the same F / T and EA F² / T³; `TENSION` at the first one."""
    ratio, stiff = bend
    load, chord = ratio * TENSION, float(np.linalg.norm(end))
    stiffness = stiff * TENSION**3 / load**2
    return with_tension(Rope(end, chord, WEIGHT * TENSION / chord, stiffness, shares, (load,) * len(shares)), TENSION)


def over_an_element(rope: Rope, count: int = 13, elements: int = ELEMENTS, first: int = FIRST) -> list[Rope]:
    """The rope with its load at `count` places of one element of an even mesh, from node to node."""
    return [replace(rope, places=((first + u) * rope.length / elements,)) for u in np.linspace(0.0, 1.0, count)]


def rows(label: str, errors: dict[str, float], limits: dict[str, float] = LIMITS) -> Iterator[Result]:
    """A row for each error."""
    for name, limit in limits.items():
        yield Result(f"{label}: {TEXTS[name]}", UNITS[name], 0.0, errors[name], limit)


def label_of(bend: tuple[float, float]) -> str:
    """Text of a bend."""
    return f"F/T {bend[0]:g}, EA F²/T³ {bend[1]:g}"


@case("load anywhere on an element", "two elastic catenaries that meet at it", needs_jit=True, long=True)
def load_on_an_element() -> Iterator[Result]:
    """Held by a drive at 13 places of an element of 20: the worst of them."""
    for bend in BENDS:
        errors = [compare(simulated(rope, ELEMENTS), solve(rope)) for rope in over_an_element(rope_of(bend))]
        yield from rows(label_of(bend), worst(errors))


@case("fixed load anywhere on an element", "two elastic catenaries that meet at it", needs_jit=True, long=True)
def fixed_load() -> Iterator[Result]:
    """Fixed joint at 16 places of an element of 20, and at 16 places along 60 m of a graded mesh."""
    for bend in FEW:
        errors = [
            compare(simulated(rope, ELEMENTS, "fixed"), solve(rope)) for rope in over_an_element(rope_of(bend), 16)
        ]
        yield from rows(label_of(bend), worst(errors))
    graded = {"target": 50.0, "at_towers": 10.0, "growth": 1.5}
    rope = rope_of(FEW[0], shares=(0.06,))
    errors = []
    for place in np.linspace(30.0, 90.0, 16):
        moved = replace(rope, places=(float(place),))
        errors.append(compare(simulated(moved, graded, "fixed"), solve(moved)))
    limits = {name: limit for name, limit in LIMITS.items() if name != "height"}  # in lengths of no one element
    yield from rows(f"graded mesh, {label_of(FEW[0])}", worst(errors), limits)


@case("load anywhere on an element, in space", "two elastic catenaries that meet at it", needs_jit=True, long=True)
def load_in_space() -> Iterator[Result]:
    """A rope across all three axes."""
    for bend in FEW:
        for joint in ("driven", "fixed"):
            ropes = over_an_element(rope_of(bend, SPACE), 5)
            errors = [compare(simulated(rope, ELEMENTS, joint), solve(rope)) for rope in ropes]
            yield from rows(f"{joint}, {label_of(bend)}", worst(errors))


def two_ropes(first: Rope, second: Rope, elements: int, joint: str) -> Simulation:
    """Two ropes side by side, each with its loads, `one` and `two`."""
    ropes = {name: plain(rope, elements, joint)["cable"] for name, rope in (("one", first), ("two", second))}
    for end in ("start", "end"):  # the second one lies 20 m higher
        position = ropes["two"][end]["position"]
        ropes["two"][end] = {"position": [*position[:-1], position[-1] + 20.0]}
    carriages = hung(first, joint, "one", {"rope": "one"}) | hung(second, joint, "two", {"rope": "two"})
    return Simulation(load_scenario({"gravity": GRAVITY, "ropes": ropes, "carriages": carriages}))


@case("load anywhere on an element, two ropes", "two elastic catenaries that meet at it", needs_jit=True, long=True)
def loads_on_two_ropes() -> Iterator[Result]:
    """Two ropes with other lengths and loads in one system, in a plane and in space."""
    for end in (PLANE, SPACE):
        ropes = [rope_of(FEW[0], end), rope_of(FEW[2], end)]
        errors: dict[str, list[Errors]] = {"one": [], "two": []}
        for first, second in zip(over_an_element(ropes[0], 5), over_an_element(ropes[1], 5)[::-1], strict=True):
            simulation = two_ropes(first, second, ELEMENTS, "driven")
            for name, rope in (("one", first), ("two", second)):
                errors[name].append(compare(simulation, solve(rope), rope=name, name=name))
        for (name, found), bend in zip(errors.items(), (FEW[0], FEW[2]), strict=True):
            yield from rows(f"{'plane' if len(end) == 2 else 'space'}, {name}, {label_of(bend)}", worst(found))


@case("loads closer than an element", "elastic catenaries that meet at them", needs_jit=True, long=True)
def train_of_loads() -> Iterator[Result]:
    """Two and four loads within an element of each other, driven and fixed, over an element of the mesh."""
    for apart, count in ((0.3, 2), (0.9, 2), (0.45, 4)):
        for joint in ("driven", "fixed"):
            shares = tuple(0.425 + k * apart / ELEMENTS for k in range(count))
            rope = rope_of((0.1 / count, 3.0 / count**2), shares=shares)
            errors = []
            for u in np.linspace(0.0, 1.0, 13):
                element = rope.length / ELEMENTS
                moved = replace(rope, places=tuple((FIRST + u + k * apart) * element for k in range(count)))
                simulation, exact = simulated(moved, ELEMENTS, joint), solve(moved)
                errors += [compare(simulation, exact, load) for load in range(count)]
            yield from rows(f"{count} loads {apart:g} elements apart, {joint}", worst(errors))


@case("load near the end of a rope", "two elastic catenaries that meet at it", needs_jit=True)
def load_near_an_end() -> Iterator[Result]:
    """From a fiftieth of an element beside the support to the second node."""
    for joint in ("driven", "fixed"):
        rope, errors = rope_of((0.1, 3.0), shares=(0.05,)), []
        for u in (0.02, 0.1, 0.3, 0.49, 0.51, 0.7, 0.9, 1.0, 1.1, 1.3, 1.49, 1.51, 1.8):
            moved = replace(rope, places=(u * rope.length / ELEMENTS,))
            errors.append(compare(simulated(moved, ELEMENTS, joint), solve(moved)))
        yield from rows(joint, worst(errors))


@case("force along the rope, by the energies beside", "derivative of the potential by the place", needs_jit=True)
def force_by_potential() -> Iterator[Result]:
    """Central difference of the product's own energies, of a load that is held 20 mm to either side."""
    for bend in FEW:
        rope, off, apart = rope_of(bend), [], []
        unit = rope.loads[0] ** 2 / TENSION
        for moved in over_an_element(rope, 9)[1:-1]:
            exact, by_energy = solve(moved).hold(0), held_by_potential(moved, ELEMENTS)
            got = simulated(moved, ELEMENTS).snapshot.carriages["load_1"].drive_force
            off.append((by_energy - exact) / unit)
            apart.append((by_energy - got) / unit)
        yield Result(f"{label_of(bend)}: from energies", "F² / T", 0.0, max(off, key=abs), 1e-3)
        yield Result(f"{label_of(bend)}: drive force beside that", "F² / T", 0.0, max(apart, key=abs), 1e-3)


@case("free bead on a rope", "it rests where the tension is the same on both sides", needs_jit=True, long=True)
def free_bead() -> Iterator[Result]:
    """Held and then let go at the place of the closed form, on meshes that put it anywhere on an element."""
    for bend in FEW:
        rope = rope_of(bend, LEVEL)
        place = rest_place(rope)
        rope = replace(rope, places=(place,))
        unit, pulls, ways = rope.loads[0] ** 2 / TENSION, [], []
        for elements in (18, 19, 20, 21, 23, 26, 29):
            held = simulated(rope, elements).snapshot.carriages["load_1"].drive_force
            pulls.append(held / unit)
            free = simulated(rope, elements, "free")
            moved = free.advance_to(5.0).carriages["load_1"].arc_length - place
            ways.append(moved / (0.5 * unit / (rope.loads[0] / GRAVITY) * 5.0**2))
        yield Result(f"{label_of(bend)}: force that holds it there", "F² / T", 0.0, max(pulls, key=abs), 1e-3)
        yield Result(f"{label_of(bend)}: way in 5 s", "F² t² / 2 m T", 0.0, max(ways, key=abs), 1e-3)


@case("load beside a frictionless sheave", "T + T² / 2 EA - q h is the same along a rope but at loads", needs_jit=True)
def frictionless_sheave() -> Iterator[Result]:
    """Eight sheaves on a circle between two spans; a load at 16 places of an element before them, and close to them."""
    rope = Rope((400.0, 80.0), 408.0, 60.0, 6e7, (150.0,), (8e3,))
    tower = {"position": [200.0, 52.0], "contacts": 8, "length": 6.0, "radius": 30.0, "friction": 0.0}
    mesh = {"target": 10.0, "at_towers": 1.0, "growth": 1.3}
    first_sheave = 203.2  # m along the rope
    near = (190.0, 198.0, 199.0, 200.0, 200.5, 201.0, 201.5, 202.0)
    for where, places in (("a load in the span", np.linspace(140.0, 150.0, 16)), ("a load at 1 to 13 m", near)):
        passed, held = [], []
        for place in places:
            moved = replace(rope, places=(float(place),))
            simulation = simulated(moved, mesh, changes={"towers": {"tower": tower}})
            force = simulation.snapshot.carriages["load_1"].drive_force
            around = np.array([60.0, 0.5 * (place + first_sheave), 240.0])  # m: beside the load, and beyond the sheaves
            heights, tensions = simulation.cable_positions(around)[:, 2], simulation.cable_tension(around)
            levels = tensions + tensions**2 / (2.0 * rope.stiffness) - rope.weight * heights
            tension = float(tensions[:2].mean())
            stretch = 1.0 + tension / rope.stiffness
            held.append((levels[1] - levels[0] - force * stretch) / (moved.loads[0] ** 2 / tension))
            passed.append((levels[2] - levels[1]) / tension)
        yield Result(f"{where}: gained over them", "T", 0.0, max(passed, key=abs), 5e-4)
        yield Result(f"{where}: gained at the load, beside the drive", "F² / T", 0.0, max(held, key=abs), 1e-3)


def string_with_mass(share: float, ratio: float, count: int) -> list[float]:
    """Lowest frequencies of a string with a mass, by that of the first mode without it.

    With φ = π ω / ω_1, a the place and μ the mass, of the string's: sin φ = μ φ sin(a φ) sin((1 - a) φ).
    """

    def off(phi: float) -> float:
        return float(np.sin(phi) - ratio * phi * np.sin(share * phi) * np.sin((1.0 - share) * phi))

    edges, found = np.linspace(1e-3, np.pi * (count + 1), 4000), []
    for low, high in pairwise(edges):
        if off(low) * off(high) < 0.0:
            found.append(float(brentq(off, low, high, xtol=1e-14)) / np.pi)
    return found[:count]


@case("frequencies of a string with a mass", "sin φ = μ φ sin(a φ) sin((1 - a) φ)", needs_jit=True, long=True)
def frequencies_with_a_load() -> Iterator[Result]:
    """A fixed mass at 9 places of an element of 20: first three modes across the string; in a plane and in space."""
    length, tension, mass, stiffness = 100.0, 1e5, 5.0, 1e7
    for dim in (2, 3):
        for ratio in (0.1, 2.0):
            off = []
            for u in np.linspace(0.0, 1.0, 9):
                share = float((6.0 + u) / ELEMENTS)
                unstrained = length / (1.0 + tension / stiffness)
                end = (length, 0.0) if dim == 2 else (0.8 * length, 0.6 * length, 0.0)
                load = ratio * mass * unstrained * 1e-3
                rope = Rope(end, unstrained, mass * 1e-3, stiffness, (share * unstrained,), (load,))
                data = plain(rope, ELEMENTS, "fixed")
                # weights of a thousandth, so that the string is straight
                data["gravity"] = 1e-3
                data["cable"]["mass_per_length"] = mass
                for body in data["carriages"]["load_1"]["bodies"].values():
                    body |= {"mass": ratio * mass * unstrained, "inertia": 1.0}
                simulation = Simulation(load_scenario(data))
                seen = simulation.natural_frequencies(12 if dim == 3 else 6)
                first = np.sqrt(tension / (mass * unstrained / length)) / (2.0 * length)
                wanted = string_with_mass(share, ratio, 3)
                off += [float(np.abs(seen / first - one).min()) / one for one in wanted]
            where = f"{'plane' if dim == 2 else 'space'}, {ratio:g} of the string's mass"
            yield Result(f"{where}: farthest of three", "-", 0.0, max(off), 2e-4)
