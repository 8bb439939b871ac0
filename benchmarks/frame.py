"""What one frame of the twin costs, stage by stage, with the code that the node runs."""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich.progress import Progress

from benchmarks.measure import Effort, Timing, median, note_on_load, timed
from benchmarks.report import Part, Table, Value
from cable_twin.messages import NAMESPACE, MessageEncoder, Topic, topics
from cable_twin.recording.mcap_log import McapLog, run_metadata
from cable_twin.recording.run import open_view
from cable_twin.records import Snapshot
from cable_twin.scenario import load_scenario
from cable_twin.simulation import SAMPLES, Simulation

SCENARIO = "aerial_tramway"
PERIOD = 0.01  # s
FRAMES = 1000
SPEED = 7.0  # m/s

Messages = list[tuple[str, bytes]]


def run(effort: Effort, progress: Progress) -> Part:
    """Run all stages in turn, round after round."""
    count = 50 if effort.quick else FRAMES
    _round(2)  # codecs are made on their first use
    rounds = [
        _round(count) for _ in progress.track(range(effort.repetitions), description=f"{count} frames, stage by stage")
    ]
    stages = {stage: median([one[stage] for one in rounds]) for stage in rounds[0]}
    both = stages.pop("solve and sample")
    solve = stages.pop("solve")
    sample = Timing(both.wall - solve.wall, both.processor - solve.processor)
    split = {"solve": solve, "sample": sample, **stages}
    split["all"] = Timing(sum(one.wall for one in split.values()), sum(one.processor for one in split.values()))
    rows: list[dict[str, Value]] = [
        {
            "stage": stage,
            "wall per frame [µs]": timing.wall / count * 1e6,
            "processor [µs]": timing.processor / count * 1e6,
            "of a frame of 10 ms [%]": timing.wall / count / PERIOD * 1e2,
        }
        for stage, timing in split.items()
    ]
    notes = [
        f"`{SCENARIO}` at {SPEED:g} m/s, {count} frames of {PERIOD * 1e3:g} ms in each round.",
        "Solve: all frames in one call. Sample: the difference to one call a frame, which reads a snapshot each time.",
        "MCAP and rerun: writing, compressing and closing, in the recorder's thread of the node; the threads of rerun "
        "itself come on top.",
    ]
    if "publish" in split:
        notes.append(
            "Publish: every topic of a frame as raw bytes over DDS, with a subscriber to each in this process."
        )
    else:
        notes.append("Publish is missing: rclpy is not installed (`pip install '.[ros]'`).")
    return Part(
        "A frame",
        [Table("stages of a frame", rows)],
        [*notes, note_on_load([solve, both])],
    )


def _round(count: int) -> dict[str, Timing]:
    """Every stage over the same frames."""
    times = [(index + 1) * PERIOD for index in range(count)]
    stages: dict[str, Timing] = {}
    ahead, simulation = _under_way(), _under_way()
    stages["solve"] = timed(lambda: ahead.advance_to(times[-1]))
    snapshots: list[Snapshot] = []
    stages["solve and sample"] = timed(lambda: snapshots.extend(map(simulation.advance_to, times)))
    epoch_ns = time.time_ns()
    encoder = MessageEncoder(simulation.carriages, epoch_ns, simulation.drives)
    frames: list[Messages] = []
    stages["serialise"] = timed(lambda: frames.extend(map(encoder.frame, snapshots)))
    table = topics(simulation.carriages, supports=simulation.supports)
    with _publisher(table) as publish:
        if publish is not None:
            stages["publish"] = timed(lambda: [publish(messages) for messages in frames])
    with tempfile.TemporaryDirectory(prefix="frame-") as name:
        metadata = run_metadata(scenario=SCENARIO, frame_period=PERIOD, sample_count=SAMPLES)
        log = McapLog(Path(name) / "log", table, metadata)
        log.begin(epoch_ns)
        stages["MCAP"] = timed(lambda: _write(log, encoder, snapshots, frames))
        view = open_view(simulation.scenario, Path(name) / "log.rrd", live=False)
        stages["rerun"] = timed(lambda: _draw(view, snapshots))
    return stages


def _under_way() -> Simulation:
    simulation = Simulation(load_scenario(SCENARIO))
    simulation.command("cabin", speed=SPEED)
    return simulation


def _write(log: McapLog, encoder: MessageEncoder, snapshots: list[Snapshot], frames: list[Messages]) -> None:
    for snapshot, messages in zip(snapshots, frames, strict=True):
        stamp_ns = encoder.stamp_ns(snapshot)
        for topic, data in messages:
            log.write(topic, stamp_ns, data)
    log.close()


def _draw(view: Any, snapshots: list[Snapshot]) -> None:
    for snapshot in snapshots:
        view.log(snapshot)
    view.close()


@contextmanager
def _publisher(table: tuple[Topic, ...]) -> Iterator[Callable[[Messages], None] | None]:
    """What publishes the messages of a frame as the node does, or None without rclpy."""
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    try:
        import rclpy  # noqa: PLC0415 - optional
        from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy  # noqa: PLC0415

        from cable_twin.ros.node import MESSAGE_TYPES  # noqa: PLC0415
    except ImportError:
        yield None
        return
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=os.getpid() % 80 + 20)
    node = rclpy.create_node("cable_twin_benchmark", context=context)
    try:
        known = [topic for topic in table if topic.type in MESSAGE_TYPES]
        publishers = {}
        for topic in known:
            name = topic.name if topic.name.startswith("/") else f"{NAMESPACE}/{topic.name}"
            kind = MESSAGE_TYPES[topic.type]
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
    """Take a message and do nothing with it."""
