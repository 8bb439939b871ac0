"""Load cases: the file and its faults, extremes with the governing case, kept results, rules of load cases."""

from __future__ import annotations

import csv
import importlib
import json
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import brentq

from cable_twin.key_figures import KeyFigures, Subject, figure
from cable_twin.key_figures.rules import RuleVerdict
from cable_twin.offline import envelope
from cable_twin.offline.envelopes.cases import CaseError, loading, read_cases
from cable_twin.offline.envelopes.motion import StopSearch, run_dynamic
from cable_twin.offline.envelopes.ranges import RangeCollector
from cable_twin.offline.envelopes.runs import CaseResult, Job, _line, run_case
from cable_twin.offline.envelopes.search import Search
from cable_twin.offline.envelopes.tensioning import tensioning
from cable_twin.scenario import ScenarioError, load_scenario
from cable_twin.scenario.files import config_directory
from cable_twin.simulation import Simulation
from cable_twin.simulation.rests import Rests, differ_in_loads
from cable_twin.simulation.vehicles import _rooms
from verification import JIT

PEAKS = {"a/r/highest": 1.37, "b/r/highest": 0.0, "c/r/highest": 2.86}
CASES = """\
cases:
  - {id: heavy, name: more counterweight, loading: empty, set: {sheaves.return.counterweight.mass: 36000.0}}
product:
  load: {empty: {loading: empty}, up: {name: full up, loading: up_full}}
  air: {cold: {set: {air.temperature: -20.0}}}
"""


def cases_in(directory, text):
    file = directory / "cases.yaml"
    file.write_text(text, encoding="utf-8")
    return file


@pytest.mark.parametrize(("name", "place"), [("aerial_tramway", 12.0), ("gondola", 0.0), ("pantograph", 0.0)])
def test_one_place_is_that_of_the_scenario(name, place):
    """That of its carriage; carriers, and lines without a vehicle, are where they are at a travel of 0."""
    line = _line(load_scenario(name), 1)
    assert (line.moved, line.places.tolist()) == ("", [place])


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("cases: 3", "cases: given 3; allowed: a list of mappings with id, name, loading, tensioning, set"),
        ("cases: [{name: x}]", "cases.0: given a mapping without an id; allowed: a mapping with id, name"),
        ("cases: [{id: a, sett: {}}]", "cases.0.sett: this key does not exist; allowed: id, name, loading"),
        ("cases: [{id: a}, {id: a}]", "a: given twice; allowed: each id once"),
        ("cases: [{id: a, loading: half}]", "a: loading: given 'half'; allowed: empty, full, up_full, down_full"),
        ("cases: [{id: a, set: {gravity: -1}}]", "a: gravity: given -1 m/s^2; allowed: a finite number at least 0, in"),
        ("product: {load: [1]}", "product: given a mapping; allowed: mappings of factors to levels by id"),
        ("case: []", "case: this key does not exist; allowed: cases, product"),
        ("cases: [{id: 3}]", "cases.0: given a mapping with the id 3, no text; allowed: a mapping with id, name"),
        ('cases: [{id: "a\\nb"}]', r"cases.0: given a mapping with the id 'a\nb', no text; allowed: a mapping with id"),
        ("cases: [{id: a, name: [x]}]", "cases.0.name: given ['x']; allowed: a text of one line"),
        ("cases: [{id: a, loading: [full]}]", "a: loading: given ['full']; allowed: empty, full, up_full, down_full"),
        ("product: {}", "product: given an empty mapping; allowed: mappings of factors to levels by id"),
        ("product: {a: {x: {loading: full}}, b: {y: {loading: empty}}}", "product.b: given loading, as"),
        ("product: {a: {x: {set: {gravity: 9}}}, b: {y: {set: {gravity: 8}}}}", "product.b: given set.grav"),
        ("{}", "given no case; allowed: a list `cases`, or a mapping `product`"),
    ],
)
def test_faults_of_a_file_are_a_line_each(tmp_path, text, told):
    with pytest.raises(CaseError) as error:
        read_cases(cases_in(tmp_path, text), "chairlift", {})
    line, *_ = str(error.value).splitlines()
    assert line.startswith(f"{tmp_path / 'cases.yaml'}: ")
    assert told in line


