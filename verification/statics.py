"""Cases at rest: catenaries, elastica, reactions."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, root

from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation
from verification import JIT, Result, case
from verification.models import GRAVITY

Array = NDArray[np.float64]

LEVEL_SPAN: dict[str, Any] = {
    "description": "level span",
    "cable": {
        "unstrained_length": 101.0,
        "mass_per_length": 10.0,
        "axial_stiffness": 2e7,
        "bending_stiffness": 1.0,
        "elements": 64,
        "start": {"position": [0.0, 0.0], "support": "pinned"},
        "end": {"position": [100.0, 0.0], "support": "pinned"},
    },
    "carriages": {},
    "solver": {},
}

CANTILEVER: dict[str, Any] = {
    "description": "cantilever without weight",
    "gravity": 0.0,
    "cable": {
        "unstrained_length": 1.0,
        "mass_per_length": 1.0,
        "axial_stiffness": 1e6,
        "bending_stiffness": 1.0,
        "elements": 32,
        "start": {"position": [0.0, 0.0], "support": "clamped", "direction": [1.0, 0.0]},
        "end": {"position": [1.0, 0.0], "support": "free"},
    },
}


def hung(arc_length: float, mass: float) -> dict[str, Any]:
    """One carriage of one body of `mass` (kg), held at `arc_length` (m)."""
    body = {"mass": mass, "inertia": mass, "upper_pivot": [0.0, 1.0]}
    return {"carriage": {"arc_length": arc_length, "joint": "fixed", "bodies": {"body": body}}}


def catenary_end(pull: Array, weight: float, stiffness: float, length: float) -> Array:
    """End (2,) in m of an elastic catenary from the origin (Irvine 1981).

    `pull` is (H, V) in N at its start, V upwards the rope; `weight` is in N/m, `stiffness` EA in N, `length` in m.
    """
    h, v = pull
    after = v + weight * length
    across = h * length / stiffness + h / weight * (np.arcsinh(after / h) - np.arcsinh(v / h))
    up = length * (v + 0.5 * weight * length) / stiffness + (np.hypot(h, after) - np.hypot(h, v)) / weight
    return np.array([across, up])


def two_catenaries(
    span: Array, weight: float, stiffness: float, length: float, place: float, load: float, first: Array
) -> tuple[Array, Callable[[float], Array], Callable[[Array], Array]]:
    """Elastic catenaries on both sides of a point load, by shooting from the start.

    Args:
        span: end less start (2,) in m.
        weight: N/m.
        stiffness: EA in N.
        length: unstrained, m.
        place: arc length of the load, m.
        load: N downwards.
        first: where to start looking for (H, V) at the start, N.

    Returns:
        (H, V) at the start in N; position (2,) in m and tension (n,) in N as functions of the arc length in m.
    """

    def position(pull: Array, s: float) -> Array:
        near = catenary_end(pull, weight, stiffness, min(s, place))
        if s <= place:
            return near
        at_load = pull + np.array([0.0, weight * place + load])
        return near + catenary_end(at_load, weight, stiffness, s - place)

    found = root(lambda p: position(p * abs(first), length) - span, first / abs(first), method="hybr", tol=1e-13)
    pull = found.x * abs(first)
    assert np.abs(position(pull, length) - span).max() < 1e-9 * length
    return (
        pull,
        lambda s: position(pull, s),
        lambda s: np.hypot(pull[0], pull[1] + weight * s + load * (s > place)),
    )


def elastica(load: float, axial: float, model: str = "continuum") -> tuple[float, float, float]:
    """Tip x, z (m) and angle (rad) of a cantilever along x of 1 m and EI of 1 N m² under a force along -z at its tip.

    With θ the angle of the tangent t, n its normal, ε the strain, κ = θ' and F the force, what is least is the integral
    of ½ EA ε² + w(ε, κ) - (1 + ε) F·t. So EA ε + ∂w/∂ε = F·t, and M = ∂w/∂κ has M' = -(1 + ε) F·n, zero at the tip.

    - `continuum`: w = ½ EI κ².
    - `element_frame`: the bending strain of eq. 7 is r_xx across the chord, (1 + η) κ in an element whose slopes at the
      nodes have the length 1 + η. That length is not that of the chord, 1 + ε: a cubic with such slopes has the axial
      strain ε + (η - ε)(1 - 6u + 6u²), of mean square ε² + (η - ε)² / 5 whatever the length of the element. So η gives
      way to bending however fine the mesh is: the least of ½ EA (η - ε)² / 5 + ½ EI (1 + η)² κ² is
      w = ½ EI (1 + ε)² κ² / (1 + 5 EI κ² / EA).

    Args:
        load: N.
        axial: EA in N.
        model: elastic model.
    """
    softening = 5.0 / axial if model == "element_frame" else 0.0

    def bent(along: float, moment: float) -> tuple[float, float]:
        """Strain and curvature (1/m) for the force along the tangent (N) and the moment (N m)."""
        strain, curvature = along / axial, moment
        if model == "element_frame":
            for _ in range(60):  # a contraction as long as 5 EI κ² / EA is small
                soft = 1.0 + softening * curvature**2
                curvature = moment * (soft / (1.0 + strain)) ** 2
                strain = (along - (1.0 + strain) * curvature**2 / soft) / axial
        return strain, curvature

    def rates(_: float, y: Array) -> Array:
        theta, moment, _, _ = y
        strain, curvature = bent(-load * np.sin(theta), moment)
        stretch = 1.0 + strain
        return np.array([curvature, stretch * load * np.cos(theta), stretch * np.cos(theta), stretch * np.sin(theta)])

    def shoot(moment: float) -> Array:
        return solve_ivp(rates, (0.0, 1.0), [0.0, moment, 0.0, 0.0], method="DOP853", rtol=1e-11, atol=1e-12).y[:, -1]

    # of all equilibria the one that is nearest to straight: the first sign change of the moment at the tip
    moments = -load * np.linspace(0.0, 1.0, 21)
    missed = [shoot(moment)[1] for moment in moments]
    change = next(k for k in range(20) if missed[k] > 0.0 >= missed[k + 1])
    theta, _, x, z = shoot(brentq(lambda m: shoot(m)[1], moments[change + 1], moments[change], xtol=1e-13))
    return float(x), float(z), float(theta)


def tip(simulation: Simulation) -> Array:
    """Position (2,), x and z in m, of the end of the cable."""
    return simulation.cable_positions(np.array([simulation.system.cable.unstrained_length]))[0, [0, 2]]


def direction(simulation: Simulation, arc_length: float) -> float:
    """Angle (rad) of the cable over x, from points on both sides or within the end element."""
    length = simulation.system.cable.unstrained_length
    apart = 1e-4 * length
    near = min(max(arc_length, apart), length - apart)
    a, b, c = simulation.cable_positions(np.array([near - apart, near, near + apart]))
    ends = (c - a) / 2.0 + (arc_length - near) / apart * (a - 2.0 * b + c)
    return float(np.arctan2(ends[2], ends[0]))


@case("elastic catenary, level", "Irvine 1981")
def level_catenary() -> Iterator[Result]:
    """Both ends at one height."""
    weight, length, stiffness, span = 98.1, 101.0, 2e7, 100.0

    def width(horizontal: float) -> float:
        half = 0.5 * weight * length
        return horizontal * length / stiffness + 2.0 * horizontal / weight * np.arcsinh(half / horizontal)

    horizontal = brentq(lambda h: width(h) - span, 1e3, 1e6, xtol=1e-9)
    tension = np.hypot(horizontal, 0.5 * weight * length)
    sag = weight * length**2 / (8.0 * stiffness) + (tension - horizontal) / weight
    simulation = Simulation(load_scenario(LEVEL_SPAN))
    start = simulation.snapshot.supports["start"].force
    yield Result("horizontal tension", "N", horizontal, -start[0], 0.01)
    yield Result("end tension", "N", tension, float(np.linalg.norm(start)), 0.01)
    yield Result("sag", "m", sag, -simulation.cable_positions(np.array([length / 2.0]))[0, 2], 1e-6)
    arc_lengths = np.linspace(0.0, length, 41)
    exact = np.hypot(horizontal, weight * (arc_lengths - length / 2.0))
    worst = float(np.abs(simulation.cable_tension(arc_lengths) / exact - 1.0).max())
    yield Result("tension readout, worst of 41 points", "-", 0.0, worst, 1e-5)


@case("elastic catenary, inclined", "Irvine 1981")
def inclined_catenary() -> Iterator[Result]:
    """A rise of 60 m over 100 m, with 2 % of slack: the lowest point is within the span."""
    span, weight, stiffness, length = np.array([100.0, 60.0]), 98.1, 2e7, 120.0
    pull, position, tension = two_catenaries(span, weight, stiffness, length, 0.5 * length, 0.0, np.array([1e4, -1e3]))
    simulation = Simulation(
        load_scenario(LEVEL_SPAN, {"cable.end.position": [100.0, 60.0], "cable.unstrained_length": length})
    )
    start, end = (simulation.snapshot.supports[name].force for name in ("start", "end"))
    yield Result("horizontal tension", "N", pull[0], -start[0], 0.005)
    yield Result("vertical pull at the start", "N", pull[1], -start[2], 0.005)
    yield Result("tension at the end", "N", tension(np.array(length)), float(np.linalg.norm(end)), 0.005)
    arc_lengths = np.linspace(0.0, length, 33)
    exact = np.array([position(s) for s in arc_lengths])
    worst = float(np.abs(simulation.cable_positions(arc_lengths)[:, [0, 2]] - exact).max())
    yield Result("place, worst of 33 points", "m", 0.0, worst, 2e-6)
    worst = float(np.abs(simulation.cable_tension(arc_lengths) / tension(arc_lengths) - 1.0).max())
    yield Result("tension readout, worst of 33 points", "-", 0.0, worst, 2e-7)


@case("elastic catenary, 5000 kg at half length", "Irvine 1981, two catenaries")
def loaded_catenary() -> Iterator[Result]:
    """The load is a carriage with the joint of the paper, held at half length, which is a node.

    The slope of a cubic element is continuous, so it rounds the kink off over its length: the error is of first order.
    """
    weight, stiffness, length, load = 98.1, 2e7, 101.0, 5000.0 * GRAVITY
    pull, position, tension = two_catenaries(
        np.array([100.0, 0.0]), weight, stiffness, length, 0.5 * length, load, np.array([1e5, -3e4])
    )
    errors = []
    meshes = (64, 512) if JIT else (32, 64)
    for elements in meshes:
        changes = {"carriages": hung(0.5 * length, 5000.0), "cable.elements": elements, "cable.joint": "paper"}
        simulation = Simulation(load_scenario(LEVEL_SPAN, changes))
        start = simulation.snapshot.supports["start"].force
        carriage = simulation.snapshot.carriages["carriage"]
        coarse = 64 / elements
        end_tension = float(np.linalg.norm(start))
        errors.append(abs(end_tension - tension(np.array(0.0))))
        mesh = f", {elements} elements"
        yield Result(f"end tension{mesh}", "N", tension(np.array(0.0)), end_tension, 250.0 * coarse)
        yield Result(f"horizontal tension{mesh}", "N", pull[0], -start[0], 250.0 * coarse)
        yield Result(f"carriage x{mesh}", "m", position(0.5 * length)[0], carriage.position[0], 1e-8)
        yield Result(f"carriage z{mesh}", "m", position(0.5 * length)[1], carriage.position[2], 0.022 * coarse)
        yield Result(f"contact force z{mesh}", "N", load, carriage.contact_force[2], 1e-4)
    order = np.log2(errors[0] / errors[1]) / np.log2(meshes[1] / meshes[0])
    yield Result("order of convergence of the tension", "-", 1.0, float(order), 0.05)


def taut_inclined(
    mass: float, more: dict[str, Any] | None = None
) -> tuple[Simulation, Callable[[Array], Array], float]:
    """A taut rope up 300 m over 1000 m; with `mass` (kg) on it at 0.3 of its length, within an element.

    `more` changes keys of its scenario.

    Returns the simulation, the exact tension (N) by arc length (m) and the arc length of the carriage.
    """
    weight, stiffness, length = 20.0 * GRAVITY, 4e8, 1044.25
    place = 0.3 * length
    _, _, tension = two_catenaries(
        np.array([1000.0, 300.0]), weight, stiffness, length, place, mass * GRAVITY, np.array([1e6, 1e5])
    )
    changes = {
        "cable.unstrained_length": length,
        "cable.mass_per_length": 20.0,
        "cable.axial_stiffness": stiffness,
        "cable.bending_stiffness": 100.0,
        "cable.end.position": [1000.0, 300.0],
        "carriages": hung(place, mass) if mass > 0.0 else {},
        **(more or {}),
    }
    return Simulation(load_scenario(LEVEL_SPAN, changes)), tension, place


@case("tension readout, taut inclined rope", "Irvine 1981")
def taut_readout() -> Iterator[Result]:
    """Between nodes the readout is linear, so it must neither oscillate nor be off."""
    simulation, tension, _ = taut_inclined(0.0)
    arc_lengths = np.linspace(0.0, 1044.25, 501)
    got, exact = simulation.cable_tension(arc_lengths), tension(arc_lengths)
    yield Result("worst of 501 points", "-", 0.0, float(np.abs(got / exact - 1.0).max()), 3e-6)
    # a rope without load along it: the tension rises all the way up but for the lowest part
    wrong = np.diff(got) * np.sign(np.diff(exact)) < -1e-9 * exact[0]
    yield Result("points that fall where it rises", "-", 0.0, float(wrong.sum()), 0.0)


@case("tension readout beside a carriage", "Irvine 1981, two catenaries")
def carriage_readout() -> Iterator[Result]:
    """The rope has a kink at the carriage, within an element: no spike beside it, and a jump there.

    Where elements round the kink off, as with the joint of the paper, the whole rope hangs higher and has less tension.
    """
    for joint, off, jump in (("paper", 6e-4, 3e-3), ("node", 6e-5, 3e-4)):
        simulation, tension, place = taut_inclined(12_000.0, {"cable.joint": joint})
        arc_lengths = np.linspace(0.0, 1044.25, 501)
        error = np.abs(simulation.cable_tension(arc_lengths) / tension(arc_lengths) - 1.0)
        yield Result(f"joint {joint}, worst of 501 points", "-", 0.0, float(error.max()), off)
        beside = np.array([place - 1e-6, place + 1e-6])
        before, after = simulation.cable_tension(beside)
        exact = float(np.diff(tension(beside))[0])
        yield Result(f"joint {joint}, jump at the carriage", "N", exact, float(after - before), jump * exact)
    arc_lengths = np.array([0.0, 1044.25])
    forces = [float(np.linalg.norm(simulation.snapshot.supports[end].force)) for end in ("start", "end")]
    for end, force, got in zip(("start", "end"), forces, simulation.cable_tension(arc_lengths), strict=True):
        yield Result(f"at the {end}, beside the reaction there", "N", force, float(got), 1e-3)


@case("balance of supports and weights", "statics")
def balance() -> Iterator[Result]:
    """Two carriages, a point force and the rope's weight on two pins: no force and no moment is left over."""
    one, two = hung(30.0, 800.0)["carriage"], hung(71.3, 2500.0)["carriage"]
    loads = [{"arc_length": 55.0, "force": [3000.0, -7000.0]}]
    simulation = Simulation(
        load_scenario({**LEVEL_SPAN, "carriages": {"one": one, "two": two}}, {"cable.loads": loads})
    )
    snapshot = simulation.snapshot
    start, end = snapshot.supports["start"].force, snapshot.supports["end"].force
    weight = 98.1 * 101.0
    yield Result("vertical reactions", "N", weight + 3300.0 * GRAVITY + 7000.0, start[2] + end[2], 1e-3)
    yield Result("horizontal reactions", "N", -3000.0, start[0] + end[0], 1e-3)
    # moments about the start; the rope's own by Gauss points within each element
    points, weights = np.polynomial.legendre.leggauss(2)
    edges = np.linspace(0.0, 101.0, 65)
    middle, half = 0.5 * (edges[1:] + edges[:-1]), 0.5 * np.diff(edges)
    x = simulation.cable_positions((middle[:, None] + half[:, None] * points).ravel())[:, 0]
    rope = 98.1 * float((x * np.outer(half, weights).ravel()).sum())
    carried = sum(
        mass * GRAVITY * snapshot.carriages[name].bodies["body"].x for name, mass in (("one", 800.0), ("two", 2500.0))
    )
    at = simulation.cable_positions(np.array([55.0]))[0]
    point = at[0] * 7000.0 + at[2] * 3000.0
    yield Result("moment of the end reaction", "N m", rope + carried + point, 100.0 * end[2], 0.2)


