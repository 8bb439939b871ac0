"""Key figures against closed forms: motion and tension that are prescribed, so that every figure is known."""

from __future__ import annotations

import functools
import math
import time

import numpy as np
import pytest

from cable_twin.key_figures import KeyFigure, KeyFigures, figure_from_values, values_of
from cable_twin.records import AppliedCommand, Command, SolverReport
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation
from cable_twin.snapshot import ENDS, Layout, Snapshot

PERIOD = 0.01  # s
LENGTH, SAG = 1000.0, 40.0  # m, of a parabola between ends of one height


CABIN = {
    "arc_length": 60.0,
    "drive": {"mode": "speed", "limits": {"speed": 10.0, "force": 150e3, "power": 250e3}},
    "bodies": {"cabin": {"mass": 12e3, "inertia": 24e3, "upper_pivot": [0.0, 4.0], "size": [4.0, 3.0]}},
}
SCENARIO = {
    "cable": {
        "unstrained_length": 1003.0,
        "mass_per_length": 20.0,
        "axial_stiffness": 4e8,
        "bending_stiffness": 0.0,
        "elements": 10,
        "start": {"position": [0.0, 0.0]},
        "end": {"position": [1000.0, 0.0]},
    },
    "carriages": {"cabin": CABIN},
}
TOWERS = {"lower": {"position": [250.0, -20.0]}, "upper": {"position": [600.0, -30.0]}}
WEIGHT = {"support": "counterweight", "direction": [1.0, 0.0], "mass": 1e5, "travel": [-2.0, 3.0]}
LIFT = {
    **SCENARIO,
    "carriages": {},
    "drives": {"haul_rope": {"kind": "moving_cable", "limits": {"speed": 5.0}}},
    "carriers": {"name": "chair", "count": 3, "spacing": 500.0, "bodies": CABIN["bodies"]},
}


def scenario(**overrides):
    return load_scenario(SCENARIO, {key.replace("__", "."): value for key, value in overrides.items()})


@functools.cache
def layout(vehicles, towers, drives) -> Layout:
    x = np.linspace(0.0, LENGTH, 201)
    return Layout(dict.fromkeys(vehicles, ("cabin",)), (*ENDS, *towers), drives, x)


def frame(moment: float, vehicles=("cabin",), towers=(), drives=(), *, tension=1e6) -> Snapshot:
    """The rope and nothing else: what is not filled in is NaN, which is no value."""
    shape = layout(vehicles, towers, drives)
    one = Snapshot(shape, np.full(shape.size, math.nan), SolverReport(1, 1, 0, 0.0))
    columns, x = one.columns, shape.arc_lengths
    columns.time[0] = moment
    columns.rope_position[:] = np.column_stack([x, 0.0 * x, height(x)])
    columns.rope_tension[:] = tension * (1.0 + 0.1 * x / LENGTH)  # highest at the end, lowest at the start
    return one


def height(x):
    return -4.0 * SAG * x / LENGTH * (1.0 - x / LENGTH)


def put(
    one: Snapshot, row=0, *, place=500.0, speed=0.0, drive_force=0.0, pitch=0.0, body=None, weight=1e5, attached=1.0
) -> None:
    """Hang a vehicle into a frame."""
    c = one.columns
    c.arc_length[row], c.speed[row], c.drive_force[row] = place, speed, drive_force
    c.contact_force[row] = 0.0, 0.0, weight
    c.attached[row] = attached
    c.body_position[row] = (place, 0.0, height(min(place, LENGTH)) - 5.0) if body is None else (body[0], 0.0, body[1])
    c.body_angles[row] = 0.0, pitch, 0.0


def snapshot(moment: float, *, tension=1e6, **vehicle) -> Snapshot:
    one = frame(moment, tension=tension)
    put(one, **vehicle)
    return one


def gathered(figures: KeyFigures) -> dict[str, object]:
    return {figure.name: figure for figure in figures.figures()}


def drive(figures: KeyFigures, speed_at, duration: float, *, start=100.0, begin=0.0) -> float:
    """Move the carriage with a speed over time, place by the trapezoidal rule, which is exact for ramps."""
    place = start
    for frame in range(round(duration / PERIOD) + 1):
        moment = begin + frame * PERIOD
        if frame:
            place += 0.5 * PERIOD * (speed_at(moment) + speed_at(moment - PERIOD))
        figures.update(snapshot(moment, place=place, speed=speed_at(moment)))
    return place


