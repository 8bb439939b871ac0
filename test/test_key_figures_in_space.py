"""Key figures in space against closed forms on prescribed frames, absent in a plane."""

from __future__ import annotations

import math

import numpy as np
import pytest
from prescribed_frames import SCENARIO, gathered, height, scenario

from cable_twin.frame.plotted_signals import SIGNALS
from cable_twin.frame.records import SolverReport
from cable_twin.frame.snapshot import Layout, Snapshot
from cable_twin.key_figures import KeyFigures
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation

WIDTH = 0.8 * 3.0  # m, of a cabin of 4 m and 3 m, as its outline is assumed
TOWERS = {"tower": {"position": [500.0, 0.0, -40.0], "mast_offset": 5.0, "mast_width": 1.2}}
LEANING = {"distance": 10.0, "left": [[0.0, -50.0], [1000.0, -50.0]], "right": [[0.0, -80.0], [1000.0, -80.0]]}


def spatial(**more):
    return load_scenario({**SCENARIO, "space": 3, "towers": TOWERS, **more})


def frame(one, moment, *, place=500.0, roll=0.0, pitch=0.0, y=0.0, wind=(0.0, 0.0, 0.0), lateral=0.0, ratio=0.0):
    """Frame of a cabin 5 m below a parabola, rolled or pitched, in wind (m/s)."""
    layout = Layout.of(one, 201)
    snapshot = Snapshot(layout, np.full(layout.size, math.nan), SolverReport(1, 1, 0, 0.0))
    c = layout.columns(snapshot.numbers.base)
    x = np.linspace(0.0, 1000.0, 201)
    c.time[0], c.wind[:] = moment, wind
    c.rope_position[:], c.rope_tension[:] = np.column_stack([x, 0.0 * x, height(x)]), 1e6
    c.arc_length[0], c.attached[0], c.contact_force[0] = place, 1.0, (0.0, 0.0, 1e5)
    c.body_position[0], c.body_angles[0] = (place, y, height(place) - 5.0), (roll, pitch, 0.0)
    half = 0.5 * (roll or pitch)
    c.body_orientation[0] = (
        (math.sin(half), 0.0, 0.0, math.cos(half)) if roll else (0.0, math.sin(half), 0.0, math.cos(half))
    )
    c.support_force[:] = 1e5
    c.tower_load[2], c.tower_lowest_load[2], c.tower_rest_load[2] = 2e5, 2e5, 2e5
    c.tower_lateral[2], c.tower_lateral_ratio[2] = lateral, ratio
    c.tower_derailed[2], c.tower_derailed_time[2] = 0.0, 0.0
    return snapshot


def figures_of(one, *frames):
    figures = KeyFigures(one)
    for number, options in enumerate(frames):
        figures.update(frame(one, float(number), **options))
    return gathered(figures)


def test_swing_across_with_its_limit_and_the_wind_at_that_time():
    frames = ({"roll": 0.1, "wind": (3.0, 4.0, 0.0)}, {"roll": -0.25, "wind": (0.0, -12.0, 0.0)}, {"roll": 0.2})
    swing = figures_of(spatial(), *frames)["cabin: swing across the track"]
    assert (swing.value, swing.unit, swing.time, swing.kept) == (0.25, "rad", 1.0, False)
    assert math.tan(swing.limit) == pytest.approx(0.2, rel=1e-4)  # 20 %, as the rules with this swing compare
    assert swing.place == "arc length 500.0 m, wind 12.0 m/s to -90 deg"
    assert "Vorarlberg" in swing.source
    along = figures_of(spatial(), {"pitch": 0.1}, {"pitch": 0.3, "wind": (3.0, 4.0, 0.0)})[
        "cabin: swing along the track"
    ]
    assert (along.value, along.place) == (0.3, "arc length 500.0 m, wind 5.0 m/s to 53 deg")
    own = figures_of(spatial(limits={"lateral_swing": 0.4}), *frames)["cabin: swing across the track"]
    assert (own.limit, own.source, own.kept) == (0.4, "scenario: limits.lateral_swing", True)


@pytest.mark.parametrize(
    ("wind", "text"),
    [
        ((0.0, 0.0, 30.15), "wind 30.1 m/s upwards"),
        ((0.0, 0.0, -2.0), "wind 2.0 m/s downwards"),
        ((0.0, 20.0, 2.0), "wind 20.1 m/s to 90 deg, 6 deg upwards"),
        ((0.0, 20.0, 0.1), "wind 20.0 m/s to 90 deg"),
    ],
)
def test_wind_that_rises_or_falls_says_so(wind, text):
    swing = figures_of(spatial(), {"roll": 0.1}, {"roll": -0.25, "wind": wind})["cabin: swing across the track"]
    assert swing.place == f"arc length 500.0 m, {text}"


def test_lateral_force_of_a_tower_and_how_much_of_its_ratio_is_used():
    frames = (
        {"lateral": 3e4, "ratio": 0.2},
        {"lateral": -8e4, "ratio": 0.42, "wind": (0.0, -20.0, 0.0)},
        {"ratio": 0.42},
    )
    found = figures_of(spatial(), *frames)
    force = found["tower: lateral rope force"]
    assert (force.value, force.unit, force.time, force.place) == (8e4, "N", 1.0, "wind 20.0 m/s to -90 deg")
    ratio = found["tower: lateral over normal force"]
    assert (ratio.value, ratio.limit, ratio.kept, ratio.time) == (0.42, 0.5, True, 1.0)
    assert "Nadal" in ratio.source
    assert "tower: derailed" not in found
    weak = spatial(towers={"tower": {**TOWERS["tower"], "derailment_ratio": 0.4}})
    ratio = figures_of(weak, *frames)["tower: lateral over normal force"]
    assert (ratio.kept, ratio.source) == (False, "scenario: towers.tower.derailment_ratio")


