"""Commands on topics: accepted, recorded and reported, without ROS."""

from __future__ import annotations

import numpy as np
import pytest
from frame_loops import frame_loop

from cable_twin.frame.commands import JOINT_COMMANDS
from cable_twin.frame.records import Command, CommandError
from cable_twin.messages import SECOND, JointState, header, serialize
from cable_twin.messages.command_messages import command_from_joint_state
from cable_twin.ros.command_subscriber import LONGEST_REASON, WARNING_PERIOD, CommandLimits, CommandSubscriber

MANY = 20_000  # names
NOW = 1_700_000_000 * SECOND  # ns, stamp of the newest frame


class Taken:
    """Command subscriber of a twin at rest with an immediate loop, and its results."""

    def __init__(self, **limits):
        self.recorded, self.lines, self.applied, self.refused = [], [], [], []
        self.counts = {"commands_refused": 0}
        self.loop = frame_loop(on_applied=self.applied.append)
        limits = CommandLimits(**{"size": 65_536, "rate": 1000, "names": 9} | limits)
        record = lambda topic, data: self.recorded.append((topic, data))  # noqa: E731
        tell = lambda *refused: self.refused.append(refused)  # noqa: E731
        self.now = 0.0  # s
        name, clock = "/cable_twin/{}".format, lambda: self.now
        self.subscriber = CommandSubscriber(
            self.loop, limits, self.counts, self, name, lambda: NOW, record, tell, clock
        )

    def warning(self, line):
        self.lines.append(line)

    def take(self, data):
        self.subscriber.take(JOINT_COMMANDS, data)
        self.loop._handle_requests()


def command(*names, frame="", speed=1.0, stamp_ns=0):
    return serialize(
        JointState(header(stamp_ns, frame), list(names), np.empty(0), np.full(len(names), speed), np.empty(0))
    )


class Compared(str):
    """Name that counts comparisons."""

    times = 0

    def __eq__(self, other):
        Compared.times += 1
        return str.__eq__(self, other)

    __hash__ = str.__hash__


def test_names_given_twice_are_found_without_a_comparison_of_each_with_each():
    count = MANY // 10
    names = [Compared(f"n{number}") for number in range(count)]
    Compared.times = 0
    with pytest.raises(CommandError, match="names 'n0' more than once"):
        command_from_joint_state(JOINT_COMMANDS, [*names, Compared("n0")], [], np.ones(count + 1), [])
    assert 1 <= Compared.times < 10 * count  # of those with one hash; each with each would be 2 million


def test_what_has_more_names_than_there_are_joints_is_refused_before_it_is_decoded():
    taken = Taken(size=10_000_000)
    taken.take(command(*(f"n{number}" for number in range(MANY)))[:40])  # ends after some names: decoded it is a fault
    assert "names: given 20000; allowed: up to 9, as many as there are joints" in taken.lines[0]
    assert (taken.counts, taken.recorded, taken.applied) == ({"commands_refused": 1}, [], [])


@pytest.mark.parametrize(
    ("message", "reason"),
    [
        (command("cabin", frame="f" * 70_000), "message: given 70056 bytes; allowed: up to 65536 bytes"),
        (command("cabin", frame="f" * 300), "frame_id: given 300 bytes; allowed: up to 256"),
        (bytes(range(10)), "not a JointState"),
        (b"\0", "not a JointState"),
        (command("n" * 60_000), "carriage or drive: given 'nnn"),
        (command("\x1b[2Jcabin"), r"carriage or drive: given '\x1b[2Jcabin'"),
        (command("cabin", speed=1e9), "speed of 'cabin': given 1e+09 m/s"),
    ],
)
def test_what_is_refused_is_counted_named_in_a_short_line_and_not_recorded(message, reason):
    taken = Taken()
    taken.take(message)
    (line,) = taken.lines
    assert reason in line
    assert line.isprintable()
    assert len(line) < LONGEST_REASON + 200
    ((topic, told, count),) = taken.refused
    assert (topic, count) == (JOINT_COMMANDS, 1)
    assert told in line
    assert (taken.counts, taken.recorded, taken.applied) == ({"commands_refused": 1}, [], [])


def test_what_takes_effect_is_recorded_as_it_came():
    taken = Taken()
    taken.take(command("cabin"))
    assert taken.recorded == [(JOINT_COMMANDS, command("cabin"))]
    assert [one.command for one in taken.applied] == [Command("speed", {"cabin": 1.0})]


def test_commands_beyond_the_rate_are_refused_and_refused_ones_crowd_nobody_out():
    taken = Taken(rate=10)
    for _ in range(50):
        taken.take(command("cabin", frame="f" * 300))
    for _ in range(20):
        taken.take(command("cabin"))
    assert len(taken.applied) == 10
    assert taken.counts == {"commands_refused": 60}
    taken.loop.pause(True)  # in lockstep as many as there are frames
    for _ in range(20):
        taken.take(command("cabin"))
    assert len(taken.applied) == 30
    taken.loop.pause(False)
    taken.now += 1.0
    taken.take(command("cabin"))
    assert len(taken.applied) == 31


def test_a_stream_of_refused_commands_is_one_line_and_some_messages():
    """50 in a second: one line in the log, up to 20 messages, each with the total so far."""
    taken = Taken()
    for _ in range(50):
        taken.take(command("nobody"))
        taken.now += 0.02
    assert len(taken.lines) == 1
    assert [count for *_, count in taken.refused] == [*range(1, 51, 3)]
    taken.now += WARNING_PERIOD
    taken.take(command("nobody"))
    assert "51 refused so far" in taken.lines[1]


@pytest.mark.parametrize(
    ("age", "stamp_ns", "reason"),
    [
        (0.0, 1, ""),  # of 1970: stamps do not count
        (0.5, 0, ""),  # no stamp
        (0.5, NOW - SECOND // 4, ""),
        (0.5, NOW + SECOND // 4, ""),
        (0.5, 1, "stamp: given 1.7e+09 s older than the newest frame; allowed: up to 0.5 s (command_max_age)"),
        (0.5, NOW - SECOND, "stamp: given 1 s older than the newest frame"),
        (0.5, NOW + SECOND, "stamp: given 1 s later than the newest frame"),
    ],
)
def test_commands_of_another_time_are_refused_where_that_is_asked_for(age, stamp_ns, reason):
    taken = Taken(age=age)
    taken.take(command("cabin", stamp_ns=stamp_ns))
    assert len(taken.applied) == (not reason)
    assert [reason in line for line in taken.lines] == [True] * bool(reason)


def test_an_urgent_command_goes_before_others_and_those_that_come_meanwhile_wait():
    taken = Taken()
    later = []

    def ask_again():
        later.append(taken.loop.call(lambda: None))

    first = taken.loop.call(ask_again)
    taken.loop.submit(Command("speed", {"cabin": 1.0}), "test")
    stop = taken.loop.submit(Command("emergency_stop", {}), "service", urgent=True)
    taken.loop._handle_requests()
    assert [one.command.kind for one in taken.applied] == ["emergency_stop"]  # the speed is refused then
    assert first.done()
    assert stop.done()
    assert not later[0].done()
    taken.loop._handle_requests()
    assert later[0].done()
