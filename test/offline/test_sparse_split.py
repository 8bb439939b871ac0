"""Run in files shorter than the period of the most frequent topics, without loss between files."""

from __future__ import annotations

import re

from split_run import COMMANDS, bags, record_split

from cable_twin.offline import replay
from cable_twin.recording.splitting import Splitting

SELDOM = dict.fromkeys(("joints", "poses", "forces", "rope", "path", "clock"), 0.2)  # Hz
DURATION = 7.5  # s


def test_files_with_a_single_frame_each_are_no_loss(tmp_path, capsys):
    run = record_split(tmp_path, DURATION, Splitting(split_duration=2.0), rates=SELDOM)
    assert len(bags(run)) == 4
    assert replay.main([str(run)]) == 0
    output = capsys.readouterr().out
    assert "lost" not in output
    assert f"{len(COMMANDS)} commands" in output
    assert re.search(r"^ +snapshot\.npz +3 samples, +0 differ$", output, re.MULTILINE)
    assert "every sample agrees to the last bit" in output


def test_a_file_that_is_gone_is_lost_all_the_same(tmp_path, capsys):
    run = record_split(tmp_path, DURATION, Splitting(split_duration=2.0), rates=SELDOM)
    bags(run)[1].unlink()
    assert replay.main([str(run)]) == 0
    assert (
        "data before 4.00 s is lost; the replay continues from the state at the start of this file"
        in capsys.readouterr().out
    )
