"""Logs cut or damaged by a kill or a full disk, and files that are no logs."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from bags import chunk_with, chunks_of, flip_chunk
from logged_run import COMMANDS, EPOCH, METADATA, SCENARIO_VALUES, open_log, run_messages, write_run
from rosbags.rosbag2 import StoragePlugin, Writer

import cable_twin
from cable_twin.messages import TYPESTORE, decode, scenario_message
from cable_twin.recording.log_file import LogError
from cable_twin.recording.log_reader import read_log


def test_every_cut_is_read_up_to_the_last_whole_chunk(directory):
    log = open_log(directory)
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


def write_in_chunks(directory, frames=200) -> tuple[Path, list]:
    """Write a finished log with ten frames in each chunk."""
    log, messages = open_log(directory), run_messages(frames)
    for number, message in enumerate(messages):
        log.write(*message)
        if number % 50 == 49:
            log.flush()
    log.close()
    return log.path, messages


@pytest.mark.parametrize("finished", [True, False], ids=["index", "no index"])
def test_a_flipped_bit_costs_the_chunk_that_it_is_in(directory, finished):
    path, messages = write_in_chunks(directory)
    whole, chunks = path.read_bytes(), chunks_of(path)
    assert len(chunks) > 10
    for number in (1, 2, len(chunks) // 2, len(chunks) - 1):  # the first declares channels
        path.write_bytes(whole if finished else whole[: -len(whole) // 100])
        flip_chunk(path, chunks[number])
        read = read_log(directory)
        got = list(read.messages())
        lost = [message for message in messages if message not in got]
        assert got == [message for message in messages if message not in lost]
        first = messages.index(lost[0])
        assert lost == messages[first : first + len(lost)]  # in one place
        assert len(lost) <= 50
        (said,) = read.damage
        assert "checksum" in said or "zstd" in said or "decompress" in said
        assert read.scenario == SCENARIO_VALUES


@pytest.mark.parametrize("finished", [True, False], ids=["index", "no index"])
def test_a_damaged_first_chunk_costs_what_is_in_it_and_no_more(directory, finished):
    path, messages = write_in_chunks(directory)
    whole, first = path.read_bytes(), chunks_of(path)[0]
    if not finished:
        path.write_bytes(whole[: -len(whole) // 100])
    flip_chunk(path, first)
    read = read_log(directory)
    got = list(read.messages())
    assert len(messages) - len(got) <= 51 + (not finished) * 50
    assert got == messages[-len(got) :] if finished else got[0] in messages
    assert read.scenario == SCENARIO_VALUES
    assert len(read.damage) == 1


def test_damage_to_the_declarations_alone_costs_nothing(directory):
    path, messages = write_in_chunks(directory)
    whole = bytearray(path.read_bytes()[: -path.stat().st_size // 100])
    place = bytes(whole).index(b"\x04\x00\x00\x00zstd") + 40  # of the first chunk in the file
    assert place < chunks_of(path)[0].chunk_start_offset
    whole[place] ^= 0x10
    path.write_bytes(whole)
    read = read_log(directory)
    got = list(read.messages())
    assert got == messages[: len(got)]
    assert len(got) > 0.9 * len(messages)
    assert not read.damage


@pytest.mark.parametrize("finished", [True, False], ids=["index", "no index"])
def test_100_random_bytes_cost_the_chunks_that_they_are_in(directory, finished):
    path, messages = write_in_chunks(directory)
    whole, chunks = path.read_bytes(), chunks_of(path)
    rng = np.random.default_rng(3)
    for _ in range(20):
        damaged = bytearray(whole if finished else whole[: chunks[-1].chunk_start_offset])
        place = int(rng.integers(chunks[1].chunk_start_offset, chunks[-1].chunk_start_offset - 100))
        damaged[place : place + 100] = rng.bytes(100)
        path.write_bytes(damaged)
        hit = [
            c for c in chunks if c.chunk_start_offset < place + 100 and place < c.chunk_start_offset + c.chunk_length
        ]
        got = list(read_log(directory).messages())
        missing = [message for message in messages if message not in got]
        assert len(missing) <= 50 * (len(hit) + (not finished))


def test_the_scenario_is_in_the_metadata_too(directory):
    path, _ = write_in_chunks(directory)
    flip_chunk(path, chunk_with(path, "scenario"))
    read = read_log(directory)
    assert read.scenario == SCENARIO_VALUES
    content = path.read_bytes()
    assert content.count("Prüfstand".encode()) == 1
    path.write_bytes(content.replace("Prüfstand".encode(), b"Prufstand "))  # which no checksum of MCAP finds
    assert "damaged" in complaint(path)


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
    log = open_log(tmp_path / "empty")
    assert "empty: no message" in complaint(log.path)  # while it is written
    log.close()
    assert "empty: no message" in complaint(log.path)
    log = open_log(tmp_path / "bare", metadata={**METADATA, "scenario_text": ""})
    log.write(*run_messages(1)[1])
    log.close()
    assert "no scenario" in complaint(log.path)


def test_bags_of_others_and_of_other_versions_are_said(tmp_path):
    with Writer(tmp_path / "foreign", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection("/chatter", "std_msgs/msg/String", typestore=TYPESTORE)
        writer.write(connection, 1, scenario_message({}))
    assert "not a bag made by cable_twin" in complaint(tmp_path / "foreign")
    for name, metadata, words in [
        ("later", {**METADATA, "format_version": "6"}, "format version 6 is newer than this cable_twin reads (5)"),
        ("strange", {**METADATA, "format_version": "one"}, "format version 'one', this cable_twin reads 5; made by "),
        ("earlier", {**METADATA, "format_version": "4"}, "format version '4', this cable_twin reads 5; made by "),
        ("timeless", {**METADATA, "epoch_ns": "-1"}, "epoch_ns: given '-1'"),
        ("pointless", {**METADATA, "sample_count": "many"}, "sample_count: given 'many'; allowed: a whole number of"),
    ]:
        log = open_log(tmp_path / name, metadata=metadata)
        write_run(log, 1)
        log.close()
        assert words in complaint(log.path)


KILLED = """
import sys, time
from pathlib import Path
from logged_run import *
from test_recorder import *

