"""Watches of a running twin that report each change once: limits of key figures, pace of frames, recorder."""

from __future__ import annotations

import threading
from typing import Any

from cable_twin.frame.records import AppliedCommand
from cable_twin.frame.snapshot import Snapshot
from cable_twin.key_figures import FigureId, KeyFigure, KeyFigures
from cable_twin.key_figures.rules import Judge, RuleError, RuleVerdict, profiles_of
from cable_twin.key_figures.rules.verdicts import BROKEN, sentence
from cable_twin.messages import Status
from cable_twin.messages.figure_messages import OK, WARNING, describe, figure_statuses
from cable_twin.recording.recorder import CAPACITY, Recorder
from cable_twin.runtime.frame_loop import FrameLoop
from cable_twin.runtime.run_clock import RunClock
from cable_twin.scenario import Scenario

TIMES = 10.0  # times the lateness that was logged last, at which it is logged again
LATE, ON_TIME = 1.0, 0.1  # s of lateness from which the twin has fallen behind, and below which it has caught up
LAG = 0.02  # s by which stamps are behind the clock after a pause, from which on it is logged
BEHIND = 2.0  # s of frames waiting for the disk, from which on it counts as slow


class FigureWatch:
    """Watch of the limits of key figures; updated by the solver's thread, read by another.

    Args:
        figures: gathers the key figures.
        scenario: scenario of the run, whose rule profiles are watched; None: none.
    """

    def __init__(self, figures: KeyFigures, scenario: Scenario | None = None) -> None:
        self._figures = figures
        self._broken: dict[tuple[str, str], RuleVerdict] = {}  # first verdict beyond a rule, by profile and check
        self._lock = threading.Lock()  # so that value, time and place of an extreme belong together
        self._passed: dict[FigureId, KeyFigure] = {}  # with the first value beyond the limit
        self._contacts: dict[tuple[str, str], float] = {}  # pair of vehicles -> time (s) of its last reported contact
        self._messages: list[str] = []
        try:
            self._judge = None if scenario is None else Judge(scenario, profiles_of(scenario))
        except RuleError as error:
            self._judge = None
            self._messages += [f"no rule profile is judged: {fault}" for fault in error.faults]

    def update(self, snapshot: Snapshot) -> None:
        """Update the watched key figures with a frame."""
        with self._lock:
            self._figures.update(snapshot)

    def command(self, applied: AppliedCommand) -> None:
        """Update the watched key figures with an applied command."""
        with self._lock:
            self._figures.command(applied)

    def limit(self, quantity: str, subject: str) -> float | None:
        """Limit of the key figure of a quantity and a subject, in its unit; None without such a figure or limit."""
        with self._lock:
            figures = self._figures.figures()
        return next((one.limit for one in figures if one.id[:2] == (quantity, subject)), None)

    def statuses(self) -> list[Status]:
        """Status of each key figure: a warning where a limit is not kept."""
        with self._lock:
            figures, touches = self._figures.figures(), self._figures.touches()
        for touch in touches:
            if self._contacts.get((touch.vehicle, touch.other)) != touch.time:
                self._contacts[touch.vehicle, touch.other] = touch.time
                self._messages.append(str(touch))
        for figure in figures:
            if figure.kept is False and figure.id not in self._passed:
                self._passed[figure.id] = figure
                self._messages.append(f"limit not kept: {figure.name}: {describe(figure)}")
        for one in [] if self._judge is None else self._judge.verdicts(figures):
            if one.state in BROKEN and (one.profile, one.check) not in self._broken:
                self._broken[one.profile, one.check] = one
                self._messages.append(f"rule of {one.profile}: {sentence(one)}")
        return figure_statuses(figures)

    def take_messages(self) -> list[str]:
        """New messages: a line for each figure that first does not keep its limit, and for vehicles in contact."""
        taken, self._messages = self._messages, []
        return taken

    def status(self) -> tuple[int, str, dict[str, str]]:
        """Level, message and figures for the task `limits`: a warning that names limits that are not kept."""
        values = {figure.name: describe(figure) for figure in self._passed.values()}
        values |= {f"{profile} {check}": sentence(one) for (profile, check), one in self._broken.items()}
        return (WARNING, f"limits not kept: {', '.join(values)}", values) if values else (OK, "all limits kept", {})


