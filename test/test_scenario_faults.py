"""Scenario files: everything wrong with one is said, in one line each and at once."""

import pickle
from contextlib import suppress
from math import inf, nan

import pytest

from cable_twin.scenario import (
    Scenario,
    ScenarioError,
    config_directory,
    load_scenario,
)

SEED = load_scenario("seed_example")


def faults_of(source, overrides=None):
    with pytest.raises(ScenarioError) as caught:
        load_scenario(source, overrides)
    error = caught.value
    assert str(error).splitlines() == list(error.faults)
    assert error.__cause__ is None
    assert error.__context__ is None or error.__suppress_context__, "the traceback would show pydantic or YAML"
    return error.faults


def write(path, text):
    path.write_text(text, encoding="utf-8")
    return path


def keys_of(data, at=()):
    """Every dotted key of a resolved scenario."""
    for key, value in data.items():
        yield ".".join((*at, key))
        if isinstance(value, dict):
            yield from keys_of(value, (*at, key))


# What is there


FAULTS = [
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
    (
        "towers",
        {"tower": {"position": [1.8, -0.6], "hold_down": "no"}},
        "hold_down: given 'no'; allowed: true or false",
    ),
    ("cable.start.position", [0.0, nan], "given [0.0, nan] m; allowed: a list of 2 finite numbers, 3 in space, in m"),
    ("cable.start.position", [0.0], "given [0.0] m; allowed: a list of 2 finite numbers, 3 in space"),
    ("cable.start.direction", [1.0, 0.0], "where support is pinned; allowed: null; only of a clamped end"),
    ("cable.end.position", [0.0, 0.0], "the place of the start; allowed: another place"),
    (
        "cable.unstrained_length",
        3.3,
        "needs a strain of 9.09 % and a tension of 129 kN; allowed: at least 3.42857 m",
    ),
    ("carriages.carriage.arc_length", 0.0, "given 0.0 m; allowed: 0.0201 to 3.9999 m"),
    ("carriages.carriage.arc_length", 4.01, "given 4.01 m; allowed: 0.0201 to 3.9999 m"),
    (
        "carriages.carriage.end_stop.stroke",
        2.5,
        "given 2.5 m: at both ends of a cable of 4.02 m; allowed: less than 2.01 m",
    ),
    ("carriages.carriage.bodies", {}, "given an empty mapping; allowed: a mapping with a length of at least 1"),
    ("carriages.carriage.bodies.rb1.lower_pivot", None, "given nothing: another body hangs there"),
    ("carriages.carriage.bodies.rb2.inertia", 0, "given 0 kg m^2; allowed: a finite number above 0, in kg m^2"),
    ("carriages.carriage.drive.limits.speed", 0, "given 0 m/s; allowed: a finite number above 0, in m/s, or null"),
    ("carriages.carriage.friction.rolling", -0.1, "given -0.1; allowed: a finite number at least 0"),
    ("solver.spectral_radius", 1.1, "given 1.1; allowed: a finite number at least 0 and at most 1"),
    ("solver.max_halvings", -1, "given -1; allowed: a whole number at least 0"),
    ("carriages.carriage.drive.haul_rope", 5, "given 5; allowed: a mapping, or null"),
    (
        "carriages.carriage.drive.haul_rope",
        {"axial_stiffness": -1.0, "mass_per_length": 6.0, "drive_inertia": 5e3},
        "given -1.0 N; allowed: a finite number above 0, in N",
    ),
    (
        "carriages.carriage.drive.haul_rope",
        {"axial_stiffness": 1e8, "mass_per_length": 6.0},
        "given nothing: it is needed; allowed: a finite number above 0, in kg",
    ),
    ("carriages.carriage.drive.limits.deceleration", 2.0, "at most the emergency_deceleration of 1.5 m/s^2"),
    (
        "carriages.carriage.drive.emergency_stop",
        ["hand"],
        "allowed: a list of some of drive, service_brake, emergency_brake, track_rope_brake",
    ),
    ("carriages.carriage.drive.emergency_stop", [], "given []; allowed: a list of some of drive, service_brake"),
    (
        "carriages.carriage.drive.emergency_stop",
        ["track_rope_brake"],
        "given 'track_rope_brake': this drive does not have it; allowed: drive",
    ),
    ("carriages.carriage.payload", {"capacity": 1.0, "mass": 2.0}, "given 2.0 kg; allowed: 0 to the capacity of 1 kg"),
    ("carriages.carriage.payload", {"capacity": 1.0, "body": "rb3"}, "given 'rb3'; allowed: one of rb1, rb2"),
    ("cable.ice", -0.1, "given -0.1 kg/m; allowed: a finite number at least 0, in kg/m"),
    ("air.wind", [3.0], "given [3.0] m/s; allowed: a list of 2 finite numbers, 3 in space, in m/s"),
    ("terrain", [[0.0, -5.0]], "given 1 point; allowed: at least 2 points x, z, in m"),
    ("terrain", [[0.0, -5.0], [2.0, -5.0]], "given x from 0 to 2 m; allowed: at least the whole track, 0 to 3.6 m"),
    ("terrain", [[0.0, -5.0], [4.0, -5.0], [4.0, 1.0]], "given x = 4.0 m after 4.0 m; allowed: rising x, in m"),
    ("terrain", [[0.0, "low"]], "allowed: a list of points, 2 finite numbers each, in m"),
]


