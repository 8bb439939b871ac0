"""Table of topics and their schedule."""

from __future__ import annotations

import numpy as np
import pytest

from cable_twin.frame.rates import LOGGED, PUBLISHED, divides, fault, frames_between
from cable_twin.frame.snapshot import Layout
from cable_twin.messages import Schedule, TopicNames, topics

BODIES = ("hanger", "cabin")


def lift(carriers: int, carriages: int = 1) -> Layout:
    """Layout with some carriages of two bodies and many chairs."""
    vehicles = {f"cabin_{number}": BODIES for number in range(1, carriages + 1)}
    vehicles |= {f"chair_{number}": ("chair",) for number in range(1, carriers + 1)}
    return Layout(vehicles, ("start", "end", "tower"), ("haul_rope",), np.linspace(0.0, 1.0, 3), carriers=carriers)


def names(table) -> set[str]:
    return {topic.name for topic in table}


def test_nothing_is_there_twice():
    table = topics(lift(3), own=["chair_2"], clock=True, tf=True)
    assert len(names(table)) == len(table)
    assert names(table) - names(topics(lift(3), own=["chair_2"])) == {"/clock", "/tf", "/tf_static"}
    shown = topics(lift(3), own=["chair_2"], clock=True, tf=True, markers=True, robot=True)
    assert names(shown) - names(table) == {"markers", "robot_description"}
    latched = {topic.name for topic in shown if topic.durability == "transient_local"}
    assert latched == {"scenario", "/tf_static", "robot_description"}  # what is sent once stays there for who comes


def test_topics_do_not_grow_with_carriers_but_with_carriages_and_names_that_are_asked_for():
    assert names(topics(lift(3))) == names(topics(lift(300)))
    assert "carriers/poses" not in names(topics(lift(0)))
    assert names(topics(lift(3, 2))) - names(topics(lift(3))) == {
        "carriages/cabin_2/pose",
        "carriages/cabin_2/hanger/pose",
        "carriages/cabin_2/cabin/pose",
        "carriages/cabin_2/contact_force",
    }
    assert names(topics(lift(3), own=["chair_2"])) - names(topics(lift(3))) == {
        "carriages/chair_2/pose",
        "carriages/chair_2/chair/pose",
        "carriages/chair_2/contact_force",
    }


def test_full_names_follow_the_node():
    assert TopicNames().full("joint_states") == "/cable_twin/joint_states"
    assert TopicNames("/site/twin").full("joint_states") == "/site/twin/joint_states"
    assert TopicNames("/site/twin").full("/tf") == "/tf"


def test_names_that_are_remapped_come_back_from_the_metadata_of_a_log():
    names = TopicNames("/site/twin", {"joint_states": "/js", "/clock": "/south/clock"})
    again = TopicNames.of(names.metadata)
    for topic, full in (("joint_states", "/js"), ("/clock", "/south/clock"), ("cable", "/site/twin/cable")):
        assert names.full(topic) == full
        assert again.own(full) == topic
    assert TopicNames.of({}).own("/cable_twin/cable") == "cable"  # of an early log


@pytest.mark.parametrize("frame_rate", [7.0, 50.0, 60.0, 100.0, 250.0, 1000.0])
def test_each_group_comes_as_often_as_it_may(frame_rate):
    """Never above the requested rate, and at most one frame late."""
    table = topics(lift(3), tf=True)
    schedule = Schedule(table, frame_rate, PUBLISHED, LOGGED)
    groups = {topic.name: topic.group for topic in table}
    for taker, rates in enumerate((PUBLISHED, LOGGED)):
        frames: dict[str, list[int]] = {}
        for frame in range(3 * round(frame_rate)):
            due = schedule.due(frame)
            for number in due.taken[taker]:
                frames.setdefault(groups[due.names[number]], []).append(frame)
        assert set(frames) == {group for group in groups.values() if group}
        for group, given in frames.items():
            (period,) = set(np.diff(sorted(set(given))))
            rate = rates.get(group, 0.0) or frame_rate
            assert given[0] == 0
            assert frame_rate / rate - 1e-9 <= max(period, frame_rate / rate) < frame_rate / rate + 1.0
            assert period >= 1


def test_a_frame_has_each_topic_once_for_all_takers():
    schedule = Schedule(topics(lift(3)), 100.0, PUBLISHED, LOGGED)
    for frame in range(200):
        due = schedule.due(frame)
        assert len(set(due.names)) == len(due.names)
        assert sorted({number for taken in due.taken for number in taken}) == list(range(len(due.names)))
    assert schedule.due(0) is schedule.due(100)  # made once


def test_everything_is_due_when_it_is_asked_for():
    table = topics(lift(3))
    schedule = Schedule(table, 100.0, LOGGED)
    everything = {topic.name for topic in table if topic.group}
    assert set(schedule.due(3, everything=True).names) == everything
    assert set(schedule.due(3).names) == {"joint_states", "joint_references"}


@pytest.mark.parametrize(
    ("frame_rate", "rate", "expected"),
    [(100.0, 20.0, True), (100.0, 0.0, True), (100.0, 100.0, True), (100.0, 30.0, False), (100.0, 200.0, False)],
)
def test_rates_that_can_be_kept(frame_rate, rate, expected):
    assert divides(frame_rate, rate) is expected


@pytest.mark.parametrize("steps", [3, 7, 143])  # of 1 ms in a frame
def test_rates_that_a_message_allows_can_be_given(steps):
    """Frame rates with endless digits, printed with six of them."""
    frame_rate = 1e3 / steps
    line = fault("rope_rate", 0.9 * frame_rate, frame_rate)
    allowed = line.partition("frame rate, as ")[2].partition(" Hz")[0].replace(" or ", ", ").split(", ")
    assert [frames_between(frame_rate, float(rate)) for rate in allowed] == [1, 2, 5]
    assert all(divides(frame_rate, float(rate)) for rate in allowed)


def test_a_group_to_which_nobody_listens_is_taken_by_the_others_alone():
    schedule = Schedule(topics(lift(3), markers=True), 100.0, PUBLISHED, LOGGED)
    schedule.listen(0, "markers", False)
    due = [schedule.due(frame) for frame in range(1, 201)]
    taken = [[sum(one.names[number] == "markers" for number in one.taken[taker]) for one in due] for taker in (0, 1)]
    assert (sum(taken[0]), sum(taken[1])) == (0, 2)  # the log once a second
    assert sum("markers" in one.names for one in due) == 2
    schedule.listen(0, "markers", True)
    assert sum("markers" in schedule.due(frame).names for frame in range(1, 101)) == 10