def cantilever(changes: dict[str, Any], *, force: float = 0.0, moment: float = 0.0) -> Simulation:
    """Cantilever of CANTILEVER with a force (N) along -z and a moment (N m) about y at its tip."""
    load = {"arc_length": 1.0, "force": [0.0, -force], "moment": moment}
    return Simulation(load_scenario(CANTILEVER, {"cable.loads": [load], **changes}))


@case("large deflection cantilever, end force", "elastica")
def deflected_cantilever() -> Iterator[Result]:
    """P L² / EI of 1 and 10; the reference has the same EA."""
    for alpha in (1.0, 10.0):
        for model, tolerance in (("continuum", 1e-5), ("element_frame", 1e-3)):
            x, z, theta = elastica(alpha, 1e6, model)
            simulation = cantilever({"cable.elastic_model": model}, force=alpha)
            got = tip(simulation)
            yield Result(f"{model}, P L² / EI = {alpha:g}, tip x", "m", x, got[0], tolerance)
            yield Result(f"{model}, P L² / EI = {alpha:g}, tip z", "m", z, got[1], tolerance)
            yield Result(
                f"{model}, P L² / EI = {alpha:g}, tip angle", "rad", theta, direction(simulation, 1.0), tolerance
            )


@case("cantilever rolled into a half circle", "M = π EI / L", long=True)
def half_circle() -> Iterator[Result]:
    """An end moment bends the inextensible rod into an arc of radius EI / M."""
    for model, tolerance in (("continuum", 1e-5), ("element_frame", 4e-3)):
        simulation = cantilever({"cable.elastic_model": model}, moment=-np.pi)
        places = simulation.cable_positions(np.array([0.5, 1.0]))
        radius = 1.0 / np.pi
        yield Result(f"{model}, middle x", "m", radius, places[0, 0], tolerance)
        yield Result(f"{model}, middle z", "m", radius, places[0, 2], tolerance)
        yield Result(f"{model}, tip x", "m", 0.0, places[1, 0], tolerance)
        yield Result(f"{model}, tip z", "m", 2.0 * radius, places[1, 2], tolerance)


