"""Real-time frame loop in the solver's thread: frames at absolute deadlines, commands at frame boundaries.

A frame is computed and encoded ahead and published when its simulated time is due, so that lateness is that of the
clock and not of the solver. A command takes effect at the boundary after its arrival. No step is ever skipped: a loop
that is late computes without waiting until it has caught up.
"""

from __future__ import annotations

import ctypes
import math
import os
import platform
import struct
import threading
import traceback
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass, field
from typing import Any

from cable_twin.frame.commands import KINDS
from cable_twin.frame.records import AppliedCommand, Command, CommandError, Goal
from cable_twin.frame.snapshot import Snapshot
from cable_twin.runtime.frame_statistics import FrameStatistics, LatenessHistogram
from cable_twin.runtime.point_to_point import ARRIVAL, SOURCE, Goals
from cable_twin.runtime.run_clock import SteadyClock
from cable_twin.simulation import Simulation, SolverError
from cable_twin.simulation.snapshot_file import FullState

IDLE = 0.5  # s between two looks at the queue while paused and nobody wakes the loop
SYSTEM_CALLS = {"x86_64": 314, "aarch64": 274}  # sched_setattr, for which C libraries have a function only lately
ATTRIBUTES = struct.Struct("=IIQiIQQQ")  # struct sched_attr: size, policy, flags, nice, priority, runtime, two more
SHORTEST = 100_000  # ns, the shortest slice that Linux gives
_Request = tuple[Command | Goal | Callable[[], Any], str, Future[Any]]


def wake_promptly() -> bool:
    """Give the calling thread the shortest scheduler slice, so that it runs soon after it wakes; needs no privilege.

    A thread that wakes waits until the slice of the one that has the processor has run out, some milliseconds; unless
    its own slice is the shorter one, which it may choose since Linux 6.12 (sched(7), sched_setattr(2)). Its share
    of the processor stays as it was. Returns False on systems without support.
    """
    number = SYSTEM_CALLS.get(platform.machine())
    if platform.system() != "Linux" or number is None or os.sched_getscheduler(0) != os.SCHED_OTHER:
        return False
    nice = os.getpriority(os.PRIO_PROCESS, threading.get_native_id())
    attributes = ATTRIBUTES.pack(ATTRIBUTES.size, os.SCHED_OTHER, 0, nice, 0, SHORTEST, 0, 0)
    return ctypes.CDLL(None).syscall(number, 0, attributes, 0) == 0


@dataclass(slots=True)
class Stepping:
    """Request to compute a number of frames while paused, with its progress."""

    count: int
    on_frame: Callable[[int], bool] | None = None  # takes the number of frames so far, returns whether to continue
    taken: int = 0
    future: Future[int] = field(default_factory=Future)

    def took(self, took: bool) -> bool:
        """Record a computed or failed frame; returns whether the request is finished."""
        self.taken += took
        on = took and (self.on_frame is None or self.on_frame(self.taken))
        if on and self.taken < self.count:
            return False
        if self.future.set_running_or_notify_cancel():
            self.future.set_result(self.taken)
        return True


