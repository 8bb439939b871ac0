"""Towers in space: refused ones, lateral groove forces, and a derailment in all outputs."""

import csv
import json
import re
from math import sqrt

import numpy as np
import pytest
from bent_line import BENT
from recorded_run import snapshots_of
from test_scenario_faults import faults_of

from cable_twin.key_figures import KeyFigures
from cable_twin.messages import DERAILMENTS, decode
from cable_twin.offline.replay import main as replay
from cable_twin.offline.review import main as review
from cable_twin.offline.simulate import main as simulate
from cable_twin.recording.log_reader import read_log
from cable_twin.scenario import ScenarioError, load_scenario
from cable_twin.simulation import Simulation

SCRIPT = "- {time: 0.5, wind: 0, wind_y: -40}\n- {time: 2.5, event: reset}\n"
FAULTS = [
    (
        "position",
        [100.0, 70.0, 2.0],
        "there the line turns by 70 degrees in plan, .* allowed: a turn of less than 60 degrees",
    ),
    ("groove_direction", [0.0, 0.2, -1.0], r"given \[0.0, 0.2, -1.0\]: it points away from the rope; .* z above 0"),
    ("groove_direction", [1.0, 0.0, 0.2], "it points along the rope; allowed: a direction across the rope"),
    ("groove_direction", [0.0, 0.0, 0.0], "allowed: a direction, not all numbers zero"),
    ("derailment_ratio", 0.0, "given 0.0; allowed: a finite number above 0"),
    ("groove_height", -0.1, "given -0.1 m; allowed: a finite number above 0, in m"),
    ("mast_offset", 4.0, "given nothing: a mast has an offset and a width; allowed: both or none, in m"),
]


@pytest.mark.parametrize(("key", "value", "text"), FAULTS)
def test_a_fault_says_where_what_and_what_is_allowed(tmp_path, key, value, text):
    file = tmp_path / "bent.yaml"
    file.write_text(json.dumps(BENT), encoding="utf-8")
    (fault,) = faults_of(file, {f"towers.tower.{key}": value, "cable.unstrained_length": 260.0})
    assert fault.startswith(f"{file}")
    assert f": towers.tower.{'mast_width' if key == 'mast_offset' else key}: " in fault
    assert re.search(text, fault), fault


def test_a_groove_of_a_hold_down_opens_downwards():
    direction = {"towers.tower.hold_down": True, "towers.tower.groove_direction": [0.0, 0.0, 1.0]}
    with pytest.raises(ScenarioError, match="z below 0, as it holds the rope down"):
        load_scenario(BENT, direction)


def test_a_plane_has_neither_grooves_nor_masts():
    flat = {
        "cable.start.position": [0.0, 0.0],
        "cable.end.position": [200.0, 0.0],
        "towers.tower.position": [100.0, 2.0],
    }
    for key, value in (("mast_offset", 3.0), ("groove_direction", [0.0, 1.0])):
        (fault,) = faults_of(BENT, flat | {f"towers.tower.{key}": value})
        assert re.search(rf"towers\.tower\.{key}: given .*: in a plane; allowed: null", fault)
    assert load_scenario(BENT, flat).dim == 2


def test_towers_that_the_rope_does_not_reach_in_plan_are_refused():
    (fault,) = faults_of(BENT, {"towers.tower.position": [100.0, 8.0, 2.0], "cable.unstrained_length": 200.8})
    assert re.search(
        r"towers\.tower\.position: given \[100\.0, 8\.0, 2\.0\] m: .* sideways with [\d.]+ kN, 0\.\d+ of its normal "
        r"force; allowed: at most 0\.5 of it \(derailment_ratio\): move the tower towards y = 0 m",
        fault,
    ), fault


def test_a_groove_that_leans_bears_what_an_upright_one_does_not():
    """Inclined groove along the direction of the force."""
    far = {"towers.tower.position": [100.0, 8.0, 2.0], "cable.unstrained_length": 200.8}
    leans = Simulation(load_scenario(BENT, far | {"towers.tower.groove_direction": [0.0, 0.8, 1.0]}))
    tower = leans.snapshot.supports["tower"]
    force = tower.force
    across = np.array([0.0, 1.0, -0.8]) / sqrt(1.64)
    assert tower.tower.lateral_force == pytest.approx(float(across @ force), rel=1e-3)
    assert tower.tower.lateral_ratio < 0.5 < force[1] / force[2]
    with pytest.raises(ScenarioError, match=r"groove_direction: given .*: it points away from the bare cable"):
        load_scenario(BENT, far | {"towers.tower.groove_direction": [0.0, -2.5, 1.0]})


