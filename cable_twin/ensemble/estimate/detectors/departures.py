"""Departures of estimates from the expected values, and sudden changes of them, as alarms."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from cable_twin.basics.units import with_unit
from cable_twin.ensemble.estimate.detectors.alarm import Alarm, with_deviation
from cable_twin.ensemble.estimate.quantities import Estimate

CERTAIN = 3.0  # standard deviations, beyond which an estimate is not the expected one
SUDDEN = 2.0  # the same of a sudden change, for which measurements speak already
REMEMBERED = 20.0  # s, for which an estimate is held against the one before a sudden change, and an alarm is recent


class Expected(NamedTuple):
    """Expected value of an estimate, in the estimate's unit, and where it comes from."""

    value: float
    tolerance: float  # by which the plant may differ without an alarm
    may_change: bool  # suddenly, as a payload does in a station
    source: str = "scenario"


class Departures:
    """Alarms for slow quantities that are not as expected, or have changed by more than is tolerated.

    An estimate before a sudden change is off by the same errors as the one after it, so that the change is known better
    than the value.
    """

    def __init__(self) -> None:
        self._told: dict[str, tuple[float, float]] = {}  # times (s) and values of the last alarms of quantities
        self._before: dict[str, tuple[float, float]] = {}  # times (s) of sudden changes, and the values before

    def changed(self, time: float, name: str, value: float) -> None:
        """Note that a quantity seems to change suddenly from a value at a time (s)."""
        self._before.setdefault(name, (time, value))

    def forget(self, name: str) -> None:
        """Forget the alarm about a quantity of which another value is expected now."""
        self._told.pop(name, None)

    def told(self, time: float, name: str) -> bool:
        """Whether a recent alarm, seen from a time (s), says that a quantity is not as expected."""
        return name in self._told and time - self._told[name][0] < REMEMBERED

    def alarms(
        self,
        time: float,
        slow: Mapping[str, Estimate],
        expected: Mapping[str, Expected],
        agreed: Mapping[str, Estimate] | None = None,
    ) -> list[Alarm]:
        """New alarms for those estimates of which something is expected.

        Args:
            time: s.
            slow: estimates of then, by name.
            expected: by name.
            agreed: the same with wider bands, by which they are judged; None for those of `slow`.
        """
        found = []
        for name, one in expected.items():
            got = (agreed or slow)[name]
            margin = CERTAIN * got.deviation
            if name in self._before and time - self._before[name][0] > REMEMBERED:
                del self._before[name]
            before = self._before[name][1] if name in self._before and not one.may_change else got.value
            sure, told = one.tolerance + margin, self._told.get(name, (time, np.inf))[1]
            plan = f"{with_unit(one.value, got.unit)} in the {one.source}"
            said = f"{name} is {with_deviation(slow[name].value, slow[name].deviation, got.unit)}"
            if abs(got.value - one.value) + margin < one.tolerance:
                self._told.pop(name, None)
            elif min(abs(got.value - one.value), abs(got.value - told)) > sure:
                self._told[name] = time, got.value
                found.append(Alarm(time, f"{said}; {plan}", one.may_change))
            elif name not in self._told and abs(got.value - before) > one.tolerance + SUDDEN * got.deviation:
                self._told[name] = time, got.value
                found.append(Alarm(time, f"{said}, after {with_unit(before, got.unit)}; {plan}", one.may_change))
        return found
