"""Warnings about time stamps or frames that depart from the clock, logged once each, without rclpy but a logger."""

from __future__ import annotations

from typing import Any

from cable_twin.runtime.frame_loop import FrameLoop
from cable_twin.runtime.run_clock import RunClock

LATE, ON_TIME = 1.0, 0.1  # s: a twin later than that has fallen behind, one within this has caught up
MUCH = 0.02  # s by which stamps are behind that a pause has left


class PaceWatch:
    """Periodic comparison of simulated time and frames with the clock.

    Args:
        logger: of the node.
        clock: of the run.
        loop: the frames.
        real_time: whether simulated time runs as fast as the clock, so that stamps are to be on it.
    """

    def __init__(self, logger: Any, clock: RunClock, loop: FrameLoop, *, real_time: bool) -> None:
        self._logger, self._clock, self._loop, self._real_time = logger, clock, loop, real_time
        self._behind = False

    def tell_start(self, simulated_time: float) -> None:
        """Log the lag of time stamps behind the clock where simulated time (s) continues after a pause."""
        behind = self._clock.behind(simulated_time)
        if self._real_time and behind > MUCH:
            self._logger.info(
                f"simulated time continues at {simulated_time:.3f} s after a pause; from now on time stamps are "
                f"{behind:.3f} s behind the clock"
            )

    def look(self) -> dict[str, str]:
        """Log new departures from the clock; returns figures by their names in the diagnostics."""
        moved = self._clock.take_setting()
        behind = self._clock.behind(self._loop.simulated_time)
        if moved is not None:
            self._logger.warning(
                f"the clock of this machine was set by {moved:+.3f} s; time stamps continue without a jump and are now "
                f"{abs(behind):.3f} s {'behind' if behind > 0.0 else 'ahead of'} it"
            )
        late = self._loop.behind
        if not self._behind and late > LATE:
            self._behind = True
            self._logger.warning(f"falls behind the clock: {late:.1f} s late; no frame is skipped")
        elif self._behind and late < ON_TIME:
            self._behind = False
            self._logger.info("has caught up with the clock")
        if self._clock.epoch_ns is None:
            return {}
        return {"stamps_behind_clock_s": f"{behind:.3f}"}
