"""Energy lost by the solver, as reported by a running twin and by `review` of its log."""

from __future__ import annotations

import json

import pytest
from small_tramway import IN_SPACE, TRAMWAY

from cable_twin.key_figures import QUANTITIES, KeyFigures
from cable_twin.offline import review, simulate
from cable_twin.runtime.watches import FigureWatch
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation

ENERGY_LOST = QUANTITIES["energy_lost"].name
BEGIN, DURATION = 0.5, 12.0  # s


@pytest.mark.parametrize("tramway", [TRAMWAY, IN_SPACE], ids=["plane", "space"])
def test_a_running_twin_and_the_log_of_its_run_have_one_verdict(tramway, tmp_path, capsys):
    """No alarm from the first steps of a motion, which lose a large share of little energy."""
    scenario = load_scenario(tramway, {"solver.step": 0.02})
    path, script = tmp_path / "tramway.yaml", tmp_path / "start.yaml"
    path.write_text(scenario.to_yaml(), encoding="utf-8")
    script.write_text(f"- {{time: {BEGIN}, name: cabin, speed: 3.0}}\n", encoding="utf-8")
    arguments = [str(path), "--script", str(script), "--duration", str(DURATION), "--frame-rate", "50"]
    assert simulate.main([*arguments, "--record", "bag", "--output", str(tmp_path / "runs")]) == 0
    (run,) = (tmp_path / "runs").iterdir()
    assert review.main([str(run), "--no-viewer", "--json", str(tmp_path / "run.json")]) == 0
    assert ENERGY_LOST not in capsys.readouterr().err
    (reviewed,) = json.loads((tmp_path / "run.json").read_text())["runs"]
    (found,) = [figure for figure in reviewed["key_figures"] if figure["id"] == "energy_lost/solver/highest"]

    simulation = Simulation(scenario)
    watch, levels = FigureWatch(KeyFigures(scenario)), set()
    watch.update(simulation.snapshot)
    for frame in range(1, round(50.0 * DURATION) + 1):
        if frame == round(50.0 * BEGIN) + 1:
            watch.command(simulation.command("cabin", speed=3.0))
        watch.update(simulation.advance_to(0.02 * frame))
        statuses = {status.name: status for status in watch.statuses()}
        levels |= {statuses[ENERGY_LOST].level} if ENERGY_LOST in statuses else set()
    assert levels == {0}  # at no moment a warning
    assert not [line for line in watch.take_messages() if ENERGY_LOST in line]
    assert found["kept"] is True
    assert found["value"] == pytest.approx(float(statuses[ENERGY_LOST].values["value"]), rel=1e-9)