class FrameLoop:
    """Real-time loop of a simulation: frame by frame, in its own thread.

    Args:
        simulation: advanced by this loop alone while it runs.
        frame_steps: number of solver steps in a frame.
        real_time_factor: simulated seconds per second, 0 for as fast as possible.
        command_timeout: time (s) without a command after which a moving carriage or drive ramps to a stop.
        on_run: called when simulated time starts to run: with True at the first start, with False after a pause; not
            for single steps while paused.
        prepare: called with each computed snapshot, except that of the start; returns the frame to publish.
        publish: called with each prepared frame when it is due.
        before_command: called before a command takes effect, also while the twin is paused before its first start.
        on_applied: called with each applied command, before the frame that shows it.
        on_fault: called with a message, in lines, when a step or the loop fails.
        on_goal: called with a message when a goal is reached (False) or abandoned (True).
        paused: start paused, until `pause(False)` or `step`.
        clock: steady clock that paces the frames.

    Attributes:
        command_timeout: time (s) as given; may be changed while the loop runs.
        frame_period: simulated time (s) of a frame.
        fault: message of a failed step or of the program, empty while the loop works.
        failed: whether the loop has ended by a fault of the program.
        behind: lateness (s) of the newest frame.
        goals: point-to-point motions.
        total_lateness: lateness of all frames since the start.
    """

    def __init__(
        self,
        simulation: Simulation,
        *,
        frame_steps: int,
        real_time_factor: float,
        command_timeout: float,
        on_run: Callable[[bool], None],
        prepare: Callable[[Snapshot], Any],
        publish: Callable[[Any], None],
        before_command: Callable[[], None],
        on_applied: Callable[[AppliedCommand], None],
        on_fault: Callable[[str], None],
        on_goal: Callable[[str, bool], None] = lambda line, given_up: None,
        paused: bool = False,
        clock: SteadyClock | None = None,
    ) -> None:
        self.command_timeout = command_timeout
        self.frame_period = frame_steps * simulation.step
        self.fault, self.failed, self.behind = "", False, 0.0
        self._clock = clock or SteadyClock()
        self._simulation = simulation
        self._factor = real_time_factor
        self._on_run, self._prepare, self._publish = on_run, prepare, publish
        self._before_command, self._on_applied, self._on_fault = before_command, on_applied, on_fault
        self._paused = paused
        self.goals = Goals(simulation, on_goal)
        self._requests: deque[_Request] = deque()  # handled between two frames
        self._urgent: deque[_Request] = deque()  # handled before them
        self._stepping: deque[Stepping] = deque()  # requested frames while paused
        self._deadlines: dict[str, float] = {}  # name of a moving carriage or drive -> clock (s) of its time-out
        self._clock_period = self.frame_period / real_time_factor if real_time_factor > 0.0 else math.inf
        self.total_lateness = LatenessHistogram(self._clock_period)
        self._statistics = FrameStatistics(self._clock_period)
        self._stopping, self._asked = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._guard, name="solver", daemon=True)

    @property
    def paused(self) -> bool:
        """Whether simulated time stands still."""
        return self._paused

    @property
    def emergency_stopped(self) -> bool:
        """Whether an emergency stop is in force."""
        return self._simulation.emergency_stopped

    @property
    def stepping(self) -> bool:
        """Whether requested frames are computed while paused."""
        return bool(self._stepping)

    @property
    def urgent(self) -> bool:
        """Whether urgent commands wait for the next frame boundary."""
        return bool(self._urgent)

    @property
    def simulated_time(self) -> float:
        """Simulated time (s) of the newest computed frame."""
        return self._simulation.snapshot.time

    def start(self) -> None:
        """Start the thread of the frame loop."""
        self._thread.start()

    def stop(self) -> None:
        """End the thread of the frame loop after the present frame; waiting requests are cancelled."""
        self._stopping.set()
        self._asked.set()
        if self._thread.is_alive():
            self._thread.join()
        waiting = (*self._urgent, *self._requests)
        for future in (*(item.future for item in self._stepping), *(future for *_, future in waiting)):
            future.cancel()
        for queue in (self._stepping, self._urgent, self._requests):
            queue.clear()

    def submit(self, command: Command | Goal, source: str, *, urgent: bool = False) -> Future[AppliedCommand | None]:
        """Queue a command; returns a future with the command as applied, with None for a goal, or with CommandError.

        Urgent commands are handled before all others at the next frame boundary.
        """
        return self._queue(command, source, self._urgent if urgent else self._requests)

    def pause(self, paused: bool) -> None:
        """Pause simulated time, stepping included, or resume."""
        self._paused = paused
        for stepping in tuple(self._stepping) if paused else ():
            stepping.count = 0
        self._asked.set()

    def step(self, count: int = 1, on_frame: Callable[[int], bool] | None = None) -> Future[int]:
        """Compute frames while paused, unpaced; returns a future of their number, lower after a failure or pause.

        After each frame `on_frame` takes the number of frames so far, and returns whether to continue.
        """
        stepping = Stepping(count, on_frame)
        self._stepping.append(stepping)
        self._asked.set()
        return stepping.future

    def capture(self) -> Future[FullState]:
        """Copy the full state at the next frame boundary; returns a future of the copy."""
        return self.call(self._simulation.capture)

    def call(self, function: Callable[[], Any]) -> Future[Any]:
        """Call a function, which must not raise, at the next frame boundary; returns a future of its result."""
        return self._queue(function, "", self._requests)

    def _queue(self, command: Command | Goal | Callable[[], Any], source: str, queue: deque[_Request]) -> Future[Any]:
        future: Future[Any] = Future()
        queue.append((command, source, future))
        self._asked.set()
        return future

    def take_statistics(self) -> FrameStatistics:
        """Return the statistics of the frames since the last call, and begin new ones."""
        taken, self._statistics = self._statistics, FrameStatistics(self._clock_period)
        return taken

    def _guard(self) -> None:
        """Run the loop and report an exception that ends its thread."""
        wake_promptly()
        try:
            self._run()
        except Exception as error:
            self.fault = f"fault of the program: {error!r}"
            self._on_fault("".join(traceback.format_exception(error)).rstrip())
            self.failed = True

    def _run(self) -> None:
        self._start_timeouts()
        anchor: tuple[float, float] | None = None  # clock (s) and simulated time (s) from which frames are paced
        first = True
        while not self._stopping.is_set():
            if self._urgent or self._requests or self._deadlines:
                self._handle_requests()
            stepping = self._stepping[0] if self._stepping else None
            if self._paused and stepping is None:
                anchor = None
                self._asked.wait(IDLE)
                self._asked.clear()
                continue
            paced = self._factor > 0.0 and not self._paused
            if anchor is None:
                anchor = self._clock.now(), self._simulation.time
                if first or not self._paused:
                    self._on_run(first)
                first = False
            for command, source in self.goals.commands():
                self._apply_goal(command, source)
            snapshot = self._advance()
            if snapshot is not None:
                frame = self._prepare(snapshot)
                if paced:
                    self._wait(anchor[0] + (snapshot.time - anchor[1]) / self._factor)
                    if self._stopping.is_set():
                        break  # this frame is not due yet
                self._publish(frame)
            if stepping is not None and stepping.took(snapshot is not None):
                self._stepping.popleft()
            if self._paused:
                anchor = None

    def _advance(self) -> Snapshot | None:
        """Compute the next frame; a failed step pauses simulated time and reports a fault."""
        before = self._simulation.time
        try:
            snapshot = self._simulation.advance_to(before + self.frame_period)
        except SolverError as error:
            self.fault = str(error)
            self._paused = True
            self._on_fault(f"{error}; the twin is paused; reset it to continue")
            return None
        self.fault = ""
        report, statistics = snapshot.solver, self._statistics
        statistics.steps += report.steps
        statistics.iterations += report.iterations
        statistics.halvings += report.halvings
        statistics.constraint_residual = max(statistics.constraint_residual, report.constraint_residual)
        statistics.simulated += snapshot.time - before
        return snapshot

    def _wait(self, due: float) -> None:
        """Wait until a frame is due on the clock (s), and record its lateness."""
        self._clock.wait_until(due, self._stopping)
        if self._stopping.is_set():
            return  # this frame is not published
        late = self.behind = max(self._clock.now() - due, 0.0)
        self._statistics.lateness.add(late)
        self.total_lateness.add(late)

    def _handle_requests(self) -> None:
        """Handle queued requests, urgent commands first; later requests wait for the next boundary unless urgent."""
        for _ in range(len(self._requests)):
            while self._urgent:
                self._handle(*self._urgent.popleft())
            self._handle(*self._requests.popleft())
        while self._urgent:
            self._handle(*self._urgent.popleft())
        now = self._clock.now()
        silent = [name for name, deadline in self._deadlines.items() if now > deadline]
        if silent and not self._paused:
            self._apply(Command("speed", dict.fromkeys(silent, 0.0)), "command_timeout")

    def _handle(self, command: Command | Goal | Callable[[], Any], source: str, future: Future[Any]) -> None:
        """Handle one request, unless its future is cancelled."""
        if not future.set_running_or_notify_cancel():
            return
        if callable(command):
            future.set_result(command())
            return
        try:
            if isinstance(command, Goal):
                self._before_command()
                self.goals.take(command)
            applied = None if isinstance(command, Goal) else self._apply(command, source)
        except CommandError as error:
            future.set_exception(error)
        else:
            future.set_result(applied)

    def _apply_goal(self, command: Command, source: str) -> None:
        """Apply the speed due on the way to a goal; a refused speed abandons the goal."""
        try:
            self._apply(command, source)
        except CommandError as error:
            for name in command.values:
                self.goals.abandon(name, str(error))

    def _apply(self, command: Command, source: str) -> AppliedCommand:
        self._before_command()
        applied = self._simulation.apply(command, source)
        self.goals.note(command, source)
        if KINDS[command.kind].drives:
            self._start_timeout(command, source)
        elif KINDS[command.kind].halts:
            self._deadlines.clear()
            self._start_timeouts()
            if command.kind == "reset" and self.fault:
                self.fault = ""
                self._paused = False
        self._on_applied(applied)
        return applied

    def _start_timeouts(self) -> None:
        for command in self._simulation.commands.values():  # of a snapshot, or of a start in motion
            self._start_timeout(command, "")

    def _start_timeout(self, command: Command, source: str) -> None:
        """Start the time-out of a drive command; commands towards a goal have no time-out."""
        until = self._clock.now() + self.command_timeout
        for name, value in command.values.items():
            moving = value != 0.0 or command.kind == "force"  # without force it rolls on
            if moving and source not in (SOURCE, ARRIVAL):
                self._deadlines[name] = until
            else:
                self._deadlines.pop(name, None)
