"""Derailment by wind in a running twin: topic, diagnostics and log of the node."""

from __future__ import annotations

import json

import pytest
from bent_line import STRAIGHT
from recorded_run import snapshots_of
from twin_process import PATIENCE

pytest.importorskip("rclpy")
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Vector3, Vector3Stamped
from rclpy.qos import DurabilityPolicy, QoSProfile
from ros_participant import values_of

LATE = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def test_the_event_is_told_everywhere_and_to_who_comes_late(processes, participants, tmp_path, replayed):
    (tmp_path / "straight.yaml").write_text(json.dumps(STRAIGHT), encoding="utf-8")
    sim = processes("--scenario", "straight.yaml")
    participant = participants(sim.domain)
    participant.subscribe("derailments", DiagnosticArray, LATE)
    participant.subscribe_standard()
    wind = participant.node.create_publisher(Vector3Stamped, "/cable_twin/wind", 50)
    participant.until(wind.get_subscription_count, what="a twin that listens")
    assert not participant.received["derailments"]
    wind.publish(Vector3Stamped(vector=Vector3(x=0.0, y=-50.0, z=0.0)))
    (message,) = participant.until(lambda: participant.received["derailments"], what="an event")
    (status,) = message.status
    values = values_of(status)
    assert (status.level, status.name, values["how"]) == (2, "tower", "outward to the right")
    assert "x 100.0, y 0.0, z 2.0 m" in status.message
    passed = "limit not kept: tower: derailed: 1 at"
    participant.until(lambda: passed in sim.output, 2.0 * PATIENCE, what="a warning")
    participant.until(lambda: "tower: derailed" in participant.task("limits")[1], what="diagnostics")
    late = participants(sim.domain)
    late.subscribe("derailments", DiagnosticArray, LATE)
    late.until(lambda: late.received["derailments"], what="the same, later")
    assert sim.end() == 0
    frames = snapshots_of(sim.run_directory)
    (one,) = frames[-1].derailments
    assert one.time == float(values["time_s"])
    replayed(sim.run_directory)
