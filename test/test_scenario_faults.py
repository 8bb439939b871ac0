"""Faults of scenario files: all at once, a line each."""

import pickle
from contextlib import suppress
from math import inf, nan

import pytest
from ruamel.yaml import YAML
from strands import one_strand

from cable_twin.scenario import Scenario, ScenarioError, config_directory, load_scenario
from cable_twin.scenario.checks.fault import Phrase, refuse

SEED = load_scenario("seed_example")
OWN_LIFT = YAML(typ="safe", pure=True).load(config_directory() / "chairlift.yaml")  # as written, not resolved
CABIN = {"mass": 300.0, "inertia": 100.0, "inertia_tensor": [90.0, 100.0, 60.0], "upper_pivot": [0.0, 2.0]}
WIRE = {"unstrained_length": 99.9, "mass_per_length": 1.0, "axial_stiffness": 1e6, "bending_stiffness": 1.0}
SPAN = {  # in space
    "cable": WIRE
    | {"unstrained_length": 60.9, "elements": 8}
    | {"start": {"position": [0.0, 0.0, 0.0]}, "end": {"position": [60.0, 2.0, 10.0]}},
    "carriages": {"cabin": {"arc_length": 30.0, "bodies": {"cabin": CABIN}}},
}
ROPE = WIRE | {"elements": 20, "start": {"position": [0.0, 0.0]}, "end": {"position": [100.0, 0.0]}}
ROD = {"length": 1.0, "stiffness": 1e5}
TWO_ROPES = {  # with rods between them and a pantograph below
    "ropes": {"upper": ROPE, "lower": ROPE},
    "connectors": {
        name: {"from": ["upper", s], "to": ["lower", s], **ROD} for name, s in (("one", 30.0), ("other", 60.0))
    },
    "pantographs": {
        "head": {"rope": "lower", "position": 20.0, "uplift_force": 100.0, "stages": [{"mass": 7.0, "stiffness": 4e3}]}
    },
}


def faults_of(source, overrides=None):
    with pytest.raises(ScenarioError) as caught:
        load_scenario(source, overrides)
    error = caught.value
    assert str(error).splitlines() == list(error.faults)
    assert error.__cause__ is None
    assert error.__context__ is None or error.__suppress_context__, "the traceback would show pydantic or YAML"
    return error.faults


def paths_of(source, overrides=None):
    """Key paths of all faults."""
    return [fault.split(": ")[1] for fault in faults_of(source, overrides)]


def write(path, text):
    path.write_text(text, encoding="utf-8")
    return path


def keys_of(data, at=()):
    """Every dotted key of a resolved scenario."""
    for key, value in data.items():
        yield ".".join((*at, key))
        if isinstance(value, dict):
            yield from keys_of(value, (*at, key))


@pytest.mark.parametrize(
    ("path", "given", "why", "line"),
    [
        (("gravity",), -1, "", "given -1 m/s^2; allowed: RANGE"),
        (("gravity",), "strong", "too much", "given 'strong': too much; allowed: RANGE"),
        (("cable", "start", "position"), (0.0, 1.0), "off", "given [0.0, 1.0] m: off; allowed: RANGE"),
        (("towers", "one", "contacts"), 3, "", "given 3; allowed: RANGE"),
        (("sensors", "one", "noise"), 3.0, "", "given 3.0; allowed: RANGE"),
        (("towers",), {}, "", "given an empty mapping; allowed: RANGE"),
        (("solver",), SEED.solver, "", "given a mapping; allowed: RANGE"),
        (("cable", "diameter"), None, "", "given null; allowed: RANGE"),
        (("terrain",), Phrase("1 point"), "", "given 1 point; allowed: RANGE"),
        (("no", "key"), "x" * 99, "", f"given '{'x' * 56}...; allowed: RANGE"),
    ],
)
def test_every_fault_has_one_wording_with_the_unit_of_its_key(path, given, why, line):
    assert refuse(path, given, "RANGE", why) == (path, line)
    assert refuse(path, 10**5000, "RANGE").text == "given a number of thousands of digits; allowed: RANGE"


