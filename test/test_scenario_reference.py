"""Reference of scenario files: current, complete, and printed by `simulate --explain`."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from jsonschema import Draft202012Validator
from rich.console import Console
from ruamel.yaml import YAML

from cable_twin.offline.simulate import main
from cable_twin.scenario import config_directory, load_scenario, reference, scenario_names

DOCS = Path(__file__).resolve().parents[1] / "docs"
AGAIN = "write it anew: python -m cable_twin.scenario.reference"


def test_page_and_json_schema_are_current():
    assert (DOCS / reference.PAGE).read_text(encoding="utf-8") == reference.page(), AGAIN
    assert json.loads((DOCS / reference.JSON_SCHEMA).read_text(encoding="utf-8")) == reference.json_schema(), AGAIN


def test_every_key_says_what_it_means():
    for entry in reference.entries():
        assert entry.meaning, entry.key
        assert entry.allowed, entry.key
        number = "number" in entry.allowed
        assert bool(entry.unit) == number, entry.key


def test_every_key_of_the_scenarios_is_in_it():
    def keys(node, path=()):
        items = node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else ()
        for key, value in items:
            yield ".".join(map(str, (*path, key)))
            yield from keys(value, (*path, key))

    for name in scenario_names():
        for key in keys(load_scenario(name).resolved()):
            if not key.rpartition(".")[2].isdigit():  # a number of a vector, or of a list, which is its own entry
                assert reference.explained(key), key


def test_scenarios_name_the_json_schema():
    for name in scenario_names():
        file = config_directory() / f"{name}.yaml"
        first = file.read_text(encoding="utf-8").splitlines()[0]
        schema = first.removeprefix("# yaml-language-server: $schema=")
        assert (file.parent / schema).resolve() == DOCS / reference.JSON_SCHEMA


@pytest.mark.parametrize("name", scenario_names())
def test_the_json_schema_takes_what_is_shipped_as_it_stands_in_the_file(name):
    """Also keys of files only: drives of bullwheels, towers of several ropes."""
    written = YAML(typ="safe", pure=True).load(config_directory() / f"{name}.yaml")
    faults = Draft202012Validator(reference.json_schema()).iter_errors(written)
    assert [f"{fault.json_path}: {fault.message}" for fault in faults] == []


@pytest.mark.parametrize(
    ("key", "known"),
    [
        ("sheaves.drive.drive.limits.speed", "sheaves.NAME.drive.limits.speed"),
        ("sheaves.drive.drive.name", "sheaves.NAME.drive.name"),
        ("towers.tower_1.ropes", "towers.NAME.ropes.NAME"),
    ],
)
def test_what_a_file_alone_has_is_explained(key, known):
    assert known in [entry.key for entry in reference.explained(key)]


def test_explain_prints_an_entry(capsys):
    assert main(["--explain", "cable.damping_time"]) == 0
    assert capsys.readouterr().out.splitlines() == [
        "cable.damping_time (s): Kelvin-Voigt relaxation time of EA and EI",
        "  default: 0",
        "  allowed: a finite number at least 0",
    ]


def test_explain_is_readable_on_a_narrow_terminal(capsys, monkeypatch):
    """No cut word, no line longer than the terminal: key with unit, meaning below."""
    monkeypatch.setattr("cable_twin.offline.simulate.table_console", lambda: Console(width=80))
    assert main(["--explain", "limits"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) < 80
    at = lines.index("limits.support_load [N]")
    assert lines[at + 1] == "    highest force of the cable on a support"
    assert lines[at + 2] == "    default: null; allowed: a finite number above 0, or null"


def test_explain_prints_a_section_whatever_a_carriage_is_called(capsys):
    assert main(["--explain", "carriages.cabin.drive.limits"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert any("carriages.NAME.drive.limits.emergency_deceleration" in line and "m/s^2" in line for line in lines)
    assert not any("haul_rope" in line for line in lines)


@pytest.mark.parametrize(
    ("key", "hint"),
    [
        ("cable.dampin_time", "did you mean cable.damping_time,"),
        ("damping_time", "did you mean cable.damping_time,"),
        ("zzz", "sections: name, description, gravity,"),
        ("", "sections: name, "),
    ],
)
def test_a_key_that_does_not_exist_is_one_line(capsys, key, hint):
    assert main(["--explain", key]) == 2
    output = capsys.readouterr()
    (line,) = output.err.splitlines()
    assert line.startswith(f"simulate: --explain {key}: this key does not exist; {hint}")
    assert output.out == ""
