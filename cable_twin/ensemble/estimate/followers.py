"""Choice of the filter by which a twin follows a plant of its scenario."""

from __future__ import annotations

from cable_twin.ensemble.estimate.follower import Follower
from cable_twin.ensemble.estimate.line_follower import LineFollower
from cable_twin.scenario import Scenario

AnyFollower = Follower | LineFollower


def unfollowable(scenario: Scenario) -> str:
    """Reason in a line why a plant of a scenario cannot be followed; empty where it can."""
    if scenario.carriers is None:
        return "" if scenario.carriages else f"{scenario.name}: given no vehicles; allowed: carriages, or carriers"
    if not any(kind.payload is not None for kind in scenario.carriers.kinds_by_path.values()):
        return f"{scenario.name}: given carriers without payload; allowed: carriers with 'carriers.payload'"
    return ""


def follower_of(scenario: Scenario, threads: int | None = None) -> AnyFollower:
    """Filter by which a twin follows a plant, with carriages or with carriers; not for an `unfollowable` scenario."""
    return Follower(scenario, threads) if scenario.carriers is None else LineFollower(scenario)
