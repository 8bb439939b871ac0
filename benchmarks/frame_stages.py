"""Cost of one frame of the twin, stage by stage, with the code that the node runs."""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich.progress import Progress

from benchmarks.measure import Effort, Timing, median, timed
from benchmarks.report import Table, Value
from cable_twin.frame.rates import LOGGED, PUBLISHED
from cable_twin.frame.snapshot import Snapshot
from cable_twin.key_figures import KeyFigures
from cable_twin.messages import NAMESPACE, MessageEncoder, Schedule, Topic, topics
from cable_twin.messages.columns import COLUMNS, COLUMNS_TOPIC, RowEncoder, groups_due
from cable_twin.recording.log_writer import McapLog, run_metadata
from cable_twin.recording.run import open_view
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation

RUNS = {"aerial_tramway": ("cabin", 7.0), "chairlift": ("haul_rope", 2.5), "gondola": ("haul_rope", 6.0)}  # m/s
PERIOD = 0.01  # s
FRAMES = 1000

Messages = list[tuple[str, bytes]]


def stages_table(effort: Effort, progress: Progress) -> tuple[list[Table], list[str]]:
    """Run all stages in turn, round after round; a table for each ropeway, and notes."""
    count = 50 if effort.quick else FRAMES
    tables = []
    for scenario, (drive, speed) in RUNS.items():
        if effort.quick and scenario != "aerial_tramway":
            continue
        _round(scenario, drive, speed, 2)  # codecs are made on their first use
        turns = progress.track(range(effort.repetitions), description=f"{scenario}, stage by stage")
        rounds = [_round(scenario, drive, speed, count) for _ in turns]
        stages = {stage: median([one[stage] for one in rounds]) for stage in rounds[0]}
        both, solve = stages.pop("solve and observe"), stages.pop("solve")
        observe = Timing(both.wall - solve.wall, both.processor - solve.processor)
        rows: list[dict[str, Value]] = [
            {
                "stage": stage,
                "wall per frame [µs]": timing.wall / count * 1e6,
                "processor [µs]": timing.processor / count * 1e6,
                "of a frame of 10 ms [%]": timing.wall / count / PERIOD * 1e2,
            }
            for stage, timing in {"solve": solve, "observe": observe, **stages}.items()
        ]
        tables.append(Table(f"stages of a frame, {scenario}", rows))
    notes = [
        f"{count} frames of {PERIOD * 1e3:g} ms in each round. Solve: all frames in one call. Observe: the difference "
        "to one call a frame, which reads a snapshot each time. Encode: what is published in a frame.",
        "MCAP and rerun: writing, compressing and closing, in the recorder's thread of the node; the threads of rerun "
        "itself come on top. Capture and restore: the whole state, without reading a snapshot of it; no frame does so.",
    ]
    if "publish" in stages:
        notes.append(
            "Publish: every topic of a frame as raw bytes over DDS, with a subscriber to each in this process."
        )
    else:
        notes.append("Publish is missing: rclpy is not installed (`pip install '.[ros]'`).")
    return tables, notes


