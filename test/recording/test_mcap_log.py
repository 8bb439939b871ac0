from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from rosbags.interfaces import QosDurability, QosReliability
from rosbags.rosbag2 import StoragePlugin, Writer
from ruamel.yaml import YAML

import cable_twin
from cable_twin.command_messages import applied_command_message
from cable_twin.messages import APPLIED_COMMANDS, SCENARIO, TYPESTORE, MessageEncoder, decode, scenario_message, topics
from cable_twin.recording.log_reader import LogError, read_log
from cable_twin.recording.mcap_log import McapLog, run_metadata
from cable_twin.recording.recorder import Recorder
from cable_twin.records import (
    AppliedCommand,
    BodyState,
    CableSamples,
    CarriageState,
    Command,
    Snapshot,
    SolverReport,
)

CARRIAGES = {"cabin": ("hanger",)}
EPOCH = 1_700_000_000_123_456_789
SCENARIO_VALUES = {"description": "Prüfstand", "cable": {"elements": 24}}
METADATA = run_metadata(scenario="bench", epoch_ns=EPOCH, frame_period=0.01, sample_count=50)
COMMANDS = [
    AppliedCommand(0.0, Command("speed", {"cabin": 1.5}), "joint_commands"),
    AppliedCommand(0.123456, Command("force", {"cabin": -20.0}), "script"),
    AppliedCommand(0.25, Command("emergency_stop", {}), "service"),
]


def make_snapshot(time: float, samples: int = 50) -> Snapshot:
    pair = np.array([time, 1.0])
    cabin = CarriageState(3.5, 6.0, 120.0, pair, pair, {"hanger": BodyState(time, 0.0, 0.3, 0.1, 0.0, -0.02)})
    arc_lengths = np.linspace(0.0, 4.0, samples)
    noise = np.random.default_rng(round(time * 1e6)).normal(size=(samples, 2))
    return Snapshot(
        time, {"cabin": cabin}, {}, CableSamples(arc_lengths, noise, arc_lengths), SolverReport(1, 2, 0, 0.0)
    )


def run_messages(frames: int) -> list[tuple[str, int, bytes]]:
    """Scenario, frames at 100 Hz and commands."""
    encoder = MessageEncoder(CARRIAGES, EPOCH)
    messages = [(SCENARIO, EPOCH, scenario_message(SCENARIO_VALUES))]
    waiting = list(COMMANDS)
    for frame in range(frames):
        snapshot = make_snapshot(frame / 100)
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


@pytest.fixture
def directory(tmp_path):
    return tmp_path / "logs" / "2024-01-01T00-00-00"


@pytest.fixture
def finished(directory):
    with_clock = topics(CARRIAGES, clock=True)  # a channel without messages
    log = McapLog(directory, with_clock, METADATA)
    messages = write_run(log, 40)
    log.close()
    return log, messages


def test_a_finished_log_is_read_back(finished):
    log, messages = finished
    for path in (log.directory, log.path, str(log.path)):
        read = read_log(path)
        assert read.complete
        assert read.metadata.items() >= METADATA.items()
        assert (read.metadata["format_version"], read.metadata["namespace"]) == ("1", "/cable_twin")
        assert read.epoch_ns == EPOCH
        assert read.scenario == SCENARIO_VALUES
        assert read.commands == COMMANDS
        assert list(read.messages()) == messages
        assert list(read.messages(["cable_path"])) == [entry for entry in messages if entry[0] == "cable_path"]


def test_order_and_commands_are_the_same_over_many_chunks_with_and_without_index(directory):
    log = McapLog(directory, topics(CARRIAGES), METADATA)
    messages = run_messages(60)
    for count, message in enumerate(messages):
        log.write(*message)
        if count % 17 == 0:
            log.flush()
    log.close()
    whole = log.path.read_bytes()
    for complete, data in [(True, whole), (False, whole[:-1])]:  # without its last byte, a file is read as a stream
        log.path.write_bytes(data)
        read = read_log(directory)
        assert read.complete is complete
        assert list(read.messages()) == messages
        assert list(read.messages(["cable"])) == [message for message in messages if message[0] == "cable"]
        assert read.commands == COMMANDS


