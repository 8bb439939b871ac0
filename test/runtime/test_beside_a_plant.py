"""Twin that follows a plant: no outlook begins while it makes up for a distance; it is not well while it is late."""

from __future__ import annotations

import time
from concurrent.futures import Future
from io import BytesIO
from types import SimpleNamespace

import numba
import numpy as np
import pytest
from twin_process import wait_until

from cable_twin.ensemble.estimate.tracker import WAITING
from cable_twin.frame.records import TensionAhead
from cable_twin.frame.sensors import standard_sensors
from cable_twin.messages import READMITTED
from cable_twin.messages.texts import readmitted_message
from cable_twin.runtime.companion import receive
from cable_twin.runtime.follow_process import Decoder, compilation_told
from cable_twin.runtime.following import COMPILING, FOLLOWING, MOST_LINES, STARTING, Arrival, Estimated, LiveFollowing
from cable_twin.runtime.outlook import Answer, LiveOutlook, Question
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation
from cable_twin.simulation.first_compilation import watching_compilation

COARSE = {"cable.elements": {"target": 20.0, "at_towers": 6.0, "growth": 1.7}}  # for speed


@pytest.mark.parametrize("passing", [[True, True, False], [False]])
def test_no_outlook_begins_while_a_speed_will_not_last(passing, monkeypatch):
    """The process ends with its first question; the state is looked at until one may be asked, and the answer late."""
    simulation, captured, answers = Simulation(load_scenario("aerial_tramway", COARSE)), [], iter(passing)

    def capture():
        captured.append(future := Future())
        future.set_result(simulation.capture())
        return future

    outlook = LiveOutlook(
        simulation,
        SimpleNamespace(capture=capture),
        stamp_ns=lambda time: round(1e9 * time),
        publish=pytest.fail,
        warn=pytest.fail,
        horizon=60.0,
        rate=1000.0,
        gust=10.0,
        passing=lambda: next(answers),
    )
    questions = BytesIO()
    outlook.talk(questions, BytesIO())
    questions.seek(0)
    assert receive(questions)["horizon"] == 60.0
    assert isinstance(receive(questions), Question)
    assert receive(questions) is None
    assert len(captured) == len(passing)
    assert outlook.status()[:2] == (True, "starts")
    now = time.monotonic()
    monkeypatch.setattr(time, "monotonic", lambda: now + 65.0)
    well, said, _ = outlook.status()
    assert not well
    assert said.startswith("an outlook takes more than 65 s, as this machine is too slow beside the twin")


@pytest.mark.parametrize(
    ("now", "said"), [(64.0, "outlook from 62.73 s: "), (68.0, "outlook from 62.73 s, there only at ")]
)
def test_a_warning_that_comes_after_the_event_says_so(now, said):
    lines, published = [], []
    outlook = LiveOutlook(
        SimpleNamespace(scenario=load_scenario("aerial_tramway"), time=now),
        SimpleNamespace(),
        stamp_ns=round,
        publish=published.append,
        warn=lines.append,
        horizon=60.0,
        rate=1.0,
        gust=10.0,
    )
    ahead = TensionAhead(62.73, np.zeros(1), np.zeros(1))
    for _ in range(2):
        outlook._take(Answer(62.73, b"", {"swing": (64.33, "as commanded: swing")}, ahead))
    (line,) = lines
    assert line.startswith(said)
    assert line.endswith(": as commanded: swing")
    assert len(published) == 2


@pytest.mark.parametrize(("behind", "well", "said"), [(4.0, True, "follows"), (19.0, False, "19 s behind the plant")])
def test_a_twin_that_is_behind_its_plant_is_not_well(behind, well, said):
    following = LiveFollowing(load_scenario("aerial_tramway"), pytest.fail, pytest.fail, pytest.fail)
    following._note(Estimated(7.0, b"", (), FOLLOWING, {}, {}, behind))
    assert following.status()[0] == well
    assert following.status()[1].endswith(said)


def test_alarms_about_payloads_do_not_push_out_others():
    lines: list[str] = []
    following = LiveFollowing(load_scenario("chairlift"), pytest.fail, pytest.fail, lines.append)
    stuck, wrong = "3.0 s: sensor a is stuck", "9.0 s: sensor b is wrong"
    following._note(Estimated(3.0, b"", (stuck,), FOLLOWING, {}, {}))
    for number in range(2 * MOST_LINES):
        told = (f"{number + 4} s: chair_{number}/payload is 1 kg",)
        following._note(Estimated(number + 4.0, b"", (wrong,) if number == 7 else (), FOLLOWING, {}, {}, 0.0, told))
    kept = [text for key, text in following.status()[2].items() if key.startswith("alarm_")]
    assert len(kept) == MOST_LINES
    assert kept[:2] == [stuck, wrong]
    assert kept[-1] == lines[-1] == told[0]
    assert len(lines) == 2 + 2 * MOST_LINES


