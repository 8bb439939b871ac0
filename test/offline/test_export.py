"""Key figures and signals for programs: `--csv` and `--json` of `simulate` and `review`, every frame, with units."""

from __future__ import annotations

import csv
import io
import json

import pytest
from twin_process import run_module, write_quick_scenario

from cable_twin.frame.plotted_signals import SIGNALS
from cable_twin.key_figures import QUANTITIES
from cable_twin.offline import review, simulate
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Directory with a run of two seconds and its exported files."""
    directory = tmp_path_factory.mktemp("export")
    write_quick_scenario(directory)
    (directory / "go.yaml").write_text("- {time: 0, name: cabin, speed: 6}\n")
    result = run_module(
        *("offline.simulate", "quick.yaml", "--script", "go.yaml", "--duration", "2", "--log-rope-rate", "0"),
        *("--csv", "run.csv", "--json", "-"),
        directory=directory,
    )
    assert result.returncode == 0, result.stderr
    (log,) = (directory / "cable_twin_logs").iterdir()
    return directory, log, result


def table(path):
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_json_on_the_output_is_all_that_is_there_and_words_are_beside_it(made):
    directory, log, result = made
    (run,) = json.loads(result.stdout)["runs"]
    assert (run["run"], run["scenario"]) == (str(log.relative_to(directory)), "quick")
    assert "2.00 s in" in result.stderr
    figures = {figure["key_figure"]: figure for figure in run["key_figures"]}
    speed = figures["cabin: speed"]
    assert (speed["unit"], speed["limit"], speed["bound"], speed["kept"]) == ("m/s", 10.0, "at most", True)
    signals = run["signals"]
    assert len(signals["rows"]) == 201
    assert all(len(row) == len(signals["columns"]) for row in signals["rows"])


def test_every_signal_of_the_table_has_a_column_with_its_unit_and_the_value_of_the_twin(made):
    directory, _, _ = made
    rows = table(directory / "run.csv")
    simulation = Simulation(load_scenario(directory / "quick.yaml"))
    simulation.command("cabin", speed=6.0)
    simulation.advance_to(1.0)
    assert rows[100].pop("time [s]") == "1.0"
    layout, columns = simulation.layout, simulation.snapshot.columns
    expected = {}
    for signal in SIGNALS.values():
        values = zip(signal.names(layout), signal.values(layout, columns), strict=True)
        expected |= {f"{signal.name}/{name} [{signal.unit}]": float(value) for name, value in values}
    assert {"speed/cabin [m/s]", "tension/highest [N]", "swing/cabin/cabin [deg]"} <= set(rows[100])
    # those that are left out are of ends without a counterweight, and of a carriage without a haul rope
    lacking = {"travel/start [m]", "travel/end [m]", "haul_force/cabin [N]"}
    assert {name for name in expected if name not in rows[100]} <= lacking
    empty = {name for name, value in rows[100].items() if not value}
    assert empty == {"commanded_force/cabin [N]"}  # the command in force is a speed
    written = {name: float(value) for name, value in rows[100].items() if value}
    assert written == {name: expected[name] for name in written}
    assert written["commanded_speed/cabin [m/s]"] == 6.0
    assert written["reference_speed/cabin [m/s]"] == written["speed/cabin [m/s]"] > 0.0
    assert 0.0 < written["force_limit_used/cabin [-]"] < 1.0


def test_review_gives_the_same_from_the_log(made, tmp_path, capsys):
    directory, log, result = made
    assert review.main([str(log), "--no-viewer", "--json", "-", "--csv", str(tmp_path / "log.csv")]) == 0
    output = capsys.readouterr()
    (run,) = json.loads(output.out)["runs"]
    (original,) = json.loads(result.stdout)["runs"]
    assert "complete; scenario quick" in output.err
    assert run["key_figures"] == original["key_figures"]
    for name in ("log", "run"):
        path = tmp_path if name == "log" else directory
        figures = table(path / f"{name}_key_figures.csv")
        assert [figure["key_figure"] for figure in figures] == [item["key_figure"] for item in run["key_figures"]]
        assert [float(figure["value"]) for figure in figures] == [item["value"] for item in run["key_figures"]]
    logged, simulated = table(tmp_path / "log.csv"), table(directory / "run.csv")
    assert len(logged) == len(simulated)
    for column in ("speed/cabin [m/s]", "arc_length/cabin [m]"):
        assert [float(row[column]) for row in logged] == [float(row[column]) for row in simulated]


def test_rows_of_several_runs_say_which(made, capsys):
    _, log, _ = made
    assert review.main([str(log), str(log), "--no-viewer", "--csv", "-"]) == 0
    output = capsys.readouterr()
    rows = list(csv.DictReader(io.StringIO(output.out)))
    assert [row["run"] for row in rows] == [str(log)] * 402
    assert [row["time [s]"] for row in rows[:201]] == [row["time [s]"] for row in rows[201:]]
    assert "differences at 201 common frames" in output.err


@pytest.mark.parametrize("command", [simulate, review])
def test_what_cannot_be_written_is_a_line_before_anything_runs(made, tmp_path, refusal, command):
    directory, log, _ = made
    arguments = [directory / "quick.yaml", "--record", "off"] if command is simulate else [log, "--no-viewer"]
    nowhere = tmp_path / "nowhere" / "a.csv"
    line = refusal(command.main, *arguments, "--csv", nowhere, code=1)
    assert line.endswith(f": {nowhere}: No such file or directory")
    line = refusal(command.main, *arguments, "--csv", "-", "--json", "-")
    assert "--csv, --json: given - for both; allowed: standard output for one of them" in line
    line = refusal(command.main, *arguments, "--csv", tmp_path / "a.parquet")
    assert "a.parquet; allowed: a name that ends in .csv, or -" in line


def test_angles_are_in_deg_as_signals_and_in_rad_as_key_figures():
    """As docs/experiments.md says."""
    units = {signal.unit for signal in SIGNALS.values()}, {row.unit for row in QUANTITIES.values()}
    assert [{"deg", "rad"} & one for one in units] == [{"deg"}, {"rad"}]