def test_rosbags_opens_the_directory(finished):
    log, messages = finished
    with AnyReader([log.directory]) as reader:
        assert reader.message_count == len(messages)
        # AnyReader counts to one past the last message
        assert reader.duration == max(stamp for _, stamp, _ in messages) - EPOCH + 1
        read = [(c.topic.removeprefix("/cable_twin/"), t, bytes(d)) for c, t, d in reader.messages()]
        assert sorted(read) == sorted(messages)
        connections = {connection.topic: connection for connection in reader.connections}
        assert connections["/cable_twin/joint_states"].digest == TYPESTORE.hash_rihs01("sensor_msgs/msg/JointState")
        (qos,) = connections["/cable_twin/scenario"].ext.offered_qos_profiles
        assert (qos.durability, qos.reliability, qos.depth) == (
            QosDurability.TRANSIENT_LOCAL,
            QosReliability.RELIABLE,
            1,
        )
        assert "/clock" in connections
        assert reader.deserialize(messages[1][2], "sensor_msgs/msg/JointState").name == ["cabin", "cabin/hanger"]


def test_rosbags_opens_the_file_alone(finished):
    log, messages = finished
    with AnyReader([log.path]) as reader:
        assert reader.message_count == len(messages)


def test_mcap_is_as_rosbag2_writes_it(finished):
    log, messages = finished
    with log.path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        assert reader.get_header().profile == "ros2"
        summary = reader.get_summary()
        assert summary.statistics.message_count == len(messages)
        assert {schema.encoding for schema in summary.schemas.values()} == {"ros2msg"}
        assert {chunk.compression for chunk in summary.chunk_indexes} == {"zstd"}
        for channel in summary.channels.values():
            assert channel.message_encoding == "cdr"
            type_name = summary.schemas[channel.schema_id].name
            assert channel.metadata["topic_type_hash"] == TYPESTORE.hash_rihs01(type_name)
            (qos,) = YAML(typ="safe").load(channel.metadata["offered_qos_profiles"])
            assert (qos["history"], qos["deadline"]) == ("keep_last", {"sec": 9223372036, "nsec": 854775807})
        records = {record.name: record.metadata for record in reader.iter_metadata()}
        last = YAML(typ="safe").load(records["rosbag2"]["serialized_metadata"])
        assert last["message_count"] == len(messages)
        for _, _, message in reader.iter_messages():
            assert message.log_time == message.publish_time


def test_metadata_yaml_is_there_from_the_start_and_final_in_the_end(directory):
    log = McapLog(directory, topics(CARRIAGES), METADATA)
    yaml = YAML(typ="safe")
    preliminary = yaml.load(directory / "metadata.yaml")["rosbag2_bagfile_information"]
    assert (preliminary["version"], preliminary["message_count"]) == (9, 0)
    messages = write_run(log, 20)
    log.close()
    log.close()
    text = (directory / "metadata.yaml").read_text()
    assert "&" not in text  # no YAML anchors: rosbag2 writes none
    assert "type_description_hash: RIHS01_" in text  # on one line
    final = yaml.load(text)["rosbag2_bagfile_information"]
    assert final["relative_file_paths"] == [f"{directory.name}_0.mcap"]
    assert final["message_count"] == len(messages) == final["files"][0]["message_count"]
    assert final["duration"]["nanoseconds"] == 190_000_000
    assert final["starting_time"]["nanoseconds_since_epoch"] == EPOCH
    counts = {t["topic_metadata"]["name"]: t["message_count"] for t in final["topics_with_message_count"]}
    assert counts["/cable_twin/joint_states"] == 20
    assert sorted(path.name for path in directory.iterdir()) == [f"{directory.name}_0.mcap", "metadata.yaml"]


