"""Shipped jig-back: stops in stations, passing cabins, both ropes in all outputs."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import lsq_linear
from scipy.spatial.transform import Rotation
from test_scenario_faults import faults_of

from cable_twin.frame.records import CommandError
from cable_twin.key_figures import KeyFigures
from cable_twin.mechanics.readout.clearances import box_distance
from cable_twin.runtime.point_to_point import target_of
from cable_twin.scenario import ScenarioError, load_scenario
from cable_twin.simulation import Simulation
from verification import JIT

needs_kernels = pytest.mark.skipif(not JIT, reason="minutes without compilation")
ROPES = ("track_1", "track_2", "haul_1", "haul_2")
QUICK = {f"ropes.{rope}.elements": {"target": 40.0, "at_towers": 8.0, "growth": 1.6} for rope in ROPES}
SIDE_WIND = 12.0  # m/s
HALF = np.array([2.25, 1.2, 1.5])  # m, a cabin


def distance(centres, turns, halves) -> float:
    """Distance (m) of two boxes."""
    axes = np.array([turn.as_matrix() for turn in turns])
    return float(box_distance(np.array(centres), axes, np.array(halves, dtype=float), np.zeros((2, 8, 3))))


@pytest.mark.parametrize("seed", range(40))
def test_boxes_are_as_far_apart_as_least_squares_has_it(seed):
    """Bars, plates and boxes, some touching, some overlapping."""
    random = np.random.default_rng(seed)
    centres = random.normal(0.0, 2.0 if seed % 2 else 0.8, (2, 3))
    turns, halves = Rotation.random(2, random_state=seed), random.uniform(0.1, 1.5, (2, 3))
    halves[0, seed % 3] *= seed % 4 > 0
    between = np.hstack([turns[0].as_matrix(), -turns[1].as_matrix()])
    reach = np.maximum(halves.ravel(), 1e-9)
    best = lsq_linear(between, centres[1] - centres[0], (-reach, reach), method="bvls", tol=1e-14)
    expected = np.sqrt(2.0 * best.cost)
    assert distance(centres, turns, halves) == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("roll", [0.0, 0.1, 0.3])
def test_cabins_that_swing_across_come_as_near_as_their_corners(roll):
    """Cabins `low` m below ropes 9 m apart: swung to one side, and towards each other."""
    low, apart = 6.5, 9.0
    for other in (roll, -roll):
        turns = Rotation.from_euler("x", [[roll], [other]])  # swings to the left for roll > 0: the box is below
        centres = np.array([[0.0, -0.5 * apart, 0.0], [0.0, 0.5 * apart, 0.0]])
        centres += turns.apply([0.0, 0.0, -low])
        got = distance(centres, turns, [HALF, HALF])
        if other == roll:
            expected = apart * np.cos(roll) - 2.0 * HALF[1]
        else:
            expected = apart - 2.0 * ((low + HALF[2]) * np.sin(roll) + HALF[1] * np.cos(roll))
        assert got == pytest.approx(expected, abs=1e-12)


@pytest.fixture(scope="module")
def trip():
    """Whole trip in side wind on few elements: frames, key figures, and the twin at the end."""
    scenario = load_scenario("jig_back", QUICK | {"air.wind": [0.0, SIDE_WIND, 0.0]})
    simulation, figures, frames = Simulation(scenario), KeyFigures(scenario), []
    figures.command(simulation.command("haul_rope", speed=10.0))
    while simulation.time < 150.0:
        frames.append(simulation.advance_to(simulation.time + 0.1))
        figures.update(frames[-1])
    return simulation, frames, {figure.name: figure for figure in figures.figures()}


@needs_kernels
def test_the_drive_stops_both_cabins_in_their_stations(trip):
    simulation, frames, _ = trip
    scenario, last = simulation.scenario, frames[-1]
    _, high = scenario.drives["haul_rope"].travel
    drives = [frame.drives["haul_rope"] for frame in frames]
    assert sum(frame.solver.halvings for frame in frames) == 0
    assert max(drive.position for drive in drives) == pytest.approx(high, abs=1e-6)
    assert (drives[-1].position, drives[-1].speed) == pytest.approx((high, 0.0), abs=1e-6)
    speeds = np.array([drive.speed for drive in drives])
    assert speeds.max() == pytest.approx(10.0)
    assert np.abs(np.diff(speeds)).max() < 0.1 * 0.3 * (1.0 + 1e-6)  # m/s in a frame, of 0.3 m/s^2
    upper, lower = (last.carriages[name].arc_length for name in ("cabin_1", "cabin_2"))
    length = scenario.ropes["track_1"].unstrained_length
    assert 3.0 < length - upper < 25.0  # m: between the end stop and where its payload may change
    assert 3.0 < lower < 25.0


@needs_kernels
def test_the_haul_rope_is_back_on_its_rollers_when_a_cabin_has_passed_them(trip):
    _, frames, figures = trip
    assert [name for name in figures if name.endswith(": derailed")] == []
    least = [min(frame.supports[name].tower.normal_load for frame in frames) for name in ("rollers_1", "rollers_2")]
    assert least == [0.0, 0.0]  # lifted off while it passes
    for name in ("rollers_1", "rollers_2"):
        loads = [frames[number].supports[name].tower.normal_load for number in (0, -1)]
        assert loads[1] == pytest.approx(loads[0], rel=0.2)
    heights = [figures[f"{rope}: rope clearance over the terrain"] for rope in ROPES]
    assert [figure for figure in heights if not figure.kept] == []


@pytest.mark.long
@needs_kernels
def test_it_goes_back_and_stops_where_it_began(trip):
    simulation, *_ = trip
    there = simulation.capture()
    simulation.command("haul_rope", speed=-10.0)
    back = [simulation.advance_to(simulation.time + 0.1) for _ in range(1400)]
    assert min(frame.drives["haul_rope"].position for frame in back) == pytest.approx(0.0, abs=1e-6)
    assert back[-1].drives["haul_rope"].speed == 0.0
    simulation.restore(there)
    simulation.command("haul_rope", speed=-10.0)
    for frame in back[:50]:
        again = simulation.advance_to(frame.time).columns
        both = zip(again._fields, again, frame.columns, strict=True)
        assert [name for name, got, had in both if not np.array_equal(got, had, equal_nan=True)] == []
    simulation.restore(there)


@pytest.mark.long
@needs_kernels
def test_the_next_passengers_get_in_and_out_where_it_stands(trip):
    simulation, *_ = trip
    there = simulation.capture()
    simulation.payload("cabin_1", 0.0)
    simulation.payload("cabin_2", 6400.0)
    simulation.advance_to(simulation.time + 45.0)
    payloads = [simulation.snapshot.carriages[name].payload for name in ("cabin_1", "cabin_2")]
    assert payloads == pytest.approx([0.0, 6400.0])
    simulation.command("haul_rope", speed=-10.0)
    simulation.advance_to(simulation.time + 15.0)
    with pytest.raises(CommandError, match=r"payload of 'cabin_1': given at .* allowed: within 25 m of an end"):
        simulation.payload("cabin_1", 6400.0)
    simulation.restore(there)


@needs_kernels
def test_cabins_pass_each_other_half_way_as_near_as_the_wind_brings_them(trip):
    """Parallel cabins in side wind: 9 m between the ropes less roll of both and two half widths."""
    _, frames, figures = trip
    figure = figures["clearance between cabin_1 and cabin_2, least"]
    assert (figure.limit, figure.bound, figure.verdict) == (1.0, "at least", "kept")
    assert figure.place.startswith("cabin_1 at arc length 5")
    assert figure.place.endswith(f"wind {SIDE_WIND:.1f} m/s to 90 deg")
    nearest = min(frames, key=lambda frame: abs(frame.time - figure.time))
    cabins = [nearest.carriages[name].bodies["cabin"] for name in ("cabin_1", "cabin_2")]
    across = [cabin.position[1] for cabin in cabins]
    assert min(cabin.roll for cabin in cabins) * max(cabin.roll for cabin in cabins) > 0.0
    assert figure.value == pytest.approx(across[0] - across[1] - 2.4 * np.cos(cabins[0].roll), abs=0.3)
    assert figure.value < 6.6 - 0.01


@needs_kernels
def test_a_cabin_is_moved_by_its_haul_rope_alone(trip):
    simulation, *_ = trip
    with pytest.raises(CommandError, match="'cabin_1' is clamped to haul_1, which pulls it; allowed drives: haul_rope"):
        simulation.command("cabin_1", speed=1.0)


@pytest.mark.parametrize(("place", "metres"), [("400", 400.0), ("start", 0.0), ("end", 1012.0)])
def test_a_place_of_the_drive_is_rope_gone_by(place, metres):
    assert target_of(load_scenario("jig_back"), "haul_rope", place) == metres


@pytest.mark.parametrize("place", ["-1", "1012.5", "nan", "upper_station"])
def test_a_place_beyond_the_travel_of_the_drive_is_refused(place):
    with pytest.raises(ValueError, match=r"allowed: 0 to 1012 m of cable travel, or start, end"):
        target_of(load_scenario("jig_back"), "haul_rope", place)


@pytest.mark.parametrize("travel", [[5.0, 1.0], [1.0, 5.0], [0.0, 0.0], [-5.0, -1.0]])
def test_a_way_of_the_drive_has_the_start_in_it(travel):
    data = load_scenario("jig_back").resolved()
    data["drives"]["haul_rope"]["travel"] = travel
    with pytest.raises(ScenarioError, match=r"drives.haul_rope.travel: given .*; allowed: the least travel, then the"):
        load_scenario(data)


@pytest.mark.parametrize(
    ("travel", "cabin"), [([0.0, 1030.0], "cabin_2"), ([-20.0, 1012.0], "cabin_1"), ([-20.0, 2000.0], "cabin_1")]
)
def test_a_way_of_the_drive_ends_before_the_end_stops(travel, cabin):
    (fault,) = faults_of("jig_back", {"sheaves.drive.drive.travel": travel})
    said = f"given {travel} m: '{cabin}' would run into an end stop of its track; allowed: -11.00 to 1025."
    assert f"sheaves.drive.drive.travel: {said}" in fault


@pytest.mark.long
@needs_kernels
def test_a_rollback_brakes_cabins_too_at_the_same_step_always():
    """Full cabin up, drive lost, pulled back by the empty one's rope."""
    means = {f"carriages.cabin_{number}.drive.emergency_stop": ["track_rope_brake"] for number in (1, 2)}
    seen = []
    for period in (0.04, 0.5):
        simulation = Simulation(load_scenario("jig_back", {**QUICK, **means, "sheaves.drive.rollback": 0.5}), samples=2)
        simulation.command("haul_rope", speed=1.0)
        for number in range(1, round(8.0 / period) + 1):
            simulation.advance_to(number * period)
        simulation.command("haul_rope", force=0.0)
        while not simulation.emergency_stopped and simulation.time < 60.0:
            simulation.advance_to(simulation.time + period)
        simulation.advance_to(62.0)
        assert simulation.state.drives.braking.tolist() == [True, True]
        assert simulation.snapshot.drives["haul_rope"].speed == pytest.approx(0.0, abs=0.05)
        seen.append(simulation.snapshot.numbers.tobytes())
    assert seen[0] == seen[1]
