"""The histogram of lateness against numpy, and a frame loop that is held up: late, but without a step left out."""

from __future__ import annotations

import math
import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cable_twin.ros.frame_loop import FrameLoop
from cable_twin.ros.lateness import BIN_COUNT, COARSE_NAMES, LIMITS_MS, RESOLUTION, LatenessHistogram
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation


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


def test_a_loop_that_is_held_up_catches_up_without_leaving_out_a_step():
    """Hold the loop for 0.3 s: frames then come late, every one of them, until the clock is caught."""
    simulation = Simulation(load_scenario("aerial_tramway", {"cable.elements": 10}))
    frames = []

    def take(snapshot):
        frames.append((time.monotonic(), snapshot.time, snapshot.solver.steps))
        if len(frames) == 50:
            time.sleep(0.3)

    faults = []
    loop = FrameLoop(
        simulation,
        frame_steps=2,
        real_time_factor=1.0,
        command_timeout=0.5,
        on_frame=take,
        on_applied=lambda applied: None,
        on_fault=faults.append,
    )
    begin = time.monotonic()
    loop.start()
    while len(frames) < 150 and time.monotonic() - begin < 20.0:
        time.sleep(0.01)
    loop.stop()
    assert not faults
    assert np.diff([at for _, at, _ in frames]) == pytest.approx(loop.frame_period, abs=1e-9)
    assert {steps for _, _, steps in frames} == {2}
    total = loop.total_lateness
    assert total.count == len(frames)
    assert total.missed >= 20  # 0.3 s are 30 frames of which the first is due as it began, and the last not missed
    assert total.maximum > 0.25
    clock, simulated, _ = frames[-1]
    if total.percentile(50.0) < 1e-3:  # a machine that is not itself behind
        assert clock - frames[0][0] == pytest.approx(simulated, abs=0.1)  # caught up


def test_stopping_does_not_wait_for_a_distant_frame():
    simulation = Simulation(load_scenario("aerial_tramway", {"cable.elements": 10}))
    loop = FrameLoop(
        simulation,
        frame_steps=2,
        real_time_factor=1e-3,  # ten seconds from frame to frame
        command_timeout=0.5,
        on_frame=lambda snapshot: None,
        on_applied=lambda applied: None,
        on_fault=lambda line: None,
    )
    loop.start()
    time.sleep(0.2)
    begin = time.monotonic()
    loop.stop()
    assert time.monotonic() - begin < 2.0
    assert loop.total_lateness.count <= 1
