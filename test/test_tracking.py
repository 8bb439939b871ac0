"""Plant that is followed live, without ROS: order of arrivals, clocks, silences, new beginnings, drives."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from cable_twin.ensemble.estimate.arrivals import OTHER_CLOCK, RESET, Arrivals
from cable_twin.ensemble.estimate.detectors.sensor_faults import Doubts
from cable_twin.ensemble.estimate.pursuit import APART, BELOW, CLOSING, Pursuit
from cable_twin.ensemble.estimate.quantities import Errors, Reading
from cable_twin.ensemble.estimate.scatter import WAVING
from cable_twin.ensemble.estimate.tracker import ALONE, FOLLOWING, SILENT, WAITING, Tracker
from cable_twin.frame.sensors import Measurement, Sensors, standard_sensors
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation

COARSE = {"cable.elements": {"target": 20.0, "at_towers": 6.0, "growth": 1.7}}  # for speed
CLOCK = 5000.0  # s, by which the clock of this machine is ahead of that of the plant
SPEED = 7.0  # m/s
STANDS = "waits until cabin of the plant stands still: stop it for some seconds, to have estimates"


def one(time, value=1.0, sensor="a"):
    return Measurement(sensor, time, (value,))


def times(arrivals, now):
    return [item.time for item in arrivals.due(now)]


def test_arrivals_are_put_in_the_order_of_their_stamps_by_a_clock_of_their_own():
    arrivals = Arrivals()
    for stamp, delay in ((0.0, 0.01), (0.2, 0.01), (0.1, 0.15), (0.3, 0.02)):
        arrivals.put([one(stamp)], CLOCK + stamp + delay)
    assert times(arrivals, CLOCK + 0.72) == [0.0, 0.1, 0.2]
    arrivals.put([one(0.15)], CLOCK + 0.72)
    assert arrivals.left_out == {"too late to be put in order": 1}
    assert times(arrivals, CLOCK + 1.0) == [0.3]


def test_what_no_clock_can_say_is_left_out_and_told_once():
    arrivals = Arrivals()
    arrivals.put([one(0.0)], CLOCK)
    for _ in range(3):
        arrivals.put([one(0.1, float("nan")), one(2.0), one(-1.5 * OTHER_CLOCK)], CLOCK + 0.1)
    assert sorted(arrivals.left_out.values()) == [3, 3, 3]
    assert sorted(note.rpartition(": ")[2] for note in arrivals.notes) == [
        "a stamp from the future",
        "a stamp more than 30 s old",
        "not finite",
    ]
    assert times(arrivals, CLOCK + 10.0) == [0.0]


def test_a_plant_that_got_another_clock_is_followed_by_it():
    arrivals = Arrivals()
    arrivals.put([one(0.0)], CLOCK)
    for number in range(RESET):
        arrivals.put([one(100.0 + 0.1 * number)], CLOCK + 0.1 * number)
    assert arrivals.notes[-1].startswith("stamps of the plant jumped by 100.000 s, or messages no longer come late: ")
    arrivals.put([one(105.0)], CLOCK + 5.0)
    assert times(arrivals, CLOCK + 6.0) == [pytest.approx(104.9), 105.0]


def test_a_drive_goes_as_commanded_and_makes_up_for_a_distance():
    pursuit = Pursuit({"cabin": 10.0})
    for number in range(11):
        pursuit.measure(0.1 * number, "cabin", 5.0 + 0.7 * number)
    assert pursuit.wanted(1.0, "cabin", 12.0) == pytest.approx(7.0)  # measured, as nothing is commanded
    pursuit.command(1.0, {"cabin": 6.5})
    assert pursuit.wanted(1.0, "cabin", 12.0) == 6.5
    assert not pursuit.catching_up
    behind = 2.0 * APART + 0.7
    assert pursuit.wanted(1.1, "cabin", 12.0 + 0.7 - behind) == pytest.approx(7.0 + behind / CLOSING)
    assert pursuit.catching_up
    assert pursuit.wanted(1.1, "cabin", -500.0) == BELOW * 10.0
    assert pursuit.wanted(1.1, "cabin", 112.0 + 0.7) == pytest.approx(7.0 - np.sqrt(0.2 * 100.0))  # room to brake


@pytest.fixture(scope="module")
def measured():
    """Scenario of a twin, and measurements of a plant under way by time (s), which stops at 6 s by itself."""
    bare = load_scenario("aerial_tramway", COARSE)
    usual = standard_sensors(bare, Simulation(bare).snapshot)
    scenario = load_scenario("aerial_tramway", {**COARSE, "sensors": usual})
    under_way = {"carriages.cabin.arc_length": 150.0, "carriages.cabin.speed": SPEED}
    running = Simulation(load_scenario(scenario.resolved(), {**under_way, "carriages.cabin.payload.mass": 4200.0}))
    sensors, found = Sensors(running.scenario, running.layout), []
    for frame in range(321):
        snapshot = running.advance_to(round(0.05 * frame, 9))
        if frame == 120:
            running.command("cabin", speed=0.0)
        found += sensors.take(snapshot)
    return scenario, found


def tracker_of(scenario, **options):
    """Tracker that may begin under way, as if payload and friction were known from before."""
    tracker = Tracker(scenario, **options)
    tracker.follower.needs_rest = False
    return tracker


def test_a_twin_that_knows_nothing_waits_until_its_plant_stands(measured):
    scenario, found = measured
    tracker, lines = Tracker(scenario), []
    stands = next(item.values for item in found if item.sensor == "encoder_cabin" and item.time >= 10.0)
    for number in range(round(found[-1].time / 0.05)):
        now = 0.05 * (number + 1)
        arrived = [item for item in found if now - 0.05 < item.time <= now]
        tracker.measure(
            [replace(one, values=stands) if one.sensor == "encoder_cabin" and now > 10.0 else one for one in arrived],
            now,
        )
        lines += [(now, line) for news in tracker.advance(now) for line in news.lines]
        if len(lines) == 2:
            break
    (_, waits), (begun, follows) = lines
    assert waits == STANDS
    assert follows.startswith("follows the plant from 1")
    assert begun > 10.0
    assert "with 0.00 m/s" in follows
    tracker.follower.close()


def test_a_twin_does_not_begin_where_its_plant_turns_round_and_sees_one_that_is_held(measured):
    """Turn without a jerk, which stands for a second: its drive is commanded to go back, and is not held for 3 s."""
    tracker, lines = Tracker(measured[0]), []
    at_rest = {one.sensor: one for one in reversed(measured[1])}
    for number in range(140):
        now = 0.1 * (number + 1)
        away = max(abs(min(now, 8.0) - 6.0) - 0.6, 0.0)  # s, before or behind its turn at 6 s; from 8 s on it is held
        place = round(150.0 - 0.05 * away**3, 2)
        measurements = [replace(one, time=now) for one in at_rest.values() if one.sensor != "encoder_cabin"]
        tracker.command({"cabin": -5.0}, now)
        tracker.measure([*measurements, Measurement("encoder_cabin", now, (place,))], now)
        lines += [line for news in tracker.advance(now) for line in news.lines]
        assert now > 10.5 or lines in ([], [STANDS])
    assert lines[1].startswith("follows the plant from 1")
    assert "by an emergency stop" in lines[2]
    tracker.follower.close()


def test_a_twin_begins_at_a_constant_speed_alone(measured):
    scenario, found = measured
    tracker, lines = tracker_of(scenario), []
    for number in range(200):
        now = 0.05 * (number + 1)
        arrived = [item for item in found if now - 0.05 < item.time <= now and item.time > 7.0]
        tracker.measure(arrived, now)
        lines += [line for news in tracker.advance(now) for line in news.lines]
    assert lines == [
        "waits until cabin of the plant moves at a constant speed: keep its speed for some seconds, to have estimates"
    ]
    assert tracker.state == WAITING
    tracker.follower.close()


@pytest.mark.parametrize("needs_rest", [True, False])
def test_a_twin_that_waits_listens_anew_after_a_gap(measured, needs_rest):
    scenario, found = measured
    tracker, lines = Tracker(scenario), []
    tracker.follower.needs_rest = needs_rest
    for number in range(120):
        now = 0.05 * (number + 1)
        arrived = [one for one in found if now - 0.05 < one.time <= now and not 0.9 < one.time < 4.0]
        tracker.measure(arrived, now)
        lines += [line for news in tracker.advance(now) for line in news.lines]
    if needs_rest:  # it goes by with 7 m/s
        assert lines == [STANDS]
        assert tracker.state == WAITING
    else:
        assert lines[-1].startswith("follows the plant from 5.")
        assert float(lines[-1].split()[-2]) == pytest.approx(SPEED, abs=0.1)
    tracker.follower.close()


def test_what_was_learned_at_a_wrong_place_is_forgotten(measured):
    scenario, found = measured
    tracker, lines, corrections = Tracker(scenario), [], []
    before = tracker.follower.learned
    for number in range(120):
        now = 0.05 * (number + 1)
        arrived = [one for one in found if now - 0.05 < one.time <= now]
        stands = now < 4.0
        tracker.measure(
            [replace(one, values=(150.0,)) if one.sensor == "encoder_cabin" and stands else one for one in arrived], now
        )
        for news in tracker.advance(now):
            lines.extend(news.lines)
            corrections.extend([news.correction] if news.correction else [])
    begun, far, waits = (line for line in lines if not line[0].isdigit())
    assert begun.endswith("cabin at 150.00 m with 0.00 m/s")
    assert "which begins anew there; what was learned since 1." in far
    assert waits == STANDS
    assert corrections
    (belief, needs_rest, *_), known = tracker.follower.learned
    assert needs_rest
    assert known == before[1]
    np.testing.assert_array_equal(belief.mean, before[0][0].mean)
    np.testing.assert_array_equal(belief.covariance, before[0][0].covariance)
    tracker.follower.close()


def test_a_speed_is_known_of_an_encoder_that_measures_seldom():
    pursuit = Pursuit({"cabin": 10.0})
    for number in range(4):
        assert pursuit.speed_of("cabin") is None or number == 3
        pursuit.measure(1.5 * number, "cabin", 5.0 + 3.0 * number)
    assert pursuit.speed_of("cabin") == pytest.approx(2.0)
    pursuit.forget()
    assert pursuit.speed_of("cabin") is None
    assert pursuit.knows("cabin")


def test_a_twin_begins_where_its_plant_is_goes_on_alone_and_follows_again(measured):
    scenario, found = measured
    tracker, lines, estimates = tracker_of(scenario), [], []

    def pass_on(first, last):
        for number in range(round(20.0 * (last - first))):
            now = CLOCK + first + 0.05 * (number + 1)
            since = now - CLOCK - 0.05
            tracker.measure([item for item in found if since < item.time <= since + 0.05], now)
            for news in tracker.advance(now):
                lines.extend(news.lines)
                estimates.extend([news.correction] if news.correction else [])

    assert tracker.state == WAITING
    pass_on(0.0, 9.0)
    assert tracker.state == FOLLOWING
    assert lines[0].startswith("follows the plant from 1.")
    assert "cabin at 15" in lines[0]
    twin = tracker.follower.place_of("encoder_cabin")
    found_places = {item.time: item.values[0] for item in found if item.sensor == "encoder_cabin"}
    nearest = min(found_places, key=lambda time: abs(time - tracker.follower.time))
    assert abs(twin - found_places[nearest]) < 1.5  # m, of a stop that nobody told it
    followed = len(estimates)
    for number in range(1, 121):
        tracker.command({"cabin": 0.0}, CLOCK + 9.0 + 0.05 * number)  # by somebody who is still there
        for news in tracker.advance(CLOCK + 9.0 + 0.05 * number):
            lines.extend(news.lines)
            estimates.extend([news.correction] if news.correction else [])
    assert tracker.state == ALONE
    assert lines[-1].startswith("nothing from the plant since 9.0 s: the twin goes on by its model")
    assert len(estimates) > followed
    before = tracker.follower.time
    assert 9.0 + SILENT < before < 15.0
    pass_on(15.0, 16.0)
    assert tracker.state == FOLLOWING
    assert any("the twin follows again" in line for line in lines)
    tracker.follower.close()


def test_a_plant_that_is_somewhere_else_is_begun_with_anew(measured):
    scenario, found = measured
    tracker, lines = tracker_of(scenario), []
    moved = [Measurement(item.sensor, item.time, (item.values[0] + 100.0,)) if item.sensor == "encoder_cabin" else item
             for item in found if item.time > 3.0]  # fmt: skip
    arrived = sorted([item for item in found if item.time <= 3.0] + moved, key=lambda item: item.time)
    for number in range(140):
        now = 0.05 * (number + 1)
        tracker.measure([item for item in arrived if now - 0.05 < item.time <= now], now)
        for news in tracker.advance(now):
            lines.extend(news.lines)
    assert any(line.startswith("cabin is +") for line in lines)
    assert lines[-1].startswith("follows the plant from ")
    assert 255.0 < tracker.follower.place_of("encoder_cabin") < 310.0
    tracker.follower.close()


@pytest.mark.parametrize(("reads", "again"), [("another place", True), ("what it did before", False)])
def test_an_encoder_that_is_left_out_counts_again_where_a_plant_that_was_silent_is_elsewhere(measured, reads, again):
    """As of a plant that was started again; an encoder that is stuck is left out behind a silence as well."""
    scenario, found = measured
    tracker, lines, stuck = tracker_of(scenario), [], None
    for number in range(300):
        now = 0.05 * (number + 1)
        if now > 4.0 and stuck is None:
            stuck = tracker.follower.place_of("encoder_cabin")
            tracker.follower.doubts.leave_out("encoder_cabin", now, "sensor encoder_cabin is stuck")
        place = {"another place": 400.0, "what it did before": stuck}[reads] if now > 9.0 else stuck
        arrived = [one for one in found if now - 0.05 < one.time <= now and not 5.0 < one.time <= 9.0]
        if stuck is not None:
            arrived = [replace(one, values=(place,)) if one.sensor == "encoder_cabin" else one for one in arrived]
            tracker.command({"cabin": SPEED}, now)
        tracker.measure(arrived, now)
        lines += [line for news in tracker.advance(now) for line in news.lines]
    assert any(line.startswith("the plant is back at 9.") for line in lines)
    assert ("encoder_cabin" not in tracker.follower.left_out) == again
    begun = [line for line in lines if line.startswith("follows the plant from ")]
    assert [line.partition(": ")[2] for line in begun[1:]] == ["cabin at 400.00 m with 0.00 m/s"] * again
    assert any("from the twin, which begins anew there; sensor encoder_cabin, which" in line for line in lines) == again
    tracker.follower.close()


@pytest.mark.parametrize("sensor", ["load_tower", "encoder_cabin"])
def test_a_sensor_that_is_left_out_counts_again_where_somebody_says_so_until_it_is_wrong(measured, sensor):
    """Its alarm was false; later it sticks, and is left out again."""
    scenario, found = measured
    tracker, lines, corrections, at, kept = tracker_of(scenario), [], [], {"left out": 2.5, "again": 4.0}, None
    for number in range(240):
        now = 0.05 * (number + 1)
        if now > at["left out"]:
            tracker.follower.doubts.leave_out(sensor, at.pop("left out"), "it contradicts all others")
            at["left out"] = np.inf
        if now > at["again"]:
            assert [*tracker.follower.left_out] == [sensor]
            tracker.readmit(sensor)
            tracker.readmit(sensor)  # twice is as good as once
            at["again"] = np.inf
        arrived = [item for item in found if now - 0.05 < item.time <= now]
        own = [item.values for item in arrived if item.sensor == sensor]
        kept = kept or (own[0] if own and now > 5.0 else None)
        if kept is not None:
            arrived = [replace(item, values=kept) if item.sensor == sensor else item for item in arrived]
        tracker.measure(arrived, now)
        for news in tracker.advance(now):
            lines += news.lines
            corrections += [news.correction] if news.correction else []
    again = f"sensor {sensor} counts again, as asked for"
    assert lines.count(again) == 1
    alarms = [one.reason for correction in corrections for one in correction.alarms]
    (stuck,) = [reason for reason in alarms if sensor in reason]
    assert stuck.startswith(f"sensor {sensor} is stuck")
    assert [*tracker.follower.left_out] == [sensor]
    tracker.follower.close()


def test_a_sensor_that_counts_again_does_so_as_well_where_what_was_known_before_is_restored():
    doubts = Doubts({})
    doubts.leave_out("a", 3.0, "is stuck")
    doubts.leave_out("b", 4.0, "is stuck")
    known = doubts.known
    doubts.readmit("a")
    doubts.known = known
    assert [*doubts.left_out] == ["b"]
    doubts.leave_out("a", 9.0, "is stuck")
    doubts.known = doubts.known
    assert sorted(doubts.left_out) == ["a", "b"]


def test_small_jumps_are_not_told_while_the_plant_may_swing_otherwise_than_its_twin(measured, monkeypatch):
    """After a beginning under way the haul rope of the plant swings, and that of the twin does not."""
    follower, until = tracker_of(measured[0]).follower, list[float]()
    monkeypatch.setattr(follower.doubts, "expect_waves", until.append)
    follower.begin_at(5.0, {"cabin": (100.0, 0.0)})
    assert until == []
    follower.begin_at(7.0, {"cabin": (100.0, 4.0)})
    follower.doubt_swing()
    assert until == [7.0 + WAVING, 7.0 + WAVING]
    follower.close()


@pytest.mark.parametrize(("gap", "stuck"), [(0.1, True), (20.0, False)])
def test_an_encoder_is_not_stuck_whose_plant_has_stopped_while_nothing_was_heard(gap, stuck):
    """As of a twin that was too far behind its plant, and has left out what was waiting."""
    doubts = Doubts({"a": Reading("a", "m", np.zeros(1, dtype=np.intp), 0.003, Errors(0.05, 0.05), 0.2)})
    moving = [(0.1 * number, 0.2 * number) for number in range(20)]
    time, place = moving[-1]
    standing = [(time + gap + 0.1 * number, place + 2.0 * gap) for number in range(9)]
    said = [
        alarm.reason
        for now, there in (*moving, *standing)
        for alarm in doubts.of_samples(now, [Measurement("a", now, (there,))], np.zeros(1), unlike=True)
    ]
    assert said == ["sensor a is stuck at 4 m and is left out"] * stuck


SWAPPED = "load_end/load_tower"  # as `contradicting` has a pair


def swapped_doubts():
    """Doubts of a twin that takes two load cells for each other, and the alarm."""
    readings = dict.fromkeys(SWAPPED.split("/"), SimpleNamespace(unit="N", noise=1.0))
    doubts = Doubts(readings)
    alarms = [alarm for time in (2.0, 4.0, 6.0) for alarm in doubts.judge(time, SWAPPED)]
    assert [one.reason for one in alarms] == [
        "sensors load_end and load_tower are swapped, and are taken for each other"
    ]
    assert doubts.swapped == {"load_end": "load_tower", "load_tower": "load_end"}
    return doubts


def test_sensors_that_are_swapped_back_are_taken_for_themselves_again():
    """As after their wires were changed: they contradict now as they are taken."""
    doubts = swapped_doubts()
    doubts.judge(8.0, "")
    alarms = [alarm for time in (10.0, 12.0, 14.0) for alarm in doubts.judge(time, SWAPPED)]
    assert [one.reason for one in alarms] == [
        "sensors load_end and load_tower are swapped no more, and are taken for themselves again"
    ]
    assert not doubts.swapped
    assert doubts.taken("load_end") == "load_end"


@pytest.mark.parametrize("sensor", SWAPPED.split("/"))
def test_either_of_two_sensors_that_are_taken_for_each_other_makes_both_count_for_themselves(measured, sensor):
    scenario, found = measured
    tracker, lines = tracker_of(scenario), list[str]()
    tracker.follower.doubts = swapped_doubts()
    known = tracker.follower.doubts.known
    tracker.readmit(sensor)
    tracker.readmit(sensor)  # twice is as good as once
    tracker.follower.doubts.known = known
    assert not tracker.follower.doubts.swapped
    tracker.measure(found[:50], 0.5)
    for news in tracker.advance(0.5):
        lines += news.lines
    other = next(one for one in SWAPPED.split("/") if one != sensor)
    assert [line for line in lines if "as asked for" in line] == [
        f"sensors {sensor} and {other} count for themselves, as asked for"
    ]
    tracker.follower.close()


def test_a_twin_that_is_too_far_behind_begins_anew_at_the_present(measured, monkeypatch):
    scenario, found = measured
    monkeypatch.setattr("cable_twin.ensemble.estimate.tracker.BEHIND", 2.0)
    monkeypatch.setattr("cable_twin.ensemble.estimate.tracker.TOO_FAR", 4.0)
    monkeypatch.setattr("cable_twin.ensemble.estimate.tracker.STEADY", 1.0)  # as the plant slows down
    tracker, lines, behind = tracker_of(scenario, relief="a quicker machine helps"), [], []

    def pass_on(first, last, present=None):
        tracker.measure([one for one in found if first < one.time <= last], last)
        for number in range(round(10.0 * (last - first))):
            now = first + 0.1 * (number + 1)
            lines.extend(line for news in tracker.advance(now, present) for line in news.lines)
            behind.append(tracker.behind)

    for number in range(30):
        pass_on(0.1 * number, 0.1 * (number + 1))
    assert max(behind) < 1.0
    pass_on(3.0, 6.0, 6.0)
    assert lines[-1].endswith("s behind the plant; a quicker machine helps")
    assert behind[-1] < 1.0  # it has caught up
    tracker.measure([one for one in found if 6.0 < one.time <= 11.0], 11.0)
    lines.extend(line for news in tracker.advance(6.1, 11.0) for line in news.lines)
    assert tracker.state == WAITING
    assert "behind the plant, as this machine is too slow: begins anew at the present; a quicker" in lines[-1]
    for number in range(110, 130):
        pass_on(0.1 * number, 0.1 * (number + 1))
    assert tracker.state == FOLLOWING
    assert lines[-1].startswith("follows the plant from 1")
    place = next(one.values[0] for one in reversed(found) if one.sensor == "encoder_cabin" and one.time <= 12.5)
    assert abs(tracker.follower.place_of("encoder_cabin") - place) < 2.0  # m
    tracker.follower.close()