# One key of seed_example, its value, and part of the fault; a path before "given" is that of the fault
CARRIAGE, DRIVE = "carriages.carriage", "carriages.carriage.drive"
HAUL_ROPE = {"axial_stiffness": 1e8, "mass_per_length": 6.0}
OF_ONE_CABLE = [
    ("gravity", -1, "given -1 m/s^2; allowed: a finite number at least 0, in m/s^2"),
    ("gravity", True, "given True; allowed: a finite number"),
    ("gravity", nan, "given nan m/s^2; allowed: a finite number"),
    ("gravity", 10**400, "allowed: a finite number"),
    ("cable.axial_stiffness", inf, "given inf N; allowed: a finite number above 0, in N"),
    ("cable.mass_per_length", "0.1", "given '0.1'; allowed: a finite number above 0, in kg/m"),
    ("cable.unstrained_length", None, "given null; allowed: a finite number above 0, in m"),
    ("cable.elements", 0, "given 0; allowed: a whole number at least 1 and at most 100000"),
    ("cable.elements", 100_001, "given 100001"),
    ("cable.elements", 24.0, "given 24.0; allowed: a whole number"),
    ("cable.elastic_model", "continium", "allowed: one of continuum, element_frame"),
    ("cable.start", [0.0, 0.0], "given [0.0, 0.0]; allowed: a mapping"),
    ("towers", {"one": {"position": [1.8, -0.6], "hold_down": "no"}}, "given 'no'; allowed: true or false"),
    ("cable.start.position", [0.0, nan], "given [0.0, nan] m; allowed: a list of 2 finite numbers, 3 in space, in m"),
    ("cable.start.position", [0.0], "given [0.0] m; allowed: a list of 2 finite numbers, 3 in space"),
    ("cable.start.direction", [1.0, 0.0], "where support is pinned; allowed: null; only of a clamped end"),
    ("cable.end.position", [0.0, 0.0], "the place of the start; allowed: another place"),
    ("cable.unstrained_length", 3.3, "a strain of 9.09 % and a tension of 129 kN; allowed: at least 3.42857 m"),
    ("cable.initial_shape", "straight", "is not straight between held ends 3.6 m apart"),
    ("cable.ice", -0.1, "given -0.1 kg/m; allowed: a finite number at least 0 and at most 200, in kg/m"),
    ("cable.mass_damping", 0.1, "given 0.1 1/s; allowed: 0, or several `ropes`"),
    ("cable.lateral", 2.0, "given 2.0 m; allowed: 0, or several `ropes`"),
    ("pantographs", TWO_ROPES["pantographs"], "pantographs.head: given a mapping: with one cable; allowed: only with"),
    (f"{CARRIAGE}.arc_length", 0.0, "given 0.0 m; allowed: 0.0201 to 3.9999 m"),
    (f"{CARRIAGE}.arc_length", 4.01, "given 4.01 m; allowed: 0.0201 to 3.9999 m"),
    (f"{CARRIAGE}.end_stop.stroke", 2.5, "given 2.5 m: at both ends of a cable of 4.02 m; allowed: less than 2.01 m"),
    (f"{CARRIAGE}.bodies", {}, "given an empty mapping; allowed: a mapping with a length of at least 1"),
    (f"{CARRIAGE}.bodies.rb1.lower_pivot", None, "given nothing: another body hangs there"),
    (f"{CARRIAGE}.bodies.rb2.inertia", 0, "given 0 kg m^2; allowed: a finite number above 0, in kg m^2"),
    (f"{CARRIAGE}.friction.rolling", -0.1, "given -0.1; allowed: a finite number at least 0"),
    (f"{CARRIAGE}.payload", {"capacity": 1.0, "mass": 2.0}, "given 2.0 kg; allowed: 0 to the capacity of 1 kg"),
    (f"{CARRIAGE}.payload", {"capacity": 1.0, "body": "rb3"}, "given 'rb3'; allowed: rb1, rb2"),
    (f"{DRIVE}.limits.speed", 0, "given 0 m/s; allowed: a finite number above 0, in m/s, or null"),
    (f"{DRIVE}.limits.deceleration", 2.0, "at most the emergency_deceleration of 1.5 m/s^2"),
    (f"{DRIVE}.haul_rope", 5, "given 5; allowed: a mapping, or null"),
    (f"{DRIVE}.haul_rope", {**HAUL_ROPE, "drive_inertia": -1.0}, "given -1.0 kg; allowed: a finite number above 0"),
    (f"{DRIVE}.haul_rope", HAUL_ROPE, "given nothing: it is needed; allowed: a finite number above 0, in kg"),
    (f"{DRIVE}.emergency_stop", ["hand"], "a list of some of drive, service_brake, emergency_brake, track_rope_brake"),
    (f"{DRIVE}.emergency_stop", [], "given []; allowed: a list of some of drive, service_brake"),
    (f"{DRIVE}.emergency_stop", ["track_rope_brake"], "given 'track_rope_brake': this drive does not have it; allowed"),
    ("solver.spectral_radius", 1.1, "given 1.1; allowed: a finite number at least 0 and at most 1"),
    ("solver.max_halvings", -1, "given -1; allowed: a whole number at least 0"),
    ("air.wind", [3.0], "given [3.0] m/s; allowed: a list of 2 finite numbers, 3 in space, in m/s"),
    ("terrain", [[0.0, -5.0]], "given 1 point; allowed: at least 2 points x, z, in m"),
    ("terrain", [[0.0, -5.0], [2.0, -5.0]], "given x from 0 to 2 m; allowed: at least the whole track, 0 to 3.6 m"),
    ("terrain", [[0.0, -5.0], [4.0, -5.0], [4.0, 1.0]], "given x = 4.0 m after 4.0 m; allowed: rising x, in m"),
    ("terrain", [[0.0, "low"]], "allowed: a list of points, 2 finite numbers each, in m"),
]
GRADING = {"target": 8.0, "at_towers": 1.4, "growth": 1.5}
OF_A_MESH = [  # of a rope over towers
    (0, "given 0; allowed: a whole number at least 1 and at most 100000, or a mapping of target"),
    (2.5, "given 2.5; allowed: a whole number"),
    ("many", "given 'many'; allowed: a whole number"),
    ({"target": 8.0}, "cable.elements.at_towers: given nothing: it is needed; allowed: a finite number above 0"),
    ({**GRADING, "growth": 1.0}, "cable.elements.growth: given 1.0; allowed: a finite number above 1"),
    ({**GRADING, "target": 1.0}, "cable.elements.at_towers: given 1.4 m; allowed: at most target, 1.0 m"),
    ({**GRADING, "at_towers": 1e-6}, "cable.elements.at_towers: given 1e-06 m; allowed: at least"),
    ({**GRADING, "at_tower": 1.0}, "cable.elements.at_tower: this key does not exist"),
]
TENSOR = "carriages.cabin.bodies.cabin.inertia_tensor"
TOWER = {"position": [30.0, 1.0, 3.0], "stiffness": 1e6}
CLAMP = {"position": [0.0, 0.0, 0.0], "support": "clamped", "direction": [1.0, 0.0]}
MOMENTS = "allowed: all above 0 and none more than the other two together, in kg m^2"
IN_SPACE = [
    ("cable.start.position", [0.0, 0.0], "given [0.0, 0.0] m: other positions have three numbers; allowed: x, y, z in"),
    ("towers", {"one": {**TOWER, "position": [30.0, 3.0]}}, "given [30.0, 3.0] m: other positions have three"),
    ("cable.start", CLAMP, "allowed: x, y, z"),
    ("cable.start.position", [0.0, nan, 0.0], "given [0.0, nan, 0.0] m; allowed: a list of 2 finite numbers, 3 in spa"),
    ("cable.end.position", [60.0, inf, 10.0], "given [60.0, inf, 10.0] m; allowed: a list of 2 finite numbers, 3 in"),
    ("cable.end.position", [60.0, 2.0, 10.0, 1.0], "allowed: a list of 2 finite numbers, 3 in space, in m"),
    ("air.wind", [0.0, nan, 0.0], "given [0.0, nan, 0.0] m/s; allowed: a list of 2 finite numbers, 3 in space, in m/s"),
    (TENSOR, [90.0, 100.0, 191.0], f"given [90.0, 100.0, 191.0] kg m^2: principal moments 90, 100 and 191; {MOMENTS}"),
    (TENSOR, [90.0, 100.0, 0.0], f"principal moments 0, 90 and 100; {MOMENTS}"),
    (TENSOR, [90.0, -100.0, 60.0], MOMENTS),
    (TENSOR, [1.0, 1.0, 1.0, 2.0, 0.0, 0.0], f"principal moments -1, 1 and 3; {MOMENTS}"),
    (TENSOR, [90.0, 100.0, 60.0, 1.0], "60.0, 1.0] kg m^2; allowed: 3 or 6 finite numbers, in kg m^2"),
    (TENSOR, [90.0, nan, 60.0], "given [90.0, nan, 60.0] kg m^2; allowed: a list of 3 or 6 finite numbers, in kg m^2"),
    (TENSOR, [90.0, 100.0, inf], "allowed: a list of 3 or 6 finite numbers, in kg m^2, or null"),
    ("towers", {"one": {**TOWER, "groove": -1.0}}, "given -1.0 1/m; allowed: a finite number above 0, in 1/m"),
    ("carriages.cabin.bodies.cabin.roll_damping", inf, "allowed: a finite number at least 0, in N m s/rad"),
    ("carriages.cabin.bodies.cabin.turns", "ball", "given 'ball'; allowed: one of revolute, universal"),
    ("carriages.cabin.bodies.cabin.size", [2.5, -2.0], "given [2.5, -2.0] m; allowed: a list of 2 finite numbers at l"),
    ("carriages.cabin.bodies.cabin.size", [-2.5, 2.0], "given [-2.5, 2.0] m; allowed: a list of 2 finite numbers at l"),
    ("cable.diameter", 45.0, "diameter: given 45.0 m: with the mass_per_length of 1.0 kg/m a density of 0.000629 kg/m"),
    ("cable.diameter", 0.005, "a density of 5.09e+04 kg/m^3; allowed: 0.00714 to 1.13 m, for 1 to 25000 kg/m^3"),
    ("space", 4, "given 4; allowed: one of 2, 3, or null"),
]
OF_TWO_ROPES = [
    ("ropes.upper.unstrained_length", -1.0, "given -1.0 m; allowed: a finite"),
    ("ropes.lower.unstrained_length", 80.0, "given 80.0 m: its ends are 100 m"),
    ("connectors.one.length", 0.0, "given 0.0 m; allowed: a finite number above 0, in m"),
    ("connectors.one.to", ["lower", 120.0], "given 120.0 m: on 'lower'; allowed: above 0 and"),
    ("connectors.one.to", ["middle", 30.0], "given the rope 'middle'; allowed: upper, lower"),
    ("connectors.one.to", ["upper", 40.0], "given 'upper': both ends on one rope; allowed: another rope than `from`"),
    ("pantographs.head.rope", "middle", "given the rope 'middle'; allowed: upper, lower"),
    ("pantographs.head.position", 100.0, "given 100.0 m; allowed: above 0 and below 100"),
    ("pantographs.head.stages", [], "given []"),
    ("towers", {"mast": {"position": [50.0, 1.0], "rope": "middle"}}, "towers.mast.rope: given the rope 'middle'"),
    ("solver.integrator", "runge_kutta", "given 'runge_kutta': with several ropes"),
]
SINGLE = [
    *(("seed_example", *row) for row in OF_ONE_CABLE),
    *((one_strand("chairlift"), "cable.elements", *row) for row in OF_A_MESH),
    *((SPAN, *row) for row in IN_SPACE),
    *((TWO_ROPES, *row) for row in OF_TWO_ROPES),
]