def test_an_estimator_that_stands_still_is_behind_its_plant(monkeypatch):
    following = LiveFollowing(load_scenario("aerial_tramway"), pytest.fail, pytest.fail, pytest.fail)
    following._note(Estimated(7.0, b"", (), FOLLOWING, {}, {}))
    assert following.status()[:2] == (True, "follows")
    now = time.monotonic()
    monkeypatch.setattr(time, "monotonic", lambda: now + 65.0)
    assert following.status()[:2] == (False, "follows; 60 s behind the plant")


def test_an_estimator_tells_that_it_starts_and_what_it_waits_for():
    """In its own process; it is not well meanwhile, as nothing is estimated."""
    bare, lines = load_scenario("aerial_tramway", COARSE), []
    sensors = standard_sensors(bare, Simulation(bare).snapshot)
    following = LiveFollowing(
        load_scenario(bare.resolved(), {"sensors": sensors}), pytest.fail, lines.append, pytest.fail
    )
    assert following.status()[:2] == (False, STARTING)
    following.start()
    wait_until(lambda: following.status()[1] == WAITING, 600.0)
    following.stop()
    assert not following.status()[0]
    first, *compiles, ready = lines
    assert first == "the estimator starts: a line says when it has found the plant and estimates begin"
    assert not any("follows the plant" in line for line in lines)  # for which README says to wait
    assert len(compiles) <= 1
    assert ready == "the estimator is ready: it begins when the plant stands still for 1 s"


@pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="nothing is compiled")
def test_an_estimator_tells_once_that_it_compiles():
    """Of kernels that are compiled here, one after the other until it has told."""
    sink = BytesIO()

    def compile_one():
        numba.njit(lambda x: x + 1.0)(1.0)
        return sink.tell()

    looks = []
    with compilation_told(sink), watching_compilation(looks.append):
        wait_until(compile_one)
        length, seen = sink.tell(), len(looks)
        wait_until(lambda: compile_one() and len(looks) > seen + 2)  # both look at the same times
    assert sink.tell() == length
    sink.seek(0)
    told = receive(sink)
    assert told.state == COMPILING
    assert told.notes == ("the estimator compiles its kernels, once on this machine",)
    assert told.warnings == ()
    assert told.message == b""


def test_topics_of_several_plants_are_told_in_one_line_each_way():
    scenario = load_scenario("aerial_tramway")
    notes, warnings = list[str](), list[str]()
    following = LiveFollowing(scenario, lambda message: None, notes.append, warnings.append)
    topics = ["/plant/supports/end/force", "/plant/joint_states"]
    for doubled in (topics, topics, [], []):
        following.shut_out(doubled)
    named = "/plant/joint_states, /plant/supports/end/force"
    assert warnings == [f"several plants publish on {named}: left out until one of them is gone, seconds after a kill"]
    assert notes == [f"one plant alone publishes on {named}: followed again"]


def test_a_sensor_counts_again_only_where_it_is_left_out():
    following = LiveFollowing(load_scenario("aerial_tramway"), pytest.fail, pytest.fail, pytest.fail)
    refused = "readmit: given 'load_end'; allowed: "
    assert following.readmit("load_end", b"") == f"{refused}none, as no sensor is left out"
    swapped = {"tilt_a": "tilt_b", "tilt_b": "tilt_a"}
    following._note(Estimated(3.0, b"", (), FOLLOWING, {"load_tower": "is stuck"}, {}, swapped=swapped))
    assert (
        following.readmit("load_end", b"")
        == f"{refused}a sensor that is left out or swapped: load_tower, tilt_a, tilt_b"
    )
    assert following.readmit("load_tower", b"") == following.readmit("tilt_b", b"") == ""


def test_sensors_that_are_taken_for_each_other_are_in_the_diagnostics():
    following = LiveFollowing(load_scenario("aerial_tramway"), pytest.fail, pytest.fail, pytest.fail)
    following._note(Estimated(3.0, b"", (), FOLLOWING, {}, {}, swapped={"tilt_a": "tilt_b", "tilt_b": "tilt_a"}))
    well, text, values = following.status()
    assert not well
    assert text.endswith("taken for each other: tilt_a, tilt_b")
    assert values["taken_for_tilt_a"] == "tilt_b"


def test_a_sensor_that_counts_again_reaches_the_tracker():
    readmitted = list[str]()
    tracker = SimpleNamespace(sensors={}, readmit=readmitted.append)
    Decoder(tracker).take(Arrival(READMITTED, readmitted_message("load_tower"), 5))
    assert readmitted == ["load_tower"]


def test_what_is_normal_is_no_alarm():
    notes, warnings = list[str](), list[str]()
    following = LiveFollowing(load_scenario("aerial_tramway"), pytest.fail, notes.append, warnings.append)
    begins, stuck = "follows the plant from 1.2 s on", "sensor a is stuck"
    following._note(Estimated(3.0, b"", (stuck,), FOLLOWING, {}, {}, notes=(begins,)))
    assert (notes, warnings) == ([begins], [stuck])
    assert [text for key, text in following.status()[2].items() if key.startswith("alarm_")] == [stuck]
