"""Simulated sensors: quantised, noisy, biased and delayed measurements of frames, reproducible from a seed.

The noise of a sample is a function of the seed, the name of the sensor and the number of the sample (a counter-based
generator, Salmon and others 2011), so neither pacing, nor other sensors, nor where a run begins have a part in it.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from math import floor, isfinite
from zlib import crc32

import numpy as np

from cable_twin.frame.records import FloatArray
from cable_twin.frame.snapshot import Layout, Snapshot
from cable_twin.scenario import Scenario
from cable_twin.scenario.schema import Sensor

EARLY = 1e-6  # of a sample period, by which a frame may come before a sample is due


@dataclass(frozen=True, slots=True)
class Measurement:
    """Measurement by one sensor at one time.

    Attributes:
        sensor: its name.
        time: s, simulated, of the frame that was measured.
        values: m and m/s of an encoder; (3,) N of a load cell, in space; rad of an inclinometer; (6,) rad/s and m/s^2
            of an IMU in the axes of its body, with what gravity is to it.
    """

    sensor: str
    time: float
    values: tuple[float, ...]


class Sensors:
    """Simulated sensors of a scenario.

    Args:
        scenario: which they are.
        layout: of its frames.
    """

    def __init__(self, scenario: Scenario, layout: Layout) -> None:
        self._all = [_Running(name, one, scenario.gravity, layout) for name, one in scenario.sensors.items()]

    def take(self, snapshot: Snapshot) -> list[Measurement]:
        """Measure a frame where a sample is due; returns arrived measurements in the order of arrival."""
        arrived = [item for sensor in self._all for item in sensor.take(snapshot)]
        return [measurement for _, measurement in sorted(arrived, key=lambda item: item[0])]

    def restart(self) -> None:
        """Forget the previous frame of all sensors, after a jump of the state."""
        for sensor in self._all:
            sensor.restart()


class _Running:
    """Running sensor with its delay line."""

    def __init__(self, name: str, sensor: Sensor, gravity: float, layout: Layout) -> None:
        self._name, self._sensor, self._gravity = name, sensor, gravity
        self._key = np.array([sensor.seed, crc32(name.encode())], dtype=np.uint64)
        self._read = {
            "encoder": self._encoder,
            "load_cell": self._load_cell,
            "inclinometer": self._inclinometer,
            "imu": self._imu,
        }[sensor.kind]
        self._layout = layout
        self._row, self._driven = _row(sensor, layout)
        self._last_sample = -1
        self._before: tuple[float, FloatArray] | None = None  # time and velocity, or measured place, of the last look
        self._under_way: deque[tuple[float, Measurement]] = deque()

    def restart(self) -> None:
        self._before = None

    def take(self, snapshot: Snapshot) -> list[tuple[float, Measurement]]:
        """Measurements that have arrived up to a frame, with their times."""
        time, sensor = snapshot.time, self._sensor
        sample = floor(time * sensor.rate + EARLY)
        if sample != self._last_sample:
            self._last_sample = sample
            draws = np.random.Generator(np.random.Philox(key=self._key, counter=[sample, 0, 0, 0])).standard_normal(6)
            values = self._read(snapshot, draws)
            if values and all(map(isfinite, values)):
                self._under_way.append((time + sensor.delay, Measurement(self._name, time, values)))
        arrived = []
        while self._under_way and self._under_way[0][0] <= time + EARLY / sensor.rate:
            arrived.append(self._under_way.popleft())
        return arrived

    def _spoiled(self, value: float, draw: float) -> float:
        """Measured value: a true one with added bias and noise, quantised."""
        sensor = self._sensor
        value += sensor.bias + sensor.noise * draw
        return value if sensor.quantum == 0.0 else round(value / sensor.quantum) * sensor.quantum

    def _encoder(self, snapshot: Snapshot, draws: FloatArray) -> tuple[float, ...]:
        """Measured place, and speed as the difference of two measured places."""
        columns = snapshot.columns
        places = columns.drive_position if self._driven else self._layout.on_loop(columns)
        place = self._spoiled(float(places[self._row]), draws[0])
        before, self._before = self._before, (snapshot.time, np.array([place]))
        speed = 0.0 if before is None else (place - float(before[1][0])) / (snapshot.time - before[0])
        return place, speed

    def _load_cell(self, snapshot: Snapshot, draws: FloatArray) -> tuple[float, ...]:
        """Force of the support on the cable: magnitude as measured, in the true direction."""
        force = snapshot.columns.support_force[self._row]
        size = float(np.linalg.norm(force))
        share = self._spoiled(size, draws[0]) / size if size > 0.0 else 0.0
        return tuple((share * force).tolist())

    def _inclinometer(self, snapshot: Snapshot, draws: FloatArray) -> tuple[float, ...]:
        return (self._spoiled(float(snapshot.columns.body_angles[self._row, 1]), draws[0]),)

    def _imu(self, snapshot: Snapshot, draws: FloatArray) -> tuple[float, ...]:
        """Angular velocity, and mean specific force (acceleration minus gravity) since the previous sample."""
        columns, sensor = snapshot.columns, self._sensor
        velocity, time = columns.body_velocity[self._row].copy(), snapshot.time
        before, self._before = self._before, (time, velocity)
        if before is None:
            return ()
        felt, turn = (velocity - before[1]) / (time - before[0]), columns.body_angular_velocity[self._row]
        felt[2] += self._gravity
        along, turn = (_in_axes(vector, columns.body_orientation[self._row]) for vector in (felt, turn))
        turns = (float(turn[k]) + sensor.rate_bias + sensor.rate_noise * draws[k] for k in range(3))
        return (*turns, *(self._spoiled(float(along[k]), draws[3 + k]) for k in range(3)))


def _in_axes(vector: FloatArray, turn: FloatArray) -> FloatArray:
    """Components of a vector (3,) in the axes of a body with the orientation of a quaternion x, y, z, w."""
    twice = 2.0 * np.cross(turn[:3], vector)
    turned: FloatArray = vector - turn[3] * twice + np.cross(turn[:3], twice)
    return turned


def _row(sensor: Sensor, layout: Layout) -> tuple[int, bool]:
    """Row of a sensor's object in its column, and whether the object is a drive of the cable."""
    if sensor.kind == "load_cell":
        return layout.support_rows[sensor.of], False
    if sensor.kind == "encoder":
        driven = sensor.of in layout.drive_rows
        rows: Mapping[str, int] = layout.drive_rows if driven else layout.vehicle_rows
        return rows[sensor.of], driven
    return layout.bodies.index(body_of(sensor, layout)), False


def body_of(sensor: Sensor, layout: Layout) -> str:
    """Body VEHICLE/BODY of an inclinometer or IMU: the last body where none is given."""
    return sensor.of if "/" in sensor.of else f"{sensor.of}/{layout.vehicles[sensor.of][-1]}"


__all__ = ["Measurement", "Sensors", "body_of"]
