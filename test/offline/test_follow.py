"""`follow`: a twin estimates what is hidden in a plant, names sensors that lie, and tells what it cannot follow."""

from __future__ import annotations

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from recorded_run import snapshots_of

from cable_twin import Ensemble
from cable_twin.basics.limited_yaml import read_yaml
from cable_twin.ensemble.estimate.correction import Correction
from cable_twin.ensemble.estimate.detectors.sensor_faults import STUCK_SAMPLES, Doubts
from cable_twin.ensemble.estimate.follower import Follower
from cable_twin.ensemble.estimate.kalman import Belief, update
from cable_twin.ensemble.estimate.line_follower import LineFollower
from cable_twin.ensemble.estimate.linear_range import slopes
from cable_twin.ensemble.estimate.quantities import (
    BOARDING,
    Errors,
    Estimate,
    Reading,
    boards,
    readings,
    slow_quantities,
)
from cable_twin.ensemble.estimate.scatter import Scatter
from cable_twin.frame.records import AppliedCommand, Command
from cable_twin.frame.sensors import Measurement, Sensors, standard_sensors
from cable_twin.messages import ESTIMATE, statuses_of_message
from cable_twin.offline import plant
from cable_twin.offline.follow import main
from cable_twin.offline.following.truth import Truth, true_values
from cable_twin.recording.log_reader import Log, read_log
from cable_twin.scenario import load_scenario, scenario_file
from cable_twin.simulation import EquilibriumError, Simulation

pytest.importorskip("matplotlib")
import matplotlib.pyplot as plt

from cable_twin.offline.following.plot import write_estimates

PAYLOAD = "carriages.cabin.payload.mass"
TRUTH = 4200.0  # kg
DURATION = 20.0  # s
COARSE = {"cable.elements": {"target": 20.0, "at_towers": 6.0, "growth": 1.7}}  # for speed


@pytest.fixture(scope="module")
def measured():
    """As `measurements`, of a plant with another payload."""
    return measurements({PAYLOAD: TRUTH})


def measurements(changes, name="aerial_tramway", duration=DURATION):
    """Scenario of a twin, and all measurements of a plant by time (s), which starts at 2 s."""
    bare = load_scenario(name, COARSE)
    usual = standard_sensors(bare, Simulation(bare).snapshot)
    scenario = load_scenario(name, {**COARSE, "sensors": usual})
    running = Simulation(load_scenario(scenario.resolved(), changes), samples=2)
    sensors, found = Sensors(running.scenario, running.layout), {}
    for frame in range(round(duration / 0.05) + 1):
        snapshot = running.advance_to(round(0.05 * frame, 9))
        if frame == 40:
            running.command("cabin", speed=7.0)
        for one in sensors.take(snapshot):
            found.setdefault(one.time, []).append(one)
    return scenario, dict(sorted(found.items()))


@pytest.fixture(scope="module")
def calm(measured):
    """Follower and corrections of measurements as they are."""
    return followed(measured)


def followed(measured, changed=lambda one: one, until=DURATION):
    """Follower and corrections of measurements, each changed by a function, up to a time (s)."""
    scenario, found = measured
    follower, corrections = Follower(scenario, threads=1), []
    for time, group in found.items():
        if time > until:
            break
        if time >= 2.0 > follower.time:
            follower.command(AppliedCommand(2.0, Command("speed", {"cabin": 7.0}), "test"))
        corrections.append(follower.take(time, [changed(one) for one in group]))
    follower.close()
    return follower, [one for one in corrections if one is not None]


def test_a_linear_filter_has_the_least_squares_of_all_measurements():
    draws = np.random.default_rng(3)
    prior = Belief(draws.standard_normal(3), np.diag([1.0, 4.0, 0.25]))
    jacobian, values, variance = draws.standard_normal((8, 3)), draws.standard_normal(8), draws.uniform(0.1, 1.0, 8)
    belief = prior
    for rows in (slice(0, 3), slice(3, 8)):
        innovation = values[rows] - jacobian[rows] @ belief.mean
        belief = update(belief, innovation, jacobian[rows], variance[rows])
    information = np.linalg.inv(prior.covariance) + (jacobian.T / variance) @ jacobian
    vector = np.linalg.solve(prior.covariance, prior.mean) + (jacobian.T / variance) @ values
    np.testing.assert_allclose(belief.mean, np.linalg.solve(information, vector), rtol=1e-10)
    np.testing.assert_allclose(belief.covariance, np.linalg.inv(information), rtol=1e-9)


