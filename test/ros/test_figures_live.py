"""Key figures, derailment and outlook of a running twin: topics, diagnostics and log, and the same from its bag."""

from __future__ import annotations

import json
import os
import signal
from pathlib import Path

import pytest
from bent_line import STRAIGHT
from recorded_run import snapshots_of
from small_tramway import TRAMWAY
from twin_process import LOG_EVERY_FRAME, PATIENCE

from cable_twin.frame.records import AppliedCommand
from cable_twin.key_figures import KeyFigures, figure_from_values
from cable_twin.messages import SECOND, decode, statuses_of_message
from cable_twin.offline.replay import main as replay
from cable_twin.recording.log_reader import RecordedFigures, read_log, read_snapshots
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation

pytest.importorskip("rclpy")
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Vector3, Vector3Stamped, WrenchStamped
from rclpy.qos import DurabilityPolicy, QoSProfile
from ros_participant import values_of

SWING = "cabin: swing along the track"
SWING_AHEAD, STOP = f"as commanded: {SWING}", "emergency stop: cabin: stopping distance"
LATE = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def test_a_limit_that_is_passed_is_told_everywhere_and_once(processes, participants, tmp_path):
    limited = load_scenario(TRAMWAY, {"limits.swing": 0.02})
    (tmp_path / "tramway.yaml").write_text(limited.to_yaml())
    sim = processes("--scenario", "tramway.yaml", *LOG_EVERY_FRAME)
    participant = participants(sim.domain)
    participant.subscribe("key_figures", DiagnosticArray)
    participant.subscribe("supports/tower_1/force", WrenchStamped)
    participant.subscribe_standard()

    def figures():
        messages = participant.received["key_figures"]
        return {status.name: status for status in messages[-1].status} if messages else {}

    participant.until(lambda: SWING in figures(), what="key figures")
    assert "limit not kept: " + SWING not in sim.output
    with participant.stream(name=["cabin"], velocity=[6.0]):
        participant.until(lambda: figures()[SWING].level == 1, what="a warning")
    participant.next_diagnostics()
    status = figures()[SWING]
    values = values_of(status)
    assert (values["unit"], values["limit"], values["bound"]) == ("rad", "0.02", "at most")
    assert float(values["value"]) > 0.02
    assert "arc length" in values["place"]
    level, message = participant.task("limits")
    assert level == 1
    assert SWING in message
    (line,) = [line for line in sim.output.splitlines() if f"limit not kept: {SWING}" in line]
    assert "allowed: at most 1.146 deg (scenario: limits.swing)" in line
    assert participant.received["supports/tower_1/force"]
    acceleration = values_of(figures()["cabin: vehicle acceleration"])
    assert acceleration["band"].startswith("smoothed twice with a moving average")
    assert sim.end() == 0

    log = read_log(sim.run_directory)
    _, stamp_ns, data = list(log.messages(["key_figures"]))[-1]
    told = {status.name: status for status in decode(data, "diagnostic_msgs/msg/DiagnosticArray").status}
    told_at = (stamp_ns - log.epoch_ns) / SECOND
    ahead = stamp_ns - max(stamp for _, stamp, _ in log.messages(["joint_states"]))
    # of all frames; of the diagnostics beside a frame that was not due yet; or before the last frame, at the end
    assert -10_000_000 <= ahead <= 10_000_000
    before, after = KeyFigures(limited), KeyFigures(limited)  # a frame may be computed and not yet be gathered
    for item in read_snapshots(log):
        if isinstance(item, RecordedFigures):
            continue
        for figures_so_far, until in ((before, told_at - 0.025), (after, told_at + 0.015)):
            if item.time <= until:
                take = figures_so_far.command if isinstance(item, AppliedCommand) else figures_so_far.update
                take(item)
    earlier = {figure.name: figure.value for figure in before.figures()}
    for figure in after.figures():
        value = float(values_of(told[figure.name])["value"])
        if (
            "deropement" not in figure.name and "roller" not in figure.name
        ):  # of every step live, of every frame from the log
            low, high = sorted((earlier.get(figure.name, figure.value), figure.value))
            close = 1e-3 + 1e-5 * abs(value)  # the cable is in single precision in the log
            assert low - close <= value <= high + close, figure.name
    assert set(earlier) <= set(told)


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


def test_what_would_come_is_told_before_it_comes(processes, participants, tmp_path):
    (tmp_path / "tramway.yaml").write_text(load_scenario(TRAMWAY, {"limits.swing": 0.02}).to_yaml())
    sim = processes("--scenario", "tramway.yaml", "--outlook-horizon", "3", "--outlook-rate", "5")
    participant = participants(sim.domain)
    participant.subscribe("outlook", DiagnosticArray)
    participant.subscribe_standard()

    def newest():
        return {one.name: one for one in participant.received["outlook"][-1].status}

    participant.until(lambda: STOP.split(": ", maxsplit=1)[0] in values_of(newest()["outlook"]), what="an outlook")
    assert STOP not in newest()
    with participant.stream(name=["cabin"], velocity=[3.0]):
        participant.until(lambda: STOP in newest() and newest()[SWING_AHEAD].level == 1, what="a stop and a warning")
        participant.until(lambda: "outlook from " in sim.output, what="a line in the log")
    told = newest()
    head, swing = values_of(told["outlook"]), values_of(told[SWING_AHEAD])
    assert float(head["horizon_s"]) == 3.0
    assert float(head["age_s"]) >= float(head["took_s"]) > 0.0
    assert float(head["time_s"]) <= float(swing["passed_s"]) <= float(swing["time_s"])
    assert (swing["future"], swing["limit"], swing["bound"]) == ("as commanded", "0.02", "at most")
    assert "cabin: swing along the track: " in sim.output

    count = len(participant.received["outlook"])
    (child,) = [path for path in Path(f"/proc/{sim.process.pid}/task").glob("*/children") if path.read_text().split()]
    os.kill(int(child.read_text().split()[0]), signal.SIGKILL)
    participant.until(lambda: "outlook: its process has ended; another one begins in 30 s" in sim.output, what="a line")
    assert len(participant.received["outlook"]) >= count
    assert sim.end() == 0

    log = read_log(sim.run_directory)
    messages = [data for _, _, data in log.messages(["outlook"])]
    assert len(messages) >= 2
    assert replay([str(sim.run_directory)]) == 0  # to the last bit
    forecast_is_what_happens(log, messages)


def forecast_is_what_happens(log, messages):
    """Stopping distance of a logged outlook, against a stop at that time of the repeated run."""
    for data in reversed(messages):
        told = {status.name: status for status in statuses_of_message(data)}
        if STOP in told and told[STOP].level == 0:
            break
    distance = figure_from_values(STOP, told[STOP].values)
    twin, time = Simulation(load_scenario(log.scenario)), float(told["outlook"].values["time_s"])
    for applied in log.commands:
        if applied.time < time:
            twin.advance_to(applied.time)
            twin.apply(applied.command)
    twin.advance_to(time)
    future = twin.outlook(horizon=3.0)["emergency stop"]
    assert future["stopping_distance/carriages.cabin/highest"].value == distance.value
