"""Key figures of a running twin: topic, diagnostics, log, and identical figures from its bag."""

from __future__ import annotations

import pytest
from small_tramway import TRAMWAY
from twin_process import LOG_EVERY_FRAME

from cable_twin.frame.records import AppliedCommand
from cable_twin.key_figures import KeyFigures
from cable_twin.messages import SECOND, decode
from cable_twin.recording.log_reader import RecordedFigures, read_log, read_snapshots
from cable_twin.scenario import load_scenario

pytest.importorskip("rclpy")
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
from ros_participant import values_of

SWING = "cabin: swing along the track"


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
