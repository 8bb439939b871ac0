"""Failures of the machine under a running twin, and many frames: `verification.failures`, and a part of `endurance`."""

from __future__ import annotations

import pytest
from twin_process import write_quick_scenario

pytest.importorskip("rclpy")

from verification.endurance import FRAME_RATE, run
from verification.failures import (
    Disk,
    full_disk,
    measure,
    power_cut,
    read_only_directory,
    stalling_disk,
)

pytestmark = pytest.mark.long

# a disk that becomes read-only is the full one with another number; a kill, a cut file and a limit on the size of files
# need no disk of their own: see test_sim_process and test_damaged_logs
SAYS = {
    power_cut: "",
    full_disk: "recording: log stopped: [Errno 28] No space left on device; readable up to ",
    stalling_disk: "recording: the disk does not keep up: ",
    read_only_directory: "nothing is recorded: record_directory '",
}


@pytest.fixture(scope="module")
def _mounts(tmp_path_factory):
    try:
        Disk(tmp_path_factory.mktemp("mount")).release()
    except OSError as error:
        pytest.skip(f"disks that fail need root and loop devices: {error}")


@pytest.mark.usefixtures("_mounts")
@pytest.mark.parametrize("failure", SAYS, ids=lambda failure: failure.__name__)
def test_twin_goes_on_and_less_than_a_second_is_lost(tmp_path, domain, failure):
    loss = measure(failure, tmp_path, domain, str(write_quick_scenario(tmp_path)), listening=1.5, stall=4.0)
    assert loss.said.startswith(SAYS[failure])
    if failure is power_cut:
        assert loss.rate is None
    else:
        assert loss.rate == pytest.approx(100.0, rel=0.1)
    if failure is read_only_directory:
        assert loss.lost is None
        return
    assert loss.lost is not None
    assert loss.lost <= (0.0 if failure is stalling_disk else 1000.0)
    assert loss.replayed
    assert loss.repaired == loss.messages > 150  # of half a second and more, at 340 a second


HOURS = 0.03  # of simulated time


def test_many_frames_are_all_in_the_log(tmp_path, domain):
    seen: list[float] = []
    result = run(HOURS, 40.0, tmp_path, domain, seen.append)
    print("\n".join(result.lines()))
    assert seen == sorted(seen)
    assert result.hours >= HOURS
    assert result.frames >= 3600.0 * HOURS * FRAME_RATE
    assert (result.missing, result.dropped) == (0, 0)
    assert result.memory[1] - result.memory[0] < 60.0  # MB; the first seconds fill caches