def _round(scenario: str, drive: str, speed: float, count: int) -> dict[str, Timing]:
    """Run every stage over equal frames."""
    times = [(index + 1) * PERIOD for index in range(count)]
    stages: dict[str, Timing] = {}
    ahead, simulation = (_under_way(scenario, drive, speed, on_demand=alone) for alone in (True, False))
    stages["solve"] = timed(lambda: ahead.advance_to(times[-1]))
    snapshots: list[Snapshot] = []
    stages["solve and observe"] = timed(lambda: snapshots.extend(map(simulation.advance_to, times)))
    figures = KeyFigures(simulation.scenario)
    figures.update(snapshots[0])
    stages["key figures"] = timed(lambda: [figures.update(snapshot) for snapshot in snapshots])
    epoch_ns = time.time_ns()
    encoder = MessageEncoder(simulation.layout, epoch_ns)
    table = topics(simulation.layout)
    schedule = Schedule(table, 1.0 / PERIOD, PUBLISHED, LOGGED)
    due = [schedule.due(frame) for frame in range(count)]
    encoder.frame(snapshots[0])
    frames: list[Messages] = []
    stages["encode"] = timed(
        lambda: frames.extend(encoder.frame(snapshot, one.names) for snapshot, one in zip(snapshots, due, strict=True))
    )
    logged = [[messages[number] for number in one.taken[1]] for messages, one in zip(frames, due, strict=True)]
    with _publisher(table) as publish:
        if publish is not None:
            stages["publish"] = timed(lambda: [publish(messages) for messages in frames])
    with tempfile.TemporaryDirectory(prefix="frame-") as name:
        metadata = run_metadata(simulation.scenario.resolved(), simulation.layout, frame_period=PERIOD)
        log = McapLog(Path(name) / "log", (*table, COLUMNS_TOPIC), metadata)
        log.begin(epoch_ns)
        columns = [groups_due(one.groups[1]) for one in due]
        stages["MCAP"] = timed(lambda: _write(log, encoder, snapshots, columns, logged))
        view = open_view(simulation.scenario, Path(name) / "log.rrd", live=False)
        stages["rerun"] = timed(lambda: _draw(view, snapshots))
    stages["capture"] = timed(lambda: _repeat(ahead.capture, count))
    full = ahead.capture()
    stages["restore"] = timed(lambda: _repeat(lambda: ahead.restore(full), count))
    return stages


def _repeat(call: Callable[[], object], count: int) -> None:
    for _ in range(count):
        call()


def _under_way(scenario: str, drive: str, speed: float, *, on_demand: bool) -> Simulation:
    simulation = Simulation(load_scenario(scenario), on_demand=on_demand)
    simulation.command(drive, speed=speed)
    return simulation


def _write(
    log: McapLog,
    encoder: MessageEncoder,
    snapshots: list[Snapshot],
    columns: list[tuple[str, ...]],
    frames: list[Messages],
) -> None:
    rows = RowEncoder(snapshots[0].layout)
    for snapshot, groups, messages in zip(snapshots, columns, frames, strict=True):
        stamp_ns = encoder.stamp_ns(snapshot)
        if (row := rows.encode(snapshot, groups)) is not None:
            log.write(COLUMNS, stamp_ns, row)
        for topic, data in messages:
            log.write(topic, stamp_ns, data)
    log.close()


def _draw(view: Any, snapshots: list[Snapshot]) -> None:
    for snapshot in snapshots:
        view.log(snapshot)
    view.close()


@contextmanager
def _publisher(table: tuple[Topic, ...]) -> Iterator[Callable[[Messages], None] | None]:
    """Publishers of the messages of a frame, as in the node, or None without rclpy."""
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    try:
        import rclpy  # noqa: PLC0415 - optional
        from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy  # noqa: PLC0415

    except ImportError:
        yield None
        return
    from cable_twin.ros.endpoints import message_class  # noqa: PLC0415 - needs rclpy

    context = rclpy.Context()
    rclpy.init(context=context, domain_id=os.getpid() % 80 + 20)
    node = rclpy.create_node("cable_twin_benchmark", context=context)
    try:
        publishers = {}
        for topic in table:
            name = topic.name if topic.name.startswith("/") else f"{NAMESPACE}/{topic.name}"
            kind = message_class(topic.type)
            quality = QoSProfile(
                depth=topic.depth,
                reliability=ReliabilityPolicy[topic.reliability.upper()],
                durability=DurabilityPolicy[topic.durability.upper()],
            )
            publishers[topic.name] = node.create_publisher(kind, name, quality)
            node.create_subscription(kind, name, _ignore, quality, raw=True)

        def publish(messages: Messages) -> None:
            for topic, data in messages:
                publishers[topic].publish(data)

        yield publish
    finally:
        node.destroy_node()
        rclpy.shutdown(context=context)


def _ignore(data: bytes) -> None:
    """Ignore a message."""
