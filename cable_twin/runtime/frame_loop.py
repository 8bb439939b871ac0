"""Real-time frame loop in the solver's thread: frames at absolute deadlines, commands at frame boundaries, no rclpy.

A frame is computed and encoded ahead and published when its simulated time is due, so that lateness is that of the
clock and not of the solver. A command takes effect at the boundary after its arrival. No step is ever skipped: a loop
that is late computes without waiting until it has caught up.
"""

from __future__ import annotations

import math
import threading
import time
import traceback
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any

from cable_twin.frame.commands import KINDS
from cable_twin.frame.records import AppliedCommand, Command, CommandError, Goal
from cable_twin.frame.snapshot import Snapshot
from cable_twin.runtime.frame_statistics import FrameStatistics
from cable_twin.runtime.goals import ARRIVAL, SOURCE, Goals
from cable_twin.runtime.lateness import LatenessHistogram
from cable_twin.runtime.stepping import Stepping
from cable_twin.runtime.time_slice import wake_promptly
from cable_twin.simulation import Simulation, SolverError
from cable_twin.simulation.snapshot_file import FullState

IDLE = 0.5  # s between two looks at the queue while paused and nobody wakes the loop
SHORT = 0.05  # s that the end of a run may have to wait for
_Request = tuple[Command | Goal | Callable[[], Any], str, Future[Any]]


