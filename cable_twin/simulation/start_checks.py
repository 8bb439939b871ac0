"""Checks of a start: compression, slack elements, few elements in a span, coarse saddles, long steps.

A rope without bending stiffness under compression is in an unstable equilibrium and is refused; the others warn
(theory.md: element frames, crossing of nodes).
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Mapping
from math import ceil, floor, inf, log, log10, nan, pi, sqrt

import numpy as np

from cable_twin.basics.units import counted, with_unit
from cable_twin.frame.records import CableSamples, SupportState
from cable_twin.mechanics.parameters import ELEMENT_FRAME, FloatArray, System
from cable_twin.mechanics.solution.catenary import EquilibriumError
from cable_twin.scenario import Scenario
from cable_twin.scenario.sections.vehicles import Carriage, CarrierKind
from cable_twin.simulation.vehicle_contacts import Pair, meeting_pairs

ROUNDING = 1e-9  # strain of compression by rounding alone
SHARE = 0.1  # of the tension, which curved elements may add to it: the shape is off by about a tenth of the sag then
E_FOLDS = 5.6  # by which the error of a joint has to die out on an element, measured
FEWEST = 5.0  # elements in a span beside a tower, below which its load is off by more than 2 %, measured
STATION = 0.25  # of the mean span, below which towers carry a bend of the rope and hardly its weight
SHAKE = 0.01  # of the depth in a saddle, by which a vehicle may rise and sink from contact point to contact point
STEPS = 5.0  # in an element that a joint with a node of its own passes, below which its force is wrong, measured
STEPS_IN_SWING = 12.0  # below which its period is off by 2.5 % and more, of generalized-alpha with a radius of 0.7
STEPS_IN_CONTACT = 8.0  # of two vehicles that meet, below which their highest force is up to 5 % too low, measured
FASTEST = 15.0  # m/s: the fastest aerial tramways run at 12.5
FASTEST_LIFT = 8.5  # m/s, on two or three ropes; chairs run at up to 6, gondolas on one rope at up to 7
ROUGHEST = 0.1  # of rolling friction: of lined rollers 0.003 to 0.03
LIGHTEST = 0.02  # of the mass of a vehicle, below which a payload is hardly one: of chairs and cabins 0.5 to 2
DENSITIES = 1e3, 12e3  # kg/m^3 of the circle of a rope: of steel ropes 4500 to 8500
DEEPEST = 0.25  # m that contacts of a tower yield under the rope at rest; those of towers yield by up to some cm
REACH = 0.45  # ln(1/ρ) times the elements that a wave crosses in a step, from which on nothing grows, measured


def check_pressure(system: System, rope: CableSamples) -> None:
    """Refuse a cable without bending stiffness under compression at the start, beyond its weight and rounding errors.

    Raises:
        EquilibriumError: the cable is under compression, and has no bending stiffness.
    """
    cable = system.cable
    weight = cable.mass_per_length * cable.unstrained_length * float(np.linalg.norm(cable.gravity))
    pressure = -float(rope.tensions.min())
    if cable.bending_stiffness == 0.0 and pressure > max(ROUNDING * cable.axial_stiffness, weight):
        raise EquilibriumError(
            "cable.bending_stiffness: given 0, but the cable starts under a compression of "
            f"{with_unit(pressure, 'N')}, which only "
            "a strut bears; allowed: a number above 0 in N m^2, a shorter cable, or gravity"
        )


def warn_of_units(scenario: Scenario) -> None:
    """Warn of speeds, friction, payloads and ropes that are hardly those of a ropeway, as in km/h, in % and in t."""
    lift = ("lifts", FASTEST_LIFT) if scenario.carriers else ("ropeways", FASTEST)
    limits = {f"{scenario.drive_key(name)}.limits": (one.limits, *lift) for name, one in scenario.drives.items()}
    limits |= {
        f"carriages.{name}.drive.limits": (one.drive.limits, "ropeways", FASTEST)
        for name, one in scenario.carriages.items()
    }
    rolling = {f"carriages.{name}": one.friction.rolling for name, one in scenario.carriages.items()}
    kinds: dict[str, Carriage | CarrierKind] = {f"carriages.{name}": one for name, one in scenario.carriages.items()}
    if scenario.carriers is not None:
        rolling["carriers"] = scenario.carriers.friction.rolling
        kinds |= {".".join(path): kind for path, kind in scenario.carriers.kinds_by_path.items()}
    told = []
    for key, (one, what, fastest) in limits.items() if kinds else ():
        if (speed := one.speed or 0.0) > fastest:
            told.append(
                f"{key}.speed of {speed:g} m/s: {what} run at up to {fastest:g} m/s; {speed:g} km/h are "
                f"{speed / 3.6:.3g} m/s"
            )
    for key, share in rolling.items():
        if share > ROUGHEST:
            told.append(
                f"{key}.friction.rolling of {share:g}: rollers have 0.003 to 0.03; {share:g} % are {0.01 * share:g}"
            )
    for key, kind in kinds.items():
        empty = sum(body.mass for body in kind.bodies.values())
        room = empty if kind.payload is None else kind.payload.capacity
        if room < LIGHTEST * empty:
            told.append(
                f"{key}.payload.capacity of {room:g} kg: less than {100.0 * LIGHTEST:g} % of the {empty:g} kg that "
                f"carry it; {room:g} t are {1e3 * room:g} kg"
            )
    for name, rope in scenario.cables.items():
        mass, diameter = rope.mass_per_length, nan if rope.diameter is None else rope.diameter
        if (density := mass / (0.25 * pi * diameter**2)) < DENSITIES[0] or density > DENSITIES[1]:
            told.append(
                f"{scenario.rope_key(name)}.mass_per_length of {mass:g} kg/m: with the diameter of {diameter:g} m a "
                f"density of {density:.3g} kg/m^3; steel ropes have 4500 to 8500"
            )
    for line in told:
        warnings.warn(line, stacklevel=3)


def warn_of_soft_towers(scenario: Scenario, supports: Mapping[str, SupportState]) -> None:
    """Warn of towers whose contacts yield so far under the rope at rest that it is not where the tower is."""
    for name, tower in scenario.towers.items():
        state = supports[name].tower
        load = 0.0 if state is None else state.normal_load
        if (depth := load / (tower.contacts * tower.stiffness)) > DEEPEST:
            warnings.warn(
                f"towers.{name}.stiffness of {with_unit(tower.stiffness, 'N/m')}: {counted(tower.contacts, 'contact')} "
                f"yield by {with_unit(depth, 'm', 2)} under the {with_unit(load, 'N', 3)} at rest, and the rope hangs "
                "so much lower; those of towers yield by some cm at most",
                stacklevel=3,
            )


def warn_of_frames(system: System, rope: CableSamples, nodes: FloatArray) -> None:
    """Warn of elements so curved relative to their chord frame that spurious strain is not small against the tension.

    An element that turns by φ over its length l has slopes up to φ/2 aside of its chord, which shortens them there by
    φ²/24 on average: EA φ²/24 beside T. Under its weight w, φ = w l / T. A load of a vehicle or tower turns its element
    by load over T, however short that is, and slopes that strain gives way to may turn by radians, as at ends.

    Args:
        system: of the rope.
        rope: at rest.
        nodes: (n, 2, dim) positions in m and slopes of its nodes there.
    """
    cable = system.cable
    tension = max(float(np.abs(rope.tensions).min()), 1e-9)
    weight = cable.mass_per_length * float(np.linalg.norm(cable.gravity))
    if cable.elastic_model != ELEMENT_FRAME or weight == 0.0:
        return
    longest = (24.0 * SHARE * tension**3 / cable.axial_stiffness) ** 0.5 / weight
    if float(cable.element_length.max()) > longest:
        warnings.warn(
            f"cable.elastic_model element_frame on a slack rope (least tension {with_unit(tension, 'N', 3)}): "
            "elements of "
            f"{with_unit(float(cable.element_length.max()), 'm', 3)} are too long for its curvature, and its shape "
            "may be "
            f"off by metres; elements up to {with_unit(longest, 'm', 2)}, or elastic_model continuum, prevent that",
            stacklevel=3,
        )
        return
    slopes = nodes[:, 1] / np.linalg.norm(nodes[:, 1], axis=1, keepdims=True)
    turn = float(np.arccos(np.clip(np.sum(slopes[1:] * slopes[:-1], axis=1), -1.0, 1.0)).max())
    if (strain := turn**2 / 24.0) * cable.axial_stiffness > SHARE * tension:
        warnings.warn(
            f"cable.elastic_model element_frame: the rope turns by {turn:.2g} rad within an element, as under a "
            f"vehicle, at a tower or an end, which strains it by {with_unit(strain * cable.axial_stiffness, 'N', 2)} "
            f"beside a least tension of {with_unit(tension, 'N', 3)}: sag, clearance and forces there may be wrong by "
            "multiples; elastic_model continuum prevents that, shorter elements only lessen it",
            stacklevel=3,
        )


def with_frames_told(error: EquilibriumError, systems: Iterable[System]) -> EquilibriumError:
    """Error of an equilibrium that is not found, with the advice on elements in frames where a rope has them."""
    if not any(system.cable.elastic_model == ELEMENT_FRAME for system in systems):
        return error
    return EquilibriumError(f"{error}; first of all, elastic_model continuum: element_frame bends badly under vehicles")


def warn_of_mesh(scenario: Scenario, system: System) -> None:
    """Warn of elements so long beside a tower of a rope that its load is wrong, of spans as long as their chords."""
    cable, corners = system.cable, np.array([scenario.vector(place) for place in scenario.corners])
    spans = np.linalg.norm(np.diff(corners, axis=0), axis=1)
    if len(spans) < 2 or not np.any(cable.gravity):
        return
    places = np.cumsum(spans)[:-1] * cable.unstrained_length / spans.sum()
    nodes = np.cumsum(cable.element_length)
    beside = cable.element_length[np.minimum(np.searchsorted(nodes, places), len(nodes) - 1)]
    span = 0.5 * (spans[1:] + spans[:-1])  # whose weight the tower carries
    few = np.where(span < STATION * spans.mean(), FEWEST, span / beside)
    worst = int(few.argmin())
    if few[worst] < FEWEST:
        warnings.warn(
            f"elements of {with_unit(float(beside[worst]), 'm', 3)} beside tower {list(scenario.towers)[worst]!r}, "
            f"whose spans are {with_unit(float(span[worst]), 'm', 3)} long on average: with fewer than {FEWEST:g} "
            "in a span loads of towers and ends may be off by more than 2 %, with one by tens of per cent; elements "
            f"up to {with_unit(float(span[worst]) / FEWEST, 'm', 2)}, or a graded mesh, prevent that",
            stacklevel=3,
        )


def warn_of_saddles(scenario: Scenario, rope: CableSamples) -> None:
    """Warn of contact points of saddles so far apart that vehicles on them rise and sink, which no real saddle does.

    A load F on a rope under the tension T, borne by points of stiffness k at distances a, sinks by F a / (4 T) more
    between two of them than on one: it rises and sinks by the share k a / (8 T) of its mean depth, F √(a / k T) / 2.
    """
    tension = float(rope.tensions.min())
    if tension <= 0.0 or all(vehicle.joint == "fixed" for vehicle in scenario.vehicles.values()):
        return
    for name, tower in scenario.towers.items():
        if tower.kind != "saddle" or tower.contacts < 2:
            continue
        apart = tower.length / (tower.contacts - 1)
        share = tower.stiffness * apart / (8.0 * tension)
        if share > SHAKE:
            parts = ceil(sqrt(share / SHAKE))
            much = f"by {share:.0%} of" if share < 1.0 else "by more than"
            warnings.warn(
                f"contact points of saddle {name!r}, {with_unit(apart, 'm', 2)} apart and of "
                f"{with_unit(tower.stiffness, 'N/m', 2)} each, shake vehicles on the saddle {much} their depth in it, "
                f"which adds to loads and forces; contacts: {parts * (tower.contacts - 1) + 1} with "
                f"stiffness: {with_unit(tower.stiffness / parts, 'N/m', 3)} prevent that",
                stacklevel=3,
            )


def two_digits_of(step: float) -> str:
    """Text of the longest step (s) of two digits that is not above a given one, above 0."""
    digit = 10.0 ** (floor(log10(step)) - 1)
    return f"{floor(step / digit) * digit:.2g}"


def growing_steps(spectral_radius: float, length: float, speed: float, wave: float) -> tuple[float, float]:
    """Interval of step sizes (s) of generalized-alpha in which the joint force at nodes may grow.

    Those with speed h/l > ln(1/ρ)/5.6 and wave h/l < 0.45/ln(1/ρ); none where the first is not below the second.

    Args:
        spectral_radius: ρ, at infinite frequency.
        length: l, of the elements (m).
        speed: of the joint along the cable (m/s), at least 0.
        wave: speed of transverse waves (m/s), at least 0.
    """
    decay = log(1.0 / spectral_radius) if spectral_radius > 0.0 else inf
    shortest = decay / E_FOLDS * length / speed if speed > 0.0 else inf
    return shortest, REACH / decay * length / wave if decay * wave > 0.0 else inf


def highest_speed(vehicles: Scenario, drives: Scenario) -> float:
    """Highest speed (m/s) of the vehicles of one scenario with the drives of another; 0 without any limit."""
    moved = [one for one in vehicles.vehicles.values() if one.joint != "fixed"]
    limits = [drive.limits.speed for drive in drives.drives.values()] if moved else []
    limits += [one.drive.limits.speed for one in moved]
    return max([*(limit for limit in limits if limit is not None), *(abs(one.speed) for one in moved)], default=0.0)


def warn_of_crossing(vehicles: Scenario, drives: Scenario, system: System, rope: CableSamples) -> None:
    """Warn of a step size with which joint forces are wrong or may grow on the shortest elements of a rope.

    A joint that is a node of its own needs `STEPS` in each element that it passes; of one within an element the force
    may grow, at the least tension of `rope`.
    """
    step, radius = system.solver.step, system.solver.spectral_radius
    speed, length = highest_speed(vehicles, drives), float(system.cable.element_length.min())
    if vehicles.joint == "node":
        if speed * step * STEPS > 1.01 * length:  # elements may be a little shorter than asked for
            warnings.warn(
                f"solver.step of {step:g} s: a vehicle at its highest speed, {speed:g} m/s, passes elements of "
                f"{with_unit(length, 'm', 3)} in {length / (speed * step):.1f} steps; below {STEPS:g} its forces are "
                f"wrong; a step up to {two_digits_of(length / (speed * STEPS))} s, or longer elements, prevent that",
                stacklevel=3,
            )
        return
    wave = sqrt(max(float(rope.tensions.min()), 0.0) / system.cable.mass_per_length)
    shortest, longest = growing_steps(radius, length, speed, wave)
    if shortest < step < longest:
        warnings.warn(
            f"solver.step of {step:g} s is above {shortest:.3g} s, the longest for a vehicle at {speed:g} m/s on "
            f"elements of {with_unit(length, 'm', 3)} with solver.spectral_radius {radius:g}: the force of its "
            "joint may grow from "
            "node to node; a shorter step, longer elements or a lower radius prevent that",
            stacklevel=3,
        )


def swing_period(vehicle: Carriage, gravity: float) -> float:
    """Period (s) of small swings of a vehicle along the track, as one rigid body that hangs from its joint.

    2π sqrt(I/(m g d)), with the moment of inertia I about the joint, and the depth d of the centre of mass below it.

    Args:
        vehicle: with its bodies; its payload is left out.
        gravity: g, m/s².

    Returns:
        The period; infinite where nothing pulls it back.
    """
    pin = moment = inertia = 0.0
    for body in vehicle.bodies.values():
        height = pin - body.upper_pivot[-1]
        moment -= body.mass * height
        inertia += body.inertia + body.mass * height**2
        pin = height + (body.lower_pivot or (0.0, 0.0))[-1]
    return 2.0 * pi * sqrt(inertia / (moment * gravity)) if moment * gravity > 0.0 else inf


def warn_of_swings(scenario: Scenario) -> None:
    """Warn of a step size with which a vehicle on a rope has too few steps in a swing for the right period of it."""
    step = scenario.solver.step
    periods = {name: swing_period(one, scenario.gravity) for name, one in scenario.vehicles.items()}
    fastest = min(periods, key=periods.__getitem__, default="")
    if fastest and periods[fastest] < STEPS_IN_SWING * step:
        warnings.warn(
            f"solver.step of {step:g} s: {fastest!r} swings once in {with_unit(periods[fastest], 's', 2)}, in "
            f"{periods[fastest] / step:.1f} steps; below {STEPS_IN_SWING:g} its period is wrong by 2.5 % and more; "
            f"a step up to {two_digits_of(periods[fastest] / STEPS_IN_SWING)} s prevents that",
            stacklevel=3,
        )


def contact_time(scenario: Scenario, pair: Pair) -> float:
    """Time (s) after which two empty vehicles that meet part again: half a period of both on their buffers.

    Infinite where neither of them moves.
    """
    vehicles = [list(scenario.vehicles.values())[row] for row in (pair.before, pair.after)]
    if all(one.joint == "fixed" for one in vehicles):
        return inf
    masses = [sum(body.mass for body in one.bodies.values()) for one in vehicles]
    return pi * sqrt(masses[0] * masses[1] / (sum(masses) * pair.stiffness))


def warn_of_short_contacts(scenario: Scenario) -> None:
    """Warn of a step size with which two vehicles that meet part after too few steps for the force of their buffers."""
    step, names = scenario.solver.step, list(scenario.vehicles)
    times = {pair: contact_time(scenario, pair) for pair in meeting_pairs(scenario)}
    shortest = min(times, key=times.__getitem__, default=None)
    if shortest is not None and times[shortest] < STEPS_IN_CONTACT * step:
        warnings.warn(
            f"solver.step of {step:g} s: {names[shortest.before]!r} and {names[shortest.after]!r}, should they meet, "
            f"part after {with_unit(times[shortest], 's', 2)}, in {times[shortest] / step:.1f} steps; below "
            f"{STEPS_IN_CONTACT:g} the highest force of their buffers is 5 % too low and more; "
            f"a step up to {two_digits_of(times[shortest] / STEPS_IN_CONTACT)} s prevents that",
            stacklevel=3,
        )
