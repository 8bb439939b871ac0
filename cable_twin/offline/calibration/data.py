"""Measured data of a calibration: commands and measurements of logs, with stretches held out for validation."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cable_twin.ensemble.estimate.beginning import start_of
from cable_twin.ensemble.estimate.quantities import Reading
from cable_twin.frame.records import AppliedCommand, FloatArray
from cable_twin.offline.calibration.parameters import CalibrationError
from cable_twin.offline.following.plant_log import PlantLog, at_rest_with_sensors, check_same_parts, read_plant_log
from cable_twin.recording.log_reader import Log
from cable_twin.scenario import Scenario, load_scenario
from cable_twin.simulation import Simulation

ELSEWHERE = 1.0  # m, by which a real plant may begin elsewhere than its twin
SHORTEST = 5.0  # s, of a log
SILENCE = 10.0  # s without a measurement, which is told
STRETCH, OUT_OF = 10.0, 5  # s, and one of how many is held out


class Series(NamedTuple):
    """Time series of the measurements of one sensor in one log, with samples held out for validation."""

    sensor: str
    times: FloatArray  # s, (n,)
    values: FloatArray  # (n,)
    held: NDArray[np.bool_]  # (n,) held out, for validation


class Package(NamedTuple):
    """Data of one log for a calibration: commands and measurements of all sensors."""

    path: Path
    commands: tuple[AppliedCommand, ...]
    series: tuple[Series, ...]
    end: float  # s, of the last measurement

    @property
    def moved(self) -> bool:
        """Whether the log has any command."""
        return bool(self.commands)

    def first(self, seconds: float) -> Package:
        """Copy of the data of one log, limited to the first `seconds` (s)."""
        series = []
        for one in self.series:
            there = one.times <= seconds
            series.append(one._replace(times=one.times[there], values=one.values[there], held=one.held[there]))
        return self._replace(series=tuple(one for one in series if one.times.size), end=min(self.end, seconds))


def logs_of(paths: Sequence[Path], scenario: str | None = None) -> list[Log]:
    """Open the logs of a calibration and check that all are of one scenario: given, or that of the logs.

    Raises:
        LogError: a log cannot be read.
        CalibrationError: a log begins in the middle of a run, or two logs are of different scenarios.
    """
    logs = [read_plant_log(path, scenario) for path in paths]
    for log in logs:
        if log.snapshot is not None or log.files[0].number != 0:
            raise CalibrationError(f"{log.path}: begins in the middle of a run; allowed: logs from a start at rest")
    own = [log for log in logs if log.scenario]  # of this package
    first = _without_sensors(own[0].scenario) if own else {}
    for log in own[1:]:
        for key, *values in differences(first, _without_sensors(log.scenario)):
            one, other = ("a section" if isinstance(value, Mapping | list) else repr(value) for value in values)
            raise CalibrationError(
                f"{log.path}: {key}: given {other}, in {own[0].path} {one}; allowed: logs of one scenario"
            )
    return logs


def _without_sensors(scenario: Mapping[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in scenario.items() if key not in ("sensors", "description")}


def differences(one: Any, other: Any, key: str = "") -> Iterator[tuple[str, Any, Any]]:
    """Dotted keys with different values in two resolved scenarios, with both values."""
    if isinstance(one, Mapping) and isinstance(other, Mapping):
        for name in [*one, *(name for name in other if name not in one)]:
            yield from differences(one.get(name), other.get(name), f"{key}.{name}".lstrip("."))
    elif one != other:
        yield key, one, other


def twin_of(log: Log, source: str | None, values: Mapping[str, Any]) -> Simulation:
    """Simulation of the twin at rest, with the sensors of its scenario, else of the log, else the standard ones.

    Args:
        log: of the plant.
        source: scenario, or None for that of the log.
        values: changes of the scenario by dotted key.

    Raises:
        ScenarioError, EquilibriumError: the scenario cannot be simulated.
        LogError: the log is of another scenario.
    """
    scenario = load_scenario(log.scenario if source is None else source, dict(values))
    if source is not None:
        check_same_parts(scenario, log)
    return at_rest_with_sensors(scenario, log)


def package(
    log: Log, scenario: Scenario, readings: Mapping[str, Reading], say: Callable[[str], object], *, held: bool = False
) -> Package:
    """Gather measurements and commands of a log for a calibration; calls `say` with a line about each omission.

    Args:
        log: of the plant.
        scenario: of the twin, with the sensors.
        readings: of its sensors by name.
        say: called with a line about each part of the log that is left out or missing.
        held: hold out all of the log for validation, else one stretch of five.

    Raises:
        LogError: a message is not of this plant.
        CalibrationError: the log has no measurements, or too few, or begins elsewhere than the twin.
    """
    plant, commands = PlantLog(log, scenario.sensors), []
    found: dict[str, list[tuple[float, float]]] = {name: [] for name in readings}
    unread: dict[str, int] = {}
    for item in plant.items():
        if isinstance(item, AppliedCommand):
            commands.append(item)
        elif (reading := readings.get(item.sensor)) is not None:
            value = item.values[0] if reading.places.size == 1 else float(np.linalg.norm(item.values))
            found[item.sensor].append((round(item.time, 6), value))
        else:
            unread[item.sensor] = unread.get(item.sensor, 0) + 1
    for line in plant.left_out():
        say(line)
    for name, count in unread.items():
        say(f"{log.path}: {count} measurements of {name}, an inertial sensor, are left out")
    times = sorted({time for rows in found.values() for time, _ in rows})
    if not times:
        raise CalibrationError(plant.nothing(readings))
    if times[-1] < SHORTEST:
        raise CalibrationError(f"{log.path}: length: given {times[-1]:.3g} s; allowed: {SHORTEST:g} s or more")
    for before, after in pairwise([0.0, *times]):
        if after - before > SILENCE:
            say(f"{log.path}: nothing from {before:.1f} to {after:.1f} s: the twin goes on by its model there")
    series = []
    for name, rows in found.items():
        if not rows:
            say(f"{log.path}: nothing of sensor {name}")
            continue
        if plant.real and scenario.sensors[name].kind == "encoder":
            _check_start(log, scenario, name, min(rows)[1])
        own = dict(rows)  # of two samples of one time the last
        when = np.array(sorted(own))
        apart = np.full(when.size, held) if held else (when // STRETCH).astype(int) % OUT_OF == OUT_OF - 1
        series.append(Series(name, when, np.array([own[time] for time in when.tolist()]), apart))
    return Package(log.path, tuple(commands), tuple(series), times[-1])


def _check_start(log: Log, scenario: Scenario, sensor: str, place: float) -> None:
    """Raise an error if a real plant begins with an encoder elsewhere than its twin, at a place (m)."""
    of = scenario.sensors[sensor].of
    own = start_of(scenario, of)
    if abs(place - own) > ELSEWHERE:
        how = f"; --set carriages.{of}.arc_length={place:.2f} begins there" if of in scenario.carriages else ""
        raise CalibrationError(
            f"{log.path}: {sensor}: given {place:.2f} m at first; allowed: {own:g} m, where the twin begins{how}"
        )


def fingerprint(packages: Sequence[Package], *more: object) -> str:
    """SHA-256 hash of all inputs of a calibration: data of its logs and further objects."""
    found = hashlib.sha256()
    for one in packages:
        for applied in one.commands:
            found.update(repr((applied.time, applied.command)).encode())
        for series in one.series:
            found.update(series.sensor.encode())
            for array in (series.times, series.values, series.held):
                found.update(np.ascontiguousarray(array).tobytes())
    for thing in more:
        found.update(repr(thing).encode())
    return found.hexdigest()
