"""Statistics of the frame loop for the diagnostics: lateness in fine bins, and work of the solver."""

from __future__ import annotations

import math
import time
from itertools import pairwise

import numpy as np

RESOLUTION = 1e-5  # s, width of a bin
BIN_COUNT = 10_000  # up to 0.1 s; what is later is in the last one
LIMITS_MS = (0.5, 1.0, 2.0, 3.0, 5.0, 10.0)  # between the coarse bins of reports
COARSE_NAMES = (
    f"below_{LIMITS_MS[0]:g}_ms",
    *(f"{low:g}_to_{high:g}_ms" for low, high in pairwise(LIMITS_MS)),
    f"over_{LIMITS_MS[-1]:g}_ms",
)


class LatenessHistogram:
    """Histogram of the lateness of frames; one thread adds, others may read.

    Attributes:
        count: number of frames.
        missed: number of frames later than `period`.
        maximum: largest lateness (s).
    """

    def __init__(self, period: float) -> None:
        """Start empty; `period` (s, may be infinite) is the lateness beyond which a frame is missed."""
        self.count = 0
        self.missed = 0
        self.maximum = 0.0
        self._period = period
        self._counts = np.zeros(BIN_COUNT + 1, dtype=np.int64)

    def add(self, late: float) -> None:
        """Count one frame with a lateness (s), 0 where on time."""
        self._counts[min(int(late / RESOLUTION), BIN_COUNT)] += 1
        self.count += 1
        self.maximum = max(self.maximum, late)
        if late > self._period:
            self.missed += 1

    def percentile(self, percent: float) -> float:
        """Lateness (s) not exceeded by `percent` of the frames: upper edge of the histogram's bin."""
        if self.count == 0:
            return 0.0
        cumulated = np.cumsum(self._counts)
        place = int(np.searchsorted(cumulated, math.ceil(percent / 100.0 * cumulated[-1])))
        return self.maximum if place >= BIN_COUNT else min((place + 1) * RESOLUTION, self.maximum)

    def coarse(self) -> dict[str, int]:
        """Number of frames between the limits of `LIMITS_MS`, by names such as "0.5_to_1_ms"."""
        edges = [0, *(round(limit * 1e-3 / RESOLUTION) for limit in LIMITS_MS)]
        counts = np.add.reduceat(self._counts, edges)
        return {name: int(count) for name, count in zip(COARSE_NAMES, counts, strict=True)}

    def summary(self) -> dict[str, float]:
        """Lateness figures by their names in the diagnostics, coarse bins included."""
        return {
            "lateness_median_ms": self.percentile(50.0) * 1e3,
            "lateness_p99_ms": self.percentile(99.0) * 1e3,
            "lateness_p99.9_ms": self.percentile(99.9) * 1e3,
            "lateness_max_ms": self.maximum * 1e3,
            "frames": self.count,
            "missed_frames": self.missed,
            **{f"frames_late_{name}": count for name, count in self.coarse().items()},
        }


class FrameStatistics:
    """Counts of a frame loop since the last call of `take_statistics`."""

    def __init__(self, period: float) -> None:
        """Start empty; `period` (s, may be infinite) is the lateness beyond which a frame is missed."""
        self.lateness = LatenessHistogram(period)
        self.steps = self.iterations = self.halvings = 0
        self.constraint_residual = 0.0  # m, largest
        self.simulated = 0.0  # s
        self._since = time.monotonic()

    def summary(self) -> dict[str, float]:
        """Frame statistics by their names in the diagnostics."""
        elapsed = max(time.monotonic() - self._since, 1e-9)
        return {
            "real_time_factor": self.simulated / elapsed,
            **self.lateness.summary(),
            "newton_iterations_per_step": self.iterations / max(self.steps, 1),
            "halved_steps": self.halvings,
            "constraint_residual_m": self.constraint_residual,
        }
