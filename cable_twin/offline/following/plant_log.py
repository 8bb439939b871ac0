"""Measurements and commands of a recorded plant, in the order of their time stamps."""

from __future__ import annotations

import heapq
from collections.abc import Iterator, Mapping
from itertools import count

from cable_twin.frame.records import AppliedCommand
from cable_twin.frame.sensors import Measurement
from cable_twin.messages import APPLIED_COMMANDS, SECOND
from cable_twin.messages.sensor_messages import measurements_from_message, sensor_topic
from cable_twin.offline.plant import with_usual_sensors
from cable_twin.recording.log_file import UNREADABLE, LogError, one_line
from cable_twin.recording.log_reader import Log
from cable_twin.scenario import Scenario, ScenarioError, load_scenario
from cable_twin.scenario.checks.fault import listed
from cable_twin.scenario.schema import Sensor
from cable_twin.simulation import Simulation

HORIZON = 1.0  # s, for which measurements are waited for, so that late ones are put in order
OTHER_CLOCK = 60.0  # s between the stamp of a measurement and its arrival
PARTS = {"cables": "ropes", "vehicles": "vehicles", "towers": "towers", "drives": "drives", "sheaves": "bullwheels"}
Item = AppliedCommand | Measurement


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
        invalid: number of measurements that are not finite; they are left out.
        late: number of measurements that came too late to be put in order; they are left out.

    Args:
        log: bag of the plant, or of a twin with sensors.
        sensors: sensors of the plant by name.
    """

    def __init__(self, log: Log, sensors: Mapping[str, Sensor]) -> None:
        self._log, self._sensors = log, sensors
        self.invalid = self.late = 0

    def items(self) -> Iterator[Item]:
        """Commands and measurements of the plant in the order of their time stamps; at equal times commands first.

        Raises:
            LogError: a message is not of this plant, or its stamp is of another clock; one line.
        """
        waiting: list[tuple[float, int, int, Item]] = []
        number, done = count(), float("-inf")
        topics = {APPLIED_COMMANDS, *map(sensor_topic, self._sensors.values())}
        for topic, stamp_ns, data in self._log.messages(topics):
            arrival = (stamp_ns - self._log.epoch_ns) / SECOND
            if topic == APPLIED_COMMANDS:
                applied = self._log.command(stamp_ns, data)
                heapq.heappush(waiting, (applied.time, 0, next(number), applied))
            else:
                for one in self._measurements(topic, data, arrival):
                    if one.time < done:
                        self.late += 1
                    else:
                        heapq.heappush(waiting, (one.time, 1, next(number), one))
            while waiting and waiting[0][0] < arrival - HORIZON:
                done = waiting[0][0]
                yield heapq.heappop(waiting)[-1]
        while waiting:
            yield heapq.heappop(waiting)[-1]

    def left_out(self) -> Iterator[str]:
        """Lines about the measurements that were left out."""
        for samples, what in ((self.invalid, "not finite"), (self.late, "too late")):
            if samples:
                yield f"{self._log.path}: {samples} measurements are {what} and left out"

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
        finite = [one for one in found if all(abs(value) < float("inf") for value in one.values)]
        self.invalid += len(found) - len(finite)
        return finite
