"""Keys of whole lifts in a file, and names for commands and sensors of them."""

from __future__ import annotations

import numpy as np
import pytest
from jsonschema import Draft202012Validator
from ruamel.yaml import YAML
from test_scenario_faults import faults_of

from cable_twin.frame.records import Command, CommandError
from cable_twin.frame.sensors import Sensors
from cable_twin.offline.sweep import is_whole
from cable_twin.scenario import load_scenario
from cable_twin.scenario.files import config_directory
from cable_twin.scenario.reference import explained, json_schema
from cable_twin.simulation import Simulation
from cable_twin.view.labels import shared_names

YAML_1_2 = YAML(typ="safe", pure=True)
COARSE = {"ropes.up.elements": 100, "ropes.down.elements": 100}


@pytest.mark.parametrize("key", ["sheaves.drive.drive.limits.speed", "drives.haul_rope.limits.speed"])
def test_a_drive_is_changed_where_the_file_has_it_and_by_its_name(key):
    assert load_scenario("chairlift", {key: 1.5}).drives["haul_rope"].limits.speed == 1.5


def test_bullwheels_is_another_name_of_sheaves():
    content = YAML_1_2.load(config_directory() / "chairlift.yaml")
    other = {"bullwheels" if key == "sheaves" else key: value for key, value in content.items()}
    assert load_scenario(other) == load_scenario(content)
    changed = {"sheaves.drive.radius": 2.15, "sheaves.drive.drive.speed": 1.0}
    renamed = {key.replace("sheaves", "bullwheels"): value for key, value in changed.items()}
    assert load_scenario(other, renamed) == load_scenario(content, changed)
    (fault,) = faults_of({**other, "sheaves": content["sheaves"]})
    assert fault == "mapping: bullwheels: given a mapping: also given as `sheaves`; allowed: one of the two"
    (fault,) = faults_of({**other, "bullwheels": {**content["sheaves"], "other": 5}})
    assert fault == "mapping: bullwheels.other: given 5; allowed: a mapping"
    assert explained("bullwheels.NAME.radius") == explained("sheaves.NAME.radius")
    assert not list(Draft202012Validator(json_schema()).iter_errors(other))


def test_what_only_a_file_has_is_changed_whole_or_in_part():
    drive = {"name": "motor", "limits": {"speed": 1.0}}
    assert load_scenario("chairlift", {"sheaves.drive.drive": drive}).drives["motor"].limits.speed == 1.0
    named = load_scenario("chairlift", {"sheaves.drive.drive.name": "motor", "sheaves.drive.drive.limits.speed": 1.5})
    assert named.drives["motor"].limits.speed == 1.5
    one = load_scenario("chairlift", {"towers.tower_1.ropes.down.stiffness": 1e6}).towers
    assert [one[f"tower_1_{rope}"].stiffness for rope in ("up", "down")] == [3e5, 1e6]
    lone = load_scenario("chairlift", {"towers.tower_1.ropes": {"up": {}}}).towers
    assert ("tower_1_up" in lone, "tower_1_down" in lone) == (True, False)
    tower = {"position": [40.0, 8.0], "contacts": 2, "length": 1.0, "stiffness": 2e5, "ropes": {"up": {}}}
    whole = load_scenario("chairlift", {"towers.tower_1": tower}).towers
    assert ("tower_1_down" in whole, whole["tower_1_up"].stiffness) == (False, 2e5)
    alone = load_scenario("chairlift", {"towers": {"one": tower}}).towers
    assert list(alone) == ["one_up"]
    more = load_scenario("chairlift", {"towers.one": {**tower, "position": [60.0, 19.0]}}).towers
    assert {"one_up", "tower_1_up", "tower_1_down"} <= set(more)
    sheave = YAML_1_2.load(config_directory() / "chairlift.yaml")["sheaves"]["drive"]
    turned = load_scenario("chairlift", {"sheaves.drive": {**sheave, "drive": {"name": "motor"}}})
    assert list(turned.drives) == ["motor"]


def test_a_whole_tower_is_put_before_what_is_below_it():
    tower = {"position": [40.0, 8.0], "contacts": 2, "length": 1.0, "stiffness": 2e5, "ropes": {"up": {}}}
    below = [{"towers.tower_1.stiffness": 1e5}, {"towers.tower_1.ropes.up.stiffness": 1e5}]
    alone = {key: value for key, value in tower.items() if key != "ropes"}
    below.append({"towers.tower_1_up": {**alone, "stiffness": 1e5}})
    for other in below:
        for overrides in ({"towers.tower_1": tower} | other, other | {"towers.tower_1": tower}):
            one = load_scenario("chairlift", overrides).towers
            assert (one["tower_1_up"].stiffness, one["tower_1_up"].rope) == (1e5, "up")


