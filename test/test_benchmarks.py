"""The benchmark command measures for real, says what it measured, and compares equal motions only."""

import json
import re
import sys
from io import StringIO
from math import isfinite
from pathlib import Path

import pytest
from rich.console import Console
from twin_process import run_python

from benchmarks.command import main
from benchmarks.report import Part, Table, print_part

ROOT = Path(__file__).resolve().parents[1]


def run(*arguments):
    return run_python("-m", "benchmarks", *arguments)


def numbers(rows, key):
    """Values of one column; all of them are finite and above zero."""
    values = [row[key] for row in rows]
    assert all(isinstance(value, (int, float)) and isfinite(value) and value > 0.0 for value in values)
    return values


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
        assert 0.0 < accurate["distance [mm]"] <= accurate["allowed [mm]"] <= 5.0
        assert default["distance [mm]"] > 0.0
        assert default["allowed [mm]"] is None


def test_another_motion_is_a_fault(monkeypatch):
    """What the comparison refuses: a tenth less gravity in Exudyn."""
    pytest.importorskip("exudyn")
    from rich.progress import Progress  # noqa: PLC0415

    from benchmarks import exudyn_comparison  # noqa: PLC0415
    from benchmarks.exudyn_model import ExudynModel  # noqa: PLC0415
    from benchmarks.measure import Effort  # noqa: PLC0415

    def lighter(self, exudyn, simulation, setting):
        scenario = simulation.scenario
        simulation.scenario = scenario.model_copy(update={"gravity": 0.9 * scenario.gravity})
        built(self, exudyn, simulation, setting)

    built = ExudynModel.__init__
    monkeypatch.setattr(ExudynModel, "__init__", lighter)
    with Progress(disable=True) as progress:
        part = exudyn_comparison.run(Effort(quick=True, repetitions=1), progress)
    assert part.faults
    assert all("allowed are" in fault and "mm from cable_twin" in fault for fault in part.faults)


def test_moves_as_exudyn_does_in_space(tmp_path):
    """A rope of a kilometre, pushed sideways: bare to a hundredth of a millimetre, far below 1 mm per metre of span."""
    pytest.importorskip("exudyn")
    result = run("exudyn_space", "--quick", "--output", tmp_path)
    assert result.returncode == 0, result.stderr
    times, distances = json.loads((tmp_path / "benchmarks.json").read_text())["exudyn_space"]["tables"]
    bare, vehicle = distances["rows"]
    assert [row["case"] for row in times["rows"]] == [bare["case"], vehicle["case"]]
    assert [bare["case"], vehicle["case"]] == ["1 km, 100 elements, bare", "1 km, 100 elements, one moving vehicle"]
    assert min(numbers(times["rows"], "faster than Exudyn [times]")) > 3.0  # of one turn on whatever else runs
    assert min(numbers(distances["rows"], "moved sideways [m]")) > 0.3
    assert bare["ropes apart [mm]"] < 0.01
    assert vehicle["ropes apart [mm]"] < 20.0
    assert vehicle["vehicles apart [mm]"] < 20.0


def test_another_motion_in_space_is_a_fault(monkeypatch):
    """A tenth less gravity in Exudyn, which in the second of a quick run is half a metre."""
    pytest.importorskip("exudyn")
    from rich.progress import Progress  # noqa: PLC0415

    from benchmarks import exudyn_space  # noqa: PLC0415
    from benchmarks.measure import Effort  # noqa: PLC0415

    def lighter(self, exudyn, simulation, setting):
        scenario = simulation.scenario
        simulation.scenario = scenario.model_copy(update={"gravity": 0.9 * scenario.gravity})
        built(self, exudyn, simulation, setting)

    built = exudyn_space.SpatialModel.__init__
    monkeypatch.setattr(exudyn_space.SpatialModel, "__init__", lighter)
    monkeypatch.setattr(exudyn_space, "NEAR", 1e-4)
    with Progress(disable=True) as progress:
        part = exudyn_space.run(Effort(quick=True, repetitions=1), progress)
    assert part.faults
    assert all("ropes apart [mm] is" in fault and "allowed: 100" in fault for fault in part.faults if "ropes" in fault)


@pytest.mark.long
def test_what_space_costs(tmp_path):
    result = run("space", "--quick", "--output", tmp_path)
    assert result.returncode == 0, result.stderr
    (table,) = json.loads((tmp_path / "benchmarks.json").read_text())["space"]["tables"]
    (row,) = table["rows"]
    assert 1.0 < row["space, times the plane"] < 4.0  # allowed are 2.5, of more turns
    assert numbers(table["rows"], "space, times real time")


def test_parts_that_were_not_run_stay(tmp_path):
    path = tmp_path / "benchmarks.json"
    other = json.loads((ROOT / "docs" / "benchmarks.json").read_text())["frame"]
    path.write_text(json.dumps({"frame": other}))
    result = run("scaling", "--quick", "--output", tmp_path)
    assert result.returncode == 0, result.stderr

    records = json.loads(path.read_text())
    assert list(records) == ["scaling", "frame"]
    assert records["frame"] == other
    over_elements, over_carriages, exponents = (table["rows"] for table in records["scaling"]["tables"])
    walls = numbers(over_elements, "wall per step [µs]")
    assert walls[-1] > walls[0]  # 3200 elements against 12
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
            "uniform, accuracy, convergence, learning, lockstep, emergency_stop, live",
        ),
        (["--repetitions", "0"], "--repetitions"),
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


def test_refuses_results_that_are_not_its_own_before_it_measures(tmp_path, monkeypatch, capsys):
    (tmp_path / "benchmarks.json").write_text("[]")
    monkeypatch.setattr(sys, "argv", ["benchmarks", "scaling", "--output", str(tmp_path)])  # would take minutes
    assert main() == 1
    assert "is not from here" in capsys.readouterr().err


def test_steps_for_learning(tmp_path, monkeypatch, capsys):
    """The environment is no slower than the same trip by commands and snapshots."""
    monkeypatch.setattr(sys, "argv", ["benchmarks", "learning", "--quick", "--output", str(tmp_path)])
    assert main() == 0
    (table,) = json.loads((tmp_path / "benchmarks.json").read_text())["learning"]["tables"]
    alone, read, environment = numbers(table["rows"], "steps per second of the processor")
    assert alone > read
    assert environment > read


@pytest.mark.long
def test_lockstep(tmp_path, monkeypatch, domain):
    """A twin that is stepped by one call does not wait for its clock, of 100 frames a second."""
    pytest.importorskip("rclpy")
    monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
    result = run("lockstep", "--quick", "--output", tmp_path)
    assert result.returncode == 0, result.stderr
    (table,) = json.loads((tmp_path / "benchmarks.json").read_text())["lockstep"]["tables"]
    for what in ("API alone", "API with messages", "one call"):
        assert numbers(table["rows"], what)[0] > 200.0


@pytest.mark.parametrize("width", [80, 200])
def test_tables_have_every_number_on_a_narrow_terminal(width):
    """Of the widest part, and as many columns of text."""
    columns = range(14)
    rows = [{"process": f"twin {row}", **{f"{key} ms": 1000 * row + key for key in columns}} for row in range(9)]
    console = Console(width=width, file=StringIO())
    print_part(Part("Live", [Table("lateness", rows)], []), console)
    printed = console.file.getvalue()
    assert "…" not in printed
    assert max(map(len, printed.splitlines())) <= width
    assert all(re.search(rf"\b{number}\b", printed) for row in rows for number in row.values())