def test_a_blend_of_states_is_the_state_between_them():
    """A state put together of its neighbours moves on as the one that had the value between from the start."""
    masses = [4000.0, 4300.0, 3700.0, 4150.0]
    ensemble = Ensemble(load_scenario("aerial_tramway", COARSE), 4, parameters={PAYLOAD: masses}, threads=1)
    ensemble.command("cabin", speed=7.0)
    ensemble.advance_to(8.0)
    weights = np.eye(4)
    weights[0, 1:3] = 0.25, -0.25
    ensemble.blend(weights)
    ensemble.change({PAYLOAD: [4150.0, *masses[1:]]})
    ensemble.advance_to(9.0)
    columns = ensemble.observe(["cabin/arc_length", "cabin/drive_force", "cabin/cabin/pitch"])
    ensemble.close()
    blended, wanted, other = columns.array[[0, 3, 1]]
    assert np.all(np.abs(blended - wanted) < 0.02 * np.abs(other - wanted) + [0.0, 0.0, 5e-5])  # m, N, rad


def test_a_large_correction_of_the_wind_leaves_the_drive_on_its_course():
    """Joints that a blend left open would need more than the drive has in the next step, and it starts anew."""
    winds = {PAYLOAD: 1900.0, "air.wind.x": [14.0, 17.0, 11.0, 8.0]}
    ensemble = Ensemble(load_scenario("aerial_tramway", COARSE), 4, parameters=winds, threads=1)
    ensemble.command("cabin", speed=7.0)
    ensemble.advance_to(3.0)
    weights = np.eye(4)
    weights[0, 1:3] = -1.0, 1.0
    ensemble.blend(weights)
    ensemble.change({"air.wind.x": [8.0, 17.0, 11.0, 8.0]})
    ensemble.advance_to(5.0)
    force, place = ensemble.observe(["cabin/drive_force", "cabin/arc_length"]).array[[0, 3]].T
    ensemble.close()
    assert abs(force[0] - force[1]) < 1000.0  # N
    assert abs(place[0] - place[1]) < 0.03  # m


def test_a_plant_that_rests_in_a_strong_wind_is_known_before_it_moves():
    """Payload and both components of the wind, with what swings at rest in it, from twins that rest in still air."""
    wind = {"air.wind.x": -5.0, "air.wind.y": 12.0}
    follower, corrections = followed(measurements({PAYLOAD: 2000.0, **wind}, "windy_tramway", 6.0))
    assert not follower.left_out
    for correction in (corrections[0], corrections[-1]):
        slow = correction.slow
        for name, true, most in (("cabin/payload", 2000.0, 150.0), ("wind/x", -5.0, 3.0), ("wind/y", 12.0, 1.5)):
            assert abs(slow[name].value - true) < most, f"{name} at {correction.time} s"
            assert abs(slow[name].value - true) < 3.5 * slow[name].deviation, f"{name} at {correction.time} s"
    assert corrections[0].time == pytest.approx(1.0)
    swing = corrections[-1].hidden
    assert abs(swing["cabin/cabin/roll"].value) > 0.02  # rad
    assert abs(swing["cabin/cabin/roll"].deviation) < 0.01


def test_where_there_is_no_rest_the_twin_stays_as_it_was(measured, monkeypatch):
    """Equilibrium that is not found, as by a wind that no rope stands."""
    follower = Follower(measured[0], threads=1)
    points, motion, time = follower._points, follower._motion, follower.time

    def none(*_, **__):
        raise EquilibriumError("no rest")

    monkeypatch.setattr(follower._ensemble, "change", none)
    assert not follower._rest(3.0, points + 1.0)
    with pytest.raises(EquilibriumError):
        follower.begin_at(3.0, {"cabin": (100.0, 0.0)})
    assert follower._points is points
    assert follower._motion is motion
    assert follower.time == time
    follower.close()


