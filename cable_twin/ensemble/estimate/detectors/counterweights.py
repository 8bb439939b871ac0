"""Counterweights of a plant that are stuck: found by the load cells at the ends of their rope, and held in its twin."""

from __future__ import annotations

from collections.abc import Container, Mapping
from math import inf
from typing import Any, NamedTuple

import numpy as np

from cable_twin.ensemble.ensemble import Ensemble
from cable_twin.ensemble.estimate.quantities import Slow, weights_along
from cable_twin.mechanics.parameters import FloatArray
from cable_twin.scenario import Scenario

SURELY = 5.0  # standard deviations of a change of tension at an end
STUCK = 0.01  # of its pull, by which the tension of a stuck counterweight may be another one, a standard deviation
CREEP = 0.1  # of that, a standard deviation after a second, by which it may move on
LEAST_WAY = 1e-9  # m/kg, of a counterweight that moves if it is heavier
ROOM = 1e-4  # m, between its stops


class Stuck(NamedTuple):
    """Counterweight that is stuck: name of its support, and what is said about it; both empty for none."""

    support: str = ""
    reason: str = ""
    tension: float = 0.0  # N, measured at it, less that of the model


def stuck_counterweight(
    scenario: Scenario, apart: Mapping[str, float], sure: Mapping[str, float], held: Container[str]
) -> Stuck:
    """Counterweight that is stuck, whose own load cell is farthest from the model.

    The other end of the rope has a change of tension of the same sign, smaller by the friction of towers.

    Args:
        scenario: of the twin.
        apart: N, mean measured less predicted force of a window, by support with a load cell.
        sure: the same in standard deviations.
        held: names of quantities that are masses of counterweights already known to be stuck.
    """
    for rope, cable in scenario.cables.items():
        names = scenario.end_names(rope)
        if not all(name in apart for name in names):
            continue
        for end, name, other in zip(cable.ends.values(), names, reversed(names), strict=True):
            farthest = abs(sure[name]) >= max(map(abs, sure.values()))
            against = sure[name] * sure[other] < 0.0 and abs(sure[other]) > SURELY
            moves = end.support == "counterweight" and mass_of(name) not in held
            if moves and farthest and abs(sure[name]) > SURELY and not against:
                first, last = (f"{apart[one] / 1e3:+.1f}" for one in names)
                said = f"the counterweight at {name} is stuck: tension changes by {first} and {last} kN at the ends"
                return Stuck(name, said, apart[name])
    return Stuck()


def mass_of(support: str) -> str:
    """Name of the quantity that is the mass of the counterweight at a support."""
    return f"{support}/counterweight"


def held_at(mass: Slow, travel: float, way: float, more: float) -> Slow | None:
    """Travel at which a stuck counterweight is held, as a quantity instead of its mass; None for one that never moves.

    It is held between buffers, which are two orders of magnitude stiffer than a rope.

    Args:
        mass: the quantity that is its mass.
        travel: m, of the twin.
        way: m/kg, by which it moves in the twin if it is heavier.
        more: kg, by which it seems to be heavier.
    """
    if not way > LEAST_WAY:
        return None
    deviation = STUCK * mass.mean * way
    return mass._replace(
        key=f"{mass.key.rpartition('.')[0]}.travel",
        unit="m",
        mean=travel + more * way,
        deviation=deviation,
        low=-inf,
        high=inf,
        plan=travel + more * way,
        tolerance=inf,
        walk=CREEP * deviation,
        change=deviation,
        room=ROOM,
    )


def hold(
    ensemble: Ensemble, mass: Slow, points: FloatArray, travels: FloatArray, sides: tuple[int, int], more: float
) -> Slow | None:
    """Hold a stuck counterweight in all members at travels about one that is estimated, returned instead of its mass.

    The members with its mass above and below the estimate have their rope tensioned more and less. What they differ
    by is what each member is moved by to one travel of all, and the two above and below it by more of that.

    Args:
        ensemble: members, which are blended.
        mass: the quantity that is its mass.
        points: (2 n + 1,) masses of the first members, which become travels (m).
        travels: (members,) m.
        sides: members with more and with less mass.
        more: kg, by which it seems to be heavier.

    Returns:
        The travel as a quantity; None for a counterweight that never moves.
    """
    above, below = sides
    way = float((travels[above] - travels[below]) / (points[above] - points[below]))
    held = held_at(mass, float(travels[0]), way, more)
    if held is None:
        return None
    wanted = np.full(travels.size, held.mean)
    wanted[[*sides]] += held.deviation, -held.deviation
    ensemble.blend(weights_along(travels, wanted, above, below))
    ensemble.change({mass.key: float(points[0])})
    points[:] = wanted[: points.size]
    return held


def stops_of(scenario: Scenario) -> dict[str, Any]:
    """Travels of all counterweights at the ends of ropes, by dotted key: those of counterweights that are not held."""
    return {
        f"{scenario.rope_key(rope)}.{name}.travel": end.travel
        for rope, cable in scenario.cables.items()
        for name, end in cable.ends.items()
        if end.support == "counterweight"
    }