class FrameLoop:
    """Real-time loop of a simulation: frame by frame, in its own thread.

    Args:
        simulation: whose only user this becomes.
        frame_steps: solver steps in a frame.
        real_time_factor: simulated seconds a second, 0 for as fast as possible.
        command_timeout: s of the clock after which a carriage that was told to move is told to stop.
        on_run: called where time begins to run, first with True, after a pause with False; not for steps while paused.
        prepare: called with every new snapshot as soon as it is computed; the one to start from is not new.
        publish: called with what `prepare` gave, when it is due.
        before_command: called before a command takes effect, be it the first thing that happens to a paused twin.
        on_applied: called with every command as it takes effect, before the frame that shows it.
        on_fault: called with a line about what failed.
        on_goal: called with a line about a goal that is reached, and with True where it is given up.
        paused: wait for `pause(False)` or `step`.
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
    ) -> None:
        self.command_timeout = command_timeout
        self.frame_period = frame_steps * simulation.step
        self.fault = ""  # why the twin stands still, if it does
        self.failed = False  # by a fault of the program; the thread has ended
        self.behind = 0.0  # s, how late the newest frame was
        self._simulation = simulation
        self._factor = real_time_factor
        self._on_run, self._prepare, self._publish = on_run, prepare, publish
        self._before_command, self._on_applied, self._on_fault = before_command, on_applied, on_fault
        self._paused = paused
        self.goals = Goals(simulation, on_goal)
        self._requests: deque[_Request] = deque()  # what the loop does between frames
        self._urgent: deque[_Request] = deque()  # and what it does before that
        self._stepping: deque[Stepping] = deque()  # frames that are asked for while paused
        self._deadlines: dict[str, float] = {}  # carriages told to move, and until when that holds
        self._clock_period = self.frame_period / real_time_factor if real_time_factor > 0.0 else math.inf
        self.total_lateness = LatenessHistogram(self._clock_period)  # since the start
        self._statistics = FrameStatistics(LatenessHistogram(self._clock_period))
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
    def urgent(self) -> bool:
        """Whether urgent commands wait for the next frame boundary."""
        return bool(self._urgent)

    @property
    def simulated_time(self) -> float:
        """Simulated time (s) of the newest computed frame."""
        return self._simulation.snapshot.time

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    def stop(self) -> None:
        """End the thread after the present frame; waiting requests are cancelled."""
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
        """Queue a command; the future gives the applied command, None for a goal, or the `CommandError`.

        At a frame boundary an `urgent` one goes before all that are not.
        """
        return self._ask(command, source, self._urgent if urgent else self._requests)

    def pause(self, paused: bool) -> None:
        """Pause simulated time, stepping included, or resume."""
        self._paused = paused
        for stepping in tuple(self._stepping) if paused else ():
            stepping.count = 0
        self._asked.set()

    def step(self, count: int = 1, on_frame: Callable[[int], bool] | None = None) -> Future[int]:
        """Compute frames while paused, as fast as possible; the future gives the number, fewer on a fault or pause.

        After each one `on_frame` gets how many there were, and says whether to go on.
        """
        stepping = Stepping(count, on_frame)
        self._stepping.append(stepping)
        self._asked.set()
        return stepping.future

    def capture(self) -> Future[FullState]:
        """Copy the full state at the next frame boundary."""
        return self.call(self._simulation.capture)

    def call(self, function: Callable[[], Any]) -> Future[Any]:
        """Call a function that raises nothing at the next frame boundary; the future gives its result."""
        return self._ask(function, "")

    def _ask(
        self, command: Command | Goal | Callable[[], Any], source: str, queue: deque[_Request] | None = None
    ) -> Future[Any]:
        future: Future[Any] = Future()
        (self._requests if queue is None else queue).append((command, source, future))
        self._asked.set()
        return future

    def take_statistics(self) -> FrameStatistics:
        """Frame statistics since the last call."""
        taken, self._statistics = self._statistics, FrameStatistics(LatenessHistogram(self._clock_period))
        return taken

    def _guard(self) -> None:
        """Report an exception that ends the thread, which the node would otherwise outlive in silence."""
        wake_promptly()
        try:
            self._run()
        except Exception as error:
            self.fault = f"fault of the program: {error!r}"
            self._on_fault("".join(traceback.format_exception(error)).rstrip())
            self.failed = True

    def _run(self) -> None:
        self._hold_all()
        anchor: tuple[float, float] | None = None  # clock and simulated time between which pacing counts
        first = True
        while not self._stopping.is_set():
            if self._urgent or self._requests or self._deadlines:
                self._obey()
            stepping = self._stepping[0] if self._stepping else None
            if self._paused and stepping is None:
                anchor = None
                self._asked.wait(IDLE)
                self._asked.clear()
                continue
            paced = self._factor > 0.0 and not self._paused
            if anchor is None:
                anchor = time.monotonic(), self._simulation.time
                if first or not self._paused:
                    self._on_run(first)
                first = False
            for command, source in self.goals.commands():
                self._drive(command, source)
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
            self._on_fault(f"{error}; the twin is paused, reset it to go on")
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
        remaining = due - time.monotonic()
        if remaining > SHORT:
            self._stopping.wait(min(remaining - SHORT, threading.TIMEOUT_MAX))
            remaining = due - time.monotonic()
        if remaining > 0.0 and not self._stopping.is_set():
            time.sleep(remaining)  # wakes more exactly than an event, which takes a lock and gives it back
        if self._stopping.is_set():
            return  # nobody gets to see this frame
        late = self.behind = max(time.monotonic() - due, 0.0)
        self._statistics.lateness.add(late)
        self.total_lateness.add(late)

    def _obey(self) -> None:
        """Handle queued requests, urgent commands first; later requests wait for the next boundary unless urgent."""
        for _ in range(len(self._requests)):
            while self._urgent:
                self._do(*self._urgent.popleft())
            self._do(*self._requests.popleft())
        while self._urgent:
            self._do(*self._urgent.popleft())
        now = time.monotonic()
        silent = [name for name, deadline in self._deadlines.items() if now > deadline]
        if silent and not self._paused:
            self._apply(Command("speed", dict.fromkeys(silent, 0.0)), "command_timeout")

    def _do(self, command: Command | Goal | Callable[[], Any], source: str, future: Future[Any]) -> None:
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

    def _drive(self, command: Command, source: str) -> None:
        """Apply the due speed of a goal."""
        try:
            self._apply(command, source)
        except CommandError as error:
            for name in command.values:
                self.goals.give_up(name, str(error))

    def _apply(self, command: Command, source: str) -> AppliedCommand:
        self._before_command()
        applied = self._simulation.apply(command, source)
        self.goals.note(command, source)
        if KINDS[command.kind].drives:
            self._hold(command, source)
        elif KINDS[command.kind].halts:
            self._deadlines.clear()
            self._hold_all()
            if command.kind == "reset" and self.fault:
                self.fault = ""
                self._paused = False
        self._on_applied(applied)
        return applied

    def _hold_all(self) -> None:
        for command in self._simulation.commands.values():  # of a snapshot, or of a start in motion
            self._hold(command, "")

    def _hold(self, command: Command, source: str) -> None:
        """Start the time-out of a drive command; commands towards a goal have no time-out."""
        until = time.monotonic() + self.command_timeout
        for name, value in command.values.items():
            if source not in (SOURCE, ARRIVAL) and (
                value != 0.0 or command.kind == "force"
            ):  # without force it rolls on
                self._deadlines[name] = until
            else:
                self._deadlines.pop(name, None)
