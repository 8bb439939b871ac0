"""`simulate --sweep`: windows with all limits kept, against closed forms."""

from __future__ import annotations

import csv
import json
from math import atan2, sqrt, tan

import numpy as np
import pytest
from named_figures import named
from ruamel.yaml import YAML

from cable_twin.frame.records import Command
from cable_twin.key_figures import KeyFigures
from cable_twin.offline.runs_side_by_side import Job, run_side_by_side
from cable_twin.offline.script import Place, ScriptedCommand
from cable_twin.offline.scripted_run import simulate
from cable_twin.offline.simulate import main
from cable_twin.offline.simulate_options import sweep_of
from cable_twin.offline.sweep_limits import SweptRun, limited_figures, unsure_gaps, windows_of
from cable_twin.offline.sweep_report import window_lines
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation
from verification import JIT

LIMIT = 0.2  # rad
FORCE_PER_SPEED = 0.5 * 1.225 * 5.0  # N s²/m²
CABIN = {"mass": 200.0, "inertia": 100.0, "upper_pivot": [0.0, 2.0], "drag_area": 5.0}
AT = sqrt(200.0 * 9.81 * tan(LIMIT) / FORCE_PER_SPEED)  # m/s of wind at which the limit is
HANGING = {
    "cable": {
        "unstrained_length": 99.9,
        "mass_per_length": 2.0,
        "axial_stiffness": 1e9,
        "bending_stiffness": 1.0,
        "elements": 6,
        "start": {"position": [0.0, 0.0]},
        "end": {"position": [100.0, 0.0]},
    },
    "carriages": {"car": {"arc_length": 49.95, "joint": "fixed", "bodies": {"cabin": CABIN}}},
    "limits": {"swing": LIMIT},
    "solver": {"step": 0.01},
}


@pytest.fixture
def scenario(tmp_path):
    path = tmp_path / "hanging.yaml"
    with path.open("w") as file:
        YAML(typ="safe").dump(HANGING, file)
    return str(path)


@pytest.mark.skipif(not JIT, reason="minutes without compilation")
def test_the_operating_limit_is_where_the_closed_form_has_it(scenario, tmp_path, capsys):
    files = [str(tmp_path / name) for name in ("sweep.csv", "sweep.json", "sweep.png")]
    arguments = (scenario, "--sweep", "wind.x=0:20:5", "--duration", "0.1")
    assert main([*arguments, "--csv", files[0], "--json", files[1], "--plot", files[2]]) == 0
    output = capsys.readouterr().out
    swing = {wind: atan2(FORCE_PER_SPEED * wind**2, 200.0 * 9.81) for wind in (0.0, 5.0, 10.0, 15.0, 20.0)}
    (line,) = output.splitlines()[-1:]
    assert line.startswith(f"hanging: operating limit of air.wind.x: {AT:.3g}")  # 10.1 on a straight line
    assert line.endswith(" m/s: car: swing along the track, at most 11.46 deg")
    assert f"{np.rad2deg(swing[15.0]):.4g} *" in output  # limit not kept
    found = json.loads((tmp_path / "sweep.json").read_text())
    assert found["sweep"] == {
        "scenario": "hanging",
        "key": "air.wind.x",
        "unit": "m/s",
        "values": [0.0, 5.0, 10.0, 15.0, 20.0],
    }
    assert found["operating_limit"]["key_figure"] == "car: swing along the track"
    assert found["operating_limit"]["value"] == pytest.approx(AT, rel=1e-3)
    with (tmp_path / "sweep.csv").open() as file:
        rows = [row for row in csv.DictReader(file) if row["key_figure"] == "car: swing along the track"]
    got = {float(row["air.wind.x"]): float(row["value"]) for row in rows}
    assert {wind: got[wind] for wind in swing} == pytest.approx(swing, abs=1e-5)
    assert any(got[wind] == pytest.approx(LIMIT, rel=1e-3) for wind in got)  # a run at the limit itself
    assert (tmp_path / "sweep.png").read_bytes()[:4] == b"\x89PNG"


