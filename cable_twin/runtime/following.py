"""Following of a plant by a running twin: plant messages go to a separate process, whose estimates are published.

The frame loop gets nothing from here but commands of speeds, as from any other source. All else is done by a process at
a lower priority. Where that process is behind, estimates come later, and each has the time for which it holds.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from queue import Empty, SimpleQueue
from typing import IO, NamedTuple

from cable_twin.basics.newest import NewestLines
from cable_twin.basics.printable import printable
from cable_twin.ensemble.estimate.detectors.emergency_stops import EmergencyStops
from cable_twin.ensemble.estimate.followers import unfollowable
from cable_twin.ensemble.estimate.pursuit import pursuit_of
from cable_twin.ensemble.estimate.tracker import ALONE, BEHIND, FOLLOWING, SILENT
from cable_twin.messages import READMITTED
from cable_twin.runtime.companion import AGAIN, GLANCE, Companion, receive, send
from cable_twin.scenario import Scenario

COMMANDS = "joint_commands"  # topic of what a plant is commanded, below its namespace
STARTING, COMPILING = "starts", "compiles its kernels"  # nothing is estimated yet
NONE_OUT = "none, as no sensor is left out"
SETTLED = 5.0  # s between two answers of a process that follows, at most: more is time by which it is behind
MOST_LINES = 20  # of alarms in the diagnostics, the newest ones, those about payloads the first to go
MOST_WAITING = 20_000  # messages of a plant that may wait for the process


class Arrival(NamedTuple):
    """Message of a plant as it arrived: topic, bytes, and time of arrival."""

    topic: str  # as `sensor_topic` has it, `COMMANDS`, or `READMITTED`
    data: bytes  # CDR
    arrival_ns: int  # by the clock of this machine


class Estimated(NamedTuple):
    """Answer of the process that follows a plant: estimates, lines to log, state and counts."""

    time: float  # s, of the plant
    message: bytes  # diagnostic_msgs/DiagnosticArray, or empty
    warnings: tuple[str, ...]  # alarms, but those about payloads, and what else is doubted or goes wrong
    state: str
    left_out: Mapping[str, str]  # reason by sensor
    counts: Mapping[str, int]  # of messages that were left out, by reason
    behind: float = 0.0  # s behind the plant
    of_payloads: tuple[str, ...] = ()  # alarms about payloads
    notes: tuple[str, ...] = ()  # lines about what is normal
    swapped: Mapping[str, str] = {}  # other sensor, for which one is taken


class LiveFollowing(Companion):
    """Follower of a plant for a running twin, with a separate process that computes the estimates.

    Attributes:
        shut: topics whose messages are left out at present, as two plants publish there.

    Args:
        scenario: of the twin, with the sensors of the plant.
        publish: called with each message of estimates.
        note: called with a line for what is normal, as that the twin begins to follow.
        warn: called with a line for each alarm, and for what is doubted, left out, or goes wrong.
        relief: what gives a follower that is behind its plant more of this machine, in words; empty where nothing does.
    """

    def __init__(
        self,
        scenario: Scenario,
        publish: Callable[[bytes], None],
        note: Callable[[str], None],
        warn: Callable[[str], None],
        relief: str = "",
    ) -> None:
        self._options = {"scenario": scenario.resolved(), "relief": relief}
        self._publish, self._say, self._warn = publish, note, warn
        self._waiting: SimpleQueue[Arrival] = SimpleQueue()
        self._last = Estimated(0.0, b"", (), STARTING, {}, {})
        self._alarms = NewestLines(MOST_LINES)
        self._arrived = math.inf  # s on the steady clock, of the last message
        self._answered = math.inf  # s on the steady clock, of the last answer
        self.shut: frozenset[str] = frozenset()
        super().__init__("runtime.follow_process")

    @property
    def left_out(self) -> Mapping[str, str]:
        """Sensors that are left out as faulty at present, each with the reason."""
        return self._last.left_out

    def take(self, topic: str, data: bytes) -> None:
        """Queue a message of the plant for the process."""
        self._arrived = time.monotonic()
        if self._waiting.qsize() < MOST_WAITING:
            self._waiting.put(Arrival(topic, data, time.time_ns()))

    def readmit(self, sensor: str, message: bytes) -> str:
        """Let a sensor count again that is left out or swapped, by a message; returns why it cannot, or nothing."""
        doubted = {**self._last.left_out, **self._last.swapped}
        if sensor not in doubted:
            allowed = f"a sensor that is left out or swapped: {', '.join(doubted)}" if doubted else NONE_OUT
            return f"readmit: given '{printable(sensor)}'; allowed: {allowed}"
        self._waiting.put(Arrival(READMITTED, message, time.time_ns()))
        return ""

    def status(self) -> tuple[bool, str, dict[str, str]]:
        """Status of the following for the diagnostics: whether all is well, a message, and values."""
        last = self._last
        if last.state == FOLLOWING and time.monotonic() - self._arrived > SILENT:
            last = last._replace(state=ALONE)  # the process, which may be behind, will find that as well
        if last.state == FOLLOWING:
            last = last._replace(behind=last.behind + max(time.monotonic() - self._answered - SETTLED, 0.0))
        values = {"state": last.state, "time_s": f"{last.time:.3f}", "behind_s": f"{last.behind:.1f}"}
        values |= {f"left_out_{name}": reason for name, reason in last.left_out.items()}
        values |= {f"taken_for_{name}": other for name, other in last.swapped.items()}
        values |= {f"left_out: {reason}": str(count) for reason, count in last.counts.items()}
        values |= {f"alarm_{row + 1}": line for row, line in enumerate(self._alarms.lines)}
        text = last.state + (f"; {last.behind:.0f} s behind the plant" if last.behind > BEHIND else "")
        text += f"; left out: {', '.join(last.left_out)}" if last.left_out else ""
        text += f"; taken for each other: {', '.join(last.swapped)}" if last.swapped else ""
        if self.shut:
            text += f"; several plants publish on {', '.join(sorted(self.shut))}, which is left out"
        well = last.state == FOLLOWING and last.behind <= BEHIND
        return well and not (last.left_out or last.swapped or self.shut), text, values

    def shut_out(self, topics: Sequence[str]) -> None:
        """Leave out the messages of topics on which several plants publish, and log changes in a line each way."""
        now = frozenset(topics)
        if more := ", ".join(sorted(now - self.shut)):
            self._warn(f"several plants publish on {more}: left out until one of them is gone, seconds after a kill")
        if again := ", ".join(sorted(self.shut - now)):
            self._say(f"one plant alone publishes on {again}: followed again")
        self.shut = now

    def ended(self) -> None:
        """Tell that the process has ended by itself."""
        self._last = self._last._replace(state=STARTING)
        self._warn(f"following: its process has ended; another one begins in {AGAIN:g} s")

    def talk(self, questions: IO[bytes], answers: IO[bytes]) -> None:
        """Send messages of the plant to the process and read its answers, until either side ends."""
        self._say("the estimator starts: a line says when it has found the plant and estimates begin")
        send(questions, self._options)
        while (answer := receive(answers)) is not None and answer.state == COMPILING:
            self._note(answer)
        if answer is None:
            return
        self._drop_old()
        self._note(answer)  # ready
        reader = threading.Thread(target=self._read, args=(answers,), name="estimates", daemon=True)
        reader.start()
        while not self.stopping.is_set() and reader.is_alive():
            with suppress(Empty):
                send(questions, self._waiting.get(timeout=GLANCE))

    def _drop_old(self) -> None:
        """Forget messages of the plant that arrived while the process started."""
        with suppress(Empty):
            while True:
                self._waiting.get_nowait()

    def _read(self, answers: IO[bytes]) -> None:
        """Publish the estimates in answers of the process, until the pipe ends."""
        while not self.stopping.is_set() and (answer := receive(answers)) is not None:
            self._note(answer)

    def _note(self, answer: Estimated) -> None:
        """Note an answer of the process, log its lines, and publish its estimates."""
        self._last, self._answered = answer, time.monotonic()
        self._alarms.add(answer.warnings)
        self._alarms.add(answer.of_payloads, minor=True)
        for line in answer.notes:
            self._say(line)
        for line in (*answer.warnings, *answer.of_payloads):
            self._warn(line)
        if answer.message:
            self._publish(answer.message)


__all__ = ["COMMANDS", "Arrival", "EmergencyStops", "Estimated", "LiveFollowing", "pursuit_of", "unfollowable"]
