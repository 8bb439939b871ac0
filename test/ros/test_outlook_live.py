"""Outlook of a running twin: topic and log, warnings, pause and a killed process; the run itself stays as it was."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import pytest
from small_tramway import TRAMWAY

from cable_twin.key_figures import figure_from_values
from cable_twin.messages import statuses_of_message
from cable_twin.offline.replay import main as replay
from cable_twin.recording.log_reader import read_log
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation

pytest.importorskip("rclpy")
from diagnostic_msgs.msg import DiagnosticArray
from ros_participant import values_of

SWING, STOP = "as commanded: cabin: swing along the track", "emergency stop: cabin: stopping distance"


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
        participant.until(lambda: STOP in newest() and newest()[SWING].level == 1, what="a stop and a warning")
        participant.until(lambda: "outlook from " in sim.output, what="a line in the log")
    told = newest()
    head, swing = values_of(told["outlook"]), values_of(told[SWING])
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
