"""Shipped ropeways: start, run, limits of their key figures, and force balance of drives."""

import re
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from cable_twin.key_figures import KeyFigures
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation
from verification import JIT

pytestmark = pytest.mark.skipif(not JIT, reason="minutes without compilation")

SPEEDS = {
    "aerial_tramway": ("cabin", 5.0),
    "windy_tramway": ("cabin", 5.0),
    "chairlift": ("haul_rope", 2.5),
    "gondola": ("haul_rope", 6.0),
    "jig_back": ("haul_rope", 5.0),
    "bicable": ("haul_rope", 6.0),
}
PAGE = Path(__file__).resolve().parents[1] / "docs" / "scenarios.md"
KEPT = ("rope safety factor", "tension over transverse load", "swing along the track", "drive force")


OF_SEVERAL_ROPES = {"jig_back", "bicable"}  # with tests of their own in files of their own


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.long if name in OF_SEVERAL_ROPES else ()) for name in SPEEDS]
)
def test_it_runs_and_keeps_its_limits(name):
    scenario = load_scenario(name)
    simulation, figures = Simulation(scenario), KeyFigures(scenario)
    target, speed = SPEEDS[name]
    figures.command(simulation.command(target, speed=speed))
    halvings, lowest = 0, np.inf
    for frame in range(300):
        snapshot = simulation.advance_to(0.1 * (frame + 1))
        figures.update(snapshot)
        halvings += snapshot.solver.halvings
        assert snapshot.solver.constraint_residual < max(5e-7, scenario.solver.tolerance)  # tramways yield by 60 mm
        if frame % 10 == 0 and scenario.terrain:
            clearance = simulation.clearance()
            lowest = min(lowest, clearance.rope.height, *(place.height for place in clearance.vehicles.values()))
            assert clearance.rope in clearance.ropes.values()
            assert set(clearance.vehicles) == {name for name, one in snapshot.carriages.items() if one.attached}
    assert halvings == 0
    assert lowest > 0.2  # m, and that in the stations
    found = figures.figures()
    limited = [figure for figure in found if figure.limit is not None and figure.name.endswith(KEPT)]
    rolls = scenario.carriers is None or bool(scenario.carriers.tracks)  # on a track rope, whose limit it is
    clamped = not rolls and any(one.joint == "clamped" for one in scenario.vehicles.values())
    expected = {*KEPT[:3]} - ({"tension over transverse load"} if clamped else set())
    assert expected == {*KEPT[:3]} & {figure.name.split(": ")[-1] for figure in limited}
    assert [figure for figure in limited if not figure.kept] == []
    for support in snapshot.supports.values():
        if support.tower is not None:
            assert support.tower.lowest_load > 0.5 * support.tower.rest_load
    if scenario.sheaves:
        travel, (low, high) = snapshot.columns.sheave_travel[1], scenario.sheaves["return"].counterweight.travel
        assert np.abs(snapshot.columns.sheave_slip).max() < 1e-3
        values = {figure.name: figure for figure in found}
        assert values["drive: adhesion used of available"].value < 0.6
        if scenario.carriers:
            loads = [one.value for name, one in values.items() if "load of carriers" in name and one.value > 0.0]
            assert loads[0] > 1.5 * loads[1]  # full up, empty down
    else:
        travel, (low, high) = snapshot.supports["start"].travel, scenario.cable.start.travel
    assert low < travel < high
    moving = snapshot.drives[target].speed if scenario.drives else snapshot.carriages[target].speed
    assert moving == pytest.approx(speed, abs=0.05)


def test_the_drive_of_a_bare_line_takes_the_friction_of_all_towers():
    """Drive force of Σ μ N over the towers of both strands, whose weights balance."""
    bare = {"carriers": None, "ropes.up.damping_time": 0.05, "ropes.down.damping_time": 0.05}
    simulation = Simulation(load_scenario("chairlift", bare))
    simulation.command("haul_rope", speed=2.5)
    simulation.advance_to(60.0)
    drives, friction, ends = [], [], []
    for frame in range(200):
        snapshot = simulation.advance_to(60.0 + 0.1 * frame)
        drives.append(snapshot.drives["haul_rope"].force)
        friction.append(sum(0.03 * s.tower.normal_load for s in snapshot.supports.values() if s.tower is not None))
        on, off = snapshot.columns.sheave_tension[0]
        ends.append(on - off)
    assert np.mean(drives) == pytest.approx(np.mean(friction), rel=5e-3)
    assert np.mean(drives) == pytest.approx(np.mean(ends), rel=2e-2)