def test_tension_sag_and_safety_factor_with_place_and_time():
    figures = KeyFigures(scenario(cable__breaking_force=4.0e6))
    figures.update(snapshot(0.0, tension=1.0e6))
    figures.update(snapshot(1.0, tension=1.2e6))
    figures.update(snapshot(2.0, tension=0.9e6))
    found = gathered(figures)
    highest = found["rope tension, highest"]
    assert (highest.value, highest.time, highest.place) == (pytest.approx(1.32e6), 1.0, "arc length 1000.0 m")
    assert found["rope tension, lowest"].value == pytest.approx(0.9e6)
    assert found["sag below the chord"].value == pytest.approx(SAG)
    assert found["sag below the chord"].place == "x 500.0 m"
    factor = found["rope safety factor"]
    assert factor.value == pytest.approx(4.0e6 / 1.32e6)
    assert (factor.limit, factor.bound, factor.kept) == (3.15, "at least", False)
    assert "EN 12927" in factor.source


def test_no_safety_factor_without_breaking_force():
    figures = KeyFigures(scenario(cable__breaking_force=None))
    figures.update(snapshot(0.0))
    assert "rope safety factor" not in gathered(figures)


def test_tension_over_transverse_load_takes_the_part_across_the_rope():
    figures = KeyFigures(scenario())
    figures.update(snapshot(0.0, place=250.0, weight=1e5, tension=1e6))
    # sampled every 5 m: the chord from 245 to 255 m is the tangent of the parabola at 250 m
    across = 1e5 * math.cos(math.atan(4.0 * SAG / LENGTH * (1.0 - 2.0 * 0.25)))
    ratio = gathered(figures)["cabin: tension over transverse load"]
    assert ratio.value == pytest.approx(1.025e6 / across, rel=1e-6)
    assert ratio.kept is True


def test_acceleration_of_the_last_body_on_a_circle():
    figures = KeyFigures(scenario())
    radius, rate = 5.0, 0.7
    for frame in range(200):
        angle = rate * frame * PERIOD
        figures.update(snapshot(frame * PERIOD, body=radius * np.array([math.sin(angle), -math.cos(angle)])))
    found = gathered(figures)["cabin: vehicle acceleration"]
    assert found.value == pytest.approx(radius * rate**2, rel=1e-4)
    assert found.kept is False


def test_a_reset_is_no_acceleration():
    figures = KeyFigures(scenario())
    for frame in range(10):
        figures.update(snapshot(frame * PERIOD, place=100.0))
    figures.command(AppliedCommand(9 * PERIOD, Command("reset", {}), "test"))
    for frame in range(10, 20):
        figures.update(snapshot(frame * PERIOD, place=300.0))
    assert gathered(figures)["cabin: vehicle acceleration"].value == pytest.approx(0.0, abs=1e-6)


def test_stopping_distance_is_half_the_square_of_speed_over_deceleration():
    figures = KeyFigures(scenario(limits__stopping_distance=20.0))
    drive(figures, lambda _: 6.0, 5.0)
    figures.command(AppliedCommand(5.0, Command("emergency_stop", {}), "test"))
    drive(figures, lambda moment: max(6.0 - 1.2 * (moment - 5.0), 0.0), 8.0, start=130.0, begin=5.0)
    stop = gathered(figures)["cabin: stopping distance"]
    assert stop.value == pytest.approx(6.0**2 / (2.0 * 1.2), abs=1e-6)
    assert stop.place == "emergency stop from 6.00 m/s at 130.0 m"
    duration = gathered(figures)["cabin: stopping time"]
    assert (duration.value, duration.unit, duration.limit) == (pytest.approx(5.0, abs=1e-6), "s", None)
    assert (stop.time, stop.limit, stop.source, stop.kept) == (5.0, 20.0, "scenario: limits.stopping_distance", True)


def test_stopping_distance_counts_from_the_command_also_between_frames():
    figures = KeyFigures(scenario())
    drive(figures, lambda _: 6.0, 5.0)
    figures.command(AppliedCommand(5.0 + 0.4 * PERIOD, Command("emergency_stop", {}), "test"))
    place = 130.0 + 0.4 * PERIOD * 6.0
    figures.update(snapshot(10.0, place=place + 15.0, speed=0.0))
    stop = gathered(figures)["cabin: stopping distance"]
    assert stop.value == pytest.approx(15.0)
    assert stop.time == 5.0 + 0.4 * PERIOD