@pytest.mark.parametrize(("source", "key", "value", "said"), SINGLE)
def test_a_fault_says_where_what_and_what_is_allowed(source, key, value, said):
    (fault,) = faults_of(source, {key: value})
    label, _, line = fault.partition(": ")
    assert label == f"{'mapping' if isinstance(source, dict) else load_path(source)} (override)"
    assert line.startswith(key)
    assert said in line


def load_path(source):
    """Path of a scenario file by its name."""
    return source if isinstance(source, type(config_directory())) else config_directory() / f"{source}.yaml"


WEIGHT = {"direction": [-0.98, -0.197], "mass": 33.0e3}
PUSHES = {**WEIGHT, "direction": [0.98, 0.197]}
RETURN, LEAVING = "sheaves.return", "carriers.payload.leaving"
OF_A_LOOP = [  # some have others beside them
    (f"{RETURN}.joins", ["down.end", "down.start"], "joins.1: given 'down.start': 'drive' joins the end"),
    (f"{RETURN}.joins", ["down.start", "up.start"], "joins.0: given 'down.start'; allowed: up.end, down."),
    ("sheaves.drive.joins", ["up.end"], "sheaves.drive.joins: given"),
    ("ropes.down.end.position", [30.0, 0.0], "sheaves.return.joins: given ends that are 30 m apart"),
    ("ropes.down.mass_per_length", 7.0, "ropes.down.mass_per_length: given 7.0 kg/m: 'drive' joins it to"),
    ("ropes.down.start.support", "free", "ropes.down.start.support: given 'free': at a bullwheel"),
    ("ropes.alone", load_scenario("chairlift").resolved()["ropes"]["up"], "ropes.alone: given a mapping: no vehicle"),
    ("carriers.spacing", 60.0, "carriers.count: given 28: every 60 m they need 1680 m; allowed: at most "),
    (
        "carriers.spacing",
        0.7,
        "carriers.spacing: given 0.7 m: carriers overlap; allowed: at least 0.8 m, the length of",
    ),
    ("carriers.count", 3000, "carriers.count: given 3000: carriers overlap, every 0.55 m of"),
    (f"{RETURN}.counterweight", {**WEIGHT, "travel": [4.0, -4.0]}, "travel: given [4.0, -4.0] m; allowed"),
    (f"{RETURN}.counterweight", PUSHES, "away from the other ends of the strands, about [-0.976, -0.22]"),
    (f"{RETURN}.rollback", 0.5, "sheaves.return.rollback: given 0.5 m: no drive turns it"),
    ("drives.haul_rope.sheave", "middle", "sheave: given 'middle'; allowed: drive, return"),
    ("sheaves", {"drive": OWN_LIFT["sheaves"]["drive"]}, "is not on a closed loop"),
    (LEAVING, {"middle": 1.0}, "payload.leaving.middle: given 'middle': no such bullwheel;"),
    (LEAVING, {"return": 500.0}, "payload.leaving.return: given 500.0 kg; allowed: 0 to 30"),
    ("carriers.payload.from_start", 0.0, "from_start: given 0.0 kg: `leaving` has the payload after each bullwheel;"),
    ("towers.tower_3.ropes", {"up": {}, "dwn": {}}, "towers.tower_3.ropes.dwn: given 'dwn': no such rope; allow"),
    ("towers.tower_3.ropes", ["up", "down"], "towers.tower_3.ropes: given ['up', 'down']; allowed: a mapping"),
    ("towers.tower_3.ropes", {"up": 1.0}, "towers.tower_3.ropes.up: given 1.0; allowed: a mapping of keys of"),
    ("towers.tower_1_up", {"ropes": {"up": 5}}, "towers.tower_1.ropes.up.ropes: given a mapping; allowed: no such key"),
    ("towers.tower_1.ropes.up", {"rope": "down"}, "towers.tower_1.ropes.up.rope: given 'down'; allowed: no such key"),
    ("towers.tower_1.ropes", None, "towers.tower_1.ropes: given null; allowed: a mapping of ropes"),
    ("towers.tower_1", 5, "towers.tower_1: given 5; allowed: a mapping"),
    ("towers.nope", 5, "towers.nope: this key does not exist; allowed: tower_1_up"),
    ("towers.tower", {"ropes": {"1": {}}}, "towers.tower.ropes.1: given '1': no such rope; allowed: up, down"),
    ("sheaves.drive.drive", 5, "sheaves.drive.drive: given 5; allowed: a mapping with the keys of a drive"),
    ("sheaves.drive.drive.name", True, "sheaves.drive.drive.name: given True; allowed: a text"),
    ("sheaves.drive.drive.name", "", "sheaves.drive.drive.name: given ''; allowed: a text, not empty"),
    ("sheaves.return.drive", OWN_LIFT["sheaves"]["drive"]["drive"], "drive.name: given 'haul_rope': another drive has"),
    ("sheaves.drive.joins", ["up.end", "dwn.start"], "sheaves.drive.joins.1: given 'dwn.start'; allowed: "),
    # in a plane and in space, as of one cable
    ("towers.tower_1.mast_offset", 2.0, "towers.tower_1.mast_offset: given 2.0 m: in a plane; allowed: null"),
    ("terrain_sides", {"distance": 9.0, "left": [[0, 0], [1, 0]], "right": [[0, 0], [1, 0]]}, "in a plane; allowed"),
]


