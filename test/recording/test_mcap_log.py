"""Logs as written, read back by this package and by other programs."""

from __future__ import annotations

import math
import sys

import pytest
from bags import rerun_command
from logged_run import COMMANDS, EPOCH, METADATA, SCENARIO_VALUES, open_log, run_messages, write_run
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from rosbags.interfaces import QosDurability, QosReliability
from ruamel.yaml import YAML

from cable_twin.messages import TYPESTORE, TopicNames
from cable_twin.recording import mcap_file
from cable_twin.recording.log_reader import read_log
from cable_twin.recording.log_writer import FORMAT_VERSION


def test_a_finished_log_is_read_back(finished):
    log, messages = finished
    for path in (log.directory, log.path, str(log.path)):
        read = read_log(path)
        assert read.complete
        assert read.metadata.items() >= METADATA.items()
        assert (read.metadata["format_version"], read.metadata["namespace"]) == (FORMAT_VERSION, "/cable_twin")
        assert read.epoch_ns == EPOCH
        assert read.scenario == SCENARIO_VALUES
        assert read.commands == COMMANDS
        assert list(read.messages()) == messages
        assert list(read.messages(["cable_path"])) == [entry for entry in messages if entry[0] == "cable_path"]


def test_order_and_commands_are_the_same_over_many_chunks_with_and_without_index(directory):
    log = open_log(directory)
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
        assert reader.deserialize(messages[2][2], "sensor_msgs/msg/JointState").name == ["cabin", "cabin_hanger"]


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
    log = open_log(directory)
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
    log = open_log(directory, names=TopicNames("/valley/twin", {"joint_states": "/js"}))
    messages = write_run(log, 5)
    log.close()
    assert list(read_log(directory).messages()) == messages
    with AnyReader([directory]) as reader:
        assert {"/valley/twin/cable", "/js", "/diagnostics"} <= {connection.topic for connection in reader.connections}


def test_equal_runs_give_equal_files(tmp_path, monkeypatch):
    monkeypatch.setattr(mcap_file, "FLUSH_PERIOD", math.inf)  # chunks also end by wall time
    for name in ("a", "b"):
        log = open_log(tmp_path / name / "run")
        write_run(log, 10)
        log.close()
    assert (tmp_path / "a/run/run_0.mcap").read_bytes() == (tmp_path / "b/run/run_0.mcap").read_bytes()


def test_a_log_is_never_overwritten(finished):
    log, _ = finished
    with pytest.raises(FileExistsError):
        open_log(log.directory)
    assert read_log(log.directory).complete


def test_a_closed_log_takes_nothing(finished):
    log, messages = finished
    with pytest.raises(ValueError, match="closed"):
        log.write(*messages[0])


def test_an_unknown_topic_is_refused_and_the_log_goes_on(directory):
    log = open_log(directory)
    with pytest.raises(ValueError, match="'/clock' was not declared"):
        log.write("/clock", EPOCH, b"")
    messages = write_run(log, 3)
    log.close()
    assert list(read_log(directory).messages()) == messages


def test_index_is_kept_packed_and_comes_out_whole(directory):
    log = open_log(directory)
    packed = log._file._writer.packed
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
    log, _ = finished
    rerun_command("mcap", "check", log.path)
