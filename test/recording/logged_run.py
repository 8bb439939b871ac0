"""Messages for logs of a cabin with prescribed motion, without a simulation."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from hand_made_snapshot import body_in_plane, snapshot_of

from cable_twin.frame.records import (
    AppliedCommand,
    CableSamples,
    CarriageState,
    Command,
    SupportState,
)
from cable_twin.frame.snapshot import Layout, Snapshot
from cable_twin.messages import APPLIED_COMMANDS, SCENARIO, MessageEncoder, scenario_message, topics
from cable_twin.messages.columns import COLUMNS, COLUMNS_TOPIC, GROUPS, RowEncoder
from cable_twin.messages.command_messages import applied_command_message
from cable_twin.recording.log_writer import McapLog, run_metadata

SAMPLES = 50
LAYOUT = Layout({"cabin": ("hanger",)}, ("start", "end"), (), np.linspace(0.0, 4.0, SAMPLES))
EPOCH = 1_700_000_000_123_456_789
SCENARIO_VALUES = {"name": "bench", "description": "Prüfstand", "cable": {"elements": 24}}
METADATA = run_metadata(SCENARIO_VALUES, LAYOUT, frame_period=0.01)
TABLE = (*topics(LAYOUT), COLUMNS_TOPIC)

COMMANDS = [
    AppliedCommand(0.0, Command("speed", {"cabin": 1.5}), "joint_commands"),
    AppliedCommand(0.123456, Command("force", {"cabin": -20.0}), "script"),
    AppliedCommand(0.25, Command("emergency_stop", {}), "service"),
]


def open_log(directory: Path, table=None, metadata=METADATA, **options) -> McapLog:
    """Log that has begun."""
    log = McapLog(directory, TABLE if table is None else table, metadata, **options)
    log.begin(EPOCH)
    return log


def make_snapshot(time: float) -> Snapshot:
    pair = np.array([time, 1.0])
    cabin = CarriageState(3.5, 6.0, 120.0, pair, pair, {"hanger": body_in_plane(time, 0.0, 0.3, spin=-0.02)})
    noise = np.random.default_rng(round(time * 1e6)).normal(size=(SAMPLES, 2))
    supports = {name: SupportState(pair) for name in LAYOUT.supports}
    return snapshot_of(time, {"cabin": cabin}, supports, CableSamples(LAYOUT.arc_lengths, noise, LAYOUT.arc_lengths))


def run_messages(frames: int) -> list[tuple[str, int, bytes]]:
    """Scenario, frames at 100 Hz and commands of the run."""
    encoder, rows = MessageEncoder(LAYOUT, EPOCH), RowEncoder(LAYOUT)
    messages = [(SCENARIO, EPOCH, scenario_message(SCENARIO_VALUES))]
    waiting = list(COMMANDS)
    for frame in range(frames):
        snapshot = make_snapshot(frame / 100)
        messages.append((COLUMNS, encoder.stamp_ns(snapshot), rows.encode(snapshot, GROUPS)))
        messages += [(name, encoder.stamp_ns(snapshot), data) for name, data in encoder.frame(snapshot)]
        while waiting and waiting[0].time <= snapshot.time:
            applied = waiting.pop(0)
            stamp = EPOCH + round(applied.time * 1e9)
            messages.append((APPLIED_COMMANDS, stamp, applied_command_message(applied, EPOCH)))
    return messages


def write_run(log: McapLog, frames: int) -> list[tuple[str, int, bytes]]:
    messages = run_messages(frames)
    for message in messages:
        log.write(*message)
    return messages
