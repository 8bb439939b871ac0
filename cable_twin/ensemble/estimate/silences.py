"""Silent plants: sensors that say nothing while others speak, and doubt about a twin that goes on by its model."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

from cable_twin.ensemble.estimate.correction import Correction
from cable_twin.ensemble.estimate.line_waves import LineWaves
from cable_twin.ensemble.estimate.quantities import Estimate
from cable_twin.frame.sensors import Measurement

QUIET, SELDOM = 3.0, 5.0  # s without a sample, and times the longest time between its samples, from which one is silent
SWINGING = 5.0  # s of silence, after which a carriage may swing as one whose drive has stopped


class Silences:
    """Lines about sensors of a plant that are silent while others speak."""

    def __init__(self) -> None:
        self._last: dict[str, float] = {}  # s, of the last sample
        self._usual: dict[str, float] = {}  # s, longest time between two samples
        self._silent: set[str] = set()

    def clear(self) -> None:
        """Forget all samples, as after a silence of the whole plant."""
        self._last.clear()
        self._silent.clear()

    def note(self, time: float, measurements: Sequence[Measurement], left_out: Collection[str]) -> list[str]:
        """Add the samples of a time (s); returns lines about sensors that have fallen silent, or are back."""
        lines = []
        for one in measurements:
            since = time - self._last.get(one.sensor, time)
            if one.sensor in self._silent:
                self._silent.discard(one.sensor)
                lines.append(f"sensor {one.sensor} is back after {since:.1f} s")
            else:
                self._usual[one.sensor] = max(self._usual.get(one.sensor, 0.0), since)
            self._last[one.sensor] = time
        for name, last in self._last.items():
            quiet = time - last > max(QUIET, SELDOM * self._usual[name])
            if quiet and name not in self._silent and name not in left_out:
                self._silent.add(name)
                lines.append(f"sensor {name} is silent since {last:.1f} s, for {time - last:.1f} s, while others speak")
        return lines


class Unheard:
    """Estimates of a twin that goes on alone, with the doubt what its plant does meanwhile.

    A force may still be what it was when the plant fell silent, and has waves of other phases than in the twin. A body
    may swing by the angle of a pendulum whose pivot slows down.

    Args:
        stopping: deceleration of a stop over gravity.
    """

    def __init__(self, stopping: float) -> None:
        self._stopping, self._waves = stopping, LineWaves()
        self._last: Mapping[str, Estimate] = {}  # of what is hidden, as it was told last while the plant was heard

    def forget(self) -> None:
        """Forget what was told, as the twin begins anew."""
        self._last = {}

    def followed(self, correction: Correction) -> None:
        """Take what the twin says while it hears its plant."""
        self._last = correction.hidden
        self._variances(correction)

    def widened(self, alone: Correction, silent: float) -> Correction:
        """Estimates with more doubt, of a twin that has gone on alone for some seconds."""
        self._waves.stir(alone.time)
        waves, swing = self._variances(alone), min(silent / SWINGING, 1.0) * self._stopping

        def more_doubted(name: str, one: Estimate) -> Estimate:
            moved = one.value - self._last.get(name, one).value
            more = swing**2 if one.unit == "rad" else moved**2 + waves.get(name, 0.0)
            return one._replace(deviation=(one.deviation**2 + more) ** 0.5)

        return alone._replace(hidden={name: more_doubted(name, one) for name, one in alone.hidden.items()})

    def _variances(self, correction: Correction) -> dict[str, float]:
        """Variances (N^2) of hidden forces by waves."""
        forces = {name: one.value for name, one in correction.hidden.items() if one.unit == "N"}
        return {name: self._waves.variance(correction.time, name, force) for name, force in forces.items()}
