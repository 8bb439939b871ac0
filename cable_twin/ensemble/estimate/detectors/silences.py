"""Detection of sensors that say nothing while others speak."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from cable_twin.frame.sensors import Measurement

QUIET, SELDOM = 3.0, 5.0  # s without a sample, and times the longest time between its samples, from which one is silent


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

    def note(
        self, time: float, measurements: Sequence[Measurement], left_out: Collection[str]
    ) -> tuple[list[str], list[str]]:
        """Add the samples of a time (s); returns lines about sensors that have fallen silent, and that are back."""
        silent, back = list[str](), list[str]()
        for one in measurements:
            since = time - self._last.get(one.sensor, time)
            if one.sensor in self._silent:
                self._silent.discard(one.sensor)
                back.append(f"sensor {one.sensor} is back after {since:.1f} s")
            else:
                self._usual[one.sensor] = max(self._usual.get(one.sensor, 0.0), since)
            self._last[one.sensor] = time
        for name, last in self._last.items():
            quiet = time - last > max(QUIET, SELDOM * self._usual[name])
            if quiet and name not in self._silent and name not in left_out:
                self._silent.add(name)
                silent.append(
                    f"sensor {name} is silent since {last:.1f} s, for {time - last:.1f} s, while others speak"
                )
        return silent, back
