"""Plants that stop all at once, turn round, or whose encoders fall silent or leap, without ROS."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cable_twin.ensemble.estimate.correction import Correction
from cable_twin.ensemble.estimate.detectors.emergency_stops import EmergencyStops, Stop
from cable_twin.ensemble.estimate.detectors.jumps import HELD, Leaps
from cable_twin.ensemble.estimate.detectors.sensor_faults import LEAPT_SAMPLES
from cable_twin.ensemble.estimate.detectors.silences import QUIET, Silences
from cable_twin.ensemble.estimate.pursuit import APART, FRESH, Pursuit
from cable_twin.ensemble.estimate.quantities import Estimate
from cable_twin.ensemble.estimate.tracker import FOLLOWING, WAITING, Tracker
from cable_twin.ensemble.estimate.waves import LineWaves, Unheard
from cable_twin.frame.records import Command
from cable_twin.frame.sensors import Measurement, Sensors, standard_sensors
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation

COARSE = {"cable.elements": {"target": 20.0, "at_towers": 6.0, "growth": 1.7}}  # for speed
QUANTUM, PERIOD, SPEED = 0.01, 0.1, 5.0  # m, s, m/s
BEGUN = 3.0  # s, of what happens to the places below


def places(deceleration=0.0, step=0.0, stuck=False, speed=SPEED):
    """Times (s) and places (m) of an encoder with quanta, 0.1 s apart, to whose vehicle something happens at 3 s."""
    times = np.arange(0.0, 5.0, PERIOD)
    since = np.clip(times - BEGUN, 0.0, None)
    lasts = np.minimum(since, speed / deceleration) if deceleration else since
    way = speed * np.minimum(times, BEGUN) + speed * (0.0 if stuck else lasts) - 0.5 * deceleration * lasts**2
    way = way if deceleration else way + np.where(times > BEGUN, step, 0.0)
    return [*zip(times.tolist(), (QUANTUM * np.round(way / QUANTUM)).tolist(), strict=True)]


def first_stop(stops, name, found):
    return next(((time, stop) for time, place in found if (stop := stops.measure(time, name, place))), (0.0, None))


@pytest.mark.parametrize("scenario", ["chairlift", "gondola"])
def test_an_emergency_stop_is_told_within_the_time_that_measurements_wait(scenario):
    stops = EmergencyStops(load_scenario(scenario))
    seen, stop = first_stop(stops, "haul_rope", places(deceleration=1.2))
    assert stop is not None
    assert stop.time == pytest.approx(BEGUN, abs=0.1)
    assert seen - BEGUN <= 0.5
    assert stop.speed == pytest.approx(SPEED, abs=0.05)


@pytest.mark.parametrize(
    "found",
    [
        places(),
        places(deceleration=0.45),
        *(places(stuck=True, speed=one) for one in (1.2, 2.5, SPEED)),
        *(places(step=size) for size in (-3.0, -0.1, -0.02, 1.0)),
    ],
)
def test_a_service_stop_a_jump_or_a_stuck_encoder_is_no_emergency_stop(found):
    assert first_stop(EmergencyStops(load_scenario("aerial_tramway")), "cabin", found) == (0.0, None)


@pytest.fixture(scope="module")
def of_two():
    """Scenario with two carriages, each with a drive of its own."""
    given = load_scenario("aerial_tramway").resolved()
    cabin = given["carriages"]["cabin"]
    return load_scenario(given, {"carriages": {"cabin": cabin, "other": {**cabin, "arc_length": 900.0}}})


@pytest.mark.parametrize(
    ("other", "stops"),
    [(places(deceleration=1.2), True), ([(time, 900.0) for time, _ in places()], True), (places(), False)],
    ids=["stops", "stands", "goes on"],
)
def test_of_several_drives_all_that_move_have_to_stop_at_once(of_two, other, stops):
    detector, found = EmergencyStops(of_two), []
    for (time, place), (_, beside) in zip(places(deceleration=1.2), other, strict=True):
        found += [detector.measure(time, "cabin", place), detector.measure(time, "other", beside)]
    told = [stop for stop in found if stop is not None]
    assert bool(told) == stops
    assert all(stop.time == pytest.approx(BEGUN, abs=0.4) for stop in told[:1])


@pytest.mark.parametrize("heard", [True, False], ids=["with its force", "without"])
def test_a_carriage_that_swings_on_its_haul_rope_is_no_emergency_stop_as_its_force_says(heard):
    scenario = load_scenario("aerial_tramway")
    rope, track = scenario.haul_ropes["cabin"], scenario.cable.unstrained_length
    stops, told = EmergencyStops(scenario), []
    for time, way in places():
        behind = 0.14 * (1.0 - np.cos(2.8 * max(time - BEGUN, 0.0)))  # m, as 40 m behind the tower
        if heard:
            stops.pull(time, "cabin", 20e3 + behind * rope.axial_stiffness / (rope.beyond_track + track - way))
        told += [stops.measure(time, "cabin", way - round(behind, 2))]
    assert any(told) == (not heard)  # else it looks like a stop


def test_places_where_a_vehicle_cannot_be_are_leaps():
    leaps = Leaps()
    assert not any(leaps.note(*one) for one in places(deceleration=1.5))
    leaps.clear()
    sizes = [(time, leaps.note(time, place)) for time, place in places(step=9.0)]
    assert all(size == 0.0 for time, size in sizes if time <= BEGUN)
    away = [size for time, size in sizes if time > BEGUN]
    assert away == pytest.approx([9.0] * len(away), abs=0.3)
    leaps.clear()
    for number in range(HELD + 3):  # of an encoder that is followed where it stays
        size = leaps.note(PERIOD * number, 0.0 if number < 2 else 90.0)
        assert bool(size) == (2 <= number < HELD + 2)


def test_an_encoder_that_leaps_is_not_pursued_and_one_that_is_silent_neither():
    leapt, silent = Pursuit({"cabin": 10.0}), Pursuit({"cabin": 10.0})
    for time, place in places(step=9.0):
        leapt.command(time, {"cabin": SPEED})
        leapt.measure(time, "cabin", place)
        assert leapt.wanted(time, "cabin", SPEED * time) in (None, SPEED)
    for time, place in places():
        silent.command(time, {"cabin": SPEED})
        if time < BEGUN:
            silent.measure(time, "cabin", place)
        if time > BEGUN + FRESH:
            assert silent.wanted(time, "cabin", SPEED * time) in (None, SPEED)
            assert not silent.catching_up


def test_a_stop_is_released_by_a_new_command_or_where_the_plant_moves():
    pursuit = Pursuit({"cabin": 10.0})
    pursuit.command(9.9, {"cabin": 0.0})
    pursuit.stop(Stop("cabin", 10.0, SPEED, 4.0))
    for time in (10.0, 10.1, 10.2, 10.3):
        pursuit.measure(time, "cabin", 50.0)
    assert pursuit.wanted(10.3, "cabin", 50.0) is None
    assert not pursuit.moves_again(10.3, "cabin", 50.0)
    pursuit.command(10.4, {"cabin": 0.0})
    assert not pursuit.moves_again(10.4, "cabin", None)
    pursuit.command(10.5, {"cabin": 2.0})
    assert pursuit.moves_again(10.5, "cabin", None)
    pursuit.release()
    assert pursuit.wanted(10.5, "cabin", 50.0) == 2.0

    pursuit.stop(Stop("cabin", 10.0, SPEED, 4.0))  # the command goes on, as of somebody who drives
    pursuit.command(20.0, {"cabin": 2.0})
    for time in (20.0, 20.1, 20.2, 20.3):
        pursuit.measure(time, "cabin", 50.0)
    assert not pursuit.moves_again(20.3, "cabin", 50.0 - 0.9 * APART)
    assert pursuit.moves_again(20.3, "cabin", 50.0 - 1.1 * APART)


def test_a_plant_that_stands_though_it_is_commanded_to_move_is_held():
    pursuit = Pursuit({"cabin": 10.0})
    for number in range(60):
        pursuit.command(0.125 * number, {"cabin": 2.0 if number > 20 else 0.0})
        assert pursuit.is_held(0.125 * number, "cabin") == (number > 45)


def one(time, sensor):
    return Measurement(sensor, time, (1.0,))


def test_a_sensor_that_is_silent_while_others_speak_is_told_once_and_when_it_is_back():
    silences, silent, back = Silences(), [], []
    for number in range(100):
        time = 0.1 * number
        speak = ["a"] if 3.0 < time < 8.0 else ["a", "b"]
        lines = silences.note(time, [one(time, name) for name in speak], {})
        silent += lines[0]
        back += lines[1]
    (silent,), (back,) = silent, back
    assert silent.startswith("sensor b is silent since 3.0 s, for ")
    assert float(silent.split()[-5]) == pytest.approx(QUIET, abs=0.2)
    assert back == "sensor b is back after 5.0 s"


def test_a_twin_that_goes_on_alone_doubts_forces_and_swing():
    def said(force):
        return Correction(0.0, {}, {"end": Estimate(force, 3.0, "N"), "pitch": Estimate(0.0, 1e-3, "rad")}, 1.0, ())

    def after(silent):
        unheard = Unheard(0.5 / 9.81)
        unheard.followed(said(100.0))
        return unheard.widened(said(104.0), silent).hidden

    at_once, later = after(0.1), after(60.0)
    assert 5.0 < at_once["end"].deviation < 8.0
    assert later["pitch"].deviation == pytest.approx(0.5 / 9.81, rel=0.01)
    assert at_once["pitch"].deviation < 0.1 * later["pitch"].deviation


def test_waves_of_a_line_are_doubted_after_a_stop_alone():
    waves = LineWaves()
    before = [waves.variance(float(time), "tower", 100.0 + 10.0 * (time % 2)) for time in range(100)]
    assert before == [0.0] * 100
    waves.stir(100.0)
    assert waves.variance(100.0, "tower", 110.0) > 25.0


@pytest.fixture(scope="module")
def stopped():
    """Scenario of a twin, measurements of a plant that makes an emergency stop at 8 s, and its places by time (s)."""
    bare = load_scenario("aerial_tramway", COARSE)
    scenario = load_scenario("aerial_tramway", {**COARSE, "sensors": standard_sensors(bare, Simulation(bare).snapshot)})
    under_way = {"carriages.cabin.arc_length": 150.0, "carriages.cabin.speed": 7.0}
    running = Simulation(load_scenario(scenario.resolved(), under_way))
    sensors, found, at = Sensors(running.scenario, running.layout), [], {}
    for frame in range(361):
        snapshot = running.advance_to(round(0.05 * frame, 9))
        at[round(0.05 * frame, 2)] = snapshot.carriages["cabin"].arc_length
        if frame == 160:
            running.apply(Command("emergency_stop", {}))
        found += sensors.take(snapshot)
    return scenario, found, at


def follow(tracker, found, changed=lambda measurement: measurement, commanded=None):
    """Lines of a tracker and its corrections."""
    lines, corrections = [], []
    for number in range(360):
        now = 0.05 * (number + 1)
        if commanded is not None and number % 2:
            tracker.command({"cabin": commanded}, now)
        tracker.measure([changed(item) for item in found if now - 0.05 < item.time <= now], now)
        for news in tracker.advance(now):
            lines += news.lines
            corrections += [news.correction] if news.correction else []
    tracker.follower.close()
    alarms = [alarm.reason for correction in corrections for alarm in correction.alarms]
    return lines, [reason for reason in alarms if "contradict" in reason or "jumped" in reason]


def begins_under_way(scenario):
    """Tracker that may begin under way, as if payload and friction were known from before."""
    tracker = Tracker(scenario)
    tracker.follower.needs_rest = False
    return tracker


def test_an_emergency_stop_of_a_plant_is_one_of_its_twin(stopped):
    scenario, found, at = stopped
    tracker = begins_under_way(scenario)
    lines, contradicting = follow(tracker, found, commanded=7.0)  # as of somebody who goes on driving
    begins, stops = lines[-2:]
    assert begins.startswith("follows the plant from 1")
    assert stops.startswith("the plant is stopped at ")
    assert tracker.state == FOLLOWING
    assert contradicting == []
    place = at[min(at, key=lambda time: abs(time - tracker.follower.time))]
    assert tracker.follower.place_of("encoder_cabin") == pytest.approx(place, abs=APART + 0.1)


def test_an_encoder_that_leaps_is_named_after_some_samples_and_the_twin_goes_on(stopped):
    scenario, found, at = stopped

    def leaps(item):
        away = item.sensor == "encoder_cabin" and item.time > 4.0
        return replace(item, values=(item.values[0] + 5.0,)) if away else item

    tracker = begins_under_way(scenario)
    _, contradicting = follow(tracker, [item for item in found if item.time < 8.0], leaps, commanded=7.0)
    assert contradicting == ["sensor encoder_cabin has jumped by 5 m and is left out"]
    alarm = tracker.follower.left_out["encoder_cabin"]
    assert alarm.time == pytest.approx(4.0 + PERIOD * LEAPT_SAMPLES, abs=2.0 * PERIOD)
    place = at[min(at, key=lambda time: abs(time - 7.0))] + 7.0 * (tracker.follower.time - 7.0)
    assert tracker.follower.place_of("encoder_cabin") == pytest.approx(place, abs=1.0)


def test_forces_are_doubted_more_behind_a_silence_in_which_the_plant_moved(stopped):
    scenario, found, _ = stopped
    deviations = []
    for silent in (False, True):
        tracker, last = begins_under_way(scenario), None
        for number in range(1, 170):
            now = 0.05 * number
            tracker.command({"cabin": 7.0}, now)
            heard = [] if silent and 2.0 < now < 5.5 else found
            tracker.measure([item for item in heard if now - 0.05 < item.time <= now], now)
            for news in tracker.advance(now):
                last = news.correction or last
        tracker.follower.close()
        assert tracker.state == FOLLOWING
        deviations.append(last.hidden["start/force"].deviation)
    assert deviations[1] > 2.0 * deviations[0]


def test_what_was_learned_since_a_beginning_that_agreed_is_kept(stopped):
    scenario, found, _ = stopped

    def elsewhere(item):
        away = item.sensor == "encoder_cabin" and item.time > 7.6
        return replace(item, values=(item.values[0] + 60.0,)) if away else item

    lines, _ = follow(begins_under_way(scenario), [item for item in found if item.time < 9.0], elsewhere, commanded=7.0)
    assert any(line.endswith("m from the twin, which begins anew there") for line in lines)


def test_a_plant_that_turns_round_does_not_stand(stopped):
    scenario, found, _ = stopped
    begins, tracker = 4.0, Tracker(scenario)
    for sample in found:
        if sample.sensor == "encoder_cabin" and sample.time < 2.0 * begins:
            place = 150.0 - 0.15 * (sample.time - begins) ** 2
            tracker.measure([replace(sample, values=(place,))], sample.time)
            lines = [line for news in tracker.advance(sample.time) for line in news.lines]
            assert not any(line.startswith("follows") for line in lines)
    assert tracker.state == WAITING
    tracker.follower.close()
