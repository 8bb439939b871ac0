"""`~/save_snapshot` of the live node: another node started from the file continues bit for bit."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from bags import bag, rerun_command
from rosbags.highlevel import AnyReader
from twin_process import LOG_EVERY_FRAME, environment, refused_starts, write_quick_scenario

from cable_twin.recording.log_reader import Log, read_log
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation

pytest.importorskip("rclpy")
from std_srvs.srv import SetBool, Trigger

from cable_twin.ros.services import NothingSavedError, SnapshotWriter


def motion(log: Log) -> dict[tuple[str, int], bytes]:
    """Messages by topic and simulated time (ns), without stamps."""
    topics = ["joint_states", "cable", "carriages/cabin/pose", "carriages/cabin/contact_force", "supports/end/force"]
    return {(topic, stamp - log.epoch_ns): data[12:] for topic, stamp, data in log.messages(topics)}


def test_second_node_goes_on_with_the_same_bits(processes, participants, tmp_path, replayed):
    scenario = str(write_quick_scenario(tmp_path))
    first = processes("--scenario", scenario, "--rerun", "none", "--record-directory", "first", *LOG_EVERY_FRAME)
    participant = participants(first.domain)
    participant.subscribe_standard()
    with participant.stream(name=["cabin"], velocity=[4.0]):
        participant.until(lambda: participant.arc_length > 66.0)
    participant.publish(name=["cabin"], velocity=[0.0])
    participant.until(lambda: participant.speed < 3.0, what="braking")
    answer = participant.call("save_snapshot", Trigger)
    assert answer.success
    path = Path(answer.message.partition(": ")[2])
    (run,) = (tmp_path / "first").iterdir()
    assert path.parent == run
    saved = float(answer.message.split()[2])
    assert path.name == f"snapshot_{saved:.3f}_s.npz"
    assert participant.speed > 0.05
    participant.until(lambda: participant.speed == 0.0, what="standstill")
    frames = len(participant.received["joint_states"])
    participant.until(lambda: len(participant.received["joint_states"]) > frames + 200)
    assert participant.call("pause", SetBool, data=True).success
    names = [Path(participant.call("save_snapshot", Trigger).message.partition(": ")[2]).stem for _ in range(3)]
    assert names[1:] == [f"{names[0]}_2", f"{names[0]}_3"]  # none replaces another
    assert {file.stem for file in run.glob("*.npz")} == {path.stem, *names}
    assert first.end() == 0, first.output

    second = processes("--snapshot", str(path), "--rerun", "none", "--record-directory", "second", *LOG_EVERY_FRAME)
    observer = participants(second.domain)
    observer.subscribe_standard()
    second.wait_for(f"'quick' runs at 100 Hz from {saved:.3f} s of the snapshot on")
    observer.until(lambda: len(observer.received["joint_states"]) > 300)
    assert second.end() == 0, second.output
    (rest,) = (tmp_path / "second").iterdir()

    expected, found = motion(read_log(run)), motion(read_log(rest))
    assert min(time for _, time in found) == round(saved * 1e9)
    common = expected.keys() & found.keys()
    assert len(common) > 5 * 250
    assert all(expected[key] == found[key] for key in common)
    moving = [found[key] for key in sorted(common) if key[0] == "carriages/cabin/pose"]
    assert len(set(moving)) > 100  # it did move

    for log in (run, rest):
        replayed(log)
    rerun_command("mcap", "check", bag(rest))
    with AnyReader([rest]) as reader:
        assert reader.message_count > 1000


def test_command_of_the_snapshot_times_out_like_any_other(processes, participants, tmp_path):
    scenario = str(write_quick_scenario(tmp_path))
    first = processes("--scenario", scenario, "--record", "false")
    participant = participants(first.domain)
    participant.subscribe_standard()
    with participant.stream(name=["cabin"], velocity=[3.0]):
        participant.until(lambda: participant.arc_length > 63.0)
        answer = participant.call("save_snapshot", Trigger)
    assert answer.success
    path = Path(answer.message.partition(": ")[2])
    assert path.parent == tmp_path / "cable_twin_logs"  # nothing is recorded: where runs would be
    second = processes("--snapshot", str(path), "--record", "false")
    observer = participants(second.domain)
    observer.subscribe_standard()
    observer.until(lambda: "no command for 0.5 s: cabin ramps to a stop" in second.output)
    observer.until(lambda: observer.speed == 0.0)
    assert second.end() == 0


SLOW_DISK = """
import os, time
fsync = os.fsync
def slow_fsync(file):
    if "snapshot_" in os.readlink(f"/proc/self/fd/{file}"):
        while not os.path.exists("disk_is_ready"):
            time.sleep(0.01)
    fsync(file)
os.fsync = slow_fsync
"""


@pytest.mark.long
def test_commands_do_not_wait_for_the_disk(processes, participants, domain, tmp_path):
    (tmp_path / "slow").mkdir()
    (tmp_path / "slow" / "sitecustomize.py").write_text(SLOW_DISK)
    variables = environment(tmp_path, domain)
    variables["PYTHONPATH"] = os.pathsep.join([str(tmp_path / "slow"), variables["PYTHONPATH"]])
    scenario = str(write_quick_scenario(tmp_path))
    sim = processes("--scenario", scenario, "--rerun", "none", domain=domain, variables=variables)
    participant = participants(domain)
    participant.subscribe_standard()
    with participant.stream(name=["cabin"], velocity=[1.0]):
        participant.until(lambda: participant.speed > 0.5)
        answer = participant.call("save_snapshot", Trigger)
        assert not answer.success
        assert "is still being written: the log of the node says when it is saved" in answer.message
        assert "snapshot saved: " not in sim.output
        (tmp_path / "disk_is_ready").touch()
        participant.until(lambda: "snapshot saved: " in sim.output)
    assert "ramps to a stop" not in sim.output.partition("snapshot saved: ")[0]
    (path,) = sim.run_directory.glob("snapshot_*.npz")
    assert answer.message.startswith(path.stem)
    assert sim.end() == 0
    assert Simulation.load(path).scenario.name == "quick"


def test_wrong_snapshot_is_one_line(tmp_path):
    Simulation(load_scenario(write_quick_scenario(tmp_path))).save(tmp_path / "real.npz")
    expected = {
        ("--snapshot", "none.npz"): "sim: none.npz: no such file",
        ("--snapshot", "quick.yaml"): "sim: quick.yaml: not a snapshot of cable_twin; allowed: ",
        ("--snapshot", "real.npz", "--scenario", "seed_example"): (
            "sim: parameter 'scenario': given 'seed_example'; allowed: 'quick', the scenario of the snapshot"
        ),
    }
    for said, lines in zip(expected.values(), refused_starts(tmp_path, *expected), strict=True):
        (line,) = lines
        assert line.startswith(said)


def test_saved_states_have_half_of_the_room_that_logs_and_they_share(tmp_path):
    full = Simulation(load_scenario(write_quick_scenario(tmp_path))).capture()
    writer = SnapshotWriter(lambda: tmp_path / "run", keep_size=0.4)
    first = writer.write(full)
    allowed = int(0.2e6 / first.stat().st_size)
    for _ in range(allowed - 1):
        writer.write(full)
    with pytest.raises(
        NothingSavedError, match=r"nothing saved: .* MB of saved states, .* half of keep_size, 0\.2 MB; remove some"
    ):
        writer.write(full)
    assert len(list((tmp_path / "run").iterdir())) == allowed
    first.unlink()
    writer.write(full)
