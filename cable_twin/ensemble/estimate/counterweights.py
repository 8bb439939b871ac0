"""Counterweights of a plant that are stuck, found by the load cells at the ends of their rope."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from cable_twin.scenario import Scenario

SURELY = 5.0  # standard deviations of a change of tension at an end


class Stuck(NamedTuple):
    """Counterweight that is stuck: name of its support, and what is said about it; both empty for none."""

    support: str = ""
    reason: str = ""


def stuck_counterweight(scenario: Scenario, apart: Mapping[str, float], sure: Mapping[str, float]) -> Stuck:
    """Counterweight that is stuck, whose own load cell is farthest from the model.

    The other end of the rope has a change of tension of the same sign, smaller by the friction of towers.

    Args:
        scenario: of the twin.
        apart: N, mean measured less predicted force of a window, by support with a load cell.
        sure: the same in standard deviations.
    """
    for rope, cable in scenario.cables.items():
        names = scenario.end_names(rope)
        if not all(name in apart for name in names):
            continue
        for end, name, other in zip(cable.ends.values(), names, reversed(names), strict=True):
            farthest = abs(sure[name]) >= max(map(abs, sure.values()))
            against = sure[name] * sure[other] < 0.0 and abs(sure[other]) > SURELY
            if end.support == "counterweight" and farthest and abs(sure[name]) > SURELY and not against:
                first, last = (f"{apart[one] / 1e3:+.1f}" for one in names)
                said = f"the counterweight at {name} is stuck: tension changes by {first} and {last} kN at the ends"
                return Stuck(name, said)
    return Stuck()
