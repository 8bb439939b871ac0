"""Outlook beside a running twin: state copied between two steps, and forecasts of a separate process published.

The frame loop gives a copy of its memory at a frame boundary, and knows nothing else of it. All else is done by a
process at the lowest priority. Where that takes longer than the period, the next outlook is later, and each says its
age.
"""

from __future__ import annotations

import pickle
import struct
import subprocess
import threading
import time
from collections.abc import Callable, Mapping
from concurrent.futures import Future, wait
from contextlib import suppress
from typing import IO, Any, NamedTuple, cast

from cable_twin.frame.records import TensionAhead
from cable_twin.runtime.frame_loop import FrameLoop
from cable_twin.runtime.separate_process import start_process
from cable_twin.simulation import Simulation
from cable_twin.simulation.snapshot_file import FullState

NICE = 19  # the lowest priority
FIRST = 3.0  # s after the start until the process is started: a start has other things to do
AGAIN = 30.0  # s after the end of the process until another one is started
GLANCE = 0.5  # s between two looks whether to end


SIZE = struct.Struct("<Q")  # bytes of what follows in the pipe


class Question(NamedTuple):
    """State of a twin, as bytes."""

    time: float  # s, simulated
    blocks: tuple[bytes, ...]  # ropes and vehicles, the same at the start, and of couplings likewise
    stopped: bool
    commands: Mapping[str, tuple[str, float]]  # kind and value of the last one of each drive
    loading: Mapping[str, float]  # kg
    stamp_ns: int  # of that time
    taken: float  # s on the steady clock, when it was copied

    @classmethod
    def of(cls, full: FullState, stamp_ns: int, taken: float) -> Question:
        """Question about a full state."""
        kept = (full.now, full.before, *full.couplings)
        commands = {name: (one.kind, one.values[name]) for name, one in full.commands.items()}
        blocks = tuple(one.memory.tobytes() for one in kept)
        return cls(full.time, blocks, full.emergency_stopped, commands, dict(full.loading), stamp_ns, taken)


class Answer(NamedTuple):
    """Outlook as a message, and for pictures."""

    time: float  # s, simulated, of the state
    message: bytes  # diagnostic_msgs/DiagnosticArray
    warnings: dict[str, str]  # of the future as commanded: line by id of the figure
    ahead: TensionAhead


def send(stream: IO[bytes], item: Any) -> None:
    """Write an object into a pipe."""
    data = pickle.dumps(item, protocol=5)
    stream.write(SIZE.pack(len(data)) + data)
    stream.flush()


def receive(stream: IO[bytes]) -> Any:
    """Read an object from a pipe between a twin and its own process; None at its end."""
    head = stream.read(SIZE.size)
    if len(head) < SIZE.size:
        return None
    data = stream.read(SIZE.unpack(head)[0])
    try:
        return pickle.loads(data)
    except (pickle.UnpicklingError, EOFError):  # cut short
        return None


class LiveOutlook:
    """Outlook of a running twin, published about once a period.

    Args:
        simulation: running simulation.
        loop: its frame loop.
        stamp_ns: gives the stamp (ns) of a simulated time (s).
        publish: called with each answer.
        warn: called with a line for each limit that would be passed as commanded, once a run, and for a fault.
        horizon: length of the futures (s).
        rate: outlooks a second, where the machine is fast enough.
        gust: amplitude (m/s) of the announced gust.
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
    ) -> None:
        self._simulation, self._loop, self._stamp_ns = simulation, loop, stamp_ns
        self._publish, self._warn, self._period = publish, warn, 1.0 / rate
        self._options = {"scenario": simulation.scenario.resolved(), "horizon": horizon, "gust": gust}
        self._stopping = threading.Event()
        self._process: subprocess.Popen[bytes] | None = None
        self._warned: set[str] = set()
        self._last: tuple[float, bytes] | None = None  # time (s) and state of the last question
        self._thread = threading.Thread(target=self._run, name="outlook", daemon=True)

    def start(self) -> None:
        """Begin to look ahead, some seconds after the start of simulated time."""
        self._thread.start()

    def stop(self) -> None:
        """End the process and the thread."""
        self._stopping.set()
        self._end_process()
        if self._thread.is_alive():
            self._thread.join(4.0 * GLANCE)
        self._end_process()  # if it was about to begin

    def _run(self) -> None:
        seconds = FIRST
        while not self._stopping.wait(seconds):
            try:
                process = self._process = start_process("runtime.outlook_process", NICE)
                self._look(process)
            except OSError:  # of the pipe, or there is no room for a process
                pass
            self._end_process()
            seconds = AGAIN
            if not self._stopping.is_set():
                self._warn(f"outlook: its process has ended; another one begins in {AGAIN:g} s")

    def _look(self, process: subprocess.Popen[bytes]) -> None:
        """Request forecasts of the present state from the separate process, until either of both ends."""
        questions, answers = cast(IO[bytes], process.stdin), cast(IO[bytes], process.stdout)
        send(questions, self._options)
        while not self._stopping.is_set():
            begun = time.monotonic()
            full = self._capture()
            if full is None:
                return
            question = Question.of(full, self._stamp_ns(full.time), begun)
            if self._last != (now := (question.time, question.blocks[0])):  # else it stands still, as while paused
                send(questions, question)
                answer = receive(answers)
                if answer is None:
                    return
                self._last = now
                self._take(answer)
            self._stopping.wait(max(begun + self._period - time.monotonic(), 0.0))

    def _capture(self) -> FullState | None:
        """Copy of the state at the next frame boundary; None where there is none any more."""
        future: Future[FullState] = self._loop.capture()
        while not self._stopping.is_set() and not future.done():
            wait([future], GLANCE)
        return future.result() if future.done() and not future.cancelled() else None

    def _take(self, answer: Answer) -> None:
        """Publish an answer, and warn of limits that would be passed for the first time."""
        if self._stopping.is_set():
            return
        self._publish(answer)
        for key in [key for key in answer.warnings if key not in self._warned]:
            self._warned.add(key)
            self._warn(f"outlook from {answer.time:.2f} s: {answer.warnings[key]}")

    def _end_process(self) -> None:
        """End the process at once, which also ends a wait for its answer."""
        process: Any = self._process
        if process is None:
            return
        process.kill()
        process.wait()
        with suppress(OSError):
            process.stdin.close()
