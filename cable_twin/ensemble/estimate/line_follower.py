"""Filter for a line with many carriers: the payload of each from the loads of towers that it passes.

An ensemble with a member for each chair would be too large. The twin is one simulation with the planned payloads, and
the effect of another payload on the sensors is taken from statics (`line_statics`), so that each measurement has a
sparse row of derivatives.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from copy import deepcopy
from typing import Any, NamedTuple

import numpy as np
import scipy  # loads `special` where it is used
from numpy.typing import NDArray

from cable_twin.ensemble.estimate.beginning import Motion, values_at, with_offsets
from cable_twin.ensemble.estimate.correction import Correction
from cable_twin.ensemble.estimate.detectors.alarm import Alarm
from cable_twin.ensemble.estimate.detectors.biases import WRONG, Biases
from cable_twin.ensemble.estimate.detectors.departures import Departures, Expected
from cable_twin.ensemble.estimate.detectors.sensor_faults import PLANT, Doubts, fault_of_drive
from cable_twin.ensemble.estimate.detectors.unlike_motion import UnlikeMotion
from cable_twin.ensemble.estimate.kalman import Belief, Terms, normalised_square, predict, reset, update, within
from cable_twin.ensemble.estimate.line_statics import EMPTY, PAYLOAD, Carried, LineStatics, drag_of_wind
from cable_twin.ensemble.estimate.quantities import ICE_TOLERANCE, ICE_WALK, Estimate, Reading, Slow, readings
from cable_twin.ensemble.estimate.waves import LineWaves
from cable_twin.frame.records import AppliedCommand
from cable_twin.frame.sensors import Measurement
from cable_twin.frame.snapshot import Snapshot
from cable_twin.mechanics.parameters import FloatArray
from cable_twin.scenario import Scenario, command_limits, load_scenario
from cable_twin.simulation import Simulation

WINDOW, ENDS = 1.0, 2  # s, of which the mean of each sensor is taken
FRICTION_TOLERANCE = 0.25  # of that of the scenario, by which it may differ without an alarm
FRICTION = 0.4  # standard deviation of the friction of all towers, as share of that of the scenario
ROLLING = 0.4  # of that of the scenario, standard deviation of the rolling friction of carriers on track ropes
ROLLING_TOLERANCE = 0.5  # of that of the scenario, by which it may differ without an alarm
TENSIONED, TENSION_TOLERANCE = 0.02, 0.01  # of a counterweight: standard deviation at first, without an alarm
WIND = 5.0  # m/s, standard deviation of wind along the track
FIRST_ICE = 1.0  # kg/m, standard deviation of the ice on all ropes
BIAS, FAST = 0.002, 0.003  # of the load of a tower at rest: slow and fast error of the model
DRIVE_BIAS, DRIVE_FAST = 8e-4, 1.6e-3  # of the load of all towers at rest: the same of a drive
FORGOTTEN = 200.0  # s, in which a slow error changes
LAGS = 4  # windows over which waves are looked at
REMEMBERED, SUDDEN = 15.0, 9.0  # windows over which fast errors are averaged, and times their variance that counts
NEAR = 6.0  # m along the track from a tower, where a carrier is on its sheaves: its load is left out
STARTING = 0.05  # m/s^2, of the drive, from which on it is left out: what it moves is not known so well
SURE = 1e-7  # as that of `follower`
REACH = 2.0  # m, by which the twin may be from its plant while it follows, and still be where it is
PLAN = 0.05  # of the capacity, by which a payload may differ from the plan without an alarm
HIDDEN = 0.012  # of the load at rest: error of the model in the force of a tower


class _Sample(NamedTuple):
    """Measurement of a sensor, or mean of several, with its prediction and the derivatives of the prediction."""

    value: float
    predicted: float
    effects: FloatArray  # (n,) derivatives of what is predicted
    number: int = 1  # of measurements


class _Common(NamedTuple):
    """Quantity that all carriers or towers share, as the scenario has it, and how far a plant may differ."""

    value: float
    deviation: float  # standard deviation, at first
    tolerance: float  # without an alarm
    unit: str


class _Followed(NamedTuple):
    """Estimates of a followed lift and places of its carriers, from the last time when twin and plant agreed."""

    time: float  # s
    places: FloatArray  # (carriers,) m along the loop
    strands: FloatArray  # (carriers,) indices, NaN for carriers on none
    plan: FloatArray  # (carriers,) kg
    learned: Any


class FastErrors:
    """Variance of the model's fast error in each sensor: at least a given one, more while waves run along the rope.

    A cabin that boards with another payload than planned starts other waves. They show in how a sensor's difference
    from its prediction changes within some windows, to which slow quantities add little: half of the mean square of
    its change to the next window is the variance of one window by itself. What a window is worth beside others is told
    by the largest such variance over some windows, up to twice that of a wave half a period apart, as windows one
    after the other are alike by a wave. A single large change is no wave but a fault of the sensor or the plant: of
    the last three, the second largest counts.

    Args:
        least: standard deviation of each sensor.
    """

    def __init__(self, least: Mapping[str, float]) -> None:
        self._least = {name: one**2 for name, one in least.items()}
        self._present = {name: [one, one] for name, one in self._least.items()}  # of one window, of one among others
        self._last: dict[str, deque[tuple[float, float, FloatArray]]] = {name: deque(maxlen=LAGS) for name in least}
        self._changes = {  # squared, halved, by the number of windows between
            name: [deque([one, one], maxlen=3) for _ in range(LAGS)] for name, one in self._least.items()
        }

    def variance(self, sensor: str, *, alone: bool = False) -> float:
        """Present variance of the model's fast error in a window of a sensor: of one `alone`, or among others."""
        return max(self._present[sensor][0 if alone else 1], self._least[sensor])

    def take(self, time: float, sensor: str, apart: float, effects: FloatArray, mean: FloatArray) -> None:
        """Update the variances of a sensor by its mean difference from the prediction in a window.

        Args:
            time: s, end of the window.
            sensor: name.
            apart: measured less predicted value.
            effects: (n,) derivatives of the predicted value.
            mean: (n,) present estimate.
        """
        last = self._last[sensor]
        if last and time - last[-1][0] > 1.5 * WINDOW:
            last.clear()
        for (_, before, others), changes in zip(reversed(last), self._changes[sensor], strict=False):
            changes.append(0.5 * (apart - before - float((effects - others) @ mean)) ** 2)
        if last:
            squares = [sorted(one)[1] for one in self._changes[sensor]]
            for row, found in enumerate((squares[0], max(squares))):
                present = max(self._present[sensor][row], self._least[sensor])
                self._present[sensor][row] = present + (min(found, SUDDEN * present) - present) / REMEMBERED
        last.append((time, apart, effects))


