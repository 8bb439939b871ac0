"""Measurements and commands of a recorded plant, in the order of their time stamps, and sensors that count again."""

from __future__ import annotations

import heapq
from collections.abc import Collection, Iterator, Mapping
from itertools import count
from pathlib import Path
from typing import NamedTuple

from cable_twin.ensemble.estimate.beginning import has_moved
from cable_twin.frame.commands import JOINT_COMMANDS
from cable_twin.frame.records import AppliedCommand, Command, CommandError
from cable_twin.frame.sensors import Measurement
from cable_twin.messages import APPLIED_COMMANDS, READMITTED, SECOND
from cable_twin.messages.command_messages import command_from_message
from cable_twin.messages.sensor_messages import PLANT, measurements_from_message, plant_name, sensor_topic
from cable_twin.messages.texts import readmitted_from_message
from cable_twin.offline.plant import with_usual_sensors
from cable_twin.recording.log_file import UNREADABLE, ForeignError, LogError, one_line
from cable_twin.recording.log_reader import Log, read_foreign, read_log
from cable_twin.scenario import Scenario, ScenarioError, load_scenario
from cable_twin.scenario.checks.fault import listed
from cable_twin.scenario.schema import Sensor
from cable_twin.simulation import Simulation

HORIZON = 1.0  # s, for which measurements are waited for, so that late ones are put in order
OTHER_CLOCK = 60.0  # s between the stamp of a measurement and its arrival
PARTS = {"cables": "ropes", "vehicles": "vehicles", "towers": "towers", "drives": "drives", "sheaves": "bullwheels"}
SOURCE = "plant"  # of commands
Item = AppliedCommand | Measurement


class Readmission(NamedTuple):
    """Sensor that counts again from the arrival of this on, as somebody asked the twin that recorded the plant."""

    sensor: str


def read_plant_log(path: Path, scenario: str | None) -> Log:
    """Open a bag of a plant: one of this package, or with a scenario any bag with the topics of a plant.

    Raises:
        LogError: the bag cannot be read; one line.
    """
    try:
        return read_log(path)
    except ForeignError as error:
        if scenario is None:
            raise LogError(f"{error}; with --scenario the topics {PLANT}/... of any bag are read") from None
        return read_foreign(path)


def at_rest_with_sensors(scenario: Scenario, log: Log) -> Simulation:
    """Simulation of a scenario at rest, with its own sensors, else those of a plant's log, else the standard ones.

    Raises:
        ScenarioError, EquilibriumError: the scenario cannot be simulated.
        LogError: the log is of another scenario, which lacks what its sensors measure.
    """
    if not scenario.sensors and (sensors := log.scenario.get("sensors")):
        try:
            scenario = load_scenario(scenario.resolved(), {"sensors": sensors})
        except ScenarioError:
            check_same_parts(scenario, log)
            raise
    simulation = Simulation(scenario)
    return simulation if scenario.sensors else with_usual_sensors(simulation)


def check_same_parts(scenario: Scenario, log: Log) -> None:
    """Raise an error if a log's scenario differs from the twin's in ropes, vehicles, towers, drives or bullwheels.

    Raises:
        LogError: one line with both scenarios and the first difference.
    """
    if not log.scenario:  # a bag of another program
        return
    of_log = load_scenario(log.scenario)
    for part, word in PARTS.items():
        own, other = ([*getattr(one, part)] for one in (scenario, of_log))
        if own != other:
            given, allowed = (f"({word}: {listed(names, 'none')})" for names in (other, own))
            raise LogError(
                f"{log.path}: given a log of {of_log.name} {given}; allowed: one of {scenario.name} {allowed}, "
                f"or --scenario {of_log.name}"
            )


