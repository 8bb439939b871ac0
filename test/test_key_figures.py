"""Key figures against closed forms, from prescribed motion and tension."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from prescribed_frames import (
    LENGTH,
    LIFT,
    PERIOD,
    SAG,
    TOWERS,
    WEIGHT,
    chairs,
    gathered,
    scenario,
    snapshot,
    supported,
    writable,
)
from small_tramway import TRAMWAY
from strands import one_strand

from cable_twin.basics.limited_yaml import read_yaml
from cable_twin.frame.plotted_signals import SIGNALS
from cable_twin.frame.records import AppliedCommand, Command
from cable_twin.key_figures import FigureId, KeyFigures, figure_from_values, not_judged, values_of
from cable_twin.key_figures.figure import Subject
from cable_twin.key_figures.figure import figure as key_figure
from cable_twin.key_figures.quantities import QUANTITIES, bound_of, limit_of
from cable_twin.mechanics.drives.joint_drive import SPEED
from cable_twin.mechanics.readout.columns import STOPPING
from cable_twin.offline.responses import Responses
from cable_twin.scenario import load_scenario
from cable_twin.scenario.builders.vehicles import stop_stroke
from cable_twin.scenario.files import config_directory
from cable_twin.scenario.sections.limits import KeyFigureLimits
from cable_twin.simulation import Simulation
from verification import JIT

needs_kernels = pytest.mark.skipif(not JIT, reason="minutes without compilation")


def drive(figures: KeyFigures, speed_at, duration: float, *, start=100.0, begin=0.0) -> float:
    """Move the carriage at a speed over time; place by the trapezoidal rule, exact for ramps."""
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


def test_tension_over_transverse_load_is_the_least_on_the_rope():
    figures = KeyFigures(scenario())
    for moment, place, ratio in ((0.0, 240.0, 11.0), (1.0, 250.0, 10.4), (2.0, 260.0, math.nan)):
        one = snapshot(moment, place=place)
        writable(one).tension_over_load[0] = ratio
        figures.update(one)
    lowest = gathered(figures)["cabin: tension over transverse load"]
    assert (lowest.value, lowest.time, lowest.place) == (10.4, 1.0, "arc length 250.0 m")
    assert lowest.kept is True


def test_acceleration_of_the_last_body_on_a_circle():
    figures = KeyFigures(scenario())
    radius, rate = 5.0, 0.7
    for frame in range(200):
        angle = rate * frame * PERIOD
        figures.update(snapshot(frame * PERIOD, body=radius * np.array([math.sin(angle), -math.cos(angle)])))
    found = gathered(figures)["cabin: vehicle acceleration"]
    # means over 0.2 s of means over 0.2 s leave the square of a sinc of it
    assert found.value == pytest.approx(radius * rate**2 * np.sinc(0.2 * rate / (2.0 * math.pi)) ** 2, rel=1e-6)
    assert found.kept is False
    assert "smoothed twice with a moving average over 0.2 s" in found.band


@pytest.mark.parametrize("period", [0.01, 0.02, 0.05, 0.1])
def test_an_acceleration_does_not_depend_on_how_often_one_looks(period):
    """Step of 1 m/s² in full after 0.4 s; shock of 1 m/s² for 10 ms as a twentieth."""
    figures = KeyFigures(scenario())
    for frame in range(round(3.0 / period)):
        moment = frame * period
        shock = 0.01 * max(moment - 2.495, 0.0)  # m, of 1 m/s² for 10 ms at 2.5 s
        figures.update(snapshot(moment, body=np.array([0.5 * max(moment - 1.0, 0.0) ** 2 + shock, 0.0])))
    found = gathered(figures)
    assert found["cabin: vehicle acceleration"].value == pytest.approx(1.045, rel=0.01)
    assert found["rope tension, highest"].band == f"samples taken every {period:g} s"


def test_shocks_are_those_of_the_mesh():
    figures = KeyFigures(scenario())
    for frame in range(300):
        figures.update(snapshot(frame * PERIOD, body=np.array([0.02 * max(frame * PERIOD - 1.0, 0.0), 0.0])))
    # 2 m/s² for 10 ms are a step of 0.02 m/s
    assert gathered(figures)["cabin: vehicle acceleration"].value == pytest.approx(0.02 / 0.2, rel=1e-6)


def test_a_reset_is_no_acceleration():
    figures = KeyFigures(scenario())
    for frame in range(100):
        figures.update(snapshot(frame * PERIOD, place=100.0))
    figures.command(AppliedCommand(99 * PERIOD, Command("reset", {}), "test"))
    for frame in range(100, 200):
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
    assert gathered(figures)["cabin: mean deceleration of the stop"].value == pytest.approx(1.2, abs=1e-6)
    for time, kind in ((14.0, "speed"), (15.0, "speed")):  # it stands from 10 s on
        figures.command(AppliedCommand(time, Command(kind, {"cabin": 3.0}), "test"))
    delay = gathered(figures)["cabin: delay of a restart"]
    assert (delay.value, delay.time) == (pytest.approx(4.0, abs=0.02), 14.0)


def test_a_passenger_swings_on_and_back_and_counts_until_told_to_move():
    """6 m/s, standstill after 15 m, swing of 0.8 m; frames of the next trip belong to no stop."""
    figures = KeyFigures(scenario())

    def sit(moment, way, speed):
        swing = 0.8 * np.sin(moment - 10.0) if moment > 10.0 else 0.0
        figures.update(snapshot(moment, place=way, speed=speed, body=(way + swing, 0.0)))

    for moment in np.arange(0.0, 5.001, PERIOD):
        sit(moment, 6.0 * moment, 6.0)
    figures.command(AppliedCommand(5.0, Command("emergency_stop", {}), "test"))
    for moment in np.arange(5.0 + PERIOD, 20.0, PERIOD):
        passed = min(moment - 5.0, 5.0)
        sit(moment, 30.0 + 6.0 * passed - 0.6 * passed**2, 6.0 - 1.2 * passed)
    name = "cabin: passenger's stopping distance"
    slopes = np.sqrt(1.0 + (4.0 * SAG / LENGTH * (1.0 - 2.0 * 45.0 / LENGTH)) ** 2)  # the rope falls there
    assert gathered(figures)[name].value == pytest.approx(15.8 / slopes, rel=2e-3)
    figures.command(AppliedCommand(20.0, Command("emergency_stop", {}), "test"))  # once more: it is one stop
    figures.command(AppliedCommand(20.0, Command("speed", {"cabin": 3.0}), "test"))
    sit(21.0, 100.0, 3.0)
    assert gathered(figures)[name].value == pytest.approx(15.8 / slopes, rel=2e-3)
    assert "cabin: stopping distance" in gathered(figures)


@pytest.mark.parametrize("creep", [True, False], ids=["creeps", "swings"])
def test_a_command_to_stop_what_only_creeps_or_swings_is_no_stop(creep):
    """Vehicle creeping at 0.05 m/s, or swinging so on its haul rope: the earlier stop counts."""
    figures = KeyFigures(scenario())
    drive(figures, lambda _: 6.0, 5.0)
    figures.command(AppliedCommand(5.0, Command("speed", {"cabin": 0.0}), "test"))
    drive(figures, lambda moment: max(6.0 - 1.2 * (moment - 5.0), 0.0), 6.0, start=130.0, begin=5.0)
    if creep:
        figures.command(AppliedCommand(11.5, Command("speed", {"cabin": 0.05}), "test"))
    drive(figures, lambda _: 0.05, 1.0, start=145.0, begin=11.5)
    figures.command(AppliedCommand(12.5, Command("speed", {"cabin": 0.0}), "test"))
    drive(figures, lambda _: 0.02, 1.0, start=145.05, begin=12.51)
    for name in ("stopping distance", "passenger's stopping distance"):
        assert gathered(figures)[f"cabin: {name}"].place.startswith("stop from 6.00 m/s")


def stop_at(figures: KeyFigures, begin: float, start: float, speed: float, deceleration: float) -> tuple[float, float]:
    """Run from standstill at a speed for 5 s, and an emergency stop from it; time and place of the standstill."""
    figures.command(AppliedCommand(begin, Command("speed", {"cabin": speed}), "test"))
    place = drive(figures, lambda _: speed, 5.0, start=start, begin=begin)
    figures.command(AppliedCommand(begin + 5.0, Command("emergency_stop", {}), "test"))
    begin, duration = begin + 5.0 + PERIOD, speed / deceleration + 1.0
    place = drive(figures, lambda at: max(speed - deceleration * (at - begin), 0.0), duration, start=place, begin=begin)
    return begin + duration + PERIOD, place


def test_of_several_stops_the_longest_counts_and_each_mean_deceleration():
    """Stops of 2.4, 1.0 and 2.0 m/s², the second one the longest, and a fourth that is not over."""
    figures = KeyFigures(scenario(limits__stopping_distance=40.0))
    moment, place = stop_at(figures, 0.0, 100.0, 6.0, 2.4)
    alone = gathered(figures)
    assert alone["cabin: mean deceleration of the stop"].value == pytest.approx(2.4, rel=0.01)
    assert "cabin: mean deceleration of the stop, highest" not in alone
    moment, place = stop_at(figures, moment, place, 8.0, 1.0)
    moment, place = stop_at(figures, moment, place, 4.0, 2.0)
    found = gathered(figures)
    stop = found["cabin: stopping distance"]
    assert stop.value == pytest.approx(32.0, rel=0.01)
    assert stop.place.startswith("emergency stop from 8.00 m/s")
    assert stop.kept is True
    passenger = found["cabin: passenger's stopping distance"]
    assert passenger.place.startswith("emergency stop from 8.00 m/s")
    decelerations = {"": 1.0, ", highest": 2.4, ", lowest": 1.0}
    for words, value in decelerations.items():
        assert found[f"cabin: mean deceleration of the stop{words}"].value == pytest.approx(value, rel=0.01)
    figures.command(AppliedCommand(moment, Command("speed", {"cabin": 3.0}), "test"))
    place = drive(figures, lambda _: 3.0, 1.0, start=place, begin=moment)
    figures.command(AppliedCommand(moment + 1.0, Command("emergency_stop", {}), "test"))
    drive(figures, lambda _: 2.5, 1.0, start=place, begin=moment + 1.0 + PERIOD)
    stop = gathered(figures)["cabin: stopping distance"]
    assert (stop.value, stop.unfinished, stop.kept) == (pytest.approx(32.0, rel=0.01), True, None)


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


@needs_kernels
def test_the_limits_of_a_drive_hold_at_the_drum_of_its_haul_rope():
    """A cabin bobs on its elastic rope: faster than the drum, as its brakes stop the drum backwards as well."""
    changes = {"carriages.cabin.drive.limits.power": 1.5e4, "carriages.cabin.drive.haul_rope.axial_stiffness": 5e4}
    simulation = Simulation(load_scenario(TRAMWAY, changes))
    figures, layout = KeyFigures(simulation.scenario), simulation.layout
    responses, rows = Responses(), []
    for speed in (6.0, 0.0):
        figures.command(simulation.command("cabin", speed=speed))
        for _ in range(400):
            snapshot = simulation.advance_to(simulation.time + PERIOD)
            figures.update(snapshot)
            responses.take(snapshot)
            c = snapshot.columns
            drum = float(c.haul_speed[0])
            assert SIGNALS["drive_power"].values(layout, c) == [c.drive_force[0] * drum]
            rows.append((float(c.speed[0]), drum, float(c.drive_force[0]) * drum))
    speeds, drums, powers = np.array(rows).T
    assert np.abs(speeds).max() > 1.005 * np.abs(drums).max()
    found = gathered(figures)
    assert (found["cabin: speed"].value, found["cabin: speed"].limit) == (np.abs(speeds).max(), None)
    assert (found["cabin: drive speed"].value, found["cabin: drive speed"].limit) == (np.abs(drums).max(), 6.0)
    assert found["cabin: drive speed"].kept is True
    power = found["cabin: drive power, highest"]
    assert (power.value, power.kept) == (powers.max(), True)
    assert found["cabin: drive power, lowest"].value == powers.min()
    work = responses.efforts["cabin"]
    assert work.driving == pytest.approx(np.maximum(powers[1:], 0.0).sum() * PERIOD)


def test_a_limit_is_kept_but_for_rounding():
    figures = KeyFigures(scenario())
    figures.update(snapshot(0.0, speed=10.000001))
    assert gathered(figures)["cabin: speed"].kept is True
    figures.update(snapshot(1.0, speed=10.001))
    assert gathered(figures)["cabin: speed"].kept is False


def test_amplification_is_over_the_tension_of_the_first_snapshot():
    figures = KeyFigures(scenario(limits__dynamic_amplification=1.2))
    for moment, tension in ((0.0, 1.0e6), (1.0, 1.3e6), (2.0, 0.7e6)):
        figures.update(snapshot(moment, tension=tension))
    found = gathered(figures)["dynamic amplification, tension over that at the start"]
    assert (found.value, found.time, found.kept) == (pytest.approx(1.3), 1.0, False)


def test_an_amplification_since_a_snapshot_says_so():
    """It is not judged, unless the tension at rest is known."""
    limited, found = scenario(limits__dynamic_amplification=1.2), []
    for rest in (None, snapshot(0.0, tension=0.9e6)):
        figures = KeyFigures(limited, rest)
        for moment, tension in ((40.0, 1.0e6), (41.0, 1.1e6)):
            figures.update(snapshot(moment, tension=tension))
        found.append(gathered(figures)["dynamic amplification, tension over that at the start"])
        told = [one.told() for one in not_judged(limited, figures.figures())]
        why = "the run begins in motion, and its tension at rest is not known"
        assert (f"not judged: limits.dynamic_amplification: {why}" in told) == (rest is None)
    assert found[0].place == "arc length 1000.0 m, over that at 40.00 s, where the run begins"
    assert [one.kept for one in found] == [None, False]
    assert (found[1].value, found[1].place) == (pytest.approx(1.1 / 0.9), "arc length 1000.0 m")


def test_sag_of_each_span_is_below_its_own_chord():
    """Parabola at most 10 m below the line of both towers, where parallel to the chord of its span."""
    heights = {x: -4.0 * SAG * x / LENGTH * (1.0 - x / LENGTH) for x in (0.0, 250.0, 600.0, LENGTH)}
    towers = {name: {"position": [x, heights[x]]} for name, x in (("lower", 250.0), ("upper", 600.0))}
    figures = KeyFigures(scenario(towers=towers))
    figures.update(supported(3.0))
    found = gathered(figures)
    for name, low, high in (("start to lower", 0, 250), ("lower to upper", 250, 600), ("upper to end", 600, 1000)):
        sag = found[f"sag below the chord, {name}"]
        assert sag.value == pytest.approx(SAG * ((high - low) / LENGTH) ** 2)  # w l^2 / 8 H
        assert sag.place == f"x {(low + high) / 2:.1f} m"


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
    rollers = [found[f"{name}: load of a roller, lowest"] for name in ("lower", "upper")]
    assert [(one.value, one.kept) for one in rollers] == [(2e5, True), (0.0, False)]
    assert (rollers[0].place, rollers[0].source[:7]) == ("one roller", "assumed")
    farthest, nearest = (found[f"end: counterweight travel, {which}"] for which in ("highest", "lowest"))
    assert (farthest.value, farthest.limit, farthest.kept, farthest.time) == (3.1, 3.0, False, 1.0)
    assert (nearest.value, nearest.limit, nearest.bound, nearest.kept) == (-1.0, -2.0, "at least", True)
    assert nearest.source == "scenario: cable.end.travel"
    assert "start: counterweight travel, highest" not in found


def test_a_tower_that_the_rope_never_touches_is_told():
    figures = KeyFigures(scenario(towers=TOWERS))
    for moment in (0.0, 1.0):
        one = supported(moment, loads=(2e5, 0.0), lowest=(2e5, 0.0))
        writable(one).tower_rest_load[3] = 0.0
        figures.update(one)
    margin = gathered(figures)["upper: deropement margin, load over that at rest"]
    assert (margin.value, margin.place, margin.kept) == (0.0, "does not touch", False)
    roller = gathered(figures)["upper: load of a roller, lowest"]
    assert (roller.value, roller.limit, roller.place, roller.kept) == (0.0, 500.0, "does not touch", False)
    assert gathered(figures)["lower: deropement margin, load over that at rest"].place == ""
    assert "end: deropement margin, load over that at rest" not in gathered(figures)


@pytest.mark.parametrize("name", ["aerial_tramway", "chairlift", "gondola", "single_span", "seed_example"])
def test_shipped_scenarios_start_within_their_limits(name):
    shipped = load_scenario(name)
    figures = KeyFigures(shipped)
    figures.update(Simulation(shipped).snapshot)
    assert [figure.name for figure in figures.figures() if figure.kept is False] == []


@pytest.mark.parametrize("name", ["aerial_tramway", "jig_back", "bicable", "chairlift", "gondola"])
def test_the_source_of_a_limit_is_a_key_of_the_file(name):
    """Formerly `drives.haul_rope.limits.speed`, where the file has `sheaves.drive.drive.limits.speed`."""
    content = read_yaml((config_directory() / f"{name}.yaml").read_text(encoding="utf-8")).content
    found = KeyFigures(load_scenario(name))
    found.update(Simulation(load_scenario(name)).snapshot)
    drives = [one for one in found.figures() if one.id.subject == "drives.haul_rope" and one.place]
    assert all(one.place == "rim travel 0.0 m" for one in drives)  # formerly `rope travel`, also of a rope that slips
    sources = {one.source for one in found.figures() if one.source.startswith("scenario: ")}
    assert any(".drive.limits.speed" in one for one in sources)
    for source in sources:
        part = content
        for key in re.match(r"scenario: ([\w.]+\w)", source)[1].split("."):
            part = part[key]  # KeyError without the key


def test_clearance_of_rope_and_vehicle_with_place():
    """Hill under a cabin with its lowest corner 1.5 m below its centre; level ground elsewhere."""
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


@pytest.mark.parametrize(
    ("limit", "uncertainty", "kept"),
    [
        (0.243, None, False),
        (0.2432, 5.1e-5, None),
        (0.2431913, None, True),
        (0.2433, 5.1e-5, True),
        (0.243, 5.1e-5, False),
    ],
)
def test_a_value_above_its_limit_does_not_keep_it_but_for_rounding(limit, uncertainty, kept):
    found = key_figure("swing", Subject("carriages.cabin", "cabin"), "highest", 0.2431913000001, 70.0).limited(
        limit, ""
    )
    found = replace(found, uncertainty=uncertainty)
    assert found.kept is kept
    assert found.verdict == {True: "kept", False: "not kept", None: "not decided"}[kept]


@pytest.mark.parametrize(("limit", "kept", "verdict"), [(100.0, None, "not decided"), (20.0, False, "not kept")])
def test_a_stop_that_is_not_over_at_the_end_decides_nothing_but_a_limit_that_it_has_passed(limit, kept, verdict):
    figures = KeyFigures(scenario(limits__stopping_distance=limit))
    drive(figures, lambda _: 6.0, 5.0)
    figures.command(AppliedCommand(5.0, Command("emergency_stop", {}), "test"))
    drive(figures, lambda _: 7.0, 5.0, start=130.0, begin=5.0 + PERIOD)
    found = gathered(figures)
    stop, passenger = found["cabin: stopping distance"], found["cabin: passenger's stopping distance"]
    assert stop.value == pytest.approx(35.0, rel=0.01)
    assert stop.place == "emergency stop from 6.00 m/s at 130.0 m, not over: still 7.00 m/s"
    assert (stop.unfinished, stop.kept, stop.verdict) == (True, kept, verdict)
    assert "cabin: mean deceleration of the stop" not in found
    assert figure_from_values(stop.name, values_of(stop)) == stop
    assert passenger.unfinished


def test_a_passengers_stop_that_counts_is_over_though_a_later_one_is_under_way():
    """Emergency stop to standstill, then a service stop that is under way at the end and does not count."""
    figures = KeyFigures(scenario())
    drive(figures, lambda _: 6.0, 5.0)
    figures.command(AppliedCommand(5.0, Command("emergency_stop", {}), "test"))
    drive(figures, lambda moment: max(6.0 - 1.2 * (moment - 5.0), 0.0), 6.0, start=130.0, begin=5.0)
    figures.command(AppliedCommand(11.5, Command("speed", {"cabin": 6.0}), "test"))
    drive(figures, lambda _: 6.0, 2.0, start=145.0, begin=11.5)
    figures.command(AppliedCommand(13.5, Command("speed", {"cabin": 0.0}), "test"))
    drive(figures, lambda _: 5.0, 4.0, start=157.0, begin=13.5 + PERIOD)
    passenger = gathered(figures)["cabin: passenger's stopping distance"]
    assert passenger.place.startswith("emergency stop from 6.00 m/s")
    assert not passenger.unfinished


@pytest.mark.parametrize(("means", "braked"), [("emergency_brake", True), ("drive", False)])
def test_the_force_of_brakes_is_not_judged_by_the_limits_of_the_drive(means, braked):
    own = scenario(
        carriages__cabin__drive__emergency_brake={"force": 2e5},
        carriages__cabin__drive__emergency_stop=[means],
    )
    figures = KeyFigures(own)
    for moment, kind, force in ((0.0, SPEED, 3e4), (1.0, STOPPING, -2e5)):
        one = snapshot(moment, speed=6.0, drive_force=force)
        writable(one).command_kind[0] = kind
        figures.update(one)
    found = gathered(figures)
    assert found["cabin: drive force"].value == (3e4 if braked else 2e5)
    assert found["cabin: drive force"].kept is braked
    assert ("cabin: brake force" in found) is braked
    if braked:
        assert found["cabin: brake force"].value == 2e5
        assert found["cabin: drive power, lowest"].value == 1.8e5


def test_a_carriage_that_runs_into_an_end_stop_is_told():
    figures = KeyFigures(scenario())
    end = scenario().cable.unstrained_length - stop_stroke(scenario(), scenario().carriages["cabin"])
    drive(figures, lambda _: 3.0, 20.0, start=end - 30.0)
    met = gathered(figures)["cabin: speed into an end stop"]
    assert (met.value, met.time) == (3.0, pytest.approx(10.0, abs=2.0 * PERIOD))
    figures = KeyFigures(scenario())
    drive(figures, lambda _: 3.0, 9.0, start=end - 30.0)
    assert "cabin: speed into an end stop" not in gathered(figures)


def test_limits_by_which_nothing_is_judged_are_told():
    bare = scenario(cable__breaking_force=None, limits__stopping_time=30.0)
    figures = KeyFigures(bare)
    figures.update(snapshot(0.0))
    assert [one.told() for one in not_judged(bare, figures.figures())] == [
        "not judged: limits.rope_safety_factor: cable.breaking_force is not given",
        "not judged: limits.stopping_time: the run has no such key figure",
    ]
    recorded = load_scenario(bare.resolved())  # with all defaults, those of space too, as a report reads it
    assert not_judged(recorded, figures.figures()) == not_judged(bare, figures.figures())
    strong = scenario(cable__breaking_force=4e6)
    figures = KeyFigures(strong)
    figures.update(snapshot(0.0))
    assert not_judged(strong, figures.figures()) == []


def test_a_payload_does_not_end_a_stop():
    figures = KeyFigures(scenario())
    figures.update(snapshot(0.0, speed=2.0, place=100.0))
    figures.command(AppliedCommand(0.0, Command("emergency_stop", {}), "test"))
    figures.command(AppliedCommand(0.5, Command("payload", {"cabin": 10.0}), "test"))
    figures.update(snapshot(1.0, place=101.0))
    assert gathered(figures)["cabin: stopping distance"].value == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("changes", "ratio", "factor"),
    [
        ({}, None, 4.5),
        ({"limits.tension_per_transverse_load": 10.0, "limits.rope_safety_factor": 3.15}, 10.0, 3.15),
        ({"limits.tension_per_transverse_load": 0, "limits.rope_safety_factor": 0}, None, None),
    ],
)
@pytest.mark.parametrize("lift", ["one strand", "both strands", "in space"])
def test_limits_that_a_lift_gives_hold_also_where_they_equal_those_of_track_ropes(lift, changes, ratio, factor):
    """Given limits of clamped chairs and moving ropes, which have other usual limits."""
    given = {"limits.rope_safety_factor": None, **changes} | ({"space": 3} if lift == "in space" else {})
    found = load_scenario(one_strand("chairlift") if lift == "one strand" else "chairlift", given)
    held = {key: limit_of(found, key, clamped=True) for key in ("tension_per_transverse_load", "rope_safety_factor")}
    assert [limit for limit, _ in held.values()] == [ratio, factor]
    assert not ratio or held["tension_per_transverse_load"][1] == "scenario: limits.tension_per_transverse_load"
    assert held["rope_safety_factor"][1].startswith("scenario" if factor == 3.15 else "EN 12927") or factor is None


def test_chairs_are_judged_by_a_ratio_that_their_scenario_gives():
    for given, judged, factor in (({}, None, 4.5), ({"tension_per_transverse_load": 10.0}, True, 3.15)):
        limits = {"rope_safety_factor": factor, **given}
        found = load_scenario("chairlift", {f"limits.{key}": limit for key, limit in limits.items()})
        figures = KeyFigures(found)
        figures.update(Simulation(found).snapshot)
        assert gathered(figures)["chair: tension over transverse load"].kept is judged
        assert gathered(figures)["up: rope safety factor"].limit == factor


def test_the_table_of_quantities_and_that_of_limits_agree():
    """Limit of each quantity on the side of its statistic, and a quantity for each limit."""
    limited = {row.limit: row for row in QUANTITIES.values() if row.limit}
    assert {key for key, row in limited.items() if row.limit_row.bound != bound_of(row.statistics[0])} == set()
    rules = {"profile", "installation", "load_cases"}
    haul_rope = "haul_rope_safety_factor"  # of rope_safety_factor, too
    assert {*KeyFigureLimits.model_fields} - rules == {*limited, haul_rope}


@pytest.mark.parametrize("changes", [{}, {"space": 3}], ids=["plane", "space"])
@pytest.mark.parametrize("name", ["aerial_tramway", "chairlift"], ids=["one rope", "several"])
def test_each_figure_has_an_identity_of_its_own(name, changes):
    found = load_scenario(name, changes)
    figures = KeyFigures(found)
    figures.update(Simulation(found).snapshot)
    identities = {figure.id: figure for figure in figures.figures()}
    assert len(identities) == len({figure.name for figure in figures.figures()}) == len(figures.figures())
    for identity, figure in identities.items():
        row = QUANTITIES[identity.quantity]
        assert (figure.unit, identity.statistic in row.statistics) == (row.unit, True)
        assert FigureId.of_text(str(identity)) == identity
    ropes = {one.subject for one in identities if one.quantity == "rope_tension"}
    assert ropes == {*(f"ropes.{rope}" for rope in found.cables), *map(found.haul_rope_key, found.haul_ropes)}
