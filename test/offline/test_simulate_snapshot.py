"""`simulate --snapshot`: continuation bit for bit, and replay of such a run from its attached state."""

from __future__ import annotations

import json
from collections import Counter

import numpy as np
import pytest
from bags import alter, bag, unchanged
from small_tramway import TRAMWAY
from twin_process import LOG_EVERY_FRAME, write_quick_scenario

from cable_twin.frame.snapshot import Snapshot
from cable_twin.offline import replay, review
from cable_twin.offline.script import read_script
from cable_twin.offline.simulate import main
from cable_twin.recording.log_reader import read_log, read_snapshots
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation

SCRIPT = """\
- {time: 0, name: cabin, speed: 6.0}
- {time: 6.5, event: emergency_stop}
- {time: 8, event: release}
- {time: 8.5, name: cabin, force: 3.0e4}
- {time: 9.5, event: reset}
"""
SAVED = 4.1  # s
COUNTS = {"joint_states": 641, "supports/start/force": 129, "carriages/cabin/pose": 129, "cable": 65}  # from there on


def the_run(directory):
    (run,) = directory.iterdir()
    return run


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Directory with the whole run in `whole`, a snapshot from its middle, and the continued run in `rest`."""
    directory = tmp_path_factory.mktemp("snapshots")
    scenario = write_quick_scenario(directory)
    script = directory / "trip.yaml"
    script.write_text(SCRIPT)
    assert (
        main([str(scenario), "--script", str(script), "--duration", "10.5", "--output", str(directory / "whole")]) == 0
    )
    simulation = Simulation.load(_saved(scenario, script, directory / "state.npz"))
    assert simulation.time == SAVED
    arguments = ["--script", str(script), "--duration", str(10.5 - SAVED), "--output", str(directory / "rest")]
    assert main(["--snapshot", str(directory / "state.npz"), *arguments]) == 0
    return directory


def _saved(scenario, script, path, when=SAVED):
    """Simulate the script in Python up to the snapshot."""
    simulation = Simulation(load_scenario(scenario))
    for item in read_script(script):
        if item.time < when:
            simulation.advance_to(item.time)
            simulation.apply(item.command)
    simulation.advance_to(when)
    simulation.save(path)
    return path


def frames(log, start=0.0):
    """Messages of the motion by topic and simulated time (ns), without stamps."""
    topics = ["joint_states", "cable", "supports/start/force", "carriages/cabin/pose"]
    return {
        (topic, stamp - log.epoch_ns): data[12:]
        for topic, stamp, data in log.messages(topics)
        if stamp - log.epoch_ns >= round(start * 1e9)
    }


def test_rest_of_the_run_has_the_same_bits(runs):
    whole, rest = (read_log(the_run(runs / name)) for name in ("whole", "rest"))
    expected, found = frames(whole, SAVED), frames(rest)
    assert Counter(topic for topic, _ in expected) == COUNTS
    assert found == expected
    assert whole.snapshot is None  # nothing is attached where the scenario says it all
    assert rest.snapshot is not None
    assert len(rest.commands) == 4
    assert [(item.time, item.command) for item in rest.commands] == [
        (item.time, item.command) for item in whole.commands if item.time > SAVED
    ]


def test_log_of_the_rest_replays_also_when_cut_short(runs, tmp_path, capsys, replayed):
    output = replayed(the_run(runs / "rest"))
    assert "starts from: a snapshot, sha256 " in output
    arguments = ["--snapshot", str(runs / "state.npz"), *LOG_EVERY_FRAME, "--duration", "3", "--record", "bag"]
    assert main([*arguments, "--output", str(tmp_path / "logs")]) == 0
    data = bag(the_run(tmp_path / "logs")).read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(data[: len(data) // 2])
    capsys.readouterr()
    assert replay.main([str(cut)]) == 0
    assert "cut short" in capsys.readouterr().out
    assert review.main([str(cut), "--no-viewer"]) == 0
    assert review.main([str(cut), "--repair"]) == 0
    capsys.readouterr()
    replayed(tmp_path / "cut_repaired")


def test_commands_before_the_snapshot_are_not_asked_whether_they_would_do(runs, tmp_path, capsys):
    """Snapshot during the emergency stop of the script, in which the first command would be refused."""
    stopped = _saved(runs / "quick.yaml", runs / "trip.yaml", tmp_path / "stopped.npz", 7.0)
    arguments = ["--snapshot", str(stopped), "--script", str(runs / "trip.yaml"), "--duration", "3.5"]
    assert main([*arguments, "--record", "bag", "--output", str(tmp_path / "logs")]) == 0
    assert "not carried out, because their time is before that of the snapshot: 2 commands" in capsys.readouterr().err
    assert frames(read_log(the_run(tmp_path / "logs"))) == frames(read_log(the_run(runs / "whole")), 7.0)


def test_review_has_the_loads_at_rest_from_the_snapshot(tmp_path):
    """Snapshot with the cabin on the tower, whose margin refers to its load at rest."""
    simulation = Simulation(load_scenario(TRAMWAY))
    simulation.payload("cabin", 320.0)
    simulation.command("cabin", speed=6.0)
    simulation.advance_to(12.0)
    simulation.save(tmp_path / "state.npz")
    arguments = ["--snapshot", str(tmp_path / "state.npz"), "--duration", "1", "--record", "bag"]
    assert main([*arguments, "--output", str(tmp_path / "logs")]) == 0
    first = next(read_snapshots(read_log(the_run(tmp_path / "logs"))))
    assert isinstance(first, Snapshot)
    expected, found = simulation.snapshot.supports["tower_1"].tower, first.supports["tower_1"].tower
    assert found.rest_load == expected.rest_load
    assert found.lowest_load == pytest.approx(expected.lowest_load)
    assert found.normal_load > 1.05 * found.rest_load
    assert first.carriages["cabin"].payload == 320.0


def test_log_that_lost_its_snapshot_is_read_and_not_replayed(runs, tmp_path, refusal):
    lost = alter(bag(the_run(runs / "rest")), tmp_path / "lost.mcap", unchanged)  # copies messages alone
    assert frames(read_log(lost)) == frames(read_log(the_run(runs / "rest")))
    line = refusal(replay.main, lost)
    assert "lost.mcap: the run started from a snapshot, and snapshot.npz is no longer attached" in line


def test_bag_is_a_script_from_the_snapshot_on(runs, tmp_path, capsys):
    whole = the_run(runs / "whole")
    arguments = ["--snapshot", str(runs / "state.npz"), "--from-bag", str(whole), "--record", "bag"]
    assert main([*arguments, "--output", str(tmp_path)]) == 0
    said = capsys.readouterr()
    assert "not carried out, because their time is before that of the snapshot: 1 command\n" in said.err
    assert f"from {SAVED:.2f} s on" in said.out
    log = read_log(the_run(tmp_path))
    expected = frames(read_log(whole), SAVED)
    found = frames(log)
    assert Counter(topic for topic, _ in found) == COUNTS
    assert found == expected


def test_bag_of_the_rest_is_simulated_from_its_own_snapshot(runs, tmp_path):
    rest = the_run(runs / "rest")
    assert main(["--from-bag", str(rest), "--record", "bag", "--output", str(tmp_path)]) == 0
    assert frames(read_log(the_run(tmp_path))) == frames(read_log(rest))


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--snapshot", "{}/none.npz"], "{}/none.npz: no such file"),
        (["--snapshot", "{}/trip.yaml"], "{}/trip.yaml: not a snapshot of cable_twin"),
        (["seed_example", "--snapshot", "{}/state.npz"], "{}/state.npz: a snapshot contains its scenario"),
        (["--set", "gravity=9", "--snapshot", "{}/state.npz"], "{}/state.npz: a snapshot contains its scenario"),
    ],
)
def test_what_cannot_be_is_one_line(runs, refusal, arguments, said):
    assert refusal(main, *(item.format(runs) for item in arguments)).startswith(f"simulate: {said.format(runs)}")


def test_other_scenario_for_a_bag_from_a_snapshot_is_refused(runs, refusal):
    line = refusal(main, "--from-bag", the_run(runs / "rest"), "--set", "gravity=9")
    assert "started from a snapshot: neither SCENARIO nor --set is allowed" in line


def test_snapshot_of_a_version_with_another_state_names_field_and_versions(runs, tmp_path, refusal):
    with np.load(runs / "state.npz") as archive:
        arrays = dict(archive)
    header = json.loads(arrays["header"].tobytes()) | {"package_version": "0.0.7"}
    arrays["header"] = np.frombuffer(json.dumps(header).encode(), np.uint8)
    del arrays["state/drives.target"]
    np.savez(tmp_path / "old.npz", **arrays)
    line = refusal(main, "--snapshot", tmp_path / "old.npz")
    assert "no array drives.target in its state; the snapshot was made by cable_twin 0.0.7, this is " in line