def test_another_node_name_changes_topics_in_the_file_only(directory):
    log = McapLog(directory, topics(CARRIAGES), METADATA, namespace="/valley/twin")
    messages = write_run(log, 5)
    log.close()
    assert list(read_log(directory).messages()) == messages
    with AnyReader([directory]) as reader:
        assert {"/valley/twin/joint_states", "/diagnostics"} <= {connection.topic for connection in reader.connections}


def test_equal_runs_give_equal_files(tmp_path):
    for name in ("a", "b"):
        log = McapLog(tmp_path / name / "run", topics(CARRIAGES), METADATA)
        write_run(log, 10)
        log.close()
    assert (tmp_path / "a/run/run_0.mcap").read_bytes() == (tmp_path / "b/run/run_0.mcap").read_bytes()


def test_a_log_is_never_overwritten(finished):
    log, _ = finished
    with pytest.raises(FileExistsError):
        McapLog(log.directory, topics(CARRIAGES), METADATA)
    assert read_log(log.directory).complete


def test_a_closed_log_takes_nothing(finished):
    log, messages = finished
    with pytest.raises(ValueError, match="closed"):
        log.write(*messages[0])


def test_an_unknown_topic_is_refused_and_the_log_goes_on(directory):
    log = McapLog(directory, topics(CARRIAGES), METADATA)
    with pytest.raises(ValueError, match="'/clock' was not declared"):
        log.write("/clock", EPOCH, b"")
    messages = write_run(log, 3)
    log.close()
    assert list(read_log(directory).messages()) == messages


def test_every_cut_is_read_up_to_the_last_whole_chunk(directory):
    log = McapLog(directory, topics(CARRIAGES), METADATA)
    messages = []
    ends = []  # size of the file after a flush, messages so far
    for message in run_messages(20):
        log.write(*message)
        messages.append(message)
        if len(messages) % 20 == 0:
            log.flush()
            ends.append((log.path.stat().st_size, len(messages)))
    log.close()
    whole = log.path.read_bytes()
    for size in np.random.default_rng(2).integers(ends[0][0], len(whole), 200).tolist():
        log.path.write_bytes(whole[:size])
        read = read_log(directory)
        assert not read.complete
        count = max(count for end, count in ends if end <= size)
        got = list(read.messages())
        assert got == messages[: len(got)]
        assert len(got) >= count


def test_zeros_at_the_end_as_after_a_power_cut(finished):
    log, messages = finished
    with log.path.open("ab") as stream:
        stream.write(bytes(5000))
    read = read_log(log.path)
    assert not read.complete
    assert list(read.messages()) == messages


def test_damage_inside_a_finished_log_is_said(finished):
    log, _ = finished
    whole = bytearray(log.path.read_bytes())
    with log.path.open("rb") as stream:
        chunk = make_reader(stream).get_summary().chunk_indexes[-1]
    middle = chunk.chunk_start_offset + chunk.chunk_length // 2
    whole[middle : middle + 50] = bytes(50)
    log.path.write_bytes(whole)
    with pytest.raises(LogError, match=rf"{log.path.name}: .*") as caught:
        list(read_log(log.path).messages())
    assert "\n" not in str(caught.value)


def complaint(path) -> str:
    with pytest.raises(LogError) as caught:
        read_log(path)
    assert "\n" not in str(caught.value)
    assert str(path) in str(caught.value)
    return str(caught.value)


def test_what_is_no_log_is_said_in_one_line(tmp_path, finished):
    log, _ = finished
    assert "no such file" in complaint(tmp_path / "nowhere")
    (tmp_path / "empty").mkdir()
    assert "0 .mcap files" in complaint(tmp_path / "empty")
    (tmp_path / "notes.mcap").write_text("not an MCAP at all, but some text")
    assert "not a bag" in complaint(tmp_path / "notes.mcap")
    (tmp_path / "nothing.mcap").touch()
    assert "not a bag" in complaint(tmp_path / "nothing.mcap")
    (tmp_path / "head.mcap").write_bytes(log.path.read_bytes()[:20])
    assert "not a bag, or empty" in complaint(tmp_path / "head.mcap")