@pytest.mark.parametrize(("key", "value", "said"), OF_A_LOOP)
@pytest.mark.parametrize("source", ["chairlift", OWN_LIFT], ids=["file", "mapping"])
def test_a_loop_that_cannot_be_is_told_in_a_line(source, key, value, said):
    faults = faults_of(source, {key: value})
    assert sum(said in fault for fault in faults) == 1, faults
    assert sum("from_start" in fault or "from_end" in fault for fault in faults) == ("from_start" in key)


@pytest.mark.parametrize(
    ("source", "overrides", "said"),
    [
        (
            "chairlift",
            {"space": 3, "towers.tower_3.position": [290.0, 400.0, 66.0]},
            "given [290.0, 402.1, 66.0] m: there the line turns by",
        ),
        (TWO_ROPES, {"connectors.one.to": ["lower", 70.0]}, "other: given crossing 'one'; allowed: connectors in"),
        ("jig_back", {"ropes.haul_1.lateral": 3.0}, "joins: given ends that are 12 m apart; allowed: at most the diam"),
        (
            "seed_example",
            {f"{DRIVE}.emergency_stop": ["drive", "service_brake"], f"{DRIVE}.service_brake": {"force": 10.0}},
            "given 'drive' and 'service_brake'; allowed: only one of the two",
        ),
        (
            "seed_example",
            {f"{DRIVE}.haul_rope": HAUL_ROPE | {"drive_inertia": 5e3}, "solver.integrator": "runge_kutta"},
            "haul_rope: given a mapping: with the integrator runge_kutta; allowed: only with generalized_alpha",
        ),
        (
            "seed_example",
            {f"{DRIVE}.haul_rope": HAUL_ROPE | {"drive_inertia": 5e3}, f"{CARRIAGE}.joint": "fixed"},
            "drive.haul_rope: given a mapping: the joint is fixed",
        ),
        ("seed_example", {"cable.start.support": "clamped"}, "direction: given nothing: a clamped end needs it"),
        (
            "seed_example",
            {"cable.start.support": "clamped", "cable.start.direction": [0, 0]},
            "allowed: a direction, not all numbers zero",
        ),
        (
            "seed_example",
            {"cable.start.support": "free", "cable.end.support": "free", "cable.loads": [{"arc_length": 5.0}]},
            "end.support: given 'free': at both ends; allowed: pinned or clamped",
        ),
        ("seed_example", {"cable.loads": [{"arc_length": 5.0}]}, "0.arc_length: given 5.0 m; allowed: 0 to 4.02 m"),
        ("seed_example", {"cable.loads": [{"arc_length": 1.0, "moment": 2.0}]}, "given 2.0 N m: between the ends"),
        ("aerial_tramway", {"drives": {"haul": {"kind": "moving_cable", "travel": [0.0, 0.5]}}}, "haul.travel: given"),
        (
            "aerial_tramway",
            {"drives": {"haul": {"kind": "moving_cable", "sheave": "a"}}},
            "haul.sheave: given 'a': the",
        ),
    ],
)
def test_keys_that_contradict_each_other_are_told(source, overrides, said):
    assert any(said in fault for fault in faults_of(source, overrides)), faults_of(source, overrides)


