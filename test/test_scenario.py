"""Contents of loaded scenario files."""

import json
import re
import subprocess
import sys
from math import atan, cos, inf, sqrt
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from pydantic import BaseModel, ValidationError

import cable_twin.scenario.files as module
from cable_twin.mechanics.parameters import FloatArray
from cable_twin.scenario import (
    Scenario,
    ScenarioError,
    build_system,
    config_directory,
    load_scenario,
    scenario_names,
)
from cable_twin.scenario.builders import columns, numbers
from cable_twin.scenario.sections.quantities import Section

SEED = load_scenario("seed_example")
TRAMWAY = load_scenario("aerial_tramway")


def write(path, text):
    path.write_text(text, encoding="utf-8")
    return path


def test_names_are_the_scenario_files_and_not_those_of_node_parameters(tmp_path, monkeypatch):
    assert {"aerial_tramway", "chairlift", "gondola", "seed_example"} <= set(scenario_names())
    assert config_directory() == Path(__file__).resolve().parents[1] / "config"
    write(tmp_path / "mine.yml", "description: mine")
    write(tmp_path / "node.yaml", "/**:\n  ros__parameters: {frame_rate: 50.0}\n")
    monkeypatch.setattr(module, "config_directory", lambda: tmp_path)
    assert scenario_names() == ["mine"]


def test_config_directory_of_an_installed_package_is_in_the_share_of_its_prefix(tmp_path, monkeypatch):
    package = tmp_path / "lib" / "python3.12" / "site-packages" / "cable_twin"
    package.mkdir(parents=True)
    (package.parent / "config").mkdir()  # of somebody else
    monkeypatch.setattr(module, "__file__", str(package / "scenario" / "files.py"))
    with pytest.raises(ScenarioError, match="share/cable_twin/config"):
        config_directory()
    shared = tmp_path / "share" / "cable_twin" / "config"
    shared.mkdir(parents=True)
    assert config_directory() == shared


@pytest.mark.parametrize("name", scenario_names())
def test_a_resolved_scenario_reads_back_the_same(name, tmp_path):
    scenario = load_scenario(name)
    assert scenario.name == name
    resolved = scenario.resolved()
    assert load_scenario(resolved) == scenario
    assert load_scenario(json.loads(json.dumps(resolved))) == scenario
    text = scenario.to_yaml()
    read = load_scenario(write(tmp_path / "other.yaml", text))
    assert read == scenario
    for carriage, same in zip(read.carriages.values(), scenario.carriages.values(), strict=True):
        assert list(carriage.bodies) == list(same.bodies)
    assert re.search(r"tolerance: [1-9]\.0e-0[6-9]", text), "YAML 1.1 reads 1e-09 as a text"


def test_name_is_that_of_the_file_or_custom(tmp_path):
    content = {key: value for key, value in SEED.resolved().items() if key != "name"}
    assert load_scenario(content).name == "custom"
    assert load_scenario(write(tmp_path / "my_rope.yaml", json.dumps(content))).name == "my_rope"
    assert load_scenario(content, {"name": "given"}).name == "given"


def test_a_scenario_does_not_change_and_has_units_everywhere():
    with pytest.raises(ValidationError):
        SEED.gravity = 0.0
    for section in Section.__subclasses__():
        for name, field in section.model_fields.items():
            assert field.description, f"{section.__name__}.{name}"
            if re.search(r"\b(float|int)\b", str(field.annotation)):
                assert field.json_schema_extra["unit"], f"{section.__name__}.{name}"