@pytest.mark.skipif(not JIT, reason="minutes without compilation")
def test_runs_side_by_side_have_the_bits_of_runs_by_themselves():
    """Of three meshes, as stiffness moves the short elements of a graded one, with commands at times and a place."""
    script = [
        ScriptedCommand(0.0, Command("speed", {"cabin": 6.0}), "script", "1"),
        ScriptedCommand(0.2, Command("emergency_stop", {}), "script", "2", Place("cabin", 12.0001)),
        ScriptedCommand(0.403, Command("wind", {"x": 9.0, "z": 1.0}), "script", "3"),
        ScriptedCommand(0.65, Command("speed", {"cabin": 1.0}), "script", "4"),
    ]
    changes = [{"air.temperature": 0.0}, {}, {"cable.axial_stiffness": 4e8}, {"air.wind": [9.0, 0.0]}]
    changes.append({"solver.step": 0.0025})
    scenarios = [load_scenario("aerial_tramway", one) for one in changes]
    jobs = [Job(float(number), one, script, 0.8, 2) for number, one in enumerate(scenarios)]
    shares: list[float] = []
    runs = run_side_by_side(jobs, shares.append)
    for job, run in zip(jobs, runs, strict=True):
        figures = KeyFigures(job.scenario)
        alone = simulate(
            Simulation(job.scenario), script, duration=job.duration, frame_steps=2, epoch_ns=0, figures=figures
        )
        assert (run.value, run.fault, run.refused) == (job.value, alone.fault, alone.refused)
        assert run.figures == figures.figures()
        assert len(run.refused) == 1
        assert "emergency stop is in force" in run.refused[0]
    assert shares == sorted(shares)
    assert shares[-1] == pytest.approx(1.0)


@pytest.mark.skipif(not JIT, reason="minutes without compilation")
def test_wind_from_either_side_has_a_window(scenario, tmp_path, capsys):
    path = tmp_path / "sweep.json"
    arguments = (scenario, "--sweep", "wind.x=-20:20:10", "--duration", "0.1", "--json", str(path))
    assert main(arguments) == 0
    assert "hanging: air.wind.x: all limits are kept from -1" in capsys.readouterr().out
    found = json.loads(path.read_text())
    ends = [found["windows"][0][end]["value"] for end in ("low", "high")]
    assert ends == pytest.approx([-AT, AT], rel=1e-3)
    assert found["operating_limit"] is None  # the first value is out of it
    assert len(found["runs"]) < 16


@pytest.mark.long
def test_a_counterweight_of_a_lift_has_a_window(tmp_path):
    path = tmp_path / "sweep.json"
    arguments = ("chairlift", "--set", "limits.tension_per_transverse_load=28", "--set",
                 "sheaves.return.counterweight.travel=[-20,20]", "--sweep",
                 "sheaves.return.counterweight.mass=24e3:40e3:4e3", "--duration", "1")  # fmt: skip
    assert main([*arguments, "--json", str(path)]) == 0
    (window,) = json.loads(path.read_text())["windows"]
    assert 28000.0 < window["low"]["value"] < 30000.0
    assert 37000.0 < window["high"]["value"] < 38500.0
    names = [window[end]["key_figure"] for end in ("low", "high")]
    assert names == ["chair: tension over transverse load", "up: rope safety factor"]


@pytest.mark.long
def test_the_limit_of_a_lift_in_space_is_found_between_two_runs(tmp_path):
    """Swing at rest goes with the square of side wind; on a straight line from 0 to 7.5 m/s the limit is at 4.03."""
    path = tmp_path / "sweep.json"
    changes = {"space": 3, "limits.lateral_swing": 0.014245}
    arguments = [part for key, value in changes.items() for part in ("--set", f"{key}={value}")]
    assert main(["chairlift", *arguments, "--sweep", "wind.y=0:15:7.5", "--duration", "0.1", "--json", str(path)]) == 0
    found = json.loads(path.read_text())["operating_limit"]
    assert found["key_figure"] == "chair: swing across the track"
    assert found["value"] == pytest.approx(5.5, rel=2e-3)