def test_wrong_files_and_profiles_are_a_line(tmp_path, capsys):
    assert envelope.main(["chairlift", "--cases", str(tmp_path / "nowhere.yaml")]) == 2
    file = cases_in(tmp_path, "cases: [{id: a, load_cases: [france_1985.uplift]}]")
    assert envelope.main(["jig_back", "--cases", str(file)]) == 2
    first, second = capsys.readouterr().err.splitlines()
    assert "cannot be read (No such file or directory); allowed: a YAML file of load cases" in first
    assert "limits.load_cases.0: given 'france_1985.uplift': without a profile there is no load case" in second


@pytest.mark.parametrize(
    ("case", "told"),
    [
        (
            "tensioning: loose",
            "tensioning: given 'loose'; allowed: stops, stuck, least_travel, most_travel, or a travel",
        ),
        ("tensioning: true", "tensioning: given True; allowed: stops"),
        ("tensioning: 4.5", "tensioning: given 4.5 m; allowed: -4 to 4 m, by sheaves.return.counterweight.travel"),
        ("worst_place: 3", "worst_place: given 3; allowed: a mapping with figures, a list of their ids"),
        ("worst_place: {figures: [sag]}", "worst_place.figures: id: given 'sag'; allowed: quantity/subject/statistic"),
        (
            "worst_place: {figures: [a/b/lowest], points: 2}",
            "worst_place.points: given 2; allowed: a whole number from",
        ),
        (
            "worst_place: {figure: 1, figures: [a/b/lowest]}",
            "worst_place.figure: this key does not exist; allowed: poi",
        ),
    ],
)
def test_faults_of_tensioning_and_places_are_a_line(tmp_path, case, told):
    with pytest.raises(CaseError) as error:
        read_cases(cases_in(tmp_path, f"cases: [{{id: a, {case}}}]"), "chairlift", {})
    assert str(error.value).startswith(f"{tmp_path / 'cases.yaml'}: a: {told}")


def test_what_nothing_tensions_and_nothing_moves_is_a_line(tmp_path):
    (tmp_path / "span.yaml").write_text(SPAN, encoding="utf-8")
    for key, told in (
        ("tensioning: stuck", "nothing tensions a rope here"),
        ("worst_place: {figures: [a/b/lowest]}", "no"),
    ):
        with pytest.raises(CaseError, match=f"{told}"):
            read_cases(cases_in(tmp_path, f"cases: [{{id: a, {key}}}]"), tmp_path / "span.yaml", {})


def test_held_devices_move_the_ends_of_their_ropes():
    values = tensioning(load_scenario("chairlift"), "most_travel")
    way = 4.0 * np.array([-0.98, -0.197]) / np.hypot(0.98, 0.197)
    assert values["sheaves.return.counterweight"] is None
    moved = load_scenario("chairlift", values)
    for rope, end in (("up", "start"), ("down", "end")):
        before = load_scenario("chairlift").ropes[rope].ends[end].position
        assert np.subtract(moved.ropes[rope].ends[end].position, before) == pytest.approx(way, abs=1e-12)
    track = load_scenario("aerial_tramway", tensioning(load_scenario("aerial_tramway"), "stuck"))
    assert (track.cable.start.support, track.cable.start.mass) == ("pinned", None)


def test_one_chair_at_its_worst_place_is_one_case_of_the_whole_loop(tmp_path):
    text = "cases: [{id: one, loading: one, worst_place: {figures: [a/b/lowest]}}]"
    (case,) = read_cases(cases_in(tmp_path, text), "chairlift", {})
    assert (case.id, case.worst_place.one, case.worst_place.points) == ("one", True, 40)


