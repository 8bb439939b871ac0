"""Limits of commands: one source for refusals, URDF, list of twins and learning environment."""

from math import inf, isfinite
from xml.etree import ElementTree

import pytest

from cable_twin.frame.records import Command, CommandError
from cable_twin.ros.client.twin_client import UNLIMITED, limits_in
from cable_twin.ros.rviz import robot_description
from cable_twin.runtime.point_to_point import target_of
from cable_twin.scenario import command_limits, load_scenario, places_of
from cable_twin.simulation.command_handlers import check_drive

SCENARIOS = [  # of one rope and of several, in a plane and in space
    ("aerial_tramway", {}),
    ("windy_tramway", {}),
    ("seed_example", {}),
    ("chairlift", {}),
    ("chairlift", {"space": 3}),
    ("jig_back", {}),
    ("bicable", {}),
]


def limits_of_joints(scenario):
    robot = ElementTree.fromstring(robot_description(scenario))
    return {
        joint.get("name"): {key: float(value) for key, value in joint.find("limit").attrib.items()}
        for joint in robot.iterfind("joint[@type='prismatic']")
    }


def is_taken(scenario, kind, name, value):
    try:
        check_drive(Command(kind, {name: value}), scenario)
    except CommandError:
        return False
    return True


def is_reached(scenario, name, place):
    try:
        return target_of(scenario, name, repr(place)) == place
    except ValueError:
        return False


@pytest.mark.parametrize(("name", "changes"), SCENARIOS)
def test_the_urdf_has_the_limits_beyond_which_commands_are_refused(name, changes):
    scenario = load_scenario(name, changes)
    joints, commanded = limits_of_joints(scenario), command_limits(scenario)
    assert {*commanded} <= {*joints} == {*scenario.drives, *scenario.vehicles}
    for joint, limit in joints.items():
        for kind, key in (("speed", "velocity"), ("force", "effort")):
            if joint not in commanded:
                assert not is_taken(scenario, kind, joint, 1e-3)
                continue
            assert is_taken(scenario, kind, joint, 0.99999 * limit[key]) == (limit[key] > 0.0)
            assert is_taken(scenario, kind, joint, -1.00001 * limit[key]) == (limit[key] == UNLIMITED)
        if joint in commanded:
            for place, beyond in ((limit["lower"], -1e-6), (limit["upper"], 1e-6)):
                if abs(place) < UNLIMITED:
                    assert is_reached(scenario, joint, place - beyond)
                    assert not is_reached(scenario, joint, place + beyond)
        else:
            assert limit["effort"] == 0.0


def test_numbers_of_shipped_lifts():
    """Force from EN 12927's safety factor and Eytelwein: 0.96e6 / 4.5 (1 - exp(-0.22 π)) = 106.5 kN."""
    chairlift = limits_of_joints(load_scenario("chairlift"))
    assert chairlift["haul_rope"]["effort"] == pytest.approx(106.45e3, rel=1e-4)
    assert chairlift["haul_rope"]["upper"] == UNLIMITED == -chairlift["haul_rope"]["lower"]  # rope goes by for ever
    assert chairlift["chair_1"]["upper"] == pytest.approx(1650.19, abs=0.01)
    jig_back = limits_of_joints(load_scenario("jig_back"))
    assert (jig_back["haul_rope"]["lower"], jig_back["haul_rope"]["upper"]) == (0.0, 1012.0)
    assert (jig_back["cabin_2"]["lower"], jig_back["cabin_2"]["upper"]) == (3.0, 1039.2)


def test_a_carriage_on_another_rope_than_the_first_has_that_ropes_ends():
    car = {
        "arc_length": 30.0,
        "rope": "long",
        "bodies": {"car": {"mass": 100.0, "inertia": 50.0, "upper_pivot": [0.0, 1.0]}},
    }
    rope = {"mass_per_length": 5.0, "axial_stiffness": 5e7, "bending_stiffness": 0.0, "elements": 10}
    ropes = {
        name: {
            **rope,
            "unstrained_length": length,
            "start": {"position": [0.0, 0.0]},
            "end": {"position": [0.99 * length, 0.0]},
        }
        for name, length in (("short", 50.0), ("long", 200.0))
    }
    scenario = load_scenario({"ropes": ropes, "carriages": {"car": car}})
    assert places_of(scenario, "car") == (1.0, 199.0)
    assert target_of(scenario, "car", "150") == 150.0
    assert limits_of_joints(scenario)["car"] == {"lower": 1.0, "upper": 199.0, "velocity": 1e9, "effort": 1e9}


def test_a_list_of_twins_tells_them():
    told = limits_in(robot_description(load_scenario("chairlift")))
    assert told["haul_rope"] == "up to 2.5 m/s, 106.5 kN"
    assert limits_in(robot_description(load_scenario("seed_example"))) == {"carriage": ""}
    assert limits_in("<robot><joint type='prismatic' name='a'/></robot>") == {}
    assert limits_in("no URDF") == {}


def test_learning_has_them():
    gym = pytest.importorskip("cable_twin.gym.environment")
    scenario = load_scenario("chairlift")
    assert gym._limits(scenario, "force") == {"haul_rope": ("force", pytest.approx(106.45e3, rel=1e-4))}
    with pytest.raises(ValueError, match="command: given 'cabin_1'; allowed: haul_rope"):
        gym._limits(load_scenario("jig_back"), {"cabin_1": "speed"})
    assert all(isfinite(limit) for limits in command_limits(scenario).values() for limit in limits)
    assert command_limits(load_scenario("seed_example"))["carriage"] == (inf, inf)
