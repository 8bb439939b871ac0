"""Detection of faulty sensors: stuck, jumping, of another unit, swapped, or in contradiction to all others."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from cable_twin.basics.units import with_unit
from cable_twin.ensemble.estimate.detectors.alarm import Alarm
from cable_twin.ensemble.estimate.detectors.jumps import FASTEST, Jumps, Leaps
from cable_twin.ensemble.estimate.quantities import LEAST_FORCE, Reading
from cable_twin.frame.sensors import Measurement
from cable_twin.mechanics.parameters import FloatArray

THOUSANDFOLD = 300.0, 3000.0  # times a prediction that a sensor with a wrong unit reads, or the inverse of that
PLANT = "plant"  # instead of a sensor: several contradict
SUSPECT_WINDOWS = 3  # in which it has to, one after the other, before it is left out
STUCK_SAMPLES = 30  # equal ones of a sensor with noise
STANDING_SAMPLES = 5  # equal ones of an encoder, which before was faster than
LEAPT_SAMPLES, ALIKE = 5, 0.3  # samples after a leap, and share of it by which these may differ
LARGEST_LEAP = 20.0  # m, from which on the plant itself is taken to be elsewhere
UNIT_SAMPLES = 5  # of another unit, one after the other: one alone may be near 0 by chance
SUDDEN = 1.0  # m/s, from which no drive stops within a sample
WELL_ABOVE = 30.0  # times its noise, from which on a prediction tells the unit of a sensor
SURELY = 2.0 / 3.0  # of the expected value in all members, from which on its sign is sure: three deviations off
LOST = 0.1  # share of the force of a drive, from which on its sensor is not the only one that may be at fault


# squares of the innovations by sensor, over their limit; some sensors may be taken for others
Squares = Callable[[Sequence[str], Mapping[str, str]], Mapping[str, float]]


def fault_of_drive(reading: Reading, drive: str, got: float, wanted: float) -> str:
    """Message about a drive whose force (N) is not the predicted one, read by a sensor; empty for a small difference.

    Args:
        reading: of the sensor of its force.
        drive: name.
        got: N, mean measured force.
        wanted: N, mean predicted force.
    """
    if abs(wanted) < WELL_ABOVE * reading.noise or abs(got / wanted - 1.0) < LOST:
        return ""
    share = f"{100.0 * abs(got / wanted - 1.0):.0f} % {'more' if abs(got) > abs(wanted) else 'less'} force"
    return (
        f"the drive of {drive} takes {share} than payload and friction need, {got / 1e3:.1f} instead of "
        f"{wanted / 1e3:.1f} kN, or its sensor {reading.name} is wrong, which is left out"
    )


def negative(reading: Reading) -> str:
    """Message about a sensor whose sign is the other one."""
    return f"sensor {reading.name} reads the negative of what is expected: sign? It is left out"


class Swap(NamedTuple):
    """Other sensor, for which one is taken, and the alarm that says so."""

    other: str
    alarm: Alarm


class Doubts:
    """Detector of faulty sensors of a plant: stuck, jumping, of another unit, swapped, or contradicting the others.

    Attributes:
        left_out: sensors that are left out, each with its alarm, until `readmit`.
        mistrusted: sensors of which it was said that they seem to be wrong.

    Args:
        readings: of the sensors by name.
    """

    def __init__(self, readings: Mapping[str, Reading]) -> None:
        self._readings = readings
        self._suspected: dict[str, int] = {}
        self._last: dict[str, tuple[float, int]] = {}  # value and count of equal samples
        self._moved: dict[str, tuple[float, float, float]] = {}  # time, place, speed of the last move of an encoder
        self._rough_until = -np.inf  # s, until when the plant has waves that its twin does not have
        self._jumps = {name: Jumps(one.noise) for name, one in readings.items() if one.unit == "m"}
        self._leaps = {name: Leaps(one.noise) for name, one in readings.items() if one.unit == "m"}
        self._away: dict[str, list[float]] = {}  # m, of samples one after the other, from where each encoder may be
        self._of_other_units: dict[str, int] = {}  # count of samples one after the other
        self._negatives: dict[str, int] = {}  # the same with the other sign
        self._swaps: dict[str, Swap] = {}  # of sensors whose measurements have the name of another one
        self.left_out: dict[str, Alarm] = {}
        self.mistrusted: set[str] = set()
        self._revoked: set[Alarm] = set()  # of sensors that count again, or as themselves

    def taken(self, sensor: str) -> str:
        """Sensor that a measurement named `sensor` counts for, the other one if swapped; empty if left out."""
        if sensor in self.left_out or sensor not in self._readings:
            return ""
        return self._swaps[sensor].other if sensor in self._swaps else sensor

    @property
    def known(self) -> tuple[dict[str, Alarm], dict[str, Swap]]:
        """Sensors that are left out, and those that are swapped, for `known` to be set to later."""
        return dict(self.left_out), dict(self._swaps)

    @known.setter
    def known(self, known: tuple[dict[str, Alarm], dict[str, Swap]]) -> None:
        left_out, swaps = known
        self.left_out = {name: one for name, one in left_out.items() if one not in self._revoked}
        self._swaps = {name: one for name, one in swaps.items() if one.alarm not in self._revoked}

    @property
    def swapped(self) -> Mapping[str, str]:
        """Sensors that are taken for each other, each with the other one."""
        return {name: one.other for name, one in self._swaps.items()}

    @property
    def suspects(self) -> bool:
        """Whether a sensor, or the plant, contradicted in the last window."""
        return bool(self._suspected)

    def forget(self) -> None:
        """Forget which sensors are suspected, as at a restart; sensors already left out stay so."""
        self._suspected.clear()
        self._away.clear()
        for leaps in self._leaps.values():
            leaps.clear()
        self._forget_places()

    def expect_waves(self, until: float = np.inf) -> None:
        """Tell larger jumps of encoders alone until a time (s), as the plant has waves that its twin does not have."""
        self._rough_until = max(self._rough_until, until)

    def of_samples(
        self,
        time: float,
        measurements: Sequence[Measurement],
        numbers: FloatArray,
        unlike: bool = False,
        stands: bool = False,
    ) -> list[Alarm]:
        """Alarms for sensors that are stuck, jump or have a wrong unit, and which are then left out.

        Args:
            time: s.
            measurements: of that time.
            numbers: (n,) frame of the twin, or (members, n) frames, the first one that of the estimate.
            unlike: whether the plant moves otherwise than its twin, as at a tower; no jump is told then.
            stands: whether nothing has moved yet, so that the force of a drive has the sign of the slope.
        """
        known = [one for one in measurements if one.sensor in self._readings]
        alarms, numbers = self._negative(time, known, numbers) if stands else [], np.atleast_2d(numbers)[0]
        alarms += self._stuck(time, known, numbers) + self._of_another_unit(time, known, numbers)
        alarms += self._leapt(time, known)
        if unlike:
            self._forget_places()
            return alarms
        return alarms + self._jumped(time, known, numbers)

    def corrected(self, before: FloatArray, after: FloatArray) -> None:
        """Note that a correction has changed the frame (n,) of the twin, which is no jump of an encoder."""
        for name, jumps in self._jumps.items():
            reading = self._readings[name]
            jumps.shift(reading.in_frame(after) - reading.in_frame(before))

    def _forget_places(self) -> None:
        for jumps in self._jumps.values():
            jumps.forget()

    def contradicting(self, sensors: Sequence[str], squares: Squares) -> str:
        """Sensor that contradicts all others; ONE/OTHER for two swapped ones, `PLANT` for several, empty for none."""
        found = squares(sensors, {})
        worst = max(found, key=lambda name: found[name], default="")
        if not worst or found[worst] <= 1.0:
            return ""
        rest = squares([name for name in sensors if name != worst], {})
        if max(rest.values(), default=0.0) <= 1.0:
            return worst
        for other in sensors:
            alike = other != worst and self._readings[other].unit == self._readings[worst].unit
            if alike and max(squares(sensors, {worst: other, other: worst}).values()) <= 1.0:
                one, two = sorted((worst, other))
                return f"{one}/{two}"
        return PLANT

    def judge(self, time: float, contradicting: str, reason: str = "") -> list[Alarm]:
        """Alarm for a sensor, two swapped ones, or the plant, that contradicts in several successive windows.

        Args:
            time: s.
            contradicting: result of the method `contradicting`.
            reason: fault of the plant that explains the contradiction; empty for none.
        """
        self._suspected = {contradicting: self._suspected.get(contradicting, 0) + 1} if contradicting else {}
        if self._suspected.get(contradicting) != SUSPECT_WINDOWS:
            return []
        if contradicting == PLANT:
            return [Alarm(time, reason or "several sensors contradict the model: the plant is not as it is described")]
        if "/" in contradicting:
            return [self._swap(time, *contradicting.split("/"))]
        text = reason or f"sensor {contradicting} contradicts all others and is left out"
        return [self.leave_out(contradicting, time, text)]

    def leave_out(self, sensor: str, time: float, reason: str) -> Alarm:
        """Leave out a sensor from a time (s) on; returns the alarm with the reason."""
        self.left_out[sensor] = alarm = Alarm(time, reason)
        return alarm

    def _swap(self, time: float, one: str, other: str) -> Alarm:
        """Take two sensors for each other from a time (s) on, or again for themselves; returns the alarm."""
        if self.swapped.get(one) == other:
            self._take_for_itself(one)
            return Alarm(time, f"sensors {one} and {other} are swapped no more, and are taken for themselves again")
        for sensor in (one, other):
            self._take_for_itself(sensor)
        alarm = Alarm(time, f"sensors {one} and {other} are swapped, and are taken for each other")
        self._swaps |= {one: Swap(other, alarm), other: Swap(one, alarm)}
        return alarm

    def _take_for_itself(self, sensor: str) -> None:
        """Take a sensor for itself, and the other one that it was taken for, if any."""
        if sensor in self._swaps:
            for name in (sensor, self._swaps[sensor].other):
                self._revoked.add(self._swaps.pop(name).alarm)

    def readmit(self, sensor: str) -> None:
        """Let a sensor that is left out or swapped count again, also where `known` is set to what was known before."""
        names = [sensor, *([self._swaps[sensor].other] if sensor in self._swaps else [])]
        self._take_for_itself(sensor)
        if sensor in self.left_out:
            self._revoked.add(self.left_out.pop(sensor))
        for name in names:
            self._forget(name)

    def _forget(self, sensor: str) -> None:
        """Forget what was doubted of a sensor, and its samples."""
        self.mistrusted.discard(sensor)
        for kept in (self._last, self._moved, self._away, self._of_other_units, self._negatives):
            kept.pop(sensor, None)  # type: ignore[attr-defined]
        if sensor in self._jumps:
            self._jumps[sensor].forget()
            self._leaps[sensor].clear()

    def _read(self, measurements: Sequence[Measurement]) -> Iterator[tuple[Measurement, Reading]]:
        """Measurements by sensors that are not left out, each with the quantity that its sensor reads."""
        return ((one, self._readings[one.sensor]) for one in measurements if one.sensor not in self.left_out)

    def _stuck(self, time: float, measurements: Sequence[Measurement], numbers: FloatArray) -> list[Alarm]:
        """Alarms for sensors with noise that repeat one value, and for encoders that stop within a sample."""
        alarms = []
        for one, reading in self._read(measurements):
            size, most = float(np.linalg.norm(one.values)), STUCK_SAMPLES
            if reading.unit == "m":
                size, most = one.values[0], STANDING_SAMPLES
            value, count = self._last.get(one.sensor, (np.nan, 0))
            same = abs(value - size) <= 1e-9 * abs(size) and not self._bears_nothing(reading, size, numbers)
            self._last[one.sensor] = size, count + 1 if same else 1
            if reading.unit == "m" and not same:
                then, there, _ = self._moved.get(one.sensor, (time, size, 0.0))
                since = max(time - then, 1e-3)
                speed = (size - there) / since
                self._moved[one.sensor] = time, size, speed if abs(speed) > FASTEST * since else 0.0  # it may brake
            if same and count + 1 == most and abs(self._moved.get(one.sensor, (0.0, 0.0, np.inf))[2]) > SUDDEN:
                text = f"sensor {one.sensor} is stuck at {with_unit(size, reading.unit, 6)} and is left out"
                alarms.append(self.leave_out(one.sensor, time, text))
        return alarms

    def _leapt(self, time: float, measurements: Sequence[Measurement]) -> list[Alarm]:
        """Alarms for encoders that have leapt to places where their vehicles cannot be, and stay beside the way."""
        alarms = []
        for one, reading in self._read(measurements):
            if reading.unit != "m":
                continue
            away = self._away.setdefault(one.sensor, [])
            size = self._leaps[one.sensor].note(time, one.values[0])
            away[:] = [*away, size] if size else []
            if len(away) == LEAPT_SAMPLES and max(away) - min(away) < ALIKE * abs(size) and abs(size) < LARGEST_LEAP:
                text = f"sensor {one.sensor} has jumped by {with_unit(away[0], 'm', 2)} and is left out"
                alarms.append(self.leave_out(one.sensor, time, text))
        return alarms

    def _jumped(self, time: float, measurements: Sequence[Measurement], numbers: FloatArray) -> list[Alarm]:
        """Alarms for encoders whose places jump against those of the twin."""
        alarms = []
        for one in measurements:
            sensor = self.taken(one.sensor)
            if sensor not in self._jumps:
                continue
            apart = one.values[0] - self._readings[sensor].in_frame(numbers)
            self._jumps[sensor].rough = time < self._rough_until
            if size := self._jumps[sensor].note(time, apart):
                text = f"sensor {one.sensor} has jumped by {with_unit(size, 'm', 2)} and is left out"
                alarms.append(self.leave_out(one.sensor, time, text))
        return alarms

    def _negative(self, time: float, measurements: Sequence[Measurement], numbers: FloatArray) -> list[Alarm]:
        """Alarms for drive forces with the other sign than in all members (members, n), surely of one sign."""
        alarms = []
        for one, reading in self._read(measurements):
            if reading.unit != "N" or reading.places.size > 1:
                continue
            wanted = reading.of(numbers)
            sure = abs(wanted[0]) > WELL_ABOVE * reading.noise and float(np.min(wanted / wanted[0])) > SURELY
            odd = sure and one.values[0] / wanted[0] < -LOST
            self._negatives[one.sensor] = self._negatives.get(one.sensor, 0) + 1 if odd else 0
            if self._negatives[one.sensor] == UNIT_SAMPLES:
                alarms.append(self.leave_out(one.sensor, time, negative(reading)))
        return alarms

    def _bears_nothing(self, reading: Reading, size: float, numbers: FloatArray) -> bool:
        """Whether a load cell reads no force where the twin expects hardly any: the rope has lifted off its support."""
        return reading.places.size > 1 and size == 0.0 and reading.in_frame(numbers) < LEAST_FORCE

    def _of_another_unit(self, time: float, measurements: Sequence[Measurement], numbers: FloatArray) -> list[Alarm]:
        """Alarms for sensors that read about a thousand times more or less than the twin predicts."""
        alarms = []
        for one, reading in self._read(measurements):
            wanted = abs(reading.in_frame(numbers))
            size = abs(reading.measured(one))
            share = size / wanted if wanted > WELL_ABOVE * reading.noise else 1.0
            odd = any(THOUSANDFOLD[0] <= ratio <= THOUSANDFOLD[1] for ratio in (share, 1.0 / max(share, 1e-12)))
            self._of_other_units[one.sensor] = self._of_other_units.get(one.sensor, 0) + 1 if odd else 0
            if self._of_other_units[one.sensor] == UNIT_SAMPLES:
                read, expected = with_unit(size, reading.unit), with_unit(wanted, reading.unit)
                text = f"reads {read} where {expected} are expected: another unit? It is left out"
                alarms.append(self.leave_out(one.sensor, time, f"sensor {one.sensor} {text}"))
        return alarms
