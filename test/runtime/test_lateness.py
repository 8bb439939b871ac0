"""Histogram of lateness against numpy."""

from __future__ import annotations

import math
import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cable_twin.runtime.frame_statistics import BIN_COUNT, COARSE_NAMES, LIMITS_MS, RESOLUTION, LatenessHistogram


@settings(max_examples=50, deadline=None)
@given(
    st.lists(st.floats(0.0, 0.09), min_size=1, max_size=200),
    st.sampled_from([1.0, 50.0, 99.0, 99.9, 100.0]),
)
def test_percentiles_are_those_of_numpy_to_a_bin(lateness, percent):
    histogram = LatenessHistogram(0.01)
    for late in lateness:
        histogram.add(late)
    expected = np.percentile(lateness, percent, method="inverted_cdf")
    assert histogram.percentile(percent) == pytest.approx(expected, abs=1.01 * RESOLUTION)
    assert histogram.maximum == max(lateness)
    assert histogram.missed == sum(late > 0.01 for late in lateness)
    assert sum(histogram.coarse().values()) == histogram.count == len(lateness)


def test_every_frame_is_in_its_bin():
    histogram = LatenessHistogram(math.inf)
    for frames, limit in enumerate(LIMITS_MS, start=1):
        for _ in range(frames):
            histogram.add((limit - 0.2) * 1e-3)
    for _ in range(20):
        histogram.add(7.0)  # far beyond the last bin
    assert list(histogram.coarse().values()) == [*range(1, len(LIMITS_MS) + 1), 20]
    assert list(histogram.coarse()) == list(COARSE_NAMES)
    assert histogram.percentile(99.9) == 7.0
    assert histogram.missed == 0


def test_without_frames_there_is_nothing_late():
    figures = LatenessHistogram(0.01).summary()
    assert set(figures.values()) == {0.0}


def test_it_costs_the_same_after_hours():
    histogram = LatenessHistogram(0.01)
    started = time.perf_counter()
    for _ in range(20_000):
        histogram.add(1e-4)
    assert (time.perf_counter() - started) / 20_000 < 100e-6
    assert histogram._counts.size == BIN_COUNT + 1