def test_roll_is_read_and_haul_ropes_wave_with_one_rope_and_with_several():
    for name in ("windy_tramway", "jig_back"):
        bare = load_scenario(name)
        rest = Simulation(bare).snapshot
        scenario = load_scenario(name, {"sensors": standard_sensors(bare, rest)})
        found = readings(scenario, rest.layout, dict.fromkeys(rest.layout.support_rows, 1e6))
        sensors = [scenario.sensors[one] for one in found]
        assert {one.axis for one in sensors if one.kind == "inclinometer"} == {"pitch", "roll"}
        assert "wind/y" in [one.name for one in slow_quantities(scenario)]
        assert {one.waving for one in found.values() if one.unit == "N"} == {name == "jig_back"}
        assert not any(one.waving for one in found.values() if one.unit != "N")


def test_waves_of_members_are_no_slopes_of_forces_that_feel_a_haul_rope():
    points, waves = np.array([[0.0], [1.0], [-1.0]]), np.sin(np.pi * np.arange(1, 9) / 4.0)
    predicted = np.repeat(5.0 + 3.0 * waves[:, None] * points[:, 0], 2, axis=0)
    sensors = ["force", ""] * 8
    found = slopes(points, predicted, sensors)[:, 0]
    assert found[::2] == pytest.approx(np.zeros(8), abs=1e-12)
    assert found[1::2] == pytest.approx(3.0 * waves)


@pytest.mark.parametrize("named", [False, True], ids=["cable", "ropes"])
def test_a_plant_that_feels_no_wind_is_followed(tmp_path, capsys, named):
    content = read_yaml(scenario_file("seed_example").read_text(encoding="utf-8")).content
    if named:
        content |= {"ropes": {"wire": content.pop("cable")}}
        content["carriages"]["carriage"]["rope"] = "wire"
    (tmp_path / "own.yaml").write_text(json.dumps(content), encoding="utf-8")
    assert plant.main([str(tmp_path / "own.yaml"), "--duration", "1.2", "--log", str(tmp_path / "plant")]) == 0
    (bag,) = (tmp_path / "plant").iterdir()
    assert main([str(bag), "--output", str(tmp_path / "twin")]) == 0
    found = {line.split("  ")[0] for line in capsys.readouterr().out.splitlines()}
    assert {"ice", "carriage/rb2/pitch"} <= found
    assert not {"wind/x", "wind/y"} & found


def test_a_load_cell_off_which_the_rope_has_lifted_is_not_stuck():
    """A cabin that passes lifts its haul rope off the rollers: they read 0 N for as long as it is near."""
    reading = Reading("load", "N", np.arange(3), 50.0, Errors(100.0, 100.0), 50.0)
    for expected, stuck in ((1e3, False), (2e4, True)):
        doubts, alarms = Doubts({"load": reading}), []
        for sample in range(STUCK_SAMPLES + 5):
            measured = [Measurement("load", 0.1 * sample, (0.0, 0.0, 0.0))]
            alarms += doubts.of_samples(0.1 * sample, measured, np.array([0.0, 0.0, expected]))
        assert ["stuck at 0 N" in one.reason for one in alarms] == [True] * stuck


def test_payload_is_found_within_its_band_and_a_wrong_plan_is_told(calm):
    follower, corrections = calm
    got = corrections[-1].slow["cabin/payload"]
    assert abs(got.value - TRUTH) < 3.0 * got.deviation < 350.0  # kg
    assert not follower.left_out
    (alarm,) = [alarm for one in corrections for alarm in one.alarms]
    assert alarm.reason.startswith("cabin/payload is 4")
    assert "6400 kg in the scenario" in alarm.reason


@pytest.mark.parametrize(
    ("sensor", "spoil", "said"),
    [
        ("load_end", lambda values: tuple(1.03 * value for value in values), "contradicts all others"),
        ("tilt_cabin", lambda _: (0.05,), "is stuck at 2.86479 deg"),
        ("force_cabin", lambda values: tuple(1e3 * value for value in values), "another unit"),
        (
            "force_cabin",
            lambda values: (1.15 * values[0],),
            "the drive of cabin takes 15 % more force than payload and",
        ),
    ],
)
def test_a_sensor_that_lies_is_named_and_left_out_within_ten_seconds(measured, sensor, spoil, said):
    def changed(one):
        return replace(one, values=spoil(one.values)) if one.sensor == sensor and one.time > 8.0 else one

    follower, corrections = followed(measured, changed, until=15.5)  # s, and it lies from 8 s on
    assert [*follower.left_out] == [sensor]
    assert said in follower.left_out[sensor].reason
    assert follower.left_out[sensor] in [alarm for one in corrections for alarm in one.alarms]
    got = corrections[-1].slow["cabin/payload"]
    assert abs(got.value - TRUTH) < 4.0 * got.deviation


