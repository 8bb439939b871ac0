"""What is wrong with a scenario or a snapshot in space, each in one line with file, key, given, allowed and unit."""

from __future__ import annotations

from math import inf, nan

import numpy as np
import pytest
from bent_line import BENT

from cable_twin.scenario import ScenarioError, load_scenario
from cable_twin.simulation import EquilibriumError, Simulation, SnapshotError

CABIN = {"mass": 300.0, "inertia": 100.0, "inertia_tensor": [90.0, 100.0, 60.0], "upper_pivot": [0.0, 2.0]}
SPAN = {
    "cable": {
        "unstrained_length": 60.9,
        "mass_per_length": 1.0,
        "axial_stiffness": 5e6,
        "bending_stiffness": 20.0,
        "elements": 8,
        "start": {"position": [0.0, 0.0, 0.0]},
        "end": {"position": [60.0, 2.0, 10.0]},
    },
    "carriages": {"cabin": {"arc_length": 30.0, "bodies": {"cabin": CABIN}}},
}
TENSOR = "carriages.cabin.bodies.cabin.inertia_tensor"
TOWER = {"position": [30.0, 1.0, 3.0], "stiffness": 1e6}
MOMENTS = "allowed: all above 0 and none more than the other two together, in kg m^2"
FAULTS = [
    (
        "cable.start.position",
        [0.0, 0.0],
        "given [0.0, 0.0] m: other positions have three numbers; allowed: x, y, z in m",
    ),
    ("towers", {"one": {**TOWER, "position": [30.0, 3.0]}}, "given [30.0, 3.0] m: other positions have three"),
    ("cable.start", {"position": [0.0, 0.0, 0.0], "support": "clamped", "direction": [1.0, 0.0]}, "allowed: x, y, z"),
    (
        "cable.start.position",
        [0.0, nan, 0.0],
        "given [0.0, nan, 0.0] m; allowed: a list of 2 finite numbers, 3 in space",
    ),
    ("cable.end.position", [60.0, inf, 10.0], "given [60.0, inf, 10.0] m; allowed: a list of 2 finite numbers, 3 in"),
    ("cable.end.position", [60.0, 2.0, 10.0, 1.0], "allowed: a list of 2 finite numbers, 3 in space, in m"),
    ("air.wind", [0.0, nan, 0.0], "given [0.0, nan, 0.0] m/s; allowed: a list of 2 finite numbers, 3 in space, in m/s"),
    (TENSOR, [90.0, 100.0, 191.0], f"given [90.0, 100.0, 191.0] kg m^2: principal moments 90, 100 and 191; {MOMENTS}"),
    (TENSOR, [90.0, 100.0, 0.0], f"principal moments 0, 90 and 100; {MOMENTS}"),
    (TENSOR, [90.0, -100.0, 60.0], MOMENTS),
    (TENSOR, [1.0, 1.0, 1.0, 2.0, 0.0, 0.0], f"principal moments -1, 1 and 3; {MOMENTS}"),
    (
        TENSOR,
        [90.0, 100.0, 60.0, 1.0],
        "given [90.0, 100.0, 60.0, 1.0] kg m^2; allowed: 3 or 6 finite numbers, in kg m^2",
    ),
    (TENSOR, [90.0, nan, 60.0], "given [90.0, nan, 60.0] kg m^2; allowed: a list of 3 or 6 finite numbers, in kg m^2"),
    (TENSOR, [90.0, 100.0, inf], "allowed: a list of 3 or 6 finite numbers, in kg m^2, or null"),
    ("towers", {"one": {**TOWER, "groove": -1.0}}, "given -1.0 1/m; allowed: a finite number above 0, in 1/m"),
    ("carriages.cabin.bodies.cabin.roll_damping", inf, "allowed: a finite number at least 0, in N m s/rad"),
    ("carriages.cabin.bodies.cabin.turns", "ball", "given 'ball'; allowed: one of revolute, universal"),
    ("space", 4, "given 4; allowed: one of 2, 3, or null"),
]


@pytest.mark.parametrize(("key", "value", "said"), FAULTS)
def test_each_is_one_line_with_its_key(key, value, said):
    load_scenario(SPAN)
    with pytest.raises(ScenarioError) as caught:
        load_scenario(SPAN, {key: value})
    (fault,) = caught.value.faults
    assert fault.startswith(f"mapping (override): {key}")
    assert said in fault


def test_what_is_of_space_in_a_plane_is_named_with_its_unit():
    with pytest.raises(ScenarioError) as caught:
        load_scenario(SPAN, {"space": 2, "cable.diameter": 0.05, "air.wind": [3.0, 9.0, 0.0]})
    given = "three numbers in a plane; allowed: x, z in"
    other = "or space: 3 or positions x, y, z throughout"
    assert caught.value.faults == (
        f"mapping: cable.start.position: given [0.0, 0.0, 0.0] m: {given} m, {other}",
        f"mapping: cable.end.position: given [60.0, 2.0, 10.0] m: {given} m, {other}",
        f"mapping (override): air.wind: given [3.0, 9.0, 0.0] m/s: {given} m/s, {other}",
        f"mapping: {TENSOR}: given [90.0, 100.0, 60.0] kg m^2: in a plane; allowed: null, "
        "as a body in a plane has `inertia`",
    )


@pytest.mark.parametrize(("part", "length"), [("state", 0.0), ("start", 0.5)])
def test_an_orientation_that_is_none_is_found_in_a_snapshot(tmp_path, part, length):
    """The only place where a user can give one: a scenario hangs its bodies upright, and commands turn nothing."""
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
    """One rope by itself and the first of two say the same."""
    tower = {**BENT["towers"]["tower"], "derailment_ratio": 0.05}
    alone = {**BENT, "towers": {"tower": tower}}
    with pytest.raises(ScenarioError) as one:
        load_scenario(alone)
    other = {**BENT["cable"], **{end: {"position": [x, 60.0, 0.0]} for end, x in (("start", 0.0), ("end", 200.0))}}
    both = {"name": "two", "ropes": {"first": BENT["cable"], "second": other}, "solver": BENT["solver"]}
    with pytest.raises(ScenarioError) as several:
        load_scenario({**both, "towers": {"tower": {**tower, "rope": "first"}}})
    assert "pushes sideways with" in str(one.value)
    assert str(several.value).partition("towers.")[2] == str(one.value).partition("towers.")[2]


def test_strands_that_would_be_pushed_out_of_their_grooves_at_rest_are_refused():
    coarse = {f"ropes.{rope}.elements": 60 for rope in ("up", "down")}
    aside = {"space": 3, "towers.tower_3.position": [290.0, 3.0, 66.0], "towers.tower_3.derailment_ratio": 0.1}
    with pytest.raises(EquilibriumError, match=r"towers\.tower_[23]_up\.position: .*pushes sideways with .* kN"):
        Simulation(load_scenario("chairlift", coarse | aside))
