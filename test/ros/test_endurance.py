"""Short part of `verification.endurance`: memory, lateness and a complete log over many frames."""

from __future__ import annotations

import pytest

pytest.importorskip("rclpy")

from verification.endurance import FRAME_RATE, run

pytestmark = pytest.mark.long

HOURS = 0.03  # of simulated time


def test_many_frames_are_all_in_the_log(tmp_path, domain):
    seen: list[float] = []
    result = run(HOURS, 40.0, tmp_path, domain, seen.append)
    print("\n".join(result.lines()))
    assert seen == sorted(seen)
    assert result.hours >= HOURS
    assert result.frames >= 3600.0 * HOURS * FRAME_RATE
    assert (result.missing, result.dropped) == (0, 0)
    assert result.memory[1] - result.memory[0] < 60.0  # MB; the first seconds fill caches
