"""Run with its log directory deleted meanwhile: recording continues in a new one, with a message."""

from __future__ import annotations

import shutil
import time

import pytest
from small_tramway import TRAMWAY
from split_run import record_frame
from twin_process import wait_until

from cable_twin.messages import MessageEncoder, topics
from cable_twin.recording.log_reader import read_log
from cable_twin.recording.run import _new_directory, start_run
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation

EPOCH = 1_700_000_000_123_456_789  # ns
SAID = 2.0  # s within which it is


def delete_directory(run):
    shutil.rmtree(run.directory)


def delete_with_its_parent(run):
    shutil.rmtree(run.directory.parent)


def delete_bag(run):
    next(run.directory.glob("*.mcap")).unlink()


def replace_bag(run):
    (bag,) = run.directory.glob("*.mcap")
    bag.unlink()
    bag.write_text("somebody else's")


@pytest.mark.parametrize(
    "how",
    [
        delete_directory,
        pytest.param(delete_with_its_parent, marks=pytest.mark.long),
        pytest.param(delete_bag, marks=pytest.mark.long),
        replace_bag,
    ],
)
def test_a_run_goes_on_in_a_new_directory(tmp_path, replayed, how):
    simulation = Simulation(load_scenario(TRAMWAY))
    logs = tmp_path / "logs"
    rerun = "file" if how is delete_directory else "none"
    run = start_run(simulation, topics(simulation.layout), record_directory=logs, frame_period=0.02, rerun=rerun)
    run.begin(EPOCH)
    encoder, first, frame = MessageEncoder(simulation.layout, EPOCH), run.directory, 0

    def go_on() -> bool:
        nonlocal frame
        snapshot = simulation.advance_to(frame * 0.02)
        record_frame(run.recorder, encoder, simulation, snapshot)
        frame += 1
        time.sleep(0.02)
        return bool(run.recorder.faults)

    wait_until(lambda: not go_on() and run.recorder._log.safe_until > 0.1)
    how(run)
    since = time.monotonic()
    wait_until(go_on)
    assert time.monotonic() - since < SAID
    assert run.recorder.faults[0].startswith(f"recording: {first} is gone with all files in it")
    wait_until(lambda: go_on() and run.directory != first)
    end = frame * 0.02 + 0.3
    wait_until(lambda: go_on() and frame * 0.02 > end)
    run.close()
    assert run.recorder.faults[1].startswith(
        f"recording: {first} is gone with all files in it; recording continues in {run.directory} "
    )
    assert len(run.recorder.faults) == 2
    log = read_log(run.directory)
    assert log.complete
    assert log.snapshot is not None
    assert len(list(run.directory.glob("*.rrd"))) == (rerun == "file")
    replayed(run.directory)
    if how is replace_bag:
        assert next(first.glob("*.mcap")).read_text() == "somebody else's"


def test_a_new_directory_never_has_the_name_of_the_deleted_one(tmp_path):
    deleted = _new_directory(tmp_path)
    deleted.rmdir()
    assert _new_directory(tmp_path, deleted) != deleted