def test_search_finds_what_lies_between_the_points_of_its_grid():
    tried = []

    def at(value):
        tried.append(value)
        heights = {key: -((value - peak) ** 2) for key, peak in PEAKS.items()}
        return {key: figure("sag", Subject("r"), "highest", one, 0.0) for key, one in heights.items()}

    search = Search(at, 0.01, "worst_place")
    for key, peak in PEAKS.items():
        search.refine(key, [0.0, 1.0, 2.0, 3.0])
        assert search.worst(key)[0] == pytest.approx(peak, abs=0.02)
    assert len(tried) == len(set(tried)) < 60


def test_loading_plans():
    chairs = loading(load_scenario("chairlift"), "up_full")
    assert chairs["carriers.payload.leaving"] == {"drive": 0.0, "return": 300.0}
    alike = {"carriers.payload.leaving": {}, "carriers.payload.from_start": 100.0}
    assert load_scenario("chairlift", alike | chairs).carriers.payload.from_start is None
    cabins = loading(load_scenario("jig_back"), "down_full")
    assert cabins == {"carriages.cabin_1.payload.mass": 0.0, "carriages.cabin_2.payload.mass": 6400.0}
    assert loading(load_scenario("jig_back"), "every_second") == {
        "carriages.cabin_1.payload.mass": 6400.0,
        "carriages.cabin_2.payload.mass": 0.0,
    }
    odd = loading(load_scenario("chairlift"), "every_second")
    assert odd["carriers.payload.leaving"] == {"drive": 300.0, "return": 300.0}
    assert odd["carriers.loaded"] == [*range(1, 28, 2)]
    masses = [one.payload.mass for one in load_scenario("chairlift", odd).of_rope("up").vehicles.values()]
    assert masses == [300.0, 0.0] * 14
    again = loading(load_scenario("chairlift", odd), "full")
    vehicles = load_scenario("chairlift", odd | again).of_rope("up").vehicles
    assert {one.payload.mass for one in vehicles.values()} == {300.0}


def test_one_vehicle_is_a_case_for_each(tmp_path):
    file = cases_in(tmp_path, "product: {load: {one: {name: one chair, loading: one}}, air: {still: {}}}")
    cases = read_cases(file, "chairlift", {})
    assert [one.id for one in cases] == [f"one+still+chair_{number}" for number in range(1, 29)]
    assert cases[4].name == "one chair, still, chair_5 full"
    masses = [one.payload.mass for one in cases[4].scenario.of_rope("up").vehicles.values()]
    assert masses == [300.0 if number == 4 else 0.0 for number in range(28)]


def test_carriers_that_are_not_loaded_stay_empty(tmp_path):
    with pytest.raises(ScenarioError, match=r"carriers\.loaded: given 29; allowed: numbers of carriers from 1 to 28"):
        load_scenario("chairlift", {"carriers.loaded": [3, 29]})
    scenario = load_scenario("chairlift", {"carriers.loaded": [3]})
    rooms = _rooms(scenario.of_rope("up"))
    assert (rooms["chair_3"].from_start, rooms["chair_4"].from_start) == (300.0, 0.0)


@pytest.fixture(scope="module")
def calculated(tmp_path_factory):
    """Three load cases of the chairlift, kept and exported, under a profile."""
    directory = tmp_path_factory.mktemp("envelope")
    file = cases_in(directory, CASES)
    options = ["chairlift", "--cases", file, "--places", 1, "--results", directory / "kept"]
    options += ["--plot", directory / "all.png"]
    options += [
        "--set",
        "limits.profile=[pennsylvania]",
        "--json",
        directory / "all.json",
        "--csv",
        directory / "all.csv",
    ]
    assert envelope.main([*map(str, options)]) == 0
    return directory, [*map(str, options)]