def test_a_stop_that_is_taken_back_does_not_count():
    figures = KeyFigures(scenario())
    drive(figures, lambda _: 6.0, 1.0)
    figures.command(AppliedCommand(1.0, Command("speed", {"cabin": 0.0}), "test"))
    drive(figures, lambda _: 4.0, 1.0, begin=1.01)
    figures.command(AppliedCommand(2.0, Command("speed", {"cabin": 6.0}), "test"))
    drive(figures, lambda _: 0.0, 1.0, begin=2.02)
    assert "cabin: stopping distance" not in gathered(figures)


def test_drive_and_swing_against_the_limits_of_the_scenario():
    figures = KeyFigures(scenario())
    figures.update(snapshot(0.0, speed=-8.0, drive_force=4e4, pitch=-0.2))
    figures.update(snapshot(1.0, speed=10.5, drive_force=2e4, pitch=0.4))
    found = gathered(figures)
    assert found["cabin: speed"].value == 10.5
    assert found["cabin: speed"].kept is False
    assert found["cabin: speed"].source == "scenario: carriages.cabin.drive.limits.speed"
    assert found["cabin: drive force"].value == 4e4
    assert found["cabin: drive force"].kept is True
    assert found["cabin: drive power, highest"].value == pytest.approx(2.1e5)
    assert found["cabin: drive power, highest"].kept is True
    braking = found["cabin: drive power, lowest"]
    assert (braking.value, braking.limit, braking.bound, braking.kept) == (-3.2e5, -2.5e5, "at least", False)
    assert (found["cabin: swing along the track"].value, found["cabin: swing along the track"].kept) == (0.4, False)


def test_a_limit_is_kept_to_a_thousandth_of_it():
    """As a drive keeps its speed."""
    figures = KeyFigures(scenario())
    figures.update(snapshot(0.0, speed=10.001))
    assert gathered(figures)["cabin: speed"].kept is True
    figures.update(snapshot(1.0, speed=10.02))
    assert gathered(figures)["cabin: speed"].kept is False


def test_amplification_is_over_the_tension_of_the_first_snapshot():
    figures = KeyFigures(scenario(limits__dynamic_amplification=1.2))
    for moment, tension in ((0.0, 1.0e6), (1.0, 1.3e6), (2.0, 0.7e6)):
        figures.update(snapshot(moment, tension=tension))
    found = gathered(figures)["dynamic amplification, tension over that at the start"]
    assert (found.value, found.time, found.kept) == (pytest.approx(1.3), 1.0, False)


def test_sag_of_each_span_is_below_its_own_chord():
    """The parabola runs 10 m below both towers' line at most where the chord of its span is parallel to it."""
    heights = {x: -4.0 * SAG * x / LENGTH * (1.0 - x / LENGTH) for x in (0.0, 250.0, 600.0, LENGTH)}
    towers = {name: {"position": [x, heights[x]]} for name, x in (("lower", 250.0), ("upper", 600.0))}
    figures = KeyFigures(scenario(towers=towers))
    figures.update(supported(3.0))
    found = gathered(figures)
    for name, low, high in (("start to lower", 0, 250), ("lower to upper", 250, 600), ("upper to end", 600, 1000)):
        sag = found[f"sag below the chord, {name}"]
        assert sag.value == pytest.approx(SAG * ((high - low) / LENGTH) ** 2)  # w l^2 / 8 H
        assert sag.place == f"x {(low + high) / 2:.1f} m"


def supported(moment: float, *, loads=(2e5, 2e5), lowest=(2e5, 2e5), travel=math.nan) -> Snapshot:
    one = frame(moment, towers=("lower", "upper"))
    columns = one.columns
    columns.support_force[:] = [(-9e5, 0.0, 1e5), (9e5, 0.0, 1e5), *((0.0, 0.0, load) for load in loads)]
    columns.support_travel[1] = travel
    columns.tower_load[2:], columns.tower_lowest_load[2:], columns.tower_rest_load[2:] = loads, lowest, 2e5
    return one


