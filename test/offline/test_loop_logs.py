"""Logs of a whole lift: key figures, bullwheels and strands read back exactly, and replay."""

from __future__ import annotations

import json

import numpy as np
import pytest
from recorded_run import snapshots_of
from twin_process import LOG_EVERY_FRAME

from cable_twin.frame.snapshot import COMMANDED, Columns
from cable_twin.offline import review, simulate
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation

COARSE = ("--set", "ropes.up.elements=150", "--set", "ropes.down.elements=150")
END = 4.0  # s


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Directory and printed output of a run with a start and an emergency stop."""
    directory = tmp_path_factory.mktemp("loop")
    script = directory / "lift.yaml"
    script.write_text("- {time: 0, name: haul_rope, speed: 2.5}\n- {time: 2, event: emergency_stop}\n")
    arguments = ["chairlift", *COARSE, "--script", str(script), "--duration", str(END), *LOG_EVERY_FRAME]
    arguments += ["--output", str(directory / "logs"), "--json", str(directory / "run.json")]
    assert simulate.main(arguments) == 0
    return next((directory / "logs").iterdir()), json.loads((directory / "run.json").read_text())["runs"][0]


def test_review_has_the_figures_of_the_run(run, tmp_path):
    directory, told = run
    seen, pictures = tmp_path / "seen.json", tmp_path / "pictures"
    arguments = [str(directory), "--no-viewer", "--json", str(seen), "--plots", str(pictures)]
    assert review.main(arguments) == 0
    again = json.loads(seen.read_text())["runs"][0]
    for mine, theirs in ((told, again), (again, told)):
        values = {one["key_figure"]: one["value"] for one in mine["key_figures"]}
        for figure in theirs["key_figures"]:
            if "chair: " not in figure["key_figure"]:  # of which a log has single precision
                assert values[figure["key_figure"]] == pytest.approx(figure["value"], rel=1e-5, abs=1e-6), figure[
                    "key_figure"
                ]
    names = {one["key_figure"] for one in told["key_figures"]}
    assert {"haul_rope: stopping time", "drive: adhesion used of available", "drive: drive torque, highest"} <= names
    assert {"return: counterweight travel, lowest", "down: load of carriers, highest"} <= names
    assert "sheave_tension/drive_on [N]" in told["signals"]["columns"]
    assert (pictures / "sheaves.png").is_file()


def test_bullwheels_and_strands_come_back_to_the_last_bit_and_to_the_side(run):
    directory, _ = run
    last = snapshots_of(directory)[-1]
    overrides = {"ropes.up.elements": 150, "ropes.down.elements": 150}
    simulation = Simulation(load_scenario("chairlift", overrides))
    simulation.command("haul_rope", speed=2.5)
    simulation.advance_to(2.0)
    simulation.emergency_stop()
    there, here = simulation.advance_to(END).columns, last.columns
    assert there.drive_command_kind == COMMANDED.index("emergency stop")
    told = [name for name in Columns._fields if name.startswith(("drive_comm", "drive_ref"))]
    assert len(told) == 5
    for name in (
        *told,
        "sheave_position",
        "sheave_speed",
        "sheave_force",
        "sheave_tension",
        "sheave_slip",
        "sheave_travel",
    ):
        np.testing.assert_array_equal(getattr(here, name), getattr(there, name))
    np.testing.assert_array_equal(here.vehicle_rope, there.vehicle_rope)
    np.testing.assert_allclose(here.arc_length, there.arc_length, atol=1e-9)
    np.testing.assert_array_equal(here.body_position, there.body_position)
    sides = np.where(here.vehicle_rope == 0.0, 2.1, -2.1)
    np.testing.assert_array_equal(here.body_position[:, 1], sides)
    samples = np.where(last.layout.sample_ropes == 0, 2.1, -2.1)
    np.testing.assert_array_equal(there.rope_position[:, 1], samples)


def test_it_replays_to_the_last_bit(run, replayed):
    directory, _ = run
    replayed(directory)
