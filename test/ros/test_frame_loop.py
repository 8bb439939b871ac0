"""The frame loop without ROS: pacing, silence of whoever drives, and faults of the solver."""

from __future__ import annotations

import time

import numpy as np
import pytest
from twin_process import PATIENCE, wait_until

from cable_twin.frame.records import Command
from cable_twin.runtime.frame_loop import FrameLoop
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation


def frame_loop(scenario="aerial_tramway", *, overrides=None, **options):
    """A loop of a small simulation whose callbacks do nothing where they are not given."""
    simulation = Simulation(load_scenario(scenario, {"cable.elements": 10, **(overrides or {})}))
    defaults = {
        "frame_steps": 2,
        "real_time_factor": 1.0,
        "command_timeout": 0.5,
        "on_run": lambda first: None,
        "prepare": lambda snapshot: snapshot,
        "publish": lambda frame: None,
        "before_command": lambda: None,
        "on_applied": lambda applied: None,
        "on_fault": lambda line: None,
    }
    return FrameLoop(simulation, **{**defaults, **options})


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
        on_run=lambda first: None,
        prepare=lambda snapshot: snapshot,
        publish=take,
        before_command=lambda: None,
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


@pytest.mark.parametrize("factor", [1e-3, 1e-300])  # ten seconds from frame to frame, or for ever
def test_stopping_does_not_wait_for_a_distant_frame(factor):
    loop = frame_loop(real_time_factor=factor)
    loop.start()
    time.sleep(0.2)
    begin = time.monotonic()
    loop.stop()
    assert time.monotonic() - begin < 2.0
    assert loop.total_lateness.count <= 1
    assert not loop.failed


@pytest.mark.parametrize("before", [None, "release"])
def test_silence_stops_what_was_told_to_move_also_after_a_release_that_released_nothing(before):
    applied = []
    loop = frame_loop("single_span", on_applied=applied.append, command_timeout=0.3)
    loop.start()
    try:
        loop.submit(Command("speed", {"cabin": 2.0}), "test").result(PATIENCE)
        if before is not None:
            loop.submit(Command(before, {}), "test").result(PATIENCE)
        wait_until(lambda: [item for item in applied if item.source == "command_timeout"])
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


def test_a_frame_is_prepared_ahead_and_published_when_it_is_due():
    """What encoding takes does not come on top of the time at which a frame is published."""
    prepared, published = [], []

    def prepare(snapshot):
        prepared.append(time.monotonic())
        return snapshot.time

    loop = frame_loop(prepare=prepare, publish=lambda at: published.append((at, time.monotonic())))
    loop.start()
    wait_until(lambda: len(published) >= 30, what="30 frames")
    loop.stop()
    assert [at for at, _ in published] == pytest.approx([0.01 * (k + 1) for k in range(len(published))], abs=1e-9)
    ahead = [after - before for before, (_, after) in zip(prepared, published, strict=False)]
    assert max(ahead) > 2e-3  # a frame takes far less than its period


def test_it_tells_when_time_begins_to_run_and_when_it_goes_on():
    """Once at the start and after each pause; single steps are no run, but a first one is the start."""
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
    """Also of its own stop of what a snapshot has moving: the run has to begin before, with the state as it was."""
    told = []
    loop = frame_loop(
        "single_span",
        paused=True,
        command_timeout=0.05,
        on_run=told.append,
        before_command=lambda: told.append("command"),
    )
    loop._simulation.command("cabin", speed=2.0)
    loop.start()
    try:
        loop.submit(Command("emergency_stop", {}), "service").result(PATIENCE)
        assert told == ["command"]
        loop.submit(Command("release", {}), "service").result(PATIENCE)
        loop.submit(Command("speed", {"cabin": 2.0}), "test").result(PATIENCE)
        time.sleep(0.1)
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


def test_silence_stops_a_start_in_motion_also_after_a_reset():
    applied = []
    loop = frame_loop(
        "single_span", on_applied=applied.append, command_timeout=0.2, overrides={"carriages.cabin.speed": 2.0}
    )
    loop.start()
    try:
        wait_until(lambda: [item for item in applied if item.source == "command_timeout"])
        loop.submit(Command("reset", {}), "test").result(PATIENCE)
        wait_until(lambda: len([item for item in applied if item.source == "command_timeout"]) == 2)
    finally:
        loop.stop()
    assert applied[-1].command == Command("speed", {"cabin": 0.0})