@pytest.mark.parametrize(
    ("sensor", "error", "at"),
    [("load_tower", 5000.0, "rest"), ("load_tower", -5000.0, "end"), ("load_end", 1e4, "end")],
)
def test_a_load_cell_that_is_wrong_from_the_start_is_no_ice_and_is_named(measured, sensor, error, at):
    """A cell of a tower may read more by ice or by an error; until a vehicle has moved far nothing tells them apart."""

    def changed(one):
        if one.sensor != sensor:
            return one
        return replace(one, values=tuple((1.0 + error / np.linalg.norm(one.values)) * value for value in one.values))

    follower, corrections = followed(measured, changed, until=4.0 if at == "rest" else 12.5)
    reasons = [alarm.reason for one in corrections for alarm in one.alarms]
    assert not [reason for reason in reasons if reason.startswith("ice")]
    assert [*follower.left_out] == ([] if at == "rest" else [sensor])
    slow, truth = corrections[-1].slow, {"cabin/payload": TRUTH, "ice": 0.0, "start/counterweight": 134e3}
    for name, true in truth.items():
        assert abs(slow[name].value - true) < 3.0 * slow[name].deviation, name
    tensions = corrections[-1].hidden
    assert tensions["end/force"].deviation < (3500.0 if at == "rest" else 1000.0)


def test_members_rest_with_the_payload_of_the_plant_although_a_load_cell_lies(measured):
    """The plan has 6400 kg, the middle of the prior 3200 kg: blended to 4200 kg, members would not be at rest."""

    def changed(one):
        return replace(one, values=tuple(1.05 * value for value in one.values)) if one.sensor == "load_end" else one

    _, corrections = followed(measured, changed, until=1.5)
    got = corrections[0].slow["cabin/payload"]
    assert abs(got.value - TRUTH) < 3.0 * got.deviation < 300.0  # kg; else it would be 470 kg


def test_a_twin_that_is_a_little_off_its_place_does_not_suspect_the_encoder(measured):
    """A live drive is brought to the place of its plant to 0.3 m, also where both stand."""
    scenario, found = measured
    early = {time: group for time, group in found.items() if time < 9.0}

    def changed(one):
        return replace(one, values=(one.values[0] + 0.3, *one.values[1:])) if one.sensor == "encoder_cabin" else one

    follower, _ = followed((scenario, early), changed)
    assert not follower.left_out


def test_a_plant_that_is_shaken_as_no_twin_is_widens_bands_and_gives_no_alarm(measured, calm):
    """Waves of 0.9 Hz in the force of the drive, ten times as large as its noise."""

    def changed(one):
        shaken = 1200.0 * np.sin(5.7 * one.time) if one.sensor == "force_cabin" and one.time > 3.0 else 0.0
        return replace(one, values=(one.values[0] + shaken, *one.values[1:]))

    _, before = calm
    follower, corrections = followed(measured, changed)
    assert not follower.left_out
    got, usual = (one[-1].hidden["end/force"].deviation for one in (corrections, before))
    assert usual < 500.0  # N
    assert 600.0 < got < 1100.0  # N, of a wave 850
    payload = corrections[-1].slow["cabin/payload"]
    assert abs(payload.value - TRUTH) < 3.0 * payload.deviation
    assert payload.deviation > before[-1].slow["cabin/payload"].deviation


def test_waves_of_a_counterweight_are_no_doubt_of_the_drive(measured, calm):
    """People who board let a counterweight bounce by some kN; the force of the drive tells their weight as before."""

    def changed(one):
        if one.sensor != "load_start" or one.time < 3.0:
            return one
        shaken = 1.0 + 1e4 * np.sin(5.7 * one.time) / np.linalg.norm(one.values)
        return replace(one, values=tuple(shaken * value for value in one.values))

    _, before = calm
    follower, corrections = followed(measured, changed)
    assert not follower.left_out
    got, usual = (one[-1].slow["cabin/payload"].deviation for one in (corrections, before))
    assert got < 1.3 * usual