def test_a_log_without_messages_or_scenario_is_said(tmp_path):
    log = McapLog(tmp_path / "empty", topics(CARRIAGES), METADATA)
    assert "empty: no message" in complaint(log.path)  # while it is written
    log.close()
    assert "empty: no message" in complaint(log.path)
    log = McapLog(tmp_path / "bare", topics(CARRIAGES), METADATA)
    log.write(*run_messages(1)[1])
    log.close()
    assert "no scenario" in complaint(log.path)


def test_bags_of_others_and_of_other_versions_are_said(tmp_path):
    with Writer(tmp_path / "foreign", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection("/chatter", "std_msgs/msg/String", typestore=TYPESTORE)
        writer.write(connection, 1, scenario_message({}))
    assert "not a bag made by cable_twin" in complaint(tmp_path / "foreign")
    for name, metadata, words in [
        ("later", {**METADATA, "format_version": "2"}, "format version 2 is newer than this cable_twin reads (1)"),
        ("strange", {**METADATA, "format_version": "one"}, "format version 'one', this package reads '1'"),
        ("timeless", {**METADATA, "epoch_ns": "-1"}, "epoch_ns is '-1'"),
    ]:
        log = McapLog(tmp_path / name, topics(CARRIAGES), metadata)
        write_run(log, 1)
        log.close()
        assert words in complaint(log.path)


def test_index_is_kept_packed_and_comes_out_whole(directory):
    log = McapLog(directory, topics(CARRIAGES), METADATA)
    packed = log._writer.packed
    for message in run_messages(50):
        log.write(*message)
        log.flush()
    count = len(run_messages(50))
    assert len(packed) == count
    assert sum(sys.getsizeof(index._record) for index in packed) < count * 250
    log.close()
    with log.path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert len(summary.chunk_indexes) == summary.statistics.chunk_count == count
    assert all(len(index.message_index_offsets) == 1 for index in summary.chunk_indexes)


def test_rerun_finds_nothing_wrong(finished):
    rerun = Path(sys.executable).with_name("rerun")
    log, _ = finished
    checked = subprocess.run(
        [rerun, "mcap", "check", log.path], capture_output=True, text=True, check=False, timeout=60
    )
    assert checked.returncode == 0, checked.stdout + checked.stderr


KILLED = """
import sys, time
from pathlib import Path
from test_mcap_log import *

log = McapLog(Path(sys.argv[1]), topics(CARRIAGES), METADATA)
recorder = Recorder(log)
recorder.record([(SCENARIO, scenario_message(SCENARIO_VALUES))], EPOCH)
for applied in COMMANDS[:1]:
    recorder.record_command(applied, applied_command_message(applied, EPOCH), EPOCH)
encoder = MessageEncoder(CARRIAGES, EPOCH)
start = time.monotonic()
for frame in range(10_000):
    snapshot = make_snapshot(frame / 100)
    recorder.record(encoder.frame(snapshot), encoder.stamp_ns(snapshot), snapshot)
    print(frame, flush=True)
    time.sleep(max(0.0, start + (frame + 1) / 100 - time.monotonic()))
"""


def child_environment() -> dict[str, str]:
    paths = [str(Path(cable_twin.__file__).parents[1]), str(Path(__file__).parent)]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(paths)}


def test_kill_loses_less_than_a_second(directory):
    child = subprocess.Popen(
        [sys.executable, "-c", KILLED, str(directory)], stdout=subprocess.PIPE, text=True, env=child_environment()
    )
    last = 0
    for line in child.stdout:
        last = int(line)
        if last == 230:
            child.send_signal(signal.SIGKILL)
    assert child.wait(10) == -signal.SIGKILL
    read = read_log(directory)
    assert not read.complete
    assert read.scenario == SCENARIO_VALUES
    assert read.commands == COMMANDS[:1]
    frames = [data for name, _, data in read.messages(["joint_states"])]
    assert last - 100 < len(frames) - 1 <= last + 1
    stamp = decode(frames[-1], "sensor_msgs/msg/JointState").header.stamp
    assert stamp.sec * 10**9 + stamp.nanosec == EPOCH + (len(frames) - 1) * 10**7