BODY = "carriages.cabin.bodies.cabin"


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        (
            "cable.breaking_force",
            4.95,
            "given 4.95 N: with the axial_stiffness of 482000000.0 N a strain of 1.03e-06 %",
        ),
        (
            "cable.tested_breaking_force",
            4950.0,
            "of steel ropes 0.5 to 3 %; allowed: 48200 to 9.64e+08 N, for 0.01 to 2",
        ),
        ("cable.calculated_breaking_force", 4.95e9, "a strain of 1030 %"),
        (
            "carriages.cabin.drive.haul_rope.breaking_force",
            1.09,
            "axial_stiffness of 63000000.0 N a strain of",
        ),
        (
            "cable.axial_stiffness",
            482e3,
            "breaking_force: given 4950000.0 N: with the axial_stiffness of 482000.0 N a str",
        ),
        ("cable.metal_area", 3013.0, "a density of 0.0084 kg/m^3; allowed: 0.00101 to 25.3 m^2, for 1 to 25000 kg/m^3"),
        (
            "cable.bending_stiffness",
            1e11,
            "a solid bar of its diameter and axial_stiffness has 131000 N m^2; allowed: up",
        ),
        ("cable.largest_wire", 5.0, "given 5.0 m; allowed: a finite number above 0 and at most 0.05, in m, or null"),
        (
            "cable.ice_density",
            0.9,
            "given 0.9 kg/m^3; allowed: a finite number at least 10 and at most 1000, in kg/m^3",
        ),
        ("cable.drag_coefficient", 120.0, "allowed: a finite number at least 0 and at most 10"),
        ("air.density", 1225.0, "given 1225.0 kg/m^3; allowed: a finite number at least 0 and at most 10, in kg/m^3"),
        ("carriages.cabin.friction.rolling", 5.0, "given 5.0; allowed: a finite number at least 0 and at most 1"),
        ("towers.tower.friction", 3.0, "allowed: a finite number at least 0 and at most 2, or null"),
        ("limits.swing", 20.0, "given 20.0 rad; allowed: a finite number above 0 and at most 3.14, in rad, or null"),
        (
            f"{BODY}.drag_area",
            11e6,
            "given 11000000.0 m^2; allowed: a finite number at least 0 and at most 1000, or a",
        ),
        (f"{BODY}.upper_pivot", [0.0, 1500.0], "given [0.0, 1500.0] m; allowed: within 100 m of the centre of mass"),
        (
            f"{BODY}.mass",
            3.1,
            "given 7556.0 kg m^2: with the mass of 3.1 kg a radius of gyration of 49.4 m; allowed: up to 12",
        ),
    ],
)
def test_values_in_a_wrong_unit_are_refused(key, value, said):
    fault, *_ = faults_of("aerial_tramway", {key: value})
    assert said in fault