def test_waves_of_carriages_that_begin_to_roll_are_expected():
    """What rollers held in a stand, 500 N, shakes the drive from then on, until its samples tell how much it does."""
    scatter = Scatter(("force", "load"))
    scatter.stir({"force": 500.0})
    assert scatter.unexplained("force") == 500.0**2
    assert scatter.lasting("force") > 500.0**2
    assert scatter.lasting("load") == 0.0
    for _ in range(20):
        seen = np.random.default_rng(1).standard_normal(20)
        scatter.note(2.0, ["force"] * 20, seen, np.full(20, 300.0**2), seen)
    assert scatter.lasting("force") == 0.0


def test_waves_are_told_from_noise_and_from_a_jump():
    """Noise three times as large as assumed, a sensor that is wrong from some moment on, and waves of 0.9 Hz."""
    draws, scatter = np.random.default_rng(1), Scatter(("noisy", "wrong", "shaken"))
    for window in range(20):
        time = 2.0 * window + 0.1 * np.arange(20)
        noise = draws.standard_normal(20)
        measured = {
            "noisy": 3.0 * noise,
            "wrong": noise + 50.0 * (time > 10.4),
            "shaken": noise + 4.0 * np.sin(5.7 * time),
        }
        seen = np.concatenate([*measured.values()])
        scatter.note(2.0, np.repeat([*measured], 20).tolist(), seen, np.ones(60), seen)
        assert scatter.unexplained("wrong") == 0.0
    assert scatter.unexplained("noisy") < 1.0
    assert scatter.unexplained("shaken") == pytest.approx(8.0, rel=0.3)


def test_a_payload_may_change_in_a_station_alone(measured):
    follower = Follower(measured[0], threads=1)
    payload, rolling = (one for one in follower.slow if one.name in ("cabin/payload", "cabin/rolling"))
    numbers = follower._ensemble.numbers()[0]
    places = follower._layout.places
    for place, speed, may in ((12.0, 0.0, True), (12.0, 1.0, False), (300.0, 0.0, False), (1035.0, 0.0, True)):
        numbers[places.arc_length[0]], numbers[places.speed[0]] = place, speed
        assert boards(payload, measured[0], follower._layout, numbers) == may
        assert not boards(rolling, measured[0], follower._layout, numbers)
    follower.close()


def test_estimates_are_without_the_doubt_of_the_next_window(measured):
    """While a cabin stands in a station anybody may board in the next window; that is no doubt about this one."""
    scenario, found = measured
    follower, correction = Follower(scenario, threads=1), None
    for time, group in found.items():
        correction = follower.take(time, group)
        if correction is not None:
            break
    assert correction is not None
    capacity = scenario.carriages["cabin"].payload.capacity
    said, believed = correction.slow["cabin/payload"].deviation, follower._biases.believed(follower._belief)
    follower.close()
    assert believed.covariance[0, 0] - said**2 == pytest.approx((BOARDING * capacity) ** 2 * correction.time, rel=1e-6)


def test_the_force_of_a_drive_with_the_other_sign_is_named_before_any_payload_is_told(measured):
    def turned(one):
        return replace(one, values=(-one.values[0],)) if one.sensor == "force_cabin" else one

    follower, corrections = followed(measured, turned, 4.5)
    reasons = [alarm.reason for one in corrections for alarm in one.alarms]
    assert reasons[0] == "sensor force_cabin reads the negative of what is expected: sign? It is left out"
    assert not any(reason.startswith("cabin/payload is 0 ") for reason in reasons)
    assert [*follower.left_out] == ["force_cabin"]


def test_swapped_sensors_are_named(measured):
    to = {"load_end": "load_tower", "load_tower": "load_end"}
    follower, corrections = followed(measured, lambda one: replace(one, sensor=to.get(one.sensor, one.sensor)), 9.5)
    reasons = [alarm.reason for one in corrections for alarm in one.alarms]
    assert "sensors load_end and load_tower are swapped, and are taken for each other" in reasons
    assert not follower.left_out


