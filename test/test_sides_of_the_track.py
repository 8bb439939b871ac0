"""Left and right of the track in space: one meaning for a rope alone and both strands of a loop."""

from __future__ import annotations

from math import cos, radians, sin
from xml.etree import ElementTree

import numpy as np
import pytest
from bent_line import BENT

from cable_twin.frame.sensors import Sensors
from cable_twin.key_figures import KeyFigures
from cable_twin.messages.texts import DerailmentMessage, statuses_of_message
from cable_twin.ros.rviz import robot_description
from cable_twin.scenario import load_scenario, masts, tower_axes
from cable_twin.simulation import Simulation
from verification import JIT

needs_kernels = pytest.mark.skipif(not JIT, reason="minutes without compilation")
WIND = {"air.wind": [0.0, 10.0, 0.0]}
ELEMENTS = {f"ropes.{rope}.elements": {"target": 12.0, "at_towers": 2.0, "growth": 2.0} for rope in ("up", "down")}
LIFT = {**ELEMENTS, **WIND, "space": 3}
HELD_DOWN = {"towers.tower_2.hold_down": True, "towers.tower_2.position": [150.0, 27.0]}
BACK = {"cable.start.position": [200.0, 0.0, 0.0], "cable.end.position": [0.0, 0.0, 0.0]}  # of the bent line


def checked(simulation: Simulation) -> dict[str, float]:
    """Lateral forces (N) by tower, checked against forces along y and against the ratios."""
    figures = KeyFigures(simulation.scenario)
    figures.update(simulation.snapshot)
    shown = {figure.name: figure.value for figure in figures.figures()}
    found = {}
    for name in simulation.scenario.towers:
        force, tower = simulation.snapshot.supports[name].force, simulation.snapshot.supports[name].tower
        found[name] = tower.lateral_force
        assert tower.lateral_force == pytest.approx(float(force[1]), rel=1e-3, abs=1e-6), name
        key = f"{name}: lateral over normal force"
        if tower.normal_load == 0.0:
            assert tower.lateral_ratio is None, name
            assert key not in shown
        else:
            ratio = abs(tower.lateral_force) / tower.normal_load
            assert tower.lateral_ratio == pytest.approx(ratio, rel=1e-12), name
            assert shown[key] == tower.lateral_ratio
    return found


@pytest.mark.parametrize("back", [{}, BACK])
def test_one_rope_is_pushed_to_the_same_side_whichever_way_it_runs(back):
    forces = checked(Simulation(load_scenario(BENT, {**WIND, **back})))
    assert forces["tower"] == pytest.approx(1703.0, rel=0.01)


@needs_kernels
@pytest.mark.parametrize(
    ("scenario", "changes"), [("chairlift", LIFT), ("chairlift", LIFT | HELD_DOWN), ("jig_back", WIND)]
)
def test_ropes_together_show_forces_and_ratios_of_their_common_rest(scenario, changes):
    """Both strands held to the right in a wind to the left; no ratio without load."""
    simulation = Simulation(load_scenario(scenario, changes))
    forces = checked(simulation)
    untouched = [name for name in forces if simulation.snapshot.supports[name].tower.normal_load == 0.0]
    assert untouched == (["tower_2_up"] if "towers.tower_2.hold_down" in changes else [])
    assert all(force < 0.0 for name, force in forces.items() if name not in untouched), forces


@pytest.mark.parametrize("back", [{}, BACK])
def test_one_rope_comes_out_on_the_side_to_which_it_is_blown(back):
    simulation = Simulation(load_scenario(BENT, {**WIND, **back}))
    simulation.wind(0.0, 0.0, -60.0)
    (one,) = simulation.advance_to(1.0).derailments
    assert one.how == "outward to the right"
    middle = simulation.layout.ropes["cable"].stop // 2
    assert simulation.snapshot.columns.rope_position[middle, 1] < 3.9  # m, off its tower at 4 m


@needs_kernels
def test_the_strand_that_runs_back_comes_out_on_the_side_to_which_it_is_blown():
    """Lighter strand with empty chairs, the only one blown off its towers."""
    simulation = Simulation(load_scenario("chairlift", LIFT | {"towers.tower_3.derailment_ratio": 0.04}))
    rope = simulation.layout.ropes["down"]
    before = simulation.snapshot.columns.rope_position[rope, 1].max()
    (one,) = simulation.advance_to(1.0).derailments
    assert (one.tower, one.how) == ("tower_3_down", "outward to the left")
    assert simulation.snapshot.columns.rope_position[rope, 1].max() > before + 0.1