log = McapLog(Path(sys.argv[1]), TABLE, METADATA)
recorder = Recorder(log)
recorder.begin(EPOCH, 0.0, scenario_message(SCENARIO_VALUES))
for applied in COMMANDS[:1]:
    recorder.record_command(applied, applied_command_message(applied, EPOCH), EPOCH)
encoder = MessageEncoder(LAYOUT, EPOCH)
start = time.monotonic()
for frame in range(10_000):
    snapshot = make_snapshot(frame / 100)
    recorder.record(encoder.frame(snapshot), encoder.stamp_ns(snapshot), snapshot)
    print(frame, flush=True)
    time.sleep(max(0.0, start + (frame + 1) / 100 - time.monotonic()))
"""


def child_environment() -> dict[str, str]:
    here = Path(__file__).parent
    paths = [str(Path(cable_twin.__file__).parents[1]), str(here), str(here.parent)]
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
    assert child.wait(60) == -signal.SIGKILL
    read = read_log(directory)
    assert not read.complete
    assert read.scenario == SCENARIO_VALUES
    assert read.commands == COMMANDS[:1]
    frames = [data for name, _, data in read.messages(["joint_states"])]
    assert last - 100 < len(frames) - 1 <= last + 1
    stamp = decode(frames[-1], "sensor_msgs/msg/JointState").header.stamp
    assert stamp.sec * 10**9 + stamp.nanosec == EPOCH + (len(frames) - 1) * 10**7


FULL_DISK = """
import json, resource, sys, time
from pathlib import Path
from logged_run import *
from test_recorder import *

resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000))
log = McapLog(Path(sys.argv[1]), TABLE, METADATA)
view = FakeView()
recorder = Recorder(log, view)
recorder.begin(EPOCH, 0.0, scenario_message(SCENARIO_VALUES))
encoder = MessageEncoder(LAYOUT, EPOCH)
for frame in range(300):
    snapshot = make_snapshot(frame / 100)
    recorder.record(encoder.frame(snapshot), encoder.stamp_ns(snapshot), snapshot)
    while frame == 30 and log.safe_until < 0.3:
        time.sleep(0.01)
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
        timeout=300,
    )
    faults, seen, closed = json.loads(done.stdout)
    assert (seen, closed) == (300, 1)
    assert len(faults) == 1
    assert "log stopped" in faults[0]
    assert "File too large" in faults[0]
    read = read_log(directory)
    assert not read.complete
    assert len(list(read.messages(["joint_states"]))) >= 31