def alarms_of(changes):
    """Alarms of a plant with other values, by reason with the time (s)."""
    _, corrections = followed(measurements(changes))
    return {alarm.reason: alarm.time for one in corrections for alarm in one.alarms}


@pytest.mark.long
@pytest.mark.parametrize(
    ("changes", "said", "latest"),
    [
        ({"cable.ice": 1.0}, "ice is (.*) kg/m, standard", 12.0),
        ({"carriages.cabin.friction.rolling": 0.01}, "cabin/rolling is (.*), standard", 16.0),
    ],
)
def test_ice_and_a_doubled_rolling_friction_are_told_soon_after_the_start(changes, said, latest):
    """The cabin starts after 2 s, and has its speed after another 9 s."""
    alarms = alarms_of(changes)
    ((reason, time),) = alarms.items()
    assert float(re.match(said, reason)[1]) == pytest.approx(*changes.values(), rel=0.15)
    assert time < latest  # s


def test_tensions_are_right_again_soon_after_a_stuck_counterweight_is_told():
    """A rope that is pinned where its counterweight rests has more and more tension as its cabin goes to midspan."""
    place = Simulation(load_scenario("aerial_tramway", COARSE)).cable_positions(np.zeros(1))[0, [0, 2]]
    _, found = stuck = measurements({"cable.start": {"position": place.tolist(), "support": "pinned"}})
    follower, corrections = followed(stuck)
    (alarm,) = [alarm for one in corrections for alarm in one.alarms]
    time, reason = alarm.time, alarm.reason
    assert reason.startswith("the counterweight at start is stuck: tension changes by +")
    assert time < 14.0
    last = corrections[-1]
    assert last.time > time + 4.0
    for name in ("start", "end"):
        near = [one for at, group in found.items() if abs(at - last.time) < 0.5 for one in group]
        measured = [one.values for one in near if one.sensor == f"load_{name}"]
        load, got = float(np.linalg.norm(measured, axis=1).mean()), last.hidden[f"{name}/force"]
        assert got.value == pytest.approx(load, rel=5e-3)
        assert got.deviation < 5e-3 * load
    mass = last.slow["start/counterweight"]
    assert (mass.value, mass.deviation) == pytest.approx((134e3, 670.0))  # of the scenario: nothing tells it now
    assert not follower.left_out


@pytest.mark.long
def test_a_plant_without_a_fault_gives_no_alarm():
    assert alarms_of({}) == {}


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    directory = tmp_path_factory.mktemp("plant")
    (directory / "trip.yaml").write_text("- {time: 1, name: cabin, speed: 7.0}\n", encoding="utf-8")
    arguments = ["--script", str(directory / "trip.yaml"), "--duration", "8", "--log", str(directory)]
    assert plant.main(["aerial_tramway", "--set", f"{PAYLOAD}={TRUTH}", *arguments]) == 0
    (bag,) = {path.parent for path in directory.rglob("*.mcap")}
    return bag


def test_a_bag_is_followed_into_a_log_of_estimates_and_a_plot(bag, tmp_path, capsys):
    arguments = ["--scenario", "aerial_tramway", "--plots", str(tmp_path), "--output", str(tmp_path)]
    assert main([str(bag), *arguments]) == 0
    said = capsys.readouterr()
    assert "cabin/payload is 4" in said.err
    rows = {line.split("  ")[0]: line.split() for line in said.out.splitlines()}
    assert float(rows["cabin/payload"][-1]) == TRUTH
    last = snapshots_of(bag)[-1]  # at 8 s
    force = np.linalg.norm(last.columns.support_force[last.layout.support_rows["end"]])
    assert rows["end/force"][-2] == "kN"
    assert float(rows["end/force"][-1]) == pytest.approx(1e-3 * force, rel=1e-3)
    assert rows["cabin/cabin/pitch"][-2] == "deg"
    assert abs(float(rows["cabin/cabin/pitch"][-1])) < 10.0
    assert (tmp_path / "estimates.png").stat().st_size > 20_000
    log = read_log(next(path.parent for path in tmp_path.rglob("*.mcap")))
    messages = [statuses_of_message(data) for _, _, data in log.messages([ESTIMATE])]
    assert len(messages) >= 3
    last = {status.name: status.values for status in messages[-1]}
    assert abs(float(last["cabin/payload"]["value"]) - TRUTH) < 500.0
    assert last["end/force"]["unit"] == "N"


