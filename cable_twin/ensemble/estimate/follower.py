"""Filter that follows a plant: an ensemble of twins whose slow quantities are corrected by measurements.

The middle member has the estimate; for each slow quantity there are two members, above and below it, and for each angle
of a body and its rate one member with a changed swing. All get the commands of the plant, so that their fast motion is
that of the model; after each window of measurements slow quantities and swing are corrected, and the states are blended
to those that the corrected quantities would have caused (recursive prediction error method, Ljung 1979, with finite
differences). The error of the model in each sensor is a bias that is estimated as well, and forgotten within
`FORGOTTEN`. While a vehicle passes a tower swing alone is corrected.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import deepcopy
from typing import Any

import numpy as np
import scipy  # loads `special` where it is used

from cable_twin.ensemble.ensemble import ENDS_OF_CABLE, Ensemble
from cable_twin.ensemble.estimate.beginning import Motion, has_moved, values_at, with_offsets
from cable_twin.ensemble.estimate.boarding import Boarding
from cable_twin.ensemble.estimate.correction import Correction
from cable_twin.ensemble.estimate.detectors import biases, windows
from cable_twin.ensemble.estimate.detectors.alarm import Alarm
from cable_twin.ensemble.estimate.detectors.changes import with_doubt_of_change
from cable_twin.ensemble.estimate.detectors.counterweights import Stuck, hold, mass_of, stops_of
from cable_twin.ensemble.estimate.detectors.departures import Departures, Expected
from cable_twin.ensemble.estimate.detectors.encoder_zeros import ZERO, Displaced, with_zero
from cable_twin.ensemble.estimate.detectors.sensor_faults import PLANT, Doubts
from cable_twin.ensemble.estimate.kalman import Belief, Terms, normalised_square, predict, reset, update
from cable_twin.ensemble.estimate.linear_range import any_swing, doubt_steps, loads_went_far, slopes, wind_went_far
from cable_twin.ensemble.estimate.quantities import (
    Estimate,
    Hidden,
    Reading,
    Slow,
    boarding_walk,
    boards,
    bounds,
    changes_of,
    estimates_of,
    friction_errors,
    hidden_quantities,
    payload_places,
    readings,
    slow_quantities,
    stencil,
    weights_of,
)
from cable_twin.ensemble.estimate.scatter import WAVING, Scatter, excuse
from cable_twin.ensemble.estimate.standing import Standing
from cable_twin.ensemble.estimate.swings import ANY_SWING, PRIOR, SIZE, anchored, carried, growth, swings
from cable_twin.frame.records import AppliedCommand
from cable_twin.frame.sensors import Measurement
from cable_twin.frame.snapshot import Layout
from cable_twin.mechanics.parameters import FloatArray
from cable_twin.scenario import Scenario
from cable_twin.simulation import EquilibriumError

CALMED = 300.0  # s, in which what a tower or a stop has stirred calms down
OF_TOWER = 0.1  # share of those by a tower that is passed, or a wind that was far off
WINDOW, WINDOW_OF_ROPES = 2.0, 3.0  # s, between two corrections, with one rope and with several
FIRST_WINDOW = 1.0  # s, the first one of a twin that stands, so that it is as its plant before that moves
LONGEST_WINDOW = 6.0  # s, to which it may grow while members pass from one element to the next
SETTLING = 0.15  # s after a correction, without measurements
FORGOTTEN = 100.0  # s, in which the error of the model in a sensor changes
TIMING = 0.05  # s, by which what a sensor measures may be earlier or later than in the model
NARROWEST = 0.03  # of the prior deviation, apart from which members are at least
WRONG = 5.0  # times its noise, by which a sensor may be wrong all at once, a standard deviation
RARER = 4.0  # logarithm of how much rarer that is than a change of the plant that explains as much
FASTER = 20.0  # times the usual drift of a quantity of which an alarm has told: ice that has come may go on coming
RESTS = 8  # at most, that are tried for one window


class Follower:
    """Ensemble filter by which a twin follows a plant with carriages.

    Attributes:
        window: s, between two corrections.
        slow: quantities that are estimated.
        readings: sensors that are read, by name.
        hidden: estimated quantities that no sensor need measure.
        doubts: detector of faulty sensors.
        zeros: what the encoders of carriages, by name, read more than their places (m), where that was found.
        needs_rest: whether it has to begin at a plant that stands: under way payload, ice and friction have effects too
            much alike to be told apart, unless they are known from before.

    Args:
        scenario: of the twin; its `sensors` are those of the plant.
        threads: of the ensemble.
    """

    def __init__(self, scenario: Scenario, threads: int | None = None) -> None:
        self.slow = slow_quantities(scenario)
        apart = Layout.of(scenario, ENDS_OF_CABLE)
        self._scenario, self.window = scenario, WINDOW if len(scenario.cables) == 1 else WINDOW_OF_ROPES
        self._fast = swings(apart)
        self._first = 2 * len(self.slow) + 1  # member with the first swing
        self._displaced = Displaced(scenario, self._first + len(self._fast), apart)
        members = self._first + len(self._fast) + len(self._displaced)
        self._ensemble = Ensemble(scenario, members, threads=threads, progress=False)
        start = self._ensemble.snapshot(0)
        self._layout = start.layout
        forces = start.columns.support_force
        scale = {name: float(np.linalg.norm(forces[row])) for name, row in start.layout.support_rows.items()}
        self.readings: dict[str, Reading] = readings(scenario, start.layout, scale)
        self._towers = np.array([one.position[0] for one in scenario.towers.values()])
        self._tracks = start.layout.places.joint_position[:, 0].astype(np.intp)
        self.hidden: tuple[Hidden, ...] = hidden_quantities(scenario, start.layout)
        self._deviation = np.array([one.deviation for one in self.slow])
        self._held: dict[str, Estimate] = {}  # counterweights that are stuck: what is said of their masses
        self._stuck = Stuck()  # counterweight to be held
        self._astray: dict[str, float] = {}  # variances by unit in a contradicting plant
        self.doubts, self._scatter = Doubts(self.readings), Scatter(tuple(self.readings))
        errors = np.array([one.error for one in self.readings.values()])
        self._usual_errors, self._of_friction = errors, friction_errors(scenario, self.readings, scale)
        self._standing = Standing(scenario, self.readings, start.layout)
        self._errors, self._rows_of = errors, {name: row for row, name in enumerate(self.readings)}
        mean = np.concatenate([[one.mean for one in self.slow], np.zeros(len(self._fast) + errors.size)])
        deviations = [self._deviation, np.full(len(self._fast), PRIOR), errors]
        self._belief = Belief(mean, np.diag(np.concatenate(deviations) ** 2))
        cells = [(name, one.of) for name, one in scenario.sensors.items() if one.kind == "load_cell"]
        wrong = {name: biases.WRONG * scale[of] for name, of in cells} | dict.fromkeys(self._displaced.encoders, ZERO)
        self._biases = biases.Biases(wrong, mean.size, recent=0, kept=self._displaced.encoders)
        self._biases.expect(dict(zip(self.readings, errors.tolist(), strict=True)))
        self._boarding = Boarding(self._deviation, len(self._fast), payload_places(self.slow, self._layout))
        self._points, self._at_tower, self._stirred = self._stencil(self._belief), False, 0.0
        self._motion: dict[str, Any] = {}  # places and speeds of vehicles at the last beginning, by key
        self._change(rest=True)
        self._swing()
        self.zeros: dict[str, float] = {}  # m, by carriage
        self._rows: list[windows.Row] = []
        self._before: tuple[float, FloatArray] | None = None
        self._since, self._from, self._zero = 0.0, 0.0, 0.0
        self._shaken = 0.0  # s, until when the plant stops all at once
        self._stands, self._begun = True, 0.0  # at rest, as no command has changed anything since the beginning, s
        self.needs_rest, self._departures = True, Departures()
        self._expected = {one.name: Expected(one.plan, one.tolerance, bool(one.payload_of)) for one in self.slow}
        self._alarms: list[Alarm] = []  # of samples, to be told with the next correction

    @property
    def left_out(self) -> dict[str, Alarm]:
        """Sensors that are left out as faulty, each with its alarm."""
        return self.doubts.left_out

    @property
    def learned(self) -> Any:
        """Estimates, alarms and faulty sensors so far, to restore them after the twin has begun at a wrong place."""
        own = self._belief, self.needs_rest, self._departures, self._biases, self.slow, self._deviation, self._held
        return deepcopy((*own, self.zeros)), self.doubts.known

    @learned.setter
    def learned(self, learned: Any) -> None:
        (*own, self.zeros), self.doubts.known = learned
        self._belief, self.needs_rest, self._departures, self._biases, self.slow, self._deviation, self._held = own

    @property
    def time(self) -> float:
        """Simulated time (s) of the twin."""
        return self._zero + float(self._ensemble.times[0])

    def begin_at(self, time: float, motion: Motion) -> None:
        """Restart at a time (s) from rest or steady motion; the estimates of slow quantities are kept.

        Args:
            time: s, from which the twin goes on.
            motion: place (m) and speed (m/s) of carriages and drives; others begin where they do in the scenario.

        Raises:
            ScenarioError, EquilibriumError, ValueError: vehicles cannot be there; one line. The twin stays as it was.
        """
        motion = {name: (place - self.zeros.get(name, 0.0), speed) for name, (place, speed) in motion.items()}
        values, offsets = values_at(self._scenario, motion)
        before = self._motion, self._points
        self._motion, self._points = values, self._stencil(self._belief)
        try:
            self._change(rest=True)
        except (EquilibriumError, ValueError):
            self._motion, self._points = before
            raise
        self.readings |= with_offsets(self.readings, self._scenario, offsets | self.zeros)
        under_way = any(speed != 0.0 for _, speed in motion.values())
        fast = [*range(len(self.slow), len(self.slow) + len(self._fast))]
        self._belief = reset(self._belief, fast, 0.0, ANY_SWING if under_way else PRIOR)
        self._expect(self._of_friction if has_moved(self._scenario, motion) else 0.0 * self._of_friction)
        self._biases.forget(fast)
        self._rows, self._before, self._zero = [], None, time
        self._since, self._from, self._at_tower = time, time, False
        self._stands, self._begun, self._stirred = not under_way, time, float(under_way)
        if under_way:  # its haul rope swings, and that of the twin does not
            self.doubts.expect_waves(time + WAVING)
        self.needs_rest = self.needs_rest and under_way
        self.doubts.forget()
        self._boarding.forget()
        self._swing()

    def _expect(self, friction: FloatArray) -> None:
        """Doubt sensors by standard deviations (sensors,), as towers hold the rope by an unknown friction."""
        self._errors = np.hypot(self._usual_errors, friction + self._standing.errors)
        self._biases.expect(dict(zip(self.readings, self._errors.tolist(), strict=True)))
        mean, covariance = self._belief.mean, self._belief.covariance.copy()
        of_sensors = range(mean.size - self._errors.size, mean.size)
        covariance[of_sensors, of_sensors] = np.maximum(np.diag(covariance)[of_sensors], self._errors**2)
        self._belief = Belief(mean, covariance)

    def _roll(self) -> None:
        """Forget how carriages were held that roll from this window on, and what their drives told in their stand."""
        self._scatter.stir(self._standing.held)
        rows = [self._belief.mean.size - self._errors.size + row for row in self._standing.rows]
        self._belief = reset(self._belief, rows, 0.0, self._usual_errors[self._standing.rows])
        self._biases.forget(rows)
        self._expect(self._of_friction)
        self._rows = [row for row in self._rows if self._standing.tells(row.sensor, row.numbers[0])]

    def doubt_swing(self, until: float = 0.0, waves: float = 1.0) -> None:
        """Expect any swing, and waves by the share of those of a stop; as at a tower until a time (s)."""
        self._shaken, self._stands, self._stirred = until, False, max(waves, self._stirred)
        self._belief = self._belief._replace(covariance=any_swing(self._belief, len(self.slow), len(self._fast)))
        self.doubts.expect_waves(max(until, self.time) + WAVING)

    def close(self) -> None:
        """End the threads of the ensemble."""
        self._ensemble.close()

    def command(self, applied: AppliedCommand) -> None:
        """Apply a command of the plant to the twin, at the time of the command.

        Raises:
            CommandError: the twin refuses it.
        """
        self._advance(applied.time)
        if applied.command.kind != "payload":  # of a plant that is simulated; it is estimated
            self._ensemble.apply(applied.command)
        if applied.command.kind not in ("speed", "force") or any(applied.command.values.values()):
            self._stands = False

    def take(self, time: float, measurements: Sequence[Measurement]) -> Correction | None:
        """Process the measurements of one time (s), in the order of time; returns a correction at the end of a window.

        Without any measurement in a window the twin goes on by its model, with growing variances.
        """
        self._advance(time)
        numbers = self._ensemble.numbers()
        unlike = self._at_tower or bool(self._astray) or self._boarding.stirs
        self._alarms += self.doubts.of_samples(time, measurements, numbers, unlike, self._stands)
        self._rows = [row for row in self._rows if row.sensor not in self.left_out]
        then, before = self._before or (time, numbers[0])
        rates = np.abs(numbers[0] - before) / max(time - then, 1e-3)
        self._before = time, numbers[0].copy()
        if time > self._from + SETTLING or self._from == 0.0:
            for one in measurements:
                if not (sensor := self.doubts.taken(one.sensor)):
                    continue
                reading = self.readings[sensor]
                value = reading.measured(one)
                variance = self._variance(reading) + (TIMING * float(np.linalg.norm(rates[reading.places]))) ** 2
                self._rows.append(windows.Row(sensor, value, reading.of(numbers), variance, numbers))
        if (windows.passes_a_tower(numbers[0, self._tracks], self._towers) or time < self._shaken) != self._at_tower:
            self._at_tower = not self._at_tower
            self._stirred = max(self._stirred, OF_TOWER)
            self._rows, self._since, self._from = [], time, time
            if not self._at_tower:
                for member in (*range(1, self._first), *self._displaced.members):
                    self._ensemble.swing(member, anchored(self._fast, numbers, member))
            return None
        lasted = time - self._since
        window = FIRST_WINDOW if self._stands and self._since == self._begun else self.window
        if lasted < window - 1e-6 or (lasted < LONGEST_WINDOW and not self._ensemble.alike):
            return None
        alarms, self._alarms = self._alarms, []
        correction = self._correct(time, numbers, alarms)
        self.doubts.corrected(numbers[0], self._ensemble.numbers()[0])
        return correction

    def place_of(self, sensor: str) -> float:
        """Present reading (m) of an encoder in the twin."""
        return self.readings[sensor].in_frame(self._ensemble.numbers()[0])

    def _advance(self, time: float) -> None:
        self._ensemble.advance_to(max(time, self.time) - self._zero)

    def _correct(self, time: float, numbers: FloatArray, alarms: list[Alarm]) -> Correction:
        """Correct slow quantities and states by the measurements of a window."""
        if self._stands and self._rest_where_believed(time):
            numbers = self._ensemble.numbers()
        if self._standing.rolls(numbers[0]):
            self._roll()
        boarding = self._take_boarding(time, numbers)
        of_swing = [row for row in self._rows if self.readings[row.sensor].unit == "rad"]
        used = of_swing if self._at_tower else [] if boarding else self._consistent(time, alarms)
        innovation = 1.0
        if used:
            terms, before = self._linear(used), self._belief
            innovation = normalised_square(*terms, before.covariance) / len(used)
            self._belief = update(before, *terms)
            self._note_scatter(time - self._since, before)  # it counts in this window already
            self._belief = before
            terms = self._linear(used)
            self._belief = update(before, *terms)
            far = wind_went_far(self.slow, self._points[0], before, self._belief)
            if not self._held:  # else what its towers hold is as much as an error of a cell
                elsewhere = {} if self._at_tower else self._displaced.effects(used)
                self._biases.note([row.sensor for row in used], *terms, before, not far, elsewhere)
            if far:
                swinging = any_swing(before, len(self.slow), len(self._fast))
                self._belief = self._belief._replace(covariance=swinging)
                self._stirred = self._stirred if self._stands else max(self._stirred, OF_TOWER)
            else:
                self._belief = doubt_steps(self.slow, self._points[0], self._belief)
        sure = not (self._astray or self._held or boarding)  # else the plant may explain as much as a wrong cell
        alarms += self._find_zero(time) if sure else []
        self._belief, wrong = self._biases.judge(time, self._belief, self.doubts, sure)
        lasted, self._since, self._from = time - self._since, time, time
        believed = self._biases.believed(self._belief)
        hidden, slow = self._hidden(numbers, believed), estimates_of(self.slow, believed) | self._held
        agreed = estimates_of(self.slow, self._biases.agreed(self._belief)) | self._held
        expected = {name: one for name, one in self._expected.items() if not (boarding and one.may_change)}
        alarms += [*wrong, *self._departures.alarms(time, slow, expected, agreed)]
        self._go_on(lasted, numbers)
        return Correction(time, slow, hidden, innovation, tuple(alarms))

    def _find_zero(self, time: float) -> list[Alarm]:
        """Take an encoder whose zero is surely elsewhere with that offset from now on; returns the alarm about it."""
        name, size = self._biases.surely()
        if name not in self._displaced.encoders:
            return []
        self.readings[name], said = with_zero(self.readings[name], size, self._biases.deviation_of(name))
        self._belief = self._biases.without(self._belief, name)
        self.zeros[self._displaced.encoders[name]] = self.readings[name].offset
        self.doubts.forget()
        return [Alarm(time, said)]

    def _take_boarding(self, time: float, numbers: FloatArray) -> bool:
        """Estimate payloads alone while they change in stations, by (members, n) values; False while none does.

        Towers hold the rope by their friction then, so that members cannot rest anew around what a window says.
        """
        station, before = (self._scenario, self._layout, numbers[0], self._boarding.slow), self._boarding.changing
        rows = [row for row, one in enumerate(self.slow) if boards(one, *station)]
        self._boarding.note_loads(self._points, self._belief, numbers)
        if not rows or self._at_tower:
            self._boarding.forget()
        if not rows or self._at_tower or not self._rows:
            return False
        terms, contradicted = self._linear(self._rows), bool(self._contradicting()[1])
        if self._boarding.look(rows, terms, self._belief, self._biases, contradicted):
            self._belief, self._biases = self._boarding.before
            self._stands, self._astray = False, {}
            self._standing.stir()
            self._expect(self._of_friction)
            self.doubts.forget()
        if not (self._boarding.changing or before):
            return False
        if not self._boarding.changing:  # any more
            self._scatter.expect()
            self.doubts.expect_waves(time + WAVING)
            self._stirred = max(self._stirred, OF_TOWER * self._boarding.stirred(self._points[0]))
            self._rows = [row._replace(variance=self._variance(self.readings[row.sensor])) for row in self._rows]
        self._belief.mean[rows] = self._points[0, rows]  # of the belief from before
        self._belief = self._boarding.doubted(rows, self._belief)
        taken, doubted = (self._linear(self._rows), [row.sensor for row in self._rows]), self._belief
        self._belief = self._boarding.take(*taken, self._belief, self._biases)
        self._note_scatter(time - self._since, doubted)
        return True

    def _rest_where_believed(self, time: float) -> bool:
        """Restart members of a standing plant at rests in a much different wind or with other payloads; True if so.

        At rest the measurements of a window hold at any time, so that they can correct the restarted members again
        (iterated Kalman filter, Bell and Cathey 1993). Unlike a twin in which a wind sets in, one at rest in that wind
        does not swing; members blended to a payload far from theirs would not be at rest either, by the second order of
        its effects. A sensor that contradicts the rest which it has led to is not asked again.
        """
        first, anew, out = self._points, False, ""
        while self._rest_without(time, out):
            anew, wrong = True, self._contradicting()[1]
            if wrong in ("", out):
                break
            self._rest(time, first)  # it was not the wind
            if out or wrong not in self.readings:
                break
            out = wrong
        return anew

    def _rest_without(self, time: float, sensor: str) -> bool:
        """Restart all members where a window without a sensor has them; False where that is no restart."""
        anew, before, rows = False, self._belief, [row for row in self._rows if row.sensor != sensor]
        for _ in range(RESTS if rows else 0):
            found = update(before, *self._linear(rows))
            moved = self.slow, self._points[0], before, found
            if not wind_went_far(*moved) and not loads_went_far(*moved):
                break
            if not self._rest(time, self._stencil(before._replace(mean=found.mean))):
                break
            anew, rows = True, [row for row in self._rows if row.sensor != sensor]
        return anew

    def _rest(self, time: float, points: FloatArray) -> bool:
        """Restart all members at static equilibria for given values of the slow quantities; False if there are none."""
        before, self._points = self._points, points
        try:
            self._change(rest=True)
        except (EquilibriumError, ValueError):
            self._points = before
            return False
        self._zero = time
        self._swing()
        numbers = self._ensemble.numbers()
        self._rows = [
            row._replace(predicted=self.readings[row.sensor].of(numbers), numbers=numbers) for row in self._rows
        ]
        return True

    def _go_on(self, lasted: float, numbers: FloatArray) -> None:
        """Begin the next window: predict the belief over the last one (s), and blend members to it if all are alike."""
        count, swinging = len(self.slow), len(self._fast)
        kept = np.exp(-lasted / FORGOTTEN)
        self._stirred = max(OF_TOWER * self._at_tower, self._stirred * float(np.exp(-lasted / CALMED)))
        decay = np.concatenate([np.ones(count + swinging), np.full(self._errors.size, kept)])
        walks = np.array([self._walk(one, numbers[0]) for one in self.slow])
        gained = growth(self._fast, lasted, self._stirred, self._at_tower)
        added = np.concatenate([walks**2 * lasted, gained, (1.0 - kept**2) * self._errors**2])
        self._rows = []
        if self._ensemble.alike:
            wanted, fast = self._stencil(self._belief), slice(count, count + swinging)
            blended, wanted = self._boarding.apart(self._points, wanted, *bounds(self.slow))
            weights = weights_of(self._points, blended, self._belief.mean[fast] / SIZE)
            self._ensemble.blend(self._displaced.along(weights))
            self._points = wanted
            moved = np.eye(decay.size)
            moved[fast, fast] = carried(self._fast, numbers, self._first)
            mean = self._belief.mean.copy()
            self._biases.keep_within(*bounds(self.slow), self._belief.mean)
            self._biases.carry(moved)
            mean[:count], mean[fast] = wanted[0], 0.0
            self._belief = Belief(mean, moved @ self._belief.covariance @ moved.T)
            self._change()
            for row in self._boarding.rows:
                self._ensemble.load(self.slow[row].payload_of, self._member_points()[:, row])
            self._swing()
            if self._stuck.support:
                self._hold()
        else:
            added[count : count + swinging] = 0.0  # the members still have the swings of the window before
        self._biases.carry(np.diag(decay))
        self._belief = predict(self._belief, decay, added)

    def _hold(self) -> None:
        """Keep a stuck counterweight at its travel from now on, which is estimated instead of its mass."""
        (support, _, tension), self._stuck = self._stuck, Stuck()
        row = next(row for row, one in enumerate(self.slow) if one.name == mass_of(support))
        place = self._layout.places.support_travel[self._layout.support_rows[support]]
        mass, travels, sides = self.slow[row], self._ensemble.numbers()[:, int(place)], (1 + 2 * row, 2 + 2 * row)
        held = hold(self._ensemble, mass, self._points[:, row], travels, sides, tension / self._scenario.gravity)
        if held is None:
            return
        self._belief, self._deviation[row] = reset(self._belief, [row], held.mean, held.deviation), held.deviation
        self._expect(self._of_friction)
        self._biases.forget(range(self._belief.mean.size))  # they held for a counterweight that moves
        self.slow = (*self.slow[:row], held, *self.slow[row + 1 :])
        self._held[mass.name] = Estimate(mass.mean, mass.deviation, mass.unit)
        self._change()
        self._astray, self._stirred = {}, 1.0
        self.doubts.forget()
        self.doubts.expect_waves()
        self._boarding.forget()

    def _swing(self) -> None:
        """Rotate bodies in the last members, each by the unit swing of one angle or rate."""
        for number, one in enumerate(self._fast):
            self._ensemble.swing(self._first + number, [one.turn(SIZE)])

    def _consistent(self, time: float, alarms: list[Alarm]) -> list[windows.Row]:
        """Rows of a window without a sensor that contradicts all others; adds an alarm for one that keeps doing so."""
        self._doubt_what_changed()
        of, contradicting = self._contradicting()
        stuck = windows.stuck_by(self._scenario, of, self._held) if contradicting == PLANT else Stuck()
        reason = stuck.reason or windows.fault_of(self._scenario, self.readings, of.get(contradicting, []))
        told = self.doubts.judge(time, contradicting, reason)
        alarms += told
        self._astray = {}
        if contradicting == PLANT:
            self._stuck = stuck if told else self._stuck
            self._astray = windows.contradiction(self.readings, of)
            return []
        one, _, other = contradicting.partition("/")
        if not other:
            return [row for name in of if name != one for row in windows.excused(of[name], self._linear, self._belief)]
        to = {one: other, other: one}
        return [self._read_as(row, to[row.sensor]) if row.sensor in to else row for row in self._rows]

    def _doubt_what_changed(self) -> None:
        """Enlarge the variance of a slow quantity whose sudden change explains a window better than any sensor's."""
        if not self._rows:
            return
        sizes = changes_of(self.slow, self._scenario, self._layout, self._rows[-1].numbers[0])
        wrong, terms = WRONG * np.array([one.noise for one in self.readings.values()]), self._linear(self._rows)
        self._belief, found = with_doubt_of_change(self._belief, terms, sizes, wrong, RARER)
        if found >= 0 and (name := self.slow[found].name) not in self._held:
            self._departures.changed(self.time, name, float(self._biases.agreed(self._belief).mean[found]))

    def _walk(self, one: Slow, numbers: FloatArray) -> float:
        """Standard deviation of what a slow quantity may change by in a second, by the values (n,) of a frame."""
        walk = one.walk * (FASTER if self._departures.told(self.time, one.name) else 1.0)
        return boarding_walk(one, self._scenario, self._layout, numbers) or walk

    def _contradicting(self) -> tuple[dict[str, list[windows.Row]], str]:
        """Measurements of a window by sensor, and the sensor or swapped pair of sensors that contradicts all others."""
        of = {name: [row for row in self._rows if row.sensor == name] for name in self._rows_of}

        def squares(sensors: Sequence[str], to: Mapping[str, str]) -> dict[str, float]:
            found = {}
            for sensor in sensors:
                rows = [self._read_as(row, to[sensor]) for row in of[sensor]] if sensor in to else of[sensor]
                limit = float(scipy.special.chdtri(len(rows), windows.SURE))
                innovation, jacobian, variance = self._linear(rows)
                variance = variance + excuse(innovation, variance)
                found[sensor] = normalised_square(innovation, jacobian, variance, self._belief.covariance) / limit
            return found

        return of, self.doubts.contradicting([name for name, rows in of.items() if rows], squares)

    def _variance(self, reading: Reading) -> float:
        """Variance of a sample: noise of the sensor and usual fast error of the model."""
        stirred = 0.0 if self._standing.doubts(reading.name) else self._stirred
        return reading.noise**2 + reading.fast.variance(stirred, self._at_tower)

    def _unexplained(self, unit: str) -> float:
        """Variance of a hidden quantity at one moment by waves: what shakes a sensor of its unit changes it as much."""
        alike = [name for name, one in self.readings.items() if one.unit == unit]
        return max(map(self._scatter.unexplained, alike), default=0.0)

    def _note_scatter(self, lasted: float, before: Belief) -> None:
        """Compare a window's scatter about the model, corrected and before, with what is assumed."""
        if self._rows and not self._at_tower:
            sensors, assumed = [row.sensor for row in self._rows], np.array([row.variance for row in self._rows])
            after, jacobian, _ = self._linear(self._rows)
            apart = after + jacobian @ (self._belief.mean - before.mean)
            self._scatter.note(lasted, sensors, after, assumed, apart)

    def _read_as(self, row: windows.Row, sensor: str) -> windows.Row:
        """Row of a measurement with the prediction and variance of another sensor, to test for swapped sensors."""
        reading = self.readings[sensor]
        return row._replace(sensor=sensor, predicted=reading.of(row.numbers), variance=self._variance(reading))

    def _linear(self, rows: Sequence[windows.Row]) -> Terms:
        """Innovation (m,), Jacobian (m, n) and noise variance (m,) of the measurements in rows of a window."""
        count = len(self.slow) + len(self._fast)
        predicted = np.array([row.predicted[: self._first + len(self._fast)] for row in rows])
        jacobian = np.zeros((len(rows), self._belief.mean.size))
        waving = [row.sensor if self.readings[row.sensor].waving else "" for row in rows]
        jacobian[:, :count] = slopes(self._points, predicted, waving)
        if self._at_tower:
            jacobian[:, : len(self.slow)] = 0.0
        columns = [count + self._rows_of[row.sensor] for row in rows]
        jacobian[range(len(rows)), columns] = 1.0
        innovation = np.array([row.value for row in rows]) - predicted[:, 0] - jacobian @ self._pending(self._belief)
        return innovation, jacobian, np.array([row.variance + self._scatter.lasting(row.sensor) for row in rows])

    def _pending(self, belief: Belief) -> FloatArray:
        """Differences (n,) of a belief from the quantities of the middle member."""
        mean = belief.mean.copy()
        mean[: len(self.slow)] -= self._points[0]
        return mean

    def _hidden(self, numbers: FloatArray, belief: Belief) -> dict[str, Estimate]:
        """Estimates of unmeasured quantities; deviations follow from the slow quantities and the model's error."""
        count, found = len(self.slow) + len(self._fast), {}
        shift, covariance = self._pending(belief)[:count], belief.covariance[:count, :count]
        for one in self.hidden:
            values = one.of(numbers[: self._first + len(self._fast)])
            by_each = slopes(self._points, values[None, :])[0]
            value = float(values[0] + by_each @ shift)
            variance = by_each @ covariance @ by_each + one.error(value).variance(self._stirred, self._at_tower)
            variance += self._unexplained(one.unit) + self._astray.get(one.unit, 0.0)
            found[one.name] = Estimate(value, float(np.sqrt(variance)), one.unit)
        return found

    def _stencil(self, belief: Belief) -> FloatArray:
        count = len(self.slow)
        deviations = np.sqrt(np.diag(belief.covariance)[:count])
        return stencil(belief.mean[:count], np.maximum(deviations, NARROWEST * self._deviation), self.slow)

    def _member_points(self) -> FloatArray:
        """Stencil points (members, n) of the slow quantities, those of all further members at the middle one."""
        return np.vstack([self._points, np.tile(self._points[0], (len(self._ensemble) - self._first, 1))])

    def _change(self, rest: bool = False) -> None:
        """Set the slow quantities of each member to its stencil point; payloads that change are loaded."""
        points, loaded = self._member_points(), self._boarding.rows
        values = {
            key: [one.value_at(value) for value in points[:, row].tolist()]
            for row, one in enumerate(self.slow)
            for key in (one.key, *one.also)
            if row not in loaded
        }
        each = {key: [value] * len(points) for key, value in {**stops_of(self._scenario), **self._motion}.items()}
        each |= self._displaced.places(self._motion)
        self._ensemble.change({**values, **each} if rest else values, rest=rest)
