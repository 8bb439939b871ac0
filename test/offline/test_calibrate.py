"""`calibrate`: known truth comes back, intervals cover it, and what the logs cannot tell is named with its reason."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from cable_twin.basics.limited_yaml import read_yaml
from cable_twin.basics.units import NORMAL_95
from cable_twin.offline import plant
from cable_twin.offline.calibrate import _print, main, parser, prepare
from cable_twin.offline.calibration.check import check
from cable_twin.offline.calibration.parameters import CalibrationError, Parameter, Prior, parameters_of
from cable_twin.offline.calibration.plot import write_picture
from cable_twin.offline.calibration.prediction import Evaluation, Rows
from cable_twin.offline.calibration.solve import Estimate, solve
from cable_twin.offline.calibration.starts import starting_points
from cable_twin.offline.calibration.writing import scenario_text
from cable_twin.scenario import load_scenario, scenario_file, scenario_keys, value_at
from cable_twin.simulation import EquilibriumError, Simulation

PAYLOAD, ROLLING = "carriages.cabin.payload.mass", "carriages.cabin.friction.rolling"
DAMPING, MASS = "cable.damping_time", "cable.start.mass"
BIAS = "sensors.load_start.bias"
TRUTH = {PAYLOAD: 4200.0, ROLLING: 0.0065, MASS: 131e3}
COARSE = ["--set", "cable.elements={target: 30.0, at_towers: 8.0, growth: 2.0}"]  # for speed
SENSORS = """\
encoder_cabin: {kind: encoder, of: cabin, rate: 5}
force_cabin: {kind: drive_force, of: cabin, rate: 5}
load_start: {kind: load_cell, of: start, rate: 5}
load_tower: {kind: load_cell, of: tower, rate: 5}
"""
LEAVING = "carriers.payload.leaving.return"
LIFT_SENSORS = """\
encoder: {kind: encoder, of: haul_rope, rate: 5}
force: {kind: drive_force, of: haul_rope, rate: 5}
load_up_start: {kind: load_cell, of: up/start, rate: 5}
load_down_end: {kind: load_cell, of: down/end, rate: 5}
"""


class Linear:
    """Measurements that depend on parameters linearly, in place of twins."""

    def __init__(self, jacobian, measured, bounds=(-6.0, 6.0)):
        count = jacobian.shape[1]
        self.parameters = [Parameter(f"p{row}", "-", 0.0, 1.0, *bounds) for row in range(count)]
        self.bounds = np.full(count, bounds[0]), np.full(count, bounds[1])
        number = np.arange(len(measured))
        none = np.zeros(len(measured), dtype=int)
        self.rows = Rows(none, none, 0.5 * number, number % 100 >= 80, ("sensor",))
        self._jacobian, self._measured, self.evaluations = jacobian, measured, []

    def values(self, point):
        return point

    def first(self, seconds):
        return None

    def look(self, points):
        return self._measured[:, None] - self._jacobian @ points.T

    def evaluate(self, point, near=None):
        self.evaluations.append(Evaluation(point, self._measured - self._jacobian @ point, -self._jacobian))
        return self.evaluations[-1]


class Swing(Linear):
    """Measurements of a swing whose frequency depends on the first parameter: minima where its phase slips a turn."""

    def __init__(self, measured):
        super().__init__(np.ones((len(measured), 2)), measured)
        self.looks, self.failing = 0, False

    def at(self, point):
        phase = (1.0 + 0.02 * point[0]) * self.rows.time
        return np.sin(phase) + point[1], np.column_stack([0.02 * self.rows.time * np.cos(phase), np.ones(phase.size)])

    def look(self, points):
        self.looks += 1
        return np.column_stack([50.0 * (self._measured - self.at(point)[0]) for point in points])

    def evaluate(self, point, near=None):
        if self.failing and 0.0 < abs(point[0]) < 1.5:
            raise EquilibriumError("no rest")
        predicted, slopes = self.at(point)
        self.evaluations.append(Evaluation(point, 50.0 * (self._measured - predicted), -50.0 * slopes))
        return self.evaluations[-1]


def solved_by(predictor):
    prior = predictor.evaluate(np.zeros(len(predictor.parameters)))
    return solve(predictor, check(predictor.parameters, prior, predictor.rows), prior)


def solved(jacobian, measured, **options):
    return solved_by(Linear(jacobian, measured, **options))


SWING_TIMES = 0.5 * np.arange(400)  # s


@pytest.mark.parametrize("failing", [False, True], ids=["wrong minimum", "no rest on the way"])
def test_a_search_that_ends_where_sensors_do_not_fit_starts_again_from_elsewhere(failing):
    swing = Swing(np.sin((1.0 + 0.02 * 2.2) * SWING_TIMES) + 0.3)
    swing.failing = failing
    found = solved_by(swing)
    assert [one.value for one in found.estimates] == pytest.approx([2.2, 0.3], abs=1e-3)
    assert (found.misfits, found.done, swing.looks) == ((), True, 1)
    assert found.starts > 1


def test_a_search_that_fits_looks_nowhere_else_and_one_that_fits_from_nowhere_is_not_done():
    near = Swing(np.sin((1.0 + 0.02 * 0.3) * SWING_TIMES) + 0.3)
    assert (solved_by(near).starts, near.looks) == (1, 0)
    other = Swing(np.sign(np.sin((1.0 + 0.02 * 0.3) * SWING_TIMES)))
    found = solved_by(other)
    assert [one.sensor for one in found.misfits] == ["sensor"]
    assert found.converged
    assert not found.done


def test_starting_points_go_through_payloads_and_leave_errors_of_sensors_where_they_are():
    parameters = [
        Parameter(PAYLOAD, "kg", 6400.0, 1920.0, 0.0, 6400.0),
        Parameter(DAMPING, "s", 0.004, 0.003, 8e-5, 0.022),
        Parameter("sensors.load_end.bias", "N", 0.0, 1.0, -6.0, 6.0, "load_end", "bias"),
    ]
    bounds = np.array([-10.0 / 3.0, -1.3, -6.0]), np.array([0.0, 6.0, 6.0])
    found = np.array([-2.0, 0.5, 3.0])
    near, far = starting_points(parameters, [0, 1, 2], bounds, found)
    for points, origin in ((near, found), (far, np.zeros(3))):
        assert ((points != origin).sum(axis=1) == 1).all()
        assert (points[:, 2] == origin[2]).all()
        assert ((bounds[0] <= points) & (points <= bounds[1])).all()
    assert np.ptp(far[:, 0]) == pytest.approx(10.0 / 3.0)  # from empty to full
    assert any(np.array_equal(point, [-2.0, 0.0, 0.0]) for point in far)


def test_the_check_names_what_is_not_felt_and_what_is_told_together_only():
    draws = np.random.default_rng(1)
    own, common = draws.standard_normal((2, 500))
    jacobian = np.column_stack([own, common, common + 1e-3 * own, np.zeros(500)])
    linear = Linear(jacobian, np.zeros(500))
    found = check(linear.parameters, linear.evaluate(np.zeros(4)), linear.rows)
    assert [one.told for one in found.findings] == [True, False, False, False]
    assert found.rank == 2
    assert "cannot be told apart from p2 (correlation -1.00)" in found.findings[1].reason(moved=True)
    assert "no sensor feels it here (nothing was commanded)" in found.findings[3].reason(moved=False)


def test_least_squares_keep_to_bounds_and_to_the_priors_of_what_is_not_told():
    draws = np.random.default_rng(2)
    jacobian = 3.0 * draws.standard_normal((400, 3))
    jacobian[:, 2] *= 1e-4
    found = solved(jacobian, jacobian @ [0.7, 3.0, 1.0], bounds=(-2.0, 2.0))
    first, second, third = found.estimates
    assert abs(second.value - 2.0) < 1e-6
    assert (first.at_bound, second.at_bound, third.told) == (False, True, False)
    assert (third.value, third.half) == (0.0, pytest.approx(NORMAL_95))
    assert found.converged


@pytest.mark.parametrize("lasting", [0.0, 1.0], ids=["noise", "error of the model that lasts"])
def test_intervals_cover_the_truth(lasting):
    """With noise alone, and where an error of the model makes neighbouring residuals alike."""
    draws, inside, factors = np.random.default_rng(3), [], []
    for _ in range(150):
        truth = draws.standard_normal(2)
        slow = np.repeat(draws.standard_normal((100, 3)), 10, axis=0)  # each for 5 s
        jacobian = slow[:, :2]
        measured = jacobian @ truth + draws.standard_normal(1000) + lasting * slow[:, 2]
        found = solved(jacobian, measured)
        inside += [abs(one.value - value) <= one.half for one, value in zip(found.estimates, truth, strict=True)]
        factors += [one.inflated for one in found.estimates]
    assert 0.90 <= np.mean(inside) <= 0.99
    assert (np.median(factors) > 2.0) == (lasting > 0.0)


def test_an_interval_beyond_a_bound_is_cut_there_and_it_is_said(tmp_path, capsys):
    """In the table, as `low` and `high` of the results, in the comment of the scenario and in the picture."""
    jacobian = np.column_stack([np.full(400, 0.2), np.full(400, 3.0) * (-1.0) ** np.arange(400)])
    found = solved(jacobian, jacobian @ [-1.9, 0.5], bounds=(-2.0, 2.0))
    first, second = found.estimates
    assert first.value - first.half < -2.0 == first.low < first.value < first.high
    assert (first.cut, second.cut) == (True, False)
    assert second.high - second.low == pytest.approx(2.0 * second.half)
    _print(found)
    lines = [line for line in capsys.readouterr().out.splitlines() if line.startswith("p")]
    assert [line.endswith("interval cut at its bound") for line in lines if line[:2] in ("p0", "p1")] == [True, False]
    assert " -2 to " in lines[1]
    parameter = Parameter(DAMPING, "s", 0.004, 0.003, 2e-4, 0.022)
    estimate = Estimate(parameter, 0.005, 0.003, told=True, at_bound=False, inflated=1.0)
    text = scenario_text("aerial_tramway", {}, load_scenario("aerial_tramway"), [estimate], [Path("log")])
    assert "calibrated: 0.0002 s to 0.0109 s (95 %, cut at its bound)" in text
    linear = Linear(jacobian, np.zeros(400))
    write_picture("picture", found, linear.rows, tmp_path / "picture.png")
    assert (tmp_path / "picture.png").stat().st_size > 10_000


@pytest.fixture(scope="module")
def bags(tmp_path_factory):
    """Bags of a plant with an emergency stop, of one that never moves, and of one of other values."""
    directory = tmp_path_factory.mktemp("plant")
    (directory / "trip.yaml").write_text(
        "- {time: 0.5, name: cabin, speed: 4.0}\n- {time: 8, event: emergency_stop}\n", encoding="utf-8"
    )
    (directory / "sensors.yaml").write_text(SENSORS, encoding="utf-8")
    values = [part for key, value in TRUTH.items() for part in ("--set", f"{key}={value}")]
    trip = ["--script", str(directory / "trip.yaml")]
    for name, more in (
        ("trip", [*values, *trip, "--duration", "14"]),
        ("still", [*values, "--duration", "6"]),
        ("short", ["--duration", "2"]),
    ):
        sensors = ["--sensors", str(directory / "sensors.yaml")]
        assert plant.main(["aerial_tramway", *COARSE, *sensors, *more, "--log", str(directory / name)]) == 0
    return {path.parent.parent.name: path.parent for path in directory.rglob("*.mcap")}


def test_known_truth_comes_back_and_the_same_command_goes_on(bags, tmp_path, capsys):
    command = [str(bags["trip"]), "--scenario", "aerial_tramway", *COARSE, "--free", ",".join(TRUTH)]
    command += ["--output", str(tmp_path)]
    assert main(command) == 0
    found = json.loads((tmp_path / "calibration.json").read_text())
    for one in found["parameters"]:
        assert one["value"] == pytest.approx(TRUTH[one["key"]], rel=1e-3)
        assert one["low"] < one["value"] < one["high"]
    assert {one["sensor"] for one in found["residuals"]} == {*re.findall(r"^(\w+):", SENSORS, re.MULTILINE)}
    text = (tmp_path / "calibrated.yaml").read_text()
    assert load_scenario(str(tmp_path / "calibrated.yaml")).carriages["cabin"].payload.mass == pytest.approx(4200, 1e-3)
    assert "# kg/m: steel of 7850 kg/m^3" in text  # what stood there stays
    (line,) = re.findall(r"rolling: .*", text)
    assert re.search(r"# calibrated: \+- \S+ \(95 %\), prior 0.005 \+- ", line)
    assert (tmp_path / "calibration.png").stat().st_size > 30_000
    first = capsys.readouterr()
    assert main(command) == 0
    again = capsys.readouterr()
    assert again.out == first.out
    assert f"goes on with {found['evaluations']} evaluations" in again.err


def test_a_run_that_does_not_fit_is_no_success_and_its_line_says_so(bags, tmp_path, capsys):
    """The payload of the plant is another one than that of the scenario, and not free."""
    command = [str(bags["trip"]), "--scenario", "aerial_tramway", *COARSE, "--free", ROLLING]
    command += ["--output", str(tmp_path)]
    assert main(command) == 1
    first = capsys.readouterr()
    (line,) = re.findall(r"calibrate: the run does not fit.*", first.err)
    assert re.search(
        r"from any of \d starting points: values and intervals are not to be trusted; residuals: given .*force_cabin "
        r"\S+.* standard deviations; allowed: 1.5 or less$",
        line,
    )
    found = json.loads((tmp_path / "calibration.json").read_text())
    assert found["converged"] is False
    assert "force_cabin" in found["do_not_fit"]
    assert (tmp_path / "calibrated.yaml").exists()
    assert main(command) == 1
    assert capsys.readouterr().out == first.out


def test_a_look_at_points_leaves_out_those_without_a_rest(bags, tmp_path):
    """And is else what an evaluation at the point has as residuals."""
    options = parser().parse_args(
        [str(bags["trip"]), "--scenario", "aerial_tramway", *COARSE, "--free", f"cable.axial_stiffness,{BIAS}"]
    )
    predictor = prepare(options).predictor
    points = np.array([[0.0, 0.0], [-5.9, 0.0], [0.3, 2.0]])  # 55 MN: the counterweight sinks to its stop
    residuals = predictor.look(points)
    assert np.isposinf(residuals[:, 1]).all()
    for row in (0, 2):
        np.testing.assert_allclose(residuals[:, row], predictor.evaluate(points[row]).residuals, atol=1e-6)


@pytest.mark.long
def test_half_a_payload_is_found_from_the_full_one_with_the_right_stiffness(tmp_path):
    """From 6400 kg the search ends first with half of the stiffness, at residuals of 3 standard deviations.

    So it does with contact points of the saddle 1 m apart, which shake the cabin; with close ones the first search
    finds the truth.
    """
    mesh = "cable.elements={target: 30.0, at_towers: 1.5, growth: 2.5}"
    rough = ["--set", mesh, "--set", "towers.tower.contacts=25", "--set", "towers.tower.stiffness=0.4e6"]
    truth = {PAYLOAD: 2500.0, "cable.axial_stiffness": 520e6, "cable.mass_per_length": 24.6}
    script = tmp_path / "trip.yaml"
    script.write_text(
        "- {time: 1, name: cabin, speed: 8.0}\n- {time: 40, event: emergency_stop}\n"
        "- {time: 60, event: release}\n- {time: 61, name: cabin, speed: -6.0}\n",
        encoding="utf-8",
    )
    values = [part for key, value in truth.items() for part in ("--set", f"{key}={value}")]
    command = ["aerial_tramway", *rough, *values, "--script", str(script), "--duration", "100"]
    assert plant.main([*command, "--log", str(tmp_path / "bag")]) == 0
    (bag,) = (tmp_path / "bag").iterdir()
    keys = ",".join([*truth, DAMPING, ROLLING, MASS])
    command = [str(bag), "--scenario", "aerial_tramway", *rough, "--free", keys]
    assert main([*command, "--output", str(tmp_path / "out")]) == 0
    found = json.loads((tmp_path / "out" / "calibration.json").read_text())
    for one in found["parameters"]:
        if one["key"] in truth:
            assert one["low"] < truth[one["key"]] < one["high"]
            assert one["value"] == pytest.approx(truth[one["key"]], rel=2e-3)
    assert found["starting_points"] > 1
    assert found["converged"]


def test_a_run_that_never_moved_says_what_it_cannot_give(bags, tmp_path, capsys):
    keys = f"{PAYLOAD},{MASS},{ROLLING},{DAMPING}"
    output = tmp_path / "out"
    command = [str(bags["still"]), "--scenario", "aerial_tramway", *COARSE, "--free", keys, "--output", str(output)]
    assert main(command) == 0
    out = capsys.readouterr().out
    assert re.search(
        r"^check: the logs tell \d of 4 directions better than priors: deviations of priors are ", out, re.M
    )
    for key, run in ((ROLLING, "a run at constant speed"), (DAMPING, "a run with an emergency stop")):
        assert re.search(rf"^  {re.escape(key)} cannot be told: .*\(nothing was commanded\); {run}", out, re.MULTILINE)
    found = {one["key"]: one for one in json.loads((output / "calibration.json").read_text())["parameters"]}
    assert (found[ROLLING]["value"], found[ROLLING]["told"], found[DAMPING]["told"]) == (0.005, False, False)
    assert found[PAYLOAD]["value"] == pytest.approx(4200.0, rel=1e-3)
    (line,) = re.findall(r"rolling: .*", (output / "calibrated.yaml").read_text())
    assert "prior kept: the logs do not tell it" in line


@pytest.fixture(scope="module")
def lift_bag(tmp_path_factory):
    """Bag of a chairlift with a stiffer rope and lighter payloads than the scenario."""
    directory = tmp_path_factory.mktemp("lift")
    (directory / "start.yaml").write_text("- {time: 0.2, name: haul_rope, speed: 2.5}\n", encoding="utf-8")
    (directory / "sensors.yaml").write_text(LIFT_SENSORS, encoding="utf-8")
    values = {"ropes.up.axial_stiffness": 70e6, "ropes.down.axial_stiffness": 70e6, LEAVING: 200.0}
    options = [part for key, value in values.items() for part in ("--set", f"{key}={value}")]
    options += ["--sensors", str(directory / "sensors.yaml"), "--script", str(directory / "start.yaml")]
    assert plant.main(["chairlift", *options, "--duration", "5", "--log", str(directory / "bag")]) == 0
    (bag,) = (directory / "bag").iterdir()
    return str(bag)


def test_strands_of_one_loop_have_one_stiffness_and_payloads_of_carriers_stay_within_capacity(
    lift_bag, tmp_path, capsys
):
    keys = f"ropes.down.axial_stiffness,ropes.up.axial_stiffness,{LEAVING}"
    assert main([lift_bag, "--scenario", "chairlift", "--free", keys, "--output", str(tmp_path)]) == 0
    stiffness, payload = json.loads((tmp_path / "calibration.json").read_text())["parameters"]
    assert (stiffness["key"], stiffness["joined"]) == ("ropes.down.axial_stiffness", ["ropes.up.axial_stiffness"])
    assert stiffness["value"] == pytest.approx(70e6, rel=1e-3)
    assert (payload["value"], payload["bounds"]) == (pytest.approx(200.0, abs=0.1), [0.0, 300.0])
    found = load_scenario(str(tmp_path / "calibrated.yaml")).ropes
    assert found["up"].axial_stiffness == found["down"].axial_stiffness == pytest.approx(stiffness["value"])
    assert "kN  = ropes.up.axial_stiffness" in capsys.readouterr().out


def test_one_rope_has_one_prior(lift_bag, tmp_path, capsys):
    priors = [f"--prior=ropes.{rope}.axial_stiffness=60e6:5e6" for rope in ("up", "down")]
    command = [lift_bag, "--free", "ropes.up.axial_stiffness", *priors, "--output", str(tmp_path / "out")]
    assert main(command) == 2
    assert "and ropes.down.axial_stiffness, of one rope; allowed: one of them" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("name", "given", "keys"),
    [
        ("chairlift", {"towers.tower_3.friction": 0.03}, ["towers.tower_3_up.friction"]),
        ("chairlift", {"towers.tower_3.ropes.up.stiffness": 2e5}, ["towers.tower_3.friction"]),
        ("gondola", {}, ["drives.haul_rope.limits.jerk", "towers.tower_2_down.position.z"]),
        ("windy_tramway", {}, ["air.wind.x", "air.wind.y"]),  # not in the file
        ("bicable", {}, ["ropes.track_up.start.mass"]),  # an alias is of another rope
        ("jig_back", {}, ["carriages.cabin_1.payload.mass", "ropes.track_1.start.mass"]),  # as is a merged part
    ],
)
def test_a_calibrated_file_keeps_its_comments_and_has_what_was_found_and_nothing_else(name, given, keys):
    scenario = load_scenario(name, given)
    resolved = scenario.resolved()
    estimates, found = [], {}
    for number, key in enumerate(keys):
        own = scenario_keys(resolved, key)
        value = round(0.9 * (value_at(resolved, own[0]) or 0.0) + 0.5 * (number + 1), 3)
        parameter = Parameter(own[0], "-", value, 1.0, value - 1.0, value + 1.0, joined=(*own[1:],))
        estimates.append(Estimate(parameter, value, 0.5, told=True, at_bound=False, inflated=1.0))
        found |= dict.fromkeys(own, value)
    text = scenario_text(name, given, scenario, estimates, [Path("log")])
    assert load_scenario(read_yaml(text).content, {"name": name}) == load_scenario(resolved, found)
    before = scenario_file(name).read_text(encoding="utf-8")
    assert before.count("#") - len(keys) <= text.count("#")
    assert before.splitlines()[3] in text
    assert text.count("calibrated: +-") == len(keys)
    assert text.count("given by --set") == len(given)


def test_a_key_of_a_tower_is_one_parameter_of_all_its_ropes():
    simulation = Simulation(load_scenario("chairlift", {"towers.tower_2.ropes.up.stiffness": 2e5}))
    (one,) = parameters_of(simulation, ["towers.tower_3.stiffness"], {"towers.tower_3.stiffness": Prior(3e5, 1e4)}, {})
    assert one.keys == ("towers.tower_3_up.stiffness", "towers.tower_3_down.stiffness")
    assert (one.mean, one.deviation, one.given) == (3e5, 1e4, True)
    (alone,) = parameters_of(simulation, ["towers.tower_2.ropes.up.stiffness"], {}, {})
    assert (alone.keys, alone.mean) == (("towers.tower_2_up.stiffness",), 2e5)
    for keys, said in (
        (["towers.tower_2.stiffness"], "of different values; allowed: each for itself"),
        (["towers.tower_3_down.stiffness", "towers.tower_3.stiffness"], "given towers.tower_3_down.stiffness twice"),
    ):
        with pytest.raises(CalibrationError, match=said):
            parameters_of(simulation, keys, {}, {})


def test_bounds_keep_to_what_the_schema_allows():
    """Of ice from 0 on, temperature from its default on and a strong wind: six deviations reach beyond."""
    simulation = Simulation(load_scenario("aerial_tramway"))
    priors = {"air.wind.x": Prior(90.0, 5.0)}
    found = parameters_of(simulation, ["cable.ice", "air.temperature", "wind.x"], priors, {})
    assert [(one.key, one.mean, one.deviation, one.low, one.high) for one in found] == [
        ("cable.ice", 0.0, 1.0, 0.0, 6.0),
        ("air.temperature", 20.0, 15.0, -70.0, 100.0),
        ("air.wind.x", 90.0, 5.0, 60.0, 100.0),
    ]
    for key, mean, said in (
        ("cable.ice", -0.05, "--prior: cable.ice: given a mean of -0.05 kg/m; allowed: at least 0 kg/m"),
        (PAYLOAD, 9000.0, "given a mean of 9000 kg; allowed: at least 0 kg and at most 6400 kg"),
    ):
        with pytest.raises(CalibrationError, match=re.escape(said)):
            parameters_of(simulation, [key], {key: Prior(mean, 1.0)}, {})


def test_the_friction_of_a_tower_without_one_is_free_from_its_usual_value():
    simulation = Simulation(load_scenario("chairlift"))
    (one,) = parameters_of(simulation, ["towers.tower_3.friction"], {}, {})
    assert one.keys == ("towers.tower_3_up.friction", "towers.tower_3_down.friction")
    assert (one.mean, one.deviation) == (0.03, pytest.approx(0.015))
    said = "--free: towers.tower_3.mast_offset: given null in this scenario; allowed: with --set towers.tower_3.mast_o"
    with pytest.raises(CalibrationError, match=re.escape(said)):
        parameters_of(simulation, ["towers.tower_3.mast_offset"], {}, {})


@pytest.mark.parametrize(
    ("bag", "options", "said"),
    [
        ("trip", ["--free", "cable.no_such"], "cable.no_such: this key does not exist"),
        ("trip", ["--free", "carriages.other.payload.mass"], "given no number in this scenario"),
        ("trip", ["--free", "cable.unstrained_length"], "needs another mesh; allowed: keys that leave ropes"),
        ("trip", ["--free", "cable.elastic_model"], "given no number in this scenario; allowed: keys with a number"),
        ("trip", ["--free", "wind.x,wind.x"], "given air.wind.x twice"),
        ("trip", ["--free", "cable.ice.thickness"], "cable.ice.thickness"),
        ("trip", ["--free", "sensors.no_such.bias"], "given sensor 'no_such'; allowed: encoder_cabin"),
        ("trip", ["--free", PAYLOAD, "--prior", "wind.x=0:1"], "given air.wind.x; allowed: a key given in --free"),
        ("trip", ["--free", PAYLOAD, "--prior", f"{PAYLOAD}=4000:0"], "allowed: KEY=VALUE:DEVIATION"),
        (
            "trip",
            ["--free", PAYLOAD, "--scenario", "single_span"],
            "given a log of aerial_tramway (towers: tower); allowed: one of single_span",
        ),
        ("short", ["--free", PAYLOAD], "length: given 2 s; allowed: 5 s or more"),
        (
            "trip",
            ["--free", PAYLOAD, "--set", "sensors={a: {kind: imu, of: cabin}}"],
            "no measurements of any sensor; allowed: a log of `plant`",
        ),
        ("nothing", ["--free", PAYLOAD], "no such file or directory"),
    ],
)
def test_what_cannot_be_used_is_a_line(bags, tmp_path, refusal, bag, options, said):
    assert said in refusal(main, bags.get(bag, tmp_path / "nothing"), *options, "--output", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_logs_of_different_scenarios_are_a_line(bags, tmp_path, refusal):
    line = refusal(main, bags["trip"], bags["short"], "--free", PAYLOAD, "--output", tmp_path / "out")
    assert "allowed: logs of one scenario" in line
    assert re.search(r"given \S+, in .*trip", line)
