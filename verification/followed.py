"""Plants that are followed: with another mesh than the twin, values that change under way, and sensors.

What `verification.following`, `verification.alarms` and `verification.faultless` have in common.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from time import process_time
from typing import Any, NamedTuple

import numpy as np

from cable_twin import Ensemble
from cable_twin.ensemble.estimate.correction import Correction
from cable_twin.ensemble.estimate.detectors.alarm import Alarm
from cable_twin.ensemble.estimate.follower import Follower
from cable_twin.ensemble.estimate.tracker import News, Tracker
from cable_twin.frame.records import AppliedCommand, Command, FloatArray
from cable_twin.frame.sensors import Measurement, Sensors
from cable_twin.frame.snapshot import Snapshot
from cable_twin.scenario import Scenario

FRAME = 0.02  # s
REPEATED = 0.1  # s, from a live command to the next
ARRIVED = 0.1  # s after its time, when a measurement has arrived for sure
TRAMWAY = {"cable.elements.target": 7.0, "cable.elements.at_towers": 0.55}
ROPES = {
    f"ropes.{kind}_{number}.elements": {"target": target, "at_towers": at_towers, "growth": 2.0}
    for kind, target, at_towers in (("track", 9.0, 0.5), ("haul", 5.0, 1.5))
    for number in (1, 2)
}


def _lift(target: float, at_towers: float, growth: float, kinds: Sequence[str] = ("",)) -> dict[str, Any]:
    """Half the step, and elements (m) of the ropes of a lift that are finer than those of the scenario."""
    elements = {"target": target, "at_towers": at_towers, "growth": growth}
    ropes = [f"{kind}{strand}" for kind in kinds for strand in ("up", "down")]
    return {"solver.step": 0.005} | {f"ropes.{rope}.elements": elements for rope in ropes}


class Scene(NamedTuple):
    """Scenario with what its plants have otherwise."""

    mesh: Mapping[str, Any]  # by key
    drive: str  # as commands call it
    speeds: tuple[float, float]  # m/s, from which the speed of a trip is drawn


SCENES = {
    "aerial_tramway": Scene(TRAMWAY, "cabin", (6.0, 9.0)),
    "windy_tramway": Scene(TRAMWAY, "cabin", (5.0, 8.0)),
    "jig_back": Scene(ROPES, "haul_rope", (6.0, 9.0)),
}
LIFTS = {
    "chairlift": Scene(_lift(9.0, 0.6, 3.0), "haul_rope", (2.5, 2.5)),
    "gondola": Scene(_lift(10.0, 1.0, 2.0), "haul_rope", (5.0, 5.0)),
    "bicable": Scene(_lift(8.0, 1.0, 3.0, ("track_", "haul_")), "haul_rope", (5.0, 5.0)),
}

Changed = Callable[[Measurement], Measurement]
Driver = Callable[[Snapshot], list[Command]]


class Step(NamedTuple):
    """Something that is done to a plant at a time (s): a command, of which its twin hears, or a change of values."""

    time: float
    command: Command | None = None
    values: Callable[[Snapshot], Mapping[str, Any]] | None = None  # by dotted key, from the present frame


class Plant:
    """Plant whose values may change while it moves.

    Args:
        scenario: of it, with its sensors.
        steps: what is done to it, in the order of their times.
        driver: who commands it by its frames; None for nobody.
    """

    def __init__(self, scenario: Scenario, steps: Sequence[Step], driver: Driver | None = None) -> None:
        self._ensemble = Ensemble(scenario, 1, threads=1, progress=False)
        self._sensors, self._steps = Sensors(scenario, self._ensemble.layout), [*steps]
        self._driver = driver or (lambda _: [])

    def frames(self, duration: float) -> Iterator[tuple[float, Snapshot, list[Command], list[Measurement]]]:
        """Each frame with its time (s), the commands of which its twin hears, and the measurements that arrive."""
        for frame in range(round(duration / FRAME) + 1):
            time = round(frame * FRAME, 9)
            self._ensemble.advance_to(time)
            for fault in self._ensemble.faults.values():
                raise RuntimeError(f"plant at {time:g} s: {fault}")
            snapshot, given = self._ensemble.snapshot(0), list[Command]()
            while self._steps and self._steps[0].time <= time:
                step = self._steps.pop(0)
                given += [] if step.command is None else [step.command]
                if step.values is not None:
                    self._ensemble.change({key: [value] for key, value in step.values(snapshot).items()})
            given += self._driver(snapshot)
            for command in given:
                self._ensemble.apply(command)
            yield time, snapshot, [one for one in given if one.kind == "speed"], self._sensors.take(snapshot)
        self._ensemble.close()


def _same(one: Measurement) -> Measurement:
    return one


def measured(plant: Plant, duration: float, changed: Changed = _same) -> Iterator[tuple[float, list[Measurement]]]:
    """Measurements of a plant as they come, by frame."""
    for time, _, _, arrived in plant.frames(duration):
        yield time, [changed(one) for one in arrived]


def corrections(
    plant: Plant, follower: Follower, duration: float, took: list[float], changed: Changed = _same
) -> Iterator[tuple[Correction, FloatArray]]:
    """Corrections of a twin that follows a plant, each with the numbers of the plant's frame of that time.

    Args:
        plant: what is followed.
        follower: twin.
        duration: s.
        took: to which the processor time (s) of the twin is added.
        changed: what becomes of a measurement between plant and twin.
    """
    waiting: list[Measurement] = []
    plant_at: dict[float, FloatArray] = {}
    for time, snapshot, given, arrived in plant.frames(duration):
        begun = process_time()
        for command in given:
            follower.command(AppliedCommand(time, command, "plant"))
        took.append(process_time() - begun)
        waiting += map(changed, arrived)  # in the order of arrival
        plant_at = {key: row for key, row in plant_at.items() if key > time - 0.5}
        plant_at[snapshot.time] = np.array(snapshot.numbers)
        due = [one for one in waiting if one.time <= time - ARRIVED]
        waiting = [one for one in waiting if one.time > time - ARRIVED]
        for stamp in sorted({one.time for one in due}):
            begun = process_time()
            correction = follower.take(stamp, [one for one in due if one.time == stamp])
            took.append(process_time() - begun)
            if correction is not None:
                yield correction, plant_at[stamp]
    follower.close()


def news(
    plant: Plant, tracker: Tracker, duration: float, took: list[float], changed: Changed = _same
) -> Iterator[News]:
    """News of a twin that follows a plant live, whose clock is that of the plant; else as `corrections`.

    Commands are repeated, as somebody who drives live does.
    """
    speeds: dict[str, float] = {}
    last = 0.0
    for time, _, given, arrived in plant.frames(duration):
        begun = process_time()
        for command in given:
            speeds |= command.values
        if speeds and (given or time >= last + REPEATED):
            tracker.command(speeds, time)
            last = time
        tracker.measure([changed(one) for one in arrived], time)
        told = [*tracker.advance(time)]
        took.append(process_time() - begun)
        yield from told
    tracker.follower.close()


def alarms_of(told: Iterable[News]) -> Iterator[Alarm]:
    """Alarms of a twin, and its other warnings."""
    for one in told:
        yield from (Alarm(one.time, line) for line in one.warnings)
        yield from one.correction.alarms if one.correction else ()
