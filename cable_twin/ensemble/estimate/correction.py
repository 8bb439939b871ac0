"""Result of one window of measurements of a plant that is followed."""

from __future__ import annotations

from typing import NamedTuple

from cable_twin.ensemble.estimate.detectors.alarm import Alarm
from cable_twin.ensemble.estimate.quantities import Estimate


class Correction(NamedTuple):
    """Result of one window of measurements: estimates, normalised innovation and new alarms."""

    time: float  # s
    slow: dict[str, Estimate]
    hidden: dict[str, Estimate]
    innovation: float  # normalised square over its degrees of freedom
    alarms: tuple[Alarm, ...]  # new ones

    def said(self, *, of_payloads: bool) -> list[str]:
        """New alarms, a line each: those about payloads, or all others."""
        return [f"{one.time:.1f} s: {one.reason}" for one in self.alarms if one.of_payload == of_payloads]
