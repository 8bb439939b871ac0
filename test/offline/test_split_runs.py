"""Runs with split logs, also damaged: replay, review and repair of each file alone and of all together."""

from __future__ import annotations

import re
import shutil
from dataclasses import replace
from io import BytesIO
from pathlib import Path

import numpy as np
import psutil
import pytest
from bags import damage_middle, flip_bit, rerun_command
from mcap.reader import make_reader
from recorded_run import EPOCH
from rosbags.highlevel import AnyReader
from small_tramway import TRAMWAY
from split_run import COMMANDS, bags, record_frame, record_split
from twin_process import wait_until

from cable_twin.messages import SCENARIO, MessageEncoder, topics
from cable_twin.offline import replay, review, simulate
from cable_twin.offline.repair import repair
from cable_twin.recording.log_file import LogError, LogFile
from cable_twin.recording.log_reader import read_log
from cable_twin.recording.run import start_run
from cable_twin.recording.splitting import UNSPLIT, Splitting
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation
from cable_twin.simulation.snapshot_file import read_full_state

DURATION = 7.5  # s
SELDOM = dict.fromkeys(("joints", "poses", "forces", "rope", "path", "clock"), 0.2)  # Hz, less than a file lasts


@pytest.fixture(scope="module")
def split(tmp_path_factory):
    """Directory of a run in four files, with their recordings."""
    directory = tmp_path_factory.mktemp("split")
    return record_split(directory, DURATION, Splitting(split_duration=2.0), rerun="file")


@pytest.fixture(scope="module")
def unsplit(tmp_path_factory):
    return record_split(tmp_path_factory.mktemp("unsplit"), DURATION, UNSPLIT)


@pytest.fixture
def copy(split, tmp_path):
    """Copy of the bag of the run, to be changed."""
    run = tmp_path / split.name
    run.mkdir()
    for file in (*bags(split), split / "metadata.yaml"):
        shutil.copy(file, run)
    return run


def test_each_file_replays_alone_to_the_last_bit(split, replayed):
    files = bags(split)
    assert len(files) == 4
    for file in files:
        output = replayed(file)
        assert f"{file}: complete, " in output


def test_all_files_replay_in_one_go_and_their_states_are_those_of_the_run(split, replayed):
    output = replayed(split)
    assert f"{split}: files 0 to 3, complete, " in output
    assert f"{DURATION:.2f} s, {len(COMMANDS)} commands" in output
    assert re.search(r"^ +snapshot\.npz +3 samples, +0 differ$", output, re.MULTILINE)
    assert re.search(r"^ +joint_states +376 samples, +0 differ$", output, re.MULTILINE)


def test_nothing_is_lost_or_doubled_between_files(split, unsplit):
    starts = [EPOCH + second * 10**9 for second in (0, 2, 4, 6)]
    whole = list(read_log(unsplit).messages())
    parts = list(read_log(split).messages())
    assert [stamp for topic, stamp, _ in parts if topic == SCENARIO] == starts
    common = [message for message in whole if message[1] not in starts]
    assert [message for message in parts if message[1] not in starts] == common
    assert set(whole) <= set(parts)  # a file begins with all that there is at its time
    with AnyReader([split]) as reader:
        assert reader.message_count == len(parts) == sum(1 for _ in reader.messages())


def test_files_begin_with_the_frame_of_their_state(split):
    for number, file in enumerate(bags(split)):
        begun = [(topic, stamp) for topic, stamp, _ in read_log(file).messages()]
        assert begun[:2] == [(SCENARIO, EPOCH + number * 2 * 10**9), ("columns", EPOCH + number * 2 * 10**9)]
    first = read_log(bags(split)[1]).commands[0]
    assert (first.time, first.command) == (2.0, COMMANDS[2.0])  # after the frame of its time


def test_recordings_are_whole_and_all_are_shown(split, no_display, capsys):
    recordings = [str(file.with_suffix(".rrd")) for file in bags(split)]
    rerun_command("rrd", "verify", *recordings)
    assert review.main([str(split)]) == 0
    output = capsys.readouterr().out
    assert "files 0 to 3, complete; scenario small_tramway, 7.50 s, 376 frames, 8 commands" in output
    assert f"\nrerun recording: {' '.join(recordings)}\n" in output
    assert review.main([str(bags(split)[2])]) == 0
    assert f"\nrerun recording: {recordings[2]}\n" in capsys.readouterr().out