class LineFollower:
    """Filter by which a twin follows a plant with carriers on a loop: payloads, friction, ice and counterweights.

    Attributes:
        slow: none; the truth of a payload is no key of a scenario.
        window: s, between two corrections.
        readings: sensors that are read, by name; the values of load cells at towers and of drive forces are compared
            with the model, the others only looked at for faults of their own.
        doubts: detector of faulty sensors.
        carriers: names of the carriers.
        zeros: none; a lift begins where the rope that has gone by at its drive says.
        needs_rest: False, as it may begin at a lift under way.

    Args:
        scenario: of the twin; its `sensors` are those of the plant.
    """

    slow: tuple[Slow, ...] = ()
    window = WINDOW
    needs_rest = False
    zeros: Mapping[str, float] = {}

    def __init__(self, scenario: Scenario) -> None:
        self._scenario = scenario
        self._twin = Simulation(scenario, samples=ENDS)
        start, layout = self._twin.snapshot, self._twin.layout
        supports = layout.support_rows
        self._rest = {name: float(np.linalg.norm(start.columns.support_force[row])) for name, row in supports.items()}
        self.readings: dict[str, Reading] = readings(scenario, layout, self._rest)
        self._of = {name: scenario.sensors[name].of for name in self.readings}
        self._kinds = {name: scenario.sensors[name].kind for name in self.readings}
        self._of_forces = [  # whose values tell payloads, friction and ice
            name for name in self.readings if self._kinds[name] == "drive_force" or self._of[name] in layout.towers
        ]
        self._encoders = {name for name, kind in self._kinds.items() if kind == "encoder"}
        self._zero = 0.0
        self.doubts = Doubts(self.readings)
        self.carriers = layout.carriers
        self._rows = np.array([layout.vehicle_rows[name] for name in self.carriers])
        assert scenario.carriers is not None
        kinds = scenario.carriers.kinds_by_path.values()
        self._capacity = max(kind.payload.capacity for kind in kinds if kind.payload is not None)
        self._statics = LineStatics(scenario, start)
        ice, rolling = next(iter(scenario.cables.values())).ice, scenario.carriers.friction.rolling
        self._commons = {
            "towers/friction": _Common(1.0, FRICTION, FRICTION_TOLERANCE, "-"),
            "carriers/rolling": _Common(rolling, ROLLING * rolling, ROLLING_TOLERANCE * rolling, "-"),
            **{
                f"{name}/counterweight": _Common(mass, TENSIONED * mass, TENSION_TOLERANCE * mass, "kg")
                for name, mass in self._statics.counterweights.items()
            },
            "ropes/ice": _Common(ice, FIRST_ICE, ICE_TOLERANCE, "kg/m"),  # the last one, which drifts
        }
        if not scenario.carriers.tracks:
            del self._commons["carriers/rolling"]
        self._known = len(self.carriers) + len(self._commons)
        size = self._known + len(self._of_forces)
        blown = [self._kinds[name] == "drive_force" and drag_of_wind(scenario, WIND) for name in self._of_forces]
        self._bias = np.hypot([self._scale(name, BIAS, DRIVE_BIAS) for name in self._of_forces], blown)
        deviations = np.concatenate(
            [
                [PAYLOAD * self._capacity] * len(self.carriers),
                [one.deviation for one in self._commons.values()],
                self._bias,
            ]
        )
        self._belief = Belief(np.zeros(size), np.diag(deviations**2))
        cells = [name for name in self._of_forces if self._kinds[name] == "load_cell"]
        self._biases = Biases({name: WRONG * self._rest[self._of[name]] for name in cells}, size)
        self._plan = start.columns.payload[self._rows].copy()
        self._sums: dict[str, list[_Sample]] = {}
        self._fast = FastErrors({name: self._scale(name, FAST, DRIVE_FAST) for name in self._of_forces})
        self._since, self._speed = 0.0, (0.0, 0.0)
        self._departures, self._waves = Departures(), LineWaves()
        self._alarms: list[Alarm] = []  # of this window
        self._unlike = UnlikeMotion()
        self._fastest = max(one.speed for one in command_limits(scenario).values())  # m/s
        self._followed: _Followed | None = None  # as of the last window in which the twin was where the plant was

    @property
    def left_out(self) -> dict[str, Alarm]:
        """Sensors that are left out as faulty, each with its alarm."""
        return self.doubts.left_out

    @property
    def learned(self) -> Any:
        """Estimates, alarms and faulty sensors so far, to restore them after the twin has begun at a wrong place."""
        own = deepcopy((self._belief, self._biases, self._departures))
        return own, self.doubts.known

    @learned.setter
    def learned(self, learned: Any) -> None:
        (self._belief, self._biases, self._departures), self.doubts.known = learned
        self._followed = None

    @property
    def time(self) -> float:
        """Simulated time (s) of the twin."""
        return self._zero + self._twin.time

    def begin_at(self, time: float, motion: Motion) -> None:
        """Restart at a time (s) from rest or steady motion; friction, errors of sensors and payloads on board are kept.

        Payloads are kept of carriers that can have passed no station since they were last followed.

        Args:
            time: s, from which the twin goes on.
            motion: length of rope that has passed (m) and speed (m/s) of drives by name.

        Raises:
            ScenarioError, EquilibriumError: carriers cannot be there; one line. The twin stays as it was.
        """
        values, offsets = values_at(self._scenario, motion)
        self._twin = Simulation(load_scenario(self._scenario.resolved(), values), samples=ENDS)
        self.readings |= with_offsets(self.readings, self._scenario, offsets)
        snapshot = self._twin.snapshot
        aboard = self._aboard(time, snapshot)
        if aboard.any() and self._followed is not None:
            self.learned = self._followed.learned
        self._plan = snapshot.columns.payload[self._rows].copy()
        self._forget(np.flatnonzero(~aboard).tolist())
        self._zero, self._since, self._sums, self._speed = time, time, {}, (0.0, 0.0)
        self._unlike.clear()
        self.doubts.forget()

    def _aboard(self, time: float, snapshot: Snapshot) -> NDArray[np.bool_]:
        """Mask (carriers,) of those on the strand on which they were last followed, if they can have come from there.

        A plant that is farther away than its drive can have taken the rope since then was started anew.
        """
        followed, none = self._followed, np.zeros(len(self.carriers), np.bool_)
        if followed is None:
            return none
        loop, reach = self._scenario.loop_length, self._fastest * (time - followed.time) + REACH
        moved = self._places(snapshot) - followed.places
        moved -= loop * np.round(moved / loop)
        if reach > 0.5 * loop or np.abs(np.nanmedian(moved)) > reach:
            return none
        planned = snapshot.columns.payload[self._rows] == followed.plan
        return np.asarray((self._strands(snapshot) == followed.strands) & planned)

    def _places(self, snapshot: Snapshot) -> FloatArray:
        """Places (carriers,) in m of carriers along the loop."""
        return snapshot.layout.on_loop(snapshot.columns)[self._rows]

    def _strands(self, snapshot: Snapshot) -> FloatArray:
        """Indices (carriers,) of the strands on which carriers are; NaN for carriers on none."""
        on = snapshot.columns.attached[self._rows] == 1.0
        return np.where(on, snapshot.columns.vehicle_rope[self._rows], np.nan)

    def _note_followed(self, time: float, snapshot: Snapshot, measurements: Sequence[Measurement]) -> None:
        """Keep what is known at a time (s), unless an encoder says that the plant is elsewhere."""
        places = [(one.values[0], self.place_of(one.sensor)) for one in measurements if one.sensor in self._encoders]
        if places and all(abs(measured - own) < REACH for measured, own in places):
            self._followed = _Followed(time, self._places(snapshot), self._strands(snapshot), self._plan, self.learned)

    def place_of(self, sensor: str) -> float:
        """Present reading (m) of an encoder in the twin."""
        return self.readings[sensor].in_frame(self._twin.snapshot.numbers)

    def doubt_swing(self, until: float = 0.0, waves: float = 1.0) -> None:
        """Expect waves that the twin does not have from now on, as of a plant that has stopped all at once."""
        self._waves.stir(self.time)

    def close(self) -> None:
        """End the follower, which has no threads."""

    def command(self, applied: AppliedCommand) -> None:
        """Apply a command of the plant to the twin, at the time of the command.

        Raises:
            CommandError: the twin refuses it.
        """
        self._advance(applied.time)
        self._twin.apply(applied.command)

    def take(self, time: float, measurements: Sequence[Measurement]) -> Correction | None:
        """Process the measurements of one time (s), in the order of time; returns a correction at a window's end."""
        snapshot = self._advance(time)
        self._exchange(snapshot)
        numbers = snapshot.numbers[None, :]
        self._note_motion(snapshot, measurements)
        alarms = self.doubts.of_samples(time, measurements, snapshot.numbers)
        for one in measurements:
            sensor = self.doubts.taken(one.sensor)
            if self._unlike.lasts(time) or not sensor or not self._counts(sensor, snapshot):
                continue
            reading, row = self.readings[sensor], self._effects(sensor, snapshot)
            sample = _Sample(reading.measured(one), float(reading.of(numbers)[0]), row)
            self._sums.setdefault(sensor, []).append(sample)
        if time - self._since < WINDOW - 1e-6:
            self._alarms += alarms
            return None
        alarms, self._alarms = [*self._alarms, *alarms], []
        correction = self._correct(time, snapshot, alarms)
        self._note_followed(time, snapshot, measurements)
        return correction

    def _note_motion(self, snapshot: Snapshot, measurements: Sequence[Measurement]) -> None:
        """Leave out all forces for some seconds where a drive of the plant moves otherwise than that of the twin.

        In its emergency stop they are those of brakes and waves, which tell nothing of payloads and friction.
        """
        for one in measurements:
            if one.sensor not in self._encoders or one.sensor in self.left_out:
                continue
            own = float(snapshot.columns.drive_speed[snapshot.layout.drive_rows[self._of[one.sensor]]])
            if self._unlike.note(one.time, one.sensor, one.values[0], own):
                self._sums = {}

    def _advance(self, time: float) -> Snapshot:
        return self._twin.advance_to(max(time - self._zero, self._twin.time))

    def _correct(self, time: float, snapshot: Snapshot, alarms: list[Alarm]) -> Correction:
        """Correct payloads, friction and ice by the mean values of the sensors in a window."""
        found = {name: _mean(samples) for name, samples in self._sums.items() if len(samples) > 2}
        innovation = self._update(time, found, alarms)
        believed = self._possible(self._biases.believed(self._belief))  # before the doubt of the next window
        slow, hidden = self._slow(believed), self._hidden(snapshot, believed)
        agreed = self._slow(self._possible(self._biases.agreed(self._belief)))
        alarms += self._departures.alarms(time, slow, self._expected(), agreed)
        self._drift(time - self._since)
        self._since, self._sums = time, {}
        return Correction(time, slow, hidden, innovation, tuple(alarms))

    def _update(self, time: float, found: Mapping[str, _Sample], alarms: list[Alarm]) -> float:
        """Correct the belief by the means of the sensors in a window; returns the normalised innovation."""
        for name, one in found.items():
            self._fast.take(time, name, one.value - one.predicted, one.effects, self._belief.mean)
        sensors = self._consistent(time, found, alarms)
        innovation = 1.0
        if sensors:
            terms = self._terms(sensors, found, self._belief)
            innovation = normalised_square(*terms, self._belief.covariance) / len(sensors)
            self._biases.note([*sensors], *terms, self._belief)
            self._belief = update(self._belief, *terms)
        self._belief, wrong = self._biases.judge(time, self._belief, self.doubts)
        alarms += wrong
        return innovation

    def _drift(self, lasted: float) -> None:
        """Kalman prediction over a window (s): ice gets less certain, and slow errors of sensors are forgotten."""
        kept, known = np.exp(-lasted / FORGOTTEN), self._known
        walks = np.zeros(known)
        walks[-1] = ICE_WALK**2 * lasted
        decay = np.concatenate([np.ones(known), np.full(self._bias.size, kept)])
        self._biases.carry(np.diag(decay))
        self._belief = predict(self._belief, decay, np.concatenate([walks, (1.0 - kept**2) * self._bias**2]))

    def _terms(
        self, taken: Mapping[str, str], found: Mapping[str, _Sample], belief: Belief, *, alone: bool = False
    ) -> Terms:
        """Innovation, derivatives and variance of the means of sensors in a window.

        Args:
            taken: sensors, each with the one whose measurements count as its own.
            found: means of the measurements by sensor.
            belief: by which they are predicted.
            alone: whether this window is looked at by itself, and not as one of many.
        """
        jacobian = np.vstack([found[name].effects for name in taken])
        apart = np.array([found[of].value - found[name].predicted for name, of in taken.items()])
        noise = [self.readings[name].noise ** 2 / found[of].number for name, of in taken.items()]
        fast = [self._fast.variance(name, alone=alone) for name in taken]
        count = len(self.carriers)
        squares = belief.mean[:count] ** 2 + np.diag(belief.covariance)[:count]
        shares = np.array([self._statics.errors.get(self._of[name], 0.0) for name in taken])
        statics = shares**2 * (jacobian[:, :count] ** 2 @ squares)
        return apart - jacobian @ belief.mean, jacobian, np.add(noise, fast) + statics

    def _consistent(self, time: float, found: Mapping[str, _Sample], alarms: list[Alarm]) -> dict[str, str]:
        """Sensors that do not contradict, each with the one whose measurements count as its own; adds alarms."""
        believed = self._biases.believed(self._belief)

        def squares(sensors: Sequence[str], to: Mapping[str, str]) -> dict[str, float]:
            """Ratio of each sensor's normalised squared innovation, given all other sensors, to its limit."""
            if not sensors:
                return {}
            of = {one: to.get(one, one) for one in sensors}
            innovation, jacobian, variance = self._terms(of, found, believed, alone=True)
            inverse = np.linalg.inv(jacobian @ believed.covariance @ jacobian.T + np.diag(variance))
            alone = (inverse @ innovation) ** 2 / np.diag(inverse) / float(scipy.special.chdtri(1, SURE))
            return dict(zip(sensors, alone.tolist(), strict=True))

        contradicting = self.doubts.contradicting([*found], squares)
        reason = self._fault_of_drive(contradicting, found, believed)
        alarms += self.doubts.judge(time, contradicting, reason)
        if contradicting == PLANT:
            return {}
        one, _, other = contradicting.partition("/")
        to = {one: other, other: one} if other else {}
        return {name: to.get(name, name) for name in found if other or name != one}

    def _fault_of_drive(self, sensor: str, found: Mapping[str, _Sample], belief: Belief) -> str:
        """Message about a drive whose force is not the predicted one, by its sensor; empty for none."""
        if sensor not in found or self._kinds[sensor] != "drive_force":
            return ""
        one = found[sensor]
        wanted = one.predicted + float(one.effects @ belief.mean)
        return fault_of_drive(self.readings[sensor], self._of[sensor], one.value, wanted)

    def _expected(self) -> dict[str, Expected]:
        """Payloads of the plan, and friction and ice of the scenario, by the names of their estimates."""
        tolerance = PLAN * self._capacity
        return {
            **{
                f"{name}/payload": Expected(float(self._plan[row]), tolerance, may_change=True, source="plan")
                for row, name in enumerate(self.carriers)
            },
            **{name: Expected(one.value, one.tolerance, may_change=False) for name, one in self._commons.items()},
        }

    def _possible(self, belief: Belief) -> Belief:
        """Belief with payloads of 0 to the capacity, and no friction or ice below 0."""
        shared = np.array([one.value for one in self._commons.values()])
        most = np.concatenate([self._capacity - self._plan, np.full(shared.size, np.inf)])
        return within(belief, -np.concatenate([self._plan, shared]), most)

    def _slow(self, belief: Belief) -> dict[str, Estimate]:
        deviations, mean = np.sqrt(np.diag(belief.covariance)), belief.mean
        found = {
            f"{name}/payload": Estimate(float(self._plan[row] + mean[row]), float(deviations[row]), "kg")
            for row, name in enumerate(self.carriers)
        }
        for row, (name, one) in enumerate(self._commons.items(), start=len(self.carriers)):
            found[name] = Estimate(float(one.value + mean[row]), float(deviations[row]), one.unit)
        return found

    def _known_effects(self, carried: Carried) -> FloatArray:
        """Derivatives by payloads and by what all carriers and towers share, in the order of the belief."""
        rolling = [carried.rolling] if "carriers/rolling" in self._commons else []
        return np.array([*carried.payloads, carried.friction, *rolling, *carried.counterweights, carried.ice])

    def _hidden(self, snapshot: Snapshot, belief: Belief) -> dict[str, Estimate]:
        """Estimated forces of towers; deviations follow from those of payloads, friction and ice."""
        found, known = {}, self._known
        for name in self._statics.towers:
            own = self._statics.of_tower(name, snapshot)
            effects = self._known_effects(own)
            force = float(np.linalg.norm(snapshot.columns.support_force[snapshot.layout.support_rows[name]]))
            variance = effects @ belief.covariance[:known, :known] @ effects + (HIDDEN * self._rest[name]) ** 2
            variance += self._waves.variance(self.time, name, force)
            value = force + float(effects @ belief.mean[:known])
            found[f"{name}/force"] = Estimate(value, float(np.sqrt(variance)), "N")
        return found

    def _exchange(self, snapshot: Snapshot) -> None:
        """Reset the payload estimates of carriers whose planned payload has changed, as in a station."""
        plan = snapshot.columns.payload[self._rows]
        changed = np.flatnonzero(plan != self._plan).tolist()
        self._plan = plan.copy()
        self._forget(changed)

    def _doubt(self, row: int) -> float:
        """Standard deviation (kg) of the payload of a carrier from its plan."""
        return (PAYLOAD if self._plan[row] > 0.0 else EMPTY) * self._capacity

    def _forget(self, rows: Sequence[int]) -> None:
        """Reset the payload estimates of some carriers to their planned payloads."""
        self._belief = reset(self._belief, rows, 0.0, [self._doubt(row) for row in rows])
        for row in rows:
            self._departures.forget(f"{self.carriers[row]}/payload")
        self._biases.forget(rows)

    def _counts(self, sensor: str, snapshot: Snapshot) -> bool:
        """Whether a sensor tells payloads at present: no carrier on the sheaves of its tower, or a steady drive."""
        if sensor not in self._of_forces:
            return False
        if self._kinds[sensor] == "drive_force":
            row = snapshot.layout.drive_rows[self._of[sensor]]
            speed, (time, before) = float(snapshot.columns.drive_speed[row]), self._speed
            if snapshot.time > time:
                self._speed = snapshot.time, speed
                return abs(speed) > 0.2 and abs(speed - before) < STARTING * (snapshot.time - time)
            return False
        return self._statics.clear(self._of[sensor], snapshot, NEAR)

    def _effects(self, sensor: str, snapshot: Snapshot) -> FloatArray:
        """Derivatives (n,) of a sensor's predicted value by payloads, friction, ice and slow sensor errors."""
        tower = self._kinds[sensor] == "load_cell"
        own = (self._statics.of_tower if tower else self._statics.of_drive)(self._of[sensor], snapshot)
        row = np.zeros(self._belief.mean.size)
        row[: self._known] = self._known_effects(own)
        row[self._known + self._of_forces.index(sensor)] = 1.0
        return row

    def _scale(self, sensor: str, of_tower: float, of_drive: float) -> float:
        """Error (N) of the model in a sensor: a share of its tower's load at rest, or of all towers' for a drive."""
        if self._kinds[sensor] == "drive_force":
            return of_drive * sum(self._rest[name] for name in self._statics.towers)
        return of_tower * self._rest[self._of[sensor]]


def _mean(samples: Sequence[_Sample]) -> _Sample:
    """Mean of the samples of one sensor."""
    value, predicted = (float(np.mean([one[part] for one in samples])) for part in (0, 1))
    return _Sample(value, predicted, np.mean([one.effects for one in samples], axis=0), len(samples))
