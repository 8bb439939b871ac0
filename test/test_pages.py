"""README.md and docs/: length, working links, and commands with existing options."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

from cable_twin.offline import (
    calibrate,
    design,
    envelope,
    follow,
    import_profile,
    line,
    plant,
    replay,
    report,
    review,
    rules,
    simulate,
    study,
    what_if,
)
from cable_twin.recording.log_writer import FORMAT_VERSION
from cable_twin.ros import sim
from cable_twin.ros.client import drive
from cable_twin.ros.door import plant_door
from cable_twin.scenario.checks.fault import inner_model
from cable_twin.scenario.schema import Scenario
from cable_twin.simulation.snapshot_file import FORMAT_VERSION as SNAPSHOT_VERSION

ROOT = Path(__file__).resolve().parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
TOOLS = {"simulate": simulate, "review": review, "replay": replay, "line": line, "rules": rules, "what_if": what_if}
COMMANDS = {
    "sim": sim,
    "drive": drive,
    "design": design,
    "envelope": envelope,
    "study": study,
    "import_profile": import_profile,
    "plant": plant,
    "follow": follow,
    "calibrate": calibrate,
    "plant_door": plant_door,
    "report": report,
    **TOOLS,
}
CALL = re.compile(rf"^(?: {{4}}|\$ |)(?:\.venv/bin/)?({'|'.join(COMMANDS)})((?: +[^#\n]*|))", re.MULTILINE)

FOLDERS = ("benchmarks", "cable_twin", "config", "docs", "examples", "launch", "test", "verification")
FILES = [f"/{path.relative_to(ROOT).as_posix()}" for folder in FOLDERS for path in (ROOT / folder).rglob("*")]
DEVELOPMENT = ROOT / "docs" / "development.md"


def test_readme_is_short():
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) <= 150


def test_quick_start_has_two_blocks():
    """Blocks that `.ci/run` runs."""
    (section,) = re.findall(r"^## Quick start\n(.*?)^## ", (ROOT / "README.md").read_text(), re.MULTILINE | re.DOTALL)
    first, second = re.findall(r"^```sh\n(.*?)^```$", section, re.MULTILINE | re.DOTALL)
    assert first.splitlines()[-1] == ".venv/bin/sim"
    assert "pytest" in second


def test_the_quick_start_keeps_to_this_machine():
    """ROS 2 announces a twin to the whole network by default, and anyone there may command it."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    first = re.findall(r"^```sh\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)[0]
    assert "export ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST" in first.splitlines()[-2]
    for page in (text, (ROOT / "docs" / "ros2.md").read_text(encoding="utf-8")):
        assert re.search(r"`emergency_stop`[^.]*\bno\s+safety\s+function", page)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_to_files(page):
    links = re.findall(r"\]\(([^)#\s\\]+)(?:#[^)]*)?\)", page.read_text(encoding="utf-8"))
    assert not [link for link in links if "://" not in link and not (page.parent / link).exists()]


def test_every_page_is_reached_from_the_readme():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert not [page.name for page in PAGES[1:] if f"docs/{page.name}" not in text]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_commands_have_the_options_they_are_given(page):
    for command, given in CALL.findall(page.read_text(encoding="utf-8")):
        arguments = given.partition("--ros-args")[0]
        known = COMMANDS[command].parser()._option_string_actions
        assert not [option for option in re.findall(r"(?<= )--[a-z][a-z-]+", arguments) if option not in known], (
            arguments
        )
        for option, value in re.findall(r"(?<= )(--[a-z][a-z-]+) (?!-)('[^']*'|[^\s']+)", arguments):
            if known[option].type is not None and not value.isupper():
                known[option].type(value.strip("'"))  # raises where the command refuses it


def is_there(name):
    """Whether a file or folder of a name or end of a path exists; NAME stands for any."""
    any_name = re.escape(name.strip("/")).replace("NAME", r"\w+").replace(r"\*", r"\w+")
    return (ROOT / name).exists() or any(re.search(rf"/{any_name}$", path) for path in FILES)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_modules_that_are_named_exist(page):
    names = set(re.findall(r"`([\w./*]*\w\.py)`", page.read_text(encoding="utf-8")))
    assert not [name for name in names if not is_there(name)]


def test_what_development_names_exists():
    """Files and folders by path, modules without suffix, functions of modules."""
    text = DEVELOPMENT.read_text(encoding="utf-8")
    named = {name for name in re.findall(r"`([\w./*]+)`", text) if "/" in name}
    ways = {name: (name, f"{name}.py", f"{name.rpartition('.')[0]}.py") for name in named}
    assert len(named) > 30
    assert not [name for name, tried in ways.items() if not any(map(is_there, tried))]


@pytest.mark.parametrize("folder", ["drives", "on_rope", "rope", "language"])
def test_the_house_has_the_modules_that_it_shows(folder):
    (row,) = re.findall(rf"^[ |]+{folder}/ +(.+)$", DEVELOPMENT.read_text(encoding="utf-8"), re.MULTILINE)
    assert not [name for name in row.split(", ") if name != "..." and not is_there(f"mechanics/{folder}/{name}.py")]


def test_keys_of_scenarios_are_in_the_files_that_are_named():
    text = DEVELOPMENT.read_text(encoding="utf-8")
    (table,) = re.findall(r"^\| file \| sections \|\n.*\n((?:\|.*\n)+)", text, re.MULTILINE)
    rows = [re.findall(r"`([\w.]+)`", row) for row in table.splitlines()]
    file_of = {section: file for file, *sections in rows for section in sections}
    for section, field in Scenario.model_fields.items():
        _, model = inner_model(field)
        if model is not None:
            assert f"{model.__module__.rpartition('.')[2]}.py" == file_of.get(section, "schema.py"), section


def test_the_table_of_theory_names_what_the_mechanics_have():
    """Words of the column `code`: functions, arguments, variables or fields in the code."""
    (table,) = re.findall(r"^\| symbol .*\n.*\n((?:\|.*\n)+)", (ROOT / "docs" / "theory.md").read_text(), re.MULTILINE)
    words = {word for row in table.splitlines() for word in re.findall(r"`([\w.]+)`", row)}
    there = names_in(ROOT / "cable_twin" / "mechanics")
    assert len(words) > 30
    assert not [word for word in words if not set(word.split(".")) <= there]


def names_in(folder):
    """All identifiers in the modules of a folder."""
    fields = ("id", "attr", "arg", "name")
    nodes = (node for path in folder.rglob("*.py") for node in ast.walk(ast.parse(path.read_text())))
    return {name for node in nodes for field in fields if isinstance(name := getattr(node, field, None), str)}


def test_the_page_of_logs_names_the_formats_that_are_written():
    text = " ".join((ROOT / "docs" / "logs.md").read_text(encoding="utf-8").split())
    assert re.search(rf'`format_version`[^.]*"{FORMAT_VERSION}"', text)
    assert re.search(rf"\(`\.npz`\)[^.]*\bformat {SNAPSHOT_VERSION}\b", text)