@case("order of convergence in space, cantilever", "elastica", needs_jit=True)
def order_in_space() -> Iterator[Result]:
    """Error of the tip on three meshes, each model against its own elastica.

    EA is 100 EI / L² in `continuum`, so that the error is that of bending: with a large EA, membrane locking on coarse
    meshes vanishes with higher orders yet, and the observed order is above 4.
    """
    for model, axial, order, tolerance in (("continuum", 1e2, 4.0, 0.05), ("element_frame", 1e4, 2.0, 0.05)):
        exact = np.array(elastica(3.0, axial, model)[:2])
        errors = []
        for elements in (8, 16, 32):
            changes = {"cable.elements": elements, "cable.axial_stiffness": axial, "cable.elastic_model": model}
            errors.append(float(np.linalg.norm(tip(cantilever(changes, force=3.0)) - exact)))
        for k, meshes in enumerate(("8 to 16", "16 to 32")):
            got = float(np.log2(errors[k] / errors[k + 1]))
            yield Result(f"{model}, order, {meshes} elements", "-", order, got, tolerance)
        yield Result(f"{model}, tip on 32 elements", "m", 0.0, errors[-1], 2e-8 if model == "continuum" else 4e-4)


@case("elastic models agree as elements vanish", "paper, eq. 7-9, against the continuum", needs_jit=True, long=True)
def models_agree() -> Iterator[Result]:
    """The paper's example at rest, its carriage held at arc length 3.2 m: the joint's place in both models."""
    apart = []
    for elements, tolerance in ((12, 6e-3), (24, 1.6e-3), (48, 3e-4), (96, 7e-5)):
        places = []
        for model in ("continuum", "element_frame"):
            changes = {"cable.elements": elements, "cable.elastic_model": model}
            places.append(Simulation(load_scenario("seed_example", changes)).snapshot.carriages["carriage"].position)
        apart.append(float(np.linalg.norm(places[1] - places[0])))
        yield Result(f"joint apart, {elements} elements", "m", 0.0, apart[-1], tolerance)
    yield Result("order, 48 to 96 elements", "-", 2.0, float(np.log2(apart[2] / apart[3])), 0.2)