@pytest.mark.parametrize("name", ["chairlift", "jig_back"])
@pytest.mark.parametrize("end", ["foo.start", "down.end"])
def test_wrongly_joined_ends_are_told_alone(name, end):
    """Without lengths, orders of towers, carriers and travels, which are wrong by them."""
    wheel = load_scenario(name).sheaves["drive"]
    joins = [wheel.joins[0], end] if end == "foo.start" else [f"{wheel.ropes[1]}.end", wheel.joins[1]]
    (fault,) = faults_of(name, {"sheaves.drive.joins": joins})
    assert "sheaves.drive.joins" in fault
    assert len(faults_of(name, {"sheaves.drive.joins": joins, "air.wind": [500.0, 0.0]})) == 2


def test_what_is_of_space_in_a_plane_is_named_with_its_unit():
    given = "three numbers in a plane; allowed: x, z in"
    other = "x, y, z only with `space: 3` or if all positions have x, y, z"
    assert faults_of(SPAN, {"space": 2, "cable.diameter": 0.05, "air.wind": [3.0, 9.0, 0.0]}) == (
        f"mapping: cable.start.position: given [0.0, 0.0, 0.0] m: {given} m; {other}",
        f"mapping: cable.end.position: given [60.0, 2.0, 10.0] m: {given} m; {other}",
        f"mapping (override): air.wind: given [3.0, 9.0, 0.0] m/s: {given} m/s; {other}",
        f"mapping: {TENSOR}: given [90.0, 100.0, 60.0] kg m^2: in a plane; allowed: null, "
        "as a body in a plane has `inertia`",
    )