class PlantLog:
    """Log of a plant, from which commands and measurements are read in the order of their time stamps.

    Attributes:
        real: whether measurements and commands are those of a plant that another process has recorded, under /plant/.
        invalid: number of measurements that are not finite; they are left out.
        late: number of measurements that came too late to be put in order; they are left out.

    Args:
        log: bag of the plant, or of a twin with sensors.
        sensors: sensors of the plant by name.
    """

    def __init__(self, log: Log, sensors: Mapping[str, Sensor]) -> None:
        self._log, self._sensors = log, sensors
        topics = {*map(sensor_topic, sensors.values())}
        of_plant = {plant_name(topic): topic for topic in topics} | {f"{PLANT}/{JOINT_COMMANDS}": JOINT_COMMANDS}
        self.real = any(topic in log.topics for topic in of_plant)
        of_plant[READMITTED] = READMITTED
        self._topics = of_plant if self.real else {topic: topic for topic in (*topics, APPLIED_COMMANDS)}
        self.invalid = self.late = 0

    def nothing(self, readings: Collection[str]) -> str:
        """Reason, in a line, why the log has no measurements of the sensors that are read, by name."""
        sensors = ", ".join(readings) or "any sensor"
        topics = ", ".join(plant_name(topic) for topic in dict.fromkeys(map(sensor_topic, self._sensors.values())))
        return (
            f"{self._log.path}: given no measurements of {sensors}; allowed: a log of `plant`, of a twin with sensors, "
            f"or with {topics}"
        )

    def begins_with(self, scenario: Scenario) -> bool:
        """Whether the log begins with a run, and vehicles where a scenario has them: not so a later file of a bag.

        Raises:
            LogError: as `items`.
        """
        peek = PlantLog(self._log, self._sensors)
        for arrival, items in peek.arrivals():
            if arrival > HORIZON:
                return False
            for one in items:
                if isinstance(one, Measurement) and (sensor := self._sensors[one.sensor]).kind == "encoder":
                    return not has_moved(scenario, {sensor.of: (one.values[0], 0.0)})
        return True

    def items(self) -> Iterator[Item]:
        """Commands and measurements of the plant in the order of their time stamps; at equal times commands first.

        Raises:
            LogError: a message is not of this plant, or its stamp is of another clock; one line.
        """
        waiting: list[tuple[float, int, int, Item]] = []
        number, done = count(), float("-inf")
        last: Command | None = None
        for arrival, items in self.arrivals():
            for one in items:
                if isinstance(one, Readmission):
                    continue  # of a twin that was there then
                if isinstance(one, AppliedCommand):
                    if self.real and one.command == last:
                        continue  # repeated
                    last = one.command
                    heapq.heappush(waiting, (one.time, 0, next(number), one))
                elif one.time < done:
                    self.late += 1
                else:
                    heapq.heappush(waiting, (one.time, 1, next(number), one))
            while waiting and waiting[0][0] < arrival - HORIZON:
                done = waiting[0][0]
                yield heapq.heappop(waiting)[-1]
        while waiting:
            yield heapq.heappop(waiting)[-1]

    def arrivals(self) -> Iterator[tuple[float, list[Item | Readmission]]]:
        """Commands, measurements and sensors that count again of each message, with the time (s) of its arrival.

        Raises:
            LogError: as `items`.
        """
        for name, stamp_ns, data in self._log.messages(self._topics):
            topic, arrival = self._topics[name], (stamp_ns - self._log.epoch_ns) / SECOND
            if topic == APPLIED_COMMANDS:
                yield arrival, [self._log.command(stamp_ns, data)]
            elif topic == READMITTED:
                yield arrival, [self._readmission(data, arrival)]
            elif topic == JOINT_COMMANDS:
                yield arrival, [*self._commands(data, arrival)]
            else:
                yield arrival, [*self._measurements(topic, data, arrival)]

    def left_out(self) -> Iterator[str]:
        """Lines about the measurements that were left out."""
        for samples, what in ((self.invalid, "not finite"), (self.late, "too late")):
            if samples:
                yield f"{self._log.path}: {samples} measurements are {what} and left out"

    def _commands(self, data: bytes, arrival: float) -> Iterator[AppliedCommand]:
        """Command of a plant at its arrival (s); places to go to are not read."""
        try:
            command = command_from_message(JOINT_COMMANDS, data)
        except CommandError as error:
            raise LogError(
                f"{self._log.path}: {PLANT}/{JOINT_COMMANDS} at {arrival:.3f} s: {one_line(error)}"
            ) from None
        if isinstance(command, Command):
            yield AppliedCommand(arrival, command, SOURCE)

    def _readmission(self, data: bytes, arrival: float) -> Readmission:
        """Sensor that counts again from a time (s) on."""
        try:
            return Readmission(readmitted_from_message(data))
        except UNREADABLE as error:
            raise LogError(f"{self._log.path}: {READMITTED} at {arrival:.3f} s: {one_line(error)}") from None

    def _measurements(self, topic: str, data: bytes, arrival: float) -> list[Measurement]:
        """Finite measurements in a sensor message of the plant; counts those that are not finite."""
        try:
            found = measurements_from_message(topic, data, self._sensors, self._log.epoch_ns)
        except UNREADABLE as error:
            raise LogError(f"{self._log.path}: {topic} at {arrival:.3f} s: {one_line(error)}") from None
        for one in found:
            if abs(one.time - arrival) > OTHER_CLOCK:
                raise LogError(
                    f"{self._log.path}: {topic} at {arrival:.3f} s: given a stamp of {one.time:.3f} s; allowed: "
                    f"at most {OTHER_CLOCK:g} s from that time, by the same clock"
                )
        if self.real:
            found = [one for one in found if one.time >= 0.0]  # of before the first message
        finite = [one for one in found if all(abs(value) < float("inf") for value in one.values)]
        self.invalid += len(found) - len(finite)
        return finite
