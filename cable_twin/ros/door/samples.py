"""Samples of a plant's tags: conversion to SI, reasons to leave samples out, and log lines when a reason changes."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from typing import Literal, NamedTuple

from cable_twin.basics.printable import printable
from cable_twin.basics.units import rounded
from cable_twin.messages import SECOND
from cable_twin.ros.door.plant_map import Tag
from cable_twin.ros.door.quantities import QUANTITIES, conversion

Level = Literal["info", "warning", "error"]
Tell = Callable[[Level, str], None]

QUIET = 10.0  # s between two lines about a tag, which may change its mind with each sample
FAR = 10.0  # times what is possible, beyond which a value a thousand times off has another unit
FUTURE, PAST = 1.0, 60.0  # s after and before the receipt, beyond which a stamp is one of another clock


class Sample(NamedTuple):
    """Value of a tag of a plant as it arrived, before conversion.

    Attributes:
        tag: name of the tag.
        value: value of any type.
        quality: good, uncertain or bad.
        detail: name of a quality that is not good.
        stamp_ns: time of the measurement, by our clock, ns since 1970.
        receipt_ns: time of its arrival, ns since 1970.
    """

    tag: str
    value: object
    quality: Literal["good", "uncertain", "bad"]
    detail: str
    stamp_ns: int
    receipt_ns: int


class Measured(NamedTuple):
    """Value of a tag of a plant in SI units, with its stamp (ns)."""

    stamp_ns: int
    value: float


class TagState:
    """Check of the samples of a tag, which logs a line when it starts and when it stops leaving samples out.

    Args:
        name: name of the tag.
        tag: its section of the map.
        tell: takes lines.

    Attributes:
        counts: number of samples `taken`, and left out by reason.
        last: newest good value.
        confirmed_ns: receipt of the newest good sample, be it that of `last` or a repeated one.
    """

    def __init__(self, name: str, tag: Tag, tell: Tell) -> None:
        self.name, self.tag, self._tell = name, tag, tell
        self._factor, self._constant = conversion(tag.quantity, tag.unit, tag.radius, tag.area)
        self.counts: Counter[str] = Counter()
        self.last: Measured | None = None
        self.confirmed_ns = 0
        self._heard_ns = 0  # receipt of the newest sample, good or not
        self._reason = ""  # of the newest sample that was left out; empty where it was taken
        self._text = ""  # of that in words
        self._out = 0  # samples since it was told, or since the last good one
        self._told_ns = 0
        self._told_reason = ""

    @property
    def reason(self) -> str:
        """Reason why the samples of this tag are left out at present; empty where they are taken."""
        return self._reason

    def take(self, sample: Sample) -> Measured | None:
        """Check a sample; returns its value in SI units, or None for a sample that is left out."""
        self._heard_ns = sample.receipt_ns
        value, reason, text = self._judged(sample)
        if reason:
            self._leave_out(reason, text, sample.receipt_ns)
            return None
        self.confirmed_ns = sample.receipt_ns
        if self.last is not None and sample.stamp_ns <= self.last.stamp_ns:
            self.counts["repeated"] += 1  # as after a new connection, whose first sample is an old one
            return None
        self._recover(sample.receipt_ns)
        self.counts["taken"] += 1
        self.last = Measured(sample.stamp_ns, value)
        return self.last

    def check_age(self, now_ns: int) -> None:
        """Check that a sample of the tag came recently, and log pending lines; called while the server is connected.

        The time to a first sample counts from the first call; a value that is held may be as old as it likes.
        """
        self._say(now_ns)
        self._heard_ns = self._heard_ns or now_ns
        age = (now_ns - self._heard_ns) / SECOND
        held = self.tag.hold and self.last is not None
        if age > self.tag.stale_after and not self._reason and not held:
            text = f"no sample for {self.tag.stale_after:g} s"
            self._leave_out("stale", text, now_ns, samples=0)

    def lose(self, now_ns: int) -> None:
        """Restart the age of the tag's newest sample; called when the connection is lost or made."""
        self._heard_ns = now_ns
        if self._reason == "stale":
            self._reason = ""

    def _judged(self, sample: Sample) -> tuple[float, str, str]:
        """Value of a sample in SI units, the reason to leave it out (empty for none), and that reason in words."""
        tag = self.tag
        if sample.quality == "bad" or (sample.quality == "uncertain" and tag.quality == "good"):
            allowed = "good" if tag.quality == "good" else "good or uncertain"
            return 0.0, "quality", f"given quality {printable(sample.detail)}; allowed: {allowed}"
        raw = sample.value
        if isinstance(raw, bool) or not isinstance(raw, int | float):
            shown = f"'{printable(raw, 40)}'" if isinstance(raw, str) else f"a {type(raw).__name__}"
            return 0.0, "no number", f"given {shown}; allowed: a number, in {tag.unit}"
        try:
            given = (float(raw) * tag.scale + tag.offset) * tag.sign
        except OverflowError:  # a whole number of hundreds of digits
            given = math.inf
        if not math.isfinite(given):
            shown = str(raw) if isinstance(raw, float) else "a huge number"
            return 0.0, "not finite", f"given {shown}; allowed: a finite number, in {tag.unit}"
        if tag.range is not None and not tag.range[0] <= given <= tag.range[1]:
            low, high = (rounded(limit) for limit in tag.range)
            text = f"given {rounded(given)} {tag.unit}; allowed: {low} to {high} {tag.unit}"
            return 0.0, "range", text + ("; a thousand times off: another unit?" if self._is_other_unit(given) else "")
        age = (sample.receipt_ns - sample.stamp_ns) / SECOND
        if not -FUTURE <= age <= PAST:
            when = f"{rounded(abs(age))} s {'ago' if age > 0.0 else 'from now'}"
            allowed = f"{PAST:g} s ago to {FUTURE:g} s from now"
            return 0.0, "stamp", f"given a stamp {when}; allowed: {allowed}, else `stamp: receipt`"
        return given * self._factor + self._constant, "", ""

    def _is_other_unit(self, given: float) -> bool:
        """Whether a value seems to have another unit: far out of range, but within it if scaled by 1000 or 1/1000."""
        assert self.tag.range is not None
        low, high = self.tag.range
        far = abs(given) > FAR * max(abs(low), abs(high))
        if far:
            return low <= given / 1e3 <= high
        near = min(abs(low), abs(high))
        return low * high > 0.0 and abs(given) < near / FAR and low <= given * 1e3 <= high

    def _leave_out(self, reason: str, text: str, now_ns: int, samples: int = 1) -> None:
        self.counts[reason] += samples
        self._out += samples
        self._reason, self._text = reason, text
        self._say(now_ns)

    def _say(self, now_ns: int) -> None:
        """Log why samples are left out, if the reason is new and the last such line is more than 10 s ago."""
        quiet = self._told_ns and now_ns - self._told_ns <= QUIET * SECOND
        if self._reason and self._reason != self._told_reason and not quiet:
            self._told_ns, self._told_reason = now_ns, self._reason
            self._tell("warning", f"tags.{self.name}: {self._text}; left out until it is right again")

    def _recover(self, now_ns: int) -> None:
        if self._told_reason:
            after = f", after {self._out} sample{'s' * (self._out != 1)} left out" if self._out else ""
            self._tell("info", f"tags.{self.name}: right again{after}")
            self._told_reason, self._out = "", 0
        self._reason = ""


def unit_of(tag: Tag) -> str:
    """SI unit of the quantity that a tag measures."""
    return QUANTITIES[tag.quantity].unit