@pytest.mark.skipif(not JIT, reason="minutes without compilation")
def test_a_run_that_has_no_start_is_told_and_the_others_are_there(scenario, capsys):
    """Cable on one pin, at rest in any direction without gravity."""
    free = ("--set", "cable.end.support=free")
    code = main([scenario, "--sweep", "gravity=9.81:0:-9.81", *free, "--duration", "0.1"])
    output = capsys.readouterr()
    assert code == 1
    assert output.err == (
        "simulate: gravity 0: gravity: given 0 m/s², where a cable on one pin is at rest in any direction; "
        "allowed: more than 0 m/s², or a clamped end\n"
    )
    assert any(line.strip().startswith("9.81 ") for line in output.out.splitlines())


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ("wind.x", "given 'wind.x'; allowed: KEY=START:STOP:STEP"),
        ("wind.x=0:10", "given 'wind.x=0:10'; allowed: KEY=START:STOP:STEP"),
        ("wind.x=0:gale:1", "given 'wind.x=0:gale:1', 'gale' is no finite number"),
        ("wind.x=0:inf:1", "'inf' is no finite number"),
        ("wind.x=0:10:0", "a step of 0; allowed"),
        ("wind.x=0:10:-1", "a step of -1, which leads away from 10"),
        ("wind.x=0:1:1e-6", "1000001 runs; allowed: at most 1000"),
        ("wund.x=0:10:1", "wund: this key does not exist; allowed: name"),
        ("air.wind.q=0:10:1", "air.wind.q: this key does not exist; allowed: x, y, z or a number from 0 to 1"),
        (
            "wind.y=1:10:1",
            "air.wind: given [0.0, 1.0, 0.0] m/s: three numbers in a plane; allowed: x, z in m/s; x, y, z only",
        ),
        ("cable=0:10:1", "cable: given 0; allowed: a mapping"),
        ("cable.elements=6:7:0.5", "cable.elements: given 6.0; allowed: a whole number"),
        ("wind.x=50:150:50", "air.wind: given [150.0, 0.0] m/s: a speed of 150 m/s; allowed: at most 100 m/s"),
    ],
)
def test_a_sweep_that_is_none_is_one_line(scenario, refusal, given, said):
    assert said in refusal(main, scenario, "--sweep", given, "--duration", 0.1)


@pytest.mark.skipif(not JIT, reason="minutes without compilation")
def test_a_file_that_cannot_be_written_is_told_before_anything_runs(scenario, tmp_path, refusal, monkeypatch):
    monkeypatch.setattr("cable_twin.offline.sweep.run_side_by_side", None)
    missing = tmp_path / "nowhere" / "sweep.csv"
    line = refusal(main, scenario, "--sweep", "wind.x=0:1:1", "--csv", missing, code=1)
    assert line == f"simulate: {missing}: No such file or directory"


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--plot", "a.png"), "--plot a.png without --sweep"),
        (("--sweep", "wind.x=0:1:1", "--plot", "a.txt"), "--plot: given a.txt; allowed: a name that ends with .png"),
        (
            ("--sweep", "wind.x=0:1:1", "--check"),
            "--sweep cannot be combined with --check: a sweep starts every run from rest",
        ),
    ],
)
def test_options_that_do_not_go_together_are_one_line(refusal, options, said):
    assert said in refusal(main, *options)


def test_values_and_short_keys():
    assert sweep_of("wind.y=0:30:2.5").values == tuple(2.5 * k for k in range(13))
    assert sweep_of("wind.y=0:1:0.1").values[-1] == 1.0
    assert sweep_of("cable.elements=20:60:20").values == (20, 40, 60)
    assert sweep_of("x=3:-3:-3").values == (3, 0, -3)
    assert sweep_of("wind.turbulence.intensity=0:1:1").key == "air.turbulence.intensity"


def swept(values, **limited):
    """Runs at given values, each with figures NAME=(function of the value, limit, bound)."""
    return [
        SweptRun(value, [named(name, read(value), "m", 0.0, limit=limit, bound=bound)
                         for name, (read, limit, bound) in limited.items() if read(value) is not None])
        for value in values
    ]  # fmt: skip


TENSIONED = {
    "ratio": (lambda mass: 0.95 * mass, 28.0, "at least"),  # kept from 29.47 on
    "factor": (lambda mass: 170.5 / mass, 4.5, "at least"),  # kept up to 37.89
}


