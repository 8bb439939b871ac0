"""Simulated sensors: quantised, noisy, biased and delayed measurements of frames, reproducible from a seed.

The noise of a sample is a function of the seed, the name of the sensor and the number of the sample (a counter-based
generator, Salmon and others 2011), so it depends neither on pacing, nor on other sensors, nor on where a run begins.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import floor, isfinite, radians
from typing import Any
from zlib import crc32

import numpy as np

from cable_twin.frame.records import FloatArray
from cable_twin.frame.snapshot import Layout, Snapshot
from cable_twin.scenario import Scenario, command_limits
from cable_twin.scenario.schema import Sensor

HOUR = 3600.0  # s, of a drift
LOAD_CELL, INCLINOMETER = 0.002, radians(0.3)  # standard deviations: share of the load at rest, and rad
UNLIMITED = 100e3  # N, taken as the range of a drive without a limit of its force
ANGLES = {"roll": 0, "pitch": 1}  # columns of the angles of a body
EARLY = 1e-6  # of a sample period, by which a frame may come before a sample is due


@dataclass(frozen=True, slots=True)
class Measurement:
    """Measurement of one sensor: name, time and values.

    Attributes:
        sensor: its name.
        time: s, simulated, of the frame that was measured.
        values: m and m/s of an encoder; N of a drive force; (3,) N of a load cell, in space; rad of an inclinometer;
            (6,) rad/s and m/s^2 of an IMU in the axes of its body, the latter as specific force, with gravity in it.
    """

    sensor: str
    time: float
    values: tuple[float, ...]


class Sensors:
    """Simulated sensors of a scenario, which measure its frames.

    Args:
        scenario: with the parameters of all sensors.
        layout: of its frames.
    """

    def __init__(self, scenario: Scenario, layout: Layout) -> None:
        self._all = [_Running(name, one, scenario.gravity, layout) for name, one in scenario.sensors.items()]

    def take(self, snapshot: Snapshot) -> list[Measurement]:
        """Sample all due sensors in a frame; returns the measurements that have arrived, in the order of arrival."""
        arrived = [item for sensor in self._all for item in sensor.take(snapshot)]
        return [measurement for _, measurement in sorted(arrived, key=lambda item: item[0])]

    def restart(self) -> None:
        """Forget the previous frame of all sensors, after a jump of the state."""
        for sensor in self._all:
            sensor.restart()


class _Running:
    """One simulated sensor in a run, with its measurements that have not arrived yet."""

    def __init__(self, name: str, sensor: Sensor, gravity: float, layout: Layout) -> None:
        self._name, self._sensor, self._gravity = name, sensor, gravity
        self._key = np.array([sensor.seed, crc32(name.encode())], dtype=np.uint64)
        self._read = {
            "encoder": self._encoder,
            "drive_force": self._drive_force,
            "load_cell": self._load_cell,
            "inclinometer": self._inclinometer,
            "imu": self._imu,
        }[sensor.kind]
        self._layout = layout
        self._row, self._driven = _row(sensor, layout)
        self._last_sample = -1
        self._before: tuple[float, FloatArray] | None = None  # time and velocity, or measured place, of the last look
        self._under_way: list[tuple[float, Measurement]] = []
        self._time = 0.0  # s, of the last sample
        self._last: tuple[float, ...] = ()  # values of the last sample

    def restart(self) -> None:
        self._before = None

    def take(self, snapshot: Snapshot) -> list[tuple[float, Measurement]]:
        """Sample the sensor where due; returns measurements arrived up to the frame, with their times of arrival."""
        time, sensor = snapshot.time, self._sensor
        sample = floor(time * sensor.rate + EARLY)
        if sample != self._last_sample:
            self._last_sample = sample
            draws = np.random.Generator(np.random.Philox(key=self._key, counter=[sample, 0, 0, 0])).standard_normal(6)
            self._time = time
            stuck = sensor.stuck_after is not None and time >= sensor.stuck_after and bool(self._last)
            values = self._last = self._last if stuck else self._read(snapshot, draws)
            wait = self._wait(sample)
            if values and all(map(isfinite, values)) and wait is not None:
                self._under_way.append((time + wait, Measurement(self._name, time, values)))
        due = time + EARLY / sensor.rate
        arrived = [one for one in self._under_way if one[0] <= due]
        if arrived:
            self._under_way = [one for one in self._under_way if one[0] > due]
        return arrived

    def _wait(self, sample: int) -> float | None:
        """Delay (s) from a sample to its arrival, by sample number; None for a lost sample."""
        sensor = self._sensor
        if sensor.lost == 0.0 and sensor.jitter == 0.0:
            return sensor.delay
        fate = np.random.Generator(np.random.Philox(key=self._key, counter=[sample, 1, 0, 0])).random(2)
        return None if fate[0] < sensor.lost else sensor.delay + sensor.jitter * float(fate[1])

    def _spoiled(self, value: float, draw: float) -> float:
        """Measured value of a true one: bias, drift and noise added, then quantised."""
        sensor = self._sensor
        value += sensor.bias + sensor.drift * self._time / HOUR + sensor.noise * draw
        return value if sensor.quantum == 0.0 else round(value / sensor.quantum) * sensor.quantum

    def _encoder(self, snapshot: Snapshot, draws: FloatArray) -> tuple[float, ...]:
        """Reading of an encoder: measured place, and speed as the difference quotient of two measured places."""
        columns = snapshot.columns
        places = columns.drive_position if self._driven else self._layout.on_loop(columns)
        place = self._spoiled(float(places[self._row]), draws[0])
        before, self._before = self._before, (snapshot.time, np.array([place]))
        speed = 0.0 if before is None else (place - float(before[1][0])) / (snapshot.time - before[0])
        return place, speed

    def _drive_force(self, snapshot: Snapshot, draws: FloatArray) -> tuple[float, ...]:
        columns = snapshot.columns
        forces = columns.moving_cable_force if self._driven else columns.drive_force
        return (self._spoiled(float(forces[self._row]), draws[0]),)

    def _load_cell(self, snapshot: Snapshot, draws: FloatArray) -> tuple[float, ...]:
        """Reading of a load cell: force of the support on the cable, of measured magnitude in the true direction."""
        force = snapshot.columns.support_force[self._row]
        size = float(np.linalg.norm(force))
        share = self._spoiled(size, draws[0]) / size if size > 0.0 else 0.0
        return tuple((share * force).tolist())

    def _inclinometer(self, snapshot: Snapshot, draws: FloatArray) -> tuple[float, ...]:
        return (self._spoiled(float(snapshot.columns.body_angles[self._row, ANGLES[self._sensor.axis]]), draws[0]),)

    def _imu(self, snapshot: Snapshot, draws: FloatArray) -> tuple[float, ...]:
        """Reading of an IMU: angular velocity; mean specific force (acceleration less gravity) since last sample."""
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
    """Row of a sensor's measured object in its column, and whether the object is a drive of the cable."""
    if sensor.kind == "load_cell":
        return layout.support_rows[sensor.of], False
    if sensor.kind in ("encoder", "drive_force"):
        driven = sensor.of in layout.drive_rows
        rows: Mapping[str, int] = layout.drive_rows if driven else layout.vehicle_rows
        return rows[sensor.of], driven
    return layout.bodies.index(body_of(sensor, layout)), False