# Names


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        (
            "carriages.cabin.bodies.cabin.turns",
            "universal",
            "given 'universal': in a plane; allowed: 'revolute', the",
        ),
        ("carriages.cabin.bodies.cabin.roll_damping", 9.0, "given 9.0 N m s/rad: in a plane; allowed: 0.0 N m s/rad, "),
        (
            "carriages.cabin.bodies.cabin.drag_area",
            [11.0, 15.0, 9.0],
            "given [11.0, 15.0, 9.0] m^2: in a plane; allowed: [11.0, 0.0, 9.0] m^2; a y of its own in space only",
        ),
        ("towers.tower.groove", 9.0, "given 9.0 1/m: in a plane; allowed: 20.0 1/m, the default; others in space only"),
        ("towers.tower.groove_friction", 0.1, "given 0.1: in a plane; allowed: 0.0, the default; others in space only"),
        ("towers.tower.groove_height", 0.1, "given 0.1 m: in a plane; allowed: 0.05 m, the default; others in space"),
        ("towers.tower.derailment_ratio", 0.1, "given 0.1: in a plane; allowed: 0.5, the default; others in space onl"),
    ],
)
def test_what_a_plane_would_ignore_is_refused_there(key, value, said):
    (fault,) = faults_of("aerial_tramway", {key: value})
    assert f"{key}: {said}" in fault
    load_scenario("aerial_tramway", {key: value, "space": 3})


def test_unknown_keys_name_the_nearest_one():
    data = SEED.resolved()
    data["cable"]["elemnts"] = 3
    data["carriages"]["carriage"]["colour"] = "red"
    del data["cable"]["axial_stiffness"]
    overrides = {"cable.damping_tme": 0.1, "carriages.carriag.arc_length": 1, "cable.loads.0.force": [0, 1]}
    assert dict(fault.split(": ", 2)[1:] for fault in faults_of(data, overrides)) == {
        "cable.damping_tme": "this key does not exist; did you mean 'damping_time'?",
        "carriages.carriag": "this key does not exist; did you mean 'carriage'?",
        "cable.loads.0": "this key does not exist; nothing can be set below this",
        "cable.axial_stiffness": "given nothing: it is needed; allowed: a finite number above 0, in N",
        "cable.elemnts": "this key does not exist; did you mean 'elements'?",
        "carriages.carriage.colour": "this key does not exist; "
        "allowed: rope, arc_length, speed, joint, drive, clamped_to, clamp_offset, friction, end_stop, buffers, "
        "bodies, payload",
    }


@pytest.mark.parametrize("name", ["2nd", "a b", "_x", "a.b", "käbin", "cabin\n", ""])
def test_names_are_names_in_ros(name):
    data = SEED.resolved()
    carriage = data["carriages"].pop("carriage")
    for carriages in ({name: carriage}, {"carriage": carriage | {"bodies": {name: carriage["bodies"]["rb2"]}}}):
        (fault,) = faults_of({**data, "carriages": carriages})
        assert f"given the name {name!r}; allowed: a letter" in fault


def test_names_of_joints_and_frames_are_there_once():
    """Joint carriage_rb1 of `rb1`; coordinate frames of carriages and supports by name."""
    data = SEED.resolved()
    carriage = data["carriages"]["carriage"]
    data["carriages"] |= {"carriage_rb1": carriage, "end": carriage}
    assert paths_of(data) == ["carriages.carriage.bodies.rb1", "carriages.end"]
    one, other = ({"arc_length": 30.0, "bodies": {body: CABIN | {"inertia_tensor": None}}} for body in ("b_c", "c"))
    carriages = {"a": {**one, "rope": "upper"}, "a_b": {**other, "rope": "lower"}, "mast": {**one, "rope": "lower"}}
    towers = {"mast": {"position": [50.0, -1.0], "rope": "upper"}}
    assert paths_of(TWO_ROPES | {"carriages": carriages, "towers": towers}) == [
        "carriages.a_b.bodies.c",
        "carriages.mast",
    ]


def test_a_joint_of_a_carrier_is_no_carriage():
    carriage = SEED.resolved()["carriages"]["carriage"] | {"joint": "clamped"}
    faults = faults_of("chairlift", {"carriages": {"chair_3_chair": carriage}})
    assert any("'chair': a carrier would have the name 'chair_3_chair' as well" in fault for fault in faults)


def test_two_towers_of_one_name_are_refused():
    alone = {key: value for key, value in OWN_LIFT["towers"]["tower_1"].items() if key != "ropes"}
    towers = {**OWN_LIFT["towers"], "tower_1_up": {**alone, "rope": "up"}}
    (fault,) = faults_of("chairlift", {"towers": towers})
    assert "towers.tower_1.ropes.up: given a tower with the name 'tower_1_up': another tower has this name" in fault


def test_a_strand_that_is_not_there_is_a_line():
    towers = {name: {**tower, "ropes": {"up": {}}} for name, tower in OWN_LIFT["towers"].items()}
    faults = faults_of({**OWN_LIFT, "ropes": {"up": OWN_LIFT["ropes"]["up"]}, "towers": towers})
    assert any("sheaves.drive.joins.1: given 'down.start'; allowed: up.start" in fault for fault in faults)


# All of them, and nothing else


