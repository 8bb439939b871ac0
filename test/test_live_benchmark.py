"""The live benchmark: what it counts as a stall of the machine, and a short run of the real processes."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from twin_process import COMPILING, allocate_domain, write_quick_scenario

from benchmarks.live import Second, faults, unexplained

ROOT = Path(__file__).resolve().parents[1]


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
    result = {
        "missed_unexplained": 0,
        "log_dropped_frames": 0,
        "cpu_percent": 24.0,
        "twin": {"lateness_p99.9_ms": 2.9},
        "bare_timer": {"lateness_p99.9_ms": 0.5},
    }
    assert faults(result) == []
    result.update(missed_unexplained=2, cpu_percent=26.0, log_dropped_frames=4, twin={"lateness_p99.9_ms": 3.1})
    assert faults(result) == [
        "2 missed frames that no stall of the machine explains",
        "lateness p99.9 of 3.10 ms, allowed are 3 ms (bare timer: 0.50 ms)",
        "26.0 % of a core, allowed are 25 %",
        "4 frames are missing in the logs",
    ]


def run(*arguments, directory):
    return subprocess.run(
        [sys.executable, "-m", "benchmarks.live", *arguments],
        cwd=directory,
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])},
        capture_output=True,
        text=True,
        timeout=2 * COMPILING,
        check=False,
    )


def test_a_short_run_gives_every_figure(tmp_path):
    pytest.importorskip("rclpy")
    scenario = write_quick_scenario(tmp_path)
    options = ["--minutes", "0.1", "--scenario", str(scenario), "--domain", str(allocate_domain())]
    result = run(*options, "--output", "live.json", "--plot", "live.png", directory=tmp_path)
    assert result.returncode in (0, 1), result.stdout + result.stderr  # the machine may be busy
    figures = json.loads((tmp_path / "live.json").read_text())
    twin, bare = figures["twin"], figures["bare_timer"]
    assert 400 < twin["frames"] < 1500
    assert 300 < bare["frames"] <= twin["frames"] + 50
    for one in (twin, bare):
        assert sum(one[key] for key in one if key.startswith("frames_late_")) == one["frames"]
        assert 0.0 < one["lateness_median_ms"] <= one["lateness_p99_ms"] <= one["lateness_max_ms"]
    assert figures["commands_sent"] > 50
    assert figures["commands_refused"] == 0
    assert len(figures["seconds"]) >= 5
    assert 0.5 < figures["cpu_percent"] < 200.0
    assert 50.0 < figures["memory_mb"] <= figures["memory_peak_mb"]
    assert "| lateness p99.9 (ms) |" in result.stdout
    assert (tmp_path / "live.png").stat().st_size > 5000


def test_what_cannot_be_measured_is_one_line(tmp_path):
    pytest.importorskip("rclpy")
    result = run("--scenario", "nowhere", directory=tmp_path)
    assert result.returncode == 2
    assert "Traceback" not in result.stderr
    assert "nowhere" in result.stderr
    result = run("--minutes", "-1", directory=tmp_path)
    assert result.returncode == 2
    assert "-1 given, a number above 0 is needed" in result.stderr
    result = run("--output", "missing/live.json", directory=tmp_path)
    assert result.returncode == 2
    assert "there is no directory" in result.stderr