def test_support_loads_margins_and_travel_against_their_limits():
    figures = KeyFigures(scenario(towers=TOWERS, cable__end={"position": [1000.0, 0.0], **WEIGHT}))
    figures.update(supported(0.0, travel=0.5))
    figures.update(supported(1.0, loads=(3e5, 1e5), lowest=(2e5, 0.9e5), travel=3.1))
    figures.update(supported(2.0, loads=(2e5, 0.0), lowest=(2e5, 0.0), travel=-1.0))
    found = gathered(figures)
    assert (found["lower: support load, highest"].value, found["lower: support load, highest"].time) == (3e5, 1.0)
    assert (found["upper: support load, lowest"].value, found["upper: support load, lowest"].time) == (0.0, 2.0)
    margins = [found[f"{name}: deropement margin, load over that at rest"] for name in ("lower", "upper")]
    assert [(margin.value, margin.kept) for margin in margins] == [(1.0, True), (0.0, False)]
    assert "lifts off" in margins[0].source
    farthest, nearest = (found[f"end: counterweight travel, {which}"] for which in ("highest", "lowest"))
    assert (farthest.value, farthest.limit, farthest.kept, farthest.time) == (3.1, 3.0, False, 1.0)
    assert (nearest.value, nearest.limit, nearest.bound, nearest.kept) == (-1.0, -2.0, "at least", True)
    assert nearest.source == "scenario: cable.end.travel"
    assert "start: counterweight travel, highest" not in found


def test_clearance_of_rope_and_vehicle_with_place():
    """A hill under the cabin, whose lowest corner is 1.5 m below its centre; and level ground elsewhere."""
    terrain = [[0.0, -60.0], [490.0, -60.0], [500.0, -52.0], [510.0, -60.0], [1000.0, -60.0]]
    figures = KeyFigures(scenario(terrain=terrain, limits__vehicle_clearance=6.0))
    figures.update(snapshot(0.0, place=300.0))
    figures.update(snapshot(1.0, place=500.0))  # its centre 5 m below the rope, which is at -40 m
    found = gathered(figures)
    vehicle = found["cabin: clearance over the terrain"]
    assert vehicle.value == pytest.approx(-40.0 - 5.0 - 1.5 + 52.0)
    assert (vehicle.place, vehicle.time, vehicle.limit, vehicle.kept) == ("x 500.0 m", 1.0, 6.0, False)
    rope = found["rope clearance over the terrain"]
    assert (rope.value, rope.place, rope.kept) == (pytest.approx(12.0), "x 500.0 m", True)


def chairs(moment: float, *, speed: float, force: float, swings: tuple[float, ...], gone=None) -> Snapshot:
    """Chairs at 100, 300 and, off the cable, at its end."""
    one = frame(moment, ("chair_1", "chair_2", "chair_3"), drives=("haul_rope",))
    for row, place, swing in zip(range(3), (100.0, 300.0, 1003.0), swings, strict=True):
        put(one, row, place=place, speed=speed, pitch=swing, attached=float(row < 2))
    columns = one.columns
    columns.drive_position[0], columns.drive_speed[0] = moment * speed if gone is None else gone, speed
    columns.moving_cable_force[0] = force
    return one


def test_carriers_share_the_figures_of_the_worst_and_those_off_the_cable_do_not_count():
    figures = KeyFigures(load_scenario(LIFT, {"cable.breaking_force": 4e6}))
    figures.update(chairs(0.0, speed=0.0, force=0.0, swings=(0.1, 0.2, 0.9)))
    figures.update(chairs(1.0, speed=5.0, force=3e4, swings=(0.1, 0.4, 0.0)))
    found = gathered(figures)
    swing = found["chair: swing along the track"]
    assert (swing.value, swing.place, swing.time, swing.kept) == (0.4, "chair_2, arc length 300.0 m", 1.0, False)
    assert not any(name.startswith("chair_") for name in found)
    assert found["chair: contact force"].place == "chair_2, arc length 300.0 m"  # chair_1 is on the element at the end
    power = found["haul_rope: drive power, highest"]
    assert (power.value, power.limit, power.kept) == (1.5e5, None, None)
    assert found["haul_rope: speed"].kept is True
    assert found["rope safety factor"].limit == 4.5


def test_the_stop_of_a_moving_cable():
    figures = KeyFigures(load_scenario(LIFT))
    figures.update(chairs(1.0, speed=5.0, force=0.0, swings=(0.0, 0.0, 0.0)))
    figures.command(AppliedCommand(1.0, Command("emergency_stop", {}), "test"))
    figures.update(chairs(5.0, speed=0.0, force=0.0, swings=(0.0, 0.0, 0.0), gone=15.0))
    found = gathered(figures)
    assert (found["haul_rope: stopping distance"].value, found["haul_rope: stopping time"].value) == (10.0, 4.0)


