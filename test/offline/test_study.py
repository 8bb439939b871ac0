"""Studies: designs, indices against closed forms, and workers that are killed, with the bits of one worker."""

from __future__ import annotations

import csv
import importlib
import json
import re
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest

from cable_twin.offline import study
from cable_twin.offline.reporting.from_study import _factor
from cable_twin.offline.studies import case
from cable_twin.offline.studies.design import Factor, design, factor_of
from cable_twin.offline.studies.indices import indices_of
from cable_twin.offline.studies.record import Kept
from verification import JIT

CHEAP = ["seed_example", "--vary", "cable.mass_per_length=1:3", "--vary", "gravity=9:10", "--duration", "0"]


def test_designs_cover_ranges_and_lists():
    mass, mode = Factor("mass", (1.0, 3.0)), Factor("mode", values=("a", "b"))
    grid = design([mass, mode], "grid", 7, 0).rows
    assert grid == [(1.0, "a"), (1.0, "b"), (2.0, "a"), (2.0, "b"), (3.0, "a"), (3.0, "b")]
    assert [one for (one,) in design([Factor("n", (1.0, 3.0), whole=True)], "grid", 9, 0).rows] == [1, 2, 3]
    latin = np.array([row[0] for row in design([mass, mode], "latin", 10, 3).rows])
    assert np.array_equal(np.sort(np.floor((latin - 1.0) * 5.0)), np.arange(10.0))  # one in each tenth
    sobol = design([mass, mode], "sobol", 70, 0)
    assert (sobol.base, len(sobol.rows)) == (16, 64)
    (a, b), (a_b0, a_b1) = (sobol.rows[:16], sobol.rows[16:32]), (sobol.rows[32:48], sobol.rows[48:])
    assert a_b0 == [(two[0], one[1]) for one, two in zip(a, b, strict=True)]
    assert a_b1 == [(one[0], two[1]) for one, two in zip(a, b, strict=True)]
    assert [*sobol.cases()][8] == ("c09", dict(zip(("mass", "mode"), a[8], strict=True)))
    assert factor_of("wind.x=-5:5") == Factor("air.wind.x", (-5.0, 5.0))
    assert factor_of("script=a:1.yaml,b.yaml").values == ("a:1.yaml", "b.yaml")
    assert factor_of("carriages.cabin.joint=fixed,sliding").values == ("fixed", "sliding")


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (["--vary", "gravity=9"], ""),
        (["--vary", "gravity"], "given 'gravity'; allowed: KEY=LOW:HIGH or KEY=VALUE,VALUE,..."),
        (["--vary", "gravity=9:8"], "with LOW below HIGH, both finite"),
        (
            ["--vary", "gravity=9:10", "--vary", "gravity=9,10"],
            "--vary: given gravity twice; allowed: each key once",
        ),
        (["--vary", "gravity=-1:9"], "gravity: given -1.0 m/s^2; allowed: a finite number at least 0"),
        (["--vary", "grvity=1:9"], "grvity"),
        (["--vary", "cable.elements=4:8.5"], "--vary cable.elements: given 4:8.5; allowed: whole numbers"),
        (["--vary", "gravity=8:9", "--method", "sobol", "--cases", "5"], "allowed: at least 6, for sobol of 1 keys"),
        (
            ["--vary", "gravity=8,9,10", "--method", "grid", "--cases", "2"],
            "allowed: at least 3, for both ends and all",
        ),
        (["--vary", "script=nowhere.yaml"], "nowhere.yaml"),
        (["--vary", "gravity=8:9", "--figure", "nothing"], "allowed: quantity/subject/statistic"),
        (["--vary", "gravity=8:9", "--figure", "rope_tensio/ropes.cable/highest"], "did you mean rope_tension?"),
        (
            ["--vary", "gravity=8:9", "--figure", "rope_tension/ropes.cable/mean"],
            "allowed: rope_tension/ropes.cable/highest or rope_tension/ropes.cable/lowest",
        ),
        (["--vary", "gravity=8:9", "--figure", "rope_tension/ropes.cabel/highest"], "did you mean ropes.cable?"),
        (["--vary", "gravity=8:9", "--scheduler", "tcp://127.0.0.1:9"], "there is none (Timed out trying to connect"),
    ],
)
def test_what_cannot_be_used_is_a_line(options, told, tmp_path, refusal, monkeypatch):
    monkeypatch.setattr("cable_twin.offline.studies.cluster.PATIENCE", 0.5)
    monkeypatch.setattr(study, "_compile", lambda _: {"ropes.cable"})
    if not told:
        assert study.parser().parse_args([*options, "--out", "x"]).vary == [Factor("gravity", values=(9,))]
        return
    assert told in refusal(study.main, "seed_example", *options, "--out", tmp_path / "out")


def test_indices_have_the_closed_form_of_ishigami():
    factors = [Factor(key, (-np.pi, np.pi)) for key in "xyz"]
    made = design(factors, "sobol", 5 * 1024, 1)
    x, y, z = np.array(made.rows).T
    values = np.sin(x) + 7.0 * np.sin(y) ** 2 + 0.1 * z**4 * np.sin(x)
    figures = {"f": values, "constant": np.ones_like(x), "partial": np.where(x > 0.0, x, np.nan)}
    found, without = indices_of(made, SimpleNamespace(figures=figures, names=dict.fromkeys(figures, ("", "-"))))
    assert (list(found), without) == (["f"], ["partial"])
    for order, expected in (("first", (0.3139, 0.4424, 0.0)), ("total", (0.5576, 0.4424, 0.2437))):
        for index, value in zip(getattr(found["f"], order).values(), expected, strict=True):
            assert index.value == pytest.approx(value, abs=0.03)
            assert index.low - 0.01 < value < index.high + 0.01


