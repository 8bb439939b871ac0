"""Tension beside loads and at the ends: in balance with supports and loads on any mesh."""

import numpy as np
import pytest
from small_tramway import IN_SPACE, TRAMWAY
from test_jig_back import QUICK

from cable_twin.key_figures import KeyFigures
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation
from verification import JIT
from verification.statics import taut_inclined

needs_kernels = pytest.mark.skipif(not JIT, reason="minutes without compilation")
BESIDE = 1e-6  # m


def gathered(simulation):
    figures = KeyFigures(simulation.scenario)
    figures.update(simulation.snapshot)
    return {figure.name: figure.value for figure in figures.figures()}


def nearly(expected, rel=1e-6):
    return pytest.approx(expected, rel=rel)


@pytest.mark.parametrize("model", ["continuum", "element_frame"])
def test_a_load_between_nodes_leaves_no_spike(model):
    """12 t between nodes against two catenaries: both sides, everywhere, and the extremes."""
    mesh = {} if model == "continuum" else {"cable.elements": 256, "cable.bending_stiffness": 1e5}  # as it needs
    simulation, tension, place = taut_inclined(12e3, {"cable.elastic_model": model, **mesh})
    arc_lengths = np.linspace(0.0, 1044.25, 501)
    off = np.abs(simulation.cable_tension(arc_lengths) / tension(arc_lengths) - 1.0)
    assert off.max() < 1e-3
    before, after = simulation.cable_tension(np.array([place, place + BESIDE]))
    assert after - before == nearly(tension(np.array(place + BESIDE)) - tension(np.array(place - BESIDE)), rel=3e-3)
    figures = gathered(simulation)
    assert figures["rope tension, highest"] == nearly(tension(np.array(1044.25)), rel=1e-3)
    assert figures["rope tension, lowest"] == nearly(tension(np.array(0.0)), rel=1e-3)


@pytest.mark.parametrize("scenario", [TRAMWAY, IN_SPACE], ids=["plane", "space"])
@pytest.mark.parametrize("joint", ["paper", "node"])
def test_the_tension_of_a_rope_is_that_of_a_finer_mesh_and_of_what_pulls_it(scenario, joint):
    """Cabin with haul rope beside a tower; counterweight along the rope."""
    found = []
    for elements in (40, 320):
        changes = {"cable.elements": elements, "cable.joint": joint, "carriages.cabin.arc_length": 71.3}
        changes["carriages.cabin.payload.mass"] = 400.0
        found.append(Simulation(load_scenario(scenario, changes)))
    places = np.linspace(0.0, 121.5, 244)
    coarse, fine = (one.cable_tension(places) for one in found)
    np.testing.assert_allclose(coarse, fine, rtol=3e-3)
    for key in ("rope tension, highest", "rope tension, lowest"):
        assert gathered(found[0])[key] == nearly(gathered(found[1])[key], rel=3e-3)
    for one in found:
        supports, tensions = one.snapshot.supports, one.cable_tension(np.array([0.0, 121.5]))
        assert tensions == nearly([np.linalg.norm(supports[end].force) for end in ("start", "end")])
        direction = np.array([1.0, 0.0, 0.1]) / np.hypot(1.0, 0.1)
        assert supports["end"].force @ direction == nearly(5e3 * 9.81)


def test_the_tension_is_in_balance_on_the_way():
    """From rest, under way, in wind: ends and supports agree, without jumps at the cabin."""
    simulation = Simulation(load_scenario(TRAMWAY))
    simulation.command("cabin", speed=6.0)
    simulation.wind(8.0, 0.0)
    for _ in range(4 if JIT else 1):
        snapshot = simulation.advance_to(simulation.time + (1.5 if JIT else 0.01))
        tensions = simulation.cable_tension(np.array([0.0, 121.5]))
        assert tensions == nearly([np.linalg.norm(snapshot.supports[end].force) for end in ("start", "end")])
        # the tension falls by the weight of a metre over a metre of height, also where the cabin passes
        place = snapshot.carriages["cabin"].arc_length
        steps = np.diff(simulation.cable_tension(place + np.array([-1.0, -0.5, 0.0, 0.5, 1.0]) + BESIDE))
        assert np.abs(steps).max() < 2e-3 * tensions[1]


def test_sag_is_that_of_the_kink_under_the_vehicle():
    """Few sampled points: lowest at the joint, between two of them."""
    changes = {"carriages.cabin.arc_length": 31.0, "carriages.cabin.payload.mass": 400.0}
    coarse, fine = (Simulation(load_scenario(TRAMWAY, changes), samples=count) for count in (11, 2001))
    name = "sag below the chord, start to tower_1"
    assert gathered(coarse)[name] == nearly(gathered(fine)[name], rel=1e-3)


@needs_kernels
def test_several_ropes_bear_what_their_clamps_and_wheels_give_them():
    """Both sides of a clamp on the haul rope; supports of tracks, bullwheel tensions."""
    simulation = Simulation(load_scenario("jig_back", QUICK))
    simulation.command("haul_rope", speed=5.0)
    for time in (0.0, 2.0):
        snapshot = simulation.advance_to(time)
        for rope in ("track_1", "track_2", "haul_1", "haul_2"):
            ends = simulation.cable_tension(np.array([0.0, snapshot.ropes[rope].arc_lengths[-1]]), rope)
            forces = [np.linalg.norm(snapshot.supports[f"{rope}/{end}"].force) for end in ("start", "end")]
            moved = 7.0 * snapshot.drives["haul_rope"].speed ** 2 if rope.startswith("haul") else 0.0
            assert ends == pytest.approx(forces, rel=2e-5, abs=3.0 * moved + 1.0)
    column = snapshot.columns
    for row, rope in enumerate(snapshot.ropes.values()):
        inside = rope.tensions[2:-2]
        assert column.lowest_tension[row, 0] <= inside.min()
        assert column.highest_tension[row, 0] >= inside.max()
    # the haul rope holds its cabin: tension jumps by the pull, less what is of its own direction
    name = "cabin_1"
    parts = {rope: snapshot.ropes[rope] for rope in ("haul_1", "haul_2")}
    jumps = {}
    for rope, part in parts.items():
        fine = np.arange(0.0, part.arc_lengths[-1], 0.25)
        steps = np.diff(simulation.cable_tension(fine, rope))
        jumps[rope] = float(np.abs(steps).max())
    pull = np.linalg.norm(snapshot.carriages[name].clamp_force)
    assert min(abs(max(jumps.values()) / pull - 1.0), abs(min(jumps.values()) / pull - 1.0)) < 0.02


@needs_kernels
def test_strands_of_a_lift_have_no_spikes():
    """Chairs on both strands: tension rising with height only."""
    simulation = Simulation(load_scenario("chairlift"))
    for name, rope in simulation.snapshot.ropes.items():
        places = np.linspace(0.0, rope.arc_lengths[-1], 1201)
        height, tension = simulation.cable_positions(places, name)[:, 2], simulation.cable_tension(places, name)
        along = np.diff(tension) - 6.1 * 9.81 * np.diff(height)
        # what is left are chairs, whose weight along the rope it bears: never down the slope
        uphill = 1.0 if name == "up" else -1.0
        assert (uphill * along > -60.0).all()
        ends = [simulation.snapshot.supports[f"{name}/{end}"].force for end in ("start", "end")]
        assert tension[[0, -1]] == nearly([np.linalg.norm(force) for force in ends])