def test_each_extreme_has_the_case_that_governs(calculated):
    directory, _ = calculated
    data = json.loads((directory / "all.json").read_text())
    assert (directory / "all.png").stat().st_size > 10_000
    assert [(one["id"], one["name"]) for one in data["cases"]] == [
        ("heavy", "more counterweight"),
        ("empty+cold", "empty, cold"),
        ("up+cold", "full up, cold"),
    ]
    found = {one["id"]: one for one in data["envelope"]}
    start = {which: found[f"support_load/ropes.up.start/{which}"] for which in ("highest", "lowest")}
    assert start["highest"]["case"] == "heavy"
    assert start["highest"]["value"] == pytest.approx(36e3 * 9.81 / 2.0, rel=2e-3)  # half the counterweight a strand
    assert start["lowest"]["value"] == pytest.approx(33e3 * 9.81 / 2.0, rel=2e-3)
    assert found["sag/ropes.up.tower_3_up+tower_4_up/highest"]["case"] == "up+cold"
    scenario = load_scenario("chairlift", loading(load_scenario("chairlift"), "up_full") | {"air.temperature": -20.0})
    figures = KeyFigures(scenario)
    figures.update(Simulation(scenario).snapshot)
    alone = {str(one.id): one.value for one in figures.figures()}
    with (directory / "all.csv").open(encoding="utf-8", newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["case"] == "up+cold"]
    assert not any(None in row or None in row.values() for row in rows)  # each is as wide as the first line
    same = [row for row in rows if row["id"] in alone]
    assert len(same) > 40
    assert all(float(row["value"]) == pytest.approx(alone[row["id"]], rel=1e-6, abs=1e-9) for row in same)
    (rule,) = data["rules"]
    assert (rule["check"], rule["verdict"]) == ("USPA-01", "not kept")  # at rest it is the static factor


LOADS = (
    {"carriers.payload.leaving": {"return": 300.0, "drive": 300.0}, "air.wind": [-15.0, 0.0]},
    {"sheaves.return.counterweight.mass": 36.0e3, "carriers.loaded": [2, 3, 20]},
    {"air.wind": [12.0, -3.0]},
)


@pytest.mark.skipif(not JIT, reason="minutes without compilation")
def test_rests_under_other_loads_are_those_from_scratch_and_have_no_memory():
    rests = Rests(load_scenario("chairlift"))
    found = []
    for changes in (*LOADS, LOADS[0]):
        scenario = load_scenario("chairlift", changes)
        assert differ_in_loads(scenario, load_scenario("chairlift"))
        assert rests.under(scenario) is rests
        here, figures = rests.snapshot, []
        for snapshot in (here, Simulation(scenario, on_demand=True).snapshot):
            key_figures = KeyFigures(scenario)
            key_figures.update(snapshot)
            figures.append({str(one.id): one.value for one in key_figures.figures()})
        assert figures[0] == pytest.approx(figures[1], rel=1e-6, abs=1e-6), changes
        found.append(here.numbers.tobytes())
    assert found[3] == found[0] != found[1]


@pytest.mark.parametrize("changes", [{"air.temperature": -5.0}, {"ropes.up.ice": 1.0}, {"towers.tower_2.radius": 24.0}])
def test_what_is_no_load_is_calculated_from_scratch(changes):
    assert not differ_in_loads(load_scenario("chairlift", changes), load_scenario("chairlift"))


def test_finished_cases_are_not_calculated_again(calculated, capsys, monkeypatch):
    directory, options = calculated
    options = list(options)
    before = (directory / "all.csv").read_bytes()
    monkeypatch.setattr("cable_twin.offline.envelope.run_part", None)
    assert envelope.main(options) == 0
    assert f"3 of 3 cases are in {directory / 'kept'} already" in capsys.readouterr().err
    assert (directory / "all.csv").read_bytes() == before
    options[options.index("--csv") + 1] = "-"
    assert envelope.main(options) == 0
    assert capsys.readouterr().out.encode() == before  # and stdout is still open