def test_a_fault_is_where_the_file_or_the_override_has_it():
    def faults(*overrides):
        return [fault.partition("chairlift.yaml")[2] for fault in faults_of("chairlift", dict(overrides))]

    for key in ("sheaves.drive.drive.speed", "drives.haul_rope.speed"):
        assert faults((key, 3.0)) == [
            f" (override): {key}: given 3.0 m/s; allowed: -2.5 to 2.5 m/s, the limit of the drive"
        ]
    for key in ("towers.tower_1.stiffness", "towers.tower_1.ropes.up.stiffness", "towers.tower_1_up.stiffness"):
        said = f" (override): {key}: given -1.0 N/m; allowed: a finite number above 0, in N/m"
        assert faults((key, -1.0)) == [said]  # once, though it is a tower of each rope
    (fault,) = faults(("sheaves.drive.drive.limits.sped", 1.0))
    assert fault == " (override): sheaves.drive.drive.limits.sped: this key does not exist; did you mean 'speed'?"
    (fault,) = faults(("towers.tower_1.ropes.dwn.stiffness", 1.0))
    assert fault == ": towers.tower_1.ropes.dwn: given 'dwn': no such rope; allowed: up, down"


def test_a_tower_of_several_ropes_is_changed_for_all_or_for_one():
    both = load_scenario("chairlift", {"towers.tower_1.stiffness": 1e6}).towers
    assert [both[f"tower_1_{rope}"].stiffness for rope in ("up", "down")] == [1e6, 1e6]
    one = load_scenario("chairlift", {"towers.tower_1_down.stiffness": 1e6}).towers
    assert [one[f"tower_1_{rope}"].stiffness for rope in ("up", "down")] == [3e5, 1e6]
    left = load_scenario("chairlift", {"carriers.payload.leaving.return": 150.0}).carriers.payload.leaving
    assert left == {"return": 150.0, "drive": 0.0}


def _as_in_a_log(name):
    return load_scenario(name).resolved()


@pytest.mark.parametrize("source", ["chairlift", _as_in_a_log("chairlift")], ids=["file", "log"])
def test_keys_of_a_file_work_in_the_scenario_of_a_log_too_and_one_rope_goes_before_all(source):
    for one in ("towers.tower_1.ropes.up.stiffness", "towers.tower_1_up.stiffness"):
        both = {"towers.tower_1.stiffness": 1e5, one: 2e5}
        for overrides in (both, dict(reversed(both.items()))):
            found = load_scenario(source, overrides).towers
            assert [found[f"tower_1_{rope}"].stiffness for rope in ("up", "down")] == [2e5, 1e5]
    assert load_scenario(source, {"bullwheels.drive.drive.limits.jerk": 0.2}).drives["haul_rope"].limits.jerk == 0.2
    assert load_scenario(source, {"towers.tower_1.ropes.up.position.z": 9.0}).towers["tower_1_up"].position[-1] == 9.0
    assert all("(override)" in fault for fault in faults_of(source, {"towers.tower_1.ropes.up.stiffness": -1.0}))
    assert is_whole(load_scenario(source), "towers.tower_1.contacts")


@pytest.mark.parametrize(
    ("overrides", "said"),
    [
        ({"cable.elements": 60}, "cable.elements: given 60: with several ropes; allowed: ropes.up, ropes.down"),
        ({"sheaves.drive.drive.limits.sped": 1.0}, "limits.sped: this key does not exist; did you mean 'speed'"),
        ({"drives.haul_rope.speed": 3.0}, "drives.haul_rope.speed: given 3.0 m/s; allowed: -2.5 to 2.5 m/s"),
        (
            {"sensors": {"cell": {"kind": "load_cell", "of": "start"}}},
            "sensors.cell.of: given 'start'; allowed: up/start, up/end, down/start, down/end, tower_1_up",
        ),
    ],
)
def test_what_cannot_be_is_one_line(overrides, said):
    (fault,) = faults_of("chairlift", overrides)
    assert said in fault


