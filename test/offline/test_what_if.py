"""`what_if`: a branch of a recorded run has its bits where nothing is changed, and else what would have been."""

from __future__ import annotations

import json

import numpy as np
import pytest
from recorded_run import record
from small_tramway import IN_SPACE

from cable_twin.frame.records import Command
from cable_twin.offline.reading import Reading
from cable_twin.offline.what_if import main
from cable_twin.recording.log_reader import read_log
from cable_twin.recording.splitting import Splitting
from cable_twin.scenario import load_scenario

END = 4.0  # s
BRAKE = "carriages.cabin.drive.emergency_brake.force=450"


@pytest.fixture(scope="module", params=[None, 1.5], ids=["one file", "split"])
def run(request, tmp_path_factory):
    """Directory of a run with a trip, a wind and an emergency stop."""
    script = [
        (0.5, Command("speed", {"cabin": 3.0})),
        (1.255, Command("wind", {"x": 2.0, "y": 6.0, "z": 0.0})),
        (2.5, Command("emergency_stop", {})),
    ]
    splitting = Splitting(split_duration=request.param or 0.0)
    return record(tmp_path_factory.mktemp("what_if"), load_scenario(IN_SPACE), script, END, splitting=splitting)[0]


def branch(run, tmp_path, *options):
    """Exit code of a branch, and its log where it has one."""
    code = main([str(run), *map(str, options), "--record", "bag", "--output", str(tmp_path / "branch")])
    found = [*(tmp_path / "branch").glob("*")]
    return code, read_log(found[0]) if found else None


@pytest.mark.parametrize(
    "at", [0.0, pytest.param(1.25, marks=pytest.mark.long), 2.0, pytest.param(2.5, marks=pytest.mark.long)]
)
def test_a_branch_without_changes_has_the_bits_of_the_run(run, tmp_path, capsys, at):
    code, log = branch(run, tmp_path, "--at", at, "--json", tmp_path / "both.json")
    assert code == 0
    assert "no sample differs: the branch has the bits of the run" in capsys.readouterr().out
    assert_same_figures(tmp_path / "both.json", read_log(run) if at == 0.0 else None)
    a, b = ([*Reading(one, part=(at, END)).values()] for one in (read_log(run), log))
    assert len(a) == len(b) == round((END - at) / 0.01) + 1
    assert a[0][0] == pytest.approx(at)
    rows = zip((one for _, one in a), (one for _, one in b), strict=True)
    common = [(name, one[name], other[name]) for one, other in rows for name in one if name in other]
    exact = np.array([pair for name, *pair in common if not name.startswith("tension/")])  # those are rounded
    assert len(exact) > 10 * len(a)
    assert np.array_equal(*exact.T, equal_nan=True)
    assert [one.command for one in log.commands] == [one.command for one in read_log(run).commands if one.time >= at]


def assert_same_figures(table, whole):
    """Key figures of both runs are the same in every digit, as are those that the whole run has recorded, if given."""
    a, b = (one["key_figures"] for one in json.loads(table.read_text())["runs"])
    assert a == b
    if whole is not None:
        reading = Reading(whole)
        assert all(reading.values())
        recorded = {str(one.id): one.value for one in reading.figures}
        assert {one["id"]: one["value"] for one in a} == pytest.approx(recorded, rel=1e-12)
        assert {"stopping_distance", "passenger_stopping_distance"} <= {one.id.quantity for one in reading.figures}


def test_a_branch_has_the_other_commands_and_values(run, tmp_path, capsys):
    script = tmp_path / "other.yaml"
    script.write_text("- {time: 2.0, name: cabin, speed: 0.0}\n- {time: 4.5, wind: 1.0, wind_y: 0.0}\n")
    code, log = branch(run, tmp_path, "--at", 2, "--script", script, "--duration", 3, "--set", BRAKE)
    assert code == 0
    assert [(one.time, one.command.kind) for one in log.commands] == [(2.0, "speed"), (4.5, "wind")]
    assert log.end == pytest.approx(5.0)
    assert log.scenario["carriages"]["cabin"]["drive"]["emergency_brake"]["force"] == 450.0
    said = capsys.readouterr().out
    assert "cabin: stopping distance" in said
    assert said.startswith("both runs from 2.00 s on, where the branch begins\n")
    assert "small_tramway, 2.00 to 4.00 s, 201 frames, " in said
    assert "small_tramway, 2.00 to 5.00 s, 301 frames, 2 commands" in said
    assert "no sample differs" not in said


def test_a_softer_brake_stops_later(run, tmp_path):
    code, log = branch(run, tmp_path, "--at", 2, "--set", BRAKE)
    assert code == 0
    ends = [[*Reading(one, part=(2.0, END)).values()][-1][1]["arc_length/cabin"] for one in (read_log(run), log)]
    assert ends[1] > ends[0] + 0.1


@pytest.mark.parametrize(
    ("options", "line"),
    [
        (["--at", 9], "--at: given 9 s; allowed: up to 4 s, the end of"),
        (["--at", 4], "--at: given 4 s, the end of the log; allowed: at least one frame of 0.01 s; give --duration"),
        (
            ["--at", 2, "--set", "cable.elements=44"],
            "--set cable.elements: given 44, which needs another mesh; allowed",
        ),
        (["--at", 2, "--set", "cabel.elements=44"], "cabel: this key does not exist; did you mean 'cable'?"),
        (["--at", 2, "--set", "cable.mass_per_length=-1"], "cable.mass_per_length: given -1"),
        (["--at", 2, "--script", "early.yaml"], "early.yaml:2: time: given 1.9 s; allowed: from 2 s, the time of --at"),
        (["--at", 2, "--script", "drive.yaml"], "drive.yaml:1: carriage or drive: given 'cabn'"),
        (["--at", 2, "--script", "none.yaml"], "none.yaml: No such file or directory"),
    ],
)
def test_what_cannot_be_branched_is_refused_in_a_line(run, tmp_path, monkeypatch, capsys, options, line):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "early.yaml").write_text("- {time: 3, event: release}\n- {time: 1.9, name: cabin, speed: 1.0}\n")
    (tmp_path / "drive.yaml").write_text("- {time: 3, name: cabn, speed: 1.0}\n")
    assert branch(run, tmp_path, *options) == (2, None)
    (said,) = [one for one in capsys.readouterr().err.splitlines() if "warning" not in one]
    assert said.startswith("what_if: ")
    assert line in said
