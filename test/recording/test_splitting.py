"""Logs split into files: data on the disk at any time, removal of old files, full disks."""

from __future__ import annotations

import time
from errno import ENOSPC

import pytest
from logged_run import EPOCH, LAYOUT, METADATA, TABLE, make_snapshot, open_log, run_messages
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from ruamel.yaml import YAML
from small_tramway import TRAMWAY
from split_run import record_frame

from cable_twin.messages import SECOND, MessageEncoder, scenario_message, topics
from cable_twin.messages.columns import COLUMNS_TOPIC
from cable_twin.recording import mcap_file
from cable_twin.recording.log_file import LogError
from cable_twin.recording.log_reader import read_log
from cable_twin.recording.log_writer import McapLog
from cable_twin.recording.mcap_file import McapFile
from cable_twin.recording.recorder import Recorder
from cable_twin.recording.splitting import UNSPLIT, ClosedSize, Splitting
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation

STATE = b"a full state"


def information(directory):
    return YAML(typ="safe").load(directory / "metadata.yaml")["rosbag2_bagfile_information"]


def write_split(log: McapLog, files: int, frames: int = 5) -> list[tuple[str, int, bytes]]:
    """Write a log of equal files of `frames` frames, each 10 s after the previous one."""
    messages = []
    for number in range(files):
        if number:
            log.split(STATE)
        part = [(topic, stamp + number * 10 * SECOND, data) for topic, stamp, data in run_messages(frames)]
        for message in part:
            log.write(*message)
        messages += part
    return messages


