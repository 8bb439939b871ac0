"""Plants with several ropes that are followed: payloads of chairs and cabins, lying sensors, lifts under way."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cable_twin.ensemble.estimate.kalman import Belief
from cable_twin.ensemble.estimate.line_follower import FIRST_ICE, FastErrors, LineFollower
from cable_twin.ensemble.estimate.line_statics import LineStatics, counterweight_keys, drag_of_wind
from cable_twin.ensemble.estimate.tracker import FOLLOWING, Tracker
from cable_twin.frame.sensors import Sensors, standard_sensors
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation
from verification.alarms import scaled
from verification.faultless import hours_of
from verification.following import follow as follow_carriages
from verification.following_line import follow

MOST = 40.0  # kg
DURATION = 90.0  # s, in which the first chairs pass two towers
GONE = 1000.0  # m of rope that went by before
SPEED = 2.5  # m/s
WHILE = 45.0  # s, in which an error of a load cell shows in what it says of chairs that other cells have seen
TOWER = "tower_3_up"


@pytest.fixture(scope="module")
def under_way():
    """As `lift`, of a plant without a fault."""
    return lift({}, 8.0)


def lift(faults, duration):
    """Scenario of a twin, measurements of a lift under way, and the force of one of its towers, by time (s)."""
    bare = load_scenario("chairlift")
    usual = standard_sensors(bare, Simulation(bare).snapshot)
    scenario = load_scenario("chairlift", {"sensors": usual})
    first = (0.5 * bare.spacing + GONE) % bare.loop_length
    changes = {"carriers.first": first, "drives.haul_rope.speed": SPEED, **faults}
    running = Simulation(load_scenario(scenario.resolved(), changes), samples=2)
    sensors, found, forces = Sensors(running.scenario, running.layout), [], {}
    row = running.layout.support_rows[TOWER]
    for frame in range(round(20.0 * duration) + 1):
        snapshot = running.advance_to(round(0.05 * frame, 9))
        found += sensors.take(snapshot)
        forces[snapshot.time] = float(np.linalg.norm(snapshot.columns.support_force[row]))
    found = [
        replace(one, values=(one.values[0] + GONE, one.values[1])) if one.sensor == "encoder_haul_rope" else one
        for one in found
    ]
    return scenario, sorted(found, key=lambda one: one.time), forces


def test_a_lift_under_way_is_followed_from_where_its_chairs_are(under_way):
    scenario, found, forces = under_way
    tracker, lines, corrections = Tracker(scenario), [], []
    for frame in range(160):
        now = 0.05 * (frame + 1)
        tracker.measure([one for one in found if now - 0.05 < one.time <= now], now)
        for news in tracker.advance(now):
            lines.extend(news.lines)
            corrections.extend([news.correction] if news.correction else [])
    assert tracker.state == FOLLOWING
    assert lines[0].startswith("follows the plant from 1.")
    places = {one.time: one.values[0] for one in found if one.sensor == "encoder_haul_rope"}
    nearest = min(places, key=lambda time: abs(time - tracker.follower.time))
    assert abs(tracker.follower.place_of("encoder_haul_rope") - places[nearest]) < 0.5  # m
    assert len(corrections) > 4
    for one in corrections:
        got, true = one.hidden[f"{TOWER}/force"], forces[min(forces, key=lambda time: abs(time - one.time))]
        assert abs(got.value - true) < 4.0 * got.deviation
    assert not tracker.follower.left_out
    assert [line for line in lines if "payload" in line] == []


@pytest.fixture(scope="module")
def for_a_while():
    """As `under_way`, until the chairs have passed some towers."""
    return lift({}, WHILE)


@pytest.mark.parametrize(("sensor", "share"), [("load_tower_2_down", 0.085), ("load_tower_3_down", -0.05)])
def test_a_load_cell_of_a_lift_with_a_constant_error_is_named_and_no_payload(for_a_while, sensor, share):
    (first, *_) = [float(np.linalg.norm(one.values)) for one in for_a_while[1] if one.sensor == sensor]
    _, alarms = followed(for_a_while, lambda one: scaled(one, 1.0, share * first) if one.sensor == sensor else one)
    (said,) = [alarm.reason for alarm in alarms]
    assert said.startswith(f"sensor {sensor} contradicts all others")


def followed(under_way, changed):
    """Follower and alarms of measurements, each changed by a function."""
    scenario, found, _ = under_way
    follower, alarms = LineFollower(scenario), []
    follower.begin_at(0.0, {"haul_rope": (GONE, SPEED)})
    for time in sorted({one.time for one in found}):
        correction = follower.take(time, [changed(one) for one in found if one.time == time])
        alarms += [] if correction is None else correction.alarms
    return follower, alarms


def test_forces_of_a_lift_that_stops_while_its_twin_goes_on_tell_nothing(under_way):
    """In an emergency stop of the plant they are those of brakes and waves, which looked like negative friction."""
    scenario, found, _ = under_way
    places = {one.time: one.values[0] for one in found if one.sensor == "encoder_haul_rope"}
    stops = min(time for time in places if time > 3.0)
    follower, innovations = LineFollower(scenario), {}
    follower.begin_at(0.0, {"haul_rope": (GONE, SPEED)})
    for time in sorted({one.time for one in found}):
        slower = time > stops
        group = [
            replace(one, values=(places[stops] + 0.5 * (one.values[0] - places[stops]), 0.5 * SPEED))
            if slower and one.sensor == "encoder_haul_rope"
            else one
            for one in found
            if one.time == time
        ]
        if (correction := follower.take(time, group)) is not None:
            innovations[correction.time] = correction.innovation
    assert not follower.left_out
    assert all(innovations[time] != 1.0 for time in innovations if 1.5 < time < stops)
    assert {innovations[time] for time in innovations if time > stops + 2.0} == {1.0}  # none was taken


def test_what_is_told_of_a_lift_is_possible(under_way):
    """No friction or ice below 0, and payloads of 0 to the capacity; what goes with them moves along."""
    follower = LineFollower(under_way[0])
    count, ice, covariance = len(follower.carriers), follower._known - 1, follower._belief.covariance.copy()
    both = np.sqrt(np.diag(covariance))
    covariance[ice, 0] = covariance[0, ice] = 0.5 * both[0] * both[ice]
    mean = np.zeros(covariance.shape[0])
    mean[0], mean[1], mean[count] = -5000.0, 5000.0, -1.5  # kg of two chairs, and friction
    told = follower._slow(follower._possible(Belief(mean, covariance)))
    assert told[f"{follower.carriers[0]}/payload"].value == pytest.approx(0.0, abs=1e-9)
    assert told[f"{follower.carriers[1]}/payload"].value == pytest.approx(follower._capacity)
    assert told["towers/friction"].value == 0.0
    assert told["ropes/ice"].value > 0.0
    assert told["towers/friction"].deviation == pytest.approx(covariance[count, count] ** 0.5)


def test_a_lift_that_is_found_farther_on_has_its_payloads_but_of_chairs_that_passed_a_station(for_a_while):
    """Twin that lost its plant for 20 s: the rope went on by 50 m; a plant that was put back has other people."""
    follower, _ = followed(for_a_while, lambda one: one)
    before, strands = deviations(follower), strands_of(follower)
    at = GONE + SPEED * WHILE
    follower.begin_at(WHILE + 20.0, {"haul_rope": (at + 50.0, SPEED)})
    after, now = deviations(follower), strands_of(follower)
    seen = {name for name in before if before[name] < 0.5 * max(before.values())}
    assert len(seen) > 3
    stayed = {name for name in before if strands[name] == now[name]}
    assert 0 < len(before) - len(stayed) < 4
    assert {name: after[name] for name in stayed} == pytest.approx({name: before[name] for name in stayed})
    doubt = max(before.values())
    assert all(after[name] > 0.3 * doubt for name in set(before) - stayed)
    follower.begin_at(WHILE + 21.0, {"haul_rope": (0.0, 0.0)})
    assert min(deviations(follower).values()) > 0.3 * doubt


def deviations(follower):
    """Standard deviation (kg) of the payload of each carrier."""
    return {name: one.deviation for name, one in follower._slow(follower._belief).items() if name.endswith("/payload")}


def strands_of(follower):
    """Strand of each carrier, by name of its payload."""
    columns, layout = follower._twin.snapshot.columns, follower._twin.layout
    return {f"{name}/payload": columns.vehicle_rope[row] for name, row in layout.vehicle_rows.items()}


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda values: (20e3, 0.0, 0.0), "is stuck at 20 kN"),
        (lambda values: tuple(1e3 * value for value in values), "another unit"),
        (lambda values: tuple(1.4 * value for value in values), "contradicts all others"),
    ],
)
def test_a_load_cell_of_a_lift_that_lies_is_named_within_ten_seconds(under_way, spoil, said):
    sensor = "load_tower_3_up"

    def spoiled(one):
        return replace(one, values=spoil(one.values))

    follower, alarms = followed(under_way, lambda one: spoiled(one) if one.sensor == sensor else one)
    assert [*follower.left_out] == [sensor]
    assert said in follower.left_out[sensor].reason
    assert [alarm for alarm in alarms if alarm is follower.left_out[sensor]]


@pytest.mark.parametrize(
    ("spoil", "said"), [(lambda place, at: at, "is stuck at 1010"), (lambda place, at: place + 0.05, "has jumped by ")]
)
def test_an_encoder_of_a_lift_that_lies_is_named_within_ten_seconds(under_way, spoil, said):
    sensor, begins = "encoder_haul_rope", 4.0  # s
    (at, *_) = [one.values[0] for one in under_way[1] if one.sensor == sensor and one.time > begins]

    def spoiled(one):
        return replace(one, values=(spoil(one.values[0], at), *one.values[1:]))

    follower, _ = followed(under_way, lambda one: spoiled(one) if one.sensor == sensor and one.time > begins else one)
    assert [*follower.left_out] == [sensor]
    assert said in follower.left_out[sensor].reason
    assert abs(follower.place_of(sensor) - GONE - SPEED * follower.time) < 0.1  # m


def test_swapped_load_cells_of_a_lift_are_named(under_way):
    to = {"load_tower_1_up": "load_tower_5_up", "load_tower_5_up": "load_tower_1_up"}
    follower, alarms = followed(under_way, lambda one: replace(one, sensor=to.get(one.sensor, one.sensor)))
    (said,) = [alarm.reason for alarm in alarms if "sensor" in alarm.reason]
    assert said.startswith("sensors load_tower_1_up and load_tower_5_up are swapped")
    assert not follower.left_out


@pytest.mark.parametrize(
    ("faults", "said"),
    [
        ({"ropes.up.ice": 1.0, "ropes.down.ice": 1.0}, "ropes/ice is "),
        (
            {f"towers.tower_{row}_{rope}.friction": 0.06 for row in range(1, 7) for rope in ("up", "down")},
            "towers/friction is ",
        ),
    ],
)
def test_ice_and_a_doubled_friction_of_towers_are_told_within_ten_seconds(faults, said):
    follower, alarms = followed(lift(faults, 11.0), lambda one: one)
    assert [alarm.reason for alarm in alarms if alarm.reason.startswith(said) and alarm.time < 10.5]
    assert not follower.left_out


def test_estimates_of_a_lift_are_without_the_doubt_of_the_next_window(under_way):
    scenario, _, _ = under_way
    follower = LineFollower(scenario)
    first, second = follower.take(1.0, []), follower.take(2.0, [])
    assert first.slow["ropes/ice"].deviation == FIRST_ICE
    assert second.slow["ropes/ice"].deviation > FIRST_ICE


@pytest.mark.parametrize("scenario", ["gondola", "bicable"])
def test_effects_of_payloads_on_the_loads_of_towers_are_those_of_two_rests(scenario):
    """All cabins that go up with half of their load: the rope pulls less, and more so the higher a tower is."""
    bare = load_scenario(scenario)
    loaded = bare.carriers.payload.leaving["return"]
    full = Simulation(bare, samples=2).snapshot
    half = Simulation(load_scenario(scenario, {"carriers.payload.leaving.return": 0.5 * loaded}), samples=2).snapshot
    statics, rows = LineStatics(bare, full), [full.layout.vehicle_rows[name] for name in full.layout.carriers]
    less = (half.columns.payload - full.columns.payload)[rows]
    for name in statics.towers:
        row = full.layout.support_rows[name]
        true = np.linalg.norm(half.columns.support_force[row]) - np.linalg.norm(full.columns.support_force[row])
        assert abs(statics.of_tower(name, full).payloads @ less - true) < 0.01 * abs(true) + 30.0, name  # N
    bare = load_scenario(scenario, {f"ropes.{rope}.ice": 0.5 for rope in bare.ropes})
    iced = Simulation(bare, samples=2).snapshot
    for name in statics.towers:
        row = full.layout.support_rows[name]
        true = np.linalg.norm(iced.columns.support_force[row]) - np.linalg.norm(full.columns.support_force[row])
        assert abs(0.5 * statics.of_tower(name, full).ice - true) < 0.02 * abs(true) + 30.0, name  # N


@pytest.mark.parametrize("scenario", ["gondola", "bicable"])
def test_the_effect_of_one_payload_is_that_of_a_rest_without_it(scenario):
    bare, lost = load_scenario(scenario), 3
    full = Simulation(bare, samples=2).snapshot
    others = [number for number in range(1, bare.carriers.count + 1) if number != lost]
    without = Simulation(load_scenario(scenario, {"carriers.loaded": others}), samples=2).snapshot
    statics, rows = LineStatics(bare, full), [full.layout.vehicle_rows[name] for name in full.layout.carriers]
    less = (without.columns.payload - full.columns.payload)[rows]
    assert np.count_nonzero(less) == 1
    for name in statics.towers:
        row = full.layout.support_rows[name]
        true = np.linalg.norm(without.columns.support_force[row]) - np.linalg.norm(full.columns.support_force[row])
        assert abs(statics.of_tower(name, full).payloads @ less - true) < 0.02 * bare.gravity * abs(less.sum()), name


@pytest.mark.parametrize("scenario", ["chairlift", "bicable"])
def test_effects_of_a_counterweight_are_those_of_another_rest(scenario):
    bare = load_scenario(scenario)
    start = Simulation(bare, samples=2).snapshot
    statics, heavier = LineStatics(bare, start), 0.03
    for column, (name, (key, mass)) in enumerate(counterweight_keys(bare).items()):
        assert statics.counterweights[name] == mass
        other = Simulation(load_scenario(scenario, {key: (1.0 + heavier) * mass}), samples=2).snapshot
        rows = [start.layout.support_rows[tower] for tower in statics.towers]
        before, after = (np.linalg.norm(one.columns.support_force[rows], axis=1) for one in (start, other))
        told = [statics.of_tower(tower, start).counterweights[column] * heavier * mass for tower in statics.towers]
        np.testing.assert_allclose(told, after - before, atol=0.05 * np.abs(after - before).max())


def test_wind_along_a_lift_needs_more_force_either_way_the_larger_the_faster_it_is():
    lift = load_scenario("chairlift")
    drag = 0.5 * lift.air.density * 2.1 * lift.carriers.count
    assert drag_of_wind(lift, 10.0) == drag_of_wind(lift, -10.0)
    assert drag_of_wind(lift, 10.0) == pytest.approx(drag * (2.0 * 10.0 * SPEED - SPEED**2))
    assert drag_of_wind(lift, 1.0) == pytest.approx(drag)
    assert drag_of_wind(lift, 0.0) == 0.0


def test_another_counterweight_of_a_lift_is_told_as_that():
    """2 t of 33 t, three standard deviations of what is known before; no load cell is taken for wrong."""
    scenario, found, _ = lift({"sheaves.return.counterweight.mass": 31.0e3}, 8.0)
    tracker, last = Tracker(scenario), None
    for frame in range(160):
        now = 0.05 * (frame + 1)
        tracker.measure([one for one in found if now - 0.05 < one.time <= now], now)
        for news in tracker.advance(now):
            last = news.correction or last
    told = last.slow["return/counterweight"]
    assert abs(told.value - 31.0e3) < 3.0 * told.deviation
    assert told.value < 32.6e3
    assert not tracker.follower.left_out


@pytest.mark.parametrize("scenario", ["chairlift", "bicable"])
def test_effects_of_payloads_do_not_depend_on_whether_the_rope_runs_at_the_start(scenario):
    standing, running = (load_scenario(scenario, {"drives.haul_rope.speed": speed}) for speed in (0.0, SPEED))
    start = Simulation(standing, samples=2).snapshot
    told = [LineStatics(one, Simulation(one, samples=2).snapshot) for one in (standing, running)]
    effects = [one.of_drive("haul_rope", start).payloads for one in told]
    np.testing.assert_allclose(*effects, rtol=1e-9, atol=1e-9)


def test_a_bicable_lift_with_other_payloads_is_followed_and_no_sensor_is_suspected():
    """Cabins go up with 700 kg instead of 1200: track and haul rope, drive and rollers agree on that."""
    usual = standard_sensors(load_scenario("bicable"), Simulation(load_scenario("bicable"), samples=2).snapshot)
    scenario = load_scenario("bicable", {"sensors": usual})
    plant = Simulation(
        load_scenario(scenario.resolved(), {"carriers.payload.leaving.return": 700.0, "drives.haul_rope.speed": 5.0}),
        samples=2,
    )
    sensors, follower, alarms = Sensors(plant.scenario, plant.layout), LineFollower(scenario), []
    follower.begin_at(0.0, {"haul_rope": (0.0, 5.0)})
    last = None
    for frame in range(700):
        found = sensors.take(plant.advance_to(round(0.05 * frame, 9)))
        for time in sorted({one.time for one in found}):
            correction = follower.take(time, [one for one in found if one.time == time])
            alarms += [] if correction is None else correction.alarms
            last = correction or last
    columns, rows = plant.snapshot.columns, plant.layout.vehicle_rows
    assert not follower.left_out
    assert not [one.reason for one in alarms if "payload" not in one.reason]
    assert [one.reason for one in alarms if "; 1200 kg in the plan" in one.reason]
    errors = [
        (last.slow[f"{name}/payload"].value - columns.payload[row]) / last.slow[f"{name}/payload"].deviation
        for name, row in rows.items()
    ]
    assert np.max(np.abs(errors)) < 4.0
    assert np.sqrt(np.mean(np.square(errors))) < 1.7
    assert last.slow["carriers/rolling"].deviation < 0.4 * 0.005


def test_a_lift_without_a_fault_gives_no_alarm(under_way):
    _, alarms = followed(under_way, lambda one: one)
    assert alarms == []


def test_fast_errors_grow_with_waves_and_not_with_a_payload_that_passes():
    effects, mean = np.array([10.0, 0.0]), np.array([50.0, 0.0])
    errors = FastErrors({"drive": 300.0, "tower": 100.0})
    for number in range(30):
        errors.take(float(number), "drive", 2000.0 * (-1.0) ** number, effects, mean)
        errors.take(float(number), "tower", 50.0 * number, number * effects / 10.0, mean)
    assert 1500.0 < errors.variance("drive") ** 0.5 < 3000.0
    assert errors.variance("tower") ** 0.5 == pytest.approx(100.0)


@pytest.mark.long
@pytest.mark.parametrize("scenario", ["chairlift", "gondola"])
def test_payload_of_each_carrier_is_found_once_it_has_passed_two_load_cells(scenario):
    said: list[str] = []
    found = list(follow(scenario, 1, DURATION, said, []))
    assert not [line for line in said if "sensor" in line]
    assert [line for line in said if "in the plan" in line]
    payloads = [one for one in found if one.name == "payload" and one.cells >= 2]
    assert len(payloads) > 20
    assert sum(abs(one.error) > MOST for one in payloads) < 0.05 * len(payloads)
    friction = [one for one in found if one.name == "friction"][-1]
    assert abs(friction.error) < 0.05
    assert abs(friction.error) < 3.0 * friction.deviation


@pytest.mark.long
def test_payloads_of_both_cabins_of_a_jig_back_are_found_once_its_drive_has_started():
    said: list[str] = []
    found = [one for one in follow_carriages("jig_back", 1, 45.0, said, []) if one.name.endswith("/payload")]
    assert not said
    assert len(found) >= 8
    assert sum(abs(one.error) > MOST for one in found) < 0.1 * len(found)
    assert all(abs(one.error) < 4.0 * one.deviation for one in found)


@pytest.mark.long
def test_a_jig_back_that_waits_and_leaves_in_a_side_wind_gives_no_alarm():
    """Its members begin anew with payloads far from the prior; blended to them they swing, 180 kg of payload."""
    told: list[str] = []
    hours_of("jig_back", 11, 40.0 / 3600.0, lambda time, reason: told.append(f"{time:.1f} s: {reason}"), [])
    assert told == []