FULL_DISK = """
import resource, sys
from pathlib import Path
from test_mcap_log import *

resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000))
log = McapLog(Path(sys.argv[1]), topics(CARRIAGES), METADATA)
view = FakeView()
recorder = Recorder(log, view)
recorder.record([(SCENARIO, scenario_message(SCENARIO_VALUES))], EPOCH)
encoder = MessageEncoder(CARRIAGES, EPOCH)
for frame in range(300):
    snapshot = make_snapshot(frame / 100)
    recorder.record(encoder.frame(snapshot), encoder.stamp_ns(snapshot), snapshot)
    if frame % 30 == 0:
        time.sleep(0.2)
recorder.close()
log.close()
print(json.dumps([recorder.faults, len(view.seen), view.closed]))
"""


def test_a_full_disk_ends_the_log_only_and_leaves_it_readable(directory):
    done = subprocess.run(
        [sys.executable, "-c", FULL_DISK, str(directory)],
        capture_output=True,
        text=True,
        check=True,
        env=child_environment(),
        timeout=60,
    )
    faults, seen, closed = json.loads(done.stdout)
    assert (seen, closed) == (300, 1)
    assert len(faults) == 1
    assert "log stopped" in faults[0]
    assert "File too large" in faults[0]
    read = read_log(directory)
    assert not read.complete
    assert len(list(read.messages(["joint_states"]))) > 10


class FakeView:
    flush_period = 0.5

    def __init__(self, broken_after: int | None = None) -> None:
        self.seen: list[float] = []
        self.commands: list[AppliedCommand] = []
        self.flushes = 0
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

    def close(self):
        self.closed += 1


def record_run(recorder: Recorder, frames: int) -> None:
    encoder = MessageEncoder(CARRIAGES, EPOCH)
    recorder.record([(SCENARIO, scenario_message(SCENARIO_VALUES))], EPOCH)
    for applied in COMMANDS:
        recorder.record_command(applied, applied_command_message(applied, EPOCH), EPOCH + round(applied.time * 1e9))
    for frame in range(frames):
        snapshot = make_snapshot(frame / 100)
        recorder.record(encoder.frame(snapshot), encoder.stamp_ns(snapshot), snapshot)


def test_recorder_writes_log_and_view(directory):
    view = FakeView()
    recorder = Recorder(McapLog(directory, topics(CARRIAGES), METADATA), view)
    record_run(recorder, 30)
    time.sleep(0.7)
    assert recorder.backlog == 0
    assert view.flushes >= 1
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
    assert recorder.dropped == 2 + len(COMMANDS)


def test_messages_reach_the_disk_where_no_more_follow(directory):
    recorder = Recorder(McapLog(directory, topics(CARRIAGES), METADATA))
    record_run(recorder, 10)
    time.sleep(0.9)
    assert len(list(read_log(directory).messages(["joint_states"]))) == 10
    recorder.close()


def test_a_broken_view_does_not_stop_the_log(directory):
    view = FakeView(broken_after=3)
    recorder = Recorder(McapLog(directory, topics(CARRIAGES), METADATA), view)
    record_run(recorder, 20)
    recorder.close()
    assert recorder.faults == ["recording: view stopped: no more paper"]
    assert view.closed == 1
    assert len(list(read_log(directory).messages(["joint_states"]))) == 20


def test_frames_too_many_are_dropped_and_commands_never():
    gate = threading.Event()

    class SlowView(FakeView):
        def log(self, snapshot):
            gate.wait(10)
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