@pytest.mark.parametrize("values", [(24.0, 28.0, 32.0, 36.0, 40.0), (40.0, 36.0, 32.0, 28.0, 24.0)])
def test_a_sizing_has_a_window(values):
    runs = swept(values, **TENSIONED)
    figures = limited_figures(runs)
    (window,) = windows_of(runs, figures)
    assert (window.low.figure.name, window.high.figure.name) == ("ratio", "factor")
    assert window.low.value == pytest.approx(28.0 / 0.95, rel=1e-3)
    assert window.high.value == pytest.approx(170.5 / 4.5, rel=1e-3)
    (line,) = window_lines("mass", "t", runs, figures, [window])
    assert line.startswith("mass: all limits are kept from 29.47 to 37.8")
    assert line.endswith(" t; below, ratio, at least 28 m; above, factor, at least 4.5 m")


def test_a_window_between_two_runs_is_looked_for():
    runs = swept((24.0, 40.0), **TENSIONED)
    assert not windows_of(runs, limited_figures(runs))
    ((gap, value),) = unsure_gaps(runs, limited_figures(runs), 0.1)
    assert gap == 0
    more = swept((24.0, value, 40.0), **TENSIONED)
    assert windows_of(more, limited_figures(more))
    always = {**TENSIONED, "never kept": (lambda _: 2.0, 1.0, "at most")}
    runs = swept((24.0, 40.0), **always)
    assert not [*unsure_gaps(runs, limited_figures(runs), 0.1)]


def test_limits_that_are_passed_first_come_first_and_say_where_they_are_passed_most():
    limits = {
        "late and far": (lambda wind: 10.0 * (wind > 25.0), 1.0, "at most"),
        "early": (lambda wind: wind**2 / 100.0, 1.0, "at most"),
        "calm": (lambda wind: 1.0 - 0.1 * wind, 0.8, "at most"),
        "kept": (lambda wind: 0.9 + 0.0 * wind, 1.0, "at most"),
    }
    runs = swept((0.0, 5.0, 10.0, 15.0, 20.0, 30.0), **limits)
    found = limited_figures(runs)
    assert [figure.name for figure in found] == ["calm", "early", "late and far", "kept"]
    assert found[1].passed_at == pytest.approx(10.0, abs=0.01)
    assert [value for value, _ in (figure.worst for figure in found)] == [0.0, 30.0, 30.0, 0.0]
    assert [[*figure.passed()] for figure in found[:2]] == [
        [(-np.inf, pytest.approx(2.0, abs=0.1))],
        [(pytest.approx(10.0, abs=0.01), np.inf)],
    ]


def test_a_limit_that_is_swept_itself_is_met_where_the_figure_has_it():
    values = (1.0, 2.0, 3.0)
    runs = [SweptRun(one, [named("sag", 2.4, "m", 0.0, limit=one)]) for one in values]
    (figure,) = limited_figures(runs)
    (window,) = windows_of(runs, [figure])
    assert window.low.value == pytest.approx(2.4)
    assert window.high.figure is None


def test_limits_that_are_passed_from_the_start_and_those_of_runs_that_have_no_figures():
    def run(value, swing, clearance=None):
        figures = [named("swing", swing, "rad", 0.0, limit=1.0)]
        if clearance is not None:
            figures.append(named("clearance", clearance, "m", 0.0, limit=0.0, bound="at least"))
        return SweptRun(value, figures)

    runs = [run(0.0, 0.5, 2.0), run(10.0, 0.8, 1.0), SweptRun(20.0, (), "failed"), run(30.0, 0.9, -1.0)]
    found = {figure.name: figure.passed_at for figure in limited_figures(runs)}
    assert found == {"swing": None, "clearance": 30.0}  # there is no run just before it
    windows = windows_of(runs, limited_figures(runs))
    assert [(window.low.value, window.high.value) for window in windows] == [(0.0, 10.0)]  # the run at 20 has failed
    assert windows[0].high.figure is None
    runs = [run(3.0, 2.0), run(2.0, 1.5), run(1.0, 0.5)]
    (figure,) = limited_figures(runs)
    assert figure.passed_at == 3.0
    (window,) = windows_of(runs, [figure])
    assert window.low.value == 1.0
    assert 1.0 < window.high.value < 2.0
