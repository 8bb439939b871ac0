"""Hydraulic tensioner of a loop: its pull as a key figure, at its set-point and locked."""

import numpy as np
import pytest

from cable_twin.key_figures import KeyFigures
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation

FORCE = 3.0e5


@pytest.mark.parametrize("locked", [False, True])
def test_the_pull_of_a_hydraulic_tensioner_is_a_key_figure(locked):
    """Formerly only its travel; with its strands parallel the pull is the sum of their tensions."""
    base = load_scenario("chairlift")
    name, weight = next((name, one.counterweight) for name, one in base.sheaves.items() if one.counterweight)
    cylinder = {"direction": list(weight.direction), "force": FORCE, "band": 5e3, "locked": locked}
    changes = {f"sheaves.{name}.counterweight": None, f"sheaves.{name}.hydraulics": cylinder}
    twin = Simulation(load_scenario("chairlift", changes))
    figures = KeyFigures(twin.scenario)
    figures.update(twin.snapshot)
    found = {one.id.statistic: one for one in figures.figures() if one.id.quantity == "hydraulics_pull"}
    assert found["highest"].value == found["lowest"].value
    assert found["highest"].name == f"{name}: hydraulics pull, highest"
    row = list(twin.scenario.sheaves).index(name)
    tensions = float(np.sum(twin.snapshot.columns.sheave_tension[row]))
    assert found["highest"].value == pytest.approx(tensions if locked else FORCE, rel=0.02)
    assert found["highest"].value <= tensions
