"""Time from when on a fault of a plant can be told from its sensors, whoever reads them.

Two runs of the plant without noise of its sensors, one with the fault and one with the nearest state that is tolerated,
differ by a signal in Gaussian noise. The best test that there is, the likelihood ratio (Neyman and Pearson 1933), can
tell it once the square sum of its samples in standard deviations is beyond the square of the threshold at which the
alarm is given. That is for one who knows all else. What a twin doubts, payload, friction, wind, sudden changes of
both, ice, counterweight and slow errors of sensors, are further signals of unknown size: what they can explain does
not count. Of a payload that changes in a station nothing counts until its carriage rolls: rollers hold an unknown share
of its weight along the track, and how it changes, at once or by and by, and so how the ropes bounce, is not known.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from cable_twin.ensemble.estimate.quantities import QUANTISED, SLOW, WIND_WALK, readings, slow_quantities
from cable_twin.frame.records import FloatArray
from cable_twin.frame.sensors import Measurement
from cable_twin.scenario import Scenario, load_scenario
from cable_twin.simulation import Simulation
from verification.followed import Changed, Plant, Step, measured

CHANGING = 5.0  # s, from one change of the wind to the next
SMALL = 0.2  # standard deviations, by which a doubted quantity is changed for its effect


class Observable(NamedTuple):
    """Times (s) from when on a fault can be told; infinite for never."""

    known: float  # by one who knows all else
    doubted: float  # by one with the doubts of the twin


class Readings:
    """Readings of a plant without noise, as arrays (samples, sensors) in standard deviations of their noise.

    Args:
        twin: scenario with sensors that all have one rate.
        values: of the plant, by key.
        trip: commands of all runs.
        duration: s.
    """

    def __init__(self, twin: Scenario, values: Mapping[str, Any], trip: Step, duration: float) -> None:
        silent = {"noise": 0.0, "quantum": 0.0, "jitter": 0.0, "lost": 0.0}
        sensors = {name: {**content, **silent} for name, content in twin.resolved()["sensors"].items()}
        self._plant = load_scenario(twin.resolved(), {**values, "sensors": sensors})
        self._twin, self._trip, self._duration = twin, trip, duration
        self._columns = {name: column for column, name in enumerate(twin.sensors)}
        self._noise = np.array([np.hypot(one.noise, QUANTISED * one.quantum) for one in twin.sensors.values()])
        (self._rate,) = {one.rate for one in twin.sensors.values()}
        self._doubts: list[tuple[str, FloatArray]] = []
        self._sudden: dict[float, list[tuple[str, FloatArray]]] = {}
        self._plain: FloatArray | None = None

    def of(
        self, steps: Sequence[Step] = (), start: Mapping[str, Any] | None = None, changed: Changed | None = None
    ) -> FloatArray:
        """Readings (samples, sensors) of a plant with further steps, and other values at the start."""
        if not steps and not start and changed is None:
            if self._plain is None:
                self._plain = self._read([], {}, _same)
            return self._plain
        return self._read(steps, start or {}, changed or _same)

    def _read(self, steps: Sequence[Step], start: Mapping[str, Any], changed: Changed) -> FloatArray:
        scenario = load_scenario(self._plant.resolved(), dict(start))
        plant = Plant(scenario, sorted([self._trip, *steps], key=lambda one: one.time))
        found = np.full((round(self._duration * self._rate) + 1, len(self._columns)), np.nan)
        for _, arrived in measured(plant, self._duration, changed):
            for one in arrived:
                column = self._columns[one.sensor]
                size = one.values[0] if len(one.values) < 3 else float(np.linalg.norm(one.values))
                found[round(one.time * self._rate), column] = size / self._noise[column]
        return found

    def effects(self, without: str, at: float) -> list[FloatArray]:
        """What a standard deviation of each doubted quantity changes, but of those whose name ends with a text.

        Args:
            without: the fault is about it, so that it is no doubt; empty for none.
            at: s, when a quantity that may change at once may have done so instead.
        """
        if not self._doubts:
            self._doubts = self._effects()
        if at > 0.0 and at not in self._sudden:
            self._sudden[at] = self._sudden_effects(at)
        known = [*self._doubts, *self._sudden.get(at, [])]
        return [effect for name, effect in known if not without or not name.endswith(without)]

    def rolls(self, at: float) -> float:
        """Time (s) from which on a carriage rolls that stands at a time (s); that time where none stands."""
        encoders = [self._columns[name] for name, one in self._twin.sensors.items() if one.kind == "encoder"]
        speeds = np.abs(np.diff((self.of() * self._noise)[:, encoders], axis=0)) * self._rate
        rolling = np.flatnonzero((speeds > SLOW).any(axis=1)) / self._rate
        return float(rolling[rolling >= at].min(initial=self._duration))

    def _sudden_effects(self, at: float) -> list[tuple[str, FloatArray]]:
        """Likewise of sudden changes at a time (s) of friction and wind, not of payloads, which change in stations."""
        plain, found = self.of(), list[tuple[str, FloatArray]]()
        for one in slow_quantities(self._twin):
            if one.change > 0.0 and not one.payload_of:
                off = SMALL * one.change
                values = dict.fromkeys((one.key, *one.also), self._value(one.key) + off)
                there = self.of([Step(at, values=_always(values))])
                found.append((one.name, (there - plain) * (one.change / off)))
        return found

    def _value(self, key: str) -> float:
        """Value of the plant by its key."""
        value: Any = self._plant.resolved()
        for part in key.split("."):
            value = value[part] if isinstance(value, dict) else value["xyz".index(part)]
        return float(value)

    def _effects(self) -> list[tuple[str, FloatArray]]:
        plain, found = self.of(), list[tuple[str, FloatArray]]()
        for one in slow_quantities(self._twin):
            value = self._value(one.key)
            off = SMALL * one.deviation
            off = off if value + off <= one.high else -off
            there = self.of(start=dict.fromkeys((one.key, *one.also), value + off))
            found.append((one.name, (there - plain) * (one.deviation / off)))
            if one.name.startswith("wind/"):
                walk = WIND_WALK * CHANGING**0.5
                for time in np.arange(CHANGING, self._duration, CHANGING).tolist():
                    there = self.of([Step(time, values=_always({one.key: value + walk}))])
                    found.append((f"{one.name} from {time:g} s on", there - plain))
        rest = Simulation(self._twin).snapshot
        loads = rest.columns.support_force
        scale = {name: float(np.linalg.norm(loads[row])) for name, row in rest.layout.support_rows.items()}
        for name, reading in readings(self._twin, rest.layout, scale).items():
            error, column = np.zeros_like(plain), self._columns[name]
            error[:, column] = reading.error / self._noise[column]
            found.append((f"error of {name}", error))
        return found

    def time_of(self, signal: FloatArray, effects: Sequence[FloatArray], limit: float, since: float = 0.0) -> float:
        """Time (s) at which a signal (samples, sensors) weighs a limit, less what doubted effects explain of it.

        Args:
            signal: in standard deviations.
            effects: signals of the doubted quantities, each of a standard deviation.
            limit: square of standard deviations.
            since: s, from when on samples count.
        """
        size = len(effects)
        known, towards, total = np.eye(size), np.zeros(size), 0.0
        first = round(since * self._rate)
        for sample, row in enumerate(signal[first:], first):
            seen = np.flatnonzero(np.isfinite(row))
            own = np.array([effect[sample, seen] for effect in effects]).reshape(size, seen.size)
            own = np.nan_to_num(own)
            known += own @ own.T
            towards += own @ row[seen]
            total += float(row[seen] @ row[seen])
            if total >= limit and total - towards @ np.linalg.solve(known, towards) >= limit:
                return sample / self._rate
        return float("inf")


def _same(one: Measurement) -> Measurement:
    return one


def _always(values: Mapping[str, Any]) -> Callable[[object], Mapping[str, Any]]:
    return lambda _: values