def test_the_event_in_what_a_simulation_shows_and_after_a_reset():
    simulation = Simulation(load_scenario(BENT))
    figures = KeyFigures(simulation.scenario)
    assert simulation.snapshot.derailments == []
    simulation.wind(0.0, 0.0, -40.0)
    for frame in range(1, 101):
        figures.update(simulation.advance_to(0.02 * frame))
    (one,) = simulation.snapshot.derailments
    assert (one.tower, one.how, one.position) == ("tower", "outward to the right", (100.0, 4.0, 2.0))
    assert 0.0 < one.time < 2.0
    assert one.ratio == pytest.approx(0.5, rel=0.05)
    assert simulation.snapshot.supports["tower"].force.tolist() == [0.0, 0.0, 0.0]
    found = {figure.name: figure for figure in figures.figures()}
    derailed = found["tower: derailed"]
    assert (derailed.value, derailed.time, derailed.kept) == (1.0, one.time, False)
    assert derailed.place == "x 100.0, y 4.0, z 2.0 m, outward to the right, wind 40.0 m/s to -90 deg"
    assert found["tower: lateral over normal force"].value == one.ratio

    again = Simulation(simulation.scenario)
    again.restore(simulation.capture())
    for twin in (simulation, again):
        twin.advance_to(3.0)
    np.testing.assert_array_equal(again.snapshot.numbers, simulation.snapshot.numbers)
    assert again.snapshot.derailments == [one]
    simulation.reset()
    assert simulation.snapshot.derailments == []
    assert simulation.advance_to(3.1).supports["tower"].force[2] > 1e3


def test_a_rope_that_the_wind_lifts_is_out():
    simulation = Simulation(load_scenario(BENT, {"towers.tower.position": [100.0, 0.0, 0.5]}))
    simulation.wind(0.0, 80.0)
    simulation.advance_to(2.0)
    (one,) = simulation.snapshot.derailments
    assert one.how == "by lifting off"
    assert str(one) == f"tower: rope derailed by lifting off at {one.time:.3f} s, at x 100.0, y 0.0, z 0.5 m"


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """Run of `simulate` with a derailment, and the rope back on its tower after a reset."""
    directory = tmp_path_factory.mktemp("bent")
    (directory / "bent.yaml").write_text(json.dumps(BENT), encoding="utf-8")
    (directory / "script.yaml").write_text(SCRIPT, encoding="utf-8")
    arguments = [str(directory / "bent.yaml"), "--script", str(directory / "script.yaml"), "--duration", "3"]
    assert simulate([*arguments, "--output", str(directory / "runs"), "--csv", str(directory / "run.csv")]) == 0
    (run,) = (directory / "runs").iterdir()
    return directory, run


def test_simulate_writes_figures_and_signals_of_it(recorded):
    directory, _ = recorded
    figures = list(csv.DictReader((directory / "run_key_figures.csv").open(encoding="utf-8")))
    row = next(row for row in figures if row["key_figure"] == "tower: derailed")
    assert "outward to the right, wind 40.0 m/s to -90 deg" in row["place"]
    signal = [float(line["tower_lateral/tower [N]"]) for line in csv.DictReader((directory / "run.csv").open())]
    assert signal[0] > 1000.0
    assert signal[200] == 0.0  # out
    assert signal[-1] == pytest.approx(signal[0], rel=0.1)


def test_simulate_warns_of_it(recorded, capsys, tmp_path):
    directory, _ = recorded
    script = tmp_path / "script.yaml"
    script.write_text("- {time: 0.1, wind: 0, wind_y: -40}\n", encoding="utf-8")
    assert simulate([str(directory / "bent.yaml"), "--script", str(script), "--duration", "2", "--record", "off"]) == 0
    assert re.search(r"simulate: warning: tower: derailed: .* outward to the right, wind", capsys.readouterr().err)


def test_a_log_holds_the_event_and_is_replayed_to_the_last_bit(recorded, capsys):
    _, run = recorded
    log = read_log(run)
    messages = [
        (stamp_ns, decode(data, "diagnostic_msgs/msg/DiagnosticArray"))
        for topic, stamp_ns, data in log.files[0].messages([DERAILMENTS])
    ]
    (stamp_ns, out), (_, back) = messages
    (status,) = out.status
    values = {pair.key: pair.value for pair in status.values}
    assert (status.name, status.level, values["how"], values["y_m"]) == ("tower", 2, "outward to the right", "4.0")
    assert 0.0 <= (stamp_ns - log.epoch_ns) / 1e9 - float(values["time_s"]) < 0.01 + 1e-9
    assert back.status == []
    assert replay([str(run)]) == 0
    printed = capsys.readouterr().out
    assert re.search(rf"{DERAILMENTS} +2 samples, +0 differ", printed)


def test_review_shows_it(recorded, capsys, tmp_path):
    _, run = recorded
    frames = snapshots_of(run)
    out = [bool(frame.derailments) for frame in frames]
    first = out.index(True)
    time = frames[first].derailments[0].time
    assert frames[first].time - time < 0.01 + 1e-9
    assert out == [time <= frame.time <= 2.5 for frame in frames]
    rest = frames[0].supports["tower"]
    assert rest.tower.lateral_force == pytest.approx(float(rest.force[1]), rel=1e-6)
    assert frames[first].columns.wind.tolist() == [0.0, -40.0, 0.0]
    assert frames[-1].columns.wind.tolist() == [0.0, 0.0, 0.0]
    assert review([str(run), "--no-viewer", "--csv", str(tmp_path / "review.csv")]) == 0
    assert "tower: derailed" in capsys.readouterr().out
