"""Filter that follows a plant: an ensemble of twins whose slow quantities are corrected by measurements.

The middle member has the estimate, two others for each slow quantity are above and below it, and one swings otherwise
for each angle of a body and its rate. All get the commands of the plant, so that their fast motion is that of the
model; after each window of measurements slow quantities and swing are corrected, and the states are blended so that
they are those which the corrected quantities would have brought about (recursive prediction error method, Ljung 1979,
with finite differences). The error of the model in each sensor is a bias that is estimated as well, and forgotten
within `FORGOTTEN`. While a vehicle passes a tower swing alone is corrected.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np
from scipy.stats import chi2

from cable_twin.ensemble.ensemble import ENDS_OF_CABLE, Ensemble
from cable_twin.ensemble.estimate.kalman import Belief, normalised_square, predict, update
from cable_twin.ensemble.estimate.quantities import (
    Hidden,
    Reading,
    hidden_quantities,
    readings,
    slow_quantities,
    stencil,
    weights_of,
)
from cable_twin.ensemble.estimate.swings import ANY_SWING, PRIOR, SIZE, anchored, carried, growth, swings
from cable_twin.frame.records import AppliedCommand
from cable_twin.frame.sensors import Measurement
from cable_twin.frame.snapshot import Layout
from cable_twin.mechanics.parameters import FloatArray
from cable_twin.scenario import Scenario

WINDOW = 2.0  # s, between two corrections
LONGEST_WINDOW = 6.0  # s, to which it may grow while members pass from one element to the next
SETTLING = 0.15  # s after a correction, without measurements
FORGOTTEN = 100.0  # s, in which the error of the model in a sensor changes
CURVATURE = 0.15  # of the step of a slow quantity, by which it may be wrong, as effects are not linear
CALMED = 300.0  # s, in which what a tower has stirred calms down
TIMING = 0.05  # s, by which what a sensor measures may be earlier or later than in the model
NARROWEST = 0.03  # of the prior deviation, apart from which members are at least
SURE = 1e-6  # probability at which a sensor contradicts the others
NEAR = 40.0  # m along the track from a tower, where slow quantities go on by the model
CERTAIN = 3.0  # standard deviations, beyond which an estimate is not that of the scenario
THOUSANDFOLD = 300.0, 3000.0  # times a prediction that a sensor with a wrong unit reads, or the inverse of that
PLANT = "plant"  # instead of a sensor: several contradict
SUSPECT_WINDOWS = 3  # in which it has to, one after the other, before it is left out for good
STUCK_SAMPLES = 30  # equal ones of a sensor with noise


class Estimate(NamedTuple):
    """Estimated value with its standard deviation."""

    value: float
    deviation: float
    unit: str


class Alarm(NamedTuple):
    """Something that the sensors say of the plant or of each other."""

    time: float  # s
    reason: str


class Correction(NamedTuple):
    """Result of one window."""

    time: float  # s
    slow: dict[str, Estimate]
    hidden: dict[str, Estimate]
    innovation: float  # normalised square over its degrees of freedom
    alarms: tuple[Alarm, ...]  # new ones


class _Row(NamedTuple):
    """One measurement beside the predictions of the members."""

    sensor: str
    value: float
    predicted: FloatArray  # (members,)
    variance: float
    numbers: FloatArray  # (members, n) of the frames of that time


class Follower:
    """Twin that follows a plant.

    Args:
        scenario: of the twin; its `sensors` are those of the plant.
        threads: of the ensemble.
    """

    def __init__(self, scenario: Scenario, threads: int | None = None) -> None:
        self.slow = slow_quantities(scenario)
        apart = Layout.of(scenario, ENDS_OF_CABLE)
        self._fast = swings(apart)
        self._first = 2 * len(self.slow) + 1  # member with the first swing
        self._ensemble = Ensemble(scenario, self._first + len(self._fast), threads=threads, progress=False)
        start = self._ensemble.snapshot(0)
        supports = start.layout.support_rows
        scale = {name: float(np.linalg.norm(start.columns.support_force[row])) for name, row in supports.items()}
        self.readings: dict[str, Reading] = readings(scenario.sensors, start.layout, scale)
        self._towers = np.array([one.position[0] for one in scenario.towers.values()])
        self._tracks = start.layout.places.joint_position[:, 0].astype(np.intp)
        self.hidden: tuple[Hidden, ...] = hidden_quantities(scenario, start.layout)
        self._deviation = np.array([one.deviation for one in self.slow])
        errors = np.array([one.error for one in self.readings.values()])
        self._errors, self._rows_of = errors, {name: row for row, name in enumerate(self.readings)}
        mean = np.concatenate([[one.mean for one in self.slow], np.zeros(len(self._fast) + errors.size)])
        swing = np.full(len(self._fast), PRIOR)
        self._belief = Belief(mean, np.diag(np.concatenate([self._deviation, swing, errors]) ** 2))
        self._points, self._at_tower, self._stirred = self._stencil(), False, 0.0
        self._motion: dict[str, float] = {}  # place and speed of vehicles at the last beginning, by key
        self._change(rest=True)
        self._swing()
        self._rows: list[_Row] = []
        self._before: tuple[float, FloatArray] | None = None
        self._since, self._from, self._zero = 0.0, 0.0, 0.0
        self._suspected: dict[str, int] = {}
        self._last: dict[str, tuple[float, int]] = {}  # value and count of equal samples
        self._exchanged: dict[str, str] = {}  # sensor by another one, whose name its measurements have
        self._told: set[str] = set()  # quantities with an alarm
        self.left_out: dict[str, Alarm] = {}

    @property
    def time(self) -> float:
        """Simulated time (s) of the twin."""
        return self._zero + float(self._ensemble.times[0])

    def begin_at(self, time: float, motion: Mapping[str, tuple[float, float]]) -> None:
        """Restart at a time (s) from rest or steady motion; the estimates of slow quantities are kept.

        Args:
            time: s, from which the twin goes on.
            motion: place (m) and speed (m/s) of carriages by name; others begin where they do in the scenario.

        Raises:
            ScenarioError, EquilibriumError, ValueError: they cannot be there; one line. The twin stays as it was.
        """
        values = {f"carriages.{name}.arc_length": place for name, (place, _) in motion.items()}
        values |= {f"carriages.{name}.speed": speed for name, (_, speed) in motion.items()}
        before, self._motion = self._motion, values
        try:
            self._change(rest=True)
        except ValueError:
            self._motion = before
            raise
        count, covariance = len(self.slow), self._belief.covariance.copy()
        fast, mean = slice(count, count + len(self._fast)), self._belief.mean.copy()
        mean[fast], covariance[fast, :], covariance[:, fast] = 0.0, 0.0, 0.0
        under_way = any(speed != 0.0 for _, speed in motion.values())
        covariance[fast, fast] = (ANY_SWING if under_way else PRIOR) ** 2 * np.eye(len(self._fast))
        self._belief = Belief(mean, covariance)
        self._rows, self._before, self._zero = [], None, time
        self._since, self._from, self._at_tower = time, time, False
        self._suspected.clear()
        self._swing()

    def close(self) -> None:
        """End the threads of the ensemble."""
        self._ensemble.close()

    def command(self, applied: AppliedCommand) -> None:
        """Give a command of the plant to the twin at its time.

        Raises:
            CommandError: the twin refuses it.
        """
        self._advance(applied.time)
        self._ensemble.apply(applied.command)

    def take(self, time: float, measurements: Sequence[Measurement]) -> Correction | None:
        """Take the measurements of one time (s), which are not older than those before; a correction where due.

        Without any measurement in a window the twin goes on by its model, with more doubt.
        """
        self._advance(time)
        numbers = self._ensemble.numbers()
        alarms = self._stuck(time, measurements) + self._of_another_unit(time, measurements, numbers)
        rates = (
            0.0 if self._before is None else np.abs(numbers[0] - self._before[1]) / max(time - self._before[0], 1e-3)
        )
        self._before = time, numbers[0].copy()
        if time > self._from + SETTLING or self._from == 0.0:
            for one in measurements:
                reading = self.readings.get(one.sensor)
                if reading is None or one.sensor in self.left_out:
                    continue
                sensor = self._exchanged.get(one.sensor, one.sensor)
                value = one.values[0] if reading.places.size == 1 else float(np.linalg.norm(one.values))
                reading = self.readings[sensor]
                rate = 0.0 if isinstance(rates, float) else float(np.linalg.norm(rates[reading.places]))
                variance = self._variance(reading) + (TIMING * rate) ** 2
                self._rows.append(_Row(sensor, value, reading.of(numbers), variance, numbers))
        if self._passes_a_tower(numbers[0]) != self._at_tower:
            self._at_tower = not self._at_tower
            self._stirred = 1.0
            self._rows, self._since, self._from = [], time, time
            if not self._at_tower:
                for member in range(1, self._first):
                    self._ensemble.swing(member, anchored(self._fast, numbers, member))
            return None
        lasted = time - self._since
        if lasted < WINDOW - 1e-6 or (lasted < LONGEST_WINDOW and not self._ensemble.alike):
            return None
        return self._correct(time, numbers, alarms)

    def place_of(self, sensor: str) -> float:
        """Place (m) of an encoder in the twin at present."""
        return float(self.readings[sensor].of(self._ensemble.numbers()[:1])[0])

    def _advance(self, time: float) -> None:
        self._ensemble.advance_to(max(time, self.time) - self._zero)

    def _passes_a_tower(self, numbers: FloatArray) -> bool:
        """Whether a carriage is so near to a tower that the members differ in more than first order."""
        places = numbers[self._tracks]
        return bool((np.abs(places[:, None] - self._towers) < NEAR).any())

    def _correct(self, time: float, numbers: FloatArray, alarms: list[Alarm]) -> Correction:
        """Correct slow quantities and states by the measurements of a window."""
        used = self._of_swing() if self._at_tower else self._consistent(time, alarms)
        innovation = 1.0
        if used:
            terms = self._linear(used)
            innovation = normalised_square(*terms, self._belief.covariance) / len(used)
            self._belief = update(self._belief, *terms)
            self._doubt_steps()
        lasted, self._since, self._from = time - self._since, time, time
        hidden = self._hidden(numbers)
        self._go_on(lasted, numbers)
        slow = self._slow()
        alarms += self._against_plan(time, slow)
        return Correction(time, slow, hidden, innovation, tuple(alarms))

    def _doubt_steps(self) -> None:
        """Add the second-order error of the last correction to the variances of slow quantities."""
        count, covariance = len(self.slow), self._belief.covariance.copy()
        moved = self._belief.mean[:count] - self._points[0]
        covariance[range(count), range(count)] += (CURVATURE * moved) ** 2
        self._belief = self._belief._replace(covariance=covariance)

    def _go_on(self, lasted: float, numbers: FloatArray) -> None:
        """Begin a new window after one of some seconds, with the states of what is believed where members are alike."""
        count, swinging = len(self.slow), len(self._fast)
        kept = np.exp(-lasted / FORGOTTEN)
        self._stirred = 1.0 if self._at_tower else self._stirred * float(np.exp(-lasted / CALMED))
        decay = np.concatenate([np.ones(count + swinging), np.full(self._errors.size, kept)])
        walks = np.array([one.walk for one in self.slow])
        gained = growth(self._fast, lasted, self._stirred, self._at_tower)
        added = np.concatenate([walks**2 * lasted, gained, (1.0 - kept**2) * self._errors**2])
        self._rows = []
        if self._ensemble.alike:
            wanted, fast = self._stencil(), slice(count, count + swinging)
            self._ensemble.blend(self._weights(wanted, self._belief.mean[fast] / SIZE))
            self._points = wanted
            moved = np.eye(decay.size)
            moved[fast, fast] = carried(self._fast, numbers, self._first)
            mean = self._belief.mean.copy()
            mean[:count], mean[fast] = wanted[0], 0.0
            self._belief = Belief(mean, moved @ self._belief.covariance @ moved.T)
            self._change()
            self._swing()
        else:
            added[count : count + swinging] = 0.0  # the members still have the swings of the window before
        self._belief = predict(self._belief, decay, added)

    def _weights(self, wanted: FloatArray, shares: FloatArray) -> FloatArray:
        """Weights (members, members) of a blend: slow quantities (2 n + 1, n), and shares (m,) of the given swings."""
        size, first = len(self._ensemble), self._first
        weights = np.zeros((size, size))
        weights[:first, :first] = weights_of(self._points, wanted)
        weights[:first, first:] += shares
        weights[:first, 0] -= shares.sum()
        weights[first:] = weights[0]
        return weights

    def _swing(self) -> None:
        """Give the last members their swings, beyond that of the middle one."""
        for number, one in enumerate(self._fast):
            self._ensemble.swing(self._first + number, [one.turn(SIZE)])

    def _of_swing(self) -> list[_Row]:
        """Rows of a window that measure the swing of vehicles."""
        return [row for row in self._rows if self.readings[row.sensor].unit == "rad"]

    def _against_plan(self, time: float, slow: Mapping[str, Estimate]) -> list[Alarm]:
        """Alarms for quantities that are surely not those of the scenario."""
        alarms = []
        for one in self.slow:
            got = slow[one.name]
            apart = abs(got.value - one.plan)
            if one.name not in self._told and apart > one.tolerance + CERTAIN * got.deviation:
                self._told.add(one.name)
                found = f"{got.value:.4g} {one.unit}, standard deviation {got.deviation:.2g}"
                alarms.append(Alarm(time, f"{one.name} is {found}; {one.plan:.4g} in the scenario"))
        return alarms

    def _consistent(self, time: float, alarms: list[Alarm]) -> list[_Row]:
        """Rows of a window without the sensor that contradicts all others; alarms for one that keeps doing so."""
        rows, left = self._rows, set(self._rows_of)
        worst, square = self._worst(rows, left)
        contradicting = ""
        if square > 1.0:
            contradicting = worst
            rows = [row for row in rows if row.sensor != worst]
            if rows and self._worst(rows, left - {worst})[1] > 1.0:
                contradicting, rows = self._exchange()
        self._suspected = {contradicting: self._suspected.get(contradicting, 0) + 1} if contradicting else {}
        if self._suspected.get(contradicting) == SUSPECT_WINDOWS:
            if contradicting == PLANT:
                alarms.append(Alarm(time, "several sensors contradict the model: the plant is not as it is described"))
            elif "/" in contradicting:
                one, other = contradicting.split("/")
                self._exchanged |= {one: other, other: one}
                alarms.append(Alarm(time, f"sensors {one} and {other} are swapped, and are taken for each other"))
            else:
                alarm = Alarm(time, f"sensor {contradicting} contradicts all others and is left out")
                alarms.append(alarm)
                self.left_out[contradicting] = alarm
        return rows

    def _exchange(self) -> tuple[str, list[_Row]]:
        """Two sensors, ONE/OTHER, that contradict nothing if swapped, with such rows; else `PLANT` and none."""
        pairs = [
            (one, other)
            for one, other in combinations(self.readings, 2)
            if self.readings[one].unit == self.readings[other].unit and not {one, other} & {*self.left_out}
        ]
        for one, other in pairs:
            to = {one: other, other: one}
            rows = [self._read_as(row, to[row.sensor]) if row.sensor in to else row for row in self._rows]
            if self._worst(rows, set(self._rows_of))[1] <= 1.0:
                return f"{one}/{other}", rows
        return PLANT, []

    def _variance(self, reading: Reading) -> float:
        """Variance of a sample: noise of the sensor and fast error of the model."""
        return reading.noise**2 + reading.fast.variance(self._stirred, self._at_tower)

    def _read_as(self, row: _Row, sensor: str) -> _Row:
        """Row of a measurement with the prediction and variance of another sensor, to test for swapped sensors."""
        reading = self.readings[sensor]
        return row._replace(sensor=sensor, predicted=reading.of(row.numbers), variance=self._variance(reading))

    def _worst(self, rows: Sequence[_Row], sensors: set[str]) -> tuple[str, float]:
        """Sensor with the least likely innovations, and their normalised square over its limit."""
        worst, most = "", 0.0
        for sensor in sensors:
            own = [row for row in rows if row.sensor == sensor]
            if own:
                square = normalised_square(*self._linear(own), self._belief.covariance) / chi2.isf(SURE, len(own))
                worst, most = (sensor, square) if square > most else (worst, most)
        return worst, most

    def _linear(self, rows: Sequence[_Row]) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Innovation (m,), Jacobian (m, n) and variance (m,) of measurements."""
        count = len(self.slow) + len(self._fast)
        predicted = np.array([row.predicted for row in rows])
        jacobian = np.zeros((len(rows), self._belief.mean.size))
        jacobian[:, :count] = self._slopes(predicted)
        if self._at_tower:
            jacobian[:, : len(self.slow)] = 0.0
        columns = [count + self._rows_of[row.sensor] for row in rows]
        jacobian[range(len(rows)), columns] = 1.0
        innovation = np.array([row.value for row in rows]) - predicted[:, 0] - jacobian @ self._pending()
        return innovation, jacobian, np.array([row.variance for row in rows])

    def _slopes(self, predicted: FloatArray) -> FloatArray:
        """Derivatives (m, n) by slow quantities and swings of predictions (m, members)."""
        number, first = np.arange(len(self.slow)), self._first
        apart = self._points[1 + 2 * number, number] - self._points[2 + 2 * number, number]
        slow = (predicted[:, 1:first:2] - predicted[:, 2:first:2]) / apart
        fast = (predicted[:, first:] - predicted[:, :1]) / SIZE
        return np.hstack([slow, fast])

    def _pending(self) -> FloatArray:
        """Differences (n,) of the estimate from the quantities of the middle member."""
        mean = self._belief.mean.copy()
        mean[: len(self.slow)] -= self._points[0]
        return mean

    def _slow(self) -> dict[str, Estimate]:
        deviations = np.sqrt(np.diag(self._belief.covariance))
        means = self._belief.mean
        return {
            one.name: Estimate(float(means[row]), float(deviations[row]), one.unit) for row, one in enumerate(self.slow)
        }

    def _hidden(self, numbers: FloatArray) -> dict[str, Estimate]:
        """Hidden quantities with the deviations that follow from those of slow ones, and from the model's error."""
        count, found = len(self.slow) + len(self._fast), {}
        shift = self._pending()[:count]
        covariance = self._belief.covariance[:count, :count]
        for one in self.hidden:
            rows = numbers[:, one.places]
            values = rows[:, 0] if one.places.size == 1 else np.linalg.norm(rows, axis=1)
            slopes = self._slopes(values[None, :])[0]
            value = float(values[0] + slopes @ shift)
            errors = one.errors.scaled(abs(value) if one.unit == "N" else 1.0)
            variance = slopes @ covariance @ slopes + errors.variance(self._stirred, self._at_tower)
            found[one.name] = Estimate(value, float(np.sqrt(variance)), one.unit)
        return found

    def _stuck(self, time: float, measurements: Sequence[Measurement]) -> list[Alarm]:
        """Alarms for sensors with noise that repeat one value; they are left out."""
        alarms = []
        for one in measurements:
            reading = self.readings.get(one.sensor)
            if reading is None or one.sensor in self.left_out or reading.unit == "m":
                continue
            size = float(np.linalg.norm(one.values))
            value, count = self._last.get(one.sensor, (np.nan, 0))
            same = abs(value - size) <= 1e-9 * abs(size)
            self._last[one.sensor] = size, count + 1 if same else 1
            if same and count + 1 == STUCK_SAMPLES:
                alarm = Alarm(time, f"sensor {one.sensor} is stuck at {size:.6g} {reading.unit} and is left out")
                self.left_out[one.sensor] = alarm
                alarms.append(alarm)
        return alarms

    def _of_another_unit(self, time: float, measurements: Sequence[Measurement], numbers: FloatArray) -> list[Alarm]:
        """Alarms for sensors that read a thousand times more or less than can be; they are left out."""
        alarms = []
        for one in measurements:
            reading = self.readings.get(one.sensor)
            if reading is None or one.sensor in self.left_out:
                continue
            wanted = abs(float(reading.of(numbers[:1])[0]))
            size = float(np.linalg.norm(one.values[:1] if reading.places.size == 1 else one.values))
            share = size / wanted if wanted > 30.0 * reading.noise else 1.0
            if any(
                least <= ratio <= most for ratio in (share, 1.0 / max(share, 1e-12)) for least, most in [THOUSANDFOLD]
            ):
                text = f"reads {size:.4g} {reading.unit} where {wanted:.4g} are expected: another unit? It is left out"
                self.left_out[one.sensor] = alarm = Alarm(time, f"sensor {one.sensor} {text}")
                alarms.append(alarm)
        return alarms

    def _stencil(self) -> FloatArray:
        count = len(self.slow)
        deviations = np.sqrt(np.diag(self._belief.covariance)[:count])
        return stencil(self._belief.mean[:count], np.maximum(deviations, NARROWEST * self._deviation), self.slow)

    def _change(self, rest: bool = False) -> None:
        """Give the members the slow quantities of their points, the swinging ones those of the middle."""
        points = np.vstack([self._points, np.tile(self._points[0], (len(self._fast), 1))])
        values: Mapping[str, list[float]] = {one.key: points[:, row].tolist() for row, one in enumerate(self.slow)}
        self._ensemble.change({**values, **self._motion} if rest else values, rest=rest)
