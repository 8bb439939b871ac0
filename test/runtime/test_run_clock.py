"""Stamps of a run beside a slewed, stopped or set clock."""

from __future__ import annotations

import pytest

from cable_twin.messages import SECOND
from cable_twin.runtime.run_clock import RunClock
from cable_twin.runtime.watches import PaceWatch


class Clocks:
    """Time of day and steady clock, moved by the test."""

    def __init__(self) -> None:
        self.day, self.steady = 1_700_000_000 * SECOND + 123, 55 * SECOND

    def run(self, seconds: float) -> None:
        self.day += round(seconds * SECOND)
        self.steady += round(seconds * SECOND)

    def set_by(self, seconds: float) -> None:
        self.day += round(seconds * SECOND)


class Logger:
    """Logger that keeps its messages."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self.info = self.warning = self.lines.append


class Loop:
    """Frame loop stand-in at a given time."""

    behind, simulated_time = 0.0, 0.0


@pytest.fixture
def clocks():
    return Clocks()


@pytest.fixture
def clock(clocks):
    return RunClock(lambda: clocks.day, lambda: clocks.steady)


def test_stamps_are_the_time_of_day_from_the_start_on(clocks, clock):
    assert clock.stamp_ns(7.0) == clocks.day  # nothing has a time of its own yet
    clocks.run(3.0)
    assert clock.begin(5.0) == clocks.day - 5 * SECOND
    assert clock.stamp_ns(5.0) == clocks.day
    clocks.run(2.25)
    assert clock.stamp_ns(7.25) == clocks.day
    assert clock.behind(7.25) == 0.0
    clocks.run(1.5)  # a pause
    assert clock.behind(7.25) == 1.5


@pytest.mark.parametrize("by", [3600.0, -0.5, 0.05])
def test_a_clock_that_is_set_is_told_once_and_stamps_go_on(clocks, clock, by):
    logger, loop = Logger(), Loop()
    watch = PaceWatch(logger, clock, loop, real_time=True)
    assert watch.check() == {}
    clock.begin(0.0)
    assert watch.check() == {"stamps_behind_clock_s": "0.000"}
    clocks.run(1.0)
    loop.simulated_time = 1.0
    before = clock.stamp_ns(1.0)
    clocks.set_by(by)
    assert clock.stamp_ns(1.0) == before
    assert float(watch.check()["stamps_behind_clock_s"]) == by
    (line,) = logger.lines
    assert f"set by {by:+.3f} s" in line
    assert f"{abs(by):.3f} s {'behind' if by > 0.0 else 'ahead of'} it" in line
    clocks.run(1.0)
    watch.check()
    assert len(logger.lines) == 1


def test_a_clock_that_is_slewed_is_not_set(clocks, clock):
    clock.begin(0.0)
    for _ in range(100):
        clocks.run(1.0)
        clocks.set_by(1e-4)
    assert clock.take_setting() is None


def test_stamps_that_a_pause_left_behind_are_told(clocks, clock):
    logger = Logger()
    watch = PaceWatch(logger, clock, Loop(), real_time=True)
    clock.begin(0.0)
    watch.log_start(0.0, first=False)
    assert logger.lines == []
    clocks.run(12.5)
    watch.log_start(0.0, first=False)
    (line,) = logger.lines
    assert "from now on time stamps are 12.500 s behind the clock" in line
    PaceWatch(logger, clock, Loop(), real_time=False).log_start(0.0, first=True)  # they go their own way
    assert len(logger.lines) == 1


def test_falling_behind_and_catching_up_are_a_line_each(clock):
    logger, loop = Logger(), Loop()
    watch = PaceWatch(logger, clock, loop, real_time=True)
    for behind in (0.0, 0.9, 1.2, 5.0, 12.5, 30.0, 0.5, 0.01, 0.0, 2.0):
        loop.behind = behind
        watch.check()
    assert [line.split(";")[0] for line in logger.lines] == [
        "falls behind the clock: 1.2 s late",
        "falls behind the clock: 12.5 s late",
        "has caught up with the clock",
        "falls behind the clock: 2.0 s late",
    ]
