"""Frame loop without ROS: pacing, its slices of a processor, lateness, time-out of commands, faults of the solver."""

from __future__ import annotations

import ctypes
import math
import os
import platform
import threading
import time
from itertools import pairwise

import numpy as np
import pytest
from frame_loops import SteppedClock, frame_loop
from hypothesis import given, settings
from hypothesis import strategies as st
from twin_process import PATIENCE, wait_until

from cable_twin.frame.records import Command
from cable_twin.runtime.frame_loop import ATTRIBUTES, SHORTEST, SYSTEM_CALLS, wake_promptly
from cable_twin.runtime.frame_statistics import BIN_COUNT, COARSE_NAMES, LIMITS_MS, RESOLUTION, LatenessHistogram
from cable_twin.runtime.run_clock import SteadyClock


def run_until(condition, loop):
    loop.start()
    try:
        wait_until(condition)
    finally:
        loop.stop()
    assert not loop.failed, loop.fault


def test_a_loop_that_is_held_up_catches_up_without_leaving_out_a_step():
    """Loop delayed by 0.3 s: all frames late until it has caught up with the clock."""
    clock, frames = SteppedClock(), []

    def take(snapshot):
        frames.append((clock.now(), snapshot.time, snapshot.solver.steps))
        if len(frames) == 50:
            clock.time += 0.3

    loop = frame_loop(publish=take, clock=clock)
    run_until(lambda: len(frames) >= 150, loop)
    assert [at for _, at, _ in frames] == pytest.approx([0.01 * (k + 1) for k in range(len(frames))], abs=1e-9)
    assert {steps for _, _, steps in frames} == {2}
    late = [now - 1000.0 - at for now, at, _ in frames]
    assert late[:50] == pytest.approx([0.0] * 50, abs=1e-9)
    assert late[50:80] == pytest.approx([0.29 - 0.01 * k for k in range(30)], abs=1e-9)
    assert late[80:] == pytest.approx([0.0] * (len(frames) - 80), abs=1e-9)  # caught up
    total = loop.total_lateness
    assert total.count == len(frames)
    assert 28 <= total.missed <= 29  # the one that is late by its period is by rounding
    assert total.maximum == pytest.approx(0.29)


def test_a_frame_is_prepared_ahead_and_published_when_it_is_due():
    """Encoding before the due time, so that it does not delay publication."""
    clock, prepared, published = SteppedClock(), [], []

    def prepare(snapshot):
        prepared.append(clock.now())
        clock.time += 4e-3
        return snapshot.time

    loop = frame_loop(prepare=prepare, publish=lambda at: published.append((at, clock.now() - 1000.0)), clock=clock)
    run_until(lambda: len(published) >= 30, loop)
    for at, now in published:
        assert now == pytest.approx(at, abs=1e-9)
    assert all(before + 0.01 == pytest.approx(after) for before, after in pairwise(prepared))
    assert loop.total_lateness.maximum < 1e-9


@pytest.mark.parametrize("factor", [1e-3, 1e-300])  # ten seconds from frame to frame, or for ever
def test_stopping_does_not_wait_for_a_distant_frame(factor):
    loop = frame_loop(real_time_factor=factor)
    loop.start()
    wait_until(lambda: loop.simulated_time > 0.0)  # the first frame is computed ahead
    begin = time.monotonic()
    loop.stop()
    assert time.monotonic() - begin < 2.0
    assert loop.total_lateness.count == 0
    assert not loop.failed


def test_the_clock_waits_until_it_is_time_or_it_is_interrupted():
    clock, interrupt = SteadyClock(), threading.Event()
    due = clock.now() + 0.08
    clock.wait_until(due, interrupt)
    assert clock.now() >= due
    waiting = threading.Thread(target=clock.wait_until, args=(clock.now() + 1e12, interrupt))
    waiting.start()
    interrupt.set()
    waiting.join(PATIENCE)
    assert not waiting.is_alive()


def silenced(applied):
    return [item for item in applied if item.source == "command_timeout"]


@pytest.mark.parametrize("before", [None, "release"])
def test_silence_stops_what_was_told_to_move_also_after_a_release_that_released_nothing(before):
    applied = []
    loop = frame_loop("single_span", on_applied=applied.append, command_timeout=0.3, clock=SteppedClock())
    loop.start()
    try:
        given = [loop.submit(Command("speed", {"cabin": 2.0}), "test")]
        if before is not None:  # at once, as the clock does not wait for answers
            given.append(loop.submit(Command(before, {}), "test"))
        for one in given:
            one.result(PATIENCE)
        wait_until(lambda: silenced(applied))
    finally:
        loop.stop()
    assert applied[-1].command == Command("speed", {"cabin": 0.0})
    assert applied[-1].time - applied[0].time == pytest.approx(0.3, abs=0.021)  # as computed ahead


