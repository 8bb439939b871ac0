"""Bullwheels and closed loops in a scenario: what is wrong with each, a line each."""

import pytest
from changed_keys import change
from ruamel.yaml import YAML
from test_scenario_faults import faults_of

from cable_twin.scenario import ScenarioError, config_directory, load_scenario
from cable_twin.simulation import EquilibriumError, Simulation


def lift(**changes):
    """The shipped chairlift as plain data, with changes at keys joined by two underscores."""
    data = load_scenario("chairlift").resolved()
    return change(data, changes)


WEIGHT = {"direction": [-0.98, -0.197], "mass": 33.0e3}
PUSHES = {**WEIGHT, "direction": [0.98, 0.197]}


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"sheaves__return__joins": ["down.end", "down.start"]}, "joins.1: given 'down.start': 'drive' joins it"),
        ({"sheaves__return__joins": ["down.start", "up.start"]}, "joins.0: given 'down.start'; allowed: up.end, down."),
        ({"sheaves__drive__joins": ["up.end"]}, "sheaves.drive.joins: given"),
        ({"ropes__down__end__position": [30.0, 0.0]}, "sheaves.return.joins: given ends that are 30 m apart"),
        ({"ropes__down__mass_per_length": 7.0}, "ropes.down.mass_per_length: given 7.0 kg/m: 'drive' joins it to"),
        ({"ropes__down__start__support": "free"}, "ropes.down.start.support: given 'free': at a bullwheel"),
        ({"carriers__spacing": 60.0}, "carriers.count: given 28: every 60 m, 1680 m; allowed: at most the loop of"),
        ({"sheaves__return__counterweight": {**WEIGHT, "travel": [4.0, -4.0]}}, "travel: given [4.0, -4.0] m; allowed"),
        ({"sheaves__return__counterweight": PUSHES}, "away from their other ends, about [-0.976, -0.22]"),
        ({"sheaves__return__rollback": 0.5}, "sheaves.return.rollback: given 0.5 m: no drive turns it"),
        ({"drives__haul_rope__sheave": "middle"}, "drives.haul_rope.sheave: given 'middle'; allowed: drive, return"),
        ({"carriers__payload__leaving": {"middle": 1.0}}, "payload.leaving.middle: given 'middle': no such bullwheel;"),
        ({"carriers__payload__leaving": {"return": 500.0}}, "payload.leaving.return: given 500.0 kg; allowed: 0 to 30"),
    ],
)
def test_a_loop_that_cannot_be_is_told_in_a_line(changes, said):
    faults = faults_of(lift(**changes))
    assert sum(said in fault for fault in faults) == 1, faults
    assert not any("from_start" in fault or "from_end" in fault for fault in faults)


def test_a_loop_that_does_not_close_is_told():
    data = lift()
    del data["sheaves"]["return"]
    data["carriers"]["payload"]["leaving"] = {}
    assert any("is not on a closed loop" in fault for fault in faults_of(data))


def test_a_rope_that_no_vehicle_can_reach_is_told():
    data = lift()
    data["ropes"]["alone"] = data["ropes"]["up"]
    assert any("ropes.alone: given" in fault for fault in faults_of(data))


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("drive__friction", 0.005, r"sheaves\.drive: at rest its strands pull with 189.4 kN and 180.4 kN"),
        (
            "return__counterweight",
            {**WEIGHT, "travel": [-0.2, 0.2]},
            "given .* less pull, or ropes that are 0.339 m sh",
        ),
        (
            "return__counterweight",
            {**WEIGHT, "travel": [0.5, 4.0]},
            "rests at 0.3695 m; .* more pull, .* 0.261 m longer",
        ),
        (
            "return__counterweight__mass",
            100.0,
            "given 100 kg, .* 981 N: no static equilibrium; allowed: about 28700 kg",
        ),
        ("return__counterweight__force", 500.0, "given 500 N: no static equilibrium; allowed: about 281000 N"),
    ],
)
def test_a_rest_that_cannot_be_is_told_in_a_line(key, value, said):
    with pytest.raises(EquilibriumError, match=said) as caught:
        Simulation(load_scenario(lift(**{f"sheaves__{key}": value})), samples=2)
    assert "allowed: " in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_rope_beside_its_bullwheel_is_refused_where_that_is_real():
    with pytest.raises(ScenarioError, match="joins: given ends that are 12 m apart; allowed: at most the diameter"):
        load_scenario("jig_back", {"ropes.haul_1.lateral": 3.0})


@pytest.mark.parametrize(("key", "given"), [("travel", [0.0, 0.5]), ("sheave", "wheel")])
def test_the_drive_of_a_cable_without_bullwheels_takes_none_of_theirs(key, given):
    drive = {"kind": "moving_cable", key: given}
    with pytest.raises(ScenarioError, match=rf"drives.haul_rope.{key}: given .*; allowed: null"):
        load_scenario("aerial_tramway", {"drives": {"haul_rope": drive}})


def test_a_drive_without_force_has_none_while_bearings_hold_the_wheel():
    simulation = Simulation(load_scenario(lift(sheaves__drive__resistance=1e5)), samples=2, on_demand=True)
    simulation.command("haul_rope", force=0.0)
    simulation.advance_to(3.0)
    drive = simulation.snapshot.drives["haul_rope"]
    assert (drive.speed, drive.force) == (0.0, 0.0)


def own_lift():
    """A file of a lift as it is written, not resolved."""
    return YAML(typ="safe", pure=True).load(config_directory() / "chairlift.yaml")


@pytest.mark.parametrize(
    ("key", "given", "said"),
    [
        ("towers__tower_3__ropes", {"up": {}, "dwn": {}}, "towers.tower_3.ropes.dwn: given 'dwn': no such rope; allow"),
        ("towers__tower_3__ropes", ["up", "down"], "towers.tower_3.ropes: given ['up', 'down']; allowed: a mapping"),
        ("towers__tower_3__ropes", {"up": 1.0}, "towers.tower_3.ropes.up: given 1.0; allowed: a mapping of keys of"),
        ("sheaves__drive__drive", 5, "sheaves.drive.drive: given 5; allowed: a mapping with the keys of a drive"),
        ("sheaves__drive__drive__name", True, "sheaves.drive.drive.name: given True; allowed: a text"),
        ("sheaves__drive__drive__name", "", "sheaves.drive.drive.name: given ''; allowed: a text, not empty"),
        ("sheaves__drive__joins", ["up.end", "dwn.start"], "sheaves.drive.joins.1: given 'dwn.start'; allowed: "),
    ],
)
def test_what_a_file_says_wrong_is_its_first_line(key, given, said):
    assert faults_of(change(own_lift(), {key: given}))[0].partition(": ")[2].startswith(said)


@pytest.mark.parametrize("given", [{}, {"name": None}])
def test_a_drive_without_a_name_is_called_as_its_bullwheel(given):
    data = own_lift()
    drive = {key: value for key, value in data["sheaves"]["drive"]["drive"].items() if key != "name"}
    data["sheaves"]["drive"]["drive"] = drive | given
    assert list(load_scenario(data).drives) == ["drive"]


def test_a_strand_that_is_not_there_is_a_line():
    data = own_lift()
    del data["ropes"]["down"]
    for tower in data["towers"].values():
        tower["ropes"].pop("down", None)
    with pytest.raises(ScenarioError, match=r"sheaves.drive.joins.1: given 'down.start'; allowed: up.start"):
        load_scenario(data)