@needs_kernels
def test_a_rope_that_never_lay_on_a_tower_leaves_it_without_a_ratio():
    simulation = Simulation(load_scenario("chairlift", LIFT | HELD_DOWN | {"towers.tower_2.groove_height": 0.001}))
    (one,) = simulation.advance_to(0.05).derailments
    assert (one.tower, one.how, one.ratio) == ("tower_2_up", "by lifting off", None)
    data = DerailmentMessage(simulation.layout, simulation.snapshot.columns).fill(0)
    (status,) = statuses_of_message(data)
    assert sorted(status.values) == ["how", "time_s", "x_m", "y_m", "z_m"]


def test_masts_of_both_strands_are_to_the_left_of_the_track():
    own = {"mast_offset": 1.5, "mast_width": 0.8}
    changes = {"space": 3} | {f"towers.tower_2.{key}": value for key, value in own.items()}
    scenario = load_scenario("chairlift", changes)
    assert masts(scenario.of_rope("up")) == {"tower_2_up": pytest.approx((150.0, 3.6, 34.0, 0.4))}
    assert masts(scenario.of_rope("down")) == {"tower_2_down": pytest.approx((150.0, -0.6, 34.0, 0.4))}


@pytest.mark.parametrize(
    ("heading", "left"), [(0, 90), (60, 150), (90, 180), (100, 10), (180, 90), (-60, 30), (-90, 0), (-120, 150)]
)
def test_left_is_that_of_the_track_for_both_ropes_of_a_line_to_anywhere(heading, left):
    """Degrees in plan from x: track along its first rope towards +x, second rope back."""
    way = np.array([cos(radians(heading)), sin(radians(heading)), 0.0])
    beside = np.array([-way[1], way[0], 0.0])
    ropes, towers = {}, {}
    for name, ends, side in (("there", (-100.0, 100.0), 2.0), ("back", (100.0, -100.0), -2.0)):
        start, end = (way * end + beside * side for end in ends)
        rope = {"start": {"position": start.tolist()}, "end": {"position": end.tolist()}}
        ropes[name] = {**BENT["cable"], **rope}
        towers[name] = {"rope": name, "position": (beside * side + [0.0, 0.0, 2.0]).tolist()}
    scenario = load_scenario({"ropes": ropes, "towers": towers})
    for name in ropes:
        _, across = tower_axes(scenario.of_rope(name))
        np.testing.assert_allclose(across, [[cos(radians(left)), sin(radians(left)), 0.0]], atol=1e-9)


@needs_kernels
def test_what_hangs_and_what_measures_it_is_blown_to_one_side_on_both_strands():
    """Wind to the left: chairs, their pins, IMUs, load cells, and axes in the URDF."""
    pins = {"carriers.bodies.chair.upper_pivot": [0.0, 0.05, 2.6]}
    imus = {f"sensors.box_{number}": {"kind": "imu", "of": f"chair_{number}", "rate": 100.0} for number in (5, 20)}
    cells = {f"sensors.cell_{rope}": {"kind": "load_cell", "of": f"tower_3_{rope}"} for rope in ("up", "down")}
    scenario = load_scenario("chairlift", LIFT | pins | imus | cells)
    simulation = Simulation(scenario)
    sensors, measured = Sensors(scenario, simulation.layout), {}
    for frame in range(1, 5):
        for one in sensors.take(simulation.advance_to(0.01 * frame)):
            measured[one.sensor] = one.values
    c, layout = simulation.snapshot.columns, simulation.layout
    rows = [layout.vehicle_rows[name] for name in ("chair_5", "chair_20")]
    strands = [list(layout.ropes)[int(c.vehicle_rope[row])] for row in rows]
    assert strands == ["up", "down"]
    for row, name in zip(rows, ("chair_5", "chair_20"), strict=True):
        roll, beside = c.body_angles[row, 0], c.body_position[row] - c.joint_position[row]
        assert beside[1] > 0.03  # blown to the left
        assert beside[1] == pytest.approx(2.6 * sin(roll) - 0.05 * cos(roll), abs=0.02)  # its pin is left of its middle
        turns, felt = np.split(np.array(measured[f"box_{name.partition('_')[2]}"]), 2)
        assert felt[1] == pytest.approx(9.81 * sin(roll), rel=0.05)
        assert np.linalg.norm(felt) == pytest.approx(9.81, rel=0.02)
        assert np.abs(turns).max() < 0.05
    for rope in ("up", "down"):
        assert measured[f"cell_{rope}"][1] < 0.0  # it is held to the right
    robot = ElementTree.fromstring(robot_description(scenario))
    axes = {
        joint.get("name"): joint.find("axis").get("xyz")
        for joint in robot.iter("joint")
        if joint.find("axis") is not None
    }
    assert axes["chair_5_chair"] == axes["chair_20_chair"] == "0 1 0"
    places = {
        joint.get("name"): [*map(float, joint.find("origin").get("xyz").split())] for joint in robot.iter("joint")
    }
    assert places["chair_5_chair_centre"] == places["chair_20_chair_centre"] == [0.0, -0.05, -2.6]
