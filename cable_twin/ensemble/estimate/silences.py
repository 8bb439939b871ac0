"""Silent plants: sensors that say nothing while others speak, and doubt about a twin that goes on by its model."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from cable_twin.ensemble.estimate.correction import Correction
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


def doubted(alone: Correction, followed: Correction | None, silent: float, stopping: float) -> Correction:
    """Estimates of a twin that goes on alone, with the doubt whether the plant has stopped meanwhile.

    A force may still be what it was when the plant fell silent, and a body may swing by the angle of a pendulum whose
    pivot slows down.

    Args:
        alone: what the twin says by its model.
        followed: what it said last while it followed.
        silent: s since the last sample.
        stopping: deceleration of a stop over gravity.
    """
    swing = min(silent / SWINGING, 1.0) * stopping
    before = {} if followed is None else followed.hidden

    def widened(name: str, one: Estimate) -> Estimate:
        last = before.get(name, one).value
        more = swing if one.unit == "rad" else one.value - last
        return one._replace(deviation=(one.deviation**2 + more**2) ** 0.5)

    return alone._replace(hidden={name: widened(name, one) for name, one in alone.hidden.items()})
