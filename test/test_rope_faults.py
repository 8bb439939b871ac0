"""Ropes without an equilibrium: connectors, bullwheels, counterweights and grooves, in a line with key and values."""

import re

import numpy as np
import pytest
from bent_line import BENT
from test_scenario_faults import OWN_LIFT, SPAN, TWO_ROPES, WEIGHT, faults_of

from cable_twin.mechanics.solution.bundle.loop_rest import settle_loop
from cable_twin.mechanics.solution.bundle.records import FIXED
from cable_twin.scenario import load_scenario
from cable_twin.simulation import EquilibriumError, Simulation, SnapshotError, loop


def test_several_ropes_go_through_yaml_and_back():
    scenario = load_scenario(TWO_ROPES, {"ropes.lower.unstrained_length": 300.0})
    assert "cable" not in scenario.resolved()
    assert load_scenario(scenario.resolved()).resolved() == scenario.resolved()
    assert scenario.cable == scenario.ropes["upper"]


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        (
            {"connectors.other.to": ["lower", 66.0]},
            "connectors.other.to: given 66 m on 'lower', at rest 6.006 m aside from 60 m on 'upper' without this "
            "connector of 1 m; allowed: a place up to 2.998 m aside",
        ),
        (
            {"ropes.upper.start.position": [0.0, 30.0], "ropes.upper.end.position": [100.0, 30.0]},
            "connectors.one.to: given 30 m on 'lower', at rest 30 m away from 30 m on 'upper' without this connector "
            "of 1 m; allowed: a place up to 10.99 m away",
        ),
    ],
)
def test_a_connector_that_cannot_reach_is_named_before_it_bends_the_ropes(changes, said):
    with pytest.raises(EquilibriumError, match=f"^{re.escape(said)}$"):
        Simulation(load_scenario(TWO_ROPES, changes), samples=2)


UNBREAKABLE = {f"ropes.{name}.breaking_force": None for name in ("up", "down")}


@pytest.mark.parametrize("changes", [{}, {"space": 3}])
def test_a_weight_that_no_tension_holds_is_told(changes):
    """Strands over towers, in a plane and in space, without a traceback of the search."""
    with pytest.raises(EquilibriumError, match=r"^no tension up to 620000 kN, .* its weight is 4.993e\+10 kN; "):
        Simulation(load_scenario("chairlift", {"gravity": 1e10, **UNBREAKABLE, **changes}))


# a mesh on which no shape of a rope with hardly any pull is found
SHORT = {f"ropes.{name}.elements": {"target": 12.0, "at_towers": 1.0, "growth": 3.0} for name in ("up", "down")}
TIGHT, SLACK = {**WEIGHT, "travel": [-0.2, 0.2]}, {**WEIGHT, "travel": [0.5, 4.0]}


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("drive.friction", 0.005, r"sheaves\.drive: at rest its strands pull with 189.4 kN and 180.4 kN"),
        ("return.counterweight", TIGHT, "given .* less pull, or ropes that are 0.337 m sh"),
        ("return.counterweight", SLACK, "rests at 0.3687 m; .* more pull, .* 0.263 m longer"),
        ("return.counterweight.mass", 100.0, "given 100 kg, .* 981 N: no static equilibrium; allowed: about 28700 kg"),
        ("return.counterweight.force", 500.0, "given 500 N: no static equilibrium; allowed: about 282000 N"),
    ],
)
def test_a_rest_that_cannot_be_is_told_in_a_line(key, value, said):
    mesh = SHORT if "no static equilibrium" in said else {}
    with pytest.raises(EquilibriumError, match=said) as caught:
        Simulation(load_scenario("chairlift", {f"sheaves.{key}": value, **mesh}), samples=2)
    assert "allowed: " in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_counterweight_that_can_balance_is_not_blamed(monkeypatch):
    """That of the chairlift rests at 0.37 m of 4 m: what else a search fails of is told, and what is known."""

    def fails(sheaves, *others):
        if np.any(sheaves.tensioning != FIXED):
            raise EquilibriumError("no rest")
        settle_loop(sheaves, *others)

    monkeypatch.setattr(loop, "settle_loop", fails)
    said = (
        "^no rest; with a travel of 0 m the loop rests, where sheaves.return.counterweight.mass needs about 28700 kg$"
    )
    with pytest.raises(EquilibriumError, match=said):
        Simulation(load_scenario("chairlift"), samples=2)


def test_a_drive_without_force_has_none_while_bearings_hold_the_wheel():
    scenario = load_scenario("chairlift", {"sheaves.drive.resistance": 1e5})
    simulation = Simulation(scenario, samples=2, on_demand=True)
    simulation.command("haul_rope", force=0.0)
    simulation.advance_to(3.0)
    drive = simulation.snapshot.drives["haul_rope"]
    assert (drive.speed, drive.force) == (0.0, 0.0)


@pytest.mark.parametrize("given", [{}, {"name": None}])
def test_a_drive_without_a_name_is_called_as_its_bullwheel(given):
    sheaves = OWN_LIFT["sheaves"]
    drive = {key: value for key, value in sheaves["drive"]["drive"].items() if key != "name"} | given
    scenario = load_scenario({**OWN_LIFT, "sheaves": {**sheaves, "drive": {**sheaves["drive"], "drive": drive}}})
    assert list(scenario.drives) == ["drive"]


@pytest.mark.parametrize(("part", "length"), [("state", 0.0), ("start", 0.5)])
def test_an_orientation_that_is_none_is_found_in_a_snapshot(tmp_path, part, length):
    """Snapshot files, the only input with orientations of bodies."""
    path = tmp_path / "state.npz"
    Simulation(load_scenario(SPAN)).save(path)
    with np.load(path) as archive:
        arrays = dict(archive)
    arrays[f"{part}/bodies.position"][0, 3:] *= length
    with path.open("wb") as stream:
        np.savez(stream, **arrays)
    with pytest.raises(SnapshotError) as caught:
        Simulation.load(path)
    assert str(caught.value) == (
        f"{path}: {part}/bodies.position: the quaternion of body 0 has a length of {length:.3g}; allowed: 1"
    )


def test_a_groove_that_pushes_its_rope_out_at_rest_is_refused_for_several_ropes_too():
    """Equal message for a single rope and for the first of two."""
    tower = {**BENT["towers"]["tower"], "derailment_ratio": 0.05}
    (one,) = faults_of({**BENT, "towers": {"tower": tower}})
    other = {**BENT["cable"], **{end: {"position": [x, 60.0, 0.0]} for end, x in (("start", 0.0), ("end", 200.0))}}
    both = {"name": "two", "ropes": {"first": BENT["cable"], "second": other}, "solver": BENT["solver"]}
    assert faults_of({**both, "towers": {"tower": {**tower, "rope": "first"}}}) == (one,)
    assert "pushes sideways with" in one


def test_strands_that_would_be_pushed_out_of_their_grooves_at_rest_are_refused():
    coarse = {f"ropes.{rope}.elements": 60 for rope in ("up", "down")}
    aside = {"space": 3, "towers.tower_3.position": [290.0, 3.0, 66.0], "towers.tower_3.derailment_ratio": 0.1}
    with pytest.raises(EquilibriumError, match=r"towers\.tower_[23]_up\.position: .*pushes sideways with .* kN"):
        Simulation(load_scenario("chairlift", coarse | aside))