class PaceWatch:
    """Watch of the pace: logs when frames fall behind the clock, ten times as far or catch up, and when stamps depart.

    Args:
        logger: logger of the node.
        clock: clock of the run.
        loop: frame loop.
        real_time: whether simulated time is meant to run as fast as the clock.
    """

    def __init__(self, logger: Any, clock: RunClock, loop: FrameLoop, *, real_time: bool) -> None:
        self._logger, self._clock, self._loop, self._real_time = logger, clock, loop, real_time
        self._told = 0.0  # s, by which frames were behind when that was logged last; 0 after they have caught up

    def log_start(self, simulated_time: float, *, first: bool) -> None:
        """Log the lag of time stamps behind the clock where simulated time (s) starts, or continues after a pause."""
        behind = self._clock.behind(simulated_time)
        if self._real_time and behind > LAG:
            self._logger.info(
                f"simulated time {'starts' if first else 'continues'} at {simulated_time:.3f} s"
                f"{'' if first else ' after a pause'}; from now on time stamps are {behind:.3f} s behind the clock"
            )

    def check(self) -> dict[str, str]:
        """Log new departures from the clock; returns clock figures by their names in the diagnostics."""
        moved = self._clock.take_setting()
        behind = self._clock.behind(self._loop.simulated_time)
        if moved is not None:
            self._logger.warning(
                f"the clock of this machine was set by {moved:+.3f} s; time stamps continue without a jump and are now "
                f"{abs(behind):.3f} s {'behind' if behind > 0.0 else 'ahead of'} it"
            )
        late = self._loop.behind
        if late > max(LATE, TIMES * self._told):
            self._told = late
            self._logger.warning(f"falls behind the clock: {late:.1f} s late; no frame is skipped")
        elif self._told and late < ON_TIME:
            self._told = 0.0
            self._logger.info("has caught up with the clock")
        if self._clock.epoch_ns is None:
            return {}
        return {"stamps_behind_clock_s": f"{behind:.3f}"}


class RecordingWatch:
    """Watch of the recorder: logs each fault, a slow disk and its recovery once; checked about once a second.

    Attributes:
        fault: messages of the faults so far, empty without one.
    """

    def __init__(self, logger: Any, recorder: Recorder | None = None, frame_time: float = 0.0, fault: str = "") -> None:
        """Begin to watch a recorder.

        Args:
            logger: logger of the node.
            recorder: recorder of the run; None without recording.
            frame_time: clock time (s) between two frames; 0 where the disk sets the pace.
            fault: message why a wanted recording was not started, empty otherwise.
        """
        self.fault = fault
        self._logger = logger
        self._recorder = recorder
        self._frame_time = frame_time
        self._behind = False
        if fault:
            logger.error(fault)

    def check(self) -> None:
        """Log new faults and recoveries of the recording."""
        if self._recorder is None:
            return
        while self._recorder.faults:
            fault = self._recorder.faults.pop(0)
            if fault not in self.fault:  # all of them stay in the diagnostics, as a log that has ended
                self.fault = "; ".join(filter(None, (self.fault, fault)))
            self._logger.error(fault)
        waiting = self._recorder.backlog * self._frame_time
        if not self._behind and waiting > BEHIND:
            self._behind = True
            self._logger.warning(
                f"recording: the disk does not keep up: {waiting:.1f} s of frames wait in memory, which has room for "
                f"{CAPACITY * self._frame_time:.0f} s; the twin runs on"
            )
        elif self._behind and waiting < BEHIND / 2:
            self._behind = False
            missing = f"{self._recorder.dropped} frames are" if self._recorder.dropped else "nothing is"
            self._logger.info(f"recording: the disk has caught up; {missing} missing in the log")

    def problem(self) -> tuple[int, str] | None:
        """Level and message of a recording fault; None without one."""
        if self.fault:
            return 2, self.fault
        if self._recorder is not None and self._recorder.dropped:
            return 2, f"{self._recorder.dropped} frames are missing in the log: the disk was too slow"
        if self._behind:
            return 1, "the disk does not keep up with the log"
        return None

    def status(self) -> tuple[int, str, dict[str, str]]:
        """Level, message and figures of the recording for the diagnostics."""
        recorder = self._recorder
        level, message = self.problem() or (0, "nothing is recorded" if recorder is None else "all is recorded")
        if recorder is None:
            return level, message, {}
        values = {"log_backlog_frames": str(recorder.backlog), "log_dropped_frames": str(recorder.dropped)}
        return level, message, values