@pytest.mark.long
def test_processes_have_the_bits_of_one(calculated, tmp_path):
    directory, _ = calculated
    text = CASES + "    hot: {set: {air.temperature: 40.0}}\n"
    text = text.replace(
        "  air: {cold: {set: {air.temperature: -20.0}}}\n", "  air:\n    cold: {set: {air.temperature: -20.0}}\n"
    )
    options = ["chairlift", "--cases", cases_in(tmp_path, text), "--places", 1, "--csv", tmp_path / "all.csv"]
    assert envelope.main([*map(str, options)]) == 0
    rows = (tmp_path / "all.csv").read_text(encoding="utf-8").splitlines()
    assert {row.partition(",")[0] for row in rows[1:]} == {"heavy", "empty+cold", "empty+hot", "up+cold", "up+hot"}
    assert set((directory / "all.csv").read_text(encoding="utf-8").splitlines()) <= set(rows)


@pytest.mark.parametrize(
    ("dynamic", "told"),
    [
        ("3", "dynamic: given 3; allowed: a mapping with script, and duration, stop"),
        ("{script: nowhere.yaml}", "nowhere.yaml: No such file or directory"),
        ("{script: trip.yaml, durations: 1}", "dynamic.durations: this key does not exist; allowed: script, duration"),
        ("{script: trip.yaml, stop: {}}", "dynamic.stop: given an empty mapping; allowed: a mapping with figures"),
        ("{script: trip.yaml, stop: {figures: [swing]}}", "dynamic.stop.figures: id: given 'swing'; allowed: quantity"),
        ("{script: trip.yaml, duration: -1}", "dynamic.duration: given -1; allowed: a number from 0"),
        ("{script: trip.yaml, stop: {figures: [a/b/lowest], from: 5, to: 5}}", "dynamic.stop: given from 5, to 5 s"),
    ],
)
def test_faults_of_runs_are_a_line(tmp_path, dynamic, told):
    (tmp_path / "trip.yaml").write_text("- {time: 0, name: cabin, speed: 6.0}\n", encoding="utf-8")
    with pytest.raises(CaseError) as error:
        read_cases(cases_in(tmp_path, f"cases: [{{id: a, dynamic: {dynamic}}}]"), "aerial_tramway", {})
    (line,) = str(error.value).splitlines()
    assert f"{tmp_path / 'cases.yaml'}: a: " in line
    assert told in line


SWING, TENSION = "swing/carriages.cabin/highest", "rope_tension/ropes.cable/highest"
RUNS = f"""\
cases:
  - {{id: rest, loading: full}}
  - {{id: trip, loading: full, dynamic: {{script: trip.yaml, duration: 3}}}}
  - id: stop
    loading: full
    dynamic:
      script: trip.yaml
      stop: {{from: 5, to: 15, points: 6, settle: 4, figures: [{SWING}, {TENSION}]}}
"""


@pytest.mark.skipif(not JIT, reason="minutes without compilation")
@pytest.mark.long
def test_the_worst_stop_is_at_least_as_bad_as_on_a_grid_ten_times_as_dense(tmp_path, monkeypatch):
    (tmp_path / "trip.yaml").write_text("- {time: 0, name: cabin, speed: 6.0}\n", encoding="utf-8")
    file, kept = cases_in(tmp_path, RUNS), tmp_path / "kept"
    options = ["aerial_tramway", "--cases", file, "--places", 1, "--results", kept, "--json", tmp_path / "all.json"]
    assert envelope.main([*map(str, options)]) == 0
    text = (tmp_path / "all.json").read_text()
    data = json.loads(text)
    assert [one["dynamic"] for one in data["cases"]] == [False, True, True]
    found = {one["id"]: one for one in data["envelope"]}
    _, trip, stop = read_cases(file, "aerial_tramway", {})
    dense = stop.dynamic.stop._replace(points=51)
    monkeypatch.setattr(StopSearch, "refine", lambda *_: None)
    moments = StopSearch(stop.scenario, stop.dynamic, dense, RangeCollector(stop.scenario)).tried
    assert len(moments) == 51
    for key in (SWING, TENSION):
        assert found[key]["case"] == "stop"
        assert found[key]["value"] >= max(one[key].value for one in moments.values())
    begin, _ = run_dynamic(trip.scenario, trip.dynamic._replace(script=(), duration=0.0), RangeCollector(trip.scenario))
    rest = {str(one.id): one.value for one in run_case(Job(read_cases(file, "aerial_tramway", {})[0], 1)).figures}
    same = {str(one.id): one.value for one in begin if str(one.id) in rest}
    assert len(same) > 10
    assert same == pytest.approx({key: rest[key] for key in same}, rel=1e-6, abs=1e-9)

    monkeypatch.setattr("cable_twin.offline.envelope.run_part", None)  # nothing is run any more
    assert envelope.main([*map(str, options)]) == 0
    assert (tmp_path / "all.json").read_text() == text


