"""Writer thread of log and view."""

from __future__ import annotations

import threading
import time
from pathlib import Path

from logged_run import COMMANDS, EPOCH, LAYOUT, METADATA, SCENARIO_VALUES, TABLE, make_snapshot
from twin_process import wait_until

from cable_twin.frame.records import (
    AppliedCommand,
)
from cable_twin.messages import MessageEncoder, scenario_message
from cable_twin.messages.command_messages import applied_command_message
from cable_twin.recording.log_reader import read_log
from cable_twin.recording.log_writer import McapLog
from cable_twin.recording.recorder import Recorder


class FakeView:
    flush_period = 0.5

    def __init__(self, broken_after: int | None = None) -> None:
        self.seen: list[float] = []
        self.commands: list[AppliedCommand] = []
        self.flushes = 0
        self.paths: list[Path] = []
        self.closed = 0
        self.broken_after = broken_after

    def log(self, snapshot):
        if self.broken_after is not None and len(self.seen) >= self.broken_after:
            raise RuntimeError("no more\npaper")
        self.seen.append(snapshot.time)

    def log_command(self, applied):
        self.commands.append(applied)

    def flush(self):
        self.flushes += 1

    def split(self, path):
        self.paths.append(path)

    def close(self):
        self.closed += 1


def record_run(recorder: Recorder, frames: int) -> None:
    encoder = MessageEncoder(LAYOUT, EPOCH)
    recorder.begin(EPOCH, 0.0, scenario_message(SCENARIO_VALUES))
    for applied in COMMANDS:
        recorder.record_command(applied, applied_command_message(applied, EPOCH), EPOCH + round(applied.time * 1e9))
    for frame in range(frames):
        snapshot = make_snapshot(frame / 100)
        recorder.record(encoder.frame(snapshot), encoder.stamp_ns(snapshot), snapshot)


def test_recorder_writes_log_and_view(directory):
    view = FakeView()
    recorder = Recorder(McapLog(directory, TABLE, METADATA), view)
    record_run(recorder, 30)
    wait_until(lambda: recorder.idle and view.flushes >= 1)
    recorder.close()
    recorder.close()
    assert recorder.faults == []
    assert not recorder.recording
    assert (len(view.seen), view.commands, view.closed) == (30, COMMANDS, 1)
    read = read_log(directory)
    assert read.complete
    assert read.commands == COMMANDS
    assert len(list(read.messages(["joint_states"]))) == 30
    record_run(recorder, 1)
    assert recorder.dropped == 1 + len(COMMANDS)


def test_messages_reach_the_disk_where_no_more_follow(directory):
    log = McapLog(directory, TABLE, METADATA)
    recorder = Recorder(log)
    record_run(recorder, 10)
    wait_until(lambda: recorder.idle and log.safe_until >= COMMANDS[-1].time)  # which stand before the frames
    wait_until(lambda: len(list(read_log(directory).messages(["joint_states"]))) == 10)
    recorder.close()


def test_a_broken_view_does_not_stop_the_log(directory):
    view = FakeView(broken_after=3)
    recorder = Recorder(McapLog(directory, TABLE, METADATA), view)
    record_run(recorder, 20)
    recorder.close()
    assert recorder.faults == ["recording: view stopped: no more paper"]
    assert view.closed == 1
    assert len(list(read_log(directory).messages(["joint_states"]))) == 20


def test_frames_too_many_are_dropped_and_commands_never():
    gate = threading.Event()

    class SlowView(FakeView):
        def log(self, snapshot):
            gate.wait(60)
            super().log(snapshot)

    view = SlowView()
    recorder = Recorder(None, view, capacity=10)
    start = time.perf_counter()
    for frame in range(50):
        recorder.record([], EPOCH, make_snapshot(frame / 100))
    recorder.record_command(COMMANDS[0], b"", EPOCH)
    assert time.perf_counter() - start < 1.0
    assert recorder.backlog <= 11
    gate.set()
    recorder.close()
    assert recorder.dropped + len(view.seen) == 50
    assert 10 <= len(view.seen) <= 11
    assert view.commands == COMMANDS[:1]