def test_run_without_its_first_files_starts_from_the_first_that_is_kept(copy, tmp_path, capsys):
    for file in bags(copy)[:2]:
        file.unlink()
    assert replay.main([str(copy)]) == 0
    assert f"{copy}: files 2 to 3, complete, " in capsys.readouterr().out
    assert simulate.main(["--from-bag", str(copy), "--output", str(tmp_path / "again"), "--record", "bag"]) == 0
    assert "from 4.00 s on" in capsys.readouterr().out
    (again,) = (tmp_path / "again").iterdir()
    motion = ["joint_states", "cable", "supports/tower_1/force"]
    read, original = read_log(again), read_log(copy)
    found = {(topic, stamp - read.epoch_ns): data[12:] for topic, stamp, data in read.messages(motion)}
    expected = {(topic, stamp - EPOCH): data[12:] for topic, stamp, data in original.messages(motion)}
    common = found.keys() & expected.keys()  # what is not logged with every frame is so at other times
    assert {key for key in expected if key[0] == "joint_states"} <= common
    assert len({topic for topic, _ in common}) == 3
    assert all(found[key] == expected[key] for key in common)
    assert simulate.main(["--from-bag", str(copy), "--set", "cable.elements=30"]) == 2
    assert "started from a snapshot" in capsys.readouterr().err


