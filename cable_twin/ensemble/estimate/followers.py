"""Choice of the filter by which a twin follows a plant of its scenario."""

from __future__ import annotations

from cable_twin.ensemble.estimate.follower import Follower
from cable_twin.ensemble.estimate.line_follower import LineFollower
from cable_twin.scenario import Scenario

AnyFollower = Follower | LineFollower


def unfollowable(scenario: Scenario, live: bool = False) -> str:
    """Reason in a line why a plant of a scenario cannot be followed yet; empty where it can.

    Args:
        scenario: of the twin.
        live: whether it is to be followed from wherever it is.
    """
    if scenario.carriers is None and scenario.carriages and len(scenario.cables) == 1:
        return ""
    if live:
        return f"{scenario.name}: several ropes or carriers; allowed: carriages on one rope"
    if scenario.carriers is None:
        return f"{scenario.name}: carriages on several ropes; allowed: carriages on one rope, or carriers"
    if not any(kind.payload is not None for kind in scenario.carriers.kinds_by_path.values()):
        return f"{scenario.name}: carriers without payload; allowed: with 'carriers.payload'"
    return ""


def follower_of(scenario: Scenario, threads: int | None = None) -> AnyFollower:
    """Filter for a scenario that is not `unfollowable`."""
    return Follower(scenario, threads) if scenario.carriers is None else LineFollower(scenario)