def test_each_file_is_whole_and_metadata_lists_all(directory):
    log = open_log(directory)
    messages = write_split(log, 3)
    running = information(directory)
    assert running["relative_file_paths"] == [f"{directory.name}_{number}.mcap" for number in range(3)]
    assert [item["message_count"] for item in running["files"]] == [len(messages) // 3, len(messages) // 3, 0]
    assert [read_log(log.path_of(number)).complete for number in range(2)] == [True, True]
    log.close()
    final = information(directory)
    assert final["message_count"] == len(messages)
    assert final["starting_time"]["nanoseconds_since_epoch"] == EPOCH
    assert final["duration"]["nanoseconds"] == 20 * SECOND + 40_000_000
    starts = [item["starting_time"]["nanoseconds_since_epoch"] for item in final["files"]]
    assert starts == [EPOCH + number * 10 * SECOND for number in range(3)]
    for number in range(3):
        with log.path_of(number).open("rb") as stream:
            reader = make_reader(stream, validate_crcs=True)
            assert reader.get_summary().statistics.message_count == len(messages) // 3
            records = {record.name: record.metadata for record in reader.iter_metadata()}
            attached = [item.data for item in reader.iter_attachments()]
        assert records["cable_twin"]["file"] == str(number)
        assert records["cable_twin"]["epoch_ns"] == str(EPOCH)
        assert records["cable_twin"]["starts_from"] == ("snapshot.npz" if number else "scenario")
        assert attached == ([STATE] if number else [])
        own = YAML(typ="safe").load(records["rosbag2"]["serialized_metadata"])
        assert own["relative_file_paths"] == [log.path_of(number).name]
        assert own["message_count"] == len(messages) // 3


def test_directory_is_read_as_one_by_us_and_by_rosbags(directory):
    log = open_log(directory)
    messages = write_split(log, 12)  # more than ten: numbers, not names, give the order
    log.close()
    read = read_log(directory)
    assert list(read.messages()) == messages
    assert read.condition == "files 0 to 11, complete"
    assert read.end == 110.04
    assert read.size == sum(file.stat().st_size for file in directory.glob("*.mcap"))
    positions = []
    assert len(list(read.messages(["joint_states"], positions.append))) == 60
    assert positions == sorted(positions)
    assert 0.9 * read.size < positions[-1] <= read.size
    with AnyReader([directory]) as reader:
        assert reader.message_count == len(messages)
        found = [
            (item.topic.removeprefix("/cable_twin/"), stamp, bytes(data)) for item, stamp, data in reader.messages()
        ]
    assert sorted(found) == sorted(messages)


def test_metadata_comes_first_in_each_file(directory):
    log = McapLog(directory, TABLE, METADATA)
    with pytest.raises(ValueError, match="has not begun"):
        log.write(*run_messages(1)[0])
    log.begin(EPOCH, STATE)
    log.close()
    content = log.path.read_bytes()
    assert content.index(b"format_version") < content.index(STATE) < 10_000


def test_files_that_lasted_long_enough_go_with_their_recordings(directory):
    log = open_log(directory)
    for number in range(5):
        log.path_of(number).with_suffix(".rrd").write_bytes(b"drawn")
    (directory / "snapshot_60.000_s.npz").write_bytes(b"somebody's own")
    write_split(log, 5)
    now = EPOCH + 40 * SECOND
    log.remove_oldest(Splitting(keep_age=25.0), now)
    left = {log.path_of(number).name for number in (2, 3, 4)}
    assert {file.name for file in directory.glob("*.mcap")} == left
    assert {file.with_suffix(".mcap").name for file in directory.glob("*.rrd")} == left
    assert (directory / "snapshot_60.000_s.npz").exists()
    assert set(information(directory)["relative_file_paths"]) == left
    log.remove_oldest(Splitting(keep_age=1.0), now + 1000 * SECOND)  # never the running one
    assert [file.name for file in directory.glob("*.mcap")] == [log.path.name]
    log.close()
    assert information(directory)["message_count"] == len(run_messages(5))
    assert read_log(directory).complete


def test_files_beyond_the_size_go(directory):
    log = open_log(directory)
    write_split(log, 8, frames=40)
    size = log.path_of(1).stat().st_size
    log.remove_oldest(Splitting(keep_size=3.5 * size / 1e6), EPOCH)
    total = sum(file.stat().st_size for file in directory.glob("*.mcap"))
    assert 2.4 * size < total <= 3.5 * size
    log.close()
    assert read_log(directory).files[-1].number == 7


def test_saved_states_count_among_what_is_kept(directory):
    log = open_log(directory)
    write_split(log, 8, frames=40)
    size = log.path_of(1).stat().st_size
    for number in range(2):
        (directory / f"snapshot_{number}.000_s.npz").write_bytes(bytes(size))
    log.remove_oldest(Splitting(keep_size=5.5 * size / 1e6), EPOCH)
    assert 4.4 * size < sum(file.stat().st_size for file in directory.glob("*_*")) <= 5.5 * size
    assert len(list(directory.glob("snapshot_*"))) == 2
    log.close()


def test_what_is_kept():
    hour = 3600 * SECOND
    closed = [ClosedSize(number * hour, 100) for number in range(1, 5)]
    assert UNSPLIT.surplus(closed, 50, 5 * hour) == 0
    assert Splitting(keep_age=7200.0).surplus(closed, 50, 5 * hour) == 2
    assert Splitting(keep_size=0.00025).surplus(closed, 50, 5 * hour) == 2
    assert Splitting(keep_age=7200.0, keep_size=0.00015).surplus(closed, 50, 5 * hour) == 3
    assert Splitting(keep_size=0.00001).surplus(closed, 50, 5 * hour) == 4


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"split_duration": -1.0}, "split_duration: given -1 s; allowed: 0, or 1 s and more"),
        ({"split_duration": float("nan")}, "split_duration: given nan s; allowed: 0, or 1 s and more"),
        ({"split_size": 0.1}, "split_size: given 0.1 MB; allowed: 0, or 1 MB and more"),
        ({"keep_age": float("inf")}, "keep_age: given inf s; allowed: 0 s and more"),
        ({"keep_size": -5.0}, "keep_size: given -5 MB; allowed: 0 MB and more"),
        (
            {"keep_age": 60.0},
            "keep_age: given 60 s, less than a file; allowed: 0, or split_duration of 3600 s and more",
        ),
        (
            {"split_size": 10.0, "keep_size": 15.0},
            "keep_size: given 15 MB, less than two files; allowed: 0, or twice split_size, 20 MB, and more",
        ),
        (
            {"split_duration": 0.0, "keep_age": 60.0, "keep_size": 5.0},
            "keep_age and keep_size: given without splitting; allowed: with split_duration or split_size above 0",
        ),
    ],
)
def test_options_that_make_no_sense_are_named(given, said):
    assert Splitting(**given).faults() == [said]
    assert Splitting().faults() == []


