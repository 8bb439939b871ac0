"""Uncertainty of key figures from a run with half the mesh and half the step."""

from __future__ import annotations

import pytest
from named_figures import named

from cable_twin.offline.check import refined
from cable_twin.offline.simulate import main
from cable_twin.scenario import load_scenario


@pytest.mark.parametrize(
    ("value", "uncertainty", "verdict"),
    [
        (1.4, None, "kept"),
        (1.4, 0.05, "kept"),
        (1.4, 0.2, "not decided"),
        (1.6, 0.2, "not decided"),
        (1.8, 0.2, "not kept"),
        (1.5, 0.0, "kept"),  # on its limit, as a drive keeps a speed
    ],
)
def test_a_verdict_within_its_own_uncertainty_is_none(value, uncertainty, verdict):
    figure = named("acceleration", value, "m/s^2", 1.0, limit=1.5, uncertainty=uncertainty)
    assert figure.verdict == verdict
    assert named("acceleration", value, "m/s^2", 1.0, uncertainty=uncertainty).verdict == ""


@pytest.mark.parametrize("elements", [40, {"target": 20.0, "at_towers": 5.0, "growth": 1.44}])
def test_elements_and_steps_are_halved_everywhere(elements):
    from cable_twin.scenario import build_system  # noqa: PLC0415

    coarse = load_scenario("aerial_tramway", {"cable.elements": elements})
    fine = refined(coarse)
    counts = [build_system(one).cable.element_count for one in (coarse, fine)]
    assert counts[1] == pytest.approx(2 * counts[0], rel=0.05)
    assert fine.solver.step == 0.5 * coarse.solver.step


def test_simulate_says_how_sure_its_figures_are(capsys):
    arguments = ["seed_example", "--duration", "0.2", "--record", "off", "--set", "limits.swing=3.0", "--check"]
    assert main(arguments) == 0
    lines = capsys.readouterr().out.splitlines()
    (swing,) = (line for line in lines if "swing along the track" in line)
    assert "kept, ± " in swing
    assert any("rope tension, highest" in line and "± " in line for line in lines)


def test_a_state_is_of_one_mesh(capsys):
    assert main(["--snapshot", "state.npz", "--check"]) == 2
    assert "--check: given with a snapshot" in capsys.readouterr().err
