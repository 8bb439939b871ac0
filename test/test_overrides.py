"""Scenario values by dotted key: equal keys for `--set`, `--sweep`, `sim --set` and Python."""

import pytest
from test_scenario_faults import faults_of

from cable_twin.offline import line, simulate
from cable_twin.offline.simulate_options import sweep_of
from cable_twin.offline.sweep import swept_scenarios
from cable_twin.scenario import ScenarioError, load_scenario

SENSOR = {"kind": "encoder", "of": "cabin"}
CASES = [  # of one rope and of several, in a plane and in space: scenario, key, value; the same in full
    ("aerial_tramway", "wind.x", 27.4, "air.wind", [27.4, 0.0]),
    ("aerial_tramway", "air.wind.z", 2, "air.wind", [0.0, 2]),
    ("aerial_tramway", "wind", [3.0, 1.0], "air.wind", [3.0, 1.0]),
    ("aerial_tramway", "wind.turbulence.intensity", 0.1, "air.turbulence", {"intensity": 0.1}),
    ("aerial_tramway", "cable.end.position.0", 1001.0, "cable.end.position", [1001.0, 300.0]),
    ("aerial_tramway", "towers.tower.position.z", 143.0, "towers.tower.position", [400.0, 143.0]),
    ("aerial_tramway", "terrain.12.1", -1.0, "terrain", None),
    ("aerial_tramway", "sensors.place", SENSOR, "sensors", {"place": SENSOR}),
    ("aerial_tramway", "carriages.cabin.payload.position.z", -0.5, "carriages.cabin.payload.position", [0.0, -0.5]),
    ("single_span", "cable.elements.target", 9.0, "cable.elements", {"target": 9.0, "at_towers": 3.0}),
    ("windy_tramway", "wind.y", 12.0, "air.wind", [0.0, 12.0, 0.0]),
    ("windy_tramway", "wind.1", 12.0, "air.wind", [0.0, 12.0, 0.0]),
    ("windy_tramway", "cable.start.direction.x", -0.95, "cable.start.direction", [-0.95, 0.0, -0.297]),
    ("chairlift", "wind.x", -5.0, "air.wind", [-5.0, 0.0]),
    ("chairlift", "ropes.up.end.position.z", 181.0, "ropes.up.end.position", [800.0, 181.0]),
    ("chairlift", "towers.tower_1.position.z", 9.6, "towers.tower_1.position", [40.0, 9.6]),
    ("chairlift", "towers.tower_1_up.position.z", 9.6, "towers.tower_1.ropes.up.position", [40.0, 9.6]),
    ("chairlift", "sheaves.return.counterweight.travel.0", -5, "sheaves.return.counterweight.travel", [-5, 4.0]),
    ("jig_back", "wind.y", 12.0, "air.wind", [0.0, 12.0, 0.0]),
]


@pytest.mark.parametrize(("name", "key", "value", "whole_key", "whole"), CASES)
def test_a_part_of_a_list_or_a_new_thing_is_as_the_whole(name, key, value, whole_key, whole):
    changed = {}
    if whole is None:
        whole = load_scenario(name).resolved()["terrain"]
        whole[12][1] = value
    if key == "cable.elements.target":
        changed = {"cable.elements.at_towers": 3.0}
    expected = load_scenario(name, {whole_key: whole})
    assert load_scenario(name, {**changed, key: value}) == expected != load_scenario(name)
    if isinstance(value, float):
        (swept,) = swept_scenarios(sweep_of(f"{key}={value}:{value}:1.0"), name, changed)
        assert swept == expected


def test_the_whole_goes_before_what_is_in_it_and_files_and_shared_lists_stay():
    assert load_scenario("aerial_tramway", {"wind.x": 4.0, "air.wind": [1.0, 2.0]}).air.wind == (4.0, 2.0)
    content = load_scenario("chairlift").resolved()
    shared = content["ropes"]["up"]["start"]["position"]
    content["ropes"]["down"]["end"]["position"] = shared
    with pytest.raises(ScenarioError):  # strands that no longer meet their wheel
        load_scenario(content, {"ropes.up.start.position.x": "far"})
    assert shared == [0.0, 0.0]


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("wind.q", 1.0, "air.q: this key does not exist; allowed: density"),
        ("air.wind.q", 1.0, "air.wind.q: this key does not exist; allowed: x, y, z or a number from 0 to 1"),
        ("wind.y", 1.0, "air.wind: given [0.0, 1.0, 0.0] m/s: three numbers in a plane"),
        ("wind.x", "gale", "air.wind: given ['gale', 0.0]; allowed: a list of 2 finite numbers"),
        ("cable.end.position.2", 1.0, "cable.end.position.2: this key does not exist; allowed: x, y, z or a number"),
        ("cable.end.position.x.0", 1.0, "cable.end.position.x.0: this key does not exist; nothing can be set below"),
        ("cable.mass_per_length.x", 1.0, "cable.mass_per_length.x: this key does not exist; nothing can be set below"),
        ("terrain.13.0", 1.0, "terrain.13: this key does not exist; allowed: a number from 0 to 12"),
        ("cable.loads.0.force.x", 1.0, "cable.loads.0: this key does not exist; nothing can be set below this"),
        ("sensors.place.rate", 9.0, "allowed: a whole mapping, as in sensors.place={...}"),
        ("sensors.place", {"kind": "scale", "of": "cabin"}, "sensors.place.kind: given 'scale'; allowed: one of"),
        ("towers.tower_1.position", [545.0, 30.0], "towers.tower_1: this key does not exist; did you mean 'tower'?"),
        ("carriages.cabbin.speed", 1.0, "carriages.cabbin: this key does not exist; did you mean 'cabin'?"),
        ("cable.elements.taget", 1.0, "cable.elements.taget: this key does not exist; did you mean 'target'?"),
    ],
)
def test_what_leads_nowhere_is_one_line(key, value, said):
    (fault,) = faults_of("aerial_tramway", {key: value})
    assert "aerial_tramway.yaml (override): " in fault
    assert said in fault


@pytest.mark.parametrize("module", [simulate, line])
def test_options_take_them(module, capsys):
    """Refusal by value instead of key, before anything runs."""
    assert module.main(["aerial_tramway", "--set", "wind.x=120", "--set", "sensors.place={kind: encoder, of: up}"]) == 2
    faults = capsys.readouterr().err.splitlines()
    assert len(faults) == 2
    assert "air.wind: given [120.0, 0.0] m/s: a speed of 120 m/s; allowed: at most 100 m/s" in faults[1]
    assert "sensors.place.of: given 'up'" in faults[0]
