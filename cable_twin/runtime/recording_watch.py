"""Log messages of the node about its recording: once each for a fault, a slow disk, and its recovery."""

from __future__ import annotations

from typing import Any

from cable_twin.recording.recorder import CAPACITY, Recorder

BEHIND = 2.0  # s of frames that wait for the disk before it is called slow


class RecordingWatch:
    """Periodic check of a recorder, about once a second.

    Attributes:
        fault: the newest thing that failed, a line, or nothing.
    """

    def __init__(self, logger: Any, recorder: Recorder | None = None, frame_time: float = 0.0, fault: str = "") -> None:
        """Begin to watch a recorder.

        Args:
            logger: of the node.
            recorder: what is watched; None where nothing is recorded.
            frame_time: s of the clock between two frames; 0 where the disk sets the pace.
            fault: why nothing is recorded, if it should be.
        """
        self.fault = fault
        self._logger = logger
        self._recorder = recorder
        self._frame_time = frame_time
        self._behind = False
        if fault:
            logger.error(fault)

    def look(self) -> None:
        """Log new recording faults and recoveries."""
        if self._recorder is None:
            return
        while self._recorder.faults:
            self.fault = self._recorder.faults.pop(0)
            self._logger.error(self.fault)
        waiting = self._recorder.backlog * self._frame_time
        if not self._behind and waiting > BEHIND:
            self._behind = True
            self._logger.warning(
                f"recording: the disk does not keep up: {waiting:.1f} s wait in memory, where there is room for "
                f"{CAPACITY * self._frame_time:.0f} s; the twin goes on"
            )
        elif self._behind and waiting < BEHIND / 2:
            self._behind = False
            missing = f"{self._recorder.dropped} frames are" if self._recorder.dropped else "nothing is"
            self._logger.info(f"recording: the disk has caught up; {missing} missing in the log")

    def judge(self) -> tuple[int, str] | None:
        """Level and message of a recording fault; None without one."""
        if self.fault:
            return 2, self.fault
        if self._recorder is not None and self._recorder.dropped:
            return 2, f"{self._recorder.dropped} frames are missing in the log: the disk was too slow"
        if self._behind:
            return 1, "the disk does not keep up with the log"
        return None

    def judged(self) -> tuple[int, str, dict[str, str]]:
        """Level, message and figures for the diagnostics."""
        recorder = self._recorder
        level, message = self.judge() or (0, "nothing is recorded" if recorder is None else "all is recorded")
        if recorder is None:
            return level, message, {}
        return (
            level,
            message,
            {
                "log_backlog_frames": str(recorder.backlog),
                "log_dropped_frames": str(recorder.dropped),
            },
        )