def test_all_faults_come_at_once_even_those_between_values():
    overrides = {
        "gravity": "strong",
        "cable.unstrained_length": 3.0,
        "cable.damping_time": -1,
        "cable.elemnts": 12,
        f"{CARRIAGE}.arc_length": 5.0,
        f"{CARRIAGE}.bodies.rb1.mass": nan,
        f"{CARRIAGE}.bodies.rb1.lower_pivot": None,
        "solver.max_halvings": -1,
    }
    assert sorted(paths_of("seed_example", overrides)) == sorted(overrides)


@pytest.mark.parametrize("key", sorted(keys_of(SEED.resolved())))
def test_no_junk_anywhere_gives_anything_but_faults(key):
    data = SEED.resolved()
    refused = 0
    for junk in (None, True, -1, 1e300, nan, "", "junk", [], [1, "2"], {}, {"a": {}}, {1: 2}, b"x", {0, 3}, object()):
        with suppress(ScenarioError):
            assert isinstance(load_scenario(data, {key: junk}), Scenario)
            continue
        refused += 1
    assert refused > 8


@pytest.mark.parametrize("count", ["many", 3.5, None, True])
@pytest.mark.parametrize("name", ["chairlift", "gondola"])
def test_a_count_of_carriers_that_is_none_is_one_fault(name, count):
    """Loop in `ropes` and single strand; later checks skip the invalid count."""
    source = load_scenario(name).resolved()
    source["carriers"]["count"] = count
    assert paths_of(source) == ["carriers.count"]
    cable = source["ropes"][next(iter(source["ropes"]))]
    assert "carriers.count" in paths_of({"carriers": source["carriers"], "cable": cable})


@pytest.mark.parametrize("joint", ["paper", "node"])
def test_carriers_without_bodies_are_a_fault_whatever_the_joint(joint):
    assert "carriers.bodies" in paths_of("chairlift", {"carriers.bodies": {}, "ropes.up.joint": joint})


# Files


@pytest.mark.parametrize("source", [5, None, "", b"seed_example"])
def test_a_source_of_another_kind_is_a_fault(source):
    assert "allowed: a name, the path of a YAML file, or a mapping" in faults_of(source)[0]


def test_a_mapping_that_holds_itself_is_a_fault():
    data = SEED.resolved()
    data["cable"]["start"] = data
    assert "nested too deeply" in faults_of(data)[0]


def test_unknown_names_and_missing_files_name_the_known_ones(tmp_path):
    for source in ("seed_exmple", "missing.yaml", tmp_path / "missing.yaml"):
        (fault,) = faults_of(source)
        assert str(source) in fault
        assert "aerial_tramway, bicable, chairlift, gondola, jig_back, pantograph, seed_example" in fault
    assert "cannot be read" in faults_of(tmp_path)[0]


@pytest.mark.parametrize(
    ("content", "text"),
    [
        (b"cable:\n  elements: [1, 2\nsolver: {}\n", ":3: not YAML ("),
        (b"cable: {}\n\tsolver: {}\n", ":2: not YAML ("),
        (b"cable: !!python/object:os.system {}\n", ":1: not YAML ("),
        (b"a: 1\n---\nb: 2\n", ":2: not YAML ("),
        (b"a: \x00\n", ": not YAML ("),
        (b"a: \xff\n", ": not a text in UTF-8"),
        (b"", ": given null; allowed: a mapping"),
        (b"- cable\n", ": given ['cable']; allowed: a mapping"),
        (b"just text", ": given 'just text'; allowed: a mapping"),
        (b"gravity: " + b"9" * 5000, ": holds a value that cannot be read"),
        (b"gravity: 2020-13-45", ": holds a value that cannot be read"),
        (b"[" * 2000, ":1: nested more than 60 levels deep; allowed: at most 60"),
    ],
)
def test_what_is_no_scenario_is_said_with_its_line(content, text, tmp_path):
    path = tmp_path / "broken.yaml"
    path.write_bytes(content)
    (fault,) = faults_of(path)
    assert fault.startswith(f"{path}{text}")


def test_keys_given_twice_are_faults_beside_the_others(tmp_path):
    text = SEED.to_yaml() + "gravity: 9.81\n"
    text = text.replace("  elements: 24\n", "  elements: 24\n  elements: 48\n").replace("step: 0.001", "step: 0.0")
    path = write(tmp_path / "twice.yaml", text)
    lines = text.splitlines()
    elements = lines.index("  elements: 24") + 1
    assert faults_of(path) == (
        f"{path}: cable.elements: given twice, on lines {elements} and {elements + 1}; allowed: once",
        f"{path}: gravity: given twice, on lines 3 and {len(lines)}; allowed: once",
        f"{path}: solver.step: given 0.0 s; allowed: a finite number at least 1e-06 and at most 1, in s",
    )


def test_an_error_survives_pickling():
    error = pickle.loads(pickle.dumps(ScenarioError("one", "two")))
    assert error.faults == ("one", "two")
    assert str(error) == "one\ntwo"