def test_last_file_cut_short_is_read_as_far_as_it_goes(copy, capsys):
    last = bags(copy)[-1]
    last.write_bytes(last.read_bytes()[: last.stat().st_size * 2 // 3])
    assert replay.main([str(copy)]) == 0
    assert "files 0 to 3, cut short, read as far as it goes, " in capsys.readouterr().out
    assert review.main([str(copy), "--no-viewer"]) == 0
    assert "files 0 to 3, cut short, read as far as it goes; scenario" in capsys.readouterr().out
    assert repaired(copy) == sum(1 for _ in read_log(copy).messages())


def test_last_file_with_nothing_in_it_is_said(copy, capsys):
    last = bags(copy)[-1]
    last.write_bytes(last.read_bytes()[:60])  # killed while it was opened
    assert replay.main([str(copy)]) == 0
    output = capsys.readouterr().out
    assert f"files 0 to 2, damaged, all else is read ({last.name}: not a bag, or empty: " in output
    assert " 6.00 s, " not in output
    assert repaired(copy) > 500


@pytest.mark.parametrize(
    ("spoil", "states"),
    [
        (damage_middle, 2),
        (Path.unlink, 1),
        pytest.param(lambda file: file.write_bytes(bytes(5000)), 1, marks=pytest.mark.long),
    ],
    ids=["damaged", "missing", "erased"],
)
def test_after_a_damaged_file_it_goes_on_from_the_next_state(copy, capsys, spoil, states, replayed):
    files = bags(copy)
    spoil(files[1])
    output = replayed(copy)
    assert (
        f"{files[2].name}: data before 4.00 s is lost; the replay continues from the state at the start of this file"
        in output
    )
    assert re.search(rf"^ +snapshot\.npz +{states} samples, +0 differ$", output, re.MULTILINE)
    assert "damaged, all else is read (" in output
    assert review.main([str(copy), "--no-viewer"]) == 0
    assert "damaged, all else is read (" in capsys.readouterr().out
    assert repaired(copy) == sum(1 for _ in read_log(copy).messages())
    copied = copy.with_name(f"{copy.name}_repaired")
    capsys.readouterr()
    assert replay.main([str(copied)]) == 0
    assert "data before 4.00 s is lost" in capsys.readouterr().out


def test_a_damaged_state_is_said_and_the_replay_goes_on(copy, capsys):
    flip_state(bags(copy)[2])
    assert replay.main([str(copy)]) == 0
    output = capsys.readouterr().out
    assert f"  {bags(copy)[2].name}: snapshot.npz: damaged" in output
    assert "its state is not compared" in output
    assert re.search(r"^ +snapshot\.npz +2 samples, +0 differ$", output, re.MULTILINE)
    assert re.search(r"^ +joint_states +376 samples, +0 differ$", output, re.MULTILINE)
    assert review.main([str(copy), "--no-viewer"]) == 0
    assert "376 frames, 8 commands" in capsys.readouterr().out
    flip_state(bags(copy)[3])
    for file in bags(copy)[:2]:
        file.unlink()
    assert replay.main([str(copy)]) == 2  # from no state that is left
    assert capsys.readouterr().err.count("\n") == 1


def test_a_damaged_state_that_is_needed_costs_its_file(copy, capsys):
    files = bags(copy)
    files[0].unlink()
    flip_state(files[1])
    assert replay.main([str(copy)]) == 0  # from the next one
    output = capsys.readouterr().out
    assert f"{copy}: files 2 to 3, damaged, all else is read ({files[1].name}: snapshot: damaged" in output
    assert "every sample agrees to the last bit" in output
    damage_middle(files[2])
    flip_state(files[3])
    flip_state(files[1])  # back
    assert replay.main([str(copy)]) == 0
    output = capsys.readouterr().out
    assert (
        f"  {files[3].name}: left out, because the data before it is lost and "
        f"its own state cannot be used: {files[3].name}: snapshot.npz" in output
    )


def flip_state(file: Path) -> None:
    """Invert some bits of the attached state, anywhere in its archive."""
    with file.open("rb") as stream:
        (attached,) = make_reader(stream).get_summary().attachment_indexes
    for share in range(2, 8):
        flip_bit(file, attached.offset + attached.length * share // 10)


def repaired(run: Path) -> int:
    """Messages that rosbags reads from a repaired copy."""
    assert review.main([str(run), "--repair"]) == 0
    with AnyReader([run.with_name(f"{run.name}_repaired")]) as reader:
        return sum(1 for _ in reader.messages())


def test_whole_run_needs_no_repair_and_a_copy_of_it_is_the_same(split, copy, capsys):
    assert review.main([str(split), "--repair"]) == 0
    assert capsys.readouterr().out == f"{split}: complete, nothing to repair\n"
    directory, count = repair(read_log(copy))
    read, again = read_log(copy), read_log(directory)
    assert list(again.messages()) == list(read.messages())
    assert count == sum(1 for _ in read.messages())
    assert [file.snapshot() for file in again.files] == [file.snapshot() for file in read.files]
    assert [dict(file.metadata) for file in again.files] == [dict(file.metadata) for file in read.files]


def test_file_alone_is_repaired_under_its_own_name(copy, capsys):
    file = bags(copy)[2]
    file.write_bytes(file.read_bytes()[:-100])
    assert review.main([str(file), "--repair"]) == 0
    copied = read_log(copy / f"{file.stem}_repaired")
    assert copied.complete
    assert replay.main([str(copied.path)]) == 0
    assert "every sample agrees" in capsys.readouterr().out


def test_attached_state_of_another_run_is_found(copy, capsys):
    """State that differs in the last bit of one number."""

    class Changed(LogFile):
        def snapshot(self):
            full = read_full_state(BytesIO(super().snapshot()), "state")
            places = full.state.joints.position
            places[0] = np.nextafter(places[0], np.inf)
            stream = BytesIO()
            full.write(stream)
            return stream.getvalue()

    read = read_log(copy)
    files = [*read.files[:2], Changed(read.files[2].path, read.files[2].metadata, EPOCH), *read.files[3:]]
    directory, _ = repair(replace(read, files=tuple(files)))
    assert replay.main([str(directory)]) == 1
    output = capsys.readouterr().out
    assert "first difference at 4.000000 s on snapshot.npz, state/joints.position[0]: logged " in output
    assert re.search(r"^ +snapshot\.npz +3 samples, +1 differ$", output, re.MULTILINE)


def test_directory_with_a_file_of_another_run_is_refused(copy, unsplit):
    shutil.copy(bags(unsplit)[0], copy / f"{copy.name}_4.mcap")
    assert read_log(copy).files[-1].number == 4  # with the same epoch, by chance
    other = bags(copy)[-1]
    content = other.read_bytes()
    other.write_bytes(content.replace(str(EPOCH).encode(), str(EPOCH + 1).encode()))
    with pytest.raises(LogError, match=f"{other.name}: belongs to another run than {copy.name}_0.mcap beside it"):
        read_log(copy)


def test_options_of_simulate_split_and_keep(tmp_path, capsys):
    arguments = ["single_span", "--set", "cable.elements=12", "--duration", "12", "--output", str(tmp_path)]
    limits = ["--split-duration", "2", "--keep-age", "4"]
    assert simulate.main([*arguments, *limits]) == 0
    (run,) = tmp_path.iterdir()
    assert [read_log(file).files[0].number for file in bags(run)] == [4, 5, 6]  # the last with the frame of 12 s
    assert sorted(file.with_suffix(".mcap") for file in run.glob("*.rrd")) == sorted(bags(run))
    capsys.readouterr()
    assert replay.main([str(run)]) == 0
    assert "files 4 to 6, complete" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--split-duration", "-1"], "simulate: --split-duration: given -1 s; allowed: 0, or 1 s and more"),
        (["--keep-age", "nan"], "simulate: --keep-age: given nan s; allowed: 0 s and more"),
        (
            ["--keep-age", "10"],
            "simulate: --keep-age: given 10 s, less than a file; allowed: 0, or --split-duration of 3600 s and more",
        ),
    ],
)
def test_wrong_options_of_simulate_are_named(options, said, tmp_path, capsys):
    assert simulate.main([*options, "--output", str(tmp_path)]) == 2
    assert capsys.readouterr().err == f"{said}\n"
    assert not list(tmp_path.iterdir())


@pytest.mark.long
def test_disk_that_fills_up_before_a_split_leaves_all_readable(tmp_path):
    """Full disk for the rest of the old file and for a new one; flushed data stays readable."""
    from verification.failures import Disk  # noqa: PLC0415 - needs no ROS until it is used

    try:
        disk = Disk(tmp_path)
    except OSError as error:
        pytest.skip(f"disks that fail need root and loop devices: {error}")
    simulation = Simulation(load_scenario(TRAMWAY))
    table = topics(simulation.layout)
    limits = Splitting(split_duration=2.0)
    run = start_run(simulation, table, record_directory=disk.root, frame_period=0.02, splitting=limits)
    try:
        run.begin(EPOCH)
        encoder = MessageEncoder(simulation.layout, EPOCH)
        for frame in range(300):
            snapshot = simulation.advance_to(frame * 0.02)
            if frame == 190:
                wait_until(lambda: run.recorder._log.safe_until > 3.7)
                disk.fill()
            record_frame(run.recorder, encoder, simulation, snapshot)
        run.recorder.close()
        stopped = [fault for fault in run.recorder.faults if fault.startswith("recording: log stopped: ")]
        assert len(stopped) == 1
        assert "No space left on device" in stopped[0]
        (disk.root / "ballast").unlink()
        log = read_log(run.directory)
        assert [file.number for file in log.files] == [0, 1]
        assert log.files[0].complete
        assert log.end > 3.0
        assert replay.main([str(run.directory)]) == 0
        assert repaired(run.directory) == sum(1 for _ in log.messages())
        rerun_command("rrd", "verify", bags(run.directory)[0].with_suffix(".rrd"))
    finally:
        disk.release()


@pytest.mark.long
def test_memory_stays_as_it_is_over_many_splits(tmp_path):
    """Eighty files with recordings, whose threads rerun tends to leave behind."""
    simulation = Simulation(load_scenario(TRAMWAY))
    table = topics(simulation.layout)
    limits = Splitting(split_duration=1.0, keep_age=3.0)
    run = start_run(simulation, table, record_directory=tmp_path, frame_period=0.1, splitting=limits)
    run.begin(EPOCH)
    encoder = MessageEncoder(simulation.layout, EPOCH)
    process = psutil.Process()
    used = []
    for frame in range(801):
        snapshot = simulation.advance_to(frame * 0.1)
        record_frame(run.recorder, encoder, simulation, snapshot)
        wait_until(lambda: run.recorder.backlog < 20)  # or what waits is measured
        if frame in (200, 800):
            wait_until(lambda: run.recorder.idle)
            used.append((process.memory_info().rss / 1e6, process.num_threads(), process.num_fds()))
    run.recorder.close()
    assert run.recorder.faults == []
    assert len(bags(run.directory)) <= 5
    (memory, threads, descriptors), (later_memory, later_threads, later_descriptors) = used
    assert later_memory - memory < 20.0  # MB over 60 splits; a thread left behind by each would take 80
    assert abs(later_threads - threads) <= 2
    assert abs(later_descriptors - descriptors) <= 2


def test_files_with_a_single_frame_each_are_no_loss(tmp_path, replayed):
    run = record_split(tmp_path, DURATION, Splitting(split_duration=2.0), rates=SELDOM)
    assert len(bags(run)) == 4
    output = replayed(run)
    assert "lost" not in output
    assert f"{len(COMMANDS)} commands" in output
    assert re.search(r"^ +snapshot\.npz +3 samples, +0 differ$", output, re.MULTILINE)
    bags(run)[1].unlink()  # what is gone is lost all the same
    assert "data before 4.00 s is lost; the replay continues from the state at the start of this file" in replayed(run)
