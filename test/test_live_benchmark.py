"""The live benchmark: what it counts as a stall of the machine, and a short run of the real processes."""

import json
from dataclasses import replace

import pytest
from twin_process import environment, run_python, write_quick_scenario

from benchmarks.live import Result, Second, faults, unexplained


def seconds(*rows):
    """Seconds from (missed, bare timer in ms, watchers in ms)."""
    return [Second(float(index), missed, 0.0, bare, stall) for index, (missed, bare, stall) in enumerate(rows)]


@pytest.mark.parametrize(
    ("rows", "expected"),
    [
        ([(0, 0.1, 0.1)] * 3, 0),
        ([(2, 0.1, 0.1)], 2),
        ([(2, 12.0, 0.1)], 0),  # the bare timer missed one too
        ([(2, 0.1, 12.0)], 0),  # a core stood still
        ([(0, 0.1, 12.0), (2, 0.1, 0.1), (0, 0.1, 0.1)], 0),  # reports of both are not of the same instant
        ([(0, 0.1, 12.0), (0, 0.1, 0.1), (3, 0.1, 0.1)], 3),
        ([(1, 9.0, 9.9)], 1),
    ],
)
def test_missed_frames_are_explained_by_stalls_beside_them(rows, expected):
    assert unexplained(seconds(*rows), 10.0) == expected


def test_each_limit_is_named_when_it_is_missed():
    result = Result(
        minutes=1.0,
        twin={"lateness_p99.9_ms": 2.9},
        bare={"lateness_p99.9_ms": 0.5},
        seconds=seconds((0, 0.1, 0.1)),
        processor=24.0,
        resident=100.0,
        peak=100.0,
        commands=100,
        refused=0,
        dropped=0,
    )
    assert faults(result) == []
    late = replace(result, seconds=seconds((2, 0.1, 0.1)), processor=26.0, dropped=4, twin={"lateness_p99.9_ms": 3.1})
    assert faults(late) == [
        "live: aerial_tramway: 2 missed frames that no stall of the machine explains",
        "live: aerial_tramway: lateness p99.9 of 3.10 ms, allowed are 3 ms (bare timer: 0.50 ms)",
        "live: aerial_tramway: 26.0 % of a core, allowed are 25 %",
        "live: aerial_tramway: 4 frames are missing in the logs",
    ]


def run(*arguments, directory):
    return run_python("-m", "benchmarks", "live", *arguments, directory=directory, variables=environment(directory))


@pytest.mark.long
def test_a_short_run_gives_every_figure(tmp_path):
    pytest.importorskip("rclpy")
    scenario = write_quick_scenario(tmp_path)
    result = run("--minutes", "0.1", "--scenario", str(scenario), "--output", ".", directory=tmp_path)
    assert result.returncode in (0, 1), result.stdout + result.stderr  # the machine may be busy
    part = json.loads((tmp_path / "benchmarks.json").read_text())["live"]
    lateness, process, worst = (table["rows"] for table in part["tables"])
    twin, bare = lateness
    assert 400 < twin["frames"] < 1500
    assert 300 < bare["frames"] <= twin["frames"] + 50
    for one in lateness:
        bins = [key for key in one if key.startswith(("below ", "over ")) or " to " in key]
        assert len(bins) == 7
        assert sum(one[key] for key in bins) == one["frames"]
        assert 0.0 < one["median [ms]"] <= one["p99 [ms]"] <= one["max [ms]"]
    assert process[0]["commands sent"] > 50
    assert process[0]["refused"] == 0
    assert len(worst) >= 4
    assert worst[0]["twin [ms]"] >= worst[-1]["twin [ms]"] > 0.0
    assert 0.5 < process[0]["processor [% of a core]"] < 200.0
    assert 50.0 < process[0]["resident [MB]"] <= process[0]["peak [MB]"]
    assert "## Live" in (tmp_path / "benchmarks.md").read_text()
    assert (tmp_path / "pictures" / "live_quick.png").stat().st_size > 5000
    assert 0.0 < process[0]["stamp to subscriber, median [ms]"] <= process[0]["p99 [ms]"]


def test_what_cannot_be_measured_is_one_line(tmp_path):
    pytest.importorskip("rclpy")
    result = run("--scenario", "nowhere", directory=tmp_path)
    assert result.returncode == 1
    assert "Traceback" not in result.stderr
    assert "python -m benchmarks: live:" in result.stderr
    assert "nowhere" in result.stderr
