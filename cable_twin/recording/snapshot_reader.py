"""Reader of snapshots and commands from a log, one after the other and without simulation.

A log holds each group of columns at its own rate; numbers that it does not hold at a time are NaN in the snapshot of
that time. All others are those of the run, bit for bit, but for the shape and tension of the rope: between complete
frames, usually one a second, these come from the topic `cable`, in single precision.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

from cable_twin.frame.records import AppliedCommand, RefusedCommand
from cable_twin.frame.snapshot import Layout, Snapshot
from cable_twin.messages import (
    APPLIED_COMMANDS,
    CABLE,
    KEY_FIGURES,
    REFUSED_COMMANDS,
    SECOND,
    Status,
    read_rope,
    refused_command_from_message,
    statuses_of_message,
)
from cable_twin.messages.columns import COLUMNS, Row
from cable_twin.recording.log_file import UNREADABLE, LogError, one_line
from cable_twin.recording.log_reader import Log
from cable_twin.scenario import ScenarioError, load_scenario

TOPICS = (COLUMNS, CABLE, APPLIED_COMMANDS, REFUSED_COMMANDS, KEY_FIGURES)


class RecordedFigures(NamedTuple):
    """Key figures that a run has recorded in its log, with their time."""

    time: float  # s
    statuses: list[Status]


Item = Snapshot | AppliedCommand | RefusedCommand | RecordedFigures


def read_snapshots(log: Log, *, on_position: Callable[[int], None] | None = None) -> Iterator[Item]:
    """Stream snapshots, commands and key figures of a log in its order, with one frame in memory.

    Args:
        log: Finished, or cut short: the last frame then may be missing.
        on_position: Called with the bytes of the file read so far.

    Yields:
        Snapshots, each command where it took effect or was refused, and key figures where they were recorded, in the
        order of the log.

    Raises:
        LogError: The scenario or a message is unreadable; the line names topic and time.
    """
    try:
        layout = Layout.of(load_scenario(log.scenario), int(log.metadata["sample_count"]))
    except ScenarioError as error:
        raise LogError("\n".join(f"{log.path}: {fault}" for fault in error.faults)) from error
    decoder = log.row_decoder(layout)
    frame: Row | None = None  # the last one, which may still get its rope
    frame_ns = -1
    for topic, stamp_ns, data in log.messages(TOPICS, on_position):
        time = (stamp_ns - log.epoch_ns) / SECOND
        try:
            if topic == CABLE:
                if frame is not None and stamp_ns == frame_ns:
                    read_rope(data, layout, frame.numbers)
                continue
            if frame is not None:
                yield Snapshot(layout, frame.numbers, frame.report)
                frame = None
            if topic == COLUMNS:
                frame, frame_ns = decoder.decode(data), stamp_ns
            elif topic == APPLIED_COMMANDS:
                yield log.command(stamp_ns, data)
            elif topic == REFUSED_COMMANDS:
                yield refused_command_from_message(data, time)
            else:
                yield RecordedFigures(time, statuses_of_message(data))
        except UNREADABLE as error:
            if isinstance(error, LogError):
                raise
            raise LogError(f"{log.path}: {topic} at {time:.6f} s is unreadable: {one_line(error)}") from error
    if frame is not None:
        yield Snapshot(layout, frame.numbers, frame.report)