SPAN = """\
cable:
  unstrained_length: 200.5
  mass_per_length: 2.0
  axial_stiffness: 2.0e7
  bending_stiffness: 1.0
  thermal_expansion: 1.2e-5
  reference_temperature: 10.0
  diameter: 0.03
  elements: 200
  start: {position: [0.0, 0.0]}
  end: {position: [200.0, 0.0]}
solver: {step: 0.01}
"""


@pytest.mark.skipif(not JIT, reason="minutes without compilation")
def test_a_span_has_the_elastic_catenary_of_each_temperature_and_ice(tmp_path):
    """Level span: 2 H/w asinh(w S / 2H) + H S / EA = 200 m, with S longer by the thermal strain, w with ice."""
    (tmp_path / "span.yaml").write_text(SPAN, encoding="utf-8")
    text = "product:\n  air: {cold: {set: {air.temperature: -30}}, hot: {set: {air.temperature: 50}}}\n"
    text += "  ice: {bare: {}, iced: {set: {cable.ice: 3.0}}}\n"
    for case in read_cases(cases_in(tmp_path, text), tmp_path / "span.yaml", {}):
        found = {str(one.id): one.value for one in run_case(Job(case, 1)).figures}
        warmer, iced = case.scenario.air.temperature - 10.0, "iced" in case.id
        length = 200.5 * (1.0 + 1.2e-5 * warmer)
        half = 0.5 * (5.0 if iced else 2.0) * 9.81 * 200.5  # N, half the weight

        def beyond(h, half=half, length=length):
            return length * (h / half * np.arcsinh(half / h) + h / 2e7) - 200.0

        h = brentq(beyond, 1e3, 1e6, xtol=1e-6)
        sag = length * (np.hypot(h, half) - h) / (2.0 * half) + half * length / (4.0 * 2e7)
        assert found["rope_tension/ropes.cable/highest"] == pytest.approx(np.hypot(h, half), rel=2e-4), case.id
        assert found["sag/ropes.cable.start+end/highest"] == pytest.approx(sag, rel=1e-3), case.id


def test_adhesion_and_travel_are_those_of_capstan_and_counterweight(calculated, tmp_path):
    directory, _ = calculated
    with (directory / "all.csv").open(encoding="utf-8", newline="") as file:
        rows = {row["id"]: float(row["value"]) for row in csv.DictReader(file) if row["case"] == "up+cold"}
    ratio = rows["support_load/ropes.up.end/highest"] / rows["support_load/ropes.down.start/highest"]
    assert rows["adhesion_used/sheaves.drive/highest"] == pytest.approx(np.log(ratio) / (0.22 * np.pi), rel=1e-3)
    heavy = "cases: [{id: heavy, set: {sheaves.return.counterweight.travel: [-0.01, 0.01]}}]"
    (case,) = read_cases(cases_in(tmp_path, heavy), "chairlift", {})
    assert "counterweight.travel: given -0.01 to 0.01 m, but it rests at" in run_case(Job(case, 1)).fault


