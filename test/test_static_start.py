"""Static start on finer meshes and stiffer cables, and limits on the step."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

from cable_twin.key_figures import KeyFigures
from cable_twin.offline.envelopes.cases import loading
from cable_twin.scenario import load_scenario
from cable_twin.simulation import EquilibriumError, Simulation, SolverError
from cable_twin.simulation.engine import Engine
from cable_twin.simulation.twin import NOTHING_DONE
from verification import JIT
from verification.statics import CANTILEVER, LEVEL_SPAN


def bent(elements: int, model: str) -> float:
    """End angle (rad) of a 1 m cantilever, EI = 10 N m², EA = 20 kN, under an end moment of 10 N m."""
    changes = {"axial_stiffness": 2e4, "bending_stiffness": 10.0, "elements": elements, "elastic_model": model}
    changes["loads"] = [{"arc_length": 1.0, "moment": 10.0}]
    scenario = load_scenario(CANTILEVER, {f"cable.{key}": value for key, value in changes.items()})
    slope = Simulation(scenario).state.nodes.position[-1, 1]
    return -float(np.arctan2(slope[1], slope[0]))


@pytest.mark.parametrize("elements", [32, 64, 128, 512])
def test_a_cantilever_under_an_end_moment_survives_refinement(elements):
    """M L / EI = 1; in element frames the softness of theory.md: 2.4 c κ² more, c = 5 EI / EA."""
    assert bent(elements, "continuum") == pytest.approx(1.0, abs=1e-8)
    assert bent(elements, "element_frame") == pytest.approx(1.0 + 2.4 * 5.0 * 10.0 / 2e4, abs=3e-4)


@pytest.mark.parametrize("elements", [24, 96])
def test_a_cable_that_hardly_stretches_finds_its_rest_from_softer_ones(elements):
    """24 elements that cannot bend without stretching: equilibrium depends on the path by 2 cm."""
    stiff = {"cable.axial_stiffness": 1e12, "cable.elements": elements}
    stiffer, real = (
        Simulation(load_scenario("seed_example", change)) for change in (stiff, {"cable.elements": elements})
    )
    heights = [one.snapshot.carriages["carriage"].position[2] for one in (stiffer, real)]
    assert heights[0] == pytest.approx(heights[1], abs=0.03 if elements == 24 else 0.001)


def test_where_there_is_no_rest_the_line_says_what_to_change():
    with pytest.raises(
        EquilibriumError, match=r"no static equilibrium .* lost in rounding: lower cable.axial_stiffness"
    ):
        Simulation(load_scenario("seed_example", {"cable.axial_stiffness": 1e14}))


def test_a_cable_without_bending_stiffness_is_no_strut():
    """300 m on 100 m without gravity; with gravity a hanging cable."""
    ends = {"start": {"position": [0.0, 0.0]}, "end": {"position": [100.0, 0.0]}}
    rope = {"unstrained_length": 300.0, "mass_per_length": 1.0, "axial_stiffness": 1e6, "elements": 60}
    slack = {"gravity": 0.0, "cable": {**rope, "bending_stiffness": 0.0, **ends}}
    with pytest.raises(EquilibriumError, match=r"cable.bending_stiffness: given 0, .* compression of 666.7 kN"):
        Simulation(load_scenario(slack))
    assert Simulation(load_scenario(slack, {"gravity": 9.81})).snapshot.cable.tensions.min() > 0.0


@pytest.mark.parametrize("radius", [0.5, 0.7, 0.8])
@pytest.mark.parametrize("share", [1.0, 0.1, 0.01])
def test_radii_that_are_sure_halve_no_step_whatever_the_load(radius, share):
    body = {"mass": share * 2.67, "inertia": share * 0.2242}
    changes = {f"carriages.carriage.bodies.{name}.{key}": body[key] for name in ("rb1", "rb2") for key in body}
    simulation = Simulation(load_scenario("seed_example", {**changes, "solver.spectral_radius": radius}))
    assert simulation.advance_to(1.0).solver.halvings == 0


def test_a_step_that_fails_names_a_radius_that_is_none_of_them():
    simulation = Simulation(load_scenario("seed_example", {"solver.spectral_radius": 1.0}))
    with pytest.raises(SolverError, match=r"solver.spectral_radius is 1, .* up to 0.8 is sure"):
        simulation.advance_to(2.0)


def test_a_straight_start_knows_on_which_elements_its_carriages_are():
    """Support forces at the start equal those after a step."""
    changes = {"cable.initial_shape": "straight", "cable.end.support": "free", "carriages.carriage.arc_length": 2.0}
    simulation = Simulation(load_scenario("seed_example", changes))
    cable = simulation.system.cable
    (element,) = simulation.state.joint_element
    assert cable.node_arc_length[element] <= 2.0 < cable.node_arc_length[element + 1]


@pytest.mark.parametrize("space", [2, pytest.param(3, marks=pytest.mark.long)])
def test_a_slack_rope_in_too_few_frames_is_told(space):
    """Warning for 20 elements, off by metres; none for 160, for a taut rope, and for `continuum`."""
    slack = {**LEVEL_SPAN, "space": space}
    slack["cable"] = {**LEVEL_SPAN["cable"], "unstrained_length": 110.0, "bending_stiffness": 100.0}
    slack["cable"]["elastic_model"] = "element_frame"
    with pytest.warns(UserWarning, match="element_frame on a slack rope .* elastic_model continuum"):
        Simulation(load_scenario(slack, {"cable.elements": 20}))
    for changes in ({"elements": 320}, {"elements": 20, "elastic_model": "continuum"}):
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            Simulation(load_scenario(slack, {f"cable.{key}": value for key, value in changes.items()}))


@pytest.mark.skipif(not JIT, reason="minutes without compilation")
def test_frames_that_a_vehicle_bends_are_told():
    """The turn of `single_span` under its cabin of 12 t, which is taut, so that its own weight hardly bends it."""
    frames = {"cable.elastic_model": "element_frame"}
    with pytest.warns(UserWarning, match="element_frame: the rope turns by .* rad within .* elastic_model continuum"):
        Simulation(load_scenario("single_span", frames), on_demand=True)
    with pytest.raises(
        EquilibriumError, match=r"haul_rope: given one that would have to push .* elastic_model continuum"
    ):
        Simulation(load_scenario("aerial_tramway", frames), on_demand=True)


@pytest.mark.skipif(not JIT, reason="minutes without compilation")
@pytest.mark.parametrize("name", ["chairlift", "aerial_tramway"])
def test_a_rest_that_is_found_nearby_is_the_one_from_scratch(name, monkeypatch):
    """Of the same mesh to rounding, of another one to the last bit; and the base is found again after it."""
    base = Simulation(load_scenario(name), on_demand=True)
    first = base.snapshot.numbers.copy()
    heavy = loading(base.scenario, "full")
    for values, near in (({"air.wind.x": 12.0, **heavy}, True), ({"air.temperature": -20.0}, False)):
        scenario = load_scenario(name, values)
        alone = figures_of(scenario, Simulation(scenario))
        with monkeypatch.context() as patch:
            if near:
                patch.setattr(Engine, "check_bare", None)  # which a search from scratch begins with
            found = figures_of(scenario, base.near(scenario))
        assert alone.keys() == found.keys()
        for key, value in alone.items():
            assert found[key] == (pytest.approx(value, rel=1e-6, abs=1e-6) if near else value), key
    base.engine.go_to_start()
    base.show(NOTHING_DONE)
    assert np.array_equal(base.snapshot.numbers, first, equal_nan=True)


def figures_of(scenario, simulation):
    figures = KeyFigures(scenario)
    figures.update(simulation.snapshot)
    return {str(one.id): one.value for one in figures.figures()}
