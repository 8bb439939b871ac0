"""Benchmark command: real measurements of equal motions, with notes on their conditions."""

import json
import re
import sys
from dataclasses import replace
from importlib import import_module
from io import StringIO
from math import isfinite
from pathlib import Path

import pytest
from rich.console import Console
from twin_process import environment, run_python, write_quick_scenario

from benchmarks.command import PARTS, main
from benchmarks.live import Result, Second, faults, unexplained
from benchmarks.report import HEAD, Part, Table, print_part

ROOT = Path(__file__).resolve().parents[1]


def run(*arguments):
    return run_python("-m", "benchmarks", *arguments)


def numbers(rows, key):
    """Values of one column, checked to be finite and positive."""
    values = [row[key] for row in rows]
    assert all(isinstance(value, (int, float)) and isfinite(value) and value > 0.0 for value in values)
    return values


@pytest.mark.long
def test_moves_as_exudyn_does(tmp_path):
    pytest.importorskip("exudyn")
    result = run("exudyn", "--quick", "--output", tmp_path)
    assert result.returncode == 0, result.stderr

    part = json.loads((tmp_path / "benchmarks.json").read_text())["exudyn"]
    assert part["faults"] == []
    assert "[ms]" in result.stdout
    summary, *tables = part["tables"]
    assert [row["case"] for row in summary["rows"]] == [
        "seed example, 24 elements",
        "ropeway, 100 elements, 10 carriages",
    ]
    assert len(tables) == 2
    page = (tmp_path / "benchmarks.md").read_text()
    for table in tables:
        assert table["title"] in result.stdout
        assert table["title"] in page
        ours, default, accurate = table["rows"]
        assert [ours["program"], default["program"], accurate["program"]] == [
            "cable_twin",
            "Exudyn, default joint",
            "Exudyn, accurate joint",
        ]
        numbers(table["rows"], "wall per step [µs]")
        numbers(table["rows"], "per element, iteration [µs]")
        assert all(count >= 1.0 for count in numbers(table["rows"], "iterations"))
        for row in table["rows"]:
            assert row["ours faster [times]"] == pytest.approx(row["processor [µs]"] / ours["processor [µs]"])
        # two programs are never equal to the last bit, and these agree: in the step it has moved by more
        assert 0.0 < accurate["distance [mm]"] <= accurate["allowed [mm]"] <= 10.0
        assert default["distance [mm]"] > 0.0
        assert default["allowed [mm]"] is None


@pytest.mark.long
def test_moves_as_exudyn_does_in_space(tmp_path):
    """Rope of 1 km pushed sideways by 0.5 m: bare to 0.2 mm."""
    pytest.importorskip("exudyn")
    result = run("exudyn_space", "--quick", "--output", tmp_path)
    assert result.returncode == 0, result.stderr
    times, distances = json.loads((tmp_path / "benchmarks.json").read_text())["exudyn_space"]["tables"]
    bare, vehicle = distances["rows"]
    assert [row["case"] for row in times["rows"]] == [bare["case"], vehicle["case"]]
    assert [bare["case"], vehicle["case"]] == ["1 km, 100 elements, bare", "1 km, 100 elements, one moving vehicle"]
    assert min(numbers(times["rows"], "faster than Exudyn [times]")) > 3.0  # of one turn on whatever else runs
    assert min(numbers(distances["rows"], "moved sideways [m]")) > 0.3
    assert bare["ropes apart [mm]"] < 0.2
    assert vehicle["ropes apart [mm]"] < 100.0  # of Exudyn's mesh at the vehicle: 18 mm with four times the elements
    assert vehicle["vehicles apart [mm]"] < 100.0


@pytest.mark.long
@pytest.mark.parametrize("name", ["exudyn_comparison", "exudyn_space"])
def test_another_motion_is_a_fault(name, monkeypatch):
    """Refused comparisons: a tenth less gravity in Exudyn, and in space a rope half a metre off."""
    pytest.importorskip("exudyn")
    from rich.progress import Progress  # noqa: PLC0415

    from benchmarks.exudyn_model import ExudynModel  # noqa: PLC0415
    from benchmarks.measure import Effort  # noqa: PLC0415

    def lighter(self, exudyn, simulation, setting):
        scenario = simulation.scenario
        simulation.scenario = scenario.model_copy(update={"gravity": 0.9 * scenario.gravity})
        built(self, exudyn, simulation, setting)

    part, built = import_module(f"benchmarks.{name}"), ExudynModel.__init__
    monkeypatch.setattr(ExudynModel, "__init__", lighter)
    monkeypatch.setattr(part, "NEAR", 1e-4, raising=False)
    with Progress(disable=True) as progress:
        faults = part.run(Effort(quick=True, repetitions=1), progress).faults
    said = (
        ("allowed are", "mm from cable_twin")
        if name == "exudyn_comparison"
        else ("ropes apart [mm] is", "allowed: 100")
    )
    assert faults
    assert all(word in fault for fault in faults if "vehicles" not in fault for word in said)