def test_the_plant_of_a_lift_has_its_payloads_forces_and_friction_beside_the_estimates(tmp_path, capsys, monkeypatch):
    """Also of a twin with the plant's own scenario; but not from a log of a twin that itself has followed a plant."""
    changes = {"carriers.payload.leaving.return": 220.0, "towers.tower_1_up.friction": 0.03}
    given = [part for key, value in changes.items() for part in ("--set", f"{key}={value}")]
    assert plant.main(["chairlift", *given, "--duration", "2", "--log", str(tmp_path / "plant")]) == 0
    (bag,) = {path.parent for path in tmp_path.rglob("*.mcap")}
    assert main([str(bag), "--scenario", "chairlift", "--output", str(tmp_path / "out")]) == 0
    rows = {line.split("  ")[0]: line.split() for line in capsys.readouterr().out.splitlines()}
    assert {float(rows[f"chair_{number}/payload"][-1]) for number in range(1, 29)} == {0.0, 220.0}
    assert float(rows["towers/friction"][-1]) == 1.0
    snapshots = snapshots_of(bag)
    force = np.linalg.norm(snapshots[0].columns.support_force[snapshots[0].layout.support_rows["tower_1_up"]])
    assert float(rows["tower_1_up/force"][-1]) == pytest.approx(1e-3 * force, rel=0.01)  # at rest
    follower = LineFollower(load_scenario(read_log(bag).scenario))
    correction = Correction(1.0, {"chair_1/payload": Estimate(1.0, 1.0, "kg")}, {}, 1.0, ())
    log = read_log(bag)
    assert [*true_values(log, follower, correction, load_scenario(log.scenario))] == ["chair_1/payload"]
    monkeypatch.setattr(Log, "messages", lambda *_: iter([(ESTIMATE, 0, b"")]))
    assert true_values(log, follower, correction, load_scenario(log.scenario)) == {}


def test_many_estimates_make_a_small_picture_and_no_lines_between_samples_of_motion(tmp_path, monkeypatch):
    """Title above the panels, bands within the axes, the plant by its own samples, and 28 payloads in one panel."""
    monkeypatch.setattr(plt, "close", lambda _figure: None)
    corrections = [
        Correction(
            2.0 * number,
            {f"chair_{row}/payload": Estimate(100.0, 200.0 / number, "kg") for row in range(28)},
            {"cabin/pitch": Estimate(0.01 * (-1.0) ** number, 0.01 / number, "rad")},
            1.0,
            (),
        )
        for number in range(1, 6)
    ]
    times = np.linspace(0.0, 10.0, 301)
    write_estimates("a", corrections, {"cabin/pitch": Truth(times, np.sin(times), 0.0)}, tmp_path / "estimates.png")
    figure = plt.gcf()
    last, pitch = figure.axes
    assert plt.imread(tmp_path / "estimates.png").shape[0] < 1000
    assert [text.get_text() for text in last.get_xticklabels()] == [f"chair_{row}" for row in range(28)]
    truth, estimate = pitch.get_lines()
    assert len(truth.get_xdata()) == 301
    assert (len(estimate.get_xdata()), estimate.get_linestyle()) == (5, "None")
    low, high = pitch.get_ylim()
    assert low < np.rad2deg(-0.01 - 1.96 * 0.01) < high
    renderer = figure.canvas.get_renderer()
    (title,) = figure.texts
    assert title.get_window_extent(renderer).y0 > last.get_tightbbox(renderer).y1
    monkeypatch.undo()
    plt.close("all")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--scenario", "no_such"], "no_such"),
        (
            ["--scenario", "chairlift"],
            ".mcap: given a log of aerial_tramway (ropes: cable); allowed: one of chairlift (ropes: up, down), or "
            "--scenario aerial_tramway",
        ),
        (["--set", "sensors={a: {kind: encoder, of: cabin}}"], "drive_force: given 'cabin'; allowed: none"),
    ],
)
def test_what_cannot_be_followed_is_a_line(bag, tmp_path, refusal, arguments, said):
    assert said in refusal(main, bag, *arguments, "--output", tmp_path)
