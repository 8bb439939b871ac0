"""`report`: numbers of the page are those of `review`, the page is whole in itself, and it prints without colours."""

from __future__ import annotations

import csv
import json
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

from cable_twin.frame.plotted_signals import PLOTS, SIGNALS
from cable_twin.key_figures import QUANTITIES, FigureId, Subject, figure
from cable_twin.key_figures.rules import STATES, Profile
from cable_twin.key_figures.rules.document import Document
from cable_twin.offline import envelope, report, reporting, review, simulate, study
from cable_twin.offline.figure_table import shown
from cable_twin.offline.reporting import german
from cable_twin.offline.reporting.chart import BOTTOM, LEFT, LOOKS, Chart, Mark, labelled_ticks, span, ticks
from cable_twin.offline.reporting.from_envelope import read_envelope
from cable_twin.offline.reporting.judging import judge_cases, judge_extremes
from cable_twin.offline.reporting.page import PrintError, find_printer
from cable_twin.offline.reporting.remarks import CHANGED, NONE, Input, inputs_of
from cable_twin.offline.reporting.results import Results, RopeCourse, TowerLoad
from cable_twin.offline.reporting.sections import SECTIONS
from cable_twin.offline.reporting.sections.assumptions import grouped
from cable_twin.offline.reporting.sections.figures import limits_summary
from cable_twin.offline.reporting.sections.profile import line_profile
from cable_twin.offline.reporting.sections.section import with_units_kept
from cable_twin.offline.reporting.sections.tower_loads import tower_loads
from cable_twin.offline.reporting.texts import Texts
from cable_twin.scenario import load_scenario
from cable_twin.scenario.files import config_directory