@pytest.mark.long
def test_iterations_and_cost_of_coupled_ropes(tmp_path):
    result = run("coupled", "--quick", "--output", tmp_path)
    assert result.returncode == 0, result.stderr
    part = json.loads((tmp_path / "benchmarks.json").read_text())["coupled"]
    (row,) = part["tables"][0]["rows"]
    assert row["scenario"] == "chairlift"
    assert 1.0 <= row["iterations a step"] < 2.2, "wheels are in the tangent"
    assert 0.0 < row["left of a step [m]"] < row["tolerance [m]"] * 10.0
    assert row["a step [µs]"] > 0.0


@pytest.mark.long
def test_loads_beside_another_checkout(tmp_path):
    """Beside itself: the same elements, and nearly the same cost."""
    result = run("loads", "--quick", "--beside", ROOT, "--output", tmp_path)
    assert result.returncode == 0, result.stderr
    (table,) = json.loads((tmp_path / "benchmarks.json").read_text())["loads"]["tables"]
    assert [(row["scenario"], row["mesh"]) for row in table["rows"]] == [
        (name, mesh) for name in ("single_span", "chairlift") for mesh in ("shipped", "before")
    ]
    assert numbers(table["rows"], "elements, ratio") == [1.0] * 4
    assert all(0.2 < ratio < 5.0 for ratio in numbers(table["rows"], "cost, ratio"))  # one turn, on a busy machine
    assert numbers(table["rows"], "a step here [µs]")


@pytest.mark.long
def test_what_space_costs(tmp_path):
    result = run("space", "--quick", "--output", tmp_path)
    assert result.returncode == 0, result.stderr
    (table,) = json.loads((tmp_path / "benchmarks.json").read_text())["space"]["tables"]
    (row,) = table["rows"]
    assert 1.0 < row["space, times the plane"] < 4.0  # allowed are 2.5, of more turns
    assert numbers(table["rows"], "space, times real time")


@pytest.mark.long
def test_cost_over_elements_and_carriages(tmp_path):
    result = run("scaling", "--quick", "--output", tmp_path)
    assert result.returncode == 0, result.stderr
    tables = json.loads((tmp_path / "benchmarks.json").read_text())["scaling"]["tables"]
    over_elements, over_carriages, exponents = (table["rows"] for table in tables)
    walls = numbers(over_elements, "wall per step [µs]")
    assert walls[-1] > walls[0]  # 800 elements against 12
    numbers(over_carriages, "processor per iteration [µs]")
    assert [row["over"] for row in exponents] == ["elements", "carriages"]


@pytest.mark.long  # compiles the solver of another commit each time
def test_a_frame_is_measured_in_units_of_the_solver(tmp_path):
    result = run("frame", "--quick", "--output", tmp_path)
    assert result.returncode == 0, result.stderr
    frame = json.loads((tmp_path / "benchmarks.json").read_text())["frame"]
    ratios, stages = (table["rows"] for table in frame["tables"])
    (lift,) = ratios
    before, solver, bare, logged = (
        *numbers(ratios, "solver of 757d35a [µs a frame]"),
        *numbers(ratios, "solver [µs]"),
        *numbers(ratios, "no logs [µs]"),
        *numbers(ratios, "all logs [µs]"),
    )
    assert lift["scenario"] == "chairlift"
    assert lift["no logs, times the solver"] == pytest.approx(1.0 + (bare - solver) / before)
    assert lift["all logs, times the solver"] == pytest.approx(1.0 + (logged - solver) / before)
    assert {"solve", "observe", "key figures", "encode", "MCAP", "rerun"} <= {row["stage"] for row in stages}
    shares = [wall / 100.0 for wall in numbers(stages, "wall per frame [µs]")]
    assert numbers(stages, "of a frame of 10 ms [%]") == pytest.approx(shares)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (
            ["speed"],
            "'speed' is no part; allowed are exudyn, exudyn_space, space, ropes, scaling, startup, frame, graded, "
            "uniform, loads, accuracy, convergence, coupled, learning, ensemble, outlook, envelope, study, lockstep, "
            "emergency_stop, live",
        ),
        (["--repetitions", "0"], "--repetitions"),
        (
            ["scaling", "--beside", "."],
            "--beside: neither loads nor coupled was asked for; allowed: with loads or coupled",
        ),
        (
            ["loads", "--beside", "nowhere"],
            "--beside: given nowhere; allowed: with loads or coupled, a directory that has",
        ),
        (["scaling", "--minutes", "3"], "--minutes is of the part live, which was not asked for"),
        (["live", "--minutes", "-1"], "'-1' given; allowed are numbers above 0"),
    ],
)
def test_refuses_what_it_does_not_know(monkeypatch, capsys, arguments, said):
    monkeypatch.setattr(sys, "argv", ["benchmarks", *arguments])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    assert said in capsys.readouterr().err


