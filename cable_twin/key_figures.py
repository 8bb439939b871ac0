"""Key figures of a run, gathered from snapshot to snapshot: live in the node, or afterwards from a log.

Each has its standard name, value, unit, limit and the source of the limit, and says when and where it was reached. The
cost and the memory of an update do not grow with the run.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from cable_twin.records import AppliedCommand, CarriageState, FloatArray, Snapshot
from cable_twin.scenario import Scenario

STANDSTILL = 1e-3  # m/s
SOURCES = {  # of the default limits
    "rope_safety_factor": "EN 12927 and CEN practice: 3.15 to 3.5 track rope, 4.5 to 5 haul rope",
    "tension_per_transverse_load": "CEN practice for carriages on a track rope, at least 10",
    "swing": "assumed: clearance usually allows for 0.35 rad (20 deg)",
    "acceleration": "assumed: emergency stops usually have 1 to 1.5 m/s^2",
}


@dataclass(frozen=True, slots=True)
class KeyFigure:
    """One figure with its limit."""

    name: str
    value: float
    unit: str
    time: float  # s, when it was reached
    place: str = ""  # where, with unit
    limit: float | None = None
    bound: Literal["at most", "at least"] = "at most"
    source: str = ""  # of the limit

    @property
    def kept(self) -> bool | None:
        """Whether the limit is kept; None without a limit."""
        if self.limit is None:
            return None
        return self.value <= self.limit if self.bound == "at most" else self.value >= self.limit


class _Extreme:
    """The largest value so far, or with sign -1 the smallest, with time and place."""

    def __init__(self, sign: float = 1.0) -> None:
        self.value = math.nan
        self.time = 0.0
        self.place = math.nan
        self._sign = sign

    def update(self, value: float, time: float, place: float = math.nan) -> None:
        if not self._sign * value <= self._sign * self.value and not math.isnan(value):
            self.value, self.time, self.place = float(value), time, float(place)

    def figure(self, name: str, unit: str, at: str = "arc length") -> KeyFigure | None:
        """The figure without a limit, or None where there never was a value."""
        if math.isnan(self.value):
            return None
        place = "" if math.isnan(self.place) else f"{at} {self.place:.1f} m"
        return KeyFigure(name, self.value, unit, self.time, place)


@dataclass(slots=True)
class _Stop:
    """A braking to standstill, under way or done."""

    kind: str
    time: float  # s, of the command
    start: float  # m, arc length there
    speed: float  # m/s there
    end: float = math.nan  # s, of the standstill
    distance: float = math.nan  # m


class _Vehicle:
    """What is gathered of one carriage."""

    def __init__(self) -> None:
        self.speed, self.swing, self.acceleration = _Extreme(), _Extreme(), _Extreme()
        self.drive_force, self.drive_power, self.braking_power = _Extreme(), _Extreme(), _Extreme(-1.0)
        self.contact_force, self.tension_ratio = _Extreme(), _Extreme(-1.0)
        self.braking: _Stop | None = None
        self.stop: _Stop | None = None  # the last one that counts
        self.state: CarriageState | None = None
        self._passed: list[tuple[float, FloatArray]] = []  # time and place of the last body, two frames

    def forget(self) -> None:
        """The state was put back to the start: nothing before it is a part of the motion."""
        self.braking = None
        self._passed = []

    def update(self, time: float, state: CarriageState, tension: float, direction: FloatArray) -> None:
        where = state.arc_length
        self.state = state
        self.speed.update(abs(state.speed), time, where)
        self.drive_force.update(abs(state.drive_force), time, where)
        self.drive_power.update(state.drive_force * state.speed, time, where)
        self.braking_power.update(state.drive_force * state.speed, time, where)
        force = state.contact_force[[0, -1]]
        self.contact_force.update(math.hypot(*force), time, where)
        transverse = abs(direction[0] * force[1] - direction[1] * force[0])
        if transverse > 0.0:
            self.tension_ratio.update(tension / transverse, time, where)
        if state.bodies:
            body = list(state.bodies.values())[-1]
            self.swing.update(abs(body.pitch), time, where)
            self._accelerate(time, np.array([body.x, body.z]), where)
        self._brake(time, state)

    def _accelerate(self, time: float, place: FloatArray, where: float) -> None:
        """Second difference of the place of the last body over three frames of equal spacing."""
        if len(self._passed) == 2:
            (first_time, first), (middle_time, middle) = self._passed
            period = time - middle_time
            if period > 0.0 and abs(middle_time - first_time - period) < 1e-6 * period:
                self.acceleration.update(
                    float(np.linalg.norm(place - 2.0 * middle + first)) / period**2, middle_time, where
                )
        self._passed = [*self._passed[-1:], (time, place)]

    def begin_stop(self, kind: str, time: float) -> None:
        """A command to stop: the emergency stop goes before a stop that is under way."""
        if self.state is None or abs(self.state.speed) <= STANDSTILL:
            return
        if self.braking is None or (kind == "emergency stop" and self.braking.kind != kind):
            self.braking = _Stop(kind, time, self.state.arc_length, self.state.speed)

    def _brake(self, time: float, state: CarriageState) -> None:
        stop = self.braking
        if stop is None:
            return
        if abs(state.speed) <= STANDSTILL or state.speed * stop.speed < 0.0:
            stop.end, stop.distance = time, abs(state.arc_length - stop.start)
            if self.stop is None or stop.kind == "emergency stop" or self.stop.kind != "emergency stop":
                self.stop = stop
            self.braking = None


class KeyFigures:
    """Gathers the key figures of one run.

    Args:
        scenario: what runs; its `limits` and the limits of its drives are those of the figures.
    """

    def __init__(self, scenario: Scenario) -> None:
        self._scenario = scenario
        self._tension, self._slackest, self._sag = _Extreme(), _Extreme(-1.0), _Extreme()
        self._vehicles = {name: _Vehicle() for name in scenario.carriages}

    def update(self, snapshot: Snapshot) -> None:
        """Take in one snapshot; they come in the order of time."""
        time, cable = snapshot.time, snapshot.cable
        highest, lowest = int(cable.tensions.argmax()), int(cable.tensions.argmin())
        self._tension.update(cable.tensions[highest], time, cable.arc_lengths[highest])
        self._slackest.update(cable.tensions[lowest], time, cable.arc_lengths[lowest])
        x, z = cable.positions[:, 0], cable.positions[:, -1]
        if x[-1] != x[0]:
            depths = z[0] + (z[-1] - z[0]) / (x[-1] - x[0]) * (x - x[0]) - z
            deepest = int(depths.argmax())
            self._sag.update(depths[deepest], time, x[deepest])
        for name, state in snapshot.carriages.items():
            tension = float(np.interp(state.arc_length, cable.arc_lengths, cable.tensions))
            after = int(np.clip(np.searchsorted(cable.arc_lengths, state.arc_length), 1, len(x) - 1))
            # beside the kink at the joint, from the sample before to the one after
            chord = np.array(
                [x[min(after + 1, len(x) - 1)] - x[after - 1], z[min(after + 1, len(z) - 1)] - z[after - 1]]
            )
            self._vehicles.setdefault(name, _Vehicle()).update(time, state, tension, chord / np.linalg.norm(chord))

    def command(self, applied: AppliedCommand) -> None:
        """Take in a command where it took effect."""
        kind, values = applied.command.kind, applied.command.values
        for name, vehicle in self._vehicles.items():
            if kind == "reset":
                vehicle.forget()
            elif kind == "emergency_stop":
                vehicle.begin_stop("emergency stop", applied.time)
            elif name in values and kind == "speed" and values[name] == 0.0:
                vehicle.begin_stop("stop", applied.time)
            elif name in values:
                vehicle.braking = None

    def figures(self) -> list[KeyFigure]:
        """All figures that have a value so far."""
        result = [
            self._tension.figure("rope tension, highest", "N"),
            self._slackest.figure("rope tension, lowest", "N"),
        ]
        breaking_force = self._scenario.cable.breaking_force
        if breaking_force is not None and self._tension.value > 0.0:
            place = f"arc length {self._tension.place:.1f} m"
            factor = KeyFigure(
                "rope safety factor", breaking_force / self._tension.value, "-", self._tension.time, place
            )
            result.append(self._limited(factor, "rope_safety_factor", "at least"))
        result.append(self._limited(self._sag.figure("sag below the chord", "m", "x"), "sag"))
        for name, vehicle in self._vehicles.items():
            result += self._of_vehicle(name, vehicle)
        return [figure for figure in result if figure is not None]

    def _of_vehicle(self, name: str, vehicle: _Vehicle) -> list[KeyFigure | None]:
        drive = self._scenario.carriages[name].drive.limits if name in self._scenario.carriages else None
        source = f"carriages.{name}.drive.limits"
        speed = vehicle.speed.figure(f"{name}: speed", "m/s")
        force = vehicle.drive_force.figure(f"{name}: drive force", "N")
        if drive is not None:
            speed = _with_limit(speed, drive.speed, f"scenario: {source}.speed")
            force = _with_limit(force, drive.force, f"scenario: {source}.force")
        ratio = vehicle.tension_ratio.figure(f"{name}: tension over transverse load", "-")
        result = [
            speed,
            self._limited(vehicle.acceleration.figure(f"{name}: vehicle acceleration", "m/s^2"), "acceleration"),
            self._limited(vehicle.swing.figure(f"{name}: swing along the track", "rad"), "swing"),
            force,
            vehicle.drive_power.figure(f"{name}: drive power, highest", "W"),
            vehicle.braking_power.figure(f"{name}: drive power, lowest", "W"),
            vehicle.contact_force.figure(f"{name}: contact force", "N"),
            self._limited(ratio, "tension_per_transverse_load", "at least"),
        ]
        if vehicle.stop is not None:
            stop = vehicle.stop
            place = f"{stop.kind} from {abs(stop.speed):.2f} m/s in {stop.end - stop.time:.1f} s"
            figure = KeyFigure(f"{name}: stopping distance", stop.distance, "m", stop.time, place)
            result.append(self._limited(figure, "stopping_distance"))
        return result

    def _limited(
        self, figure: KeyFigure | None, key: str, bound: Literal["at most", "at least"] = "at most"
    ) -> KeyFigure | None:
        """The figure with the limit of the scenario, and where that comes from."""
        limits = self._scenario.limits
        limit = getattr(limits, key)
        own = limit != type(limits).model_fields[key].default
        return _with_limit(figure, limit, f"scenario: limits.{key}" if own else SOURCES.get(key, ""), bound)


def _with_limit(
    figure: KeyFigure | None, limit: float | None, source: str, bound: Literal["at most", "at least"] = "at most"
) -> KeyFigure | None:
    if figure is None or limit is None:
        return figure
    return KeyFigure(figure.name, figure.value, figure.unit, figure.time, figure.place, limit, bound, source)


__all__ = ["SOURCES", "KeyFigure", "KeyFigures"]