def test_disk_that_refuses_the_next_file_leaves_the_closed_ones(directory):
    log = open_log(directory)
    write_split(log, 2)
    log.path_of(2).mkdir()
    with pytest.raises(FileExistsError):
        log.split(STATE)
    log.close()
    log.path_of(2).rmdir()
    assert information(directory)["relative_file_paths"] == [log.path_of(0).name, log.path_of(1).name]
    assert read_log(directory).condition == "files 0 to 1, complete"
    with AnyReader([directory]) as reader:
        assert reader.message_count == 2 * len(run_messages(5))


def test_disk_without_room_for_the_next_file_leaves_no_empty_one(directory, monkeypatch):
    log = open_log(directory)
    write_split(log, 2)

    def refuse(path):
        raise OSError(ENOSPC, "No space left on device", str(path))

    monkeypatch.setattr(mcap_file, "sync", refuse)  # the last thing that a new file does before it is taken
    with pytest.raises(OSError, match="No space left"):
        McapFile(log.path_of(2), log._topics)
    monkeypatch.undo()
    log.close()
    assert not log.path_of(2).exists()
    assert read_log(directory).condition == "files 0 to 1, complete"


def test_file_that_cannot_be_finished_is_readable_and_the_node_is_told(tmp_path):
    simulation = Simulation(load_scenario(TRAMWAY))
    table = (*topics(simulation.layout), COLUMNS_TOPIC)
    log = McapLog(tmp_path / "run", table, METADATA)
    recorder = Recorder(log, splitting=Splitting(split_duration=1.0))
    recorder.begin(EPOCH, 0.0, scenario_message(simulation.scenario.resolved()))
    encoder = MessageEncoder(simulation.layout, EPOCH)
    log.path_of(1).mkdir()
    for frame in range(200):
        snapshot = simulation.advance_to(frame * 0.01)
        record_frame(recorder, encoder, simulation, snapshot)
    recorder.close()
    log.path_of(1).rmdir()
    (fault,) = recorder.faults
    assert fault.startswith("recording: log stopped: [Errno 17] File exists: ")
    assert fault.endswith("; readable up to 0.99 s of simulated time, nothing later is written")
    assert read_log(tmp_path / "run").complete


def test_size_asks_for_one_file_at_a_time(tmp_path):
    """One new file at a time while a slow disk still closes a large one."""
    simulation = Simulation(load_scenario(TRAMWAY))
    log = McapLog(tmp_path / "run", TABLE, METADATA)
    recorder = Recorder(log, splitting=Splitting(split_duration=0.0, split_size=1.0))
    recorder.begin(EPOCH, 0.0, scenario_message(simulation.scenario.resolved()))
    encoder = MessageEncoder(LAYOUT, EPOCH)
    asked = 0
    for frame in range(3000):
        snapshot = make_snapshot(frame * 0.01)
        if recorder.split_due(snapshot.time):
            recorder.split(simulation.capture())
            assert not recorder.split_due(snapshot.time)
            asked += 1
        while recorder.backlog > 50:
            assert recorder.recording
            time.sleep(0.001)  # the core is for what writes
        recorder.record(encoder.frame(snapshot), encoder.stamp_ns(snapshot), snapshot)
    recorder.close()
    assert recorder.faults == []
    sizes = [log.path_of(number).stat().st_size for number in range(asked + 1)]
    assert asked >= 2
    assert all(1e6 <= size < 3e6 for size in sizes[:-1])
    assert len(list(read_log(log.directory).messages(["joint_states"]))) == 3000


def test_files_of_several_runs_are_no_log(tmp_path):
    for name in ("a", "b"):
        log = open_log(tmp_path / name)
        write_split(log, 1)
        log.close()
    (tmp_path / "b/b_0.mcap").replace(tmp_path / "a/b_0.mcap")
    with pytest.raises(LogError, match=r"given .mcap files of several runs: a, b; allowed: one run$"):
        read_log(tmp_path / "a")
