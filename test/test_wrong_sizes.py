"""Sizes that no ropeway has are refused before anything is calculated: what breaks a rope, towers in each other."""

import pytest

from cable_twin.scenario import ScenarioError, load_scenario


@pytest.mark.parametrize(
    ("scenario", "changes", "told"),
    [
        (
            "aerial_tramway",
            {"cable.start.mass": 1.3e6},
            "mass: given 1300000.0 kg: a pull of 12750 kN; allowed",
        ),
        (
            "bicable",
            {"ropes.track_up.start.mass": 300e3},
            "start.mass: given 300000.0 kg: a pull of 2943 kN; allowed",
        ),
        ("chairlift", {"sheaves.return.counterweight.mass": 200e3}, "counterweight.mass: given 200000.0 kg: a pull of"),
        (
            "chairlift",
            {"sheaves.return.counterweight": None}
            | {"sheaves.return.hydraulics": {"direction": [-0.98, -0.2], "force": 2.5e6, "band": 5e3}},
            "hydraulics.force: given 2500000.0 N: a pull of 2500 kN; allowed: less than 1920 kN, with which its",
        ),
        ("aerial_tramway", {"carriages.cabin.payload.capacity": 6.4e6}, "capacity: given 6400000.0 kg: the veh"),
        ("chairlift", {"carriers.bodies.chair.mass": 250e3}, "carriers.bodies.chair.mass: given 250000.0 kg: the veh"),
        (
            "chairlift",
            {"sheaves.drive.radius": 2100.0},
            "sheaves.drive.radius: given 2100.0 m; allowed: a finite",
        ),
        (
            "chairlift",
            {"ropes.up.ice": 2000.0},
            "ropes.up.ice: given 2000.0 kg/m; allowed: a finite number at least 0 and",
        ),
        (
            "aerial_tramway",
            {"towers.tower.length": 900.0, "towers.tower.radius": 2000.0},
            "towers.tower.length: given 900.0 m: it reaches over the start, 424 m away; allowed: at least 450 m betw",
        ),
        (
            "chairlift",
            {"towers.tower_2.length": 270.0, "towers.tower_2.radius": 900.0},
            "tower_2.length: given 270.0 m: it reaches over tower_1_up, 113 m away, 4.5 m long; allowed: at least 13",
        ),
        (
            "chairlift",
            {"towers.tower_2.position": [42.0, 10.0]},
            "towers.tower_2.length: given 4.5 m: it reaches over tower_1_up, 2.06 m away, 4.5 m long; allowed: at l",
        ),
    ],
)
def test_sizes_of_no_ropeway_are_refused_in_a_line(scenario, changes, told):
    with pytest.raises(ScenarioError) as error:
        load_scenario(scenario, changes)
    assert told in error.value.faults[0]
    assert "\n" not in error.value.faults[0]


def test_what_its_rope_bears_is_no_fault():
    assert load_scenario("aerial_tramway", {"cable.start.mass": 400e3, "cable.breaking_force": None})