def test_a_key_of_a_rope_where_there_is_one_cable_names_that_of_the_cable():
    (fault,) = faults_of("aerial_tramway", {"ropes.up.ice": 2.0})
    assert fault.endswith("(override): ropes.up.ice: given 2.0 kg/m: with one cable; allowed: cable.ice")


def test_sensors_of_a_loop_and_a_force_that_friction_cannot_carry():
    sensors = {
        "cell": {"kind": "load_cell", "of": "up/end", "rate": 50.0},
        "drive": {"kind": "encoder", "of": "haul_rope", "rate": 50.0},
        "chair": {"kind": "encoder", "of": "chair_20", "rate": 50.0},
    }
    scenario = load_scenario("chairlift", {**COARSE, "sensors": sensors, "drives.haul_rope.speed": 1.0})
    simulation = Simulation(scenario)
    measure = Sensors(scenario, simulation.layout)
    measured = {item.sensor: item.values for item in measure.take(simulation.advance_to(0.5))}
    c = simulation.snapshot.columns
    # the bullwheel turns the momentum of the rope as well
    assert np.linalg.norm(measured["cell"]) == pytest.approx(c.sheave_tension[0, 0], rel=1e-3)
    assert measured["drive"][0] == pytest.approx(0.5)
    assert measured["chair"][0] == simulation.layout.on_loop(c)[19] > 818.5
    with pytest.raises(CommandError, match=r"force of 'haul_rope': given 1e\+12 N; allowed: -106453 to 106453 N"):
        simulation.apply(Command("force", {"haul_rope": 1e12}))
    simulation.command("haul_rope", force=0.0)
    assert simulation.advance_to(3.0).drives["haul_rope"].speed < 0.5  # the weight of those going up is the greater one
    with pytest.raises(ValueError, match="given a scenario of 2 ropes; allowed: one rope"):
        simulation.natural_frequencies(1)


def test_a_space_has_its_strands_where_a_plane_shows_them():
    simulation = Simulation(load_scenario("chairlift", {**COARSE, "space": 3}), samples=5)
    c, ropes = simulation.snapshot.columns, simulation.layout.ropes
    assert c.rope_position[ropes["up"], 1] == pytest.approx(np.full(5, 2.1), abs=1e-6)
    assert c.rope_position[ropes["down"], 1] == pytest.approx(np.full(5, -2.1), abs=1e-6)


def test_what_is_in_one_place_has_one_name():
    places = {
        "up/end": (800.0, 1.0),
        "down/start": (800.0, 1.0),
        "tower_1_up": (40.0, 9.0),
        "tower_1_down": (40.0, 9.0),
    }
    rim = np.array([(798.0, -2.0, 1.0), (802.0, 2.0, 1.0)])
    called = shared_names(places, {"drive": rim}, ["up", "down"])
    assert called == {"drive": places["up/end"], "tower_1": places["tower_1_up"]}


def test_what_stands_closer_than_letters_has_one_name():
    """Masts of two tracks, bullwheels behind ends of track ropes, towers of several strands."""
    places = {
        "track_1/start": (0.0, 4.5, 0.0),
        "track_2/end": (0.0, -4.5, 0.0),
        "haul_1/start": (-15.0, 4.5, -5.0),
        "tower_1_track_1": (400.0, 4.5, 142.0),
        "tower_1_track_2": (400.0, -4.5, 142.0),
        "rollers_1_haul_1": (400.0, 4.5, 140.0),
        "tower_2_track_1": (450.0, 4.5, 160.0),
    }
    rims = {"return": np.array([(-16.0, -4.5, -5.0), (-14.0, 4.5, -5.0)])}
    ropes = ["track_1", "track_2", "haul_1"]
    assert list(shared_names(places, rims, ropes, near=20.0)) == ["return", "tower_1, rollers_1", "tower_2_track_1"]
    assert len(shared_names(places, rims, ropes)) == len(places)


def test_places_that_begin_alike_keep_names_of_their_own():
    places = {
        "haul_1/start": (0.0, 0.0),
        "haul_2/end": (0.0, 0.0),
        "haul_1/end": (9.0, 1.0),
        "haul_2/start": (9.0, 1.0),
    }
    rims = {"return": np.array([(-2.0, 0.0, 0.0), (2.0, 0.0, 0.0)])}
    assert list(shared_names(places, rims)) == ["return", "haul"]
    assert list(shared_names(places, {})) == ["haul", "haul_1/end, haul_2/start"]
