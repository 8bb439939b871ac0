"""Topic joint_references: commands, followed ramps, and used share of drive forces."""

import numpy as np
import pytest
from small_tramway import IN_SPACE, TRAMWAY
from test_jig_back import QUICK
from test_moving_cable_twin import SHORT

from cable_twin.frame.plotted_signals import SIGNALS
from cable_twin.frame.snapshot import COMMANDED
from cable_twin.gym import RopewayEnv
from cable_twin.messages import JOINT_REFERENCES, MessageEncoder, decode, topics
from cable_twin.scenario import limits_of, load_scenario
from cable_twin.simulation import Simulation

NOTHING, FORCE, SPEED, STOP = range(len(COMMANDED))
LIMITS = {"carriages.cabin.drive.limits": {"speed": 6.0, "acceleration": 1.0, "jerk": 2.0, "force": 900.0}}
DIRECT = {**LIMITS, "carriages.cabin.drive.haul_rope": None, "carriages.cabin.drive.emergency_stop": ["drive"]}


def references(simulation):
    """Rows of the message by name: position, velocity, effort."""
    ((_, data),) = MessageEncoder(simulation.layout).frame(simulation.snapshot, [JOINT_REFERENCES])
    message = decode(data, "sensor_msgs/msg/JointState")
    rows = np.array([message.position, message.velocity, message.effort]).T
    assert np.isfinite(rows).all()
    return dict(zip(message.name, rows.tolist(), strict=True))


@pytest.mark.parametrize("scenario", [TRAMWAY, IN_SPACE], ids=["plane", "space"])
def test_a_speed_is_ramped_to_as_acceleration_and_jerk_allow(scenario):
    simulation = Simulation(load_scenario(scenario, LIMITS))
    assert references(simulation)["cabin/command"] == [SPEED, 0.0, 0.0]  # the scenario holds it
    simulation.command("cabin", speed=4.0)
    simulation.advance_to(1.0)
    rows = references(simulation)
    assert [*rows] == ["cabin", "cabin/command", "cabin/limit"]
    assert rows["cabin/command"] == [SPEED, 4.0, 0.0]
    place, speed, force = rows["cabin"]
    assert force == 0.0
    assert speed == pytest.approx(0.25 + 0.5, abs=0.02)  # 1 m/s² after 0.5 s with 2 m/s³
    columns = simulation.snapshot.columns
    assert (place, speed) == (columns.haul_travel[0], columns.haul_speed[0])  # the reference is that of the sheave
    assert columns.speed[0] != speed  # the rope gives way
    share, _, limit = rows["cabin/limit"]
    assert limit == 900.0
    assert share == pytest.approx(abs(columns.drive_force[0]) / limit)


def test_a_drive_in_saturation_says_so_and_its_reference_goes_on_from_its_speed():
    simulation = Simulation(load_scenario(TRAMWAY, DIRECT))
    resting = references(simulation)["cabin/limit"][0] * 900.0
    strong = Simulation(load_scenario(TRAMWAY, DIRECT | {"carriages.cabin.drive.limits.force": resting + 50.0}))
    strong.command("cabin", speed=4.0)
    strong.advance_to(0.9)
    rows, columns = references(strong), strong.snapshot.columns
    assert rows["cabin/limit"][0] == pytest.approx(1.0, abs=1e-6)
    assert rows["cabin"][1] == columns.speed[0]
    assert 0.0 < rows["cabin"][1] < 0.5  # 200 kg with some 50 N, not 1 m/s²
    simulation.command("cabin", speed=4.0)
    simulation.advance_to(0.9)
    assert references(simulation)["cabin/limit"][0] < 1.0
    assert references(simulation)["cabin"][1] > 0.5


