"""Outlook of a running twin: copies of its state go to a separate process, whose forecasts are published.

The frame loop only gives a copy of its memory at a frame boundary. All else is done by a process at the lowest
priority. Where that takes longer than the period, the next outlook is later; each outlook has its age.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from concurrent.futures import Future, wait
from typing import IO, NamedTuple

from cable_twin.frame.records import TensionAhead
from cable_twin.runtime.companion import AGAIN, GLANCE, Companion, receive, send
from cable_twin.runtime.frame_loop import FrameLoop
from cable_twin.simulation import Simulation
from cable_twin.simulation.snapshot_file import FullState

LATE, STARTS = 10.0, 60.0  # s that an outlook may take, and the first one, whose process starts, without a warning
FIRST = 3.0  # s after the start until the process is started: a start has other things to do


class Question(NamedTuple):
    """Request for an outlook: state of a twin as bytes, with its commands and loading."""

    time: float  # s, simulated
    blocks: tuple[bytes, ...]  # ropes and vehicles, the same at the start, and of couplings likewise
    stopped: bool
    commands: Mapping[str, tuple[str, float]]  # kind and value of the last one of each drive
    loading: Mapping[str, float]  # kg
    stamp_ns: int  # of that time
    taken: float  # s on the steady clock, when it was copied

    @classmethod
    def of(cls, full: FullState, stamp_ns: int, taken: float) -> Question:
        """Request for an outlook from a full state of a twin."""
        kept = (full.now, full.before, *full.couplings)
        commands = {name: (one.kind, one.values[name]) for name, one in full.commands.items()}
        blocks = tuple(one.memory.tobytes() for one in kept)
        return cls(full.time, blocks, full.emergency_stopped, commands, dict(full.loading), stamp_ns, taken)


class Answer(NamedTuple):
    """Outlook as a ROS message, with warnings, and ranges of tension for pictures."""

    time: float  # s, simulated, of the state
    message: bytes  # diagnostic_msgs/DiagnosticArray
    warnings: dict[str, tuple[float, str]]  # of the future as commanded, by id of the figure: when (s), and a line
    ahead: TensionAhead


class LiveOutlook(Companion):
    """Publisher of outlooks (forecasts) of a running twin, computed in a separate process about once a period.

    Args:
        simulation: running simulation.
        loop: its frame loop.
        stamp_ns: gives the stamp (ns) of a simulated time (s).
        publish: called with each answer.
        warn: called with a line for each limit that would be passed as commanded, once a run, and for a fault.
        horizon: length of the futures (s).
        rate: outlooks a second, where the machine is fast enough.
        gust: amplitude (m/s) of the announced gust.
        passing: tells whether the drives have speeds that will not last: no outlook begins then.
    """

    def __init__(
        self,
        simulation: Simulation,
        loop: FrameLoop,
        *,
        stamp_ns: Callable[[float], int],
        publish: Callable[[Answer], None],
        warn: Callable[[str], None],
        horizon: float,
        rate: float,
        gust: float,
        passing: Callable[[], bool] = lambda: False,
    ) -> None:
        self._passing = passing
        self._simulation, self._loop, self._stamp_ns = simulation, loop, stamp_ns
        self._publish, self._warn, self._period = publish, warn, 1.0 / rate
        self._options = {"scenario": simulation.scenario.resolved(), "horizon": horizon, "gust": gust}
        self._warned: set[str] = set()
        self._last: tuple[float, bytes] | None = None  # time (s) and state of the last question
        self._asked: float | None = None  # s on the steady clock, of the question that waits for its answer
        self._found = math.nan, 0.0  # s, simulated time of the last outlook, and s by the clock that it took
        super().__init__("runtime.outlook_process", FIRST)

    def ended(self) -> None:
        """Tell that the process has ended by itself."""
        self._found, self._asked = (math.nan, 0.0), None
        self._warn(f"outlook: its process has ended; another one begins in {AGAIN:g} s")

    def status(self) -> tuple[bool, str, dict[str, str]]:
        """Status of the outlook for the diagnostics: whether it comes in time, a message, and values."""
        (at, took), asked = self._found, self._asked
        waits = 0.0 if asked is None else time.monotonic() - asked
        values = {"time_s": f"{at:.3f}", "took_s": f"{took:.1f}", "waits_s": f"{waits:.1f}"}
        if max(took, waits) > (STARTS if math.isnan(at) else LATE):
            takes = f"more than {waits:.0f}" if waits > took else f"{took:.0f}"
            text = f"an outlook takes {takes} s, as this machine is too slow beside the twin"
            return False, f"{text}: a shorter outlook_horizon takes less", values
        return True, "starts" if math.isnan(at) else f"looks ahead from {at:.1f} s", values

    def talk(self, questions: IO[bytes], answers: IO[bytes]) -> None:
        """Send the twin's state to the process every period and publish the returned outlook, until either ends."""
        self._found, self._asked = (math.nan, 0.0), time.monotonic()
        send(questions, self._options)
        while not self.stopping.is_set():
            begun = time.monotonic()
            full = self._capture()
            if full is None:
                return
            question = Question.of(full, self._stamp_ns(full.time), begun)
            now = question.time, question.blocks[0]
            if self._last != now and not self._passing():  # else it stands still, as while paused
                self._asked = begun if self._asked is None else self._asked
                send(questions, question)
                answer = receive(answers)
                if answer is None:
                    return
                took = time.monotonic() - self._asked
                took = 0.0 if math.isnan(self._found[0]) else took  # the first one has the start of the process in it
                self._found, self._asked = (answer.time, took), None
                self._last = now
                self._take(answer)
            self.stopping.wait(max(begun + self._period - time.monotonic(), 0.0))

    def _capture(self) -> FullState | None:
        """Copy of the twin's state at the next frame boundary; None after the end of the frame loop."""
        future: Future[FullState] = self._loop.capture()
        while not self.stopping.is_set() and not future.done():
            wait([future], GLANCE)
        return future.result() if future.done() and not future.cancelled() else None

    def _take(self, answer: Answer) -> None:
        """Publish an outlook, and warn of limits that would be passed for the first time.

        One that took so long that the twin is past that time says so: what is reported of the twin itself came before.
        """
        if self.stopping.is_set():
            return
        self._publish(answer)
        for key in [key for key in answer.warnings if key not in self._warned]:
            self._warned.add(key)
            (passed, line), now = answer.warnings[key], self._simulation.time
            late = f", there only at {now:.2f} s" if now >= passed else ""
            self._warn(f"outlook from {answer.time:.2f} s{late}: {line}")
