"""Kernel calls of some tenths of a second at most, so that Ctrl-C and progress work."""

from __future__ import annotations

import signal
import time
from io import StringIO

import pytest
from rich.console import Console
from twin_process import COMPILING, TwinProcess, wait_until

from cable_twin.mechanics.solution import relaxation
from cable_twin.offline.scripted_run import simulate
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation, twin
from cable_twin.simulation.engine import watching_relaxation
from cable_twin.terminal.bars import compilation_shown

HEARD = 1.0  # s within which Ctrl-C is, and what a busy machine adds
BUSY = 2.0  # s
NAMES = "seed_example", "windy_tramway", "chairlift", "jig_back"  # one rope and several, in a plane and in space


class EndedError(Exception):
    """End of a run ordered by the test."""


@pytest.mark.parametrize("name", NAMES)
def test_parts_give_the_same_bits_and_may_end_a_run(name, monkeypatch):
    whole, split = (Simulation(load_scenario(name)) for _ in range(2))
    end = 40 * whole.step
    expected = whole.advance_to(end).numbers
    monkeypatch.setattr(twin, "PART", 1)
    calls = []
    assert split.advance_to(end, lambda: calls.append(split.time)).numbers.tobytes() == expected.tobytes()
    assert len(calls) == 40

    def end_soon():
        if split.time > end + 2.5 * split.step:
            raise EndedError

    with pytest.raises(EndedError):
        split.advance_to(2.0 * end, end_soon)
    assert split.time == pytest.approx(end + 3 * split.step)
    assert split.snapshot.time == split.time  # what is read is what it has come to
    assert split.advance_to(2.0 * end).numbers.tobytes() == whole.advance_to(2.0 * end).numbers.tobytes()


@pytest.mark.parametrize("name", NAMES)
def test_a_rest_in_parts_has_the_same_bits_and_tells_how_far_it_is(name, monkeypatch):
    scenario = load_scenario(name)
    expected = Simulation(scenario).snapshot.numbers
    monkeypatch.setattr(relaxation, "PART", 1)
    moments = []
    with watching_relaxation(moments.append):
        assert Simulation(scenario).snapshot.numbers.tobytes() == expected.tobytes()
    assert len(moments) > 5
    assert all(0.0 <= moment.share <= 1.0 and moment.remaining >= 0.0 for moment in moments)

    def end(_):
        raise EndedError

    with pytest.raises(EndedError), watching_relaxation(end):
        Simulation(scenario)


def test_a_large_mesh_says_how_long_its_start_may_take(monkeypatch):
    monkeypatch.setattr("cable_twin.terminal.bars.SETTLING_TIME", 0.0)
    monkeypatch.setattr("cable_twin.terminal.bars.LARGE", 30)
    monkeypatch.setattr(relaxation, "PART", 1)
    lines, output = [], StringIO()
    with compilation_shown(Console(file=output, force_terminal=False), lines.append):
        Simulation(load_scenario("single_span", {"cable.elements": 30}))
    said = [line for line in lines if line.startswith("the rope settles: 30 elements, 1 iterations, at most ")]
    assert len(said) == 1


def test_a_run_ends_within_a_frame_that_is_long():
    simulation, asked = Simulation(load_scenario("seed_example")), []

    def ended() -> bool:
        asked.append(simulation.time)
        return simulation.time > 20.0

    outcome = simulate(simulation, [], duration=1e5, frame_steps=round(1e4 / simulation.step), epoch_ns=0, ended=ended)
    assert outcome.fault == "ended by a signal"
    assert 20.0 < outcome.time < 60.0
    assert outcome.wall_time < COMPILING


@pytest.mark.long
def test_ctrl_c_is_heard_while_a_large_mesh_settles(tmp_path):
    arguments = ["single_span", "--set", "cable.elements=60000", "--record", "off"]
    process = TwinProcess(tmp_path, *arguments, module="offline.simulate")
    try:
        wait_until(lambda: "the rope settles: 60000 elements" in process.output, COMPILING)
        since = time.monotonic()
        process.send(signal.SIGINT)
        assert process.wait() == 130
        assert time.monotonic() - since < HEARD + BUSY
    finally:
        process.kill()
    assert process.output.endswith("simulate: ended before it had started\n")
