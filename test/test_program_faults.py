"""Faults of the program: a line, a file of details and exit code 70; no control characters of others."""

import re
from pathlib import Path

import numpy as np
import pytest
from twin_process import run_python

from cable_twin.messages import Status
from cable_twin.messages.figure_messages import figures_of_statuses
from cable_twin.offline import simulate
from cable_twin.offline.plots import PlottedRun, write_plots
from cable_twin.offline.script import ScriptError, read_script
from cable_twin.offline.thinned_series import Signals, signal_values
from cable_twin.ros import sim
from cable_twin.ros.client import drive
from cable_twin.scenario import ScenarioError, load_scenario
from cable_twin.simulation import Simulation
from cable_twin.terminal.command_line import PROGRAM_FAULT, faults_reported, print_line, tell

OBEYED = "\x1b]0;owned\x07\x1b[2J\r\x9b31m\u202e"  # a title, a cleared screen, a line begun again, red, right to left
BROKEN = """
import sys
from cable_twin.offline import entry_points, line

def main():
    return [][3]

line.main = main
sys.argv = ["line", "chairlift"]
sys.exit(entry_points.line())
"""


def reported(text):
    """File of details named in a line."""
    (name,) = re.findall(r"please report it with (\S+)$", text.strip())
    return Path(name)


def test_a_fault_of_the_program_is_a_line_and_a_file(tmp_path):
    done = run_python("-c", BROKEN, variables={"TMPDIR": str(tmp_path)})
    assert done.returncode == PROGRAM_FAULT == 70
    assert done.stdout == ""
    assert done.stderr.startswith(
        "line: a fault of the program (IndexError: list index out of range), please report it"
    )
    assert done.stderr.count("\n") == 1
    details = reported(done.stderr)
    assert details.parent == tmp_path
    assert details.stat().st_mode & 0o077 == 0, "others may not read what was given"
    text = details.read_text()
    assert text.startswith("cable_twin ")
    assert "line chairlift" in text
    assert "return [][3]" in text or "in main" in text
    assert text.strip().endswith("IndexError: list index out of range")


@pytest.mark.parametrize("command", [sim, drive], ids=["sim", "drive"])
def test_commands_with_ros_do_so_as_well(command, monkeypatch, capsys, tmp_path):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.setattr(command, "split_ros_arguments", lambda _: 1 / 0)
    assert command.main([]) == PROGRAM_FAULT
    said = capsys.readouterr().err
    assert "a fault of the program (ZeroDivisionError: division by zero)" in said
    assert "ZeroDivisionError" in reported(said).read_text()


def test_a_full_disk_keeps_no_details(monkeypatch, capsys):
    monkeypatch.setattr("tempfile.tempdir", "/nowhere")

    @faults_reported("simulate")
    def main():
        raise ValueError(OBEYED)

    assert main() == PROGRAM_FAULT
    said = capsys.readouterr().err
    assert "its details cannot be written (No such file or directory)" in said
    assert said.removesuffix("\n").isprintable()


NUMBERS = [  # one rope and several
    ("gondola", "carriers.payload.leaving.return=-300", "finite numbers at least 0, in kg"),
    ("aerial_tramway", "cable.diameter=1e200", "in m, or null; numbers of 1e-30 to 1e+15 in size, or 0"),
    ("chairlift", "ropes.up.diameter=1e200", "in m, or null; numbers of 1e-30 to 1e+15 in size, or 0"),
    ("aerial_tramway", "towers.tower.position=[1e300, 10]", "in m; numbers of 1e-30 to 1e+15 in size, or 0"),
    ("chairlift", "towers.tower_1_up.position=[1e300, 1e300]", "in m; numbers of 1e-30 to 1e+15 in size, or 0"),
    ("seed_example", "carriages.carriage.bodies.rb1.upper_pivot=[0, 1e-300]", "of 1e-30 to 1e+15 in size, or 0"),
    ("seed_example", "solver.step=1e-300", "a finite number at least 1e-06 and at most 1, in s"),
    ("chairlift", "solver.step=1e308", "a finite number at least 1e-06 and at most 1, in s"),
    ("single_span", "solver.step=5", "a finite number at least 1e-06 and at most 1, in s"),
    ("seed_example", "gravity=1" + "0" * 400, "a finite number at least 0, in m/s^2"),
]


@pytest.mark.parametrize(("name", "change", "allowed"), NUMBERS, ids=[change[:40] for _, change, _ in NUMBERS])
def test_numbers_with_which_nothing_can_be_reckoned_are_named(name, change, allowed, capsys):
    assert simulate.main([name, "--set", change, "--duration", "0.01", "--record", "off"]) == 2
    said = capsys.readouterr().err.strip()
    assert said.startswith("simulate: ")
    assert f" {change.partition('=')[0]}: given " in said
    assert said.endswith(allowed)
    assert "\n" not in said


@pytest.mark.parametrize("key", ["name", "description"])
def test_texts_of_a_scenario_can_be_printed(key):
    with pytest.raises(ScenarioError, match=r"that can be printed$") as raised:
        load_scenario("seed_example", {key: f"a{OBEYED}"})
    assert str(raised.value).isprintable()
    assert load_scenario("seed_example", {"name": "Schöne Bahn 3"}).name == "Schöne Bahn 3"


def test_what_is_said_of_others_is_only_shown(capsys, tmp_path):
    tell("review", f"{OBEYED}.mcap: not a bag\nsecond")
    print_line(f"{OBEYED}: complete")
    shown = capsys.readouterr()
    assert shown.err.count("\n") == 2
    assert (shown.out + shown.err).replace("\n", "").isprintable()
    values = {"value": "1.0", "unit": f"N{OBEYED}", "time_s": "0", "place": OBEYED, "band": OBEYED, "id": "a/b/c"}
    (figure,) = figures_of_statuses([Status(0, f"tension{OBEYED}", "", values)])
    assert all(text.isprintable() for text in (figure.name, figure.unit, figure.place, figure.band))
    file = tmp_path / f"{OBEYED}.yaml"
    file.write_text(f'- {{time: 1, "{OBEYED.encode("unicode_escape").decode()}": 2}}\n')
    with pytest.raises(ScriptError) as raised:
        read_script(file)
    tell("simulate", raised.value)
    assert capsys.readouterr().err.removesuffix("\n").isprintable()


def test_names_are_no_formulas_in_plots(tmp_path):
    simulation = Simulation(load_scenario("seed_example", {"name": r"$\frac{$"}))
    signals = Signals()
    for time in np.arange(0.0, 0.03, 0.01):
        snapshot = simulation.advance_to(time)
        signals.update(snapshot, signal_values(snapshot))
    runs = [PlottedRun("", simulation.scenario.name, r"$\frac{$", signals)]
    assert all(file.stat().st_size > 10_000 for file in write_plots(runs, tmp_path, lambda _: None))