def test_what_an_override_would_be_in_is_no_fault_of_the_file():
    (fault,) = faults_of("aerial_tramway", {"towers.tower_1.position": [545.0, 30.0]})
    assert fault.endswith(
        "aerial_tramway.yaml (override): towers.tower_1: this key does not exist; did you mean 'tower'?"
    )


@pytest.mark.parametrize(("key", "value", "text"), FAULTS)
def test_a_fault_says_where_what_and_what_is_allowed(key, value, text):
    (fault,) = faults_of("seed_example", {key: value})
    assert fault.startswith(f"{config_directory() / 'seed_example.yaml'} (override): {key}")
    assert text in fault


def test_a_drive_and_its_integrator_that_contradict():
    rope = {"axial_stiffness": 1e8, "mass_per_length": 6.0, "drive_inertia": 5e3}
    key = "carriages.carriage.drive"
    both = {f"{key}.emergency_stop": ["drive", "service_brake"], f"{key}.service_brake": {"force": 10.0}}
    assert "given 'drive' and 'service_brake'; allowed: only one of the two" in faults_of("seed_example", both)[0]
    explicit = {f"{key}.haul_rope": rope, "solver.integrator": "runge_kutta"}
    (fault,) = faults_of("seed_example", explicit)
    assert (
        "drive.haul_rope: given a mapping: with the integrator runge_kutta; allowed: only with generalized_alpha"
        in fault
    )
    (fault,) = faults_of("seed_example", {f"{key}.haul_rope": rope, "carriages.carriage.joint": "fixed"})
    assert "drive.haul_rope: given a mapping: the joint is fixed" in fault


def test_a_straight_start_between_held_ends_needs_a_cable_of_their_distance():
    (fault,) = faults_of("seed_example", {"cable.initial_shape": "straight"})
    assert "cable.initial_shape: given 'straight': unstrained between held ends 3.6 m apart" in fault


def test_supports_and_loads_that_contradict():
    faults = faults_of(
        "seed_example",
        {
            "cable.start.support": "free",
            "cable.end.support": "free",
            "cable.loads": [{"arc_length": 5.0}, {"arc_length": 1.0, "moment": 2.0}],
        },
    )
    assert any("cable.end.support: given 'free': at both ends; allowed: pinned or clamped" in fault for fault in faults)
    assert any("cable.loads.0.arc_length: given 5.0 m; allowed: 0 to 4.02 m" in fault for fault in faults)
    assert any("cable.loads.1.moment: given 2.0 N m: within the cable" in fault for fault in faults)
    faults = faults_of("seed_example", {"cable.start.support": "clamped"})
    assert any("cable.start.direction: given nothing: a clamped end needs it" in fault for fault in faults)
    faults = faults_of("seed_example", {"cable.start.support": "clamped", "cable.start.direction": [0, 0]})
    assert any("allowed: a direction, not all numbers zero" in fault for fault in faults)