def test_a_drive_with_a_limit_of_the_jerk_holds_its_force_limit():
    """It is as fast as one without that limit, once both ask for more than they can give."""
    speeds = []
    for jerk in (None, 0.2):
        limits = {"carriages.cabin.drive.limits.force": 34e3, "carriages.cabin.drive.limits.jerk": jerk}
        simulation = Simulation(load_scenario("aerial_tramway", limits), samples=2)
        simulation.command("cabin", speed=4.0)
        simulation.advance_to(10.0)
        speeds.append(float(simulation.snapshot.columns.haul_speed[0]))
        assert simulation.snapshot.columns.drive_force[0] == pytest.approx(34e3, rel=1e-6)
    assert speeds[0] > 0.4
    assert speeds[1] == pytest.approx(speeds[0], rel=0.1)


def test_forces_and_stops_have_their_kind():
    simulation = Simulation(load_scenario(TRAMWAY, DIRECT))
    simulation.command("cabin", force=700.0)
    simulation.advance_to(0.1)
    rows, columns = references(simulation), simulation.snapshot.columns
    assert rows["cabin/command"] == [FORCE, 0.0, 700.0]
    assert rows["cabin"] == [columns.arc_length[0], columns.speed[0], 700.0]
    assert rows["cabin/limit"][0] == pytest.approx(700.0 / 900.0)
    simulation.emergency_stop()
    assert references(simulation)["cabin/command"] == [STOP, 0.0, 0.0]
    simulation.emergency_stop(False)
    assert references(simulation)["cabin/command"] == [SPEED, 0.0, 0.0]


@pytest.mark.parametrize("scenario", [SHORT, "chairlift"], ids=["strand", "loop"])
def test_a_moving_rope_has_its_command_and_ramp(scenario):
    coarse = {} if scenario is SHORT else {"ropes.up.elements": 150, "ropes.down.elements": 150}
    simulation = Simulation(load_scenario(scenario, coarse))
    simulation.command("haul_rope", speed=2.0)
    simulation.advance_to(1.0)
    rows, drive = references(simulation), simulation.snapshot.drives["haul_rope"]
    assert [*rows] == ["haul_rope", "haul_rope/command", "haul_rope/limit"]  # chairs take no commands
    assert rows["haul_rope"] == [drive.position, drive.speed, 0.0]
    assert rows["haul_rope/command"] == [SPEED, 2.0, 0.0]
    share, _, limit = rows["haul_rope/limit"]
    if scenario is SHORT:  # moves as it is told, whatever that takes
        assert (share, limit) == (0.0, 0.0)
    else:
        assert limit == limits_of(simulation.scenario, "haul_rope").force
        assert share == pytest.approx(abs(drive.force) / limit) != 0.0
        assert SIGNALS["force_limit_used"].values(simulation.layout, simulation.snapshot.columns)[0] == share
    simulation.emergency_stop()
    assert references(simulation)["haul_rope/command"] == [STOP, 0.0, 0.0]
    if scenario is SHORT:
        return
    simulation.emergency_stop(False)
    simulation.command("haul_rope", force=5e3)
    assert references(simulation)["haul_rope/command"] == [FORCE, 0.0, 5e3]
    assert references(simulation)["haul_rope"] == [drive.position, drive.speed, 5e3]


def test_of_several_ropes_only_what_takes_commands_has_rows():
    simulation = Simulation(load_scenario("jig_back", QUICK))
    assert simulation.layout.commanded == ("haul_rope",)  # the cabins are clamped to haul ropes
    assert [*references(simulation)] == ["haul_rope", "haul_rope/command", "haul_rope/limit"]


def test_where_nothing_takes_commands_there_is_no_such_topic():
    layout = Simulation(load_scenario("pantograph")).layout
    assert layout.commanded == ()
    assert JOINT_REFERENCES not in {topic.name for topic in topics(layout)}


def test_they_can_be_observed_by_a_learning_controller():
    observations = ["cabin/commanded_*", "cabin/reference_*", "cabin/speed"]
    env = RopewayEnv("single_span", observations=observations, period=0.1, duration=10.0)
    env.reset(seed=1)
    observed = env.named(env.step([3.0])[0])
    assert observed["cabin/commanded_speed"] == 3.0
    assert observed["cabin/reference_speed"] == observed["cabin/speed"] > 0.0
    assert env.observation_units == ("m/s", "N", "m", "m/s", "m/s")