def test_silence_stops_a_start_in_motion_also_after_a_reset():
    applied = []
    motion = {"carriages.cabin.speed": 2.0}
    loop = frame_loop(
        "single_span", on_applied=applied.append, command_timeout=0.2, overrides=motion, clock=SteppedClock()
    )
    loop.start()
    try:
        wait_until(lambda: silenced(applied))
        loop.submit(Command("reset", {}), "test").result(PATIENCE)
        wait_until(lambda: len(silenced(applied)) == 2)
    finally:
        loop.stop()
    assert applied[-1].command == Command("speed", {"cabin": 0.0})


def test_a_frame_that_converges_ends_the_fault():
    faults = []
    loop = frame_loop("seed_example", on_fault=faults.append)
    loop.start()
    try:
        loop.submit(Command("force", {"carriage": 1e9}), "test").result(PATIENCE)
        wait_until(lambda: loop.fault and loop.paused)
        loop.submit(Command("force", {"carriage": 0.0}), "test").result(PATIENCE)
        time_before = loop.simulated_time
        loop.step().result(PATIENCE)
        assert loop.simulated_time > time_before
        assert loop.fault == ""
    finally:
        loop.stop()
    assert len(faults) == 1


def test_it_tells_when_time_begins_to_run_and_when_it_goes_on():
    """Once at the start and after each pause; of single steps only a first one counts."""
    runs, published = [], []
    loop = frame_loop(on_run=runs.append, publish=published.append, paused=True)
    loop.start()
    loop.step().result(PATIENCE)
    assert runs == [True]
    for _ in range(3):
        loop.step().result(PATIENCE)
    assert runs == [True]
    assert len(published) == 4
    for count in (2, 3):
        loop.pause(False)
        wait_until(lambda count=count: len(runs) == count, what="a run that goes on")
        loop.pause(True)
        loop.step().result(PATIENCE)  # answered when the loop has seen the pause
    loop.stop()
    assert runs == [True, False, False]


def test_it_tells_of_a_command_before_that_changes_a_twin_that_waits_for_its_start():
    """Begin of the run before a command takes effect, also before the loop's own stop of a moving snapshot."""
    told, clock = [], SteppedClock()
    loop = frame_loop(
        "single_span",
        paused=True,
        on_run=told.append,
        before_command=lambda: told.append("command"),
        clock=clock,
    )
    loop._simulation.command("cabin", speed=2.0)
    loop.start()
    try:
        loop.submit(Command("emergency_stop", {}), "service").result(PATIENCE)
        assert told == ["command"]
        loop.submit(Command("release", {}), "service").result(PATIENCE)
        loop.submit(Command("speed", {"cabin": 2.0}), "test").result(PATIENCE)
        clock.time += 0.6
        loop.pause(False)
        wait_until(lambda: True in told, what="the start")
    finally:
        loop.stop()
    assert told[:4] == ["command"] * 4  # the last one for the silence


def test_steps_do_not_wait_for_the_clock_and_what_waits_is_done_between_them():
    applied, published = [], []
    loop = frame_loop(real_time_factor=1e-3, paused=True, on_applied=applied.append, publish=published.append)
    loop.start()
    try:
        assert loop.step(100).result(PATIENCE) == 100  # paced, that would be 1000 s
        assert loop.simulated_time == pytest.approx(1.0)
        many = loop.step(10**9)
        loop.submit(Command("wind", {"x": 3.0, "z": 0.0}), "test").result(PATIENCE)
        assert not many.done()
        loop.pause(True)
        assert 100 < 100 + many.result(PATIENCE) == len(published)
        assert applied[0].time < loop.simulated_time
        left = loop.step(10**9)
    finally:
        loop.stop()
    assert left.cancelled() or left.result() < 10**9


KERNEL = tuple(int(part) for part in platform.release().split("-")[0].split(".")[:2])
with_slices = pytest.mark.skipif(
    platform.machine() not in SYSTEM_CALLS or KERNEL < (6, 12), reason="Linux 6.12 on a known processor"
)


def attributes():
    """Nice value and slice (ns) of this thread by the system call sched_getattr."""
    buffer = ctypes.create_string_buffer(ATTRIBUTES.size)
    call = SYSTEM_CALLS[platform.machine()] + 1
    assert ctypes.CDLL(None).syscall(call, 0, buffer, ATTRIBUTES.size, 0) == 0
    _, _, _, nice, _, runtime, _, _ = ATTRIBUTES.unpack(buffer.raw)
    return nice, runtime


def in_a_thread(function):
    results = []
    thread = threading.Thread(target=lambda: results.append(function()))
    thread.start()
    thread.join()
    return results[0]


@with_slices
def test_only_the_calling_thread_gets_a_short_slice():
    before = attributes()
    assert before[1] != SHORTEST
    assert in_a_thread(lambda: (wake_promptly(), attributes())) == (True, (before[0], SHORTEST))
    assert attributes() == before


@with_slices
def test_a_nice_thread_stays_nice():
    def nice():
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), 19)
        return wake_promptly(), attributes()

    assert in_a_thread(nice) == (True, (19, SHORTEST))


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
