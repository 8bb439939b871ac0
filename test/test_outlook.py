"""Outlook: futures have the bits and key figures of what then happens, and limits are passed with a warning."""

from __future__ import annotations

import numpy as np
import pytest
from small_tramway import IN_SPACE, TRAMWAY

from cable_twin import Command, Forecaster, Simulation, load_scenario
from cable_twin.ensemble.outlook import LOOK
from cable_twin.frame.records import CommandError
from cable_twin.key_figures import KeyFigures
from cable_twin.key_figures.outlook import ANNOUNCED, AS_COMMANDED, EMERGENCY_STOP
from cable_twin.messages.figure_messages import outlook_statuses

GUST = Command("gust", {"x": 5.0, "z": 0.0, "duration": 1.0})
DRIVEN = {"cabin": 3.0, "haul_rope": 2.0}  # m/s
GROWING = "rope_tension", "swing", "support_load", "speed", "drive_force"


def under_way(source: object, values: dict[str, object] | None = None, until: float = 1.5) -> Simulation:
    """Twin of a scenario whose vehicles move, at a time (s)."""
    twin = Simulation(load_scenario(source, values))
    (name,) = [*twin.scenario.drives] or ["cabin"]
    twin.command(name, speed=DRIVEN[name])
    twin.advance_to(until)
    return twin


@pytest.mark.parametrize("source", [TRAMWAY, IN_SPACE, "jig_back"], ids=["plane", "space", "ropes"])
def test_what_is_foreseen_then_happens_to_the_last_bit(source):
    twin = under_way(source)
    before = twin.capture()
    outlook = twin.outlook(horizon=2.0, announced=GUST, threads=2)
    assert np.array_equal(twin.snapshot.numbers, under_way(source).snapshot.numbers, equal_nan=True)  # is left alone
    happens = {EMERGENCY_STOP: Command("emergency_stop", {}), AS_COMMANDED: None, ANNOUNCED: GUST}
    assert [one.name for one in outlook.futures] == [*happens]
    for future, command in zip(outlook.futures, happens.values(), strict=True):
        twin.restore(before)
        figures = KeyFigures(twin.scenario)
        figures.update(twin.snapshot)
        if command is not None:
            figures.command(twin.apply(command))
        for time in future.times[1:]:
            figures.update(twin.advance_to(time))
        assert future.last is not None
        assert not future.fault
        assert np.array_equal(future.last.numbers, twin.snapshot.numbers, equal_nan=True)
        found = {one.id: one for one in figures.figures()}
        assert all(found[one.id] == one for one in future.figures)
        assert future.highest[-1].tolist() == twin.snapshot.columns.highest_tension[:, 0].tolist()
    stop = outlook[EMERGENCY_STOP]
    assert {"stopping_distance", "stopping_time"} <= {one.id.quantity for one in stop.figures}
    assert np.diff(stop.times).max() == pytest.approx(LOOK)


def test_a_limit_is_warned_of_before_it_is_passed():
    twin = under_way(TRAMWAY, {"limits.swing": 0.03})
    first = twin.outlook(horizon=3.0)[EMERGENCY_STOP]
    swing = first["swing/carriages.cabin/highest"]
    passed = first.passed[swing.id]
    assert twin.time < passed <= swing.time
    (line,) = [line for line in first.warnings if "swing" in line]
    assert line.startswith("emergency stop: cabin: swing along the track: ")
    assert f"allowed: at most 1.719 deg, violated no later than {passed:.2f} s (scenario: limits.swing)" in line
    assert line in twin.outlook(horizon=3.0).warnings


def test_an_outlook_that_comes_too_late_to_warn_says_so():
    outlook = under_way(TRAMWAY).outlook(horizon=3.0)
    soon, late = (outlook_statuses(outlook, age)[0] for age in (0.5, 2.0))
    assert late.level == 1
    assert late.message == f"{soon.message}; 2 s old, of a horizon of 3 s"


def test_a_future_that_cannot_be_says_why():
    twin = under_way(TRAMWAY)
    twin.apply(GUST)
    twin.emergency_stop()
    outlook = twin.outlook(horizon=0.5)
    assert outlook[EMERGENCY_STOP].assumed == "emergency stop, already in force"
    assert outlook[ANNOUNCED].fault.startswith("gust: given while another one lasts; allowed: in 1 s")
    assert outlook[ANNOUNCED].last is None
    assert not outlook[ANNOUNCED].figures
    unfelt = under_way(TRAMWAY, {"cable.diameter": None, "carriages.cabin.bodies.cabin.drag_area": 0.0}).outlook(
        horizon=0.5
    )
    assert unfelt[ANNOUNCED].fault.startswith("no gust is looked at: nothing feels the wind")


@pytest.mark.parametrize(
    ("command", "line"),
    [
        (Command("release", {}), "announced: given 'release'; allowed: gust, operating_gust, wind"),
        (Command("wind", {"x": 300.0, "z": 0.0}), "wind x: given 300 m/s; allowed: -100 to 100 m/s"),
    ],
)
def test_a_wind_that_cannot_come_is_refused(command, line):
    with pytest.raises(CommandError, match=line):
        under_way(TRAMWAY, until=0.0).outlook(announced=command)


def test_a_horizon_that_is_none_is_refused():
    with pytest.raises(ValueError, match="outlook: horizon: given nan s; allowed: more than 0 to 3600 s"):
        Forecaster(load_scenario(TRAMWAY), horizon=float("nan"))


def test_key_figures_of_an_earlier_moment_come_from_the_extremes_kept_then():
    simulation = Simulation(load_scenario(TRAMWAY))
    simulation.command("cabin", speed=3.0)
    figures = KeyFigures(simulation.scenario)
    seen = []
    for _ in range(3):
        simulation.advance_to(simulation.time + 2.0)
        figures.update(simulation.snapshot)
        seen.append((figures.extremes(), {one.id: one.value for one in figures.figures()}))
    for extremes, values in seen:
        then = {one.id: one.value for one in figures.figures_with(extremes)}
        assert {key: then[key] for key in values if key.quantity in GROWING} == {
            key: value for key, value in values.items() if key.quantity in GROWING
        }
    assert {one.id: one.value for one in figures.figures()} == seen[-1][1]
    tensions = [max(value for key, value in values.items() if key.quantity == "rope_tension") for _, values in seen]
    assert tensions[0] < tensions[-1]