def test_axes_of_keys_have_units_and_a_key_of_one_value_has_none(tmp_path):
    mpl = pytest.importorskip("matplotlib")
    plot = importlib.import_module("cable_twin.offline.studies.plot")
    factors = [Factor("sheaves.return.counterweight.mass", (44e3, 52e3)), Factor("script", values=("only.yaml",))]
    made = design(factors, "latin", 4, 0)
    cases = [case.Case(id_, values, "") for id_, values in made.cases()]
    results = SimpleNamespace(
        figures={"f": np.arange(4.0)},
        names={"f": ("sag", "m")},
        columns=lambda: {one.key: [each.values[one.key] for each in cases] for one in factors},
    )
    with mpl.rc_context({"svg.fonttype": "none"}):
        plot.write_scatter("study", made, results, ["f"], tmp_path / "f.svg")
    texts = re.findall(r">([^<>]+)</(?:text|tspan)>", (tmp_path / "f.svg").read_text())
    assert {"sheaves.return.counterweight.mass", "[kg]", "[m]"} <= {*texts}
    assert "script" not in texts
    numbers = [one for one in texts if re.fullmatch(r"\d{5}", one)]
    assert 2 <= len(numbers) <= plot.TICKS + 1
    assert _factor("air.temperature", {"from": -20.0, "to": 40.0}) == ("air.temperature", "-20 to 40 degC")
    assert _factor("script", ["a.yaml", "b.yaml"]) == ("script", "a.yaml, b.yaml")


@pytest.fixture
def scheduler():
    """Address of a scheduler in a process of its own, and a function that starts a worker."""
    running = []

    def start(*command):
        running.append(subprocess.Popen([sys.executable, "-m", *command], stderr=subprocess.PIPE, text=True))
        return running[-1]

    process = start("distributed.cli.dask_scheduler", "--port", "0", "--host", "127.0.0.1", "--no-dashboard")
    address = next(found[0] for line in process.stderr if (found := re.findall(r"tcp://127\S+", line)))
    worker = "distributed.cli.dask_worker", address, "--nthreads", "1", "--no-nanny", "--no-dashboard"
    yield address, lambda: start(*worker)
    for one in running:
        one.kill()
        one.communicate()


@pytest.mark.skipif(not JIT, reason="minutes without compilation")
@pytest.mark.long
def test_a_worker_that_is_killed_twice_leaves_no_trace(tmp_path, scheduler, monkeypatch, capsys):
    """200 cases on two workers, of which one is killed twice, beside one worker; then nothing is left to do."""
    address, start_worker = scheduler
    workers, add, order = [start_worker(), start_worker()], Kept.add, []

    def add_and_kill(self, finished, names):
        add(self, finished, names)
        order.append(finished.case)
        if len(order) in (20, 90):
            workers[-1].kill()
            workers.append(start_worker())

    monkeypatch.setattr(Kept, "add", add_and_kill)
    options = [*CHEAP, "--cases", "200"]
    assert study.main([*options, "--scheduler", address, "--out", str(tmp_path / "killed")]) == 0
    assert sorted(order) == [f"c{number:03d}" for number in range(1, 201)]  # each once
    monkeypatch.setattr(Kept, "add", add)
    assert study.main([*options, "--workers", "1", "--out", str(tmp_path / "alone")]) == 0
    killed, alone = (tmp_path / name / "results.csv" for name in ("killed", "alone"))
    assert killed.read_bytes() == alone.read_bytes()
    with alone.open(newline="") as file:
        rows = [*csv.DictReader(file)]
    masses = [float(one["cable.mass_per_length"]) for one in rows]
    tensions = [float(one["rope_tension/ropes.cable/highest"]) for one in rows]
    assert np.corrcoef(masses, tensions)[0, 1] > 0.9

    capsys.readouterr()
    with (tmp_path / "alone" / "cases.jsonl").open("r+b") as file:  # as a kill of the command leaves it
        lines = file.read().splitlines(keepends=True)
        file.seek(0)
        file.writelines([*lines[:-3], lines[-2], lines[-1].replace(b'"fault": ""', b'"fault": "x"'), lines[-3][:50]])
        file.truncate()
    assert study.main([*options, "--workers", "1", "--out", str(tmp_path / "alone")]) == 0
    assert "198 of 200 cases are in" in capsys.readouterr().err
    assert killed.read_bytes() == alone.read_bytes()
    monkeypatch.setattr(study, "run_on", None)  # nothing is run any more
    assert study.main([*options, "--out", str(tmp_path / "alone")]) == 0
    manifest = json.loads((tmp_path / "alone" / "manifest.json").read_text())
    assert (manifest["cases"], manifest["finished"], manifest["with_fault"]) == (200, 200, 0)
    assert set(manifest["files"]) >= {"cases.jsonl", "results.csv", "results.parquet", "figures.png"}


def test_inputs_and_program_are_in_the_hash_of_a_case(monkeypatch):
    options = study.parser().parse_args([*CHEAP, "--cases", "3", "--out", "x"])
    first = [one.inputs for one in study.plan(options, "seed_example").cases]
    assert [one.inputs for one in study.plan(options, "seed_example").cases] == first
    options.duration = 1.0
    assert not {*first} & {one.inputs for one in study.plan(options, "seed_example").cases}
    options.duration = 0.0
    monkeypatch.setattr(case, "program", lambda: json.dumps({"sources": "others"}))
    assert not {*first} & {one.inputs for one in study.plan(options, "seed_example").cases}
    with pytest.raises(case.OtherProgramError, match="a worker has sources others; allowed: 1, as here"):
        case.run_case(None, None, json.dumps({"sources": 1}))