def test_defaults_are_those_of_the_contract():
    content = {
        "cable": {
            "unstrained_length": 10,
            "mass_per_length": 1,
            "axial_stiffness": 1000000,
            "bending_stiffness": 0,
            "elements": 4,
            "start": {"position": [0, 0]},
            "end": {"position": [9, 0]},
        }
    }
    scenario = load_scenario(content)
    assert isinstance(scenario.cable.unstrained_length, float)
    assert scenario.gravity == 9.81
    assert scenario.cable.damping_time == 0.0
    assert scenario.carriages == {}
    assert scenario.solver.model_dump() == {
        "integrator": "generalized_alpha",
        "step": 0.001,
        "spectral_radius": 0.7,
        "tolerance": 1e-9,
        "max_iterations": 12,
        "max_halvings": 6,
    }
    system = build_system(scenario)
    assert system.carriages.body_offset.tolist() == [0]
    assert system.carriages.upper_pivot.shape == (0, 2)
    assert system.carriages.stop_stroke.shape == (0,)
    drive = SEED.carriages["carriage"].drive
    assert drive.mode == "free"
    assert drive.limits.model_dump() == {
        "speed": None,
        "acceleration": 0.5,
        "deceleration": None,
        "jerk": None,
        "force": None,
        "power": None,
        "emergency_deceleration": 1.5,
    }


def test_overrides_reach_sections_that_the_file_leaves_out_and_leave_the_source_alone():
    content = SEED.resolved()
    del content["carriages"]["carriage"]["drive"]
    before = json.dumps(content)
    scenario = load_scenario(
        content,
        {
            "cable.elements": np.int64(48),
            "cable.end.position": np.array([3.5, 0.1]),
            "carriages.carriage.drive.limits.speed": np.float64(2.0),
            "carriages.carriage.drive.mode": "speed",
        },
    )
    assert json.dumps(content) == before
    assert scenario.cable.elements == 48
    assert scenario.cable.end.position == (3.5, 0.1)
    assert scenario.carriages["carriage"].drive.limits.speed == 2.0
    assert type(scenario.carriages["carriage"].drive.limits.speed) is float
    assert load_scenario(scenario.resolved()) == scenario


# The shipped scenarios


def test_seed_example_has_the_printed_values():
    system = build_system(SEED)
    cable, carriages = system.cable, system.carriages
    assert cable.axial_stiffness == pytest.approx(200e9 * 7.068e-6, rel=1e-12)
    assert cable.bending_stiffness == pytest.approx(200e9 * 7.952e-12, rel=1e-12)
    assert cable.mass_per_length * cable.unstrained_length == pytest.approx(0.148, rel=1e-12)
    assert (cable.element_count, cable.element_length[0]) == (24, pytest.approx(4.02 / 24))
    assert cable.gravity == (0.0, -9.81)
    assert cable.end_position.tolist() == [[0.0, 0.0], [3.6, 0.0]]
    assert carriages.mass.tolist() == [2.67, 2.67]
    assert carriages.inertia.tolist() == [0.2242, 0.2242]
    assert SEED.carriages["carriage"].arc_length == 3.2
    assert system.solver.step == 0.001


def test_the_tramway_is_as_heavy_as_its_file_says_and_its_counterweight_tight_enough_for_it():
    cable, carriage = TRAMWAY.cable, TRAMWAY.carriages["cabin"]
    load = sum(body.mass for body in carriage.bodies.values()) + carriage.payload.mass
    assert load == 12_000
    across = load * cos(atan(cable.end.position[1] / cable.end.position[0]))
    assert cable.start.mass > TRAMWAY.limits.tension_per_transverse_load * across
    steel = cable.axial_stiffness / 160e9
    assert cable.breaking_force == pytest.approx(0.93 * 1770e6 * steel, rel=1e-2)
    assert cable.mass_per_length == pytest.approx(1.07 * 7850.0 * steel, rel=1e-2)


# Constants of the mechanics


class Motor(BaseModel):
    """Section as a new key would make it."""

    ratio: float = 1.5
    speed: float | None = None
    count: int = 3
    kind: str = "new"
    slope: float = 0.1
    place: tuple[float, ...] = (0.0, 1.0)


class MotorNumbers(NamedTuple):
    """Record of one motor."""

    ratio: float
    speed_limit: float
    count: int
    slope: FloatArray


class MotorColumns(NamedTuple):
    """Record of several motors."""

    ratio: FloatArray
    speed_limit: FloatArray
    count: int
    place: FloatArray


def test_a_number_of_one_name_in_section_and_record_is_copied():
    assert numbers(MotorNumbers, Motor(), "{}_limit") == {"ratio": 1.5, "speed_limit": inf, "count": 3}
    found = columns(MotorColumns, Motor, [Motor(ratio=2.0), Motor(speed=4.0)], "{}_limit")
    assert {name: column.tolist() for name, column in found.items()} == {"ratio": [2.0, 1.5], "speed_limit": [inf, 4.0]}
    assert columns(MotorColumns, Motor, [])["ratio"].shape == (0,)


