"""Maps of plants: faults in one line each, what is left out for one, and the page and schema of all keys."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from jsonschema import Draft202012Validator
from ruamel.yaml import YAML

from cable_twin.ros.door import reference
from cable_twin.ros.door.map_file import MapError, names_of, read_map
from cable_twin.ros.door.plant_door import main
from cable_twin.ros.door.quantities import QUANTITIES, UNITS, conversion, units_of
from cable_twin.scenario import load_scenario, scenario_names

ROOT = Path(__file__).resolve().parents[2]
EXAMPLE = ROOT / "examples" / "plant_map.yaml"
SPEED = {"source": "plc", "address": "ns=2;s=v", "quantity": "speed", "of": "cabin", "unit": "m/s"}
BASE = {"opcua": {"plc": {"url": "opc.tcp://127.0.0.1:4840"}}, "mqtt": {"broker": {"host": "127.0.0.1"}}}


@pytest.fixture
def faults(tmp_path):
    """Lines about a map, without the name of its file: those of a fatal fault, or of tags that are left out."""

    def read(**content):
        file = tmp_path / "map.yaml"
        YAML().dump({**BASE, **content}, file)
        try:
            found = read_map(file)
        except MapError as error:
            lines = str(error).splitlines()
        else:
            lines = [*found.left_out, *found.warnings]
        assert all(line.startswith(f"{file}: ") for line in lines)
        return [line.removeprefix(f"{file}: ") for line in lines]

    return read


@pytest.mark.parametrize(
    ("changed", "line"),
    [
        ({"unit": "ft/s"}, "unit: given 'ft/s'; allowed: m/s, mm/s, m/min, km/h, ft/min, kn"),
        ({"unit": "KM/H"}, "unit: given 'KM/H'; did you mean 'km/h'? allowed: m/s, mm/s, m/min, km/h, ft/min, kn"),
        ({"quantity": "sped"}, "quantity: given 'sped'; did you mean 'speed'?"),
        ({"source": "plcc"}, "source: given 'plcc'; allowed: plc, broker"),
        ({"address": "v"}, "address: given 'v'; allowed: a node such as ns=2;s=Cabin.Position or ns=2;i=7"),
        ({"of": "cabn"}, "of: given 'cabn'; did you mean 'cabin'? allowed: cabin of aerial_tramway"),
        ({"axis": "x"}, "axis: given x; allowed: nothing for speed"),
        (
            {"range": [3.0, 3.0]},
            "range: given [3.0, 3.0] m/s; allowed: two numbers, the lowest value, then a higher one",
        ),
        ({"scale": float("nan")}, "scale: given nan; allowed: a finite number"),
        ({"rate": 0.0}, "rate: given 0.0; allowed: a finite number above 0 and at most 1000, in Hz"),
        (
            {"range": [0.0, "many"]},
            "range: given [0.0, 'many']; allowed: a list of 2 finite numbers, in m/s, or null",
        ),
        ({"untt": 1}, "untt: this key does not exist; did you mean 'unit'?"),
        ({"field": "v"}, "field: given 'v'; allowed: for tags of mqtt only"),
        ({"sign": 0}, "sign: given 0; allowed: 1 or -1"),
        (
            {"quantity": "drive_force", "unit": "Nm"},
            "unit: given 'Nm'; written N m; allowed: N, daN, kN, MN, kgf, tf, lbf, N m, kN m",
        ),
        (
            {"quantity": "drive_force", "unit": "kN m"},
            "radius: given nothing, with kN m; allowed: a number above 0, in m",
        ),
        (
            {"quantity": "payload", "unit": "lbs"},
            "unit: given 'lbs'; a mass or a force; as a force lbf; allowed: kg, t",
        ),
        ({"quantity": "acceleration", "unit": "g"}, "axis: given nothing; allowed: one of x, y, z"),
        (
            {"quantity": "wind_speed", "of": "tower"},
            "quantity: given wind_speed without wind_direction; allowed: both, of one place",
        ),
        ({"source": "broker", "address": "lift/+/v"}, "address: given 'lift/+/v'; allowed: one topic, without + and #"),
    ],
)
def test_a_tag_with_a_fault_is_left_out_with_a_line(faults, changed, line):
    position = {**SPEED, "quantity": "position", "unit": "m"}
    lines = faults(scenario="aerial_tramway", tags={"wrong": {**SPEED, **changed}, "right": position})
    assert lines == [f"tags.wrong.{line}; this tag is left out"]


@pytest.mark.parametrize("name", scenario_names())
def test_all_that_a_scenario_names_can_be_measured(faults, name):
    scenario, tags = load_scenario(name), {}
    for kind, (quantity, unit) in {
        "support": ("support_force", "kN"),
        "place": ("wind", "m/s"),
        "driven": ("position", "m"),
        "body": ("pitch", "deg"),
        "wheel": ("wheel_speed", "m/s"),
        "vehicle": ("payload", "kg"),
    }.items():
        axis = {"axis": "x"} if kind == "place" else {}
        common = {"source": "plc", "address": "ns=2;i=7", "quantity": quantity, "unit": unit, **axis}
        tags |= {f"{kind}_{number}": {**common, "of": one} for number, one in enumerate(names_of(kind, scenario))}
    assert len(tags) > 5
    assert faults(scenario=name, tags=tags) == []
    (line,) = faults(tags={"right": SPEED, "wrong": {**common, "quantity": "support_force", "unit": "kN", "of": "a/b"}})
    assert line.startswith("tags.wrong.of: given 'a/b'; allowed: the name of a tower, or an end of a rope")


@pytest.mark.parametrize(
    ("second", "line"),
    [
        ({}, "quantity: given support_force of tower, which tags.first is already; allowed: once"),
        ({"axis": "z"}, "quantity: given support_force z of tower, which tags.first is already; allowed: once"),
        (
            {"direction": [0.0, 0.0, 1.0]},
            "quantity: given support_force of tower, which tags.first is already; allowed: once",
        ),
        ({"axis": "x"}, None),
        ({"of": "start"}, None),
    ],
)
def test_each_place_in_a_message_has_one_tag(faults, second, line):
    first = {"source": "plc", "address": "ns=2;i=7", "quantity": "support_force", "of": "tower", "unit": "kN"}
    lines = faults(tags={"first": first, "second": {**first, **second}})
    assert lines == ([] if line is None else [f"tags.second.{line}; this tag is left out"])


@pytest.mark.parametrize(
    ("content", "line"),
    [
        ({"tags": {}}, "tags: given none that can be used; allowed: at least one tag, or a server"),
        ({"taggs": {}}, "taggs: this key does not exist; did you mean 'tags'?"),
        ({"scenario": "aerial"}, None),
        (
            {"opcua": {"plc": {"url": "http://h:1"}}},
            "opcua.plc.url: given 'http://h:1'; allowed: opc.tcp://HOST:PORT/PATH",
        ),
        ({"opcua": {"plc": {}}}, "opcua.plc.url: given nothing; allowed: a text"),
        (
            {"opcua": {"plc": {"url": "opc.tcp://h:1", "security": "sign"}}},
            "opcua.plc.certificate: given nothing, with security sign; allowed: files certificate and private_key",
        ),
        (
            {"opcua": {"plc": {"url": "opc.tcp://h:1", "security": "encrypt"}}},
            "opcua.plc.security: given 'encrypt'; allowed: one of none, sign, sign_and_encrypt",
        ),
        (
            {"mqtt": {"broker": {"host": "h", "authority": "no.pem", "tls": True}}},
            "mqtt.broker.authority: given 'no.pem': No such file or directory; allowed: a file that can be read",
        ),
        (
            {"mqtt": {"broker": {"host": "h", "port": 70000}}},
            "mqtt.broker.port: given 70000; allowed: a whole number at least 1 and at most 65535",
        ),
    ],
)
def test_a_connection_with_a_fault_is_refused(faults, content, line):
    lines = faults(**{"tags": {"v": SPEED}, **content})
    assert line is None or line in lines
    assert lines


@pytest.mark.parametrize(
    "connection",
    [
        {"url": "opc.tcp://operator:Hunter2x@h:1"},
        {"url": "opc.tcp://h:1", "user": "Hunter2x", "password": "Hunter2x"},
        {"url": "opc.tcp://h:1", "user": {"environment": "UNSET_USER"}, "password": {"file": "none.txt"}},
        {"url": "opc.tcp://h:1", "user": {"value": "Hunter2x"}, "password": {"file": "a", "environment": "b"}},
        {"url": ["Hunter2x"], "private_key_password": ["Hunter2x"]},
    ],
)
def test_no_secret_is_in_a_line(faults, connection):
    lines = faults(opcua={"plc": connection}, tags={"v": SPEED})
    assert lines
    assert "Hunter2x" not in "\n".join(lines)


def test_what_is_unwise_is_warned_of(faults, monkeypatch):
    monkeypatch.setenv("DOOR_USER", "operator")
    user = {"user": {"environment": "DOOR_USER"}, "password": {"environment": "DOOR_USER"}}
    lines = faults(
        opcua={"plc": {"url": "opc.tcp://plc.example:1", **user}},
        mqtt={"broker": {"host": "broker.example", **user}},
        server={"url": "opc.tcp://0.0.0.0:4841"},
        tags={"v": SPEED},
    )
    assert [line.partition(":")[0] for line in lines] == ["opcua.plc.security", "mqtt.broker.tls", "server.user"]


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("a: [", "not YAML"),
        ("- 1\n", "given [1]; allowed: a mapping with description, scenario, opcua, mqtt, tags, server"),
        ("tags: {a: {}}\ntags: {}\n", "tags: given on lines 1 and 2"),
    ],
)
def test_a_file_that_is_no_map_is_one_line(tmp_path, capsys, text, line):
    file = tmp_path / "map.yaml"
    file.write_text(text)
    assert main([str(file), "--check"]) == 2
    (error,) = capsys.readouterr().err.splitlines()
    assert error.startswith(f"plant_door: {file}:")
    assert line in error


def test_a_missing_file_is_one_line(capsys):
    assert main(["nowhere.yaml"]) == 2
    (error,) = capsys.readouterr().err.splitlines()
    assert error == (
        "plant_door: nowhere.yaml: cannot be read (No such file or directory); allowed: a YAML file of a plant map"
    )


def test_check_prints_what_becomes_of_each_tag(capsys):
    assert main([str(EXAMPLE), "--check"]) == 0
    output = capsys.readouterr()
    assert output.err == ""
    lines = output.out.splitlines()
    assert "speed        plc ns=2;s=cabin.speed [km/h] -> /plant/joint_states: cabin speed" in lines
    assert lines[-1] == "server       estimates of /cable_twin -> opc.tcp://127.0.0.1:4841"


def test_units_are_converted():
    expected = {
        ("position", "ft"): (10.0, 3.048),
        ("speed", "km/h"): (36.0, 10.0),
        ("support_force", "kN"): (2.5, 2500.0),
        ("support_force", "bar"): (10.0, 1e6 * 0.02),
        ("drive_force", "kN m"): (3.0, 2000.0),
        ("payload", "t"): (1.2, 1200.0),
        ("pitch", "deg"): (180.0, 3.141592653589793),
        ("temperature", "degF"): (32.0, 0.0),
        ("temperature", "K"): (273.15, 0.0),
    }
    for (name, unit), (given, converted) in expected.items():
        factor, offset = conversion(name, unit, radius=1.5, area=0.02)
        assert given * factor + offset == pytest.approx(converted, abs=1e-9), (name, unit)


def test_every_quantity_has_its_own_unit_among_its_units():
    for name, quantity in QUANTITIES.items():
        assert quantity.unit in units_of(name)
        assert conversion(name, quantity.unit) == (1.0, 0.0)
        assert quantity.unit in UNITS


def test_page_and_json_schema_are_current():
    again = "write it anew: python -m cable_twin.ros.door.reference"
    docs = ROOT / "docs"
    assert (docs / reference.PAGE).read_text(encoding="utf-8") == reference.page(), again
    assert json.loads((docs / reference.JSON_SCHEMA).read_text(encoding="utf-8")) == reference.json_schema(), again


def test_the_json_schema_takes_the_example():
    written = YAML(typ="safe", pure=True).load(EXAMPLE)
    faults = Draft202012Validator(reference.json_schema()).iter_errors(written)
    assert [f"{fault.json_path}: {fault.message}" for fault in faults] == []
