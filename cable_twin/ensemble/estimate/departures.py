"""Departures of estimates from the values of the scenario, and sudden changes of them, as alarms."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from cable_twin.basics.units import with_unit
from cable_twin.ensemble.estimate.doubts import Alarm, with_deviation
from cable_twin.ensemble.estimate.quantities import Estimate, Slow

CERTAIN = 3.0  # standard deviations, beyond which an estimate is not that of the scenario
SUDDEN = 2.0  # the same of a sudden change, for which measurements speak already
REMEMBERED = 20.0  # s, for which an estimate is held against the one before a sudden change


class Departures:
    """Alarms for slow quantities that are not those of the scenario, or have changed by more than is tolerated.

    An estimate before a sudden change is off by the same errors as the one after it, so that the change is known better
    than the value.

    Args:
        slow: quantities that are estimated.
    """

    def __init__(self, slow: Sequence[Slow]) -> None:
        self._slow = {one.name: one for one in slow}
        self._told: dict[str, float] = {}  # values of quantities with an alarm
        self._before: dict[str, tuple[float, float]] = {}  # times (s) of sudden changes, and the values before

    def changed(self, time: float, name: str, value: float) -> None:
        """Note that a quantity seems to change suddenly from a value at a time (s); payloads may do so."""
        if not self._slow[name].payload_of:
            self._before.setdefault(name, (time, value))

    def alarms(self, time: float, slow: Mapping[str, Estimate]) -> list[Alarm]:
        """New alarms at a time (s) with the estimates of then."""
        found = []
        for name, one in self._slow.items():
            got, margin = slow[name], CERTAIN * slow[name].deviation
            if name in self._before and time - self._before[name][0] > REMEMBERED:
                del self._before[name]
            before = self._before[name][1] if name in self._before else got.value
            sure, told = one.tolerance + margin, self._told.get(name, np.inf)
            plan = with_unit(one.plan, one.unit)
            said = f"{name} is {with_deviation(got.value, got.deviation, one.unit)}"
            if abs(got.value - one.plan) + margin < one.tolerance:
                self._told.pop(name, None)
            elif min(abs(got.value - one.plan), abs(got.value - told)) > sure:
                self._told[name] = got.value
                found.append(Alarm(time, f"{said}; {plan} in the scenario"))
            elif name not in self._told and abs(got.value - before) > one.tolerance + SUDDEN * got.deviation:
                self._told[name] = got.value
                found.append(Alarm(time, f"{said}, after {with_unit(before, one.unit)}; {plan} in the scenario"))
        return found