def test_numbers_of_a_scenario_reach_the_mechanics_by_their_names():
    solver = {"step": 0.002, "spectral_radius": 0.6, "tolerance": 1e-8, "max_iterations": 9, "max_halvings": 3}
    assert build_system(load_scenario("seed_example", {"solver": solver})).solver._asdict() == solver
    limits = {"speed": 8.0, "acceleration": 0.2, "deceleration": 0.3, "jerk": 0.1, "force": 1e5, "power": 3e5}
    rope = {
        "axial_stiffness": 1e8,
        "mass_per_length": 6.0,
        "drive_inertia": 5e3,
        "pretension": 10.0,
        "beyond_track": 3.0,
    }
    drive = {"limits": limits | {"emergency_deceleration": 1.1}, "haul_rope": rope | {"damping_ratio": 0.02}}
    system = build_system(load_scenario("aerial_tramway", {"carriages.cabin.drive": drive}))
    for key, value in limits.items():
        assert getattr(system.carriages.limits, key).tolist() == [value]
    for key, value in drive["haul_rope"].items():
        assert getattr(system.haul_ropes, key).tolist() == [value]
    assert system.carriages.limits.emergency_deceleration.tolist() == [1.1]


def test_supports_become_projectors_onto_what_they_leave_free():
    data = SEED.resolved()
    data["cable"]["start"] |= {"support": "clamped", "direction": [3.0, 4.0]}
    data["cable"]["end"] |= {"support": "free"}
    cable = build_system(Scenario.model_validate(data)).cable  # not through load_scenario, which refuses both for now
    (start_position, start_slope), (end_position, end_slope) = cable.end_projector.reshape(2, 2, 2, 2)
    assert not start_position.any()
    np.testing.assert_allclose(start_slope, [[0.36, 0.48], [0.48, 0.64]])
    np.testing.assert_array_equal(end_position, np.eye(2))
    np.testing.assert_array_equal(end_slope, np.eye(2))
    assert np.isnan(cable.end_position).tolist() == [[False, False], [True, True]]
    pinned = build_system(SEED).cable.end_projector.reshape(2, 2, 2, 2)
    assert not pinned[:, 0].any()
    np.testing.assert_array_equal(pinned[:, 1], [np.eye(2)] * 2)


def test_bodies_keep_the_order_of_the_file_and_limits_left_out_are_infinite():
    data = SEED.resolved()
    cabin = TRAMWAY.resolved()["carriages"]["cabin"]
    cabin["drive"]["haul_rope"] = None
    data["carriages"]["another"] = cabin | {"arc_length": 1.0, "joint": "fixed", "end_stop": {}}
    carriages = build_system(load_scenario(data)).carriages
    assert carriages.body_offset.tolist() == [0, 2, 5]
    assert carriages.mass.tolist() == [2.67, 2.67, 1500.0, 1000.0, 3100.0]
    assert carriages.lower_pivot.tolist() == [[0.0, -0.5], [0.0, 0.0], [0.0, -0.2], [0.0, -2.5], [0.0, 0.0]]
    assert carriages.fixed.tolist() == [False, True]
    assert carriages.limits.speed.tolist() == [inf, 10.0]
    assert carriages.limits.jerk.tolist() == [inf, 0.2]
    assert carriages.limits.force.tolist() == [inf, 150e3]
    assert carriages.limits.acceleration.tolist() == [0.5, 0.3]
    assert carriages.limits.emergency_deceleration.tolist() == [1.5, 1.2]
    assert carriages.rolling_friction.tolist() == [0.0, 0.005]


