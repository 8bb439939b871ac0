"""Travel of a haul rope limited by the end stops of the carriages clamped to it on their own track ropes."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from cable_twin.scenario.builders.vehicles import stop_stroke
from cable_twin.scenario.checks.fault import Fault
from cable_twin.scenario.schema import Scenario

ROUNDING = 0.01  # m, to which the limits are told


class Way(NamedTuple):
    """Range of travel of a haul rope between the end stops of a carriage at both ends of its track."""

    low: float  # m of haul rope gone by since the start
    high: float


def way_between_stops(scenario: Scenario, name: str) -> Way:
    """Travel of the haul rope between the end stops of a carriage clamped to it, for inextensible ropes."""
    carriage = scenario.carriages[name]
    track = carriage.rope or next(iter(scenario.ropes))
    stroke, length = stop_stroke(scenario.of_rope(track), carriage), scenario.ropes[track].unstrained_length
    ends = (sense_of(scenario, name) * (end - carriage.arc_length) for end in (stroke, length - stroke))
    return Way(*sorted(ends))


def sense_of(scenario: Scenario, name: str) -> float:
    """Sense of the track rope of a carriage relative to its haul rope: 1 for equal directions, else -1."""
    carriage = scenario.carriages[name]
    haul = scenario.ropes[next(iter(carriage.clamped_to))]
    track = scenario.ropes[carriage.rope or next(iter(scenario.ropes))]
    ways = [rope.end.position[0] - rope.start.position[0] for rope in (track, haul)]
    return 1.0 if ways[0] * ways[1] >= 0.0 else -1.0


def travel_faults(scenario: Scenario) -> Iterator[Fault]:
    """Faults of drives whose travel pulls a carriage into its end stops, for ropes and clamps without faults."""
    hauled = [name for name, one in scenario.carriages.items() if scenario.strands.keys() & one.clamped_to.keys()]
    ways = {name: way_between_stops(scenario, name) for name in hauled}
    loops = sum(strand.offset == 0.0 for strand in scenario.strands.values())
    if not ways or loops > 1:  # of several loops each would have ways of its own
        return
    first, last = max(ways, key=lambda name: ways[name].low), min(ways, key=lambda name: ways[name].high)
    low, high = ways[first].low, ways[last].high
    for name, drive in scenario.drives.items():
        if drive.travel is None or drive.travel[0] > drive.travel[1]:  # which is told elsewhere
            continue
        if low - ROUNDING <= drive.travel[0] and drive.travel[1] <= high + ROUNDING:
            continue
        beyond = first if drive.travel[0] < low - ROUNDING else last
        yield Fault(
            ("drives", name, "travel"),
            f"given {list(drive.travel)} m, with which {beyond!r} would run into an end stop of its track; allowed: "
            f"{low:.2f} to {high:.2f} m",
        )


__all__ = ["Way", "sense_of", "travel_faults", "way_between_stops"]
