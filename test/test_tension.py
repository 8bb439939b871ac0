"""Tension beside loads and at the ends: in balance with supports and loads on any mesh."""

import numpy as np
import pytest
from scipy.optimize import root
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


SPAN = {"cable.bending_stiffness": 0.0, "cable.elements": 20}  # of `single_span`, so that catenaries are exact
HAUL = {
    "axial_stiffness": 6e7,
    "mass_per_length": 6.0,
    "beyond_track": 20.0,
    "drive_inertia": 3e4,
    "pretension": 6e4,
    "station": "end",
}
IN_WIND = {
    "cable.start.position": [0.0, 0.0, 0.0],
    "cable.end.position": [1000.0, 0.0, 300.0],
    "cable.diameter": None,
    "air.wind": [0.0, 12.0, 0.0],
}


def hangs(pull, weight, stiffness, length):
    """End (3,) of an elastic catenary in space from the origin, with `pull` (3,) on it at the end of its start."""
    across, up = np.hypot(*pull[:2]), np.array([pull[2], pull[2] + weight * length])
    way = length / stiffness + float(np.diff(np.arcsinh(up / across))[0]) / weight
    rise = length * up.mean() / stiffness + float(np.diff(np.hypot(across, up))[0]) / weight
    return np.array([*(pull[:2] * way), rise])


def exact_ratio(simulation):
    """Tension over the load across the bisector of both tangents, of two catenaries that meet under the cabin."""
    cable, carriage = simulation.scenario.cable, simulation.snapshot.carriages["cabin"]
    weight, place, load = cable.mass_per_length * 9.81, carriage.arc_length, carriage.contact_force
    ends = [np.array([end.position[0], 0.0, end.position[-1]]) for end in (cable.start, cable.end)]

    def sides(pull):
        before = pull + np.array([0.0, 0.0, weight * place])
        return before, before + load

    def gap(pull):
        pull = pull * 1e6
        near = hangs(pull, weight, cable.axial_stiffness, place)
        far = hangs(sides(pull)[1], weight, cable.axial_stiffness, cable.unstrained_length - place)
        return near + far - (ends[1] - ends[0])

    way = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
    found = root(gap, way * np.linalg.norm(simulation.snapshot.supports["start"].force) / 1e6, tol=1e-13)
    before, after = sides(found.x * 1e6)
    assert np.abs(gap(found.x)).max() < 1e-8
    bisector = before / np.linalg.norm(before) + after / np.linalg.norm(after)
    across = load - (load @ bisector) / (bisector @ bisector) * bisector
    return min(np.linalg.norm(before), np.linalg.norm(after)) / np.linalg.norm(across)


def load_figure(simulation):
    return gathered(simulation)["cabin: tension over transverse load"]


@pytest.mark.parametrize("place", [60.0, 579.56, 1039.02])
@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"carriages.cabin.joint": "fixed"},
        {"carriages.cabin.drive.haul_rope": HAUL},
        IN_WIND,
        {**IN_WIND, "carriages.cabin.drive.haul_rope": HAUL},
    ],
    ids=["own drive", "fixed", "haul rope", "space", "haul rope in space"],
)
def test_tension_over_transverse_load_is_that_of_two_catenaries(changes, place):
    """The rope bends at the cabin by much more than between two of the points at which it is sampled."""
    changes = {**SPAN, **changes, "carriages.cabin.arc_length": place}
    simulation = Simulation(load_scenario("single_span", changes), samples=51)
    assert load_figure(simulation) == nearly(exact_ratio(simulation))


@pytest.mark.parametrize("place", [105.0, 1039.02])
def test_tension_over_transverse_load_is_that_of_the_mirror_image(place):
    """With the bending stiffness of the rope; the same line, seen from behind."""
    length = 1044.25
    mirrored = {"cable.start.position": [0.0, 300.0], "cable.end.position": [1000.0, 0.0]}
    one, other = (
        Simulation(load_scenario("single_span", {**changes, "carriages.cabin.arc_length": at}))
        for changes, at in (({}, place), (mirrored, length - place))
    )
    assert load_figure(one) == nearly(load_figure(other), rel=1e-8)


@needs_kernels
def test_tension_over_transverse_load_of_a_chair():
    """Under a chair both sections are those of the rope beside it, in balance with its weight."""
    simulation = Simulation(load_scenario("chairlift"))
    column, layout = simulation.snapshot.columns, simulation.layout
    weights = np.linalg.norm(column.contact_force, axis=1)
    seen = 0
    for row in np.flatnonzero(column.attached == 1.0):
        rope = list(layout.ropes)[int(column.vehicle_rope[row])]
        place = column.arc_length[row]
        tensions = simulation.cable_tension(place + np.array([-BESIDE, BESIDE]), rope)
        # the sides of a triangle of both tensions and the weight between them
        bend = (weights[row] ** 2 - np.diff(tensions)[0] ** 2) / (tensions.sum() ** 2 - np.diff(tensions)[0] ** 2)
        assert column.tension_over_load[row] == nearly(tensions.min() / (tensions.sum() * np.sqrt(bend)), rel=1e-4)
        seen += 1
    assert seen