pytest.importorskip("jinja2")
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
CASES = """\
cases:
  - {id: heavy, name: more counterweight, loading: empty, set: {sheaves.return.counterweight.mass: 36000.0}}
  - {id: full, loading: full}
"""
PROFILES = ["--profile", "france_2009", "--profile", "pennsylvania", "--profile", "new_zealand_1972"]
FACTS = ["--fact", "persons=4", "--fact", "grip=fixed", "--fact", "vehicle=chair"]
DATA = re.compile(r'<data class="(\w+)" data-(?:id|check)="([^"]*)" value="([^"]*)">([^<]*)</data>')
WIDER = "<script>document.title = document.documentElement.scrollWidth - document.documentElement.clientWidth</script>"


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Short run of the chairlift with an emergency stop, with a payload of its own."""
    directory = tmp_path_factory.mktemp("run")
    (directory / "stop.yaml").write_text(
        "- {time: 0, name: haul_rope, speed: 1.0}\n- {time: 2, event: emergency_stop}\n"
    )
    arguments = ["chairlift", "--script", directory / "stop.yaml", "--duration", 4, "--output", directory / "runs"]
    arguments += ["--set", "sheaves.return.counterweight.mass=34000.0", "--record", "bag"]
    assert simulate.main([*map(str, arguments)]) == 0
    (made,) = (directory / "runs").iterdir()
    return made


@pytest.fixture(scope="module")
def page(run):
    file = run.parent / "page.html"
    assert report.main([str(run), "--output", str(file), "--trips", "8000", *PROFILES, *FACTS]) == 0
    return file


def test_every_number_is_that_of_review(run, page, tmp_path):
    table = tmp_path / "review.json"
    assert review.main([str(run), "--no-viewer", "--json", str(table), *PROFILES, *FACTS]) == 0
    (reviewed,) = json.loads(table.read_text())["runs"]
    figures = {one["id"]: one for one in reviewed["key_figures"]}
    rules = {f"{one['profile']}/{one['check']}": one for one in reviewed["rules"]}
    found = DATA.findall(page.read_text(encoding="utf-8"))
    assert {id_ for kind, id_, _, _ in found if kind == "figure"} == set(figures)
    judged = {check for check, one in rules.items() if one["limits"] and one["verdict"] != "does not apply"}
    assert {id_ for kind, id_, _, _ in found if kind == "rule"} == judged
    for kind, id_, value, text in found:
        one = (figures if kind == "figure" else rules)[id_]
        assert float(value) == one["value"], id_
        if kind == "figure":
            scales = [1.0, 1e-3, 1e-6, np.degrees(1.0)]
            assert text in {shown(one["value"], scale) for scale in scales}, id_
        else:
            assert float(text.split()[0]) == pytest.approx(one["value"], rel=5e-4, abs=1e-9), id_


@pytest.fixture(scope="module")
def cases(tmp_path_factory):
    """Envelope of two load cases of the chairlift, and the report of it."""
    directory = tmp_path_factory.mktemp("cases")
    (directory / "cases.yaml").write_text(CASES)
    options = ["chairlift", "--cases", "cases.yaml", "--places", "1", "--json", "all.json"]
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(directory)
        assert envelope.main([*options, "--set", "limits.profile=[pennsylvania]"]) == 0
        assert report.main(["all.json", "--output", "all.html"]) == 0
    return directory


def test_every_number_is_that_of_the_envelope(cases):
    data = json.loads((cases / "all.json").read_text())
    text = (cases / "all.html").read_text(encoding="utf-8")
    figures = {one["id"]: one["value"] for one in data["envelope"]}
    found = [one for one in DATA.findall(text) if one[0] == "figure"]
    assert {id_ for _, id_, _, _ in found} == set(figures)
    assert all(float(value) == figures[id_] for _, id_, value, _ in found)
    (rule,) = [value for kind, id_, value, _ in DATA.findall(text) if id_ == "pennsylvania/USPA-01"]
    (judged,) = [one["value"] for one in data["rules"] if one["check"] == "USPA-01"]
    assert float(rule) == pytest.approx(judged, rel=1e-12)


def test_extremes_of_load_cases_are_judged_by_other_profiles_too(cases, capsys):
    """As the envelope judges its cases; a case of a rule cannot be told from the others."""
    data = json.loads((cases / "all.json").read_text())
    (judged,) = [one for one in data["rules"] if one["check"] == "USPA-01"]
    given = ["--profile", "pennsylvania", "--profile", "italy_1999"]
    assert report.main([str(cases / "all.json"), "--output", str(cases / "other.html"), *given]) == 0
    text = (cases / "other.html").read_text(encoding="utf-8")
    (rule,) = [value for kind, id_, value, _ in DATA.findall(text) if id_ == "pennsylvania/USPA-01"]
    assert float(rule) == pytest.approx(judged["value"], rel=1e-12)
    assert f"case {judged['place'].removeprefix('case ').partition(',')[0]}" in text[text.index('id="rules"') :]
    assert "Only italy_1999 has a rule on: " in text
    data["cases"][0]["changes"]["limits.load_cases"] = ["italy_1999.without_pressure"]
    (cases / "rule.json").write_text(json.dumps(data))
    capsys.readouterr()
    assert report.main([str(cases / "rule.json"), *given]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "rule.json: case heavy: given a load case of a rule, whose figures are among the extremes; allowed: " in line


def test_ratios_of_extremes_of_different_cases_are_not_broken():
    scenario = load_scenario("chairlift")
    tower = Subject("towers.tower_1_up", "tower_1_up")
    figures = [figure("support_load", tower, which, value, 0.0) for which, value in (("lowest", 1.0), ("highest", 9.0))]
    check = {"clause": "1", "text": "loads", "quantity": "load_ratio/towers/lowest", "comparison": "at least"}
    head = {"document": "own", "jurisdiction": "test", "edition": "1", "systems": ["monocable"], "carries": "both"}
    profile = Profile("own", Document.model_validate(head | {"checks": {"A": check | {"limit": 0.5, "unit": "-"}}}))
    (found,) = judge_extremes(scenario, figures, {one.id: "c" for one in figures}, [], [profile])
    assert (found.state, found.value) == ("not decided", pytest.approx(1.0 / 9.0))
    (found,) = judge_cases(scenario, [("c", {}, figures), ("d", {}, [])], [profile], at_rest=True)
    assert (found.state, found.figure.place) == ("not kept", "case c")


def test_states_that_govern_are_found_again(cases):
    """Force on each tower, calculated anew, has the size of the figure of the envelope."""
    found = read_envelope(cases / "all.json", lambda count: lambda: None)
    assert not found.notes
    loads = {one.id.subject: one.value for one in found.figures if one.id[::2] == ("support_load", "highest")}
    assert len(found.towers) == 12
    for one in found.towers:
        assert np.linalg.norm(one.force) == pytest.approx(loads[one.subject], rel=1e-9)
    tension = {one.id: one.value for one in found.figures}
    for rope in found.ropes:
        highest = tension[FigureId("rope_tension", f"ropes.{rope.name}", "highest")]
        assert rope.tension.max() == pytest.approx(highest, rel=1e-9)
    text = (cases / "all.html").read_text(encoding="utf-8")
    assert "sheaves.return.counterweight.mass: 36000 kg" in text
    assert "envelope chairlift --cases cases.yaml" in text


@pytest.mark.parametrize(
    ("scenario", "text"),
    [
        ("aerial_tramway", "{id: full, loading: full, worst_place: {points: 5, figures: [FIGURE]}}"),
        ("chairlift", "{id: empty, loading: empty, tensioning: stops}, {id: up, loading: up_full, tensioning: stops}"),
    ],
)
def test_what_a_search_or_a_stop_has_found_is_found_again(tmp_path, scenario, text):
    """A vehicle at its worst place, tensioning at its limits, and a rest found from another one: to the last bit."""
    rope = next(iter(load_scenario(scenario).cables))
    figure = f"rope_tension/ropes.{rope}/highest"
    (tmp_path / "cases.yaml").write_text(f"cases: [{text.replace('FIGURE', figure)}]")
    options = ["--cases", tmp_path / "cases.yaml", "--places", 1, "--json", tmp_path / "all.json"]
    options += ["--set", "sheaves.return.counterweight.travel=[-0.1,0.1]"] if scenario == "chairlift" else []
    assert envelope.main([*map(str, (scenario, *options))]) == 0
    found = read_envelope(tmp_path / "all.json", lambda count: lambda: None)
    assert not found.notes
    loads = {one.id.subject: one.value for one in found.figures if one.id[::2] == ("support_load", "highest")}
    assert found.towers
    for one in found.towers:
        assert np.linalg.norm(one.force) == loads[one.subject]


def test_a_study_has_its_ranges_and_indices(tmp_path):
    pytest.importorskip("distributed")
    options = "seed_example --vary gravity=9:10 --vary cable.mass_per_length=1:3 --method sobol --cases 8 --duration 0"
    out = tmp_path / "study"
    assert study.main([*options.split(), "--workers", "1", "--out", str(out)]) == 0
    page = tmp_path / "study.html"
    judged = ["--profile", "pennsylvania"]
    assert report.main([str(out), "--language", "de", "--output", str(page), *judged]) == 0
    text = page.read_text(encoding="utf-8")
    with (out / "results.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    figures = [(id_, float(value)) for kind, id_, value, _ in DATA.findall(text) if kind == "figure"]
    ends = {id_ for id_, _ in figures}
    assert len(ends) > 10
    assert "Kennwerte</h2>" not in text  # a second time, without what a study does not have
    for id_, value in figures:
        assert value == (min if id_.endswith("/lowest") else max)(float(row[id_]) for row in rows), id_
    with (out / "indices.csv").open(newline="") as file:
        indices = [float(row[key]) for row in csv.DictReader(file) for key in ("first", "total")]
    assert [float(one) for one in re.findall(r'<data class="index" value="([^"]*)">', text)] == indices
    assert "pennsylvania: USA, Pennsylvania: 34 Pa. Code chapter 7" in text
    broken = sum(row["limits_not_kept"] != "0" for row in rows)
    assert f"hier nicht beurteilt: {broken} von 8 Fällen halten einen Grenzwert nicht ein" in text
    (out / "manifest.json").write_text("{}")
    assert report.main([str(out)]) == 2


def test_what_a_case_in_motion_governs_is_drawn_beside_the_extremes_at_rest(tmp_path):
    """Tensions along the ropes and forces on towers are those of all cases; shapes are of all extremes at rest."""
    (tmp_path / "run.yaml").write_text("- {time: 0, name: haul_rope, speed: 1.0}\n")
    run = "{id: run, loading: up_full, dynamic: {script: run.yaml, duration: 1}}"
    both = "{id: heavy, set: {sheaves.return.counterweight.mass: 36000}}, {id: empty, loading: empty}"
    (tmp_path / "cases.yaml").write_text(f"cases: [{both}, {run}]")
    options = ["--cases", tmp_path / "cases.yaml", "--places", 1, "--json", tmp_path / "all.json"]
    assert envelope.main([*map(str, ("chairlift", *options))]) == 0
    data = json.loads((tmp_path / "all.json").read_text())
    governed = {one["id"]: one["case"] for one in data["envelope"]}
    assert "run" in [case for key, case in governed.items() if re.fullmatch("support_load/towers.*/highest", key)]
    found = read_envelope(tmp_path / "all.json", lambda count: lambda: None)
    values = {str(one.id): one.value for one in found.figures}
    for one in found.towers:
        assert np.linalg.norm(one.force) == pytest.approx(values[f"support_load/{one.subject}/highest"], rel=1e-9)
    at_rest = {one["id"]: one["value"] for one in data["at_rest"]}
    for rope in found.ropes:
        ends = [values[f"rope_tension/ropes.{rope.name}/{one}"] for one in ("lowest", "highest")]
        assert [rope.tension.min(), rope.tension.max()] == pytest.approx(ends, rel=1e-9)
        assert rope.clearance[np.isfinite(rope.clearance)].min() == pytest.approx(
            at_rest[f"rope_clearance/ropes.{rope.name}/lowest"], abs=0.05
        )
    assert report.main([str(tmp_path / "all.json"), "--output", str(tmp_path / "page.html")]) == 0
    text = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert "Lines and dashes are of cases at rest" in text
    assert "those in motion included" in text


def test_an_envelope_of_an_earlier_version_has_no_forces_in_motion(cases, tmp_path):
    """Line at rest and figures are there; loads of towers without arrows."""
    data = json.loads((cases / "all.json").read_text())
    del data["at_rest"], data["ranges"]
    for one in data["cases"]:
        one["dynamic"] = True
    (tmp_path / "moving.json").write_text(json.dumps(data))
    found = read_envelope(tmp_path / "moving.json", lambda count: lambda: None)
    assert (found.kind, len(found.ropes), len(found.towers)) == ("load cases at rest and in motion", 2, 12)
    assert np.isnan([one.force for one in found.towers]).all()
    assert dict(found.sources)["drawn"].endswith("tensions along ropes of these alone, as in files of earlier versions")
    assert report.main([str(tmp_path / "moving.json"), "--output", str(tmp_path / "page.html")]) == 0
    text = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert "nan" not in text.partition("<svg")[2]
    assert " Line profile</h2>" in text


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda data: [], "no envelope: given a list or a number; allowed: a file that `envelope --json` has written"),
        (lambda data: {**data, "envelope": [{}]}, "no envelope: 'id' is missing; allowed: a file that"),
        (lambda data: {**data, "resolved": {**data["resolved"], "gravity": -1}}, "gravity: given -1 m/s^2"),
    ],
)
def test_faults_of_an_envelope_are_a_line(cases, tmp_path, refusal, change, told):
    file = tmp_path / "changed.json"
    file.write_text(json.dumps(change(json.loads((cases / "all.json").read_text()))))
    line = refusal(report.main, file)
    assert line.startswith(f"report: {file}: ")
    assert told in line


def test_the_head_tells_why_nothing_is_judged():
    """Formerly `no limit is given`, without the missing breaking force."""
    scenario = load_scenario("seed_example")
    told = limits_summary(Results("", scenario, [], inputs_of(scenario, None)), Texts("en"))
    missing = "not judged: limits.rope_safety_factor: cable.breaking_force is not given"
    assert told == ("no key figure has a limit", [missing])


def test_the_page_shows_where_profiles_differ(page):
    text = page.read_text(encoding="utf-8")
    section = text[text.index('id="rules"') : text.index('id="load_cases"')]
    assert "Only france_2009 has a rule on: speed (FR09-07, FR09-12" in section
    assert "Only pennsylvania has a rule on: rope safety factor (USPA-01)" in section
    table = section[section.index('class="differences"') : section.index("</table>")]
    assert "mean deceleration of the stop<br>" in table
    assert "at most 2.5 m/s²: <strong>not decided</strong> (FR09-25, annex 3, note 4)" in table
    assert "stopping distance: at most 0.914 m: <strong>not decided</strong> (NZ72-01, 5.4)" in table
    assert "that is at least 3.419 m/s², a stop from the rated speed within this distance" in table
    assert "no rule</td>" in table  # pennsylvania
    (clash,) = re.findall(r'<p class="clash">(.*)</p>', section)
    assert "france_2009 FR09-25 (annex 3, note 4) at most 2.5 m/s² (stop with both brakes together)" in clash
    assert "new_zealand_1972 NZ72-01 (5.4) at least 3.419 m/s²" in clash
    assert "§ 7.429(a)(2)" in section


def test_the_page_is_whole_in_itself_and_says_its_origin(page):
    text = page.read_text(encoding="utf-8")
    assert not re.findall(r'\bsrc=|<link|<script|url\(|@import|href="(?!#)', text)
    assert text.count("<svg") > 10
    assert "<pre>report " in text
    assert "--profile france_2009" in text
    assert "set for this run" in text
    assert re.findall(r'<data class="bends" value="(\d+)">', text) == ["2", "96"]
    for title in ("Rope life", "Line profile", "Rope tension", "Tower loads", "Load cases", "Over time", "Assumptions"):
        assert f" {title}</h2>" in text
    ids = re.findall(r' id="(\w+)"', text)
    assert len(ids) == len(set(ids))


def test_german_says_all_with_the_same_numbers(run, page, tmp_path):
    file = tmp_path / "de.html"
    assert report.main([str(run), "--output", str(file), "--language", "de", *PROFILES, *FACTS]) == 0
    text, english = file.read_text(encoding="utf-8"), page.read_text(encoding="utf-8")
    assert DATA.findall(text) == DATA.findall(english)
    assert " Längenschnitt</h2>" in text
    assert "up: Durchhang unter der Sehne, Anfang bis tower_1_up" in text
    assert set(german.QUANTITIES) == set(QUANTITIES)
    folder = Path(reporting.__file__).parent
    sources = [one.read_text(encoding="utf-8") for one in folder.rglob("*.*") if one.suffix in (".py", ".html")]
    used = {said for one in sources for said in re.findall(r'\bt(?:exts)?\("([^"]+)"', one)}
    used |= {one.title for one in SECTIONS} | set(PLOTS.values()) | set(STATES)
    used |= {one.label for one in SIGNALS.values() if one.plot}
    assert len(used) > 100
    assert not used - set(german.TEXTS)


def test_a_pdf_has_pages(page, tmp_path):
    """By WeasyPrint or by Chromium, whichever is there."""
    try:
        printer = find_printer()
    except PrintError as error:
        pytest.skip(str(error))
    begin = page.read_text(encoding="utf-8").partition('<section id="key_figures"')[0]
    printer(f"{begin}</body></html>", tmp_path / "page.pdf")
    content = (tmp_path / "page.pdf").read_bytes()
    assert content.startswith(b"%PDF")
    assert len(content) > 20_000


def test_without_a_printer_the_extra_is_named(run, monkeypatch, refusal):
    monkeypatch.setitem(sys.modules, "weasyprint", None)
    monkeypatch.setattr("shutil.which", lambda name: None)
    line = refusal(report.main, run, "--pdf", "page.pdf")
    assert "--pdf: WeasyPrint is not installed, and there is no Chromium" in line


def test_german_places_have_the_direction_of_the_wind_and_no_english_at():
    german = Texts("de")
    assert german.phrase("cabin_2, x 5.3 m, wind 12.0 m/s to 90 deg") == "cabin_2, x 5.3 m, Wind 12.0 m/s nach 90 deg"
    assert german.phrase("at 45.32 s") == "bei 45.32 s"
    assert german.quantity("vehicle_separation") == "Abstand zwischen Fahrzeugen, kleinster"
    assert not german.missing


def test_a_unit_is_not_alone_on_a_line():
    assert with_units_kept("arc length 1042.2 m, x -5.3 m, 20 %").split(" ") == [
        *("arc", "length", "1042.2\u00a0m,", "x\u00a0-5.3\u00a0m,", "20\u00a0%")
    ]


def test_tables_have_columns_of_limits_where_there_are_limits(page):
    text = page.read_text(encoding="utf-8")
    sags, clearances = (
        text.partition(f"<h3>{name}</h3>")[2].partition("</thead>")[0] for name in ("Sags", "Clearances")
    )
    assert 'class="limit"' not in sags
    assert 'class="limit"' in clearances


def test_inputs_have_the_remarks_of_their_file():
    inputs = inputs_of(load_scenario("chairlift", {"air.density": 1.2, "ropes.up.ice": 2.0}), None)
    rows = {one.key: one for one in inputs.rows}
    assert rows["ropes.up.mass_per_length"][1:] == ("6.1", "kg/m", "kg/m, assumed (6 to 11 are common)", True)
    assert rows["ropes.down.mass_per_length"].assumed  # by its merge key
    assert rows["towers.tower_3.contacts"].assumed  # by the head of the block
    assert rows["gravity"].remark == NONE  # its remark is the unit alone
    assert rows["air.density"][1:] == ("1.2", "kg/m^3", CHANGED, False)
    assert rows["ropes.up.ice"].value == "2"
    assert not rows["carriers.count"].assumed
    assert {"limits.acceleration", "limits.roller_load"} <= {one.key for one in inputs.defaults}


def test_a_comment_above_a_block_counts_for_its_keys_without_own_remark():
    rows = {one.key: one for one in inputs_of(load_scenario("aerial_tramway"), None).rows}
    assert rows["cable.start.mass"].remark.startswith("The counterweight of the lower station pulls")
    for key in ("axial_stiffness", "mass_per_length", "drive_inertia"):
        assert rows[f"carriages.cabin.drive.haul_rope.{key}"].remark.startswith("A haul rope of 40 mm with 630")
    assert rows["carriages.cabin.drive.haul_rope.damping_ratio"].remark == "-, assumed"
    assert rows["gravity"].remark.startswith("m/s^2, standard gravity")


def test_an_envelope_has_the_remarks_of_its_own_file_and_a_run_says_where_they_are(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text = (config_directory() / "seed_example.yaml").read_text(encoding="utf-8")
    Path("own.yaml").write_text(text.replace("# m/s^2, assumed", "# m/s^2, measured on site"), encoding="utf-8")
    Path("cases.yaml").write_text(
        "cases: [{id: a, set: {cable.end.position.z: 0.1, carriages.carriage.payload: null}}]"
    )
    assert envelope.main(["own.yaml", "--cases", "cases.yaml", "--places", "1", "--json", "own.json"]) == 0
    assert simulate.main(["own.yaml", "--duration", "0.1", "--output", "runs", "--record", "bag"]) == 0
    Path("own.yaml").unlink()
    capsys.readouterr()
    assert report.main(["own.json"]) == 0
    assert not capsys.readouterr().err
    page = Path("own_report.html").read_text(encoding="utf-8")
    assert "measured on site" in page
    assert "cable.end.position.z: 0.1 m; carriages.carriage.payload: none" in page
    assert report.main([str(next(Path("runs").iterdir()))]) == 0
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("report: note: inputs count as assumed, as remarks on them are not in the log: --scenario")


def test_remarks_of_lists_stand_above_their_items(tmp_path):
    file = tmp_path / "level.yaml"
    text = (config_directory() / "single_span.yaml").read_text(encoding="utf-8")
    file.write_text(f"{text}\nterrain:  # survey of 2026\n- [0.0, -9.0]\n- [1000.0, 200.0]  # map\n", encoding="utf-8")
    rows = {one.key: one for one in inputs_of(load_scenario(file), file).rows}
    assert (rows["terrain.0"].remark, rows["terrain.1"].remark) == ("survey of 2026", "map")
    assert not rows["terrain.0"].assumed


def test_lines_differ_without_colours_and_gaps_stay():
    assert len({one.dashes for one in LOOKS}) == len(LOOKS)
    chart = Chart("a <b>", (0.0, 10.0), (0.0, 1.0), ("x", "y"))
    chart.line(np.arange(5.0), np.array([0.0, 1.0, np.nan, 1.0, 0.0]), LOOKS[1], "l")
    svg = chart.svg()
    assert svg.count("<polyline") == 2
    assert 'stroke-dasharray="7 3"' in svg
    assert "a &lt;b&gt;" in svg
    assert ticks(-0.3, 1.1) == pytest.approx([-0.25, 0.0, 0.25, 0.5, 0.75, 1.0])
    assert list(labelled_ticks(1511.2, 1513.9).values()) == ["1511.5", "1512", "1512.5", "1513", "1513.5"]
    assert span([np.array([1.0, 1.0])])[0] < 1.0


def _texts(svg):
    """Text and place (x, y) of each text of a chart, without halos; x is that of the anchor."""
    found = re.findall(r'<text x="([-\d.]+)" y="([-\d.]+)" text-anchor="(\w+)"[^>]* fill="#[^>]*>([^<]*)</text>', svg)
    return {text: (float(x), float(y), anchor) for x, y, anchor, text in found}


def _ropes(scenario, slope=0.3):
    """Courses of all ropes of a scenario, straight from (0, 0) on."""
    x = np.linspace(0.0, 1200.0, 50)
    for name in scenario.cables:
        shape = np.column_stack([x, 0.0 * x, slope * x])
        yield RopeCourse(name, x, shape, x, shape[:, 2], 20.0 + 0.0 * x, np.array([1e5 + x, 1.2e5 + x]))


@pytest.mark.parametrize(
    ("name", "towers"),
    [
        ("jig_back", ["tower_1, tower_2,", "rollers_1, rollers_2"]),
        ("bicable", ["tower_1, rollers_1", "tower_2, rollers_2"]),
    ],
)
def test_a_profile_names_all_ropes_and_towers(name, towers):
    """Formerly three ropes alone had their sags, `rollers_1` stood for all towers and lay on the ropes."""
    scenario = load_scenario(name)
    sags = [
        replace(figure("sag", Subject(f"ropes.{rope}.0", rope), "highest", 7.0 + number, 0.0), place="x 300.0 m")
        for number, rope in enumerate(scenario.cables)
    ]
    found = Results("", scenario, sags, inputs_of(scenario, None), ropes=list(_ropes(scenario)))
    drawn = line_profile(found, Texts("en"))
    texts = _texts(drawn["profile"])
    numbers = [texts[f"{7 + number}"] for number in range(len(sags))]
    for rope, (_, row, _) in zip(scenario.cables, numbers, strict=True):  # its name beside its number
        ((x, y),) = re.findall(rf'<text x="([\d.]+)" y="([\d.]+)" text-anchor="end"[^>]*>{rope}<', drawn["profile"])
        assert float(x) > 6.0 * len(rope)
        assert float(y) == row
    ticks_at = [y for text, (_, y, anchor) in texts.items() if anchor == "end" and re.fullmatch(r"-?\d+", text)]
    assert max(ticks_at) < numbers[0][1] - 8.0
    last = re.findall(r'<polyline points="([^"]*)"', drawn["profile"])[-1]
    rope_px = np.array([point.split(",") for point in last.split()], dtype=float)
    for line in towers:
        x, y, anchor = texts[line]
        width = 6.4 * len(line)
        left = x - width * {"start": 0.0, "middle": 0.5, "end": 1.0}[anchor]
        assert (np.interp(np.linspace(left, left + width, 20), *rope_px.T) > y).all()  # the rope is below the name
    assert all(f"{rope}: rope, least" in drawn["clearance"] for rope in scenario.cables)


def test_inputs_have_points_without_numbers_and_a_common_remark_once():
    rows = [Input(f"terrain.{number}", f"[{number}, 0]", "m", "surveyed", False) for number in range(3)]
    rows += [Input(f"connectors.up_{one}.{key}", "0.6", "m", "slack carriers", True) for one in (1, 2) for key in "ab"]
    rows += [Input(f"gravity{one}", "9.81", "m/s^2", NONE, True) for one in (1, 2)]
    found = grouped(rows, Texts("en"))
    assert found[0] == ("terrain", [("", "[0, 0], [1, 0], [2, 0] m")], "surveyed")
    assert found[1:3] == [
        ("connectors.up_1", [("a", "0.6 m"), ("b", "0.6 m")], "slack carriers"),
        ("connectors.up_2", [("a", "0.6 m"), ("b", "0.6 m")], "as above"),
    ]
    assert [one.remark for one in grouped(rows[-2:], Texts("de"))] == ["keine Quelle angegeben"]


@pytest.mark.parametrize("name", ["bicable", "gondola", "jig_back", "aerial_tramway"])
def test_tower_loads_stand_below_each_other_and_no_text_on_another_or_the_axis(name):
    scenario = load_scenario(name)
    towers = [
        TowerLoad(
            f"towers.{tower}",
            tower,
            np.array(place),
            np.array([-2e3, -6.1e-9, 4e4 if number == 1 else -1e5]),
            np.array([-1e3, 0.0, -3e4]),
        )
        for number, (tower, place) in enumerate(scenario.tower_places.items())
    ]
    figures = [figure("support_load", Subject(one.subject), "highest", 1e5, 0.0) for one in towers]
    found = Results("", scenario, figures, inputs_of(scenario, None), ropes=list(_ropes(scenario)), towers=towers)
    dots = set()
    for svg in tower_loads(found, Texts("en"))["charts"]:
        texts = re.findall(
            r'<text x="([-\d.]+)" y="([-\d.]+)" text-anchor="middle"[^>]* fill="#1b2730">([^<]*)</text>', svg
        )
        (height,) = re.findall(r'viewBox="0 0 760 ([\d.]+)"', svg)
        boxes = [(float(x) - 3.2 * len(text), float(y), 6.4 * len(text)) for x, y, text in texts if "[m]" not in text]
        for left, y, width in boxes:
            assert left > LEFT
            assert left + width <= 760.0
            assert 8.0 < y < float(height) - BOTTOM
        for one, (left, y, width) in enumerate(boxes):
            for other_left, other_y, other_width in boxes[:one]:
                assert abs(y - other_y) >= 12.0 or left >= other_left + other_width or other_left >= left + width
        dots |= {float(x) for x in re.findall(r'<circle cx="([\d.]+)"', svg)}
    assert len(dots) == len({one.place[0] for one in towers})
    highest, lowest = tower_loads(found, Texts("en"))["rows"][:2]
    assert highest.left == 0.0  # formerly -6.1e-09 N
    assert (lowest.load, lowest.along, lowest.down) == ("lowest", -1e3, 3e4)


@pytest.mark.parametrize(("value", "below"), [(1.0, False), (9.0, True), (9.5, True)])
def test_a_number_is_not_struck_through_by_a_limit(value, below):
    chart = Chart("", (0.0, 10.0), (0.0, 10.0), ("x", "y"))
    chart.level(9.8, "limit")
    chart.dot(5.0, value)
    chart.mark(Mark(5.0, value, "number", up=7.0))
    svg = chart.svg()
    (dot,) = re.findall(r'cy="([\d.]+)"', svg)
    assert (_texts(svg)["number"][1] > float(dot)) is below


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["nowhere"], "nowhere: no such file or directory"),
        (["{run}", "--output", "page.txt"], "given 'page.txt'; allowed: a name that ends in .html"),
        (["{run}", "--profile", "nothing"], "--profile: given 'nothing': no such profile"),
        (["{run}", "--scenario", "no.yaml"], "no.yaml: no such file"),
        (["{run}", "--trips", "0"], "given '0'; allowed: more than 0, at most 1e+07"),
        (["{empty}"], "not a log: given 0 .mcap files"),
    ],
)
def test_faults_are_a_line(run, tmp_path, refusal, arguments, told):
    (tmp_path / "empty").mkdir()
    assert told in refusal(report.main, *(one.format(run=run, empty=tmp_path / "empty") for one in arguments))


def test_a_missing_library_is_named_with_its_extra(run, monkeypatch, refusal):
    monkeypatch.setattr(report, "find_spec", lambda name: None)
    assert "pip install 'cable_twin[report]'" in refusal(report.main, run)


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium: apt-get install chromium")
def test_a_browser_draws_it_without_network(page, tmp_path):
    def chromium(*arguments):
        offline = "--headless", "--no-sandbox", "--disable-gpu", "--host-resolver-rules=MAP * ~NOTFOUND"
        profile = f"--user-data-dir={tmp_path / 'profile'}"
        command = [CHROMIUM, *offline, profile, "--hide-scrollbars", "--window-size=960,1200", *arguments]
        return subprocess.run(command, check=True, capture_output=True, text=True, timeout=60).stdout

    probe = tmp_path / "probe.html"
    probe.write_text(page.read_text(encoding="utf-8") + WIDER, encoding="utf-8")
    assert "<title>0</title>" in chromium("--dump-dom", f"file://{probe}")  # nothing is wider than the window
    picture = tmp_path / "page.png"
    chromium(f"--screenshot={picture}", f"file://{page}")
    grey = imread(picture)[..., :3].mean(axis=2)
    assert grey.shape == (1200, 960)
    assert 0.01 < (grey < 0.5).mean() < 0.2  # ink
    assert np.ptp(grey[350:700, 120:800].mean(axis=0)) > 0.05  # the profile
