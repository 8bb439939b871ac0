"""Rope life in counts: rainflow of ASTM E1049, sheaves that a rope point passes in a trip, points that move."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from cable_twin.frame.snapshot import Layout
from cable_twin.offline.reporting.rope_life import (
    Cycle,
    LifeCounter,
    haul_reach,
    loops_of,
    rainflow_cycles,
    turning_points,
)
from cable_twin.offline.reporting.sections.rope_life import classes_of
from cable_twin.scenario import load_scenario

SAMPLES = 201


def test_rainflow_of_the_example_in_astm_e1049():
    """ASTM E1049-85, figure 6: ranges 3, 4, 6, 8, 9 with 0.5, 1.5, 0.5, 1, 0.5 cycles."""
    cycles = rainflow_cycles(np.array([-2.0, 1.0, -3.0, 5.0, -1.0, 3.0, -4.0, 4.0, -2.0]))
    counts = {size: sum(one.weight for one in cycles if one.range == size) for size in (3, 4, 6, 8, 9)}
    assert counts == {3: 0.5, 4: 1.5, 6: 0.5, 8: 1.0, 9: 0.5}
    assert sum(one.weight for one in cycles) == 4.0
    assert Cycle(4.0, 1.0, 1.0) in cycles


def test_rainflow_of_a_sine_and_of_nothing():
    cycles = rainflow_cycles(np.sin(np.linspace(0.0, 20.0 * np.pi, 2001)))
    assert sum(one.weight for one in cycles if one.range > 1.9) == pytest.approx(10.0, abs=0.5)
    assert rainflow_cycles(np.array([])) == rainflow_cycles(np.ones(5)) == []
    assert turning_points(np.array([0.0, 1.0, 1.0, np.nan, 2.0, 1.0])).tolist() == [0.0, 2.0, 1.0]


def test_classes_hold_all_cycles():
    rows = classes_of([Cycle(29.9e3, 0.0, 1.0)], [Cycle(1e3, 0.0, 0.5), Cycle(36.9e3, 0.0, 1.0)])
    assert sum(one.per_trip for one in rows) == 1.0
    assert sum(one.in_run for one in rows) == 1.5
    assert classes_of([], []) == []


def counted(name, travel, tension):
    """Counts of a scenario whose rope moves by travels (m), with a tension (N) along its loop that stays."""
    scenario = load_scenario(name)
    layout = Layout.of(scenario, SAMPLES)
    shape = np.zeros((layout.arc_lengths.size, 3))
    loop = np.zeros(layout.arc_lengths.size)
    for rope, part in layout.ropes.items():
        start, end = (
            np.array(scenario.of_rope(rope).vector(one.position)) for one in scenario.cables[rope].ends.values()
        )
        share = np.linspace(0.0, 1.0, SAMPLES)[:, None]
        shape[part][:, [0, 2]] = (start + share * (end - start))[:, [0, -1]]
        shape[part][:, 1] = scenario.cables[rope].lateral
        loop[part] = layout.arc_lengths[part] + (scenario.strands[rope].offset if rope in scenario.strands else 0.0)
    counter = LifeCounter(scenario, layout)
    driven = [name in {one.sheave for one in scenario.drives.values()} for name in layout.sheaves]
    for number, place in enumerate(travel):
        idle = place + (number % 2)  # swings by a metre, which is no travel of the rope
        columns = SimpleNamespace(
            support_force=np.full((len(layout.supports), 3), 1e3),
            sheave_position=np.where(driven, place, idle),
            rope_tension=tension(loop),
            rope_position=shape,
        )
        counter.log(SimpleNamespace(columns=columns))
    return scenario, counter.lives()


def test_a_rope_point_of_a_loop_passes_each_sheave_once_in_a_trip():
    """Six towers of eight sheaves on both strands, and two bullwheels; the tension along the loop is a sine."""
    length = load_scenario("chairlift").loop_length

    def tension(loop):
        return 2e5 + 3e4 * np.sin(2.0 * np.pi * loop / length)

    scenario, (life,) = counted("chairlift", np.linspace(0.0, 2.0 * length, 400), tension)
    assert [*loops_of(scenario)] == [["up", "down"]]
    assert sum(one.cycles for one in life.bends) == 2 * 6 * 8 + 2
    assert life.circulates
    assert life.trips == pytest.approx(2.0)
    ((size, weight),) = {(round(one.range, -1), one.weight) for one in life.per_trip}
    assert (size, weight, len(life.per_trip)) == (pytest.approx(6e4, rel=1e-3), 0.5, 2)
    assert max(one.range for one in life.in_run) == pytest.approx(6e4, rel=1e-3)
    assert sum(one.weight for one in life.in_run if one.range > 1e4) == pytest.approx(2.0, abs=0.5)
    (drive,) = [one for one in life.bends if one.name == "drive"]
    assert (drive.diameter, drive.angle) == (4.2, pytest.approx(np.pi))
    middle = tension(np.array([scenario.ropes["up"].unstrained_length + 0.5 * np.pi * 2.1]))[0]
    assert drive.tension[1] == pytest.approx(middle, rel=1e-3)
    (tower,) = [one for one in life.bends if one.name == "tower_1_up"]
    assert tower.angle == pytest.approx(np.sqrt(3.0) * 1e3 / tower.tension[1] / 8)


def test_a_rope_point_of_a_jig_back_passes_what_is_within_its_travel_twice():
    scenario, lives = counted("jig_back", np.linspace(0.0, 100.0, 11), lambda loop: 1e5 + 10.0 * loop)
    life = next(one for one in lives if one.length)
    reach = haul_reach(scenario, ["haul_1", "haul_2"])
    assert not life.circulates
    assert life.trip == pytest.approx(2.0 * reach)
    assert life.trips == pytest.approx(100.0 / (2.0 * reach))
    assert {one.passes for one in life.bends} <= {0, 2}
    assert sum(one.cycles for one in life.bends) == 2 * (8 + 8 + 1)  # reaches both towers over one bullwheel
    assert [one.name for one in lives if not one.length] == ["track_1", "track_2"]
    assert sum(one.range for one in life.per_trip if one.weight == 0.5) > 0.0