def test_unknown_keys_name_the_nearest_one():
    data = SEED.resolved()
    data["cable"]["elemnts"] = 3
    data["carriages"]["carriage"]["colour"] = "red"
    del data["cable"]["axial_stiffness"]
    faults = faults_of(
        data, {"cable.damping_tme": 0.1, "carriages.carriag.arc_length": 1, "cable.loads.0.force": [0, 1]}
    )
    assert dict(fault.split(": ", 2)[1:] for fault in faults) == {
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
    data["carriages"][name] = carriage
    (fault,) = faults_of(data)
    assert f"given the name {name!r}; allowed: a letter" in fault
    data["carriages"] = {"carriage": carriage | {"bodies": {name: carriage["bodies"]["rb2"]}}}
    (fault,) = faults_of(data)
    assert f"given the name {name!r}; allowed: a letter" in fault


def test_names_of_joints_and_frames_are_there_once():
    """The joint of `rb1` is `carriage_rb1`; a carriage has the frame of its name, and so has a support."""
    data = SEED.resolved()
    carriage = data["carriages"]["carriage"]
    data["carriages"] |= {"carriage_rb1": carriage, "end": carriage}
    body, end = faults_of(data)
    assert "carriages.end: given the name 'end': that of a support of the cable" in end
    assert "carriages.carriage.bodies.rb1: given the name 'rb1': 'carriage_rb1' is the name" in body


def test_a_joint_of_a_carrier_is_no_carriage():
    data = load_scenario("chairlift").resolved()
    carriage = SEED.resolved()["carriages"]["carriage"] | {"joint": "clamped"}
    data["carriages"] = {"chair_3_chair": carriage}
    assert any("'chair': a carrier would have the name 'chair_3_chair' as well" in fault for fault in faults_of(data))


def test_all_faults_come_at_once_even_those_between_values():
    faults = faults_of(
        "seed_example",
        {
            "gravity": "strong",
            "cable.unstrained_length": 3.0,
            "cable.damping_time": -1,
            "cable.elemnts": 12,
            "carriages.carriage.arc_length": 5.0,
            "carriages.carriage.bodies.rb1.mass": nan,
            "carriages.carriage.bodies.rb1.lower_pivot": None,
            "solver.max_halvings": -1,
        },
    )
    keys = {fault.split(": ")[1] for fault in faults}
    assert len(faults) == 8
    assert keys == {
        "gravity",
        "cable.unstrained_length",
        "cable.damping_time",
        "cable.elemnts",
        "carriages.carriage.arc_length",
        "carriages.carriage.bodies.rb1.mass",
        "carriages.carriage.bodies.rb1.lower_pivot",
        "solver.max_halvings",
    }


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


# YAML


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
        (b"[" * 2000, ":1: nested more than 60 deep; allowed: up to that"),
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
        f"{path}: solver.step: given 0.0 s; allowed: a finite number at least 1e-06 and at most 10, in s",
    )


# The house


def test_an_error_survives_pickling():
    error = pickle.loads(pickle.dumps(ScenarioError("one", "two")))
    assert error.faults == ("one", "two")
    assert str(error) == "one\ntwo"


@pytest.mark.parametrize("count", ["many", 3.5, None, True])
@pytest.mark.parametrize("name", ["chairlift", "gondola"])
def test_a_count_of_carriers_that_is_none_is_one_fault(name, count):
    """Of a loop in `ropes`, and of one strand: what goes by the number of vehicles is left out of the checks."""
    source = load_scenario(name).resolved()
    source["carriers"]["count"] = count
    (fault,) = faults_of(source)
    assert fault.startswith("mapping: carriers.count: given ")
    alone = {key: source[key] for key in ("carriers",)}
    alone["cable"] = {**source["ropes"][next(iter(source["ropes"]))], "kinks": "sharp"}
    assert any(fault.startswith("mapping: carriers.count: given ") for fault in faults_of(alone))
