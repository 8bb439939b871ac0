"""Log of a run in space: lateral quantities read back, plotted and replayed."""

from __future__ import annotations

import csv
import shutil

import numpy as np
import pytest
from recorded_run import snapshots_of
from small_tramway import IN_SPACE

from cable_twin.offline import review, simulate
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation

GUST = 1.0  # s, when the wind rises


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Directory of a run of three seconds with wind from the right."""
    directory = tmp_path_factory.mktemp("space")
    (directory / "windy.yaml").write_text(load_scenario(IN_SPACE).to_yaml())
    (directory / "gust.yaml").write_text(f"- {{time: {GUST}, wind: 2.0, wind_y: 14.0}}\n")
    script = ["--script", str(directory / "gust.yaml"), "--duration", "3"]
    logs = ["--record", "bag", "--output", str(directory / "logs")]
    assert simulate.main([str(directory / "windy.yaml"), *script, *logs]) == 0
    (found,) = (directory / "logs").iterdir()
    return found


def test_roll_yaw_and_wind_come_back(run):
    simulation = Simulation(load_scenario(IN_SPACE))
    frames = snapshots_of(run)
    compared = 0
    for frame in frames:
        if simulation.time < GUST <= frame.time:
            simulation.advance_to(GUST)
            simulation.wind(2.0, 0.0, 14.0)
        snapshot = simulation.advance_to(frame.time)
        wind = [0.0, 0.0, 0.0] if frame.time < GUST else [2.0, 14.0, 0.0]
        if frame.time != GUST:
            np.testing.assert_array_equal(frame.columns.wind, wind)
        if not np.isnan(frame.columns.body_angles).any():
            np.testing.assert_allclose(frame.columns.body_angles, snapshot.columns.body_angles, atol=1e-12)
            compared += 1
    assert compared > 30


def test_it_replays_to_the_last_bit(run, replayed):
    replayed(run)


def test_review_plots_and_exports_what_goes_across(run, tmp_path):
    pytest.importorskip("matplotlib")
    files = ["--plots", str(tmp_path / "plots"), "--csv", str(tmp_path / "run.csv")]
    assert review.main([str(run), "--no-viewer", *files]) == 0
    assert (tmp_path / "plots" / "across.png").stat().st_size > 20_000
    rows = list(csv.DictReader((tmp_path / "run.csv").open()))
    rolls = [float(row["roll/cabin/cabin [deg]"]) for row in rows if row["roll/cabin/cabin [deg]"]]
    assert max(rolls) > 1.0
    assert float(rows[-1]["wind/y [m/s]"]) == 14.0
    assert max(float(row["lateral/cabin/cabin [m]"]) for row in rows if row["lateral/cabin/cabin [m]"]) > 0.1


def test_runs_are_compared_in_space_too(run, tmp_path, no_display):
    pytest.importorskip("rerun")
    from rerun.chunk import RrdReader  # noqa: PLC0415

    copies = [shutil.copytree(run, tmp_path / name) for name in ("calm", "windy")]
    assert review.main([*map(str, copies)]) == 0
    (recording,) = copies[0].glob("*.rrd")
    entities = {chunk.entity_path for chunk in RrdReader(recording).stream()}
    for root in "ab":
        assert {f"/{root}/space/rope", f"/{root}/space/carriages/cabin/cabin", f"/{root}/plots/wind"} <= entities