def test_a_payload_does_not_end_a_stop():
    figures = KeyFigures(scenario())
    figures.update(snapshot(0.0, speed=2.0, place=100.0))
    figures.command(AppliedCommand(0.0, Command("emergency_stop", {}), "test"))
    figures.command(AppliedCommand(0.5, Command("payload", {"cabin": 10.0}), "test"))
    figures.update(snapshot(1.0, place=101.0))
    assert gathered(figures)["cabin: stopping distance"].value == pytest.approx(1.0)


def test_what_a_log_does_not_hold_is_no_value():
    """Nothing of NaN passes into figures, or takes the place of one."""
    figures = KeyFigures(scenario(terrain=[[0.0, -60.0], [1000.0, -60.0]]))
    figures.update(frame(0.0, tension=math.nan))
    names = set(gathered(figures))
    assert names == {"sag below the chord", "rope clearance over the terrain"}
    figures.command(AppliedCommand(0.0, Command("emergency_stop", {}), "test"))  # from nobody knows where
    figures.update(snapshot(1.0, speed=3.0, pitch=0.1))
    before = gathered(figures)
    assert before["dynamic amplification, tension over that at the start"].value == 1.0
    assert before["cabin: clearance over the terrain"].value == pytest.approx(60.0 - 40.0 - 5.0 - 1.5, abs=0.3)
    for moment in (2.0, 3.0):
        nothing = frame(moment)
        nothing.numbers[1:] = math.nan
        figures.update(nothing)
    assert gathered(figures) == before


def test_frames_of_another_scenario_are_refused():
    with pytest.raises(ValueError, match="another scenario"):
        KeyFigures(scenario()).update(supported(0.0))


def test_a_span_without_a_point_takes_the_next_one():
    """Two towers between two points of the rope, and one beyond a point to the digit."""
    places = {"a": 251.0, "b": 253.0, "c": 600.0}
    towers = {name: {"position": [x, height(x)]} for name, x in places.items()}
    figures = KeyFigures(scenario(towers=towers))
    figures.update(frame(0.0, towers=tuple(places)))
    found = gathered(figures)
    assert found["sag below the chord, a to b"].place == "x 255.0 m"
    assert found["sag below the chord, b to c"].value == pytest.approx(SAG * (347.0 / LENGTH) ** 2, rel=1e-3)


@pytest.mark.parametrize("limit", [None, 0.1 + 0.2])
def test_a_figure_comes_back_from_what_is_told_to_the_last_bit(limit):
    figure = KeyFigure("cabin: swing", 1.0 / 3.0, "rad", 0.1 + 0.7, "arc length 1.0 m", limit, "at least", "scenario")
    figure = figure if limit is not None else KeyFigure("cabin: swing", -1.0 / 3.0, "rad", 2.0)
    values = values_of(figure)
    assert all(isinstance(value, str) for value in values.values())
    assert figure_from_values("cabin: swing", values) == figure


@pytest.mark.parametrize(
    ("change", "message"),
    [({"value": "much"}, "could not convert"), ({"bound": "about"}, "bound 'about'"), ({"unit": None}, "unit is miss")],
)
def test_values_that_are_no_figure_are_refused(change, message):
    values = values_of(KeyFigure("swing", 0.1, "rad", 1.0, limit=0.2)) | change
    with pytest.raises(ValueError, match=f"key figure 'swing': {message}"):
        figure_from_values("swing", {key: value for key, value in values.items() if value is not None})


def test_an_update_costs_little_and_keeps_nothing():
    """Live use: well under a hundredth of a frame of 10 ms, on a machine that others use too."""
    figures = KeyFigures(scenario())
    frames = [snapshot(number * PERIOD, place=100.0 + number) for number in range(200)]
    costs = []
    for one in frames:
        started = time.perf_counter()
        figures.update(one)
        costs.append(time.perf_counter() - started)
    assert np.median(costs) < 1e-4


def test_the_clearance_of_the_figures_is_that_of_the_simulation():
    """On a turned outline over a ground with corners; the figures see the rope at fewer points."""
    ground = [[-10.0, -70.0], [55.0, -10.0], [60.0, -11.0], [300.0, -60.0], [1000.0, -60.0]]
    tilted = scenario(terrain=ground, carriages__cabin__arc_length=57.0)
    simulation, figures = Simulation(tilted), KeyFigures(tilted)
    simulation.wind(12.0)
    lowest = math.inf
    for number in range(10):
        figures.update(simulation.advance_to(0.1 * number))
        lowest = min(lowest, simulation.clearance().vehicles["cabin"].height)
    assert gathered(figures)["cabin: clearance over the terrain"].value == pytest.approx(lowest, abs=1e-12)
