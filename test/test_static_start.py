"""The static start as meshes become finer and cables stiffer."""

from __future__ import annotations

import numpy as np
import pytest

from cable_twin.scenario import load_scenario
from cable_twin.simulation import EquilibriumError, Simulation


def bent(elements: int, model: str) -> float:
    """Angle (rad) at the end of a cantilever of 1 m, EI = 10 N m², EA = 20 kN, under an end moment of 10 N m."""
    cable = {
        "unstrained_length": 1.0,
        "mass_per_length": 1.0,
        "axial_stiffness": 2e4,
        "bending_stiffness": 10.0,
        "elements": elements,
        "elastic_model": model,
        "start": {"position": [0.0, 0.0], "support": "clamped", "direction": [1.0, 0.0]},
        "end": {"position": [1.0, 0.0], "support": "free"},
        "loads": [{"arc_length": 1.0, "moment": 10.0}],
    }
    slope = Simulation(load_scenario({"gravity": 0.0, "cable": cable})).state.nodes.position[-1, 1]
    return -float(np.arctan2(slope[1], slope[0]))


@pytest.mark.parametrize("elements", [32, 64, 128, 512])
def test_a_cantilever_under_an_end_moment_survives_refinement(elements):
    """M L / EI = 1; in the frame of elements, the softness of theory.md: 2.4 c κ² more, with c = 5 EI / EA."""
    assert bent(elements, "continuum") == pytest.approx(1.0, abs=1e-8)
    assert bent(elements, "element_frame") == pytest.approx(1.0 + 2.4 * 5.0 * 10.0 / 2e4, abs=3e-4)


@pytest.mark.parametrize("elements", [24, 96])
def test_a_cable_that_hardly_stretches_finds_its_rest_from_softer_ones(elements):
    stiff = {"cable.axial_stiffness": 1e12, "cable.elements": elements}
    stiffer, real = (
        Simulation(load_scenario("seed_example", change)) for change in (stiff, {"cable.elements": elements})
    )
    heights = [one.snapshot.carriages["carriage"].position[2] for one in (stiffer, real)]
    assert heights[0] == pytest.approx(heights[1], abs=0.02)


def test_where_there_is_no_rest_the_line_says_what_to_change():
    with pytest.raises(
        EquilibriumError, match=r"no static equilibrium .* lost in rounding: lower cable.axial_stiffness"
    ):
        Simulation(load_scenario("seed_example", {"cable.axial_stiffness": 1e14}))