def test_an_emergency_stop_of_the_whole_lift_has_its_way_and_time():
    """From 2.5 m/s with 1.2 m/s²: 2.08 s and 2.60 m of the rim, and one figure for the chairs of both strands."""
    scenario = load_scenario("chairlift", {"drives.haul_rope.speed": 2.5})
    simulation, figures = Simulation(scenario), KeyFigures(scenario)
    figures.update(simulation.snapshot)
    figures.command(simulation.emergency_stop())
    for frame in range(1, 61):
        figures.update(simulation.advance_to(0.05 * frame))
    names = [figure.name for figure in figures.figures()]
    assert len(set(names)) == len(names)
    found = {figure.name: figure for figure in figures.figures()}
    assert found["haul_rope: stopping time"].value == pytest.approx(2.5 / 1.2, abs=0.06)
    assert found["haul_rope: stopping distance"].value == pytest.approx(0.5 * 2.5**2 / 1.2, rel=0.02)
    assert "of the rim" in found["haul_rope: stopping distance"].place
    chair, duration = found["chair: stopping distance"], found["chair: stopping time"]
    assert chair.place.startswith("chair_")  # the one that goes on farthest: the rope gives way
    assert 2.62 < chair.value < 3.2
    seat = found["chair: passenger's stopping distance"]
    assert chair.value + 0.2 < seat.value < 4.0
    assert seat.place.startswith("chair_")
    assert seat.place.endswith("its load along the rope, swing included")
    assert duration.value == pytest.approx(2.5 / 1.2, abs=0.3)
    assert found["haul_rope: drive power, lowest"].value < 0.0
    torque, force = found["drive: drive torque, highest"], found["haul_rope: drive force"]
    assert torque.value == pytest.approx(2.1 * force.value)
    on, off = (found[f"drive: tension of '{rope}', highest"] for rope in ("up", "down"))
    assert min(on.value, off.value) > 1.5e5
    assert (found["up: rope safety factor"].limit, found["down: rope safety factor"].limit) == (4.5, 4.5)
    assert found["drive: adhesion used of available"].kept
    assert found["chair: swing along the track"].place.startswith(("up: chair_", "down: chair_"))


def test_a_chair_passes_a_tower_smoothly():
    simulation = Simulation(load_scenario("chairlift"))
    simulation.command("haul_rope", speed=2.5)
    simulation.advance_to(25.0)
    places, loads = [], []
    for frame in range(500):  # chair_4 from 250 to 300 m, over the tower at 296 m
        chair = simulation.advance_to(25.0 + 0.05 * frame).carriages["chair_4"]
        body = chair.bodies["chair"]
        places.append((chair.arc_length, body.x, body.z))
        loads.append(float(chair.contact_force[-1]))
    arc = np.array([place[0] for place in places])
    assert arc[0] < 285.0
    assert arc[-1] > 305.0
    assert all(after > before for before, after in pairwise(arc))
    accelerations = np.linalg.norm(np.diff([place[1:] for place in places], 2, axis=0), axis=1) / 0.05**2
    assert accelerations.max() < 1.65  # m/s²; 1.53 on a mesh twice as fine
    weight = 550.0 * 9.81
    assert 0.8 * weight < min(loads) < max(loads) < 1.2 * weight


ACROSS = {  # what the tramway in space has that the one in its plane has not
    *("name", "description", "space"),
    *("cable.start.position", "cable.start.direction", "cable.end.position"),
    *("towers.tower.position", "towers.tower.groove", "air.wind"),
    *(f"carriages.cabin.bodies.{body}.inertia_tensor" for body in ("running_carriage", "hanger", "cabin")),
    *("carriages.cabin.bodies.running_carriage.roll_damping", "carriages.cabin.bodies.hanger.damping"),
    *("carriages.cabin.bodies.hanger.drag_area", "carriages.cabin.bodies.cabin.drag_area"),
}


def leaves(data, path=""):
    """Values by dotted key."""
    if not isinstance(data, dict):
        return {path: data}
    return {
        key: value for name, item in data.items() for key, value in leaves(item, f"{path}.{name}".strip(".")).items()
    }


def test_the_tramway_in_the_wind_is_the_default_but_for_what_goes_across():
    plane, space = (leaves(load_scenario(name).resolved()) for name in ("aerial_tramway", "windy_tramway"))
    assert {key for key in plane.keys() | space.keys() if plane.get(key) != space.get(key)} == ACROSS
    for name in ("cable.start", "cable.end", "towers.tower"):
        x, y, z = space[f"{name}.position"]
        assert ([x, z], y) == (plane[f"{name}.position"], 0.0)


def test_the_page_says_how_a_cabin_hangs_in_the_wind(capsys):
    """Python code of the page; across the track along the resultant of weight and drag."""
    text = PAGE.read_text(encoding="utf-8")
    (block,) = [one for one in re.findall(r"^```python\n(.*?)^```$", text, re.M | re.S) if "windy_tramway" in one]
    exec(block, {})  # of this repository
    printed = capsys.readouterr().out
    assert printed.splitlines() == re.findall(r"^# (.*)$", block, re.M)
    empty = [float(word) for word in re.findall(r"[\d.]+", printed)][1]
    drag = 0.5 * 1.1 * 20.0**2  # Pa
    moment = drag * (2.0 * 2.7 + 14.9 * 6.7)  # N m about the rope: hanger and cabin by the depth of their middles
    weight = 9.81 * (1500.0 * 0.2 + 1000.0 * 2.9 + 3100.0 * 6.9)  # N m for each rad
    assert np.radians(empty) == pytest.approx(moment / weight, rel=0.1)