def test_the_page_names_all_parts_in_order():
    named = re.findall(r"`(?:python -m benchmarks )?(\w+)(?: --quick)?`", HEAD.partition("```")[0])
    assert named == list(PARTS)


def test_refuses_results_that_are_not_its_own_before_it_measures(tmp_path, monkeypatch, capsys):
    (tmp_path / "benchmarks.json").write_text("[]")
    monkeypatch.setattr(sys, "argv", ["benchmarks", "scaling", "--output", str(tmp_path)])  # would take minutes
    assert main() == 1
    assert "is not from here" in capsys.readouterr().err


@pytest.mark.long
def test_steps_for_learning_and_parts_that_were_not_run_stay(tmp_path, monkeypatch, capsys):
    """Environment not slower than the same trip by commands and snapshots."""
    path = tmp_path / "benchmarks.json"
    other = json.loads((ROOT / "docs" / "benchmarks.json").read_text())["frame"]
    path.write_text(json.dumps({"frame": other}))
    monkeypatch.setattr(sys, "argv", ["benchmarks", "learning", "--quick", "--output", str(tmp_path)])
    assert main() == 0
    records = json.loads(path.read_text())
    assert list(records) == ["frame", "learning"]
    assert records["frame"] == other
    table, vectors = records["learning"]["tables"]
    assert all(row["steps of one per second of the clock"] > 0.0 for row in vectors["rows"])
    alone, read, environment = numbers(table["rows"], "steps per second of the processor")
    assert alone > read
    assert environment > read


@pytest.mark.long
def test_lockstep(tmp_path, monkeypatch, domain):
    """Twin stepped by one call, without waiting for its clock of 100 frames a second."""
    pytest.importorskip("rclpy")
    monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
    result = run("lockstep", "--quick", "--output", tmp_path)
    assert result.returncode == 0, result.stderr
    (table,) = json.loads((tmp_path / "benchmarks.json").read_text())["lockstep"]["tables"]
    for what in ("API alone", "API with messages", "one call"):
        assert numbers(table["rows"], what)[0] > 200.0


@pytest.mark.parametrize("width", [80, 200])
def test_tables_have_every_number_on_a_narrow_terminal(width):
    """Widest part of the results, with as many columns of text."""
    columns = range(14)
    rows = [{"process": f"twin {row}", **{f"{key} ms": 1000 * row + key for key in columns}} for row in range(9)]
    console = Console(width=width, file=StringIO())
    print_part(Part("Live", [Table("lateness", rows)], []), console)
    printed = console.file.getvalue()
    assert "…" not in printed
    assert max(map(len, printed.splitlines())) <= width
    assert all(re.search(rf"\b{number}\b", printed) for row in rows for number in row.values())


@pytest.mark.parametrize("width", [100, 110, 120, 130])
def test_no_number_is_cut_where_headings_take_the_room(width):
    """Lateness of frames, as the live benchmark has it: one long number in a narrow column."""
    headings = "frames|missed|median [ms]|p99 [ms]|p99.9 [ms]|max [ms]|below 0.5 ms|0.5 to 1 ms|1 to 2 ms|2 to 3 ms"
    names = f"{headings}|3 to 5 ms|5 to 10 ms|over 10 ms".split("|")
    numbers = [6098, 0, 0.0912, 4.45, 6.94, 9.32, 4026, 496, 136, 1094, 333, 13, 0]
    rows = [{"process": process, **dict(zip(names, numbers, strict=True))} for process in ("twin", "bare timer")]
    console = Console(width=width, file=StringIO())
    print_part(Part("Live", [Table("lateness", rows)], []), console)
    assert "…" not in console.file.getvalue()
    assert console.file.getvalue().count("0.0912") == 2