def standard_sensors(scenario: Scenario, rest: Snapshot, seed: int = 0) -> dict[str, dict[str, Any]]:
    """Standard sensors of a ropeway, as a mapping for `sensors` of a scenario.

    An encoder of 1 cm and the force of each drive, a load cell at each end and tower with 0.2 % of its load at rest as
    standard deviation, and an inclinometer of 0.3 degrees on the last body of each carriage, in space another one for
    its roll; ten samples a second, which arrive up to 50 ms late, and of which 2 % are lost.

    Args:
        scenario: of the plant.
        rest: snapshot of the plant at rest.
        seed: of the noise of all sensors.
    """
    layout, limits = rest.layout, command_limits(scenario)
    common = {"rate": 10.0, "jitter": 0.05, "lost": 0.02, "seed": seed}
    found: dict[str, dict[str, Any]] = {}
    for name in layout.commanded:
        found[f"encoder_{name}"] = {"kind": "encoder", "of": name, "quantum": 0.01, **common}
        most = limits[name].force if name in limits else 0.0
        noise = LOAD_CELL * (most if isfinite(most) and most > 0.0 else UNLIMITED)
        found[f"force_{name}"] = {"kind": "drive_force", "of": name, "noise": noise, **common}
    for row, name in enumerate(layout.supports):
        load = float(np.linalg.norm(rest.columns.support_force[row]))
        found[f"load_{name.replace('/', '_')}"] = {"kind": "load_cell", "of": name, "noise": LOAD_CELL * load, **common}
    for name in layout.carriages:
        tilt = {"kind": "inclinometer", "of": name, "noise": INCLINOMETER, **common}
        found[f"tilt_{name}"] = tilt
        if layout.space:
            found[f"roll_{name}"] = {**tilt, "axis": "roll"}
    return found


def body_of(sensor: Sensor, layout: Layout) -> str:
    """Name VEHICLE/BODY of the body of an inclinometer or IMU: the vehicle's last body where none is given."""
    return sensor.of if "/" in sensor.of else f"{sensor.of}/{layout.vehicles[sensor.of][-1]}"


__all__ = ["ANGLES", "Measurement", "Sensors", "body_of", "standard_sensors"]
