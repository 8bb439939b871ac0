"""Waves in what a sensor measures: how much of them is left in the mean of a window."""

from __future__ import annotations

import numpy as np
import pytest

from cable_twin.ensemble.estimate.scatter import SLOWER, Scatter

NOISE, WAVES, WINDOW = 100.0, 300.0, 2.0  # N, standard deviations; s
TIMES = np.arange(20) * 0.1  # s, in a window


def _after(period: float, windows: int = 12) -> Scatter:
    """Scatter after some windows with noise and waves of a period (s)."""
    scatter, draws = Scatter(["force"]), np.random.default_rng(1)
    for number in range(windows):
        phase = 2.0 * np.pi * (number * WINDOW + TIMES) / period + 0.3 * number
        seen = 2.0**0.5 * WAVES * np.sin(phase) + NOISE * draws.standard_normal(TIMES.size)
        scatter.note(WINDOW, ["force"] * TIMES.size, seen, np.full(TIMES.size, NOISE**2), seen)
    return scatter


def test_waves_shorter_than_a_window_are_nearly_as_independent_samples():
    scatter = _after(1.0)
    assert scatter.unexplained("force") == pytest.approx(WAVES**2, rel=0.4)
    assert scatter.unexplained("force") <= scatter.lasting("force") < 0.2 * SLOWER**2 * WAVES**2


def test_waves_longer_than_a_window_count_in_its_mean():
    assert _after(6.0).lasting("force") > 0.5 * SLOWER**2 * _after(6.0).unexplained("force")


def test_waves_that_are_expected_count_as_long_ones_until_windows_show_them():
    scatter = Scatter(["force"])
    scatter.stir({"force": WAVES})
    assert scatter.lasting("force") == pytest.approx(SLOWER**2 * WAVES**2)
