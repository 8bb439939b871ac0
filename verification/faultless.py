"""Hours of plants without any fault: no alarm may come from the twins that follow them.

`python -m verification.faultless` lets live twins follow plants of a scenario with another mesh, noisy sensors, and
wind and friction that are drawn within what is tolerated. Carriages go from station to station in gusts, with stays; a
lift runs at changing speeds with stops. Each plant has a seed of its own, and its line is printed as soon as it ends,
with the alarms, so that a run of many hours may be ended at any time.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Mapping, Sequence
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np
from rich.console import Console
from rich.progress import Progress

from cable_twin.ensemble.estimate.tracker import Tracker
from cable_twin.frame.records import Command
from cable_twin.frame.sensors import standard_sensors
from cable_twin.frame.snapshot import Snapshot
from cable_twin.scenario import Scenario, load_scenario
from cable_twin.scenario.builders.system import tower_friction
from cable_twin.simulation import Simulation
from cable_twin.terminal.command_line import Filled
from verification.followed import LIFTS, SCENES, Plant, alarms_of, news

BEGINS = 20.0  # s, when a plant begins to move
GUST, GUST_TIME, BLOWN = 1.0, 50.0, 5.0  # m/s, s in which they change, s from one to the next
WIND = 2.0  # m/s, standard deviation of the mean wind along the track, and across it in space
ROUGH = 0.2  # by which friction may be another one than that of the scenario, of which half is tolerated
STAYS, RUNS = (30.0, 120.0), (120.0, 600.0)  # s, in a station, and of a lift at one speed
STOPS = 0.3  # probability that a lift stops after that
SLOWEST = 0.4  # of the largest speed, for a lift
JERKING = 1.2  # s, by which a drive begins to slow down later than commanded


class Trips(NamedTuple):
    """How a carriage goes from station to station."""

    vehicle: str
    ends: tuple[float, float]  # m, places there
    slowing: float  # m/s^2, with which its drive stops
    planned: Mapping[str, Any]  # values of twin and plants, by key


ONE_CABIN = Trips("cabin", (12.0, 1030.0), 0.45, {"carriages.cabin.payload.mass": 6000.0})
TRIPS = {
    "aerial_tramway": ONE_CABIN,
    "windy_tramway": ONE_CABIN,
    "jig_back": Trips("cabin_1", (14.5, 1024.0), 0.3, {"carriages.cabin_1.payload.mass": 6000.0}),
}
SCENARIOS = (*TRIPS, *LIFTS)


class Shuttle:
    """Driver of trips from station to station, in gusts.

    Args:
        drive: as commands call it.
        trips: of which vehicle.
        wind: m/s along the track and, in space, across it, on the average.
        seed: of speeds, stays and gusts.
        speeds: m/s, from which that of a trip is drawn.
    """

    def __init__(
        self, drive: str, trips: Trips, wind: Sequence[float], seed: int, speeds: tuple[float, float] = (4.0, 8.0)
    ) -> None:
        self._drive, self._trips, self._speeds = drive, trips, speeds
        self._draws, self._until, self._speed, self._blown = np.random.default_rng(seed), BEGINS, 0.0, 0.0
        self._wind, self._gust = np.array(wind), np.zeros(len(wind))
        self.trips = 0

    def __call__(self, snapshot: Snapshot) -> list[Command]:
        """Commands of a frame."""
        time, given = snapshot.time, list[Command]()
        if time >= self._blown:
            self._blown += BLOWN
            kept = float(np.exp(-BLOWN / GUST_TIME))
            self._gust *= kept
            self._gust += GUST * np.sqrt(1.0 - kept**2) * self._draws.standard_normal(self._gust.size)
            given.append(
                Command("wind", dict(zip("xy", (self._wind + self._gust).tolist(), strict=False)) | {"z": 0.0})
            )
        ends, slowing = self._trips.ends, self._trips.slowing
        place = float(snapshot.columns.arc_length[snapshot.layout.vehicle_rows[self._trips.vehicle]])
        if self._speed == 0.0 and time >= self._until:
            up = place < 0.5 * sum(ends)
            self._speed = float(self._draws.uniform(*self._speeds)) * (1.0 if up else -1.0)
            given.append(Command("speed", {self._drive: self._speed}))
            self.trips += 1
        elif self._speed != 0.0:
            left = (ends[1] - place) if self._speed > 0.0 else (place - ends[0])
            if left <= self._speed**2 / (2.0 * slowing) + abs(self._speed) * JERKING:
                self._until = time + abs(self._speed) / slowing + float(self._draws.uniform(*STAYS))
                self._speed = 0.0
                given.append(Command("speed", {self._drive: 0.0}))
        return given


class Circulation:
    """Driver of a lift: speeds that change, and stops.

    Args:
        drive: as commands call it.
        most: m/s, largest speed.
        seed: of speeds and stops.
    """

    def __init__(self, drive: str, most: float, seed: int) -> None:
        self._drive, self._most, self._draws = drive, most, np.random.default_rng(seed)
        self._until, self._runs = BEGINS, False
        self.trips = 0

    def __call__(self, snapshot: Snapshot) -> list[Command]:
        """Commands of a frame."""
        if snapshot.time < self._until:
            return []
        stops = self._runs and self._draws.random() < STOPS
        self._runs = not stops
        self.trips += self._runs
        speed = 0.0 if stops else self._most * float(self._draws.uniform(SLOWEST, 1.0))
        self._until += float(self._draws.uniform(*(STAYS if stops else RUNS)))
        return [Command("speed", {self._drive: speed})]


def _with_sensors(bare: Scenario, seed: int) -> Scenario:
    return load_scenario(bare.resolved(), {"sensors": standard_sensors(bare, Simulation(bare).snapshot, seed)})


def of_carriages(name: str, seed: int) -> tuple[Scenario, Plant, Shuttle]:
    """Twin, plant and driver of a scenario with carriages."""
    scene, trips, draws = SCENES[name], TRIPS[name], np.random.default_rng(seed)
    twin = _with_sensors(load_scenario(name, trips.planned), seed)
    wind = (WIND * draws.standard_normal(twin.dim - 1)).tolist()
    values = {f"air.wind.{axis}": speed for axis, speed in zip("xy", wind, strict=False)}
    rough = float(draws.uniform(1.0 - ROUGH, 1.0 + ROUGH))
    values |= {f"carriages.{of}.friction.rolling": rough * one.friction.rolling for of, one in twin.carriages.items()}
    driver = Shuttle(scene.drive, trips, wind, 1000 + seed)
    return twin, Plant(load_scenario(twin.resolved(), {**scene.mesh, **values}), [], driver), driver


def of_carriers(name: str, seed: int) -> tuple[Scenario, Plant, Circulation]:
    """Twin, plant and driver of a lift."""
    scene, draws = LIFTS[name], np.random.default_rng(seed)
    twin, rough = _with_sensors(load_scenario(name), seed), float(draws.uniform(1.0 - ROUGH, 1.0 + ROUGH))
    towers = {tower: one for rope in twin.cables for tower, one in twin.of_rope(rope).towers.items()}
    friction = {f"towers.{tower}.friction": rough * tower_friction(one) for tower, one in towers.items()}
    driver = Circulation(scene.drive, scene.speeds[0], 1000 + seed)
    return twin, Plant(load_scenario(twin.resolved(), {**scene.mesh, **friction}), [], driver), driver


def hours_of(name: str, seed: int, hours: float, told: Callable[[float, str], None], took: list[float]) -> int:
    """Let a twin follow a plant with a seed for some hours; returns the trips, and each alarm is `told`."""
    twin, plant, driver = (of_carriages if name in TRIPS else of_carriers)(name, seed)
    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(f"{name} {seed}", total=3600.0 * hours)
        for one in news(plant, Tracker(twin), 3600.0 * hours, took):
            bar.update(task, completed=one.time)
            for alarm in alarms_of([one]):
                told(alarm.time, alarm.reason)
    return driver.trips


def main() -> int:
    """Follow plants without fault; 1 where there was an alarm."""
    parser = argparse.ArgumentParser(
        prog="python -m verification.faultless", description=__doc__, formatter_class=Filled
    )
    parser.add_argument("--scenario", choices=SCENARIOS, default="aerial_tramway", help="default: aerial_tramway")
    parser.add_argument("--plants", type=int, default=1, help="default: 1")
    parser.add_argument("--hours", type=float, default=1.0, help="of each plant; default: 1")
    parser.add_argument("--first", type=int, default=1, help="seed of the first plant; default: 1")
    options = parser.parse_args()
    alarms, trips, took = 0, 0, list[float]()

    def told(time: float, reason: str) -> None:
        nonlocal alarms
        alarms += 1
        print(f"    {time:.1f} s: {reason}", flush=True)

    for seed in range(options.first, options.first + options.plants):
        before, own, begun = alarms, list[float](), perf_counter()
        made = hours_of(options.scenario, seed, options.hours, told, own)
        took, trips = took + own, trips + made
        print(
            f"{options.scenario}, plant {seed}: {options.hours:g} h, {made} trips or runs, {alarms - before} alarms; "
            f"the twin took {sum(own) / options.hours / 36.0:.0f} % of a core; {perf_counter() - begun:.0f} s",
            flush=True,
        )
    total = options.hours * options.plants
    print(f"{total:g} h of {options.plants} plants, {trips} trips or runs: {alarms} alarms")
    return int(alarms > 0)


if __name__ == "__main__":
    sys.exit(main())
