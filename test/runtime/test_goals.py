"""Goals: speeds on the way, take-over by other commands, and refusals, without ROS and as fast as possible."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from frame_loops import frame_loop
from small_tramway import IN_SPACE, TRAMWAY

from cable_twin.frame.records import Command, CommandError, Goal
from cable_twin.ros.client.driver import points_of, tower_places
from cable_twin.runtime.point_to_point import SOURCE, TOLD, Goals
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation

FRAME = 0.01  # s


class Driven:
    """Simulation with goals, driven as by the frame loop."""

    def __init__(self, scenario):
        self.simulation, self.told = Simulation(scenario), []
        self.goals = Goals(self.simulation, lambda line, abandoned: self.told.append((line, abandoned)))
        self.frames = []

    def apply(self, command, source=SOURCE):
        self.simulation.apply(command, source)
        self.goals.note(command, source)

    def run(self, seconds):
        """Simulate until a message, or for a time (s)."""
        until, told = self.simulation.time + seconds, len(self.told)
        while self.simulation.time < until and len(self.told) == told:
            for command, source in self.goals.commands():
                self.apply(command, source)
            self.frames.append(self.simulation.advance_to(self.simulation.time + FRAME))


@pytest.fixture(scope="module")
def tramway():
    return load_scenario(TRAMWAY)


@pytest.fixture
def driven(tramway):
    return Driven(tramway)


def test_it_arrives_over_a_tower_and_comes_back(driven, tramway):
    snapshot = driven.simulation.snapshot
    rope = np.column_stack([snapshot.columns.rope_position, snapshot.layout.arc_lengths])
    place = tower_places(tramway, rope)["tower_1"]
    assert abs(np.interp(place, rope[:, 3], rope[:, 0]) - 60.0) < 1e-6
    for target, at_most in ((place, 3.0), (10.0, None)):
        driven.goals.take(Goal({"cabin": target}, {} if at_most is None else {"cabin": at_most}))
        assert driven.goals.texts["cabin"] == f"on its way to {target:.2f} m"
        driven.frames.clear()
        driven.run(200.0)
        line, abandoned = driven.told[-1]
        assert not abandoned
        assert line.startswith("cabin has arrived at ")
        snapshot = driven.simulation.snapshot
        assert snapshot.carriages["cabin"].arc_length == pytest.approx(target, abs=0.1)
        assert snapshot.columns.reference_speed[0] == pytest.approx(0.0, abs=0.05)  # of the drive; the cabin swings on
        if at_most is not None:
            speeds = [frame.carriages["cabin"].speed for frame in driven.frames]
            assert max(speeds) == pytest.approx(at_most, rel=0.2)
    assert driven.simulation.commands["cabin"] == Command("speed", {"cabin": 0.0})


@pytest.mark.parametrize("scenario", [TRAMWAY, IN_SPACE], ids=["plane", "space"])
def test_a_short_way_takes_little_more_than_its_ramps_though_the_vehicle_swings(scenario):
    """Long swing on the haul rope: arrival of the drive at the place, and of the vehicle on average."""
    driven, places = Driven(load_scenario(scenario)), (10.0, 13.5, 12.5)
    driven.goals.take(Goal({"cabin": places[0]}, {}))
    driven.run(60.0)
    for start, target in pairwise(places):
        begin = driven.simulation.time
        driven.goals.take(Goal({"cabin": target}, {}))
        driven.frames.clear()
        driven.run(60.0)
        assert "cabin has arrived at " in driven.told[-1][0]
        ramps = 2.0 * math.sqrt(abs(target - start) / 0.7)  # s, up and down by 0.7 of 1 m/s^2
        assert driven.simulation.time - begin < ramps + 5.0  # 2 s of them at rest
        resting = [frame.carriages["cabin"].arc_length for frame in driven.frames[-200:]]
        assert np.mean(resting) == pytest.approx(target, abs=0.1)


def test_what_else_is_commanded_takes_over(driven):
    goal = Goal({"cabin": 50.0}, {})
    for command, why in (
        (Command("speed", {"cabin": 1.0}), "speed from joint_commands took over"),
        (Command("emergency_stop", {}), "emergency stop from joint_commands took over"),
    ):
        driven.goals.take(goal)
        driven.run(1.0)
        driven.apply(Command("wind", {"x": 1.0, "z": 0.0}), "wind")
        assert not driven.told or driven.told[-1][0] == "goal abandoned: cabin: speed from joint_commands took over"
        driven.apply(command, "joint_commands")
        assert driven.told[-1] == (f"goal abandoned: cabin: {why}", True)
        assert driven.goals.texts["cabin"] == f"abandoned: {why}"
        assert not list(driven.goals.commands())
    with pytest.raises(CommandError, match="the emergency stop is in force"):
        driven.goals.take(goal)


def test_an_arrival_is_told_until_another_command_and_a_reason_for_a_minute(driven):
    driven.goals.take(Goal({"cabin": driven.simulation.snapshot.carriages["cabin"].arc_length}, {}))
    driven.run(60.0)
    assert "arrived" in driven.goals.texts["cabin"]
    driven.apply(Command("wind", {"x": 1.0, "z": 0.0}), "wind")
    assert "arrived" in driven.goals.texts["cabin"]
    driven.apply(Command("speed", {"cabin": 0.0}), "joint_commands")
    assert driven.goals.texts == {}
    driven.goals.take(Goal({"cabin": 50.0}, {}))
    driven.apply(Command("reset", {}), "reset")
    driven.run(TOLD - FRAME)
    driven.apply(Command("speed", {"cabin": 0.0}), "joint_commands")
    assert driven.goals.texts["cabin"] == "abandoned: reset from reset took over"
    driven.run(3.0 * FRAME)
    assert driven.goals.texts == {}


def test_another_place_on_the_way_is_gone_on_to_without_a_stop(driven):
    driven.goals.take(Goal({"cabin": 100.0}, {}))
    driven.run(4.0)
    before = driven.simulation.commands["cabin"].values["cabin"]
    driven.goals.take(Goal({"cabin": 100.0}, {}))  # again: nothing changes
    driven.goals.take(Goal({"cabin": 90.0}, {}))
    driven.run(0.05)
    assert driven.simulation.commands["cabin"].values["cabin"] == pytest.approx(before, abs=0.1)
    assert before > 0.5


@pytest.mark.parametrize(
    ("places", "at_most", "complaint"),
    [
        ({"bus": 1.0}, {}, "carriage or drive: given 'bus'; allowed: cabin"),
        ({"cabin": 500.0}, {}, "place for 'cabin': given 500 m; allowed: [0-9.]+ to [0-9.]+ m along the cable$"),
        ({"cabin": 50.0}, {"cabin": 0.0}, "speed of 'cabin': given 0 m/s; allowed: the highest speed of the trip"),
        ({"cabin": 50.0}, {"cabin": 1e3}, "speed of 'cabin': given 1000 m/s; allowed: "),
    ],
)
def test_goals_are_refused_whole(driven, places, at_most, complaint):
    with pytest.raises(CommandError, match=complaint):
        driven.goals.take(Goal({"cabin": 50.0} | places, at_most))
    assert not list(driven.goals.commands())


def test_the_goal_of_a_held_vehicle_is_abandoned(driven, monkeypatch):
    monkeypatch.setattr("cable_twin.runtime.point_to_point.STALLED", 0.5)
    driven.goals.take(Goal({"cabin": 50.0}, {}))
    next(driven.goals.commands())
    driven.simulation.advance_to(driven.simulation.time + 1.0)  # whoever drives it does not
    assert list(driven.goals.commands()) == [(Command("speed", {"cabin": 0.0}), SOURCE)]
    (line, abandoned) = driven.told[-1]
    assert abandoned
    assert "'cabin' has come no nearer than " in line


def test_a_goal_needs_nobody_who_repeats_it_while_a_speed_does(tramway):
    """Time-out of the loop for speed commands only."""
    applied = []
    loop = frame_loop(tramway, command_timeout=0.05, on_applied=applied.append, paused=True)
    loop.start()
    asked = loop.submit(Goal({"cabin": 50.0}, {}), "joint_commands")
    assert asked.result(60.0) is None
    assert loop.step(200).result(60.0) == 200
    assert {one.source for one in applied} == {SOURCE}
    assert applied[-1].command.values["cabin"] > 0.1
    times = [one.time for one in applied]
    assert np.diff(times) == pytest.approx(0.05)
    loop.stop()


def test_points_of_a_cable_are_read_from_its_message():
    from types import SimpleNamespace  # noqa: PLC0415 - a double of sensor_msgs/PointCloud2

    rows = np.array([[0, 0, 5, 0, 9], [3, 0, 6, 3.5, 9]], "<f4")
    fields = [SimpleNamespace(name=name, offset=4 * row) for row, name in enumerate(("x", "y", "z", "arc_length", "t"))]
    cloud = SimpleNamespace(width=2, point_step=20, fields=fields, data=rows.tobytes())
    assert points_of(cloud).tolist() == rows[:, :4].tolist()
    assert math.isclose(points_of(cloud)[1, 3], 3.5)