@case("slack rope", "inextensible catenary")
def slack_rope() -> Iterator[Result]:
    """Half as long again as its span; the closed form has neither EA nor EI, here they are large and small."""
    length, span, weight = 150.0, 100.0, 98.1
    # sinh(u) / u = L / span, with u = w span / (2 H)
    u = brentq(lambda u: np.sinh(u) / u - length / span, 0.1, 5.0, xtol=1e-14)
    horizontal = weight * span / (2.0 * u)
    sag = horizontal / weight * (np.cosh(u) - 1.0)
    changes = {"cable.unstrained_length": length, "cable.axial_stiffness": 1e9, "cable.bending_stiffness": 0.01}
    simulation = Simulation(load_scenario(LEVEL_SPAN, changes))
    start = simulation.snapshot.supports["start"].force
    yield Result("horizontal tension", "N", horizontal, -start[0], 0.2)
    yield Result("end tension", "N", horizontal * np.cosh(u), float(np.linalg.norm(start)), 0.2)
    yield Result("sag", "m", sag, -simulation.cable_positions(np.array([0.5 * length]))[0, 2], 1e-3)
    arc_lengths = np.linspace(0.0, length, 31)
    x = span / 2.0 + horizontal / weight * np.arcsinh(weight * (arc_lengths - 0.5 * length) / horizontal)
    z = horizontal / weight * (np.cosh(weight * (x - span / 2.0) / horizontal) - np.cosh(u))
    worst = float(np.abs(simulation.cable_positions(arc_lengths) - np.stack([x, 0.0 * x, z], axis=1)).max())
    yield Result("place, worst of 31 points", "m", 0.0, worst, 1e-3)
