"""Statistics of a frame loop, for the diagnostics."""

from __future__ import annotations

import time
from dataclasses import dataclass, field

from cable_twin.runtime.lateness import LatenessHistogram


@dataclass(slots=True)
class FrameStatistics:
    """Counts of a frame loop since the last call of `take_statistics`."""

    lateness: LatenessHistogram
    steps: int = 0
    iterations: int = 0
    halvings: int = 0
    constraint_residual: float = 0.0  # m, worst
    simulated: float = 0.0  # s
    since: float = field(default_factory=time.monotonic)

    def summary(self) -> dict[str, float]:
        """Figures by their names in the diagnostics."""
        elapsed = max(time.monotonic() - self.since, 1e-9)
        return {
            "real_time_factor": self.simulated / elapsed,
            **self.lateness.summary(),
            "newton_iterations_per_step": self.iterations / max(self.steps, 1),
            "halved_steps": self.halvings,
            "constraint_residual_m": self.constraint_residual,
        }


__all__ = ["FrameStatistics"]