def live(*arguments, directory):
    """Module of the live benchmark, in a ROS domain of its own."""
    return run_python("-m", "benchmarks", "live", *arguments, directory=directory, variables=environment(directory))


def seconds(*rows):
    """Reports of seconds from (missed, bare timer in ms, watchers in ms)."""
    return [Second(float(index), missed, 0.0, bare, stall) for index, (missed, bare, stall) in enumerate(rows)]


@pytest.mark.parametrize(
    ("rows", "expected"),
    [
        ([(0, 0.1, 0.1)] * 3, 0),
        ([(2, 0.1, 0.1)], 2),
        ([(2, 12.0, 0.1)], 0),  # the bare timer missed one too
        ([(2, 0.1, 12.0)], 0),  # a core stood still
        ([(0, 0.1, 12.0), (2, 0.1, 0.1), (0, 0.1, 0.1)], 0),  # reports of both are not of the same instant
        ([(0, 0.1, 12.0), (0, 0.1, 0.1), (3, 0.1, 0.1)], 3),
        ([(1, 9.0, 9.9)], 1),
    ],
)
def test_missed_frames_are_explained_by_stalls_beside_them(rows, expected):
    assert unexplained(seconds(*rows), 10.0) == expected


def test_each_limit_is_named_when_it_is_missed():
    result = Result(
        minutes=1.0,
        twin={"lateness_p99.9_ms": 2.9},
        bare={"lateness_p99.9_ms": 0.5},
        seconds=seconds((0, 0.1, 0.1)),
        processor=24.0,
        resident=100.0,
        peak=100.0,
        commands=100,
        refused=0,
        dropped=0,
    )
    assert faults(result) == []
    late = replace(result, seconds=seconds((2, 0.1, 0.1)), processor=26.0, dropped=4, twin={"lateness_p99.9_ms": 3.1})
    assert faults(late) == [
        "live: aerial_tramway: 2 missed frames that no stall of the machine explains",
        "live: aerial_tramway: lateness p99.9 of 3.10 ms, allowed are 3 ms (bare timer: 0.50 ms)",
        "live: aerial_tramway: 26.0 % of a core, allowed are 25 %",
        "live: aerial_tramway: 4 frames are missing in the logs",
    ]


@pytest.mark.long
def test_a_short_run_gives_every_figure(tmp_path):
    pytest.importorskip("rclpy")
    scenario = write_quick_scenario(tmp_path)
    result = live("--minutes", "0.1", "--scenario", str(scenario), "--output", ".", directory=tmp_path)
    assert result.returncode in (0, 1), result.stdout + result.stderr  # the machine may be busy
    part = json.loads((tmp_path / "benchmarks.json").read_text())["live"]
    lateness, process, worst = (table["rows"] for table in part["tables"])
    twin, bare = lateness
    assert 400 < twin["frames"] < 1500
    assert 300 < bare["frames"] <= twin["frames"] + 50
    for one in lateness:
        bins = [key for key in one if key.startswith(("below ", "over ")) or " to " in key]
        assert len(bins) == 7
        assert sum(one[key] for key in bins) == one["frames"]
        assert 0.0 < one["median [ms]"] <= one["p99 [ms]"] <= one["max [ms]"]
    assert process[0]["commands sent"] > 50
    assert process[0]["refused"] == 0
    assert len(worst) >= 4
    assert worst[0]["twin [ms]"] >= worst[-1]["twin [ms]"] > 0.0
    assert 0.5 < process[0]["processor [% of a core]"] < 200.0
    assert 50.0 < process[0]["resident [MB]"] <= process[0]["peak [MB]"]
    assert "## Live" in (tmp_path / "benchmarks.md").read_text()
    assert (tmp_path / "pictures" / "live_quick.png").stat().st_size > 5000
    assert 0.0 < process[0]["stamp to subscriber, median [ms]"] <= process[0]["p99 [ms]"]


def test_what_cannot_be_measured_is_one_line(tmp_path):
    pytest.importorskip("rclpy")
    result = live("--scenario", "nowhere", directory=tmp_path)
    assert result.returncode == 1
    assert "Traceback" not in result.stderr
    assert "python -m benchmarks: live:" in result.stderr
    assert "nowhere" in result.stderr