@pytest.mark.parametrize("scenario", [SEED, load_scenario("aerial_tramway", {"carriages.cabin.end_stop": {}})])
def test_an_end_stop_left_open_stops_the_carriage_within_its_stroke(scenario):
    payload = next(iter(scenario.carriages.values())).payload
    capacity = payload.capacity if payload else 0.0
    carriages = build_system(scenario).carriages
    length = scenario.cable.unstrained_length
    limit = carriages.limits.speed[0]
    speed = sqrt(9.81 * length) / 2 if limit == inf else limit
    stroke, stiffness = carriages.stop_stroke[0], carriages.stop_stiffness[0]
    assert stroke == pytest.approx(0.005 * length)
    assert stiffness * (0.6 * stroke) ** 2 == pytest.approx((carriages.mass.sum() + capacity) * speed**2)
    assert carriages.stop_damping[0] == pytest.approx(0.5 / speed)


def test_an_end_stop_holds_the_weight_of_a_slow_carriage_and_keeps_what_is_given():
    key = "carriages.cabin.drive.limits.speed"
    carriages = build_system(load_scenario("aerial_tramway", {key: 0.1, "carriages.cabin.end_stop": {}})).carriages
    assert carriages.stop_stiffness[0] * 0.6 * carriages.stop_stroke[0] == pytest.approx(12_000 * 9.81)
    given = {"stroke": 2.0, "stiffness": 5e5, "damping": 0.0}
    carriages = build_system(load_scenario("aerial_tramway", {"carriages.cabin.end_stop": given})).carriages
    assert (carriages.stop_stroke[0], carriages.stop_stiffness[0], carriages.stop_damping[0]) == (2.0, 5e5, 0.0)
    weightless = build_system(load_scenario("seed_example", {"gravity": 0})).carriages
    assert weightless.stop_stiffness[0] > 0.0
    assert np.isfinite(weightless.stop_damping[0])


# Faults


RUNNABLE = [
    {"cable.elastic_model": "element_frame"},
    {"cable.initial_shape": "straight", "cable.end.support": "free"},
    {"cable.loads": [{"arc_length": 1, "force": [0, 1]}]},
    {"cable.start.support": "clamped", "cable.start.direction": [1, 0]},
    {"cable.end.support": "free"},
    {"solver.integrator": "runge_kutta"},
]


@pytest.mark.parametrize("overrides", RUNNABLE)
def test_every_choice_of_the_schema_can_be_built(overrides):
    system = build_system(load_scenario("seed_example", overrides))
    assert system.cable.element_count == 24


def test_overrides_reach_into_what_was_null():
    key = "carriages.carriage.drive.haul_rope"
    given = {f"{key}.axial_stiffness": 1e8, f"{key}.mass_per_length": 6.0, f"{key}.drive_inertia": 5e3}
    rope = load_scenario(SEED.resolved(), given).carriages["carriage"].drive.haul_rope
    assert rope is not None
    assert (rope.axial_stiffness, rope.station, rope.pretension) == (1e8, "end", 0.0)


def test_numbers_without_a_point_and_with_an_exponent_are_numbers(tmp_path):
    text = SEED.to_yaml().replace("axial_stiffness: 1413600.0", "axial_stiffness: 1e6")
    assert load_scenario(write(tmp_path / "a.yaml", text)).cable.axial_stiffness == 1e6
    assert load_scenario(str(write(tmp_path / "a.yaml", text))).cable.axial_stiffness == 1e6


def test_sections_shared_by_an_anchor_are_overridden_one_by_one(tmp_path):
    text = SEED.to_yaml().replace("  start:\n    position", "  start: &s\n    position", 1)
    text = text[: text.index("  end:")] + "  end: *s\n" + text[text.index("  loads:") :]
    scenario = load_scenario(write(tmp_path / "a.yaml", text), {"cable.end.position": [3.6, 0.0]})
    assert (scenario.cable.start.position, scenario.cable.end.position) == ((0.0, 0.0), (3.6, 0.0))


def test_loading_needs_neither_ros_nor_recorders():
    code = (
        "import sys\n"
        "for name in ('rclpy', 'mcap', 'rerun', 'rosbags'): sys.modules[name] = None\n"
        "from cable_twin.scenario import build_system, load_scenario\n"
        "build_system(load_scenario('seed_example'))\n"
    )
    root_directory = Path(__file__).resolve().parents[1]
    subprocess.run([sys.executable, "-c", code], check=True, cwd=root_directory)