def test_mean_decelerations_of_stops_are_among_the_extremes():
    drive = Subject("drives.haul_rope", "haul_rope")

    def stop(case, *values):
        return CaseResult(case, tuple(figure("mean_deceleration", drive, *one, 0.0) for one in values))

    hard, soft = stop("hard", ("mean", 1.4)), stop("soft", ("mean", 0.7), ("highest", 0.9), ("lowest", 0.6))
    found = {str(one.id): (case, one.value, one.name) for case, one in envelope.envelope([hard, soft])}
    name = "haul_rope: mean deceleration of the stop"
    assert found == {
        "mean_deceleration/drives.haul_rope/highest": ("hard", 1.4, f"{name}, highest"),
        "mean_deceleration/drives.haul_rope/lowest": ("soft", 0.6, f"{name}, lowest"),
    }


def test_the_picture_says_how_many_cases_move_and_its_axis_begins_at_zero(tmp_path, monkeypatch):
    plots = pytest.importorskip("matplotlib.pyplot")
    plot = importlib.import_module("cable_twin.offline.envelopes.plot")
    cases = [SimpleNamespace(scenario=SimpleNamespace(name="lift"), moves=one) for one in (False, True)]
    sag = figure("sag", Subject("ropes.up.0"), "highest", 7.0, 0.0)
    found, lost = CaseResult("found", (sag,)), CaseResult("lost", ())
    assert envelope._title(cases, [found] * 2) == "lift, 1 load case at rest and 1 load case in motion"
    assert envelope._title(cases[:1] * 2, [found] * 2) == "lift, 2 load cases at rest"
    some = envelope._title(cases[:1] * 3, [lost, found, lost])  # formerly 3 load cases at rest
    assert some == "lift, 1 load case at rest, 2 load cases without a result"
    subjects = Subject("towers.t1", "t1"), Subject("towers.t2", "t2")
    extremes = [
        (f"both+cold+{statistic}", figure("support_load", one, statistic, value, 0.0))
        for one in subjects
        for statistic, value in (("lowest", 9.9e3), ("highest", 149e3))
    ]
    shown = []
    monkeypatch.setattr(plot, "save", lambda figure, *_: shown.append(figure))
    assert plot.write_envelope_plot(envelope._title(cases, [found] * 2), extremes, tmp_path / "e.png")
    (axes,) = shown[0].axes  # no panel of sags without one
    shown[0].tight_layout()
    shown[0].draw_without_rendering()
    assert axes.get_xlim()[0] == 0.0
    assert all(text.get_window_extent().x1 <= axes.bbox.x1 for text in axes.texts)
    plots.close()


@pytest.mark.parametrize(
    ("file", "name", "count"),
    [
        ("load_cases", "chairlift", 25),
        ("load_cases", "gondola", 25),
        ("loadings", "chairlift", 61),
        ("bicable_cases", "bicable", 19),
        ("stop_cases", "aerial_tramway", 4),
    ],
)
def test_files_of_examples_fit_the_scenarios_that_the_page_names(file, name, count):
    path = config_directory().parent / "examples" / f"{file}.yaml"
    assert len(read_cases(path, name, {})) == count


def test_of_equal_verdicts_that_with_the_worst_value_is_shown():
    def verdict(state, value, limits=(0.8,), comparison="at most"):
        one = figure("adhesion_used", Subject("sheaves.drive", "drive"), "highest", value, 0.0)
        texts = dict.fromkeys(("profile", "check", "document", "edition", "clause", "text"), "")
        return RuleVerdict(**texts, state=state, figure=one, comparison=comparison, limits=limits)

    for states, values, worst in (
        (("kept", "kept", "kept"), (0.1, 0.55, 0.3), 0.55),
        (("not kept", "not kept", "kept"), (0.9, 1.1, 0.3), 1.1),
        (("not decided", "kept", "kept"), (0.79, 0.55, 0.3), 0.79),
    ):
        cases = [[verdict(*one)] for one in zip(states, values, strict=True)]
        assert envelope.worst_verdicts(cases)[0].value == worst
    unknown = [verdict("not decided", 0.9, limits=())]
    assert envelope.worst_verdicts([unknown, [verdict("kept", 0.3)]])[0].state == "kept"