@pytest.mark.parametrize("roll", [0.0, 0.3, -0.3])
def test_clearance_to_a_mast_is_that_of_the_nearest_edge_in_plan(roll):
    """Mast of 1.2 m, 5 m to the left of a passing cabin, with either edge nearest."""
    one = spatial()
    # rolled to the left, its upper edge is nearest, else the lower one
    edge = WIDTH / 2.0 * math.cos(roll) + 1.5 * abs(math.sin(roll))
    figure = figures_of(one, {"place": 480.0}, {"place": 501.0, "roll": roll, "wind": (0.0, 10.0, 0.0)})
    clearance = figure["cabin: clearance to towers"]
    assert clearance.value == pytest.approx(5.0 - 0.6 - edge, abs=1e-9)
    assert (clearance.limit, clearance.bound, clearance.kept) == (0.5, "at least", True)
    assert clearance.place == "tower, wind 10.0 m/s to 90 deg"


def test_a_cabin_blown_towards_the_mast_passes_the_limit():
    clearance = figures_of(spatial(), {"y": 3.0})["cabin: clearance to towers"]
    assert clearance.value == pytest.approx(5.0 - 0.6 - 3.0 - WIDTH / 2.0)
    assert clearance.kept is False
    beside = spatial(towers={"tower": {**TOWERS["tower"], "mast_offset": -5.0}})
    assert figures_of(beside, {"y": 3.0})["cabin: clearance to towers"].kept is True


@pytest.mark.parametrize("roll", [0.0, 0.2])
def test_clearance_over_ground_that_leans(roll):
    """Ground rising from -80 m on the right over -60 m below the track to -50 m on the left: 1 in 1, then 2 in 1."""
    one = spatial(terrain=[[0.0, -60.0], [1000.0, -60.0]], terrain_sides=LEANING)
    found = figures_of(one, {"roll": roll})
    assert found["rope clearance over the terrain"].value == pytest.approx(20.0)
    # the corner below on the left, a half width and a half height off the centre, turned
    y = WIDTH / 2.0 * math.cos(roll) + 1.5 * math.sin(roll)
    z = -45.0 + WIDTH / 2.0 * math.sin(roll) - 1.5 * math.cos(roll)
    assert found["cabin: clearance over the terrain"].value == pytest.approx(z - (-60.0 + y), abs=1e-9)


def test_ground_without_sides_is_level_across_and_level_beyond_them():
    level = spatial(terrain=[[0.0, -60.0], [1000.0, -60.0]])
    assert figures_of(level, {"y": 300.0})["cabin: clearance over the terrain"].value == pytest.approx(60.0 - 46.5)
    leaning = spatial(terrain=[[0.0, -60.0], [1000.0, -60.0]], terrain_sides=LEANING)
    assert figures_of(leaning, {"y": -300.0})["cabin: clearance over the terrain"].value == pytest.approx(80.0 - 46.5)


def test_a_hill_beside_the_track_is_seen_between_the_points_of_the_rope():
    hill = {"distance": 10.0, "left": [[0.0, -60.0], [501.0, -60.0], [502.0, -42.0], [503.0, -60.0], [1000.0, -60.0]]}
    one = spatial(terrain=[[0.0, -60.0], [1000.0, -60.0]], terrain_sides={**hill, "right": hill["left"]})
    found = figures_of(one, {"place": 300.0, "y": 10.0})
    assert found["rope clearance over the terrain"].value == pytest.approx(20.0, abs=0.01)  # it runs over y = 0
    passing = figures_of(one, {"place": 501.5, "y": 10.0})["cabin: clearance over the terrain"]
    assert passing.value == pytest.approx(-46.5 + 42.0, abs=0.01)


def test_the_clearance_of_the_figures_is_that_of_the_simulation():
    one = spatial(terrain=[[0.0, -60.0], [1000.0, -60.0]], terrain_sides=LEANING, towers={}, solver={"step": 0.005})
    simulation, figures = Simulation(one), KeyFigures(one)
    lowest = math.inf
    for number in range(5):
        figures.update(simulation.advance_to(0.1 * number))
        lowest = min(lowest, simulation.clearance().vehicles["cabin"].height)
    assert gathered(figures)["cabin: clearance over the terrain"].value == pytest.approx(lowest, abs=1e-12)


def test_a_plane_has_no_rows_of_what_it_has_not():
    flat = scenario(towers={"tower": {"position": [500.0, -40.0]}}, terrain=[[0.0, -60.0], [1000.0, -60.0]])
    figures = KeyFigures(flat)
    figures.update(Simulation(flat).snapshot)
    names = " ".join(gathered(figures))
    assert "across" not in names
    assert "lateral" not in names
    assert "clearance to towers" not in names
    assert not any("wind" in figure.place for figure in figures.figures())
    layout = Layout.of(flat, 3)
    for name in ("roll", "tower_lateral"):
        assert len(SIGNALS[name].names(layout)) == 0
        assert SIGNALS[name].names(Layout.of(spatial(), 3))


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (
            {"terrain_sides": LEANING},
            "terrain_sides: given a mapping: without terrain; allowed: null; only with `terrain`, the profile",
        ),
        (
            {
                "terrain": [[0.0, -60.0], [1000.0, -60.0]],
                "terrain_sides": {**LEANING, "left": [[5.0, 1.0], [5.0, 2.0]]},
            },
            r"terrain_sides\.left\.1: given x = 5\.0 m after 5\.0 m; allowed: rising x, in m",
        ),
    ],
)
def test_profiles_that_do_not_go_together_are_refused(change, text):
    with pytest.raises(ValueError, match=text):
        spatial(**change)
